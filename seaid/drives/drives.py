"""The values of a drive's parameters: which it has, their units, and where they lie.

What a drive may be: its numbers, its terms and their values, checked where it is made.

The drive of one joint as data: stiff, or series elastic.

Friction and rotor inertia are at the motor. What a drive leaves at None is not known: known values
(ratio, radii, rotor inertia, what `known` names) enter the equations, nominal ones (stiffness,
friction, all others) only serve simulation, planning and as a start of a search.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

from seaid._arrays import FrozenMapping, number
from seaid.drives.terms import (
    COULOMB,
    FRICTION_TERMS,
    MOTOR_INPUTS,
    NON_LINEAR_SPRING,
    PARAMETERS,
    PARAMETERS_OF,
    key_of,
)
from seaid.errors import RobotError, shortened, shown, unknown_name

AnyDrive = TypeVar("AnyDrive", "StiffDrive", "SeriesElasticDrive")


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


_MAY_BE_ZERO = (
    "motor_inertia_kg_m2",
    "viscous_friction_Nms_per_rad",
    "coulomb_friction_Nm",
)
_LENGTHS = ("gear_ratio", "motor_pulley_radius", "load_pulley_radius", "transmission")
_LENGTH_SIZES, _SIZES = (1e-9, 1e9), (0.0, 1e30)
"""So that products and powers in the equations stay doubles; no drive comes near."""

_MOST_EXTRA_TERMS = 20
_TERM_FIELDS = (*(name for name in PARAMETERS_OF if name != "motor_input"), "known", "extra_terms")
_NO_NUMBERS = (*PARAMETERS_OF, "known", "extra_terms", "nominal", "transmission")


def check_numbers(drive: Drive) -> None:
    """Check the fields that are numbers. Raises RobotError."""
    for field in fields(drive):
        value = getattr(drive, field.name)
        if value is None or field.name in _NO_NUMBERS:
            continue
        least = "zero or more" if field.name in _MAY_BE_ZERO else "more than zero"
        _check_number(field.name, value, least)


def _check_number(name: str, value: Any, least: str) -> None:
    """Check a number. Raises RobotError for one that is none, or that no drive can have."""
    size = number(name, value, RobotError)
    allowed = {"zero or more": size >= 0, "more than zero": size > 0}.get(least, True)
    if not allowed or not math.isfinite(size):
        raise RobotError(f"{name} must be {least} and finite, found {shown(value)}")
    least_size, most = _LENGTH_SIZES if name.startswith(_LENGTHS) else _SIZES
    if size and not least_size <= abs(size) <= most:
        raise RobotError(
            f"{name} must be from {least_size:g} to {most:g} in size, found {size:g}: check its "
            "unit"
        )


def check_terms(drive: Drive) -> None:
    """Check the fields that name terms. Raises RobotError."""
    for field in _TERM_FIELDS:
        if not hasattr(drive, field):
            continue
        terms = getattr(drive, field)
        if not (isinstance(terms, list | tuple) and all(isinstance(term, str) for term in terms)):
            raise RobotError(f"{field} must be a list of texts, found {shown(terms)}")
        if len(set(terms)) < len(terms):
            raise RobotError(f"{field} names a term twice: {shortened(', '.join(terms))}")
        object.__setattr__(drive, field, tuple(terms))
        for term in terms:
            if field in PARAMETERS_OF and term not in PARAMETERS_OF[field]:
                what = f"{field.replace('_', ' ')} term"
                raise RobotError(unknown_name(what, term, PARAMETERS_OF[field]))
    if len(drive.extra_terms) > _MOST_EXTRA_TERMS:
        raise RobotError(
            f"extra_terms has {len(drive.extra_terms)} terms, allowed are {_MOST_EXTRA_TERMS}"
        )
    if not isinstance(drive.motor_input, str) or drive.motor_input not in MOTOR_INPUTS:
        raise RobotError(unknown_name("motor input", drive.motor_input, MOTOR_INPUTS))
    coulomb = [term for term in drive.friction if term in COULOMB]
    if len(coulomb) > 1:
        raise RobotError(f"friction has one of {', '.join(COULOMB)}, found {', '.join(coulomb)}")
    if hasattr(drive, "spring") and "offset" in drive.friction:
        raise RobotError(
            "an elastic drive has no friction offset: its constant column is the deflection offset"
        )


def check_spring(drive: SeriesElasticDrive) -> None:
    """Check radii, stiffness and terms of a spring against each other. Raises RobotError."""
    if drive.load_pulley_radius_m is not None and drive.motor_pulley_radius_m is None:
        raise RobotError(
            "a series elastic drive with load_pulley_radius_m needs motor_pulley_radius_m too "
            "(leave both out for a rotary spring)"
        )
    wrong = "stiffness_Nm_per_rad" if drive.is_linear_spring else "stiffness_N_per_m"
    if getattr(drive, wrong) is not None:
        kind = "linear" if drive.is_linear_spring else "rotary"
        right = "stiffness_N_per_m" if drive.is_linear_spring else "stiffness_Nm_per_rad"
        raise RobotError(
            f"found {wrong}, but the spring is {kind} (pulley radii "
            f"{'given' if drive.is_linear_spring else 'left out'}): use {right}"
        )
    if not {"linear", "cubic", "fifth"} & set(drive.spring):
        raise RobotError(
            "spring needs a term that pulls, 'linear', 'cubic' or 'fifth', found "
            f"{', '.join(drive.spring) or 'none'}"
        )


def check_values(drive: Drive) -> None:
    """Check `nominal`, `known` and `transmission` against the terms that the drive has."""
    names = drive.parameter_names
    for field in ("nominal", "transmission"):
        given = getattr(drive, field)
        if not isinstance(given, Mapping):
            raise RobotError(f"{field} must be a table of numbers, found {shown(given)}")
        for name, value in given.items():
            _check_number(f"{field} '{shortened(name)}'", value, "any number")
        object.__setattr__(drive, field, FrozenMapping(given))
    for name, value in drive.nominal.items():
        if name not in PARAMETERS:
            raise RobotError(unknown_name("nominal parameter", name, PARAMETERS))
        field_name = field_of(drive, name)
        if field_name is not None:
            raise RobotError(f"nominal has '{name}': give it as {field_name}")
        if name not in names:
            raise RobotError(f"found a value of '{name}', but {_term_with(name)} is not there")
        if PARAMETERS[name].is_positive:
            _check_number(f"nominal '{name}'", value, "zero or more")
    for name in drive.known:
        if name not in names:
            raise RobotError(unknown_name("known parameter", name, list(names)))
        if name not in drive.values:
            raise RobotError(f"known names '{name}', but it has no value")


def _term_with(name: str) -> str:
    """Say which term brings a parameter."""
    for field, terms in PARAMETERS_OF.items():
        for term, names in terms.items():
            if name in names:
                return f"its term '{term}' of {field}"
    return "a spring that is not linear, whose zero it is,"


__all__ = [
    "FRICTION_TERMS",
    "IDEAL_DRIVE",
    "Drive",
    "SeriesElasticDrive",
    "StiffDrive",
]

_PLAIN_FRICTION = ("viscous", "coulomb")
_NOTHING: Mapping[str, float] = FrozenMapping({})


@dataclass(frozen=True)
class StiffDrive:
    """A motor behind a stiff gear: N tau_M - N^2 I_M q'' - friction = joint torque.

    `gear_ratio` motor turns a joint turn (`gear_ratio_rad_per_m` at a prismatic joint);
    `motor_inertia_kg_m2` None = unknown, to be identified; `friction` names the terms of its
    friction, all to be identified, see `seaid.drives.terms`; friction values are nominal.
    `extra_terms` are expressions added to the motor's equation, see `seaid.drives.equations`.

    `nominal` {parameter: value} are nominal values of all other parameters; `known` names those
    whose nominal value is known and not identified. `transmission` {joint: factor} makes the drive
    turn a sum of joint coordinates instead of its own joint's alone (a differential, a
    parallelogram): its angle behind the gear is sum of factor times q.
    """

    gear_ratio: float | None = None
    gear_ratio_rad_per_m: float | None = None
    motor_inertia_kg_m2: float | None = None
    viscous_friction_Nms_per_rad: float | None = None
    coulomb_friction_Nm: float | None = None
    friction: tuple[str, ...] = _PLAIN_FRICTION
    extra_terms: tuple[str, ...] = ()
    parallel_spring: tuple[str, ...] = ()
    motor_input: str = "torque"
    known: tuple[str, ...] = ()
    nominal: Mapping[str, float] = _NOTHING
    transmission: Mapping[str, float] = _NOTHING

    def __post_init__(self) -> None:
        check_numbers(self)
        check_terms(self)
        check_values(self)
        if self.gear_ratio is not None and self.gear_ratio_rad_per_m is not None:
            raise RobotError(
                "a stiff drive has gear_ratio (turning joint) or gear_ratio_rad_per_m (prismatic "
                "joint), found both"
            )

    @property
    def ratio(self) -> float:
        """Motor angle a joint coordinate, rad/rad or rad/m; 1 where none is given."""
        return self.gear_ratio or self.gear_ratio_rad_per_m or 1.0

    @property
    def joint_units(self) -> tuple[str, str]:
        """Units of what acts on the joint and of its coordinate: N m and rad, or N and m."""
        return ("N m", "rad") if self.gear_ratio_rad_per_m is None else ("N", "m")

    @property
    def spring_units(self) -> tuple[str, str]:
        """Those of the joint: a stiff drive has no spring."""
        return self.joint_units

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all parameters that its terms have, known ones too, in the order of columns."""
        return parameter_names(self, ("friction", "parallel_spring", "motor_input"))

    @property
    def values(self) -> Mapping[str, float]:
        """{parameter: known or nominal value} of all that have one."""
        return values_of(self)

    def with_values(self, values: Mapping[str, float]) -> StiffDrive:
        """Return the drive with values of some parameters."""
        return with_values(self, values)

    def without_nominal(self) -> StiffDrive:
        """Return the drive with known values only: no friction."""
        return without_nominal(self)


@dataclass(frozen=True)
class SeriesElasticDrive:
    """A motor with gear, and a spring between two pulleys (Fig. 1 of the paper).

    No radii: a rotary spring behind the gear, `stiffness_Nm_per_rad`, the same equations with both
    radii 1. Both radii: a linear spring, `stiffness_N_per_m`. At a prismatic joint the motor pulley
    only (the load side counts 1), `stiffness_N_per_m`. `motor_inertia_kg_m2` None = unknown, to be
    identified; stiffness and friction values are nominal. The terms of `friction`, `spring`,
    `parallel_spring` and `joint_friction` are in `seaid.drives.terms`; `motor_input`,
    `known`, `nominal` and `transmission` as in `StiffDrive`.
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
    spring: tuple[str, ...] = ("linear",)
    parallel_spring: tuple[str, ...] = ()
    joint_friction: tuple[str, ...] = ()
    motor_input: str = "torque"
    known: tuple[str, ...] = ()
    nominal: Mapping[str, float] = _NOTHING
    transmission: Mapping[str, float] = _NOTHING

    def __post_init__(self) -> None:
        check_numbers(self)
        check_terms(self)
        check_spring(self)
        check_values(self)

    @property
    def is_linear_spring(self) -> bool:
        """True for a spring that is pulled [N/m], False for one that is twisted [N m/rad]."""
        return self.motor_pulley_radius_m is not None

    @property
    def knows_zero(self) -> bool:
        """True for a spring whose force is no straight line, so that its zero can be found."""
        return any(term in NON_LINEAR_SPRING for term in self.spring)

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

    @property
    def spring_units(self) -> tuple[str, str]:
        """Units of what the spring transmits and of its deflection: N and m, or N m and rad."""
        return ("N", "m") if self.is_linear_spring else ("N m", "rad")

    @property
    def joint_units(self) -> tuple[str, str]:
        """Units of what acts on the joint and of its coordinate: N m and rad, or N and m."""
        slides = self.is_linear_spring and self.load_pulley_radius_m is None
        return ("N", "m") if slides else ("N m", "rad")

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all parameters that its terms have, known ones too, in the order of columns."""
        extra = ("deflection_zero",) if self.knows_zero else ("spring_offset",)
        return parameter_names(self, tuple(PARAMETERS_OF), extra)

    @property
    def values(self) -> Mapping[str, float]:
        """{parameter: known or nominal value} of all that have one."""
        return values_of(self)

    def with_values(self, values: Mapping[str, float]) -> SeriesElasticDrive:
        """Return the drive with values of some parameters."""
        return with_values(self, values)

    def without_nominal(self) -> SeriesElasticDrive:
        """Return the drive with known values only: no stiffness, no friction."""
        return without_nominal(self)


Drive = StiffDrive | SeriesElasticDrive

IDEAL_DRIVE = StiffDrive(gear_ratio=1.0, motor_inertia_kg_m2=0.0, friction=())
"""The drive of a joint that has none in the description: its torque is known at the joint."""
