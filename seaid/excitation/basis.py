"""Bases of a planned motion: functions of time, linear in their coefficients (18).

"bspline" is quintic on uniform knots. "polynomial" is (18) as a spline without inner knots: its
Bernstein coefficients stay of the size of the motion. "fourier" is a finite Fourier series over
one period (Swevers et al. 1997). A `JoinedBasis` concatenates several bases in time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from seaid._arrays import Array, BoolArray, frozen, number
from seaid._files import numbers
from seaid.errors import ExcitationError, check_name, shown, unknown_name

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


@dataclass(frozen=True)
class FourierBasis:
    """A finite Fourier series over one period, or several equal ones.

    The coefficients of a joint are the constant, then the amplitudes of the sines, then those of
    the cosines [rad or m]. The motion can be repeated without a jump, so that periods can be
    averaged.

    Parameters
    ----------
    harmonics : int
        Number of harmonics, at least 1.
    duration : float
        The length of the motion [s].
    periods : int
        Number of equal periods in it.
    """

    harmonics: int
    duration: float
    periods: int = 1

    def __post_init__(self) -> None:
        check_whole_number("harmonics", self.harmonics)
        check_whole_number("periods", self.periods)
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise ExcitationError(
                f"duration must be more than zero seconds, found {shown(self.duration)}"
            )

    @property
    def period_s(self) -> float:
        """Length of one period [s]."""
        return self.duration / self.periods

    @property
    def size(self) -> int:
        """Number of coefficients per joint, 2 harmonics + 1."""
        return 2 * self.harmonics + 1

    @property
    def constant(self) -> Array:
        """The coefficients (K,) of the constant 1."""
        return np.asarray(np.eye(self.size)[0])

    @property
    def scaling(self) -> Array:
        """The matrix (K, K) from variables to amplitudes that fall as 1 / harmonic."""
        # equal variables are equal amplitudes of velocity, so that no harmonic uses its limit alone
        falling = 1.0 / np.arange(1, self.harmonics + 1)
        return np.diag(np.concatenate([[1.0], falling, falling]))

    def _matrices(self, time: Array) -> tuple[Array, Array, Array]:
        """Return the matrices (T, K) of position, velocity and acceleration at times (T,) [s]."""
        harmonic = np.arange(1, self.harmonics + 1)
        rate = 2 * np.pi * harmonic / self.period_s
        # modulo the period, so that the end gives exactly the values of the start
        phase = 2 * np.pi * np.outer(np.asarray(time) / self.period_s % 1.0, harmonic)
        sine, cosine = np.sin(phase), np.cos(phase)
        ones = np.ones((len(phase), 1))
        return (
            np.hstack([ones, sine, cosine]),
            np.hstack([0 * ones, rate * cosine, -rate * sine]),
            np.hstack([0 * ones, -(rate**2) * sine, -(rate**2) * cosine]),
        )

    def states(self, time: Array, coefficients: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (T, n) of coefficients (K, n) at times."""
        position, velocity, acceleration = self._matrices(time)
        return position @ coefficients, velocity @ coefficients, acceleration @ coefficients

    def shifted(self, coefficients: Array, time: float) -> Array:
        """Return the coefficients (K, n) of the motion started at `time` [s] of its period."""
        phase = 2 * np.pi * np.arange(1, self.harmonics + 1) * (time / self.period_s % 1.0)
        sine, cosine = np.sin(phase)[:, None], np.cos(phase)[:, None]
        # a sin(x + p) + b cos(x + p) = (a cos p - b sin p) sin x + (a sin p + b cos p) cos x
        a, b = np.split(coefficients[1:], 2)
        return np.vstack([coefficients[:1], cosine * a - sine * b, sine * a + cosine * b])

    def hull(self, order: int, density: int) -> Array:
        """Return the matrix (C, K) whose largest |row @ c| bounds the derivative of `order`."""
        # C >= 2 K = 4 N + 2 samples, with which the factor below is less than sqrt(2)
        count = max(density, 2) * self.size
        time = self.period_s * np.arange(count) / count
        # M. Riesz (1914): around a maximum M of |s|, |s(phase)| >= M cos(N phase) for N harmonics,
        # so the largest of C equally spaced samples is at least M cos(pi N / C)
        return np.asarray(self._matrices(time)[order] / np.cos(np.pi * self.harmonics / count))

    def to_dict(self) -> dict[str, Any]:
        """Return the basis as JSON content."""
        periods = {"periods": self.periods} if self.periods > 1 else {}
        size = {"harmonics": self.harmonics, "duration": self.duration}
        return {"type": "fourier", **size, **periods}


@dataclass(frozen=True, eq=False)
class JoinedBasis:
    """Bases over consecutive intervals, each with its own coefficients, stacked in their order.

    The coefficients must make the motion continuous where two parts meet; there, the later part is
    evaluated. Raises ExcitationError without a part.
    """

    parts: tuple[Basis, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts:
            raise ExcitationError("a joined basis needs at least one part, found none")

    @cached_property
    def starts(self) -> tuple[float, ...]:
        """Start time of each part, then the end of the last [s]."""
        durations = [part.duration for part in self.parts]
        return (0.0, *np.cumsum(durations).tolist())

    @property
    def duration(self) -> float:
        """End of the motion [s]; it starts at 0."""
        return self.starts[-1]

    @property
    def size(self) -> int:
        """Number of coefficients per joint, over all parts."""
        return sum(part.size for part in self.parts)

    @property
    def constant(self) -> Array:
        """The coefficients (K,) of the constant 1."""
        return np.concatenate([part.constant for part in self.parts])

    @property
    def scaling(self) -> Array:
        """The block-diagonal matrix (K, K) of the parts' scalings."""
        return _block_diagonal([part.scaling for part in self.parts])

    def states(self, time: Array, coefficients: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (T, n) of coefficients (K, n) at times."""
        states = np.empty((3, len(time), coefficients.shape[1]))
        for part, columns, mask, local in self._pieces(time):
            states[:, mask] = part.states(local, coefficients[columns])
        return states[0], states[1], states[2]

    def hull(self, order: int, density: int) -> Array:
        """Return the block-diagonal matrix (C, K) of the parts' hulls."""
        return _block_diagonal([part.hull(order, density) for part in self.parts])

    def to_dict(self) -> dict[str, Any]:
        """Return the basis as JSON content."""
        return {"type": "joined", "parts": [part.to_dict() for part in self.parts]}

    def _pieces(self, time: Array) -> Iterator[tuple[Basis, slice, BoolArray, Array]]:
        """Yield each part in use, its columns, the mask of its times, and these from its start.

        Times are clipped to the part, because rounding may place one beyond its end.
        """
        owner = np.searchsorted(self.starts[1:-1], time, side="right")
        first = 0
        for place, (part, start) in enumerate(zip(self.parts, self.starts, strict=False)):
            mask = owner == place
            if np.any(mask):
                local = np.clip(np.asarray(time)[mask] - start, 0.0, part.duration)
                yield part, slice(first, first + part.size), mask, local
            first += part.size


def _block_diagonal(blocks: Sequence[Array]) -> Array:
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))


BasisName = Literal["bspline", "polynomial", "fourier", "multisine"]
BASES: tuple[BasisName, ...] = ("bspline", "polynomial", "fourier")
"""Those of `make_basis`; a multisine is a Fourier series of its own."""

_QUINTIC = 5
"""Degree of the splines: derivatives up to the fourth are continuous, on which the torque of a
motor behind a spring depends."""

_SHORTEST_S, _LONGEST_S = 1e-3, 1e6
"""Shortest and longest duration of a motion [s], beyond those that a robot can have."""

_LEAST: dict[BasisName, int] = {"bspline": 6, "polynomial": 4, "fourier": 3}
"""The least number of coefficients per joint; prescribed ends may need more."""


class Basis(Protocol):
    """The protocol of a basis with K coefficients per joint."""

    @property
    def duration(self) -> float:
        """End of the motion [s]; it starts at 0."""

    @property
    def size(self) -> int:
        """Number of coefficients per joint, K."""

    @property
    def constant(self) -> Array:
        """The coefficients (K,) of the constant 1."""

    def states(self, time: Array, coefficients: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (T, n) of coefficients (K, n) at times."""

    def hull(self, order: int, density: int) -> Array:
        """Return a matrix (C, K) whose largest |row @ c| bounds the derivative of `order`.

        It has about `density` rows per coefficient; more rows give a tighter bound.
        """

    @property
    def scaling(self) -> Array:
        """The matrix (K, K) from variables of similar magnitude to coefficients."""

    def to_dict(self) -> dict[str, Any]:
        """Return the basis as JSON content; `basis_from_dict` reads it."""


def matrices(basis: Basis, time: Array) -> tuple[Array, Array, Array]:
    """Return the matrices (T, K) of position, velocity and acceleration at times (T,) [s]."""
    return basis.states(time, np.eye(basis.size))


def make_basis(name: BasisName, duration: float, coefficients: int) -> Basis:
    """Return the basis of a name, with `coefficients` per joint, or raise ExcitationError."""
    check_name("basis", name, BASES, ExcitationError)
    if not _SHORTEST_S <= duration <= _LONGEST_S:
        raise ExcitationError(
            f"duration must be from {_SHORTEST_S:g} to {_LONGEST_S:g} s, found {duration:g}",
            "duration",
        )
    if coefficients != int(coefficients) or coefficients < _LEAST[name]:
        raise ExcitationError(
            f"a {name} needs at least {_LEAST[name]} coefficients per joint, a whole number, "
            f"found {coefficients}"
        )
    if name == "fourier":
        if coefficients % 2 == 0:
            raise ExcitationError(
                "a fourier series has an odd number of coefficients per joint, one and two per "
                f"harmonic, found {coefficients}"
            )
        return FourierBasis(int(coefficients) // 2, float(duration))
    degree = _QUINTIC if name == "bspline" else int(coefficients) - 1
    # K coefficients of degree p have K - p spans between knots, so K - p - 1 knots inside
    inside = np.linspace(0.0, duration, int(coefficients) - degree + 1)[1:-1]
    zeros = np.zeros(degree + 1)
    return SplineBasis(degree, np.concatenate([zeros, inside, zeros + duration]))


def basis_from_dict(content: Any) -> Basis:
    """Return the basis of `to_dict`; raise ExcitationError or, for missing keys, KeyError."""
    if not isinstance(content, dict):
        raise ExcitationError(f"a basis must be an object with a type, found {shown(content)}")
    if content["type"] == "spline":
        return SplineBasis(content["degree"], numbers("knots", content["knots"], ExcitationError))
    if content["type"] == "fourier":
        duration = number("duration", content["duration"], ExcitationError)
        return FourierBasis(content["harmonics"], duration, content.get("periods", 1))
    if content["type"] == "joined":
        parts = content["parts"]
        if not isinstance(parts, list):
            raise ExcitationError(f"parts must be a list of bases, found {shown(parts)}")
        return JoinedBasis(tuple(basis_from_dict(part) for part in parts))
    raise ExcitationError(
        unknown_name("basis type", content["type"], ("spline", "fourier", "joined"))
    )


def check_whole_number(name: str, value: Any, least: int = 1) -> None:
    """Raise ExcitationError, naming the value, if it is no whole number or less than `least`."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise ExcitationError(
            f"{name} must be a whole number of at least {least}, found {shown(value)}", name
        )


_MOST_DEGREE = 100
"""Largest degree of a basis of splines."""

_LEAST_SPAN = 1e-12
"""Relative to the duration: knots closer than this differ by rounding error only."""


@dataclass(frozen=True, eq=False)
class SplineBasis:
    """Clamped B-splines over [0, duration]; the K coefficients of a joint are control points.

    Parameters
    ----------
    degree : int
        From 3 to 100.
    knots : array (K + degree + 1,)
        Rising times [s], the first and the last repeated degree + 1 times. Raises ExcitationError
        for knots that are not clamped, not in order, closer than 1e-12 of the duration, or
        repeated so often that the acceleration jumps.
    """

    degree: int
    knots: Array

    def __post_init__(self) -> None:
        knots = frozen("knots", self.knots, (None,), ExcitationError)
        object.__setattr__(self, "knots", knots)
        check_whole_number("degree", self.degree, least=3)
        if self.degree > _MOST_DEGREE:
            raise ExcitationError(
                f"the degree of a spline is at most {_MOST_DEGREE}, found {shown(self.degree)}"
            )
        _check_knots(knots, self.degree)

    @property
    def duration(self) -> float:
        """End of the motion [s]; it starts at 0."""
        return float(self.knots[-1])

    @property
    def size(self) -> int:
        """Number of coefficients per joint, K."""
        return len(self.knots) - self.degree - 1

    def states(self, time: Array, coefficients: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (T, n) of coefficients (K, n) at times.

        Times must lie within [0, duration].
        """
        spline = self._spline(coefficients)
        position, velocity, acceleration = (spline(time, nu=order) for order in range(3))
        return position, velocity, acceleration

    @property
    def constant(self) -> Array:
        """The coefficients (K,) of the constant 1."""
        return np.ones(self.size)

    @property
    def scaling(self) -> Array:
        """The matrix (K, K) from variables to coefficients: the identity."""
        return np.eye(self.size)

    def hull(self, order: int, density: int) -> Array:
        """Return the matrix (C, K) to control points of the derivative of `order` (0, 1, 2).

        The derivative lies between its least and greatest control points at every instant (convex
        hull property). Inserting knots, about `density` per coefficient, brings the control points
        closer to the curve, quadratically in their number.
        """
        # rounded up: at least `density` control points per coefficient
        intervals = len(np.unique(self.knots)) - 1
        pieces = max(1, -(-density * self.size // intervals))
        derivative = self._spline(np.eye(self.size)).derivative(order)
        knots, degree = derivative.t, derivative.k
        ends = np.unique(knots)
        cuts = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(1, pieces) / pieces
        finer = np.sort(np.concatenate([knots, cuts.ravel()]))
        # scipy fills the control points with zeros up to the number of knots
        control_points = derivative.c[: len(knots) - degree - 1]
        return np.asarray(_refinement(knots, finer, degree) @ control_points)

    def to_dict(self) -> dict[str, Any]:
        """Return the basis as JSON content."""
        return {"type": "spline", "degree": self.degree, "knots": self.knots.tolist()}

    def _spline(self, coefficients: Array) -> BSpline:
        from scipy.interpolate import BSpline

        return BSpline(self.knots, coefficients, self.degree)


def _check_knots(knots: Array, degree: int) -> None:
    count, end = degree + 1, len(knots) - degree - 1
    clamped = count <= end and np.all(knots[:count] == 0) and np.all(knots[end:] == knots[-1])
    inside, spans = knots[count:end], np.diff(knots)
    ordered = clamped and np.all(np.isfinite(knots)) and np.all(spans >= 0)
    if not (ordered and knots[-1] > 0 and np.all((inside > 0) & (inside < knots[-1]))):
        raise ExcitationError(
            f"knots of degree {degree} must be {count} zeros, then rising times, then "
            f"{count} times the duration, found {shown(knots.tolist())}"
        )
    near = (spans > 0) & (spans < _LEAST_SPAN * knots[-1])
    if np.any(near):
        i = int(np.argmax(near))
        raise ExcitationError(
            f"knots at different times must be at least {_LEAST_SPAN:g} of the duration apart, "
            f"found {knots[i]:.9g} and {knots[i + 1]:.9g} s"
        )
    # a knot of multiplicity m has p - m continuous derivatives, and the acceleration needs two
    if np.unique(inside, return_counts=True)[1].max(initial=0) > degree - 2:
        raise ExcitationError(
            f"a knot of degree {degree} is repeated more than {degree - 2} times: "
            "the acceleration would jump there"
        )


def _refinement(knots: Array, finer: Array, degree: int) -> Array:
    """Return the matrix from control points to those of the same curve on finer knots.

    Oslo algorithm (Cohen, Lyche and Riesenfeld 1980): control point i of the finer curve is the
    polar form at its knots s[i+1] .. s[i+degree], by the recursion of de Boor.
    """
    index = np.arange(len(finer) - degree - 1)
    # The span is that of the Greville abscissa, the mean of the knots: from there the polar form is
    # extrapolated least. The knot in their middle could be a repeated one, where the support ends.
    middle = finer[index[:, None] + np.arange(1, degree + 1)].mean(axis=1)
    span = np.searchsorted(knots, middle, side="right") - 1
    span = np.clip(span, degree, len(knots) - degree - 2)
    # (C, degree + 1, K): the control points c[span-degree] .. c[span] that meet in each span
    points = np.eye(len(knots) - degree - 1)[span[:, None] + np.arange(-degree, 1)]
    for level in range(1, degree + 1):
        j = span[:, None] + np.arange(level - degree, 1)
        low, high = knots[j], knots[j + degree + 1 - level]
        # d[j] <- (1 - w) d[j-1] + w d[j],  w = (s[i+level] - t[j]) / (t[j+degree+1-level] - t[j])
        share = ((finer[index + level, None] - low) / (high - low))[:, :, None]
        points[:, level:] = (1.0 - share) * points[:, level - 1 : -1] + share * points[:, level:]
    return np.asarray(points[:, degree])
