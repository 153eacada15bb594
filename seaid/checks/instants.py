"""The signals of a log at some hundred instants, with what was given about the robot.

The motions of a log and a robot come in. Out go the angles and torques of both sides of each joint,
at instants that are few enough to repeat everything for hundreds of possible set-ups:
`with_changes` keeps what a change of the fields leaves as it was. What bodies explain of it is in
`experiment`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Any, Self, TypeVar

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray
from seaid.checks import tolerances as tol
from seaid.drives import IDEAL_DRIVE
from seaid.drives.terms import MOTOR_CONSTANTS
from seaid.errors import listed
from seaid.estimation import qr_factor
from seaid.log import Motion, row_samples
from seaid.log.description import Entries, Entry, changed_source, sources_of
from seaid.log.filtering import moving
from seaid.log.rows import in_band_at
from seaid.regressor import joint_torques
from seaid.regressor.base import INPUT_FIELDS, regressor_at_drives
from seaid.robot import Robot, at_drives, at_joints, torques_at_drives

_INSTANTS = 200
"""Instants at which hypotheses are compared."""

_WINDOWS, _WINDOW_SAMPLES = 5, 4000
"""Windows of a longer motion from which these instants are taken, evenly over its time."""

MOST_STEPS = 8
"""Steps of a search for a value."""

_ARRAYS = {"q": ["joint"], "m": ["motor", "direction"], "s": ["sensed"]}
_ARRAYS["t"] = ["effort", "effort_rate"]
"""{channel of a joint: the fields (..., n) that a change of it changes}: q is the position of the
joint, m that of the motor, t the torque and s that of a sensor behind the motor. Without a motor
torque the sensor of a joint is its channel t."""

OF_LOADS = ("robot", "joint", "motor", "direction", "sprung")
OF_TORQUES = (*OF_LOADS, "ratio", "inertia", "effort", "effort_rate", "sensed")
SIGNALS = (*OF_TORQUES, "both", "counted", "acting")
"""Fields of an experiment from which its loads, its torques, and all but bodies are derived."""

_OF_INSTANTS = (*chain.from_iterable(_ARRAYS.values()), "time", "counted")
"""Fields (..., R, k) with a value for each instant."""

_LARGE = ("regressor", "columns", "_factors", "_seen", "_effects", "_rows")
"""Derived arrays that `forget_rows` drops: they grow with the bodies times instants or joints."""

Value = TypeVar("Value")

_FIELDS_OF: dict[str, frozenset[str]] = {}


def derived(*fields: str) -> Callable[[Callable[[Any], Value]], cached_property[Value]]:
    """Return the decorator of a property of `Experiment` that is computed once from some fields.

    `Experiment.with_changes` keeps its value if these stay, so that of the hundreds of transforms
    of an experiment each one computes only what it changes.
    """

    def decorate(compute: Callable[[Any], Value]) -> cached_property[Value]:
        _FIELDS_OF[compute.__name__] = frozenset(fields)
        return cached_property(compute)

    return decorate


@dataclass(frozen=True, eq=False)
class Instants:
    """A motion at R instants, below the cutoff, with what was given about the robot.

    `log` (R,): number of the log, from 0; `time` (R, 1) [s] in it; `rate_hz`: sampling rate;
    `motor` and `joint` (3, R, n): position, velocity and acceleration of both sides; `direction`
    (R, n): the sign of the motor speed; `effort` and its derivative `effort_rate` (R, n): torque,
    current or voltage of the motor; `sensed` (R, n): torque of a sensor behind it; NaN without
    these; `both` (n,): whether both encoders were logged; `ratio`, `inertia` (n,): gear ratios and
    rotor inertias; `sprung` (n,): whether a spring is parallel to the joint; `bodies` (10n,):
    standard parameters with payloads; `sources`: of each log {joint: {quantity: column or entry of
    its description}}; `counted` (R, n): whether misfits are taken at an instant; `acting`
    (2, n): whether friction and a rotor may act on a joint; `has_wrenches`: whether contact forces
    were measured.
    """

    robot: Robot
    log: IndexArray
    time: Array
    rate_hz: float
    motor: Array
    joint: Array
    direction: Array
    effort: Array
    effort_rate: Array
    sensed: Array
    both: BoolArray
    ratio: Array
    inertia: Array
    sprung: BoolArray
    bodies: Array
    sources: tuple[Entries, ...]
    counted: BoolArray
    acting: BoolArray
    has_wrenches: bool = False

    @classmethod
    def of(cls, robot: Robot, logs: Sequence[Sequence[Motion]]) -> Self:
        """Return the instants, about `_INSTANTS`, of the motions of each log."""
        windows = [*_windows(logs)]
        most = max(1, _INSTANTS // len(windows))
        parts = [_sampled(robot, window, most) for _, window in windows]
        signals = {name: np.concatenate([x[name] for x in parts], axis=-2) for name in parts[0]}
        drives, motor = robot.drives.values(), signals["motor"][0]
        ratio = np.array([drive.ratio for drive in drives])
        apart = motor - ratio * at_drives(robot.transmission, signals["joint"][0])
        bodies = robot.parameters + robot.payload_parameters
        return cls(
            robot,
            np.repeat([number for number, _ in windows], [len(part["effort"]) for part in parts]),
            rate_hz=logs[0][0].rate_hz,
            # A side without an encoder was computed from the other, and differs by rounding only.
            both=np.ptp(apart, axis=0) > 1e-9 * np.ptp(motor, axis=0),
            ratio=ratio,
            inertia=np.array([drive.values.get("motor_inertia", 0.0) for drive in drives]),
            sprung=np.array(["linear" in drive.parallel_spring for drive in drives]),
            # a robot file may have no inertias
            bodies=bodies if np.any(robot.parameters) else np.full_like(bodies, np.nan),
            sources=tuple(map(sources_of, logs)),
            counted=np.ones(signals["effort"].shape, dtype=bool),
            acting=np.ones((2, robot.n), dtype=bool),
            has_wrenches=any(x.base and x.base.wrenches for x in chain.from_iterable(logs)),
            **signals,
        )

    def source(self, j: int, quantity: str, log: int = 0) -> Entry:
        """Return how a quantity of joint j was read."""
        return self.sources[log][self.robot.joint_names[j]][quantity]

    def input(self, j: int) -> str:
        """Return the quantity by which the torque of motor j is logged, such as its current."""
        return INPUT_FIELDS[self.robot.drives[self.robot.joint_names[j]].motor_input]

    def logged(self, j: int, channels: str) -> list[str]:
        """Return the logged quantities of joint j for channels of q, m, t and s.

        Where a channel was not logged, the quantity is that of the other side, from which it was
        computed.
        """
        sources = self.sources[0][self.robot.joint_names[j]]
        sides = {"q": ["joint_position", "motor_position"], "t": [self.input(j), "joint_torque"]}
        sides |= {"m": sides["q"][::-1], "s": sides["t"][1:]}
        choices = [[name for name in sides[x] if name in sources][:1] for x in channels]
        return list(dict.fromkeys(name for choice in choices for name in choice))

    def entries(self, j: int, channels: str, **changes: float) -> dict[str, Entry]:
        """Return {quantity: source} of `logged`, with the changes of `changed_source`."""
        names = self.logged(j, channels)
        return {name: changed_source(self.source(j, name), **changes) for name in names}

    def subject(self, joints: Sequence[int], channels: str) -> str:
        """Return the words for logged channels of joints, which begin a sentence about them."""
        quantities = self.logged(joints[0], channels)
        words = listed([f"{quantity.replace('_', ' ')}s" for quantity in quantities])
        is_whole = len(joints) > 1 and {*self.used} <= {*joints}
        names = [self.robot.joint_names[j] for j in joints]
        return f"the {words} of {'all joints' if is_whole else listed(names)}"

    def with_changes(self, **changes: Any) -> Self:
        """Return the experiment with other fields, and what was derived from those that stay."""
        changed, names = replace(self, **changes), {*changes}
        # unknown constants follow from all that there is
        names |= {"effort"} if np.any(self.is_unscaled) else set()
        stay = (name for name in vars(self) if not _FIELDS_OF.get(name, names) & names)
        vars(changed).update({name: vars(self)[name] for name in stay})
        return changed

    def forget_rows(self) -> None:
        """Forget the large arrays that were derived, which are derived again if they are needed."""
        for name in _LARGE:
            vars(self).pop(name, None)

    def described_as(self, sources: Entries, number: int | None = None) -> Self:
        """Return the experiment whose description has other sources of some quantities.

        That is the description of one log by its number, or that of all.
        """
        logs = [*self.sources]
        for place in range(len(logs)) if number is None else [number]:
            entries = logs[place].items()
            logs[place] = {joint: {**x, **sources.get(joint, {})} for joint, x in entries}
        return self.with_changes(sources=tuple(logs))

    def of_log(self, number: int) -> Self:
        """Return the experiment at the instants of one log."""
        rows = self.log == number
        parts = {name: getattr(self, name)[..., rows, :] for name in _OF_INSTANTS}
        return self.with_changes(log=self.log[rows], sources=(self.sources[number],), **parts)

    def with_log(self, before: Self, after: Self) -> Self:
        """Return the experiment in which the instants of one log, `before`, are those `after`."""
        changes, rows = dict[str, Array](), self.log == before.log[0]
        for name in _OF_INSTANTS:
            if getattr(before, name) is not getattr(after, name):
                changes[name] = getattr(self, name).copy()
                changes[name][..., rows, :] = getattr(after, name)
        return self.with_changes(**changes)

    def with_channels(self, channels: str, change: Callable[[Array], Array]) -> Self:
        """Return the experiment after a change of the arrays (..., n) of channels q, m, t and s."""
        names = [name for channel in channels for name in _ARRAYS[channel]]
        changes = {name: change(getattr(self, name)) for name in names}
        if "t" in channels and "s" not in channels:
            changes["sensed"] = np.where(self.has_both_torques, self.sensed, change(self.sensed))
        changed = self.with_changes(**changes)
        return changed.consistent if {*channels} & {"q", "m"} else changed

    def scaled(self, factors: Mapping[int, float], channels: str) -> Self:
        """Return the experiment with channels (q, m, t, s) of joints times their factors."""
        factor = np.array([factors.get(j, 1.0) for j in range(self.robot.n)])
        changed = self.with_channels(channels, lambda values: values * factor)
        # `with_channels` has multiplied the direction by the factor, of which it has the sign.
        direction = self.direction * np.sign(factor)
        return changed.with_changes(direction=direction) if "m" in channels else changed

    def turned_by(self, added: Array) -> Self:
        """Return the experiment with states (3, R, n) added to joints, and so to their motors."""
        turned = self.lever * at_drives(self.robot.transmission, added)
        return self.with_changes(joint=self.joint + added, motor=self.motor + turned)

    @property
    def consistent(self) -> Self:
        """The experiment in which the joints without encoders follow from the motors.

        The motors without encoders follow from the joints.
        """
        names, sources = self.robot.joint_names, self.sources[0]
        is_alone = np.array(["joint_position" not in sources.get(x, {}) for x in names])
        of_motors = at_joints(self.robot.transmission, self.motor / self.lever)
        changed = self.with_changes(joint=np.where(is_alone & ~self.both, of_motors, self.joint))
        motor = np.where(is_alone | self.both, self.motor, changed.lever * changed.turned)
        return changed.with_changes(motor=motor)

    @derived("robot", "joint")
    def turned(self) -> Array:
        """Position, velocity and acceleration (3, R, n) behind the gears: phi = C q."""
        return at_drives(self.robot.transmission, self.joint)

    @derived("robot", "ratio", "motor", "joint")
    def apart(self) -> Array:
        """Angles (R, n) of the motors behind the gears less those of the joints."""
        # The stretch of the spring in (3) over r_L: r_M / (N r_L) theta_M - theta_L.
        return np.asarray(self.motor[0] / self.lever - self.turned[0])

    @derived("robot", "ratio")
    def lever(self) -> Array:
        """N r_L / r_M (n,), positive: the torque on the load per torque of the motor."""
        drives = self.robot.drives.values()
        return np.asarray(self.ratio * [drive.load_radius / drive.motor_radius for drive in drives])

    @derived("robot")
    def is_unscaled(self) -> BoolArray:
        """Whether the effort (n,) of a motor is not its torque, by a constant that is unknown."""
        drives = self.robot.drives.values()
        unknown = [MOTOR_CONSTANTS.get(x.motor_input, "") not in ("", *x.known) for x in drives]
        return np.array(unknown)

    @derived(*OF_TORQUES)
    def constants(self) -> Array:
        """Torque (n,) of a motor per effort: an unknown one is that by which bodies explain most.

        It is positive. Where the log does not show it the torque is as large as that of the bodies;
        without these it is nominal, or 1. A torque sensor is used in place of an unknown one, NaN.
        """
        drives = self.robot.drives.values()
        known = [x.values.get(MOTOR_CONSTANTS.get(x.motor_input, ""), 1.0) for x in drives]
        constants = np.where(self.is_unscaled & np.isfinite(self.sensed[0]), np.nan, known)
        unknown = self.is_unscaled & np.isfinite(constants) & self.robot.base_is_held
        unscaled = np.flatnonzero(unknown).tolist()
        for j in unscaled if unscaled and np.all(np.isfinite(self.bodies)) else ():
            # (7) into (4b): N r_L / r_M K i is the torque of the load, of the rotor and of friction
            load = self.of_file[:, j] + self.lever[j] * self.inertia[j] * self.motor[2][:, j]
            columns = np.column_stack([load, self._any_friction(j, not self.inertia[j])])
            rows, effort = self._moving[:, j], self.lever[j] * self.effort[:, j]
            if np.sum(rows) > 3 * columns.shape[1] and np.std(effort) > 0:
                x, covariance = fitted([columns[rows]], effort[rows])
                is_shown = abs(x[0]) > tol.SURE * math.sqrt(covariance[0, 0])
                constants[j] = 1 / abs(x[0]) if is_shown else np.std(load) / np.std(effort)
        return constants

    @property
    def torque(self) -> Array:
        """The torque (R, n) of motors, NaN without a sensor or a constant."""
        return np.asarray(self.constants * self.effort)

    @property
    def torque_rate(self) -> Array:
        """The derivative (R, n) of the torque of motors."""
        return np.asarray(self.constants * self.effort_rate)

    @derived(*OF_TORQUES)
    def target(self) -> Array:
        """Torque on the load (R, n): sensed, or of the motor without that on its rotor."""
        # (7) into (4b) without friction: tau_L = N r_L / r_M (tau_M - I_M theta_M'').
        of_motor = self.lever * (self.torque - self.rotor * self.motor[2])
        return np.asarray(np.where(np.isnan(self.torque), self.sensed, of_motor))

    @derived(*OF_TORQUES)
    def rotor(self) -> Array:
        """Inertia (n,) of the rotors: a known one, or that by the motor equation (7) of a spring.

        The torque on a rotor whose inertia is taken as zero looks like that of bodies. A negative
        inertia comes from a mistake in the channels and is none.
        """
        inertia = self.inertia.copy()
        for j in map(self.robot.index, self.robot.elastic_joints):
            if not inertia[j] and np.any(moving(self.motor[1][:, j])):
                rows, y, others = self._of_spring(j)
                # any delay of the torque, stiffness and friction; the rotor comes last
                columns = np.column_stack([self.torque_rate[:, j], self.apart[:, j], others])
                is_known = np.all(np.isfinite(self.torque[:, j]))
                if is_known and np.sum(rows) > 3 * columns.shape[1]:
                    inertia[j] = max(float(fitted([columns[rows]], y[rows])[0][-1]), 0.0)
        return inertia

    @derived(*OF_TORQUES)
    def _torque_sizes(self) -> Array:
        """Standard deviations (n,) of `target`, by which misfits and noise are measured."""
        # joint by joint: the mean of a constant torque over several columns is rounded
        return np.asarray(np.std(np.ascontiguousarray(self.target.T), axis=1))

    @derived(*OF_TORQUES)
    def used(self) -> list[int]:
        """Joints with a torque that changes."""
        return np.flatnonzero(self._torque_sizes > 0).tolist()

    @derived("robot", "joint")
    def regressor(self) -> Array:
        """The regressor (R, n, 10n) of the rigid bodies."""
        return regressor_at_drives(self.robot, *self.joint)

    @derived("motor", "direction")
    def friction(self) -> Array:
        """Columns (n, R, 3) of viscous friction, Coulomb friction and a constant."""
        ones = np.ones_like(self.direction)
        # The speed over its largest value, from -1 to 1: as large as the sign, and without a unit.
        scaled = self.motor[1] / np.maximum(np.max(np.abs(self.motor[1]), axis=0), tol.LEAST)
        return np.stack([scaled, self.direction, ones], axis=-1).swapaxes(0, 1)

    @derived("robot", "joint", "bodies")
    def of_file(self) -> Array:
        """The torques (R, n) of the bodies of the robot file and the payloads."""
        robot, masses = self.robot, self.bodies[::10]
        # Those of the model by recursion, in O(n) where the regressor has O(n^2) numbers.
        if np.array_equal(robot.parameters + robot.payload_parameters, self.bodies) and all(masses):
            return torques_at_drives(robot.transmission, joint_torques(robot, *self.joint))
        return np.asarray(self.regressor @ self.bodies)

    def deflection(self, j: int) -> Array:
        """Return columns (R, k) of the deflection of a spring, none of a stiff joint j.

        It is by the torque of its motor but for friction.
        """
        columns = np.column_stack([self.friction[j][:, :2], self.target[:, j]])
        return columns if j in self._elastic else columns[:, :0]

    @derived("effort", "sensed")
    def has_both_torques(self) -> BoolArray:
        """Whether the torques (n,) of the motor and of a sensor behind it were logged."""
        return np.asarray(np.all(np.isfinite(self.torque) & np.isfinite(self.sensed), axis=0))

    @derived("robot")
    def _is_open(self) -> BoolArray:
        """Whether the rotor inertia (n,) of a drive is unknown, or the drive itself."""
        drives = self.robot.drives.values()
        unknown = [x.motor_inertia_kg_m2 is None or x == IDEAL_DRIVE for x in drives]
        return np.array(unknown, dtype=bool)

    @derived(*OF_TORQUES)
    def _has_open_rotor(self) -> BoolArray:
        """Whether the known motor torque (n,) of a stiff joint turns a rotor of any inertia."""
        is_stiff = ~np.isin(np.arange(self.robot.n), self._elastic)
        return np.asarray(self._is_open & np.isfinite(self.torque[0]) & is_stiff)

    def encoder_slope(self, j: int) -> tuple[float, float]:
        """Return the motor angle per joint angle over the gear ratio, and what it leaves.

        The deflection of a spring is none of it, nor are the zeros of each log. What is left is a
        part (rms) of the motion.
        """
        zeros, joint = np.equal.outer(self.log, np.unique(self.log)), self.turned[0][:, j]
        motor, columns = self.motor[0][:, j] / self.lever[j], [joint, zeros, self.deflection(j)]
        H = np.column_stack(columns)
        x = qr_factor.scaled_svd(H).solve(motor)
        return float(x[0]), float(np.std(motor - H @ x)) / max(float(np.std(joint)), tol.LEAST)

    def encoder_ratio(self, j: int) -> tuple[float, float]:
        """Return the gear ratio between both encoders and its standard error, NaN if none is shown.

        Of a spring joint it is that of the motor equation (7), tau - I w' = friction + a theta_M -
        b theta_L with N = b/a r_L/r_M, or of the torque sensor and (4b); of others that of the
        angles alone, whose error is not over the root of the number of rows: errors of a gear do
        not average out.
        """
        motor, joint, given = self.motor[0][:, j], self.turned[0][:, j], float(self.ratio[j])
        # a joint that stands still while its motor moves shows no ratio
        if not self.both[j] or np.ptp(self.lever[j] * joint) < tol.HARDLY * np.ptp(motor):
            return math.nan, math.nan
        if self.robot.joint_names[j] not in self.robot.elastic_joints:
            slope, error = self.encoder_slope(j)
            return given * slope, given * error
        rows, y, others = self._of_spring(j)
        zeros = np.equal.outer(self.log, np.unique(self.log)[1:])  # `others` have the first one
        columns = np.column_stack([motor / self.lever[j], joint, others, zeros])
        if np.sum(rows) <= 3 * columns.shape[1]:
            return math.nan, math.nan
        slope, error = qr_factor.fitted_slope(columns[rows], y[rows], tol.CORRELATED_ERRORS)
        return given * slope, given * error

    def _of_spring(self, j: int) -> tuple[BoolArray, Array, Array]:
        """Return the rows (R,), torque (R,) and columns (R, k), without the angles, of a spring.

        They are those of (7) with the motor torque, else of (4b) with the torque sensor. A joint
        without any torque has no rows.
        """
        sensed = self.sensed[:, j]
        if np.all(np.isfinite(self.torque[:, j])):
            columns = self._any_friction(j, has_rotor=not self.inertia[j])
            of_spring = self.torque[:, j] - self.inertia[j] * self.motor[2][:, j]
            return self._moving[:, j], of_spring, columns
        return np.isfinite(sensed), np.nan_to_num(sensed), np.ones((len(sensed), 1))

    @cached_property
    def _moving(self) -> BoolArray:
        # Where the mean sign of the speed behind the low pass is less, a motor may have stuck:
        # friction then changes before the motion does, like an early torque.
        return np.asarray(np.abs(self.direction) > 1 - tol.FEW)

    def _any_friction(self, j: int, has_rotor: bool) -> Array:
        """Return columns (R, k) of friction, of which one changes gradually near reversals.

        The rotor has a column if its inertia is unknown.
        """
        gradual = np.tanh(self.friction[j][:, 0] / tol.POOR)  # of the speed, which is up to 1
        rotor = [self.motor[2][:, j]] if has_rotor else []
        return np.column_stack([self.friction[j], gradual, *rotor])

    @derived(*OF_TORQUES)
    def _elastic(self) -> list[int]:
        return [j for j in map(self.robot.index, self.robot.elastic_joints) if j in self.used]


def fitted(columns: Sequence[Array], y: Array) -> tuple[Array, Array]:
    """Return the parameters of y (R,) by columns, and their covariance, at instants far apart."""
    return qr_factor.fitted_columns(np.column_stack(columns), y, tol.CORRELATED_ERRORS, 1)


def _windows(logs: Sequence[Sequence[Motion]]) -> Iterator[tuple[int, Motion]]:
    """Yield the number of each log with each of its motions, or with windows of a long one."""
    for number, motion in ((k, motion) for k, motions in enumerate(logs) for motion in motions):
        count = len(motion.time)
        # The low pass takes a transient at both ends of a window: two thirds of it remain, or more.
        size = max(_WINDOW_SAMPLES, round(6 * motion.transient_s * motion.rate_hz))
        if count <= _WINDOWS * size:
            yield number, motion
            continue
        for start in np.linspace(0, count - size, _WINDOWS).astype(int).tolist():
            yield number, motion.samples(slice(start, start + size))


def _sampled(robot: Robot, motion: Motion, most: int) -> dict[str, Any]:
    """Return the signals of an experiment, by name, at not many more than `most` instants."""
    rows = row_samples(motion)
    # (T,) samples -> at most about `most` rows, evenly over the motion.
    rows = rows[:: max(1, math.ceil(len(rows) / most))]

    def filtered(signal: Array, samples: IndexArray = rows) -> Array:
        # A column is NaN at all samples, without its sensor, or at none (`Log`).
        known = in_band_at(motion, np.nan_to_num(signal), samples)
        return np.where(np.isnan(signal[0]), np.nan, known)

    of_motors = np.full(motion.motor_position.shape, np.nan)
    for j, drive in enumerate(robot.drives.values()):
        channel = getattr(motion, INPUT_FIELDS[drive.motor_input])
        if channel is not None and not drive.is_up_to_scale:
            of_motors[:, j] = channel[:, j]
    # At all samples, because the derivative needs the neighbours of a row.
    effort = filtered(of_motors, np.arange(len(of_motors)))
    motor = motion.motor_position, motion.motor_velocity, motion.motor_acceleration
    return {
        "time": motion.time[rows, None],
        "motor": np.stack([*map(filtered, motor)]),
        "joint": np.stack([*map(filtered, motion.joint_states)]),
        "direction": filtered(np.sign(motion.motor_velocity)),
        "effort": effort[rows],
        "effort_rate": np.gradient(effort, motion.time, axis=0)[rows],
        "sensed": filtered(torques_at_drives(robot.transmission, motion.joint_torque)),
    }
