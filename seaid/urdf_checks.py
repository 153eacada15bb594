"""The elements of a URDF that count for the dynamics, checked: names, types, ends, numbers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from seaid.errors import RobotError, shortened, unknown_name
from seaid.inertia import LARGEST_KG, LARGEST_KG_M2, LARGEST_M, SMALLEST_KG

_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical")
_LARGEST_RAD = 1e4
_LONGEST_NAME = 1000


class _Numbers(NamedTuple):
    """How many numbers an attribute has, and how large they may be, with the unit."""

    many: int
    largest: float = math.inf
    unit: str = ""


_NUMBERS: Mapping[str, Mapping[str, _Numbers]] = {
    "origin": {"xyz": _Numbers(3, LARGEST_M, "m"), "rpy": _Numbers(3, _LARGEST_RAD, "rad")},
    "axis": {"xyz": _Numbers(3)},
    "mass": {"value": _Numbers(1, LARGEST_KG, "kg")},
    "inertia": dict.fromkeys(
        ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), _Numbers(1, LARGEST_KG_M2, "kg m^2")
    ),
    "limit": dict.fromkeys(("lower", "upper", "velocity", "effort"), _Numbers(1)),
}
"""Attributes of the elements that count for the dynamics."""
_NEEDED = {"mass": ("value",), "inertia": ("ixx", "iyy", "izz")}
_ONCE = {
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": (
        *("origin", "parent", "child", "axis", "limit"),
        *("dynamics", "mimic", "calibration", "safety_controller"),
    ),
}
"""Elements of which there is one at most; which of several was meant nobody can know."""


def check_elements(path: Path, root: Any) -> None:
    """Refuse what yourdfpy would trip over, fill in or pass over: names, types, ends, numbers."""
    _check_length(path, "robot", root.get("name") or "")
    joints, links = root.findall("joint"), root.findall("link")
    _check_names(path, "link", links)
    _check_names(path, "joint", joints)
    for joint in joints:
        where = f"URDF '{path}': joint '{joint.get('name')}'"
        if joint.get("type") not in _TYPES:
            kind = joint.get("type") or ""
            raise RobotError(f"{where}: " + unknown_name("joint type", kind, _TYPES))
        _check_once(where, joint)
        for tag in ("parent", "child"):
            end = joint.find(tag)
            if end is None or not end.get("link"):
                raise RobotError(f'{where} has no <{tag} link="...">')
        _check_numbers(where, joint)
        _check_limit(where, joint.find("limit"))
    for link in links:
        where = f"URDF '{path}': link '{link.get('name')}'"
        _check_once(where, link)
        for inertial in link.findall("inertial"):
            _check_once(where, inertial)
            _check_numbers(where, inertial)


def _check_names(path: Path, tag: str, elements: list[Any]) -> None:
    names = Counter(element.get("name") for element in elements)
    if not all(names):
        raise RobotError(f"URDF '{path}': a <{tag}> has no name")
    repeated = [name for name, count in names.items() if count > 1]
    if repeated:
        raise RobotError(
            f"URDF '{path}': {tag} name used twice: {shortened(', '.join(sorted(repeated)))}"
        )
    _check_length(path, tag, max(names, key=len, default=""))


def _check_length(path: Path, tag: str, name: str) -> None:
    if len(name) > _LONGEST_NAME:
        raise RobotError(
            f"URDF '{path}': the name of a {tag} has {len(name):,} letters, allowed are "
            f"{_LONGEST_NAME:,}: '{shortened(name)}'"
        )


def _check_once(where: str, parent: Any) -> None:
    """Refuse a second element of which one counts: a reader would pass over one of the two."""
    counts = Counter(element.tag for element in parent)
    for tag in _ONCE[parent.tag]:
        if counts[tag] > 1:
            inside = "" if parent.tag in ("link", "joint") else f" in its <{parent.tag}>"
            raise RobotError(
                f"{where} has {counts[tag]} elements <{tag}>{inside}: leave the one that is meant"
            )


def _check_numbers(where: str, parent: Any) -> None:
    for element in parent:
        for name, wanted in _NUMBERS.get(element.tag, {}).items():
            text = element.get(name)
            if text is not None:
                _check_number(where, element.tag, name, text, wanted)
            elif name in _NEEDED.get(element.tag, ()):
                raise RobotError(f"{where}: <{element.tag}> has no {name}")


def _check_number(where: str, tag: str, name: str, text: str, wanted: _Numbers) -> None:
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        found = []
    endless = tag == "limit" and not any(map(math.isnan, found))
    if len(found) != wanted.many or not (endless or all(map(math.isfinite, found))):
        raise RobotError(
            f"{where}: {name} of <{tag}> must be {wanted.many} finite number"
            f"{'s' if wanted.many > 1 else ''}, found '{shortened(text)}'"
        )
    if any(abs(number) > wanted.largest for number in found):
        allowed = f"-{wanted.largest:g} to {wanted.largest:g} {wanted.unit}"
        raise RobotError(
            f"{where}: {name} of <{tag}> is beyond what a robot can have, found "
            f"'{shortened(text)}': allowed are {allowed}"
        )
    if tag == "mass" and 0 < abs(found[0]) < SMALLEST_KG:
        raise RobotError(
            f"{where}: its mass is too small to count with, found '{shortened(text)}': allowed "
            f"are 0 and {SMALLEST_KG:g} to {LARGEST_KG:g} kg"
        )


def _check_limit(where: str, limit: Any) -> None:
    if limit is None:
        return
    lower, upper = (float(limit.get(name, 0.0)) for name in ("lower", "upper"))
    if lower > upper:
        raise RobotError(f"{where}: its lower limit {lower} is above its upper limit {upper}")
    for name in ("velocity", "effort"):
        if float(limit.get(name, 0.0)) < 0:
            raise RobotError(f"{where}: its {name} limit is negative, {shortened(limit.get(name))}")
