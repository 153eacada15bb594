"""Robust estimates against truth, with and without outliers."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid.log.long_log as long_log_module
from seaid.errors import IdentificationError, LogError
from seaid.estimation import Estimate, estimator_named
from seaid.estimation.fitting import (
    StoredRows,
    fit,
    huber,
    stored_estimate,
    tukey,
    with_further_columns,
)
from seaid.estimation.least_squares import ordinary, settled_weights, weighted
from seaid.estimation.qr_factor import QRFactor
from seaid.identification import identify
from seaid.identification.datasets import rows_of_equations
from seaid.log import Log, LongLog, Motion, open_long_log, reconstruct_motion, write_log
from seaid.log.motion import motion_of
from seaid.regressor import Regression, actuator_regression
from seaid.regressor.regression import regressions_of_parts, stacked
from tests.estimation.rows import TRUTH, experiment, spoiled
from tests.experiments import arm, arm_log
from tests.representatives import quick_first

Solver = Callable[[Regression], Estimate]

ROBUST = pytest.mark.parametrize("estimator", [huber, tukey])


@ROBUST
def test_a_fifth_of_gross_outliers_by_the_thousand_does_little(estimator: Solver) -> None:
    data = spoiled(experiment(0, count=10_000), 0.2)
    found = estimator(data)
    assert np.max(np.abs(ordinary(data).values - TRUTH)) > 2.0
    assert np.max(np.abs(weighted(data).values - TRUTH)) > 2.0
    assert np.all(np.abs(found.values - TRUTH) < 0.05)
    assert found.residual_std == pytest.approx(1.0, rel=0.4)  # that of the good rows


@pytest.mark.rounding
@ROBUST
def test_weights_solve_the_estimating_equation(estimator: Solver) -> None:
    """Sum of psi(u) / scale times row is zero, with the median of |residual| as scale."""
    data = spoiled(experiment(2, (0.1, 5.0), 1000), 0.1)
    at_huber = data.y - data.H @ huber(data).values
    of_joint = [1.4826 * np.median(np.abs(at_huber[data.joint == j])) for j in range(2)]
    scale = np.array(of_joint)[data.joint.astype(int)]
    u = (data.y - data.H @ estimator(data).values) / scale
    bisquare = np.maximum(1 - (u / 4.685) ** 2, 0.0) ** 2
    psi = u * (np.minimum(1.0, 1.345 / np.abs(u)) if estimator is huber else bisquare)
    size = np.linalg.norm(data.H / scale[:, None], axis=0)
    assert np.all(np.abs(data.H.T @ (psi / scale)) < 1e-3 * size)


@pytest.mark.rounding
@ROBUST
def test_exact_data_with_outliers_give_the_exact_answer(estimator: Solver) -> None:
    data = experiment(4, count=1000)
    y = data.H @ TRUTH
    y[::7] += 50.0
    assert estimator(replace(data, y=y)).values == pytest.approx(TRUTH, rel=1e-6)


def test_what_does_not_settle_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seaid.estimation.fitting._MOST_ITERATIONS", 2)
    with pytest.raises(IdentificationError, match=r"did not converge in 2 iterations: at .* s the"):
        huber(spoiled(experiment(7, count=1000), 0.2))


# Long logs in pieces: the same rows, the same estimate, the same errors as in memory

CUTOFF_HZ = 8.0
ROBOT = arm().without_nominal()
JOINT = "shoulder"


@cache
def log(seed: int = 0) -> Log:
    return arm_log(seed, motion_seed=seed)


@pytest.fixture(scope="module")
def npz(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("npz") / "log.npz"
    write_log(log(), file)
    return file


def stream_estimate(logs: list[LongLog]) -> tuple[Estimate, QRFactor]:
    with rows_of_equations(logs, {"": actuator}, True) as stored:
        rows = stored[""]
        assert isinstance(rows, StoredRows)
        return stored_estimate(rows, settled_weights, None)[:2]


def opened(path: Path, chunk_samples: int = 1500) -> LongLog:
    return open_long_log(path, ROBOT, cutoff_hz=CUTOFF_HZ, chunk_samples=chunk_samples)


@cache
def motion(seed: int = 0) -> Motion:
    return reconstruct_motion(ROBOT, log(seed), CUTOFF_HZ)


def actuator(one: Motion) -> Regression:
    return actuator_regression(ROBOT, one, JOINT)


def assert_same(found: Estimate, expected: Estimate) -> None:
    assert found.names == expected.names
    assert np.max(np.abs(found.values - expected.values) / expected.standard_errors) < 1e-9
    assert found.standard_errors == pytest.approx(expected.standard_errors, rel=1e-8)
    assert found.white_standard_errors == pytest.approx(expected.white_standard_errors, rel=1e-8)
    assert found.residual_std == pytest.approx(expected.residual_std, rel=1e-9)


@pytest.mark.parametrize(
    ("seeds", "chunk"),
    quick_first([((0,), 1250), ((0,), 1777), ((0,), 100_000), ((0, 1), 1500)], 3),
)
def test_logs_in_pieces_of_any_size_are_fitted_as_their_rows(
    tmp_path: Path, seeds: tuple[int, ...], chunk: int
) -> None:
    """As those of all logs together."""
    for seed in seeds:
        write_log(log(seed), tmp_path / f"{seed}.npz")
    logs = [opened(tmp_path / f"{seed}.npz", chunk) for seed in seeds]
    rows = stacked([actuator(motion(seed)) for seed in seeds])
    found, qr_factor = stream_estimate(logs)
    assert_same(found, ordinary(rows))
    assert (qr_factor.count, qr_factor.excluded) == (len(rows.y), rows.excluded)
    assert qr_factor.joint_names == ROBOT.joint_names


def test_a_file_is_read_once_for_all_equations(npz: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two actuator sides and the load side: one reading, after that for the largest speeds."""
    long_log, reconstructed = opened(npz, 3000), []

    def counted(*arguments: Any) -> Motion:
        reconstructed.append(arguments)
        return motion_of(*arguments)

    monkeypatch.setattr(long_log_module, "motion_of", counted)
    pieces = len(list(long_log.motions()))
    reconstructed.clear()
    found = identify(ROBOT, long_log)
    first_pieces = 3  # asked which torques there are
    assert len(reconstructed) <= pieces + first_pieces
    whole = identify(ROBOT, log(), method="two-step", cutoff_hz=CUTOFF_HZ)
    assert_same(found.load, whole.load)
    for joint in ROBOT.elastic_joints:
        assert_same(found.drives[joint], whole.drives[joint])


def test_no_room_for_rows_is_said(npz: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("seaid.estimation.fitting.np.save", full)
    with pytest.raises(LogError, match=r"cannot be kept .*No space left on device.* set TMPDIR"):
        stream_estimate([opened(npz)])


def test_part_without_motion_is_still_left_out_by_the_speed_of_the_whole(tmp_path: Path) -> None:
    """A piece in which the motor hardly moves would find its own noise fast."""
    still = log().motor_position.copy()
    still[:2000, 1] = still[2000, 1] + 1e-6 * np.sin(np.arange(2000) / 30)
    write_log(replace(log(), motor_position=still), tmp_path / "still.npz")
    rows = stacked(
        [rows for _, rows in regressions_of_parts(opened(tmp_path / "still.npz"), {"": actuator})]
    )
    assert np.min(rows.time) > 1.8


def test_further_columns_are_parameters_on_the_side_of_the_torque() -> None:
    """y + 3 x = H theta: without the column the fit has it as noise."""
    rows, column = experiment(4), np.random.default_rng(5).normal(size=(300, 1))
    plain = fit(replace(rows, y=rows.y - 3.0 * column[:, 0]), estimator_named("wls"))
    found = with_further_columns(plain, column, lambda values: bool(values[0] > 0))
    assert found is not None
    scores = (found.values - [*TRUTH, 3.0]) / found.standard_errors
    assert np.max(np.abs(scores)) < 3
    assert with_further_columns(plain, column, lambda values: bool(values[0] < 0)) is None
