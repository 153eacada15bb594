"""Files appear whole or not at all."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from seaid.arrays import Array
from seaid.errors import SeaidError, reason_of, shortened

_LONGEST_SUFFIX, _SHOWN = 16, 500
"""Letters: of an ending that a temporary file keeps, and of a path in a message."""


def result_folder(path: str | Path) -> Path:
    """Make a folder for results and return it; asked before long work, not after it.

    Raises SeaidError where it cannot be made or written to.
    """
    path = Path(path)
    with _refusals(path):
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    return path


def real_path(path: str | Path) -> Path:
    """Return a path in full and without links.

    Raises SeaidError for what no path can be, and for a relative one in a deleted working folder.
    """
    try:
        return Path(os.path.realpath(path))
    except (OSError, ValueError) as problem:
        raise SeaidError(
            f"cannot look up '{shortened(str(path))}' ({working_folder()}): {reason_of(problem)}"
        ) from None


def working_folder() -> str:
    """Return 'working folder /home/...' for messages, also where it has been deleted."""
    try:
        return f"working folder {os.getcwd()}"
    except OSError:
        return "the working folder has been deleted: change to one that exists"


def is_replaced(path: str | Path) -> bool:
    """Tell whether writing would replace a file: not at devices, pipes and this process's output.

    Raises SeaidError for a folder, and for what no path can be.
    """
    path = Path(path)
    with _refusals(path):
        there = _status(path)
    return there is not None and _is_plain(there)


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Give a temporary path to write to; it becomes `path` only if all went well.

    It is a new file beside `path` under a name that nobody can foresee. Makes the folder if it is
    not there; an older file keeps its mode, and its owner where that is allowed; a link stays, and
    what it points to is written. A device, a pipe or the output of this process is not replaced:
    the bytes are sent there. Raises SeaidError where the file cannot be written; an older file
    then stays as it was.
    """
    path = Path(path)
    with _refusals(path):
        there = _status(path)
        if there is None or _is_plain(there):
            path.parent.mkdir(parents=True, exist_ok=True)  # also where it is 'new/../'
            place = _replacing(Path(os.path.realpath(path)), there)
        else:
            place = _sending(path, there)
        with place as temporary:
            yield temporary


def write_whole(path: str | Path, content: bytes | str) -> None:
    """Write bytes, or text as UTF-8, whole or not at all; see `whole_file`."""
    data = content if isinstance(content, bytes) else content.encode("utf-8", "replace")
    with whole_file(path) as temporary:
        temporary.write_bytes(data)


def write_csv(path: str | Path, data: Mapping[str, Array]) -> None:
    """Write equally long columns with a header line, in full precision, whole or not at all."""
    with (
        whole_file(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="replace", newline="") as file,
    ):
        csv.writer(file, lineterminator="\n").writerow(data)
        np.savetxt(file, np.column_stack(list(data.values())), fmt="%.17g", delimiter=",")


def write_json(path: str | Path, content: Any) -> None:
    """Write data as JSON, whole or not at all; see `plain`."""
    write_whole(path, json.dumps(plain(content), indent=1, allow_nan=False) + "\n")


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


def _status(path: Path) -> os.stat_result | None:
    """Return the status of what is at a path, links followed; None where nothing is."""
    try:
        there = path.stat()
    except FileNotFoundError:
        return None
    except ValueError as problem:  # a NUL in the name
        raise OSError(errno.EINVAL, str(problem)) from None
    if stat.S_ISDIR(there.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    return there


def _is_plain(there: os.stat_result) -> bool:
    return stat.S_ISREG(there.st_mode) and _output_stream(there) is None


def _output_stream(there: os.stat_result) -> int | None:
    """Return 1 or 2 where a file is what stdout or stderr of this process go to."""
    for number in (1, 2):
        with suppress(OSError):  # closed
            if os.path.samestat(os.fstat(number), there):
                return number
    return None


@contextmanager
def _replacing(target: Path, old: os.stat_result | None) -> Iterator[Path]:
    """Give a new file beside the target, which takes its place in the end."""
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".seaid-{secrets.token_hex(8)}{_suffix(target)}")
    flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY
    try:
        number = os.open(temporary, flags, 0o666 if old is None else 0o600)
        try:
            yield temporary
            os.fsync(number)
            if old is not None:
                with suppress(PermissionError):
                    os.fchown(number, old.st_uid, old.st_gid)
                os.fchmod(number, stat.S_IMODE(old.st_mode))
        finally:
            os.close(number)
        os.replace(temporary, target)
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def _sending(path: Path, there: os.stat_result) -> Iterator[Path]:
    """Give a file elsewhere, whose bytes are sent to a device, a pipe or the own output."""
    with tempfile.TemporaryDirectory() as folder:
        temporary = Path(folder) / f"content{_suffix(path)}"
        yield temporary
        with _opened(path, there) as stream, temporary.open("rb") as content:
            shutil.copyfileobj(content, stream)


def _opened(path: Path, there: os.stat_result) -> BinaryIO:
    number = _output_stream(there)
    if number is None:
        return path.open("wb")
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()  # what was said before stands before
    return os.fdopen(os.dup(number), "wb")


def _suffix(path: Path) -> str:
    """Return the ending of a path, by which some writers know the format; none if it is long."""
    return path.suffix if len(os.fsencode(path.suffix)) <= _LONGEST_SUFFIX else ""


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """Say in words where something cannot be written."""
    try:
        yield
    except OSError as problem:
        advice = "name a folder you may write to"
        if problem.errno in (errno.ENOSPC, errno.EDQUOT):
            advice = "make room, or name a folder on another disk"
        raise SeaidError(
            f"cannot write '{shortened(str(path), _SHOWN)}': {reason_of(problem)}; {advice}"
        ) from None
