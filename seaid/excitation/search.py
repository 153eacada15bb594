"""The search behind design_excitation: SLSQP from many starts, within limits.

SLSQP (Kraft 1988) because it takes linear inequalities, keeps to them at every step, needs first
derivatives alone, and comes with scipy. It descends the smooth criterion, for it stalls at the
kinks of the plain one; which motion is the best is judged by the plain one.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array
from seaid.errors import ExcitationError
from seaid.excitation.constraints import constraints
from seaid.excitation.problem import (
    Problem,
    drawn_inside,
    random_start,
    value_and_gradient,
    value_of,
)
from seaid.excitation.workers import run_all
from seaid.progress import Report, best_so_far

_STALL_ITERATIONS, _STALL, _STILL_FALLING = 25, 2e-3, 5e-2
_HOPELESS = 100.0


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where a search ended: log of the criterion and x within limits; `early` says why it ended."""

    value: float
    x: Array
    early: str = ""
    interrupted: bool = False


class _StallError(Exception):
    """The way out of SLSQP once it gains no more."""


def search(
    problem: Problem,
    starts: int,
    iterations: int,
    seed: int,
    *,
    executor: Executor | None = None,
    progress: bool = False,
) -> tuple[Outcome, Array]:
    """Search from random starts, a third of the iterations each, then on from the best of them.

    Also return the best of the starts themselves. Ties go to the first start, so the result does
    not depend on who computes it, nor in which order. Raises ExcitationError where no start tells
    all parameters.
    """
    seeds = np.random.SeedSequence(seed).spawn(starts)
    begins = [random_start(problem, np.random.default_rng(one)) for one in seeds]
    outcomes = [Outcome(value_of(problem, x), x) for x in begins]
    begin = min(outcomes, key=lambda outcome: outcome.value)
    if not np.isfinite(begin.value):
        raise ExcitationError(
            f"no motion of this kind tells all {problem.target.asked}: condition number "
            "infinite; give more coefficients, more samples or wider limits"
        )
    first = -(-iterations // 3) if starts > 1 else 0
    total = starts * first + iterations
    with best_so_far("excitation", problem.measure.meaning, total, progress) as report:
        if first:
            outcomes += _map_starts(problem, begins, first, executor, report)
        best = min(outcomes, key=lambda outcome: outcome.value)
        if any(outcome.interrupted for outcome in outcomes):
            return replace(best, early="interrupted", interrupted=True), begin.x
        return optimise(problem, best.x, iterations, _after(report, starts * first)), begin.x


def optimise(
    problem: Problem, start: Array, iterations: int, report: Report | None = None
) -> Outcome:
    """Run SLSQP from one start; never worse than it. Other processes can be asked for this."""
    from scipy.optimize import minimize

    best = Outcome(value_of(problem, start), start)
    history = [best.value]

    def watch(x: Array) -> None:
        nonlocal best
        inside = drawn_inside(problem, x)
        value = value_of(problem, inside)
        if value < best.value:
            best = Outcome(value, inside)
        history.append(best.value)
        if report is not None:
            report(best.value, len(history) - 1)
        if _gain(history) < _STALL:
            raise _StallError

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
    except _StallError:
        return best
    except KeyboardInterrupt:
        return replace(best, early="interrupted", interrupted=True)
    if result.status == 9 and _gain(history) > _STILL_FALLING:
        return replace(best, early=f"after {iterations} iterations it still fell; give more")
    if result.status in (0, 8, 9):  # 8: no descent at a kink, where two singular values meet
        return best
    return replace(best, early=f"SLSQP: {result.message}")


def _finite(value: float, gradient: Array) -> tuple[float, Array]:
    """Return a value that SLSQP goes back from where a trial step tells nothing."""
    return (value, gradient) if np.isfinite(value) else (_HOPELESS, gradient)


def _gain(history: Sequence[float]) -> float:
    """Return what the last iterations gained in the log of the criterion."""
    return history[-_STALL_ITERATIONS] - history[-1] if len(history) > _STALL_ITERATIONS else np.inf


def _map_starts(
    problem: Problem,
    begins: Sequence[Array],
    iterations: int,
    executor: Executor | None,
    report: Report,
) -> list[Outcome]:
    """Optimise from every start, by the executor; an interrupted outcome comes last."""
    outcomes, interrupted = run_all(
        optimise,
        [(problem, x, iterations) for x in begins],
        executor,
        lambda number, outcome: report(outcome.value, number * iterations),
    )
    return [*outcomes, Outcome(np.inf, begins[0], interrupted=True)] if interrupted else outcomes


def _after(report: Report, done: int) -> Report:
    return lambda value, iteration: report(value, done + iteration)
