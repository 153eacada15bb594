"""Largest violation of a linear limit by motions of random robots, sampled at 100 kHz."""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import seaid
from seaid._arrays import Array
from seaid.excitation.limits import joint_limits
from seaid.report import table

RATE_HZ, CHUNK = 100_000, 20_000
KINDS = ("position", "velocity", "acceleration")
BASES = {"bspline": (8, 24), "polynomial": (8, 18), "fourier": (7, 21)}
LINK = """<link name="{child}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial></link>
  <joint name="joint{number}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="{origin}" rpy="{turn}"/><axis xyz="{axis}"/>
  <limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="0"/></joint>"""


def random_urdf(rng: np.random.Generator) -> str:
    """Return a chain of one to seven joints, about one in four of them prismatic."""

    def numbers(least: float, most: float) -> str:
        return " ".join(f"{value:.3f}" for value in rng.uniform(least, most, 3))

    parts, parent = [], "ground"
    for number in range(rng.integers(1, 8)):
        lower, width = rng.uniform(-2, 1), 10 ** rng.uniform(-1, 0.6)
        child = f"link{number}"
        parts.append(
            LINK.format(
                child=child,
                com=numbers(-0.1, 0.1),
                mass=f"{rng.uniform(0.5, 5):.3f}",
                number=number,
                kind="prismatic" if rng.uniform() < 0.25 else "revolute",
                parent=parent,
                origin=numbers(-0.3, 0.3),
                turn=numbers(-1.5, 1.5),
                axis=("1 0 0", "0 1 0", "0 0 1")[rng.integers(3)],
                lower=f"{lower:.6f}",
                upper=f"{lower + width:.6f}",
                velocity=f"{10 ** rng.uniform(-1, 1):.6f}",
            )
        )
        parent = child
    return f'<robot name="random"><link name="ground"/>{"".join(parts)}</robot>'


def random_request(rng: np.random.Generator, robot: seaid.Robot, seed: int) -> dict[str, Any]:
    """Return a small planning budget with random ends, basis and acceleration limits."""
    basis = list(BASES)[rng.integers(3)]
    count = int(rng.integers(*BASES[basis]))
    return {
        "duration": float(10 ** rng.uniform(-0.3, 0.7)),
        "basis": basis,
        "coefficients": count + (1 - count % 2 if basis == "fourier" else 0),
        "limits": seaid.Limits(acceleration=10 ** rng.uniform(-0.5, 1.5, robot.n)),
        "rest_to_rest": bool(rng.integers(2)),
        "starts": 1,
        "iterations": 6,
        "seed": seed,
    }


def chunks(duration: float) -> Iterator[Array]:
    """Yield the times of samples at 100 kHz, and the end."""
    count = int(duration * RATE_HZ) + 1
    for first in range(0, count, CHUNK):
        yield np.arange(first, min(first + CHUNK, count)) / RATE_HZ
    yield np.array([duration])


def breach(robot: seaid.Robot, limits: seaid.Limits, trajectory: seaid.Trajectory) -> Array:
    """Return the largest relative violations of the limits of position, velocity, acceleration.

    Values are negative if a limit is kept. The unit of a position is half the range of the joint.
    """
    bounds = joint_limits(robot, limits)
    worst = np.full(3, -np.inf)
    for time in chunks(trajectory.duration):
        q, v, a = trajectory.sample(np.minimum(time, trajectory.duration))
        used = (
            np.abs(q - bounds.middle) / bounds.half_range,
            np.abs(v) / bounds.velocity,
            np.abs(a) / bounds.acceleration,
        )
        worst = np.maximum(worst, [np.max(part) - 1.0 for part in used])
    return worst


def main() -> None:
    """Plan motions of random robots and print the largest violation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=200, help="number of robots (default 200)")
    cases = parser.parse_args().cases
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    worst, planned, refused = np.full(3, -np.inf), 0, []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(cases):
            rng = np.random.default_rng(seed)
            path = Path(folder) / "robot.urdf"
            path.write_text(random_urdf(rng))
            robot = seaid.load_robot(path)
            request = random_request(rng, robot, seed)
            try:
                plan = seaid.design_excitation(robot, **request)
            except seaid.errors.ExcitationError as problem:
                refused.append(f"robot {seed}: {problem}")
                continue
            planned += 1
            worst = np.maximum(worst, breach(robot, request["limits"], plan.trajectory))
    title = f"{planned} of {cases} robots planned; violations relative to the limit, at 100 kHz"
    rows = [[kind, f"{part:.2e}"] for kind, part in zip(KINDS, worst, strict=True)]
    print(table(title, ["limit", "largest violation"], rows))
    for line in refused:
        print(line)


if __name__ == "__main__":
    main()
