"""Joints whose ratio depends on their angle: equations, simulation, and what logs give back.

The experiments are built without the code under test: the torques of the bodies by Pinocchio's rnea
at the angles of the joints, the linkage phi = g(q) and the drives' equations written out.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from seaid._arrays import Array
from seaid.drives.drives import SeriesElasticDrive
from seaid.errors import ExcitationError, IdentificationError, LogError, RobotError, SymbolicError
from seaid.excitation.design import design_excitation
from seaid.export.mjcf import write_mjcf
from seaid.export.simulators import write_model
from seaid.export.urdf import write_urdf
from seaid.frequency.linear_joints import linearised
from seaid.identification.identification import identify
from seaid.identification.output_error import refine
from seaid.identification.result import Identification
from seaid.identification.static_calibration import held_poses
from seaid.legged import load_robot
from seaid.log.log import Log
from seaid.log.motion import reconstruct_motion
from seaid.log.sources import both_sides
from seaid.regressor import joint_torques, rigid_body_regressor, torque_slopes
from seaid.regressor.exact.equations import complete_model
from seaid.robot.robot import Robot
from seaid.simulation.plant import JOINT_POSITION, JOINT_SPEED, POSITION, SPEED, plant_of
from seaid.simulation.replaying import replay
from tests.experiments import DATA, MODELS
from tests.robot.test_transmission import elastic, rnea, stiff, waves
from tests.simulation.swings import run
from tests.standard_errors import check_scores

CURVE = 0.25, 0.3
"""The linkages: dg/dq = 1 + 0.25 cos(q + 0.3) at the elbow, and 1 + 0.25 sin(2 q + 0.3)."""

URDF = MODELS / "differential_wrist.urdf"
JOINTS = ("elbow", "wrist_pitch", "wrist_roll")


def driven(q: Array) -> Array:
    """Return the angles g(q) (T, n) behind the gears, zero where q is."""
    size, phase = CURVE
    phi = q.copy()
    phi[:, 0] += size * (np.sin(q[:, 0] + phase) - np.sin(phase))
    phi[:, 1] -= size / 2 * (np.cos(2 * q[:, 1] + phase) - np.cos(phase))
    return phi


def ratios(q: Array) -> Array:
    """Return dg/dq (T, n)."""
    size, phase = CURVE
    rho = np.ones_like(q)
    rho[:, 0] += size * np.cos(q[:, 0] + phase)
    rho[:, 1] += size * np.sin(2 * q[:, 1] + phase)
    return rho


@cache
def robot() -> Robot:
    """Return an arm with linkages at an elastic and at a stiff drive."""
    size, phase = CURVE
    c, s = size * np.cos(phase), size * np.sin(phase)
    drives = {
        "elbow": elastic(angle_ratio={"cos": [c], "sin": [-s]}),
        "wrist_pitch": stiff(1, angle_ratio={"cos": [0.0, s], "sin": [0.0, c]}),
        "wrist_roll": elastic(2),
    }
    return load_robot(URDF, drives)


def random_states(count: int = 40) -> tuple[Array, Array, Array]:
    q, v, a = np.random.default_rng(0).normal(size=(3, count, 3))
    return q, v, a


def test_rows_and_torques_behind_the_gears_are_those_of_the_bodies() -> None:
    """By the chain rule at the joints: tau_phi = tau_q / rho."""
    q, v, a = random_states()
    wanted = rnea(robot(), (q, v, a)) / ratios(q)
    behind = robot().angle_ratios.at_drives(q, v, a)
    np.testing.assert_allclose(behind[0], driven(q), rtol=0, atol=1e-13)
    np.testing.assert_allclose(joint_torques(robot(), *behind), wanted, rtol=0, atol=1e-11)
    Y = rigid_body_regressor(robot(), *behind)
    np.testing.assert_allclose(Y @ robot().parameters, wanted, rtol=0, atol=1e-11)


def test_slopes_are_those_of_the_torques_behind_the_gears() -> None:
    states, step = random_states(10), 1e-6
    found = torque_slopes(robot(), *states)
    for order in range(3):
        for column in range(3):
            ends = []
            for sign in (1, -1):
                moved = [state.copy() for state in states]
                moved[order][:, column] += sign * step
                ends.append(joint_torques(robot(), *moved))
            slope = (ends[0] - ends[1]) / (2 * step)
            np.testing.assert_allclose(found[order, :, :, column], slope, rtol=0, atol=1e-6)


def without_friction(robot: Robot) -> Robot:
    bare: dict[str, Any] = {"viscous_friction_Nms_per_rad": 0.0, "coulomb_friction_Nm": 0.0}
    return robot.with_drives({x: replace(drive, **bare) for x, drive in robot.drives.items()})


def test_an_arm_without_friction_keeps_its_energy() -> None:
    """That of bodies at the angles of the joints, rotors at those of the motors, and springs."""
    plant = plant_of(without_friction(robot()))
    state = np.zeros((4, 3))
    state[JOINT_POSITION] = (0.9, -0.5, 0.4)
    state[POSITION] = plant.ratio * state[JOINT_POSITION]
    states = run(plant, state, lambda _: np.zeros(3), 0.05, 1e-3)
    grid = np.linspace(-np.pi, np.pi, 200_001)[:, None] * np.ones(3)
    data, totals, exchanged = plant.model.createData(), [], []
    for now in states:
        # The inverse of the linkages, by interpolation between exact pairs.
        pairs = zip(now[JOINT_POSITION], driven(grid).T, strict=True)
        q = np.array([np.interp(phi, behind, grid[:, 0]) for phi, behind in pairs])
        v = now[JOINT_SPEED] / ratios(q[None])[0]
        plant.model.armature = np.zeros(3)
        bodies = pin.computeKineticEnergy(plant.model, data, q, v)
        stretch = now[POSITION] / plant.ratio - now[JOINT_POSITION]
        springs = 0.5 * np.sum((plant.stiffness * stretch**2)[plant.elastic])
        rotors = 0.5 * np.sum(plant.motor_inertia * now[SPEED] ** 2)
        totals.append(bodies + pin.computePotentialEnergy(plant.model, data, q) + springs + rotors)
        exchanged.append(bodies + rotors)
    assert np.ptp(exchanged) > 0.05
    assert np.ptp(totals) < 1e-5 * np.ptp(exchanged)


def motor_angles(time: Array, seed: int) -> tuple[Array, Array]:
    """Return the angles of the motors and the torques behind their gears, by (3) and (4b)."""
    q, v, a = waves(3, time, 0.8, seed)
    torque = rnea(robot(), (q, v, a)) / ratios(q)
    angle = driven(q)
    for i, drive in enumerate(robot().drives[joint] for joint in JOINTS):
        if isinstance(drive, SeriesElasticDrive):
            angle[:, i] += torque[:, i] / drive.values["stiffness"]
        angle[:, i] *= drive.ratio
    return angle, torque


@cache
def true_log(seed: int = 0, torque_sensor: bool = False) -> Log:
    """Return the exact log of eight seconds at 500 Hz: torques by (7) at the motors' angles."""
    step = 1e-3
    time = np.arange(4000) / 500
    before, after = (motor_angles(time + x, seed)[0] for x in (-step, step))
    now, behind = motor_angles(time, seed)
    speed, acceleration = (after - before) / (2 * step), (after - 2 * now + before) / step**2
    torque = np.empty_like(now)
    for i, values in enumerate(robot().drives[joint].values for joint in JOINTS):
        torque[:, i] = values["motor_inertia"] * acceleration[:, i]
        torque[:, i] += values["viscous_friction"] * speed[:, i]
        torque[:, i] += values["coulomb_friction"] * np.sign(speed[:, i])
        torque[:, i] += behind[:, i] / robot().drives[JOINTS[i]].ratio
    q = waves(3, time, 0.8, seed)[0]
    return Log(
        time=time,
        joint_names=JOINTS,
        motor_position=now,
        joint_position=q,
        motor_torque=torque,
        joint_torque=behind * ratios(q) if torque_sensor else None,
    )


def noisy(log: Log, seed: int) -> Log:
    rng, shape = np.random.default_rng(seed), log.motor_torque.shape
    return replace(
        log,
        motor_position=log.motor_position + 2e-4 * rng.normal(size=shape),
        joint_position=log.joint_position + 1e-5 * rng.normal(size=shape),
        motor_torque=log.motor_torque + 0.01 * rng.normal(size=shape),
    )


DRIVE = ("viscous_friction", "coulomb_friction", "stiffness")


def errors_of(found: Identification) -> tuple[Array, Array, Array]:
    """Return errors of the estimates, their standard errors and the true values."""
    off, spread, true = [], [], []
    for joint in JOINTS:
        estimate, drive = found.drives[joint], robot().drives[joint]
        for name in DRIVE if drive.is_elastic else DRIVE[:2]:
            true.append(drive.values[name])
            off.append(estimate.value(name) - true[-1])
            spread.append(estimate.standard_errors[estimate.names.index(name)])
    load = found.load
    bodies = found.base.project(robot().parameters)
    places = [load.names.index(name) for name in found.base.expressions]
    off += (load.values[places] - bodies).tolist()
    spread += load.standard_errors[places].tolist()
    return np.array(off), np.array(spread), np.array([*true, *bodies])


def test_a_motion_has_the_angles_and_torques_behind_the_gears() -> None:
    log = true_log(torque_sensor=True)
    motion = reconstruct_motion(robot(), log, 12.0)
    inside = slice(400, -400)
    phi = driven(log.joint_position)[inside]
    np.testing.assert_allclose(motion.joint_position[inside], phi, rtol=0, atol=2e-5)
    behind = motor_angles(log.time, 0)[1]
    np.testing.assert_allclose(motion.joint_torque, behind, rtol=1e-12)


@pytest.mark.parametrize("method", ["two-step", "simultaneous"])
def test_an_exact_log_gives_back_the_robot(method: Any) -> None:
    found = identify(robot().without_nominal(), true_log(), method=method, cutoff_hz=12.0)
    off, _, true = errors_of(found)
    size = np.maximum(np.abs(true), 0.02 * np.max(np.abs(true)))
    assert np.max(np.abs(off) / size) < 5e-3, (off, true)
    assert not [finding for finding in found.warnings if finding.severity == "wrong"]


@pytest.mark.slow  # 30 s
def test_estimates_are_within_their_intervals() -> None:
    scores = []
    for seed in range(48):
        found = identify(robot().without_nominal(), noisy(true_log(seed % 4), seed))
        off, spread, _ = errors_of(found)
        scores.append(off / spread)
    check_scores(scores, band=1.3)


@pytest.mark.slow  # 4 s
def test_a_replay_follows_the_log_in_the_angles_of_the_joints() -> None:
    start = true_log().between(0.0, 1.0)
    again = replay(robot(), start)
    np.testing.assert_allclose(again.joint_position, start.joint_position, rtol=0, atol=4e-3)


@pytest.mark.slow  # 15 s
@pytest.mark.usefixtures("estimates_only")
def test_springs_are_refined_by_output_errors() -> None:
    """The simulation of the joints by the motors is one behind the gears, too."""
    found = identify(robot().without_nominal(), noisy(true_log(), 1))
    refined = refine(found, noisy(true_log(), 1))
    for joint in robot().elastic_joints:
        stiffness = refined.drives[joint].value("stiffness")
        assert stiffness == pytest.approx(robot().drives[joint].values["stiffness"], rel=0.02)


def test_held_poses_have_the_torque_behind_the_gear() -> None:
    """Of the spring, and of a sensor at the joint."""
    log = held_log()
    for sensor in ("spring", "torque"):
        poses = held_poses(robot(), log, "elbow", sensor=sensor)
        scale = robot().drives["elbow"].values["stiffness"] if sensor == "spring" else 1.0
        np.testing.assert_allclose(scale * poses.reading, poses.load, rtol=1e-6, atol=1e-9)


def held_log() -> Log:
    """Return a log that rests in eight poses, by the torques of gravity at the joints."""
    poses = np.random.default_rng(4).uniform(-0.8, 0.8, (8, 3))
    q = np.repeat(poses, 1000, axis=0)
    q += 1e-9 * np.arange(len(q))[:, None]
    torque = rnea(robot(), (q, np.zeros_like(q), np.zeros_like(q)))
    angle = driven(q)
    for i, drive in enumerate(robot().drives[joint] for joint in JOINTS):
        if isinstance(drive, SeriesElasticDrive):
            angle[:, i] += (torque / ratios(q))[:, i] / drive.values["stiffness"]
        angle[:, i] *= drive.ratio
    return Log(
        time=np.arange(len(q)) / 500,
        joint_names=JOINTS,
        motor_position=angle,
        joint_position=q,
        motor_torque=np.zeros_like(q),
        joint_torque=torque,
    )


TABLE = {"angle_rad": [-1.0, 0.0, 0.5, 1.0], "ratio": [1.0, 1.1, 1.2, 1.1]}
SUM = {"wrist_pitch": 1.0, "wrist_roll": 1.0}


@pytest.mark.parametrize(
    ("drives", "problem"),
    [
        ({"elbow": elastic(angle_ratio=TABLE)}, "the table of its angle_ratio ends at -1 and 1"),
        (
            {"wrist_pitch": stiff(transmission=SUM), "wrist_roll": robot().drives["elbow"]},
            "has a factor on 'wrist_roll', whose drive has angle_ratio",
        ),
    ],
    ids=["table", "coupled"],
)
def test_ratios_that_the_robot_cannot_have_are_refused(drives: Any, problem: str) -> None:
    with pytest.raises(RobotError, match=problem):
        load_robot(URDF, drives)


def test_a_joint_that_slides_has_no_angle() -> None:
    drives = {"telescope": stiff(angle_ratio={"cos": [0.1]})}
    with pytest.raises(RobotError, match="is prismatic, and a drive with angle_ratio turns"):
        load_robot(DATA / "mixed_arm.urdf", drives)


@pytest.mark.usefixtures("estimates_only")
def test_what_such_joints_do_not_have_is_said(tmp_path: Path) -> None:
    needs = "needs constant gear ratios, and that of 'elbow' depends on its angle"
    with pytest.raises(ExcitationError, match=f"design_excitation {needs}"):
        design_excitation(robot(), 5.0)
    with pytest.raises(RobotError, match=f"a MuJoCo model {needs}"):
        write_mjcf(robot(), tmp_path / "arm.xml")
    with pytest.raises(SymbolicError, match=f"complete_model {needs}"):
        complete_model(robot())
    with pytest.raises(RobotError, match=f"a linearised robot {needs}"):
        linearised(robot(), np.zeros(3), [0])
    with pytest.raises(RobotError, match=f"a floating base {needs}"):
        load_robot(URDF, robot().drives, base="floating")
    with pytest.raises(LogError, match="a deflection does not determine its position"):
        both_sides({"elbow.deflection_rad": np.zeros(3)}, robot())
    unseen = np.where(np.arange(3) == 0, np.nan, true_log().joint_position)
    with pytest.raises(IdentificationError, match="or angle_ratio, and no sensor behind"):
        identify(robot(), replace(true_log(), joint_position=unseen))


def test_the_page_of_a_simulator_names_the_joints_that_it_lacks(tmp_path: Path) -> None:
    written = write_model(robot(), tmp_path / "arm.py", "isaaclab")
    (lost,) = (x.message for x in written.warnings if "ratio of its angle" in x.message)
    assert "those of elbow, wrist_pitch are not in the file" in lost
    files = write_urdf(robot(), tmp_path / "arm.urdf")
    again = load_robot(files.urdf, files.drives)
    assert again.angle_ratios == robot().angle_ratios
