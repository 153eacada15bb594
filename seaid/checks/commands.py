"""Checks of commands, and of torques that are none: without sign, or repeats of tracking errors.

A controller takes the place of a torque sensor: what its commands, gains and limits contradict is
seen in a log alone. Before a fit `setup` asks for `command_findings` and `no_measurements` of a
log, for `torque_limits` and `gain_scales` of an experiment, which compete with the zeros of
`bodies.poses`. Of a fit there are `delay_estimate_findings`. A torque that is friction alone is
seen by the bodies.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, combinations

import numpy as np

from seaid._arrays import Array, is_constant
from seaid.checks import codes
from seaid.checks import tolerances as tol
from seaid.checks.codes import CODES
from seaid.checks.engine import looks_for
from seaid.checks.experiment import Experiment, Transform
from seaid.drives import Controller, Drive, ParameterName
from seaid.drives.controller import DELAY_PARAMETER, NORMAL_95
from seaid.drives.drives import stated_delay_s
from seaid.errors import Finding, listed
from seaid.estimation import Estimate
from seaid.estimation.parameters import buses_of, is_stated
from seaid.estimation.qr_factor import residual_of
from seaid.log import Log
from seaid.log.commands import Commanded, commanded_joints, controlled_position
from seaid.log.describe.inference import correlation
from seaid.log.description import LogChannel, changed_source, channels_of
from seaid.log.repair.channels import encoder_noise
from seaid.robot import Robot


def command_findings(robot: Robot, log: Log) -> Iterator[Finding]:
    """Yield what is wrong or worth knowing with the position commands of a log.

    A command with another sign or unit than its position makes the other checks meaningless.
    """
    if log.position_command is None or not robot.has_controllers:
        return
    every = [*commanded_joints(robot, log)]
    exchanged = [x for pair in combinations(every, 2) for x in _exchanged_commands(*pair)]
    yield from exchanged
    for commanded in every if not exchanged else ():
        wrong = list(_not_following(commanded))
        yield from wrong or chain.from_iterable(look(commanded) for look in _OF_COMMANDS)


def _exchanged_commands(first: Commanded, second: Commanded) -> Iterator[Finding]:
    """Yield two joints of which each follows the command of the other one and not its own."""
    pairs = [(first, second), (second, first), (first, first), (second, second)]
    crossed, other, *own = (correlation(x.command, y.position) for x, y in pairs)
    if min(crossed, other) <= 1 - tol.POOR or max(own) >= tol.MOST:
        return
    name, sources = "position_command", first.log.sources()
    lines = {x.joint: {name: changed_source(sources[y.joint][name])} for x, y in pairs[:2]}
    evidence = {"correlation": min(crossed, other), "correlation as given": max(own)}
    words = {"other": second.joint, "each": f"{crossed:.3f} and {other:.3f}"}
    of_pair = "commands", first.joint, {**evidence, **words}, codes.in_description(lines)
    yield CODES["swapped-joints"].finding(*of_pair)


def _not_following(commanded: Commanded) -> Iterator[Finding]:
    """Yield a command or a position with the sign or unit of the other: a loop follows with r = 1.

    Lag and resonance change a range by less than a factor of exp(1/2).
    """
    command, position, joint = commanded.command, commanded.position, commanded.joint
    r = correlation(command, position)
    times = float(np.std(command) / np.std(position))
    if abs(r) < tol.MOST or (r > 0 and abs(math.log(times)) < math.log(tol.FAR)):
        return
    name, factor, words = "position_command", -1.0, dict[str, str]()
    if r > 0:
        name = _in_another_unit(commanded, times > 1)
        times, like = (times, "position") if name == "position_command" else (1 / times, "command")
        is_degrees = abs(math.log(times * math.pi / 180)) < tol.MOST
        factor = float(f"{math.pi / 180 if is_degrees else 1 / times:.4g}")
        words = {"like": like, "unit": "degrees" if is_degrees else "another unit"}
    source = changed_source(commanded.log.sources()[joint][name], factor=factor)
    words["name"] = name.replace("_", " ")
    evidence = {"correlation": r, "ratio of the ranges": times}
    remedy = codes.in_description({joint: {name: source}})
    code = CODES["unit" if r > 0 else "sign"]
    yield code.finding("command", joint, {**evidence, **words}, remedy)


def _in_another_unit(commanded: Commanded, is_command_larger: bool) -> str:
    """Return which of a command and its position has another unit than the robot file.

    It is the larger one if it is far beyond the limits of the joint or there are none, else the
    smaller one. A command whose unit the description states has that unit.
    """
    joint, log = commanded.joint, commanded.log
    position = next(x for x in ("motor_position", "joint_position") if x in log.logged(joint))
    described = [log.sources()[joint][name] for name in ("position_command", position)]
    stated = [isinstance(source, Mapping) and "unit" in source for source in described]
    larger = commanded.command if is_command_larger else commanded.position
    farthest = max(map(abs, commanded.robot.position_range(joint)))
    is_wrong = math.isinf(farthest) or np.max(np.abs(larger)) > tol.TWICE * farthest
    is_position = stated == [True, False] or is_wrong != is_command_larger
    return position if is_position else "position_command"


def _repeats(commanded: Commanded) -> Iterator[Finding]:
    """Yield commands of which some are logged twice; held ones, all alike, are no finding."""
    from scipy.ndimage import uniform_filter1d

    time, command = commanded.log.time, commanded.command
    period_s, changes = float(time[-1] - time[0]) / (len(time) - 1), np.diff(command)
    at = np.flatnonzero(changes)
    # Samples from one change of the command to the next: 1 where each sample has a new one.
    runs = np.diff(at)
    # Commands in ticks repeat where they are slow: only fast ones show that a message is late.
    speed = np.abs(uniform_filter1d(changes, max(1, round(tol.WINDOW_S / period_s))))
    is_fast = speed[at[1:]] > tol.MOST * np.max(speed)
    runs = runs[(runs * period_s < tol.WINDOW_S) & is_fast]  # longer ones are rests
    # A median above one: each command is held over several samples, and none is repeated.
    if len(runs) < tol.POOR * len(command) or np.median(runs) > 1:
        return
    evidence = {"share of repeated commands": float(np.sum(runs - 1) / np.sum(runs))}
    if evidence["share of repeated commands"] >= tol.FEW:
        evidence["longest delay [s]"] = period_s * float(np.percentile(runs - 1, 99))
        yield CODES["delay"].finding("repeats", commanded.joint, evidence)


def _at_stop(commanded: Commanded) -> Iterator[Finding]:
    """Yield a joint that is commanded beyond its limits and does not follow there."""
    robot, joint, unit = commanded.robot, commanded.joint, commanded.units[1]
    lower, upper = robot.position_range(joint)
    angles = commanded.command, commanded.position
    command_beyond, position_beyond = (np.abs(x - np.clip(x, lower, upper)) for x in angles)
    share, farthest = float(np.mean(command_beyond > 0)), float(np.max(command_beyond))
    if share < tol.FEW or np.sum(position_beyond) > tol.MOST * np.sum(command_beyond):
        return
    others = codes.excluding_torque([name for name in robot.joint_names if name != joint])
    words = {"range": f"{lower:.4g} to {upper:.4g} {unit}", "unit": unit, "others": others}
    evidence = {"share beyond the limits": share, "farthest beyond": farthest, **words}
    yield CODES["contact"].finding("stop", joint, evidence, is_worse=share > tol.MOST)


def _limited(commanded: Commanded) -> Iterator[Finding]:
    """Yield a controller that is at its limit, or asks more than the limit of the robot file."""
    robot, joint, limit = commanded.robot, commanded.joint, commanded.law.torque_limit_Nm
    has_limit = bool(np.isfinite(limit))
    if not has_limit and robot.drives[joint].is_up_to_scale:
        return  # its gains are in other units than the limit
    limit = limit if has_limit else float(robot.effort_limits[robot.index(joint)])
    asked, saturation = np.abs(commanded.asked), CODES["saturation"]
    share = float(np.mean(asked > limit)) if limit > 0 else 0.0
    if share < tol.FEW:
        return
    times, evidence = float(np.median(asked)) / limit, {"share at the limit": share}
    words = {"limit": f"{limit:.4g} {commanded.units[0]}"}
    # bodies of the robot file show another unit better than its limits
    if times > tol.MANY_TIMES and (has_limit or not np.any(robot.parameters)):
        evidence["median torque over its limit"] = times
        of_joint = "limit", joint, {**evidence, **words}, _declared_scale(robot, [joint])
        yield CODES["gain-scale"].finding(*of_joint)
    elif has_limit:
        yield saturation.note("limited", joint, {**evidence, **words})
    else:
        words["most"] = f"{float(np.max(asked)):.3g} {commanded.units[0]}"
        lines = codes.in_drives({(joint, "controller"): f"torque_limit_Nm = {limit:.4g}"})
        yield saturation.finding("effort", joint, {**evidence, **words}, lines)


def _declared_scale(robot: Robot, joints: Sequence[str]) -> str:
    """Return the remedy of gains in units of the drive."""
    bodies = "" if robot.known_bodies else " with known bodies (known_bodies=)"
    lines: dict[tuple[str, ...], str] = {(x, "controller"): "is_up_to_scale = true" for x in joints}
    return codes.in_drives(lines, f"gains in N m/rad, or their scale as a parameter{bodies}, ")


def _ignored(commanded: Commanded) -> Iterator[Finding]:
    """Yield velocity commands for which a controller of velocities has no gain."""
    rates, law, joint = commanded.log.velocity_command, commanded.law, commanded.joint
    gain = law.velocity_gain_Nms_per_rad
    if rates is None or not gain or law.command_velocity_gain_Nms_per_rad:
        return
    largest = float(np.max(np.abs(rates[:, commanded.log.joint_names.index(joint)])))
    if largest > 0:  # False for a joint without them, too, whose samples are NaN
        line = f"command_velocity_gain_Nms_per_rad = {gain:g}"
        remedy = codes.in_drives({(joint, "controller"): line}, only="if the drive gets them")
        evidence = {"largest velocity command": largest, "unit": commanded.units[1]}
        yield CODES["unused-command"].finding("velocity", joint, evidence, remedy)


def _too_close(commanded: Commanded) -> Iterator[Finding]:
    """Yield a joint whose tracking error is mostly the noise of its encoder."""
    size = float(np.std(commanded.command - commanded.position))
    noise = encoder_noise(commanded.position)
    if size <= tol.SURE * noise and not is_constant(commanded.position):
        evidence = {"tracking error over noise": size / noise if noise else 0.0, "noise": noise}
        words = {"unit": commanded.units[1], "times": f"{size / noise if noise else 1.0:.2g}"}
        evidence["tracking error"] = size
        yield CODES["unidentifiable"].finding("noise", commanded.joint, {**evidence, **words})


_OF_COMMANDS = (_repeats, _at_stop, _limited, _ignored, _too_close)


def no_measurements(robot: Robot, log: Log) -> Iterator[Finding]:
    """Yield the torques and currents that are magnitudes, or computed from the tracking error.

    The current loop of a real drive leaves more noise, friction of the sensor and delay.
    """
    quantities = "motor_torque", "joint_torque", "motor_current"
    computed = [x for quantity in quantities for x in _computed(robot, log, quantity)]
    others = [name for name in log.joint_names if name not in {x.joint for x, *_ in computed}]
    for channel, error, is_size in computed:
        yield _no_measurement(channel, robot.drives[channel.joint], error, is_size, others)


def _computed(robot: Robot, log: Log, quantity: str) -> Iterator[tuple[LogChannel, Array, bool]]:
    """Yield the torques that measure none, with the tracking error (T,), and if it is a size."""
    channels = list(channels_of(log, log.joint_names, quantity))
    returns = _returns([channel.values for channel in channels])
    for channel, count in zip(channels, returns, strict=True):
        drive = robot.drives.get(channel.joint)
        if drive is not None and drive.controller is None:
            error = _tracking_error(log, channel.joint, drive.ratio)
            is_magnitude = count >= tol.EVENTS or _is_folded(error, channel.values)
            if is_magnitude or abs(correlation(error, channel.values)) >= 1 - tol.FEW:
                yield channel, error, is_magnitude


def _to_be_measured(kept: Iterable[str]) -> str:
    """Return the remedy of torques that are none, next to joints whose torques are `kept`."""
    return f"log the measured current or torque{codes.excluding_torque([*kept])}"


def _tracking_error(log: Log, joint: str, ratio: float) -> Array:
    """Return the position commands of a joint less its positions (T,), NaN without either."""
    j = log.joint_names.index(joint)
    commands = np.nan if log.position_command is None else log.position_command[:, j]
    return np.asarray(commands - controlled_position(log, j, ratio))


def _no_measurement(
    channel: LogChannel, drive: Drive, error: Array, is_magnitude: bool, others: Sequence[str]
) -> Finding:
    """Return the finding of a torque or current that is a magnitude, or computed from the error."""
    evidence = {"correlation with the tracking error": abs(correlation(error, channel.values))}
    known = "20.0  # write the gain of your controller"
    if not is_magnitude:
        # N tau_M = K e at the joint
        times = float(np.std(channel.values) / np.std(error))
        # K_p acts at the joint, N K_t i = N tau_M = K_p e: a current needs K_t for it
        to_joint = {
            "joint_torque": 1.0,
            "motor_torque": drive.ratio,
            "motor_current": drive.ratio * drive.values.get("torque_constant", math.nan),
        }[channel.quantity]
        known = f"{to_joint * times:.4g}" if math.isfinite(to_joint) else known
        evidence["times the tracking error"] = times
    table = f'type = "stiff"\ngear_ratio = {drive.ratio:.6g}\nmotor_input = "position_command"'
    law = f"position_gain_Nm_per_rad = {known}"
    remedy: str = codes.in_drives({(channel.joint,): table, (channel.joint, "controller"): law})
    if drive.is_elastic or np.isnan(error[0]):  # a joint with a controller is stiff, and commanded
        remedy = _to_be_measured(others)
    case, words = "magnitude" if is_magnitude else "tracking", {"quantity": channel.words}
    return CODES["no-measurement"].finding(case, channel.joint, {**evidence, **words}, remedy)


def magnitudes(experiment: Experiment) -> Iterator[Finding]:
    """Yield torques without a sign, which rise with those of the nominal bodies of both signs."""
    names, torque = experiment.robot.joint_names, experiment.lever * experiment.torque
    # (4b) into (7): the torque of the bodies and on the rotor, where it is that of a motor
    of_file = experiment.of_file + np.nan_to_num(torque - experiment.target)
    torque = np.where(np.isnan(torque), experiment.sensed, torque)
    folded = [j for j in experiment.on_bodies if _is_folded(of_file[:, j], torque[:, j])]
    remedy = _to_be_measured(x for i, x in enumerate(names) if i not in folded)
    for j in folded:
        yield CODES["no-measurement"].finding("folded", names[j], remedy=remedy)


def of_friction_alone(experiment: Experiment) -> Iterator[Finding]:
    """Yield torques that lack those of the nominal bodies, which other joints show.

    Their factor is far below one, of chance or of a friction that is no sign of the speed, and
    friction explains the torque.
    """
    # a payload that is named and not there has no torque, of a joint that measures well
    scales = experiment.with_changes(bodies=experiment.robot.parameters).scales
    names = experiment.robot.joint_names
    shown = [names[j] for j, x in scales.items() if x.factor > max(tol.POOR, tol.SURE * x.error)]
    for j, scale in scales.items() if 2 * len(shown) > len(scales) else ():
        most, most_of_all = (x.factor + tol.SURE * x.error for x in (scale, experiment.scales[j]))
        is_chance = abs(scale.factor) < tol.SIGNIFICANT * scale.error
        if is_chance and most < 1 and most_of_all < tol.SEVERE and _is_friction(experiment, j):
            factor = {"torque over that of the bodies": scale.factor, "standard error": scale.error}
            of_joint = "friction", names[j], factor, _to_be_measured(shown)
            yield CODES["no-measurement"].finding(*of_joint)


def _is_friction(experiment: Experiment, j: int) -> bool:
    """Whether friction explains the torque of the motor of joint j."""
    torque, friction = experiment.lever[j] * experiment.torque[:, j], experiment.friction[j]
    rest = float(np.std(residual_of(np.nan_to_num(torque), friction)))
    return rest < tol.SEVERE * float(np.std(torque))


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
    return all(
        np.mean(part) >= tol.SLIGHT and side * correlation(error[part], torque[part]) >= tol.MOST
        for side, part in ((1, error > 0), (-1, error < 0))
    )


_OTHER_GAINS = "add a log with other gains to identify_conditions, or a known delay "

_KNOWN_DELAY = 'command_delay_s = 0.004  # write yours\nknown = ["command_delay"]'


@looks_for(CODES["command-delay"])
def delay_estimate_findings(robot: Robot, stated: Robot, load_side: Estimate) -> Iterator[Finding]:
    """Yield, after a fit, sums that the log determines in place of delays, and unusual delays.

    The robot has the delays at which the fit is linear, `stated` those that were given.
    """
    sums, stated_at, evidence, stated_s = list[str](), list[tuple[str]](), dict[str, float](), 0.0
    for bus in buses_of(robot.drives, load_side.names):
        joints, place = [load_side.names[x].owner for x in bus.places], bus.places[0]
        delay, std = float(load_side.values[place]), float(load_side.standard_errors[place])
        drive, error = stated.drives[joints[0]], tol.SIGNIFICANT * std
        given_s, range_s = drive.command_delay_s or 0.0, stated_delay_s(drive)
        is_other = "command_delay_s" in drive.std and abs(delay - given_s) > range_s + error
        text = f"command_delay_s states {1e3 * given_s:.4g} +- {1e3 * range_s:.2g} ms" * is_other
        if is_other or (abs(delay) > error and not -tol.LEAST_DELAY_S < delay < tol.LATE_S):
            yield _unusual_delay(delay, joints, text)
        for joint in joints if is_stated(std, bus.std_s) else ():
            if ParameterName("motor_inertia", joint) in load_side.names:
                scale = robot.drives[joint].ratio ** 2
                slope, value, error = (scale * x for x in _sum_with_delay(load_side, joint))
                sums.append(f"{joint} {value:.3g} +- {NORMAL_95 * error:.2g}")
                stated_at.append((joint,))
                evidence[f"armature and {slope:.3g} delay of {joint}"] = value
                stated_s = max(stated_s, std)
    if sums:
        evidence["delay within [s]"] = NORMAL_95 * stated_s
        lines = codes.in_drives(dict.fromkeys(stated_at, _KNOWN_DELAY), _OTHER_GAINS)
        of_sums = "sums", "", {**evidence, "sums": listed(sums)}, lines
        yield CODES["command-delay"].finding(*of_sums)


def _sum_with_delay(load_side: Estimate, joint: str) -> tuple[float, float, float]:
    """Return the best determined sum of rotor inertia I and s T, with T the delay of commands.

    That is s = K_d + F_v at the motor, the value of the sum, and its standard error.
    """
    names = (ParameterName(name, joint) for name in ("motor_inertia", DELAY_PARAMETER))
    places = [load_side.names.index(name) for name in names]
    (variance, shared), (_, of_delay) = load_side.covariance[np.ix_(places, places)]
    inertia, delay = load_side.values[places]
    # I + s T has the least variance at s = -cov(I, T) / var(T), that of I less s^2 var(T).
    slope = -shared / of_delay  # over N^2, as the rest
    return slope, inertia + slope * delay, math.sqrt(max(variance - slope**2 * of_delay, 0.0))


def _unusual_delay(delay: float, joints: Sequence[str], stated: str = "") -> Finding:
    """Return the finding on commands that act before their time, later than on any bus, or stated.

    `stated` is what the log contradicts.
    """
    when, cause = "before", "they are logged late, or K_d is on the error (command_velocity_gain)"
    if delay > 0:
        when, cause = "after", "no bus is so slow: clocks differ, or the drive filters its commands"
    words = {"joints": listed(joints), "when": when, "cause": stated or cause}
    lines = codes.in_drives({(joint,): f"command_delay_s = {delay:.4g}" for joint in joints})
    evidence, remedy = {"delay [s]": delay, **words}, lines if stated else None
    of_commands = "commands", codes.only_joint(joints), evidence, remedy
    return CODES["delay"].finding(*of_commands, is_worse=delay > 0 or bool(stated))


def _controllers(experiment: Experiment) -> dict[int, Controller]:
    """Return the controllers that give the torques of joints, with gains in N m."""
    laws = [drive.controller for drive in experiment.robot.drives.values()]
    return {j: law for j in experiment.used if (law := laws[j])}


def torque_limits(experiment: Experiment) -> Iterator[Transform]:
    """Yield limits of the torques that controllers without a limit ask for.

    The motion is that of the torque that is cut: of all levels the bodies of the robot file, next
    to friction and rotor inertia, leave least of it at the right one.
    """
    for j, law in _controllers(experiment).items():
        if np.isfinite(law.torque_limit_Nm) or experiment.scale(j).unexplained < tol.SLIGHT:
            continue
        asked = experiment.lever[j] * np.abs(experiment.torque[:, j])
        # the torque of a joint that is used changes, and so some of it is not zero
        levels = np.quantile(asked[asked > 0], np.linspace(0.3, 0.98, 35)).tolist()
        changed = {x: _with_limit(experiment, j, x) for x in levels}
        limit = min(changed, key=lambda x: changed[x].scale(j).unexplained)
        joint, evidence = experiment.robot.joint_names[j], {"torque limit": limit}
        evidence |= {"largest torque": float(np.max(asked)), "share": float(np.mean(asked > limit))}
        line = f"torque_limit_Nm = {limit:.3g}  # write that of your drive"
        of_joint = "motion", joint, evidence, codes.in_drives({(joint, "controller"): line})
        finding = CODES["saturation"].finding(*of_joint, joints=(joint,))
        yield Transform(finding, changed[limit], penalty=1.0)


def _with_limit(experiment: Experiment, j: int, limit: float) -> Experiment:
    """Return the experiment with the torque of joint j cut at a limit, at the joint."""
    most = np.where(np.arange(experiment.robot.n) == j, limit / experiment.lever, np.inf)
    is_cut, torque = np.abs(experiment.torque) > most, np.clip(experiment.torque, -most, most)
    rate = np.where(is_cut, 0.0, experiment.torque_rate)
    return experiment.with_changes(effort=torque, effort_rate=rate)


def gain_scales(experiment: Experiment) -> Iterator[Transform]:
    """Yield gains in another unit than N m, which give many times the torque, or a fraction of it.

    The bodies of the robot file show the factor at some joints. Where it is off at all of these,
    all commanded joints count as off, those that show none by the median factor.
    """
    joints, scales = [*_controllers(experiment)], experiment.clear_scales
    shown = {j: scales[j].factor for j in joints if j in scales}
    off = {j: factor for j, factor in shown.items() if not 1 / tol.TWICE < factor < tol.TWICE}
    if off:
        others = [j for j in joints if j not in off] if len(off) == len(shown) else []
        yield _in_other_units(experiment, off, others)


def _in_other_units(
    experiment: Experiment, off: Mapping[int, float], others: Sequence[int]
) -> Transform:
    """Return the transform of gains with factors that are `off`, of `others` by their median."""
    robot, names = experiment.robot, experiment.robot.joint_names
    errors = [experiment.scales[j].error / factor for j, factor in off.items()]
    factors = {**dict.fromkeys(others, float(np.median([*off.values()]))), **off}
    texts = [f"{names[j]} {'1/' * (x < 1)}{max(x, 1 / x):.3g}" for j, x in off.items()]
    words = {"bodies": "known bodies" if robot.known_bodies else "bodies of the robot file"}
    words |= {"factors": listed(texts), "error": f"{float(np.median(errors)):.1%}"}
    words["alike"] = f"; {listed([names[j] for j in others])} as the others" if others else ""
    evidence = {f"torque of {names[j]} over that of the bodies": x for j, x in off.items()}
    joints = tuple(names[j] for j in sorted(factors))
    of_joints = "bodies", "", {**evidence, **words}, _declared_scale(robot, joints)
    finding = CODES["gain-scale"].finding(*of_joints, joints=joints)
    right = experiment.scaled({j: 1 / factor for j, factor in factors.items()}, "t")
    return Transform(finding, right, penalty=float(len(off)))
