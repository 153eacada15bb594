"""Who runs the starts of a search: processes of this machine, unless an executor is given."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import suppress
from typing import TypeVar

from seaid.errors import ExcitationError

Result = TypeVar("Result")

_IDLE_SECONDS, _LOOK_SECONDS, _PATIENCE_SECONDS = 120, 1.0, 5.0
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def run_all(
    function: Callable[..., Result],
    tasks: Sequence[tuple[object, ...]],
    executor: Executor | None,
    done: Callable[[int, Result], None],
) -> tuple[list[Result], bool]:
    """Return the results of a function for all tasks, in their order, and whether Ctrl-C came.

    By the executor, or by processes that stay for the next search; `done` is called with the number
    and the result of each task. After Ctrl-C the results are those that were handed in. A process
    of ours that dies takes the tasks of all with it: they are given to new processes, once. Raises
    ExcitationError where that does not help, or an executor of the user's breaks.
    """
    results: list[Result] = []
    attempts = 2 if executor is None else 1
    while True:
        attempts -= 1
        before = len(results)
        try:
            pool = _processes(len(tasks)) if executor is None else executor
            futures = [pool.submit(function, *task) for task in tasks[before:]]
            try:
                for future in futures:
                    results.append(future.result())
                    done(len(results), results[-1])
            except KeyboardInterrupt:
                return results + _handed_in(futures[len(results) - before :]), True
            return results, False
        except BrokenExecutor as problem:
            if attempts:
                continue
            raise ExcitationError(
                "a process of the search was ended from outside (killed, or out of memory: "
                f"{type(problem).__name__}): close what needs memory, or search in this process "
                "with executor=concurrent.futures.ThreadPoolExecutor(1)"
            ) from None


def _processes(tasks: int) -> Executor:
    """Return processes that stay for the next search and end with this one.

    They are loky's, which need no `if __name__ == "__main__"` in a user's script, as those of
    concurrent.futures do; one a task, at most one a core, with one thread each.
    """
    from loky import cpu_count, get_reusable_executor

    executor: Executor = get_reusable_executor(
        max_workers=min(tasks, cpu_count()),
        timeout=_IDLE_SECONDS,
        env=_ONE_THREAD,
        initializer=_end_with,
        initargs=(os.getpid(),),
    )
    return executor


def _end_with(parent: int) -> None:
    """End this process soon after its parent, which may be killed and then says nothing."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _handed_in(futures: Sequence[Future[Result]]) -> list[Result]:
    """Return what workers, interrupted as well, still hand in."""
    found = []
    for future in futures:
        future.cancel()
    for future in futures:
        with suppress(CancelledError, TimeoutError, BrokenExecutor, KeyboardInterrupt):
            found.append(future.result(timeout=_PATIENCE_SECONDS))
    return found
