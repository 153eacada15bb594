"""The regressor of the rigid bodies by Pinocchio, and base parameters by its QR reduction.

The reduction (Gautier 1991) takes columns from left to right.

`cross_check` compares them with the exact ones of `seaid.regressor.exact`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache, singledispatch
from threading import local
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, BoolArray, IndexArray, frozen, safely
from seaid._progress import Result, counted
from seaid.drives import COMMANDS
from seaid.errors import ExcitationError, RobotError, SeaidError, Seed, checked
from seaid.robot import coupled_groups
from seaid.robot.transmission import rows_at_drives

if TYPE_CHECKING:
    from seaid.log import Motion
    from seaid.robot import Robot

RANK_TOLERANCE = 1e-8
"""A unit column is dependent if its residual after projection on earlier ones is below this."""

_FEWEST_STATES, _WHOLE_STATES = 40, 20
"""Random states for any use, and those in which the torques at all joints determine the bodies."""

_MOST_BYTES = 1e9
"""Limit on the memory in which Pinocchio computes; regressors of many samples come in blocks of a
tenth of it."""

_BLOCK = 32
"""Columns that are projected together, as one product of matrices."""

_ROUNDING = 1e-12
"""Grouping coefficients of unit columns below this are rounding errors."""


INPUTS = {"torque": "tau_M", "current": "i_M", "voltage": "u_M", **dict.fromkeys(COMMANDS, "tau_M")}
"""{motor input: its signal in the drive's equation}."""

INPUT_FIELDS = {
    "torque": "motor_torque",
    "current": "motor_current",
    "voltage": "motor_voltage",
    **dict.fromkeys(COMMANDS, "motor_torque"),
}
"""Field of a motion with a drive's logged input."""


_MEMORY = local()
"""The memory in which Pinocchio computes, for the last tree of each thread."""


def _memory_of(model: pin.Model) -> pin.Data:
    """Return memory for a model: n^3 numbers, shared by models that differ in inertias only."""
    if model is getattr(_MEMORY, "model", None):  # a copy takes as long as ten samples
        return _MEMORY.data
    needed = 64 * model.nv**3  # eight arrays of n^3 numbers
    if needed > _MOST_BYTES:
        raise ExcitationError(
            f"'{model.name}' has {model.nv} joints that move: Pinocchio takes {needed / 1e9:.3g} GB"
            f" for it, allowed are {_MOST_BYTES / 1e9:.3g} GB; let fewer joints move with joints=",
            "joints=",
        )
    tree, weightless = model.copy(), pin.Inertia.Zero()
    for joint in range(model.njoints):
        tree.inertias[joint] = weightless
    if tree != getattr(_MEMORY, "tree", None):
        _MEMORY.data = None  # before other n^3 numbers are there
        _MEMORY.tree, _MEMORY.data = tree, tree.createData()
    _MEMORY.model = model
    return _MEMORY.data


def samples_of_block(robot: Robot) -> int:
    """Return the samples whose regressor takes a tenth of the memory that is allowed, or less."""
    return int(_MOST_BYTES / (8 * robot.parameters.size**2)) + 1


def rigid_body_regressor(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return the joint-torque regressor Y of the rigid bodies: Y[t] @ theta = inverse dynamics.

    Parameters
    ----------
    robot : Robot
    q, v, a : arrays (T, n)
        Joint positions, velocities and accelerations [rad or m, s], in the robot's joint order; of
        a joint whose ratio depends on its angle, those behind the gear, as torques are.

    Returns
    -------
    array (T, n, 10N)
        For standard parameters theta in the order of `robot.parameter_names`; without payload,
        friction and rotor inertia.

    Raises
    ------
    SeaidError
        For wrong shapes.

    Examples
    --------
    >>> Y = seaid.regressor.rigid_body_regressor(robot, q, v, a)
    >>> torque = Y @ robot.parameters
    """
    q, v, a = (
        frozen(name, value, (None, robot.n)) for name, value in zip("qva", (q, v, a), strict=True)
    )
    if not len(q) == len(v) == len(a):
        raise SeaidError(f"q, v and a must have as many rows, found {len(q)}, {len(v)}, {len(a)}")
    moved = robot.joint_states(q, v, a)
    return _regressor(robot, moved[0], robot.model_states(*moved))


def _regressor(robot: Robot, q: Array, states: Sequence[Array]) -> Array:
    """Return the regressor (T, n, 10N) at joint angles (T, n), and at the `states` of the model."""
    model, data, N = robot.model, _memory_of(robot.model), robot.model.nv
    # `block` is a view of the memory that every call fills, and exists after the first call.
    pin.computeJointTorqueRegressor(model, data, *np.zeros((3, N)))
    # Pinocchio's matrix is column-major: its transposed view is copied as one block of bytes, which
    # takes half the time of an assignment to a row.
    block, stacked = data.jointTorqueRegressor.T.reshape(-1).data, np.empty((len(q), 10 * N * N))
    block, target = block.cast("B"), stacked.reshape(-1).view(np.uint8).data
    places, compute = range(0, len(target), len(block)), pin.computeJointTorqueRegressor
    for place, q_t, v_t, a_t in zip(places, *states, strict=True):
        compute(model, data, q_t, v_t, a_t)
        target[place : place + len(block)] = block
    # (T, 10N N) -> (T, 10N, N) as Pinocchio's columns lie in memory -> (T, N, 10N).
    Y = stacked.reshape(-1, 10 * N, N).swapaxes(1, 2)
    order = robot.model_order
    if list(order) != sorted(order) or robot.dependent_joints:
        # Columns from the model's order of bodies to the robot's; the rows follow in `from_model`,
        # which adds those of mimic joints to their leaders'.
        by_body = Y.reshape(len(q), N, N, 10)[:, :, np.argsort(order)].reshape(len(q), N, 10 * N)
        Y = np.moveaxis(robot.from_model(np.moveaxis(by_body, 1, -1)), -1, 1)
    return Y / robot.angle_ratios.rates(q)[..., None] if robot.angle_ratios.by_joint else Y


def regressor_at_drives(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return `rigid_body_regressor` for the torques on the drives' coordinates, (T, n, 10N)."""
    return rows_at_drives(robot.transmission, rigid_body_regressor(robot, q, v, a))


def blocks_at_drives(robot: Robot, states: JointStates, size: int) -> Iterator[tuple[slice, Array]]:
    """Yield slices of `size` samples of states, and `regressor_at_drives` (S, n, 10N) at them."""
    q, *_ = moved = robot.joint_states(*states)
    of_model = robot.model_states(*moved)
    for start in range(0, len(q), size):
        part = slice(start, start + size)
        Y = _regressor(robot, q[part], [state[part] for state in of_model])
        yield part, rows_at_drives(robot.transmission, Y)


def joint_torques(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return the inverse dynamics (T, n) of the robot with its payloads, by Pinocchio's rnea."""
    model, data = robot.model, _memory_of(robot.model)
    moved = robot.joint_states(q, v, a)
    states = robot.model_states(*(np.asarray(state, np.float64) for state in moved))
    torques, rnea = np.empty((len(q), model.nv)), pin.rnea
    for t, (q_t, v_t, a_t) in enumerate(zip(*states, strict=True)):
        torques[t] = rnea(model, data, q_t, v_t, a_t)
    return np.asarray(robot.from_model(torques) / robot.angle_ratios.rates(moved[0]))


def torque_slopes(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return the derivatives (3, T, n, n) of `joint_torques` by the states q, v and a."""
    moved = robot.joint_states(q, v, a)
    states = robot.model_states(*moved)
    slopes = np.ascontiguousarray(robot.from_model(slopes_of_model(robot.model, states), axes=2))
    if not robot.angle_ratios:
        return slopes
    rho, first, second = (robot.angle_ratios.rates(moved[0], k) for k in range(3))
    _, speed, acceleration = moved
    # The derivatives of q' = phi' / rho and q'' = (phi'' - rho_q q'^2) / rho by q; that of q'' by
    # phi' is 2 / rho times the first. Those by phi, phi' and phi'' are derivatives by q over rho.
    of_speed = -first * speed / rho
    of_acceleration = 2 * of_speed**2 - (second * speed**2 + first * acceleration) / rho
    by_q, by_v, by_a = slopes
    by_q = by_q + by_v * of_speed[:, None] + by_a * of_acceleration[:, None]
    slopes = np.stack([by_q, by_v + 2 * by_a * of_speed[:, None], by_a])
    slopes /= rho[:, None] * rho[..., None]
    # The derivative of 1 / rho in tau_phi = tau / rho.
    diagonal = np.arange(robot.n)
    slopes[0][:, diagonal, diagonal] -= joint_torques(robot, q, v, a) * first / rho**2
    return slopes


def check_constant_ratios(robot: Robot, what: str, error: type[SeaidError] = RobotError) -> None:
    """Raise an error if a gear ratio depends on an angle, for what needs constant ones."""
    for index in robot.angle_ratios.by_joint:
        raise error(
            f"{what} needs constant gear ratios, and that of '{robot.joint_names[index]}' depends "
            "on its angle: remove angle_ratio from its drive, or lock the joint"
        )


def incomplete_group(
    joints: Sequence[str], matrix: Array, selected: Collection[str]
) -> tuple[str, ...]:
    """Return the first coupled group of which some joints are selected but not all, or ()."""
    for group in coupled_groups(matrix):
        names = tuple(joints[index] for index in group)
        if 0 < sum(name in selected for name in names) < len(names):
            return names
    return ()


def slopes_of_model(model: pin.Model, states: Sequence[Array]) -> Array:
    """Return d tau / d (q, v, a), (3, T, N, N), at states (T, N) each in the order of a model."""
    data, compute = _memory_of(model), pin.computeRNEADerivatives
    q, v, a = (np.ascontiguousarray(state) for state in states)
    compute(model, data, *np.zeros((3, model.nv)))
    # Views of memory that Pinocchio overwrites at every instant.
    views, tables = (data.dtau_dq, data.dtau_dv, data.M), np.empty((len(q), 3, model.nv, model.nv))
    for table, q_t, v_t, a_t in zip(tables, q, v, a, strict=True):
        compute(model, data, q_t, v_t, a_t)
        table[0], table[1], table[2] = views
    slopes = np.ascontiguousarray(tables.swapaxes(0, 1))
    # Pinocchio fills only the upper triangle of the mass matrix.
    slopes[2] = np.triu(slopes[2]) + np.triu(slopes[2], 1).swapaxes(1, 2)
    return slopes


@dataclass(frozen=True, eq=False, repr=False)
class BaseParameters(Result):
    """The p identifiable combinations of m standard parameters.

    base = grouping @ standard, and Y @ standard = Y[..., columns] @ base for every motion.

    Attributes
    ----------
    columns : tuple of p int
        Indices of the base columns in the standard regressor.
    names : tuple of p str
        The standard parameters of these columns.
    expressions : tuple of p str
        The combinations as text, such as 'Iyy_thigh + 0.0756 m_shank'.
    grouping : array (p, m)
    gap : float
        Smallest accepted over largest rejected relative column residual, the margin of the rank
        decision.
    """

    table_name = "base_table"

    columns: tuple[int, ...]
    names: tuple[str, ...]
    expressions: tuple[str, ...]
    grouping: Array
    gap: float

    def _in_short(self) -> str:
        combinations, parameters = map(counted, self.grouping.shape, ("combination", "parameter"))
        return f"{combinations} of {parameters}, gap {self.gap:.2g}"

    def reduce(self, Y: Array) -> Array:
        """Return the base columns (..., p) of a standard regressor (..., m)."""
        return np.asarray(Y)[..., list(self.columns)]

    def project(self, theta: Array) -> Array:
        """Return the base parameters (p,) of standard parameters (m,), (14)."""
        return self.grouping @ np.asarray(theta)

    def least(self, values: Array) -> Array:
        """Return the standard parameters (m,) of least norm with these base parameters (p,)."""
        inverse = safely(
            np.linalg.pinv, self.grouping, what="the base parameters", error=RobotError
        )
        return np.asarray(inverse @ values)


@checked(RobotError)
def base_parameters(
    robot: Robot,
    motion: Motion | None = None,
    *,
    torque_joints: str | Sequence[str] | None = None,
    seed: Seed = 0,
    stances: Sequence[Sequence[str]] = ((),),
    measured: Sequence[str] = (),
) -> BaseParameters:
    """Return the base parameters of a robot, structural ones or those that a motion excites.

    Parameters
    ----------
    robot : Robot
    motion : Motion, optional
        A motion whose regressor is reduced. Default: random states, which excite every structurally
        identifiable combination.
    torque_joints : list of str, optional
        Joints whose torque is known; of a floating base with measured wrenches also none. Default:
        all.
    seed : int, default 0
        Seed of the random states.
    stances : list of lists of str
        Of a floating base: the links of its contacts that stand on the ground together, of each
        kind of stance that a log has. "hanging" in place of a list is another experiment with the
        base bolted to the world. Default: flight alone.
    measured : list of str, optional
        Links of the stances whose forces, and of flat feet moments, are measured. Points determine
        what flight does; a flat foot that always stands shows its weight and not its inertia.

    Returns
    -------
    BaseParameters
        Without columns of known bodies; empty if all bodies are known.

    Raises
    ------
    ExcitationError
        If nothing is identifiable, or if the regressor is too large for the memory.

    Examples
    --------
    >>> robot = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
    >>> base = seaid.base_parameters(robot)
    >>> len(base.columns), base.expressions[0]
    """
    torques = robot.selected(torque_joints)
    known = tuple(map(robot.index, torques))
    kinds = tuple(links if isinstance(links, str) else tuple(links) for links in stances)
    reduced = _structural if motion is None else _reduced
    columns, grouping, gap = reduced(robot, motion, known, seed, kinds, tuple(measured))
    if not columns and not np.all(robot.is_known):
        raise ExcitationError(
            f"no parameter of '{robot.name}' is identifiable from "
            + (f"the torques at {', '.join(torques)}" if torques else "the forces on its base")
        )
    return base_of_columns(robot.parameter_names, columns, grouping, gap)


def _reduced(
    robot: Robot, motion: Motion | None, known: Joints, seed: int, stances: Stances, measured: Links
) -> tuple[list[int], Array, float]:
    """Return base columns, grouping matrix (p, m) and gap of the bodies, as `base_parameters`."""
    equations = body_equations(robot)
    H = equations.columns(motion, known, seed, stances, measured)
    return equations.left_to_right(H, negligible(H) | robot.is_known)


_structural = lru_cache(_reduced)
"""What random states give is kept for the next sensors, methods and logs of the same robots."""


def with_base_columns(robot: Robot, width: int) -> tuple[list[int], Array, float]:
    """Return the columns of the base parameters and of all drives, of `width` that start with the
    bodies', the grouping (p, width) of all columns by these, and the gap.
    """
    columns, by_base, gap = _structural(robot, None, tuple(range(robot.n)), 0, ((),), ())
    drives = range(by_base.shape[1], width)
    return *with_independent(columns, np.pad(by_base, ((0, 0), (0, len(drives)))), drives), gap


def with_independent(
    columns: Sequence[int], grouping: Array, further: Sequence[int]
) -> tuple[list[int], Array]:
    """Return columns and grouping (p, m) with `further` columns, independent of all others."""
    every = np.array([*columns, *further], dtype=np.intp)
    rows = np.concatenate([grouping, np.eye(grouping.shape[1])[list(further)]])
    order = np.argsort(every)
    return every[order].tolist(), rows[order]


def grouped_by(grouping: Array, further: Array, rounding: float) -> Array:
    """Return the product of two grouping matrices, with zero for what is left of terms by rounding.

    The first one may have no dependent column: then it changes nothing.
    """
    if grouping.shape[0] == grouping.shape[1]:
        return further
    product = grouping @ further
    product[np.abs(product) < rounding * (np.abs(grouping) @ np.abs(further))] = 0.0
    return np.asarray(product)


@dataclass(frozen=True, eq=False)
class BodyEquations:
    """How the bodies of a robot act on its equations, those of joints if its base is held.

    A package that knows another kind of robot registers its equations for the type of that robot.
    """

    robot: Robot

    def columns(
        self, motion: Motion | None, known: Joints, seed: int, stances: Stances, measured: Links
    ) -> Array:
        """Return the columns (rows, m) over a motion, or over random states.

        The other arguments are those of `base_parameters`, with joints `known` by their indices.
        """
        if not known:
            raise ExcitationError(
                "torque_joints= names no joint: give those whose torque is known", "torque_joints="
            )
        robot = self.robot
        H = np.zeros((0, m := robot.parameters.size))
        count = _WHOLE_STATES if 10 * len(known) == m else None
        random = random_states(robot, seed, len(known), count=count)
        states = random if motion is None else motion.joint_states
        for _, Y in blocks_at_drives(robot, states, samples_of_block(robot)):
            # H = Q R has the norms and the dependencies of R.
            R = H if len(H) <= m else np.asarray(np.linalg.qr(H, mode="r"))
            H = np.concatenate([R, Y[:, known].reshape(-1, m)])
        return H

    def left_to_right(self, H: Array, zero: BoolArray) -> tuple[list[int], Array, float]:
        """Return `left_to_right` in the order in which columns are kept."""
        return left_to_right(H, zero)

    def random_rows(
        self, known: Joints, stances: Stances, measured: Links, seed: int = 1
    ) -> Iterator[tuple[JointStates, Array, Callable[[Array], Array]]]:
        """Yield random states of joints, the rows (T, r, m) of bodies there, and a function.

        The function removes from rows what nothing determines, as forces that are not measured.
        """
        q, v, a = states = random_states(self.robot, seed, len(known))
        for part, Y in blocks_at_drives(self.robot, states, samples_of_block(self.robot)):
            yield (q[part], v[part], a[part]), Y[:, known], np.asarray

    def body_columns(self, motion: Motion, known: Joints, columns: IndexArray) -> Array:
        """Return some columns (T, r, c) of the bodies along a motion."""
        return regressor_at_drives(self.robot, *motion.joint_states)[:, known][:, :, columns]

    def check_stances(self, stances: Stances) -> None:
        """Raise RobotError for stances that the robot cannot have."""

    def with_all_rows(self, columns: Array) -> Array:
        """Return columns (T, k, ...) of k joints with the rows (T, r, ...) of other equations."""
        return columns


JointStates = tuple[Array, Array, Array]
"""Positions, velocities and accelerations of joints, each (T, n)."""

Joints = Sequence[int]
Links = Sequence[str]
Stances = Sequence[Links]
"""Joints by their indices, links of contacts, and sets of these that touch the ground together."""


@singledispatch
def body_equations(robot: Robot) -> BodyEquations:
    """Return how the bodies of this kind of robot act on its equations."""
    return BodyEquations(robot)


def four_digits(size: float) -> str:
    """Return the size of a coefficient as text, 0.0756."""
    # A tie at the fifth digit is rounded up, whatever rounding errors have made of it.
    return f"{size * (1 + 1e-9):.4g}"


_LONGEST = 10_000
"""Numerators and denominators of rationals that are shown."""


def rational_text(size: Fraction) -> str:
    """Return the size of a coefficient as text, 121/1600; a long rational as a decimal."""
    is_short = max(size.numerator, size.denominator) <= _LONGEST
    return str(size) if is_short else four_digits(float(size))


def base_of_columns(
    names: Sequence[str],
    columns: Sequence[int],
    grouping: Array,
    gap: float,
    shown: Callable[[float], str] = four_digits,
) -> BaseParameters:
    """Return the base parameters of selected columns of `names` and their grouping matrix."""
    return BaseParameters(
        columns=tuple(columns),
        names=tuple(names[column] for column in columns),
        expressions=tuple(grouped_text(row, names, shown) for row in grouping),
        grouping=frozen("grouping", grouping, (None, len(names))),
        gap=gap,
    )


def random_states(
    robot: Robot, seed: int, torques: int | None = None, *, count: int | None = None
) -> tuple[Array, Array, Array]:
    """Return random q, v, a, enough for a rank decision with `torques` known torques (default n).

    Positions cover a full turn or +-1 m. There are at least three rows per parameter; if all
    torques are known, forty states determine the ten parameters of each body in any robot. `count`
    takes the place of that number. Joints that move in no log stand where they do there.
    """
    rng = np.random.default_rng(seed)
    known = robot.n if torques is None else torques
    # Bodies without a known torque between them act on the rest of the robot by one force and one
    # moment: an instant gives at most six of three rows per parameter.
    enough = -(-30 * (len(robot.body_names) - known + 1) // min(known, 6))
    shape = (count or max(_FEWEST_STATES, enough), robot.n)
    reach = np.where(robot.is_prismatic, 1.0, np.pi)
    q = rng.uniform(-reach, reach, shape)
    v, a = rng.normal(0, 3, shape), rng.normal(0, 10, shape)
    for joint, place in robot.at_rest.items():
        q[:, robot.index(joint)] = place
        v[:, robot.index(joint)] = a[:, robot.index(joint)] = 0.0
    return q, v, a


def left_to_right(
    H: Array, zero: BoolArray | None = None, *, rounding: float = _ROUNDING
) -> tuple[list[int], Array, float]:
    """Return base columns, grouping matrix (p, m) and gap of the columns of H, taken in order.

    Columns marked `zero` (default: exact zeros) are excluded; the others are scaled to unit norm.
    Coefficients of unit columns below `rounding` are set to zero.
    With H = Q R the dependencies of H are those of R, found by Gram-Schmidt with
    reorthogonalisation.
    """
    norms = np.linalg.norm(H, axis=0)
    zero = norms == 0 if zero is None else zero | (norms == 0)
    if not np.all(np.isfinite(norms)):
        raise RobotError(
            "the torques of unit parameters are not finite: lengths or speeds of the robot are "
            "too large to be squared; check that its file is in metres and radians"
        )
    # not by SciPy, whose import takes longer than all base parameters of a leg
    candidates = np.flatnonzero(~zero)
    R = np.asarray(np.linalg.qr(H[:, candidates] / norms[candidates], mode="r"))
    # Until a column is dependent, those of R span unit vectors, and its diagonal has residuals.
    diagonal = np.abs(np.diagonal(R))
    first = int(np.argmin(np.append(diagonal > RANK_TOLERANCE, False)))
    columns = list(range(first))
    # If no column is rejected, the gap is that to rounding.
    accepted, rejected = diagonal[:first].min(initial=1.0), float(np.finfo(float).eps)
    basis = np.eye(R.shape[0], min(R.shape), order="F")  # filled column by column
    places = np.arange(len(candidates))
    for block in np.split(places[first:], range(_BLOCK, len(places) - first, _BLOCK)):
        # R is triangular: further down these columns, and the basis so far, are zero.
        before, rows = len(columns), slice(first, int(block.max(initial=0)) + 1)
        vectors = _projected(R[rows, block], basis[rows, first:before])
        for column, new in zip(block.tolist(), vectors.T, strict=True):
            new = _projected(new, basis[rows, before : len(columns)])
            residual = float(np.linalg.norm(new))
            if residual > RANK_TOLERANCE and len(columns) < basis.shape[1]:
                accepted = min(accepted, residual)
                basis[:, len(columns)] = 0.0
                basis[rows, len(columns)] = new / residual
                columns.append(column)
            else:
                rejected = max(rejected, residual)
    basis = basis[:, : len(columns)]
    dependent = places[~np.isin(places, columns)]
    # R = R_b G: Q^T R_b is triangular up to rounding, and G = (Q^T R_b)^-1 Q^T R.
    solved = safely(
        np.linalg.solve,
        np.triu(basis.T @ R[:, columns]),
        basis.T @ R[:, dependent],
        what="the base parameters",
        error=RobotError,
    )
    # A column depends on base columns before it only.
    solved[(np.abs(solved) < rounding) | (np.array(columns)[:, None] > dependent)] = 0.0
    grouping = np.zeros((len(columns), H.shape[1]))
    kept, others = candidates[columns], candidates[dependent]
    # Unit columns H / s have G_s; for H itself G = s_b^-1 G_s s.
    grouping[:, others] = solved * norms[others] / norms[kept][:, None]
    grouping[np.arange(len(kept)), kept] = 1.0
    return kept.tolist(), grouping, float(accepted / rejected)


def _projected(vectors: Array, Q: Array) -> Array:
    """Return vectors (r,) or (r, b) without their part in the range of orthonormal columns Q."""
    # Twice is enough (Parlett 1980): what rounding has left goes the second time.
    for _ in range(2):
        vectors = vectors - Q @ (Q.T @ vectors)
    return vectors


def grouped_text(
    coefficients: Array, names: Sequence[str], shown: Callable[[float], str] = four_digits
) -> str:
    """Return a combination (m,) as text, 'Iyy_thigh + 0.0756 m_shank', without coefficients 1."""
    places = np.flatnonzero(coefficients)
    terms = tuple(names[place] for place in places.tolist())
    return _text_of(tuple(coefficients[places].tolist()), terms, shown)


def combination_text(
    values: Iterable[Any], terms: Iterable[str], shown: Callable[[Any], str]
) -> str:
    """Return the sum of terms times values as text, with their sizes as they are `shown`."""
    text = ""
    for value, term in zip(values, terms, strict=True):
        size = "" if abs(abs(value) - 1) < 1e-9 else f"{shown(abs(value))} "
        sign = ("-" if value < 0 else "") if not text else (" - " if value < 0 else " + ")
        text += f"{sign}{size}{term}"
    return text


_text_of = lru_cache(4096)(combination_text)
"""Many sets of sensors determine the same combinations."""


def negligible(H: Array, bodies: BoolArray | None = None) -> BoolArray:
    """Return which columns (m,) of H are zero up to rounding, before they are scaled.

    A column of H is the torque of a unit parameter. Their sizes are similar, so that a column far
    below the largest is the trace of a rounded angle. Where only some columns are those of
    `bodies` (m,), the others are of drives, whose sizes differ.
    """
    norms = np.linalg.norm(H, axis=0)
    is_body = np.ones(len(norms), dtype=bool) if bodies is None else bodies
    return np.asarray(is_body & (norms < 1e-9 * norms[is_body].max(initial=0.0)))


AGREEMENT = 1e-9
"""The largest difference of groupings that rounding can cause in a well-conditioned choice."""

_LEAST_GAP = 1e7
"""A rank decision with a smaller gap proves no agreement."""


@dataclass(frozen=True, repr=False)
class CrossCheck(Result):
    """Comparison of numeric and exact base parameters.

    Attributes
    ----------
    agree : bool
        True for the same base columns and `max_difference` below 1e-9 or, in an ill-conditioned
        choice of columns, below 10 / `gap`, to which rounding is amplified.
    same_columns : bool
    max_difference : float
        Largest difference of the grouping matrices, relative to the largest coefficient of the
        base parameter or of the standard parameter; infinite for different columns.
    gap : float
        Margin of the numeric rank decision, see `BaseParameters`.
    counts : (int, int)
        Number of base parameters, numeric and exact.
    """

    table_name = "cross_check_text"

    agree: bool
    same_columns: bool
    max_difference: float
    gap: float
    counts: tuple[int, int]


@checked(SeaidError)
def cross_check(numeric: BaseParameters, exact: BaseParameters) -> CrossCheck:
    """Compare the numeric base parameters of a robot with its exact ones.

    Parameters
    ----------
    numeric, exact : BaseParameters
        Of `seaid.base_parameters` and of `seaid.symbolic.base_parameters`, for the same robot.

    Returns
    -------
    CrossCheck

    Raises
    ------
    SeaidError
        For different numbers of standard parameters.

    Examples
    --------
    >>> exact = seaid.symbolic.base_parameters(robot)
    >>> seaid.cross_check(seaid.base_parameters(robot), exact).agree
    """
    widths = numeric.grouping.shape[1], exact.grouping.shape[1]
    if widths[0] != widths[1]:
        raise SeaidError(
            f"cross_check compares base parameters of one robot, found {widths[0]} and {widths[1]} "
            "standard parameters; make both from the same Robot"
        )
    same = numeric.columns == exact.columns
    difference = float("inf")
    if same:
        # Differences count by the largest coefficient of the row or of the column: units differ.
        rows, columns = (np.max(np.abs(exact.grouping), axis=k, initial=1.0) for k in (1, 0))
        largest = np.maximum(rows[:, None], columns)
        apart = np.abs(numeric.grouping - exact.grouping) / largest
        difference = float(np.max(apart, initial=0.0))
    return CrossCheck(
        agree=same and difference < max(AGREEMENT, 10 / max(numeric.gap, _LEAST_GAP)),
        same_columns=same,
        max_difference=difference,
        gap=numeric.gap,
        counts=(len(numeric.columns), len(exact.columns)),
    )
