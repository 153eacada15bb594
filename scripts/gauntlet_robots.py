"""The robots of the gauntlet: true files, true motions, and the files that a user would have.

Two robots are simulated by `seaid.simulate`, two by MuJoCo. The files of the user have the true
geometry, ratios and rotor inertias; masses, friction and stiffness in them are only nominal.
"""

from __future__ import annotations

import math
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import seaid
from scripts.gauntlet_legs import QUADRUPED, quadruped_columns, quadruped_files
from seaid._arrays import Array
from seaid._files import read_toml
from seaid.cli.kinds import payload_of
from seaid.drives import Drive, unit_of
from seaid.drives.terms import key_of
from seaid.errors import RobotError
from seaid.excitation import Trajectory, make_basis
from seaid.log import Motion
from seaid.regressor import joint_torques
from seaid.simulation import Noise
from seaid.simulation.controller import joint_controller
from seaid.simulation.plant import plant_of
from seaid.simulation.simulation import measure, simulate_motion

ROOT = Path(__file__).resolve().parents[1]
DURATION_S, RATE_HZ, KNOT_S = 8.0, 1000.0, 0.4

Tables = Mapping[str, Mapping[str, Any]]
"""A drive TOML as data."""

Columns = dict[str, Array]
"""A log as {column name of seaid: samples}."""


@dataclass(frozen=True)
class Subject:
    """A true robot, and the places of the mistakes in it.

    Attributes
    ----------
    name, urdf : str
        Its name, and its URDF as text.
    drives : mapping
        The true drives.
    payload, misplaced : str
        The payload of its logs as the command line has it; the same on a wrong link.
    joint, minor : str
        Joints for mistakes at one joint: an important one, and a less important one.
    pair, minor_pair : (str, str)
        Joints of the same kind to be exchanged: the heavy ones, and others if there are any.
    length : str
        The joint in whose origin the length of a link is.
    simulator : str
        "seaid" or "mujoco".
    base : mapping
        The options of `load_robot` of a floating base; empty for one that is held.
    """

    name: str
    urdf: str
    drives: Tables
    payload: str
    misplaced: str
    joint: str
    minor: str
    pair: tuple[str, str]
    minor_pair: tuple[str, str]
    length: str
    simulator: str = "seaid"
    base: Mapping[str, Any] = field(default_factory=dict)

    @property
    def elastic(self) -> list[str]:
        """Joints with springs."""
        return [joint for joint, one in self.drives.items() if one["type"] == "series_elastic"]

    @property
    def turning(self) -> tuple[str, str]:
        """A joint whose link has a length, and a joint before it; both turn."""
        return self.length, self.pair[0] if self.joint == self.length else self.joint


_JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/>
<origin xyz="{4}"/><axis xyz="{5}"/><limit lower="{6}" upper="{7}" velocity="{8}" effort="{9}"/>
</joint><link name="{3}"><inertial><origin xyz="{10}"/><mass value="{11}"/>
<inertia ixx="{12}" iyy="{13}" izz="{14}" ixy="{15}" ixz="0" iyz="0"/></inertial></link>
"""

_STIFF = (
    "yaw revolute base column;0 0 0.2;0 0 1;-2 2 6 150;0.01 0.02 0.08;4;0.04 0.04 0.02 0.001",
    "shoulder revolute column upper;0 0.1 0.1;0 1 0;-1.4 1.4 6 150;0.02 0.03 0.2;3;.06 .06 .01 0",
    "elbow revolute upper fore;0 0 0.4;0 1 0;-2 2 8 80;0.01 -0.02 0.15;2;0.03 0.03 0.004 0.001",
    "wrist revolute fore hand;0 0 0.3;1 0 0;-2 2 8 20;0.02 0.03 0.06;0.8;0.003 0.002 0.002 0",
)
_SCARA = (
    "first revolute base upper;0 0 0.4;0 0 1;-2 2 6 120;0.2 0.01 0;5;0.02 0.12 0.12 0.002",
    "second revolute upper fore;0.4 0 0;0 0 1;-2.2 2.2 8 60;0.15 0.02 0;3;0.01 0.05 0.05 0.001",
    "lift prismatic fore quill;0.3 0 0;0 0 1;-0.2 0 1 200;0.005 0 -0.05;1;0.004 0.004 0.001 0",
    "spin revolute quill tool;0 0 -0.1;0 0 1;-3 3 12 10;0.03 0.01 -0.02;0.5;.001 .001 .001 0",
)


def _urdf(name: str, joints: tuple[str, ...]) -> str:
    """Return the URDF of a chain from one line per joint."""
    rows = []
    for text in joints:
        names, origin, axis, limits, centre, mass, inertia = text.split(";")
        rows.append(
            _JOINT.format(
                *names.split(), origin, axis, *limits.split(), centre, mass, *inertia.split()
            )
        )
    return f'<robot name="{name}"><link name="base"/>{"".join(rows)}</robot>'


def _drive(kind: str, inertia: float, viscous: float, coulomb: float, **more: float) -> Any:
    friction = {"viscous_friction_Nms_per_rad": viscous, "coulomb_friction_Nm": coulomb}
    return {"type": kind, "motor_inertia_kg_m2": inertia, **more, **friction}


_STIFF_DRIVES = {
    "yaw": _drive("stiff", 3e-5, 3e-4, 0.03, gear_ratio=100.0),
    "shoulder": _drive("stiff", 3e-5, 3e-4, 0.03, gear_ratio=100.0),
    "elbow": _drive("stiff", 1e-5, 1e-4, 0.015, gear_ratio=80.0),
    "wrist": _drive("stiff", 2e-6, 2e-5, 0.004, gear_ratio=50.0),
}
_SCARA_DRIVES = {
    "first": _drive("series_elastic", 4e-5, 4e-4, 0.03, gear_ratio=50.0, stiffness_Nm_per_rad=2e3),
    "second": _drive("series_elastic", 2e-5, 2e-4, 0.02, gear_ratio=50.0, stiffness_Nm_per_rad=800),
    "lift": _drive("stiff", 1e-5, 1e-4, 0.01, gear_ratio_rad_per_m=300.0),
    "spin": _drive("stiff", 2e-6, 2e-5, 0.004, gear_ratio=20.0),
}


@cache
def subjects() -> dict[str, Subject]:
    """Return the true robots by name."""

    def files(urdf: str, drives: str) -> tuple[str, Tables]:
        return (ROOT / urdf).read_text("utf-8"), read_toml(ROOT / drives, "drives", RobotError)

    leg = files("models/tulip_leg.urdf", "models/tulip_leg.toml")
    arm = files("tests/data/mixed_arm.urdf", "tests/data/mixed_arm.toml")
    hips, pitches, wrists = ("hip_yaw", "hip_roll"), ("hip_pitch", "knee_pitch"), ("elbow", "wrist")
    both, last = ("rail", "telescope"), ("shoulder", "wrist")
    heavy, axes = ("yaw", "shoulder"), ("first", "second")
    found = [
        Subject("leg", *leg, "foot:2:0.15,0,0", "thigh:2:0,0,-0.2", "knee_pitch", "hip_roll",
                pitches, hips, "knee_pitch"),
        Subject("arm", *arm, "tool:1.5:0.1,0.05,-0.1", "carriage:1.5:0,0,0.1", "shoulder", "wrist",
                last, both, "wrist"),
        Subject("stiff", _urdf("stiff", _STIFF), _STIFF_DRIVES, "hand:2:0.05,0,0.1",
                "column:2:0,0,0.1", "shoulder", "wrist", heavy, wrists, "elbow", "mujoco"),
        Subject("scara", _urdf("scara", _SCARA), _SCARA_DRIVES, "tool:2:0.06,0,-0.05",
                "upper:2:0.2,0,0", "first", "spin", axes, ("second", "spin"), "second", "mujoco"),
    ]  # fmt: skip
    return {one.name: one for one in found}


@cache
def right_subjects() -> dict[str, Subject]:
    """Return the true robots of right set-ups: two more, a mimic joint and a floating base.

    One has a finger that follows its wrist, the other is a quadruped on the ground.
    """
    stiff = subjects()["stiff"]
    finger = _JOINT.format(
        *("finger", "revolute", "hand", "tip", "0.04 0 0.1", "0 1 0", -2, 2, 8, 20),
        *("0.02 0 0.05", 0.4, 1e-3, 1e-3, 5e-4, 0),
    ).replace("</joint>", '<mimic joint="wrist" multiplier="-0.5"/></joint>')
    urdf = stiff.urdf.replace("</robot>", f"{finger}</robot>")
    mimic = replace(stiff, name="mimic", urdf=urdf, simulator="seaid")
    return {**subjects(), "mimic": mimic, QUADRUPED: quadruped_subject()}


def quadruped_subject() -> Subject:
    """Return the quadruped, whose bodies, torques and feet alone are judged."""
    urdf, base = quadruped_files()
    joints = "FL_HAA", "FL_HFE"
    return Subject(QUADRUPED, urdf, {}, "", "", *joints, joints, joints, joints[1], "mujoco", base)


def load(
    urdf: str, drives: Tables | None, payloads: tuple[str, ...] = (), **options: Any
) -> seaid.Robot:
    """Load a robot from the text of its URDF, as a user loads it from files."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(urdf, "utf-8")
        given = [payload_of(text) for text in payloads]
        return seaid.load_robot(path, drives, payloads=given, **options)


TRUTHS = (
    *("plain", "bare", "light", "cubic20", "cubic5", "dead20", "dead5"),
    *("stribeck100", "stribeck30", "still", "slow", "damping20", "damping5"),
    *("hysteresis20", "hysteresis5", "parallel100", "parallel30", "preload100", "preload30"),
    *("constant100", "constant30", "tendon50", "tendon15", "differential"),
)
"""True robots and motions: with the payload, without it, with a quarter of it, and the share [%] of
what a linear model lacks, in the load for parallel springs, in the turns of the other joint for
coupled ones; motions of 0.2 and 5 % of the joint ranges."""

BY_SEAID = ("damping", "hysteresis", "parallel", "preload", "constant", "tendon", "differential")
"""Kinds of true robots that seaid simulates, whatever simulates the plain one."""


def true_payload(subject: Subject, truth: str) -> tuple[str, ...]:
    """Return the payload that the true robot has."""
    if truth == "bare" or not subject.payload:
        return ()
    return (heavier(subject.payload, 0.25 if truth == "light" else 1.0),)


def heavier(payload: str, factor: float) -> str:
    """Return a payload with another mass."""
    link, mass, place = payload.split(":")
    return f"{link}:{factor * float(mass):g}:{place}"


def true_drives(subject: Subject, truth: str) -> Tables:
    """Return the true drives: nonlinear springs and Stribeck friction as the truth says."""
    kind, share = truth.rstrip("0123456789"), int("0" + "".join(filter(str.isdigit, truth))) / 100
    drives = deepcopy({joint: dict(table) for joint, table in subject.drives.items()})
    if kind in ("cubic", "dead", "damping", "hysteresis"):
        robot = load(subject.urdf, subject.drives, true_payload(subject, truth))
        motion = true_motion(subject.name, "plain", 0)
        for joint in subject.elastic:
            stretch = deflection(robot, motion, joint)
            peak = float(np.max(np.abs(stretch)))
            drive = robot.drives[joint]
            if kind in ("cubic", "dead"):
                drives[joint] |= _nonlinear(drives[joint], kind, share, peak)
            else:
                drives[joint] |= _lossy(drive, kind, share, peak, np.gradient(stretch) * RATE_HZ)
    if kind in ("parallel", "preload", "constant"):
        drives[subject.joint] |= _parallel(subject, kind, share)
    if kind in ("tendon", "differential"):
        joint, other = subject.turning
        drives[joint]["transmission"] = {joint: 1.0, other: -share if share else 1.0}
        if not share:
            drives[other]["transmission"] = {other: 1.0, joint: -1.0}
    if kind == "stribeck":
        for joint, table in drives.items():
            speed = true_motion(subject.name, "plain", 0).motor_velocity
            fast = float(np.max(np.abs(speed[:, list(drives).index(joint)])))
            table["friction"] = ["viscous", "coulomb", "stribeck"]
            table["stribeck_friction_Nm"] = share * table["coulomb_friction_Nm"]
            table["stribeck_speed_rad_per_s"] = 0.1 * fast
    return drives


def _nonlinear(table: dict[str, Any], kind: str, share: float, peak: float) -> dict[str, Any]:
    """Return a cubic term with a share of the force at the peak, or play of a share of the peak."""
    is_rotary = "stiffness_Nm_per_rad" in table
    if kind == "dead":
        key = "dead_zone_rad" if is_rotary else "dead_zone_m"
        return {"spring": ["linear", "dead_zone"], key: share * peak}
    stiffness = table["stiffness_Nm_per_rad" if is_rotary else "stiffness_N_per_m"]
    key = "cubic_stiffness_Nm_per_rad3" if is_rotary else "cubic_stiffness_N_per_m3"
    return {"spring": ["linear", "cubic"], key: share * stiffness / peak**2}


def _keyed(drive: Drive, values: Mapping[str, float]) -> dict[str, Any]:
    """Return values of parameters with the keys of a drive TOML, which have their units."""
    return {key_of(name, unit_of(drive, name)): value for name, value in values.items()}


def _lossy(drive: Drive, kind: str, share: float, peak: float, rate: Array) -> dict[str, Any]:
    """Return damping, or hysteresis, of a spring with a share of its largest force."""
    force, terms = share * drive.values["stiffness"] * peak, ["linear", "dahl"]
    values = {"hysteresis_force": force, "hysteresis_deflection": 0.1 * peak}
    if kind == "damping":
        values, terms = {"spring_damping": force / float(np.max(np.abs(rate)))}, ["linear", kind]
    spring: dict[str, Any] = {"spring": tuple(terms)}
    return {"spring": terms} | _keyed(replace(drive, **spring), values)


def _parallel(subject: Subject, kind: str, share: float) -> dict[str, Any]:
    """Return a spring parallel to the important joint, with a share of the rms load.

    One with a preload pulls by as much where it is shortest; a constant one has no stiffness.
    """
    robot, motion = true_robot(subject.name, "plain"), true_motion(subject.name, "plain", 0)
    states = (motion.joint_position, motion.joint_velocity, motion.joint_acceleration)
    index = robot.index(subject.joint)
    load = joint_torques(robot, *(state[::5] for state in states))[:, index]
    force = share * float(np.sqrt(np.mean(load**2)))
    values = {"parallel_stiffness": force / float(np.std(states[0][:, index]))}
    if kind != "parallel":
        values["parallel_preload"] = force
    if kind == "constant":
        del values["parallel_stiffness"]
    terms: dict[str, Any] = {
        "parallel": ["linear"],
        "preload": ["linear", "preload"],
        "constant": ["preload"],
    }
    drive = replace(robot.drives[subject.joint], parallel_spring=tuple(terms[kind]))
    return {"parallel_spring": terms[kind]} | _keyed(drive, values)


def deflection(robot: seaid.Robot, motion: Motion, joint: str) -> Array:
    """Return the deflection (T,) of a spring, (3)."""
    drive, index = robot.drives[joint], robot.index(joint)
    motor = drive.motor_radius / drive.ratio * motion.motor_position[:, index]
    return np.asarray(motor - drive.load_radius * motion.joint_position[:, index])


@cache
def true_robot(name: str, truth: str) -> seaid.Robot:
    """Return a true robot."""
    subject = right_subjects()[name]
    drives, payloads = true_drives(subject, truth), true_payload(subject, truth)
    return load(subject.urdf, drives, payloads, **subject.base)


def commanded(name: str, motion: int, log: Columns, drives: Tables) -> tuple[Columns, Tables]:
    """Return a log with the position commands that make the torques, and drives with the gains.

    With tau = K_p (u - q) - K_d q' at the joint, u = q + (N tau_M + K_d q') / K_p. Drives are
    stiff, and turn.
    """
    robot, true = true_robot(name, "plain"), true_motion(name, "plain", motion)
    usual = true_motion(name, "plain", 0)  # all logs have the same gains
    found, tables = dict(log), {joint: dict(table) for joint, table in drives.items()}
    for index, (joint, drive) in enumerate(robot.drives.items()):
        q, v = true.motor_position[:, index] / drive.ratio, true.motor_velocity[:, index]
        torque = drive.ratio * true.motor_torque[:, index]
        gain = 20.0 * float(np.std(usual.motor_torque[:, index]) * drive.ratio**2)
        gain /= float(np.std(usual.motor_position[:, index]))
        command = q + (torque + 0.05 * gain * v / drive.ratio) / gain
        del found[f"{joint}.motor_torque_Nm"], found[f"{joint}.motor_position_rad"]
        found[f"{joint}.position_command_rad"] = command
        tables[joint] |= {
            "motor_input": "position_command",
            "controller": {
                "position_gain_Nm_per_rad": gain,
                "velocity_gain_Nms_per_rad": 0.05 * gain,
            },
        }
    return found, tables


@cache
def true_motion(name: str, truth: str, seed: int) -> Motion:
    """Return the true motion of a robot, simulated once per process."""
    subject, robot = right_subjects()[name], true_robot(name, truth)
    reach = {"still": 0.002, "slow": 0.05}.get(truth, 0.8)
    trajectory = wiggle(robot, reach, seed)
    by_mujoco = subject.simulator == "mujoco" and truth.rstrip("0123456789") not in BY_SEAID
    simulate = mujoco_motion if by_mujoco else simulate_motion
    return simulate(robot, trajectory)


def wiggle(robot: seaid.Robot, share: float, seed: int) -> Trajectory:
    """Return a smooth random motion, rest to rest, in a share of the joint ranges."""
    basis = make_basis("bspline", DURATION_S, round(DURATION_S / KNOT_S) + 5)
    random = np.random.default_rng(seed).uniform(-1, 1, (basis.size - 4, robot.n))
    middle = (robot.lower_limits + robot.upper_limits) / 2
    reach = share * (robot.upper_limits - robot.lower_limits) / 2
    # the hull of the control points contains the curve; three equal ones at either end: rest
    coefficients = np.pad(middle + reach * random, ((2, 2), (0, 0)), mode="edge")
    sliding = tuple(np.array(robot.joint_names)[list(robot.is_prismatic)].tolist())
    return Trajectory(robot.joint_names, basis, coefficients, sliding)


_WIDTH_RAD_S, _SETTLE_S = 0.2, 1.0
"""Smoothing of the friction in MuJoCo; rest before the log begins."""


def mujoco_motion(robot: seaid.Robot, trajectory: Trajectory) -> Motion:
    """Return the motion that MuJoCo simulates; friction and nonlinear springs act explicitly."""
    import mujoco

    q, v, a = (rows for rows in trajectory.sample(np.arange(0, DURATION_S, 1 / RATE_HZ)))
    settle = round(_SETTLE_S * RATE_HZ)
    q = np.concatenate([np.repeat(q[:1], settle, axis=0), q])
    v, a = (np.pad(rows, ((settle, 0), (0, 0))) for rows in (v, a))
    controller = joint_controller(plant_of(robot), q, v, a, RATE_HZ)
    model = _mujoco_model(robot)
    steps = math.ceil(1 / (RATE_HZ * model.opt.timestep))
    model.opt.timestep = 1 / (RATE_HZ * steps)
    data = mujoco.MjData(model)
    forces = _Forces(robot, model)
    data.qpos[forces.joint], data.qpos[forces.motor] = q[0], controller.motor_position[0]
    data.qpos[forces.joint] = q[0]  # a stiff motor is no coordinate of its own
    position, torques, states = np.empty_like(q), np.empty_like(q), np.empty((3, *q.shape))
    torque, speed, previous = controller.feedforward[0], np.zeros(robot.n), None
    for tick in range(len(q)):
        mujoco.mj_forward(model, data)
        position[tick], torques[tick] = forces.motor_angle(data.qpos), torque
        states[:, tick] = [one[forces.joint] for one in (data.qpos, data.qvel, data.qacc)]
        if previous is not None:
            change = (position[tick] - previous) * RATE_HZ
            speed = speed + controller.velocity_filter * (change - speed)
        previous = position[tick]
        command = controller.torque(tick, position[tick], speed)
        for step in range(steps):
            data.ctrl[forces.actuator] = torque + (command - torque) * (step + 0.5) / steps
            data.qfrc_applied[:] = forces.applied(data.qpos, data.qvel)
            mujoco.mj_step(model, data)
        torque = command
    nothing = np.full_like(q, np.nan)[settle:]
    motor_speed = np.gradient(position, 1 / RATE_HZ, axis=0)[settle:]
    return Motion(
        time=np.arange(len(q) - settle) / RATE_HZ,
        joint_names=robot.joint_names,
        joint_position=states[0, settle:],
        joint_velocity=states[1, settle:],
        joint_acceleration=states[2, settle:],
        motor_position=position[settle:],
        motor_velocity=motor_speed,
        motor_acceleration=np.gradient(motor_speed, 1 / RATE_HZ, axis=0),
        motor_torque=torques[settle:],
        joint_torque=nothing,
        cutoff_hz=math.inf,
    )


def _mujoco_model(robot: seaid.Robot) -> Any:
    """Return the MuJoCo model of bodies, rotors and linear springs, without friction."""
    import mujoco

    bare = {}
    for joint, drive in robot.drives.items():
        values = {"viscous_friction": 0.0, "coulomb_friction": 0.0}
        terms: dict[str, Any] = {"friction": ("viscous", "coulomb"), "nominal": {}}
        terms |= {"spring": ("linear",)} if drive.is_elastic else {}
        kept = {name: one for name, one in drive.values.items() if name == "stiffness"}
        bare[joint] = replace(drive, **terms).with_values(values | kept)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.xml"
        seaid.write_mjcf(robot.with_drives(bare), path)
        return mujoco.MjModel.from_xml_path(str(path))


class _Forces:
    """Friction of the motors, and what their springs have besides k d, at MuJoCo's coordinates."""

    def __init__(self, robot: seaid.Robot, model: Any) -> None:
        names, drives = robot.joint_names, [robot.drives[joint] for joint in robot.joint_names]
        self.elastic = np.array([drive.is_elastic for drive in drives])
        motors = [f"{one}_motor" if e else one for one, e in zip(names, self.elastic, strict=True)]
        self.joint = np.array([model.joint(one).qposadr[0] for one in names])
        self.motor = np.array([model.joint(one).qposadr[0] for one in motors])
        self.actuator = np.array([model.actuator(one).id for one in names])
        self.ratio = np.array([drive.ratio for drive in drives])
        self.lever = np.array([drive.motor_radius / drive.ratio for drive in drives])
        self.load_radius = np.array([drive.load_radius for drive in drives])
        self.size = model.nv

        def value(name: str, otherwise: float = 0.0) -> Array:
            return np.array([drive.values.get(name, otherwise) for drive in drives])

        self.viscous, self.coulomb = value("viscous_friction"), value("coulomb_friction")
        self.stribeck, self.slow = value("stribeck_friction"), value("stribeck_speed", 1.0)
        self.cubic, self.play = value("cubic_stiffness"), value("dead_zone")
        self.stiffness = value("stiffness")

    def motor_angle(self, coordinates: Array) -> Array:
        """Return the motor angles, or speeds (n,), of MuJoCo's coordinates."""
        turned = self.ratio * coordinates[self.joint]
        return np.asarray(np.where(self.elastic, coordinates[self.motor], turned))

    def applied(self, position: Array, velocity: Array) -> Array:
        """Return the generalised forces."""
        angle, speed = self.motor_angle(position), self.motor_angle(velocity)
        dry = self.coulomb + self.stribeck * np.exp(-((speed / self.slow) ** 2))
        friction = self.viscous * speed + dry * np.tanh(speed / _WIDTH_RAD_S)
        stretch = self.lever * angle - self.load_radius * position[self.joint]
        # k (d - clip(d)) + k_3 d^3 = k d + what is not linear
        more = self.cubic * stretch**3 - self.stiffness * np.clip(stretch, -self.play, self.play)
        more = np.where(self.elastic, more, 0.0)
        found = np.zeros(self.size)
        scale = np.where(self.elastic, 1.0, self.ratio)
        np.add.at(found, self.motor, -scale * friction - self.lever * more)
        np.add.at(found, self.joint, self.load_radius * more)
        return found


@dataclass(frozen=True)
class Sensors:
    """The sensors of an experiment: steps of the encoders, and noise as a share of the torque."""

    motor_counts: float = 2000.0
    joint_counts: float = 2.0**14
    noise: float = 0.01
    seed: int = 0


def columns(name: str, truth: str, motion: int, sensors: Sensors) -> Columns:
    """Return the log of a true motion, with white torque noise and motor encoder offsets."""
    if name == QUADRUPED:
        return quadruped_columns(motion, sensors.seed if sensors.noise else None)
    robot, true = true_robot(name, truth), true_motion(name, truth, motion)
    rng = np.random.default_rng((sensors.seed, 7))
    step = 2 * np.pi / sensors.joint_counts
    resolution = np.where(robot.is_prismatic, step / 20, step)
    plain = true_motion(name, "plain", 0).motor_torque
    noise = Noise(
        motor_resolution_rad=2 * np.pi / sensors.motor_counts,
        joint_resolution_rad=tuple(resolution.tolist()),
        motor_offset_rad=tuple(rng.uniform(-3, 3, robot.n).tolist()),
        torque_std_Nm=tuple((sensors.noise * np.std(plain, axis=0)).tolist()),
    )
    log = measure(robot, true, noise, 1000 * sensors.seed + motion)
    channels = {name: np.array(samples) for name, samples in log.columns().items()}
    return {"time_s": np.array(log.time), **channels}


MASSES_OFF = 0.15
"""Largest relative error of a nominal mass."""


def nominal_urdf(urdf: str, rng: np.random.Generator, spread: float = MASSES_OFF) -> str:
    """Return a URDF whose masses and inertias are off by a share, as those of CAD are."""
    tree = ElementTree.fromstring(urdf)
    for body in tree.iter("inertial"):
        factor = rng.uniform(1 - spread, 1 + spread)
        for element in (body.find("mass"), body.find("inertia")):
            assert element is not None
            for key, value in element.attrib.items():
                element.set(key, f"{factor * float(value):.9g}")
    return ElementTree.tostring(tree, encoding="unicode")


def nominal_drives(drives: Tables, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Return drives whose stiffness is off by up to 20 %, friction by up to a factor of two."""
    found = {joint: dict(table) for joint, table in drives.items()}
    for table in found.values():
        for key in table:
            if key.startswith("stiffness"):
                table[key] *= float(rng.uniform(0.8, 1.2))
            elif "friction_N" in key:
                table[key] *= float(2 ** rng.uniform(-1, 1))
    return found
