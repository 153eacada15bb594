"""Limits on torques, motor speed and deflection: what they are, their gradient, that they hold."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import ExcitationError
from seaid.excitation import Excitation, Limits, design_excitation
from seaid.excitation.basis import FourierBasis
from seaid.excitation.limits import DRIVE_KINDS, drive_limits, drive_load_gradient, drive_loads
from seaid.regressor import joint_torques
from seaid.robot.robot import Robot, load_robot
from seaid.simulation.simulation import simulate_motion

MODELS = Path(__file__).parents[2] / "models"
EVERYTHING = Limits(joint_torque=5.0, motor_torque=0.05, motor_speed=400.0, deflection=0.004)


@pytest.fixture(scope="module")
def elastic_leg() -> Robot:
    return load_robot(MODELS / "tulip_leg.urdf", drives=MODELS / "tulip_leg.toml")


def plan(robot: Robot, **options: Any) -> Excitation:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "the search for an excitation ended early")
        quick: dict[str, Any] = {"starts": 1, "iterations": 25, "coefficients": 14}
        return design_excitation(robot, 6.0, **(quick | options))


@pytest.mark.slow  # a search, and its motion simulated with springs
def test_loads_are_those_of_the_simulated_leg(elastic_leg: Robot) -> None:
    """The complete model, moved along a plan, has the torques and deflections foreseen.

    Without dry friction, which in the plan turns over a small speed and in the plant at once.
    """
    drives = {
        joint: replace(drive, coulomb_friction_Nm=0.0)
        for joint, drive in elastic_leg.drives.items()
    }
    elastic_leg = elastic_leg.with_values(elastic_leg.parameters, drives)
    found = plan(elastic_leg, limits=Limits(velocity=2.0, acceleration=6.0))
    motion = simulate_motion(elastic_leg, found.trajectory, rate_hz=500.0)
    limits = drive_limits(elastic_leg, EVERYTHING, np.full(5, 2.0))
    assert limits is not None
    states = motion.joint_states
    loads = drive_loads(limits, motion.time, states)
    torque = joint_torques(elastic_leg, *states)
    np.testing.assert_allclose(loads[0], torque, atol=1e-9)
    elastic = slice(2, 5)
    inside = slice(100, -100)
    ratio = limits.drives.ratio[elastic]
    for kind, simulated in (
        (1, motion.motor_torque),
        (2, motion.motor_velocity),
    ):
        off = loads[kind, inside, elastic] - simulated[inside, elastic]
        size = np.linalg.norm(simulated[inside, elastic], axis=0)
        assert np.all(np.linalg.norm(off, axis=0) < 0.01 * size)
    springs = [drives[joint] for joint in elastic_leg.elastic_joints]
    radii = np.array([drive.load_radius for drive in springs])
    sagging = motion.motor_position[:, elastic] / ratio - motion.joint_position[:, elastic]
    foreseen = loads[3, inside, elastic]
    off = foreseen - (radii * sagging)[inside]
    assert np.all(np.linalg.norm(off, axis=0) < 0.01 * np.linalg.norm(foreseen, axis=0))


def test_gradient_of_loads_equals_differences(elastic_leg: Robot) -> None:
    limits = drive_limits(elastic_leg, EVERYTHING, np.full(5, 2.0))
    assert limits is not None
    basis = FourierBasis(3, 4.0)
    time = np.linspace(0.0, 3.9, 50)
    position, velocity, acceleration = maps = basis.matrices(time)
    rng = np.random.default_rng(0)
    x = 0.2 * rng.normal(size=(5, basis.size))

    def loads(x: Any) -> Any:
        states = (position @ x.T, velocity @ x.T, acceleration @ x.T)
        return drive_loads(limits, time, states), states

    values, states = loads(x)
    kinds, joints = (index.ravel() for index in np.indices((4, 5)))
    instants = rng.integers(0, len(time), len(kinds))
    picked = (kinds, instants, joints)
    gradient = drive_load_gradient(limits, time, states, values, picked, maps)
    for _ in range(4):
        direction = rng.normal(size=x.shape)
        plus, minus = (loads(x + sign * 1e-6 * direction)[0] for sign in (1, -1))
        numeric = ((plus - minus) / 2e-6)[kinds, instants, joints]
        found = np.einsum("mik,ik->m", gradient, direction)
        np.testing.assert_allclose(found, numeric, rtol=1e-6, atol=1e-9 * np.abs(numeric).max())


@pytest.mark.slow  # 1.5 s
def test_limits_on_drives_hold_between_the_samples_too(elastic_leg: Robot) -> None:
    limits = Limits(
        velocity=2.5,
        joint_torque={"hip_pitch": 6.0},
        motor_torque=0.06,
        motor_speed=300.0,
        deflection={"knee_pitch": 0.0022},
    )
    free = plan(elastic_leg, limits=Limits(velocity=2.5))
    found = plan(elastic_leg, limits=limits)
    bounds = drive_limits(elastic_leg, limits, np.full(5, 2.5))
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


def test_effort_of_the_file_is_the_default_and_can_be_lifted(elastic_leg: Robot) -> None:
    found = drive_limits(elastic_leg, Limits(), np.ones(5))
    assert found is not None
    np.testing.assert_array_equal(found.largest[0], elastic_leg.effort_limits)
    assert not np.any(np.isfinite(found.largest[1:]))
    assert drive_limits(elastic_leg, Limits(joint_torque=np.inf), np.ones(5)) is None
    assert drive_limits(elastic_leg.without_nominal(), Limits(), np.ones(5)) is None
    stiff = drive_limits(elastic_leg, Limits(deflection=0.1, joint_torque=np.inf), np.ones(5))
    assert stiff is not None
    np.testing.assert_array_equal(np.isfinite(stiff.largest[3]), [False, False, True, True, True])


def test_a_limit_that_the_middle_breaks_is_kept_by_going_elsewhere(elastic_leg: Robot) -> None:
    """With the thigh level in the middle of its range, gravity alone breaks the limit there."""
    level = Limits(
        lower={"hip_pitch": -2.2, "knee_pitch": 0.05},
        upper={"hip_pitch": -0.1, "knee_pitch": 0.9},
        joint_torque={"hip_pitch": 6.5},
    )
    found = plan(elastic_leg, limits=level)
    assert found.margins.joint_torque is not None
    assert np.min(found.margins.joint_torque) >= 0
    still = np.zeros((1, 5))
    middle = 0.5 * (found.limits.lower + found.limits.upper)[None]
    assert abs(joint_torques(elastic_leg, middle, still, still)[0, 2]) > 6.5


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
        (Limits(motor_torque=-1.0), "motor_torque limit must be more than zero, found -1"),
        (Limits(motor_speed={"knee": 1.0}), "did you mean 'knee_pitch'"),
        (Limits(joint_torque=float("nan")), "joint_torque limit is nan"),
    ],
)
def test_limits_that_cannot_be_kept_are_named(
    elastic_leg: Robot, limits: Limits, words: str
) -> None:
    with pytest.raises(ExcitationError, match=words):
        plan(elastic_leg, limits=limits)


def test_limits_on_drives_need_nominal_values(elastic_leg: Robot) -> None:
    unknown = elastic_leg.without_nominal()
    with pytest.raises(ExcitationError, match=r"no nominal inertial parameters .* \(NaN\)"):
        plan(unknown, limits=Limits(joint_torque=10.0))
    bodies = elastic_leg.with_values(elastic_leg.parameters, unknown.drives)
    for limits, words in (
        (Limits(deflection=0.1), "'hip_pitch': its drive has no nominal stiffness"),
        (Limits(motor_torque=0.1), "its drive has no nominal (viscous friction|stiffness)"),
    ):
        with pytest.raises(ExcitationError, match=words):
            plan(bodies, limits=limits)
