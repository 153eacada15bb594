"""What many tests measure: rows of equations, and files of columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.regressor.regression import Regression


def write_columns(path: Path, columns: Mapping[str, Array], fmt: str = "%.12g") -> Path:
    """Write columns as a CSV file, or as .npz by the ending of the path."""
    if path.suffix == ".npz":
        np.savez(path, **columns)  # type: ignore[arg-type]
        return path
    table, header = np.column_stack([*columns.values()]), ",".join(columns)
    np.savetxt(path, table, fmt=fmt, delimiter=",", header=header, comments="")
    return path


def regression(H: Array, y: Array, *, unit: str = "kg", **more: Any) -> Regression:
    """Return rows y = H theta + noise, with names a, b, ... and one equation unless told.

    Equations `joint=` follow each other in time, 0.05 s a row, unless `time=` is given.
    """
    count, width = H.shape
    joint = np.asarray(more.get("joint", np.zeros(count)), dtype=float)
    time = np.empty(count)
    for one in np.unique(joint):
        time[joint == one] = 0.05 * np.arange(np.sum(joint == one))
    plain: dict[str, Any] = {
        "names": tuple("abcdefghijklmnop"[:width]),
        "units": (unit,) * width,
        "time": time,
        "run": np.zeros(count),
        "excluded": 0,
        "propagated": np.empty((count, 0)),
    }
    return Regression(H=H, y=y, **(plain | more | {"joint": joint}))
