"""The gear between the encoders, in series with the spring.

Two encoders see the deflection of both. The spring alone follows from a known stiffness of the
gear, or from a sensor of its own deflection, which determines the gear too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import FrozenMapping
from seaid.drives import ParameterName, SeriesElasticDrive, unit_of
from seaid.drives.terms import is_harmonic, spring_parameters, spring_slopes
from seaid.errors import IdentificationError
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
    with rows_of_equations(datasets, equations, estimator.weigh is not None) as rows:
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
    spring_values = spring_parameters(values, drive.gear_compliance)
    slopes = spring_slopes(values, drive.gear_compliance)
    # Delta method, d (own values) / d (values between the encoders).
    J = np.array([[slopes[row].get(column, 0.0) for column in names] for row in names])
    transformed = estimate.transformed(np.array([spring_values[name] for name in names]), J)
    units = tuple(
        unit_of(drive, name) if is_harmonic(name) else unit
        for name, unit in zip(names, estimate.units, strict=True)
    )
    return replace(transformed, units=units)
