"""The drivetrain of one joint as data: stiff, or series elastic.

Friction and rotor inertia are at the motor. What a drive leaves at None is not known: known values
(ratio, radii, rotor inertia, what `known` names) enter the equations, nominal ones (stiffness,
friction, all others) only serve simulation, planning and as a start of a search.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from seaid.arrays import FrozenMapping
from seaid.drivetrain.catalogue import FRICTION_TERMS, NON_LINEAR_SPRING, PARAMETERS_OF
from seaid.drivetrain.checks import check_numbers, check_spring, check_terms, check_values
from seaid.drivetrain.values import parameter_names, values_of, with_values, without_nominal
from seaid.errors import RobotError

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
    friction, all to be identified, see `seaid.drivetrain.catalogue`; friction values are nominal.
    `extra_terms` are expressions added to the motor's equation, see `seaid.drivetrain.equations`.

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
    `parallel_spring` and `joint_friction` are in `seaid.drivetrain.catalogue`; `motor_input`,
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
        extra = ("deflection_zero",) if self.knows_zero else ("deflection_offset",)
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
