"""`check`: the set-up of an experiment before any fit, from the logs and what was given.

Time, motion and channels are looked at one by one, then the torques by `seaid.checks.setup`. Every
mistake is a `Finding` with its evidence and the one change that repairs it; what no fit can
use, a robot at rest or a dead channel, is an error.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from seaid._arrays import Array, FrozenMapping, is_constant, resolution, white_noise
from seaid._files import toml_key, toml_table
from seaid._progress import Result, counted
from seaid.checks import (
    LEAST_DELAY_S,
    Experiment,
    command_findings,
    encoder_slope,
    experiment_of,
    gain_findings,
    hidden_limits,
    is_wrong,
    mistakes,
    model_findings,
    model_sides,
    no_measurements,
    pose_findings,
    resolved_widths,
    selections,
    separation_findings,
    stands_locked,
)
from seaid.drives import IDEAL_DRIVE, Drive
from seaid.errors import (
    ExcitationError,
    Finding,
    IdentificationError,
    LogError,
    SeaidError,
    by_severity,
    checked,
    listed,
)
from seaid.estimation import estimator_named, scaled_svd
from seaid.identification.datasets import Dataset, Source, datasets_by_log, first_motion, sources_of
from seaid.identification.motor_side import with_regressed_angles, without_joint_encoder
from seaid.identification.nonlinear_terms import linearised_robot
from seaid.identification.two_step import estimate_two_step, joints_with_torque
from seaid.log import Log, Motion, changed_source, held_over, row_samples
from seaid.regressor import (
    INPUT_FIELDS,
    actuator_rows,
    is_linear,
    load_model_of,
    motor_regressor,
    usable_rows,
)
from seaid.robot import Robot

_SLOWEST_HZ, _FASTEST_HZ = 8.0, 2e5
"""Sampling rates of dynamic logs lie between; outside the unit of the time is another one."""

_UNITS_OF_TIME = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}

_LEAST_SWING = 0.03
"""Motion [rad or m] of every joint below which the robot hardly moves."""

_AT_LIMIT, _RUN, _LEVELS = 0.01, 5, 50
"""Share of a torque's samples at its extreme, in runs of at least so many, from which it saturates;
channels of fewer levels are too coarse to say."""

_APART = 0.1
"""Difference of the encoder offsets of two logs, over the deflection (rms), that matters."""


@dataclass(frozen=True)
class JointCheck:
    """What the logs say of one joint, NaN where they cannot.

    Attributes
    ----------
    swing : float
        Range of the position [rad or m].
    encoder_slope : float
        Motor angle per joint angle over the gear ratio: 1 for a right set-up.
    nominal, bodies, motor : float
        Share (rms) of the torque that is left by the bodies of the robot file, by any bodies, and
        by the motor equation (7) of a spring joint, where the motor moves: its friction at
        standstill is anything up to that of Coulomb.
    gear_ratio, gear_ratio_error : float
        Gear ratio between both encoders, without the deflection of a spring, and standard error.
    delay_s, delay_error_s : float
        Delay of the motor torque against the motion and its standard error.
    """

    swing: float
    encoder_slope: float
    nominal: float
    bodies: float
    motor: float
    gear_ratio: float = float("nan")
    gear_ratio_error: float = float("nan")
    delay_s: float = float("nan")
    delay_error_s: float = float("nan")


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
    in_memory = [one for one in sources if isinstance(one, Log)]
    unseen = without_joint_encoder(robot, in_memory) if in_memory else ()
    if unseen and len(in_memory) == len(sources):
        sources = list(with_regressed_angles(robot, in_memory, unseen, cutoff_hz))
    first = log_findings(robot, in_memory)
    if any(one.code == "time-unit" for one in first):
        return SetupCheck(tuple(first), FrozenMapping({}, "joint"))
    groups = datasets_by_log(robot, sources, cutoff_hz, None, False)
    motions = [[first_motion(one) for one in group] for group in groups]
    given = experiment_of(robot, motions)
    found = with_setup_findings(given, first)
    every = [one for own in motions for one in own]
    found += separation_findings(robot, every)
    if not is_wrong(found):
        found += _of_quick_fit(robot, in_memory, every, found)
    return SetupCheck(by_severity(found), joint_checks(given, every))


def _of_quick_fit(
    robot: Robot, logs: Sequence[Log], motions: Sequence[Motion], known: Sequence[Finding]
) -> list[Finding]:
    """Return what the equations lack that matters, by weighted least squares; [] without a fit."""
    with suppress(SeaidError):
        used = joints_with_torque(robot, motions)
        datasets: list[Dataset] = [*motions]
        if not is_linear(robot, used):
            robot, datasets = linearised_robot(robot, datasets, used)
        model = load_model_of(robot, list(map(first_motion, datasets)), used)
        solver = estimator_named("wls")
        found = estimate_two_step(robot, datasets, model, solver, 0.0, None, False)
        in_memory = [one for one in datasets if isinstance(one, Motion)]
        widths = resolved_widths(robot, logs, motions)
        sides = model_sides(robot, in_memory, (found.actuators, found.fit), widths)
        findings = model_findings(selections(sides), known)
        return [finding for finding in findings if finding.severity != "note"]
    return []


def joint_checks(given: Experiment, motions: Sequence[Motion]) -> Mapping[str, JointCheck]:
    """Return what the motions of an experiment say of each joint."""
    swings = np.max([np.ptp(one.joint_position, axis=0) for one in motions], axis=0)
    nothing, moving = (float("nan"), float("nan")), given.in_motion
    found = {
        joint: JointCheck(
            float(swings[j]),
            encoder_slope(given, j) if given.both[j] else float("nan"),
            float(moving.nominal[j]),
            float(moving.free[j]),
            float(moving.of_motors[j]),
            *given.encoder_ratios.get(j, nothing),
            *given.torque_delays.get(j, nothing),
        )
        for j, joint in enumerate(given.robot.joint_names)
    }
    return FrozenMapping(found, "joint")


def with_setup_findings(given: Experiment, known: Sequence[Finding]) -> list[Finding]:
    """Return the `known` findings and the mistakes of the set-up, unless those explain the torques.

    Torques beyond their limits are no finding of joints whose gains are in another unit, or whose
    limit is another one.
    """
    known = [one for one in known if _HELD not in one.evidence] + [*_decided_delays(given, known)]
    found = [*known, *_setup_findings(given, known)]
    joints = [joint for one in found for joint in one.joints]
    return [x for x in found if x.code != "saturation" or x.joints or x.joint not in joints]


def _setup_findings(given: Experiment, known: Sequence[Finding]) -> list[Finding]:
    if any(one.code in _EXPLAINING for one in known):
        return []
    found = list(offset_findings(given))
    if found:
        return found
    if given.robot.has_controllers:
        # the channels of a torque are not there, and an unknown armature looks like another mistake
        if any(one.severity == "wrong" for one in known):
            return []
        limited = list(hidden_limits(given))
        if limited:  # which looks like gains in another unit, or another zero
            return limited
        stopped = {one.joint for one in known if one.code == "contact"}
        found, without = gain_findings(given)
        found += [*limit_findings(without), *pose_findings(without)]
        return [one for one in found if one.joint not in stopped]
    found, without = mistakes(given)
    beyond = [] if found else list(limit_findings(given))
    return [*found, *beyond]


_EXPLAINING = ("time-unit", "missing-drives")
"""Findings after which the torques say nothing of other mistakes."""


def log_findings(
    robot: Robot, logs: Sequence[Log], torque_joints: Collection[str] | None = None
) -> list[Finding]:
    """Return the findings that need no motion: the unit of time, drives, saturated torques.

    Those of torques and commands are of the `torque_joints`, by default of all.
    """
    own, of_torques = list[Finding](), list[Finding]()
    for log in logs:
        own += [*_time(log), *_missing_drives(robot, log)]
        of_torques += [*no_measurements(robot, log), *command_findings(robot, log)]
    own += _references(robot, logs)
    locked = locked_outputs(robot, logs)
    standing = locked_findings(locked) if locked else _standing(logs)
    of_torques += _saturated(logs)
    used = robot.joint_names if torque_joints is None else torque_joints
    own += () if robot.has_controllers else _held_torques(logs, used)
    return [*own, *(one for one in of_torques if one.joint in used), *standing]


def _time(log: Log) -> Iterator[Finding]:
    rate = 1 / float(np.median(np.diff(log.time)))  # a gap is not the unit of the clock
    if _SLOWEST_HZ <= rate <= _FASTEST_HZ:
        return
    fitting = [
        unit for unit, size in _UNITS_OF_TIME.items() if _SLOWEST_HZ <= rate / size <= _FASTEST_HZ
    ]
    # several may fit: the one whose rate is nearest to 500 Hz
    fitting.sort(key=lambda one: abs(float(np.log(rate / _UNITS_OF_TIME[one] / 500))))
    unit, remedy = fitting[0] if fitting else "", ""
    text = "is its time in seconds?"
    if unit:
        text = f"its time seems to be in {unit}, which gives {rate / _UNITS_OF_TIME[unit]:.4g} Hz"
        clock = (log.description or {}).get("time", "time_s")
        column = clock if isinstance(clock, str) else clock.get("column", "time_s")
        remedy = (
            f'in the description of the log:\ntime = {{ column = "{column}", unit = "{unit}" }}'
        )
    yield Finding(
        "time-unit",
        f"the log has {rate:.3g} samples per second: {text}",
        severity="wrong",
        evidence={"rate [Hz]": rate},
        remedy=remedy,
        certainty="certain" if unit else "likely",
    )


def _missing_drives(robot: Robot, log: Log) -> Iterator[Finding]:
    """Yield the joints with two different encoders and an ideal drive."""
    tables, times = [], []
    for joint, drive in robot.drives.items():
        if drive.is_elastic or drive.ratio != 1 or joint not in log.joint_names:
            continue
        j = log.joint_names.index(joint)
        motor, position = log.motor_position[:, j], log.joint_position[:, j]
        if not (np.all(np.isfinite(motor)) and np.all(np.isfinite(position))):
            continue
        moved = float(np.std(position))
        if moved == 0 or np.std(motor) < _GEARED * moved:
            continue
        columns = [position, np.ones(len(position))]
        torque, sensed = log.motor_torque[:, j], log.joint_torque
        if (
            not np.any(np.isfinite(torque))
            and sensed is not None
            and np.any(np.isfinite(sensed[:, j]))
        ):
            continue  # measured behind the gear: neither friction nor rotor is in it
        if np.all(np.isfinite(torque)):  # a deflection is in proportion to it
            columns.append(torque)
        ratio, zero, *_ = scaled_svd(np.column_stack(columns)).solve(motor).tolist()
        apart = float(np.std(motor / ratio - position - zero / ratio)) / moved
        kind = "series_elastic" if apart > _ELASTIC else "stiff"
        is_linear = robot.is_prismatic[robot.index(joint)] and kind == "stiff"
        key = "gear_ratio_rad_per_m" if is_linear else "gear_ratio"
        tables.append(f'{toml_table(joint)}\ntype = "{kind}"\n{key} = {abs(ratio):.4g}')
        times.append((joint, abs(ratio)))
    if tables:
        yield Finding(
            "missing-drives",
            f"the log has the motor side of {', '.join(joint for joint, _ in times)}, which moves "
            f"{times[0][1]:.3g} times as far as the joint, and the robot has no drive there: "
            "friction, gear and spring are not in the model (--drives, drives=)",
            times[0][0],
            "wrong",
            {"motor over joint motion": times[0][1]},
            "\n".join(["option: --drives FILE, or without one", "in the drives file:", *tables]),
            "certain",
        )


_GEARED, _ELASTIC = 2.0, 5e-3
"""Motor over joint motion of a gear; difference of both sides, over the motion, of a spring."""


def _references(robot: Robot, logs: Sequence[Log]) -> Iterator[Finding]:
    """Yield reference positions outside the motion, where Coulomb friction is extrapolated."""
    for joint, drive in robot.drives.items():
        if "coulomb_position" not in drive.friction or not logs:
            continue
        own = [log.joint_position[:, log.joint_names.index(joint)] for log in logs]
        low, high = (float(end(np.concatenate(own))) for end in (np.nanmin, np.nanmax))
        reference, unit = drive.reference_position_rad, drive.joint_units[1]
        if not low <= reference <= high:
            yield Finding(
                "reference-position",
                f"Coulomb friction of {joint} is stated at {reference:g} {unit}, outside its "
                f"motion from {low:.3g} to {high:.3g} {unit}: it is extrapolated to there and may "
                "come out negative, which no simulation has",
                joint,
                "doubtful",
                {"reference position": reference, "lowest": low, "highest": high},
                f"in the drives file:\n{toml_table(joint)}\n"
                f"reference_position_rad = {0.5 * (low + high):.2g}",
                "certain",
            )


def _saturated(logs: Sequence[Log]) -> Iterator[Finding]:
    """Yield the channels that stay at their extremes: of each the log that does so longest."""
    shares: dict[tuple[str, str], tuple[float, int, float]] = {}
    for number, log in enumerate(logs, 1):
        for field in INPUT_FIELDS.values():
            values = getattr(log, field)
            for j, joint in enumerate(log.joint_names if values is not None else ()):
                share = _share_at_limit(values[:, j])
                if share > max(_AT_LIMIT, shares.get((field, joint), (0.0,))[0]):
                    shares[field, joint] = share, number, float(np.max(np.abs(values[:, j])))
    for (field, joint), (share, number, limit) in shares.items():
        where = f" in log {number}" if len(logs) > 1 else ""
        yield Finding(
            "saturation",
            f"the {field.replace('_', ' ')} of {joint} is at its limit, {limit:.4g}, during "
            f"{share:.1%} of the time{where}: a command there is not what the motor gave",
            joint,
            "doubtful" if field == "motor_torque" else "note",
            {"share at the limit": share},
            "record a slower motion, or log the measured current",
            "certain",
        )


_HELD = "samples held"
"""The evidence of torques that are held over samples of their log."""


def _held_torques(logs: Sequence[Log], used: Collection[str]) -> Iterator[Finding]:
    """Yield the motor torques that come more rarely than the samples of their log.

    A value that is held over n samples is (n - 1) / 2 samples late on average.
    """
    for number, log in enumerate(logs, 1):
        held: dict[int, list[str]] = {}
        for j, joint in enumerate(log.joint_names):
            source = log.sources()[joint].get("motor_torque", {"delay_s": np.nan})
            if joint in used and (isinstance(source, str) or not source.get("delay_s")):
                sides = (log.motor_position[:, j], log.joint_position[:, j])
                count = held_over(log.time, log.motor_torque[:, j])
                if count > max(held_over(log.time, one) for one in sides):
                    held.setdefault(count, []).append(joint)
        where = f" {number}" if len(logs) > 1 else ""
        for count, joints in held.items():
            late = 0.5 * (count - 1) * float(np.median(np.diff(log.time)))
            lines = [f"in the description of {f'log{where}' if where else 'the log'}:"]
            for joint in joints:
                source = changed_source(log.sources()[joint]["motor_torque"], delay_s=late)
                lines += [toml_table("joints", joint), f"motor_torque = {source}"]
            yield Finding(
                "delay",
                f"the motor torques of {', '.join(joints)} are held over {count} samples"
                f"{where and f' of log{where}'}, and so {1e3 * late:.3g} ms late on average, which "
                "biases friction, unless the motors give them so",
                joints[0] if len(joints) == 1 else "",
                "note",
                {_HELD: count, "delay [s]": late},
                "\n".join(lines),
                "possible",
                tuple(joints),
            )


def _share_at_limit(values: Array) -> float:
    """Return the share of samples (T,) in runs at the largest or smallest value."""
    if not np.all(np.isfinite(values)) or len(np.unique(values)) < _LEVELS:
        return 0.0
    at_limit = (values == np.max(values)) | (values == np.min(values))
    return float(np.mean(np.convolve(at_limit, np.ones(_RUN), mode="same") >= _RUN))


def _standing(logs: Sequence[Log]) -> Iterator[Finding]:
    swings = [
        float(np.ptp(side))
        for log in logs
        for side in log.joint_position.T
        if np.all(np.isfinite(side))
    ]
    if swings and max(swings) < _LEAST_SWING:
        yield Finding(
            "standstill",
            f"the robot hardly moves: its widest motion is {max(swings):.2g} rad or m",
            severity="doubtful",
            evidence={"widest motion": max(swings)},
            remedy="record a wider motion: seaid excite plans one",
            certainty="certain",
        )


_LARGEST_DEFLECTION_RAD = 0.5
"""Motion of the motor at the joint that may be the deflection of a spring. An encoder that does not
change while the motor moves further is a dead channel."""


def locked_outputs(robot: Robot, logs: Sequence[Log]) -> tuple[str, ...]:
    """Return the elastic joints whose output does not move in any log while their motor does.

    What holds it is outside, as on a test bench. The motor equation (7), and (4b) of a torque
    sensor, hold as always; the load side (8) has an unknown torque.
    """
    if not logs or not np.array_equal(robot.transmission, np.eye(robot.n)):
        return ()
    joints = [joint for joint in robot.elastic_joints if not robot.is_prismatic[robot.index(joint)]]
    return tuple(joint for joint in joints if all(_is_locked(robot, log, joint) for log in logs))


def _is_locked(robot: Robot, log: Log, joint: str) -> bool:
    if joint not in log.joint_names:
        return False
    index, drive = log.joint_names.index(joint), robot.drives[joint]
    motor, output = log.motor_position[:, index], log.joint_position[:, index]
    if not (np.all(np.isfinite(motor)) and np.all(np.isfinite(output))) or is_constant(motor):
        return False
    behind = motor * drive.motor_radius / (drive.ratio * drive.load_radius)
    return bool(np.ptp(behind) < _LARGEST_DEFLECTION_RAD) and stands_locked(output, behind)


def locked_findings(joints: Collection[str]) -> Iterator[Finding]:
    """Yield a note for each joint with a locked output."""
    for joint in joints:
        yield Finding(
            "locked-output",
            f"the output of {joint} does not move while its motor deflects the spring: it counts "
            "as locked, so that its motor, friction and spring are identified and the torque on "
            "its load is not used. If it did move, its encoder is dead: exclude its column",
            joint,
            "note",
            certainty="likely",
        )


def without_locked_loads(
    robot: Robot, used: Sequence[str], locked: Collection[str]
) -> tuple[Robot, tuple[str, ...]]:
    """Return the robot and the joints whose load side is used, those that are not locked.

    If all are locked, nothing is known of the bodies, which then count as given.
    """
    free = tuple(joint for joint in used if joint not in locked)
    if free or not used:
        return robot, free
    bodies = np.nan_to_num(robot.parameters)
    given = robot.with_values(bodies, robot.drives)
    return replace(given, known_bodies=robot.body_names), tuple(used)


def offset_findings(given: Experiment) -> Iterator[Finding]:
    """Yield joints whose encoder offsets differ between logs by more than deflections and noise.

    The angle between the encoders is the deflection, in proportion to the torque of the spring
    (that of the motor but for friction), and an offset of each log.
    """
    robot, logs = given.robot, np.unique(given.log).tolist()
    for j in np.flatnonzero(given.both).tolist() if len(logs) > 1 else ():
        joint = robot.joint_names[j]
        is_elastic = robot.drives[joint].is_elastic
        if is_elastic and robot.floating_base is not None and j not in given.used:
            continue  # its load is unknown, and is another one hanging than standing
        y = given.motor[0][:, j] / given.lever[j] - given.joint[0][:, j]
        H = np.equal.outer(given.log, logs).astype(float)
        if is_elastic and j in given.used:
            H = np.column_stack([H, given.target[:, j], given.friction[j][:, :2]])
        x = scaled_svd(H).solve(y)
        noise = float(np.std(y - H @ x)) / np.sqrt(_INDEPENDENT)
        size = float(np.std(H[:, len(logs) :] @ x[len(logs) :])) if is_elastic else 0.0
        least = _APART * size if is_elastic else _LEAST_OFFSET
        for number, change in enumerate((x[1 : len(logs)] - x[0]).tolist(), 2):
            if abs(change) > least + _SURE * noise:
                yield _offset(given, j, number, change, size)


def _offset(given: Experiment, j: int, number: int, change: float, size: float) -> Finding:
    """Return the finding for encoder offsets that changed between log 1 and another one."""
    joint = given.robot.joint_names[j]
    wanted = "motor_position" if size else "joint_position"
    offset = -change * given.lever[j] if size else change
    times = f", {abs(change) / size:.2g} times the deflection of its spring (rms)" if size else ""
    return Finding(
        "encoder-offsets-differ",
        f"the encoder offsets of {joint} differ by {abs(change):.4g} at the joint between log 1 "
        f"and log {number}{times}: the robot was switched on anew",
        joint,
        "wrong" if size else "doubtful",
        {"difference at the joint": change},
        f"in the description of log {number}:\n{toml_table('joints', joint)}\n"
        f"{wanted} = {changed_source(given.source(j, wanted, number - 1), offset=offset)}",
        "certain" if size else "likely",
    )


_LEAST_OFFSET = 2e-3
"""Difference [rad or m] of the encoder offsets of a joint without a spring that matters."""


_BEYOND = 5.0
"""Multiple of a limit of the robot file from which a channel, and not the limit, is wrong."""


def limit_findings(given: Experiment) -> Iterator[Finding]:
    """Yield joints that move or pull many times beyond the limits of the robot file."""
    robot = given.robot
    ends = np.array([robot.lower_limits, robot.upper_limits])
    known = np.all(np.isfinite(ends), axis=0)
    middle = np.where(known, np.mean(np.where(known, ends, 0.0), axis=0), 0.0)
    half = np.where(known, 0.5 * np.ptp(np.where(known, ends, 0.0), axis=0), np.inf)
    checks = (
        ("position", np.abs(given.joint[0] - middle), half),
        ("speed", np.abs(given.joint[1]), robot.velocity_limits),
        ("torque", np.abs(given.target), robot.effort_limits),
    )
    for name, values, limits in checks:
        for j in range(robot.n):
            largest, limit = float(np.max(values[:, j])), float(limits[j])
            if np.isfinite(limit) and 0 < _BEYOND * limit < largest:
                yield Finding(
                    "unit",
                    f"the {name} of {robot.joint_names[j]} reaches {largest / limit:.3g} times the "
                    "limit of the robot file: check the unit of its channels and of the time",
                    robot.joint_names[j],
                    "doubtful",
                    {f"{name} over its limit": largest / limit},
                    certainty="possible",
                )


def _decided_delays(given: Experiment, known: Sequence[Finding]) -> Iterator[Finding]:
    """Yield the findings of torques that are held over samples, unless the motion excludes a delay.

    Torques that a motor gets held are not late; a longer delay has another cause.
    """
    for one in (one for one in known if _HELD in one.evidence):
        places = {given.robot.index(joint) for joint in one.joints}
        delays = [delay for j, delay in given.torque_delays.items() if j in places]
        late = one.evidence["delay [s]"]
        values, errors = np.array(delays).reshape(-1, 2).T
        weights = 1.0 / (errors**2 + late**2)
        if not delays or float(np.linalg.norm(weights * errors) / np.sum(weights)) > late / 2:
            yield one
        elif late / 2 < np.average(values, weights=weights) < max(1.5 * late, LEAST_DELAY_S):
            yield replace(one, severity="doubtful", certainty="likely")


_INDEPENDENT, _SURE = 10, 5.0
"""Independent rows of a log, at least, and multiple of the standard error of an offset."""


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
    moved = [one for one in robot.joint_names if any(_joint_moves(log, one) for log in logs)]
    if not moved:
        raise ExcitationError("no joint moves in the log: the motion does not excite the robot")
    if robot.floating_base is not None or not np.array_equal(robot.transmission, np.eye(robot.n)):
        return {}
    found = {}
    for index, joint in enumerate(robot.joint_names):
        if joint not in moved:
            positions = [one.joint_position[:, index] for one in motions]
            found[joint] = float(np.mean(np.concatenate(positions)))
        elif not _drive_moves(robot, logs, motions, joint):
            found[joint] = float("nan")
    return found


def _joint_moves(log: Log, joint: str) -> bool:
    """Whether an encoder of a joint, or the one of its motor, moves."""
    index = log.joint_names.index(joint)
    sides = (log.joint_position[:, index], log.motor_position[:, index])
    return any(_moves(side) for side in sides if np.all(np.isfinite(side)))


def _drive_moves(robot: Robot, logs: Sequence[Log], motions: Sequence[Motion], joint: str) -> bool:
    """Whether the equation of a drive has rows, whose friction is known, and its motor moves."""
    if not robot.drives[joint].is_elastic:
        return any(np.any(usable_rows(robot, one, joint, row_samples(one))) for one in motions)
    regressor = motor_regressor(robot, joint)
    return any(_moves(log.motor_position[:, log.joint_names.index(joint)]) for log in logs) and any(
        len(actuator_rows(robot, one, joint, regressor)[0]) for one in motions
    )


def without_standing(
    robot: Robot, used: Sequence[str], standing: Mapping[str, float]
) -> tuple[Robot, tuple[str, ...], list[Finding]]:
    """Return the robot without the drives that stand still, the other joints, and findings.

    The torque of a joint at rest is that of its load but for a friction that nothing determines.
    """
    if not standing:
        return robot, tuple(used), []
    drives = {joint: robot.drives[joint] for joint in standing}
    elastic = {joint: IDEAL_DRIVE for joint, drive in drives.items() if drive.is_elastic}
    dropped = [
        joint
        for joint in standing
        if joint in elastic or (joint in used and motor_regressor(robot, joint).names)
    ]
    moving = tuple(joint for joint in used if joint not in dropped)
    if used and not moving:
        raise ExcitationError(
            f"{listed(dropped)}: the drive stands still in all logs, and no other joint has a "
            "torque, so that no friction and no inertia is identifiable: move this joint"
        )
    places = {joint: place for joint, place in standing.items() if np.isfinite(place)}
    robot = replace(robot.with_drives(elastic), at_rest=FrozenMapping(places, "joint"))
    return robot, moving, [_standing_still(joint, drives[joint], places) for joint in dropped]


def _standing_still(joint: str, drive: Drive, places: Mapping[str, float]) -> Finding:
    """Return the finding of a joint whose drive moves in no log."""
    what = (
        "friction, spring and rotor inertia" if drive.is_elastic else "friction and rotor inertia"
    )
    text = f"no sample of {joint} is away from standstill in any log"
    remedy = "move this joint"
    if joint in places:
        at = f"{places[joint]:.4g}"
        text = f"{joint} stands still in all logs, at {at} {drive.joint_units[1]}"
        remedy += (
            f", or lock it (--locked {joint}={at}), at the top of seaid.toml:\n"
            f"locked = {{ {toml_key(joint)} = {at} }}"
        )
    return Finding(
        "standstill",
        f"{text}: its {what} are not estimated, and its torque is not used",
        joint,
        "doubtful",
        {"position": places[joint]} if joint in places else {},
        remedy,
        "certain",
    )


def check_channels(logs: Sequence[Log], locked: Collection[str] = ()) -> None:
    """Raise LogError if a sensor is constant while another sensor of its joint moves.

    The outputs of joints that are `locked` are constant.
    """
    for log in logs:
        for index, joint in enumerate(log.joint_names):
            sides = {
                "motor position": log.motor_position[:, index],
                "joint position": log.joint_position[:, index],
            }
            pairs = [tuple(sides)] if joint in locked else [tuple(sides), tuple(sides)[::-1]]
            for dead, other in pairs:
                _check_alive(joint, dead, sides[dead], other, sides[other])
            torques = {"motor torque": log.motor_torque[:, index]}
            if log.joint_torque is not None:
                torques["joint torque"] = log.joint_torque[:, index]
            for name, torque in torques.items():
                for side, position in sides.items():
                    _check_alive(joint, name, torque, side, position)


def _check_alive(joint: str, name: str, values: Array, other: str, moved: Array) -> None:
    if is_constant(values) and np.all(np.isfinite(moved)) and _moves(moved):
        raise LogError(
            f"the {name} of '{joint}' is {values[0]:.6g} all the time, while its {other} moves: a "
            "dead channel? Exclude its column from the log, or the joint with joints=[...] of "
            "load_robot",
            "joints=[...] of load_robot",
        )


def _moves(position: Array) -> bool:
    least = max(_LEAST_RANGE * white_noise(position), _FLICKER * resolution(position))
    return bool(np.ptp(position) > least)
