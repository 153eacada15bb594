"""What the names of columns say of vectors of a floating base, of contacts and of a planar base.

`place_of` reads the vector and the component of a column, `kind_of` the quantity of a vector, and
`planar_meaning` that of a single column of a planar base: by phrases of vocabulary.toml.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from seaid.log.describe.names import known_unit, vocabulary
from seaid.log.description import VectorSource
from seaid.log.log import UNIT_FACTORS

_TURNING_ABOUT = {"x": "roll", "y": "pitch", "z": "yaw"}

_OF_UNITS = {
    **{"m": "position", "m_per_s": "velocity", "rad_per_s": "angular_velocity"},
    **{"m_per_s2": "specific_force", "N": "", "Nm": "", "rad": ""},
}
"""{SI unit of a component: the quantity of its vector, if no word says it}."""

_AXIS = re.compile(r"(?:^|[._/ ]|(?<=[a-z])(?=[WXYZ]))([qpvwaftmFMT]?)([wxyzWXYZ])(?=[._/ \[(]|$)")
"""A component in a name, with the letter of its vector: "acc_x", "GyroX", "pelvis_tx"."""

_INDEXED = re.compile(r"(.*)\[(\d+)\]")
_NUMBERED = re.compile(r"(.*[A-Za-z])_?(\d+)")
_WRENCH = re.compile(r"(.+?)[._/ ]+(force|f|moment|torque|tau|t|m)", re.IGNORECASE)
_GLUED = re.compile(r"(root|d{1,2}|[vapwq])?([xyz]|pitch|roll|yaw)(d{1,2}ot|dot|d)?")
"""A coordinate with its rate in one word: "dx", "vx", "xdot", "rootz", "dpitch"."""


@cache
def _phrases(table: str, entry: str) -> tuple[str, ...]:
    """Return the words and the phrases of an entry of the vocabulary."""
    words, *phrases = vocabulary().tables[table][entry].split(", ")
    return (*words.split(), *phrases)


def _says(words: Sequence[str], table: str, entry: str) -> bool:
    """Return whether words have one of the phrases of an entry of the vocabulary."""
    text = f" {' '.join(words)} "
    return any(f" {phrase} " in text for phrase in _phrases(table, entry))


def words_of(name: str) -> list[str]:
    """Return the words of a name in small letters, glued coordinates and rates apart."""
    words: list[str] = []
    for word in re.findall(r"[a-z]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()):
        before, axis, after = (
            glued.groups() if (glued := _GLUED.fullmatch(word)) else ("", word, "")
        )
        if before == "root":  # a hinge about y, slides along the others
            words += ["root", "pitch" if axis == "y" else axis]
            continue
        rates = (before or "").count("d") + (after or "").count("d")
        rate = ["vel" if rates == 1 else "acc"] if rates else [before] if before else []
        words += [axis, *rate]
    return words


def kind_of(name: str) -> str:
    """Return the quantity of the base that a name says, an empty text if none."""
    words = words_of(name)
    if words[-1:] == ["t"] and _says(words, "base_words", "body"):  # a translation: "trunk.t"
        return "position"
    kinds = vocabulary().tables["base"]
    return next((kind for kind in kinds if _says(words, "base", kind)), "")


def is_commanded(name: str) -> bool:
    """Return whether a name is that of a command."""
    return not vocabulary().roles["commanded"].isdisjoint(words_of(name))


def is_elsewhere(name: str) -> bool:
    """Return whether a name is that of a command, or of a vector that the base does not have."""
    return _says(words_of(name), "base_words", "no_vector") or is_commanded(name)


def is_contact(name: str) -> bool:
    """Return whether a name is that of a contact."""
    return _says(words_of(name), "base_words", "contact")


def _unit(tail: str) -> tuple[str, float] | None:
    """Return quantity and factor to SI of the unit behind a component, None if it is none."""
    text = re.sub(r"[\s_.\[\]()^*]|(?<=/)/|^/", "", tail.replace("_per_", "/").replace("²", "2"))
    if not text:
        return "", 1.0
    of_vectors = vocabulary().tables["base_units"].items()
    unit = next((unit for unit, texts in of_vectors if text in texts.split()), "")
    unit = unit or (known_unit(text) or ("", ""))[1]
    for si, quantity in _OF_UNITS.items():
        if unit in UNIT_FACTORS[si]:
            return quantity, UNIT_FACTORS[si][unit]
    return None


@dataclass(frozen=True)
class Vector:
    """Columns that differ in a component or in their place in an array, and their factor to SI."""

    stem: str
    columns: tuple[str, ...]
    factor: float = 1.0
    is_array: bool = False

    def source(self, **more: Any) -> VectorSource:
        """Return the source of the vector."""
        return VectorSource(self.columns, **{"scale": self.factor, **more})


def force_sensors(vectors: Sequence[Vector]) -> dict[str, dict[str, Vector]]:
    """Return {sensor: {"force" and "moment": vector}} of what is no command."""
    sensors: dict[str, dict[str, Vector]] = {}
    for vector in vectors:
        match = _WRENCH.fullmatch(vector.stem)
        if match and len(vector.columns) == 3 and not is_commanded(vector.stem):
            quantity = "force" if match[2].lower().startswith("f") else "moment"
            sensors.setdefault(match[1], {})[quantity] = vector
    return {sensor: parts for sensor, parts in sensors.items() if "force" in parts}


def place_of(bare: str, file: str) -> tuple[str, str, str, float]:
    """Return form, stem, place and factor of a column as that of a vector.

    The form is "array" of q[3] and of the numbered columns of a file, "axis" of a component with
    the factor of its unit, "number" of a name that ends in one, or an empty text.
    """
    if part := _INDEXED.fullmatch(bare):
        return "array", part[1], part[2], 1.0
    if bare.isdecimal() and file:
        return "array", file.rsplit(".", 1)[0], bare, 1.0
    if component := _component(bare):
        return "axis", *component
    number = _NUMBERED.fullmatch(bare)
    return ("number", number[1], number[2], 1.0) if number else ("", "", "", 1.0)


def _component(bare: str) -> tuple[str, str, float] | None:
    """Return the name of a vector, the axis of a column and its factor: "GyroX [deg/s]"."""
    for match in _AXIS.finditer(bare):
        stem, unit = bare[: match.start()], _unit(bare[match.end() :])
        if unit is None or not (stem or match[1]):
            continue
        quantity, factor = unit
        stem += f"_{match[1]}" if match[1] else ""
        if quantity and not kind_of(stem) and _says(words_of(stem), "base_words", "body"):
            stem = f"{stem}.{quantity}"
        return stem, match[2].lower(), factor
    return None


def planar_meaning(bare: str, normal: str) -> tuple[str, str] | None:
    """Return (quantity, axis) of a name, None if it is not that of a planar base."""
    words, known = {*words_of(bare)}, _planar_words()
    rest = words - known["body"] - known["filler"]
    axes, angles = rest & {*"xyz"}, rest & {*_phrases("base_words", _TURNING_ABOUT[normal])}
    if words & known["body"] and not axes:
        angles |= rest & known["angle"]
    # What remains must be words of one quantity only: an unknown word makes it another column.
    rest -= axes | angles
    if angles and not axes:  # "base_pos_pitch_dot" is a rate
        return _of_angle(rest - {"pos"}, normal)
    kind = next((kind for kind in _PLANAR if rest <= known[kind]), "")
    # A rate may lack its axis, which is the normal of the plane: "gyro".
    is_rate = kind == "angular_velocity"
    (axis, *more) = sorted(axes) or ([normal] if is_rate else [""])
    is_along = (axis == normal) == is_rate
    return (kind, axis) if kind and axis and is_along and not more else None


def _of_angle(rest: set[str], normal: str) -> tuple[str, str] | None:
    """Return (quantity, axis) of the words next to that of an angle."""
    kinds = [kind for kind in _PLANAR if rest <= _planar_words()[kind]]
    return next(((_PLANAR[kind], normal) for kind in kinds if _PLANAR[kind]), None)


_PLANAR = {
    **{"position": "angle", "velocity": "", "specific_force": ""},
    "angular_velocity": "angular_velocity",
}
"""{quantity of the words of a name: the quantity next to the word of an angle, if any}."""


@cache
def _planar_words() -> dict[str, set[str]]:
    """Return the words of a planar base by what they say; a rate may be that of an angle."""
    tables = vocabulary().tables["planar_words"]
    words = {x: {*_phrases("base_words", x)} for x in ("body", "filler", "angle")}
    words |= {x: {*_phrases("base", x), *tables.get(x, "").split()} for x in _PLANAR}
    words["angular_velocity"] |= words["velocity"]
    return words
