"""What the channels of logs show before a fit: time, drives, encoders, limits and held torques.

Some of it is in the samples of the logs (`OF_LOGS`), some in the motion. Each finding has the one
change that repairs it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

import numpy as np

from seaid._arrays import Array, is_constant, runs
from seaid._files import toml_key
from seaid.checks import tolerances as tol
from seaid.checks.codes import CODES, in_description, in_drives
from seaid.checks.engine import Check, looks_for
from seaid.checks.experiment import Experiment
from seaid.drives import Drive, total_ratio
from seaid.errors import Finding, listed
from seaid.estimation.qr_factor import deleted_residual, scaled_svd
from seaid.log import Log, Processing
from seaid.log.channels import UNIT_FACTORS
from seaid.log.description import (
    LogChannel,
    Logged,
    as_toml,
    changed_source,
    changed_sources,
    channels_of,
)
from seaid.log.repair.channels import held_over, saturated, wrap_period
from seaid.log.usable_parts import REST
from seaid.regressor.base import INPUT_FIELDS
from seaid.robot import Robot


def _time_units(logged: Logged) -> Iterator[Finding]:
    """Yield logs whose time is not in seconds; of several units, that of the usual rate."""
    # The geometric mean: rates differ by factors.
    usual_hz = np.sqrt(tol.SLOWEST_HZ * tol.FASTEST_HZ)
    for log in logged.logs:
        rate = 1 / float(np.median(np.diff(log.time)))  # a gap is not the unit of the clock
        if tol.SLOWEST_HZ <= rate <= tol.FASTEST_HZ:
            continue
        clock, sizes = (log.description or {}).get("time", {}), UNIT_FACTORS["s"]
        described = {"column": clock} if isinstance(clock, str) else dict(clock)
        source = {"column": "time_s", "unit": "s"} | described
        # The time was read in the unit that the description states.
        rates = {unit: rate * sizes[source["unit"]] / size for unit, size in sizes.items()}
        rates = {unit: x for unit, x in rates.items() if tol.SLOWEST_HZ <= x <= tol.FASTEST_HZ}
        evidence, code = {"rate [Hz]": rate}, CODES["time-unit"]
        if not rates:
            yield code.finding("unknown", "", evidence)
            continue
        unit = min(rates, key=lambda unit: abs(float(np.log(rates[unit] / usual_hz))))
        remedy = f"in the description of the log:\ntime = {as_toml(source | {'unit': unit})}"
        evidence["with it [Hz]"] = rates[unit]
        yield code.finding("other", "", {**evidence, "unit": unit}, remedy)


def _positions(log: Log) -> Iterator[LogChannel]:
    """Yield the positions of a log that change."""
    return channels_of(log, log.joint_names, "motor_position", "joint_position")


def _torques(log: Log, used: Collection[str]) -> list[LogChannel]:
    """Return the torques that change, and have a column without a unit."""
    channels = channels_of(log, used, "motor_torque", "joint_torque")
    return [each for each in channels if each.source is not None and "unit" not in each.entry]


def _wraps(logged: Logged) -> Iterator[Finding]:
    """Yield the joints of each log with positions or torques that wrap around."""
    for name, log in logged.named:
        periods = {each: wrap_period(log.time, each.values) for each in _positions(log)}
        periods |= {each: _period_of_integer(each) for each in _torques(log, logged.used)}
        changes = {
            channel: {"offset": _offset_of_turn(logged.robot, channel, period), "wraps": period}
            for channel, period in periods.items()
            if period is not None and channel.source is not None
        }
        if lines := changed_sources(changes):
            evidence = {"period": next(iter(changes.values()))["wraps"]}
            words = {"joints": ", ".join(lines), "log": name}
            of_joints = "jumps", "", {**evidence, **words}, in_description(lines, name)
            yield CODES["wraps"].finding(*of_joints, joints=tuple(lines))


def _offset_of_turn(robot: Robot, channel: LogChannel, period: float) -> float:
    """Return what to add to a channel that is unwrapped from its first sample on."""
    if channel.quantity in ("motor_torque", "joint_torque"):
        # A first sample in the upper half of the range is a negative one without its sign.
        return -period * float(channel.values[0] > 0.5 * period)
    if channel.quantity != "joint_position" or abs(period / (2 * np.pi) - 1) >= tol.NEGLIGIBLE:
        return 0.0
    # the unwrapped angle begins within the turn of its first sample
    low, high = robot.position_range(channel.joint)
    middle = 0.5 * (low + high) if np.isfinite(high - low) else 0.0
    return period * float(np.rint((middle - np.mean(np.unwrap(channel.values))) / period))


def _period_of_integer(channel: LogChannel) -> float | None:
    """Return scale 2^b if a channel is a signed integer of b bits, read without its sign.

    It is at both ends of this range, and not in its middle half.
    """
    values = channel.values
    span, middle = float(np.ptp(values)), 0.5 * float(np.min(values) + np.max(values))
    if float(np.mean(np.abs(values - middle) < 0.25 * span)) > tol.FEW:
        return None
    periods = (channel.scale * 2.0**bits for bits in (16, 32))
    return next((period for period in periods if abs(span / period - 1) < tol.FEW), None)


def _is_whole(channel: LogChannel) -> bool:
    """Whether the samples of a torque in N m are whole numbers, but not those of an encoder."""
    has_levels = channel.scale == 1 and len(np.unique(channel.values)) >= tol.EVENTS
    return has_levels and not np.any(channel.values % 1) and _period_of_integer(channel) is None


def _whole_numbers(logged: Logged) -> Iterator[Finding]:
    """Yield the torques of each log in N m that are whole numbers, such as a percentage."""
    for name, log in logged.named:
        whole = filter(_is_whole, _torques(log, logged.used))
        ratings = {channel: _rating(logged.robot, channel) for channel in whole}
        largest = max((channel.largest for channel in ratings), default=0.0)
        unit, full = ("per cent", 100) if largest <= 100 else ("per mille", 1000)
        known = {x: rating for x, rating in ratings.items() if 0 < rating < np.inf}
        by = f"{unit} of the limits of the robot file" if known == ratings else "times the rating"
        lines = changed_sources({x: {"factor": known.get(x, 1.0) / full} for x in ratings})
        is_far = any(x.largest > tol.MANY_TIMES * rating for x, rating in ratings.items())
        if lines:
            remedy = f"{in_description(lines, name)}\n# {by}, see the data sheet; if it "
            remedy += "is the duty cycle of a servo, use its commands"
            words = {"joints": ", ".join(lines), "log": name, "unit": unit}
            of_joints = "whole", "", {"largest value": largest, **words}, remedy, is_far
            yield CODES["unit"].finding(*of_joints, joints=tuple(lines))


def _rating(robot: Robot, channel: LogChannel) -> float:
    """Return the limit of the robot file for a torque, at the motor for that of a motor."""
    lever = total_ratio(robot.drives[channel.joint]) if channel.quantity == "motor_torque" else 1.0
    return float(robot.effort_limits[robot.index(channel.joint)]) / abs(lever)


def _lost_samples(logged: Logged) -> Iterator[Finding]:
    """Yield logs whose time counts the samples, some of which were lost or are repeated.

    Over k lost samples all positions move k + 1 times as far as before and after. What a step
    differs from the mean of its neighbours by, in the median, is the noise of such a comparison; a
    clock that was resampled is none that counts.
    """
    for name, log in logged.named:
        channels, steps = [*_positions(log)], np.diff(log.time)
        held = {x: count for x in channels if (count := held_over(log.time, x.values)) > 1}
        is_resampled = any(repair.kind == "irregular steps" for repair in log.report)
        if held:
            most, lines = max(held.values()), changed_sources({channel: {} for channel in held})
            remedy = f"{in_description(lines, name)}\n# held samples are then interpolated"
            words = {"joints": listed(lines), "log": name}
            of_joints = "held", "", {"samples per new value": float(most), **words}, remedy
            yield CODES["holes"].finding(*of_joints, joints=tuple(lines))
        elif channels and np.ptp(steps) < tol.NEGLIGIBLE * np.median(steps) and not is_resampled:
            yield from _lost_of([channel.values for channel in channels], name)


def _lost_of(positions: Sequence[Array], name: str) -> Iterator[Finding]:
    """Yield that samples were lost in a log with equal steps of the time."""
    lost, many = _lost(positions), tol.SLIGHT * (len(positions[0]) - 1)
    jumps = 0 if len(lost) >= tol.EVENTS else _common_jumps(positions)
    if jumps or len(lost) >= tol.EVENTS:
        evidence = {"lost samples": float(np.sum(lost)), "steps": float(len(lost) or jumps)}
        of_log = "bursts" if jumps else "lost", "", {**evidence, "log": name}
        yield CODES["holes"].finding(*of_log, is_worse=bool(np.sum(lost) > many))


def _common_jumps(positions: Sequence[Array]) -> int:
    """Return in how many single steps most positions (T,) jump, as over a burst of lost samples.

    A step is far longer there than the longest ones elsewhere. The positions of one joint may jump
    by a fault of its encoder: two joints and more do not at once.
    """
    moved = np.abs(np.diff(positions, axis=1))
    usual = np.quantile(moved, 1 - tol.FEW, axis=1)
    jumps = moved[usual > 0] > tol.MANY_TIMES * usual[usual > 0, None]
    if len(jumps) <= 2:  # both encoders of a joint
        return 0
    return int(np.count_nonzero(np.mean(jumps, axis=0) > tol.MOST))


def _lost(positions: Sequence[Array]) -> Array:
    """Return the numbers of samples that were lost in single steps of all positions (T,)."""
    moved = np.diff(positions, axis=1)
    usual, change = 0.5 * (moved[:, :-2] + moved[:, 2:]), moved[:, 2:] - moved[:, :-2]
    apart = np.abs(moved[:, 1:-1] - usual)
    # An encoder of coarse counts has most steps of zero, of which the noise is not the median.
    noise = np.array([np.median(x[x > 0]) if np.any(x) else 1.0 for x in apart])[:, None]
    moved, usual, change = (x / noise for x in (moved[:, 1:-1], usual, change))
    size = np.linalg.norm(usual, axis=0)
    # The multiple of the usual step of all positions by least squares: k + 1 over k lost samples.
    times = np.round(np.sum(moved * usual, axis=0) / np.maximum(size**2, np.finfo(float).tiny))
    # (2, T - 3), norms over all positions: the steps before and after have to agree, and the one
    # between has to be a multiple of them.
    differing = np.linalg.norm([change, moved - times * usual], axis=1)
    # of a single encoder that sticks and lets go the others know nothing
    in_each = np.abs(moved - times * usual) < tol.MOST * np.abs(usual)
    is_same = np.all(in_each | (np.abs(usual) < tol.FAR), axis=0)
    is_same &= np.all(differing < tol.MOST * size, axis=0)
    return np.asarray((times - 1)[(times > 1) & (size > tol.FAR) & is_same])


def _missing_drives(logged: Logged) -> Iterator[Finding]:
    """Yield the joints with two different encoders and an ideal drive."""
    robot = logged.robot
    stiff = [x for x, drive in robot.drives.items() if not drive.is_elastic and drive.ratio == 1]
    for log in logged.logs:
        gears = {joint: gear for joint in stiff if (gear := _gear(log, joint))}
        if gears:
            tables: dict[tuple[str, ...], str] = {
                (joint,): _drive_table(robot.is_prismatic[robot.index(joint)], *gear)
                for joint, gear in gears.items()
            }
            first, (ratio, _) = next(iter(gears.items()))
            evidence = {"motor over joint motion": ratio, "joints": ", ".join(gears)}
            keys = 'option: --drives FILE, or drives = "FILE" at the top of seaid.toml, with\n'
            remedy = f"{keys}{in_drives(tables)}"
            yield CODES["missing-drives"].finding("missing", first, evidence, remedy)


def _drive_table(is_prismatic: bool, ratio: float, is_stiff: bool) -> str:
    """Return the lines of a drive with a gear."""
    key = "gear_ratio_rad_per_m" if is_prismatic and is_stiff else "gear_ratio"
    return f'type = "{"stiff" if is_stiff else "series_elastic"}"\n{key} = {ratio:.4g}'


def _gear(log: Log, joint: str) -> tuple[float, bool] | None:
    """Return the ratio between the encoders of a joint, and whether it is stiff; None without one.

    A deflection is in proportion to the torque. A torque that is measured behind the gear has
    neither friction nor rotor in it, so that no drive is missing.
    """
    j = log.joint_names.index(joint)
    channels = log.motor_position, log.joint_position, log.motor_torque
    motor, position, torque = (channel[:, j] for channel in channels)
    moved = float(np.std(position))
    if not np.all(np.isfinite([motor, position])) or not 0 < tol.TWICE * moved <= np.std(motor):
        return None
    columns = [position, np.ones(len(position))]
    if np.all(np.isfinite(torque)):
        columns.append(torque)
    elif log.joint_torque is not None and np.any(np.isfinite(log.joint_torque[:, j])):
        return None
    ratio, zero, *_ = scaled_svd(np.column_stack(columns)).solve(motor).tolist()
    apart = float(np.std(motor / ratio - position - zero / ratio)) / moved
    return abs(ratio), apart <= tol.NEGLIGIBLE


def _references(logged: Logged) -> Iterator[Finding]:
    """Yield reference positions outside the motion, where Coulomb friction is extrapolated."""
    for joint, drive in logged.robot.drives.items():
        if "coulomb_position" not in drive.friction or not logged.logs:
            continue
        positions = [log.joint_position[:, log.joint_names.index(joint)] for log in logged.logs]
        low, high = (float(end(np.concatenate(positions))) for end in (np.nanmin, np.nanmax))
        reference, unit = drive.reference_position_rad, drive.joint_units[1]
        if not low <= reference <= high:
            evidence = {"reference position": reference, "lowest": low, "highest": high}
            lines = in_drives({(joint,): f"reference_position_rad = {(low + high) / 2:.2g}"})
            of_joint = "outside", joint, {**evidence, "unit": unit}, lines
            yield CODES["reference-position"].finding(*of_joint)


def _saturated(logged: Logged) -> Iterator[Finding]:
    """Yield the channels that stay at their extremes: of each the log that does so longest."""
    longest: dict[tuple[str, str], tuple[float, str, float]] = {}
    for name, log in logged.named:
        for channel in channels_of(log, logged.used, *INPUT_FIELDS.values(), "joint_torque"):
            stuck, key = saturated(channel.values), (channel.quantity, channel.joint)
            share = float(np.mean(stuck))
            if share > longest.get(key, (tol.FEW,))[0]:
                longest[key] = share, name, float(np.max(np.abs(channel.values[stuck])))
    for (quantity, joint), (share, name, limit) in longest.items():
        case, words = "sensor" if quantity == "joint_torque" else "input", {"log": name}
        words["quantity"] = quantity.replace("_", " ")
        of_joint = case, joint, {"share at the limit": share, "limit": limit, **words}
        yield CODES["saturation"].finding(*of_joint, is_worse=quantity.endswith("torque"))


def _locked(logged: Logged) -> Iterator[Finding]:
    """Yield a note for each joint with a locked output."""
    for joint in locked_outputs(logged.robot, logged.logs):
        yield CODES["locked-output"].note("counts", joint)


def locked_outputs(robot: Robot, logs: Sequence[Log]) -> tuple[str, ...]:
    """Return the elastic joints whose output does not move in any log while their motor does.

    What holds it is outside, as on a test bench. The motor equation (7), and (4b) of a torque
    sensor, hold as always; the load side (8) has an unknown torque.
    """
    if not logs or not np.array_equal(robot.transmission, np.eye(robot.n)):
        return ()
    turning = (x for x in robot.elastic_joints if not robot.is_prismatic[robot.index(x)])
    drives = ((joint, robot.drives[joint]) for joint in turning)
    return tuple(x for x, drive in drives if all(_is_locked(drive, log, x) for log in logs))


def _is_locked(drive: Drive, log: Log, joint: str) -> bool:
    """Whether a motor moves by what may be a deflection while its joint stands.

    An encoder that does not change while the motor moves further is a dead channel.
    """
    j = log.joint_names.index(joint)
    motor, output = log.motor_position[:, j], log.joint_position[:, j]
    if not np.all(np.isfinite([motor, output])) or is_constant(motor):
        return False
    behind = motor / total_ratio(drive)
    least = tol.HARDLY * np.ptp(behind)
    return bool(np.ptp(behind) < tol.LARGEST_DEFLECTION_RAD and np.ptp(output) < least)


def _standing(logged: Logged) -> Iterator[Finding]:
    """Yield a robot that hardly moves, unless its outputs are locked."""
    sides = [side for log in logged.logs for side in log.joint_position.T]
    swings = [float(np.ptp(side)) for side in sides if np.all(np.isfinite(side))]
    if not swings or max(swings) >= tol.LEAST_SWING or locked_outputs(logged.robot, logged.logs):
        return
    yield CODES["standstill"].finding("robot", "", {"widest motion": max(swings)})


def without_torque(findings: Iterable[Finding]) -> set[str]:
    """Return the joints whose torques are in another unit, wrap around, or are those of a stop."""
    return {joint for x in findings if x.code in ("unit", "wraps", "contact") for joint in x.joints}


OF_LOGS = (
    Check(CODES["time-unit"], (), _time_units),
    Check(CODES["wraps"], (), _wraps),
    Check(CODES["unit"], (), _whole_numbers),
    Check(CODES["holes"], (), _lost_samples),
    Check(CODES["missing-drives"], (), _missing_drives),
    Check(CODES["reference-position"], (), _references),
    Check(CODES["saturation"], (), _saturated),
    Check(CODES["locked-output"], (), _locked),
    Check(CODES["standstill"], (), _standing),
)


def excluded_findings(processing: Iterable[Processing]) -> Iterator[Finding]:
    """Yield notes of the samples that were excluded: rest at the ends, frozen channels, holes."""
    for repair in (repair for each in processing for repair in each.excluded):
        code = CODES["standstill"] if repair.kind == REST else CODES["holes"]
        yield code.note("excluded", "", {"text": str(repair)})


def excluded_instants(place: str, share: float, has_contacts: bool) -> Iterator[Finding]:
    """Yield the note on a regression that lacks most of its instants, a `share` of them."""
    if share > tol.MOST:
        words = {"place": place, "contacts": ", or next to a change of contact" * has_contacts}
        yield CODES["standstill"].note("instants", "", {"part": 1 - share, **words})


def standstill_findings(
    drives: Mapping[str, Drive], positions: Mapping[str, float]
) -> Iterator[Finding]:
    """Yield the joints whose drives move in no log, with their `positions` if the joints stand."""
    for joint, drive in drives.items():
        evidence, case, remedy = dict[str, float](), "motor", None
        words = {"what": "friction, spring" if drive.is_elastic else "friction"}
        if np.isfinite(positions[joint]):
            at, case, evidence = f"{positions[joint]:.4g}", "joint", {"position": positions[joint]}
            words |= {"at": at, "unit": drive.joint_units[1]}
            remedy = f"move this joint, or lock it (--locked {joint}={at}), at the top of "
            remedy += f"seaid.toml:\nlocked = {{ {toml_key(joint)} = {at} }}"
        yield CODES["standstill"].finding(case, joint, {**evidence, **words}, remedy)


def offset_findings(experiment: Experiment) -> Iterator[Finding]:
    """Yield joints whose encoder offsets differ between logs by more than deflections and noise.

    The angle between the encoders is the deflection, in proportion to the torque of the spring
    (that of the motor but for friction), and an offset of each log. What is left is correlated over
    a log, and counts as the error of its mean.
    """
    logs = np.unique(experiment.log).tolist()
    for j in np.flatnonzero(experiment.both).tolist() if len(logs) > 1 else ():
        drive = experiment.robot.drives[experiment.robot.joint_names[j]]
        if drive.is_elastic and not experiment.robot.base_is_held:
            continue  # its load is unknown, and is another one hanging than standing
        y = experiment.apart[:, j]
        # One column per log, its offset; the first len(logs) parameters are these offsets.
        H = np.column_stack([np.equal.outer(experiment.log, logs), experiment.deflection(j)])
        x = scaled_svd(H).solve(y)
        size = float(np.std(H[:, len(logs) :] @ x[len(logs) :]))
        least = tol.POOR * size if drive.is_elastic else tol.LEAST_OFFSET
        beyond = least + tol.TWICE * float(np.std(y - H @ x))
        for number, change in enumerate((x[1 : len(logs)] - x[0]).tolist(), 2):
            if abs(change) > beyond:
                yield _offset(experiment, j, number, change, size)


def _offset(experiment: Experiment, j: int, number: int, change: float, size: float) -> Finding:
    """Return the finding for encoder offsets that changed between log 1 and another one."""
    joint, log = experiment.robot.joint_names[j], f"log {number}"
    quantity = "motor_position" if size else "joint_position"
    offset = -change * experiment.lever[j] if size else change
    source = changed_source(experiment.source(j, quantity, number - 1), offset=offset)
    evidence = {"difference at the joint": change}
    if size:
        evidence["times the deflection"] = abs(change) / size
    remedy = in_description({joint: {quantity: source}}, log)
    of_joint = "spring" if size else "stiff", joint, {**evidence, "log": log}, remedy
    return CODES["encoder-offsets-differ"].finding(*of_joint)


@looks_for(CODES["unit"])
def strength_findings(experiment: Experiment) -> Iterator[Finding]:
    """Yield torques that are far larger than any that the bodies need, most of which are known.

    They are compared with those of the heaviest joint, so that friction without load, as of an
    axis along gravity, is none.
    """
    robot, used = experiment.robot, experiment.used
    known = robot.payload_parameters + robot.is_known * robot.parameters
    if not experiment.has_bodies or not np.any(known) or robot.has_controllers:
        return
    torques = (experiment.regressor @ x for x in (experiment.bodies, known))
    sizes, of_known = (np.sqrt(np.mean(torque**2, axis=0)) for torque in torques)
    heaviest = max(used, key=lambda j: float(sizes[j]))
    # the unit of a motor with an unknown constant is none
    rms = np.sqrt(np.mean(experiment.target**2, axis=0)) * ~experiment.is_unscaled
    times = rms / sizes[heaviest]
    joints = tuple(robot.joint_names[j] for j in used if times[j] > tol.FAR)
    if joints and of_known[heaviest] > tol.MOST * sizes[heaviest]:
        evidence = {"torque over that of the bodies": float(np.nanmax(times[used]))}
        evidence["torque of the bodies"] = float(sizes[heaviest])
        of_joints = "strength", "", {**evidence, "joints": ", ".join(joints)}
        yield CODES["unit"].finding(*of_joints, joints=joints)


@looks_for(CODES["contact"])
def stop_findings(experiment: Experiment, logs: Sequence[Log]) -> Iterator[Finding]:
    """Yield joints whose motors push outwards where they are at their limits, as against a stop.

    The torque there is compared with what the rest of the motion predicts, in units of the error of
    such a prediction.
    """
    robot = experiment.robot
    for j in experiment.on_bodies if not robot.has_controllers else ():
        joint, (low, high) = robot.joint_names[j], robot.position_range(robot.joint_names[j])
        if not np.isfinite(high - low):
            continue
        (angle,) = robot.joint_states(experiment.joint[0])
        place, far = angle[:, j] - 0.5 * (low + high), (0.5 - tol.FEW) * (high - low)
        at_limit = np.abs(place) > far
        share = float(np.mean(at_limit))
        if not tol.FEW < share < tol.MOST:
            continue
        y = experiment.target[:, j] / np.std(experiment.target[:, j])
        # a spring that is parallel to the joint pushes everywhere, and a stop only there
        spring = experiment.joint[0][:, j]
        H = np.column_stack([experiment.regressor[:, j], experiment.loads[j], spring])
        residual, noise = deleted_residual(H, y, at_limit, tol.CORRELATED_ROWS)
        push = float(np.median(residual[at_limit] * np.sign(place[at_limit]))) / max(noise, tol.FEW)
        if push > tol.SIGNIFICANT:
            evidence = {"share at the limit": share, "push over its error": push}
            excluded = [
                f"in the description of {name}:\n"
                f"exclude_s = {_times_beyond(log, robot, joint, far)}"
                for name, log in Logged(robot, logs, ()).named
            ]
            of_joint = "pushes", joint, evidence, "\n".join(excluded)
            yield CODES["contact"].finding(*of_joint, joints=(joint,))


def _times_beyond(log: Log, robot: Robot, joint: str, far: float) -> list[list[float]]:
    """Return the times [s] around those at which a joint is far from the middle of its range."""
    j, step = log.joint_names.index(joint), float(np.median(np.diff(log.time)))
    motor, place = log.motor_position[:, j], log.joint_position[:, j]
    place = np.where(np.isnan(place), motor / total_ratio(robot.drives[joint]), place)
    is_beyond = np.abs(place - np.mean(robot.position_range(joint))) > far
    near = np.convolve(is_beyond, np.ones(2 * round(tol.WINDOW_S / step) + 1), mode="same") > 0.5
    return [[round(float(log.time[k]), 3) for k in (a, b - 1)] for a, b in runs(near)]


@looks_for(CODES["unit"])
def limit_findings(experiment: Experiment) -> Iterator[Finding]:
    """Yield joints that move or pull many times beyond the limits of the robot file."""
    robot = experiment.robot
    ends = np.array([robot.lower_limits, robot.upper_limits])
    # NaN in place of a range without an end: its comparison below is False.
    ends[:, ~np.all(np.isfinite(ends), axis=0)] = np.nan
    angles, half = experiment.joint[0] - np.mean(ends, axis=0), 0.5 * np.ptp(ends, axis=0)
    torque = np.where(experiment.is_unscaled, np.nan, experiment.target)
    values_of = {"position": angles, "speed": experiment.joint[1], "torque": torque}
    limits_of = half, robot.velocity_limits, robot.effort_limits
    for (name, values), limits in zip(values_of.items(), limits_of, strict=True):
        for j, joint in enumerate(robot.joint_names):
            largest, limit = float(np.max(np.abs(values[:, j]))), float(limits[j])
            if 0 < tol.MANY_TIMES * limit < largest:
                times, words = largest / limit, {"name": name, "times": f"{largest / limit:.3g}"}
                evidence = {f"{name} over its limit": times, **words}
                yield CODES["unit"].finding("limits", joint, evidence)
