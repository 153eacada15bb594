"""What a log may have: the one table of its channels, from which names and units follow.

A row of channels.toml is a quantity of a joint, of the base or of a contact. Its name is the field
of `Log` or `BaseLog` and the key of a description; its columns in a file are the owner, the name
and the SI unit: "knee.joint_position_rad", "base.velocity_x_m_per_s", "foot.force_z_N". What a log
may not have is an error (`refusal`) by the codes of refusals.toml.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

import numpy as np

from seaid.errors import LogError, SeaidError

if TYPE_CHECKING:
    from seaid._arrays import Array

_Error = TypeVar("_Error", bound=SeaidError)


def _table_of(file: str) -> dict[str, Any]:
    return tomllib.loads(Path(__file__).with_name(file).read_text("utf-8"))


class Refusals(Generic[_Error]):
    """The errors of a file with `texts`, and the `arguments` that they name, by their codes."""

    def __init__(self, file: Path, error: type[_Error]) -> None:
        tables, self._error = tomllib.loads(file.read_text("utf-8")), error
        self.texts: dict[str, str] = tables["texts"]
        self.arguments: dict[str, list[str]] = tables.get("arguments", {})

    def __call__(self, code: str, /, **values: object) -> _Error:
        """Return the error of a code, with values for the braces of its text."""
        return self._error(self.texts[code].format(**values), *self.arguments.get(code, ()))


refusal = Refusals(Path(__file__).with_name("refusals.toml"), LogError)
"""Return the error of a code about a log."""


UNITS = _table_of("units.toml")
"""The tables of units.toml: the units with their spellings, and their prefixes."""


def _unit_factors() -> dict[str, dict[str, float]]:
    factors: dict[str, dict[str, float]] = {}
    for unit, entry in UNITS["units"].items():
        if "si" in entry:
            of_si, factor = factors.setdefault(entry["si"], {}), entry.get("factor", 1.0)
            of_si[unit] = factor
            for prefix in entry.get("prefixes", "").split():
                of_si[prefix + unit] = UNITS["prefixes"][prefix]["factor"] * factor
    return factors


UNIT_FACTORS = _unit_factors()
"""{SI unit at the end of a column name: {unit: factor to the SI unit}}, the SI unit first."""

TEMPERATURES = {
    unit: (entry.get("factor", 1.0), entry["zero"])
    for unit, entry in UNITS["units"].items()
    if "zero" in entry
}
"""{unit of a temperature: (factor, its zero) in degrees Celsius}."""

Interpolation = Literal["spline", "akima", "linear"]
Frame = Literal["base", "world"]


@dataclass(frozen=True)
class Quantity:
    """A row of the table.

    Attributes
    ----------
    name : str
        Field of `Log` or `BaseLog`, and key of a description.
    kind : str
        What is measured, which determines the units of a column.
    unit, prismatic_unit : str
        SI units at the end of a column, the latter of a prismatic joint if it is another one.
    interpolation : {"akima", "spline", "linear"}
        How samples are interpolated: by a spline what is differentiated, linearly a command.
    axes : str
        The components of a vector.
    short_name : str
        Another name, as logs of position controllers have it.
    is_slow : bool
        Whether its values repeat because they hardly change.
    frame : {"base", "world"} or None
        That of a vector that may be logged in either, where a description has none.
    """

    name: str
    kind: str
    unit: str
    prismatic_unit: str = ""
    interpolation: Interpolation = "akima"
    axes: str = ""
    short_name: str = ""
    is_slow: bool = False
    frame: Frame | None = None

    @property
    def is_command(self) -> bool:
        """Whether it is sent and not measured.

        Repeated values, zeros and jumps are what the drive was asked for, and no faults.
        """
        return self.name.endswith("_command")

    @property
    def is_position(self) -> bool:
        """Whether it is a measured position."""
        return self.kind == "position" and not self.is_command

    @property
    def width(self) -> int:
        """The number of its columns."""
        return max(len(self.axes), 1)

    def unit_of(self, is_prismatic: bool) -> str:
        """Return the SI unit of a joint."""
        return (is_prismatic and self.prismatic_unit) or self.unit

    def columns(self, owner: str, is_prismatic: bool = False) -> tuple[str, ...]:
        """Return the names of its columns in a file, of a joint, of the base or of a contact."""
        unit = self.unit_of(is_prismatic)
        name = self.name.replace("torque", "force") if unit == "N" else self.name
        parts = [[name, axis, unit] for axis in self.axes or [""]]
        return tuple(f"{owner}.{'_'.join(filter(None, words))}" for words in parts)


OF_JOINTS, OF_BASE, OF_CONTACTS = (
    {name: Quantity(name, **row) for name, row in table.items()}
    for table in _table_of("channels.toml").values()
)
"""Quantities of a joint, of the base and of a contact by their names."""

SENSORS = tuple(OF_JOINTS)
"""Fields of a `Log` with samples of sensors, each (T, n)."""

OF_CONTROLLERS = (*(x for x, row in OF_JOINTS.items() if row.is_command), "supply_voltage")
"""Fields that the controllers of drives need."""

CHANNELS = {
    name: row.columns("base")
    for name, row in OF_BASE.items()
    if name not in ("acceleration", "angle")
}
"""{field of `BaseLog`: its columns in a file}."""

(ANGLE,) = OF_BASE["angle"].columns("base")
"""The column of the angle of a planar base, in place of its orientation."""


def contact_columns(link: str) -> tuple[str, tuple[str, ...]]:
    """Return the columns of a contact in a file: of its flag, and of its wrench."""
    (flag,), *wrench = (row.columns(link) for row in OF_CONTACTS.values())
    return flag, tuple(chain.from_iterable(wrench))


def column_names(joint: str, is_prismatic: bool) -> dict[str, str]:
    """Return {field of `Log`: column name in a file} of one joint."""
    return {name: row.columns(joint, is_prismatic)[0] for name, row in OF_JOINTS.items()}


def short_name(name: str) -> str:
    """Return the short name of a column of seaid: "knee.position_rad" of the joint's position."""
    joint, _, text = name.rpartition(".")
    field, _, unit = text.rpartition("_")
    row = OF_JOINTS.get(field)
    return f"{joint}.{row.short_name}_{unit}" if joint and row and row.short_name else name


@cache
def quantity_of(name: str) -> Quantity:
    """Return the row of a field or of a column of seaid; an empty one for another name."""
    owner, _, text = name.rpartition(".")
    tables = OF_JOINTS, OF_BASE if owner == "base" else OF_CONTACTS
    for field, row in chain.from_iterable(table.items() for table in tables):
        if f"{text}_".startswith((f"{field}_", f"{field.replace('torque', 'force')}_")):
            return row
    return Quantity("", "", "")


def units_of(kind: str) -> set[str]:
    """Return the units of the columns of a quantity of a joint, by what is measured."""
    rows = [row for row in OF_JOINTS.values() if row.kind == kind]
    units = {unit for row in rows for unit in (row.unit, row.prismatic_unit) if unit}
    if "degC" in units:
        return {*TEMPERATURES}
    # Encoders count, and a torque may be that of a current by a torque constant.
    units |= {"A"} if "Nm" in units else set()
    factors = set(chain.from_iterable(UNIT_FACTORS[unit] for unit in units))
    return factors | ({"counts"} if "rad" in units else set())


def check_finite(about: str, values: Array, advice: str = "drop the sample") -> None:
    """Raise LogError for samples (T,) or (T, k) that are NaN or infinite, naming the first one."""
    if not np.isfinite(values).all():
        bad = np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))
        size = {"bad": len(bad), "count": len(values)}
        raise refusal("not_finite", about=about, row=bad[0], advice=advice, **size)


def check_size(about: str, values: Array, largest: float) -> None:
    """Raise LogError for finite samples (T,) beyond what any sensor measures."""
    beyond = np.flatnonzero(np.isfinite(values) & (np.abs(values) > largest))
    if len(beyond):
        value, row = values[beyond[0]], beyond[0]
        raise refusal("too_large", about=about, value=value, row=row, largest=largest)
