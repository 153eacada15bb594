"""Log description: which column of a foreign log is what, as plain data, from TOML."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from seaid.arrays import FrozenMapping
from seaid.errors import LogError, unknown_name
from seaid.logs.log_columns import SENSORS, UNIT_FACTORS
from seaid.logs.repair import Repairs

QUANTITIES = (*SENSORS, "deflection")
"""What a column may be, per joint. Deflection: motor side of the spring minus joint side."""


@dataclass(frozen=True)
class Clock:
    """The time of samples: a column and its unit (s, ms, us, ns), or an even rate [Hz]."""

    column: str | None = None
    unit: str = "s"
    rate_hz: float | None = None

    def __post_init__(self) -> None:
        if (self.column is None) == (self.rate_hz is None):
            raise LogError("a time needs column, or rate_hz where there is none")
        if self.rate_hz is not None and not 0 < self.rate_hz < math.inf:
            raise LogError(f"rate_hz must be above zero and finite, found {self.rate_hz}")
        if self.unit not in UNIT_FACTORS["s"]:
            raise LogError(unknown_name("unit of time", self.unit, UNIT_FACTORS["s"]))


@dataclass(frozen=True)
class Servo:
    """A proportional position servo: voltage = clip(g (goal - position), -limit, limit) supply.

    A goal holds until the next sample.

    `goal` and `position` are columns in the same unit; g = `gain` times `gain_factor` is a duty
    cycle a unit; `gain` and `supply` [V] are columns or numbers.
    """

    goal: str
    position: str
    gain: str | float
    supply: str | float
    gain_factor: float = 1.0
    limit: float = 1.0

    def columns(self) -> list[str]:
        """Return the columns that it takes."""
        return [
            one
            for one in (self.goal, self.position, self.gain, self.supply)
            if isinstance(one, str)
        ]


@dataclass(frozen=True)
class Source:
    """Where a quantity comes from: value = sign scale (unit in SI) times column + offset.

    `unit`: that of the column, None = SI; "counts" with `counts_per_turn` or `counts_per_m`; "A" or
    "mA" of a torque with `torque_constant_Nm_per_A`. `offset` is in SI units, `wraps` the period of
    an encoder that wraps around, in the column's unit. `times`: a column or number to multiply
    with, as the supply voltage of a duty cycle. `side`: "motor" or "joint", where the column has
    the value at the other side of the gear. `time`: its own clock. `servo` instead of a column: a
    voltage that is not logged.
    """

    column: str | None = None
    unit: str | None = None
    sign: int = 1
    scale: float = 1.0
    offset: float = 0.0
    wraps: float | None = None
    counts_per_turn: float | None = None
    counts_per_m: float | None = None
    torque_constant_Nm_per_A: float | None = None
    times: str | float | None = None
    side: str | None = None
    time: Clock | None = None
    servo: Servo | None = None

    def columns(self) -> list[str]:
        """Return the columns that it takes, without that of its clock."""
        own = [one for one in (self.column, self.times) if isinstance(one, str)]
        return own + (self.servo.columns() if self.servo else [])


@dataclass(frozen=True, eq=False)
class LogDescription:
    """What the columns of a log are: {joint: {quantity: Source}}, their clock, limits of repair.

    `time` is the clock of all that have none of their own; None: the file's own (ROS bags and HEBI
    logs have one). `where` names a column: samples at which it is zero are left out.
    """

    joints: Mapping[str, Mapping[str, Source]]
    time: Clock | None = None
    where: str | None = None
    repair: Repairs = field(default_factory=Repairs)

    def __post_init__(self) -> None:
        copied = {joint: FrozenMapping(sources) for joint, sources in self.joints.items()}
        object.__setattr__(self, "joints", FrozenMapping(copied))

    def to_dict(self) -> dict[str, Any]:
        """Return the description as nested plain data, what is default left out."""
        found: dict[str, Any] = {}
        if self.time is not None:
            found["time"] = _short(_plain(self.time))
        if self.where is not None:
            found["where"] = self.where
        found["joints"] = {
            joint: {name: _short(_plain(source)) for name, source in sources.items()}
            for joint, sources in self.joints.items()
        }
        if repair := _plain(self.repair):
            found["repair"] = repair
        return found

    def to_toml(self) -> str:
        """Return the description as the text of a TOML file."""
        content = self.to_dict()
        lines = [f"{key} = {_toml(content[key])}" for key in ("time", "where") if key in content]
        tables = {f"joints.{_key(joint)}": one for joint, one in content["joints"].items()}
        if "repair" in content:
            tables["repair"] = content["repair"]
        for name, table in tables.items():
            lines += ["", f"[{name}]"]
            lines += [f"{_key(key)} = {_toml(value)}" for key, value in table.items()]
        return "\n".join(lines).lstrip("\n") + "\n"


def _plain(one: Any) -> dict[str, Any]:
    """Return a dataclass as a mapping, without what is at its default."""
    default = {each.name: each.default for each in fields(one)}
    found = {key: value for key, value in asdict(one).items() if value != default[key]}
    return {
        key: _plain(getattr(one, key)) if isinstance(value, dict) else value
        for key, value in found.items()
    }


def _short(table: dict[str, Any]) -> Any:
    """Return a table with nothing but a column as the name of that column."""
    table = {key: _short(one) if key == "time" else one for key, one in table.items()}
    return table["column"] if list(table) == ["column"] else table


def _key(name: str) -> str:
    bare = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if bare else _text(name)


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(one)}" for key, one in value.items()) + " }"
    if isinstance(value, str):
        return _text(value)
    return repr(float(value) if isinstance(value, float) else value)  # NumPy's repr is no number


def _text(value: str) -> str:
    """Return a text as TOML has it: as in JSON, but without a raw delete character."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
