"""The drivetrain of one joint as data: stiff, or series elastic; read from TOML.

Friction and rotor inertia are at the motor. What a drive leaves at None is not known: known values
(ratio, radii, rotor inertia) enter the equations, nominal ones (stiffness, friction) only serve
simulation and planning.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from numbers import Real
from pathlib import Path
from typing import Any

from seaid.errors import RobotError, unknown_name

FRICTION_TERMS = ("viscous", "coulomb", "offset")
"""What `friction` may name; an offset (a constant torque) only at a stiff drive: the deflection
offset of an elastic one is the same column."""

_PLAIN_FRICTION = ("viscous", "coulomb")


@dataclass(frozen=True)
class StiffDrive:
    """A motor behind a stiff gear: N tau_M - N^2 I_M q'' - friction = joint torque.

    `gear_ratio` motor turns a joint turn (`gear_ratio_rad_per_m` at a prismatic joint);
    `motor_inertia_kg_m2` None = unknown, to be identified; `friction` names the terms of its
    friction, all to be identified ("viscous", "coulomb", "offset"); friction values are nominal.
    `extra_terms` are expressions added to the motor's equation, see `seaid.drivetrain.equations`.
    """

    gear_ratio: float | None = None
    gear_ratio_rad_per_m: float | None = None
    motor_inertia_kg_m2: float | None = None
    viscous_friction_Nms_per_rad: float | None = None
    coulomb_friction_Nm: float | None = None
    friction: tuple[str, ...] = _PLAIN_FRICTION
    extra_terms: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_numbers(self)
        _check_terms(self)
        if self.gear_ratio is not None and self.gear_ratio_rad_per_m is not None:
            raise RobotError(
                "a stiff drive has gear_ratio (turning joint) or gear_ratio_rad_per_m (prismatic "
                "joint), found both"
            )

    @property
    def ratio(self) -> float:
        """Motor angle a joint coordinate, rad/rad or rad/m; 1 where none is given."""
        return self.gear_ratio or self.gear_ratio_rad_per_m or 1.0

    def without_nominal(self) -> StiffDrive:
        """Return the drive with known values only: no friction."""
        return replace(self, viscous_friction_Nms_per_rad=None, coulomb_friction_Nm=None)


@dataclass(frozen=True)
class SeriesElasticDrive:
    """A motor with gear, and a spring between two pulleys (Fig. 1 of the paper).

    No radii: a rotary spring behind the gear, `stiffness_Nm_per_rad`, the same equations with both
    radii 1. Both radii: a linear spring, `stiffness_N_per_m`. At a prismatic joint the motor pulley
    only (the load side counts 1), `stiffness_N_per_m`. `motor_inertia_kg_m2` None = unknown, to be
    identified; stiffness and friction values are nominal.
    """

    gear_ratio: float
    motor_inertia_kg_m2: float | None = None
    motor_pulley_radius_m: float | None = None
    load_pulley_radius_m: float | None = None
    stiffness_N_per_m: float | None = None
    stiffness_Nm_per_rad: float | None = None
    viscous_friction_Nms_per_rad: float | None = None
    coulomb_friction_Nm: float | None = None
    friction: tuple[str, ...] = _PLAIN_FRICTION
    extra_terms: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_numbers(self)
        _check_terms(self)
        if self.load_pulley_radius_m is not None and self.motor_pulley_radius_m is None:
            raise RobotError(
                "a series elastic drive with load_pulley_radius_m needs motor_pulley_radius_m too "
                "(leave both out for a rotary spring)"
            )
        wrong = "stiffness_Nm_per_rad" if self.is_linear_spring else "stiffness_N_per_m"
        if getattr(self, wrong) is not None:
            kind = "linear" if self.is_linear_spring else "rotary"
            right = "stiffness_N_per_m" if self.is_linear_spring else "stiffness_Nm_per_rad"
            raise RobotError(
                f"found {wrong}, but the spring is {kind} (pulley radii "
                f"{'given' if self.is_linear_spring else 'left out'}): use {right}"
            )

    @property
    def is_linear_spring(self) -> bool:
        """True for a spring that is pulled [N/m], False for one that is twisted [N m/rad]."""
        return self.motor_pulley_radius_m is not None

    @property
    def ratio(self) -> float:
        """Gear ratio N, motor turns a turn behind the gear."""
        return self.gear_ratio

    @property
    def motor_radius(self) -> float:
        """r_M of (7), [m]; 1 for a rotary spring."""
        return self.motor_pulley_radius_m or 1.0

    @property
    def load_radius(self) -> float:
        """r_L of (8), [m]; 1 for a rotary spring and for a prismatic joint."""
        return self.load_pulley_radius_m or 1.0

    @property
    def stiffness(self) -> float | None:
        """Nominal k, in `stiffness_unit`."""
        return self.stiffness_N_per_m if self.is_linear_spring else self.stiffness_Nm_per_rad

    @property
    def stiffness_unit(self) -> str:
        """N/m or N m/rad."""
        return "N/m" if self.is_linear_spring else "N m/rad"

    @property
    def force_unit(self) -> str:
        """Unit of what the spring transmits: N or N m."""
        return "N" if self.is_linear_spring else "N m"

    def without_nominal(self) -> SeriesElasticDrive:
        """Return the drive with known values only: no stiffness, no friction."""
        return replace(
            self,
            stiffness_N_per_m=None,
            stiffness_Nm_per_rad=None,
            viscous_friction_Nms_per_rad=None,
            coulomb_friction_Nm=None,
        )


Drive = StiffDrive | SeriesElasticDrive

_TYPES: dict[str, type[StiffDrive] | type[SeriesElasticDrive]] = {
    "stiff": StiffDrive,
    "series_elastic": SeriesElasticDrive,
}
_MAY_BE_ZERO = (
    "motor_inertia_kg_m2",
    "viscous_friction_Nms_per_rad",
    "coulomb_friction_Nm",
)


def read_drivetrains(path: str | Path) -> dict[str, Drive]:
    """Read a drivetrain TOML, one table a joint. Raises RobotError naming joint and key."""
    path = Path(path)
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise RobotError(f"cannot read drivetrains '{path}': {problem.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise RobotError(f"drivetrains '{path}' is not valid TOML: {problem}") from None
    return {joint: _drive(f"{path}: [{joint}]", table) for joint, table in tables.items()}


def drives_from_mapping(drivetrains: Mapping[str, Any]) -> dict[str, Drive]:
    """Return {joint: drive} of a mapping whose values are drives or tables as in the TOML."""
    return {
        joint: value
        if isinstance(value, StiffDrive | SeriesElasticDrive)
        else _drive(f"drivetrain of '{joint}'", value)
        for joint, value in drivetrains.items()
    }


def _drive(where: str, table: Any) -> Drive:
    if not isinstance(table, Mapping):
        raise RobotError(f"{where} must be a table of a drive, found {table!r}")
    if "type" not in table:
        raise RobotError(f"{where}: key 'type' is missing; allowed: {', '.join(_TYPES)}")
    if not isinstance(table["type"], str) or table["type"] not in _TYPES:
        raise RobotError(f"{where}: " + unknown_name("drive type", str(table["type"]), _TYPES))
    kind = _TYPES[table["type"]]
    keys = [field.name for field in fields(kind)]
    values = {key: value for key, value in table.items() if key != "type"}
    for key in values:
        if key not in keys:
            raise RobotError(f"{where}: " + unknown_name("key", key, ["type", *keys]))
    needed = ("gear_ratio", "gear_ratio_rad_per_m") if kind is StiffDrive else ("gear_ratio",)
    if not any(key in values for key in needed):
        raise RobotError(
            f"{where}: key '{needed[0]}' is missing; give the motor turns a turn behind the gear"
        )
    try:
        return kind(**values)
    except RobotError as problem:
        raise RobotError(f"{where}: {problem}") from None


def _check_numbers(drive: Drive) -> None:
    for field in fields(drive):
        value = getattr(drive, field.name)
        if value is None or field.name in ("friction", "extra_terms"):
            continue
        if isinstance(value, bool) or not isinstance(value, Real):
            raise RobotError(f"{field.name} must be a number, found {value!r}")
        number = float(value)
        least = "zero or more" if field.name in _MAY_BE_ZERO else "more than zero"
        allowed = number >= 0 if field.name in _MAY_BE_ZERO else number > 0
        if not allowed or number == float("inf"):
            raise RobotError(f"{field.name} must be {least} and finite, found {value}")


def _check_terms(drive: Drive) -> None:
    for field in ("friction", "extra_terms"):
        terms = getattr(drive, field)
        if not (isinstance(terms, list | tuple) and all(isinstance(term, str) for term in terms)):
            raise RobotError(f"{field} must be a list of texts, found {terms!r}")
        if len(set(terms)) < len(terms):
            raise RobotError(f"{field} names a term twice: {', '.join(terms)}")
        object.__setattr__(drive, field, tuple(terms))
    for term in drive.friction:
        if term not in FRICTION_TERMS:
            raise RobotError(unknown_name("friction term", str(term), FRICTION_TERMS))
    if isinstance(drive, SeriesElasticDrive) and "offset" in drive.friction:
        raise RobotError(
            "an elastic drive has no friction offset: its constant column is the deflection offset"
        )


IDEAL_DRIVE = StiffDrive(gear_ratio=1.0, motor_inertia_kg_m2=0.0, friction=())
"""The drive of a joint that has none in the description: its torque is known at the joint."""
