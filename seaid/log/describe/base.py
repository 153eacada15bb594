"""The columns of a floating or planar base and of its contacts, by their names and samples.

Vectors are found by their names and by their samples: a quaternion has unit length, the angular
velocity is its derivative, an accelerometer feels gravity, a contact is 0 or 1. Arrays of n + 7 and
n + 6 columns are generalised positions and velocities, of the base and then of the joints; which of
them is a derivative of which, and where they lie in one table without names, the samples show. Logs
of robots on a boom have single columns, such as "x", "z", "pitch" and "pitch_rate", or arrays of
n + 3 columns.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.log.base_log import matrices
from seaid.log.channels import UNIT_FACTORS, Frame
from seaid.log.describe.inference import Inference
from seaid.log.describe.names import (
    PLANAR,
    Meaning,
    is_commanded,
    is_contact,
    is_elsewhere,
    kind_of,
    meaning_of,
    nearest,
    place_of,
    planar_meaning,
    words_of,
)
from seaid.log.description import Order, Source
from seaid.log.readers.table import Table
from seaid.robot import FloatingBase, Robot

_UNIT = 0.02
"""Deviation of the length of a quaternion from one."""

_GRAVITY = (8.0, 12.0)
"""Median length [m/s^2] of a specific force; without gravity it is far less."""

_IN_G = 0.1
"""Deviation of the median vector of an accelerometer from one, for one in g: without gravity the
vector is near zero."""

_CLEARER = 0.05
"""Difference of two correlations from which the larger one decides."""

_DERIVED = 0.6
"""Cosine of a derivative of the joints and an array of the same length from which it is that."""

_SMOOTHED = 15
"""Samples over which derivatives are averaged before they are compared."""

_TURNS = 2.5 * math.pi
"""Range of an angle without a unit from which it is in degrees: a base on a boom turns less."""

_OPPOSITE = -0.8
"""Correlation of the derivative of the angle with the rate from which one has the other sign."""

_TAKEN = Meaning("base", "", "", None, "derived")


_WRENCH = re.compile(r"(.+?)[._/ ]+(force|f|moment|torque|tau|t|m)", re.IGNORECASE)


@dataclass(frozen=True)
class Vector:
    """Columns that differ in a component or in their place in an array, and their factor to SI."""

    stem: str
    columns: tuple[str, ...]
    factor: float = 1.0
    is_array: bool = False

    def source(self, **more: Any) -> Source:
        """Return the source of the vector."""
        return Source(self.columns, **{"scale": self.factor, **more})


def force_sensors(vectors: Sequence[Vector]) -> dict[str, dict[str, Vector]]:
    """Return {sensor: {"force" and "moment": vector}} of what is no command."""
    sensors: dict[str, dict[str, Vector]] = {}
    for vector in vectors:
        match = _WRENCH.fullmatch(vector.stem)
        if match and len(vector.columns) == 3 and not is_commanded(vector.stem):
            quantity = "force" if match[2].lower().startswith("f") else "moment"
            sensors.setdefault(match[1], {})[quantity] = vector
    return {sensor: parts for sensor, parts in sensors.items() if "force" in parts}


@dataclass
class BaseGuess:
    """What was found: vectors of the base and of contacts, and meanings of the other columns."""

    base: dict[str, Source] = field(default_factory=dict)
    contacts: dict[str, dict[str, Source]] = field(default_factory=dict)
    meanings: dict[str, Meaning] = field(default_factory=dict)

    @property
    def taken(self) -> dict[str, Meaning]:
        """The meanings of all columns that are taken, those of the vectors too."""
        tables = [self.base, *self.contacts.values()]
        columns = chain.from_iterable(x.columns for table in tables for x in table.values())
        return {**self.meanings, **dict.fromkeys(columns, _TAKEN)}


def infer_base(table: Table, inference: Inference, robot: Robot) -> BaseGuess:
    """Return the columns of the base and of contacts of a log; `inference` has all samples."""
    assert robot.floating_base is not None
    search = _Search(table, inference, robot, robot.floating_base)
    vectors = search.named_vectors() or search.vectors_of_one_table()
    search.take_states(vectors)
    search.take_wrenches(vectors)
    for vector in vectors:
        if search.guess.taken.keys().isdisjoint(vector.columns):
            search.take_vector(vector)
    search.note_unused_forces()
    search.take_contacts(vectors)
    search.take_loads()
    search.take_planar()
    search.decide_frames()
    search.note_what_is_lacking()
    return search.guess


@dataclass
class _Search:
    """The search for a base and its contacts in the columns of a log."""

    table: Table
    inference: Inference
    robot: Robot
    floating: FloatingBase
    guess: BaseGuess = field(default_factory=BaseGuess)
    other_forces: dict[str, Vector] = field(default_factory=dict)

    def note(self, about: str, doubt: str, /, **values: Any) -> None:
        """Note what is in doubt."""
        self.inference.note(about, doubt, **values)

    @property
    def widths(self) -> tuple[int, ...]:
        """The columns of generalised positions and velocities of base and joints."""
        n = self.robot.n
        return (n + 7, n + 6) if self.floating.normal is None else (n + 3,)

    def samples(self, columns: Sequence[str]) -> Array:
        """Return the samples (T, k) of k columns."""
        return np.column_stack([self.inference.data[name] for name in columns])

    def named_vectors(self) -> list[Vector]:
        """Return the vectors by their names: arrays, files without names, and components.

        Columns that differ in their last number, as "gyro_0", are a vector if there are as many as
        of a vector of the base, or of its contacts.
        """
        groups = self._groups()
        sizes = {3, 4, 7, *self.widths, len(self.floating.contacts)}
        vectors = []
        for (form, stem), parts in groups.items():
            is_known = ("array", stem) in groups or len(parts) not in sizes
            if form == "number" and is_known:
                continue
            places = self._axes(stem, parts) if form == "axis" else sorted(parts, key=int)
            factors = {parts[place][1] for place in places}
            if places:
                columns = tuple(parts[place][0] for place in places)
                factor = factors.pop() if len(factors) == 1 else 1.0
                vectors.append(Vector(stem, columns, factor, is_array=form != "axis"))
        return vectors

    def _groups(self) -> dict[tuple[str, str], dict[str, tuple[str, float]]]:
        """Return {(form, stem): {place: (column, factor)}} of the columns."""
        groups: dict[tuple[str, str], dict[str, tuple[str, float]]] = {}
        for name in self.inference.data:
            file = self.table.files.get(name, "")
            form, stem, place, factor = place_of(self.table.label(name), file)
            if form:
                groups.setdefault((form, stem), {}).setdefault(place, (name, factor))
        return groups

    def _axes(self, stem: str, parts: Collection[str]) -> list[str]:
        """Return the axes of a whole vector in order, none of one that lacks an axis: note that."""
        lacking = [x for x in "xyz" if x not in parts]
        if not lacking:
            return [x for x in "wxyz" if x in parts]
        is_vector = len(lacking) == 1 and self.floating.normal is None and kind_of(stem)
        if is_vector and not is_elsewhere(stem):
            self.note(stem, "no_axis", axis=lacking[0])
        return []

    def vectors_of_one_table(self) -> list[Vector]:
        """Return the vectors of one table of numbers: positions with a quaternion, what follows.

        Behind the n + 7 positions come arrays of n + 6, those of n torques, and flags of the
        contacts.
        """
        names = list(self.inference.data)
        if self.table.files or not all(map(str.isdecimal, names)):
            return []
        n, feet = self.robot.n, len(self.floating.contacts)
        start = self._start_of_pose(names)
        if start is None:
            return []
        place = start + n + 7
        vectors = [Vector("q", tuple(names[start:place]), is_array=True)]
        rate = self.samples(names[place - n : place])
        widths = {"velocity": n + 6, "acceleration": n + 6, "torque": n, "contact": feet}
        for stem, width in widths.items():
            columns = names[place : place + width]
            if len(columns) < width:
                continue
            if width == n + 6:
                values, derivative = self.samples(columns[-n:]), np.diff(rate, axis=0)
                if _cosine(derivative, values[: len(derivative)]) < _DERIVED:
                    continue
                rate = values
            vectors.append(Vector(stem, tuple(columns), is_array=True))
            place += width
        parts = ", ".join(f"{vector.stem} ({len(vector.columns)})" for vector in vectors)
        self.note(f"columns {names[start]} to {names[place - 1]}", "one_table", vectors=parts)
        return vectors

    def _start_of_pose(self, names: Sequence[str]) -> int | None:
        """Return the first of n + 7 columns that have three coordinates and then a quaternion."""
        starts = range(len(names) - self.robot.n - 6)
        poses = (x for x in starts if _is_quaternion(self.samples(names[x + 3 : x + 7])))
        return next(poses, None)

    def take_states(self, vectors: Sequence[Vector]) -> None:
        """Take arrays of n, n + 3, n + 6 or n + 7 columns for states of base and joints."""
        widths = {self.robot.n, *self.widths} - {*range(5)}
        arrays = [x for x in vectors if x.is_array and len(x.columns) in widths]
        for vector, quantity in self._state_quantities(arrays).items():
            if quantity:
                self._take_state(vector, quantity)

    def _take_state(self, vector: Vector, quantity: str) -> None:
        """Take an array for the states of the base, if it has them, and of the joints."""
        names, n = self.robot.joint_names, self.robot.n
        base, joints = vector.columns[:-n], vector.columns[-n:]
        for name, part in _STATES.get((len(base), quantity), {}).items():
            self.guess.base[name] = Source(base[part])
        self.guess.meanings |= dict.fromkeys(base, _TAKEN)
        meaning = replace(meaning_of(vector.stem), quantity=quantity, side="", unknown=())
        for column, joint in zip(joints, names, strict=True):
            self.guess.meanings[column] = replace(meaning, joint=joint)
        about = f"{vector.stem}: its last {n} columns" if base else vector.stem
        order = f"{names[0]}, {names[1]}, ..." if n > 1 else "one"
        self.note(about, "states", order=order)

    def _state_quantities(self, arrays: Sequence[Vector]) -> dict[Vector, str]:
        """Return the quantities of arrays by their names, by a quaternion, and as derivatives."""
        quantities = {vector: self._named_quantity(vector) for vector in arrays}
        positions = [
            vector
            for vector, quantity in quantities.items()
            if quantity == "position" and meaning_of(vector.stem).is_raw
        ]
        pose = self.robot.n + 7
        unnamed = [x for x in arrays if not quantities[x] and len(x.columns) != pose]
        if positions:
            position = max(positions, key=lambda vector: len(vector.columns))
            quantities |= self._derivatives(position, unnamed)
        return quantities

    def _named_quantity(self, vector: Vector) -> str:
        """Return the quantity of an array by its name, of one with a pose by its quaternion."""
        if len(vector.columns) == self.robot.n + 7:
            return "position" if _is_quaternion(self.samples(vector.columns[3:7])) else ""
        return meaning_of(vector.stem).quantity

    def _derivatives(self, position: Vector, arrays: Sequence[Vector]) -> dict[Vector, str]:
        """Return which arrays are the velocity and the acceleration, by those of the joints."""
        samples = {x: self.samples(x.columns[-self.robot.n :]) for x in (position, *arrays)}
        quantities: dict[Vector, str] = {}
        rate = samples.pop(position)
        for quantity in ("velocity", "acceleration"):
            # The acceleration is compared with the derivative of the velocity that was found, if
            # any: one derivative has less noise than two.
            rate = np.diff(rate, axis=0)
            cosines = {x: _cosine(rate, values[: len(rate)]) for x, values in samples.items()}
            best = max(cosines, key=cosines.__getitem__, default=None)
            if best is not None and cosines[best] > _DERIVED:
                quantities[best] = quantity
                rate = samples.pop(best)
                self.note(best.stem, "by_samples", quantity=quantity)
        return quantities

    def take_vector(self, vector: Vector) -> None:
        """Take a vector for what its name and its samples say."""
        width, kind = len(vector.columns), kind_of(vector.stem)
        if is_contact(vector.stem) or is_elsewhere(vector.stem):
            return
        if width in (4, 7) and _is_quaternion(self.samples(vector.columns[-4:])):
            self._take_pose(vector)
        elif width == 3 and kind == "specific_force":
            self._take_acceleration(vector, self.samples(vector.columns))
        elif width == 3 and kind not in ("", "orientation"):
            self.guess.base.setdefault(kind, vector.source())

    def _take_pose(self, vector: Vector) -> None:
        """Take a quaternion for the orientation, and three columns before it for the position."""
        is_alone = len(vector.columns) == 4
        order: Order | None = "wxyz" if is_alone and not vector.is_array else None
        quaternion = Source(vector.columns[-4:], order=order)
        if not is_alone:
            self.guess.base.setdefault("position", Source(vector.columns[:3]))
        self.guess.base.setdefault("orientation", quaternion)

    def _take_acceleration(self, vector: Vector, values: Array) -> None:
        """Take an acceleration with gravity, or one without it in the axes of the base."""
        factor = self._acceleration_factor(vector.stem, vector.factor * values, "no_gravity")
        if factor:
            source = vector.source(scale=factor * vector.factor)
            self.guess.base.setdefault("specific_force", source)
        else:
            self.guess.base.setdefault("acceleration", vector.source(frame="base"))

    def _acceleration_factor(self, about: str, values: Array, doubt: str) -> float:
        """Return the factor to m/s^2 of an acceleration (T, k), zero with a note of its `doubt`."""
        typical = float(np.nanmedian(np.linalg.norm(values, axis=1)))
        # The length of the median, not the median of the lengths, to which vibrations always add.
        if abs(float(np.linalg.norm(np.nanmedian(values, axis=0))) - 1.0) < _IN_G:
            self.note(about, "in_g")
            return UNIT_FACTORS["m_per_s2"]["g"]
        if not _GRAVITY[0] < typical < _GRAVITY[1]:
            self.note(about, doubt, typical=typical)
            return 0.0
        return 1.0

    def take_wrenches(self, vectors: Sequence[Vector]) -> None:
        """Take force sensors for the contacts whose names share the most words with theirs."""
        sensors = force_sensors(vectors)
        shared = {sensor: nearest(sensor, self.floating.contact_links) for sensor in sensors}
        for sensor, parts in sensors.items():
            link, count = shared[sensor]
            # No other sensor that is nearest to this contact shares as many words with it.
            is_rival = [x == link and words >= count for x, words in shared.values()]
            if not link or is_rival.count(True) > 1:
                self.other_forces[sensor] = parts["force"]
                continue
            self.guess.contacts[link] = {x: vector.source() for x, vector in parts.items()}
            self.note(sensor, "force_sensor", link=link)

    def note_unused_forces(self) -> None:
        """Note the forces that are neither at a contact nor a vector of the base."""
        taken = {source.columns for source in self.guess.base.values()}
        for sensor, vector in self.other_forces.items():
            if vector.columns not in taken:
                self.note(sensor, "other_force")

    def take_contacts(self, vectors: Sequence[Vector]) -> None:
        """Take columns for contacts: with the words of a link, or an array of one for each."""
        links = [x for x in self.floating.contact_links if x not in self.guess.contacts]
        for name in self.inference.data:
            link = self._contact_in(self.table.label(name))
            if link in links:
                self._take_contact(link, name)
        arrays = [x for x in vectors if is_contact(x.stem) and len(x.columns) == len(links)]
        if arrays and not self.guess.contacts:
            self._take_in_order(links, arrays[0])

    def _contact_in(self, name: str) -> str:
        """Return the contact in a name that is one of a contact, an empty text if none."""
        return nearest(name, self.floating.contact_links)[0] if is_contact(name) else ""

    def _take_in_order(self, links: Sequence[str], vector: Vector) -> None:
        """Take an array for the contacts of the robot in their order."""
        for link, name in zip(links, vector.columns, strict=True):
            self._take_contact(link, name)
        self.note(vector.stem, "contacts_in_order", links=", ".join(links))

    def _take_contact(self, link: str, name: str) -> None:
        """Take a column for a flag, or for a force with a threshold in the middle of its range."""
        values = self.inference.finite(name)
        above = unknown = None
        kinds, scale = {*np.unique(values)}, 1.0
        if kinds <= {0.0, 1.0, 2.0} and 2.0 in kinds:
            # `above` is a lower limit, so that the codes are negated: -1 is above -1.5, and -2 is
            # not.
            above, scale, unknown = -1.5, -1.0, 0.0
            self.note(name, "codes")
        elif not kinds <= {0.0, 1.0}:
            # Quantiles, because impacts exceed the force on a standing foot by far.
            low, high = np.quantile(values, [0.05, 0.95])
            above = float(f"{low + 0.2 * (high - low):.3g}")
            self.note(name, "force", above=above)
        source = Source((name,), scale=scale, above=above, unknown=unknown)
        self.guess.contacts.setdefault(link, {}).setdefault("contact", source)

    def take_loads(self) -> None:
        """Take "hip.load" for the torque of a joint, as Spot names it, if no column has one."""
        meanings = {**self.inference.meanings, **self.guess.meanings}
        if any(meaning.quantity in ("torque", "current") for meaning in meanings.values()):
            return
        for name, m in self.inference.meanings.items():
            is_load = words_of(name)[-1:] == ["load"] and m.joint in self.robot.joint_names
            if is_load and not m.quantity:
                self.guess.meanings[name] = replace(m, quantity="torque", side="")
                self.note(name, "load")

    def take_planar(self) -> None:
        """Take single columns for the coordinates, the angle and the rates of a planar base."""
        if self.floating.normal is None:
            return
        normal = "xyz"[int(np.argmax(np.abs(np.array(self.floating.normal))))]
        vectors = self._planar_vectors(normal)
        for quantity in ("angle", "angular_velocity"):
            if quantity in vectors:
                vectors[quantity] = self._in_radians(vectors[quantity])
        self._check_signs(vectors)
        # If the normal points up, gravity is along it, and no component in the plane feels it.
        if "specific_force" in vectors and abs(float(self.floating.normal_in_world[2])) < 0.5:
            force = vectors.pop("specific_force")
            about, values = force.column, self.samples(force.columns)
            if factor := self._acceleration_factor(about, values, "no_gravity_or_unit"):
                vectors["specific_force"] = replace(force, scale=factor)
        self.guess.base = {**vectors, **self.guess.base}

    def _planar_vectors(self, normal: str) -> dict[str, Source]:
        """Return the vectors of single columns; note one that lacks an axis."""
        plane, vectors = "xyz".replace(normal, ""), dict[str, Source]()
        axes = {**dict.fromkeys(PLANAR, plane), "angle": normal, "angular_velocity": normal}
        columns = self._planar_columns(normal)
        for quantity in [x for x in axes if x in columns]:
            parts = columns[quantity]
            if lacking := [axis for axis in axes[quantity] if axis not in parts]:
                self.note(next(iter(parts.values())), "no_plane_axis", axis=lacking[0])
            else:
                vectors[quantity] = Source(tuple(parts[axis] for axis in axes[quantity]))
        return vectors

    def _planar_columns(self, normal: str) -> dict[str, dict[str, str]]:
        """Return {quantity: {axis: column}} of single columns that nothing else has taken."""
        # What arrays and vectors were taken for has precedence over single columns.
        free = self.inference.data.keys() - self.guess.taken.keys()
        parts = dict[str, dict[str, str]]()
        for column in filter(free.__contains__, self.inference.data):
            meaning = planar_meaning(self.table.label(column), normal)
            if meaning and self.inference.meanings[column].joint not in self.robot.joint_names:
                parts.setdefault(meaning[0], {}).setdefault(meaning[1], column)
        return parts

    def _in_radians(self, source: Source) -> Source:
        """Return the source of an angle or its rate, in degrees by its name or its range."""
        unit = self.inference.meanings[source.column].unit
        turn = np.ptp(self.inference.finite(source.column))
        if unit is None and turn > _TURNS:
            unit = "deg"
            self.note(source.column, "in_degrees", turn=turn)
        return replace(source, scale=math.pi / 180 if unit in ("deg", "deg/s") else 1.0)

    def _check_signs(self, vectors: Mapping[str, Source]) -> None:
        """Note an angle whose derivative is minus the angular velocity."""
        if not {"angle", "angular_velocity"} <= vectors.keys():
            return
        angle, rate = (
            vectors[x].scale * self.samples(vectors[x].columns)
            for x in ("angle", "angular_velocity")
        )
        # Steps over rates: a constant step of time is in both norms and does not change the cosine.
        if _cosine(np.diff(angle, axis=0), rate[:-1]) < _OPPOSITE:
            column = vectors["angular_velocity"].columns[0]
            self.note(column, "opposite_rate")

    def decide_frames(self) -> None:
        """Decide the order of a quaternion and the frames of velocities by their samples."""
        base = self.guess.base
        if "orientation" in base:
            order, frame = self._order(base["orientation"])
            if frame == "world":
                base["angular_velocity"] = replace(base["angular_velocity"], frame="world")
            columns = base["orientation"].columns
            R = _rotations(self.samples(columns), order)
            base["orientation"] = Source(columns, order=None if order == "wxyz" else order)
            if "velocity" in base:
                base["velocity"] = replace(base["velocity"], frame=self._velocity_frame(R))
        if {"velocity", "position", "specific_force"} & base.keys():
            base.pop("acceleration", None)
        elif "acceleration" in base:
            self.note("acceleration", "of_imu")

    def _order(self, source: Source) -> tuple[Order, Frame | None]:
        """Return the order of a quaternion, and the frame of the angular velocity."""
        base, values = self.guess.base, self.samples(source.columns)
        orders: tuple[Order, ...] = ("wxyz",) if source.order else ("xyzw", "wxyz")
        scores: dict[tuple[Order, Frame | None], float] = {}
        for order in orders:
            R = _rotations(values, order)
            if "angular_velocity" in base:
                w = self.samples(base["angular_velocity"].columns)
                # the rows of R' are those of R turned: R(t+1) R(t)^T is a turn about w in the world
                turn = np.einsum("tij,tkj->tik", R[1:], R[:-1])
                axial = [turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))]
                world = np.column_stack(axial)
                scores[order, "base"] = _cosine(np.einsum("tji,tj->ti", R[:-1], world), w[:-1])
                scores[order, "world"] = _cosine(world, w[:-1])
            elif "specific_force" in base:
                f = self.samples(base["specific_force"].columns)
                # R f = a - g, whose mean is 9.81 upwards in the right order: a base does not
                # accelerate for long.
                up = float(np.mean(np.einsum("tij,tj->ti", R, f)[:, 2]))
                scores[order, None] = up / 9.81
            else:
                # The z axis of a base is about upright: R_zz is near 1 in the right order.
                scores[order, None] = float(np.mean(R[:, 2, 2]))
        (order, frame), best = max(scores.items(), key=lambda item: item[1])
        rivals = [score for (rival, _), score in scores.items() if rival != order]
        if rivals and best - max(rivals) < _CLEARER:
            self.note("orientation", "guessed_order", order=order)
        return order, frame

    def _velocity_frame(self, R: Array) -> Frame | None:
        """Return the frame of the velocity: that in which it is the derivative of the position."""
        base = self.guess.base
        if "position" not in base:
            self.note("velocity", "of_odometry")
            return "base"
        v = self.samples(base["velocity"].columns)
        rate = np.diff(self.samples(base["position"].columns), axis=0)
        # p' = v in the world, or R v of one in the base's axes; they are equal while the base
        # hardly turns.
        in_world, in_base = _cosine(rate, v[:-1]), _cosine(rate, np.einsum("tij,tj->ti", R, v)[:-1])
        if abs(in_world - in_base) < _CLEARER / 5:
            self.note("velocity", "guessed_frame")
        return "base" if in_base > in_world else None

    def note_what_is_lacking(self) -> None:
        """Note the motion of a base of six degrees of freedom that no column says."""
        if self.floating.normal is not None:
            return
        quantities = self.guess.base.keys()
        if quantities.isdisjoint(("orientation", "angular_velocity")):
            self.note("base", "no_turn")
        has_pose = "orientation" in quantities and not quantities.isdisjoint(
            ("position", "velocity")
        )
        if not has_pose and quantities.isdisjoint(("specific_force", "acceleration")):
            self.note("base", "no_acceleration")


_STATES: dict[tuple[int, str], dict[str, slice]] = {
    (7, "position"): {"position": slice(3), "orientation": slice(3, 7)},
    (6, "velocity"): {"velocity": slice(3), "angular_velocity": slice(3, 6)},
    (3, "position"): {"position": slice(2), "angle": slice(2, 3)},
    (3, "velocity"): {"velocity": slice(2), "angular_velocity": slice(2, 3)},
}
"""{(columns of the base, quantity): {its vectors: their columns}} of generalised coordinates."""


def _is_quaternion(values: Array) -> bool:
    length = np.linalg.norm(values, axis=1)
    return values.shape[1] == 4 and float(np.median(np.abs(length - 1))) < _UNIT


def _rotations(quaternions: Array, order: Order) -> Array:
    """Return the rotations (T, 3, 3) of quaternions (T, 4) of any length, in an order."""
    values = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    return matrices(values if order == "wxyz" else values[:, [3, 0, 1, 2]])


def _cosine(first: Array, second: Array) -> float:
    """Return the cosine of two signals (T, k) without short noise; their scales do not matter."""
    first, second = (_smoothed(x) for x in (first, second))
    both = np.all(np.isfinite(first) & np.isfinite(second), axis=1)
    size = float(np.linalg.norm(first[both]) * np.linalg.norm(second[both]))
    return float(np.sum(first[both] * second[both])) / size if size > 0 else 0.0


def _smoothed(values: Array) -> Array:
    # The moving sum in place of the mean: a cosine does not have its factor.
    total = np.cumsum(values, axis=0)
    return np.asarray(total[_SMOOTHED:] - total[:-_SMOOTHED])
