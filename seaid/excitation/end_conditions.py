"""What is asked of the two ends of a motion, as linear equations in its coefficients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid.arrays import Array, finite
from seaid.errors import ExcitationError, unknown_name
from seaid.excitation.basis import Basis
from seaid.excitation.limits import KINDS, JointLimits
from seaid.linear_algebra import safely

EndValue = float | Sequence[float] | Array | Mapping[str, float] | None
SAME = 1e-9
"""What rounding may take, as a part of the whole."""

_ENDS = ("start", "end")


@dataclass(frozen=True, eq=False)
class EndState:
    """Position, velocity and acceleration at one end of a motion [rad or m, s].

    Each is one number for all joints, one a joint, a mapping {joint: value} of all joints, or None:
    free. Without arguments it is rest at a position that stays free.
    """

    position: EndValue = None
    velocity: EndValue = 0.0
    acceleration: EndValue = 0.0


FREE = EndState(None, None, None)
"""An end at which nothing is asked."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Equations rows (c, K) @ coefficients (K, n) = values (c, n).

    Condition i is on the kind `kinds[i]` (0 position, 1 velocity, 2 acceleration) at the end
    `ends[i]` (0 start, 1 end). `sizes` (c,) are the lengths of the rows over natural variables.
    """

    rows: Array
    values: Array
    sizes: Array
    kinds: tuple[int, ...]
    ends: tuple[int, ...]

    def missed(self, coefficients: Array) -> Array:
        """Return by how much coefficients (K, n) miss each condition (c, n), all weighed alike."""
        return (self.values - self.rows @ coefficients) / self.sizes[:, None]


def end_conditions(
    basis: Basis, joint_names: Sequence[str], start: EndState, end: EndState
) -> Conditions:
    """Return what end states ask of a basis. Raises ExcitationError for values that cannot be."""
    tables = basis.matrices(np.array([0.0, basis.duration]))
    found: list[tuple[Array, Array, int, int]] = []
    for which, state in enumerate((start, end)):
        for kind, given in enumerate((state.position, state.velocity, state.acceleration)):
            if given is not None:
                name = f"{KINDS[kind]} at the {_ENDS[which]}"
                values = _end_values(name, given, tuple(joint_names))
                found.append((tables[kind][which], values, kind, which))
    rows = np.array([row for row, *_ in found]).reshape(-1, basis.size)
    return Conditions(
        rows,
        np.array([values for _, values, *_ in found]).reshape(-1, len(joint_names)),
        np.asarray(np.linalg.norm(rows @ basis.natural, axis=1)),
        tuple(kind for *_, kind, _ in found),
        tuple(which for *_, which in found),
    )


def solutions(basis: Basis, asked: Conditions) -> tuple[Array, Array]:
    """Return the matrix (K, k) of what conditions leave free, and (K, c) from `missed` to a change.

    The first has orthonormal columns over natural variables. Raises ExcitationError for a basis
    whose coefficients are too few.
    """
    from scipy.linalg import qr

    rows = (asked.rows @ basis.natural) / asked.sizes[:, None]
    if not len(rows):
        return basis.natural, np.empty((basis.size, 0))
    Q, R, _ = qr(rows.T, pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > SAME))
    # where no position is asked, one that does not move at all is left, and is no motion
    least = rank + (1 if 0 in asked.kinds else 2)
    if basis.size < least:
        raise ExcitationError(
            f"{basis.size} coefficients a joint are too few for the ends asked, which are {rank} "
            f"conditions; give at least {least}"
        )
    back = safely(
        np.linalg.pinv, rows, what="the ends of a motion", error=ExcitationError, rcond=SAME
    )
    return np.asarray(basis.natural @ Q[:, rank:]), np.asarray(basis.natural @ back)


def check_within(asked: Conditions, joint_names: Sequence[str], limits: JointLimits) -> None:
    """Raise ExcitationError, naming joint, end and limit, where an end state breaks a limit."""
    low = (limits.lower, -limits.velocity, -limits.acceleration)
    high = (limits.upper, limits.velocity, limits.acceleration)
    for kind, which, values in zip(asked.kinds, asked.ends, asked.values, strict=True):
        for joint, value, least, most in zip(
            joint_names, values, low[kind], high[kind], strict=True
        ):
            if not least - SAME <= value <= most + SAME:
                raise ExcitationError(
                    f"joint '{joint}': {KINDS[kind]} {value:.6g} at the {_ENDS[which]} is outside "
                    f"its limits, {least:.6g} to {most:.6g}; give another or wider Limits"
                )


def check_met(
    asked: Conditions, coefficients: Array, joint_names: Sequence[str], limits: JointLimits
) -> None:
    """Raise ExcitationError where the conditions contradict each other: a periodic basis."""
    reach = limits.half_range + np.abs(coefficients).max(axis=0)
    wrong = np.argwhere(np.abs(asked.missed(coefficients)) > SAME * reach)
    if len(wrong):
        condition, joint = wrong[0]
        kind = asked.kinds[condition]
        start, end = asked.values[np.array(asked.kinds) == kind, joint]
        raise ExcitationError(
            f"joint '{joint_names[joint]}': {KINDS[kind]} {start:.6g} at the start and {end:.6g} "
            "at the end contradict each other, for a fourier series is periodic and ends as it "
            "starts; give equal ends, leave one free, or take a bspline"
        )


def _end_values(name: str, given: Any, joint_names: tuple[str, ...]) -> Array:
    """Return one part of an end state (n,)."""
    wanted = given
    if isinstance(given, Mapping):
        for joint in given:
            if joint not in joint_names:
                raise ExcitationError(f"{name}: " + unknown_name("joint", joint, joint_names))
        missing = [joint for joint in joint_names if joint not in given]
        if missing:
            raise ExcitationError(
                f"{name} is not given for {', '.join(missing)}; name all joints, or give None "
                "where it may be any"
            )
        wanted = [given[joint] for joint in joint_names]
    elif np.ndim(given) == 0:
        wanted = [given] * len(joint_names)
    return finite(name, wanted, (len(joint_names),), ExcitationError)
