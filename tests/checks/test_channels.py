"""What the channels of a log show is named, with a remedy that repairs it."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid._arrays import Array, IndexArray
from seaid.checks.channels import _lost
from seaid.checks.setup import _are_scales, log_findings
from seaid.errors import Finding
from seaid.identification import check
from seaid.log import Log
from seaid.robot import Robot
from tests.commanded_joint import SOFT, mujoco_log, robot_of
from tests.experiments import MODELS, TEST_MASS, arm, arm_log, geared_arm_log, leg, leg_log
from tests.mistakes import CASES, described, repaired, worst
from tests.one_joint import one_joint
from tests.plants import write_columns
from tests.representatives import quick_first, quick_only


def test_motor_channels_without_drives() -> None:
    robot = seaid.load_robot(str(leg().urdf))
    finding = worst(robot, leg_log())
    assert finding.code == "missing-drives"
    option, header, text = finding.remedy.split("\n", 2)
    assert option.startswith("option: --drives FILE")
    assert header == "in the drives file:"
    tables = tomllib.loads(text)
    assert list(tables) == list(leg().joint_names)
    assert tables["hip_yaw"]["gear_ratio"] == pytest.approx(86.0, rel=1e-3)


@pytest.mark.slow  # 1.0 s
def test_limits_of_the_robot_file_unmask_units_without_nominal_bodies() -> None:
    robot = leg(TEST_MASS).without_nominal()
    for name, limit in (("effort_limits", 0.5), ("velocity_limits", 1e-3)):
        weak: dict[str, Any] = {name: np.full(5, limit)}
        found = seaid.check(replace(robot, **weak), leg_log()).warnings
        assert {(x.code, x.severity) for x in found} == {("unit", "doubtful")}
        assert found[0].joints == leg().joint_names


@pytest.mark.parametrize(("case", "joint", "slip"), [("leg", 3, 0.02), ("arm", 1, -0.01)])
def test_a_coupling_that_slips_within_a_log_is_named_with_its_time(
    case: str, joint: int, slip: float
) -> None:
    """Its parts as two logs have two encoder offsets."""
    robot, log = CASES[case][0](), CASES[case][1]()
    name, start = robot.joint_names[joint], float(log.time[0]) + 2.5
    drive, motor = robot.drives[name], log.motor_position.copy()
    motor[log.time > start, joint] += drive.ratio * drive.load_radius / drive.motor_radius * slip
    slipped = replace(log, motor_position=motor)
    finding = worst(robot, slipped)
    assert (finding.code, finding.joint) == ("loose-encoder", name)
    assert finding.evidence["step"] == pytest.approx(slip, rel=0.1)
    assert finding.evidence["time [s]"] == pytest.approx(start, abs=0.15)
    parts = slipped.between(-1.0, start - 0.1), slipped.between(start + 0.1, 1e9)
    codes = {(x.code, x.joint) for x in seaid.check(robot, list(parts)).warnings}
    assert ("encoder-offsets-differ", name) in codes
    assert "loose-encoder" not in {code for code, _ in codes}


@pytest.mark.parametrize(("start_s", "end_s"), [(2.0, 3.5), (2.0, 3.0)])
def test_friction_at_a_reversal_is_no_slip_of_a_short_log(start_s: float, end_s: float) -> None:
    """Few instants, of which the other columns of an experiment leave little."""
    plan = seaid.load_trajectory(MODELS / "tulip_plan.json")
    log = seaid.simulate(leg(TEST_MASS), plan, seed=1).between(start_s, end_s)
    codes = {finding.code for finding in seaid.check(leg(TEST_MASS), log).warnings}
    assert "loose-encoder" not in codes


@pytest.mark.slow  # 1.3 s
def test_a_coupling_that_slips_hides_no_other_mistake() -> None:
    log = leg_log()
    motor, torque = log.motor_position.copy(), log.motor_torque.copy()
    motor[log.time > log.time[0] + 2.5, 3] += 86.0 * 0.02
    torque[:, 1] *= -1
    shown = seaid.check(leg(TEST_MASS), replace(log, motor_position=motor, motor_torque=torque))
    codes = {(x.code, x.joint) for x in shown.warnings if x.severity != "note"}
    assert codes == {("loose-encoder", "knee_pitch"), ("sign", "hip_roll")}


@pytest.mark.parametrize("case", quick_only(CASES, ["arm"]))  # 0.9 s each
def test_encoders_that_drift_against_each_other_do_not_step(case: str) -> None:
    robot, log = CASES[case][0](), CASES[case][1]()
    t = (log.time - log.time[0]) / np.ptp(log.time)
    for drift in (t, np.sin(2 * np.pi * t)):
        motor = log.motor_position + 0.02 * drift[:, None] * [
            x.ratio for x in robot.drives.values()
        ]
        codes = {x.code for x in seaid.check(robot, replace(log, motor_position=motor)).warnings}
        assert "loose-encoder" not in codes


@pytest.mark.slow  # several checks of the arm
@pytest.mark.parametrize("has_drives", [True, False])
def test_an_unknown_rotor_inertia_is_no_delay(has_drives: bool) -> None:
    log = geared_arm_log()
    robot = geared_arm() if has_drives else seaid.load_robot("ur10", snap_tolerance_rad=0)
    assert "delay" not in [one.code for one in seaid.check(robot, log).warnings]
    late = replace(log, motor_torque=np.roll(log.motor_torque, 5, axis=0)).between(0.1, 9.9)
    (delay,) = [one for one in seaid.check(robot, late).warnings if one.code == "delay"]
    error = delay.evidence["standard error [s]"]
    assert abs(delay.evidence["delay [s]"] - 0.02) < 2.5 * error < 0.005


def test_a_jump_of_the_clock_is_not_its_unit() -> None:
    robot, log = arm(), arm_log()
    time = log.time + np.where(np.arange(len(log.time)) > 500, 1000.0, 0.0)
    assert "time-unit" not in {one.code for one in log_findings(robot, [replace(log, time=time)])}


@pytest.mark.parametrize(("stated", "unit"), [("s", "ms"), ("ms", "us"), ("us", "ns")])
def test_a_clock_is_in_a_smaller_unit_than_its_description_states(stated: str, unit: str) -> None:
    robot, log = arm(), arm_log()
    slow = replace(log, time=1e3 * log.time, description={"time": {"column": "t", "unit": stated}})
    (finding,) = (x for x in log_findings(robot, [slow]) if x.code == "time-unit")
    described = tomllib.loads(finding.remedy.split("\n", 1)[1])
    assert described == {"time": {"column": "t", "unit": unit}}


def test_torques_held_over_samples_are_named_and_the_remedy_repairs_them(tmp_path: Path) -> None:
    """Viscous friction was too large by the inertia times the delay times the squared frequency."""
    drive = {"type": "stiff", "gear_ratio": 50.0, "friction": ["viscous", "coulomb"]}
    robot = one_joint(tmp_path, drive={**drive, "motor_inertia_kg_m2": 1e-5})
    rng = np.random.default_rng(0)
    time, frequencies = np.arange(4000) / 1000.0, 2 * np.pi * np.arange(1, 5) / 2
    phases = rng.uniform(0, 6, 4) + np.outer(time, frequencies)
    angle, speed = 0.2 * np.sin(phases).sum(axis=1), 0.2 * np.cos(phases) @ frequencies
    torque = (1e-5 + 1 / 50**2) * -50 * 0.2 * np.sin(phases) @ frequencies**2
    torque += 4e-5 * 50 * speed + 0.01 * np.sign(speed) + 1e-4 * rng.normal(size=len(time))
    angle += 1e-6 * rng.normal(size=len(time))

    def read(torques: Array, description: Any = None) -> Log:
        columns = {"time_s": time, "arm.joint_position_rad": angle, "arm.motor_torque_Nm": torques}
        path = write_columns(tmp_path / "run.csv", columns, "%.9g")
        return seaid.read_log(path, robot, description=description)

    pairs = np.arange(len(time)) // 2 * 2
    held = read(torque[pairs])
    (finding,) = check(robot, held).warnings
    assert (finding.code, finding.severity, finding.joint) == ("delay", "doubtful", "arm")
    assert finding.evidence["delay [s]"] == pytest.approx(0.0005, rel=0.1)
    repaired = read(torque[pairs], tomllib.loads(finding.remedy.split("\n", 1)[1]))
    # a motor that gets held torques has them on average when they are logged, and is not late
    given = np.interp(pairs + 0.5, np.arange(len(time)), torque)
    coarse = np.round(torque / 0.05) * 0.05
    for right in (repaired, read(torque), read(given), read(coarse)):
        assert check(robot, right).warnings == ()
    fits = [seaid.identify(robot, log).drives["arm"] for log in (held, repaired)]
    name = "viscous_friction"
    errors = [(fit.value(name) - 4e-5) / fit.standard_error(name) for fit in fits]
    assert errors[0] > 4
    assert abs(errors[1]) < 2


def test_friction_stated_where_the_joint_never_is_has_the_line_that_repairs_it(urdf: Path) -> None:
    """A servo that moves between 1.6 and 2.8 rad has its own friction at 0 rad extrapolated."""
    robot, log = robot_of(urdf, SOFT, 0.0), mujoco_log(SOFT, 0.0, 1e-5, 1)
    terms = (*robot.drives["j"].friction, "coulomb_position")
    log = replace(log, joint_position=log.joint_position + 2.2)

    def found(reference: float) -> tuple[Robot, list[Finding]]:
        drive = replace(robot.drives["j"], friction=terms, reference_position_rad=reference)
        stated = robot.with_drives({"j": drive})
        return stated, [x for x in log_findings(stated, [log]) if x.code == "reference-position"]

    assert found(2.2)[1] == []
    stated, (finding,) = found(0.0)
    right, _ = repaired(stated, log, finding.remedy)
    middle = 0.5 * float(np.min(log.joint_position) + np.max(log.joint_position))
    assert right.drives["j"].reference_position_rad == pytest.approx(middle, rel=0.025)


def geared_arm() -> Robot:
    """Return the UR10 with stiff drives of unknown inertia."""
    drive = seaid.StiffDrive(gear_ratio=1.0)
    drives = dict.fromkeys(geared_arm_log().joint_names, drive)
    return seaid.load_robot("ur10", drives, snap_tolerance_rad=0)


ROBOTS: dict[str, tuple[Callable[[], Robot], Callable[[], Log]]] = {
    "leg": (lambda: leg(TEST_MASS), leg_log),
    "arm": (arm, arm_log),
    "ur10": (geared_arm, geared_arm_log),
}
"""Three robots: with springs, with sliding joints, and without the motor side."""


def at(log: Log, samples: IndexArray, time: Array) -> Log:
    """Return some samples of a log as those of a time."""
    changed: dict[str, Any] = {name: x[samples] for name, x in log.sensors().items()}
    return replace(log, time=time, **changed)


@pytest.mark.parametrize("case", quick_only(ROBOTS, ["leg", "arm"]))
def test_the_channels_of_right_logs_are_silent(case: str) -> None:
    robot, log = ROBOTS[case][0](), ROBOTS[case][1]()
    assert log_findings(robot, [log]) == []


@pytest.mark.parametrize("case", quick_only(ROBOTS, ["leg", "arm"]))  # 2 s of the UR10
def test_lost_samples_are_seen_where_the_time_is_a_counter(case: str) -> None:
    """A clock shows them as gaps; a few are not distinguished from a jerk."""
    robot, log = ROBOTS[case][0](), ROBOTS[case][1]()
    rng = np.random.default_rng(1)
    inner = np.arange(20, len(log.time) - 20, 10)
    kept = np.ones(len(log.time), dtype=bool)
    for first in rng.choice(inner, 25, replace=False).tolist():
        kept[first : first + rng.integers(1, 4)] = False
    samples = np.flatnonzero(kept)
    (finding,) = log_findings(robot, [at(log, samples, log.time[: len(samples)])])
    assert (finding.code, finding.severity) == ("holes", "doubtful")
    assert 0.7 * np.sum(~kept) < finding.evidence["lost samples"] <= np.sum(~kept)
    assert log_findings(robot, [at(log, samples, log.time[samples])]) == []
    twice = np.sort(np.concatenate([np.arange(len(log.time)), rng.choice(inner, 25)]))
    late = at(log, twice[: len(log.time)], log.time)  # what is logged twice is not lost
    assert log_findings(robot, [late]) == []


@pytest.mark.parametrize("side", quick_first(["joint_position", "motor_position"]))
@pytest.mark.parametrize("count", quick_first([10, 4]))
def test_encoders_that_are_slower_than_their_log_are_named_and_its_repair_is_right(
    side: str, count: int, tmp_path: Path
) -> None:
    """A staircase looked like a time in another unit, or like a zero of another joint."""
    robot, log = leg(TEST_MASS), leg_log()
    last_new = np.arange(len(log.time)) // count * count
    changed: dict[str, Any] = {side: getattr(log, side)[last_new]}
    slow, path = replace(log, **changed), tmp_path / "slow.csv"
    seaid.write_log(slow, path)
    held = seaid.read_log(path, robot)
    warnings = check(robot, held).warnings
    assert [(x.code, x.severity, x.joints) for x in warnings] == [
        ("holes", "wrong", robot.joint_names)
    ]
    assert warnings[0].evidence == {"samples per new value": count}
    right = seaid.read_log(
        path, robot, description=tomllib.loads(warnings[0].remedy.split("\n", 1)[1])
    )
    assert log_findings(robot, [right]) == []
    errors = [np.std(getattr(x, side) - getattr(log, side), axis=0) for x in (held, right)]
    assert np.all(errors[1] < 0.2 * errors[0])


def test_an_encoder_that_slips_has_lost_no_samples() -> None:
    """Its values after the slip lie between those before, as if its resolution were finer."""
    time, step = np.arange(20000) / 1e3, 2 * np.pi / 4000
    angles = [np.sin(2 * np.pi * 0.31 * time), np.sin(2 * np.pi * 0.37 * time + 1)]
    angles += [2 * np.clip(1.5 * np.sin(2 * np.pi * 0.23 * time), -1, 1)]  # which rests at times
    encoders = [np.round(angle / step) * step for angle in angles]
    encoders[2] += 3.0 * (time > 11)
    assert len(_lost(encoders)) == 0


@pytest.mark.parametrize("decimals", [7, 12])
def test_counts_of_an_encoder_with_few_decimals_have_lost_no_samples(decimals: int) -> None:
    """The decimals of a file looked like the resolution of its encoders."""
    step, counts = 2 * np.pi / 2**14, 1.15 * np.abs(np.arange(20000) % 4000 - 2000)
    encoders = np.array([counts, 0.01 * counts]).round() * step
    assert len(_lost([*encoders.round(decimals)])) == 0


def wrapped(log: Log, robot: Robot, joint: str, field: str, crossing: float) -> Log:
    """Return the log with an encoder that wraps around where `crossing` of its range is passed."""
    values, j = getattr(log, field).copy(), robot.index(joint)
    low = np.min(values[:, j])
    end = low + crossing * np.ptp(values[:, j])
    values[:, j] = (values[:, j] - end) % (2 * np.pi) + (end if field == "joint_position" else 0.0)
    changed: dict[str, Any] = {field: values}
    return replace(log, **changed)


WRAPPED = [
    ("leg", "hip_roll", "joint_position", 0.5),
    ("leg", "knee_pitch", "joint_position", 0.97),  # at the end of its range only
    ("leg", "knee_pitch", "motor_position", 0.3),
    ("arm", "shoulder", "joint_position", 0.5),
    ("arm", "shoulder", "motor_position", 0.1),
    ("ur10", "elbow_joint", "joint_position", 0.4),
]


@pytest.mark.parametrize(("case", "joint", "field", "crossing"), quick_first(WRAPPED, 5))
def test_encoders_that_wrap_around_are_named_and_unwrapped(
    case: str, joint: str, field: str, crossing: float
) -> None:
    robot, log = ROBOTS[case][0](), ROBOTS[case][1]()
    bad = wrapped(log, robot, joint, field, crossing)
    right = repaired_channels(robot, bad, ("wraps", "wrong", (joint,)))
    moved = getattr(right, field) - getattr(log, field)
    assert np.ptp(moved, axis=0) == pytest.approx(0, abs=1e-6)
    if field == "joint_position":
        assert moved == pytest.approx(0, abs=1e-6)


def repaired_channels(robot: Robot, bad: Log, found: tuple[str, str, tuple[str, ...]]) -> Log:
    """Check the only finding in the channels of a log, and return the log by its remedy."""
    (finding,) = log_findings(robot, [bad])
    assert (finding.code, finding.severity, finding.joints) == found
    return described(bad, finding.remedy)


def test_wrapped_encoders_that_flicker_and_glitches_that_do_not_wrap() -> None:
    """Noise at the end of a turn lets an encoder jump forth and back."""
    robot, log = leg(TEST_MASS), leg_log()
    noise = 2e-3 * np.random.default_rng(0).normal(size=log.joint_position.shape)
    noisy = replace(log, joint_position=log.joint_position + noise)
    (finding,) = log_findings(robot, [wrapped(noisy, robot, "hip_roll", "joint_position", 0.9)])
    assert (finding.code, finding.joint) == ("wraps", "hip_roll")
    glitches = noisy.joint_position.copy()
    glitches[::500, 1] = 0.0  # lost messages
    glitches[250::500, 1] += 2 * np.pi
    assert log_findings(robot, [replace(log, joint_position=glitches)]) == []


def limited(robot: Robot, log: Log) -> Robot:
    """Return the robot with effort limits that its torques reach by two thirds."""
    levers = [x.ratio * x.load_radius / x.motor_radius for x in robot.drives.values()]
    largest = np.max(np.abs(log.motor_torque), axis=0)
    return replace(robot, effort_limits=1.5 * largest * np.abs(levers))


def rated(log: Log, full: float, *places: int) -> Log:
    """Return the log with torques of some joints, of all by default, as parts of their limits."""
    torque, chosen = log.motor_torque.copy(), list(places or range(len(log.joint_names)))
    limits = 1.5 * np.max(np.abs(torque[:, chosen]), axis=0)
    torque[:, chosen] = np.round(full * torque[:, chosen] / limits)
    return replace(log, motor_torque=torque)


RATED = [("leg", 100.0, ()), ("leg", 1000.0, (2,)), ("arm", 1000.0, ()), ("arm", 100.0, (1,))]


@pytest.mark.parametrize(("case", "full", "places"), RATED)
def test_torques_that_are_parts_of_a_rating_are_named(
    case: str, full: float, places: tuple[int, ...]
) -> None:
    log = ROBOTS[case][1]()
    robot = limited(ROBOTS[case][0](), log)
    names = tuple(robot.joint_names[j] for j in places) or robot.joint_names
    right = repaired_channels(robot, rated(log, full, *places), ("unit", "wrong", names))
    assert log_findings(robot, [right]) == []
    steps = 1.5 * np.max(np.abs(log.motor_torque), axis=0) / full
    assert np.all(np.abs(right.motor_torque - log.motor_torque) < 0.51 * steps)


@pytest.mark.parametrize(("case", "full"), [("leg", 1000.0), ("arm", 100.0)])
@pytest.mark.parametrize("bits", [16, 32])
def test_signed_integers_that_were_read_without_their_sign(
    case: str, full: float, bits: int
) -> None:
    """A servo that counts its load in 0.1 % gives 65535 for -1, which looked like a joint limit."""
    log = ROBOTS[case][1]()
    robot = limited(ROBOTS[case][0](), log)
    signed = rated(log, full)
    bad = replace(signed, motor_torque=signed.motor_torque % 2**bits)
    right = repaired_channels(robot, bad, ("wraps", "wrong", robot.joint_names))
    assert np.array_equal(right.motor_torque, signed.motor_torque)
    (finding,) = log_findings(robot, [right])
    assert finding.code == "unit"


@pytest.mark.slow  # identifies the pendulum of a servo, and checks three robots
def test_torques_far_above_those_of_known_bodies_are_named() -> None:
    """Friction of a hundred times the weight of a known payload was "good" for a servo's load."""
    robot, log = _servo_with_payload()
    found = seaid.identify(robot, log)
    (finding,) = [x for x in found.warnings if x.severity == "wrong"]
    assert (finding.code, finding.joint) == ("unit", "pendulum")
    scaled = replace(log, motor_torque=log.motor_torque * 0.6 / 100)
    assert "unit" not in [x.code for x in seaid.identify(robot, scaled).warnings]
    for case, (make, log_of) in ROBOTS.items():
        known = replace(make(), known_bodies=make().body_names)
        assert seaid.check(known, log_of()).warnings == (), case


def _servo_with_payload() -> tuple[Robot, Log]:
    """Return a pendulum with a payload of 0.49 kg, and a log of the duty cycle of its servo [%]."""
    drive = seaid.StiffDrive(gear_ratio=1.0, friction=("viscous", "coulomb", "offset"))
    payload = seaid.Payload("arm", 0.49, (0, 0, -0.1))
    path = MODELS / "xl330_pendulum.urdf"
    robot = seaid.load_robot(path, {"pendulum": drive}, payloads=[payload])
    time = np.arange(0, 6, 0.005)
    angle = 0.5 * np.sin(4 * time) * np.sin(0.7 * time)
    speed = np.gradient(angle, time)
    weight, inertia = 0.049 * 9.81, 0.0049 + 0.0016
    torque = weight * np.sin(angle) + inertia * np.gradient(speed, time)
    torque += 0.03 * np.tanh(speed / 0.1) + 0.05 * speed
    duty = torque * 100 / 0.6 + np.random.default_rng(3).normal(size=len(time))
    nothing = np.full((len(time), 1), np.nan)
    log = seaid.Log(time, ("pendulum",), nothing, angle[:, None], duty[:, None])
    return replace(robot, effort_limits=np.array([np.inf])), log


@pytest.mark.parametrize("case", ["leg", "arm"])
@pytest.mark.parametrize("channel", ["motor_torque", "joint_torque"])
def test_a_torque_that_ends_at_a_limit_is_named_with_its_level(case: str, channel: str) -> None:
    robot, log = ROBOTS[case][0](), ROBOTS[case][1]()
    right = replace(log, joint_torque=10 * log.motor_torque)
    assert log_findings(robot, [right]) == []
    torque = getattr(right, channel).copy()
    limit = float(np.quantile(torque[:, 1], 0.8))
    torque[:, 1] = np.minimum(torque[:, 1], limit)
    changed: dict[str, Any] = {channel: torque}
    (finding,) = log_findings(robot, [replace(right, **changed)])
    assert (finding.code, finding.joint) == ("saturation", robot.joint_names[1])
    assert (finding.severity, channel.replace("_", " ") in finding.message) == ("doubtful", True)
    assert finding.evidence["limit"] == pytest.approx(abs(limit))
    assert finding.evidence["share at the limit"] == pytest.approx(0.2, abs=0.01)


def stopped(case: str, joint: str, share: float, size: float) -> tuple[Robot, Log, Log]:
    """Return a robot whose joint meets an elastic stop in a share of its samples, and its logs.

    The first log is that with the stop, which pushes with up to `size` times the standard deviation
    of the torque, and the second one that without it. A spring carries the push too.
    """
    robot, log = ROBOTS[case][0](), ROBOTS[case][1]()
    j, drive = robot.index(joint), robot.drives[joint]
    place = log.joint_position[:, j]
    limit = float(np.quantile(place, 1 - share))
    lower, upper = np.min(log.joint_position, axis=0) - 1, np.max(log.joint_position, axis=0) + 1
    upper[j] = limit
    push = np.maximum(place - limit, 0) / np.ptp(np.maximum(place - limit, 0))
    push *= size * float(np.std(log.motor_torque[:, j]))
    torque, motor = log.motor_torque.copy(), log.motor_position.copy()
    torque[:, j] += push
    if isinstance(drive, seaid.SeriesElasticDrive):
        gear = drive.motor_radius / drive.ratio
        motor[:, j] += push / (gear**2 * drive.values["stiffness"])
    robot = replace(robot, lower_limits=lower, upper_limits=upper)
    return robot, replace(log, motor_torque=torque, motor_position=motor), log


def excluded(log: Log, remedy: str) -> Log:
    """Return the log without the times that a remedy excludes."""
    spans = tomllib.loads(remedy.split("\n", 1)[1])["exclude_s"]
    kept = [not any(start <= t < end for start, end in spans) for t in log.time]
    samples = np.flatnonzero(kept)
    return at(log, samples, log.time[samples])


SHORT, LONG = (0.05, 1.0), (0.2, 3.0)
"""How long a joint is at its stop, and how hard."""

STOPS = [
    ("leg", "knee_pitch", *SHORT),
    ("leg", "hip_roll", *LONG),
    ("arm", "rail", *SHORT),
    ("arm", "rail", *LONG),
    ("ur10", "elbow_joint", *LONG),
]


@pytest.mark.slow  # identifies three robots
@pytest.mark.parametrize(("case", "joint", "share", "size"), STOPS)
def test_a_joint_at_its_stop_is_named(case: str, joint: str, share: float, size: float) -> None:
    robot, bad, right = stopped(case, joint, share, size)
    assert seaid.check(robot, right).warnings == ()
    found = [x for x in seaid.identify(robot, bad).warnings if x.severity != "note"]
    assert [(x.code, x.joint, x.severity) for x in found] == [("contact", joint, "wrong")]
    assert found[0].evidence["share at the limit"] == pytest.approx(share, abs=0.06)
    logs = (excluded(log, found[0].remedy) for log in (bad, right))
    # A log without a fifth of its time may be at the edge of having enough rows, and of these few
    # the right one may support a term by chance.
    repaired, wanted = (
        {(x.code, x.joint) for x in seaid.identify(robot, log).warnings if x.severity != "note"}
        - {("few-rows", "")}
        for log in logs
    )
    assert repaired <= wanted


@pytest.mark.parametrize(
    ("factors", "differ"),
    [([1000, 1030, 980, 250], False), ([90, 240, 150, 1100], True), ([30, 30, 90], False)],
)
def test_one_factor_of_most_joints_is_a_unit_and_no_rating(
    factors: list[float], differ: bool
) -> None:
    assert _are_scales(np.log(factors), np.full(len(factors), 50.0)) == differ
