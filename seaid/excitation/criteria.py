"""Criteria of excitation, from the triangular factor R of the observation matrix H (15).

A criterion is the logarithm of a cost and its gradient as a symmetric matrix S (p, p): a change dH
changes the logarithm by sum((H S) * dH). The plain criteria have kinks at the best motions, where
singular values meet, so the search minimises smooth maxima instead.

Also the base columns of a condition number, picked by QR with column pivoting, and the exact
gradient of the rigid-body regressor by the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
import pinocchio as pin
from scipy.linalg import solve_triangular

from seaid._arrays import Array, safely
from seaid.errors import ExcitationError
from seaid.regressor import BaseParameters, base_parameters
from seaid.regressor.base import base_of_columns, body_equations, slopes_of_model
from seaid.robot import Robot

_safely = partial(safely, what="the regressor of the motion", error=ExcitationError)

_WORST = 1e12
"""Condition number above which H counts as rank deficient, so a parameter is unidentifiable."""

# four equal singular values at either end make the smooth condition number the larger by
# 4^(2/32), 9 %
_SHARPNESS, _NEIGHBOURS = 32.0, 4


@dataclass(frozen=True)
class Criterion:
    """A cost to minimise, as its logarithm, of an R that `has_full_rank`.

    `log_value(R)` is reported and compared; `smooth(R)` returns the smooth approximation that the
    search descends and its gradient S. `meaning` is the name of the cost in messages.
    """

    meaning: str
    log_value: Callable[[Array], float]
    smooth: Callable[[Array], tuple[float, Array]]
    needs_nominal: bool = False


def triangular_factor(H: Array, previous: Array) -> Array:
    """Return R (p, p) with R^T R = H^T H + P^T P for the factor P of `previous` rows."""
    # H = Q R: factors are added by stacking, and H^T H would square the condition number
    return np.asarray(np.linalg.qr(np.vstack([previous, H]), mode="r"))


def singular_values(R: Array) -> Array:
    """Return the singular values of a triangular factor, largest first."""
    return np.asarray(_safely(np.linalg.svd, R, compute_uv=False), dtype=np.float64)


def scaled_condition_and_d_value(H: Array) -> tuple[float, float]:
    """Return condition number of H (T, p) with columns of unit norm, and (det H^T H)^(1/2p).

    The first does not depend on the units of the parameters. The second is the geometric mean of
    the singular values: other base columns are H M, other units H D, and det M and det D are the
    same for every motion, so that the ratio between two motions depends on neither. It is zero, and
    the condition number infinite, if columns are dependent.
    """
    norms = np.linalg.norm(H, axis=0)
    if not np.all(norms > 0):
        return np.inf, 0.0
    values = singular_values(triangular_factor(H / norms, np.empty((0, H.shape[1]))))
    if values[-1] <= values[0] / _WORST:
        return np.inf, 0.0
    return float(values[0] / values[-1]), float(np.exp(np.mean(np.log(values) + np.log(norms))))


def has_full_rank(R: Array) -> bool:
    """Return whether all columns are linearly independent, rounding errors aside."""
    singular = singular_values(R)
    return bool(R.shape[0] == R.shape[1] and singular[-1] > singular[0] / _WORST)


def _log_condition(R: Array) -> float:
    singular = singular_values(R)
    return float(np.log(singular[0] / singular[-1]))


def _smooth_condition(R: Array) -> tuple[float, Array]:
    """Return the smooth log condition number (16), over the largest and smallest few sigma."""
    _, singular, right = _safely(np.linalg.svd, R)
    # d log sigma = u^T dH v / sigma = (H v)^T dH v / sigma^2, so S = v v^T / sigma^2
    value, slope = 0.0, np.zeros_like(R)
    for sign, picked in ((1.0, slice(None, _NEIGHBOURS)), (-1.0, slice(-_NEIGHBOURS, None))):
        part, shares = _smooth_maximum(sign * np.log(singular[picked]))
        value += part
        slope += (right[picked].T * (sign * shares / singular[picked] ** 2)) @ right[picked]
    return value, slope


def _log_mean_error(R: Array) -> float:
    """Return the log of the geometric mean of the confidence ellipsoid's axes (D-optimality)."""
    # -log det(H^T H) / 2p = -mean(log |R_ii|) (Fedorov 1972)
    return float(-np.mean(np.log(np.abs(np.diag(R)))))


def _smooth_mean_error(R: Array) -> tuple[float, Array]:
    inverse = _inverse(R)  # d log det(H^T H) / 2 = trace((H^T H)^-1 H^T dH)
    return _log_mean_error(R), -(inverse @ inverse.T) / len(R)


def _log_worst_error(R: Array) -> float:
    """Return the log of the largest standard error; columns are scaled by parameter size."""
    return float(np.log(np.linalg.norm(_inverse(R), axis=1).max()))


def _smooth_worst_error(R: Array) -> tuple[float, Array]:
    inverse = _inverse(R)
    covariance, errors = inverse @ inverse.T, np.linalg.norm(inverse, axis=1)
    value, shares = _smooth_maximum(np.log(errors))
    # with P = (H^T H)^-1: d P = -P (dH^T H + H^T dH) P, and d log error_i = d P_ii / (2 P_ii)
    return value, -(covariance * (shares / errors**2)) @ covariance


def _inverse(R: Array) -> Array:
    return np.asarray(_safely(solve_triangular, R, np.eye(len(R)), check_finite=False))


def _smooth_maximum(values: Array) -> tuple[float, Array]:
    """Return a smooth maximum of values (k,) and its derivative by each."""
    # max + log(sum exp(s (x - max))) / s, at most log(k) / s above the maximum
    # (Kreisselmeier and Steinhauser 1979)
    shares = np.exp(_SHARPNESS * (values - values.max()))
    total = float(shares.sum())
    return float(values.max()) + np.log(total) / _SHARPNESS, shares / total


CriterionName = Literal["condition_number", "d_optimality", "relative_error"]

CRITERIA: dict[CriterionName, Criterion] = {
    "condition_number": Criterion("condition number", _log_condition, _smooth_condition),
    "d_optimality": Criterion("mean standard error", _log_mean_error, _smooth_mean_error),
    "relative_error": Criterion(
        "worst relative standard error", _log_worst_error, _smooth_worst_error, needs_nominal=True
    ),
}
"""The condition number (16); D-optimality, as the geometric mean of the standard errors along the
axes of the confidence ellipsoid; and the largest standard error over the size of its parameter."""


_safely_grouped = partial(safely, what="the base parameters", error=ExcitationError)

_DRAWS = 16
_LEFT = 1e-6
"""Relative decrease of a column's weight in the pivoting, from each column to the next on its
right. Columns with equal residual norms occur in every robot; without these weights rounding errors
would choose between them, and the choice would depend on the processor."""

_ALIKE = 1e-6
"""Relative difference below which condition numbers count as equal."""


def pivoted_base(
    robot: Robot,
    torque_joints: str | Sequence[str] | None = None,
    stance: Sequence[str] | None = None,
) -> BaseParameters:
    """Return the base parameters whose columns QR with column pivoting picks at random states.

    The pivoting (Businger and Golub 1965) is repeated over 16 draws of states, because the
    condition number of the picked columns varies by a factor of two or three; the columns with the
    smallest condition number over all states are returned. Their number is the rank of
    `base_parameters`, and their groupings follow from its. The choice depends on the robot, on
    `torque_joints` and, for a floating base, on the contacts in `stance` alone. Raises
    ExcitationError if nothing is identifiable.
    """
    stances = ((),) if stance is None else (tuple(stance),)
    leftmost = base_parameters(robot, torque_joints=torque_joints, stances=stances)
    known = [robot.index(joint) for joint in robot.selected(torque_joints)]
    draws = [_random_rows(robot, known, draw, stances) for draw in range(_DRAWS)]
    columns = _best_pivots(draws, len(leftmost.columns))
    # H theta = H_left G theta and H_picked = H_left G_picked: the grouping is G_picked^-1 G
    grouping = _safely_grouped(np.linalg.solve, leftmost.grouping[:, columns], leftmost.grouping)
    grouping[:, columns] = np.eye(len(columns))
    grouping[np.abs(grouping) < 1e-11 * np.abs(grouping).max()] = 0.0
    return base_of_columns(robot, columns, np.asarray(grouping, dtype=np.float64), leftmost.gap)


def _random_rows(
    robot: Robot, known: list[int], seed: int, stances: Sequence[Sequence[str]]
) -> Array:
    ((_, whole, reduced),) = body_equations(robot).random_rows(known, stances, (), seed)
    Y = reduced(whole)
    return np.where(robot.is_known, 0.0, Y).reshape(-1, robot.parameters.size)


def _best_pivots(draws: list[Array], rank: int) -> list[int]:
    """Return the columns of the best conditioned pivoting; the first one among equals."""
    from scipy.linalg import qr

    # H = Q R over all draws: columns of R are conditioned as those of H
    R: Array = qr(np.concatenate(draws), mode="r")[0][: draws[0].shape[1]]
    weights = 1.0 - _LEFT * np.arange(R.shape[1])
    pivots = (qr(H * weights, mode="r", pivoting=True)[1] for H in draws)
    picked: list[list[int]] = [sorted(order[:rank].tolist()) for order in pivots]
    condition = np.array([_safely_grouped(np.linalg.cond, R[:, columns]) for columns in picked])
    return picked[int(np.argmax(condition <= (1 + _ALIKE) * np.min(condition)))]


States = tuple[Array, Array, Array]
"""Joint position, velocity and acceleration, each (T, n)."""


def _in_model(robot: Robot, states: States) -> States:
    q, v, a = (robot.to_model(state, order) for order, state in enumerate(states))
    return q, v, a


def regressor_gradient(
    robot: Robot, states: States, rows: Sequence[int], weights: Array
) -> tuple[Array, Array, Array]:
    """Return the gradient of sum_t sum_r Y_t[rows[r]] . weights[t, r] by q, v and a, each (T, n).

    `weights` (T, r, 10N) weight the entries of the standard regressor Y. Y_t[row] . w is the torque
    of one joint of a robot with the parameters w, so the gradient takes one pass of Pinocchio's
    derivatives (Carpentier and Mansard 2018) per row, whatever the number of parameters.
    """
    model, ordered = robot.model.copy(), _in_model(robot, states)
    # q_model = G q + constant, so that a row of the robot is a sum of rows of the model
    G = robot.to_model(np.eye(robot.n), 1).T
    parts = [
        (r, position, float(G[position, row]))
        for r, row in enumerate(rows)
        for position in np.flatnonzero(G[:, row]).tolist()
    ]
    bodies = weights.reshape(*weights.shape[:2], model.nv, 10)[:, :, list(robot.model_order)]
    # Pinocchio needs bodies with positive mass: equal masses are added to all bodies, and their
    # torques, which are linear in the parameters, are subtracted again
    mass = 2.0 * max(float(np.abs(weights).max(initial=0.0) * np.abs(G).max()), 1e-12)
    for body in range(model.nv):
        model.inertias[body + 1] = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
    positions = [position for _, position, _ in parts]
    total = -slopes_of_model(model, ordered)[:, :, positions].sum(axis=2)
    for r, position, factor in parts:
        felt = [joint - 1 for joint in model.subtrees[position + 1]]
        subtree = factor * bodies[:, r, felt]
        # after the factor, because the torques of the equal masses are subtracted without it
        subtree[:, :, 0] += mass
        total += _row_derivatives(model, ordered, position, subtree)
    gradient = robot.from_model(total)
    return gradient[0], gradient[1], gradient[2]


def _row_derivatives(model: pin.Model, states: tuple[Array, ...], row: int, bodies: Array) -> Array:
    """Return d tau_row / d (q, v, a), (3, T, n), in the order of the model.

    `bodies` (T, b, 10) are the parameters of the b bodies of the row's subtree at every instant.
    """
    model, n = model.copy(), model.nv
    data, inertias = model.createData(), model.inertias
    compute, inertia_of = pin.computeRNEADerivatives, pin.Inertia.FromDynamicParameters
    compute(model, data, *np.zeros((3, n)))
    # views of the row, in memory that Pinocchio overwrites at every instant; of the mass matrix it
    # fills only the upper triangle
    views = (data.dtau_dq[row], data.dtau_dv[row], data.M[:row, row], data.M[row, row:])
    felt, together = list(model.subtrees[row + 1]), np.concatenate
    table = np.empty((len(bodies), 3 * n))
    for subtree, out, q, v, a in zip(bodies, table, *states, strict=True):
        for joint, parameters in zip(felt, subtree, strict=True):
            inertias[joint] = inertia_of(parameters)
        compute(model, data, q, v, a)
        together(views, out=out)
    return table.reshape(-1, 3, n).swapaxes(0, 1)
