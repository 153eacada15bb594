"""A motion that keeps the limits on drives and distances, for the search to set out from."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from seaid.arrays import Array
from seaid.errors import ExcitationError
from seaid.excitation.constraints import constraints
from seaid.excitation.drive_limits import DRIVE_KINDS, drive_loads
from seaid.excitation.problem import (
    AIM,
    Problem,
    counted_from,
    curved_use,
    is_curved,
    linear_use,
    most_curved_use,
    states_of,
)
from seaid.excitation.scene import distances

_TRIES, _ITERATIONS, _ENOUGH = 3, 40, 0.9
_SHARPNESS = 32.0
_UNITS = {"joint_torque": "N m (or N)", "motor_torque": "N m", "motor_speed": "rad/s"}


class _FoundError(Exception):
    """The way out of SLSQP once a motion is well within the limits."""


def with_feasible_home(problem: Problem, seed: int) -> Problem:
    """Return the problem counted from a motion that keeps all limits.

    That is its own home, unless a drive or a distance breaks a limit there: then the one that uses
    least of them, by SLSQP within the linear limits from a few starts. Raises ExcitationError,
    naming the joint or the links and the limit, where none is found.
    """
    nothing = np.zeros(np.prod(problem.shape))
    if not is_curved(problem) or most_curved_use(problem, nothing) <= AIM:
        return problem
    rng = np.random.default_rng(seed)
    tried = [nothing]
    for number in range(_TRIES):
        x = nothing
        if number:
            joints = rng.normal(size=problem.shape)
            x = 0.8 * np.ravel(joints / linear_use(problem, joints.ravel())[:, None])
        tried.append(_least_use(problem, x))
        if most_curved_use(problem, tried[-1]) <= AIM:
            return counted_from(problem, tried[-1])
    raise _impossible(problem, min(tried, key=lambda x: most_curved_use(problem, x)))


def _least_use(problem: Problem, start: Array) -> Array:
    """Return the x that SLSQP finds to use least of the limits, pulled inside the linear ones."""
    from scipy.optimize import minimize

    found = start

    def watch(x: Array) -> None:
        nonlocal found
        found = x / max(1.0, float(linear_use(problem, x).max()) * (1 + 1e-6))
        if most_curved_use(problem, found) < _ENOUGH:
            raise _FoundError

    def objective(x: Array) -> tuple[float, Array]:
        use, gradient = curved_use(problem, x)
        shares = np.exp(_SHARPNESS * (use - use.max()))
        value = float(use.max()) + np.log(shares.sum()) / _SHARPNESS
        return value, gradient.T @ (shares / shares.sum())

    with suppress(_FoundError):
        minimize(
            objective,
            start,
            jac=True,
            method="SLSQP",
            constraints=constraints(problem, curved=False),
            options={"maxiter": _ITERATIONS},
            callback=watch,
        )
    return found


def _impossible(problem: Problem, x: Array) -> ExcitationError:
    """Name what breaks its limit most at the best motion found."""
    states, worst, words = states_of(problem, x), 0.0, ""
    if problem.drive_limits is not None:
        limits = problem.drive_limits
        loads = np.abs(drive_loads(limits, problem.time, states)).max(axis=1)
        kind, joint = np.unravel_index(np.argmax(loads / limits.most), loads.shape)
        worst, name = float(loads[kind, joint] / limits.most[kind, joint]), DRIVE_KINDS[kind]
        owner = limits.robot.joint_names[joint]
        unit = _UNITS.get(name, "rad (or m)")
        words = (
            f"keeps joint '{owner}' within its {name.replace('_', ' ')} limit, "
            f"{limits.most[kind, joint]:.4g} {unit}: the best needs {loads[kind, joint]:.4g}. Give "
            f"more by Limits({name}={{'{owner}': ...}}) (math.inf: not limited), a smaller range "
            "or a longer duration"
        )
    if problem.scene is not None:
        far = distances(problem.scene, states[0])
        pair = int(far.min(axis=0).argmin())
        if worst <= 1.0 or far.min() < 0:
            first, second = problem.scene.pairs[pair]
            words = (
                f"keeps '{first}' and '{second}' {problem.scene.clearance_m:.4g} m apart: the best "
                f"has {far.min():.4g} m. Give a smaller clearance, other position limits or boxes"
            )
    return ExcitationError(f"no motion was found that {words}")
