"""`identify` a robot from its logs, `validate` on another, and both over parts and cutoffs.

Without a sensor behind some springs their motors alone determine them, by simulation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid._progress import track
from seaid.checks.predictions import not_measured, unseen_motion
from seaid.checks.setup import log_findings
from seaid.checks.tolerances import MOST
from seaid.errors import Finding, Hertz, IdentificationError, checked
from seaid.estimation.fitting import EstimatorName
from seaid.estimation.parameters import with_groups
from seaid.identification import output_error
from seaid.identification.conclusion import conclude, consistent_bodies
from seaid.identification.datasets import Source, sources_of
from seaid.identification.problem import Method, Options, explained, solve
from seaid.identification.result import Fit, Identification, Validation, extension_of
from seaid.identification.two_step import ONLY
from seaid.identification.unseen_springs import (
    cutoff_of,
    hidden_spring_findings,
    joints_sensed_by_motor_only,
    starts_by_regression,
    successes,
)
from seaid.identification.validation import compared
from seaid.log import Log
from seaid.log.motion import reconstruct_motions
from seaid.robot import Robot


@checked(IdentificationError)
def identify(
    robot: Robot,
    logs: Source | Sequence[Source],
    *,
    torque_joints: str | Sequence[str] | None = None,
    method: Method = "auto",
    estimator: EstimatorName = "wls",
    feasible: bool = False,
    cutoff_hz: Hertz | None = None,
    encoder_offset_std: float = 0.0,
    known_std: Mapping[str, float] = MappingProxyType({}),
    share: Mapping[str, Sequence[str]] = MappingProxyType({}),
    progress: bool = False,
) -> Identification:
    """Identify the drives and the load of a robot from one log or several.

    Part one estimates friction, stiffness and spring offset of each elastic joint from its motor
    equation (7). Part two computes the load torques from the springs by (4b) and estimates the base
    parameters from the load side (8), with the uncertainty of the springs propagated. Where the
    data support it, both equations are then solved at once.

    Of `robot` only ratios, radii, geometry, payloads and known values enter the estimate, and with
    `feasible` its inertial parameters as a prior; nominal values are only starts of a search.
    Parameters in which a drive equation is nonlinear (a width, a Stribeck speed, a dead zone) are
    first searched by variable projection (in the first piece of a log that is read in pieces); then
    they have a column and a standard error like all others.

    Parameters
    ----------
    robot : Robot
        The robot model of `load_robot`.
    logs : Log, LongLog, path, or a sequence of them
        Logs in memory, or log files with standard column names that are read in pieces: with "ols"
        and "wls" memory does not grow with their length.
    torque_joints : sequence of str, optional
        Joints whose torque is used on the load side. Default: all with a measured torque.
    method : {"auto", "two-step", "simultaneous"}
        "two-step" is that of the paper. "simultaneous" continues from it to (7) and (8) in one
        regression that shares the springs. "auto" takes the latter, which is the more accurate one,
        if the equations of two steps lack nothing, and if both agree; `Identification.not_shared`
        says why not.
    estimator : {"wls", "ols", "huber", "tukey", "iv"}
        Least squares weighted per joint or ordinary, robust estimators, or instrumental variables
        from the fitted model against the bias by noise in the regressor (two-step only). Logs
        without the joint position of a spring refuse "iv", and the method "simultaneous".
    feasible : bool
        Make `Identification.robot` physically consistent; see `feasible_parameters`.
    cutoff_hz : float, optional
        Cutoff of the low pass. Default: proposed from the data.
    encoder_offset_std : float
        Standard deviation of the joint encoder offsets [rad or m], propagated to the load side.
    known_std : mapping {constant: relative standard deviation}
        Of what was given as known: "torque" (one scale error common to all torques), "payload"
        (mass), "bodies" (each known body, by a scale of its own), "motor_inertia_kg_m2",
        "gear_ratio", "motor_pulley_radius_m", "load_pulley_radius_m"; propagated to all estimates.
        A drive's own `std` takes precedence. Each is above 0 and at most 1, and of something that
        the robot has: a constant without one is exact.
    share : mapping {group: joints}
        Drives of one type, whose friction, spring, rotor inertia and constants are the same ones,
        besides those that the drives file names (`shared`); `Identification.shared` tests it.
    progress : bool
        Show progress bars.

    Returns
    -------
    Identification

    Raises
    ------
    IdentificationError, ExcitationError, LogError
        For wrong options, for a motion that leaves parameters unidentifiable, for logs that do not
        fit the robot.

    Examples
    --------
    >>> robot = seaid.load_robot("leg.urdf", "leg.toml")
    >>> result = seaid.identify(robot, seaid.read_log("run.csv", robot), feasible=True)
    >>> print(result.summary())
    """
    robot.selected(torque_joints)  # refuses unknown joints before a log is read
    robot = robot.with_drives(with_groups(robot.drives, share)) if share else robot
    options = Options(
        torque_joints=torque_joints,
        method=method,
        estimator=estimator,
        feasible=feasible,
        cutoff_hz=cutoff_hz,
        encoder_offset_std=encoder_offset_std,
        known_std=known_std,
        progress=progress,
    )
    sources = sources_of(logs)
    in_memory = [source for source in sources if isinstance(source, Log)]
    unseen = joints_sensed_by_motor_only(robot, in_memory) if len(in_memory) == len(sources) else ()
    if unseen:
        return _identify_from_motors(robot, in_memory, unseen, options)
    return _fit(robot, sources, options)


_MOST_STEPS = 60
"""Steps of a refinement without joint encoders, three times as many as with them: at a spring that
the torque noise hides, a step goes only part of the way."""


_CUTOFF_FRACTIONS = (1.0, 0.5, 0.25)
"""Parts of the proposed cutoff that are tried in turn without joint encoders. That of a motion far
above the antiresonance lets in derivatives of noise, which hide where a search has to start."""


def _identify_from_motors(
    robot: Robot, logs: list[Log], joints: Sequence[str], options: Options
) -> Identification:
    """Return the identification of logs without a sensor behind the springs of some joints.

    For each cutoff in turn, until one succeeds:

    1. a search of the stiffnesses gives angles of the joints;
    2. a first regression with these and its refinement give better angles;
    3. a second regression with those and its refinement are the result.

    Where the fit does not end below the proposed cutoff, lower ones are tried. Raises the error of
    the proposed one if none of them shows the springs: a fit of noise may end there too.
    """
    findings = log_findings(robot, logs, robot.selected(options.torque_joints))
    # The simulated angles of the joints come from the springs: both sides at once add nothing.
    steps = replace(
        options, method="two-step", feasible=False, progress=False, as_recorded=findings
    )
    fractions = _CUTOFF_FRACTIONS if options.cutoff_hz is None else (1.0,)
    with explained(lambda: findings):  # an error raised inside gets these findings as its cause
        output_error.WITHOUT_ENCODERS.check(robot, joints)
        if options.method != "auto" or options.estimator == "iv":
            options.procedure.check_seen(joints)
        proposed_hz = cutoff_of(robot, logs, joints, options.cutoff_hz)
        attempt = partial(_result_below, robot, logs, joints)
        cutoffs = (replace(steps, cutoff_hz=part * proposed_hz) for part in fractions)
        try:
            result = next(successes(partial(attempt, x, k > 0) for k, x in enumerate(cutoffs)))
        except IdentificationError as problem:
            raise IdentificationError(
                f"the motor alone does not determine the stiffness of {', '.join(joints)} "
                f"({problem.reason}). Either the motion, with a band of {proposed_hz:.3g} Hz, "
                "stays too far below the antiresonance of the load for the motor to feel the "
                "spring, or the load has a spring of its own: record a multisine with a larger "
                "band (seaid excite --basis multisine), log the joint position, or leave the "
                'springs out (type = "stiff")'
            ) from None
    reason = f"no sensor is behind the springs of {', '.join(joints)}, whose motors are simulated"
    result = replace(result, not_shared=reason if options.method == "auto" else "")
    return consistent_bodies(result) if options.feasible else result


def _result_below(
    robot: Robot, logs: list[Log], joints: Sequence[str], options: Options, is_lower: bool
) -> Identification:
    """Return the result of a cutoff; of one `is_lower` than proposed, if it shows the springs."""
    second_regression = _fit(robot, _with_simulated_angles(robot, logs, joints, options), options)
    result = _refined_from_motors(second_regression, logs, joints, options.encoder_offset_std)
    if is_lower and any(finding.code == "hidden-resonance" for finding in result.findings):
        raise IdentificationError(f"the springs are hidden below {result.cutoff_hz:.3g} Hz")
    return result


def _fit(robot: Robot, logs: Sequence[Source], options: Options) -> Identification:
    """Return the identification of logs that have the joint position of each spring."""
    return conclude(solve({ONLY: robot}, {ONLY: logs}, options), ONLY)


def _with_simulated_angles(
    robot: Robot, logs: list[Log], joints: Sequence[str], options: Options
) -> list[Log]:
    """Return the logs with the angles of joints as the best of the first estimates simulates them.

    A first estimate is the refined first regression from one of the stiffnesses of the search.
    """
    assert options.cutoff_hz is not None

    def estimated(initial: list[Log], is_consistent: bool) -> tuple[float, list[Log]]:
        return output_error.first_estimate(
            _fit(robot, initial, replace(options, feasible=is_consistent)), logs
        )

    def refined(initial: list[Log]) -> tuple[float, list[Log]]:
        # An inertia as estimated may not be one to simulate.
        return next(successes(partial(estimated, initial, x) for x in (False, True)))

    starts = starts_by_regression(robot, logs, joints, options.cutoff_hz)
    tried = successes(partial(refined, initial) for initial in starts)
    return min(tried, key=lambda estimate: estimate[0])[1]


def _refined_from_motors(
    second: Identification, logs: list[Log], joints: Sequence[str], encoder_offset_std: float
) -> Identification:
    """Return the refinement of a second regression, with what hides the springs of joints."""
    refined = output_error.refined_by_motors(second, logs, encoder_offset_std, _MOST_STEPS)
    rate_hz = min((len(log.time) - 1) / float(log.time[-1] - log.time[0]) for log in logs)
    findings = (*refined.findings, *hidden_spring_findings(refined, joints, rate_hz))
    return replace(refined, findings=findings)


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
    unseen = joints_sensed_by_motor_only(identification.known, [log])
    log = output_error.simulated_from_motors(identification, log)
    motions = reconstruct_motions(identification.robot, log, identification.cutoff_hz)
    result = compared(identification, *motions)
    places = [identification.known.index(joint) for joint in unseen]
    result = replace(result, load=_without_joints(result.load, places))
    findings = [*_contradictions(identification, result, places), *not_measured(unseen)]
    result = replace(result, warnings=tuple(findings))
    return extension_of(identification.known).validated(identification, result)


def _without_joints(fit: Fit, joints: Sequence[int]) -> Fit:
    """Return a fit without the values of some joints."""
    values = {field.name: getattr(fit, field.name).copy() for field in fields(fit)}
    for value in values.values():
        value[..., joints] = False if value.dtype == bool else np.nan
    return Fit(**values)


def _contradictions(
    identification: Identification, result: Validation, unseen: Sequence[int]
) -> Iterator[Finding]:
    """Yield a finding for each joint whose torque is predicted worse than in the own logs.

    Compared is the torque on the load; of the joints at the places `unseen`, whose load side was
    not measured, that of the motor.
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
        in_own_logs = [float(x[place]) for x in fits if np.isfinite(x[place])]
        ratio = float(of(result, "rms_error")[place]) / max(in_own_logs, default=np.inf)
        torque = f"the torque {where[is_unseen[place]]} of {joint}"
        yield from unseen_motion(torque, joint, float(error), ratio)


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
