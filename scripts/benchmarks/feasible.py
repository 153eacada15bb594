"""Physically consistent bodies of four robots: time, and distance from estimate and truth.

The estimate comes from noisy torques of the true robot at random states. In the robot file that
serves as the prior, every body is stretched, moved and heavier or lighter by about a tenth.

With `--programs 10000` random semidefinite programs are solved and compared with Clarabel instead,
see `scripts.benchmarks.random_programs`. `OPENBLAS_CORETYPE=Prescott` and others select the kernel,
and the table has a row per kernel:

    OPENBLAS_CORETYPE=Prescott python -m scripts.benchmarks.feasible --programs 10000
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import seaid
from scripts.benchmarks.random_programs import (
    HEADER,
    distorted,
    read,
    robot_named,
    run,
    summary,
)
from scripts.short_form import add_quick, few
from seaid._arrays import Array
from seaid.estimation import Estimate
from seaid.identification import FeasibleParameters
from seaid.identification.consistency import feasible_parameters
from seaid.regressor import base_parameters, rigid_body_regressor
from seaid.regressor.base import random_states
from seaid.regressor.load import LoadModel, load_model
from seaid.report import table
from seaid.report.formats import percent
from seaid.robot import is_physical

MODELS = Path(__file__).resolve().parents[2] / "models"
NOISE = 0.05
"""Standard deviation of the torque, relative to its root mean square."""


def robots() -> list[seaid.Robot]:
    """Return a leg of five joints and arms of six and seven, with locked fingers."""
    return [
        seaid.load_robot(MODELS / "tulip_leg.urdf"),
        robot_named("UR10"),
        robot_named("Panda"),
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


def row(robot: seaid.Robot) -> list[str]:
    """Return a row of the table."""
    model, estimate, unseen = estimated(robot, 0)
    truth, prior = model.base.project(robot.parameters), distorted(robot, np.random.default_rng(1))
    feasible_parameters(robot, model, estimate, weight=0.0)  # imports
    seconds, results = [], []
    for weight in (0.0, None):
        begin = time.perf_counter()
        results.append(feasible_parameters(robot, model, estimate, prior=prior, weight=weight))
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


def physical(found: FeasibleParameters) -> bool:
    """Return whether every body is physically consistent, by its eigenvalues."""
    return all(is_physical(body, 0.0) for body in found.parameters.reshape(-1, 10))


def robots_table() -> str:
    """Return the table of four robots."""
    header = ["robot", "p", "weight 0 [s]", "weight selected [s]", "least chi2", "chi2", "weight"]
    header += ["freedom", "file", "estimate", "weight 0", "selected"]
    title = "Physically consistent bodies; the last four are errors of the torque at unseen states"
    return table(title, header, [row(robot) for robot in few(robots())])


def programs_table(folder: Path) -> str:
    """Return the table of random semidefinite programs, with a row per kernel."""
    found = {path.stem.split("_")[1]: read(path) for path in sorted(folder.glob("programs_*"))}
    rows = [summary(name, outcomes) for name, outcomes in found.items()]
    return table("Random programs; differences relative to 1 + objective", HEADER, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--programs", type=int, help="number of random ones, instead of robots")
    parser.add_argument("--output", type=Path, default=Path("out/feasible"), help="result folder")
    add_quick(parser)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    if arguments.programs is None:
        print(robots_table())
    else:
        run(arguments.programs, arguments.output)
        print(programs_table(arguments.output))
