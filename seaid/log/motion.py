"""Motion: positions, velocities and accelerations of both sides of every joint, from a log."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, BoolArray, connected_groups, safely
from seaid._progress import Display, counted, sampled_text
from seaid.drives import DEAD_ZONES, is_dry
from seaid.errors import LogError, checked, listed
from seaid.log.base_log import BaseLog, BaseMotion, base_motion
from seaid.log.channels import quantity_of, refusal
from seaid.log.commands import commanded_torque, is_commanded
from seaid.log.filtering import (
    BLUR_OF_COMMANDS,
    CutoffSelection,
    is_friction_known,
    low_pass,
    mean_directions,
    select_cutoff,
    spline_derivatives,
)
from seaid.log.repair.channels import in_gap, interpolated
from seaid.log.repair.clocks import irregular_steps, longest_bridge, longest_step, typical_step
from seaid.log.usable_parts import FROZEN, HOLES, REST, check_whole, holes, stretches, usable
from seaid.robot import at_drives

if TYPE_CHECKING:
    from seaid.log.log import Log
    from seaid.log.repair import Repair
    from seaid.robot import Robot


@dataclass(frozen=True)
class Processing:
    """How a motion was computed from a log; str() summarises it in one line.

    Attributes
    ----------
    logged_rate_hz, rate_hz : float
        Sampling rates of the log and of the uniform grid of the motion [Hz].
    resampled : bool
        Whether the time steps of the log were uneven.
    position_low_pass_hz : float
        Cutoff of the low pass of the positions [Hz].
    cutoff_selection : CutoffSelection
        Cutoff of regressor and torque, with the reason.
    transient_s : float
        Filter transient that is excluded at both ends [s].
    repairs : tuple of Repair
        Repairs made when the log was read, and samples that were excluded afterwards.
    sources : mapping {joint: {quantity: column, or entry of a description}}, or None
        What the log has of each joint.
    """

    logged_rate_hz: float
    rate_hz: float
    resampled: bool
    position_low_pass_hz: float
    cutoff_selection: CutoffSelection
    transient_s: float
    repairs: tuple[Repair, ...] = ()
    sources: Mapping[str, Mapping[str, Any]] | None = None

    @property
    def excluded(self) -> tuple[Repair, ...]:
        """The excluded samples: rest at the ends, frozen channels, holes in time."""
        return tuple(repair for repair in self.repairs if repair.kind in (HOLES, FROZEN, REST))

    def __str__(self) -> str:
        grid = f"{self.rate_hz:.4g} Hz"
        if self.resampled:
            grid = f"uneven steps resampled to {grid} (splines)"
        low_pass = f"positions below {self.position_low_pass_hz:.3g} Hz"
        if self.position_low_pass_hz >= 0.4 * self.rate_hz:
            low_pass = "positions unfiltered"
        faults = len(self.repairs) - len(self.excluded)
        repaired = f"; {counted(faults, 'kind')} of faults repaired" if faults else ""
        excluded = [f"; {part.kind}: {part.action}" for part in self.excluded if part.kind != HOLES]
        return (
            f"{grid}, {low_pass}; regressor and torque below {self.cutoff_selection}; "
            f"{self.transient_s:.2g} s excluded at both ends{''.join(excluded)}{repaired}"
        )


POSITION_BAND = 5.0
"""Cutoff of the positions over that of regressor and torque, so that these stay undistorted."""

FEWEST_PERIODS = 10.0
"""Shortest log in periods of the cutoff: the filter transients take two of them."""

SHORTEST_STRETCH = 4.0
"""Shortest stretch between two holes in periods of the cutoff: the transients take half of it."""


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Display):
    """The motion of both sides of n joints at T instants of a uniform grid.

    Attributes
    ----------
    time : array (T,)
        Time [s].
    joint_names : tuple of n str
        Names of the n joints, in the order of the columns.
    joint_position, joint_velocity, joint_acceleration : array (T, n)
        Joint side theta_L and its derivatives [rad, rad/s, rad/s^2], of prismatic joints [m, ...].
    motor_position, motor_velocity, motor_acceleration : array (T, n)
        Motor side theta_M and its derivatives [rad, rad/s, rad/s^2].
    motor_torque, joint_torque : array (T, n)
        Measured torques [N m], `joint_torque` of a prismatic joint [N]; not filtered, NaN for
        joints without the sensor.
    cutoff_hz : float
        Cutoff of the low pass of regressor and torque in a regression; inf: no filter.
    transient_s : float
        Filter transient that a regression excludes at both ends [s].
    fastest : array (2, n) or None
        Largest speeds of motors and joints in the whole log, if this motion is a part of it.
    motor_current, motor_voltage : array (T, n) or None
        Measured current [A] and voltage [V]; None: no such sensor.
    deflection, deflection_rate : array (T, n) or None
        Measured deflection of the springs and its derivative [rad, rad/s], of prismatic joints [m,
        m/s], NaN for joints without the sensor.
    motor_temperature : array (T, n) or None
        Temperature of the motors [degC], NaN for those without the sensor.
    command_slope : array (T, n) or None
        Rate [N m/s] of the motor torque by the command of position controllers, see `Controller`.
    command_delay_s : tuple of float
        Delay of the commands [s] in `motor_torque`, for each joint; empty without commands.
    motor_direction : array (T, n) or None
        Mean of sign(motor speed) over the interval about each sample, of drives with position
        commands, NaN for others; None: the sign at the samples.
    friction_known : array (T, n) or None
        1 where the direction of dry friction is known, and 0 where it is not, of stiff drives with
        position commands, NaN for others: factor of their equations before the low pass.
    gear_torque : array (T, n) or None
        Estimated torque of rigid drives on their load [N m or N], if their friction depends on it.
    base : None
        `MotionWithBase` has one, and is the type of motions of a robot that nothing holds.
    bridged : array (T,) or None
        Whether a sample was interpolated over a gap; None: none was.
    processing : Processing or None
        How the motion was computed from the log.
    start_s : float
        Time [s] of the log's first sample, from which warm-up counts.
    """

    time: Array
    joint_names: tuple[str, ...]
    joint_position: Array
    joint_velocity: Array
    joint_acceleration: Array
    motor_position: Array
    motor_velocity: Array
    motor_acceleration: Array
    motor_torque: Array
    joint_torque: Array
    cutoff_hz: float
    transient_s: float = 0.0
    fastest: Array | None = None
    motor_current: Array | None = None
    motor_voltage: Array | None = None
    deflection: Array | None = None
    deflection_rate: Array | None = None
    motor_temperature: Array | None = None
    command_slope: Array | None = None
    command_delay_s: tuple[float, ...] = ()
    motor_direction: Array | None = None
    friction_known: Array | None = None
    gear_torque: Array | None = None
    base: BaseMotion | None = None
    bridged: BoolArray | None = None
    processing: Processing | None = None
    start_s: float = 0.0

    def _in_short(self) -> str:
        return f"{sampled_text(self.time, self.joint_names)}, cutoff {self.cutoff_hz:.3g} Hz"

    @cached_property
    def joint_states(self) -> tuple[Array, Array, Array]:
        """Joint position, velocity and acceleration, each (T, n), as arguments of a regressor."""
        return self.joint_position, self.joint_velocity, self.joint_acceleration

    @cached_property
    def rate_hz(self) -> float:
        """Sampling rate of the grid."""
        return _rate_hz(self.time)

    @property
    def largest_speeds(self) -> Array:
        """Largest speeds (2, n) of motors [rad/s] and joints [rad/s or m/s]: those of the log."""
        if self.fastest is not None:
            return self.fastest
        return np.array(np.max(np.abs([self.motor_velocity, self.joint_velocity]), axis=1))

    @property
    def signals(self) -> dict[str, Array]:
        """The arrays of samples by their fields."""
        arrays = {name: x for name, x in vars(self).items() if isinstance(x, np.ndarray)}
        arrays.pop("fastest", None)
        return arrays

    def samples(self, part: slice) -> Motion:
        """Return some successive samples of the motion, as a part of the same log."""
        cut: dict[str, Any] = {name: values[part] for name, values in self.signals.items()}
        if self.base is not None:
            cut["base"] = self.base.samples(part)
        return replace(self, **cut, fastest=self.largest_speeds)


@dataclass(frozen=True, eq=False, repr=False)
class MotionWithBase(Motion):
    """The motion of a robot whose base moves, too.

    Attributes
    ----------
    base : BaseMotion
        The motion of the base, and its contacts.
    """

    base: BaseMotion = field(kw_only=True)


def decimated(motion: Motion, factor: int) -> Motion:
    """Return every `factor`-th sample of a motion, of its signals behind a low pass."""
    # Four fifths of the new Nyquist frequency. Speeds of the log stay, since standstill refers to
    # them and the low pass would lower them.
    highest_hz = 0.4 * motion.rate_hz / factor
    smooth: dict[str, Any] = {}
    for name, values in motion.signals.items():
        if values.ndim == 2 and len(known := np.flatnonzero(np.isfinite(values[0]))):
            smooth[name] = values.copy()
            smooth[name][:, known] = low_pass(values[:, known], motion.rate_hz, highest_hz)
    whole = replace(motion, **smooth, fastest=motion.largest_speeds)
    return whole.samples(slice(None, None, factor))


@checked(LogError)
def reconstruct_motion(robot: Robot, log: Log, cutoff_hz: float | None = None) -> Motion:
    """Return the motion of a log: resampled if needed, filtered and differentiated.

    Positions pass a zero-phase low pass at five times the cutoff, and a quintic spline gives their
    derivatives. Torques stay unfiltered, because a regression filters regressor and torque alike.
    The side of a rigid drive without an encoder is computed from the other side; joints with
    coupled drives are computed from all motors of the group. Rest at the ends of the log and
    samples of frozen channels are excluded.

    Parameters
    ----------
    robot : Robot
        The robot; its joints must be in the log.
    log : Log
        The log, without holes in time.
    cutoff_hz : float, optional
        Cutoff of the identification [Hz]; default: selected from the spectra of the positions.

    Returns
    -------
    Motion
        The motion; its `processing` states the steps and the reason for the cutoff.

    Raises
    ------
    LogError
        If the log does not fit the robot, is shorter than ten periods of the cutoff, or has a hole
        in time.

    Examples
    --------
    >>> motion = seaid.reconstruct_motion(robot, log, cutoff_hz=8.0)
    >>> motion.joint_acceleration.shape
    """
    # Without a given cutoff the shortest log is not known yet, so that all of the rest may be cut.
    motion = motion_of(robot, usable(log, _shortest_s(cutoff_hz)), cutoff_hz)
    return replace(motion, start_s=float(log.time[0]))


def motion_of(robot: Robot, log: Log, cutoff_hz: float | None = None) -> Motion:
    """Return the motion of all samples of a log. Raises LogError for a hole in time."""
    check_whole(log)
    cutoff = None if cutoff_hz is None else CutoffSelection(cutoff_hz, "as given")
    return _motion(robot, log, cutoff)


def _shortest_s(cutoff_hz: float | None) -> float:
    """Return the shortest log [s] for a cutoff, which is checked later."""
    return 1.001 * FEWEST_PERIODS / cutoff_hz if cutoff_hz and cutoff_hz > 0 else 0.0


def reconstruct_motions(
    robot: Robot, log: Log, cutoff_hz: float | None = None
) -> tuple[Motion, ...]:
    """Return the motion of each stretch of a log between its holes in time, with one cutoff.

    A log without a hole has one motion, see `reconstruct_motion`. `cutoff_hz` None: the smaller of
    two selections, from the longest stretch, which may be short, and from the whole log with
    straight lines over its holes, whose corners add power at high frequencies. Stretches shorter
    than four periods of the cutoff are excluded, as the repairs in the first motion's `processing`
    state. Raises LogError if holes and excluded stretches are more than half of the log.
    """
    start_s, log = float(log.time[0]), usable(log, _shortest_s(cutoff_hz))
    if not len(holes(log.time)):
        return (replace(motion_of(robot, log, cutoff_hz), start_s=start_s),)
    longest = max(stretches(log), key=lambda part: float(part.time[-1] - part.time[0]))
    if cutoff_hz is None:
        # `_sampled` of the whole log interpolates its holes linearly, see `interpolated`.
        choices = [_selected_cutoff(robot, *_sampled(robot, part)) for part in (log, longest)]
        cutoff = min(choices, key=lambda choice: choice.cutoff_hz)
    else:
        cutoff = CutoffSelection(cutoff_hz, "as given")
        # The mean rate of a log with holes would be too low for this check.
        check_cutoff(cutoff_hz, 1.0 / typical_step(log.time))
    # The factor 1.001 outweighs rounding: each stretch passes the check of its duration in
    # `_motion`.
    parts = stretches(log, 1.001 * SHORTEST_STRETCH / cutoff.cutoff_hz)
    _check_duration(cutoff.cutoff_hz, sum(float(part.time[-1] - part.time[0]) for part in parts))
    motions = [_motion(robot, part, cutoff, fewest=SHORTEST_STRETCH) for part in parts]
    fastest = np.max([motion.largest_speeds for motion in motions], axis=0)
    return tuple(replace(motion, fastest=fastest, start_s=start_s) for motion in motions)


_CORNERS = 3.0
"""Cutoff for an elastic drive with a dead zone, hysteresis or presliding, over that of the motion.

Their torque has corners where the teeth meet and where the motion turns back. At the cutoff of the
motion a contact of 4000 N m/rad comes out at a quarter of its stiffness, and the loop of a spring
5 % small; the width of presliding is off by twice its standard error, and by half of it at twice
the cutoff. That of a stiff drive is not (scripts/benchmarks/hysteresis.py)."""


_REVERSALS = 2.0
"""Cutoff for an elastic drive with dry friction and a rotor inertia to estimate, over that of the
motion, where noise permits it.

Where a motor stops at a reversal, its friction is not that by the sign of its speed until it moves
again. The low pass spreads this over the accelerations near the reversal, the largest ones: the
rotor inertia is 0.2 to 0.5 % too large, up to nine standard errors, and at twice the cutoff 0.05 %
(`scripts/benchmarks/unseen_plants.py`)."""


def _sampled(robot: Robot, log: Log) -> tuple[Array, dict[str, Array]]:
    """Return time and {sensor: samples} on a uniform grid, after checking the positions."""
    _check_joints(robot, log)
    time, signals = _uniform(log, robot.joint_names)
    _check_positions(robot, signals["joint_position"], signals["motor_position"])
    if robot.angle_ratios:
        q = signals["joint_position"]
        (signals["joint_position"],) = robot.drive_states(q)
        if "joint_torque" in signals:  # the same power: tau_phi phi' = tau_q q'
            signals["joint_torque"] /= robot.angle_ratios.rates(q)
    return time, signals


def _selected_cutoff(robot: Robot, time: Array, signals: dict[str, Array]) -> CutoffSelection:
    joint, motor = signals["joint_position"], signals["motor_position"]
    selection = select_cutoff(
        joint, motor, _rate_hz(time), robot.joint_names, of_commands=robot.has_controllers
    )
    corners = {*DEAD_ZONES, "dahl"}
    elastic = [(joint, drive) for joint, drive in robot.drives.items() if drive.is_elastic]
    sharp = [joint for joint, drive in elastic if corners & {*drive.spring, *drive.friction}]
    if sharp:
        # A corner of the torque against the deflection has power far above the motion's bandwidth.
        what, highest_hz = f"corners in the drive of {sharp[0]}", selection.rate_limit_hz
        return _widened(selection, _CORNERS, highest_hz, what)
    rotors = [joint for joint, x in elastic if is_dry(x) and x.motor_inertia_kg_m2 is None]
    if rotors:
        highest_hz = min(selection.noise_limit_hz, selection.rate_limit_hz)
        what = f"reversals of {rotors[0]}, whose rotor inertia is estimated"
        return _widened(selection, _REVERSALS, highest_hz, what)
    return selection


def _widened(
    selection: CutoffSelection, times: float, highest_hz: float, what: str
) -> CutoffSelection:
    """Return a selection with a cutoff that is larger by a factor, up to a limit."""
    cutoff_hz = min(times * selection.cutoff_hz, highest_hz)
    if cutoff_hz <= selection.cutoff_hz:
        return selection
    times = cutoff_hz / selection.cutoff_hz
    reason = f"{times:.2g} times that of the motion, for the {what}"
    return replace(selection, cutoff_hz=cutoff_hz, reason=reason)


def _motion(
    robot: Robot, log: Log, cutoff: CutoffSelection | None, fewest: float = FEWEST_PERIODS
) -> Motion:
    """Return the motion of a log without a hole; `cutoff` None: selected from the spectra."""
    time, signals = _sampled(robot, log)
    rate_hz = _rate_hz(time)
    joint, motor = signals["joint_position"], signals["motor_position"]
    cutoff = _selected_cutoff(robot, time, signals) if cutoff is None else cutoff
    cutoff_hz = float(cutoff.cutoff_hz)
    check_cutoff(cutoff_hz, rate_hz)
    _check_duration(cutoff_hz, float(time[-1] - time[0]), fewest)
    band_hz = POSITION_BAND * cutoff_hz
    # One filter for both sides: the deflection r_M theta_M / N - r_L theta_L of (3) is a small
    # difference of them, to which unequal filters would add a part of the motion itself.
    measured = low_pass(np.hstack([joint, motor]), rate_hz, band_hz)
    states = [_both_sides(robot, signal) for signal in spline_derivatives(time, measured)]
    kinds = ("position", "velocity", "acceleration")
    sides: dict[str, Any] = {}
    for kind, (of_joints, of_motors) in zip(kinds, states, strict=True):
        sides |= {f"joint_{kind}": of_joints, f"motor_{kind}": of_motors}
    others = _other_signals(robot, time, signals, band_hz)
    made = Motion if robot.base_is_held else MotionWithBase
    if not robot.base_is_held:
        q, v, a = (of_joints for of_joints, _ in states)
        others["base"] = base_motion(robot, _base_on(log, time), time, band_hz, (q, v, a))
    motion = made(
        **sides,
        **others,
        time=time,
        joint_names=robot.joint_names,
        # A regression passes torque and regressor through the same low pass, which then cancels.
        joint_torque=signals.get("joint_torque", np.full_like(joint, np.nan)),
        motor_current=signals.get("motor_current"),
        motor_voltage=signals.get("motor_voltage"),
        cutoff_hz=cutoff_hz,
        transient_s=1.0 / cutoff_hz,
        bridged=_bridged(log.time, time),
        processing=_processing(log, time, cutoff, band_hz),
    )
    if not robot.has_controllers:
        return motion
    ends = math.ceil(_ENDS * rate_hz / band_hz)
    return with_directions(robot, motion.samples(slice(ends, len(time) - ends)), {})


def _processing(log: Log, time: Array, cutoff: CutoffSelection, band_hz: float) -> Processing:
    """Return how the motion on a grid was computed from a log."""
    return Processing(
        logged_rate_hz=_rate_hz(log.time),
        rate_hz=_rate_hz(time),
        resampled=time is not log.time,
        position_low_pass_hz=band_hz,
        cutoff_selection=cutoff,
        transient_s=1.0 / float(cutoff.cutoff_hz),
        repairs=log.report,
        sources=log.sources(),
    )


def _other_signals(
    robot: Robot, time: Array, signals: dict[str, Array], band_hz: float
) -> dict[str, Any]:
    """Return motor torques, and of what is logged deflection, its rate, temperature, commands."""
    # Measured torques stay unfiltered; those of commands depend on the positions, and get their
    # filter.
    torque, slope = commanded_torque(robot, time, signals, band_hz)
    logged = [field for field in ("deflection", "motor_temperature") if field in signals]
    others: dict[str, Any] = {x: low_pass(signals[x], _rate_hz(time), band_hz) for x in logged}
    if "deflection" in others:
        others["deflection_rate"] = spline_derivatives(time, others["deflection"])[1]
    if robot.has_controllers:
        delays = (robot.drives[joint].command_delay_s or 0.0 for joint in robot.joint_names)
        others |= {"command_slope": slope, "command_delay_s": tuple(delays)}
    return {**others, "motor_torque": torque}


def with_directions(robot: Robot, motion: Motion, dry: Mapping[str, float]) -> Motion:
    """Return a motion with the directions of dry friction of drives with position commands.

    `dry` {joint: acceleration of dry friction alone} says at which reversals a joint may stick;
    without it a joint may at all of them.
    """
    direction, known = (np.full_like(motion.motor_velocity, np.nan) for _ in range(2))
    fastest, bands_hz = motion.largest_speeds[0], (motion.rate_hz, POSITION_BAND * motion.cutoff_hz)
    for index, joint in enumerate(robot.joint_names):
        drive, velocity = robot.drives[joint], motion.motor_velocity[:, index]
        if not is_commanded(drive):
            continue
        # inf: no reversal is steep enough to be passed; 0: all are passed, and none is late.
        acceleration = dry.get(joint, np.inf) if is_dry(drive) else 0.0
        direction[:, index] = mean_directions(velocity, *bands_hz, acceleration)
        if not drive.is_elastic and robot.base_is_held:
            known[:, index] = not is_dry(drive) or is_friction_known(
                velocity, float(fastest[index]), *bands_hz, acceleration, BLUR_OF_COMMANDS
            )
    return replace(motion, motor_direction=direction, friction_known=known)


_ENDS = 2.0
"""Periods of the low pass of the positions that are excluded at both ends of a commanded log.

There accelerations are those of the padding, and torques, of unfiltered positions, are not: errors
of 1 N m at a pendulum of 3 N m. The low pass of the rows would spread them beyond its transient."""


def _rate_hz(time: Array) -> float:
    return float((len(time) - 1) / (time[-1] - time[0]))


def _check_joints(robot: Robot, log: Log) -> None:
    """Raise LogError for a log without a joint of the robot."""
    missing = [joint for joint in robot.joint_names if joint not in log.joint_names]
    if missing:
        logged = ", ".join(log.joint_names)
        raise refusal("no_such_joint", missing=", ".join(missing), robot=robot.name, joints=logged)


def is_regular(time: Array) -> bool:
    """Return whether time steps are equal enough to be used without resampling."""
    return not np.any(irregular_steps(time))


def _uniform(log: Log, joints: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    """Return time and {sensor: samples} on a uniform grid at the log's mean rate."""
    signals = log.sensors(joints)
    if is_regular(log.time):
        return log.time, signals
    steps = np.diff(log.time)
    # Steps over holes do not count, so that a hole does not lower the rate of the grid.
    step = float(np.mean(steps[steps <= longest_bridge(log.time)]))
    count = math.floor((log.time[-1] - log.time[0]) / step + 1e-9) + 1
    # The last stamp may exceed the log's by rounding, and a spline would extrapolate there.
    time = np.minimum(log.time[0] + step * np.arange(count), log.time[-1])
    # The deflection rate multiplies the damping of the spring: the deflection is differentiated.
    how = {x: quantity_of(x).interpolation for x in signals} | {"deflection": "spline"}
    return time, {
        sensor: np.column_stack([interpolated(log.time, x, time, how[sensor]) for x in values.T])
        for sensor, values in signals.items()
    }


def _base_on(log: Log, time: Array) -> BaseLog | None:
    """Return the samples of the base at the times (T,) of the uniform grid."""
    if log.base is None or time is log.time:
        return log.base
    return log.base.each(lambda x: np.column_stack([np.interp(time, log.time, c) for c in x.T]))


def _bridged(logged: Array, time: Array) -> BoolArray | None:
    """Return the mask (T,) of samples of a uniform grid inside a gap of the log, None without."""
    if time is logged:
        return None
    inside = in_gap(logged, time, longest_step(logged))
    return inside if np.any(inside) else None


def _seen_stiff(robot: Robot, motor: Array) -> BoolArray:
    """Return the mask (n,) of stiff drives that have an encoder at the motor."""
    is_elastic = [robot.drives[joint].is_elastic for joint in robot.joint_names]
    return np.asarray(~np.isnan(motor[0]) & ~np.array(is_elastic))


def _check_positions(robot: Robot, joint: Array, motor: Array) -> None:
    """Raise LogError for joints whose motion the positions of both sides do not determine."""
    unseen, blind, stiff = np.isnan(joint[0]), np.isnan(motor[0]), _seen_stiff(robot, motor)
    names = np.array(robot.joint_names)
    for group in connected_groups(robot.transmission != 0):
        for index in group:
            if robot.drives[names[index]].is_elastic:
                _check_elastic(names[index], bool(unseen[index]) and len(group) == 1, blind[index])
        lacking, drives = (np.array(group)[mask[group]] for mask in (unseen, stiff))
        slopes = robot.transmission[np.ix_(drives, lacking)]
        rank = safely(np.linalg.matrix_rank, slopes, what=_TURNS) if slopes.size else 0
        if rank < len(lacking) == len(group) == 1:
            raise LogError(f"joint '{names[group[0]]}' has no position in the log")
        if rank < len(lacking):
            logged = listed(names[drives]) or "none"
            coupled = {"drives": listed(names[group]), "joints": listed(names[lacking])}
            raise refusal("coupled_without_position", logged=logged, **coupled)


_TURNS = "the positions of coupled joints"


def _check_elastic(joint: str, is_unseen: bool, is_blind: bool) -> None:
    """Raise LogError for an elastic joint without the position of the joint or of the motor."""
    if is_unseen and not is_blind:
        raise refusal("motor_side_alone", joint=joint)
    if is_blind:
        raise refusal("no_side", joint=joint, side="joint" if is_unseen else "motor")


def _both_sides(robot: Robot, signal: Array) -> tuple[Array, Array]:
    """Return joint and motor side, each (T, n), also of rigid drives that have no encoder there."""
    joint, motor = np.hsplit(signal.copy(), 2)
    C, ratio = robot.transmission, np.array([robot.drives[x].ratio for x in robot.joint_names])
    unseen, blind, drives = np.isnan(joint[0]), np.isnan(motor[0]), _seen_stiff(robot, motor)
    # theta_M / N = C q of the stiff drives, solved for the joints without an encoder.
    rest = motor[:, drives] / ratio[drives] - np.nan_to_num(joint) @ C[drives].T
    joint[:, unseen] = rest @ safely(np.linalg.pinv, C[np.ix_(drives, unseen)], what=_TURNS).T
    motor[:, blind] = (at_drives(C, joint) * ratio)[:, blind]
    return joint, motor


def check_cutoff(cutoff_hz: float, rate_hz: float) -> None:
    """Raise LogError for a cutoff that is not between zero and half of the sampling rate."""
    if not 0 < cutoff_hz < rate_hz / 2:
        raise refusal("cutoff_beyond_nyquist", nyquist_hz=rate_hz / 2, cutoff_hz=cutoff_hz)


def _check_duration(cutoff_hz: float, duration_s: float, fewest: float = FEWEST_PERIODS) -> None:
    if duration_s * cutoff_hz < fewest:
        raise refusal("too_short", duration_s=duration_s, fewest=fewest, cutoff_hz=cutoff_hz)
