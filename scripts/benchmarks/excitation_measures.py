"""Measures of two motions of the leg over many valid choices of base columns.

python scripts/benchmarks/excitation_measures.py --choices 200
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seaid._arrays import Array
from seaid.excitation.criteria import scaled_condition_and_d_value
from seaid.regressor import rigid_body_regressor
from tests.experiments import leg, leg_trajectory


def regressor(seed: int) -> Array:
    """Return the regressor (T n, 10 N) of a motion in all standard parameters."""
    states = leg_trajectory(seed).sample(np.linspace(0.0, 6.0, 400))
    return np.asarray(rigid_body_regressor(leg(), *states).reshape(-1, leg().parameters.size))


def chosen(Y: Array, count: int, rng: np.random.Generator) -> list[int]:
    """Return a random valid choice of base columns: the first independent ones in random order."""
    picked: list[int] = []
    basis = np.empty((len(Y), 0))
    norms = np.linalg.norm(Y, axis=0)
    for column in rng.permutation(Y.shape[1]):
        rest = Y[:, column] - basis @ (basis.T @ Y[:, column])
        rest -= basis @ (basis.T @ rest)
        if np.linalg.norm(rest) > 1e-7 * max(norms[column], 1e-3):
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
            picked.append(int(column))
    assert len(picked) == count
    return picked


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
