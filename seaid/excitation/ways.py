"""Motions that can be run into from rest, and out of to rest, within limits.

A free end may be anywhere, at the end of the range at full speed as well, where nothing stops a
robot in time. So each end that moves gets a way to rest that hangs on it linearly: the one with the
least mean square acceleration. Its limits are linear in the motion's own coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seaid.arrays import Array
from seaid.errors import ExcitationError
from seaid.excitation.basis import Basis, make_basis
from seaid.excitation.end_conditions import SAME, EndState, end_conditions, solutions
from seaid.excitation.ends import MotionSpace, with_room
from seaid.excitation.limits import JointLimits
from seaid.excitation.spline import SplineBasis
from seaid.linear_algebra import safely

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
