"""Custom columns of a floating base and its contacts: their description, and their inference.

A vector is a list of columns in some frame. Reading turns all of them into the columns of `BaseLog`
by the orientation of the base.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np

from seaid._arrays import Array
from seaid.errors import LogError, shown, unknown_name
from seaid.log.base_log import (
    ANGLE,
    CHANNELS,
    contact_columns,
    continuous,
    matrices,
    needed_columns,
    with_guided,
)
from seaid.log.repair import Channel

if TYPE_CHECKING:
    from seaid.log.description import Clock
    from seaid.log.readers.table import Block, Table
    from seaid.robot import FloatingBase, Robot

Frame = Literal["base", "world"]
Order = Literal["wxyz", "xyzw"]

BASE_QUANTITIES = {
    "position": 3,
    "orientation": 4,
    "angle": 1,
    "velocity": 3,
    "angular_velocity": 3,
    "acceleration": 3,
    "specific_force": 3,
}
"""{quantity of the base: its number of columns}."""

CONTACT_QUANTITIES = {"contact": 1, "force": 3, "moment": 3}
"""{quantity of a contact: its number of columns}."""

_FRAMES: dict[str, Frame] = {
    "velocity": "world",
    "angular_velocity": "base",
    "acceleration": "world",
}
"""Frames of vectors that may be in either, where a description does not say which."""

_SLICE = re.compile(r"(.*)\[(\d+):(\d+)\]")


@dataclass(frozen=True)
class VectorSource:
    """The source of a vector of the base or of a contact: scale times the columns.

    Attributes
    ----------
    columns : tuple of str
    frame : {"base", "world"} or None
        Of a velocity, an angular velocity or an acceleration (without gravity); None: velocity and
        acceleration in the world, angular velocity in the base.
    order : {"wxyz", "xyzw"} or None
        Of the columns of an orientation, None: wxyz.
    scale : float
        Factor to SI units.
    above : float or None
        Value of a contact, such as a force, above which it touches the ground; None: 0.5.
    unknown : float or None
        Value in the columns of a contact that is no measurement, such as a code for "unknown".
    delay_s : float
        As of `Source`.
    time : Clock or None
        Clock of the columns, if they have their own.
    """

    columns: tuple[str, ...]
    frame: Frame | None = None
    order: Order | None = None
    scale: float = 1.0
    above: float | None = None
    unknown: float | None = None
    delay_s: float = 0.0
    time: Clock | None = None

    def plain(self) -> Any:
        """Return the source as TOML has it, without default values and its clock."""
        table: dict[str, Any] = {"columns": _short(self.columns)}
        for field in fields(self)[1:-1]:
            if (value := getattr(self, field.name)) != field.default:
                table[field.name] = value
        return table["columns"] if len(table) == 1 else table


def _short(columns: Sequence[str]) -> Any:
    """Return columns as a slice of an array if they are one, a name if there is only one."""
    parts = [*filter(None, (re.fullmatch(r"(.*)\[(\d+)\]", column) for column in columns))]
    if len(columns) > 1 and len(parts) == len(columns):
        places = [int(part[2]) for part in parts]
        stems = {part[1] for part in parts}
        if len(stems) == 1 and places == list(range(places[0], places[0] + len(places))):
            return f"{stems.pop()}[{places[0]}:{places[-1] + 1}]"
    return columns[0] if len(columns) == 1 else list(columns)


def vector_source(where: str, quantity: str, value: Any, clock: Clock | None) -> VectorSource:
    """Return the source of a vector from TOML. Raises LogError."""
    if isinstance(value, VectorSource):
        return value
    table = value if isinstance(value, Mapping) else {"columns": value}
    allowed = [field.name for field in fields(VectorSource)[:-1]]
    for key in table:
        if key not in allowed:
            raise LogError(f"{where}: {unknown_name('key', str(key), allowed)}")
    columns, width = _expanded(where, table.get("columns")), _WIDTHS[quantity]
    # How many of them a planar base needs is known with the robot: `_names` checks that.
    if len(columns) != width and not (quantity in _PLANAR and len(columns) < width):
        raise LogError(f"{where}: needs {width} columns, found {len(columns)}")
    _check_entries(where, quantity, table)
    return VectorSource(**{**table, "columns": columns, "time": clock})


def _check_entries(where: str, quantity: str, table: Mapping[str, Any]) -> None:
    """Raise LogError for an entry of a vector that its quantity has not, or of another type."""
    for key, words, holds in (
        ("frame", get_args(Frame), quantity in _FRAMES),
        ("order", get_args(Order), quantity == "orientation"),
    ):
        if key in table and not (holds and table[key] in words):
            fit = f"must be one of {', '.join(words)}" if holds else f"is not for {quantity}"
            raise LogError(f"{where}: {key} {fit}, found {shown(table[key])}")
    for key in ("scale", "above", "unknown", "delay_s"):
        number = table.get(key, 1.0)
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise LogError(f"{where}: {key} must be a number, found {shown(number)}")
    for key in ("above", "unknown"):
        if key in table and quantity != "contact":
            raise LogError(f"{where}: {key} is that of a contact")


_WIDTHS = BASE_QUANTITIES | CONTACT_QUANTITIES

_PLANAR = ("position", "velocity", "angular_velocity", "specific_force")
"""Vectors of which a planar base needs a part only."""


def _expanded(where: str, value: Any) -> tuple[str, ...]:
    """Return the names of columns: 'q[3:7]' stands for four, and a number for itself."""
    entries = value if isinstance(value, list | tuple) else [value]
    columns: list[str] = []
    for entry in entries:
        if type(entry) is not int and not (isinstance(entry, str) and entry):
            raise LogError(f"{where}: columns must be names of columns, found {shown(entry)}")
        part = _SLICE.fullmatch(str(entry))
        columns += (
            [f"{part[1]}[{place}]" for place in range(int(part[2]), min(int(part[3]), 10_000))]
            if part
            else [str(entry)]
        )
    return tuple(columns)


class DescribedVector(NamedTuple):
    """A described vector with its place in messages and the names of its channels."""

    where: str
    quantity: str
    names: tuple[str, ...]
    source: VectorSource


def described_vectors(
    where: str,
    base: Mapping[str, VectorSource],
    contacts: Mapping[str, Mapping[str, VectorSource]],
    table: Table,
    robot: Robot,
) -> Iterator[DescribedVector]:
    """Yield the vectors of a description, and those with seaid's own columns."""
    if robot.floating_base is None:
        if base or contacts:
            raise LogError(
                "the description has [base] or [contacts], and the base of the robot is fixed: "
                "load it with base='floating'",
                "base='floating'",
            )
        return
    for quantity, source in base.items():
        place = f"{where}: [base] {quantity}"
        names = _names(place, quantity, source, robot.floating_base)
        yield DescribedVector(place, quantity, names, source)
    planar = {"angle": (ANGLE,)} if robot.floating_base.normal is not None else {}
    for quantity, every in {**CHANNELS, **planar}.items():
        needed = every if quantity in planar else needed_columns(robot.floating_base, quantity)
        logged = tuple(name for name in every if name in table.names)
        if quantity not in base and set(needed) <= set(logged):
            yield DescribedVector(f"{where}: {logged[0]}", quantity, logged, VectorSource(logged))
    yield from _contact_vectors(where, contacts, table, robot.floating_base)


def _contact_vectors(
    where: str, contacts: Mapping[str, Mapping[str, VectorSource]], table: Table, base: FloatingBase
) -> Iterator[DescribedVector]:
    """Yield the flags and wrenches of a description, and those with seaid's own columns."""
    for link in dict.fromkeys([*contacts, *base.contact_links]):
        place = f"{where}: [contacts.{link}]"
        if link not in base.frames:
            raise LogError(f"{place}: {unknown_name('link', link, base.frames)}")
        flag, wrench = contact_columns(link)
        channels = {"contact": (flag,), "force": wrench[:3], "moment": wrench[3:]}
        for quantity, names in channels.items():
            source = contacts.get(link, {}).get(quantity)
            if source is None and set(names) <= set(table.names):
                source = VectorSource(names)
            if source is not None:
                yield DescribedVector(f"{place} {quantity}", quantity, names, source)


def _names(where: str, quantity: str, source: VectorSource, base: FloatingBase) -> tuple[str, ...]:
    """Return the names of the channels of a vector, also of the part that a planar base needs."""
    if quantity == "angle":
        if base.normal is None:
            raise LogError(f"{where}: angle is that of a planar base, and this one is floating")
        return (ANGLE,)
    names, width = _raw_names(quantity, source), len(source.columns)
    if width < len(names):
        needed = needed_columns(base, quantity) if names == CHANNELS[quantity] else names
        if width != len(needed):
            raise LogError(f"{where}: needs {len(needed)} columns, found {width}")
        return needed
    return names


def _raw_names(quantity: str, source: VectorSource) -> tuple[str, ...]:
    """Return the names of the channels of a vector, which say its frame if it is to be turned."""
    frame = source.frame or _FRAMES.get(quantity)
    if quantity in CHANNELS and (frame is None or frame == _FRAMES[quantity]):
        return CHANNELS[quantity]
    return tuple(f"base.{quantity}_in_{frame}_{x}" for x in "xyz")


def vector_channels(vector: DescribedVector, data: Block, time: Array) -> list[Channel]:
    """Return the channels of a vector as logged: a quaternion without changes of sign."""
    source = vector.source
    logged = np.column_stack([data[name] for name in source.columns])
    values = source.scale * logged
    if vector.quantity == "orientation":
        if source.order == "xyzw":
            values = values[:, [3, 0, 1, 2]]
        # Before gaps and other clocks are interpolated: between p and -p an interpolation passes
        # zero.
        values = continuous(values)
    if vector.quantity == "contact":
        limit = 0.5 if source.above is None else source.above
        unknown = np.nan if source.unknown is None else source.unknown
        is_known = np.isfinite(values) & (logged != unknown)
        values = np.where(is_known, values > limit, np.nan)
    return [
        Channel(name, time, column, None, source.delay_s)
        for name, column in zip(vector.names, values.T, strict=True)
    ]


def in_own_frames(picked: Mapping[str, Array], robot: Robot) -> dict[str, Array]:
    """Return the samples with vectors of other frames turned to those of `BaseLog`.

    f = R^T (a - g) with R from the base to the world. Raises LogError without an orientation.
    """
    samples = with_guided(picked, robot)
    turned = [name for name in picked if name.startswith("base.") and "_in_" in name]
    if not turned:
        return samples
    base = robot.floating_base
    assert base is not None
    _check_turnable(turned, picked, base)
    quaternions = np.column_stack([picked[name] for name in CHANNELS["orientation"]])
    R = matrices(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))
    gravity, (imu, _) = robot.model.gravity.linear, base.imu_placement
    for stem in dict.fromkeys(name[:-2] for name in turned):
        values = np.column_stack([samples.pop(f"{stem}_{x}") for x in "xyz"])
        quantity, frame = stem.removeprefix("base.").rsplit("_in_", 1)
        if quantity == "velocity":
            values = np.einsum("tij,tj->ti", R, values)
        elif frame == "world":
            # f = R^T (a - g): `tji` transposes R, and `@ imu` is imu^T, into the axes of the IMU.
            down = gravity if quantity == "acceleration" else 0.0
            values = np.einsum("tji,tj->ti", R, values - down) @ imu
        else:
            # a - R^T g: gravity as a row times R is R^T g, in the axes of the base.
            values = (values - gravity @ R) @ imu
        channel = "specific_force" if quantity == "acceleration" else quantity
        # What was logged in its own frame has precedence over what was turned to it.
        if CHANNELS[channel][0] not in samples:
            samples.update(zip(CHANNELS[channel], values.T, strict=True))
    return samples


def _check_turnable(turned: Sequence[str], picked: Mapping[str, Array], base: FloatingBase) -> None:
    """Raise LogError if vectors of other frames lack an orientation, or their IMU moves."""
    if not set(CHANNELS["orientation"]) <= set(picked):
        kind = turned[0].removeprefix("base.").rsplit("_in_", 1)
        raise LogError(
            f"the {kind[0]} of the base in the frame of the {kind[1][:-2]} needs the orientation "
            "of the base too: name it in [base]"
        )
    if not base.imu_is_fixed and any("velocity_in_base" not in name for name in turned):
        raise LogError(
            f"a joint moves the IMU at '{base.imu_link}': its angular velocity and specific force "
            'must be those of its own frame, without frame = "world" and with gravity'
        )
