"""Datasets of an identification: motions of logs in memory, and log files read in pieces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from seaid._arrays import Array
from seaid._progress import track
from seaid.checks.tolerances import LEAST_RANGE_K
from seaid.drives.terms import BY_TEMPERATURE
from seaid.errors import IdentificationError
from seaid.estimation.fitting import Rows, stored_rows
from seaid.log import Log, LongLog, Motion, Processing, open_long_log
from seaid.log.filtering import CutoffSelection
from seaid.log.motion import FEWEST_PERIODS, SHORTEST_STRETCH, reconstruct_motions
from seaid.regressor import Regression
from seaid.regressor.regression import Regress, regressions_of_parts, stacked
from seaid.robot import Robot

Source = Log | LongLog | str | Path
"""A log in memory, a log file opened by `open_long_log`, or a path with standard column names."""

Dataset = Motion | LongLog
_FILTER = "filtering the log"


def sources_of(logs: Source | Sequence[Source]) -> list[Source]:
    """Return the logs as a list. Raises IdentificationError for none, and for other types."""
    sources = [logs] if isinstance(logs, Log | LongLog | str | Path) else list(logs)
    if not sources:
        raise IdentificationError("identify needs a log, found none")
    for source in sources:
        if not isinstance(source, Log | LongLog | str | Path):
            raise IdentificationError(
                "logs must be Logs (of read_log, simulate), paths of log files or LongLogs, found "
                f"{type(source).__name__}"
            )
    return sources


def datasets_by_log(
    robot: Robot,
    sources: Sequence[Source],
    cutoff_hz: float | None,
    progress: bool = False,
) -> list[list[Dataset]]:
    """Return the motions of each log with one cutoff: the given one, or the lowest one proposed.

    The common cutoff is not below the limit of the shortest log. A log with gaps in time has one
    motion per stretch between them.
    """
    filtered = partial(track, description=_FILTER, enabled=progress)
    groups = [_datasets(robot, cutoff_hz, source) for source in filtered(sources)]
    common = min(group[0].cutoff_hz for group in groups)
    if cutoff_hz is None:
        # The lowest cutoff of one log may be below what another one, a shorter log, allows.
        common = max([common, *(1.001 * _lowest_hz(group) for group in groups)])
    others = {x: sources[x] for x, group in enumerate(groups) if group[0].cutoff_hz != common}
    for place in filtered([*others]):
        groups[place] = list(map(_in_common, _datasets(robot, common, others[place])))
    return groups


def _lowest_hz(group: Sequence[Dataset]) -> float:
    """Return the limit of the cutoff for the stretches of a log, zero for one read in pieces."""
    lengths = [float(x.time[-1] - x.time[0]) for x in group if isinstance(x, Motion)]
    if not lengths:
        return 0.0
    return max(FEWEST_PERIODS / sum(lengths), SHORTEST_STRETCH / max(lengths))


def _in_common(dataset: Dataset) -> Dataset:
    if isinstance(dataset, LongLog) or dataset.processing is None:
        return dataset
    band = CutoffSelection(dataset.cutoff_hz, "common to all logs")
    return replace(dataset, processing=replace(dataset.processing, cutoff_selection=band))


def check_temperatures(robot: Robot, datasets: Sequence[Dataset], only: str | None = None) -> None:
    """Raise IdentificationError if friction by temperature lacks a temperature that changes.

    `only`: the joint that is checked; None: all.
    """
    for index, joint in enumerate(robot.joint_names):
        drive = robot.drives[joint]
        if not drive.has_temperature_terms or only not in (None, joint):
            continue
        column = f"{joint}.motor_temperature_degC"
        if not all(has_temperature(first_motion(dataset), index) for dataset in datasets):
            raise IdentificationError(
                f"the friction of joint '{joint}' depends on the temperature of its motor, and a "
                f"log has none: log '{column}', or remove its terms "
                f"{', '.join(term for term in drive.friction if term in BY_TEMPERATURE)}"
            )
        warmth = np.concatenate([_temperatures(dataset) for dataset in datasets])[:, index]
        low, high = float(np.min(warmth)), float(np.max(warmth))
        if high - low < LEAST_RANGE_K:
            raise IdentificationError(
                f"'{column}' ranges from {low:.4g} to {high:.4g} degC: friction by temperature "
                f"needs a range of {LEAST_RANGE_K:g} K or more. Add a log with a warmer or colder "
                f"motor, or remove the terms from friction of '{joint}'"
            )


def _temperatures(dataset: Dataset) -> Array:
    """Return the temperatures (T, n) of the motors, of a log read in pieces the extreme ones."""
    if isinstance(dataset, Motion):
        return np.asarray(dataset.motor_temperature)
    return np.asarray(dataset.temperature_range)


def has_temperature(motion: Motion, index: int) -> bool:
    """Whether the temperature of a motor was logged."""
    warmth = motion.motor_temperature
    return warmth is not None and bool(np.all(np.isfinite(warmth[:, index])))


def processing_of(datasets: Sequence[Dataset]) -> tuple[Processing, ...]:
    """Return the processing of each log; of a long log, that of its first piece."""
    return tuple(dataset.processing for dataset in datasets if dataset.processing is not None)


def first_motion(dataset: Dataset) -> Motion:
    """Return the motion, or that of the first piece of a long log, which has the same sensors."""
    return dataset if isinstance(dataset, Motion) else dataset.first_motion


@contextmanager
def rows_of_equations(
    datasets: Sequence[Dataset],
    equations: Mapping[str, Regress],
    stored: bool,
    progress: bool = False,
) -> Iterator[Mapping[str, Rows]]:
    """Yield the rows of several equations; those of long logs may be `stored` in files."""
    long_logs = [dataset for dataset in datasets if isinstance(dataset, LongLog)]
    if stored and len(long_logs) == len(datasets):
        steps_s = tuple(log.step_s for log in long_logs)
        pieces = (
            (number, name, rows)
            for number, log in enumerate(long_logs)
            for name, rows in regressions_of_parts(log, equations)
        )
        with stored_rows(equations, steps_s, pieces) as files:
            yield files
        return
    yield rows_in_memory(datasets, equations, progress)


def rows_in_memory(
    datasets: Sequence[Dataset], equations: Mapping[str, Regress], progress: bool = False
) -> dict[str, Regression]:
    """Return the rows of all datasets for several equations, for which each log is read once."""
    parts = [_rows(equations, dataset) for dataset in track(datasets, "regressors", progress)]
    return {name: stacked([part[name] for part in parts]) for name in equations}


def _datasets(robot: Robot, cutoff_hz: float | None, source: Source) -> list[Dataset]:
    """Return a log file read in pieces, or the motions between the gaps of a log in memory."""
    if isinstance(source, Log):
        return list(reconstruct_motions(robot, source, cutoff_hz))
    if not isinstance(source, LongLog):
        return [open_long_log(source, robot, cutoff_hz=cutoff_hz)]
    if cutoff_hz in (None, source.cutoff_hz):
        return [source]
    samples = source.chunk_samples
    return [open_long_log(source.path, robot, cutoff_hz=cutoff_hz, chunk_samples=samples)]


def _rows(equations: Mapping[str, Regress], dataset: Dataset) -> dict[str, Regression]:
    """Return the rows of one dataset per equation."""
    if isinstance(dataset, Motion):
        return {name: regress(dataset) for name, regress in equations.items()}
    parts: dict[str, list[Regression]] = {name: [] for name in equations}
    for name, rows in regressions_of_parts(dataset, equations):
        parts[name].append(rows)
    whole = {name: stacked(pieces) for name, pieces in parts.items()}
    return {name: replace(rows, run=np.zeros(len(rows.y))) for name, rows in whole.items()}
