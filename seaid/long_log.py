"""Long logs, read and reconstructed piece by piece: memory does not grow with their length."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from seaid.arrays import Array
from seaid.errors import LogError
from seaid.filtering import decimation
from seaid.log import (
    MINIMUM_SAMPLES,
    Column,
    Log,
    csv_columns,
    csv_header,
    log_format,
    log_of,
    wanted_columns,
)
from seaid.motion import Motion, check_cutoff, is_regular, reconstruct_motion
from seaid.regression import Regression, row_samples
from seaid.robot import Robot

CHUNK_SAMPLES = 16_000
"""Samples that are looked at together, beside the overlap."""

_FORGOTTEN = 6.0
"""Periods of the cutoff after which the filters have forgotten an end to 1e-11."""

_SHORTEST_RECORD = 10.0
"""Periods of the cutoff that a reconstruction needs."""

Block = dict[str, Array]
Blocks = Iterator[Block]
Regress = Callable[[Motion], Regression]


@dataclass(frozen=True, eq=False)
class LogPart:
    """Some samples of a long log, and the time from `start_s` to before `end_s` that is its own.

    What is outside is overlap with the neighbours, for filters to swing in.
    """

    log: Log
    start_s: float
    end_s: float


@dataclass(frozen=True, eq=False)
class LongLog:
    """A log file that is read piece by piece, each time anew, with what all pieces must share.

    `cutoff_hz` is the pass band, `step_s` the time between rows of a regression, `fastest` (n,) the
    largest motor speeds [rad/s]: friction is unknown below a part of them.
    """

    path: Path
    robot: Robot
    columns: Mapping[str, Column]
    chunk_samples: int
    overlap_samples: int
    cutoff_hz: float
    step_s: float
    fastest: Array | None = None

    def parts(self) -> Iterator[LogPart]:
        """Yield the log in parts that overlap."""
        return iterate_log(
            self.path,
            self.robot,
            columns=self.columns,
            chunk_samples=self.chunk_samples,
            overlap_samples=self.overlap_samples,
        )

    def motions(self) -> Iterator[tuple[Motion, LogPart]]:
        """Yield the reconstructed motion of each part, overlap included."""
        for part in self.parts():
            if not is_regular(part.log.time):
                raise LogError(
                    f"'{self.path}': the time steps around {part.start_s:.6g} s are not equal; a "
                    "log that is read in pieces must be sampled evenly: resample it, or use "
                    "read_log"
                )
            motion = reconstruct_motion(self.robot, part.log, self.cutoff_hz)
            yield replace(motion, fastest=self.fastest), part

    def regressions(self, regress: Regress) -> Iterator[Regression]:
        """Yield the rows of each part: together those of `regress` for the whole log."""
        for motion, part in self.motions():
            yield _own_rows(regress(motion), motion, part)


def open_long_log(
    path: str | Path,
    robot: Robot,
    *,
    columns: Mapping[str, Column] | None = None,
    cutoff_hz: float | None = None,
    chunk_samples: int = CHUNK_SAMPLES,
) -> LongLog:
    """Look through a log file (.csv or .npz) once, to read it in pieces from then on.

    `columns` as in `read_log`; `cutoff_hz` None: proposed from the first `chunk_samples`. Raises
    LogError as `read_log` does, where a sensor is not there all the time, and where time steps
    differ.
    """
    path, columns = Path(path), dict(columns or {})
    first = next(iterate_log(path, robot, columns=columns, chunk_samples=chunk_samples)).log
    if cutoff_hz is None:
        cutoff_hz = reconstruct_motion(robot, first).cutoff_hz
    rate_hz = (len(first.time) - 1) / (first.time[-1] - first.time[0])
    check_cutoff(cutoff_hz, rate_hz)
    step, period = decimation(rate_hz, cutoff_hz), rate_hz / cutoff_hz
    overlap = step * math.ceil(_FORGOTTEN * period / step)
    own = step * math.ceil(max(chunk_samples, _SHORTEST_RECORD * period) / step)
    long_log = LongLog(
        path=path,
        robot=robot,
        columns=columns,
        chunk_samples=own,
        overlap_samples=overlap,
        cutoff_hz=cutoff_hz,
        step_s=step / rate_hz,
    )
    return replace(long_log, fastest=_fastest(long_log))


def iterate_log(
    path: str | Path,
    robot: Robot,
    *,
    columns: Mapping[str, Column] | None = None,
    chunk_samples: int = CHUNK_SAMPLES,
    overlap_samples: int = 0,
) -> Iterator[LogPart]:
    """Yield a log file (.csv or .npz) in parts of `chunk_samples`, with overlap on both sides.

    Memory holds one part. Each part is checked as `read_log` checks a log; besides, all must have
    the same sensors. Raises LogError.
    """
    if not 0 <= overlap_samples <= chunk_samples:
        raise LogError(
            f"overlap_samples must be between 0 and chunk_samples, {chunk_samples}, found "
            f"{overlap_samples}"
        )
    path = Path(path)
    names, read = _READERS[log_format(path)](path)
    wanted = wanted_columns(path, names, robot, columns or {})
    blocks = read(list(dict.fromkeys(foreign for foreign, _ in wanted.values())), chunk_samples)
    sensors: set[str] | None = None
    for data, before, own in _overlapping(blocks, overlap_samples):
        log = log_of(path, data, wanted, robot, names)
        found = set(log.columns())
        sensors = found if sensors is None else sensors
        if found != sensors:
            raise LogError(
                f"'{path}': {', '.join(sorted(found ^ sensors))} has values in one part of the log "
                f"and none in another (around t = {log.time[before]:.6g} s); a sensor must be "
                "there all the time, or not at all"
            )
        end = before + own
        end_s = float(log.time[end]) if end < len(log.time) else math.inf
        yield LogPart(log, float(log.time[before]), end_s)


def _overlapping(blocks: Blocks, overlap: int) -> Iterator[tuple[Block, int, int]]:
    """Yield blocks with `overlap` samples of both neighbours; where own ones begin, how many.

    A last block too short for a log goes to the one before.
    """
    own = next(blocks)
    before = _cut(own, slice(0))
    for following in chain(blocks, [None]):
        if following is not None and _length(following) < MINIMUM_SAMPLES:
            own, after = _joined([own, following]), _cut(own, slice(0))
        else:
            after = _cut(own, slice(0)) if following is None else _cut(following, slice(overlap))
        yield _joined([before, own, after]), _length(before), _length(own)
        if following is None or _length(following) < MINIMUM_SAMPLES:
            return
        before = _cut(own, slice(_length(own) - overlap, None))
        own = following


def _length(block: Block) -> int:
    return len(next(iter(block.values())))


def _cut(block: Block, samples: slice) -> Block:
    return {name: values[samples] for name, values in block.items()}


def _joined(blocks: list[Block]) -> Block:
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _own_rows(rows: Regression, motion: Motion, part: LogPart) -> Regression:
    """Return the rows whose instant is the part's own, and how many of those were left out."""
    instants = motion.time[row_samples(motion)]
    mine = int(np.sum((instants >= part.start_s) & (instants < part.end_s)))
    equations = (len(rows.y) + rows.left_out) // max(len(instants), 1)
    kept = (rows.time >= part.start_s) & (rows.time < part.end_s)
    return replace(
        rows,
        left_out=equations * mine - int(np.sum(kept)),
        **{
            name: getattr(rows, name)[kept]
            for name in ("H", "y", "joint", "time", "run", "carried")
        },
    )


def _fastest(long_log: LongLog) -> Array:
    """Return the largest motor speed (n,) of the whole log."""
    fastest = np.zeros(long_log.robot.n)
    for motion, part in long_log.motions():
        own = (motion.time >= part.start_s) & (motion.time < part.end_s)
        fastest = np.maximum(fastest, np.max(np.abs(motion.motor_velocity[own]), axis=0))
    return fastest


def _csv_blocks(path: Path) -> tuple[list[str], Callable[[list[str], int], Blocks]]:
    """Return the column names of a CSV file, and how to read columns block by block."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            names, delimiter = csv_header(path, file.readline().rstrip("\r\n"))
    except OSError as problem:
        raise LogError(f"cannot read '{path}': {problem.strerror}") from None
    except UnicodeDecodeError as problem:
        raise LogError(f"'{path}' is not a text file in UTF-8: {problem}") from None

    def read(wanted: list[str], size: int) -> Blocks:
        with path.open(encoding="utf-8-sig") as file:
            file.readline()
            lines, line = list(islice(file, size)), 2
            while lines or line == 2:
                yield csv_columns(path, names, lines, delimiter, wanted, line)
                line += len(lines)
                lines = list(islice(file, size))

    return names, read


def _npz_blocks(path: Path) -> tuple[list[str], Callable[[list[str], int], Blocks]]:
    """Return the column names of an NPZ file, and how to read columns block by block."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist()]
    except (OSError, zipfile.BadZipFile):
        raise LogError(f"'{path}' is not a NumPy archive (.npz), or a damaged one") from None

    def read(wanted: list[str], size: int) -> Blocks:
        with zipfile.ZipFile(path) as archive, ExitStack() as stack:
            files = {name: stack.enter_context(archive.open(f"{name}.npy")) for name in wanted}
            kinds = {name: _npy_kind(path, name, file) for name, file in files.items()}
            lengths = {name: length for name, (_, length) in kinds.items()}
            if len(set(lengths.values())) > 1:
                raise LogError(f"'{path}': columns are not equally long: {lengths}")
            total = lengths[wanted[0]]
            for start in range(0, max(total, 1), size):
                count = min(size, total - start)
                yield {
                    name: _npy_block(path, name, file, kinds[name][0], count)
                    for name, file in files.items()
                }

    return names, read


def _npy_kind(path: Path, name: str, file: IO[bytes]) -> tuple[np.dtype[Any], int]:
    """Return type and length of a column."""
    try:
        version = np.lib.format.read_magic(file)
        reader = np.lib.format.read_array_header_1_0
        if version != (1, 0):
            reader = np.lib.format.read_array_header_2_0
        shape, _, kind = reader(file)
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error) as problem:
        raise LogError(f"'{path}': column '{name}' cannot be read: {problem}") from None
    if kind.kind not in "iuf" or len(shape) != 1:
        raise LogError(
            f"'{path}': column '{name}' must be a row of numbers, found {kind} of shape {shape}"
        )
    return kind, int(shape[0])


def _npy_block(path: Path, name: str, file: IO[bytes], kind: np.dtype[Any], count: int) -> Array:
    try:
        values = np.frombuffer(file.read(count * kind.itemsize), dtype=kind)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as problem:
        raise LogError(f"'{path}': column '{name}' cannot be read: {problem}") from None
    if len(values) < count:
        raise LogError(f"'{path}': column '{name}' cannot be read: it ends too early")
    return values.astype(np.float64)


_READERS = {".csv": _csv_blocks, ".npz": _npz_blocks}
