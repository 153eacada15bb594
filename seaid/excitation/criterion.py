"""How much a motion tells: log of the condition number (16) of the stacked regressor (15)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from seaid.arrays import Array
from seaid.base import BaseParameters, base_of_columns, base_parameters, random_states
from seaid.errors import ExcitationError
from seaid.inertia import to_pinocchio
from seaid.rigid_body import rigid_body_regressor
from seaid.robot import Robot

_DRAWS = 16
_WORST = 1e12
"""A condition number above this is rounding: the motion does not tell all parameters."""
_SHARPNESS, _NEGLIGIBLE = 32.0, 1e-9


@dataclass(frozen=True, eq=False)
class Criterion:
    """Whose parameters a motion shall tell: a robot, the joints with known torque, base columns.

    Planning needs the geometry alone, so the robot is kept without parameters and drives; that also
    lets it go to other processes.
    """

    robot: Robot
    rows: tuple[int, ...]
    columns: tuple[int, ...]


def make_criterion(robot: Robot, rows: Sequence[str] | None, base: BaseParameters) -> Criterion:
    """Return the criterion of a robot for base columns and the joints whose torques are known."""
    bare = replace(robot.with_values(np.zeros(10 * robot.n), robot.drivetrains), drivetrains={})
    return Criterion(bare, tuple(map(robot.index, robot.rows(rows))), base.columns)


def pivoted_base(robot: Robot, rows: Sequence[str] | None = None) -> BaseParameters:
    """Return the base parameters whose columns QR with column pivoting picks at random states.

    The pivoting (Businger and Golub 1965) is repeated over 16 draws of states; the columns kept are
    those with the smallest condition number over all states drawn, for it differs by a factor of
    two or three between draws. How many columns there are is the rank that `base_parameters` finds;
    the groupings are its own, solved for these columns. The choice depends on the robot and on
    `rows` alone. Raises ExcitationError where nothing is identifiable.
    """
    leftmost = base_parameters(robot, rows=rows)
    known = [robot.index(joint) for joint in robot.rows(rows)]
    draws = [_random_rows(robot, known, draw) for draw in range(_DRAWS)]
    columns = _best_pivots(draws, len(leftmost.columns))
    grouping = np.linalg.solve(leftmost.grouping[:, columns], leftmost.grouping)
    grouping[:, columns] = np.eye(len(columns))
    grouping[np.abs(grouping) < 1e-11 * np.abs(grouping).max()] = 0.0
    return base_of_columns(robot, columns, np.asarray(grouping, dtype=np.float64), leftmost.gap)


def _random_rows(robot: Robot, known: list[int], seed: int) -> Array:
    Y = rigid_body_regressor(robot, *random_states(robot, seed, len(known)))[:, known]
    return Y.reshape(-1, 10 * robot.n)


def _best_pivots(draws: list[Array], rank: int) -> list[int]:
    """Return the columns of the one pivoting whose pick is best conditioned over all draws."""
    from scipy.linalg import qr

    R: Array = qr(np.concatenate(draws), mode="r")[0][: draws[0].shape[1]]
    pivots = (qr(H, mode="r", pivoting=True)[1] for H in draws)
    picked: list[list[int]] = [sorted(order[:rank].tolist()) for order in pivots]
    return min(picked, key=lambda columns: float(np.linalg.cond(R[:, columns])))


def condition_number(criterion: Criterion, q: Array, v: Array, a: Array) -> float:
    """Return sigma_max / sigma_min (16) of the stacked base regressor (15) over states (T, n).

    The columns are not scaled. Infinite where the motion does not tell all base parameters.
    """
    singular = _singular(_stacked(criterion, q, v, a))[0]
    return float(singular[0] / singular[-1]) if singular[-1] > singular[0] / _WORST else np.inf


def log_condition(
    criterion: Criterion, q: Array, v: Array, a: Array, *, neighbours: int = 1
) -> tuple[float, tuple[Array, Array, Array]]:
    """Return log kappa (16) and its exact gradient with respect to q, v and a, each (T, n).

    With H v = sigma u, d sigma = sum_t u_t^T d(Y_t v), and Y_t v is the inverse dynamics of a robot
    whose parameters are the singular vector v. The gradient jumps where two singular values meet,
    and there the best motions lie. More `neighbours` take that many of the largest and of the
    smallest singular values together, as a smooth maximum of log sigma (Kreisselmeier and
    Steinhauser 1979): at most 2 log(neighbours) / 32 more than log kappa. Raises ExcitationError
    where the motion does not tell all base parameters.
    """
    H = _stacked(criterion, q, v, a)
    singular, right = _singular(H)
    if not singular[-1] > singular[0] / _WORST:
        raise ExcitationError(
            f"this motion does not tell all {len(criterion.columns)} base parameters: condition "
            "number infinite; give more samples or coefficients, or wider limits"
        )
    value, pairs = 0.0, []
    for sign, order in ((1.0, slice(None, neighbours)), (-1.0, slice(-neighbours, None))):
        logs = sign * np.log(singular[order])
        shares = np.exp(_SHARPNESS * (logs - logs.max()))
        value += logs.max() + np.log(shares.sum()) / _SHARPNESS
        shares /= shares.sum()
        for share, sigma, vector in zip(shares, singular[order], right[order], strict=True):
            if share > _NEGLIGIBLE:
                pairs.append(_pair(criterion, H, vector, sign * share / sigma**2))
    return value, torque_gradient(criterion.robot, (q, v, a), pairs)


def _pair(criterion: Criterion, H: Array, vector: Array, factor: float) -> tuple[Array, Array]:
    """Return factor * H v as torques (T, n) and v as standard parameters (10n,)."""
    n = criterion.robot.n
    torques = (H @ vector).reshape(-1, len(criterion.rows))
    u, theta = np.zeros((len(torques), n)), np.zeros(10 * n)
    u[:, criterion.rows] = factor * torques
    theta[list(criterion.columns)] = vector
    return u, theta


def torque_gradient(
    robot: Robot, states: tuple[Array, Array, Array], pairs: Sequence[tuple[Array, Array]]
) -> tuple[Array, Array, Array]:
    """Return the gradient of sum over pairs (u, theta) of sum_t u_t^T Y_t theta, by q, v and a.

    u (T, n) weights the joint torques of standard parameters theta (10n,). Pinocchio needs bodies
    with mass; torques are linear in theta, so equal masses are added to every pair, and taken off
    again once for all.
    """
    masses = np.zeros(10 * robot.n)
    masses[::10] = 2.0 * max(float(np.abs(theta).max()) for _, theta in pairs)
    weights = np.sum([u for u, _ in pairs], axis=0)
    total = _weighted_derivatives(robot, states, -weights, masses)
    for u, theta in pairs:
        total += _weighted_derivatives(robot, states, u, theta + masses)
    return total[0], total[1], total[2]


def _weighted_derivatives(
    robot: Robot, states: tuple[Array, Array, Array], u: Array, theta: Array
) -> Array:
    """Return sum_t u_t^T d(tau_t) / d(q, v, a), (3, T, n), for the robot with parameters theta."""
    model, order = robot.model.copy(), list(robot.model_order)
    for position, index in enumerate(order):
        model.inertias[position + 1] = to_pinocchio(theta[10 * index : 10 * index + 10])
    data = model.createData()
    q, v, a = (np.ascontiguousarray(state[:, order]) for state in states)
    tables = np.empty((3, len(q), robot.n, robot.n))
    zeros = np.zeros(robot.n)
    pin.computeRNEADerivatives(model, data, zeros, zeros, zeros)
    by_q, by_v, mass_matrix = data.dtau_dq, data.dtau_dv, data.M
    for t in range(len(q)):
        pin.computeRNEADerivatives(model, data, q[t], v[t], a[t])
        tables[0, t], tables[1, t], tables[2, t] = by_q, by_v, mass_matrix
    upper = np.triu(tables[2])  # the mass matrix is sure in its upper triangle only
    tables[2] = upper + np.triu(upper, 1).swapaxes(1, 2)
    gradient = np.empty((3, *u.shape))
    gradient[:, :, order] = np.einsum("ti,xtij->xtj", u[:, order], tables)
    return gradient


def _stacked(criterion: Criterion, q: Array, v: Array, a: Array) -> Array:
    """Return H (T r, p) of (15)."""
    Y = rigid_body_regressor(criterion.robot, q, v, a)
    chosen = Y[:, list(criterion.rows)][:, :, list(criterion.columns)]
    return chosen.reshape(-1, len(criterion.columns))


def _singular(H: Array) -> tuple[Array, Array]:
    """Return the singular values of H, largest first, and its right singular vectors as rows."""
    _, singular, right = np.linalg.svd(np.linalg.qr(H, mode="r"))
    return singular, right
