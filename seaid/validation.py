"""validate: predicted against measured torque, on a motion the identification has not seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid.arrays import Array
from seaid.identification import Identification
from seaid.log import Log
from seaid.motion import Motion, reconstruct_motion
from seaid.regression import actuator_columns, in_band, load_columns


@dataclass(frozen=True, eq=False)
class Fit:
    """Measured and computed torque (T, n) in the pass band, and how far apart, each (n,).

    The traces are NaN at both ends, where filters swing in.
    `relative_error` is the norm of the error over the norm of the signal; `raw_relative_error` the
    same without the low pass; `r_squared` one minus the error's over the signal's variance. NaN
    where a joint has no such equation.
    """

    measured: Array
    computed: Array
    rms_error: Array
    relative_error: Array
    r_squared: Array
    raw_relative_error: Array


@dataclass(frozen=True, eq=False)
class Validation:
    """Actuator side (motor torque, elastic joints) and load side (torque at the joint)."""

    joints: tuple[str, ...]
    time: Array
    cutoff_hz: float
    actuator: Fit
    load: Fit

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `parameters.json`, null where there is no equation."""
        return {
            side: {
                joint: {
                    name: _number(getattr(fit, name)[index])
                    for name in ("rms_error", "relative_error", "r_squared", "raw_relative_error")
                }
                for index, joint in enumerate(self.joints)
            }
            for side, fit in (("actuator", self.actuator), ("load", self.load))
        }


def validate(found: Identification, log: Log) -> Validation:
    """Predict the torques of another log and compare, in the pass band of the identification.

    All instants count, those near standstill too. Raises LogError where the log does not fit.
    """
    robot = found.robot
    motion = reconstruct_motion(robot, log, found.cutoff_hz)
    return Validation(
        joints=robot.joint_names,
        time=motion.time,
        cutoff_hz=motion.cutoff_hz,
        actuator=_fit(motion, *_actuator(found, motion)),
        load=_fit(motion, *_load(found, motion)),
    )


def _actuator(found: Identification, motion: Motion) -> tuple[Array, Array]:
    """Return measured and computed motor torque (T, n) by (7), NaN at stiff joints."""
    measured = np.full_like(motion.motor_torque, np.nan)
    computed = measured.copy()
    for joint in found.robot.elastic_joints:
        index = found.robot.index(joint)
        regressor, zeta, R = actuator_columns(found.known, motion, joint)
        torque = motion.motor_torque[:, index]
        if regressor.names != found.drivetrains[joint].names:
            continue
        measured[:, index] = torque if np.all(np.isfinite(torque)) else zeta
        computed[:, index] = measured[:, index] - zeta + R @ found.drivetrains[joint].values
    return measured, computed


def _load(found: Identification, motion: Motion) -> tuple[Array, Array]:
    """Return measured and computed load torque (T, n) by (8), NaN where it was not used."""
    torque, payload, H, _ = load_columns(found.known, motion, found.model, found.springs)
    measured = np.full_like(motion.joint_position, np.nan)
    computed = measured.copy()
    used = [found.robot.index(joint) for joint in found.model.rows]
    measured[:, used] = torque
    computed[:, used] = payload + H @ found.load_side.values
    return measured, computed


def _fit(motion: Motion, measured: Array, computed: Array) -> Fit:
    ends = np.arange(len(measured))
    trim = round(motion.trim_s * motion.rate_hz)
    outside = (ends < trim) | (ends >= len(ends) - trim)
    smooth_measured, smooth_computed = _smooth(motion, measured), _smooth(motion, computed)
    smooth_measured[outside] = smooth_computed[outside] = np.nan
    error, signal = smooth_measured - smooth_computed, smooth_measured[~outside]
    error, raw_error = error[~outside], (measured - computed)[~outside]
    variance = np.sum((signal - signal.mean(axis=0)) ** 2, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return Fit(
            measured=smooth_measured,
            computed=smooth_computed,
            rms_error=np.sqrt(np.mean(error**2, axis=0)),
            relative_error=np.linalg.norm(error, axis=0) / np.linalg.norm(signal, axis=0),
            r_squared=1 - np.sum(error**2, axis=0) / variance,
            raw_relative_error=np.linalg.norm(raw_error, axis=0)
            / np.linalg.norm(measured[~outside], axis=0),
        )


def _smooth(motion: Motion, torque: Array) -> Array:
    """Return torques (T, n) in the pass band; NaN columns stay NaN."""
    smooth, there = torque.copy(), np.flatnonzero(np.isfinite(torque[0]))
    smooth[:, there] = in_band(motion, torque[:, there])
    return smooth


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
