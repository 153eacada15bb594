"""Several conditions at once: with and without payload, warm and cold, robots of one type.

What the conditions share is estimated from all of them, what is their own from each: one regression
whose own columns stand once a condition. Two payloads, one of them known, tell what one condition
cannot, as the torque constant of a motor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from seaid.arrays import FrozenMapping
from seaid.base import base_parameters
from seaid.drivetrain.catalogue import PARAMETERS
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation.checks import TermTest
from seaid.estimation.estimators import estimator_named
from seaid.identification import Identification, packed
from seaid.robot import Robot
from seaid.sides.condition_sides import BODIES, condition_sides
from seaid.sides.load_model import LoadModel, load_model
from seaid.sides.records import Record, Source, records_of, sources_of
from seaid.sides.sequential import known_torques
from seaid.sides.straightening import straightened_robot
from seaid.sides.untold import with_held_flags

OWN = ("deflection_offset", "deflection_zero")
"""Own by default: encoders are zeroed anew when a robot is switched on."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """What several conditions told together.

    `found` {condition: Identification}, each whole, equal in what is shared; `own` names what is
    not. `differences` {parameter: test} say of each own parameter (of a joint) whether the
    conditions differ in it; shared ones have no entry.
    """

    found: Mapping[str, Identification]
    own: tuple[str, ...]
    differences: Mapping[str, TermTest]

    def summary(self) -> str:
        """Return the own parameters beside each other, and whether the conditions differ."""
        from seaid.report.conditions_text import conditions_table

        return conditions_table(self)


def identify_conditions(
    conditions: Mapping[str, tuple[Robot, Source | Sequence[Source]]],
    *,
    own: Sequence[str] = OWN,
    rows: Sequence[str] | None = None,
    estimator: str = "wls",
    cutoff_hz: float | None = None,
    progress: bool = False,
) -> Conditions:
    """Identify {condition: (robot, logs)} together, the two parts one after the other.

    The robots are one type: the same URDF and drives; their payloads may differ. `own` names the
    parameters that each condition has for itself, of all joints ("viscous_friction") or of one
    ("viscous_friction of knee"), "bodies" the base parameters; all others are shared. Other options
    as in `identify`; equations that bend are taken near values of the first condition. Raises
    IdentificationError for less than two conditions, unknown names and robots that do not have the
    same joints, drives and base parameters.
    """
    robots, records = _records(conditions, cutoff_hz, progress)
    first = robots[next(iter(robots))]
    _check_own(first, own)
    used = _used(robots, records) if rows is None else first.rows(rows)
    given = robots
    robots, records = _straightened(robots, records, used)
    models = {
        name: load_model(robot, base_parameters(robot, rows=used), used)
        for name, robot in robots.items()
    }
    _check_models(models)
    sides = condition_sides(robots, records, models, own, estimator_named(estimator))
    found = {}
    for name, robot in robots.items():
        part = sides.of(name)
        drives = with_held_flags(part.drivetrains, given[name], robot)
        part = replace(part, drivetrains=drives)
        found[name] = packed(robot, models[name], part, records[name])
    return Conditions(FrozenMapping(found), tuple(own), FrozenMapping(sides.differences()))


def _records(
    conditions: Mapping[str, tuple[Robot, Source | Sequence[Source]]],
    cutoff_hz: float | None,
    progress: bool,
) -> tuple[dict[str, Robot], dict[str, list[Record]]]:
    """Return robots and records of all conditions, in one pass band."""
    if len(conditions) < 2:
        raise IdentificationError(
            f"conditions are estimated together from two on, found {len(conditions)}"
        )
    robots = {name: robot for name, (robot, _) in conditions.items()}
    _check_joints(robots)
    sources = {name: sources_of(logs) for name, (_, logs) in conditions.items()}

    def read(cutoff: float | None) -> dict[str, list[Record]]:
        return {
            name: records_of(robots[name], sources[name], cutoff, None, progress)
            for name in conditions
        }

    records = read(cutoff_hz)
    bands = {one.cutoff_hz for found in records.values() for one in found}
    return robots, records if len(bands) == 1 else read(min(bands))


def _straightened(
    robots: Mapping[str, Robot], records: Mapping[str, list[Record]], used: Sequence[str]
) -> tuple[dict[str, Robot], dict[str, list[Record]]]:
    """Return robots near whose values drives that bend are taken: those of the first condition."""
    found, known = dict(robots), {}
    for place, (name, robot) in enumerate(robots.items()):
        straight, known[name] = straightened_robot(found[name], records[name], used)
        if place == 0 and straight is not robot:
            alike = {x: one for x, one in robots.items() if one.drivetrains == robot.drivetrains}
            found |= {x: one.with_drivetrains(straight.drivetrains) for x, one in alike.items()}
    return found, known


def _used(robots: Mapping[str, Robot], records: Mapping[str, list[Record]]) -> tuple[str, ...]:
    """Return the joints whose torque is measured in every condition."""
    known = [known_torques(robots[name], records[name]) for name in robots]
    return tuple(joint for joint in known[0] if all(joint in one for one in known))


def _check_joints(robots: Mapping[str, Robot]) -> None:
    (first, robot), *others = robots.items()
    for name, other in others:
        if other.joint_names != robot.joint_names:
            raise IdentificationError(
                f"condition '{first}' has the joints {', '.join(robot.joint_names)}, '{name}' "
                f"{', '.join(other.joint_names)}: they must be one type of robot"
            )


def _check_own(robot: Robot, own: Sequence[str]) -> None:
    allowed = [BODIES, *PARAMETERS]
    for name in own:
        parameter, _, joint = name.partition(" of ")
        if parameter not in allowed:
            raise IdentificationError("own=: " + unknown_name("parameter", parameter, allowed))
        if joint and joint not in robot.joint_names:
            raise IdentificationError("own=: " + unknown_name("joint", joint, robot.joint_names))


def _check_models(models: Mapping[str, LoadModel]) -> None:
    first, *others = models
    for other in others:
        if models[other].names != models[first].names:
            raise IdentificationError(
                f"conditions '{first}' and '{other}' do not have the same base parameters and "
                "drives: they must be one type of robot, with the same joints; payloads may differ"
            )
