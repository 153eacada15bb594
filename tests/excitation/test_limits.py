from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import ExcitationError
from seaid.excitation import Limits, Trajectory, make_basis
from seaid.excitation.limits import (
    DRIVE_KINDS,
    drive_limits,
    drive_loads,
    joint_limits,
    limit_values,
    margins,
    positive_values,
)
from seaid.legged import load_robot
from seaid.regressor import joint_torques
from seaid.robot import Robot
from tests.excitation.robots import plan


def test_a_limit_is_one_number_one_a_joint_or_a_mapping_and_else_the_robots(
    slider_arm: Robot,
) -> None:
    """What is not given, the robot's file gives; a limit that may be none at all is infinity."""
    found = joint_limits(slider_arm)
    np.testing.assert_allclose(found.lower, [-0.4, -np.pi, 0.1])
    np.testing.assert_allclose(found.upper, [0.6, np.pi, 2.0])
    np.testing.assert_allclose(found.velocity, [1.0, 3.0, 3.0])
    np.testing.assert_allclose(found.acceleration, [10.0, 10.0, 10.0])
    limits = Limits(
        lower={"shoulder": -1.0}, upper=[0.5, 1.0, 1.5], velocity=0.5, acceleration=np.ones(3)
    )
    found = joint_limits(slider_arm, limits)
    np.testing.assert_allclose(found.lower, [-0.4, -1.0, 0.1])
    np.testing.assert_allclose(found.upper, [0.5, 1.0, 1.5])
    np.testing.assert_allclose(found.velocity, 0.5)
    np.testing.assert_allclose(found.acceleration, 1.0)
    default = np.array([np.inf, 2.0, 3.0])
    values = positive_values(slider_arm, "deflection", {"elbow": 0.1}, default, unlimited=True)
    np.testing.assert_array_equal(values, [np.inf, 2.0, 0.1])
    values = limit_values(slider_arm, "joint_torque", np.inf, default, unlimited=True)
    np.testing.assert_array_equal(values, np.inf)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"velocity": 0.0}, "joint 'rail': velocity limit must be more than zero, found 0"),
        ({"acceleration": {"elbow": -1}}, "joint 'elbow': acceleration limit must be more"),
        ({"lower": {"elbow": 2.0}}, "'elbow': lower limit 2 must be less than upper limit 2"),
        ({"lower": 1.0, "upper": -1.0}, "'rail': lower limit 1 must be less than upper limit -1"),
        ({"lower": np.nan}, "joint 'rail' of 'slider_arm': lower limit is nan, which is not"),
        ({"velocity": {"elbow": np.inf}}, "'elbow' of 'slider_arm': velocity limit is inf"),
        ({"velocity": [1.0, 2.0]}, r"velocity limit must have shape \(3\), found \(2,\)"),
        ({"velocity": {"elbo": 1.0}}, "velocity limit: no joint is named 'elbo'; did you mean"),
        ({"velocity": "fast"}, "velocity limit must be numbers"),
        ({"upper": {"elbow": 1e200}}, r"'elbow': upper limit must be from .* found 1e\+200"),
        ({"acceleration": 1e-320}, r"acceleration limit must be more than 1e-09, found 9\.99"),
        ({"velocity": {"elbow": "fast"}}, "velocity limit must be numbers"),
        # that may be infinite
        ({"motor_speed": np.nan}, "'rail' of 'slider_arm': motor_speed limit is nan, which is not"),
        ({"motor_speed": -np.inf}, "'rail' of 'slider_arm': motor_speed limit is -inf, which is"),
        ({"motor_speed": [1.0, -2.0, 3.0]}, "'shoulder': motor_speed limit must be more than zer"),
    ],
)
def test_bad_limits_name_joint_and_limit(
    slider_arm: Robot, limits: dict[str, Any], words: str
) -> None:
    """Each limit that is no number, not positive or of no joint, infinite or not."""
    with pytest.raises(ExcitationError, match=words):
        joint_limits(slider_arm, Limits(**limits))
        drive_limits(slider_arm, Limits(**limits), np.ones(3))


NO_VELOCITY = "joint 'shoulder' of 'slider_arm': velocity limit is missing; give it by Limits"
NO_RANGE = "joint 'elbow': lower limit 0 must be less than upper limit 0"
NO_LIMIT = "joint 'rail' of 'slider_arm': lower limit is missing"


@pytest.mark.parametrize(
    ("old", "words"),
    [
        ('<limit velocity="3.0" effort="20"/>', NO_VELOCITY),
        ('lower="0.1" upper="2.0"', NO_RANGE),
        ('<limit lower="-0.4" upper="0.6" velocity="1.0" effort="50"/>', NO_LIMIT),
    ],
)
def test_what_the_file_lacks_is_named(
    tmp_path: Path, slider_arm_text: str, old: str, words: str
) -> None:
    assert old in slider_arm_text
    path = tmp_path / "lacking.urdf"
    path.write_text(slider_arm_text.replace(old, ""))
    with pytest.raises(ExcitationError, match=words):
        joint_limits(load_robot(path))


def test_margins_are_the_distances_at_the_worst_instant(slider_arm: Robot) -> None:
    basis = make_basis("bspline", 5.0, 15)
    inside = np.random.default_rng(0).uniform(-0.2, 0.2, size=(11, 3))
    values = np.pad(inside, ((2, 2), (0, 0)), mode="edge") + np.array([0.1, 0, 1])
    motion = Trajectory(slider_arm.joint_names, basis, values, ("rail",))
    limits = joint_limits(slider_arm)
    found = margins(motion, limits)
    q, v, a = motion.sample(np.linspace(0.0, 5.0, 50001))
    position = np.minimum(q - limits.lower, limits.upper - q).min(axis=0)
    for exact, sampled in (
        (found.position, position),
        (found.velocity, limits.velocity - np.abs(v).max(axis=0)),
        (found.acceleration, limits.acceleration - np.abs(a).max(axis=0)),
    ):
        assert np.all(exact <= sampled + 1e-12)
        np.testing.assert_allclose(exact, sampled, atol=2e-3)
    # below zero where a limit is broken
    still = Trajectory(slider_arm.joint_names, basis, np.full((15, 3), 0.7), ("rail",))
    found = margins(still, limits)
    np.testing.assert_allclose(found.position, [-0.1, np.pi - 0.7, 0.6], rtol=1e-12)
    np.testing.assert_allclose(found.velocity, [1.0, 3.0, 3.0], rtol=1e-12)


# Limits on torques, motor speed and deflection: what they are, their gradient, that they hold

QUICK: dict[str, Any] = {"duration": 6.0, "starts": 1, "iterations": 25, "coefficients": 14}


@pytest.mark.slow  # 1.5 s
def test_limits_on_drives_hold_between_the_samples_too(tulip_leg: Robot) -> None:
    limits = Limits(
        velocity=2.5,
        joint_torque={"hip_pitch": 6.0},
        motor_torque=0.06,
        motor_speed=300.0,
        deflection={"knee_pitch": 0.0022},
    )
    free = plan(tulip_leg, **QUICK, limits=Limits(velocity=2.5))
    found = plan(tulip_leg, **QUICK, limits=limits)
    bounds = drive_limits(tulip_leg, limits, np.full(5, 2.5))
    assert bounds is not None
    time = np.linspace(0, 6, 2401)
    loads = np.abs(drive_loads(bounds, time, found.trajectory.sample(time))).max(axis=1)
    assert np.all(loads <= bounds.largest * (1 + 1e-6))
    unlimited = np.abs(drive_loads(bounds, time, free.trajectory.sample(time))).max(axis=1)
    assert np.any(unlimited > 1.2 * bounds.largest)
    for kind, row, most in zip(DRIVE_KINDS, loads, bounds.largest, strict=True):
        margin = getattr(found.margins, kind)
        np.testing.assert_allclose(margin, most - row, rtol=1e-2, atol=2e-2 * np.max(row))
        assert np.all(margin >= 0)
    assert np.isfinite(found.condition_number)


def test_effort_of_the_file_is_the_default_and_can_be_lifted(tulip_leg: Robot) -> None:
    found = drive_limits(tulip_leg, Limits(), np.ones(5))
    assert found is not None
    np.testing.assert_array_equal(found.largest[0], tulip_leg.effort_limits)
    assert not np.any(np.isfinite(found.largest[1:]))
    assert drive_limits(tulip_leg, Limits(joint_torque=np.inf), np.ones(5)) is None
    assert drive_limits(tulip_leg.without_nominal(), Limits(), np.ones(5)) is None
    stiff = drive_limits(tulip_leg, Limits(deflection=0.1, joint_torque=np.inf), np.ones(5))
    assert stiff is not None
    np.testing.assert_array_equal(np.isfinite(stiff.largest[3]), [False, False, True, True, True])


def test_a_limit_that_the_middle_breaks_is_kept_by_going_elsewhere(tulip_leg: Robot) -> None:
    """With the thigh level in the middle of its range, gravity alone breaks the limit there."""
    level = Limits(
        lower={"hip_pitch": -2.2, "knee_pitch": 0.05},
        upper={"hip_pitch": -0.1, "knee_pitch": 0.9},
        joint_torque={"hip_pitch": 6.5},
    )
    found = plan(tulip_leg, **QUICK, limits=level)
    assert found.margins.joint_torque is not None
    assert np.min(found.margins.joint_torque) >= 0
    still = np.zeros((1, 5))
    middle = 0.5 * (found.limits.lower + found.limits.upper)[None]
    assert abs(joint_torques(tulip_leg, middle, still, still)[0, 2]) > 6.5


@pytest.mark.slow  # 2.2 s
@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (
            Limits(upper={"hip_pitch": -0.8}, joint_torque={"hip_pitch": 0.5}),
            r"keeps joint 'hip_pitch' within its joint torque limit, 0.5 N m \(or N\): the best "
            r"needs .* Limits\(joint_torque=\{'hip_pitch'",
        ),
        (Limits(deflection=1e-7), r"within its deflection limit, 1e-07 rad \(or m\)"),
    ],
)
def test_limits_that_cannot_be_kept_are_named(tulip_leg: Robot, limits: Limits, words: str) -> None:
    with pytest.raises(ExcitationError, match=words):
        plan(tulip_leg, **QUICK, limits=limits)
