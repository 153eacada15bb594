"""The exact base parameters of a Robot, by three ways that give the same echelon form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from seaid.errors import SymbolicError, unknown_name
from seaid.inertia import parameter_names
from seaid.robot import Robot
from seaid.symbolic.geometry import exact_tree
from seaid.symbolic.grouping import ExactBaseParameters, Way, from_null_space, packed
from seaid.symbolic.recursion import null_space


def base_parameters(
    robot: Robot,
    *,
    through: Way | None = None,
    rows: Sequence[str] | None = None,
    floating_base: bool = False,
) -> ExactBaseParameters:
    """Return the base parameters of a robot over the rationals, for its standard parameters.

    `through` is the way: "recursion" asks one small question a joint and takes milliseconds for any
    tree (the default); "energy" reduces the polynomials of kinetic and potential energy; "torque"
    those of the regressor of the joint torques, the paper's (11)-(13). All give the same. `rows`
    names the joints whose torques are known (default all); only "torque" serves it, and is taken
    then. Angles and lengths are those of `seaid.symbolic.geometry`.

    With `floating_base` the base is a free body with known motion and wrench (recursion only): ten
    parameters '<parameter>_base' come first, of everything that no joint moves.

    Raises SymbolicError for options that do not go together, RobotError for a joint that is not
    there.
    """
    way = _way(through, rows, floating_base)
    tree = exact_tree(robot)
    names = robot.parameter_names
    if floating_base:
        taken = "base" in robot.body_names
        names = parameter_names(["floating_base" if taken else "base"]) + names
    echelon = from_null_space(null_space(tree, floating=floating_base), len(names))
    return packed(echelon, names, way)


def _way(through: Way | None, rows: Sequence[str] | None, floating_base: bool) -> Way:
    if through is not None and through not in get_args(Way):
        raise SymbolicError(unknown_name("way through=", through, get_args(Way)))
    if rows is not None and through not in (None, "torque"):
        raise SymbolicError(
            f'rows= tells which torques are known, found it with through="{through}"; only '
            'through="torque" can serve it: leave through= out'
        )
    way: Way = through or ("recursion" if rows is None else "torque")
    if floating_base and way != "recursion":
        raise SymbolicError(
            f'floating_base=True goes with through="recursion" and all rows, found "{way}"'
        )
    return way
