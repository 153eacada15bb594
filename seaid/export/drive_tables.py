"""Drivetrains as a TOML file that `load_robot` reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from seaid.drivetrain.catalogue import key_of
from seaid.drivetrain.model import IDEAL_DRIVE, Drive, SeriesElasticDrive, StiffDrive
from seaid.drivetrain.values import unit_of
from seaid.files import write_whole


def write_drivetrains(drives: Mapping[str, Drive], path: str | Path) -> None:
    """Write {joint: drive} as TOML, one table a joint, whole or not at all.

    Ideal drives are left out: a joint without a table has one. Raises SeaidError where the file
    cannot be written.
    """
    import tomli_w

    tables = {joint: drive_table(drive) for joint, drive in drives.items() if drive != IDEAL_DRIVE}
    write_whole(path, tomli_w.dumps(tables))


def drive_table(drive: Drive) -> dict[str, Any]:
    """Return the TOML table of a drive: what differs from the defaults, values under their keys."""
    kind = "series_elastic" if isinstance(drive, SeriesElasticDrive) else "stiff"
    table: dict[str, Any] = {"type": kind}
    for field in fields(drive):
        value = getattr(drive, field.name)
        default = None if field.default is MISSING else field.default
        if value is None or value == default or field.name == "nominal":
            continue
        table[field.name] = _plain(value)
    if isinstance(drive, StiffDrive) and not {"gear_ratio", "gear_ratio_rad_per_m"} & set(table):
        table["gear_ratio"] = 1.0  # what it has where none is given
    nominal = {key_of(name, unit_of(drive, name)): value for name, value in drive.nominal.items()}
    transmission = table.pop("transmission", None)
    table |= {key: float(value) for key, value in nominal.items()}
    return table if transmission is None else table | {"transmission": transmission}


def _plain(value: Any) -> Any:
    """Return a field as what TOML knows."""
    if isinstance(value, Mapping):
        return {name: float(number) for name, number in value.items()}
    if isinstance(value, tuple):
        return list(value)
    return value if isinstance(value, str) else float(value)
