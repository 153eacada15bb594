"""Mistakes of a set-up are named with a remedy that repairs them; right set-ups have no warning."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid.checks.instants import fitted
from seaid.estimation.qr_factor import fitted_slope
from seaid.identification import check
from tests.mistakes import CASES
from tests.one_joint import one_joint
from tests.plants import log_with
from tests.representatives import quick_only


@pytest.mark.parametrize(("case", "seed"), quick_only(product(CASES, range(3)), [("arm", 1)]))
def test_right_set_ups_have_no_warning(case: str, seed: int) -> None:
    robot, log = CASES[case][0](), CASES[case][1](seed)
    assert seaid.check(robot, log).warnings == ()
    assert seaid.check(robot.without_nominal(), log).warnings == ()


def spring_rows(error_rad: float, seed: int) -> tuple[Array, Array]:
    """Return angles of both sides and the torque of a spring behind a gear with an error."""
    random = np.random.default_rng(seed)
    t = np.linspace(0.0, 6.0, 150)
    rates = random.uniform(0.3, 1.2, (3, 1))
    joint = 0.3 * np.sum(np.sin(2 * np.pi * rates * t + random.uniform(0, 6, (3, 1))), axis=0)
    torque = random.normal() * np.cos(joint) + np.gradient(np.gradient(joint, t), t) / 20
    of_gear = error_rad * np.sin(8 * joint + random.uniform(0, 6))
    motor = 700 * (joint + torque / 70 + of_gear)
    noise = random.normal(0, 0.01, len(t))
    return np.column_stack([motor, joint, np.ones_like(t)]), torque + noise


def by_fit_alone(columns: Array, torque: Array) -> tuple[float, float]:
    """Return the slope by the fit alone, and its standard error."""
    (a, b, _), covariance = fitted([columns], torque)
    slopes = np.array([b / a**2, -1 / a])
    return -b / a, float(np.sqrt(slopes @ covariance[:2, :2] @ slopes))


def test_the_error_of_a_gear_ratio_has_that_of_the_gear() -> None:
    off = []
    for seed in range(60):
        rows = spring_rows(1.5e-3, seed)
        pairs = fitted_slope(*rows, 1.5), by_fit_alone(*rows)
        off.append([abs(slope - 700) / error for slope, error in pairs])
    covered, by_fit = np.mean(np.array(off) < 2, axis=0)
    assert covered > 0.8 > 0.6 > by_fit
    for seed in range(20):  # of a gear without an error it is hardly above that of the noise
        rows = spring_rows(0.0, seed)
        assert fitted_slope(*rows, 1.5)[1] < 3 * by_fit_alone(*rows)[1]


def test_noise_of_encoders_makes_no_other_gear_ratio() -> None:
    """It reduces the stiffness, and biased the ratio with it by up to 3.9 standard errors."""
    off = []
    for seed in range(60):
        (columns, torque), random = spring_rows(0.0, seed), np.random.default_rng((seed, 1))
        columns[:, :2] += random.normal(0, 2e-3, (len(torque), 2)) * (700, 1)
        slope, error = fitted_slope(columns, torque, 1.5)
        off.append(abs(slope - 700) / error)
    assert np.mean(np.array(off) < 2) > 0.9
    assert max(off) < 2.5


def test_a_motor_that_sticks_leaves_no_torque_unexplained(tmp_path: Path) -> None:
    """Its friction at standstill is anything up to that of Coulomb, and was 30 % of the torque."""
    rng = np.random.default_rng(1)
    ratio, inertia, coulomb, rate_hz = 50.0, 1e-5, 0.1, 500.0
    friction = ["viscous", "coulomb"]
    drive = {"type": "stiff", "gear_ratio": ratio, "friction": friction}
    robot = one_joint(tmp_path, drive={**drive, "motor_inertia_kg_m2": inertia})
    angles, signs, at = list[Array](), list[Array](), 0.0
    for to, moves, rests in rng.uniform(
        [-1.0, 300.0, 150.0], [1.0, 750.0, 500.0], (20, 3)
    ).tolist():
        s = np.arange(int(moves)) / int(moves)
        angles += [at + (to - at) * s**3 * (10 - 15 * s + 6 * s**2), np.full(int(rests), to)]
        signs += [np.full(int(moves), np.sign(to - at)), np.full(int(rests), np.nan)]
        at = to
    angle, sign = np.concatenate(angles), np.concatenate(signs)
    time, known = np.arange(len(angle)) / rate_hz, np.isfinite(sign)
    speed = np.gradient(ratio * angle, time)
    friction_torque = coulomb * np.interp(time, time[known], sign[known]) + 4e-5 * speed
    torque = (inertia + 1 / ratio**2) * np.gradient(speed, time) + friction_torque
    sensed = log_with(robot.joint_names, time, joint_position=angle, motor_torque=torque)
    found = check(robot, sensed)
    assert not found.warnings
    assert max(found.joints["arm"].bodies, found.joints["arm"].nominal) < 0.02
