"""Quadrupeds on the ground in MuJoCo: intervals, total mass, unseen motions, radius of the feet.

Run from the folder of the project: python -m scripts.benchmarks.legged [motions [draws]]
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

import seaid
from scripts.example_robots import example_urdf
from scripts.legged_plant import (
    GO2,
    HOME,
    SOLO12,
    Quadruped,
    Targets,
    changed_bodies,
    plan,
    plant,
    simulate,
)
from scripts.short_form import few, sized, words
from seaid._arrays import Array
from seaid.legged import whole_body
from seaid.legged.base import turned_to_world
from seaid.log.base_log import moving_base

NOISE = {"joint_position": 2e-4, "motor_torque": 0.1 / 45}
"""Standard deviation of the encoders [rad], and of the torques over their limit."""

IMU_NOISE = {"angular_velocity": 0.003, "specific_force": 0.05}
DURATION_S = 60.0
FIRST_SEED = 10
"""Seeds before it were used to choose what samples next to a change of contact are not used."""


def noisy(log: seaid.Log, seed: int, legs: Quadruped = GO2) -> seaid.Log:
    """Return a log with white noise on encoders [rad], torques [N m] and the IMU [rad/s, m/s^2]."""
    rng = np.random.default_rng(seed)
    assert log.base is not None
    imu: dict[str, Any] = {
        name: getattr(log.base, name) + size * rng.normal(size=(len(log.time), 3))
        for name, size in IMU_NOISE.items()
    }
    sizes = {**NOISE, "motor_torque": NOISE["motor_torque"] * legs.torque_limit}
    own: dict[str, Any] = {
        name: (values := getattr(log, name)) + size * rng.normal(size=values.shape)
        for name, size in sizes.items()
    }
    return replace(log, base=replace(log.base, **imu), **own)


def quadruped(legs: Quadruped, urdf: Path | None = None, balls: bool = True) -> seaid.Robot:
    """Return a quadruped with a floating base, from its file or one with other bodies."""
    contacts: Any = legs.contacts if balls else list(legs.feet)
    path = example_urdf(legs.urdf) if urdf is None else urdf
    return seaid.load_robot(path, base="floating", contacts=contacts)


def intervals(legs: Quadruped, motions: int, draws: int, duration_s: float) -> None:
    """Print coverage, errors of the mass, and torques of an unseen motion, of changed bodies."""
    nominal, z, masses, unseen, seconds = quadruped(legs).without_nominal(), [], [], [], []
    holds: list[Array] = []
    for motion in range(FIRST_SEED, FIRST_SEED + motions):
        with tempfile.TemporaryDirectory() as folder:
            path = changed_bodies(example_urdf(legs.urdf), Path(folder), motion)
            robot = quadruped(legs, path)
            model = plant(robot)
        log = simulate(robot, model, duration_s, 2 * motion, legs=legs)
        other = simulate(robot, model, min(12.0, duration_s), 2 * motion + 1, legs=legs)
        for draw in range(draws):
            start = time.process_time()
            found = seaid.identify(nominal, noisy(log, 1000 * motion + draw, legs))
            seconds.append(time.process_time() - start)
            truth = found.base.project(robot.parameters)
            error = found.load.values - truth
            z.append(error / found.load.standard_errors)
            lower, upper = found.load.interval().T
            holds.append((lower < truth) & (truth < upper))
            row = found.base.names.index(f"m_{moving_base(nominal).link}")
            masses.append(error[row] / truth[row])
        fit = seaid.validate(found, other).load
        unseen.append(fit.whole_relative_error)
        print(
            f"  motion {motion}: {np.mean(holds[-draws:]):.1%} hold, rms score "
            f"{np.mean(np.square(z[-draws:])) ** 0.5:.2f}, cutoff {found.cutoff_hz:.3g} Hz, unseen "
            f"{unseen[-1]:.2%}, worst joint {np.max(fit.relative_error):.2%}",
            flush=True,
        )
    every = np.array(z)
    print(f"{legs.urdf}: {motions} motions and bodies, {draws} draws each of {duration_s:g} s")
    print(f"  95 % intervals that hold: {np.mean(holds):.1%} of {every.size}")
    print(f"  rms score: {np.mean(every**2) ** 0.5:.2f}")
    print(f"  largest error of the total mass: {np.max(np.abs(masses)):.2%}")
    print(f"  torques of an unseen motion: {np.max(unseen):.2%} error at most")
    print(f"  identify: {np.median(seconds):.1f} s of processor time (median)")


def planned(robot: seaid.Robot, legs: Quadruped, duration_s: float, seed: int) -> Targets:
    """Return an exciting motion in stance of the bodies of the file."""
    stance = seaid.excitation.Stance(legs.feet, posture=HOME.tolist(), friction=0.5, least_load=0.3)
    excitation = seaid.design_excitation(
        robot,
        duration_s,
        stance=stance,
        limits=seaid.Limits(velocity=6.0, acceleration=30.0),
        criterion="d_optimality",
        starts=1,
        iterations=10,
        seed=seed,
    )
    assert excitation.stance is not None
    time = excitation.stance.time
    angles = excitation.trajectory.sample(time)[0]
    return Targets(time, angles, excitation.stance.joint_torques)


def standing(motions: int, draws: int, legs: Quadruped = GO2) -> None:
    """Print the coverage of motions in stance, swayed by hand and planned, of changed bodies."""
    of_file = quadruped(legs)
    nominal = of_file.without_nominal()
    for name, duration_s in sized(
        (("sways", 8.0), ("sways", 40.0), ("planned", 8.0)), (("sways", 3.0),)
    ):
        z, holds, errors, counts = [], [], [], set()
        for motion in range(FIRST_SEED, FIRST_SEED + motions):
            with tempfile.TemporaryDirectory() as folder:
                robot = quadruped(
                    legs, changed_bodies(example_urdf(legs.urdf), Path(folder), motion)
                )
                model = plant(robot)
            make = partial(plan, lifted=False) if name == "sways" else planned
            targets = make(of_file, legs, duration_s, motion)
            log = simulate(robot, model, duration_s, legs=legs, targets=targets)
            for draw in range(draws):
                found = seaid.identify(nominal, noisy(log, 1000 * motion + draw, legs))
                truth = found.base.project(robot.parameters)
                z.append((found.load.values - truth) / found.load.standard_errors)
                lower, upper = found.load.interval().T
                holds.append((lower < truth) & (truth < upper))
                errors.append(np.median(found.load.standard_errors))
                counts.add(len(truth))
        print(
            f"{legs.urdf} in stance, {name}, {motions} motions of {duration_s:g} s and bodies, "
            f"{draws} draws each: {np.mean(np.concatenate(holds)):.1%} of the intervals hold, rms "
            f"score {np.mean(np.concatenate(z) ** 2) ** 0.5:.2f}, {min(counts)} to {max(counts)} "
            f"parameters, median standard error {np.median(errors):.2g}",
            flush=True,
        )


def estimator(draws: int, legs: Quadruped = GO2) -> None:
    """Print scores of the whole robot with the velocity of a state estimator in place of an IMU."""
    robot = quadruped(legs)
    log = simulate(robot, plant(robot), sized(40.0, 3.0), 3)
    base = log.base
    assert base is not None
    assert base.orientation is not None
    assert base.angular_velocity is not None
    assert base.specific_force is not None
    acceleration = turned_to_world(base.orientation, base.specific_force) - [0.0, 0.0, 9.81]
    velocity = cumulative_trapezoid(acceleration, log.time, axis=0, initial=0.0)
    squares, names = [], []
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        turned = base.orientation + 1.5e-4 * rng.normal(size=(len(log.time), 4))
        own = replace(
            base,
            orientation=turned / np.linalg.norm(turned, axis=1)[:, None],
            velocity=velocity + 3e-3 * rng.normal(size=velocity.shape),
            specific_force=None,
            angular_velocity=base.angular_velocity + 5e-3 * rng.normal(size=velocity.shape),
        )
        angles = log.joint_position + 2e-4 * rng.normal(size=log.joint_position.shape)
        torques = log.motor_torque + 0.1 * rng.normal(size=log.motor_torque.shape)
        given = replace(log, base=own, joint_position=angles, motor_torque=torques)
        found = seaid.identify(robot.without_nominal(), given)
        truth = found.base.project(robot.parameters)
        exact = whole_body(replace(found, load=replace(found.load, values=truth)))[:4]
        pairs = list(zip(whole_body(found)[:4], exact, strict=True))
        names = [one.name for one, _ in pairs]
        own_scores = [(one.value - true.value) / one.standard_error for one, true in pairs]
        scores = (found.load.values - truth) / found.load.standard_errors
        squares.append([*np.square(own_scores), np.mean(scores**2)])
    print(f"{legs.urdf}: velocity of the base with 3 mm/s of noise, {draws} draws; rms scores")
    for name, score in zip([*names, "base parameters"], np.mean(squares, axis=0), strict=True):
        print(f"  {name}: {score**0.5:.2f}")


def main() -> None:
    """Print the tables."""
    motions, draws = (int(x) for x in [*words(), "3", "2"][:2])
    robot = quadruped(GO2)
    duration_s = sized(DURATION_S, 3.0)
    for kind, soft in few((("stiff", False), ("soft", True))):
        log = simulate(robot, plant(robot, soft=soft), duration_s)
        for name, one in few((("balls", robot), ("points", quadruped(GO2, balls=False)))):
            fits = seaid.identify(one, log, cutoff_hz=5.0).joint_fits.values()
            own = np.mean([x.own for x in fits])
            print(f"unexplained torque without noise, {kind} feet as {name}: {own:.2%}")
    for legs in few((GO2, SOLO12)):
        intervals(legs, motions, draws, duration_s)
    standing(motions, draws)
    estimator(sized(12, 1))


if __name__ == "__main__":
    main()
