"""refine: maximum likelihood by output error, both sides at once, from an identification on.

The measured motor angles (and the joints without a spring) drive the complete model: behind the
springs the joints are simulated by (8), and their encoders and all torques compared with what was
measured. Motor encoders see the joint through a gear, so what they add of noise is far below the
joint encoders': taking them as the input costs next to nothing, cannot drift, and needs no
controller. Each window of the log has its own initial state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array, FrozenMapping
from seaid.errors import IdentificationError
from seaid.estimation.estimate import Estimate
from seaid.estimation.gauss_newton import Step, gauss_newton_step
from seaid.identification import Identification
from seaid.log import Log
from seaid.logs.holes import stretches
from seaid.motion import SHORTEST_STRETCH
from seaid.output_residuals import Layout, Run, layout_of, linearised, robot_at, run_of
from seaid.progress import track
from seaid.sides.found import joined, with_estimate, with_flags
from seaid.sides.joint_zeros import check_zero_std
from seaid.sides.load_response import Answer
from seaid.sides.method_limits import check_refinable
from seaid.sides.sequential import split_load_side
from seaid.transmission import coupled_names

_SETTLED, _CLOSE = 1e-3, 0.05
_MOST_HALVINGS, _MOST_SWEEPS = 6, 5
_ALIKE = 1e-3
"""Log-likelihoods that differ by less are the same."""


@dataclass(frozen=True, eq=False)
class Point:
    """A point of the iteration: parameters (p,), runs, how their joints answer, the next step."""

    x: Array
    runs: list[Run]
    answers: list[Answer]
    step: Step


def refine(
    found: Identification,
    logs: Log | Sequence[Log],
    *,
    joint_zero_std: float = 0.0,
    iterations: int = 20,
    progress: bool = False,
) -> Identification:
    """Refine an identification to the maximum-likelihood estimate of both sides at once.

    Output error (Gautier, Janot, Vandanjon 2013) by Gauss-Newton with forward sensitivities: the
    joints behind springs are simulated from the measured motor angles; their encoders, and every
    measured torque, are outputs with white noise whose size is estimated too. Rows in which a motor
    stands still or turns back are left out, as its dry friction is unknown. `joint_zero_std` [rad
    or m]: how well the zeros of the joint encoders are known; they are then estimated as well.
    The covariance counts the autocorrelation of the residuals. Rows are averages over blocks of
    samples; `residual_std` is theirs: of a drive's torque (or spring force), and on the load side
    of the stiff joints' torques (where there are none: of the joint encoders).

    Raises IdentificationError where the start is unusable or the iteration does not settle,
    ExcitationError where the logs leave parameters open and LogError where a log does not fit.
    """
    logs = [logs] if isinstance(logs, Log) else list(logs)
    if not logs:
        raise IdentificationError("refine needs a log, found none")
    check_zero_std(joint_zero_std)
    _check_start(found)
    layout = layout_of(found, joint_zero_std)
    shortest_s = SHORTEST_STRETCH / found.cutoff_hz
    runs = [run_of(layout, part) for log in logs for part in stretches(log, shortest_s)]
    start = here = _simulated(layout, _point(layout, runs, layout.start))
    for _ in track(range(iterations), "refining", progress):
        here, better = _improved(layout, here)
        if _size(here.step) < _SETTLED or not better:
            break
    if not _size(here.step) < _CLOSE:
        raise IdentificationError(
            f"the refinement did not settle in {iterations} iterations: its next step would be "
            f"{_size(here.step):.2g} standard errors; do the logs and the identification belong "
            "together?"
        )
    return _refined(layout, here, worse=here.step.merit > start.step.merit + _ALIKE)


def _check_start(found: Identification) -> None:
    coupled = coupled_names(found.known.joint_names, found.known.transmission)
    if coupled:
        raise IdentificationError(
            f"the drives of {', '.join(coupled)} move several joints, which the refinement cannot "
            "simulate; take what identify found, or estimator='iv' or sides='joint' of identify"
        )
    check_refinable(found.known)
    for joint in found.springs:
        stiffness = found.drivetrains[joint].value("stiffness")
        if not (np.isfinite(stiffness) and stiffness > 0):
            raise IdentificationError(
                f"the refinement cannot start: the stiffness of {joint} was found "
                f"{stiffness:.3g}, and a simulation needs one above zero"
            )


def _point(layout: Layout, runs: list[Run], x: Array) -> Point:
    diverges = "the simulation diverges at this estimate: check the identification it starts from"
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            around = [linearised(layout, run, x) for run in runs]
    except IdentificationError as problem:
        raise IdentificationError(f"{diverges}; {problem}") from None
    residuals, answers = [one for one, _ in around], [one for _, one in around]
    if not all(np.all(np.isfinite(one.jacobian)) for one in residuals):
        raise IdentificationError(diverges)
    return Point(x, runs, answers, gauss_newton_step(residuals, layout.names, x, layout.precision))


def _size(step: Step) -> float:
    """Return the largest change of a parameter in standard errors."""
    return float(np.max(np.abs(step.change) / np.sqrt(np.diag(step.white_covariance))))


def _improved(layout: Layout, here: Point) -> tuple[Point, bool]:
    """Return the point one step on, the step halved while it makes things worse; and if it did."""
    part = 1.0
    for _ in range(_MOST_HALVINGS):
        change = part * here.step.change
        there = _simulated(layout, _next(layout, here, change, part, here.step.nuisance))
        if there.step.merit <= here.step.merit + _ALIKE:
            return there, True
        part /= 2
    return here, False


def _simulated(layout: Layout, point: Point) -> Point:
    """Return the point with its joints where they obey (8) at its parameters: Newton's method."""
    for _ in range(_MOST_SWEEPS):
        new = _next(layout, point, np.zeros_like(point.x), 1.0, point.step.own)
        settled = abs(new.step.merit - point.step.merit) < _ALIKE
        point = new
        if settled:
            break
    return point


def _next(layout: Layout, here: Point, change: Array, part: float, own: tuple[Array, ...]) -> Point:
    """Return the point after a change of the parameters and part of one of the initial states."""
    runs = [
        _moved(layout, run, answer, change, part, states)
        for run, answer, states in zip(here.runs, here.answers, own, strict=True)
    ]
    return _point(layout, runs, here.x + change)


def _moved(layout: Layout, run: Run, answer: Answer, change: Array, part: float, own: Array) -> Run:
    """Return a run with its simulated joints where part of a step puts them."""
    known, motion = layout.found.known, run.motion
    joints = [known.index(joint) for joint in layout.simulated]
    step = np.append(part, change)
    states = []
    for state, moves in zip(
        motion.joint_states, (answer.position, answer.velocity, answer.acceleration), strict=True
    ):
        windowed = moves[..., len(step) :].reshape(
            run.windows, len(state) // run.windows, len(joints), own.shape[1]
        )
        free = np.einsum("wtjs,ws->wtj", windowed, part * own).reshape(len(state), len(joints))
        new = state.copy()
        new[:, joints] += moves[..., : len(step)] @ step + free
        states.append(new)
    if layout.precision.any():
        others = [joint for joint in range(known.n) if joint not in joints]
        states[0][:, others] -= change[layout.zeros][others]
    q, v, a = states
    moved = replace(motion, joint_position=q, joint_velocity=v, joint_acceleration=a)
    return replace(run, motion=moved)


def _refined(layout: Layout, here: Point, worse: bool) -> Identification:
    """Return the identification with the values of a point."""
    found, x = layout.found, here.x
    actuators, load_side = _estimates(layout, here, worse)
    load, beside = split_load_side(found.model, load_side)
    refined = joined(actuators, beside)
    drives = {joint: refined[joint] for joint in found.drivetrains}
    robot = robot_at(layout, x)
    known = {
        joint: with_estimate(found.known.drivetrains[joint], drives[joint])
        if joint in drives
        else drive
        for joint, drive in robot.drivetrains.items()
    }
    return replace(
        found,
        drivetrains=FrozenMapping(drives),
        load=load,
        load_side=load_side,
        robot=robot.with_values(robot.parameters, known),
        springs=FrozenMapping({joint: x[layout.spring(joint)] for joint in found.springs}),
    )


def _estimates(layout: Layout, here: Point, worse: bool) -> tuple[dict[str, Estimate], Estimate]:
    """Return the estimates of elastic drives by joint, and of the load side, at a point."""
    found, step = layout.found, here.step
    whole = Estimate(
        names=layout.names,
        values=here.x,
        covariance=step.covariance,
        units=("",) * len(here.x),
        residual_std=float("nan"),
        condition_number=step.condition_number,
    )

    def part(old: Estimate, columns: slice, std: float) -> Estimate:
        new = whole.part(range(columns.start, columns.stop), old.names)
        flags = ("the refinement ended worse than it began",) if worse else ()
        return replace(new, units=old.units, residual_std=std, flags=flags)

    first = len(layout.simulated)
    drives = {
        joint: with_flags(part(found.drivetrains[joint], columns, float(std)), joint, None)
        for (joint, columns), std in zip(layout.drives.items(), step.stds[first:], strict=False)
    }
    rest = step.stds[first + len(layout.drives) :]
    load_std = float(np.sqrt(np.mean((rest if rest.size else step.stds[:first]) ** 2)))
    return drives, part(found.load_side, layout.load, load_std)
