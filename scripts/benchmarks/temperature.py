"""Friction by the temperature of the motor and over time: intervals, selection, prediction.

The knee of the simulated TULip leg gets 1.2 % less viscous and 0.4 % less Coulomb friction per
kelvin while its motor warms from 18 to 48 degC in the six seconds of the test motion. Per draw of
the noise it is identified with and without the terms, compared, and the torque of a run at 58 to
62 degC predicted; draws without any effect count what is recommended falsely. With --warm-up it is
one joint, stiff or elastic, whose cold motor loses a third of its friction over 15 s of a log of
62 s, without any temperature in it.

    python scripts/benchmarks/temperature.py --draws 100 [--warm-up]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import seaid
from scripts.short_form import add_quick, few
from tests.experiments import TEST_MASS, leg
from tests.whole.test_temperature import (
    COLD,
    FRICTION,
    KNEE,
    SLOPES,
    TERMS,
    WARM_UP,
    cold_arm,
    cold_log,
    log_at,
    ramp,
    robot_of,
    without_terms,
)


def main() -> None:
    """Print one line per figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--warm-up", action="store_true")
    add_quick(parser)
    given = parser.parse_args()
    if given.warm_up:
        for kind in few(("stiff", "elastic")):
            warm_up(kind, given.draws)
    else:
        temperature(given.draws)


def coverage(names: list[str], true: dict[str, float], errors: object, sizes: object) -> None:
    """Print the rms error and the share of 95 % intervals that hold the truth, per parameter."""
    error, size = np.array(errors), np.array(sizes)
    for place, name in enumerate(names):
        rms = np.sqrt(np.mean(error[:, place] ** 2))
        inside = np.mean(np.abs(error[:, place]) < 1.96 * size[:, place])
        print(f"{name}: true {true[name]:.3g}, rms error {rms:.2g}, 95 % holds {inside:.0%}")


def warm_up(kind: str, draws: int) -> None:
    """Print the figures of the warm-up over time."""
    with TemporaryDirectory() as folder:
        robot = cold_arm(Path(folder), kind)
    true, warm = {**FRICTION, **COLD}, robot.drives["arm"].at_temperature()
    errors, sizes, selected, false = [], [], 0, 0
    for seed in range(1, draws + 1):
        log = cold_log(robot, seed=seed)
        estimate = seaid.identify(robot.without_nominal(), log).drives["arm"]
        errors.append([estimate.value(name) - true[name] for name in true])
        sizes.append([estimate.standard_error(name) for name in true])
        terms = seaid.compare_terms(without_terms(robot), log).recommended.get("arm", ())
        selected += {term for _, term in terms} == {*WARM_UP[2:]}
        log = cold_log(robot.with_drives({"arm": warm}), seed=seed)
        false += bool(seaid.compare_terms(without_terms(robot), log).recommended)
    print(f"warm-up of a {kind} drive")
    coverage(list(true), true, errors, sizes)
    print(f"these terms recommended: {selected} of {draws}; any without an effect: {false}")


def temperature(draws: int) -> None:
    """Print the figures of friction by temperature."""
    true = {**leg(TEST_MASS).drives[KNEE].values, **SLOPES}
    names = ["viscous_friction", "coulomb_friction", *SLOPES]
    errors, sizes, predicted, selected, false = [], [], [], 0, 0
    index = leg().index(KNEE)
    for seed in range(1, draws + 1):
        log = log_at(ramp(), seed=seed)
        models = [seaid.identify(robot_of(terms), log) for terms in (TERMS, TERMS[:2])]
        estimate = models[0].drives[KNEE]
        errors.append([estimate.value(name) - true[name] for name in names])
        sizes.append([estimate.standard_error(name) for name in names])
        hot = log_at(ramp(58.0, 62.0), seed=1000 + seed)
        predicted.append(
            [
                seaid.validate(one, hot).actuator.relative_error_with_standstill[index]
                for one in models
            ]
        )
        for slopes in (tuple(SLOPES.values()), (0.0, 0.0)):
            one = log_at(ramp(), slopes, seed)
            terms = seaid.compare_terms(robot_of(TERMS[:2]), one, joints=KNEE).recommended
            of_warmth = [term for _, term in terms.get(KNEE, ()) if "temperature" in term]
            selected += bool(of_warmth) and any(slopes)
            false += bool(of_warmth) and not any(slopes)
    coverage(names, true, errors, sizes)
    for name, column in zip(("with", "without"), np.array(predicted).T, strict=True):
        print(f"torque at 58 to 62 degC {name} the terms: error {np.median(column):.1%}")
    print(f"terms recommended: {selected} of {draws}; without an effect: {false} of {draws}")


if __name__ == "__main__":
    main()
