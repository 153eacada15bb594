"""`refine`: maximum likelihood by output error, both sides at once, from an identification.

Joints are simulated, from the measured motors (`motor_driven`) or under their own controllers
(`command_driven`), and compared with their encoders; all other measured torques are compared with
the equations, below the cutoff of the identification. One search goes from the values of the
identification to those of the largest likelihood, which are kept unless they predict worse.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, IndexArray
from seaid.checks.predictions import nothing_to_simulate, worse_than_start
from seaid.drives import Drive, readable
from seaid.errors import ExcitationError, Finding, IdentificationError, SeaidError, checked, listed
from seaid.estimation import Parameter
from seaid.estimation.nonlinear_least_squares import (
    Point,
    Residuals,
    Step,
    gauss_newton_search,
    information,
    nuisance_draw,
    without_information,
)
from seaid.identification import motor_driven
from seaid.identification.command_driven import commanded_point
from seaid.identification.drive_estimates import without_torque
from seaid.identification.given_constants import STEP, constants_of
from seaid.identification.joint_dynamics import finer_side
from seaid.identification.refined_parameters import (
    Layout,
    LogPoint,
    MotionChange,
    Outputs,
    identification_at,
    layout_of,
)
from seaid.identification.two_step import Procedure, nonlinear_springs
from seaid.identification.unseen_springs import (
    joints_sensed_by_motor_only,
    with_angles,
    with_motor_side_findings,
    with_rigid_angles,
)
from seaid.identification.validation import compared
from seaid.log import Log, Motion, reconstruct_motion, row_samples
from seaid.log.filtering import noise_density
from seaid.log.motion import SHORTEST_STRETCH, reconstruct_motions
from seaid.log.usable_parts import stretches, usable
from seaid.regressor import Regression, actuator_regression, load_regression, motor_regressor
from seaid.regressor.load import check_offset_std, offset_sensitivity
from seaid.regressor.regression import Regress
from seaid.robot import Robot, coupled_names
from seaid.robot.transmission import group_of

if TYPE_CHECKING:
    from seaid.identification.result import Identification

SHORT_WINDOW_S, _FIRST_STEPS, _CLOSE_TO_LONGER = 0.25, 12, 0.5
"""Windows and most steps of a first estimate without joint encoders, see `unseen_springs`; its next
step [standard errors] from which longer windows go on."""

_SETTLED, _CLOSE = 1e-3, 0.05
"""Next steps [standard errors] at which a search ends, and up to which it has converged."""

_COMMANDED_SETTLED = 0.02
"""Next step [standard errors] at which a search ends."""

_FAR = 3.0
"""Standard errors of the next step beyond which a search that cannot go on has not converged: 0.13
to 0.41 on the measured logs of a Go2, 48 where friction holds the joints of an arm at reversals."""

_WORSE, _WORSE_SHARE = 1.5, 0.02
"""A joint is predicted worse if the relative error of its torque grows by this factor, and by this
much. Without model errors the factor is at most 1.2 (`scripts/benchmarks/output_error.py`,
cutoffs of 2 to 12 Hz): the likelihood weights other channels than the regression does.
"""

_STATE_DRAWS = 8
"""Random errors of the initial states from which their part of the information is computed."""


@checked(IdentificationError)
def refine(
    identification: Identification,
    logs: Log | Sequence[Log],
    *,
    encoder_offset_std: float = 0.0,
    iterations: int = 20,
    progress: bool = False,
) -> Identification:
    """Refine an identification to the maximum-likelihood estimate of both sides at once.

    Output error (Gautier, Janot and Vandanjon 2013) by Gauss-Newton with forward sensitivities: the
    joints behind springs are simulated from the measured motor angles; their encoders and all
    measured torques are outputs with white noise of estimated variance. Rows in which a motor with
    dry friction, or one whose width `identify` selected, stands still or turns back are excluded,
    as are gaps. The covariance includes autocorrelation.
    The torques of joints that are not simulated are compared below the cutoff, as in `identify`.
    Where position commands were logged, the model follows them under its own controllers, and the
    joint positions are the outputs.
    `residual_std` is that of averages over blocks of samples: of a drive's torque (or spring
    force), and on the load side of the torques of stiff joints, or else of the joint encoders.

    Parameters
    ----------
    identification : Identification
        The start, of `identify`.
    logs : Log or sequence of Log
        The logs to fit.
    encoder_offset_std : float
        Standard deviation of the joint encoder offsets [rad or m]; if positive they are estimated.
    iterations : int
        Largest number of Gauss-Newton steps.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Identification
        The refined parameters. Those of the start, with a warning that says why, if they predict
        the logs better, or if no joint can be simulated.

    Raises
    ------
    IdentificationError
        If the start is unusable or the iteration does not converge.
    ExcitationError
        If the logs leave parameters unidentifiable.
    LogError
        If a log does not fit the robot.

    Examples
    --------
    >>> refined = seaid.refine(seaid.identify(robot, log), log)
    """
    logs = [logs] if isinstance(logs, Log) else list(logs)
    if not logs:
        raise IdentificationError("refine needs a log, found none")
    check_offset_std(encoder_offset_std)
    _check_start(identification, joints_sensed_by_motor_only(identification.known, logs))
    if identification.known.has_controllers:
        return _refined_by_commands(identification, logs, iterations, progress)
    return refined_by_motors(identification, logs, encoder_offset_std, iterations, progress)


def _check_start(start: Identification, unseen: Sequence[str]) -> None:
    by_commands = start.known.has_controllers
    (WITHOUT_ENCODERS if unseen and not by_commands else BY_MOTORS).check(start.known, unseen)
    if start.gears:
        raise IdentificationError(
            f"the deflection of {', '.join(start.gears)} was measured, and the refinement knows "
            "that between the encoders only: use the result of identify, or exclude that channel"
        )
    for joint in start.springs:
        estimate = start.drive_side[joint]
        is_known = "stiffness" not in estimate.names
        drive = start.known.drives[joint]
        stiffness = drive.values["stiffness"] if is_known else estimate.value("stiffness")
        if not (np.isfinite(stiffness) and stiffness > 0):
            raise IdentificationError(
                f"the refinement cannot start: the estimated stiffness of {joint} is "
                f"{stiffness:.3g}, and the simulation needs a positive one"
            )


def _refined_by_commands(
    start: Identification, logs: Sequence[Log], iterations: int, progress: bool
) -> Identification:
    """Return the identification with the least output error of the closed loop.

    It is the start with the reason why, where the values are worse. With errors of the model in
    place of noise the likelihood, in which joints of small errors weigh most, may rise while the
    positions get worse; or no step may improve it, although its slope is not zero.
    """
    first = commanded_point(start, logs)
    try:
        _ = first.step
    except SeaidError as problem:
        raise IdentificationError(
            "the model cannot be simulated with the values of the identification: give the bodies "
            f"that are known (known_bodies=), or identify with feasible=True; {problem}",
            "known_bodies=",
            "feasible=True",
        ) from None
    point, is_stuck = gauss_newton_search(first, iterations, _COMMANDED_SETTLED, progress)
    errors = np.sqrt(np.diag(point.step.covariance))
    rest = np.abs(point.step.change) / np.where(errors > 0, errors, 1.0)
    before, after = _mean_absolute_error(first), _mean_absolute_error(point)
    if is_stuck and np.max(rest, initial=0.0) > _FAR:
        worst = int(np.argmax(rest))
        reason = (
            f"its search cannot improve the simulated positions, although its next step would "
            f"change {readable(point.parameters[worst].name)} by {rest[worst]:.0f} standard errors"
        )
        evidence = {"standard errors": float(rest[worst])}
    elif after > before:
        reason = "its positions follow the commands more closely"
        evidence = {"error of the start": before, "error after": after}
    else:
        return _refined(point.logs[0].layout, point, point.step)
    return start.with_findings([worse_than_start(reason, evidence)])


def _mean_absolute_error(point: LogPoint) -> float:
    """Return the mean absolute error of all joints [rad or m]."""
    residuals = [log.residuals for log in point.logs]
    return float(np.mean(np.concatenate([abs(x.residual[x.kept]) for x in residuals])))


def refined_by_motors(
    identification: Identification,
    logs: list[Log],
    encoder_offset_std: float,
    iterations: int = 20,
    progress: bool = False,
) -> Identification:
    """Return the identification with the least output error of joints driven by their motors.

    It is the start with the reason why, where the values predict worse.
    """
    unseen = joints_sensed_by_motor_only(identification.known, logs)
    layout = layout_of(identification, encoder_offset_std, unseen)
    if not (layout.simulated or encoder_offset_std):
        return identification.with_findings([nothing_to_simulate()])
    # Angles without an encoder come from (7), and the errors of a poor start accumulate over a
    # window: an iteration in short windows comes first.
    simulated, x = logs, layout.start
    if unseen:
        point, simulated = _in_short_windows(layout, logs, x, iterations, progress)
        x = point.x
    start = point_at(layout, simulated, x)
    point, _ = gauss_newton_search(start, iterations, _SETTLED, progress)
    # `not <` also refuses NaN.
    if not point.size < _CLOSE:
        raise IdentificationError(
            f"the refinement did not converge in {iterations} iterations: its next step would be "
            f"{point.size:.2g} standard errors",
            advice="use the result of identify, if the logs and the identification belong together",
        )
    if unseen:
        if any("motor_inertia" in layout.actuators[joint].names for joint in unseen):
            point = _without_noise_of_rotors(layout, point, simulated)
        return _refined_unseen(layout, point)
    result = _refined(layout, point, point.step)
    zeros = point.x[layout.zeros] if layout.has_zeros else np.zeros(1)
    worse = _worse(identification, result, logs, zeros)
    return identification.with_findings(worse) if worse else result


def _worse(
    before: Identification, after: Identification, logs: list[Log], zeros: Array
) -> list[Finding]:
    """Return which torque the refined values predict worse than the start, if any."""
    motions = [
        part for log in logs for part in reconstruct_motions(before.known, log, before.cutoff_hz)
    ]
    shifted = [replace(motion, joint_position=motion.joint_position - zeros) for motion in motions]
    # (2, n): the motor torques, then the load torques.
    old, new = (
        np.array([fits.actuator.relative_error, fits.load.relative_error])
        for fits in (compared(before, *motions), compared(after, *shifted))
    )
    with np.errstate(invalid="ignore"):
        is_worse = (new > _WORSE * old) & (new - old > _WORSE_SHARE)
        worst = np.unravel_index(np.argmax(np.where(is_worse, new / old, 0.0)), new.shape)
    if not is_worse[worst]:
        return []
    side, joint = ("motor", "load")[worst[0]], before.known.joint_names[worst[1]]
    evidence = {"error before": float(old[worst]), "error after": float(new[worst])}
    reason = (
        f"the error of the {side} torque of {joint} would grow from {old[worst]:.1%} to "
        f"{new[worst]:.1%}"
    )
    return [worse_than_start(reason, evidence)]


def _squared_change(point: LogPoint, logs: Sequence[Outputs]) -> Array:
    """Return the square (p, p) of the change of the next step with other logs at its values."""
    change = replace(point, logs=tuple(logs)).step.change - point.step.change
    return np.outer(change, change)


def _of_constants(start: Identification, point: LogPoint) -> Array:
    """Return the covariance (p, p) of a point by errors of the known constants.

    A constant changes the residuals at the same values, and the next step by its derivative.
    """
    total = np.zeros((len(point.x), len(point.x)))
    for constant in constants_of(start.known, start.known_std):
        changed = [log.changed(constant.robot, constant.scaled) for log in point.logs]
        total += (constant.std / STEP) ** 2 * _squared_change(point, changed)
    return total


def _refined(layout: Layout, point: LogPoint, step: Step) -> Identification:
    """Return the identification at a point with the covariance of a step and of constants."""
    step = replace(step, covariance=step.covariance + _of_constants(layout.identification, point))
    return identification_at(layout, point.x, step)


# What is compared


def point_at(
    layout: Layout, logs: Sequence[Log], x: Array, window_s: float = motor_driven.WINDOW_S
) -> LogPoint:
    """Return the point of a search at the values x (p,), its joints simulated to satisfy (8)."""
    shortest_s = SHORTEST_STRETCH / layout.identification.cutoff_hz
    parts = [part for log in logs for part in stretches(usable(log), shortest_s)]
    compared: list[Outputs] = []
    for part in parts if layout.simulated else ():
        runs = motor_driven.runs_of(layout, part, window_s)
        compared += [motor_driven.MotorDriven(layout, x, run) for run in runs]
    if layout.sensed or layout.others:
        compared += [MeasuredTorques.of(layout, part, x) for part in parts]
    return Point(layout.parameters, x, tuple(compared)).settled()


@dataclass(frozen=True, eq=False)
class MeasuredTorques(Outputs):
    """The motion of a part of a log without gaps, whose torques are compared with the equations.

    It is filtered at the cutoff of the identification. `of_linear` are the residuals at parameters
    of zero of a layout whose equations are linear, computed once.
    """

    motion: Motion
    of_linear: Callable[[Layout], Residuals]

    @classmethod
    def of(cls, layout: Layout, log: Log, x: Array) -> MeasuredTorques:
        """Return a log at the cutoff of the identification."""
        known = layout.identification.known
        motion = reconstruct_motion(known, log, layout.identification.cutoff_hz)
        return cls.of_motion(layout, finer_side(known, motion), x)

    @classmethod
    def of_motion(cls, layout: Layout, motion: Motion, x: Array) -> MeasuredTorques:
        """Return a motion whose linear equations are evaluated once."""
        return cls(layout, x, motion, cache(lambda each: _measured_near(each, motion, x)))

    @cached_property
    def residuals(self) -> Residuals:
        """The residuals of what is not simulated."""
        layout, x = self.layout, self.x
        is_nonlinear = bool(layout.nonlinear)
        rows = _measured_near(layout, self.motion, x) if is_nonlinear else self.of_linear(layout)
        return replace(rows, residual=rows.residual + rows.jacobian @ x)

    def changed(self, known: Robot, change: MotionChange) -> MeasuredTorques:
        """Return the residuals for a robot with other constants, and a change of the log."""
        return self.of_motion(self.layout.with_known(known), change(self.motion), self.x)


def _measured_near(layout: Layout, motion: Motion, x: Array) -> Residuals:
    """Return what is not simulated, linearised at x (p,), at parameters of zero."""
    samples = row_samples(motion)
    instants = motion.time[samples]
    shape = (1, len(instants), len(layout.sensed) + len(layout.others))
    residual, jacobian = np.zeros(shape), np.zeros((*shape, len(x)))
    kept = np.zeros(shape, dtype=bool)
    rows_of_channels = _rows_of_channels(layout, motion, x)
    for channel, (index, columns, rows) in enumerate(rows_of_channels):
        of_joint = rows.joint == index
        # Rows near standstill are missing: others are placed by time, 1e-9 s against rounding.
        places = np.searchsorted(instants, rows.time[of_joint] - 1e-9)
        # The rows are at twice the Nyquist rate of the filter: every second one counts, so that
        # white noise below the cutoff is uncorrelated from row to row.
        kept[0, places[places % 2 == 0], channel] = True
        residual[0, places, channel] = rows.y[of_joint]
        jacobian[0, places[:, None], channel, columns] = -rows.H[of_joint]
        if layout.has_zeros:
            jacobian[0, places, channel, layout.zeros] = -rows.propagated[of_joint]
    simulated = 2 * len(layout.simulated) + len(layout.followed)
    return Residuals(
        residual=residual,
        jacobian=jacobian,
        nuisance=np.zeros((*shape, 0)),
        kept=kept,
        time=instants[None],
        channels=range(simulated, simulated + shape[2]),
    )


def _rows_of_channels(
    layout: Layout, motion: Motion, x: Array
) -> Iterator[tuple[int, IndexArray, Regression]]:
    """Yield joint, columns and rows of what is not simulated.

    These are the drives of springs with a measured torque, and the torques of stiff joints. Their
    columns have the noise of the encoders, so that both sides are filtered as in `identify`. The
    effect of encoder offsets is that at the start.
    """
    known, model, start = layout.known_at(x), layout.identification.model, layout.start

    def rows_of(regress: Regress, columns: IndexArray) -> Regression:
        if layout.has_zeros:
            return offset_sensitivity(known, motion, regress, start[columns])
        return regress(motion)

    for joint in layout.sensed:
        rows = rows_of(partial(actuator_regression, known, joint=joint), layout.drives[joint])
        motor_driven.check_columns(layout, rows.names, joint)
        yield known.index(joint), layout.drives[joint], rows
    if layout.others:
        zero = without_torque(known, layout.simulated)
        rows = rows_of(partial(load_regression, known, model=model, springs=zero), layout.load)
        yield from ((known.index(joint), layout.load, rows) for joint in layout.others)


# Joints whose angles behind the springs are not measured


def _filled(layout: Layout, logs: list[Log]) -> list[Log]:
    """Return the logs with rigid springs at unseen joints, about which these are simulated."""
    return [with_rigid_angles(layout.identification.known, log, layout.unseen) for log in logs]


def _in_short_windows(
    layout: Layout, logs: list[Log], x: Array, iterations: int, progress: bool = False
) -> tuple[LogPoint, list[Log]]:
    """Return a fit in short windows from x (p,), and the logs with the angles that it simulates."""
    short = point_at(layout, _filled(layout, logs), x, SHORT_WINDOW_S)
    point, _ = gauss_newton_search(short, iterations, _CLOSE_TO_LONGER, progress)
    return point, [_simulated_log(layout, log, point) for log in logs]


def _simulated_log(layout: Layout, log: Log, point: LogPoint) -> Log:
    """Return the simulated part of the log with the simulated angles of the unseen joints."""
    robot = layout.identification.known
    motions = [run.motion for run in _runs(point)]
    parts = [x for x in motions if log.time[0] <= x.time[0] <= log.time[-1]]
    filled = with_angles(robot, log, parts, layout.unseen)
    return filled.between(parts[0].time[0], parts[-1].time[-1])


def _runs(point: LogPoint) -> list[motor_driven.Run]:
    """Return the simulated windows of all logs."""
    return [log.run for log in point.logs if isinstance(log, motor_driven.MotorDriven)]


def simulated_from_motors(identification: Identification, log: Log) -> Log:
    """Return a log with the angles of joints without a sensor there, simulated by the model.

    The motors turn as measured; only the initial state of each window is fitted to their torques.
    """
    unseen = joints_sensed_by_motor_only(identification.known, [log])
    if not unseen:
        return log
    _check_start(identification, unseen)
    layout = layout_of(identification, 0.0, unseen)
    filled = _filled(layout, [log])
    return _simulated_log(layout, log, point_at(layout, filled, layout.start))


def first_estimate(identification: Identification, logs: list[Log]) -> tuple[float, list[Log]]:
    """Return the merit of the fit in short windows of logs without some joint encoders.

    With it come the logs with the angles of unseen joints that it simulates.
    """
    layout = layout_of(identification, 0.0, joints_sensed_by_motor_only(identification.known, logs))
    point, simulated = _in_short_windows(layout, logs, layout.start, _FIRST_STEPS)
    if any(point.x[layout.spring(joint)[0]] <= 0 for joint in layout.unseen):
        raise IdentificationError("the search of the stiffness ended below zero")
    return point.step.merit, simulated


def _refined_unseen(layout: Layout, point: LogPoint) -> Identification:
    """Return the refinement of joints without encoder, with the terms that their springs lack."""
    wider, wider_point = _with_tests(layout, point)
    noise, p = _noise_of_states(wider_point), len(point.x)
    step = without_information(wider_point.step, noise)
    errors = np.sqrt(np.diag(step.covariance))
    # {joint: {order: [value, standard error]}} of the tested terms, in units of (8).
    terms: dict[str, dict[int, Array]] = {joint: {} for joint in layout.unseen}
    for place, (joint, order) in enumerate(wider.tested, p):
        terms[joint][order] = np.array([step.change[place], errors[place]])
    result = _refined(layout, point, without_information(point.step, noise[:p, :p]))
    return with_motor_side_findings(result, terms, _runs(point)[0].motion)


def _noise_of_states(point: LogPoint) -> Array:
    """Return the information (p, p) that is noise of initial states which only torques determine.

    Where no encoder shows the joint, noise of the torque becomes motion of the estimated initial
    states, and the derivatives by a stiffness have a part that is noise.
    """
    rng, step = np.random.default_rng(0), point.step
    driven = [log for log in point.logs if isinstance(log, motor_driven.MotorDriven)]
    noise = np.zeros((len(point.x), len(point.x)))
    for _ in range(_STATE_DRAWS):
        states = [nuisance_draw(log.residuals, step.stds, rng) for log in driven]
        parts = []
        for log, drawn in zip(driven, states, strict=True):
            rows, moved = log.residuals, log.moved(point.x, 1.0, drawn).residuals
            parts.append(replace(rows, jacobian=moved.jacobian - rows.jacobian))
        noise += information(parts, step.stds) / _STATE_DRAWS
    return noise


def _without_noise_of_rotors(layout: Layout, point: LogPoint, logs: Sequence[Log]) -> LogPoint:
    """Return the point without the bias by the noise in the accelerations of the motors.

    Noise in the column of an unknown rotor inertia makes it too small (errors in variables). As
    much noise of the encoders once more changes the estimate by as much again (Cook and Stefanski
    1994).
    """
    rng = np.random.default_rng(0)
    places = [layout.identification.known.index(joint) for joint in layout.unseen]
    bias = -point.step.change
    for _ in range(_STATE_DRAWS):
        noisy = [_with_motor_noise(log, places, rng) for log in logs]
        bias += point_at(layout, noisy, point.x).step.change / _STATE_DRAWS
    return point.moved(
        -bias, 1.0, [np.zeros_like(change) for change in point.step.nuisance_alone]
    ).settled()


def _with_motor_noise(log: Log, places: Sequence[int], rng: np.random.Generator) -> Log:
    """Return the log whose motor positions have the noise of their encoders once more."""
    rate_hz = (len(log.time) - 1) / (log.time[-1] - log.time[0])
    position = log.motor_position.copy()
    for place in places:
        std = np.sqrt(noise_density(position[:, place], rate_hz) * rate_hz / 2)
        position[:, place] += std * rng.normal(size=len(position))
    return replace(log, motor_position=position)


def _with_tests(layout: Layout, point: LogPoint) -> tuple[Layout, LogPoint]:
    """Return the point with terms that springs without encoder may lack, if they are identifiable.

    Their first step from zero is a score test (Rao 1948).
    """
    tested = tuple(
        (joint, order)
        for joint in layout.unseen
        for order in (1, 2)
        if order == 2 or Parameter("spring_damping", joint) not in layout.places
    )
    terms = (Parameter(f"deflection derivative {order}", joint) for joint, order in tested)
    wider = replace(layout, parameters=(*layout.parameters, *terms), tested=tested)
    x = np.append(point.x, np.zeros(len(tested)))
    try:
        logs = tuple(replace(log, layout=wider, x=x) for log in point.logs)
        wider_point = Point(wider.parameters, x, logs)
        _ = wider_point.step
        return wider, wider_point
    except ExcitationError:
        return layout, point


# What is refused


def _drives_not_simulated(robot: Robot, unseen: Collection[str]) -> Iterator[str]:
    """Yield which drives a refinement does not simulate, and why.

    The joints `unseen` have no sensor behind their springs, which have to be linear then, and only
    their own drives have to move one joint.
    """
    coupled = coupled_names(robot.joint_names, robot.transmission)
    if coupled and not unseen:
        yield f"the drives of {listed(coupled)} move several joints"
    for joint, drive in robot.drives.items():
        reasons = _refusals(robot, joint, drive), _of_terms(drive)
        for reason in chain(*reasons, _of_unseen(robot, joint, drive, unseen)):
            yield f"the drive of {joint}, {reason}"


def _refusals(robot: Robot, joint: str, drive: Drive) -> Iterator[str]:
    """Yield why a drive is not simulated."""
    if drive.shared:
        yield f"which shares parameters with others ('{drive.shared}'): it moves those of each"
    if drive.controller is not None:
        if drive.is_elastic or any(x.controller is None for x in robot.drives.values()):
            yield "whose command was logged: all drives have to be stiff, with a position command"
        if any((motor_regressor(robot, joint).non_linear, robot.angle_ratios)):
            yield "whose equation is not linear in its parameters, or has a ratio of its angle"
    elif drive.motor_input != "torque":
        yield f"of which the {drive.motor_input} was logged, not the torque"


def _of_terms(drive: Drive) -> Iterator[str]:
    """Yield which terms of a drive are not simulated."""
    if "dahl" in drive.spring:
        yield "whose spring has hysteresis, a state that adds up the noise of its deflection"
    if "load" in drive.friction and not drive.is_elastic:
        yield "whose friction grows with the load"


def _of_unseen(robot: Robot, joint: str, drive: Drive, unseen: Iterable[str]) -> Iterator[str]:
    """Yield why a drive is not simulated, if no sensor is behind its spring."""
    if joint not in unseen:
        return
    if len(group_of(robot.transmission, robot.index(joint))) > 1:
        yield "whose motor turns several joints, and no sensor is behind its spring"
    if any((drive.parallel_spring, drive.joint_friction, drive.angle_ratio)):
        yield "which has a parallel spring or joint friction, or angle_ratio, and no sensor behind"
    if motor_regressor(robot, joint).non_linear or "load" in drive.friction:
        yield "whose equation is not linear in its parameters, without a sensor behind its spring"
    for reason in nonlinear_springs({"stiffness", "spring_offset"}, robot, [joint]):
        yield f"without a sensor behind its spring: {reason}"


BY_MOTORS = Procedure(
    option="refine",
    limits=_drives_not_simulated,
    only="cannot simulate every drive",
    instead="use the result of identify",
    held="seaid does not simulate contacts",
)

WITHOUT_ENCODERS = replace(
    BY_MOTORS,
    option="the refinement without joint encoders",
    instead="log the joint position",
)
