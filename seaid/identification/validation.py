"""Predicted against measured torques of logs, by the equations of both sides."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, BoolArray
from seaid._progress import Display, Result, sampled_text
from seaid.checks import Verdict, verdict_of
from seaid.errors import Finding, by_severity
from seaid.identification.drive_estimates import TORQUE_OFFSET
from seaid.identification.extension import extension_of
from seaid.identification.gear import for_sensors
from seaid.identification.motor_constants import CONSTANTS
from seaid.log import Motion, in_band
from seaid.regressor import (
    INPUTS,
    actuator_columns,
    known_friction,
    load_side,
    load_torques,
    sensed_torque,
    signals,
    under_load,
    unknown_friction,
    with_gear_torque,
)

if TYPE_CHECKING:
    from seaid.identification.result import Identification
    from seaid.simulation import ReplayComparison

NUMBERS = (
    "rms_error",
    "relative_error",
    "relative_error_with_standstill",
    "raw_relative_error",
    "r_squared",
    "counted_share",
)
"""Fields of a Fit that tables and files contain."""


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Display):
    """Measured and computed torque (T, n) below the cutoff, and error measures (n,).

    Both torques are NaN in the filter transients at the ends. The samples that count are those from
    which parameters are identified, too: not those at which a motor with dry friction stands, since
    the model has no torque there, only one anywhere within Coulomb friction. `counted_share` is
    their share.

    `rms_error` is in the unit of the torque; `relative_error` is the norm of the error over that of
    the signal; `relative_error_with_standstill` the same with the samples at standstill;
    `raw_relative_error` as `relative_error`, without the low pass; `r_squared` is one minus the
    variance of the error over that of the signal. NaN for a joint without such an equation, and,
    but for the one with standstill, for a motor that never moves.

    Attributes
    ----------
    measured, computed : array (T, n)
    counted : bool array (T, n)
    rms_error, relative_error, r_squared, raw_relative_error : array (n,)
    relative_error_with_standstill, counted_share : array (n,)
    """

    measured: Array
    computed: Array
    counted: BoolArray
    rms_error: Array
    relative_error: Array
    r_squared: Array
    raw_relative_error: Array
    relative_error_with_standstill: Array
    counted_share: Array

    def to_dict(self, names: Iterable[str]) -> dict[str, dict[str, float | None]]:
        """Return the `NUMBERS` of each column by its name, null where there is no equation."""
        return {
            column: {name: _number(getattr(self, name)[index]) for name in NUMBERS}
            for index, column in enumerate(names)
        }

    @property
    def whole_relative_error(self) -> float:
        """The norm of the errors of all joints over that of their torques."""
        size = float(np.linalg.norm(self.measured[self.counted]))
        error = float(np.linalg.norm((self.measured - self.computed)[self.counted]))
        return error / size if size > 0 else float("nan")


@dataclass(frozen=True, eq=False, repr=False)
class Validation(Result):
    """Predicted torques of a log, `actuator` (motor torque of elastic joints) and `load` side.

    Attributes
    ----------
    joints : tuple of n str
        The n joints.
    time : ndarray (T,)
        Time [s].
    cutoff_hz : float
        Cutoff of the comparison.
    actuator, load : Fit
        Torques and error measures of both sides.
    motions : tuple of Motion
        The motions of the log, several if it has gaps in time: for figures over the motion, and to
        predict the same torques with other values.
    warnings : tuple of Finding
        Joints whose torque the model does not predict here, though it explains the own logs better.
    """

    table_name = "validation_table"

    joints: tuple[str, ...]
    time: Array
    cutoff_hz: float
    actuator: Fit
    load: Fit
    motions: tuple[Motion, ...] = ()
    warnings: tuple[Finding, ...] = ()

    def _in_short(self) -> str:
        sides = {"motor": self.actuator.relative_error, "load": self.load.relative_error}
        known = {side: errors[np.isfinite(errors)] for side, errors in sides.items()}
        texts = [f"{100 * x.max():.2g} % ({side} torque)" for side, x in known.items() if len(x)]
        errors = ", ".join(texts)
        return f"{sampled_text(self.time, self.joints)}: relative error at most {errors}"

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `parameters.json`, null for a joint without such an equation."""
        sides = {"actuator": self.actuator, "load": self.load}
        return {side: fit.to_dict(self.joints) for side, fit in sides.items()}


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
    robot = identification.robot
    if under_load(identification.known, identification.model.torque_joints):
        theta = identification.load_side.values
        motions = [
            with_gear_torque(
                identification.known, motion, identification.model, identification.springs, theta
            )
            for motion in motions
        ]
    actuator = [_traces(motion, *_actuator(identification, motion)) for motion in motions]
    sides = [_load(identification, motion) for motion in motions]
    load = [
        _traces(
            part,
            *side[:2],
            np.column_stack([unknown_friction(robot, part, joint) for joint in robot.joint_names]),
        )
        for part, side in zip(motions, sides, strict=True)
    ]
    comparison = Validation(
        joints=robot.joint_names,
        time=np.concatenate([motion.time for motion in motions]),
        cutoff_hz=motions[0].cutoff_hz,
        actuator=fit_of(actuator),
        load=fit_of(load),
        motions=given,
    )
    return extension_of(identification.known).compared(comparison, [side[2] for side in sides])


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
    factor = {
        "current": values.get("torque_constant", np.nan),
        "voltage": values.get("voltage_constant", np.nan),
    }.get(drive.motor_input, values["gain_scale"] if drive.is_up_to_scale else 1.0)
    signal = signals(identification.known, motion, identification.robot.index(joint))[
        INPUTS[drive.motor_input]
    ]
    return np.asarray(factor * signal)


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
    torque, payload, parts = load_torques(
        identification.known,
        motion,
        model,
        identification.springs,
        np.column_stack([theta, constants]),
    )
    made, known = parts[:, :, 0], parts[:, :, 1]
    both = np.stack([torque, payload + made], axis=2)
    # What is compared is the torque of the joint alone.
    known += load_side(identification.known).contact_torques(motion, model)
    measured = np.full_like(motion.joint_position, np.nan)
    computed = measured.copy()
    used = [identification.robot.index(joint) for joint in model.torque_joints]
    rows = slice(torque.shape[1] - len(used), None)  # those of a floating base come before them
    measured[:, used] = (torque - known)[:, rows]
    computed[:, used] = (payload + made - known)[:, rows]
    return measured, computed, both


@dataclass(frozen=True, eq=False)
class Traces:
    """Measured and computed torques (T, n), raw and low-passed, and masks.

    `still` (T, n) masks samples with unknown friction; `inside` (T,) those without filter
    transients.
    """

    measured: Array
    computed: Array
    smooth_measured: Array
    smooth_computed: Array
    still: BoolArray
    inside: BoolArray


def _traces(motion: Motion, measured: Array, computed: Array, still: BoolArray) -> Traces:
    """Return the torques of a motion for the comparison, without filter transients."""
    samples = np.arange(len(measured))
    transient = round(motion.transient_s * motion.rate_hz)
    inside = (samples >= transient) & (samples < len(samples) - transient)
    smooth_measured, smooth_computed = _smooth(motion, measured), _smooth(motion, computed)
    smooth_measured[~inside] = smooth_computed[~inside] = np.nan
    return Traces(measured, computed, smooth_measured, smooth_computed, still, inside)


def fit_of(parts: Sequence[Traces]) -> Fit:
    """Return the fit of the torques of all parts together."""
    names = [field.name for field in fields(Traces)]
    whole = Traces(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
    measured, computed = whole.smooth_measured, whole.smooth_computed
    error, raw_error = measured - computed, whole.measured - whole.computed
    every = np.isfinite(error) & whole.inside[:, None]
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


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
