"""Findings on simulated logs of legged robots: false ones of clean logs, and true ones of faults.

Run from the folder of the project: python -m scripts.benchmarks.legged_findings [logs] [kind ...]
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

import seaid
from scripts.benchmarks.legged import noisy, planned, quadruped
from scripts.example_robots import example_urdf
from scripts.identify_biped import (
    FEET,
    hanging_plan,
    standing_plan,
    write_biped,
)
from scripts.identify_biped import plant as biped_plant
from scripts.identify_biped import simulate as simulate_biped
from scripts.legged_plant import GO2, SOLO12, Quadruped, changed_bodies, plan, plant, simulate
from seaid.errors import listed

FIRST_SEED = 200
SLIPPERY, PUSH_NM, LATE_S = 0.5, 15.0, 0.08
"""Friction of a ground on which feet slip, torque of a hand on a leg [N m], and delay of flags."""
CLOCK_LATE_S = 0.01
"""Delay of the channels of the base, or of all torques."""

_FOLDER = Path(tempfile.gettempdir()) / "seaid_legged_findings"

Case = tuple[seaid.Robot, seaid.Log]


@cache
def robots(legs: Quadruped, seed: int) -> tuple[seaid.Robot, seaid.Robot]:
    """Return a quadruped as its file has it, without values, and with changed bodies."""
    path = changed_bodies(example_urdf(legs.urdf), _FOLDER, seed)
    return quadruped(legs).without_nominal(), quadruped(legs, path)


def walk(legs: Quadruped, duration_s: float, seed: int, soft: bool = False) -> Case:
    """A quadruped that sways and lifts its feet in turn."""
    nominal, robot = robots(legs, seed)
    log = simulate(robot, plant(robot, soft=soft), duration_s, seed, legs=legs)
    return nominal, noisy(log, seed, legs)


def sway(legs: Quadruped, duration_s: float, seed: int, friction: float = 1.0) -> Case:
    """A quadruped that sways over its four feet."""
    nominal, robot = robots(legs, seed)
    model = plant(robot)
    model.geom_friction[:, 0] = friction
    targets = plan(quadruped(legs), legs, duration_s, seed, lifted=False)
    log = simulate(robot, model, duration_s, legs=legs, targets=targets)
    return nominal, noisy(log, seed, legs)


def exciting(legs: Quadruped, duration_s: float, seed: int) -> Case:
    """A quadruped that follows a planned motion in stance."""
    nominal, robot = robots(legs, seed)
    targets = planned(quadruped(legs), legs, duration_s, seed)
    log = simulate(robot, plant(robot), duration_s, legs=legs, targets=targets)
    return nominal, noisy(log, seed, legs)


def biped(is_held: bool, duration_s: float, seed: int) -> Case:
    """A biped with springs that hangs, or stands on flat feet and sways."""
    _FOLDER.mkdir(exist_ok=True)
    urdf, toml = write_biped(_FOLDER)
    how = {} if is_held else {"base": "floating", "contacts": FEET}
    robot = seaid.load_robot(urdf, drives=toml, **how)  # type: ignore[arg-type]
    moves = hanging_plan(duration_s, seed) if is_held else standing_plan(robot, duration_s, seed)
    log = simulate_biped(robot, biped_plant(urdf, robot, is_held), moves, seed)
    return robot.without_nominal(), log


CLEAN: dict[str, Callable[[int], Case]] = {
    "go2 walks 30 s": partial(walk, GO2, 30.0),
    "solo12 walks 30 s": partial(walk, SOLO12, 30.0),
    "go2 sways 8 s": partial(sway, GO2, 8.0),
    "solo12 sways 8 s": partial(sway, SOLO12, 8.0),
    "go2 sways 40 s": partial(sway, GO2, 40.0),
    "go2 planned 8 s": partial(exciting, GO2, 8.0),
    "biped stands 20 s": partial(biped, False, 20.0),
    "biped hangs 20 s": partial(biped, True, 20.0),
}
"""Logs as described, with noise: whatever is named in them is a false finding."""


def standing_flag(case: Case) -> Case:
    """The flag of a foot that is lifted says that it stands."""
    robot, log = case
    assert log.base is not None
    foot = GO2.feet[1]
    contacts = {**log.base.contacts, foot: np.ones(len(log.time))}
    return robot, replace(log, base=replace(log.base, contacts=contacts))


def late_flags(case: Case) -> Case:
    """All flags are late."""
    robot, log = case
    assert log.base is not None
    late = round(LATE_S / float(np.median(np.diff(log.time))))
    before = np.maximum(np.arange(len(log.time)) - late, 0)
    contacts = {link: flag[before] for link, flag in log.base.contacts.items()}
    return robot, replace(log, base=replace(log.base, contacts=contacts))


def _late(log: seaid.Log, values: np.ndarray) -> np.ndarray:
    """Return samples (T, k) that are late by some milliseconds."""
    before = log.time - CLOCK_LATE_S
    return np.column_stack([np.interp(before, log.time, column) for column in values.T])


def late_imu(case: Case) -> Case:
    """All channels of the base are late."""
    robot, log = case
    assert log.base is not None
    names = ("orientation", "angular_velocity", "specific_force")
    logged = {x: getattr(log.base, x) for x in names if getattr(log.base, x) is not None}
    late: dict[str, Any] = {x: _late(log, values) for x, values in logged.items()}
    return robot, replace(log, base=replace(log.base, **late))


def late_torques(case: Case) -> Case:
    """The torques of all joints are late."""
    robot, log = case
    return robot, replace(log, motor_torque=_late(log, log.motor_torque))


def biased(case: Case) -> Case:
    """The accelerometer has a bias."""
    robot, log = case
    assert log.base is not None
    assert log.base.specific_force is not None
    force = log.base.specific_force + 0.1 * np.array([1.0, -0.7, 0.5])
    return robot, replace(log, base=replace(log.base, specific_force=force))


def pushed(case: Case) -> Case:
    """A hand pushes at the thigh and the calf of a leg for 0.6 s."""
    robot, log = case
    acts = np.abs(log.time - 0.5 * log.time[-1]) < 0.3
    torque = np.array(log.motor_torque)
    torque[np.ix_(acts, [1, 2])] += PUSH_NM * np.array([1.0, 0.6])
    return robot, replace(log, motor_torque=torque)


FAULTS: dict[str, tuple[str, Callable[[int], Case]]] = {
    "a foot said to stand moves": (
        "contact-flags",
        lambda seed: standing_flag(walk(GO2, 30.0, seed)),
    ),
    "late flags": ("contact-flags", lambda seed: late_flags(walk(GO2, 30.0, seed))),
    "feet slip": ("contact-flags", partial(sway, GO2, 8.0, friction=SLIPPERY)),
    "soft feet": ("soft-feet", partial(walk, GO2, 30.0, soft=True)),
    "late base, walk": ("delay", lambda seed: late_imu(walk(GO2, 30.0, seed))),
    "late base, biped": ("delay", lambda seed: late_imu(biped(False, 20.0, seed))),
    "late torques, walk": ("delay", lambda seed: late_torques(walk(GO2, 30.0, seed))),
    "biased accelerometer, walk": ("base-bias", lambda seed: biased(walk(GO2, 30.0, seed))),
    "biased accelerometer, sway": ("base-bias", lambda seed: biased(sway(GO2, 40.0, seed))),
    "a hand pushes": ("contact", lambda seed: pushed(sway(GO2, 40.0, seed))),
}
"""What is wrong, the finding that has to name it, and the log."""


def named(case: Case) -> list[str]:
    """Return the codes of the findings that are more than a note."""
    found = seaid.identify(*case)
    return sorted({one.code for one in found.warnings if one.severity != "note"})


def main() -> None:
    """Print the findings of each log, and how many logs have any."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("logs", type=int, nargs="?", default=3, help="of each kind")
    parser.add_argument("kinds", nargs="*", help=f"by default all: {listed([*CLEAN, *FAULTS])}")
    given = parser.parse_args()
    kinds, seeds = given.kinds, range(FIRST_SEED, FIRST_SEED + given.logs)
    _FOLDER.mkdir(exist_ok=True)
    for kind, make in CLEAN.items():
        if not kinds or kind in kinds:
            every = [named(make(seed)) for seed in seeds]
            codes = sorted({code for one in every for code in one})
            print(f"{kind}: {sum(map(bool, every))} of {len(every)} {listed(codes)}", flush=True)
    for kind, (code, make) in FAULTS.items():
        if not kinds or kind in kinds:
            found = [seaid.identify(*make(seed)).warnings for seed in seeds]
            hits = sum(code in {one.code for one in each} for each in found)
            print(f"{kind}: {hits} of {len(found)} have {code}", flush=True)


if __name__ == "__main__":
    main()
