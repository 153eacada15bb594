"""Feet that give way under their load, by the heights of the feet that stand.

Feet on hard ground keep their heights: h_k = up . r_k of two of them differ by a constant, by the
slope of the ground, and, if they sink in by c N under the normal force N, by -c (N_i - N_j). With
the contact forces of the fit that is a linear regression for c. Without the orientation of the base
the plane through four or more feet takes the place of the vertical.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag
from scipy.special import stdtrit

from seaid._arrays import Array, safely
from seaid.errors import ExcitationError, Finding
from seaid.estimation import ordinary
from seaid.identification.base_estimates import bodies_of_fit
from seaid.identification.contact_checks import foot_places
from seaid.identification.contact_forces import contacts_of, force_instants
from seaid.identification.datasets import Dataset
from seaid.identification.gear import for_sensors
from seaid.log import Motion, decimated, in_band, smoothed_where
from seaid.regressor import Regression

if TYPE_CHECKING:
    from seaid.identification.identification import Identification

_SAMPLES_PER_PERIOD = 8.0
"""Samples per period of the cutoff at which heights and forces are compared."""

_LEAST_SINK_M = 0.001
"""Sinking under the mean load from which there is a finding: what an encoder that is off by some
mrad, or a slope of the ground, looks like is below it."""

_LEVEL = 0.999
"""Level of the test."""

_FEWEST = 50
"""Instants with two feet that stand, or four without the orientation of the base, at least."""


def soft_feet_findings(found: Identification, datasets: Sequence[Dataset]) -> Iterator[Finding]:
    """Yield the sinking of feet under their load, if the heights of standing feet show one."""
    motions = [one for one in datasets if isinstance(one, Motion) and one.base is not None]
    if found.known.floating_base is None or len(motions) < len(datasets):
        return
    if any(one.base is None or one.base.wrenches or not one.base.contacts for one in motions):
        return
    found, _ = for_sensors(found, motions[0])
    bodies = bodies_of_fit(found)[0]
    parts = [_rows(found, for_sensors(found, one)[1], bodies) for one in motions]
    y, loads, others, time = ([part[place] for part in parts] for place in range(4))
    count = sum(map(len, y))
    if count < 2 * _FEWEST:
        return
    H = np.column_stack([np.concatenate(loads), block_diag(*others)])
    H = H[:, np.any(H != 0, axis=0)]
    rows = Regression(
        names=tuple(f"height {place}" for place in range(H.shape[1])),
        units=("",) * H.shape[1],
        H=H,
        y=np.concatenate(y),
        joint=np.zeros(count),
        time=np.concatenate(time),
        run=np.repeat(np.arange(len(y), dtype=float), list(map(len, y))),
        excluded=0,
        propagated=np.empty((count, 0)),
    )
    try:
        estimate = ordinary(rows)
    except ExcitationError:  # the load is always the same
        return
    compliance, error = float(estimate.values[0]), float(estimate.standard_errors[0])
    load_N = float(np.concatenate([part[4] for part in parts]).mean())
    freedom = estimate.degrees_of_freedom
    sure = 3.3 if freedom is None else float(stdtrit(np.min(freedom), 0.5 + _LEVEL / 2))
    if compliance < sure * error or compliance * load_N < _LEAST_SINK_M:
        return
    yield Finding(
        "soft-feet",
        f"the feet sink in by {1e3 * compliance * load_N:.2g} mm under their mean load of "
        f"{load_N:.3g} N, by {1e3 * compliance:.3g} +- {1e3 * error:.1g} mm/N: the contact forces "
        "act elsewhere than at rigid feet, which makes the mass some tenths of a per cent wrong, "
        "and no standard error contains that",
        severity="doubtful",
        evidence={
            "compliance [m/N]": compliance,
            "standard error [m/N]": error,
            "mean load [N]": load_N,
        },
        remedy="put the robot on hard ground, or harder feet on it; else load it with the radius "
        "of the feet under their mean load (radius_m), or check that the joints do not give way",
        certainty="likely",
    )


def _rows(
    found: Identification, motion: Motion, bodies: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Return heights (R,) of standing feet about their mean, loads (R,), and other columns (R, m).

    The last two results are the times (R,), and the loads of all standing feet.
    """
    factor = int(motion.rate_hz / (_SAMPLES_PER_PERIOD * motion.cutoff_hz))
    motion = decimated(motion, factor) if factor > 1 else motion
    robot, base = found.known, motion.base
    assert base is not None
    contacts = contacts_of(robot, motion)
    forces = force_instants(found, motion, contacts, bodies)
    up = base.up
    if up is None:
        mean = in_band(motion, base.specific_force)
        up = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    places = foot_places(robot, motion.joint_position, [one.link for one in contacts])
    places = smoothed_where(motion, places, forces.counts)
    height, load, *aside = (
        np.einsum("tki,ti->tk", of, axis)
        for of, axis in ((places, up), (forces.forces, up), *((places, x) for x in _level(up)))
    )
    counts = forces.counts & forces.used[:, None] & np.isfinite(height) & np.isfinite(load)
    k = len(contacts)
    offsets = [np.tile(one, (len(up), 1)) for one in np.eye(k)[1:]]  # of feet from the first one
    values = np.stack([height, -load, *aside, *offsets], axis=2)
    one = np.ones_like(height)
    hidden = np.stack([one] if base.up is not None else [one, *aside], axis=2)
    fewest = 2 if base.up is not None else 4
    picked = [(np.empty((0, values.shape[2])), np.empty(0), np.empty(0))]
    for pattern in np.unique(counts, axis=0):
        own = np.flatnonzero(pattern)
        if len(own) < fewest:
            continue
        mine = np.ix_(np.flatnonzero(np.all(counts == pattern, axis=1)), own)
        known = hidden[mine]
        inverse = safely(np.linalg.pinv, known, what="the places of standing feet")
        left = values[mine] - known @ inverse @ values[mine]
        time = np.repeat(motion.time[mine[0]], len(own))
        picked.append((left.reshape(-1, left.shape[2]), time, load[mine].ravel()))
    whole, time, loads = (np.concatenate([one[place] for one in picked]) for place in range(3))
    return whole[:, 0], whole[:, 1], whole[:, 2:], time, loads


def _level(up: Array) -> tuple[Array, Array]:
    """Return two level directions (T, 3) in the frame of the base, as near to its x and y."""
    first = np.cross([0.0, 1.0, 0.0], up)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-9)
    return first, np.cross(up, first)
