"""Base columns of equations whose signals satisfy loop closures, such as those of a four-bar.

The columns are judged where the motion can be: at random points that satisfy the closures and their
derivatives, modulo a prime. There sines, cosines and roots are algebraic numbers, and a rank is
exact. The factors of dependent columns are interpolated as quotients of polynomials in the known
symbols, and confirmed at further points.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import chain, combinations_with_replacement, islice, repeat
from math import prod
from typing import Any

import sympy as sp
from flint import (
    fmpq,
    fmpz_mod_ctx,
    fmpz_mod_mat,
    fmpz_mod_mpoly,
    fmpz_mod_mpoly_ctx,
    fmpz_mod_poly_ctx,
)
from sympy.core.function import AppliedUndef

from seaid.errors import SymbolicError
from seaid.symbolic.generators import root, subexpressions
from seaid.symbolic.polynomial import (
    Exponents,
    Ratio,
    Relation,
    Ring,
    connected,
    exponents_at,
    from_polynomial,
    occurring,
    ratio,
)

Values = dict[int, int]
"""{place of a generator: its value modulo the prime}."""

Factors = dict[tuple[int, int], int]
"""{(row of the echelon form, dependent column): factor modulo the prime}."""

_LARGEST_PRIME = 2**127 - 1
"""A Mersenne prime, from which smaller primes are tried if numbers such as sqrt(3) are not in its
field: so large that a random residue is zero by chance with odds of 2^-127."""

_LONGEST = 2**48
"""Rational factors are accepted up to this size; a random residue is one with odds of 2^-30."""

_MORE_ROWS, _DRAWS, _MOST_DRAWS = 6, 60, 400
"""Rows or samples beyond the unknowns, which confirm a result; random places at which motions are
counted; most draws for one that satisfies the relations."""

_MOST_TERMS = 300
"""Coefficients of a quotient of polynomials up to which a factor is interpolated."""

_MOST_MOTIONS = 1.5
"""The mean number of solutions per random place is the number of components of the variety: one,
with a standard deviation of 1 / sqrt(_DRAWS)."""

_POLYNOMIALS: Any = fmpz_mod_poly_ctx  # the stubs of flint are narrower than flint
_RINGS: Any = fmpz_mod_mpoly_ctx


def prolonged(
    relations: Sequence[sp.Expr], equations: Sequence[sp.Expr], signals: Sequence[sp.Expr]
) -> list[sp.Expr]:
    """Return the relations with their derivatives, up to the order of those in the equations."""
    if not relations:
        return []
    time = {s for x in signals if isinstance(x, AppliedUndef) for s in x.free_symbols}
    highest, result = _order(subexpressions(*relations, *equations)), []
    for relation in relations:
        for _ in range(highest - _order(subexpressions(relation)) + 1):
            result.append(relation)
            relation = sp.Add(*(relation.diff(t) for t in time))
    return [relation for relation in result if relation != 0]


def _order(expressions: Iterable[sp.Basic]) -> int:
    """Return the highest order of the derivatives among expressions."""
    derivatives = (x for x in expressions if isinstance(x, sp.Derivative))
    return max((int(derivative.derivative_count) for derivative in derivatives), default=0)


def check_closures(ring: Ring, closures: Sequence[Any], relations: Sequence[sp.Expr]) -> None:
    """Refuse closures without signals, and with functions that are not algebraic."""
    roots = {root(base, unit) for base, unit in ring.units["root"].items()}
    related = {ring.generators[relation.generator] for relation in ring.relations}
    for closure, relation in zip(closures, relations, strict=True):
        places = occurring(closure)
        if set(ring.motion).isdisjoint(places):
            raise SymbolicError(f"the relation {relation} = 0 contains no signal of motion")
        for place in places:
            x = ring.generators[place]
            allowed = sp.Symbol | AppliedUndef | sp.Derivative | sp.sin | sp.cos
            is_number = isinstance(x, sp.NumberSymbol) or x in related
            if not (is_number if x.is_number else isinstance(x, allowed) or x in roots):
                raise SymbolicError(
                    f"the relation {relation} = 0 contains {x} and cannot be solved for a signal; "
                    "allowed are signals, their sines, cosines and roots, known symbols, and "
                    "algebraic numbers: give any other function as a signal, and any other number "
                    "as a symbol"
                )


def base_columns(
    ring: Ring,
    functions: Sequence[tuple[sp.Expr, Exponents]],
    rows: Sequence[Sequence[Mapping[int, Ratio]]],
    closures: Sequence[Any],
    width: int,
) -> tuple[list[dict[int, Ratio]], tuple[int, ...]]:
    """Return the rows of the echelon form (13) on motions that satisfy closures, and its pivots.

    `rows[i][k]` is the row of B of equation i and function k.
    """
    table = [
        [(motion, row) for (_, motion), row in zip(functions, several, strict=True) if row]
        for several in rows
    ]
    loops = _loops(ring, table, tuple(closures), width)
    base = loops.known()
    pivots, entries = loops.echelon(base, loops.check_one_motion(base))
    # A factor depends on a known symbol exactly if it changes when this symbol alone is drawn
    # again; algebraic numbers always count, since the new value may be the same conjugate.
    groups = loops.known_groups()
    changes = [(group, loops.echelon(loops.known(base, group))[1]) for group in groups]
    unity = from_polynomial(ring, ring.constant(1))
    echelon = [{pivot: unity} for pivot in pivots]
    for key, value in entries.items():
        acting = (
            group
            for group, factors in changes
            if factors.get(key) != value or ring.generators[group[0]].is_number
        )
        echelon[key[0]][key[1]] = _interpolated(loops, list(chain(*acting)), key)
    return echelon, pivots


_Table = list[list[tuple[Exponents, Mapping[int, Ratio]]]]


def _loops(ring: Ring, table: _Table, closures: tuple[Any, ...], width: int) -> _Loops:
    """Return the loops modulo a prime in whose field the polynomials of all numbers split.

    There sqrt(3) is a residue with two signs, of which neither is the positive one.
    """
    prime, relations = _LARGEST_PRIME, _number_relations(ring)
    places = {i for relation in relations for i in occurring(relation.polynomial)}
    conjugates = prod(relation.degree for relation in relations)
    for _ in range(_MOST_DRAWS):
        loops = _Loops(ring, table, closures, width, prime, conjugates)
        roots = _solutions(loops, [loops.modular(relation.polynomial) for relation in relations])
        # numbers of a field that is too large are related by sin^2 + cos^2 = 1 only
        if len(roots) >= (conjugates if len(places) == len(relations) else 1):
            return loops
        prime = sp.prevprime(prime)
    names = ", ".join(str(ring.generators[i]) for i in sorted(places))
    raise SymbolicError(f"with a closed loop, {names} cannot be kept; give it as a symbol")


def _number_relations(ring: Ring) -> list[Relation]:
    """Return the relations of the numbers in a ring, such as sqrt(3)^2 = 3."""
    return [r for r in ring.relations if ring.generators[r.generator].is_number]


@dataclass(eq=False)
class _Loops:
    """The variety of the motions that satisfy closures, and the rows of the regressor on it."""

    ring: Ring
    table: _Table
    closures: tuple[Any, ...]
    width: int
    prime: int
    conjugates: int
    draw: random.Random = field(default_factory=lambda: random.Random(1))
    samples: list[tuple[Values, Factors]] = field(default_factory=list)

    @cached_property
    def context(self) -> Any:
        names = [f"x{i}" for i in range(len(self.ring.generators))]
        return _RINGS.get(names, self.prime, "lex")

    @cached_property
    def levels(self) -> list[list[fmpz_mod_mpoly]]:
        """The polynomials that are zero, by the order of the derivatives that they contain."""
        generators = self.ring.generators
        # Signs are drawn in `_with_rates` and known symbols in `known`: neither is solved for.
        free = {i for i, x in enumerate(generators) if isinstance(x, sp.sign)}
        known = set(self.ring.known)
        relations = [r.polynomial for r in self.ring.relations if r.generator not in free | known]
        levels: dict[int, list[fmpz_mod_mpoly]] = {}
        for p in (*relations, *self.closures):
            level = _order(generators[i] for i in occurring(p))
            levels.setdefault(level, []).append(self.modular(p))
        return [levels.get(level, []) for level in range(max(levels) + 1)]

    def modular(self, polynomial: Any) -> Any:
        terms = polynomial.to_dict().items()
        return self.context.from_dict({m: self.residue(x) for m, x in terms})

    def residue(self, number: fmpq) -> int:
        return int(number.p) * pow(int(number.q), -1, self.prime) % self.prime

    def known_groups(self) -> list[list[int]]:
        """Return the known generators that occur, those that a relation couples together."""
        ratios = chain(*(line.values() for row in self.table for _, line in row))
        polynomials = [*self.closures, *chain(*ratios)]
        places = {i for p in polynomials for i in occurring(p)} & set(self.ring.known)
        related = [occurring(relation.polynomial) for relation in self.ring.relations]
        coupled = [several for several in related if not places.isdisjoint(several)]
        return [sorted(group) for group in connected([*([i] for i in sorted(places)), *coupled])]

    def known(self, others: Mapping[int, int] = {}, group: Sequence[int] = ()) -> Values:
        """Return random values of the known generators, with `others` for those not in `group`."""
        relations = [r for r in self.ring.relations if r.generator in self.ring.known]
        fixed = {i: x for i, x in others.items() if i not in group}
        for _ in range(_MOST_DRAWS):
            polynomials = [_at(self.modular(r.polynomial), fixed) for r in relations]
            solutions = _solutions(self, polynomials)
            if solutions:
                drawn = {i: self.random() for i in self.ring.known}
                # What solves the relations replaces what was drawn for the same generators.
                return drawn | fixed | self.draw.choice(solutions)
        names = ", ".join(str(self.ring.generators[r.generator]) for r in relations)
        raise SymbolicError(f"with a closed loop, {names} cannot be kept; give it as a symbol")

    def random(self) -> int:
        # Not zero, which is a special place and has no inverse.
        return self.draw.randrange(1, self.prime)

    def places_of_motion(self, known: Values, first: Sequence[int] = ()) -> Iterator[list[Values]]:
        """Yield, for random values of free generators, all solutions in those without derivative.

        The sine and cosine, or the one generator, of `first` are free.
        """
        polynomials = [_at(p, known) for p in self.levels[0]]
        for _ in range(_MOST_DRAWS):
            drawn = _drawn(self, polynomials, first) if first else {}
            yield _completed_solutions(self, polynomials, [drawn])

    def check_one_motion(self, known: Values) -> list[Values]:
        """Return solutions; raise SymbolicError if they are none, or those of several motions.

        Of a parallelogram, one motion keeps the coupler's angle: only others show it, as the first.
        """
        # Relations such as sin^2 + cos^2 = 1 pair the generators of one signal.
        angles = [r.polynomial for r in self.ring.relations if r.generator in self.ring.motion]
        result = []
        moving = set(chain(*map(occurring, self.levels[0]))) - set(self.ring.known)
        pairs = [pair for pair in map(occurring, angles) if moving.issuperset(pair)]
        for first in [(), *pairs, *([i] for i in moving - set(chain(*pairs)))]:
            solutions = list(chain(*islice(self.places_of_motion(known, first), _DRAWS)))
            result += [] if first else solutions
            if len(solutions) > _MOST_MOTIONS * _DRAWS:
                raise SymbolicError(
                    "the relations allow several motions that do not pass into each other, as a "
                    "parallelogram has two; add the relation of the one meant, such as q3 - q1"
                )
        if not result:
            raise SymbolicError(f"no motion satisfies the relations: {_DRAWS} random places fail")
        return result

    def factors(self, key: tuple[int, int], count: int) -> list[tuple[Values, int]]:
        """Return random known values, each with the factor at `key` that the echelon form has."""
        count += 3 * self.conjugates
        while len(self.samples) < count:
            values = self.known()
            self.samples.append((values, self.echelon(values)[1]))
        return [(values, factors.get(key, 0)) for values, factors in self.samples[:count]]

    def echelon(
        self, known: Values, start: Sequence[Values] = ()
    ) -> tuple[tuple[int, ...], Factors]:
        """Return the pivots, and the factors of the dependent columns, for known values."""
        lines = self.reduced(self._rows(known, start), self.width)
        return tuple(lines), {
            (i, j): x
            for i, line in enumerate(lines.values())
            for j, x in enumerate(line)
            if x and j not in lines
        }

    def _rows(self, known: Values, start: Sequence[Values]) -> list[list[int]]:
        """Return rows of the regressor at `start` and at random places, more than its columns."""
        table = [
            [(motion, {j: self._value(x, known) for j, x in row.items()}) for motion, row in rows]
            for rows in self.table
        ]
        rates = [[_at(p, known) for p in level] for level in self.levels[1:]]
        rows: list[list[int]] = []
        for place in chain(start, chain.from_iterable(self.places_of_motion(known))):
            point = self._with_rates(known | place, rates)
            rows += [self._row(several, point) for several in table] if point else []
            if len(rows) >= self.width + _MORE_ROWS:
                break
        return rows

    def reduced(self, rows: list[list[int]], width: int) -> dict[int, list[int]]:
        """Return the rows of the echelon form as {pivot: row}."""
        entries, modulus = list(chain(*rows)), fmpz_mod_ctx(self.prime)
        matrix, rank = fmpz_mod_mat(len(rows), width, entries, modulus).rref()
        lines = [[int(x) for x in line] for line in matrix.tolist()[:rank]]
        return {next(j for j, x in enumerate(line) if x): line for line in lines}

    def _with_rates(self, point: Values, rates: list[list[fmpz_mod_mpoly]]) -> Values | None:
        for polynomials in rates:
            solutions = _solutions(self, [_at(p, point) for p in polynomials])
            if not solutions:
                return None
            point = point | self.draw.choice(solutions)
        signs = {
            i: self.draw.choice((1, self.prime - 1))
            for i in self.ring.motion
            if isinstance(self.ring.generators[i], sp.sign)
        }
        # Generators in no closure, such as free rates, are random.
        return {i: self.random() for i in self.ring.motion} | signs | point

    def _value(self, quotient: Ratio, known: Values) -> int:
        above, below = (_number(_at(self.modular(p), known)) for p in quotient)
        return above * pow(below, -1, self.prime) % self.prime

    def _row(self, rows: list[tuple[Exponents, dict[int, int]]], point: Values) -> list[int]:
        result = [0] * self.width
        for motion, row in rows:
            value = self.power(motion, point)
            for j, factor in row.items():
                result[j] = (result[j] + factor * value) % self.prime
        return result

    def power(self, exponents: Exponents, values: Values) -> int:
        result = 1
        for i, e in enumerate(exponents):
            if e:
                result = result * pow(values[i], int(e), self.prime) % self.prime
        return result


def _at(polynomial: fmpz_mod_mpoly, values: Mapping[Any, Any]) -> fmpz_mod_mpoly:
    return polynomial.subs(values)


def _number(constant: fmpz_mod_mpoly) -> int:
    """Return the value of a polynomial without variables."""
    return 0 if constant.is_zero() else int(constant.leading_coefficient())


def _solutions(loops: _Loops, polynomials: Sequence[fmpz_mod_mpoly]) -> list[Values]:
    """Return the values at which polynomials are zero; generators that remain free are random.

    One variable is eliminated at a time: by a polynomial in it alone, by one that is linear in it,
    or by resultants.
    """
    system = list({str(p): p for p in polynomials if not p.is_zero()}.values())
    if not system:
        return [{}]
    if any(p.is_constant() for p in system):
        return []
    for p in system:
        if len(occurring(p)) == 1:
            return _completed_solutions(loops, system, _roots(loops, p))
    linear = next(_linear_terms(system), None)
    if linear is not None:
        return _with_linear(loops, system, *linear)
    free = sorted(set(chain(*map(occurring, system))))
    # More variables than equations: one of them moves freely, and is drawn.
    if len(system) < len(free):
        return _completed_solutions(loops, system, [_drawn(loops, system, free)])
    return _with_resultants(loops, system, free)


def _completed_solutions(
    loops: _Loops, system: Sequence[fmpz_mod_mpoly], starts: Iterable[Values]
) -> list[Values]:
    """Return the solutions of a system that have the values of one of the starts."""
    return [
        values | rest
        for values in starts
        for rest in _solutions(loops, [_at(p, values) for p in system])
    ]


def _roots(loops: _Loops, polynomial: fmpz_mod_mpoly) -> list[Values]:
    """Return the values at which a polynomial in one variable is zero."""
    (place,) = occurring(polynomial)
    coefficients = [0] * (int(polynomial.degrees()[place]) + 1)
    for exponents, value in polynomial.to_dict().items():
        coefficients[int(exponents[place])] = int(value)
    return [{place: int(value)} for value, _ in _POLYNOMIALS(loops.prime)(coefficients).roots()]


def _linear_terms(system: list[fmpz_mod_mpoly]) -> Iterator[tuple[fmpz_mod_mpoly, int, int]]:
    """Yield polynomials, short ones first, with a variable to solve for and its coefficient."""
    for p in sorted(system, key=len):
        for place in occurring(p):
            slope = _constant_slope(p, place)
            if slope:
                yield p, place, slope


def _constant_slope(polynomial: fmpz_mod_mpoly, place: int) -> int:
    """Return the coefficient of a variable that occurs once, linearly and alone, or zero."""
    terms = [(m, x) for m, x in polynomial.to_dict().items() if m[place]]
    return int(terms[0][1]) if len(terms) == 1 and sum(terms[0][0]) == 1 else 0


def _with_linear(
    loops: _Loops, system: list[fmpz_mod_mpoly], p: fmpz_mod_mpoly, place: int, slope: int
) -> list[Values]:
    gens = list(loops.context.gens())
    # p = slope x + rest, so that x - p / slope is -rest / slope, without x.
    value = gens[place] - p * pow(slope, -1, loops.prime)
    rule = [*gens[:place], value, *gens[place + 1 :]]
    others = [q.compose(*rule) if place in occurring(q) else q for q in system if q is not p]
    result = []
    for rest in _solutions(loops, others):
        rest = {i: loops.random() for i in occurring(value)} | rest
        result.append(rest | {place: _number(_at(value, rest))})
    return result


def _drawn(loops: _Loops, system: list[fmpz_mod_mpoly], free: Sequence[int]) -> Values:
    """Return random values of an angle's sine and cosine, or else of one variable."""
    generators = loops.ring.generators
    for place in free:
        x = generators[place]
        cosine = loops.ring.index[sp.cos(x.args[0])] if isinstance(x, sp.sin) else -1
        if cosine in free and any(set(occurring(p)) == {place, cosine} for p in system):
            # (2 t, 1 - t^2) / (1 + t^2): of a random cosine, every second sine is not in the field.
            t = loops.random()
            below = pow(1 + t * t, -1, loops.prime)
            pair = 2 * t * below, (1 - t * t) * below
            return {place: pair[0] % loops.prime, cosine: pair[1] % loops.prime}
    return {free[0]: loops.random()}


def _with_resultants(loops: _Loops, system: list[fmpz_mod_mpoly], free: list[int]) -> list[Values]:
    """Eliminate the variable with the lowest degrees, by resultants of the polynomials in it."""
    place = min(free, key=partial(_elimination_cost, system))
    holders = sorted(
        (p for p in system if p.degrees()[place] > 0),
        key=lambda p: (int(p.degrees()[place]), len(p)),
    )
    first, rest = holders[0], [p for p in system if p.degrees()[place] == 0]
    for holder in holders[1:]:
        common = first.gcd(holder)
        # A common factor makes the resultant zero: either it is zero, or both cofactors are.
        if not common.is_constant():
            apart = [p for p in system if p is not first and p is not holder]
            split = [first / common, holder / common, *apart]
            return [*_solutions(loops, [common, *apart]), *_solutions(loops, split)]
        rest.append(first.resultant(holder, place))
    return _completed_solutions(loops, holders, _solutions(loops, rest))


def _elimination_cost(system: list[fmpz_mod_mpoly], place: int) -> tuple[int, int]:
    degrees = [int(p.degrees()[place]) for p in system]
    # A variable in one polynomial only cannot be eliminated by a resultant.
    return (sum(degrees), len(degrees)) if sum(map(bool, degrees)) > 1 else (10**6, 0)


def _interpolated(loops: _Loops, places: Sequence[int], key: tuple[int, int]) -> Ratio:
    """Return the factor at `key` as a quotient of polynomials in the generators at `places`."""
    ring = loops.ring
    for degree in range(9):
        for below in range(degree + 1):
            sides = _monomials(ring, places, degree - below), _monomials(ring, places, below)
            count = sum(map(len, sides))
            if count > _MOST_TERMS:
                break
            # More samples than coefficients: those beyond confirm the quotient.
            quotient = _quotient(loops, *sides, loops.factors(key, count + _MORE_ROWS))
            if quotient is not None:
                return quotient
    names = ", ".join(str(ring.generators[i]) for i in places) or "the lengths"
    raise SymbolicError(
        "a column depends on others with factors that are no short quotients of polynomials in "
        f"{names}; give them as symbols, or as short numbers"
    )


def _monomials(ring: Ring, places: Sequence[int], degree: int) -> list[Exponents]:
    limits = {relation.generator: relation.degree for relation in ring.relations}
    products = chain(*(combinations_with_replacement(places, n) for n in range(degree + 1)))
    monomials = (exponents_at(ring, several, repeat(1, len(several))) for several in products)
    return [m for m in monomials if all(m[i] < limit for i, limit in limits.items())]


def _quotient(
    loops: _Loops,
    above: list[Exponents],
    below: list[Exponents],
    samples: list[tuple[Values, int]],
) -> Ratio | None:
    """Return the quotient with which numerator = value * denominator in all samples, or None."""
    rows = []
    for known, value in samples:
        powers = [loops.power(m, known) for m in above]
        # numerator - value * denominator = 0, linear in the coefficients of both.
        rows.append([*powers, *(-value * loops.power(m, known) % loops.prime for m in below)])
    factors = _dependence(loops, rows, len(above) + len(below))
    if factors is None:
        return None
    terms = list(zip([*above, *below], factors, strict=True))
    sides = terms[: len(above)], terms[len(above) :]
    return ratio(loops.ring, *(loops.ring.context.from_dict(dict(side)) for side in sides))


def _dependence(loops: _Loops, rows: list[list[int]], width: int) -> list[fmpq] | None:
    """Return short factors with which columns add up to zero, or None.

    That of the first dependent column is one.
    """
    lines = loops.reduced(rows, width)
    if len(lines) == width:
        return None
    free = next(j for j in range(width) if j not in lines)
    residues = {free: 1} | {pivot: -line[free] % loops.prime for pivot, line in lines.items()}
    numbers = [_rational(residues.get(j, 0), loops.prime) for j in range(width)]
    short = [x for x in numbers if x is not None]
    return short if len(short) == width else None


def _rational(residue: int, prime: int) -> fmpq | None:
    """Return the short fraction that is a residue modulo the prime, by Euclid's algorithm."""
    a, b, above, below = prime, residue, 0, 1
    while b > _LONGEST:
        step = a // b
        a, b, above, below = b, a - step * b, below, above - step * below
    return fmpq(b, below) if 0 < abs(below) <= _LONGEST else None
