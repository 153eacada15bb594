"""`refine` of drives with nonlinear springs and other friction: errors and intervals.

Two joints with springs, the shoulder with one more term each, four seconds at 500 Hz with noise,
another motion in every draw. Run from the folder of the project:
python -m scripts.benchmarks.refined_terms [draws] [cases]
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import seaid
from scripts.short_form import words
from seaid.report import table
from seaid.report.formats import percent
from tests.experiments import all_scores
from tests.identification.test_output_error import CASES, errors, measured, with_terms_of

INSIDE = 1.96
"""Standard errors from the estimate to the end of a 95 % interval of a normal distribution."""


def rows_of(case: str, draws: int) -> list[list[str]]:
    """Return a row of the table per added parameter and one of the bodies."""
    truth, found = with_terms_of(case), []
    for seed in range(draws):
        log = measured(truth, seed)
        start = seaid.identify(truth.without_nominal(), log)
        found.append((start, seaid.refine(start, log)))
    names = [name for name, value in CASES[case][1].items() if value and name != "deflection_zero"]
    far = [[errors(one, truth, "shoulder") for one in pair] for pair in found]
    rows = [
        [f"{case}: {name}"] + [_median([both[way].get(name) for both in far]) for way in (0, 1)]
        for name in ("stiffness", *names)
    ]
    bodies = np.array([[_bodies(one, truth) for one in pair] for pair in found])
    rows.append([f"{case}: base parameters", *map(percent, np.median(bodies, axis=0))])
    held = [np.concatenate([all_scores(pair[way], truth) for pair in found]) for way in (0, 1)]
    inside = [percent(float(np.mean(np.abs(one) < INSIDE))) for one in held]
    rows.append([f"{case}: intervals that hold", *inside])
    return rows


def _median(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    fixed = f" ({len(values) - len(known)} fixed)" if len(known) < len(values) else ""
    return (percent(float(np.median(known))) if known else "") + fixed


def _bodies(found: seaid.Identification, truth: seaid.Robot) -> float:
    true = found.base.project(truth.parameters)
    return float(np.linalg.norm(found.load.values - true) / np.linalg.norm(true))


def main() -> None:
    """Print the table."""
    given = words()
    draws = int(given[0]) if given else 20
    cases = given[1:] or [case for case, (terms, _) in CASES.items() if terms]
    rows = [row for case in cases for row in rows_of(case, draws)]
    print(table(f"Median errors, {draws} draws", ["", "identify", "refine"], rows))


if __name__ == "__main__":
    main()
