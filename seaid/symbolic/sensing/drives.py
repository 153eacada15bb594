"""The equations of one drive as the sensors of its motor see it, in plain symbols."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import sympy as sp

from seaid.drivetrain.equations import joint_equation, motor_equation, spring_force
from seaid.drivetrain.model import Drive, SeriesElasticDrive
from seaid.drivetrain.regressor import flat_names
from seaid.drivetrain.symbols import (
    PARAMETER_NAMES,
    SIGNALS,
    K_t,
    K_u,
    N,
    known_values,
    r_L,
    r_M,
    tau_L,
)

INPUTS = {"motor_torque": "torque", "motor_current": "current", "motor_voltage": "voltage"}
"""Sensors of what drives a motor, and the `motor_input` that each is; the best first."""

BACK_EMF = sp.Symbol("back_emf_damping", real=True)
"""What a voltage loses to the motor's speed, where the torque is measured beside it."""

_REAL = {
    name: sp.Symbol(name, real=True)
    for signal in SIGNALS
    for name in (f"{signal.func}{suffix}" for suffix in ("", "_dot", "_ddot"))
}
STRETCH, STRETCH_DOT = (sp.Symbol(f"deflection{suffix}", real=True) for suffix in ("", "_dot"))
MOTOR_SIGNALS = {"motor_torque": "tau_M", "motor_current": "i_M", "motor_voltage": "u_M"}
_SCALES = {"motor_torque": sp.Integer(1), "motor_current": K_t, "motor_voltage": K_u}


def plain(name: str) -> sp.Symbol:
    """Return the symbol of a signal, as "theta_M_dot"."""
    return _REAL[name]


@dataclass(frozen=True, eq=False)
class DriveTerms:
    """The equations of one drive in plain real symbols.

    `motor` is (7) without the torques on both sides of it: motor + share * tau = tau_M, `share`
    that of the torque tau on what the drive turns; `spring` is (3), None for a stiff drive;
    `beside` is what the joint has beside the rigid bodies. `inputs` {sensor: what it says of the
    motor's torque}; `driver` is the sensor in which the motor balance is written.
    """

    drive: Drive
    motor: sp.Expr
    share: sp.Expr
    spring: sp.Expr | None
    beside: sp.Expr
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
    """Return the equations of a drive as the sensors of its motor see it."""
    own = next(sensor for sensor, name in INPUTS.items() if name == drive.motor_input)
    sensed = [sensor for sensor in INPUTS if sensor in sensors] or [own]
    driver = sensed[0]
    seen, scale, source = _driven_by(drive, INPUTS[driver]), _SCALES[driver], MOTOR_SIGNALS[driver]
    force = spring_force(seen) if isinstance(seen, SeriesElasticDrive) else None
    behind = tau_L / N if force is None else r_M / N * force
    motor = _plain(motor_equation(seen).expression - behind) + scale * plain(source)
    spring = None if force is None else _by_stretch(_plain(force))
    beside = _plain(joint_equation(seen).expression + tau_L)
    inputs = {sensor: _input(sensor, driver) for sensor in sensed}
    motor, known = _by_stretch(sp.expand(motor)), known_values(seen)
    expressions = [motor, beside, *inputs.values(), *([] if spring is None else [spring])]
    return DriveTerms(
        drive=seen,
        motor=motor,
        share=1 / N if force is None else r_M / (N * r_L),
        spring=spring,
        beside=beside,
        inputs=inputs,
        driver=driver,
        known=known,
        unknowns=_unknowns(expressions, known),
    )


def _input(sensor: str, driver: str) -> sp.Expr:
    """Return what a sensor says of the motor's torque, 0 for one of the torque itself."""
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


def _driven_by(drive: Drive, motor_input: str) -> Drive:
    """Return the drive with another motor input."""
    if motor_input == drive.motor_input:
        return drive
    constants = ("torque_constant", "voltage_constant")
    wanted = {"current": constants[0], "voltage": constants[1]}.get(motor_input)
    kept = {name: x for name, x in drive.nominal.items() if name not in constants or name == wanted}
    known = tuple(name for name in drive.known if name not in constants or name in kept)
    return replace(drive, motor_input=motor_input, nominal=kept, known=known)


def _plain(expression: sp.Expr) -> sp.Expr:
    """Return an expression with the signals as real symbols."""
    return flat_names(expression).xreplace({sp.Symbol(name): s for name, s in _REAL.items()})


def _by_stretch(expression: sp.Expr) -> sp.Expr:
    """Write what depends on both positions only through the deflection as a function of that."""
    found = expression
    for suffix, stretch in (("", STRETCH), ("_dot", STRETCH_DOT)):
        motor, load = _REAL[f"theta_M{suffix}"], _REAL[f"theta_L{suffix}"]
        if load in found.free_symbols and motor in found.free_symbols:
            through = sp.expand(found.xreplace({motor: N / r_M * (stretch + r_L * load)}))
            if load not in through.free_symbols:
                found = through
    return found
