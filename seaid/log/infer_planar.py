"""Inference of the columns of a planar base: two coordinates, an angle, and their rates.

Logs of robots on a boom have single columns of them, such as "x", "z", "pitch" and "pitch_rate", or
arrays of n + 3 columns, of the base and then of the joints.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from seaid._arrays import Array
from seaid.log.base_columns import VectorSource
from seaid.log.describe.inference import Inference
from seaid.robot import FloatingBase

_ANGLES = {"x": ("roll",), "y": ("pitch",), "z": ("yaw", "heading")}
_ANY_ANGLE = {"angle", "theta", "phi", "tilt", "rot", "rotation", "orientation"}
"""Words of an angle next to one of the base: without it they are those of any joint."""

_BASE = {"base", "boom", "body", "trunk", "torso", "root", "pelvis", "hull", "imu", "floating"}
_POSITION = {"pos", "position", "p", "q", "qpos", "trans", "translation"}
_RATE = {"dot", "vel", "velocity", "rate", "speed", "v", "d", "qvel", "qd", "dq"}
_TURNING = {"gyro", "gyr", "omega", "w", "ang", "angular"}
_ACCELERATION = {"acc", "accel", "acceleration", "accelerometer", "a", "specific", "force", "f"}
_NO_MEANING = {"meas", "measured", "raw", "filt", "est", "state", "in", "of", "the", "m", "s", "g"}
_NO_MEANING |= {"rad", "deg", "degree", "degrees", "per", "mps", "rads", "dps", "2"}
_VECTORS = {"position": _POSITION, "velocity": _RATE, "specific_force": _ACCELERATION}
_GLUED = re.compile(r"(root|d{1,2}|[vapwq])?([xyz]|pitch|roll|yaw)(d{1,2}ot|dot|d)?")
"""A coordinate with its rate in one word: "dx", "vx", "xdot", "rootz", "dpitch"."""

_TURNS = 2.5 * math.pi
"""Range of an angle without a unit from which it is in degrees: a base on a boom turns less."""

_OPPOSITE = -0.8
"""Correlation of the derivative of the angle with the rate from which one has the other sign."""

_RATES = 15
"""Samples over which a derivative is averaged."""

_GRAVITY = (8.0, 12.0)
"""Median length [m/s^2] of a specific force in a plane that stands upright."""


def infer_planar(
    names: Mapping[str, str], inference: Inference, base: FloatingBase
) -> dict[str, VectorSource]:
    """Return the vectors of a planar base among single columns.

    Parameters
    ----------
    names : mapping {column: its name without that of its file}
    inference : Inference
        Has the samples, the units and the notes.
    base : FloatingBase
        Of which the axes of the plane, and the normal, are asked for.
    """
    normal = "xyz"[int(np.argmax(np.abs(np.array(base.normal))))]
    plane = tuple(x for x in "xyz" if x != normal)
    columns: dict[tuple[str, str], str] = {}
    for column, bare in names.items():
        meaning = _meaning(bare, normal)
        if meaning is not None:
            columns.setdefault(meaning, column)
    vectors: dict[str, VectorSource] = {}
    for quantity in ("position", "velocity", "specific_force"):
        components = [columns[quantity, x] for x in plane if (quantity, x) in columns]
        if len(components) == 2:
            vectors[quantity] = VectorSource(tuple(components))
        elif components:
            lacking = next(x for x in plane if (quantity, x) not in columns)
            inference.note(components[0], f"has no {lacking}: the plane of the base needs both")
    for quantity in ("angle", "angular_velocity"):
        if (quantity, normal) in columns:
            vectors[quantity] = _in_radians(columns[quantity, normal], inference)
    _check_signs(vectors, inference)
    return _with_gravity(vectors, base, inference)


def planar_states(base: Sequence[str], quantity: str) -> dict[str, VectorSource]:
    """Return the vectors of an array that begins with two coordinates and an angle, or rates."""
    *places, angle = base
    if quantity == "position":
        return {"position": VectorSource(tuple(places)), "angle": VectorSource((angle,))}
    if quantity == "velocity":
        return {"velocity": VectorSource(tuple(places)), "angular_velocity": VectorSource((angle,))}
    return {}


def _meaning(bare: str, normal: str) -> tuple[str, str] | None:
    """Return (quantity, axis) of a name, None if it is not that of a planar base."""
    words = {*_words(bare)}
    is_of_base, rest = bool(_BASE & words), words - _BASE - _NO_MEANING
    axes, angles = rest & set("xyz"), rest & {*_ANGLES[normal]}
    if is_of_base and not axes:
        angles |= rest & _ANY_ANGLE
    # What remains must be words of one quantity only: an unknown word makes it another column.
    rest -= axes | angles
    if angles and not axes:
        if rest <= _POSITION:
            return "angle", normal
        return ("angular_velocity", normal) if rest <= _RATE | _TURNING | {"pos"} else None
    if rest & _TURNING and rest <= _TURNING | _RATE and (axes or {normal}) == {normal}:
        return "angular_velocity", normal
    if len(axes) != 1 or normal in axes:
        return None
    (axis,) = axes
    return next(((quantity, axis) for quantity, known in _VECTORS.items() if rest <= known), None)


def _words(bare: str) -> Iterator[str]:
    """Yield the words of a name in small letters, glued coordinates and rates apart."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", bare)
    for word in re.findall(r"[a-z]+|\d+", text.lower()):
        glued = _GLUED.fullmatch(word)
        if not glued:
            yield word
            continue
        before, axis, after = glued.groups()
        if before == "root":  # a hinge about y, slides along the others
            yield from ("root", {"y": "pitch"}.get(axis, axis))
            continue
        rates = (before or "").count("d") + (after or "").count("d")
        yield axis
        if rates:
            yield "vel" if rates == 1 else "acc"
        elif before:
            yield before


def _in_radians(column: str, inference: Inference) -> VectorSource:
    """Return the source of an angle or its rate, in degrees by its name or its range."""
    unit, values = inference.meanings[column].unit, inference.finite(column)
    by_name = re.search(r"(?<![a-z])(deg|degrees?|dps)(?![a-z])|°", column.lower())
    if unit in ("deg", "deg/s") or by_name:
        return VectorSource((column,), scale=math.pi / 180)
    if unit is None and not re.search("rad", column.lower()) and np.ptp(values) > _TURNS:
        inference.note(column, f"turns by {np.ptp(values):.3g} without a unit: taken for degrees")
        return VectorSource((column,), scale=math.pi / 180)
    return VectorSource((column,))


def _check_signs(vectors: Mapping[str, VectorSource], inference: Inference) -> None:
    """Note an angle whose derivative is minus the angular velocity."""
    if not {"angle", "angular_velocity"} <= vectors.keys():
        return
    angle, rate = (
        inference.data[vectors[x].columns[0]] * vectors[x].scale
        for x in ("angle", "angular_velocity")
    )
    # Steps over rates: a constant step of time is in both norms and does not change the cosine.
    turned, meant = _averaged(np.diff(angle)), _averaged(rate[:-1])
    both = np.isfinite(turned) & np.isfinite(meant)
    size = float(np.linalg.norm(turned[both]) * np.linalg.norm(meant[both]))
    if size and float(turned[both] @ meant[both]) / size < _OPPOSITE:
        column = vectors["angular_velocity"].columns[0]
        inference.note(column, "minus the derivative of the angle: one of them needs scale = -1")


def _averaged(values: Array) -> Array:
    total = np.cumsum(values)
    return np.asarray(total[_RATES:] - total[:-_RATES])


def _with_gravity(
    vectors: dict[str, VectorSource], base: FloatingBase, inference: Inference
) -> dict[str, VectorSource]:
    """Return the vectors without an acceleration that feels no gravity, where the plane does."""
    force = vectors.get("specific_force")
    # If the normal points up, gravity is along it, and no component in the plane feels it.
    if force is None or abs(float(base.normal_in_world[2])) > 0.5:
        return vectors
    values = np.column_stack([inference.data[column] for column in force.columns])
    typical = float(np.nanmedian(np.linalg.norm(values, axis=1)))
    if _GRAVITY[0] < typical < _GRAVITY[1]:
        return vectors
    inference.note(
        force.columns[0],
        f"its median is {typical:.2g} m/s^2, without gravity or in another unit: not used",
    )
    return {name: source for name, source in vectors.items() if name != "specific_force"}
