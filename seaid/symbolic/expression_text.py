"""A user's text as a sympy expression, parsed through its syntax tree; nothing is evaluated.

Allowed are ASCII names, numbers, + - * /, powers and the given functions. Large expressions are
refused before they are built, so that no text takes long.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from keyword import iskeyword

import sympy as sp
from sympy.functions.elementary.hyperbolic import HyperbolicFunction
from sympy.functions.elementary.trigonometric import TrigonometricFunction

from seaid.errors import SymbolicError, check_name, shortened

_MOST_LETTERS = 500
"""Limit on the letters of a text. The limits keep a user's text from taking more time or memory
than an equation of a drive does."""

_MOST_DIGITS = 40
"""Limit on the digits of a number; a double has 17."""

_MOST_POWER = 20
"""Limit on the size of an exponent, and on its denominator."""

_MOST_DEGREE = 60
"""Limit on the degree of a product or power, with functions counted as of degree 1."""

_MOST_TERMS = 100
"""Limit on the terms of numerator and denominator each, multiplied out."""

_MOST_DEPTH = 60
"""Limit on operations within each other, since each is a call in the call before."""

_MOST_BITS = 4096
"""Limit on the bits of numerator and denominator of a number together."""

_MOST_ARGUMENT = 700.0
"""Limit on the argument of a function of numbers: exp(700) is near the largest double."""

_OF_SUMS = (TrigonometricFunction, HyperbolicFunction)
"""Functions expanded by angle sums: the terms double with each term of the argument."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)(?![\w.])"
    r"|(?P<name>[A-Za-z]\w*)|[-+*/()])",
    re.ASCII,
)


@dataclass(frozen=True)
class _Part:
    """An expression, its value if it is a number, and a bound on its size.

    `above` and `below` bound the terms of numerator and denominator once multiplied out.
    """

    expression: sp.Expr
    above: int = 1
    below: int = 1
    degree: int = 1
    number: float | None = None


def expression_of(
    text: str, symbol: Callable[[str], sp.Expr], functions: Mapping[str, Callable[..., sp.Expr]]
) -> sp.Expr:
    """Return a text such as "c*sin(2*x)**2" or "0.1*x^3" as an expression.

    Decimals become exact rationals. `symbol` maps a name to its expression; `functions` are the
    allowed functions of one argument. Raises SymbolicError for any other text, and for expressions
    that are too large or have no finite real value.
    """
    if len(text) > _MOST_LETTERS:
        raise SymbolicError(f"is longer than {_MOST_LETTERS} letters")
    plain = text.replace("^", "**").strip(" \t")
    _check_tokens(plain, functions)
    try:
        tree = ast.parse(plain, mode="eval")
    except (SyntaxError, ValueError, MemoryError, RecursionError):  # of too many brackets
        raise SymbolicError("is not an expression") from None
    expression = _part(tree.body, plain, symbol, functions, 0).expression
    if not isinstance(expression, sp.Expr) or expression.has(sp.zoo, sp.oo, sp.nan, sp.I):
        raise SymbolicError(f"is not an expression but {shortened(str(expression))}")
    return expression


def _check_tokens(text: str, functions: Mapping[str, object]) -> None:
    """Refuse characters and words that no expression has, before Python's parser sees them."""
    place = 0
    while place < len(text):
        token = _TOKEN.match(text, place)
        if token is None:
            raise SymbolicError(
                "is not an expression: it may have names, numbers and + - * / ^ ( )"
            )
        place = token.end()
        name = token["name"]
        if name is not None and iskeyword(name):
            raise SymbolicError(f"the name '{name}' is taken; choose another")
        if name in functions and not text[place:].lstrip().startswith("("):
            raise SymbolicError(f"the name '{name}' is that of a function; choose another")
        if sum(map(str.isdigit, token["number"] or "")) > _MOST_DIGITS:
            raise SymbolicError(f"has a number of more than {_MOST_DIGITS} digits")


def _part(
    node: ast.expr,
    text: str,
    symbol: Callable[[str], sp.Expr],
    functions: Mapping[str, Callable[..., sp.Expr]],
    depth: int,
) -> _Part:
    if depth > _MOST_DEPTH:
        raise SymbolicError(f"has more than {_MOST_DEPTH} operations within each other")

    def inner(child: ast.expr) -> _Part:
        return _part(child, text, symbol, functions, depth + 1)

    match node:
        case ast.Constant(value=int() | float()) if not isinstance(node.value, bool):
            # From the text: the parsed double of 0.1 is not 1/10.
            value = Fraction(text[node.col_offset : node.end_col_offset])
            return _built(lambda: sp.Rational(value.numerator, value.denominator), degree=0)
        case ast.Name():
            return _built(lambda: symbol(node.id), degree=1)
        case ast.UnaryOp(op=ast.UAdd()):
            return inner(node.operand)
        case ast.UnaryOp(op=ast.USub()):
            return _product(_MINUS_ONE, inner(node.operand))
        case ast.BinOp(op=operation) if type(operation) in _OPERATIONS:
            return _OPERATIONS[type(operation)](inner(node.left), inner(node.right))
        case ast.Call(func=ast.Name(id=called), args=[argument], keywords=[]):
            check_name("function", called, functions, SymbolicError)
            return _called(functions[called], inner(argument))
    raise SymbolicError("is not an expression")


def _sum(first: _Part, second: _Part) -> _Part:
    # a/b + c/d = (a d + c b) / (b d), counted in terms.
    below = first.below * second.below
    above = first.above * second.below + second.above * first.below
    degree = max(first.degree, second.degree)
    return _built(lambda: first.expression + second.expression, degree, above, below)


def _product(first: _Part, second: _Part) -> _Part:
    above, below = first.above * second.above, first.below * second.below
    degree = first.degree + second.degree
    return _built(lambda: first.expression * second.expression, degree, above, below)


def _power(base: _Part, power: _Part) -> _Part:
    exponent = power.expression
    if not isinstance(exponent, sp.Rational) or exponent.q > _MOST_POWER:
        raise SymbolicError(
            f"has a power that is not a plain number; allowed are numbers from -{_MOST_POWER} to "
            f"{_MOST_POWER}, and exp()"
        )
    if abs(exponent) > _MOST_POWER:
        raise SymbolicError(
            f"has a power above {_MOST_POWER}; allowed are -{_MOST_POWER} to {_MOST_POWER}"
        )
    size = math.ceil(abs(exponent))
    if _bits(base.expression) * size > _MOST_BITS:
        raise SymbolicError("has a number of too many digits")
    if base.expression == 0 and exponent < 0:
        raise SymbolicError("is not an expression: it divides by zero")
    # A sum of n terms to the power s has binomial(n + s - 1, s) terms.
    above, below = (math.comb(terms + size - 1, size) for terms in (base.above, base.below))
    if exponent < 0:
        above, below = below, above
    return _built(lambda: base.expression**exponent, base.degree * size, above, below)


_MINUS_ONE = _Part(sp.Integer(-1), degree=0, number=-1.0)
"""The factor -1, as a part of an expression."""

_OPERATIONS: Mapping[type[ast.operator], Callable[[_Part, _Part], _Part]] = {
    ast.Add: _sum,
    ast.Sub: lambda first, second: _sum(first, _product(_MINUS_ONE, second)),
    ast.Mult: _product,
    ast.Div: lambda first, second: _product(first, _power(second, _MINUS_ONE)),
    ast.Pow: _power,
}


def _called(function: Callable[..., sp.Expr], argument: _Part) -> _Part:
    if argument.number is not None and abs(argument.number) > _MOST_ARGUMENT:
        raise SymbolicError(
            f"has a function of a number beyond {_MOST_ARGUMENT:g}: write its value"
        )
    is_number = argument.number is not None
    doubles = isinstance(function, type) and issubclass(function, _OF_SUMS) and not is_number
    above = 2 ** (argument.above - 1) if doubles else 1
    return _built(lambda: function(argument.expression), 0 if is_number else 1, above)


def _built(build: Callable[[], sp.Expr], degree: int, above: int = 1, below: int = 1) -> _Part:
    """Build a part after checking that it is not too large, and check a number."""
    if max(above, below) > _MOST_TERMS:
        raise SymbolicError(f"has more than {_MOST_TERMS} terms, multiplied out")
    if degree > _MOST_DEGREE:
        raise SymbolicError(f"is of a degree above {_MOST_DEGREE}")
    expression = build()
    if not expression.is_number:
        return _Part(expression, above, below, degree)
    number = _double(expression)
    lost = number == 0 and expression != 0
    if not math.isfinite(number) or lost:
        raise SymbolicError("has a number outside the range of doubles")
    if _bits(expression) > _MOST_BITS:
        raise SymbolicError("has a number of too many digits")
    return _Part(expression, above, below, degree, number)


def _bits(expression: sp.Expr) -> int:
    if not isinstance(expression, sp.Rational):
        return 0
    return int(expression.p).bit_length() + int(expression.q).bit_length()


def _double(expression: sp.Expr) -> float:
    """Return the value of a number, or raise SymbolicError if it is not real."""
    try:
        number = complex(expression.evalf())
    except (ArithmeticError, TypeError, ValueError):
        raise SymbolicError("is not an expression: a number in it has no finite value") from None
    if abs(number.imag) > 1e-9 * abs(number):
        raise SymbolicError("is not an expression: a number in it is not real")
    return number.real
