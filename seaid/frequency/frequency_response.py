"""Frequency responses from motor torque to motor angle, and the springs that they show.

The best linear approximation with its noise and its total variance: Pintelon and Schoukens, System
Identification: A Frequency Domain Approach, 2012, chapters 4 and 7. The springs are those of the
linearised robot that explains the same spectra by maximum likelihood (chapter 9).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid._arrays import Array, IndexArray
from seaid._progress import Result, counted
from seaid.checks import predictions
from seaid.drives import total_ratio
from seaid.errors import Finding, IdentificationError, by_severity, checked, listed
from seaid.estimation import Estimate
from seaid.excitation import FourierBasis, JoinedBasis, Trajectory
from seaid.frequency.linear_joints import (
    FITS,
    Fit,
    LinearJoints,
    fitted,
    linearised,
    refitted,
    sticking_sign,
)
from seaid.frequency.spectra import (
    Record,
    Spectra,
    approximation_of,
    moving_joints,
    record_of,
    spectra_of,
)
from seaid.identification import Identification
from seaid.log import Log
from seaid.robot import Robot, at_joints

_OF_NYQUIST = 0.8
"""Share of half the rate up to which a response is trusted."""

_STICK_ROUNDS = 3
"""Fits with the friction of motors at standstill that the fit before has."""


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(Result):
    """The measured response of joints to their motor torques, and the springs in it.

    Attributes
    ----------
    joints : tuple of n str
        The joints that move in the logs.
    frequency_hz : array (F,)
        Frequencies of the response [Hz].
    response : array (F, n, n)
        Best linear approximation from the motor torque of a joint (last axis) to the motor angle of
        a joint [rad/(N m)], complex.
    noise_std, total_std : array (F, n, n)
        Standard deviations of `response`: by noise, which differs from period to period, and in
        total, with what the nonlinear parts of the robot do; NaN where the logs do not show it.
    coherence : array (F, n)
        Share of the power of each motor angle that the linear response explains.
    model : array (F, n, n)
        Response of the linearised robot that fits the logs best, with dry friction as the viscous
        one that it equals for this motion.
    identified : array (F, n, n) or None
        That of the linearised robot of an identification.
    drives : mapping {joint: Estimate}
        Of each elastic joint: `resonance` and `antiresonance` [Hz], which are frequencies with all
        motors free and with all held, their damping ratios, and the stiffness, spring damping,
        motor inertia, viscous friction and load inertia.
    period_s : float or None
        Length of a period [s], None for a log that is not periodic.
    warnings : tuple of Finding
        What limits the result, from the worst to the mildest.
    """

    table_name = "frequency_table"

    joints: tuple[str, ...]
    frequency_hz: Array
    response: Array
    noise_std: Array
    total_std: Array
    coherence: Array
    model: Array
    identified: Array | None
    drives: Mapping[str, Estimate]
    period_s: float | None
    warnings: tuple[Finding, ...] = ()

    def _in_short(self) -> str:
        ends = f"{self.frequency_hz[0]:.3g} to {self.frequency_hz[-1]:.3g} Hz"
        return f"joints {listed(self.joints, 6)}: {counted(len(self.frequency_hz), 'line')}, {ends}"


@checked(IdentificationError)
def frequency_response(
    robot: Robot,
    logs: Log | Sequence[Log],
    *,
    plan: Trajectory | None = None,
    period_s: float | None = None,
    band_hz: Sequence[float] | None = None,
    joints: str | Sequence[str] | None = None,
    identification: Identification | None = None,
) -> FrequencyResponse:
    """Measure the frequency response of joints, and the resonance, damping and springs in it.

    Motor torques and motor angles suffice. The best linear approximation needs periodic motions, as
    `design_excitation(..., basis="multisine")` plans them, or takes segments of the log (Welch).
    Noise is what differs between periods, and nonlinear distortion what differs between
    realisations, or appears at frequencies that were not excited. The springs are found by a
    maximum-likelihood fit of the linearised robot: mass matrix, gravity stiffness, springs with
    damping, motors with viscous and dry friction. It starts from nominal values where there are
    some; it is weighted by the variance of what it leaves, and the standard errors follow from it.

    Parameters
    ----------
    robot : Robot
    logs : Log or sequence of Log
        Logs about the same posture. As many as joints move, or more, with motions independent of
        each other, give the response at each frequency by itself. Fewer give that of the fit, with
        a correction that is smooth over frequency.
    plan : Trajectory, optional
        A multisine that the logs followed: its period, and the frequencies that it excites.
    period_s : float, optional
        Length of the period [s] of periodic logs without `plan`.
    band_hz : (float, float), optional
        Lowest and highest frequency [Hz]. Default: what is excited, below 0.8 times half the rate.
    joints : sequence of str, optional
        Joints that take part. Default: those that move.
    identification : Identification, optional
        Its linearised robot is compared: response, and stiffness by its interval.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    IdentificationError
        For logs without torques or angles of the motors, of several rates, too short for a period,
        or in which no joint moves.

    Examples
    --------
    >>> plan = seaid.design_excitation(robot, 5.0, basis="multisine").trajectory
    >>> log = seaid.simulate(robot, plan, rate_hz=500.0)  # or seaid.read_log("run.csv", robot)
    >>> found = seaid.frequency_response(robot, log, plan=plan)
    >>> found.drives["knee"].value("resonance"), found.drives["knee"].interval(0.95)
    """
    logs = [logs] if isinstance(logs, Log) else list(logs)
    middle = harmonics = None
    if plan is not None:
        period_s, middle, harmonics = _multisine_of(plan)
        logs = [_within(log, plan) for log in logs]
    rate = _rate_of(logs, period_s)
    band = _band(band_hz, _OF_NYQUIST * rate / 2)
    ratio = _ratios(robot, robot.joint_names)
    records = [record_of(robot, log, ratio, period_s) for log in logs]
    picked = _picked(robot, records, joints, band[1])
    mean = np.mean([record.posture for record in records], axis=0)
    posture = at_joints(robot.transmission, mean) if middle is None else middle
    nominal = linearised(robot, posture, picked)

    def read(records: Sequence[Record]) -> Spectra:
        return spectra_of(records, picked, band, harmonics, periodic=period_s is not None)

    spectra = read(records)
    fit = fitted(spectra, nominal, robot, picked)
    # Friction at standstill is that of the fit before, if motors have to stick.
    sticks = spectra.is_periodic & bool(np.any(fit.joints.dry > 0))
    for _ in range(_STICK_ROUNDS * sticks):
        spectra = read([sticking_sign(record, picked, fit) for record in records])
        fit = refitted(spectra, fit)
    identified, others = None, dict[str, Estimate]()
    if identification is not None:
        identified = linearised(identification.robot, posture, picked)
        others = dict(identification.drive_side)
    result = _response(robot, picked, records, spectra, fit, identified, period_s)
    findings = _findings(result, fit, spectra, nominal, robot, rate)
    return replace(result, warnings=by_severity([*findings, *_disagreements(result, others)]))


def _disagreements(result: FrequencyResponse, others: Mapping[str, Estimate]) -> Iterator[Finding]:
    """Yield the stiffnesses that other estimates have otherwise."""
    for joint, estimate in others.items():
        if joint in result.drives and "stiffness" in estimate.names:
            yield from predictions.stiffness_disagrees(joint, result.drives[joint], estimate)


def _response(
    robot: Robot,
    picked: list[int],
    records: Sequence[Record],
    spectra: Spectra,
    fit: Fit,
    identified: LinearJoints | None,
    period_s: float | None,
) -> FrequencyResponse:
    """Return the best linear approximation of joints, with the robot that fits them best."""
    names = tuple(robot.joint_names[index] for index in picked)
    alike = _with_dry_friction(fit.joints, spectra, spectra.hz)
    measured = approximation_of(spectra, records, picked, alike)
    # Spectra are at the joints, theta_M/N_i by N_j tau_M: N_i N_j times that is theta_M by tau_M.
    ratio = _ratios(robot, names)
    scale = ratio[:, None] * ratio

    def modelled(joints: LinearJoints) -> Array:
        return np.asarray(scale * _with_dry_friction(joints, spectra, measured.hz))

    return FrequencyResponse(
        joints=names,
        frequency_hz=measured.hz,
        **{
            name: scale * getattr(measured, name) for name in ("response", "noise_std", "total_std")
        },
        coherence=measured.coherence,
        model=modelled(fit.joints),
        identified=None if identified is None else modelled(identified),
        drives={
            names[place]: fit.estimate(place, robot.drives[names[place]])
            for place in np.flatnonzero(fit.joints.elastic).tolist()
        },
        period_s=period_s,
    )


def _ratios(robot: Robot, names: Sequence[str]) -> Array:
    """Return the ratios (n,) of motors to joints."""
    return np.array([total_ratio(robot.drives[name]) for name in names])


def _rate_of(logs: Sequence[Log], period_s: float | None) -> float:
    """Return the rate of all logs [Hz]. Raises IdentificationError for logs that do not fit."""
    if not logs:
        raise IdentificationError("a frequency response needs at least one log", "logs=")
    rates = [(len(log.time) - 1) / float(log.time[-1] - log.time[0]) for log in logs]
    if max(rates) > 1.001 * min(rates):
        raise IdentificationError(
            f"the logs have rates from {min(rates):.6g} to {max(rates):.6g} Hz: a frequency "
            "response needs one rate; give logs of one rate, or one of them"
        )
    if period_s is None:
        return rates[0]
    if not 0 < period_s < math.inf:
        text = f"period_s must be more than zero seconds, found {period_s}"
        raise IdentificationError(text, "period_s")
    shortest = min(len(log.time) / rate for log, rate in zip(logs, rates, strict=True))
    if shortest < period_s * (1 - 1e-6):
        raise IdentificationError(
            f"a log of {shortest:.4g} s is shorter than the period of {period_s:.4g} s: give a "
            "longer log, or the period that it has",
            "period_s",
        )
    return rates[0]


def _band(band_hz: Sequence[float] | None, top_hz: float) -> tuple[float, float]:
    """Return the lowest and highest frequency [Hz], below what the rate shows."""
    band = (0.0, math.inf) if band_hz is None else tuple(map(float, band_hz))
    if len(band) != 2 or not 0 <= band[0] < band[1]:
        text = f"band_hz must be a lowest and a highest frequency, found {list(band)}"
        raise IdentificationError(text, "band_hz")
    return band[0], min(band[1], top_hz)


def _picked(
    robot: Robot, records: Sequence[Record], joints: str | Sequence[str] | None, top_hz: float
) -> list[int]:
    """Return the indices of the joints that take part, which need both motor channels."""
    if joints is None:
        picked = moving_joints(records, top_hz)
    else:
        picked = [robot.index(joint) for joint in robot.selected(joints)]
    if not picked:
        raise IdentificationError("no motor moves in these logs: give logs of a multisine")
    for name, field in (("torque", "motor_torque"), ("motor", "motor_position")):
        known = [np.isfinite(getattr(x, name)).all(axis=(0, 1)) for x in records]
        for index in np.intersect1d(picked, np.flatnonzero(~np.all(known, axis=0))).tolist():
            joint = robot.joint_names[index]
            raise IdentificationError(
                f"joint '{joint}' has no {field.replace('_', ' ')} in a log: a frequency response "
                f"needs both, from the motor; log '{joint}.{field}_...', or leave the joint out "
                "with joints=",
                "joints=",
            )
    return picked


def _multisine_of(plan: Trajectory) -> tuple[float, Array, IndexArray]:
    """Return period [s], mean position (n,) and excited harmonics of a plan, but for its run-in."""
    parts = plan.basis.parts if isinstance(plan.basis, JoinedBasis) else (plan.basis,)
    first = 0
    for part in parts:
        if isinstance(part, FourierBasis):
            # Coefficients: the constant, H sines, H cosines, per joint.
            coefficients = plan.coefficients[first : first + part.size]
            sizes = np.abs(coefficients[1:]).reshape(2, part.harmonics, -1).sum(axis=(0, 2))
            return part.period_s, coefficients[0], 1 + np.flatnonzero(sizes > 1e-9 * sizes.max())
        first += part.size
    raise IdentificationError(
        "plan= must be a multisine, from design_excitation(..., basis='multisine'), found a "
        f"{type(plan.basis).__name__}",
        "plan=",
    )


def _within(log: Log, plan: Trajectory) -> Log:
    """Return the part of a log without run-in and run-out, if it is as long as the plan."""
    begin, end = plan.main_interval
    start = float(log.time[0])
    if float(log.time[-1]) - start < end - 1e-6 or (begin, end) == (0.0, plan.duration):
        return log
    step = (float(log.time[-1]) - start) / (len(log.time) - 1)
    return log.between(start + begin - 1e-6 * step, start + end + 1e-6 * step)


def _with_dry_friction(joints: LinearJoints, spectra: Spectra, hz: Array) -> Array:
    """Return the response (F, n, n) with dry friction as the viscous one closest to it.

    The best linear approximation of a sign is a gain for a random speed (Bussgang 1952).
    """
    speed = 2j * np.pi * spectra.hz[:, None] * spectra.motor
    power = np.sum(np.abs(speed) ** 2, axis=(0, 1, 2))
    # Projection of sign(w) on w, by Parseval: Re <w, sign(w)> / <w, w> over logs, periods, lines.
    gain = np.sum(np.real(np.conj(speed) * spectra.sign), axis=(0, 1, 2)) / power
    n = len(joints.dry)
    alike = replace(joints, friction=joints.friction + joints.dry * gain)
    return alike.compliance(2j * np.pi * hz)[:, :n, :n]


def _findings(
    result: FrequencyResponse,
    fit: Fit,
    spectra: Spectra,
    nominal: LinearJoints,
    robot: Robot,
    rate: float,
) -> Iterator[Finding]:
    """Yield what the response of each joint shows of its spring, and of the fit."""
    expected = np.full(len(result.drives), np.nan)
    if np.all(np.isfinite(nominal.stiffness)) and np.all(np.isfinite(nominal.mass)):
        # Motors that are held have no part in it, with whatever inertia.
        held = replace(nominal, inertia=np.zeros(len(nominal.inertia)))
        expected = np.abs(held.modes(held=True)) / (2 * np.pi)
    top = float(result.frequency_hz[-1])
    for (joint, spring), hz in zip(result.drives.items(), expected.tolist(), strict=True):
        place = result.joints.index(joint)
        near = int(np.argmin(np.abs(result.frequency_hz - (hz if math.isfinite(hz) else top))))
        response = abs(result.response[near, place, place])
        noise = float(result.total_std[near, place, place] / response)
        band_hz = top, _OF_NYQUIST * rate / 2, rate
        yield from predictions.unseen_resonance(joint, spring, hz, band_hz, noise)
    if np.sum(fit.joints.elastic) > 1 and fit.lack_of_fit >= FITS:
        yield predictions.wrong_minimum(fit.lack_of_fit)
    known = fit.joints.elastic & ~fit.parameters.free["inertia"]
    free = refitted(spectra, fit, are_rotors_free=True) if np.any(known) else fit
    for place in np.flatnonzero(known).tolist():
        joint = result.joints[place]
        stated, drive = result.drives[joint].by_name, robot.drives[joint]
        yield from predictions.contradicted_rotor(joint, stated, free.estimate(place, drive))
