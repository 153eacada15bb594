"""A quadruped on the ground in MuJoCo: intervals, total mass, and the radius of its feet.

Run from the folder of the project: python -m scripts.benchmarks.legged [draws]
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np

import seaid
from scripts.example_robots import example_urdf
from scripts.legged_plant import GO2_FEET, ball_feet, plant, simulate

NOISE = {"joint_position": 2e-4, "motor_torque": 0.1}
IMU_NOISE = {"angular_velocity": 0.003, "specific_force": 0.05}
DURATION_S = 30.0


def noisy(log: seaid.Log, seed: int) -> seaid.Log:
    """Return a log with white noise on encoders [rad], torques [N m] and the IMU [rad/s, m/s^2]."""
    rng = np.random.default_rng(seed)
    assert log.base is not None
    imu: dict[str, Any] = {
        name: getattr(log.base, name) + size * rng.normal(size=(len(log.time), 3))
        for name, size in IMU_NOISE.items()
    }
    own: dict[str, Any] = {
        name: (values := getattr(log, name)) + size * rng.normal(size=values.shape)
        for name, size in NOISE.items()
    }
    return replace(log, base=replace(log.base, **imu), **own)


def go2(feet: Any) -> seaid.Robot:
    """Return the Go2 of example-robot-data with a floating base."""
    return seaid.load_robot(example_urdf("go2.urdf"), base="floating", contacts=feet)


def main() -> None:
    """Print the table."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    robot, points = go2(ball_feet()), go2(GO2_FEET)
    log = simulate(robot, plant(robot), DURATION_S)
    for name, one in (("balls as they are", robot), ("points at their centres", points)):
        fits = seaid.identify(one, log).joint_fits.values()
        print(f"unexplained torque without noise, {name}: {np.mean([x.own for x in fits]):.2%}")
    inside, masses, scores, seconds = [], [], [], []
    for seed in range(draws):
        start = time.process_time()
        found = seaid.identify(robot.without_nominal(), noisy(log, seed))
        seconds.append(time.process_time() - start)
        truth = found.base.project(robot.parameters)
        error = found.load.values - truth
        z = error / found.load.standard_errors
        inside.append(np.mean(np.abs(z) < 1.96))
        scores.append(np.mean(z**2))
        row = found.base.names.index("m_base")
        masses.append(error[row] / truth[row])
    print(f"{draws} draws of {DURATION_S:g} s, {len(truth)} base parameters")
    print(
        f"95 % intervals that hold: {np.mean(inside):.1%}; rms score {np.mean(scores) ** 0.5:.2f}"
    )
    print(f"largest error of the total mass: {np.max(np.abs(masses)):.2%}")
    print(f"identify: {np.median(seconds):.1f} s of processor time (median)")


if __name__ == "__main__":
    main()
