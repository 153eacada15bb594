"""Commands of a log before a fit: signs, units, repeats, limits, tracking errors and delays.

A controller takes the place of a torque sensor: what its commands, gains and limits contradict is
seen in the log alone. Torques that are none, without sign or computed from the tracking error,
are seen by the same signals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from seaid._arrays import Array, is_constant, resolution
from seaid.checks import codes
from seaid.checks import tolerances as tol
from seaid.checks.check import (
    Channel,
    Observation,
    channels_of,
    excluding_torque,
    in_description,
    in_drives,
    observed,
    only_joint,
)
from seaid.checks.experiment import (
    Experiment,
    fitted,
    flipped,
    scaled,
)
from seaid.drives import (
    DELAY_PARAMETER,
    NORMAL_95,
    Controller,
    Drive,
    JointParameter,
    buses_of,
    delay_std_s,
    is_stated,
    stated_delay_s,
)
from seaid.errors import Finding, Severity, listed
from seaid.estimation import Estimate, scaled_svd
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


@dataclass(frozen=True, eq=False)
class Commanded:
    """A joint with a controller in a log.

    `command` and `position` (T,) are those at the joint; the position is that of the encoder which
    the controller sees, of the motor if it was logged.
    """

    robot: Robot
    log: Log
    joint: str
    law: Controller
    command: Array
    position: Array

    @property
    def place(self) -> int:
        """The column of the joint in the log."""
        return self.log.joint_names.index(self.joint)

    @property
    def error(self) -> Array:
        """The tracking error (T,)."""
        return np.asarray(self.command - self.position)

    @property
    def unit(self) -> str:
        """The unit of the position."""
        return "m" if self.log.is_prismatic[self.place] else "rad"

    def asked(self) -> Array:
        """Return the torque (T,) at the joint for which the controller asks without a limit."""
        index = self.robot.index(self.joint)
        columns = [self.log.joint_names.index(joint) for joint in self.robot.joint_names]
        signals = {name: values[:, columns] for name, values in self.log.sensors().items()}
        velocity = spline_derivatives(self.log.time, self.position[:, None])[1][:, 0]
        commanded = commanded_part(self.robot, self.log.time, signals, index)
        supply = relative_supply(self.robot, self.log.time, signals, index)
        unlimited = replace(self.law, torque_limit_Nm=math.inf)
        return unlimited.torque(commanded, self.position, velocity, supply)[0]


def command_findings(robot: Robot, log: Log) -> Iterator[Finding]:
    """Yield what is wrong or worth knowing with the position commands of a log.

    A command with another sign or unit than its position makes the other checks meaningless.
    """
    for j, joint in enumerate(log.joint_names if log.position_command is not None else ()):
        drive = robot.drives.get(joint)
        if drive is None or drive.controller is None or log.position_command is None:
            continue
        command, position = log.position_command[:, j], _controlled_position(log, j, drive.ratio)
        if np.isnan(command[0]) or np.isnan(position[0]):
            continue
        commanded = Commanded(robot, log, joint, drive.controller, command, position)
        yield from list(_not_following(commanded)) or observed(_OF_COMMANDS, commanded)


def _controlled_position(log: Log, j: int, ratio: float) -> Array:
    """Return the position (T,) at joint j that its controller sees, NaN without either encoder."""
    motor = log.motor_position[:, j] / ratio
    return log.joint_position[:, j] if np.isnan(motor[0]) else motor


def _not_following(commanded: Commanded) -> Iterator[Finding]:
    """Yield a command with another sign or unit than its position: a loop that follows has r = 1.

    Lag and resonance change a range by less than a factor of exp(1/2).
    """
    command, position, joint = commanded.command, commanded.position, commanded.joint
    if is_constant(command) or is_constant(position):
        return
    r = float(np.corrcoef(command, position)[0, 1])
    times = float(np.std(command) / np.std(position))
    is_other_unit = r >= tol.MOST and max(times, 1 / times) >= tol.FAR
    if r > -tol.MOST and not is_other_unit:
        return
    per_degree = math.pi / 180
    factor, code = -1.0, codes.SIGN
    words = f"moves against its position (correlation {r:.3f}): it has the opposite sign"
    if is_other_unit:
        is_degrees = abs(math.log(times * per_degree)) < tol.MOST
        factor, code = float(f"{per_degree if is_degrees else 1 / times:.4g}"), codes.UNIT
        unit = "degrees" if is_degrees else "another unit"
        words = f"has {times:.4g} times the range of its position: it is in {unit}"
    source = commanded.log.sources()[joint]["position_command"]
    yield code.finding(
        f"the position command of {joint} {words}",
        joint,
        "wrong",
        {"correlation": r, "ratio of the ranges": times},
        in_description({joint: {"position_command": changed_source(source, factor=factor)}}),
        "certain",
    )


def _repeats(commanded: Commanded) -> Iterator[Finding]:
    """Yield commands of which some are logged twice; held ones, all alike, are no finding."""
    time, command, joint = commanded.log.time, commanded.command, commanded.joint
    period_s = float(time[-1] - time[0]) / (len(time) - 1)
    runs = np.diff(np.flatnonzero(np.diff(command) != 0))
    runs = runs[runs * period_s < tol.HELD_S]  # longer ones are rests
    if len(runs) < tol.POOR * len(command) or np.median(runs) > 1:
        return
    share = float(np.sum(runs - 1) / np.sum(runs))
    if share < tol.FEW:
        return
    longest_ms = 1e3 * period_s * float(np.percentile(runs - 1, 99))
    yield codes.DELAY.finding(
        f"{share:.1%} of the position commands of {joint} repeat the one before while others "
        f"change: they are logged twice or late, by {longest_ms:.3g} ms and more at times",
        joint,
        evidence={"share of repeated commands": share},
        remedy="log each command with the time at which it was sent",
    )


def _at_stop(commanded: Commanded) -> Iterator[Finding]:
    """Yield a joint that is commanded beyond its limits and does not follow there."""
    robot, joint, unit = commanded.robot, commanded.joint, commanded.unit
    lower, upper = robot.position_range(joint)

    def beyond(place: Array) -> Array:
        return np.asarray(np.maximum(np.maximum(place - upper, lower - place), 0.0))

    command = beyond(commanded.command)
    share, farthest = float(np.mean(command > 0)), float(np.max(command))
    if share < tol.FEW or np.sum(beyond(commanded.position)) > tol.MOST * np.sum(command):
        return
    others = [name for name in robot.joint_names if name != joint]
    yield codes.CONTACT.finding(
        f"{joint} is commanded beyond its limits in the robot file, from {lower:.4g} to "
        f"{upper:.4g} {unit}, in {share:.0%} of the samples, by up to {farthest:.3g} {unit}, and "
        "does not follow there: at its stop its controller pushes against a force that is not in "
        "the model",
        joint,
        "wrong" if share > tol.MOST else "doubtful",
        {"share beyond the limits": share, "farthest beyond": farthest},
        f"command it within its limits{excluding_torque(others)}",
    )


def _limited(commanded: Commanded) -> Iterator[Finding]:
    """Yield a controller that is at its limit, or asks more than the limit of the robot file."""
    robot, joint, limit = commanded.robot, commanded.joint, commanded.law.torque_limit_Nm
    is_stated = bool(np.isfinite(limit))
    if not is_stated:
        if robot.drives[joint].is_up_to_scale:
            return  # its gains are in other units than the limit
        limit = float(robot.effort_limits[robot.index(joint)])
    asked = np.abs(commanded.asked())
    share = float(np.mean(asked > limit)) if limit > 0 else 0.0
    if share < tol.FEW:
        return
    times, evidence = float(np.median(asked)) / limit, {"share at the limit": share}
    # bodies of the robot file show another unit better than its limits
    if times > tol.MANY_TIMES and (is_stated or not np.any(robot.parameters)):
        yield codes.GAIN_SCALE.finding(
            f"the controller of {joint} asks for more than its torque limit, {limit:.4g} N m, in "
            f"{share:.0%} of the samples, and for {times:.3g} times as much on average: its gains "
            "are in another unit than the limit, such as units of the drive (counts, 1/256, per "
            "degree)",
            joint,
            evidence={**evidence, "median torque over its limit": times},
            remedy="gains in N m/rad, or gains and limit in units of the drive and their scale as "
            "a parameter with known bodies, "
            + in_drives({(joint, "controller"): "is_up_to_scale = true"}),
        )
    elif is_stated:
        yield codes.SATURATION.finding(
            f"the controller of {joint} asks for more than its torque limit, {limit:.4g} N m, in "
            f"{share:.1%} of the samples: the limit counts as its torque there",
            joint,
            "note",
            evidence,
            certainty="certain",
        )
    else:
        yield codes.SATURATION.finding(
            f"the controller of {joint} asks for up to {float(np.max(asked)):.3g} N m, in "
            f"{share:.1%} of the samples more than the effort limit of the robot file "
            f"({limit:.4g} N m), and has no torque limit",
            joint,
            evidence=evidence,
            remedy=in_drives({(joint, "controller"): f"torque_limit_Nm = {limit:.4g}"}),
        )


def _ignored(commanded: Commanded) -> Iterator[Finding]:
    """Yield velocity commands for which a controller of velocities has no gain."""
    rates, law, joint = commanded.log.velocity_command, commanded.law, commanded.joint
    gain = law.velocity_gain_Nms_per_rad
    if rates is None or not gain or law.command_velocity_gain_Nms_per_rad:
        return
    largest = float(np.max(np.abs(rates[:, commanded.place])))
    if largest > 0:  # False for a joint without them, too, whose samples are NaN
        line = f"command_velocity_gain_Nms_per_rad = {gain:g}"
        yield codes.UNUSED_COMMAND.finding(
            f"the log has velocity commands of {joint}, of up to {largest:.3g} {commanded.unit}/s, "
            "and its controller has no gain for them: they are not used",
            joint,
            evidence={"largest velocity command": largest},
            remedy=in_drives({(joint, "controller"): line}, "if the drive gets them"),
            certainty="possible",
        )


def _encoder_noise(position: Array) -> float:
    """Return the standard deviation of noise and resolution of an encoder (T,).

    Noise has 924 times its variance in sixth differences, where a motion leaves little of itself.
    """
    sixth = 1.4826 * float(np.median(np.abs(np.diff(position, 6)))) / math.sqrt(924)
    repeats = bool(np.any(np.diff(position) == 0))
    return float(max(sixth, resolution(position) / math.sqrt(12) if repeats else 0.0))


def _too_close(commanded: Commanded) -> Iterator[Finding]:
    """Yield a joint whose tracking error is mostly the noise of its encoder."""
    joint, size = commanded.joint, float(np.std(commanded.error))
    noise = _encoder_noise(commanded.position)
    if size > tol.SURE * noise or is_constant(commanded.position):
        return
    yield codes.UNIDENTIFIABLE.finding(
        f"the position of {joint} follows its command within {1e3 * size:.3g} mrad (rms), "
        f"{size / noise if noise else 1.0:.2g} times the noise and resolution of its encoder "
        f"({1e3 * noise:.2g} mrad): what its controller gives is mostly noise, and no parameter is "
        "identifiable from it",
        joint,
        evidence={"tracking error over noise": size / noise if noise else 0.0},
        remedy="record a faster motion, lower gains, or a payload; or log the torque",
        certainty="certain",
    )


_OF_COMMANDS = (
    Observation(codes.DELAY, _repeats),
    Observation(codes.CONTACT, _at_stop),
    Observation(codes.SATURATION, _limited),
    Observation(codes.UNUSED_COMMAND, _ignored),
    Observation(codes.UNIDENTIFIABLE, _too_close),
)


def no_measurements(robot: Robot, log: Log) -> Iterator[Finding]:
    """Yield the torques and currents that are magnitudes, or computed from the tracking error.

    The current loop of a real drive leaves more noise, friction of the sensor and delay.
    """
    for quantity in ("motor_torque", "joint_torque", "motor_current"):
        channels = list(channels_of(log, log.joint_names, quantity))
        returns = _returns([channel.values for channel in channels])
        for channel, count in zip(channels, returns, strict=True):
            drive = robot.drives.get(channel.joint)
            if drive is not None and drive.controller is None:
                yield from _no_measurement(log, channel, drive.ratio, count)


def _no_measurement(log: Log, channel: Channel, ratio: float, returns: int) -> Iterator[Finding]:
    """Yield a torque or current that is a magnitude, or computed from the tracking error."""
    j, torque = log.joint_names.index(channel.joint), channel.values
    error = np.full(len(torque), np.nan)
    if log.position_command is not None:
        error = log.position_command[:, j] - _controlled_position(log, j, ratio)
    r, known = abs(_correlation(error, torque)), "20.0  # write the gain of your controller"
    is_magnitude = returns >= tol.EVENTS or _is_folded(error, torque)
    what = "has no sign: it is a magnitude and returns to zero without crossing it"
    if not is_magnitude:
        if r < 1 - tol.FEW:
            return
        gain = ratio * float(np.std(torque) / np.std(error))
        known = f"{gain:.4g}"
        what = f"is {known} times the tracking error (correlation {r:.4f})"
    drive = f'type = "stiff"\ngear_ratio = {ratio:.6g}\nmotor_input = "position_command"'
    law = f"position_gain_Nm_per_rad = {known}"
    yield codes.NO_MEASUREMENT.finding(
        f"the {channel.quantity.replace('_', ' ')} of {channel.joint} {what}, so that it measures "
        "no torque",
        channel.joint,
        "wrong" if is_magnitude else "doubtful",
        {"correlation with the tracking error": r},
        in_drives({(channel.joint,): drive, (channel.joint, "controller"): law}),
    )


def _correlation(first: Array, second: Array) -> float:
    """Return the correlation of two channels (T,), zero for constant ones and unknown ones."""
    if len(first) == 0 or is_constant(first) or is_constant(second) or np.isnan(first[0]):
        return 0.0
    return float(np.corrcoef(first, second)[0, 1])


def is_unsigned(torque: Array) -> bool:
    """Whether a channel (T,) is never negative, but for what resampling leaves."""
    return bool(np.min(torque) >= -tol.NEGLIGIBLE * np.percentile(np.abs(torque), 99))


def _returns(torques: Sequence[Array]) -> list[int]:
    """Return how often channels (T,) of one sign return to zero and do not cross it.

    The returns of all joints count together where no joint has a torque below zero: joints that
    gravity pulls to one side seldom return.
    """
    counts = [_returns_of(torque) for torque in torques]
    is_of_all = len(counts) > 1 and all(is_unsigned(torque) for torque in torques)
    return [sum(counts)] * len(counts) if is_of_all else counts


def _returns_of(torque: Array) -> int:
    """Return how often a channel (T,) of one sign falls from half of its size to a slight part.

    Between levels that are nearer, noise alone passes often, on a foot that loses its load once and
    on a joint that gravity pulls to one side.
    """
    size = float(np.percentile(np.abs(torque), 99))
    has_one_sign = is_unsigned(torque) or is_unsigned(-torque)
    is_coarse = len(np.unique(torque)) * tol.SLIGHT < 1  # then zero is no level of its own
    if size == 0 or is_coarse or not has_one_sign:
        return 0
    near, away = np.abs(torque) <= tol.SLIGHT * size, np.abs(torque) > tol.MOST * size
    if np.mean(~near & (np.abs(torque) < (1 - tol.SLIGHT) * size)) < tol.FEW:
        return 0  # a signed integer without its sign is at both ends only
    levels = near[near | away]
    return int(np.count_nonzero(levels[1:] & ~levels[:-1]))


def _is_folded(error: Array, torque: Array) -> bool:
    """Whether a torque (T,) without sign rises with the size of the error (T,) on both sides."""
    if np.isnan(error[0]) or not is_unsigned(torque):
        return False
    sides = ((1, error > 0), (-1, error < 0))
    return all(
        np.mean(part) >= tol.SLIGHT and side * _correlation(error[part], torque[part]) >= tol.MOST
        for side, part in sides
    )


_OTHER_GAINS = (
    "add a log with other gains to identify_conditions, or a known delay in the drives file:\n"
    'command_delay_s = 0.004\nknown = ["command_delay"]'
)


def separation_findings(robot: Robot, motions: Sequence[Motion]) -> Iterator[Finding]:
    """Yield, before a fit, what logs with one gain set determine of armature, friction and delay.

    Of stiff drives; a delay that counts as known, but not exactly, is free here.
    """
    free = _free_delays(robot)
    if not free or not is_linear(robot, list(free)) or robot.floating_base is not None:
        return
    robot = robot.with_drives(free)
    model = load_model_of(robot, motions, list(free))
    rows = stacked([load_regression(robot, motion, model, {}) for motion in motions])
    H = rows.H / _residual_std(rows)[:, None]
    is_delay = np.array([DELAY_PARAMETER in str(name) for name in rows.names])
    others, names = H[:, ~is_delay], np.array(rows.names)[~is_delay].tolist()
    for bus in buses_of(robot.drives, rows.names):
        columns = H[:, list(bus.places)]
        change = scaled_svd(others).solve(columns.sum(axis=1))
        unshared = (columns.sum(axis=1) - others @ change)[np.any(columns != 0, axis=1)]
        reach = NORMAL_95 * bus.std_s
        effect = reach * float(np.sqrt(np.mean(unshared**2)))
        of_bus = [rows.names[place].split(" of ")[1] for place in bus.places]
        slopes = dict(zip(names, change.tolist(), strict=True))
        yield _separation(robot, of_bus, slopes, reach, effect)


def _free_delays(robot: Robot) -> dict[str, Drive]:
    """Return the stiff drives whose delay counts as known, but not exactly, with a free one."""
    within = {joint: stated_delay_s(drive) for joint, drive in robot.drives.items()}
    return {
        joint: replace(
            drive,
            known=tuple(name for name in drive.known if name != DELAY_PARAMETER),
            std={**drive.std, "command_delay_s": within[joint] / NORMAL_95},
        )
        for joint, drive in robot.drives.items()
        if within[joint] and not drive.is_elastic
    }


def _residual_std(rows: Regression) -> Array:
    """Return the rms residual (R,) of the joint of each row, from rows weighted by their torque."""
    _, place = np.unique(rows.joint, return_inverse=True)

    def rms(values: Array) -> Array:
        squares = np.bincount(place, values**2) / np.bincount(place)
        return np.sqrt(np.maximum(squares, np.finfo(float).tiny))[place]

    size = rms(rows.y)
    theta = scaled_svd(rows.H / size[:, None]).solve(rows.y / size)
    return rms(rows.y - rows.H @ theta)


def _separation(
    robot: Robot, joints: Sequence[str], slopes: Mapping[str, float], reach: float, effect: float
) -> Finding:
    """Return the finding of one bus; `effect` is that of `reach` [s] over the residual."""
    texts = []
    evidence = {"effect of the delay that nothing else has, over the residual": effect}
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
    verdict, but, remedy = "separates", "", ""
    if effect <= 1:
        verdict, remedy = "does not separate", _OTHER_GAINS
        but = "; it determines sums, and each alone only as well as T is known: "
        but += "; ".join(texts[: tol.MOST_LISTED])
    return codes.COMMAND_DELAY.finding(
        f"before a fit: this log {verdict} the delay T of the commands from rotor inertia and "
        f"viscous friction{but}. {reach * 1e3:.3g} ms of T change the torque by {effect:.2g} times "
        "the residual beyond what these and the other parameters explain",
        severity="note",
        evidence=evidence,
        remedy=remedy,
        certainty="certain",
    )


def delay_estimate_findings(robot: Robot, load_side: Estimate) -> Iterator[Finding]:
    """Yield, after a fit, sums that the log determines in place of delays, and unusual delays."""
    sums: dict[str, str] = {}
    evidence: dict[str, float] = {}
    stated_s: list[float] = []
    unusual: dict[float, list[str]] = {}
    for place, joint in _delays(load_side):
        drive = robot.drives[joint]
        delay, std = float(load_side.values[place]), float(load_side.standard_errors[place])
        is_sure = abs(delay) > tol.SIGNIFICANT * std and DELAY_PARAMETER not in drive.known
        if is_sure and not -tol.LEAST_DELAY_S < delay < tol.LATE_S:
            unusual.setdefault(round(delay, 4), []).append(joint)
        inertia = JointParameter("motor_inertia", joint)
        if is_stated(std, delay_std_s(drive)) and inertia in load_side.names:
            slope, value, error = _sum_with_delay(load_side, place, inertia)
            scale = drive.ratio**2
            sums[joint] = f"{joint} {scale * value:.3g} +- {NORMAL_95 * scale * error:.2g}"
            evidence[f"armature and {scale * slope:.3g} delay of {joint}"] = scale * value
            stated_s.append(std)
    if sums:
        yield codes.COMMAND_DELAY.finding(
            "the log does not separate the delay of the commands from rotor inertia and friction: "
            f"it counts as known to +-{NORMAL_95 * max(stated_s) * 1e3:.3g} ms, which is in all "
            "intervals. Within one gain set it determines armature + (K_d + F_v) delay "
            f"[kg m^2], with 95 %: {listed(sums.values(), tol.MOST_LISTED)}",
            severity="note",
            evidence=evidence,
            remedy=_OTHER_GAINS,
            certainty="certain",
        )
    for delay, joints in unusual.items():
        yield _unusual_delay(delay, joints)


def _delays(load_side: Estimate) -> Iterator[tuple[int, str]]:
    """Yield the places of delays of commands in an estimate, and their joints."""
    for place, name in enumerate(load_side.names):
        if isinstance(name, JointParameter) and name.parameter == DELAY_PARAMETER:
            yield place, name.joint


def _sum_with_delay(
    load_side: Estimate, place: int, inertia: JointParameter
) -> tuple[float, float, float]:
    """Return K_d + F_v, the rotor inertia plus that times the delay, and its standard error."""
    row, std = load_side.names.index(inertia), load_side.standard_errors[place]
    slope = -load_side.covariance[row, place] / std**2  # over N^2, as the rest
    error = np.sqrt(max(load_side.covariance[row, row] - (slope * std) ** 2, 0.0))
    value = load_side.values[row] + slope * load_side.values[place]
    return float(slope), float(value), float(error)


def _unusual_delay(delay: float, joints: Sequence[str]) -> Finding:
    """Return the finding on commands that act before their time, or later than on any bus."""
    severity: Severity = "note"
    when, cause = "before", "they are logged late, or the positions early"
    if delay > 0:
        severity, when = "doubtful", "after"
        cause = "no bus is so slow: positions or commands have another clock, or the drive "
        cause += "filters or interpolates commands"
    return codes.DELAY.finding(
        f"the commands of {listed(joints, tol.MOST_LISTED)} act {1e3 * abs(delay):.3g} ms {when} "
        f"their time in the log: {cause}",
        only_joint(joints),
        severity,
        {"delay [s]": delay},
        "log command and position with one clock, each with the time at which it is sent or "
        "measured; the other parameters do not depend on it",
    )


def _commanded_joints(experiment: Experiment) -> list[int]:
    """Return the joints whose torque is that of a controller with gains in N m."""
    drives = [*experiment.robot.drives.values()]
    return [j for j in experiment.used if drives[j].controller is not None]


def _by_bodies(experiment: Experiment, j: int) -> tuple[Array, Array]:
    """Return columns (R, 5) of the bodies, friction and rotor, and the controller's torque (R,)."""
    of_bodies = experiment.regressor[:, j] @ experiment.bodies
    rotor = experiment.lever[j] * experiment.motor[2][:, j]
    columns = np.column_stack([of_bodies, experiment.friction[j], rotor])
    return columns, experiment.lever[j] * experiment.torque[:, j]


def _unexplained_share(columns: Array, y: Array) -> float:
    """Return the residual of a fit over y (R,), both as standard deviations."""
    residual = y - columns @ fitted(columns, y)[0]
    return float(np.std(residual) / max(float(np.std(y)), np.finfo(float).tiny))


def hidden_limits(experiment: Experiment) -> Iterator[Finding]:
    """Yield controllers without a limit whose torque ends at one, by the motion that follows.

    The torque that they ask for is cut at levels; with the right one, bodies, friction and rotor
    inertia leave little of the residual.
    """
    for j in _commanded_joints(experiment) if np.all(np.isfinite(experiment.bodies)) else ():
        joint = experiment.robot.joint_names[j]
        law = experiment.robot.drives[joint].controller
        if law is None or np.isfinite(law.torque_limit_Nm):
            continue
        columns, asked = _by_bodies(experiment, j)
        before = _unexplained_share(columns, asked)
        levels = np.quantile(np.abs(asked), np.linspace(0.3, 0.98, 35))
        after = {
            level: _unexplained_share(columns, np.clip(asked, -level, level))
            for level in levels.tolist()
            if level > 0
        }
        limit = min(after, key=after.__getitem__, default=0.0)
        if before < tol.SLIGHT or not after or after[limit] > tol.SEVERE * before:
            continue
        share = float(np.mean(np.abs(asked) > limit))
        line = f"torque_limit_Nm = {limit:.3g}  # write that of your drive"
        yield codes.SATURATION.finding(
            f"the controller of {joint} has no torque limit and asks for up to "
            f"{float(np.max(np.abs(asked))):.3g} N m, but the joint moves as if its torque "
            f"ended at about {limit:.3g} N m ({share:.0%} of the samples): that leaves "
            f"{after[limit]:.2g} of the torque unexplained, no limit {before:.2g}",
            joint,
            "wrong",
            {"torque limit": limit, "unexplained": after[limit], "without a limit": before},
            in_drives({(joint, "controller"): line}),
            joints=(joint,),
        )


def gain_findings(experiment: Experiment) -> tuple[list[Finding], Experiment]:
    """Return gains in another unit than N m by the bodies of the robot file, and it with N m.

    What is so on each joint that shows it counts as so on the others.
    """
    factors = _gain_factors(experiment)
    off = {j: pair for j, pair in factors.items() if not 1 / tol.TWICE < pair[0] < tol.TWICE}
    if not off:
        return [], experiment
    changes = {j: factor for j, (factor, _) in off.items()}
    if len(off) == len(factors):
        middle = float(np.median([*changes.values()]))
        changes = {j: changes.get(j, middle) for j in _commanded_joints(experiment)}
    finding = _gain_finding(experiment, off, sorted(changes))
    for j, factor in changes.items():
        experiment = scaled(experiment, j, {"t": 1 / factor})
    return [finding], experiment


def _gain_factors(experiment: Experiment) -> dict[int, tuple[float, float]]:
    """Return the torque of controllers over that of the bodies, and its standard error, by joint.

    With any friction and any rotor inertia; of joints where it is well known, and where both
    together explain the torque.
    """
    factors: dict[int, tuple[float, float]] = {}
    for j in _commanded_joints(experiment) if np.all(np.isfinite(experiment.bodies)) else ():
        columns, y = _by_bodies(experiment, j)
        x, covariance = fitted(columns, y)
        factor, error = float(x[0]), float(np.sqrt(covariance[0, 0]))
        if factor > 0 and error < tol.POOR * factor and _unexplained_share(columns, y) < tol.SEVERE:
            factors[j] = factor, error
    return factors


def _gain_finding(
    experiment: Experiment, shown: Mapping[int, tuple[float, float]], joints: Sequence[int]
) -> Finding:
    """Return the finding for the factors and standard errors `shown`, and all joints concerned."""
    names = np.array(experiment.robot.joint_names)
    concerned = tuple(names[list(joints)].tolist())
    times = {str(names[j]): factor for j, (factor, _) in shown.items()}
    each = [f"{joint} {_as_text(factor)}" for joint, factor in times.items()]
    others = [joint for joint in concerned if joint not in times]
    more = f"; {listed(others, tol.MOST_LISTED)} as the others" if others else ""
    error = float(np.median([error / factor for factor, error in shown.values()]))
    bodies, scale = "bodies of the robot file", " with known bodies (known_bodies=)"
    if experiment.robot.known_bodies:
        bodies, scale = "known bodies", ""
    return codes.GAIN_SCALE.finding(
        f"the controllers give many times or a fraction of the torque that moves and holds the "
        f"{bodies} ({listed(each, tol.MOST_LISTED)}, +- {error:.1%}{more}): their gains are in "
        "units of the drive (counts, 1/256, per degree) and not in N m, or those bodies are wrong",
        severity="wrong",
        evidence={f"torque of {x} over that of the bodies": times[x] for x in times},
        remedy=f"gains in N m/rad, or their scale as a parameter{scale}, "
        + in_drives(dict.fromkeys([(x, "controller") for x in concerned], "is_up_to_scale = true")),
        joints=concerned,
    )


def _as_text(factor: float) -> str:
    return f"{factor:.3g}" if factor > 1 else f"1/{1 / factor:.3g}"


Poses = dict[int, tuple[float, float]]
"""{joint: sign and offset [rad] of its position}."""


def pose_findings(experiment: Experiment) -> Iterator[Finding]:
    """Yield signs and zeros of joints with position commands that gravity contradicts.

    By gravity on the known bodies. Command and position have one sign and one zero, and the torque
    between them has that sign.
    """
    robot = experiment.robot
    joints = [j for j in _commanded_joints(experiment) if not robot.is_prismatic[j]]
    is_known = bool(robot.known_bodies) and bool(np.all(np.isfinite(experiment.bodies)))
    if not (is_known and joints and np.any(robot.model.gravity.linear)):
        return
    experiment = _with_poses(_thinned(experiment), {})
    if not np.nanmax(experiment.nominal) > tol.POOR:
        return
    cost = partial(_pose_cost, experiment)
    searched = [_searched(experiment, joints, start) for start in _starts(joints, cost)]
    poses = min(searched, key=cost)
    for j in sorted(poses):
        yield from _pose_finding(experiment, poses, j)


def _starts(joints: Sequence[int], cost: Callable[[Poses], float]) -> list[Poses]:
    """Return no change, and two signs: of joints that both carry the load they do nothing alone."""
    pairs: list[Poses] = [{i: (-1.0, 0.0), j: (-1.0, 0.0)} for i, j in combinations(joints, 2)]
    best = min(pairs, key=cost, default={})
    return [{}, best] if best and cost(best) <= cost({}) else [{}]


def _thinned(experiment: Experiment) -> Experiment:
    """Return the experiment at fewer instants, 50 of which decide between poses."""
    part = slice(None, None, max(1, len(experiment.direction) // 50))
    rows = ("log", "direction", "torque", "torque_rate", "sensed")
    changes: dict[str, Any] = {name: getattr(experiment, name)[part] for name in rows}
    changes |= {name: getattr(experiment, name)[:, part] for name in ("motor", "joint")}
    return replace(experiment, **changes)


def _with_poses(experiment: Experiment, poses: Poses) -> Experiment:
    """Return the experiment with sign * position + offset of joints, at both encoders.

    Unknown rotor inertias are those that explain the torques best.
    """
    for j, (sign, offset) in poses.items():
        changed = flipped(experiment, j, "qmt") if sign < 0 else experiment
        joint, motor = changed.joint.copy(), changed.motor.copy()
        joint[0, :, j] += offset
        motor[0, :, j] += changed.lever[j] * offset
        experiment = replace(changed, joint=joint, motor=motor)
    inertia, drives = experiment.inertia.copy(), [*experiment.robot.drives.values()]
    unexplained = experiment.lever * experiment.torque - experiment.regressor @ experiment.bodies
    for j in experiment.used:
        if drives[j].motor_inertia_kg_m2 is None:
            rotor = experiment.lever[j] * experiment.motor[2][:, j]
            columns = np.column_stack([experiment.friction[j], rotor])
            inertia[j] = max(float(scaled_svd(columns).solve(unexplained[:, j])[-1]), 0.0)
    changed = replace(experiment, inertia=inertia)
    vars(changed)["regressor"] = experiment.regressor  # of the same motion: not computed again
    return changed


def _pose_cost(experiment: Experiment, poses: Poses) -> float:
    """Return the cost of signs and zeros: that of the misfit, and a half of each change."""
    changes = sum(0.5 * (sign < 0) + 0.5 * (offset != 0) for sign, offset in poses.values())
    return _with_poses(experiment, poses).cost("nominal") + float(changes)


def _searched(experiment: Experiment, joints: Sequence[int], poses: Poses) -> Poses:
    """Return the signs and zeros that explain most, found joint by joint from a start."""
    cost, before = _pose_cost(experiment, poses), math.inf
    while before - cost >= tol.TIE:  # each pass but the last lowers the cost by a tie or more
        before = cost
        for j in joints:
            others = {i: pose for i, pose in poses.items() if i != j}
            tried = [(_pose_cost(experiment, others), others)]
            for sign in (1.0, -1.0):
                tried += _best_zero(experiment, others, j, sign, cost)
            cheapest, changed = min(tried, key=lambda pair: pair[0])
            if cheapest < cost:
                cost, poses = cheapest, changed
    return poses


def _best_zero(
    experiment: Experiment, others: Poses, j: int, sign: float, most_cost: float
) -> list[tuple[float, Poses]]:
    """Return the best cost, and poses, with a sign of joint j, within its limits.

    A grid that comes nowhere near `most_cost` has none, nor has a zero that is nearly that of the
    robot file.
    """
    robot, moved = experiment.robot, sign * experiment.joint[0][:, j]
    lower, upper = robot.position_range(robot.joint_names[j])
    least = max(lower - float(moved.min()) - tol.BEYOND_RAD, -math.pi)
    most = min(upper - float(moved.max()) + tol.BEYOND_RAD, math.pi)

    def at(offset: float) -> tuple[float, float]:
        return _pose_cost(experiment, others | {j: (sign, offset)}), offset

    first, last = math.radians(tol.GRID_DEG), math.radians(tol.NEAREST_DEG)
    grid = [float(x) for x in np.arange(-6, 7) * first if least <= x <= most]
    best = min(map(at, grid), default=(math.inf, 0.0))
    if best[0] > most_cost + tol.LEAST_GAIN:
        return []
    step = 0.5 * first
    while step > 0.5 * last:
        best, step = min([best, *(at(best[1] + x) for x in (-step, step))]), 0.5 * step
    cost, offset = min(best, at(math.radians(round(math.degrees(best[1])))))
    is_given = sign > 0 and abs(offset) < tol.SURE * last
    return [] if is_given else [(cost, others | {j: (sign, offset)})]


def _pose_finding(experiment: Experiment, poses: Poses, j: int) -> Iterator[Finding]:
    """Yield the finding of one joint, unless the others explain the torques without it."""
    sign, offset = poses[j]
    others = {i: pose for i, pose in poses.items() if i != j}
    gain = _pose_cost(experiment, others) - _pose_cost(experiment, poses)
    before, after = (_with_poses(experiment, each).nominal for each in (others, poses))
    falls = (before > tol.POOR) & (after < tol.MOST * before)
    if gain < tol.LEAST_GAIN or not np.any(falls):
        return
    names, joint = experiment.robot.joint_names, experiment.robot.joint_names[j]
    worst = int(np.argmax(np.where(falls, before / np.maximum(after, 1e-9), 0.0)))
    zero = f"its zero {math.degrees(offset):.0f} degrees from that of the robot file"
    signs = {"the opposite sign": sign < 0, zero: offset != 0}
    parts = [text for text, is_so in signs.items() if is_so]
    same = "\n# the same sign for velocity_command and torque_command, if the log has them"
    yield (codes.SIGN if sign < 0 else codes.ENCODER_OFFSET).finding(
        f"the position of {joint} has {' and '.join(parts)}: the part of the torque of "
        f"{names[worst]} that gravity on the known bodies leaves unexplained falls from "
        f"{before[worst]:.0%} to {after[worst]:.0%}",
        joint,
        "wrong",
        {
            "offset [rad]": offset,
            "misfit as given": float(before[worst]),
            "misfit without it": float(after[worst]),
        },
        in_description({joint: _moved_sources(experiment, j, sign, offset)})
        + (same if sign < 0 else ""),
    )


def _moved_sources(experiment: Experiment, j: int, sign: float, offset: float) -> dict[str, str]:
    """Return the positions and the command of joint j with a sign, and an offset at the joint."""
    sources = {}
    for quantity in (*experiment.logged(j, "qm"), "position_command"):
        moved = offset * (float(experiment.ratio[j]) if quantity == "motor_position" else 1.0)
        source = experiment.source(j, quantity)
        sources[quantity] = changed_source(source, factor=sign, offset=round(moved, 4))
    return sources
