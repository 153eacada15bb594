"""`check`: the set-up of an experiment before any fit, from the logs and what was given.

The findings are those of `seaid.checks`. What no fit can use is excluded, such as the drive of a
joint at rest, or an error, such as a dead channel.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from seaid._arrays import Array, FrozenMapping, is_constant, resolution, white_noise
from seaid._progress import Result, counted
from seaid.checks import CODES, JointCheck
from seaid.checks.channels import stop_findings, strength_findings, without_torque
from seaid.checks.codes import is_wrong, merged
from seaid.checks.columns import Side
from seaid.checks.commands import delay_estimate_findings
from seaid.checks.engine import guarded
from seaid.checks.experiment import Experiment, with_torques_of
from seaid.checks.model import delays_of, model_findings, selections
from seaid.checks.setup import log_findings, setup_findings
from seaid.checks.verdict import Contact, RobotFit
from seaid.drives import IDEAL_DRIVE, Drive
from seaid.errors import (
    ExcitationError,
    Finding,
    IdentificationError,
    LogError,
    SeaidError,
    checked,
    listed,
)
from seaid.estimation import FittedRows, estimator_named
from seaid.identification.datasets import Source, datasets_by_log, first_motion, sources_of
from seaid.identification.nonlinear_terms import linearised_condition
from seaid.identification.stacked_fits import RobotEstimate
from seaid.identification.two_step import ONLY, Condition, estimate_two_step, joints_with_torque
from seaid.identification.unseen_springs import joints_sensed_by_motor_only, with_regressed_angles
from seaid.log import Log, Motion, row_samples
from seaid.log.rows import still_speed
from seaid.regressor import motor_regressor
from seaid.regressor.load import known_frictions, usable_rows
from seaid.regressor.regression import actuator_rows
from seaid.robot import Robot


@dataclass(frozen=True, eq=False, repr=False)
class SetupCheck(Result):
    """The result of `check`.

    Attributes
    ----------
    warnings : tuple of Finding
        The mistakes found, the worst first; empty if nothing contradicts the set-up.
    joints : mapping {joint: JointCheck}
        The numbers on which they rest.
    """

    table_name = "setup_table"

    warnings: tuple[Finding, ...]
    joints: Mapping[str, JointCheck]

    def _in_short(self) -> str:
        return f"{counted(len(self.joints), 'joint')}, {counted(len(self.warnings), 'warning')}"


@checked(IdentificationError)
def check(
    robot: Robot, logs: Source | Sequence[Source], *, cutoff_hz: float | None = None
) -> SetupCheck:
    """Check the set-up of an experiment before the fit: units, signs, ratios, gravity, payloads.

    Nothing is estimated but what decides between mistakes; `identify` makes this check itself.

    Parameters
    ----------
    robot : Robot
        The robot model of `load_robot`. Nominal bodies help to find mistakes, wrong ones only
        weaken the check.
    logs : Log, LongLog, path, or a sequence of them
        The logs; of long logs the first piece is checked.
    cutoff_hz : float, optional
        Cutoff of the low pass. Default: proposed from the data.

    Returns
    -------
    SetupCheck

    Raises
    ------
    IdentificationError, LogError
        For logs that do not fit the robot.

    Examples
    --------
    >>> robot = seaid.load_robot("leg.urdf", "leg.toml")
    >>> print(seaid.check(robot, seaid.read_log("run.csv", robot)).summary())
    """
    sources = sources_of(logs)
    in_memory = [source for source in sources if isinstance(source, Log)]
    unseen = joints_sensed_by_motor_only(robot, in_memory) if in_memory else ()
    if unseen and len(in_memory) == len(sources):
        sources = list(with_regressed_angles(robot, in_memory, unseen, cutoff_hz))
    findings = log_findings(robot, in_memory)
    if any(finding.code == "time-unit" for finding in findings):
        return SetupCheck(merged(findings), FrozenMapping({}, "joint"))
    by_log = [list(map(first_motion, x)) for x in datasets_by_log(robot, sources, cutoff_hz)]
    experiment, motions = Experiment.of(robot, by_log), list(chain(*by_log))
    findings = findings_of_setup(experiment, {*robot.joint_names}, findings, in_memory)
    delays: Mapping[str, tuple[float, float]] = {}
    if not is_wrong(findings):
        # Angles that follow from the torque of a motor show no delay of it.
        quick, delays = _of_quick_fit(robot, in_memory, motions, findings)
        findings += [x for x in quick if x.joint not in unseen]
    joints = joint_checks(experiment, motions, findings, delays)
    return SetupCheck(merged(findings), joints)


def joint_checks(
    experiment: Experiment,
    motions: Sequence[Motion],
    findings: list[Finding],
    delays: Mapping[str, tuple[float, float]],
) -> Mapping[str, JointCheck]:
    """Return what the motions of an experiment show of each joint, and add a note if that fails.

    `delays` {joint: delay of its torque and standard error [s]} are those of a fit.
    """
    swings = np.max([np.ptp(motion.joint_position, axis=0) for motion in motions], axis=0).tolist()
    names = experiment.robot.joint_names
    checks = dict(zip(names, map(JointCheck, swings), strict=True))
    with guarded(CODES["gear-ratio"], findings):
        moving, unknown = experiment.in_motion, (math.nan, math.nan)
        for j, joint in enumerate(names):
            slope = experiment.encoder_slope(j)[0] if experiment.both[j] else math.nan
            misfits = float(moving.nominal[j]), float(moving.free[j]), float(moving.of_motors[j])
            ratio, delay = experiment.encoder_ratio(j), delays.get(joint, unknown)
            checks[joint] = JointCheck(swings[j], slope, *misfits, *ratio, *delay)
    return FrozenMapping(checks, "joint")


def findings_of_setup(
    experiment: Experiment, joints: Collection[str], known: Sequence[Finding], logs: Sequence[Log]
) -> list[Finding]:
    """Return the `known` findings and those of the set-up, by the torques of some joints.

    Torques that are known to be in another unit, far too large or those of a stop show nothing
    else. A stop is one where no mistake of the set-up explains the torque without it.
    """

    def trusted(known: Sequence[Finding]) -> Experiment:
        return with_torques_of(experiment, {*joints} - without_torque(known))

    findings = setup_findings(trusted(known), known)
    if any((finding.code, finding.severity) == ("unit", "wrong") for finding in findings):
        return findings
    far = strength_findings(trusted(known))
    if far:
        return setup_findings(trusted([*known, *far]), [*known, *far])
    stops = stop_findings(trusted(known), logs)
    beyond = setup_findings(trusted([*known, *stops]), [*known, *stops]) if stops else findings
    others = (finding for finding in beyond if finding not in known and finding not in stops)
    return findings if any(finding.severity != "note" for finding in others) else beyond


_OF_LOGS = ("delay", "encoder-offset")
"""Mistakes of a log that its equations show; a term that a drive lacks is none of the set-up."""


def _of_quick_fit(
    robot: Robot, logs: Sequence[Log], motions: Sequence[Motion], known: Sequence[Finding]
) -> tuple[list[Finding], Mapping[str, tuple[float, float]]]:
    """Return what weighted least squares show of logs and commands, and the delays of torques."""
    with suppress(SeaidError):
        used = joints_with_torque(robot, motions)
        condition = linearised_condition(Condition(robot, motions, used))
        fit = estimate_two_step({ONLY: condition}, estimator_named("wls")).of(ONLY)
        selected = selections(checked_sides(condition, fit, logs))
        of_commands = delay_estimate_findings(robot, robot, fit.load_side)
        shown = [x for x in model_findings(selected, known) if x.severity != "note"]
        return [*(x for x in shown if x.code in _OF_LOGS), *of_commands], delays_of(selected)
    return [], {}


def checked_sides(
    condition: Condition,
    estimate: RobotEstimate,
    logs: Sequence[Log],
    gears: Iterable[str] = (),
    offset_std: float = 0.0,
    numbers: Sequence[int] = (),
) -> list[Side]:
    """Return the equations of two steps that are checked: (7) of elastic joints, and the load side.

    `gears` are the joints whose gear was measured, `offset_std` the standard deviation of the
    joints' zeros [rad], and `numbers` those of the logs of the motions. Rows that are not in memory
    are not checked, nor those of robust estimators, which lack some instants. Rows at the times of
    a contact are excluded: a term would explain there what a hand did.
    """
    robot, motions, load = condition.robot, condition.motions_in_memory, estimate.fit
    notes, contacts = list[Finding](), tuple[Contact, ...]()
    if load.rows is None or not motions:
        return []
    with guarded(CODES["contact"], notes):
        contacts = RobotFit(robot.joint_names, load).contacts
    resolved = resolved_widths(robot, logs, motions), frozenset(gears), tuple(notes)
    actuators, base = estimate.actuators, condition.model.base
    shared = *resolved, base, offset_std, tuple(numbers), actuators, logs
    sides = [
        Side(robot, motions, _without_contacts(fitted, contacts), (joint,), True, *shared)
        for joint, fitted in actuators.items()
    ]
    load = _without_contacts(load, contacts)
    assert load.rows is not None
    loads = tuple(name for place, name in enumerate(robot.joint_names) if place in load.rows.joint)
    sides += [Side(robot, motions, load, loads, False, *shared)] if loads else []
    return [side for side in sides if side.is_checked]


def _without_contacts(fitted: FittedRows, contacts: Iterable[Contact]) -> FittedRows:
    """Return a fit without the rows of contacts, which begin and end softly."""
    for contact in contacts:
        if fitted.rows is not None:
            fitted = replace(fitted, rows=fitted.rows.at(~contact.touches(fitted.rows)))
    return fitted


def resolved_widths(
    robot: Robot, logs: Sequence[Log], motions: Sequence[Motion]
) -> dict[str, float]:
    """Return {joint: motor speed [rad/s] below which logs do not resolve the direction of motion}.

    One encoder step per sample, and the change of the speed within a sample at a reversal. The step
    is that of a quantised position of the same noise, whose standard deviation is step / sqrt(12).
    Not less than the speed below which a motor counts as standing: a smaller width would describe
    the friction of a motor that sticks, which has no sign, in rows next to standstill.
    """
    widths = {}
    for index, joint in enumerate(robot.joint_names):
        steps = [_step_per_sample(log, joint, robot.drives[joint].ratio) for log in logs]
        step = float(np.median(steps)) if steps else 0.0
        if np.isfinite(step) and step > 0:
            turns = [_change_at_reversal(motion, index) for motion in motions]
            # Both widen the reversal independently of each other: their squares add up.
            width = float(np.hypot(step, np.median(turns) if turns else 0.0))
            widths[joint] = max([width, *(still_speed(motion, index) for motion in motions)])
    return widths


def _step_per_sample(log: Log, joint: str, ratio: float) -> float:
    """Return the motor speed [rad/s] of one step of its encoder, or the joint's, per sample."""
    place = log.joint_names.index(joint)
    angle = log.motor_position[:, place]
    if not np.all(np.isfinite(angle)):
        angle = ratio * log.joint_position[:, place]
    return float(np.sqrt(12.0) * white_noise(angle) / np.median(np.diff(log.time)))


def _change_at_reversal(motion: Motion, place: int) -> float:
    """Return the median change of a motor's speed [rad/s] within a sample at its reversals."""
    speed = motion.motor_velocity[:, place]
    reversals = np.flatnonzero(speed[1:] * speed[:-1] < 0)
    changes = np.abs(motion.motor_acceleration[reversals, place]) / motion.rate_hz
    return float(np.median(changes)) if len(changes) else 0.0


def without_locked_loads(
    robot: Robot, used: Sequence[str], locked: Mapping[str, float]
) -> tuple[Robot, tuple[str, ...]]:
    """Return the robot and the joints whose load side is used, those that are not locked.

    Locked ones {joint: position} are at rest, though their motors move. If all are locked, nothing
    is known of the bodies, which then count as given.
    """
    free = tuple(joint for joint in used if joint not in locked)
    if free or not used:
        return replace(robot, at_rest=FrozenMapping(locked, "joint")), free
    bodies = np.nan_to_num(robot.parameters)
    known = robot.with_values(bodies, robot.drives)
    return replace(known, known_bodies=robot.body_names), tuple(used)


_LEAST_RANGE, _FLICKER = 20.0, 2.0
"""A position moves if its range is this many times the noise between samples, and more than so many
steps of its encoder."""


def standing_joints(
    robot: Robot, logs: Sequence[Log], motions: Sequence[Motion]
) -> dict[str, float]:
    """Return the joints of a fixed base whose drive moves in no log, and where they stand.

    That is their position [rad or m], NaN if the joint moves while its motor stands. Raises
    ExcitationError if no joint moves.
    """
    moved = [joint for joint in robot.joint_names if _joint_moves(logs, joint)]
    if not moved:
        raise ExcitationError("no joint moves in the log: the motion does not excite the robot")
    if not robot.base_is_held or not np.array_equal(robot.transmission, np.eye(robot.n)):
        return {}
    places = mean_positions(robot, motions, [x for x in robot.joint_names if x not in moved])
    unknown = (joint for joint in moved if not _drive_moves(robot, logs, motions, joint))
    return places | dict.fromkeys(unknown, math.nan)


def mean_positions(
    robot: Robot, motions: Sequence[Motion], joints: Iterable[str]
) -> dict[str, float]:
    """Return the mean position [rad or m] of some joints over all motions."""
    mean = np.mean(np.concatenate([motion.joint_position for motion in motions]), axis=0)
    return {joint: float(mean[robot.index(joint)]) for joint in joints}


def _joint_moves(logs: Sequence[Log], joint: str) -> bool:
    """Whether an encoder of a joint, or the one of its motor, moves in a log."""
    sides, logged = ("joint_position", "motor_position"), [log.logged(joint) for log in logs]
    return any(_moves(channels[side]) for channels in logged for side in sides if side in channels)


def _drive_moves(robot: Robot, logs: Sequence[Log], motions: Sequence[Motion], joint: str) -> bool:
    """Whether the equation of a drive has rows, whose friction is known, and its motor moves."""
    if not robot.drives[joint].is_elastic:
        known = ((motion, known_frictions(robot, motion, [joint])) for motion in motions)
        return any(np.any(usable_rows(robot, x, [joint], row_samples(x), y)) for x, y in known)
    regressor = motor_regressor(robot, joint)
    return any(_moves(log.motor_position[:, log.joint_names.index(joint)]) for log in logs) and any(
        len(actuator_rows(robot, motion, joint, regressor)[0]) for motion in motions
    )


def without_standing(
    robot: Robot, used: Sequence[str], standing: Mapping[str, float]
) -> tuple[Robot, tuple[str, ...], dict[str, Drive]]:
    """Return the robot without the drives that stand still, the other joints, and these drives.

    The torque of a joint at rest is that of its load but for a friction that nothing determines.
    """
    if not standing:
        return robot, tuple(used), {}
    stopped = {joint: robot.drives[joint] for joint in standing if _has_terms(robot, joint, used)}
    elastic = [joint for joint, drive in stopped.items() if drive.is_elastic]
    moving = tuple(joint for joint in used if joint not in stopped)
    if used and not moving:
        raise ExcitationError(
            f"{listed(stopped)}: the drive stands still in all logs, and no other joint has a "
            "torque, so that no friction and no inertia is identifiable: move this joint"
        )
    # Joints that move while their motors stand have no place.
    places = {joint: place for joint, place in standing.items() if np.isfinite(place)}
    robot = robot.with_drives(dict.fromkeys(elastic, IDEAL_DRIVE))
    robot = replace(robot, at_rest=FrozenMapping({**robot.at_rest, **places}, "joint"))
    return robot, moving, stopped


def _has_terms(robot: Robot, joint: str, used: Sequence[str]) -> bool:
    """Whether a drive has a spring, or terms in the equation of a joint whose torque is used."""
    is_elastic = robot.drives[joint].is_elastic
    return is_elastic or (joint in used and bool(motor_regressor(robot, joint).names))


def check_channels(
    robot: Robot, logs: Sequence[Log], used: Collection[str], locked: Collection[str]
) -> None:
    """Raise LogError if a sensor is constant while another sensor of its joint moves.

    The outputs of joints that are `locked` are constant. Of joints without a spring the torques of
    those `used` only have an equation.
    """
    for log in logs:
        for index, joint in enumerate(log.joint_names):
            sides = motor, output = "motor position", "joint position"
            channels = {motor: log.motor_position[:, index], output: log.joint_position[:, index]}
            pairs = [(motor, output)] if joint in locked else [(motor, output), (output, motor)]
            torques = {"motor torque": log.motor_torque, "joint torque": log.joint_torque}
            for name, torque in torques.items():
                if torque is not None and joint in (*used, *robot.elastic_joints):
                    channels[name] = torque[:, index]
                    pairs += [(name, side) for side in sides]
            for dead, moving in pairs:
                _check_alive(joint, dead, channels[dead], moving, channels[moving])


def _check_alive(joint: str, name: str, values: Array, moving: str, position: Array) -> None:
    """Raise LogError if a channel is constant while the position of a side, `moving`, moves."""
    if is_constant(values) and np.all(np.isfinite(position)) and _moves(position):
        raise LogError(
            f"the {name} of '{joint}' is {values[0]:.6g} all the time, while its {moving} moves: a "
            "dead channel? Exclude its column from the log, or the joint with joints=[...] of "
            "load_robot, or, if it has no spring, its torque by torque_joints= of the others",
            *("joints=[...] of load_robot", "torque_joints="),
        )


def _moves(position: Array) -> bool:
    """Whether a position (T,) has a range beyond noise and encoder steps."""
    least = max(_LEAST_RANGE * white_noise(position), _FLICKER * resolution(position))
    return bool(np.ptp(position) > least)
