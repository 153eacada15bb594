"""The values of a drive's parameters: which it has, their units, and where they lie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from seaid.arrays import FrozenMapping
from seaid.drivetrain.catalogue import PARAMETERS, PARAMETERS_OF, key_of
from seaid.errors import RobotError

if TYPE_CHECKING:
    from seaid.drivetrain.model import Drive, SeriesElasticDrive, StiffDrive

    AnyDrive = TypeVar("AnyDrive", StiffDrive, SeriesElasticDrive)


def unit_of(drive: Drive, name: str) -> str:
    """Return the unit of a parameter of a drive."""
    return PARAMETERS[name].unit_for(drive.spring_units, drive.joint_units)


DRY = ("coulomb", "load", "stribeck")
"""Friction terms that can hold a motor, unless the drive's Coulomb friction is smooth."""


def is_smooth(drive: Drive) -> bool:
    """Tell whether the drive's friction is known at standstill too."""
    return bool({"smooth_coulomb", "shifted_coulomb"} & set(drive.friction))


def is_dry(drive: Drive) -> bool:
    """Tell whether the drive has friction whose direction is unknown at standstill."""
    return bool(set(DRY) & set(drive.friction)) and not is_smooth(drive)


def parameter_names(
    drive: Drive, term_fields: tuple[str, ...], extra: tuple[str, ...] = ()
) -> tuple[str, ...]:
    """Return the names of all parameters that the terms of a drive have, in order."""
    names = {"motor_inertia", *extra}
    for field in term_fields:
        terms = getattr(drive, field)
        for term in (terms,) if isinstance(terms, str) else terms:
            names.update(PARAMETERS_OF[field][term])
    return tuple(name for name in PARAMETERS if name in names)


def field_of(drive: Drive, name: str) -> str | None:
    """Return the field that has the value of a parameter, None where `nominal` has it."""
    key = key_of(name, unit_of(drive, name))
    return key if hasattr(drive, key) else None


def values_of(drive: Drive) -> Mapping[str, float]:
    """Return {parameter: known or nominal value} of all that have one."""
    values: dict[str, float] = {}
    for name in PARAMETERS:
        field = field_of(drive, name)
        value = drive.nominal.get(name) if field is None else getattr(drive, field)
        if value is not None:
            values[name] = float(value)
    return FrozenMapping(values)


_DIVISORS = ("coulomb_width", "stribeck_speed", "torque_constant", "voltage_constant")
_LEAST_DIVISOR = 1e-12


def check_divisors(drive: Drive, values: Mapping[str, float]) -> None:
    """Raise RobotError for a zero by which an equation of the drive is divided.

    An identification may find such a zero; nothing can be computed with it.
    """
    for name in _DIVISORS:
        if name in drive.parameter_names and values.get(name, 1.0) < _LEAST_DIVISOR:
            raise RobotError(
                f"'{key_of(name, unit_of(drive, name))}' is {values[name]:g}, and the drive's "
                "equation is divided by it: give a value above zero, or leave its term out"
            )


def with_values(drive: AnyDrive, values: Mapping[str, float]) -> AnyDrive:
    """Return the drive with values of some parameters, in their fields or in `nominal`."""
    changes: dict[str, Any] = {}
    nominal = dict(drive.nominal)
    for name, value in values.items():
        field = field_of(drive, name)
        if field is None:
            nominal[name] = float(value)
        else:
            changes[field] = float(value)
    return replace(drive, nominal=nominal, **changes)


def without_nominal(drive: AnyDrive) -> AnyDrive:
    """Return the drive with known values only."""
    kept = {"motor_inertia", *drive.known}
    fields_of = {name: field_of(drive, name) for name in PARAMETERS if name not in kept}
    changes: dict[str, Any] = {field: None for field in fields_of.values() if field is not None}
    nominal = {name: value for name, value in drive.nominal.items() if name in kept}
    return replace(drive, nominal=nominal, **changes)
