"""Delays between channels that should agree: how late one is, how sure that is; correction."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seaid._arrays import Array, IndexArray, safely
from seaid.drives import SeriesElasticDrive
from seaid.errors import LogError, unknown_name
from seaid.estimation import newey_west
from seaid.log import (
    Log,
    Motion,
    Repair,
    column_names,
    in_band,
    interpolated,
    reconstruct_motions,
    row_samples,
    standstill,
)
from seaid.regressor import (
    actuator_columns,
    motor_regressor,
    regressor_at_drives,
    sensed_torque,
    signals,
)
from seaid.robot import Robot

SIGNIFICANT = 4.0
"""A delay of so many standard errors is taken to be one."""

_TRIALS = 41
_WIDER = 2.0
_RANK = 1e-10


@dataclass(frozen=True)
class Delay:
    """How late the samples of a `channel` (field of Log) of a joint are, `against` others, in s.

    More than zero: a sample shows what was `delay_s` before its stamp. `standard_error_s` counts
    the autocorrelation of what is left; it is infinite where the motion tells nothing.
    """

    joint: str
    channel: str
    against: str
    delay_s: float
    standard_error_s: float

    @property
    def is_significant(self) -> bool:
        """Tell whether it is more than four standard errors from none."""
        return abs(self.delay_s) > SIGNIFICANT * self.standard_error_s

    def __str__(self) -> str:
        if not math.isfinite(self.standard_error_s):
            return f"{self.joint}: delay of its {self.channel} against {self.against} not told"
        late = "late" if self.delay_s > 0 else "early"
        word = "" if self.is_significant else ", not significant"
        return (
            f"{self.joint}: its {self.channel} is {1e3 * abs(self.delay_s):.3g} ms {late} against "
            f"{self.against} (standard error {1e3 * self.standard_error_s:.2g} ms{word})"
        )


@dataclass(frozen=True, eq=False)
class _Agreement:
    """What agrees without a delay: channel (T,) + rest (T,) = columns (T, p) @ anything."""

    joint: str
    channel: str
    against: str
    values: Array
    rest: Array
    columns: Array
    rows: IndexArray


def estimate_delays(
    robot: Robot, log: Log, *, largest_s: float = 0.03, cutoff_hz: float | None = None
) -> tuple[Delay, ...]:
    """Return the delay of each channel that others of its joint can tell.

    The motor position of a stiff drive against the joint position; that of an elastic one against
    the spring's torque where it was measured, else against the load that bends the spring. Then,
    with these taken out where significant, torques: the motor's of an elastic joint against (10),
    the torque of a stiff one against (8), a spring's torque against the deflection. The delay is
    the one at which least is left of that linear model in the pass band (variable projection, Golub
    and Pereyra 1973), within +-`largest_s`. `cutoff_hz` None: twice that of an identification,
    since what is fast tells delays. What the model lacks is not told from a delay: a viscous
    friction on the load side of an elastic joint looks like a late motor position. A log with holes
    in time is asked by its longest stretch. Raises LogError for a log that does not fit the robot.
    """
    motion = _longest_motion(robot, log, cutoff_hz)
    if cutoff_hz is None:
        wider = min(_WIDER * motion.cutoff_hz, motion.rate_hz / 8)
        motion = _longest_motion(robot, log, wider)
    if not 0 < largest_s < (motion.time[-1] - motion.time[0]) / 10:
        raise LogError(
            f"largest_s must be above 0 and below a tenth of the log, found {largest_s:g} s"
        )
    positions = [_fitted(motion, one, largest_s) for one in _of_positions(robot, motion)]
    if any(delay.is_significant for delay in positions):
        motion = _longest_motion(robot, correct_delays(log, positions), motion.cutoff_hz)
    torques = [_fitted(motion, one, largest_s) for one in _of_torques(robot, motion)]
    return tuple(positions + torques)


def _longest_motion(robot: Robot, log: Log, cutoff_hz: float | None) -> Motion:
    return max(reconstruct_motions(robot, log, cutoff_hz), key=lambda motion: len(motion.time))


def correct_delays(log: Log, delays: Sequence[Delay]) -> Log:
    """Return the log with every significant delay taken out; the ends that nothing covers are cut.

    Channels are interpolated at the times at which they were true, as the repair does;
    the log's `report` says so. Raises LogError for a joint or channel that the log does not have.
    """
    fields = log.sensors()
    shifts = [delay for delay in delays if delay.is_significant]
    for delay in delays:
        if delay.joint not in log.joint_names:
            raise LogError(unknown_name("joint of the log", delay.joint, log.joint_names))
        if delay.channel not in fields:
            raise LogError(unknown_name("channel", delay.channel, fields))
    late = max([0.0, *(delay.delay_s for delay in shifts)])
    early = min([0.0, *(delay.delay_s for delay in shifts)])
    kept = (log.time >= log.time[0] - early) & (log.time <= log.time[-1] - late)
    found: dict[str, Any] = {field: values[kept].copy() for field, values in fields.items()}
    for delay in shifts:
        index = log.joint_names.index(delay.joint)
        column = fields[delay.channel][:, index]
        smooth = delay.channel.endswith("position")
        wanted = log.time[kept] + delay.delay_s
        found[delay.channel][:, index] = interpolated(log.time, column, wanted, smooth=smooth)
    report = tuple(_as_repair(log, delay) for delay in shifts)
    return replace(log, time=log.time[kept], report=log.report + report, **found)


def _as_repair(log: Log, delay: Delay) -> Repair:
    index = log.joint_names.index(delay.joint)
    fields = column_names(delay.joint, log.is_prismatic[index]).items()
    name = next(name for name, field in fields if field == delay.channel)
    return Repair(name, "delay", 1, float(log.time[0]), f"{delay}; taken out")


def _of_positions(robot: Robot, motion: Motion) -> Iterator[_Agreement]:
    rows = row_samples(motion)
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        motor, position = motion.motor_position[:, index], signals(robot, motion, index)["theta_L"]
        one = np.ones((len(motor), 1))
        if not isinstance(drive, SeriesElasticDrive):
            if np.ptp(motor - drive.ratio * position) > 1e-9 * np.ptp(motor):  # both measured
                columns = np.column_stack([one, position])
                against, nothing = "joint position", np.zeros(len(motor))
                yield _Agreement(joint, "motor_position", against, motor, nothing, columns, rows)
            continue
        force = sensed_torque(robot, motion, index)
        if np.all(np.isfinite(force)):
            columns, against = np.column_stack([one, force]), "joint torque"
        else:
            bodies = regressor_at_drives(robot, *motion.joint_states)[:, index]
            columns, against = np.column_stack([one, bodies]), "the load on its spring"
        values = drive.motor_radius / drive.ratio * motor
        rest = -drive.load_radius * position
        yield _Agreement(joint, "motor_position", against, values, rest, columns, rows)


def _of_torques(robot: Robot, motion: Motion) -> Iterator[_Agreement]:
    rows = row_samples(motion)
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        by_name = signals(robot, motion, index)
        nothing = np.zeros(len(motion.time))
        told = rows[~standstill(motion, index)[rows]]
        motor = by_name["tau_M"]
        force = sensed_torque(robot, motion, index)
        if np.all(np.isfinite(motor)):
            if isinstance(drive, SeriesElasticDrive):
                regressor, zeta, columns = actuator_columns(robot, motion, joint)
                against = "its motion and its spring"
            else:
                regressor = motor_regressor(robot, joint)
                zeta, columns = regressor.evaluate(by_name)
                bodies = regressor_at_drives(robot, *motion.joint_states)[:, index]
                columns, against = np.column_stack([columns, bodies]), "the motion"
            rest = regressor.evaluate(by_name | {"tau_M": nothing})[0]
            yield _Agreement(joint, "motor_torque", against, zeta - rest, rest, columns, told)
        if np.all(np.isfinite(force)):
            if isinstance(drive, SeriesElasticDrive):
                stretch = drive.motor_radius / drive.ratio * motion.motor_position[:, index]
                stretch = stretch - drive.load_radius * by_name["theta_L"]
                columns, against = np.column_stack([nothing + 1, stretch]), "its deflection"
            else:
                friction = motor_regressor(robot, joint).evaluate(by_name)[1]
                bodies = regressor_at_drives(robot, *motion.joint_states)[:, index]
                columns, against = np.column_stack([friction, bodies]), "the motion"
            yield _Agreement(joint, "joint_torque", against, force, nothing, columns, told)


@dataclass(frozen=True, eq=False)
class _Moved:
    """A channel (R,) at `time` (R,) [s], and the rest and the columns that are moved under it."""

    time: Array
    channel: Array
    spline: Callable[..., Array]

    def fit(self, delay: float) -> tuple[Array, Array]:
        """Return an orthonormal basis of the columns, moved, and what they leave."""
        moved = self.spline(self.time - delay)
        basis = _orthonormal(moved[:, 1:])
        return basis, _left(basis, self.channel + moved[:, 0])

    def cost(self, delay: float) -> float:
        """Return the sum of squares that a delay leaves."""
        return float(np.sum(self.fit(delay)[1] ** 2))

    def standard_error(self, found: float) -> float | None:
        """Return that of the best delay, None where the delay has no effect at all."""
        basis, residual = self.fit(found)
        moved, rates = self.spline(self.time - found), self.spline(self.time - found, 1)
        theta = safely(
            np.linalg.lstsq,
            moved[:, 1:],
            self.channel + moved[:, 0],
            what="the delay of a channel",
            error=LogError,
            rcond=_RANK,
        )[0]
        slope = _left(basis, rates[:, 1:] @ theta - rates[:, 0])
        curvature = float(slope @ slope)
        if curvature <= 0:
            return None
        scores = newey_west((slope * residual)[:, None], self.time, np.zeros(len(self.time)))
        error = math.sqrt(float(scores[0, 0])) / curvature
        # far from none, what is gained tells more than the curvature: noise has minima everywhere
        gained = max(self.cost(0.0) - self.cost(found), 0.0) / float(scores[0, 0]) * curvature
        return max(error, abs(found) / math.sqrt(gained)) if gained > 0 else math.inf


def _fitted(motion: Motion, agreement: _Agreement, largest_s: float) -> Delay:
    """Return the delay that leaves least of an agreement in the pass band.

    The channel stays where it is and the rest is moved, so that its noise is the same at all trials
    and does not count as a motion that tells the delay.
    """
    from scipy.interpolate import make_interp_spline
    from scipy.optimize import minimize_scalar

    time = motion.time
    band = in_band(motion, np.column_stack([agreement.values, agreement.rest, agreement.columns]))
    rows = agreement.rows
    rows = rows[(time[rows] > time[0] + largest_s) & (time[rows] < time[-1] - largest_s)]
    sizes = np.linalg.norm(band[:, 2:], axis=0)
    model = np.column_stack([band[:, 1], band[:, 2:][:, sizes > 0] / sizes[sizes > 0]])
    moved = _Moved(time[rows], band[rows, 0], make_interp_spline(time, model, k=5))
    trials = np.linspace(-largest_s, largest_s, _TRIALS)
    best = int(np.argmin([moved.cost(trial) for trial in trials]))
    unknown = Delay(agreement.joint, agreement.channel, agreement.against, 0.0, math.inf)
    if best in (0, _TRIALS - 1):
        return unknown
    ends = (trials[best - 1], trials[best + 1])
    options = {"xatol": 1e-7}
    found = float(minimize_scalar(moved.cost, bounds=ends, method="bounded", options=options).x)
    error = moved.standard_error(found)
    return unknown if error is None else replace(unknown, delay_s=found, standard_error_s=error)


def _left(basis: Array, signal: Array) -> Array:
    """Return what an orthonormal basis (R, p) leaves of a signal (R,)."""
    return np.asarray(signal - basis @ (basis.T @ signal))


def _orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis of what columns (R, p) of like norms span."""
    left, sizes, _ = safely(
        np.linalg.svd, columns, what="the delay of a channel", error=LogError, full_matrices=False
    )
    return np.asarray(left[:, sizes > _RANK * max(sizes, default=0.0)])
