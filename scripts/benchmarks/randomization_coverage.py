"""How often the 95 % ranges of write_randomization hold the true values.

Each simulated robot is a two-joint arm whose bodies and drives differ from the nominal ones: bodies
by A exp(E) A^T with random symmetric E of the prior's spread, drives by factors. Its torques along
one fixed motion come from inverse dynamics, with noise of encoders and torques; it is identified
from the nominal robot, and each range counts that holds the true value.

    python scripts/benchmarks/randomization_coverage.py --robots 200
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from collections import defaultdict
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.linalg import expm

import seaid
from seaid._arrays import Array
from seaid.export import write_randomization
from seaid.regressor import rigid_body_regressor
from seaid.robot.inertia import from_pseudo_inertia, pseudo_inertia

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.terms import STIFF, arm

SPREAD, RATE_HZ, SECONDS = 0.1, 250.0, 8.0
ENCODER_RAD, TORQUE_NM = 2e-5, 2e-3


@dataclass
class Count:
    """How many ranges hold the truth."""

    held: int = 0
    all: int = 0

    def __str__(self) -> str:
        return f"{self.held} of {self.all}, {100 * self.held / max(self.all, 1):.1f} %"


@dataclass
class Coverage:
    """Counts by where a range comes from."""

    by_source: dict[str, Count] = field(default_factory=lambda: defaultdict(Count))


def motion() -> tuple[Array, Array, Array, Array]:
    """Return times, positions, speeds and accelerations of a motion of two joints."""
    time = np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    rng = np.random.default_rng(7)
    q, v, a = np.zeros((3, len(time), 2))
    for joint in range(2):
        for order in range(1, 7):
            w, phase = 2 * np.pi * order / SECONDS, rng.uniform(0, 2 * np.pi)
            size = 1.2 * rng.uniform(0.3, 1.0) / order**0.7
            q[:, joint] += size * np.sin(w * time + phase)
            v[:, joint] += size * w * np.cos(w * time + phase)
            a[:, joint] -= size * w**2 * np.sin(w * time + phase)
    return time, q, v, a


def true_robot(nominal: seaid.Robot, rng: np.random.Generator) -> seaid.Robot:
    """Return a robot that differs from the nominal one as the prior says."""
    bodies = []
    for ten in nominal.parameters.reshape(-1, 10):
        root = np.linalg.cholesky(pseudo_inertia(ten))
        E = rng.normal(size=(4, 4)) * SPREAD
        E = (E + E.T) / 2  # off the diagonal with the deviation 1 / sqrt(2)
        E[np.diag_indices(4)] = rng.normal(size=4) * SPREAD
        bodies.append(from_pseudo_inertia(root @ expm(E) @ root.T))
    drives = {
        joint: drive.with_values(
            {name: x * rng.uniform(0.7, 1.4) for name, x in drive.values.items()}
        )
        for joint, drive in nominal.drives.items()
    }
    return nominal.with_values(np.concatenate(bodies), drives)


def log_of(robot: seaid.Robot, rng: np.random.Generator) -> seaid.Log:
    """Return the log of a robot along the motion: inverse dynamics and noise."""
    time, q, v, a = motion()
    load = rigid_body_regressor(robot, q, v, a) @ robot.parameters
    torque = np.empty_like(q)
    ratios = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
    for index, joint in enumerate(robot.joint_names):
        drive, N = robot.drives[joint], ratios[index]
        x = drive.values
        torque[:, index] = load[:, index] / N + x["motor_inertia"] * N * a[:, index]
        torque[:, index] += x["viscous_friction"] * N * v[:, index]
        torque[:, index] += x["coulomb_friction"] * np.sign(v[:, index])
    q = q + rng.normal(size=q.shape) * ENCODER_RAD
    return seaid.Log(
        time=time,
        joint_names=robot.joint_names,
        motor_position=q * ratios,
        joint_position=q,
        motor_torque=torque + rng.normal(size=q.shape) * TORQUE_NM / 10,
    )


def study(robots: int, folder: Path, seed: int = 0) -> Coverage:
    """Return how many ranges of simulated robots hold the truth."""
    found = Coverage()
    drives = {"one": STIFF, "two": replace(STIFF, gear_ratio=30.0, motor_inertia_kg_m2=1e-5)}
    nominal = arm(folder, *drives.values())
    for number in range(robots):
        rng = np.random.default_rng((seed, number))
        truth = true_robot(nominal, rng)
        known = {
            joint: replace(drive, motor_inertia_kg_m2=truth.drives[joint].motor_inertia_kg_m2)
            for joint, drive in nominal.drives.items()
        }
        result = seaid.identify(
            nominal.with_drives(known), log_of(truth, rng), feasible=True, cutoff_hz=8.0
        )
        made = write_randomization(result, folder / "ranges.json", samples=0, spread=SPREAD)
        for one in made.ranges:
            if one.source != "given":
                count = found.by_source[one.source]
                count.all += 1
                count.held += one.low <= true_value(truth, one.of, one.name) <= one.high
    return found


def true_value(robot: seaid.Robot, of: str, name: str) -> float:
    """Return a parameter as the file has it: of a joint, or of a body at its centre of mass."""
    if of in robot.joint_names:
        drive = robot.drives[of]
        own = {"viscous_friction": ("viscous_friction", 2), "dry_friction": ("coulomb_friction", 1)}
        raw, power = own[name]
        return float(drive.values[raw] * drive.ratio**power)
    ten = robot.parameters.reshape(-1, 10)[robot.body_names.index(of)]
    body = pin.Inertia.FromDynamicParameters(ten)
    places = {"Ixx": (0, 0), "Ixy": (0, 1), "Iyy": (1, 1), "Ixz": (0, 2), "Iyz": (1, 2)}
    if name == "mass":
        return float(body.mass)
    if name.startswith("com"):
        return float(body.lever["xyz".index(name[-1])])
    return float(body.inertia[{**places, "Izz": (2, 2)}[name]])


def main() -> None:
    """Print the coverage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=200)
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    with tempfile.TemporaryDirectory() as folder:
        found = study(parser.parse_args().robots, Path(folder))
    for source, count in found.by_source.items():
        print(f"{source}: {count}")
    total = Count(*(sum(getattr(x, k) for x in found.by_source.values()) for k in ("held", "all")))
    print(f"all: {total}")


if __name__ == "__main__":
    main()
