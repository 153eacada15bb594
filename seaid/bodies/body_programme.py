"""The programme whose solution are possible bodies: its unknowns, their limits, its start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seaid.arrays import Array, BoolArray
from seaid.bodies.body_bounds import Limit
from seaid.estimation.estimate import Estimate
from seaid.estimation.programme import Programme, root_of
from seaid.robot import Robot
from seaid.sides.load_model import LoadModel

NON_NEGATIVE = ("viscous_friction", "coulomb_friction", "motor_inertia", "stiffness")
"""Parameters of drives that cannot be negative."""


def body_programme(
    robot: Robot,
    model: LoadModel,
    known: Estimate,
    bodies: Array,
    limits: list[Limit],
    start: Array,
) -> tuple[Programme, list[str]]:
    """Return the programme, and what it means in words that an inequality is active.

    Unknowns: the standard parameters, what the base parameters absorb of stiff drives, the drives'
    parameters.
    """
    m, absorbed = 10 * robot.n, len(model.absorbed)
    columns, pivots, own = _columns(model, known, m)
    root = root_of(known.covariance, known.values)
    largest = np.max(np.abs(model.absorption), axis=0, initial=0.0)
    names = [f"{name} of {joint}" for joint, name, _ in model.absorbed]
    names += [known.names[row] for row in own]
    sizes = np.append(np.max(bodies[:, 4:]) / largest, np.linalg.norm(root, axis=1)[own])
    values = np.append(np.zeros(absorbed), known.values[own])
    signed = np.array([name.split(" of ", 1)[0] in NON_NEGATIVE for name in names], dtype=bool)
    all_limits = [replace(one, row=np.pad(one.row, (0, len(names)))) for one in limits]
    all_limits += _not_negative(names, sizes, signed, m)
    programme = Programme(
        columns=columns,
        pivots=pivots,
        estimate=known.values,
        root=root,
        prior=bodies,
        limits=np.array([one.row for one in all_limits]).reshape(-1, columns.shape[1]),
        bounds=np.array([one.bound for one in all_limits]),
        start=np.append(start, np.where(signed, np.maximum(values, 0.1 * sizes), values)),
    )
    return programme, [one.words for one in all_limits]


def _columns(model: LoadModel, known: Estimate, m: int) -> tuple[Array, tuple[int, ...], list[int]]:
    """Return what all unknowns are in the estimate, its pivots, and its rows that are drives' own.

    `m` unknowns are standard parameters.
    """
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
    """Return the limits of the parameters of drives, after `m` others, that are not negative."""
    limits = []
    for place in np.flatnonzero(signed).tolist():
        row = np.zeros(m + len(names))
        row[m + place] = 1 / sizes[place]
        parameter, joint = names[place].split(" of ", 1)
        limits.append(Limit(row, 0.0, f"{parameter.replace('_', ' ')} of {joint} is zero"))
    return limits
