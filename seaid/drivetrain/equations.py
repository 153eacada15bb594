"""Motor, gear, spring and friction of one joint as sympy equations, (1)-(4), (7) and (8).

An equation is an expression that is zero along every motion. Whatever is added to it, to
`DriveEquation.expression` or as `extra_terms` of a drive, becomes a column of the regressor with
the name of its unknown symbol: nothing else has to change.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from keyword import iskeyword

import sympy as sp

from seaid.drivetrain.model import Drive, SeriesElasticDrive
from seaid.errors import RobotError, unknown_name

t = sp.Symbol("t")
theta_M, theta_L, tau_M, tau_L = (
    sp.Function(name)(t) for name in ("theta_M", "theta_L", "tau_M", "tau_L")
)
"""Motor angle, joint coordinate, motor torque and the torque (or force) on the load."""

N, r_M, r_L = sp.symbols("N r_M r_L", positive=True)
I_M, F_v, F_C, F_0, k, f_0 = sp.symbols("I_M F_v F_C F_0 k f_0")

PARAMETER_NAMES = {
    F_v: "viscous_friction",
    F_C: "coulomb_friction",
    F_0: "friction_offset",
    k: "stiffness",
    f_0: "deflection_offset",
    I_M: "motor_inertia",
}
SIGNALS = (theta_M, theta_L, tau_M, tau_L)
STATES = {
    "theta_M": theta_M,
    "theta_M_dot": theta_M.diff(t),
    "theta_M_ddot": theta_M.diff(t, 2),
    "theta_L": theta_L,
    "theta_L_dot": theta_L.diff(t),
    "theta_L_ddot": theta_L.diff(t, 2),
}
"""What an extra term may depend on, by the name it has in text."""


@dataclass(frozen=True)
class DriveEquation:
    """An expression that is zero along the motion; every symbol not in `known` is unknown."""

    expression: sp.Expr
    known: tuple[sp.Symbol, ...]

    @property
    def unknowns(self) -> tuple[sp.Symbol, ...]:
        """The unknown parameters: the named ones first, then added ones by name."""
        free = self.expression.free_symbols - {t, *self.known}
        named = [symbol for symbol in PARAMETER_NAMES if symbol in free]
        return (*named, *sorted(free - set(named), key=str))


def spring_force(angle: sp.Expr = theta_M) -> sp.Expr:
    """Return (3) with the force at zero deflection that unknown encoder zeros leave."""
    return k * (r_M / N * angle - r_L * theta_L) + f_0


def motor_equation(drive: Drive) -> DriveEquation:
    """Return (7) of an elastic drive, or the same with the joint torque behind a stiff gear."""
    elastic = isinstance(drive, SeriesElasticDrive)
    speed = theta_M.diff(t)
    friction = {"viscous": F_v * speed, "coulomb": F_C * sp.sign(speed), "offset": F_0}
    behind_gear = r_M * spring_force() if elastic else tau_L  # (4a)
    expression = (
        I_M * theta_M.diff(t, 2)
        + sum(friction[term] for term in drive.friction)
        + sum(extra_terms(drive))
        + behind_gear / N
        - tau_M
    )
    return DriveEquation(expression, _known(drive))


def spring_equation(drive: SeriesElasticDrive) -> DriveEquation:
    """Return (4b) as a balance of forces, for a joint whose spring torque is measured."""
    return DriveEquation(spring_force() - tau_L / r_L, _known(drive))


def _known(drive: Drive) -> tuple[sp.Symbol, ...]:
    return (N, r_M, r_L) if drive.motor_inertia_kg_m2 is None else (N, r_M, r_L, I_M)


def extra_terms(drive: Drive) -> list[sp.Expr]:
    """Return the drive's extra terms as expressions.

    They are text such as "c*theta_M'**3" or "c*theta_M_dot**3", a torque [N m] at the motor; names
    other than those of STATES, N, r_M, r_L and I_M are unknown parameters. Raises RobotError for
    text that is no expression.
    """
    return [_expression(text) for text in drive.extra_terms]


_NAMES = {**STATES, **{str(symbol): symbol for symbol in (N, r_M, r_L, *PARAMETER_NAMES)}}
_FUNCTIONS = {
    "abs": sp.Abs,
    "atan": sp.atan,
    "cos": sp.cos,
    "cosh": sp.cosh,
    "exp": sp.exp,
    "log": sp.log,
    "sign": sp.sign,
    "sin": sp.sin,
    "sinh": sp.sinh,
    "sqrt": sp.sqrt,
    "tan": sp.tan,
    "tanh": sp.tanh,
}


def _expression(text: str) -> sp.Expr:
    """Return one extra term as an expression, of names and functions that mean something here.

    sympy would take E, beta or S for its own, and a state with a typo for a parameter.
    """
    plain = re.sub(r"(theta_[ML])''", r"\1_ddot", text)
    plain = re.sub(r"(theta_[ML])'", r"\1_dot", plain)
    where = f"extra term '{text}'"
    if re.search(r"[^\w\s+\-*/^().]|\.\s*[^\W\d]", plain):
        raise RobotError(
            f"{where} is not an expression: it may have names, numbers and + - * / ^ ( )"
        )
    names: dict[str, object] = {"pi": sp.pi, **_NAMES}
    for name, call in re.findall(r"(?<!\w)([^\W\d]\w*)\s*(\(?)", plain):
        if call:
            if name not in _FUNCTIONS:
                raise RobotError(f"{where}: " + unknown_name("function", name, _FUNCTIONS))
            names[name] = _FUNCTIONS[name]
        elif name == "t" or (name.startswith(("theta", "tau")) and name not in STATES):
            raise RobotError(f"{where}: " + unknown_name("state", name, STATES))
        elif name in PARAMETER_NAMES.values() or iskeyword(name):
            raise RobotError(f"{where}: the name '{name}' is taken; choose another")
        else:
            names.setdefault(name, sp.Symbol(name))
    try:
        expression = sp.sympify(plain, locals=names, rational=True)
    except (sp.SympifyError, TypeError, AttributeError, SyntaxError):
        raise RobotError(f"{where} is not an expression") from None
    if not isinstance(expression, sp.Expr) or expression.has(sp.zoo, sp.oo, sp.nan):
        raise RobotError(f"{where} is not an expression but {expression}")
    return expression


def extra_torque(drive: Drive) -> Callable[[float, float, float, float], float]:
    """Return the extra terms as a number of motor angle and speed, joint position and speed.

    Raises RobotError where they have unknown parameters, so that they have no value.
    """
    expression = sum(extra_terms(drive), sp.Integer(0)).subs(known_values(drive))
    flat = {state: sp.Symbol(name) for name, state in reversed(STATES.items())}
    expression = expression.subs(flat)
    arguments = [sp.Symbol(name) for name in ("theta_M", "theta_M_dot", "theta_L", "theta_L_dot")]
    unknown = expression.free_symbols - set(arguments)
    if unknown:
        raise RobotError(
            f"extra terms {list(drive.extra_terms)} have no value for "
            f"{', '.join(sorted(map(str, unknown)))}: write numbers to simulate them"
        )
    return sp.lambdify(arguments, expression, modules="math")  # type: ignore[no-any-return]


def known_values(drive: Drive) -> dict[sp.Symbol, float]:
    """Return {known symbol: value} of a drive."""
    values = {
        N: drive.ratio,
        r_M: getattr(drive, "motor_radius", 1.0),
        r_L: getattr(drive, "load_radius", 1.0),
    }
    if drive.motor_inertia_kg_m2 is not None:
        values[I_M] = drive.motor_inertia_kg_m2
    return values
