"""Slow drift of a torque: found where it is, its share and corner, and right standard errors."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.fft import dct
from scipy.signal import lfilter

from seaid._arrays import Array
from seaid.checks.values import noise_findings
from seaid.drives import ParameterName
from seaid.estimation import Drift, Estimate, fit
from seaid.estimation.drift import agreement, block_factors, drifts_of, with_drifts
from seaid.estimation.fitting import ESTIMATORS, stored_rows
from seaid.estimation.least_squares import ordinary
from seaid.regressor import Regression
from seaid.regressor.regression import stacked
from tests.estimation.rows import TRUTH, experiment
from tests.plants import regression
from tests.representatives import quick_first

STEP_S, CUTOFF_HZ = 0.05, 5.0
NOISE = 0.1
WAVES_HZ = np.array([[0.1, 0.23, 0.41], [0.5, 0.9, 1.7]])[:, :, None]


def slow(rng: np.random.Generator, instants: int) -> Array:
    """Return a first-order Gauss-Markov process of 2 s and standard deviation one."""
    a = np.exp(-STEP_S / 2.0)
    white = rng.normal(size=instants + 1000) * np.sqrt(1 - a**2)
    return np.asarray(lfilter([1.0], [1.0, -a], white)[1000:])


def data(seed: int, drift: tuple[float, ...] = (0.0,), logs: int = 1) -> Regression:
    """Return rows of equations with a gravity-like column, a fast one, and a constant."""
    rng, parts = np.random.default_rng(seed), []
    for log, (joint, size) in product(range(logs), enumerate(drift)):
        time = STEP_S * np.arange(200)
        # three slow waves each: a motion, the same in all draws
        phases = np.random.default_rng(10 * log + joint).uniform(0, 2 * np.pi, (2, 3, 1))
        waves = np.sum(np.sin(2 * np.pi * WAVES_HZ * time + phases), axis=1)
        H = np.column_stack([*waves, np.ones(200)])
        y = H @ TRUTH + NOISE * rng.normal(size=200) + size * slow(rng, 200)
        rows = regression(H, y, time=time, joint=np.full(200, joint), run=np.full(200, log))
        parts.append(replace(rows, names=ParameterName.all_of(("gravity", "inertia", "offset"))))
    return replace(stacked(parts), joint_names=("hip", "knee"))


def fitted(rows: Regression, cutoff_hz: float | None = CUTOFF_HZ) -> Estimate:
    return fit(rows, ESTIMATORS["wls"], cutoff_hz=cutoff_hz).estimate


def found(rows: Regression) -> tuple[Drift, ...]:
    drifts = drifts_of(rows, np.ones(len(np.unique(rows.joint))), CUTOFF_HZ)
    return tuple(one for one, _ in drifts)


def held(estimate: Estimate) -> Array:
    """Return whether the 95 % intervals of gravity and offset hold."""
    lower, upper = estimate.interval().T
    return np.asarray((lower <= TRUTH) & (upper >= TRUTH))[[0, 2]]


@pytest.mark.slow  # 0.6 s
def test_intervals_hold_where_a_torque_drifts() -> None:
    """Of gravity 79 % hold without drift in the covariance, and of the offset 56 %."""
    draws = [data(seed, (0.1,)) for seed in range(80)]
    with_drift = np.mean([held(fitted(rows)) for rows in draws], axis=0)
    assert np.all(with_drift > 0.88)
    without = np.mean([held(fitted(rows, None)) for rows in draws], axis=0)
    assert np.mean(without) < 0.8


@pytest.mark.parametrize("drift", quick_first([((0.0, 0.0),), ((0.0,),)]))
def test_noise_is_no_drift(drift: tuple[float, ...]) -> None:
    """By chance 2 % of the equations have a likelihood ratio above 4, none one above 20."""
    rows = [data(seed, drift) for seed in range(60)]
    ratios = [one.ratio for each in rows for one in found(each)]
    assert len(ratios) <= 3 * len(drift)
    assert max(ratios, default=0.0) < 15
    grown = [fitted(one).standard_errors / fitted(one, None).standard_errors for one in rows[:30]]
    assert np.mean(grown) < 1.08


def test_the_joint_that_drifts_is_named() -> None:
    names = []
    for seed in range(20):
        findings = noise_findings(fitted(data(seed, (0.0, 0.2), logs=2)))
        names += [one.joint for one in findings if one.code == "drift"]
    assert names.count("knee") >= 18
    assert names.count("hip") == 0


def test_a_drift_that_is_harmless_hides_no_other() -> None:
    """The search for all equations once ended at the first drift of a rounding error's size."""
    rows, rng = data(0, (0.0, 0.2)), np.random.default_rng(0)
    hip = rows.joint == 0
    count, y = int(np.sum(hip)), rows.y.copy()
    y[hip] = rows.H[hip] @ TRUTH + 1e-6 * rng.normal(size=count) + 1e-5 * slow(rng, count)
    drifts = fitted(replace(rows, y=y)).diagnostics.drifts
    assert [drift.joint for drift in drifts] == ["knee"]


def test_the_share_leaves_out_the_mean_of_every_log() -> None:
    """Of logs of unequal length it once left out that of the longest one alone."""
    rows = data(4, (0.2,), logs=3)
    rows = rows.at((rows.run == 0) | (rows.time < 4.0))
    ((drift, influence),) = drifts_of(rows, np.ones(1), CUTOFF_HZ)
    cosines = [dct(rows.H[rows.run == log, 1], norm="ortho") for log in range(3)]
    # cosines below 0.7 of the cutoff, of orders k = 2 T f
    counts = [round(2 * len(x) * STEP_S * 0.7 * CUTOFF_HZ) for x in cosines]
    H = [x[:count] for x, count in zip(cosines, counts, strict=True)]
    changes = np.concatenate([np.arange(count) > 0 for count in counts])
    std = influence[1] / np.concatenate(H)
    rms = np.linalg.norm(std[changes]) / np.sqrt(len(rows.y))
    assert drift.share == pytest.approx(rms / np.std(rows.y), rel=1e-6)


def test_share_and_corner_are_those_of_the_drift() -> None:
    """Spectra of drift 4 tau s^2 / (1 + (2 pi f tau)^2) and noise 2 n^2 step are equal at f_c."""
    size, tau = 0.1, 2.0  # the corner of a drift of 0.2 is that of the highest that is tried
    drifts = [
        (one, np.std(data(seed).y)) for seed in range(30) for one in found(data(seed, (size,)))
    ]
    ratio = 4 * tau * size**2 / (2 * NOISE**2 * STEP_S)
    corner = np.median([drift.corner_hz for drift, _ in drifts])
    assert corner == pytest.approx(np.sqrt(ratio) / (2 * np.pi * tau), rel=0.4)
    assert 0.05 < np.median([drift.share * std for drift, std in drifts]) < 0.15  # less its mean


def test_a_linear_trend_is_drift_too() -> None:
    rows = data(3)
    trend = replace(rows, y=rows.y + 0.2 * (rows.time / np.max(rows.time) - 0.5))
    assert not found(rows)
    (one,) = found(trend)
    assert one.ratio > 20
    (same,) = found(replace(trend, H=trend.H * [1e-9, 1e9, 1.0]))  # in other units
    assert same.ratio == pytest.approx(one.ratio, rel=1e-6)
    finding = next(x for x in noise_findings(fitted(trend)) if x.code == "drift")
    assert (finding.joint, finding.severity) == ("hip", "doubtful")
    assert "the torque of hip has slow errors of" in finding.message
    assert finding.evidence["corner_hz"] == one.corner_hz
    assert finding.evidence["time constant [s]"] == pytest.approx(1 / (2 * np.pi * one.corner_hz))
    assert "zero the torque or current sensor" in finding.remedy


def test_drift_of_rows_without_parameters_makes_no_error_larger() -> None:
    """The load side of known bodies has none: identifying it failed where its torque drifts."""
    nothing = Estimate((), np.zeros(0), np.zeros((0, 0)), (), 0.1, 1.0)
    drift = Drift("hip", 1.0, 0.1, 30.0), np.zeros((0, 5))
    estimate = with_drifts(nothing, np.zeros((0, 0)), [drift])
    assert (estimate.diagnostics.growth, len(estimate.diagnostics.drifts)) == (1.0, 1)


def test_rows_without_noise_and_short_logs_have_no_drift() -> None:
    rows = data(0)
    exact = replace(rows, y=rows.H @ TRUTH + 1e-6 * rows.time)
    assert not found(exact)
    assert not found(replace(rows, y=np.zeros(len(rows.y))))
    assert not found(rows.at(rows.time < 1.0))


# Whether blocks and logs agree within their errors, and what is done if they do not


def blocks_of(seed: int, logs: int, differ: float = 0.0, instants: int = 300) -> Regression:
    """Return rows of logs whose first parameter differs."""
    rows = experiment(seed, (0.1,), logs * instants, phi=0.8)
    run = np.repeat(np.arange(logs), instants)
    shift = differ * np.random.default_rng(seed).normal(size=logs)
    time = np.tile(0.05 * np.arange(instants), logs)
    return replace(rows, y=rows.y + rows.H[:, 0] * shift[run], time=time, run=run.astype(float))


@pytest.mark.parametrize(("logs", "differ"), [(8, 0.1), (4, 0.3)])
def test_logs_that_differ_are_flagged_and_their_intervals_hold(logs: int, differ: float) -> None:
    held, flagged = 0, 0
    for seed in range(40):
        found = ordinary(blocks_of(seed, logs, differ))
        lower, upper = found.interval().T
        held += int(lower[0] <= TRUTH[0] <= upper[0])
        flagged += any(one.code == "blocks-disagree" for one in noise_findings(found))
    assert held >= 34
    assert flagged >= 36


@pytest.mark.parametrize("logs", quick_first([1, 2, 8]))
def test_right_data_are_hardly_ever_enlarged(logs: int) -> None:
    """The level is 1 %; 60 data sets have two by chance at most."""
    sizes = []
    for seed in range(60):
        rows = blocks_of(seed, logs)
        found = ordinary(rows)
        assert not list(noise_findings(found))
        sizes.append(found.standard_errors[0])
    assert np.max(sizes) < 1.9 * np.median(sizes)


def test_blocks_are_compared_where_the_degrees_of_freedom_are_infinite() -> None:
    """Quantiles of F were NaN there, and nothing was ever larger than these."""
    # Eight blocks of one parameter: sums +-3, which add up to zero, in place of a variance of 1.
    R = [np.array([[1.0, 3.0 * sign], [0.0, 1.0]]) for sign in (1, -1) * 4]
    blocks = list(enumerate(R))
    for freedom in (np.inf, 1e6):
        ratios, _ = agreement(blocks, np.zeros(1), np.sqrt([[1 / 8]]), np.array([1 / 8]), freedom)
        assert ratios[0] == pytest.approx(9 / (1 - 1 / 8))


def test_stored_rows_are_compared_alike() -> None:
    rows = blocks_of(0, 4, differ=0.3)
    pieces = [
        (log, "", replace(rows.at(rows.run == log), run=np.zeros(300)).at(part))
        for log in range(4)
        for part in (slice(0, 110), slice(110, 300))
    ]
    expected = fit(rows, ESTIMATORS["wls"]).estimate
    with stored_rows([""], (0.05,) * 4, pieces) as stored:
        found = fit(stored[""], ESTIMATORS["wls"]).estimate
        assert stored[""].instants == len(rows.y)
    assert found.standard_errors == pytest.approx(expected.standard_errors, rel=1e-8)
    (finding,) = noise_findings(found)
    assert finding.code == "blocks-disagree"
    assert "4 parts of the data disagree: their estimates scatter" in finding.message
    later = replace(rows, time=rows.time + 100.0)
    blocks = block_factors([later], dict.fromkeys(range(4), (100.0, 114.95)))
    assert [(log, factor.count) for log, factor in blocks] == [(log // 2, 150) for log in range(8)]
