"""The exact equations of a Robot: base parameters, joint-torque regressor and complete model.

The base parameters follow from a recursion over the joints; the regressor, and the complete model
(7) and (8), are in sympy.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from seaid._arrays import Array, frozen
from seaid.drives import IDEAL_DRIVE, Drive, motor_equation, spring_force
from seaid.drives.equations import (
    N,
    i_M,
    joint_equation,
    r_L,
    t,
    tau_G,
    tau_L,
    tau_M,
    theta_L,
    theta_M,
    u_M,
)
from seaid.errors import SeaidWarning, SymbolicError
from seaid.regressor.base import check_constant_ratios
from seaid.regressor.exact.geometry import exact_tree, independent_tree
from seaid.regressor.exact.grouping import (
    ExactBaseParameters,
    from_null_space,
    from_rows,
    packed,
)
from seaid.regressor.exact.program import (
    Entries,
    Program,
    Value,
    evaluated,
    regressor_program,
)
from seaid.regressor.exact.recursion import null_space
from seaid.robot import Robot, coupled_groups
from seaid.robot.inertia import parameter_names
from seaid.robot.robot import check_held

_SUSPICIOUS = 1e10
"""Coefficient of a grouping [in the units of its parameters] from which there is a warning: it is
one over the difference of two directions, here 1e-10, by which a parameter is identifiable."""


def base_parameters(robot: Robot, *, floating_base: bool = False) -> ExactBaseParameters:
    """Return the base parameters of a robot in exact rational arithmetic.

    One small null space per joint is solved, in milliseconds for any tree, with mimic joints.

    Parameters
    ----------
    robot : Robot
        Its geometry is made rational as described in `seaid.regressor.exact.geometry`.
    floating_base : bool, default False
        The base is a free body with known motion and wrench. Ten parameters '<parameter>_base' of
        everything that no joint moves come first.

    Returns
    -------
    ExactBaseParameters
        Without columns of known bodies.

    Raises
    ------
    SymbolicError
        For a robot whose base moves: its file is loaded with a base that is held.

    Warns
    -----
    SeaidWarning
        If a grouping coefficient exceeds 1e10: directions in the file coincide up to a rounding
        error, which exact arithmetic counts as a difference.

    Examples
    --------
    >>> exact = seaid.symbolic.base_parameters(robot)
    >>> exact.rank, exact.exact_rows[0]
    """
    check_held(robot, "base_parameters in exact arithmetic", SymbolicError)
    names = robot.parameter_names
    if floating_base:
        taken = "base" in robot.body_names
        names = parameter_names(["floating_base" if taken else "base"]) + names
    echelon = from_null_space(null_space(exact_tree(robot), floating=floating_base), len(names))
    if np.any(robot.is_known):
        first = len(names) - len(robot.parameters)
        known = {first + column for column in np.flatnonzero(robot.is_known).tolist()}
        echelon = from_rows(echelon, len(names), without=known)
    base = packed(echelon, names)
    largest = float(np.max(np.abs(base.grouping), initial=0.0))
    if largest > _SUSPICIOUS:
        row = int(np.argmax(np.max(np.abs(base.grouping), axis=1)))
        warnings.warn(
            f"'{robot.name}': {base.names[row]} counts as identifiable only because directions "
            f"differ by {1 / largest:.0e}, as a rounded angle makes them; compare with "
            "seaid.base_parameters, or write the angle with all digits",
            SeaidWarning,
            stacklevel=2,
        )
    return base


@dataclass(frozen=True, eq=False)
class RigidBodyForm:
    """The regressor R of (9) for a robot's load side, and R_0 of (14), over exact geometry.

    `base` are the exact base parameters. `program` and `entries` {(joint, parameter): value} are
    the regressor as a straight-line program in q0 .., v0 .., a0 .., in the robot's joint order.
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
        """Common subexpressions of R and R_0: (symbol, expression in earlier ones), as sp.cse."""
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
        """Return an expression or a matrix such as R without the common subexpressions.

        Nothing is multiplied out; for a long chain the result is deep.
        """
        values: dict[sp.Symbol, sp.Expr] = {}
        for symbol, value in self.subexpressions:
            values[symbol] = value.xreplace(values)
        return expression.xreplace(values)

    def regressor(self, q: Array, v: Array, a: Array) -> Array:
        """Return Y (T, n, 10n) of q, v, a (T, n). Raises SeaidError for wrong shapes."""
        return self._evaluated(self.entries, len(self.parameter_names), q, v, a)

    def base_regressor(self, q: Array, v: Array, a: Array) -> Array:
        """Return the base columns (T, n, p) of `regressor`, without computing the others."""
        return self._evaluated(self.base_entries, self.base.rank, q, v, a)

    def _matrix(self, entries: Mapping[tuple[int, int], Value], width: int) -> sp.ImmutableMatrix:
        elements = {place: _to_sympy(value) for place, value in entries.items()}
        return sp.ImmutableMatrix(sp.SparseMatrix(len(self.joint_names), width, elements))

    def _evaluated(self, entries: Entries, width: int, q: Array, v: Array, a: Array) -> Array:
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
        for (i, j), values in evaluated(self.program, entries, motion):
            Y[:, i, j] = values
        return Y


def rigid_body(robot: Robot) -> RigidBodyForm:
    """Derive the exact regressor of a robot's load side, in sympy and as a numeric function.

    It is without payload, friction and rotor inertia, as `seaid.regressor.rigid_body_regressor`.
    """
    program, entries = regressor_program(independent_tree(robot))
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
    terms = ((sp.Rational(int(x.p), int(x.q)), map(_symbol, f)) for f, x in value.items())
    return sp.Add(*(sp.Mul(number, *factors) for number, factors in terms))


@dataclass(frozen=True, eq=False)
class CompleteModel:
    """The equations of a robot with its drives, each an expression that is zero.

    An elastic joint has two equations, (7) of its motor and (8) of its load; a stiff one has one,
    with (8) inserted in (7). For drives that move several joints, (8) is that of the drives'
    coordinates. `coordinates` are the positions of the joints and of the elastic joints' motors,
    functions of time; `inputs` are the motor torques, or the joint torque of an ideal drive.
    `parameters` are the standard inertial parameters. The other symbols are those of
    `seaid.drives.equations` followed by the joint's name, such as k_knee; of these N, r_M, r_L and
    I_M are known.
    """

    equations: tuple[sp.Expr, ...]
    coordinates: tuple[sp.Expr, ...]
    inputs: tuple[sp.Expr, ...]
    parameters: tuple[sp.Symbol, ...]


def complete_model(robot: Robot) -> CompleteModel:
    """Derive (7) and (8) of a robot; lengths and gravity are exact numbers, the rest symbols."""
    check_constant_ratios(robot, "complete_model", SymbolicError)
    form = rigid_body(robot)
    joints = [sp.Function(f"q_{joint}")(t) for joint in robot.joint_names]
    inertial = tuple(sp.Symbol(text) for text in robot.parameter_names)
    torques = form.expanded(form.R) * sp.Matrix(inertial)
    in_time = {
        symbol: joint.diff(t, order)
        for order, symbols in enumerate(form.motion)
        for symbol, joint in zip(symbols, joints, strict=True)
    }
    loads = [
        torque.xreplace(in_time) + _joint_terms(robot.drives[joint], joint, position)
        for torque, joint, position in zip(torques, robot.joint_names, joints, strict=True)
    ]
    turned, loads = _at_drives(robot, joints, loads)
    equations: list[sp.Expr] = []
    coordinates, inputs = list(joints), []
    for joint, position, load in zip(robot.joint_names, turned, loads, strict=True):
        drive = robot.drives[joint]
        motor = sp.Function(f"theta_M_{joint}")(t)
        torque = sp.Function(f"tau_{joint}" if drive is IDEAL_DRIVE else f"tau_M_{joint}")(t)
        inputs.append(torque)
        if drive is IDEAL_DRIVE:
            equations.append(load - torque)
            continue
        side = motor_equation(drive).expression
        if drive.is_elastic:
            spring = r_L * spring_force(drive)
            coordinates.append(motor)
            equations.append(_joint_form(side, joint, position, motor, torque))
            equations.append(_joint_form(spring, joint, position, motor, torque) - load)
        else:
            side = side.subs(theta_M, N * theta_L).doit()
            stiff = _joint_form(side, joint, position, motor, torque)
            equations.append(stiff.subs({tau_L: load, tau_G: load}))
    return CompleteModel(tuple(equations), tuple(coordinates), tuple(inputs), inertial)


def _joint_terms(drive: Drive, joint: str, position: sp.Expr) -> sp.Expr:
    """Return the torque of parallel spring and joint friction."""
    if drive is IDEAL_DRIVE:
        return sp.Integer(0)
    return _joint_form(joint_equation(drive).expression + tau_L, joint, position, theta_M, tau_M)


def _at_drives(
    robot: Robot, joints: list[sp.Expr], loads: list[sp.Expr]
) -> tuple[list[sp.Expr], list[sp.Expr]]:
    """Return the drives' coordinates C q and the torques on them, C^-T tau."""
    if not coupled_groups(robot.transmission):
        return joints, loads
    # The shortest decimal of a factor, as the file has it, and not its binary fraction.
    factors = sp.Matrix(
        [[sp.Rational(repr(factor)) for factor in row] for row in robot.transmission.tolist()]
    )
    return list(factors * sp.Matrix(joints)), list(factors.inv().T * sp.Matrix(loads))


def _joint_form(
    expression: sp.Expr, joint: str, position: sp.Expr, motor: sp.Expr, torque: sp.Expr
) -> sp.Expr:
    """Return a drive's equation with the joint's name in its signals and symbols."""
    signals = {theta_M: motor, theta_L: position, tau_M: torque, i_M: torque, u_M: torque}
    symbols = {
        symbol: sp.Symbol(f"{symbol.name}_{joint}", positive=symbol.is_positive)
        for symbol in expression.free_symbols - {t}
    }
    return expression.subs(signals).doit().xreplace(symbols)
