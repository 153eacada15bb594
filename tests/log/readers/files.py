"""A log to be written, and what the opening of a file says where it is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log.readers.opening import open_table
from seaid.log.reading import WRITTEN, Log, write_log

TIME: Array = np.arange(400) / 100
FORMATS = (*WRITTEN, ".json")
"""Endings of the files that may have seaid's own columns."""


def one_log() -> Log:
    position, behind, torque, current = (
        np.sin(2 * np.pi * f * TIME)[:, None] for f in (5, 7, 9, 3)
    )
    return Log(TIME, ("arm",), position, behind, torque, motor_current=current)


def write(log: Log, path: Path) -> None:
    """Write a log in any of the FORMATS."""
    if path.suffix != ".json":
        write_log(log, path)
        return
    columns = {"time_s": log.time, **log.columns()}
    path.write_text(json.dumps({name: values.tolist() for name, values in columns.items()}))


def error_of(path: Path, *wanted: str) -> str:
    """Return what opening a file, or loading columns of it, says; never much."""
    with pytest.raises(LogError) as caught:
        open_table(path).load(list(wanted))
    assert len(str(caught.value)) < 2100
    assert "\n" not in str(caught.value)
    return str(caught.value)
