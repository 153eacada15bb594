"""Run-in and run-out: from rest into a motion that starts in motion, and from its end to rest.

A motion may start or end anywhere within limits, also at the end of the range at full speed, where
no run-out can stop the robot in time. `with_run_in` therefore attaches to each moving end the
run-in of least mean square acceleration, which is linear in the motion's coefficients; so its
limits are linear inequalities too. `add_run_in` then shortens the run-in of the planned motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seaid._arrays import Array, safely
from seaid.errors import ExcitationError, checked
from seaid.excitation.basis import Basis, FourierBasis, JoinedBasis, SplineBasis, make_basis
from seaid.excitation.boundary import (
    ROUNDING,
    EndState,
    MotionSpace,
    end_conditions,
    motion_space,
    null_space,
    with_interior_start,
)
from seaid.excitation.limits import JointLimits, Limits, joint_limits
from seaid.excitation.trajectory import Trajectory, check_joint_names
from seaid.robot import Robot

# of a quintic: the ends determine five (q, v, a of the motion, v and a at rest), seven are free
_COEFFICIENTS = 12


def with_run_in(space: MotionSpace, joint_names: Sequence[str], limits: JointLimits) -> MotionSpace:
    """Return the space restricted to motions with a run-in from rest and a run-out to rest.

    `limit_rows` of the result includes the limits of the run-ins, so `add_run_in` succeeds. Ends at
    rest need none. Raises ExcitationError, naming joint and limit, if the given ends admit none.
    """
    tables = space.basis.matrices(np.array([0.0, space.basis.duration]))
    run_ins = []
    for which in range(2):
        state = np.array([table[which] for table in tables])
        # an end moves if a free variable or the feasible start gives it speed or acceleration
        speed = state[1:] @ np.column_stack([space.free, space.feasible_start])
        whole = np.linalg.norm(state[1:] @ space.basis.scaling, axis=1, keepdims=True)
        if np.any(np.abs(speed) > ROUNDING * whole):
            run_ins.append(_run_in(state, run_in_duration(limits), out=bool(which)))
    restricted = replace(space, run_ins=tuple(run_ins))
    middle = np.outer(space.basis.constant, limits.middle)
    # at the middle of the range a joint and its run-ins stand still, within all limits
    moved = np.any(np.abs(space.feasible_start - middle) > ROUNDING * limits.half_range, axis=0)
    return with_interior_start(restricted, joint_names, limits, moved)


def run_in_duration(limits: JointLimits) -> float:
    """Return the duration of a run-in [s]: twice the stopping time of the slowest joint."""
    # time to brake from the top speed, v / a, or from sqrt(a h), the peak speed of the fastest
    # motion from rest to rest over h = half_range
    stopping = np.minimum(
        limits.velocity / limits.acceleration, np.sqrt(limits.half_range / limits.acceleration)
    )
    return 2.0 * float(stopping.max())


def run_in_basis(duration: float) -> SplineBasis:
    """Return the B-spline basis of a run-in."""
    basis = make_basis("bspline", duration, _COEFFICIENTS)
    assert isinstance(basis, SplineBasis)
    return basis


def _run_in(state: Array, duration: float, *, out: bool) -> tuple[Basis, Array]:
    """Return a run-in's basis and its matrix (L, K) from coefficients; `state` (3, K)."""
    basis = run_in_basis(duration)
    names = [str(column) for column in range(state.shape[1])]
    # one column per coefficient of the motion, in place of joints: the run-in is linear in them
    moving, rest = EndState(*state), EndState()
    conditions = end_conditions(basis, names, *((moving, rest) if out else (rest, moving)))
    free, inverse = null_space(basis, conditions)
    time = np.linspace(0.0, duration, 8 * basis.size)
    acceleration = basis.matrices(time)[2] * duration**2
    # coefficients some + free y, with y of least |A (some + free y)|, A the scaled accelerations
    some = inverse @ (conditions.values / conditions.row_norms[:, None])
    least = safely(
        np.linalg.lstsq,
        acceleration @ free,
        -acceleration @ some,
        what="the run-in of a motion",
        error=ExcitationError,
        rcond=None,
    )[0]
    return basis, some + free @ least


_SHARE = 0.9
"""Share of each limit that a run-in uses, unless the motion itself starts or ends with more."""
# factor between durations, the least one of a shortening, and durations tried in each direction
_GROWTH, _FINEST, _TRIALS = 1.6, 1.2, 6
_PHASES = 200

Segment = tuple[Basis, Array]


@checked(ExcitationError)
def add_run_in(
    trajectory: Trajectory, robot: Robot, limits: Limits | None = None, *, periods: int = 1
) -> Trajectory:
    """Add a run-in from rest and a run-out to rest to a trajectory.

    Position, velocity and acceleration are continuous, and the limits hold at every instant. The
    postures at rest are free. A Fourier series is shifted in its period to the start that needs the
    least room.

    Parameters
    ----------
    trajectory : Trajectory
        The motion, of the joints of the robot.
    robot : Robot
    limits : Limits, optional
        Default: the robot's, see `Limits`.
    periods : int
        Number of repetitions of a motion that ends in the state in which it starts, to average.

    Returns
    -------
    Trajectory
        Its `main_interval` [s] is the interval of the given motion and its repetitions.

    Raises
    ------
    ExcitationError
        For joints other than the robot's, for several periods of a motion whose ends do not meet,
        and if no run-in keeps the limits. A plan with `rest_to_rest=False` always has one.

    Examples
    --------
    >>> plan = seaid.design_excitation(robot, 10.0, basis="fourier", rest_to_rest=False)
    >>> motion = seaid.add_run_in(plan.trajectory, robot, periods=5)
    """
    check_joint_names(trajectory, robot)
    if not (periods >= 1 and periods == int(periods)):
        raise ExcitationError(f"periods must be a whole number of at least 1, found {periods}")
    bounds = joint_limits(robot, limits)
    main = trajectory if trajectory.rests_at_ends else _with_best_phase(trajectory, bounds)
    ends = main.basis.states(np.array([0.0, main.duration]), main.coefficients)
    start, end = np.stack(ends, axis=1)
    if periods > 1:
        _check_meets(main, start, end)
    names = trajectory.joint_names
    into = [] if main.rests_at_ends else [_shortest_segment(names, bounds, start, out=False)]
    out = [] if main.rests_at_ends else [_shortest_segment(names, bounds, end, out=True)]
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


def _check_meets(trajectory: Trajectory, start: Array, end: Array) -> None:
    reach = np.ptp(trajectory.coefficients, axis=0)
    for order, (first, last) in enumerate(zip(start, end, strict=True)):
        # a derivative times the power of the duration is in the unit of the position
        apart = np.abs(first - last) * trajectory.duration**order > 1e-9 * reach
        if np.any(apart):
            joint = trajectory.joint_names[int(apart.argmax())]
            raise ExcitationError(
                f"joint '{joint}' does not end as it starts, so the motion cannot be run more than "
                "once without a jump: plan with basis='fourier', or take periods=1"
            )


def _with_best_phase(trajectory: Trajectory, bounds: JointLimits) -> Trajectory:
    """Return a Fourier series started at the phase at which all joints have most room to stop."""
    basis = trajectory.basis
    if not isinstance(basis, FourierBasis):
        return trajectory
    times = basis.duration * np.arange(_PHASES) / _PHASES
    q, v, _ = basis.states(times, trajectory.coefficients)
    # v^2 / (2 a) is the distance in which a joint stops
    braking = v**2 / (2 * bounds.acceleration)
    used = (np.abs(q - bounds.middle) + braking) / bounds.half_range
    easiest = float(times[used.max(axis=1).argmin()])
    return replace(trajectory, coefficients=basis.shifted(trajectory.coefficients, easiest))


def _shortest_segment(
    names: tuple[str, ...], bounds: JointLimits, state: Array, *, out: bool
) -> Segment:
    """Return a short segment from rest to a state (3, n), or with `out` from the state to rest.

    A segment that is too short breaks the acceleration limit; one that is too long has too few
    coefficients to turn. So longer and shorter durations than the stopping time are tried in turn.
    """
    refusal: ExcitationError | None = None
    for share in (_SHARE, 1.0):
        tightened = _tightened(bounds, state, share)
        for power in sorted(range(-_TRIALS, _TRIALS + 1), key=abs):
            duration = run_in_duration(bounds) * _GROWTH**power
            try:
                segment = _segment(names, tightened, state, duration, out=out)
            except ExcitationError as refused:
                refusal = refused
            else:
                return _shortened(names, tightened, state, segment, out=out)
    side = "run-out from its end" if out else "run-in to its start"
    raise ExcitationError(
        f"there is no {side} within limits ({refusal}); plan the motion with rest at its ends, "
        "within a narrower range, or with basis='fourier', which can start anywhere in its period"
    )


def _shortened(
    names: tuple[str, ...], bounds: JointLimits, state: Array, piece: Segment, *, out: bool
) -> Segment:
    """Return the segment, shortened by steps that are halved when one fails."""
    step = _GROWTH
    while step > _FINEST:
        try:
            piece = _segment(names, bounds, state, piece[0].duration / step, out=out)
        except ExcitationError:
            step = float(np.sqrt(step))
    return piece


def _segment(
    names: tuple[str, ...], bounds: JointLimits, state: Array, duration: float, *, out: bool
) -> Segment:
    """Return a segment of one duration. Raises ExcitationError if none is within bounds."""
    basis = run_in_basis(duration)
    moving, rest = EndState(*state), EndState()
    start, end = (moving, rest) if out else (rest, moving)
    return basis, motion_space(basis, names, bounds, start, end).feasible_start


def _tightened(bounds: JointLimits, state: Array, share: float) -> JointLimits:
    """Return limits reduced to a share of each, but not below the values of the state itself."""
    q, v, a = state
    half = np.maximum(share * bounds.half_range, np.abs(q - bounds.middle))
    return JointLimits(
        bounds.middle - half,
        bounds.middle + half,
        np.maximum(share * bounds.velocity, np.abs(v)),
        np.maximum(share * bounds.acceleration, np.abs(a)),
    )
