"""The terms a drive may have, and the parameters they bring: names, units, keys of the TOML."""

from __future__ import annotations

from dataclasses import dataclass

FRICTION_TERMS = (
    "viscous",
    "coulomb",
    "smooth_coulomb",
    "shifted_coulomb",
    "offset",
    "asymmetric",
    "quadratic",
    "load",
    "stribeck",
)
"""What `friction` may name, all at the motor, with w the motor speed:

- viscous F_v w, quadratic F_q w |w|, asymmetric F_a |w| (the other direction has less);
- coulomb F_C sign(w), or smooth_coulomb F_C tanh(w / w_C) with its width w_C, or shifted_coulomb
  F_C tanh((w - w_0) / w_C), which is zero at another speed w_0 (Gaz et al. 2019). The smooth ones
  are known at standstill too, and sign(w) of the next two terms is then theirs;
- stribeck F_S exp(-(w / w_S)^2) sign(w), what sticks more than it slides;
- load F_L |torque through the gear| sign(w): of the spring, or of what a stiff drive moves;
- offset F_0, a constant torque: it gives Coulomb friction of its own to each direction. Only at a
  stiff drive, since the deflection offset of an elastic one is the same column."""

SPRING_TERMS = ("linear", "cubic", "fifth", "dead_zone", "damping", "preload")
"""What `spring` may name, with d the deflection: k d, k_3 d^3, k_5 d^5; dead_zone takes its half
width g away on both sides before anything stretches (backlash); damping c d' beside the spring;
preload a constant force f_0. A spring that is not linear also has the zero of its deflection as
an unknown, `deflection_zero`; a linear one has a force at zero deflection instead,
`spring_offset`, and its preload is that."""

PARALLEL_TERMS = ("linear", "preload")
"""What `parallel_spring` may name: k_P q and a constant torque, between the joint's two bodies."""

JOINT_FRICTION_TERMS = ("viscous", "coulomb")
"""What `joint_friction` may name: friction between the joint's two bodies, behind the spring."""

MOTOR_INPUTS = ("torque", "current", "voltage")
"""What is logged of a motor: its torque, its current (torque = torque constant times current), or
its voltage (torque = voltage constant times voltage; the viscous friction has the back-EMF in it).
The constant is unknown."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a drive: its unit and the keys of its nominal value in the TOML.

    In `unit` stand F and L for force and length of the spring (N and m, or N m and rad), P and Q
    for those of the joint. `is_positive`: zero or more, in the file and in a robot that simulates.
    """

    unit: str
    is_positive: bool = True

    def unit_for(self, spring: tuple[str, str], joint: tuple[str, str]) -> str:
        """Return the unit; `spring` and `joint` are the units of force and length there."""
        letters = dict(zip("FLPQ", (*spring, *joint), strict=True))
        return "".join(letters.get(letter, letter) for letter in self.unit)


PARAMETERS = {
    "viscous_friction": Parameter("N m s/rad"),
    "coulomb_friction": Parameter("N m"),
    "coulomb_width": Parameter("rad/s"),
    "coulomb_shift": Parameter("rad/s", is_positive=False),
    "friction_offset": Parameter("N m", is_positive=False),
    "asymmetric_friction": Parameter("N m s/rad", is_positive=False),
    "quadratic_friction": Parameter("N m s^2/rad^2", is_positive=False),
    "load_friction": Parameter("1"),
    "stribeck_friction": Parameter("N m", is_positive=False),
    "stribeck_speed": Parameter("rad/s"),
    "stiffness": Parameter("F/L"),
    "cubic_stiffness": Parameter("F/L^3", is_positive=False),
    "fifth_stiffness": Parameter("F/L^5", is_positive=False),
    "dead_zone": Parameter("L"),
    "spring_damping": Parameter("F s/L"),
    "spring_offset": Parameter("F", is_positive=False),
    "deflection_zero": Parameter("L", is_positive=False),
    "motor_inertia": Parameter("kg m^2"),
    "torque_constant": Parameter("N m/A"),
    "voltage_constant": Parameter("N m/V"),
    "parallel_stiffness": Parameter("P/Q", is_positive=False),
    "parallel_preload": Parameter("P", is_positive=False),
    "joint_viscous_friction": Parameter("P s/Q"),
    "joint_coulomb_friction": Parameter("P"),
}
"""Every parameter by the name it has in an estimate, in the order of the columns."""


def key_of(name: str, unit: str) -> str:
    """Return the TOML key of a parameter in a unit: "stribeck_speed_rad_per_s" of "rad/s"."""
    if unit == "1":
        return name
    above, _, below = unit.replace("^", "").partition("/")
    above, below = above.replace(" ", ""), below.replace(" ", "")
    return f"{name}_{above}_per_{below}" if below else f"{name}_{above.replace('kgm2', 'kg_m2')}"


PARAMETERS_OF: dict[str, dict[str, tuple[str, ...]]] = {
    "friction": {
        "viscous": ("viscous_friction",),
        "coulomb": ("coulomb_friction",),
        "smooth_coulomb": ("coulomb_friction", "coulomb_width"),
        "shifted_coulomb": ("coulomb_friction", "coulomb_width", "coulomb_shift"),
        "offset": ("friction_offset",),
        "asymmetric": ("asymmetric_friction",),
        "quadratic": ("quadratic_friction",),
        "load": ("load_friction",),
        "stribeck": ("stribeck_friction", "stribeck_speed"),
    },
    "spring": {
        "linear": ("stiffness",),
        "cubic": ("cubic_stiffness",),
        "fifth": ("fifth_stiffness",),
        "dead_zone": ("dead_zone",),
        "damping": ("spring_damping",),
        "preload": ("spring_offset",),
    },
    "parallel_spring": {
        "linear": ("parallel_stiffness",),
        "preload": ("parallel_preload",),
    },
    "joint_friction": {
        "viscous": ("joint_viscous_friction",),
        "coulomb": ("joint_coulomb_friction",),
    },
    "motor_input": {
        "torque": (),
        "current": ("torque_constant",),
        "voltage": ("voltage_constant",),
    },
}
"""{field of a drive: {term: the parameters it brings}}."""

COULOMB = ("coulomb", "smooth_coulomb", "shifted_coulomb")
"""Friction terms of which a drive has one at most."""

NON_LINEAR_SPRING = ("cubic", "fifth", "dead_zone")
"""Spring terms that know where the deflection is zero."""
