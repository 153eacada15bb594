"""Derivatives of the inverse dynamics in any joint order, and the integration of what follows."""

from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

from seaid._arrays import Array
from seaid.legged import load_robot
from seaid.robot import Payload
from seaid.simulation.plant import (
    holding,
    inertia,
    inverse_dynamics,
    plant_of,
    response_to,
    torque_jacobians,
)
from tests.experiments import DATA, arm
from tests.plants import torque_slopes_by_steps

STEP = 1e-3


@pytest.mark.parametrize(
    "joints", [None, ("wrist", "telescope", "rail", "shoulder")], ids=["tree", "reordered"]
)
def test_derivatives_are_those_of_differences(joints: tuple[str, ...] | None) -> None:
    robot = load_robot(
        DATA / "mixed_arm.urdf", joints=joints, payloads=[Payload("tool", 0.7, (0.1, 0.0, 0.05))]
    )
    states = np.random.default_rng(0).uniform(-1, 1, (3, 4, robot.n))
    found = torque_jacobians(robot, *states)
    by_steps = torque_slopes_by_steps(robot, [*states], 1e-5)
    np.testing.assert_allclose(found, by_steps, rtol=0, atol=1e-7)


def test_bodies_of_negative_mass_have_derivatives_that_are_linear_in_the_parameters() -> None:
    """Estimates may have them; Pinocchio then takes their sum with others for a mass of 1e-12."""
    robot = load_robot(DATA / "mixed_arm.urdf", payloads=[Payload("tool", 0.7, (0.1, 0.0, 0.05))])
    states = np.random.default_rng(0).uniform(-1, 1, (3, 4, robot.n))
    mass = np.zeros(robot.parameters.size)
    mass[::10] = [0.0, -3.0, -6.0, -0.5]
    wrong, heavy, payload = (
        torque_jacobians(robot.with_values(one, robot.drives), *states)
        for one in (robot.parameters + mass, robot.parameters - mass, robot.parameters)
    )
    np.testing.assert_allclose((wrong + heavy) / 2, payload, atol=1e-10)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_held_joints_stand_still_and_the_others_move_as_without_them(count: int) -> None:
    """Rows and columns of held joints leave the equations of motion (8)."""
    plant = plant_of(arm())
    data, n = plant.model.createData(), len(plant.elastic)
    position, speed, torque = np.random.default_rng(0).normal(size=(3, n))
    for joints in combinations(range(n), count):
        acceleration = pin.aba(holding(plant.model, joints), data, position, speed, torque)
        free = [joint for joint in range(n) if joint not in joints]
        rest = torque - inverse_dynamics(plant, data, (position, speed, np.zeros(n)))
        expected = np.zeros(n)
        M = inertia(plant, data, position)
        expected[free] = np.linalg.solve(M[np.ix_(free, free)], rest[free])
        assert not np.any(acceleration[list(joints)])
        np.testing.assert_allclose(acceleration, expected, rtol=1e-9)


def constant(M: float, C: float, K: float, samples: int) -> Array:
    return np.array([np.full((samples, 1, 1), value) for value in (K, C, M)])


def test_damped_spring_answers_as_the_textbook_says() -> None:
    samples, M, K, decay = 1000, 2.0, 800.0, 1.5
    C = 2 * M * decay
    rate = np.sqrt(K / M - decay**2)
    time = STEP * np.arange(samples)
    free = np.exp(-decay * time)
    kept = free * (np.cos(rate * time) + decay / rate * np.sin(rate * time))
    force = np.full((samples, 1, 1), 40.0)
    position = response_to(constant(M, C, K, samples), force, STEP, 1)[0]
    assert position[:, 0, 0] == pytest.approx(40.0 / K * (1 - kept), abs=1e-5)
    assert position[:, 0, 1] == pytest.approx(kept, abs=1e-3)
    assert position[:, 0, 2] == pytest.approx(free * np.sin(rate * time) / rate, abs=5e-5)


def test_integration_of_an_oscillation_is_of_fourth_order() -> None:
    errors = []
    for step in (2e-3, 1e-3):
        samples = round(1.0 / step)
        response = response_to(
            constant(1.0, 0.0, 900.0, samples), np.zeros((samples, 1, 0)), step, 1
        )
        exact = np.cos(30.0 * step * np.arange(samples))
        errors.append(np.max(np.abs(response[0, :, 0, 0] - exact)))
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.02)


def test_every_window_starts_anew() -> None:
    """Without a joint behind a spring there is no answer."""
    force = np.random.default_rng(0).normal(size=(600, 1, 2))
    system = constant(1.0, 0.5, 400.0, 600)
    both = response_to(system, force, STEP, 2)
    second = response_to(constant(1.0, 0.5, 400.0, 300), force[300:], STEP, 1)
    assert np.array_equal(both[1, 300:], second[1])
    assert both[0, 300, 0].tolist() == [0.0, 0.0, 1.0, 0.0]
    nothing = np.empty((3, 100, 0, 0))
    assert response_to(nothing, np.empty((100, 0, 5)), STEP, 4).shape == (3, 100, 0, 5)
