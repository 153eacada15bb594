"""What a drive's terms do while it moves: its equations as numbers of its state.

Columns of a drive's regressor with their slopes: what a search with gradients needs of (10).

How far a spring that is no straight line is stretched by a force, and how that changes.

Friction of a drive, and what acts beside it, with slopes: numbers of its terms along a plan.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp

from seaid._arrays import Array, FrozenMapping
from seaid.drives.drives import (
    Drive,
    SeriesElasticDrive,
    StiffDrive,
    check_divisors,
    is_dry,
    unit_of,
)
from seaid.drives.equations import (
    dry_friction,
    joint_equation,
    motor_equation,
    smooth_friction,
    spring_force,
)
from seaid.drives.regressor import DriveRegressor, flat_names
from seaid.drives.symbols import (
    PARAMETER_NAMES,
    SYMBOLS,
    K_t,
    K_u,
    N,
    known_values,
    r_L,
    r_M,
    tau_L,
    theta_M,
)
from seaid.drives.symbols import t as time_symbol
from seaid.drives.terms import PARAMETERS_OF, key_of
from seaid.errors import ExcitationError, RobotError

Acting = Callable[..., float]
"""Of motor angle and speed, joint position and speed, and torque through the gear."""

_STATE = ("theta_M", "theta_M_dot", "theta_L", "theta_L_dot", "tau_G")
_PLAIN_FRICTION = {"viscous", "coulomb"}


@dataclass(frozen=True, eq=False)
class ActingDrive:
    """The terms of a drive with its values.

    `friction` [N m] at the motor, which cannot hold it, `level` [N m] of the friction that can,
    `force` of the spring (zero of a stiff drive), `beside` of the joint's own position and speed:
    what acts between its bodies beside the drive [N m or N] and cannot hold it, `joint_level` of
    the friction there that can. `is_under_load`: the friction of a stiff drive depends on the
    torque through its gear.
    """

    friction: Acting
    level: Acting
    force: Acting
    beside: Callable[[float, float], float]
    joint_level: float
    is_dry: bool
    is_under_load: bool


def is_plain(drive: Drive) -> bool:
    """Tell whether a drive has viscous and Coulomb friction and a linear spring at most."""
    spring = getattr(drive, "spring", ("linear",))
    beside = (*drive.parallel_spring, *getattr(drive, "joint_friction", ()))
    return set(drive.friction) <= _PLAIN_FRICTION and spring == ("linear",) and not beside


@cache
def acting_drive(drive: Drive) -> ActingDrive:
    """Return the terms of a drive with its values.

    The deflection offset of a linear spring without preload does not act: it is what unknown
    encoder zeros leave. A deflection zero that is not given is zero. Raises RobotError naming a
    parameter without a value by its key.
    """
    level = _with_values(drive, dry_friction(drive))
    friction = _with_values(drive, smooth_friction(drive))
    force = sp.Integer(0)
    if isinstance(drive, SeriesElasticDrive):
        force = _with_values(drive, spring_force(drive))
    beside = _with_values(drive, joint_equation(drive).expression + tau_L)
    smooth = beside.replace(sp.sign, lambda _: sp.Integer(0))
    position, speed = sp.symbols("theta_L theta_L_dot")
    return ActingDrive(
        friction=_function(friction),
        level=_function(level),
        force=_function(force),
        beside=sp.lambdify([position, speed], smooth, modules="math"),
        joint_level=float(beside.coeff(sp.sign(speed))),
        is_dry=is_dry(drive),
        is_under_load=not isinstance(drive, SeriesElasticDrive) and "load" in drive.friction,
    )


@dataclass(frozen=True, eq=False)
class SpringCurve:
    """The force of a spring at rest and its slope, as functions of the stretch (any shape).

    The stretch is r_M/N theta_M - r_L theta_L.
    """

    force: Callable[[Array], Array]
    slope: Callable[[Array], Array]


@cache
def spring_curve(drive: SeriesElasticDrive) -> SpringCurve:
    """Return the curve of a drive's spring with its values, without damping.

    Raises RobotError naming a parameter without a value by its key.
    """
    stretch = sp.Symbol("stretch", real=True)
    undamped = [term for term in drive.spring if term != "damping"]
    force = _with_values(drive, spring_force(drive), needed=undamped)
    zero = {sp.Symbol(name): 0 for name in _STATE}
    turned = stretch * drive.ratio / drive.motor_radius
    curve = force.subs({**zero, sp.Symbol("theta_M"): turned})
    slope = curve.diff(stretch)
    return SpringCurve(_vectorised(stretch, curve), _vectorised(stretch, slope))


def stretch_of(curve: SpringCurve, force: Array) -> Array:
    """Return the stretch at which a spring has a force, any shape; bisected from the zero outward.

    Within a dead zone it is one of its ends. Raises RobotError where the spring never has it.
    """
    most, least = float(np.max(force)), float(np.min(force))
    bound = 1e-6
    while not np.all(_reaches(curve, bound, least, most)):
        bound *= 1.2
        if bound > 1e6:
            raise RobotError(
                f"its spring never pulls with {least:.4g} to {most:.4g}: check the nominal values "
                "of its terms"
            )
    low, high = np.full_like(force, -bound), np.full_like(force, bound)
    for _ in range(70):
        middle = 0.5 * (low + high)
        short = curve.force(middle) < force
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return 0.5 * (low + high)


def _reaches(curve: SpringCurve, bound: float, least: float, most: float) -> tuple[bool, bool]:
    low, high = curve.force(np.array([-bound, bound]))
    return bool(low <= least), bool(high >= most)


def _with_values(drive: Drive, expression: sp.Expr, needed: list[str] | None = None) -> sp.Expr:
    """Return an expression of flat states with the drive's values in it."""
    flat = flat_names(expression).subs(known_values(drive))
    values = dict(drive.values)
    if "preload" not in getattr(drive, "spring", ()):
        values["spring_offset"] = 0.0
    values.setdefault("deflection_zero", 0.0)
    check_divisors(drive, values)
    if needed is not None and "damping" not in needed:
        values["spring_damping"] = 0.0
    for symbol in sorted(flat.free_symbols & set(PARAMETER_NAMES), key=str):
        name = PARAMETER_NAMES[symbol]
        if name not in values:
            raise RobotError(
                f"'{key_of(name, unit_of(drive, name))}' is not given; a simulation needs a "
                "nominal value"
            )
    return flat.subs({SYMBOLS[name]: value for name, value in values.items()})


def _function(expression: sp.Expr) -> Acting:
    arguments = [sp.Symbol(name) for name in _STATE]
    return sp.lambdify(arguments, expression, modules="math", cse=True)  # type: ignore[no-any-return]


def _vectorised(argument: sp.Symbol, expression: sp.Expr) -> Callable[[Array], Array]:
    plain = sp.lambdify(argument, expression, modules="numpy")
    return lambda values: np.broadcast_to(plain(values), np.shape(values)).astype(float)


STATES = ("theta_M", "theta_M_dot", "theta_M_ddot", "theta_L", "theta_L_dot", "theta_L_ddot")
SMOOTH_SIGNALS = (*STATES, "tau_G")
"""What the columns are differentiated by, in this order; `tau_G` is the torque on the load."""

WIDTH = sp.Symbol("sign_width", real=True)
"""Speed within which the sign of a speed turns, in `smoothed` expressions."""

_POSITIVE = {str(symbol) for symbol in (N, r_M, r_L, *PARAMETER_NAMES) if symbol.is_positive}
_SPEEDS = {"theta_M_dot", "theta_L_dot"}
_NAMES = {str(symbol): name for symbol, name in PARAMETER_NAMES.items()}


@dataclass(frozen=True)
class SmoothColumns:
    """The columns of a drive's regressor as expressions of `SMOOTH_SIGNALS` and `known` values.

    Plain data, which can be sent to other processes.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    row: tuple[sp.Expr, ...]
    known: FrozenMapping[float]

    @property
    def missing(self) -> tuple[str, ...]:
        """The parameters near whose values the columns are taken, and that have none."""
        symbols = {str(symbol) for entry in self.row for symbol in entry.free_symbols}
        return tuple(name for key, name in _NAMES.items() if key in symbols - set(self.known))

    def evaluate(self, signals: Mapping[str, Array], sign_width: float) -> tuple[Array, Array]:
        """Return the columns (T, p) and their slopes (T, p, 7) by `SMOOTH_SIGNALS`, each (T,).

        As `DriveRegressor.evaluate`, with the sign of a speed as tanh(speed / sign_width), so that
        friction has a slope. A signal that is in no column may be left out.
        """
        function, names = _compiled_slopes(self.row)
        known = {**self.known, str(WIDTH): sign_width}
        arguments = [known[name] if name in known else signals[name] for name in names]
        p, length = len(self.row), len(next(iter(signals.values())))
        table = np.empty((p * (1 + len(SMOOTH_SIGNALS)), length))
        for line, entry in zip(table, function(*arguments), strict=True):
            line[:] = entry
        return table[:p].T, table[p:].reshape(p, len(SMOOTH_SIGNALS), length).transpose(2, 0, 1)


def smooth_columns(regressor: DriveRegressor) -> SmoothColumns:
    """Return the columns of a drive's regressor with slopes.

    Current and voltage are those that the drive needs for its motion, with its values; zeros of
    encoders are zero where they are not given.
    """
    row = tuple(_with_input(flat_names(entry), regressor.drive) for entry in regressor.row)
    values = {"deflection_zero": 0.0, "spring_offset": 0.0, **regressor.drive.values}
    if "preload" not in getattr(regressor.drive, "spring", ("preload",)):
        values["spring_offset"] = 0.0
    check_divisors(regressor.drive, values)
    known = {str(SYMBOLS[name]): value for name, value in values.items()}
    known |= {str(symbol): value for symbol, value in known_values(regressor.drive).items()}
    return SmoothColumns(regressor.names, regressor.units, row, FrozenMapping(known))


def _with_input(entry: sp.Expr, drive: Drive) -> sp.Expr:
    """Return a flat column in which current or voltage follow from the motor equation (7)."""
    constants = {"i_M": K_t, "u_M": K_u}
    asked = [symbol for symbol in entry.free_symbols if str(symbol) in constants]
    if not asked:
        return entry
    needed = flat_names(motor_equation(drive).expression)
    nothing = dict.fromkeys(map(sp.Symbol, constants), 0)
    needed = needed.subs({**nothing, sp.Symbol("tau_L"): sp.Symbol("tau_G")})
    return entry.subs({symbol: needed / constants[str(symbol)] for symbol in asked})


def smoothed(expression: sp.Expr) -> sp.Expr:
    """Return a flat expression of real symbols in which the signs of speeds turn within `WIDTH`."""
    real = {symbol: real_symbol(str(symbol)) for symbol in expression.free_symbols}
    return expression.xreplace(real).replace(sp.sign, _turning)


def slope_of(expression: sp.Expr, name: str) -> sp.Expr:
    """Return the derivative of a smoothed expression by a signal; a step has none."""
    slope = expression.diff(real_symbol(name))
    return slope.replace(sp.DiracDelta, lambda *_: sp.Integer(0))


def real_symbol(name: str) -> sp.Symbol:
    """Return the symbol of a signal or parameter in `smoothed` expressions."""
    return sp.Symbol(name, positive=True) if name in _POSITIVE else sp.Symbol(name, real=True)


def _turning(x: sp.Expr) -> sp.Expr:
    of_speed = {str(symbol) for symbol in x.free_symbols & set(map(real_symbol, SMOOTH_SIGNALS))}
    return sp.tanh(x / WIDTH) if of_speed and of_speed <= _SPEEDS else sp.sign(x)


@cache
def _compiled_slopes(row: tuple[sp.Expr, ...]):  # type: ignore[no-untyped-def]
    smooth = [smoothed(entry) for entry in row]
    entries = [*smooth, *(slope_of(entry, signal) for entry in smooth for signal in SMOOTH_SIGNALS)]
    names = sorted({str(symbol) for entry in entries for symbol in entry.free_symbols})
    arguments = [real_symbol(name) for name in names]
    return sp.lambdify(arguments, entries, modules="numpy", cse=True), names


_SOFTEST = 0.1
"""Where a spring is softer than this part of its stiffness at zero it is continued straight."""

_CROSSING = 0.5
"""A dead zone is crossed while the spring behind it stretches by this part of the zone."""

_HALVINGS = 64


@dataclass(frozen=True, eq=False)
class BentSpring:
    """force = preload + k d + k_3 d^3 + k_5 d^5, d = stretch less `zero` less a dead zone `gap`.

    From the deflection `end` on it is continued straight, so that every force has one stretch.
    """

    coefficients: tuple[float, float, float]
    preload: float
    zero: float
    gap: float
    end: float

    def stretch(self, force: Array) -> tuple[Array, Array]:
        """Return the stretch under a force (any shape) from the spring's zero, and its slope."""
        pull = np.abs(force - self.preload)
        low, high = np.zeros_like(pull), pull / (_SOFTEST * self.coefficients[0])
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            short = self._pull(middle)[0] < pull
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        d = np.sign(force - self.preload) * high
        slope = 1.0 / self._pull(high)[1]
        if self.gap == 0:
            return d, slope
        crossing = np.tanh(d / (_CROSSING * self.gap))
        return d + self.gap * crossing, slope * (1 + (1 - crossing**2) / _CROSSING)

    def _pull(self, d: Array) -> tuple[Array, Array]:
        """Return force without preload and stiffness at deflections that are not negative."""
        k, k_3, k_5 = self.coefficients
        x = np.minimum(d, self.end)
        stiffness = k + 3 * k_3 * x**2 + 5 * k_5 * x**4
        return x * (k + k_3 * x**2 + k_5 * x**4) + (d - x) * stiffness, stiffness


def nonlinear_spring(joint: str, drive: SeriesElasticDrive) -> BentSpring:
    """Return the spring of a drive whose values are all given, at rest: damping is left out.

    Raises ExcitationError for one without linear stiffness: at zero force its motor would have no
    speed that ends.
    """
    values, terms = drive.values, drive.spring
    k = values["stiffness"] if "linear" in terms else 0.0
    if k <= 0:
        raise ExcitationError(
            f"joint '{joint}': its spring has no linear stiffness, so that no force holds its "
            "deflection at zero: where its motor goes along a planned motion cannot be told; plan "
            "for the base parameters, without parameters and limits of its drive"
        )
    k_3 = values["cubic_stiffness"] if "cubic" in terms else 0.0
    k_5 = values["fifth_stiffness"] if "fifth" in terms else 0.0
    squares = np.roots([5 * k_5, 3 * k_3, (1 - _SOFTEST) * k])
    softest = [float(root.real) for root in squares if root.imag == 0 and root.real > 0]
    return BentSpring(
        coefficients=(k, k_3, k_5),
        preload=values["spring_offset"] if "preload" in terms else 0.0,
        zero=values.get("deflection_zero", 0.0) if drive.knows_zero else 0.0,
        gap=values["dead_zone"] if "dead_zone" in terms else 0.0,
        end=float(np.sqrt(min(softest))) if softest else np.inf,
    )


@dataclass(frozen=True)
class DriveCurve:
    """A torque as an expression of two `signals` and of `values` {parameter: value}.

    Plain data, which can be sent to other processes.
    """

    expression: sp.Expr
    signals: tuple[str, str]
    values: FrozenMapping[float]

    def evaluate(self, one: Array, other: Array, width: float) -> tuple[Array, Array, Array]:
        """Return the torque and its slopes by both signals, each (T,).

        Signs of speeds turn within `width` [rad/s or m/s].
        """
        function, names = _compiled(self.expression, self.signals)
        given = [self.values[name] for name in names]
        found = np.empty((3, *np.shape(one)))
        for line, entry in zip(found, function(one, other, width, *given), strict=True):
            line[...] = entry
        return found[0], found[1], found[2]


def friction_curve(joint: str, drive: Drive) -> DriveCurve:
    """Return the friction [N m] at the motor of its speed and the torque on what the drive turns.

    Extra terms are left out. Raises ExcitationError where a nominal value is missing.
    """
    return _curve(joint, drive, *_friction(drive))


def beside_curve(joint: str, drive: Drive) -> DriveCurve:
    """Return the torque of parallel spring and joint friction of the joint's position and speed.

    In N m, or N. Raises ExcitationError where a nominal value is missing.
    """
    beside = joint_equation(drive).expression + tau_L
    return _curve(joint, drive, beside, ("theta_L", "theta_L_dot"))


def beside_names(drive: Drive) -> tuple[str, ...]:
    """Return the parameters of what acts between the joint's bodies beside the drive."""
    return tuple(
        name
        for field in ("parallel_spring", "joint_friction")
        for term in getattr(drive, field, ())
        for name in PARAMETERS_OF[field][term]
    )


def no_value(joint: str, name: str) -> ExcitationError:
    """Return the error of a nominal value that is missing."""
    return ExcitationError(
        f"joint '{joint}': its drive has no nominal {name.replace('_', ' ')}; "
        "this criterion or limit needs one: give it in the drives of load_robot"
    )


def _friction(drive: Drive) -> tuple[sp.Expr, tuple[str, str]]:
    """Return friction as if the drive was stiff: the load's torque stands for the spring's."""
    lever = drive.ratio * getattr(drive, "load_radius", 1.0) / getattr(drive, "motor_radius", 1.0)
    stiff = StiffDrive(friction=drive.friction)
    turning = dry_friction(stiff) * sp.sign(theta_M.diff(time_symbol))
    friction = smooth_friction(stiff) + turning
    return friction.subs(N, sp.Float(lever)), ("theta_M_dot", "tau_G")


def _curve(joint: str, drive: Drive, expression: sp.Expr, signals: tuple[str, str]) -> DriveCurve:
    flat = flat_names(expression)
    for name in _compiled(flat, signals)[1]:
        if name not in drive.values:
            raise no_value(joint, name)
    check_divisors(drive, drive.values)
    return DriveCurve(flat, signals, FrozenMapping(drive.values))


@cache
def _compiled(expression: sp.Expr, signals: tuple[str, str]):  # type: ignore[no-untyped-def]
    smooth = smoothed(expression)
    names = {str(symbol): name for symbol, name in PARAMETER_NAMES.items()}
    used = sorted({str(symbol) for symbol in smooth.free_symbols} & set(names))
    entries = [smooth, *(slope_of(smooth, signal) for signal in signals)]
    arguments = [real_symbol(name) for name in (*signals, str(WIDTH), *used)]
    function = sp.lambdify(arguments, entries, modules="numpy", cse=True)
    return function, [names[name] for name in used]
