"""Random-phase multisines around a posture, for the frequency response of a robot's joints.

Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2012, chapters 4 and 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from seaid._arrays import Array, BoolArray, finite, number
from seaid._progress import Display, counted
from seaid.errors import ExcitationError, unknown_name
from seaid.excitation.basis import FourierBasis, check_whole_number
from seaid.excitation.limits import (
    DRIVE_KINDS,
    KINDS,
    DriveLimits,
    JointLimits,
    LimitValue,
    drive_loads,
    largest_factor,
    limit_values,
)
from seaid.excitation.trajectory import Trajectory
from seaid.robot import Robot

Spectrum = Literal["position", "velocity", "acceleration"]

_FLAT: dict[str, int] = {"position": 0, "velocity": 1, "acceleration": 2}
"""{what has equal amplitudes at all frequencies: the order of that derivative of the position}."""

_HIGHEST_HZ = 20.0
"""Upper end of the band [Hz] if none is given."""

_MOST_HARMONICS = 400
"""Harmonics of a period: bounds of the motion take a matrix of twice its square, times 64."""

_USE = 0.95
"""Share of the limits that a multisine without a given amplitude uses."""

_GRID = 8
"""Instants per period of the highest frequency, at which limits of the drives are checked."""


@dataclass(frozen=True, repr=False)
class Multisine(Display):
    """A sum of cosines with random phases, repeated over periods, around a posture.

    Parameters
    ----------
    band_hz : (float, float), optional
        Lowest and highest excited frequency [Hz]. Default: from that of the period to 20.
    period_s : float, optional
        Length of a period [s]; frequencies are multiples of its inverse. Default: half of the
        duration, so that the motion has two periods.
    spectrum : {"acceleration", "velocity", "position"}
        The quantity with equal amplitudes at all frequencies.
    amplitude : float, sequence of n floats or dict, optional
        Largest displacement of each joint from its posture [rad or m]; 0 holds a joint. Default:
        what the limits allow, the same share of them for all joints.
    posture : float, sequence of n floats or dict, optional
        Mean position of each joint. Default: the middle of its limits.
    odd : bool
        Whether only odd multiples are excited: even ones then show nonlinear distortions.
    omit_one_of : int
        One of so many consecutive excited frequencies, chosen at random, is not excited, and shows
        odd distortions; 0 excites all.
    realisation : int
        Number of the random phases; different realisations show what is nonlinear.
    experiment : int
        Number of the experiment from 0 to n - 1: the phases of n moving joints are shifted such
        that their n experiments are orthogonal, and determine the response from every joint to
        every joint.

    Examples
    --------
    >>> shape = seaid.Multisine(band_hz=(0.5, 15.0), period_s=5.0, amplitude={"knee": 0.1})
    >>> plan = seaid.design_excitation(robot, 10.0, basis="multisine", multisine=shape)
    """

    band_hz: tuple[float, float] | None = None
    period_s: float | None = None
    spectrum: Spectrum = "acceleration"
    amplitude: LimitValue = None
    posture: LimitValue = None
    odd: bool = True
    omit_one_of: int = 4
    realisation: int = 0
    experiment: int = 0

    def __post_init__(self) -> None:
        for name in ("omit_one_of", "realisation", "experiment"):
            check_whole_number(name, getattr(self, name), least=0)
        if self.spectrum not in _FLAT:
            raise ExcitationError(unknown_name("spectrum", self.spectrum, _FLAT), "spectrum")


def multisine(
    robot: Robot,
    duration: float,
    shape: Multisine,
    limits: JointLimits,
    drives: DriveLimits | None,
    seed: int,
) -> Trajectory:
    """Return the multisine of a shape within limits. Raises ExcitationError where it breaks one."""
    basis, excited = _frequencies(shape, duration, seed)
    middle = limit_values(robot, "posture", shape.posture, limits.middle)
    default = np.full(robot.n, np.inf)
    most = limit_values(robot, "amplitude", shape.amplitude, default, unlimited=True)
    moving, room = np.flatnonzero(most != 0), _room(robot, middle, limits)
    if not len(moving):
        text = "the multisine moves no joint: all amplitudes are zero; give one of them"
        raise ExcitationError(text, "amplitude")
    sliding = tuple(np.array(robot.joint_names)[list(robot.is_prismatic)].tolist())
    # all experiments have one size, that of the largest peaks, so that they are orthogonal
    unscaled = np.zeros((len(moving), basis.size, robot.n))
    for experiment, values in enumerate(unscaled):
        variant = replace(shape, experiment=experiment)
        values[1:, moving] = _unscaled(variant, basis, excited, len(moving), seed)
    # (experiments, K, n) -> (3, n): displacement, speed and acceleration at unit size
    peaks = np.max([_peaks(basis, coefficients) for coefficients in unscaled], axis=0)

    def motion(size: Array, experiment: int) -> Trajectory:
        values = unscaled[experiment] * size
        values[0] = middle
        return Trajectory(robot.joint_names, basis, values, sliding)

    bounds = np.array([room, limits.velocity, limits.acceleration])
    share = np.min(bounds / np.maximum(peaks, 1e-300), axis=0)
    fixed = np.isfinite(most)
    size = np.where(fixed, most / np.maximum(peaks[0], 1e-300), _USE * share)
    size[peaks[0] == 0] = 0.0
    index = shape.experiment % len(moving)
    # of one period
    instants = basis.period_s * np.linspace(0.0, 1.0, _GRID * basis.harmonics, endpoint=False)
    if drives is not None and not np.all(fixed):
        motions = [partial(motion, experiment=e) for e in range(len(moving))]
        size = _within_drives(motions, size, fixed, drives, instants)
    trajectory = motion(size, index)
    _check_limits(trajectory, bounds, peaks * size, drives, instants)
    return trajectory


def _room(robot: Robot, middle: Array, limits: JointLimits) -> Array:
    """Return how far joints can move from the middle (n,). Raises ExcitationError for nowhere."""
    room = np.minimum(limits.upper - middle, middle - limits.lower)
    if np.any(room <= 0):
        joint = int(np.argmin(room))
        raise ExcitationError(
            f"joint '{robot.joint_names[joint]}': the posture {middle[joint]:.4g} of the multisine "
            f"is not inside of its position limits, {limits.lower[joint]:.4g} to "
            f"{limits.upper[joint]:.4g}: give another posture",
            "posture",
        )
    return np.asarray(room)


def _period(shape: Multisine, duration: float) -> tuple[float, int]:
    """Return the period [s], and the number of periods."""
    period = number("period_s", shape.period_s or duration / 2, ExcitationError)
    if not (math.isfinite(period) and 0 < period <= duration):
        text = f"period_s must be more than zero and at most the duration, {duration:g} s"
        raise ExcitationError(f"{text}, found {period:g}", "period_s")
    periods = round(duration / period)
    if abs(periods * period - duration) > 1e-6 * duration:
        raise ExcitationError(
            f"a duration of {duration:g} s is not a whole number of periods of {period:g} s: give "
            f"{max(periods, 1) * period:g} s",
            "duration",
        )
    return period, periods


def _frequencies(shape: Multisine, duration: float, seed: int) -> tuple[FourierBasis, Array]:
    """Return the basis, and the numbers of the excited harmonics."""
    period, periods = _period(shape, duration)
    low, high = shape.band_hz or (1 / period, _HIGHEST_HZ)
    low, high = finite("band_hz", (low, high), (2,), ExcitationError).tolist()
    # rounding must not exclude a harmonic at an end of the band
    lowest, highest = math.ceil(low * period - 1e-9), math.floor(high * period + 1e-9)
    harmonics = np.arange(max(1, lowest), highest + 1)
    if shape.odd:
        harmonics = harmonics[harmonics % 2 == 1]
    if len(harmonics) < 2 or not 0 <= low < high:
        raise ExcitationError(
            f"the band {low:g} to {high:g} Hz has {counted(len(harmonics), 'frequency')} of a "
            f"period of {period:g} s, needs two or more: give a wider band or a longer period",
            "band_hz",
        )
    if harmonics[-1] > _MOST_HARMONICS:
        raise ExcitationError(
            f"{high:g} Hz is harmonic {harmonics[-1]} of a period of {period:g} s, at most "
            f"{_MOST_HARMONICS} are allowed: give a shorter period, or a lower band",
            "band_hz",
        )
    if shape.omit_one_of:
        # Pintelon and Schoukens 2012, section 4.3: one line at random of each group is not excited
        rng = np.random.default_rng([seed, len(harmonics)])
        # lines that do not fill a last group are all excited
        groups = np.arange(0, len(harmonics) - shape.omit_one_of + 1, shape.omit_one_of)
        harmonics = np.delete(harmonics, groups + rng.integers(shape.omit_one_of, size=len(groups)))
    return FourierBasis(int(harmonics[-1]), float(duration), periods), harmonics


def _unscaled(shape: Multisine, basis: FourierBasis, excited: Array, n: int, seed: int) -> Array:
    """Return the amplitudes (2H, n) of sines and cosines, up to a scale per joint."""
    # amplitudes f^-k of the position are equal ones of its derivative of order k
    size = (excited / basis.period_s) ** -float(_FLAT[shape.spectrum])
    rng = np.random.default_rng([seed, shape.realisation])
    phase = 2 * np.pi * rng.random((len(excited), n))
    # the orthogonal experiments of Dobrowiecki and Schoukens 2007: joint j turned by 2 pi e j / n
    phase += 2 * np.pi * shape.experiment * np.arange(n) / max(n, 1)
    # A cos(w t + phase) = -A sin(phase) sin(w t) + A cos(phase) cos(w t)
    amplitudes = np.zeros((2, basis.harmonics, n))
    amplitudes[0, excited - 1] = -size[:, None] * np.sin(phase)
    amplitudes[1, excited - 1] = size[:, None] * np.cos(phase)
    flat: Array = amplitudes.reshape(-1, n)
    return flat


def _peaks(basis: FourierBasis, coefficients: Array) -> Array:
    """Return upper bounds (3, n) of displacement, speed and acceleration of unit size."""
    about = coefficients.copy()
    about[0] = 0.0
    return np.array([np.abs(basis.hull(order, 16) @ about).max(axis=0) for order in range(3)])


def _within_drives(
    motions: Sequence[Callable[[Array], Trajectory]],
    size: Array,
    fixed: BoolArray,
    drives: DriveLimits,
    time: Array,
) -> Array:
    """Return the sizes (n,), those not given reduced until all motions keep limits of drives."""

    def reduced(factor: float) -> Array:
        return np.where(fixed, size, factor * size)

    def keeps_limits(factor: float) -> bool:
        trials = [motion(reduced(factor)).sample(time) for motion in motions]
        loads = [drive_loads(drives, time, states) for states in trials]
        return bool(np.all(np.abs(loads).max(axis=(0, 2)) <= _USE * drives.largest))

    return reduced(largest_factor(keeps_limits))


def _check_limits(
    motion: Trajectory, bounds: Array, peaks: Array, drives: DriveLimits | None, time: Array
) -> None:
    """Raise ExcitationError naming the joint and the first limit that a multisine breaks."""
    kinds, most, largest = list(KINDS), list(peaks), list(bounds)
    if drives is not None:
        kinds += [kind.replace("_", " ") for kind in DRIVE_KINDS]
        most += list(np.abs(drive_loads(drives, time, motion.sample(time))).max(axis=1))
        largest += list(drives.largest)
    for kind, used, allowed in zip(kinds, most, largest, strict=True):
        over = used / allowed
        joint = int(np.argmax(over))
        if over[joint] > 1.0:
            name = motion.joint_names[joint]
            size = peaks[0, joint]
            lower = (
                f"give an amplitude of at most {_USE * size / over[joint]:.3g} for '{name}', a "
                "lower band, or none to use what the limits allow"
            )
            raise ExcitationError(
                f"joint '{name}': the multisine breaks its {kind} limit: {used[joint]:.4g}, "
                f"allowed {allowed[joint]:.4g}; {lower}",
                "amplitude",
            )
    if not np.any(peaks[0] > 0):
        raise ExcitationError(
            "the multisine moves no joint: the limits of torque are reached at its posture; give "
            "another posture or other limits",
            "posture",
        )
