"""Bodies before any data: those of the robot file, mended where impossible, or plain balls."""

from __future__ import annotations

from functools import partial

import numpy as np

from seaid.arrays import Array
from seaid.errors import RobotError
from seaid.inertia import from_center_of_mass, from_pseudo_inertia, is_physical, pseudo_inertia
from seaid.linear_algebra import safely
from seaid.robot import Robot

BALL_MASS = 1.0
"""Mass [kg] of the ball that stands for a body of which nothing is known."""

SHIFT = 1e-3
"""Part of a ball that is added to a body that is impossible or degenerate."""

_safely = partial(safely, what="a body of the file", error=RobotError)

_DEGENERATE = 1e-5
_LEAST_RADIUS = 0.05


def balls(robot: Robot) -> Array:
    """Return a ball of 1 kg for every body (n, 10), as large as the robot's links.

    It lies between the body's joint and the next ones; its radius is half their distance, that of a
    body without any the robot's mean; at least 5 cm.
    """
    model, centers, radii = robot.model, np.zeros((robot.n, 3)), np.full(robot.n, np.nan)
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
    """Return possible bodies (n, 10) with mass in every direction, and in words what was changed.

    `parameters` (10n,) are those of the file or any others; a body with NaN becomes its ball; one
    that is impossible loses its negative part, and it and a degenerate one (no mass, a point, a
    rod, a plate) get a thousandth of a ball of their mass. Raises RobotError for another shape.
    """
    given = np.asarray(parameters, dtype=float)
    if given.shape != (10 * robot.n,):
        raise RobotError(
            f"prior= must be the {10 * robot.n} standard parameters of '{robot.name}', found shape "
            f"{given.shape}"
        )
    bodies, notes, plain = given.reshape(-1, 10).copy(), [], balls(robot)
    missing = ~np.all(np.isfinite(bodies), axis=1)
    if np.any(missing):
        names = ", ".join(np.array(robot.body_names)[missing])
        notes.append(f"no values to start from: a ball of {BALL_MASS:g} kg stands for {names}")
    masses = bodies[~missing, 0]
    usual = float(np.mean(masses[masses > 0])) if np.any(masses > 0) else BALL_MASS
    for index, ball in enumerate(plain):
        if missing[index]:
            bodies[index] = ball
            continue
        scaled = ball * max(bodies[index, 0], 0.01 * usual)
        mended = _mended(bodies[index], scaled)
        if mended is not None:
            kind = "degenerate" if is_physical(bodies[index]) else "impossible"
            notes.append(
                f"{robot.body_names[index]} is {kind} in the file: {SHIFT:g} of a ball of "
                f"{scaled[0]:.3g} kg was added"
            )
            bodies[index] = mended
    return bodies, tuple(notes)


def _mended(body: Array, ball: Array) -> Array | None:
    """Return a possible body near one that has no mass in some direction; None for all others."""
    half = _safely(np.linalg.cholesky, pseudo_inertia(ball))
    inverse = _safely(np.linalg.inv, half)
    spread, vectors = _safely(np.linalg.eigh, inverse @ pseudo_inertia(body) @ inverse.T)
    if spread[0] >= _DEGENERATE:
        return None
    root = half @ vectors * np.sqrt(np.maximum(spread, 0.0) + SHIFT)
    return from_pseudo_inertia(root @ root.T)
