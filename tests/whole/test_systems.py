"""Every system of `systems.py`: its base form at random states, with 50 digits."""

import random
import time
from math import pi
from pathlib import Path

import pytest
import sympy as sp
from mpmath import mp, mpf
from sympy.parsing.sympy_parser import implicit_multiplication, standard_transformations

from seaid.legged import load_robot
from seaid.symbolic import (
    BaseForm,
    RegressorForm,
    base_parameters,
    reduce,
    separate,
)
from tests.one_joint import BODY
from tests.plants import write_robot
from tests.representatives import quick_only
from tests.symbolic.systems import DIGITS, SYSTEMS, System, leftmost

Values = dict[sp.Expr, sp.Expr]


def states(expressions: list[sp.Expr], seed: int) -> Values:
    """Return random values of the signals, and of their derivatives, in the expressions."""
    draw = random.Random(seed)
    signals = {x for one in expressions for x in one.atoms(sp.core.function.AppliedUndef)}
    signals |= {x for one in expressions for x in one.atoms(sp.Derivative)}
    return {x: 2 * sp.Rational(draw.randint(-1000, 1000), 1009) for x in sorted(signals, key=str)}


def at(matrix: sp.Matrix, values: Values) -> list[list[mpf]]:
    numbers = matrix.xreplace(values).evalf(DIGITS)
    return [[mp.mpmathify(x) for x in numbers.row(i)] for i in range(numbers.rows)]


def constants(system: System) -> Values:
    draw = random.Random(1)
    free = {s for one in system.equations for s in one.free_symbols} - {sp.Symbol("t")}
    return {s: sp.Rational(draw.randint(500, 1500), 1009) for s in sorted(free, key=str)}


BY_NAME = {system.name: system for system in SYSTEMS}
QUICK = ("arm yz", "2 masses with cubic springs", "acrobot", "series elastic joint")


@pytest.mark.parametrize("name", quick_only(BY_NAME, QUICK))
def test_base_form(name: str) -> None:
    """The number of base parameters of the source, and the laws of the form, within seconds."""
    system = BY_NAME[name]
    started = time.process_time()
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
            values = known | states([equation, left[i]], seed)
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
        rows += at(form.regressor, known | states(list(form.regressor), seed))
    assert leftmost([list(column) for column in zip(*rows, strict=True)]) == base.pivots
    echelon = at(base.echelon, known)
    for row in rows:
        for j, value in enumerate(row):
            parts = [row[pivot] * line[j] for pivot, line in zip(base.pivots, echelon, strict=True)]
            assert abs(value - mp.fsum(parts)) <= 1e-20 * max(1, *map(abs, parts))


# (alpha [deg], d, r) of Khalil and Dombre (2002), table 3.1, with other lengths for d3 and r4
RX90 = [(0, 0, 0), (90, 0, 0), (0, 0.5, 0), (-90, 0, 0.375), (90, 0, 0), (-90, 0, 0)]

RX90_BASE = """
        Izz1 + Iyy2 + Iyy3 + d3^2 M3456
        Ixx2 - Iyy2 - d3^2 M3456; Ixy2; Ixz2 - d3 mz3; Iyz2; Izz2 + d3^2 M3456; mx2 + d3 M3456; my2
        Ixx3 - Iyy3 + Iyy4 + 2 r4 mz4 + r4^2 M456; Ixy3; Ixz3; Iyz3
        Izz3 + Iyy4 + 2 r4 mz4 + r4^2 M456; mx3; my3 + mz4 + r4 M456
        Ixx4 - Iyy4 + Iyy5; Ixy4; Ixz4; Iyz4; Izz4 + Iyy5; mx4; my4 - mz5
        Ixx5 - Iyy5 + Iyy6; Ixy5; Ixz5; Iyz5; Izz5 + Iyy6; mx5; my5 + mz6
        Ixx6 - Iyy6; Ixy6; Ixz6; Iyz6; Izz6; mx6; my6"""
"""Their base inertial parameters, without those of the rotors."""


def published_rx90() -> list[sp.Expr]:
    text = RX90_BASE.replace("^", "**").replace("\n", ";")
    names = {f"M{end}": sum(sp.Symbol(f"m{i}") for i in end) for end in ("3456", "456")}
    spaced = (*standard_transformations, implicit_multiplication)
    lines = [line for line in text.split(";") if line.strip()]
    return [sp.parse_expr(one, local_dict=names, transformations=spaced) for one in lines]


def test_rx90_has_the_base_parameters_of_khalil_and_dombre(tmp_path: Path) -> None:
    """Frames of modified Denavit and Hartenberg are those of a URDF with all axes along z."""
    joints = {}
    for i, (alpha, d, r) in enumerate(RX90, 1):
        x, y, z = map(float, (d, -sp.sin(sp.rad(alpha)) * r, sp.cos(sp.rad(alpha)) * r))
        place = f'<origin xyz="{x} {y} {z}" rpy="{alpha * pi / 180} 0 0"/>'
        joints[f"q{i}"] = f'continuous l{i - 1} l{i} {place}<axis xyz="0 0 1"/>'
    path = write_robot(tmp_path / "rx90.urdf", joints, BODY)
    exact = base_parameters(load_robot(path))
    assert exact.rank == 36
    names = ["m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"]
    parameters = [sp.Symbol(f"{name}{body}") for body in range(1, 7) for name in names]
    lengths = {sp.Symbol("d3"): sp.Rational(1, 2), sp.Symbol("r4"): sp.Rational(3, 8)}
    published = sp.Matrix([one.subs(lengths) for one in published_rx90()]).jacobian(parameters)
    # both span the same space: one echelon form
    echelon, pivots = published.rref()
    assert len(pivots) == 36
    rows = [[sp.Rational(row.get(j, 0)) for j in range(60)] for row in exact.exact_rows]
    assert sp.Matrix(rows).rref()[0] == echelon
