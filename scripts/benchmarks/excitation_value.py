"""Benefit of planning: identification on simulated logs of planned motions and of a random one.

The TULip leg with the test mass moves for 10 s, rest to rest, within the same limits. Each entry is
the factor by which an error is smaller with the planned motion than with the random one: predicted
by the plan, stated by the identification, and actual over draws of noise and encoder offsets. The
plans assume that every torque is as accurate as that of the motor; a spring measures the torque of
its joint better.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._progress import track
from seaid.excitation import EndState, make_basis
from seaid.excitation.boundary import motion_space
from seaid.excitation.criteria import CRITERIA, CriterionName, triangular_factor
from seaid.excitation.flatness import transmission
from seaid.excitation.limits import joint_limits
from seaid.excitation.observation_matrix import Target, drive_target, stacked_regressor
from seaid.excitation.problem import make_problem, previous_logs_factor, scaled_target
from seaid.report import table
from seaid.report.formats import percent
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.identify_tulip_leg import (
    DURATION_S,
    ENCODER_OFFSET_STD_RAD,
    LIMITS,
    TEST_MASS,
    load_leg,
    sensors,
)
from scripts.short_form import PLAN_S, add_quick, few, sized
from scripts.short_form import plan as planned

SHOWN = ("stiffness", "coulomb_friction", "viscous_friction")
COEFFICIENTS, SAMPLES = sized((35, 140), (12, 40))
PLANNED_S = sized(DURATION_S, PLAN_S)


def torque_std(truth: seaid.Robot) -> list[float]:
    """Return the noise of the motor torque sensors, referred to the joints [N m]."""
    return [float(std) for std in transmission(truth).ratio * sensors(0).torque_std_Nm]


def plan(truth: seaid.Robot, criterion: CriterionName, **request: Any) -> seaid.Excitation:
    """Return a plan that excites bodies and drives; nominal values are the true ones."""
    return planned(
        truth,
        PLANNED_S,
        limits=LIMITS,
        criterion=criterion,
        drive_parameters=True,
        torque_std=torque_std(truth),
        coefficients=COEFFICIENTS,
        samples=SAMPLES,
        **request,
    )


def run(found: seaid.Excitation, draws: int) -> tuple[Array, Array]:
    """Return errors and stated standard errors (draws, p) of the plan's parameters."""
    truth = load_leg((TEST_MASS,))
    known = truth.without_nominal()
    motion = simulate_motion(truth, found.trajectory, noise=sensors(0))
    both = []
    for draw in range(draws):
        log = measure(truth, motion, sensors(draw), draw)
        identified = seaid.identify(known, log, encoder_offset_std=ENCODER_OFFSET_STD_RAD)
        both.append(errors_of(truth, found, identified))
    errors, stated = np.array(both).transpose(1, 0, 2)
    return errors, stated


def errors_of(
    truth: seaid.Robot, found: seaid.Excitation, identified: seaid.Identification
) -> tuple[Array, Array]:
    """Return error and standard error (p,) of the plan's parameters, base first."""
    grouping = found.base.grouping[:, list(identified.base.columns)]
    off = grouping @ (identified.load.values - identified.base.project(truth.parameters))
    covariance = grouping @ identified.load.covariance @ grouping.T
    errors, stated = list(off), list(np.sqrt(np.diag(covariance)))
    for name, joint in drive_names(found):
        estimate = identified.drives[joint]
        there = name in estimate.names
        true = truth.drives[joint].values.get(name, np.nan)
        errors.append(estimate.value(name) - true if there else np.nan)
        stated.append(estimate.standard_error(name) if there else np.nan)
    return np.array(errors), np.array(stated)


def drive_names(found: seaid.Excitation) -> list[tuple[str, str]]:
    """Return (parameter, joint) of the drive parameters of a plan."""
    parts = [name.rpartition(" of ") for name in found.names[len(found.base.columns) :]]
    return [(name, joint) for name, _, joint in parts]


def value_table(plans: Sequence[seaid.Excitation], draws: int) -> str:
    """Return the table of errors of the random motion (the last plan) over those of the others."""
    with ProcessPoolExecutor(2) as executor:
        futures = [executor.submit(run, found, draws) for found in plans]
        done = [future.result() for future in track(futures, "simulating and identifying", True)]
    sizes = [
        (found.standard_errors, stated.mean(axis=0), np.sqrt(np.mean(errors**2, axis=0)))
        for found, (errors, stated) in zip(plans, done, strict=True)
    ]
    ratios = np.array([[sizes[-1][i] / size[i] for i in range(3)] for size in sizes[:-1]])
    truth, p, rows = load_leg((TEST_MASS,)), len(plans[0].base.columns), []
    for index, (name, joint) in enumerate(drive_names(plans[0]), p):
        if name in SHOWN and np.all(np.isfinite(ratios[:, :, index])):
            true = truth.drives[joint].values[name]
            shown = percent(sizes[-1][1][index] / true)
            rows.append([f"{name} of {joint}", shown, *map(line, ratios[:, :, index])])
    for label, pick in (("median", np.median), ("least", np.min)):
        rows.append([f"{p} base, {label}", "-", *map(line, pick(ratios[:, :, :p], axis=2))])
    title = (
        "Errors of the random motion (stated: 'random') over those of the planned one: predicted, "
        f"stated, actual of {draws} draws"
    )
    return table(title, ["parameter", "random", *few(CRITERIA)], rows)


def line(ratios: Array) -> str:
    """Return the three ratios of one entry."""
    return "  ".join(f"{ratio:.2f}" for ratio in ratios)


def sequential_table(truth: seaid.Robot, first: seaid.Excitation, random: seaid.Excitation) -> str:
    """Return the worst relative error predicted after a log and another motion.

    The log is of the planned motion, or of the random one.
    """
    alone = plan(truth, "relative_error", seed=4, progress=True)
    target, columns = relative_target(truth, first), []
    for previous_logs in few((first, random)):
        motion = simulate_motion(truth, previous_logs.trajectory, noise=sensors(0))
        log = measure(truth, motion, sensors(0), 0)
        factor = previous_logs_factor(target, truth, [log])
        after = plan(truth, "relative_error", previous_logs=[log], seed=4, progress=True)
        motions = (None, previous_logs, random, alone, after)
        columns.append([f"{worst_error(target, factor, found):.3f}" for found in motions])
    names = (
        "the log alone",
        "and its motion again",
        "and the random motion",
        "and another motion, planned alone",
        "and a motion planned with previous_logs=[log]",
    )
    rows = [list(row) for row in zip(names, *columns, strict=True)]
    header = ["data", *few(("log of the planned motion", "log of the random motion"))]
    return table("Sequential design: worst relative standard error", header, rows)


def relative_target(truth: seaid.Robot, found: seaid.Excitation) -> Target:
    """Return the target of the plans for "relative_error", with the same scaling."""
    bounds = joint_limits(truth, LIMITS)
    basis = make_basis("bspline", PLANNED_S, COEFFICIENTS)
    space = motion_space(basis, truth.joint_names, bounds, EndState(), EndState())
    target = drive_target(truth, None, found.base, bounds.velocity)
    problem = make_problem(target, "relative_error", space, SAMPLES, bounds, None, None)
    return scaled_target(problem, truth, found.base, torque_std(truth), relative=True)


def worst_error(target: Target, factor: Array, found: seaid.Excitation | None) -> float:
    """Return the worst relative error from a QR factor, and from another motion if there is one."""
    H = np.empty((0, len(target.names)))
    if found is not None:
        instants = np.linspace(0.0, PLANNED_S, 10 * SAMPLES)
        H = stacked_regressor(target, instants, found.trajectory.sample(instants))
    R = triangular_factor(H, factor)
    return float(np.exp(CRITERIA["relative_error"].log_value(R)))


def main() -> None:
    """Plan, simulate, identify, print both tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=16, help="of noise and encoder offsets")
    add_quick(parser)
    draws = parser.parse_args().draws
    begin = time.perf_counter()
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    truth = load_leg((TEST_MASS,))
    plans = [plan(truth, criterion, seed=2, progress=True) for criterion in few(CRITERIA)]
    random = plan(truth, "condition_number", seed=2, starts=1, iterations=1)
    conditions = [f"{found.condition_number:.0f}" for found in (*plans, random)]
    print(f"Condition numbers: {', '.join(conditions)} ({', '.join(few(CRITERIA))}, random)")
    print(value_table([*plans, random], draws))
    print(sequential_table(truth, plans[-1], random))
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
