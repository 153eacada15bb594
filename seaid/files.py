"""Files appear whole or not at all."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from seaid.arrays import Array
from seaid.errors import SeaidError


def result_folder(path: str | Path) -> Path:
    """Make a folder for results and return it; asked before long work, not after it.

    Raises SeaidError where it cannot be made or written to.
    """
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as problem:
        raise _cannot_write(path, problem) from None
    return path


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside `path` to write to; it becomes `path` only if all went well.

    Makes the folder if it is not there. Raises SeaidError where the file cannot be written; an
    older file then stays as it was.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, path)
    except OSError as problem:
        raise _cannot_write(path, problem) from None
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_csv(path: str | Path, data: Mapping[str, Array]) -> None:
    """Write equally long columns with a header line, in full precision, whole or not at all."""
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(data)
        np.savetxt(file, np.column_stack(list(data.values())), fmt="%.17g", delimiter=",")


def write_json(path: str | Path, content: Any) -> None:
    """Write data as JSON, whole or not at all; see `plain`."""
    with whole_file(path) as temporary:
        text = json.dumps(plain(content), indent=1, allow_nan=False)
        temporary.write_text(text + "\n", encoding="utf-8")


def plain(value: Any) -> Any:
    """Return data as JSON knows it: arrays as lists, numbers that are not finite as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def _cannot_write(path: Path, problem: OSError) -> SeaidError:
    reason = problem.strerror or str(problem)
    advice = "name a folder you may write to"
    if problem.errno in (errno.ENOSPC, errno.EDQUOT):
        advice = "make room, or name a folder on another disk"
    return SeaidError(f"cannot write '{path}': {reason}; {advice}")
