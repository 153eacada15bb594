"""Atomic writing of files, and bounded reading of TOML and JSON files of users.

A file is written completely or not at all. TOML and JSON are read as plain data of bounded size and
depth with finite numbers; nothing in them is evaluated, and the caller checks the meaning.
"""

from __future__ import annotations

import csv
import errno
import fcntl
import json
import math
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array, as_float, number
from seaid.errors import SeaidError, reason_of, shortened, shown

_LONGEST_SUFFIX, _SHOWN = 16, 500
"""Characters of a suffix that a temporary file keeps, and of a path in a message."""


def result_folder(path: str | Path) -> Path:
    """Create and return a folder for results, before a long computation; or raise SeaidError."""
    path = Path(path)
    with _refusals(path):
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    return path


PROJECT_FILE, LATEST, _TEMPORARY = "seaid.toml", "latest", ".seaid-"
"""The file of a project; the link to the folder of its newest run; how temporary names begin."""

_LONGEST_NAME = 255
"""Bytes of the name of a file."""


def followed(path: str | Path) -> Path:
    """Return a path behind `latest` where that is not a link, but a text with a folder's name."""
    path = Path(path)
    for link in (path, *path.parents):
        with suppress(OSError, ValueError):
            if link.name == LATEST and 0 < link.stat().st_size <= _LONGEST_NAME:
                folder = link.with_name(link.read_text(encoding="utf-8").strip())
                return folder / path.relative_to(link) if folder.is_dir() else path
    return path


def point_latest(target: Path) -> None:
    """Make `latest` point to a folder next to it: a link, or a text where there are no links.

    A folder or a file of that name that is neither stays.
    """
    link, temporary = target.parent / LATEST, target / f".{LATEST}"
    if link.exists() and not link.is_symlink() and followed(link) == link:
        return
    with _refusals(link):
        try:
            os.symlink(target.name, temporary)
        except OSError:  # a file system without links
            temporary.write_text(target.name, encoding="utf-8")
        # A rename is atomic: there is no instant without `latest`.
        os.replace(temporary, link)


@contextmanager
def owned_folder(parent: Path) -> Iterator[Path]:
    """Yield a new folder for results in `parent`, which is removed unless it was renamed.

    This process locks it while it lives. Folders of processes that were killed are removed before.
    """
    # A lock is gone with its process, also a killed one: what can be locked is abandoned. An empty
    # folder may be one that another process has made and not yet locked.
    for folder in parent.glob(f"{_TEMPORARY}*/"):
        with suppress(OSError), _locked(folder) as is_abandoned:
            if is_abandoned and any(folder.iterdir()):
                shutil.rmtree(folder, ignore_errors=True)
    folder = result_folder(parent / f"{_TEMPORARY}{secrets.token_hex(8)}")
    try:
        with _refusals(folder), _locked(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Lock a folder until the block, or the process, ends; yield whether that was possible."""
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        is_locked = False
        with suppress(OSError):  # another process has it, or the file system has no locks
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            is_locked = True
        yield is_locked
    finally:
        os.close(number)


def real_path(path: str | Path) -> Path:
    """Return the absolute path with links resolved; raise SeaidError for an invalid path."""
    try:
        return Path(os.path.realpath(path))
    except (OSError, ValueError) as problem:
        raise SeaidError(
            f"cannot look up '{shortened(str(path))}' ({working_folder()}): {reason_of(problem)}"
        ) from None


def working_folder() -> str:
    """Return 'working folder /home/...' for messages, or that the folder has been deleted."""
    try:
        return f"working folder {os.getcwd()}"
    except OSError:
        return "the working folder has been deleted: change to one that exists"


def is_replaced(path: str | Path) -> bool:
    """Return whether writing replaces a file; False for devices, pipes and this process's output.

    Raises SeaidError for a folder and for an invalid path.
    """
    path = Path(path)
    with _refusals(path):
        status = _status(path)
    return status is not None and _is_plain(status)


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path to write to; it replaces `path` only if the block ends without error.

    The temporary file has a random name in the folder of `path`, which is created if needed. An
    existing file keeps its mode and, where permitted, its owner; a link stays, and its target is
    written. Devices, pipes and the output of this process are not replaced: they receive the bytes.
    Raises SeaidError if the file cannot be written; an existing file then stays unchanged.
    """
    path = Path(path)
    with _refusals(path):
        old, target = _status(path), Path(os.path.realpath(path))
        is_plain = old is None or _is_plain(old)
        if is_plain:
            for name in (path, target):  # also where it is 'new/../', and of a link
                name.parent.mkdir(parents=True, exist_ok=True)
        folder = target.parent if is_plain else Path(tempfile.gettempdir())
        # By their suffix some writers select the format.
        suffix = path.suffix if len(os.fsencode(path.suffix)) <= _LONGEST_SUFFIX else ""
        temporary = folder / f"{_TEMPORARY}{secrets.token_hex(8)}{suffix}"
        # A new file gets the user's umask. In place of an existing one nobody else may read it
        # before it has the mode of that one.
        flags, mode = os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666 if old is None else 0o600
        number = os.open(temporary, flags, mode)
        try:
            yield temporary
            if old is not None and not is_plain:
                _send(temporary, path, old)
                return
            os.fsync(number)
            if old is not None:
                # In this order: a change of owner clears the set-user-id bits of the mode.
                with suppress(PermissionError):
                    os.fchown(number, old.st_uid, old.st_gid)
                os.fchmod(number, stat.S_IMODE(old.st_mode))
            os.replace(temporary, target)
        finally:
            os.close(number)
            with suppress(OSError):
                temporary.unlink()


def write_whole(path: str | Path, content: bytes | str) -> None:
    """Write bytes, or text as UTF-8, atomically; see `whole_file`."""
    data = content if isinstance(content, bytes) else content.encode("utf-8", "replace")
    with whole_file(path) as temporary:
        temporary.write_bytes(data)


def write_csv(path: str | Path, data: Mapping[str, Array]) -> None:
    """Write columns of equal length as CSV with a header line, in full precision, atomically."""
    with (
        whole_file(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="replace", newline="") as file,
    ):
        csv.writer(file, lineterminator="\n").writerow(data)
        np.savetxt(file, np.column_stack(list(data.values())), fmt="%.17g", delimiter=",")


def write_json(path: str | Path, content: Any) -> None:
    """Write data as JSON, atomically; see `plain`."""
    write_whole(path, json.dumps(plain(content), indent=1, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """Return data of JSON types: paths as texts, non-finite numbers as None."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return list(map(plain, value))
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def _status(path: Path) -> os.stat_result | None:
    """Return the status of a path with links followed, None if nothing exists there."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    except ValueError as problem:  # a NUL in the name
        raise OSError(errno.EINVAL, str(problem)) from None
    if stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    return status


def _is_plain(status: os.stat_result) -> bool:
    return stat.S_ISREG(status.st_mode) and _output_stream(status) is None


def _output_stream(status: os.stat_result) -> int | None:
    """Return 1 or 2 if a file is the target of this process's stdout or stderr, else None."""
    for stream in (1, 2):
        with suppress(OSError):  # closed
            if os.path.samestat(os.fstat(stream), status):
                return stream
    return None


def _send(content: Path, path: Path, status: os.stat_result) -> None:
    """Copy the bytes of a file to a device, a pipe or stdout/stderr."""
    number = _output_stream(status)
    if number is not None:
        for stream in filter(None, (sys.stdout, sys.stderr)):
            stream.flush()  # earlier output comes first
        # Closing the copy leaves stdout itself open.
        number = os.dup(number)
    with open(path if number is None else number, "wb") as stream, content.open("rb") as source:
        shutil.copyfileobj(source, stream)


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """Turn an OSError of writing into a SeaidError with advice."""
    try:
        yield
    except OSError as problem:
        advice = "name a folder you may write to"
        if problem.errno in (errno.ENOSPC, errno.EDQUOT):
            advice = "make room, or name a folder on another disk"
        raise SeaidError(
            f"cannot write '{shortened(str(path), _SHOWN)}': {reason_of(problem)}; {advice}"
        ) from None


MOST_TOML_BYTES = 2**20
"""Largest TOML file; the drives of a hundred joints take 50 kB."""

MOST_JSON_BYTES = 2**24
"""Largest JSON file; the planned motion of seven joints takes 100 kB."""

_MOST_DEPTH = 32
"""Most levels of tables and lists within each other, each of which is a call in the call before."""

_MOST_DOTS = 200
"""Most dots in a line of TOML: `tomllib` takes time quadratic in the parts of a dotted key."""

_LONGEST_PLACE = 200
"""Characters of the place of a fault in a message, as a.b[2]."""

_SURROGATE = re.compile("[\ud800-\udfff]")
_BARE = re.compile(r"[A-Za-z0-9_-]+", re.ASCII)


def from_template(
    package: str, template: str, filters: Mapping[str, Callable[..., Any]], **content: Any
) -> str:
    """Return the text of a file by its template in a package; `filters` say how values are written.

    `template` is relative to the folder of the package.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    lines: Any = {"trim_blocks": True, "lstrip_blocks": True, "keep_trailing_newline": True}
    loader = PackageLoader(package, ".")
    environment = Environment(loader=loader, undefined=StrictUndefined, **lines)
    environment.filters |= filters
    environment.tests["finite"] = math.isfinite
    return environment.get_template(template).render(content)


def toml_text(value: str) -> str:
    """Return a text as a TOML string: as in JSON, but with the delete character escaped."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_table(*keys: str) -> str:
    """Return the header of a table, [joints.elbow]; names that are no bare keys are quoted."""
    return f"[{'.'.join(map(toml_key, keys))}]"


def toml_key(name: str) -> str:
    """Return a name as a TOML key, quoted if it has to be."""
    return name if _BARE.fullmatch(name) else toml_text(name)


def read_toml(path: str | Path, what: str, error: type[SeaidError]) -> dict[str, Any]:
    """Return the tables of a TOML file of at most `MOST_TOML_BYTES`.

    `what` names the content in messages, as "drives". Raises `error`, with the file and the place
    in it, for an unreadable or invalid file, dates, non-finite numbers and too many levels.
    """

    def tables(text: str) -> Any:
        for place, line in enumerate(text.splitlines(), 1):
            if line.count(".") > _MOST_DOTS:
                raise ValueError(f"more than {_MOST_DOTS} dots (at line {place})")
        return tomllib.loads(text)

    content: dict[str, Any] = _read(path, what, "is not valid TOML", error, MOST_TOML_BYTES, tables)
    return content


def read_json(path: str | Path, what: str, error: type[SeaidError]) -> Any:
    """Return the content of a JSON file of at most `MOST_JSON_BYTES`.

    `what` names the content in messages, as "trajectory". Raises `error`, with the file and the
    place in it, for an unreadable or invalid file, non-finite numbers, duplicate keys and too many
    levels.
    """

    def content(text: str) -> Any:
        return json.loads(text, object_pairs_hook=_without_duplicates)

    return _read(path, what, "is not JSON", error, MOST_JSON_BYTES, content)


def numbers(where: str, value: Any, error: type[SeaidError]) -> Any:
    """Return a number, or lists of numbers of any depth, of JSON or TOML unchanged.

    Raises `error` naming `where` for any other type, such as texts and booleans.
    """
    if isinstance(value, list):
        for element in value:
            numbers(where, element, error)
    else:
        number(where, value, error)
    return value


def _read(
    path: str | Path,
    what: str,
    wrong: str,
    error: type[SeaidError],
    most_bytes: int,
    parse: Callable[[str], Any],
) -> Any:
    try:
        path = followed(path)
        mode = os.stat(path).st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # reading a pipe could block
            raise error(f"{what} '{path}' is a pipe, a socket or a device; it must be a file")
        with open(path, "rb") as file:
            data = file.read(most_bytes + 1)
    except (OSError, ValueError) as problem:  # ValueError: a zero byte or half a character
        text = shortened(str(path), _SHOWN)
        raise error(f"cannot read {what} '{text}': {reason_of(problem)}") from None
    where = f"{what} '{path}'"
    if len(data) > most_bytes:
        raise error(f"{where} is longer than the {most_bytes // 2**20} MB allowed")
    try:
        content = parse(data.decode("utf-8-sig"))
    except RecursionError:
        raise error(f"{where} {wrong}: tables or lists have too many levels") from None
    except ValueError as problem:  # TOML, JSON, UTF-8, or an integer of thousands of digits
        raise error(f"{where} {wrong}: {reason_of(problem)}") from None
    for place, wrong in _problems(content):
        raise error(f"{where}: {shortened(place or 'it', _LONGEST_PLACE)} {wrong}")
    return content


def _problems(value: Any, place: str = "", depth: int = 0) -> Iterator[tuple[str, str]]:
    """Yield place, as a.b[2], and fault of what is too deep, not finite or not plain data.

    The place of a key is that of its table.
    """
    match value:
        case dict() | list() if depth >= _MOST_DEPTH:
            yield place, f"is more than {_MOST_DEPTH} levels deep"
        case list():
            for index, entry in enumerate(value):
                yield from _problems(entry, f"{place}[{index}]", depth + 1)
        case dict():
            for key, entry in value.items():
                yield from _problems(key, place, depth + 1)
                name = key if _BARE.fullmatch(key) else shown(key)
                yield from _problems(entry, f"{place}.{name}".removeprefix("."), depth + 1)
        case str() if _SURROGATE.search(value):
            yield place, "is not Unicode: an unpaired surrogate"
        case int() | float() if not math.isfinite(as_float(value)):
            yield place, "must be a finite number, of 308 digits at most"
        case object() if not isinstance(value, str | int | float | None):
            found = shown(str(value))
            yield place, f"must be a number, a text, a list or a table, found {found}"


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    # Python's reader would take the last of several equal keys without a word.
    for key, count in Counter(key for key, _ in pairs).items():
        if count > 1:
            raise ValueError(f"duplicate key {shown(key)} in one object")
    return dict(pairs)
