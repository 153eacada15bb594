"""The catalogue of a drive's terms, and of their parameters: names, units, keys of the TOML.

`friction` of the motor, with motor speed w:

- viscous F_v w, quadratic F_q w |w|, asymmetric F_a |w| (differs between the directions);
- coulomb F_C sign(w); or smooth_coulomb F_C tanh(w / w_C) of width w_C; or shifted_coulomb
  F_C tanh((w - w_0) / w_C), zero at the speed w_0 (Gaz et al. 2019). The smooth ones are known at
  standstill too, and their tanh replaces sign(w) in the next two terms;
- or dahl F_C z: presliding, with a state z that follows the motor's travel over the
  angle w_M, see `seaid.drives.equations`; z replaces sign(w) in the next two terms, too;
- stribeck F_S exp(-(w / w_S)^2) sign(w), static friction above the sliding one;
- load F_L |torque through the gear| sign(w): the spring's torque, or the load of a stiff drive;
- coulomb_position (F_x x + F_xx x^2) sign(w), with the position x of the joint from the drive's
  reference position: a level that changes over the range of the joint;
- viscous_temperature F_vT dT w and coulomb_temperature F_CT dT sign(w): what viscous and Coulomb
  friction grow by, per kelvin that the motor is warmer than the drive's reference temperature;
- viscous_warm_up F_vW exp(-t / t_W) w and coulomb_warm_up F_CW exp(-t / t_W) sign(w): what a cold
  motor has in addition, which is lost over the time t since the start of its log;
- offset F_0, a constant torque that makes Coulomb friction differ between the directions. Stiff
  drives only: the spring offset of an elastic one is the same column.

`spring`, with deflection d: linear k d, cubic k_3 d^3, fifth k_5 d^5; dead_zone subtracts a half
width g from |d| (backlash), smooth_dead_zone with corners that are round over w_g; damping c_k d'
parallel to the spring; dahl F_H z, hysteresis whose state z follows the deflection
over w_H; preload a constant force f_0.
A nonlinear spring has the unknown zero of its deflection, `deflection_zero`; a linear one has a
force at zero measured deflection instead, `spring_offset`, which contains its preload.

Between the joint's two bodies: `parallel_spring` linear k_P q and preload tau_P; `joint_friction`
viscous b_L q' and coulomb c_L sign(q').

`motor_input`, the logged quantity: torque; current, with torque = torque constant * current;
voltage, with torque = voltage constant * voltage (the viscous friction then contains the back-EMF).
The constants are unknown parameters. With position_command and velocity_command the drive's
`controller` gives the torque. Its commands (u of the position, w of the velocity, f of the torque)
give the part tau_C = (K_p u + K_v w + f) / N of the motor torque tau_M, and act after the unknown
delay T_C: to first order the torque is tau_M - T_C tau_C'. Where the gains are known up to scale,
it is this times the gain scale s_K, an unknown parameter.

Periodic errors: the transmission error of the gear [rad, or m of a linear spring] adds to the
deflection that the encoders show; the spring force sees k times that, which is linear in its
amplitudes. Ripple is a torque of the motor [N m]. An error of order n has the two amplitudes of
cos(n x) and sin(n x). Its angle x is that of

- "motor": theta_M, once per turn of the motor (eccentricity, cogging, poles);
- "joint": theta_L, once per turn of the joint (the joint's encoder, the last wheel);
- "mesh": theta_M - theta_M/N, the motor relative to the output of its gear (strain-wave gears: 2).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from seaid.errors import RobotError, check_name, shown


@dataclass(frozen=True)
class Parameter:
    """A parameter of a drive: its symbol and unit, and whether it cannot be negative.

    In `unit`, F and L are force and length of the spring (N and m, or N m and rad), P and Q those
    of the joint. A parameter in which the equations are nonlinear has `starts`, the values from
    which its search starts. They are multiples of a size of the data: of the largest motor speed
    (rad/s), of the duration of the longest log (s), or of half the range of the motor angle (rad)
    or of the deflection (L). The equations are divided by a parameter that `is_divisor`.
    """

    symbol: str
    unit: str
    is_positive: bool = True
    starts: tuple[float, ...] = ()
    is_divisor: bool = False

    def unit_for(self, spring: tuple[str, str], joint: tuple[str, str]) -> str:
        """Return the unit for given units (force, length) of spring and joint."""
        letters = dict(zip("FLPQ", (*spring, *joint), strict=True))
        return "".join(letters.get(letter, letter) for letter in self.unit)


_PRESLIDING = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
"""Starts of the search for the angle of presliding, over half the range of the motor angle."""

PARAMETERS = {
    "viscous_friction": Parameter("F_v", "N m s/rad"),
    "coulomb_friction": Parameter("F_C", "N m"),
    "coulomb_width": Parameter("w_C", "rad/s", starts=(0.002, 0.01, 0.05, 0.2), is_divisor=True),
    "coulomb_shift": Parameter("w_0", "rad/s", is_positive=False, starts=(0.0,)),
    "presliding_angle": Parameter("w_M", "rad", starts=_PRESLIDING, is_divisor=True),
    "friction_offset": Parameter("F_0", "N m", is_positive=False),
    "asymmetric_friction": Parameter("F_a", "N m s/rad", is_positive=False),
    "quadratic_friction": Parameter("F_q", "N m s^2/rad^2", is_positive=False),
    "load_friction": Parameter("F_L", "1"),
    "stribeck_friction": Parameter("F_S", "N m", is_positive=False),
    "stribeck_speed": Parameter("w_S", "rad/s", starts=(0.03, 0.1, 0.3), is_divisor=True),
    "coulomb_position_slope": Parameter("F_x", "N m/Q", is_positive=False),
    "coulomb_position_curvature": Parameter("F_xx", "N m/Q^2", is_positive=False),
    "viscous_temperature_slope": Parameter("F_vT", "N m s/(rad K)", is_positive=False),
    "coulomb_temperature_slope": Parameter("F_CT", "N m/K", is_positive=False),
    "cold_viscous_friction": Parameter("F_vW", "N m s/rad", is_positive=False),
    "cold_coulomb_friction": Parameter("F_CW", "N m", is_positive=False),
    "warm_up_time": Parameter("t_W", "s", starts=(0.05, 0.2, 0.6), is_divisor=True),
    "stiffness": Parameter("k", "F/L"),
    "cubic_stiffness": Parameter("k_3", "F/L^3", is_positive=False),
    "fifth_stiffness": Parameter("k_5", "F/L^5", is_positive=False),
    "dead_zone": Parameter("g", "L", starts=(0.03, 0.3, 0.8)),
    "dead_zone_rounding": Parameter("w_g", "L", starts=(0.005, 0.05)),
    "spring_damping": Parameter("c_k", "F s/L"),
    "hysteresis_force": Parameter("F_H", "F"),
    "hysteresis_deflection": Parameter(
        "w_H", "L", starts=(0.02, 0.05, 0.1, 0.2, 0.4), is_divisor=True
    ),
    "spring_offset": Parameter("f_0", "F", is_positive=False),
    "deflection_zero": Parameter("d_0", "L", is_positive=False, starts=(0.0,)),
    "motor_inertia": Parameter("I_M", "kg m^2"),
    "torque_constant": Parameter("K_t", "N m/A", is_divisor=True),
    "voltage_constant": Parameter("K_u", "N m/V", is_divisor=True),
    "command_delay": Parameter("T_C", "s", is_positive=False),
    "gain_scale": Parameter("s_K", "1", is_divisor=True),
    "parallel_stiffness": Parameter("k_P", "P/Q", is_positive=False),
    "parallel_preload": Parameter("tau_P", "P", is_positive=False),
    "joint_viscous_friction": Parameter("b_L", "P s/Q"),
    "joint_coulomb_friction": Parameter("c_L", "P"),
}
"""Every parameter by its name in an estimate, in the order of the columns."""


_HARMONICS = {
    "transmission_error": Parameter("", "L", is_positive=False),
    "torque_ripple": Parameter("", "N m", is_positive=False),
}
"""{field: an amplitude of one of its harmonics}; the symbol of an amplitude is its name."""


def parameter_named(name: str) -> Parameter:
    """Return a parameter, or that of an amplitude such as "torque_ripple_motor_6_cos"."""
    field = next((field for field in _HARMONICS if name.startswith(field)), "")
    return _HARMONICS[field] if field else PARAMETERS[name]


def key_of(name: str, unit: str) -> str:
    """Return the TOML key of a parameter with a unit: "stribeck_speed_rad_per_s" for "rad/s"."""
    if unit == "1":
        return name
    above, _, below = unit.replace("^", "").partition("/")
    above, below = above.replace(" ", ""), below.translate(str.maketrans("", "", " ()"))
    return f"{name}_{above}_per_{below}" if below else f"{name}_{above.replace('kgm2', 'kg_m2')}"


MOTOR_CONSTANTS = {"current": "torque_constant", "voltage": "voltage_constant"}
"""{input of a motor: its constant}; a voltage has its back-EMF in the viscous friction."""

PARAMETERS_OF: dict[str, dict[str, tuple[str, ...]]] = {
    "friction": {
        "viscous": ("viscous_friction",),
        "coulomb": ("coulomb_friction",),
        "smooth_coulomb": ("coulomb_friction", "coulomb_width"),
        "shifted_coulomb": ("coulomb_friction", "coulomb_width", "coulomb_shift"),
        "dahl": ("coulomb_friction", "presliding_angle"),
        "offset": ("friction_offset",),
        "asymmetric": ("asymmetric_friction",),
        "quadratic": ("quadratic_friction",),
        "load": ("load_friction",),
        "stribeck": ("stribeck_friction", "stribeck_speed"),
        "coulomb_position": ("coulomb_position_slope", "coulomb_position_curvature"),
        "viscous_temperature": ("viscous_temperature_slope",),
        "coulomb_temperature": ("coulomb_temperature_slope",),
        "viscous_warm_up": ("cold_viscous_friction", "warm_up_time"),
        "coulomb_warm_up": ("cold_coulomb_friction", "warm_up_time"),
    },
    "spring": {
        "linear": ("stiffness",),
        "cubic": ("cubic_stiffness",),
        "fifth": ("fifth_stiffness",),
        "dead_zone": ("dead_zone",),
        "smooth_dead_zone": ("dead_zone", "dead_zone_rounding"),
        "damping": ("spring_damping",),
        "dahl": ("hysteresis_force", "hysteresis_deflection"),
        "preload": ("spring_offset",),
    },
    "parallel_spring": {"linear": ("parallel_stiffness",), "preload": ("parallel_preload",)},
    "joint_friction": {
        "viscous": ("joint_viscous_friction",),
        "coulomb": ("joint_coulomb_friction",),
    },
    "motor_input": {
        "torque": (),
        **{kind: (constant,) for kind, constant in MOTOR_CONSTANTS.items()},
        "position_command": ("command_delay", "gain_scale"),
        "velocity_command": ("command_delay", "gain_scale"),
    },
}
"""{field of a drive: {term: its parameters}}."""

LEVEL_OF = {
    term: names[0]
    for term, names in PARAMETERS_OF["friction"].items()
    if any(PARAMETERS[name].starts for name in names)
}
"""{nonlinear friction term: its level, the parameter that multiplies the term's function}."""

MotorInput = Literal["torque", "current", "voltage", "position_command", "velocity_command"]
"""Values of `motor_input=`, with their parameters in `PARAMETERS_OF`."""

COMMANDS = ("position_command", "velocity_command")
"""Motor inputs of drives whose controller gives the torque."""

COULOMB = ("coulomb", "smooth_coulomb", "shifted_coulomb", "dahl")
"""Friction terms of which a drive has at most one."""

BY_TEMPERATURE = {
    "viscous_temperature": "viscous_friction",
    "coulomb_temperature": "coulomb_friction",
}
"""{friction term that depends on the motor's temperature: the parameter that it changes}."""

WARM_UP = ("viscous_warm_up", "coulomb_warm_up")
"""Friction terms of a cold motor, which fade with the time since the start of the log."""

DRY = (
    *("coulomb", "load", "stribeck", "coulomb_position"),
    *("coulomb_temperature", "coulomb_warm_up"),
)
"""Friction terms that can hold a motor at rest, unless the drive's Coulomb friction is smooth."""

DEAD_ZONES = ("dead_zone", "smooth_dead_zone")
"""Spring terms of which a drive has at most one."""

NONLINEAR_SPRING = ("cubic", "fifth", *DEAD_ZONES)
"""Spring terms whose force depends on where the deflection is zero."""


class ParameterName(str):
    """The name of a column as data: "stiffness of knee [warm]" is a quantity of a joint.

    `owner` is the joint, "" for what no joint has alone (base parameters, or the columns of the
    equation of one joint); `condition` is the one that has the column alone, None for all.
    """

    quantity: str
    owner: str
    condition: str | None

    def __new__(cls, quantity: str, owner: str = "", condition: str | None = None) -> ParameterName:
        """Return the name with its parts."""
        text = f"{quantity} of {owner}" if owner else quantity
        name = super().__new__(cls, text if condition is None else f"{text} [{condition}]")
        name.quantity, name.owner, name.condition = quantity, owner, condition
        return name

    def __getnewargs__(self) -> tuple[str, str, str | None]:  # type: ignore[override]
        return self.quantity, self.owner, self.condition

    @classmethod
    def of(cls, name: str) -> ParameterName:
        """Return a name as data: a plain text is a quantity without a joint or a condition."""
        return name if isinstance(name, ParameterName) else cls(name)

    @classmethod
    def all_of(cls, names: Iterable[str]) -> tuple[ParameterName, ...]:
        """Return names as data."""
        return tuple(name if isinstance(name, cls) else cls(name) for name in names)

    @classmethod
    def read(cls, text: str) -> ParameterName:
        """Return the name that a user writes, "stiffness" of all joints or "stiffness of knee"."""
        quantity, _, owner = text.partition(" of ")
        return cls(quantity, owner)

    def at(self, owner: str) -> ParameterName:
        """Return the name of the same quantity of another owner."""
        return ParameterName(self.quantity, owner, self.condition)

    def within(self, condition: str | None) -> ParameterName:
        """Return the name of the column that a condition has alone; None: that all share."""
        return ParameterName(self.quantity, self.owner, condition)


def places_of(names: Sequence[ParameterName], condition: str) -> list[int]:
    """Return the places of the columns that a condition has, in the order of its own names."""
    return [k for k, name in enumerate(names) if name.condition in (None, condition)]


def readable(name: str) -> str:
    """Return the name of a column for text: "viscous friction of knee", bodies unchanged."""
    parts = ParameterName.of(name)
    quantity = parts.quantity.replace("_", " ") if parts.owner else parts.quantity
    return str(ParameterName(quantity, parts.owner, parts.condition))


_SERIES_POWERS = {
    "stiffness": 1,
    "cubic_stiffness": 4,
    "fifth_stiffness": 6,
    "spring_damping": 2,
    "hysteresis_force": 1,
    "hysteresis_deflection": -1,
}
"""{parameter: p}: between the encoders it is that of the spring over (1 + c k)^p.

A motor encoder sees the wind-up c F of the gear, with compliance c, under the spring force F as
deflection: d = d_s + c F. As a function of d the force has the same terms with smaller
coefficients: exact for a linear spring, else up to c F_n F_n' with the nonlinear part F_n of F.

With d_s = d / (1 + c k) + ..., F = k d_s + k_3 d_s^3 = (d - d_s) / c: the term in d^3 is
k_3 (d / (1 + c k))^3 - c k k_3 d^3 / (1 + c k)^4 = k_3 d^3 / (1 + c k)^4, and so on.
"""


def between_encoders(values: Mapping[str, float], compliance: float) -> dict[str, float]:
    """Return parameters {name: value} of the spring as those between the encoders.

    Amplitudes of the transmission error become those of a force, k between the encoders times them.
    """
    softer = 1.0 + compliance * values.get("stiffness", 0.0)
    series = {name: value / softer ** _SERIES_POWERS.get(name, 0) for name, value in values.items()}
    for name in filter(is_transmission_error, series):
        series[name] *= series.get("stiffness", 0.0)
    return series


def is_transmission_error(name: str) -> bool:
    """Return whether a parameter is an amplitude of a transmission error."""
    return name.startswith("transmission_error")


def spring_parameters(values: Mapping[str, Any], compliance: float) -> dict[str, Any]:
    """Return parameters {name: value} between the encoders as those of the spring alone.

    Raises RobotError if the gear is softer than gear and spring together.
    """
    share = compliance * values.get("stiffness", 0.0)  # of the gear in the deflection
    if share.real >= 1:
        raise RobotError(
            f"the stiffness between the encoders is {share.real:.3g} times that of the gear alone, "
            "of which it is a part: check gear_stiffness_Nm_per_rad"
        )
    spring = {
        name: value / (1.0 - share) ** _SERIES_POWERS.get(name, 0) for name, value in values.items()
    }
    for name in filter(is_transmission_error, spring):
        spring[name] = spring[name] / values["stiffness"] if values.get("stiffness") else 0.0
    return spring


def spring_slopes(values: Mapping[str, float], compliance: float) -> dict[str, dict[str, float]]:
    """Return {name: {other: slope}}, the derivatives of `spring_parameters`, by a complex step."""
    step, slopes = 1e-30, {name: dict[str, float]() for name in values}
    for other in values:
        moved = spring_parameters({**values, other: values[other] + 1j * step}, compliance)
        for name, value in moved.items():
            if value.imag:
                slopes[name][other] = value.imag / step
    return slopes


Angle = Literal["motor", "joint", "mesh"]
"""Angles in which an error of a drive may be periodic."""

_HIGHEST_ORDER = 1000
"""Periods per turn of the angle of a periodic error, at most."""

_PARTS = ("cos", "sin")


@dataclass(frozen=True)
class Harmonic:
    """One order of a periodic error."""

    field: str
    angle: Angle
    order: int

    @property
    def names(self) -> tuple[str, str]:
        """Names of the two parameters, such as "torque_ripple_motor_6_cos"."""
        cosine, sine = (f"{self.field}_{self.angle}_{self.order}_{part}" for part in _PARTS)
        return cosine, sine


FIELDS = ("transmission_error", "torque_ripple")
"""Fields of a drive that have harmonics."""


def is_harmonic(name: str) -> bool:
    """Return whether a parameter is an amplitude of a harmonic."""
    return name.startswith(FIELDS)


def harmonics_of(field: str, table: Any) -> tuple[Harmonic, ...]:
    """Return the harmonics of a field from {angle: [orders]}.

    Raises RobotError naming the field.
    """
    if isinstance(table, tuple) and all(isinstance(harmonic, Harmonic) for harmonic in table):
        return table
    if not isinstance(table, Mapping):
        raise RobotError(
            f"{field} must be a table of orders, such as {{ motor = [1, 2] }}, found {shown(table)}"
        )
    harmonics = tuple(
        Harmonic(field, angle, order)
        for angle, orders in table.items()
        for order in _orders(field, angle, orders)
    )
    if len({harmonic.names for harmonic in harmonics}) < len(harmonics):
        raise RobotError(f"{field} names an order twice: {shown(table)}")
    return harmonics


def _orders(field: str, angle: Any, orders: Any) -> Sequence[int]:
    """Return the orders of a field about one angle. Raises RobotError for others."""
    check_name(f"angle of {field}", angle, get_args(Angle), RobotError)
    if not isinstance(orders, list | tuple) or not orders:
        raise RobotError(
            f"{field} {angle} must be a list of orders, such as [6], found {shown(orders)}; "
            f"amplitudes are parameters, such as {field}_{angle}_6_cos"
        )
    for order in orders:
        if type(order) is not int or not 1 <= order <= _HIGHEST_ORDER:
            raise RobotError(
                f"{field} {angle}: an order is a whole number from 1 to {_HIGHEST_ORDER}, found "
                f"{shown(order)}"
            )
    return orders


def harmonics_table(harmonics: Iterable[Harmonic]) -> dict[str, list[int]]:
    """Return harmonics as a table for TOML: the orders of each angle."""
    table: dict[str, list[int]] = {}
    for harmonic in harmonics:
        table.setdefault(harmonic.angle, []).append(harmonic.order)
    return table
