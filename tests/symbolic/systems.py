"""Some eighty Euler-Lagrange systems as data: equations, what is known, how many bases.

The count of each is that of its source or of its formula, None for arms without one;
`test_systems.py` checks it, and the whole base form, at random states with 50 digits.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import sympy as sp
from mpmath import mp, mpf
from sympy import cos, exp, sign, sin, sqrt

from seaid.symbolic import equations_of_motion
from seaid.symbolic.expression_text import expression_of

t = sp.Symbol("t")
g = sp.Symbol("g")
Offset = tuple[sp.Expr | float, ...]


@dataclass(frozen=True)
class System:
    """Equations that are zero, with the number of their base parameters.

    `derive` makes them when they are first used; `base` are the base parameters where they are
    published.
    """

    name: str
    derive: Callable[[], list[sp.Expr]]
    motion: list[sp.Expr]
    unknowns: list[sp.Symbol]
    count: int | None
    base: tuple[sp.Expr, ...] = ()

    @cached_property
    def equations(self) -> list[sp.Expr]:
        return self.derive()


def coordinates(number: int) -> list[sp.Expr]:
    return [sp.Function(f"q{i}")(t) for i in range(1, number + 1)]


def signal(name: str) -> sp.Expr:
    return sp.Function(name)(t)


def rotation(axis: str, angle: sp.Expr) -> sp.Matrix:
    c, s = sp.cos(angle), sp.sin(angle)
    return {
        "x": sp.Matrix([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": sp.Matrix([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": sp.Matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def inertial_symbols(body: int) -> list[sp.Symbol]:
    """The ten parameters of a body in Pinocchio's order."""
    names = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    return [sp.Symbol(f"{name}{body}") for name in names]


def arm(axes: str, offsets: list[Offset]) -> tuple[sp.Expr, list[sp.Expr], list[sp.Symbol]]:
    """Lagrangian, coordinates and parameters of a chain; gravity along -z.

    A letter of `axes` is the axis of a turning joint, a capital one of a sliding joint; `offsets`
    are the places of the joints in the frame of the body before.
    """
    q = coordinates(len(axes))
    turn, speed, place = sp.zeros(3, 1), sp.zeros(3, 1), sp.zeros(3, 1)
    orientation, lagrangian = sp.eye(3), sp.Integer(0)
    parameters: list[sp.Symbol] = []
    for body, (axis, offset) in enumerate(zip(axes, offsets, strict=True), 1):
        unit = sp.Matrix([int(axis.lower() == name) for name in "xyz"])
        rate, slides = q[body - 1].diff(t), axis.isupper()
        step = sp.Matrix(offset) + (unit * q[body - 1] if slides else sp.zeros(3, 1))
        relative = sp.eye(3) if slides else rotation(axis, q[body - 1])
        speed = relative.T * (speed + turn.cross(step) + (unit * rate if slides else 0 * unit))
        turn = relative.T * turn + (0 * unit if slides else unit * rate)
        place, orientation = place + orientation * step, orientation * relative
        symbols = inertial_symbols(body)
        m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz = symbols
        moment = sp.Matrix([mx, my, mz])
        inertia = sp.Matrix([[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]])
        kinetic = m * speed.dot(speed) / 2 + turn.dot(inertia * turn) / 2
        kinetic += moment.dot(speed.cross(turn))
        lagrangian += kinetic - g * (m * place + orientation * moment)[2]
        parameters += symbols
    return lagrangian, q, parameters


def lagrangian_system(
    name: str,
    lagrangian: sp.Expr,
    q: list[sp.Expr],
    unknowns: list[sp.Symbol],
    count: int | None,
    *base: sp.Expr,
    forces: list[sp.Expr] | None = None,
    loss: sp.Expr | int = 0,
) -> System:
    """A system by its Lagrangian; the forces are inputs u1, u2 ... unless given."""
    applied = forces or list(sp.symbols(f"u1:{len(q) + 1}"))
    equations = partial(equations_of_motion, lagrangian, q, applied, dissipation=loss)
    return System(name, equations, q, unknowns, count, base=base)


def two_bodies(axes: str) -> System:
    def equations() -> list[sp.Expr]:
        lagrangian, q, _ = arm(axes, [(0, 0, 0), (0.3, 0.28, 0.2)])
        return equations_of_motion(lagrangian, q, sp.symbols("u1:3"))

    unknowns = [*inertial_symbols(1), *inertial_symbols(2)]
    return System(f"arm {axes}", equations, coordinates(2), unknowns, ARMS.get(axes))


ARMS = {"yy": 6, "zz": 4, "zy": 8}
"""The counts of textbooks; an offset along parallel axes changes none."""

TWO_BODIES = [two_bodies(one + two) for one in "xyzXYZ" for two in "xyzXYZ"]

x, y = signal("x"), signal("y")
q, p, w = signal("q"), signal("p"), signal("w")
th, ph, ps = signal("theta"), signal("phi"), signal("psi")


def chain(masses: int, kind: str) -> System:
    """Masses in a row, each with a spring and a damper to the one before (or to the wall)."""
    place = coordinates(masses)
    ms, ks, cs = (sp.symbols(f"{name}1:{masses + 1}") for name in "mkc")
    steps = [one - before for one, before in zip(place, [0, *place], strict=False)]
    lagrangian = sum(a * v.diff(t) ** 2 for a, v in zip(ms, place, strict=True)) / 2
    lagrangian -= sum(
        a * (s**2 / 2 if kind == "linear" else s**4 / 4) for a, s in zip(ks, steps, strict=True)
    )
    loss = sum(a * sp.diff(s, t) ** 2 for a, s in zip(cs, steps, strict=True)) / 2
    name = f"{masses} masses with {kind} springs"
    unknowns = [*ms, *ks, *cs]
    return lagrangian_system(name, lagrangian, place, unknowns, 3 * masses, loss=loss)


FUNCTIONS = {"sin": sin, "cos": cos, "exp": exp, "sign": sign, "sqrt": sqrt}
NAMED = {"x": x, "y": y, "q": q, "p": p, "w": w, "th": th, "ph": ph, "ps": ps}
NAMED |= {f"d{name}": coordinate.diff(t) for name, coordinate in NAMED.items()}


def read(text: str) -> sp.Expr:
    """Read a text with names of coordinates, after d their velocities, and of other symbols."""
    return expression_of(text, sp.Symbol, FUNCTIONS).xreplace(
        {sp.Symbol(name): value for name, value in NAMED.items()}
    )


def squared_speed(*place: str) -> sp.Expr:
    return sp.Add(*(read(text).diff(t) ** 2 for text in place))


NAMED |= {
    "bob": squared_speed("x + l*sin(th)", "l*cos(th)"),
    "hook": squared_speed("x + y*sin(th)", "y*cos(th)"),
    "forearm": squared_speed("l1*cos(q) + r2*cos(q + p)", "l1*sin(q) + r2*sin(q + p)"),
    "furuta": squared_speed("l*cos(q) - r*sin(q)*sin(p)", "l*sin(q) + r*cos(q)*sin(p)", "r*cos(p)"),
    "w1": read("dph*sin(th)*sin(ps) + dth*cos(ps)"),
    "w2": read("dph*sin(th)*cos(ps) - dth*sin(ps)"),
    "w3": read("dph*cos(th) + dps"),
}
"""Squared speeds of points, and the angular velocity of a body by Euler's angles."""

TEXTBOOK = """
damped pendulum | q | J m r c | J, m*r, c
    J*dq^2/2 + m*g*r*cos(q)
    loss c*dq^2/2
two masses and a spring | x y | m1 m2 k c | m1, m2, k, c
    m1*dx^2/2 + m2*dy^2/2 - k*(x - y)^2/2
    loss c*(dx - dy)^2/2
series elastic joint | q p | F_v F_C k J m | F_v, F_C, k, J, m
    I*dq^2/2 + J*dp^2/2 + m*g*r*cos(p) - k*(r1/N*q - r2*p)^2/2
    forces u1 - F_v*dq - F_C*sign(dq), 0
cart-pole | x th | M m | M, m
    M*dx^2/2 + m*bob/2 + m*g*l*cos(th)
cart-pole, length unknown | x th | M m l J b c | M + m, l*m, J + l^2*m, b, c
    M*dx^2/2 + J*dth^2/2 + m*bob/2 + m*g*l*cos(th)
    loss b*dx^2/2 + c*dth^2/2
gantry crane with a hoist | x y th | M m | M, m
    M*dx^2/2 + m*hook/2 + m*g*y*cos(th)
acrobot | q p | I1 I2 m1 m2 r1 r2 | I1 + m1*r1^2 + m2*l1^2, I2 + m2*r2^2, m1*r1 + m2*l1, m2*r2
    I1*dq^2/2 + I2*(dq + dp)^2/2 + m1*r1^2*dq^2/2 + m2*forearm/2
    - g*(m1*r1*sin(q) + m2*(l1*sin(q) + r2*sin(q + p)))
    forces 0, u1
Furuta pendulum | q p | J1 J2 m r | 4
    J1*dq^2/2 + J2*dp^2/2 + m*furuta/2 - m*g*r*cos(p)
reaction wheel pendulum | q p | J1 J2 m r | 3
    J1*dq^2/2 + J2*(dq + dp)^2/2 + m*g*r*cos(q)
ball and beam | q x | J m J2 | 3
    J*dq^2/2 + m*(dx^2 + x^2*dq^2)/2 + J2*dx^2/2 - m*g*x*sin(q)
elastic pendulum, length unknown | x q | m k l | m, k, k*l
    m*(dx^2 + x^2*dq^2)/2 + m*g*x*cos(q) - k*(x - l)^2/2
spherical pendulum | th ph | m J | 1
    m*l^2*(dth^2 + sin(th)^2*dph^2)/2 + m*g*l*cos(th)
Foucault's pendulum | x y | m k | 2
    m*((dx - alpha*y)^2 + (dy + alpha*x)^2)/2 - k*(x^2 + y^2)/2
bead on a rotating hoop | th ph | m J | 2
    m*R^2*(dth^2 + sin(th)^2*dph^2)/2 + J*dph^2/2 - m*g*R*cos(th)
Coulomb and centrifugal | x ph | m k1 k2 | 3
    m*(dx^2 + x^2*dph^2)/2 + k1/x + k2/x^3
Yukawa's potential | x ph | m k | 2
    m*(dx^2 + x^2*dph^2)/2 + k*exp(-x)/x
Morse's potential | x | m k | 2
    m*dx^2/2 - k*(1 - exp(-alpha*x))^2
Henon-Heiles | x y | m k c | 3
    m*(dx^2 + dy^2)/2 - k*(x^2 + y^2)/2 - c*(x^2*y - y^3/3)
swinging Atwood's machine | x th | M m | 2
    M*dx^2/2 + m*(dx^2 + x^2*dth^2)/2 - M*g*x + m*g*x*cos(th)
disk rolling without slope | x | m J | m + J/R^2
    m*dx^2/2 + J*dx^2/(2*R^2)
heavy symmetric top | ph th ps | J1 J3 m | 3
    J1*(dth^2 + sin(th)^2*dph^2)/2 + J3*w3^2/2 - m*g*l*cos(th)
free rigid body | ph th ps | J1 J2 J3 | J1, J2, J3
    J1*w1^2/2 + J2*w2^2/2 + J3*w3^2/2
gyroscope in gimbals | ph th ps | J1 J2 J3 I1 I2 | 4
    J1*w1^2/2 + J2*w2^2/2 + J3*w3^2/2 + I1*dph^2/2 + I2*(dth^2 + dph^2*sin(th)^2)/2
planar quadrotor | x y th | m J | 2
    m*(dx^2 + dy^2)/2 + J*dth^2/2 - m*g*y
    forces -F*sin(th), F*cos(th), u1
two pendulums and a spring | q p | J1 J2 m1 m2 r1 r2 k | 5
    J1*dq^2/2 + J2*dp^2/2 + m1*g*r1*cos(q) + m2*g*r2*cos(p) - k*(sin(q) - sin(p))^2/2
two coupled circuits | x y | J1 J2 J3 k1 k2 c | 6
    J1*dx^2/2 + J2*dy^2/2 + J3*dx*dy - k1*x^2/2 - k2*y^2/2
    loss c*dx^2/2
magnetic levitation | x y | m b c | 3
    m*dx^2/2 + b*dy^2/(2*(1 + x)) + m*g*x
    loss c*dy^2/2
relativistic particle | x | m k | 2
    -m*sqrt(9 - dx^2) - k*x^2/2
brachistochrone wire | x | m | 1
    m*dx^2*(1 + cos(x)) - m*g*sin(x/2)
beam of one assumed mode | q x | J m k | 3
    J*dq^2/2 + m*((dx + l*dq)^2 + (x*dq)^2)/2 - k*x^2/2
"""
"""Of Goldstein, Landau, Spong, Meirovitch and of control courses.

Name, coordinates, unknowns, base parameters or their number; the Lagrangian; a dissipation, and
the generalised forces unless they are inputs u1, u2 ...
"""


def of_textbook(record: str) -> System:
    """Return the system of a record of TEXTBOOK."""
    head, *lines = record.split("\n    ")
    name, places, unknowns, base = head.split(" | ")
    further = dict(line.split(" ", 1) for line in lines if line.startswith(("loss ", "forces ")))
    lagrangian = " ".join(lines[: len(lines) - len(further)])
    forces = [read(force) for force in further.get("forces", "").split(", ") if force]
    parameters = [] if base.isdigit() else [read(parameter) for parameter in base.split(", ")]
    return lagrangian_system(
        *(name, read(lagrangian), [NAMED[place] for place in places.split()]),
        *([sp.Symbol(unknown) for unknown in unknowns.split()], len(parameters) or int(base)),
        *parameters,
        forces=forces,
        loss=read(further.get("loss", "0")),
    )


SYSTEMS = [
    *TWO_BODIES,
    *(chain(n, kind) for n in range(1, 7) for kind in ("linear", "cubic")),
    *map(of_textbook, re.split(r"\n(?=\S)", TEXTBOOK.strip())),
]

DIGITS, ZERO = 50, mpf(10) ** -25


def leftmost(columns: list[list[mpf]]) -> tuple[int, ...]:
    """Return the columns that are independent of those before them, by Gram-Schmidt."""
    basis: list[list[mpf]] = []
    pivots = []
    for place, column in enumerate(columns):
        size = mp.sqrt(mp.fdot(column, column))
        rest = list(column)
        for _ in range(2):
            for unit in basis:
                share = mp.fdot(unit, rest)
                rest = [x - share * e for x, e in zip(rest, unit, strict=True)]
        left = mp.sqrt(mp.fdot(rest, rest))
        if size and left > ZERO * size:
            basis.append([x / left for x in rest])
            pivots.append(place)
    return tuple(pivots)
