"""Every term of a drive in a plan: what it asks of motors, its columns, and their gradients."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives import Drive, SeriesElasticDrive, motor_equation, spring_equation
from seaid.drives.equations import joint_equation
from seaid.drives.functions import SMOOTH_SIGNALS, STATES, smooth_columns, spring_inverse
from seaid.errors import ExcitationError
from seaid.excitation import FourierBasis, Limits
from seaid.excitation.basis import matrices
from seaid.excitation.flatness import differentiation, motor_signals
from seaid.excitation.limits import drive_limits, drive_load_gradient, drive_loads
from seaid.excitation.observation_matrix import drive_target, stacked_regressor
from seaid.regressor import base_parameters, joint_torques, motor_regressor
from seaid.regressor.load import load_model
from tests import terms
from tests.excitation.robots import assert_gradient, smooth_motion
from tests.representatives import quick_first
from tests.terms import (
    CUBIC,
    DRY,
    ELASTIC,
    FRICTION,
    FULL,
    HEAVY,
    SMOOTH,
    STIFF,
    TERMS,
    arm,
    arm_of,
    elastic,
    exact_motion,
    slope,
    value_of,
    with_terms,
)

SHARP = np.full(2, 1e-7)
LIMITED = Limits(joint_torque=50.0, motor_torque=0.5, motor_speed=400.0, deflection=0.1)
FLUID = FULL.with_values({"joint_coulomb_friction": 0.0})
"""Dry friction at the joint lets a spring's torque jump, and its motor."""


def test_spring_that_gives_way_is_continued_straight() -> None:
    """k - 3 |k_3| d^2 is a tenth of k at the end; beyond, the force grows by that.

    The corner lies between two values of the table, which are 0.5 % apart.
    """
    spring = spring_inverse(elastic({"cubic_stiffness": -2e3}, spring=("linear", "cubic")))
    end = np.sqrt(0.9 * 120 / 6e3)
    peak = 120 * end - 2e3 * end**3
    assert spring.stretch(np.array([-peak]))[0] == pytest.approx(-end, rel=1e-4)
    assert spring.stretch(np.array([peak + 12 * 0.1]))[0] == pytest.approx(end + 0.1, rel=1e-4)


def test_dead_zone_is_crossed_smoothly_and_whole_outside() -> None:
    spring = spring_inverse(elastic({"dead_zone": 0.01}, spring=("linear", "dead_zone")))
    force = np.linspace(-12, 12, 2401)
    stretch, by_force = spring.stretch(force)
    outside = np.abs(force) > 4
    expected = force / 120 + 0.01 * np.sign(force)
    # The tail of the rounding, gap * 0.6 wide, is a gap^2 / stretch.
    np.testing.assert_allclose(stretch[outside], expected[outside], rtol=3e-3)
    np.testing.assert_allclose(np.gradient(stretch, force)[1:-1], by_force[1:-1], rtol=2e-3)
    assert np.max(by_force) <= 10 / 120


@pytest.mark.parametrize("is_coupled", [False, True], ids=["", "coupled"])
@pytest.mark.parametrize(
    ("one", "two"),
    [(HEAVY, FLUID), (SMOOTH, CUBIC), (FLUID, ELASTIC)],
    ids=["heavy", "smooth", "springs"],
)
def test_loads_obey_the_equations(
    one: Drive, two: Drive, is_coupled: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """(4b), (7), (8) with parallel elements, along a periodic motion differentiated by itself."""
    time, rate_hz = terms.TIME[::2], terms.RATE_HZ / 2
    monkeypatch.setattr(terms, "TIME", time)
    monkeypatch.setattr(terms, "RATE_HZ", rate_hz)
    robot = arm_of(tmp_path, one, two, is_coupled)
    C, states = robot.transmission, exact_motion(arm(tmp_path, STIFF, ELASTIC)).joint_states
    limits = drive_limits(robot, LIMITED, SHARP)
    assert limits is not None
    loads = drive_loads(limits, time, states)
    through = loads[0] @ np.linalg.inv(C)
    signals = motor_signals(limits.drives, states, through, differentiation(time))
    inside, bodies = slice(20, -20), joint_torques(robot, *states)
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        nothing = dict.fromkeys(("tau_L", "tau_M", "i_M", "u_M"), np.zeros(len(time)))
        own = dict(zip(STATES[3:], [state[:, index] for state in states], strict=True))
        parallel = value_of(joint_equation(drive), drive, {**nothing, **own})
        np.testing.assert_allclose(loads[0, :, index], bodies[:, index] + parallel, atol=1e-9)
        seen = dict(zip(SMOOTH_SIGNALS, signals[:, :, index], strict=True))
        angle = seen["theta_M"]
        by_name = {**nothing, **seen, "tau_L": through[:, index]}
        np.testing.assert_allclose(seen["theta_L"], states[0] @ C[index])
        by_name |= {"theta_M_dot": slope(angle), "theta_M_ddot": slope(slope(angle))}
        if isinstance(drive, SeriesElasticDrive):
            error = value_of(spring_equation(drive), drive, by_name)
            assert np.max(np.abs(error)) < 1e-9
        torque = value_of(motor_equation(drive), drive, by_name)
        off = np.abs(loads[1, :, index] - torque)[inside]
        assert np.mean(off > 1e-4 * np.max(np.abs(torque))) < 0.02  # where a sign turns
        np.testing.assert_allclose(loads[2, inside, index], slope(angle)[inside], atol=1e-3)


@pytest.mark.rounding
@pytest.mark.parametrize("is_coupled", [False, True], ids=["", "coupled"])
@pytest.mark.parametrize(("one", "two"), [(HEAVY, FULL), (SMOOTH, CUBIC)], ids=["heavy", "smooth"])
def test_gradient_of_loads_equals_differences(
    one: Drive, two: Drive, is_coupled: bool, tmp_path: Path
) -> None:
    """Along a periodic motion, after the limits went to another process."""
    found = drive_limits(arm_of(tmp_path, one, two, is_coupled), LIMITED, np.full(2, 2.0))
    assert found is not None
    bounds = pickle.loads(pickle.dumps(found))
    basis, time = FourierBasis(3, 4.0), np.linspace(0.0, 3.9, 50)
    position, velocity, acceleration = maps = matrices(basis, time)
    rng = np.random.default_rng(0)
    x = 0.3 * rng.normal(size=(2, basis.size))

    def loads(x: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        states = (position @ x.T, velocity @ x.T, acceleration @ x.T)
        return drive_loads(bounds, time, states), states

    values, states = loads(x)
    kinds, joints = (np.tile(index.ravel(), 4) for index in np.indices((4, 2)))
    instants = rng.integers(0, len(time), len(kinds))
    gradient = drive_load_gradient(bounds, time, states, values, (kinds, instants, joints), maps)
    for _ in range(3):
        direction = rng.normal(size=x.shape)
        plus, minus = (loads(x + sign * 1e-6 * direction)[0] for sign in (1, -1))
        numeric = ((plus - minus) / 2e-6)[kinds, instants, joints]
        by_gradient = np.einsum("mik,ik->m", gradient, direction)
        np.testing.assert_allclose(by_gradient, numeric, rtol=2e-6, atol=1e-8 * abs(numeric).max())


DEAD = elastic(
    {"dead_zone": 0.005, "spring_damping": 0.1}, spring=("linear", "dead_zone", "damping")
)
DAMPED = elastic({"spring_damping": 0.1}, spring=("linear", "damping"))
FIFTH = elastic({"fifth_stiffness": 1e7}, spring=("fifth",))
DRIVEN = elastic({"torque_constant": 0.05, **FRICTION}, motor_input="current", friction=TERMS)


@pytest.mark.parametrize("is_coupled", [False, True], ids=["", "coupled"])
@pytest.mark.parametrize(
    ("one", "two"),
    quick_first([(HEAVY, FULL), (SMOOTH, CUBIC), (STIFF, DEAD), (STIFF, DRIVEN)], 2),
    ids=["heavy", "smooth", "dead", "current"],
)
def test_gradient_of_the_columns_of_all_terms(
    one: Drive, two: Drive, is_coupled: bool, tmp_path: Path
) -> None:
    robot = arm_of(tmp_path, one, two, is_coupled)
    target = drive_target(robot, None, base_parameters(robot), np.full(2, 2.0))
    nonlinear = {"cubic_stiffness", "coulomb_shift", "dead_zone", "torque_constant"}
    assert nonlinear & {name.split(" of ")[0] for name in target.names}
    assert_gradient(target, *smooth_motion(robot, reach=0.2))


@pytest.mark.parametrize("is_coupled", [False, True], ids=["", "coupled"])
def test_columns_times_true_parameters_are_the_torques(is_coupled: bool, tmp_path: Path) -> None:
    """Load rows: the motor torque of a stiff drive, the torque behind a spring; and motor rows."""
    parallel = {"parallel_stiffness": 3.0}
    one = with_terms(STIFF, {"parallel_spring": ("linear",)}, parallel)
    two = elastic({"joint_viscous_friction": 0.1}, joint_friction=("viscous",))
    robot = arm_of(tmp_path, one, two, is_coupled)
    base, model = base_parameters(robot), load_model(robot, base_parameters(robot), ("one", "two"))
    target = drive_target(robot, None, base, SHARP)
    time, states = smooth_motion(robot, 99, 0.2)
    H = stacked_regressor(target, time, states)
    limits = drive_limits(robot, LIMITED, SHARP)
    assert limits is not None
    loads = drive_loads(limits, time, states)
    through = loads[0] @ np.linalg.inv(robot.transmission)
    drives, p = robot.drives, len(base.columns)
    true = np.array([drives[joint].values[name] for joint, name, _ in model.drives])
    absorbed = [drives[joint].values[name] for joint, name, _ in model.absorbed]
    theta = np.concatenate([base.project(robot.parameters), true]) + model.absorption @ absorbed
    names = [*model.expressions, *(f"{name} of {joint}" for joint, name, _ in model.drives)]
    values = dict(zip(names, theta, strict=True))
    values |= {f"{name} of two": value for name, value in drives["two"].values.items()}
    values["spring_offset of two"] = 0.0
    assert set(target.names) <= set(values)
    assert len(target.names) > p
    told = H @ np.array([values[name] for name in target.names])
    told = told.reshape(len(time), 3)[1:-1] / np.sqrt(1000.0 * (time[1] - time[0]))
    signals = motor_signals(limits.drives, states, through, differentiation(time))
    rotor = 1e-5 * signals[2, 1:-1, 1]
    expected = [
        40.0 * loads[1, 1:-1, 0] - 40.0 * 2e-5 * signals[2, 1:-1, 0],
        through[1:-1, 1],
        50.0 * (loads[1, 1:-1, 1] - rotor),
    ]
    np.testing.assert_allclose(told, np.column_stack(expected), rtol=1e-6, atol=1e-6)


def test_current_column_is_what_the_motor_needs(tmp_path: Path) -> None:
    robot = arm(tmp_path, STIFF, DRIVEN)
    motion = exact_motion(robot)
    smooth = smooth_columns(motor_regressor(robot, "two"))
    motor = (motion.motor_position, motion.motor_velocity, motion.motor_acceleration)
    signals = dict(zip(STATES, [s[:, 1] for s in (*motor, *motion.joint_states)], strict=True))
    columns = smooth.evaluate(signals, 1e-9)[0]
    assert motion.motor_current is not None
    place = smooth.names.index("torque_constant")
    np.testing.assert_allclose(columns[:, place], -motion.motor_current[:, 1], atol=1e-9)


@pytest.mark.parametrize(
    ("two", "limits", "words"),
    [
        (DEAD, {"motor_speed": 100.0}, "spring with dead zone: its motor_speed do not follow"),
        (DAMPED, {"deflection": 0.1}, "'two' has a spring with damping: its deflection do not fol"),
        (FIFTH, {"motor_speed": 100.0}, "'two': its spring has no linear stiffness"),
        ({"stiffness_Nm_per_rad": None}, {"deflection": 0.1}, "has no nominal stiffness"),
        ({"viscous_friction_Nms_per_rad": None}, {"motor_torque": 0.1}, "nominal viscous friction"),
        ({"spring": ("linear", "cubic")}, {"motor_speed": 100.0}, "nominal cubic stiffness"),
        ({"friction": (*DRY, "stribeck")}, {"motor_torque": 0.1}, "nominal stribeck friction"),
        ({"parallel_spring": ("linear",)}, {"joint_torque": 1.0}, "nominal parallel stiffness"),
    ],
)
def test_limits_that_need_more_say_what(
    two: Any, limits: dict[str, float], words: str, tmp_path: Path
) -> None:
    two = replace(ELASTIC, **two) if isinstance(two, dict) else two
    with pytest.raises(ExcitationError, match=words) as caught:
        drive_limits(arm(tmp_path, STIFF, two), Limits(**limits), np.ones(2))
    assert "'two'" in str(caught.value)


def test_columns_near_a_value_need_the_value(tmp_path: Path) -> None:
    """The speed of Stribeck friction must be known, of a stiff drive and behind a spring."""
    terms: tuple[str, ...] = ("viscous", "coulomb", "stribeck")
    for one, two, name in (
        (STIFF, replace(ELASTIC, friction=terms), "two"),
        (replace(STIFF, friction=terms), ELASTIC, "one"),
    ):
        robot = arm(tmp_path, one, two)
        with pytest.raises(ExcitationError, match=f"'{name}': its drive has no nominal stribeck"):
            drive_target(robot, None, base_parameters(robot), np.ones(2))
