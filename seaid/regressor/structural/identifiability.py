"""Structural identifiability: the parameters that a robot's sensors determine, before any log.

A combination of parameters is identifiable if it is in the row space of the derivatives of the
usable equations (`equations`) by all parameters, over all motions. This is decided modulo a prime
(`arithmetic`, `rank`), without rounding, and confirmed in doubles.

Motor angle and motor torque alone determine more with their time derivatives. By (7) the torque on
the load follows from the motor, tau = n (tau_M - sum c_i phi_i) with n = N r_L / r_M and the
columns c_i of inertia and friction; by (4b) the deflection, and so the angle of the joint, with its
derivatives. (8) is then an equation in measured signals, nonlinear in the parameters. Its rows are
its derivatives by all parameters, at random motions that satisfy the equations: their rank is the
number of locally identifiable combinations.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, compress
from typing import Any, Literal, get_args

import numpy as np

from seaid._arrays import Array, FrozenMapping, safely, seed_of
from seaid._progress import Result, counted
from seaid.drives import Drive, JointParameter, delay_sums
from seaid.errors import RobotError, checked, unknown_name
from seaid.regressor.base import BaseParameters, base_parameters, grouped_text, left_to_right
from seaid.regressor.rigid_body import joint_torques, rigid_body_regressor
from seaid.robot import Robot, check_held

Sensor = Literal[
    "motor_position",
    "joint_position",
    "deflection",
    "motor_torque",
    "motor_current",
    "motor_voltage",
    "joint_torque",
]
"""Sensors of a joint: encoders of motor and joint, one across the spring; motor input; torque."""

SENSORS = get_args(Sensor)


@dataclass(frozen=True, eq=False, repr=False)
class Identifiability(Result):
    """Structural identifiability of a robot's parameters, those of the drives and ten per body.

    Attributes
    ----------
    names : tuple of m str
        All parameters.
    identifiable : tuple of str
        Parameters that are identifiable individually.
    combinations : tuple of str
        Expressions that are identifiable only in combination.
    ratios : tuple of tuples of str
        Groups of parameters and combinations that are identifiable up to scale, such as inertias
        over a stiffness if no torque is measured.
    unidentifiable : tuple of str
        Parameters in no usable equation.
    base : BaseParameters
        All of these combinations, groups included, over `names`.
    rank : int
        Number of values that a log determines; a group counts one less than its members.
    usable : mapping {joint: sentences}
        Which equations of a joint are used, and why others cannot be.
    sensors : mapping {joint: names}
    gap : float
        Singular-value gap of the numeric rank decision, see `BaseParameters`.
    agree : bool
        Whether doubles give the same combinations and rank as exact arithmetic; of feet that are
        balls, which exact stances do not have, whether other random states do.
    derivatives : BaseParameters or None
        What the sensors determine locally with their derivatives in time, if motor angle and motor
        torque are all that an elastic joint has; `identify` then estimates it by simulation. The
        rank is numeric. None where there is no such joint, or other terms and sensors.
    commands : tuple of str
        Of each joint with position commands: with which multiples of their delay its armature and
        viscous friction are determined, and how uncertain that leaves them.
    """

    table_name = "sensors_table"

    robot_name: str
    names: tuple[str, ...]
    identifiable: tuple[str, ...]
    combinations: tuple[str, ...]
    ratios: tuple[tuple[str, ...], ...]
    unidentifiable: tuple[str, ...]
    base: BaseParameters
    rank: int
    usable: Mapping[str, tuple[str, ...]]
    sensors: Mapping[str, tuple[str, ...]]
    gap: float
    agree: bool
    derivatives: BaseParameters | None = None
    commands: tuple[str, ...] = ()

    def _in_short(self) -> str:
        kinds = {"individually": self.identifiable, "in combination": self.combinations}
        kinds |= {"up to scale": sum(self.ratios, ()), "unidentifiable": self.unidentifiable}
        counts = ", ".join(f"{len(names)} {kind}" for kind, names in kinds.items())
        return f"'{self.robot_name}': {counted(len(self.names), 'parameter')}: {counts}"

    @property
    def body_count(self) -> int:
        """Number of combinations whose first parameter is a body's: the base parameters."""
        return sum(not isinstance(name, JointParameter) for name in self.base.names)


@checked(RobotError)
def identifiability(
    robot: Robot,
    sensors: Iterable[Sensor] | Mapping[str, Iterable[Sensor]] | None = None,
    *,
    conditions: Sequence[Robot] = (),
    stances: Sequence[Sequence[str]] = ((),),
    seed: int = 0,
) -> Identifiability:
    """Return which parameters a set of sensors can identify, with motions of all joints.

    Of the robot only geometry, ratios and known values are used. Equations that are nonlinear in
    their parameters are linearised at random values, so that the result is local. What a regression
    can use counts; what derivatives of motor angle and motor torque determine besides is in
    `derivatives`.

    Parameters
    ----------
    robot : Robot
    sensors : names for every joint, or mapping {joint: names}, optional
        Of "motor_position", "joint_position", "deflection", "motor_torque", "motor_current",
        "motor_voltage" and "joint_torque"; a joint missing in the mapping has none. A deflection
        gives the position on one side of a spring from the other. Default: the positions on both
        sides of a spring, or of the joint, and the drive's motor input.
    conditions : list of Robot
        The same robot with other payloads or gains, of which there are logs too.
    stances : list of lists of str
        Of a floating base, as in `base_parameters`: what the motion of the base and the torques at
        the joints determine together in these stances. Default: flight alone.
    seed : int, default 0
        Seed of the random instants.

    Returns
    -------
    Identifiability

    Raises
    ------
    RobotError
        For unknown names, and for conditions of another robot.

    Examples
    --------
    >>> sensors = ["motor_position", "joint_position", "motor_current"]
    >>> print(seaid.identifiability(robot, sensors))
    """
    from seaid.regressor.structural.arithmetic import RealNumbers, ResidueNumbers
    from seaid.regressor.structural.equations import explanations, system_of
    from seaid.regressor.structural.rank import decide

    seed = seed_of(seed)
    if robot.floating_base is not None:
        if sensors is not None or conditions:
            check_held(robot, "identifiability with sensors= or conditions=")
        return _stance_result(robot, stances, seed)
    sensed = _sensed(robot, sensors)
    _check_conditions(robot, conditions)
    exact = ResidueNumbers(robot, np.random.default_rng(seed))
    system = system_of(robot, sensed, exact.depends())
    names = system.names
    payloads = [condition.known_parameters for condition in (robot, *conditions)]
    numeric = RealNumbers(robot, np.random.default_rng(seed))
    base, groups, rank, agree = decide(system, payloads, exact, numeric)
    up_to_scale = np.zeros(len(base.names), dtype=bool)
    up_to_scale[list(chain(*groups))] = True
    alone = np.count_nonzero(base.grouping, axis=1) == 1
    missing = ~np.any(base.grouping, axis=0)
    missing[: robot.parameters.size] &= ~robot.is_known
    usable = explanations(system, list(compress(base.names, up_to_scale)))
    return Identifiability(
        robot_name=robot.name,
        names=names,
        identifiable=tuple(compress(base.names, alone & ~up_to_scale)),
        combinations=tuple(compress(base.expressions, ~alone & ~up_to_scale)),
        ratios=tuple(tuple(base.expressions[place] for place in group) for group in groups),
        unidentifiable=tuple(compress(names, missing)),
        base=base,
        rank=rank,
        usable=FrozenMapping(usable),
        sensors=FrozenMapping({x: tuple(sorted(sensed[x], key=SENSORS.index)) for x in sensed}),
        gap=base.gap,
        agree=agree,
        derivatives=base_by_derivatives(robot, sensed, names, seed),
        commands=tuple(filter(None, _delay_sums(robot, conditions))),
    )


def _stance_result(robot: Robot, stances: Sequence[Sequence[str]], seed: int) -> Identifiability:
    """Return what some stances of a floating base determine of its bodies."""
    from seaid.regressor.structural.stances import check_stances, columns_of_stances

    check_stances(robot, stances)
    base = base_parameters(robot, stances=stances, seed=seed)
    alone = np.count_nonzero(base.grouping, axis=1) == 1
    missing = ~np.any(base.grouping, axis=0) & ~robot.is_known
    return Identifiability(
        robot_name=robot.name,
        names=robot.parameter_names,
        identifiable=tuple(compress(base.names, alone)),
        combinations=tuple(compress(base.expressions, ~alone)),
        ratios=(),
        unidentifiable=tuple(compress(robot.parameter_names, missing)),
        base=base,
        rank=len(base.columns),
        usable=FrozenMapping({}),
        sensors=FrozenMapping({}),
        gap=base.gap,
        agree=columns_of_stances(robot, stances, seed=seed) == base.columns,
    )


def _delay_sums(robot: Robot, conditions: Sequence[Robot]) -> Iterator[str]:
    for joint in robot.joint_names:
        drives = [condition.drives[joint] for condition in (robot, *conditions)]
        if all(drive.controller is not None for drive in drives):
            yield delay_sums(joint, drives)


def _sensed(
    robot: Robot, sensors: Iterable[Sensor] | Mapping[str, Iterable[Sensor]] | None
) -> dict[str, frozenset[str]]:
    """Return {joint: sensors} of all joints, checked."""
    if sensors is None:
        return {joint: frozenset(_full_set(robot, joint)) for joint in robot.joint_names}
    if isinstance(sensors, Mapping):
        for joint in sensors:
            robot.index(joint)
        by_joint = {joint: sensors.get(joint, ()) for joint in robot.joint_names}
    else:
        by_joint = dict.fromkeys(robot.joint_names, tuple(sensors))
    return {joint: _checked(joint, names) for joint, names in by_joint.items()}


def _full_set(robot: Robot, joint: str) -> tuple[str, ...]:
    from seaid.regressor.structural.equations import input_sensor

    drive = robot.drives[joint]
    positions = ("motor_position", "joint_position") if drive.is_elastic else ("joint_position",)
    return (*positions, input_sensor(drive))


def _checked(joint: str, names: Iterable[str]) -> frozenset[str]:
    if isinstance(names, str):
        raise RobotError(
            f"sensors of '{joint}' must be a list of names, found the text '{names}': "
            f"write ['{names}']"
        )
    selected = frozenset(names)
    for name in sorted(map(str, selected)):
        if name not in SENSORS:
            raise RobotError(f"sensors of '{joint}': " + unknown_name("sensor", name, SENSORS))
    return selected


def _check_conditions(robot: Robot, conditions: Sequence[Robot]) -> None:
    """Refuse conditions that differ from the robot in more than payloads and gains."""
    model, drives = robot.model, _with_one_gain_set(robot, robot)
    for condition in conditions:
        same = condition.joint_names == robot.joint_names and all(
            a.isApprox(b)
            for a, b in zip(model.jointPlacements, condition.model.jointPlacements, strict=True)
        )
        same = same and condition.known_bodies == robot.known_bodies
        if not same or _with_one_gain_set(condition, robot) != drives:
            raise RobotError(
                "conditions= takes the same robot with other payloads or gains; "
                f"'{condition.name}' has other joints, drives or known bodies than '{robot.name}'"
            )


def _with_one_gain_set(robot: Robot, first: Robot) -> dict[str, Drive]:
    """Return the drives, commanded ones with the controllers of another robot."""
    laws = {joint: drive.controller for joint, drive in first.drives.items()}
    return {
        joint: drive if drive.controller is None else replace(drive, controller=laws[joint])
        for joint, drive in robot.drives.items()
        if drive.controller is None or laws[joint] is not None
    }


_FRICTION = ("viscous", "coulomb", "offset", "quadratic", "asymmetric")
"""Terms of friction whose columns have derivatives here."""

_POINTS, _STEP_S = np.arange(-6, 7), 0.03
"""Samples about an instant; a polynomial through them gives four derivatives of a torque."""

_ORDERS = 5

_INSTANTS_PER_PARAMETER = 3

_ZERO, _ROUNDED = 1e-9, 1e-6
"""Norm of a column that is zero, and part of a column below which another one in it is rounding:
the fourth derivatives have errors of 1e-8."""


def is_motor_only(drive: Drive, sensors: frozenset[str]) -> bool:
    """Return whether an elastic joint has motor angle and motor torque, and nothing behind."""
    behind = {"joint_position", "deflection", "joint_torque"}
    return (
        drive.is_elastic and {"motor_position", "motor_torque"} <= sensors and not behind & sensors
    )


def base_by_derivatives(
    robot: Robot, sensors: Mapping[str, frozenset[str]], names: Sequence[str], seed: int
) -> BaseParameters | None:
    """Return the combinations of `names` that sensors determine with their derivatives.

    None without an elastic joint that has motor angle and motor torque only, and for robots with
    sensors or terms that have no columns here: coupled drives, nonlinear springs, other friction,
    joints whose position or torque is not measured.
    """
    joints = robot.joint_names
    alone = (is_motor_only(robot.drives[joint], sensors[joint]) for joint in joints)
    if not any(alone) or not all(_is_covered(robot, joint, sensors[joint]) for joint in joints):
        return None
    rng = np.random.default_rng(seed)
    bodies = rng.normal(size=robot.parameters.size)
    plausible = _plausible(robot) if np.all(np.isfinite(robot.parameters)) else bodies
    plausible_robot = robot.with_values(plausible, robot.drives)
    stiffness = rng.uniform(50.0, 200.0, robot.n)
    for index, joint in enumerate(joints):
        stiffness[index] = robot.drives[joint].values.get("stiffness", stiffness[index])
    # A stiff drive has no deflection: tau / (r_L k) is zero.
    stiffness[~np.isin(joints, robot.elastic_joints)] = np.inf
    places = {name: place for place, name in enumerate(names)}
    count = max(20, -(-_INSTANTS_PER_PARAMETER * len(names) // robot.n))
    rows = (_rows(plausible_robot, stiffness, sensors, places, rng) for _ in range(count))
    H = np.vstack(list(rows))
    H[:, : robot.parameters.size][:, robot.is_known] = 0.0
    return _base_of(H, names)


def _base_of(H: Array, names: Sequence[str]) -> BaseParameters:
    """Return the base parameters of rows, without entries of the grouping that are rounding."""
    norms = np.linalg.norm(H, axis=0)
    columns, grouping, gap = left_to_right(H, norms < _ZERO)
    norms[norms < _ZERO] = 1.0
    # Coefficients of unit columns are compared, since parameters differ in unit and size.
    small = np.abs(grouping) * norms[columns][:, None] / norms < _ROUNDED
    grouping = np.where(small, 0.0, grouping)
    return BaseParameters(
        columns=tuple(columns),
        names=tuple(names[column] for column in columns),
        expressions=tuple(grouped_text(row, names) for row in grouping),
        grouping=grouping,
        gap=gap,
    )


def _plausible(robot: Robot) -> Array:
    """Return the standard parameters of the robot, with masses where it has none."""
    bodies = robot.parameters.reshape(-1, 10).copy()
    empty = bodies[:, 0] <= 0
    bodies[empty] = [1.0, 0.1, 0.05, 0.08, 0.05, 0.0, 0.06, 0.0, 0.0, 0.04]
    return bodies.ravel()


def _is_covered(robot: Robot, joint: str, sensors: frozenset[str]) -> bool:
    drive = robot.drives[joint]
    if {*drive.friction} - {*_FRICTION} or drive.motor_input != "torque":
        return False
    if any((drive.parallel_spring, drive.joint_friction, drive.extra_terms, drive.transmission)):
        return False
    if not drive.is_elastic:
        position = {"joint_position", "motor_position"} & sensors
        return bool(position and {"motor_torque", "joint_torque"} & sensors)
    seen = {"joint_position", "motor_position", "motor_torque"} <= sensors
    return drive.spring == ("linear",) and (seen or is_motor_only(drive, sensors))


@dataclass(frozen=True)
class _Instant:
    """Derivatives (5, n) of order 0 to 4 of joint positions and of the torques on the joints."""

    position: Array
    torque: Array


def _instant(robot: Robot, rng: np.random.Generator) -> _Instant:
    """Return a random motion at an instant, by sums of two sines per joint."""
    amplitude = rng.uniform(0.3, 1.0, (2, robot.n))
    frequency, phase = rng.uniform(1.0, 3.0, (2, robot.n)), rng.uniform(0, 6.3, (2, robot.n))

    def moved(time: Array, order: int) -> Array:
        angle = frequency * time[:, None, None] + phase + order * np.pi / 2
        return np.asarray(np.sum(amplitude * frequency**order * np.sin(angle), axis=1))

    time: Array = _STEP_S * _POINTS.astype(np.float64)
    torques = joint_torques(robot, *(moved(time, order) for order in range(3)))
    # weights of derivatives by the polynomial through the points
    powers = np.vander(_POINTS.astype(float), increasing=True)
    weights = safely(np.linalg.inv, powers, what="the samples about an instant")[:_ORDERS]
    factorials = np.cumprod([1.0, *range(1, _ORDERS)])
    # The k-th derivative of a polynomial at 0 is k! times its coefficient of t^k.
    scale = factorials / _STEP_S ** np.arange(_ORDERS)
    now: Array = np.zeros(1)
    position = np.array([moved(now, order)[0] for order in range(_ORDERS)])
    return _Instant(position, scale[:, None] * (weights @ torques))


def _rows(
    robot: Robot,
    stiffness: Array,
    sensors: Mapping[str, frozenset[str]],
    places: Mapping[str, int],
    rng: np.random.Generator,
) -> Array:
    """Return the derivatives of (8), and of (7) where it is used, by all parameters at an instant.

    The drive of a joint with a torque sensor is not in (8). `places` {parameter: column}.
    """
    at = _instant(robot, rng)
    rows, further = np.zeros((robot.n, len(places))), []
    rows[:, : robot.parameters.size] = -rigid_body_regressor(robot, *at.position[:3, None])[0]
    for index, joint in enumerate(robot.joint_names):
        if "joint_torque" in sensors[joint]:
            continue
        drive, k = robot.drives[joint], stiffness[index]
        is_alone = is_motor_only(drive, sensors[joint])
        reach, lever = drive.load_radius, drive.ratio / drive.motor_radius
        # (4b) and (3): d = tau / (r_L k), theta_M = N / r_M (r_L q + d), and so their derivatives.
        d = at.torque[:, index] / (reach * k)
        columns = _columns(drive, lever * (reach * at.position[:, index] + d))
        if is_alone or not drive.is_elastic:  # r_L f = r_L N / r_M (tau_M - c phi)
            load = {name: -lever * reach * column[0] for name, column in columns.items()}
        else:
            load = {"stiffness": reach * d[0], "spring_offset": reach}
            further.append(np.zeros(len(places)))
            motor = {name: column[0] for name, column in columns.items()}
            # (7): r_M / N (k d + f_0) at the motor.
            motor |= {"stiffness": d[0] / lever, "spring_offset": 1.0 / lever}
            _add(further[-1], places, joint, motor)
        if is_alone:  # q = (r_M / N theta_M - d) / r_L
            changes = {name: -lever / k * column for name, column in columns.items()}
            changes |= {"stiffness": -d[:3] / k, "spring_offset": np.array([-1.0 / k, 0.0, 0.0])}
            felt = _felt(robot, at.position[:3], index)
            torques = {name: felt @ change / reach for name, change in changes.items()}
            # The angle of this joint is in the torques of all joints: by the chain rule.
            _add(rows.T, places, joint, torques)
        _add(rows[index], places, joint, load)
    return np.vstack([rows, *further])


def _add(row: Array, places: Mapping[str, int], joint: str, values: Mapping[str, Any]) -> None:
    """Add {parameter of a drive: value} to a row, or columns to the transpose of rows.

    Known parameters have no place.
    """
    for name, value in values.items():
        if (place := places.get(f"{name} of {joint}")) is not None:
            row[place] += value


def _columns(drive: Drive, motor: Array) -> dict[str, Array]:
    """Return the columns of (7) and their first two derivatives, by those of the motor angle."""
    w, rate, jerk, snap = motor[1:5]
    sign = np.sign(w)
    square = [w**2, 2 * w * rate, 2 * (rate**2 + w * jerk)]
    of_terms = {
        "viscous": ("viscous_friction", [w, rate, jerk]),
        "coulomb": ("coulomb_friction", [sign, 0.0, 0.0]),
        "offset": ("friction_offset", [1.0, 0.0, 0.0]),
        "quadratic": ("quadratic_friction", [sign * x for x in square]),
        "asymmetric": ("asymmetric_friction", [sign * x for x in (w, rate, jerk)]),
    }
    pairs = (of_terms[term] for term in drive.friction)
    columns = {name: np.array(column) for name, column in pairs}
    return columns | {"motor_inertia": np.array([rate, jerk, snap])}


_DIFFERENCE = 1e-5


def _felt(robot: Robot, states: Array, index: int) -> Array:
    """Return the derivatives (n, 3) of all torques by the states (3, n) of a joint."""
    slopes = np.empty((robot.n, 3))
    for order in range(3):
        ends = []
        for step in (_DIFFERENCE, -_DIFFERENCE):
            moved = states.copy()
            moved[order, index] += step
            ends.append(joint_torques(robot, *moved[:, None])[0])
        slopes[:, order] = (ends[0] - ends[1]) / (2 * _DIFFERENCE)
    return slopes
