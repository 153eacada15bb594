"""Terms that the rows of an identification support: named, and added where nobody named any."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import seaid
from scripts.benchmarks import contact_backlash
from seaid._arrays import Array, FrozenMapping
from seaid.checks import CODES, gears
from seaid.checks.columns import DRIVE_CHECKS, Side
from seaid.checks.engine import Accepted, Alternative, Candidate, Equation, ModelComparison, Trial
from seaid.checks.experiment import moved
from seaid.checks.values import drive_findings
from seaid.drives import drive_table
from seaid.drives.drives import DefaultTerms
from seaid.drives.toml import drives_from_mapping
from seaid.errors import Finding, by_severity
from seaid.identification import Identification, identify
from seaid.identification.checking import resolved_widths
from seaid.log import Log
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure, simulate_motion
from tests.experiments import (
    ARM_SENSORS,
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
    true_geared_arm,
    wiggle,
)
from tests.mistakes import (
    CASES,
    Planted,
    check_planted,
    lines_of,
    of_joint,
    repaired,
    with_channels,
    with_torque,
)
from tests.one_joint import BODY, one_joint
from tests.plants import log_with, write_robot
from tests.representatives import quick_first, quick_only

OF_TERMS = ("missing-term", "nonlinear-spring")
NAMED: tuple[str, ...] = ("viscous", "coulomb")


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


def stribeck(level: float = 0.02) -> Log:
    w = speed("knee_pitch")
    return with_torque("knee_pitch", level * np.exp(-((w / 60.0) ** 2)) * np.sign(w))


def test_friction_that_falls_towards_standstill_is_not_that_of_stribeck() -> None:
    """It is rounded Coulomb friction, of which a Stribeck force would be negative."""
    found = seaid.identify(named(), stribeck(-0.01))
    assert not any("stribeck_speed" in finding.evidence for finding in findings(found))


def with_knee(robot: Robot | None = None, joint: str = "knee_pitch", **changed: Any) -> Robot:
    """Return a leg, with named terms by default, whose drive of a joint has other fields."""
    robot = robot or named()
    return robot.with_drives({joint: replace(robot.drives[joint], **changed)})


def simulated(
    values: Mapping[str, float],
    joint: str = "knee_pitch",
    warm_up_K: float = 0.0,
    **changed: Any,
) -> tuple[Robot, Log]:
    """Return the leg with named terms, and a log of one whose joint has other terms with values.

    Its motors warm up from 20 degC by `warm_up_K` within the log.
    """
    true = with_knee(leg(TEST_MASS), joint, **changed)
    drive, trajectory = true.drives[joint], leg_trajectory()
    true = true.with_drives({joint: drive.with_values({**drive.values, **values})})
    warms = [20.0, 20.0 + warm_up_K]
    log = seaid.simulate(true, trajectory, noise=LEG_SENSORS, seed=1, temperature_degC=warms)
    return named(), log


def hardening(power: int) -> tuple[Robot, Log]:
    """Return the leg with named terms, and a log of a spring with 30 % of the force by a power."""
    return named(), with_torque("hip_pitch", spring_part("hip_pitch", power, 0.3))


def with_one_term(joint: str, term: str) -> tuple[Robot, Log]:
    """Return the leg with only one of the plain friction terms of a joint, and its log."""
    return with_knee(leg(TEST_MASS).without_nominal(), joint, friction=(term,)), leg_log()


def backlash(stiffness: float, half_width_rad: float, noise_rad: float) -> tuple[Robot, Log]:
    """Return an arm with a spring behind backlash, and its log."""
    with TemporaryDirectory() as folder:
        robot = contact_backlash.robot_of(Path(folder))
    time, *states = contact_backlash.motions_of(robot, stiffness, half_width_rad, 1, duration=6.0)
    log = contact_backlash.log_of(time, [x[:, 0] for x in states], 0)
    noise = noise_rad * np.random.default_rng(0).normal(size=log.joint_position.shape)
    return robot, replace(log, joint_position=log.joint_position + noise)


def near(rel: float, **values: float) -> dict[str, Any]:
    """Return values that others have to be near to."""
    return {name: pytest.approx(value, rel=rel) for name, value in values.items()}


def stiffness(joint: str) -> float:
    """Return the true stiffness of a spring of the leg."""
    return leg().drives[joint].values["stiffness"]


HIP = near(0.015, stiffness=stiffness("hip_pitch"))
KNEE = near(0.02, stiffness=stiffness("knee_pitch"))
PARALLEL = {"parallel_stiffness": 15.0, "parallel_preload": 4.0}

DAMPING = {"spring_damping": 0.005 * stiffness("knee_pitch")}

PLAIN: tuple[tuple[str, str, str], ...] = (
    ("ankle_pitch", "viscous", "coulomb"),
    ("knee_pitch", "coulomb", "viscous"),
    ("hip_roll", "viscous", "coulomb"),
    ("hip_yaw", "coulomb", "viscous"),
)
"""Joints, the term of plain friction that is named, and the one that is not."""

PLANTED: dict[str, Planted] = {
    "Stribeck friction": Planted(
        lambda: (named(), stribeck()),
        ("missing-term", "doubtful", "knee_pitch"),
        lines={"friction": [*NAMED, "stribeck"]},
        values=near(0.05, stribeck_friction=0.02),
    ),
    # it was not looked for at joints without a spring
    "friction under load": Planted(
        partial(simulated, {"load_friction": 0.3}, "hip_roll", friction=(*NAMED, "load")),
        ("missing-term", "doubtful", "hip_roll"),
        lines={"friction": [*NAMED, "load"]},
        values=near(0.05, load_friction=0.3),
    ),
    # nor was this, whose friction was up to 17 % off
    "friction by temperature": Planted(
        lambda: simulated(
            {"coulomb_temperature_slope": -1e-4},
            warm_up_K=20.0,
            friction=(*NAMED, "coulomb_temperature"),
        ),
        ("missing-term", "doubtful", "knee_pitch"),
        lines={"friction": [*NAMED, "coulomb_temperature"]},
        values=near(0.5, coulomb_temperature_slope=-1e-4),
    ),
    # the width of missing Coulomb friction is that of the samples: it was a mere note
    **{
        f"no {lacks} friction of the {joint}": Planted(
            partial(with_one_term, joint, term),
            ("missing-term", "doubtful", joint),
            lines={"friction": [term, lacks]},
        )
        for joint, term, lacks in PLAIN
    },
    **{
        f"{name} spring": Planted(
            partial(hardening, power),
            ("nonlinear-spring", "doubtful", "hip_pitch"),
            lines={"spring": ["linear", name]},
            values=HIP,
        )
        for name, power in (("cubic", 3), ("fifth", 5))
    },
    # viscous friction there is also that of a late encoder
    "friction behind the spring": Planted(
        partial(simulated, {"joint_coulomb_friction": 1.0}, joint_friction=("coulomb",)),
        ("missing-term", "doubtful", "knee_pitch"),
        lines={"joint_friction": ["coulomb"]},
        values=near(0.1, joint_coulomb_friction=1.0) | KNEE,
    ),
    # it looks like a torque that is late
    "damped spring": Planted(
        partial(simulated, DAMPING, spring=("linear", "damping")),
        ("nonlinear-spring", "doubtful", "knee_pitch"),
        lines={"spring": ["linear", "damping"]},
        values=KNEE,
        beside=("drift",),
    ),
    # it carries as much torque as gravity does, and rests away from zero
    "parallel spring": Planted(
        partial(simulated, PARALLEL, parallel_spring=("linear", "preload")),
        ("missing-term", "wrong", "knee_pitch"),
        lines={"parallel_spring": ["linear", "preload"]},
        values=near(0.02, **PARALLEL) | KNEE,
    ),
    # it looks like a weak spring
    "backlash": Planted(
        partial(backlash, 4000.0, 0.005, 0.0),
        ("backlash", "doubtful", "arm"),
        lines={"spring": ["linear", "dead_zone"]},
        values={
            "stiffness": pytest.approx(4000.0, rel=0.02),
            "dead_zone": pytest.approx(0.005, rel=0.02),
        },
    ),
}


@pytest.mark.parametrize("name", quick_only(PLANTED, [*PLANTED][:1]))
def test_what_a_model_lacks_is_named_and_its_lines_repair_it(name: str) -> None:
    check_planted(PLANTED[name])


@pytest.mark.slow  # 2.0 s
def test_a_spring_whose_encoder_is_too_coarse_has_no_backlash() -> None:
    robot, log = backlash(10000.0, 0.0, 2e-3)
    found = identify(robot, log, method="two-step")  # both sides at once determine the spring
    codes = {one.code for one in found.warnings}
    assert "weak-spring" in codes
    assert "backlash" not in codes


RIGHT: dict[str, Callable[[], tuple[Robot, Log]]] = {
    "leg": lambda: (leg(TEST_MASS), perfect_log(leg(TEST_MASS), leg_motion(TEST_MASS))),
    "free foot": lambda: (leg(), perfect_log(leg(), leg_motion(seed=2))),
    "arm": lambda: (arm(), perfect_log(arm(), arm_motion())),
    "leg by its sensors": lambda: (named(), leg_log(0)),
    "leg by its sensors again": lambda: (named(), leg_log(1)),
    "leg with open terms": lambda: (open_robot(), leg_log(0)),
    "arm by its sensors": lambda: (arm(), arm_log(0)),
}


@pytest.mark.slow  # 0.5 s each
@pytest.mark.parametrize("name", RIGHT)
def test_a_right_log_lacks_no_term(name: str) -> None:
    """Nor what the low pass leaves without noise: 0.1 % of the torque is not added either."""
    truth, log = RIGHT[name]()
    found = identify(truth.without_nominal(), log)
    assert {one.code for one in found.warnings}.isdisjoint({*OF_TERMS, "transmission-error"})
    assert found.known.drives == truth.without_nominal().drives


@pytest.mark.slow  # 0.9 s
def test_what_a_term_changes_is_reported_before_it_is_in_the_model() -> None:
    """The change of the estimate that it changes most, in per cent and in standard errors."""
    finding, *fits = check_planted(PLANTED["cubic spring"])
    start, end = (fit.drives["hip_pitch"] for fit in fits)
    names = [name for name in start.names if name in end.names]
    changes = {str(name): abs(end.value(name) - start.value(name)) for name in names}
    scores = {name: x / start.standard_error(name) for name, x in changes.items()}
    assert max(scores, key=scores.__getitem__) == "stiffness"
    of_term = finding.evidence["change of stiffness [standard errors]"]
    assert of_term == pytest.approx(scores["stiffness"], rel=0.05)
    share = 100 * changes["stiffness"] / start.value("stiffness")
    assert share > 3
    assert finding.evidence["change of stiffness [%]"] == pytest.approx(share, rel=0.05)


def test_a_term_that_explains_the_residual_stays_and_its_symptoms_go() -> None:
    w = speed("knee_pitch")
    found = identify(named(), with_torque("knee_pitch", 1e-6 * w * np.abs(w)))
    symptoms = drive_findings("knee_pitch", found.drive_side["knee_pitch"], None)
    assert "loose-encoder" in {one.code for one in symptoms}
    (finding,) = findings(found)
    assert finding.evidence["explained"] > 0.95
    assert "quadratic" in finding.remedy
    assert not {"weak-spring", "loose-encoder"} & {one.code for one in found.warnings}


def test_an_offset_is_added_where_nobody_named_terms_and_named_where_somebody_did() -> None:
    off_Nm = 0.05  # eight of its standard errors; half of that is no more than a drift may be
    sensed = with_torque("hip_roll", np.full(len(leg_log(3).time), off_Nm))
    before = identify(named(), sensed)
    assert [finding.code for finding in findings(before)] == ["missing-term"]
    assert "friction_offset" not in before.drives["hip_roll"].names
    found = identify(open_robot(), sensed)
    (note,) = findings(found)
    assert note.severity == "note"
    assert "'offset' is included and explains" in str(note)
    estimate = found.drives["hip_roll"]
    error = estimate.value("friction_offset") - off_Nm
    assert abs(error) < 3.3 * estimate.standard_error("friction_offset") < off_Nm
    assert found.known.drives["hip_roll"].friction == (*NAMED, "offset")
    assert found.known.drives["hip_yaw"].friction == NAMED


def test_terms_are_open_only_where_no_one_names_them() -> None:
    table = {"type": "stiff", "gear_ratio": 50.0}
    opened, closed = (
        drives_from_mapping({"arm": {**table, **named}})["arm"]
        for named in ({}, {"friction": list(NAMED)})
    )
    assert closed == opened
    for drive, is_open in ((opened, True), (closed, False)):
        valued = drive.with_values({"viscous_friction": 0.1})
        assert isinstance(valued.friction, DefaultTerms) == is_open
        assert ("friction" not in drive_table(drive)) == is_open


def log_of(robot: Robot, time: Array, position: Array, motor: Array | None = None) -> Log:
    """Return a log of one joint by its positions (T,), which are its torques too."""
    joint = position[:, None]
    return Log(
        time=time,
        joint_names=robot.joint_names,
        joint_position=joint,
        motor_position=np.full_like(joint, np.nan) if motor is None else motor[:, None],
        motor_torque=joint,
    )


def test_the_width_that_encoders_resolve_is_one_step_per_sample(tmp_path: Path) -> None:
    robot = one_joint(tmp_path, drive={"type": "stiff", "gear_ratio": 10.0})
    time = np.arange(4000) / 200.0
    sensed = log_of(robot, time, np.round(np.sin(time) / 0.002) * 0.002)
    (width,) = resolved_widths(robot, [sensed], []).values()
    assert width == pytest.approx(10.0 * 0.002 * 200.0, rel=0.2)
    # sampled rarely, the speed changes by 10 sin(t) / 5 rad/s within a sample at its reversals
    rare = log_of(robot, time[::40], np.sin(time)[::40], 10 * np.sin(time)[::40])
    motion = seaid.reconstruct_motion(robot, rare, cutoff_hz=1.0)
    alone, both = (resolved_widths(robot, [sensed], x)["arm"] for x in ([], [motion]))
    assert both == pytest.approx(np.hypot(alone, 10.0 / 5), rel=0.1)
    # sharp friction of a motor that sticks, without noise, had a width of 0.2 % of its speed
    fine = log_of(robot, time, np.sin(time))
    motion = seaid.reconstruct_motion(robot, fine, cutoff_hz=5.0)
    standing = 0.01 * np.max(np.abs(motion.motor_velocity))
    assert resolved_widths(robot, [fine], [motion])["arm"] == pytest.approx(standing)


@pytest.mark.parametrize(
    ("joint", "offset"),  # 0.6 s each
    quick_only(
        product(("hip_roll", "hip_pitch", "knee_pitch", "shoulder"), (0.02, 0.15)),
        [("shoulder", 0.02)],
    ),
)
def test_a_zero_that_is_off_is_named_with_its_angle_and_repaired(joint: str, offset: float) -> None:
    """Next to any bodies: a joint about the vertical, or at the end, does not show its zero.

    The motor moves by the lever of its gear and pulleys.
    """
    is_arm = joint == "shoulder"
    robot = arm().without_nominal() if is_arm else leg(TEST_MASS).without_nominal()
    wrong = with_zero(robot, arm_log(0) if is_arm else leg_log(1), joint, offset)
    found = identify(robot, wrong).warnings
    (finding,) = (x for x in found if x.code == "encoder-offset")
    assert (finding.joint, finding.severity) == (joint, "doubtful")
    error = finding.evidence["standard error [rad]"]
    assert abs(finding.evidence["offset [rad]"] + offset) < 3.3 * error < 0.003
    lines, drive = lines_of(finding, joint), robot.drives[joint]
    lever = drive.ratio * drive.load_radius / drive.motor_radius
    assert lines["joint_position"]["offset"] == pytest.approx(-offset, abs=0.003)
    of_motor = lever * lines["joint_position"]["offset"]
    assert lines["motor_position"]["offset"] == pytest.approx(of_motor, rel=1e-3)
    after = identify(*repaired(robot, wrong, finding.remedy))
    assert "encoder-offset" not in {x.code for x in after.warnings}


@pytest.mark.parametrize(
    ("case", "delay_s"),  # 0.8 s each
    quick_only(product(CASES, (0.004, 0.02, -0.01)), [("arm", -0.01)]),
)
def test_torques_that_are_all_late_are_one_finding(case: str, delay_s: float) -> None:
    robot, right = CASES[case][0](), CASES[case][1](3)
    torque = [
        np.interp(right.time - delay_s, right.time, column) for column in right.motor_torque.T
    ]
    late = replace(right, motor_torque=np.transpose(torque))
    for result, known in ((seaid.check, robot), (identify, robot.without_nominal())):
        assert "delay" not in {x.code for x in result(known, right).warnings}
        found = result(known, late).warnings
        # a torque that is late by d looks like a damping of -k d, which no spring has
        assert delay_s < 0 or "nonlinear-spring" not in {x.code for x in found}
        (finding,) = (x for x in found if x.code == "delay")
        # but for one case some friction is by half too large or too small
        severity = "doubtful" if (case, delay_s) == ("leg", 0.004) else "wrong"
        assert (finding.severity, finding.joint) == (severity, "")
        error = finding.evidence["standard error [s]"]
        assert abs(finding.evidence["delay [s]"] - delay_s) < max(3 * error, 5e-4)
        assert finding.remedy.count("delay_s = ") == robot.n


LATE = [
    ("leg", "knee_pitch", "joint_position", 0.03, 0.004),  # its motor has less friction than none
    ("arm", "telescope", "motor_torque", 0.01, 0.006),  # looks like an early position
    ("leg", "knee_pitch", "motor_position", 0.004, 0.001),  # friction, of the load a negative one
    ("arm", "shoulder", "motor_position", 0.004, 0.001),
    ("leg", "knee_pitch", "joint_position", -0.01, 0.004),  # a negative damping
]
"""Channels that are late by some seconds, and a bound of three standard errors."""


@pytest.mark.parametrize(("case", "joint", "channel", "delay_s", "bound_s"), quick_first(LATE, 4))
def test_a_channel_that_is_late_is_named_and_not_as_friction_or_damping(
    case: str, joint: str, channel: str, delay_s: float, bound_s: float
) -> None:
    robot, log = CASES[case][0](), CASES[case][1]()
    late = with_channels(
        log, joint, **{channel: lambda x: np.interp(log.time - delay_s, log.time, x)}
    )
    found = identify(robot.without_nominal(), late).warnings
    (finding,) = (x for x in found if x.code in ("delay", "nonlinear-spring"))
    assert (finding.code, finding.joint) == ("delay", joint)
    error, value = (finding.evidence[x] for x in ("standard error [s]", "delay [s]"))
    if channel == "motor_position":  # the position of its joint is early by as much
        assert [x for x in found if x.severity != "note"] == [finding]
        value = -value
    else:
        assert f"{channel} = {{ column = " in finding.remedy
    assert abs(value - delay_s) < 3 * error < bound_s


@pytest.mark.parametrize("delay_s", [0.004, 0.001])
def test_the_load_of_a_single_spring_shows_an_encoder_that_is_late(
    tmp_path: Path, delay_s: float
) -> None:
    """Its motor shows as much damping, next to less viscous friction.

    The torques of such a robot are all those of springs, whose errors explained whatever it lacks.
    """
    values = {"stiffness_Nm_per_rad": 200.0, "viscous_friction_Nms_per_rad": 4e-4}
    values |= {"coulomb_friction_Nm": 0.01, "motor_inertia_kg_m2": 1e-5, "gear_ratio": 50.0}
    robot = one_joint(tmp_path, drive={"type": "series_elastic", **values})
    noise = Noise(motor_resolution_rad=1e-4, joint_resolution_rad=1e-5, torque_std_Nm=1e-3)
    log = seaid.simulate(robot, wiggle(robot, 8.0, (0.0,), (2.0,)), noise=noise, seed=0)
    right = identify(robot.without_nominal(), log).warnings
    assert all(finding.severity == "note" for finding in right)
    late = {"joint_position": lambda x: np.interp(log.time - delay_s, log.time, x)}
    found = identify(robot.without_nominal(), with_channels(log, "arm", **late)).warnings
    (finding,) = (x for x in found if x.severity != "note")
    assert finding.code == "delay"
    error = finding.evidence["standard error [s]"]
    assert abs(finding.evidence["delay [s]"] - delay_s) < 3 * error < 0.2 * delay_s
    assert "joint_position = {" in finding.remedy


def test_damping_is_named_where_it_may_be_a_late_encoder_next_to_friction() -> None:
    true, delay_s = with_knee(leg(TEST_MASS)), 0.01
    knee = true.drives["knee_pitch"]
    viscous = 5 * knee.values["viscous_friction"]
    damped = knee.with_values({**knee.values, "viscous_friction": viscous})
    robot = true.with_drives({"knee_pitch": damped})
    log = seaid.simulate(robot, leg_trajectory(), noise=LEG_SENSORS, seed=1)
    wrong = with_channels(
        log, "knee_pitch", joint_position=lambda x: np.interp(log.time - delay_s, log.time, x)
    )
    found = identify(leg(TEST_MASS).without_nominal(), wrong).warnings
    (finding,) = (x for x in found if x.code in ("delay", "nonlinear-spring"))
    assert (finding.code, finding.joint) == ("nonlinear-spring", "knee_pitch")
    assert "late against that of its motor" in " ".join(CODES[finding.code].cause.split())


def test_laws_of_a_spring_that_is_loaded_on_one_side_are_rivals(tmp_path: Path) -> None:
    """The log shows that the spring hardens, and not by which power: each has its own stiffness."""
    body = '<inertial><origin xyz="0.28 0 0"/><mass value="1.8"/>'
    body += '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial>'
    joints = {"arm": 'revolute base link <axis xyz="0 1 0"/>'}
    drive = {"type": "series_elastic", "gear_ratio": 60.0, "stiffness_Nm_per_rad": 180.0}
    drive |= {"viscous_friction_Nms_per_rad": 1.5e-4, "coulomb_friction_Nm": 0.012}
    drive |= {"motor_inertia_kg_m2": 2e-5}
    law = {"spring": ["linear", "fifth"], "fifth_stiffness_Nm_per_rad5": 3.2e7}
    path = write_robot(tmp_path / "arm.urdf", joints, {"link": body})
    robot, true = (seaid.load_robot(path, {"arm": drive | x}) for x in ({}, law))
    noise = Noise(motor_resolution_rad=3e-3, joint_resolution_rad=5e-5, torque_std_Nm=4e-3)
    log = seaid.simulate(true, wiggle(robot, 8.0, (0.0,), (0.8,)), noise=noise, seed=0)
    found = identify(robot.without_nominal(), log).warnings
    (finding,) = (x for x in found if x.severity != "note")
    assert (finding.code, finding.joint) == ("nonlinear-spring", "arm")
    assert "'fifth' in its spring" in finding.message
    assert "'cubic' in its spring" in finding.message
    assert "load its spring slowly" in finding.remedy
    assert "spring = [" not in finding.remedy


@pytest.mark.parametrize(("torque", "rotor"), quick_only([(2, 1), (0.5, 1), (1, 2)], [(2, 1)]))
def test_a_known_rotor_is_the_scale_of_the_torque_at_a_spring(torque: float, rotor: float) -> None:
    """Which of the two is wrong no log decides: both are named, and no line is printed."""
    joint = "knee_pitch"
    inertia = rotor * leg().drives[joint].values["motor_inertia"]
    robot = with_knee(leg(TEST_MASS), motor_inertia_kg_m2=inertia).without_nominal()
    found = identify(robot, of_joint(leg_log(3), leg().index(joint), motor_torque=torque))
    (finding,) = (x for x in found.warnings if x.code == "rotor-inertia")
    assert (finding.severity, finding.joint) == ("doubtful", joint)
    times = finding.evidence["factor"]
    assert abs(times - torque / rotor) < 3 * finding.evidence["standard error"] < 0.3
    assert "by its constant" in finding.message
    assert "motor_inertia_kg_m2 = " not in finding.remedy


@pytest.mark.parametrize(("resolved", "severity"), [(4.0, "note"), (2.0, "doubtful")])
def test_a_width_that_the_sampling_explains_is_noted_only(resolved: float, severity: str) -> None:
    tests = {"bic": 50.0, "F": 90.0, "t": 9.0, "independent": 200.0, "parameters": 1}
    blocks = {"improvement": 0.5, "improvement_std": 0.1, "better": 8, "blocks": 8}
    support = ModelComparison(explained=0.5, **tests, **blocks)  # type: ignore[arg-type]
    values = FrozenMapping({"coulomb_width": 8.0})
    smooth = Alternative(np.ones((1, 1)), 1, (), values, ("coulomb_friction",))
    width = Trial(Candidate("hip_roll", "friction", "smooth_coulomb", ()), support, smooth)
    accepted = [Accepted(width, np.ones(1), np.ones(1))]
    check = next(check for check in DRIVE_CHECKS if check.code is CODES["missing-term"])
    nothing: Any = None
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


@pytest.mark.slow  # 0.7 s
def test_screening_excludes_no_term_that_is_supported(monkeypatch: pytest.MonkeyPatch) -> None:
    logs = (leg_log(3), stribeck(), hardening(3)[1])
    screened = [identify(open_robot(), log) for log in logs]
    monkeypatch.setattr(Equation, "is_promising", lambda *_: True)
    for before, log in zip(screened, logs, strict=True):
        whole = identify(open_robot(), log)
        assert [str(one) for one in before.warnings] == [str(one) for one in whole.warnings]
        assert before.known.drives == whole.known.drives


def with_zero(robot: Robot, log: Log, joint: str, offset: float) -> Log:
    """Return the log of a joint whose encoders were set to zero at another angle [rad]."""
    drive = robot.drives[joint]
    of_motor = offset * drive.ratio * drive.load_radius / drive.motor_radius
    moved = {"joint_position": lambda q: q + offset, "motor_position": lambda q: q + of_motor}
    return with_channels(log, joint, **moved)


def test_a_zero_next_to_dry_friction_that_stops_the_joint_is_found(tmp_path: Path) -> None:
    """Where a motor stands its friction is unknown: rows there weigh less, with their bodies."""
    body = BODY.replace("<mass", '<origin xyz="0 0.3 0"/><mass')
    path = write_robot(tmp_path / "arm.urdf", {"arm": "revolute base body"}, body)
    drive = {"type": "stiff", "gear_ratio": 10.0, "friction": ["viscous", "coulomb"]}
    robot = seaid.load_robot(path, {"arm": drive})
    time = np.arange(6000) / 200.0
    turn = 2 * np.pi * np.array([0.31, 0.83])[:, None] * time
    amplitude, rate = np.array([[0.5], [0.35]]), 2 * np.pi * np.array([[0.31], [0.83]])
    states = [
        np.sum(amplitude * rate**k * f, axis=0)[:, None]
        for k, f in enumerate((np.sin(turn), np.cos(turn), -np.sin(turn)))
    ]
    torque = seaid.regressor.joint_torques(robot, *states) / 10 + 0.08 * np.sign(states[1])
    joint, rng = states[0], np.random.default_rng(0)
    log = Log(
        time=time,
        joint_names=robot.joint_names,
        joint_position=joint - 0.08,
        motor_position=np.full_like(joint, np.nan),
        motor_torque=torque + 0.002 * rng.normal(size=joint.shape),
    )
    known = replace(robot, known_bodies=("body",))
    (finding,) = (x for x in identify(known, log).findings if x.code == "encoder-offset")
    assert finding.evidence["offset [rad]"] == pytest.approx(0.08, abs=0.002)


def test_known_bodies_leave_open_whether_a_zero_or_their_centre_is_off() -> None:
    """What a joint moves is taken from the robot file, whose centres have their own errors."""
    robot = replace(leg(TEST_MASS), known_bodies=("shank", "foot"))
    findings = identify(robot, with_zero(robot, leg_log(1), "hip_pitch", 0.008)).findings
    (finding,) = (finding for finding in findings if finding.code == "encoder-offset")
    assert finding.severity == "note"
    assert "or centres of known bodies are off as much" in finding.message


@pytest.mark.parametrize("factor", [1.0, 1.3])
def test_a_known_body_with_another_mass_is_named(factor: float) -> None:
    robot = leg(TEST_MASS)
    bodies = robot.parameters.reshape(-1, 10).copy()
    bodies[robot.body_names.index("shank")] *= factor
    known = replace(robot.with_values(bodies.ravel(), robot.drives), known_bodies=("shank", "foot"))
    named = [x for x in identify(known, leg_log(3)).warnings if x.code == "nominal-values"]
    assert [(x.joint, x.severity) for x in named] == [("knee_pitch", "doubtful")] * (factor > 1)
    for finding in named:
        error = finding.evidence["standard error"]
        assert finding.evidence["factor"] == pytest.approx(1 / 1.3, abs=3 * error)
        assert error < 0.02


def test_logs_of_two_set_ups_are_named_and_conditions_repair_it() -> None:
    loaded, bare = leg_log(1), measure(leg(), leg_motion(), LEG_SENSORS, 2)
    found = identify(named(), [loaded, loaded.between(0.0, 3.0), bare])
    (finding,) = (x for x in found.warnings if x.code == "logs-differ")
    assert (finding.joint, found.verdict.level) == ("", "do not use")
    assert "log 3 and the others" in finding.message
    assert "foot" in finding.message.partition(";")[2]
    assert finding.evidence["explained"] > 0.9
    together = seaid.identify_conditions(
        {"loaded": (named(), [loaded]), "bare": (leg().without_nominal(), [bare])}
    )
    levels = [x.verdict.level for x in together.identifications.values()]
    assert "do not use" not in levels


FRICTION = ("viscous_friction", "coulomb_friction")
MOVES: dict[str, tuple[tuple[float, ...], tuple[float, ...], Noise]] = {
    "leg": ((0.0, 0.0, -0.2, 0.7, 0.0), (0.8, 0.6, 0.7, 0.7, 1.1), LEG_SENSORS),
    "arm": ((0.0, 0.3, 0.15, 0.0), (0.4, 0.8, 0.2, 0.9), ARM_SENSORS),
    "ur10": ((0.0, -1.2, 1.0, 0.0, 0.5, 0.0), (0.8,) * 6, Noise(torque_std_Nm=0.05)),
}
"""{robot: middle and reach of its motions, and its sensors}."""


def with_friction(name: str, seed: int, *factors: float) -> tuple[Robot, list[Log]]:
    """Return a robot, and logs of other motions in which its friction has these factors."""
    robot = leg(TEST_MASS) if name == "leg" else arm() if name == "arm" else true_geared_arm()
    middle, reach, sensors = MOVES[name]
    logs = []
    for place, factor in enumerate(factors):
        drives = {}
        for joint, drive in robot.drives.items():
            known = {name: drive.values[name] for name in FRICTION if name in drive.values}
            drives[joint] = drive.with_values({x: factor * y for x, y in known.items()})
        true = robot.with_drives(drives)
        motion = simulate_motion(true, wiggle(robot, 6.0, middle, reach, seed=10 * seed + place))
        logs.append(measure(true, motion, sensors, 7 * seed + place))
    return robot.without_nominal(), logs


@pytest.mark.slow  # 3 s each: three logs of each of three robots
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", MOVES)
def test_logs_of_other_motions_and_temperatures_are_of_one_set_up(name: str, seed: int) -> None:
    """Friction that is 25 % above and 15 % below that of the first log is named as friction."""
    assert doubts(with_friction(name, seed, 1.0, 1.0, 1.0)) == []
    found = doubts(with_friction(name, seed, 1.0, 1.25, 0.85))
    assert causes(found) == {"logs-differ"}
    assert all("viscous_friction" in x.remedy for x in found if x.code == "logs-differ")


def causes(found: list[Finding]) -> set[str]:
    """Return the codes of findings without those of symptoms, such as a drift."""
    return {x.code for x in found if CODES[x.code].kind != "symptom"}


def doubts(experiment: tuple[Robot, list[Log]]) -> list[Finding]:
    """Return what is above a note in the result of logs."""
    return [finding for finding in identify(*experiment).warnings if finding.severity != "note"]


@pytest.mark.parametrize(  # 2 s each
    ("name", "seed"), quick_only(product(MOVES, range(2)), [("arm", 0)])
)
def test_a_cold_and_a_warm_log_are_named_by_their_friction_and_repaired(
    name: str, seed: int
) -> None:
    """They looked like a torque that is early and like sensors that drift."""
    robot, logs = with_friction(name, seed, 1.0, 1.5)
    found = doubts((robot, logs))
    assert causes(found) == {"logs-differ"}
    named = next(x for x in found if x.code == "logs-differ")
    specific = named.remedy.split('"')[1::2]
    assert {"viscous_friction", "spring_offset"} <= {*specific} <= {*FRICTION, "spring_offset"}
    conditions = {f"log {k}": (robot, [log]) for k, log in enumerate(logs)}
    together = seaid.identify_conditions(conditions, condition_specific=specific)
    assert {x.verdict.level for x in together.identifications.values()} == {"good"}


@pytest.mark.parametrize("std", quick_first([0.1, 0.0]))
def test_an_error_of_known_bodies_is_no_constant_error_of_a_torque(std: float) -> None:
    """It was 80 % of the torque that known bodies leave; next to all of it, it is little."""
    robot = leg(TEST_MASS)
    bodies = robot.parameters.reshape(-1, 10).copy()
    for place in (
        3,
        4,
    ):  # the centres of the shank and the foot are 1 cm off
        bodies[place] += 0.01 * moved(bodies[place, 0], bodies[place, 1:4])[:, 2]
    robot = robot.with_values(bodies.ravel(), robot.drives)
    robot = replace(robot, known_bodies=("shank", "foot"))
    found = identify(robot, leg_log(3), cutoff_hz=4.0, known_std={"bodies": std} if std else {})
    offsets = [x.severity for x in found.warnings if x.code == "torque-offset"]
    assert offsets == ([] if std else ["note"])


@pytest.mark.parametrize(
    ("angle", "error", "is_named"),
    [
        (0.2, 0.01, True),
        (2.6, 0.3, False),
        (0.3, 0.12, False),
        (-0.2, 0.01, False),
        (0.6, 0.01, False),
    ],
)
def test_a_zero_that_the_torque_does_not_determine_is_no_finding(
    angle: float, error: float, is_named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a light load with play 150 +- 17 degrees were a zero, 9 standard errors from none.

    An angle alone of another sign or size than next to those of other joints is their echo: one
    joint's zero of 3.4 degrees made one of 63 degrees at the next.
    """
    monkeypatch.setattr(gears, "_searched_zero", lambda *_: (angle, error))
    side: Any = SimpleNamespace(robot=leg(), offset_std=0.0, sources={})
    accepted: Any = [SimpleNamespace(coefficients=np.array([0.25]), errors=np.array([0.1]))]
    finding = gears.zero_is_off(side, "knee_pitch", accepted, 0.5)
    assert (finding is not None) == is_named


def limited(folder: Path, limit: float) -> tuple[Robot, Log, Array]:
    """Return a body on a motor with a limit, the log of its torque, and what its controller asks.

    The body has an inertia of 1 kg m^2, viscous friction and no weight.
    """
    robot = one_joint(folder, drive={"type": "stiff", "gear_ratio": 1.0, "friction": ["viscous"]})
    rate_hz, steps, viscous = 200, 20, 0.3
    time = np.arange(0, 20, 1 / rate_hz)
    goals = np.sum(np.sin(np.arange(1, 4)[:, None] * 1.1 * time + 1.0), axis=0)
    state, rows = np.zeros(2), []
    for goal in goals:
        asked = 12 * (goal - state[0]) - 3 * state[1]
        torque = float(np.clip(asked, -limit, limit))
        rows.append((state[0], torque, asked))
        for _ in range(steps):
            speed = state[1] + (torque - viscous * state[1]) / (rate_hz * steps)
            state = np.array([state[0] + speed / (rate_hz * steps), speed])
    # A torque that is held from one sample to the next acts half a sample later.
    angle, torque, asked = np.array(rows).T
    acts, asked = ((x + np.append(x[:1], x[:-1])) / 2 for x in (torque, asked))
    return robot, log_with("arm", time, joint_position=angle, motor_torque=acts), asked


def worst_saturation(result: Identification) -> Finding:
    """Return the worst finding of torques at a limit."""
    return by_severity(x for x in result.findings if x.code == "saturation")[0]


def test_the_limit_of_a_motor_is_none_of_its_log(tmp_path: Path) -> None:
    """Such a log was refused."""
    robot, log, _ = limited(tmp_path, 4.0)
    result = seaid.identify(robot, log)
    assert (worst_saturation(result).severity, result.verdict.level) == ("note", "good")


def test_a_log_that_ends_at_the_range_of_its_sensor_shows_what_the_motor_gave(
    tmp_path: Path,
) -> None:
    robot, log, _ = limited(tmp_path, 4.0)
    torque, end = log.motor_torque, 2.8
    of_sensor = replace(log, motor_torque=np.clip(torque, -end, end))
    worst = worst_saturation(seaid.identify(robot, of_sensor))
    beyond = float(np.mean(np.abs(torque[np.abs(torque) >= end]) - end))
    error = worst.evidence["standard error"]
    assert worst.severity == "wrong"
    assert worst.evidence["beyond the limit"] == pytest.approx(beyond, abs=3 * error)


def test_a_command_that_an_amplifier_limits_shows_the_limit(tmp_path: Path) -> None:
    """It was a weak spring, or a misfit without a cause."""
    robot, log, asked = limited(tmp_path, 10.0)
    worst = worst_saturation(seaid.identify(robot, replace(log, motor_torque=asked[:, None])))
    assert worst.severity != "note"
    assert worst.evidence["limit"] == pytest.approx(10.0, rel=0.2)
