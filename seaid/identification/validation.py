"""validate: predicted against measured torque, on a motion the identification has not seen.

Cross-validation over motions: what is identified from some, validated on the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np

from seaid._arrays import Array, BoolArray
from seaid._progress import track
from seaid.errors import IdentificationError
from seaid.identification.identification import Identification, identify
from seaid.identification.linearisation import under_load, with_gear_torque
from seaid.log import Log, Motion, in_band, reconstruct_motions, standstill
from seaid.regressor import INPUTS, actuator_columns, load_columns, signals, unknown_friction
from seaid.robot import Robot

NUMBERS = (
    "rms_error",
    "relative_error",
    "moving_relative_error",
    "raw_relative_error",
    "r_squared",
)
"""Fields of a Fit that go to tables and files."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Measured and computed torque (T, n) in the pass band, and how far apart, each (n,).

    The traces are NaN at both ends, where filters swing in.
    `relative_error` is the norm of the error over the norm of the signal; `moving_relative_error`
    the same away from standstill, where no model predicts what dry friction does;
    `raw_relative_error` the same without the low pass; `r_squared` one minus the error's over the
    signal's variance. NaN where a joint has no such equation.
    """

    measured: Array
    computed: Array
    rms_error: Array
    relative_error: Array
    r_squared: Array
    raw_relative_error: Array
    moving_relative_error: Array


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
                joint: {name: _number(getattr(fit, name)[index]) for name in NUMBERS}
                for index, joint in enumerate(self.joints)
            }
            for side, fit in (("actuator", self.actuator), ("load", self.load))
        }


def validate(found: Identification, log: Log) -> Validation:
    """Predict the torques of another log and compare, in the pass band of the identification.

    All instants count, those near standstill too; what is left out around holes in time does not.
    Raises LogError where the log does not fit.
    """
    return _compared(found, reconstruct_motions(found.robot, log, found.cutoff_hz))


def compared(found: Identification, motion: Motion) -> Validation:
    """Compare torques of a motion; with one of `found.motions`, how well the model fits its own."""
    return _compared(found, [motion])


def _compared(found: Identification, motions: Sequence[Motion]) -> Validation:
    """Compare torques of the motions of a log, of which there are several where it has holes."""
    robot = found.robot
    if under_load(found.known, found.model.rows):
        theta = found.load_side.values
        motions = [
            with_gear_torque(found.known, one, found.model, found.springs, theta) for one in motions
        ]
    actuator = [
        _traces(one, *_actuator(found, one), _still(robot, one, _motor_stands)) for one in motions
    ]
    load = [
        _traces(one, *_load(found, one), _still(robot, one, unknown_friction)) for one in motions
    ]
    return Validation(
        joints=robot.joint_names,
        time=np.concatenate([one.time for one in motions]),
        cutoff_hz=motions[0].cutoff_hz,
        actuator=_fit(actuator),
        load=_fit(load),
    )


def _actuator(found: Identification, motion: Motion) -> tuple[Array, Array]:
    """Return measured and computed motor torque (T, n) by (7), NaN at stiff joints.

    Where only the spring's torque was measured, that is compared, seen at the motor.
    """
    measured = np.full_like(motion.motor_torque, np.nan)
    computed = measured.copy()
    for joint in found.robot.elastic_joints:
        index, estimate = found.robot.index(joint), found.drives[joint]
        regressor, zeta, R = actuator_columns(found.known, motion, joint)
        if not set(regressor.names) <= set(estimate.names):
            continue
        values = np.array([estimate.value(name) for name in regressor.names])
        error = R @ values - zeta
        measured[:, index] = _input_torque(found, motion, joint)
        if np.any(np.isnan(measured[:, index])):
            drive = found.known.drives[joint]
            lever = getattr(drive, "motor_radius", 1.0) / drive.ratio
            force = motion.joint_torque[:, index] / getattr(drive, "load_radius", 1.0)
            measured[:, index], error = lever * force, lever * error
        computed[:, index] = measured[:, index] + error
    return measured, computed


def _input_torque(found: Identification, motion: Motion, joint: str) -> Array:
    """Return the motor's torque (T,) by what is logged of it, with the constant that was found."""
    drive, estimate = found.known.drives[joint], found.drives[joint]
    values = {**drive.values, **dict(zip(estimate.names, estimate.values, strict=True))}
    factor = {
        "torque": 1.0,
        "current": values.get("torque_constant", np.nan),
        "voltage": values.get("voltage_constant", np.nan),
    }[drive.motor_input]
    signal = signals(found.known, motion, found.robot.index(joint))[INPUTS[drive.motor_input]]
    return np.asarray(factor * signal)


def _load(found: Identification, motion: Motion) -> tuple[Array, Array]:
    """Return measured and computed load torque (T, n) by (8), NaN where it was not used.

    Where a motor's current or voltage was logged, what it gives by the found constant is measured.
    """
    torque, payload, H, _ = load_columns(found.known, motion, found.model, found.springs)
    theta, bodies = found.load_side.values, len(found.model.expressions)
    constants = [
        bodies + place
        for place, (_, name, _) in enumerate(found.model.drives)
        if name in ("torque_constant", "voltage_constant")
    ]
    given = H[:, :, constants] @ theta[constants]
    measured = np.full_like(motion.joint_position, np.nan)
    computed = measured.copy()
    used = [found.robot.index(joint) for joint in found.model.rows]
    measured[:, used] = torque - given
    computed[:, used] = payload + H @ theta - given
    return measured, computed


@dataclass(frozen=True, eq=False)
class _Traces:
    """Torques (T, n) as measured and computed, and in the pass band; which samples (T,) count.

    `still` (T, n) tells where friction is unknown.
    """

    measured: Array
    computed: Array
    smooth_measured: Array
    smooth_computed: Array
    still: BoolArray
    inside: BoolArray


def _traces(motion: Motion, measured: Array, computed: Array, still: BoolArray) -> _Traces:
    """Return the torques of a motion as they are compared; filters swing in at both ends."""
    samples = np.arange(len(measured))
    trim = round(motion.trim_s * motion.rate_hz)
    inside = (samples >= trim) & (samples < len(samples) - trim)
    smooth_measured, smooth_computed = _smooth(motion, measured), _smooth(motion, computed)
    smooth_measured[~inside] = smooth_computed[~inside] = np.nan
    return _Traces(measured, computed, smooth_measured, smooth_computed, still, inside)


def _fit(parts: Sequence[_Traces]) -> Fit:
    """Compare torques, those of all parts as one."""
    names = [field.name for field in fields(_Traces)]
    whole = _Traces(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))
    measured, computed, inside = whole.smooth_measured, whole.smooth_computed, whole.inside
    raw, signal = whole.measured[inside], measured[inside]
    error, moving = (measured - computed)[inside], ~whole.still[inside]
    with np.errstate(divide="ignore", invalid="ignore"):
        return Fit(
            measured=measured,
            computed=computed,
            rms_error=np.sqrt(np.mean(error**2, axis=0)),
            relative_error=_ratio(error, signal),
            r_squared=1 - _ratio(error, signal - signal.mean(axis=0)) ** 2,
            raw_relative_error=_ratio(raw - whole.computed[inside], raw),
            moving_relative_error=_ratio(error * moving, signal * moving),
        )


def _ratio(error: Array, signal: Array) -> Array:
    return np.asarray(np.linalg.norm(error, axis=0) / np.linalg.norm(signal, axis=0))


def _still(
    robot: Robot, motion: Motion, unknown: Callable[[Robot, Motion, str], BoolArray]
) -> BoolArray:
    return np.column_stack([unknown(robot, motion, joint) for joint in robot.joint_names])


def _motor_stands(robot: Robot, motion: Motion, joint: str) -> BoolArray:
    return standstill(motion, robot.index(joint))


def _smooth(motion: Motion, torque: Array) -> Array:
    """Return torques (T, n) in the pass band; NaN columns stay NaN."""
    smooth, there = torque.copy(), np.flatnonzero(np.isfinite(torque[0]))
    smooth[:, there] = in_band(motion, torque[:, there])
    return smooth


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def cross_validate(
    robot: Robot,
    logs: Log | Sequence[Log],
    *,
    parts: int = 4,
    progress: bool = False,
    **options: Any,
) -> tuple[Validation, ...]:
    """Return one validation a log, of what the other logs tell; one log is cut into `parts`.

    `options` are those of `identify`. All use one pass band, that of all logs together unless
    `cutoff_hz` is given. Raises IdentificationError for less than two parts, and as `identify` and
    `validate` do.
    """
    pieces = _cut(logs, parts) if isinstance(logs, Log) else list(logs)
    if len(pieces) == 1:
        pieces = _cut(pieces[0], parts)
    if len(pieces) < 2:
        raise IdentificationError(
            f"cross-validation needs two logs or parts at least, found {len(pieces)}"
        )
    if options.get("cutoff_hz") is None:
        options["cutoff_hz"] = identify(robot, logs, **options).cutoff_hz
    return tuple(
        validate(identify(robot, [*pieces[:place], *pieces[place + 1 :]], **options), pieces[place])
        for place in track(range(len(pieces)), "cross-validation", progress)
    )


def _cut(log: Log, parts: int) -> list[Log]:
    """Return a log in parts of equal length, one after the other."""
    if not (parts >= 2 and parts == int(parts)):
        raise IdentificationError(f"parts must be a whole number of at least 2, found {parts}")
    edges = np.linspace(log.time[0], log.time[-1], int(parts) + 1)
    edges[-1] = np.inf
    return [log.between(start, end) for start, end in pairwise(edges)]
