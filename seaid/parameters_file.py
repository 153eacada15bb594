"""parameters.json: what an identification found, and the robot it found, to be taken up again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid.arrays import finite
from seaid.drivetrain.drive_file import drives_from_mapping
from seaid.drivetrain.model import IDEAL_DRIVE
from seaid.errors import RobotError
from seaid.export.drive_tables import drive_table
from seaid.files import plain
from seaid.inertia import PARAMETERS
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.bodies.possible_bodies import PossibleBodies
    from seaid.estimation.estimate import Estimate
    from seaid.estimation.model_checks import ModelChecks
    from seaid.identification import Identification
    from seaid.validation import Validation


def content_of(found: Identification, validation: Validation | None = None) -> dict[str, Any]:
    """Return the content of `parameters.json`: plain data, null for what is not there."""
    from seaid import __version__

    robot = found.robot
    drives = {joint: drive for joint, drive in robot.drivetrains.items() if drive != IDEAL_DRIVE}
    bodies = zip(robot.body_names, robot.parameters.reshape(-1, 10), strict=True)
    content = {
        "robot": robot.name,
        "joints": robot.joint_names,
        "drivetrains": {joint: _values(one) for joint, one in found.drivetrains.items()},
        "load": [{"expression": name, **value} for name, value in _values(found.load).items()],
        "base_columns": found.base.columns,
        "grouping": found.base.grouping,
        "validation": {} if validation is None else validation.to_dict(),
        "torques_used": found.model.rows,
        "cutoff_hz": found.cutoff_hz,
        "flags": found.flags,
        "bodies": {link: dict(zip(PARAMETERS, ten, strict=True)) for link, ten in bodies},
        "drives": {joint: drive_table(drive) for joint, drive in drives.items()},
        "possible": None if found.possible is None else _possible(found.possible),
        "checks": {side: _checks(one) for side, one in found.checks.items()},
        "left_out": found.left_out,
        "processing": [asdict(one) for one in found.processing],
        "seaid": __version__,
    }
    return {name: plain(value) for name, value in content.items()}


def read_parameters(path: str | Path, robot: Robot) -> Robot:
    """Return a robot with the bodies and drives that stand in a `parameters.json`, exactly.

    `robot` is the one identified: its geometry and payloads are kept, its own bodies and drives do
    not matter. Raises RobotError for a file that is none, and for another robot's.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        joints, bodies, drives = (content[key] for key in ("joints", "bodies", "drives"))
        tens = [[bodies[link][name] for name in PARAMETERS] for link in bodies]
    except OSError as problem:
        raise RobotError(f"cannot read parameters '{path}': {problem.strerror}") from None
    except (ValueError, KeyError, TypeError) as problem:
        what = f"key {problem}" if isinstance(problem, KeyError) else str(problem)
        raise RobotError(
            f"'{path}' is no file of identified parameters ({what}): give one that seaid identify "
            "or save has written"
        ) from None
    if list(joints) != list(robot.joint_names) or list(bodies) != list(robot.body_names):
        raise RobotError(
            f"'{path}' is of another robot than '{robot.name}': its joints are "
            f"{', '.join(joints)}, here they are {', '.join(robot.joint_names)}; joints= chooses"
        )
    values = finite(f"'{path}': bodies", np.array(tens, float).ravel(), (None,), RobotError)
    ideal = dict.fromkeys(robot.joint_names, IDEAL_DRIVE)
    return robot.with_values(values, {**ideal, **drives_from_mapping(drives)})


def _values(estimate: Estimate) -> dict[str, dict[str, Any]]:
    """Return {name: value with its standard error and unit}."""
    columns = (estimate.names, estimate.values, estimate.standard_errors, estimate.units)
    return {
        name: {"value": value, "standard_error": error, "unit": unit}
        for name, value, error, unit in zip(*columns, strict=True)
    }


def _possible(possible: PossibleBodies) -> dict[str, Any]:
    columns = (possible.names, possible.values, possible.estimate, possible.distance)
    keys = ("name", "value", "estimate", "distance", "unit")
    return {
        "chi_square": possible.chi_square,
        "nearest_chi_square": possible.nearest_chi_square,
        "weight": possible.weight,
        "freedom": possible.freedom,
        "combinations": [
            dict(zip(keys, one, strict=True)) for one in zip(*columns, possible.units, strict=True)
        ],
        "held": possible.held,
        "notes": possible.notes,
        "flags": possible.flags,
    }


def _checks(checks: ModelChecks) -> Mapping[str, Any]:
    return {
        "condition_number": checks.condition_number,
        "poorly_told": checks.poorly_told,
        "terms": [asdict(one) for one in checks.terms],
        "whiteness": {joint: asdict(one) for joint, one in checks.whiteness.items()},
    }
