"""What a drive may be: its numbers, its terms and their values, checked where it is made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from seaid.arrays import FrozenMapping, number
from seaid.drivetrain.catalogue import COULOMB, MOTOR_INPUTS, PARAMETERS, PARAMETERS_OF
from seaid.drivetrain.values import field_of
from seaid.errors import RobotError, shortened, shown, unknown_name

if TYPE_CHECKING:
    from seaid.drivetrain.model import Drive, SeriesElasticDrive

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
