"""Friction, spring and motor terms: their columns, and equations that are not linear in them."""

import json
import pickle
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives import FrictionTerm, MotorInput, ParameterName, SpringTerm, parameter_of, readable
from seaid.drives.drives import SeriesElasticDrive, StiffDrive, is_dry
from seaid.drives.equations import (
    PARAMETER_NAMES,
    dry_friction,
    joint_equation,
    motor_equation,
    spring_equation,
)
from seaid.drives.functions import friction_curve
from seaid.drives.regressor import drive_regressor, non_linear
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
        *("tau_M", "tau_L", "i_M", "u_M", "tau_G", "t_log"),
    ]
    return {name: rng.normal(size=count) for name in names}


@pytest.mark.parametrize(("friction", "spring", "expected"), CHOICES)
def test_what_is_linear_stays_linear(
    friction: tuple[FrictionTerm, ...], spring: tuple[SpringTerm, ...], expected: tuple[str, ...]
) -> None:
    drive = replace(ELASTIC, friction=friction, spring=spring)
    nonlinear = non_linear(motor_equation(drive))
    assert tuple(PARAMETER_NAMES[symbol] for symbol in nonlinear) == expected
    if "stribeck" in friction:
        with pytest.raises(RobotError, match=r"stribeck_.* needs an initial value"):
            drive_regressor(motor_equation(drive), drive).evaluate(signals())


def with_own_values(drive: SeriesElasticDrive) -> SeriesElasticDrive:
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
    drive = nonlinear.with_values(
        {name: VALUES[name] for name in nonlinear.parameter_names if name in VALUES}
    )
    regressor = drive_regressor(motor_equation(drive), drive)
    assert {"coulomb_shift", "stribeck_speed", "dead_zone"} <= set(regressor.non_linear)
    s = signals(1)
    zeta, R = regressor.evaluate(s)
    zeta_part, R_part = regressor.given(s, {name: VALUES[name] for name in regressor.non_linear})
    error = zeta - R @ [VALUES[name] for name in regressor.names]
    np.testing.assert_allclose(error, zeta_part - R_part @ [VALUES[n] for n in regressor.linear])


@pytest.mark.parametrize("term", get_args(FrictionTerm))
def test_dry_terms_are_those_that_act_against_the_motion(term: FrictionTerm) -> None:
    drive = replace(STIFF, friction=(term,))
    assert is_dry(drive) == (dry_friction(drive) != 0)


def test_friction_under_load_takes_the_direction_of_the_coulomb_friction() -> None:
    drive = replace(STIFF, friction=("smooth_coulomb", "load")).with_values(
        {"coulomb_friction": 0.1, "coulomb_width": 2.0, "load_friction": 0.05}
    )
    s = signals()
    R = drive_regressor(motor_equation(drive), drive).evaluate(s)[1]
    smooth = np.tanh(s["theta_M_dot"] / 2.0)
    np.testing.assert_allclose(R[:, 0], smooth)
    np.testing.assert_allclose(R[:, 2], np.abs(s["tau_G"]) / 50 * smooth)
    assert dry_friction(drive) == 0
    sharp = replace(drive, friction=("coulomb", "load"), nominal={})
    R = drive_regressor(motor_equation(sharp), sharp).evaluate(s)[1]
    np.testing.assert_allclose(R[:, 1], np.abs(s["tau_G"]) / 50 * np.sign(s["theta_M_dot"]))


@pytest.mark.parametrize("motor_input", ["torque", "current", "voltage"])
@pytest.mark.parametrize("friction", [("viscous",), ("viscous", "coulomb", "load"), ("load",)])
def test_a_row_balances_the_torque_at_the_motor(
    motor_input: MotorInput, friction: tuple[FrictionTerm, ...]
) -> None:
    """The load's torque counts 1/N there, whatever scale Algorithm 1 leaves."""
    drive = replace(STIFF, motor_input=motor_input, friction=friction)
    regressor = drive_regressor(motor_equation(drive), drive)
    s = signals()
    more = {**s, "tau_L": s["tau_L"] + 1.0}
    change = regressor.evaluate(more)[0] - regressor.evaluate(s)[0]
    np.testing.assert_allclose(change, -1 / 50, rtol=1e-9)


def test_dead_zone_takes_its_width_away_on_both_sides() -> None:
    drive = replace(ELASTIC, spring=("linear", "dead_zone")).with_values(
        {"stiffness": 10.0, "dead_zone": 0.1, "deflection_zero": 0.02}
    )
    s = {"theta_M": 50 * np.array([-0.38, -0.05, 0.1, 0.42]), "theta_L": np.zeros(4)}
    s["tau_L"] = np.zeros(4)
    regressor = drive_regressor(spring_equation(drive), drive)
    zeta, R = regressor.evaluate(s)
    values = [drive.values[name] for name in regressor.names]
    np.testing.assert_allclose(R @ values - zeta, [-3.0, 0.0, 0.0, 3.0], atol=1e-12)


@pytest.mark.parametrize(
    ("motor_input", "signal", "name"),
    [("current", "i_M", "torque_constant"), ("voltage", "u_M", "voltage_constant")],
)
def test_current_or_voltage_has_a_constant_as_its_column(
    motor_input: MotorInput, signal: str, name: str
) -> None:
    drive = replace(STIFF, motor_input=motor_input)
    regressor = drive_regressor(motor_equation(drive), drive)
    s = signals()
    zeta, R = regressor.evaluate(s)
    np.testing.assert_array_equal(R[:, regressor.names.index(name)], -s[signal])
    np.testing.assert_allclose(zeta, -s["tau_L"] / 50 - 1e-5 * s["theta_M_ddot"])


def test_what_acts_beside_the_drive_has_columns_at_the_joint() -> None:
    drive = replace(
        ELASTIC, parallel_spring=("linear", "preload"), joint_friction=("viscous", "coulomb")
    )
    regressor = drive_regressor(joint_equation(drive), drive)
    assert regressor.units == ("N m/rad", "N m", "N m s/rad", "N m")
    s = signals()
    zeta, R = regressor.evaluate(s)
    np.testing.assert_array_equal(zeta, s["tau_L"])
    speed = s["theta_L_dot"]
    np.testing.assert_array_equal(
        R, np.column_stack([s["theta_L"], np.ones(40), speed, np.sign(speed)])
    )


def test_a_known_parameter_has_no_column() -> None:
    drive = replace(ELASTIC, stiffness_Nm_per_rad=80.0, known=("stiffness",))
    regressor = drive_regressor(motor_equation(drive), drive)
    assert regressor.names == ("viscous_friction", "coulomb_friction", "spring_offset")
    free = replace(drive, known=())
    s = signals()
    zeta, R = drive_regressor(motor_equation(free), free).evaluate(s)
    np.testing.assert_allclose(regressor.evaluate(s)[0], zeta - 80.0 * R[:, 2])


def test_columns_carry_their_parameter_and_joint() -> None:
    """Through tuples, files and processes, whatever the joint is called."""
    one = ParameterName("stiffness", "left of knee")
    assert one == "stiffness of left of knee"
    assert hash(one) == hash("stiffness of left of knee")
    other = pickle.loads(pickle.dumps(one))
    assert (other, other.quantity, other.owner) == (one, "stiffness", "left of knee")
    assert json.dumps([one]) == '["stiffness of left of knee"]'
    assert parameter_of(one) == parameter_of("stiffness") == "stiffness"
    assert readable(ParameterName("viscous_friction", "a_b")) == "viscous friction of a_b"
    assert readable("m_1 + m_2 of both") == "m_1 + m_2 of both"


def test_an_equation_in_one_parameter_is_not_divided_by_a_motion_that_may_be_zero() -> None:
    """A known dead zone: within it the spring has no force, whatever its stiffness."""
    drive = SeriesElasticDrive(
        gear_ratio=1.0,
        spring=("linear", "dead_zone"),
        known=("dead_zone", "deflection_zero"),
        nominal={"dead_zone": 0.1, "deflection_zero": 0.0},
    )
    stretch = np.array([-0.3, -0.1, 0.0, 0.05, 0.1, 0.2])
    zeta, R = drive_regressor(spring_equation(drive), drive).evaluate(
        {"theta_M": stretch, "theta_L": np.zeros(6), "tau_L": np.arange(6.0)}
    )
    np.testing.assert_allclose(R[:, 0], [-0.2, 0.0, 0.0, 0.0, 0.0, 0.1], atol=1e-15)
    np.testing.assert_allclose(zeta, np.arange(6.0))


def test_the_curve_of_friction_that_depends_on_the_position_is_that_at_the_reference() -> None:
    """Reports and plans draw friction over the speed alone."""
    plain = replace(
        STIFF,
        friction=("viscous", "coulomb"),
        viscous_friction_Nms_per_rad=1e-3,
        coulomb_friction_Nm=0.02,
    )
    further = {"coulomb_position_slope": 0.03, "coulomb_position_curvature": -0.02}
    along = replace(
        plain,
        friction=(*plain.friction, "coulomb_position"),
        nominal=further,
        reference_position_rad=0.3,
    )
    speed = np.linspace(-5.0, 5.0, 11)
    torques = [
        friction_curve("knee", drive).torque(speed, np.zeros(11), sign_width=0.1)[0]
        for drive in (plain, along)
    ]
    np.testing.assert_allclose(torques[1], torques[0], rtol=1e-12)
