"""Whether blocks and logs agree within their errors, and what is done if they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from seaid._arrays import Array
from seaid.checks import noise_findings
from seaid.estimation.drift import agreement
from seaid.estimation.fitting import ESTIMATORS, fit, stored_rows
from seaid.estimation.least_squares import ordinary
from seaid.regressor.regression import Regression

TRUTH = np.array([2.0, -1.0, 0.5])


def smooth(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    return np.asarray(lfilter([0.6], [1.0, -0.8], rng.normal(size=shape), axis=0))


def data(seed: int, logs: int, differ: float = 0.0, instants: int = 300) -> Regression:
    """Return rows of logs whose first parameter differs."""
    rng = np.random.default_rng(seed)
    H = smooth(rng, (logs * instants, 3))
    run = np.repeat(np.arange(logs), instants)
    y = H @ TRUTH + 0.1 * smooth(rng, (logs * instants, 1))[:, 0]
    y += H[:, 0] * differ * rng.normal(size=logs)[run]
    return Regression(
        names=("a", "b", "c"),
        units=("", "", ""),
        H=H,
        y=y,
        joint=np.zeros(len(y)),
        time=np.tile(0.05 * np.arange(instants), logs),
        run=run.astype(float),
        excluded=0,
        propagated=np.empty((len(y), 0)),
        joint_names=("j",),
    )


@pytest.mark.parametrize(("logs", "differ"), [(8, 0.1), (4, 0.3)])
def test_logs_that_differ_are_flagged_and_their_intervals_hold(logs: int, differ: float) -> None:
    held, flagged = 0, 0
    for seed in range(40):
        found = ordinary(data(seed, logs, differ))
        lower, upper = found.interval().T
        held += int(lower[0] <= TRUTH[0] <= upper[0])
        flagged += any(one.code == "blocks-disagree" for one in noise_findings(found))
    assert held >= 34
    assert flagged >= 36


@pytest.mark.parametrize("logs", [1, 2, 8])
def test_right_data_are_hardly_ever_enlarged(logs: int) -> None:
    """The level is 1 %; 60 data sets have two by chance at most."""
    sizes = []
    for seed in range(60):
        rows = data(seed, logs)
        found = ordinary(rows)
        assert not noise_findings(found)
        sizes.append(found.standard_errors[0])
    assert np.max(sizes) < 1.9 * np.median(sizes)


def test_blocks_are_compared_where_the_degrees_of_freedom_are_infinite() -> None:
    """Quantiles of F were NaN there, and nothing was ever larger than these."""
    # Eight blocks of one parameter: sums +-3, which add up to zero, in place of a variance of 1.
    R = [np.array([[1.0, 3.0 * sign], [0.0, 1.0]]) for sign in (1, -1) * 4]
    blocks = list(enumerate(R))
    for freedom in (np.inf, 1e6):
        ratios = agreement(
            blocks, np.zeros(1), np.sqrt([[1 / 8]]), np.array([1 / 8]), freedom
        ).ratios
        assert ratios[0] == pytest.approx(9 / (1 - 1 / 8))


def test_stored_rows_are_compared_alike() -> None:
    rows = data(0, 4, differ=0.3)
    pieces = [
        (log, "", replace(rows.at(rows.run == log), run=np.zeros(300)).at(part))
        for log in range(4)
        for part in (slice(0, 110), slice(110, 300))
    ]
    expected = fit(rows, ESTIMATORS["wls"]).estimate
    with stored_rows([""], (0.05,) * 4, pieces) as stored:
        found = fit(stored[""], ESTIMATORS["wls"]).estimate
    assert found.standard_errors == pytest.approx(expected.standard_errors, rel=1e-8)
    (finding,) = noise_findings(found)
    assert finding.code == "blocks-disagree"
    assert "parts of the data disagree: their estimates scatter" in finding.message
