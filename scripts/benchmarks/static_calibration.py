"""Calibration from statics: the published dead weights of an ANYdrive, and ramps with friction.

18 loads of -14.7 to 14.7 N m on a spring of 159.8 N m/rad with a residual of 0.077 N m (published:
159.8 +- 0.4, rms 0.077), drawn many times; and slow ramps up and down on a cubic spring behind
friction.

    python scripts/benchmarks/static_calibration.py --draws 2000
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seaid.identification import StaticCalibration, calibrate_statics
from tests.identification.test_static_calibration import RMS, STIFFNESS, anydrive, ramp


def line(name: str, found: list[StaticCalibration], true: float) -> str:
    """Return mean, scatter, mean standard error and coverage of a parameter."""
    estimates = [one.estimate for one in found]
    values = np.array([estimate.value(name) for estimate in estimates])
    errors = np.array([estimate.standard_error(name) for estimate in estimates])
    intervals = [estimate.interval()[estimate.names.index(name)] for estimate in estimates]
    inside = [low < true < high for low, high in intervals]
    return (
        f"{name}: true {true:.4g}, mean {np.mean(values):.5g}, scatter {np.std(values):.3g}, "
        f"standard error {np.mean(errors):.3g}, 95 % holds {np.mean(inside):.1%}"
    )


def main() -> None:
    """Print both experiments."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=2000)
    draws = parser.parse_args().draws
    weights = [anydrive(seed) for seed in range(draws)]
    half = np.mean([np.ptp(one.estimate.interval()[0]) / 2 for one in weights])
    print(line("stiffness", weights, STIFFNESS), f"half interval {half:.2g} N m/rad")
    print(f"rms {np.mean([one.estimate.residual_std for one in weights]):.4f} N m of {RMS}")
    curved = sum(any(w.code == "nonlinear-spring" for w in one.warnings) for one in weights)
    print(f"called nonlinear: {curved} of {draws}")
    ramps = [calibrate_statics(ramp(seed), law="cubic") for seed in range(draws // 10)]
    for name, true in zip(ramps[0].estimate.names, (150.0, 2000.0, 0.02, 0.3), strict=True):
        print(line(name, ramps, true))


if __name__ == "__main__":
    main()
