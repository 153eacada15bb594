"""Structural identifiability: the parameters that a robot's sensors determine, before any log.

A combination of parameters is identifiable if it is in the row space of the derivatives of the
usable equations (`equations`) by all parameters, over all motions. This is decided modulo a prime
(`arithmetic`, `rank`), without rounding, and confirmed in doubles.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, compress
from typing import Literal, get_args

import numpy as np

from seaid._arrays import FrozenMapping, seed_of
from seaid._progress import Result, counted
from seaid.drives import JointParameter
from seaid.errors import RobotError, checked, unknown_name
from seaid.regressor.base import BaseParameters
from seaid.robot import Robot

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
        Whether doubles give the same combinations and rank as exact arithmetic.
    derivatives : BaseParameters or None
        What the sensors determine locally with their derivatives in time, if motor angle and motor
        torque are all that an elastic joint has; `identify` then estimates it by simulation. The
        rank is numeric. None where there is no such joint, or other terms and sensors.
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
        The same robot with other payloads, of which there are logs too.
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
    from seaid.regressor.structural.derivatives import base_by_derivatives
    from seaid.regressor.structural.equations import explanations, system_of
    from seaid.regressor.structural.rank import decide

    seed = seed_of(seed)
    sensed = _sensed(robot, sensors)
    _check_conditions(robot, conditions)
    exact = ResidueNumbers(robot, np.random.default_rng(seed))
    system = system_of(robot, sensed, exact.depends())
    names = system.names
    payloads = [one.known_parameters for one in (robot, *conditions)]
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
        given = {joint: sensors.get(joint, ()) for joint in robot.joint_names}
    else:
        given = dict.fromkeys(robot.joint_names, tuple(sensors))
    return {joint: _checked(joint, names) for joint, names in given.items()}


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
    """Refuse conditions that differ from the robot in more than payloads."""
    own = robot.model
    for other in conditions:
        same = other.joint_names == robot.joint_names and all(
            one.isApprox(two)
            for one, two in zip(own.jointPlacements, other.model.jointPlacements, strict=True)
        )
        same = same and other.known_bodies == robot.known_bodies
        if not same or dict(other.drives) != dict(robot.drives):
            raise RobotError(
                f"conditions= takes the same robot with other payloads; '{other.name}' has other "
                f"joints, drives or known bodies than '{robot.name}'"
            )
