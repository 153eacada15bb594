"""The load side of a robot whose base moves: six more rows, and contact forces eliminated.

- `FloatingBodies` and `FloatingLoadSide` take the place of the equations of a base that is held;
- `contact_force_rows` and `contact_force_columns`: what the forces of contacts must hold;
- `accelerometer_rows`, `wrench_rows`, `late_flag_rows`, `radius_rows`: by how much an error of a
  sensor, of a flag or of a foot changes the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, compress

import numpy as np
from scipy.interpolate import CubicSpline

from seaid._arrays import Array, BoolArray, IndexArray
from seaid.errors import LogError, RobotError, unknown_name
from seaid.legged.floating import (
    FloatingRobot,
    accelerated_base,
    base_of,
    contact_equations,
    contact_map,
    floating_regressor,
    floating_rows,
    guided,
    measured_contact,
    measured_wrenches,
    row_scale,
    stance_rows,
    without_contact_forces,
)
from seaid.log import Motion, row_samples
from seaid.log.base_log import LEAST_LIFT, BaseMotion, loaded
from seaid.log.motion import POSITION_BAND, decimated
from seaid.log.rows import PIECE_SAMPLES
from seaid.regressor import Regression
from seaid.regressor.base import BodyEquations, Joints, JointStates, Links, Stances, left_to_right
from seaid.regressor.load import (
    LoadColumns,
    LoadModel,
    LoadSide,
    Springs,
    drive_columns,
    drive_parameters,
    drive_torques,
    joined,
    load_rows,
    load_signals,
    load_targets,
    unknown_frictions,
)
from seaid.regressor.regression import rows_by_pieces
from seaid.robot import BASE_ROWS, HANGING, Robot

_RATES = 16.0
"""Rate over the cutoff at which columns of a floating base are computed: products of three of its
positions, whose band is five times the cutoff, have no image below the cutoff then. On walks of a
Go2, a Solo12 and a G1 parameters change by 0.04 to 0.10 standard errors (rms) from those at the
rate of the log, by 0.02 to 0.06 at 30 and by 0.10 to 0.14 at 12."""

_PIECE_NUMBERS = 40_000_000
"""Numbers of the regressor of a floating base that are in memory at a time: 320 MB."""

_BLOCK_NUMBERS = 1_000_000
"""Numbers of the regressor of a floating base that are computed at a time: few megabytes."""


@dataclass(frozen=True, eq=False)
class FloatingBodies(BodyEquations):
    """The bodies of a robot with a floating base, whose six rows come before those of joints."""

    robot: FloatingRobot

    def columns(
        self, motion: Motion | None, known: Joints, seed: int, stances: Stances, measured: Links
    ) -> Array:
        """Return the columns (rows, m) over a motion, or over random stances."""
        if motion is not None:
            base, q = base_of(motion), motion.joint_position
            Y, robot = self.body_columns(motion, known), guided(self.robot, base.guided)
            rows = [without_contact_forces(robot, q, base.contacts, known, Y, up=base.up)]
        else:
            random = self.random_rows(known, stances, measured, seed)
            rows = [reduced(Y) for _, Y, reduced in random]
        return np.concatenate([block.reshape(-1, block.shape[2]) for block in rows])

    def left_to_right(self, H: Array, zero: BoolArray) -> tuple[list[int], Array, float]:
        """Return `left_to_right` of the columns of all bodies, the base before the others."""
        order = np.roll(np.arange(H.shape[1]), 10)  # the base is the last body
        columns, grouping, gap = left_to_right(H[:, order], zero[order])
        base_columns = [int(order[column]) for column in columns]
        return base_columns, grouping[:, np.argsort(order)], gap

    def random_rows(
        self, known: Joints, stances: Stances, measured: Links, seed: int = 1
    ) -> Iterator[tuple[JointStates, Array, Callable[[Array], Array]]]:
        """Yield the `stance_rows` of each stance."""
        for place, links in enumerate(stances):
            yield stance_rows(self.robot, links, seed + place, known, measured)

    def body_columns(
        self, motion: Motion, known: Joints, columns: IndexArray | None = None
    ) -> Array:
        """Return some columns (T, 6 + k, c) of the bodies, or all, with contact forces."""
        base, some = base_of(motion), None if columns is None else columns.tolist()
        Y = floating_regressor(self.robot, *motion.joint_states, base.states, some)
        return floating_rows(guided(self.robot, base.guided), Y, known)

    def check_stances(self, stances: Stances) -> None:
        """Raise RobotError for links of stances that are no contacts of the robot."""
        known = self.robot.floating_base.contact_links
        for links in stances:
            for link in () if links == HANGING else links:
                if link not in (*known, *BASE_ROWS):
                    raise RobotError(
                        f"stances=: {unknown_name('contact', link, known)}", "stances="
                    )

    def with_all_rows(self, columns: Array) -> Array:
        """Return columns of joints with six rows of zeros for the base before them."""
        return below_base(columns)


@dataclass(frozen=True, eq=False)
class FloatingLoadSide(LoadSide):
    """The load side of a robot with a floating base, without contact forces."""

    robot: FloatingRobot

    def stances(self, motions: Sequence[Motion]) -> tuple[Stances, Links]:
        """Return the sets of contacts that touch the ground together, and those measured."""
        return stances_of(self.robot, motions)

    def columns(
        self, motion: Motion, model: LoadModel, springs: Springs, further: Array | None = None
    ) -> LoadColumns:
        """Return the `load_columns`."""
        return floating_columns(self.robot, motion, model, springs, further=further)

    def torques(
        self, motion: Motion, model: LoadModel, springs: Springs, thetas: Array
    ) -> tuple[Array, Array, Array]:
        """Return torque, payload, and H @ `thetas`, without the many columns in memory."""
        columns = floating_columns(self.robot, motion, model, springs, thetas)
        return columns.torque, columns.payload, columns.H

    def contact_torques(self, motion: Motion, model: LoadModel) -> Array | float:
        """Return what measured wrenches contribute to the torque (T, rows) of `load_columns`."""
        base, q = base_of(motion), motion.joint_position
        if not base.wrenches:
            return 0.0
        robot = guided(self.robot, base.guided)
        joints = [robot.index(joint) for joint in model.torque_joints]
        unknown = unknown_frictions(robot, motion, model.torque_joints)
        rows = measured_wrenches(robot, q, base.wrenches, joints, base.up)[:, :, None]
        rows = without_contact_forces(robot, q, base.contacts, joints, rows, unknown, base.up)
        return np.asarray(rows[:, :, 0] * base.used[:, None])

    def parts(self, motion: Motion, equations: Array) -> Callable[[Array], dict[int, Array]]:
        """Return the factors of torques at the drives in equations without contact forces."""
        joints = np.unique(equations[equations < self.robot.n]).astype(int).tolist()
        units = np.tile(np.eye(6 + len(joints)), (len(motion.time), 1, 1))
        rows = as_equations(self.robot, motion, joints, units)[:, :, 6:-1]
        of_equations = dict(zip(_indices(self.robot, joints), rows.swapaxes(0, 1), strict=True))
        return lambda torques: {x: y @ torques[joints] for x, y in of_equations.items()}

    def in_pieces(self, motion: Motion, model: LoadModel) -> tuple[Motion, int]:
        """Return the thinned motion, and the samples of its pieces, which order its rows."""
        return thinned(motion), _piece_samples(model)

    def with_all_equations(
        self, motion: Motion, rows: IndexArray, joints: Joints, usable: BoolArray
    ) -> tuple[tuple[str, ...], Joints, BoolArray]:
        """Return names, indices and usable samples with those of the base before them.

        The indices of the rows of the base follow those of the n joints.
        """
        base = base_of(motion)
        robot = guided(self.robot, base.guided)
        free = np.repeat(robot.free_axes[:, None], len(rows), axis=1)
        usable = np.concatenate([free, usable]) & base.used[rows]
        return (*robot.joint_names, *BASE_ROWS), _indices(robot, joints), usable

    def with_equation(self, usable: BoolArray, H: Array, y: Array) -> BoolArray:
        """Return the usable rows without those of zeros, as of a base that is held."""
        return np.asarray(usable & (np.any(H, axis=2) | (y != 0)).T)


def floating_columns(
    robot: Robot,
    motion: Motion,
    model: LoadModel,
    springs: Springs,
    thetas: Array | None = None,
    further: Array | None = None,
) -> LoadColumns:
    """Return the `load_columns` of a floating base, without contact forces, block by block.

    With `thetas` (p + p_d, k) the field `H` has no columns but torques H @ thetas (T, rows, k).
    """
    base, q = base_of(motion), motion.joint_position
    robot, joints = guided(robot, base.guided), model.torque_joints
    joint_places, p = [robot.index(joint) for joint in joints], len(model.base.columns)
    known_bodies = np.flatnonzero(robot.known_parameters)
    torque, propagated = load_targets(robot, motion, joints, springs)
    # M v' + h = S^T tau + sum J_c^T w: the base has no motor, so that its rows begin with zeros.
    torque = below_base(torque) + measured_wrenches(robot, q, base.wrenches, joint_places, base.up)
    unknown = unknown_frictions(robot, motion, joints)
    drives = drive_columns(robot, motion, model)()
    propagated = joined(below_base(propagated), further)
    if thetas is not None:
        drives = drives @ thetas[p:]
    drives, count = below_base(drives), len(model.names) if thetas is None else thetas.shape[1]
    table = np.zeros((*torque.shape, count + 2 + propagated.shape[2]))
    step = max(_BLOCK_NUMBERS // (torque.shape[1] * len(model.names)), 1)
    for start in range(0, len(q), step):
        part = slice(start, start + step)
        piece = base.samples(part)
        # Rows of zeros are no equations: `with_equation` excludes them.
        if not np.any(piece.used):
            continue
        states = (q[part], motion.joint_velocity[part], motion.joint_acceleration[part])
        Y = floating_regressor(robot, *states, piece.states, [*model.base.columns, *known_bodies])
        Y = floating_rows(robot, Y, joint_places)
        payload = Y[:, :, p:] @ robot.known_parameters[known_bodies]
        if thetas is None:
            H = np.concatenate([Y[:, :, :p], drives[part]], axis=2)
        else:
            H = Y[:, :, :p] @ thetas[:p] + drives[part]
        # The projection is linear and the same for both sides of the equations.
        both = np.stack([payload, torque[part]], axis=2)
        rows = np.concatenate([H, both, propagated[part]], axis=2)
        rows = without_contact_forces(
            robot, states[0], piece.contacts, joint_places, rows, unknown[part], piece.up
        )
        table[part] = rows * piece.used[:, None, None]
    # The last column of `columns` is the payload itself.
    columns, torque, propagated = np.split(table, [count + 1, count + 2], axis=2)
    return LoadColumns(torque[:, :, 0], propagated, columns.__getitem__, np.ones(1))


def _indices(robot: Robot, joints: Joints) -> list[int]:
    """Return the indices of the equations of the base, which follow those of joints, and of k."""
    return [*range(robot.n, robot.n + 6), *joints]


def as_equations(robot: Robot, motion: Motion, joints: Joints, rows: Array) -> Array:
    """Return rows (T, 6 + k, m) of the base and of k joints without contact forces.

    They have one column more, which is zero only where a row is no equation.
    """
    base, q = base_of(motion), motion.joint_position
    unknown = unknown_frictions(robot, motion, [robot.joint_names[joint] for joint in joints])
    robot = guided(robot, base.guided)
    # No combination of contact forces makes these zero.
    nonzero = np.broadcast_to(np.cos(np.arange(rows.shape[1])), rows.shape[:2])
    rows = np.concatenate([rows, nonzero[:, :, None]], axis=2)
    rows = without_contact_forces(robot, q, base.contacts, joints, rows, unknown, base.up)
    return np.asarray(rows * base.used[:, None, None])


def late_base(
    robot: Robot, motion: Motion, joints: Joints, bodies: Array, delay_s: float
) -> dict[int, Array]:
    """Return {index of an equation: torque (T,) of a base that is ahead, less the logged one}.

    It is that of `bodies` (10N,). A base that is `delay_s` late is right so much ahead.
    """
    base, time = base_of(motion), motion.time
    ahead_s = np.clip(time + delay_s, time[0], time[-1])
    ahead = [CubicSpline(time, state)(ahead_s) for state in base.states]
    change = _body_rows(robot, motion, joints, ahead, bodies)
    change -= _body_rows(robot, motion, joints, base.states, bodies)
    rows = as_equations(robot, motion, joints, change[:, :, None])
    return dict(zip(_indices(robot, joints), rows[:, :, 0].T, strict=True))


def _body_rows(
    robot: Robot, motion: Motion, joints: Joints, base_states: Sequence[Array], bodies: Array
) -> Array:
    """Return the rows (T, 6 + k) of bodies, block by block, whose base has some states."""
    rows = np.empty((len(motion.time), 6 + len(joints)))
    step = max(_BLOCK_NUMBERS // (rows.shape[1] * len(bodies)), 1)
    for start in range(0, len(rows), step):
        part = slice(start, start + step)
        (q, v, a), (w, e, f) = ([x[part] for x in y] for y in (motion.joint_states, base_states))
        Y = floating_regressor(robot, q, v, a, (w, e, f)) @ bodies
        rows[part] = floating_rows(robot, Y[:, :, None], joints)[:, :, 0]
    return rows


def contact_force_rows(
    robot: Robot, motion: Motion, model: LoadModel, springs: Springs, theta: Array, bodies: Array
) -> tuple[Array, BoolArray]:
    """Return the generalised forces (T, 6 + k) that contacts balance, and unknown rows (T, k).

    They are Y `bodies` less the torques of the drives by a fit `theta` of the load side; the
    friction of unknown rows is not known.
    """
    base = base_of(motion)
    robot = guided(robot, base.guided)
    joints = [robot.index(joint) for joint in model.torque_joints]
    rows = _body_rows(robot, motion, joints, base.states, bodies)
    rows -= below_base(drive_torques(robot, motion, model, springs, theta))
    return rows, unknown_frictions(robot, motion, model.torque_joints)


def contact_force_columns(
    robot: Robot, motion: Motion, model: LoadModel, samples: IndexArray
) -> tuple[Array, Array]:
    """Return the columns C (S, 6 + k, m) of contact forces by all parameters, and a grouping G.

    The m parameters are those of all bodies, of the identified drives, and the absorbed ones. The f
    identified combinations are G (f, m) times these: forces follow from them alone where each row
    of C is a combination of the rows of G, C = C_f G.
    """
    base, p = base_of(motion), len(model.base.columns)
    robot = guided(robot, base.guided)
    joints = [robot.index(joint) for joint in model.torque_joints]
    q, v, a = (state[samples] for state in motion.joint_states)
    angular_velocity, angular_acceleration, specific_force = (x[samples] for x in base.states)
    base_states = angular_velocity, angular_acceleration, specific_force
    Y = floating_rows(robot, floating_regressor(robot, q, v, a, base_states), joints)
    signals_of = partial(load_signals, robot, motion)
    of_drives, drives = drive_parameters(robot, model.torque_joints, signals_of)
    wanted = [drives.index(drive) for drive in (*model.drives, *model.absorbed)]
    grouping = np.zeros((len(model.names), Y.shape[2] + len(wanted)))
    grouping[:p, : Y.shape[2]] = model.base.grouping
    grouping[p:, Y.shape[2] : Y.shape[2] + len(model.drives)] = np.eye(len(model.drives))
    grouping[:, Y.shape[2] + len(model.drives) :] = model.absorption
    columns = below_base(of_drives(wanted)[samples])
    force_columns = np.concatenate([Y, columns], axis=2)
    is_unknown = ~np.concatenate([robot.is_known, np.zeros(len(wanted), bool)])
    return force_columns * is_unknown, grouping * is_unknown


def stances_of(robot: FloatingRobot, motions: Sequence[Motion]) -> tuple[Stances, Links]:
    """Return the sets of contacts that touch the ground together in motions of a floating base.

    The second result are those among them with measured wrenches: flat feet that have one in each
    log. A flat foot that never lifts determines only its weight.
    """
    bases = [base_of(motion) for motion in motions]
    flat = _measured_feet(robot, bases)
    stances = dict.fromkeys(chain(*(_base_stances(base, flat) for base in bases)))
    if not any(np.any(base_of(x).used[row_samples(x)]) for x in motions):
        raise _no_used_sample(motions)
    return tuple(stances), flat


def _measured_feet(robot: FloatingRobot, bases: Sequence[BaseMotion]) -> tuple[str, ...]:
    """Return the flat contacts that have a measured wrench in each log."""
    flat = (contact.link for contact in robot.floating_base.contacts if contact.is_flat)
    return tuple(link for link in flat if all(link in base.wrenches for base in bases))


def _base_stances(base: BaseMotion, flat: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the sets of contacts that touch the ground together, `flat` by their wrenches."""
    touching = {**base.contacts, **{link: loaded(base.wrenches[link]) for link in flat}}
    if not touching:
        return [base.guided]
    # (samples, contacts) of the samples that are used; each different row is a stance.
    patterns = np.array([flags[base.used] for flags in touching.values()]).T
    stances = np.unique(patterns, axis=0)
    return [(*compress(touching, pattern), *base.guided) for pattern in stances]


def _no_used_sample(motions: Sequence[Motion]) -> LogError:
    """Return the error of motions whose contacts change too often for their cutoff."""
    longest_s = 0.0
    for motion in motions:
        base = base_of(motion)
        flags = np.array([*base.contacts.values(), *map(loaded, base.wrenches.values())])
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
    widths = {link: values.shape[1] for link, values in base_of(motion).wrenches.items()}

    def columns(piece: Motion) -> Array:
        contacts = [measured_contact(robot, link, width) for link, width in widths.items()]
        # the zeros are in y, where those of an accelerometer are in H
        up = base_of(piece).up
        return -contact_map(robot, piece.joint_position, contacts, up, own_frame=True)

    names = tuple(f"{axis} of {link}" for link, n in widths.items() for axis in range(n))
    return _further_rows(robot, motion, model, columns, names, "")


def late_flag_rows(
    robot: FloatingRobot, motion: Motion, model: LoadModel, reach_s: float
) -> Regression:
    """Return the rows of `load_regression` with the change of y by forces on feet in the air.

    The two columns are those of a vertical force of 1 N before each landing, and after each time
    that a foot leaves the ground, which fades to zero in `reach_s`; the base needs its orientation.
    """
    contacts = [replace(contact, is_flat=False) for contact in robot.floating_base.contacts]

    def columns(piece: Motion) -> Array:
        base = base_of(piece)
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
    robot: FloatingRobot,
    motion: Motion,
    model: LoadModel,
    springs: Springs,
    theta: Array,
    bodies: Array,
) -> Regression:
    """Return the rows of `load_regression` with the change of y by the radius of balls and points.

    It is that of the moments of the contact forces by a fit `theta`, about lower places; the base
    needs its orientation. The other arguments are those of `contact_force_rows`.
    """
    joints = [robot.index(joint) for joint in model.torque_joints]
    places = [contact for contact in robot.floating_base.contacts if not contact.is_flat]

    def columns(piece: Motion) -> Array:
        base, q = base_of(piece), piece.joint_position
        contacts = [contact for contact in places if contact.link in base.contacts]
        rows, unknown = contact_force_rows(robot, piece, model, springs, theta, bodies)
        # `contact_equations` are of scaled rows, in which unknown ones are zero.
        rows = rows * row_scale(robot, rows.shape[1])[:, 0]
        rows[:, 6:] *= ~unknown
        held = guided(robot, base.guided)
        _, inverse = contact_equations(held, q, contacts, base.contacts, joints, unknown, base.up)
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
    motion = thinned(motion)
    joints = [robot.index(joint) for joint in model.torque_joints]

    def regress(piece: Motion) -> Regression:
        held = guided(robot, base_of(piece).guided)
        A = as_equations(robot, piece, joints, floating_rows(held, columns_of(piece), joints))
        bodies, torque, none = np.split(A, [A.shape[2] - 1, A.shape[2]], axis=2)
        columns = LoadColumns(torque[:, :, 0], none, bodies.__getitem__, np.zeros(0))
        return load_rows(robot, piece, model, columns, (names, (unit,) * len(names)))

    return rows_by_pieces(motion, regress, _piece_samples(model))


def _piece_samples(model: LoadModel) -> int:
    """Return the samples of the pieces of a floating base, which order its rows."""
    size = (6 + len(model.torque_joints)) * len(model.names)
    return min(max(_PIECE_NUMBERS // size, 1), PIECE_SAMPLES)


def thinned(motion: Motion) -> Motion:
    """Return the motion of a floating base at a rate that its columns need, if it has no wrenches.

    Its positions have passed a low pass, its measured wrenches have not.
    """
    rate_hz = _RATES * motion.cutoff_hz
    factor = int(motion.rate_hz / rate_hz) if np.isfinite(rate_hz) else 1
    if factor < 2 or base_of(motion).wrenches:
        return motion
    return decimated(motion, factor)
