"""Bent parameters of stiff drives: found on the load side, beside all bodies, joint by joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import linalg

from seaid.arrays import Array, IndexArray
from seaid.base import base_parameters
from seaid.drive_signals import fed_signals, motor_regressor
from seaid.drivetrain.catalogue import PARAMETERS
from seaid.drivetrain.model import Drive
from seaid.drivetrain.regressor import DriveRegressor
from seaid.estimation.estimate import Estimate
from seaid.estimation.information import Information, information_of
from seaid.estimation.projection import projected
from seaid.estimation.solve import equal_weights, estimate_of, ordinary, solve
from seaid.linear_algebra import safely
from seaid.motion import Motion
from seaid.motion_rows import in_band_at, row_samples
from seaid.regression import Regression, actuator_regression, stacked
from seaid.robot import Robot
from seaid.sides.bent import Scale, bounds_of, starts_of
from seaid.sides.found import spring_of, with_values
from seaid.sides.load_model import LoadModel, load_model
from seaid.sides.load_side import load_regression, unknown_friction
from seaid.sides.untold import told

_SWEEPS = 2
"""How often the joints are searched in turn, each beside the others."""

_LEVELS = ("coulomb_friction", "stribeck_friction")
"""What must not be zero at the start: the slope of what bends is a multiple of it."""

_LOST = 1e-9

_FEW = 1e-3
"""Of two equations' weights the smaller over the larger is no less."""


@dataclass(frozen=True, eq=False)
class LoadFit:
    """A fit of the load side: its columns, the springs' values, the estimate and its rows."""

    model: LoadModel
    springs: Mapping[str, Array]
    estimate: Estimate
    rows: Regression
    information: Information


def bent_joints(robot: Robot, used: Sequence[str]) -> tuple[str, ...]:
    """Return the joints among `used` whose stiff drive is not linear in its parameters."""
    return tuple(
        joint
        for joint in used
        if joint not in robot.elastic_joints and motor_regressor(robot, joint).non_linear
    )


def straightened_load(robot: Robot, motions: Sequence[Motion], used: Sequence[str]) -> Robot:
    """Return the robot with the values near which its stiff drives' equations are taken."""
    bent = bent_joints(robot, used)
    if not bent:
        return robot
    scales = {joint: _scale(robot, motions, joint) for joint in bent}
    given, robot = robot.drivetrains, _started(robot, scales)
    for sweep in range(1 if len(bent) == 1 else _SWEEPS):
        for joint in bent:
            grid = [] if sweep else _grid(robot, joint, given[joint], scales[joint])
            robot = _searched(robot, motions, used, joint, scales[joint], grid)
    for joint in bent:
        search = _load_search(robot, motions, joint, fit_load(robot, motions, used))
        drive, names = robot.drivetrains[joint], search.regressor.non_linear
        columns = search.all_columns(drive.values)
        held = told(drive, (*search.linear, *names), columns, names)
        robot = robot.with_drivetrains({joint: held})
    return robot


def _grid(robot: Robot, joint: str, given: Drive, scale: Scale) -> list[Array]:
    names = motor_regressor(robot, joint).non_linear
    return [np.array(one) for one in product(*(starts_of(n, given, {}, scale) for n in names))]


def fit_load(robot: Robot, motions: Sequence[Motion], used: Sequence[str]) -> LoadFit:
    """Fit the load side by weighted least squares, the springs by ordinary ones before it."""
    model = load_model(robot, base_parameters(robot, rows=used), used)
    springs = {}
    for joint in (joint for joint in used if joint in robot.elastic_joints):
        index = robot.index(joint)
        if not all(np.all(np.isfinite(one.joint_torque[:, index])) for one in motions):
            rows = stacked([actuator_regression(robot, motion, joint) for motion in motions])
            springs[joint] = spring_of(robot, ordinary(rows), joint).values
    rows = stacked([load_regression(robot, motion, model, springs) for motion in motions])
    information = information_of(rows)
    estimate = estimate_of(information, _weights(information))
    return LoadFit(model, springs, estimate, rows, information)


def _weights(information: Information) -> Array:
    """Return weights (E,) of the equations by what an ordinary fit leaves, within limits.

    Settled ones are for the estimate: here the model is not right yet.
    """
    theta = solve(information, equal_weights(information)).values
    std = information.residual_norms(theta) / np.sqrt(np.maximum(information.counts, 1))
    largest = float(np.max(std))
    return largest / np.maximum(std, _FEW * largest) if largest else equal_weights(information)


def _scale(robot: Robot, motions: Sequence[Motion], joint: str) -> Scale:
    index = robot.index(joint)
    return Scale(max(float(np.max(np.abs(one.motor_velocity[:, index]))) for one in motions), 0, 1)


def _started(robot: Robot, scales: Mapping[str, Scale]) -> Robot:
    """Return the robot with a value of every bent parameter, and small ones of what bends them."""
    drives = dict(robot.drivetrains)
    for joint, scale in scales.items():
        drive, regressor = drives[joint], motor_regressor(robot, joint)
        values = {
            name: 1.0 if name in _LEVELS else starts_of(name, drive, {}, scale)[0]
            for name in regressor.names
            if name in PARAMETERS and name not in drive.values
        }
        drives[joint] = drive.with_values(values)
    return robot.with_drivetrains(drives)


def _searched(
    robot: Robot,
    motions: Sequence[Motion],
    used: Sequence[str],
    joint: str,
    scale: Scale,
    starts: Sequence[Array],
) -> Robot:
    """Return the robot with better bent parameters of one joint, all others held."""
    fit, drive = fit_load(robot, motions, used), robot.drivetrains[joint]
    search = _load_search(robot, motions, joint, fit)
    names = search.regressor.non_linear
    starts = [np.array([drive.values[name] for name in names]), *starts]
    lower, upper = (np.array([bounds_of(name, scale)[end] for name in names]) for end in (0, 1))
    found = projected(search.columns, search.slopes, starts, lower, upper)
    values = dict(zip(names, found.bent.tolist(), strict=True))
    values |= dict(zip(search.linear, found.linear.tolist(), strict=True))
    return robot.with_drivetrains({joint: with_values(drive, values)})


@dataclass(frozen=True, eq=False)
class _LoadSearch:
    """The rows of the load side as functions of one stiff drive's bent parameters.

    `others` (R, rank) spans the weighted columns of all else, which are projected out; `mine` (R,)
    are the rows of the drive's own joint, `y` (R,) the weighted target, `weight` the joint's.
    `zeta` (T,) of each motion is what `y` was made of.
    """

    regressor: DriveRegressor
    linear: tuple[str, ...]
    ratio: float
    motions: Sequence[Motion]
    signals: Sequence[Mapping[str, Array]]
    samples: Sequence[IndexArray]
    zeta: Sequence[Array]
    mine: IndexArray
    y: Array
    weight: float
    others: Array

    def columns(self, bent: Array) -> tuple[Array, Array]:
        """Return y and the drive's linear columns, both without what the others make up for."""
        values = dict(zip(self.regressor.non_linear, bent.tolist(), strict=True))
        places = [self.regressor.linear.index(name) for name in self.linear]
        pairs = [self.regressor.given(one, values) for one in self.signals]
        changes = [zeta - old for (zeta, _), old in zip(pairs, self.zeta, strict=True)]
        y = self.y.copy()
        y[self.mine] += self._banded(changes)
        return self._alone(y), self._alone(self._placed([H[:, places] for _, H in pairs]))

    def slopes(self, bent: Array, linear: Array) -> Array:
        """Return the columns of the bent parameters in the same way."""
        drive = self.regressor.drive.values
        values = {**drive, **dict(zip(self.regressor.non_linear, bent.tolist(), strict=True))}
        values |= dict(zip(self.linear, linear.tolist(), strict=True))
        places = [self.regressor.names.index(name) for name in self.regressor.non_linear]
        parts = [self.regressor.evaluate(one, values)[1][:, places] for one in self.signals]
        return self._alone(self._placed(parts))

    def all_columns(self, values: Mapping[str, float]) -> Array:
        """Return the linear columns and then the bent ones near some values."""
        bent = np.array([values[name] for name in self.regressor.non_linear])
        linear = np.array([values[name] for name in self.linear])
        return np.hstack([self.columns(bent)[1], self.slopes(bent, linear)])

    def _placed(self, parts: Sequence[Array]) -> Array:
        columns = np.zeros((len(self.y), parts[0].shape[1]))
        columns[self.mine] = self._banded(parts)
        return columns

    def _banded(self, parts: Sequence[Array]) -> Array:
        triples = zip(self.motions, parts, self.samples, strict=True)
        banded = [in_band_at(motion, part, samples) for motion, part, samples in triples]
        return self.weight * self.ratio * np.concatenate(banded)

    def _alone(self, columns: Array) -> Array:
        return np.asarray(columns - self.others @ (self.others.T @ columns))


def _load_search(robot: Robot, motions: Sequence[Motion], joint: str, fit: LoadFit) -> _LoadSearch:
    rows, index, drive = fit.rows, robot.index(joint), robot.drivetrains[joint]
    regressor = motor_regressor(robot, joint)
    own = [f"{name} of {joint}" for name in regressor.names]
    information = fit.information
    weights = _weights(information)
    of_row = weights[np.searchsorted(information.equations, rows.joint)]
    rest = [place for place, name in enumerate(rows.names) if name not in own]
    H = of_row[:, None] * rows.H[:, rest]
    norms = np.linalg.norm(H, axis=0)
    by_motion = [fed_signals(robot, motion, index) for motion in motions]
    return _LoadSearch(
        regressor=regressor,
        linear=tuple(n for n in regressor.linear if f"{n} of {joint}" in rows.names),
        ratio=drive.ratio,
        motions=motions,
        signals=by_motion,
        samples=[_samples(robot, motion, joint) for motion in motions],
        zeta=[regressor.evaluate(one)[0] for one in by_motion],
        mine=np.flatnonzero(rows.joint == index),
        y=of_row * rows.y,
        weight=float(weights[information.equations.index(index)]),
        others=safely(
            linalg.orth,
            H / np.where(norms > 0, norms, 1.0),
            what="the columns of the load side",
            rcond=_LOST,
        ),
    )


def _samples(robot: Robot, motion: Motion, joint: str) -> IndexArray:
    """Return the samples that are rows of a joint on the load side."""
    rows = row_samples(motion)
    return np.asarray(rows[~unknown_friction(robot, motion, joint)[rows]])
