"""Quadrupeds on the ground in MuJoCo: they sway, turn, lift their feet in turn, or trot."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

import seaid
from seaid._arrays import Array
from seaid.legged.floating import contact_map
from seaid.log import BaseLog
from seaid.log.base_log import moving_base
from seaid.robot import Contact, Robot
from seaid.robot.pinocchio_model import floating_model

_PLAN_HZ, _SETTLE_S, _LIFT_S = 100, 1.0, 2.0
_PERIOD_S, _SWING = 0.6, 0.4
"""Of a trot: its period, and the share of it for which a foot swings."""

HOME = np.tile([0.0, 0.8, -1.6], 4)


@dataclass(frozen=True)
class Quadruped:
    """A quadruped of example-robot-data: its file, its feet, and the size of all that moves it.

    `stiffness` [N m/rad], `damping` [N m s/rad] and `torque_limit` [N m] are those of the PD
    control of the joints; `size` multiplies the distances of the motion of a Go2.
    """

    urdf: str
    feet: tuple[str, ...]
    radius_m: float
    size: float
    stiffness: float
    damping: float
    torque_limit: float

    @property
    def contacts(self) -> list[Contact]:
        """The contacts: the feet are balls."""
        return [Contact(foot, radius_m=self.radius_m) for foot in self.feet]


GO2 = Quadruped(
    "go2.urdf", ("FL_foot", "FR_foot", "RL_foot", "RR_foot"), 0.02, 1.0, 120.0, 3.0, 45.0
)
GO2_FEET = GO2.feet
SOLO12 = Quadruped(
    "solo12.urdf", ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"), 0.016, 0.75, 12.0, 0.2, 2.7
)
"""Masses of 15 kg and 2.5 kg on legs of 0.43 m and 0.32 m."""


def changed_bodies(urdf: Path, folder: Path, seed: int, size: float = 0.2) -> Path:
    """Write a URDF whose bodies are changed at random by about `size`, and return its path.

    The pseudo-inertia J of each link becomes A J A^T with A = 1 + a random matrix, which keeps it
    physically consistent: mass, place and spread of the mass change together.
    """
    rng, root = np.random.default_rng(seed), ET.fromstring(urdf.read_bytes())
    for inertial in root.iter("inertial"):
        mass, inertia, origin = (inertial.find(x) for x in ("mass", "inertia", "origin"))
        assert mass is not None
        assert inertia is not None
        assert origin is not None
        names = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))
        spread = np.array([[float(inertia.attrib[x]) for x in row] for row in names])
        R = pin.rpy.rpyToMatrix(*map(float, origin.get("rpy", "0 0 0").split()))
        m, c = float(mass.attrib["value"]), np.array(origin.get("xyz", "0 0 0").split(), float)
        if m == 0:
            continue
        spread = R @ spread @ R.T
        J = m * np.outer([*c, 1], [*c, 1])
        J[:3, :3] += 0.5 * np.trace(spread) * np.eye(3) - spread
        A = np.eye(4) + 0.5 * size * rng.uniform(-1, 1, (4, 4)) * np.array(
            [[1, 0.5, 0.5, 0.1], [0.5, 1, 0.5, 0.1], [0.5, 0.5, 1, 0.1], [0, 0, 0, 1]]
        )
        J = A @ J @ A.T
        m, c = J[3, 3], J[:3, 3] / J[3, 3]
        spread = J[:3, :3] - m * np.outer(c, c)
        spread = np.trace(spread) * np.eye(3) - spread
        mass.set("value", repr(float(m)))
        origin.set("xyz", " ".join(repr(float(x)) for x in c))
        origin.set("rpy", "0 0 0")
        for i, row in enumerate(names):
            for j, name in enumerate(row):
                inertia.set(name, repr(float(spread[i, j])))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{urdf.stem}_{seed}.urdf"
    path.write_bytes(ET.tostring(root))
    return path


def foot_positions(robot: Robot, q: Array) -> Array:
    """Places (T, feet, 3) of the contacts in the frame of the base."""
    base = moving_base(robot)
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
    q = np.tile(HOME, (len(wanted), 1))
    contacts = moving_base(robot).contacts
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


@dataclass(frozen=True, eq=False)
class Targets:
    """Joint angles (T, n) [rad] at times (T,) [s], and torques (T, n) [N m] that are added."""

    time: Array
    angles: Array
    torques: Array


def plan(
    robot: Robot, legs: Quadruped, duration_s: float, seed: int, lifted: bool = True
) -> Targets:
    """The base sways, and feet are `lifted` in turn."""
    rng, time = np.random.default_rng(seed), np.arange(0, duration_s, 1 / _PLAN_HZ)
    place = legs.size * _waves(time, (0.05, 0.04, 0.05), rng)
    tilt = _waves(time, (0.25, 0.25, 0.25), rng)
    feet = np.tile(foot_positions(robot, HOME[None])[0], (len(time), 1, 1))
    turn, phase = (time // _LIFT_S).astype(int), (time % _LIFT_S) / _LIFT_S
    lifts = (turn % 2 == 1) & lifted
    place, tilt = place * np.where(lifts, 0.6, 1)[:, None], tilt * np.where(lifts, 0.4, 1)[:, None]
    for foot in range(feet.shape[1]):
        own = lifts & ((turn // 2) % 4 == foot)
        away = np.where(own, np.clip(2 * np.sin(np.pi * phase), 0, 1), 0.0)
        place[:, :2] -= 0.05 * legs.size * away[:, None] * np.sign(feet[0, foot, :2])
        up = own & (phase > 0.25) & (phase < 0.75)
        feet[:, foot, 2] += np.where(
            up, 0.06 * legs.size * np.sin(2 * np.pi * (phase - 0.25)) ** 2, 0.0
        )
    place, tilt = (gaussian_filter1d(x, 6, axis=0) for x in (place, tilt))
    R = np.array([pin.rpy.rpyToMatrix(*angles) for angles in tilt])
    angles = _with_feet_at(robot, np.einsum("tji,tkj->tki", R, feet - place[:, None]))
    return Targets(time, angles, np.zeros_like(angles))


def trot(robot: Robot, legs: Quadruped, duration_s: float, seed: int) -> Targets:
    """Trot on the spot, and forth and back, while the base sways."""
    rng, t = np.random.default_rng(seed), np.arange(0, duration_s, 1 / _PLAN_HZ)
    place, tilt = legs.size * _waves(t, (0.03, 0.02, 0.04), rng), _waves(t, (0.12, 0.12, 0.15), rng)
    feet = np.tile(foot_positions(robot, HOME[None])[0], (len(t), 1, 1))
    grows = legs.size * np.clip(t - 1, 0, 1)
    for foot in range(4):
        phase = (t / _PERIOD_S + 0.5 * (foot not in (0, 3))) % 1
        s = np.clip(phase / _SWING, 0, 1) * (phase < _SWING)
        feet[:, foot, 2] += grows * 0.05 * np.sin(np.pi * s) ** 2
        forth = np.where(
            phase < _SWING,
            s - np.sin(2 * np.pi * s) / (2 * np.pi) - 0.5,
            0.5 - (phase - _SWING) / (1 - _SWING),
        )
        feet[:, foot, 0] += grows * 0.05 * forth * np.sin(2 * np.pi * t / 7)
    place, tilt = (gaussian_filter1d(x, 6, axis=0) for x in (place, tilt))
    R = np.array([pin.rpy.rpyToMatrix(*angles) for angles in tilt])
    angles = _with_feet_at(robot, np.einsum("tji,tkj->tki", R, feet - place[:, None]))
    return Targets(t, angles, np.zeros_like(angles))


def plant(robot: Robot, timestep_s: float = 0.0005, soft: bool = False) -> Any:
    """The robot's URDF in MuJoCo on level ground, with balls for feet and the robot's bodies.

    The feet sink in by 0.2 mm on average; `soft` ones, as MuJoCo has them, by 4 mm.
    """
    assert robot.urdf is not None
    root = ET.fromstring(Path(robot.urdf).read_bytes())
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for one in link.findall(tag):
                link.remove(one)
    options = {"fusestatic": "false", "discardvisual": "true"}
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", options)
    spec = mujoco.MjSpec.from_string(ET.tostring(root).decode())
    base = moving_base(robot)
    spec.body(base.link).add_freejoint()
    for foot in base.contacts:
        ball = spec.body(foot.link).add_geom(name=foot.link, type=mujoco.mjtGeom.mjGEOM_SPHERE)
        ball.size, ball.mass, ball.friction = [foot.radius_m, 0, 0], 0.0, [1.0, 0.005, 0.0001]
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1])
    spec.option.timestep = timestep_s
    model = spec.compile()
    if not soft:
        model.geom_solref[:], model.geom_solimp[:] = (0.004, 1.0), (0.95, 0.99, 0.001, 0.5, 2.0)
    return model


def simulate(
    robot: Robot,
    model: Any,
    duration_s: float,
    seed: int = 0,
    rate_hz: float = 250.0,
    legs: Quadruped = GO2,
    targets: Targets | None = None,
    has_forces: bool = False,
) -> seaid.Log:
    """The noise-free log of PD-controlled legs on the ground, with IMU and contact flags.

    They follow `targets`, by default those of a `plan`. With `has_forces` the log has the forces at
    the feet, in the frames of their links, in place of the flags.
    """
    data, base = mujoco.MjData(model), model.body(moving_base(robot).link).id
    targets = targets or plan(robot, legs, duration_s, seed)
    wanted = CubicSpline(targets.time, targets.angles)
    rates, added = wanted.derivative(), CubicSpline(targets.time, targets.torques)
    joints = [model.joint(name) for name in robot.joint_names]
    places, dofs = [one.qposadr[0] for one in joints], [one.dofadr[0] for one in joints]
    feet = {model.geom(foot).id: k for k, foot in enumerate(moving_base(robot).contact_links)}
    data.qpos[3:7], data.qpos[places] = [1, 0, 0, 0], HOME
    data.qpos[2] = legs.radius_m - np.mean(foot_positions(robot, HOME[None])[0, :, 2])
    step_s = model.opt.timestep
    every, rows = round(1 / (rate_hz * step_s)), []
    steps = np.arange(-round(_SETTLE_S / step_s), round((duration_s - 0.02) / step_s))
    time = np.maximum(steps * step_s, 0.0)
    plans = wanted(time), rates(time) * (steps > 0)[:, None], added(time)
    for step, t, angle, speed, torque_of_plan in zip(steps.tolist(), time, *plans, strict=True):
        torque = legs.stiffness * (angle - data.qpos[places])
        torque += legs.damping * (speed - data.qvel[dofs]) + torque_of_plan
        data.qfrc_applied[dofs] = np.clip(torque, -legs.torque_limit, legs.torque_limit)
        if step >= 0 and step % every == 0:
            mujoco.mj_forward(model, data)
            R = data.xmat[base].reshape(3, 3)
            touching, forces = np.zeros(len(feet)), np.zeros((len(feet), 3))
            for place, contact in enumerate(data.contact):
                for geom, sign in ((contact.geom1, -1), (contact.geom2, 1)):
                    if geom in feet:
                        touching[feet[geom]] = 1
                        forces[feet[geom]] += sign * _force_on(model, data, place, geom)
            force = R.T @ (data.qacc[:3] - model.opt.gravity)
            now = (data.qpos[places], data.qfrc_applied[dofs], data.qvel[3:6], force)
            rows.append(np.concatenate([[t], *now, data.qpos[3:7], touching, *forces]))
        mujoco.mj_step(model, data)
    n, table = robot.n, np.array(rows)
    q, torque, w, force, orientation, touching, forces = np.split(
        table[:, 1:], np.cumsum([n, n, 3, 3, 4, len(feet)]), axis=1
    )
    links = moving_base(robot).contact_links
    of_feet = dict(zip(links, forces.reshape(len(table), -1, 3).swapaxes(0, 1), strict=True))
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
            contacts={} if has_forces else dict(zip(links, touching.T, strict=True)),
            wrenches=of_feet if has_forces else {},
        ),
    )


def _force_on(model: Any, data: Any, place: int, geom: int) -> Array:
    """The force (3,) of a contact on the second of its two geoms, in the frame of the link."""
    found = np.empty(6)
    mujoco.mj_contactForce(model, data, place, found)
    world = data.contact[place].frame.reshape(3, 3).T @ found[:3]
    return np.asarray(data.xmat[model.geom_bodyid[geom]].reshape(3, 3).T @ world)
