"""The exact base parameters of a Robot, by three routes to the same echelon form."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import get_args

import numpy as np

from seaid.errors import SeaidWarning, SymbolicError, unknown_name
from seaid.regressor.exact.geometry import ExactTree, exact_tree, independent_tree
from seaid.regressor.exact.grouping import (
    ExactBaseParameters,
    Route,
    SparseRow,
    from_null_space,
    from_rows,
    packed,
    without_columns,
)
from seaid.regressor.exact.lagrangian import lagrangian_table, torque_rows
from seaid.regressor.exact.recursion import null_space
from seaid.robot import Robot, check_held, incomplete_group, parameter_names
from seaid.symbolic import MAX_TERMS

_SUSPICIOUS = 1e10


def base_parameters(
    robot: Robot,
    *,
    through: Route | None = None,
    torque_joints: Sequence[str] | None = None,
    floating_base: bool = False,
    max_terms: int = MAX_TERMS,
    progress: bool = False,
) -> ExactBaseParameters:
    """Return the base parameters of a robot in exact rational arithmetic.

    Parameters
    ----------
    robot : Robot
        Its geometry is made rational as described in `seaid.regressor.exact.geometry`.
    through : {"recursion", "energy", "torque"}, optional
        The route; all give the same result. "recursion" (default) solves one small null space per
        joint, in milliseconds for any tree, and takes mimic joints; "energy" reduces the
        polynomials of kinetic and potential energy; "torque" those of the joint torques, (11)-(13)
        of the paper.
    torque_joints : list of str, optional
        Joints whose torque is known, served by "torque" only. Default: all.
    floating_base : bool, default False
        The base is a free body with known motion and wrench ("recursion" only). Ten parameters
        '<parameter>_base' of everything that no joint moves come first.
    max_terms : int
        Limit on the terms of the polynomials, reached by chains of about nine joints.
    progress : bool, default False
        Show a progress bar on stderr.

    Returns
    -------
    ExactBaseParameters
        Without columns of known bodies.

    Raises
    ------
    SymbolicError
        For options that exclude each other, and for more than `max_terms` terms.
    RobotError
        For an unknown joint.

    Warns
    -----
    SeaidWarning
        If a grouping coefficient exceeds 1e10: directions in the file coincide up to a rounding
        error, which exact arithmetic counts as a difference.

    Examples
    --------
    >>> exact = seaid.symbolic.base_parameters(robot)
    >>> exact.rank, exact.exact_grouping[0]
    """
    check_held(robot, "base_parameters in exact arithmetic", SymbolicError)
    route = _route(through, torque_joints, floating_base)
    known = _known(robot, torque_joints)
    if route != "recursion":
        tree = independent_tree(robot)
        return _checked(robot, _by_polynomials(robot, tree, route, known, max_terms, progress))
    names = robot.parameter_names
    if floating_base:
        taken = "base" in robot.body_names
        names = parameter_names(["floating_base" if taken else "base"]) + names
    nulls = null_space(exact_tree(robot), floating=floating_base)
    echelon = from_null_space(nulls, len(names))
    echelon = _of_unknown(robot, echelon, len(names) - len(robot.parameters))
    return _checked(robot, packed(echelon, names, route))


def _checked(robot: Robot, base: ExactBaseParameters) -> ExactBaseParameters:
    """Warn if the geometry is special up to a rounding error."""
    largest = float(np.max(np.abs(base.grouping), initial=0.0))
    if largest > _SUSPICIOUS:
        row = int(np.argmax(np.max(np.abs(base.grouping), axis=1)))
        warnings.warn(
            f"'{robot.name}': {base.names[row]} counts as identifiable only because directions "
            f"differ by {1 / largest:.0e}, as a rounded angle makes them; compare with "
            "seaid.base_parameters, or write the angle with all digits",
            SeaidWarning,
            stacklevel=3,
        )
    return base


def _by_polynomials(
    robot: Robot, tree: ExactTree, route: Route, known: list[int], max_terms: int, progress: bool
) -> ExactBaseParameters:
    """Reduce the functions of the energy, or those of the torques of the joints `known`."""
    table = lagrangian_table(tree, max_terms, progress=progress)
    rows, functions = list(table.values()), len(table)
    if route == "torque":
        rows, functions = torque_rows(tree, table, known, max_terms, progress=progress)
    echelon, different = from_rows(rows, 10 * robot.n)
    echelon = _of_unknown(robot, echelon, 0)
    return packed(echelon, robot.parameter_names, route, functions, different)


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
            f"{torque_joints!r}; the joints of '{robot.name}' are {', '.join(robot.joint_names)}",
            "torque_joints=",
        )
    group = incomplete_group(robot.joint_names, robot.transmission, torque_joints)
    if group:
        raise SymbolicError(
            f"the drives of {', '.join(group)} move these joints together: torque_joints= must "
            "name all of them or none here; seaid.base_parameters accepts some of them",
            "torque_joints=",
        )
    return [robot.model_order.index(robot.index(joint)) for joint in torque_joints]


def _route(
    through: Route | None, torque_joints: Sequence[str] | None, floating_base: bool
) -> Route:
    if through is not None and through not in get_args(Route):
        raise SymbolicError(unknown_name("route through=", through, get_args(Route)))
    if torque_joints is not None and through not in (None, "torque"):
        raise SymbolicError(
            f'torque_joints= was given with through="{through}", but only through="torque" '
            "supports it: omit through=",
            "torque_joints=",
        )
    route: Route = through or ("recursion" if torque_joints is None else "torque")
    if floating_base and route != "recursion":
        raise SymbolicError(
            f'floating_base=True needs through="recursion" and all torque joints, found "{route}"'
        )
    return route
