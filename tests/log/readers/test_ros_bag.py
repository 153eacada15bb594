"""ROS bags written here and read back: topics, fields, joints by name, stamps, several senders."""

import re
import shutil
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from seaid.errors import LogError
from seaid.log import read_log
from seaid.log.readers.opening import open_table
from seaid.robot import Robot
from tests.one_joint import one_joint

START_NS = 1_700_000_000_123_456_789
COUNT = 80
DRIVE = """std_msgs/Header header
int32 temperature
float64[2] motor_angle
my_msgs/Board board
"""
BOARD = "float64 current\nstring note\n"
MOTOR, JOINTS = "/drives", "/joint_states"


@cache
def store(version: int) -> Any:
    types = get_typestore(Stores.ROS2_HUMBLE if version == 2 else Stores.ROS1_NOETIC)
    types.register(get_types_from_msg(DRIVE, "my_msgs/msg/Drive"))
    types.register(get_types_from_msg(BOARD, "my_msgs/msg/Board"))
    return types


def messages(types: Any, version: int, stamped: bool = True) -> Any:
    """Yield (topic, type, time, message): two senders of joint states, and motor side."""
    header, stamp = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    state, drive = types.types["sensor_msgs/msg/JointState"], types.types["my_msgs/msg/Drive"]
    board = types.types["my_msgs/msg/Board"]
    more = {"seq": 0} if version == 1 else {}
    for step in range(COUNT):
        time = START_NS + step * 10_000_000
        sec, nanosec = divmod(time - 2_000_000, 10**9) if stamped else (0, 0)
        head = header(stamp=stamp(sec=sec, nanosec=nanosec), frame_id="", **more)
        nothing = np.zeros(0)
        for names, values in ((["b", "a"], [2.0 + step, 1.0 + step]), (["grip"], [9.0])):
            message = state(head, names, np.array(values), nothing, 10 * np.array(values))
            yield JOINTS, "sensor_msgs/msg/JointState", time, message
        motor = np.array([100.0 * step, -1.0])
        yield MOTOR, "my_msgs/msg/Drive", time + 3_000_000, drive(head, 30, motor, board(0.5, "x"))


def write_bag(path: Path, version: int = 2, plugin: Any = None, stamped: bool = True) -> Path:
    types = store(version)
    arguments: dict[str, Any] = {} if version == 1 else {"version": 9}
    if plugin is not None:
        arguments["storage_plugin"] = plugin
    connections: dict[str, Any] = {}
    with (Writer1 if version == 1 else Writer2)(path, **arguments) as writer:
        for topic, kind, time, message in messages(types, version, stamped):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=types)
            serialize = types.serialize_ros1 if version == 1 else types.serialize_cdr
            writer.write(connections[topic], time, serialize(message, kind))
    return path


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    """Return one bag of every kind."""
    folder = tmp_path_factory.mktemp("bags")
    sqlite = write_bag(folder / "sqlite", plugin=StoragePlugin.SQLITE3)
    mcap = write_bag(folder / "mcap", plugin=StoragePlugin.MCAP)
    alone = folder / "alone"
    alone.mkdir()
    shutil.copy(next(sqlite.glob("*.db3")), alone / "x.db3")
    return (
        sqlite,
        mcap,
        next(mcap.glob("*.mcap")),
        alone,
        alone / "x.db3",
        write_bag(folder / "old.bag", version=1),
    )


@pytest.mark.slow  # six bags, each read in a process of its own
def test_every_kind_of_bag_gives_the_same_columns(bags: Sequence[Path]) -> None:
    """SQLite, MCAP and ROS 1, folders and files: values by joint and sender, stamps and clocks."""
    for path in bags:
        table = open_table(path)
        joints, motors = f"{JOINTS}/header.stamp", f"{MOTOR}/header.stamp"
        wanted = [f"{JOINTS}/position[a]", f"{JOINTS}/effort[grip]", joints, motors]
        wanted += [f"{MOTOR}/motor_angle[0]", f"{MOTOR}/board.current", f"{MOTOR}/bag_time"]
        assert set(wanted) <= set(table.names), path
        assert table.clocks[wanted[0]] == joints
        assert table.clocks[f"{MOTOR}/motor_angle[0]"] == motors
        data = table.load(wanted)
        steps = np.arange(COUNT)
        position = data[f"{JOINTS}/position[a]"]
        assert len(position) == 2 * COUNT
        np.testing.assert_array_equal(position[::2], 1.0 + steps)
        assert np.all(np.isnan(position[1::2]))  # those are of the other sender
        assert np.all(data[f"{JOINTS}/effort[grip]"][1::2] == 90.0)
        np.testing.assert_allclose(data[motors], steps / 100 - 0.002, atol=1e-12)
        np.testing.assert_allclose(data[f"{MOTOR}/bag_time"], steps / 100 + 0.003, atol=1e-12)
        np.testing.assert_array_equal(data[f"{MOTOR}/motor_angle[0]"], 100.0 * steps)
        assert np.all(data[f"{MOTOR}/board.current"] == 0.5)


def test_without_stamps_the_time_of_the_bag_counts(tmp_path: Path) -> None:
    """A header of zeros is no clock."""
    table = open_table(write_bag(tmp_path / "bag", stamped=False))
    assert table.clocks[f"{JOINTS}/position[a]"] == f"{JOINTS}/bag_time"


@pytest.fixture
def arm(tmp_path: Path) -> Robot:
    return one_joint(tmp_path, "continuous", {"type": "series_elastic", "gear_ratio": 100})


def described(position: str) -> dict[str, Any]:
    return {
        "joints": {
            "arm": {
                "joint_position": position,
                "joint_torque": f"{JOINTS}/effort[a]",
                "motor_position": {"column": f"{MOTOR}/motor_angle[0]", "sign": -1, "unit": "deg"},
            }
        }
    }


@pytest.mark.slow  # 0.8 s
def test_topics_with_clocks_of_their_own_become_one_log(tmp_path: Path, arm: Robot) -> None:
    path = write_bag(tmp_path / "bag")
    log = read_log(path, arm, description=described(f"{JOINTS}/position[a]"))
    assert len(log.time) == COUNT
    steps = np.arange(COUNT)
    np.testing.assert_allclose(log.joint_position[:, 0], 1.0 + steps, atol=1e-9)
    np.testing.assert_allclose(log.motor_position[:, 0], -np.deg2rad(100.0) * steps, atol=1e-6)


@pytest.mark.slow  # 0.8 s, a process each
@pytest.mark.parametrize(
    ("position", "words"),
    [
        ("/joint_stat/position[a]", "topic is named '/joint_stat/position[a]'; did you"),
        (f"{JOINTS}/position[c]", "did you mean '/joint_states/position[b]'? allowed: /joint_"),
        ("position[a]", "allowed: /drives, /joint_states"),
    ],
)
def test_bag_without_the_topic_or_field_says_what_is_there(
    bags: Sequence[Path], arm: Robot, position: str, words: str
) -> None:
    path = f"'{bags[0]}': [joints.arm] joint_position: no "
    with pytest.raises(LogError, match=re.escape(path) + ".*" + re.escape(words)):
        read_log(bags[0], arm, description=described(position))


@pytest.mark.slow  # 0.7 s
def test_folder_without_a_bag_and_bag_without_messages_are_named(
    tmp_path: Path, arm: Robot
) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(LogError, match="is a folder without a ROS bag"):
        read_log(tmp_path / "empty", arm)
    with Writer2(tmp_path / "bag", version=9) as writer:
        writer.add_connection(JOINTS, "sensor_msgs/msg/JointState", typestore=store(2))
    with pytest.raises(LogError, match="bag' has no message with numbers"):
        read_log(tmp_path / "bag", arm)


@pytest.mark.slow  # 0.7 s
def test_interfaces_of_ros2_control_have_their_names(tmp_path: Path) -> None:
    """A list of names beside a list of values names these."""
    types = get_typestore(Stores.ROS2_JAZZY)
    value, state = "control_msgs/msg/InterfaceValue", "control_msgs/msg/DynamicJointState"
    types.register(get_types_from_msg("string[] interface_names\nfloat64[] values", value))
    types.register(
        get_types_from_msg(
            "std_msgs/Header header\nstring[] joint_names\n"
            "control_msgs/InterfaceValue[] interface_values",
            state,
        )
    )
    stamp = types.types["builtin_interfaces/msg/Time"]
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/dynamic_joint_states", state, typestore=types)
        for step in range(3):
            time = START_NS + step * 10_000_000
            values = types.types[value](
                ["position", "motor_position"], np.array([0.1, 10.0 + step])
            )
            header = types.types["std_msgs/msg/Header"](stamp(*divmod(time, 10**9)), "")
            message = types.types[state](header, ["knee"], [values])
            writer.write(topic, time, types.serialize_cdr(message, state))
    name = "/dynamic_joint_states/interface_values[knee].values[motor_position]"
    np.testing.assert_array_equal(open_table(tmp_path / "bag").load([name])[name], [10, 11, 12])
