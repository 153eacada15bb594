"""Laws that `compare_terms` recommends in logs without them: the rate of each law.

The two-joint arm of the tests, with a stiff and an elastic drive of viscous and Coulomb friction
and a linear spring, follows random motions of 66 s. Its motors warm up by 25 K without any effect.
Every log has new noise; all terms are compared: memory, backlash, temperature and warm-up too.

    python scripts/benchmarks/false_terms.py --logs 200
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import seaid
from seaid._progress import track
from seaid.report import table
from seaid.report.formats import percent
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.benchmarks.hysteresis import SENSORS
from scripts.short_form import add_quick, sized
from tests.experiments import wiggle
from tests.terms import ELASTIC, STIFF, arm

FAMILIES = {
    "memory": ("dahl",),
    "backlash": ("dead_zone", "smooth_dead_zone"),
    "temperature": ("viscous_temperature", "coulomb_temperature"),
    "warm-up": ("viscous_warm_up", "coulomb_warm_up"),
}
_SECONDS = sized(66.0, 4.0)


def main() -> None:
    """Print the rate of each law that was recommended."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--logs", type=int, default=200)
    parser.add_argument("--motions", type=int, default=8)
    add_quick(parser)
    given = parser.parse_args()
    picks: Counter[str] = Counter()
    families: Counter[str] = Counter()
    with TemporaryDirectory() as folder:
        truth = arm(Path(folder), STIFF, ELASTIC)
        runs = []
        for seed in track(range(given.motions), "motions", True):
            plan = wiggle(truth, _SECONDS, (0.2, 0.3), (1.0, 1.3), seed=seed)
            motion = simulate_motion(truth, plan, rate_hz=250.0)
            warmth = 25.0 + 25.0 * (1 - np.exp(-motion.time / 30.0))
            runs.append(replace(motion, motor_temperature=np.column_stack([warmth, warmth])))
        for seed in track(range(given.logs), "logs", True):
            log = measure(truth, runs[seed % given.motions], SENSORS, seed)
            found = seaid.compare_terms(truth.without_nominal(), log).recommended
            terms = {term for joint in found.values() for _, term in joint}
            picks.update(terms)
            families.update(name for name, of in FAMILIES.items() if terms & {*of})
            families["any term"] += bool(terms)
            if terms:
                print(seed, {joint: list(of) for joint, of in found.items()}, flush=True)
    counts = [*((name, families[name]) for name in (*FAMILIES, "any term")), *sorted(picks.items())]
    rows = [[name, f"{n} of {given.logs}", percent(n / given.logs)] for name, n in counts]
    print(table(f"Terms recommended in {given.logs} logs without them", ["", "logs", ""], rows))


if __name__ == "__main__":
    main()
