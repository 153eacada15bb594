"""sympy equations as ratios of polynomials; the caller's arguments are checked first.

Each algebraic number in them, such as cos(pi/9) or sqrt(2 + sqrt(2)), is a root of a polynomial
over the field of those before it. Its coefficients are an integer relation between powers, found by
lattice reduction (Lenstra, Lenstra, Lovasz 1982) with far more digits than the relation has, and
confirmed with twice as many.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import inf, prod
from typing import Any

import sympy as sp
from flint import fmpq, fmpq_mpoly, fmpz_mat
from mpmath import mp, mpf
from sympy.core.function import AppliedUndef

from seaid._progress import track
from seaid.errors import SymbolicError
from seaid.symbolic.generators import (
    CIRCULAR,
    bottom_up,
    check_instantaneous,
    expanded_inside,
    find_functions,
    located,
    operands,
    parts,
    prepared,
    root,
    root_bases,
    shortened,
    signed,
    subexpressions,
    times_angle,
    turns,
)
from seaid.symbolic.polynomial import (
    Exponents,
    Ratio,
    Relation,
    Ring,
    exponents_at,
    from_polynomial,
    multiply,
    occurring,
    power,
    product,
    quotient,
    rational,
    total,
)


def declared(
    equations: Any, motion: Any, unknowns: Any
) -> tuple[list[sp.Expr], tuple[sp.Expr, ...], tuple[sp.Symbol, ...]]:
    """Return the three arguments of `separate` as checked sequences."""
    expressions = [scalar("an equation", equation) for equation in listed(equations)]
    signals = tuple(m.expr if isinstance(m, sp.Derivative) else m for m in listed(motion))
    symbols = tuple(listed(unknowns))
    for kind, values in (("equations", expressions), ("motion", signals), ("unknowns", symbols)):
        if not values:
            raise SymbolicError(f"{kind} is empty; give at least one")
    for signal in signals:
        if not isinstance(signal, sp.Symbol | AppliedUndef):
            raise SymbolicError(
                f"motion contains {signal!r}; allowed are functions of time such as "
                "Function('q')(t), and symbols"
            )
    _check_unknowns(symbols, signals)
    _check_names(expressions, (*signals, *symbols))
    return expressions, signals, symbols


def listed(expressions: Any) -> list[Any]:
    """Return one expression, or several in a list, a tuple or a matrix, as a list."""
    several = isinstance(expressions, Iterable | sp.MatrixBase)
    return list(expressions) if several and not isinstance(expressions, str) else [expressions]


def scalar(what: str, value: Any) -> sp.Expr:
    """Return a scalar sympy expression. Raises SymbolicError naming `what` otherwise."""
    try:
        expression = sp.sympify(value, strict=True)
    except sp.SympifyError:
        expression = value
    if isinstance(expression, sp.MatrixBase) and expression.shape == (1, 1):
        expression = expression[0, 0]
    if isinstance(expression, sp.Eq):
        expression = expression.lhs - expression.rhs
    if not isinstance(expression, sp.Expr) or expression.is_Matrix:
        raise SymbolicError(f"{what} must be a scalar sympy expression, found {value!r}")
    return expression


def _check_unknowns(symbols: tuple[sp.Symbol, ...], signals: tuple[sp.Expr, ...]) -> None:
    for place, symbol in enumerate(symbols):
        if not isinstance(symbol, sp.Symbol):
            raise SymbolicError(f"unknowns contains {symbol!r}; allowed are sympy symbols")
        if symbol in symbols[:place]:
            raise SymbolicError(f"the unknown {symbol} is listed twice; list it once")
        if any(signal.has(symbol) for signal in signals):
            raise SymbolicError(
                f"{symbol} is both unknown and known: it is in unknowns and in motion; remove it "
                "from one of them"
            )


def _check_names(expressions: Sequence[sp.Expr], declared: Sequence[sp.Expr]) -> None:
    """Refuse a symbol of the equations with the name, but not the identity, of a declared one."""
    names = {str(x): x for x in declared}
    for number, expression in enumerate(expressions, 1):
        for symbol in subexpressions(expression):
            if not isinstance(symbol, sp.Symbol | AppliedUndef):
                continue
            twin = names.get(str(symbol), symbol)
            if twin != symbol:
                raise SymbolicError(
                    f"equation {number} contains a {symbol} that is not the declared {twin}: they "
                    "share the name but not the assumptions (real, positive ...); create it once "
                    "and use it everywhere"
                )


def without_dependent(
    expressions: Sequence[sp.Expr],
    relations: Any,
    signals: tuple[sp.Expr, ...],
    unknowns: tuple[sp.Symbol, ...],
) -> tuple[list[sp.Expr], list[sp.Expr]]:
    """Return the equations without the signals for which relations can be solved, and the rest.

    The rest are the relations that give no signal, as loop closures, without those signals too.
    """
    equations = list(expressions)
    rest = [prepared(scalar("a relation", relation)) for relation in listed(relations)]
    for relation in rest:
        if relation.free_symbols.intersection(unknowns):
            raise SymbolicError(
                f"the relation {shortened(relation)} = 0 contains an unknown; relations are "
                "between signals, with known constants: give it as an equation"
            )
    while solved := next(filter(None, (_solved(relation, signals) for relation in rest)), None):
        used, rule = solved
        rest.remove(used)
        equations, rest = (
            [prepared(x.xreplace(rule)) for x in several] for several in (equations, rest)
        )
        rest = [relation for relation in rest if sp.expand(relation, trig=True) != 0]
    return equations, rest


def _solved(
    relation: sp.Expr, signals: Sequence[sp.Expr]
) -> tuple[sp.Expr, dict[sp.Expr, sp.Expr]] | None:
    """Return the relation and {signal: its value}, for the last signal that it determines."""
    for signal in reversed(signals):
        # A relation of rates, as of a rolling wheel, does not give the position.
        if any(derivative.expr == signal for derivative in relation.atoms(sp.Derivative)):
            continue
        x = sp.Dummy("x")
        # Linear with a constant slope: signal = -rest / slope.
        inside = relation.xreplace({signal: x})
        slope = sp.expand(inside.diff(x))
        if slope != 0 and not slope.has(x, AppliedUndef, *signals):
            return relation, {signal: sp.expand(-inside.subs(x, 0) / slope)}
    return None


_MOST_POWER = 10**9
"""Largest power of an exponential or a root: exponents in flint are machine words."""

_FEW_TURNS = 4
"""Multiples of an angle up to this are polynomials in its sine and cosine, with short factors;
products of joint rotations have no higher ones."""

Memory = dict[sp.Expr, Ratio]


def read_equations(
    equations: Sequence[sp.Expr],
    motion: tuple[sp.Expr, ...],
    unknowns: tuple[sp.Symbol, ...],
    max_terms: int,
    *,
    closures: Sequence[sp.Expr] = (),
    progress: bool = False,
) -> tuple[Ring, list[Ratio]]:
    """Return the polynomial ring of the equations, and each as a ratio in it, closures last.

    Floats count as the decimals that they represent. Raises SymbolicError, naming equation, term
    and unknown, if an unknown is the argument of a function or if the equations are too large.
    """
    equations = [prepared(equation) for equation in (*equations, *closures)]
    for number, equation in enumerate(equations, 1):
        with located(f"equation {number}"):
            check_instantaneous(equation)
    # A closed loop is solved for sines and cosines of the angles themselves, not of multiples.
    most_turns = inf if closures else _FEW_TURNS
    ring = find_functions(equations, motion, unknowns, max_terms, most_turns)
    _add_relations(ring)
    memory: Memory = {}
    ratios = []
    for number, equation in track(list(enumerate(equations, 1)), "equations read", progress):
        with located(f"equation {number}"):
            ratios.append(_read(ring, equation, memory))
    return _with_inputs(ring, ratios, len(closures)), ratios


def _with_inputs(ring: Ring, equations: Sequence[Ratio], closures: int) -> Ring:
    """Return the ring in which plain symbols that occur as inputs do, such as a torque, are such.

    An input multiplies neither motion, unknown nor another such symbol, and occurs in no function,
    in no denominator and in none of the last equations, the `closures`.
    """
    symbols, acting = _plain_symbols(ring, equations, closures), {*ring.motion, *ring.unknown}
    products = _products(equations)
    for factors, highest in products:
        if factors & acting or highest > 1:
            symbols -= factors
    for factors, _ in products:
        if len(factors & symbols) > 1:
            symbols -= factors
    return replace(
        ring,
        motion=tuple(sorted({*ring.motion, *symbols})),
        known=tuple(sorted({*ring.known} - symbols)),
        moving=ring.moving.union(ring.generators[i] for i in symbols),
    )


def _products(equations: Sequence[Ratio]) -> list[tuple[set[int], int]]:
    """Return the places of the factors of each term of the equations, and its highest exponent."""
    monomials = itertools.chain(*(numerator.monoms() for numerator, _ in equations))
    return [({i for i, e in enumerate(m) if e}, max(m)) for m in monomials]


def _plain_symbols(ring: Ring, equations: Sequence[Ratio], closures: int) -> set[int]:
    """Return the places of the known symbols in no function, no denominator and no closure."""
    functions = [x for x in ring.generators if not x.is_Symbol]
    arguments = set(itertools.chain(*(function.atoms(sp.Symbol) for function in functions)))
    excluded = [denominator for _, denominator in equations]
    excluded += [numerator for numerator, _ in equations[len(equations) - closures :]]
    places = (i for i in ring.known if ring.generators[i].is_Symbol)
    symbols = {i for i in places if ring.generators[i] not in arguments}
    return symbols.difference(*map(occurring, excluded))


def _add_relations(ring: Ring) -> None:
    """Add the ring's relations, lowest generator first, because each uses those below it."""
    numbers = {relation.generator: relation for relation in algebraic_relations(ring)}
    roots = {root(x, unit): (x, unit) for x, unit in ring.units["root"].items()}
    for place in reversed(range(len(ring.generators))):
        expression, x = ring.generators[place], ring.context.gen(place)
        degree = 2
        if place in numbers:
            ring.relations.insert(0, numbers[place])
            continue
        if expression in roots:
            base, degree = roots[expression][0], int(roots[expression][1])
            below = _read(ring, base, {})
            if not below.denominator.is_one():
                continue
            polynomial = x**degree - below.numerator
        elif isinstance(expression, sp.sign):
            polynomial = x**2 - 1
        elif isinstance(expression, sp.sin):
            polynomial = x**2 + ring.generator(sp.cos(expression.args[0])) ** 2 - 1
        else:
            continue
        ring.relations.insert(0, Relation(place, degree, polynomial))


def _read(ring: Ring, expression: sp.Expr, memory: Memory) -> Ratio:
    """Return an expression as a ratio; `memory` keeps the subexpressions that were read."""

    def needed(part: sp.Expr) -> tuple[sp.Expr, ...]:
        return () if part in ring.index else operands(part)

    for part in bottom_up(expression, memory, needed):
        memory[part] = _read_part(ring, part, memory)
    return memory[expression]


def _read_part(ring: Ring, expression: sp.Expr, memory: Memory) -> Ratio:
    """Read an expression whose operands are in `memory`."""
    if expression in ring.index:
        return from_polynomial(ring, ring.generator(expression))
    if expression.is_Rational:
        return from_polynomial(ring, ring.constant(rational(expression)))
    if expression.is_Add:
        return total(ring, (memory[part] for part in expression.args))
    if expression.is_Mul:
        result = from_polynomial(ring, ring.constant(1))
        for part in expression.args:
            result = product(ring, result, memory[part])
        return result
    if operands(expression):
        return power(ring, memory[expression.base], int(expression.exp))
    return _read_function(ring, expression, memory)


def _read_function(ring: Ring, function: sp.Expr, memory: Memory) -> Ratio:
    if isinstance(function, CIRCULAR):
        return _read_circular(ring, function, memory)
    if isinstance(function, sp.exp):
        units = ring.units["exponent"]
        factors = parts(function.args[0])
        return _powers(ring, [(sp.exp(x / units[x]), times * units[x]) for x, times in factors])
    if isinstance(function, sp.Abs | sp.sign):
        turned, argument = signed(function.args[0])
        # |x| = sign(x) x; sign(x) is that of x over a positive number, or of its negative.
        sign = from_polynomial(ring, turned * ring.generator(sp.sign(argument)))
        if isinstance(function, sp.sign):
            return sign
        return product(ring, sign, _read(ring, sp.expand(function.args[0]), memory))
    if function.is_Pow and function.exp.is_Rational:
        units, bases = ring.units["root"], root_bases(function.base)
        return _powers(
            ring,
            [(root(x, units[x]), function.exp * times * units[x]) for x, times in bases.items()],
        )
    return from_polynomial(ring, ring.generator(expanded_inside(function)))


def _powers(ring: Ring, factors: list[tuple[sp.Expr, sp.Rational]]) -> Ratio:
    result = from_polynomial(ring, ring.constant(1))
    for generator, exponent in factors:
        if abs(exponent) > _MOST_POWER:
            raise SymbolicError(
                f"found {generator} to the power {exponent}; up to {_MOST_POWER} are allowed; give "
                "it as a signal of its own"
            )
        base = from_polynomial(ring, ring.generator(generator))
        result = product(ring, result, power(ring, base, int(exponent)))
    return result


def _read_circular(ring: Ring, function: sp.Expr, memory: Memory) -> Ratio:
    """Read sin, cos, tan ... of a sum from de Moivre's product of (cos x_k + i sin x_k)."""
    pair = (ring.constant(1), ring.constant(0))
    for turn in turns(function.args[0]):
        cosine, sine = (_read(ring, f(turn), memory).numerator for f in (sp.cos, sp.sin))
        pair = _turned(ring, pair, (cosine, sine))
    for part, factor in parts(function.args[0]):
        angle, times = times_angle(part, factor, ring.units["angle"][part], ring.most_turns)
        cosine, sine = (ring.generator(f(angle)) for f in (sp.cos, sp.sin))
        step = (cosine, sine if times > 0 else -sine)
        pair = _turned(ring, pair, _times(ring, step, abs(times)))
    c, s, unity = (from_polynomial(ring, x) for x in (*pair, ring.constant(1)))
    above, below = {
        sp.sin: (s, unity),
        sp.cos: (c, unity),
        sp.tan: (s, c),
        sp.cot: (c, s),
        sp.sec: (unity, c),
        sp.csc: (unity, s),
    }[function.func]
    return quotient(ring, above, below)


Pair = tuple[fmpq_mpoly, fmpq_mpoly]


def _turned(ring: Ring, first: Pair, second: Pair) -> Pair:
    """Return cosine and sine of the sum of two angles."""
    (c, s), (d, t) = first, second
    return (
        multiply(ring, c, d) - multiply(ring, s, t),
        multiply(ring, s, d) + multiply(ring, c, t),
    )


def _times(ring: Ring, step: Pair, times: int) -> Pair:
    """Return cosine and sine of a multiple of an angle, by repeated doubling."""
    if times == 0:
        return ring.constant(1), ring.constant(0)
    half = _times(ring, step, times // 2)
    even = _turned(ring, half, half)
    return _turned(ring, even, step) if times % 2 else even


MOST_DEGREES = 40
"""Largest degree of the field of all numbers; beyond it only sin^2 = 1 - cos^2 is used."""

_DIGITS_PER_TERM = 30
"""A chance relation has coefficients of about this many digits, a true one at most half."""


def algebraic_relations(ring: Ring) -> list[Relation]:
    """Return the relations of the ring's algebraic numbers, the lowest generator first.

    Empty if the numbers are roots of integers only, which are independent as they are, or if their
    field is too large.
    """
    places = [i for i in reversed(ring.known) if _is_algebraic(ring.generators[i])]
    numbers = [ring.generators[i] for i in places]
    if all(x.is_Pow and x.base.is_Integer for x in numbers):
        return []
    relations: list[Relation] = []
    degrees: list[int] = []
    for place in places:
        relation = _relation(ring, places[: len(degrees)], degrees, place)
        if relation is None:
            return []
        relations.append(relation)
        degrees.append(relation.degree)
    return relations


def _is_algebraic(number: sp.Expr) -> bool:
    return bool(number.is_number and number.is_algebraic and not number.is_Rational)


def _relation(
    ring: Ring, below: Sequence[int], degrees: Sequence[int], place: int
) -> Relation | None:
    """Return the relation of least degree of a number over the field of those `below`."""
    size = prod(degrees)
    least = 1 if degrees else _degree(ring.generators[place])
    for degree in range(least, MOST_DEGREES // size + 1):
        powers = itertools.product(*map(range, (*degrees, degree)))
        terms = [exponents_at(ring, (*below, place), exponents) for exponents in powers]
        terms.append(exponents_at(ring, (place,), (degree,)))
        factors = _integer_relation(ring, terms)
        if factors is not None:
            # Divided by the factor of the highest power: that is the leading term.
            whole = {term: fmpq(x, factors[-1]) for term, x in zip(terms, factors, strict=True)}
            return Relation(place, degree, ring.context.from_dict(whole))
    return None


def _degree(number: sp.Expr) -> int:
    """Return the degree of cos(p pi / q), half that of the root of unity; 1 for other numbers."""
    if not isinstance(number, sp.cos):
        return 1
    turn = number.args[0] / (2 * sp.pi)
    return int(sp.totient(turn.q)) // 2 if turn.is_Rational else 1


def _integer_relation(ring: Ring, terms: Sequence[Exponents]) -> list[int] | None:
    """Return integers with which the terms add up to zero, the last of them not zero, or None."""
    digits = 100 + _DIGITS_PER_TERM * len(terms)
    with mp.workdps(2 * digits + 50):
        values = [_value(ring, term) for term in terms]
        # A short vector of the lattice (1, value 10^digits) is an integer relation of values.
        lattice = [
            [*(int(i == j) for j in range(len(terms))), int(mp.nint(value * mpf(10) ** digits))]
            for i, value in enumerate(values)
        ]
        shortest = [int(x) for x in fmpz_mat(lattice).lll().tolist()[0]][:-1]
        error = abs(mp.fdot(shortest, values))
        is_short = max(map(abs, shortest)) < 10 ** (_DIGITS_PER_TERM // 2)
        return shortest if is_short and shortest[-1] and error < mpf(10) ** (-2 * digits) else None


def _value(ring: Ring, term: Exponents) -> mpf:
    parts = ((ring.generators[i], times) for i, times in enumerate(term) if times)
    return mp.fprod(mp.mpmathify(x.evalf(mp.dps)) ** times for x, times in parts)
