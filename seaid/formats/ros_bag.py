"""ROS bags, read with rosbags (`pip install 'seaid[ros]'`): ROS 2 .db3 and .mcap, ROS 1 .bag.

A column is topic and field, as "/joint_states/position[elbow]": by the joint's name where the
message has names, by the place in the array otherwise. No ROS needs to be installed.
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
from seaid.formats.table import Block, Table, optional

_LOOKED_AT = 100
"""Messages of a topic that tell its columns: several senders may share a topic."""

_NAMES = ("name", "names", "joint_names", "joint_name")


def open_bag(path: Path) -> Table:
    """Return the columns of a bag: a file, or a folder with metadata.yaml.

    Beside the fields each topic has `bag_time` and, where its messages have a header,
    `header.stamp`, in seconds since the bag began. Raises LogError for what is no bag, and where
    rosbags is not installed.
    """
    names: list[str] = []
    clocks: dict[str, str] = {}
    with _opened(path) as bag:
        for connection in sorted(bag.connections, key=lambda one: one.topic):
            topic, found = connection.topic, dict[str, float]()
            try:
                for _, message in islice(_messages(bag, [connection]), _LOOKED_AT):
                    found |= dict(_values(message, bag.start_time))
            except KeyError:  # a type whose definition is nowhere
                continue
            if not found:
                continue
            stamped = found.get("header.stamp", 0.0) not in (0.0, -bag.start_time * 1e-9)
            clock = f"{topic}/{'header.stamp' if stamped else 'bag_time'}"
            columns = [f"{topic}/{name}" for name in ("bag_time", *found)]
            names += [name for name in columns if name not in clocks]
            clocks |= dict.fromkeys(columns, clock)
    if not names:
        raise LogError(f"'{path}' has no message with numbers")
    return Table(names, lambda wanted: _load(path, wanted), clocks=clocks, sparse=True)


def _load(path: Path, wanted: list[str]) -> Block:
    data: Block = {}
    with _opened(path) as bag:
        topics = {one.topic for one in bag.connections}
        for topic in sorted(topics):
            mine = {name: name[len(topic) + 1 :] for name in wanted if name.startswith(f"{topic}/")}
            if not mine:
                continue
            used = [one for one in bag.connections if one.topic == topic]
            rows = []
            for time, message in _messages(bag, used):
                found = dict(_values(message, bag.start_time))
                found["bag_time"] = (time - bag.start_time) * 1e-9
                rows.append([found.get(field, np.nan) for field in mine.values()])
            data |= dict(zip(mine, np.array(rows, dtype=np.float64).T, strict=True))
    return data


def _values(message: Any, start_ns: int, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield (field, number) of all numbers in a message."""
    if isinstance(message, Real):
        yield name, float(message)
    elif hasattr(message, "sec") and hasattr(message, "nanosec"):
        yield name, (message.sec * 10**9 + message.nanosec - start_ns) * 1e-9
    elif is_dataclass(message):
        given = (_labels(getattr(message, one, None)) for one in _NAMES)
        labels = next((found for found in given if found), [])
        dot = f"{name}." if name else ""
        for field in fields(message):
            value = getattr(message, field.name)
            if isinstance(value, list | np.ndarray) and len(value):
                yield from _array(value, start_ns, f"{dot}{field.name}", labels)
            elif not isinstance(value, str | list | np.ndarray):
                yield from _values(value, start_ns, f"{dot}{field.name}")


def _array(values: Any, start_ns: int, name: str, labels: list[str]) -> Iterator[tuple[str, float]]:
    named = labels if len(labels) == len(values) else range(len(values))
    for label, value in zip(named, values, strict=True):
        if not isinstance(value, str):
            yield from _values(value, start_ns, f"{name}[{label}]")


def _labels(value: Any) -> list[str]:
    is_names = isinstance(value, list) and all(isinstance(one, str) for one in value)
    return list(value) if is_names else []


def _messages(bag: Any, connections: list[Any]) -> Iterator[tuple[int, Any]]:
    for connection, time, raw in bag.messages(connections):
        yield time, bag.deserialize(raw, connection.msgtype)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Give the open bag; whatever is wrong with it is a LogError."""
    highlevel = optional("rosbags.highlevel", "ros", path)
    types = optional("rosbags.typesys", "ros", path)
    try:
        known = types.get_typestore(types.Stores.LATEST)
        with highlevel.AnyReader(_files(path), default_typestore=known) as bag:
            yield bag
    except (LogError, KeyboardInterrupt):
        raise
    except Exception as problem:  # rosbags lets errors of SQLite, struct, YAML and LZ4 through
        reason = str(problem).splitlines()[0] if str(problem) else type(problem).__name__
        raise LogError(f"'{path}' is not a ROS bag, or a damaged one: {reason}") from None


def _files(path: Path) -> list[Path]:
    """Return what rosbags opens: the bag's folder, or its one storage file without metadata."""
    if not path.is_dir() or (path / "metadata.yaml").is_file():
        return [path]
    found = sorted(one for end in ("*.db3", "*.mcap", "*.bag") for one in path.glob(end))
    if not found:
        raise LogError(f"'{path}' is a folder without a ROS bag (.db3, .mcap or .bag) in it")
    return found
