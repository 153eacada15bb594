"""Parameters that bend a drive's equation: found by variable projection, before all others.

A Stribeck speed, the width of smooth friction, a dead zone: with them given the equations (7) and
(8) are linear. They are searched for first; `identify` then takes the equations near them, where
they have a column as any other parameter, and with it a standard error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from seaid.arrays import Array, IndexArray
from seaid.drivetrain.catalogue import COULOMB, PARAMETERS
from seaid.drivetrain.model import Drive, SeriesElasticDrive
from seaid.drivetrain.regressor import DriveRegressor
from seaid.errors import IdentificationError
from seaid.estimation.projection import projected
from seaid.estimation.solve import ordinary
from seaid.motion import Motion
from seaid.motion_rows import in_band_at
from seaid.regression import actuator_equation, actuator_regression, actuator_rows, stacked
from seaid.robot import Robot
from seaid.sides.found import with_values
from seaid.sides.untold import told

_SPEEDS = {
    "coulomb_width": (0.002, 0.01, 0.05),
    "coulomb_shift": (0.0,),
    "stribeck_speed": (0.03, 0.1, 0.3),
}
"""Where the search starts, in parts of the largest motor speed."""

_STRETCHES = {"dead_zone": (0.03, 0.15, 0.4), "deflection_zero": (0.0,)}
"""The same, in parts of half the range of the deflection."""

_LEAST, _MOST = 1e-4, 2.0
"""Bounds of what is positive, in the same parts."""


def straightened(robot: Robot, motions: Sequence[Motion]) -> Robot:
    """Return the robot with the values near which its elastic drives' equations are taken.

    Drives whose equations are linear stay as they are. Raises IdentificationError where a spring
    that is linear finds no stiffness to start from.
    """
    found = {
        joint: _straight_drive(robot, motions, joint)
        for joint in robot.elastic_joints
        if actuator_equation(robot, motions[0], joint)[0].non_linear
    }
    return robot.with_drivetrains(found) if found else robot


def _straight_drive(robot: Robot, motions: Sequence[Motion], joint: str) -> Drive:
    drive = robot.drivetrains[joint]
    assert isinstance(drive, SeriesElasticDrive)
    scale = _scale_of(robot, motions, joint)
    start = _linear_start(robot, motions, joint, drive)
    search = _motor_search(robot, motions, joint)
    names = search.regressor.non_linear
    grid = [starts_of(name, drive, start, scale) for name in names]
    lower, upper = (np.array([bounds_of(name, scale)[end] for name in names]) for end in (0, 1))
    found = projected(
        search.columns,
        search.slopes,
        [np.array(one) for one in product(*grid)],
        lower,
        upper,
    )
    values = dict(zip(names, found.bent.tolist(), strict=True))
    values |= dict(zip(search.regressor.linear, found.linear.tolist(), strict=True))
    drive = with_values(drive, values)
    return told(drive, search.regressor.names, search.all_columns(drive.values), names)


@dataclass(frozen=True)
class Scale:
    """Largest motor speed [rad/s], middle and half range of the deflection."""

    speed: float
    middle: float
    reach: float


@dataclass(frozen=True, eq=False)
class _MotorSearch:
    """The rows of one actuator side as functions of its bent parameters."""

    regressor: DriveRegressor
    motions: Sequence[Motion]
    signals: Sequence[Mapping[str, Array]]
    rows: Sequence[IndexArray]

    def columns(self, bent: Array) -> tuple[Array, Array]:
        """Return y and the linear columns of all motions in their band."""
        values = dict(zip(self.regressor.non_linear, bent.tolist(), strict=True))
        pairs = [self.regressor.given(one, values) for one in self.signals]
        return self._banded([y for y, _ in pairs]), self._banded([H for _, H in pairs])

    def slopes(self, bent: Array, linear: Array) -> Array:
        """Return the columns of the bent parameters."""
        values = dict(zip(self.regressor.non_linear, bent.tolist(), strict=True))
        values |= dict(zip(self.regressor.linear, linear.tolist(), strict=True))
        bent_places = [self.regressor.names.index(name) for name in self.regressor.non_linear]
        return self._banded(
            [self.regressor.evaluate(one, values)[1][:, bent_places] for one in self.signals]
        )

    def all_columns(self, values: Mapping[str, float]) -> Array:
        """Return the columns of all parameters near some values."""
        return self._banded([self.regressor.evaluate(one, values)[1] for one in self.signals])

    def _banded(self, parts: Sequence[Array]) -> Array:
        triples = zip(self.motions, parts, self.rows, strict=True)
        return np.concatenate([in_band_at(motion, part, rows) for motion, part, rows in triples])


def _motor_search(robot: Robot, motions: Sequence[Motion], joint: str) -> _MotorSearch:
    pairs = [actuator_equation(robot, motion, joint) for motion in motions]
    regressor = pairs[0][0]
    return _MotorSearch(
        regressor=regressor,
        motions=motions,
        signals=[by_name for _, by_name in pairs],
        rows=[actuator_rows(robot, motion, joint, regressor)[0] for motion in motions],
    )


def _scale_of(robot: Robot, motions: Sequence[Motion], joint: str) -> Scale:
    index, drive = robot.index(joint), robot.drivetrains[joint]
    assert isinstance(drive, SeriesElasticDrive)
    by_name = [actuator_equation(robot, motion, joint)[1] for motion in motions]
    stretch = np.concatenate(
        [
            drive.motor_radius / drive.ratio * one["theta_M"] - drive.load_radius * one["theta_L"]
            for one in by_name
        ]
    )
    speed = max(float(np.max(np.abs(one.motor_velocity[:, index]))) for one in motions)
    low, high = float(np.min(stretch)), float(np.max(stretch))
    return Scale(max(speed, 1e-9), 0.5 * (low + high), max(0.5 * (high - low), 1e-12))


def _linear_start(
    robot: Robot, motions: Sequence[Motion], joint: str, drive: SeriesElasticDrive
) -> dict[str, float]:
    """Return friction, stiffness and the zero of the deflection with linear terms only."""
    friction = tuple("coulomb" if term in COULOMB else term for term in drive.friction)
    known = tuple(name for name in drive.known if name in ("stiffness", "viscous_friction"))
    plain = replace(
        drive,
        friction=tuple(term for term in friction if term not in ("load", "stribeck")),
        spring=("linear",),
        known=known,
        nominal={},
    )
    simple = robot.with_drivetrains({joint: plain})
    rows = stacked([actuator_regression(simple, motion, joint) for motion in motions])
    found = ordinary(rows)
    values = {**plain.values, **dict(zip(found.names, found.values.tolist(), strict=True))}
    stiffness = values.get("stiffness", 0.0)
    if stiffness == 0:
        raise IdentificationError(f"joint '{joint}': no stiffness to start a search from")
    values["deflection_zero"] = -values.get("deflection_offset", 0.0) / stiffness
    return values


def starts_of(
    name: str, drive: Drive, start: Mapping[str, float], scale: Scale
) -> tuple[float, ...]:
    """Return where the search for a parameter begins: its nominal value, or by the data."""
    if name in drive.values:
        return (drive.values[name],)
    if name in _SPEEDS:
        return tuple(part * scale.speed for part in _SPEEDS[name])
    if name == "deflection_zero":
        return (start[name], scale.middle)
    if name in _STRETCHES:
        return tuple(part * scale.reach for part in _STRETCHES[name])
    return (start.get(name, 0.0),)


def bounds_of(name: str, scale: Scale) -> tuple[float, float]:
    """Return between what a bent parameter is searched."""
    if name in _SPEEDS:
        size, middle = scale.speed, 0.0
    elif name in _STRETCHES:
        size, middle = scale.reach, scale.middle if name == "deflection_zero" else 0.0
    else:
        return (0.0 if PARAMETERS[name].is_positive else -np.inf), np.inf
    if PARAMETERS[name].is_positive:
        return _LEAST * size, _MOST * size
    return middle - _MOST * size, middle + _MOST * size
