"""The functions that occur in equations, as generators of their polynomial ring.

Arguments of sin, cos and exp are split at their sums: sin(q1 + 2 q2) needs sin q1, cos q1, sin q2
and cos q2. |x| needs sign(x). Any other function is a generator of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from decimal import Decimal
from math import lcm

import sympy as sp
from flint import fmpq_mpoly_ctx
from sympy.core.function import AppliedUndef

from seaid.errors import SymbolicError
from seaid.symbolic.polynomial import Ring

_LONGEST_TEXT = 200
"""Characters of an expression in a message."""

_LARGEST_PRIME = 10**6
"""Factors of the base of a root are sought up to this size: all prime factors of a large number
would take too long."""

CIRCULAR = (sp.sin, sp.cos, sp.tan, sp.cot, sp.sec, sp.csc)


@dataclass(frozen=True, eq=False)
class _Scan:
    """The caller's declarations, and the functions found so far in the equations."""

    motion: tuple[sp.Expr, ...]
    unknowns: tuple[sp.Symbol, ...]
    time: frozenset[sp.Symbol]
    most_turns: float
    angles: set[tuple[sp.Expr, sp.Rational]] = field(default_factory=set)
    plain: dict[sp.Expr, None] = field(default_factory=dict)
    signs: dict[sp.Expr, None] = field(default_factory=dict)
    units: dict[str, dict[sp.Expr, sp.Rational]] = field(
        default_factory=lambda: {"angle": {}, "exponent": {}, "root": {}}
    )
    seen: set[sp.Expr] = field(default_factory=set)


@contextmanager
def located(place: str, detail: object = None) -> Iterator[None]:
    """Prefix the message of a SymbolicError raised inside with `place` and `detail`."""
    try:
        yield
    except SymbolicError as problem:
        if detail is not None:
            place = f"{place} {shortened(detail)}"
        raise problem.at(place) from None


def shortened(expression: object) -> str:
    """Return an expression as text, cut to the length of a message."""
    text = str(expression)
    return text if len(text) <= _LONGEST_TEXT else text[: _LONGEST_TEXT - 4] + " ..."


def find_functions(
    equations: Sequence[sp.Expr],
    motion: tuple[sp.Expr, ...],
    unknowns: tuple[sp.Symbol, ...],
    max_terms: int,
    most_turns: float,
) -> Ring:
    """Return the ring of the functions and symbols in the equations, without relations yet.

    Raises SymbolicError, naming equation, term and unknown, if an unknown is the argument of a
    function.
    """
    time = time_symbols(subexpressions(*equations), motion)
    scan = _Scan(motion, unknowns, time, most_turns)
    for number, equation in enumerate(equations, 1):
        for term in sp.Add.make_args(equation):
            with located(f"equation {number}, term", term):
                _visit(scan, term)
    return _ring(scan, max_terms)


def subexpressions(*expressions: sp.Basic) -> set[sp.Basic]:
    """Return the set of all subexpressions; shared ones are visited once."""
    parts: set[sp.Basic] = set()
    waiting = list(expressions)
    while waiting:
        part = waiting.pop()
        if part not in parts:
            parts.add(part)
            waiting += part.args
    return parts


def prepared(expression: sp.Expr) -> sp.Expr:
    """Evaluate derivatives of composite expressions, and read floats as decimals."""
    parts = subexpressions(expression)
    composite = {
        part: part.doit()
        for part in parts
        if isinstance(part, sp.Derivative) and not isinstance(part.expr, AppliedUndef)
    }
    if composite:
        expression = expression.xreplace(composite)
        parts = subexpressions(expression)
    return expression.xreplace({x: _decimal(x) for x in parts if x.is_Float})


_SHORT_DIGITS = 12
"""A decimal of at most this many digits within float noise is the number that was meant: 0.28**2
is 0.0784 and not 0.07840000000000001. By chance that is so for one number in a thousand."""


def _decimal(number: sp.Float) -> sp.Rational:
    """Return the decimal that a float represents: a short one within noise, or the shortest."""
    # A float of more digits than a double was written with them: all of them count.
    if number._prec > _DOUBLE_BITS:
        return sp.Rational(str(number))
    near = Decimal(f"{float(number):.15g}")
    short = len(near.normalize().as_tuple().digits) <= _SHORT_DIGITS
    return sp.Rational(str(near) if short else repr(float(number)))


_DOUBLE_BITS = 53
"""Bits of the mantissa of a double."""

_COMPLEX = (sp.re, sp.im, sp.conjugate, sp.arg)
_NO_INSTANT = (sp.Integral, sp.Sum, sp.Product, sp.Limit)


def check_instantaneous(expression: sp.Expr) -> None:
    """Refuse complex numbers, and integrals, which have no value at an instant."""
    parts = subexpressions(expression)
    unreal = [x for x in parts if x == sp.I or isinstance(x, _COMPLEX) or _is_unreal(x)]
    if unreal:
        raise SymbolicError(
            f"found {min(map(str, unreal))}; only real equations are allowed: write sines and "
            "cosines instead of exp(I x), and make the symbols real"
        )
    summed = [str(x) for x in parts if isinstance(x, _NO_INSTANT)]
    if summed:
        raise SymbolicError(
            f"found {min(summed)}, which has no value at an instant of the motion; give it as a "
            "signal of its own, such as Function('x')(t) in motion"
        )


def _is_unreal(expression: sp.Basic) -> bool:
    return bool(expression.is_Symbol and expression.is_extended_real is False)


def time_symbols(parts: set[sp.Basic], motion: tuple[sp.Expr, ...]) -> frozenset[sp.Symbol]:
    """Return the time symbols: arguments of the declared signals, and any symbol named t."""
    declared = {s for m in motion if isinstance(m, AppliedUndef) for s in m.free_symbols}
    named = {s for s in parts if s.is_Symbol and s.name == "t" and s not in motion}
    return frozenset(declared | named)


def bottom_up(
    expression: sp.Expr, known: Container[sp.Expr], operands: Callable[[sp.Expr], Iterable[sp.Expr]]
) -> Iterator[sp.Expr]:
    """Yield subexpressions not in `known`, operands first; the caller adds each to `known`."""
    waiting = [expression]
    while waiting:
        missing = [part for part in operands(waiting[-1]) if part not in known]
        if missing:
            waiting += missing
        else:
            part = waiting.pop()
            if part not in known:
                yield part


def operands(expression: sp.Expr) -> tuple[sp.Expr, ...]:
    """Return the operands of a sum, a product or an integer power; none for anything else."""
    if expression.is_Add or expression.is_Mul:
        return tuple(expression.args)
    if expression.is_Pow and expression.exp.is_Integer:
        return (expression.base,)
    return ()


def _visit(scan: _Scan, expression: sp.Expr) -> None:
    """Record every function and symbol of the expression in `scan`."""
    for part in bottom_up(expression, scan.seen, operands):
        scan.seen.add(part)
        if part.is_Rational or operands(part):
            continue
        if part.is_Symbol or isinstance(part, sp.NumberSymbol):
            scan.plain[part] = None
        elif part.is_number and not part.is_real:
            raise SymbolicError(f"found {part}; only finite real numbers are allowed")
        else:
            _visit_function(scan, part)


def _visit_function(scan: _Scan, function: sp.Expr) -> None:
    inside = sorted(function.free_symbols.intersection(scan.unknowns), key=scan.unknowns.index)
    if inside and not _is_phase(scan, function):
        raise SymbolicError(
            f"the unknown {inside[0]} is inside {function}, so the equation is not linear in any "
            f"product of unknowns; make {inside[0]} known, or name the whole function as one "
            "unknown"
        )
    if isinstance(function, CIRCULAR):
        scan.angles.update(parts(function.args[0]))
        _note_units(scan.units["angle"], parts(function.args[0]), least=False)
        # Sines and cosines of these are square roots in sympy, whose bases are recorded.
        for turn in turns(function.args[0]):
            _visit(scan, sp.cos(turn))
            _visit(scan, sp.sin(turn))
    elif isinstance(function, sp.exp):
        _note_units(scan.units["exponent"], parts(function.args[0]), least=True)
    elif isinstance(function, sp.Abs | sp.sign):
        argument = signed(function.args[0])[1]
        scan.signs[argument] = None
        _visit(scan, argument)
    elif function.is_Pow and function.exp.is_Rational:
        for base in root_bases(function.base):
            # The common root: a^(1/2) and a^(1/3) are powers of a^(1/6).
            unit = int(scan.units["root"].get(base, 1))
            scan.units["root"][base] = sp.Integer(lcm(unit, int(function.exp.q)))
            _visit(scan, base)
    else:
        scan.plain[expanded_inside(function)] = None


def _is_phase(scan: _Scan, function: sp.Expr) -> bool:
    """Whether this is a sine or cosine of a sum in which the unknowns are terms: sin(q + phi)."""
    unknowns = set(scan.unknowns)
    return isinstance(function, CIRCULAR) and all(
        part in unknowns or not part.free_symbols & unknowns for part, _ in parts(function.args[0])
    )


def _note_units(
    units: dict[sp.Expr, sp.Rational], factors: list[tuple[sp.Expr, sp.Rational]], *, least: bool
) -> None:
    """Extend the divisors in `units`, of which the rational factors of the parts are multiples.

    They are common denominators or, for numbers and if `least`, the largest that are possible:
    cos(173 pi / 1800) and exp(10^12 x) stay what they are.
    """
    for part, factor in factors:
        if part.is_number or least:
            # 1 / unit is the gcd of the factors: they are whole multiples of it.
            units[part] = 1 / sp.gcd(1 / units[part] if part in units else 0, factor)
        else:
            units[part] = sp.Integer(lcm(int(units.get(part, 1)), int(factor.q)))


def parts(argument: sp.Expr) -> list[tuple[sp.Expr, sp.Rational]]:
    """Split the argument of a function at its sum: [(term, rational factor)]."""
    parts = sp.expand(argument).as_coefficients_dict().items()
    return [(part, factor) for part, factor in parts if not _is_turn(part * factor)]


def times_angle(
    part: sp.Expr, factor: sp.Rational, unit: sp.Rational, most_turns: float
) -> tuple[sp.Expr, int]:
    """Return (angle, times) of a term of an argument: its sine and cosine are those of the angle.

    sin(84 q) is a polynomial of degree 84 in sin q and cos q, with 25 digits in its coefficients,
    which cancel when it is evaluated. So a large multiple of an angle is an angle of its own.
    """
    times = factor * unit
    if abs(times) <= most_turns:
        return part / unit, int(times)
    return part * abs(factor), int(sp.sign(factor))


def turns(argument: sp.Expr) -> list[sp.Expr]:
    """Return the fractions of pi in a sum whose sine and cosine sympy knows in square roots."""
    parts = sp.expand(argument).as_coefficients_dict().items()
    return [part * factor for part, factor in parts if _is_turn(part * factor)]


def _is_turn(angle: sp.Expr) -> bool:
    return bool(angle.is_number) and not sp.cos(angle).has(*CIRCULAR)


def root_bases(base: sp.Expr) -> dict[sp.Expr, int]:
    """Return {factor: power} of the base of a root; roots of different primes are independent."""
    if not base.is_Integer:
        return {base: 1}
    return {sp.Integer(p): int(n) for p, n in sp.factorint(base, limit=_LARGEST_PRIME).items()}


def signed(argument: sp.Expr) -> tuple[int, sp.Expr]:
    """Return (sign, expression) so that sign(x), sign(2 x) and sign(-x) share the expression."""
    argument = sp.expand(argument).primitive()[1]
    return (-1, -argument) if argument.could_extract_minus_sign() else (1, argument)


def expanded_inside(function: sp.Expr) -> sp.Expr:
    """Return a function with expanded arguments, so that equal ones compare equal."""
    if isinstance(function, AppliedUndef | sp.Derivative):
        return function
    return function.func(*(sp.expand(a) if isinstance(a, sp.Expr) else a for a in function.args))


def _ring(scan: _Scan, max_terms: int) -> Ring:
    order = _generators(scan)
    kinds = [_kind(scan, x) for x in order]
    places = {
        kind: tuple(i for i, k in enumerate(kinds) if k == kind)
        for kind in ("motion", "unknown", "known")
    }
    return Ring(
        context=fmpq_mpoly_ctx.get([f"x{i}" for i in range(len(order))], "lex"),
        generators=order,
        motion=places["motion"],
        unknown=places["unknown"],
        known=places["known"],
        undeclared=tuple(i for i in places["motion"] if _undeclared(scan, order[i])),
        moving=scan.time.union(x for x in scan.motion if x.is_Symbol),
        units=scan.units,
        max_terms=max_terms,
        most_turns=scan.most_turns,
    )


def _generators(scan: _Scan) -> tuple[sp.Expr, ...]:
    """Order the generators so that the leading term of every relation is the eliminated one."""
    roots = {root(base, unit): base for base, unit in scan.units["root"].items()}
    units = scan.units["angle"]
    turned = {times_angle(x, factor, units[x], scan.most_turns)[0] for x, factor in scan.angles}
    divided = (part / unit for part, unit in scan.units["exponent"].items())
    angles, exponents = (sorted(x, key=sp.default_sort_key) for x in (turned, divided))
    order = [
        *sorted(roots, key=lambda x: (-roots[x].count_ops(), sp.default_sort_key(x))),
        *sorted(map(sp.sign, scan.signs), key=sp.default_sort_key),
        *map(sp.sin, angles),
        *map(sp.cos, angles),
        *map(sp.exp, exponents),
        *sorted(scan.plain, key=_plain_key(scan)),
    ]
    return tuple(dict.fromkeys(order))


def root(base: sp.Expr, unit: sp.Integer) -> sp.Expr:
    """Return base^(1/unit), the generator whose powers are all roots of `base`."""
    return sp.Pow(base, sp.Rational(1, unit))


def _plain_key(scan: _Scan) -> Callable[[sp.Expr], tuple[object, ...]]:
    """Return the sort key: signals as declared, each before its derivatives; unknowns; names."""
    place = {x: i for i, x in enumerate((*scan.motion, *scan.unknowns))}

    def key(x: sp.Expr) -> tuple[object, ...]:
        signal, order = (x.expr, x.derivative_count) if isinstance(x, sp.Derivative) else (x, 0)
        return place.get(signal, len(place)), sp.default_sort_key(signal), order

    return key


def _kind(scan: _Scan, generator: sp.Expr) -> str:
    """Return "motion", "unknown" or "known"."""
    free = generator.free_symbols
    if free.intersection(scan.unknowns):
        return "unknown"
    return "motion" if free & scan.time or free.intersection(scan.motion) else "known"


def _undeclared(scan: _Scan, generator: sp.Expr) -> bool:
    """Whether a generator contains a function of time that is not in `motion`."""
    return any(
        signal not in scan.motion and scan.time.intersection(signal.args)
        for signal in generator.atoms(AppliedUndef)
    )
