"""A straight-line program: named sums of products of numbers and names, in the order of evaluation.

Common subexpressions have one name each. Coefficients are rationals until text is made of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import fmpq

from seaid.arrays import Array

Value = Mapping[tuple[str, ...], fmpq]
"""A sum: {sorted names of the factors: coefficient}; {} is zero."""

ZERO: Value = {}


@dataclass(frozen=True, eq=False)
class Program:
    """Steps {name: value}, each from names before it; `circular` are {name: ('sin', 'q1')}."""

    circular: dict[str, tuple[str, str]] = field(default_factory=dict)
    steps: dict[str, Value] = field(default_factory=dict)
    known: dict[frozenset[tuple[tuple[str, ...], fmpq]], str] = field(default_factory=dict)


def constant(number: Any) -> Value:
    """Return a number as a value."""
    return {(): fmpq(number)} if number != 0 else {}


def name(text: str) -> Value:
    """Return a name as a value."""
    return {(text,): fmpq(1)}


def plus(*values: Value) -> Value:
    """Return the sum."""
    total: dict[tuple[str, ...], fmpq] = {}
    for value in values:
        for factors, x in value.items():
            total[factors] = total.get(factors, 0) + x
    return {factors: x for factors, x in total.items() if x != 0}


def times(left: Value, right: Value) -> Value:
    """Return the product."""
    products = ({tuple(sorted(f + g)): x * y} for f, x in left.items() for g, y in right.items())
    return plus(*products)


def scaled(number: Any, value: Value) -> Value:
    """Return number * value."""
    return {factors: number * x for factors, x in value.items()} if number != 0 else {}


def dot(left: Iterable[Value], right: Iterable[Value]) -> Value:
    """Return the sum of the products."""
    return plus(*(times(x, y) for x, y in zip(left, right, strict=True)))


def cross(left: Sequence[Value], right: Sequence[Value]) -> list[Value]:
    """Return the vector product of two triples."""
    return [
        plus(times(left[j], right[k]), scaled(-1, times(left[k], right[j])))
        for j, k in ((1, 2), (2, 0), (0, 1))
    ]


def combined(matrix: Sequence[Sequence[Any]], vector: Sequence[Value]) -> list[Value]:
    """Return matrix @ vector for a matrix of numbers."""
    return [
        plus(*(scaled(x, value) for x, value in zip(row, vector, strict=True))) for row in matrix
    ]


def named(program: Program, values: Iterable[Value]) -> list[Value]:
    """Name each value that is more than a number times a name; equal ones share a name."""
    return [_named(program, value) for value in values]


def _named(program: Program, value: Value) -> Value:
    if not value or (len(value) == 1 and len(next(iter(value))) < 2):
        return value
    found = program.known.get(frozenset(value.items()))
    if found is not None:
        return name(found)
    opposite = program.known.get(frozenset(scaled(-1, value).items()))
    if opposite is not None:
        return scaled(-1, name(opposite))
    text = f"x{len(program.steps)}"
    program.steps[text] = value
    program.known[frozenset(value.items())] = text
    return name(text)


def needed(program: Program, values: Iterable[Value]) -> set[str]:
    """Return the names that the values need, directly or through others."""
    found = {factor for value in values for factors in value for factor in factors}
    for text in reversed(program.steps):
        if text in found:
            found.update(factor for factors in program.steps[text] for factor in factors)
    found.update(argument for text, (_, argument) in program.circular.items() if text in found)
    return found


_Terms = tuple[tuple[float, tuple[str, ...]], ...]


@dataclass(frozen=True, eq=False)
class Numeric:
    """What entries {place: value} need of a program, with doubles as coefficients."""

    circular: tuple[tuple[str, str, str], ...]
    steps: tuple[tuple[str, _Terms], ...]
    entries: tuple[tuple[tuple[int, int], _Terms], ...]

    def evaluate(self, motion: Mapping[str, Array]) -> Iterator[tuple[tuple[int, int], Any]]:
        """Yield places and their values (T,) along `motion` {name: (T,)}.

        Bit by bit those of the program's text.
        """
        known: dict[str, Any] = dict(motion)
        for text, function, argument in self.circular:
            known[text] = _CIRCULAR[function](motion[argument])
        for text, terms in self.steps:
            known[text] = _sum_of(terms, known)
        for place, terms in self.entries:
            yield place, _sum_of(terms, known)


def numeric(program: Program, entries: Mapping[tuple[int, int], Value]) -> Numeric:
    """Return what the entries need of a program, for numbers."""
    used = needed(program, entries.values())
    return Numeric(
        tuple((text, *call) for text, call in program.circular.items() if text in used),
        tuple((text, _terms(value)) for text, value in program.steps.items() if text in used),
        tuple((place, _terms(value)) for place, value in entries.items()),
    )


_CIRCULAR: dict[str, Callable[[Array], Array]] = {"sin": np.sin, "cos": np.cos}


def _terms(value: Value) -> _Terms:
    return tuple((int(x.p) / int(x.q), factors) for factors, x in value.items())


def _sum_of(terms: _Terms, known: Mapping[str, Any]) -> Any:
    total: Any = 0.0
    for x, factors in terms:
        product: Any = x
        for factor in factors:
            product = product * known[factor]
        total = total + product
    return total


def text_of(value: Value, number: Callable[[fmpq], str]) -> str:
    """Return a value as an expression that Python and C read alike."""
    text = ""
    for factors, x in value.items():
        sign = ("-" if x < 0 else "") if not text else (" - " if x < 0 else " + ")
        size = [] if abs(x) == 1 and factors else [number(abs(x))]
        text += sign + "*".join([*size, *factors])
    return text or number(fmpq(0))
