from typing import Any

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy.calculus.euler import euler_equations

from seaid.errors import SymbolicError
from seaid.symbolic import equations_of_motion, reduce, separate

t = sp.Symbol("t", real=True)
q, p, other = (sp.Function(name, real=True)(t) for name in ("q", "p", "z"))
f = sp.Function("f")
m, inertia, g, r, k, F_v, w, force = sp.symbols("m inertia g r k F_v w force")
KINETIC = (inertia + m * r**2) * q.diff(t) ** 2 / 2


FUNCTIONS = [
    sp.sin(q + 2 * p),
    sp.cos(q - p) * p,
    sp.exp(q * k),
    sp.sqrt(1 + q**2),
    sp.tanh(p),
    sp.Abs(q) * p,
    sp.log(2 + p**2),
    q**4,
    sp.sin(w * t) * q,
    f(q),
    sp.atan2(q, 2 + p**2),
    sp.Max(q, p),
    sp.Integer(1),
]
MOTION = {q: sp.Rational(1, 3) + t - t**2 / 5, p: -sp.Rational(1, 2) + t**2 + t**3 / 7}
VALUES = {k: sp.Rational(2, 3), w: sp.Rational(5, 4), t: sp.Rational(3, 8)}


@pytest.mark.slow  # six pairs of equations, derived by sympy too
@settings(max_examples=6, deadline=None, derandomize=True)
@given(st.sampled_from(FUNCTIONS), st.sampled_from(FUNCTIONS), st.sampled_from(FUNCTIONS))
def test_agrees_with_the_equations_of_sympy(
    first: sp.Expr, second: sp.Expr, third: sp.Expr
) -> None:
    rates = q.diff(t), p.diff(t)
    lagrangian = first * rates[0] ** 2 + second * rates[0] * rates[1] + rates[1] ** 2 * k - third
    found = equations_of_motion(lagrangian, [q, p], [0, 0])
    for equation, expected in zip(found, euler_equations(lagrangian, [q, p], t), strict=True):
        difference = (equation + expected.lhs).replace(f, sp.cosh)
        value = difference.subs(MOTION).doit().subs(VALUES).evalf(30)
        assert abs(value) < 1e-20


def test_prescribed_motion_is_an_input() -> None:
    """A pendulum whose pivot is moved: as with the pivot as a coordinate, without its equation."""
    pivot = other
    tip = sp.Matrix([pivot + r * sp.sin(q), -r * sp.cos(q)]).diff(t)
    lagrangian = inertia * q.diff(t) ** 2 / 2 + m * tip.dot(tip) / 2 + m * g * r * sp.cos(q)
    found = equations_of_motion(lagrangian, [q], [force], inputs=[pivot])
    assert found == equations_of_motion(lagrangian, [pivot, q], [0, force])[1:]
    form = separate(found, [q, pivot], [m, r, inertia])
    assert list(reduce(form).parameters) == [m * r, inertia + m * r**2]
    assert form.regressor.has(pivot.diff(t, 2))
    # of any order, such as the jerk of a reference
    lagrangian = q.diff(t) ** 2 * m / 2 - k * q.diff(t) * pivot.diff(t, 3)
    (equation,) = equations_of_motion(lagrangian, [q], [0], inputs=pivot)
    assert sp.expand(equation - m * q.diff(t, 2) + k * pivot.diff(t, 4)) == 0


def test_jumps_of_sign_are_left_out() -> None:
    (equation,) = equations_of_motion(KINETIC * sp.sign(q), [q], [0])
    assert not equation.has(sp.DiracDelta)
    assert sp.expand(equation - (inertia + m * r**2) * sp.sign(q) * q.diff(t, 2)) == 0


def test_real_functions_of_symbols_without_assumptions() -> None:
    (equation,) = equations_of_motion(KINETIC - sp.Abs(q / k), [q], [0])
    assert not equation.has(sp.re, sp.im)
    assert sp.simplify(equation.coeff(sp.sign(q / k)) - 1 / k) == 0


X = sp.Symbol("x")
REFUSED = [
    (X**2, [X], [0], None, ["coordinate x is not a function of time", "Function('x')(t)"]),
    (KINETIC, [], [], None, ["no coordinates"]),
    (KINETIC, [q, q], [0, 0], None, ["q(t) is listed twice"]),
    (KINETIC, [q, sp.Function("z")(X)], [0, 0], None, ["different times"]),
    (KINETIC - k * p, [q], [0], None, ["Lagrangian contains p(t)", "not declared", "q(t)", "add"]),
    (KINETIC, [q], [0], other.diff(t) ** 2, ["the dissipation contains z(t)", "not declared"]),
    (KINETIC - k * p**2, [q, p], [0, 0], None, ["p(t) occurs without derivatives", "kinetic"]),
    (KINETIC + q.diff(t, 2), [q], [0], None, ["Derivative(q(t), (t, 2))", "first derivatives"]),
    (KINETIC, [q], [0, force], None, ["found 2 forces for 1 coordinates"]),
    (sp.Matrix([KINETIC, 0]), [q], [0], None, ["the Lagrangian must be a scalar"]),
    (KINETIC, [q], [[1]], None, ["a force must be a scalar"]),
    (KINETIC, [q], [0], "a b", ["the dissipation must be a scalar"]),
]
REFUSED_INPUTS = [
    ([q], ["the input q(t) is listed twice"]),
    ([m], ["the input m is not a function of time", "Function('m')(t)"]),
    ([sp.Function("z")(sp.Symbol("x"))], ["different times"]),
    ([p], ["contains z(t)", "not declared", "inputs="]),
]
ROWS: list[tuple[Any, ...]] = [(*row[:4], (), row[4]) for row in REFUSED]
ROWS += [(KINETIC * other, [q], [0], None, *row) for row in REFUSED_INPUTS]


@pytest.mark.parametrize(("lagrangian", "coordinates", "forces", "loss", "inputs", "words"), ROWS)
def test_refusals_say_what_where_and_what_to_do(
    lagrangian: sp.Expr,
    coordinates: list[sp.Expr],
    forces: list[sp.Expr],
    loss: sp.Expr,
    inputs: list[sp.Expr],
    words: list[str],
) -> None:
    """Coordinates, forces, dissipation and prescribed motions that make no equations."""
    with pytest.raises(SymbolicError) as caught:
        equations_of_motion(lagrangian, coordinates, forces, dissipation=loss, inputs=inputs)
    assert all(word in str(caught.value) for word in words), str(caught.value)
