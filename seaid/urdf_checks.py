"""The elements of a URDF that count for the dynamics, checked: names, types, ends, numbers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from seaid.errors import RobotError, unknown_name

_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical")
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "velocity", "effort"), 1),
}
"""How many numbers each attribute has, of the elements that count for the dynamics."""
_NEEDED = {"mass": ("value",), "inertia": ("ixx", "iyy", "izz")}


def check_elements(path: Path, root: Any) -> None:
    """Refuse what yourdfpy would trip over or fill in: names, types, ends, numbers."""
    for tag in ("link", "joint"):
        names = [element.get("name") for element in root.findall(tag)]
        if not all(names):
            raise RobotError(f"URDF '{path}': a <{tag}> has no name")
        repeated = {name for name in names if names.count(name) > 1}
        if repeated:
            raise RobotError(f"URDF '{path}': {tag} name used twice: {', '.join(sorted(repeated))}")
    for joint in root.findall("joint"):
        where = f"URDF '{path}': joint '{joint.get('name')}'"
        if joint.get("type") not in _TYPES:
            kind = joint.get("type") or ""
            raise RobotError(f"{where}: " + unknown_name("joint type", kind, _TYPES))
        for tag in ("parent", "child"):
            end = joint.find(tag)
            if end is None or not end.get("link"):
                raise RobotError(f'{where} has no <{tag} link="...">')
        _check_numbers(where, joint)
        _check_limit(where, joint.find("limit"))
    for link in root.findall("link"):
        for inertial in link.findall("inertial"):
            _check_numbers(f"URDF '{path}': link '{link.get('name')}'", inertial)


def _check_numbers(where: str, parent: Any) -> None:
    for element in parent:
        for name, count in _NUMBERS.get(element.tag, {}).items():
            text = element.get(name)
            if text is None:
                if name in _NEEDED.get(element.tag, ()):
                    raise RobotError(f"{where}: <{element.tag}> has no {name}")
                continue
            try:
                found = [float(word) for word in text.split()]
            except ValueError:
                found = []
            endless = element.tag == "limit" and not any(map(math.isnan, found))
            if len(found) != count or not (endless or all(map(math.isfinite, found))):
                raise RobotError(
                    f"{where}: {name} of <{element.tag}> must be {count} finite number"
                    f"{'s' if count > 1 else ''}, found '{text}'"
                )


def _check_limit(where: str, limit: Any) -> None:
    if limit is None:
        return
    lower, upper = (float(limit.get(name, 0.0)) for name in ("lower", "upper"))
    if lower > upper:
        raise RobotError(f"{where}: its lower limit {lower} is above its upper limit {upper}")
    for name in ("velocity", "effort"):
        if float(limit.get(name, 0.0)) < 0:
            raise RobotError(f"{where}: its {name} limit is negative, {limit.get(name)}")
