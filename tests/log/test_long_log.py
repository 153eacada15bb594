"""Long logs in pieces: their lengths, and that no sample is lost."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import LogError
from seaid.log.log import MINIMUM_SAMPLES
from seaid.log.long_log import LongLog, _overlapping, iterate_log, open_long_log
from seaid.log.motion import Motion, reconstruct_motion
from seaid.log.reading import Log, read_log, write_log
from seaid.robot.robot import Robot
from tests.experiments import arm, arm_log
from tests.log.readers.files import one_log


@pytest.mark.parametrize("chunk_samples", [0, -1, 49, 1.5, "100", None, True, 10**10])
def test_pieces_have_a_whole_number_of_samples(
    arm: Robot, tmp_path: Path, chunk_samples: Any
) -> None:
    write_log(one_log(), tmp_path / "log.npz")
    with pytest.raises(LogError, match=r"chunk_samples=? must be a whole number"):
        open_long_log(tmp_path / "log.npz", arm, chunk_samples=chunk_samples)
    with pytest.raises(LogError, match="overlap_samples must be a whole number from 0 to"):
        next(iterate_log(tmp_path / "log.npz", arm, overlap_samples=-1))


@pytest.mark.parametrize("lengths", [(100, 30, 100), (20, 100, 30), (100, 10, 10, 80, 5)])
@pytest.mark.parametrize("overlap", [0, 10])
def test_no_sample_of_a_short_piece_is_lost(lengths: tuple[int, ...], overlap: int) -> None:
    ends = np.cumsum(lengths)
    blocks = [{"t": np.arange(end - n, end)} for n, end in zip(lengths, ends, strict=True)]
    seen = [
        block["t"][before : before + length]
        for block, before, length in _overlapping(iter(blocks), overlap)
    ]
    np.testing.assert_array_equal(np.concatenate(seen), np.arange(ends[-1]))
    assert min(map(len, seen)) >= MINIMUM_SAMPLES


# X


# Long logs in pieces: the same rows, the same estimate, the same errors as in memory

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


def opened(path: Path, chunk_samples: int = 1500) -> LongLog:
    return open_long_log(path, ROBOT, cutoff_hz=CUTOFF_HZ, chunk_samples=chunk_samples)


@cache
def motion(seed: int = 0) -> Motion:
    return reconstruct_motion(ROBOT, log(seed), CUTOFF_HZ)


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


def test_fastest_speed_is_that_of_the_whole_log(npz: Path) -> None:
    fastest = opened(npz).fastest
    assert fastest == pytest.approx(motion().largest_speeds, rel=1e-9)


def test_cutoff_is_proposed_from_the_first_piece(npz: Path) -> None:
    long_log = open_long_log(npz, ROBOT, chunk_samples=3000)
    first = reconstruct_motion(ROBOT, log().between(0.0, 2.9995))
    assert long_log.cutoff_hz == pytest.approx(first.cutoff_hz, rel=1e-9)


def test_foreign_columns_and_units(tmp_path: Path) -> None:
    write_log(log(), tmp_path / "log.csv")
    text = (tmp_path / "log.csv").read_text().replace("time_s", "t", 1)
    (tmp_path / "log.csv").write_text(text)
    parts = iterate_log(
        tmp_path / "log.csv", ROBOT, columns={"time_s": ("t", "ms")}, chunk_samples=1000
    )
    assert next(parts).log.time[1] == pytest.approx(1e-6)


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
