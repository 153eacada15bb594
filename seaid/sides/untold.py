"""Bent parameters that a motion cannot tell: held where the search left them, and said in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from seaid.arrays import Array
from seaid.drivetrain.model import Drive
from seaid.drivetrain.values import unit_of
from seaid.estimation.estimate import Estimate
from seaid.linear_algebra import safely
from seaid.robot import Robot

_UNSEEN = 1e-6
"""Singular value of columns of unit norm, relative to the largest, below which one is not told."""

_PART = 0.1

_LEVEL = {"stribeck_speed": "stribeck_friction", "stribeck_friction": "stribeck_speed"}
"""What has no meaning without the other."""


def told(drive: Drive, names: Sequence[str], H: Array, bent: Sequence[str]) -> Drive:
    """Return the drive with those of its `bent` parameters known that the columns H do not tell.

    H (R, p) has the columns `names` at the drive's values. A dead zone of zero beside no other
    curve, a Stribeck speed where nothing sticks: the equations are singular in them.
    """
    held: list[str] = []
    while True:
        kept = [place for place, name in enumerate(names) if name not in held]
        name = _lost([names[place] for place in kept], H[:, kept], [*bent, *_LEVEL])
        if name is None:
            return replace(drive, known=(*drive.known, *held)) if held else drive
        held.append(name)


def _lost(names: Sequence[str], H: Array, candidates: Sequence[str]) -> str | None:
    """Return the candidate that a combination without effect has most of, if there is any."""
    norms = np.linalg.norm(H, axis=0)
    may_go = np.array([name in candidates for name in names])
    dead = np.flatnonzero((norms == 0) & may_go)
    if len(dead):
        return names[int(dead[0])]
    if not len(names):
        return None
    _, sizes, vectors = safely(
        np.linalg.svd,
        H / np.where(norms > 0, norms, 1.0),
        what="the columns of a drive",
        full_matrices=False,
    )
    share = np.abs(vectors[-1])
    place = int(np.argmax(np.where(may_go, share, 0.0)))
    lost = sizes[-1] < _UNSEEN * sizes[0] and may_go[place] and share[place] > _PART * share.max()
    return names[place] if lost else None


def with_held_flags(
    drives: Mapping[str, Estimate], given: Robot, robot: Robot
) -> dict[str, Estimate]:
    """Return estimates of drives with a flag for every parameter that became known by a search."""
    flagged = dict(drives)
    for joint, estimate in drives.items():
        drive, before = robot.drivetrains[joint], given.drivetrains[joint].known
        held = tuple(
            f"{name.replace('_', ' ')} of {joint} is not told by this motion: taken as "
            f"{drive.values[name]:.3g} {unit_of(drive, name)}; leave its term out, or excite it"
            for name in drive.known
            if name not in before
        )
        flagged[joint] = replace(estimate, flags=held + estimate.flags)
    return flagged
