"""Coverage of the 95 % intervals over many simulated experiments, for every estimator.

The TULip leg with its test mass moves along several planned motions, each simulated once. Every
experiment measures one of them with new torque noise, encoder offsets and quantisation. The
intervals of the base parameters allow for encoder offsets known to 2 mrad.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._files import result_folder
from seaid._progress import track
from seaid.excitation import BasisName
from seaid.log import Motion
from seaid.report import table
from seaid.report.formats import percent
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.identify_tulip_leg import (
    DURATION_S,
    ENCODER_OFFSET_STD_RAD,
    LIMITS,
    TEST_MASS,
    load_leg,
    sensors,
)
from scripts.short_form import add_quick, few, plan, sized

DEFAULT = "wls"
WAYS = ("wls", "ols", "huber", "tukey", "iv", "simultaneous", "refine")
MOTIONS = sized(4, 1)


@dataclass(frozen=True)
class Outcome:
    """Errors (P,), stated standard errors, half widths of 95 % intervals, by white noise too."""

    error: Array
    stated: Array
    half: Array
    white: Array


WANTED = (0.90, 0.98)
LEVEL = 0.95


def save_coverage_figure(
    names: Sequence[str],
    coverage: Mapping[str, Array],
    experiments: Mapping[str, int],
    path: str | Path,
) -> None:
    """Draw the coverage (P,) of each parameter's 95 % interval, one panel per estimator.

    `names` (P,) are the parameters, `experiments` the number per estimator. The grey band contains
    95 % of the dots if the intervals are correct; the dashed lines are the accepted range. Raises
    SeaidError if the file cannot be written.
    """
    from matplotlib.figure import Figure

    estimators, places = list(coverage), np.arange(len(names))
    height = 0.6 + 0.17 * len(names)
    figure = Figure(figsize=(2.2 + 1.5 * len(estimators), height), layout="constrained")
    axes = figure.subplots(1, len(estimators), sharey=True, squeeze=False)[0]
    for axis, one in zip(axes, estimators, strict=True):
        # binomial standard deviation of a share over N experiments: sqrt(p (1 - p) / N)
        half = 1.96 * np.sqrt(LEVEL * (1 - LEVEL) / experiments[one])
        axis.axvspan(LEVEL - half, min(LEVEL + half, 1.0), color="0.9", zorder=0)
        for edge in WANTED:
            axis.axvline(edge, color="tab:red", linestyle="--", linewidth=0.8)
        axis.plot(coverage[one], places, "o", color="black", markersize=3)
        axis.set_title(f"{one}, {experiments[one]}", fontsize="medium")
        axis.set_xlim(min(0.7, float(np.min(coverage[one])) - 0.02), 1.01)
        axis.grid(axis="y", color="0.94")
        axis.set_xlabel("share")
    axes[0].set_yticks(places, names, fontsize="x-small")
    axes[0].set_ylim(len(names) - 0.5, -0.5)
    figure.suptitle("Share of experiments whose 95 % interval contains the true value")
    figure.savefig(path, dpi=130)


def main(output: Path, experiments: int, others: int, jobs: int) -> None:
    """Simulate and identify, print two tables, draw the figure."""
    begin = time.perf_counter()
    result_folder(output)
    truth = load_leg((TEST_MASS,))
    with ProcessPoolExecutor(jobs) as executor:
        motions = list(
            track(list(executor.map(simulated, range(MOTIONS))), "simulating", progress_wanted())
        )
        found: dict[str, list[Outcome]] = {}
        for way in few(WAYS, 2):
            runs = range(experiments if way == DEFAULT else others)
            chosen = [motions[run % MOTIONS] for run in runs]
            done = executor.map(partial(experiment, way), chosen, runs, chunksize=2)
            shown = track(list(zip(runs, repeat(done))), way, progress_wanted())
            answers = [one for one in (next(results) for _, results in shown) if one]
            if answers:
                found[way] = answers
    names, drives = parameter_names(truth)
    print(parameter_table(names, found[DEFAULT]))
    print(way_table(found, drives))
    coverage = {way: held(outcomes) for way, outcomes in found.items()}
    counts = {way: len(outcomes) for way, outcomes in found.items()}
    save_coverage_figure(names, coverage, counts, output / "coverage.png")
    print(f"{time.perf_counter() - begin:.0f} s. Results: {output}")


def progress_wanted() -> bool:
    """Return whether standard error is a terminal."""
    return sys.stderr.isatty()


def simulated(number: int) -> Motion:
    """Return the motion of the leg along one of the plans."""
    truth = load_leg((TEST_MASS,))
    basis = get_args(BasisName)[number % 3]
    planned = plan(
        truth.without_nominal(), DURATION_S, basis=basis, limits=LIMITS, seed=number, starts=1
    )
    return simulate_motion(truth, planned.trajectory, noise=sensors(number))


def experiment(way: str, motion: Motion, run: int) -> Outcome | None:
    """Measure a motion with new noise and identify; None, with a message, if this fails."""
    truth = load_leg((TEST_MASS,))
    log = measure(truth, motion, sensors(1000 + run), run)
    known, zeros = truth.without_nominal(), ENCODER_OFFSET_STD_RAD
    identified = partial(seaid.identify, known, log, encoder_offset_std=zeros)
    try:
        if way == "simultaneous":
            found = identified(method="simultaneous")
        elif way == "refine":
            found = seaid.refine(identified(method="two-step"), log, encoder_offset_std=zeros)
        else:
            found = identified(method="two-step", estimator=cast(Any, way))
    except seaid.SeaidError as problem:
        print(f"{way}, experiment {run}: {problem}", file=sys.stderr)
        return None
    return outcome(truth, found)


def outcome(truth: seaid.Robot, found: seaid.Identification) -> Outcome:
    """Return errors and standard errors of drives with a true value, then of base parameters."""
    error, stated, half, white = [], [], [], []
    for joint, estimate in found.drives.items():
        exact = truth.drives[joint].values
        for index, name in enumerate(estimate.names):
            if name in exact:
                error.append(estimate.values[index] - exact[name])
                stated.append(estimate.standard_errors[index])
                half.append(half_widths(estimate)[index])
                white.append(1.96 * white_errors(estimate)[index])
    true = found.base.project(truth.parameters)
    return Outcome(
        np.concatenate([error, found.load.values - true]),
        np.concatenate([stated, found.load.standard_errors]),
        np.concatenate([half, half_widths(found.load)]),
        np.concatenate([white, 1.96 * white_errors(found.load)]),
    )


def half_widths(estimate: seaid.Estimate) -> Array:
    """Return half the widths of the 95 % intervals."""
    return np.asarray(np.diff(estimate.interval(LEVEL), axis=1)[:, 0] / 2)


def white_errors(estimate: seaid.Estimate) -> Array:
    """Return the standard errors of the white-noise formula, NaN if there are none."""
    white = estimate.white_standard_errors
    return np.full(len(estimate.values), np.nan) if white is None else white


def parameter_names(truth: seaid.Robot) -> tuple[list[str], int]:
    """Return the names of all parameters, and how many are of drives."""
    drives = [
        f"{name} of {joint}"
        for joint in truth.joint_names
        for name in truth.drives[joint].values
        if name != "motor_inertia"
    ]
    return [*drives, *seaid.base_parameters(truth).names], len(drives)


def held(outcomes: Sequence[Outcome], which: str = "half") -> Array:
    """Return the share (P,) of experiments whose 95 % interval contains the truth."""
    inside = [np.abs(one.error) < np.asarray(getattr(one, which)) for one in outcomes]
    return np.asarray(np.mean(inside, axis=0))


def parameter_table(names: Sequence[str], outcomes: Sequence[Outcome]) -> str:
    """Return the table of bias, scatter and coverage per parameter, for the default estimator."""
    scores = np.array([one.error / one.stated for one in outcomes])
    covered, white = held(outcomes), held(outcomes, "white")
    rows = [
        [name, *(f"{value:.2f}" for value in (bias, spread)), percent(share), percent(plain)]
        for name, bias, spread, share, plain in zip(
            names,
            scores.mean(axis=0),
            scores.std(axis=0),
            covered,
            white,
            strict=True,
        )
    ]
    header = ["parameter", "bias/s.e.", "std/s.e.", "coverage of 95 %", "white formula"]
    return table(f"{DEFAULT}, {len(outcomes)} experiments", header, rows)


def way_table(found: dict[str, list[Outcome]], drives: int) -> str:
    """Return the table of coverage and rms error per estimator, separate for drives and base."""
    rows = []
    for way, outcomes in found.items():
        share = held(outcomes)
        same = found[DEFAULT][: len(outcomes)]
        ratio = rms(outcomes) / rms(same)
        entries = []
        for part in (slice(drives), slice(drives, None)):
            least, middle, most = np.quantile(share[part], (0.0, 0.5, 1.0))
            entries += [*map(percent, (least, middle, most)), f"{np.median(ratio[part]):.2f}"]
        rows.append([way, str(len(outcomes)), *entries])
    header = ["estimator", "experiments", "drives: least", "median", "most", "rms"]
    header += ["base: least", "median", "most", "rms"]
    return table(f"Coverage, and rms error over that of {DEFAULT}", header, rows)


def rms(outcomes: Sequence[Outcome]) -> Array:
    """Return the rms error (P,)."""
    return np.asarray(np.sqrt(np.mean([one.error**2 for one in outcomes], axis=0)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--experiments", type=int, default=200, help="of the default estimator")
    parser.add_argument("--others", type=int, default=40, help="of each other estimator")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--output", type=Path, default=Path("out/coverage"), help="result folder")
    add_quick(parser)
    arguments = parser.parse_args()
    main(arguments.output, arguments.experiments, arguments.others, arguments.jobs)
