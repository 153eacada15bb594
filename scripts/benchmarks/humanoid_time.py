"""Processor time and memory of `identify` for 100 s of a humanoid with 29 joints at 500 Hz.

Run from the folder of the project: python -m scripts.benchmarks.humanoid_time [seconds]
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

import seaid
from scripts.example_robots import example_urdf
from seaid._arrays import Array
from seaid.legged.floating import contact_map, floating_regressor
from seaid.log import BaseLog
from seaid.log.base_log import moving_base
from seaid.robot import Contact

FEET = ("left_ankle_roll_link", "right_ankle_roll_link")
RATE_HZ, BLOCK = 500.0, 1000


def humanoid() -> seaid.Robot:
    """Return the G1 of example-robot-data with a floating base and two flat feet."""
    contacts = [Contact(foot, (0.035, 0.0, -0.035), is_flat=True) for foot in FEET]
    path = example_urdf("g1_29dof_rev_1_0.urdf")
    return seaid.load_robot(path, base="floating", contacts=contacts)


def stepping(robot: seaid.Robot, duration_s: float, seed: int = 0) -> seaid.Log:
    """Return a log of smooth random motion with exact torques; its feet touch in turn.

    The forces are the least that hold the base; noise of 0.1 N m is on the torques.
    """
    rng, t = np.random.default_rng(seed), np.arange(0, duration_s, 1 / RATE_HZ)

    def waves(count: int, size: float) -> tuple[Array, Array, Array]:
        found = np.zeros((3, len(t), count))
        for _ in range(4):
            turn = 2 * np.pi * rng.uniform(0.1, 1.0, count)
            angle, own = np.outer(t, turn) + rng.uniform(0, 6, count), size / 2
            found += own * np.array(
                [np.sin(angle), turn * np.cos(angle), -(turn**2) * np.sin(angle)]
            )
        return found[0], found[1], found[2]

    q, v, a = waves(robot.n, 0.4)
    w, e, _ = waves(3, 0.5)
    f = waves(3, 1.5)[0] + np.array([0, 0, 9.81])
    base = moving_base(robot)
    phase = (t // 2).astype(int) % 3  # both feet, the left one, the right one
    touching = np.array([phase != 2, phase != 1]).T
    torque = np.empty_like(q)
    for start in range(0, len(t), BLOCK):
        part = slice(start, start + BLOCK)
        rows = floating_regressor(robot, q[part], v[part], a[part], (w[part], e[part], f[part]))
        need = rows @ robot.parameters
        A = (
            contact_map(robot, q[part], base.contacts)
            * np.repeat(touching[part], 6, axis=1)[:, None]
        )
        forces = np.einsum("tkr,tr->tk", np.linalg.pinv(A[:, :6]), need[:, :6])
        torque[part] = (need - np.einsum("trk,tk->tr", A, forces))[:, 6:]
    return seaid.Log(
        time=t,
        joint_names=robot.joint_names,
        joint_position=q,
        motor_position=np.full_like(q, np.nan),
        motor_torque=torque + 0.1 * rng.normal(size=q.shape),
        base=BaseLog(
            angular_velocity=w,
            specific_force=f,
            contacts=dict(zip(FEET, touching.T.astype(float), strict=True)),
        ),
    )


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Print the time and the memory."""
    robot = humanoid()
    log = stepping(robot, float(sys.argv[1]) if len(sys.argv) > 1 else 100.0)
    before, start = _peak_mb(), time.process_time()
    found = seaid.identify(robot.without_nominal(), log)
    seconds = time.process_time() - start
    truth = found.base.project(robot.parameters)
    z = (found.load.values - truth) / found.load.standard_errors
    print(f"{robot.n} joints, {len(log.time):,} samples, cutoff {found.cutoff_hz:.3g} Hz")
    print(f"{len(truth)} base parameters, {np.mean(np.abs(z) < 1.96):.1%} of 95 % intervals hold")
    print(
        f"processor time {seconds:.1f} s, peak memory {_peak_mb():,.0f} MB ({before:,.0f} before)"
    )


if __name__ == "__main__":
    main()
