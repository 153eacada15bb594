"""The exact base parameters of a Robot, by three ways that give the same echelon form."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import get_args

import numpy as np

from seaid.errors import SeaidWarning, SymbolicError, unknown_name
from seaid.regressor.exact.geometry import ExactTree, exact_tree
from seaid.regressor.exact.grouping import (
    ExactBaseParameters,
    SparseRow,
    Way,
    from_null_space,
    from_rows,
    packed,
    without_columns,
)
from seaid.regressor.exact.lagrangian import lagrangian_table, torque_rows
from seaid.regressor.exact.recursion import null_space
from seaid.robot import Robot, incomplete_group, parameter_names
from seaid.symbolic import MAX_TERMS

_SUSPICIOUS = 1e10


def base_parameters(
    robot: Robot,
    *,
    through: Way | None = None,
    torque_joints: Sequence[str] | None = None,
    floating_base: bool = False,
    max_terms: int = MAX_TERMS,
    progress: bool = False,
) -> ExactBaseParameters:
    """Return the base parameters of a robot over the rationals, for its standard parameters.

    `through` is the way: "recursion" asks one small question a joint and takes milliseconds for any
    tree (the default); "energy" reduces the polynomials of kinetic and potential energy; "torque"
    those of the regressor of the joint torques, the paper's (11)-(13). All give the same. `rows`
    names the joints whose torques are known (default all); only "torque" serves it, and is taken
    then. Columns of known bodies are left out. Angles and lengths are those of
    `seaid.regressor.exact.geometry`.

    With `floating_base` the base is a free body with known motion and wrench (recursion only): ten
    parameters '<parameter>_base' come first, of everything that no joint moves.

    Raises SymbolicError for options that do not go together, and before the polynomials have more
    than `max_terms` terms (chains of about nine joints); RobotError for a joint that is not there.
    Warns where a grouping has a coefficient above 1e10: then directions of the file coincide but
    for a rounding error, and the exact count takes that at its word.
    """
    way = _way(through, torque_joints, floating_base)
    known = _known(robot, torque_joints)
    tree = exact_tree(robot)
    if way != "recursion":
        return _checked(robot, _by_polynomials(robot, tree, way, known, max_terms, progress))
    names = robot.parameter_names
    if floating_base:
        taken = "base" in robot.body_names
        names = parameter_names(["floating_base" if taken else "base"]) + names
    echelon = from_null_space(null_space(tree, floating=floating_base), len(names))
    echelon = _of_unknown(robot, echelon, len(names) - 10 * robot.n)
    return _checked(robot, packed(echelon, names, way))


def _checked(robot: Robot, base: ExactBaseParameters) -> ExactBaseParameters:
    """Warn where the geometry is special but for a rounding error."""
    largest = float(np.max(np.abs(base.grouping), initial=0.0))
    if largest > _SUSPICIOUS:
        row = int(np.argmax(np.max(np.abs(base.grouping), axis=1)))
        warnings.warn(
            f"'{robot.name}': {base.names[row]} is told apart by directions that coincide but for "
            f"{1 / largest:.0e}, as a rounded angle leaves them, and is counted; compare with "
            "seaid.base_parameters, or write the angle with all digits",
            SeaidWarning,
            stacklevel=3,
        )
    return base


def _by_polynomials(
    robot: Robot,
    tree: ExactTree,
    way: Way,
    known: list[int],
    max_terms: int,
    progress: bool,
) -> ExactBaseParameters:
    """Reduce the functions of the energy, or those of the torques of the joints `known`."""
    table = lagrangian_table(tree, max_terms, progress=progress)
    rows, functions = list(table.values()), len(table)
    if way == "torque":
        rows, functions = torque_rows(tree, table, known, max_terms, progress=progress)
    echelon, different = from_rows(rows, 10 * robot.n)
    echelon = _of_unknown(robot, echelon, 0)
    return packed(echelon, robot.parameter_names, way, functions, different)


def _of_unknown(robot: Robot, echelon: list[SparseRow], first: int) -> list[SparseRow]:
    """Return the echelon form without the columns of known bodies; `first` is the robot's own."""
    known = {first + int(column) for column in np.flatnonzero(robot.is_known)}
    return without_columns(echelon, known) if known else echelon


def _known(robot: Robot, torque_joints: Sequence[str] | None) -> list[int]:
    """Return the joints of the tree whose torques are known."""
    if torque_joints is None:
        return list(range(robot.n))
    if isinstance(torque_joints, str) or not torque_joints:
        raise SymbolicError(
            "torque_joints= must be a list of at least one joint name, found "
            f"{torque_joints!r}; the joints of '{robot.name}' are {', '.join(robot.joint_names)}"
        )
    group = incomplete_group(robot.joint_names, robot.transmission, torque_joints)
    if group:
        raise SymbolicError(
            f"the drives of {', '.join(group)} move these joints together: torque_joints= must "
            "name all of them or none here; seaid.base_parameters serves some of them"
        )
    return [robot.model_order.index(robot.index(joint)) for joint in torque_joints]


def _way(through: Way | None, torque_joints: Sequence[str] | None, floating_base: bool) -> Way:
    if through is not None and through not in get_args(Way):
        raise SymbolicError(unknown_name("way through=", through, get_args(Way)))
    if torque_joints is not None and through not in (None, "torque"):
        raise SymbolicError(
            f'torque_joints= tells which torques are known, found it with through="{through}"; '
            'only through="torque" can serve it: leave through= out'
        )
    way: Way = through or ("recursion" if torque_joints is None else "torque")
    if floating_base and way != "recursion":
        raise SymbolicError(
            f'floating_base=True goes with through="recursion" and all rows, found "{way}"'
        )
    return way
