"""The search behind design_excitation: SLSQP on log kappa with limits at every instant.

SLSQP (Kraft 1988) because it takes linear inequalities, keeps to them at every step, needs first
derivatives alone, and comes with scipy. Its cost grows with the number of inequalities, so each
group of limit rows counts as one, its largest: a maximum of linear functions has the same feasible
set, and its gradient is the row that is largest. The objective is log kappa made smooth over the
four largest and four smallest singular values, for SLSQP stalls at the kinks of log kappa itself;
which motion is the best is judged by kappa.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array
from seaid.errors import ExcitationError
from seaid.excitation.criterion import Criterion, condition_number, log_condition
from seaid.excitation.limits import JointLimits

_NEIGHBOURS = 4
_STALL_ITERATIONS, _STALL, _STILL_FALLING = 25, 2e-3, 5e-2
_PATIENCE_SECONDS, _HOPELESS = 5.0, 100.0

Report = Callable[[float, int], None]


@dataclass(frozen=True, eq=False)
class Problem:
    """Minimise log kappa over x (n k,), with |rows[j] x_j| <= 1 for every joint j.

    Position is middle + half range times (P x_j), P (T, k) the first of `maps`; the others give
    velocity and acceleration. `rows` (n, g, c, k) are those of `limit_rows`.
    """

    criterion: Criterion
    limits: JointLimits
    maps: tuple[Array, Array, Array]
    rows: Array

    @property
    def shape(self) -> tuple[int, int]:
        """Number of joints and of free variables a joint."""
        return self.rows.shape[0], self.rows.shape[3]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where a search ended: log kappa and x within limits; `early` says why it ended early."""

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
) -> Outcome:
    """Search from random starts, a third of the iterations each, then on from the best of them.

    Ties go to the first start, so the result does not depend on who computes it, nor in which
    order. Raises ExcitationError where no start tells all parameters.
    """
    seeds = np.random.SeedSequence(seed).spawn(starts)
    begins = [random_start(problem, np.random.default_rng(one)) for one in seeds]
    values = [_value(problem, x) for x in begins]
    if not np.any(np.isfinite(values)):
        raise ExcitationError(
            f"no motion of this kind tells all {len(problem.criterion.columns)} base parameters: "
            "condition number infinite; give more coefficients, more samples or wider limits"
        )
    first = -(-iterations // 3) if starts > 1 else 0
    with _bar(progress, starts * first + iterations) as report:
        outcomes = [Outcome(value, x) for value, x in zip(values, begins, strict=True)]
        if first:
            outcomes += _map_starts(problem, begins, first, executor, report)
        best = min(outcomes, key=lambda outcome: outcome.value)
        if any(outcome.interrupted for outcome in outcomes):
            return replace(best, early="interrupted", interrupted=True)
        return optimise(problem, best.x, iterations, _after(report, starts * first))


def optimise(
    problem: Problem, start: Array, iterations: int, report: Report | None = None
) -> Outcome:
    """Run SLSQP from one start; never worse than it. Other processes can be asked for this."""
    from scipy.optimize import minimize

    best = Outcome(_value(problem, start), start)
    history = [best.value]

    def watch(x: Array) -> None:
        nonlocal best
        inside = drawn_inside(problem, x)
        value = _value(problem, inside)
        if value < best.value:
            best = Outcome(value, inside)
        history.append(best.value)
        if report is not None:
            report(best.value, len(history) - 1)
        if _gain(history) < _STALL:
            raise _StallError

    try:
        result = minimize(
            lambda x: _value_and_gradient(problem, x),
            start,
            jac=True,
            method="SLSQP",
            constraints={
                "type": "ineq",
                "fun": lambda x: _slack(problem, x)[0],
                "jac": lambda x: _slack_gradient(problem, x),
            },
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


def random_start(problem: Problem, rng: np.random.Generator) -> Array:
    """Return a random x within limits: each joint uses 60 to 95 percent of them."""
    joints = rng.normal(size=problem.shape)
    share = rng.uniform(0.6, 0.95, problem.shape[0])
    return np.ravel(joints * (share / _usage(problem, joints))[:, None])


def drawn_inside(problem: Problem, x: Array) -> Array:
    """Return x, each joint that breaks a limit drawn towards its middle until it does not."""
    joints = x.reshape(problem.shape)
    return np.ravel(joints / np.maximum(_usage(problem, joints), 1.0)[:, None])


def _gain(history: Sequence[float]) -> float:
    """Return what the last iterations gained in log kappa."""
    return history[-_STALL_ITERATIONS] - history[-1] if len(history) > _STALL_ITERATIONS else np.inf


def _states(problem: Problem, x: Array) -> tuple[Array, Array, Array]:
    joints, limits = x.reshape(problem.shape).T, problem.limits
    q, v, a = (limits.half_range * (matrix @ joints) for matrix in problem.maps)
    return limits.middle + q, v, a


def _value(problem: Problem, x: Array) -> float:
    return float(np.log(condition_number(problem.criterion, *_states(problem, x))))


def _value_and_gradient(problem: Problem, x: Array) -> tuple[float, Array]:
    try:
        value, gradients = log_condition(
            problem.criterion, *_states(problem, x), neighbours=_NEIGHBOURS
        )
    except ExcitationError:  # a trial step too far: SLSQP goes back from so high a value
        return _HOPELESS, np.zeros(x.size)
    by_joint = [matrix.T @ part for matrix, part in zip(problem.maps, gradients, strict=True)]
    return value, np.ravel((problem.limits.half_range * np.sum(by_joint, axis=0)).T)


def _usage(problem: Problem, joints: Array) -> Array:
    """Return how much of its limits each joint uses (n,): 1 is all."""
    used = np.einsum("jgck,jk->jgc", problem.rows, joints)
    return np.asarray(np.abs(used).max(axis=(1, 2)))


def _slack(problem: Problem, x: Array) -> tuple[Array, Array, Array]:
    """Return what each group leaves above and below (2 n g,), and the rows that decide (n, g)."""
    used = np.einsum("jgck,jk->jgc", problem.rows, x.reshape(problem.shape))
    slack = np.concatenate([1.0 - used.max(axis=2).ravel(), 1.0 + used.min(axis=2).ravel()])
    return slack, used.argmax(axis=2), used.argmin(axis=2)


def _slack_gradient(problem: Problem, x: Array) -> Array:
    """Return the derivative (2 n g, n k) of the slack."""
    _, highest, lowest = _slack(problem, x)
    (n, k), groups = problem.shape, highest.shape[1]
    gradient = np.zeros((2, n, groups, n, k))
    for joint in range(n):
        order = np.arange(groups)
        gradient[0, joint, :, joint] = -problem.rows[joint, order, highest[joint]]
        gradient[1, joint, :, joint] = problem.rows[joint, order, lowest[joint]]
    return gradient.reshape(2 * n * groups, n * k)


def _map_starts(
    problem: Problem,
    begins: Sequence[Array],
    iterations: int,
    executor: Executor | None,
    report: Report,
) -> list[Outcome]:
    """Optimise from every start, here or by the executor; an interrupted outcome comes last."""
    outcomes: list[Outcome] = []
    if executor is None:
        for number, x in enumerate(begins):
            outcomes.append(optimise(problem, x, iterations, _after(report, number * iterations)))
            if outcomes[-1].interrupted:
                break
        return outcomes
    futures = [executor.submit(optimise, problem, x, iterations) for x in begins]
    try:
        for number, future in enumerate(futures, 1):
            outcomes.append(future.result())
            report(outcomes[-1].value, number * iterations)
    except KeyboardInterrupt:
        outcomes += _finished(futures[len(outcomes) :])
        outcomes.append(Outcome(np.inf, begins[0], interrupted=True))
    return outcomes


def _finished(futures: Sequence[Future[Outcome]]) -> list[Outcome]:
    """Return what the workers, interrupted as well, still hand in."""
    found = []
    for future in futures:
        future.cancel()
    for future in futures:
        with suppress(CancelledError, TimeoutError, BrokenExecutor, KeyboardInterrupt):
            found.append(future.result(timeout=_PATIENCE_SECONDS))
    return found


def _after(report: Report, done: int) -> Report:
    return lambda value, iteration: report(value, done + iteration)


@contextmanager
def _bar(progress: bool, total: int) -> Iterator[Report]:
    """Give a function that shows a log kappa and the number of iterations done on stderr."""
    if not progress:
        yield lambda value, iteration: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("excitation", total=total)
        best = np.inf

        def report(value: float, iteration: int) -> None:
            nonlocal best
            best = min(best, value)
            text = f"excitation: condition number {np.exp(best):.4g}"
            bar.update(task, completed=iteration, description=text)

        yield report
        bar.update(task, completed=total)
