"""Measures of two motions of the leg over many valid choices of base columns.

python scripts/benchmarks/excitation_measures.py --choices 200
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seaid.excitation.criteria import scaled_condition_and_d_value
from tests.excitation.test_criteria import chosen, regressor


def main() -> None:
    """Print the range of each measure over the choices."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--choices", type=int, default=200)
    rng = np.random.default_rng(0)
    one, other = regressor(0), regressor(3)
    found = []
    for _ in range(parser.parse_args().choices):
        columns = chosen(np.vstack([one, other]), 29, rng)
        scaled, d_value = scaled_condition_and_d_value(one[:, columns])
        ratio = d_value / scaled_condition_and_d_value(other[:, columns])[1]
        found.append([np.linalg.cond(one[:, columns]), scaled, ratio])
    names = ("raw condition number", "condition number, unit norm", "D-efficiency of two motions")
    for name, values in zip(names, np.array(found).T, strict=True):
        spread = np.ptp(values) / np.mean(values)
        print(f"{name}: {np.min(values):.6g} to {np.max(values):.6g} (spread {spread:.2g})")


if __name__ == "__main__":
    main()
