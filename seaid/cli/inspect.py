"""Command inspect: facts about a robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import seaid
from seaid._progress import counted
from seaid.cli.kinds import Names
from seaid.cli.options import JsonOptions, RobotOptions, refuse
from seaid.errors import SeaidError

_CHOICES = (
    ("motor_position", "joint_position", "motor_torque"),
    ("motor_position", "joint_position", "motor_current"),
    ("motor_position", "motor_torque"),
    ("joint_position", "joint_torque"),
)
"""Usual sets of sensors per joint."""


def inspect(
    options: RobotOptions,
    *,
    sensors: Names | None = None,
    stance: tuple[Names, ...] = (),
    exact: bool = False,
    result: JsonOptions,
) -> None:
    """Show a robot: tree, drives, base parameters, and the identifiability by sensors.

    Base parameters are the combinations of masses, first moments and inertias that determine the
    torques; no log determines more. The command lists the links whose inertia in the file is
    physically inconsistent. Of a robot with a floating base it
    shows what the stances determine, alone and together.

    With --exact the exit code is 1 if numeric and exact base parameters differ: then angles in the
    file are rounded, or the robot is badly conditioned.

    Parameters
    ----------
    sensors
        Sensors of every joint, as motor_position,motor_torque, in detail.
    stance
        Contacts of a floating base on the ground together, as FL,HR; air or hanging for none.
        Default: the air, each contact, and all.
    exact
        Compare numeric base parameters with exact ones, computed over the rationals.

    Examples
    --------
    seaid inspect leg.urdf --drives leg.toml
    seaid inspect arm.urdf --joints shoulder,elbow --sensors motor_position,motor_torque
    seaid inspect arm.urdf --exact
    seaid inspect solo12 --base floating --contact FL_FOOT,FR_FOOT,HL_FOOT,HR_FOOT
    """
    from seaid.log.base_log import moving_base

    robot = options.robot()
    tree = seaid.robot.reread_urdf(robot.urdf or options.urdf).locked_at(robot.locked)
    inconsistent = _inconsistent_links(tree)
    facts = {"joints": _joint_facts(robot), "inconsistent_links": inconsistent}
    if not robot.base_is_held:
        refuse("it is for a base that is held: choose stances with --stance", "sensors")
        content, text = _stance_content(robot, moving_base(robot).contact_links, stance)
    else:
        refuse("it is for a floating base: add --base floating", "stance")
        content, text = _sensor_content(robot, sensors)
    text = [*_tree_lines(robot, tree, tree.root), *_link_lines(inconsistent), *text]
    comparison = None
    if exact:
        numeric, rational = seaid.base_parameters(robot), seaid.symbolic.base_parameters(robot)
        comparison = seaid.regressor.cross_check(numeric, rational)
        text.append(f"\n{comparison.summary()}")
        content["exact"] = asdict(comparison)
    result.show("\n".join(text), {**facts, **content}, robot=robot.name)
    if comparison is not None and not comparison.agree:
        raise SeaidError(
            f"numeric and exact base parameters of '{robot.name}' differ: look for rounded angles "
            "in the URDF; the exact ones hold for the file as written"
        )


def _sensor_content(
    robot: seaid.Robot, sensors: Sequence[str] | None
) -> tuple[dict[str, Any], list[str]]:
    """Return base parameters and identifiability by sensors, and both as lines."""
    base = seaid.base_parameters(robot)
    choices: tuple[tuple[str, ...], ...] = _CHOICES if sensors is None else (tuple(sensors),)
    cases = {", ".join(choice): seaid.identifiability(robot, choice) for choice in choices}  # type: ignore[arg-type]
    content = {
        "base_parameters": list(base.expressions),
        "singular_value_gap": base.gap,
        "sensors": {name: _identifiable(case) for name, case in cases.items()},
    }
    details = map(str, cases.values()) if sensors is not None else [_identifiability_table(cases)]
    text = [*_base_lines(base), *details]
    commands = next(iter(cases.values())).commands
    if commands:
        content["commands"] = list(commands)
        text += ["\nPosition commands:", *(f"  {x}" for x in commands)] if sensors is None else []
    return content, text


_AGREES = {True: "agrees", False: "does NOT agree"}


def _stance_content(
    robot: seaid.Robot, links: Sequence[str], asked_stances: Sequence[list[str]]
) -> tuple[dict[str, Any], list[str]]:
    """Return what stances of a floating base determine, alone and together, and as lines."""
    usual = [["air"], *([link] for link in links), links] if links else [["air"]]
    stances = _stances(asked_stances or usual)
    asked = list(stances.values())[0 if asked_stances else -1 :]
    cases = {text: seaid.identifiability(robot, stances=[x]) for text, x in stances.items()}
    together = seaid.identifiability(robot, stances=asked)
    if len(asked) > 1:
        cases["together"] = together
    rows = []
    for name, case in cases.items():
        parts = (case.base.columns, case.identifiable, case.combinations, case.unidentifiable)
        rows.append((name, *map(len, parts), _AGREES[case.agree]))
    content = {"stances": {name: _identifiable(case) for name, case in cases.items()}}
    content["base_parameters"] = list(together.base.expressions)  # type: ignore[assignment]
    return content, [*_base_lines(together.base), seaid.report.named_table("stances", rows)]


def _stances(asked: Sequence[Sequence[str]]) -> dict[str, Sequence[str]]:
    """Return {text: contacts on the ground, or the word for a robot that hangs} of stances."""
    by_word: dict[str, Sequence[str]] = {seaid.robot.HANGING: seaid.robot.HANGING, "air": []}
    texts = [",".join(links) for links in asked]
    return {text: by_word.get(text, text.split(",")) for text in texts}


def _joint_facts(robot: seaid.Robot) -> list[dict[str, Any]]:
    return [
        {
            "joint": joint,
            "link": robot.body_names[index],
            "type": "prismatic" if robot.is_prismatic[index] else "revolute",
            "lower": robot.lower_limits[index],
            "upper": robot.upper_limits[index],
            "drive": seaid.drives.drive_table(robot.drives[joint]),
        }
        for index, joint in enumerate(robot.joint_names)
    ]


def _tree_lines(robot: seaid.Robot, tree: seaid.robot.UrdfTree, root: str) -> Iterator[str]:
    """Yield the links depth first, each with its joint and drive."""
    joints, springs = counted(robot.n, "moving joint"), len(robot.elastic_joints)
    yield f"{robot.name}: {joints}, {springs} of them with a spring"
    yield root
    waiting = [(joint, 1) for joint in reversed(tree.children(root))]
    while waiting:
        joint, depth = waiting.pop()
        yield f"{'  ' * depth}{joint.child}  <- {joint.name}: {_motion(robot, joint.name)}"
        waiting += [(below, depth + 1) for below in reversed(tree.children(joint.child))]


def _motion(robot: seaid.Robot, joint: str) -> str:
    for mimic in robot.dependent_joints:
        if mimic.name == joint:
            return f"mimics {mimic.leader}, times {mimic.multiplier:.6g} plus {mimic.offset:.6g}"
    if joint not in robot.joint_names:
        return "does not move"

    index = robot.index(joint)
    unit = "m" if robot.is_prismatic[index] else "rad"
    limits = f"{robot.lower_limits[index]:.4g} to {robot.upper_limits[index]:.4g} {unit}"
    drive = robot.drives[joint]
    if drive == seaid.drives.IDEAL_DRIVE:
        return f"{limits}, torque known at the joint"
    kind, *facts = (
        f"{name} {' + '.join(value) if isinstance(value, list) else value}"
        for name, value in seaid.drives.drive_table(drive).items()
    )
    return f"{limits}, {kind.removeprefix('type ')}; {', '.join(facts)}"


def _inconsistent_links(tree: seaid.robot.UrdfTree) -> dict[str, str]:
    """Return {link: reason why its inertia is physically inconsistent}."""
    reasons = {link: seaid.robot.inconsistency(body) for link, body in tree.links.items()}
    return {link: reason for link, reason in reasons.items() if reason is not None}


def _link_lines(inconsistent: dict[str, str]) -> Iterator[str]:
    if inconsistent:
        yield "\nPhysically inconsistent links (simulations with them may fail):"
        yield from (f"  {link} has {reason}" for link, reason in inconsistent.items())


def _base_lines(base: seaid.regressor.BaseParameters) -> Iterator[str]:
    yield f"\n{len(base.expressions)} base parameters (singular-value gap {base.gap:.2g}):"
    yield from (f"  {expression}" for expression in base.expressions)


def _identifiable(case: seaid.regressor.Identifiability) -> dict[str, Any]:
    kept = ("rank", "identifiable", "combinations", "ratios", "unidentifiable", "agree")
    by_derivatives = None if case.derivatives is None else case.derivatives.expressions
    facts = {name: getattr(case, name) for name in kept}
    return {"base_parameters": case.body_count, **facts, "by_derivatives": by_derivatives}


def _identifiability_table(cases: dict[str, seaid.regressor.Identifiability]) -> str:
    """Return the numbers of parameters by identifiability for each set of sensors."""
    rows = list[tuple[object, ...]]()
    for name, case in cases.items():
        ratios = " + ".join(str(len(group)) for group in case.ratios) or "-"
        counts = (case.body_count, len(case.identifiable), len(case.combinations), ratios)
        rows.append((name, *counts, len(case.unidentifiable)))
        if (base := case.derivatives) is not None:
            bodies = sum(not seaid.drives.ParameterName.of(x).owner for x in base.names)
            pairs = zip(base.expressions, base.names, strict=True)
            alone = sum(expression == name for expression, name in pairs)
            lost = int((~base.grouping.any(axis=0)).sum())
            counts = (bodies, alone, len(base.columns) - alone, "-")
            rows.append(("  with their derivatives", *counts, lost))
    return seaid.report.named_table("identifiability", rows)
