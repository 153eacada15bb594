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
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from seaid._arrays import Array
from seaid.log.base_log import moving_base
from seaid.log.channels import UNIT_FACTORS, Frame
from seaid.log.describe.inference import Inference
from seaid.log.describe.names import (
    PLANAR,
    Meaning,
    is_commanded,
    is_of_base,
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


def infer_base(table: Table, inference: Inference, robot: Robot) -> None:
    """Find the base and the contacts of a log, and the joints that are in arrays with the base.

    `inference` has all samples; it gets the sources, and the meanings of the columns.
    """
    search = _Search(table, inference, robot, moving_base(robot))
    vectors = search.named_vectors() or search.vectors_of_one_table()
    search.take_states(vectors)
    forces = search.take_wrenches(vectors)
    for vector in vectors:
        if search.taken.keys().isdisjoint(vector.columns):
            search.take_vector(vector)
    of_base = {source.columns for source in search.base.values()}
    for sensor in [x for x, vector in forces.items() if vector.columns not in of_base]:
        search.note(sensor, "other_force")
    search.take_contacts(vectors)
    search.take_loads()
    search.take_planar()
    search.decide_frames()
    search.note_what_is_lacking()
    inference.meanings |= search.taken


@dataclass
class _Search:
    """The search for a base and its contacts in the columns of a log.

    `meanings` are those of columns that are taken for a joint, or for a coordinate of the base.
    """

    table: Table
    inference: Inference
    robot: Robot
    floating: FloatingBase
    meanings: dict[str, Meaning] = field(default_factory=dict)

    @property
    def base(self) -> dict[str, Source]:
        """The sources of the base."""
        return self.inference.tables["base",]

    @property
    def taken(self) -> dict[str, Meaning]:
        """The meanings of all columns that are taken, those of the vectors too."""
        sources = chain.from_iterable(x.values() for x in self.inference.tables.values())
        columns = chain.from_iterable(source.columns for source in sources)
        return {**self.meanings, **dict.fromkeys(columns, _TAKEN)}

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

    def is_quaternion(self, columns: Sequence[str]) -> bool:
        """Return whether columns are four that have unit length together."""
        length = np.linalg.norm(self.samples(columns), axis=1)
        return len(columns) == 4 and float(np.median(np.abs(length - 1))) < _UNIT

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
            if places:
                columns, factors = zip(*(parts[place] for place in places), strict=True)
                factor = factors[0] if len({*factors}) == 1 else 1.0
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
        if is_vector and not _is_elsewhere(stem):
            self.note(stem, "no_axis", axis=lacking[0])
        return []

    def vectors_of_one_table(self) -> list[Vector]:
        """Return the vectors of one table of numbers: positions with a quaternion, what follows.

        Behind the n + 7 positions come arrays of n + 6, those of n torques, and flags of the
        contacts.
        """
        names, n = list(self.inference.data), self.robot.n
        if self.table.files or not all(map(str.isdecimal, names)):
            return []
        start = self._start_of_pose(names)
        if start is None:
            return []
        place = start + n + 7
        vectors = [Vector("q", tuple(names[start:place]), is_array=True)]
        widths = {"velocity": n + 6, "acceleration": n + 6, "torque": n}
        for stem, width in {**widths, "contact": len(self.floating.contacts)}.items():
            vector = Vector(stem, tuple(names[place : place + width]), is_array=True)
            is_whole, is_rate = len(vector.columns) == width, width == n + 6
            if is_whole and (not is_rate or self._likeness(vectors[-1], vector) >= _DERIVED):
                vectors.append(vector)
                place += width
        parts = ", ".join(f"{vector.stem} ({len(vector.columns)})" for vector in vectors)
        about = f"columns {names[start]} to {vectors[-1].columns[-1]}"
        self.note(about, "one_table", vectors=parts)
        return vectors

    def _start_of_pose(self, names: Sequence[str]) -> int | None:
        """Return the first of n + 7 columns that have three coordinates and then a quaternion."""
        starts = range(len(names) - self.robot.n - 6)
        return next((x for x in starts if self.is_quaternion(names[x + 3 : x + 7])), None)

    def _likeness(self, vector: Vector, rate: Vector) -> float:
        """Return the cosine of the derivative of one array and another one, by their joints."""
        values, rates = (self.samples(x.columns[-self.robot.n :]) for x in (vector, rate))
        return _cosine(np.diff(values, axis=0), rates[:-1])

    def take_states(self, vectors: Sequence[Vector]) -> None:
        """Take arrays of n, n + 3, n + 6 or n + 7 columns for states of base and joints."""
        widths = {self.robot.n, *self.widths} - {*range(5)}
        arrays = [x for x in vectors if x.is_array and len(x.columns) in widths]
        for vector, quantity in self._state_quantities(arrays).items():
            if quantity:
                self._take_state(vector, quantity)

    def _state_quantities(self, arrays: Sequence[Vector]) -> dict[Vector, str]:
        """Return the quantities of arrays by their names, by a quaternion, and as derivatives."""
        quantities, pose = {x: self._named_quantity(x) for x in arrays}, self.robot.n + 7
        states = (x for x in arrays if quantities[x] == "position" and meaning_of(x.stem).is_raw)
        unnamed = [x for x in arrays if not quantities[x] and len(x.columns) != pose]
        if position := max(states, key=lambda vector: len(vector.columns), default=None):
            quantities |= self._derivatives(position, unnamed)
        return quantities

    def _named_quantity(self, vector: Vector) -> str:
        """Return the quantity of an array by its name, of one with a pose by its quaternion."""
        if len(vector.columns) == self.robot.n + 7:
            return "position" * self.is_quaternion(vector.columns[3:7])
        return meaning_of(vector.stem).quantity

    def _derivatives(self, position: Vector, arrays: Sequence[Vector]) -> dict[Vector, str]:
        """Return which arrays are the velocity and the acceleration, by those of the joints."""
        quantities: dict[Vector, str] = {}
        # The acceleration is compared with the derivative of the velocity that was found: one
        # derivative has less noise than two.
        for quantity in ("velocity", "acceleration"):
            rates = {x: self._likeness(position, x) for x in arrays if x not in quantities}
            best = max(rates, key=rates.__getitem__, default=position)
            if rates.get(best, 0.0) <= _DERIVED:
                break
            quantities[best], position = quantity, best
            self.note(best.stem, "by_samples", quantity=quantity)
        return quantities

    def _take_state(self, vector: Vector, quantity: str) -> None:
        """Take an array for the states of the base, if it has them, and of the joints."""
        names, n = self.robot.joint_names, self.robot.n
        base, joints = vector.columns[:-n], vector.columns[-n:]
        for name, part in _STATES.get((len(base), quantity), {}).items():
            self.base[name] = Source(base[part])
        self.meanings |= dict.fromkeys(base, _TAKEN)
        meaning = replace(meaning_of(vector.stem), quantity=quantity, side="", unknown=())
        for column, joint in zip(joints, names, strict=True):
            self.meanings[column] = replace(meaning, joint=joint)
        about = f"{vector.stem}: its last {n} columns" if base else vector.stem
        order = f"{names[0]}, {names[1]}, ..." if n > 1 else "one"
        self.note(about, "states", order=order)

    def take_vector(self, vector: Vector) -> None:
        """Take a vector for what its name and its samples say."""
        width, kind = len(vector.columns), kind_of(vector.stem)
        if is_of_base(vector.stem, "contact") or _is_elsewhere(vector.stem):
            return
        if width in (4, 7) and self.is_quaternion(vector.columns[-4:]):
            self._take_pose(vector)
        elif width == 3 and kind == "specific_force":
            self._take_acceleration(vector)
        elif width == 3 and kind not in ("", "orientation"):
            self.base.setdefault(kind, vector.source())

    def _take_pose(self, vector: Vector) -> None:
        """Take a quaternion for the orientation, and three columns before it for the position."""
        is_alone = len(vector.columns) == 4
        order: Order | None = "wxyz" if is_alone and not vector.is_array else None
        if not is_alone:
            self.base.setdefault("position", Source(vector.columns[:3]))
        self.base.setdefault("orientation", Source(vector.columns[-4:], order=order))

    def _take_acceleration(self, vector: Vector) -> None:
        """Take an acceleration with gravity, or one without it in the axes of the base."""
        values = vector.factor * self.samples(vector.columns)
        if factor := self._acceleration_factor(vector.stem, values, "no_gravity"):
            self.base.setdefault("specific_force", vector.source(scale=factor * vector.factor))
        else:
            self.base.setdefault("acceleration", vector.source(frame="base"))

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

    def take_wrenches(self, vectors: Sequence[Vector]) -> dict[str, Vector]:
        """Take force sensors for the contacts whose names share the most words with theirs.

        Return the forces of the others.
        """
        sensors = force_sensors(vectors)
        shared = {sensor: nearest(sensor, self.floating.contact_links) for sensor in sensors}
        rest = {}
        for sensor, parts in sensors.items():
            link, count = shared[sensor]
            # No other sensor that is nearest to this contact shares as many words with it.
            rivals = [words for x, words in shared.values() if x == link and words >= count]
            if not link or len(rivals) > 1:
                rest[sensor] = parts["force"]
                continue
            self.inference.tables["contacts", link] = {x: y.source() for x, y in parts.items()}
            self.note(sensor, "force_sensor", link=link)
        return rest

    def take_contacts(self, vectors: Sequence[Vector]) -> None:
        """Take columns for contacts: with the words of a link, or an array of one for each."""
        every, tables = self.floating.contact_links, self.inference.tables
        links = [link for link in every if ("contacts", link) not in tables]
        for name in self.inference.data:
            label = self.table.label(name)
            if is_of_base(label, "contact") and (link := nearest(label, every)[0]) in links:
                self._take_contact(link, name)
        if tables.keys() <= {("base",)}:
            self._take_in_order(links, vectors)

    def _take_in_order(self, links: Sequence[str], vectors: Sequence[Vector]) -> None:
        """Take an array for the contacts of the robot in their order."""
        arrays = (x for x in vectors if len(x.columns) == len(links))
        if vector := next((x for x in arrays if is_of_base(x.stem, "contact")), None):
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
        self.inference.tables["contacts", link].setdefault("contact", source)

    def take_loads(self) -> None:
        """Take "hip.load" for the torque of a joint, as Spot names it, if no column has one."""
        meanings = {**self.inference.meanings, **self.meanings}
        if any(meaning.quantity in ("torque", "current") for meaning in meanings.values()):
            return
        for name, m in self.inference.meanings.items():
            is_load = words_of(name)[-1:] == ["load"] and m.joint in self.robot.joint_names
            if is_load and not m.quantity:
                self.meanings[name] = replace(m, quantity="torque", side="")
                self.note(name, "load")

    def take_planar(self) -> None:
        """Take single columns for the coordinates, the angle and the rates of a planar base."""
        if self.floating.normal is None:
            return
        vectors = self._planar_vectors("xyz"[int(np.argmax(np.abs(self.floating.normal)))])
        turns = {x: vectors[x] for x in ("angle", "angular_velocity") if x in vectors}
        vectors |= {quantity: self._in_radians(source) for quantity, source in turns.items()}
        if len(turns) == 2:
            self._check_signs(*turns.values())
        # If the normal points up, gravity is along it, and no component in the plane feels it.
        if "specific_force" in vectors and abs(float(self.floating.normal_in_world[2])) < 0.5:
            force = vectors.pop("specific_force")
            about, values = force.column, self.samples(force.columns)
            if factor := self._acceleration_factor(about, values, "no_gravity_or_unit"):
                vectors["specific_force"] = replace(force, scale=factor)
        self.inference.tables["base",] = {**vectors, **self.base}

    def _check_signs(self, *turns: Source) -> None:
        """Note an angle whose derivative is minus the angular velocity."""
        angle, rate = (self.samples(source.columns) for source in turns)
        # Steps over rates: constant factors are in both norms and do not change the cosine.
        if _cosine(np.diff(angle, axis=0), rate[:-1]) < _OPPOSITE:
            self.note(turns[1].column, "opposite_rate")

    def _planar_vectors(self, normal: str) -> dict[str, Source]:
        """Return the vectors of single columns that nothing else has taken; note a lacking axis."""
        axes = dict.fromkeys(PLANAR, "xyz".replace(normal, ""))
        axes |= {"angle": normal, "angular_velocity": normal}
        vectors, parts = dict[str, Source](), self._planar_columns(normal)
        for quantity in [quantity for quantity in axes if quantity in parts]:
            columns = parts[quantity]
            if lacking := [axis for axis in axes[quantity] if axis not in columns]:
                self.note(next(iter(columns.values())), "no_plane_axis", axis=lacking[0])
            else:
                vectors[quantity] = Source(tuple(columns[axis] for axis in axes[quantity]))
        return vectors

    def _planar_columns(self, normal: str) -> dict[str, dict[str, str]]:
        """Return {quantity: {axis: column}} of single columns that nothing else has taken."""
        taken, joints = self.taken, self.robot.joint_names
        parts = dict[str, dict[str, str]]()
        for column in [x for x in self.inference.data if x not in taken]:
            quantity, axis = planar_meaning(self.table.label(column), normal)
            if quantity and self.inference.meanings[column].joint not in joints:
                parts.setdefault(quantity, {}).setdefault(axis, column)
        return parts

    def _in_radians(self, source: Source) -> Source:
        """Return the source of an angle or its rate, in degrees by its name or its range."""
        unit = self.inference.meanings[source.column].unit
        turn = np.ptp(self.inference.finite(source.column))
        if unit is None and turn > _TURNS:
            unit = "deg"
            self.note(source.column, "in_degrees", turn=turn)
        return replace(source, scale=math.pi / 180 if unit in ("deg", "deg/s") else 1.0)

    def decide_frames(self) -> None:
        """Decide the order of a quaternion and the frames of velocities by their samples."""
        base = self.base
        if "orientation" in base:
            columns = base["orientation"].columns
            order, frame = self._order(base["orientation"])
            if frame == "world":
                base["angular_velocity"] = replace(base["angular_velocity"], frame="world")
            base["orientation"] = Source(columns, order=None if order == "wxyz" else order)
            if "velocity" in base:
                R = _rotations(self.samples(columns), order)
                base["velocity"] = replace(base["velocity"], frame=self._velocity_frame(R))
        if {"velocity", "position", "specific_force"} & base.keys():
            base.pop("acceleration", None)
        elif "acceleration" in base:
            self.note("acceleration", "of_imu")

    def _order(self, source: Source) -> tuple[Order, Frame | None]:
        """Return the order of a quaternion, and the frame of the angular velocity."""
        base, values = self.base, self.samples(source.columns)
        orders: tuple[Order, ...] = ("wxyz",) if source.order else ("xyzw", "wxyz")
        scores: dict[tuple[Order, Frame | None], float] = {}
        for order in orders:
            R = _rotations(values, order)
            if "angular_velocity" in base:
                w = self.samples(base["angular_velocity"].columns)[:-1]
                # R(t+1) R(t)^T is a turn about w in the world, and R(t)^T R(t+1) one in the base.
                world = (R[1:] * R[:-1].inv()).as_rotvec()
                scores[order, "base"] = _cosine(R[:-1].inv().apply(world), w)
                scores[order, "world"] = _cosine(world, w)
            elif "specific_force" in base:
                # R f = a - g, whose mean is 9.81 upwards in the right order: a base does not
                # accelerate for long.
                f = self.samples(base["specific_force"].columns)
                scores[order, None] = float(np.mean(R.apply(f)[:, 2])) / 9.81
            else:
                # The z axis of a base is about upright: R_zz is near 1 in the right order.
                scores[order, None] = float(np.mean(R.as_matrix()[:, 2, 2]))
        (order, frame), best = max(scores.items(), key=lambda item: item[1])
        rivals = [score for (rival, _), score in scores.items() if rival != order]
        if rivals and best - max(rivals) < _CLEARER:
            self.note("orientation", "guessed_order", order=order)
        return order, frame

    def _velocity_frame(self, R: Rotation) -> Frame | None:
        """Return the frame of the velocity: that in which it is the derivative of the position."""
        if "position" not in self.base:
            self.note("velocity", "of_odometry")
            return "base"
        v = self.samples(self.base["velocity"].columns)[:-1]
        rate = np.diff(self.samples(self.base["position"].columns), axis=0)
        # p' = v in the world, or R v of one in the base's axes; they are equal while the base
        # hardly turns.
        in_world, in_base = _cosine(rate, v), _cosine(rate, R[:-1].apply(v))
        if abs(in_world - in_base) < _CLEARER / 5:
            self.note("velocity", "guessed_frame")
        return "base" if in_base > in_world else None

    def note_what_is_lacking(self) -> None:
        """Note the motion of a base of six degrees of freedom that no column says."""
        if self.floating.normal is not None:
            return
        quantities = self.base.keys()
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


def _is_elsewhere(name: str) -> bool:
    """Return whether a name is that of a command, or of a vector that the base does not have."""
    return is_of_base(name, "no_vector") or is_commanded(name)


def _rotations(quaternions: Array, order: Order) -> Rotation:
    """Return the rotations of quaternions (T, 4) of any length in an order; lost ones are held."""
    is_there = np.linalg.norm(quaternions, axis=1) > 0
    rows = np.maximum.accumulate(np.where(is_there, np.arange(len(is_there)), np.argmax(is_there)))
    return Rotation.from_quat(quaternions[rows], scalar_first=order == "wxyz")


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
