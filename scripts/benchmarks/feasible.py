"""Possible bodies of four robots: how long they take, how far they are from estimate and truth.

The estimate is the truth with noise of a torque sensor, at random states; the robot file the search
starts from has every body stretched, moved and heavier or lighter by about a tenth.
"""

from __future__ import annotations

import time
import warnings
from importlib.metadata import files
from pathlib import Path

import numpy as np

import seaid
from seaid.arrays import Array
from seaid.base import base_parameters, random_states
from seaid.bodies.possible_bodies import PossibleBodies, possible_bodies
from seaid.estimation.estimate import Estimate
from seaid.inertia import from_pseudo_inertia, is_physical, pseudo_inertia
from seaid.report.text import percent, table
from seaid.rigid_body import rigid_body_regressor
from seaid.sides.load_model import LoadModel, load_model

MODELS = Path(__file__).resolve().parents[2] / "models"
NOISE = 0.05
"""Standard deviation of the torque, relative to its root mean square."""


def robots() -> list[seaid.Robot]:
    """Return a leg of five joints and arms of six and seven; fingers locked."""
    examples = {path.name: Path(str(path.locate())) for path in files("example-robot-data") or []}
    arm = [f"panda_joint{number}" for number in range(1, 8)]
    return [
        seaid.load_robot(MODELS / "tulip_leg.urdf"),
        seaid.load_robot(examples["ur10_robot.urdf"]),
        seaid.load_robot(examples["panda.urdf"], joints=arm),
        seaid.load_robot(MODELS / "philips_arm.urdf"),
    ]


def estimated(robot: seaid.Robot, seed: int) -> tuple[LoadModel, Estimate, Array]:
    """Return the model, an estimate of the truth from noisy torques, and an unseen regressor."""
    model = load_model(robot, base_parameters(robot), robot.joint_names)
    H, unseen = (
        model.base.reduce(rigid_body_regressor(robot, *random_states(robot, one))).reshape(
            -1, len(model.expressions)
        )
        for one in (seed, seed + 100)
    )
    torque = H @ model.base.project(robot.parameters)
    std = NOISE * float(np.sqrt(np.mean(torque**2)))
    noisy = torque + std * np.random.default_rng(seed).normal(size=len(torque))
    inverse = np.asarray(np.linalg.inv(H.T @ H))
    values = inverse @ (H.T @ noisy)
    condition = float(np.linalg.cond(H / np.linalg.norm(H, axis=0)))
    estimate = Estimate(model.names, values, std**2 * inverse, model.units, std, condition)
    return model, estimate, unseen


def distorted(robot: seaid.Robot, seed: int) -> Array:
    """Return standard parameters as a robot file has them: possible, and wrong by a tenth."""
    rng = np.random.default_rng(seed)
    bodies = []
    for body in robot.parameters.reshape(-1, 10):
        change = np.eye(4)
        change[:3, :3] += 0.1 * rng.normal(size=(3, 3))
        change[:3, 3] = 0.01 * rng.normal(size=3)
        pseudo = change @ pseudo_inertia(body) @ change.T
        bodies.append(from_pseudo_inertia(pseudo * np.exp(0.1 * rng.normal())))
    return np.concatenate(bodies)


def row(robot: seaid.Robot) -> list[str]:
    """Return a row of the table."""
    model, estimate, unseen = estimated(robot, 0)
    truth, prior = model.base.project(robot.parameters), distorted(robot, 1)
    possible_bodies(robot, model, estimate, weight=0.0)  # imports
    seconds, results = [], []
    for weight in (0.0, None):
        begin = time.perf_counter()
        results.append(possible_bodies(robot, model, estimate, prior=prior, weight=weight))
        seconds.append(time.perf_counter() - begin)
    assert all(physical(one) for one in results)
    scale = np.linalg.norm(unseen @ truth)
    errors = [
        percent(float(np.linalg.norm(unseen @ (values - truth)) / scale))
        for values in (model.base.project(prior), estimate.values, *(one.values for one in results))
    ]
    found = results[1]
    return [
        f"{robot.name} ({robot.n} joints)",
        f"{len(truth)}",
        *(f"{one:.2f}" for one in seconds),
        f"{found.nearest_chi_square:.1f}",
        f"{found.chi_square:.1f}",
        f"{found.weight:.2g}",
        f"{found.freedom:.1f}",
        *errors,
    ]


def physical(found: PossibleBodies) -> bool:
    """Tell whether every body is possible, by its eigenvalues."""
    return all(is_physical(body, 0.0) for body in found.parameters.reshape(-1, 10))


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    header = ["robot", "p", "weight 0 [s]", "weight chosen [s]", "least chi2", "chi2", "weight"]
    header += ["freedom", "file", "estimate", "weight 0", "chosen"]
    rows = [row(robot) for robot in robots()]
    print(
        table(
            "Possible bodies; the last four are errors of the torque at unseen states", header, rows
        )
    )


if __name__ == "__main__":
    main()
