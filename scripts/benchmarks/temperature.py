"""Friction by the temperature of the motor: slopes, intervals, selection, prediction.

The knee of the simulated TULip leg gets 1.2 % less viscous and 0.4 % less Coulomb friction per
kelvin while its motor warms from 18 to 48 degC in the six seconds of the test motion. Per draw of
the noise it is identified with and without the terms, compared, and the torque of a run at 58 to
62 degC predicted; draws without any effect count what is recommended falsely.

    python scripts/benchmarks/temperature.py --draws 20
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import seaid
from tests.experiments import TEST_MASS, leg
from tests.identification.test_temperature import KNEE, SLOPES, TERMS, log_at, ramp, robot_of


def main() -> None:
    """Print one line per figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=20)
    draws = parser.parse_args().draws
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
            [seaid.validate(one, hot).actuator.relative_error[index] for one in models]
        )
        for slopes in (tuple(SLOPES.values()), (0.0, 0.0)):
            one = log_at(ramp(), slopes, seed)
            terms = seaid.compare_terms(robot_of(TERMS[:2]), one, joints=KNEE).recommended
            of_warmth = [term for _, term in terms.get(KNEE, ()) if "temperature" in term]
            selected += bool(of_warmth) and any(slopes)
            false += bool(of_warmth) and not any(slopes)
    error, size = np.array(errors), np.array(sizes)
    for place, name in enumerate(names):
        rms = np.sqrt(np.mean(error[:, place] ** 2))
        inside = np.mean(np.abs(error[:, place]) < 1.96 * size[:, place])
        print(f"{name}: true {true[name]:.3g}, rms error {rms:.2g}, 95 % holds {inside:.0%}")
    for name, column in zip(("with", "without"), np.array(predicted).T, strict=True):
        print(f"torque at 58 to 62 degC {name} the terms: error {np.median(column):.1%}")
    print(f"terms recommended: {selected} of {draws}; without an effect: {false} of {draws}")


if __name__ == "__main__":
    main()
