"""Processor time of `identify` with its warnings, by parts, and over that of another version.

`--against TREE` alternates the runs with those of another checkout, each in a process of its own on
one core, after a run that fills the caches. Robots and logs are the same files for both.
`--known-std` states typical standard deviations of all constants.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import seaid
from seaid.identification import problem
from seaid.identification.sensitivity import TYPICAL_STD

ROOT = Path(__file__).resolve().parents[2]
NAMES = ("leg", "stiff", "scara", "arm", "elastic arm")
PARTS = (
    *("log_findings", "datasets_by_log", "check_channels", "experiment_of", "findings_of_setup"),
    *("load_model_of", "estimate_two_step", "resolved_widths", "selections", "model_findings"),
    *("sensitivity_findings", "with_known_std", "identification_of", "robot_fit", "fit_findings"),
)
"""Functions that `identify` and `warnings` call."""


def write_experiments(folder: Path, names: Sequence[str]) -> None:
    """Write the files of each of these robots."""
    sys.path.insert(0, str(ROOT))
    from scripts import gauntlet_robots
    from scripts import identify_philips_arm as philips
    from scripts import identify_tulip_leg as tulip
    from seaid._files import read_toml
    from seaid.errors import RobotError

    if "leg" in names:
        leg = gauntlet_robots.subjects()["leg"]
        log = tulip.experiment((tulip.TEST_MASS,), tulip.shipped_plan(), tulip.sensors(0), 0)
        mass = ["foot", 2.0, [0.15, 0.0, 0.0]]
        _write(folder / "leg", leg.urdf, leg.drives, log, payloads=[mass])
    sensors = seaid.Noise(motor_resolution_rad=3e-3, joint_resolution_rad=2e-4, torque_std_Nm=3e-3)
    for name in [name for name in ("stiff", "scara") if name in names]:
        subject = gauntlet_robots.subjects()[name]
        robot = gauntlet_robots.load(subject.urdf, subject.drives)
        log = seaid.simulate(robot, gauntlet_robots.wiggle(robot, 0.8, 0), noise=sensors, seed=0)
        _write(folder / name, subject.urdf, subject.drives, log)
    urdf, gravity = philips.MODELS / "philips_arm.urdf", (-9.81, 0.0, 0.0)
    for name, drives in (("arm", philips.STIFF), ("elastic arm", philips.ELASTIC)):
        if name not in names:
            continue
        robot = philips.load_arm(drives, gravity)
        motion = gauntlet_robots.wiggle(robot, 0.3, 0)
        log = seaid.simulate(robot, motion, noise=philips.sensors(robot), seed=0)
        tables = read_toml(philips.MODELS / drives, "drives", RobotError)
        _write(folder / name, urdf.read_text("utf-8"), tables, log, gravity=gravity)


def _write(path: Path, urdf: str, drives: Any, log: seaid.Log, **options: Any) -> None:
    path.with_suffix(".urdf").write_text(urdf, "utf-8")
    path.with_suffix(".json").write_text(json.dumps([dict(drives), options]), "utf-8")
    seaid.write_log(log, path.with_suffix(".csv"))


def read_experiment(path: Path) -> tuple[seaid.Robot, seaid.Log]:
    """Return the robot, without nominal values, and its log."""
    drives, options = json.loads(path.with_suffix(".json").read_text("utf-8"))
    options["payloads"] = [seaid.Payload(*one) for one in options.get("payloads", [])]
    robot = seaid.load_robot(path.with_suffix(".urdf"), drives, **options).without_nominal()
    return robot, seaid.read_log(path.with_suffix(".csv"), robot)


KNOWN_STD: dict[str, float] = {}
"""Standard deviations of constants that the identifications state."""


def identified(robot: seaid.Robot, log: seaid.Log) -> Any:
    """Return all warnings of an identification; "flags" before they had codes."""
    found = seaid.identify(robot, log, known_std=KNOWN_STD)
    return getattr(found, "warnings" if hasattr(found, "warnings") else "flags")


def serve(folder: Path) -> None:
    """Print a processor time [s] of the experiment that each line of the input names."""
    experiments = {path.stem: read_experiment(path) for path in folder.glob("*.csv")}
    for line in sys.stdin:
        robot, log = experiments[line.strip()]
        begin = time.process_time()
        identified(robot, log)
        print(time.process_time() - begin, flush=True)


def timed(times: dict[str, float], name: str) -> Any:
    """Return a patch that adds the processor time of a function that `identify` calls to `times`.

    A name that `identify` does not have is an AttributeError.
    """
    function = getattr(problem, name)

    def call(*arguments: Any, **options: Any) -> Any:
        begin = time.process_time()
        try:
            return function(*arguments, **options)
        finally:
            times[name] += time.process_time() - begin

    return patch.object(problem, name, call)


def parts(folder: Path, names: Sequence[str], runs: int) -> list[list[str]]:
    """Return a line per part with its median time [ms] for each robot."""
    times: dict[str, float] = {}
    found: dict[str, list[str]] = {part: [] for part in (*PARTS, "all")}
    with ExitStack() as patches:
        for part in PARTS:
            patches.enter_context(timed(times, part))
        for name in names:
            robot, log = read_experiment(folder / name)
            several: list[dict[str, float]] = []
            for _ in range(runs + 1):
                times |= dict.fromkeys(PARTS, 0.0)
                begin = time.process_time()
                identified(robot, log)
                several.append(times | {"all": time.process_time() - begin})
            for part, cells in found.items():
                cells.append(f"{1e3 * statistics.median(one[part] for one in several[1:]):.0f}")
    return [[part, *cells] for part, cells in found.items()]


def compared(folder: Path, names: Sequence[str], trees: list[Path], runs: int) -> list[list[str]]:
    """Return a line per robot: the median times [ms] of the trees in turns, and their ratio."""
    servers = [_server(folder, tree) for tree in trees]
    lines = []
    for name in names:
        times: list[list[float]] = [[] for _ in trees]
        for _ in range(runs + 1):
            for own, server in zip(times, servers, strict=True):
                assert server.stdin is not None
                assert server.stdout is not None
                print(name, file=server.stdin, flush=True)
                own.append(float(server.stdout.readline()))
        medians = [statistics.median(own[1:]) for own in times]  # the first fills the caches
        ratio = f"{medians[0] / medians[-1]:.2f}"
        lines.append([name, *(f"{1e3 * one:.0f}" for one in medians), ratio])
    for server in servers:
        server.communicate()
    return lines


def _server(folder: Path, tree: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-W", "ignore", __file__, "--serve", str(folder)]
    command += ["--known-std"] if KNOWN_STD else []
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    return subprocess.Popen(
        command,
        env=os.environ | {"PYTHONPATH": str(tree)} | threads,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def main(against: Path | None, names: Sequence[str], runs: int) -> None:
    """Print the tables."""
    from seaid.report.text import table

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_experiments(folder, names)
        if against is not None:
            lines = compared(folder, names, [ROOT, against], runs)
            print(table("Processor time of identify", ["robot", "ms", "before", "ratio"], lines))
        else:
            print(table("Parts of identify [ms]", ["", *names], parts(folder, names, runs)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--against", type=Path, help="another checkout of seaid")
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--robot", action="append", choices=NAMES, help="may be repeated")
    parser.add_argument("--known-std", action="store_true", help="of all constants")
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    KNOWN_STD |= TYPICAL_STD if arguments.known_std else {}
    warnings.simplefilter("ignore")
    if arguments.serve is None:
        main(arguments.against, arguments.robot or NAMES, arguments.runs)
    else:
        serve(arguments.serve)
