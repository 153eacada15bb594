"""The regressor that a plan conditions: its entries, and its exact gradient with drives in it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from seaid.drives.functions import SMOOTH_SIGNALS, smooth_columns
from seaid.errors import ExcitationError
from seaid.excitation.criteria import pivoted_base
from seaid.excitation.observation_matrix import (
    READINGS_HZ,
    drive_target,
    load_target,
    stacked_regressor,
)
from seaid.legged import load_robot
from seaid.regressor import motor_regressor, rigid_body_regressor
from seaid.robot import Robot
from tests.excitation.robots import assert_gradient, robots, smooth_motion
from tests.experiments import DATA, arm
from tests.plants import states


def mixed_arm() -> Robot:
    """Return the mixed arm in another order, with an unknown rotor, an offset and own terms."""
    drives: dict[str, Any] = dict(arm().drives)
    changes: dict[str, Any] = {
        "shoulder": {"extra_terms": ("c*theta_M_dot**3", "d*theta_L_dot**3")},
        "telescope": {"motor_inertia_kg_m2": None},
        "wrist": {"friction": ("viscous", "coulomb", "offset")},
    }
    changed = {joint: replace(drives[joint], **change) for joint, change in changes.items()}
    return load_robot(DATA / "mixed_arm.urdf", drives | changed, joints=arm().joint_names[::-1])


SOME = ("ankle_pitch", "hip_pitch", "knee_pitch")


@pytest.mark.rounding
@pytest.mark.parametrize(("name", "rows"), [*((name, None) for name in robots()), ("leg", SOME)])
def test_gradient_of_the_base_regressor(name: str, rows: tuple[str, ...] | None) -> None:
    """Of robots of every kind, and with the torques of three joints known alone."""
    robot = robots()[name]
    target = load_target(robot, rows, pivoted_base(robot, rows))
    assert rows is None or len(target.base_columns) == 21
    assert_gradient(target, np.linspace(0, 1, 60), states(robot.n, 60))


def test_gradient_with_drives() -> None:
    robot = mixed_arm()
    target = drive_target(robot, None, pivoted_base(robot), np.ones(robot.n))
    scaled = replace(target, row_weights=np.linspace(1, 2, len(target.row_weights)))
    assert_gradient(scaled, *smooth_motion(robot))
    assert any(name.startswith("stiffness of") for name in target.names)


@pytest.mark.rounding
def test_base_regressor_is_the_stacked_one_of_every_reading() -> None:
    robot = robots()["leg"]
    base = pivoted_base(robot)
    target = load_target(robot, None, base)
    motion, time = states(robot.n, 40), np.linspace(0, 3.9, 40)
    H = base.reduce(rigid_body_regressor(robot, *motion)) * np.sqrt(0.1 * READINGS_HZ)
    H[[0, -1]] *= np.sqrt(0.5)  # the ends stand for half as long
    found = stacked_regressor(target, time, motion)
    np.testing.assert_allclose(found, H.reshape(found.shape), rtol=1e-12)


def test_smooth_columns_are_the_regressor_but_for_the_sign() -> None:
    """Of a drive with terms of the user."""
    regressor = motor_regressor(mixed_arm(), "shoulder")
    rng = np.random.default_rng(2)
    signals = {name: rng.normal(size=30) for name in SMOOTH_SIGNALS}
    columns, slopes = smooth_columns(regressor).evaluate(signals, 1e-6)
    plain = regressor.evaluate({**signals, "tau_M": np.zeros(30), "tau_L": np.zeros(30)})[1]
    np.testing.assert_allclose(columns, plain, rtol=1e-12)
    assert slopes.shape == (30, len(regressor.names), 7)


def test_drives_need_nominal_values(tulip_leg: Robot) -> None:
    base, unknown = pivoted_base(tulip_leg), np.full(50, np.nan)
    with pytest.raises(ExcitationError, match=r"'hip_pitch': its drive has no nominal stiffness"):
        drive_target(tulip_leg.without_nominal(), None, base, np.ones(5))
    with pytest.raises(ExcitationError, match=r"no nominal inertial parameters of hip_yaw_link"):
        drive_target(tulip_leg.with_values(unknown, tulip_leg.drives), None, base, np.ones(5))
