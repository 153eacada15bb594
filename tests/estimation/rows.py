"""One plant of rows whose truth is known: noise of any colour, outliers, and its own scale."""

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from seaid.regressor import Regression
from tests.plants import regression

TRUTH = np.array([2.0, -1.0, 0.5])


def experiment(
    seed: int, stds: tuple[float, ...] = (1.0,), count: int = 300, phi: float = 0.0
) -> Regression:
    """Return rows of several joints, each with Gaussian noise of its own standard deviation.

    Columns and noise are autoregressive: x[t] = phi x[t-1] + white noise, of variance one.
    """
    drawn = np.random.default_rng(seed).normal(size=(count, 4, len(stds)))
    drawn = lfilter([np.sqrt(1 - phi**2)], [1, -phi], drawn, axis=0)
    H = np.concatenate([drawn[:, :3, place] for place in range(len(stds))])
    noise = np.concatenate([std * drawn[:, 3, place] for place, std in enumerate(stds)])
    joint = np.repeat(np.arange(float(len(stds))), count)
    names = ("hip", "knee", "ankle")[: len(stds)]
    return regression(H, H @ TRUTH + noise, joint=joint, joint_names=names)


def spoiled(rows: Regression, share: float, seed: int = 0) -> Regression:
    """Return the rows with some of the targets gone off by thousands, mostly to one side."""
    rng = np.random.default_rng(seed)
    y = rows.y.copy()
    bad = np.flatnonzero(rng.random(len(y)) < share)
    y[bad] += rng.uniform(-200.0, 1000.0, len(bad))
    return replace(rows, y=y)
