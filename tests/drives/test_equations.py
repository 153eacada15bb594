"""The drive's equations, and the regressor derived from them by Algorithm 1."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy as sp

from seaid._arrays import Array
from seaid.drives import (
    Drive,
    SeriesElasticDrive,
    StiffDrive,
    equations,
    motor_equation,
    spring_equation,
)
from seaid.drives.equations import PARAMETER_NAMES, t, theta_M
from seaid.drives.functions import OfState, drive_functions
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


FRICTION = ("viscous_friction", "coulomb_friction")
SPRING = ("stiffness", "spring_offset")
OFFSET, ROTOR = "friction_offset", "motor_inertia"
NO_ROTOR = replace(ROTARY, friction=("coulomb",), motor_inertia_kg_m2=None)
COLUMNS: list[tuple[Any, Drive, tuple[str, ...], str]] = [
    (motor_equation, LINEAR, (*FRICTION, *SPRING), "N m s/rad, N m, N/m, N"),
    (motor_equation, NO_ROTOR, ("coulomb_friction", *SPRING, ROTOR), "N m, N m/rad, N m, kg m^2"),
    (motor_equation, STIFF, (*FRICTION, OFFSET, ROTOR), "N m s/rad, N m, N m, kg m^2"),
    (spring_equation, LINEAR, SPRING, "N/m, N"),
]


@pytest.mark.parametrize(("equation_of", "drive", "names", "units"), COLUMNS)
def test_columns_have_the_names_and_units_of_their_parameters(
    equation_of: Any, drive: Drive, names: tuple[str, ...], units: str
) -> None:
    """Friction has the terms that the drive names, and an unknown rotor inertia is a column.

    Their values are those of formulas, in test_terms.py.
    """
    form = drive_regressor(equation_of(drive), drive)
    assert (form.names, ", ".join(form.units)) == (names, units)


# A user's own term: its column and its name, and nothing else changes


@pytest.mark.parametrize("drive", [LINEAR, StiffDrive(gear_ratio=111.0, friction=())])
def test_extra_terms_get_columns_in_the_order_of_their_names_and_leave_the_rest(
    drive: Drive,
) -> None:
    """They may name functions, numbers and known values; one without a parameter is known.

    Any other name is a parameter, even one that sympy knows.
    """
    columns: dict[str, Callable[..., Array]] = {
        "E*abs(theta_M')*theta_M'": lambda s: np.abs(s["theta_M_dot"]) * s["theta_M_dot"],
        "I*tanh(100*theta_L_dot)": lambda s: np.tanh(100 * s["theta_L_dot"]),
        "beta*cos(theta_M)": lambda s: np.cos(s["theta_M"]),
        "c * theta_M' ^ 3": lambda s: s["theta_M_dot"] ** 3,
        "d*theta_M_dot**3": lambda s: s["theta_M_dot"] ** 3,
        "zeta*N*theta_M''": lambda s: 111.0 * s["theta_M_ddot"],
    }
    s, plain = signals(), motor_regressor(drive)
    more = motor_regressor(replace(drive, extra_terms=(*reversed(columns), "0.5*theta_L")))
    zeta, R = more.evaluate(s)
    assert more.names == (*plain.names, "E", "I", "beta", "c", "d", "zeta")
    assert more.units[-3:-1] == ("N m/(theta_M_dot**3)",) * 2
    np.testing.assert_allclose(zeta, plain.evaluate(s)[0] - 0.5 * s["theta_L"], rtol=1e-13)
    np.testing.assert_array_equal(R[:, :-6], plain.evaluate(s)[1])
    expected = np.column_stack([column(s) for column in columns.values()])
    np.testing.assert_allclose(R[:, -6:], expected, rtol=1e-14)


def read(text: str) -> object:
    return motor_equation(replace(LINEAR, extra_terms=(text,)))


def fitted(text: str) -> object:
    return motor_regressor(replace(LINEAR, extra_terms=(text,)))


def simulated(*terms: str) -> OfState:
    return drive_functions(StiffDrive(gear_ratio=86.0, friction=(), extra_terms=terms)).friction


def at_a_state(text: str) -> object:
    return simulated(text)(1.0, 20.0, 0.0, 0.0, 0.0)


REFUSED: list[tuple[Callable[[str], object], str, str]] = [
    (read, "c*", "is not an expression"),
    (read, "c*theta_M.diff", r"is not an expression: it may have names, numbers and \+ - \* /"),
    (read, "abs*theta_M'", "the name 'abs' is that of a function; choose another"),
    (read, "c*thetaM_dot", r"no state is named 'thetaM_dot'; did you mean 'theta_M_dot'\? allow"),
    (read, "c*tau_L", "no state is named 'tau_L'"),
    (read, "c*t", "no state is named 't'; allowed: theta_"),
    (read, "c*sgn(theta_M')", r"no function is named 'sgn'; did you mean 'sign'\? allowed: abs"),
    (read, "stiffness*theta_M'", "the name 'stiffness' is taken; choose another"),
    (fitted, "exp(c*theta_M')", r"unknown c is inside exp\(c"),
    (simulated, "c*theta_M'**3 + a*theta_L", "no value for a, c: write numbers to simulate them"),
    (at_a_state, "exp(theta_M'**3)", "no value at theta_M = 1, theta_M_dot = 20, .*: math range"),
    (at_a_state, "1/theta_L", "have no value at .*theta_L = 0, .*: "),
    (at_a_state, "sqrt(-theta_M)", "have no value at .*: "),
    (at_a_state, "(-theta_M)**(1/3)", "have no value at .*: "),
]


@pytest.mark.parametrize(("use", "text", "words"), REFUSED)
def test_an_extra_term_that_cannot_be_used_says_why(
    use: Callable[[str], object], text: str, words: str
) -> None:
    """It cannot be read, has a parameter where there can be none, or no value at a state."""
    with pytest.raises((RobotError, SymbolicError), match=words) as caught:
        use(text)
    assert use is not read or f"extra term '{text}'" in str(caught.value)


def test_extra_terms_with_numbers_are_a_torque_for_the_simulation() -> None:
    torque = simulated("2e-6*theta_M'**3", "0.1*sin(theta_L)")(0.3, 20.0, 0.7, 0.0, 0.0)
    assert torque == pytest.approx(2e-6 * 8000 + 0.1 * np.sin(0.7), rel=1e-14)
    torque = simulated("0.1*abs(exp(theta_M'*theta_L'))")(0.0, 2.0, 0.0, 0.5, 0.0)
    assert torque == pytest.approx(0.1 * np.e, rel=1e-14)


def test_a_sharp_exponential_is_a_column_of_its_own() -> None:
    term = "c*exp(-1e20*theta_M)/(1+exp(-1e20*theta_M))"
    regressor = motor_regressor(replace(LINEAR, extra_terms=(term,)))
    given = signals(seed=1) | {"theta_M": np.linspace(-2e-20, 2e-20, 20)}
    column = regressor.evaluate(given)[1][:, regressor.names.index("c")]
    np.testing.assert_allclose(column, 1 / (1 + np.exp(1e20 * given["theta_M"])), rtol=1e-12)


def test_symbols_of_the_equations_are_those_of_the_parameters() -> None:
    """The others are known values: ratio, radii, reference position, nominal delay and scale."""
    symbols = {value for value in vars(equations).values() if isinstance(value, sp.Symbol)}
    assert set(PARAMETER_NAMES) <= symbols
    others = {str(symbol) for symbol in symbols - set(PARAMETER_NAMES)}
    assert others == {"t", "N", "r_M", "r_L", "q_0", "T_0", "s_0"}
