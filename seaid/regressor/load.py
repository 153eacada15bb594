"""The load side (8) over time: base parameters, and columns of drives, from torques on the load.

- `load_model` decides which columns are identifiable: base parameters of the bodies, friction and
  rotor inertia of stiff drives, and the joint terms (parallel spring, joint friction) of any drive;
- `load_regression` evaluates these columns along a motion;
- `offset_sensitivity` gives the effect of joint encoder offsets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial, singledispatch
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray, frozen
from seaid.drives import ParameterName, is_dry, total_ratio
from seaid.drives.terms import LEVEL_OF
from seaid.errors import IdentificationError, LogError
from seaid.log import row_samples, standstill
from seaid.log.rows import PIECE_SAMPLES, in_band_at, still_share
from seaid.regressor.base import (
    INPUTS,
    Joints,
    Links,
    Stances,
    base_parameters,
    blocks_at_drives,
    body_equations,
    grouped_text,
    left_to_right,
    negligible,
    samples_of_block,
    with_independent,
)
from seaid.regressor.regression import (
    LEAST_KNOWN,
    Regress,
    Regression,
    input_signals,
    joint_regressor,
    known_load_friction,
    motor_regressor,
    rows_by_pieces,
    sensed_torque,
    signals,
    spring_regressor,
    with_changes,
)
from seaid.robot import Robot, at_drives, torques_at_drives
from seaid.robot.inertia import UNITS
from seaid.robot.robot import check_held
from seaid.robot.transmission import group_of

if TYPE_CHECKING:
    from seaid.log import Motion
    from seaid.regressor.base import BaseParameters

_JOINT = ("theta_L", "theta_L_dot", "theta_L_ddot")


def drive_parameters(
    robot: Robot, rows: Sequence[str], signals_of: Callable[[int], dict[str, Array]]
) -> tuple[Callable[..., Array], list[tuple[str, str, str]]]:
    """Return the drives' load-side columns (T, rows, columns), and (joint, parameter, unit).

    They are returned by a function of the places of the columns wanted, and of samples (a slice).
    Most drives move one joint, so that most of the columns is zero, and is never in memory.
    """
    placed, drives = list[tuple[Array, int, Array]](), list[tuple[str, str, str]]()
    known = list(map(robot.index, rows))
    for index, joint in enumerate(robot.joint_names):
        drive, parts = robot.drives[joint], []
        if not drive.is_elastic and index in known:
            # N times (7) without a spring: friction and rotor inertia as torques on the load.
            parts.append((motor_regressor(robot, joint), drive.ratio, np.eye(robot.n)[index]))
        # C^-T e_j: a torque on one joint is shared by all drives that move it.
        at_drive = torques_at_drives(robot.transmission, np.eye(robot.n)[index])
        # No equation has what acts on a joint that none of the known torques moves.
        if np.any(at_drive[known]) and (*drive.parallel_spring, *drive.joint_friction):
            parts.append((joint_regressor(robot, joint), 1.0, at_drive))
        for regressor, factor, share in parts:
            by_name = signals_of(index)
            # Parallel spring and joint friction act at the joint itself.
            if regressor is not motor_regressor(robot, joint):
                by_name = {**by_name, **{name: by_name[f"own_{name}"] for name in _JOINT}}
            placed.append((share[known], len(drives), factor * regressor.evaluate(by_name)[1]))
            units = zip(regressor.names, regressor.units, strict=True)
            drives += [(joint, str(name), unit) for name, unit in units]
    like = np.empty((len(signals_of(0)["theta_L"]), len(rows), 0))
    return partial(_table, placed, like), drives


_Placed = Sequence[tuple[Array, int, Array]]
"""The shares (rows,) of drives in the rows, the place of their first column, and columns (T, c)."""


def _table(placed: _Placed, like: Array, chosen: Sequence[int], part: slice = slice(None)) -> Array:
    """Return chosen columns (S, rows, chosen) at some samples; `like` is (T, rows, 0)."""
    table = np.zeros((*like[part].shape[:2], len(chosen)))
    for shares, first, columns in placed:
        for row in np.flatnonzero(shares).tolist():
            for place, values in enumerate(columns.T, first):
                if place in chosen:
                    table[:, row, chosen.index(place)] = shares[row] * values[part]
    return table


def load_signals(robot: Robot, motion: Motion, index: int) -> dict[str, Array]:
    """Return the signals of a drive, and the states of its own joint as own_theta_L etc."""
    states = zip(_JOINT, motion.joint_states, strict=True)
    return signals(robot, motion, index) | {f"own_{name}": x[:, index] for name, x in states}


def stiff_signals(robot: Robot, index: int, q: Array, v: Array, a: Array) -> dict[str, Array]:
    """Return a stiff drive's signals at joint states, random where these do not fix them."""
    ratio, nothing = robot.drives[robot.joint_names[index]].ratio, np.zeros(len(q))
    joint_states = {f"own_{name}": x[:, index] for name, x in zip(_JOINT, (q, v, a), strict=True)}
    rng = np.random.default_rng(index)
    others = ("i_M", "u_M", "tau_G", "Delta_T", "t_log", "tau_C_dot", "tau_M")
    free = {name: rng.normal(size=len(q)) for name in others}
    states = {"theta_L": q, "theta_L_dot": v, "theta_L_ddot": a}
    joint = {x: at_drives(robot.transmission, values)[:, index] for x, values in states.items()}
    motor = {name.replace("_L", "_M"): ratio * values for name, values in joint.items()}
    return {**joint, **motor, **joint_states, **free, "tau_L": nothing}


@dataclass(frozen=True, eq=False)
class LoadModel:
    """The identifiable columns of the load side: base parameters and drive parameters.

    Attributes
    ----------
    base : BaseParameters
        The p base parameters of the bodies.
    torque_joints : tuple of str
        Joints whose equations are used: the torques on the coordinates of their drives.
    drives : tuple of (joint, parameter, unit)
        The p_d drive parameters that are identifiable next to the base parameters.
    expressions : tuple of p str
        The base parameters, with the absorbed drive parameters.
    absorbed : tuple of (joint, parameter, unit)
        The a other drive parameters, which are identifiable only in combination with base
        parameters.
    absorption : array (p + p_d, a)
        Coefficient of each absorbed parameter in each column.
    """

    base: BaseParameters
    torque_joints: tuple[str, ...]
    drives: tuple[tuple[str, str, str], ...]
    expressions: tuple[str, ...]
    absorbed: tuple[tuple[str, str, str], ...]
    absorption: Array

    @cached_property
    def names(self) -> tuple[ParameterName, ...]:
        """Names of all columns: expressions, then '<parameter> of <joint>'."""
        drives = (ParameterName(name, joint) for joint, name, _ in self.drives)
        return (*map(ParameterName, self.expressions), *drives)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of all columns."""
        base = tuple(UNITS[column % 10] for column in self.base.columns)
        return base + tuple(unit for _, _, unit in self.drives)


Springs = Mapping[str, Array]
"""{joint: parameters of (4b)} of the springs whose torque is that on the load."""


@dataclass(frozen=True, eq=False)
class LoadColumns:
    """The load side (8) at T samples of a motion, in r rows: torque = payload + H theta.

    `torque` (T, r) is that on the load, with the derivatives `propagated` (T, r, s) by parameters
    that were estimated before. `columns` returns the columns (S, r, m + q) of some samples: those
    of all samples take more memory than all else together. The first m make up `H` (T, r, m), the
    others are of parameters whose values are `known` (q,), whose torque is the `payload` (T, r).
    """

    torque: Array
    propagated: Array
    columns: Callable[[slice], Array]
    known: Array

    @property
    def payload(self) -> Array:
        """The torque (T, r) of known bodies."""
        return self._whole[0]

    @property
    def H(self) -> Array:
        """The columns (T, r, m) of all parameters."""
        return self._whole[1]

    @cached_property
    def _whole(self) -> tuple[Array, Array]:
        return self._sides(self.columns(slice(None)))

    def _sides(self, columns: Array) -> tuple[Array, Array]:
        """Return payload (S, r) and H (S, r, m) of columns (S, r, m + q)."""
        H, others = np.split(columns, [columns.shape[2] - len(self.known)], axis=2)
        return others @ self.known, H

    def in_band(self, motion: Motion, known: Array, rows: IndexArray) -> tuple[Array, Array, Array]:
        """Return torque - payload, `H` and `propagated` of filtered equations at S samples.

        Their friction is `known` (T, r).
        """
        columns = in_band_at(motion, lambda x: where_known(known[x], self.columns(x)), rows)
        payload, H = self._sides(columns)
        y = in_band_at(motion, where_known(known, self.torque.copy()), rows) - payload
        return y, H, in_band_at(motion, where_known(known, self.propagated), rows)


_BLOCK = 128
"""Samples whose regressors of all parameters stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class LoadSide:
    """The load side of a robot whose base is held; other kinds of robots replace its parts.

    A package that knows another kind of robot registers its load side for the type of that robot.
    """

    robot: Robot

    def stances(self, motions: Sequence[Motion]) -> tuple[Stances, Links]:
        """Return the `stances` and the `measured` contacts of motions for `base_parameters`."""
        return ((),), ()

    def columns(
        self, motion: Motion, model: LoadModel, springs: Springs, further: Array | None = None
    ) -> LoadColumns:
        """Return the columns of the load side.

        `further` (T, rows, k) are columns of `torque_changes`, which follow those of the springs.
        """
        robot, joints, p = self.robot, model.torque_joints, len(model.base.columns)
        torque, propagated = load_targets(robot, motion, joints, springs)
        drives, others = drive_columns(robot, motion, model), np.flatnonzero(robot.known_parameters)
        parameters = np.array([*model.base.columns, *others], dtype=np.intp)
        # (k, p) places in a flat sample: ten parameters of each body, and n joints per parameter.
        places = np.add.outer([*map(robot.index, joints)], robot.n * parameters)
        samples = min(_BLOCK, samples_of_block(robot))

        def columns(part: slice) -> Array:
            q, v, a = (state[part] for state in motion.joint_states)
            bodies = np.empty((len(q), *places.shape))
            for block, Y in blocks_at_drives(robot, (q, v, a), samples):
                flat = Y.swapaxes(1, 2).reshape(len(Y), -1)  # a view: the memory layout of Y
                # With another `mode` NumPy fills a copy of the target.
                flat.take(places, axis=1, out=bodies[block], mode="clip")
            return np.concatenate([bodies[:, :, :p], drives(part), bodies[:, :, p:]], axis=2)

        propagated = joined(propagated, further)
        return LoadColumns(torque, propagated, columns, robot.known_parameters[others])

    def torques(
        self, motion: Motion, model: LoadModel, springs: Springs, thetas: Array
    ) -> tuple[Array, Array, Array]:
        """Return torque and payload (T, rows) of the columns, and H @ `thetas` (T, rows, k)."""
        columns = self.columns(motion, model, springs)
        return columns.torque, columns.payload, columns.H @ thetas

    def contact_torques(self, motion: Motion, model: LoadModel) -> Array | float:
        """Return what measured forces of the ground contribute to the torque (T, rows)."""
        return 0.0

    def parts(self, motion: Motion, equations: Array) -> Callable[[Array], dict[int, Array]]:
        """Return a function of torques (n,) at drives: factors of what has them times a signal.

        Those are {index of an equation: factor (T,)}, zero where friction in it is not known, of
        the `equations` (R,) of the rows of a fit.
        """
        known = cache(partial(known_load_friction, self.robot, motion))
        return lambda torques: {i: x * known(i) for i, x in enumerate(torques.tolist()) if x}

    def in_pieces(self, motion: Motion, model: LoadModel) -> tuple[Motion, int]:
        """Return the motion at the rate that its columns need, and the samples of its pieces."""
        return motion, PIECE_SAMPLES

    def with_all_equations(
        self, motion: Motion, rows: IndexArray, joints: Joints, usable: BoolArray
    ) -> tuple[tuple[str, ...], Joints, BoolArray]:
        """Return the names of all equations, their indices (r,), and where each is usable (r, S).

        `usable` (k, S) is that of k joints at the S samples `rows`.
        """
        return self.robot.joint_names, joints, usable

    def with_equation(self, usable: BoolArray, H: Array, y: Array) -> BoolArray:
        """Return the usable rows (r, S) that have an equation in H (S, r, m) and y (S, r)."""
        return usable


@singledispatch
def load_side(robot: Robot) -> LoadSide:
    """Return the load side of this kind of robot."""
    return LoadSide(robot)


def load_model_of(
    robot: Robot, motions: Sequence[Motion], torque_joints: Sequence[str]
) -> LoadModel:
    """Return the identifiable columns of the load side in the stances of some motions."""
    stances, measured = load_side(robot).stances(motions)
    base = base_parameters(robot, torque_joints=torque_joints, stances=stances, measured=measured)
    return load_model(robot, base, torque_joints, stances, measured)


def load_model(
    robot: Robot,
    base: BaseParameters,
    torque_joints: Sequence[str],
    stances: Stances = ((),),
    measured: Links = (),
) -> LoadModel:
    """Return the identifiable columns of the load side, for the torques of some joints.

    `stances` and `measured` are those of a floating base, as in `base_parameters`.
    """
    H, drives = _random_rows(robot, base, torque_joints, stances, measured)
    p = len(base.columns)
    nonlinear = [
        p + place
        for place, (joint, name, _) in enumerate(drives)
        if name in _nonlinear_parameters(robot, joint)
    ]
    identifiable, grouping = _identifiable(H, nonlinear)
    names = (*base.expressions, *(f"{name}_{joint}" for joint, name, _ in drives))
    absorbed = sorted({*range(p, H.shape[1])}.difference(identifiable))
    expressions = []
    for row in range(p):
        # The row of a base parameter: itself and the drive parameters that it absorbs.
        wanted = np.zeros(H.shape[1])
        wanted[[row, *absorbed]] = grouping[row, [row, *absorbed]]
        expressions.append(grouped_text(wanted, names))
    return LoadModel(
        base=base,
        torque_joints=tuple(torque_joints),
        drives=tuple(drives[column - p] for column in identifiable if column >= p),
        expressions=tuple(expressions),
        absorbed=tuple(drives[column - p] for column in absorbed),
        absorption=frozen("absorption", grouping[:, absorbed], (len(identifiable), None)),
    )


def _random_rows(
    robot: Robot, base: BaseParameters, joints: Sequence[str], stances: Stances, measured: Links
) -> tuple[Array, list[tuple[str, str, str]]]:
    """Return the rows of the load side at random states, and the drive parameters in them."""
    known, equations = list(map(robot.index, joints)), body_equations(robot)
    parts, drives = [], list[tuple[str, str, str]]()
    for (q, v, a), Y, reduced in equations.random_rows(known, stances, measured):
        signals_of = partial(stiff_signals, robot, q=q, v=v, a=a)
        of_drives, drives = drive_parameters(robot, joints, signals_of)
        columns = equations.with_all_rows(of_drives(range(len(drives))))
        rows = reduced(np.concatenate([base.reduce(Y), columns], axis=2))
        # not reshape(-1, ...): where all bodies are known there may be no column
        parts.append(rows.reshape(rows.shape[0] * rows.shape[1], rows.shape[2]))
    return np.concatenate(parts), drives


def _nonlinear_parameters(robot: Robot, joint: str) -> tuple[str, ...]:
    """Return the parameters in which the equation of a stiff drive is nonlinear, and their levels.

    The column of a level differs from those of the others at low speeds only, too.
    """
    drive = robot.drives[joint]
    if drive.is_elastic:
        return ()
    levels = (LEVEL_OF[term] for term in drive.friction if term in LEVEL_OF)
    return (*motor_regressor(robot, joint).non_linear, *levels)


def _identifiable(H: Array, nonlinear: Sequence[int]) -> tuple[list[int], Array]:
    """Return the identifiable columns of H, and the grouping matrix of all columns.

    Columns of `nonlinear` parameters count as independent: they differ from the others at low motor
    speeds, which random states do not cover.
    """
    is_linear = ~np.isin(np.arange(H.shape[1]), nonlinear)
    selected, grouping, _ = left_to_right(H, negligible(H, is_linear) | ~is_linear)
    return with_independent(selected, grouping, nonlinear)


def joined(columns: Array, further: Array | None) -> Array:
    """Return columns (T, rows, s) and further ones, if any."""
    return columns if further is None else np.concatenate([columns, further], axis=2)


def torque_changes(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Springs,
    theta: Array,
    changed: Sequence[tuple[Robot, Motion]],
) -> Array:
    """Return by how much torque - payload - H theta (T, rows, k) differs in k changed experiments.

    Their robots differ in constants of drives and in known bodies, their motions in logged inputs,
    so that the regressor of the bodies is the same. The rows of a floating base come first, and
    contact forces are not yet eliminated.
    """
    joints = [robot.index(joint) for joint in model.torque_joints]
    before = drive_torques(robot, motion, model, springs, theta)
    changes = np.stack(
        [drive_torques(*experiment, model, springs, theta) - before for experiment in changed], 2
    )
    equations = body_equations(robot)
    changes = equations.with_all_rows(changes)
    bodies = np.stack([other.known_parameters - robot.known_parameters for other, _ in changed], 1)
    columns = np.flatnonzero(np.any(bodies, axis=1))
    if not len(columns):
        return changes
    Y = equations.body_columns(motion, joints, columns)
    # Heavier known bodies take more of the torque: they are on its side with a minus.
    return np.asarray(changes - Y @ bodies[columns])


def drive_torques(
    robot: Robot, motion: Motion, model: LoadModel, springs: Springs, theta: Array
) -> Array:
    """Return the torques (T, rows) of the drives on the load by a fit `theta` of the load side.

    Drive parameters that are identifiable only with base parameters belong to the bodies here.
    """
    torque, _ = load_targets(robot, motion, model.torque_joints, springs)
    return torque - drive_columns(robot, motion, model)() @ theta[len(model.expressions) :]


def drive_columns(robot: Robot, motion: Motion, model: LoadModel) -> Callable[..., Array]:
    """Return a function from samples (a slice) to the columns (S, rows, p_d) of a model's drives.

    Without an argument they are those of all samples.
    """
    signals_of = partial(load_signals, robot, motion)
    columns, drives = drive_parameters(robot, model.torque_joints, signals_of)
    return partial(columns, [drives.index(drive) for drive in model.drives])


def load_regression(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Springs,
    further: Callable[[Motion], Array] | None = None,
) -> Regression:
    """Return the load side (8) over time, with the columns of `model`.

    `springs` {joint: parameters of (4b)} gives the load torques of elastic joints; an elastic joint
    that it does not contain takes its joint torque from the log. The torque of known bodies and
    payloads is on the known side y. `further` returns columns (T, rows, k) as of `torque_changes`
    for a piece of the motion; they follow those of the springs in `propagated`.
    """
    side = load_side(robot)
    motion, samples = side.in_pieces(motion, model)

    def regress(piece: Motion) -> Regression:
        columns = None if further is None else further(piece)
        return load_rows(robot, piece, model, side.columns(piece, model, springs, columns))

    return rows_by_pieces(motion, regress, samples)


def load_rows(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    columns: LoadColumns,
    called: tuple[tuple[str, ...], tuple[str, ...]] | None = None,
) -> Regression:
    """Return the rows of one piece of a motion, whose `load_columns` are given.

    `called` are the names and units of columns that are not those of `model`.
    """
    rows, joints = row_samples(motion), model.torque_joints
    # a combination of equations that are all valid, whatever friction does at rest
    known = known_frictions(robot, motion, joints)
    y, H, propagated = columns.in_band(motion, known, rows)
    usable, side = usable_rows(robot, motion, joints, rows, known), load_side(robot)
    indices: Joints = [robot.index(joint) for joint in joints]
    names, indices, usable = side.with_all_equations(motion, rows, indices, usable)
    excluded = usable.size - int(usable.sum())
    usable = side.with_equation(usable, H, y)
    # (k, S) -> (R,) rows, equation by equation.
    which, kept = np.nonzero(usable)
    column_names, units = called or (model.names, model.units)
    return Regression(
        names=ParameterName.all_of(column_names),
        units=units,
        H=H[kept, which],
        y=y[kept, which],
        joint=np.array(indices)[which],
        time=motion.time[rows[kept]],
        run=np.zeros(len(kept)),
        excluded=excluded,
        propagated=propagated[kept, which],
        joint_names=names,
    )


def with_gear_torque(
    robot: Robot, motion: Motion, model: LoadModel, springs: Springs, theta: Array
) -> Motion:
    """Return the motion with the torque through the gears by a fit `theta` of the load side."""
    check_held(robot, "load-dependent friction", IdentificationError)
    # Friction under load needs a gear torque, but is not among the columns behind the gear.
    unloaded = replace(motion, gear_torque=np.zeros_like(motion.joint_position))
    columns = load_side(robot).columns(unloaded, model, springs)
    drives = [
        place
        for place, (joint, name, _) in enumerate(model.drives, len(model.expressions))
        if joint not in robot.elastic_joints and name in motor_regressor(robot, joint).names
    ]
    # A gear passes on the load behind it, without the motor's own friction and inertia.
    behind = [place for place in range(len(model.names)) if place not in drives]
    torque = np.full_like(motion.joint_position, np.nan)
    torque[:, [robot.index(joint) for joint in model.torque_joints]] = (
        columns.payload + columns.H[:, :, behind] @ theta[behind]
    )
    return replace(motion, gear_torque=torque)


def unknown_frictions(robot: Robot, motion: Motion, joints: Sequence[str]) -> BoolArray:
    """Return `unknown_friction` of several joints (T, k), which may be none."""
    each = [unknown_friction(robot, motion, joint) for joint in joints]
    return np.reshape(np.array(each, dtype=bool), (len(joints), len(motion.time))).T


def known_frictions(robot: Robot, motion: Motion, joints: Sequence[str]) -> Array:
    """Return `known_load_friction` of several joints (T, k), which may be none."""
    each = [known_load_friction(robot, motion, robot.index(joint)) for joint in joints]
    return np.reshape(each, (len(joints), len(motion.time))).T


def where_known(known: Array, columns: Array) -> Array:
    """Make columns (T, k, ...) of equations zero where their friction is not `known` (T, k).

    They are changed in place, since they are large; and returned.
    """
    if np.any(known != 1):
        columns *= known.reshape(*known.shape, *(1,) * (columns.ndim - 2))
    return columns


def usable_rows(
    robot: Robot, motion: Motion, joints: Sequence[str], rows: IndexArray, known: Array
) -> BoolArray:
    """Return which samples give equations of the load side (k, S); `known`: `known_frictions`."""
    if not robot.base_is_held:
        return ~unknown_frictions(robot, motion, joints)[rows].T
    usable: BoolArray = in_band_at(motion, known, rows).T >= LEAST_KNOWN
    for row, joint in enumerate(joints):
        usable[row] &= ~_group_rests(robot, motion, joint)[rows]
    return usable


def unknown_friction(robot: Robot, motion: Motion, joint: str) -> BoolArray:
    """Return the samples (T,) at which the load side of a joint has unknown friction.

    These are the reversals and standstills of a stiff drive with dry friction, on a moving base the
    standstills alone, and those of joints with dry friction of their own.
    """
    drive, index = robot.drives[joint], robot.index(joint)
    unknown = known_load_friction(robot, motion, index) == 0
    if not robot.base_is_held and is_dry(drive) and not drive.is_elastic:
        # While its motor stands friction is anything up to that of Coulomb.
        unknown |= standstill(motion, index, still_share(drive))
    return np.asarray(unknown | _group_rests(robot, motion, joint))


def _group_rests(robot: Robot, motion: Motion, joint: str) -> BoolArray:
    """Return the samples (T,) at which joints that a drive moves rest with dry friction."""
    unknown, index = np.zeros(len(motion.time), dtype=bool), robot.index(joint)
    for moved in group_of(robot.transmission, index):
        if "coulomb" in robot.drives[robot.joint_names[moved]].joint_friction:
            unknown |= standstill(motion, moved, of_joint=True)
    return unknown


def load_targets(
    robot: Robot, motion: Motion, rows: Sequence[str], springs: Springs
) -> tuple[Array, Array]:
    """Return the torque on the load (T, rows) and its derivative by the springs' parameters."""
    elastic = [joint for joint in rows if joint in springs]
    targets = np.empty((len(motion.time), len(rows)))
    propagated = np.zeros((*targets.shape, sum(len(springs[joint]) for joint in elastic)))
    start = 0
    for row, joint in enumerate(rows):
        index, drive = robot.index(joint), robot.drives[joint]
        if drive.is_elastic:
            if joint not in springs:
                targets[:, row] = sensed_torque(robot, motion, index)
                continue
            zeta, R = spring_regressor(robot, joint).evaluate(signals(robot, motion, index))
            R = drive.load_radius * R
            # r_L F = R k - zeta, (4b) with a load torque of zero; its derivative by k is R.
            targets[:, row] = R @ springs[joint] - drive.load_radius * zeta  # (4b)
            propagated[:, row, start : start + R.shape[1]] = R
            start += R.shape[1]
        else:
            by_name = input_signals(robot, motion, index)
            targets[:, row] = drive.ratio * motor_regressor(robot, joint).evaluate(by_name)[0]
            # Of an unknown torque constant the input is in R alone, and zeta is finite without it.
            targets[np.isnan(by_name[INPUTS[drive.motor_input]]), row] = np.nan
    missing = [joint for row, joint in enumerate(rows) if np.any(np.isnan(targets[:, row]))]
    if missing:
        raise LogError(
            f"no torque in the log at {', '.join(missing)}; name the others with torque_joints=",
            "torque_joints=",
        )
    return targets, propagated


OFFSET_STEP = 1e-4
"""Encoder offset [rad or m] of the difference quotients."""


_LARGEST_STD = 1e3
"""Limit on the standard deviation of an encoder offset [rad or m], which is squared."""


def check_offset_std(encoder_offset_std: float) -> None:
    """Raise IdentificationError for an invalid standard deviation of encoder offsets."""
    if not 0 <= encoder_offset_std <= _LARGEST_STD:
        raise IdentificationError(
            f"encoder_offset_std must be from 0 to {_LARGEST_STD:g} rad or m, found "
            f"{encoder_offset_std}",
            "encoder_offset_std",
        )


def offset_sensitivity(robot: Robot, motion: Motion, regress: Regress, theta: Array) -> Regression:
    """Return the rows with `propagated` (R, n), the derivative of y by the encoder offsets.

    It is that of the residual y - H theta at the parameters `theta`, by difference quotients.
    """
    # The encoder moves H as well as y: what counts is the residual at fixed parameters.
    shifted = (regress(shifted_encoder(robot, motion, index)) for index in range(robot.n))
    return with_changes(regress(motion), shifted, theta, OFFSET_STEP)


def shifted_encoder(robot: Robot, motion: Motion, index: int) -> Motion:
    """Return the motion with `OFFSET_STEP` added to one joint's encoder.

    The motors of springs move along, because the spring offset absorbs a constant deflection.
    """
    joint, motor = motion.joint_position.copy(), motion.motor_position.copy()
    joint[:, index] += OFFSET_STEP
    for name in robot.elastic_joints:
        spring, drive = robot.index(name), robot.drives[name]
        motor[:, spring] += total_ratio(drive) * robot.transmission[spring, index] * OFFSET_STEP
    return replace(motion, joint_position=joint, motor_position=motor)
