"""Base parameters by QR reduction of the numeric regressor (Gautier 1991), left to right.

The agreement of two ways to base parameters, as numbers: numeric by QR, and exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from seaid._arrays import Array, BoolArray, frozen, safely, seed_of
from seaid.errors import ExcitationError, RobotError, SeaidError
from seaid.log import Motion
from seaid.regressor.rigid_body import regressor_at_drives
from seaid.robot import Robot

RANK_TOLERANCE = 1e-8
"""Relative: a column is dependent if less than this part of it is new."""

_FEWEST_STATES = 40

_MOST_BYTES = 16e9
"""Of a regressor, which is held twice while it is reduced."""

_NOTHING = 1e-12
"""An entry that makes less than this part of a column is rounding."""


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """The p identifiable combinations of m standard parameters.

    base = grouping @ standard, and Y @ standard = Y[..., columns] @ base for every motion.
    `columns` (p,) are the indices of the base columns; `names` the standard parameters there;
    `expressions` the combinations as text; `grouping` (p, m); `gap` the smallest accepted over the
    largest rejected relative column residual: how clear the rank decision was.
    """

    columns: tuple[int, ...]
    names: tuple[str, ...]
    expressions: tuple[str, ...]
    grouping: Array
    gap: float

    def reduce(self, Y: Array) -> Array:
        """Return the base columns (..., p) of a standard regressor (..., m)."""
        return np.asarray(Y)[..., list(self.columns)]

    def project(self, theta: Array) -> Array:
        """Return the base parameters (p,) of standard parameters (m,), (14)."""
        return self.grouping @ np.asarray(theta)

    def least(self, values: Array) -> Array:
        """Return the smallest standard parameters (10n,) that have these base parameters (p,)."""
        inverse = safely(
            np.linalg.pinv, self.grouping, what="the base parameters", error=RobotError
        )
        return np.asarray(inverse @ values)


def base_parameters(
    robot: Robot,
    motion: Motion | None = None,
    *,
    torque_joints: Sequence[str] | None = None,
    seed: int = 0,
) -> BaseParameters:
    """Return the base parameters of a robot: structural, or what one motion can tell.

    Without `motion` the regressor is taken at random full states. `rows` names the joints whose
    torques are known (default all): those of their drives. Columns of known bodies are left
    out; where all are known there are none. Raises ExcitationError where nothing is identifiable.
    """
    torques = robot.rows(torque_joints)
    known = [robot.index(joint) for joint in torques]
    if not known:
        raise ExcitationError("torque_joints= names no joint: give those whose torque is known")
    states = random_states(robot, seed, len(known)) if motion is None else motion.joint_states
    _check_memory(robot, len(states[0]))
    Y = regressor_at_drives(robot, *states)
    H = Y[:, known].reshape(-1, Y.shape[2])
    columns, grouping, gap = left_to_right(H, negligible(H) | robot.is_known)
    if not columns and not np.all(robot.is_known):
        raise ExcitationError(
            f"no parameter of '{robot.name}' is identifiable from the torques at "
            f"{', '.join(torques)}"
        )
    return base_of_columns(robot, columns, grouping, gap)


def _check_memory(robot: Robot, samples: int) -> None:
    """Raise ExcitationError where the regressor of a robot with very many joints is too large."""
    needed = 8 * 10 * samples * robot.n**2
    if needed > _MOST_BYTES:
        raise ExcitationError(
            f"'{robot.name}' has {robot.n} joints that move: the regressor over {samples} samples "
            f"takes {needed / 1e9:.3g} GB, allowed are {_MOST_BYTES / 1e9:.3g} GB; let fewer "
            "joints move with joints=, or give a shorter motion"
        )


def base_of_columns(
    robot: Robot, columns: Sequence[int], grouping: Array, gap: float
) -> BaseParameters:
    """Return the base parameters of a choice of columns with its grouping matrix, named."""
    names = robot.parameter_names
    return BaseParameters(
        columns=tuple(columns),
        names=tuple(names[column] for column in columns),
        expressions=tuple(grouped_text(row, names) for row in grouping),
        grouping=frozen("grouping", grouping, (None, None)),
        gap=gap,
    )


def random_states(
    robot: Robot, seed: int, torques: int | None = None
) -> tuple[Array, Array, Array]:
    """Return random q, v, a, enough for a rank decision with so many known torques (default n).

    Positions over a full turn or a metre; three rows a parameter and more. Where all torques are
    known each body has one of its own, and forty states tell its ten parameters in any robot.
    """
    rng = np.random.default_rng(seed_of(seed))
    known = robot.n if torques is None else torques
    enough = 0 if known == robot.n else -(-30 * robot.n // min(known, 6))
    shape = (max(_FEWEST_STATES, enough), robot.n)
    reach = np.where(robot.is_prismatic, 1.0, np.pi)
    return rng.uniform(-reach, reach, shape), rng.normal(0, 3, shape), rng.normal(0, 10, shape)


def left_to_right(H: Array, zero: BoolArray | None = None) -> tuple[list[int], Array, float]:
    """Return base columns, grouping matrix (p, m) and gap of the columns of H, taken in order.

    Columns are scaled to unit norm first; those marked `zero` (default: none but exact zeros) are
    left out before. The triangular factor of H stands for H: both have the same dependencies.
    """
    norms = np.linalg.norm(H, axis=0)
    zero = norms == 0 if zero is None else zero | (norms == 0)
    scale = np.where(zero, 1.0, norms)
    if not np.all(np.isfinite(norms)):
        raise RobotError(
            "the torques of unit parameters are not finite: lengths or speeds of the robot are "
            "too large to be squared; check that its file is in metres and radians"
        )
    R = linalg.qr(H / scale, mode="r", check_finite=False)[0][: H.shape[1]]
    basis = np.zeros((R.shape[0], min(R.shape)))
    columns: list[int] = []
    accepted, rejected = 1.0, float(np.finfo(float).eps)
    for column in np.flatnonzero(~zero):
        found = basis[:, : len(columns)]
        new = R[:, column] - found @ (found.T @ R[:, column])
        new -= found @ (found.T @ new)
        residual = float(np.linalg.norm(new))
        if residual > RANK_TOLERANCE and len(columns) < basis.shape[1]:
            accepted = min(accepted, residual)
            basis[:, len(columns)] = new / residual
            columns.append(int(column))
        else:
            rejected = max(rejected, residual)
    basis = basis[:, : len(columns)]
    grouping = safely(
        linalg.solve_triangular,
        basis.T @ R[:, columns],
        basis.T @ R,
        what="the base parameters",
        error=RobotError,
    )
    grouping[np.abs(grouping) < _NOTHING] = 0.0
    grouping *= scale[None, :] / scale[columns][:, None]
    grouping[:, zero] = 0.0
    for row, base in enumerate(columns):  # exact where it is known: left of the base column, at it
        grouping[row, :base] = 0.0
        grouping[:, base] = 0.0
        grouping[row, base] = 1.0
    return columns, grouping, accepted / rejected


def grouped_text(coefficients: Array, names: Sequence[str]) -> str:
    """Return 'Iyy_thigh + 0.0756 m_shank' of coefficients (m,), four digits, 1 left out."""
    text = ""
    for index in map(int, np.flatnonzero(coefficients)):
        value = coefficients[index]
        size = "" if abs(abs(value) - 1) < 1e-9 else f"{abs(value) * (1 + 1e-9):.4g} "
        sign = ("-" if value < 0 else "") if not text else (" - " if value < 0 else " + ")
        text += f"{sign}{size}{names[index]}"
    return text


def negligible(H: Array) -> BoolArray:
    """Tell columns that are zero but for rounding, before scaling makes them look like others.

    A column of H is the torque of a unit parameter; those of mass times one or two metres are
    alike in size, so one far below the largest is the trace of a rounded angle.
    """
    norms = np.linalg.norm(H, axis=0)
    return np.asarray(norms < 1e-9 * norms.max(initial=0.0))


AGREEMENT = 1e-9
"""The largest difference of groupings that rounding explains."""


@dataclass(frozen=True)
class CrossCheck:
    """What numeric and exact base parameters have in common.

    `same_columns` is true for the same base columns; then `max_difference` is the largest
    difference of the grouping matrices, each base parameter's divided by its largest coefficient
    (which is at least 1), else infinite. `gap` is the numeric rank decision's. `agree` is true for
    the same columns and a difference below 1e-9. `counts` are the numeric and the exact number of
    base parameters.
    """

    agree: bool
    same_columns: bool
    max_difference: float
    gap: float
    counts: tuple[int, int]


def cross_check(numeric: BaseParameters, exact: BaseParameters) -> CrossCheck:
    """Compare the numeric base parameters of a robot with its exact ones.

    Raises SeaidError where both do not belong to the same number of standard parameters.
    """
    widths = numeric.grouping.shape[1], exact.grouping.shape[1]
    if widths[0] != widths[1]:
        raise SeaidError(
            f"cross_check compares base parameters of one robot, found {widths[0]} and {widths[1]} "
            "standard parameters; make both from the same Robot"
        )
    same = numeric.columns == exact.columns
    difference = float("inf")
    if same:
        largest = np.max(np.abs(exact.grouping), axis=1, initial=1.0)
        apart = np.abs(numeric.grouping - exact.grouping) / largest[:, None]
        difference = float(np.max(apart, initial=0.0))
    return CrossCheck(
        agree=same and difference < AGREEMENT,
        same_columns=same,
        max_difference=difference,
        gap=numeric.gap,
        counts=(len(numeric.columns), len(exact.columns)),
    )
