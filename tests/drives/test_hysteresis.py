"""The law of hysteresis: against its differential equation, known loops, and its limit."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from seaid._arrays import Array
from seaid.drives.drives import SeriesElasticDrive, StiffDrive
from seaid.drives.equations import motor_equation, spring_force
from seaid.drives.functions import friction_curve, smooth_columns, spring_curve
from seaid.drives.regressor import drive_regressor
from seaid.drives.symbols import Dahl, after_travel, states

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
    exact = solve_ivp(dahl_rate, (0, 6), [0.0], t_eval=TIME, rtol=1e-8, atol=1e-8, max_step=1e-3)
    np.testing.assert_allclose(states(position(TIME), WIDTH)[0], exact.y[0], atol=3e-3)


def test_a_step_after_another_is_the_whole() -> None:
    x, z = position(TIME), 0.0
    whole = states(x, WIDTH)[0]
    for place, step in enumerate(np.diff(x).tolist()):
        z = after_travel(z, step, WIDTH)
        assert z == pytest.approx(whole[place + 1], abs=1e-9)


def test_the_slope_by_the_width_is_the_difference() -> None:
    x = position(TIME)
    more, less = (states(x, WIDTH + step)[0] for step in (1e-6, -1e-6))
    slope, found = (more - less) / 2e-6, states(x, WIDTH)[1]
    agree = np.abs(slope - found) < 1e-4 * (1 + np.abs(found))
    assert np.mean(agree) > 0.9999


def test_speed_and_rests_do_not_matter() -> None:
    x = np.concatenate([np.linspace(0, 0.5, 200), np.linspace(0.5, -0.2, 300)])
    slow = np.concatenate([np.repeat(np.linspace(0, 0.5, 900), 2), np.linspace(0.5, -0.2, 40)])
    assert states(x, WIDTH)[0][-1] == pytest.approx(states(slow, WIDTH)[0][-1])
    assert not np.any(states(np.zeros(5), WIDTH))


def test_the_area_of_a_loop() -> None:
    """Over +-A it is the integral of its exponentials."""
    A = 0.3
    cycle = np.concatenate([np.linspace(-A, A, 4001), np.linspace(A, -A, 4001)])
    x = np.tile(cycle, 3)
    area = float(abs(np.trapezoid(states(x, WIDTH)[0][-8002:], cycle)))
    # up: z = 1 - (1 + z_A) e^(-(x + A)/w), with z_A = tanh(A / w) at the ends
    end = np.tanh(A / WIDTH)
    up = 2 * A - (1 + end) * WIDTH * (1 - np.exp(-2 * A / WIDTH))
    assert area == pytest.approx(2 * up, rel=1e-3)


def test_a_narrow_law_is_the_direction_of_motion() -> None:
    x = position(TIME)
    direction = np.sign(np.diff(x, prepend=0))
    assert states(x, 1e-9)[0][1:] == pytest.approx(direction[1:])


def test_the_law_is_data_of_an_equation() -> None:
    x, w = sp.symbols("x w")
    expression = Dahl(x, w) + Dahl(x, w).diff(w)
    assert pickle.loads(pickle.dumps(expression)) == expression
    assert Dahl(x, w).diff(x).has(sp.Derivative)  # what follows the travel has no such slope


DAHL = StiffDrive(gear_ratio=50.0, friction=("viscous", "dahl", "load")).with_values(
    {"viscous_friction": 1e-3, "coulomb_friction": 0.1, "load_friction": 0.1, "presliding_angle": 1}
)


def test_plans_see_the_loop_of_wide_motions() -> None:
    """Columns and curve of a plan are those of sharp friction, without the width."""
    sharp = DAHL.without_memory()
    assert sharp.friction == ("viscous", "coulomb", "load")
    mine, other = (
        smooth_columns(drive_regressor(motor_equation(one), one)) for one in (DAHL, sharp)
    )
    assert mine.names == other.names
    w, load = np.linspace(-5, 5, 11), np.linspace(2, 3, 11)
    given = {"theta_M_dot": w, "theta_M_ddot": w, "tau_G": load, "tau_M": w, "tau_L": load}
    for got, wanted in zip(mine.evaluate(given, 0.1), other.evaluate(given, 0.1), strict=True):
        np.testing.assert_allclose(got, wanted)
    mine_curve, other_curve = (
        friction_curve("knee", one).torque(w, load, sign_width=0.1)[0] for one in (DAHL, sharp)
    )
    np.testing.assert_allclose(mine_curve, other_curve)


def test_plans_see_no_hysteresis_of_springs() -> None:
    plain = SeriesElasticDrive(gear_ratio=50.0, stiffness_Nm_per_rad=100.0)
    drive = replace(plain, spring=("linear", "dahl"))
    mine, other = (
        smooth_columns(drive_regressor(motor_equation(one), one)) for one in (drive, plain)
    )
    assert (mine.names, mine.missing) == (other.names, other.missing)


def test_the_curve_of_a_spring_is_the_middle_of_its_loop() -> None:
    plain = SeriesElasticDrive(gear_ratio=50.0, stiffness_Nm_per_rad=100.0)
    drive = replace(plain, spring=("linear", "dahl")).with_values(
        {"hysteresis_force": 2.0, "hysteresis_deflection": 0.01}
    )
    x = np.linspace(-0.1, 0.1, 5)
    np.testing.assert_allclose(spring_curve(drive).force(x), 100 * x)
    assert drive.without_memory() == plain


def test_the_sharp_dead_zone_is_the_limit_of_the_smooth_one() -> None:
    smooth = SeriesElasticDrive(
        gear_ratio=1.0, stiffness_Nm_per_rad=1.0, spring=("linear", "smooth_dead_zone")
    )
    sharp = replace(smooth, spring=("linear", "dead_zone")).with_values({"dead_zone": 0.02})
    x = np.linspace(-0.1, 0.1, 101)
    for rounding, most in ((1e-2, 5e-3), (1e-3, 5e-4), (0.0, 1e-15)):
        drive = smooth.with_values({"dead_zone": 0.02, "dead_zone_rounding": rounding})
        error = np.max(np.abs(spring_curve(drive).force(x) - spring_curve(sharp).force(x)))
        assert error <= most
    assert spring_force(sharp) != spring_force(smooth)


def test_stiffness_between_the_encoders_keeps_the_loop() -> None:
    """A loop of force F_H over d_s is one of F_H / (1 + c k) over (1 + c k) d_s."""
    drive = SeriesElasticDrive(
        gear_ratio=50.0,
        stiffness_Nm_per_rad=100.0,
        gear_stiffness_Nm_per_rad=400.0,
        spring=("linear", "dahl"),
        nominal={"hysteresis_force": 2.0, "hysteresis_deflection": 0.01},
    )
    assert drive.values["hysteresis_force"] == pytest.approx(2.0 / 1.25)
    assert drive.values["hysteresis_deflection"] == pytest.approx(0.01 * 1.25)
    assert drive.with_values(drive.values).own_values == pytest.approx(drive.own_values)
