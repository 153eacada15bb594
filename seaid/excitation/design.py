"""design_excitation: the motion within limits that tells the parameters best, (17)-(19)."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from seaid.arrays import Array
from seaid.base import BaseParameters
from seaid.errors import ExcitationError, SeaidWarning
from seaid.excitation.basis import SplineBasis, make_basis
from seaid.excitation.criterion import (
    Criterion,
    condition_number,
    log_condition,
    make_criterion,
    pivoted_base,
)
from seaid.excitation.limits import (
    JointLimits,
    Limits,
    Margins,
    joint_limits,
    margins,
    scaled_rows,
)
from seaid.excitation.trajectory import Trajectory
from seaid.robot import Robot

_DEFAULT_COEFFICIENTS = {"bspline": 18, "polynomial": 14}
_PIECES = {"bspline": 4, "polynomial": 60}
_REPORT_SAMPLES = 2000
_STALL_ITERATIONS, _STALL = 25, 2e-3

Report = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Excitation:
    """A planned motion: `condition_number` (16) is raw, of the columns of `base`, over 2000
    samples; `margins` are the least distances to the limits over the whole motion.
    """

    trajectory: Trajectory
    condition_number: float
    base: BaseParameters
    margins: Margins


@dataclass(frozen=True, eq=False)
class _Problem:
    """Minimise log kappa over x (n k,), with |rows[j] x_j| <= 1; every array a joint in a row.

    Position is middle + half_range * (P x), P the first of `maps` (T, k) and so on.
    """

    criterion: Criterion
    limits: JointLimits
    maps: tuple[Array, Array, Array]
    rows: Array

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows.shape[0], self.rows.shape[2]


@dataclass(frozen=True, eq=False)
class _Outcome:
    """Where one start ended: log kappa and x, feasible; `early` says why it stopped early."""

    value: float
    x: Array
    early: str
    interrupted: bool = False


class _Stop(Exception):  # noqa: N818  # no error: the way out of SLSQP
    pass


def design_excitation(
    robot: Robot,
    duration: float,
    *,
    basis: str = "bspline",
    coefficients: int | None = None,
    limits: Limits | None = None,
    rest_to_rest: bool = True,
    rows: Sequence[str] | None = None,
    starts: int = 4,
    iterations: int = 100,
    seed: int = 0,
    samples: int | None = None,
    progress: bool = False,
    executor: Executor | None = None,
) -> Excitation:
    """Plan a motion of `duration` [s] that tells the rigid-body parameters of the robot well.

    Minimises the log of the condition number (16) of the stacked base regressor (15) over the
    coefficients of a "bspline" or "polynomial" basis, `coefficients` of them a joint, from several
    random `starts`, each of at most so many `iterations` of SLSQP (Kraft 1988) with the exact
    gradient. The `limits` (default: the robot's, see `Limits`) hold at every instant, not only at
    the `samples` that the criterion looks at. `rest_to_rest`: zero velocity and acceleration at
    both ends. `rows` names the joints whose torques are known (default all).

    The same seed gives the same motion, with any `executor` (concurrent.futures) to map the starts
    over. `progress` shows a bar on stderr. Ctrl-C ends the search and gives the best motion so far;
    a search that ends early says so in a SeaidWarning. Raises ExcitationError for a duration,
    coefficients, limits or rows that cannot be planned with.
    """
    function = make_basis(
        basis,
        duration,
        _DEFAULT_COEFFICIENTS.get(basis, 0) if coefficients is None else coefficients,
        rest_to_rest=rest_to_rest,
    )
    for name, count in (("starts", starts), ("iterations", iterations)):
        if count < 1:
            raise ExcitationError(f"{name} must be at least 1, found {count}")
    bounds = joint_limits(robot, limits)
    base = pivoted_base(robot, rows)
    criterion = make_criterion(robot, rows, base)
    free = function.free_coefficients(rest_to_rest=rest_to_rest)
    count = _sample_count(criterion, function, samples)
    problem = _Problem(
        criterion,
        bounds,
        _maps(function, free, count),
        scaled_rows(function, free, bounds, _PIECES[basis]),
    )
    best = _search(problem, starts, iterations, seed, executor, progress)
    if best.early:
        warnings.warn(
            f"the search for an excitation ended early: {best.early}; the motion keeps all limits, "
            f"its condition number is {np.exp(best.value):.4g}",
            SeaidWarning,
            stacklevel=2,
        )
    x = best.x.reshape(problem.shape)
    trajectory = Trajectory(
        robot.joint_names,
        function,
        bounds.middle + bounds.half_range * (free @ x.T),
        tuple(np.array(robot.joint_names)[list(robot.is_prismatic)].tolist()),
    )
    time = np.linspace(0.0, duration, max(_REPORT_SAMPLES, count))
    kappa = condition_number(criterion, *trajectory.sample(time))
    return Excitation(trajectory, kappa, base, margins(trajectory, bounds))


def _sample_count(criterion: Criterion, function: SplineBasis, samples: int | None) -> int:
    """Return how many instants the criterion looks at: ten a coefficient unless given."""
    needed = -(-len(criterion.columns) // len(criterion.rows))
    if samples is None:
        return max(200, 10 * function.size, 4 * needed)
    if samples < needed:
        raise ExcitationError(
            f"{samples} samples of {len(criterion.rows)} torques cannot tell "
            f"{len(criterion.columns)} base parameters; give at least {needed}"
        )
    return int(samples)


def _maps(function: SplineBasis, free: Array, samples: int) -> tuple[Array, Array, Array]:
    time = np.linspace(0.0, function.duration, samples)
    position, velocity, acceleration = (matrix @ free for matrix in function.matrices(time))
    return position, velocity, acceleration


def _search(
    problem: _Problem,
    starts: int,
    iterations: int,
    seed: int,
    executor: Executor | None,
    progress: bool,
) -> _Outcome:
    """Run all starts, here or by the executor, and return the best; ties go to the first."""
    seeds = np.random.SeedSequence(seed).spawn(starts)
    outcomes: list[_Outcome] = []
    with _shown(progress, starts) as (report, advance):
        try:
            found: Iterator[_Outcome]
            if executor is None:
                found = (_run_start(problem, one, iterations, report) for one in seeds)
            else:
                found = iter(
                    executor.map(_run_start, [problem] * starts, seeds, [iterations] * starts)
                )
            for outcome in found:
                outcomes.append(outcome)
                advance(outcome.value)
                if outcome.interrupted:
                    break
        except KeyboardInterrupt:
            if not outcomes:
                raise
            outcomes.append(_Outcome(np.inf, outcomes[0].x, "", interrupted=True))
    best = min(outcomes, key=lambda outcome: outcome.value)
    if outcomes[-1].interrupted:
        best = _Outcome(best.value, best.x, f"interrupted in start {len(outcomes)} of {starts}")
    return best


def _run_start(
    problem: _Problem,
    seed: np.random.SeedSequence,
    iterations: int,
    report: Report | None = None,
) -> _Outcome:
    """Optimise from one random start; at module level so that other processes can be asked."""
    from scipy.optimize import minimize

    best = _Outcome(np.inf, np.zeros(np.prod(problem.shape)), "")
    history: list[float] = []
    G = _block_diagonal(problem.rows)
    both = np.concatenate([-G, G])

    def value_and_gradient(x: Array) -> tuple[float, Array]:
        value, gradient = _log_condition(problem, x)
        nonlocal best
        if value < best.value:
            inside = _inside(problem, x)
            feasible = value if inside is x else _log_condition(problem, inside)[0]
            if feasible < best.value:
                best = _Outcome(feasible, inside, "")
        return value, gradient

    def watch(_x: Array) -> None:
        history.append(best.value)
        if report is not None:
            report(best.value)
        if len(history) > _STALL_ITERATIONS and history[-_STALL_ITERATIONS] - best.value < _STALL:
            raise _Stop

    early = ""
    try:
        result = minimize(
            value_and_gradient,
            _random_start(problem, np.random.default_rng(seed)),
            jac=True,
            method="SLSQP",
            constraints={"type": "ineq", "fun": lambda x: 1.0 + both @ x, "jac": lambda x: both},
            options={"maxiter": iterations, "ftol": 1e-9},
            callback=watch,
        )
        if result.status not in (0, 8):  # 8: no descent at a kink, where two singular values meet
            early = f"SLSQP: {result.message} ({result.nit} iterations)"
    except _Stop:
        pass
    except KeyboardInterrupt:
        if not np.isfinite(best.value):
            raise
        return _Outcome(best.value, best.x, "interrupted", interrupted=True)
    return _Outcome(best.value, best.x, early)


def _log_condition(problem: _Problem, x: Array) -> tuple[float, Array]:
    limits = problem.limits
    states = [limits.half_range * (matrix @ x.reshape(problem.shape).T) for matrix in problem.maps]
    states[0] += limits.middle
    value, gradients = log_condition(problem.criterion, states[0], states[1], states[2])
    by_x = sum(matrix.T @ part for matrix, part in zip(problem.maps, gradients, strict=True))
    return value, np.ravel((limits.half_range * by_x).T)


def _usage(problem: _Problem, x: Array) -> Array:
    """Return how much of its limits each joint uses (n,): 1 is all."""
    return np.asarray(np.abs(np.einsum("jck,jk->jc", problem.rows, x)).max(axis=1))


def _inside(problem: _Problem, x: Array) -> Array:
    """Return x, or x drawn towards the joints' middles where a limit is broken."""
    joints = x.reshape(problem.shape)
    usage = _usage(problem, joints)
    if usage.max() <= 1.0:
        return x
    return np.ravel(joints / np.maximum(usage, 1.0)[:, None])


def _random_start(problem: _Problem, rng: np.random.Generator) -> Array:
    """Return a random feasible x: each joint uses 60 to 95 percent of its limits."""
    joints = rng.normal(size=problem.shape)
    share = rng.uniform(0.6, 0.95, problem.shape[0])
    return np.ravel(joints * (share / _usage(problem, joints))[:, None])


def _block_diagonal(rows: Array) -> Array:
    n, count, k = rows.shape
    blocks = np.zeros((n, count, n, k))
    for joint in range(n):
        blocks[joint, :, joint] = rows[joint]
    return blocks.reshape(n * count, n * k)


@contextmanager
def _shown(progress: bool, starts: int) -> Iterator[tuple[Report | None, Report]]:
    """Give two functions: one to report a value, one to report a value and the end of a start."""
    if not progress:
        yield None, lambda value: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("excitation", total=starts)
        best = np.inf

        def report(value: float, *, advance: int = 0) -> None:
            nonlocal best
            best = min(best, value)
            text = f"excitation: condition number {np.exp(best):.4g}"
            bar.update(task, advance=advance, description=text)

        yield report, lambda value: report(value, advance=1)
