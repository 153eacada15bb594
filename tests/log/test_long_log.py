"""Long logs in pieces: their lengths, and that no sample is lost."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import LogError
from seaid.log import WRITTEN, Log, open_long_log, read_log, reconstruct_motion, write_log
from seaid.log.log import MINIMUM_SAMPLES
from seaid.log.long_log import _overlapping, iterate_log
from seaid.robot import Robot
from tests.experiments import arm, arm_log
from tests.log.readers.files import one_log


@pytest.mark.parametrize("chunk_samples", [0, 49, 1.5, "100", None, True, 10**10])
def test_pieces_have_a_whole_number_of_samples(
    arm: Robot, tmp_path: Path, chunk_samples: Any
) -> None:
    write_log(one_log(), tmp_path / "log.npz")
    with pytest.raises(LogError, match=r"chunk_samples=? must be a whole number"):
        open_long_log(tmp_path / "log.npz", arm, chunk_samples=chunk_samples)


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


# Long logs in pieces: the same rows, the same estimate, the same errors as in memory

ROBOT = arm().without_nominal()
JOINT = "shoulder"


@cache
def log(seed: int = 0) -> Log:
    return arm_log(seed, motion_seed=seed)


@pytest.fixture(scope="module", params=WRITTEN)
def path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("long") / f"log{request.param}"
    write_log(log(), file)
    return file


def parts(path: Path) -> list[Log]:
    """Return all parts of a long log."""
    return [part for part, *_ in iterate_log(path, ROBOT, chunk_samples=1000)]


@pytest.mark.parametrize("overlap", [0, 70])
@pytest.mark.parametrize("chunk", [1499, 10_000])
def test_parts_make_up_the_log(path: Path, chunk: int, overlap: int) -> None:
    whole = read_log(path, ROBOT)
    parts = list(iterate_log(path, ROBOT, chunk_samples=chunk, overlap_samples=overlap))
    own = [(part.time >= start_s) & (part.time < end_s) for part, start_s, end_s in parts]
    for field in ("time", "motor_position", "joint_position", "motor_torque"):
        joined = np.concatenate(
            [getattr(part, field)[mine] for (part, *_), mine in zip(parts, own, strict=True)]
        )
        assert np.array_equal(joined, getattr(whole, field), equal_nan=True)
    for number, ((part, *_), mine) in enumerate(zip(parts, own, strict=True)):
        before = np.argmax(mine)
        after = len(mine) - before - np.sum(mine)
        assert before == (overlap if number else 0)
        assert after == overlap or number >= len(parts) - 2
        assert len(part.time) <= chunk + 2 * overlap + 50


def test_speeds_are_those_of_the_whole_log_and_the_cutoff_that_of_its_first_piece(
    path: Path,
) -> None:
    whole = reconstruct_motion(ROBOT, log(), 8.0)
    found = open_long_log(path, ROBOT, cutoff_hz=8.0, chunk_samples=1500)
    assert found.fastest == pytest.approx(whole.largest_speeds, rel=1e-6)
    first = reconstruct_motion(ROBOT, log().between(0.0, 2.9995))
    proposed = open_long_log(path, ROBOT, chunk_samples=3000)
    assert proposed.cutoff_hz == pytest.approx(first.cutoff_hz, rel=1e-9)


# What is refused, in whatever part of the log it stands


def with_cells(path: Path, column: str, start: int, cell: str) -> Path:
    """Write the log as CSV, with the cells of a column replaced from a line on, and a name."""
    write_log(replace(log(), joint_torque=np.ones_like(log().motor_torque)), path)
    header, *lines = path.read_text().splitlines()
    place = header.split(",").index(column)
    rows = [line.split(",") for line in lines]
    for row in rows[start:]:
        row[place] = cell
    path.write_text("\n".join([header, *map(",".join, rows)]))
    return path


def test_cells_far_down_are_named(tmp_path: Path) -> None:
    """A word by its line, and a sensor that ends by the time."""
    name = f"{JOINT}.joint_torque_Nm"
    with pytest.raises(LogError, match=f"line 2502: column '{name}' has 'x'"):
        parts(with_cells(tmp_path / "log.csv", name, 2500, "x"))
    with pytest.raises(LogError, match=rf"{JOINT}.joint_torque_Nm has values in one part .* 1 s"):
        parts(with_cells(tmp_path / "log.csv", name, 1000, "nan"))


def test_time_must_be_regular(tmp_path: Path) -> None:
    holed = log().time + 0.5 * (np.arange(len(log().time)) >= 4000)
    uneven = log().time + np.where(np.arange(len(log().time)) % 2, 2e-4, 0.0)
    for time, words in (
        (holed, r"hole of 0\.501 s at t = 3\.999 s; a log that is read"),
        (uneven, r"time steps around .* are not equal; a log that is read"),
    ):
        write_log(replace(log(), time=time), tmp_path / "log.npz")
        with pytest.raises(LogError, match=words):
            open_long_log(tmp_path / "log.npz", ROBOT, cutoff_hz=8.0, chunk_samples=1500)
