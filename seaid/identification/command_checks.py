"""Position commands of a log before a fit: signs, units, repeats, limits, tracking error.

And torques that are none: without sign, or computed from the tracking error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from seaid._arrays import Array, is_constant, resolution
from seaid._files import toml_table
from seaid.checks import excluding_torque
from seaid.drives import NORMAL_95, Controller, Drive, JointParameter, stated_delay_s
from seaid.errors import Finding
from seaid.estimation import scaled_svd
from seaid.identification.command_delays import DELAY, buses_of
from seaid.log import (
    Log,
    Motion,
    changed_source,
    commanded_part,
    relative_supply,
    spline_derivatives,
)
from seaid.regressor import Regression, is_linear, load_model_of, load_regression, stacked
from seaid.robot import Robot

_FOLLOWS, _OTHER_UNIT = 0.5, 20.0
"""Size of the correlation of command and position from which a sign is wrong if it is negative, and
a unit if the ratio of their ranges is beyond the second: a loop that follows has one near 1."""

_DEGREE, _LAG = np.pi / 180, 0.5
"""A degree [rad], and the logarithm of the ratio by which lag and resonance change a range."""

_REPEATED, _REST_S = 0.02, 0.25
"""Share of commands that repeat the one before, single steps being usual, from which commands are
logged twice; longer runs of equal commands are rests."""

_AT_LIMIT, _TIMES_LIMIT = 0.01, 5.0
"""Share of samples beyond the limit of a controller, from which it is said, and median torque over
the limit from which gains are in another unit: a saturated one was 1.5 times beyond."""

_MOSTLY = 0.5
"""Share of the samples at a stop from which the rest of the motion is no use either."""

_NOISY = 3.0
"""Tracking error (rms) over the noise of the encoder below which a third of the torque is noise."""


def command_findings(robot: Robot, log: Log) -> Iterator[Finding]:
    """Yield what is wrong or worth knowing with the position commands of a log."""
    for j, joint in enumerate(log.joint_names if log.position_command is not None else ()):
        drive = robot.drives.get(joint)
        error = None if drive is None else _tracking_error(log, j, drive.ratio)
        if drive is None or drive.controller is None or error is None or np.isnan(error[0]):
            continue
        found = _not_following(robot, log, j, error)
        if found is not None:
            yield found
            continue
        yield from _repeats(log, j)
        yield from _at_stop(robot, log, j)
        yield from _limited(robot, log, j)
        yield from _ignored(log, j, drive.controller)
        yield from _too_close(log, j, error)


def _not_following(robot: Robot, log: Log, j: int, error: Array) -> Finding | None:
    """Return the finding of a command with another sign or unit than the position, if it has."""
    assert log.position_command is not None
    command, joint = log.position_command[:, j], log.joint_names[j]
    position = command - error
    if is_constant(command) or is_constant(position):
        return None
    r = float(np.corrcoef(command, position)[0, 1])
    times = float(np.std(command) / np.std(position))
    apart = max(times, 1 / times)
    if r > -_FOLLOWS and (r < _FOLLOWS or apart < _OTHER_UNIT):
        return None
    quantity = "position_command"
    source = log.sources()[joint][quantity]
    is_degrees = abs(np.log(times * _DEGREE)) < _LAG
    factor = -1.0 if r < 0 else float(f"{_DEGREE if is_degrees else 1 / times:.4g}")
    words = f"moves against its position (correlation {r:.3f}): it has the opposite sign"
    if r > 0:
        unit = "degrees" if is_degrees else "another unit"
        words = f"has {times:.4g} times the range of its position: it is in {unit}"
    return Finding(
        "sign" if r < 0 else "unit",
        f"the position command of {joint} {words}",
        joint,
        "wrong",
        {"correlation": r, "ratio of the ranges": times},
        f"in the description of the log:\n{toml_table('joints', joint)}\n"
        f"{quantity} = {changed_source(source, factor=factor)}",
        "certain",
    )


def _repeats(log: Log, j: int) -> Iterator[Finding]:
    """Yield commands of which some are logged twice; held ones, all alike, are no finding."""
    assert log.position_command is not None
    command, joint = log.position_command[:, j], log.joint_names[j]
    changes = np.flatnonzero(np.diff(command) != 0)
    runs = np.diff(changes)
    period_s = float(log.time[-1] - log.time[0]) / (len(log.time) - 1)
    runs = runs[runs * period_s < _REST_S]
    if len(runs) < len(command) / 10 or np.median(runs) > 1:
        return
    share = float(np.sum(runs - 1) / np.sum(runs))
    if share < _REPEATED:
        return
    longest_ms = 1e3 * period_s * float(np.percentile(runs - 1, 99))
    yield Finding(
        "delay",
        f"{share:.1%} of the position commands of {joint} repeat the one before while others "
        f"change: they are logged twice or late, by {longest_ms:.3g} ms and more at times",
        joint,
        "doubtful",
        {"share of repeated commands": share},
        "log each command with the time at which it was sent",
        "likely",
    )


def _limited(robot: Robot, log: Log, j: int) -> Iterator[Finding]:
    """Yield a controller that is at its limit, or asks more than the limit of the robot file."""
    joint = log.joint_names[j]
    drive = robot.drives[joint]
    law = drive.controller
    assert law is not None
    position = controlled_position(log, j, drive.ratio)
    velocity = spline_derivatives(log.time, position[:, None])[1][:, 0]
    columns = [log.joint_names.index(one) for one in robot.joint_names]
    signals = {field: values[:, columns] for field, values in log.sensors().items()}
    index = robot.index(joint)
    commanded = commanded_part(robot, log.time, signals, index)
    unlimited = replace(law, torque_limit_Nm=math.inf)
    supply = relative_supply(robot, log.time, signals, index)
    asked = unlimited.torque(commanded, position, velocity, supply)[0]
    is_given = bool(np.isfinite(law.torque_limit_Nm))
    limit = law.torque_limit_Nm if is_given else float(robot.effort_limits[index])
    if drive.is_up_to_scale and not is_given:
        return  # its gains are in other units than the limit
    share = float(np.mean(np.abs(asked) > limit)) if limit > 0 else 0.0
    if share < _AT_LIMIT:
        return
    largest = float(np.max(np.abs(asked)))
    times = float(np.median(np.abs(asked))) / limit
    if times > _TIMES_LIMIT and (is_given or not np.any(robot.parameters)):  # bodies show it better
        yield _other_unit(joint, limit, share, times)
        return
    text = f"asks for more than its torque limit, {limit:.4g} N m, in {share:.1%} of the samples"
    if is_given:
        text += ": the limit counts as its torque there"
    else:
        text = (
            f"asks for up to {largest:.3g} N m, in {share:.1%} of the samples more than the effort "
            f"limit of the robot file ({limit:.4g} N m), and has no torque limit"
        )
    table = toml_table(joint, "controller")
    yield Finding(
        "saturation",
        f"the controller of {joint} {text}",
        joint,
        "note" if is_given else "doubtful",
        {"share at the limit": share},
        "" if is_given else f"in the drives file:\n{table}\ntorque_limit_Nm = {limit:.4g}",
        "certain" if is_given else "likely",
    )


def _at_stop(robot: Robot, log: Log, j: int) -> Iterator[Finding]:
    """Yield a joint that is commanded beyond its limits and does not follow there."""
    assert log.position_command is not None
    joint = log.joint_names[j]
    lower, upper = robot.position_range(joint)

    def beyond(place: Array) -> Array:
        return np.asarray(np.maximum(np.maximum(place - upper, lower - place), 0.0))

    command = beyond(log.position_command[:, j])
    share, farthest = float(np.mean(command > 0)), float(np.max(command))
    position = controlled_position(log, j, robot.drives[joint].ratio)
    if share < _AT_LIMIT or np.sum(beyond(position)) > _FOLLOWS * np.sum(command):
        return
    others = [name for name in robot.joint_names if name != joint]
    unit = "m" if log.is_prismatic[j] else "rad"
    yield Finding(
        "contact",
        f"{joint} is commanded beyond its limits in the robot file, from {lower:.4g} to "
        f"{upper:.4g} {unit}, in {share:.0%} of the samples, by up to {farthest:.3g} {unit}, and "
        "does not follow there: at its stop its controller pushes against a force that is not in "
        "the model",
        joint,
        "wrong" if share > _MOSTLY else "doubtful",
        {"share beyond the limits": share, "farthest beyond": farthest},
        f"command it within its limits{excluding_torque(others)}",
        "likely",
    )


def _other_unit(joint: str, limit: float, share: float, times: float) -> Finding:
    """Return the finding of gains that ask for more than a limit most of the time."""
    return Finding(
        "gain-scale",
        f"the controller of {joint} asks for more than its torque limit, {limit:.4g} N m, in "
        f"{share:.0%} of the samples, and for {times:.3g} times as much on average: its gains are "
        "in another unit than the limit, such as units of the drive (counts, 1/256, per degree)",
        joint,
        "doubtful",
        {"share at the limit": share, "median torque over its limit": times},
        "gains in N m/rad, or gains and limit in units of the drive and their scale as a parameter "
        "with known bodies, in the drives file:\n"
        f"{toml_table(joint, 'controller')}\nis_up_to_scale = true",
        "likely",
    )


def _ignored(log: Log, j: int, law: Controller) -> Iterator[Finding]:
    """Yield velocity commands for which a controller of velocities has no gain."""
    rate, joint = log.velocity_command, log.joint_names[j]
    gain = law.velocity_gain_Nms_per_rad
    if rate is None or not gain or law.command_velocity_gain_Nms_per_rad:
        return
    largest = float(np.max(np.abs(rate[:, j])))
    if largest > 0:  # False for a joint without them, too, whose samples are NaN
        unit = "m/s" if log.is_prismatic[j] else "rad/s"
        yield Finding(
            "unused-command",
            f"the log has velocity commands of {joint}, of up to {largest:.3g} {unit}, and its "
            "controller has no gain for them: they are not used",
            joint,
            "doubtful",
            {"largest velocity command": largest},
            f"in the drives file, if the drive gets them:\n{toml_table(joint, 'controller')}\n"
            f"command_velocity_gain_Nms_per_rad = {gain:g}",
            "possible",
        )


def encoder_noise(position: Array) -> float:
    """Return the standard deviation of noise and resolution of an encoder (T,).

    Noise has 924 times its variance in sixth differences, where a motion leaves little of itself.
    """
    sixth = 1.4826 * float(np.median(np.abs(np.diff(position, 6)))) / np.sqrt(924)
    repeats = bool(np.any(np.diff(position) == 0))
    return float(max(sixth, resolution(position) / np.sqrt(12) if repeats else 0.0))


def _too_close(log: Log, j: int, error: Array) -> Iterator[Finding]:
    """Yield a joint whose tracking error is mostly the noise of its encoder."""
    assert log.position_command is not None
    joint = log.joint_names[j]
    position = log.position_command[:, j] - error
    noise = encoder_noise(position)
    size = float(np.std(error))
    if size > _NOISY * noise or is_constant(position):
        return
    yield Finding(
        "unidentifiable",
        f"the position of {joint} follows its command within {1e3 * size:.3g} mrad (rms), "
        f"{size / noise if noise else 1.0:.2g} times the noise and resolution of its encoder "
        f"({1e3 * noise:.2g} mrad): what its controller gives is mostly noise, and no parameter is "
        "identifiable from it",
        joint,
        "doubtful",
        {"tracking error over noise": size / noise if noise else 0.0},
        "record a faster motion, lower gains, or a payload; or log the torque",
        "certain",
    )


_NEAR_ZERO, _AWAY, _RETURNS, _FINE = 0.02, 0.1, 8, 20
"""A channel that is never negative and so often falls below the first share of its size, from above
the second one, is a magnitude: noise about zero would be negative half of the time. Without the
second one, noise counted many times in a foot that lost its load once. One of fewer levels is too
coarse to say."""

_RESAMPLED = 0.005
"""What interpolation onto another clock leaves below zero of a magnitude, over its size; 0.002 at
most in the SO-101 logs, after which this was chosen."""

_PROPORTIONAL = 0.99
"""Correlation with the tracking error, or its size, from which a torque is computed from it: the
current loops of real drives leave more noise, friction of the current sensor and delay."""


_FOLDED, _FEWEST = 0.5, 0.05
"""A torque without sign falls with a tracking error below zero and rises with one above it, each by
a correlation of at least so much in at least this share of the samples."""


def no_measurements(robot: Robot, log: Log) -> Iterator[Finding]:
    """Yield the torques and currents that are magnitudes, or computed from the tracking error."""
    for field in ("motor_torque", "joint_torque", "motor_current"):
        values = getattr(log, field)
        for j, joint in enumerate(log.joint_names if values is not None else ()):
            drive = robot.drives.get(joint)
            torque = values[:, j]
            if drive is None or drive.controller is not None or not np.all(np.isfinite(torque)):
                continue
            error = _tracking_error(log, j, drive.ratio)
            is_magnitude = _is_magnitude(torque) or _is_folded(error, torque)
            varies = not (is_constant(torque) or is_constant(error) or np.isnan(error[0]))
            r = abs(float(np.corrcoef(error, torque)[0, 1])) if varies else 0.0
            if not is_magnitude and r < _PROPORTIONAL:
                continue
            gain = drive.ratio * float(np.std(torque) / np.std(error)) if varies else 0.0
            what = "has no sign: it is a magnitude and returns to zero without crossing it"
            if not is_magnitude:
                what = f"is {gain:.4g} times the tracking error (correlation {r:.4f})"
            yield Finding(
                "no-measurement",
                f"the {field.replace('_', ' ')} of {joint} {what}, so that it measures no torque",
                joint,
                "wrong" if is_magnitude else "doubtful",
                {"correlation with the tracking error": r},
                _with_commands(joint, drive.ratio, None if is_magnitude else gain),
                "likely",
            )


def _with_commands(joint: str, ratio: float, gain: float | None) -> str:
    """Return the drive table of a joint whose position commands replace its torque."""
    known = "20.0  # write the gain of your controller" if gain is None else f"{gain:.4g}"
    return (
        f'in the drives file:\n{toml_table(joint)}\ntype = "stiff"\ngear_ratio = {ratio:.6g}\n'
        f'motor_input = "position_command"\n{toml_table(joint, "controller")}\n'
        f"position_gain_Nm_per_rad = {known}"
    )


def is_unsigned(torque: Array) -> bool:
    """Whether a channel (T,) is never negative, but for what resampling leaves."""
    return bool(np.min(torque) >= -_RESAMPLED * np.percentile(np.abs(torque), 99))


def _is_magnitude(torque: Array) -> bool:
    """Whether a channel (T,) has one sign only and returns to zero again and again."""
    size = float(np.percentile(np.abs(torque), 99))
    if (
        size == 0
        or len(np.unique(torque)) < _FINE
        or not (is_unsigned(torque) or is_unsigned(-torque))
    ):
        return False
    near, away = np.abs(torque) <= _NEAR_ZERO * size, np.abs(torque) > _AWAY * size
    there = near[near | away]
    return int(np.count_nonzero(there[1:] & ~there[:-1])) >= _RETURNS


def controlled_position(log: Log, j: int, ratio: float) -> Array:
    """Return the position (T,) at the joint that its controller sees: by the motor if it is logged.

    NaN without either encoder.
    """
    motor = log.motor_position[:, j] / ratio
    return log.joint_position[:, j] if np.isnan(motor[0]) else motor


def _tracking_error(log: Log, j: int, ratio: float) -> Array:
    """Return command less position (T,) at the joint, NaN without either."""
    position, command = controlled_position(log, j, ratio), log.position_command
    return np.full(len(position), np.nan) if command is None else command[:, j] - position


def _is_folded(error: Array, torque: Array) -> bool:
    """Whether a torque (T,) without sign rises with the size of the error (T,) on both sides."""
    if np.isnan(error[0]) or not is_unsigned(torque):
        return False
    for side, part in ((1, error > 0), (-1, error < 0)):
        if np.mean(part) < _FEWEST or is_constant(error[part]) or is_constant(torque[part]):
            return False
        if side * np.corrcoef(error[part], torque[part])[0, 1] < _FOLDED:
            return False
    return True


_MOST_JOINTS = 12
"""Most joints in a message."""


def separation_findings(robot: Robot, motions: Sequence[Motion]) -> Iterator[Finding]:
    """Yield, before a fit, what logs with one gain set determine of armature, friction and delay.

    Of stiff drives; a delay that counts as known, but not exactly, is free here.
    """
    within = {joint: stated_delay_s(drive) for joint, drive in robot.drives.items()}
    joints = [joint for joint in within if within[joint] and not robot.drives[joint].is_elastic]
    if not joints or not is_linear(robot, joints) or robot.floating_base is not None:
        return
    free = {joint: _with_free_delay(robot.drives[joint], within[joint]) for joint in joints}
    robot = robot.with_drives(free)
    model = load_model_of(robot, motions, joints)
    rows = stacked([load_regression(robot, motion, model, {}) for motion in motions])
    noise = _residual_std(rows)
    H, is_delay = rows.H / noise[:, None], np.array([DELAY in str(one) for one in rows.names])
    for bus in buses_of(robot.drives, rows.names):
        own = H[:, list(bus.places)].sum(axis=1)
        change = scaled_svd(H[:, ~is_delay]).solve(own)
        slopes = dict(zip(np.array(rows.names)[~is_delay].tolist(), change.tolist(), strict=True))
        left = (own - H[:, ~is_delay] @ change)[np.any(H[:, list(bus.places)] != 0, axis=1)]
        bus_joints = [rows.names[place].split(" of ")[1] for place in bus.places]
        reach = NORMAL_95 * bus.std_s
        size = float(np.sqrt(np.mean(left**2)))
        yield _separation(robot, bus_joints, slopes, reach, reach * size)


def _with_free_delay(drive: Drive, within_s: float) -> Drive:
    known = tuple(name for name in drive.known if name != DELAY)
    return replace(drive, known=known, std={**drive.std, "command_delay_s": within_s / NORMAL_95})


def _residual_std(rows: Regression) -> Array:
    """Return the rms residual (R,) of the joint of each row, from rows weighted by their torque."""
    found = np.ones(len(rows.y))
    for size in (rows.y, None):
        theta = scaled_svd(rows.H / found[:, None]).solve(rows.y / found)
        left = rows.y - rows.H @ theta if size is None else size
        for joint in np.unique(rows.joint):
            own = rows.joint == joint
            found[own] = max(float(np.sqrt(np.mean(left[own] ** 2))), np.finfo(float).tiny)
    return found


def _separation(
    robot: Robot, joints: Sequence[str], slopes: Mapping[str, float], reach: float, left: float
) -> Finding:
    """Return the finding of one bus; `left` is the effect of `reach` [s] over the residual."""
    texts, evidence = [], {"effect of the delay that nothing else has, over the residual": left}
    for joint in joints:
        sums, alone = [], []
        for name, parameter in (("armature", "motor_inertia"), ("friction", "viscous_friction")):
            slope = slopes.get(JointParameter(parameter, joint))
            if slope is not None:
                slope *= robot.drives[joint].ratio ** 2
                sums.append(f"{name} + {slope:.3g} T")
                alone.append(f"+-{abs(slope) * reach:.2g}")
                evidence[f"{name} of {joint} per second of delay"] = slope
        if sums:
            texts.append(f"{joint} {' and '.join(sums)} ({' and '.join(alone)} alone)")
    is_separate = left > 1
    verdict = (
        "separates the delay T of the commands from rotor inertia and viscous friction"
        if is_separate
        else "does not separate the delay T of the commands from rotor inertia and viscous "
        "friction; it determines sums, and each alone only as well as T is known: "
        f"{'; '.join(texts[:_MOST_JOINTS])}"
    )
    return Finding(
        "command-delay",
        f"before a fit: this log {verdict}. {reach * 1e3:.3g} ms of T change the torque by "
        f"{left:.2g} times the residual beyond what these and the other parameters explain",
        severity="note",
        evidence=evidence,
        remedy=""
        if is_separate
        else "add a log with other gains to identify_conditions, or a known delay in the "
        'drives file:\ncommand_delay_s = 0.004\nknown = ["command_delay"]',
        certainty="certain",
    )
