"""Commands of a log before a fit: signs, units, repeats, limits, tracking errors and delays.

A controller takes the place of a torque sensor: what its commands, gains and limits contradict is
seen in the log alone. Torques that are none, without sign or computed from the tracking error,
are seen by the same signals.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from seaid._arrays import Array, is_constant, resolution
from seaid.checks.check import (
    Observation,
    excluding_torque,
    in_description,
    in_drives,
    observed,
    only_joint,
)
from seaid.checks.codes import (
    COMMAND_DELAY,
    CONTACT,
    DELAY,
    ENCODER_OFFSET,
    GAIN_SCALE,
    NO_MEASUREMENT,
    SATURATION,
    SIGN,
    UNIDENTIFIABLE,
    UNIT,
    UNUSED_COMMAND,
)
from seaid.checks.experiment import (
    FALLS,
    LEAST_GAIN,
    SEVERE,
    SUSPICIOUS,
    TIE,
    Experiment,
    fitted,
    flipped,
    scaled,
)
from seaid.checks.tolerances import (
    BEYOND_RAD,
    EVENTS,
    FAR,
    FEW,
    HELD_S,
    LATE_S,
    LEAST_DELAY_S,
    MANY_TIMES,
    MOST,
    NEGLIGIBLE,
    POOR,
    SIGNIFICANT,
    SLIGHT,
    SURE,
    TWICE,
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
from seaid.errors import Finding, listed
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
    is_other_unit = r >= MOST and max(times, 1 / times) >= FAR
    if r > -MOST and not is_other_unit:
        return
    per_degree = math.pi / 180
    is_degrees = abs(math.log(times * per_degree)) < MOST
    code, words = (
        SIGN,
        f"moves against its position (correlation {r:.3f}): it has the opposite sign",
    )
    factor = -1.0
    if is_other_unit:
        unit = "degrees" if is_degrees else "another unit"
        code, words = UNIT, f"has {times:.4g} times the range of its position: it is in {unit}"
        factor = float(f"{per_degree if is_degrees else 1 / times:.4g}")
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
    runs = runs[runs * period_s < HELD_S]  # longer ones are rests
    if len(runs) < POOR * len(command) or np.median(runs) > 1:
        return
    share = float(np.sum(runs - 1) / np.sum(runs))
    if share < FEW:
        return
    longest_ms = 1e3 * period_s * float(np.percentile(runs - 1, 99))
    yield DELAY.finding(
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
    if share < FEW or np.sum(beyond(commanded.position)) > MOST * np.sum(command):
        return
    others = [name for name in robot.joint_names if name != joint]
    yield CONTACT.finding(
        f"{joint} is commanded beyond its limits in the robot file, from {lower:.4g} to "
        f"{upper:.4g} {unit}, in {share:.0%} of the samples, by up to {farthest:.3g} {unit}, and "
        "does not follow there: at its stop its controller pushes against a force that is not in "
        "the model",
        joint,
        "wrong" if share > MOST else "doubtful",
        {"share beyond the limits": share, "farthest beyond": farthest},
        f"command it within its limits{excluding_torque(others)}",
    )


def _limited(commanded: Commanded) -> Iterator[Finding]:
    """Yield a controller that is at its limit, or asks more than the limit of the robot file."""
    robot, joint, law = commanded.robot, commanded.joint, commanded.law
    is_stated_limit = bool(np.isfinite(law.torque_limit_Nm))
    limit = law.torque_limit_Nm
    if not is_stated_limit:
        if robot.drives[joint].is_up_to_scale:
            return  # its gains are in other units than the limit
        limit = float(robot.effort_limits[robot.index(joint)])
    asked = np.abs(commanded.asked())
    share = float(np.mean(asked > limit)) if limit > 0 else 0.0
    if share < FEW:
        return
    times = float(np.median(asked)) / limit
    # bodies of the robot file show another unit better than its limits
    if times > MANY_TIMES and (is_stated_limit or not np.any(robot.parameters)):
        yield GAIN_SCALE.finding(
            f"the controller of {joint} asks for more than its torque limit, {limit:.4g} N m, in "
            f"{share:.0%} of the samples, and for {times:.3g} times as much on average: its gains "
            "are in another unit than the limit, such as units of the drive (counts, 1/256, per "
            "degree)",
            joint,
            evidence={"share at the limit": share, "median torque over its limit": times},
            remedy="gains in N m/rad, or gains and limit in units of the drive and their scale as "
            "a parameter with known bodies, "
            + in_drives({(joint, "controller"): "is_up_to_scale = true"}),
        )
        return
    text = (
        f"asks for more than its torque limit, {limit:.4g} N m, in {share:.1%} of the samples: the "
        "limit counts as its torque there"
        if is_stated_limit
        else f"asks for up to {float(np.max(asked)):.3g} N m, in {share:.1%} of the samples more "
        f"than the effort limit of the robot file ({limit:.4g} N m), and has no torque limit"
    )
    line = in_drives({(joint, "controller"): f"torque_limit_Nm = {limit:.4g}"})
    yield SATURATION.finding(
        f"the controller of {joint} {text}",
        joint,
        "note" if is_stated_limit else "doubtful",
        {"share at the limit": share},
        "" if is_stated_limit else line,
        "certain" if is_stated_limit else "likely",
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
        yield UNUSED_COMMAND.finding(
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
    if size > SURE * noise or is_constant(commanded.position):
        return
    yield UNIDENTIFIABLE.finding(
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
    Observation(DELAY, _repeats),
    Observation(CONTACT, _at_stop),
    Observation(SATURATION, _limited),
    Observation(UNUSED_COMMAND, _ignored),
    Observation(UNIDENTIFIABLE, _too_close),
)


def no_measurements(robot: Robot, log: Log) -> Iterator[Finding]:
    """Yield the torques and currents that are magnitudes, or computed from the tracking error.

    The current loop of a real drive leaves more noise, friction of the sensor and delay.
    """
    for name in ("motor_torque", "joint_torque", "motor_current"):
        values, commands = getattr(log, name), log.position_command
        for j, joint in enumerate(log.joint_names if values is not None else ()):
            drive, torque = robot.drives.get(joint), values[:, j]
            if drive is None or drive.controller is not None or not np.all(np.isfinite(torque)):
                continue
            error = np.full(len(torque), np.nan)
            if commands is not None:
                error = commands[:, j] - _controlled_position(log, j, drive.ratio)
            is_magnitude = _is_magnitude(torque) or _is_folded(error, torque)
            r = abs(_correlation(error, torque))
            if not is_magnitude and r < 1 - FEW:
                continue
            gain = drive.ratio * float(np.std(torque) / np.std(error)) if r else 0.0
            what = "has no sign: it is a magnitude and returns to zero without crossing it"
            if not is_magnitude:
                what = f"is {gain:.4g} times the tracking error (correlation {r:.4f})"
            yield NO_MEASUREMENT.finding(
                f"the {name.replace('_', ' ')} of {joint} {what}, so that it measures no torque",
                joint,
                "wrong" if is_magnitude else "doubtful",
                {"correlation with the tracking error": r},
                _with_commands(joint, drive.ratio, None if is_magnitude else gain),
            )


def _with_commands(joint: str, ratio: float, gain: float | None) -> str:
    """Return the drive table of a joint whose position commands replace its torque."""
    known = "20.0  # write the gain of your controller" if gain is None else f"{gain:.4g}"
    drive = f'type = "stiff"\ngear_ratio = {ratio:.6g}\nmotor_input = "position_command"'
    law = f"position_gain_Nm_per_rad = {known}"
    return in_drives({(joint,): drive, (joint, "controller"): law})


def _correlation(first: Array, second: Array) -> float:
    """Return the correlation of two channels (T,), zero for constant ones and unknown ones."""
    if len(first) == 0 or is_constant(first) or is_constant(second) or np.isnan(first[0]):
        return 0.0
    return float(np.corrcoef(first, second)[0, 1])


def is_unsigned(torque: Array) -> bool:
    """Whether a channel (T,) is never negative, but for what resampling leaves."""
    return bool(np.min(torque) >= -NEGLIGIBLE * np.percentile(np.abs(torque), 99))


def _is_magnitude(torque: Array) -> bool:
    """Whether a channel (T,) has one sign only and returns to zero again and again.

    It returns when it falls from half of its size to a slight part: between levels that are nearer,
    noise alone passes often, on a foot that loses its load once and on a joint that gravity pulls
    to one side.
    """
    size = float(np.percentile(np.abs(torque), 99))
    has_one_sign = is_unsigned(torque) or is_unsigned(-torque)
    is_coarse = len(np.unique(torque)) * SLIGHT < 1  # then zero is no level of its own
    if size == 0 or is_coarse or not has_one_sign:
        return False
    near, away = np.abs(torque) <= SLIGHT * size, np.abs(torque) > MOST * size
    if np.mean(~near & (np.abs(torque) < (1 - SLIGHT) * size)) < FEW:
        return False  # a signed integer without its sign is at both ends only
    levels = near[near | away]
    return int(np.count_nonzero(levels[1:] & ~levels[:-1])) >= EVENTS


def _is_folded(error: Array, torque: Array) -> bool:
    """Whether a torque (T,) without sign rises with the size of the error (T,) on both sides."""
    if np.isnan(error[0]) or not is_unsigned(torque):
        return False
    sides = ((1, error > 0), (-1, error < 0))
    return all(
        np.mean(part) >= SLIGHT and side * _correlation(error[part], torque[part]) >= MOST
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
    within = {joint: stated_delay_s(drive) for joint, drive in robot.drives.items()}
    joints = [joint for joint in within if within[joint] and not robot.drives[joint].is_elastic]
    if not joints or not is_linear(robot, joints) or robot.floating_base is not None:
        return
    free = {joint: _with_free_delay(robot.drives[joint], within[joint]) for joint in joints}
    robot = robot.with_drives(free)
    model = load_model_of(robot, motions, joints)
    rows = stacked([load_regression(robot, motion, model, {}) for motion in motions])
    H = rows.H / _residual_std(rows)[:, None]
    is_delay = np.array([DELAY_PARAMETER in str(name) for name in rows.names])
    others = H[:, ~is_delay]
    for bus in buses_of(robot.drives, rows.names):
        columns = H[:, list(bus.places)]
        change = scaled_svd(others).solve(columns.sum(axis=1))
        names = np.array(rows.names)[~is_delay].tolist()
        slopes = dict(zip(names, change.tolist(), strict=True))
        left = (columns.sum(axis=1) - others @ change)[np.any(columns != 0, axis=1)]
        reach = NORMAL_95 * bus.std_s
        effect = reach * float(np.sqrt(np.mean(left**2)))
        of_bus = [rows.names[place].split(" of ")[1] for place in bus.places]
        yield _separation(robot, of_bus, slopes, reach, effect)


def _with_free_delay(drive: Drive, within_s: float) -> Drive:
    known = tuple(name for name in drive.known if name != DELAY_PARAMETER)
    return replace(drive, known=known, std={**drive.std, "command_delay_s": within_s / NORMAL_95})


def _residual_std(rows: Regression) -> Array:
    """Return the rms residual (R,) of the joint of each row, from rows weighted by their torque."""
    noise = np.ones(len(rows.y))
    for size in (rows.y, None):
        theta = scaled_svd(rows.H / noise[:, None]).solve(rows.y / noise)
        left = rows.y - rows.H @ theta if size is None else size
        for joint in np.unique(rows.joint):
            of_joint = rows.joint == joint
            rms = float(np.sqrt(np.mean(left[of_joint] ** 2)))
            noise[of_joint] = max(rms, np.finfo(float).tiny)
    return noise


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
    is_separate = effect > 1
    verdict = "separates the delay T of the commands from rotor inertia and viscous friction"
    if not is_separate:
        verdict = (
            "does not separate the delay T of the commands from rotor inertia and viscous "
            "friction; it determines sums, and each alone only as well as T is known: "
            f"{'; '.join(texts[:_MOST_JOINTS])}"
        )
    return COMMAND_DELAY.finding(
        f"before a fit: this log {verdict}. {reach * 1e3:.3g} ms of T change the torque by "
        f"{effect:.2g} times the residual beyond what these and the other parameters explain",
        severity="note",
        evidence=evidence,
        remedy="" if is_separate else _OTHER_GAINS,
        certainty="certain",
    )


_MOST_JOINTS = 12
"""Most joints in a message."""


def delay_estimate_findings(robot: Robot, load_side: Estimate) -> Iterator[Finding]:
    """Yield, after a fit, sums that the log determines in place of delays, and unusual delays."""
    sums: dict[str, str] = {}
    evidence: dict[str, float] = {}
    stated_s: list[float] = []
    unusual: dict[float, list[str]] = {}
    for place, name in enumerate(load_side.names):
        if not isinstance(name, JointParameter) or name.parameter != DELAY_PARAMETER:
            continue
        joint, drive = name.joint, robot.drives[name.joint]
        delay, std = load_side.values[place], load_side.standard_errors[place]
        is_sure = abs(delay) > SIGNIFICANT * std and DELAY_PARAMETER not in drive.known
        if is_sure and not -LEAST_DELAY_S < delay < LATE_S:
            unusual.setdefault(round(float(delay), 4), []).append(joint)
        inertia = JointParameter("motor_inertia", joint)
        if not is_stated(std, delay_std_s(drive)) or inertia not in load_side.names:
            continue
        own = load_side.names.index(inertia)
        slope = -load_side.covariance[own, place] / std**2  # K_d + F_v, over N^2
        error = np.sqrt(max(load_side.covariance[own, own] - (slope * std) ** 2, 0.0))
        scale = drive.ratio**2
        value = scale * (load_side.values[own] + slope * delay)
        sums[joint] = f"{joint} {value:.3g} +- {NORMAL_95 * scale * error:.2g}"
        evidence[f"armature and {scale * slope:.3g} delay of {joint}"] = float(value)
        stated_s.append(float(std))
    if sums:
        yield COMMAND_DELAY.finding(
            "the log does not separate the delay of the commands from rotor inertia and friction: "
            f"it counts as known to +-{NORMAL_95 * max(stated_s) * 1e3:.3g} ms, which is in all "
            "intervals. Within one gain set it determines armature + (K_d + F_v) delay "
            f"[kg m^2], with 95 %: {listed(sums.values(), _MOST_JOINTS)}",
            severity="note",
            evidence=evidence,
            remedy=_OTHER_GAINS,
            certainty="certain",
        )
    for delay, joints in unusual.items():
        cause = (
            "they are logged late, or the positions early"
            if delay < 0
            else "no bus is so slow: positions or commands have another clock, or the drive "
            "filters or interpolates commands"
        )
        yield DELAY.finding(
            f"the commands of {listed(joints, _MOST_JOINTS)} act {1e3 * abs(delay):.3g} ms "
            f"{'before' if delay < 0 else 'after'} their time in the log: {cause}",
            only_joint(joints),
            "note" if delay < 0 else "doubtful",
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


def _share_left(columns: Array, y: Array) -> float:
    """Return the residual of a fit over y (R,), both as standard deviations."""
    left = y - columns @ fitted(columns, y)[0]
    return float(np.std(left) / max(float(np.std(y)), np.finfo(float).tiny))


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
        before = _share_left(columns, asked)
        levels = np.quantile(np.abs(asked), np.linspace(0.3, 0.98, 35))
        after = {
            level: _share_left(columns, np.clip(asked, -level, level))
            for level in levels.tolist()
            if level > 0
        }
        limit = min(after, key=after.__getitem__, default=0.0)
        if before < SLIGHT or not after or after[limit] > SEVERE * before:
            continue
        share = float(np.mean(np.abs(asked) > limit))
        line = f"torque_limit_Nm = {limit:.3g}  # write that of your drive"
        yield SATURATION.finding(
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
    off = {j: pair for j, pair in factors.items() if not 1 / TWICE < pair[0] < TWICE}
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
        if factor > 0 and error < POOR * factor and _share_left(columns, y) < SEVERE:
            factors[j] = factor, error
    return factors


def _gain_finding(
    experiment: Experiment, shown: Mapping[int, tuple[float, float]], joints: Sequence[int]
) -> Finding:
    """Return the finding for the factors and standard errors `shown`, and all joints concerned."""
    names, is_known = experiment.robot.joint_names, bool(experiment.robot.known_bodies)
    each = [
        f"{names[j]} {factor:.3g}" if factor > 1 else f"{names[j]} 1/{1 / factor:.3g}"
        for j, (factor, _) in shown.items()
    ]
    error = float(np.median([error / factor for factor, error in shown.values()]))
    others = [names[j] for j in joints if j not in shown]
    more = f"; {listed(others, _MOST_JOINTS)} as the others" if others else ""
    bodies = "known bodies" if is_known else "bodies of the robot file"
    scale = "" if is_known else " with known bodies (known_bodies=)"
    return GAIN_SCALE.finding(
        f"the controllers give many times or a fraction of the torque that moves and holds the "
        f"{bodies} ({listed(each, _MOST_JOINTS)}, +- {error:.1%}{more}): their gains are in units "
        "of the drive (counts, 1/256, per degree) and not in N m, or those bodies are wrong",
        only_joint([names[j] for j in joints]),
        "wrong",
        {f"torque of {names[j]} over that of the bodies": x for j, (x, _) in shown.items()},
        f"gains in N m/rad, or their scale as a parameter{scale}, "
        + in_drives({(names[j], "controller"): "is_up_to_scale = true" for j in joints}),
        joints=tuple(names[j] for j in joints),
    )


Poses = dict[int, tuple[float, float]]
"""{joint: sign and offset [rad] of its position}."""

_GRID, _NEAREST = math.radians(30), math.radians(1)
"""First and last step of the search for the zero of a joint [rad]."""


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
    if not np.nanmax(experiment.nominal) > SUSPICIOUS:
        return
    # two signs of joints that both carry the load explain nothing alone
    pairs: list[Poses] = [{i: (-1.0, 0.0), j: (-1.0, 0.0)} for i, j in combinations(joints, 2)]
    best = min(pairs, key=partial(_pose_cost, experiment), default={})
    starts: list[Poses] = [{}]
    if best and _pose_cost(experiment, best) <= _pose_cost(experiment, {}):
        starts.append(best)
    searched = [_searched(experiment, joints, start) for start in starts]
    poses = min(searched, key=partial(_pose_cost, experiment))
    for j in sorted(poses):
        yield from _pose_finding(experiment, poses, j)


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
    left = experiment.lever * experiment.torque - experiment.regressor @ experiment.bodies
    for j in experiment.used:
        if drives[j].motor_inertia_kg_m2 is None:
            rotor = experiment.lever[j] * experiment.motor[2][:, j]
            columns = np.column_stack([experiment.friction[j], rotor])
            inertia[j] = max(float(scaled_svd(columns).solve(left[:, j])[-1]), 0.0)
    found = replace(experiment, inertia=inertia)
    vars(found)["regressor"] = experiment.regressor  # of the same motion: not computed again
    return found


def _pose_cost(experiment: Experiment, poses: Poses) -> float:
    """Return the cost of signs and zeros: that of the misfit, and a half of each change."""
    changes = sum(0.5 * (sign < 0) + 0.5 * (offset != 0) for sign, offset in poses.values())
    return _with_poses(experiment, poses).cost("nominal") + float(changes)


def _searched(experiment: Experiment, joints: Sequence[int], poses: Poses) -> Poses:
    """Return the signs and zeros that explain most, found joint by joint from a start."""
    cost, before = _pose_cost(experiment, poses), math.inf
    while before - cost >= TIE:  # each pass but the last lowers the cost by a tie or more
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
    least = max(lower - float(moved.min()) - BEYOND_RAD, -math.pi)
    most = min(upper - float(moved.max()) + BEYOND_RAD, math.pi)

    def at(offset: float) -> tuple[float, float]:
        return _pose_cost(experiment, others | {j: (sign, offset)}), offset

    grid = [float(x) for x in np.arange(-6, 7) * _GRID if least <= x <= most]
    best = min(map(at, grid), default=(math.inf, 0.0))
    if best[0] > most_cost + LEAST_GAIN:
        return []
    step = 0.5 * _GRID
    while step > 0.5 * _NEAREST:
        best, step = min([best, *(at(best[1] + x) for x in (-step, step))]), 0.5 * step
    cost, offset = min(best, at(math.radians(round(math.degrees(best[1])))))
    is_given = sign > 0 and abs(offset) < SURE * _NEAREST
    return [] if is_given else [(cost, others | {j: (sign, offset)})]


def _pose_finding(experiment: Experiment, poses: Poses, j: int) -> Iterator[Finding]:
    """Yield the finding of one joint, unless the others explain the torques without it."""
    sign, offset = poses[j]
    others = {i: pose for i, pose in poses.items() if i != j}
    gain = _pose_cost(experiment, others) - _pose_cost(experiment, poses)
    before, after = (_with_poses(experiment, each).nominal for each in (others, poses))
    falls = (before > SUSPICIOUS) & (after < FALLS * before)
    if gain < LEAST_GAIN or not np.any(falls):
        return
    names, joint = experiment.robot.joint_names, experiment.robot.joint_names[j]
    worst = int(np.argmax(np.where(falls, before / np.maximum(after, 1e-9), 0.0)))
    zero = f"its zero {math.degrees(offset):.0f} degrees from that of the robot file"
    parts = [*(["the opposite sign"] if sign < 0 else []), *([zero] if offset else [])]
    sources = {}
    for quantity in (*experiment.logged(j, "qm"), "position_command"):
        moved = offset * (float(experiment.ratio[j]) if quantity == "motor_position" else 1.0)
        source = experiment.source(j, quantity)
        sources[quantity] = changed_source(source, factor=sign, offset=round(moved, 4))
    same = "\n# the same sign for velocity_command and torque_command, if the log has them"
    yield (SIGN if sign < 0 else ENCODER_OFFSET).finding(
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
        in_description({joint: sources}) + (same if sign < 0 else ""),
    )
