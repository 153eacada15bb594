"""Identify a biped with springs in six joints, in simulation: hanging, standing, both at once.

Two TULip legs (models/tulip_leg.urdf, the right one mirrored) carry a trunk of 3 kg. The ankles
also roll, with a measured torque. MuJoCo simulates bodies and contacts, this script the motors
behind the springs. Hanging, the trunk is held and the legs swing; standing, both soles stay on the
ground and the trunk sways. `python scripts/identify_biped.py --help` lists all options.
"""

from __future__ import annotations

import argparse
import copy
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

import seaid
from seaid._arrays import Array
from seaid._files import result_folder
from seaid.drives import IDEAL_DRIVE, total_ratio
from seaid.legged.floating import contact_map, floating_regressor
from seaid.log import BaseLog
from seaid.report import warning_lines
from seaid.report.text import drive_table, load_table
from seaid.robot import Contact

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

MODELS = Path(__file__).resolve().parents[1] / "models"
SIDES = ("left", "right")
LEG = ("hip_yaw", "hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch", "ankle_roll")
SOLE_M = (0.04, 0.0, -0.05)
"""The middle of a sole in the frame of the foot, and so the place of a contact."""

FEET = [Contact(f"{side}_foot", SOLE_M, is_flat=True) for side in SIDES]
_HIP_M, _STEP_S, _RATE_HZ, _PLAN_HZ = 0.03, 2.5e-4, 500.0, 50.0
_TRUNK = (
    '<inertial><origin xyz="-0.01 0.004 0.10" rpy="0.1 0.05 0.2"/><mass value="3.0"/>'
    '<inertia ixx="0.025" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.018"/></inertial>'
)
_ANKLE = (
    '<link name="ankle"><inertial><mass value="0.045"/><inertia ixx="2e-5" ixy="0" ixz="0" '
    'iyy="2e-5" iyz="0" izz="2e-5"/></inertial></link>'
)
_ANKLE_ROLL = (
    '<joint name="ankle_roll" type="revolute"><parent link="ankle"/><child link="foot"/>'
    '<axis xyz="1 0 0"/><limit lower="-0.4" upper="0.4" velocity="6" effort="10"/></joint>'
)


def write_biped(folder: Path) -> tuple[Path, Path]:
    """Write URDF and drives of the biped from those of the leg, and return their paths."""
    leg = ET.parse(MODELS / "tulip_leg.urdf").getroot()
    trunk = leg.find("link[@name='trunk']")
    ankle = leg.find("joint[@name='ankle_pitch']/child")
    assert trunk is not None
    assert ankle is not None
    trunk.append(ET.fromstring(_TRUNK))
    ankle.set("link", "ankle")
    leg.extend([ET.fromstring(_ANKLE), ET.fromstring(_ANKLE_ROLL)])
    biped = ET.Element("robot", name="tulip_biped")
    biped.extend([*leg.findall("material"), trunk])
    for side in SIDES:
        for one in [*leg.findall("link"), *leg.findall("joint")]:
            if one is not trunk:
                biped.append(_of_side(copy.deepcopy(one), side))
    drives = (MODELS / "tulip_leg.toml").read_text(encoding="utf-8")
    urdf, toml = folder / "tulip_biped.urdf", folder / "tulip_biped.toml"
    urdf.write_bytes(ET.tostring(biped))
    toml.write_text("\n".join(drives.replace("\n[", f"\n[{side}_") for side in SIDES))
    return urdf, toml


def _of_side(one: ET.Element, side: str) -> ET.Element:
    """Return a link or joint of the left leg with names of a side, the right one mirrored in y."""
    one.set("name", f"{side}_{one.attrib['name']}")
    for end in (*one.findall("parent"), *one.findall("child")):
        if end.attrib["link"] != "trunk":
            end.set("link", f"{side}_{end.attrib['link']}")
        elif end.tag == "parent":
            one.find("origin").set("xyz", f"0 {_HIP_M} 0")  # type: ignore[union-attr]
    if side == "right":
        for origin in one.iter("origin"):
            for name, signs in (("xyz", (1, -1, 1)), ("rpy", (-1, 1, -1))):
                if name in origin.attrib:
                    values = np.array(origin.attrib[name].split(), float) * signs
                    origin.set(name, " ".join(map(repr, values.tolist())))
        limit = one.find("limit")
        if limit is not None and one.attrib["name"].endswith(("yaw", "roll")):
            lower, upper = (-float(limit.attrib[x]) for x in ("upper", "lower"))
            limit.set("lower", repr(lower))
            limit.set("upper", repr(upper))
    return one


def plant(urdf: Path, robot: seaid.Robot, is_held: bool) -> Any:
    """Return the biped in MuJoCo with the rotors and friction of its rigid drives."""
    root = ET.fromstring(urdf.read_bytes())
    ET.SubElement(
        ET.SubElement(root, "mujoco"),
        "compiler",
        {"fusestatic": "false", "discardvisual": "true"},
    )
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    spec = mujoco.MjSpec.from_string(ET.tostring(root).decode())
    if not is_held:
        spec.body("trunk").add_freejoint()
        for side in SIDES:
            sole = spec.body(f"{side}_foot").add_geom(type=mujoco.mjtGeom.mjGEOM_BOX)
            sole.size, sole.mass, sole.friction = [0.1, 0.045, 0.01], 0.0, [1.0, 0.1, 0.01]
            sole.pos, sole.condim = [SOLE_M[0], SOLE_M[1], SOLE_M[2] + 0.01], 4
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1])
    spec.option.timestep, spec.option.integrator = _STEP_S, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model = spec.compile()
    model.jnt_limited[:] = 0
    for joint, drive in robot.drives.items():
        if not drive.is_elastic and drive != IDEAL_DRIVE:
            own, ratio = model.joint(joint).dofadr[0], drive.ratio
            model.dof_armature[own] = drive.values["motor_inertia"] * ratio**2
            model.dof_damping[own] = drive.values["viscous_friction"] * ratio**2
            model.dof_frictionloss[own] = drive.values["coulomb_friction"] * ratio
    model.geom_solref[:], model.geom_solimp[:] = (0.004, 1.0), (0.95, 0.99, 0.001, 0.5, 2.0)
    return model


def _waves(rng: np.random.Generator, time: Array, sizes: Any, fastest_hz: float) -> Array:
    """Return sums (T, k) of four sines each that begin gently."""
    begin = np.clip(time / 2, 0, 1) ** 2 * (3 - 2 * np.clip(time / 2, 0, 1))
    found = np.zeros((len(time), len(sizes)))
    for _ in range(4):
        turn = 2 * np.pi * rng.uniform(0.1, fastest_hz, len(sizes))
        found += np.sin(np.outer(time, turn) + rng.uniform(0, 6, len(sizes))) / 3
    return np.asarray(found * begin[:, None] * np.array(sizes))


def hanging_plan(duration_s: float, seed: int) -> tuple[Array, Array, Array]:
    """Return times, joint angles and torques of zero (T, 12) of the swinging legs."""
    rng, time = np.random.default_rng(seed), np.arange(0, duration_s, 1 / _PLAN_HZ)
    middle = [0.0, 0.1, -0.3, 0.7, 0.0, 0.0, 0.0, -0.1, -0.3, 0.7, 0.0, 0.0]
    sizes = 2 * [0.4, 0.2, 0.5, 0.5, 0.4, 0.2]
    angles = np.array(middle) + _waves(rng, time, sizes, 1.2)
    return time, angles, 0 * angles


def standing_plan(robot: seaid.Robot, duration_s: float, seed: int) -> tuple[Array, Array, Array]:
    """Return times, joint angles and static torques (T, 12) of a trunk that sways over its feet."""
    rng, time = np.random.default_rng(seed), np.arange(0, duration_s, 1 / _PLAN_HZ)
    sway = _waves(rng, time, (0.012, 0.012, 0.02, 0.05, 0.08, 0.1), 0.7)
    model = robot.model
    data, joints = model.createData(), [model.getJointId(f"{x}_ankle_roll") for x in SIDES]
    q, found = robot.to_model(np.array([2 * [0.0, 0.0, -0.4, 0.83, -0.43, 0.0]]))[0], []
    pin.forwardKinematics(model, data, q)
    feet = [data.oMi[joint].translation - [0.02, 0, 0] for joint in joints]
    for x in sway:
        trunk = pin.SE3(pin.rpy.rpyToMatrix(*x[3:]), x[:3])
        for _ in range(8):
            pin.forwardKinematics(model, data, q)
            for joint, foot in zip(joints, feet, strict=True):
                wanted = trunk.inverse() * pin.SE3(np.eye(3), foot)
                error = pin.log6(data.oMi[joint].inverse() * wanted).vector
                J = pin.computeJointJacobian(model, data, q, joint)
                q = q + np.linalg.pinv(J) @ error
        found.append(robot.from_model(q))
    angles, still = np.array(found), np.zeros((len(time), robot.n))
    up = np.array([pin.rpy.rpyToMatrix(*x[3:])[2] for x in sway])
    rows = floating_regressor(robot, angles, still, still, (0 * up, 0 * up, 9.81 * up))
    rows = rows @ robot.parameters
    A = contact_map(robot, angles, FEET)
    forces = np.einsum("tkr,tr->tk", np.linalg.pinv(A[:, :6]), rows[:, :6])
    return time, angles, (rows - np.einsum("trk,tk->tr", A, forces))[:, 6:]


def simulate(
    robot: seaid.Robot, model: Any, plan: tuple[Array, Array, Array], seed: int
) -> seaid.Log:
    """Return the log of encoders, motor torques and, of a biped that stands, of the IMU."""
    n, wanted, data = robot.n, CubicSpline(*plan[:2]), mujoco.MjData(model)
    holding = CubicSpline(plan[0], plan[2])
    rates, own = wanted.derivative(), [model.joint(name) for name in robot.joint_names]
    places, dofs = [x.qposadr[0] for x in own], [x.dofadr[0] for x in own]
    drives = list(robot.drives.values())
    elastic = np.array([drive.is_elastic for drive in drives])
    ratio = np.array([total_ratio(drive) for drive in drives])

    def value(name: str) -> Array:
        values = np.array([drive.values.get(name, 0.0) for drive in drives])
        return np.asarray(values[elastic])

    # coordinates of the joints: phi = theta_M / ratio, k r_L^2
    N, e = ratio[elastic], np.flatnonzero(elastic)
    radius = np.array([drive.load_radius for drive in drives])[elastic]
    rotor, drag, dry = value("motor_inertia"), value("viscous_friction"), value("coulomb_friction")
    k = value("stiffness") * radius**2
    is_held = model.nq == n
    data.qpos[places] = wanted(0.0)
    if not is_held:
        data.qpos[3:7] = [1, 0, 0, 0]
        mujoco.mj_forward(model, data)
        data.qpos[2] -= np.min(_soles(model, data))
    motor, speed = data.qpos[places][e] + holding(0.0)[e] / k, np.zeros(len(e))
    geared = np.array([drive != IDEAL_DRIVE for drive in drives])
    stiffness, damping = np.where(geared, 200.0, 30.0), np.where(geared, 5.0, 0.3)
    every, rows = round(1 / (_RATE_HZ * _STEP_S)), []
    steps = np.arange(-round(2 / _STEP_S), round((plan[0][-1] - 0.02) / _STEP_S))
    time = np.maximum(steps * _STEP_S, 0.0)
    plans = wanted(time), rates(time) * (steps > 0)[:, None], holding(time)
    for step, t, angle, faster, held in zip(steps.tolist(), time, *plans, strict=True):
        q, v = data.qpos[places], data.qvel[dofs]
        command = stiffness * (angle - q) + damping * (faster - v) + held
        spring = k * (motor - q[e])
        torque = command / ratio
        # the motors behind springs lead by the deflections of the planned motion
        ahead = angle[e] + held[e] / k
        torque[e] = (600 * (ahead - motor) + 30 * (faster[e] - speed) + held[e]) / N
        data.qfrc_applied[dofs] = np.where(elastic, 0.0, ratio * torque)
        data.qfrc_applied[np.array(dofs)[e]] = spring
        if step >= 0 and step % every == 0:
            mujoco.mj_forward(model, data)
            now = [[t], q.copy(), torque.copy(), N * motor]
            if not is_held:
                R = data.xmat[model.body("trunk").id].reshape(3, 3)
                now += [data.qvel[3:6], R.T @ (data.qacc[:3] - model.opt.gravity)]
            rows.append(np.concatenate(now))
        # dry friction holds a motor that it can stop within the step
        free = N * speed + _STEP_S / rotor * (torque[e] - spring / N - drag * N * speed)
        slid = np.sign(free) * np.maximum(np.abs(free) - dry * _STEP_S / rotor, 0.0)
        speed = slid / N
        motor = motor + _STEP_S * speed
        mujoco.mj_step(model, data)
    return _log(robot, np.array(rows), elastic, seed)


def _soles(model: Any, data: Any) -> Array:
    """Return the heights of the soles."""
    boxes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
    return np.asarray(data.geom_xpos[boxes, 2] - model.geom_size[boxes, 2])


def _log(robot: seaid.Robot, table: Array, elastic: Array, seed: int) -> seaid.Log:
    """Return the log with the noise of encoders, torques and IMU."""
    rng, n, count = np.random.default_rng(seed), robot.n, len(table)
    time, q, torque, motor, imu = np.split(table, np.cumsum([1, n, n, np.sum(elastic)]), axis=1)
    motors = np.full_like(q, np.nan)
    motors[:, elastic] = np.round(motor / (2 * np.pi / 2000)) * (2 * np.pi / 2000)
    of_motor = [drive != IDEAL_DRIVE for drive in robot.drives.values()]
    base = None
    if imu.shape[1]:
        base = BaseLog(
            angular_velocity=imu[:, :3] + 0.003 * rng.normal(size=(count, 3)),
            specific_force=imu[:, 3:] + 0.05 * rng.normal(size=(count, 3)),
            contacts={foot.link: np.ones(count) for foot in FEET},
        )
    return seaid.Log(
        time=time[:, 0],
        joint_names=robot.joint_names,
        joint_position=q + 1e-4 * rng.normal(size=q.shape),
        motor_position=motors,
        motor_torque=torque + np.where(of_motor, 0.004, 0.05) * rng.normal(size=q.shape),
        base=base,
    )


def main(output: Path, seed: int, duration_s: float) -> None:
    """Hang, identify, stand, identify, compare, write."""
    result_folder(output)
    urdf, toml = write_biped(output)
    held = seaid.load_robot(urdf, drives=toml)
    standing = seaid.load_robot(urdf, drives=toml, base="floating", contacts=FEET)
    hang = hanging_plan(duration_s, seed)
    log = simulate(held, plant(urdf, held, True), hang, seed)
    hanging = log
    legs = seaid.identify(held.without_nominal(), log)
    print(drive_table("Hanging: drives", legs, held))
    stand = standing_plan(standing, duration_s, seed + 1)
    log = simulate(standing, plant(urdf, standing, False), stand, seed + 1)
    whole = seaid.identify(standing.without_nominal(), log)
    print(drive_table("Standing on two flat feet: drives", whole, standing))
    print(load_table("Standing: base parameters of the whole robot", whole, standing))
    robot = seaid.load_robot(
        urdf, drives=toml, base="floating", contacts=[*FEET, Contact("trunk", is_flat=True)]
    )
    assert log.base is not None
    free = replace(log.base, contacts={**log.base.contacts, "trunk": np.zeros(len(log.time))})
    held_base = BaseLog.hanging(robot, len(hanging.time))
    both = seaid.identify(
        robot.without_nominal(), [replace(hanging, base=held_base), replace(log, base=free)]
    )
    print(drive_table("Both logs at once: drives", both, robot))
    for name, found in (("hanging", legs), ("standing", whole), ("both", both)):
        print(f"{name}: {len(found.load.values)} base parameters, {found.verdict.sentence}")
        print("\n".join(warning_lines(found.warnings)))
        seaid.write_parameters(found, output / f"{name}.json")
    seaid.write_report(whole, output / "report.html")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("biped"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--duration", type=float, default=20.0)
    options = parser.parse_args()
    main(options.output, options.seed, options.duration)
