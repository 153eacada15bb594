"""Drives as TOML or as a mapping, one table per joint: reading and writing."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
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
from seaid.drives.terms import FIELDS, PARAMETERS, PARAMETERS_OF, harmonics_table, key_of
from seaid.errors import RobotError, checked, shortened, shown, unknown_name

_TYPES: dict[str, type[StiffDrive] | type[SeriesElasticDrive]] = {
    "stiff": StiffDrive,
    "series_elastic": SeriesElasticDrive,
}
_RATIOS = {"gear_ratio", "gear_ratio_rad_per_m"}
_STIFFNESS = {"stiffness_N_per_m", "stiffness_Nm_per_rad"}
_OF_SPRING = ("spring_offset", "deflection_zero")


def read_drives(path: str | Path) -> dict[str, Drive]:
    """Read a drive TOML as {joint: drive}. Raises RobotError naming joint and key."""
    if os.path.isfile(path):
        with suppress(OSError), open(path, "rb") as file:
            if file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
                raise RobotError(
                    f"drives '{path}' is XML, as a URDF is: the drives are a TOML file with a "
                    "table for each joint, and the URDF is the first argument"
                )
    tables = read_toml(path, "drives", RobotError)
    drives = {
        joint: _drive(f"{path}: [{shortened(joint)}]", table) for joint, table in tables.items()
    }
    check_groups(drives, str(path))
    return drives


_OLD_KEYS = {"deflection_offset_N": "spring_offset_N", "deflection_offset_Nm": "spring_offset_Nm"}
"""Keys of files that are older than the parameter's name."""


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
        return _drive_of_table(_kind_of(table), _with_new_keys(table))
    except RobotError as problem:
        raise problem.at(where) from None


def _kind_of(table: Mapping[str, Any]) -> type[Drive]:
    inner = next((name for name, value in table.items() if isinstance(value, Mapping)), None)
    if "type" not in table and inner is not None and "type" in table[inner]:
        raise RobotError(f"the tables of joints stand at the top: write [{inner}] for [...{inner}]")
    if "type" not in table:
        raise RobotError(f"key 'type' is missing; allowed: {', '.join(_TYPES)}")
    if not isinstance(table["type"], str) or table["type"] not in _TYPES:
        raise RobotError(unknown_name("drive type", table["type"], _TYPES))
    return _TYPES[table["type"]]


def _with_new_keys(table: Mapping[str, Any]) -> dict[str, Any]:
    for old, new in _OLD_KEYS.items():
        if old in table and new in table:
            raise RobotError(f"'{old}' is the old name of '{new}': give one of them")
    return {_OLD_KEYS.get(key, key): value for key, value in table.items() if key != "type"}


def _drive_of_table(kind: type[Drive], others: dict[str, Any]) -> Drive:
    """Return the drive of a table: fields of the kind by name, parameters by names with units."""
    keys = [field.name for field in fields(kind)]
    values = _pop_fields(keys, others)
    if all(values.get(key) in (None, "?") for key in _RATIOS):
        _check_keys(others, keys, _every_key())
        raise RobotError(
            "key 'gear_ratio' is missing or '?'; give the motor turns per turn behind the gear"
        )
    # The units, and with them the keys, depend on ratio and radii: first a drive of these alone.
    bare = kind(**{**values, "known": ()})
    named = {key_of(name, unit_of(bare, name)): name for name in _possible_parameters(kind)}
    in_other_units = _STIFFNESS - named.keys()
    _check_keys(others, [key for key in keys if key not in in_other_units], named)
    more = {named[key]: value for key, value in others.items()}
    for name in more:
        if name in bare.nominal:
            raise RobotError(f"found two values of '{name}': one in nominal, one by its key")
    return replace(bare, known=values.get("known", ()), nominal={**bare.nominal, **more})


def _pop_fields(keys: list[str], table: dict[str, Any]) -> dict[str, Any]:
    """Remove the fields of a drive from a table, and return them."""
    for key in _RATIOS.intersection(table):
        _check_ratio(key, table[key])
    stds = {f"{name}_std": name for name in (STD_OF_TORQUE, *CONSTANTS)}
    std = {name: table.pop(key) for key, name in stds.items() if key in table}
    if std:
        table["std"] = {**table.get("std", {}), **std}
    return {key: table.pop(key) for key in keys if key in table}


def _check_ratio(key: str, value: Any) -> None:
    """Raise RobotError for a ratio as text, such as "100:1", with the number to write."""
    if isinstance(value, str):
        ratio = re.fullmatch(r"\s*([\d.]+)\s*[:/]\s*([\d.]+)\s*", value)
        with suppress(ValueError, ZeroDivisionError):
            remedy = float(ratio[1]) / float(ratio[2]) if ratio else float(value)
            raise RobotError(
                f"{key} must be a number without quotes, found {shown(value)}: write "
                f"{key} = {remedy!r}"
            )


def _check_keys(written: Iterable[str], keys: list[str], named: Mapping[str, str]) -> None:
    for key in written:
        if key not in named:
            raise RobotError(unknown_name("key", key, dict.fromkeys(["type", *keys, *named])))


def _possible_parameters(kind: type[Drive]) -> list[str]:
    """Return the parameters that a kind of drive can have with its terms."""
    terms = [names for field in term_fields(kind) for names in PARAMETERS_OF[field].values()]
    possible = {*sum(terms, ()), *(_OF_SPRING if kind.is_elastic else ())}
    return [name for name in PARAMETERS if name in possible]


def _every_key() -> dict[str, str]:
    """Return {key: parameter} in all units, for a table whose units are not known yet."""
    units = (("N", "m"), ("N m", "rad"))
    return {
        key_of(name, parameter.unit_for(pair, pair)): name
        for name, parameter in PARAMETERS.items()
        for pair in units
    }


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
