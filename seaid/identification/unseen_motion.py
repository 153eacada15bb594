"""A log that an identification has not seen: predicted torques, and what they contradict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

import numpy as np

from seaid._arrays import Array
from seaid.checks import MOST, force_findings, not_measured, unseen_motion
from seaid.errors import Finding, IdentificationError, checked
from seaid.identification.contact_forces import contact_forces
from seaid.identification.motor_side import without_joint_encoder
from seaid.identification.output_error import simulated_from_motors
from seaid.identification.result import Identification
from seaid.identification.validation import Fit, Validation, compared
from seaid.log import Log, reconstruct_motions
from seaid.regressor import row_scale


@checked(IdentificationError)
def validate(identification: Identification, log: Log) -> Validation:
    """Predict the torques of another log and compare them with the measured ones.

    Of a robot with a floating base the contact forces are predicted, too.

    Parameters
    ----------
    identification : Identification
        The identified model.
    log : Log
        A log that was not used in the identification. All its instants count but those of the
        filter transients at its ends and around gaps in time, and those at which a motor with dry
        friction stands.

    Returns
    -------
    Validation

    Raises
    ------
    LogError
        If the log does not fit the robot.

    Examples
    --------
    >>> seaid.validate(result, seaid.read_log("other.csv", robot)).load.relative_error
    """
    unseen = without_joint_encoder(identification.known, [log])
    log = simulated_from_motors(identification, log)
    motions = reconstruct_motions(identification.robot, log, identification.cutoff_hz)
    result = compared(identification, *motions)
    places = [identification.known.index(joint) for joint in unseen]
    result = replace(result, load=_without_joints(result.load, places))
    contacts = contact_forces(identification, *motions)
    findings = [*_contradictions(identification, result, places), *not_measured(unseen)]
    findings += list(_base_contradictions(identification, result))
    findings += [] if contacts is None else force_findings(contacts.to_dict()["feet"])
    return replace(result, warnings=tuple(findings), contacts=contacts)


def _without_joints(fit: Fit, joints: Sequence[int]) -> Fit:
    """Return a fit without the values of some joints."""
    values = {field.name: getattr(fit, field.name).copy() for field in fields(fit)}
    for value in values.values():
        value[..., joints] = False if value.dtype == bool else np.nan
    return Fit(**values)


def _contradictions(
    identification: Identification, result: Validation, unseen: Sequence[int]
) -> Iterator[Finding]:
    """Yield the joints whose torque on the load is not predicted, worse than in the own logs.

    It is the motor torque of joints whose load side was not measured.
    """
    is_unseen = np.isin(np.arange(len(result.joints)), unseen)

    def of(v: Validation, name: str) -> Array:
        return np.asarray(np.where(is_unseen, getattr(v.actuator, name), getattr(v.load, name)))

    errors = np.sqrt(np.maximum(1 - of(result, "r_squared"), 0))  # over that of a constant torque
    suspects = [place for place, error in enumerate(errors) if error > MOST]
    if not suspects or not identification.motions:
        return
    fits = [of(compared(identification, motion), "rms_error") for motion in identification.motions]
    where = {False: "on the load", True: "of the motor"}
    for place in suspects:
        joint, error = result.joints[place], errors[place]
        known = [float(each[place]) for each in fits if np.isfinite(each[place])]
        ratio = float(of(result, "rms_error")[place]) / max(known, default=np.inf)
        torque = f"the torque {where[is_unseen[place]]} of {joint}"
        yield from unseen_motion(torque, joint, float(error), ratio)


_LEAST_OF_WEIGHT = 0.05
"""Part of the weight, or of its moment at the lever of the contacts, that counts as the force on
the base where the ground acts less: in flight it does not act at all."""


def _base_contradictions(identification: Identification, result: Validation) -> Iterator[Finding]:
    """Yield that the force or moment on a floating base is not predicted, worse than in own logs.

    The error is that of the vector of the three forces, or moments, over its deviation from the
    mean.
    """
    if result.base is None:
        return
    robot = identification.robot
    weight = float(np.linalg.norm(robot.model.gravity.linear) * robot.parameters[::10].sum())
    lever = float(row_scale(robot, 6)[0, 0])
    fits = [compared(identification, motion).base for motion in identification.motions]
    for kind, rows, least in (("force", slice(3), weight), ("moment", slice(3, 6), weight * lever)):
        measured = result.base.measured[:, rows]
        # Without the mean, which is the weight: it would hide any error.
        size = float(np.linalg.norm(np.nanstd(measured, axis=0)))
        rms = float(np.linalg.norm(result.base.rms_error[rows]))
        error = rms / max(size, _LEAST_OF_WEIGHT * least)
        known = [float(np.linalg.norm(fit.rms_error[rows])) for fit in fits if fit is not None]
        ratio = rms / max(known) if known else np.inf
        yield from unseen_motion(f"the {kind} on the base", "", error, float(ratio))
