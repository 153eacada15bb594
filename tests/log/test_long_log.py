"""Long logs in pieces: their lengths, and that no sample is lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import LogError
from seaid.log.log import MINIMUM_SAMPLES
from seaid.log.long_log import _overlapping, iterate_log, open_long_log
from seaid.log.reading import write_log
from seaid.robot.robot import Robot
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
