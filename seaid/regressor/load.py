"""The load side (8) over time: base parameters, and columns of drives, from torques on the load.

- `load_model` decides which columns are identifiable: base parameters of the bodies, friction and
  rotor inertia of stiff drives, and the joint terms (parallel spring, joint friction) of any drive;
- `load_regression` evaluates these columns along a motion;
- `offset_sensitivity` gives the effect of joint encoder offsets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, compress
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, BoolArray, IndexArray, frozen
from seaid.drives import LEVEL_OF, ParameterName, total_ratio
from seaid.errors import IdentificationError, LogError
from seaid.log import (
    LEAST_LIFT,
    PIECE_SAMPLES,
    POSITION_BAND,
    decimated,
    in_band_at,
    joint_standstill,
    loaded,
    row_samples,
)
from seaid.regressor.base import (
    base_parameters,
    grouped_text,
    left_to_right,
    negligible,
    random_states,
)
from seaid.regressor.floating import (
    accelerated_base,
    contact_equations,
    contact_map,
    floating_regressor,
    floating_rows,
    measured_contact,
    measured_wrenches,
    row_scale,
    stance_rows,
    without_contact_forces,
)
from seaid.regressor.regression import (
    INPUTS,
    LEAST_KNOWN,
    Regress,
    Regression,
    input_signals,
    joint_regressor,
    motor_regressor,
    rows_by_pieces,
    sensed_torque,
    signals,
    spring_regressor,
    unknown_motor_friction,
    with_changes,
)
from seaid.regressor.rigid_body import regressor_at_drives
from seaid.robot import (
    BASE_ROWS,
    UNITS,
    at_drives,
    check_held,
    group_of,
    torques_at_drives,
)

if TYPE_CHECKING:
    from seaid.log import BaseMotion, Motion
    from seaid.regressor.base import BaseParameters
    from seaid.robot import Robot

_JOINT = ("theta_L", "theta_L_dot", "theta_L_ddot")


def drive_parameters(
    robot: Robot, rows: Sequence[str], signals_of: Callable[[int], dict[str, Array]]
) -> tuple[Array, list[tuple[str, str, str]]]:
    """Return the drives' load-side columns (T, rows, columns), and (joint, parameter, unit)."""
    blocks, drives = [], []
    known = list(map(robot.index, rows))
    for joint in robot.joint_names:
        index, drive = robot.index(joint), robot.drives[joint]
        parts = []
        if not drive.is_elastic and index in known:
            # N times (7) without a spring: friction and rotor inertia as torques on the load.
            parts.append((motor_regressor(robot, joint), drive.ratio, np.eye(robot.n)[index]))
        if drive.parallel_spring or drive.joint_friction:
            # C^-T e_j: a torque on one joint is shared by all drives that move it.
            at_drive = torques_at_drives(robot.transmission, np.eye(robot.n)[index])
            parts.append((joint_regressor(robot, joint), 1.0, at_drive))
        for regressor, factor, share in parts:
            by_name = signals_of(index)
            # Parallel spring and joint friction act at the joint itself.
            if regressor is not motor_regressor(robot, joint):
                by_name = {**by_name, **{name: by_name[f"own_{name}"] for name in _JOINT}}
            R = factor * regressor.evaluate(by_name)[1]
            blocks.append(R[:, None, :] * share[known][None, :, None])
            drives += [
                (joint, name, unit)
                for name, unit in zip(regressor.names, regressor.units, strict=True)
            ]
    length = len(next(iter(signals_of(0).values())))
    return np.concatenate([*blocks, np.empty((length, len(rows), 0))], axis=2), drives


def load_signals(robot: Robot, motion: Motion, index: int) -> dict[str, Array]:
    """Return the signals of a drive, and the states of its own joint as own_theta_L etc."""
    joint_states = {
        f"own_{name}": values[:, index]
        for name, values in zip(_JOINT, motion.joint_states, strict=True)
    }
    return signals(robot, motion, index) | joint_states


def stiff_signals(robot: Robot, index: int, q: Array, v: Array, a: Array) -> dict[str, Array]:
    """Return a stiff drive's signals at joint states, random where these do not fix them."""
    ratio, nothing = robot.drives[robot.joint_names[index]].ratio, np.zeros(len(q))
    joint_states = {f"own_{name}": x[:, index] for name, x in zip(_JOINT, (q, v, a), strict=True)}
    rng = np.random.default_rng(index)
    others = ("i_M", "u_M", "tau_G", "Delta_T", "t_log", "tau_C_dot", "tau_M")
    free = {name: rng.normal(size=len(q)) for name in others}
    states = {"theta_L": q, "theta_L_dot": v, "theta_L_ddot": a}
    joint = {
        name: at_drives(robot.transmission, values)[:, index] for name, values in states.items()
    }
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

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns: expressions, then '<parameter> of <joint>'."""
        return self.expressions + tuple(
            ParameterName(name, joint) for joint, name, _ in self.drives
        )

    @property
    def units(self) -> tuple[str, ...]:
        """Units of all columns."""
        base = tuple(UNITS[column % 10] for column in self.base.columns)
        return base + tuple(unit for _, _, unit in self.drives)


def load_model_of(
    robot: Robot, motions: Sequence[Motion], torque_joints: Sequence[str]
) -> LoadModel:
    """Return the identifiable columns of the load side in the stances of some motions."""
    stances, measured = stances_of(robot, motions)
    base = base_parameters(robot, torque_joints=torque_joints, stances=stances, measured=measured)
    return load_model(robot, base, torque_joints, stances, measured)


def load_model(
    robot: Robot,
    base: BaseParameters,
    torque_joints: Sequence[str],
    stances: Sequence[Sequence[str]] = ((),),
    measured: Sequence[str] = (),
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
    robot: Robot,
    base: BaseParameters,
    torque_joints: Sequence[str],
    stances: Sequence[Sequence[str]],
    measured: Sequence[str],
) -> tuple[Array, list[tuple[str, str, str]]]:
    """Return the rows of the load side at random states, and the drive parameters in them."""
    known, floats = list(map(robot.index, torque_joints)), robot.floating_base is not None
    parts, drives = [], list[tuple[str, str, str]]()
    for place, links in enumerate(stances if floats else ((),)):
        if floats:
            (q, v, a), Y, reduced = stance_rows(robot, links, 1 + place, known, measured)
        else:
            q, v, a = random_states(robot, seed=1, torques=len(known))
            Y, reduced = regressor_at_drives(robot, q, v, a)[:, known], np.asarray
        signals_of = partial(stiff_signals, robot, q=q, v=v, a=a)
        columns, drives = drive_parameters(robot, torque_joints, signals_of)
        columns = below_base(columns) if floats else columns
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
    linear = [column for column in range(H.shape[1]) if column not in nonlinear]
    selected, grouping, _ = left_to_right(H[:, linear], negligible(H[:, linear]))
    identifiable = sorted([linear[column] for column in selected] + list(nonlinear))
    whole = np.zeros((len(identifiable), H.shape[1]))
    rows = [identifiable.index(linear[column]) for column in selected]
    whole[np.ix_(rows, linear)] = grouping
    whole[[identifiable.index(column) for column in nonlinear], list(nonlinear)] = 1.0
    return identifiable, whole


def load_columns(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Mapping[str, Array],
    further: Array | None = None,
) -> tuple[Array, Array, Array, Array]:
    """Return torque and payload (T, rows), H and `propagated`: torque = payload + H @ theta.

    `further` (T, rows, k) are columns of `torque_changes`, which follow those of the springs.
    """
    if robot.floating_base is not None:
        return _floating_columns(robot, motion, model, springs, further=further)
    known = [robot.index(joint) for joint in model.torque_joints]
    Y = regressor_at_drives(robot, *motion.joint_states)
    flat = Y.swapaxes(1, 2).reshape(len(Y), -1)  # a view: the memory layout of the regressor
    # (k, p) places in a flat sample: ten parameters of each body, and n joints per parameter.
    places = np.add.outer(known, Y.shape[1] * np.array(model.base.columns, dtype=np.intp))
    base = np.take(flat, places.ravel(), axis=1).reshape(len(Y), *places.shape)
    H = base
    if model.drives:
        H = np.concatenate([base, drive_columns(robot, motion, model)], axis=2)
    torque, propagated = _load_targets(robot, motion, model.torque_joints, springs)
    propagated = _joined(propagated, further)
    payload = np.zeros_like(torque)
    if np.any(robot.known_parameters):
        payload = (Y @ robot.known_parameters)[:, known]
    return torque, payload, H, propagated


def _joined(columns: Array, further: Array | None) -> Array:
    """Return columns (T, rows, s) and further ones, if any."""
    return columns if further is None else np.concatenate([columns, further], axis=2)


def torque_changes(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Mapping[str, Array],
    theta: Array,
    changed: Sequence[tuple[Robot, Motion]],
) -> Array:
    """Return by how much torque - payload - H theta (T, rows, k) differs in k changed experiments.

    Their robots differ in constants of drives and in known bodies, their motions in logged inputs,
    so that the regressor of the bodies is the same. The rows of a floating base come first, and
    contact forces are not yet eliminated.
    """
    states, joints = motion.joint_states, [robot.index(joint) for joint in model.torque_joints]
    before = drive_torques(robot, motion, model, springs, theta)
    changes = np.stack(
        [drive_torques(*experiment, model, springs, theta) - before for experiment in changed], 2
    )
    changes = changes if motion.base is None else below_base(changes)
    bodies = np.stack([other.known_parameters - robot.known_parameters for other, _ in changed], 1)
    columns = np.flatnonzero(np.any(bodies, axis=1))
    if not len(columns):
        return changes
    if motion.base is None:
        Y = regressor_at_drives(robot, *states)[:, joints][:, :, columns]
    else:
        Y = floating_regressor(robot, *states, motion.base.states, columns.tolist())
        Y = floating_rows(robot, Y, joints)
    # Heavier known bodies take more of the torque: they are on its side with a minus.
    return np.asarray(changes - Y @ bodies[columns])


_RATES = 16.0
"""Rate over the cutoff at which columns of a floating base are computed: products of three of its
positions, whose band is five times the cutoff, have no image below the cutoff then. On walks of a
Go2, a Solo12 and a G1 parameters change by 0.04 to 0.10 standard errors (rms) from those at the
rate of the log, by 0.02 to 0.06 at 30 and by 0.10 to 0.14 at 12."""

_PIECE_NUMBERS = 40_000_000
"""Numbers of the regressor of a floating base that are in memory at a time: 320 MB."""

_BLOCK_NUMBERS = 1_000_000
"""Numbers of the regressor of a floating base that are computed at a time: few megabytes."""


def load_torques(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Mapping[str, Array],
    thetas: Array,
) -> tuple[Array, Array, Array]:
    """Return torque and payload (T, rows) of `load_columns`, and H @ `thetas` (T, rows, k).

    The columns H of a floating base, which are many, are not held in memory.
    """
    if robot.floating_base is not None:
        return _floating_columns(robot, motion, model, springs, thetas)[:3]
    torque, payload, H, _ = load_columns(robot, motion, model, springs)
    return torque, payload, H @ thetas


def _floating_columns(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Mapping[str, Array],
    thetas: Array | None = None,
    further: Array | None = None,
) -> tuple[Array, Array, Array, Array]:
    """Return the `load_columns` of a floating base, without contact forces, block by block.

    With `thetas` (p + p_d, k) its products with H are in place of H.
    """
    base, q = motion.base, motion.joint_position
    assert base is not None
    joints = model.torque_joints
    known, p = [robot.index(joint) for joint in joints], len(model.base.columns)
    known_columns = np.flatnonzero(robot.known_parameters)
    torque, propagated = _load_targets(robot, motion, joints, springs)
    # M v' + h = S^T tau + sum J_c^T w: the base has no motor, so that its rows begin with zeros.
    torque = below_base(torque) + measured_wrenches(robot, q, base.wrenches, known, base.up)
    unknown = unknown_frictions(robot, motion, joints)
    drives = drive_columns(robot, motion, model)
    propagated = _joined(below_base(propagated), further)
    if thetas is not None:
        drives = drives @ thetas[p:]
    drives, count = below_base(drives), len(model.names) if thetas is None else thetas.shape[1]
    table = np.zeros((*torque.shape, count + 2 + propagated.shape[2]))
    step = max(_BLOCK_NUMBERS // (torque.shape[1] * len(model.names)), 1)
    for start in range(0, len(q), step):
        part = slice(start, start + step)
        piece = base.samples(part)
        # Rows of zeros are no equations: `_load_rows` removes them.
        if not np.any(piece.used):
            continue
        states = (q[part], motion.joint_velocity[part], motion.joint_acceleration[part])
        Y = floating_regressor(robot, *states, piece.states, [*model.base.columns, *known_columns])
        Y = floating_rows(robot, Y, known)
        sides = (torque[part], Y[:, :, p:] @ robot.known_parameters[known_columns])
        if thetas is None:
            H = np.concatenate([Y[:, :, :p], drives[part]], axis=2)
        else:
            H = Y[:, :, :p] @ thetas[:p] + drives[part]
        # The projection is linear and the same for both sides of the equations.
        rows = np.concatenate([H, *(x[:, :, None] for x in sides), propagated[part]], axis=2)
        rows = without_contact_forces(
            robot, states[0], piece.contacts, known, rows, unknown[part], piece.up
        )
        table[part] = rows * piece.used[:, None, None]
    H, (torque, payload) = table[:, :, :count], np.moveaxis(table[:, :, count : count + 2], 2, 0)
    return torque, payload, H, table[:, :, count + 2 :]


def drive_torques(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array], theta: Array
) -> Array:
    """Return the torques (T, rows) of the drives on the load by a fit `theta` of the load side.

    Drive parameters that are identifiable only with base parameters belong to the bodies here.
    """
    torque, _ = _load_targets(robot, motion, model.torque_joints, springs)
    return torque - drive_columns(robot, motion, model) @ theta[len(model.expressions) :]


def measured_contact_torques(robot: Robot, motion: Motion, model: LoadModel) -> Array:
    """Return what measured wrenches contribute to the torque (T, rows) of `load_columns`."""
    base, q = motion.base, motion.joint_position
    assert base is not None
    joints = [robot.index(joint) for joint in model.torque_joints]
    unknown = unknown_frictions(robot, motion, model.torque_joints)
    rows = measured_wrenches(robot, q, base.wrenches, joints, base.up)[:, :, None]
    rows = without_contact_forces(robot, q, base.contacts, joints, rows, unknown, base.up)
    return np.asarray(rows[:, :, 0] * base.used[:, None])


def contact_force_rows(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Mapping[str, Array],
    theta: Array,
    bodies: Array,
) -> tuple[Array, BoolArray]:
    """Return what contact forces must hold in the rows (T, 6 + k), and unknown rows (T, k).

    That is Y `bodies` less the torques of the drives by a fit `theta` of the load side.
    """
    base, q = motion.base, motion.joint_position
    assert base is not None
    joints = [robot.index(joint) for joint in model.torque_joints]
    rows = -below_base(drive_torques(robot, motion, model, springs, theta))
    step = max(_BLOCK_NUMBERS // (rows.shape[1] * len(bodies)), 1)
    for start in range(0, len(q), step):
        part = slice(start, start + step)
        states = (q[part], motion.joint_velocity[part], motion.joint_acceleration[part])
        Y = floating_regressor(robot, *states, base.samples(part).states) @ bodies
        rows[part] += floating_rows(robot, Y[:, :, None], joints)[:, :, 0]
    return rows, unknown_frictions(robot, motion, model.torque_joints)


def contact_force_columns(
    robot: Robot, motion: Motion, model: LoadModel, samples: IndexArray
) -> tuple[Array, Array]:
    """Return the columns (S, 6 + k, m) of contact forces by all parameters, and a grouping (f, m).

    The m parameters are those of all bodies, of the identified drives, and the absorbed ones. What
    they do is that of the f identified ones if it is a combination of the rows of the grouping.
    """
    base, p = motion.base, len(model.base.columns)
    assert base is not None
    joints = [robot.index(joint) for joint in model.torque_joints]
    q, v, a, w, e, f = (values[samples] for values in (*motion.joint_states, *base.states))
    Y = floating_rows(robot, floating_regressor(robot, q, v, a, (w, e, f)), joints)
    signals_of = partial(load_signals, robot, motion)
    columns, drives = drive_parameters(robot, model.torque_joints, signals_of)
    wanted = [drives.index(drive) for drive in (*model.drives, *model.absorbed)]
    grouping = np.zeros((len(model.names), Y.shape[2] + len(wanted)))
    grouping[:p, : Y.shape[2]] = model.base.grouping
    grouping[p:, Y.shape[2] : Y.shape[2] + len(model.drives)] = np.eye(len(model.drives))
    grouping[:, Y.shape[2] + len(model.drives) :] = model.absorption
    force_columns = np.concatenate([Y, below_base(columns[samples][:, :, wanted])], axis=2)
    is_unknown = ~np.concatenate([robot.is_known, np.zeros(len(wanted), bool)])
    return force_columns * is_unknown, grouping * is_unknown


def drive_columns(robot: Robot, motion: Motion, model: LoadModel) -> Array:
    """Return the columns (T, rows, p_d) of the drive parameters of a model."""
    signals_of = partial(load_signals, robot, motion)
    columns, drives = drive_parameters(robot, model.torque_joints, signals_of)
    return columns[:, :, [drives.index(drive) for drive in model.drives]]


def stances_of(
    robot: Robot, motions: Sequence[Motion]
) -> tuple[tuple[tuple[str, ...], ...], tuple[str, ...]]:
    """Return the sets of contacts that touch the ground together in motions of a floating base.

    The second result are those among them with measured wrenches: flat feet that have one in each
    log, of which one that always stands shows its weight only.
    """
    bases = [motion.base for motion in motions]
    flat = _measured_feet(robot, bases)
    stances = dict.fromkeys(chain(*(_base_stances(base, flat) for base in bases)))
    if not any(x.base is None or np.any(x.base.used[row_samples(x)]) for x in motions):
        raise _without_stance(motions)
    return tuple(stances), flat


def _measured_feet(robot: Robot, bases: Sequence[BaseMotion | None]) -> tuple[str, ...]:
    """Return the flat contacts that have a measured wrench in each log."""
    if robot.floating_base is None:
        return ()
    flat = (contact.link for contact in robot.floating_base.contacts if contact.is_flat)
    measured = [frozenset() if base is None else frozenset(base.wrenches) for base in bases]
    return tuple(link for link in flat if all(link in links for links in measured))


def _base_stances(base: BaseMotion | None, flat: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the sets of contacts that touch the ground together, `flat` by their wrenches."""
    if base is None:
        return [()]
    touching = {**base.contacts, **{link: loaded(base.wrenches[link]) for link in flat}}
    if not touching:
        return [()]
    # (samples, contacts) of the samples that are used; each different row is a stance.
    patterns = np.array([flags[base.used] for flags in touching.values()]).T
    return [tuple(compress(touching, pattern)) for pattern in np.unique(patterns, axis=0)]


def _without_stance(motions: Sequence[Motion]) -> LogError:
    """Return the error of motions whose contacts change too often for their cutoff."""
    longest_s = 0.0
    for motion in motions:
        assert motion.base is not None
        flags = np.array(
            [*motion.base.contacts.values(), *map(loaded, motion.base.wrenches.values())]
        )
        changes = np.flatnonzero(np.any(np.diff(flags.astype(int)), axis=0)) + 1
        samples = np.diff(changes, prepend=0, append=len(motion.time))
        longest_s = max(longest_s, float(np.max(samples)) / motion.rate_hz)
    # The low pass spreads a change over LEAST_LIFT / (POSITION_BAND cutoff), which must fit into
    # the longest time without a change.
    needed_hz = LEAST_LIFT / (POSITION_BAND * longest_s)
    return LogError(
        f"no sample of the logs is used: between two changes of a contact, or jumps of the base, "
        f"are {longest_s:.3g} s at most, and the low pass at a cutoff of "
        f"{motions[0].cutoff_hz:.3g} Hz spreads a change over more: check that the flags do not "
        f"flicker, or raise cutoff_hz to {needed_hz:.2g} Hz",
        "cutoff_hz",
    )


def below_base(columns: Array) -> Array:
    """Return columns (T, k, ...) of joints with six rows of zeros for the base before them."""
    return np.concatenate([np.zeros((len(columns), 6, *columns.shape[2:])), columns], axis=1)


def load_regression(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Mapping[str, Array],
    further: Callable[[Motion], Array] | None = None,
) -> Regression:
    """Return the load side (8) over time, with the columns of `model`.

    `springs` {joint: parameters of (4b)} gives the load torques of elastic joints; an elastic joint
    that it does not contain takes its joint torque from the log. The torque of known bodies and
    payloads is on the known side y. `further` returns columns (T, rows, k) as of `torque_changes`
    for a piece of the motion; they follow those of the springs in `propagated`.
    """
    samples = PIECE_SAMPLES
    if robot.floating_base is not None:  # has more rows and columns
        motion = _thinned(motion)
        samples = _piece_samples(model)

    def regress(piece: Motion) -> Regression:
        columns = None if further is None else further(piece)
        return _load_rows(robot, piece, model, load_columns(robot, piece, model, springs, columns))

    return rows_by_pieces(motion, regress, samples)


def accelerometer_rows(robot: Robot, motion: Motion, model: LoadModel) -> Regression:
    """Return the rows of `load_regression` with the change of y by a bias of the accelerometer.

    The three columns [N or N m per m/s^2] are in the axes of the base; `robot` has all bodies.
    """

    def columns(piece: Motion) -> Array:
        return accelerated_base(robot, piece.joint_position)

    return _further_rows(robot, motion, model, columns, ("x", "y", "z"), "kg")


def wrench_rows(robot: Robot, motion: Motion, model: LoadModel) -> Regression:
    """Return the rows of `load_regression` with the change of y by zeros of measured wrenches.

    The columns are those of each sensor in turn, in the frame of its link.
    """
    assert motion.base is not None
    widths = {link: values.shape[1] for link, values in motion.base.wrenches.items()}

    def columns(piece: Motion) -> Array:
        assert piece.base is not None
        contacts = [measured_contact(robot, link, width) for link, width in widths.items()]
        # the zeros are in y, where those of an accelerometer are in H
        return -contact_map(robot, piece.joint_position, contacts, piece.base.up, own_frame=True)

    names = tuple(f"{axis} of {link}" for link, n in widths.items() for axis in range(n))
    return _further_rows(robot, motion, model, columns, names, "")


def late_flag_rows(robot: Robot, motion: Motion, model: LoadModel, reach_s: float) -> Regression:
    """Return the rows of `load_regression` with the change of y by forces on feet in the air.

    The two columns are those of a vertical force of 1 N before each landing, and after each time
    that a foot leaves the ground, which fades to zero in `reach_s`; the base needs its orientation.
    """
    assert robot.floating_base is not None
    contacts = [replace(contact, is_flat=False) for contact in robot.floating_base.contacts]

    def columns(piece: Motion) -> Array:
        base = piece.base
        assert base is not None
        assert base.up is not None
        feet = [contact for contact in contacts if contact.link in base.contacts]
        fades = np.array([_fading(base.contacts[x.link], reach_s * piece.rate_hz) for x in feet])
        A = contact_map(robot, piece.joint_position, feet, base.up)
        # (T, 6 + n, 3 k) -> (T, 6 + n, k): the columns of vertical forces of 1 N.
        vertical = A.reshape(*A.shape[:2], len(feet), 3) @ base.up[:, None, :, None]
        return np.asarray(np.einsum("trk,kit->tri", vertical[..., 0], fades))

    return _further_rows(robot, motion, model, columns, ("landing", "leaving"), "")


def _fading(touches: BoolArray, reach: float) -> Array:
    """Return weights (2, T) before and after a contact, from 1 next to it to 0 at `reach`."""
    at, count = np.flatnonzero(touches), len(touches)
    if not len(at):
        return np.zeros((2, count))
    samples = np.arange(count)
    place = np.searchsorted(at, samples)
    until = np.where(place < len(at), at[np.minimum(place, len(at) - 1)] - samples, np.inf)
    since = np.where(place > 0, samples - at[np.maximum(place - 1, 0)], np.inf)
    return np.maximum(1 - np.array([until, since]) / reach, 0.0) * ~touches


def radius_rows(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Mapping[str, Array],
    theta: Array,
    bodies: Array,
) -> Regression:
    """Return the rows of `load_regression` with the change of y by the radius of balls and points.

    It is that of the moments of the contact forces by a fit `theta`, about lower places; the base
    needs its orientation. The other arguments are those of `contact_force_rows`.
    """
    assert robot.floating_base is not None
    joints = [robot.index(joint) for joint in model.torque_joints]
    places = [contact for contact in robot.floating_base.contacts if not contact.is_flat]

    def columns(piece: Motion) -> Array:
        base, q = piece.base, piece.joint_position
        assert base is not None
        contacts = [contact for contact in places if contact.link in base.contacts]
        rows, unknown = contact_force_rows(robot, piece, model, springs, theta, bodies)
        # `contact_equations` are of scaled rows, in which unknown ones are zero.
        rows = rows * row_scale(robot, rows.shape[1])[:, 0]
        rows[:, 6:] *= ~unknown
        _, inverse = contact_equations(robot, q, contacts, base.contacts, joints, unknown, base.up)
        # The map is linear in the radius: its derivative is that at 1 m less that at 0.
        lower, centre = (
            contact_map(robot, q, [replace(contact, radius_m=x) for contact in contacts], base.up)
            for x in (1.0, 0.0)
        )
        return np.asarray((lower - centre) @ (inverse @ rows[:, :, None]))

    return _further_rows(robot, motion, model, columns, ("radius",), "N")


def _further_rows(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    columns_of: Callable[[Motion], Array],
    names: tuple[str, ...],
    unit: str,
) -> Regression:
    """Return the rows of `load_regression` with other columns (T, 6 + n, m) of a piece."""
    motion = _thinned(motion)
    known = [robot.index(joint) for joint in model.torque_joints]

    def regress(piece: Motion) -> Regression:
        base, q = piece.base, piece.joint_position
        assert base is not None
        unknown = unknown_frictions(robot, piece, model.torque_joints)
        A = floating_rows(robot, columns_of(piece), known)
        # in the place of y: zero in rows without an equation only, so that the rows are the same
        any_y = np.broadcast_to(np.cos(np.arange(A.shape[1])), A.shape[:2])
        A = np.concatenate([A, any_y[:, :, None]], axis=2)
        A = without_contact_forces(robot, q, base.contacts, known, A, unknown, base.up)
        A *= base.used[:, None, None]
        columns = (A[:, :, -1], A[:, :, -1] * 0.0, A[:, :, :-1], A[:, :, :0])
        return _load_rows(robot, piece, model, columns, (names, (unit,) * len(names)))

    return rows_by_pieces(motion, regress, _piece_samples(model))


def _piece_samples(model: LoadModel) -> int:
    """Return the samples of the pieces of a floating base, which order its rows."""
    size = (6 + len(model.torque_joints)) * len(model.names)
    return min(max(_PIECE_NUMBERS // size, 1), PIECE_SAMPLES)


def _thinned(motion: Motion) -> Motion:
    """Return the motion of a floating base at a rate that its columns need, if it has no wrenches.

    Its positions have passed a low pass, its measured wrenches have not.
    """
    rate_hz = _RATES * motion.cutoff_hz
    factor = int(motion.rate_hz / rate_hz) if np.isfinite(rate_hz) else 1
    if factor < 2 or motion.base is None or motion.base.wrenches:
        return motion
    return decimated(motion, factor)


def _load_rows(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    columns: tuple[Array, Array, Array, Array],
    called: tuple[tuple[str, ...], tuple[str, ...]] | None = None,
) -> Regression:
    """Return the rows of one piece of a motion, whose `load_columns` are given.

    `called` are the names and units of columns that are not those of `model`.
    """
    torque, payload, H, propagated = columns
    rows = row_samples(motion)
    joints = [robot.index(joint) for joint in model.torque_joints]
    # a combination of equations that are all valid, whatever friction does at rest
    y, H, propagated = (
        in_band_at(motion, with_known_friction(motion, joints, part), rows)
        for part in (torque - payload, H, propagated)
    )
    usable = np.ones((len(joints), len(rows)), dtype=bool)
    for row, joint in enumerate(model.torque_joints):
        usable[row] = usable_rows(robot, motion, joint, rows)
    names = robot.joint_names
    if robot.floating_base is not None and motion.base is not None:
        names = (*names, *BASE_ROWS)
        # The base's rows come first in the columns; their indices follow those of the n joints.
        joints = [*range(robot.n, robot.n + 6), *joints]
        free = np.repeat(robot.floating_base.free_axes[:, None], len(rows), axis=1)
        usable = np.concatenate([free, usable])
        usable &= motion.base.used[rows]
    excluded = usable.size - int(usable.sum())
    if robot.floating_base is not None:  # rows without an equation, as of a base that is held
        usable &= (np.any(H, axis=2) | (y != 0)).T
    # (k, S) -> (R,) rows, equation by equation.
    which, kept = np.nonzero(usable)
    column_names, units = called or (model.names, model.units)
    return Regression(
        names=column_names,
        units=units,
        H=H[kept, which],
        y=y[kept, which],
        joint=np.array(joints)[which],
        time=motion.time[rows[kept]],
        run=np.zeros(len(kept)),
        excluded=excluded,
        propagated=propagated[kept, which],
        joint_names=names,
    )


def with_gear_torque(
    robot: Robot, motion: Motion, model: LoadModel, springs: Mapping[str, Array], theta: Array
) -> Motion:
    """Return the motion with the torque through the gears by a fit `theta` of the load side."""
    check_held(robot, "load-dependent friction", IdentificationError)
    # Friction under load needs a gear torque, but is not among the columns behind the gear.
    unloaded = replace(motion, gear_torque=np.zeros_like(motion.joint_position))
    _, payload, H, _ = load_columns(robot, unloaded, model, springs)
    drives = [
        place
        for place, (joint, name, _) in enumerate(model.drives, len(model.expressions))
        if joint not in robot.elastic_joints and name in motor_regressor(robot, joint).names
    ]
    # A gear passes on the load behind it, without the motor's own friction and inertia.
    behind = [place for place in range(H.shape[2]) if place not in drives]
    torque = np.full_like(motion.joint_position, np.nan)
    torque[:, [robot.index(joint) for joint in model.torque_joints]] = (
        payload + H[:, :, behind] @ theta[behind]
    )
    return replace(motion, gear_torque=torque)


def unknown_frictions(robot: Robot, motion: Motion, joints: Sequence[str]) -> BoolArray:
    """Return `unknown_friction` of several joints (T, k), which may be none."""
    unknown = np.zeros((len(motion.time), len(joints)), dtype=bool)
    for place, joint in enumerate(joints):
        unknown[:, place] = unknown_friction(robot, motion, joint)
    return unknown


def with_known_friction(motion: Motion, joints: Sequence[int], columns: Array) -> Array:
    """Return columns (T, k, ...) of the equations of joints, zero where friction is not known."""
    if not any(motion.has_known_friction(joint) for joint in joints):
        return columns
    each = [motion.where_known(joint, columns[:, row]) for row, joint in enumerate(joints)]
    return np.stack(each, axis=1)


def usable_rows(robot: Robot, motion: Motion, joint: str, rows: IndexArray) -> BoolArray:
    """Return which of some samples give an equation of a joint on the load side."""
    index = robot.index(joint)
    if not motion.has_known_friction(index):
        return ~unknown_friction(robot, motion, joint)[rows]
    assert motion.friction_known is not None
    share = in_band_at(motion, motion.friction_known[:, [index]], rows)[:, 0]
    return np.asarray((share >= LEAST_KNOWN) & ~_group_rests(robot, motion, joint)[rows])


def unknown_friction(robot: Robot, motion: Motion, joint: str) -> BoolArray:
    """Return the samples (T,) at which the load side of a joint has unknown friction.

    These are the standstills of a stiff drive with dry friction, and of joints with dry friction
    of their own.
    """
    index = robot.index(joint)
    unknown = _group_rests(robot, motion, joint)
    if motion.friction_known is not None and motion.has_known_friction(index):
        unknown |= motion.friction_known[:, index] == 0
    elif not robot.drives[joint].is_elastic:
        unknown |= unknown_motor_friction(robot, motion, joint)
    return unknown


def _group_rests(robot: Robot, motion: Motion, joint: str) -> BoolArray:
    """Return the samples (T,) at which joints that a drive moves rest with dry friction."""
    unknown, index = np.zeros(len(motion.time), dtype=bool), robot.index(joint)
    for moved in group_of(robot.transmission, index):
        if "coulomb" in robot.drives[robot.joint_names[moved]].joint_friction:
            unknown |= joint_standstill(motion, moved)
    return unknown


def _load_targets(
    robot: Robot, motion: Motion, rows: Sequence[str], springs: Mapping[str, Array]
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
