"""An experiment at some hundred instants: its signals, what was given, and what that explains.

Four misfits judge a set-up: how well the nominal bodies of the robot file predict the torque of
each joint, how well any bodies do, how well the motor equation (7) of a spring joint holds, and how
well the encoders of both sides agree. Friction that would drive the joint counts as misfit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray, safely
from seaid.checks.check import Code
from seaid.checks.tolerances import (
    BODY,
    CENTRE_M,
    CORRELATED_ROWS,
    FEW,
    MOST,
    POOR,
    SLIGHT,
    TWICE,
)
from seaid.drives import IDEAL_DRIVE
from seaid.errors import IdentificationError, Severity
from seaid.estimation import RANK_TOLERANCE, scaled_svd, triangle
from seaid.log import Motion, in_band, in_band_at, row_samples
from seaid.regressor import INPUT_FIELDS, regressor_at_drives
from seaid.robot import Robot, at_drives, torques_at_drives

INSTANTS = 200
"""Instants at which hypotheses are compared."""

_WINDOWS, _WINDOW_SAMPLES = 5, 4000
"""Windows of a longer motion from which these instants are taken, evenly over its time."""

_KINDS = {
    "nominal": ("nominal", SLIGHT),
    "free": ("free", FEW),
    "motor": ("of_motors", FEW),
    "encoders": ("of_encoders", FEW),
}
"""{kind of misfit: its property, and what counts as none}: by bodies of the robot file, by any
bodies, of the motor equation, of one encoder by the other."""


def inertial_parameters(mass: float, moments: Array, J: Array) -> Array:
    """Return ten parameters in the order of Pinocchio: m, m c and the inertia at the joint."""
    return np.array([mass, *moments, *J[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])


def moved(mass: float, moments: Array) -> Array:
    """Return the change (10, 3) of a body by a shift of its centre along each axis, per metre.

    A mass m at c that moves by e has m e more as first moments, and m (2 (c.e) 1 - e c^T - c e^T)
    more as inertia.
    """
    shifts = []
    for e in np.eye(3):
        J = 2 * (moments @ e) * np.eye(3) - np.outer(e, moments) - np.outer(moments, e)
        shifts.append(inertial_parameters(0.0, mass * e, J))
    return np.column_stack(shifts)


@dataclass(frozen=True, eq=False)
class Experiment:
    """A motion at R instants, below the cutoff, with what was given about the robot.

    `log` (R,): number of the log, from 0; `rate_hz`: sampling rate; `motor` and `joint` (3, R, n):
    position, velocity and acceleration of both sides; `direction` (R, n): the sign of the motor
    speed; `torque`, its derivative `torque_rate`, and `sensed` (R, n): of motor and joint, NaN
    without the sensor; `unscaled` (R, n): the current or the voltage of a motor whose constant is
    unknown, NaN of the others; `both` (n,): whether both encoders were logged; `ratio`, `inertia`
    (n,): gear ratios and rotor inertias; `bodies` (10n,): standard parameters with payloads;
    `sources`: of each log {joint: {quantity: column or entry of its description}}; `has_wrenches`:
    whether contact forces were measured; `counted` (R, n): the instants at which misfits are taken,
    None for all.
    """

    robot: Robot
    log: IndexArray
    rate_hz: float
    motor: Array
    joint: Array
    direction: Array
    torque: Array
    torque_rate: Array
    sensed: Array
    unscaled: Array
    both: Array
    ratio: Array
    inertia: Array
    bodies: Array
    sources: tuple[Mapping[str, Mapping[str, Any]], ...]
    has_wrenches: bool = False
    counted: BoolArray | None = None

    def source(self, j: int, quantity: str, log: int = 0) -> str | Mapping[str, Any]:
        """Return how a quantity of joint j was read: its column, or its entry in a description."""
        found: str | Mapping[str, Any] = self.sources[log][self.robot.joint_names[j]][quantity]
        return found

    def logged(self, j: int, channels: str) -> list[str]:
        """Return the logged quantities of joint j for channels of q, m and t.

        A position that was computed from the other side's changes with that one.
        """
        sources = self.sources[0][self.robot.joint_names[j]]
        sides = {"q": ["joint_position", "motor_position"], "t": ["motor_torque", "joint_torque"]}
        sides["m"] = sides["q"][::-1]
        choices = [[one for one in sides[channel] if one in sources][:1] for channel in channels]
        return list(dict.fromkeys(one for choice in choices for one in choice))

    @cached_property
    def turned(self) -> Array:
        """Position, velocity and acceleration (3, R, n) behind the gears: phi = C q."""
        return at_drives(self.robot.transmission, self.joint)

    @cached_property
    def apart(self) -> Array:
        """Angles (R, n) of the motors behind the gears less those of the joints."""
        return np.asarray(self.motor[0] / self.lever - self.turned[0])

    @cached_property
    def lever(self) -> Array:
        """N r_L / r_M (n,): the torque on the load per torque of the motor."""
        drives = self.robot.drives.values()
        return np.asarray(self.ratio * [one.load_radius / one.motor_radius for one in drives])

    @cached_property
    def target(self) -> Array:
        """Torque on the load (R, n): sensed, or of the motor without that on its rotor."""
        of_motor = self.lever * (self.torque - self.inertia * self.motor[2])
        return np.asarray(np.where(np.isnan(self.torque), self.sensed, of_motor))

    @cached_property
    def _torque_sizes(self) -> list[float]:
        """Standard deviations (n,) of `target`, by which misfits and noise are measured."""
        return [float(np.std(self.target[:, j])) for j in range(self.robot.n)]

    @cached_property
    def used(self) -> list[int]:
        """Joints with a torque that changes; none on a floating base, whose forces are unknown."""
        if self.robot.floating_base is not None:
            return []
        return [j for j in range(self.robot.n) if self._torque_sizes[j] > 0]

    @cached_property
    def regressor(self) -> Array:
        """The regressor (R, n, 10n) of the rigid bodies."""
        return regressor_at_drives(self.robot, *self.joint)

    @cached_property
    def friction(self) -> Array:
        """Columns (n, R, 3) of viscous friction, Coulomb friction and a constant."""
        ones = np.ones_like(self.direction)
        scaled = self.motor[1] / np.maximum(np.max(np.abs(self.motor[1]), axis=0), 1e-300)
        return np.stack([scaled, self.direction, ones], axis=-1).swapaxes(0, 1)

    @cached_property
    def _springs(self) -> Array:
        """Torque (n, R, n) at each drive per stiffness of a declared spring parallel to a joint."""
        robot = self.robot
        has_spring = ["linear" in drive.parallel_spring for drive in robot.drives.values()]
        turned = self.joint[0] * np.array(has_spring)
        at_drive = torques_at_drives(robot.transmission, np.eye(robot.n))
        return np.asarray(np.einsum("rj,jd->drj", turned, at_drive))

    def load_columns(self, j: int) -> Array:
        """Return columns (R, k) of what acts on the load of joint j next to bodies: friction first.

        Springs parallel to the joint have any stiffness and preload; the constant of friction is
        one of theirs.
        """
        springs = self._springs[j]
        return np.hstack([self.friction[j], springs[:, np.any(springs != 0, axis=0)]])

    @cached_property
    def nominal(self) -> Array:
        """Misfit (n,) of the nominal bodies with any friction, NaN without nominal bodies."""
        return self.of_bodies(self.bodies)

    def of_bodies(self, bodies: Array) -> Array:
        """Return the misfit (n,) of bodies (10n,) with any friction, NaN for unknown ones."""
        found = np.full(self.robot.n, np.nan)
        if self.used and np.all(np.isfinite(bodies)):
            left = self.target - self.regressor @ bodies
            for j in self.used:
                found[j] = self._misfit(j, left[:, j], self.load_columns(j))
        return found

    @property
    def free(self) -> Array:
        """Misfit (n,) of any bodies with any friction."""
        return self._by_any_bodies[0]

    @cached_property
    def _by_any_bodies(self) -> tuple[Array, Array]:
        """Misfit (n,) of any bodies with any friction, and rows per independent one of it."""
        used, count, m = self.used, len(self.target), self.robot.parameters.size
        found = np.full(self.robot.n, np.nan)
        per_row = np.full_like(found, CORRELATED_ROWS)
        if not used:
            return found, per_row
        loads = [self.load_columns(j) for j in used]
        ends = m + np.cumsum([0, *(columns.shape[1] for columns in loads)])
        H = np.zeros((count, len(used), ends[-1]))
        H[:, :, :m] = self.regressor[:, used]
        for place, columns in enumerate(loads):
            H[:, place, ends[place] : ends[place + 1]] = columns
        weight = 1.0 / np.std(self.target[:, used], axis=0)
        counts = np.stack([self._counted(j) for j in used], axis=1)
        A = (H * weight[:, None] * counts[:, :, None]).reshape(-1, ends[-1])
        b = (self.target[:, used] * weight * counts).ravel()
        size = np.linalg.norm(A, axis=0)
        A[:, size < 1e-9 * np.max(size)] = 0.0
        # the triangular factor has the singular values and the solution of all rows
        factor = triangle(np.column_stack([A, b]))
        x = scaled_svd(factor[:, :-1]).solve(factor[:, -1], RANK_TOLERANCE)
        residual = (b - A @ x).reshape(count, -1)
        for place, j in enumerate(used):
            friction = x[ends[place] : ends[place] + 2] / weight[place]
            rows = residual[counts[:, place], place]
            found[j] = self._size(j, rows / weight[place], friction)
            per_row[j] = max(CORRELATED_ROWS, correlated_rows(rows))
        return found, per_row

    @cached_property
    def of_motors(self) -> Array:
        """Misfit (n,) of the motor equation (7) with any spring and friction, or of (4b)."""
        found = np.full(self.robot.n, np.nan)
        for j in self._elastic:
            rate = self.torque_rate[:, j]  # a torque that is late is no other mistake
            columns = np.column_stack([self.friction[j], rate, self.apart[:, j]])
            y = self._spring_torque(j)
            if not np.all(np.isfinite(y)):  # (4b) alone: the torque of the sensor
                columns = np.column_stack([self.friction[j][:, 2], self.apart[:, j]])
                y = self.sensed[:, j] / self.lever[j]
            found[j] = self._misfit(j, y, columns, stretch=columns.shape[1] - 1)
        return found

    @cached_property
    def of_encoders(self) -> Array:
        """Misfit (n,) between both encoders, but for a constant and a deflection by the torque."""
        found = np.full(self.robot.n, np.nan)
        for j in np.flatnonzero(self.both).tolist():
            H, apart = with_constant(self.deflection(j)), self.apart[:, j]
            left = apart - H @ scaled_svd(H).solve(apart)
            found[j] = float(np.std(left)) / max(float(np.std(self.turned[0][:, j])), _LEAST)
        return found

    def deflection(self, j: int) -> Array:
        """Return columns (R, k) of the deflection of a spring, none of a stiff joint j.

        It is proportional to the torque of the spring, which is that of the motor but for friction.
        """
        if j not in self._elastic:
            return np.empty((len(self.target), 0))
        torque = self.target[:, j] / max(self._torque_sizes[j], _LEAST)
        return np.column_stack([self.friction[j][:, :2], torque])

    @cached_property
    def _is_open(self) -> BoolArray:
        """Whether the rotor inertia (n,) of a drive is unknown, or the drive itself."""
        drives = self.robot.drives.values()
        unknown = [one.motor_inertia_kg_m2 is None or one == IDEAL_DRIVE for one in drives]
        return np.array(unknown, dtype=bool)

    @cached_property
    def torque_delays(self) -> dict[int, tuple[float, float]]:
        """Delay of the motor torque and its standard error [s], by joint.

        From the motor equation (7) of spring joints, and from the motion with any bodies of others,
        and any rotor inertia that is unknown.
        """
        robot, n = self.robot, self.robot.n
        driven = [j for j in self.used if np.all(np.isfinite(self.torque[:, j]))]
        found = {}
        for j in (one for one in driven if one in self._elastic):
            rows, y = self._moving[:, j], self._spring_torque(j)
            others = [self._any_friction(j), *self._open_rotor(j), self.apart[:, j]]
            columns = np.column_stack([self.torque_rate[:, j], *others])
            if np.sum(rows) > 3 * columns.shape[1]:
                x, covariance = fitted(columns[rows], y[rows])
                found[j] = -float(x[0]), float(np.sqrt(covariance[0, 0]))
        stiff = [j for j in driven if j not in self._elastic]
        if not stiff:
            return found
        m = robot.parameters.size
        H = np.zeros((len(stiff), len(self.target), m + 6 * n))
        H[:, :, :m] = self.regressor[:, stiff].swapaxes(0, 1)
        for place, j in enumerate(stiff):
            H[place, :, m + 4 * j : m + 4 * j + 4] = self._any_friction(j)
            H[place, :, m + 4 * n + j] = self.lever[j] * self.motor[2][:, j] * self._is_open[j]
            H[place, :, m + 5 * n + j] = self.lever[j] * self.torque_rate[:, j]
        weight = 1.0 / np.std(self.target[:, stiff], axis=0)
        moving = self._moving[:, stiff].T.astype(float)
        A = H * weight[:, None, None] * moving[:, :, None]
        y = self.target[:, stiff].T * weight[:, None] * moving
        order = [m + 5 * n + j for j in stiff]
        order += [place for place in range(m + 5 * n) if np.any(np.abs(A[:, :, place]) > _TINY)]
        columns = A[:, :, order].reshape(-1, len(order))
        return found | dict(zip(stiff, _first(columns, y.ravel(), len(stiff)), strict=True))

    @cached_property
    def encoder_ratios(self) -> dict[int, tuple[float, float]]:
        """Gear ratio between both encoders and its standard error, by joint.

        Of a spring joint from the motor equation (7), tau - I w' = friction + a theta_M - b theta_L
        with N = b/a r_L/r_M, or from the torque sensor and (4b); of others from the angles alone.
        Errors of the gear do not average out (see `gear_ratio`).
        """
        found = {}
        # the zeros of the encoders of each log but the first
        zeros = np.equal.outer(self.log, np.unique(self.log)[1:]).astype(float)
        is_elastic = [drive.is_elastic for drive in self.robot.drives.values()]
        for j in np.flatnonzero(self.both).tolist():
            motor, joint = self.motor[0][:, j], self.turned[0][:, j]
            per_ratio = self.ratio[j] / self.lever[j]
            if stands_locked(self.lever[j] * joint, motor):
                continue
            of_spring = self._of_spring(j) if is_elastic[j] else None
            if of_spring is not None:
                rows, y, others = of_spring
                columns = np.column_stack([motor, joint, others, zeros])
                if np.sum(rows) <= 3 * columns.shape[1]:
                    continue
                slope, error = _slope(columns[rows], y[rows])
            elif not is_elastic[j]:
                columns = np.column_stack([joint, np.ones(len(joint)), zeros])
                found_here = scaled_svd(columns).solve(motor)
                slope, left = found_here[0], motor - columns @ found_here
                error = float(np.std(left)) / max(float(np.std(joint)), 1e-300)
            else:
                continue
            found[j] = float(slope) * per_ratio, error * abs(per_ratio)
        return found

    def _of_spring(self, j: int) -> tuple[BoolArray, Array, Array] | None:
        """Return rows, torque and columns but the angles: by (7), or by the sensor and (4b).

        A torque of unknown scale does as well in (7), next to a rotor of any inertia.
        """
        if np.all(np.isfinite(self.torque[:, j])):
            columns = np.column_stack([self._any_friction(j), *self._open_rotor(j)])
            return self._moving[:, j], self._spring_torque(j), columns
        if np.any(np.isfinite(self.sensed[:, j])):
            ones = np.ones((len(self.sensed), 1))
            return np.isfinite(self.sensed[:, j]), np.nan_to_num(self.sensed[:, j]), ones
        if np.all(np.isfinite(self.unscaled[:, j])):
            columns = np.column_stack([self._any_friction(j), self.motor[2][:, j]])
            return self._moving[:, j], self.unscaled[:, j], columns
        return None

    @cached_property
    def _moving(self) -> BoolArray:
        return np.asarray(np.abs(self.direction) > _MOVING)

    def _spring_torque(self, j: int) -> Array:
        return np.asarray(self.torque[:, j] - self.inertia[j] * self.motor[2][:, j])

    def _open_rotor(self, j: int) -> list[Array]:
        """Return the column (R,) of a rotor whose inertia is unknown, if it is."""
        return [] if self.inertia[j] else [self.motor[2][:, j]]

    def _any_friction(self, j: int) -> Array:
        """Return columns (R, 4) of friction, with one that changes gradually near reversals."""
        gradual = np.tanh(self.friction[j][:, 0] / _WIDTH)  # the first column is the speed, up to 1
        return np.column_stack([self.friction[j], gradual])

    @cached_property
    def misfits(self) -> dict[str, Array]:
        """All misfits (n,) by kind."""
        return {kind: getattr(self, name) for kind, (name, _) in _KINDS.items()}

    @cached_property
    def widths(self) -> Array:
        """Columns (10N, 5N): one standard deviation of each body of the robot file.

        A body of mass m at c is wrong by dm (all of it in proportion), by dc, which adds m dc to
        its first moments and m (2 (c.dc) 1 - dc c^T - c dc^T) to its inertia, and by its inertia.
        Known bodies are wrong by little.
        """
        bodies = self.robot.parameters.reshape(-1, 10)
        N, mass = len(bodies), np.abs(bodies[:, 0])
        known = np.where(self.robot.is_known[::10], POOR, 1.0)[:, None]
        # cables, screws and covers weigh much next to a small body, little next to a large one
        share = np.clip(SLIGHT * np.sum(mass) / np.maximum(mass, _LEAST), BODY, 1.0)
        spread = np.zeros((N, 10, 5))
        spread[:, :, 0] = share[:, None] * bodies
        spread[:, 4:, 4] = MOST * bodies[:, 4:]
        for body, (m, moments) in enumerate(zip(mass, bodies[:, 1:4], strict=True)):
            length = max(CENTRE_M, BODY * float(np.linalg.norm(moments)) / max(m, _LEAST))
            spread[body, :, 1:4] = length * moved(m, moments)
        columns = np.zeros((N, 10, N, 5))
        columns[np.arange(N), :, np.arange(N)] = known[:, :, None] * spread
        return columns.reshape(10 * N, 5 * N)

    @cached_property
    def common(self) -> Array:
        """Columns (10N, 1 + N + 4P): standard deviations that no log makes smaller.

        All masses of a file may be wrong by one factor, which looks like one of all torques, and
        each is off by some per cent. Each payload was weighed and measured.
        """
        known = np.where(self.robot.is_known, POOR, 1.0) * self.robot.parameters
        each = np.repeat(np.eye(len(known) // 10), 10, axis=0) * known[:, None]
        columns = [BODY * known, *(POOR * each).T]
        payloads = self.robot.payload_parameters.reshape(-1, 10)
        for body in np.flatnonzero(payloads[:, 0]).tolist():
            spread = np.zeros((*payloads.shape, 4))
            spread[body, :, 0] = SLIGHT * payloads[body]
            spread[body, :, 1:] = BODY * CENTRE_M * moved(payloads[body, 0], payloads[body, 1:4])
            columns += [*spread.reshape(-1, 4).T]
        return np.column_stack(columns)

    @cached_property
    def _nuisances(self) -> list[Array]:
        """Orthonormal columns (R, k) of each used joint: what a torque has besides bodies.

        The rotor of a stiff drive is among it if its inertia is unknown, and that a motor torque
        may be late, which is no mistake of a value.
        """
        found = []
        for j in self.used:
            columns, late = self.load_columns(j), self.torque_rate[:, [j]]
            if self._is_open[j] and j not in self._elastic:
                columns = np.hstack([columns, self.motor[2][:, [j]]])
            if np.all(np.isfinite(late)):
                columns = np.hstack([columns, late])
            found.append(np.linalg.qr(columns)[0])
        return found

    @cached_property
    def row_noise(self) -> Array:
        """Standard deviation (n,) of a torque over its size, per independent row."""
        misfit, per_row = self._by_any_bodies
        return np.asarray(np.maximum(misfit, FEW) * np.sqrt(per_row))

    @property
    def independent_rows(self) -> Array:
        """Independent rows (n,) of each joint, by the correlation of what any bodies leave."""
        return len(self.target) / self._by_any_bodies[1]

    def over_noise(self, torques: Array) -> Array:
        """Return torques (R, n, ...) without nuisances over their noise, joint by joint."""
        parts = []
        for j, Q in zip(self.used, self._nuisances, strict=True):
            noise = self.row_noise[j] * self._torque_sizes[j]
            parts.append((torques[:, j] - Q @ (Q.T @ torques[:, j])) / noise)
        return np.concatenate(parts)

    @cached_property
    def _of_common(self) -> tuple[Array, Array]:
        return _effects(self.over_noise(self.regressor @ self.common))

    @cached_property
    def _errors(self) -> tuple[Array, Array]:
        """Orthonormal effects U (rows, k) of errors of the robot file, and their sizes (k,).

        A size is that of the torques over their noise for one standard deviation.
        """
        return _effects(_whitened(self.over_noise(self.regressor @ self.widths), *self._of_common))

    def weighed(self, torques: Array) -> Array:
        """Return torques (R, n) as one column, weighed by noise and the errors of the robot file.

        That is generalised least squares. A joint whose torque is mostly that of a payload says
        more about it than one that carries the whole robot.
        """
        return _whitened(_whitened(self.over_noise(torques), *self._of_common), *self._errors)

    @cached_property
    def unexplained(self) -> Array:
        """What the bodies of the robot file leave of the torques, `weighed`."""
        return self.weighed(self.target - self.regressor @ self.bodies)

    def multiple(self, torques: Array) -> float:
        """Return the multiple of torques (R, n) that is in what the robot file leaves unexplained.

        It is that of generalised least squares, zero for torques that it does not see.
        """
        x = self.weighed(torques)
        size = float(x @ x)
        return float(x @ self.unexplained) / size if size > 0 else 0.0

    @cached_property
    def file(self) -> tuple[float, float]:
        """Minus the log likelihood of what the bodies of the robot file leave, and their scale s.

        With bodies of s times the usual widths the torques along each effect, of size z and in
        units of the noise, have the variance 1 + s^2 z^2, and s is that of the largest likelihood:
        the log shows how good its file is. The density of log s is 1 / s above 1, so that one file
        in ten is ten times worse than a usual one, and even below, down to 3 mm of a centre.
        """
        if not self.used or not np.all(np.isfinite(self.bodies)):
            return 0.0, 1.0
        U, sizes = self._errors
        y = self.over_noise(self.target - self.regressor @ self.bodies)
        along = U.T @ _whitened(y, *self._of_common)
        most = max(1.0, float(np.max(np.abs(along) / sizes, initial=0.0)))
        scales = np.geomspace(POOR, most, _SCALES)
        variance = 1 + (scales[:, None] * sizes) ** 2
        costs = np.sum(np.log(variance) + along**2 / variance, axis=1) / 2
        costs += np.log(np.maximum(scales, 1.0))
        return float(np.min(costs)), float(scales[np.argmin(costs)])

    @cached_property
    def in_motion(self) -> Experiment:
        """The experiment whose misfits are taken where the motor of a joint has a direction.

        The friction of a motor that stands is anything up to that of Coulomb. A joint with too few
        such instants has all.
        """
        few = np.sum(self._moving, axis=0) < _FEWEST_ROWS
        return replace(self, counted=np.asarray(self._moving | few))

    def _counted(self, j: int) -> BoolArray:
        """Return the mask (R,) of the instants at which the misfits of joint j are taken."""
        every = np.ones(len(self.target), dtype=bool)
        return every if self.counted is None else np.asarray(self.counted[:, j])

    @property
    def _elastic(self) -> list[int]:
        names = self.robot.elastic_joints
        known = [self.robot.index(joint) for joint in names]
        return [j for j in known if j in self.used]

    def _misfit(self, j: int, y: Array, columns: Array, stretch: int | None = None) -> float:
        """Return the misfit of joint j: of y (R,) by columns (R, k), friction first."""
        rows = self._counted(j)
        x = scaled_svd(columns[rows]).solve(y[rows])
        left = (y - columns @ x)[rows]
        if stretch is None:
            return self._size(j, left, x[:2])
        # a spring of negative stiffness explains nothing
        spring = columns[:, stretch] * x[stretch]
        wrong = float(np.std(spring)) if x[stretch] * self.lever[j] < 0 else 0.0
        size = max(float(np.std(y)), 1e-300)
        friction = x[:2] if stretch > 1 else np.zeros(2)
        return float(np.hypot(self._size(j, left, friction, size), wrong / size))

    def _size(self, j: int, left: Array, friction: Array, size: float = 0.0) -> float:
        """Return the rms of a residual and of friction that drives, over that of the torque."""
        size = size or self._torque_sizes[j]
        torque, speed = self.friction[j][:, :2] @ friction, self.motor[1][:, j]
        power = float(np.mean(torque * speed)) * float(np.sign(self.lever[j]))
        drives = max(-power, 0.0) / max(float(np.std(speed)), 1e-300)
        return float(np.hypot(np.std(left), drives)) / max(size, 1e-300)

    def cost(self, kind: str, rows: Array | float = 2.0) -> float:
        """Return minus the log likelihood of one kind of misfit, of Gaussian residuals of any size.

        Each joint has so many independent `rows`.
        """
        # not by `misfits`, which computes all kinds: of most transforms only cheap ones are needed
        name, floor = _KINDS[kind]
        squares = np.minimum(getattr(self, name), TWICE) ** 2 + floor**2
        return float(np.nansum(rows * np.log(squares))) / 2


def correlated_rows(residual: Array) -> float:
    """Return rows per independent one: the long-run variance over the variance (Bartlett)."""
    x = residual - np.mean(residual)
    power, lags = float(x @ x), round(2 * math.sqrt(len(x)))
    sums = [(1 - lag / (lags + 1)) * float(x[lag:] @ x[:-lag]) for lag in range(1, lags + 1)]
    return 1 + 2 * sum(sums) / power if power > 0 else 1.0


def _effects(B: Array) -> tuple[Array, Array]:
    """Return orthonormal effects U (rows, k) of columns (rows, m), and their sizes (k,)."""
    squares, V = safely(np.linalg.eigh, B.T @ B, what="nominal bodies", error=IdentificationError)
    kept = squares > RANK_TOLERANCE * squares[-1]
    sizes = np.sqrt(squares[kept])
    return B @ V[:, kept] / sizes, sizes


def _whitened(y: Array, U: Array, sizes: Array) -> Array:
    """Return rows (rows, ...) times (1 + B B^T)^(-1/2), with B = U diag(sizes)."""
    shrunk = ((1 - 1 / np.hypot(1, sizes)) * U) @ (U.T @ y)
    return np.asarray(y - shrunk)


def _first(columns: Array, y: Array, count: int) -> list[tuple[float, float]]:
    """Return the first parameters of a fit, one per part of y, negative, with standard errors."""
    x, covariance = fitted(columns, y, count)
    errors = np.sqrt(np.diag(covariance)[:count])
    return list(zip((-x[:count]).tolist(), errors.tolist(), strict=True))


def fitted(columns: Array, y: Array, count: int = 1) -> tuple[Array, Array]:
    """Return the parameters of a fit and their covariance, from the residuals of each part of y."""
    svd = scaled_svd(columns)
    rank = svd.rank(RANK_TOLERANCE)
    x = svd.solve(y, RANK_TOLERANCE)
    left = (y - columns @ x).reshape(count, -1)
    rows = np.sum(left != 0, axis=1)  # others are excluded
    sizes = np.linalg.norm(left, axis=1) / np.sqrt(np.maximum(rows - rank / count, 1))
    inverse = (svd.vectors[:rank] / svd.sizes[:rank, None]) / svd.norms
    # the first parameter of each part belongs to its residuals; all parts are weighed alike
    size = np.full(len(x), float(np.sqrt(np.mean(sizes**2))))
    size[:count] = sizes
    scaled = _CORRELATED * inverse * size
    return x, np.asarray(scaled.T @ scaled)


def _slope(columns: Array, y: Array) -> tuple[float, float]:
    """Return -b/a of the first columns, motor and joint angle, and its standard error.

    That of the fit, or of the halves of the rows if they differ by more; and, as in `gear_ratio`,
    the error of the gear, the smooth part of the residual: what rows that are no neighbours share,
    in time or in the angle, beyond the standard error of such a correlation of noise.
    """

    def part(rows: slice) -> tuple[float, float, Array]:
        used = columns[rows][:, np.any(columns[rows] != 0, axis=0)]  # zeros of encoders of its logs
        x, covariance = fitted(used, y[rows])
        slopes = np.array([x[1] / x[0] ** 2, -1 / x[0]])
        error = float(np.sqrt(slopes @ covariance[:2, :2] @ slopes))
        return float(-x[1] / x[0]), error, (y[rows] - used @ x) / x[1]

    slope, error, left = part(slice(None))
    count, joint = len(y), columns[:, 1]
    if count > 6 * columns.shape[1]:
        (first, e, _), (second, f, _) = part(slice(count // 2)), part(slice(count // 2, None))
        error = max(error, abs(first - second) * e * f / max(e**2 + f**2, _LEAST))
    by_angle = left[np.argsort(joint)]
    shared = max(float(left[2:] @ left[:-2]), float(by_angle[1:] @ by_angle[:-1])) / count
    smooth = np.sqrt(max(shared - float(left @ left) / count**1.5, 0.0))
    return slope, float(np.hypot(error, slope * smooth / max(float(np.std(joint)), _LEAST)))


_CORRELATED = 1.5
"""Standard errors for autocorrelated rows over those for white noise, for rows this far apart."""

_WIDTH = 0.1
"""Speed over the largest one at which friction may have another shape than Coulomb's."""

_TINY, _LEAST = 1e-9, 1e-300

_SCALES = 60
"""Widths of the bodies of a robot file that are compared, see `file`."""

_LOCKED = 0.02
"""Motion of a joint over that of its motor, behind the gear, up to which it counts as locked: it
shows no gear ratio, and what holds it yields too."""


def stands_locked(joint: Array, motor: Array) -> bool:
    """Return whether a joint stands still while its motor moves, both (T,) at the same side."""
    return bool(np.ptp(joint) < _LOCKED * np.ptp(motor))


_FEWEST_ROWS = 30
"""Fewest instants in motion of a joint: three for each of seven base parameters that a body adds
and of three columns of friction."""

_MOVING = 0.99
"""Mean sign of the speed behind the low pass below which a motor may have stuck: friction then
changes before the motion does, like an early torque."""


def experiment_of(robot: Robot, logs: Sequence[Sequence[Motion]]) -> Experiment:
    """Return the experiment at `INSTANTS` instants of the motions of each log."""
    split = [[part for motion in motions for part in _windows(motion)] for motions in logs]
    windows = [part for parts in split for part in parts]
    numbers = np.repeat(np.arange(len(split)), [len(parts) for parts in split])
    parts = [_sampled(robot, part, max(1, INSTANTS // len(windows))) for part in windows]
    motor, joint, direction, torque, rate, sensed, unscaled = (
        np.concatenate(one, axis=-2) for one in zip(*parts, strict=True)
    )
    drives = robot.drives.values()
    ratio = np.array([drive.ratio for drive in drives])
    apart = motor[0] - ratio * at_drives(robot.transmission, joint[0])
    both = np.ptp(apart, axis=0) > 1e-9 * np.ptp(motor[0], axis=0)
    inertia = np.array([drive.values.get("motor_inertia", 0.0) for drive in drives])
    bodies = robot.parameters + robot.payload_parameters
    if not np.any(robot.parameters):
        bodies = np.full_like(bodies, np.nan)  # a robot file without inertias
    log, rate_hz = np.repeat(numbers, [len(one[2]) for one in parts]), logs[0][0].rate_hz
    signals = motor, joint, direction, torque, rate, sensed, unscaled
    first = [motions[0].processing for motions in logs]
    sources = tuple((one and one.sources) or {} for one in first)
    has_wrenches = any(one.base and one.base.wrenches for motions in logs for one in motions)
    return Experiment(
        robot,
        log,
        rate_hz,
        *signals,
        both,
        ratio,
        inertia,
        bodies,
        sources,
        has_wrenches=has_wrenches,
    )


def with_torques_of(given: Experiment, joints: Collection[str]) -> Experiment:
    """Return the experiment of a fixed base with the torques of some joints only."""
    if given.robot.floating_base is not None:
        return given
    kept = np.isin(given.robot.joint_names, [*joints])
    torque, rate, sensed = (
        np.where(kept, one, np.nan) for one in (given.torque, given.torque_rate, given.sensed)
    )
    return replace(given, torque=torque, torque_rate=rate, sensed=sensed)


def _windows(motion: Motion) -> list[Motion]:
    """Return the motion, or windows of it if it is long."""
    count = len(motion.time)
    size = max(_WINDOW_SAMPLES, round(6 * motion.transient_s * motion.rate_hz))
    if count <= _WINDOWS * size:
        return [motion]
    starts = np.linspace(0, count - size, _WINDOWS).astype(int).tolist()
    return [motion.samples(slice(start, start + size)) for start in starts]


def _sampled(robot: Robot, motion: Motion, most: int) -> tuple[Array, ...]:
    rows = row_samples(motion)
    rows = rows[:: max(1, math.ceil(len(rows) / most))]
    filtered = partial(in_band_at, motion, samples=rows)
    speed = motion.motor_velocity
    sides = [
        [getattr(motion, f"{side}_{name}") for name in ("position", "velocity", "acceleration")]
        for side in ("motor", "joint")
    ]
    motor, joint = (np.stack([filtered(one) for one in side]) for side in sides)
    of_motors = _of_motors(robot, motion)
    torque = np.where(np.isnan(of_motors[0]), np.nan, in_band(motion, np.nan_to_num(of_motors)))
    rate = np.gradient(torque, motion.time, axis=0)[rows]
    sensed = torques_at_drives(robot.transmission, motion.joint_torque)
    sensed = np.where(np.isnan(sensed[0]), np.nan, filtered(np.nan_to_num(sensed)))
    unscaled = _unscaled(robot, motion)
    unscaled = np.where(np.isnan(unscaled[0]), np.nan, filtered(np.nan_to_num(unscaled)))
    return motor, joint, filtered(np.sign(speed)), torque[rows], rate, sensed, unscaled


def _of_motors(robot: Robot, motion: Motion) -> Array:
    """Return the motor torque (T, n), NaN for drives of which it is known up to scale only."""
    is_known = [
        INPUT_FIELDS[drive.motor_input] == "motor_torque" and not drive.is_up_to_scale
        for drive in robot.drives.values()
    ]
    return np.where(is_known, motion.motor_torque, np.nan)


def _unscaled(robot: Robot, motion: Motion) -> Array:
    """Return the current or voltage (T, n) of motors with an unknown constant, else NaN."""
    found = np.full(motion.motor_position.shape, np.nan)
    for j, drive in enumerate(robot.drives.values()):
        if drive.motor_input in ("current", "voltage"):
            channel = getattr(motion, INPUT_FIELDS[drive.motor_input])
            found[:, j] = np.nan if channel is None else channel[:, j]
    return found


@dataclass(frozen=True, eq=False)
class Transform:
    """A possible mistake: how to undo it, and the finding if that explains the log.

    `penalty`: number of fitted values, of the log likelihood as Akaike counts them, and less than
    one for what is unusual. `other`: the second of two joints that are concerned.
    """

    code: Code
    message: str
    undo: Callable[[Experiment], Experiment]
    joint: str = ""
    remedy: str = ""
    severity: Severity = "wrong"
    evidence: dict[str, float] = field(default_factory=dict)
    penalty: float = 0.0
    other: str = ""


_USUAL = (2.0, 3.0, 4.0, 5.0, 10.0, 100.0, 1000.0)


def with_constant(*columns: Array) -> Array:
    """Return columns (R, ...) next to a constant."""
    return np.column_stack([np.ones(len(columns[0])), *columns])


def near(factor: float, *others: float) -> list[float]:
    """Return a factor, and the usual ones within a fifth of it: mistakes are often round."""
    usual = [*_USUAL, *others, *(1 / one for one in (*_USUAL, *others))]
    return [*(one for one in usual if abs(math.log(factor / one)) < 0.2), factor]


def flipped(given: Experiment, j: int, channels: str) -> Experiment:
    """Return the experiment with the opposite sign of some channels of joint j."""
    return scaled(given, j, dict.fromkeys(channels, -1.0))


def scaled(
    given: Experiment, joints: int | Sequence[int], factors: Mapping[str, float]
) -> Experiment:
    """Return the experiment with channels (q, m, t) of one joint or several times factors."""
    own = np.isin(np.arange(given.robot.n), joints)
    factor = {one: np.where(own, factors.get(one, 1.0), 1.0) for one in "qmt"}
    return replace(
        given,
        joint=given.joint * factor["q"],
        motor=given.motor * factor["m"],
        direction=given.direction * np.sign(factor["m"]),
        torque=given.torque * factor["t"],
        torque_rate=given.torque_rate * factor["t"],
        sensed=given.sensed * factor["t"],
    )
