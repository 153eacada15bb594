"""Logs that no robot makes: an error of ours that names the place, or numbers, never another."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid.checks.setup import log_findings
from seaid.drives import SeriesElasticDrive, StiffDrive
from seaid.errors import ExcitationError, LogError, SeaidError
from seaid.estimation.fitting import EstimatorName
from seaid.log import Log
from seaid.regressor import joint_torques
from seaid.robot import Robot
from tests.plants import log_with, write_robot
from tests.representatives import quick_first, quick_only

ROD = (
    '<inertial><mass value="1"/><origin xyz="0.2 0 0"/>'
    '<inertia ixx=".01" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial>'
)
HINGE = '<axis xyz="0 1 0"/><limit lower="-3" upper="{}" effort="10" velocity="10"/>'
TIME: Array = np.linspace(0.0, 9.995, 2000)
ANGLE = 0.8 * np.sin(3 * TIME) + 0.3 * np.sin(7 * TIME + 1)
SPEED = 2.4 * np.cos(3 * TIME) + 2.1 * np.cos(7 * TIME + 1)
ACCELERATION = -7.2 * np.sin(3 * TIME) - 14.7 * np.sin(7 * TIME + 1)
FRICTION = 0.1 * SPEED + 0.3 * np.tanh(SPEED / 0.2)


HINGE_ALONE = {"hinge": f"revolute base rod {HINGE.format(3)}"}


def rods(folder: Path, joints: dict[str, str] | None = None, drives: Any = None) -> Robot:
    """Return one hinged rod and more, each as its text says."""
    path = write_robot(folder / "rods.urdf", HINGE_ALONE | (joints or {}), ROD)
    return seaid.load_robot(path, drives)


@pytest.fixture
def pendulum(tmp_path: Path) -> Robot:
    return rods(tmp_path)


def torque(robot: Robot) -> Array:
    states = (one[:, None] for one in (ANGLE, SPEED, ACCELERATION))
    return joint_torques(robot, *states)[:, 0] + FRICTION


def log_of(angle: Array, time: Array = TIME, **sensors: Array) -> Log:
    return log_with("hinge", time, joint_position=angle, **sensors)


@pytest.mark.parametrize("sensor", ["joint_position", "motor_torque", "joint_torque"])
def test_one_absurd_sample_and_a_time_in_another_unit_are_named(sensor: str) -> None:
    place = rf"column 'hinge.{sensor}.*' has .* in sample 700, allowed is up to 1e\+12"
    for value in (1e155, -1e300, 2e12):
        odd = np.where(np.arange(len(TIME)) == 700, value, ANGLE)
        with pytest.raises(LogError, match=place):
            log_with("hinge", TIME, **{"joint_position": ANGLE, sensor: odd})
    with pytest.raises(LogError, match=r"time_s runs from 1\.7e\+18 to .* another unit\?"):
        log_of(ANGLE, 1.7e18 + 1e9 * TIME, motor_torque=ANGLE)


@pytest.mark.usefixtures("estimates_only")
@pytest.mark.parametrize(
    "friction", quick_first([(("viscous", "smooth_coulomb"),), (("viscous", "stribeck"),)])
)
def test_nonlinear_friction_from_a_sensor_at_the_joint(
    pendulum: Robot, friction: tuple[str, ...]
) -> None:
    """The torque of a stiff drive without a sensor of its own is that of the one at its joint."""
    terms = friction if "smooth_coulomb" in friction else (*friction, "coulomb")
    robot = pendulum.with_drives({"hinge": StiffDrive(gear_ratio=5.0, friction=terms)})
    at_joint = seaid.identify(robot, log_of(ANGLE, joint_torque=torque(pendulum)))
    at_motor = seaid.identify(robot, log_of(ANGLE, motor_torque=torque(pendulum) / 5))
    assert at_joint.load_side.values == pytest.approx(at_motor.load_side.values, rel=1e-9)
    if "smooth_coulomb" in friction:
        assert at_joint.drives["hinge"].value("coulomb_friction") == pytest.approx(0.06, 0.02)


@pytest.mark.parametrize("estimator", ["wls", "tukey"])
def test_a_motor_with_current_that_hardly_moves(pendulum: Robot, estimator: EstimatorName) -> None:
    robot = pendulum.with_drives({"hinge": StiffDrive(motor_input="current")})
    slow = np.where(TIME < 5.0, 1e-12 * ANGLE, 0.0)
    with pytest.raises(ExcitationError, match="hinge: the drive stands still in all logs"):
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


@pytest.mark.parametrize(
    ("way", "time"),  # all ways at one time, and one way at all times are quick
    quick_only(
        product(ODD, TIMES), [(x, y) for x, y in product(ODD, TIMES) if y == "even" or x == "noise"]
    ),
)
def test_odd_channels_give_errors_of_ours_or_numbers(pendulum: Robot, way: str, time: str) -> None:
    right = torque(pendulum)
    for odd in ("angle", "torque", "both"):
        angle = ANGLE if odd == "torque" else ODD[way](ANGLE)
        pull = right if odd == "angle" else ODD[way](right)
        try:
            found = seaid.identify(pendulum, log_of(angle, TIMES[time](TIME), motor_torque=pull))
        except SeaidError:
            continue
        assert np.all(np.isfinite(found.load.values))
        assert not np.any(np.isnan(found.load.standard_errors))
        assert found.summary()


def log_of_two(
    robot: Robot, angles: Sequence[Any], torques: Sequence[Any], **sensors: Array
) -> Log:
    positions, pulls = (np.column_stack(sides) for sides in (angles, torques))
    sensors = {"joint_position": positions, "motor_torque": pulls, **sensors}
    return log_with(robot.joint_names, TIME, **sensors)


WITH_FRICTION = StiffDrive(gear_ratio=1.0, friction=("viscous", "coulomb"))
STANDS = {
    "exactly": 0.0 * TIME,
    "within noise": 2e-4 * np.random.default_rng(0).normal(size=len(TIME)),
    "within a step": 1e-3 * (TIME > 5.0),
}


@pytest.mark.parametrize("stands", [*STANDS, "a spring"])
def test_a_joint_that_stands_still_is_named_and_the_others_are_estimated(
    pendulum: Robot, tmp_path: Path, stands: str
) -> None:
    """Its own drive stays as it was, be it stiff or with a spring."""
    spring = SeriesElasticDrive(
        gear_ratio=10.0, motor_inertia_kg_m2=1e-4, friction=("viscous", "coulomb")
    )
    other = spring if stands == "a spring" else WITH_FRICTION
    beside = {"other": f"revolute base bar {HINGE.format(3)}"}
    robot = rods(tmp_path, beside, {"hinge": WITH_FRICTION, "other": other})
    moves = STANDS.get(stands, 0.0 * TIME)
    motor = np.column_stack([np.full_like(TIME, np.nan), 4.1 + 0 * TIME])
    sensors = {"motor_position": motor} if stands == "a spring" else {}
    torques = (torque(pendulum), 0.9 + 0 * TIME + moves)
    log = log_of_two(robot, (ANGLE, 0.4 + moves), torques, **sensors)
    found = seaid.identify(robot, log)
    assert found.robot.drives["other"] == other
    (warning,) = (one for one in found.warnings if one.code == "standstill")
    assert warning.joint == "other"
    if other != spring:
        assert warning.severity == "doubtful"
        assert "locked = { other = 0.4" in warning.remedy
        assert found.drives["hinge"].value("viscous_friction") == pytest.approx(0.1, rel=0.05)
        assert found.unusable_joints == {"other": "it stands still in all logs"}
    assert set(found.drives) == {"hinge"}
    assert found.drives["hinge"].value("coulomb_friction") == pytest.approx(0.3, rel=0.05)
    assert found.model.torque_joints == ("hinge",)


def test_a_distal_joint_that_stands_still_is_one_body_with_the_one_before_it(
    tmp_path: Path,
) -> None:
    """Its base parameters are those of both bodies: those of each are not identifiable."""
    end = {"end": f"revolute rod bar {HINGE.format(3)}"}
    robot = rods(tmp_path, end, dict.fromkeys(("hinge", "end"), WITH_FRICTION))
    states = (np.column_stack([one, 0 * TIME]) for one in (ANGLE, SPEED, ACCELERATION))
    loads = joint_torques(robot, *states) + np.column_stack([FRICTION, 0 * TIME])
    found = seaid.identify(robot, log_of_two(robot, (ANGLE, 0 * TIME), tuple(loads.T)))
    assert [one.joint for one in found.warnings if one.code == "standstill"] == ["end"]
    assert len(found.load.names) == 3
    assert found.drives["hinge"].value("viscous_friction") == pytest.approx(0.1, rel=0.05)


def at_a_stop(folder: Path) -> tuple[Robot, Log]:
    """Return two servos, the second of which pushes against a stiff spring most of the time."""
    servo = StiffDrive(
        friction=("viscous", "coulomb"),
        motor_input="position_command",
        controller=seaid.Controller(position_gain_Nm_per_rad=40.0),
        command_delay_s=0.0,
        known=("command_delay",),
    )
    moved = torque(rods(folder))
    beside = {"other": f"revolute base bar {HINGE.format(0.3)}"}
    robot = rods(folder, beside, dict.fromkeys(("hinge", "other"), servo))
    robot = replace(robot, known_bodies=robot.body_names)
    pushed = 20.0 + 8.0 * ANGLE
    stopped = 0.3 + pushed / 500.0
    command = np.column_stack([ANGLE + moved / 40.0, stopped + pushed / 40.0])
    nothing = np.full((len(TIME), 2), np.nan)
    noise = 1e-5 * np.random.default_rng(1).normal(size=(len(TIME), 2))
    log = log_of_two(robot, (ANGLE, stopped), tuple(nothing.T), position_command=command)
    return robot, replace(log, joint_position=log.joint_position + noise)


def test_a_joint_at_its_stop_is_named_with_the_torques_to_use(tmp_path: Path) -> None:
    robot, log = at_a_stop(tmp_path)
    found = seaid.identify(robot, log)
    named = [one for one in found.warnings if one.severity == "wrong"]
    assert [(one.code, one.joint) for one in named] == [("contact", "other")]
    assert "beyond its limits" in named[0].message
    assert named[0].remedy.endswith('in [identify] of seaid.toml:\ntorque_joints = ["hinge"]')
    assert found.load_side.value("motor_inertia of other") < 0
    assert "rotor inertia was estimated as -" in found.unusable_joints["other"]
    assert found.load_side.value("motor_inertia of hinge") == pytest.approx(0.0, abs=5e-3)
    repaired = seaid.identify(robot, log, torque_joints=["hinge"])
    assert [one for one in repaired.warnings if one.joint == "other"] == []
    assert repaired.unusable_joints == {"other": "its torque was not used"}
    # one that follows its command beyond the limits of its file is at no stop
    assert log.position_command is not None
    follows = replace(log, joint_position=log.position_command - 0.01)
    assert "contact" not in [one.code for one in log_findings(robot, [follows])]
