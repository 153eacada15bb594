"""Delays of the channels of a log, and of position commands.

Those between channels have estimates with standard errors, by which a log is corrected.

A delay of commands is one for all drives of a bus, and only where the log determines it. With one
gain set a delay T adds (K_d + F_v) T to the rotor inertia at the joint and K_p T to the viscous
friction, to first order. What is left to tell them apart is often less than the errors of the
model; the delay is then as stated, and its uncertainty in all intervals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seaid._arrays import Array, IndexArray, safely
from seaid._files import toml_table
from seaid._progress import Display
from seaid.drives import DELAY_PARAMETER, NORMAL_95, Bus, Drive, buses_of, is_stated
from seaid.errors import IdentificationError, LogError, checked, unknown_name
from seaid.estimation import Estimate, FittedRows, newey_west, scaled_svd
from seaid.log import (
    Log,
    LogField,
    Motion,
    Repair,
    column_name,
    in_band,
    on_time,
    reconstruct_motions,
    row_samples,
    standstill,
)
from seaid.regressor import (
    Regression,
    actuator_columns,
    motor_regressor,
    regressor_at_drives,
    sensed_torque,
    signals,
)
from seaid.robot import Robot

# Delays between the channels of a log

SIGNIFICANT = 4.0
"""A delay above this many standard errors is significant."""

_WIDTHS = (0.02, 0.1, 0.3)
"""Widths of free friction, as shares of the largest speed."""

_BLOCKS = 6
"""Blocks of a log, whose delays must agree within their errors."""

_INDEPENDENT = 0.5
"""Share of independent rows: two per period of the cutoff, of four."""

_LEAST_EXPLAINED = 0.5
"""A delay is determined only if its relation explains this share of the channel's power."""

_TRIALS = 41
_WIDER = 2.0
_WHAT = "the delay of a channel"


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
    >>> delays = seaid.estimate_delays(robot, log)
    >>> log = seaid.correct_delays(log, delays)
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
    >>> seaid.correct_delays(log, seaid.estimate_delays(robot, log)).report
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
        drive = robot.drives[joint]
        by_name = signals(robot, motion, index)
        nothing = np.zeros(len(motion.time))
        moving = rows[~standstill(motion, index)[rows]]
        motor = by_name["tau_M"]
        force = sensed_torque(robot, motion, index)
        friction = _free_friction(motion.motor_velocity[:, index], drive.is_elastic)
        if np.all(np.isfinite(motor)):
            if drive.is_elastic:
                regressor, zeta, columns = actuator_columns(robot, motion, joint)
                against = "its motion and its spring"
            else:
                regressor = motor_regressor(robot, joint)
                zeta, columns = regressor.evaluate(by_name)
                bodies = regressor_at_drives(robot, *motion.joint_states)[:, index]
                columns, against = np.column_stack([columns, bodies]), "the motion"
            columns = np.column_stack([columns, friction])
            rest = regressor.evaluate(by_name | {"tau_M": nothing})[0]
            # zeta = tau_M + rest, with rest at tau_M = 0: the torque alone is the channel.
            yield _Relation(joint, "motor_torque", against, zeta - rest, rest, columns, moving)
        if np.all(np.isfinite(force)):
            if drive.is_elastic:
                # (4b): a constant and k times the deflection.
                stretch = drive.motor_radius / drive.ratio * motion.motor_position[:, index]
                stretch = stretch - drive.load_radius * by_name["theta_L"]
                columns, against = np.column_stack([nothing + 1, stretch]), "its deflection"
            else:
                drive_columns = motor_regressor(robot, joint).evaluate(by_name)[1]
                bodies = regressor_at_drives(robot, *motion.joint_states)[:, index]
                columns, against = np.column_stack([drive_columns, bodies, friction]), "the motion"
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


@dataclass(frozen=True, eq=False)
class _Shifted:
    """A channel (R,) at `time` (R,) [s], with a spline of the rest and columns to be shifted."""

    time: Array
    channel: Array
    spline: Callable[..., Array]

    def fit(self, delay: float) -> tuple[Array, Array]:
        """Return an orthonormal basis of the shifted columns, and the residual of the channel."""
        shifted = self.spline(self.time - delay)
        basis = scaled_svd(shifted[:, 1:], _WHAT, LogError).span()
        return basis, _residual(basis, self.channel + shifted[:, 0])

    def cost(self, delay: float) -> float:
        """Return the sum of squared residuals for a delay."""
        return float(np.sum(self.fit(delay)[1] ** 2))

    def standard_error(self, delay: float) -> float:
        """Return the standard error of the best delay, infinite if it is not determined.

        It has autocorrelation, the parameters that were fitted (two rows per period of the cutoff
        are independent), and the disagreement of blocks.
        """
        basis, residual = self.fit(delay)
        shifted, rates = self.spline(self.time - delay), self.spline(self.time - delay, 1)
        svd = scaled_svd(shifted[:, 1:], _WHAT, LogError)
        target = self.channel + shifted[:, 0]
        # r = channel + rest(t - delay) - columns(t - delay) theta, so that
        # dr/d delay = (I - Q Q^T)(columns' theta - rest'), theta at its best value (Kaufman 1975).
        slope = _residual(basis, rates[:, 1:] @ svd.solve(target) - rates[:, 0])
        curvature, power = float(slope @ slope), float(np.sum((target - np.mean(target)) ** 2))
        free = 1.0 - basis.shape[1] / (_INDEPENDENT * len(target))
        fall = self.cost(0.0) - self.cost(delay)
        unexplained = float(residual @ residual) / max(power, 1e-300)
        if curvature <= 0 or free <= 0 or fall <= 0 or unexplained > 1 - _LEAST_EXPLAINED:
            return math.inf
        # Scores of the delay; the part that a change of the delay explains is removed.
        terms = slope * (residual - slope * float(slope @ residual) / curvature)
        scores = newey_west(terms[:, None], self.time, np.zeros(len(self.time)))
        # sums over B blocks have together that variance, if they are independent (Birge 1932)
        blocks = sum(float(np.sum(block)) ** 2 for block in np.array_split(terms, _BLOCKS))
        variance = max(float(scores[0, 0]), blocks) / free
        # a minimum of the noise has curvature too: the fall of the cost from no delay, which is
        # delay^2 curvature if the cost is quadratic, must confirm it
        confirmed = max(1.0, abs(delay) * math.sqrt(curvature / fall))
        return confirmed * math.sqrt(variance) / curvature


def _shifted(motion: Motion, relation: _Relation, largest_s: float) -> _Shifted:
    """Return the rows of a relation below the cutoff, with the side to be shifted as a spline.

    The channel is kept and the other side is shifted, so that the noise of the channel is the same
    for all trial delays and does not count as excitation.
    """
    from scipy.interpolate import make_interp_spline

    time = motion.time
    band = in_band(motion, np.column_stack([relation.values, relation.rest, relation.columns]))
    rows = relation.rows
    rows = rows[(time[rows] > time[0] + largest_s) & (time[rows] < time[-1] - largest_s)]
    sizes = np.linalg.norm(band[:, 2:], axis=0)
    model = np.column_stack([band[:, 1], band[:, 2:][:, sizes > 0] / sizes[sizes > 0]])
    return _Shifted(time[rows], band[rows, 0], make_interp_spline(time, model, k=5))


def _fitted(motion: Motion, relation: _Relation, largest_s: float) -> Delay:
    """Return the delay that minimises the residual of a relation below the cutoff."""
    from scipy.optimize import minimize_scalar

    shifted = _shifted(motion, relation, largest_s)
    trials = np.linspace(-largest_s, largest_s, _TRIALS)
    best = int(np.argmin([shifted.cost(trial) for trial in trials]))
    unknown = Delay(relation.joint, relation.channel, relation.against, 0.0, math.inf)
    # A minimum at the end of the search is no minimum: the delay may be anywhere beyond.
    if best in (0, _TRIALS - 1):
        return unknown
    ends = (trials[best - 1], trials[best + 1])
    options = {"xatol": 1e-7}
    delay = float(minimize_scalar(shifted.cost, bounds=ends, method="bounded", options=options).x)
    error = shifted.standard_error(delay)
    return replace(unknown, delay_s=delay, standard_error_s=error) if error < math.inf else unknown


def _residual(basis: Array, signal: Array) -> Array:
    """Return the residual of a signal (R,) after projection on an orthonormal basis (R, p)."""
    return np.asarray(signal - basis @ (basis.T @ signal))


# Delays of position commands

MOST_DELAY_ROUNDS = 3
"""Most repetitions with commands delayed by the estimate: the error of one is of its square."""

_DELAY_S = 2e-4
"""Change of a delay [s] below which its linearisation has converged."""

_ROUNDING_S = 1e-7
"""Difference [s] of the delays of one bus by rounding; drives stay on one by equal delays."""

_SCALE = 0.01
"""Relative change of the scale of gains below which the slope by the delay has converged."""

LARGEST_DELAY_S = 0.25
"""Largest delay of a command [s] for which the linearisation is tried."""

_FREE = 1e-8
"""Part of a variance that stays to a direction with a fixed value, so that matrices have roots."""


@dataclass(frozen=True, eq=False)
class _Constraints:
    """Constraints A x = b of parameters (p,), with standard deviations `stds` (c,) of the b.

    x of least squares with a covariance W (p, p) becomes P x + G b, with G = W A^T (A W A^T)^+ and
    P = 1 - G A.
    """

    A: Array
    b: Array
    stds: Array

    @classmethod
    def of(cls, p: int, buses: Sequence[Bus], stated: Sequence[Bus] = ()) -> _Constraints:
        """Return one delay for each bus, which is the nominal one of those that are `stated`."""
        unit = np.eye(p)
        equal = [unit[bus.places[0]] - unit[other] for bus in buses for other in bus.places[1:]]
        rows = [*equal, *(unit[bus.places[0]] for bus in stated)]
        b, stds = np.zeros((2, len(rows)))
        b[len(equal) :] = [bus.nominal_s for bus in stated]
        stds[len(equal) :] = [bus.std_s for bus in stated]
        return cls(np.reshape(rows, (-1, p)), b, stds)

    def solution(self, white: Array) -> tuple[Array, Array]:
        """Return P (p, p) and G (p, c) for a covariance (p, p)."""
        A = self.A
        inverse = safely(np.linalg.pinv, A @ white @ A.T, what="the delays of the commands")
        G = white @ A.T @ inverse
        return np.eye(len(white)) - G @ A, G

    def applied(self, estimate: Estimate, white: Array) -> Estimate:
        """Return an estimate under the constraints."""
        P, G = self.solution(white)
        of_data, spread = P @ estimate.covariance @ P.T, G * self.stds
        covariance = of_data + spread @ spread.T
        freedom, errors = estimate.degrees_of_freedom, estimate.white_standard_errors
        if freedom is not None:
            # Welch and Satterthwaite: the stated part of the variance has no degrees of freedom.
            with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
                freedom = freedom * (np.diag(covariance) / np.diag(of_data)) ** 2
            freedom = np.where(np.isfinite(freedom), freedom, np.inf)
        if errors is not None:
            ratio = np.diag(P @ white @ P.T) / np.maximum(np.diag(white), 1e-300)
            errors = errors * np.sqrt(np.maximum(ratio, 0.0))
        return replace(
            estimate,
            values=P @ estimate.values + G @ self.b,
            covariance=covariance,
            degrees_of_freedom=freedom,
            white_standard_errors=errors,
        )


def with_shared_delays(
    drives: Mapping[str, Drive], fitted: FittedRows, joint: str = ""
) -> FittedRows:
    """Return a fit with one delay per bus, the stated one where the rows do not determine it."""
    buses = buses_of(drives, fitted.estimate.names, joint)
    if not buses:
        return fitted
    white, p = fitted.white_covariance, len(fitted.estimate.names)
    constraints = _Constraints.of(p, buses)
    estimate = constraints.applied(fitted.estimate, white)
    P, _ = constraints.solution(white)
    stated = _undetermined(buses, estimate, P @ white @ P.T, fitted.qr_factor.count)
    if stated:
        constraints = _Constraints.of(p, buses, stated)
        estimate = constraints.applied(fitted.estimate, white)
    values = estimate.values.copy()
    for bus in buses:  # the same but for rounding
        values[list(bus.places)] = bus.nominal_s if bus in stated else values[bus.places[0]]
    estimate = replace(estimate, values=values)
    return replace(fitted, estimate=estimate, constraint=constraints.solution(white)[0])


def _undetermined(buses: Sequence[Bus], estimate: Estimate, white: Array, count: int) -> list[Bus]:
    """Return the buses whose delay `count` rows do not determine, with a covariance (p, p).

    They do not if the effect of the stated range, beyond that of all other parameters, is less than
    the residual: errors of the model may then hide it. An estimate farther beyond that range than
    such errors explain is one to linearise at.
    """
    free, stated = sum(len(bus.places) for bus in buses), []
    for bus in buses:
        place, range_s = bus.places[0], NORMAL_95 * bus.std_s
        # |column| of the delay, orthogonal to all others, is 1 / error for a residual of 1.
        as_residual = np.sqrt(white[place, place] * count * len(bus.places) / free)
        is_far = abs(estimate.values[place] - bus.nominal_s) > range_s + as_residual
        if as_residual > range_s and not is_far:
            stated.append(bus)
    return stated


def with_fixed_delays(
    drives: Mapping[str, Drive], estimate: Estimate, white: Array, joint: str = ""
) -> tuple[Estimate, Array]:
    """Return an estimate and its covariance `white` (p, p) for delays that stay where they are.

    A physically consistent robot is looked for near the estimate. Delays of one bus stay equal
    then, and those that are as stated keep their value: both have a distance from no other value.
    """
    buses = buses_of(drives, estimate.names, joint)
    exact = [bus for bus in buses if is_stated(estimate.standard_errors[bus.places[0]], bus.std_s)]
    constraints = _Constraints.of(len(white), buses, exact)
    if not len(constraints.A):
        return estimate, white
    P, _ = constraints.solution(white)
    stated = [place for bus in exact for place in bus.places]
    covariance, across = estimate.covariance, estimate.covariance[:, stated]
    if stated:
        # C - C_xs C_ss^-1 C_sx, the covariance of the others if the stated delays s are exact.
        inner = safely(np.linalg.pinv, across[stated], what="the delays of the commands")
        covariance = covariance - across @ inner @ across.T
    return replace(estimate, covariance=covariance), P @ white @ P.T + _FREE * white


def with_merged_delays(
    drives: Mapping[str, Drive], rows: Regression, estimate: Estimate, joint: str = ""
) -> Regression:
    """Return rows with one column for the delay of a bus, themselves without such columns.

    Their fit is the constrained one of `with_shared_delays`. Delays that are as stated in an
    estimate have no column: their torque is known.
    """
    buses = buses_of(drives, rows.names, joint)
    if not buses:
        return rows
    H, y = rows.H.copy(), rows.y.copy()
    gone: list[int] = []
    for bus in buses:
        first, *others = bus.places
        # One delay for all: the column of their common value is the sum.
        H[:, first] = H[:, list(bus.places)].sum(axis=1)
        gone += others
        if is_stated(estimate.standard_errors[first], bus.std_s):
            y -= bus.nominal_s * H[:, first]
            gone.append(first)
    kept = np.setdiff1d(np.arange(len(rows.names)), gone)
    names, units = (tuple(texts[place] for place in kept) for texts in (rows.names, rows.units))
    return replace(rows, names=names, units=units, H=H[:, kept], y=y)


def with_estimated_delays(robot: Robot, identified: Robot) -> Robot:
    """Return the robot with the delays of an estimate as nominal ones; itself if they converged.

    Raises IdentificationError for a delay that is far beyond the range of the linearisation.
    """
    drives: dict[str, Drive] = {}
    of_buses: dict[float, list[float]] = {}
    for joint, drive in robot.drives.items():
        if drive.controller is None or DELAY_PARAMETER in drive.known:
            continue
        near = drive.command_delay_s or 0.0
        scaled, delay = _estimated_delay(joint, drive, identified.drives[joint])
        seen = of_buses.setdefault(near, [])
        delay = next((known for known in seen if abs(known - delay) < _ROUNDING_S), delay)
        seen.append(delay)
        if abs(delay - near) > _DELAY_S:
            scaled = replace(scaled, command_delay_s=delay)
        if scaled is not drive:
            drives[joint] = scaled
    return robot.with_drives(drives) if drives else robot


def _estimated_delay(joint: str, drive: Drive, identified: Drive) -> tuple[Drive, float]:
    """Return a drive with the estimated scale of its gains, if that moved, and its delay [s]."""
    delay, near = identified.values[DELAY_PARAMETER], drive.command_delay_s or 0.0
    if drive.is_up_to_scale and "gain_scale" not in drive.known:
        # The slope by the delay was that of the nominal scale.
        scale, before = (max(x.scale_of_gains, 1e-9) for x in (identified, drive))
        delay = near + (delay - near) * before / scale
        if abs(scale / before - 1) > _SCALE:
            drive = drive.with_values({"gain_scale": scale})
    if abs(delay) > LARGEST_DELAY_S:
        raise IdentificationError(
            f"the command of {joint} seems delayed by {delay * 1e3:.3g} ms, more than "
            f"{LARGEST_DELAY_S * 1e3:g} ms either way, where the search ends: check the gains "
            "of its controller, and the signs and clocks of commands and positions; commands "
            "that act so late are shifted in the description of the log:\n"
            f"{toml_table('joints', joint)}\n"
            f'position_command = {{ column = "...", delay_s = {-delay:.3g} }}'
        )
    return drive, delay
