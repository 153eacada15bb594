"""What a user knows of a body's mass and centre of mass, as linear inequalities."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid.arrays import Array, frozen
from seaid.errors import IdentificationError, unknown_name
from seaid.inertia import from_pseudo_inertia, pseudo_inertia
from seaid.robot import Robot

MassBounds = Mapping[str, tuple[float, float]]
"""{body: (least, most)} [kg]."""

Boxes = Mapping[str, tuple[Sequence[float], Sequence[float]]]
"""{body: (lower, upper)}, two corners [m] in the body's frame."""

_WIDTH = 1e-9
"""Half the width, relative or [m], that bounds have which leave a single value."""

_LENGTH = 0.1


@dataclass(frozen=True, eq=False)
class Limit:
    """row @ unknowns >= bound, in a natural size of both; `words` say that it is active."""

    row: Array
    bound: float
    words: str


def body_limits(robot: Robot, bodies: Array, masses: MassBounds, boxes: Boxes) -> list[Limit]:
    """Return bounds of mass and centre of mass as inequalities of the standard parameters.

    `bodies` (n, 10) give the size; infinite bounds are left out. Raises IdentificationError for
    names that are no bodies and for bounds that no body can keep.
    """
    limits = []
    for body, (least, most) in checked_masses(robot, masses).items():
        column = 10 * robot.body_names.index(body)
        size = bodies[column // 10, 0]
        for sign, bound, side in ((1, least, "lower"), (-1, most, "upper")):
            row = np.zeros(10 * robot.n)
            row[column] = sign / size
            words = f"mass of {body} is at its {side} bound, {bound:.4g} kg"
            if most - least <= 3 * _WIDTH * most:
                words = f"mass of {body} is given, {bound:.4g} kg"
            limits.append(Limit(row, sign * bound / size, words))
    for body, corners in checked_boxes(robot, boxes).items():
        column = 10 * robot.body_names.index(body)
        size = bodies[column // 10, 0] * _LENGTH
        for sign, corner, side in zip((1, -1), corners, ("lower", "upper"), strict=True):
            for axis, bound in enumerate(corner):
                row = np.zeros(10 * robot.n)
                row[column + 1 + axis] = sign / size
                row[column] = -sign * bound / size
                words = f"centre of mass of {body} is at the {side} bound of its box in "
                limits.append(Limit(row, 0.0, words + f"{'xyz'[axis]}, {bound:.4g} m"))
    return [one for one in limits if np.all(np.isfinite(one.row)) and np.isfinite(one.bound)]


def inside(robot: Robot, bodies: Array, masses: MassBounds, boxes: Boxes) -> Array:
    """Return standard parameters (10n,) of bodies like the given ones strictly inside bounds."""
    moved = bodies.copy()
    bounds, corners = checked_masses(robot, masses), checked_boxes(robot, boxes)
    for index, body in enumerate(robot.body_names):
        pseudo = pseudo_inertia(bodies[index])
        mass, center = pseudo[3, 3], pseudo[:3, 3] / pseudo[3, 3]
        spread = pseudo[:3, :3] / mass - np.outer(center, center)
        mass = _between(mass, *bounds.get(body, (0.0, np.inf)))
        if body in corners:
            center = [_between(*values) for values in zip(center, *corners[body], strict=True)]
        column = np.append(center, 1.0)
        pseudo = mass * np.outer(column, column)
        pseudo[:3, :3] += mass * spread
        moved[index] = from_pseudo_inertia(pseudo)
    return moved.ravel()


def checked_masses(robot: Robot, masses: MassBounds) -> dict[str, tuple[float, float]]:
    """Return bounds of mass, those that leave one value a little wider; see `body_limits`."""
    _check_names(robot, "mass_bounds", masses)
    checked = {}
    for body, given in masses.items():
        least, most = _pair(f"mass_bounds of '{body}'", given, (2,), "(least, most) in kg")
        if not (0 <= least <= most and most > 0 and least < np.inf):
            raise IdentificationError(
                f"mass_bounds of '{body}' leave no mass: found {least:g} to {most:g} kg; allowed: "
                "0 <= least <= most, most more than 0"
            )
        wide = _WIDTH * most if least == most else 0.0
        checked[body] = (float(least - wide), float(most + wide))
    return checked


def checked_boxes(robot: Robot, boxes: Boxes) -> dict[str, Array]:
    """Return boxes (2, 3), those without width a little wider; see `body_limits`."""
    _check_names(robot, "com_boxes", boxes)
    checked = {}
    for body, given in boxes.items():
        box = _pair(f"com_boxes of '{body}'", given, (2, 3), "two corners of x, y, z in m")
        lower, upper = box
        if np.any(lower > upper) or np.any(lower == np.inf) or np.any(upper == -np.inf):
            raise IdentificationError(
                f"com_boxes of '{body}' leave no point: lower corner {lower.tolist()}, upper "
                f"{upper.tolist()}; allowed: lower <= upper in x, y and z"
            )
        wide = np.where(lower == upper, _WIDTH, 0.0)
        checked[body] = np.array([lower - wide, upper + wide])
    return checked


def _between(value: float, lower: float, upper: float) -> float:
    """Return the value, or one strictly inside if it is not."""
    if lower < value < upper:
        return float(value)
    if np.isfinite(lower) and np.isfinite(upper):
        return float(lower + upper) / 2
    return float(
        lower + max(abs(lower), 0.1) if np.isfinite(lower) else upper - max(abs(upper), 0.1)
    )


def _check_names(robot: Robot, option: str, names: Iterable[str]) -> None:
    for name in names:
        if name not in robot.body_names:
            raise IdentificationError(f"{option}=: " + unknown_name("body", name, robot.body_names))


def _pair(where: str, value: Any, shape: tuple[int, ...], meaning: str) -> Array:
    try:
        pair = frozen(where, value, shape, IdentificationError)
    except IdentificationError as problem:
        raise IdentificationError(f"{problem}; give {meaning}") from None
    if np.any(np.isnan(pair)):
        raise IdentificationError(f"{where} must be {meaning}, found {pair.tolist()}")
    return pair
