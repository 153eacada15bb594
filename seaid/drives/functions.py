"""Drive equations as compiled functions: values for simulation, values and slopes for planning.

- `drive_functions`: the terms of a drive with its values, at a state;
- `spring_curve`: the force of a spring at rest over its deflection;
- `smooth_columns`: columns of the regressor (10) with derivatives by the signals;
- `friction_curve`, `joint_curve`: the torques of friction and joint terms in the same way;
- `nonlinear_spring`: deflection of a nonlinear spring as a function of its force.

A "slope" is a derivative. "Joint terms" are parallel spring and joint friction, which act between
the joint's two bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
import sympy as sp

from seaid._arrays import Array, FrozenMapping
from seaid.drives.drives import Drive, StiffDrive, check_divisors, is_dry, total_ratio, unit_of
from seaid.drives.equations import (
    PARAMETER_NAMES,
    Dahl,
    DahlSlope,
    K_t,
    K_u,
    N,
    dry_friction,
    extra_terms,
    joint_equation,
    known_values,
    motor_equation,
    q_0,
    r_L,
    r_M,
    smooth_friction,
    spring_force,
    symbol_of,
    tau_L,
    theta_L,
    theta_M,
)
from seaid.drives.equations import t as time_symbol
from seaid.drives.regressor import Compiled, DriveRegressor, compiled, flat_names, of_real, slope_by
from seaid.drives.terms import DEAD_ZONES, PARAMETERS_OF, key_of
from seaid.errors import ExcitationError, RobotError, shown

OfState = Callable[..., float]
"""A function of motor angle and speed, joint position and speed, torque through the gear, and the
states of hysteresis at motor and spring, which are zero if they are not given."""

_STATE = ("theta_M", "theta_M_dot", "theta_L", "theta_L_dot", "tau_G", "z_M", "z_F")
_COVARIATES = ("Delta_T", "t_log")
"""Signals of functions that are `partial`: they change over a log, and are no states."""

_PLAIN_FRICTION = {"viscous", "coulomb"}


@dataclass(frozen=True, eq=False)
class DriveFunctions:
    """The terms of a drive with its values, as functions of the state.

    At the motor [N m]: `friction`, which cannot hold it at rest, and `level` of the dry friction,
    which can. `force` of the spring, zero of a stiff drive. At the joint [N m or N]: `joint_torque`
    of the joint terms as a function of joint position and speed, without the dry friction of level
    `joint_level`. `is_under_load`: the friction of a stiff drive depends on the torque through its
    gear.
    """

    friction: OfState
    level: OfState
    force: OfState
    joint_torque: Callable[[float, float], float]
    joint_level: float
    is_dry: bool
    is_under_load: bool

    def at(self, **covariates: float) -> DriveFunctions:
        """Return the functions at a temperature above that of reference [K], and a time [s]."""
        changes: dict[str, Any] = {
            name: partial(function, **{key: covariates[key] for key in function.keywords})
            for name in ("friction", "level")
            if isinstance(function := getattr(self, name), partial)
        }
        return replace(self, **changes) if changes else self


def is_plain(drive: Drive) -> bool:
    """Whether a drive has at most viscous and Coulomb friction and a linear spring."""
    is_linear = set(drive.spring) <= {"linear"} and not drive.harmonics
    is_linear = is_linear and not drive.extra_terms
    return is_linear and set(drive.friction) <= _PLAIN_FRICTION and not _joint_terms(drive)


@cache
def drive_functions(drive: Drive) -> DriveFunctions:
    """Return the terms of a drive with its values.

    The spring offset of a linear spring without preload is ignored, because it describes encoder
    offsets, not a force. A missing deflection zero counts as zero. Raises RobotError naming the key
    of a parameter without a value, and the functions raise it where an extra term has none.
    """
    level = _with_values(drive, dry_friction(drive))
    if "coulomb_position" in drive.friction:  # none of the positions that were seen has less
        level = sp.Max(level, 0)
    friction = _with_values(drive, smooth_friction(drive)) + _extra_torque(drive)
    force = _with_values(drive, spring_force(drive))
    joint = _with_values(drive, joint_equation(drive).expression + tau_L)
    # Without dry friction, whose level is the coefficient of sign(q').
    smooth = joint.replace(sp.sign, lambda _: sp.Integer(0))
    position, speed = sp.symbols("theta_L theta_L_dot")
    return DriveFunctions(
        friction=_function(friction, drive.extra_terms),
        level=_function(level),
        force=_function(force),
        joint_torque=sp.lambdify([position, speed], smooth, modules="math"),
        joint_level=float(joint.coeff(sp.sign(speed))),
        is_dry=is_dry(drive),
        is_under_load=not drive.is_elastic and "load" in drive.friction,
    )


def spring_curve(drive: Drive, stretch: Array) -> Array:
    """Return the force (T,) of a drive's spring at rest, by its deflection (T,).

    The deflection is r_M/N theta_M - r_L theta_L. Of a loop of hysteresis the force is that amid
    it. Raises RobotError for a missing value of the spring.
    """
    rest: Any = {"spring": tuple(term for term in drive.spring if term != "damping")}
    rest |= dict.fromkeys(("friction", "extra_terms", "parallel_spring", "joint_friction"), ())
    force = drive_functions(drive.without_harmonics().with_terms(**rest)).force
    # With theta_L = 0 the deflection is r_M/N theta_M.
    angles = np.asarray(stretch) * drive.ratio / drive.motor_radius
    return np.array([force(angle, 0.0, 0.0, 0.0, 0.0) for angle in angles.tolist()])


def _with_values(drive: Drive, expression: sp.Expr) -> sp.Expr:
    """Return an expression with flat names of signals and the drive's values inserted."""
    flat = flat_names(expression).subs(known_values(drive))
    values = dict(drive.values)
    if "preload" not in drive.spring:
        values["spring_offset"] = 0.0
    values.setdefault("deflection_zero", 0.0)
    check_divisors(drive, values)
    for symbol in sorted(flat.free_symbols & set(PARAMETER_NAMES), key=str):
        name = PARAMETER_NAMES[symbol]
        _check_given(drive, name, values)
    numeric = flat.subs({symbol_of(name): value for name, value in values.items()})
    return numeric.replace(lambda e: isinstance(e, Dahl), _state_of)


def _extra_torque(drive: Drive) -> sp.Expr:
    """Return the extra terms at the motor by the state, or raise RobotError for an unknown name."""
    torque = of_real(sum(extra_terms(drive), sp.Integer(0)))
    states = [symbol for symbol in torque.free_symbols if symbol.name in _STATE]
    torque = _with_values(drive, torque.xreplace({x: sp.Symbol(x.name) for x in states}))
    unknown = {symbol.name for symbol in torque.free_symbols} - set(_STATE)
    if unknown:
        raise RobotError(
            f"extra terms {shown(list(drive.extra_terms))} have no value for "
            f"{', '.join(sorted(unknown))}: write numbers to simulate them"
        )
    return torque


def simulated_value(drive: Drive, name: str) -> float:
    """Return a value of a drive. Raises RobotError naming its key if it is not given."""
    _check_given(drive, name, drive.values)
    return drive.values[name]


def _check_given(drive: Drive, name: str, values: Mapping[str, float]) -> None:
    if name not in values:
        key = key_of(name, unit_of(drive, name))
        raise RobotError(f"'{key}' is not given; a simulation needs a nominal value")


def _state_of(law: Dahl) -> sp.Symbol:
    """Return the symbol of the state of a law, that of the motor or of the spring."""
    is_spring = any(str(symbol) == "theta_L" for symbol in law.free_symbols)
    return sp.Symbol("z_F" if is_spring else "z_M")


def _function(expression: sp.Expr, extra_terms: Sequence[str] = ()) -> OfState:
    arguments = [sp.Symbol(name) for name in _STATE]
    covariates = [name for name in _COVARIATES if sp.Symbol(name) in expression.free_symbols]
    arguments += map(sp.Symbol, covariates)
    function = sp.lambdify(arguments, expression, modules="math", cse=True)
    # The last arguments may be omitted: states of hysteresis and covariates, which are zero.
    function.__defaults__ = (0.0,) * (2 + len(covariates))
    of_state = partial(_real, function, tuple(extra_terms)) if extra_terms else function
    return partial(of_state, **dict.fromkeys(covariates, 0.0)) if covariates else of_state


def _real(
    function: OfState, extra_terms: Sequence[str], *state: float, **covariates: float
) -> float:
    try:
        return float(function(*state, **covariates))
    except (ArithmeticError, ValueError, TypeError) as problem:  # TypeError: not real
        at = ", ".join(f"{name} = {x:.4g}" for name, x in zip(_STATE, state, strict=False))
        raise RobotError(
            f"extra terms {shown(list(extra_terms))} have no value at {at}: {problem}"
        ) from None


STATES = ("theta_M", "theta_M_dot", "theta_M_ddot", "theta_L", "theta_L_dot", "theta_L_ddot")
SMOOTH_SIGNALS = (*STATES, "tau_G")
"""The signals by which columns are differentiated, in order; `tau_G` is the torque on the load."""

_WIDTH = sp.Symbol("sign_width", real=True)
"""The speed w_s of tanh(w / w_s), which replaces sign(w) in smooth expressions."""

_POSITIVE = {str(symbol) for symbol in (N, r_M, r_L, *PARAMETER_NAMES) if symbol.is_positive}
_SPEEDS = {"theta_M_dot", "theta_L_dot"}
_NAMES = {str(symbol): name for symbol, name in PARAMETER_NAMES.items()}


@dataclass(frozen=True)
class SmoothColumns:
    """Columns of a drive's regressor, or a torque, as expressions of `signals` and `known` values.

    Plain data, so that it can be sent to other processes.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    row: tuple[sp.Expr, ...]
    known: FrozenMapping[float]
    signals: tuple[str, ...] = SMOOTH_SIGNALS

    @property
    def missing(self) -> tuple[str, ...]:
        """The parameters at whose values the columns are linearised, and that have no value."""
        symbols = {str(symbol) for entry in self.row for symbol in entry.free_symbols}
        return tuple(name for key, name in _NAMES.items() if key in symbols - set(self.known))

    def evaluate(self, signals: Mapping[str, Array], sign_width: float) -> tuple[Array, Array]:
        """Return the columns (T, p) and their slopes (T, p, s) by the s `signals`, each (T,).

        As `DriveRegressor.evaluate`, with tanh(speed / sign_width) in place of sign(speed), so that
        friction has a slope. Signals that occur in no column are optional.
        """
        function, names = _compiled_slopes(self.row, self.signals)
        known = {**self.known, str(_WIDTH): sign_width}
        arguments = [known[name] if name in known else signals[name] for name in names]
        p, length = len(self.row), len(next(iter(signals.values())))
        table = np.empty((p * (1 + len(self.signals)), length))
        for line, entry in zip(table, function(*arguments), strict=True):
            line[:] = entry
        return table[:p].T, table[p:].reshape(p, len(self.signals), length).transpose(2, 0, 1)

    def torque(self, *values: Array, sign_width: float) -> tuple[Array, Array]:
        """Return the only column (T,) and its slopes (s, T) at values (T,) of the signals."""
        by_signal = dict(zip(self.signals, values, strict=True))
        columns, slopes = self.evaluate(by_signal, sign_width)
        return columns[:, 0], slopes[:, 0].T


def smooth_columns(regressor: DriveRegressor) -> SmoothColumns:
    """Return the columns of a drive's regressor with slopes.

    Current and voltage follow from the motion by (7) with the drive's values; missing encoder
    offsets count as zero. Presliding is sharp friction, and springs have no hysteresis.
    """
    shaped = {"presliding_angle", "hysteresis_force", "hysteresis_deflection"}
    places = [place for place, name in enumerate(regressor.names) if name not in shaped]
    names, units = (
        tuple(of[place] for place in places) for of in (regressor.names, regressor.units)
    )
    entries = [flat_names(regressor.row[place]) for place in places]
    row = tuple(_without_memory(_with_input(entry, regressor.drive)) for entry in entries)
    values = {"deflection_zero": 0.0, "spring_offset": 0.0, **regressor.drive.values}
    if "preload" not in regressor.drive.spring:
        values["spring_offset"] = 0.0
    check_divisors(regressor.drive, values)
    known = {str(symbol_of(name)): value for name, value in values.items()}
    known |= regressor.known
    return SmoothColumns(names, units, row, FrozenMapping(known))


def _without_memory(entry: sp.Expr) -> sp.Expr:
    """Return a flat expression with sign(w) as the state of the motor, and none of the spring."""
    states = {sp.Symbol("z_M"): sp.sign(sp.Symbol("theta_M_dot")), sp.Symbol("z_F"): sp.Integer(0)}
    sharp = entry.replace(lambda e: isinstance(e, Dahl), lambda e: states[_state_of(e)])
    return sharp.replace(lambda e: isinstance(e, DahlSlope), lambda _: sp.Integer(0))


def _with_input(entry: sp.Expr, drive: Drive) -> sp.Expr:
    """Return a flat column in which current or voltage follow from the motor equation (7)."""
    constants = {"i_M": K_t, "u_M": K_u}
    inputs = [symbol for symbol in entry.free_symbols if str(symbol) in constants]
    if not inputs:
        return entry
    # (7) without its input is the torque that current or voltage must give.
    torque = flat_names(motor_equation(drive).expression)
    nothing = dict.fromkeys(map(sp.Symbol, constants), 0)
    torque = torque.subs({**nothing, sp.Symbol("tau_L"): sp.Symbol("tau_G")})
    return entry.subs({symbol: torque / constants[str(symbol)] for symbol in inputs})


def _smoothed(expression: sp.Expr) -> sp.Expr:
    """Return a flat expression of real symbols with sign(speed) as tanh(speed / _WIDTH)."""
    real = {symbol: _real_symbol(str(symbol)) for symbol in expression.free_symbols}
    return expression.xreplace(real).replace(sp.sign, _smooth_sign)


def _real_symbol(name: str) -> sp.Symbol:
    """Return the symbol of a signal or parameter in smoothed expressions."""
    return sp.Symbol(name, positive=True) if name in _POSITIVE else sp.Symbol(name, real=True)


def _smooth_sign(x: sp.Expr) -> sp.Expr:
    """Return tanh(x / _WIDTH) if x depends on speeds alone, else sign(x)."""
    of_speed = {str(symbol) for symbol in x.free_symbols & set(map(_real_symbol, SMOOTH_SIGNALS))}
    return sp.tanh(x / _WIDTH) if of_speed and of_speed <= _SPEEDS else sp.sign(x)


@cache
def _compiled_slopes(row: tuple[sp.Expr, ...], signals: tuple[str, ...]) -> Compiled:
    smooth = [_smoothed(entry) for entry in row]
    slopes = [slope_by(entry, _real_symbol(signal)) for entry in smooth for signal in signals]
    return compiled([*smooth, *slopes])


_SOFTEST = 0.1
"""A spring counts as at least this part of its stiffness at zero, where it is softer."""

_CROSSING = 0.6
"""Rounding of a dead zone per half width, with which its middle has about that stiffness."""

_STRETCHES = 1e-7 * np.sinh(np.linspace(0.0, 30.0, 6001))
"""Deflections [m or rad] of the table by which a spring is inverted, each 0.5 % larger."""


@dataclass(frozen=True, eq=False)
class SpringInverse:
    """The deflection of an undamped spring, from its zero, as a smooth function of its force.

    `by_pull` is that of the force less the preload, or its slope for a second argument of 1.
    """

    preload: float
    by_pull: Callable[..., Array]

    def stretch(self, force: Array) -> tuple[Array, Array]:
        """Return the deflection under a force (any shape), and its slope."""
        pull = force - self.preload
        return self.by_pull(pull), self.by_pull(pull, 1)


@cache
def spring_inverse(drive: Drive) -> SpringInverse:
    """Return the inverse of the curve of a drive's spring, whose corners are rounded.

    Every force has one deflection: where a spring gives way, it is continued with a tenth of its
    stiffness. Raises RobotError for a missing value.
    """
    from scipy.interpolate import CubicSpline

    values = {"deflection_zero": 0.0} if drive.is_nonlinear_spring else {}
    if {*DEAD_ZONES} & {*drive.spring} and drive.values.get("dead_zone"):
        gap = drive.values["dead_zone"]
        rounding = max(drive.values.get("dead_zone_rounding", 0.0), _CROSSING * gap)
        terms = tuple("smooth_dead_zone" if x in DEAD_ZONES else x for x in drive.spring)
        drive = drive.with_terms(spring=terms)
        values |= {"dead_zone": gap, "dead_zone_rounding": rounding}
    x = _STRETCHES
    curve = spring_curve(drive.with_values(values), x)
    steps = np.maximum(np.diff(curve), _SOFTEST * drive.values.get("stiffness", 0.0) * np.diff(x))
    pull = np.cumsum(steps)
    # Without its preload the force is an odd function of the deflection.
    both = (np.concatenate([-half[::-1], [0.0], half]) for half in (pull, x[1:]))
    return SpringInverse(float(curve[0]), CubicSpline(*both))


def friction_curve(joint: str, drive: Drive) -> SmoothColumns:
    """Return the friction [N m] by motor speed and torque on the load, without extra terms.

    Friction that depends on the position is that at the reference position of the drive.
    """
    # A stiff drive with the load torque as that of the spring. Friction under load has tau_G / N:
    # behind pulleys N r_L / r_M is in place of N.
    stiff = StiffDrive(friction=drive.at_temperature().friction)
    turning = dry_friction(stiff) * sp.sign(theta_M.diff(time_symbol))
    # At the reference position, where what friction gains with the position is zero.
    friction = (smooth_friction(stiff) + turning).subs(theta_L, q_0)
    friction = friction.subs(N, sp.Float(total_ratio(drive)))
    return _curve(joint, drive, friction, ("theta_M_dot", "tau_G"))


def joint_curve(joint: str, drive: Drive) -> SmoothColumns:
    """Return the torque [N m or N] of the joint terms by joint position and speed."""
    torque = joint_equation(drive).expression + tau_L
    return _curve(joint, drive, torque, ("theta_L", "theta_L_dot"))


def joint_term_parameters(drive: Drive) -> tuple[str, ...]:
    """Return the parameters of the joint terms: parallel spring and joint friction."""
    return tuple(name for field, term in _joint_terms(drive) for name in PARAMETERS_OF[field][term])


def _joint_terms(drive: Drive) -> list[tuple[str, str]]:
    fields = ("parallel_spring", "joint_friction")
    return [(field, term) for field in fields for term in getattr(drive, field)]


def missing_value(joint: str, name: str) -> ExcitationError:
    """Return the error for a missing nominal value."""
    return ExcitationError(
        f"joint '{joint}': its drive has no nominal {name.replace('_', ' ')}",
        advice="this criterion or limit needs one: give it in the drives of load_robot",
    )


def _curve(
    joint: str, drive: Drive, expression: sp.Expr, signals: tuple[str, str]
) -> SmoothColumns:
    known = FrozenMapping({str(symbol_of(name)): value for name, value in drive.values.items()})
    torque = _without_memory(flat_names(expression))
    curve = SmoothColumns(("torque",), ("N m",), (torque,), known, signals)
    for name in curve.missing:
        raise missing_value(joint, name)
    check_divisors(drive, drive.values)
    return curve
