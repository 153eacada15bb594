import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid.errors import SymbolicError
from seaid.symbolic.from_sympy import read_equations
from seaid.symbolic.polynomial import Ratio, Ring, multiply, ratio_to_sympy

x, y, m, N = sp.symbols("x y m N", positive=True)
q = sp.Function("q")(sp.Symbol("t"))


def read(*expressions: sp.Expr, max_terms: int = 10_000) -> tuple[Ring, list[Ratio]]:
    return read_equations(expressions, (x, y, q), (m,), max_terms)


def normal(expression: sp.Expr) -> sp.Expr:
    ring, (value,) = read(expression)
    return ratio_to_sympy(ring, value)


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        (sp.sin(x) ** 2 + sp.cos(x) ** 2, 1),
        (sp.sin(x) ** 3, sp.sin(x) - sp.sin(x) * sp.cos(x) ** 2),
        (sp.cos(2 * x + y), sp.expand(sp.cos(2 * x + y), trig=True)),
        (sp.sin(x / 2) * sp.cos(x / 2) * 2 - sp.sin(x), 0),
        (sp.tan(x) * sp.cos(x) - sp.sin(x), 0),
        (sp.cot(x) * sp.tan(x) + sp.sec(x) * sp.cos(x) + sp.csc(x) * sp.sin(x), 3),
        (sp.sin(x + sp.pi / 4) * sp.sqrt(2), sp.sin(x) + sp.cos(x)),
        (sp.cos(x + sp.pi / 7) ** 2 + sp.sin(x + sp.pi / 7) ** 2, 1),
        (sp.cos(x + 1) * sp.sin(x) - sp.sin(x + 1) * sp.cos(x), -sp.sin(1)),
        ((sp.exp(x) + 1) ** 2 - sp.exp(2 * x), 2 * sp.exp(x) + 1),
        (sp.exp(x + sp.log(2) * y) / sp.exp(x), sp.exp(sp.log(2) * y)),
        (sp.sqrt(1 + x) ** 3 / sp.sqrt(1 + x), 1 + x),
        (1 / sp.sqrt(2) + 1 / sp.sqrt(6), sp.sqrt(2) / 2 + sp.sqrt(2) * sp.sqrt(3) / 6),
        (1 / (sp.sqrt(N) - 2), (sp.sqrt(N) + 2) / (N - 4)),
        (sp.Pow(2, sp.Rational(2, 3)) * sp.Pow(2, sp.Rational(1, 2)), 2 * sp.root(2, 6)),
        (sp.Abs(q) * q, q**2 * sp.sign(q)),
        (sp.sign(-2 * q) * sp.sign(q), -1),
        (sp.Abs(q - 2 * x) ** 2, q**2 - 4 * x * q + 4 * x**2),
        ((x**2 - y**2) / (x - y), x + y),
        (sp.Derivative(sp.sin(q), sp.Symbol("t")), sp.cos(q) * q.diff()),
        (0.1 * x, x / 10),
        (sp.tanh(q + q) - sp.tanh(2 * q), 0),
    ],
)
def test_normal_form(written: sp.Expr, meant: sp.Expr) -> None:
    assert sp.expand(normal(written) - sp.sympify(meant)) == 0


EXPRESSIONS = st.recursive(
    st.sampled_from([x, y, m, N, sp.sin(x), sp.cos(x + y), sp.sqrt(N + 1), sp.Rational(2, 3)]),
    lambda inner: st.builds(
        lambda left, right, operation: operation(left, right),
        inner,
        inner,
        st.sampled_from([lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b]),
    ),
    max_leaves=12,
)
POINT = {x: sp.Rational(7, 5), y: sp.Rational(-3, 4), m: sp.Rational(5, 3), N: sp.Integer(4)}


@settings(max_examples=60, deadline=None, derandomize=True)
@given(EXPRESSIONS)
def test_reading_keeps_the_value_and_is_a_normal_form(expression: sp.Expr) -> None:
    found = normal(expression)
    assert abs((found - expression).subs(POINT).evalf(40)) < 1e-25
    assert sp.expand(normal(sp.expand(expression, trig=True)) - found) == 0


def test_a_product_in_pieces_equals_the_product_at_once() -> None:
    ring, (a, b) = read((1 + x + y + m) ** 8, (1 + x + y - m) ** 8, max_terms=1000)
    at_once = a.numerator * b.numerator
    assert len(a.numerator) * len(b.numerator) > ring.max_terms
    assert multiply(ring, a.numerator, b.numerator) == at_once


def test_zero_denominator_is_refused() -> None:
    with pytest.raises(SymbolicError, match="equation 1: a denominator is identically zero"):
        read(x / (sp.sin(x) ** 2 + sp.cos(x) ** 2 - 1))


def test_sum_and_product_beyond_the_limit_are_refused() -> None:
    with pytest.raises(SymbolicError, match=r"equation 2: .*too large.*max_terms=20"):
        read(x, sp.Add(*(x**i for i in range(30))), max_terms=20)
    with pytest.raises(SymbolicError, match=r"a product of .* terms goes beyond max_terms=20"):
        read((x + y + m + N) ** 4, max_terms=20)
