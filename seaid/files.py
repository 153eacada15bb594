"""Files appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from seaid.errors import SeaidError


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
        reason = problem.strerror or str(problem)
        raise SeaidError(
            f"cannot write '{path}': {reason}; name a folder you may write to"
        ) from None
    finally:
        with suppress(OSError):
            temporary.unlink()
