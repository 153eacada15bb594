"""Backlash and hysteresis: recovered values and loop areas, and laws that are selected wrongly.

The two-joint arm of the tests follows random motions: "one" has a stiff drive, "two" a spring.
Every draw has new noise. The area of a loop is that of the torque over a cycle of the deflection
(or of the motor angle) of three widths of the law, as identified over the true one.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import seaid
from seaid._progress import track
from seaid.drives.equations import states
from seaid.log import Motion
from seaid.report import table
from seaid.report.formats import percent
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.short_form import add_quick, few, sized
from tests.experiments import wiggle
from tests.terms import ELASTIC, STIFF, arm, with_terms

SENSORS = seaid.Noise(
    motor_resolution_rad=2 * np.pi / 4096,
    joint_resolution_rad=2 * np.pi / 2**17,
    motor_offset_rad=(0.5, -1.0),
    torque_std_Nm=0.002,
)
CONTACT = with_terms(ELASTIC, {}, {"stiffness": 4000.0})
"""A drive without a spring: the contact of the teeth of its gear is what yields."""

_FRICTION = {"coulomb_friction": 0.03, "presliding_angle": 0.4}
_SPRING = {"hysteresis_force": 0.25, "hysteresis_deflection": 0.004}
CASES: dict[str, tuple[str, Any, dict[str, Any], dict[str, float]]] = {
    "backlash, spring of 120 N m/rad": (
        "two",
        ELASTIC,
        {"spring": ("linear", "dead_zone")},
        {"dead_zone": 0.005},
    ),
    "backlash, contact of 4000 N m/rad": (
        "two",
        CONTACT,
        {"spring": ("linear", "dead_zone")},
        {"dead_zone": 0.005},
    ),
    "round backlash, contact of 4000 N m/rad": (
        "two",
        CONTACT,
        {"spring": ("linear", "smooth_dead_zone")},
        {"dead_zone": 0.005, "dead_zone_rounding": 0.0005},
    ),
    "spring, dahl": ("two", ELASTIC, {"spring": ("linear", "dahl")}, _SPRING),
    "elastic gear, dahl": ("two", ELASTIC, {"friction": ("viscous", "dahl")}, _FRICTION),
    "stiff gear, dahl": ("one", STIFF, {"friction": ("viscous", "dahl")}, _FRICTION),
    "stiff gear, dahl under load": (
        "one",
        STIFF,
        {"friction": ("viscous", "dahl", "load")},
        {**_FRICTION, "load_friction": 0.1},
    ),
}
CHOICES = {"friction": ("dahl",), "spring": ("dahl", "dead_zone")}


def robot(folder: Path, joint: str, drive: Any) -> seaid.Robot:
    """Return the arm with a drive at one of its joints."""
    return arm(folder, drive if joint == "one" else STIFF, drive if joint == "two" else ELASTIC)


def motion_of(truth: seaid.Robot, seed: int) -> Motion:
    """Return the true motion of twelve seconds."""
    return simulate_motion(
        truth, wiggle(truth, sized(12.0, 3.0), (0.2, 0.3), (1.0, 1.3), seed=seed), rate_hz=500.0
    )


def loop_area(values: Mapping[str, float], width: float) -> float:
    """Return the area of a loop over a cycle of +-`width`."""
    names = next(
        pair
        for pair in (
            ("hysteresis_force", "hysteresis_deflection"),
            ("coulomb_friction", "presliding_angle"),
        )
        if pair[1] in values
    )
    up = np.linspace(-width, width, 2001)
    x = np.concatenate([up, up[::-1], up, up[::-1]])
    z = states(x, values[names[1]])[0][-len(up) * 2 :]
    return float(abs(np.trapezoid(values[names[0]] * z, x[-len(up) * 2 :])))


def recovered(draws: int, motions: int) -> None:
    """Print the errors of backlash and of the areas of loops."""
    rows = []
    for name, (joint, plain, terms, values) in few(CASES.items()):
        drive = with_terms(plain, terms, values)
        errors, inside = [], []
        with TemporaryDirectory() as folder:
            truth = robot(Path(folder), joint, drive)
            runs = [motion_of(truth, seed) for seed in range(motions)]
            for seed in track(range(draws), name, True):
                log = measure(truth, runs[seed % motions], SENSORS, seed)
                found = seaid.identify(truth.without_nominal(), log)
                estimate = found.drives[joint]
                law = any("dahl" in of for of in terms.values())
                values_of = dict(zip(estimate.names, estimate.values.tolist(), strict=True))
                true = truth.drives[joint].values
                if law:
                    shape = [
                        x for x in values if x in ("presliding_angle", "hysteresis_deflection")
                    ]
                    width = 3 * values[shape[0]]
                    errors.append(loop_area(values_of, width) / loop_area(true, width) - 1)
                else:
                    errors.append(values_of["dead_zone"] / values["dead_zone"] - 1)
                inside += [
                    abs(values_of[x] - true[x]) < 1.96 * estimate.standard_error(x)
                    for x in values
                    if x in values_of
                ]
        rows.append(
            [
                name,
                "area" if law else "half width",
                percent(float(np.median(np.abs(errors)))),
                percent(float(np.max(np.abs(errors)))),
                f"{sum(inside)} of {len(inside)}",
            ]
        )
        print(rows[-1], flush=True)
    header = ["", "figure", "median error", "largest error", "values inside their intervals"]
    print(table(f"Backlash and hysteresis, {draws} draws", header, rows))


def selected(draws: int, motions: int) -> None:
    """Print how often a law is selected in logs without one, and with one."""
    rows = []
    with TemporaryDirectory() as folder:
        truth = robot(Path(folder), "two", ELASTIC)
        runs = [motion_of(truth, seed) for seed in range(motions)]
        picks: list[str] = []
        for seed in track(range(draws), "without", True):
            log = measure(truth, runs[seed % motions], SENSORS, seed)
            found = seaid.compare_terms(truth.without_nominal(), log, terms=CHOICES)
            if found.recommended:
                picks.append(str(dict(found.recommended)))
                print(seed, picks[-1], flush=True)
        rows.append(["without any", f"{len(picks)} of {draws}", percent(len(picks) / draws)])
        for name, (joint, plain, terms, values) in few(CASES.items()):
            truth = robot(Path(folder), joint, with_terms(plain, terms, values))
            known = robot(Path(folder), joint, plain).without_nominal()
            runs = [motion_of(truth, seed) for seed in range(motions)]
            hits = exact = 0
            tried = max(draws // 10, 1)
            for seed in track(range(tried), name, True):
                log = measure(truth, runs[seed % motions], SENSORS, seed)
                found = seaid.compare_terms(known, log, joints=[joint], terms=CHOICES)
                chosen = {term for _, term in dict(found.recommended).get(joint, ())}
                hits += bool(chosen)
                right = {x.replace("smooth_", "") for of in terms.values() for x in of}
                exact += bool(chosen & right)
            rows.append([name, f"{hits} of {tried}", f"{exact} of {tried} this law"])
            print(rows[-1], flush=True)
    print(table(f"Laws selected, {draws} draws", ["logs", "selected", ""], rows))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=12)
    parser.add_argument("--motions", type=int, default=2)
    parser.add_argument("--selection", action="store_true", help="the selection of laws instead")
    add_quick(parser)
    given = parser.parse_args()
    if given.selection:
        selected(given.draws, given.motions)
    else:
        recovered(given.draws, given.motions)
