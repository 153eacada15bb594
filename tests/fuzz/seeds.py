"""What the fuzzer starts from: valid contents of every kind, of one small robot and one motion."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

import seaid
from seaid._arrays import Array
from seaid.excitation.basis import make_basis
from seaid.excitation.trajectory import Trajectory
from seaid.log.motion import Motion
from seaid.log.reading import Log
from seaid.robot.robot import Robot
from tests.experiments import DATA, MODELS, arm, arm_log, wiggle
from tests.one_joint import BODY

ARM_URDF, ARM_DRIVES = DATA / "mixed_arm.urdf", DATA / "mixed_arm.toml"
URDFS = (ARM_URDF, MODELS / "tulip_leg.urdf", MODELS / "differential_wrist.urdf")
MESHES = ("stl", "stl_ascii", "obj", "ply", "off")

DRIVES = """
rail = { type = "stiff", gear_ratio_rad_per_m = 400.0, motor_inertia_kg_m2 = 2e-5, friction = [
  "viscous", "coulomb", "offset", "quadratic"], parallel_spring = ["linear", "preload"],
  viscous_friction_Nms_per_rad = 1e-4, known = ["viscous_friction"] }
[shoulder]
type = "series_elastic"
gear_ratio = 100.0
motor_inertia_kg_m2 = 4e-6
friction = ["viscous", "coulomb", "stribeck", "load"]
stribeck_speed_rad_per_s = 4.0
load_friction = 0.05
spring = ["linear", "cubic", "damping"]
stiffness_Nm_per_rad = 250.0
joint_friction = ["viscous"]
extra_terms = ["c*theta_M_dot**3"]
[telescope]
type = "series_elastic"
gear_ratio = 20.0
motor_pulley_radius_m = 0.02
spring = ["dead_zone", "linear"]
stiffness_N_per_m = 8000.0
dead_zone_m = 1e-3
[wrist]
type = "stiff"
gear_ratio = 50.0
motor_input = "current"
friction = ["viscous", "smooth_coulomb", "asymmetric"]
coulomb_width_rad_per_s = 0.1
""".replace("\n  ", " ").replace("[ ", "[")
"""Drives with a term of each kind."""

DESCRIPTION = 'time = { column = "t", unit = "s" }\nrepair = { longest_gap_s = 0.2 }\n' + "".join(
    f"""[joints.{joint}]
motor_position = {{ column = "mpos_{index}", sign = 1, wraps = 1000.0 }}
joint_position = {{ column = "pos_{index}", offset = 0.05, scale = 1.0 }}
motor_torque = {{ column = "tau_{index}", unit = "Nm", times = 1.0 }}
"""
    for index, joint in enumerate(("rail", "shoulder", "telescope", "wrist"))
)
"""What `foreign_columns` are."""

MESH = '<mesh filename="part.{}" scale="0.1 0.1 0.1"/>'
TWO_URDF = f"""<robot name="two">
<link name="ground"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="upper">{BODY}
  <collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="lower">{BODY}<collision><origin xyz="0.4 0 0" rpy="0 0.1 0"/>
  <geometry>SHAPE</geometry></collision></link>
<joint name="shoulder" type="revolute"><parent link="ground"/><child link="upper"/>
  <axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" velocity="3" effort="9"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
  <origin xyz="0.5 0 0"/><axis xyz="0 0 1"/></joint>
</robot>
"""
SRDF = """<robot name="two"><group name="all"><joint name="elbow"/></group>
<disable_collisions link1="ground" link2="upper" reason="Adjacent"/></robot>
"""

Files = dict[str, bytes]
"""The contents of a folder, by the paths in it."""


def files_in(folder: Path) -> Files:
    """Return all files in a folder and below it."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def written(write: Callable[[Path], Any]) -> Files:
    """Return the files that a function writes into a folder."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder))
        return files_in(Path(folder))


robot = arm
"""The arm with a drive of each kind."""


@cache
def small_robot(*joints: str) -> Robot:
    """Return a robot with the joints that a bag ("shoulder", "elbow") or a HEBI log has."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "two.urdf"
        path.write_text(TWO_URDF.replace("SHAPE", MESH))
        return seaid.load_robot(path, joints=joints)


@cache
def log() -> Log:
    """Return six seconds of the arm at 250 Hz."""
    full = arm_log(0)
    return full.at(np.arange(len(full.time)) % 4 == 0)


@cache
def motion() -> Motion:
    """Return the motion of the log, reconstructed."""
    return seaid.reconstruct_motion(robot(), log())


@cache
def columns() -> dict[str, Array]:
    """Return a short log by our column names: 300 samples at 50 Hz."""
    return {"time_s": log().time[::5], **{key: one[::5] for key, one in log().columns().items()}}


@cache
def foreign_columns() -> dict[str, Array]:
    """Return the same samples as another one's log has them."""
    names = {"time_s": "t"}
    for name in list(columns())[1:]:
        joint, _, quantity = name.partition(".")
        short = {"motor_p": "mpos", "joint_p": "pos", "motor_t": "tau"}[quantity[:7]]
        names[name] = f"{short}_{robot().index(joint)}"
    return {names[name]: values for name, values in columns().items()}


@cache
def log_file(name: str) -> bytes:
    """Return a log of the arm as a file; "other" is of another part of the motion."""
    start = 0 if name.startswith("run") else 400
    part = log().between(log().time[start], log().time[start + 1000])
    return written(lambda folder: seaid.write_log(part, folder / name))[name]


@cache
def parameters_text() -> str:
    """Return a parameters.json of the arm."""
    found = seaid.identify(robot(), log(), feasible=True)
    return written(lambda folder: seaid.write_parameters(found, folder / "a"))["a"].decode()


@cache
def saved_run() -> bytes:
    """Return a saved run of the arm, validated on its own log."""
    found = seaid.identify(robot(), log())
    tests = {"run.csv": seaid.validate(found, log())}
    origin = {"command": ["seaid", "run"], "inputs": [], "options": {}, "versions": {}}

    def save(folder: Path) -> None:
        seaid.save_run(found, folder / "a.npz", validations=tests, provenance=origin)

    return written(save)["a.npz"]


@cache
def trajectory_texts() -> tuple[str, ...]:
    """Return a trajectory file of each basis."""
    planned = [wiggle(robot(), 2.0, (0.0,) * 4, (0.2,) * 4, knot_s=0.5)]
    for kind in ("fourier", "polynomial"):
        basis, random = make_basis(kind, 2.0, 9), np.random.default_rng(0)
        values = random.uniform(-0.1, 0.1, (9, 4))
        planned.append(Trajectory(robot().joint_names, basis, values, ("rail", "telescope")))

    def save(folder: Path) -> None:
        for index, one in enumerate(planned):
            one.save(folder / str(index))

    return tuple(content.decode() for content in written(save).values())


@cache
def bags() -> tuple[Files, ...]:
    """Return bags with the states of two joints: SQLite, MCAP and of ROS 1."""
    kinds = (StoragePlugin.SQLITE3, StoragePlugin.MCAP)
    return (*(written(partial(_write_ros2, kind)) for kind in kinds), written(_write_ros1))


def _write_ros2(plugin: StoragePlugin, folder: Path) -> None:
    types: Any = get_typestore(Stores.ROS2_HUMBLE)
    with Writer2(folder / "bag", version=9, storage_plugin=plugin) as bag:
        _write_messages(bag, types, types.serialize_cdr, {})


def _write_ros1(folder: Path) -> None:
    types: Any = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(folder / "log.bag") as bag:
        _write_messages(bag, types, types.serialize_ros1, {"seq": 0})


def _write_messages(bag: Any, types: Any, serialize: Any, more: dict[str, int]) -> None:
    names = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    state, header, stamp = (types.types[name] for name in names)
    topic = bag.add_connection("/joint_states", names[0], typestore=types)
    for step in range(80):
        time, angles = 10**18 + step * 20_000_000, np.sin([0.1 * step, 0.13 * step])
        head = header(stamp=stamp(*divmod(time, 10**9)), frame_id="", **more)
        message = state(head, ["shoulder", "elbow"], angles, angles[:0], 3.0 * angles)
        bag.write(topic, time, serialize(message, names[0]))


@cache
def hebi_log() -> bytes:
    """Return a HEBI log of one module: frames of protobuf, as their own files have them."""
    module, start = bytes.fromhex("000041190a0a0ac3"), 1_531_147_238_241_654
    content = bytes.fromhex("73b1000200000001") + module + bytes.fromhex("73b10004") + bytes(8)
    for step in range(80):
        angle, time = float(np.sin(0.1 * step)), start + 10_000 * step
        turn = _field(2, angle)
        drive = b"".join(_field(key, angle) for key in (1, 2, 3, 6, 7, 8, 11))
        drive += _field(12, _field(1, 0) + turn) + _field(13, _field(1, step) + turn)
        clocks = _field(1, time) + _field(3, 10_000 * step) + _field(5, 10_000 * step + 80)
        message = clocks + _field(11, _field(3, 24.0) + _field(9, drive))
        body = struct.pack(">IQH", len(message) + 2, time, len(message)) + message
        content += bytes.fromhex("73b10001") + module + body
    return content


def _field(key: int, value: float | bytes) -> bytes:
    """Return a field of protobuf."""
    if isinstance(value, float):
        return _varint(key << 3 | 5) + struct.pack("<f", value)
    if isinstance(value, int):
        return _varint(key << 3) + _varint(value)
    return _varint(key << 3 | 2) + _varint(len(value)) + value


def _varint(value: int) -> bytes:
    return bytes([value]) if value < 128 else bytes([value & 127 | 128]) + _varint(value >> 7)


@cache
def mesh(kind: str) -> bytes:
    """Return a ball of triangles as a file of a kind."""
    content = trimesh.creation.icosphere(subdivisions=1).export(file_type=kind)
    return content.encode() if isinstance(content, str) else bytes(content)


def make_all() -> None:
    """Make what takes time, once a process."""
    for make in (motion, parameters_text, trajectory_texts, bags, foreign_columns):
        make()
    for name in ("run.npz", "other.npz"):
        log_file(name)
