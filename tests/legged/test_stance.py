"""Motions in stance: feet that stay, limits and contact forces that hold, a better criterion."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import seaid
from scripts.example_robots import example_urdf
from scripts.legged_plant import GO2, foot_positions
from seaid._arrays import Array
from seaid.errors import ExcitationError
from seaid.excitation import make_basis
from seaid.excitation.basis import matrices
from seaid.excitation.limits import joint_limits
from seaid.legged.floating import floating, roll_pitch_yaw
from seaid.legged.stance import StanceModel, inverse_dynamics, stance_model
from seaid.robot import Robot
from seaid.robot.pinocchio_model import floating_model

CROUCH = np.tile([0.0, 0.8, -1.6], 4)


@cache
def go2(balls: bool = False) -> Robot:
    contacts: Any = GO2.contacts if balls else GO2.feet
    return seaid.load_robot(example_urdf("go2.urdf"), base="floating", contacts=contacts)


@cache
def standing(balls: bool = False) -> StanceModel:
    stance = seaid.excitation.Stance(GO2.feet, posture=CROUCH.tolist())
    robot = go2(balls)
    columns = seaid.base_parameters(robot, stances=[GO2.feet]).columns
    return replace(
        stance_model(floating(robot), stance, joint_limits(robot), None, None), columns=columns
    )


def moved(model: StanceModel, seed: int = 0) -> tuple[Any, Array, Array]:
    """A basis of 1 s, random coefficients at rest at the ends, and 20 instants."""
    basis = make_basis("bspline", 1.0, 9)
    coefficients = 0.05 * np.random.default_rng(seed).normal(size=(9, len(model.free)))
    coefficients[[0, 1, 2, 6, 7, 8]] = 0.0
    return basis, coefficients, np.linspace(0, 1, 20)


def turn(base: Array) -> Array:
    return roll_pitch_yaw(base, base)[0]


@pytest.mark.parametrize("balls", [False, True])
def test_feet_stay_and_forces_hold_the_robot(balls: bool) -> None:
    model, fine = standing(balls), np.linspace(0, 1, 173)
    basis, coefficients, time = moved(model)
    joints, plan = model.plan(basis, coefficients, time)
    base, q = plan.base.sample(fine)[0], joints.sample(fine)[0]
    R = turn(np.column_stack([base[:, :3], base[:, 3:]]))
    feet = base[:, None, :3] + np.einsum("tij,tkj->tki", R, foot_positions(go2(), q))
    most = np.max(np.abs(feet - feet[0]), axis=(0, 1))
    # balls roll by their radius times the turn of the foot, at their height above the ground
    assert most[2] < 1e-9
    assert np.all((most[:2] > 1e-3) & (most[:2] < 0.01) if balls else most[:2] < 1e-9)
    # the whole robot falls as forces and weight say: m c'' = sum f + m g
    centre = np.array([centre_of_mass(base[t], q[t], R[t]) for t in range(len(fine))])
    step = fine[1] - fine[0]
    fallen = (centre[2:] - 2 * centre[1:-1] + centre[:-2]) / step**2
    mass = np.sum(go2().parameters[::10])
    total = np.sum(list(plan.forces.values()), axis=0) / mass + [0, 0, -9.81]
    found = np.array([np.interp(time, fine[1:-1], one) for one in fallen.T]).T
    assert np.max(np.abs(found - total)[1:-1]) < 0.02 * np.max(np.abs(total))
    assert min(plan.least_normal_force.values()) > 0
    assert plan.joint_torques.shape == (20, 12)


def centre_of_mass(base: Array, q: Array, R: Array) -> Array:
    """The centre of mass in the world, by Pinocchio."""
    model = floating_model(go2().model, go2().parameters[-10:])
    turned = pin.Quaternion(R).coeffs()
    at = np.concatenate([base[:3], turned, go2().to_model(q)])
    return np.array(pin.centerOfMass(model, model.createData(), at))


def test_gradients_are_those_of_finite_differences() -> None:
    model, rng = standing(), np.random.default_rng(1)
    basis, coefficients, _ = moved(model)
    # at rest the tangential forces are 0, where friction has a kink
    time = np.linspace(0.2, 0.8, 20)
    states = basis.states(time, coefficients)
    G = rng.normal(size=model.observed_rows(states).shape)
    slopes = model.pull_back(states, G)
    maps = matrices(basis, time)
    use, by_x = model.worst_shares(states, range(20), maps, np.ones(6))
    for kind in range(3):
        change, size = rng.normal(size=states[kind].shape), 1e-5
        values = []
        for sign in (1, -1):
            other = [state.copy() for state in states]
            other[kind] += sign * size * change
            values.append(np.sum(G * model.observed_rows((other[0], other[1], other[2]))))
        slope = (values[0] - values[1]) / (2 * size)
        assert np.sum(slopes[kind] * change) == pytest.approx(slope, rel=1e-3, abs=1e-2)
    change = 1e-5 * rng.normal(size=coefficients.shape)
    near, _ = model.worst_shares(
        basis.states(time, coefficients + change), range(20), maps, np.ones(6)
    )
    expected = np.einsum("cmx,xm->c", by_x, change)
    assert np.max(np.abs(near - use - expected)) < 1e-3 * np.max(np.abs(expected))


@pytest.mark.parametrize("balls", [False, True])
def test_rates_are_derivatives_and_motors_give_the_change_of_energy(balls: bool) -> None:
    """Forces at points that stay do no work: all power is that of the motors.

    Planned balls roll up to the third order of their turn, so that their forces do a little.
    """
    model, step_s = standing(balls), 1e-4
    basis, coefficients, _ = moved(model)
    found = inverse_dynamics(model, basis.states(0.5 + step_s * np.arange(-1, 2), coefficients))
    z, rates = found.z, found.rates
    np.testing.assert_allclose((z[2] - z[0]) / (2 * step_s), rates[1], atol=1e-6)
    changed = (rates[2] - rates[0]) / (2 * step_s)
    np.testing.assert_allclose(changed, found.accelerations[1], atol=1e-5)
    whole = floating_model(go2().model, go2().parameters[-10:])
    whole.gravity.linear = np.array([0.0, 0.0, -9.81])
    data, (R, E, _) = whole.createData(), roll_pitch_yaw(z, rates)
    energies = []
    for t in range(3):
        at = np.concatenate([z[t, :3], pin.Quaternion(R[t]).coeffs(), go2().to_model(z[t, 6:])])
        base = R[t].T @ rates[t, :3], E[t] @ rates[t, 3:6]
        speed = np.concatenate([*base, go2().to_model(rates[t, 6:], 1)])
        energies.append(pin.computeMechanicalEnergy(whole, data, at, speed))
    power = float(found.torques[1] @ rates[1, 6:])
    assert (energies[2] - energies[0]) / (2 * step_s) == pytest.approx(
        power, rel=2e-3 if balls else 1e-4
    )


def fixed(base: Any = "fixed", contacts: Any = ()) -> seaid.Excitation:
    """Design a motion in stance of a Go2 on another base, or with other contacts."""
    robot = seaid.load_robot(example_urdf("go2.urdf"), base=base, contacts=contacts)
    return seaid.design_excitation(robot, 4.0, stance=["FL_foot"])


WRONG: dict[str, Callable[[], Any]] = {
    "stance=: no contact is named 'FL'; allowed: FL_foot": lambda: designed(["FL"]),
    "stance= names 'FL_foot' twice": lambda: designed(["FL_foot", "FL_foot"]),
    "stance= needs at least one contact": lambda: designed([]),
    "cannot hold the base: a motion in stance needs three points": lambda: designed(GO2.feet[:2]),
    "posture: no joint is named 'knee'": lambda: designed(GO2.feet, posture={"knee": 0.0}),
    "posture: joint 'FL_calf_joint' at 0 must be between": lambda: designed(
        GO2.feet, posture={"FL_calf_joint": 0.0}
    ),
    "friction must be more than zero, found 0": lambda: designed(GO2.feet, friction=0.0),
    "least_load must be more than zero and less than 1": lambda: designed(GO2.feet, least_load=1.0),
    "at rest in this posture the": lambda: designed(
        GO2.feet, posture={f"{leg}_thigh_joint": 2.2 for leg in ("FL", "FR", "RL", "RR")}
    ),
    "torque of 'RL_calf_joint' is at or beyond its limit": lambda: designed(
        GO2.feet, CROUCH, limits=seaid.Limits(joint_torque=0.5)
    ),
    "basis='multisine' is not available with stance=: take bspline": lambda: designed(
        GO2.feet, CROUCH, basis="multisine"
    ),
    "rest_to_rest= is not available with stance=": lambda: designed(
        GO2.feet, CROUCH, rest_to_rest=False
    ),
    "Limits(motor_torque=...) is not available in stance": lambda: designed(
        GO2.feet, CROUCH, limits=seaid.Limits(motor_torque=1.0)
    ),
    "stance= needs a base that nothing guides": lambda: fixed("planar_xz", GO2.feet),
    "stance= needs a floating base, and that of 'go2_description' is fixed": fixed,
    "'FL_foot' is a flat foot: give Stance": lambda: fixed(
        "floating", [seaid.robot.Contact(foot, is_flat=True) for foot in GO2.feet]
    ),
}


def designed(
    feet: Any, posture: Any = None, friction: float = 0.6, least_load: float = 0.1, **given: Any
) -> seaid.Excitation:
    if isinstance(posture, np.ndarray):
        posture = posture.tolist()
    stance = seaid.excitation.Stance(
        feet, posture=posture, friction=friction, least_load=least_load
    )
    return seaid.design_excitation(go2(), 4.0, stance=stance, **given)


@pytest.mark.parametrize("message", WRONG)
def test_message_of_a_stance_that_cannot_be(message: str) -> None:
    with pytest.raises(ExcitationError) as error:
        WRONG[message]()
    assert message in str(error.value)
