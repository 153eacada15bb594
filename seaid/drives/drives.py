"""The drive of one joint as data, stiff or series elastic, checked when it is created.

Friction and rotor inertia are at the motor. A field that is None is unknown. Known values (ratio,
radii, rotor inertia, the parameters in `known`) enter the equations; nominal values (all others)
serve only simulation, planning and as initial values of an identification.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from dataclasses import field as entry
from functools import cache, cached_property, partial
from itertools import product
from typing import Any, ClassVar, Self, get_args

import numpy as np

from seaid._arrays import Array, FrozenMapping
from seaid._progress import Display
from seaid.drives.angle_ratio import AngleRatio
from seaid.drives.controller import DELAY_PARAMETER, NORMAL_95, Controller, signed_number
from seaid.drives.terms import (
    BY_TEMPERATURE,
    COMMANDS,
    COULOMB,
    DEAD_ZONES,
    DRY,
    FIELDS,
    NONLINEAR_SPRING,
    PARAMETERS,
    PARAMETERS_OF,
    WARM_UP,
    Harmonic,
    MotorInput,
    between_encoders,
    harmonics_of,
    is_transmission_error,
    key_of,
    parameter_named,
    spring_parameters,
)
from seaid.errors import RobotError, check_name, shortened, shown


class DefaultTerms(tuple[str, ...]):
    """Friction terms that nobody named: `identify` adds those that the data support."""


def unit_of(drive: Drive, name: str) -> str:
    """Return the unit of a parameter of a drive."""
    return parameter_named(name).unit_for(drive.spring_units, drive.joint_units)


def is_smooth(drive: Drive) -> bool:
    """Whether the drive's friction is a continuous function of speed, also at a reversal."""
    return bool({*COULOMB[1:]} & set(drive.friction))


def is_dry(drive: Drive) -> bool:
    """Whether the drive has friction whose direction is unknown at standstill."""
    return bool(set(DRY) & set(drive.friction)) and not is_smooth(drive)


def term_fields(drive: Drive | type[Drive]) -> tuple[str, ...]:
    """Return the fields that name terms of a drive: a stiff one has no spring."""
    return tuple(field.name for field in fields(drive) if field.name in PARAMETERS_OF)


def _field_of(drive: Any, name: str) -> str | None:
    """Return the field with the value of a parameter, None if its value is in `nominal`."""
    key = _key(name, drive.spring_units, drive.joint_units)
    return key if hasattr(drive, key) else None


@cache
def _key(name: str, spring: tuple[str, str], joint: tuple[str, str]) -> str:
    return key_of(name, parameter_named(name).unit_for(spring, joint))


_LEAST_DIVISOR = 1e-12
"""Least value of a parameter, in its unit, by which an equation of a drive is divided."""


def check_divisors(drive: Drive, values: Mapping[str, float]) -> None:
    """Raise RobotError if a parameter by which an equation of the drive divides is zero."""
    for name in drive.parameter_names:
        if parameter_named(name).is_divisor and values.get(name, 1.0) < _LEAST_DIVISOR:
            raise RobotError(
                f"'{key_of(name, unit_of(drive, name))}' is {values[name]:g}, and the drive's "
                "equation is divided by it: give a value above zero, or remove its term"
            )


_LENGTHS = ("gear_ratio", "motor_pulley_radius", "load_pulley_radius", "transmission")
_LENGTH_SIZES, _SIZES = (1e-9, 1e9), (0.0, 1e30)
"""Limits that keep products and powers in the equations finite; real drives are far inside."""

_MOST_EXTRA_TERMS = 20
"""Terms that a user may add to a drive, each a text that is checked and differentiated."""

_LEAST = {
    **dict.fromkeys(("motor_inertia_kg_m2", "coulomb_friction_Nm"), "zero or more"),
    "viscous_friction_Nms_per_rad": "zero or more",
    **dict.fromkeys(("command_delay_s", "reference_position_rad"), "a number"),
    "reference_temperature_degC": "a number",
}
"""{field: what its number must be}; those of other fields are more than zero."""


def _number(name: str, value: Any, least: str = "") -> Any:
    """Return a number of the right sign and size. Raises RobotError for others."""
    size = signed_number(name, value, least or _LEAST.get(name, "more than zero"))
    least_size, most = _LENGTH_SIZES if name.startswith(_LENGTHS) else _SIZES
    if size and not least_size <= abs(size) <= most:
        raise RobotError(
            f"{name} must be from {least_size:g} to {most:g} in size, found {size:g}: check its "
            "unit"
        )
    return value


def _names(field: str, names: Any) -> tuple[str, ...]:
    """Return names that are allowed and there once. Raises RobotError for others."""
    if not (isinstance(names, list | tuple) and all(isinstance(name, str) for name in names)):
        raise RobotError(f"{field} must be a list of texts, found {shown(names)}")
    if len(set(names)) < len(names):
        raise RobotError(f"{field} names a term twice: {shortened(', '.join(names))}")
    for name in names:
        allowed = PARAMETERS_OF.get(field, names)
        check_name(f"{field.replace('_', ' ')} term", name, allowed, RobotError)
    return names if isinstance(names, DefaultTerms) else tuple(names)


def _numbers(field: str, table: Any) -> FrozenMapping[float]:
    """Return a table of numbers. Raises RobotError for others."""
    if not isinstance(table, Mapping):
        raise RobotError(f"{field} must be a table of numbers, found {shown(table)}")
    for name, value in table.items():
        _number(f"{field} '{shortened(name)}'", value, "a number")
    return FrozenMapping(table)


def _factors(field: str, table: Any) -> FrozenMapping[float]:
    """Return the factors of a transmission. Raises RobotError for a ratio in their place."""
    if isinstance(table, Mapping) and isinstance(table.get("ratio"), str):
        raise RobotError(
            f"{field} has a factor for each joint, {{ hip = 1.0, knee = 1.0 }}, found "
            f"{shown(table)}; a ratio that depends on the angle of the joint is angle_ratio = "
            "{ cos = [c_1], sin = [s_1] }, or a table { angle_rad = [...], ratio = [...] }"
        )
    return _numbers(field, table)


def _record(kind: type[Controller] | type[AngleRatio], field: str, value: Any) -> Any:
    """Return the record of a table. Raises RobotError for what is none."""
    if isinstance(value, kind):
        return value
    if not isinstance(value, Mapping):
        raise RobotError(f"{field} must be a table of its values, found {shown(value)}")
    for key in value:
        check_name("key", key, [x.name for x in fields(kind)], RobotError, field)
    return kind(**value)


def _motor_input(_: str, value: Any) -> Any:
    check_name("motor input", value, get_args(MotorInput), RobotError)
    return value


def _group(field: str, value: Any) -> str:
    if isinstance(value, str):
        return value
    raise RobotError(
        f"{field} must be the name of a group of drives, such as 'calf_motor', found {shown(value)}"
    )


_READERS: Mapping[str, Callable[[str, Any], Any]] = {
    **dict.fromkeys(PARAMETERS_OF, _names),
    **dict.fromkeys(("known", "extra_terms"), _names),
    **dict.fromkeys(("nominal", "std"), _numbers),
    "transmission": _factors,
    **dict.fromkeys(FIELDS, harmonics_of),
    "motor_input": _motor_input,
    "controller": partial(_record, Controller),
    "angle_ratio": partial(_record, AngleRatio),
    "shared": _group,
}
"""{field: what checks its value and returns it as the type of the field}; others are numbers."""

_GAIN_OF = {
    "position_command": "position_gain_Nm_per_rad",
    "velocity_command": "command_velocity_gain_Nms_per_rad",
}
"""{motor input: gain of the controller on these commands}."""


def _faults(drive: Drive) -> Iterator[str]:
    """Yield what does not fit together in a drive."""
    yield from _controller_faults(drive)
    if len(drive.extra_terms) > _MOST_EXTRA_TERMS:
        yield f"extra_terms has {len(drive.extra_terms)} terms, allowed are {_MOST_EXTRA_TERMS}"
    for field, alike in (("friction", COULOMB), ("spring", DEAD_ZONES)):
        terms = [term for term in getattr(drive, field) if term in alike]
        if len(terms) > 1:
            yield f"{field} may have one of {', '.join(alike)}, found {', '.join(terms)}"
    for field in ("transmission", "parallel_spring", "joint_friction"):
        if drive.angle_ratio is not None and getattr(drive, field):
            yield (
                f"a drive with angle_ratio has no {field}: seaid has all that is in the table of "
                "such a drive at the angle behind the gear, and not at that of the joint"
            )
    yield from _spring_faults(drive) if drive.is_elastic else _stiff_faults(drive)
    yield from _harmonic_faults(drive)


def _controller_faults(drive: Drive) -> Iterator[str]:
    law, kind = drive.controller, drive.motor_input
    needed = _GAIN_OF.get(kind, "")
    both = f'motor_input = "{" or ".join(COMMANDS)}" and a controller go together: '
    if law is None:
        if needed:
            yield f"{both}give its gains in the table 'controller'"
    elif not needed:
        yield f"{both}found a controller and the motor input '{kind}'"
    elif not getattr(law, needed):
        yield (
            f'controller: {needed} is missing or zero, which motor_input = "{kind}" needs; '
            '"velocity_command" takes velocity commands alone, "position_command" both kinds'
        )
    elif kind == "velocity_command" and law.position_gain_Nm_per_rad:
        yield (
            'controller: found position_gain_Nm_per_rad with motor_input = "velocity_command": '
            'write "position_command", which takes velocity commands too, or a gain of zero'
        )


def _stiff_faults(drive: Any) -> Iterator[str]:
    if drive.gear_ratio is not None and drive.gear_ratio_rad_per_m is not None:
        yield (
            "a stiff drive has gear_ratio (turning joint) or gear_ratio_rad_per_m (prismatic "
            "joint), found both"
        )


def _spring_faults(drive: Any) -> Iterator[str]:
    if "offset" in drive.friction:
        yield "an elastic drive has no friction offset: its constant column is the spring offset"
    if drive.load_pulley_radius_m is not None and drive.motor_pulley_radius_m is None:
        yield (
            "a series elastic drive with load_pulley_radius_m needs motor_pulley_radius_m too "
            "(give neither for a rotary spring)"
        )
    keys = ["stiffness_Nm_per_rad", "stiffness_N_per_m"]
    right, wrong = reversed(keys) if drive.is_linear_spring else keys
    if getattr(drive, wrong) is not None:
        kind = "linear (pulley radii" if drive.is_linear_spring else "rotary (pulley radii not"
        yield f"found {wrong}, but the spring is {kind} given): use {right}"
    if {"linear", "cubic", "fifth"}.isdisjoint(drive.spring):
        found = ", ".join(drive.spring) or "none"
        yield f"spring needs a stiffness term, 'linear', 'cubic' or 'fifth', found {found}"


def _harmonic_faults(drive: Drive) -> Iterator[str]:
    if drive.transmission_error and drive.is_nonlinear_spring:
        yield (
            "a transmission error needs a linear spring, whose force is linear in its amplitudes; "
            f"found {', '.join(drive.spring)}"
        )
    if any(map(is_transmission_error, drive.known)) and "stiffness" not in drive.known:
        yield "a known transmission error needs a known stiffness: the equation has their product"
    if "m" in drive.joint_units and any(harmonic.angle == "joint" for harmonic in drive.harmonics):
        yield (
            "an error that is periodic in the joint needs a joint that turns; use 'motor' or 'mesh'"
        )


def _check_values(drive: Drive) -> None:
    """Check that `nominal`, `known` and `std` fit the drive's terms. Raises RobotError."""
    names = drive.parameter_names
    for name, value in drive.nominal.items():
        check_name("nominal parameter", name, {*PARAMETERS, *names}, RobotError)
        if (field := _field_of(drive, name)) is not None:
            raise RobotError(f"nominal has '{name}': give it as {field}")
        if name not in names:
            raise RobotError(f"found a value of '{name}', but the drive lacks {_term_with(name)}")
        if parameter_named(name).is_positive:
            _number(f"nominal '{name}'", value, "zero or more")
    for name in drive.known:
        check_name("known parameter", name, names, RobotError)
        if name not in drive.values:
            raise RobotError(f"known names '{name}', but it has no value")
    _check_std(drive)


def _check_std(drive: Drive) -> None:
    constants = [name for name in CONSTANTS if getattr(drive, name, None) is not None]
    if drive.controller is not None and drive.command_delay_s is None:
        constants.append("command_delay_s")  # of an unknown delay, about zero
    for name, value in drive.std.items():
        check_name("constant", name, (STD_OF_TORQUE, *constants), RobotError)
        # A delay may be zero; of any other constant nothing would be known beyond its value.
        size = abs(getattr(drive, name, None) or 0.0)
        most = {STD_OF_TORQUE: 1.0, "command_delay_s": _SIZES[1]}.get(name, size)
        signed_number(f"standard deviation of '{name}'", value, "more than zero", most)


def _term_with(name: str) -> str:
    """Return the description of the term that has a parameter."""
    if name == "gain_scale":
        return "a controller with is_up_to_scale = true, of which it is the scale"
    for field, terms in PARAMETERS_OF.items():
        for term, names in terms.items():
            if name in names:
                return f"the term '{term}' of {field}"
    return "a nonlinear spring, of which it is the zero"


STD_OF_TORQUE = "torque_scale"
"""Name in `std` of the relative standard deviation of a drive's torque, current or voltage."""

CONSTANTS = (
    "gear_ratio",
    "gear_ratio_rad_per_m",
    "motor_inertia_kg_m2",
    "motor_pulley_radius_m",
    "load_pulley_radius_m",
    "command_delay_s",
)
"""Constants that may have a standard deviation in `std`."""

_PLAIN_FRICTION: tuple[str, ...] = DefaultTerms(("viscous", "coulomb"))
_NOTHING: Mapping[str, float] = FrozenMapping({})
_CHANGING = frozenset({*BY_TEMPERATURE, *WARM_UP})


@dataclass(frozen=True, kw_only=True, repr=False)
class _Parameters(Display):
    """The fields of both drives, and their parameters by name, wherever the values are stored."""

    friction: tuple[str, ...] = _PLAIN_FRICTION
    extra_terms: tuple[str, ...] = ()
    parallel_spring: tuple[str, ...] = ()
    motor_input: MotorInput = "torque"
    controller: Controller | None = None
    command_delay_s: float | None = None
    known: tuple[str, ...] = ()
    nominal: Mapping[str, float] = entry(default=_NOTHING, hash=False)
    transmission: Mapping[str, float] = entry(default=_NOTHING, hash=False)
    angle_ratio: AngleRatio | None = None
    reference_temperature_degC: float = 25.0
    reference_position_rad: float = 0.0
    torque_ripple: Mapping[str, Any] | tuple[Harmonic, ...] = ()
    std: Mapping[str, float] = entry(default=_NOTHING, hash=False)
    shared: str = ""
    is_elastic: ClassVar[bool] = False

    def __post_init__(self: Any) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None or field.default is not None:
                read = _READERS.get(field.name, _number)
                object.__setattr__(self, field.name, read(field.name, value))
        for fault in _faults(self):
            raise RobotError(fault)
        _check_values(self)

    @property
    def is_up_to_scale(self) -> bool:
        """Whether the gains of the controller are known up to scale only."""
        return self.controller is not None and self.controller.is_up_to_scale

    @property
    def scale_of_gains(self) -> float:
        """The scale of the gains of the controller, known or nominal: 1 for gains in N m."""
        return self.values.get("gain_scale", 1.0) if self.is_up_to_scale else 1.0

    @property
    def law(self) -> Controller | None:
        """The controller with its gains in N m: times their scale, if they are known up to it."""
        if self.controller is None or not self.is_up_to_scale:
            return self.controller
        return self.controller.times(self.scale_of_gains)

    @property
    def harmonics(self) -> tuple[Harmonic, ...]:
        """The periodic errors of gear and motor torque."""
        return tuple(harmonic for field in FIELDS for harmonic in getattr(self, field))

    def without_harmonics(self) -> Self:
        """Return the drive without periodic errors."""
        empty: dict[str, Any] = {field: () for field in FIELDS if getattr(self, field)}
        return self.with_terms(**empty) if empty else self

    def without_memory(self) -> Self:
        """Return the drive with sharp Coulomb friction, and a spring without hysteresis."""
        if "dahl" not in (*self.friction, *self.spring):  # type: ignore[attr-defined]
            return self
        bare: Any = {"friction": tuple("coulomb" if x == "dahl" else x for x in self.friction)}
        if self.is_elastic:
            bare["spring"] = tuple(x for x in self.spring if x != "dahl")  # type: ignore[attr-defined]
        return self.with_terms(**bare)

    def with_terms(self, **terms: Any) -> Self:
        """Return the drive with other terms, and without the parameters that these do not have."""
        bare = replace(self, nominal={}, known=(), **terms)
        names = bare.parameter_names
        nominal = {name: value for name, value in self.nominal.items() if name in names}
        return replace(bare, nominal=nominal, known=tuple(x for x in self.known if x in names))

    @property
    def is_nonlinear_spring(self: Any) -> bool:
        """True if the spring force is nonlinear, so that the zero of the deflection matters."""
        return any(term in NONLINEAR_SPRING for term in self.spring)

    @property
    def gear_compliance(self: Any) -> float:
        """Deflection between the encoders by the gear, per force of the spring; 0 if rigid."""
        stiffness = self.gear_stiffness_Nm_per_rad
        # Under the force F the gear winds up by r_M F / k_G, which is r_M times that as deflection.
        return 0.0 if stiffness is None else self.motor_radius**2 / stiffness

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all parameters of the drive's terms, known ones too, in the order of columns."""
        names = {"motor_inertia"}
        if self.is_elastic:
            names.add("deflection_zero" if self.is_nonlinear_spring else "spring_offset")
        for field in PARAMETERS_OF:
            terms = getattr(self, field)
            for term in (terms,) if isinstance(terms, str) else terms:
                names.update(PARAMETERS_OF[field][term])
        if not self.is_up_to_scale:
            names.discard("gain_scale")
        return (*(name for name in PARAMETERS if name in names), *self._amplitudes)

    @cached_property
    def own_values(self) -> Mapping[str, float]:
        """{parameter: known or nominal value} of all parameters that have one, as in the TOML."""
        values: dict[str, float] = {}
        for name in (*PARAMETERS, *self._amplitudes):
            field = _field_of(self, name)
            value = self.nominal.get(name) if field is None else getattr(self, field)
            if value is not None:
                values[name] = float(value)
        return FrozenMapping(values)

    @cached_property
    def values(self) -> Mapping[str, float]:
        """`own_values` as the equations have them.

        The stiffness is that between the encoders, and unknown periodic errors are zero.
        """
        values = between_encoders(self.own_values, self.gear_compliance)
        return FrozenMapping(dict.fromkeys(self._amplitudes, 0.0) | values)

    @property
    def _amplitudes(self) -> list[str]:
        return [name for harmonic in self.harmonics for name in harmonic.names]

    @property
    def has_temperature_terms(self) -> bool:
        """Whether the friction depends on the temperature of the motor."""
        return bool({*BY_TEMPERATURE} & {*self.friction})

    def at_temperature(self, temperature_degC: float | None = None) -> Self:
        """Return the drive with the friction of one temperature; None: that of reference.

        Friction that a motor loses while it warms up is none of its.
        """
        if _CHANGING.isdisjoint(self.friction):
            return self
        values, warmer = self.own_values, 0.0
        if temperature_degC is not None:
            warmer = temperature_degC - self.reference_temperature_degC
        slopes = {PARAMETERS_OF["friction"][term][0]: x for term, x in BY_TEMPERATURE.items()}
        levels = {
            level: max(values[level] + warmer * values.get(slope, 0.0), 0.0)
            for slope, level in slopes.items()
            if level in values
        }
        kept = tuple(term for term in self.friction if term not in _CHANGING)
        bare = self.with_terms(friction=kept)
        return bare.with_values(levels) if warmer else bare

    def with_values(self, values: Mapping[str, float]) -> Self:
        """Return the drive with new `values` {parameter: value}, stored in fields or `nominal`."""
        changes: dict[str, Any] = {}
        nominal = dict(self.nominal)
        if self.gear_compliance or self.harmonics:
            # New values are between the encoders, as in the equations; fields are of the spring.
            values = spring_parameters({**self.values, **values}, self.gear_compliance)
        for name, value in values.items():
            field = _field_of(self, name)
            if field is None:
                nominal[name] = float(value)
            else:
                changes[field] = float(value)
        return replace(self, nominal=nominal, **changes)

    def without_nominal(self) -> Self:
        """Return the drive with known values only: no stiffness, no friction."""
        kept = {"motor_inertia", *self.known}
        others = (_field_of(self, name) for name in PARAMETERS if name not in kept)
        changes: dict[str, Any] = {field: None for field in others if field is not None}
        nominal = {name: value for name, value in self.nominal.items() if name in kept}
        return replace(self, nominal=nominal, **changes)


@dataclass(frozen=True, repr=False)
class StiffDrive(_Parameters):
    """A motor behind a stiff gear: joint torque = N (tau_M - I_M theta_M'' - friction).

    Parameters
    ----------
    gear_ratio : float, optional
        N, motor angle per joint angle [1], of a revolute joint; 1 if neither ratio is given.
    gear_ratio_rad_per_m : float, optional
        Motor angle per joint position [rad/m], of a prismatic joint.
    motor_inertia_kg_m2 : float, optional
        Rotor inertia I_M [kg m^2], a known value; None: unknown, to be identified.
    viscous_friction_Nms_per_rad, coulomb_friction_Nm : float, optional
        Nominal friction at the motor.
    friction, parallel_spring : tuple of str
        Terms of the motor's friction and of a spring parallel to the drive, see
        `seaid.drives.terms`. Their parameters are identified.
    extra_terms : tuple of str
        Further torques [N m] at the motor as text, such as "c*theta_M_dot**3", see
        `seaid.drives.equations.extra_terms`.
    motor_input : {"torque", "current", "voltage", "position_command", "velocity_command"}
        The logged quantity of the motor.
    controller : Controller, optional
        The controller of a drive whose commanded position or velocity was logged.
    command_delay_s : float, optional
        Nominal delay [s] of the command; negative where the positions are logged late.
    known : tuple of str
        Parameters whose values are known and not identified.
    nominal : mapping {parameter: value}
        Nominal values of all parameters without a field of their own, in SI units.
    transmission : mapping {joint: factor}
        The drive turns the sum of factor * q instead of its own joint (a differential, a
        parallelogram), see `seaid.robot.transmission`.
    angle_ratio : AngleRatio, optional
        The ratio over `gear_ratio` where it depends on the angle of the joint (a four-bar, a cam):
        {"cos": [c_1, ...], "sin": [s_1, ...]}, or a table {"angle_rad": [...], "ratio": [...]}.
    reference_temperature_degC : float
        Temperature of the motor at which friction has its stated values, 25 degC, if it has the
        terms "viscous_temperature" or "coulomb_temperature".
    reference_position_rad : float
        Position of the joint [rad, or m] at which Coulomb friction has its stated value, if it has
        the term "coulomb_position".
    torque_ripple : mapping {angle: orders}
        Periodic torque of the motor: orders of "motor", "joint" or "mesh", such as
        {"motor": [6]}; its amplitudes are parameters, such as "torque_ripple_motor_6_cos".
    std : mapping {constant: standard deviation}
        Of the constants above, in their units, and of "torque_scale" (relative), for `identify`.
    shared : str
        Group of drives with one motor type, whose parameters are estimated as the same ones.

    Raises
    ------
    RobotError
        For values, terms or names that do not fit together.

    Examples
    --------
    >>> StiffDrive(gear_ratio=100.0, motor_inertia_kg_m2=1e-5, friction=("viscous", "coulomb"))
    """

    gear_ratio: float | None = None
    gear_ratio_rad_per_m: float | None = None
    motor_inertia_kg_m2: float | None = None
    viscous_friction_Nms_per_rad: float | None = None
    coulomb_friction_Nm: float | None = None
    spring: ClassVar[tuple[str, ...]] = ()
    transmission_error: ClassVar[tuple[Harmonic, ...]] = ()
    joint_friction: ClassVar[tuple[str, ...]] = ()
    gear_stiffness_Nm_per_rad: ClassVar[float | None] = None
    motor_radius: ClassVar[float] = 1.0
    load_radius: ClassVar[float] = 1.0

    @property
    def ratio(self) -> float:
        """Motor angle per joint coordinate, rad/rad or rad/m; 1 if none is given."""
        return self.gear_ratio or self.gear_ratio_rad_per_m or 1.0

    @property
    def joint_units(self) -> tuple[str, str]:
        """Units of joint torque (or force) and coordinate: N m and rad, or N and m."""
        return ("N m", "rad") if self.gear_ratio_rad_per_m is None else ("N", "m")

    @property
    def spring_units(self) -> tuple[str, str]:
        """Those of the joint: a stiff drive has no spring."""
        return self.joint_units


@dataclass(frozen=True, repr=False)
class SeriesElasticDrive(_Parameters):
    """A motor with gear, and a spring between two pulleys (Fig. 1 of the paper).

    Parameters
    ----------
    gear_ratio : float
        N, motor turns per turn behind the gear.
    motor_pulley_radius_m, load_pulley_radius_m : float, optional
        r_M and r_L of (3) and (4). Both: a linear spring. None: a rotary spring behind the gear,
        the same equations with both radii 1. r_M alone: a linear spring at a prismatic joint.
    stiffness_N_per_m, stiffness_Nm_per_rad : float, optional
        Nominal stiffness k, of a linear or of a rotary spring: of the spring alone if
        `gear_stiffness_Nm_per_rad` is given, else between the two encoders.
    gear_stiffness_Nm_per_rad : float, optional
        Torsional stiffness of the gear at its output, a known value; None: not known, or rigid.
    spring : tuple of str
        Terms of the spring force, see `seaid.drives.terms`.
    joint_friction : tuple of str
        Terms of the friction between the joint's two bodies, behind the spring.
    transmission_error : mapping {angle: orders}
        Periodic error of the gear in the deflection, as `torque_ripple`.
    others
        As in `StiffDrive`.

    Raises
    ------
    RobotError
        For values, terms or names that do not fit together.

    Examples
    --------
    >>> SeriesElasticDrive(gear_ratio=100.0, stiffness_Nm_per_rad=300.0)
    """

    gear_ratio: float
    motor_inertia_kg_m2: float | None = None
    motor_pulley_radius_m: float | None = None
    load_pulley_radius_m: float | None = None
    stiffness_N_per_m: float | None = None
    stiffness_Nm_per_rad: float | None = None
    gear_stiffness_Nm_per_rad: float | None = None
    viscous_friction_Nms_per_rad: float | None = None
    coulomb_friction_Nm: float | None = None
    spring: tuple[str, ...] = ("linear",)
    joint_friction: tuple[str, ...] = ()
    transmission_error: Mapping[str, Any] | tuple[Harmonic, ...] = ()
    is_elastic: ClassVar[bool] = True

    @property
    def is_linear_spring(self) -> bool:
        """True for a spring in tension [N/m], False for one in torsion [N m/rad]."""
        return self.motor_pulley_radius_m is not None

    @property
    def ratio(self) -> float:
        """Gear ratio N, motor turns per turn behind the gear."""
        return self.gear_ratio

    @property
    def motor_radius(self) -> float:
        """r_M of (7) [m]; 1 for a rotary spring."""
        return self.motor_pulley_radius_m or 1.0

    @property
    def load_radius(self) -> float:
        """r_L of (8) [m]; 1 for a rotary spring and for a prismatic joint."""
        return self.load_pulley_radius_m or 1.0

    @property
    def spring_units(self) -> tuple[str, str]:
        """Units of spring force (or torque) and deflection: N and m, or N m and rad."""
        return ("N", "m") if self.is_linear_spring else ("N m", "rad")

    @property
    def joint_units(self) -> tuple[str, str]:
        """Units of joint torque (or force) and coordinate: N m and rad, or N and m."""
        slides = self.is_linear_spring and self.load_pulley_radius_m is None
        return ("N", "m") if slides else ("N m", "rad")


Drive = StiffDrive | SeriesElasticDrive


def total_ratio(drive: Drive) -> float:
    """Return N r_L / r_M, motor angle per position of the joint with a rigid spring."""
    return float(drive.ratio * drive.load_radius / drive.motor_radius)


def deflection(drive: Drive, motor: Array, joint: Array) -> Array:
    """Return the deflection d = r_M/N theta_M - r_L theta_L of (3) from the two positions."""
    return np.asarray(drive.motor_radius / drive.ratio * motor - drive.load_radius * joint)


IDEAL_DRIVE = StiffDrive(gear_ratio=1.0, motor_inertia_kg_m2=0.0, friction=())
"""The drive of a joint without a drive in the description: its torque is known at the joint."""


# What drives share: one delay of commands on each bus, one value in each group of one type

STATED_DELAY_S = 12.5e-3
"""An unknown delay [s] of commands is within this of its nominal value, with 95 %, if the drive
states no standard deviation: two or three samples of a bus at 200 Hz."""


def stated_delay_s(drive: Drive) -> float:
    """Return within what a delay is of its nominal value [s], with 95 %; 0 if exactly known."""
    known = drive.controller is None or "command_delay" in drive.known
    std = drive.std.get("command_delay_s")
    return (0.0 if known else STATED_DELAY_S) if std is None else NORMAL_95 * std


# A motor, its gear and its spring have parameters by their type, which drives of a group share; a
# joint has its own by its mounting: zeros of encoders, offsets of torques, levels over positions.
SHARED = frozenset(PARAMETERS) - {
    *("friction_offset", "coulomb_position_slope", "coulomb_position_curvature"),
    *("spring_offset", "deflection_zero", DELAY_PARAMETER),
    *("parallel_stiffness", "parallel_preload", "joint_viscous_friction", "joint_coulomb_friction"),
}
"""Parameters that the drives of a group share; drives of one bus have one delay anyway."""


def groups_of(drives: Mapping[str, Drive]) -> dict[str, list[str]]:
    """Return {group: its joints} of drives."""
    names = dict.fromkeys(drive.shared for drive in drives.values() if drive.shared)
    return {name: [joint for joint, x in drives.items() if x.shared == name] for name in names}


def check_groups(drives: Mapping[str, Drive], where: str, is_whole: bool = True) -> None:
    """Raise RobotError for groups whose drives cannot share their parameters.

    Where the drives are not the whole robot, a group may be that of one of them.
    """
    for group, joints in groups_of(drives).items():
        if is_whole and len(joints) == 1:
            raise RobotError(
                f"{where}: [{joints[0]}] is alone in the group '{group}': write shared = '{group}' "
                "at the other joints with this motor too, or remove it"
            )
        first, *others = ((joint, _kind(drives[joint])) for joint in joints)
        for searched in first[1]["searched parameters"]:
            raise RobotError(
                f"{where}: [{joints[0]}] shares '{group}', and its equation is nonlinear in the "
                f"unknown {searched}, where only linear parameters are shared: give its value "
                f"(known = ['{searched}']), or remove its term or the group"
            )
        for (joint, kind), what in product(others, first[1]):
            if kind[what] != first[1][what]:
                raise RobotError(
                    f"{where}: [{joints[0]}] and [{joint}] share '{group}' and differ in {what}, "
                    f"{shown(first[1][what])} and {shown(kind[what])}: correct one of them, or "
                    "give them groups of their own"
                )


def _kind(drive: Drive) -> dict[str, Any]:
    """Return in what the drives of a group are alike."""
    known = {name: drive.own_values[name] for name in drive.known if name in SHARED}
    names = [name for name in drive.parameter_names if name in SHARED and name not in known]
    return {
        "type": "series_elastic" if drive.is_elastic else "stiff",
        "unit of the spring": drive.spring_units[0] if drive.is_elastic else "",
        "motor_input": drive.motor_input,
        "known parameters": known | {"motor_inertia": drive.motor_inertia_kg_m2},
        "motor_inertia_kg_m2_std": drive.std.get("motor_inertia_kg_m2", 0.0),
        "unknown parameters": names,
        "searched parameters": [name for name in names if PARAMETERS[name].starts],
    }
