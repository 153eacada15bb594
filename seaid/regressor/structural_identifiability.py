"""Structural identifiability: the parameters that a robot's sensors determine, before any log.

A combination of parameters is identifiable if it is in the row space of the derivatives of the
usable equations (`sensor_equations`) by all parameters, over all motions. The rank is decided at
random instants (`random_instants`) by the singular-value gap, and confirmed at others: columns that
are independent at some instants are so in general, and a dependency that holds at instants which
were not used to find it holds everywhere. Without a clear gap more instants are drawn.

The columns of bodies are first those of their base parameters, which group the others whatever the
sensors are. Each sum of equations is then reduced by itself, the smallest first, like the torque of
the outermost joint of a tree: only what no sum determines alone is reduced together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, partial, singledispatch
from itertools import chain, compress
from typing import Literal, get_args

import numpy as np

from seaid._arrays import Array, FrozenMapping, connected_groups
from seaid._progress import Result, counted
from seaid.drives import Drive, ParameterName
from seaid.drives.drives import stated_delay_s
from seaid.errors import RobotError, Seed, checked, unknown_name
from seaid.regressor.base import (
    BaseParameters,
    base_of_columns,
    four_digits,
    grouped_by,
    left_to_right,
    negligible,
    rational_text,
    with_base_columns,
    with_independent,
)
from seaid.regressor.motor_only import ROWS_PER_PARAMETER, base_by_derivatives
from seaid.regressor.random_instants import SumRows, dependencies, random_truth, rows_of_sums
from seaid.regressor.sensor_equations import (
    MOTOR_SIGNALS,
    System,
    explanations,
    input_sensor,
    plain,
    system_of,
)
from seaid.robot import Robot
from seaid.robot.robot import check_held

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
        Whether the singular-value gap is clear, and the combinations hold at other random states
        than those that determined them. Of a floating base: whether other random states have the
        same base parameters.
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
        return sum(not ParameterName.of(name).owner for name in self.base.names)


@checked(RobotError)
def identifiability(
    robot: Robot,
    sensors: Iterable[Sensor] | Mapping[str, Iterable[Sensor]] | None = None,
    *,
    conditions: Sequence[Robot] = (),
    stances: Sequence[Sequence[str]] = ((),),
    seed: Seed = 0,
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
    if not robot.base_is_held:
        if sensors is not None or conditions:
            check_held(robot, "identifiability with sensors= or conditions=")
        return of_stances(robot, stances, seed)
    sensed = _sensed(robot, sensors)
    _check_conditions(robot, conditions)
    system = system_of(robot, sensed, dependencies(robot, seed))
    payloads = [condition.known_parameters for condition in (robot, *conditions)]
    base, groups, rank, is_certain = _decided(system, payloads, seed)
    up_to_scale = np.zeros(len(base.names), dtype=bool)
    up_to_scale[list(chain(*groups))] = True
    alone = np.count_nonzero(base.grouping, axis=1) == 1
    missing = ~np.any(base.grouping, axis=0)
    missing[: robot.parameters.size] &= ~robot.is_known
    usable = explanations(system, list(compress(base.names, up_to_scale)))
    return Identifiability(
        robot_name=robot.name,
        names=system.names,
        identifiable=tuple(compress(base.names, alone & ~up_to_scale)),
        combinations=tuple(compress(base.expressions, ~alone & ~up_to_scale)),
        ratios=tuple(tuple(base.expressions[place] for place in group) for group in groups),
        unidentifiable=tuple(compress(system.names, missing)),
        base=base,
        rank=rank,
        usable=FrozenMapping(usable),
        sensors=FrozenMapping({x: tuple(sorted(sensed[x], key=SENSORS.index)) for x in sensed}),
        gap=base.gap,
        agree=is_certain,
        derivatives=base_by_derivatives(robot, sensed, system.names, seed),
        commands=tuple(_delay_sums(robot, conditions)),
    )


@singledispatch
def of_stances(robot: Robot, stances: Sequence[Sequence[str]], seed: int) -> Identifiability:
    """Return what some stances of a floating base determine, for a robot that has one."""
    raise TypeError(f"the base of {robot} is held")


def _delay_sums(robot: Robot, conditions: Sequence[Robot]) -> Iterator[str]:
    for joint in robot.joint_names:
        drives = [condition.drives[joint] for condition in (robot, *conditions)]
        has_delay = any(map(stated_delay_s, drives))
        if has_delay and all(drive.controller is not None for drive in drives):
            yield delay_sums(joint, drives)


def delay_sums(joint: str, drives: Sequence[Drive]) -> str:
    """Return what logs with the gain sets of some drives of a joint determine of its delay T.

    To first order T adds (K_d + F_v) T to the armature and K_p T to the viscous friction.
    """
    within = max(map(stated_delay_s, drives))
    pairs = []
    for drive in drives:
        laws = drive.law
        assert laws is not None
        # F_v of the motor is F_v N^2 at the joint.
        friction = drive.values.get("viscous_friction", 0.0) * drive.ratio**2
        pair = laws.velocity_gain_Nms_per_rad + friction, laws.position_gain_Nm_per_rad
        pairs += [pair] * (pair not in pairs)
    text = "; and ".join(
        f"armature + {slope:.3g} T" + (f" and viscous friction + {gain:.4g} T" if gain else "")
        for slope, gain in pairs
    )
    start = f"{joint}: with the delay T of its commands, to first order, {text}"
    if len(pairs) > 1:
        return f"{start}: these {len(pairs)} gain sets separate them"
    (slope, gain), ms = pairs[0], 1e3 * within
    return (
        f"{start}: alone they are uncertain by {slope * within:.2g} and {gain * within:.2g} for T "
        f"within {ms:.3g} ms; a log with another gain set separates them"
    )


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


_FEWEST_INSTANTS = 48
"""Random instants of which some are on both sides of a dead zone: of 24, one draw in 300 was on one
side only."""

_FRESH_INSTANTS, _MOST_DRAWS = 8, 3
"""Instants that confirm a decision, and how often it is made with twice the instants."""

_CLEAR_GAP = 1e4
"""Singular-value gap from which a rank decision is clear."""

_ROUNDED = 1e-8
"""Coefficients of unit columns below this are rounding errors."""

_CONFIRMED = 1e-6
"""Largest error, over the size of its terms, of a dependency at instants that were not used."""

Groups = tuple[tuple[int, ...], ...]


_Decision = tuple[BaseParameters, Groups, int, bool]
"""Identifiable combinations, groups of their indices that are up to scale, the rank, and whether
it is certain."""


@dataclass(frozen=True, eq=False)
class _Columns:
    """Independent `places` of m columns, and the `grouping` (len(places), m) of all by these.

    `is_confirmed` is whether the singular-value `gap` is clear and other instants have the same
    dependencies.
    """

    places: list[int]
    grouping: Array
    gap: float
    is_confirmed: bool

    def base(self, names: Sequence[str]) -> BaseParameters:
        """Return the combinations of all parameters by their names."""
        return base_of_columns(names, self.places, self.grouping, self.gap, _shown)


def _decided(system: System, payloads: Sequence[Array], seed: int) -> _Decision:
    """Return the identifiable combinations, for logs with each of the known `payloads` (10N,)."""
    if not system.sums:
        none = _Columns([], np.zeros((0, len(system.names))), float("inf"), is_confirmed=True)
        return none.base(system.names), (), 0, True
    for draw in range(_MOST_DRAWS):
        rng = np.random.default_rng((seed, draw))
        loads = sum(any(system.equations[e].kind == "load" for e in x) for x in system.sums)
        enough = ROWS_PER_PARAMETER * (system.robot.parameters.size // max(loads, 1))
        decision = _decision(system, payloads, rng, 2**draw * max(enough, _FEWEST_INSTANTS))
        if decision[-1]:
            break
    return decision


def _decision(
    system: System, payloads: Sequence[Array], rng: np.random.Generator, count: int
) -> _Decision:
    """Return the decision at so many random instants."""
    truth, bodies = random_truth(system, rng), system.robot.parameters.size

    def rows_on_true_motions(instants: int) -> list[SumRows]:
        sums = (rows_of_sums(system, truth, rng, instants, payload) for payload in payloads)
        return list(chain(*sums))

    of_bodies = _Columns(*with_base_columns(system.robot, len(system.names)), is_confirmed=True)
    at_free_instants = partial(rows_of_sums, system, truth, rng)
    free = _confirmed(at_free_instants, count, of_bodies, bodies, rng)
    base, rank = free.base(system.names), len(free.places)
    if not (free.places and _can_be_homogeneous(system)):
        return base, (), rank, free.is_confirmed
    # True motions may determine less than free instants do, such as what has no scale.
    true = _confirmed(rows_on_true_motions, count, free, bodies, rng)
    is_certain = free.is_confirmed and true.is_confirmed
    groups = _groups(free, true) if len(true.places) < rank else ()
    return base, groups, len(true.places), is_certain


def _confirmed(
    rows_at: Callable[[int], list[SumRows]],
    count: int,
    among: _Columns,
    bodies: int,
    rng: np.random.Generator,
) -> _Columns:
    """Return `_independent` columns `among` some, and whether instants besides `count` confirm it.

    The columns among which they are chosen group all others, whatever the rows are.
    """
    places, grouping, gap = _independent(rows_at(count), among, bodies)
    grouping, gap = grouped_by(grouping, among.grouping, _ROUNDED), min(gap, among.gap)
    holds = _is_confirmed(rows_at(_FRESH_INSTANTS), places, grouping, bodies, rng)
    return _Columns(places, grouping, gap, bool(gap > _CLEAR_GAP) and holds)


def _independent(
    rows: Sequence[SumRows], among: _Columns, bodies: int
) -> tuple[list[int], Array, float]:
    """Return `left_to_right` of sums of equations `among` columns, of which `bodies` come first.

    A sum that determines all of its columns but those that smaller sums determine makes these
    columns independent of all others: they are excluded from the large matrix. Of a tree of bodies
    whose torques are all in sums nothing is left of it, so that the cost is that of the rows.
    """
    width, gaps = among.grouping.shape[1], [float("inf")]
    norms, is_open, alone = np.zeros(width), np.zeros(width, dtype=bool), list[int]()
    for columns, values in rows:
        norms[columns] = np.hypot(norms[columns], np.linalg.norm(values, axis=0))
    is_open[among.places] = True
    is_open &= ~negligible(norms[None], np.arange(width) < bodies)
    for columns, values in sorted(rows, key=lambda row: len(row[0])):
        # What is zero in a sum up to rounding is not determined by it.
        k = is_open[columns] & (np.linalg.norm(values, axis=0) > 1e-9 * norms[columns])
        if 0 < np.count_nonzero(k) < len(values):
            pivots, _, gap = left_to_right(values[:, k])
            if len(pivots) == np.count_nonzero(k):
                is_open[columns[k]] = False
                alone += columns[k].tolist()
                gaps.append(gap)
    unit = np.eye(width)
    left = [values @ unit[columns] for columns, values in rows if is_open[columns].any()]
    H = np.concatenate([unit[:0], *left])
    chosen, grouping, gap = left_to_right(H, ~is_open, rounding=_ROUNDED)
    places, whole = with_independent(chosen, grouping, alone)
    return places, whole[:, among.places], min(*gaps, gap)


def _is_confirmed(
    rows: Sequence[SumRows],
    columns: Sequence[int],
    grouping: Array,
    bodies: int,
    rng: np.random.Generator,
) -> bool:
    """Return whether the dependencies of columns hold at instants by which they were not found."""
    # A random combination of rows is in a row space if they all are.
    mixed = np.zeros((_FRESH_INSTANTS, grouping.shape[1]))
    for seen, values in rows:
        mixed[:, seen] += rng.normal(size=(len(mixed), len(values))) @ values
    chosen = mixed[:, list(columns)]
    error = np.abs(mixed - chosen @ grouping)
    size = np.abs(mixed) + np.abs(chosen) @ np.abs(grouping)
    # Columns of bodies that are negligible are zero in the grouping.
    size[:, :bodies] += 1e-3 * np.abs(mixed[:, :bodies]).max(initial=0.0)
    return bool(np.all(error <= _CONFIRMED * size))


_LARGEST, _SAME, _DIGITS = 10_000, 1e-11, 12
"""Largest denominator of a rational in place of a double, its largest relative distance from that,
and the digits of a coefficient that are no rounding."""


def _shown(size: float) -> str:
    return _short_rational(float(f"{size:.{_DIGITS}g}"))


@cache
def _short_rational(size: float) -> str:
    """Return the size of a coefficient as text: a rational, 121/1600, if that is short."""
    near = Fraction(size).limit_denominator(_LARGEST)
    is_same = abs(near - Fraction(size)) <= _SAME * size
    return rational_text(near) if is_same else four_digits(size)


def _can_be_homogeneous(system: System) -> bool:
    """Whether the equations can be homogeneous: a dependent signal has an unknown parameter.

    Every term then has an unknown factor, so that any multiple of the parameters satisfies the
    equations too: they have no scale.
    """
    signals = {plain(name) for name in MOTOR_SIGNALS.values()}
    return any(
        system.terms[i].spring is not None or expression.free_symbols & signals
        for e in system.used
        for i, _, expression in system.equations[e].parts
    )


def _groups(free: _Columns, true: _Columns) -> Groups:
    """Return the groups of `free` combinations coupled by what true motions do not determine."""
    p, pivots = len(free.places), np.searchsorted(free.places, true.places)
    links, dependent = np.zeros((p, p), dtype=bool), np.setdiff1d(np.arange(p), pivots)
    # A column that is no pivot on true motions is coupled to the pivots it depends on.
    links[np.ix_(dependent, pivots)] = true.grouping[:, np.array(free.places)[dependent]].T != 0
    links[dependent, dependent] = True
    coupled = np.any(links, axis=0) | np.any(links, axis=1)
    return tuple(tuple(group) for group in connected_groups(links) if coupled[group[0]])
