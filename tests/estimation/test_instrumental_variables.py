"""Instrumental variables against noise in the columns."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.checks.values import noise_findings
from seaid.drives import SeriesElasticDrive
from seaid.errors import ExcitationError, IdentificationError
from seaid.estimation import Estimate
from seaid.estimation.instrumental_variables import (
    deflection_instruments,
    deming,
    instrumental,
    unattenuated,
    with_predicted_columns,
)
from seaid.estimation.least_squares import equal_weights, ordinary, settled_weights, weighted
from seaid.estimation.qr_factor import qr_factor_of
from seaid.identification.drive_estimates import noise_ratio
from seaid.log import reconstruct_motion
from seaid.regressor import Regression
from tests.estimation.rows import TRUTH
from tests.experiments import leg, leg_motion, perfect_log
from tests.plants import regression
from tests.representatives import quick_first
from tests.standard_errors import check_scores


def experiment(
    seed: int, count: int = 1000, noise: float = 0.5, stds: tuple[float, ...] = (0.5,)
) -> tuple[Regression, Array]:
    """Return rows with noise in the second column, and instruments with noise of their own."""
    rng = np.random.default_rng(seed)
    exact = rng.normal(size=(count * len(stds), 3)) @ np.array(
        [[1.0, 0.3, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]]
    )
    H = exact.copy()
    H[:, 1] += noise * rng.normal(size=len(H))
    Z = exact + 0.5 * noise * rng.normal(size=exact.shape)
    joint = np.repeat(np.arange(float(len(stds))), count)
    y = exact @ TRUTH + np.repeat(stds, count) * rng.normal(size=len(H))
    rows = regression(H, y, joint=joint)
    return rows, Z


@pytest.mark.slow  # 2.0 s
def test_noise_in_a_column_biases_least_squares_and_not_instruments() -> None:
    """Instruments are inside their intervals, far from the mean of least squares."""
    scores, biases = [], []
    for seed in range(300):
        rows, Z = experiment(seed, stds=(0.2, 1.0))
        found = instrumental(rows, Z)
        scores.append((found.values - TRUTH) / found.standard_errors)
        if seed < 20:
            biases.append((ordinary(rows).values - TRUTH)[1] / found.standard_errors[1])
    check_scores(scores)
    assert abs(np.mean(biases)) > 4


@pytest.mark.rounding
def test_it_is_the_textbook_with_the_weights_of_least_squares() -> None:
    rows, Z = experiment(0, stds=(0.1, 1.0))
    residual = rows.y - rows.H @ weighted(rows).values
    std = np.array([np.sqrt(np.mean(residual[rows.joint == j] ** 2)) for j in range(2)])
    squared = (1 / std[rows.joint.astype(int)] ** 2)[:, None]
    expected = np.linalg.solve(Z.T @ (squared * rows.H), Z.T @ (squared[:, 0] * rows.y))
    assert instrumental(rows, Z).values == pytest.approx(expected, rel=1e-5)


@pytest.mark.rounding
def test_columns_as_their_own_instruments_are_weighted_least_squares() -> None:
    rows, _ = experiment(1, stds=(0.1, 1.0))
    found, expected = instrumental(rows, rows.H), weighted(rows)
    assert found.values == pytest.approx(expected.values, rel=1e-9)
    assert np.allclose(found.covariance, expected.covariance, rtol=1e-8)
    assert found.residual_std == pytest.approx(expected.residual_std, rel=1e-9)
    assert list(noise_findings(found)) == []


@pytest.mark.rounding
@given(exponent=st.lists(st.integers(-8, 8), min_size=6, max_size=6))
def test_units_do_not_matter(exponent: list[int]) -> None:
    rows, Z = experiment(2, 200)
    of_rows, of_instruments = 10.0 ** np.array(exponent[:3]), 10.0 ** np.array(exponent[3:])
    plain = instrumental(rows, Z)
    scaled = instrumental(replace(rows, H=rows.H * of_rows), Z * of_instruments)
    assert scaled.values * of_rows == pytest.approx(plain.values, rel=1e-8)
    assert scaled.standard_errors * of_rows == pytest.approx(plain.standard_errors, rel=1e-8)


def test_what_is_carried_adds_what_targets_really_do() -> None:
    rows, Z = experiment(3)
    direction = rows.H[:, :1] + Z[:, 1:2] ** 2
    plain = instrumental(rows, Z)
    noise = (rows.y - rows.H @ plain.values)[:, None]
    direction -= noise * (noise.T @ direction) / (noise.T @ noise)  # none of it is explained
    rows = replace(rows, propagated=direction)
    carrying = instrumental(rows, Z, np.array([[1e-8]]))
    moved = instrumental(replace(rows, y=rows.y + 1e-4 * direction[:, 0]), Z).values - plain.values
    added = instrumental(rows, Z, np.array([[2e-8]])).covariance - carrying.covariance
    assert np.allclose(added, np.outer(moved, moved), rtol=1e-2, atol=1e-3 * moved @ moved)


def test_weak_instruments_are_flagged_by_name() -> None:
    rows, Z = experiment(4)
    rng = np.random.default_rng(0)
    Z = Z.copy()
    Z[:, 1] = 0.1 * Z[:, 1] + rng.normal(size=len(Z))
    flags = [str(one) for one in noise_findings(instrumental(rows, Z))]
    assert any(flag.startswith("the instruments of b are weak (partial") for flag in flags)
    assert not any("instruments of c" in str(flag) for flag in flags)


def test_instruments_that_determine_nothing_are_refused() -> None:
    """Of a wrong shape, not finite, zero, or alike; and columns that are alike."""
    rows, Z = experiment(5)
    alike = replace(rows, H=rows.H[:, [0, 1, 0]])
    refused = [
        (rows, Z[:-1], r"instruments must have shape \(1000, 3\), found \(999, 3\)"),
        (rows, np.where(Z > 3, np.nan, Z), "instruments must be finite"),
        (rows, Z * [1, 0, 1], "the instruments of b are zero"),
        (rows, Z[:, [0, 1, 0]], "identify only 2 of 3 parameters"),
        (alike, Z, r"combination of .* is unidentifiable"),
    ]
    for data, instruments, words in refused:
        with pytest.raises((IdentificationError, ExcitationError), match=words):
            instrumental(data, instruments)


def currents(seed: int, noise: tuple[float, ...], count: int = 400) -> tuple[Regression, Array]:
    """Return rows k_e i_e - f_e v_e = y_e, with noise in the currents i_e only, and the truth."""
    rng, n = np.random.default_rng(seed), len(noise)
    k, f = np.arange(2.0, 2 + n), 0.3 * np.arange(1.0, 1 + n)
    y, v = rng.normal(size=(n, count)), rng.normal(size=(n, count))
    measured = (y + f[:, None] * v) / k[:, None] + np.array(noise)[:, None] * rng.normal(
        size=y.shape
    )
    H = np.zeros((n, count, 2 * n))
    for e in range(n):
        H[e, :, e], H[e, :, n + e] = measured[e], -v[e]
    joint = np.repeat(np.arange(n), count)
    rows = regression(H.reshape(-1, 2 * n), y.ravel(), unit="N m", joint=joint)
    return rows, np.concatenate([k, f])


def test_noise_of_one_equation_in_one_column_is_regressed_the_other_way_round() -> None:
    rows, _ = currents(0, (0.4,))
    qr_factor = qr_factor_of(rows)
    theta = unattenuated(qr_factor, equal_weights(qr_factor), [0], False)
    # i = y / k + (f / k) v
    inverse = np.linalg.lstsq(np.column_stack([rows.y, -rows.H[:, 1]]), rows.H[:, 0])[0]
    assert theta == pytest.approx([1 / inverse[0], inverse[1] / inverse[0]], rel=1e-9)
    again = ordinary(with_predicted_columns(rows, np.asarray(theta), [0]))
    assert again.values == pytest.approx(theta, rel=1e-9)
    assert again.residual_std == pytest.approx(np.std(rows.y - rows.H @ theta), rel=0.01)


@pytest.mark.slow  # 2.8 s
def test_noise_of_logged_currents_biases_least_squares_only() -> None:
    noisy, scores, plain, truth = [0, 1, 2], [], [], np.empty(0)
    for seed in range(250):
        rows, truth = currents(seed, (0.0, 0.1, 0.3))
        qr_factor = qr_factor_of(rows)
        theta = unattenuated(qr_factor, settled_weights(qr_factor), noisy, True)
        assert theta is not None
        found = weighted(with_predicted_columns(rows, theta, noisy))
        scores.append((found.values - truth)[[1, 2, 4, 5]] / found.standard_errors[[1, 2, 4, 5]])
        plain.append(weighted(rows).values)
        assert found.values[[0, 3]] == pytest.approx(truth[[0, 3]], rel=1e-6)
    check_scores(scores)
    assert np.mean(plain, axis=0)[2] < 0.6 * truth[2]


def test_without_convergence_there_is_no_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seaid.estimation.instrumental_variables._MOST_ROUNDS", 1)
    qr_factor = qr_factor_of(currents(0, (0.1, 0.3))[0])
    assert unattenuated(qr_factor, settled_weights(qr_factor), [0, 1], True) is None


# The spring from its measured torque: noise in torque and deflection, neither forgotten

STIFFNESS, OFFSET = 70.0, 1.5


def spring_rows(
    torque_std: float, deflection_std: float, seed: int = 0, count: int = 2000
) -> Regression:
    """Return (4b) of a spring under white noise."""
    rng = np.random.default_rng(seed)
    time = np.arange(count, dtype=float) * 0.02
    d = 0.05 * np.sin(time) + 0.02 * np.sin(2.7 * time)
    torque = STIFFNESS * d + OFFSET + torque_std * rng.normal(size=count)
    H = np.column_stack([d + deflection_std * rng.normal(size=count), np.ones(count)])
    return regression(H, torque, names=("stiffness", "spring_offset"), time=time)


def spring_estimate(noisy: Regression, ratio: float) -> Estimate:
    """Return the estimate of (4b) with both noises."""
    return instrumental(noisy, deflection_instruments(noisy, ratio))


@given(st.integers(0, 2**32 - 1), st.floats(-3, 3), st.floats(0.01, 100.0))
@settings(derandomize=True, deadline=None)
def test_the_line_lies_between_both_regressions(seed: int, slope: float, ratio: float) -> None:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=50)
    y = slope * x + 0.5 * rng.normal(size=50)
    x, y = x - x.mean(), y - y.mean()
    ways = sorted([x @ y / (x @ x), y @ y / (x @ y)])
    assert ways[0] - 1e-9 <= deming(x, y, ratio) <= ways[1] + 1e-9
    assert deming(x, y, np.inf) == pytest.approx(x @ y / (x @ x))
    # The torque has much more noise, which once cancelled to a slope of zero.
    assert deming(x, y, 1e18) == pytest.approx(x @ y / (x @ x))
    assert deming(x, y, 1e-12) == pytest.approx(y @ y / (x @ y), rel=1e-6)
    assert deming(y, x, 1 / ratio) == pytest.approx(1 / deming(x, y, ratio))  # neither is special


@pytest.mark.slow  # 2.3 s
@pytest.mark.parametrize(
    ("torque_std", "deflection_std"), quick_first([(0.3, 0.02), (1.0, 0.005), (0.05, 0.03)])
)
def test_noise_in_both_biases_no_stiffness(torque_std: float, deflection_std: float) -> None:
    ratio = (torque_std / deflection_std) ** 2
    found = [
        spring_estimate(spring_rows(torque_std, deflection_std, seed), ratio) for seed in range(400)
    ]
    values = np.array([one.value("stiffness") for one in found])
    error = np.std(values) / np.sqrt(len(values))
    assert abs(np.mean(values) - STIFFNESS) < 3.5 * error
    truth = np.array([STIFFNESS, OFFSET])
    check_scores([(one.values - truth) / one.standard_errors for one in found])
    offsets = [one.value("spring_offset") for one in found]
    assert np.mean(offsets) == pytest.approx(OFFSET, abs=0.05)


def test_an_exact_deflection_is_plain_least_squares() -> None:
    noisy = spring_rows(0.5, 0.0)
    plain, both = ordinary(noisy), spring_estimate(noisy, np.inf)
    np.testing.assert_allclose(both.values, plain.values, rtol=1e-9)


@pytest.mark.slow  # a hundred estimates
def test_the_ratio_is_read_from_the_spectra_above_the_pass_band() -> None:
    robot, motion = leg(), leg_motion()
    joint, rng = "knee_pitch", np.random.default_rng(3)
    drive = robot.drives[joint]
    assert isinstance(drive, SeriesElasticDrive)
    shape = motion.joint_torque.shape
    steps = rng.normal(size=shape) * 1e-3
    log = perfect_log(robot, motion)
    torque = motion.joint_torque + 0.5 * rng.normal(size=shape)
    sensed = replace(log, joint_torque=torque, joint_position=log.joint_position + steps)
    dataset = reconstruct_motion(robot, sensed, 6.0)
    force_noise = 0.5 / drive.load_radius
    deflection_noise = 1e-3 * drive.load_radius
    expected = (force_noise / deflection_noise) ** 2
    assert noise_ratio(robot, [dataset], joint) == pytest.approx(expected, rel=0.4)
