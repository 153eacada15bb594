"""Identifications and other data: validation, cross-validation, the sensitivity to the cutoff.

`validate` predicts the torques of another log; `cross_validate` validates each log on the
model identified from all the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array, frozen
from seaid._progress import Result, counted, track
from seaid.checks import MOST, force_findings, not_measured, unseen_motion
from seaid.errors import Finding, IdentificationError, SeaidError, checked
from seaid.identification.contact_forces import contact_forces
from seaid.identification.datasets import Source
from seaid.identification.identification import identify
from seaid.identification.model_selection import with_closed_terms
from seaid.identification.motor_side import without_joint_encoder
from seaid.identification.output_error import simulated_from_motors
from seaid.identification.result import Identification
from seaid.identification.validation import Fit, Validation, compared
from seaid.log import Log, reconstruct_motions
from seaid.regressor import row_scale
from seaid.robot import Robot


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


@checked(IdentificationError)
def cross_validate(
    robot: Robot,
    logs: Log | Sequence[Log],
    *,
    parts: int = 4,
    progress: bool = False,
    **options: Any,
) -> tuple[Validation, ...]:
    """Validate each log on the model identified from all the others.

    Parameters
    ----------
    robot : Robot
        The robot model.
    logs : Log or sequence of Log
        Logs of several motions; a single log is cut into `parts`.
    parts : int
        Number of parts of a single log, at least 2.
    progress : bool
        Show a progress bar.
    **options
        Options of `identify`. All identifications use one cutoff, `cutoff_hz` or that of all logs.

    Returns
    -------
    tuple of Validation
        One per log or part.

    Raises
    ------
    IdentificationError
        For less than two parts; further errors as in `identify` and `validate`.

    Examples
    --------
    >>> [one.load.r_squared for one in seaid.cross_validate(robot, log, parts=4)]
    """
    pieces = _cut(logs, parts) if isinstance(logs, Log) else list(logs)
    if len(pieces) == 1:
        pieces = _cut(pieces[0], parts)
    if len(pieces) < 2:
        raise IdentificationError(
            f"cross-validation needs two logs or parts at least, found {len(pieces)}"
        )
    if options.get("cutoff_hz") is None:
        # With cutoffs of their own, the errors of the parts would not be comparable.
        options["cutoff_hz"] = identify(robot, logs, **options).cutoff_hz
    return tuple(
        validate(identify(robot, [*pieces[:place], *pieces[place + 1 :]], **options), pieces[place])
        for place in track(range(len(pieces)), "cross-validation", progress)
    )


def _cut(log: Log, parts: int) -> list[Log]:
    """Return a log in consecutive parts of equal length."""
    if not (parts >= 2 and parts == int(parts)):
        raise IdentificationError(
            f"parts must be a whole number of at least 2, found {parts}", "parts"
        )
    edges = np.linspace(log.time[0], log.time[-1], int(parts) + 1)
    # `between` excludes its end: the last sample belongs to the last part.
    edges[-1] = np.inf
    return [log.between(start, end) for start, end in pairwise(edges)]


_FACTORS = (1 / 3, 1 / 2, 1 / np.sqrt(2), np.sqrt(2), 2.0, 3.0)

NEAR = 2.0
"""Cutoffs within this factor of the proposed one could have been proposed as well."""


@dataclass(frozen=True, eq=False, repr=False)
class CutoffSensitivity(Result):
    """Estimates over the cutoff; str() is a table.

    Attributes
    ----------
    cutoffs_hz : ndarray (C,)
        Cutoffs in increasing order.
    names, units : tuple of str (p,)
        Parameters of drives and base parameters.
    values, standard_errors : ndarray (C, p)
        Estimates per cutoff, NaN where the identification failed.
    proposed : int
        Index of the cutoff proposed from the data.
    refused : mapping {cutoff: reason}
        Cutoffs at which the identification failed.
    """

    table_name = "sensitivity_table"

    cutoffs_hz: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    standard_errors: Array
    proposed: int
    refused: Mapping[float, str]

    def _in_short(self) -> str:
        band = f"{self.cutoffs_hz[0]:.3g} to {self.cutoffs_hz[-1]:.3g} Hz"
        cutoffs = counted(len(self.cutoffs_hz), "cutoff")
        return f"{counted(len(self.names), 'parameter')} at {cutoffs} from {band}"

    def __post_init__(self) -> None:
        shape = (len(self.cutoffs_hz), len(self.names))
        object.__setattr__(self, "cutoffs_hz", frozen("cutoffs_hz", self.cutoffs_hz, (None,)))
        for name in ("values", "standard_errors"):
            object.__setattr__(self, name, frozen(name, getattr(self, name), shape))

    @property
    def moves(self) -> Array:
        """Largest change (p,) from the estimate at the proposed cutoff, in standard errors.

        Over cutoffs within a factor of two of the proposed one.
        """
        ratio = self.cutoffs_hz / self.cutoffs_hz[self.proposed]
        # Cutoffs that failed are NaN.
        near = (ratio <= NEAR * 1.001) & (ratio >= 0.999 / NEAR) & ~np.isnan(self.values[:, 0])
        off = np.abs(self.values[near] - self.values[self.proposed])
        return np.asarray(np.max(off, axis=0) / self.standard_errors[self.proposed])

    def save_figure(self, path: str | Path) -> None:
        """Draw estimates and 95 % intervals over the cutoff as PNG, the proposed cutoff marked."""
        from seaid.report import save_sensitivity_figure

        save_sensitivity_figure(self, path)


@checked(IdentificationError)
def cutoff_sensitivity(
    robot: Robot,
    logs: Source | Sequence[Source],
    cutoffs_hz: Sequence[float] | None = None,
    *,
    progress: bool = False,
    **options: Any,
) -> CutoffSensitivity:
    """Repeat an identification over several cutoffs.

    An estimate that changes by more than its standard error is biased: by noise (high cutoffs), or
    by model errors that grow with frequency.

    Parameters
    ----------
    robot, logs
        As in `identify`.
    cutoffs_hz : sequence of float, optional
        Cutoffs [Hz]. Default: a third to three times the proposed one.
    progress : bool
        Show a progress bar.
    **options
        Further options of `identify`, without `cutoff_hz`.

    Returns
    -------
    CutoffSensitivity

    Raises
    ------
    IdentificationError
        For `cutoff_hz` among the options, and for a cutoff that is not positive. Errors of
        `identify` at the proposed cutoff are raised, those at other cutoffs are in `refused`.

    Examples
    --------
    >>> print(seaid.cutoff_sensitivity(robot, log, [4.0, 8.0, 16.0]))
    """
    if "cutoff_hz" in options:
        raise IdentificationError("cutoff_sensitivity varies cutoff_hz: give cutoffs_hz instead")
    asked = [] if cutoffs_hz is None else list(map(float, cutoffs_hz))
    if not all(0 < cutoff < np.inf for cutoff in asked):
        raise IdentificationError(f"cutoffs_hz must be more than 0 and finite, found {asked}")
    base = identify(robot, logs, **options)
    if cutoffs_hz is None:
        asked = np.multiply(_FACTORS, base.cutoff_hz).tolist()
    cutoffs = sorted({*asked, base.cutoff_hz})
    # Terms that drives got by themselves and the method stay, so that estimates are comparable.
    robot = with_closed_terms(robot, base.known)
    options["method"] = base.method
    names, units = _names(base)
    values, errors = np.full((2, len(cutoffs), len(names)), np.nan)
    refused: dict[float, str] = {}
    for place, cutoff in enumerate(track(cutoffs, "identifying per cutoff", progress)):
        try:
            same = cutoff == base.cutoff_hz
            result = base if same else identify(robot, logs, cutoff_hz=cutoff, **options)
        except SeaidError as problem:
            refused[cutoff] = str(problem)
            continue
        if _names(result) != (names, units):
            refused[cutoff] = "other parameters are identifiable than at the proposed cutoff"
            continue
        values[place], errors[place] = _estimates(result)
    return CutoffSensitivity(
        cutoffs_hz=np.array(cutoffs),
        names=names,
        units=units,
        values=values,
        standard_errors=errors,
        proposed=cutoffs.index(base.cutoff_hz),
        refused=refused,
    )


def _names(result: Identification) -> tuple[tuple[str, ...], tuple[str, ...]]:
    drives = result.drives.items()
    names = [f"{name} of {joint}" for joint, estimate in drives for name in estimate.names]
    units = [unit for _, estimate in drives for unit in estimate.units]
    return (*names, *result.load.names), (*units, *result.load.units)


def _estimates(result: Identification) -> tuple[Array, Array]:
    estimates = [*result.drives.values(), result.load]
    return (
        np.concatenate([estimate.values for estimate in estimates]),
        np.concatenate([estimate.standard_errors for estimate in estimates]),
    )
