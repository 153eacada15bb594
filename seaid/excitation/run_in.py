"""Ways from rest into a motion whose ends are free, and out of it to rest.

Motions that can be run into from rest, and out of to rest, within limits.

A free end may be anywhere, at the end of the range at full speed as well, where nothing stops a
robot in time. So each end that moves gets a way to rest that hangs on it linearly: the one with the
least mean square acceleration. Its limits are linear in the motion's own coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seaid._arrays import Array, safely
from seaid.errors import ExcitationError
from seaid.excitation.basis import Basis, JoinedBasis, make_basis
from seaid.excitation.boundary import (
    SAME,
    EndState,
    MotionSpace,
    end_conditions,
    motion_space,
    solutions,
    with_room,
)
from seaid.excitation.fourier import FourierBasis
from seaid.excitation.limits import JointLimits, Limits, joint_limits
from seaid.excitation.spline import SplineBasis
from seaid.excitation.trajectory import Trajectory
from seaid.robot import Robot

_COEFFICIENTS = 12


def with_run_in(space: MotionSpace, joint_names: Sequence[str], limits: JointLimits) -> MotionSpace:
    """Return the space, kept to motions that can be run into from rest and out of to rest.

    `limit_rows` of what is returned has the limits of the ways too, so `add_run_in` will find one.
    Ends at rest need none. Raises ExcitationError, naming joint and limit, where given ends leave
    no way.
    """
    tables = space.basis.matrices(np.array([0.0, space.basis.duration]))
    ways = []
    for which in range(2):
        state = np.array([table[which] for table in tables])
        speed = state[1:] @ np.column_stack([space.free, space.home])
        whole = np.linalg.norm(state[1:] @ space.basis.natural, axis=1, keepdims=True)
        if np.any(np.abs(speed) > SAME * whole):
            ways.append(_way(state, way_duration(limits), out=bool(which)))
    found = replace(space, ways=tuple(ways))
    middle = np.outer(space.basis.constant, limits.middle)
    moved = np.any(np.abs(space.home - middle) > SAME * limits.half_range, axis=0)
    return with_room(found, joint_names, limits, moved)


def way_duration(limits: JointLimits) -> float:
    """Return how long a way lasts [s]: twice what the slowest joint needs to stop."""
    stopping = np.minimum(
        limits.velocity / limits.acceleration, np.sqrt(limits.half_range / limits.acceleration)
    )
    return 2.0 * float(stopping.max())


def way_basis(duration: float) -> SplineBasis:
    """Return the splines that ways are made of."""
    basis = make_basis("bspline", duration, _COEFFICIENTS)
    assert isinstance(basis, SplineBasis)
    return basis


def _way(state: Array, duration: float, *, out: bool) -> tuple[Basis, Array]:
    """Return the basis of a way and its coefficients (L, K) for position, velocity, ... (3, K)."""
    basis = way_basis(duration)
    names = [str(column) for column in range(state.shape[1])]
    moving, rest = EndState(*state), EndState()
    asked = end_conditions(basis, names, *((moving, rest) if out else (rest, moving)))
    free, back = solutions(basis, asked)
    time = np.linspace(0.0, duration, 8 * basis.size)
    acceleration = basis.matrices(time)[2] * duration**2
    some = back @ (asked.values / asked.sizes[:, None])
    least = safely(
        np.linalg.lstsq,
        acceleration @ free,
        -acceleration @ some,
        what="the way to the start of a motion",
        error=ExcitationError,
        rcond=None,
    )[0]
    return basis, some + free @ least


_SHARE = 0.9
"""How much of each limit a run-in uses, unless the motion itself begins or ends with more."""
_GROWTH, _FINEST, _TRIALS = 1.6, 1.2, 6
_PHASES = 200

State = tuple[Array, Array, Array]
Piece = tuple[Basis, Array]


def add_run_in(
    trajectory: Trajectory, robot: Robot, limits: Limits | None = None, *, periods: int = 1
) -> Trajectory:
    """Return a trajectory with a way from rest into it, and out of it to rest.

    `periods` runs of a motion that ends as it starts follow each other, so that they can be
    averaged; `main_interval` of what is returned tells from when to when they last. Position,
    velocity and acceleration are continuous, the ways in and out are short and keep the `limits`
    (default: the robot's) at every instant; where they rest is up to them. A Fourier series, which
    may begin anywhere in its period, begins where it is easiest to run in.

    Raises ExcitationError for other joints than the robot's, for more than one period of a motion
    whose ends do not meet, and where there is no way within limits: a motion that starts at the end
    of its range at full speed cannot be run into. One of a space `with_run_in` always can.
    """
    if trajectory.joint_names != robot.joint_names:
        raise ExcitationError(
            f"the trajectory moves {', '.join(trajectory.joint_names)}, but '{robot.name}' has "
            f"{', '.join(robot.joint_names)}: give the joints of the robot, in its order"
        )
    if not (periods >= 1 and periods == int(periods)):
        raise ExcitationError(f"periods must be a whole number of at least 1, found {periods}")
    bounds = joint_limits(robot, limits)
    main = trajectory if trajectory.rests_at_ends else _easily_begun(trajectory, bounds)
    start, end = _ends(main)
    if periods > 1:
        _check_meets(main, start, end)
    names = trajectory.joint_names
    into = [] if main.rests_at_ends else [_piece(names, bounds, start, out=False)]
    out = [] if main.rests_at_ends else [_piece(names, bounds, end, out=True)]
    pieces = [*into, *[(main.basis, main.coefficients)] * int(periods), *out]
    basis = JoinedBasis(tuple(part for part, _ in pieces))
    begins = basis.starts[len(into)]
    return Trajectory(
        names,
        basis,
        np.vstack([values for _, values in pieces]),
        trajectory.prismatic_joints,
        (begins, basis.starts[len(into) + int(periods)]),
    )


def _ends(trajectory: Trajectory) -> tuple[State, State]:
    q, v, a = trajectory.basis.states(np.array([0.0, trajectory.duration]), trajectory.coefficients)
    return (q[0], v[0], a[0]), (q[1], v[1], a[1])


def _check_meets(trajectory: Trajectory, start: State, end: State) -> None:
    reach = np.ptp(trajectory.coefficients, axis=0)
    for order, (first, last) in enumerate(zip(start, end, strict=True)):
        apart = np.abs(first - last) * trajectory.duration**order > 1e-9 * reach
        if np.any(apart):
            joint = trajectory.joint_names[int(apart.argmax())]
            raise ExcitationError(
                f"joint '{joint}' does not end as it starts, so the motion cannot be run more than "
                "once without a jump: plan with basis='fourier', or take periods=1"
            )


def _easily_begun(trajectory: Trajectory, bounds: JointLimits) -> Trajectory:
    """Return a Fourier series begun where all joints have most room to stop, both ways in time."""
    basis = trajectory.basis
    if not isinstance(basis, FourierBasis):
        return trajectory
    times = basis.duration * np.arange(_PHASES) / _PHASES
    q, v, _ = basis.states(times, trajectory.coefficients)
    braking = v**2 / (2 * bounds.acceleration)
    used = (np.abs(q - bounds.middle) + braking) / bounds.half_range
    easiest = float(times[used.max(axis=1).argmin()])
    return replace(trajectory, coefficients=basis.shifted(trajectory.coefficients, easiest))


def _piece(names: tuple[str, ...], bounds: JointLimits, state: State, *, out: bool) -> Piece:
    """Return a short way from rest to a state, or `out` of it to rest.

    Too short a way breaks the acceleration limit; too long a one cannot turn fast enough, for its
    coefficients are few. So durations are tried from what a joint needs to stop, both ways.
    """
    problem: ExcitationError | None = None
    for share in (_SHARE, 1.0):
        tightened = _tightened(bounds, state, share)
        for power in sorted(range(-_TRIALS, _TRIALS + 1), key=abs):
            duration = way_duration(bounds) * _GROWTH**power
            try:
                found = _joined_to(names, tightened, state, duration, out=out)
            except ExcitationError as refused:
                problem = refused
            else:
                return _shortened(names, tightened, state, found, out=out)
    side = "out of its end" if out else "into its start"
    raise ExcitationError(
        f"there is no way {side} within limits ({problem}); plan the motion with rest at its ends, "
        "within a narrower range, or with basis='fourier', which can begin anywhere in its period"
    )


def _shortened(
    names: tuple[str, ...], bounds: JointLimits, state: State, piece: Piece, *, out: bool
) -> Piece:
    """Return a way that is shorter by steps, which halve, as long as there is one."""
    step = _GROWTH
    while step > _FINEST:
        try:
            piece = _joined_to(names, bounds, state, piece[0].duration / step, out=out)
        except ExcitationError:
            step = float(np.sqrt(step))
    return piece


def _joined_to(
    names: tuple[str, ...], bounds: JointLimits, state: State, duration: float, *, out: bool
) -> Piece:
    """Return a way of one duration. Raises ExcitationError where there is none within bounds."""
    basis = way_basis(duration)
    moving, rest = EndState(*state), EndState()
    start, end = (moving, rest) if out else (rest, moving)
    return basis, motion_space(basis, names, bounds, start, end).home


def _tightened(bounds: JointLimits, state: State, share: float) -> JointLimits:
    """Return a share of each limit, or what the state itself uses where that is more."""
    q, v, a = state
    half = np.maximum(share * bounds.half_range, np.abs(q - bounds.middle))
    return JointLimits(
        bounds.middle - half,
        bounds.middle + half,
        np.maximum(share * bounds.velocity, np.abs(v)),
        np.maximum(share * bounds.acceleration, np.abs(a)),
    )
