"""Mass and centre of mass of a whole robot with a floating base, and of its base alone.

They are linear in the inertial parameters, or ratios of such: c^T theta is determined if c is a
combination of the rows of the grouping matrix of the base parameters, and only then has a value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from seaid._arrays import Array

if TYPE_CHECKING:
    from seaid.identification.identification import Identification

_DETERMINED = 1e-6
"""Largest part of a functional outside of the base parameters, over its norm, that is rounding."""


@dataclass(frozen=True)
class BodyValue:
    """A mass [kg] or a coordinate of a centre of mass [m], NaN if the logs do not determine it."""

    name: str
    value: float
    standard_error: float
    unit: str

    @property
    def is_determined(self) -> bool:
        """Whether the logs determine it."""
        return bool(np.isfinite(self.value))


def whole_body(found: Identification) -> tuple[BodyValue, ...]:
    """Return mass and centre of mass of the robot in the middle of its motion, and of its base.

    Centres are in the frame of the base, payloads included. Empty for a fixed base.
    """
    if found.robot.floating_base is None:
        return ()
    moments = _first_moments(found)
    base = found.robot.body_names[-1]
    alone = np.zeros_like(moments)
    alone[:, -10:-6] = np.eye(4)
    return tuple(
        one
        for name, rows in (("whole robot", moments), (base, alone))
        for one in _mass_and_center(found, name, rows)
    )


def mean_posture(found: Identification) -> Array:
    """Return the mean joint positions (n,) of the logs, zero if none was in memory."""
    if not found.motions:
        return np.zeros(found.robot.n)
    return np.asarray(np.concatenate([one.joint_position for one in found.motions]).mean(axis=0))


def _first_moments(found: Identification) -> Array:
    """Return the functionals (4, 10N) of mass and first moments of the robot about its base."""
    robot = found.robot
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.to_model(mean_posture(found)))
    rows = np.zeros((4, robot.parameters.size))
    frames = [pin.SE3.Identity()] * len(robot.body_names)
    for place, index in enumerate(robot.model_order, 1):
        frames[index] = data.oMi[place]
    for body, frame in enumerate(frames):
        rows[0, 10 * body] = 1.0
        rows[1:, 10 * body] = frame.translation
        rows[1:, 10 * body + 1 : 10 * body + 4] = frame.rotation
    return rows


def _mass_and_center(found: Identification, name: str, rows: Array) -> list[BodyValue]:
    """Return the values of the functionals (4, 10N) of a mass and its first moments."""
    robot, base = found.robot, found.base
    combined = rows[:, list(base.columns)]
    left = (rows - combined @ base.grouping) * ~robot.is_known
    is_known = np.linalg.norm(left, axis=1) <= _DETERMINED * np.linalg.norm(rows, axis=1)
    given = rows @ (robot.payload_parameters + np.where(robot.is_known, robot.parameters, 0.0))
    mass, *moment = (combined @ found.load.values + given).tolist()
    slopes = np.vstack([combined[:1], (combined[1:] - np.outer(moment, combined[0]) / mass) / mass])
    # h / m has the slopes (c_h - h / m c_m) / m
    errors = np.sqrt(np.einsum("ij,jk,ik->i", slopes, found.load.covariance, slopes))
    values = np.array([mass, *(one / mass for one in moment)])
    is_known[1:] &= is_known[0]
    values[~is_known] = errors[~is_known] = np.nan
    names = [f"mass of {name}", *(f"centre of mass of {name}, {x}" for x in "xyz")]
    units = ["kg", *["m"] * 3]
    facts = zip(names, values.tolist(), errors.tolist(), units, strict=True)
    return [BodyValue(*one) for one in facts]
