"""The drives of a MuJoCo model: rotors, springs, friction and motors, and notes on differences."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from seaid._arrays import spaced
from seaid.drives import DEAD_ZONES, PARAMETERS_OF, Controller, Drive, unit_of
from seaid.drives.terms import COULOMB, WARM_UP, MotorInput, key_of
from seaid.errors import RobotError, listed
from seaid.export.mjcf_bodies import TINY
from seaid.robot import Robot

SMOOTH = COULOMB[1:]
"""Friction terms that are written as dry friction."""

_SUPPORTED = ("viscous", "coulomb", "offset", *SMOOTH)


def temperature_notes(robot: Robot, temperature_degC: float | None) -> list[str]:
    """Return the notes on the temperature of friction that depends on it."""
    by_temperature: dict[float, list[str]] = {}
    for joint, drive in robot.drives.items():
        if drive.has_temperature_terms:
            at = drive.reference_temperature_degC if temperature_degC is None else temperature_degC
            by_temperature.setdefault(at, []).append(joint)
    notes = [
        f"friction of {', '.join(joints)} at a motor temperature of {at:g} degC"
        for at, joints in by_temperature.items()
    ]
    fading = [joint for joint, drive in robot.drives.items() if {*WARM_UP} & {*drive.friction}]
    return [*notes, f"friction of {', '.join(fading)} of a warm motor"] if fading else notes


def note_drive(joint: str, drive: Drive, notes: list[str]) -> None:
    """Add notes on the terms of a drive that the model lacks or approximates."""
    texts = (*_term_notes(drive), *_control_notes(drive))
    notes += [f"joint '{joint}': {text}" for text in texts]


def unsupported_terms(
    drive: Drive, supported: Collection[str], extra_term: str = "{}"
) -> list[str]:
    """Return the terms of a drive that a format lacks, which has `supported` friction terms."""
    return [
        *(term for term in drive.friction if term not in supported),
        *["dahl of the spring"] * ("dahl" in drive.spring),
        *map(extra_term.format, drive.extra_terms),
        *dict.fromkeys(harmonic.field.replace("_", " ") for harmonic in drive.harmonics),
    ]


def _term_notes(drive: Drive) -> Iterator[str]:
    """Yield the notes on friction, spring, and periodic and extra terms."""
    for term in SMOOTH:
        if term in drive.friction:
            yield f"its {term} is written as dry friction (friction loss)"
    if "cubic" in drive.spring:
        yield "its cubic spring needs a MuJoCo with polynomial stiffness"
    if "smooth_dead_zone" in drive.spring:
        yield "its smooth_dead_zone is written with sharp corners"
    if excluded := unsupported_terms(drive, _SUPPORTED, "extra term {}"):
        yield f"excluded, not available in MuJoCo: {', '.join(excluded)}"
    offset = drive.values.get("spring_offset", 0.0)
    if offset and "preload" not in drive.spring:
        yield (
            f"its spring offset ({offset:.4g} {unit_of(drive, 'spring_offset')}) comes from the "
            "encoder offsets and is not in the model, where the spring is at rest when both sides "
            "are at zero"
        )


def _control_notes(drive: Drive) -> Iterator[str]:
    """Yield the notes on the controller, or on the control of a motor without one."""
    law = drive.law
    if law is None:
        if drive.motor_input != "torque":
            constant = f"{drive.motor_input.replace('current', 'torque')}_constant"
            value = drive.values.get(constant)
            size = "unknown" if value is None else f"{value:.6g} {unit_of(drive, constant)}"
            source = f"{constant} ({size}) times the {drive.motor_input}"
            yield f"its control is the motor torque, {source}"
        return
    if drive.motor_input == "position_command" and law.command_velocity_gain_Nms_per_rad:
        yield (
            "excluded, not available in MuJoCo: the gain on the velocity of the command "
            f"({law.command_velocity_gain_Nms_per_rad:.6g}); add it times the velocity over the "
            f"position gain ({law.position_gain_Nm_per_rad:.6g}) to the command"
        )
    if np.isfinite(law.no_load_speed_rad_per_s):
        falls = (
            f"its torque limit falls with the speed, to zero at {law.no_load_speed_rad_per_s:.6g}"
        )
        yield (
            f"{falls}: a dcmotor, as MuJoCo has it since 3.12, which brakes beyond"
            if _is_dc_motor(drive)
            else f"excluded: {falls}, and is constant in the model"
        )
    if law.nominal_supply_V is not None:
        limits = "limit and gains are" if law.is_duty else "limit is"
        yield f"excluded: the supply voltage; {limits} that at {law.nominal_supply_V:.4g} V"


def note_commands(robot: Robot, step: float, notes: list[str]) -> None:
    """Add notes on the controls of controllers, those of joints with one delay together."""
    joints: dict[tuple[str, float], list[str]] = {}
    for joint, drive in robot.drives.items():
        if drive.controller is not None:
            kind = "position" if drive.motor_input == "position_command" else "velocity"
            delay_s = drive.command_delay_s or 0.0
            delay_s = delay_s if abs(delay_s) >= _ROUNDED_S else 0.0
            joints.setdefault((kind, delay_s), []).append(joint)
    for (kind, delay_s), names in joints.items():
        ms = f"{1e3 * abs(delay_s):.3g} ms"
        late = f", with a delay of {ms}, which MuJoCo has since 3.5" if delay_s > 0 else ""
        late = f"; it would act {ms} early, which no model can" if delay_s < 0 else late
        if delay_s <= 0:
            late += (
                f"; MuJoCo holds it for a step: give that of the middle, {500 * step:.3g} ms later"
            )
        notes.append(f"the control of {listed(names)} is the commanded {kind}{late}")


_ROUNDED_S = 1e-7
"""Delay of a command below which it is rounding."""


def note_drives(robot: Robot, step: float, notes: list[str]) -> None:
    """Add notes on the motors' bodies and on dry friction, which depends on the time step [s]."""
    if robot.elastic_joints:
        notes.append(
            "motors of elastic joints turn on separate bodies fixed in the world "
            f"({TINY:g} kg, and that much of their inertia in kg m^2): the links include the "
            "motors' masses, and gyroscopic torques of rotors are neglected, as in the equations "
            "of the method"
        )
    dry = ("coulomb_friction", "joint_coulomb_friction")
    if any(drive.values.get(name) for drive in robot.drives.values() for name in dry):
        notes.append(
            f"MuJoCo's friction loss is soft: it brakes within a step ({step:g} s), and a joint at "
            "standstill creeps a little; its solreffriction is -2 over the step, so change both"
        )


_FIRM = 0.999
"""Impedance of friction loss, between 0 and 1 (rigid)."""


@dataclass(frozen=True)
class _Coordinate:
    """Attributes of one coordinate (joint or tendon).

    `rest` is the rest position of its spring, and `stiffness` has the coefficients of the force by
    the deflection from there, of its first to its third power.
    """

    armature: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    stiffness: tuple[float, ...] = ()
    rest: tuple[float, ...] = (0.0,)


def add_drives(
    robot: Robot,
    joints: Mapping[str, Any],
    world: Any,
    parts: Sequence[Any],
    step: float,
    notes: list[str],
) -> None:
    """Add all drives to the joints, to the world, and to <tendon> and <actuator>."""
    tendons, actuators = parts
    taken = {*robot.joint_names, *robot.body_names, "world"}
    offsets: list[Any] = []
    for index, joint in enumerate(robot.joint_names):
        drive, C = robot.drives[joint], robot.transmission[index]
        note_drive(joint, drive, notes)
        # The output of drive i turns by C_i q.
        turned = {robot.joint_names[at]: float(C[at]) for at in np.flatnonzero(C)}
        gear = _Coordinate()
        where = {"joint": joint}
        if not drive.is_elastic:
            gear = motor_at(joint, drive, drive.ratio)
            _check_armature(robot, joint, turned, gear.armature)
            # Armature, damping and friction act on the length C_i q of a tendon as they would on a
            # joint.
            if turned != {joint: 1.0}:
                where = {"tendon": _free(f"{joint}_drive", taken)}
                _add_tendon(tendons, where["tendon"], turned, gear, step)
                gear = _Coordinate()
        _set_joint(joints[joint], _at_joint(joint, drive, gear), step)
        if drive.is_elastic:
            where = {"joint": _add_rotor(world, joint, drive, taken, step)}
            lever = {where["joint"]: drive.motor_radius / drive.ratio}
            # The length of the tendon is d = r_M/N theta_M - r_L C_i q (3). It pulls with
            # coefficient times force, which is (4a)/N at the motor and (4b) at the joint.
            lever |= {name: -drive.load_radius * factor for name, factor in turned.items()}
            spring = _spring(joint, drive)
            _add_tendon(tendons, _free(f"{joint}_spring", taken), lever, spring, step)
        kind, attributes = _actuator(joint, drive, step)
        actuators.append(actuators.makeelement(kind, name=joint, **attributes, **where))
        if kind == "dcmotor" and "offset" in drive.friction:
            attributes = {"name": _free(f"{joint}_offset", taken), **_constant(joint, drive)}
            offsets.append(actuators.makeelement("dcmotor", **attributes, **where))
    actuators.extend(offsets)  # behind the others, and without a control
    note_commands(robot, step, notes)
    note_drives(robot, step, notes)


_SHORTER_STEP = 10
"""How much shorter than the written time step a user may make it before delays are cut off."""


def _actuator(joint: str, drive: Drive, step: float) -> tuple[str, dict[str, str]]:
    """Return element and attributes of an actuator on the rotor, or behind a stiff gear.

    Its torque is (tau - F_0) N of a control tau, or that of a controller of positions,
    K_p (u - q) - K_d q' - F_0 N, or of velocities, K_v w - K_d q' - F_0 N; at the rotor of a spring
    these are divided by N, at q = theta_M/N.
    """
    # An elastic drive has its rotor as a joint of its own, with the gear in the spring's tendon.
    gear = 1.0 if drive.is_elastic else drive.ratio
    offset, law = term_value(joint, drive, "friction", "offset"), drive.law
    if law is None:
        attributes = {"gear": spaced([gear])}
        if not offset:
            return "motor", attributes
        return "general", attributes | {"biastype": "affine", "biasprm": spaced([-offset, 0, 0])}
    turns = drive.ratio if drive.is_elastic else 1.0  # of the actuator's coordinate per q
    late = _delay(drive, step)
    if _is_dc_motor(drive):
        return "dcmotor", _dc_motor(law, drive.motor_input, turns) | late
    # MuJoCo: force = gainprm u + b_0 + b_1 length + b_2 velocity, of the actuator's coordinate. At
    # the rotor, K_p (u - theta_M/N)/N = K_p/N u - K_p/N^2 theta_M: one N less for the command.
    bias = law.feedforward_Nm / turns - offset * gear
    gains = (law.position_gain_Nm_per_rad, law.velocity_gain_Nms_per_rad)
    stiffness, rate = (gain / turns**2 for gain in gains)
    is_of_position = drive.motor_input == "position_command"
    of_command = gains[0] if is_of_position else law.command_velocity_gain_Nms_per_rad
    attributes = {
        "gainprm": spaced([of_command / turns]),
        "biastype": "affine",
        "biasprm": spaced([bias, -stiffness, -rate]),
    }
    limit = law.torque_limit_Nm / turns
    if np.isfinite(limit):
        # forcerange cuts off the whole force, friction offset included, which is no torque of the
        # controller: both limits move with it.
        shifted = [-limit - offset * gear, limit - offset * gear]
        attributes |= {"forcelimited": "true", "forcerange": spaced(shifted)}
    return "general", attributes | late


def _delay(drive: Drive, step: float) -> dict[str, str]:
    """Return the attributes of the delay of the command, none without one."""
    delay = drive.command_delay_s or 0.0
    if delay < _ROUNDED_S:
        return {}
    # MuJoCo's buffer has one sample per step: a user's shorter steps need more of them.
    samples = int(np.ceil(_SHORTER_STEP * delay / step)) + 1
    return {"delay": spaced([delay]), "nsample": str(samples), "interp": "linear"}


def _is_dc_motor(drive: Drive) -> bool:
    """Return whether a drive has a torque limit that falls with the speed, as a dcmotor's.

    Its controller has one velocity gain, and no constant torque.
    """
    law = drive.law
    if law is None or not np.all(np.isfinite([law.torque_limit_Nm, law.no_load_speed_rad_per_s])):
        return False
    gains = law.velocity_gain_Nms_per_rad, law.command_velocity_gain_Nms_per_rad
    is_of_position = drive.motor_input == "position_command"
    # The controller of a dcmotor has one gain on w - q' and no constant.
    return not law.feedforward_Nm and (is_of_position or gains[0] == gains[1])


def _dc_motor(law: Controller, motor_input: MotorInput, turns: float) -> dict[str, str]:
    """Return the attributes of a dcmotor at q, whose voltage and torque are limited.

    By the voltage V that stalls at the limit and runs at v_0, the torque is within
    -limit (1 + q'/v_0) and limit (1 - q'/v_0), and by the saturation within -limit and limit.
    """
    volts, limit = law.nominal_supply_V or 1.0, law.torque_limit_Nm
    is_of_position = motor_input == "position_command"
    gain = law.position_gain_Nm_per_rad if is_of_position else 0.0
    return {
        # At the rotor q = theta_M/N: a gear of 1/N makes the actuator see q, and act on theta_M
        # with 1/N.
        "gear": spaced([1 / turns]),
        "input": "pos" if is_of_position else "vel",
        # Nominal voltage, stall torque and no-load speed: MuJoCo computes K_t and R from these
        # three.
        "nominal": spaced([volts, limit, law.no_load_speed_rad_per_s]),
        "saturation": spaced([limit, 0, 0]),
        "controller": spaced([gain, 0, law.velocity_gain_Nms_per_rad, 0, 0, volts]),
    }


def _constant(joint: str, drive: Drive) -> dict[str, str]:
    """Return the attributes of a dcmotor without control that gives the friction offset.

    Its cogging torque has no poles, a sin(pi/2), and its winding is as good as none.
    """
    torque = value_of(joint, drive, "friction_offset") * (1.0 if drive.is_elastic else drive.ratio)
    return {
        "input": "none",
        # Without a control this constant and the resistance of 1 ohm leave a back-EMF damping of
        # 1e-18.
        "motorconst": spaced([1e-9, 0]),
        "resistance": "1",
        "cogging": spaced([-torque, 0, np.pi / 2]),
    }


def _at_joint(joint: str, drive: Drive, gear: _Coordinate) -> _Coordinate:
    """Return the parallel spring and the friction of a joint, with those of a `gear` on it."""
    damping = gear.damping + term_value(joint, drive, "joint_friction", "viscous")
    friction = gear.friction + term_value(joint, drive, "joint_friction", "coulomb")
    stiffness = term_value(joint, drive, "parallel_spring", "linear")
    preload = term_value(joint, drive, "parallel_spring", "preload")
    if stiffness == 0 and preload != 0:
        raise RobotError(
            f"joint '{joint}': MuJoCo has no parallel preload without a parallel spring: give "
            "parallel_spring=('linear', 'preload')"
        )
    # k q + f_p = k (q - rest)
    rest = -preload / stiffness if stiffness else 0.0
    if stiffness < 0:
        raise RobotError(
            f"joint '{joint}': MuJoCo has no parallel spring with a negative stiffness, found "
            f"{stiffness:.4g} {unit_of(drive, 'parallel_stiffness')}"
        )
    springs = (stiffness,) if stiffness else ()
    return _Coordinate(gear.armature, damping, friction, springs, (rest,))


def motor_at(joint: str, drive: Drive, ratio: float) -> _Coordinate:
    """Return inertia and friction of a motor at a coordinate q with theta_M = ratio q."""
    # With tau = n tau_M too, inertia and viscous friction grow by n^2, and dry friction, whose size
    # does not depend on the speed, by n.
    friction = 0.0
    # Smooth terms share the parameter F_C with the plain one; simulators have only the plain one.
    if {*COULOMB} & {*drive.friction}:
        friction = ratio * value_of(joint, drive, "coulomb_friction")
    return _Coordinate(
        armature=ratio**2 * value_of(joint, drive, "motor_inertia"),
        damping=ratio**2 * term_value(joint, drive, "friction", "viscous"),
        friction=friction,
    )


def _spring(joint: str, drive: Drive) -> _Coordinate:
    """Return the spring of a drive in the coordinate of its deflection."""
    if "fifth" in drive.spring:
        raise RobotError(
            f"joint '{joint}': the spring has the term 'fifth', and MuJoCo's springs end with the "
            "third power: give or identify one with spring=('linear', 'cubic')"
        )
    k, k_3, f_0 = (term_value(joint, drive, "spring", x) for x in ("linear", "cubic", "preload"))
    if not (k or k_3):
        raise RobotError(f"joint '{joint}': its spring has no stiffness, found 0")
    zero = drive.values.get("deflection_zero", 0.0)
    # A springlength of two numbers is a dead band between them in MuJoCo.
    gap = value_of(joint, drive, "dead_zone") if {*DEAD_ZONES} & {*drive.spring} else 0.0
    if gap and f_0:
        raise RobotError(
            f"joint '{joint}': the spring has a dead zone and a preload that acts inside it, "
            "which MuJoCo's springs lack: give or identify one without one of the two"
        )
    # f_0 + k d + k_3 d^3 = (k + 3 k_3 r^2) x + 3 k_3 r x^2 + k_3 x^3 at x = d - r from its root r
    roots = np.roots([k_3, 0.0, k, f_0])
    # Of three real roots (a softening spring) the one next to zero is the rest position in use.
    r = float(min(roots[roots.imag == 0].real, key=abs))
    rest = (zero - gap, zero + gap) if gap else (zero + r,)
    stiffness = (k + 3 * k_3 * r**2, 3 * k_3 * r, k_3) if k_3 else (k,)
    return _Coordinate(0.0, term_value(joint, drive, "spring", "damping"), 0.0, stiffness, rest)


def term_value(joint: str, drive: Drive, field: str, term: str) -> float:
    """Return the value of a term with one parameter, zero if the drive lacks the term."""
    (name,) = PARAMETERS_OF[field][term]
    return value_of(joint, drive, name) if term in getattr(drive, field) else 0.0


def value_of(joint: str, drive: Drive, name: str) -> float:
    """Return the value of a parameter of a drive, or raise RobotError if it is unknown."""
    values = drive.values
    if name not in values:
        raise RobotError(
            f"joint '{joint}': '{key_of(name, unit_of(drive, name))}' is not known; the model "
            "of a simulator needs it: identify it, or give a nominal value"
        )
    return values[name]


def _set_joint(element: Any, values: _Coordinate, step: float) -> None:
    _set_numbers(element, values, step)
    if values.rest[0]:
        element.set("springref", spaced(values.rest))


def _add_tendon(
    tendons: Any, name: str, lever: Mapping[str, float], values: _Coordinate, step: float
) -> None:
    """Add a fixed tendon with the length sum(lever * coordinate)."""
    element = tendons.makeelement("fixed", name=name)
    _set_numbers(element, values, step)
    if values.stiffness:
        element.set("springlength", spaced(values.rest))
    for joint, factor in lever.items():
        element.append(element.makeelement("joint", joint=joint, coef=spaced([factor])))
    tendons.append(element)


def _set_numbers(element: Any, values: _Coordinate, step: float) -> None:
    """Set what joints and tendons share; friction brakes within one step, the shortest time."""
    numbers = {
        "armature": values.armature,
        "damping": values.damping,
        "frictionloss": values.friction,
    }
    for name, number in numbers.items():
        if number:
            element.set(name, spaced([number]))
    if values.stiffness:
        element.set("stiffness", spaced(values.stiffness))
    if values.friction:
        # direct: v' = -2/step v at reversals, the most that a step of RK4 damps
        element.set("solreffriction", spaced([-1.0, -2 / step]))
        element.set("solimpfriction", spaced([_FIRM, _FIRM, 0.001]))


def _add_rotor(world: Any, joint: str, drive: Drive, taken: set[str], step: float) -> str:
    """Add the motor of an elastic drive as a separate body; return the name of its joint."""
    name = _free(f"{joint}_motor", taken)
    values = motor_at(joint, drive, 1.0)
    if values.armature <= TINY:
        raise RobotError(f"joint '{joint}': an elastic drive needs a motor inertia to be simulated")
    body = world.makeelement("body", name=name)
    nothing = {"mass": spaced([TINY]), "diaginertia": spaced([TINY] * 3)}
    body.append(body.makeelement("inertial", pos="0 0 0", **nothing))
    element = body.makeelement("joint", name=name, type="hinge", axis="0 0 1", limited="false")
    # the body's own inertia about its axis is subtracted from the armature
    _set_joint(element, _Coordinate(values.armature - TINY, values.damping, values.friction), step)
    body.append(element)
    world.append(body)
    return name


def _free(name: str, taken: set[str]) -> str:
    """Return an unused name, and add it to those taken."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _check_armature(robot: Robot, joint: str, turned: Mapping[str, float], armature: float) -> None:
    """Raise RobotError for rotor inertia that couples branches, which MuJoCo would neglect."""
    if not armature:
        return
    # The rotor adds N^2 I_M C_i^T C_i to the mass matrix. MuJoCo stores only entries of a joint and
    # its ancestors, so those between two branches would be lost.
    places = [int(robot.model.getJointId(name)) for name in turned]
    supports: dict[int, pin.StdVec_Index] = {at: list(robot.model.supports[at]) for at in places}
    for first in places:
        for second in places:
            if first not in supports[second] and second not in supports[first]:
                raise RobotError(
                    f"joint '{joint}': its stiff drive moves joints of different branches "
                    f"({', '.join(turned)}), and MuJoCo does not couple their inertia: it can be "
                    "written with motor_inertia_kg_m2 = 0, or as an elastic drive"
                )
