"""Comparison of planning with figaroh 1.0.2: condition number reached over time.

The robot is the UR10, with motions of 10 s and the limits of the URDF. figaroh
(`pip install 'seaid[peers]'`) uses its own motion (a quintic from rest to rest between waypoints),
objective, constraints at 100 Hz and forward differences. Its solver IPOPT needs a separate
installation, so scipy's SLSQP runs in its place. The measure is the same for both: the condition
number of seaid's base columns over 2000 instants. Time is process time of one thread, which is wall
time on an idle core.
"""

from __future__ import annotations

import argparse
import importlib.util
import logging
import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import seaid
from seaid._arrays import Array
from seaid.excitation.criteria import pivoted_base
from seaid.excitation.limits import joint_limits
from seaid.regressor import joint_torques, rigid_body_regressor
from seaid.report import table

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.example_robots import example_urdf

DURATION_S, RATE_HZ = 10.0, 1000
ITERATIONS = (1, 2, 4, 8, 16, 32, 64, 150)
WAYPOINTS, GROUP = (6, 11), 10
KEPT = 1e-3
"""An iterate counts if it violates no limit by more than this fraction of the limit."""

PLOT = Path(__file__).resolve().parents[2] / "docs" / "excitation_peer.png"
States = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Trace:
    """Iterates of one method: process seconds, condition numbers and largest violations."""

    name: str
    seconds: list[float]
    conditions: list[float]
    breaches: list[tuple[float, ...]]

    def reached(self) -> Array:
        """Return the best condition number so far of motions that keep the limits."""
        kept = [max(breach) <= KEPT for breach in self.breaches]
        return np.minimum.accumulate(np.where(kept, self.conditions, np.inf))


class Measure:
    """The measure for both: condition number, and violations relative to the limits."""

    def __init__(self) -> None:
        self.robot = seaid.load_robot(example_urdf("ur10_robot.urdf"))
        self.base = pivoted_base(self.robot, None)
        self.limits = joint_limits(self.robot)

    def condition(self, states: States) -> float:
        """Return the raw condition number of the base columns."""
        some = tuple(state[:: len(state) // 2000] for state in states)
        Y = self.base.reduce(rigid_body_regressor(self.robot, *some))
        return float(np.linalg.cond(Y.reshape(-1, len(self.base.columns))))

    def breach(self, states: States) -> tuple[float, ...]:
        """Return the relative violations of position, velocity, acceleration and torque."""
        q, v, a = states
        torque = joint_torques(self.robot, q, v, a) / self.robot.effort_limits
        shares = (
            (q - self.limits.middle) / self.limits.half_range,
            v / self.limits.velocity,
            a / self.limits.acceleration,
            torque,
        )
        return tuple(float(np.max(np.abs(share))) - 1.0 for share in shares)


def seaid_trace(measure: Measure, seed: int) -> Trace:
    """Return a complete call with each number of iterations."""
    name = f"seaid, B-spline, seed {seed}"
    trace = Trace(name, [], [], [])
    time_s = np.linspace(0.0, DURATION_S, int(DURATION_S * RATE_HZ) + 1)
    for iterations in (1, *ITERATIONS):  # the first call does the imports
        begin = time.process_time()
        with ThreadPoolExecutor(1) as executor:
            plan = seaid.design_excitation(
                measure.robot, DURATION_S, iterations=iterations, seed=seed, executor=executor
            )
        trace.seconds.append(time.process_time() - begin)
        states = plan.trajectory.sample(time_s)
        trace.conditions.append(measure.condition(states))
        trace.breaches.append(measure.breach(states))
    return Trace(name, trace.seconds[1:], trace.conditions[1:], trace.breaches[1:])


class _OutOfBudgetError(Exception):
    """Raised to leave SLSQP at the end of its time."""


def peer_trace(measure: Measure, waypoints: int, seed: int, budget: float) -> Trace:
    """Return every iterate of SLSQP on figaroh's problem within a budget of process seconds."""
    from scipy.optimize import minimize

    np.random.seed(seed)  # noqa: NPY002 - the peer draws from it
    begin = time.process_time()
    problem, start = peer_problem(waypoints)
    low, high = (np.array(bound) for bound in problem.get_constraint_bounds())
    found = [(time.process_time() - begin, start)]

    def watch(x: Array) -> None:
        found.append((time.process_time() - begin, x.copy()))

    def objective(x: Array) -> float:
        if time.process_time() - begin > budget:
            raise _OutOfBudgetError
        return float(problem.objective(x))

    def gradient(x: Array) -> Array:
        return np.asarray(problem.gradient(x))

    groups = sample_groups(waypoints, problem.Ns, problem.n_joints)

    def least(x: Array) -> tuple[Array, Array]:
        values = problem.constraints(x)
        slack = np.concatenate([values - low, high - values])
        picked = groups[np.arange(len(groups)), slack[groups].argmin(axis=1)]
        return slack[picked], picked

    def slope(x: Array) -> Array:
        jacobian = problem.jacobian(x)
        return np.asarray(np.concatenate([jacobian, -jacobian])[least(x)[1]])

    ended = "out of time"
    try:
        result = minimize(
            objective,
            start,
            jac=gradient,
            method="SLSQP",
            bounds=list(zip(*problem.get_variable_bounds(), strict=True)),
            constraints=[{"type": "ineq", "fun": lambda x: least(x)[0], "jac": slope}],
            options={"maxiter": 10_000, "ftol": 1e-6},
            callback=watch,
        )
        ended = result.message
    except _OutOfBudgetError:
        pass
    print(f"figaroh, {waypoints} waypoints, seed {seed}: {len(found) - 1} iterations, {ended}")
    states = [problem.states(x) for _, x in found]
    return Trace(
        f"figaroh with SLSQP, {waypoints} waypoints, seed {seed}",
        [seconds for seconds, _ in found],
        [measure.condition(each) for each in states],
        [measure.breach(each) for each in states],
    )


def sample_groups(waypoints: int, samples: int, n: int) -> Array:
    """Return the groups of constraints that count as their worst (G, 10), of ten instants each.

    With all 24 000 constraints, as given to IPOPT, SLSQP would spend most of its time on them.
    """
    instants = np.minimum(np.arange(-(-samples // GROUP) * GROUP), samples - 1)
    at_waypoints = np.repeat(np.arange((waypoints - 1) * n)[:, None], GROUP, axis=1)
    parts = [at_waypoints]
    for kind in range(2):
        first = (waypoints - 1) * n + kind * samples * n
        rows = first + instants[:, None] * n + np.arange(n)
        parts.append(rows.reshape(-1, GROUP, n).transpose(0, 2, 1).reshape(-1, GROUP))
    one_side = np.concatenate(parts)
    return np.concatenate([one_side, one_side + (waypoints - 1 + 2 * samples) * n])


def peer_problem(waypoints: int) -> tuple[Any, Array]:
    """Return figaroh's problem and its own random start, drawn within the velocity limits.

    figaroh draws steps between waypoints for the peak speed of a cubic. Its motion is a quintic,
    which is faster, so its own start would violate the limits. The steps drawn here are smaller.
    """
    import pinocchio as pin

    peer = importlib.import_module("figaroh.optimal.base_optimal_trajectory")
    model = pin.buildModelFromUrdf(str(example_urdf("ur10_robot.urdf")))
    robot = pin.RobotWrapper(model)
    robot.q0, robot.v0 = pin.neutral(model), np.zeros(model.nv)
    n, interval = model.nv, DURATION_S / (waypoints - 1)

    class Planner(peer.BaseOptimalTrajectory):  # type: ignore[misc, name-defined]
        def __init__(self) -> None:
            self.robot, self.model = robot, model
            self.active_joints = list(model.names[1:])
            self.logger = logging.getLogger(__name__)
            names = ("n_wps", "freq", "t_s", "soft_lim", "max_attempts")
            values = (waypoints, 100, interval, 0.0, 1000)
            self.trajectory_config = dict(zip(names, values, strict=True))
            self.identif_config = {"act_idxv": list(range(n)), "robot_name": "ur10"}

        def create_ipopt_problem(self, *_: Any) -> None:
            raise NotImplementedError

        def _limit_waypoint_steps(self, wps: Array) -> Array:
            most = 0.9 * 8 / 15 * interval * self.CB.upper_dq
            for k in range(1, wps.shape[1]):
                wps[:, k] = wps[:, k - 1] + np.clip(wps[:, k] - wps[:, k - 1], -most, most)
            return wps

    class Problem(peer.BaseTrajectoryIPOPTProblem):  # type: ignore[misc, name-defined]
        def states(self, x: Array) -> States:
            """Return the motion, at ten times its own rate."""
            inner = np.reshape(x, (waypoints - 1, n))
            points = np.vstack([self.wp_init, inner]).T
            config = planner.CB.get_full_config(
                RATE_HZ, self.tps, points, self.vel_wps, self.acc_wps
            )
            return config[1], config[2], config[3]

    planner = Planner()
    planner.initialize()
    planner.WP.gen_rand_pool(planner.soft_lim_pool)
    rest = np.zeros(n)
    first = np.array([np.random.choice(pool) for pool in planner.WP.pool_q.T])  # noqa: NPY002
    points, v, a, times, *samples = planner._generate_feasible_initial_guess(first, rest, rest)
    problem = Problem(planner, n, waypoints, len(samples[0]), times, v, a, first, rest, rest, None)
    problem._initial_wps = points
    return problem, np.array(problem.get_initial_guess())


def save_plot(traces: list[Trace], path: Path) -> None:
    """Draw the condition number reached over time."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FixedLocator, NullLocator

    figure = Figure(figsize=(7.5, 4.6), layout="constrained")
    axes = figure.subplots()
    styles = {"seaid": ("black", "o"), "6": ("tab:red", "s"), "11": ("tab:orange", "^")}
    for trace in traces:
        ours = trace.name.startswith("seaid")
        colour, marker = styles["seaid" if ours else trace.name.split()[3]]
        label, _, seed = trace.name.rpartition(", seed ")
        axes.step(
            trace.seconds,
            trace.reached(),
            where="post",
            color=colour,
            marker=marker,
            markersize=3.5,
            linewidth=1.2,
            label=label if seed == "0" else "_",
        )
    axes.set(xscale="log", yscale="log", xlabel="process time, one thread [s]")
    axes.set_ylabel("condition number of the motion")
    axes.set_title(f"UR10, {DURATION_S:g} s, 36 base columns, same limits", fontsize=11, loc="left")
    axes.yaxis.set_major_locator(FixedLocator([5, 10, 20, 50, 100]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.grid(color="0.9", which="both")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    figure.savefig(path, dpi=130)


def row(trace: Trace) -> list[str]:
    """Return the table line of one method: first and best motion, and the violations."""
    reached = trace.reached()
    best = int(np.argmin(reached))
    last = f"{reached[best]:.1f}" if np.isfinite(reached[best]) else "none keeps the limits"
    shown = [f"{part:+.1e}" for part in trace.breaches[best]]
    return [
        trace.name,
        f"{trace.conditions[0]:.0f}",
        last,
        f"{trace.seconds[best]:.0f} s",
        f"{trace.conditions[-1]:.1f}",
        *shown,
    ]


def main() -> None:
    """Run both, print the table and draw the plot."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--budget", type=float, default=120.0, help="process seconds of the peer")
    parser.add_argument("--seeds", type=int, default=2, help="of each method")
    parser.add_argument("--plot", type=Path, default=PLOT, help="figure to write")
    arguments = parser.parse_args()
    if not importlib.util.find_spec("figaroh"):
        print("skipped: no figaroh here; pip install 'seaid[peers]'")
        return
    begin = time.perf_counter()
    warnings.simplefilter("ignore")
    logging.disable()
    measure, seeds = Measure(), range(arguments.seeds)
    traces = [seaid_trace(measure, seed) for seed in seeds]
    traces += [
        peer_trace(measure, waypoints, seed, arguments.budget)
        for waypoints in WAYPOINTS
        for seed in seeds
    ]
    header = ["method", "first", "best that keeps limits", "after", "last", "position"]
    title = f"UR10, {DURATION_S:g} s; relative violations of the best motion at {RATE_HZ} Hz"
    rows = [row(trace) for trace in traces]
    print(table(title, [*header, "velocity", "acceleration", "torque"], rows))
    save_plot(traces, arguments.plot)
    print(f"{time.perf_counter() - begin:.0f} s. Plot: {arguments.plot}")


if __name__ == "__main__":
    main()
