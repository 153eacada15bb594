"""Periodic errors of a drive: transmission error in the deflection, ripple of the motor torque."""

from __future__ import annotations

import pickle
import tomllib
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from seaid._arrays import Array
from seaid.drives import (
    SeriesElasticDrive,
    StiffDrive,
    friction_curve,
    motor_equation,
    spring_curve,
)
from seaid.drives.equations import Dahl, after_travel, states
from seaid.drives.functions import drive_functions, smooth_columns
from seaid.drives.regressor import drive_regressor
from seaid.identification import Identification, identify
from seaid.log import Motion
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure, simulate_motion
from tests.experiments import ARM_SENSORS, arm, arm_log, arm_motion, wiggle

ERROR_VALUES = {
    "transmission_error_motor_1_cos": 1e-3,
    "transmission_error_motor_1_sin": 5e-4,
    "transmission_error_joint_3_cos": 0.0,
    "transmission_error_joint_3_sin": 2e-3,
}
RIPPLE_VALUES = {"torque_ripple_joint_4_cos": 1e-3, "torque_ripple_joint_4_sin": 0.0}


@cache
def truth() -> Robot:
    """Return the arm with errors of 1 to 2 mrad at a spring, and a ripple of its stiff wrist."""
    shoulder: Any = arm().drives["shoulder"]
    wrist = arm().drives["wrist"]
    return arm().with_drives(
        {
            "shoulder": replace(
                shoulder,
                transmission_error={"motor": [1], "joint": [3]},
                nominal={**shoulder.nominal, **ERROR_VALUES},
            ),
            "wrist": replace(
                wrist,
                torque_ripple={"joint": [4]},
                nominal={**wrist.nominal, **RIPPLE_VALUES},
            ),
        }
    )


@cache
def motion() -> Motion:
    return simulate_motion(truth(), wiggle(arm(), 6.0, (0.0, 0.3, 0.15, 0.0), (0.4, 0.8, 0.2, 0.9)))


@cache
def found(robot: Robot) -> Identification:
    """Return the identification from encoders without offset, which would turn the phases."""
    return identify(robot.without_nominal(), measure(robot, motion(), SENSORS, 0))


SENSORS = replace(ARM_SENSORS, motor_offset_rad=0.0)


def test_force_and_torque_of_the_errors() -> None:
    """The spring force is k (d + error), and a motor at rest feels the ripple."""
    drive = SeriesElasticDrive(
        gear_ratio=100.0,
        stiffness_Nm_per_rad=300.0,
        friction=(),
        transmission_error={"motor": [1], "mesh": [2]},
        torque_ripple={"joint": [3]},
        nominal={
            "transmission_error_motor_1_cos": 1e-3,
            "transmission_error_mesh_2_sin": 2e-3,
            "torque_ripple_joint_3_cos": 0.01,
        },
    )
    functions, motor, joint = drive_functions(drive), 5.0, 0.04
    error = 1e-3 * np.cos(motor) + 2e-3 * np.sin(2 * (motor - motor / 100))
    force = functions.force(motor, 0.0, joint, 0.0, 0.0)
    assert force == pytest.approx(300.0 * (motor / 100 - joint + error))
    ripple = functions.friction(motor, 0.0, joint, 0.0, 0.0)
    assert ripple == pytest.approx(0.01 * np.cos(3 * joint))
    assert spring_curve(drive, np.array([0.01]))[0] == pytest.approx(3.0)  # not the spring's


@pytest.mark.slow  # two whole identifications of an arm
def test_remedy_as_printed_repairs_the_result() -> None:
    """Orders that nobody named are found in the residual, and naming them repairs the stiffness."""
    log = measure(arm(), motion(), SENSORS, 0)
    robot = arm().without_nominal()
    before = identify(robot, log)
    (flag,) = [finding for finding in before.warnings if finding.code == "transmission-error"]
    assert (flag.joint, flag.severity) == ("shoulder", "doubtful")
    assert flag.evidence["explained of the motor equation"] > 0.95
    assert flag.evidence["amplitude"] == pytest.approx(2e-3, rel=0.2)
    assert "between the encoders" in flag.message
    first, _, text = flag.remedy.partition("\n")
    assert first == "in the drives file:"
    (table,) = tomllib.loads(text).values()
    orders = table["transmission_error"]
    assert orders["motor"] == [1]
    assert 3 in orders["joint"]
    assert len(orders["joint"]) <= 2  # an order of the noise may be there too
    repaired = robot.with_drives({"shoulder": replace(robot.drives["shoulder"], **table)})
    after = identify(repaired, log)
    wrong, drive = (result.drives["shoulder"] for result in (before, after))
    assert abs(wrong.value("stiffness") - 250.0) > 1.0
    assert drive.value("stiffness") == pytest.approx(250.0, abs=0.5)
    assert drive.residual_std < 0.3 * wrong.residual_std
    for name, value in ERROR_VALUES.items():  # the low pass takes fast turns away
        assert drive.value(name) == pytest.approx(value, abs=1.5e-4)
        assert drive.units[drive.names.index(name)] == "rad"
        own = after.robot.drives["shoulder"].own_values[name]
        assert own == pytest.approx(drive.value(name), abs=1e-12)
    assert "transmission-error" not in {flag.code for flag in after.warnings}


@pytest.mark.slow  # 2.1 s
def test_a_second_log_may_turn_the_gear_less_than_once() -> None:
    """The slide's gear turns 2.6 times in the whole log and 0.7 times in a part of it."""
    log = arm_log(0)
    slip = 0.05 * np.ptp(log.motor_torque[:, 2]) * np.sin(log.motor_position[:, 2])
    torque = log.motor_torque + np.eye(4)[2] * slip[:, None]
    log = replace(log, motor_torque=torque)
    found = identify(arm().without_nominal(), [log, log.between(2.0, 3.0)])
    (flag,) = [finding for finding in found.warnings if finding.code == "transmission-error"]
    assert flag.joint == "telescope"


@pytest.mark.slow  # a simulation of an arm and its identification
def test_ripple_is_named_where_the_deflection_itself_is_measured() -> None:
    """An error between the encoders cannot be in that signal."""
    true = motion()
    index = arm().index("shoulder")
    drive = truth().drives["shoulder"]
    rippled = true.motor_torque.copy()
    rippled[:, index] += 2e-2 * np.cos(4 * true.joint_position[:, index])
    deflection = np.full_like(rippled, np.nan)
    deflection[:, index] = true.joint_torque[:, index] / drive.values["stiffness"]
    log = measure(arm(), replace(true, motor_torque=rippled), SENSORS, 0)
    result = identify(arm().without_nominal(), replace(log, deflection=deflection))
    (flag,) = [flag for flag in result.warnings if flag.code == "transmission-error"]
    assert "torque_ripple = { joint = [4] }" in flag.remedy


@pytest.mark.slow  # a simulation of an arm and its identification
def test_amplitudes_follow_the_stiffness_with_a_gear_in_series() -> None:
    """An error in rad is that of the encoders, whatever the spring behind the gear is.

    A known amplitude is on the known side, with a known stiffness.
    """
    shoulder: Any = truth().drives["shoulder"]
    name = "transmission_error_joint_3_sin"
    in_series = replace(shoulder, gear_stiffness_Nm_per_rad=4000.0)
    result = found(truth().with_drives({"shoulder": in_series}))
    plain = found(truth()).drives["shoulder"]
    assert result.drives["shoulder"].value(name) == pytest.approx(plain.value(name))
    known = replace(shoulder, known=("stiffness", name, name.replace("sin", "cos")))
    robot = truth().with_drives({"shoulder": known}).without_nominal()
    assert robot.drives["shoulder"].own_values[name] == 2e-3
    assert name not in found(robot).drives["shoulder"].names


def test_an_unknown_amplitude_counts_as_zero() -> None:
    known, unknown = RIPPLE_VALUES
    drive = replace(truth().drives["wrist"], known=(known,)).without_nominal()
    assert (drive.values[known], drive.values[unknown]) == (1e-3, 0.0)
    assert unknown not in drive.own_values
    shoulder = truth().drives["shoulder"]  # its amplitudes are forces between the encoders
    assert shoulder.with_values(shoulder.values).own_values == pytest.approx(shoulder.own_values)


@pytest.mark.slow  # a simulation of an arm and its identification
def test_load_friction_of_a_spring_with_an_error() -> None:
    """The amplitudes are inside |spring force| then, in which the equation is not linear."""
    robot = truth().without_nominal()
    shoulder = robot.drives["shoulder"]
    friction = replace(shoulder, friction=("viscous", "coulomb", "load"))
    robot = robot.with_drives({"shoulder": friction})
    one = identify(robot, measure(arm(), motion(), SENSORS, 0)).drives["shoulder"]
    assert one.value("stiffness") == pytest.approx(250.0, abs=1.0)
    assert one.value("transmission_error_joint_3_sin") == pytest.approx(2e-3, rel=0.1)
    assert abs(one.value("load_friction")) < 3 * one.standard_error("load_friction")


@pytest.mark.slow  # 2.6 s
def test_an_error_whose_torque_does_not_matter_is_not_named() -> None:
    """Without noise 0.02 mrad is most of the residual, and less than 0.1 % of the torque."""
    true, index, drive = arm_motion(), arm().index("shoulder"), arm().drives["shoulder"]
    torque = true.motor_torque.copy()
    lever = drive.motor_radius / drive.ratio * drive.values["stiffness"]
    torque[:, index] += lever * 2e-5 * np.cos(3 * true.joint_position[:, index])
    log = measure(arm(), replace(true, motor_torque=torque), Noise())
    result = identify(arm().without_nominal(), log)
    assert "transmission-error" not in {flag.code for flag in result.warnings}


# The law of hysteresis: against its differential equation, known loops, and its limit

TIME = np.linspace(0.0, 6.0, 6001)
WIDTH = 0.07


def position(time: Array) -> Array:
    return 0.3 * np.sin(2.1 * time) + 0.1 * np.sin(7.3 * time + 1)


def speed(time: float) -> float:
    return float(0.63 * np.cos(2.1 * time) + 0.73 * np.cos(7.3 * time + 1))


def dahl_rate(time: float, z: Array) -> Array:
    v = speed(time)
    return np.asarray((v - abs(v) * z) / WIDTH)


def test_states_solve_the_differential_equation_of_the_law() -> None:
    """By an integrator; a joint at rest has none of the force."""
    exact = solve_ivp(dahl_rate, (0, 6), [0.0], t_eval=TIME, rtol=1e-8, atol=1e-8, max_step=1e-3)
    np.testing.assert_allclose(states(position(TIME), WIDTH)[0], exact.y[0], atol=3e-3)
    assert not np.any(states(np.zeros(5), WIDTH))


def test_a_step_after_another_is_the_whole() -> None:
    """The slope by the width is the difference of two, but where the direction changes."""
    x, z = position(TIME), 0.0
    whole, found = states(x, WIDTH)
    for place, step in enumerate(np.diff(x).tolist()):
        z = after_travel(z, step, WIDTH)
        assert z == pytest.approx(whole[place + 1], abs=1e-9)
    more, less = (states(x, WIDTH + step)[0] for step in (1e-6, -1e-6))
    agree = np.abs((more - less) / 2e-6 - found) < 1e-4 * (1 + np.abs(found))
    assert np.mean(agree) > 0.9999


def test_the_law_is_data_of_an_equation() -> None:
    """It goes to other processes; what follows the travel has no slope by the position."""
    x, w = sp.symbols("x w")
    expression = Dahl(x, w) + Dahl(x, w).diff(w)
    assert pickle.loads(pickle.dumps(expression)) == expression
    assert Dahl(x, w).diff(x).has(sp.Derivative)  # what follows the travel has no such slope


DAHL = StiffDrive(gear_ratio=50.0, friction=("viscous", "dahl", "load")).with_values(
    {"viscous_friction": 1e-3, "coulomb_friction": 0.1, "load_friction": 0.1, "presliding_angle": 1}
)


PLAIN = SeriesElasticDrive(gear_ratio=50.0, stiffness_Nm_per_rad=100.0)
DAHL_SPRING = replace(PLAIN, spring=("linear", "dahl")).with_values(
    {"hysteresis_force": 2.0, "hysteresis_deflection": 0.01}
)


def test_plans_see_the_loop_of_wide_motions() -> None:
    """Columns and curves of a plan are those of sharp friction, and of springs without a loop."""
    sharp = DAHL.without_memory()
    assert sharp.friction == ("viscous", "coulomb", "load")
    assert DAHL_SPRING.without_memory() == PLAIN
    of_motor = {
        drive: smooth_columns(drive_regressor(motor_equation(drive), drive))
        for drive in (DAHL, sharp, DAHL_SPRING, PLAIN)
    }
    for drive, other in ((DAHL, sharp), (DAHL_SPRING, PLAIN)):
        columns = of_motor[drive], of_motor[other]
        assert columns[0].names == columns[1].names
        assert columns[0].missing == columns[1].missing
    w, load = np.linspace(-5, 5, 11), np.linspace(2, 3, 11)
    given = {"theta_M_dot": w, "theta_M_ddot": w, "tau_G": load, "tau_M": w, "tau_L": load}
    rows = [of_motor[drive].evaluate(given, 0.1) for drive in (DAHL, sharp)]
    for found, expected in zip(*rows, strict=True):
        np.testing.assert_allclose(found, expected)
    curves = [friction_curve("knee", drive) for drive in (DAHL, sharp)]
    torques = [curve.torque(w, load, sign_width=0.1)[0] for curve in curves]
    np.testing.assert_allclose(torques[0], torques[1])
    x = np.linspace(-0.1, 0.1, 5)
    np.testing.assert_allclose(spring_curve(DAHL_SPRING, x), 100 * x)


def test_stiffness_between_the_encoders_keeps_the_loop() -> None:
    """A loop of force F_H over d_s is one of F_H / (1 + c k) over (1 + c k) d_s."""
    drive = replace(DAHL_SPRING, gear_stiffness_Nm_per_rad=400.0)
    assert drive.values["hysteresis_force"] == pytest.approx(2.0 / 1.25)
    assert drive.values["hysteresis_deflection"] == pytest.approx(0.01 * 1.25)
    assert drive.with_values(drive.values).own_values == pytest.approx(drive.own_values)
