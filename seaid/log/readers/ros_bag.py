"""ROS bags, read with rosbags (`pip install 'seaid[ros]'`): ROS 2 .db3 and .mcap, ROS 1 .bag.

A column is topic and field, as "/joint_states/position[elbow]": with the joint's name if the
message has names, else with the place in the array. ROS need not be installed. rosbags runs in a
child process, because a compressed part of a bag may request any amount of memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from itertools import islice
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from seaid.errors import LogError
from seaid.log.readers.child_process import read_in_child
from seaid.log.readers.table import Block, Table, check_columns, check_installed

_LOOKED_AT = 100
"""Messages of a topic that define its columns; several senders may share a topic."""

_LONGEST_ARRAY = 1_000
"""Longest array of a message with a column per number; longer ones are images or point clouds."""

_NAMES = ("name", "names", "joint_names", "joint_name", "interface_names")


def open_bag(path: Path) -> Table:
    """Return the columns of a bag: a file, or a folder with metadata.yaml.

    In addition to the fields each topic has `bag_time` and, if its messages have a header,
    `header.stamp`, in seconds since the start of the bag. Raises LogError for an invalid bag, and
    if rosbags is not installed.
    """
    check_installed("rosbags.highlevel", "ros", path)

    def load(wanted: list[str]) -> Block:
        data: Block = read_in_child(bag_samples, path, "a ROS bag", 2e4, wanted)
        return data

    names, clocks = read_in_child(bag_columns, path, "a ROS bag", 2e4)
    if not names:
        raise LogError(f"'{path}' has no message with numbers")
    return Table(names, load, clocks=clocks, sparse=True)


def bag_columns(path: str) -> tuple[list[str], dict[str, str]]:
    """Return the names and clocks of the columns of a bag; runs in the child."""
    names: list[str] = []
    clocks: dict[str, str] = {}
    with _opened(Path(path)) as bag:
        for connection in sorted(bag.connections, key=lambda connection: connection.topic):
            topic, numbers = connection.topic, dict[str, float]()
            try:
                for row in islice(_rows(bag, [connection]), _LOOKED_AT):
                    numbers |= row
                    check_columns(Path(path), len(names) + len(numbers))
            except KeyError:  # a type without definition
                continue
            if len(numbers) < 2:  # none but its time
                continue
            # A stamp that was never set is 0, and since the start of the bag it is minus that
            # start.
            stamped = numbers.get("header.stamp", 0.0) not in (0.0, -bag.start_time * 1e-9)
            clock = f"{topic}/{'header.stamp' if stamped else 'bag_time'}"
            columns = [f"{topic}/{name}" for name in numbers]
            names += [name for name in columns if name not in clocks]
            clocks |= dict.fromkeys(columns, clock)
    return names, clocks


def bag_samples(path: str, wanted: list[str]) -> Block:
    """Return the samples of columns of a bag; runs in the child."""
    data: Block = {}
    with _opened(Path(path)) as bag:
        topics = {connection.topic for connection in bag.connections}
        for topic in sorted(topics):
            keys = {name: name[len(topic) + 1 :] for name in wanted if name.startswith(f"{topic}/")}
            if not keys:
                continue
            used = [connection for connection in bag.connections if connection.topic == topic]
            rows = [[row.get(x, np.nan) for x in keys.values()] for row in _rows(bag, used)]
            data |= dict(zip(keys, np.array(rows, dtype=np.float64).T, strict=True))
    return data


def _values(message: Any, start_ns: int, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield (field, number) of all numbers in a message."""
    if isinstance(message, Real):
        yield name, float(message)
    elif hasattr(message, "sec") and hasattr(message, "nanosec"):
        # In integers up to the difference: float64 has 0.2 us left of seconds since 1970.
        yield name, (message.sec * 10**9 + message.nanosec - start_ns) * 1e-9
    elif is_dataclass(message):
        candidates = (_labels(getattr(message, key, None)) for key in _NAMES)
        labels = next(filter(None, candidates), [])
        for field in fields(message):
            value, path = getattr(message, field.name), f"{name}.{field.name}".removeprefix(".")
            if isinstance(value, list | np.ndarray) and 0 < len(value) <= _LONGEST_ARRAY:
                yield from _array(value, start_ns, path, labels)
            # Empty and very long arrays, and texts, have no columns.
            elif not isinstance(value, str | list | np.ndarray):
                yield from _values(value, start_ns, path)


def _array(values: Any, start_ns: int, name: str, labels: list[str]) -> Iterator[tuple[str, float]]:
    named = labels if len(labels) == len(values) else range(len(values))
    for label, value in zip(named, values, strict=True):
        if not isinstance(value, str):
            yield from _values(value, start_ns, f"{name}[{label}]")


def _labels(value: Any) -> list[str]:
    is_names = isinstance(value, list) and all(isinstance(label, str) for label in value)
    return list(value) if is_names else []


def _rows(bag: Any, connections: list[Any]) -> Iterator[dict[str, float]]:
    """Yield {field: number} of the messages of a topic, with the times at which they came."""
    for connection, time, raw in bag.messages(connections):
        message = bag.deserialize(raw, connection.msgtype)
        since = (time - bag.start_time) * 1e-9
        yield {"bag_time": since, **dict(_values(message, bag.start_time))}


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    from rosbags import highlevel, typesys

    known = typesys.get_typestore(typesys.Stores.LATEST)
    with highlevel.AnyReader(_files(path), default_typestore=known) as bag:
        yield bag


def _files(path: Path) -> list[Path]:
    """Return the paths for rosbags: the bag's folder, or its storage files without metadata."""
    if not path.is_dir() or (path / "metadata.yaml").is_file():
        return [path]
    endings = ("*.db3", "*.mcap", "*.bag")
    files = sorted(file for end in endings for file in path.glob(end) if file.is_file())
    if not files:
        raise LogError(f"'{path}' is a folder without a ROS bag (.db3, .mcap or .bag) in it")
    return files
