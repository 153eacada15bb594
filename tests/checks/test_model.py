"""Terms that the rows of an identification support: named, and added where nobody named any."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import seaid
from scripts.benchmarks import contact_backlash
from seaid._arrays import Array, FrozenMapping
from seaid.checks import drive_findings
from seaid.checks.codes import CODES
from seaid.checks.columns import DRIVE_CHECKS, Side, _is_impossible, resolved_widths
from seaid.checks.engine import (
    Accepted,
    Alternative,
    Candidate,
    Equation,
    ModelComparison,
    Trial,
)
from seaid.drives.drives import DefaultTerms
from seaid.drives.terms import FrictionTerm
from seaid.drives.toml import drive_table, drives_from_mapping
from seaid.errors import Finding
from seaid.identification.identification import identify
from seaid.identification.result import Identification
from seaid.log.motion import Motion
from seaid.log.reading import Log
from seaid.robot.robot import Robot
from seaid.simulation.simulation import measure
from tests.experiments import (
    LEG_SENSORS,
    TEST_MASS,
    arm,
    arm_log,
    arm_motion,
    leg,
    leg_log,
    leg_motion,
    leg_trajectory,
    perfect_log,
)
from tests.mistakes import described
from tests.one_joint import one_joint
from tests.representatives import quick_first, quick_only

OF_TERMS = ("missing-term", "nonlinear-spring")
NAMED: tuple[FrictionTerm, ...] = ("viscous", "coulomb")


@cache
def named() -> Robot:
    """Return the leg whose friction terms the user names."""
    drives = {joint: replace(drive, friction=NAMED) for joint, drive in leg().drives.items()}
    return leg(TEST_MASS).with_drives(drives).without_nominal()


def open_robot() -> Robot:
    """Return the leg without named friction terms."""
    plain = DefaultTerms(NAMED)
    drives = {joint: replace(drive, friction=plain) for joint, drive in leg().drives.items()}
    return leg(TEST_MASS).with_drives(drives).without_nominal()


def with_torque(joint: str, more: Array) -> Log:
    """Return the log of a motor that needs more torque for the same motion."""
    torque = leg_log(3).motor_torque.copy()
    torque[:, leg().index(joint)] += more
    return replace(leg_log(3), motor_torque=torque)


def findings(found: Identification) -> list[Finding]:
    return [one for one in found.warnings if one.code in OF_TERMS]


def speed(joint: str) -> Array:
    return np.asarray(leg_motion(TEST_MASS).motor_velocity[:, leg().index(joint)])


def spring_part(joint: str, power: int, share: float) -> Array:
    """Return the motor torque of a spring part: a share of the force at the largest deflection."""
    motion, index, drive = leg_motion(TEST_MASS), leg().index(joint), leg().drives[joint]
    lever = drive.motor_radius / drive.ratio
    stretch = lever * motion.motor_position[:, index]
    stretch = stretch - drive.load_radius * motion.joint_position[:, index]
    top = float(np.max(np.abs(stretch)))
    return np.asarray(lever * share * drive.values["stiffness"] * top * (stretch / top) ** power)


@pytest.mark.slow  # 0.9 s
@pytest.mark.parametrize("seed", quick_first(range(2)))
def test_a_right_model_has_no_finding(seed: int) -> None:
    assert findings(identify(named(), leg_log(seed))) == []
    assert findings(identify(open_robot(), leg_log(seed))) == []
    sensed = arm_log(seed)
    assert findings(identify(arm().without_nominal(), sensed)) == []


@pytest.mark.slow  # 0.9 s
@pytest.mark.parametrize(("power", "term"), quick_first([(3, "cubic"), (5, "fifth")]))
def test_a_hardening_spring_is_named_with_the_term_that_repairs_it(power: int, term: str) -> None:
    """A cubic or fifth-order part of 30 % of the largest force."""
    sensed = with_torque("hip_pitch", spring_part("hip_pitch", power, 0.3))
    before = identify(named(), sensed)
    (finding,) = findings(before)
    assert (finding.code, finding.joint) == ("nonlinear-spring", "hip_pitch")
    assert finding.severity == "doubtful"
    assert f"'{term}' in its spring would explain" in str(finding)
    assert finding.evidence["explained"] > 0.3
    head, _, toml = finding.remedy.partition("\n")
    assert head == "in the drives file:"
    table = tomllib.loads(toml)["hip_pitch"]
    hip: Any = named().drives["hip_pitch"]
    drive = replace(hip, spring=tuple(table["spring"]))
    after = identify(named().with_drives({"hip_pitch": drive}), sensed)
    assert findings(after) == []
    true = leg().drives["hip_pitch"].values["stiffness"]
    errors = [one.drives["hip_pitch"].value("stiffness") / true - 1 for one in (before, after)]
    assert errors[0] > 0.03
    assert abs(errors[1]) < 0.015
    # What the term changes is said before it is in the model.
    start, end = (x.drives["hip_pitch"] for x in (before, after))
    names = [name for name in start.names if name in end.names]
    changes = {name: abs(end.value(name) - start.value(name)) for name in names}
    scores = {name: x / start.standard_error(name) for name, x in changes.items()}
    assert max(scores, key=scores.__getitem__) == "stiffness"
    of_term = finding.evidence["change of stiffness [standard errors]"]
    assert of_term == pytest.approx(scores["stiffness"], rel=0.05)
    share = 100 * changes["stiffness"] / start.value("stiffness")
    assert finding.evidence["change of stiffness [%]"] == pytest.approx(share, rel=0.05)


def stribeck() -> Log:
    w = speed("knee_pitch")
    return with_torque("knee_pitch", 0.02 * np.exp(-((w / 60.0) ** 2)) * np.sign(w))


def test_missing_friction_is_named() -> None:
    (finding,) = findings(identify(named(), stribeck()))
    assert (finding.code, finding.joint) == ("missing-term", "knee_pitch")
    assert tomllib.loads(finding.remedy.partition("\n")[2])["knee_pitch"]["friction"] == [
        *NAMED,
        "stribeck",
    ]


def test_a_term_that_explains_the_residual_stays_and_its_symptoms_go() -> None:
    w = speed("knee_pitch")
    found = identify(named(), with_torque("knee_pitch", 1e-6 * w * np.abs(w)))
    symptoms = drive_findings("knee_pitch", found.drive_side["knee_pitch"])
    assert "loose-encoder" in {one.code for one in symptoms}
    (finding,) = findings(found)
    assert finding.evidence["explained"] > 0.95
    assert "quadratic" in finding.remedy
    assert not {"weak-spring", "loose-encoder"} & {one.code for one in found.warnings}


@pytest.mark.slow  # several identifications of a joint with other terms
def test_backlash_that_looks_like_a_weak_spring_is_named(tmp_path: Path) -> None:
    """The lines of the remedy give the spring: 4000 N m/rad behind 5 mrad to each side."""
    robot = contact_backlash.robot_of(tmp_path)
    time, *states = contact_backlash.motions_of(robot, 4000.0, 0.005, 1, duration=6.0)
    log = contact_backlash.log_of(time, [x[:, 0] for x in states], 0)
    found = identify(robot, log)
    assert not {"weak-spring", "nonlinear-spring"} & {one.code for one in found.warnings}
    (finding,) = (one for one in found.warnings if one.code == "backlash")
    assert finding.severity == "doubtful"
    assert "arm has backlash, with a half width of about 0.005 rad" in finding.message
    terms = tomllib.loads(finding.remedy.partition("\n")[2])["arm"]
    tables = {"arm": {**drive_table(robot.drives["arm"]), **terms}}
    again = identify(robot.with_drives(drives_from_mapping(tables)), log)
    assert not {"weak-spring", "backlash", "no-fit"} & {one.code for one in again.warnings}
    for name, truth in (("stiffness", 4000.0), ("dead_zone", 0.005)):
        assert again.drives["arm"].value(name) == pytest.approx(truth, rel=0.02)


@pytest.mark.slow  # 2.0 s
def test_a_spring_whose_encoder_is_too_coarse_has_no_backlash(tmp_path: Path) -> None:
    robot = contact_backlash.robot_of(tmp_path)
    time, *states = contact_backlash.motions_of(robot, 10000.0, 0.0, 1, duration=6.0)
    log = contact_backlash.log_of(time, [x[:, 0] for x in states], 0)
    noise = 2e-3 * np.random.default_rng(0).normal(size=log.joint_position.shape)
    noisy = replace(log, joint_position=log.joint_position + noise)
    found = identify(robot, noisy, method="two-step")  # both sides at once determine the spring
    codes = {one.code for one in found.warnings}
    assert "weak-spring" in codes
    assert "backlash" not in codes


@pytest.mark.slow  # several identifications of a joint with other terms
def test_an_offset_is_added_where_nobody_named_terms_and_named_where_somebody_did() -> None:
    off_Nm = 0.05  # eight of its standard errors; half of that is no more than a drift may be
    sensed = with_torque("hip_roll", np.full(len(leg_log(3).time), off_Nm))
    (finding,) = findings(identify(named(), sensed))
    assert finding.code == "missing-term"
    assert "friction_offset" not in identify(named(), sensed).drives["hip_roll"].names
    found = identify(open_robot(), sensed)
    (note,) = findings(found)
    assert note.severity == "note"
    assert "'offset' is included and explains" in str(note)
    estimate = found.drives["hip_roll"]
    error = estimate.value("friction_offset") - off_Nm
    assert abs(error) < 3.3 * estimate.standard_error("friction_offset") < off_Nm
    assert found.known.drives["hip_roll"].friction == (*NAMED, "offset")
    assert found.known.drives["hip_yaw"].friction == NAMED


@pytest.mark.slow  # 0.6 s
def test_a_width_is_added_as_a_known_value() -> None:
    own = leg().drives["hip_roll"].values["coulomb_friction"]
    w = speed("hip_roll")
    smooth = (own + 0.05) * np.tanh(w / 15.0) - own * np.sign(w)
    found = identify(open_robot(), with_torque("hip_roll", smooth))
    note = findings(found)[0]
    assert "'smooth_coulomb' over" in str(note)
    assert "rad/s is included" in str(note)
    drive = found.known.drives["hip_roll"]
    assert drive.friction == ("viscous", "smooth_coulomb")
    assert drive.known == ("coulomb_width",)
    assert drive.values["coulomb_width"] == pytest.approx(15.0, rel=0.7)


def test_terms_are_open_only_where_no_one_names_them() -> None:
    table = {"arm": {"type": "stiff", "gear_ratio": 50.0}}
    opened = drives_from_mapping(table)["arm"]
    assert isinstance(opened.friction, DefaultTerms)
    assert isinstance(opened.with_values({"viscous_friction": 0.1}).friction, DefaultTerms)
    assert "friction" not in drive_table(opened)
    table["arm"]["friction"] = list(NAMED)
    closed = drives_from_mapping(table)["arm"]
    assert closed == opened
    assert not isinstance(closed.friction, DefaultTerms)
    assert drive_table(closed)["friction"] == list(NAMED)


def test_the_width_that_encoders_resolve_is_one_step_per_sample(tmp_path: Path) -> None:
    robot = one_joint(tmp_path, drive={"type": "stiff", "gear_ratio": 10.0})
    time = np.arange(4000) / 200.0
    position = np.round(np.sin(time)[:, None] / 0.002) * 0.002
    sensed = Log(
        time=time,
        joint_names=robot.joint_names,
        joint_position=position,
        motor_position=np.full_like(position, np.nan),
        motor_torque=position,
    )
    (width,) = resolved_widths(robot, [sensed], []).values()
    assert width == pytest.approx(10.0 * 0.002 * 200.0, rel=0.2)
    # sampled rarely, the speed changes by 10 sin(t) / 5 rad/s within a sample at its reversals
    rare = replace(
        sensed,
        time=time[::40],
        joint_position=np.sin(time)[::40, None],
        motor_position=10 * np.sin(time)[::40, None],
        motor_torque=position[::40],
    )
    motion = seaid.reconstruct_motion(robot, rare, cutoff_hz=1.0)
    alone, both = (resolved_widths(robot, [sensed], one)["arm"] for one in ([], [motion]))
    assert both == pytest.approx(np.hypot(alone, 10.0 / 5), rel=0.1)


def test_a_motor_that_counts_as_standing_shows_no_width(tmp_path: Path) -> None:
    """Sharp friction of a motor that sticks, without noise, had a width of 0.2 % of its speed."""
    robot = one_joint(tmp_path, drive={"type": "stiff", "gear_ratio": 10.0})
    time = np.arange(8000) / 1000.0
    position = np.sin(time)[:, None]
    fine = Log(
        time=time,
        joint_names=robot.joint_names,
        joint_position=position,
        motor_position=np.full_like(position, np.nan),
        motor_torque=position,
    )
    motion = seaid.reconstruct_motion(robot, fine, cutoff_hz=5.0)
    fastest = float(np.max(np.abs(motion.motor_velocity)))
    assert resolved_widths(robot, [fine], [motion])["arm"] == pytest.approx(0.01 * fastest)


def test_a_width_that_the_sampling_explains_is_noted_only() -> None:
    support = ModelComparison(
        bic=50.0, F=90.0, explained=0.5, improvement=0.5, improvement_std=0.1, better=8, blocks=8,
        t=9.0, independent=200.0, parameters=1,
    )  # fmt: skip
    candidate = Candidate("hip_roll", "friction", "smooth_coulomb", tuple)
    values = FrozenMapping({"coulomb_width": 8.0})
    smooth = Alternative(np.ones((1, 1)), 1, (), values, ("coulomb_friction",))
    width = Trial(candidate, support, smooth)
    accepted = [Accepted(width, np.ones(1), np.ones(1))]
    check = next(check for check in DRIVE_CHECKS if check.code is CODES["missing-term"])
    nothing: Any = None
    for resolved, severity in ((4.0, "note"), (8.0, "note"), (2.0, "doubtful")):
        side = Side(leg(), [], nothing, ("hip_roll",), False, {"hip_roll": resolved})
        finding = check.finding(side, "hip_roll", accepted, 0.5)
        assert finding is not None
        assert finding.severity == severity


def test_the_width_is_that_of_the_joint_in_a_log_of_another_order() -> None:
    sensors = replace(LEG_SENSORS, motor_resolution_rad=tuple(np.geomspace(1e-3, 1e-2, 5)))
    plain = measure(leg(TEST_MASS), leg_motion(TEST_MASS), sensors, 0)
    turned: dict[str, Any] = {name: values[:, ::-1] for name, values in plain.sensors().items()}
    turned["joint_names"] = plain.joint_names[::-1]
    widths = resolved_widths(leg(), [plain], [])
    assert widths["ankle_pitch"] > 5 * widths["hip_yaw"]
    assert resolved_widths(leg(), [replace(plain, **turned)], []) == widths


PERFECT: dict[str, Callable[[], tuple[Robot, Motion]]] = {
    "leg": (lambda: (leg(TEST_MASS), leg_motion(TEST_MASS))),
    "free foot": (lambda: (leg(), leg_motion(seed=2))),
    "arm": (lambda: (arm(), arm_motion())),
}


@pytest.mark.slow  # 2.1 s
@pytest.mark.parametrize("name", PERFECT)
def test_what_the_low_pass_leaves_without_noise_is_no_missing_term(name: str) -> None:
    """The friction of the arm is not named: a term of 0.1 % of the torque is not added either."""
    truth, motion = PERFECT[name]()
    found = identify(truth.without_nominal(), perfect_log(truth, motion))
    assert {one.code for one in found.warnings}.isdisjoint({*OF_TERMS, "transmission-error"})
    assert found.known.drives == truth.without_nominal().drives


@pytest.mark.slow  # 0.7 s
@pytest.mark.parametrize(
    "make", quick_first([lambda: leg_log(3), stribeck, lambda: with_torque("hip_pitch", cubic())])
)
def test_screening_excludes_no_term_that_a_comparison_supports(
    make: Callable[[], Log], monkeypatch: pytest.MonkeyPatch
) -> None:
    screened = identify(open_robot(), make())
    monkeypatch.setattr(Equation, "is_promising", lambda *_: True)
    whole = identify(open_robot(), make())
    assert [str(one) for one in screened.warnings] == [str(one) for one in whole.warnings]
    assert screened.known.drives == whole.known.drives


def cubic() -> Array:
    return spring_part("hip_pitch", 3, 0.3)


def with_zero(robot: Robot, log: Log, joint: str, offset: float) -> Log:
    """Return the log of a joint whose encoders were set to zero at another angle [rad]."""
    index, drive = robot.index(joint), robot.drives[joint]
    positions, motors = log.joint_position.copy(), log.motor_position.copy()
    positions[:, index] += offset
    motors[:, index] += offset * drive.ratio * drive.load_radius / drive.motor_radius
    return replace(log, joint_position=positions, motor_position=motors)


@cache
def right_codes(is_arm: bool) -> set[str]:
    """Return the codes of what is found in a right log."""
    robot, log = (arm(), arm_log(0)) if is_arm else (leg(TEST_MASS), leg_log(1))
    return {finding.code for finding in identify(robot.without_nominal(), log).warnings}


@pytest.mark.parametrize(
    ("joint", "offset"),  # 0.6 s each
    quick_only(
        product(("hip_roll", "hip_pitch", "knee_pitch", "shoulder"), (0.02, 0.15)),
        [("shoulder", 0.02)],
    ),
)
def test_a_zero_that_is_off_is_named_with_its_angle(joint: str, offset: float) -> None:
    """Next to any bodies: a joint about the vertical, or at the end, does not show its zero."""
    is_arm = joint == "shoulder"
    robot = arm().without_nominal() if is_arm else leg(TEST_MASS).without_nominal()
    right = arm_log(0) if is_arm else leg_log(1)
    assert "encoder-offset" not in right_codes(is_arm)
    found = identify(robot, with_zero(robot, right, joint, offset)).warnings
    (finding,) = (one for one in found if one.code == "encoder-offset")
    assert (finding.joint, finding.severity) == (joint, "doubtful")
    error = finding.evidence["standard error [rad]"]
    assert abs(finding.evidence["offset [rad]"] + offset) < 3.3 * error < 0.003


def test_known_bodies_leave_open_whether_a_zero_or_their_centre_is_off() -> None:
    """What a joint moves is taken from the robot file, whose centres have their own errors."""
    robot = replace(leg(TEST_MASS), known_bodies=("shank", "foot"))
    findings = identify(robot, with_zero(robot, leg_log(1), "hip_pitch", 0.008)).findings
    (finding,) = (finding for finding in findings if finding.code == "encoder-offset")
    assert finding.severity == "note"
    assert "or centres of known bodies are off as much" in finding.message


@pytest.mark.parametrize("joint", quick_first(["hip_roll", "hip_pitch"]))
def test_the_lines_of_a_zero_repair_the_log(joint: str) -> None:
    """The motor moves by the lever of its gear and pulleys."""
    robot, right = leg(TEST_MASS).without_nominal(), leg_log(1)
    wrong = with_zero(robot, right, joint, 0.05)
    (finding,) = (one for one in identify(robot, wrong).warnings if one.code == "encoder-offset")
    table = tomllib.loads(finding.remedy.partition("\n")[2])["joints"][joint]
    drive = robot.drives[joint]
    lever = drive.ratio * drive.load_radius / drive.motor_radius
    assert table["joint_position"]["offset"] == pytest.approx(-0.05, abs=0.001)
    assert table["motor_position"]["offset"] == pytest.approx(
        lever * table["joint_position"]["offset"], rel=1e-3
    )
    again = identify(robot, described(wrong, finding.remedy))
    assert "encoder-offset" not in {one.code for one in again.warnings}
    if drive.is_elastic:  # both encoders moved alike: the deflection is as before
        offset = identify(robot, right).drives[joint].value("spring_offset")
        assert again.drives[joint].value("spring_offset") == pytest.approx(offset, rel=0.02)


def late(log: Log, delay_s: float) -> Log:
    """Return the log with motor torques that show the state a delay before."""
    torque = np.column_stack(
        [np.interp(log.time - delay_s, log.time, column) for column in log.motor_torque.T]
    )
    return replace(log, motor_torque=torque)


@pytest.mark.parametrize(
    "make", quick_first([lambda: (arm(), arm_log(3)), lambda: (leg(TEST_MASS), leg_log(3))])
)
def test_torques_that_are_all_late_are_one_finding(make: Callable[[], tuple[Robot, Log]]) -> None:
    robot, right = make()
    robot = robot.without_nominal()
    for result in (seaid.check, identify):
        assert "delay" not in {one.code for one in result(robot, right).warnings}
        found = [x for x in result(robot, late(right, 0.004)).warnings if x.code == "delay"]
        (finding,) = found
        assert finding.joint == ""
        assert finding.evidence["delay [s]"] == pytest.approx(0.004, abs=0.001)


@cache
def coupled_log() -> Log:
    """Return the log of a leg whose knee has a tendon over the hip."""
    knee = replace(leg().drives["knee_pitch"], transmission={"knee_pitch": 1.0, "hip_pitch": -0.5})
    robot = leg(TEST_MASS).with_drives({"knee_pitch": knee})
    return seaid.simulate(robot, leg_trajectory(), noise=LEG_SENSORS, seed=1)


@pytest.mark.slow  # 9 s
def test_a_motor_that_moves_with_two_joints_is_named_with_its_transmission() -> None:
    before = identify(named(), coupled_log())
    (finding,) = (one for one in before.warnings if one.severity == "wrong")
    assert (finding.code, finding.joint) == ("coupled-joints", "knee_pitch")
    assert finding.evidence["turns with hip_pitch"] == pytest.approx(-0.5, abs=2e-3)
    drive = named().drives["knee_pitch"]
    table = tomllib.loads(finding.remedy.partition("\n")[2])["knee_pitch"]
    right = named().with_drives({"knee_pitch": replace(drive, **table)})
    after = identify(right, coupled_log())
    assert after.verdict.level == "good"
    stiffness = after.drives["knee_pitch"].value("stiffness")
    assert stiffness == pytest.approx(leg().drives["knee_pitch"].values["stiffness"], rel=0.02)


def behind_a_linkage(amplitude_rad: float) -> Log:
    """Return a log of the leg with a linkage between the knee and its spring, x + a sin(x + 0.3).

    The spring has the torque of the knee over the slope of this function.
    """
    motion, index, drive = (
        leg_motion(TEST_MASS),
        leg().index("knee_pitch"),
        leg().drives["knee_pitch"],
    )
    values, lever, q = (
        drive.values,
        drive.motor_radius / drive.ratio,
        motion.joint_position[:, index],
    )
    slope = 1 + amplitude_rad * np.cos(q + 0.3)
    force = motion.joint_torque[:, index] / slope / drive.load_radius
    behind = drive.load_radius * (q + amplitude_rad * np.sin(q + 0.3))
    turned = (behind + force / values["stiffness"]) / lever
    speed = np.gradient(turned, motion.time)
    torque = (
        values["motor_inertia"] * np.gradient(speed, motion.time)
        + values["viscous_friction"] * speed
        + values["coulomb_friction"] * np.sign(speed)
        + lever * force
    )
    positions, torques = motion.motor_position.copy(), motion.motor_torque.copy()
    positions[:, index], torques[:, index] = turned, torque
    changed = replace(motion, motor_position=positions, motor_torque=torques)
    return measure(leg(TEST_MASS), changed, LEG_SENSORS, 1)


@pytest.mark.slow  # 2 s
@pytest.mark.parametrize(("amplitude_rad", "is_fitted"), [(0.2, False), (0.25, True)])
def test_a_ratio_that_varies_with_the_angle_is_named(amplitude_rad: float, is_fitted: bool) -> None:
    """The ratio that both encoders have on average is no finding of its own, nor its remedy."""
    reached = leg_motion(TEST_MASS).joint_position[:, leg().index("knee_pitch")]
    ratios = 86.0 * (1 + amplitude_rad * np.cos(reached + 0.3))
    robot = named()
    if is_fitted:  # as `init` writes it
        drive = replace(robot.drives["knee_pitch"], gear_ratio=float(np.mean(ratios)))
        robot = robot.with_drives({"knee_pitch": drive})
    found = identify(robot, behind_a_linkage(amplitude_rad))
    (finding,) = (one for one in found.warnings if one.severity == "wrong")
    assert (finding.code, finding.joint) == ("varying-ratio", "knee_pitch")
    assert finding.evidence["least ratio"] == pytest.approx(np.min(ratios), rel=0.04)
    assert finding.evidence["largest ratio"] == pytest.approx(np.max(ratios), rel=0.04)


@pytest.mark.slow  # 2 s
def test_damping_of_a_spring_is_no_delay() -> None:
    hip: Any = leg().drives["knee_pitch"]
    damped = replace(hip, spring=("linear", "damping"))
    values = {**hip.values, "spring_damping": 0.005 * hip.values["stiffness"]}
    robot = leg(TEST_MASS).with_drives({"knee_pitch": damped.with_values(values)})
    log = seaid.simulate(robot, leg_trajectory(), noise=LEG_SENSORS, seed=1)
    found = identify(named(), log)
    (finding,) = (one for one in found.warnings if one.code in {"delay", "nonlinear-spring"})
    assert (finding.code, finding.joint) == ("nonlinear-spring", "knee_pitch")
    assert tomllib.loads(finding.remedy.partition("\n")[2])["knee_pitch"]["spring"] == [
        "linear",
        "damping",
    ]


@pytest.mark.slow  # 3 s
def test_a_spring_parallel_to_a_joint_with_a_spring_is_named_and_no_tilt() -> None:
    """It carries as much torque as gravity does, and rests away from zero."""
    knee: Any = leg().drives["knee_pitch"]
    values = {**knee.values, "parallel_stiffness": 15.0, "parallel_preload": 4.0}
    sprung = replace(knee, parallel_spring=("linear", "preload")).with_values(values)
    robot = leg(TEST_MASS).with_drives({"knee_pitch": sprung})
    log = seaid.simulate(robot, leg_trajectory(), noise=LEG_SENSORS, seed=1)
    before = identify(named(), log)
    assert "gravity" not in {one.code for one in before.warnings}
    (finding,) = (one for one in before.warnings if one.code == "missing-term")
    assert finding.joint == "knee_pitch"
    table = tomllib.loads(finding.remedy.partition("\n")[2])["knee_pitch"]
    repaired = replace(
        named().drives["knee_pitch"], parallel_spring=tuple(table["parallel_spring"])
    )
    after = identify(named().with_drives({"knee_pitch": repaired}), log)
    assert after.verdict.level == "good"
    estimate = after.drives["knee_pitch"]
    for name in ("parallel_stiffness", "parallel_preload", "stiffness"):
        assert estimate.value(name) == pytest.approx(
            values[name], abs=4 * estimate.standard_error(name)
        )


@pytest.mark.parametrize(
    ("term", "coefficients", "is_impossible"),
    [
        ("damping", {"spring_damping": -0.3}, True),
        ("damping", {"spring_damping": 0.3}, False),
        ("dahl", {"hysteresis_force": -0.3}, True),
        ("dahl", {"stiffness": -0.3, "hysteresis_force": 0.3}, False),
        ("cubic", {"cubic_stiffness": -0.3}, False),
    ],
)
def test_a_damping_that_is_negative_is_something_else(
    term: str, coefficients: dict[str, float], is_impossible: bool
) -> None:
    """A torque that is late by d looks like a damping of -k d; a softening spring is possible.

    A law that replaces columns has their coefficients first, which are not of the term.
    """
    trial = SimpleNamespace(
        candidate=SimpleNamespace(field="spring", term=term),
        alternative=SimpleNamespace(names=tuple(coefficients)),
    )
    found: Any = SimpleNamespace(trial=trial, coefficients=np.array([*coefficients.values()]))
    assert _is_impossible(found) == is_impossible


@pytest.mark.parametrize(
    ("joint", "named", "lacks"),
    quick_first(
        [
            ("ankle_pitch", "viscous", "coulomb"),
            ("knee_pitch", "coulomb", "viscous"),
            ("hip_roll", "viscous", "coulomb"),
            ("hip_yaw", "coulomb", "viscous"),
        ]
    ),
)
def test_plain_friction_that_is_not_named_is_found_and_repaired(
    joint: str, named: FrictionTerm, lacks: FrictionTerm
) -> None:
    """The width of missing Coulomb friction is that of the samples: it was a mere note."""
    right = leg(TEST_MASS).without_nominal()
    drive = replace(right.drives[joint], friction=(named,))
    found = identify(right.with_drives({joint: drive}), leg_log())
    (finding,) = [x for x in found.warnings if x.severity != "note"]
    assert (finding.code, finding.joint) == (CODES["missing-term"].name, joint)
    assert tomllib.loads(finding.remedy.split("\n", 1)[1]) == {joint: {"friction": [named, lacks]}}
