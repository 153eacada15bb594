"""Identification of logs without a sensor behind some springs, from their motors alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from seaid.checks import (
    explained,
    log_findings,
)
from seaid.errors import (
    ExcitationError,
    IdentificationError,
    LogError,
)
from seaid.identification.motor_side import (
    cutoff_of,
    shown_springs,
    starts_by_regression,
)
from seaid.identification.options import Options
from seaid.identification.output_error import FirstEstimate, first_estimate, refined_with_logs
from seaid.identification.result import Identification, consistent_bodies
from seaid.identification.simulated_joints import check_refinable
from seaid.log import Log
from seaid.robot import Robot

if TYPE_CHECKING:
    pass


_MOST_STEPS = 60
"""Steps of a refinement without joint encoders, three times as many as with them: at a spring that
the torque noise hides, a step goes only part of the way."""


_LOWER = (1.0, 0.5, 0.25)
"""Parts of the proposed cutoff that are tried in turn without joint encoders. That of a motion far
above the antiresonance lets in derivatives of noise, which hide where a search has to start."""


def identify_from_motors(
    robot: Robot,
    logs: list[Log],
    joints: Sequence[str],
    options: Options,
    identify: Callable[..., Identification],
) -> Identification:
    """Return the identification of logs without a sensor behind the springs of some joints.

    `identify` is that of logs with all sensors. Where the fit does not end below the proposed
    cutoff, lower ones are tried. Raises the error of the proposed one if none of them shows the
    springs: a fit of noise may end there too.
    """
    findings = log_findings(robot, logs, robot.selected(options.torque_joints))
    with explained(partial(list, findings)):
        result = _best_of_cutoffs(robot, logs, joints, options, identify)
    return consistent_bodies(result) if options.feasible else result


def _best_of_cutoffs(
    robot: Robot,
    logs: list[Log],
    joints: Sequence[str],
    options: Options,
    identify: Callable[..., Identification],
) -> Identification:
    """Return the result of the highest cutoff that shows the springs."""
    check_refinable(robot, joints)
    options.check_without_encoders(joints)
    fit = partial(
        identify,
        robot,
        torque_joints=options.torque_joints,
        method="two-step",  # the simulated angles of the joints come from the springs
        estimator=options.estimator,
        encoder_offset_std=options.encoder_offset_std,
        known_std=options.known_std,
        executor=options.executor,
    )
    proposed_hz, problem = cutoff_of(robot, logs, joints, options.cutoff_hz), None
    for part in _LOWER if options.cutoff_hz is None else (1.0,):
        try:
            cutoff_hz = part * proposed_hz
            second = fit(_simulated(robot, logs, joints, cutoff_hz, fit), cutoff_hz=cutoff_hz)
            result = _refined_from_motors(second, logs, joints, options.encoder_offset_std)
            if problem is None or not any(finding.code == _HIDDEN for finding in result.findings):
                return result
        except (IdentificationError, ExcitationError, LogError) as reason:
            problem = problem or reason
    assert problem is not None
    raise problem


_HIDDEN = "hidden-resonance"


def _simulated(
    robot: Robot,
    logs: list[Log],
    joints: Sequence[str],
    cutoff_hz: float,
    fit: Callable[..., Identification],
) -> list[Log]:
    """Return the logs with the angles of joints as the best of the first estimates simulates them.

    A search of the stiffness gives the angles for a first regression, and its refinement these, for
    a second, from which the terms of the drives and all findings come.
    """
    problem = None
    tried: list[FirstEstimate] = []
    for initial in starts_by_regression(robot, logs, joints, cutoff_hz):
        for consistent in (False, True):  # an inertia as estimated may not be one to simulate
            try:
                start = fit(initial, cutoff_hz=cutoff_hz, feasible=consistent)
                tried.append(first_estimate(start, logs))
                break
            except (IdentificationError, ExcitationError, LogError) as reason:
                problem = problem or reason
        if tried and tried[-1].is_at_noise:
            break
    if not tried and problem is not None:
        raise problem
    return min(tried, key=lambda estimate: estimate.merit).logs


def _refined_from_motors(
    second: Identification, logs: list[Log], joints: Sequence[str], encoder_offset_std: float
) -> Identification:
    """Return the refinement of a second regression, with what hides the springs of joints."""
    try:
        refined, _ = refined_with_logs(second, logs, encoder_offset_std, _MOST_STEPS)
    except IdentificationError as reason:
        raise IdentificationError(
            f"the motor alone does not determine the stiffness of {', '.join(joints)} "
            f"({str(reason).split(';')[0]}). "
            f"Either the motion, with a band of {second.cutoff_hz:.3g} Hz, stays too far below the "
            "antiresonance of the load for the motor to feel the spring, or the load has a spring "
            "of its own: record a multisine with a larger band (seaid excite --basis multisine), "
            "or log the joint position"
        ) from None
    rate_hz = min((len(log.time) - 1) / float(log.time[-1] - log.time[0]) for log in logs)
    findings = (*refined.findings, *shown_springs(refined, joints, rate_hz))
    return replace(refined, findings=findings)
