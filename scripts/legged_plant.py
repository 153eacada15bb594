"""A quadruped on the ground in MuJoCo: it sways, turns, and lifts its feet one after the other."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

import seaid
from seaid._arrays import Array
from seaid.log import BaseLog
from seaid.regressor.floating import contact_map
from seaid.robot import Contact, Robot, floating_model

RADIUS = 0.02
GO2_FEET = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")
_HOME = np.tile([0.0, 0.8, -1.6], 4)
_PLAN_HZ, _SETTLE_S, _LIFT_S = 100, 1.0, 2.0


def ball_feet(radius: float = RADIUS) -> list[Contact]:
    """Return the contacts of a Go2, whose feet are balls."""
    return [Contact(foot, radius_m=radius) for foot in GO2_FEET]


def foot_positions(robot: Robot, q: Array) -> Array:
    """Places (T, feet, 3) of the contacts in the frame of the base."""
    base = robot.floating_base
    assert base is not None
    model = floating_model(robot.model, robot.parameters[-10:])
    frames = []
    for foot in base.contact_links:
        body, rotation, position = base.frame(foot)
        joint, place = 2 + robot.model_order.index(body), pin.SE3(rotation, position)
        frame = pin.Frame(f"foot {foot}", joint, 0, place, pin.FrameType.OP_FRAME)
        frames.append(model.addFrame(frame, False))
    data, found = model.createData(), np.empty((len(q), len(frames), 3))
    for t, angles in enumerate(robot.to_model(q)):
        pin.framesForwardKinematics(model, data, np.concatenate([[0, 0, 0, 0, 0, 0, 1], angles]))
        found[t] = [data.oMf[frame].translation for frame in frames]
    return found


def _with_feet_at(robot: Robot, wanted: Array) -> Array:
    """Joint angles (T, n) with the feet at places (T, feet, 3), by Newton's method."""
    q = np.tile(_HOME, (len(wanted), 1))
    contacts = robot.floating_base.contacts  # type: ignore[union-attr]
    for _ in range(8):
        left = (wanted - foot_positions(robot, q)).reshape(len(q), -1)
        J = contact_map(robot, q, contacts).swapaxes(1, 2)[:, :, 6:]
        q = q + np.linalg.solve(J, left[:, :, None])[:, :, 0]
    return q


def _waves(time: Array, sizes: Sequence[float], rng: np.random.Generator) -> Array:
    """Sums (T, k) of three sines each that begin gently."""
    begin = np.clip(time, 0, 1) ** 2 * (3 - 2 * np.clip(time, 0, 1))
    found = np.zeros((len(time), len(sizes)))
    for place, size in enumerate(sizes):
        for _ in range(3):
            angle = 2 * np.pi * rng.uniform(0.3, 1.2) * time + rng.uniform(0, 2 * np.pi)
            found[:, place] += size * begin * np.sin(angle) / 3
    return found


def plan(robot: Robot, duration_s: float, seed: int) -> tuple[Array, Array]:
    """Times (T,) and joint angles (T, n) of the base swaying and of feet lifted in turn."""
    rng, time = np.random.default_rng(seed), np.arange(0, duration_s, 1 / _PLAN_HZ)
    place = _waves(time, (0.05, 0.04, 0.05), rng)
    tilt = _waves(time, (0.25, 0.25, 0.25), rng)
    feet = np.tile(foot_positions(robot, _HOME[None])[0], (len(time), 1, 1))
    turn, phase = (time // _LIFT_S).astype(int), (time % _LIFT_S) / _LIFT_S
    lifts = turn % 2 == 1
    place, tilt = place * np.where(lifts, 0.6, 1)[:, None], tilt * np.where(lifts, 0.4, 1)[:, None]
    for foot in range(feet.shape[1]):
        own = lifts & ((turn // 2) % 4 == foot)
        away = np.where(own, np.clip(2 * np.sin(np.pi * phase), 0, 1), 0.0)
        place[:, :2] -= 0.05 * away[:, None] * np.sign(feet[0, foot, :2])
        up = own & (phase > 0.25) & (phase < 0.75)
        feet[:, foot, 2] += np.where(up, 0.06 * np.sin(2 * np.pi * (phase - 0.25)) ** 2, 0.0)
    place, tilt = (gaussian_filter1d(x, 6, axis=0) for x in (place, tilt))
    R = np.array([pin.rpy.rpyToMatrix(*angles) for angles in tilt])
    return time, _with_feet_at(robot, np.einsum("tji,tkj->tki", R, feet - place[:, None]))


def plant(robot: Robot, radius: float = RADIUS) -> Any:
    """The robot's URDF in MuJoCo on level ground, with balls for feet and the robot's bodies."""
    assert robot.urdf is not None
    root = ET.fromstring(Path(robot.urdf).read_bytes())
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for one in link.findall(tag):
                link.remove(one)
    options = {"fusestatic": "false", "discardvisual": "true"}
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", options)
    spec = mujoco.MjSpec.from_string(ET.tostring(root).decode())
    base = robot.floating_base
    assert base is not None
    spec.body(base.link).add_freejoint()
    for foot in base.contact_links:
        ball = spec.body(foot).add_geom(name=foot, type=mujoco.mjtGeom.mjGEOM_SPHERE)
        ball.size, ball.mass, ball.friction = [radius, 0, 0], 0.0, [1.0, 0.005, 0.0001]
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1])
    spec.option.timestep = 0.001
    return spec.compile()


def simulate(
    robot: Robot, model: Any, duration_s: float, seed: int = 0, rate_hz: float = 250.0
) -> seaid.Log:
    """The noise-free log of PD-controlled legs on the ground, with IMU and contact flags."""
    assert robot.floating_base is not None
    data, base = mujoco.MjData(model), model.body(robot.floating_base.link).id
    time, angles = plan(robot, duration_s, seed)
    wanted = CubicSpline(time, angles)
    rates = wanted.derivative()
    joints = [model.joint(name) for name in robot.joint_names]
    places, dofs = [one.qposadr[0] for one in joints], [one.dofadr[0] for one in joints]
    feet = {model.geom(foot).id: k for k, foot in enumerate(robot.floating_base.contact_links)}
    data.qpos[3:7], data.qpos[places] = [1, 0, 0, 0], _HOME
    data.qpos[2] = RADIUS - np.mean(foot_positions(robot, _HOME[None])[0, :, 2])
    every, rows = round(1 / (rate_hz * model.opt.timestep)), []
    for step in range(-round(_SETTLE_S / model.opt.timestep), round(duration_s * 1000) - 20):
        t = max(step * model.opt.timestep, 0.0)
        speed = rates(t) if step > 0 else np.zeros(robot.n)
        torque = 120 * (wanted(t) - data.qpos[places]) + 3 * (speed - data.qvel[dofs])
        data.qfrc_applied[dofs] = np.clip(torque, -45, 45)
        mujoco.mj_forward(model, data)
        if step >= 0 and step % every == 0:
            R = data.xmat[base].reshape(3, 3)
            touching = np.zeros(len(feet))
            for contact in data.contact:
                for geom in (contact.geom1, contact.geom2):
                    if geom in feet:
                        touching[feet[geom]] = 1
            force = R.T @ (data.qacc[:3] - model.opt.gravity)
            now = (data.qpos[places], data.qfrc_applied[dofs], data.qvel[3:6], force)
            rows.append(np.concatenate([[t], *now, data.qpos[3:7], touching]))
        mujoco.mj_step(model, data)
    n, table = robot.n, np.array(rows)
    q, torque, w, force, orientation, touching = np.split(
        table[:, 1:], np.cumsum([n, n, 3, 3, 4]), axis=1
    )
    return seaid.Log(
        time=table[:, 0],
        joint_names=robot.joint_names,
        joint_position=q,
        motor_position=np.full_like(q, np.nan),
        motor_torque=torque,
        base=BaseLog(
            orientation=orientation,
            angular_velocity=w,
            specific_force=force,
            contacts=dict(zip(robot.floating_base.contact_links, touching.T, strict=True)),
        ),
    )
