"""Which sensors tell what: the parameters that a robot's sensors can tell, before any log.

The equations are those of `seaid.symbolic.sensing`. A combination of parameters can be found if it
is in the row space of the equations' slopes by all parameters, over all motions. That is decided
modulo a prime (`seaid.symbolic.residues`), without rounding, and confirmed in doubles.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seaid._arrays import FrozenMapping, seed_of
from seaid.drives import SeriesElasticDrive
from seaid.errors import RobotError, unknown_name
from seaid.regressor.base import BaseParameters
from seaid.robot import Robot

SENSORS = (
    "motor_position",
    "joint_position",
    "deflection",
    "motor_torque",
    "motor_current",
    "motor_voltage",
    "joint_torque",
)
"""What a joint may have: encoders of motor and joint, one across the spring; torques."""


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What sensors tell of a robot's parameters, those of the drives and ten a body.

    `identifiable` are found alone; `combinations` only together, as expressions of names;
    `ratios` are groups of parameters and combinations known only up to one common factor each (as
    inertias over a stiffness that no torque scales); `unidentifiable` are in no equation left.
    `base` are all of these combinations over `names` (m,), groups among them; `rank` is how many
    numbers a log can tell: a group has one less than members. `usable` {joint: sentences} says
    which equations of a joint are used and why others cannot be.

    `gap` is that of the numeric rank decision, `agree` whether doubles find the same combinations
    and the same rank as exact arithmetic does.
    """

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

    @property
    def body_count(self) -> int:
        """Number of combinations that begin with a parameter of a body: the base parameters."""
        return sum(" of " not in name for name in self.base.names)

    def table(self) -> str:
        """Return all of it as text."""
        from seaid.report import sensors_table

        return sensors_table(self)

    def __str__(self) -> str:
        return self.table()


def identifiability(
    robot: Robot,
    sensors: Iterable[str] | Mapping[str, Iterable[str]] | None = None,
    *,
    conditions: Sequence[Robot] = (),
    seed: int = 0,
) -> Identifiability:
    """Tell which parameters of a robot its sensors can tell, in a log of a motion that moves all.

    `sensors`: names of `SENSORS` for every joint, or {joint: names}, a joint left out having none;
    None: positions of both sides of a spring, of the joint where there is none, and what the motor
    is logged by. A deflection gives the position on one side of a spring from the other.
    `conditions` are the same robot with other payloads, of which there are logs too. Numbers of the
    robot are not used, but for geometry, ratios and what is known.

    Equations that are not linear count near random values of their parameters, so locally. What a
    sensor's absence leaves to be found by integrating the model is not counted. Raises RobotError
    for names that are not there and for conditions of another robot.
    """
    from seaid.regressor.structural.arithmetic import RealNumbers, ResidueNumbers
    from seaid.regressor.structural.equations import system_of, words_of
    from seaid.regressor.structural.rank import decided

    seed = seed_of(seed)
    sensed = _sensed(robot, sensors)
    _check_conditions(robot, conditions)
    exact = ResidueNumbers(robot, np.random.default_rng(seed))
    system = system_of(robot, sensed, exact.depends())
    names = system.names
    payloads = [one.known_parameters for one in (robot, *conditions)]
    numeric = RealNumbers(robot, np.random.default_rng(seed))
    base, groups, rank, agree = decided(system, payloads, exact, numeric)
    known = set(np.flatnonzero(robot.is_known).tolist())
    held = {member for group in groups for member in group}
    alone = [len(np.flatnonzero(row)) == 1 for row in base.grouping]
    free = [place for place in range(len(base.names)) if place not in held]
    usable = words_of(system, [base.names[place] for place in sorted(held)])
    return Identifiability(
        robot_name=robot.name,
        names=names,
        identifiable=tuple(base.names[place] for place in free if alone[place]),
        combinations=tuple(base.expressions[place] for place in free if not alone[place]),
        ratios=tuple(tuple(base.expressions[place] for place in group) for group in groups),
        unidentifiable=tuple(
            name
            for place, name in enumerate(names)
            if place not in known and not np.any(base.grouping[:, place])
        ),
        base=base,
        rank=rank,
        usable=FrozenMapping(usable),
        sensors=FrozenMapping(
            {joint: tuple(x for x in SENSORS if x in sensed[joint]) for joint in robot.joint_names}
        ),
        gap=base.gap,
        agree=agree,
    )


def _sensed(
    robot: Robot, sensors: Iterable[str] | Mapping[str, Iterable[str]] | None
) -> dict[str, frozenset[str]]:
    """Return {joint: sensors} of all joints, checked."""
    if sensors is None:
        return {joint: frozenset(_full_set(robot, joint)) for joint in robot.joint_names}
    if isinstance(sensors, Mapping):
        for joint in sensors:
            robot.index(joint)
        given = {joint: sensors.get(joint, ()) for joint in robot.joint_names}
    else:
        every = sensors if isinstance(sensors, str) else tuple(sensors)
        given = dict.fromkeys(robot.joint_names, every)
    return {joint: _checked(joint, names) for joint, names in given.items()}


def _full_set(robot: Robot, joint: str) -> tuple[str, ...]:
    drive = robot.drives[joint]
    elastic = isinstance(drive, SeriesElasticDrive)
    positions = ("motor_position", "joint_position") if elastic else ("joint_position",)
    return (*positions, f"motor_{drive.motor_input}")


def _checked(joint: str, names: Iterable[str]) -> frozenset[str]:
    if isinstance(names, str):
        raise RobotError(
            f"sensors of '{joint}' must be a list of names, found the text '{names}': "
            f"write ['{names}']"
        )
    chosen = frozenset(names)
    for name in sorted(map(str, chosen)):
        if name not in SENSORS:
            raise RobotError(f"sensors of '{joint}': " + unknown_name("sensor", name, SENSORS))
    return chosen


def _check_conditions(robot: Robot, conditions: Sequence[Robot]) -> None:
    """Refuse conditions that are not the same robot but for its payloads."""
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
