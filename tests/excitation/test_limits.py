from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import ExcitationError
from seaid.excitation import Limits, Trajectory, joint_limits, margins
from seaid.excitation.basis import make_basis
from seaid.excitation.limits import limit_values, positive_values
from seaid.robot.robot import Robot, load_robot


def test_the_robot_gives_what_is_not_given(slider_arm: Robot) -> None:
    found = joint_limits(slider_arm)
    np.testing.assert_allclose(found.lower, [-0.4, -np.pi, 0.1])
    np.testing.assert_allclose(found.upper, [0.6, np.pi, 2.0])
    np.testing.assert_allclose(found.velocity, [1.0, 3.0, 3.0])
    np.testing.assert_allclose(found.acceleration, [10.0, 10.0, 10.0])


def test_a_limit_is_one_number_one_a_joint_or_a_mapping(slider_arm: Robot) -> None:
    limits = Limits(
        lower={"shoulder": -1.0}, upper=[0.5, 1.0, 1.5], velocity=0.5, acceleration=np.ones(3)
    )
    found = joint_limits(slider_arm, limits)
    np.testing.assert_allclose(found.lower, [-0.4, -1.0, 0.1])
    np.testing.assert_allclose(found.upper, [0.5, 1.0, 1.5])
    np.testing.assert_allclose(found.velocity, 0.5)
    np.testing.assert_allclose(found.acceleration, 1.0)


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
    ],
)
def test_bad_limits_name_joint_and_limit(
    slider_arm: Robot, limits: dict[str, Any], words: str
) -> None:
    with pytest.raises(ExcitationError, match=words):
        joint_limits(slider_arm, Limits(**limits))


def test_a_limit_that_may_be_none_at_all_is_infinity(slider_arm: Robot) -> None:
    default = np.array([np.inf, 2.0, 3.0])
    found = positive_values(slider_arm, "deflection", {"elbow": 0.1}, default, unlimited=True)
    np.testing.assert_array_equal(found, [np.inf, 2.0, 0.1])
    found = limit_values(slider_arm, "joint_torque", np.inf, default, unlimited=True)
    np.testing.assert_array_equal(found, np.inf)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (np.nan, "joint 'rail' of 'slider_arm': motor_speed limit is nan, which is not finite"),
        (-np.inf, "joint 'rail' of 'slider_arm': motor_speed limit is -inf, which is not finite"),
        ({"elbow": 0.0}, "joint 'elbow': motor_speed limit must be more than zero, found 0; give"),
        ([1.0, -2.0, 3.0], "joint 'shoulder': motor_speed limit must be more than zero, found -2"),
        ({"elbo": 1.0}, "motor_speed limit: no joint is named 'elbo'; did you mean 'elbow'"),
    ],
)
def test_bad_limits_that_may_be_infinite_say_so(slider_arm: Robot, given: Any, words: str) -> None:
    with pytest.raises(ExcitationError, match=words):
        positive_values(slider_arm, "motor_speed", given, np.full(3, np.inf), unlimited=True)


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


def test_a_broken_limit_has_a_margin_below_zero(slider_arm: Robot) -> None:
    basis = make_basis("bspline", 5.0, 15)
    motion = Trajectory(slider_arm.joint_names, basis, np.full((15, 3), 0.7), ("rail",))
    found = margins(motion, joint_limits(slider_arm))
    np.testing.assert_allclose(found.position, [-0.1, np.pi - 0.7, 0.6], rtol=1e-12)
    np.testing.assert_allclose(found.velocity, [1.0, 3.0, 3.0], rtol=1e-12)
