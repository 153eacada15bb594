"""Names and units of the columns of our logs, and foreign names for them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from numbers import Real
from pathlib import Path

import numpy as np

from seaid.errors import LogError, listed, shown, unknown_name
from seaid.formats.table import Table
from seaid.robot import Robot

Column = str | tuple[str, float | str]
"""A foreign column: its name, or its name with the unit it is in or the factor to the SI unit."""

UNIT_FACTORS = {
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180, "turn": 2 * np.pi},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "Nm": {"Nm": 1.0, "mNm": 1e-3},
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "A": {"A": 1.0, "mA": 1e-3},
    "V": {"V": 1.0, "mV": 1e-3},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
"""Factors to the SI unit with which a column name ends."""

SENSORS = (
    "motor_position",
    "joint_position",
    "motor_torque",
    "joint_torque",
    "motor_current",
    "motor_voltage",
)
"""Fields of a Log with samples of sensors, each (T, n)."""


def column_names(joint: str, is_prismatic: bool) -> dict[str, str]:
    """Return {file column name: field of Log} of one joint."""
    position, torque = ("m", "joint_force_N") if is_prismatic else ("rad", "joint_torque_Nm")
    return {
        f"{joint}.motor_position_rad": "motor_position",
        f"{joint}.joint_position_{position}": "joint_position",
        f"{joint}.motor_torque_Nm": "motor_torque",
        f"{joint}.{torque}": "joint_torque",
        f"{joint}.motor_current_A": "motor_current",
        f"{joint}.motor_voltage_V": "motor_voltage",
    }


def wanted_columns(
    path: Path, table: Table, robot: Robot, columns: Mapping[str, Column]
) -> dict[str, tuple[str, float]]:
    """Return {our column: (column of the file, factor to our unit)} of all that the file has."""
    if not isinstance(columns, Mapping):
        raise LogError(
            f"columns= must be a mapping {{our column: column of the file}}, found {shown(columns)}"
        )
    allowed = ["time_s"]
    for joint, is_prismatic in zip(robot.joint_names, robot.is_prismatic, strict=True):
        allowed += column_names(joint, is_prismatic)
    for name in columns:
        if name not in allowed:
            raise LogError("columns=: " + unknown_name("column of this robot's log", name, allowed))
    wanted: dict[str, tuple[str, float]] = {}
    for name in allowed:
        foreign, factor = _foreign(name, columns.get(name, name))
        if foreign in table.names:
            wanted[name] = (foreign, factor)
        elif name in columns or name == "time_s":
            hint = "; foreign names need columns= or description= (seaid.describe_log guesses one)"
            raise LogError(f"'{path}': {table.missing(foreign)}{'' if name in columns else hint}")
    if len(wanted) == 1:
        raise LogError(
            f"'{path}' has no column of this robot; expected names as '{allowed[1]}' (or map "
            f"foreign ones with columns=), found: {listed(table.names)}"
        )
    return wanted


_COMPARED = 1_000
"""Names of a file that are compared with missing ones."""


def near_names(missing: list[str], picked: Iterable[str], file_names: Sequence[str]) -> str:
    """Return a hint for columns of the file whose names are nearly those of missing ones."""
    free = [name for name in file_names if name not in picked][:_COMPARED]
    pairs = [(name, near) for name in missing for near in get_close_matches(name, free, 1, 0.9)]
    return "".join(f"; '{near}' in the file is near '{name}'" for name, near in pairs)


def _foreign(name: str, column: Column) -> tuple[str, float]:
    if isinstance(column, str):
        return column, 1.0
    is_pair = isinstance(column, tuple | list) and len(column) == 2 and isinstance(column[0], str)
    if not (is_pair and isinstance(column[1], str | Real)):
        raise LogError(
            f"columns= '{name}' must be a column name or (name, unit or factor), found "
            f"{shown(column)}"
        )
    foreign, factor = column
    if isinstance(factor, str):
        units = UNIT_FACTORS[name.rsplit("_", 1)[1]]
        if factor not in units:
            raise LogError(f"columns= '{name}': " + unknown_name("unit for it", factor, units))
        factor = units[factor]
    if not (np.isfinite(factor) and factor != 0):
        raise LogError(f"columns= '{name}': the factor must be finite and not zero, found {factor}")
    return foreign, float(factor)
