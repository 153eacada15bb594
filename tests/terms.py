"""Motions of a two-joint arm made from the equations of its drives, exact to rounding.

Joint "one" has a stiff drive, "two" a spring (mostly). Everything is periodic and differentiated by
its Fourier series; torques come from the equations by themselves, not from any regressor.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

from seaid._arrays import Array
from seaid.drives import Drive, SeriesElasticDrive, StiffDrive, motor_equation
from seaid.drives.equations import DriveEquation, d_0, f_0, joint_equation, known_values, symbol_of
from seaid.drives.regressor import flat_names
from seaid.estimation import estimator_named
from seaid.identification import Identification
from seaid.identification.conclusion import (
    identification_of,
    value_findings,
    with_value_findings,
)
from seaid.identification.nonlinear_terms import linearised_condition, with_searched_drives
from seaid.identification.two_step import ONLY, Condition, estimate_two_step, joints_with_torque
from seaid.legged import load_robot
from seaid.log import Log, Motion
from seaid.regressor import joint_torques
from seaid.robot import Robot
from tests.experiments import motion_of
from tests.plants import log_with

PERIOD_S, RATE_HZ = 8.0, 250.0
TIME = np.arange(int(PERIOD_S * RATE_HZ)) / RATE_HZ

STIFF = StiffDrive(gear_ratio=40.0, motor_inertia_kg_m2=2e-5).with_values(
    {"viscous_friction": 4e-4, "coulomb_friction": 0.02}
)
ELASTIC = SeriesElasticDrive(gear_ratio=50.0, motor_inertia_kg_m2=1e-5).with_values(
    {"viscous_friction": 5e-4, "coulomb_friction": 0.03, "stiffness": 120.0}
)

_URDF = """<robot name="arm"><link name="base"/>
<joint name="one" type="continuous"><parent link="base"/><child link="upper"/>
<axis xyz="0 1 0"/><origin xyz="0 0 1"/></joint>
<link name="upper"><inertial><origin xyz="0.02 0.01 -0.15"/><mass value="2.0"/>
<inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.021" iyz="0" izz="0.004"/></inertial></link>
<joint name="two" type="continuous"><parent link="upper"/><child link="lower"/>
<axis xyz="0 1 0"/><origin xyz="0 0 -0.35"/></joint>
<link name="lower"><inertial><origin xyz="0.01 0 -0.12"/><mass value="1.2"/>
<inertia ixx="0.01" ixy="0" ixz="0.0005" iyy="0.01" iyz="0" izz="0.002"/></inertial></link>
</robot>"""


def arm(folder: Path, one: Drive, two: Drive, **options: Any) -> Robot:
    """Return the arm with two drives; options as those of load_robot."""
    path = folder / "arm.urdf"
    path.write_text(_URDF)
    return load_robot(path, {"one": one, "two": two}, **options)


def with_terms(drive: Any, terms: Mapping[str, Any], values: Mapping[str, float]) -> Any:
    """Return a drive with other terms and the true values of what they bring."""
    return replace(drive, **terms).with_values(values)


def stiff(values: Mapping[str, float], **terms: Any) -> StiffDrive:
    """Return the stiff drive with other terms, and values of what they bring."""
    return with_terms(STIFF, terms, values)  # type: ignore[no-any-return]


def elastic(values: Mapping[str, float], **terms: Any) -> SeriesElasticDrive:
    """Return the elastic drive with other terms, and values of what they bring."""
    return with_terms(ELASTIC, terms, values)  # type: ignore[no-any-return]


DRY: tuple[str, str] = ("viscous", "coulomb")
TERMS = (*DRY, "asymmetric", "quadratic", "load", "stribeck")
FRICTION: Mapping[str, float] = {
    "asymmetric_friction": 1e-4,
    "quadratic_friction": 1e-6,
    "load_friction": 0.2,
    "stribeck_friction": 0.01,
    "stribeck_speed": 6.0,
}
PARALLEL = {"parallel_stiffness": 3.0, "parallel_preload": 1.0}
AT_JOINT = {"joint_viscous_friction": 0.1, "joint_coulomb_friction": 0.2}
CUBIC = elastic(
    {"cubic_stiffness": 2e4, "deflection_zero": 0.01, "spring_offset": 1.0, **FRICTION},
    spring=("linear", "cubic", "preload"),
    friction=TERMS,
)
FULL: SeriesElasticDrive = with_terms(
    CUBIC,
    {"parallel_spring": ("linear", "preload"), "joint_friction": DRY},
    {**PARALLEL, **AT_JOINT},
)
HEAVY = stiff(
    {**FRICTION, "friction_offset": 0.01, **PARALLEL},
    friction=(*TERMS, "offset"),
    parallel_spring=("linear", "preload"),
)
SMOOTH = stiff(
    {"coulomb_width": 2.0, "coulomb_shift": 0.5, "load_friction": 0.2},
    friction=("viscous", "shifted_coulomb", "load"),
)
COUPLED = {"one": {"one": 1.0, "two": 1.0}, "two": {"one": 0.5, "two": -1.0}}


def arm_of(folder: Path, one: Drive, two: Drive, is_coupled: bool = False) -> Robot:
    """Return the arm with two drives, each of which may move both joints."""
    if is_coupled:
        one = replace(one, transmission=COUPLED["one"])
        two = replace(two, transmission=COUPLED["two"])
    return arm(folder, one, two)


Case = tuple[dict[str, Any], dict[str, float]]
"""What a drive then has, and the true values that it brings."""


def friction(*terms: str, **values: float) -> Case:
    """Return viscous friction with more terms, and their values."""
    return {"friction": ("viscous", *terms)}, values


def spring(*terms: str, **values: float) -> Case:
    """Return a linear spring with more terms, and their values."""
    return {"spring": ("linear", *terms)}, values


def exact_motion(
    robot: Robot,
    stretch: Mapping[str, Array] | None = None,
    seed: int = 1,
    *,
    reach: Sequence[float] = (0.8, 1.1),
    periods: int = 1,
    is_sensed: bool = False,
    **further: float,
) -> Motion:
    """Return the motion of the true robot, its cutoff infinite: nothing is filtered.

    Springs are as stretched as the load asks for, which a plain one can say; `stretch` {joint:
    deflection (T,)} says it for the others, whose load side is then wrong. Sensors behind them are
    there if `is_sensed`. `further` are the values of extra terms.
    """
    rng = np.random.default_rng(seed)
    q = np.tile(np.column_stack([_waves(rng, size) for size in reach]), (periods, 1))
    time = np.arange(len(q)) / RATE_HZ
    v, a = slope(q), slope(slope(q))
    load = joint_torques(robot, q, v, a)
    motor, torque, current, voltage = (np.zeros_like(q) for _ in range(4))
    for index, joint in enumerate(robot.joint_names):
        drive, states = robot.drives[joint], _states("theta_L", q[:, index])
        nothing = dict.fromkeys(("tau_L", "tau_M", "i_M", "u_M"), np.zeros(len(q)))
        load[:, index] += value_of(joint_equation(drive), drive, {**states, **nothing})
        turned = drive.ratio * q[:, index]
        if isinstance(drive, SeriesElasticDrive):
            if stretch is None:
                offset = drive.values.get("spring_offset", 0.0)
                d = (load[:, index] / drive.load_radius - offset) / drive.values["stiffness"]
            else:
                d = stretch[joint]
            turned = drive.ratio / drive.motor_radius * (d + drive.load_radius * q[:, index])
        motor[:, index] = turned
        by_name: dict[str, Array | float] = {**further, **states, **_states("theta_M", turned)}
        by_name |= nothing | {"tau_L": load[:, index], "tau_G": load[:, index], "t_log": time}
        needed = value_of(motor_equation(drive), drive, by_name)
        torque[:, index] = needed
        current[:, index] = needed / drive.values.get("torque_constant", 1.0)
        voltage[:, index] = needed / drive.values.get("voltage_constant", 1.0)
    kinds = np.array([robot.drives[joint].motor_input for joint in robot.joint_names])
    sensed = np.array([robot.drives[joint].is_elastic for joint in robot.joint_names]) & is_sensed
    return motion_of(
        robot,
        time,
        (q, v, a),
        (motor, slope(motor), slope(slope(motor))),
        np.where(kinds == "torque", torque, np.nan),
        joint_torque=np.where(sensed, load, np.nan),
        motor_current=np.where(kinds == "current", current, np.nan),
        motor_voltage=np.where(kinds == "voltage", voltage, np.nan),
    )


def free_stretch(reach: float, seed: int = 5) -> Array:
    """Return a deflection (T,) that has nothing to do with any load."""
    wave = _waves(np.random.default_rng(seed), 1.0)
    return np.asarray(reach * wave / np.max(np.abs(wave)))


def noisy_log(
    motion: Motion,
    torque_std: float,
    angle_std: float,
    seed: int = 3,
    motor_std: float | None = None,
) -> Log:
    """Return the log of a motion with white noise; current and voltage have that of the torque.

    That of the motor angle may be another one than `angle_std`, that of joints.
    """
    rng = np.random.default_rng(seed)

    def measured(values: Array, std: float) -> Array:
        return np.asarray(values + std * rng.normal(size=values.shape))

    inputs = {
        name: measured(values, torque_std)
        for name in ("motor_current", "motor_voltage")
        if np.any(np.isfinite(values := getattr(motion, name)))
    }
    inputs["joint_position"] = measured(motion.joint_position, angle_std)
    inputs["motor_position"] = measured(motion.motor_position, motor_std or angle_std)
    inputs["motor_torque"] = measured(motion.motor_torque, torque_std)
    return log_with(motion.joint_names, motion.time, **inputs)


def identified(robot: Robot, motion: Motion, rows: list[str] | None = None) -> Identification:
    """Do what `identify` does, with a motion instead of a log, from nothing but what is known."""
    known = robot.without_nominal()
    used = joints_with_torque(known, [motion]) if rows is None else tuple(rows)
    condition = linearised_condition(Condition(known, [motion], used))
    known = condition.robot
    sides = estimate_two_step({ONLY: condition}, estimator_named("wls")).of(ONLY)
    values = value_findings(sides, robot, known, None)
    sides = with_searched_drives(sides, condition)
    return with_value_findings(identification_of(known, sides, condition.datasets), values)


@cache
def _compiled(equation: DriveEquation, drive: Drive) -> tuple[Any, list[str]]:
    """Return an equation with the values of a drive as a function, and what it takes."""
    values = known_values(drive)
    values |= {symbol_of(name): number for name, number in drive.values.items()}
    flat = flat_names(equation.expression).subs({d_0: 0.0, f_0: 0.0} | values)
    names = sorted(map(str, flat.free_symbols))
    return sp.lambdify(names, flat, modules="numpy"), names


def value_of(equation: DriveEquation, drive: Drive, by_name: Mapping[str, Array | float]) -> Array:
    """Return the expression of an equation with the true values of a drive, as the states are."""
    function, names = _compiled(equation, drive)
    shape = np.broadcast_shapes(*(np.shape(states) for states in by_name.values()))
    arguments = [by_name.get(name, 0.0) for name in names]
    return np.broadcast_to(function(*arguments), shape).astype(float)


def slope(values: Array) -> Array:
    """Return the derivative of periodic columns (T, ...)."""
    spectrum = np.fft.rfft(values, axis=0)
    factor = 2j * np.pi * np.fft.rfftfreq(len(values), 1 / RATE_HZ)
    factor = factor.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(np.fft.irfft(factor * spectrum, len(values), axis=0))


def _states(name: str, position: Array) -> dict[str, Array]:
    velocity = slope(position)
    return {name: position, f"{name}_dot": velocity, f"{name}_ddot": slope(velocity)}


def _waves(rng: np.random.Generator, reach: float) -> Array:
    """Return eight harmonics with random amplitudes and phases, (T,)."""
    wave = np.zeros(len(TIME))
    for harmonic in range(1, 9):
        amplitude = rng.normal() / harmonic**0.7
        wave += amplitude * np.sin(2 * np.pi * harmonic * TIME / PERIOD_S + rng.uniform(0, 7))
    return np.asarray(reach * wave / np.max(np.abs(wave)))
