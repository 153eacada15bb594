"""A second gain set that separates armature and delay: planned by simulating the identified robot.

With the delay T a gain set determines armature + (K_d + F_v) T and viscous friction + K_p T, to
first order; another one has other sums. Each candidate is a gain set and a motion of the commands:
the identified robot follows it in a simulation, with the encoder noise of the log, and both logs
are identified together. What that states is what the second log would add. Errors of the model are
not in a simulation: all errors are multiplied by the residual of the log over the simulated one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, Literal, get_args

import numpy as np
from scipy.signal import chirp

from seaid._arrays import Array, FrozenMapping, seed_of
from seaid._progress import Display, Result, track
from seaid.drives import (
    NORMAL_95,
    STATED_DELAY_S,
    Controller,
    Drive,
    JointParameter,
    stated_delay_s,
)
from seaid.errors import IdentificationError, SeaidError, checked
from seaid.estimation import Estimate
from seaid.identification.command_checks import controlled_position, encoder_noise
from seaid.identification.command_delays import DELAY
from seaid.identification.conditions import identify_conditions
from seaid.identification.identification import Identification, identify
from seaid.log import OF_CONTROLLERS, Log
from seaid.robot import Robot
from seaid.simulation import rollout

Commands = Literal["chirp", "steps"]

GAIN_FACTORS = ((0.5, 1.0), (0.5, 2.0), (1.0, 2.0), (2.0, 1.0))
"""Factors on K_p and K_d that are tried: softer ones first, which are the safer ones."""

_STEP_S = 2.5e-3
"""Longest step [s] of a simulation, as in the refinement of closed loops."""

_CHIRP_HZ, _HOLD_S = (0.2, 3.0), (0.5, 1.0)
"""Frequencies of a chirp, and between what a step lasts."""

_DRAWS = 4
"""Simulated experiments per candidate: the standard errors that one states scatter."""

_SMALLER, _MOST_SHRINKS = 0.7, 6
"""A motion beyond the limits becomes smaller by this factor, so many times at most."""

_TRIAL_S = 4.0
"""Part of a motion that is simulated with the largest delay."""

_UNSTABLE = 2.0
"""Range of the position over that of the command from which a loop counts as unstable."""


@dataclass(frozen=True, eq=False, repr=False)
class GainSet(Display):
    """A second gain set, a motion of the commands, and what they would determine.

    Attributes
    ----------
    controllers : mapping {joint: Controller}
    commands : {"chirp", "steps"}
    log : Log
        The simulated log with the commands to send.
    armature_errors : mapping {joint: float}
        Predicted standard errors of the armature [kg m^2, of a prismatic joint kg], of both logs.
    delay_error_s : float
        Predicted standard error of the delay [s].
    torques : mapping {joint: float}
        Largest torque of each controller in the motion [N m or N].
    """

    controllers: Mapping[str, Controller]
    commands: Commands
    log: Log
    armature_errors: Mapping[str, float]
    delay_error_s: float
    torques: Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class GainSetPlan(Result):
    """The result of `plan_gain_set`.

    Attributes
    ----------
    candidates : tuple of GainSet
        Those within the limits, the best first.
    rejected : tuple of str
        The others, with the reason.
    armature_errors : mapping {joint: float}
        Standard errors of the armature by the first log alone.
    delay_error_s : float
        That of the delay by the first log alone [s].
    model_error : float
        Residual of the first log over that of its simulation, by which all errors are multiplied.
    """

    table_name = "gain_set_table"

    candidates: tuple[GainSet, ...]
    rejected: tuple[str, ...]
    armature_errors: Mapping[str, float]
    delay_error_s: float
    model_error: float

    def to_dict(self) -> dict[str, Any]:
        """Return the predicted errors and the gains as plain data."""
        both = ("armature_errors", "delay_error_s")
        return {
            **{name: getattr(self, name) for name in (*both, "rejected", "model_error")},
            "candidates": [
                {
                    **{name: getattr(one, name) for name in ("commands", *both, "torques")},
                    "controllers": {joint: asdict(law) for joint, law in one.controllers.items()},
                }
                for one in self.candidates
            ],
        }

    def _in_short(self) -> str:
        best = self.candidates[0]
        return (
            f"delay within {1e3 * best.delay_error_s:.3g} ms by the best of "
            f"{len(self.candidates)}, {1e3 * self.delay_error_s:.3g} ms by the first log alone"
        )


@checked(IdentificationError)
def plan_gain_set(
    found: Identification,
    log: Log,
    *,
    gain_factors: Sequence[tuple[float, float]] = GAIN_FACTORS,
    duration_s: float = 10.0,
    seed: int = 0,
    progress: bool = False,
) -> GainSetPlan:
    """Plan a second log of position commands, with other gains, that separates armature and delay.

    Parameters
    ----------
    found : Identification
        That of the first log, of stiff drives with position commands.
    log : Log
        The first log: its range of commands is that of the planned ones, and its encoder noise and
        residual are expected again.
    gain_factors : sequence of (float, float)
        Factors on the position and velocity gains, of all joints, that can be used.
    duration_s : float
        Length of the second log.
    seed : int
        Seed of noise and steps.
    progress : bool
        Show a progress bar.

    Returns
    -------
    GainSetPlan

    Raises
    ------
    IdentificationError
        For other drives, factors that are not positive, and if no candidate keeps the limits of
        position, speed and torque.

    Examples
    --------
    >>> plan = seaid.plan_gain_set(seaid.identify(robot, log), log)
    >>> seaid.write_log(plan.candidates[0].log, "second.csv")
    """
    _check(found.known, gain_factors, duration_s)
    free = _with_drives(found.known, _free)
    true = found.robot
    rng = np.random.default_rng(seed_of(seed))
    places = [(log.joint_names.index(x), true.drives[x].ratio) for x in true.joint_names]
    noise = np.array([encoder_noise(controlled_position(log, *place)) for place in places])
    clean = rollout(true, log, longest_closed_s=_STEP_S)
    alone = [identify(free, _noisy(clean, log, noise, rng)).load_side for _ in range(_DRAWS)]
    simulated = float(np.mean([one.residual_std for one in alone]))
    model_error = max(1.0, identify(free, log).load_side.residual_std / simulated)
    candidates: list[GainSet] = []
    rejected: list[str] = []
    tries = [(kind, pair) for pair in gain_factors for kind in get_args(Commands)]
    for kind, pair in track(tries, "gain sets", progress):
        scaled = partial(_with_gains, factors=pair)
        second = _with_drives(true, scaled)
        name = f"gains x {pair[0]:g} and {pair[1]:g}, {kind}"
        plan = _commands(log, true, kind, duration_s, np.random.default_rng(seed))
        moved, reason = _within_limits(second, plan)
        if moved is None:
            rejected.append(f"{name}: {reason}")
            continue
        robots = free, _with_drives(free, scaled)
        try:
            sides = [_both(robots, (clean, log), moved, noise, rng) for _ in range(_DRAWS)]
        except SeaidError as problem:
            rejected.append(f"{name}: {problem}")
            continue
        laws = {joint: one.controller for joint, one in second.drives.items() if one.controller}
        candidates.append(
            GainSet(
                controllers=FrozenMapping(laws),
                commands=kind,
                log=replace(moved, motor_torque=np.full_like(moved.motor_torque, np.nan)),
                armature_errors=_armature_errors(free, sides, model_error),
                delay_error_s=_delay_error(free, sides, model_error),
                torques=FrozenMapping(_torques(second, moved)),
            )
        )
    if not candidates:
        raise IdentificationError(
            "no second gain set keeps the limits: " + "; ".join(rejected), "gain_factors="
        )
    candidates.sort(key=lambda one: float(np.sum(np.log([*one.armature_errors.values()]))))
    return GainSetPlan(
        candidates=tuple(candidates),
        rejected=tuple(rejected),
        armature_errors=_armature_errors(free, alone, model_error),
        delay_error_s=_delay_error(free, alone, model_error),
        model_error=model_error,
    )


def _both(
    robots: tuple[Robot, Robot],
    first: tuple[Log, Log],
    second: Log,
    noise: Array,
    rng: np.random.Generator,
) -> Estimate:
    """Return the estimate from both logs of one experiment, whose simulations are given."""
    logs = _noisy(*first, noise, rng), _noisy(second, second, noise, rng)
    pairs = zip(("first", "second"), robots, logs, strict=True)
    conditions = {name: (robot, one) for name, robot, one in pairs}
    found = identify_conditions(conditions, condition_specific=())
    return found.identifications["first"].load_side


def _check(robot: Robot, gain_factors: Sequence[tuple[float, float]], duration_s: float) -> None:
    for joint, drive in robot.drives.items():
        if drive.motor_input != "position_command" or drive.is_elastic:
            raise IdentificationError(
                f"a second gain set is planned for stiff drives with position commands; that of "
                f"{joint} is another one: exclude the joint with joints=[...] of load_robot",
                "joints=[...] of load_robot",
            )
    if not duration_s > 1:
        raise IdentificationError(
            f"duration_s must be more than 1, found {duration_s:g}", "duration_s="
        )
    for pair in gain_factors:
        if not all(0 < factor < np.inf for factor in pair):
            raise IdentificationError(
                f"gain_factors must be positive numbers, found {tuple(pair)}", "gain_factors="
            )


def _with_drives(robot: Robot, change: Callable[[Drive], Drive]) -> Robot:
    return robot.with_drives({joint: change(drive) for joint, drive in robot.drives.items()})


def _free(drive: Drive) -> Drive:
    """Return a drive whose armature, friction and delay are unknown."""
    known = tuple(name for name in drive.known if name not in (DELAY, "motor_inertia"))
    bare = replace(drive, known=known).without_nominal()
    return replace(bare, motor_inertia_kg_m2=None, command_delay_s=drive.command_delay_s)


def _with_gains(drive: Drive, factors: tuple[float, float]) -> Drive:
    law = drive.controller
    assert law is not None
    return replace(
        drive,
        controller=replace(
            law,
            position_gain_Nm_per_rad=factors[0] * law.position_gain_Nm_per_rad,
            velocity_gain_Nms_per_rad=factors[1] * law.velocity_gain_Nms_per_rad,
        ),
    )


def _noisy(moved: Log, commands: Log, noise: Array, rng: np.random.Generator) -> Log:
    """Return a simulated log as it would be recorded: positions with noise, and the commands."""
    columns = [commands.joint_names.index(joint) for joint in moved.joint_names]
    unknown = np.full_like(moved.motor_torque, np.nan)
    there = commands.sensors()
    sent: dict[str, Any] = {x: there[x][:, columns] for x in OF_CONTROLLERS if x in there}
    return replace(
        moved,
        joint_position=moved.joint_position + noise * rng.normal(size=moved.joint_position.shape),
        motor_position=unknown,
        motor_torque=unknown,
        **sent,
    )


def _commands(
    log: Log, robot: Robot, kind: Commands, duration_s: float, rng: np.random.Generator
) -> Log:
    """Return commands of the range of a log, as a log without sensors."""
    columns = [log.joint_names.index(joint) for joint in robot.joint_names]
    assert log.position_command is not None
    low, high = np.percentile(log.position_command[:, columns], [1, 99], axis=0)
    period_s = float(log.time[-1] - log.time[0]) / (len(log.time) - 1)
    time = np.arange(0.0, duration_s, period_s)
    shape = np.zeros((len(time), robot.n))
    for j in range(robot.n):
        if kind == "chirp":  # frequencies that differ by up to a quarter between the joints
            start, end = (one * (1 + 0.25 * j / robot.n) for one in _CHIRP_HZ)
            phase = 360 * j / robot.n - 90  # [deg]
            shape[:, j] = chirp(time, start, duration_s, end, method="log", phi=phase)
        else:
            turns = np.cumsum(rng.uniform(*_HOLD_S, size=int(duration_s / _HOLD_S[0]) + 1))
            levels = rng.uniform(0.3, 1.0, len(turns)) * (-1.0) ** np.arange(j, j + len(turns))
            shape[:, j] = levels[np.searchsorted(turns, time)]
    unknown = np.full_like(shape, np.nan)
    return Log(
        time=time,
        joint_names=robot.joint_names,
        joint_position=np.tile(0.5 * (low + high), (len(time), 1)),
        motor_position=unknown,
        motor_torque=unknown,
        position_command=0.5 * (low + high) + 0.5 * (high - low) * shape,
        is_prismatic=robot.is_prismatic,
    )


def _within_limits(robot: Robot, plan: Log) -> tuple[Log | None, str]:
    """Return the simulated motion with its commands, smaller until it keeps all limits.

    None and the reason if it does not; the loop has to be stable at the largest delay, too.
    """
    middle = plan.joint_position[:1]
    assert plan.position_command is not None
    shape, reason = plan.position_command - middle, ""
    late = _with_drives(robot, _latest)
    for shrink in range(_MOST_SHRINKS):
        small = replace(plan, position_command=middle + _SMALLER**shrink * shape)
        start = small.between(0.0, min(_TRIAL_S, float(small.time[-1])))
        for one, commands in ((late, start), (robot, small)):
            try:
                moved = rollout(one, commands, longest_closed_s=_STEP_S)
            except SeaidError:
                return None, "the loop is unstable"
            reason = _beyond(one, moved, commands)
            if reason:
                break
        else:
            return replace(moved, position_command=small.position_command), ""
        if reason == "the loop is unstable":
            break
    return None, reason


def _latest(drive: Drive) -> Drive:
    delay = (drive.command_delay_s or 0.0) + max(stated_delay_s(drive), STATED_DELAY_S)
    return replace(drive, command_delay_s=delay)


def _beyond(robot: Robot, moved: Log, plan: Log) -> str:
    """Return which limit a motion exceeds, "" if none."""
    assert plan.position_command is not None
    q = moved.joint_position
    if not np.all(np.isfinite(q)):
        return "the loop is unstable"
    asked = np.ptp(plan.position_command, axis=0)
    if np.any(np.ptp(q, axis=0) > _UNSTABLE * asked + 1e-3):
        return "the loop is unstable"
    speed = np.max(np.abs(np.gradient(q, plan.time, axis=0)), axis=0)
    pulled = np.array([*_torques(robot, moved).values()])
    limits = np.array([_torque_limit(robot, joint) for joint in robot.joint_names])
    outside = np.any((q < robot.lower_limits) | (q > robot.upper_limits), axis=0)
    for what, wrong in (
        ("position", outside),
        ("speed", speed > robot.velocity_limits),
        ("torque", pulled >= limits),
    ):
        if np.any(wrong):
            joint = robot.joint_names[int(np.flatnonzero(wrong)[0])]
            return f"{joint} exceeds its limit of {what}"
    return ""


def _torques(robot: Robot, moved: Log) -> dict[str, float]:
    ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
    largest = np.max(np.abs(moved.motor_torque * ratio), axis=0)
    return dict(zip(robot.joint_names, largest.tolist(), strict=True))


def _torque_limit(robot: Robot, joint: str) -> float:
    """Return the least of the limits of controller and robot file, inf without one."""
    law, effort = robot.drives[joint].law, float(robot.effort_limits[robot.index(joint)])
    assert law is not None
    return min(law.torque_limit_Nm, effort if effort > 0 else np.inf)


def _error(sides: Sequence[Estimate], name: str) -> float:
    """Return the rms standard error of a parameter in several simulated experiments."""
    errors = [one.standard_errors[one.names.index(name)] for one in sides]
    return float(np.sqrt(np.mean(np.square(errors))))


def _armature_errors(robot: Robot, sides: Sequence[Estimate], factor: float) -> Mapping[str, float]:
    """Return {joint: standard error of the armature}, of joints where it is a parameter."""
    names = {joint: JointParameter("motor_inertia", joint) for joint in robot.joint_names}
    found = {joint: name for joint, name in names.items() if name in sides[0].names}
    scales = {joint: factor * robot.drives[joint].ratio ** 2 for joint in found}
    return FrozenMapping({joint: scales[joint] * _error(sides, found[joint]) for joint in found})


def _delay_error(robot: Robot, sides: Sequence[Estimate], factor: float) -> float:
    """Return the largest standard error of a delay [s]; that of a stated one is its range."""
    errors = [0.0]
    for name in sides[0].names:
        if isinstance(name, JointParameter) and name.parameter == DELAY:
            stated = stated_delay_s(robot.drives[name.joint]) / NORMAL_95
            errors.append(min(factor * _error(sides, name), stated or np.inf))
    return max(errors)
