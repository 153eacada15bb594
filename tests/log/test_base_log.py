"""The base of a legged robot in a log: its columns, its motion from an IMU and from a pose."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import seaid
from scripts.example_robots import example_urdf
from seaid._arrays import Array
from seaid.errors import LogError
from seaid.legged.base import base_jumps
from seaid.log import BaseLog, reconstruct_motion
from seaid.log.base_log import BaseMotion, _without_jumps, continuous, moving_base
from seaid.robot import Contact, Robot
from seaid.robot.pinocchio_model import floating_model
from tests import plants

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
TIME = np.arange(0, 4, 0.002)
PLACE = np.array([0.08, -0.03, 0.05])
"""The IMU in the frame of the base."""


def solo(**options: Any) -> Robot:
    return seaid.load_robot(example_urdf("solo12.urdf"), base="floating", **options)


def waves(count: int, size: float, seed: int, order: int = 0) -> Array:
    """Sines of an amplitude, or their time derivatives of an `order`."""
    rng = np.random.default_rng(seed)
    rate = 2 * np.pi * rng.uniform(0.3, 1.2, count)
    angle = np.outer(TIME, rate) + rng.uniform(0, 6, count)
    return size * rate**order * np.sin(angle + order * np.pi / 2)


def turned() -> tuple[Array, Array, Array]:
    """Rotations (T, 3, 3) with angular velocity and acceleration in the frame of the base."""
    h = 1e-4

    def rotation(t: Array) -> Array:
        rng = np.random.default_rng(1)
        phase = 2 * np.pi * np.outer(t, rng.uniform(0.3, 1.2, 3))
        rpy = 0.5 * np.sin(phase + rng.uniform(0, 6, 3))
        return np.array([pin.rpy.rpyToMatrix(*angles) for angles in rpy])

    def rate(t: Array) -> Array:
        R, ahead, behind = rotation(t), rotation(t + h), rotation(t - h)
        W = np.einsum("tji,tjk->tik", R, (ahead - behind) / (2 * h))
        return np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], axis=1)

    return rotation(TIME), rate(TIME), (rate(TIME + h) - rate(TIME - h)) / (2 * h)


def specific_force(R: Array) -> tuple[Array, Array]:
    """Return a position of the base, and what an accelerometer in its origin feels."""
    position, h = waves(3, 0.05, 4), 2 * np.pi * np.random.default_rng(4).uniform(0.3, 1.2, 3)
    return position, np.einsum("tji,tj->ti", R, -(h**2) * position + np.array([0, 0, 9.81]))


def quaternions(R: Array) -> Array:
    return np.array([np.roll(pin.Quaternion(one).coeffs(), 1) for one in R])


def log_with(base: BaseLog | None, robot: Robot) -> seaid.Log:
    columns = {"joint_position": waves(robot.n, 0.4, 2), "motor_torque": waves(robot.n, 1.0, 3)}
    return replace(plants.log_with(robot.joint_names, TIME, **columns), base=base)


def base_of(given: BaseLog, robot: Robot, cutoff_hz: float) -> BaseMotion:
    found = reconstruct_motion(robot, log_with(given, robot), cutoff_hz=cutoff_hz).base
    assert found is not None
    return found


def check(motion: BaseMotion, truth: tuple[Array, Array, Array]) -> None:
    """Compare angular velocity and acceleration, and the specific force, with the truth."""
    inside = slice(300, -300)
    for values, true, size in zip(motion.states, truth, (3.0, 12.0, 10.0), strict=True):
        np.testing.assert_allclose(values[inside], true[inside], atol=2e-4 * size)


def test_pose_and_imu_give_the_same_motion_of_the_base(tmp_path: Path) -> None:
    R, w, e = turned()
    position, f = specific_force(R)
    at_imu = f + np.cross(e, PLACE) + np.cross(w, np.cross(w, PLACE))
    turn = pin.rpy.rpyToMatrix(0.3, -0.5, 1.0)  # the IMU is mounted askew

    text = example_urdf("solo12.urdf").read_text()
    rpy, xyz = "0.3 -0.5 1.0", " ".join(map(str, PLACE))
    imu = (
        f'<link name="imu"/><joint name="imu" type="fixed"><parent link="base_link"/>'
        f'<child link="imu"/><origin xyz="{xyz}" rpy="{rpy}"/></joint></robot>'
    )
    path = tmp_path / "solo12.urdf"
    path.write_text(text.replace("</robot>", imu))
    robot = seaid.load_robot(path, base="floating", imu_link="imu")
    with_imu = BaseLog(angular_velocity=w @ turn, specific_force=at_imu @ turn)
    q = quaternions(R)
    flipped = q * np.where(np.arange(len(q)) % 700 < 350, 1.0, -1.0)[:, None]
    with_pose = BaseLog(position=position, orientation=flipped)
    for given in (with_imu, with_pose):
        found = base_of(given, robot, 20.0)
        check(found, (w, e, f))
    assert found.up is not None
    np.testing.assert_allclose(found.up[300:-300], R[300:-300, 2], atol=1e-5)


@pytest.mark.parametrize("link", ["FL_FOOT", "HR_SHOULDER"])
def test_imu_on_a_link_that_joints_move_gives_the_motion_of_the_base(link: str) -> None:
    robot = solo(imu_link=link)
    body, rotation, place = moving_base(robot).frame(link)
    R, w, e = turned()
    _, f = specific_force(R)
    # Pinocchio's free joint, accelerated by the specific force, and no gravity
    model = floating_model(robot.model, robot.parameters[-10:])
    joint = 2 + robot.model_order.index(body)
    own = pin.Frame("imu", joint, 0, pin.SE3(rotation, place), pin.FrameType.OP_FRAME)
    frame, data = model.addFrame(own, False), model.createData()
    q, v, a = (waves(robot.n, 0.4, 2, order) for order in range(3))
    gyro, felt = np.empty((2, len(TIME), 3))
    for t in range(len(TIME)):
        q_t = np.concatenate([[0, 0, 0, 0, 0, 0, 1], robot.to_model(q[t])])
        v_t = np.concatenate([np.zeros(3), w[t], robot.to_model(v[t], 1)])
        a_t = np.concatenate([f[t], e[t], robot.to_model(a[t], 1)])
        pin.forwardKinematics(model, data, q_t, v_t, a_t)
        gyro[t] = pin.getFrameVelocity(model, data, frame, pin.LOCAL).angular
        felt[t] = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL).linear
    base = BaseLog(angular_velocity=gyro, specific_force=felt)
    check(base_of(base, robot, 20.0), (w, e, f))


def test_columns_of_base_and_contacts_are_written_and_read(tmp_path: Path) -> None:
    robot = solo(contacts=FEET)
    R, w, _ = turned()
    base = BaseLog(
        position=waves(3, 0.05, 4),
        orientation=quaternions(R),
        angular_velocity=w,
        specific_force=w + 9,
        contacts={FEET[0]: np.ones(len(TIME)), FEET[2]: np.ones(len(TIME))},
        wrenches={FEET[1]: waves(3, 20, 5), FEET[3]: waves(6, 20, 6)},
    )
    path = tmp_path / "walk.csv"
    seaid.write_log(log_with(base, robot), path)
    found = seaid.read_log(path, robot).base
    assert found is not None
    for name, values in base.columns().items():
        np.testing.assert_allclose(found.columns()[name], values, rtol=1e-12, atol=1e-12)


IMU: dict[str, Any] = {
    "angular_velocity": waves(3, 0.4, 1),
    "specific_force": waves(3, 0.4, 2) + 9.0,
}


@pytest.mark.parametrize(("lift_s", "is_used"), [(0.12, False), (0.2, True), (9.0, True)])
def test_samples_near_a_change_of_contact_are_not_used(lift_s: float, is_used: bool) -> None:
    """Two periods of the low pass on either side; a foot that is lifted for less is never used."""
    in_air = (TIME > 2.0) & (2.0 + lift_s > TIME)
    flags = {FEET[0]: np.where(in_air, 0.0, 1.0), FEET[1]: np.ones(len(TIME))}
    motion = base_of(BaseLog(**IMU, contacts=flags), solo(contacts=FEET[:2]), 10.0)
    assert np.any(motion.used[in_air]) == is_used
    unused, margin = TIME[~motion.used], 2 * 0.02  # at five times the cutoff
    assert unused[0] == pytest.approx(2.0 - margin, abs=0.005)
    if lift_s > TIME[-1]:
        assert unused[-1] == pytest.approx(2.0 + margin, abs=0.005)


def test_the_force_of_a_robot_that_is_mostly_in_flight_has_gravity_in_it() -> None:
    """A hopper has none in the air, and on the ground several times its weight."""
    on_ground = TIME % 1.0 > 0.7
    imu = dict(IMU)
    imu["specific_force"] = np.outer(on_ground, [0.0, 0.0, 9.81 / 0.3])
    log = BaseLog(**imu, contacts={FEET[0]: on_ground.astype(np.float64)})
    motion = base_of(log, solo(contacts=FEET[:1]), 10.0)
    assert np.any(motion.used)


WRONG: tuple[tuple[dict[str, Any] | None, str], ...] = (
    (None, "the base of 'solo' floats, and the log has no channel of it"),
    ({"angular_velocity": IMU["angular_velocity"]}, "the log has no acceleration of the base"),
    ({"specific_force": IMU["specific_force"]}, "the log has no rotation of the base"),
    (
        {**IMU, "specific_force": waves(3, 0.5, 2)},
        "that of a robot on the ground about 9.81: the IMU took gravity out of it",
    ),
    ({**IMU, "contacts": {"FL_FOT": np.ones(len(TIME))}}, "did you mean 'FL_FOOT'?"),
    (
        {**IMU, "contacts": {"FL_LOWER_LEG": np.ones(len(TIME))}},
        "does not name would count as none",
    ),
    (IMU, "does not say when FL_FOOT, FR_FOOT, HL_FOOT, HR_FOOT of contacts= touch the ground"),
    ({**IMU, "wrenches": {"FL_FOT": waves(3, 1, 1)}}, "wrenches: no link is named 'FL_FOT'"),
    ({**IMU, "specific_force": np.zeros((len(TIME), 2))}, "specific_force must have shape (any, 3"),
    ({"orientation": np.full((len(TIME), 4), 0.7)}, "found a length of 1.4 in sample 0"),
    ({"wrenches": {FEET[0]: waves(2, 1, 1)}}, "must have three forces or forces and moments"),
    (
        {**IMU, "angular_velocity": np.full((len(TIME), 3), np.nan)},
        "is not finite in 2000 of 2000 samples, the first in sample 0",
    ),
)


@pytest.mark.parametrize(("given", "message"), WRONG)
def test_message_of_a_base_that_does_not_fit(given: dict[str, Any] | None, message: str) -> None:
    robot = solo(contacts=FEET)
    with pytest.raises(LogError, match=re.escape(message)):
        base = None if given is None else BaseLog(**given)
        reconstruct_motion(robot, log_with(base, robot), cutoff_hz=10.0)


def test_parts_of_a_base_that_do_not_fit_are_named(tmp_path: Path) -> None:
    """Another length, half an IMU, and a ball whose lowest point nobody knows are refused."""
    robot, path = solo(contacts=FEET), tmp_path / "walk.csv"
    log = log_with(BaseLog(**IMU, contacts={FEET[0]: TIME}), robot)
    part = log.between(1.0, 2.0).base
    assert part is not None
    np.testing.assert_array_equal(part.contacts[FEET[0]][:, 0], TIME[500:1000])
    with pytest.raises(
        LogError, match=r"base\.angular_velocity_x_\w* has 500 samples, time has 2000"
    ):
        replace(log, base=part)
    seaid.write_log(log_with(BaseLog(**IMU), robot), path)
    path.write_text(path.read_text().replace("base.specific_force_z_m_per_s2", "other"))
    with pytest.raises(LogError, match=r"no column base\.specific_force_z"):
        seaid.read_log(path, robot)
    ball = solo(contacts=[Contact(FEET[0], radius_m=0.016)])
    with pytest.raises(LogError, match="whose lowest point depends on the orientation"):
        seaid.identify(ball, log)


def test_jumps_of_position_and_orientation_at_one_sample_do_not_cancel() -> None:
    """An estimator that finds its pose anew moves both at once."""
    time = np.arange(0.0, 4.0, 0.01)
    jumped = time >= 2.0
    position = np.column_stack([0.1 * np.sin(time), 0.1 * np.cos(time), 0.3 + 0 * time])
    angle = 0.1 * np.sin(2 * time) + 0.4 * jumped
    orientation = np.column_stack([np.cos(angle / 2), 0 * time, 0 * time, np.sin(angle / 2)])
    log = BaseLog(position=position + 0.2 * jumped[:, None], orientation=orientation)
    assert {*base_jumps(log, time)} == {"position", "orientation"}
    without, flag = _without_jumps(log)
    assert np.count_nonzero(np.diff(flag)) == 1
    assert without.position is not None
    assert np.max(np.abs(np.diff(without.position, axis=0))) < 2e-3


def test_a_sign_of_a_quaternion_that_changes_at_an_unknown_sample_is_seen() -> None:
    angle = np.linspace(0.0, 1.0, 200)
    orientation = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle, 0 * angle])
    flipped = np.where(angle < 0.5, 1.0, -1.0)[:, None] * orientation
    flipped[np.searchsorted(angle, 0.5)] = np.nan
    known = np.all(np.isfinite(flipped), axis=1)
    np.testing.assert_array_equal(continuous(flipped)[known], orientation[known])
