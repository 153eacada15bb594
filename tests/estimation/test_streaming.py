"""Long logs in pieces: the same rows, the same estimate, the same errors as in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid.log.long_log as long_log_module
from seaid._arrays import Array
from seaid.errors import IdentificationError, LogError
from seaid.estimation.estimate import Estimate
from seaid.estimation.fitting import StoredRows, stored_estimate
from seaid.estimation.least_squares import equal_weights, ordinary, settled_weights, weighted
from seaid.estimation.qr_factor import QRFactor
from seaid.identification.datasets import rows_of_equations
from seaid.identification.drive_estimates import spring_of
from seaid.identification.identification import identify
from seaid.log.long_log import LongLog, iterate_log, open_long_log
from seaid.log.motion import Motion, motion_of, reconstruct_motion
from seaid.log.reading import Log, read_log, write_log
from seaid.regressor.base import base_parameters
from seaid.regressor.load import load_model, load_regression
from seaid.regressor.regression import (
    Regress,
    Regression,
    actuator_regression,
    regressions_of_parts,
    stacked,
)
from tests.experiments import arm, arm_log

CUTOFF_HZ = 8.0
ROBOT = arm().without_nominal()
JOINT = "shoulder"


@cache
def log(seed: int = 0) -> Log:
    return arm_log(seed, motion_seed=seed)


@pytest.fixture(scope="module", params=[".npz", ".csv"])
def path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("long") / f"log{request.param}"
    write_log(log(), file)
    return file


@pytest.fixture(scope="module")
def npz(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("npz") / "log.npz"
    write_log(log(), file)
    return file


def stream_estimate(
    logs: list[LongLog],
    regress: Regress,
    weigh: Callable[[QRFactor], Array] = settled_weights,
    propagated: Array | None = None,
) -> tuple[Estimate, QRFactor]:
    with rows_of_equations(logs, {"": regress}, True, None, False) as stored:
        rows = stored[""]
        assert isinstance(rows, StoredRows)
        return stored_estimate(rows, weigh, propagated)[:2]


def opened(path: Path, chunk_samples: int = 1500) -> LongLog:
    return open_long_log(path, ROBOT, cutoff_hz=CUTOFF_HZ, chunk_samples=chunk_samples)


@cache
def motion(seed: int = 0) -> Motion:
    return reconstruct_motion(ROBOT, log(seed), CUTOFF_HZ)


def actuator(one: Motion) -> Regression:
    return actuator_regression(ROBOT, one, JOINT)


def load_side() -> tuple[Callable[[Motion], Regression], Array]:
    """Return the regression of the load side with springs as found, and their covariance."""
    spring = spring_of(ROBOT, ordinary(actuator(motion())), JOINT)
    telescope = ordinary(actuator_regression(ROBOT, motion(), "telescope"))
    other = spring_of(ROBOT, telescope, "telescope")
    springs = {JOINT: spring.values, "telescope": other.values}
    model = load_model(ROBOT, base_parameters(ROBOT), ROBOT.joint_names)
    covariance = np.zeros((4, 4))
    covariance[:2, :2], covariance[2:, 2:] = spring.covariance, other.covariance
    return lambda one: load_regression(ROBOT, one, model, springs), covariance


def assert_same(found: Estimate, expected: Estimate) -> None:
    assert found.names == expected.names
    assert np.max(np.abs(found.values - expected.values) / expected.standard_errors) < 1e-9
    assert found.standard_errors == pytest.approx(expected.standard_errors, rel=1e-8)
    assert found.white_standard_errors == pytest.approx(expected.white_standard_errors, rel=1e-8)
    assert found.residual_std == pytest.approx(expected.residual_std, rel=1e-9)


@pytest.mark.parametrize("overlap", [0, 70, 500])
@pytest.mark.parametrize("chunk", [500, 1499, 5000, 10_000])
def test_parts_make_up_the_log(path: Path, chunk: int, overlap: int) -> None:
    whole = read_log(path, ROBOT)
    parts = list(iterate_log(path, ROBOT, chunk_samples=chunk, overlap_samples=overlap))
    own = [(part.log.time >= part.start_s) & (part.log.time < part.end_s) for part in parts]
    for field in ("time", "motor_position", "joint_position", "motor_torque"):
        joined = np.concatenate(
            [getattr(part.log, field)[mine] for part, mine in zip(parts, own, strict=True)]
        )
        assert np.array_equal(joined, getattr(whole, field), equal_nan=True)
    for number, (part, mine) in enumerate(zip(parts, own, strict=True)):
        before = np.argmax(mine)
        after = len(mine) - before - np.sum(mine)
        assert before == (overlap if number else 0)
        assert after == overlap or number >= len(parts) - 2
        assert len(part.log.time) <= chunk + 2 * overlap + 50


def test_rows_are_those_of_the_whole_log(path: Path) -> None:
    whole = actuator(motion())
    found = stacked([rows for _, rows in regressions_of_parts(opened(path), {"": actuator})])
    assert np.array_equal(found.time, whole.time)
    assert found.excluded == whole.excluded > 0
    scale = np.max(np.abs(whole.H), axis=0)
    assert np.max(np.abs(found.H - whole.H) / scale) < 1e-9
    assert np.max(np.abs(found.y - whole.y)) < 1e-9 * np.max(np.abs(whole.y))


@pytest.mark.parametrize("chunk", [1250, 1777, 100_000])
def test_size_of_the_pieces_does_not_matter(npz: Path, chunk: int) -> None:
    found = stream_estimate([opened(npz, chunk)], actuator, equal_weights)[0]
    assert_same(found, ordinary(actuator(motion())))


def test_load_side_with_springs_from_the_first_part(npz: Path) -> None:
    regress, propagated = load_side()
    expected = weighted(regress(motion()), propagated)
    assert_same(stream_estimate([opened(npz)], regress, settled_weights, propagated)[0], expected)


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
        stream_estimate([opened(npz)], actuator)


@pytest.mark.slow  # 2.0 s
def test_logs_are_stacked(npz: Path, tmp_path: Path) -> None:
    write_log(log(1), tmp_path / "other.npz")
    logs = [opened(npz), opened(tmp_path / "other.npz")]
    both = stacked([actuator(motion()), actuator(motion(1))])
    found, qr_factor = stream_estimate(logs, actuator)
    assert_same(found, ordinary(both))
    assert qr_factor.count == len(both.y)
    assert qr_factor.excluded == both.excluded
    assert qr_factor.joint_names == ROBOT.joint_names


def test_fastest_speed_is_that_of_the_whole_log(npz: Path) -> None:
    fastest = opened(npz).fastest
    assert fastest == pytest.approx(motion().largest_speeds, rel=1e-9)


def test_cutoff_is_proposed_from_the_first_piece(npz: Path) -> None:
    long_log = open_long_log(npz, ROBOT, chunk_samples=3000)
    first = reconstruct_motion(ROBOT, log().between(0.0, 2.9995))
    assert long_log.cutoff_hz == pytest.approx(first.cutoff_hz, rel=1e-9)


def test_part_without_motion_is_still_left_out_by_the_speed_of_the_whole(tmp_path: Path) -> None:
    """A piece in which the motor hardly moves would find its own noise fast."""
    still = log().motor_position.copy()
    still[:2000, 1] = still[2000, 1] + 1e-6 * np.sin(np.arange(2000) / 30)
    write_log(replace(log(), motor_position=still), tmp_path / "still.npz")
    rows = stacked(
        [rows for _, rows in regressions_of_parts(opened(tmp_path / "still.npz"), {"": actuator})]
    )
    assert np.min(rows.time) > 1.8


def test_foreign_columns_and_units(tmp_path: Path) -> None:
    write_log(log(), tmp_path / "log.csv")
    text = (tmp_path / "log.csv").read_text().replace("time_s", "t", 1)
    (tmp_path / "log.csv").write_text(text)
    parts = iterate_log(
        tmp_path / "log.csv", ROBOT, columns={"time_s": ("t", "ms")}, chunk_samples=1000
    )
    assert next(parts).log.time[1] == pytest.approx(1e-6)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    for name, text, words in (
        ("a.xyz", "", "cannot read '.xyz' logs; allowed: .csv, .txt"),
        ("a.csv", "", "is empty"),
        ("b.csv", "time_s,x\n1,2\n", "has no column of this robot"),
        ("c.csv", f"time_s,{JOINT}.motor_position_rad\n", "column names but no samples"),
        ("d.npz", "text", "is not a NumPy archive"),
    ):
        (tmp_path / name).write_text(text)
        with pytest.raises(LogError, match=words):
            next(iterate_log(tmp_path / name, ROBOT))
    with pytest.raises(LogError, match="no log file at"):
        next(iterate_log(tmp_path / "nothing.csv", ROBOT))


def test_bad_cell_far_down_is_named_by_its_line(tmp_path: Path) -> None:
    write_log(log(), tmp_path / "log.csv")
    lines = (tmp_path / "log.csv").read_text().splitlines()
    lines[2500] = "x" + lines[2500]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(LogError, match="line 2501: column 'time_s' has 'x"):
        list(iterate_log(tmp_path / "log.csv", ROBOT, chunk_samples=700))


def test_archives_with_bad_columns(tmp_path: Path) -> None:
    data = {"time_s": log().time, **log().columns()}
    name = f"{JOINT}.motor_position_rad"
    for value, words in (
        (np.array(["a"] * len(log().time)), "must be a vector of numbers, found <U1"),
        (np.zeros((len(log().time), 2)), r"must be a vector of numbers, found float64 of shape"),
        (np.zeros(70), "columns have different lengths"),
    ):
        np.savez(tmp_path / "log.npz", **{**data, name: value})  # type: ignore[arg-type]
        with pytest.raises(LogError, match=words):
            next(iterate_log(tmp_path / "log.npz", ROBOT))
    write_log(log(), tmp_path / "log.npz")
    content = bytearray((tmp_path / "log.npz").read_bytes())
    content[len(content) // 2 : len(content) // 2 + 2000] = bytes(2000)
    (tmp_path / "log.npz").write_bytes(bytes(content))
    with pytest.raises(LogError, match="cannot be read"):
        list(iterate_log(tmp_path / "log.npz", ROBOT, chunk_samples=500))


def test_sensor_that_comes_and_goes(tmp_path: Path) -> None:
    torque = np.full_like(log().motor_torque, np.nan)
    torque[:1000] = 1.0
    write_log(replace(log(), joint_torque=np.ones_like(torque)), tmp_path / "log.csv")
    lines = (tmp_path / "log.csv").read_text().splitlines()
    place = lines[0].split(",").index(f"{JOINT}.joint_torque_Nm")
    for number in range(1001, len(lines)):
        cells = lines[number].split(",")
        cells[place] = "nan"
        lines[number] = ",".join(cells)
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(LogError, match=rf"{JOINT}.joint_torque_Nm has values in one part .* 1 s"):
        list(iterate_log(tmp_path / "log.csv", ROBOT, chunk_samples=1000))


def test_time_must_be_regular(tmp_path: Path) -> None:
    time = log().time.copy()
    time[4000:] += 0.5
    write_log(replace(log(), time=time), tmp_path / "log.npz")
    with pytest.raises(LogError, match=r"hole of 0\.501 s at t = 3\.999 s; a log that is read"):
        opened(tmp_path / "log.npz")
    time = log().time + np.where(np.arange(len(log().time)) % 2, 2e-4, 0.0)
    write_log(replace(log(), time=time), tmp_path / "uneven.npz")
    with pytest.raises(LogError, match=r"time steps around .* are not equal; a log that is read"):
        opened(tmp_path / "uneven.npz")


def test_overlap_longer_than_a_piece(npz: Path) -> None:
    with pytest.raises(LogError, match="between 0 and chunk_samples, 100, found 101"):
        next(iterate_log(npz, ROBOT, chunk_samples=100, overlap_samples=101))


def test_joint_that_never_moves(tmp_path: Path) -> None:
    still = log().motor_position.copy()
    still[:, 1] = 0.1
    write_log(replace(log(), motor_position=still), tmp_path / "log.npz")
    words = r"0 rows \(1\d\d more are near standstill\) cannot determine 4 .* with more motion"
    with pytest.raises(IdentificationError, match=words):
        stream_estimate([opened(tmp_path / "log.npz")], actuator)
