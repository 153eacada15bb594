"""Coverage of 95 % intervals where the model is wrong in ways that real robots have.

The TULip leg with its test mass moves along a few random motions of six seconds, each simulated
once. Every experiment measures one of them with new noise and encoder phases, and one imperfection.
An experiment is flagged by a finding above a note, and noted by a note on its cause, such as "the
torques are 1.0 +- 0.1 ms late". Where nothing is found the intervals should hold 92 to 98 % of the
true values.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from loky import get_reusable_executor
from scipy.signal import lfilter

import seaid
from seaid._arrays import Array
from seaid.checks.codes import CODES
from seaid.log import Log, Motion
from seaid.report import table
from seaid.report.formats import percent
from seaid.simulation import Noise
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.short_form import add_quick, few, sized
from tests.experiments import ELASTIC, LEG_SENSORS, TEST_MASS, leg, wiggle

MOTIONS = sized(5, 1)
MIDDLE, REACH = (0.0, 0.0, -0.2, 0.7, 0.0), (0.8, 0.6, 0.7, 0.7, 1.1)
PARAMETERS = ("viscous_friction", "coulomb_friction", "stiffness")

Change = Callable[[Log, np.random.Generator], Log]


def unchanged(log: Log, rng: np.random.Generator) -> Log:
    """Return the log."""
    return log


def with_offset(size_Nm: float) -> Change:
    """Return a change that adds a constant to the torque of each elastic joint."""

    def change(log: Log, rng: np.random.Generator) -> Log:
        offset = [size_Nm * rng.choice([-1, 1]) * (joint in ELASTIC) for joint in log.joint_names]
        return replace(log, motor_torque=log.motor_torque + offset)

    return change


def with_drift(size_Nm: float | Array, time_constant_s: float = 2.0) -> Change:
    """Return a change that adds a first-order Gauss-Markov process to each torque."""

    def change(log: Log, rng: np.random.Generator) -> Log:
        a = np.exp(-(log.time[1] - log.time[0]) / time_constant_s)
        white = rng.normal(size=(len(log.time) + 20_000, log.motor_torque.shape[1]))
        drift = lfilter([np.sqrt(1 - a**2)], [1, -a], white, axis=0)[20_000:]
        return replace(log, motor_torque=log.motor_torque + size_Nm * drift)

    return change


def with_coloured_noise(share: float, time_constant_s: float = 0.1) -> Change:
    """Return a change that adds correlated noise of a share of each torque's deviation."""

    def change(log: Log, rng: np.random.Generator) -> Log:
        size_Nm = share * np.std(log.motor_torque, axis=0)
        return with_drift(size_Nm, time_constant_s)(log, rng)

    return change


def one_second(log: Log, rng: np.random.Generator) -> Log:
    """Return one second of the log, at a random place."""
    start_s = rng.uniform(0, log.time[-1] - 1.0)
    return log.between(start_s, start_s + 1.0)


def with_gear_error(size_rad: float) -> Change:
    """Return a change that adds the transmission error of an eccentric gear behind each motor."""

    def change(log: Log, rng: np.random.Generator) -> Log:
        robot = leg(TEST_MASS)
        ratios = np.array([robot.drives[joint].ratio for joint in log.joint_names])
        phases = rng.uniform(0, 2 * np.pi, len(ratios))
        error = size_rad * np.sin(log.motor_position + phases)  # behind the gear, per motor turn
        return replace(log, motor_position=log.motor_position + ratios * error)

    return change


def late(log: Log, rng: np.random.Generator) -> Log:
    """Return the log with a torque that is 1 ms late."""
    torque = np.vstack([log.motor_torque[:1], log.motor_torque[:-1]])
    return replace(log, motor_torque=torque)


def louder(log: Log, rng: np.random.Generator) -> Log:
    """Return the log with a common scale error of the torques, of standard deviation 3 %."""
    return replace(log, motor_torque=log.motor_torque * (1 + 0.03 * rng.normal()))


@dataclass(frozen=True)
class Case:
    """An imperfection, options of `identify`, sensors, and the truth if it differs."""

    name: str
    change: Change = unchanged
    options: Mapping[str, Any] = field(default_factory=dict)
    sensors: Noise = LEG_SENSORS
    stribeck: bool = False


COARSE = replace(LEG_SENSORS, joint_resolution_rad=2 * np.pi / 2**12)
CASES = (
    Case("white noise, encoders"),
    Case("torque offset 0.5 mN m", with_offset(0.5e-3)),
    Case("torque offset 2 mN m", with_offset(2e-3)),
    Case("coloured noise 1 %", with_coloured_noise(0.01)),
    Case("one second", one_second),
    Case("drift 0.5 mN m (1.6 %)", with_drift(0.5e-3)),
    Case("drift 1 mN m (3 %)", with_drift(1e-3)),
    Case("joint encoders of 12 bits", sensors=COARSE),
    Case("torque 1 ms late", late),
    Case("gear error 1 mrad", with_gear_error(1e-3)),
    Case("gear error 3 mrad", with_gear_error(3e-3)),
    Case("Stribeck peak of 60 % in truth", stribeck=True),
    Case("torque scale 3 %", louder),
    Case("torque scale 3 %, stated", louder, {"known_std": {"torque": 0.03}}),
)


def truth(stribeck: bool) -> seaid.Robot:
    """Return the leg, with a Stribeck peak of 60 % of Coulomb friction if asked for."""
    robot = leg(TEST_MASS)
    if not stribeck:
        return robot
    changed = {
        joint: replace(
            drive,
            friction=(*drive.friction, "stribeck"),
            nominal={
                **drive.nominal,
                "stribeck_friction": 0.6 * drive.values["coulomb_friction"],
                "stribeck_speed": 5.0,
            },
        )
        for joint, drive in robot.drives.items()
        if "coulomb" in drive.friction
    }
    return robot.with_drives(changed)


@cache
def motions(stribeck: bool, duration_s: float) -> list[Motion]:
    """Return the true motions."""
    robot = truth(stribeck)
    return [
        simulate_motion(robot, wiggle(robot, duration_s, MIDDLE, REACH, seed=100 + number))
        for number in range(MOTIONS)
    ]


@dataclass(frozen=True)
class Outcome:
    """Which intervals of an experiment hold, of drives and of base parameters, and its findings.

    `is_refused` is an experiment without a result.
    """

    drives: Array = field(default_factory=lambda: np.empty(0))
    base: Array = field(default_factory=lambda: np.empty(0))
    is_flagged: bool = False
    is_noted: bool = False
    is_refused: bool = False


def experiment(case: Case, duration_s: float, seed: int) -> Outcome:
    """Return the outcome of one experiment of a case."""
    runs = motions(case.stribeck, duration_s)
    robot, rng = leg(TEST_MASS), np.random.default_rng(seed)
    phase = tuple(rng.uniform(-1, 1, robot.n) * 2 * np.pi / 2000 + LEG_SENSORS.motor_offset_rad)
    sensors = replace(case.sensors, motor_offset_rad=phase)
    log = case.change(measure(robot, runs[seed % len(runs)], sensors, seed), rng)
    try:
        result = seaid.identify(robot.without_nominal(), log, **case.options)
    except seaid.SeaidError:
        return Outcome(is_flagged=True, is_refused=True)
    drives = [
        lower <= robot.drives[joint].values[name] <= upper
        for joint, estimate in result.drives.items()
        for name, (lower, upper) in zip(estimate.names, estimate.interval(), strict=True)
        if name in PARAMETERS
    ]
    lower, upper = result.load.interval().T
    true = result.base.project(robot.parameters)
    is_cause = [CODES[finding.code].kind == "cause" for finding in result.warnings]
    is_flagged = any(finding.severity != "note" for finding in result.warnings)
    holds = (lower <= true) & (true <= upper)
    return Outcome(np.array(drives), holds, is_flagged, any(is_cause) and not is_flagged)


def coverage(outcomes: list[Outcome]) -> list[str]:
    """Return the cells of a row: the shares of intervals that hold, and of findings."""
    known = [outcome for outcome in outcomes if not outcome.is_refused]
    silent = [x.drives for x in known if not (x.is_flagged or x.is_noted)]
    drives, base = (np.array([getattr(x, part) for x in known]) for part in ("drives", "base"))
    least = min(drives.mean(axis=0).min(), base.mean(axis=0).min())
    flagged, noted = (float(np.mean([getattr(x, name) for x in outcomes])) for name in FOUND)
    shares = [drives.mean(), base.mean(), least, flagged, noted]
    return [*map(percent, shares), percent(float(np.mean(silent))) if silent else "-"]


FOUND = "is_flagged", "is_noted"
HEADER = ["imperfection", "experiments", "drives", "base", "least of a parameter", "flagged"]
HEADER += ["noted", "drives where nothing is found"]


def main(experiments: int, duration_s: float, pool: Executor | None) -> None:
    """Print the table, with the experiments run by the workers of a pool, or here."""
    rows, mapped = [], map if pool is None else pool.map
    for case in few(CASES, 3):
        outcomes = mapped(partial(experiment, case, duration_s), range(experiments))
        rows.append([case.name, str(experiments), *coverage([*outcomes])])
        print("  ".join(rows[-1]), file=sys.stderr, flush=True)
    print(table("Share of 95 % intervals that hold the true value", HEADER, rows))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--experiments", type=int, default=200, help="per imperfection")
    parser.add_argument("--duration", type=float, default=6.0, help="of each motion [s]")
    add_quick(parser)
    parser.add_argument("--workers", type=int, default=1, help="processes")
    arguments = parser.parse_args()
    workers = arguments.workers
    executor = get_reusable_executor(max_workers=workers) if workers > 1 else None
    main(arguments.experiments, arguments.duration, executor)
