"""The semidefinite program of physical consistency: unknowns, limits, prior and start.

Limits are bounds of a body's mass and centre of mass, and drive parameters that are not negative.
Prior bodies are those of the robot file, repaired if physically inconsistent, or balls.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from seaid._arrays import Array, BoolArray, frozen, safely
from seaid.drives import JointParameter, parameter_of, readable
from seaid.errors import IdentificationError, RobotError, unknown_name
from seaid.estimation import Estimate, Program, covariance_root
from seaid.regressor import LoadModel
from seaid.robot import Robot, from_center_of_mass, from_pseudo_inertia, is_physical, pseudo_inertia

MassBounds = Mapping[str, tuple[float, float]]
"""{body: (least, most)} [kg]."""

Boxes = Mapping[str, tuple[Sequence[float], Sequence[float]]]
"""{body: (lower, upper)}, two corners [m] in the body's frame."""

_WIDTH = 1e-9
"""Half the width, relative or [m], of bounds that leave a single value."""

_LENGTH = 0.1


@dataclass(frozen=True, eq=False)
class Limit:
    """row @ unknowns >= bound, scaled to a natural size; `words` describe the active bound."""

    row: Array
    bound: float
    words: str


def body_limits(robot: Robot, bodies: Array, masses: MassBounds, boxes: Boxes) -> list[Limit]:
    """Return bounds of mass and centre of mass as inequalities of the standard parameters.

    `bodies` (n, 10) give the scale; infinite bounds are skipped. Raises IdentificationError for
    unknown bodies and for infeasible bounds.
    """
    limits = []
    for body, (least, most) in checked_masses(robot, masses).items():
        column = 10 * robot.body_names.index(body)
        size = bodies[column // 10, 0]
        for sign, bound, side in ((1, least, "lower"), (-1, most, "upper")):
            row = np.zeros(robot.parameters.size)
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
                row = np.zeros(robot.parameters.size)
                row[column + 1 + axis] = sign / size
                row[column] = -sign * bound / size
                words = f"centre of mass of {body} is at the {side} bound of its box in "
                limits.append(Limit(row, 0.0, words + f"{'xyz'[axis]}, {bound:.4g} m"))
    return [one for one in limits if np.all(np.isfinite(one.row)) and np.isfinite(one.bound)]


def interior_start(robot: Robot, bodies: Array, masses: MassBounds, boxes: Boxes) -> Array:
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
    """Return bounds of mass, those of a single value slightly widened; see `body_limits`."""
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
    """Return boxes (2, 3), those without width slightly widened; see `body_limits`."""
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
    """Return the value, or one strictly inside the bounds if it is not."""
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


BALL_MASS = 1.0
"""Mass [kg] of the ball that replaces an unknown body."""

SHIFT = 1e-3
"""Part of a ball added to a physically inconsistent or degenerate body."""

_safely = partial(safely, what="a body of the file", error=RobotError)

_DEGENERATE = 1e-5
_LEAST_RADIUS = 0.05


def balls(robot: Robot) -> Array:
    """Return a ball of 1 kg for every body (n, 10), as large as the robot's links.

    Its centre is the middle between the body's joint and the next ones, its radius half their
    distance (the mean of the robot for a body without a next joint), at least 5 cm.
    """
    model, count = robot.model, len(robot.body_names)
    centers, radii = np.zeros((count, 3)), np.full(count, np.nan)
    for position, index in enumerate(robot.model_order):
        ends = [
            model.jointPlacements[child].translation
            for child in range(1, model.njoints)
            if model.parents[child] == position + 1
        ]
        if ends:
            centers[index] = np.mean(ends, axis=0) / 2
            radii[index] = np.mean(np.linalg.norm(ends, axis=1)) / 2
    known = radii[np.isfinite(radii)]
    radii = np.where(np.isfinite(radii), radii, np.mean(known) if len(known) else 0.0)
    radii = np.maximum(radii, _LEAST_RADIUS)
    return np.array(
        [
            from_center_of_mass(BALL_MASS, center, 0.4 * BALL_MASS * radius**2 * np.eye(3))
            for center, radius in zip(centers, radii, strict=True)
        ]
    )


def prior_bodies(robot: Robot, parameters: Array) -> tuple[Array, tuple[str, ...]]:
    """Return consistent bodies (n, 10) with mass in every direction, and notes of changes.

    `parameters` (10n,) are those of the file or others. A body with NaN becomes its ball; an
    inconsistent one loses its negative part; it and a degenerate one (no mass, a point, a rod, a
    plate) get a thousandth of a ball of their mass. Raises RobotError for another shape.
    """
    given = np.asarray(parameters, dtype=float)
    if given.shape != robot.parameters.shape:
        raise RobotError(
            f"prior= must be the {robot.parameters.size} standard parameters of '{robot.name}', "
            f"found shape {given.shape}"
        )
    bodies, notes, plain = given.reshape(-1, 10).copy(), [], balls(robot)
    missing = ~np.all(np.isfinite(bodies), axis=1)
    if np.any(missing):
        names = ", ".join(np.array(robot.body_names)[missing])
        notes.append(f"no values in the prior: a ball of {BALL_MASS:g} kg replaces {names}")
    masses = bodies[~missing, 0]
    usual = float(np.mean(masses[masses > 0])) if np.any(masses > 0) else BALL_MASS
    for index, ball in enumerate(plain):
        if missing[index]:
            bodies[index] = ball
            continue
        scaled = ball * max(bodies[index, 0], 0.01 * usual)
        repaired = _repaired(bodies[index], scaled)
        if repaired is not None:
            kind = "degenerate" if is_physical(bodies[index]) else "physically inconsistent"
            notes.append(
                f"{robot.body_names[index]} is {kind} in the file: {SHIFT:g} of a ball of "
                f"{scaled[0]:.3g} kg was added"
            )
            bodies[index] = repaired
    return bodies, tuple(notes)


def _repaired(body: Array, ball: Array) -> Array | None:
    """Return a nearby consistent body for one without mass in some direction, otherwise None."""
    half = _safely(np.linalg.cholesky, pseudo_inertia(ball))
    inverse = _safely(np.linalg.inv, half)
    spread, vectors = _safely(np.linalg.eigh, inverse @ pseudo_inertia(body) @ inverse.T)
    if spread[0] >= _DEGENERATE:
        return None
    root = half @ vectors * np.sqrt(np.maximum(spread, 0.0) + SHIFT)
    return from_pseudo_inertia(root @ root.T)


NON_NEGATIVE = ("viscous_friction", "coulomb_friction", "motor_inertia", "stiffness")
"""Parameters of drives that cannot be negative."""


def body_program(
    robot: Robot,
    model: LoadModel,
    known: Estimate,
    bodies: Array,
    limits: list[Limit],
    start: Array,
) -> tuple[Program, list[str]]:
    """Return the program, and the description of each inequality as an active bound.

    Unknowns: the standard parameters, the parameters of stiff drives that the base parameters
    absorb, the other drive parameters.
    """
    m, absorbed = robot.parameters.size, len(model.absorbed)
    columns, pivots, own = _columns(model, known, m)
    root = covariance_root(known.covariance, known.values)
    largest = np.max(np.abs(model.absorption), axis=0, initial=0.0)
    names: list[str] = [JointParameter(name, joint) for joint, name, _ in model.absorbed]
    names += [known.names[row] for row in own]
    sizes = np.append(np.max(bodies[:, 4:]) / largest, np.linalg.norm(root, axis=1)[own])
    values = np.append(np.zeros(absorbed), known.values[own])
    signed = np.array([parameter_of(name) in NON_NEGATIVE for name in names], dtype=bool)
    all_limits = [replace(one, row=np.pad(one.row, (0, len(names)))) for one in limits]
    all_limits += _not_negative(names, sizes, signed, m)
    program = Program(
        columns=columns,
        pivots=pivots,
        estimate=known.values,
        root=root,
        prior=bodies,
        limits=np.array([one.row for one in all_limits]).reshape(-1, columns.shape[1]),
        bounds=np.array([one.bound for one in all_limits]),
        start=np.append(start, np.where(signed, np.maximum(values, 0.1 * sizes), values)),
    )
    return program, [one.words for one in all_limits]


def _columns(model: LoadModel, known: Estimate, m: int) -> tuple[Array, tuple[int, ...], list[int]]:
    """Return the columns of all unknowns in the estimate, its pivots, and the rows of drives."""
    start = m + len(model.absorbed)
    base = [known.names.index(name) for name in model.expressions]
    rows = [known.names.index(name) for name in model.names]
    own = [row for row in range(len(known.names)) if row not in base]
    columns = np.zeros((len(known.names), start + len(own)))
    columns[base, :m] = model.base.grouping
    columns[rows, m:start] = model.absorption
    columns[own, range(start, columns.shape[1])] = 1.0
    pivots = np.empty(len(known.names), dtype=int)
    pivots[base] = model.base.columns
    pivots[own] = range(start, columns.shape[1])
    return columns, tuple(map(int, pivots)), own


def _not_negative(names: Sequence[str], sizes: Array, signed: BoolArray, m: int) -> list[Limit]:
    """Return the limits of non-negative drive parameters, which follow `m` other unknowns."""
    limits = []
    for place in np.flatnonzero(signed).tolist():
        row = np.zeros(m + len(names))
        row[m + place] = 1 / sizes[place]
        limits.append(Limit(row, 0.0, f"{readable(names[place])} is zero"))
    return limits
