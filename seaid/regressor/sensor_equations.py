"""The equations of a robot with its drives that remain usable with a set of sensors.

Every drive has a motor equation (7) and, if elastic, a spring equation (3); every joint has a load
equation (8). They share the torques of the motors and those on the drives' coordinates. A torque
without a sensor is an unknown function of time and must be eliminated; an equation with a position
that no sensor determines cannot be used. `explanations` reports both in sentences.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import chain

import numpy as np
import sympy as sp
from flint import fmpq

from seaid._arrays import BoolArray, safely
from seaid.drives import PARAMETERS_OF, Drive, ParameterName, motor_equation, spring_force
from seaid.drives.equations import (
    PARAMETER_NAMES,
    SIGNALS,
    K_t,
    K_u,
    N,
    joint_equation,
    known_values,
    r_L,
    r_M,
    s_K,
    tau_L,
)
from seaid.drives.regressor import flat_names
from seaid.drives.terms import MotorInput
from seaid.errors import RobotError
from seaid.regressor.exact.geometry import exact_number
from seaid.regressor.exact.grouping import subtract
from seaid.robot import Robot


@dataclass(frozen=True, eq=False)
class KnownPositions:
    """Which positions the sensors determine: motors, drives' coordinates, joints, deflections."""

    motor: tuple[bool, ...]
    driven: tuple[bool, ...]
    joint: tuple[bool, ...]
    stretch: tuple[bool, ...]


_DETERMINED = 1e-9
"""Largest part of a position outside the row space of the encoders that is rounding."""


def known_positions(robot: Robot, sensors: Mapping[str, frozenset[str]]) -> KnownPositions:
    """Return which positions are in the row space of the encoders' and stiff drives' equations."""
    radii = [[robot.drives[joint].load_radius] for joint in robot.joint_names]
    # Coordinates: the motor angles r_M/N theta_M, in the joints' unit, then the joint positions.
    motors, joints = np.split(np.eye(2 * robot.n), 2)
    driven = robot.transmission @ joints
    # (3): r_M/N theta_M - r_L theta_L.
    stretches = motors - np.array(radii) * driven
    encoders = ("motor_position", "joint_position", "deflection")
    seen = np.array([[name in sensors[joint] for joint in robot.joint_names] for name in encoders])
    seen[2] |= ~np.isin(robot.joint_names, robot.elastic_joints)  # zero for a stiff drive
    rows = np.vstack([motors, joints, stretches])[seen.ravel()]
    positions = np.vstack([motors, driven, joints, stretches])
    inverse = safely(np.linalg.pinv, rows, what="the positions of the joints", error=RobotError)
    outside = positions - positions @ inverse @ rows
    known = np.linalg.norm(outside, axis=1) < _DETERMINED * np.linalg.norm(positions, axis=1)
    return KnownPositions(*(tuple(part.tolist()) for part in np.split(known, 4)))


INPUTS: dict[str, MotorInput] = {
    "motor_torque": "torque",
    "motor_current": "current",
    "motor_voltage": "voltage",
}
"""{sensor of a motor's input: `motor_input`}, the best first."""


def input_sensor(drive: Drive) -> str:
    """Return the sensor of a drive's input; known gains make a torque of a commanded position.

    Gains that are known up to scale make as much of it as a current does.
    """
    if drive.is_up_to_scale and "gain_scale" not in drive.known:
        return "motor_current"
    return "motor_torque" if drive.controller is not None else f"motor_{drive.motor_input}"


BACK_EMF = sp.Symbol("back_emf_damping", real=True)
"""Damping by the back-EMF, a parameter of its own if voltage and torque are both measured."""

_REAL = {
    name: sp.Symbol(name, real=True)
    for signal in SIGNALS
    for name in (f"{signal.func}{suffix}" for suffix in ("", "_dot", "_ddot"))
}
STRETCH, STRETCH_DOT = (sp.Symbol(f"deflection{suffix}", real=True) for suffix in ("", "_dot"))
MOTOR_SIGNALS = {"motor_torque": "tau_M", "motor_current": "i_M", "motor_voltage": "u_M"}

_SCALES = {"motor_torque": sp.Integer(1), "motor_current": K_t, "motor_voltage": K_u}
"""{sensor of a motor: what its signal is multiplied by to give a torque}."""


def plain(name: str) -> sp.Symbol:
    """Return the real symbol of a signal such as "theta_M_dot"."""
    return _REAL[name]


@dataclass(frozen=True, eq=False)
class DriveTerms:
    """The equations of one drive in real symbols.

    `motor` is (7) without motor and load torque: motor + share * tau = tau_M with the torque tau on
    the drive's coordinate. `spring` is (3), None for a stiff drive; `joint` is the torque of the
    joint terms. `inputs` {sensor: motor torque by that sensor}; `driver` is the sensor with which
    the motor equation is written.
    """

    drive: Drive
    motor: sp.Expr
    share: fmpq
    spring: sp.Expr | None
    joint: sp.Expr
    inputs: Mapping[str, sp.Expr]
    driver: str
    known: Mapping[sp.Symbol, float]
    unknowns: tuple[sp.Symbol, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknown parameters."""
        return tuple(PARAMETER_NAMES.get(symbol, str(symbol)) for symbol in self.unknowns)


@cache
def drive_terms(drive: Drive, sensors: frozenset[str]) -> DriveTerms:
    """Return the equations of a drive whose motor has the given sensors.

    Periodic errors and friction by temperature are excluded: their functions are independent of all
    others. Hysteresis counts as its limit without presliding.
    """
    drive = drive.without_harmonics().at_temperature().without_memory()
    sensed = [x for x in INPUTS if x in sensors] or [input_sensor(drive)]
    driver = sensed[0]
    seen, scale, source = _driven_by(drive, INPUTS[driver]), _SCALES[driver], MOTOR_SIGNALS[driver]
    ratio, in_, out = map(exact_number, (seen.ratio, seen.motor_radius, seen.load_radius))
    share, behind, spring = 1 / ratio, tau_L / N, None
    if seen.is_elastic:
        force, share = spring_force(seen), in_ / (ratio * out)
        behind, spring = r_M / N * force, _rewrite_by_stretch(_plain(force))
    motor = _plain(motor_equation(seen).expression - behind) + scale * plain(source)
    joint = _plain(joint_equation(seen).expression + tau_L)
    inputs = {sensor: _input(sensor, driver) for sensor in sensed}
    if drive.is_up_to_scale:
        inputs = {sensor: torque.xreplace({K_t: s_K}) for sensor, torque in inputs.items()}
        motor = motor.xreplace({K_t: s_K})
    motor, known = _rewrite_by_stretch(sp.expand(motor)), known_values(seen)
    expressions = [motor, joint, *inputs.values(), *([] if spring is None else [spring])]
    return DriveTerms(
        drive=seen,
        motor=motor,
        share=share,
        spring=spring,
        joint=joint,
        inputs=inputs,
        driver=driver,
        known=known,
        unknowns=_unknowns(expressions, known),
    )


def _input(sensor: str, driver: str) -> sp.Expr:
    """Return the motor torque by a sensor of current or voltage, 0 for a torque sensor."""
    if sensor == "motor_torque":
        return sp.Integer(0)
    lost = BACK_EMF * plain("theta_M_dot") if sensor == "motor_voltage" != driver else 0
    return _SCALES[sensor] * plain(MOTOR_SIGNALS[sensor]) - lost


def _unknowns(
    expressions: Iterable[sp.Expr], known: Mapping[sp.Symbol, float]
) -> tuple[sp.Symbol, ...]:
    """Return the unknown parameters: those of the catalogue in its order, then others by name."""
    free = {symbol for expression in expressions for symbol in expression.free_symbols}
    free -= {*_REAL.values(), STRETCH, STRETCH_DOT, *known}
    named = [symbol for symbol in PARAMETER_NAMES if symbol in free]
    return (*named, *sorted(free - set(named), key=str))


def _driven_by(drive: Drive, motor_input: MotorInput) -> Drive:
    """Return the drive with another motor input, and the constants that go with it."""
    if motor_input == drive.motor_input:
        return drive
    parameters = PARAMETERS_OF["motor_input"]
    lost = set(chain(*parameters.values())).difference(parameters[motor_input])
    nominal = {name: x for name, x in drive.nominal.items() if name not in lost}
    known = tuple(name for name in drive.known if name not in lost)
    return replace(drive, controller=None, motor_input=motor_input, nominal=nominal, known=known)


@cache  # drives of a kind have the same equations
def _plain(expression: sp.Expr) -> sp.Expr:
    """Return an expression with the signals as real symbols."""
    return flat_names(expression).xreplace({sp.Symbol(name): s for name, s in _REAL.items()})


@cache
def _rewrite_by_stretch(expression: sp.Expr) -> sp.Expr:
    """Rewrite an expression that depends on both positions only through the deflection."""
    rewritten = expression
    for suffix, stretch in (("", STRETCH), ("_dot", STRETCH_DOT)):
        motor, load = _REAL[f"theta_M{suffix}"], _REAL[f"theta_L{suffix}"]
        if load in rewritten.free_symbols and motor in rewritten.free_symbols:
            # (3): theta_M = N / r_M (d + r_L theta_L) with the deflection d.
            through = sp.expand(rewritten.xreplace({motor: N / r_M * (stretch + r_L * load)}))
            if load not in through.free_symbols:
                rewritten = through
    return rewritten


@dataclass(frozen=True, eq=False)
class Equation:
    """An equation that is zero along every motion.

    `kind` is "motor", "spring", "input", "load" or "sensor", `index` its drive or joint. It is the
    sum of its `parts` (drive, factor, expression), of `torques` {("motor" or "load", drive):
    factor} and, for kind "load", of minus the rigid bodies' torque. `missing` has the reasons for
    which it cannot be used.
    """

    kind: str
    index: int
    parts: tuple[tuple[int, fmpq, sp.Expr], ...]
    torques: Mapping[tuple[str, int], fmpq]
    missing: tuple[str, ...] = ()


def equations_of(
    robot: Robot,
    terms: Sequence[DriveTerms],
    sensors: Mapping[str, frozenset[str]],
    depends: BoolArray,
) -> list[Equation]:
    """Return all equations; torque j depends on the motion of joint k if `depends[j, k]`."""
    seen = known_positions(robot, sensors)
    equations: list[Equation] = []
    for i, (joint, drive) in enumerate(zip(robot.joint_names, terms, strict=True)):
        equations += _drive_equations(i, drive, sensors[joint], seen)
    equations += _load_rows(robot, terms, sensors, seen, depends)
    return equations


def _drive_equations(
    i: int, terms: DriveTerms, sensors: frozenset[str], seen: KnownPositions
) -> Iterator[Equation]:
    unity, missing = fmpq(1), _missing(terms.motor, i, sensors, seen)
    torques = {("motor", i): -unity, ("load", i): terms.share}
    yield Equation("motor", i, ((i, unity, terms.motor),), torques, missing)
    if terms.spring is not None:
        torques = {("load", i): -1 / exact_number(terms.drive.load_radius)}
        missing = _missing(terms.spring, i, sensors, seen)
        yield Equation("spring", i, ((i, unity, terms.spring),), torques, missing)
    for sensor, expression in terms.inputs.items():
        missing = _missing(expression, i, sensors, seen)
        if sensor not in sensors:
            missing = (f"no {sensor.replace('_', ' ')}",)
        yield Equation("input", i, ((i, unity, expression),), {("motor", i): -unity}, missing)


def _load_rows(
    robot: Robot,
    terms: Sequence[DriveTerms],
    sensors: Mapping[str, frozenset[str]],
    seen: KnownPositions,
    depends: BoolArray,
) -> Iterator[Equation]:
    C = robot.transmission
    for j, joint in enumerate(robot.joint_names):
        movers = np.flatnonzero(C[:, j]).tolist()
        torques = {("load", i): exact_number(C[i, j]) for i in movers}
        # (8): sum over drives of C_ij (tau_i - joint terms of i) = torque of the rigid bodies.
        parts = tuple((i, -x, terms[i].joint) for (_, i), x in torques.items())
        unknown = np.array(robot.joint_names)[depends[j] & ~np.array(seen.joint)].tolist()
        text = f"the position of {', '.join(unknown)} is not known"
        missing: tuple[str, ...] = (text,) if unknown else ()
        for i, _, expression in parts:
            missing = missing or _missing(expression, i, sensors[joint], seen)
        yield Equation("load", j, parts, torques, missing)
        if "joint_torque" in sensors[joint]:
            yield Equation("sensor", j, (), torques)


def _missing(
    expression: sp.Expr, i: int, sensors: frozenset[str], seen: KnownPositions
) -> tuple[str, ...]:
    """Return the quantities in an expression that the sensors do not determine."""
    symbols = {symbol.name for symbol in expression.free_symbols}
    names = {name.removesuffix("_ddot").removesuffix("_dot") for name in symbols}
    is_felt = bool(sensors & {*INPUTS, "joint_torque"})
    needs = {
        "theta_M": ("the motor's position is not known", seen.motor[i]),
        "theta_L": ("the joint's position is not known", seen.driven[i]),
        "deflection": ("the spring's deflection is not known", seen.stretch[i]),
        "tau_G": ("its friction needs the torque through the gear", is_felt),
    }
    return tuple(text for name, (text, is_known) in needs.items() if name in names and not is_known)


Sum = Mapping[int, fmpq]
"""{equation: factor}: a sum of equations without unknown torques."""


def eliminations(equations: Sequence[Equation]) -> list[Sum]:
    """Return the sums of usable equations without unknown torques, by substitution.

    Each torque is eliminated by the first equation that contains it. Factors are rationals here,
    so that what cancels is zero, and sums have no more equations than they need.
    """
    torques = sorted(set(chain(*(equation.torques for equation in equations))))
    usable = [(e, equation) for e, equation in enumerate(equations) if not equation.missing]
    rows = [(dict(equation.torques), {e: fmpq(1)}) for e, equation in usable]
    for torque in torques:
        holders = [row for row in rows if torque in row[0]]
        for row in holders[1:]:
            factor = row[0][torque] / holders[0][0][torque]
            subtract(row[0], factor, holders[0][0])
            subtract(row[1], factor, holders[0][1])
        rows = [row for row in rows if torque not in row[0]]
    return [sums for _, sums in rows]


@dataclass(frozen=True, eq=False)
class System:
    """The equations of a robot; the `sums` of them have no unknown torques.

    `names` are those of the unknown parameters: ten per body, then those of the drives.
    """

    robot: Robot
    terms: tuple[DriveTerms, ...]
    equations: tuple[Equation, ...]
    sums: tuple[Sum, ...]
    names: tuple[str, ...]

    @cached_property
    def used(self) -> frozenset[int]:
        """The indices of the equations that occur in a sum."""
        return frozenset(chain(*self.sums))


def system_of(robot: Robot, sensors: Mapping[str, frozenset[str]], depends: BoolArray) -> System:
    """Return the equations of a robot with given sensors; `depends` as in `equations_of`."""
    joints = robot.joint_names
    terms = tuple(drive_terms(robot.drives[joint], sensors[joint]) for joint in joints)
    equations = equations_of(robot, terms, sensors, depends)
    drives = zip(joints, terms, strict=True)
    names = [ParameterName(name, joint) for joint, drive in drives for name in drive.names]
    names_of_all = (*robot.parameter_names, *names)
    return System(robot, terms, tuple(equations), tuple(eliminations(equations)), names_of_all)


_TITLES = {"motor": "(7) of its motor", "spring": "(4b) of its spring", "load": "(8) of its load"}

_TORQUES = {
    "stiffness": "spring torque",
    "torque_constant": "motor torque",
    "voltage_constant": "motor torque",
    "gain_scale": "motor torque",
}


def explanations(system: System, scaled: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return {joint: sentences about its equations}; `scaled` are parameters known up to scale."""
    return {
        joint: (*_sentences(system, index), *_scales(joint, scaled))
        for index, joint in enumerate(system.robot.joint_names)
    }


def _scales(joint: str, scaled: Collection[str]) -> Iterator[str]:
    """Yield the torques of a joint that are known only up to scale."""
    for name, torque in _TORQUES.items():
        if ParameterName(name, joint) in scaled:
            yield f"its {torque} is known only up to the scale of its {name.replace('_', ' ')}"


def _sentences(system: System, index: int) -> Iterator[str]:
    of_joint = [(e, x) for e, x in enumerate(system.equations) if x.index == index]
    has_input = any(equation.kind == "input" and not equation.missing for _, equation in of_joint)
    for e, equation in of_joint:
        if equation.kind not in _TITLES:
            continue
        if e in system.used:
            use = f"is used{_sensor_text(system, equation)}"
        else:
            use = f"cannot be used: {_obstacle(equation, has_input)}"
        yield f"{_TITLES[equation.kind]} {use}"


def _obstacle(equation: Equation, has_input: bool) -> str:
    if equation.kind == "motor" and not (has_input or equation.missing):
        return "no motor torque, current or voltage"
    return "; ".join(equation.missing) or "the torque on its load is not determined"


def _sensor_text(system: System, equation: Equation) -> str:
    """Return the sensor with which a motor equation is used, as text."""
    if equation.kind != "motor":
        return ""
    terms = system.terms[equation.index]
    if "gain_scale" in terms.names:
        return ", by its command and gains times an unknown gain scale"
    constant = {"motor_current": "torque constant", "motor_voltage": "voltage constant"}
    text = f", by motor {INPUTS[terms.driver]}"
    name = constant.get(terms.driver)
    unknown = name is not None and name.replace(" ", "_") in terms.names
    return f"{text} times an unknown {name}" if unknown else text
