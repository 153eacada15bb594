"""Who runs the starts of a search: processes of this machine, unless an executor is given."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

_IDLE_SECONDS = 120
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@contextmanager
def workers(executor: Executor | None, tasks: int) -> Iterator[Executor]:
    """Give the executor, or processes that stay for the next search.

    They are loky's, which need no `if __name__ == "__main__"` in a user's script, as those of
    concurrent.futures do; one a task, at most one a core, with one thread each.
    """
    if executor is not None:
        yield executor
        return
    from loky import cpu_count, get_reusable_executor

    yield get_reusable_executor(
        max_workers=min(tasks, cpu_count()), timeout=_IDLE_SECONDS, env=_ONE_THREAD
    )
