"""A log to be written, and what the opening of a file says where it is refused."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from scipy import io

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import WRITTEN, Log, write_log
from seaid.log.readers.opening import open_table

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
    save(path, {name: values.tolist() for name, values in columns.items()})


def save(path: Path, content: Any) -> Path:
    """Write bytes or a text as they are, and else what a format has for columns or values."""
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif isinstance(content, str):
        path.write_text(content)
    elif path.suffix == ".json":
        path.write_text(json.dumps(content))
    elif path.suffix == ".npz":
        np.savez_compressed(path, **content)
    elif path.suffix == ".parquet":
        parquet.write_table(arrow.table(content), path)
    elif path.suffix == ".mat":
        io.savemat(path, content)
    else:
        with h5py.File(path, "w") as file:
            for name, values in content.items():
                file[name] = values
    return path


def loaded(path: Path, names: Mapping[str, object]) -> dict[str, list[float | None]]:
    """Return columns of a file as lists, NaN as None."""
    columns = open_table(path).load([*names])
    return {
        name: [None if np.isnan(value) else value for value in values.tolist()]
        for name, values in columns.items()
    }


def error_of(path: Path, *wanted: str) -> str:
    """Return what opening a file, or loading columns of it, says; never much."""
    with pytest.raises(LogError) as caught:
        open_table(path).load(list(wanted))
    assert len(str(caught.value)) < 2100
    assert str(caught.value).isprintable()
    return str(caught.value)
