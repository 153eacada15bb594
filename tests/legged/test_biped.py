"""Two TULip legs with a trunk: springs and bodies while it hangs and while it stands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicSpline

import seaid
from scripts.identify_biped import FEET, plant, simulate, standing_plan, write_biped
from seaid.legged.floating import contact_map, floating_regressor
from seaid.log import BaseLog


def test_biped_is_two_legs_and_a_trunk(tmp_path: Path) -> None:
    urdf, toml = write_biped(tmp_path)
    robot = seaid.load_robot(urdf, drives=toml, base="floating", contacts=FEET)
    leg = seaid.load_robot("models/tulip_leg.urdf")
    masses = robot.parameters[::10]
    # the axle of each ankle weighs 45 g, the trunk 3 kg
    assert np.sum(masses) == pytest.approx(2 * (np.sum(leg.parameters[::10]) + 0.045) + 3.0)
    assert len(robot.elastic_joints) == 6
    stance = [[foot.link for foot in FEET]]
    assert len(seaid.base_parameters(robot, stances=stance).columns) == 66


@pytest.mark.slow  # 12 s of MuJoCo in steps of 0.25 ms, and the fit
def test_standing_determines_springs_of_ankles(tmp_path: Path) -> None:
    urdf, toml = write_biped(tmp_path)
    robot = seaid.load_robot(urdf, drives=toml, base="floating", contacts=FEET)
    log = simulate(robot, plant(urdf, robot, False), standing_plan(robot, 12.0, 1), 1)
    found = seaid.identify(robot.without_nominal(), log)
    for side in ("left", "right"):
        joint = f"{side}_ankle_pitch"
        truth = robot.drives[joint].values["stiffness"]
        assert found.drives[joint].value("stiffness") == pytest.approx(truth, rel=0.02)


@pytest.mark.slow  # checks of a whole biped
def test_flat_feet_on_force_sensors_show_their_weight_only(tmp_path: Path) -> None:
    """Both soles always stand: 16 of the 94 parameters in flight have columns of noise alone."""
    robot = seaid.load_robot(write_biped(tmp_path)[0], base="floating", contacts=FEET)
    planned_s, angles, _ = standing_plan(robot, 12.0, 3)
    time = np.arange(0, 11.9, 0.005)
    q = CubicSpline(planned_s, angles)(time)
    model, data, poses = robot.model, robot.model.createData(), []
    for x in robot.to_model(q):
        pin.forwardKinematics(model, data, x)
        own = data.oMi[model.getJointId("left_ankle_roll")].inverse()  # its foot stays
        poses.append([*own.translation, *pin.Quaternion(own.rotation).coeffs()[[3, 0, 1, 2]]])
    place, orientation = np.split(np.array(poses), [3], axis=1)
    base = BaseLog(
        position=place,
        orientation=orientation,
        contacts={foot.link: np.ones(len(time)) for foot in FEET},
    )
    nothing = np.full_like(q, np.nan)
    log = seaid.Log(time, robot.joint_names, q, nothing, 0 * q, base=base)
    motion = seaid.reconstruct_motion(robot, log, cutoff_hz=2.0)
    assert motion.base is not None
    rows = floating_regressor(robot, *motion.joint_states, motion.base.states) @ robot.parameters
    A = contact_map(robot, motion.joint_position, FEET, own_frame=True)
    forces = np.einsum("tkr,tr->tk", np.linalg.pinv(A[:, :6]), rows[:, :6])
    torque = (rows - np.einsum("trk,tk->tr", A, forces))[:, 6:]
    rng = np.random.default_rng(0)
    noisy = forces + 0.3 * rng.normal(size=forces.shape)
    wrenches = {foot.link: noisy[:, 6 * k : 6 * k + 6] for k, foot in enumerate(FEET)}
    felt = replace(
        log,
        motor_torque=torque + 0.05 * rng.normal(size=q.shape),
        base=replace(base, contacts={}, wrenches=wrenches),
    )
    found = seaid.identify(robot.without_nominal(), felt, cutoff_hz=2.0)
    assert len(found.load.values) == 78
    truth = found.base.project(robot.parameters)
    scores = (found.load.values - truth) / found.load.standard_errors
    assert np.sqrt(np.mean(scores**2)) < 1.7
