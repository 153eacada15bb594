"""A hundred and fifty Euler-Lagrange systems as data: equations, what is known, how many bases.

The count of each is that of its source or of its formula, None for arms without one;
`test_systems.py` checks it, and the whole base form, at random states with 50 digits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial

import sympy as sp

from seaid.symbolic import equations_of_motion

t = sp.Symbol("t")
g = sp.Symbol("g")
Offset = tuple[sp.Expr | float, ...]


@dataclass(frozen=True)
class System:
    """Equations that are zero, with the number of their base parameters.

    `given` are the equations, or what derives them when they are first used. `near`
    {signal: (centre, width)} says where the functions of a signal are alive, default around
    0 +- 2; `base` are the base parameters where they are published.
    """

    name: str
    given: list[sp.Expr] | Callable[[], list[sp.Expr]]
    motion: list[sp.Expr]
    unknowns: list[sp.Symbol]
    count: int | None
    near: Mapping[sp.Expr, tuple[float, float]] = field(default_factory=dict)
    base: tuple[sp.Expr, ...] = ()

    @cached_property
    def equations(self) -> list[sp.Expr]:
        return self.given() if callable(self.given) else self.given


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
    lagrangian, q, parameters = arm(axes, [(0, 0, 0), (0.3, 0.28, 0.2)])
    return lagrangian_system(f"arm {axes}", lagrangian, q, parameters, ARMS.get(axes))


ARMS = {"yy": 6, "zz": 4, "zy": 8}
"""The counts of textbooks; an offset along parallel axes changes none."""

TWO_BODIES = [two_bodies(one + two) for one in "xyzXYZ" for two in "xyzXYZ"]

m, m1, m2, m3, M, r, r1, r2, J, J1, J2, J3 = sp.symbols("m m1 m2 m3 M r r1 r2 J J1 J2 J3")
I1, I2, I3, k, k1, k2, k3, c, c1, c2, d, b = sp.symbols("I1 I2 I3 k k1 k2 k3 c c1 c2 d b")
rod, l1, l2, R, h, N, F, F_v, F_C, F_s, alpha, beta = sp.symbols(
    "l l1 l2 R h N F F_v F_C F_s alpha beta"
)
x, y, z = signal("x"), signal("y"), signal("z")
q, p, w, u = signal("q"), signal("p"), signal("w"), signal("u")
th, ph, ps = signal("theta"), signal("phi"), signal("psi")
sin, cos, tan, exp, sqrt, pi, Abs, sign, tanh = (
    *(sp.sin, sp.cos, sp.tan, sp.exp, sp.sqrt, sp.pi, sp.Abs, sp.sign, sp.tanh),
)
half = sp.Rational(1, 2)


def dot(*signals: sp.Expr) -> list[sp.Expr]:
    return [one.diff(t) for one in signals]


def square(*parts: sp.Expr) -> sp.Expr:
    return sp.Add(*(part**2 for part in parts))


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


def pendulum_chain(links: int, lengths: list[float]) -> System:
    """Point masses on rods of decimal lengths, angles from the vertical: every mass shows."""
    angles, ms = coordinates(links), sp.symbols(f"m1:{links + 1}")
    place, lagrangian = sp.zeros(2, 1), sp.Integer(0)
    for mass, angle, length in zip(ms, angles, lengths, strict=True):
        place += length * sp.Matrix([sin(angle), -cos(angle)])
        speed = place.diff(t)
        lagrangian += mass * speed.dot(speed) / 2 - mass * g * place[1]
    return lagrangian_system(f"{links} point masses, {lengths} m", lagrangian, angles, [*ms], links)


def textbook() -> list[System]:
    """Systems of Goldstein, Landau, Spong, Meirovitch and of control courses."""
    dx, dy, dq, dp, dth, dph, dps = dot(x, y, q, p, th, ph, ps)
    rolling = sp.Matrix([x + rod * sin(th), -rod * cos(th)]).diff(t)
    crane = sp.Matrix([x + y * sin(th), -y * cos(th)]).diff(t)
    arm1 = sp.Matrix([r1 * cos(q), r1 * sin(q)]).diff(t)
    arm2 = sp.Matrix([l1 * cos(q) + r2 * cos(q + p), l1 * sin(q) + r2 * sin(q + p)]).diff(t)
    furuta = sp.Matrix(
        [rod * cos(q) - r * sin(q) * sin(p), rod * sin(q) + r * cos(q) * sin(p), r * cos(p)]
    ).diff(t)
    w1 = dph * sin(th) * sin(ps) + dth * cos(ps)
    w2 = dph * sin(th) * cos(ps) - dth * sin(ps)
    w3 = dph * cos(th) + dps
    one = lagrangian_system
    return [
        one("pendulum", J * dq**2 / 2 + m * g * r * cos(q), [q], [J, m, r], 2, J, m * r),
        one(
            "damped pendulum",
            J * dq**2 / 2 + m * g * r * cos(q),
            [q],
            [J, m, r, c],
            3,
            J,
            m * r,
            c,
            loss=c * dq**2 / 2,
        ),
        one("pendulum of a point mass", m * r**2 * dq**2 / 2 + m * g * r * cos(q), [q], [m, r], 2),
        one(
            "pendulum with a torsion spring",
            J * dq**2 / 2 + m * g * r * cos(q) - k * q**2 / 2,
            [q],
            [J, m, r, k],
            3,
        ),
        one("mass and spring", m * dx**2 / 2 - k * x**2 / 2, [x], [m, k], 2, m, k),
        one(
            "mass, spring and damper in gravity",
            m * dx**2 / 2 - k * x**2 / 2 - m * g * x,
            [x],
            [m, k, c],
            3,
            loss=c * dx**2 / 2,
        ),
        one(
            "Duffing oscillator",
            m * dx**2 / 2 - k1 * x**2 / 2 - k3 * x**4 / 4,
            [x],
            [m, k1, k3, c],
            4,
            loss=c * dx**2 / 2,
        ),
        one(
            "cart-pole",
            M * dx**2 / 2 + m * rolling.dot(rolling) / 2 + m * g * rod * cos(th),
            [x, th],
            [M, m],
            2,
            M,
            m,
        ),
        one(
            "cart-pole, length unknown",
            M * dx**2 / 2 + m * rolling.dot(rolling) / 2 + m * g * rod * cos(th),
            [x, th],
            [M, m, rod],
            3,
            M + m,
            rod * m,
            rod**2 * m,
        ),
        one(
            "gantry crane with a hoist",
            M * dx**2 / 2 + m * crane.dot(crane) / 2 + m * g * y * cos(th),
            [x, y, th],
            [M, m],
            2,
            M,
            m,
        ),
        one(
            "acrobot",
            I1 * dq**2 / 2
            + I2 * (dq + dp) ** 2 / 2
            + m1 * arm1.dot(arm1) / 2
            + m2 * arm2.dot(arm2) / 2
            - g * (m1 * r1 * sin(q) + m2 * (l1 * sin(q) + r2 * sin(q + p))),
            [q, p],
            [I1, I2, m1, m2, r1, r2],
            4,
            I1 + m1 * r1**2 + m2 * l1**2,
            I2 + m2 * r2**2,
            m1 * r1 + m2 * l1,
            m2 * r2,
            forces=[sp.Integer(0), sp.Symbol("u1")],
        ),
        one(
            "Furuta pendulum",
            J1 * dq**2 / 2 + J2 * dp**2 / 2 + m * furuta.dot(furuta) / 2 - m * g * r * cos(p),
            [q, p],
            [J1, J2, m, r],
            4,
        ),
        one(
            "reaction wheel pendulum",
            J1 * dq**2 / 2 + J2 * (dq + dp) ** 2 / 2 + m * g * r * cos(q),
            [q, p],
            [J1, J2, m, r],
            3,
        ),
        one(
            "ball and beam",
            J * dq**2 / 2 + m * (dx**2 + x**2 * dq**2) / 2 + J2 * dx**2 / 2 - m * g * x * sin(q),
            [q, x],
            [J, m, J2],
            3,
        ),
        one(
            "elastic pendulum",
            m * (dx**2 + x**2 * dq**2) / 2 + m * g * x * cos(q) - k * (x - rod) ** 2 / 2,
            [x, q],
            [m, k],
            2,
        ),
        one(
            "elastic pendulum, length unknown",
            m * (dx**2 + x**2 * dq**2) / 2 + m * g * x * cos(q) - k * (x - rod) ** 2 / 2,
            [x, q],
            [m, k, rod],
            3,
            m,
            k,
            k * rod,
        ),
        one(
            "spherical pendulum",
            m * rod**2 * (dth**2 + sin(th) ** 2 * dph**2) / 2 + m * g * rod * cos(th),
            [th, ph],
            [m, J],
            1,
        ),
        one(
            "Foucault's pendulum",
            m * square(dx - alpha * y, dy + alpha * x) / 2 - k * square(x, y) / 2,
            [x, y],
            [m, k],
            2,
        ),
        one(
            "bead on a rotating hoop",
            m * R**2 * (dth**2 + sin(th) ** 2 * dph**2) / 2 + J * dph**2 / 2 - m * g * R * cos(th),
            [th, ph],
            [m, J],
            2,
        ),
        one(
            "particle on a cone",
            m * (dx**2 * (1 + alpha**2) + x**2 * dph**2) / 2 - m * g * alpha * x,
            [x, ph],
            [m],
            1,
        ),
        one("Kepler's problem", m * (dx**2 + x**2 * dph**2) / 2 + k / x, [x, ph], [m, k], 2),
        one(
            "Coulomb and centrifugal",
            m * (dx**2 + x**2 * dph**2) / 2 + k1 / x + k2 / x**3,
            [x, ph],
            [m, k1, k2],
            3,
        ),
        one(
            "Yukawa's potential",
            m * (dx**2 + x**2 * dph**2) / 2 + k * exp(-x) / x,
            [x, ph],
            [m, k],
            2,
        ),
        one("Morse's potential", m * dx**2 / 2 - k * (1 - exp(-alpha * x)) ** 2, [x], [m, k], 2),
        one(
            "Toda lattice of two",
            m1 * dx**2 / 2 + m2 * dy**2 / 2 - k * exp(x - y),
            [x, y],
            [m1, m2, k],
            3,
        ),
        one(
            "Henon-Heiles",
            m * square(dx, dy) / 2 - k * square(x, y) / 2 - c * (x**2 * y - y**3 / 3),
            [x, y],
            [m, k, c],
            3,
        ),
        one(
            "Atwood's machine",
            (m1 + m2) * dx**2 / 2 + J * dx**2 / (2 * R**2) - (m1 - m2) * g * x,
            [x],
            [m1, m2, J],
            2,
        ),
        one(
            "swinging Atwood's machine",
            M * dx**2 / 2 + m * (dx**2 + x**2 * dth**2) / 2 - M * g * x + m * g * x * cos(th),
            [x, th],
            [M, m],
            2,
        ),
        one(
            "rolling disk on a slope",
            m * dx**2 / 2 + J * dx**2 / (2 * R**2) - m * g * x * sin(alpha),
            [x],
            [m, J],
            2,
        ),
        one(
            "disk rolling without slope",
            m * dx**2 / 2 + J * dx**2 / (2 * R**2),
            [x],
            [m, J],
            1,
            m + J / R**2,
        ),
        one(
            "heavy symmetric top",
            J1 * (dth**2 + sin(th) ** 2 * dph**2) / 2 + J3 * w3**2 / 2 - m * g * rod * cos(th),
            [ph, th, ps],
            [J1, J3, m],
            3,
        ),
        one(
            "free rigid body",
            J1 * w1**2 / 2 + J2 * w2**2 / 2 + J3 * w3**2 / 2,
            [ph, th, ps],
            [J1, J2, J3],
            3,
            J1,
            J2,
            J3,
        ),
        one(
            "gyroscope in gimbals",
            (J1 * w1**2 + J2 * w2**2 + J3 * w3**2) / 2
            + I1 * dph**2 / 2
            + I2 * (dth**2 + dph**2 * sin(th) ** 2) / 2,
            [ph, th, ps],
            [J1, J2, J3, I1, I2],
            4,
        ),
        one(
            "planar quadrotor",
            m * square(dx, dy) / 2 + J * dth**2 / 2 - m * g * y,
            [x, y, th],
            [m, J],
            2,
            forces=[-F * sin(th), F * cos(th), sp.Symbol("u1")],
        ),
        one(
            "SLIP runner",
            m * (dx**2 + x**2 * dth**2) / 2 - m * g * x * cos(th) - k * (rod - x) ** 2 / 2,
            [x, th],
            [m, k],
            2,
        ),
        one(
            "TORA",
            M * dx**2 / 2
            + m * square(dx + r * dth * cos(th), r * dth * sin(th)) / 2
            + J * dth**2 / 2
            - k * x**2 / 2,
            [x, th],
            [M, m, r, J, k],
            4,
            M + m,
            m * r,
            m * r**2 + J,
            k,
        ),
        one(
            "quarter car",
            m1 * dx**2 / 2 + m2 * dy**2 / 2 - k1 * (x - y) ** 2 / 2 - k2 * (y - h) ** 2 / 2,
            [x, y],
            [m1, m2, k1, k2, c],
            5,
            loss=c * (dx - dy) ** 2 / 2,
            forces=[sp.Integer(0), sp.Symbol("u1")],
        ),
        one(
            "half car",
            m * dx**2 / 2
            + J * dth**2 / 2
            - k1 * (x - l1 * th) ** 2 / 2
            - k2 * (x + l2 * th) ** 2 / 2,
            [x, th],
            [m, J, k1, k2, c1, c2],
            6,
            loss=c1 * (dx - l1 * dth) ** 2 / 2 + c2 * (dx + l2 * dth) ** 2 / 2,
        ),
        one(
            "two pendulums and a spring",
            J1 * dq**2 / 2
            + J2 * dp**2 / 2
            + m1 * g * r1 * cos(q)
            + m2 * g * r2 * cos(p)
            - k * (sin(q) - sin(p)) ** 2 / 2,
            [q, p],
            [J1, J2, m1, m2, r1, r2, k],
            5,
        ),
        one(
            "pendulum on a spring",
            M * dx**2 / 2 + m * rolling.dot(rolling) / 2 + m * g * rod * cos(th) - k * x**2 / 2,
            [x, th],
            [M, m, k],
            3,
        ),
        one("LC circuit", half * b * dx**2 - x**2 * k / 2, [x], [b, k], 2),
        one(
            "two coupled circuits",
            J1 * dx**2 / 2 + J2 * dy**2 / 2 + J3 * dx * dy - k1 * x**2 / 2 - k2 * y**2 / 2,
            [x, y],
            [J1, J2, J3, k1, k2, c],
            6,
            loss=c * dx**2 / 2,
        ),
        one(
            "magnetic levitation",
            m * dx**2 / 2 + b * dy**2 / (2 * (1 + x)) + m * g * x,
            [x, y],
            [m, b, c],
            3,
            loss=c * dy**2 / 2,
        ),
        one("relativistic particle", -m * sqrt(9 - dx**2) - k * x**2 / 2, [x], [m, k], 2),
        one("brachistochrone wire", m * dx**2 * (1 + cos(x)) - m * g * sin(x / 2), [x], [m], 1),
        one(
            "beam of one assumed mode",
            J * dq**2 / 2 + m * square(dx + rod * dq, x * dq) / 2 - k * x**2 / 2,
            [q, x],
            [J, m, k],
            3,
        ),
    ]


def joint(
    name: str,
    friction: sp.Expr,
    unknowns: list[sp.Symbol],
    count: int,
    near: Mapping[sp.Expr, tuple[float, float]] | None = None,
) -> System:
    """A motor with a law of friction."""
    equations = [J * w.diff(t) + friction - u]
    return System(name, equations, [w, u], [J, *unknowns], count, near=near or {})


def stribeck(speed: float) -> sp.Expr:
    return (F_C + F_s * exp(-((w / speed) ** 2))) * sign(w) + F_v * w


def frictions() -> list[System]:
    law = F_v * w + F_C * sign(w)
    kink = sp.Max(q - 30, 0)
    stretched = (k1 * q + k3 * q**3, k1 * q + k2 * q * Abs(q), k1 * q + k2 * sp.sinh(q))
    return [
        joint("viscous", F_v * w, [F_v], 2),
        joint("viscous and Coulomb", law, [F_v, F_C], 3),
        joint("quadratic drag", law + c * Abs(w) * w, [F_v, F_C, c], 4),
        joint("cubic drag", law + c * w**3, [F_v, F_C, c], 4),
        joint("drag twice", c * Abs(w) * w + d * w**2 * sign(w), [c, d], 2),
        joint("square root drag", law + c * sqrt(Abs(w)) * sign(w), [F_v, F_C, c], 4),
        *(
            joint(f"Stribeck, v_s = {v}", stribeck(v), [F_v, F_C, F_s], 4, {w: (0, 2 * v)})
            for v in (1.0, 0.1, 0.02, 0.005, 1e-6, 50.0)
        ),
        *(
            joint(
                f"Stribeck by |w|, v_s = {v}",
                law + F_s * sign(w) * exp(-Abs(w) / v),
                [F_v, F_C, F_s],
                4,
                {w: (0, 2 * v)},
            )
            for v in (0.25, 0.02)
        ),
        *(
            joint(f"tanh({n} w) and sign", law + c * tanh(n * w), [F_v, F_C, c], 4, {w: (0, 2 / n)})
            for n in (1, 30, 1000, 10**6)
        ),
        joint(
            "atan and tanh", c * sp.atan(1000 * w) + d * tanh(1000 * w), [c, d], 3, {w: (0, 2e-3)}
        ),
        joint(
            "tanh of two sharpnesses",
            c * tanh(300 * w) + d * tanh(700 * w),
            [c, d],
            3,
            {w: (0, 4e-3)},
        ),
        joint(
            "tanh as exponentials", c * tanh(w) + d * (exp(2 * w) - 1) / (exp(2 * w) + 1), [c, d], 2
        ),
        joint("sinh, cosh and exp", c * sp.sinh(w) + d * sp.cosh(w) + b * exp(w), [c, d, b], 3),
        *(
            System(
                f"hard stop at 30: {stop}",
                [J * q.diff(t, 2) + k * q + c * stop - u],
                [q, u],
                [J, k, c],
                3,
                near={q: (30, 3)},
            )
            for stop in (kink, kink**2, sp.Piecewise((0, q < 30), (q - 30, True)))
        ),
        System(
            "exp(1000 q)", [k * q + c * exp(1000 * q) - u], [q, u], [k, c], 2, near={q: (0, 2e-3)}
        ),
        System(
            "dead zone",
            [c * (sp.Max(q - p - 0.001, 0) + sp.Min(q - p + 0.001, 0)) + k * (q - p) - u],
            [q, p, u],
            [c, k],
            2,
            near={q: (0, 4e-3), p: (0, 4e-3)},
        ),
        *(
            System(
                f"spring law {law_}",
                [J * q.diff(t, 2) + law_ - u],
                [q, u],
                [J, *sorted(law_.free_symbols & {k1, k2, k3}, key=str)],
                3,
            )
            for law_ in stretched
        ),
        System(
            "cogging",
            [J * q.diff(t, 2) + c * sin(84 * q) + d * cos(84 * q) - u],
            [q, u],
            [J, c, d],
            3,
        ),
        System(
            "cogging with an unknown phase",
            [J * q.diff(t, 2) + c * sin(6 * q + alpha) - u],
            [q, u],
            [J, c, alpha],
            3,
        ),
        System(
            "pendulum with an unknown zero",
            [J * q.diff(t, 2) + m * g * r * sin(q + alpha) - u],
            [q, u],
            [J, m, r, alpha],
            3,
        ),
    ]


def numbers() -> list[System]:
    """Equations with a combination that only the arithmetic of their numbers makes dependent."""
    pairs = [
        ("decimals", 0.3, 0.3),
        ("decimals of three", 0.28, 0.7 * 0.4),
        ("large and small", 1e6, 1e-6 * 1e12),
        ("pi / 7", sin(pi / 7) ** 2, (1 - cos(2 * pi / 7)) / 2),
        ("pi / 9", 8 * cos(pi / 9) ** 3, 1 + 6 * cos(pi / 9)),
        ("pi / 8", sin(pi / 8) * cos(pi / 8), sqrt(2) / 4),
        ("sqrt(7)", tan(pi / 7) * tan(2 * pi / 7) * tan(3 * pi / 7), sqrt(7)),
        ("pi / 5", cos(pi / 5) - cos(2 * pi / 5), half),
        ("nested roots", sqrt(3 + 2 * sqrt(2)), 1 + sqrt(2)),
        ("cube roots", sp.cbrt(2) * sp.cbrt(4), sp.Integer(2)),
        ("angles", cos(alpha + beta) + cos(alpha - beta), 2 * cos(alpha) * cos(beta)),
        ("symbols", (l1**2 - l2**2) / (l1 - l2), l1 + l2),
    ]
    equal = [
        System(
            f"equal numbers: {name}",
            [c * left * x + d * right * x - u, (c + d) * y - z],
            [x, y, z, u],
            [c, d],
            1,
        )
        for name, left, right in pairs
    ]
    lever = [
        System(f"lever of {length} m", [
            sp.expand(length * (length * m1 + m2) * q.diff(t, 2)) - u,
            sp.expand((length * m1 + m2) * p.diff(t, 2)) - w,
        ], [q, p, u, w], [m1, m2], 1)
        for length in (0.3, 0.28, 0.7, 1.1)
    ]  # fmt: skip
    free = [
        System("free oscillation", [J * q.diff(t, 2) + c * q.diff(t) + k * q], [q], [J, c, k], 3),
        System("free pendulum", [J * q.diff(t, 2) + m * g * r * sin(q)], [q], [J, m, r], 2),
        System(
            "torque as a symbol",
            [m * rod**2 * q.diff(t, 2) + m * g * rod * sin(q) - sp.Symbol("u0") / rod],
            [q],
            [m],
            1,
        ),
    ]
    return equal + lever + free


SYSTEMS = [
    *TWO_BODIES,
    *(chain(n, kind) for n in range(1, 7) for kind in ("linear", "cubic")),
    *(pendulum_chain(n, lengths) for n, lengths in
      ((2, [0.3, 0.28]), (3, [0.3, 0.28, 0.2]), (2, [1.7, 0.1]), (4, [0.11, 0.13, 0.17, 0.19]))),
    *textbook(),
    *frictions(),
    *numbers(),
]  # fmt: skip
