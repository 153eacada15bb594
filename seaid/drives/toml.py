"""Drives as TOML or as a mapping, one table per joint: reading and writing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any

from seaid._files import read_toml, write_whole
from seaid.drives.drives import IDEAL_DRIVE, Drive, SeriesElasticDrive, StiffDrive, unit_of
from seaid.drives.terms import PARAMETERS, PARAMETERS_OF, key_of
from seaid.errors import RobotError, checked, shortened, shown, unknown_name

_TYPES: dict[str, type[StiffDrive] | type[SeriesElasticDrive]] = {
    "stiff": StiffDrive,
    "series_elastic": SeriesElasticDrive,
}
_OF_SPRING = ("spring_offset", "deflection_zero")


def read_drives(path: str | Path) -> dict[str, Drive]:
    """Read a drive TOML as {joint: drive}. Raises RobotError naming joint and key."""
    tables = read_toml(path, "drives", RobotError)
    return {
        joint: _drive(f"{path}: [{shortened(joint)}]", table) for joint, table in tables.items()
    }


_OLD_KEYS = {"deflection_offset_N": "spring_offset_N", "deflection_offset_Nm": "spring_offset_Nm"}
"""Keys of files that are older than the parameter's name."""


def drives_from_mapping(drives: Mapping[str, Any]) -> dict[str, Drive]:
    """Return {joint: drive} from a mapping whose values are drives or tables as in the TOML."""
    return {
        joint: value
        if isinstance(value, StiffDrive | SeriesElasticDrive)
        else _drive(f"drive of '{shortened(joint)}'", value)
        for joint, value in drives.items()
    }


def _drive(where: str, table: Any) -> Drive:
    if not isinstance(table, Mapping):
        raise RobotError(f"{where} must be a table of a drive, found {shown(table)}")
    if "type" not in table:
        raise RobotError(f"{where}: key 'type' is missing; allowed: {', '.join(_TYPES)}")
    if not isinstance(table["type"], str) or table["type"] not in _TYPES:
        raise RobotError(f"{where}: " + unknown_name("drive type", table["type"], _TYPES))
    kind = _TYPES[table["type"]]
    keys = [field.name for field in fields(kind)]
    values = {key: value for key, value in table.items() if key in keys}
    for old, new in _OLD_KEYS.items():
        if old in table and new in table:
            raise RobotError(f"{where}: '{old}' is the old name of '{new}': give one of them")
    others: dict[str, Any] = {
        _OLD_KEYS.get(str(key), str(key)): value
        for key, value in table.items()
        if key not in keys and key != "type"
    }
    needed = ("gear_ratio", "gear_ratio_rad_per_m") if kind is StiffDrive else ("gear_ratio",)
    if all(values.get(key) is None for key in needed):
        _check_keys(where, others, keys, _every_key())
        raise RobotError(
            f"{where}: key '{needed[0]}' is missing; give the motor turns per turn behind the gear"
        )
    try:
        bare = kind(**{key: value for key, value in values.items() if key != "known"})
        named = {key_of(name, unit_of(bare, name)): name for name in _possible(kind)}
        _check_keys(where, others, keys, named)
        more = {named[key]: value for key, value in others.items()}
        twice = [name for name in more if name in bare.nominal]
        if twice:
            raise RobotError(f"found two values of '{twice[0]}': one in nominal, one by its key")
        return replace(bare, known=values.get("known", ()), nominal={**bare.nominal, **more})
    except RobotError as problem:
        text = str(problem)
        raise RobotError(text if text.startswith(where) else f"{where}: {text}") from None


def _check_keys(
    where: str, found: Mapping[str, Any], keys: list[str], named: Mapping[str, str]
) -> None:
    for key in found:
        if key not in named:
            allowed = dict.fromkeys(["type", *keys, *named])
            raise RobotError(f"{where}: " + unknown_name("key", key, list(allowed)))


def _possible(kind: type[Drive]) -> list[str]:
    """Return the parameters that a kind of drive can have with its terms."""
    has_spring = kind is SeriesElasticDrive
    fields_of = [field for field in PARAMETERS_OF if hasattr(kind, field)]
    names = {name for field in fields_of for term in PARAMETERS_OF[field].values() for name in term}
    return [name for name in PARAMETERS if name in names or (has_spring and name in _OF_SPRING)]


def _every_key() -> dict[str, str]:
    """Return {key: parameter} in all units, for a table whose units are not known yet."""
    units = (("N", "m"), ("N m", "rad"))
    return {
        key_of(name, parameter.unit_for(one, one)): name
        for name, parameter in PARAMETERS.items()
        for one in units
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
    kind = "series_elastic" if isinstance(drive, SeriesElasticDrive) else "stiff"
    table: dict[str, Any] = {"type": kind}
    for field in fields(drive):
        value = getattr(drive, field.name)
        default = None if field.default is MISSING else field.default
        if value is None or value == default or field.name == "nominal":
            continue
        table[field.name] = _plain(value)
    if isinstance(drive, StiffDrive) and not {"gear_ratio", "gear_ratio_rad_per_m"} & set(table):
        table["gear_ratio"] = 1.0  # the default, which a table must state
    nominal = {key_of(name, unit_of(drive, name)): value for name, value in drive.nominal.items()}
    transmission = table.pop("transmission", None)
    table |= {key: float(value) for key, value in nominal.items()}
    return table if transmission is None else table | {"transmission": transmission}


def _plain(value: Any) -> Any:
    """Return a field as a TOML type."""
    if isinstance(value, Mapping):
        return {name: float(number) for name, number in value.items()}
    if isinstance(value, tuple):
        return list(value)
    return value if isinstance(value, str) else float(value)
