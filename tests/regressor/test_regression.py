"""Regressions: rows, columns, and what each derivative says."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives import SeriesElasticDrive
from seaid.errors import LogError
from seaid.legged import load_robot
from seaid.log import Motion, row_samples, standstill
from seaid.regressor import (
    actuator_regression,
    base_parameters,
    joint_torques,
    load_regression,
    motor_regressor,
)
from seaid.regressor.load import LoadModel, load_model, with_gear_torque
from seaid.regressor.regression import (
    actuator_columns,
    input_signals,
    is_linear,
    signals,
    spring_regressor,
    stacked,
)
from seaid.robot import Robot
from tests.experiments import ELASTIC, TEST_MASS, arm, arm_motion, leg, leg_motion, true_value

LEG = leg(TEST_MASS)


def motion_between(motion: Motion, first: int, last: int) -> Motion:
    fields = {
        name: value[first:last]
        for name, value in vars(motion).items()
        if isinstance(value, np.ndarray)
    }
    return replace(motion, **fields)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def motion() -> Motion:
    """Return half a second of the leg's true motion, all joints moving."""
    return motion_between(leg_motion(TEST_MASS), 2000, 2500)


def true_springs(robot: Robot) -> dict[str, Array]:
    return {
        joint: np.array([true_value(robot, joint, "stiffness"), 0.0])
        for joint in robot.elastic_joints
    }


@pytest.fixture(scope="module")
def model() -> LoadModel:
    return load_model(LEG, base_parameters(LEG), LEG.joint_names)


def test_what_stands_still_has_no_direction(motion: Motion) -> None:
    """The rounding of a motor at rest has a sign of the processor's; friction must not have it."""
    rest = np.random.default_rng(0).normal(0.0, 1e-10, (len(motion.time), LEG.n))
    still = replace(motion, motor_velocity=rest, joint_velocity=rest)
    for joint in LEG.joint_names:
        by_name = signals(LEG, still, LEG.index(joint))
        assert not np.any(by_name["theta_M_dot"])
        assert not np.any(by_name["theta_L_dot"])
        moving = signals(LEG, motion, LEG.index(joint))["theta_M_dot"]
        assert np.array_equal(moving, motion.motor_velocity[:, LEG.index(joint)])
    regressor, _, columns = actuator_columns(LEG, still, "knee_pitch")
    assert not np.any(columns[:, regressor.names.index("coulomb_friction")])


def test_a_deflection_and_a_delayed_command_are_in_the_signals(motion: Motion) -> None:
    """The joint is where motor and deflection put it; a command T before has the slope T later."""
    time, index, total = motion.time[:, None], LEG.index("knee_pitch"), 86 * 0.036 / 0.020
    angle, rate, torque = np.sin(3 * time), 3 * np.cos(3 * time), motion.motor_torque
    sensed = replace(
        motion,
        deflection=motion.motor_position / total - angle,
        deflection_rate=motion.motor_velocity / total - rate,
        command_slope=np.full_like(torque, 2.0),
        command_delay_s=(0.01,) * LEG.n,
    )
    by_name = signals(LEG, sensed, index)
    for name, expected in (("theta_L", angle), ("theta_L_dot", rate)):
        np.testing.assert_allclose(by_name[name], expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(by_name["tau_M"], torque[:, index] + 0.02)


def test_truth_times_the_load_regressor_is_the_torque_without_the_payload(
    motion: Motion, model: LoadModel
) -> None:
    """Names and units of the columns of (8), too."""
    rows = load_regression(LEG, motion, model, true_springs(LEG))
    base = model.base.project(LEG.parameters)
    drives = [true_value(LEG, joint, name) for joint, name, _ in model.drives]
    theta = np.array([*base, *drives])
    assert rows.y == pytest.approx(rows.H @ theta, abs=1e-9)
    # what a motor loses to its own friction does not go through its gear
    geared = with_gear_torque(LEG, motion, model, true_springs(LEG), theta)
    assert geared.gear_torque == pytest.approx(joint_torques(LEG, *motion.joint_states), abs=1e-9)
    assert len(rows.names) == len(rows.units) == 29 + 4
    assert rows.names[-1] == "coulomb_friction of hip_roll"
    assert rows.units[:2] == ("kg m^2", "kg m")


def test_carried_is_the_derivative_by_the_springs(motion: Motion, model: LoadModel) -> None:
    springs = true_springs(LEG)
    rows = load_regression(LEG, motion, model, springs)
    assert rows.propagated.shape == (len(rows.y), 6)
    for position, joint in enumerate(ELASTIC):
        for entry, step in enumerate((1000.0, 1.0)):
            shift = np.zeros(2)
            shift[entry] = step
            moved = load_regression(LEG, motion, model, {**springs, joint: springs[joint] + shift})
            derivative = (moved.y - rows.y) / step
            assert rows.propagated[:, 2 * position + entry] == pytest.approx(derivative, abs=1e-9)


def test_both_sides_of_a_row_pass_the_same_filter(motion: Motion) -> None:
    joint, index = "knee_pitch", LEG.index("knee_pitch")
    banded = replace(motion, cutoff_hz=10.0, transient_s=0.1)
    regressor, zeta, R = actuator_columns(LEG, banded, joint)
    truth = [*(true_value(LEG, joint, name) for name in regressor.names[:3]), 0.0]
    torque = motion.motor_torque.copy()
    torque[:, index] += R @ truth - zeta  # so that (7) holds at standstill too
    rows = actuator_regression(LEG, replace(banded, motor_torque=torque), joint)
    assert 5 < len(rows.y) < 20
    assert rows.y == pytest.approx(rows.H @ truth, abs=1e-12)


def test_rows_are_decimated_and_the_ends_left_away() -> None:
    """Rows of a standstill are left out and counted."""
    banded = replace(arm_motion(), cutoff_hz=5.0, transient_s=0.2)
    rows = actuator_regression(arm(), banded, "shoulder")
    assert np.min(rows.time) >= 0.2
    assert np.max(rows.time) <= 5.8
    assert np.min(np.diff(rows.time)) == pytest.approx(0.05)
    assert len(rows.y) + rows.excluded == len(np.arange(200, 5801, 50))
    motion = arm_motion()
    speed = np.abs(motion.motor_velocity[:, 1])
    still = standstill(motion, 1)
    assert np.array_equal(still, speed < 0.01 * np.max(speed))
    # The splines spread a stop over some samples on either side of it.
    unknown = np.convolve(still, np.ones(7), mode="same") > 0.5
    rows = actuator_regression(arm(), motion, "shoulder")
    assert rows.excluded == np.sum(unknown)
    assert np.array_equal(rows.time, motion.time[~unknown])


def test_torques_at_a_reversal_have_no_influence() -> None:
    """A motor that turns back may stick: its friction there is anything up to that of Coulomb."""
    motion = replace(arm_motion(), cutoff_hz=20.0, transient_s=0.05)
    speed = motion.motor_velocity[:, 1]
    turns = np.flatnonzero(np.diff(np.sign(speed)) != 0)
    assert len(turns) > 2
    torque = motion.motor_torque.copy()
    for turn in turns:  # 7 time constants of 100 Hz are 11 ms
        torque[turn - 9 : turn + 10, 1] += 1.0
    rows = actuator_regression(arm(), motion, "shoulder")
    changed = actuator_regression(arm(), replace(motion, motor_torque=torque), "shoulder")
    np.testing.assert_array_equal(rows.y, changed.y)
    assert len(rows.y) + rows.excluded == len(row_samples(motion))


def test_instants_beside_a_stop_are_left_out_with_it() -> None:
    """A row behind the low pass sees the stop next to it; a reversal without a stop is none.

    A joint whose speed is of rounding alone stands still throughout.
    """
    motion = replace(arm_motion(), cutoff_hz=5.0)
    velocity = np.ones_like(motion.motor_velocity)
    velocity[3000:3200, 1] = 0.0
    velocity[4000:, 1] = -1.0
    still = np.flatnonzero(standstill(replace(motion, motor_velocity=velocity), 1))
    assert 2900 < still[0] < 3000
    assert 3200 < still[-1] < 3300
    velocity[:, 1] = 1e-13 * np.random.default_rng(0).normal(size=len(velocity))
    assert np.all(standstill(replace(arm_motion(), motor_velocity=velocity), 1))


def test_stacked_keeps_the_runs_apart(motion: Motion) -> None:
    rows = actuator_regression(LEG, motion, "knee_pitch")
    both = stacked([rows, rows])
    assert both.run.tolist() == [0.0] * len(rows.y) + [1.0] * len(rows.y)
    assert np.array_equal(both.H, np.vstack([rows.H, rows.H]))
    assert both.excluded == 2 * rows.excluded
    no_motor = replace(motion, motor_torque=np.full_like(motion.motor_torque, np.nan))
    other = actuator_regression(LEG, no_motor, "knee_pitch")
    assert other.names == ("stiffness", "spring_offset")
    with pytest.raises(LogError, match="the logs must have the same torque sensors"):
        stacked([rows, other])


def test_missing_torques_and_springs_are_named(motion: Motion, model: LoadModel) -> None:
    nothing = np.full_like(motion.motor_torque, np.nan)
    blind = replace(motion, motor_torque=nothing, joint_torque=nothing)
    with pytest.raises(LogError, match="elastic joint 'knee_pitch' has no torque in the log"):
        actuator_regression(LEG, blind, "knee_pitch")
    with pytest.raises(LogError, match="no torque in the log at hip_yaw, hip_roll; name the other"):
        load_regression(LEG, blind, model, true_springs(LEG))
    torque, index = motion.motor_torque, LEG.index("hip_yaw")
    sensed = replace(motion, motor_torque=nothing, joint_torque=torque)
    expected = torque[:, index] / LEG.drives["hip_yaw"].ratio
    np.testing.assert_allclose(input_signals(LEG, sensed, index)["tau_M"], expected)
    with pytest.raises(LogError, match="joint 'hip_yaw' has no spring"):
        spring_regressor(LEG, "hip_yaw")


def test_load_dependent_friction_of_a_used_joint_is_not_linear() -> None:
    friction = replace(LEG.drives["hip_yaw"], friction=("viscous", "load"))
    robot = LEG.with_drives({"hip_yaw": friction})
    assert [is_linear(robot, [joint]) for joint in ("hip_yaw", "hip_roll")] == [False, True]


def test_ideal_drive_has_no_columns_and_its_torque_is_known(tulip_urdf: Path) -> None:
    robot = load_robot(tulip_urdf)
    regressor = motor_regressor(robot, "hip_yaw")
    torque = np.array([1.0, -2.0])
    zeta, R = regressor.evaluate({"tau_M": torque, "tau_L": 0 * torque, "theta_M_ddot": torque})
    assert (regressor.names, regressor.units) == ((), ())
    assert zeta.tolist() == [1.0, -2.0]
    assert R.shape == (2, 0)
    assert load_model(robot, base_parameters(robot), robot.joint_names).drives == ()


@pytest.mark.parametrize("most", [700, 1501])
def test_a_long_motion_is_evaluated_piece_by_piece(
    monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """The pieces bound the memory; rows, standstill included, are those of the whole motion."""
    shoulder = arm().drives["shoulder"]
    assert isinstance(shoulder, SeriesElasticDrive)
    robot = arm().with_drives({"shoulder": replace(shoulder, joint_friction=("coulomb",))})
    long = replace(arm_motion(), cutoff_hz=8.0, transient_s=0.125)
    columns = load_model(robot, base_parameters(robot), robot.joint_names)
    springs = true_springs(robot)
    whole = load_regression(robot, long, columns, springs)
    monkeypatch.setattr("seaid.log.rows.PIECE_SAMPLES", most)
    monkeypatch.setattr("seaid.regressor.regression.PIECE_SAMPLES", most)
    found = load_regression(robot, long, columns, springs)
    assert found.excluded == whole.excluded > 0
    same = np.lexsort((found.time, found.joint))
    assert np.array_equal(found.time[same], whole.time)
    assert np.array_equal(found.joint[same], whole.joint)
    for name in ("H", "y", "propagated"):
        one, other = getattr(found, name)[same], getattr(whole, name)
        assert np.max(np.abs(one - other)) < 1e-9 * np.max(np.abs(other))
