"""Friction, spring and motor terms: their columns, and equations that are not linear in them."""

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives import (
    Drive,
    ParameterName,
    SeriesElasticDrive,
    StiffDrive,
    equations,
    friction_curve,
    motor_equation,
    readable,
    spring_equation,
)
from seaid.drives.regressor import drive_regressor, non_linear
from seaid.drives.terms import PARAMETERS_OF
from seaid.errors import RobotError

ELASTIC = SeriesElasticDrive(gear_ratio=50.0, motor_inertia_kg_m2=1e-5)
STIFF = StiffDrive(gear_ratio=50.0, motor_inertia_kg_m2=1e-5)
EVERYTHING = replace(
    ELASTIC,
    friction=(
        *("viscous", "shifted_coulomb", "asymmetric", "quadratic", "load", "stribeck"),
        "coulomb_position",
    ),
    reference_position_rad=0.3,
    spring=("linear", "cubic", "fifth", "dead_zone", "damping", "preload"),
)
VALUES = {
    "viscous_friction": 1e-3,
    "coulomb_friction": 0.02,
    "coulomb_width": 1.3,
    "coulomb_shift": 0.2,
    "asymmetric_friction": 2e-4,
    "quadratic_friction": 1e-5,
    "load_friction": 0.07,
    "stribeck_friction": 0.01,
    "stribeck_speed": 4.0,
    "coulomb_position_slope": 0.03,
    "coulomb_position_curvature": -0.02,
    "cold_viscous_friction": 6e-4,
    "cold_coulomb_friction": 0.015,
    "warm_up_time": 0.8,
    "stiffness": 80.0,
    "cubic_stiffness": 300.0,
    "fifth_stiffness": 900.0,
    "dead_zone": 0.02,
    "dead_zone_rounding": 0.003,
    "presliding_angle": 0.3,
    "hysteresis_force": 1.5,
    "hysteresis_deflection": 0.4,
    "spring_damping": 0.4,
    "spring_offset": 0.3,
    "deflection_zero": 0.05,
    "motor_inertia": 1e-5,
    "friction_offset": -0.01,
    "viscous_temperature_slope": 1e-4,
    "coulomb_temperature_slope": -2e-3,
    "torque_constant": 0.05,
    "voltage_constant": 0.4,
    "parallel_stiffness": 3.0,
    "parallel_preload": -0.7,
    "joint_viscous_friction": 0.2,
    "joint_coulomb_friction": 0.11,
}
CHOICES = [
    (("viscous", "coulomb"), ("linear",), ()),
    (("viscous", "smooth_coulomb"), ("linear",), ("coulomb_width",)),
    (("viscous", "shifted_coulomb"), ("linear",), ("coulomb_width", "coulomb_shift")),
    (("coulomb", "stribeck", "quadratic", "asymmetric"), ("linear",), ("stribeck_speed",)),
    (("coulomb", "coulomb_position"), ("linear",), ()),
    (("viscous", "load"), ("linear",), ("stiffness", "spring_offset")),
    (("viscous", "viscous_warm_up", "coulomb_warm_up"), ("linear",), ("warm_up_time",)),
    (("viscous",), ("linear", "cubic"), ("deflection_zero",)),
    (("viscous",), ("linear", "damping", "preload"), ()),
    (("viscous",), ("linear", "dead_zone"), ("dead_zone", "deflection_zero")),
    (
        ("viscous",),
        ("linear", "smooth_dead_zone"),
        ("dead_zone", "dead_zone_rounding", "deflection_zero"),
    ),
    (("viscous", "dahl"), ("linear",), ("presliding_angle",)),
    (("viscous",), ("linear", "dahl"), ("hysteresis_deflection",)),
]


def signals(seed: int = 0, count: int = 40) -> dict[str, Array]:
    rng = np.random.default_rng(seed)
    names = [
        *(f"theta_{side}{dots}" for side in "ML" for dots in ("", "_dot", "_ddot")),
        *("tau_M", "tau_L", "i_M", "u_M", "tau_G", "t_log", "Delta_T"),
    ]
    given = {name: rng.normal(size=count) for name in names}
    given["theta_M"][0], given["theta_L"][0] = 50 * 0.05, 0.0  # in the middle of the dead zone
    return given


@pytest.mark.parametrize(("friction", "spring", "expected"), CHOICES)
def test_what_is_linear_stays_linear(
    friction: tuple[str, ...], spring: tuple[str, ...], expected: tuple[str, ...]
) -> None:
    drive = replace(ELASTIC, friction=friction, spring=spring)
    nonlinear = non_linear(motor_equation(drive))
    assert tuple(equations.PARAMETER_NAMES[symbol] for symbol in nonlinear) == expected
    if "stribeck" in friction:
        with pytest.raises(RobotError, match=r"stribeck_.* needs an initial value"):
            drive_regressor(motor_equation(drive), drive).evaluate(signals())


def with_own_values(drive: Drive) -> Drive:
    """Return a drive with the values of its own parameters."""
    return drive.with_values({x: VALUES[x] for x in drive.parameter_names if x in VALUES})


MEMORY = replace(
    ELASTIC,
    friction=("viscous", "dahl", "load", "stribeck", "viscous_warm_up", "coulomb_warm_up"),
    spring=("linear", "smooth_dead_zone", "dahl"),
)


@pytest.mark.parametrize("terms", [EVERYTHING, MEMORY], ids=["everything", "memory"])
@pytest.mark.parametrize("equation_of", [motor_equation, spring_equation])
def test_near_given_values_the_equation_is_exact_and_its_columns_are_its_slopes(
    equation_of: object, terms: SeriesElasticDrive
) -> None:
    """zeta - R p is the equation at p_0 for every p_0; R its central difference."""
    drive = with_own_values(terms)
    regressor = drive_regressor(equation_of(drive), drive)  # type: ignore[operator]
    s, p_0 = signals(), np.array([VALUES[name] for name in regressor.names])

    def error(p: Array) -> Array:
        zeta, R = regressor.evaluate(s, dict(zip(regressor.names, p, strict=True)))
        return zeta - R @ p

    R = regressor.evaluate(s)[1]
    for column, name in enumerate(regressor.names):
        step = np.zeros(len(p_0))
        step[column] = 1e-6 * max(1e-2, VALUES[name])
        slope = (error(p_0 - step) - error(p_0 + step)) / (2 * step[column])
        np.testing.assert_allclose(R[:, column], slope, rtol=1e-4, atol=1e-4, err_msg=name)


def test_with_the_bent_parameters_given_the_rest_is_the_same_equation() -> None:
    nonlinear = replace(
        EVERYTHING, friction=("shifted_coulomb", "load", "stribeck"), spring=("linear", "dead_zone")
    )
    drive = with_own_values(nonlinear)
    regressor = drive_regressor(motor_equation(drive), drive)
    assert {"coulomb_shift", "stribeck_speed", "dead_zone"} <= set(regressor.non_linear)
    s = signals(1)
    zeta, R = regressor.evaluate(s)
    zeta_part, R_part = regressor.given(s, {name: VALUES[name] for name in regressor.non_linear})
    error = zeta - R @ [VALUES[name] for name in regressor.names]
    np.testing.assert_allclose(error, zeta_part - R_part @ [VALUES[n] for n in regressor.linear])


# Every term against its formula in the documents, written out again


def friction_by_hand(drive: Drive, s: dict[str, Array], behind_gear: Array) -> Array:
    """Return the friction of the motor [N m], with the torque of the load at the motor."""
    w, v = s["theta_M_dot"], VALUES
    x, cold = s["theta_L"] - 0.3, np.exp(-s["t_log"] / v["warm_up_time"])
    smooth: dict[str, Any] = {
        "viscous": v["viscous_friction"] * w,
        "quadratic": v["quadratic_friction"] * w * np.abs(w),
        "asymmetric": v["asymmetric_friction"] * np.abs(w),
        "viscous_temperature": v["viscous_temperature_slope"] * s["Delta_T"] * w,
        "viscous_warm_up": v["cold_viscous_friction"] * cold * w,
        "offset": v["friction_offset"],
    }
    levels: dict[str, Any] = {
        **dict.fromkeys(DIRECTIONS, v["coulomb_friction"]),
        "stribeck": v["stribeck_friction"] * np.exp(-((w / v["stribeck_speed"]) ** 2)),
        "load": v["load_friction"] * np.abs(behind_gear),
        "coulomb_position": v["coulomb_position_slope"] * x
        + v["coulomb_position_curvature"] * x**2,
        "coulomb_temperature": v["coulomb_temperature_slope"] * s["Delta_T"],
        "coulomb_warm_up": v["cold_coulomb_friction"] * cold,
    }
    assert {*smooth, *levels} == {*PARAMETERS_OF["friction"]}
    direction = next((DIRECTIONS[x] for x in drive.friction if x in DIRECTIONS), np.sign)(w)
    if "dahl" in drive.friction:
        direction = equations.states(s["theta_M"], v["presliding_angle"])[0]
    total = sum(smooth.get(x, 0.0) + levels.get(x, 0.0) * direction for x in drive.friction)
    return np.asarray(total + 0.0 * w)


DIRECTIONS: dict[str, Callable[[Array], Array]] = {
    "coulomb": np.sign,
    "smooth_coulomb": lambda w: np.tanh(w / VALUES["coulomb_width"]),
    "shifted_coulomb": lambda w: np.tanh((w - VALUES["coulomb_shift"]) / VALUES["coulomb_width"]),
    "dahl": np.sign,
}


def force_by_hand(drive: SeriesElasticDrive, s: dict[str, Array]) -> Array:
    """Return the force of the spring, dead zones as a width that is taken away on both sides."""
    v, lever = VALUES, drive.motor_radius / drive.ratio
    stretch = lever * s["theta_M"] - drive.load_radius * s["theta_L"]
    rate = lever * s["theta_M_dot"] - drive.load_radius * s["theta_L_dot"]
    d = stretch - v["deflection_zero"] if drive.is_nonlinear_spring else stretch
    g, rounding = v["dead_zone"], v["dead_zone_rounding"]
    if "dead_zone" in drive.spring:
        d = np.sign(d) * np.maximum(np.abs(d) - g, 0)
    elif "smooth_dead_zone" in drive.spring:
        d = d - (np.hypot(d + g, rounding) - np.hypot(d - g, rounding)) / 2
    terms: dict[str, Any] = {
        "linear": v["stiffness"] * d,
        "cubic": v["cubic_stiffness"] * d**3,
        "fifth": v["fifth_stiffness"] * d**5,
        "damping": v["spring_damping"] * rate,
        "preload": v["spring_offset"] if drive.is_nonlinear_spring else 0.0,
        "dahl": v["hysteresis_force"] * equations.states(stretch, v["hysteresis_deflection"])[0],
        **dict.fromkeys(("dead_zone", "smooth_dead_zone"), 0.0),
    }
    assert {*terms} == {*PARAMETERS_OF["spring"]}
    offset = 0.0 if drive.is_nonlinear_spring else v["spring_offset"]
    return np.asarray(sum(terms[x] for x in drive.spring) + offset)


BESIDE: dict[str, Any] = {
    "parallel_spring": ("linear", "preload"),
    "joint_friction": ("viscous", "coulomb"),
}
WITH_TERMS: dict[str, Drive] = {
    "everything": replace(EVERYTHING, **BESIDE),
    "memory": MEMORY,
    "linear spring on pulleys": SeriesElasticDrive(
        gear_ratio=111.0, motor_pulley_radius_m=0.02, load_pulley_radius_m=0.04
    ),
    # alone in its equation, a stiffness is not divided by a deflection that may be zero
    "known dead zone": replace(
        ELASTIC,
        spring=("linear", "dead_zone"),
        known=("dead_zone", "deflection_zero"),
        nominal={"dead_zone": 0.02, "deflection_zero": 0.05},
    ),
    "known stiffness": replace(ELASTIC, stiffness_Nm_per_rad=80.0, known=("stiffness",)),
    "stiff": replace(
        STIFF,
        friction=("viscous", "coulomb", "offset", "load", "viscous_temperature"),
    ),
    "current": replace(
        STIFF,
        motor_input="current",
        friction=("smooth_coulomb", "load", "coulomb_temperature"),
    ),
    "voltage": StiffDrive(gear_ratio=50.0, motor_input="voltage", friction=("load",)),
}


@pytest.mark.parametrize("name", WITH_TERMS)
def test_equations_are_those_of_the_formulas(name: str) -> None:
    """The residuals of (7) and (4b) [N m], and of what acts beside the drive at the joint."""
    drive, s = with_own_values(WITH_TERMS[name]), signals()
    load, scale = s["tau_L"] / drive.ratio, {"torque": 1.0, "current": 0.05, "voltage": 0.4}
    behind_gear = s["tau_G"] / drive.ratio
    expected: dict[Callable[[Any], equations.DriveEquation], Array] = {}
    if isinstance(drive, SeriesElasticDrive):
        force = force_by_hand(drive, s)
        behind_gear = load = drive.motor_radius / drive.ratio * force
        expected[spring_equation] = s["tau_L"] / drive.load_radius - force
    signal = {"torque": "tau_M", "current": "i_M", "voltage": "u_M"}[drive.motor_input]
    torque = scale[drive.motor_input] * s[signal] - VALUES["motor_inertia"] * s["theta_M_ddot"]
    expected[motor_equation] = torque - friction_by_hand(drive, s, behind_gear) - load
    if drive.parallel_spring:
        beside = 3.0 * s["theta_L"] - 0.7 + 0.2 * s["theta_L_dot"]
        expected[equations.joint_equation] = s["tau_L"] - beside - 0.11 * np.sign(s["theta_L_dot"])
    for equation_of, residual in expected.items():
        regressor = drive_regressor(equation_of(drive), drive)
        zeta, R = regressor.evaluate(s)
        assert not {*regressor.names} & {*drive.known}
        values = [VALUES[parameter] for parameter in regressor.names]
        np.testing.assert_allclose(zeta - R @ values, residual, rtol=1e-9, atol=1e-12)


def test_columns_carry_their_parameter_and_joint() -> None:
    """Through tuples, files and processes, whatever the joint is called."""
    one = ParameterName("stiffness", "left of knee")
    assert one == "stiffness of left of knee"
    assert hash(one) == hash("stiffness of left of knee")
    other = pickle.loads(pickle.dumps(one))
    assert (other, other.quantity, other.owner) == (one, "stiffness", "left of knee")
    assert json.dumps([one]) == '["stiffness of left of knee"]'
    assert one.quantity == ParameterName.of("stiffness").quantity == "stiffness"
    assert readable(ParameterName("viscous_friction", "a_b")) == "viscous friction of a_b"
    assert readable("m_1 + m_2 of both") == "m_1 + m_2 of both"


def test_the_curve_of_friction_that_depends_on_the_position_is_that_at_the_reference() -> None:
    """Reports and plans draw friction over the speed alone."""
    plain = StiffDrive(50.0, viscous_friction_Nms_per_rad=1e-3, coulomb_friction_Nm=0.02)
    along = replace(
        plain,
        friction=("viscous", "coulomb", "coulomb_position"),
        nominal={"coulomb_position_slope": 0.03, "coulomb_position_curvature": -0.02},
        reference_position_rad=0.3,
    )
    speed = np.linspace(-5.0, 5.0, 11)
    torques = [
        friction_curve("knee", drive).torque(speed, np.zeros(11), sign_width=0.1)[0]
        for drive in (plain, along)
    ]
    np.testing.assert_allclose(torques[1], torques[0], rtol=1e-12)
