"""Ratios that depend on the angle of a joint: their laws."""

from __future__ import annotations

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives import AngleRatio
from seaid.drives.angle_ratio import Ratios

ANGLES = np.linspace(-1.2, 2.0, 9)
RATIOS = {
    "one order": AngleRatio(cos=(0.24,), sin=(-0.07,)),
    "three orders": AngleRatio(cos=(0.3, 0.0, 0.05), sin=(-0.2, 0.1)),
    "near a dead centre": AngleRatio(sin=(0.985,)),
    "table": AngleRatio(angle_rad=tuple(ANGLES), ratio=tuple(1.1 + 0.4 * np.sin(1.3 * ANGLES))),
}
Q = np.linspace(-8.0, 8.0, 501)


@pytest.fixture(params=list(RATIOS))
def ratio(request: pytest.FixtureRequest) -> AngleRatio:
    return RATIOS[request.param]


def slope(values: Array, step: float) -> Array:
    """Return the derivative by central differences of samples (3, ...) one step apart."""
    return np.asarray((values[2] - values[0]) / (2 * step))


def test_the_angle_behind_the_gear_has_the_ratio_as_its_slope(ratio: AngleRatio) -> None:
    """Its inverse is exact, and the derivatives of the ratio are those of finite differences."""
    step = 1e-5
    # A table of cubics has a corner of its ratio at both ends.
    inside = Q[np.min(np.abs(Q[:, None] - ANGLES[[0, -1]]), axis=1) > 2 * step]
    around = inside + step * np.array([[-1.0], [0.0], [1.0]])
    np.testing.assert_allclose(slope(ratio.drive_angle(around), step), ratio.rate(inside), 1e-8)
    for order in (0, 1):
        found = slope(ratio.rate(around, order), step)
        np.testing.assert_allclose(found, ratio.rate(inside, order + 1), rtol=0, atol=1e-5)
    assert ratio.drive_angle(np.zeros(1)) == 0
    np.testing.assert_allclose(ratio.joint_angle(ratio.drive_angle(Q)), Q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ratio.drive_angle(ratio.joint_angle(Q)), Q, rtol=0, atol=1e-12)


def test_states_are_derivatives_of_each_other_and_come_back(ratio: AngleRatio) -> None:
    """Angle, speed and acceleration behind the gear, by finite differences along a motion."""
    step, ratios = 1e-4, Ratios({1: ratio})
    time = np.linspace(0.0, 3.0, 40) + step * np.array([[-1.0], [0.0], [1.0]])
    q = np.stack([np.cos(time), 0.9 * np.sin(1.7 * time)], axis=-1)
    v = np.stack([-np.sin(time), 1.53 * np.cos(1.7 * time)], axis=-1)
    a = np.stack([-np.cos(time), -2.601 * np.sin(1.7 * time)], axis=-1)
    phi, speed, acceleration = ratios.at_drives(q, v, a)
    np.testing.assert_allclose(slope(phi, step), speed[1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(slope(speed, step), acceleration[1], rtol=0, atol=1e-5)
    back = ratios.at_joints(phi, speed, acceleration)
    for state, wanted in zip(back, (q, v, a), strict=True):
        np.testing.assert_allclose(state, wanted, rtol=0, atol=1e-10)
    # The other joint keeps its states, and no array is changed in place.
    assert np.array_equal(phi[..., 0], q[..., 0])
    assert np.array_equal(q[1, :, 1], 0.9 * np.sin(1.7 * time[1]))
    (first,) = ratios.at_joints(phi)
    assert np.array_equal(first, back[0])


def test_power_is_the_same_on_both_sides(ratio: AngleRatio) -> None:
    rng = np.random.default_rng(0)
    q, v, torque = rng.normal(size=(3, 50, 2))
    speed = Ratios({0: ratio}).at_drives(q, v, np.zeros_like(v))[1]
    behind_gear = torque / Ratios({0: ratio}).rates(q)
    np.testing.assert_allclose(np.sum(behind_gear * speed, 1), np.sum(torque * v, 1), rtol=1e-12)
