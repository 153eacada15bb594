"""Drives as TOML or as a mapping, one table per joint: reading and writing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from seaid._files import read_toml, write_whole
from seaid.drives.angle_ratio import AngleRatio
from seaid.drives.controller import Controller
from seaid.drives.drives import (
    CONSTANTS,
    IDEAL_DRIVE,
    STD_OF_TORQUE,
    Drive,
    SeriesElasticDrive,
    StiffDrive,
    check_groups,
    term_fields,
    unit_of,
)
from seaid.drives.terms import FIELDS, PARAMETERS_OF, harmonics_table, key_of
from seaid.errors import RobotError, check_name, checked, listed, shortened, shown

_TYPES: dict[str, type[StiffDrive] | type[SeriesElasticDrive]] = {
    "stiff": StiffDrive,
    "series_elastic": SeriesElasticDrive,
}
_RATIOS = {"gear_ratio", "gear_ratio_rad_per_m"}
_OF_SPRING = ("spring_offset", "deflection_zero")


def read_drives(path: str | Path) -> dict[str, Drive]:
    """Read a drive TOML as {joint: drive}. Raises RobotError naming joint and key."""
    if Path(path).suffix in (".urdf", ".xacro", ".xml"):
        raise RobotError(
            f"drives '{path}' is XML, as a URDF is: the drives are a TOML file with a table for "
            "each joint, and the URDF is the first argument"
        )
    tables = read_toml(path, "drives", RobotError)
    drives = {
        joint: _drive(f"{path}: [{shortened(joint)}]", table) for joint, table in tables.items()
    }
    check_groups(drives, str(path))
    return drives


def drives_from_mapping(drives: Mapping[str, Any]) -> dict[str, Drive]:
    """Return {joint: drive} from a mapping whose values are drives or tables as in the TOML."""
    return {
        joint: value
        if isinstance(value, Drive)
        else _drive(f"drive of '{shortened(joint)}'", value)
        for joint, value in drives.items()
    }


def _drive(where: str, table: Any) -> Drive:
    if not isinstance(table, Mapping):
        raise RobotError(f"{where} must be a table of a drive, found {shown(table)}")
    try:
        others = {key: value for key, value in table.items() if key != "type"}
        return _drive_of_table(_kind_of(table), others)
    except RobotError as problem:
        raise problem.at(where) from None


def _kind_of(table: Mapping[str, Any]) -> type[Drive]:
    inner = next((name for name, value in table.items() if isinstance(value, Mapping)), None)
    if "type" not in table and inner is not None and "type" in table[inner]:
        raise RobotError(f"the tables of joints stand at the top: write [{inner}] for [...{inner}]")
    if "type" not in table:
        raise RobotError(f"key 'type' is missing; allowed: {', '.join(_TYPES)}")
    check_name("drive type", table["type"], _TYPES, RobotError)
    return _TYPES[table["type"]]


def _drive_of_table(kind: type[Drive], others: dict[str, Any]) -> Drive:
    """Return the drive of a table: fields of the kind by name, parameters by names with units."""
    keys = [field.name for field in fields(kind)]
    values = _pop_fields(keys, others)
    if all(values.get(key) in (None, "?") for key in _RATIOS):
        raise RobotError(
            "key 'gear_ratio' is missing or '?'; give the motor turns per turn behind the gear "
            f"(other keys: {listed(others) or 'none'})"
        )
    # The units, and with them the keys, depend on ratio and radii: first a drive of these alone.
    bare = kind(**{**values, "known": ()})
    names = {*_possible_parameters(kind), *bare.parameter_names}
    named = {key_of(name, unit_of(bare, name)): name for name in sorted(names)}
    for key in others:
        check_name("key", key, ["type", *keys, *named], RobotError)
    more = {named[key]: value for key, value in others.items()}
    for name in more:
        if name in bare.nominal:
            raise RobotError(f"found two values of '{name}': one in nominal, one by its key")
    return replace(bare, known=values.get("known", ()), nominal={**bare.nominal, **more})


def _pop_fields(keys: list[str], table: dict[str, Any]) -> dict[str, Any]:
    """Remove the fields of a drive from a table, and return them."""
    stds = {f"{name}_std": name for name in (STD_OF_TORQUE, *CONSTANTS)}
    std = {name: table.pop(key) for key, name in stds.items() if key in table}
    if std:
        table["std"] = {**table.get("std", {}), **std}
    return {key: table.pop(key) for key in keys if key in table}


def _possible_parameters(kind: type[Drive]) -> set[str]:
    """Return the parameters that a kind of drive can have with its terms."""
    terms = [names for field in term_fields(kind) for names in PARAMETERS_OF[field].values()]
    return {*sum(terms, ()), *(_OF_SPRING if kind.is_elastic else ())}


@checked(RobotError)
def write_drives(drives: Mapping[str, Drive], path: str | Path) -> None:
    """Write drives as a TOML file that `load_robot` reads, one table per joint.

    Parameters
    ----------
    drives : mapping {joint: drive}
        Ideal drives are skipped: a joint without a table has one.
    path : str or Path
        The file; it is replaced only once the new one is complete.

    Raises
    ------
    SeaidError
        If the file cannot be written.

    Examples
    --------
    >>> seaid.write_drives(result.robot.drives, "leg_drives.toml")
    """
    import tomli_w

    tables = {joint: drive_table(drive) for joint, drive in drives.items() if drive != IDEAL_DRIVE}
    write_whole(path, tomli_w.dumps(tables))


def drive_table(drive: Drive) -> dict[str, Any]:
    """Return the TOML table of a drive: the fields that differ from their defaults, and values."""
    kind = next(name for name, drive_type in _TYPES.items() if isinstance(drive, drive_type))
    kept = _changed_fields(drive)
    nominal, transmission = kept.pop("nominal", {}), kept.pop("transmission", None)
    stds = {f"{name}_std": value for name, value in kept.pop("std", {}).items()}
    table = {"type": kind, **kept, **stds}
    if _RATIOS.isdisjoint(table):
        table["gear_ratio"] = 1.0  # the default, which a table must state
    table |= {key_of(name, unit_of(drive, name)): value for name, value in nominal.items()}
    return table if transmission is None else table | {"transmission": transmission}


def _changed_fields(drive: Drive) -> dict[str, Any]:
    """Return the fields that differ from their defaults, as TOML types."""
    ordered = sorted(fields(drive), key=lambda field: bool(field.kw_only))  # ratios and sizes first
    pairs = ((field, getattr(drive, field.name)) for field in ordered)
    return {
        field.name: harmonics_table(value) if field.name in FIELDS else _plain(value)
        for field, value in pairs
        if value not in (None, field.default) or type(value) is not type(field.default or value)
    }


def _plain(value: Any) -> Any:
    """Return a field as a TOML type."""
    if isinstance(value, Controller | AngleRatio):
        pairs = ((field, getattr(value, field.name)) for field in fields(value))
        return {field.name: _plain(x) for field, x in pairs if x != field.default}
    if isinstance(value, Mapping):
        return {name: float(number) for name, number in value.items()}
    if isinstance(value, tuple):
        return list(value)
    return value if isinstance(value, str | bool) else float(value)
