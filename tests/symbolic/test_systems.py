"""Every system of `systems.py`: its base form at random states, with 50 digits."""

import random
import time
import warnings

import pytest
import sympy as sp
from mpmath import mp, mpf

from seaid.symbolic import BaseForm, RegressorForm, reduce, separate
from tests.symbolic.systems import SYSTEMS, System

Values = dict[sp.Expr, sp.Expr]
DIGITS, ZERO = 50, mpf(10) ** -25


def states(system: System, expressions: list[sp.Expr], seed: int) -> Values:
    """Return random values of the signals, and of their derivatives, in the expressions."""
    draw = random.Random(seed)
    signals = {x for one in expressions for x in one.atoms(sp.core.function.AppliedUndef)}
    signals |= {x for one in expressions for x in one.atoms(sp.Derivative)}
    found: Values = {}
    for x in sorted(signals, key=str):
        centre, width = system.near.get(x, (0, 2))
        found[x] = sp.Rational(str(centre)) + sp.Rational(str(width)) * sp.Rational(
            draw.randint(-1000, 1000), 1009
        )
    return found


def at(matrix: sp.Matrix, values: Values) -> list[list[mpf]]:
    numbers = matrix.xreplace(values).evalf(DIGITS)
    return [[mp.mpmathify(x) for x in numbers.row(i)] for i in range(numbers.rows)]


def constants(system: System) -> Values:
    draw = random.Random(1)
    free = {s for one in system.equations for s in one.free_symbols} - {sp.Symbol("t")}
    return {s: sp.Rational(draw.randint(500, 1500), 1009) for s in sorted(free, key=str)}


def leftmost(columns: list[list[mpf]]) -> tuple[int, ...]:
    """Return the columns that are independent of those before them, by Gram-Schmidt."""
    basis: list[list[mpf]] = []
    pivots = []
    for place, column in enumerate(columns):
        size = mp.sqrt(mp.fdot(column, column))
        rest = list(column)
        for _ in range(2):
            for unit in basis:
                share = mp.fdot(unit, rest)
                rest = [x - share * e for x, e in zip(rest, unit, strict=True)]
        left = mp.sqrt(mp.fdot(rest, rest))
        if size and left > ZERO * size:
            basis.append([x / left for x in rest])
            pivots.append(place)
    return tuple(pivots)


@pytest.mark.slow  # 1.5 s
@pytest.mark.parametrize("system", SYSTEMS, ids=[system.name for system in SYSTEMS])
def test_base_form(system: System) -> None:
    started = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # dependent functions are part of some systems
        form = separate(system.equations, system.motion, system.unknowns)
        base = reduce(form)
    assert time.process_time() - started < 5.0
    assert system.count in (None, len(base.pivots))
    if system.base:
        assert {sp.expand(x) for x in base.parameters} == {sp.expand(x) for x in system.base}
    with mp.workdps(DIGITS):
        check_equations(system, form)
        check_base(system, form, base)


def check_equations(system: System, form: RegressorForm) -> None:
    """R theta - zeta is the equation up to a factor that no motion changes."""
    numbers = {x: sp.Rational(str(x)) for one in system.equations for x in one.atoms(sp.Float)}
    known, left = constants(system), form.regressor * form.parameters - form.zeta
    for i, equation in enumerate(one.xreplace(numbers).doit() for one in system.equations):
        ratios = []
        for seed in range(3):
            values = known | states(system, [equation, left[i]], seed)
            (pair,) = at(sp.Matrix([[left[i], equation]]), values)
            ratios.append(pair[0] / pair[1])
        assert max(ratios) - min(ratios) < 1e-20 * abs(ratios[0])


def check_base(system: System, form: RegressorForm, base: BaseForm) -> None:
    """Pivots are the leftmost independent columns, and R = R_0 B_Eu."""
    known = constants(system)
    rows = []
    # a combination that is zero in as many states as its row has elements is zero in all states
    elements = max(sum(x != 0 for x in form.regressor.row(i)) for i in range(form.regressor.rows))
    for seed in range(elements + 4):
        rows += at(form.regressor, known | states(system, list(form.regressor), seed))
    assert leftmost([list(column) for column in zip(*rows, strict=True)]) == base.pivots
    echelon = at(base.echelon, known)
    for row in rows:
        for j, value in enumerate(row):
            parts = [row[pivot] * line[j] for pivot, line in zip(base.pivots, echelon, strict=True)]
            assert abs(value - mp.fsum(parts)) <= 1e-20 * max(1, *map(abs, parts))
