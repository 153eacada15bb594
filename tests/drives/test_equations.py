"""The drive's equations, and the regressor derived from them by Algorithm 1."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy as sp

from seaid._arrays import Array
from seaid.drives.drives import Drive, SeriesElasticDrive, StiffDrive
from seaid.drives.equations import (
    F_C,
    I_M,
    F_v,
    N,
    extra_torque,
    f_0,
    k,
    motor_equation,
    r_L,
    r_M,
    spring_equation,
    t,
    tau_L,
    tau_M,
    theta_L,
    theta_M,
)
from seaid.drives.regressor import DriveRegressor, drive_regressor
from seaid.errors import RobotError, SymbolicError

LINEAR = SeriesElasticDrive(
    gear_ratio=111.0,
    motor_inertia_kg_m2=3.4e-6,
    motor_pulley_radius_m=0.020,
    load_pulley_radius_m=0.040,
)
ROTARY = SeriesElasticDrive(gear_ratio=762.0, motor_inertia_kg_m2=2e-6)
STIFF = StiffDrive(gear_ratio=86.0, friction=("viscous", "coulomb", "offset"))
speed, acceleration = theta_M.diff(t), theta_M.diff(t, 2)
c = sp.Symbol("c")


def motor_regressor(drive: Drive) -> DriveRegressor:
    return drive_regressor(motor_equation(drive), drive)


def signals(seed: int = 0, count: int = 20) -> dict[str, Array]:
    names = ("theta_M", "theta_M_dot", "theta_M_ddot", "theta_L", "theta_L_dot", "theta_L_ddot")
    rng = np.random.default_rng(seed)
    return {name: rng.normal(size=count) for name in (*names, "tau_M", "tau_L")}


def same(left: Any, right: Any) -> bool:
    """True for matrices whose difference expands to nothing."""
    return all(sp.expand(entry) == 0 for entry in sp.Matrix(left) - sp.Matrix(right))


# (7) and (8) to (10), symbol for symbol


def test_motor_equation_is_7_with_the_force_of_unknown_zeros() -> None:
    force = k * (r_M / N * theta_M - r_L * theta_L) + f_0  # (3)
    seven = I_M * acceleration + F_v * speed + F_C * sp.sign(speed) + r_M / N * force - tau_M
    assert sp.expand(motor_equation(LINEAR).expression - seven) == 0
    assert sp.expand(motor_equation(ROTARY).expression - seven) == 0


def test_7_gives_exactly_the_columns_of_10() -> None:
    form = motor_regressor(LINEAR)
    deflection = r_M / N * theta_M - r_L * theta_L
    assert form.names == ("viscous_friction", "coulomb_friction", "stiffness", "spring_offset")
    assert same([form.zeta], [tau_M - I_M * acceleration])
    assert form.units == ("N m s/rad", "N m", "N/m", "N")
    assert motor_regressor(ROTARY).units == ("N m s/rad", "N m", "N m/rad", "N m")
    assert same([form.row], [[speed, sp.sign(speed), r_M / N * deflection, r_M / N]])


def test_unknown_rotor_inertia_becomes_a_column() -> None:
    form = motor_regressor(replace(LINEAR, motor_inertia_kg_m2=None))
    assert same([form.zeta], [tau_M])
    assert form.names[4] == "motor_inertia"
    assert form.row[4] == acceleration


def test_spring_equation_is_4b_and_tells_stiffness_and_offset() -> None:
    regressor = drive_regressor(spring_equation(LINEAR), LINEAR)
    assert same([regressor.zeta], [tau_L / r_L])
    assert same([regressor.row], [[r_M / N * theta_M - r_L * theta_L, 1]])
    assert regressor.names == ("stiffness", "spring_offset")
    assert regressor.units == ("N/m", "N")


def test_stiff_drive_has_the_joint_torque_behind_its_gear() -> None:
    form = motor_regressor(STIFF)
    friction = ("viscous_friction", "coulomb_friction", "friction_offset")
    assert form.names == (*friction, "motor_inertia")
    assert form.units == ("N m s/rad", "N m", "N m", "kg m^2")
    assert same([form.zeta], [tau_M - tau_L / N])
    assert same([form.row], [[speed, sp.sign(speed), 1, acceleration]])


# Over samples


def test_true_parameters_give_the_motor_torque_of_the_equation() -> None:
    s = signals(4)
    truth = np.array([8e-5, 4.56e-3, 83008.0, 12.0])
    gear = 0.020 / 111.0
    force = 83008.0 * (gear * s["theta_M"] - 0.040 * s["theta_L"]) + 12.0
    friction = 8e-5 * s["theta_M_dot"] + 4.56e-3 * np.sign(s["theta_M_dot"])
    s["tau_M"] = 3.4e-6 * s["theta_M_ddot"] + friction + gear * force
    zeta, R = motor_regressor(LINEAR).evaluate(s)
    np.testing.assert_allclose(R @ truth, zeta, rtol=1e-11, atol=1e-14)


# A user's own term: its column and its name, and nothing else changes


@pytest.mark.parametrize("text", ["c*theta_M'**3", "c*theta_M_dot**3", "c * theta_M' ^ 3"])
@pytest.mark.parametrize("drive", [LINEAR, StiffDrive(gear_ratio=5.0, friction=())])
def test_an_extra_term_gets_its_column_and_name_and_leaves_the_rest(
    drive: Drive, text: str
) -> None:
    s = signals()
    plain, more = motor_regressor(drive), motor_regressor(replace(drive, extra_terms=(text,)))
    zeta, R = more.evaluate(s)
    assert more.names == (*plain.names, "c")
    assert more.units == (*plain.units, "N m/(theta_M_dot**3)")
    np.testing.assert_array_equal(zeta, plain.evaluate(s)[0])
    np.testing.assert_array_equal(R[:, :-1], plain.evaluate(s)[1])
    np.testing.assert_allclose(R[:, -1], s["theta_M_dot"] ** 3, rtol=1e-14)


def test_several_extra_terms_come_after_the_named_ones_in_the_order_of_their_names() -> None:
    """They may name functions, numbers and known values; one without a parameter is known."""
    terms = (
        "d*cos(theta_M)",
        "a*abs(theta_M')*theta_M'",
        "b*tanh(100*theta_L_dot)",
        "e*N*theta_M''",
        "0.5*r_M*theta_L",
    )
    s = signals()
    regressor = motor_regressor(replace(LINEAR, extra_terms=terms))
    zeta, R = regressor.evaluate(s)
    assert regressor.names[4:] == ("a", "b", "d", "e")
    np.testing.assert_allclose(R[:, 4], np.abs(s["theta_M_dot"]) * s["theta_M_dot"], rtol=1e-14)
    np.testing.assert_allclose(R[:, 5], np.tanh(100 * s["theta_L_dot"]), rtol=1e-14)
    np.testing.assert_allclose(R[:, 6], np.cos(s["theta_M"]), rtol=1e-14)
    np.testing.assert_allclose(R[:, 7], 111.0 * s["theta_M_ddot"], rtol=1e-14)
    known = s["tau_M"] - 3.4e-6 * s["theta_M_ddot"] - 0.5 * 0.020 * s["theta_L"]
    np.testing.assert_allclose(zeta, known, rtol=1e-13)


@pytest.mark.parametrize("name", ["E", "I", "S", "Q", "beta", "gamma", "zeta", "x_1", "Fv"])
def test_any_other_name_is_a_parameter_even_one_that_sympy_knows(name: str) -> None:
    regressor = motor_regressor(replace(LINEAR, extra_terms=(f"{name}*theta_M'**3",)))
    assert regressor.names[-1] == name


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("c*", "is not an expression"),
        ("2 c", "is not an expression"),
        ("", "is not an expression"),
        ("c/0", "is not an expression"),
        ("c*theta_M.diff", r"is not an expression: it may have names, numbers and \+ - \* /"),
        ("__import__('os')", "is not an expression: it may have names"),
        ("\U0001d41eval", "is not an expression: it may have names"),
        ("9**9**9", r"has a power above 20"),
        ("abs*theta_M'", "the name 'abs' is that of a function; choose another"),
        ("c*thetaM_dot", r"no state is named 'thetaM_dot'; did you mean 'theta_M_dot'\? allowed:"),
        ("c*tau_L", "no state is named 'tau_L'"),
        ("c*t", "no state is named 't'; allowed: theta_M, theta_M_dot"),
        ("c*sgn(theta_M')", r"no function is named 'sgn'; did you mean 'sign'\? allowed: abs"),
        ("stiffness*theta_M'", "the name 'stiffness' is taken; choose another"),
        ("lambda*theta_M'", "the name 'lambda' is taken; choose another"),
    ],
)
def test_extra_term_that_cannot_be_read_says_why(text: str, words: str) -> None:
    with pytest.raises(RobotError, match=words) as caught:
        motor_equation(replace(LINEAR, extra_terms=(text,)))
    assert f"extra term '{text}'" in str(caught.value)


# Extra terms in a simulation


def test_extra_terms_with_numbers_are_a_torque_for_the_simulation() -> None:
    torque = extra_torque(replace(LINEAR, extra_terms=("2e-6*theta_M'**3", "0.1*sin(theta_L)")))
    assert torque(0.3, 20.0, 0.7, 0.0) == pytest.approx(2e-6 * 8000 + 0.1 * np.sin(0.7), rel=1e-14)
    assert extra_torque(LINEAR)(1.0, 2.0, 3.0, 4.0) == 0
    torque = extra_torque(replace(LINEAR, extra_terms=("0.1*abs(exp(theta_M'*theta_L'))",)))
    assert torque(0.0, 2.0, 0.0, 0.5) == pytest.approx(0.1 * np.e, rel=1e-14)
    with pytest.raises(RobotError, match="no value for a, c: write numbers to simulate them"):
        extra_torque(replace(LINEAR, extra_terms=("c*theta_M'**3 + a*theta_L",)))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("exp(theta_M'**3)", "have no value at theta_M = 1, theta_M_dot = 20, .*: math range"),
        ("1/theta_L", "have no value at .*theta_L = 0, .*: "),
        ("sqrt(-theta_M)", "have no value at .*: "),
        ("(-theta_M)**(1/3)", "have no value at .*: "),
    ],
)
def test_extra_terms_without_a_value_at_a_state_say_where(text: str, words: str) -> None:
    torque = extra_torque(replace(LINEAR, extra_terms=(text,)))
    with pytest.raises(RobotError, match=words):
        torque(1.0, 20.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("term", "words"),
    [
        ("c*cos(1e9*theta_M)", r"give .* as a signal of its own"),
        ("exp(c*theta_M')", "c"),
    ],
)
def test_terms_that_have_no_linear_column_are_refused(term: str, words: str) -> None:
    """Multiples that no polynomial has, and a parameter inside a function."""
    with pytest.raises(SymbolicError, match=words):
        motor_regressor(replace(LINEAR, extra_terms=(term,)))


def test_a_sharp_exponential_is_a_column_of_its_own() -> None:
    term = "c*exp(-1e20*theta_M)/(1+exp(-1e20*theta_M))"
    regressor = motor_regressor(replace(LINEAR, extra_terms=(term,)))
    given = signals(seed=1) | {"theta_M": np.linspace(-2e-20, 2e-20, 20)}
    column = regressor.evaluate(given)[1][:, regressor.names.index("c")]
    np.testing.assert_allclose(column, 1 / (1 + np.exp(1e20 * given["theta_M"])), rtol=1e-12)
