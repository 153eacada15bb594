"""Inference of the columns of a floating base: poses, velocities, accelerations, contacts.

Vectors are found by their names and by their samples: a quaternion has unit length, the angular
velocity is its derivative, an accelerometer feels gravity, a contact is 0 or 1. Arrays of n + 7 and
n + 6 columns are generalised positions and velocities, of the base and then of the joints; which of
them is a derivative of which, and where they lie in one table without names, the samples show.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from seaid._arrays import Array
from seaid.log.base_columns import Frame, Order, VectorSource
from seaid.log.base_log import matrices
from seaid.log.describe.inference import Inference
from seaid.log.describe.names import Meaning, meaning_of
from seaid.log.infer_planar import infer_planar, planar_states
from seaid.log.readers.table import Table
from seaid.robot import Robot

_UNIT = 0.02
"""Deviation of the length of a quaternion from one."""

_GRAVITY = (8.0, 12.0)
"""Median length [m/s^2] of a specific force; without gravity it is far less."""

_IN_G = 0.1
"""Deviation of the median vector of an accelerometer from one, for one in g: without gravity the
vector is near zero."""

_CLEARER = 0.05
"""Difference of two correlations from which the larger one decides."""

_BASE = r"(?<![a-z])(?:base|trunk|torso|pelvis|body|root|imu|mocap|vicon|odom)(?![a-z])"
"""Words that name the base: only with one of them a unit alone says what a vector is."""

_KINDS = {
    "orientation": r"quat|orient|rotation|attitude",
    "angular_velocity": r"gyr|omega|ang|(?<![a-z])w$|rot\w*[._/ ]?vel",
    "specific_force": r"acc|specific|(?<![a-z])[af]$",
    "velocity": r"vel|twist|(?<![a-z])v$",
    "position": rf"pos|trans|(?<![a-z])p$|{_BASE}.*[._/ ]t$",
}
"""{quantity: a pattern of the names of its vectors}, the first that fits."""

_UNITS: dict[str, tuple[str | None, float]] = {
    **{"": (None, 1.0), "N": (None, 1.0), "kN": (None, 1e3), "mN": (None, 1e-3)},
    **{"Nm": (None, 1.0), "mNm": (None, 1e-3), "kNm": (None, 1e3), "rad": (None, 1.0)},
    **{"m": ("position", 1.0), "cm": ("position", 1e-2), "mm": ("position", 1e-3)},
    **{"m/s": ("velocity", 1.0), "cm/s": ("velocity", 1e-2), "mm/s": ("velocity", 1e-3)},
    **{"rad/s": ("angular_velocity", 1.0), "mrad/s": ("angular_velocity", 1e-3)},
    "deg/s": ("angular_velocity", np.pi / 180),
    **{"m/s2": ("specific_force", 1.0), "mm/s2": ("specific_force", 1e-3)},
    **{"g": ("specific_force", 1.0), "mg": ("specific_force", 1e-3)},
}
"""{unit: (quantity of a vector whose name says none, factor)}; g is found by the samples."""

_OTHER_UNITS = {
    **{"mps": "m/s", "ms": "m/s", "mps2": "m/s2", "m/s/s": "m/s2", "ms2": "m/s2", "ms-2": "m/s2"},
    **{"rads": "rad/s", "radps": "rad/s", "degs": "deg/s", "dps": "deg/s", "°/s": "deg/s"},
    **{"mms": "mm/s", "cms": "cm/s", "deg": "deg/s"},
}
"""Spellings of units: "rad_s" is that of a rate, and degrees only have rates in vectors."""

_COMMANDS = r"cmd|des\w*|ref|target|command\w*"
_COMMANDED = re.compile(rf"(?<![a-z])({_COMMANDS})(?![a-z])")
_ELSEWHERE = re.compile(rf"(?<![a-z])(joint|motor|ee|tool|{_COMMANDS})(?![a-z])")
_CONTACT = re.compile(r"contact|touch|stance|foot[._/ ]?force|grf")
_WRENCH = re.compile(r"(.+?)[._/ ]+(force|f|moment|torque|tau|t|m)", re.IGNORECASE)
_ANGULAR_ACCELERATION = re.compile(r"ang.*acc|acc.*ang|domega")
_COMPONENT = re.compile(r"(.+?)(?:[._/ ]([wxyzWXYZ])|(?<=[a-z])([WXYZ]))((?:[._/ \[(].*)?)")
_SHORT_NAME = re.compile(r"(?:(.*)[._/ ])?([qpvwaftmFMT])([wxyzXYZ])((?:[._/ \[(].*)?)")
_TAKEN = Meaning("base", "", "", None, is_raw=False)


@dataclass
class BaseGuess:
    """What was found: vectors of the base and of contacts, and meanings of the other columns."""

    base: dict[str, VectorSource] = field(default_factory=dict)
    contacts: dict[str, dict[str, VectorSource]] = field(default_factory=dict)
    meanings: dict[str, Meaning] = field(default_factory=dict)

    def columns(self) -> list[str]:
        """Return the columns of the vectors."""
        vectors = [self.base, *self.contacts.values()]
        return [name for x in vectors for source in x.values() for name in source.columns]


def infer_base(table: Table, inference: Inference, robot: Robot) -> BaseGuess:
    """Return the columns of the base and of contacts of a log; `inference` has all samples."""
    assert robot.floating_base is not None
    guess = BaseGuess()
    vectors = _vectors(table, inference, robot) or _in_one_table(table, inference, robot)
    derivatives = _derivatives(vectors, inference, robot)
    for stem, names in vectors.items():
        if len(names) in (robot.n, *_widths(robot)) and _is_indexed(stem, names):
            _add_generalised(guess, stem, names, inference, robot, derivatives.get(stem, ""))
    others = _add_wrenches(guess, vectors, table, inference, robot)
    for stem, names in vectors.items():
        if not set(names) & set(guess.meanings):
            _add_vector(guess, stem, names, inference, _scale(names, table))
    taken = {tuple(source.columns) for source in guess.base.values()}
    for sensor, names in others.items():
        if tuple(names) not in taken:
            inference.note(sensor, "a force sensor whose name is not that of one contact: not used")
    _add_contacts(guess, table, vectors, inference, robot)
    _add_loads(guess, inference, robot)
    if robot.floating_base.normal is not None:
        # What arrays and vectors were taken for has precedence over single columns.
        free = {x: table.bare(x) for x in inference.data if x not in _used(guess, robot, inference)}
        planar = infer_planar(free, inference, robot.floating_base)
        guess.base = {**planar, **guess.base}
    _decide_frames(guess, inference)
    _note_what_is_lacking(guess, inference, robot)
    guess.meanings |= dict.fromkeys(guess.columns(), _TAKEN)
    return guess


def _widths(robot: Robot) -> tuple[int, ...]:
    """Return the columns of generalised positions and velocities of base and joints."""
    base = robot.floating_base
    is_planar = base is not None and base.normal is not None
    return (robot.n + 3,) if is_planar else (robot.n + 7, robot.n + 6)


def _used(guess: BaseGuess, robot: Robot, inference: Inference) -> set[str]:
    """Return the columns that are taken, or have the name of a joint of the robot."""
    of_joints = {x for x, m in inference.meanings.items() if m.joint in robot.joint_names}
    return {*guess.meanings, *of_joints, *guess.columns()}


def _vectors(table: Table, inference: Inference, robot: Robot) -> dict[str, list[str]]:
    """Return {stem: its columns}: parts of arrays and files without names, and components.

    Columns that differ in their last number, as "gyro_0", are a vector if there are as many as of a
    vector of the base, or of its contacts.
    """
    assert robot.floating_base is not None
    stems: dict[str, dict[str, str]] = {}
    numbered: dict[str, dict[str, str]] = {}
    for name in inference.data:
        bare, file = table.bare(name), table.files.get(name, "")
        part, number = re.fullmatch(r"(.*)\[(\d+)\]", bare), _NUMBERED.fullmatch(bare)
        component = _component(bare)
        if part:
            stems.setdefault(f"{part[1]}[", {})[part[2]] = name
        elif bare.isdecimal() and file:
            stems.setdefault(f"{file.rsplit('.', 1)[0]}[", {})[bare] = name
        elif component:
            stems.setdefault(component[0], {}).setdefault(component[1], name)
        elif number:
            numbered.setdefault(f"{number[1]}[", {})[number[2]] = name
    sizes = {3, 4, 7, *_widths(robot), len(robot.floating_base.contacts)}
    stems |= {x: parts for x, parts in numbered.items() if x not in stems and len(parts) in sizes}
    return _whole_vectors(stems, inference, robot.floating_base.normal is not None)


def _component(bare: str) -> tuple[str, str] | None:
    """Return the name of a vector and the axis of a column: "GyroX [deg/s]", "pelvis_tx_mm"."""
    if (match := _SHORT_NAME.fullmatch(bare)) and _unit(match[4]) in _UNITS:
        return f"{match[1] or ''}_{match[2]}", match[3].lower()
    if (match := _COMPONENT.fullmatch(bare)) and _unit(match[4]) in _UNITS:
        stem, quantity = match[1], _UNITS[_unit(match[4])][0]
        if quantity and not _kind_of(stem) and re.search(_BASE, stem.lower().replace("_", " ")):
            stem = f"{stem}.{quantity}"
        return stem, (match[2] or match[3]).lower()
    return None


def _unit(tail: str) -> str:
    """Return the unit that ends the name of a component, without its spelling."""
    bare = re.sub(r"[\s_.\[\]()^*]|(?<=/)/|^/", "", tail.replace("_per_", "/").replace("²", "2"))
    return _OTHER_UNITS.get(bare, bare)


def _scale(names: Sequence[str], table: Table) -> float:
    """Return the factor to SI units of the unit in the names of a vector."""
    matches = [_SHORT_NAME.fullmatch(x) or _COMPONENT.fullmatch(x) for x in map(table.bare, names)]
    units = {_unit(match[4]) for match in matches if match}
    return _UNITS[units.pop()][1] if len(units) == 1 else 1.0


def _whole_vectors(
    stems: Mapping[str, Mapping[str, str]], inference: Inference, is_planar: bool
) -> dict[str, list[str]]:
    """Return the columns in order of the stems with all parts; note a vector that lacks one."""
    vectors = {}
    for stem, parts in stems.items():
        lacking = [x for x in "xyz" if x not in parts]
        if stem.endswith("["):
            vectors[stem] = [parts[place] for place in sorted(parts, key=int)]
        elif not lacking:
            vectors[stem] = [parts[x] for x in "wxyz" if x in parts]
        elif is_planar or len(lacking) != 1:
            continue
        elif _kind_of(stem) and not _ELSEWHERE.search(stem.lower()):
            inference.note(stem, f"has no {lacking[0]}: a vector of the base needs x, y and z")
    return vectors


_NUMBERED = re.compile(r"(.*[A-Za-z])_?(\d+)")
"""A name that ends in a number."""


def _in_one_table(table: Table, inference: Inference, robot: Robot) -> dict[str, list[str]]:
    """Return the vectors of one table of numbers: positions with a quaternion, and what follows.

    Behind the n + 7 positions come arrays of n + 6, those of n torques, and flags of the contacts.
    """
    assert robot.floating_base is not None
    names = list(inference.data)
    if table.files or not all(map(str.isdecimal, names)):
        return {}
    n, feet = robot.n, len(robot.floating_base.contacts)
    # From the fourth column on, behind three coordinates, and with n joints behind the quaternion.
    windows = ((place, names[place : place + 4]) for place in range(3, len(names) - n - 3))
    place = next((x for x, four in windows if _is_quaternion(_samples(four, inference))), None)
    if place is None:
        return {}
    start, place = place - 3, place + 4 + n
    vectors = {"q[": names[start:place]}
    rate = _samples(names[place - n : place], inference)
    widths = {"velocity[": n + 6, "acceleration[": n + 6, "torque[": n, "contact[": feet}
    for stem, width in widths.items():
        columns = names[place : place + width]
        if len(columns) < width:
            continue
        if width == n + 6:
            values, derivative = _samples(columns[-n:], inference), np.diff(rate, axis=0)
            if _cosine(derivative, values[: len(derivative)]) < _DERIVED:
                continue
            rate = values
        vectors[stem] = columns
        place += width
    text = ", ".join(f"{stem[:-1]} ({len(columns)})" for stem, columns in vectors.items())
    inference.note(f"columns {names[start]} to {names[place - 1]}", f"taken for {text}")
    return vectors


_DERIVED = 0.6
"""Cosine of a derivative of the joints and an array of the same length from which it is that."""


def _derivatives(
    vectors: Mapping[str, Sequence[str]], inference: Inference, robot: Robot
) -> dict[str, str]:
    """Return {stem: "velocity" or "acceleration"} of arrays whose names say nothing."""
    words = {stem: meaning_of(stem.removesuffix("[")) for stem in vectors}
    arrays = {
        stem: _samples(names[-robot.n :], inference)
        for stem, names in vectors.items()
        if len(names) in (robot.n, *_widths(robot)) and _is_indexed(stem, names)
    }
    positions = [x for x in arrays if _are_positions(len(vectors[x]), words[x], robot)]
    if not positions:
        return {}
    derivatives: dict[str, str] = {}
    rate = arrays[max(positions, key=lambda stem: len(vectors[stem]))]
    for quantity in ("velocity", "acceleration"):
        # The acceleration is compared with the derivative of the velocity that was found, if any:
        # one derivative has less noise than two.
        rate = np.diff(rate, axis=0)
        others = {
            stem: _cosine(rate, values[: len(rate)])
            for stem, values in arrays.items()
            if not words[stem].quantity and stem not in {*positions, *derivatives}
        }
        best = max(others, key=others.__getitem__, default="")
        if best and others[best] > _DERIVED:
            derivatives[best] = quantity
            rate = arrays[best]
            inference.note(best[:-1], f"the {quantity} by its samples")
    return derivatives


def _are_positions(width: int, meaning: Meaning, robot: Robot) -> bool:
    """Return whether an array has the positions of base and joints, or by its name of joints."""
    is_position = meaning.quantity == "position" and meaning.is_raw
    return width == robot.n + 7 or (width == robot.n and is_position)


def _is_indexed(stem: str, names: Sequence[str]) -> bool:
    return stem.endswith("[") and len(names) > 4


def _samples(names: Sequence[str], inference: Inference) -> Array:
    return np.column_stack([inference.data[name] for name in names])


def _is_quaternion(values: Array) -> bool:
    length = np.linalg.norm(values, axis=1)
    return values.shape[1] == 4 and float(np.median(np.abs(length - 1))) < _UNIT


def _add_generalised(
    guess: BaseGuess,
    stem: str,
    names: list[str],
    inference: Inference,
    robot: Robot,
    derivative: str,
) -> None:
    """Take an array of n, n + 6 or n + 7 columns for states of the base and of the joints."""
    base, joints = names[: -robot.n], names[-robot.n :]
    meaning = meaning_of(stem.removesuffix("["))
    quantity = meaning.quantity or derivative
    if len(base) == 7:
        if not _is_quaternion(_samples(base[3:], inference)):
            return
        guess.base["position"] = VectorSource(tuple(base[:3]))
        guess.base["orientation"] = VectorSource(tuple(base[3:]))
        quantity = "position"
    elif len(base) == 6 and quantity == "velocity":
        guess.base["velocity"] = VectorSource(tuple(base[:3]))
        guess.base["angular_velocity"] = VectorSource(tuple(base[3:]))
    elif not quantity:
        return
    elif len(base) == 3:
        guess.base |= planar_states(base, quantity)
    guess.meanings |= dict.fromkeys(base, _TAKEN)
    for name, joint in zip(joints, robot.joint_names, strict=True):
        guess.meanings[name] = Meaning(quantity, "", joint, meaning.unit, meaning.is_raw)
    about = f"{stem.removesuffix('[')}: its last {robot.n} columns" if base else stem[:-1]
    order = f"{robot.joint_names[0]}, {robot.joint_names[1]}, ..." if robot.n > 1 else "one"
    inference.note(about, f"taken for the robot's joints in their order ({order})")


def _add_vector(
    guess: BaseGuess, stem: str, names: list[str], inference: Inference, scale: float
) -> None:
    """Take a vector for what its name and its samples say; `scale` is that of its unit."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", stem).lower().removesuffix("[")
    others = (_ELSEWHERE, _CONTACT, _ANGULAR_ACCELERATION)
    if len(names) not in (3, 4, 7) or any(pattern.search(text) for pattern in others):
        return
    values = _samples(names, inference)
    if len(names) == 7 and _is_quaternion(values[:, 3:]):
        guess.base.setdefault("position", VectorSource(tuple(names[:3])))
        guess.base.setdefault("orientation", VectorSource(tuple(names[3:])))
        return
    if _is_quaternion(values):
        source = VectorSource(tuple(names), order=None if stem.endswith("[") else "wxyz")
        guess.base.setdefault("orientation", source)
        return
    kind = _kind_of(text)
    if len(names) == 4 or kind in (None, "orientation"):
        return
    frame: Frame | None = None
    if kind == "specific_force":
        values = scale * values
        typical = float(np.median(np.linalg.norm(values, axis=1)))
        # The length of the median, not the median of the lengths, to which vibrations always add.
        if abs(float(np.linalg.norm(np.median(values, axis=0))) - 1.0) < _IN_G:
            scale *= 9.80665
            inference.note(stem.removesuffix("["), "points up with 1 at rest: taken for g")
        elif not _GRAVITY[0] < typical < _GRAVITY[1]:
            text = f"its median is {typical:.2g} m/s^2, without gravity: used if nothing else is"
            inference.note(stem.removesuffix("["), text)
            kind, frame = "acceleration", "base"
    guess.base.setdefault(str(kind), VectorSource(tuple(names), frame=frame, scale=scale))


def _kind_of(text: str) -> str | None:
    """Return the quantity of the base that a name says."""
    return next((kind for kind, words in _KINDS.items() if re.search(words, text.lower())), None)


def _add_wrenches(
    guess: BaseGuess,
    vectors: Mapping[str, list[str]],
    table: Table,
    inference: Inference,
    robot: Robot,
) -> dict[str, list[str]]:
    """Take force sensors for the contacts whose names share the most words with theirs.

    Returns the forces {name: columns} that may be those of other sensors.
    """
    assert robot.floating_base is not None
    sensors = _force_sensors(vectors)
    places = [sensor for sensor, parts in sensors.items() if "force" in parts]
    links = robot.floating_base.contact_links
    if not links:  # a force that is at no contact is that of another sensor
        return {sensor: sensors[sensor]["force"] for sensor in places}
    others = {}
    words = [{*_words(link)} for link in links]
    shared = np.array([[len(x & {*_words(sensor)}) for x in words] for sensor in places])
    for place, sensor in enumerate(places):
        best = int(np.argmax(shared[place]))
        # More words than with any other contact, and than any other sensor shares with this
        # contact.
        rivals = [*np.delete(shared[place], best), *np.delete(shared[:, best], place)]
        if shared[place, best] <= max(rivals, default=0):
            others[sensor] = sensors[sensor]["force"]
            continue
        parts = sensors[sensor]
        guess.contacts[links[best]] = {
            x: VectorSource(tuple(names), scale=_scale(names, table)) for x, names in parts.items()
        }
        guess.meanings |= {name: _TAKEN for names in parts.values() for name in names}
        text = f"taken for the force of the ground on {links[best]}, in the axes of that link"
        inference.note(sensor, text)
    return others


def _force_sensors(vectors: Mapping[str, list[str]]) -> dict[str, dict[str, list[str]]]:
    """Return {sensor: {"force" or "moment": columns}} of what is no command."""
    sensors: dict[str, dict[str, list[str]]] = {}
    for stem, names in vectors.items():
        match = _WRENCH.fullmatch(stem)
        if match and len(names) == 3 and not _COMMANDED.search(stem.lower()):
            quantity = "force" if match[2].lower().startswith("f") else "moment"
            sensors.setdefault(match[1], {})[quantity] = names
    return sensors


def _add_contacts(
    guess: BaseGuess,
    table: Table,
    vectors: Mapping[str, list[str]],
    inference: Inference,
    robot: Robot,
) -> None:
    """Take columns for contacts: of the name of a link, or an array with one column for each."""
    assert robot.floating_base is not None
    links = [x for x in robot.floating_base.contact_links if x not in guess.contacts]
    for link in links:
        words = _words(link)
        for name in inference.data:
            texts = _words(table.bare(name))
            if words[0] in texts and _CONTACT.search(table.bare(name).lower()):
                _add_contact(guess, link, name, inference)
    for stem, names in vectors.items():
        if _CONTACT.search(stem.lower()) and len(names) == len(links) and not guess.contacts:
            for link, name in zip(links, names, strict=True):
                _add_contact(guess, link, name, inference)
            text = f"taken for the contacts in the order of the robot: {', '.join(links)}"
            inference.note(stem.removesuffix("["), text)


def _add_loads(guess: BaseGuess, inference: Inference, robot: Robot) -> None:
    """Take "hip.load" for the torque of a joint, as Spot names it, if no other column has one."""
    meanings = {**inference.meanings, **guess.meanings}
    if any(meaning.quantity in ("torque", "current") for meaning in meanings.values()):
        return
    for name, m in inference.meanings.items():
        if not m.quantity and m.joint in robot.joint_names and _words(name)[-1] == "load":
            guess.meanings[name] = replace(m, quantity="torque", side="")
            inference.note(name, "taken for the torque of the joint")


def _words(name: str) -> list[str]:
    return re.findall(r"[a-z]+|\d+", name.lower())


def _add_contact(guess: BaseGuess, link: str, name: str, inference: Inference) -> None:
    """Take a column for a flag, or for a force with a threshold in the middle of its range."""
    values = inference.finite(name)
    above = None
    kinds, scale = set(np.unique(values)), 1.0
    if kinds <= {0.0, 1.0, 2.0} and 2.0 in kinds:
        # `above` is a lower limit, so that the codes are negated: -1 is above -1.5, and -2 is not.
        above, scale = -1.5, -1.0
        inference.note(name, "codes: 1 is taken for contact, 2 for its loss, as Spot has them")
    elif not kinds <= {0.0, 1.0}:
        # Quantiles, because impacts exceed the force on a standing foot by far.
        low, high = np.quantile(values, [0.05, 0.95])
        above = float(f"{low + 0.2 * (high - low):.3g}")
        inference.note(name, f"a force: above {above:g} it is taken for contact")
    guess.contacts.setdefault(link, {}).setdefault(
        "contact", VectorSource((name,), scale=scale, above=above)
    )


def _decide_frames(guess: BaseGuess, inference: Inference) -> None:
    """Decide the order of a quaternion and the frames of velocities by their samples."""
    source = guess.base.get("orientation")
    if source is not None:
        order, frame = _order(guess, source, inference)
        if frame == "world":
            w = guess.base["angular_velocity"]
            guess.base["angular_velocity"] = replace(w, frame="world")
        R = matrices(_in_order(_samples(source.columns, inference), order))
        order_or_none = None if order == "wxyz" else order
        guess.base["orientation"] = VectorSource(source.columns, order=order_or_none)
        velocity = guess.base.get("velocity")
        if velocity is not None:
            axes = _velocity_frame(guess, velocity, R, inference)
            guess.base["velocity"] = replace(velocity, frame=axes)
    if {"velocity", "position", "specific_force"} & set(guess.base):
        guess.base.pop("acceleration", None)
    elif "acceleration" in guess.base:
        inference.note("acceleration", "taken for that of the base in its own axes, as of an IMU")


def _note_what_is_lacking(guess: BaseGuess, inference: Inference, robot: Robot) -> None:
    """Note the motion of a base of six degrees of freedom that no column says."""
    assert robot.floating_base is not None
    if robot.floating_base.normal is not None:
        return
    quantities, turning = set(guess.base), {"orientation", "angular_velocity"}
    if not quantities & turning:
        inference.note("base", f"no column found of how it turns: name one in [base] ({_TURNING})")
    moving = quantities & {"specific_force", "acceleration"}
    if not moving and not ("orientation" in quantities and quantities & {"position", "velocity"}):
        inference.note(
            "base",
            "no column found of how it accelerates: name in [base] the specific_force of an IMU, "
            "or position or velocity, with the orientation",
        )


_TURNING = "orientation or angular_velocity"


def _in_order(values: Array, order: Order) -> Array:
    values = values / np.linalg.norm(values, axis=1, keepdims=True)
    return values if order == "wxyz" else np.asarray(values[:, [3, 0, 1, 2]])


def _order(
    guess: BaseGuess, source: VectorSource, inference: Inference
) -> tuple[Order, Frame | None]:
    """Return the order of a quaternion, and the frame of the angular velocity."""
    values = _samples(source.columns, inference)
    orders: tuple[Order, ...] = ("wxyz",) if source.order else ("xyzw", "wxyz")
    scores: dict[tuple[Order, Frame | None], float] = {}
    for order in orders:
        R = matrices(_in_order(values, order))
        if "angular_velocity" in guess.base:
            w = _samples(guess.base["angular_velocity"].columns, inference)
            # the rows of R' are those of R turned: R(t+1) R(t)^T is a turn about w in the world
            turn = np.einsum("tij,tkj->tik", R[1:], R[:-1])
            world = np.column_stack([_axial(turn, *pair) for pair in ((2, 1), (0, 2), (1, 0))])
            body = np.einsum("tji,tj->ti", R[:-1], world)
            scores[order, "base"] = _cosine(body, w[:-1])
            scores[order, "world"] = _cosine(world, w[:-1])
        elif "specific_force" in guess.base:
            f = _samples(guess.base["specific_force"].columns, inference)
            # R f = a - g, whose mean is 9.81 upwards in the right order: a base does not accelerate
            # for long.
            scores[order, None] = float(np.mean(np.einsum("tij,tj->ti", R, f)[:, 2])) / 9.81
        else:
            # The z axis of a base is about upright: R_zz is near 1 in the right order.
            scores[order, None] = float(np.mean(R[:, 2, 2]))
    (order, frame), best = max(scores.items(), key=lambda item: item[1])
    others = [score for (rival, _), score in scores.items() if rival != order]
    if others and best - max(others) < _CLEARER:
        inference.note("orientation", f"its order {order} is a guess: no other column decides it")
    return order, frame


def _axial(turn: Array, i: int, j: int) -> Array:
    return np.asarray(turn[:, i, j] - turn[:, j, i])


def _cosine(first: Array, second: Array) -> float:
    """Return the cosine of two signals (T, 3) without short noise, None of their scales matters."""
    first, second = (_smoothed(x) for x in (first, second))
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.sum(first * second)) / size if size > 0 else 0.0


_SMOOTHED = 15
"""Samples over which derivatives are averaged before they are compared."""


def _smoothed(values: Array) -> Array:
    # The moving sum in place of the mean: a cosine does not have its factor.
    total = np.cumsum(values, axis=0)
    return np.asarray(total[_SMOOTHED:] - total[:-_SMOOTHED])


def _velocity_frame(
    guess: BaseGuess, velocity: VectorSource, R: Array, inference: Inference
) -> Frame | None:
    """Return the frame of a velocity: that in which it is the derivative of the position."""
    if "position" not in guess.base:
        inference.note("velocity", "taken for that in the axes of the base, as in an odometry")
        return "base"
    v = _samples(velocity.columns, inference)
    rate = np.diff(_samples(guess.base["position"].columns, inference), axis=0)
    # p' = v in the world, or R v of one in the base's axes; they are equal while the base hardly
    # turns.
    in_world, in_base = _cosine(rate, v[:-1]), _cosine(rate, np.einsum("tij,tj->ti", R, v)[:-1])
    if abs(in_world - in_base) < _CLEARER / 5:
        inference.note("velocity", "its frame is a guess: the base hardly turns")
    return "base" if in_base > in_world else None
