"""The gear between the encoders, in series with the spring.

Two encoders see the deflection of both. The spring alone follows from a known stiffness of the
gear, or from a sensor of its own deflection, which determines the gear too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, FrozenMapping
from seaid._progress import Display
from seaid.drives import ParameterName, SeriesElasticDrive, unit_of
from seaid.drives.terms import is_harmonic, of_spring, spring_slopes
from seaid.errors import IdentificationError, LogError, checked
from seaid.estimation import fit
from seaid.identification.datasets import Dataset, first_motion, rows_of_equations
from seaid.identification.stacked_fits import merged_estimates, spring_of
from seaid.regressor.regression import gear_regression, has_deflection

if TYPE_CHECKING:
    from seaid.drives import Drive
    from seaid.estimation import Estimate, Estimator
    from seaid.robot import Robot

_SIGNIFICANT = 4.0
"""A gear whose compliance is below so many standard errors counts as rigid: errors of the gear that
are periodic in its angles are not in the standard error. Not tuned on a log."""


def deflection_joints(robot: Robot, datasets: Sequence[Dataset]) -> tuple[str, ...]:
    """Return the elastic joints whose deflection was measured.

    Raises IdentificationError for one that only some logs have.
    """
    motions = [first_motion(dataset) for dataset in datasets]
    joints = []
    for joint in robot.elastic_joints:
        known = [has_deflection(motion, robot.index(joint)) for motion in motions]
        if any(known) and not all(known):
            raise IdentificationError(
                f"the deflection of {joint} is in {sum(known)} of {len(known)} logs: identify them "
                "apart, or exclude its column, because two encoders see the gear as well"
            )
        if all(known):
            joints.append(joint)
    return tuple(joints)


def with_rigid_gears(robot: Robot, joints: Sequence[str]) -> Robot:
    """Return the robot with rigid gears at some joints, whose deflection is that of the spring."""
    stiff = {joint: _with_gear(robot.drives[joint], None) for joint in joints}
    return robot.with_drives(stiff) if stiff else robot


def _with_gear(drive: Drive, stiffness: float | None) -> Drive:
    """Return a drive with another stiffness of its gear, and the same spring."""
    assert isinstance(drive, SeriesElasticDrive)
    return replace(drive, gear_stiffness_Nm_per_rad=stiffness)


def gear_estimates(
    robot: Robot, datasets: Sequence[Dataset], drives: Mapping[str, Estimate], estimator: Estimator
) -> dict[str, tuple[Estimate, float | None]]:
    """Return stiffness, hysteresis and offset {joint: estimate} of gears, see `gear_regression`.

    The stiffness is absent, and the least one follows, if the gear is rigid within the errors.
    """
    joints = deflection_joints(robot, datasets)
    springs = {joint: spring_of(robot, drives[joint], joint) for joint in joints}
    equations = {
        joint: partial(gear_regression, robot, joint=joint, spring=spring.values)
        for joint, spring in springs.items()
    }
    with rows_of_equations(datasets, equations, estimator.weigh is not None, None, False) as rows:
        return {
            joint: _gear(robot, joint, fit(rows[joint], estimator).estimate, springs[joint])
            for joint in joints
        }


def _gear(
    robot: Robot, joint: str, estimate: Estimate, spring: Estimate
) -> tuple[Estimate, float | None]:
    """Return k_G = r_M^2 / c with the relative error of c, and of a force by the stiffness k.

    The number is None, or the least stiffness of a gear that is rigid within the errors.
    """
    drive = robot.drives[joint]
    compliance, error = float(estimate.values[0]), float(estimate.standard_errors[0])
    others = estimate.of_names(estimate.names[1:])
    if compliance <= _SIGNIFICANT * error:
        least = drive.motor_radius**2 / max(compliance + _SIGNIFICANT * error, 1e-300)
        return others, least
    stiffness = drive.motor_radius**2 / compliance
    slopes = np.diag([-stiffness / compliance, 1.0, 1.0])  # d k_G / d c
    scaled = estimate.transformed(np.array([stiffness, *estimate.values[1:]]), slopes)
    covariance = scaled.covariance.copy()
    if "stiffness" in spring.names and spring.value("stiffness"):
        # c = wind-up over F with F = k d: a relative error of k is one of c, and so of k_G.
        share = spring.standard_error("stiffness") / spring.value("stiffness")
        covariance[0, 0] += (share * stiffness) ** 2
    names = ParameterName("gear_stiffness"), *estimate.names[1:]
    units = ("N m/rad", *estimate.units[1:])
    return replace(scaled, names=names, covariance=covariance, units=units), None


def with_gears(robot: Robot, declared: Robot, gears: Mapping[str, Estimate]) -> Robot:
    """Return the robot with gears as given, or else as identified, and the same springs.

    Springs that only `declared` has, whose drives stood still, are as given.
    """
    unused = (x for x in declared.elastic_joints if not robot.drives[x].is_elastic)
    drives: dict[str, Drive] = {joint: declared.drives[joint] for joint in unused}
    for joint, gear in gears.items():
        stiffness = getattr(declared.drives[joint], "gear_stiffness_Nm_per_rad", None)
        if stiffness is None and "gear_stiffness" in gear.names:
            stiffness = gear.value("gear_stiffness")
        drives[joint] = _with_gear(robot.drives[joint], stiffness)
    return robot.with_drives(drives) if drives else robot


def own_estimates(
    drives: Mapping[str, Drive], estimates: Mapping[str, Estimate], gears: Mapping[str, Estimate]
) -> FrozenMapping[Estimate]:
    """Return estimates {joint: Estimate} between the encoders as those of the springs alone."""
    alone = {joint: _own_estimate(drives[joint], estimate) for joint, estimate in estimates.items()}
    return FrozenMapping(alone | merged_estimates({j: alone[j] for j in gears}, gears), "joint")


def _own_estimate(drive: Drive, estimate: Estimate) -> Estimate:
    """Return the estimate of a drive in its own values, with the covariance propagated."""
    if not (drive.gear_compliance or drive.harmonics):
        return estimate
    names = estimate.names
    values = estimate.by_name
    if "stiffness" in drive.known:
        values.setdefault("stiffness", drive.values["stiffness"])
    spring_values = of_spring(values, drive.gear_compliance)
    slopes = spring_slopes(values, drive.gear_compliance)
    # Delta method, d (own values) / d (values between the encoders).
    J = np.array([[slopes[row].get(column, 0.0) for column in names] for row in names])
    transformed = estimate.transformed(np.array([spring_values[name] for name in names]), J)
    units = tuple(
        unit_of(drive, name) if is_harmonic(name) else unit
        for name, unit in zip(names, estimate.units, strict=True)
    )
    return replace(transformed, units=units)


_RESOLVED = 0.05
"""Relative standard error above which the motion is too small to determine a ratio."""


@dataclass(frozen=True, repr=False)
class GearRatio(Display):
    """A gear ratio, as `gear_ratio` determines it.

    Attributes
    ----------
    value, standard_error : float
        Motor turns per output turn, negative if the gear reverses; and its standard error.
    misfit_rad : float
        Root mean square of output angle minus motor angle over ratio [rad].
    """

    value: float
    standard_error: float
    misfit_rad: float


@checked(LogError)
def gear_ratio(
    motor_angle_rad: Array | Sequence[Array], output_angle_rad: Array | Sequence[Array]
) -> GearRatio:
    """Return the gear ratio from the angles of both sides of the gear.

    The estimate is the slope of the reduced major axis: both angles have errors, in proportion to
    their ranges. The residual is not noise but transmission error and encoder eccentricity, which
    are functions of the angle and do not average out. The standard error is therefore that of one
    sample: ratio times rms misfit over rms angle. A motion shorter than a period of such an error
    takes part of it for the ratio.

    Parameters
    ----------
    motor_angle_rad : array (T,) or list of arrays
        Motor angle [rad]; a list holds one array per log, each with its own encoder offset.
    output_angle_rad : array (T,) or list of arrays
        Angle behind the gear [rad], on the motor side of the spring: joint angle plus deflection,
        or the joint angle behind a rigid gear.

    Returns
    -------
    GearRatio
        The ratio with its standard error and the misfit.

    Raises
    ------
    LogError
        For angles of different shapes, angles that disagree, and too small a motion.

    Examples
    --------
    >>> seaid.identification.gear_ratio(log.motor_position[:, 0], log.joint_position[:, 0]).value
    """
    pairs = _pairs(motor_angle_rad, output_angle_rad)
    motor = np.concatenate([angle - angle.mean() for angle, _ in pairs])
    output = np.concatenate([angle - angle.mean() for _, angle in pairs])
    amplitude = float(np.sqrt(np.mean(output**2)))
    product = float(motor @ output)
    if amplitude == 0 or product == 0:
        raise LogError("gear_ratio: one of the angles is constant, so the ratio is undetermined")
    # reduced major axis: sign(x y) |x| / |y|
    value = float(np.sign(product) * np.linalg.norm(motor) / np.linalg.norm(output))
    misfit = float(np.sqrt(np.mean((output - motor / value) ** 2)))
    error = misfit / amplitude
    if error > _RESOLVED:
        raise LogError(
            f"gear_ratio: the angles disagree by {misfit:.2g} rad (rms) in a motion of "
            f"{amplitude:.2g} rad (rms) behind the gear; turn the joint farther, or check units "
            "and wraps"
        )
    return GearRatio(value, abs(value) * error, misfit)


def _pairs(
    motor: Array | Sequence[Array], output: Array | Sequence[Array]
) -> list[tuple[Array, Array]]:
    several = isinstance(motor, list | tuple) and np.ndim(motor[0]) > 0
    sides = [list(side) if several else [side] for side in (motor, output)]
    if len(sides[0]) != len(sides[1]):
        raise LogError(
            "gear_ratio needs the same number of logs for both angles, found "
            f"{len(sides[0])} and {len(sides[1])}"
        )
    pairs = []
    for angles in zip(*sides, strict=True):
        a, b = map(partial(np.asarray, dtype=float), angles)
        if a.ndim != 1 or a.shape != b.shape or len(a) < 2:
            raise LogError(
                f"gear_ratio needs two angles of shape (T,), found shapes {a.shape} and {b.shape}"
            )
        known = np.isfinite(a) & np.isfinite(b)
        if known.sum() < 2:
            raise LogError("gear_ratio: one of the angles is NaN at all samples")
        pairs.append((a[known], b[known]))
    return pairs
