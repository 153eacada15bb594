"""Delays between the channels of a log: estimates with standard errors, and their correction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seaid._arrays import Array, IndexArray
from seaid._progress import Display
from seaid.drives.drives import deflection
from seaid.errors import ExcitationError, IdentificationError, LogError, checked, unknown_name
from seaid.estimation.least_squares import ordinary
from seaid.estimation.nonlinear_least_squares import separable_least_squares
from seaid.estimation.qr_factor import residual_of, scaled_svd
from seaid.log import Log, Motion, Repair, in_band, row_samples, standstill
from seaid.log.channels import LogField, column_name
from seaid.log.motion import reconstruct_motions
from seaid.log.repair.channels import on_time
from seaid.regressor import Regression, motor_regressor
from seaid.regressor.base import regressor_at_drives
from seaid.regressor.regression import sensed_torque, signals
from seaid.robot import Robot

SIGNIFICANT = 4.0
"""A delay above this many standard errors is significant."""

_WIDTHS = (0.02, 0.1, 0.3)
"""Widths of free friction, as shares of the largest speed."""

_LEAST_EXPLAINED = 0.5
"""A delay is determined only if its relation explains this share of the channel's power."""

_TRIALS = 41
_WIDER = 2.0
_AT_END = 0.95
"""Part of the range of a search beyond which a minimum is that of its end."""


@dataclass(frozen=True, repr=False)
class Delay(Display):
    """Delay of a channel of a joint relative to other channels.

    Attributes
    ----------
    joint, channel : str
        Joint, and field of Log of the delayed channel.
    against : str
        The channels with which it was compared.
    delay_s : float
        Delay [s]: a positive value means that samples show the state `delay_s` before their time.
    standard_error_s : float
        Standard error [s] with autocorrelation; infinite if the motion does not determine the
        delay.
    """

    joint: str
    channel: LogField
    against: str
    delay_s: float
    standard_error_s: float

    @property
    def is_significant(self) -> bool:
        """Whether the delay is larger than four standard errors."""
        return abs(self.delay_s) > SIGNIFICANT * self.standard_error_s

    def __str__(self) -> str:
        if not math.isfinite(self.standard_error_s):
            return (
                f"{self.joint}: delay of its {self.channel} against {self.against} not determined"
            )
        late = "late" if self.delay_s > 0 else "early"
        word = "" if self.is_significant else ", not significant"
        return (
            f"{self.joint}: its {self.channel} is {1e3 * abs(self.delay_s):.3g} ms {late} against "
            f"{self.against} (standard error {1e3 * self.standard_error_s:.2g} ms{word})"
        )


@dataclass(frozen=True, eq=False)
class _Relation:
    """A linear relation without a delay: channel (T,) + rest (T,) = columns (T, p) @ parameters."""

    joint: str
    channel: LogField
    against: str
    values: Array
    rest: Array
    columns: Array
    rows: IndexArray


@checked(LogError)
def estimate_delays(
    robot: Robot, log: Log, *, largest_s: float = 0.03, cutoff_hz: float | None = None
) -> tuple[Delay, ...]:
    """Estimate the delay of each channel that is redundant with other channels of its joint.

    The motor position of a stiff drive is compared with the joint position; that of an elastic
    drive with the measured spring torque or else with the load on the spring. Then, with
    significant delays of positions corrected, torques: the motor torque of an elastic joint with
    (10), that of a stiff one with (8), and a measured spring torque with the deflection. Each delay
    minimises the residual of that linear model below the cutoff (variable projection, Golub and
    Pereyra 1973). Torques may have friction of other widths than the model. A relation that
    explains less than half of its channel determines no delay. Viscous friction on the load side of
    an elastic joint, which the model lacks, looks like a late motor position. Of a log with gaps in
    time the longest stretch is used.

    Parameters
    ----------
    robot : Robot
        The robot model.
    log : Log
        The log.
    largest_s : float
        Largest delay of the search [s], below a tenth of the log.
    cutoff_hz : float, optional
        Cutoff of the low pass. Default: twice that of an identification, since fast motion
        determines delays best.

    Returns
    -------
    tuple of Delay
        One per pair of redundant channels.

    Raises
    ------
    LogError
        For a log that does not fit the robot, and for a wrong `largest_s`.

    Examples
    --------
    >>> delays = seaid.identification.estimate_delays(robot, log)
    >>> log = seaid.identification.correct_delays(log, delays)
    """
    motion = _longest_motion(robot, log, cutoff_hz)
    if cutoff_hz is None:
        wider = min(_WIDER * motion.cutoff_hz, motion.rate_hz / 8)
        motion = _longest_motion(robot, log, wider)
    if not 0 < largest_s < (motion.time[-1] - motion.time[0]) / 10:
        raise LogError(
            f"largest_s must be above 0 and below a tenth of the log, found {largest_s:g} s",
            "largest_s",
        )
    positions = [_fitted(motion, relation, largest_s) for relation in _of_positions(robot, motion)]
    if any(delay.is_significant for delay in positions):
        motion = _longest_motion(robot, correct_delays(log, positions), motion.cutoff_hz)
    torques = [_fitted(motion, relation, largest_s) for relation in _of_torques(robot, motion)]
    return tuple(positions + torques)


def _longest_motion(robot: Robot, log: Log, cutoff_hz: float | None) -> Motion:
    return max(reconstruct_motions(robot, log, cutoff_hz), key=lambda motion: len(motion.time))


@checked(LogError)
def correct_delays(log: Log, delays: Sequence[Delay]) -> Log:
    """Return the log with every significant delay corrected.

    Parameters
    ----------
    log : Log
        The log.
    delays : sequence of Delay
        Delays of `estimate_delays`; those that are not significant are ignored.

    Returns
    -------
    Log
        Its channels are interpolated at their true times, as by a repair, and its `report` lists
        the corrections; the ends that not all channels cover are cut.

    Raises
    ------
    LogError
        For a joint or channel that the log lacks.

    Examples
    --------
    >>> delays = seaid.identification.estimate_delays(robot, log)
    >>> seaid.identification.correct_delays(log, delays).report
    """
    fields, columns = log.sensors(), log.columns()
    for delay in delays:
        if delay.joint not in log.joint_names:
            raise LogError(unknown_name("joint of the log", delay.joint, log.joint_names))
        if delay.channel not in fields or _column(log, delay) not in columns:
            raise LogError(unknown_name("channel", delay.channel, fields))
    shifts = {_column(log, delay): delay for delay in delays if delay.is_significant}
    delays_s = {name: delay.delay_s for name, delay in shifts.items()}
    kept, moved = on_time(log.time, columns, delays_s)
    corrected: dict[str, Any] = {field: values[kept].copy() for field, values in fields.items()}
    report, start = list(log.report), float(log.time[0])
    for name, delay in shifts.items():
        corrected[delay.channel][:, log.joint_names.index(delay.joint)] = moved[name]
        report.append(Repair(name, "delay", 1, start, f"{delay}; corrected"))
    return replace(log, time=log.time[kept], report=tuple(report), **corrected)


def _column(log: Log, delay: Delay) -> str:
    """Return the name of the delayed column in a file."""
    is_prismatic = log.is_prismatic[log.joint_names.index(delay.joint)]
    return column_name(delay.joint, is_prismatic, delay.channel)


def _of_positions(robot: Robot, motion: Motion) -> Iterator[_Relation]:
    rows = row_samples(motion)
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        motor, position = motion.motor_position[:, index], signals(robot, motion, index)["theta_L"]
        ones = np.ones((len(motor), 1))
        if not drive.is_elastic:
            if np.ptp(motor - drive.ratio * position) > 1e-9 * np.ptp(motor):  # both measured
                columns = np.column_stack([ones, position])
                against, nothing = "joint position", np.zeros(len(motor))
                yield _Relation(joint, "motor_position", against, motor, nothing, columns, rows)
            continue
        force = sensed_torque(robot, motion, index)
        if np.all(np.isfinite(force)):
            columns, against = np.column_stack([ones, force]), "joint torque"
        else:
            bodies = regressor_at_drives(robot, *motion.joint_states)[:, index]
            columns, against = np.column_stack([ones, bodies]), "the load on its spring"
        values = drive.motor_radius / drive.ratio * motor
        # r_M/N theta_M - r_L theta_L is the deflection d = F / k, linear in the torque on the load.
        rest = -drive.load_radius * position
        yield _Relation(joint, "motor_position", against, values, rest, columns, rows)


def _of_torques(robot: Robot, motion: Motion) -> Iterator[_Relation]:
    rows = row_samples(motion)
    for index, joint in enumerate(robot.joint_names):
        drive, by_name = robot.drives[joint], signals(robot, motion, index)
        moving, nothing = rows[~standstill(motion, index)[rows]], np.zeros(len(motion.time))
        force, against = sensed_torque(robot, motion, index), "the motion"
        has_motor, has_sensor = np.all(np.isfinite([by_name["tau_M"], force]), axis=1)
        regressor = motor_regressor(robot, joint)
        if has_motor or (has_sensor and not drive.is_elastic):
            zeta, columns = regressor.evaluate(by_name)
            if not drive.is_elastic:
                bodies = regressor_at_drives(robot, *motion.joint_states)[:, index]
                columns = np.column_stack([columns, bodies])
            friction = _free_friction(motion.motor_velocity[:, index], drive.is_elastic)
            columns = np.column_stack([columns, friction])
        if has_motor:
            known = "its motion and its spring" if drive.is_elastic else against
            # zeta = tau_M + rest, with rest at tau_M = 0: the torque alone is the channel.
            rest = regressor.evaluate(by_name | {"tau_M": nothing})[0]
            yield _Relation(joint, "motor_torque", known, zeta - rest, rest, columns, moving)
        if has_sensor:
            if drive.is_elastic:
                # (4b): a constant and k times the deflection.
                d = deflection(drive, motion.motor_position[:, index], by_name["theta_L"])
                columns, against = np.column_stack([nothing + 1, d]), "its deflection"
            yield _Relation(joint, "joint_torque", against, force, nothing, columns, moving)


def _free_friction(speed: Array, is_elastic: bool) -> Array:
    """Return friction (T, any) of several widths, and quadratic, for friction that a model lacks.

    A stiff joint gets one width only: more columns double its false delays, because its bodies have
    most columns already (six logs of the leg).
    """
    fastest = float(np.max(np.abs(speed))) or 1.0
    widths = _WIDTHS if is_elastic else _WIDTHS[1:2]
    columns = [np.tanh(speed / (width * fastest)) for width in widths]
    return np.column_stack([*columns, *([speed * np.abs(speed)] if is_elastic else [])])


def _fitted(motion: Motion, relation: _Relation, largest_s: float) -> Delay:
    """Return the delay that minimises the residual of a relation below the cutoff.

    The channel is kept and the other side is shifted, so that the noise of the channel is the same
    for all trial delays and does not count as excitation.
    """
    from scipy.interpolate import make_interp_spline

    time, rows = motion.time, relation.rows
    sides = in_band(motion, np.column_stack([relation.values, relation.rest, relation.columns]))
    other_side = make_interp_spline(time, sides[:, 1:], k=5)
    rows = rows[(time[rows] > time[0] + largest_s) & (time[rows] < time[-1] - largest_s)]

    def shifted(delay: Array) -> tuple[Array, Array]:
        at_delay = other_side(time[rows] - delay)
        return sides[rows, 0] + at_delay[:, 0], at_delay[:, 1:]

    def slopes(delay: Array, theta: Array) -> Array:
        rates = other_side(time[rows] - delay, 1)
        return np.asarray(rates[:, :1] - rates[:, 1:] @ theta[:, None])

    trials = [np.array([x]) for x in np.linspace(-largest_s, largest_s, _TRIALS)]
    start = min(trials, key=lambda trial: float(np.linalg.norm(residual_of(*shifted(trial)))))
    fit = separable_least_squares(shifted, slopes, [start], trials[0], trials[-1])
    delay, slope = float(fit.nonlinear[0]), slopes(fit.nonlinear, fit.linear)
    y, columns = shifted(fit.nonlinear)
    error = _standard_error(y, columns, slope, time[rows])
    left, curvature = fit.residual**2, float(np.sum(residual_of(slope[:, 0], columns) ** 2))
    fall = float(np.sum(residual_of(*shifted(np.zeros(1))) ** 2)) - left
    is_explained = left < (1 - _LEAST_EXPLAINED) * float(np.sum((y - np.mean(y)) ** 2))
    # A minimum at the end of the search is no minimum: the delay may be anywhere beyond.
    if fall <= 0 or not is_explained or abs(delay) > _AT_END * largest_s or error == math.inf:
        return Delay(relation.joint, relation.channel, relation.against, 0.0, math.inf)
    # A minimum of the noise has curvature too: the fall of the cost from no delay, which is
    # delay^2 curvature if the cost is quadratic, must confirm it.
    confirmed = max(1.0, abs(delay) * math.sqrt(curvature / fall))
    return Delay(relation.joint, relation.channel, relation.against, delay, confirmed * error)


def _standard_error(y: Array, columns: Array, slope: Array, time: Array) -> float:
    """Return the standard error of a delay with the columns (R, p) and its slope (R, 1) there.

    The delay is a parameter of the relation, linearised at its best value. It is infinite where
    the columns explain the slope.
    """
    # The columns may depend on each other, those of all bodies do: only their span counts.
    H = np.column_stack([scaled_svd(columns, "the delay of a channel", LogError).span(), slope])
    names = map(str, range(H.shape[1]))
    rows = Regression.of_equation(names, H.shape[1] * ("",), H, y, time)
    try:
        return float(ordinary(rows).standard_errors[-1])
    except (ExcitationError, IdentificationError):
        return math.inf
