"""The robot file is a prior: rough files are no mistake, and rivals are named together."""

import ast
import inspect
import math
import re
import tomllib
import weakref
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import seaid
from scripts.benchmarks.parts_of_logs import parts_of
from scripts.golden_measured import measured_table
from seaid._arrays import Array
from seaid.checks.bodies import _with_length, file_findings
from seaid.checks.codes import CODES
from seaid.checks.engine import Check
from seaid.checks.experiment import SHORTLIST, Experiment, Transform, best_value, multiplied
from seaid.checks.gears import linkages, small_springs
from seaid.checks.instants import _FIELDS_OF, Instants
from seaid.checks.setup import (
    MISTAKES,
    _all_torque_scales,
    log_findings,
    mistakes,
    setup_findings,
    transforms,
)
from seaid.drives import total_ratio
from seaid.errors import Finding
from seaid.legged import load_robot
from seaid.log import Log, low_pass
from seaid.log.motion import reconstruct_motions
from seaid.regressor import joint_torques
from seaid.robot import Payload, Robot
from tests.experiments import (
    MODELS,
    TEST_MASS,
    arm,
    arm_log,
    geared_arm_log,
    leg,
    leg_log,
    true_geared_arm,
    with_drive,
)
from tests.mistakes import CASES as SPRUNG
from tests.mistakes import lines_of, of_joint, with_channels
from tests.plants import body, log_with, write_robot
from tests.representatives import quick_first, quick_only
from tests.robot import test_transmission as transmissions


def the_mistake(robot: Robot, log: Log) -> Finding:
    """Return the only mistake above a note that a log shows."""
    findings, _ = mistakes(experiment(robot, log))
    assert not any("could not be made" in x.message for x in findings)
    (finding,) = (x for x in findings if x.severity != "note")
    return finding


CASES = SPRUNG | {"ur10": (lambda: load_robot("ur10", snap_tolerance_rad=0), geared_arm_log)}


def experiment(robot: Robot, log: Log) -> Experiment:
    return Experiment.of(robot, [reconstruct_motions(robot, log)])


def rough(robot: Robot, seed: int, common: float = 1.0) -> Robot:
    """Return a robot whose file is as rough as public ones: masses, centres and inertias."""
    rng, bodies = np.random.default_rng(seed), robot.parameters.reshape(-1, 10).copy()
    for place, values in enumerate(bodies):
        inertia = pin.Inertia.FromDynamicParameters(values)
        factor = common * np.exp(rng.normal(0, 0.3)) * (2.0 if place == len(bodies) - 1 else 1.0)
        size = max(0.02, 0.2 * float(np.linalg.norm(inertia.lever)))
        centre = inertia.lever + rng.normal(0, size, 3)
        about = factor * np.exp(rng.normal(0, 0.3)) * inertia.inertia
        bodies[place] = pin.Inertia(factor * inertia.mass, centre, about).toDynamicParameters()
    return robot.with_values(bodies.ravel(), robot.drives)


@pytest.mark.parametrize("case", quick_only(CASES, ["leg", "arm"]))
@pytest.mark.parametrize(("seed", "common"), quick_first([(0, 1.0), (1, 0.6), (2, 1.6)]))
def test_a_rough_robot_file_is_no_mistake(case: str, seed: int, common: float) -> None:
    robot, log = CASES[case][0](), CASES[case][1]()
    findings, _ = mistakes(experiment(rough(robot, seed, common), log))
    assert [finding for finding in findings if finding.severity != "note"] == []


@pytest.mark.parametrize("side", quick_first(["motor", "joint"]))
@pytest.mark.parametrize("what", ["gear-ratio", "unit", "torque-scale"])
def test_a_ratio_an_encoder_and_a_torque_that_are_off_are_told_apart(what: str, side: str) -> None:
    """Next to a rough robot file: each changes positions, torques and rotors in its own way."""
    truth, log, factor = true_geared_arm(), geared_arm_log(), 1.3
    elbow, name = 2, "elbow_joint"
    robot, of_elbow = rough(truth, 0), np.where(np.arange(6) == elbow, factor, 1.0)
    if what == "gear-ratio":
        drive = truth.drives[name]
        robot = robot.with_drives({name: replace(drive, gear_ratio=factor * drive.ratio)})
    positions = log.joint_position * (of_elbow if what == "unit" else 1.0)
    torques = log.motor_torque * (of_elbow if what == "torque-scale" else 1.0)
    log = replace(log, joint_position=positions, motor_torque=torques)
    if side == "motor":
        log = replace(log, motor_position=positions, joint_position=log.motor_position)
    finding = the_mistake(robot, log)
    assert (finding.code, finding.joint) == (what, name)
    source = lines_of(finding, name)
    if what == "gear-ratio":
        assert source["gear_ratio"] == pytest.approx(1.0, abs=0.05)
        assert abs(source["gear_ratio"] - 1.0) < 3 * source["gear_ratio_std"] < 0.2
    else:
        assert (f"[{name}]\ntorque_scale_std = " in finding.remedy) == (what == "torque-scale")
        quantity = "motor_torque" if what == "torque-scale" else f"{side}_position"
        assert source[quantity]["scale"] == pytest.approx(1 / factor, abs=0.04)


@pytest.mark.parametrize(
    ("case", "factor"), quick_first([("arm", 1.25), ("leg", 0.9), ("arm", 0.9), ("ur10", 1.25)])
)
def test_a_clock_of_another_rate_is_no_length_and_no_drift(case: str, factor: float) -> None:
    robot, log = rough(CASES[case][0](), 0), CASES[case][1]()
    finding = the_mistake(robot, replace(log, time=factor * log.time))
    assert (finding.code, finding.severity) == ("time-unit", "wrong")
    error = finding.evidence["standard error"]
    assert abs(finding.evidence["factor"] - factor) < 3 * error < 0.2


@pytest.mark.parametrize("case", ["leg", "arm"])
def test_a_clock_in_another_unit_needs_no_nominal_bodies(case: str) -> None:
    robot, log = CASES[case][0]().without_nominal(), CASES[case][1]()
    finding = the_mistake(robot, replace(log, time=0.1 * log.time))
    assert (finding.code, finding.evidence["factor"]) == ("time-unit", 0.1)


SLIDE = (
    '<robot name="lift"><link name="base"/><link name="cart"><inertial><origin xyz="0 0 0.1"/>'
    '<mass value="3"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
    '</link><joint name="lift" type="prismatic"><parent link="base"/><child link="cart"/>'
    '<axis xyz="0 0 1"/><limit lower="-0.1" upper="0.1" velocity="1" effort="200"/></joint></robot>'
)
SCREW = 2 * np.pi / 0.016
"""Turns of a motor [rad/m] before a screw with a lead of 16 mm."""


def lift(folder: Path, drive: Mapping[str, float | str]) -> tuple[Robot, Log]:
    """Return a joint that slides up and down behind a screw, and its log without noise.

    A stiff one has no encoder of its joint.
    """
    (folder / "lift.urdf").write_text(SLIDE)
    given = {"motor_inertia_kg_m2": 8e-6, **drive}
    robot = load_robot(folder / "lift.urdf", {"lift": given})
    time = np.arange(6000) / 500
    rates = [(0.03, 1.7), (0.025, 4.1), (0.015, 7.3)]
    q = np.sum([a * np.sin(w * time) for a, w in rates], axis=0)
    acceleration = np.sum([-a * w**2 * np.sin(w * time) for a, w in rates], axis=0)
    force = 3.0 * (acceleration + 9.81)
    deflection = force / 5e4 if "pulley" in str(drive) else 0.0 * q
    motor = SCREW * (q + deflection)
    speed, rotor = np.gradient(motor, time), np.gradient(np.gradient(motor, time), time)
    friction = 9e-5 * speed + 0.011 * np.sign(speed)
    torque = force / SCREW + 8e-6 * rotor + friction
    columns = {"motor_position": motor, "motor_torque": torque}
    if "pulley" in str(drive):
        columns["joint_position"] = q
    return robot, log_with("lift", time, **columns)


SPRUNG_LIFT: dict[str, float | str] = {
    "type": "series_elastic",
    "gear_ratio": 1.0,
    "motor_pulley_radius_m": 1 / SCREW,
}


@pytest.mark.parametrize("factor", [10.0, 0.1, 1000.0, 1e-3, 100.0, 1 / 0.0254])
def test_an_encoder_of_a_slide_in_another_unit_is_no_clock_and_no_steps(
    tmp_path: Path, factor: float
) -> None:
    robot, log = lift(tmp_path, SPRUNG_LIFT)
    finding = the_mistake(robot, replace(log, joint_position=factor * log.joint_position))
    assert (finding.code, finding.severity, finding.joint) == ("unit", "wrong", "lift")
    scale = lines_of(finding, "lift")["joint_position"]["scale"]
    assert scale == pytest.approx(1 / factor, rel=1e-6)


@pytest.mark.parametrize(("side", "factor"), [("motor", 180 / np.pi), ("joint", 1000.0)])
def test_an_only_encoder_of_a_slide_in_another_unit_has_its_scale(
    tmp_path: Path, side: str, factor: float
) -> None:
    """Nothing but a single mass of any size contradicts it: here it is among what is tried."""
    robot, log = lift(tmp_path, {"type": "stiff", "gear_ratio_rad_per_m": SCREW})
    positions = factor * log.motor_position / (1.0 if side == "motor" else SCREW)
    log = replace(log, motor_position=np.full_like(positions, np.nan))
    columns: dict[str, Any] = {f"{side}_position": positions}
    given = experiment(robot, replace(log, **columns))
    units = [x for x in transforms(given, MISTAKES, []) if x.finding.code == "unit"]
    scales = {float(x.changed.nominal[0]): x.sources["lift"] for x in units if x.channels == "qm"}
    assert min(scales) < 1e-3 < 0.5 < given.nominal[0]
    (source,) = scales[min(scales)].values()
    assert source["scale"] == pytest.approx(1 / factor, rel=1e-6)  # type: ignore[index]


@pytest.mark.parametrize("side", ["motor", "joint"])
@pytest.mark.parametrize("joints", quick_first([range(6), [2]]))
def test_an_only_encoder_at_the_other_side_of_the_gear_is_named(
    side: str, joints: Iterable[int]
) -> None:
    """It was said to be a clock that is ten times too slow."""
    robot, log, ratio = true_geared_arm(), geared_arm_log(), 80.0
    drives = {
        joint: replace(
            drive,
            gear_ratio=ratio,
            motor_inertia_kg_m2=(drive.motor_inertia_kg_m2 or 0.0) / ratio**2,
        )
        for joint, drive in robot.drives.items()
    }
    robot = robot.with_drives(drives)
    factors = np.where(np.isin(np.arange(robot.n), [*joints]), ratio, 1.0)
    torques = log.motor_torque / ratio
    if side == "joint":
        log = replace(log, joint_position=factors * log.joint_position, motor_torque=torques)
    else:
        positions = ratio * log.joint_position / factors
        nothing = np.full_like(positions, np.nan)
        log = replace(log, motor_position=positions, joint_position=nothing, motor_torque=torques)
    finding = the_mistake(robot, log)
    assert (finding.code, finding.severity) == ("unit", "wrong")
    names = [log.joint_names[j] for j in joints]
    assert (finding.joint, "are the angles of the" in finding.message) == (
        "" if len(names) > 1 else names[0],
        True,
    )
    other = {"motor": "joint", "joint": "motor"}[side]
    assert f'side = "{other}"' in finding.remedy
    scale = lines_of(finding, names[0])[f"{side}_position"]["scale"]
    assert scale == pytest.approx(1 / ratio if side == "joint" else ratio)


def two_links(axis: str, seed: int, folder: Path) -> tuple[Robot, Log]:
    """Return two links behind gears of 50, whose rotors are unknown, and a log of the motors."""
    links, joints = "", ""
    for joint, link, parent, mass, x in (
        ("a", "upper", "base", 4, 0),
        ("b", "fore", "upper", 2, 0.4),
    ):
        moments = 'ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"'
        links += f'<link name="{link}"><inertial><origin xyz="0.2 0 0.02"/><mass value="{mass}"/>'
        links += f"<inertia {moments}/></inertial></link>"
        joints += f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child '
        joints += f'link="{link}"/><origin xyz="{x} 0 0"/><axis xyz="{axis}"/>'
        joints += '<limit lower="-3" upper="3" velocity="10" effort="300"/></joint>'
    path = folder / "two.urdf"
    path.write_text(f'<robot name="two"><link name="base"/>{links}{joints}</robot>')
    drive = {"type": "stiff", "gear_ratio": 50.0, "friction": ["viscous", "coulomb"]}
    robot, rng = load_robot(path, {"a": drive, "b": drive}), np.random.default_rng(seed)
    time, w = np.arange(8000) / 500, rng.uniform(1, 6, (4, 2))
    size, angle = (
        rng.uniform(0.1, 0.35, (4, 2)),
        w * time[:, None, None] + rng.uniform(0, 6, (4, 2)),
    )
    waves = size * np.sin(angle), size * w * np.cos(angle), -size * w**2 * np.sin(angle)
    q, v, a = (np.sum(wave, axis=1) for wave in waves)
    torque = joint_torques(robot, q, v, a) / 50 + 3e-5 * 50 * a + 0.002 * 50 * v + 0.05 * np.sign(v)
    torque += 0.01 * np.std(torque, axis=0) * rng.normal(size=torque.shape)
    return robot, log_with(("a", "b"), time, motor_position=50 * q, motor_torque=torque)


@pytest.mark.parametrize("seed", quick_first([0, 1, 2]))
@pytest.mark.parametrize("factor", [0.5, 2.0, 1.0])
def test_encoders_of_other_counts_at_all_motors_are_no_clock(
    factor: float, seed: int, tmp_path: Path
) -> None:
    robot, log = two_links("0 1 0", seed, tmp_path)
    wrong = replace(log, motor_position=factor * log.motor_position)
    findings = [x for x in mistakes(experiment(robot, wrong))[0] if x.severity != "note"]
    assert [(x.code, x.joint) for x in findings] == [("unit", "")] * (factor != 1)
    for finding in findings:
        scale = lines_of(finding, "b")["motor_position"]["scale"]
        assert scale == pytest.approx(1 / factor, rel=0.03)


@pytest.mark.parametrize("factor", [0.5, 1.0])
def test_counts_are_a_rival_of_bodies_where_nothing_but_inertia_acts(
    factor: float, tmp_path: Path
) -> None:
    """It was "good", next to bodies of twice their mass."""
    robot, log = two_links("0 0 1", 0, tmp_path)
    noise = 0.3 * np.std(log.motor_torque, axis=0) * np.random.default_rng(1).normal(size=(8000, 2))
    wrong = replace(
        log, motor_position=factor * log.motor_position, motor_torque=log.motor_torque + noise
    )
    findings, without = mistakes(experiment(robot, wrong))
    assert [x for x in findings if x.severity != "note"] == []
    named = [*file_findings(without)]
    assert len(named) == (factor != 1)
    for finding in named:
        assert {finding.code, *finding.evidence} >= {"or unit", "or torque-scale"}
        assert "turn a joint by a known angle" in finding.remedy


def resting_arm_log(seed: int) -> Log:
    """Return the log of a stiff arm that goes from pose to pose and rests in each.

    Its dry friction is three times that of `true_geared_arm`, and anything below while it rests.
    """
    robot, rng = true_geared_arm(), np.random.default_rng(seed)
    rate_hz, poses, period_s, move_s = 250, 12, 2.0, 1.2
    steps = rng.uniform(-0.45, 0.45, (poses, robot.n))
    count = round(rate_hz * period_s)
    s = np.clip(np.arange(count) / rate_hz / move_s, 0.0, 1.0)
    shapes = (
        10 * s**3 - 15 * s**4 + 6 * s**5,
        (30 * s**2 - 60 * s**3 + 30 * s**4) / move_s,
        (60 * s - 180 * s**2 + 120 * s**3) / move_s**2,
    )
    q, v, a = (np.concatenate([np.outer(shape, step) for step in steps]) for shape in shapes)
    starts = np.cumsum(np.vstack([[0.0, -1.2, 1.0, 0.0, 0.5, 0.0], steps[:-1]]), axis=0)
    q += np.repeat(starts, count, axis=0)
    drives = robot.drives.values()
    rotor, viscous, dry = (
        np.array([drive.values[name] for drive in drives])
        for name in ("motor_inertia", "viscous_friction", "coulomb_friction")
    )
    at_rest = np.repeat(rng.uniform(-1, 1, (poses, robot.n)), count, axis=0)
    torque = joint_torques(robot, q, v, a) + rotor * a + viscous * v
    torque += 3 * dry * np.where(v == 0, at_rest, np.sign(v)) + 0.05 * rng.normal(size=q.shape)
    positions = q + 1e-5 * rng.normal(size=q.shape)
    time = np.arange(len(q)) / rate_hz
    return log_with(robot.joint_names, time, joint_position=positions, motor_torque=torque)


@pytest.mark.parametrize("factor", quick_first([1.3, 0.75, 1.0]))
@pytest.mark.parametrize("seed", quick_first([0, 1]))
def test_friction_at_rest_hides_no_mistake(factor: float, seed: int) -> None:
    """The torque of an arm that rests is anything: it left a third of all torques unexplained."""
    robot, log, elbow = true_geared_arm(), resting_arm_log(seed), 2
    unknown = {
        joint: replace(drive, motor_inertia_kg_m2=None) for joint, drive in robot.drives.items()
    }
    scaled = log.motor_torque * np.where(np.arange(6) == elbow, factor, 1.0)
    of_arm = experiment(rough(robot, 0).with_drives(unknown), replace(log, motor_torque=scaled))
    assert np.nanmedian(of_arm.nominal) > 0.25
    findings = [x for x in setup_findings(of_arm, []) if x.severity != "note"]
    if factor == 1:
        assert findings == []
        return
    (finding,) = findings
    assert finding.joint == "elbow_joint"
    # with one encoder and an unknown rotor a gear ratio has nearly the same effect
    assert {finding.code, *finding.evidence} & {"torque-scale", "or torque-scale"}


@pytest.mark.parametrize(("case", "joint"), [("leg", "knee_pitch"), ("arm", "shoulder")])
@pytest.mark.parametrize("side", ["motor", "joint"])
@pytest.mark.parametrize("factor", quick_first([2.0, 0.25]))
def test_an_encoder_whose_steps_are_miscounted_is_no_gear_and_no_slip(
    case: str, joint: str, side: str, factor: float
) -> None:
    robot, log = CASES[case][0](), CASES[case][1]()
    factors = np.where(np.isin(log.joint_names, joint), factor, 1.0)
    positions = {f"{side}_position": factors * getattr(log, f"{side}_position")}
    finding = the_mistake(rough(robot, 0), replace(log, **positions))
    assert (finding.code, finding.joint) == ("unit", joint)
    assert lines_of(finding, joint)[f"{side}_position"]["scale"] == 1 / factor


IN_ONE_LOG = {
    "sign": {"motor_torque": -1.0},
    "torque-scale": {"motor_torque": 1.3},
    "unit": {"motor_position": 180 / np.pi, "joint_position": 180 / np.pi},
    "": {},
}
"""{code: factors on the channels of a joint in the second of two logs}."""


@pytest.mark.parametrize(("case", "joint"), [("leg", "knee_pitch"), ("arm", "shoulder")])
@pytest.mark.parametrize("code", quick_first([*IN_ONE_LOG]))
def test_a_mistake_in_one_of_two_logs_is_named_with_its_number(
    case: str, joint: str, code: str
) -> None:
    robot = rough(CASES[case][0](), 0)
    logs = [CASES[case][1](seed) for seed in (1, 2)]
    wrong = of_joint(logs[1], robot.index(joint), **IN_ONE_LOG[code])
    both = Experiment.of(robot, [reconstruct_motions(robot, log) for log in (logs[0], wrong)])
    findings = [x for x in mistakes(both)[0] if x.severity != "note"]
    assert [(x.code, x.joint) for x in findings] == [(code, joint)] * bool(code)
    for finding in findings:
        assert finding.message.startswith("in log 2 ")
        assert "in the description of log 2:" in finding.remedy
        assert "torque_scale_std" not in finding.remedy  # a line of the drives is one of all logs


BODY_OF_TRUNK = f'<link name="trunk">{body(0)}'
OF_DRIVES = {"motor_torque": (-1.0, "sign"), "joint_position": (57.3, "unit"), "": (1.0, "")}


@pytest.mark.parametrize("channel", OF_DRIVES)
def test_a_base_that_moves_hides_no_mistake_of_a_drive_with_a_spring(
    channel: str, tmp_path: Path
) -> None:
    """What acts on the load is unknown there, and the motor equation and both encoders are not."""
    (factor, code), log, joint = OF_DRIVES[channel], leg_log(), "knee_pitch"
    at_joint = np.where(np.isin(log.joint_names, joint), factor, 1.0)
    if channel:
        log = replace(log, **{channel: at_joint * getattr(log, channel)})
    held = experiment(leg(TEST_MASS), log)
    trunk = tmp_path / "leg.urdf"
    text = (MODELS / "tulip_leg.urdf").read_text().replace('<link name="trunk">', BODY_OF_TRUNK)
    trunk.write_text(text)
    floating = load_robot(trunk, MODELS / "tulip_leg.toml", base="floating")
    moving = replace(held, robot=floating)
    findings = [x for x in setup_findings(moving, []) if x.severity != "note"]
    assert [(x.code, x.joint) for x in findings] == [(code, joint)] * bool(code)
    assert np.all(np.isnan([*moving.free, *moving.nominal]))


NEXT_TO_IT = [("leg", "hip_pitch", 1.01), ("arm", "shoulder", 1 / 1.004)]


@pytest.mark.parametrize(("case", "joint", "factor"), NEXT_TO_IT)
def test_a_gear_ratio_next_to_the_true_one_is_named(case: str, joint: str, factor: float) -> None:
    """Gears of 100 and 101 look alike: a spring deflects by less than that is of a turn."""
    robot, log = CASES[case][0](), CASES[case][1]()
    drive = robot.drives[joint]
    wrong = replace(drive, gear_ratio=factor * drive.ratio)
    finding = the_mistake(rough(robot, 0).with_drives({joint: wrong}), log)
    assert (finding.code, finding.joint) == ("gear-ratio", joint)
    ratio, error = (lines_of(finding, joint)[key] for key in ("gear_ratio", "gear_ratio_std"))
    assert ratio == pytest.approx(drive.ratio, rel=0.2 * abs(factor - 1))
    assert abs(ratio - drive.ratio) < 3 * error < abs(factor - 1) * drive.ratio


@pytest.mark.parametrize("ratio", quick_first([100.0, 97.0, 48.0]))
def test_a_torque_that_is_measured_behind_its_gear_is_no_unit_of_torque(ratio: float) -> None:
    """A gear of 100 looks like N cm, and both are named; of another gear the log decides."""
    truth, log, joint = true_geared_arm(), geared_arm_log(), "elbow_joint"
    drive = truth.drives[joint]
    rotor = float(drive.motor_inertia_kg_m2 or 0.0) / ratio**2
    geared = replace(drive, gear_ratio=ratio, motor_inertia_kg_m2=rotor)
    finding = the_mistake(rough(truth, 0).with_drives({joint: geared}), log)
    assert (finding.joint, finding.severity) == (joint, "wrong")
    if ratio == 100:
        assert {finding.code, *finding.evidence} >= {"unit", "or torque-scale"}
        assert finding.certainty == "possible"
        assert "in Ncm" in finding.message
        assert "those of the other side of the gear" in finding.message
        assert "scale" not in finding.remedy
    else:
        assert (finding.code, finding.certainty) == ("torque-scale", "certain")
        scale = lines_of(finding, joint)["motor_torque"]["scale"]
        assert scale == pytest.approx(1 / ratio, rel=1e-6)


@pytest.mark.parametrize("factor", quick_first([1.3, 1.0]))
def test_known_rotors_show_whether_all_torques_or_all_masses_are_off(factor: float) -> None:
    """With masses that are too small by the same factor the bodies of the file show neither."""
    log = geared_arm_log()
    robot = rough(true_geared_arm(), 0, 1 / 1.3 if factor > 1 else 1.3)
    off = replace(log, motor_torque=factor * log.motor_torque)
    if factor == 1:
        assert [x for x in mistakes(experiment(robot, off))[0] if x.severity != "note"] == []
        return
    finding = the_mistake(robot, off)
    assert (finding.code, finding.joint) == ("torque-scale", "")
    assert finding.evidence["factor"] == pytest.approx(factor, rel=0.06)
    # its error is that by the torques; what contradicts the value given is all that the log shows
    assert finding.evidence["standard error"] < 0.05
    assert finding.evidence["standard errors"] > 3
    assert "the error after +- is that by the torques alone" in finding.message


def test_rotor_inertias_that_are_all_in_another_unit_are_no_scale_of_the_torques() -> None:
    """Inertias a tenth of the true ones look like torques that are ten times too large."""
    robot, log = true_geared_arm(), geared_arm_log()
    drives = {
        joint: replace(drive, motor_inertia_kg_m2=0.1 * drive.values["motor_inertia"])
        for joint, drive in robot.drives.items()
    }
    finding = the_mistake(robot.with_drives(drives), log)
    assert (finding.code, finding.severity) == ("rotor-inertia", "wrong")
    tables = tomllib.loads(finding.remedy.partition("in the drives file:\n")[2])
    for joint, table in tables.items():
        inertia = robot.drives[joint].values["motor_inertia"]
        assert table["motor_inertia_kg_m2"] == pytest.approx(inertia, rel=0.1)
    assert tables.keys() == robot.drives.keys()


def test_a_clock_that_is_slightly_off_is_no_other_rotors() -> None:
    robot, log = leg(TEST_MASS), leg_log()
    finding = the_mistake(robot, replace(log, time=1.04 * log.time))
    assert finding.code == "time-unit"
    assert finding.evidence["factor"] == pytest.approx(1.04, abs=0.01)


@pytest.mark.slow  # 1.2 s
def test_a_motor_keeps_its_constant_where_columns_of_currents_are_exchanged() -> None:
    robot, log, (i, j) = leg(TEST_MASS), leg_log(), (3, 4)
    constants = {i: 0.09, j: 0.06}
    torque = log.motor_torque.copy()
    for here, there in ((i, j), (j, i)):
        torque[:, here] = constants[here] / constants[there] * log.motor_torque[:, there]
    exchanged = experiment(robot, replace(log, motor_torque=torque))
    (sources,) = exchanged.sources
    currents = {
        robot.joint_names[k]: {
            **sources[robot.joint_names[k]],
            "motor_torque": {"column": "i", "unit": "A", "torque_constant_Nm_per_A": constant},
        }
        for k, constant in constants.items()
    }
    findings, without = mistakes(exchanged.with_changes(sources=({**sources, **currents},)))
    (finding,) = (x for x in findings if x.severity != "note")
    assert (finding.code, finding.joint) == ("swapped-joints", robot.joint_names[i])
    assert finding.remedy.count("scale = 1.5") == 1
    np.testing.assert_allclose(without.torque, experiment(robot, log).torque, rtol=1e-9)


@pytest.mark.slow  # 1.1 s
def test_a_joint_without_a_torque_hides_no_exchange_of_others() -> None:
    robot, log = leg(TEST_MASS), leg_log()
    torque = log.motor_torque[:, [0, 1, 2, 4, 3]]
    torque[:, 0] = np.nan
    finding = the_mistake(robot, replace(log, motor_torque=torque))
    assert (finding.code, finding.joint) == ("swapped-joints", robot.joint_names[3])


def test_no_more_trials_are_in_memory_than_are_compared() -> None:
    references = list[weakref.ref[Experiment]]()

    def factors(before: Experiment) -> Iterator[Transform]:
        for factor in np.geomspace(0.5, 2.0, 4 * SHORTLIST).tolist():
            of_joint = CODES["unit"], "read-as", before, {0: factor}, "t"
            transform = multiplied(*of_joint, {"unit": f"{factor} N m"})
            references.append(weakref.ref(transform.changed))
            yield transform
            assert "columns" not in vars(transform.changed)
        del transform
        assert sum(reference() is not None for reference in references) <= 2 * SHORTLIST

    mistakes(experiment(arm(), arm_log()), [Check(CODES["unit"], (), factors)])
    assert len(references) >= 4 * SHORTLIST


def large_robot() -> tuple[Robot, Array, Array, Array]:
    """Return Romeo, and the time, positions and torques of a motion of all its joints."""
    robot = load_robot("romeo", snap_tolerance_rad=0)
    rng, time = np.random.default_rng(0), np.arange(0, 4, 0.004)
    rates, phases = rng.uniform(1, 4, robot.n), rng.uniform(0, 6, robot.n)
    angle = rates * time[:, None] + phases
    q, v, a = 0.3 * np.sin(angle), 0.3 * rates * np.cos(angle), -0.3 * rates**2 * np.sin(angle)
    torque = joint_torques(robot, q, v, a)
    return robot, time, q, torque


@pytest.mark.parametrize("exchanged", [(5, 20), (14, 15), (20, 27)])  # no torque of 5, and of 27
def test_exchanged_joints_of_a_large_robot_are_tried(exchanged: tuple[int, int]) -> None:
    robot, time, q, torque = large_robot()
    q[:, exchanged] = q[:, exchanged[::-1]]
    log = log_with(robot.joint_names, time, joint_position=q, joint_torque=torque)
    pairs = {*experiment(robot, log).pairs(range(robot.n))}
    assert exchanged in pairs
    assert len(pairs) < SHORTLIST * robot.n


def test_of_a_long_robot_the_joints_that_its_file_explains_worst_are_doubted() -> None:
    robot, time, q, torque = large_robot()
    torque[:, 14] *= 3
    log = log_with(robot.joint_names, time, joint_position=q, joint_torque=torque)
    doubted = experiment(robot, log).doubted
    assert 14 in doubted
    assert len(doubted) == SHORTLIST < robot.n


def test_an_experiment_is_not_changed_by_nothing() -> None:
    values = list[float]()

    def change(before: Experiment, value: float) -> Experiment:
        values.append(value)
        return before.scaled({0: math.exp(value)}, "t")

    best_value(experiment(arm(), arm_log()), change)
    assert values
    assert 0.0 not in values


@pytest.mark.parametrize("known", [("torque_constant",), ()])
def test_currents_are_compared_as_torques_whatever_their_constants(known: tuple[str, ...]) -> None:
    robot, log, constant = arm(), arm_log(), 0.05
    drives = {
        joint: replace(x, motor_input="current", nominal={"torque_constant": constant}, known=known)
        for joint, x in robot.drives.items()
    }
    sign = np.where(np.array(robot.joint_names) == "shoulder", -1.0, 1.0)
    currents = replace(
        log,
        motor_current=sign * log.motor_torque / constant,
        motor_torque=np.full_like(log.motor_torque, np.nan),
    )
    findings, _ = mistakes(experiment(robot.with_drives(drives), currents))
    signs = [(x.joint, "motor_current" in x.remedy) for x in findings if x.code == "sign"]
    assert signs == [("shoulder", True)]
    given = experiment(robot.with_drives(drives), currents)
    heavier = given.with_changes(bodies=2 * given.bodies)
    assert np.all(heavier.constants[1:3] > given.constants[1:3]) == (not known)
    assert heavier.scales.keys() == (given.scales.keys() if known else set())


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("factor", quick_first([1.25, 0.75]))
def test_a_robot_that_is_heavier_than_its_file_is_said_to_be(case: str, factor: float) -> None:
    robot, log = CASES[case][0](), CASES[case][1]()
    other = robot.with_values(robot.parameters / factor, robot.drives)
    findings, without = mistakes(experiment(other, log))
    assert findings == []
    (finding,) = file_findings(without)
    assert (finding.code, finding.severity) == ("nominal-values", "note")
    keys = ("bodies over those of the file", "standard error")
    times, error = (finding.evidence[key] for key in keys)
    assert times == pytest.approx(factor, abs=3 * error)
    assert error < 0.06
    keys = ("relative change of the mass", "standard error of the mass")
    change, error_of_mass = (finding.evidence[key] for key in keys)
    assert change == pytest.approx(factor - 1, abs=3 * error_of_mass)
    # a slide moves the mass itself, a hinge its product with a length
    assert (error_of_mass > 2 * error) == (case != "arm")
    # torques that are off by that factor, or another payload, explain the same: nothing is pasted
    assert f"or {'a payload' if case == 'leg' else 'all torques are'}" in finding.message
    assert "scale" not in finding.remedy
    assert "weigh" in finding.remedy


@pytest.mark.parametrize(("factor", "is_tried"), [(1.03, False), (1.1, True)])
def test_a_slight_factor_on_all_torques_is_none(factor: float, is_tried: bool) -> None:
    """Masses, payloads and gravity are not better known than that."""
    log = arm_log()
    larger = experiment(arm(), replace(log, motor_torque=factor * log.motor_torque))
    assert bool([*_all_torque_scales(larger)]) == is_tried


def test_the_link_that_is_heavier_is_named() -> None:
    robot = leg(TEST_MASS)
    bodies = robot.parameters.reshape(-1, 10).copy()
    shank = robot.body_names.index("shank")
    bodies[shank] /= 1.5
    found = experiment(robot.with_values(bodies.ravel(), robot.drives), leg_log())
    (finding,) = file_findings(found)
    assert "shank" in finding.message
    assert finding.evidence["relative change of shank"] == pytest.approx(0.5, abs=0.1)


def test_what_the_log_does_not_decide_is_named_together_with_the_measurement_that_does() -> None:
    """A reversed shoulder of the arm and a reversed slide mirror each other."""
    robot, log = arm(), arm_log()
    sign = np.where(np.array(robot.joint_names) == "shoulder", -1.0, 1.0)
    channels = ("motor_position", "joint_position", "motor_torque")
    wrong = replace(log, **{name: sign * getattr(log, name) for name in channels})
    (finding, *_), _ = mistakes(experiment(rough(robot, 1), wrong))
    assert (finding.code, finding.certainty) == ("sign", "possible")
    assert finding.message.count("the joint as a whole") == 2
    assert "or sign" in finding.evidence
    assert "sign =" not in finding.remedy
    assert "turn the joint by hand" in finding.remedy


IN_OTHER_UNITS = {
    "lengths": (1e3, 1e3, 1e6, -9.81, "geometry"),
    "centres": (1.0, 1e3, 1.0, -9.81, "geometry"),
    "kg mm^2": (1.0, 1.0, 1e6, -9.81, "geometry"),
    "g mm^2": (1.0, 1.0, 1e9, -9.81, "geometry"),
    "gravity": (1.0, 1.0, 1.0, -9810.0, "gravity"),
    "": (1.0, 1.0, 1.0, -9.81, ""),
}
"""{what is in another unit: factors on distances, centres and inertias, gravity, the code}."""


@pytest.mark.parametrize("what", IN_OTHER_UNITS)
def test_units_of_a_robot_file_are_plausible(what: str, tmp_path: Path) -> None:
    far, out, wide, gravity, code = IN_OTHER_UNITS[what]
    moments = f'ixx="{0.02 * wide}" iyy="{0.02 * wide}" izz="{0.01 * wide}" ixy="0" ixz="0" iyz="0"'
    inertial = f'<inertial><origin xyz="{0.05 * out} 0 0"/><mass value="1.5"/><inertia {moments}/>'
    joints = {"a": "revolute base arm ", "b": f'revolute arm hand <origin xyz="0 0 {0.3 * far}"/>'}
    path = write_robot(tmp_path / "arm.urdf", joints, f"{inertial}</inertial>")
    robot = load_robot(path, gravity=(0.0, 0.0, gravity))
    time = np.arange(500) / 100
    moved = np.column_stack([np.sin(time), np.cos(2 * time)])
    log = log_with(("a", "b"), time, joint_position=moved, motor_torque=moved)
    findings = [x for x in log_findings(robot, [log]) if x.code in ("geometry", "gravity")]
    assert [(x.code, x.severity) for x in findings] == [(code, "wrong")] * bool(code)
    if code == "gravity":  # an option, or a line of the project file
        option, line = findings[0].remedy.splitlines()
        assert option.startswith("option: --gravity 0,0,-9.81, or ")
        assert tomllib.loads(line)["gravity"] == [0, 0, -9.81]


@pytest.mark.parametrize(("case", "kg"), quick_first([("arm", 1.5), ("leg", 2.6), ("leg", 4.0)]))
def test_a_named_payload_is_contradicted_before_the_bodies_are(case: str, kg: float) -> None:
    """The leg carries 2 kg at its foot, the arm nothing."""
    place = (0.15, 0.0, 0.0) if case == "leg" else (0.1, 0.05, -0.1)
    payload = Payload("foot" if case == "leg" else "tool", kg, place)
    if case == "leg":
        robot = leg(payload)
    else:
        plain = arm()
        assert plain.urdf
        robot = load_robot(plain.urdf, plain.drives, payloads=[payload])
    (finding, *_), _ = mistakes(experiment(robot, CASES[case][1]()))
    assert (finding.code, finding.severity) == ("payload", "wrong")
    if case == "leg":
        (said,) = re.findall(r"has (\S+) \+- (\S+) kg", finding.message)
        mass, error = map(float, said)
        assert abs(mass - 2.0) < 3 * error < 0.8


@pytest.mark.parametrize("joint", quick_first([2, 1]))  # 1.3 s each
def test_a_spring_that_is_not_declared_is_neither_a_payload_nor_gravity(joint: int) -> None:
    """Near the middle of its range a joint shows a spring as well as a heavy body near its axis."""
    robot, log, stiffness = CASES["ur10"][0](), geared_arm_log(), 200.0
    pull = stiffness * log.joint_position[:, joint]
    sprung = with_channels(log, log.joint_names[joint], motor_torque=lambda x: x + pull)
    findings, _ = mistakes(experiment(robot, sprung))
    assert (findings[0].code, findings[0].joint) == ("missing-term", robot.joint_names[joint])
    assert findings[0].evidence["stiffness"] == pytest.approx(stiffness, rel=0.2)
    assert findings[0].remedy.endswith('parallel_spring = ["linear", "preload"]')
    assert {finding.code for finding in findings}.isdisjoint({"payload", "gravity"})


@pytest.mark.parametrize("tilt", [1.0, 12.0])
def test_gravity_that_is_tilted_is_named_however_little(tilt: float) -> None:
    """A tilt that was left of one repaired before was springs parallel to joints."""
    robot, angle = leg(TEST_MASS), np.radians(tilt)
    model = robot.model.copy()
    model.gravity.linear = 9.81 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    finding = the_mistake(replace(robot, model=model), leg_log())
    assert finding.code == "gravity"
    assert finding.evidence["tilt [deg]"] == pytest.approx(tilt, abs=0.2)


@pytest.mark.parametrize("factor", [0.01, 100.0])
def test_misfits_do_not_depend_on_the_unit_of_torques(factor: float) -> None:
    """Reversed torques need friction that drives, which counts as much as what is unexplained."""

    def free(unit: float) -> np.ndarray:
        drives = {
            joint: replace(drive, motor_inertia_kg_m2=unit * (drive.motor_inertia_kg_m2 or 0.0))
            for joint, drive in arm().drives.items()
        }
        log = replace(arm_log(), motor_torque=-unit * arm_log().motor_torque)
        return experiment(arm().with_drives(drives), log).free

    np.testing.assert_allclose(free(factor), free(1.0), rtol=1e-6)


@pytest.mark.parametrize("case", ["leg", "arm"])
def test_a_rotor_of_unknown_inertia_does_not_look_like_bodies(case: str) -> None:
    """Its inertia is that of the motor equation (7): the misfits are those of a known one."""
    robot, log = CASES[case][0](), CASES[case][1]()
    unknown = robot.with_drives(
        {
            joint: replace(robot.drives[joint], motor_inertia_kg_m2=None)
            for joint in robot.elastic_joints
        }
    )
    known = experiment(robot, log)
    cutoff_hz = reconstruct_motions(robot, log)[0].cutoff_hz
    estimated = Experiment.of(unknown, [reconstruct_motions(unknown, log, cutoff_hz)])
    for joint in robot.elastic_joints:
        j = robot.index(joint)
        for misfit in ("nominal", "free", "of_motors"):
            true = getattr(known, misfit)[j]
            assert getattr(estimated, misfit)[j] == pytest.approx(true, rel=0.1, abs=0.002)


def attributes_read() -> dict[str, set[str]]:
    """Return {method or property: the attributes of the experiment that its source reads}."""
    trees = [ast.parse(inspect.getsource(layer)).body[0] for layer in (Instants, Experiment)]
    parts = [part for tree in trees for part in ast.iter_child_nodes(tree)]
    reads = dict[str, set[str]]()
    for method in (part for part in parts if isinstance(part, ast.FunctionDef)):
        nodes = [*ast.walk(method)]
        own = [x for x in nodes if isinstance(x, ast.Attribute) and ast.unparse(x.value) == "self"]
        reads[method.name] = {attribute.attr for attribute in own}
        # no derived property hands the experiment on to a function that reads others
        handed_on = sum(isinstance(x, ast.Name) and x.id == "self" for x in nodes) - len(own)
        assert handed_on == 0 or method.name not in _FIELDS_OF
    return reads


def test_derived_properties_name_all_fields_that_they_rest_on() -> None:
    """Also through other properties: `with_changes` keeps what names no changed field."""
    by_method, undeclared = attributes_read(), dict[str, set[str]]()
    for name, declared in _FIELDS_OF.items():
        reached, waiting = set[str](), [name]
        while waiting:
            attribute = waiting.pop()
            if attribute not in reached:
                reached.add(attribute)
                # unknown constants rest on bodies too, see the test of currents
                waiting += by_method.get(attribute, ()) if attribute != "constants" else ()
        undeclared[name] = reached & {field.name for field in fields(Experiment)} - declared
    assert len(undeclared) > 20
    assert {name: missing for name, missing in undeclared.items() if missing} == {}
    before = experiment(arm(), arm_log())
    assert all(getattr(before, name) is not None for name in _FIELDS_OF)
    stays = vars(before.with_changes(effort=2 * before.effort)).keys() & _FIELDS_OF.keys()
    assert stays == {name for name, declared in _FIELDS_OF.items() if "effort" not in declared}


@pytest.mark.slow  # a check of the leg each
@pytest.mark.parametrize("joint", ["hip_roll", "hip_pitch"])
def test_the_same_mistake_of_an_upright_joint_is_no_rival(joint: str) -> None:
    """Nothing shows the zero of hip_yaw, whose axis is upright: it withheld the remedy."""
    j, log = leg().index(joint), leg_log()
    turned = (np.pi / 2) * (np.arange(leg().n) == j)
    ratio = total_ratio(leg().drives[joint])
    wrong = replace(
        log,
        joint_position=log.joint_position + turned,
        motor_position=log.motor_position + ratio * turned,
    )
    findings = seaid.check(leg(TEST_MASS), wrong).warnings
    (finding,) = (x for x in findings if x.severity != "note")
    assert (finding.code, finding.joint) == ("encoder-offset", joint)
    offset = lines_of(finding, joint)["joint_position"]["offset"]
    assert offset == pytest.approx(-np.pi / 2, abs=0.02)


def test_the_weight_on_a_slide_is_no_friction() -> None:
    """A torque of the other sign was explained by a constant: only the accelerations remained."""
    log, j = arm_log(), arm().index("telescope")
    sign = 1.0 - 2.0 * (np.arange(arm().n) == j)
    right, wrong = (
        experiment(arm(), replace(log, motor_torque=x * log.motor_torque)).nominal[j]
        for x in (1.0, sign)
    )
    assert right < 0.05
    assert wrong > 3.0  # 1.2 with a free constant


def test_a_linkage_is_measured_where_the_rotor_is_unknown() -> None:
    """Its inertia by (7) with a constant ratio was wrong, and with it the deflection."""
    robot, joint = leg(TEST_MASS), "knee_pitch"
    log, j, drive = leg_log(), robot.index(joint), robot.drives[joint]
    inertia, viscous, coulomb = (
        drive.values[x] for x in ("motor_inertia", "viscous_friction", "coulomb_friction")
    )
    step_s = log.time[1] - log.time[0]

    def torque_of_motor(angle: Array) -> Array:
        smooth = low_pass((angle - angle[0])[:, None], 1 / step_s, 20.0)[:, 0]
        speed = np.gradient(smooth, step_s)
        rotor = inertia * np.gradient(speed, step_s)
        return np.asarray(rotor + viscous * speed + coulomb * np.sign(speed))

    q, angle, torque = log.joint_position[:, j], log.motor_position[:, j], log.motor_torque[:, j]
    # theta = N (q + d + 0.3 (1 - cos q)), whose ratio is N (1 + 0.3 sin q)
    turned = angle + 0.3 * total_ratio(drive) * (1 - np.cos(q))
    load = (torque - torque_of_motor(angle)) / (1 + 0.3 * np.sin(q))
    channels = {"motor_position": turned, "motor_torque": load + torque_of_motor(turned)}
    changed = with_channels(log, joint, **{x: lambda _, y=y: y for x, y in channels.items()})
    unknown = robot.with_drives(
        {x: replace(robot.drives[x], motor_inertia_kg_m2=None) for x in robot.elastic_joints}
    )
    (linkage,) = linkages(experiment(unknown, changed))
    table = tomllib.loads(linkage.lines.partition("\n")[2])[joint]
    assert table["gear_ratio"] == pytest.approx(drive.ratio, rel=0.02)
    assert table["angle_ratio"]["cos"] == pytest.approx([0.0], abs=0.03)
    assert table["angle_ratio"]["sin"] == pytest.approx([0.3], abs=0.03)
    error = abs(table["gear_ratio"] - drive.ratio)
    assert error / 3.3 < table["gear_ratio_std"] < 0.01 * drive.ratio
    assert "counts as exact" in linkage.lines


@pytest.mark.parametrize(("case", "joint"), [("leg", "hip_roll"), ("arm", "wrist")])
@pytest.mark.parametrize("what", ["nothing", "a late encoder", "an eccentric gear", "a ratio"])
def test_what_moves_encoders_apart_without_the_torque_is_no_spring(
    case: str, joint: str, what: str
) -> None:
    robot, log = CASES[case][0](), CASES[case][1]()
    q = log.joint_position[:, log.joint_names.index(joint)]
    apart = {
        "nothing": 0 * q,
        "a late encoder": q - np.interp(log.time - 0.003, log.time, q),
        "an eccentric gear": 0.005 * np.sin(5 * q),
        "a ratio": 0.01 * q,
    }[what]
    channel = with_channels(log, joint, joint_position=lambda angle: angle - apart)
    of_motion = experiment(robot, channel).in_motion
    assert float(np.ptp(of_motion.apart[:, robot.index(joint)])) > 0.002 * (what != "nothing")
    assert [*small_springs(of_motion)] == []


def test_a_stiff_drive_with_a_deflection_that_follows_the_torque_has_a_spring() -> None:
    """It is a hundredth of the motion: next to it nothing is left between the encoders."""
    robot, log = CASES["arm"][0](), CASES["arm"][1]()
    torque = experiment(robot, log).target[:, robot.index("wrist")]
    stiffness = float(np.ptp(torque)) / 0.005
    lever = total_ratio(robot.drives["wrist"])
    turned = lever**2 / stiffness * log.motor_torque[:, log.joint_names.index("wrist")]
    soft = with_channels(log, "wrist", motor_position=lambda angle: angle + turned)
    assert experiment(robot, soft).of_encoders[robot.index("wrist")] < 0.01
    (finding,) = small_springs(experiment(robot, soft).in_motion)
    assert (finding.code, finding.joint, finding.severity) == (
        "gear-compliance",
        "wrist",
        "doubtful",
    )
    assert finding.evidence["stiffness of wrist"] == pytest.approx(stiffness, rel=0.1)
    assert 'type = "series_elastic"' in finding.remedy


@pytest.mark.parametrize("name", quick_first(["elastic differential", "mixed differential"]))
def test_coupled_motors_without_encoders_of_their_joints_are_no_loose_encoders(name: str) -> None:
    """The angle behind a spring is that of all motors: q = C^-1 (theta / N - deflection)."""
    case = transmissions.case_of(name)
    log = transmissions.log_of(case, torque=2e-3, angle=2e-5, duration=10.0)
    log = replace(log, joint_position=np.full_like(log.joint_position, np.nan))
    warnings = seaid.check(case.robot, log).warnings
    assert [finding for finding in warnings if finding.severity != "note"] == []


def added(robot: Robot, log: Log, angles: Mapping[int, Any]) -> Log:
    """Return a log with angles added to joints on both sides of their gears."""
    more = np.zeros_like(log.joint_position)
    for j, angle in angles.items():
        more[:, j] = angle
    ratios = np.array([total_ratio(drive) for drive in robot.drives.values()])
    motor = log.motor_position + ratios * more
    return replace(log, motor_position=motor, joint_position=log.joint_position + more)


def test_a_factor_on_all_torques_and_a_payload_are_named_together() -> None:
    """Without known rotors a payload explains as much as a factor that all joints have."""
    robot, log = leg(TEST_MASS), leg_log()
    for joint in robot.joint_names:
        robot = with_drive(robot, joint, motor_inertia_kg_m2=None)
    finding = the_mistake(robot, replace(log, motor_torque=1.3 * log.motor_torque))
    assert finding.code == "torque-scale"
    assert 0 < finding.evidence["or payload"] < 4.5
    assert "scale =" not in finding.remedy


@pytest.mark.parametrize("case", quick_first(["leg", "ur10"]))
def test_a_file_of_a_robot_of_another_size_is_no_wrong_clock(case: str) -> None:
    robot, log = rough(CASES[case][0](), 0), CASES[case][1]()
    larger = _with_length("", experiment(robot, log), np.log(1.3))
    (finding,) = (x for x in mistakes(larger)[0] if x.severity != "note")
    if case == "leg":
        assert (finding.code, finding.severity, finding.joint) == ("geometry", "wrong", "")
        error = abs(finding.evidence["factor"] - 1 / 1.3)
        assert error < 3 * finding.evidence["standard error"] < 0.05
    else:  # nothing that it shows separates the two
        assert {finding.code, *finding.evidence} >= {"time-unit", "or geometry"}


def test_two_mistakes_that_alone_explain_as_much_are_no_rivals() -> None:
    robot, log = CASES["ur10"][0](), geared_arm_log()
    torque = log.motor_torque[:, [5, 1, 2, 3, 4, 0]] * [1, 1, -1, 1, 1, 1]
    findings, _ = mistakes(experiment(robot, replace(log, motor_torque=torque)))
    assert {finding.code for finding in findings} == {"swapped-joints", "sign"}
    assert all("in the description of the log:" in finding.remedy for finding in findings)


@pytest.mark.parametrize(
    ("case", "angles"), quick_first([("ur10", {1: 0.3, 2: 0.3}), ("leg", {2: 0.15, 3: 0.2})])
)
def test_zeros_of_several_joints_are_fitted_together(case: str, angles: dict[int, float]) -> None:
    robot, log = CASES[case][0](), CASES[case][1]()
    finding = the_mistake(robot, added(robot, log, angles))
    assert finding.code == "encoder-offset"
    pairs = re.findall(r"(-?[\d.]+) \+- ([\d.]+) degrees", finding.message)
    for angle, pair in zip(angles.values(), pairs, strict=True):
        value, error = map(float, pair)
        assert abs(value + np.degrees(angle)) < 3 * error < 7


def test_positions_that_contain_those_of_the_joint_before_are_named() -> None:
    robot, log = CASES["ur10"][0](), geared_arm_log()
    finding = the_mistake(robot, added(robot, log, {2: log.joint_position[:, 1]}))
    assert (finding.code, finding.joint) == ("coupled-joints", "elbow_joint")
    assert "minus the angle of shoulder_lift_joint" in finding.remedy


@pytest.mark.parametrize(("name", "parts"), quick_first([("HEBI capstone", 3), ("XL330", 2)]))
def test_short_parts_of_measured_logs_are_not_condemned(name: str, parts: int) -> None:
    """Any bodies fit what a short part shows with a wrong sign, too: they do not predict it."""
    (table,) = (x for x in measured_table() if x["name"] == name)
    causes = [x for part in parts_of(table, [parts]) for x in part.causes]
    assert [x.message for x in causes if x.severity == "wrong"] == []


def test_gears_that_drives_lack_are_named_together() -> None:
    """The bodies of the file are those of the robot: each ratio is within an eighth."""
    robot, log = CASES["ur10"][0](), geared_arm_log()
    ratios = {1: 250.0, 2: 100.0}
    assert {robot.drives[robot.joint_names[j]].ratio for j in ratios} == {1.0}
    torque = log.motor_torque / [ratios.get(j, 1.0) for j in range(robot.n)]
    findings = setup_findings(experiment(robot, replace(log, motor_torque=torque)), [])
    (finding,) = (x for x in findings if x.severity != "note")
    assert (finding.code, finding.severity) == ("gear-ratio", "wrong")
    assert finding.joints == tuple(robot.joint_names[j] for j in ratios)
    np.testing.assert_allclose([*finding.evidence.values()], [*ratios.values()], rtol=1 / 8)
