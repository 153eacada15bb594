"""An experiment: what the bodies of the robot file, and any bodies, explain of the `Instants`.

A possible mistake of a set-up is a `Transform`: the experiment without the mistake, and its
finding. Its value is searched, or a usual one near it.

Five misfits judge a set-up: how well the nominal bodies of the robot file predict the torque of
each joint, how well any bodies do, how well the motor equation (7) of a spring joint holds, and how
well the encoders of both sides agree, and the torques of both sides. Friction that would drive the
joint is none. The bodies of the file are uncertain: a torque is weighed by the noise and by their
errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from seaid._arrays import Array, FrozenMapping, safely
from seaid.checks import tolerances as tol
from seaid.checks.codes import Code, in_description, only_joint
from seaid.checks.instants import MOST_STEPS, OF_TORQUES, SIGNALS, Instants, derived, fitted
from seaid.errors import Finding
from seaid.estimation import qr_factor
from seaid.estimation.covariance import correlated_rows
from seaid.log.description import Entries
from seaid.regressor import BaseParameters, base_parameters
from seaid.robot import torques_at_drives

KINDS = {
    "of_sensors": (tol.FEW, "torque between motor and sensor"),
    "nominal": (tol.SLIGHT, "torque (by the bodies of the robot file)"),
    "of_encoders": (tol.FEW, "motion between the encoders"),
    "of_motors": (tol.FEW, "motor torque"),
    "free": (tol.FEW, "torque (by any bodies)"),
}
"""{kind of misfit, a property of `Experiment`: (size up to which it counts as none, words for what
it is a part of)}, the quickly computed ones first."""

SHORTLIST = 12
"""Number of joints, those with the largest misfits, of which all pairs with other joints are tried.
Also the number of transforms, the best by what is quickly computed, of which all misfits are."""

_SCALES = 60
"""Widths of the bodies of a robot file that are compared, see `file_cost`."""


def moved(mass: float, moments: Array) -> Array:
    """Return the change (10, 3) of a body by a shift of its centre along each axis, per metre.

    A mass m at c that moves by e has m e more as first moments, and m (2 (c.e) 1 - e c^T - c e^T)
    more as inertia.
    """
    # `outer` has e c^T of each axis e. Pinocchio's order of J: Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    outer = np.eye(3)[:, :, None] * moments
    J = 2 * moments[:, None, None] * np.eye(3) - outer - outer.swapaxes(1, 2)
    inertias = J[:, [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return np.vstack([np.zeros(3), mass * np.eye(3), inertias.T])


@dataclass(frozen=True, eq=False)
class TorqueScale:
    """The torque of a joint as a multiple of that of the bodies, next to any friction and rotor.

    `factor` and its standard `error`; `rotor`: inertia over the given one, NaN if none was given or
    is in the torque; `unexplained`: the part (rms, without the mean) of the torque that is left.
    """

    factor: float
    error: float
    rotor: float
    unexplained: float

    @property
    def shown(self) -> float:
        """The factor, zero if it may be zero: friction alone explains as much in any unit then."""
        return self.factor if abs(self.factor) > tol.SURE * self.error else 0.0


@dataclass(frozen=True, eq=False)
class Experiment(Instants):
    """Instants, and what bodies explain of their torques next to any friction and springs."""

    @cached_property
    def doubted(self) -> list[int]:
        """Used joints, of long robots those whose torques their files explain worst."""
        if not (self.has_bodies and len(self.used) > SHORTLIST):
            return self.used
        squares = np.sum(self.unexplained.reshape(len(self.used), -1) ** 2, axis=1)
        return sorted(np.array(self.used)[np.argsort(-squares)[:SHORTLIST]].tolist())

    @property
    def on_bodies(self) -> list[int]:
        """Used joints whose torque bodies explain: none on a base that unknown forces move."""
        return self.used if self.robot.base_is_held else []

    @property
    def has_bodies(self) -> bool:
        """Whether torques can be compared with those of bodies in the robot file."""
        return bool(self.on_bodies) and bool(np.all(np.isfinite(self.bodies)))

    @derived(*OF_TORQUES, "acting")
    def loads(self) -> Array:
        """Columns (n, R, k) of what acts on the load of each joint next to bodies: friction first.

        Springs that are declared parallel to a joint have any stiffness and preload; the constant
        of friction is one of theirs. That of a joint that slides is zero, since it would be the
        weight of bodies. Columns of springs that do not act on a joint are zero, and so is that of
        the rotor, which comes last, where its inertia is known.
        """
        robot, friction = self.robot, self.friction.copy()
        friction[~self.acting[0], :, :2] = 0.0
        friction[list(robot.is_prismatic), :, 2] = 0.0
        # tau_phi = C^-T tau: a spring at joint i acts on drive j with (C^-T)_ji of its torque.
        at_drives = torques_at_drives(robot.transmission, np.eye(robot.n))[self.sprung]
        springs = at_drives.T[:, None] * self.joint[0][:, self.sprung]
        rotors = (self.acting[1] * self._has_open_rotor * self.motor[2]).T[..., None]
        return np.concatenate([friction, springs, rotors], axis=2)

    @derived(*SIGNALS)
    def _of_loads(self) -> qr_factor.ScaledSVD:
        """The decomposition of the `loads` of joints at the instants that count."""
        return qr_factor.scaled_svd(self.loads * self.counted.T[..., None], "friction")

    @derived("robot")
    def base(self) -> BaseParameters:
        """The base parameters of all bodies, known ones included."""
        robot = replace(self.robot, known_bodies=(), at_rest=FrozenMapping({}, "joint"))
        return base_parameters(robot)

    def scale(self, j: int) -> TorqueScale:
        """Return the torque of joint j as a multiple of that of the bodies.

        It is that of the motor behind the gear, in which an unknown rotor has a column as a known
        one does, or that of the sensor.
        """
        y = self.lever[j] * self.torque[:, j]
        columns = [self.of_file[:, j], self.loads[j]]
        has_rotor = bool(np.all(np.isfinite(y)) and (self.inertia[j] > 0 or self._is_open[j]))
        # N r_L / r_M I_M theta_M'', which is among the loads of a stiff joint if I_M is unknown.
        if has_rotor and not self._has_open_rotor[j]:
            columns.append(self.lever[j] * self.motor[2][:, j])
        y = self.sensed[:, j] if np.all(np.isnan(y)) else y
        rows = self.counted[:, j]
        H, y = np.column_stack(columns)[rows], y[rows]
        x, covariance = fitted([H], y)
        unexplained = float(np.std(y - H @ x) / max(float(np.std(y)), tol.LEAST))
        rotor = float(x[-1] / self.inertia[j]) if has_rotor and self.inertia[j] else math.nan
        return TorqueScale(float(x[0]), math.sqrt(covariance[0, 0]), rotor, unexplained)

    @derived(*SIGNALS, "bodies")
    def scales(self) -> dict[int, TorqueScale]:
        """The scale of each used joint whose constant is known, none without bodies."""
        scaled = (j for j in self.on_bodies if not self.is_unscaled[j])
        return {j: self.scale(j) for j in scaled if self.has_bodies}

    @property
    def clear_scales(self) -> dict[int, TorqueScale]:
        """The scales that are well known, with which bodies explain the torque."""
        known = {j: x for j, x in self.scales.items() if x.error < tol.POOR * x.factor}
        return {j: x for j, x in known.items() if x.unexplained < tol.SEVERE}

    @derived("robot", "joint")
    def columns(self) -> Array:
        """The base columns (n, R, p) of the regressor, with all that it shows of bodies."""
        return np.ascontiguousarray(self.base.reduce(self.regressor).swapaxes(0, 1))

    @derived(*OF_TORQUES)
    def _rates(self) -> Array:
        """The rates (n, R) of motor torques, zero for others: a torque may be late by any time."""
        return np.where(np.all(np.isfinite(self.torque_rate), axis=0), self.torque_rate, 0.0).T

    @derived(*SIGNALS)
    def _factors(self) -> Array:
        """Triangular factors (u, m, p + 2) of the used joints, without their `loads`.

        Their columns are the base columns of bodies, the torque, and its rate. All sums of squares
        of misfits are in them (Frisch and Waugh 1933).
        """
        used, U = self.on_bodies, self._of_loads.spans[self.on_bodies]
        torques = np.stack([self.target.T, self._rates], axis=-1)[used]
        Z = np.concatenate([self.columns[used], torques], axis=2)
        Z *= self.counted.T[used, :, None]
        return np.asarray(np.linalg.qr(Z - U @ (U.swapaxes(1, 2) @ Z), mode="r"))

    @cached_property
    def nominal(self) -> Array:
        """Misfit (n,) of the nominal bodies with any friction, NaN without nominal bodies."""
        return self.of_bodies(self.bodies)

    def of_bodies(self, bodies: Array) -> Array:
        """Return the misfit (n,) of bodies (10n,) with any friction, NaN for unknown ones."""
        if not (self.on_bodies and np.all(np.isfinite(bodies))):
            return np.full(self.robot.n, np.nan)
        # not by `columns`, which most transforms of a set-up need for nothing else
        return self._over_torques(self._left_by((self.regressor @ bodies).T))

    @property
    def free(self) -> Array:
        """Misfit (n,) of any bodies with any friction."""
        return self._over_torques(self._left_by_any)

    @derived(*SIGNALS)
    def predicted(self) -> Array:
        """Misfit (n,) of any bodies with any friction in blocks that were excluded from their fit.

        Bodies that a hand pushes, or of a short motion, fit what they do not predict.
        """
        residual, count = np.zeros_like(self.target.T), len(self.target)
        # of eight segments each of four blocks has two, so that the others surround it in time
        block = np.arange(count) * 8 // count % 4
        for inside in np.equal.outer(range(4), block):
            others = self.with_changes(counted=self.counted & ~inside[:, None])
            residual[:, inside] = others._left_by_any[:, inside]
        return self._over_torques(residual)

    @derived(*SIGNALS)
    def _left_by_any(self) -> Array:
        """Residuals (n, R) of used joints next to any bodies with any friction."""
        used, torques = self.on_bodies, np.zeros_like(self.target.T)
        if not used:
            return torques
        # Each joint counts alike: its equations are over the size of its torque.
        R = self._factors[..., :-1] / self._torque_sizes[used, None, None]
        # bodies of a motor without a constant have no scale in common with those of others
        groups = [[k for k, j in enumerate(used) if not self.is_unscaled[j]]]
        groups += [[k] for k, j in enumerate(used) if self.is_unscaled[j]]
        for group in filter(None, groups):
            factor = qr_factor.triangle(R[group].reshape(-1, R.shape[2]))
            svd = qr_factor.scaled_svd(factor[:, :-1])
            theta = svd.solve(factor[:, -1], qr_factor.RANK_TOLERANCE)
            joints = np.array(used)[group]
            torques[joints] = self.columns[joints] @ theta
        possible = self._possible(torques)
        return self._next_to(torques) if possible is None else possible._left_by_any

    def _left_by(self, torques: Array) -> Array:
        """Return residuals (n, R) next to torques (n, R) of bodies, with possible loads."""
        possible = self._possible(torques)
        return self._next_to(torques) if possible is None else possible._left_by(torques)

    def _next_to(self, torques: Array) -> Array:
        """Return residuals (n, R) next to torques (n, R) of bodies, with the loads that fit."""
        y = self.target.T - torques
        return np.asarray(y - (self.loads @ self._of_loads.inverses @ y[..., None])[..., 0])

    def _possible(self, torques: Array) -> Experiment | None:
        """Return the experiment without friction that drives, or rotors of a negative inertia.

        That is next to torques (n, R) of bodies. None if all loads of this one are possible.
        """
        used, acting = self.on_bodies, self.acting.copy()
        y = (self.target.T - torques)[used]
        x = self._of_loads.inverses[used] @ y[..., None]
        least = tol.FEW * self._torque_sizes[used]
        rotors = x[:, -1, 0] * np.std(self.loads[used, :, -1], axis=1)
        acting[:, used] &= [self._driving(used, x[:, :2]) <= least, rotors >= -least]
        is_same = np.all(acting == self.acting)
        return None if is_same else self.with_changes(acting=acting)

    def _over_torques(self, residual: Array) -> Array:
        """Return misfits (n,) by residuals (n, R), NaN of joints that no bodies explain."""
        misfit, used = np.full(self.robot.n, np.nan), self.on_bodies
        # The mean is zero, because a constant is among the loads.
        squares = np.sum((self.counted.T * residual**2)[used], axis=1)
        sizes = np.maximum(self._torque_sizes[used], tol.LEAST)
        misfit[used] = np.sqrt(squares / np.sum(self.counted, axis=0)[used]) / sizes
        return misfit

    @derived(*SIGNALS)
    def _rows_per_independent(self) -> Array:
        """Rows (n,) per independent one, by the correlation of what any bodies leave."""
        per_row = np.full(self.robot.n, tol.CORRELATED_ROWS)
        for j in self.on_bodies:
            rows = self._left_by_any[j, self.counted[:, j]]
            per_row[j] = max(tol.CORRELATED_ROWS, correlated_rows(rows))
        return per_row

    @derived(*SIGNALS)
    def of_motors(self) -> Array:
        """Misfit (n,) of the motor equation (7) with any spring and friction, or of (4b)."""
        misfit = np.full(self.robot.n, np.nan)
        for j in self._elastic:
            # a torque that is late is no other mistake
            y = self.torque[:, j] - self.rotor[j] * self.motor[2][:, j]
            columns = [self.friction[j], self.torque_rate[:, j]]
            if not np.all(np.isfinite(y)):  # (4b) alone: the torque of the sensor
                # tau_L / lever = k r_M / N stretch + c, with the zeros of all sensors in c.
                y, columns = self.sensed[:, j] / self.lever[j], [self.friction[j][:, 2]]
            misfit[j] = self._of_spring_law(j, y, np.column_stack([*columns, self.apart[:, j]]))
        return misfit

    @derived(*SIGNALS)
    def of_encoders(self) -> Array:
        """Misfit (n,) between both encoders, but for a constant and a deflection by the torque."""
        misfit, constant = np.full(self.robot.n, np.nan), np.ones_like(self.direction[:, :1])
        for j in np.flatnonzero(self.both).tolist():
            columns = np.hstack([constant, self.deflection(j)])
            apart = qr_factor.residual_of(self.apart[:, j], columns)
            misfit[j] = float(np.std(apart)) / max(float(np.std(self.turned[0][:, j])), tol.LEAST)
        return misfit

    @derived(*OF_TORQUES)
    def of_sensors(self) -> Array:
        """Misfit (n,) between the torques of motor and sensor, but for friction."""
        misfit = np.full(self.robot.n, np.nan)
        for j in np.flatnonzero(self.has_both_torques).tolist():
            target, sensed, columns = self._of_sensor(j)
            apart = qr_factor.residual_of(target - sensed, columns)
            misfit[j] = float(np.std(apart)) / max(float(np.std(sensed)), tol.LEAST)
        return misfit

    @cached_property
    def sensor_scales(self) -> dict[int, tuple[float, float]]:
        """Torques of sensors over those of the motors behind the gears, and errors, if well known.

        Noise makes the slope of direct regression too small and that of the reverse one too large:
        the factor is their geometric mean, and its error contains half of their difference.
        """
        scales = {}
        for j in np.flatnonzero(self.has_both_torques).tolist():
            target, sensed, columns = self._of_sensor(j)
            x, covariance = fitted([target, columns], sensed)
            inverse = fitted([sensed, columns], target)[0][0]
            if x[0] * inverse > 0:
                slope = math.copysign(math.sqrt(x[0] / inverse), x[0])
                error = math.hypot(math.sqrt(covariance[0, 0]), (1 / inverse - x[0]) / 2)
                scales[j] = slope, error
        return {j: x for j, x in scales.items() if x[1] < tol.POOR * abs(x[0])}

    def _of_sensor(self, j: int) -> tuple[Array, Array, Array]:
        """Return the torques (R,) of the motor and of the sensor, and columns of what is between.

        That is any friction, also one that grows with the load, as that of an efficiency does.
        """
        rows = self._moving[:, j] | (np.sum(self._moving[:, j]) < tol.FEWEST_INSTANTS)
        grows = np.abs(self.sensed[:, j]) * self.direction[:, j]
        columns = [self._any_friction(j, bool(self._has_open_rotor[j])), grows]
        return self.target[rows, j], self.sensed[rows, j], np.column_stack(columns)[rows]

    @cached_property
    def misfits(self) -> dict[str, Array]:
        """All misfits (n,) by kind."""
        return {kind: getattr(self, kind) for kind in KINDS}

    def pairs(self, joints: Iterable[int]) -> Iterator[tuple[int, int]]:
        """Return the pairs of joints of which one has a large misfit, of n joints O(n)."""
        # Both need not have one: a joint whose torque does not change has no misfit.
        largest = np.max(np.nan_to_num([*self.misfits.values()]), axis=0)
        worst = {*np.argsort(-largest, kind="stable")[:SHORTLIST].tolist()}
        return (pair for pair in combinations(joints, 2) if not worst.isdisjoint(pair))

    @derived("robot")
    def widths(self) -> Array:
        """Columns (10N, 5N): one standard deviation of each body of the robot file.

        A body of mass m at c is wrong by dm (all of it in proportion), by dc, which adds m dc to
        its first moments and m (2 (c.dc) 1 - dc c^T - c dc^T) to its inertia, and by its inertia.
        Known bodies are wrong by little.
        """
        blocks, total = list[Array](), np.sum(np.abs(self.robot.parameters[::10]))
        for body in self.robot.parameters.reshape(-1, 10):
            mass, size = abs(body[0]), float(np.linalg.norm(body[1:4]))
            # cables, screws and covers weigh much next to a small body, little next to a large one
            share = np.clip(tol.SLIGHT * total / max(mass, tol.LEAST), tol.BODY, 1.0)
            length = max(tol.CENTRE_M, tol.BODY * size / max(mass, tol.LEAST))
            # All six moments of inertia by the same half of their values: the body keeps its shape.
            inertia = np.where(np.arange(10) < 4, 0.0, tol.MOST * body)
            blocks.append(np.column_stack([share * body, length * moved(mass, body[1:4]), inertia]))
        known = np.where(self.robot.is_known, tol.POOR, 1.0)
        return np.asarray(known[:, None] * block_diag(*blocks))

    @derived("robot")
    def common(self) -> Array:
        """Columns (10N, 1 + N + 4P): standard deviations that no log makes smaller.

        All masses of a file may be wrong by one factor, which looks like one of all torques, and
        each is off by some per cent. Each payload was weighed and measured.
        """
        known = np.where(self.robot.is_known, tol.POOR, 1.0) * self.robot.parameters
        # (10N,) all masses by one factor, and (10N, N) each body alone in its column.
        columns = [tol.BODY * known, tol.POOR * block_diag(*known.reshape(-1, 10)).T]
        payloads = self.robot.payload_parameters.reshape(-1, 10)
        for body in np.flatnonzero(payloads[:, 0]):
            place = tol.BODY * tol.CENTRE_M * moved(payloads[body, 0], payloads[body, 1:4])
            spread = np.column_stack([tol.SLIGHT * payloads[body], place])
            columns.append(np.kron(np.eye(len(payloads))[:, [body]], spread))
        return np.column_stack(columns)

    @property
    def independent_rows(self) -> Array:
        """Independent rows (n,) of each joint, by the correlation of what any bodies leave."""
        return len(self.target) / self._rows_per_independent

    @derived(*SIGNALS)
    def _noise(self) -> Array:
        """Standard deviation (u, 1, 1) of a torque that is no error of bodies, per independent row.

        It is that of the used joints.
        """
        misfit, per_row = self.free, self._rows_per_independent
        # R rows with a noise that is sqrt(r) times as large have the information of R / r rows.
        noise = np.maximum(misfit, tol.FEW) * np.sqrt(per_row) * self._torque_sizes
        return noise[self.on_bodies, None, None]

    @derived(*SIGNALS)
    def _nuisances(self) -> Array:
        """Orthonormal columns (u, R, k) of each used joint: what a torque has besides bodies."""
        columns = np.concatenate([self.loads, self._rates[..., None]], axis=2)[self.on_bodies]
        return qr_factor.scaled_svd(columns * self.counted.T[self.on_bodies, :, None]).spans

    def over_noise(self, torques: Array) -> Array:
        """Return torques (R, n, ...) without nuisances over their noise, joint by joint."""
        parts, Q = torques.swapaxes(0, 1)[self.on_bodies], self._nuisances
        columns = parts.reshape(*parts.shape[:2], -1) * self.counted.T[self.on_bodies, :, None]
        columns = (columns - Q @ (Q.swapaxes(1, 2) @ columns)) / self._noise
        return columns.reshape(-1, *torques.shape[2:])

    @derived(*SIGNALS)
    def _seen(self) -> Array:
        """The triangular factor (p + 1, p + 1) of base columns and torque, `over_noise`."""
        bodies, rates = self._factors[..., :-1], self._factors[..., -1:]
        rates = qr_factor.scaled_svd(rates).spans
        R = (bodies - rates @ (rates.swapaxes(1, 2) @ bodies)) / self._noise
        return qr_factor.triangle(R.reshape(-1, R.shape[2]))

    @derived(*SIGNALS)
    def _effects(self) -> list[tuple[Array, Array]]:
        """Base parameters (p, k) of `common` errors, and of those of the file next to these.

        The torques of each are orthonormal, over the noise. Sizes (k,) are those of the torques for
        one standard deviation.
        """
        R, effects = self._seen[:, :-1], list[tuple[Array, Array]]()
        for errors in (self.common, self.widths):
            # (1 - R T S T^T R^T) R W = R (W - T S T^T R^T R W), see `whitened`
            W = self.base.project(errors)
            for theta, sizes in effects:
                W = W - qr_factor.shrunk(theta, sizes) @ (R.T @ (R @ W))
            squares, V = safely(np.linalg.eigh, W.T @ R.T @ R @ W, what="nominal bodies")
            # The tolerance is on squares: an effect counts down to 3e-4 of the largest one.
            kept = squares > qr_factor.RANK_TOLERANCE * squares[-1]
            sizes = np.sqrt(squares[kept])
            effects.append((W @ V[:, kept] / sizes, sizes))
        return effects

    @derived(*SIGNALS)
    def _rows(self) -> Array:
        """The base columns (u R, p) `over_noise`."""
        return self.over_noise(self.columns.swapaxes(0, 1))

    def weighed(self, torques: Array) -> Array:
        """Return torques (R, n, ...) as columns, weighed by noise and the errors of the robot file.

        That is generalised least squares. A joint whose torque is mostly that of a payload says
        more about it than one that carries the whole robot.
        """
        return qr_factor.whitened(self.over_noise(torques), self._rows, self._effects)

    @cached_property
    def unexplained(self) -> Array:
        """What the bodies of the robot file leave of the torques, `weighed`."""
        return self.weighed(self.target - self.of_file)

    def multiple(self, torques: Array) -> tuple[float, float]:
        """Return the multiple of torques (R, n) that is in what the robot file leaves unexplained.

        It is that of generalised least squares, with its standard error, which is infinite for
        torques that it does not see.
        """
        x = self.weighed(torques)
        size = float(x @ x)
        return (float(x @ self.unexplained) / size, size**-0.5) if size > 0 else (0.0, math.inf)

    @cached_property
    def computed(self) -> Experiment:
        """The experiment with the torques of the bodies of the robot file in place of the logged.

        Torques that were not logged stay unknown.
        """
        torque = self.of_file / self.lever + self.rotor * self.motor[2]
        return self.with_changes(
            effort=np.where(np.isnan(self.torque), np.nan, torque / self.constants),
            sensed=np.where(np.isnan(self.sensed), np.nan, self.of_file),
        )

    @cached_property
    def file_cost(self) -> float:
        """Minus the log likelihood of the torques that the bodies of the robot file leave.

        With bodies of s times the usual widths the torques along each effect, of size z and in
        units of the noise, have the variance 1 + s^2 z^2, and s is that of the largest likelihood:
        the log shows how good its file is. The density of log s is 1 / s above 1, so that one file
        in ten is ten times worse than a usual one, and even below, down to 3 mm of a centre.
        """
        if not self.has_bodies:
            return 0.0
        R, torque, (common, (errors, sizes)) = self._seen[:, :-1], self._seen[:, -1], self._effects
        y = torque - R @ self.base.project(self.bodies)
        along = errors.T @ R.T @ qr_factor.whitened(y, R, [common])
        # An effect y is most likely at a scale s < |y| / z: beyond the largest of these all effects
        # become less likely.
        most = max(1.0, float(np.max(np.abs(along) / sizes, initial=0.0)))
        scales = np.geomspace(tol.POOR, most, _SCALES)
        variance = 1 + (scales[:, None] * sizes) ** 2
        costs = np.sum(np.log(variance) + along**2 / variance, axis=1) / 2
        return float(np.min(costs + np.log(np.maximum(scales, 1.0))))

    @cached_property
    def in_motion(self) -> Experiment:
        """The experiment whose misfits are taken where the motor of a joint has a direction.

        The friction of a motor that stands is anything up to that of Coulomb; a sensor behind it
        feels none. A joint with too few such instants has all.
        """
        shown = self.counted & (self._moving | np.isnan(self.torque))
        few = np.sum(shown, axis=0) < tol.FEWEST_INSTANTS
        return self.with_changes(counted=np.where(few, self.counted, shown))

    def _of_spring_law(self, j: int, y: Array, columns: Array) -> float:
        """Return the misfit of y (R,) by columns (R, k), the last one of a spring.

        With a motor torque the first two columns are those of friction. The torque sensor has no
        friction: (4b) has two columns, a constant and the spring. Friction that drives and a spring
        of negative stiffness are none.
        """
        rows, size = self.counted[:, j], max(float(np.std(y)), tol.LEAST)
        x = qr_factor.scaled_svd(columns[rows]).solve(y[rows])
        is_possible = np.full(len(x), fill_value=True)
        is_possible[-1] = x[-1] >= 0
        if len(x) > 2:
            is_possible[:2] = self._driving([j], x[None, :2, None]) <= tol.FEW * size
        if not np.all(is_possible | ~np.any(columns, axis=0)):
            return self._of_spring_law(j, y, columns * is_possible)
        return float(np.std((y - columns @ x)[rows])) / size

    def _driving(self, joints: Sequence[int], friction: Array) -> Array:
        """Return the size (u,) of friction (u, 2, 1) of joints that drives."""
        torque, speed = self.friction[joints, :, :2] @ friction, self.motor[1].T[joints]
        # A friction torque of the sign of the speed takes power; one that gives power drives.
        power = np.mean(torque[..., 0] * speed, axis=1)
        return np.asarray(np.maximum(-power, 0.0) / np.maximum(np.std(speed, axis=1), tol.LEAST))

    def cost(self, kind: str, rows: Array | float = 2.0) -> float:
        """Return minus the log likelihood of one kind of misfit, of Gaussian residuals of any size.

        Each joint has so many independent `rows`.
        """
        # not by `misfits`, which computes all kinds: of most transforms only cheap ones are needed
        # n / 2 log(rms^2): the likelihood of Gaussian residuals at their most likely size.
        squares = np.minimum(getattr(self, kind), tol.TWICE) ** 2 + KINDS[kind][0] ** 2
        return float(np.nansum(rows * np.log(squares))) / 2


def with_torques_of(experiment: Experiment, joints: Collection[str]) -> Experiment:
    """Return the experiment of a fixed base with the torques of some joints only."""
    kept = np.isin(experiment.robot.joint_names, [*joints])
    if np.all(kept) or not experiment.robot.base_is_held:
        return experiment
    return experiment.with_channels("ts", lambda torque: np.where(kept, torque, np.nan))


@dataclass(frozen=True, eq=False)
class Transform:
    """A possible mistake: the experiment `changed` to be without it, and its finding.

    `penalty` is subtracted from the gain of the log likelihood: the number of fitted values, as
    Akaike counts them, or less than one for what is unusual. `channels`: q, m, t and s that it
    multiplies. `sources` are what changes in the description of the log; its lines stand before the
    remedy of the finding. `log` is the number of the log, from 0, of a mistake that the others do
    not have.
    """

    finding: Finding
    changed: Experiment
    penalty: float = 0.0
    channels: str = ""
    sources: Entries = field(default_factory=dict)
    log: int | None = None

    @property
    def lines(self) -> str:
        """The whole remedy as text."""
        log = "the log" if self.log is None else f"log {self.log + 1}"
        described = in_description(self.sources, log) if self.sources else ""
        return "\n".join(filter(None, [described, self.finding.remedy]))


def multiplied(
    code: Code,
    case: str,
    experiment: Experiment,
    factors: Mapping[int, float],
    channels: str,
    evidence: Mapping[str, Any] = FrozenMapping({}),
    penalty: float = 0.0,
    **more: Any,
) -> Transform:
    """Return the transform that multiplies logged channels (q, m, t, s) of joints by factors.

    Its finding is a case of a code, whose sentence begins with the subject.
    """
    names = experiment.robot.joint_names
    entries = {names[j]: experiment.entries(j, channels, factor=x) for j, x in factors.items()}
    words = {"subject": experiment.subject([*factors], channels), **evidence}
    finding = code.finding(case, only_joint([*entries]), words, **more)
    return Transform(finding, experiment.scaled(factors, channels), penalty, channels, entries)


_USUAL = (2.0, 3.0, 4.0, 5.0, 10.0, 100.0, 1000.0)
"""Factors by which units, prefixes and ratios are often wrong; see `near`."""


def near(factor: float, *others: float) -> list[float]:
    """Return a factor, and the usual ones within a fifth of it: mistakes are often round."""
    usual = [*_USUAL, *others, *(1 / x for x in (*_USUAL, *others))]
    return [*(x for x in usual if abs(math.log(factor / x)) < 2 * tol.POOR), factor]


Change = Callable[[Experiment, float], Experiment]
"""The experiment with another value of its set-up; 0 changes nothing, and changes add up."""

STEP = 1e-3
"""Step of a difference quotient."""


def scaling(joints: Sequence[int], channels: str) -> Change:
    """Return the change by a factor on channels of joints, whose value is its logarithm."""
    return lambda x, value: x.scaled(dict.fromkeys(joints, math.exp(value)), channels)


def best_value(experiment: Experiment, change: Change, start: float = 0.0) -> tuple[float, float]:
    """Return the value of a change with which the bodies of the file explain most, and its error.

    A value that the torques do not show, or that is not found, is zero with an infinite error.
    """
    (value,), (error,), is_found = best_values(experiment, [change], np.array([start]))
    return (float(value), float(error)) if is_found else (0.0, math.inf)


def best_values(
    experiment: Experiment, changes: Sequence[Change], starts: Array
) -> tuple[Array, Array, bool]:
    """Return the values (k,) of changes with which the bodies of the file explain most.

    Next come their standard errors (k,), with the errors of these bodies, and whether the torques
    show all of them. The steps are those of Gauss and Newton. Computed torques in place of the
    logged ones are the instruments, because noise of a torque that is changed would bias least
    squares.
    """
    values, errors = starts.astype(float), np.full(len(changes), np.inf)
    changed = weights = _changed(experiment, changes, values)
    for _ in range(MOST_STEPS * experiment.has_bodies):
        # of a long robot, whose factors take a second, the weights are those of the start
        weights = changed if len(experiment.used) <= SHORTLIST else weights
        left, computed = changed.target - changed.of_file, changed.computed
        effects, instruments = list[Array](), list[Array]()
        for change in changes:
            ahead = change(changed, STEP)
            effects.append(ahead.target - ahead.of_file - left)
            of_computed = change(computed, STEP).target - computed.target
            instruments.append(of_computed + changed.of_file - ahead.of_file)
        torques = weights.weighed(np.stack([*effects, *instruments, left], axis=-1))
        X, Z = torques[:, : len(changes)] / STEP, torques[:, len(changes) : -1] / STEP
        # Z^T (u + X d) = 0 for steps d, where u is unexplained: Z^T u has the covariance Z^T Z
        inverse = qr_factor.scaled_svd(Z.T @ X).inverses
        step, spread = -inverse @ (Z.T @ torques[:, -1]), np.linalg.norm(inverse @ Z.T, axis=1)
        errors = np.where(spread > 0, spread, np.inf)  # also if a change has no effect
        # a first step that is no more than its error needs no second one
        enough = np.where(values, tol.POOR * np.maximum(errors, tol.SLIGHT), tol.SURE * errors)
        values = values + np.clip(step, -tol.MOST, tol.MOST)
        is_shown = bool(np.all(errors < tol.MOST))
        if not is_shown or np.all(np.abs(step) < enough):
            return values, errors, is_shown
        changed = _changed(experiment, changes, values)
    return values, errors, False


def _changed(experiment: Experiment, changes: Sequence[Change], values: Array) -> Experiment:
    """Return the experiment after changes by values, but not by nothing, which derives it anew."""
    for change, value in zip(changes, values.tolist(), strict=True):
        experiment = change(experiment, value) if value else experiment
    return experiment


def best_factors(
    experiment: Experiment, change: Change, least: float = tol.SURE, smallest: float = tol.SLIGHT
) -> Iterator[tuple[float, float, float]]:
    """Yield factors near the `best_value` of their logarithm as (factor, relative error, penalty).

    They are the fitted one, whose penalty is 1, and the usual ones near it, which are no fitted
    number and have none. There are none if the factor may be 1, within the `least` errors, or is
    off by less than the `smallest` part.
    """
    log_factor, error = best_value(experiment, change)
    if abs(log_factor) > max(smallest, least * error):
        fitted = math.exp(log_factor)
        yield from ((factor, error, float(factor == fitted)) for factor in near(fitted))
