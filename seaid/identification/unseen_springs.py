"""Start angles and findings for joints whose springs only the motor senses.

The fit itself is `refine` of output_error.py. From (7) the torque on the load follows from the
motor, tau_L = N_t (tau_M - I_M theta_M'' - friction) with the total ratio N_t = N r_L / r_M, and
from (4b) the angle of the joint, q = theta_M / N_t - tau_L / (k r_L^2): nothing is integrated, but
noise of the torque enters (8) with two derivatives. So these angles only start the fit. `refine`
simulates the joints from the motors instead, the one direction in which the equations neither drift
nor depend on dry friction at rest, and compares the motor torques, whose noise no controller feeds
back into the motor angles. Windows shorter than a period of the joint keep the cost smooth far from
the solution (multiple shooting, Bock 1983); longer ones then give the accuracy.
`starts_by_regression` gives the first start, by a search of the compliances.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from seaid._arrays import Array
from seaid.checks.predictions import hidden_springs, motor_side_findings, noisy_springs
from seaid.drives import total_ratio
from seaid.errors import ExcitationError, Finding, IdentificationError, LogError
from seaid.estimation.nonlinear_least_squares import LEAST_STD
from seaid.estimation.qr_factor import RANK_TOLERANCE, scaled_svd
from seaid.identification.two_step import joints_with_torque
from seaid.log import Log, Motion, low_pass, row_samples
from seaid.log.filtering import spline_derivatives
from seaid.log.motion import FEWEST_PERIODS, decimated, reconstruct_motions
from seaid.log.rows import in_band_at
from seaid.regressor.load import LoadModel, load_model_of, load_side
from seaid.regressor.regression import actuator_columns, spring_regressor
from seaid.robot import Robot, at_drives, at_joints
from seaid.robot.transmission import completed
from seaid.simulation.plant import torque_jacobians, with_joints
from seaid.simulation.replaying import FARTHEST

if TYPE_CHECKING:
    from seaid.identification.result import Identification

_BANDS = (0.25, 0.5, 0.125)
"""Parts of the cutoff below which a regression starts the fit. It is a good start where the motion
fills the band, a quarter of the proposed cutoff for a multisine; above are derivatives of noise."""

_TRIED_RATIOS = np.geomspace(0.3, 4.0, 14)
"""Antiresonances that the regression tries, as multiples of the band; the inertia of each is the
apparent one of the motor. Far below the band, the joint angle is a multiple of the torque, and
anything fits."""

_SWEEPS, _WEIGHTINGS, _FACTORS = 3, 3, (0.6, 0.8, 1.25, 1.6)
"""Regressions at a compliance, for its friction, and of joints by their errors; then changes of one
compliance at a time."""

SAMPLES = 8
"""Samples per period of an oscillation that a log shows."""

_OF_SPRING = ("stiffness", "spring_damping", "spring_offset")


def joints_sensed_by_motor_only(robot: Robot, logs: Sequence[Log]) -> tuple[str, ...]:
    """Return the elastic joints of which each log, of all joints, has the motor side only."""
    if not all({*robot.joint_names} <= {*log.joint_names} for log in logs):
        return ()
    return tuple(x for x in robot.elastic_joints if all(_only_motor(log, x) for log in logs))


def _only_motor(log: Log, joint: str) -> bool:
    logged = log.logged(joint).keys()
    is_sensed = bool(logged & {"joint_position", "joint_torque", "deflection"})
    return {"motor_position", "motor_torque"} <= logged and not is_sensed


def with_motor_side_findings(
    refined: Identification, terms: Mapping[str, Mapping[int, Array]], motion: Motion
) -> Identification:
    """Return a refined identification with findings of damped springs or elastic links.

    The model leaves both out.

    `terms` {joint: {order: [value, standard error]}} of joints without a sensor behind the spring
    are torques by derivatives of the deflection: spring damping, and order 2, of an elastic link
    with a part of the inertia J behind it. They are compared with the torque of the spring at its
    antiresonance sqrt(k/J).
    """
    antiresonances_hz, tests = _antiresonances_hz(refined, motion, [*terms]), {}
    for joint, orders in terms.items():
        stiffness, rate = _joint_stiffness(refined, joint), 2 * np.pi * antiresonances_hz[joint]
        # x w_a^order / (k r_L^2): a torque, x times a derivative of the deflection, over that of
        # the spring, at w_a = sqrt(k r_L^2 / J).
        scaled = {order: pair * rate**order / stiffness for order, pair in orders.items()}
        tests[joint] = {order: (float(x), float(error)) for order, (x, error) in scaled.items()}
    others = [
        finding
        for finding in refined.findings
        if finding.code != "gear-compliance"  # The finding "motor-side" states the same.
        if finding.code != "motor-side" or "unexplained" in finding.evidence
    ]
    return replace(refined, findings=(*others, *motor_side_findings(tests, antiresonances_hz)))


def _joint_stiffness(refined: Identification, joint: str) -> float:
    """Return the stiffness k r_L^2 of a spring at its joint."""
    lever = refined.known.drives[joint].load_radius
    return refined.drive_side[joint].value("stiffness") * lever**2


def _antiresonances_hz(
    refined: Identification, motion: Motion, joints: Sequence[str]
) -> dict[str, float]:
    """Return the antiresonances sqrt(k r_L^2 / J) of joints about a motion."""
    inertia = inertia_about(refined.robot, motion)
    squares = {x: _joint_stiffness(refined, x) / inertia[refined.known.index(x)] for x in joints}
    return {x: float(np.sqrt(abs(square))) / (2 * np.pi) for x, square in squares.items()}


def with_rigid_angles(robot: Robot, log: Log, joints: Sequence[str]) -> Log:
    """Return the log with the motor angles over the gear ratio as positions of joints.

    Those of coupled joints follow from the motors of all that have no position: q = C^-1 phi.
    """
    position, is_unseen = log.joint_position.copy(), np.isin(robot.joint_names, joints)
    places = np.array([log.joint_names.index(joint) for joint in robot.joint_names])
    phi = log.motor_position[:, places] / [total_ratio(x) for x in robot.drives.values()]
    q = completed(robot.transmission, phi, np.where(is_unseen, np.nan, position[:, places]))
    position[:, places[is_unseen]] = q[:, is_unseen]
    return replace(log, joint_position=position)


def with_angles(robot: Robot, log: Log, motions: Sequence[Motion], joints: Sequence[str]) -> Log:
    """Return the log with the positions that joints have in its motions, at their times.

    At other times they are those of the motor, over the gear ratio. Raises IdentificationError if
    they diverge.
    """
    position = with_rigid_angles(robot, log, joints).joint_position.copy()
    for motion in motions:
        inside = (log.time >= motion.time[0]) & (log.time <= motion.time[-1])
        for joint in joints:
            angle = motion.joint_position[:, robot.index(joint)]
            place = log.joint_names.index(joint)
            position[inside, place] = np.interp(log.time[inside], motion.time, angle)
    if not np.all(np.abs(np.nan_to_num(position)) < FARTHEST):
        raise IdentificationError("the simulated angles behind the springs diverge")
    return replace(log, joint_position=position)


def cutoff_of(
    robot: Robot, logs: Sequence[Log], joints: Sequence[str], cutoff_hz: float | None
) -> float:
    """Return the given cutoff, or the lowest that the logs propose."""
    if cutoff_hz is not None:
        return cutoff_hz
    rigid = [with_rigid_angles(robot, log, joints) for log in logs]
    return min(reconstruct_motions(robot, log)[0].cutoff_hz for log in rigid)


@dataclass(frozen=True, eq=False)
class UnseenLoads:
    """A motion, and the torques that (7) gives on the loads of joints without a sensor there.

    `joints` are their places, `moves` (n, joints) what of C^-1 turns joints with their drives;
    `torque` (T, joints) is that without friction, from which `friction` (T, joints, f) times its
    parameters is subtracted. The cutoff of the motion is the band of the
    regression, a part of the cutoff of the log (`_BANDS`), below which the rows are filtered. Both
    are smoothed below twice this band: that low pass has a gain of 0.94 at the end of the band, and
    removes the noise above it, which two derivatives of the joint positions would enlarge.
    """

    motion: Motion
    joints: list[int]
    moves: Array
    torque: Array
    friction: Array

    def moved(self, compliance: Array, friction: Array) -> Motion:
        """Return the motion with the joint positions of (7) and (4b), below twice the band."""
        motion, moved = self.motion, np.flatnonzero(np.any(self.moves != 0, axis=1)).tolist()
        # (4b): phi = theta_M / N_t - c tau_L with c = 1 / (k r_L^2), and q = C^-1 phi; the
        # positions are rigid so far, phi = theta_M / N_t.
        stretch = compliance * (self.torque - self.friction @ friction)
        q = motion.joint_position - stretch @ self.moves.T
        q = low_pass(q, motion.rate_hz, 2 * motion.cutoff_hz)
        return with_joints(motion, moved, spline_derivatives(motion.time, q[:, moved]))


def _unseen_loads(robot: Robot, motion: Motion, joints: Sequence[str]) -> UnseenLoads:
    """Return the torques on the loads below twice the band, with few samples."""
    parts = []
    for joint in joints:
        regressor, zeta, R = actuator_columns(robot, motion, joint)
        without_spring = [name not in _OF_SPRING for name in regressor.names]
        # N r_L / r_M times (7) without its spring: the torque on the load by the motor, from which
        # friction, with unknown parameters, is still to be subtracted.
        of_motor = np.column_stack([zeta, R[:, without_spring]])
        parts.append(total_ratio(robot.drives[joint]) * of_motor)
    # (T, 1, f) times (joints, 1): the friction of each joint is in its own row.
    pairs = zip(parts, np.eye(len(joints)), strict=True)
    torque = np.stack([part[:, :1] for part in parts], axis=1)
    whole = np.concatenate([torque, *(x[:, None, 1:] * row[:, None] for x, row in pairs)], axis=2)
    few = max(1, int(motion.rate_hz / (SAMPLES * 2 * motion.cutoff_hz)))
    smooth = low_pass(whole.reshape(len(whole), -1), motion.rate_hz, 2 * motion.cutoff_hz)[::few]
    smooth = smooth.reshape(-1, *whole.shape[1:])
    places = list(map(robot.index, joints))
    moves = at_joints(robot.transmission, np.eye(robot.n)[places]).T
    return UnseenLoads(decimated(motion, few), places, moves, smooth[:, :, 0], smooth[:, :, 1:])


@dataclass(frozen=True, eq=False)
class MotorRegression:
    """The regression of the motor torques of some joints, which is linear but for the compliances.

    At given compliances and friction (7) and (4b) give the joint positions, and (7) in (8) is
    linear in the parameters of bodies and friction. The search is over the compliances alone.
    """

    robot: Robot
    joints: Sequence[str]
    loads: list[UnseenLoads]
    model: LoadModel

    def best_compliance(self, band_hz: float) -> Array:
        """Return the compliances (joints,) of least misfit, from antiresonances about a band."""
        C, torque = self.robot.transmission, np.concatenate([load.torque for load in self.loads])
        motion = [at_drives(C, x.motion.joint_acceleration)[:, x.joints] for x in self.loads]
        # The apparent inertia J is rms torque over rms acceleration; the antiresonance is
        # w_a = sqrt(1 / (c J)), so that c = 1 / (J w_a^2).
        inertia = np.sqrt(np.mean(torque**2, axis=0) / np.mean(np.concatenate(motion) ** 2, axis=0))
        tried = [1 / (inertia * (2 * np.pi * band_hz * part) ** 2) for part in _TRIED_RATIOS]
        best: Array = min(tried, key=lambda compliance: self.fit(compliance)[0])
        for changed in [*np.eye(len(self.joints), dtype=bool)] * 2:
            near = [best * np.where(changed, factor, 1.0) for factor in (1.0, *_FACTORS)]
            best = min(near, key=lambda compliance: self.fit(compliance)[0])
        return best

    def fit(self, compliance: Array) -> tuple[float, Array]:
        """Return the misfit at compliances (joints,), and the friction there.

        The misfit is the mean log of the rms error over that of the torque.
        """
        friction = np.zeros(self.loads[0].friction.shape[2])
        for _ in range(_SWEEPS):
            rows = np.concatenate([self._rows(load, compliance, friction) for load in self.loads])
            misfit, x = _weighted_fit(rows)
            # Not x[-f:], which is all of x for f = 0.
            friction = x[len(x) - len(friction) :]
        return misfit, friction

    def _rows(self, load: UnseenLoads, compliance: Array, friction: Array) -> Array:
        """Return the rows [columns of bodies and friction, torque] at the moved joints."""
        robot, motion = self.robot, load.moved(compliance, friction)
        # the torques of the springs are those that (7) leaves of the motors'
        springs = {x: np.zeros(len(spring_regressor(robot, x).names)) for x in self.joints}
        rows = [self.model.torque_joints.index(joint) for joint in self.joints]
        columns = load_side(robot).columns(motion, self.model, springs)
        of_friction = np.zeros((*columns.torque.shape, len(friction)))
        columns.torque[:, rows], of_friction[:, rows] = load.torque, load.friction
        y = (columns.torque - columns.payload)[:, :, None]
        whole = np.concatenate([columns.H, of_friction, y], axis=2)
        return in_band_at(motion, whole, row_samples(motion))


def _weighted_fit(rows: Array) -> tuple[float, Array]:
    """Return the misfit of a regression by rows (T, joints, [columns, y]), and its parameters.

    Joints are weighted by their errors.
    """
    y = rows[:, :, -1]
    size = error = np.maximum(np.sqrt(np.mean(y**2, axis=0)), LEAST_STD)
    for _ in range(_WEIGHTINGS):
        scaled = (rows * (1 / error)[:, None]).reshape(-1, rows.shape[2])
        x = scaled_svd(scaled[:, :-1]).solve(scaled[:, -1], RANK_TOLERANCE)
        residual = y - rows[:, :, :-1] @ x
        error = np.maximum(np.sqrt(np.mean(residual**2, axis=0)), LEAST_STD)
    # As in the likelihood of joints with noise levels of their own: all joints count alike.
    return float(np.mean(np.log(error / size))), x


Tried = TypeVar("Tried")


def successes(attempts: Iterable[Callable[[], Tried]]) -> Iterator[Tried]:
    """Yield the results of the attempts that succeed. Raises the first error if none of them does.

    The attempts go on as long as their results are asked for.
    """
    problem, is_none = None, True
    for attempt in attempts:
        try:
            result = attempt()
        except (IdentificationError, ExcitationError, LogError) as reason:
            problem = problem or reason
        else:
            is_none = False
            yield result
    if is_none and problem is not None:
        raise problem


def starts_by_regression(
    robot: Robot, logs: Sequence[Log], joints: Sequence[str], cutoff_hz: float
) -> list[list[Log]]:
    """Return the logs with the angles of regressions in bands below the cutoff.

    The starts with the least misfit come first.
    """
    start = partial(_start_by_regression, robot, logs, joints)
    starts = successes(partial(start, part * cutoff_hz) for part in _BANDS)
    return [filled for _, filled in sorted(starts, key=lambda start: start[0])]


def _start_by_regression(
    robot: Robot, logs: Sequence[Log], joints: Sequence[str], band_hz: float
) -> tuple[float, list[Log]]:
    """Return the misfit of a regression in a band, and the logs with its joint positions."""
    shortest_s = min(float(log.time[-1] - log.time[0]) for log in logs)
    # A fifth above the lowest band of a log of this length: rest at its ends is excluded later.
    band_hz = max(band_hz, 1.2 * FEWEST_PERIODS / shortest_s)
    rigid = [with_rigid_angles(robot, log, joints) for log in logs]
    grouped = [reconstruct_motions(robot, log, band_hz) for log in rigid]
    loads = [[_unseen_loads(robot, motion, joints) for motion in group] for group in grouped]
    model = _model_of_torques(robot, [load.motion for load in chain(*loads)], joints)
    regression = MotorRegression(robot, joints, [*chain(*loads)], model)
    compliance = regression.best_compliance(band_hz)
    misfit, friction = regression.fit(compliance)
    moved = [[load.moved(compliance, friction) for load in group] for group in loads]
    starts = [with_angles(robot, *pair, joints) for pair in zip(rigid, moved, strict=True)]
    return misfit, starts


def _model_of_torques(robot: Robot, motions: list[Motion], joints: Sequence[str]) -> LoadModel:
    """Return the columns of the torques of some joints, and of the stiff ones that have one."""
    sensed = joints_with_torque(robot, motions)
    used = [joint for joint in sensed if joint in joints or joint not in robot.elastic_joints]
    return load_model_of(robot, motions, used)


def with_regressed_angles(
    robot: Robot, logs: Sequence[Log], joints: Sequence[str], cutoff_hz: float | None
) -> list[Log]:
    """Return the logs with the joint positions of the regression that explains them best."""
    return starts_by_regression(robot, logs, joints, cutoff_of(robot, logs, joints, cutoff_hz))[0]


def inertia_about(robot: Robot, motion: Motion) -> Array:
    """Return the mean inertia (n,) about each joint while the others are locked."""
    few = motion.samples(slice(None, None, max(1, len(motion.time) // 50)))
    jacobians = torque_jacobians(robot, *few.joint_states)
    inertia = np.mean(np.diagonal(jacobians[2], axis1=1, axis2=2), axis=0)
    # An estimated inertia may be negative; its size is still that of the oscillation.
    return np.asarray(np.abs(inertia))


def hidden_spring_findings(
    refined: Identification, joints: Sequence[str], rate_hz: float
) -> list[Finding]:
    """Return findings of what hides the springs of joints from motors, in logs with a rate."""
    drives = ((joint, refined.drive_side[joint]) for joint in joints)
    springs = {x: (y.value("stiffness"), y.standard_error("stiffness")) for x, y in drives}
    rates_hz = _antiresonances_hz(refined, refined.motions[0], joints)
    fits = {joint: refined.joint_fits[joint].own for joint in joints if joint in refined.joint_fits}
    hidden = hidden_springs(springs, rates_hz, refined.cutoff_hz, (rate_hz, SAMPLES))
    return [*hidden, *noisy_springs(fits)]
