"""Predicted against measured torques of logs, by the equations of both sides."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seaid._arrays import Array, BoolArray, FrozenMapping
from seaid.checks import Verdict
from seaid.checks.verdict import verdict_of
from seaid.drives.terms import MOTOR_CONSTANTS, between_encoders
from seaid.errors import by_severity
from seaid.identification.drive_estimates import CONSTANTS
from seaid.identification.result import Fit, Identification, Validation, extension_of
from seaid.identification.stacked_fits import TORQUE_OFFSET
from seaid.log import Motion, in_band
from seaid.regressor.base import INPUTS
from seaid.regressor.load import load_side, unknown_frictions, with_gear_torque
from seaid.regressor.regression import (
    actuator_columns,
    has_deflection,
    known_friction,
    sensed_torque,
    signals,
    spring_regressor,
    under_load,
)

if TYPE_CHECKING:
    from seaid.simulation import ReplayComparison


def verdict_with(
    identification: Identification, results: Iterable[Validation | ReplayComparison]
) -> Verdict:
    """Return the verdict on an identification, its validations and replays together."""
    findings = [*identification.weighed_findings]
    findings += [finding for x in results for finding in x.warnings]
    return verdict_of(by_severity(findings), identification.joint_fits)


def compared(identification: Identification, *given: Motion) -> Validation:
    """Compare the torques of the motions of one log, several if it has gaps in time.

    With one of `identification.motions` it is the fit itself.
    """
    identification, _ = for_sensors(identification, given[0])
    motions = [for_sensors(identification, motion)[1] for motion in given]
    robot, known, model = identification.robot, identification.known, identification.model
    if under_load(known, model.torque_joints):
        springs, theta = identification.springs, identification.load_side.values
        motions = [with_gear_torque(known, x, model, springs, theta) for x in motions]
    actuator = [_traces(motion, *_actuator(identification, motion)) for motion in motions]
    sides = [_load(identification, motion) for motion in motions]
    still = [unknown_frictions(robot, motion, robot.joint_names) for motion in motions]
    load = [_traces(x, *y[:2], z) for x, y, z in zip(motions, sides, still, strict=True)]
    time, fits = np.concatenate([x.time for x in motions]), (fit_of(actuator), fit_of(load))
    comparison = Validation(robot.joint_names, time, motions[0].cutoff_hz, *fits, given)
    return extension_of(known).compared(comparison, [side[2] for side in sides])


def _actuator(identification: Identification, motion: Motion) -> tuple[Array, Array, BoolArray]:
    """Return measured and computed motor torque (T, n) by (7), NaN at stiff joints.

    If only the spring torque was measured, it is compared, transformed to the motor. The third
    array has the samples at which friction is unknown.
    """
    measured = np.full_like(motion.motor_torque, np.nan)
    computed, still = measured.copy(), np.zeros(measured.shape, dtype=bool)
    for joint in identification.known.elastic_joints:
        index, estimate = identification.robot.index(joint), identification.drive_side[joint]
        regressor, zeta, R = actuator_columns(identification.known, motion, joint)
        if not set(regressor.names) <= set(estimate.names):
            continue
        values = np.array([estimate.value(name) for name in regressor.names])
        # zeta is tau_M less the known terms of (7): tau_M + R theta - zeta is the computed torque.
        error = R @ values - zeta
        if TORQUE_OFFSET in estimate.names:
            error += estimate.value(TORQUE_OFFSET)
        measured[:, index] = _input_torque(identification, motion, joint)
        if np.any(np.isnan(measured[:, index])):
            drive = identification.known.drives[joint]
            # Then the equation is (4b), in forces of the spring; r_M/N is its lever at the motor.
            lever = drive.motor_radius / drive.ratio
            force = sensed_torque(identification.known, motion, index) / drive.load_radius
            measured[:, index], error = lever * force, lever * error
        computed[:, index] = measured[:, index] + error
        still[:, index] = known_friction(identification.known, motion, joint, regressor) == 0
    return measured, computed, still


def _input_torque(identification: Identification, motion: Motion, joint: str) -> Array:
    """Return the motor torque (T,) from the logged input and the identified motor constant."""
    drive, estimate = identification.known.drives[joint], identification.drive_side[joint]
    values = {**drive.values, **estimate.by_name}
    factor = values["gain_scale"] if drive.is_up_to_scale else 1.0
    if constant := MOTOR_CONSTANTS.get(drive.motor_input):
        factor = values.get(constant, np.nan)
    logged = signals(identification.known, motion, identification.robot.index(joint))
    return np.asarray(factor * logged[INPUTS[drive.motor_input]])


def _load(identification: Identification, motion: Motion) -> tuple[Array, Array, Array]:
    """Return measured and computed load torque (T, n) by (8), NaN where it was not used.

    The third array has both (T, r, 2) for all rows of the load side.

    For a logged current or voltage, and for gains that are known up to scale, the torque by the
    identified constant counts as measured.
    """
    model = identification.model
    theta, constants = identification.load_side.values, np.zeros(len(model.names))
    for place, (_, name, _) in enumerate(model.drives, len(model.expressions)):
        # H has minus N times the logged input in the column of an unknown constant K: torque - H K
        # is what counts as measured.
        constants[place] = theta[place] if name in CONSTANTS else 0.0
    thetas, side = np.column_stack([theta, constants]), load_side(identification.known)
    torque, payload, parts = side.torques(motion, model, identification.springs, thetas)
    made, known = parts[:, :, 0], parts[:, :, 1]
    both = np.stack([torque, payload + made], axis=2)
    # What is compared is the torque of the joint alone.
    known += side.contact_torques(motion, model)
    measured = np.full_like(motion.joint_position, np.nan)
    computed = measured.copy()
    used = [identification.robot.index(joint) for joint in model.torque_joints]
    rows = slice(torque.shape[1] - len(used), None)  # those of a floating base come before them
    measured[:, used] = (torque - known)[:, rows]
    computed[:, used] = (payload + made - known)[:, rows]
    return measured, computed, both


class Traces(NamedTuple):
    """Measured and computed torques (T, n), raw and low-passed, and masks.

    Filtered torques are NaN in transients; `still` (T, n) masks samples with unknown friction.
    """

    measured: Array
    computed: Array
    smooth_measured: Array
    smooth_computed: Array
    still: BoolArray


def _traces(motion: Motion, measured: Array, computed: Array, still: BoolArray) -> Traces:
    """Return the torques of a motion for the comparison, without filter transients."""
    transient = round(motion.transient_s * motion.rate_hz)
    smooth_measured, smooth_computed = _smooth(motion, measured), _smooth(motion, computed)
    for torque in (smooth_measured, smooth_computed):
        torque[:transient] = torque[max(len(torque) - transient, 0) :] = np.nan
    return Traces(measured, computed, smooth_measured, smooth_computed, still)


def fit_of(parts: Sequence[Traces]) -> Fit:
    """Return the fit of the torques of all parts together."""
    whole = Traces(*map(np.concatenate, zip(*parts, strict=True)))
    measured, computed = whole.smooth_measured, whole.smooth_computed
    error, raw_error = measured - computed, whole.measured - whole.computed
    every = np.isfinite(error)
    counted = every & ~whole.still
    count = np.sum(counted, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # `where=` and not NaN arithmetic: columns without samples that count become NaN by 0 / 0.
        mean = np.sum(measured, axis=0, where=counted) / count
        return Fit(
            measured=measured,
            computed=computed,
            counted=counted,
            rms_error=_norm(error, counted) / np.sqrt(count),
            relative_error=_norm(error, counted) / _norm(measured, counted),
            r_squared=1 - (_norm(error, counted) / _norm(measured - mean, counted)) ** 2,
            raw_relative_error=_norm(raw_error, counted) / _norm(whole.measured, counted),
            relative_error_with_standstill=_norm(error, every) / _norm(measured, every),
            counted_share=count / np.sum(every, axis=0),
        )


def _norm(values: Array, counted: BoolArray) -> Array:
    """Return the norm (n,) of values (T, n) at the samples that count."""
    return np.asarray(np.sqrt(np.sum(values**2, axis=0, where=counted)))


def _smooth(motion: Motion, torque: Array) -> Array:
    """Return torques (T, n) below the cutoff; NaN columns stay NaN."""
    smooth, measured = torque.copy(), np.flatnonzero(np.isfinite(torque[0]))
    smooth[:, measured] = in_band(motion, torque[:, measured])
    return smooth


def for_sensors(result: Identification, motion: Motion) -> tuple[Identification, Motion]:
    """Return identification and motion such that both have the deflection of a spring, or neither.

    Without it, drives and springs are those between the encoders.
    """
    known = result.known
    seen = {joint for joint in known.elastic_joints if has_deflection(motion, known.index(joint))}
    if seen - set(result.gears):
        assert motion.deflection is not None
        used = np.isin(known.joint_names, [*result.gears])
        motion = replace(motion, deflection=np.where(used, motion.deflection, np.nan))
    blind = [joint for joint in result.gears if joint not in seen]
    drives, springs = dict(result.drive_side), dict(result.springs)
    for joint in blind:
        drive = drives[joint]
        drives[joint] = replace(drive, values=_between(result, joint, drive.names, drive.values))
        if joint in springs:
            names = spring_regressor(known, joint).names
            springs[joint] = _between(result, joint, names, springs[joint])
    if blind:
        result = replace(result, drive_side=FrozenMapping(drives), springs=FrozenMapping(springs))
    return result, motion


def _between(result: Identification, joint: str, names: Sequence[str], values: Array) -> Array:
    """Return parameters of a drive between the encoders: F = k (d - c F - o) + f_0."""
    named, offset = dict(zip(names, values, strict=True)), result.gears[joint].value("gear_offset")
    softer = between_encoders(named, result.robot.drives[joint].gear_compliance)
    if "deflection_zero" in named:
        softer["deflection_zero"] += offset
    elif "spring_offset" in named:
        k = named.get("stiffness", result.known.drives[joint].values.get("stiffness", 0.0))
        # F = (k (d - o) + f_0) / (1 + c k).
        share = 1.0 / (1.0 + result.robot.drives[joint].gear_compliance * k)
        softer["spring_offset"] = share * (named["spring_offset"] - k * offset)
    return np.array([softer[name] for name in names])
