"""The plant: numbers and functions of the complete model (7) and (8), and its mass matrix.

All joints are in the order of Pinocchio's model, but in `torque_jacobians` and `response_to`, by
which joints move when the load side (8) is linearised along a motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import chain

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, BoolArray, IndexArray, safely
from seaid.drives import PARAMETERS_OF, Drive
from seaid.drives.angle_ratio import Ratios
from seaid.drives.functions import DriveFunctions, drive_functions, is_plain, simulated_value
from seaid.drives.terms import BY_TEMPERATURE, WARM_UP
from seaid.errors import RobotError
from seaid.log import Motion
from seaid.regressor.base import torque_slopes
from seaid.robot import Robot, coupled_groups, torques_at_drives

_safely = partial(safely, what="the mass matrix", error=RobotError)


POSITION, SPEED, JOINT_POSITION, JOINT_SPEED = range(4)
"""Rows of a state (4, n): motor angle and speed, joint position and speed."""

MEMORY_ROWS = {"friction": 4, "spring": 5}
"""Further rows (6, n) of a robot with hysteresis: states of its laws, `drives.equations`."""

_SHORTEST_STEP_S = 1e-6
"""Step [s] below which friction is refused as too stiff to simulate."""

_COLDEST_K = 50.0
"""Distance from the reference temperature at which steps are still short enough."""


@lru_cache(maxsize=64)
def holding(model: pin.Model, joints: tuple[int, ...]) -> pin.Model:
    """Return the model in which some joints stand still: their rotors are infinitely heavy.

    The articulated inertia I - U D^-1 U^T of a body at such a joint is then I, and its acceleration
    D^-1 u is zero, both exactly (Featherstone 2008, chapter 7).
    """
    held = model.copy()
    held.armature[list(joints)] = np.inf
    return held


@dataclass(frozen=True, eq=False)
class Plant:
    """Numbers of the complete model, each (n,); stiffness 0 and not `elastic` for a stiff drive.

    `model` has the rotor inertia of stiff drives, reflected to the joint, as armature. If drives
    move several joints, `coupling` is C of phi = C q; if joints follow others, `expansion` is E, e
    of all positions E q + e (N) of the model. `ratios` are those that depend on the angle of a
    joint, whose position is phi in all states. In these cases `rotors` (n, n) has the rotor inertia
    instead. Drives with more than plain friction and a linear spring are in `functions`, by index,
    and have zeros in `viscous`, `coulomb` and `stiffness`. No step is longer than `longest_step`
    [s].
    """

    model: pin.Model
    drives: tuple[Drive, ...]
    elastic: BoolArray
    ratio: Array
    motor_inertia: Array
    viscous: Array
    coulomb: Array
    motor_radius: Array
    load_radius: Array
    stiffness: Array
    functions: tuple[tuple[int, DriveFunctions], ...]
    longest_step: float
    coupling: Array | None
    ratios: Ratios
    rotors: Array | None
    expansion: tuple[Array, Array] | None

    def expanded(self, state: Array, order: int = 0) -> Array:
        """Return positions (n,), or time derivatives of an `order`, of all joints of the model."""
        if self.expansion is None:
            return state
        E, e = self.expansion
        return np.asarray(E @ state + e if order == 0 else E @ state)

    def reduced(self, torque: Array) -> Array:
        """Return torques (n,) from those on all joints of the model, by the principle of power."""
        return np.array(torque if self.expansion is None else torque @ self.expansion[0])

    @cached_property
    def mobility(self) -> Array:
        """1/I_M (n,), zero for a stiff drive, whose motor moves as its load does."""
        return np.where(self.elastic, 1 / np.where(self.elastic, self.motor_inertia, 1.0), 0.0)

    @cached_property
    def turning(self) -> Array:
        """N C (n, n), the motor speeds of stiff drives by those of the joints; rows of zeros."""
        C = np.eye(len(self.elastic)) if self.coupling is None else self.coupling
        return np.where(self.elastic, 0.0, self.ratio)[:, None] * C

    @cached_property
    def drive_matrix(self) -> Array:
        """Rates of a state, then the torques on joints and on rotors, by what acts (6n, 7n).

        This is the plain part of (4b) and (7), with zeros in the rows of joint accelerations, and
        motors that their own torques move; hysteresis adds rows of zeros. What acts are motor
        angles and speeds, joint positions and speeds, motor torques, slip directions, and, if there
        are any, forces of springs in `functions`.
        """
        angle, speed, position, moving, torque, slip, force = np.eye(7 * len(self.elastic)).reshape(
            7, len(self.elastic), -1
        )
        drives = position if self.coupling is None else self.coupling @ position
        lever, k = (values[:, None] for values in (self.motor_radius / self.ratio, self.stiffness))
        # (3): F_s = k (r_M/N theta_M - r_L phi)
        spring = force + k * (lever * angle - self.load_radius[:, None] * drives)
        # (7) but for the spring and I_M theta'': tau_M - F_v theta' - F_C slip
        free = torque - self.viscous[:, None] * speed - self.coulomb[:, None] * slip
        # (4b) at springs, r_L F_s; N times the motor torque at stiff drives, whose rotors are in M
        on_spring = self.load_radius[:, None] * spring
        load = np.where(self.elastic[:, None], on_spring, self.ratio[:, None] * free)
        load = load if self.coupling is None else self.coupling.T @ load
        rotor = np.where(self.elastic[:, None], free - lever * spring, free)
        motor = self.mobility[:, None] * rotor
        memory = [np.zeros_like(load)] * (self.rows - JOINT_SPEED - 1)
        matrix = np.concatenate([speed, motor, moving, 0 * load, load, rotor, *memory])
        return matrix if self.functions else matrix[:, : -len(load)].copy()

    @cached_property
    def changes(self) -> bool:
        """Whether friction changes with temperature or time."""
        return any({*BY_TEMPERATURE, *WARM_UP} & {*drive.friction} for drive in self.drives)

    @cached_property
    def memory(self) -> tuple[tuple[int, int, tuple[float, float], float], ...]:
        """Joint, row of the state, levers of motor and joint, and width of each hysteresis."""
        return tuple(_memory(self.drives))

    @cached_property
    def rows(self) -> int:
        """Number of rows of a state."""
        return JOINT_SPEED + 1 + (len(MEMORY_ROWS) if self.memory else 0)

    @cached_property
    def under_load(self) -> tuple[int, ...]:
        """Indices of the drives whose friction depends on the torque through a stiff gear."""
        return tuple(index for index, drive in self.functions if drive.is_under_load)

    @cached_property
    def dry_joints(self) -> IndexArray:
        """Indices (m,) of the joints with dry friction between their two bodies."""
        return np.array(
            [index for index, drive in self.functions if drive.joint_level > 0], dtype=np.intp
        )

    @cached_property
    def joint_coulomb(self) -> Array:
        """The level (m,) [N m or N] of the dry friction at `dry_joints`."""
        return np.array([drive.joint_level for _, drive in self.functions if drive.joint_level > 0])

    @cached_property
    def is_dry(self) -> BoolArray:
        """Whether friction can stick (n + m,): at the n motors, then at the m dry joints."""
        dry = self.coulomb > 0
        for index, drive in self.functions:
            dry[index] = drive.is_dry
        return np.append(dry, np.ones(len(self.dry_joints), dtype=bool))

    @cached_property
    def acts_on_load(self) -> BoolArray:
        """Whether friction (n + m,) acts on the load side when it sticks."""
        return np.append(~self.elastic, np.ones(len(self.dry_joints), dtype=bool))

    @cached_property
    def places(self) -> IndexArray:
        """The joints (n + m,) at which friction acts, if none are coupled."""
        return np.append(np.arange(len(self.elastic)), self.dry_joints)

    @cached_property
    def uncoupling(self) -> Array | None:
        """The inverse of `coupling`."""
        if self.coupling is None:
            return None
        return np.asarray(
            safely(np.linalg.inv, self.coupling, what="a transmission", error=RobotError)
        )


def warmed(plant: Plant, temperature: Array | None, time_s: float = 0.0) -> Plant:
    """Return the plant at the temperatures (n,) of its motors [degC], and a time of its log.

    `temperature` None: those of reference.
    """
    if not plant.changes:
        return plant
    at_reference = np.array([drive.reference_temperature_degC for drive in plant.drives])
    by = np.zeros(len(at_reference)) if temperature is None else temperature - at_reference
    functions = tuple(
        (index, function.at(Delta_T=float(by[index]), t_log=max(time_s, 0.0)))
        for index, function in plant.functions
    )
    return replace(plant, functions=functions)


def _memory(drives: Sequence[Drive]) -> Iterator[tuple[int, int, tuple[float, float], float]]:
    for index, drive in enumerate(drives):
        # a law moves on with the motor angle, or with the deflection r_M/N theta_M - r_L q
        stretch = drive.motor_radius / drive.ratio, -drive.load_radius
        for kind, levers in (("friction", (1.0, 0.0)), ("spring", stretch)):
            if "dahl" in getattr(drive, kind):
                width = drive.values[PARAMETERS_OF[kind]["dahl"][1]]
                yield index, MEMORY_ROWS[kind], levers, width


def inertia(plant: Plant, data: pin.Data, position: Array) -> Array:
    """Return the mass matrix (n, n) of a plant, E^T M E with dependent joints, rotors included."""
    (q,) = plant.ratios.at_joints(position)
    upper = np.triu(pin.crba(plant.model, data, plant.expanded(q)))
    M = upper + np.triu(upper, 1).T
    if plant.expansion is not None:
        M = plant.expansion[0].T @ M @ plant.expansion[0]
    if plant.ratios:
        rho = plant.ratios.rates(q)
        M = M / np.outer(rho, rho)
    return np.asarray(M if plant.rotors is None else M + plant.rotors)


def inverse_dynamics(plant: Plant, data: pin.Data, states: Sequence[Array]) -> Array:
    """Return the torques (n,) of a state q, v, a, without rotors that are in `rotors`."""
    if plant.expansion is None and not plant.ratios:  # most robots, at each step
        return np.array(pin.rnea(plant.model, data, *states))
    moved = plant.ratios.at_joints(*states)
    expanded = (plant.expanded(state, order) for order, state in enumerate(moved))
    torques = plant.reduced(pin.rnea(plant.model, data, *expanded))
    return torques / plant.ratios.rates(moved[0]) if plant.ratios else torques


def effective_inertia(plant: Plant, position: Array | None = None) -> Array:
    """Return the effective inertia (n,) at each drive with the others free, by default at zero.

    It is 1 / diag(C M^-1 C^T), the operational-space inertia (Khatib 1987) of each phi = C q.
    """
    n = len(plant.elastic)
    C = np.eye(n) if plant.coupling is None else plant.coupling
    at = np.zeros(n) if position is None else position
    M = inertia(plant, plant.model.createData(), at)
    return np.asarray(1 / np.diag(C @ _safely(np.linalg.solve, M, C.T)))


def plant_of(robot: Robot) -> Plant:
    """Return the plant of a robot with payloads; raise RobotError for a missing nominal value."""
    if not np.all(np.isfinite(robot.parameters)):
        raise RobotError(f"'{robot.name}' has no inertial parameters: it cannot be simulated")
    order = robot.joint_order
    names = [robot.joint_names[index] for index in order]
    drives = [robot.drives[name] for name in names]
    rows, functions = zip(*map(_of_drive, range(robot.n), names, drives), strict=True)
    numbers = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    elastic = numbers["elastic"]
    # C is in the order of the robot; the plant has that of the model on both sides
    C = robot.transmission[np.ix_(order, order)]
    is_coupled = bool(coupled_groups(robot.transmission))
    armature = np.where(elastic, 0.0, numbers["ratio"] ** 2 * numbers["motor_inertia"])
    # E (N, n): all joints by the independent ones, both in the order of the model
    E = robot.expand(np.eye(robot.n)[order], 1).T[list(robot.model_order)]
    e = robot.to_model(np.zeros(robot.n))
    ratios = robot.angle_ratios.in_order(order)
    is_square = not any((robot.dependent_joints, is_coupled, ratios))
    model = robot.model.copy()
    # armature is a diagonal over the joints of the model, and cannot be C^T diag(N^2 I_M) C
    model.armature = armature if is_square else np.zeros(model.nv)
    plant = Plant(
        model=model,
        drives=tuple(drives),
        **numbers,
        functions=tuple(chain(*functions)),
        longest_step=np.inf,
        coupling=C if is_coupled else None,
        ratios=ratios,
        rotors=None if is_square else C.T @ np.diag(armature) @ C,
        expansion=(E, e) if robot.dependent_joints else None,
    )
    return replace(plant, longest_step=_longest_step(names, plant))


def _of_drive(
    index: int, name: str, drive: Drive
) -> tuple[dict[str, float], list[tuple[int, DriveFunctions]]]:
    """Return the numbers of a drive by the fields of `Plant`, and its functions if it has any."""
    try:
        return _numbers(drive), [] if is_plain(drive) else [(index, drive_functions(drive))]
    except RobotError as problem:
        raise problem.at(f"joint '{name}'") from None


_PLAIN = {"viscous": "viscous_friction", "coulomb": "coulomb_friction", "linear": "stiffness"}
"""{term of a plain drive: its parameter}."""


def _numbers(drive: Drive) -> dict[str, float]:
    """Return the numbers of a drive by the fields of `Plant`. Raises RobotError without one."""
    motor_inertia = simulated_value(drive, "motor_inertia")
    if motor_inertia == 0 and drive.is_elastic:
        raise RobotError("an elastic drive needs a motor inertia to be simulated")
    # Other drives have functions for friction and spring.
    terms = [*drive.friction, *drive.spring] if is_plain(drive) else []
    values = {term: simulated_value(drive, _PLAIN[term]) for term in terms}
    return {
        "elastic": drive.is_elastic,
        "ratio": drive.ratio,
        "motor_inertia": motor_inertia,
        "viscous": values.get("viscous", 0.0),
        "coulomb": values.get("coulomb", 0.0),
        "motor_radius": drive.motor_radius,
        "load_radius": drive.load_radius,
        "stiffness": values.get("linear", 0.0),
    }


def _longest_step(names: Sequence[str], plant: Plant) -> float:
    """Return the longest step [s] that the damping of the joints allows."""
    longest = np.inf
    effective = effective_inertia(plant) if plant.functions else np.ones(0)
    for index, _ in plant.functions:
        rate = _damping_rate(plant.drives[index], float(effective[index]))
        # one time constant; the fourth-order Runge-Kutta method is stable up to 2.78 of them
        step = 1 / rate if rate > 0 else np.inf
        if step < _SHORTEST_STEP_S:
            raise RobotError(
                f"joint '{names[index]}': its friction has a time constant of {1 / rate:.2g} s, "
                "too stiff to simulate: give a larger coulomb_width_rad_per_s or "
                "presliding_angle_rad, or use the term 'coulomb' (sharp) instead"
            )
        longest = min(longest, step)
    return longest


def _damping_rate(drive: Drive, effective: float) -> float:
    """Return the rate [1/s] of the damping: each coefficient over the inertia that it brakes."""
    values = drive.values
    damping = values.get("spring_damping", 0.0)
    at_joint = values.get("joint_viscous_friction", 0.0)
    rate = (at_joint + damping * drive.load_radius**2) / effective
    at_motor = values.get("viscous_friction", 0.0)
    at_motor += _COLDEST_K * abs(values.get("viscous_temperature_slope", 0.0))
    at_motor += max(values.get("cold_viscous_friction", 0.0), 0.0)
    if "coulomb_width" in values:
        level = values.get("coulomb_friction", 0.0) + abs(values.get("stribeck_friction", 0))
        at_motor += level / max(values["coulomb_width"], 1e-300)  # slope of F tanh(w / w_C)
    if "presliding_angle" in values:  # resonance of the motor on its bristles, not a damping
        inertia = drive.motor_inertia_kg_m2 if drive.is_elastic else effective
        lever = 1.0 if drive.is_elastic else drive.ratio**2
        stiffness = values.get("coulomb_friction", 0.0) / max(values["presliding_angle"], 1e-300)
        rate += math.sqrt(lever * stiffness / float(inertia or 1.0))
    if drive.is_elastic:
        inertia = float(drive.motor_inertia_kg_m2 or 0.0)
        # damping of the spring acts on the deflection, by the lever r_M / N at the motor
        return rate + (at_motor + damping * (drive.motor_radius / drive.ratio) ** 2) / inertia
    return rate + at_motor * drive.ratio**2 / effective


def torque_jacobians(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Return the derivatives (3, T, n, n) of the inverse dynamics by q, v and a, payloads included.

    Pinocchio adds inertias of bodies, which needs positive masses, and estimated ones may be
    negative. Torques are linear in the parameters: equal masses are added, and theirs subtracted.
    """
    bodies = (robot.parameters + robot.payload_parameters).reshape(-1, 10)
    if np.all(bodies[:, 0] > 0):
        return torque_slopes(robot, q, v, a)
    added = np.zeros_like(bodies)
    added[:, 0] = 2.0 * np.max(np.abs(bodies[:, 0]), initial=1.0)
    heavier = robot.with_values(robot.parameters + added.ravel(), robot.drives)
    alone = robot.with_values(added.ravel() - robot.payload_parameters, robot.drives)
    return torque_slopes(heavier, q, v, a) - torque_slopes(alone, q, v, a)


def jacobians_at_drives(transmission: Array, jacobians: Array) -> Array:
    """Return derivatives (3, T, n, n) in the coordinates of the drives, C^-T J C^-1."""
    turned = torques_at_drives(transmission, jacobians).swapaxes(2, 3)
    return torques_at_drives(transmission, turned).swapaxes(2, 3)


def response_to(jacobians: Array, force: Array, step: float, windows: int) -> Array:
    """Integrate M a + C v + K q = force (T, joints, columns) by Newmark's method.

    K, C and M are the `jacobians` (3, T, joints, joints). Returns the changes of q, v and a,
    (3, T, joints, columns + 2 joints): the joints start each of the equally long `windows` at rest,
    and the last columns are the free motions from a unit of each initial position and velocity. The
    frequency of an undamped oscillation is of fourth order in `step` if the samples resolve it (Fox
    and Goodwin 1949), else of second order.
    """
    T, joints, columns = force.shape
    free = 2 * joints
    K, C, M = jacobians.reshape(3, windows, T // windows, joints, joints)
    force = force.reshape(windows, T // windows, joints, columns)
    force = np.concatenate([force, np.zeros((*force.shape[:3], free))], axis=3)
    # Newmark 1959 with gamma = 1/2: beta = 1/12 is stable for step^2 K / M < 6, beta = 1/4 (the
    # trapezoidal rule) always
    # The norm of M^-1 K is a bound of the squared angular frequencies.
    solve = partial(safely, np.linalg.solve, what="a simulated motion")
    rates = solve(M, K)
    fastest = step**2 * float(np.max(np.linalg.norm(rates, axis=(2, 3)), initial=0.0))
    # Samples resolve an oscillation of less than one radian from each to the next.
    beta = 1 / 12 if fastest < 1.0 else 1 / 4
    # (M + h/2 C + beta h^2 K) a_t = f_t - C v~ - K q~, with v~ and q~ by the state before.
    matrix = M + step / 2 * C + beta * step**2 * K
    inverse = safely(np.linalg.inv, matrix, what="a simulated motion")
    count = force.shape[1]
    q, v, a = response = np.zeros((3, count, windows, joints, columns + free))
    # The last columns have no force, and start from a unit of position or of velocity.
    q[0, :, :, columns : columns + joints] = np.eye(joints)
    v[0, :, :, columns + joints :] = np.eye(joints)
    a[0] = solve(M[:, 0], force[:, 0] - C[:, 0] @ v[0] - K[:, 0] @ q[0])
    for t in range(1, count):
        v_t = v[t - 1] + step / 2 * a[t - 1]
        q_t = q[t - 1] + step * v[t - 1] + (0.5 - beta) * step**2 * a[t - 1]
        a[t] = inverse[:, t] @ (force[:, t] - C[:, t] @ v_t - K[:, t] @ q_t)
        v[t], q[t] = v_t + step / 2 * a[t], q_t + beta * step**2 * a[t]
    return response.swapaxes(1, 2).reshape(3, T, joints, columns + free)


def with_joints(motion: Motion, joints: list[int], states: Array | Sequence[Array]) -> Motion:
    """Return the motion with position, velocity and acceleration of some joints replaced."""
    q, v, a = (state.copy() for state in motion.joint_states)
    for whole, part in zip((q, v, a), states, strict=True):
        whole[:, joints] = part
    return replace(
        motion, joint_position=q, joint_velocity=v, joint_acceleration=a, deflection=None
    )
