"""How much a motion tells, from the triangular factor R of its stacked regressor (15).

Each criterion is a number to make small and its slope: a symmetric matrix S (p, p) with which a
change dH of the regressor changes the number by the sum of (H S) * dH. Where the best motions lie
the plain criteria have kinks, so a search uses smooth ones: maxima over several singular values or
parameters (Kreisselmeier and Steinhauser 1979), at most log(several) / 32 above the plain one.

The base columns a condition number is of: picked by QR with column pivoting, once for all.

Derivatives of inverse dynamics and of the regressor, contracted over all samples.

Exact, through Pinocchio's derivatives of the inverse dynamics (Carpentier and Mansard 2018): the
torque of one joint weighted by a parameter vector is the inverse dynamics of a robot that has these
parameters, so a gradient costs one such pass a known torque, however many parameters or trajectory
coefficients there are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin
from scipy.linalg import solve_triangular

from seaid._arrays import Array, safely
from seaid.errors import ExcitationError, unknown_name
from seaid.regressor import (
    BaseParameters,
    base_of_columns,
    base_parameters,
    random_states,
    regressor_at_drives,
)
from seaid.robot import Robot

_safely = partial(safely, what="the regressor of the motion", error=ExcitationError)

_WORST = 1e12
"""A condition number above this is rounding: the motion does not tell all parameters."""

_SHARPNESS, _NEIGHBOURS = 32.0, 4


@dataclass(frozen=True)
class Criterion:
    """A number to make small, as its logarithm.

    `log_value(R)` is what is reported and what motions are compared by; `smooth(R)` returns what a
    search descends, with its slope S. Both need an R that `tells_all`. `meaning` is a noun.
    """

    meaning: str
    log_value: Callable[[Array], float]
    smooth: Callable[[Array], tuple[float, Array]]
    needs_nominal: bool = False


def criterion_named(name: str) -> Criterion:
    """Return the criterion of a name. Raises ExcitationError with the nearest name."""
    if name not in CRITERIA:
        raise ExcitationError(unknown_name("criterion", name, tuple(CRITERIA)))
    return CRITERIA[name]


def triangular_factor(H: Array, known: Array) -> Array:
    """Return R (p, p) with R^T R = H^T H + known^T known."""
    return np.asarray(np.linalg.qr(np.vstack([known, H]), mode="r"))


def singular_values(R: Array) -> Array:
    """Return the singular values of a triangular factor, largest first."""
    return np.asarray(_safely(np.linalg.svd, R, compute_uv=False), dtype=np.float64)


def tells_all(R: Array) -> bool:
    """Tell whether all columns can be told apart, rounding aside."""
    singular = singular_values(R)
    return bool(R.shape[0] == R.shape[1] and singular[-1] > singular[0] / _WORST)


def _log_condition(R: Array) -> float:
    singular = singular_values(R)
    return float(np.log(singular[0] / singular[-1]))


def _smooth_condition(R: Array) -> tuple[float, Array]:
    """Log of (16) by the largest and smallest few: d log sigma = u^T dH v / sigma = (H v)^T..."""
    _, singular, right = _safely(np.linalg.svd, R)
    value, slope = 0.0, np.zeros_like(R)
    for sign, picked in ((1.0, slice(None, _NEIGHBOURS)), (-1.0, slice(-_NEIGHBOURS, None))):
        part, shares = _smooth_maximum(sign * np.log(singular[picked]))
        value += part
        slope += (right[picked].T * (sign * shares / singular[picked] ** 2)) @ right[picked]
    return value, slope


def _log_mean_error(R: Array) -> float:
    """Return -log det(H^T H) / 2p: the log of the geometric mean of the axes of uncertainty."""
    return float(-np.mean(np.log(np.abs(np.diag(R)))))


def _smooth_mean_error(R: Array) -> tuple[float, Array]:
    inverse = _inverse(R)
    return _log_mean_error(R), -(inverse @ inverse.T) / len(R)


def _log_worst_error(R: Array) -> float:
    """Return the log of the largest standard error, of columns scaled by their parameters."""
    return float(np.log(np.linalg.norm(_inverse(R), axis=1).max()))


def _smooth_worst_error(R: Array) -> tuple[float, Array]:
    inverse = _inverse(R)
    covariance, errors = inverse @ inverse.T, np.linalg.norm(inverse, axis=1)
    value, shares = _smooth_maximum(np.log(errors))
    return value, -(covariance * (shares / errors**2)) @ covariance


def _inverse(R: Array) -> Array:
    return np.asarray(_safely(solve_triangular, R, np.eye(len(R)), check_finite=False))


def _smooth_maximum(values: Array) -> tuple[float, Array]:
    """Return a smooth maximum of values (k,) and its derivative by each."""
    shares = np.exp(_SHARPNESS * (values - values.max()))
    total = float(shares.sum())
    return float(values.max()) + np.log(total) / _SHARPNESS, shares / total


CRITERIA = {
    "condition_number": Criterion("condition number", _log_condition, _smooth_condition),
    "d_optimality": Criterion("mean standard error", _log_mean_error, _smooth_mean_error),
    "relative_error": Criterion(
        "worst relative standard error", _log_worst_error, _smooth_worst_error, needs_nominal=True
    ),
}
"""(16); D-optimality (Fedorov 1972), as the geometric mean of the standard errors along the axes of
uncertainty; and the largest expected standard error over the size of its parameter."""


_safely_grouped = partial(safely, what="the base parameters", error=ExcitationError)

_DRAWS = 16
_LEFT = 1e-6
"""How much less every column weighs in the pivoting than its left neighbour. Columns whose parts
outside of those picked before are equally long occur in every robot; without it rounding, and so
the processor, would choose between them."""

_ALIKE = 1e-6
"""Relative difference of condition numbers that does not decide."""


def pivoted_base(robot: Robot, torque_joints: Sequence[str] | None = None) -> BaseParameters:
    """Return the base parameters whose columns QR with column pivoting picks at random states.

    The pivoting (Businger and Golub 1965) is repeated over 16 draws of states; the columns kept are
    those with the smallest condition number over all states drawn, for it differs by a factor of
    two or three between draws. Between equally good columns the left one is picked. How many there
    are is the rank that `base_parameters` finds; the groupings are its own, solved for these
    columns. The choice depends on the robot and on `rows` alone. Raises ExcitationError where
    nothing is identifiable.
    """
    leftmost = base_parameters(robot, torque_joints=torque_joints)
    known = [robot.index(joint) for joint in robot.rows(torque_joints)]
    draws = [_random_rows(robot, known, draw) for draw in range(_DRAWS)]
    columns = _best_pivots(draws, len(leftmost.columns))
    grouping = _safely_grouped(np.linalg.solve, leftmost.grouping[:, columns], leftmost.grouping)
    grouping[:, columns] = np.eye(len(columns))
    grouping[np.abs(grouping) < 1e-11 * np.abs(grouping).max()] = 0.0
    return base_of_columns(robot, columns, np.asarray(grouping, dtype=np.float64), leftmost.gap)


def _random_rows(robot: Robot, known: list[int], seed: int) -> Array:
    Y = regressor_at_drives(robot, *random_states(robot, seed, len(known)))[:, known]
    return np.where(robot.is_known, 0.0, Y).reshape(-1, 10 * robot.n)


def _best_pivots(draws: list[Array], rank: int) -> list[int]:
    """Return the columns of the one pivoting whose pick is best conditioned over all draws.

    Of two that are equal but for rounding it is the first.
    """
    from scipy.linalg import qr

    R: Array = qr(np.concatenate(draws), mode="r")[0][: draws[0].shape[1]]
    weights = 1.0 - _LEFT * np.arange(R.shape[1])
    pivots = (qr(H * weights, mode="r", pivoting=True)[1] for H in draws)
    picked: list[list[int]] = [sorted(order[:rank].tolist()) for order in pivots]
    condition = np.array([_safely_grouped(np.linalg.cond, R[:, columns]) for columns in picked])
    return picked[int(np.argmax(condition <= (1 + _ALIKE) * np.min(condition)))]


States = tuple[Array, Array, Array]
"""Joint position, velocity and acceleration, each (T, n)."""


def torque_derivatives(robot: Robot, states: States) -> Array:
    """Return d tau_i / d (q, v, a)_j of the inverse dynamics, (3, T, n, n), payloads included."""
    model, order = robot.model, list(robot.model_order)
    tables = np.empty((3, len(states[0]), robot.n, robot.n))
    inverse = np.argsort(order)
    by_state = _derivatives(model, tuple(state[:, order] for state in states), slice(None), None)
    tables[:] = by_state[:, :, inverse][:, :, :, inverse]
    return tables


def regressor_gradient(
    robot: Robot, states: States, rows: Sequence[int], weights: Array
) -> tuple[Array, Array, Array]:
    """Return the gradient of sum_t sum_r Y_t[rows[r]] . weights[t, r] by q, v and a, each (T, n).

    `weights` (T, r, 10n) are those of the standard regressor's entries. Pinocchio needs bodies with
    mass; torques are linear in the parameters, so equal masses are added everywhere, and taken off
    again once for all rows.
    """
    model, order, n = robot.model.copy(), list(robot.model_order), robot.n
    positions = [order.index(row) for row in rows]
    ordered = tuple(np.ascontiguousarray(state[:, order]) for state in states)
    bodies = weights.reshape(*weights.shape[:2], n, 10)[:, :, order]
    mass = 2.0 * max(float(np.abs(weights).max(initial=0.0)), 1e-12)
    bodies[:, :, :, 0] += mass
    plain = np.zeros(10)
    plain[0] = mass
    for body in range(n):
        model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(plain)
    total = -_derivatives(model, ordered, positions, None).sum(axis=2)
    for r, position in enumerate(positions):
        total += _derivatives(model, ordered, [position], bodies[:, r])[:, :, 0]
    gradient = np.empty_like(total)
    gradient[:, :, order] = total
    return gradient[0], gradient[1], gradient[2]


def _derivatives(
    model: pin.Model, states: tuple[Array, ...], rows: Sequence[int] | slice, bodies: Array | None
) -> Array:
    """Return d tau[rows] / d (q, v, a), (3, T, rows, n), all in the order of the model.

    `bodies` (T, n, 10) are the parameters at every instant, None for those of the model; only those
    that the one row feels are set.
    """
    data, n = model.createData(), model.nv
    q, v, a = (np.ascontiguousarray(state) for state in states)
    pin.computeRNEADerivatives(model, data, q[0], v[0], a[0])
    by_q, by_v, mass_matrix = data.dtau_dq, data.dtau_dv, data.M
    everything = np.arange(n)[rows]
    tables = np.empty((4, len(q), len(everything), n))
    felt: list[int] = []
    if bodies is not None:
        felt = [joint - 1 for joint in model.subtrees[int(everything[0]) + 1]]
    inertias, inertia_of = model.inertias, pin.Inertia.FromDynamicParameters
    compute = pin.computeRNEADerivatives
    index = int(everything[0]) if len(everything) == 1 else everything
    for t in range(len(q)):
        for body in felt:
            inertias[body + 1] = inertia_of(bodies[t, body])  # type: ignore[index]
        compute(model, data, q[t], v[t], a[t])
        tables[0, t], tables[1, t] = by_q[index], by_v[index]
        tables[2, t], tables[3, t] = mass_matrix[index], mass_matrix.T[index]
    # the mass matrix is sure in its upper triangle only
    upper = np.arange(n)[None, :] >= everything[:, None]
    tables[2] = np.where(upper, tables[2], tables[3])
    return tables[:3]
