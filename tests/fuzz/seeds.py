"""What the fuzzer starts from: valid contents of every kind, of one small robot and one motion."""

from __future__ import annotations

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
from seaid.excitation import Trajectory, make_basis
from seaid.log import Log, Motion
from seaid.robot import Robot
from tests.experiments import DATA, MODELS, arm, arm_log, wiggle

ARM_URDF, ARM_DRIVES = DATA / "mixed_arm.urdf", DATA / "mixed_arm.toml"
URDFS = (ARM_URDF, MODELS / "tulip_leg.urdf", MODELS / "differential_wrist.urdf")
MESHES = ("stl", "stl_ascii", "obj", "ply", "off")

TEXTS = DATA / "fuzz"
DRIVES, DESCRIPTION, TWO_URDF = (
    (TEXTS / name).read_text("utf-8") for name in ("drives.toml", "description.toml", "two.urdf")
)
"""Drives with a term of each kind, what `foreign_columns` are, and a robot with a SHAPE."""

MESH = '<mesh filename="part.{}" scale="0.1 0.1 0.1"/>'

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
        seaid.project.save_run(found, folder / "a.npz", validations=tests, provenance=origin)

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
    """Return 80 records of a measured HEBI log of one module."""
    mark = bytes.fromhex("73b10001")
    path = MODELS / "logs" / "hebi_x5_unloaded" / "exampleLog.hebilog"
    head, *records = path.read_bytes().split(mark)
    return mark.join([head, *records[400:480]])


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
