"""What many tests measure: robots, and files of their columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from seaid._arrays import Array


def write_columns(path: Path, columns: Mapping[str, Array], fmt: str = "%.12g") -> Path:
    """Write columns as a CSV file, or as .npz by the ending of the path."""
    if path.suffix == ".npz":
        np.savez(path, **columns)  # type: ignore[arg-type]
        return path
    table, header = np.column_stack([*columns.values()]), ",".join(columns)
    np.savetxt(path, table, fmt=fmt, delimiter=",", header=header, comments="")
    return path
