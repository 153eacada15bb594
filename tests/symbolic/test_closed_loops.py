"""Closed loops: base columns on motions that satisfy closures, against QR along such motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import pytest
import sympy as sp
from sympy import cos, sin

from seaid.errors import SymbolicError
from seaid.symbolic import equations_of_motion, reduce, separate
from tests.symbolic.systems import signal, t

q1, q2, q3, x, y, u = (signal(name) for name in ("q1", "q2", "q3", "x", "y", "u"))
g, r, rod, d, h, L, c = sp.symbols("g r l d h L c")
LENGTHS = l1, l2, l3, l4 = sp.symbols("l1:5")
CRANK = J1, a1, b1 = sp.symbols("J1 a1 b1")
COUPLER = m2, a2, b2, J2 = sp.symbols("m2 a2 b2 J2")
ROCKER = J3, a3, b3 = sp.symbols("J3 a3 b3")
m, m3 = sp.symbols("m m3")


@dataclass(frozen=True)
class Linkage:
    """Its one equation, the closures, the signals with the input last, and the unknowns."""

    equation: sp.Expr
    closures: list[sp.Expr]
    signals: list[sp.Expr]
    unknowns: list[sp.Symbol]

    def given(self, values: dict[sp.Symbol, float]) -> Linkage:
        closures = [one.subs(values) for one in self.closures]
        return Linkage(self.equation.subs(values), closures, self.signals, self.unknowns)


def linkage(
    lagrangian: sp.Expr,
    closures: list[sp.Expr],
    coordinates: list[sp.Expr],
    unknowns: list[sp.Symbol],
    forces: tuple[sp.Expr, ...],
) -> Linkage:
    """Multiply the equations by the velocities that the closures leave, up to their size."""
    equations = equations_of_motion(lagrangian, coordinates, forces)
    J = sp.Matrix(closures).jacobian(coordinates)
    free = J[0, :].T.cross(J[1, :].T) if J.rows == 2 else sp.Matrix([-J[0, 1], J[0, 0]])
    residuals = sp.Matrix(equations)
    return Linkage(sp.expand(free.dot(residuals)), closures, [*coordinates, u], unknowns)


def crank_and_coupler(length: sp.Expr, gravity: sp.Expr) -> sp.Expr:
    """Their Lagrangian; a and b are first moments along and across the body."""
    end = length * sp.Matrix([cos(q1), sin(q1)])
    moment = sp.Matrix([a2 * cos(q2) - b2 * sin(q2), a2 * sin(q2) + b2 * cos(q2)])
    speed = end.diff(t)
    kinetic = J1 * q1.diff(t) ** 2 / 2 + m2 * speed.dot(speed) / 2 + J2 * q2.diff(t) ** 2 / 2
    height = a1 * sin(q1) + b1 * cos(q1) + m2 * end[1] + moment[1]
    return kinetic + speed.dot(moment.diff(t)) - gravity * height


@cache
def four_bar(gravity: sp.Expr = g) -> Linkage:
    rocker = J3 * q3.diff(t) ** 2 / 2 - gravity * (a3 * sin(q3) + b3 * cos(q3))
    closures = [
        l1 * cos(q1) + l2 * cos(q2) - l3 * cos(q3) - l4,
        l1 * sin(q1) + l2 * sin(q2) - l3 * sin(q3),
    ]
    lagrangian = crank_and_coupler(l1, gravity) + rocker
    unknowns = [*CRANK, *COUPLER, *ROCKER]
    return linkage(lagrangian, closures, [q1, q2, q3], unknowns, (u, 0, 0))


@cache
def slider_crank() -> Linkage:
    closures = [r * cos(q1) + rod * cos(q2) - x, r * sin(q1) + rod * sin(q2)]
    lagrangian = crank_and_coupler(r, g) + m3 * x.diff(t) ** 2 / 2
    unknowns = [*CRANK, *COUPLER, m3, c]
    return linkage(lagrangian, closures, [q1, q2, x], unknowns, (u, 0, -c * x.diff(t)))


@cache
def spatial_four_bar() -> Linkage:
    """A crank about z and a rocker about x, joined by a rod with two ball joints (RSSR)."""
    crank = sp.Matrix([r * cos(q1), r * sin(q1), 0])
    rocker = sp.Matrix([d, rod * cos(q3), h + rod * sin(q3)])
    v, w, way = crank.diff(t), rocker.diff(t), crank - rocker
    kinetic = J1 * q1.diff(t) ** 2 / 2 + J3 * q3.diff(t) ** 2 / 2
    kinetic += m * (v.dot(v) + v.dot(w) + w.dot(w)) / 6  # of a slender rod
    height = a1 * sin(q1) + b1 * cos(q1) + m * (crank[1] + rocker[1]) / 2 + a3 * cos(q3)
    closure = sp.expand(way.dot(way)) - L**2
    unknowns = [*CRANK, m, J3, a3]
    return linkage(kinetic - g * height, [closure], [q1, q3], unknowns, (u, 0))


NUMBERS: dict[sp.Symbol, float] = dict(zip(LENGTHS, (0.1, 0.3, 0.25, 0.35), strict=True))
NUMBERS |= {r: 0.05, rod: 0.25, d: 0.1, h: 0.3, L: 0.41, g: 9.81}
plane_four_bar = partial(four_bar, sp.Integer(0))
CASES: dict[str, tuple[Callable[[], Linkage], int, list[float]]] = {
    "four-bar": (four_bar, 8, [0.6, 1.7]),
    "four-bar in a horizontal plane": (plane_four_bar, 4, [0.6, 1.7]),
    "slider-crank": (slider_crank, 7, [-0.1, 0.3]),
    "spatial four-bar": (spatial_four_bar, 6, [0.0]),
}
"""The linkage, the number of its base parameters, and about where its other coordinates are."""


def states(given: Linkage, start: list[float]) -> list[list[float]]:
    """Return coordinates, velocities, accelerations and input along a motion that closes the loop.

    The positions of the dependent coordinates are solved for; their derivatives follow from those
    of the closures, J v = 0 and J a = -J' v.
    """
    q = given.signals[:-1]
    names = [sp.Symbol(f"z{i}") for i in range(len(q))]
    closures = sp.Matrix([one.subs(dict(zip(q, names, strict=True))) for one in given.closures])
    J = closures.jacobian(names)
    rates = sp.symbols(f"v0:{len(q)}")
    turning = sum((J.diff(z) * v for z, v in zip(names, rates, strict=True)), sp.zeros(*J.shape))
    closing, slopes = sp.lambdify([names], list(closures)), sp.lambdify([names], J)
    bending = sp.lambdify([names, rates], turning)
    guess, found, draw = np.array(start), [], np.random.default_rng(3)
    for time in np.linspace(0, 8, 150):
        first = 2 * np.sin(time) + 0.7 * np.cos(2.3 * time)
        v1 = 2 * np.cos(time) - 0.7 * 2.3 * np.sin(2.3 * time)
        acceleration = -2 * np.sin(time) - 0.7 * 2.3**2 * np.cos(2.3 * time)
        for _ in range(20):  # Newton's method
            position = [first, *guess]
            step = np.linalg.solve(
                np.array(slopes(position), dtype=float)[:, 1:], closing(position)
            )
            guess = guess - step
        assert np.abs(step).max() < 1e-12
        position = [first, *guess]
        at = np.array(slopes(position), dtype=float)
        velocity = [v1, *np.linalg.solve(at[:, 1:], -at[:, 0] * v1)]
        pull = np.array(bending(position, velocity), dtype=float) @ velocity
        rest = np.linalg.solve(at[:, 1:], -at[:, 0] * acceleration - pull)
        found.append([*position, *velocity, acceleration, *rest, draw.normal()])
    return found


@pytest.mark.slow  # 2.9 s
@pytest.mark.parametrize("name", CASES)
def test_base_set_is_that_of_qr_along_a_motion_that_closes_the_loop(name: str) -> None:
    linkage_of, count, start = CASES[name]
    numbers = {symbol: value for symbol, value in NUMBERS.items() if symbol != g}
    given = linkage_of().given(numbers)
    form = separate(given.equation, given.signals, given.unknowns, relations=given.closures)
    base = reduce(form)
    q = given.signals[:-1]
    free = separate(given.equation, given.signals, given.unknowns)  # in all coordinates, no loop
    arguments = [*q, *(z.diff(t) for z in q), *(z.diff(t, 2) for z in q), u]
    regressor = sp.lambdify([arguments], free.regressor.subs(NUMBERS))
    H = np.vstack([np.array(regressor(state), dtype=float) for state in states(given, start)])
    columns = [list(free.parameters).index(one) for one in form.parameters]
    H = H[:, columns] / np.linalg.norm(H, axis=1).max()
    sizes = np.linalg.norm(H, axis=0)
    sizes[sizes == 0] = 1
    left = np.abs(np.diag(np.linalg.qr(H / sizes, mode="r")))
    assert [int(i) for i in np.flatnonzero(left > 1e-8)] == list(base.pivots)
    assert len(base.pivots) == count
    assert left[list(base.pivots)].min() > 1e-5
    assert left[[i for i in range(len(left)) if i not in base.pivots]].max(initial=0) < 1e-11
    echelon = np.array(base.echelon.subs(NUMBERS), dtype=float)
    assert H[:, list(base.pivots)] @ echelon == pytest.approx(H, rel=1e-9, abs=1e-11)


def test_rolling_without_slip_is_a_relation_of_speeds() -> None:
    """x' sin q1 = y' cos q1 of a skate: its derivative makes two columns one."""
    skate = m * (x.diff(t, 2) * cos(q1) + y.diff(t, 2) * sin(q1)) - u
    skate += J1 * (x.diff(t) * sin(q1) - y.diff(t) * cos(q1))
    skate += J2 * (y.diff(t, 2) * cos(q1) - x.diff(t, 2) * sin(q1))
    skate += J3 * q1.diff(t) * (x.diff(t) * cos(q1) + y.diff(t) * sin(q1))
    edge = x.diff(t) * sin(q1) - y.diff(t) * cos(q1)
    form = separate(skate, [x, y, q1, u], [m, J1, J2, J3], relations=edge)
    base = reduce(form)
    assert list(base.parameters) == [m, J2 + J3]
    assert [one.kind for one in base.columns] == ["base", "zero", "base", "dependent"]


def test_parallelogram_has_two_motions_and_asks_for_one() -> None:
    system = four_bar().given({l3: l1, l4: l2})
    form = separate(system.equation, system.signals, system.unknowns, relations=system.closures)
    with pytest.raises(SymbolicError, match=r"several motions.*parallelogram.*q3 - q1"):
        reduce(form)
    closures = [*system.closures, q3 - q1]
    form = separate(system.equation, system.signals, system.unknowns, relations=closures)
    expected = [J1 + J3 + l1**2 * m2, a1 + a3 + l1 * m2, b1 + b3]
    assert list(reduce(form).parameters) == expected


@pytest.mark.parametrize(
    ("relations", "words"),
    [
        ([cos(q1) - 2, cos(q1) - 3], "no motion satisfies the relations"),
        ([l1 * cos(q1) + sp.log(2) * cos(q2)], "contains log(2).*as a symbol"),
        ([sp.exp(q1) + q2**2 - 1], "contains exp(q1(t)).*cannot be solved for a signal"),
        ([l1 - l2], "contains no signal of motion"),
        ([q1**2 - sp.Rational(10**20 + 39, 10**18 + 9) * q2**2 - q2], None),
        ([q1**2 - m * q2**2], "contains an unknown"),
    ],
)
def test_relations_that_cannot_be_used_are_refused(
    relations: list[sp.Expr], words: str | None
) -> None:
    equation = m * q1**2 + J1 * q2**2 + J2 * q2 + J3 * sp.sign(q1) - u
    with pytest.raises(SymbolicError) as caught:
        reduce(separate(equation, [q1, q2, u], [m, J1, J2, J3], relations=relations))
    text = words or "no short quotients of polynomials in the lengths.*short numbers"
    assert all(part in str(caught.value) for part in text.split(".*")), str(caught.value)


def test_known_square_root_is_kept() -> None:
    system = [r * cos(q1) + sp.sqrt(rod) * cos(q2) - x, r * sin(q1) + sp.sqrt(rod) * sin(q2)]
    torque = m * x * sin(q1) + J1 * (x**2 - 2 * r * x * cos(q1)) + J2 * sp.sqrt(rod) - u
    form = separate(torque, [q1, q2, x, u], [m, J1, J2], relations=system)
    # x^2 - 2 r x cos q1 = rod - r^2
    first, second = reduce(form).parameters
    assert first == m
    assert sp.simplify(second - J1 - J2 * sp.sqrt(rod) / (rod - r**2)) == 0


@pytest.mark.slow  # 1.2 s
@pytest.mark.parametrize(
    ("along", "up", "factor"),
    [
        (sp.Rational(1, 2), sp.sqrt(3) / 2, 2 * sp.sqrt(3) / 3),
        (cos(sp.pi / 7), sin(sp.pi / 7), 1 / sin(sp.pi / 7)),
        (sp.Integer(1), sp.sqrt(1 + sp.sqrt(2)), 1 / sp.sqrt(1 + sp.sqrt(2))),
    ],
)
def test_algebraic_numbers_in_closures(along: sp.Expr, up: sp.Expr, factor: sp.Expr) -> None:
    """A slider-crank whose slide is inclined: its weight rises by `up` along the slide."""
    closures = [r * cos(q1) + rod * cos(q2) - along * x, r * sin(q1) + rod * sin(q2) - up * x]
    power = J1 * q1.diff(t, 2) * q1.diff(t) - u * q1.diff(t) + m * r * x.diff(t)
    power += m2 * (r * cos(q1) * q1.diff(t) + rod * cos(q2) * q2.diff(t))
    base = reduce(separate(power, [q1, q2, x, u], [J1, m2, m], relations=closures))
    assert base.pivots == (0, 1)
    found = base.parameters[1].coeff(m) / r
    assert abs((found - factor).evalf(40)) < 1e-30
