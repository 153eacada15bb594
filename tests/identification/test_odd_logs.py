"""Logs that no robot makes: an error of ours that names the place, or numbers, never another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid.drives import FrictionTerm
from seaid.drives.drives import StiffDrive
from seaid.errors import IdentificationError, LogError, SeaidError
from seaid.estimation import EstimatorName
from seaid.log.reading import Log
from seaid.regressor.rigid_body import joint_torques
from seaid.robot.robot import Robot

PENDULUM = """
<robot name="pendulum">
  <link name="base"/>
  <link name="rod">
    <inertial>
      <mass value="1"/><origin xyz="0.2 0 0"/>
      <inertia ixx=".01" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="hinge" type="revolute">
    <parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="10" velocity="10"/>
  </joint>
</robot>
"""
TIME: Array = np.linspace(0.0, 9.995, 2000)
ANGLE = 0.8 * np.sin(3 * TIME) + 0.3 * np.sin(7 * TIME + 1)
SPEED = 2.4 * np.cos(3 * TIME) + 2.1 * np.cos(7 * TIME + 1)
ACCELERATION = -7.2 * np.sin(3 * TIME) - 14.7 * np.sin(7 * TIME + 1)


@pytest.fixture
def pendulum(tmp_path: Path) -> Robot:
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    return seaid.load_robot(tmp_path / "pendulum.urdf")


def torque(robot: Robot) -> Array:
    states = (one[:, None] for one in (ANGLE, SPEED, ACCELERATION))
    return joint_torques(robot, *states)[:, 0] + 0.1 * SPEED + 0.3 * np.tanh(SPEED / 0.2)


def log_of(angle: Array, time: Array = TIME, **sensors: Array) -> Log:
    nothing = np.full((len(time), 1), np.nan)
    columns: dict[str, Any] = {name: values[:, None] for name, values in sensors.items()}
    return Log(
        time=time,
        joint_names=("hinge",),
        motor_position=nothing,
        joint_position=angle[:, None],
        motor_torque=columns.pop("motor_torque", nothing),
        **columns,
    )


@pytest.mark.parametrize("value", [1e155, -1e300, 2e15])
@pytest.mark.parametrize("sensor", ["joint_position", "motor_torque", "joint_torque"])
def test_one_absurd_sample_is_named(pendulum: Robot, sensor: str, value: float) -> None:
    samples = {"joint_position": ANGLE.copy(), "motor_torque": torque(pendulum)}
    samples["joint_torque"] = torque(pendulum)
    samples[sensor][700] = value
    place = (
        rf"column 'hinge.{sensor}.*' has .* in sample 700 \(t = 3.5 s\), allowed is up to 1e\+15"
    )
    with pytest.raises(LogError, match=place):
        log_of(samples.pop("joint_position"), **samples)


def test_a_time_in_another_unit_is_named() -> None:
    with pytest.raises(LogError, match=r"time_s runs from 1\.7e\+18 to .* another unit\?"):
        log_of(ANGLE, 1.7e18 + 1e9 * TIME, motor_torque=ANGLE)


@pytest.mark.parametrize("friction", [("viscous", "smooth_coulomb"), ("viscous", "stribeck")])
def test_nonlinear_friction_from_a_sensor_at_the_joint(
    pendulum: Robot, friction: tuple[FrictionTerm, ...]
) -> None:
    """The torque of a stiff drive without a sensor of its own is that of the one at its joint."""
    terms = friction if "smooth_coulomb" in friction else (*friction, "coulomb")
    robot = pendulum.with_drives({"hinge": StiffDrive(friction=terms)})
    at_joint = seaid.identify(robot, log_of(ANGLE, joint_torque=torque(pendulum)))
    at_motor = seaid.identify(robot, log_of(ANGLE, motor_torque=torque(pendulum)))
    assert at_joint.load_side.values == pytest.approx(at_motor.load_side.values, rel=1e-9)
    if "smooth_coulomb" in friction:
        assert at_joint.drives["hinge"].value("coulomb_friction") == pytest.approx(0.3, 0.02)


@pytest.mark.parametrize("estimator", ["wls", "tukey"])
def test_a_motor_fed_with_current_that_hardly_moves(
    pendulum: Robot, estimator: EstimatorName
) -> None:
    robot = pendulum.with_drives({"hinge": StiffDrive(motor_input="current")})
    slow = np.where(TIME < 5.0, 1e-12 * ANGLE, 0.0)
    with pytest.raises(IdentificationError, match=r"0 rows \(.* near standstill\) cannot det"):
        seaid.identify(robot, log_of(slow, motor_current=ANGLE), estimator=estimator)


ODD: dict[str, Callable[[Array], Array]] = {
    "constant": lambda x: np.full_like(x, 0.3),
    "zero": np.zeros_like,
    "impulse": lambda x: np.where(np.arange(len(x)) == 900, 1.0, 0.0),
    "underflow": lambda x: 1e-300 * x,
    "large": lambda x: 1e14 * x,
    "coarse": lambda x: np.round(x),
    "step": lambda x: np.where(np.arange(len(x)) > 900, 1.0, 0.0),
    "noise": lambda x: np.random.default_rng(0).normal(size=len(x)),
    "alternating": lambda x: np.where(np.arange(len(x)) % 2, 1.0, -1.0),
    "ramp": lambda x: np.linspace(0.0, 1.0, len(x)),
    "held": lambda x: np.where(np.arange(len(x)) < 1000, x, x[1000]),
}
TIMES: dict[str, Callable[[Array], Array]] = {
    "even": lambda t: t,
    "1970": lambda t: t + 1.7e9,
    "MHz": lambda t: 2e-4 * t,
    "slow": lambda t: 2e3 * t,
    "growing": lambda t: np.logspace(-3, 3, len(t)),
    "jitter": lambda t: t + 0.002 * np.random.default_rng(1).uniform(size=len(t)),
}


@pytest.mark.parametrize("time", TIMES)
@pytest.mark.parametrize("way", ODD)
def test_odd_channels_give_an_error_of_ours_or_numbers(
    pendulum: Robot, way: str, time: str
) -> None:
    for odd in ("angle", "torque", "both"):
        angle = ANGLE if odd == "torque" else ODD[way](ANGLE)
        pull = torque(pendulum) if odd == "angle" else ODD[way](torque(pendulum))
        try:
            found = seaid.identify(pendulum, log_of(angle, TIMES[time](TIME), motor_torque=pull))
        except SeaidError:
            continue
        assert np.all(np.isfinite(found.load.values))
        assert not np.any(np.isnan(found.load.standard_errors))
        assert found.summary()


def test_a_cutoff_far_below_the_rate_is_one_for_which_the_log_is_too_short(
    pendulum: Robot,
) -> None:
    log = log_of(ANGLE, 1e-12 * TIME, motor_torque=ANGLE)
    with pytest.raises(LogError, match="fewer than 10 periods of the cutoff, 3 Hz"):
        seaid.reconstruct_motion(pendulum, log, 3.0)


def test_two_samples_and_equal_or_reversed_times_are_refused() -> None:
    good = log_of(ANGLE, motor_torque=ANGLE)
    for time, words in ((TIME[::-1], "goes backwards"), (np.zeros(2000), "repeats")):
        with pytest.raises(LogError, match=words):
            replace(good, time=time)
    with pytest.raises(LogError, match="a log needs 50 samples or more, found 2"):
        log_of(ANGLE[:2], TIME[:2], motor_torque=ANGLE[:2])
