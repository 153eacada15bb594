import time
import warnings
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid.errors import SeaidWarning, SymbolicError
from seaid.symbolic import BaseForm, RegressorForm, reduce, separate
from tests.regressor.stances import leftmost
from tests.representatives import quick_first

x, y, z, a = sp.symbols("x y z a")
r, d, g, alpha = sp.symbols("r d g alpha")
P = sp.symbols("p1:6")

FUNCTIONS = [x, y * x, sp.sin(x), sp.cos(x) ** 2, sp.sin(x) ** 2, sp.cos(x + y), sp.Integer(1), z]
FACTORS = [0, 1, -2, r, d, r + d, r * d - 1, sp.Rational(2, 3), 1 / r, sp.sqrt(2), sp.cos(alpha)]
EQUATIONS = st.lists(
    st.lists(
        st.tuples(st.sampled_from(FACTORS), st.sampled_from(FUNCTIONS)), min_size=1, max_size=3
    ),
    min_size=len(P),
    max_size=len(P),
)


def system(columns: list[list[tuple[sp.Expr, sp.Expr]]]) -> sp.Expr:
    return sum(p * sum(f * h for f, h in column) for p, column in zip(P, columns, strict=True)) - a


def numeric_pivots(form: RegressorForm) -> tuple[int, ...]:
    """Leftmost independent columns of R, stacked over random motions, with random known values."""
    known = {r: 0.83, d: -1.37, alpha: 0.61, g: 9.81}
    evaluate = sp.lambdify((x, y, z, a), form.regressor.subs(known), "numpy")
    samples = np.random.default_rng(0).uniform(-2, 2, (40, 4))
    rows = [np.broadcast_to(evaluate(*row), form.regressor.shape) for row in samples]
    return tuple(leftmost(np.vstack(rows)))


def is_zero(matrix: sp.Matrix) -> bool:
    return all(sp.simplify(sp.expand(element, trig=True)) == 0 for element in matrix)


def check_laws(form: RegressorForm, base: BaseForm) -> None:
    n, m, p = form.regressor.rows, form.regressor.cols, len(base.pivots)
    f = sp.Matrix(base.fundamental_functions)
    assert base.regressor == form.regressor.extract(list(range(n)), list(base.pivots))  # R_0
    assert base.echelon.shape == (p, m)
    assert base.echelon.extract(list(range(p)), list(base.pivots)) == sp.eye(p)
    assert base.parameters == base.echelon * form.parameters  # (14)
    assert base.B.shape == (n * len(f), m)
    assert is_zero(sp.kronecker_product(sp.eye(n), f.T) * base.B - form.regressor)  # (11)
    assert is_zero(base.regressor * base.parameters - form.regressor * form.parameters)


@pytest.mark.rounding
@settings(max_examples=15, deadline=None, derandomize=True)
@given(EQUATIONS)
def test_laws_of_the_base_form_and_numeric_pivots(
    columns: list[list[tuple[sp.Expr, sp.Expr]]],
) -> None:
    try:
        form = separate(system(columns), [x, y, z, a], P)
    except SymbolicError:
        return
    base = reduce(form)
    check_laws(form, base)
    assert base.pivots == numeric_pivots(form)


@pytest.mark.rounding
@pytest.mark.parametrize("number", [1 + 1e-13 / 3, 1 + 1e-9, 1.00000003])
def test_pivots_that_nearly_cancel_are_said(number: float) -> None:
    form = separate([P[0] * x + P[1] * y * 2 - a, P[2] * z - a, P[0] * y + number * P[1] * y * 2],
                    [x, y, z, a], P[:3])  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(reduce(form).pivots) == 3
    form = separate(
        [P[0] * x + P[1] * x - a, P[0] * y + number * P[1] * y - z], [x, y, z, a], P[:2]
    )
    with pytest.warns(SeaidWarning, match=r"p2 is identifiable only because numbers that nearly"):
        assert reduce(form).pivots == (0, 1)


def test_equations_without_an_input_are_identified_up_to_a_factor() -> None:
    J, c, k, m = P[:4]
    free = J * x + c * y + k * z
    assert reduce(separate(free, [x, y, z], [J, c, k])).ratios == ((J, c, k),)
    assert reduce(separate(free - a, [x, y, z, a], [J, c, k])).ratios == ()
    # an equation with an input that shares k fixes the scale, one that shares nothing does not
    form = separate([free, k * z + m * x - a], [x, y, z, a], [J, c, k, m])
    assert reduce(form).ratios == ()
    form = separate([free, m * x - a], [x, y, z, a], [J, c, k, m])
    assert reduce(form).ratios == ((J, c, k),)
    form = separate([J * x + (c + k) * y, m * x - a], [x, y, a], [J, c, k, m])
    assert reduce(form).ratios == ((J, c + k),)


def test_the_three_types_of_columns() -> None:
    """Base, zero and dependent ones, of two equations with denominators too."""
    shared = [P[0] * x + P[1] * sp.sin(y) - a, P[0] * y * r + P[1] * sp.sin(y) - P[2] * z]
    lower = P[0] / (1 + x) + P[1] * x / (1 + x) + P[2] * y / (r + x) + P[3] - a
    kinds = {
        P[0] * x + P[2] * r * x + P[3] * (d * x + y) - a: ["base", "zero", "dependent", "base"],
        lower: ["base", "base", "base", "dependent"],
        sp.ImmutableMatrix(shared): ["base", "base", "base"],
    }
    for equations, expected in kinds.items():
        form = separate(equations, [x, y, z, a], P[: len(expected)])
        base = reduce(form)
        check_laws(form, base)
        assert [column.kind for column in base.columns] == expected
        assert [column.parameter for column in base.columns] == list(P[: len(expected)])
    first = reduce(separate(next(iter(kinds)), [x, y, a], P[:4]))
    assert first.columns[2].depends_on == {P[0]: r}
    assert list(first.parameters) == [P[0] + r * P[2], P[3]]
    assert first.different_rows == 2


pi, cos = sp.pi, sp.cos
EQUAL_NUMBERS: list[tuple[sp.Expr | float, sp.Expr | float]] = [
    (0.3, 0.3),
    (0.28, 0.7 * 0.4),
    (1e6, 1e-6 * 1e12),
    (sp.sin(pi / 7) ** 2, (1 - cos(2 * pi / 7)) / 2),
    (cos(pi / 7) - cos(2 * pi / 7) + cos(3 * pi / 7), sp.Rational(1, 2)),
    (8 * cos(pi / 9) ** 3, 1 + 6 * cos(pi / 9)),
    (8 * sp.sin(pi / 9) * sp.sin(2 * pi / 9) * sp.sin(4 * pi / 9), sp.sqrt(3)),
    (1 / (1 + cos(pi / 9)), 1 / (2 * cos(pi / 18) ** 2)),
    (sp.sin(pi / 8) * cos(pi / 8), sp.sqrt(2) / 4),
    (sp.tan(pi / 7) * sp.tan(2 * pi / 7) * sp.tan(3 * pi / 7), sp.sqrt(7)),
    (sp.sqrt(3 + 2 * sp.sqrt(2)), 1 + sp.sqrt(2)),
    (sp.cbrt(2) * sp.sqrt(2), 2 ** sp.Rational(5, 6)),
    (cos(173 * pi / 1800) ** 2, 1 - sp.sin(173 * pi / 1800) ** 2),
    (cos(alpha + d) + cos(alpha - d), 2 * cos(alpha) * cos(d)),
    ((r**2 - d**2) / (r - d), r + d),
]


@pytest.mark.parametrize(("left", "right"), EQUAL_NUMBERS)
def test_equal_algebraic_numbers_are_equal(left: sp.Expr, right: sp.Expr) -> None:
    rows = [P[0] * left * x + P[1] * right * x - y, (P[0] + P[1]) * z - a]
    assert list(reduce(separate(rows, [x, y, z, a], P[:2])).parameters) == [P[0] + P[1]]
    rows = [P[0] * left * x + P[1] * right * (1 + sp.Rational(1, 10**9)) * x - y, rows[1]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert reduce(separate(rows, [x, y, z, a], P[:2])).pivots == (0, 1)


@pytest.mark.rounding
def test_numbers_of_a_large_field_that_cancel_are_said() -> None:
    """The field of cos(pi/180) has degree 48: its relations are not used."""
    left, right = 2 * cos(7 * pi / 180) * cos(7 * pi / 180), cos(14 * pi / 180) + 1
    assert abs((left - right).evalf()) < 1e-12
    rows = [P[0] * left * x + P[1] * right * x - y, (P[0] + P[1]) * z - a]
    assert reduce(separate(rows, [x, y, z, a], P[:2])).pivots == (0,)  # an addition theorem
    left, right = cos(pi / 180) - cos(59 * pi / 180), cos(61 * pi / 180)
    assert abs((left - right).evalf()) < 1e-12
    rows = [P[0] * left * x + P[1] * right * x - y, (P[0] + P[1]) * z - a]
    with pytest.warns(SeaidWarning, match="p2 is identifiable only because numbers"):
        reduce(separate(rows, [x, y, z, a], P[:2]))


SHARP = [
    [x, sp.sign(x), sp.sign(x) * sp.exp(-((x / 0.02) ** 2))],
    [x, sp.sign(x), sp.sign(x) * sp.exp(-((50 * x - 1500) ** 2)), sp.Abs(x) * x],
    [x, sp.sign(x), sp.sign(x) * sp.exp(-sp.Abs(500 * x)), sp.Abs(x) * x],
    [x, sp.sign(x), sp.tanh(1000 * x), sp.atan(1000 * x), sp.erf(1000 * x)],
    [x, sp.tanh(10**6 * x), sp.tanh(2 * 10**6 * x)],
    [x, sp.Integer(1), sp.Max(x - 30, 0), sp.Max(x - 31, 0)],
    [x - y, sp.Max(x - y - 0.001, 0) + sp.Min(x - y + 0.001, 0)],
    [x, sp.exp(1000 * x), sp.tanh(x)],
    [sp.log(x - 1000), sp.sqrt(x - 1000), (x - 1000) ** sp.Rational(3, 2)],
    [sp.sign(sp.sin(x) - 0.5), sp.tanh(200 * sp.sin(x) - 100)],
    [x * sp.exp(-(10**6) * x**2) * sp.Rational(1, 10**9), sp.tanh(x * sp.Rational(1, 10**8))],
    [x, sp.Piecewise((x**2, x < 40), (x, True)), sp.Heaviside(x - 50)],
    [x, sp.sign(x), sp.tanh(x / g), sp.Abs(x) * x, sp.exp(-sp.Abs(x / d)) * sp.sign(x)],
]


@pytest.mark.parametrize("functions", SHARP)
def test_sharp_and_far_functions_are_independent(functions: list[sp.Expr]) -> None:
    equation = sum(p * f for p, f in zip(P, functions, strict=False)) - a
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        base = reduce(separate(equation, [x, y, a], P[: len(functions)]))
    assert base.pivots == tuple(range(len(functions)))


def test_powers_with_a_known_exponent_are_independent_and_cheap() -> None:
    """Hertz's contact k x^n: as powers of fractions they would have exact, endless factors."""
    n, started = sp.Symbol("n"), time.process_time()
    damped = P[0] * x**n + P[1] * x**n * y + P[2] * x + P[3] * x ** (n / 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert reduce(separate(damped - a, [x, y, a], P[:4])).pivots == (0, 1, 2, 3)
    dependent = P[0] * x**n * x + P[1] * x + P[2] * x ** (n + 1) - a
    with pytest.warns(SeaidWarning, match="depend on each other"):
        assert list(reduce(separate(dependent, [x, a], P[:3])).parameters) == [P[0] + P[2], P[1]]
    nested = P[0] * sp.tanh(x**n * y) + P[1] * (x * y) ** n - a
    assert reduce(separate(nested, [x, y, a], P[:2])).pivots == (0, 1)
    assert time.process_time() - started < 5.0


DEPENDENT = [
    ([sp.exp(x), sp.cosh(x), sp.sinh(x)], [P[0] + P[2], P[1] - P[2]]),
    ([sp.cosh(x) ** 2, sp.sinh(x) ** 2, sp.Integer(1)], [P[0] + P[2], P[1] - P[2]]),
    ([sp.log(x), sp.log(x**2) * y, sp.log(x) * y], [P[0], P[1] + P[2] / 2]),
    ([sp.Max(x, y), sp.Min(x, y), x + y], [P[0] + P[2], P[1] + P[2]]),
    ([sp.exp(1000 * x), sp.sinh(1000 * x), sp.cosh(1000 * x)], [P[0] + P[2], P[1] - P[2]]),
    ([sp.exp(1000 * x), sp.sinh(1000 * x), sp.exp(-1000 * x)], [P[0] + P[2], P[1] - 2 * P[2]]),
    ([sp.tanh(1000 * x), (sp.exp(2000 * x) - 1) / (sp.exp(2000 * x) + 1), x], [P[0] + P[1], P[2]]),
    ([sp.Heaviside(x - 50), sp.sign(x - 50), sp.Integer(1)], [P[0] + 2 * P[2], P[1] - P[2]]),
    ([sp.Max(x - 100, 0), sp.Piecewise((x - 100, x > 100), (0, True)), x], [P[0] + P[1], P[2]]),
]
"""Functions of which one depends on the others, also where they are sharp or far from zero."""


@pytest.mark.rounding
@pytest.mark.parametrize(("functions", "parameters"), quick_first(DEPENDENT, 4))
def test_dependent_functions_are_found_said_and_replaced(
    functions: list[sp.Expr], parameters: list[sp.Expr]
) -> None:
    """One relation is reported, holds at a point, and leaves the torque as it is."""
    form = separate(sum(p * f for p, f in zip(P, functions, strict=False)) - a, [x, y, a], P[:3])
    with pytest.warns(SeaidWarning, match="functions of the motion depend on each other"):
        base = reduce(form)
    assert list(base.parameters) == parameters
    ((left, right),) = base.function_relations
    torque = base.regressor * base.parameters - form.regressor * form.parameters
    point = {x: 0.37, y: 1.21, **{p: i + 1.5 for i, p in enumerate(P)}}
    for zero in (left - right, torque[0]):
        assert abs(zero.subs(point).evalf()) < 1e-12 * (1 + abs(left.subs(point).evalf()))


def test_functions_that_cannot_be_evaluated_are_said() -> None:
    equation = P[0] * sp.log(-1 - x**2 - sp.Function("h")(r)) + P[1] * sp.tanh(x) - a
    with pytest.warns(SeaidWarning, match="was not checked"):
        assert reduce(separate(equation, [x, a], P[:2])).pivots == (0, 1)


HYPERBOLIC = P[0] * (sp.cosh(x) ** 2 - sp.sinh(x) ** 2 - 1) - a
LOGARITHMS = P[0] * sp.log(x) + P[1] * sp.log(2 * x) + P[2] - a


@pytest.mark.filterwarnings("ignore::seaid.SeaidWarning")
@pytest.mark.parametrize(
    ("form", "words"),
    [
        (separate(LOGARITHMS, [x, a], P[:3]), r"log\(2\*x\) .* depends on 1, log\(x\) with fac"),
        (separate(HYPERBOLIC, [x, a], P[:1]), r"no parameter is ident.*p1"),
        ([x], "reduce takes the result of separate, found list"),
    ],
)
def test_what_has_no_base_form_is_refused(form: Any, words: str) -> None:
    with pytest.raises(SymbolicError, match=words):
        reduce(form)
