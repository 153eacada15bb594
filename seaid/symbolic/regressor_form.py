"""The exact joint-torque regressor of a Robot: in sympy, as a numeric function, as source text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp
from flint import fmpq

from seaid.arrays import Array, frozen
from seaid.errors import SymbolicError
from seaid.robot import Robot
from seaid.symbolic.exact_base import base_parameters
from seaid.symbolic.geometry import exact_tree
from seaid.symbolic.grouping import ExactBaseParameters
from seaid.symbolic.newton_euler import Entries, regressor_program
from seaid.symbolic.program import Numeric, Program, Value, numeric


@dataclass(frozen=True, eq=False)
class RigidBodyForm:
    """The regressor R of (9) for a robot's load side, and R_0 of (14), over exact geometry.

    `base` are the exact base parameters; `program` and `entries` {(joint, parameter): value} the
    regressor as a straight-line program in q0 .., v0 .., a0 .., the joints in the robot's order.
    """

    robot_name: str
    joint_names: tuple[str, ...]
    parameter_names: tuple[str, ...]
    base: ExactBaseParameters
    program: Program = field(repr=False)
    entries: Entries = field(repr=False)

    @property
    def base_entries(self) -> Entries:
        """The elements of R_0: {(joint, base parameter): value}."""
        places = {column: place for place, column in enumerate(self.base.columns)}
        return {(i, places[j]): x for (i, j), x in self.entries.items() if j in places}

    @cached_property
    def motion(self) -> tuple[tuple[sp.Symbol, ...], ...]:
        """The symbols of positions, velocities and accelerations, each (n,)."""
        return tuple(tuple(_symbol(f"{x}{i}") for i in range(len(self.joint_names))) for x in "qva")

    @cached_property
    def subexpressions(self) -> tuple[tuple[sp.Symbol, sp.Expr], ...]:
        """What R and R_0 are written in: (symbol, expression in symbols before it), as sp.cse."""
        circular = [
            (_symbol(text), getattr(sp, function)(_symbol(argument)))
            for text, (function, argument) in self.program.circular.items()
        ]
        steps = [(_symbol(text), _to_sympy(x)) for text, x in self.program.steps.items()]
        return (*circular, *steps)

    @cached_property
    def R(self) -> sp.ImmutableMatrix:
        """R (n, 10n) in the common subexpressions."""
        return self._matrix(self.entries, len(self.parameter_names))

    @cached_property
    def R_0(self) -> sp.ImmutableMatrix:
        """R_0 (n, p) in the common subexpressions."""
        return self._matrix(self.base_entries, self.base.rank)

    def expanded(self, expression: Any) -> Any:
        """Return an expression or a matrix such as R in positions, velocities, accelerations alone.

        Nothing is multiplied out; of a long chain the result is deep.
        """
        values: dict[sp.Symbol, sp.Expr] = {}
        for symbol, value in self.subexpressions:
            values[symbol] = value.xreplace(values)
        return expression.xreplace(values)

    def regressor(self, q: Array, v: Array, a: Array) -> Array:
        """Return Y (T, n, 10n) of q, v, a (T, n). Raises SeaidError for wrong shapes."""
        return self._evaluated(self._numeric, len(self.parameter_names), q, v, a)

    def base_regressor(self, q: Array, v: Array, a: Array) -> Array:
        """Return the base columns (T, n, p) of `regressor`, computing no others."""
        return self._evaluated(self._numeric_base, self.base.rank, q, v, a)

    def _matrix(self, entries: Mapping[tuple[int, int], Value], width: int) -> sp.ImmutableMatrix:
        elements = {place: _to_sympy(value) for place, value in entries.items()}
        return sp.ImmutableMatrix(sp.SparseMatrix(len(self.joint_names), width, elements))

    @cached_property
    def _numeric(self) -> Numeric:
        return numeric(self.program, self.entries)

    @cached_property
    def _numeric_base(self) -> Numeric:
        return numeric(self.program, self.base_entries)

    def _evaluated(self, program: Numeric, width: int, q: Array, v: Array, a: Array) -> Array:
        n = len(self.joint_names)
        q, v, a = (frozen(x, value, (None, n)) for x, value in zip("qva", (q, v, a), strict=True))
        if not len(q) == len(v) == len(a):
            raise SymbolicError(
                f"q, v and a must have as many rows, found {len(q)}, {len(v)}, {len(a)}"
            )
        motion = {
            f"{x}{i}": value[:, i]
            for x, value in zip("qva", (q, v, a), strict=True)
            for i in range(n)
        }
        Y = np.zeros((len(q), n, width))
        for (i, j), values in program.evaluate(motion):
            Y[:, i, j] = values
        return Y


def rigid_body(robot: Robot) -> RigidBodyForm:
    """Return the regressor of a robot's load side, exact, in sympy and as a function.

    Without payload, friction and rotor inertia, as `seaid.regression.rigid_body_regressor`.
    """
    program, entries = regressor_program(exact_tree(robot))
    return RigidBodyForm(
        robot_name=robot.name,
        joint_names=robot.joint_names,
        parameter_names=robot.parameter_names,
        base=base_parameters(robot),
        program=program,
        entries=entries,
    )


def _symbol(text: str) -> sp.Symbol:
    return sp.Symbol(text, real=True)


def _to_sympy(value: Value) -> sp.Expr:
    return sp.Add(*(sp.Mul(_rational(x), *map(_symbol, f)) for f, x in value.items()))


def _rational(x: fmpq) -> sp.Rational:
    return sp.Rational(int(x.p), int(x.q))
