"""The ends of planned motions: prescribed end states, and run-ins from rest and run-outs to rest.

End states are linear equations in the coefficients of a basis. Their solutions are a particular
solution plus a null space, over which a search is free to move; limits are linear inequalities.

A motion may start or end anywhere within limits, also at the end of the range at full speed, where
no run-out can stop the robot in time. `with_run_in` therefore attaches to each moving end the
run-in of least mean square acceleration, which is linear in the motion's coefficients; so its
limits are linear inequalities too. `add_run_in` then shortens the run-in of the planned motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid._arrays import Array, BoolArray, finite, safely
from seaid._progress import Display
from seaid.errors import ExcitationError, checked
from seaid.excitation.basis import (
    Basis,
    FourierBasis,
    JoinedBasis,
    check_whole_number,
    make_basis,
    matrices,
)
from seaid.excitation.limits import (
    KINDS,
    JointLimits,
    Limits,
    grouped,
    hull_rows,
    joint_limits,
    per_joint,
)
from seaid.excitation.trajectory import Trajectory, check_joint_names
from seaid.robot import Robot

EndValue = float | Sequence[float] | Array | Mapping[str, float] | None
ROUNDING = 1e-9
"""Relative size below which a number counts as rounding error."""

_ENDS = ("start", "end")


@dataclass(frozen=True, eq=False, repr=False)
class EndState(Display):
    """Position, velocity and acceleration at one end of a motion [rad or m, s].

    Without arguments the motion is at rest there, at a position that the search chooses.

    Parameters
    ----------
    position, velocity, acceleration : float, sequence of n floats, dict or None
        One value for all joints, one per joint, {joint: value} for all joints, or None: free.

    Examples
    --------
    >>> start = seaid.excitation.EndState(position={"hip": 0.0, "knee": 0.5})
    >>> plan = seaid.design_excitation(robot, 10.0, start=start)
    """

    position: EndValue = None
    velocity: EndValue = 0.0
    acceleration: EndValue = 0.0


IN_MOTION = EndState(None, None, None)
"""An end without conditions, which may be in motion."""


@dataclass(frozen=True, eq=False)
class EndConditions:
    """The linear equations rows (c, K) @ coefficients (K, n) = values (c, n).

    Condition i prescribes the kind `kinds[i]` (0 position, 1 velocity, 2 acceleration) at the end
    `ends[i]` (0 start, 1 end). `row_norms` (c,) are the norms of the rows over scaled variables.
    """

    rows: Array
    values: Array
    row_norms: Array
    kinds: tuple[int, ...]
    ends: tuple[int, ...]

    def residuals(self, coefficients: Array) -> Array:
        """Return the residual (c, n) of each condition, over the norm of its row."""
        return (self.values - self.rows @ coefficients) / self.row_norms[:, None]


def end_conditions(
    basis: Basis, joint_names: Sequence[str], start: EndState, end: EndState
) -> EndConditions:
    """Return the equations of two end states. Raises ExcitationError for invalid values."""
    # 3 of (2, K): position, velocity and acceleration at the start and at the end
    tables = matrices(basis, np.array([0.0, basis.duration]))
    equations: list[tuple[Array, Array, int, int]] = []
    for which, state in enumerate((start, end)):
        for kind, value in enumerate((state.position, state.velocity, state.acceleration)):
            if value is not None:
                name = f"{KINDS[kind]} at the {_ENDS[which]}"
                wanted = per_joint(name, value, joint_names)
                values = finite(name, wanted, (len(joint_names),), ExcitationError)
                equations.append((tables[kind][which], values, kind, which))
    rows = np.array([row for row, *_ in equations]).reshape(-1, basis.size)
    return EndConditions(
        rows,
        np.array([values for _, values, *_ in equations]).reshape(-1, len(joint_names)),
        np.asarray(np.linalg.norm(rows @ basis.scaling, axis=1)),
        tuple(kind for *_, kind, _ in equations),
        tuple(which for *_, which in equations),
    )


def null_space(basis: Basis, conditions: EndConditions) -> tuple[Array, Array]:
    """Return a null-space basis (K, k) of end conditions, and their pseudo-inverse (K, c).

    The null space has orthonormal columns over scaled variables; the pseudo-inverse maps
    `EndConditions.residuals` to a change of the coefficients. Raises ExcitationError if the basis
    has too few coefficients.
    """
    from scipy.linalg import qr

    rows = (conditions.rows @ basis.scaling) / conditions.row_norms[:, None]
    if not len(rows):
        return basis.scaling, np.empty((basis.size, 0))
    # pivoting, because both ends of a periodic basis give the same rows: they count once in the
    # rank, and the other columns of Q span the null space
    Q, R, _ = qr(rows.T, pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > ROUNDING))
    # without a position condition, a constant satisfies all conditions, and it is not a motion
    least = rank + (1 if 0 in conditions.kinds else 2)
    if basis.size < least:
        raise ExcitationError(
            f"{basis.size} coefficients per joint are too few for the {rank} conditions at the "
            f"ends; give at least {least}"
        )
    inverse = safely(
        np.linalg.pinv, rows, what="the ends of a motion", error=ExcitationError, rcond=ROUNDING
    )
    return np.asarray(basis.scaling @ Q[:, rank:]), np.asarray(basis.scaling @ inverse)


def check_within(
    conditions: EndConditions, joint_names: Sequence[str], limits: JointLimits
) -> None:
    """Raise ExcitationError, naming joint, end and limit, where an end state breaks a limit."""
    low = np.array([limits.lower, -limits.velocity, -limits.acceleration])
    high = np.array([limits.upper, limits.velocity, limits.acceleration])
    for kind, which, values in zip(
        conditions.kinds, conditions.ends, conditions.values, strict=True
    ):
        outside = (values < low[kind] - ROUNDING) | (values > high[kind] + ROUNDING)
        for joint in np.flatnonzero(outside).tolist():
            raise ExcitationError(
                f"joint '{joint_names[joint]}': {KINDS[kind]} {values[joint]:.6g} at the "
                f"{_ENDS[which]} is outside its limits, {low[kind, joint]:.6g} to "
                f"{high[kind, joint]:.6g}; give another or wider Limits"
            )


def check_consistent(
    conditions: EndConditions, coefficients: Array, joint_names: Sequence[str], limits: JointLimits
) -> None:
    """Raise ExcitationError if the conditions contradict each other (on a periodic basis)."""
    reach = limits.half_range + np.abs(coefficients).max(axis=0)
    wrong = np.argwhere(np.abs(conditions.residuals(coefficients)) > ROUNDING * reach)
    if len(wrong):
        condition, joint = wrong[0]
        kind = conditions.kinds[condition]
        start, end = conditions.values[np.array(conditions.kinds) == kind, joint]
        raise ExcitationError(
            f"joint '{joint_names[joint]}': {KINDS[kind]} {start:.6g} at the start and {end:.6g} "
            "at the end contradict each other, for a fourier series is periodic and ends as it "
            "starts; give equal ends, leave one free, or take a bspline"
        )


_RUN_IN_SHARE, _RUN_IN_DENSITY = 0.98, 4
"""Share of each limit for the bounds of a run-in, and rows per coefficient of its hull
(`Basis.hull`)."""


@dataclass(frozen=True, eq=False)
class MotionSpace:
    """The motions of a basis with given ends, over free variables x (n k,), joint by joint.

    The coefficients (K, n) of joint j are feasible_start_j + half_range_j * (free @ x_j):
    `feasible_start` (K, n) is a motion well within limits, `free` (K, k) a null-space basis,
    `half_range` (n,) half of each joint's range. `run_ins` are motions that depend linearly on this
    one and must keep the limits too, see `with_run_in`: a basis of size L, and the matrix (L, K)
    from the motion's coefficients to theirs.
    """

    basis: Basis
    feasible_start: Array
    half_range: Array
    free: Array
    run_ins: tuple[tuple[Basis, Array], ...] = ()

    @property
    def shape(self) -> tuple[int, int]:
        """Number of joints and of free variables per joint, (n, k)."""
        return len(self.half_range), self.free.shape[1]

    def coefficients(self, x: Array) -> Array:
        """Return the coefficients (K, n) of free variables x (n k,) or (n, k)."""
        return self.feasible_start + self.half_range * (self.free @ np.reshape(x, self.shape).T)


_Curve = tuple[Basis, Array, int | None]
"""A basis, the matrix from the motion's coefficients to its own, and the density of its hull."""


@dataclass(frozen=True, eq=False)
class _LimitBlock:
    """The limit of one kind on one curve: |rows (n, C, k) @ x_j + offsets (n, C)| <= 1.

    `fixed_offsets` (n, D) are the offsets of zero rows: the end states alone determine them.
    """

    kind: int
    rows: Array
    offsets: Array
    fixed_offsets: Array


def motion_space(
    basis: Basis, joint_names: Sequence[str], limits: JointLimits, start: EndState, end: EndState
) -> MotionSpace:
    """Return the motions of a basis with the given end states.

    The feasible start is the middle of each joint's range if that satisfies the end states, else
    the Chebyshev centre, see `with_interior_start`. Raises ExcitationError for an end state that is
    not finite, names other joints, lies outside the limits, contradicts the other end of a periodic
    basis, needs more coefficients, or leaves no motion within limits.
    """
    conditions = end_conditions(basis, joint_names, start, end)
    check_within(conditions, joint_names, limits)
    free, inverse = null_space(basis, conditions)
    middle = np.outer(basis.constant, limits.middle)
    residuals = conditions.residuals(middle)
    feasible_start = middle + inverse @ residuals
    check_consistent(conditions, feasible_start, joint_names, limits)
    # where the middle of the range satisfies the ends it is taken as it is, without rounding errors
    moved = np.any(np.abs(residuals) > ROUNDING * limits.half_range, axis=0)
    space = MotionSpace(basis, np.where(moved, feasible_start, middle), limits.half_range, free)
    return with_interior_start(space, joint_names, limits, moved)


def limit_rows(space: MotionSpace, limits: JointLimits) -> tuple[Array, Array]:
    """Return G (n, g, c, k) and offsets h (n, g, c) of the linear limits on x.

    Joint j keeps its limits of position, velocity and acceleration at every instant if
    |G[j] x_j + h[j]| <= 1. The rows are those of `Basis.hull`, in g groups of c consecutive ones
    (the last row of each kind is repeated to fill its group). Rows that only the end states
    determine are excluded: `motion_space` has checked them.
    """
    blocks = _limit_blocks(space, limits)
    return (
        np.concatenate([grouped(block.rows, 1) for block in blocks], axis=1),
        np.concatenate([grouped(block.offsets, 1) for block in blocks], axis=1),
    )


def with_interior_start(
    space: MotionSpace, joint_names: Sequence[str], limits: JointLimits, moved: BoolArray
) -> MotionSpace:
    """Return the space with a feasible start inside the limits, for the joints `moved` (n,).

    It is the Chebyshev centre: the centre of the largest ball of free variables within limits, by
    a linear program (Boyd and Vandenberghe 2004, section 8.5.1). Raises ExcitationError, naming
    joint and limit, if no motion is within limits.
    """
    blocks, feasible_start = _limit_blocks(space, limits), space.feasible_start.copy()
    for joint in map(int, np.flatnonzero(moved)):
        for block in blocks:
            use = np.abs(block.fixed_offsets[joint]).max(initial=0.0)
            if use > 1.0 + ROUNDING:
                raise _infeasible(joint_names[joint], block.kind, use)
        rows = np.concatenate([block.rows[joint] for block in blocks])
        offsets = np.concatenate([block.offsets[joint] for block in blocks])
        y, room = _chebyshev_centre(rows, offsets, np.linalg.norm(rows, axis=1))
        if room <= 0 or np.abs(rows @ y + offsets).max() >= 1.0:
            # with equal weights the radius is one less the least possible use: for the message
            y, _ = _chebyshev_centre(rows, offsets, np.ones(len(rows)))
            use = np.abs(rows @ y + offsets)
            kinds = np.repeat([b.kind for b in blocks], [b.offsets.shape[1] for b in blocks])
            raise _infeasible(joint_names[joint], int(kinds[use.argmax()]), float(use.max()))
        feasible_start[:, joint] += space.half_range[joint] * (space.free @ y)
    return replace(space, feasible_start=feasible_start)


def _limit_blocks(space: MotionSpace, limits: JointLimits) -> list[_LimitBlock]:
    curves: list[_Curve] = [(space.basis, np.eye(space.basis.size), None)]
    curves += [(*run_in, _RUN_IN_DENSITY) for run_in in space.run_ins]
    return [_limit_block(space, limits, kind, curve) for curve in curves for kind in range(3)]


def _limit_block(space: MotionSpace, limits: JointLimits, kind: int, curve: _Curve) -> _LimitBlock:
    basis, matrix, density = curve
    hull, bounds, middle = hull_rows(basis, limits, kind, density)
    hull = hull @ matrix
    scale = bounds if density is None else _RUN_IN_SHARE * bounds
    moves = hull @ space.free
    # a row whose variables cancel up to rounding is determined by the ends alone
    whole = np.linalg.norm(hull @ space.basis.scaling, axis=1)
    free = np.linalg.norm(moves, axis=1) > ROUNDING * whole
    # also for a run-in: that of a motion that stands still stands still in the same place
    about = space.feasible_start - np.outer(space.basis.constant, middle)
    offsets = ((hull @ about) / scale).T
    rows = (space.half_range / scale)[:, None, None] * moves[free]
    return _LimitBlock(kind, rows, offsets[:, free], offsets[:, ~free])


def _chebyshev_centre(rows: Array, offsets: Array, weights: Array) -> tuple[Array, float]:
    """Return y and the radius: the largest s with |rows @ y + offsets| + weights * s <= 1."""
    from scipy.optimize import linprog

    sides = np.vstack([np.column_stack([sign * rows, weights]) for sign in (1.0, -1.0)])
    right = np.concatenate([1.0 - offsets, 1.0 + offsets])
    cost = np.zeros(sides.shape[1])
    cost[-1] = -1.0
    # variables of any sign: without bounds linprog would take zero or more
    solution = linprog(cost, A_ub=sides, b_ub=right, bounds=(None, None), method="highs")
    if solution.x is None:
        raise ExcitationError(f"no motion that keeps the ends was found: {solution.message}")
    return solution.x[:-1], float(solution.x[-1])


def _infeasible(joint: str, kind: int, use: float) -> ExcitationError:
    return ExcitationError(
        f"joint '{joint}': no motion between these ends keeps its {KINDS[kind]} limit at every "
        f"instant, at best it uses {use:.4g} of it; give a longer duration, more coefficients or "
        "wider limits"
    )


# of a quintic: the ends determine five (q, v, a of the motion, v and a at rest), seven are free
_COEFFICIENTS = 12


def with_run_in(space: MotionSpace, joint_names: Sequence[str], limits: JointLimits) -> MotionSpace:
    """Return the space restricted to motions with a run-in from rest and a run-out to rest.

    `limit_rows` of the result includes the limits of the run-ins, so `add_run_in` succeeds. Ends at
    rest need none. Raises ExcitationError, naming joint and limit, if the given ends admit none.
    """
    tables = matrices(space.basis, np.array([0.0, space.basis.duration]))
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


def _run_in(state: Array, duration: float, *, out: bool) -> tuple[Basis, Array]:
    """Return a run-in's basis and its matrix (L, K) from coefficients; `state` (3, K)."""
    basis = make_basis("bspline", duration, _COEFFICIENTS)
    names = [str(column) for column in range(state.shape[1])]
    # one column per coefficient of the motion, in place of joints: the run-in is linear in them
    moving, rest = EndState(*state), EndState()
    conditions = end_conditions(basis, names, *((moving, rest) if out else (rest, moving)))
    free, inverse = null_space(basis, conditions)
    time = np.linspace(0.0, duration, 8 * basis.size)
    acceleration = matrices(basis, time)[2] * duration**2
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
# factor between durations, and how many are tried below and above the stopping time
_GROWTH, _TRIALS = 1.25, 12

_PHASES = 200
"""Instants of a period that are compared as the start of a Fourier series."""

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
    >>> motion = seaid.excitation.add_run_in(plan.trajectory, robot, periods=5)
    """
    check_joint_names(trajectory, robot)
    check_whole_number("periods", periods)
    bounds = joint_limits(robot, limits)
    main = trajectory if trajectory.rests_at_ends else _with_best_phase(trajectory, bounds)
    ends = main.basis.states(np.array([0.0, main.duration]), main.coefficients)
    start, end = np.stack(ends, axis=1)
    if periods > 1:
        _check_meets(main, start, end)
    names = trajectory.joint_names
    into = [] if main.rests_at_ends else [_shortest_segment(names, bounds, start, out=False)]
    out = [] if main.rests_at_ends else [_shortest_segment(names, bounds, end, out=True)]
    pieces = [*into, *[(main.basis, main.coefficients)] * periods, *out]
    basis = JoinedBasis(tuple(part for part, _ in pieces))
    begins = basis.starts[len(into)]
    return Trajectory(
        names,
        basis,
        np.vstack([values for _, values in pieces]),
        trajectory.prismatic_joints,
        (begins, basis.starts[len(into) + periods]),
    )


def _check_meets(trajectory: Trajectory, start: Array, end: Array) -> None:
    reach = np.ptp(trajectory.coefficients, axis=0)
    for order, (first, last) in enumerate(zip(start, end, strict=True)):
        # a derivative times the power of the duration is in the unit of the position
        apart = np.abs(first - last) * trajectory.duration**order > ROUNDING * reach
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
    coefficients to turn. So durations about the stopping time are tried, short ones first.
    """
    refusal: ExcitationError | None = None
    for share in (_SHARE, 1.0):
        tightened = _tightened(bounds, state, share)
        for power in range(-_TRIALS, _TRIALS + 1):
            duration = run_in_duration(bounds) * _GROWTH**power
            try:
                return _segment(names, tightened, state, duration, out=out)
            except ExcitationError as refused:
                refusal = refused
    side = "run-out from its end" if out else "run-in to its start"
    raise ExcitationError(
        f"there is no {side} within limits ({refusal}); plan the motion with rest at its ends, "
        "within a narrower range, or with basis='fourier', which can start anywhere in its period"
    )


def _segment(
    names: tuple[str, ...], bounds: JointLimits, state: Array, duration: float, *, out: bool
) -> Segment:
    """Return a segment of one duration. Raises ExcitationError if none is within bounds."""
    basis = make_basis("bspline", duration, _COEFFICIENTS)
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
