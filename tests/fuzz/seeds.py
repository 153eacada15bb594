"""What the fuzzer starts from: valid contents of every kind, of one small robot and one motion."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

import seaid
from seaid.arrays import Array
from seaid.excitation.basis import make_basis
from seaid.excitation.trajectory import Trajectory
from seaid.log import Log
from seaid.motion import Motion
from seaid.robot import Robot
from seaid.simulation import measure
from tests.experiments import ARM_SENSORS, DATA, arm, arm_motion, wiggle

MODELS = DATA.parents[1] / "models"
ARM_URDF, ARM_DRIVES = DATA / "mixed_arm.urdf", DATA / "mixed_arm.toml"
URDFS = (ARM_URDF, MODELS / "tulip_leg.urdf", MODELS / "differential_wrist.urdf")

DRIVES: dict[str, Any] = {
    "rail": {
        "type": "stiff",
        "gear_ratio_rad_per_m": 400.0,
        "motor_inertia_kg_m2": 2e-5,
        "friction": ["viscous", "coulomb", "offset", "quadratic"],
        "parallel_spring": ["linear", "preload"],
        "viscous_friction_Nms_per_rad": 1e-4,
        "known": ["viscous_friction"],
    },
    "shoulder": {
        "type": "series_elastic",
        "gear_ratio": 100.0,
        "motor_inertia_kg_m2": 4e-6,
        "stiffness_Nm_per_rad": 250.0,
        "friction": ["viscous", "coulomb", "stribeck", "load"],
        "spring": ["linear", "cubic", "damping"],
        "joint_friction": ["viscous"],
        "stribeck_speed_rad_per_s": 4.0,
        "load_friction": 0.05,
        "extra_terms": ["c*theta_M_dot**3"],
    },
    "telescope": {
        "type": "series_elastic",
        "gear_ratio": 20.0,
        "motor_pulley_radius_m": 0.02,
        "stiffness_N_per_m": 8000.0,
        "spring": ["dead_zone", "linear"],
        "dead_zone_m": 1e-3,
    },
    "wrist": {
        "type": "stiff",
        "gear_ratio": 50.0,
        "motor_input": "current",
        "friction": ["viscous", "smooth_coulomb", "asymmetric"],
        "coulomb_width_rad_per_s": 0.1,
    },
}
"""Drives with a term of each kind."""

COLLISION_URDF = """<robot name="two">
<link name="ground"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="upper"><inertial><mass value="1"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  <collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="lower"><inertial><mass value="1"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  <collision><origin xyz="0.4 0 0" rpy="0 0.1 0"/>
  <geometry><mesh filename="part.MESH" scale="0.1 0.1 0.1"/></geometry></collision></link>
<joint name="shoulder" type="revolute"><parent link="ground"/><child link="upper"/>
  <axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" velocity="3" effort="9"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
  <origin xyz="0.5 0 0"/><axis xyz="0 0 1"/></joint>
</robot>
"""
SRDF = """<robot name="two"><group name="all"><joint name="elbow"/></group>
<disable_collisions link1="ground" link2="upper" reason="Adjacent"/></robot>
"""


def robot() -> Robot:
    """Return the arm with a drive of each kind, as a user would load it."""
    return arm()


@cache
def log() -> Log:
    """Return six seconds of the arm at 250 Hz."""
    full = measure(arm(), arm_motion(), ARM_SENSORS, 0)
    part: dict[str, Any] = {name: values[::4] for name, values in full.sensors().items()}
    return replace(full, time=full.time[::4], **part)


@cache
def motion() -> Motion:
    """Return the motion of the log, reconstructed."""
    return seaid.reconstruct_motion(robot(), log())


@cache
def columns() -> dict[str, Array]:
    """Return a short log by our column names: 300 samples at 50 Hz."""
    return {"time_s": log().time[::5], **{k: one[::5] for k, one in log().columns().items()}}


@cache
def foreign_columns() -> dict[str, Array]:
    """Return the same samples as another one's log has them."""
    kinds = {"motor_position": "mpos", "joint_position": "pos", "motor_torque": "tau"}
    names = {"time_s": "t"}
    for index, joint in enumerate(robot().joint_names):
        names |= {f"{joint}.{kind}": f"{short}_{index}" for kind, short in kinds.items()}
    return {
        next(new for old, new in names.items() if name.startswith(old)): values
        for name, values in columns().items()
    }


DESCRIPTION: dict[str, Any] = {
    "time": {"column": "t", "unit": "s"},
    "joints": {
        joint: {
            "motor_position": {"column": f"mpos_{index}", "sign": 1, "wraps": 1000.0},
            "joint_position": {"column": f"pos_{index}", "offset": 0.05, "scale": 1.0},
            "motor_torque": {"column": f"tau_{index}", "unit": "Nm", "times": 1.0},
        }
        for index, joint in enumerate(("rail", "shoulder", "telescope", "wrist"))
    },
    "repair": {"most_missing": 0.1, "longest_gap_s": 0.2},
}


Files = dict[str, bytes]
"""The content of a folder by the names in it."""


def files_in(folder: Path) -> Files:
    """Return all files in a folder, and in those below it."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def written(write: Callable[[Path], Any]) -> Files:
    """Return the files that a function writes into a folder."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder))
        return files_in(Path(folder))


@cache
def parameters_text() -> str:
    """Return a parameters.json of the arm."""
    found = seaid.identify(robot(), log())
    return written(lambda folder: found.save(folder / "a.json"))["a.json"].decode()


@cache
def trajectory_texts() -> tuple[str, ...]:
    """Return a trajectory file of each basis."""
    planned = [wiggle(robot(), 2.0, (0.0,) * 4, (0.2,) * 4, knot_s=0.5)]
    for kind in ("fourier", "polynomial"):
        basis = make_basis(kind, 2.0, 9)
        values = np.random.default_rng(0).uniform(-0.1, 0.1, (9, 4))
        planned.append(Trajectory(robot().joint_names, basis, values, ("rail", "telescope")))
    saved = [written(lambda folder, one=one: one.save(folder / "a.json")) for one in planned]
    return tuple(files["a.json"].decode() for files in saved)


@cache
def small_robot(*joints: str) -> Robot:
    """Return a robot with the joints that a bag ("shoulder", "elbow") or a HEBI log has."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "two.urdf"
        path.write_text(COLLISION_URDF)
        return seaid.load_robot(path, joints=joints)


@cache
def bags() -> tuple[Files, ...]:
    """Return bags with the states of two joints: SQLite, MCAP and of ROS 1."""
    kinds = (StoragePlugin.SQLITE3, StoragePlugin.MCAP, None)
    return tuple(written(lambda folder, kind=kind: _write_bag(folder, kind)) for kind in kinds)


def _write_bag(folder: Path, plugin: StoragePlugin | None) -> None:
    types: Any = get_typestore(Stores.ROS2_HUMBLE if plugin else Stores.ROS1_NOETIC)
    names = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    state, header, stamp = (types.types[name] for name in names)
    writer: Any = (
        Writer2(folder / "bag", version=9, storage_plugin=plugin)
        if plugin
        else Writer1(folder / "log.bag")
    )
    serialize = types.serialize_cdr if plugin else types.serialize_ros1
    with writer as bag:
        topic = bag.add_connection("/joint_states", state.__msgtype__, typestore=types)
        for step in range(80):
            time, angles = 10**18 + step * 20_000_000, np.sin([0.1 * step, 0.13 * step])
            number = {} if plugin else {"seq": step}
            head = header(stamp=stamp(*divmod(time, 10**9)), frame_id="", **number)
            message = state(head, ["shoulder", "elbow"], angles, angles[:0], 3.0 * angles)
            bag.write(topic, time, serialize(message, state.__msgtype__))


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


MESHES = ("stl", "stl_ascii", "obj", "ply", "off")


@cache
def mesh(kind: str) -> bytes:
    """Return a ball of triangles as a file of a kind."""
    content = trimesh.creation.icosphere(subdivisions=1).export(file_type=kind)
    return content if isinstance(content, bytes) else content.encode()


@cache
def log_file(name: str) -> bytes:
    """Return a log of the arm as a file; "other" is of another part of the motion."""
    start = 0 if name.startswith("run") else 400
    part = log().between(log().time[start], log().time[start + 1000])
    return written(lambda folder: seaid.write_log(part, folder / name))[name]


def app() -> Any:
    """Return the command line."""
    from seaid.cli.commands import app as commands

    return commands


def make_all() -> None:
    """Make what takes time, once a process."""
    for make in (motion, parameters_text, trajectory_texts, bags, foreign_columns, app):
        make()
    log_file("run.npz"), log_file("other.npz")
