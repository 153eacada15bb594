"""Text becomes an expression by a list of what is allowed, and nothing large is made of it."""

import time

import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from seaid.errors import SymbolicError
from seaid.symbolic.expression_text import expression_of

x, y = sp.symbols("x y")
FUNCTIONS = {"sin": sp.sin, "exp": sp.exp, "log": sp.log, "sqrt": sp.sqrt, "abs": sp.Abs}


def read(text: str) -> sp.Expr:
    return expression_of(text, sp.Symbol, FUNCTIONS)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x", x),
        (" 0.1*x ", x / 10),
        ("1e-3", sp.Rational(1, 1000)),
        (".5 + 2.", sp.Rational(5, 2)),
        ("-x**2", -(x**2)),
        ("2^-1*x^3", x**3 / 2),
        ("x - y - 1", x - y - 1),
        ("x/y/2", x / y / 2),
        ("x**(1/2)", sp.sqrt(x)),
        ("+sin(2*x)**2", sp.sin(2 * x) ** 2),
        ("abs(x)*exp(-(x/y)^2)", sp.Abs(x) * sp.exp(-((x / y) ** 2))),
        ("E + I*S + Q", sum(map(sp.Symbol, ("E", "Q"))) + sp.Symbol("I") * sp.Symbol("S")),
    ],
)
def test_an_expression_is_what_it_says_with_exact_numbers(text: str, expected: sp.Expr) -> None:
    assert read(text) == expected


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("\U0001d41eval", "it may have names, numbers"),
        ("e\u0301", "it may have names, numbers"),
        ("x\u0660", "it may have names, numbers"),
        ("__import__('os')", "it may have names, numbers"),
        ("_x", "it may have names, numbers"),
        ("x.diff", "it may have names, numbers"),
        ("x\ny", "is not an expression"),
        ("'x'", "it may have names, numbers"),
        ("x if y else 1", "the name 'if' is taken"),
        ("lambda*x", "the name 'lambda' is taken"),
        ("x//2", "is not an expression"),
        ("x y", "is not an expression"),
        ("", "is not an expression"),
        ("1j", "it may have names, numbers"),
        ("007", "is not an expression"),
        ("eval(x)", "no function is named 'eval'"),
        ("x(1)", "no function is named 'x'"),
        ("sin(x)(y)", "is not an expression"),
        ("sin(*x)", "is not an expression"),
        ("sin()", "is not an expression"),
        ("sin*x", "the name 'sin' is that of a function"),
        ("(" * 250 + "x" + ")" * 249, "is not an expression"),
        ("-" * 400 + "x", "more than 60 operations within each other"),
        ("x+" * 400 + "x", "is longer than 500 letters"),
        ("9**9**9", "a power above 20"),
        ("2**x", "a power that is not a plain number"),
        ("x**0.01", "a power that is not a plain number"),
        ("x**21", "a power above 20"),
        ("(x+y+1)**20", "more than 100 terms, multiplied out"),
        ("((x**20)**20)", "a degree above 60"),
        ("*".join(f"(x+{i})" for i in range(8)), "more than 100 terms"),
        ("+".join(f"x/(x+{i}*y)" for i in range(8)), "more than 100 terms"),
        ("sin(" + "+".join("x" * 9) + ")", "more than 100 terms"),
        ("(((1.0000001)**20)**20)**20", "a number of too many digits"),
        ("1e400", "a number outside the range of doubles"),
        ("1e200*1e200", "a number outside the range of doubles"),
        ("1" * 41, "more than 40 digits"),
        ("exp(exp(10))", "a function of a number beyond 700"),
        ("exp(x - x + 1e9)", "a function of a number beyond 700"),
        ("x/0", "it divides by zero"),
        ("x/(y-y)", "it divides by zero|is not an expression but"),
        ("log(0)", "outside the range of doubles|has no finite value"),
        ("sqrt(-1)", "a number in it is not real"),
        ("(-8)**(1/3)", "a number in it is not real"),
    ],
)
def test_what_is_no_expression_or_too_large_is_refused_at_once(text: str, words: str) -> None:
    start = time.process_time()
    with pytest.raises(SymbolicError, match=words):
        read(text)
    assert time.process_time() - start < 1.0


TOKENS = ("x", "y", "2", "0.5", "1e99", "+", "-", "*", "/", "**", "^", "(", ")", "sin(", "exp(")


TEXTS = st.lists(st.sampled_from(TOKENS), max_size=30).map("".join) | st.text(max_size=40)


@given(TEXTS)
def test_any_text_is_read_or_refused(text: str) -> None:
    """Of characters of all kinds, and of what is allowed, in any order."""
    try:
        found: object = read(text)
    except SymbolicError as problem:
        found = problem
    if isinstance(found, sp.Expr):
        assert not found.has(sp.zoo, sp.oo, sp.nan)
    else:
        assert len(str(found)) < 300
