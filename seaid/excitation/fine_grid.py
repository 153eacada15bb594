"""How far a planned motion stays from its limits, looked at more closely than the search did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seaid.arrays import Array
from seaid.excitation.drive_limits import DRIVE_KINDS, drive_loads
from seaid.excitation.limits import JointLimits, Margins, margins
from seaid.excitation.problem import Problem, drawn_together, is_curved, seen_at, states_of
from seaid.excitation.scene import distances
from seaid.excitation.trajectory import Trajectory

_FINER, _MOST_INSTANTS = 8, 2000


def motion_within(problem: Problem, x: Array) -> Array:
    """Return x, drawn towards zero if a limit is broken between the instants of the search."""
    return drawn_together(_closer(problem), x, 1.0) if is_curved(problem) else x


def all_margins(problem: Problem, x: Array, trajectory: Trajectory, bounds: JointLimits) -> Margins:
    """Return the margins of the motion x: the linear ones at every instant, the others on a grid.

    The grid has eight times the instants of the search, 2000 at most.
    """
    found = margins(trajectory, bounds)
    if not is_curved(problem):
        return found
    fine = _closer(problem)
    states = states_of(fine, x)
    if fine.drive_limits is not None:
        most = np.abs(drive_loads(fine.drive_limits, fine.time, states)).max(axis=1)
        left = fine.drive_limits.most - most
        found = replace(found, **dict(zip(DRIVE_KINDS, left, strict=True)))
    if fine.scene is not None:
        found = replace(found, distance_m=float(distances(fine.scene, states[0]).min()))
    return found


def _closer(problem: Problem) -> Problem:
    samples = len(problem.time)
    return seen_at(problem, min(_FINER * samples, max(_MOST_INSTANTS, samples)))
