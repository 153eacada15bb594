"""Checks of the feet of a legged robot after a fit: radius, flags, forces, soft ground; total mass.

A radius that is wrong by d puts the contact forces f too low by d: it adds d times the moments of f
about the vertical displacement to J_c^T f. With the f of the fit that is one more column of its
rows, as are forces on feet that are flagged as in the air.

Feet on hard ground keep their heights: h_k = up . r_k of two of them differ by a constant, by the
slope of the ground, and, if they sink in by c N under the normal force N, by -c (N_i - N_j). With
the contact forces of the fit that is a linear regression for c. Without the orientation of the base
the plane through four or more feet takes the place of the vertical.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ndtr, stdtrit

from seaid._arrays import Array, BoolArray, safely
from seaid._files import toml_table
from seaid.checks import tolerances as tol
from seaid.checks.check import Observation
from seaid.checks.codes import CONTACT_FLAGS, CONTACT_FORCES, GEOMETRY, SOFT_FEET, TOTAL_MASS
from seaid.checks.contacts import foot_places
from seaid.errors import ExcitationError, Finding, listed
from seaid.estimation import Estimate, FittedRows, ordinary, with_further_columns
from seaid.log import BaseMotion, Motion, in_band, smoothed_where
from seaid.regressor import LoadModel, Regression, late_flag_rows, radius_rows, stacked
from seaid.robot import Robot


@dataclass(frozen=True, eq=False)
class LoadedFeet:
    """The forces of a fit on the feet that stand, at the instants of a motion.

    `forces` (T, k, 3) are those of the contacts at `links` in the frame of the base, NaN where they
    are not determined; `counts` (T, k) are the feet that stand.
    """

    motion: Motion
    links: tuple[str, ...]
    forces: Array
    counts: BoolArray


@dataclass(frozen=True, eq=False)
class LeggedFit:
    """A fit of a robot with a floating base, whose motions are in memory.

    Attributes
    ----------
    robot : Robot
        With the bodies that count as known.
    motions, fit, model, springs
        The motions, the rows of the fit, their columns, and the springs of its drives.
    theta, bodies : arrays (p,) and (10 N,)
        Parameters of the fit, and standard parameters that have them.
    sensor_errors : array (R, k)
        Columns of errors of sensors that were subtracted: they may come of a wrong radius, and are
        identified again.
    mass_kg : float
        That of the whole robot, NaN where it is not determined.
    loads : sequence of LoadedFeet
        Empty if feet have force sensors, or no flags.
    """

    robot: Robot
    motions: Sequence[Motion]
    fit: FittedRows
    model: LoadModel
    springs: Mapping[str, Array]
    theta: Array
    bodies: Array
    sensor_errors: Array
    mass_kg: float
    loads: Sequence[LoadedFeet] = ()

    @property
    def bases(self) -> list[BaseMotion]:
        """The motions of the base."""
        return [motion.base for motion in self.motions if motion.base is not None]

    @property
    def are_upright(self) -> bool:
        """Whether all bases have an orientation."""
        return all(base.up is not None for base in self.bases)

    def sure_columns(
        self,
        regress: Callable[[Motion], Regression],
        count: int,
        least: float,
        size: Callable[[Array], Array] = np.abs,
    ) -> list[tuple[int, float, float]]:
        """Return place, value and standard error of further columns that the rows do not refuse.

        The `size` of the value is beyond chance and at least the `least` one that matters.
        """
        columns = stacked([regress(motion) for motion in self.motions]).H
        larger = with_further_columns(
            self.fit,
            np.hstack([self.sensor_errors, columns]),
            lambda values: bool(np.any(size(values[-count:]) > least)),
        )
        if larger is None:
            return []
        values, errors = larger.values[-count:], larger.standard_errors[-count:]
        sure = np.flatnonzero(size(values) > np.maximum(_beyond_chance(larger) * errors, least))
        return list(zip(sure.tolist(), values[sure].tolist(), errors[sure].tolist(), strict=True))


def _beyond_chance(estimate: Estimate) -> float:
    """Return the standard errors of Student's t that are as rare as sure ones of a normal value."""
    freedom = estimate.degrees_of_freedom
    return tol.SURE if freedom is None else float(stdtrit(np.min(freedom), ndtr(tol.SURE)))


def _radius(fit: LeggedFit) -> Iterator[Finding]:
    """Yield a radius of the feet, one for all of them, that the rows of a fit contradict."""
    assert fit.robot.floating_base is not None
    radii = {x.link: x.radius_m for x in fit.robot.floating_base.contacts if not x.is_flat}
    flagged = all(radii.keys() <= base.contacts.keys() for base in fit.bases)
    if len({*radii.values()}) != 1 or not fit.are_upright or not flagged:
        return
    regress = partial(
        radius_rows,
        fit.robot,
        model=fit.model,
        springs=fit.springs,
        theta=fit.theta,
        bodies=fit.bodies,
    )
    for _, change_m, error_m in fit.sure_columns(regress, 1, tol.LENGTH_M):
        radius_m = max(radii.values())
        fitted_m = radius_m + change_m
        if fitted_m > 0:
            yield GEOMETRY.finding(
                f"the feet touch the ground as balls of {1e3 * fitted_m:.3g} mm, with a standard "
                f"error of {1e3 * error_m:.2g} mm, and have {1e3 * radius_m:.3g} mm: the moments "
                "of the contact forces would go into the bodies",
                evidence={"radius [m]": fitted_m, "standard error [m]": error_m},
                remedy=f"load the robot with contacts of radius_m = {fitted_m:.4g}, also if the "
                "foot is larger: a soft one touches nearer to its centre",
            )


def _pushing_feet(fit: LeggedFit) -> Iterator[Finding]:
    """Yield feet that push at the ground before or after their flag, by the rows of a fit."""
    lifts = any(not np.all(flag) for base in fit.bases for flag in base.contacts.values())
    if not lifts or not fit.are_upright or not np.isfinite(fit.mass_kg):
        return
    gravity = np.mean([np.linalg.norm(base.specific_force, axis=1).mean() for base in fit.bases])
    least_N = tol.FEW * fit.mass_kg * float(gravity)
    regress = partial(late_flag_rows, fit.robot, model=fit.model, reach_s=tol.FOOT_TOUCHES_S)
    times = ("before a landing", "after it leaves")
    pushes = fit.sure_columns(regress, len(times), least_N, np.asarray)
    if pushes:
        texts = [f"{value:.2g} +- {error:.1g} N {times[x]}" for x, value, error in pushes]
        yield CONTACT_FLAGS.finding(
            f"a foot pushes at the ground while it is flagged as in the air, with {listed(texts)}, "
            f"fading within {tol.FOOT_TOUCHES_S:g} s: these forces go into the bodies and the "
            "total mass",
            evidence={f"{times[x]} [N]": value for x, value, _ in pushes},
            remedy="flag a foot from the first touch on: lower the threshold of its force (above = "
            "... in the description of the log), or make each flag longer by "
            f"{tol.FOOT_TOUCHES_S:g} s at both ends",
        )


def _sinking_feet(fit: LeggedFit) -> Iterator[Finding]:
    """Yield the sinking of feet under their load, if the heights of standing feet show one."""
    parts = [part for part in (_heights(fit.robot, feet) for feet in fit.loads) if len(part[0])]
    if not parts:
        return
    heights, aside, times, forces = zip(*parts, strict=True)
    y, loads = np.concatenate(heights).T
    H = np.column_stack([loads, block_diag(*aside)])
    H = H[:, np.any(H != 0, axis=0)]
    rows = Regression(
        names=tuple(f"height {place}" for place in range(H.shape[1])),
        units=("",) * H.shape[1],
        H=H,
        y=y,
        joint=np.zeros(len(y)),
        time=np.concatenate(times),
        run=np.repeat(np.arange(len(parts), dtype=float), list(map(len, times))),
        excluded=0,
        propagated=np.empty((len(y), 0)),
    )
    try:
        estimate = ordinary(rows)
    except ExcitationError:  # the load is always the same
        return
    compliance, error = float(estimate.values[0]), float(estimate.standard_errors[0])
    load_N = float(np.concatenate(forces).mean())
    sinking_m = compliance * load_N
    if compliance < _beyond_chance(estimate) * error or sinking_m < tol.LENGTH_M:
        return
    yield SOFT_FEET.finding(
        f"the feet sink in by {1e3 * sinking_m:.2g} mm under their mean load of {load_N:.3g} N, by "
        f"{1e3 * compliance:.3g} +- {1e3 * error:.1g} mm/N: the contact forces act elsewhere than "
        "at rigid feet, which makes the mass some tenths of a per cent wrong, and no standard "
        "error contains that",
        evidence={
            "compliance [m/N]": compliance,
            "standard error [m/N]": error,
            "mean load [N]": load_N,
        },
        remedy="put the robot on hard ground, or harder feet on it; else load it with the radius "
        "of the feet under their mean load (radius_m), or check that the joints do not give way",
    )


def _heights(robot: Robot, feet: LoadedFeet) -> tuple[Array, Array, Array, Array]:
    """Return heights of standing feet about their mean and loads (R, 2), other columns (R, m).

    The last two results are the times (R,), and the loads (R,) themselves. Without an orientation
    the height of a foot over the plane of the others counts.
    """
    motion, base = feet.motion, feet.motion.base
    assert base is not None
    up, fewest = base.up, 2
    if up is None:
        mean, fewest = in_band(motion, base.specific_force), 4
        up = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    places = foot_places(robot, motion.joint_position, feet.links)
    places = smoothed_where(motion, places, feet.counts)
    height, *aside = (np.einsum("tki,ti->tk", places, axis) for axis in (up, *_level(up)))
    load = np.einsum("tki,ti->tk", feet.forces, up)
    counts, k = feet.counts & np.isfinite(height) & np.isfinite(load), len(feet.links)
    # feet have heights of their own, but for the first one
    offsets = np.broadcast_to(np.eye(k)[:, 1:], (*height.shape, k - 1))
    values = np.concatenate([np.stack([height, -load, *aside], axis=2), offsets], axis=2)
    hidden = np.stack([np.ones_like(height), *(aside if base.up is None else ())], axis=2)
    picked = [np.empty((0, values.shape[2] + 2))]
    for pattern in np.unique(counts[np.sum(counts, axis=1) >= fewest], axis=0):
        at = np.ix_(np.flatnonzero(np.all(counts == pattern, axis=1)), np.flatnonzero(pattern))
        inverse = safely(np.linalg.pinv, hidden[at], what="the places of standing feet")
        about_mean = values[at] - hidden[at] @ inverse @ values[at]
        times = np.broadcast_to(motion.time[at[0]], load[at].shape)
        rows = np.concatenate([about_mean, times[:, :, None], load[at][:, :, None]], axis=2)
        picked.append(rows.reshape(-1, rows.shape[2]))
    rows = np.concatenate(picked)
    return rows[:, :2], rows[:, 2:-2], rows[:, -2], rows[:, -1]


def _level(up: Array) -> tuple[Array, Array]:
    """Return two level directions (T, 3) in the frame of the base, as near to its x and y."""
    first = np.cross([0.0, 1.0, 0.0], up)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-9)
    return first, np.cross(up, first)


def mass_findings(
    robot: Robot, motions: Sequence[Motion], mass_kg: float, error_kg: float
) -> Iterator[Finding]:
    """Yield a total mass that no force of the ground can come from, or far from the nominal one.

    `robot` has that of its file. The mass is NaN where it is not determined.
    """
    nominal_kg = float(np.sum((robot.parameters + robot.payload_parameters)[::10]))
    sure_kg = tol.SURE * error_kg
    evidence = {
        "mass [kg]": mass_kg,
        "standard error [kg]": error_kg,
        "robot file [kg]": nominal_kg,
    }
    if mass_kg < -sure_kg:
        yield TOTAL_MASS.finding(
            f"the mass of the whole robot is negative, {mass_kg:.3g} kg",
            severity="wrong",
            evidence=evidence,
            remedy="force sensors have the force of the ground on the robot, and torques act on "
            f"the robot along its joint angles: turn their signs round{_turned_forces(motions)}",
            certainty="certain",
        )
    elif (
        min(mass_kg, nominal_kg) > 0
        and not 1 / tol.TWICE < mass_kg / nominal_kg < tol.TWICE
        and abs(mass_kg - nominal_kg) > sure_kg
    ):
        yield TOTAL_MASS.finding(
            f"the mass of the whole robot is {mass_kg:.3g} kg, {mass_kg / nominal_kg:.2g} of that "
            f"of the robot file, {nominal_kg:.3g} kg",
            evidence=evidence,
            remedy="weigh the robot; is a force sensor or a torque in another unit (1 kgf is 9.81 "
            "N), or does a force act that is not in the log?",
        )


def _turned_forces(motions: Sequence[Motion]) -> str:
    """Return the lines that change the signs of measured forces, "" without any."""
    bases = (motion.base for motion in motions if motion.base is not None)
    sensors = sorted({link for base in bases for link in base.wrenches})
    tables = [f"{toml_table('contacts', x)}\nforce = {{ ..., scale = -1 }}" for x in sensors]
    where = "; in the description of the log, and so for each moment:\n" if sensors else ""
    return where + "\n".join(tables)


FEET_CHECKS = (
    Observation(GEOMETRY, _radius),
    Observation(CONTACT_FLAGS, _pushing_feet),
    Observation(SOFT_FEET, _sinking_feet),
)
"""What the rows of a fit contradict in the feet."""


def force_findings(feet: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """Yield feet whose predicted force is not that measured, or pulls at the ground.

    `feet` {link: numbers} are those of `ContactForces.to_dict`, None where they are not known.
    """
    for link, foot in feet.items():
        error, scale = foot["relative_error"], foot["scale"]
        if error is not None and error > tol.RARE:
            yield CONTACT_FORCES.finding(
                f"the measured force at {link} is not that of torques and motion: they differ by "
                f"{error:.0%}, and least with the measured one times {scale:.2g}",
                link,
                evidence={"error": error, "scale": scale},
                remedy="check sign, unit and frame of the force sensor (the force of the ground on "
                "the link, in the frame of the link), and its zero in the air",
            )
        pulled = foot["pulled"]
        if pulled is not None and pulled > tol.FEW:
            least_N, error_N = foot["least_normal"], foot["standard_error"]
            yield CONTACT_FORCES.finding(
                f"{link} would have to pull at the ground: its predicted normal force is clearly "
                f"below zero in {pulled:.0%} of its stance, and is {least_N:.3g} N at least, with "
                f"a standard error of {error_N:.2g} N",
                link,
                evidence={
                    "least normal force [N]": least_N,
                    "standard error [N]": error_N,
                    "share of the stance": pulled,
                },
                remedy="check the flag of this foot, and that nothing else touches or carries the "
                "robot",
            )
