"""Long logs, read and reconstructed in pieces: memory does not grow with their length."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise
from pathlib import Path

import numpy as np

from seaid._arrays import Array
from seaid._progress import Display, counted
from seaid.errors import LogError, checked
from seaid.log.description import LogDescription
from seaid.log.filtering import decimation, filter_overlap
from seaid.log.log import MINIMUM_SAMPLES, WRITTEN, Log
from seaid.log.motion import (
    FEWEST_PERIODS,
    Motion,
    Processing,
    check_cutoff,
    is_regular,
    motion_of,
    reconstruct_motion,
)
from seaid.log.readers.opening import open_table
from seaid.log.readers.table import Block, Blocks, joined
from seaid.log.rows import PIECE_SAMPLES
from seaid.log.sources import completed, selected
from seaid.log.usable_parts import hole_text, holes, without_frozen
from seaid.robot import Robot

_MOST_SAMPLES = 1_000_000_000
"""Largest number of samples that a user may have in memory at a time."""


@dataclass(frozen=True, eq=False, repr=False)
class LongLog(Display):
    """A log file that is read in pieces on every pass, and the values that all pieces share.

    Attributes
    ----------
    path, robot : Path, Robot
        The file, whose columns have the names of `Log.columns`, and the robot.
    chunk_samples, overlap_samples : int
        Samples per piece, and the overlap with each neighbour.
    cutoff_hz, step_s : float
        Cutoff of the identification [Hz], and time between rows of a regression [s].
    fastest : array (2, n) or None
        Largest speeds of motors and joints, which define standstill.
    temperature_range : array (2, n) or None
        Lowest and highest temperature of the motors [degC]; None: not logged.
    processing : Processing or None
        How the motion of the first piece was computed.
    """

    path: Path
    robot: Robot
    chunk_samples: int
    overlap_samples: int
    cutoff_hz: float
    step_s: float
    fastest: Array | None = None
    temperature_range: Array | None = None
    processing: Processing | None = None

    def _in_short(self) -> str:
        pieces = f"pieces of {counted(self.chunk_samples, 'sample')}"
        return f"'{self.path}' in {pieces}, '{self.robot.name}', cutoff {self.cutoff_hz:.3g} Hz"

    @cached_property
    def first_motion(self) -> Motion:
        """The motion of the first piece, which has the sensors of all of them."""
        return next(self.motions())[0]

    def motions(self) -> Iterator[tuple[Motion, float, float]]:
        """Yield the motion of each part, overlap included, and its time span [start, end) [s]."""
        first_s = None
        samples = self.chunk_samples, self.overlap_samples
        for part, start_s, end_s in iterate_log(self.path, self.robot, *samples):
            _check_even(self.path, part, start_s)
            first_s = start_s if first_s is None else first_s
            motion = motion_of(self.robot, part, self.cutoff_hz)
            yield replace(motion, fastest=self.fastest, start_s=first_s), start_s, end_s


@checked(LogError)
def open_long_log(
    path: str | Path,
    robot: Robot,
    *,
    cutoff_hz: float | None = None,
    chunk_samples: int = PIECE_SAMPLES,
) -> LongLog:
    """Open a log file to be read in pieces; one pass determines cutoff and largest speeds.

    Parameters
    ----------
    path : str or Path
        CSV, NPZ, Parquet or HDF5 file with equal time steps and the names of `Log.columns`.
    robot : Robot
        The robot.
    cutoff_hz : float, optional
        Cutoff of the identification [Hz]; default: selected from the first piece.
    chunk_samples : int
        Samples per piece, which bound the memory.

    Returns
    -------
    LongLog
        The log, for `seaid.identify`.

    Raises
    ------
    LogError
        As `read_log`, and for unequal time steps or a sensor that is missing in some pieces.

    Examples
    --------
    >>> log = seaid.open_long_log("day.parquet", robot, cutoff_hz=8.0)
    >>> result = seaid.identify(robot, log)
    """
    if not MINIMUM_SAMPLES <= chunk_samples <= _MOST_SAMPLES:
        raise LogError(
            f"chunk_samples must be a whole number from {MINIMUM_SAMPLES} to {_MOST_SAMPLES:,}, "
            f"found {chunk_samples:,}"
        )
    path = Path(path)
    first = next(iterate_log(path, robot, chunk_samples))[0]
    processing = None
    if cutoff_hz is None:
        motion = reconstruct_motion(robot, first)
        cutoff_hz, processing = motion.cutoff_hz, motion.processing
        # The cutoff was selected without the rest at the ends of this piece. Its rows stay in the
        # log, so that the exclusion of the rest is none of the repairs.
        if processing is not None:
            processing = replace(processing, repairs=first.report)
    rate_hz = (len(first.time) - 1) / (first.time[-1] - first.time[0])
    check_cutoff(cutoff_hz, rate_hz)
    step, period = decimation(rate_hz, cutoff_hz), rate_hz / cutoff_hz
    # Whole rows, and long enough for the check of a motion's duration.
    chunk = step * math.ceil(max(chunk_samples, FEWEST_PERIODS * period) / step)
    long_log = LongLog(
        path=path,
        robot=robot,
        chunk_samples=chunk,
        overlap_samples=filter_overlap(rate_hz, cutoff_hz),
        cutoff_hz=cutoff_hz,
        step_s=step / rate_hz,
        processing=processing,
    )
    fastest, temperatures = _extremes(long_log)
    return replace(long_log, fastest=fastest, temperature_range=temperatures)


def iterate_log(
    path: Path, robot: Robot, chunk_samples: int, overlap_samples: int = 0
) -> Iterator[tuple[Log, float, float]]:
    """Yield the parts of a log file (CSV, NPZ, Parquet, HDF5), and the time span [start, end) [s].

    They overlap with their neighbours: samples beyond the span take the filter transients. Memory
    holds one part of `chunk_samples`, which are not fewer than those of an overlap. Each part is
    checked as in `read_log`, and all must have the same sensors. Raises LogError.
    """
    table = open_table(path)
    if table.blocks is None:
        raise LogError(
            f"'{path}': '{path.suffix}' logs cannot be read in pieces; allowed: "
            f"{', '.join(WRITTEN)}; use read_log, or write it as one of these"
        )
    selection = selected(path, table, completed(table, LogDescription(), robot), robot)
    blocks = table.blocks(selection.columns, chunk_samples)
    sensors: set[str] | None = None
    for data, before, length in _overlapping(blocks, overlap_samples):
        log = selection.log(data)
        logged = set(log.columns())
        sensors = logged if sensors is None else sensors
        if logged != sensors:
            raise LogError(
                f"'{path}': {', '.join(sorted(logged ^ sensors))} has values in one part of the "
                f"log and none in another (around t = {log.time[before]:.6g} s); a sensor must be "
                "logged in all parts or in none"
            )
        end = before + length
        end_s = float(log.time[end]) if end < len(log.time) else math.inf
        yield log, float(log.time[before]), end_s


def _overlapping(blocks: Blocks, overlap: int) -> Iterator[tuple[Block, int, int]]:
    """Yield blocks with `overlap` samples of neighbours, place and number of own samples."""
    whole = _whole_blocks(blocks)
    first = next(whole)
    before = nothing = _cut(first, slice(0))
    for block, following in pairwise(chain([first], whole, [nothing])):
        after = _cut(following, slice(overlap))
        yield joined([before, block, after]), _length(before), _length(block)
        # Not slice(-overlap): that is the whole block if the overlap is zero.
        before = _cut(block, slice(_length(block) - overlap, None))


def _whole_blocks(blocks: Blocks) -> Iterator[Block]:
    """Yield blocks; those below the least length of a log become part of the one before."""
    block = next(blocks)
    for following in blocks:
        if min(_length(block), _length(following)) < MINIMUM_SAMPLES:
            block = joined([block, following])
        else:
            yield block
            block = following
    yield block


def _length(block: Block) -> int:
    return len(next(iter(block.values())))


def _cut(block: Block, samples: slice) -> Block:
    return {name: values[samples] for name, values in block.items()}


def _check_even(path: Path, log: Log, start_s: float) -> None:
    """Raise LogError for frozen channels and unequal time steps, naming the first hole, if any."""
    frozen, gaps = without_frozen(log).report, holes(log.time)
    if not frozen and is_regular(log.time):
        return
    remedy = "must be sampled evenly: resample it, cut it there, or use read_log"
    fault = f"the time steps around {start_s:.6g} s are not equal"
    if frozen:
        fault, remedy = str(frozen[0]), "must not have that: cut it there, or use read_log"
    elif len(gaps):
        fault = f"the log has a hole of {hole_text(gaps[0])}"
    raise LogError(f"'{path}': {fault}; a log that is read in pieces {remedy}")


def _extremes(long_log: LongLog) -> tuple[Array, Array | None]:
    """Return the largest speeds (2, n) of motors and joints, and the range of temperatures."""
    fastest, ends = np.zeros((2, long_log.robot.n)), []
    for motion, *span in long_log.motions():
        # Without the overlap, in which the filter's transient may exceed the true speeds.
        first, last = np.searchsorted(motion.time, span)
        piece = motion.samples(slice(first, last))
        fastest = np.maximum(fastest, piece.largest_speeds)
        if (warmth := piece.motor_temperature) is not None:
            ends.append([np.min(warmth, axis=0), np.max(warmth, axis=0)])
    if not ends:
        return fastest, None
    low, high = np.transpose(ends, (1, 0, 2))
    return fastest, np.array([np.min(low, axis=0), np.max(high, axis=0)])
