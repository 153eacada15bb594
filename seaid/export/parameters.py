"""parameters.json: the results of an identification, from which its robot can be restored."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._files import plain, read_json, write_json
from seaid.drives import IDEAL_DRIVE, drive_table
from seaid.drives.toml import drives_from_mapping
from seaid.errors import RobotError, SeaidError, SeaidWarning, checked, shortened, shown
from seaid.log.tables import Reader
from seaid.robot import PARAMETERS, Robot
from seaid.robot.robot import check_kind
from seaid.robot.transmission import check_transmission

if TYPE_CHECKING:
    from seaid.estimation import Estimate, SharedParameter
    from seaid.identification import FeasibleParameters, Identification, Validation


_READER = Reader(RobotError)
_FORMAT = "seaid parameters 4"
_READ = ("joints", "bodies", "drive_tables", "drives", "load")
"""Keys that are read again."""

_MOST = 1e12
"""Largest parameter of a body [kg, kg m, kg m^2]."""

_FARTHEST_M = 1e9
"""Largest distance of a centre of mass; a larger one has a mass that is only rounding error."""


def content_of(result: Identification, validation: Validation | None = None) -> dict[str, Any]:
    """Return the content of `parameters.json` as plain data, with None for missing parts."""
    from seaid import __version__
    from seaid.identification import verdict_with
    from seaid.legged import whole_body

    robot = result.robot
    bodies = zip(robot.body_names, robot.parameters.reshape(-1, 10), strict=True)
    content = {
        "format": _FORMAT,
        "robot": robot.name,
        "joints": robot.joint_names,
        "drives": {joint: values_of(estimate) for joint, estimate in result.drives.items()},
        "load": [{"expression": name, **value} for name, value in values_of(result.load).items()],
        "base_columns": result.base.columns,
        "grouping": result.base.grouping,
        "validation": {} if validation is None else validation.to_dict(),
        "torques_used": result.model.torque_joints,
        "method": {
            **{"name": result.method, "estimator": result.estimator},
            "not_shared": result.not_shared,
        },
        "shared": [_shared(parameter) for parameter in result.shared],
        "cutoff_hz": result.cutoff_hz,
        "verdict": verdict_with(result, () if validation is None else [validation]),
        "warnings": result.warnings,
        "bodies": {link: dict(zip(PARAMETERS, ten, strict=True)) for link, ten in bodies},
        "whole_body": whole_body(result),
        "drive_tables": {joint: drive_table(drive) for joint, drive in robot.drives.items()},
        "feasible": None if result.feasible is None else _feasible(result.feasible),
        "checks": result.checks,
        "excluded": result.excluded,
        "processing": result.processing,
        "seaid": __version__,
    }
    return {name: plain(value) for name, value in content.items()}


@checked(SeaidError)
def write_parameters(
    result: Identification, path: str | Path, validation: Validation | None = None
) -> None:
    """Write `parameters.json`, whole or not at all; `read_parameters` reads it.

    Parameters
    ----------
    result : Identification
        The identified robot.
    path : path
        The file; an existing one is replaced.
    validation : Validation, optional
        A test on an unseen log, whose errors the file has too.

    Raises
    ------
    SeaidError
        If the file cannot be written.

    Examples
    --------
    >>> result = seaid.identify(robot, log)
    >>> seaid.write_parameters(result, "parameters.json")
    """
    write_json(path, content_of(result, validation))


def _shared(shared: SharedParameter) -> dict[str, Any]:
    """Return a parameter that drives share: its group and joints, and whether these differ."""
    values = dict(zip(shared.joints, shared.values, strict=True))
    name = {"parameter": shared.name.quantity, "group": shared.name.owner}
    return {**name, "alone": values, "difference": shared.difference}


@checked(RobotError)
def read_parameters(path: str | Path, robot: Robot) -> Robot:
    """Read the identified bodies and drives of a `parameters.json`, without rounding.

    Parameters
    ----------
    path : path
        A file that `write_parameters` or `seaid identify` wrote.
    robot : Robot
        The robot that was identified; geometry and payloads are taken from it.

    Returns
    -------
    Robot
        The robot with the inertial parameters and drives of the file.

    Raises
    ------
    RobotError
        For a file of another kind or of another robot, and for invalid content.

    Examples
    --------
    >>> identified = seaid.read_parameters("parameters.json", robot)
    >>> seaid.write_urdf(identified, "identified.urdf")
    """
    path = Path(path)
    content = parameters_content(path)
    try:
        bodies, names = content["bodies"], robot.joint_names
        _check_robot(content["joints"], bodies, robot)
        values = np.array([_body(link, table) for link, table in bodies.items()]).ravel()
        _READER.table(dict.fromkeys(names, Any), content["drive_tables"], "drive_tables", names)
        drives = {
            # The object itself: other modules ask `is IDEAL_DRIVE`.
            joint: IDEAL_DRIVE if drive == IDEAL_DRIVE else drive
            for joint, drive in drives_from_mapping(content["drive_tables"]).items()
        }
        for joint, slides in zip(robot.joint_names, robot.is_prismatic, strict=True):
            check_kind(joint, "prismatic" if slides else "revolute", drives[joint])
        check_transmission(robot.joint_names, drives, ())
    except RobotError as problem:
        raise problem.at(f"'{path}'") from None
    return robot.with_values(values, drives)


def parameters_content(path: Path) -> dict[str, Any]:
    """Read a `parameters.json` as plain data; raise RobotError for a file of another kind."""
    content = read_json(path, "parameters", RobotError)
    file_format = content.get("format") if isinstance(content, dict) else None
    if file_format != _FORMAT:
        raise RobotError(
            f"'{path}' is no file of identified parameters: 'format' is {shown(file_format)}, not "
            f"{_FORMAT!r}; give one written by seaid identify or write_parameters"
        )
    return _READER.table(dict.fromkeys(content, Any), content, f"'{path}'", _READ)


def _check_robot(joints: Any, bodies: Any, robot: Robot) -> None:
    if not isinstance(bodies, Mapping):
        raise RobotError(f"bodies must be a table, found {shown(bodies)}")
    if joints != list(robot.joint_names) or list(bodies) != list(robot.body_names):
        raise RobotError(
            f"it is of another robot than '{robot.name}': its joints are {shown(joints)}, "
            f"here they are {', '.join(robot.joint_names)}; select joints with joints=",
            "joints=",
        )


def _body(link: str, table: Any) -> list[float]:
    """Return the ten parameters of a body; Pinocchio stores no first moments without mass."""
    where = f"bodies.{shortened(link)}"
    values = _READER.table(dict.fromkeys(PARAMETERS, float), table, where, PARAMETERS)
    largest = max(map(abs, values.values()))
    if largest > _MOST:
        raise RobotError(f"{where}: {largest:g} is not a mass, moment or inertia in SI units")
    # Pinocchio's Inertia has the centre of mass, first moments over the mass.
    if largest > _FARTHEST_M * abs(values["m"]):
        raise RobotError(
            f"{where}: its mass, {values['m']:g} kg, is too small for its other parameters; "
            "identify with feasible=True",
            "feasible=True",
        )
    if values["m"] < 0:
        warnings.warn(
            f"{where}: the mass is negative, {values['m']:g} kg: identify with feasible=True",
            SeaidWarning,
            stacklevel=5,
        )
    return [values[name] for name in PARAMETERS]


def values_of(estimate: Estimate) -> dict[str, dict[str, Any]]:
    """Return {name: value with its standard error, 95 % interval and unit}."""
    numbers = (estimate.values, estimate.standard_errors, estimate.interval(), estimate.units)
    keys = ("value", "standard_error", "interval_95", "unit")
    return {
        name: dict(zip(keys, row, strict=True))
        for name, *row in zip(estimate.names, *numbers, strict=True)
    }


def _feasible(feasible: FeasibleParameters) -> dict[str, Any]:
    columns = (feasible.names, feasible.values, feasible.estimate, feasible.distance)
    keys = ("name", "value", "estimate", "distance", "unit")
    return {
        "chi_square": feasible.chi_square,
        "nearest_chi_square": feasible.nearest_chi_square,
        "weight": feasible.weight,
        "freedom": feasible.freedom,
        "combinations": [
            dict(zip(keys, row, strict=True)) for row in zip(*columns, feasible.units, strict=True)
        ],
        "active_bounds": feasible.active_bounds,
        "notes": feasible.notes,
        "warnings": feasible.warnings,
    }
