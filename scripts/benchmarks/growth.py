"""How the time of work grows with samples, joints and parameters: slopes of log time over log size.

    python -m scripts.benchmarks.growth
    python -m scripts.benchmarks.growth --only samples --largest 10000000

A slope is that between the two largest sizes, where constant costs weigh least. The last column is
the exponent that the mathematics asks for, with its reason. Times are processor times of one core,
each the least of three runs that take less than a second.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import count
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[2]))

import seaid
from scripts.benchmarks.fast import chain
from scripts.benchmarks.long_log import (
    CUTOFF_HZ,
    RATE_HZ,
    elastic_robot,
    random_rows,
    robot,
    write_elastic_log,
)
from scripts.short_form import add_quick, sized
from seaid._arrays import Array
from seaid.estimation.least_squares import ordinary
from seaid.regressor import base_parameters, rigid_body_regressor
from seaid.report import table

INSTANTS = sized(300, 30)
"""Samples of a robot whose number of joints grows."""
ROWS = sized(20_000, 400)
"""Rows of an estimate whose number of parameters grows."""
LEAST_PERIODS = 12.0
"""Periods of the cutoff that the shortest log has; `identify` refuses less than ten."""
MARGIN = 0.2
"""A slope above its exponent that noise and caches explain; beyond it the row is marked."""

Work = Callable[[], object]


@dataclass(frozen=True)
class Growth:
    """Work of a size, its sizes, and the exponent that its mathematics asks for."""

    title: str
    axis: str
    sizes: tuple[int, ...]
    exponent: int
    reason: str
    prepare: Callable[[int, Path], Work]


@cache
def _motion(joints: int, samples: int) -> tuple[Array, ...]:
    states = np.random.default_rng(0).uniform(-1, 1, (3, samples, joints))
    return tuple(states)


def stacked_regressor(samples: int, _: Path) -> Work:
    """Return the regressor of an arm with seven joints at all samples."""
    arm = robot()
    return lambda: rigid_body_regressor(arm, *_motion(arm.n, samples))


def identified(samples: int, folder: Path, *, streamed: bool) -> Work:
    """Return the identification of seven joints with springs, from a file or in memory."""
    path = folder / f"{samples}.npz"
    write_elastic_log(path, samples)
    arm = elastic_robot()
    log = path if streamed else seaid.read_log(path, arm)
    # A second has too few periods of that cutoff: the same of a log is its duration, not its rate.
    cutoff_hz = max(CUTOFF_HZ, LEAST_PERIODS * RATE_HZ / samples)
    return lambda: seaid.identify(arm, log, cutoff_hz=cutoff_hz)


def _chain(joints: int, folder: Path) -> seaid.Robot:
    return seaid.load_robot(*chain(joints, folder))


def loading(joints: int, folder: Path) -> Work:
    """Return the loading of a chain and its drives."""
    return lambda: _chain(joints, folder)


def chain_regressor(joints: int, folder: Path) -> Work:
    """Return the regressor of a chain."""
    robot = _chain(joints, folder)
    return lambda: rigid_body_regressor(robot, *_motion(joints, INSTANTS))


def reduction(joints: int, folder: Path) -> Work:
    """Return the numeric base parameters of a chain."""
    robot = _chain(joints, folder)
    return lambda: base_parameters(robot)


def exact_reduction(joints: int, folder: Path) -> Work:
    """Return the exact base parameters of a chain."""
    robot = _chain(joints, folder)
    return lambda: seaid.symbolic.base_parameters(robot)


def identifiability(joints: int, folder: Path) -> Work:
    """Return the identifiability of a chain of springs, in a copy without what is kept of it."""
    robot = _chain(joints, folder)
    return lambda: seaid.identifiability(robot.with_drives(robot.drives))


def estimate(parameters: int, _: Path) -> Work:
    """Return least squares with its covariance from a fixed number of rows."""
    rows = random_rows(ROWS // 4, 4, parameters)
    return lambda: ordinary(rows)


SAMPLES = sized((1_000, 10_000, 100_000, 1_000_000), (2_000, 4_000))
JOINTS = sized((2, 4, 8, 15, 30, 60), (2, 3))
PARAMETERS = sized((10, 30, 100, 300, 600), (4, 8))
EACH_SAMPLE = "each sample is read, filtered and factored once"
GROWTHS = (
    Growth("stacked regressor", "samples", SAMPLES, 1, "one call a sample", stacked_regressor),
    Growth(
        *("identify in memory", "samples", SAMPLES, 1, EACH_SAMPLE),
        prepare=lambda size, folder: identified(size, folder, streamed=False),
    ),
    Growth(
        *("identify from a file", "samples", SAMPLES, 1, EACH_SAMPLE),
        prepare=lambda size, folder: identified(size, folder, streamed=True),
    ),
    Growth("load a robot", "joints", JOINTS, 1, "one line of the file a joint", loading),
    Growth(
        *("stacked regressor", "joints", JOINTS, 2, "n rows of 10 n columns"),
        prepare=chain_regressor,
    ),
    Growth(
        *("base parameters, numeric", "joints", JOINTS, 3, "QR factor of 10 n columns"),
        prepare=reduction,
    ),
    Growth(
        *("base parameters, exact", "joints", JOINTS, 2, "one null space a joint, over its bodies"),
        prepare=exact_reduction,
    ),
    Growth(
        *("identifiability", "joints", JOINTS, 3, "singular values of 10 n columns"),
        prepare=identifiability,
    ),
    Growth(
        *(
            "estimate and covariance",
            "parameters",
            PARAMETERS,
            2,
            "QR factor of fixed rows, p^3 a block",
        ),
        prepare=estimate,
    ),
)


def seconds(work: Work) -> float:
    """Return the processor time of a call: the least of three, if they are short."""
    times: list[float] = []
    for turn in count(1):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
        if turn == sized(3, 1) or times[-1] > 1.0:
            return min(times)
    raise AssertionError


def measured(growth: Growth, sizes: Sequence[int], folder: Path) -> list[str]:
    """Return the row of one kind of work: its times, its slope and the exponent asked for."""
    times = [max(seconds(growth.prepare(size, folder)), 1e-6) for size in sizes]
    slope = np.log(times[-1] / times[-2]) / np.log(sizes[-1] / sizes[-2])
    mark = " more" if slope > growth.exponent + MARGIN else ""
    shown = ", ".join(f"{value:.2g}" for value in times)
    return [growth.title, shown, f"{slope:.1f}{mark}", f"{growth.exponent}: {growth.reason}"]


def tables(axes: Sequence[str], largest: int | None) -> Iterator[str]:
    """Yield the table of each axis."""
    for axis in axes:
        growths = [growth for growth in GROWTHS if growth.axis == axis]
        sizes = growths[0].sizes
        if largest is not None:
            sizes = (*(size for size in sizes if size < largest), largest)
        with tempfile.TemporaryDirectory() as folder:
            rows = [measured(growth, sizes, Path(folder)) for growth in growths]
        title = f"{axis}: {', '.join(f'{size:,}' for size in sizes)}"
        yield str(table(title, ["work", "seconds", "slope", "asked"], rows))


if __name__ == "__main__":
    AXES = list(dict.fromkeys(growth.axis for growth in GROWTHS))
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", action="append", choices=AXES, help="may be repeated")
    parser.add_argument("--largest", type=int, metavar="SIZE", help="of the axis, if it is one")
    add_quick(parser)
    options = parser.parse_args()
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    for text in tables(options.only or AXES, options.largest):
        print(text, flush=True)
