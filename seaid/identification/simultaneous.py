"""Both sides of the springs at once: (7) and (8) in one regression that shares each spring.

In the two-step method (7) alone determines the spring. Here the load side does too: (8) gives the
ratio of stiffness and inertia, the motor torques give their scale. This needs two corrections.

(8) of an elastic joint reads 0 = Y beta - r_L (k d + f_0). With noise in the deflection d least
squares reduces k, and with k also beta. The deflection is the observation there, so its column is
replaced by the prediction of the load side and the noise is moved to the left-hand side:
full-information maximum likelihood in its instrumental form (Hausman 1975), iterated.

(7) and (8) of one joint share the noise of d and of the joint's acceleration. Generalised least
squares (Zellner 1962) adds that multiple of (8) to (7) by which their residuals are uncorrelated:
r_M/(N r_L), in which the spring cancels, for noise in d alone, and zero for noise in the
acceleration alone. The residuals determine the value between. The spring cancels only if reversals
count for nothing in both, so that there is a second (8) for this, which is not an equation of its
own.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from seaid._arrays import Array, IndexArray, safely
from seaid.checks.tolerances import SURE
from seaid.checks.values import noise_findings
from seaid.drives import ParameterName, readable
from seaid.errors import ExcitationError, IdentificationError, listed
from seaid.estimation import Estimate, Estimator, FittedRows, least_squares
from seaid.estimation.fitting import Rows
from seaid.estimation.qr_factor import qr_factor_of
from seaid.identification.datasets import rows_in_memory
from seaid.identification.drive_estimates import with_shared_parameters, without_torque
from seaid.identification.stacked_fits import (
    LOAD,
    TORQUE_OFFSET,
    FitsInTurn,
    RobotEstimate,
    offset_lever,
    spring_of,
)
from seaid.identification.two_step import Condition, Procedure, nonlinear_springs
from seaid.log import Motion
from seaid.regressor import Regression, actuator_regression, load_regression
from seaid.regressor.load import LoadModel
from seaid.regressor.regression import actuator_equation, known_friction, spring_regressor, stacked
from seaid.robot import Robot

MOST_ITERATIONS = 50
"""Iterations after which an estimate is refused, since it does not converge."""

SETTLED = 1e-3
"""Part of a standard error below which a change of the estimate is negligible."""

_ROUNDING = 1e-11
"""Part of the torque below which a change is negligible too, for logs without noise."""

_HARMLESS, _PATIENCE = 1e-7, 10
"""The same after so many iterations, from which half as many accelerate one: without noise
standard errors are too small to converge to."""

_SPRING = ("stiffness", "spring_offset")


def simultaneous_regression(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Collection[str],
    offsets: Collection[str] = (),
) -> Regression:
    """Return both sides over time: the columns of the elastic drives, then those of the load.

    Columns: '<parameter> of <joint>' of every elastic joint in the robot's order, then those of
    `model`. `springs` names the joints of the model whose torque on the load is that of the
    spring; the others take it from the log. The motor torque of the joints `offsets` has an unknown
    constant error.

    `joint` is the index of the equation: i is (8) of joint i; n + i its motor equation (7), or (4b)
    if only the spring's torque was measured; 2 n + i is (8) where the friction in (7) is known,
    which `whitened` subtracts. Motor equations exclude the instants near standstill. The rows are
    solved by `settled`, since plain least squares is biased. Raises LogError if a torque is
    missing.
    """
    zero = without_torque(robot, [joint for joint in model.torque_joints if joint in springs])
    actuators = {joint: actuator_regression(robot, motion, joint) for joint in robot.elastic_joints}
    actuators |= {joint: _with_torque_offset(robot, actuators[joint], joint) for joint in offsets}
    names = [ParameterName(name, joint) for joint, x in actuators.items() for name in x.names]
    units = tuple(unit for rows in actuators.values() for unit in rows.units)

    def load_rows(motion: Motion) -> Regression:
        load = load_regression(robot, motion, model, zero)
        return replace(
            load,
            names=(*names, *load.names),
            units=units + load.units,
            H=np.hstack([_spring_columns(robot, load, zero, names), load.H]),
            # The springs are parameters of these rows: no error of theirs is propagated.
            propagated=np.empty((len(load.y), 0)),
        )

    load = load_rows(motion)
    motors = [_motor_rows(robot, rows, joint, load) for joint, rows in actuators.items()]
    concurrent = load_rows(_with_motor_friction(robot, motion, zero))
    concurrent = concurrent.at(np.isin(concurrent.joint, list(map(robot.index, zero))))
    concurrent = replace(concurrent, joint=2 * robot.n + concurrent.joint, excluded=0)
    both = stacked([load, *motors, concurrent])
    return replace(both, run=np.zeros(len(both.y)))  # rows of one log


def _with_motor_friction(robot: Robot, motion: Motion, joints: Iterable[str]) -> Motion:
    """Return the motion in whose (8) friction is known only where it is in (7) too."""
    known = np.full_like(motion.joint_position, np.nan)
    if motion.friction_known is not None:
        known[:] = motion.friction_known
    for joint in joints:
        index = robot.index(joint)
        regressor, _ = actuator_equation(robot, motion, joint)
        known[:, index] = known_friction(robot, motion, joint, regressor)
    return replace(motion, friction_known=known)


def _with_torque_offset(robot: Robot, actuator: Regression, joint: str) -> Regression:
    """Return the motor equation of a joint with the column of an error b_0 of its torque."""
    # (7) has s = f_0 + b_0 N/r_M in the place of the spring offset f_0, which (8) has alone.
    column = actuator.H[:, actuator.names.index("spring_offset")] * offset_lever(robot, joint)
    return actuator.with_columns([TORQUE_OFFSET], ["N m"], column)


def _spring_columns(
    robot: Robot, load: Regression, springs: Collection[str], names: Sequence[str]
) -> Array:
    """Return the columns of the springs' parameters in (8), among those of the drives."""
    columns, start = np.zeros((len(load.y), len(names))), 0
    for joint in springs:
        for name in spring_regressor(robot, joint).names:
            # y + T s = Y beta, from rows without the torque of the springs: -T is the column of s.
            columns[:, names.index(ParameterName(name, joint))] = -load.propagated[:, start]
            start += 1
    return columns


def _motor_rows(robot: Robot, actuator: Regression, joint: str, load: Regression) -> Regression:
    """Return the motor equation of a joint in the columns of `load`."""
    H = np.zeros((len(actuator.y), len(load.names)))
    H[:, [load.names.index(ParameterName(name, joint)) for name in actuator.names]] = actuator.H
    return replace(
        actuator, names=load.names, units=load.units, H=H, joint=robot.n + actuator.joint
    )


def whitened(robot: Robot, rows: Regression, theta: Array) -> Regression:
    """Return the rows as weighted least squares may solve them, near `theta`.

    In (8) the deflection is replaced by its prediction, in column and y alike, so that the residual
    at `theta` is unchanged; from the motor equation of the joint the part of its residual that is
    correlated with that of (8) is removed. The second (8) of each joint is not among them.
    """
    H, y, propagated = rows.H.copy(), rows.y.copy(), rows.propagated.copy()
    residual = rows.y - rows.H @ theta
    for stiffness, offset, load, motor, concurrent in _springs(robot, rows):
        # The column of k is -r_L d. With e = y - H theta it becomes -r_L d + e/k = -r_L d^, with
        # the deflection d^ that (8) predicts at theta; y + e keeps the residual at theta.
        for equation in (load, concurrent):
            H[equation, stiffness] += residual[equation] / theta[stiffness]
            y[equation] += residual[equation]
        lever = -(rows.H[motor, offset] / rows.H[concurrent, offset])[:, None]  # r_M / (N r_L)
        shared = lever[:, 0] * residual[concurrent]
        power = float(shared @ shared)
        # e_M = -c lever e_L + rest, by regression: c is 1 if the residuals are noise of d alone, in
        # which (7) and (8) have opposite signs, and 0 if (7) has none of the noise of (8).
        in_deflection = np.clip(-(residual[motor] @ shared) / power, 0.0, 1.0) if power else 1.0
        for new, old in ((H, rows.H), (y[:, None], rows.y[:, None]), (propagated, rows.propagated)):
            # (7) + c lever (8), but with the measured d of (7) cancelled by that of the old (8):
            # the part 1 - c of the spring's torque comes back with the predicted d^ of the new (8).
            spring_free = old[motor] + lever * old[concurrent]
            new[motor] = spring_free - (1 - in_deflection) * lever * new[concurrent]
    return replace(rows, H=H, y=y, propagated=propagated).at(rows.joint < 2 * robot.n)


def _springs(
    robot: Robot, rows: Regression
) -> list[tuple[int, int, IndexArray, IndexArray, IndexArray]]:
    """Return for each spring in (8) the columns of its stiffness and offset, and sets of rows.

    The rows of (8), those of the motor equation, and those of the second (8) at their instants.
    """
    # One complex number per row: numpy sorts by the real part (log) first, then by time.
    springs, instant = [], rows.run + 1j * rows.time
    for joint in robot.elastic_joints:
        names = [ParameterName(name, joint) for name in _SPRING]
        if not set(names) <= set(rows.names):
            continue
        stiffness, offset = map(rows.names.index, names)
        index = robot.index(joint)
        # A joint whose torque on the load was measured has no spring in (8): its column is zero.
        load = np.flatnonzero((rows.joint == index) & (rows.H[:, offset] != 0))
        motor = np.flatnonzero(rows.joint == robot.n + index)
        again = np.flatnonzero(rows.joint == 2 * robot.n + index)
        if len(load):
            motor = motor[np.isin(instant[motor], instant[again])]
            concurrent = again[np.searchsorted(instant[again], instant[motor])]
            springs.append((stiffness, offset, load, motor, concurrent))
    return springs


Estimation = Callable[[Regression, Array], Estimate]
"""An estimate from whitened rows, and the values (p,) near which they were whitened."""


def estimation(estimator: Estimator, propagated: Array | None = None) -> Estimation:
    """Return how an estimator solves whitened rows.

    "wls" weights them by their residuals at the present values. Weights that settle in every
    iteration have two solutions where the model lacks an effect at one joint, with the equation of
    a neighbour fitted exactly or not, and the iteration would alternate between them.
    """
    if estimator.weigh is not least_squares.settled_weights:
        return lambda rows, theta: estimator.solve(rows, propagated)

    def reweighted(rows: Regression, theta: Array) -> Estimate:
        parts = least_squares.factored(rows, propagated)
        return least_squares.estimate_of_rows(parts, least_squares.weights_at(parts.whole, theta))

    return reweighted


def settled(
    robot: Robot, rows: Regression, start: Array, estimate: Estimation
) -> tuple[Estimate, int]:
    """Solve rows of `simultaneous_regression` from a start (p,), such as the two-step estimate.

    `estimate` is that of `estimation`. Iterated until no parameter changes by more than a small
    part of its standard error; also returns the number of iterations. A slow iteration, as of
    weights that hardly matter, is accelerated (Anderson 1965). Raises IdentificationError if it
    does not converge.
    """
    theta, last = np.array(start, dtype=float), list[tuple[Array, Array]]()
    stiffness = [column for column, *_ in _springs(robot, rows)]
    if np.any(theta[stiffness] == 0):
        raise IdentificationError("the start has a stiffness of zero, which predicts no deflection")
    for iteration in range(1, MOST_ITERATIONS + 1):
        new = estimate(whitened(robot, rows, theta), theta)
        moved = np.abs(new.values - theta)
        seen = np.linalg.norm(rows.H @ (new.values - theta))
        negligible = _ROUNDING if iteration < _PATIENCE else _HARMLESS
        # Without noise the standard errors are rounding, which no step can be small against.
        exact = seen <= negligible * np.linalg.norm(rows.H @ new.values)
        if exact or np.all(moved <= SETTLED * new.standard_errors):
            return new, iteration
        before, after = theta, new.values.copy()
        # step in 1/k, in which the prediction is linear: 1/k_new = (2 - k/k_old) / k_old
        after[stiffness] = before[stiffness] / (2 - after[stiffness] / before[stiffness])
        theta, last = after, [*last[-_PATIENCE // 2 :], (after, after - before)]
        if iteration >= _PATIENCE:
            scale = np.where(new.standard_errors > 0, new.standard_errors, 1.0)
            theta = _accelerated(np.array(last) / scale) * scale
    worst = int(np.argmax(moved / new.standard_errors))
    raise IdentificationError(
        f"both sides at once did not converge in {MOST_ITERATIONS} iterations: "
        f"{new.names[worst]} still changes by {moved[worst]:.2g} {new.units[worst]}; move that "
        'joint more, or use method="two-step"',
        'method="two-step"',
    )


def _accelerated(last: Array) -> Array:
    """Return where iterations (m, 2, p) lead that came to points by steps, in comparable units.

    It is that combination of the points, of which a combination of the steps is least.
    """
    changes = np.diff(last, axis=0)
    system = changes[:, 1].T, last[-1, 1], _ROUNDING
    mixture = safely(np.linalg.lstsq, *system, what="the steps of both sides at once")[0]
    return np.asarray(last[-1, 0] - mixture @ changes[:, 0])


def estimate_supported(
    condition: Condition,
    start: RobotEstimate,
    lacking: Collection[tuple[str, str]],
    estimate: Callable[[], RobotEstimate],
) -> RobotEstimate:
    """Return the `estimate` of both sides at once if the data support it, else that of two steps.

    Both at once is the more accurate one, and the first to be wrong where (7) or (8) lacks a term:
    it then biases the spring that both share. It is not used if the equations are `lacking`
    something, by (code, joint), and not if its values are outside the intervals of two steps, whose
    motor equation alone determines the springs (Hausman 1978). `not_shared` of the result says why.
    """
    if not start.springs:
        return start
    if reason := _obstacle(condition, start, lacking):
        return replace(start, not_shared=reason)
    try:
        both = estimate()
    except (IdentificationError, ExcitationError):
        return replace(start, not_shared="no estimate of both sides at once was found")
    reason = _contradiction(start, both) or _noise(start, both)
    return replace(start, not_shared=reason) if reason else both


def _obstacle(
    condition: Condition, start: RobotEstimate, lacking: Collection[tuple[str, str]]
) -> str:
    """Return why both sides at once are not even tried, "" if they are."""
    robot = condition.robot
    if not robot.base_is_held:
        return "the base floats"
    if not all(isinstance(dataset, Motion) for dataset in condition.datasets):
        return "a log is read in pieces"
    if lacking:
        return f"the equations lack something ({_named(lacking)})"
    return next(AT_ONCE.limits(robot, [*start.springs]), "")


def _named(findings: Iterable[tuple[str, str]]) -> str:
    """Return findings (code, joint) in words; those of the whole robot have no joint."""
    return listed(
        dict.fromkeys(f"{code} at {joint}" if joint else code for code, joint in findings)
    )


def _contradiction(first: RobotEstimate, both: RobotEstimate) -> str:
    """Return the parameter for which both sides at once contradict two steps, "" without one."""
    # Var(theta_2 - theta_s) = Var(theta_2) - Var(theta_s) <= Var(theta_2) if the model is complete,
    # theta_s then being the efficient estimate (Hausman 1978).
    moved = both.moved_from(first)
    # Of a log whose estimates have no errors nothing contradicts.
    if max(moved.values(), default=0.0) <= SURE:
        return ""
    name, z = max(moved.items(), key=lambda item: item[1])
    by = f"{readable(name)} by {z:.2g} standard errors"
    return f"the load side contradicts the motor equations ({by})"


def _noise(first: RobotEstimate, both: RobotEstimate) -> str:
    """Return what the residual of both sides at once shows and that of two steps does not."""
    before = [first.load, *(side.estimate for side in first.actuators.values())]
    known = {(x.code, x.joint) for estimate in before for x in noise_findings(estimate)}
    shown = {(x.code, x.joint): x for x in noise_findings(both.load) if x.severity != "note"}
    new = [key for key in shown if key not in known]
    return f"the residual of both sides at once shows {_named(new)}" if new else ""


def estimate_simultaneous(
    condition: Condition, start: RobotEstimate, estimator: Estimator
) -> RobotEstimate:
    """Estimate both sides at once; `whole` has the covariance between them.

    Raises IdentificationError if the iteration does not converge, and for springs that cannot be
    shared.
    """
    robot, springs = condition.robot, tuple(start.springs)
    AT_ONCE.check(robot, springs)
    offsets = [joint for joint in springs if TORQUE_OFFSET in start.drives[joint].names]
    regress = partial(
        simultaneous_regression, model=condition.model, springs=springs, offsets=offsets
    )
    rows = rows_in_memory(condition.datasets, {LOAD: partial(regress, robot)})[LOAD]
    values, nothing = _values(rows, start), np.zeros((0, 0))
    return _estimated(condition, start, estimator, regress, values, rows, nothing)


AT_ONCE = Procedure(
    option='method="simultaneous"',
    limits=partial(nonlinear_springs, {*_SPRING}),
    only="shares springs of unknown stiffness and offset",
    instead='use method="two-step"',
    held="without contact forces each equation has the deflections of several springs",
    continued=estimate_simultaneous,
)


def _estimated(
    condition: Condition,
    start: RobotEstimate,
    estimator: Estimator,
    regress: Callable[[Robot, Motion], Regression],
    values: Array,
    rows: Regression,
    errors: Array,
) -> RobotEstimate:
    """Return the estimate of both sides near values (p,), from rows with propagated columns.

    `errors` (k, k) is the covariance of these.
    """
    robot, model, propagated = condition.robot, condition.model, errors if len(errors) else None
    free, _ = settled(robot, rows, values, estimation(estimator, propagated))
    # Weights, drift and checks belong to the whitened rows at the solution: residuals of the plain
    # ones are correlated between (7) and (8).

    def change(rows: Regression) -> Regression:
        return estimator.effective_rows(whitened(robot, rows, free.values), free)

    solved, whole = change(rows), free
    qr_factor, equal = qr_factor_of(solved), estimator.weigh is least_squares.equal_weights
    weights = least_squares.weights_at(qr_factor, free.values)
    if estimator.weigh is least_squares.settled_weights:
        solution = least_squares.solve(qr_factor, weights)
        cutoff_hz = condition.datasets[0].cutoff_hz
        whole = least_squares.with_drifts_of(solved, weights, solution, free, cutoff_hz)
    both = FittedRows(whole, qr_factor, solved, propagated, weights, equal, change)
    both = with_shared_parameters(robot.drives, both)
    whole = both.estimate
    of_joints = whole.by_owner()
    drives = {joint: of_joints[joint] for joint in robot.joint_names if joint in of_joints}
    of_drives = [name for name in whole.names if name not in model.expressions]
    optional = [name for name in of_drives if name.quantity not in _SPRING]

    def refit(rows: Rows, errors: Array) -> FittedRows:
        assert isinstance(rows, Regression)
        return _estimated(condition, start, estimator, regress, free.values, rows, errors).fit

    return RobotEstimate(
        model=model,
        drives=drives,
        load_side=whole.of_names(model.names),
        springs={x: spring_of(robot, drives[x], x).values for x in start.springs},
        excluded=start.excluded,
        checks={"both": both.checks(optional)},
        fit=both,
        fits=FitsInTurn(robot, {}, (), load=both, refit=refit),
        whole=whole,
        regress=regress,
    )


def _values(rows: Regression, start: RobotEstimate) -> Array:
    """Return the two-step estimate in the columns of the rows."""
    known: dict[str, float] = {}
    for joint, drive in start.drives.items():
        known |= drive.at(joint).by_name
    known |= start.load_side.by_name
    return np.array([known[name] for name in rows.names])
