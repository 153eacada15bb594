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
from seaid.regressor.base import base_of_columns, body_equations
from seaid.robot import Robot
from seaid.robot.inertia import pseudo_inertia

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


def triangular_factor(H: Array, previous: Array | None = None) -> Array:
    """Return R (p, p) with R^T R = H^T H + P^T P for the factor P of `previous` rows, if any."""
    # H = Q R: factors are added by stacking, and H^T H would square the condition number
    rows = H if previous is None else np.vstack([previous, H])
    return np.asarray(np.linalg.qr(rows, mode="r"))


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
    values = singular_values(triangular_factor(H / norms))
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
        part, shares = smooth_maximum(sign * np.log(singular[picked]))
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
    value, shares = smooth_maximum(np.log(errors))
    # with P = (H^T H)^-1: d P = -P (dH^T H + H^T dH) P, and d log error_i = d P_ii / (2 P_ii)
    return value, -(covariance * (shares / errors**2)) @ covariance


def _inverse(R: Array) -> Array:
    return np.asarray(_safely(solve_triangular, R, np.eye(len(R)), check_finite=False))


def smooth_maximum(values: Array) -> tuple[float, Array]:
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
"""Draws of random states, from each of which columns are picked."""

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
    if not len(leftmost.columns):
        raise ExcitationError("nothing to excite: all bodies are known", "known_bodies=")
    known = [robot.index(joint) for joint in robot.selected(torque_joints)]
    draws = [_random_rows(robot, known, draw, stances) for draw in range(_DRAWS)]
    columns = _best_pivots(draws, len(leftmost.columns))
    # H theta = H_left G theta and H_picked = H_left G_picked: the grouping is G_picked^-1 G
    grouping = _safely_grouped(np.linalg.solve, leftmost.grouping[:, columns], leftmost.grouping)
    grouping[:, columns] = np.eye(len(columns))
    grouping[np.abs(grouping) < 1e-11 * np.abs(grouping).max()] = 0.0
    return base_of_columns(robot.parameter_names, columns, np.asarray(grouping), leftmost.gap)


def _random_rows(
    robot: Robot, known: list[int], seed: int, stances: Sequence[Sequence[str]]
) -> Array:
    ((_, whole, reduced),) = body_equations(robot).random_rows(known, stances, (), seed)
    return np.where(robot.is_known, 0.0, reduced(whole)).reshape(-1, robot.parameters.size)


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


_BLOCK = 64
"""Instants of a block: its arrays are in the cache, and in memory that is used again."""

_UNITS = np.array([pseudo_inertia(unit) for unit in np.eye(10)])
"""Pseudo-inertias (10, 4, 4) of bodies with one of their ten parameters 1 and the others 0."""


def regressor_gradient(robot: Robot, states: States, rows: Sequence[int], weights: Array) -> Array:
    """Return the gradient of f = sum_t sum_r Y_t[rows[r]] . weights[t, r] by states, (3, T, n).

    `weights` (T, r, 10N) weight the entries of the standard regressor Y. Y_t[row] . w is the torque
    of one joint of a robot with the parameters w, so that by the principle of power

        f = sum_b sum_r <K_r P_rb, M_b>    over bodies b and the joints r that carry them,

    where <X, Y> sums the products of the entries of 4x4 matrices: K_r is the twist of a joint, P_rb
    the pseudo-inertia of its weights, and M_b gives the acceleration of any point of the body.
    """
    blocks = [slice(start, start + _BLOCK) for start in range(0, len(weights), _BLOCK)]
    parts = [_gradient(robot, [x[at] for x in states], rows, weights[at]) for at in blocks]
    return np.concatenate(parts, axis=1)


def _gradient(robot: Robot, states: Sequence[Array], rows: Sequence[int], weights: Array) -> Array:
    """Return `regressor_gradient` of a block of instants."""
    N, T = robot.model.nv, len(weights)
    # Joints come first: a sum over those that carry a body, or that it carries, is one product.
    q, v, a = (robot.to_model(x, order).T[..., None, None] for order, x in enumerate(states))
    moves, K, places, carries = _kinematics(robot.model, q)
    V = _summed(carries.T, v * K)
    C = _bracket(V, K)  # dK / dt
    A = _summed(carries.T, a * K + v * C)
    A[..., :3, 3] -= robot.model.gravity.linear
    M = A + V @ V
    # q_model = G q + constant, so that a row of the robot is a sum of rows of the model.
    G = robot.to_model(np.eye(robot.n), 1)[list(rows)]
    row, joint = G.nonzero()
    is_felt = carries[joint].T[:, None, :, None]
    bodies = weights.reshape(T, -1, N, 10).transpose(2, 0, 1, 3)[list(robot.model_order)]
    units = places @ _UNITS @ places.swapaxes(2, 3)
    P = bodies[:, :, row] * (G[row, joint][:, None] * is_felt)
    P = P.reshape(N, -1, 10) @ units.reshape(N, 10, 16)
    # E P E^T at the states. All products have the twists or the bodies of the r rows side by side
    # or on top of each other, (4, 4r) or (4r, 4), because many small products would be slow.
    moved = (P.reshape(N, T, -1, 4) @ moves.swapaxes(2, 3)).reshape(N, T, -1, 4, 4).swapaxes(3, 4)
    P = moved.reshape(N, T, -1, 4) @ moves.swapaxes(2, 3)
    wide = K[joint].transpose(1, 2, 0, 3).reshape(T, 4, -1)
    tall = K[joint].swapaxes(0, 1).reshape(T, -1, 4)
    Q = wide @ P  # df / dM_b
    # f does not depend on the frame. Seen from the bodies that joint k carries, a change of its
    # position turns back the twists of the joints r that carry k, by [K_r, K_k], and changes M_b by
    # [A_k, K_k] + [V_k, C_k] + 2 C_k V_b; one of its speed changes M_b by 2 C_k + 2 K_k V_b, and
    # one of its acceleration by K_k.
    R = _summed(carries, P @ M.swapaxes(2, 3)).reshape(N, T, -1, 4, 4) * is_felt[..., None]
    turned = wide @ R.reshape(N, T, -1, 4) - R.swapaxes(2, 3).reshape(N, T, 4, -1) @ tall
    S = 2 * _summed(carries, Q @ V.swapaxes(2, 3))
    Q = _summed(carries, Q)
    by_q = _inner(Q, _bracket(A, K) + _bracket(V, C)) + _inner(S, C)
    by_q -= _inner(turned, K.swapaxes(2, 3))
    return robot.from_model(np.stack([by_q, 2 * _inner(Q, C) + _inner(S, K), _inner(Q, K)]))


def _kinematics(model: pin.Model, q: Array) -> tuple[Array, Array, Array, Array]:
    """Return how bodies move from q = 0, the twists of joints, places at q = 0, and what carries.

    Motions and twists are (N, T, 4, 4) in the world at positions `q` (N, T, 1, 1), places
    (N, 1, 4, 4). The last array (N, N) is one where a joint carries a body.
    """
    data = model.createData()
    pin.computeJointJacobians(model, data, np.zeros(model.nv))
    # the Jacobian (6, n) is (6,) of one joint
    screws = np.array([pin.Motion(x).homogeneous for x in data.J.reshape(6, -1).T])[:, None]
    places = np.array([place.homogeneous for place in data.oMi.tolist()[1:]])[:, None]
    # exp(K q) = 1 + sin(q) K + (1 - cos(q)) K^2 for a turn, 1 + q K for a shift, of which K^2 = 0
    is_turn = screws[..., :3, :3].any(axis=(2, 3), keepdims=True)
    moves = np.eye(4) + np.where(is_turn, np.sin(q), q) * screws
    moves += (1 - np.cos(q)) * (screws @ screws)
    carries = np.eye(model.nv)
    for joint, parent in enumerate(model.parents.tolist()[1:]):
        if parent:
            moves[joint] = moves[parent - 1] @ moves[joint]
            carries[:, joint] += carries[:, parent - 1]
    back = moves.swapaxes(2, 3).copy()  # E^-1
    back[..., 3, :3] = 0.0
    back[..., :3, 3:] = -back[..., :3, :3] @ moves[..., :3, 3:]
    return moves, moves @ screws @ back, places, carries


def _bracket(X: Array, Y: Array) -> Array:
    return np.asarray(X @ Y - Y @ X)


def _inner(X: Array, Y: Array) -> Array:
    """Return the sums (T, N) of the products of the entries of matrices (N, T, 4, 4)."""
    return np.asarray(np.einsum("ktij,ktij->tk", X, Y))


def _summed(matrix: Array, X: Array) -> Array:
    """Return matrix (N, N) @ X (N, ...), over the first axis."""
    return np.asarray((matrix @ X.reshape(len(X), -1)).reshape(X.shape))
