"""The search of design_excitation: SLSQP from a feasible start and many random ones, in processes.

SLSQP (Kraft 1988) satisfies linear inequalities at every step, needs first derivatives only, and is
part of scipy. It minimises the smooth criterion, because it stalls at the kinks of the plain one;
motions are compared by the plain one.
"""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Container, Mapping, Sequence, Sized
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NoReturn, TypeVar

import numpy as np

from seaid._arrays import Array
from seaid._progress import Report, best_so_far
from seaid.errors import ExcitationError
from seaid.excitation.collision import distances
from seaid.excitation.criteria import smooth_maximum
from seaid.excitation.limits import DRIVE_KINDS, drive_loads
from seaid.excitation.problem import (
    TARGET_USE,
    PlanningProblem,
    constraints,
    has_nonlinear_limits,
    largest_nonlinear_use,
    linear_use,
    nonlinear_use,
    random_start,
    recentred,
    scaled_into_limits,
    states_of,
    value_and_gradient,
    value_of,
)

Result = TypeVar("Result")

# [s]: processes without work end, look for their parent, and are waited for after Ctrl-C
_IDLE_SECONDS, _LOOK_SECONDS, _PATIENCE_SECONDS = 120, 1.0, 5.0
# one process per core: threads of the linear algebra would compete for the same cores
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def _raise(number: int, problem: BaseException) -> NoReturn:
    """Raise the exception of a task, in words for one of its process."""
    if not isinstance(problem, BrokenExecutor):
        raise problem
    raise ExcitationError(
        "a process of the search was ended from outside (killed, or out of memory: "
        f"{type(problem).__name__}): close what needs memory, or search in this process "
        "with executor=concurrent.futures.ThreadPoolExecutor(1)"
    ) from None


def run_all(
    function: Callable[..., Result],
    tasks: Sequence[tuple[object, ...]],
    executor: Executor | None,
    done: Callable[[int, Result], None],
    lost: Callable[[int, BaseException], Result] = _raise,
) -> tuple[list[Result], bool]:
    """Return the results of a function for all tasks, in order, and whether Ctrl-C interrupted.

    The tasks run by the executor, or by processes that remain for the next call; `done` is called
    with the number of finished tasks and the result of the last one. After Ctrl-C the results are
    those of finished tasks. If a process of the library dies, which of its tasks ended it is not
    known: each task that ran then is repeated alone. `lost` returns the result of a task that fails
    from its number and the exception. Without it ExcitationError is raised for a task whose process
    dies again, and for an executor of the user that breaks.
    """
    results: dict[int, Result] = {}
    running: dict[Future[Result], int] = {}
    waiting, again = deque(range(len(tasks))), set[int]()
    interrupted = False
    try:
        while waiting or running:
            pool, most = _processes(len(tasks), executor)
            for _ in range(_free(waiting, running, most, again)):
                number = waiting.popleft()
                running[pool.submit(function, *tasks[number])] = number
            for future in wait(running, return_when="FIRST_COMPLETED").done:
                number, problem = running.pop(future), future.exception()
                if isinstance(problem, BrokenExecutor) and not (executor or number in again):
                    again.add(number)
                    waiting.appendleft(number)
                    continue
                results[number] = lost(number, problem) if problem else future.result()
                done(len(results), results[number])
    except KeyboardInterrupt:
        interrupted = True
        results |= _finished_results(running)
    return list(dict(sorted(results.items())).values()), interrupted


def _free(waiting: Sequence[int], running: Sized, most: int, again: Container[int]) -> int:
    """Return how many waiting tasks begin now: a repeated one runs alone."""
    most = 1 if waiting and waiting[0] in again else most
    return max(0, min(len(waiting), most - len(running)))


def _processes(tasks: int, executor: Executor | None) -> tuple[Executor, int]:
    """Return the executor, and how many tasks run at a time; without one processes that remain.

    They remain for the next call and end with this process. They are those of loky, which need no
    `if __name__ == "__main__"` in the user's script, unlike those of concurrent.futures; one per
    task, at most one per core, with one thread each.
    """
    if executor is not None:
        return executor, tasks
    from loky import cpu_count, get_reusable_executor

    number = min(tasks, cpu_count())
    executor = get_reusable_executor(
        max_workers=number,
        timeout=_IDLE_SECONDS,
        env=_ONE_THREAD,
        initializer=_exit_with_parent,
        initargs=(os.getpid(),),
    )
    return executor, number


def _exit_with_parent(parent: int) -> None:
    """End this process soon after its parent, which may be killed without notice."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _finished_results(running: Mapping[Future[Result], int]) -> dict[int, Result]:
    """Return {number: result} of the running tasks that finish after an interrupt."""
    results = {}
    # all are cancelled before the first is waited for, so that no further one begins meanwhile
    for future in running:
        future.cancel()
    for future, number in running.items():
        with suppress(CancelledError, TimeoutError, BrokenExecutor, KeyboardInterrupt):
            results[number] = future.result(timeout=_PATIENCE_SECONDS)
    return results


# starts, iterations of each, and the used share at which one ends early
_TRIES, _ITERATIONS, _ENOUGH = 3, 40, 0.9
_UNITS = {"joint_torque": "N m (or N)", "motor_torque": "N m", "motor_speed": "rad/s"}


class _StopError(Exception):
    """Stops SLSQP: a motion is well within the limits, or the criterion no longer decreases."""


def with_feasible_start(problem: PlanningProblem, seed: int) -> PlanningProblem:
    """Return the problem with a motion within all limits as its origin.

    If a drive or a distance breaks a limit at the present origin, SLSQP minimises the used share of
    these limits within the linear ones, from a few starts. Raises ExcitationError, naming joint or
    links and the limit, if no such motion is found.
    """
    nothing = np.zeros(np.prod(problem.shape))
    if not has_nonlinear_limits(problem) or largest_nonlinear_use(problem, nothing) <= TARGET_USE:
        return problem
    rng = np.random.default_rng(seed)
    tried = [nothing]
    for number in range(_TRIES):
        x = nothing
        if number:
            joints = rng.normal(size=problem.shape)
            x = 0.8 * np.ravel(joints / linear_use(problem, joints.ravel())[:, None])
        tried.append(_least_use(problem, x))
        if largest_nonlinear_use(problem, tried[-1]) <= TARGET_USE:
            return recentred(problem, tried[-1])
    raise _infeasible(problem, min(tried, key=lambda x: largest_nonlinear_use(problem, x)))


def _least_use(problem: PlanningProblem, start: Array) -> Array:
    """Return an x within the linear limits that minimises the used share of the others."""
    from scipy.optimize import minimize

    latest = start

    def watch(x: Array) -> None:
        nonlocal latest
        # SLSQP may exceed the linear limits slightly: x is scaled towards 0, which keeps them
        latest = x / max(1.0, float(linear_use(problem, x).max()) * (1 + 1e-6))
        if largest_nonlinear_use(problem, latest) < _ENOUGH:
            raise _StopError

    def objective(x: Array) -> tuple[float, Array]:
        use, gradient = nonlinear_use(problem, x)
        value, shares = smooth_maximum(use)
        return value, gradient.T @ shares

    with suppress(_StopError):
        minimize(
            objective,
            start,
            jac=True,
            method="SLSQP",
            constraints=constraints(problem, nonlinear=False),
            options={"maxiter": _ITERATIONS},
            callback=watch,
        )
    return latest


def _infeasible(problem: PlanningProblem, x: Array) -> ExcitationError:
    """Return the error that names the most broken limit of the best motion found."""
    states, worst, words = states_of(problem, x), 0.0, ""
    if problem.drive_limits is not None:
        limits = problem.drive_limits
        loads = np.abs(drive_loads(limits, problem.time, states)).max(axis=1)
        kind, joint = np.unravel_index(np.argmax(loads / limits.largest), loads.shape)
        worst, name = float(loads[kind, joint] / limits.largest[kind, joint]), DRIVE_KINDS[kind]
        owner = limits.robot.joint_names[joint]
        unit = _UNITS.get(name, "rad (or m)")
        words = (
            f"keeps joint '{owner}' within its {name.replace('_', ' ')} limit, "
            f"{limits.largest[kind, joint]:.4g} {unit}: the best needs {loads[kind, joint]:.4g}. "
            f"Give more by Limits({name}={{'{owner}': ...}}) (math.inf: not limited), a smaller "
            "range or a longer duration"
        )
    if problem.scene is not None:
        far = distances(problem.scene, states[0])
        pair = int(far.min(axis=0).argmin())
        # the drive is named, unless it keeps its limit or bodies overlap
        if worst <= 1.0 or far.min() < 0:
            first, second = problem.scene.pairs[pair]
            words = (
                f"keeps '{first}' and '{second}' {problem.scene.clearance_m:.4g} m apart: the best "
                f"has {far.min():.4g} m. Give a smaller clearance, other position limits or boxes"
            )
    return ExcitationError(f"no motion was found that {words}")


# a search ends where 25 iterations gain less than 0.2 %; one that still gained over 5 % at its
# iteration limit is reported as early
_STALL_ITERATIONS, _STALL, _STILL_FALLING = 25, 2e-3, 5e-2

_HOPELESS = 100.0
"""Criterion in place of infinity, from which the line search of SLSQP retreats. It is a logarithm:
that of the condition number from which H is rank deficient, 1e12, is 28."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a search: log of the criterion, x within limits, reason of an `early` stop."""

    value: float
    x: Array
    early: str = ""
    interrupted: bool = False


def search(
    problem: PlanningProblem,
    starts: int,
    iterations: int,
    seed: int,
    *,
    executor: Executor | None = None,
    progress: bool = False,
) -> tuple[Outcome, Array]:
    """Search from random starts, a third of the iterations each, then continue from the best.

    Also return the best of the starts themselves. Ties go to the first start, so the result does
    not depend on the executor. Raises ExcitationError if no start identifies all parameters.
    """
    # child seeds: a start does not depend on the number of the others
    seeds = np.random.SeedSequence(seed).spawn(starts)
    begins = [random_start(problem, np.random.default_rng(child)) for child in seeds]
    outcomes = [Outcome(value_of(problem, x), x) for x in begins]
    begin = min(outcomes, key=lambda outcome: outcome.value)
    if not np.isfinite(begin.value):
        raise ExcitationError(
            f"no motion of this kind identifies all {problem.target.description}: condition number "
            "infinite; give more coefficients, more samples or wider limits"
        )
    # a single start needs no selection: it gets all iterations at once
    first = -(-iterations // 3) if starts > 1 else 0
    total = starts * first + iterations
    with best_so_far("excitation", problem.measure.meaning, total, progress) as report:
        tasks = [(problem, x, first) for x in begins] if first else []
        ended, interrupted = run_all(
            optimise, tasks, executor, lambda number, each: report(each.value, number * first)
        )
        best = min([*outcomes, *ended], key=lambda outcome: outcome.value)
        if interrupted or any(outcome.interrupted for outcome in ended):
            return replace(best, early="interrupted", interrupted=True), begin.x
        done = starts * first
        last = optimise(problem, best.x, iterations, lambda value, i: report(value, done + i))
        return last, begin.x


def optimise(
    problem: PlanningProblem, start: Array, iterations: int, report: Report | None = None
) -> Outcome:
    """Return the best motion of SLSQP from one start, which is never worse than the start."""
    from scipy.optimize import minimize

    best = Outcome(value_of(problem, start), start)
    history = [best.value]

    def watch(x: Array) -> None:
        nonlocal best
        inside = scaled_into_limits(problem, x)
        value = value_of(problem, inside)
        if value < best.value:
            best = Outcome(value, inside)
        history.append(best.value)
        if report is not None:
            report(best.value, len(history) - 1)
        if _gain(history) < _STALL:
            raise _StopError

    try:
        result = minimize(
            lambda x: _finite(*value_and_gradient(problem, x)),
            start,
            jac=True,
            method="SLSQP",
            constraints=constraints(problem),
            options={"maxiter": iterations, "ftol": 1e-9},
            callback=watch,
        )
    except _StopError:
        return best
    except KeyboardInterrupt:
        return replace(best, early="interrupted", interrupted=True)
    # 8: no descent at a kink, where two singular values meet; 9: the iteration limit
    early = "" if result.status in (0, 8, 9) else f"SLSQP: {result.message}"
    if result.status == 9 and _gain(history) > _STILL_FALLING:
        early = (
            f"stopped at the iteration limit ({iterations}) while the criterion was still "
            "decreasing; raise iterations"
        )
    return replace(best, early=early)


def _finite(value: float, gradient: Array) -> tuple[float, Array]:
    """Return a large value in place of infinity, from which the line search of SLSQP retreats."""
    return (value, gradient) if np.isfinite(value) else (_HOPELESS, gradient)


def _gain(history: Sequence[float]) -> float:
    """Return the decrease of the log of the criterion over the last iterations."""
    return history[-_STALL_ITERATIONS] - history[-1] if len(history) > _STALL_ITERATIONS else np.inf
