"""Finite Fourier series over one period (Swevers et al. 1997): the basis "fourier"."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.errors import ExcitationError, shown


@dataclass(frozen=True)
class FourierBasis:
    """A finite Fourier series over one period.

    The coefficients of a joint are the constant, then the amplitudes of the sines, then those of
    the cosines [rad or m]. The motion can be repeated without a jump, so that periods can be
    averaged.

    Parameters
    ----------
    harmonics : int
        Number of harmonics, at least 1.
    duration : float
        The period [s].
    """

    harmonics: int
    duration: float

    def __post_init__(self) -> None:
        if not (self.harmonics >= 1 and self.harmonics == int(self.harmonics)):
            raise ExcitationError(
                f"harmonics must be a whole number of at least 1, found {shown(self.harmonics)}"
            )
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise ExcitationError(
                f"duration must be more than zero seconds, found {shown(self.duration)}"
            )

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
        falling = 1.0 / np.arange(1, self.harmonics + 1)
        return np.diag(np.concatenate([[1.0], falling, falling]))

    def matrices(self, time: Array) -> tuple[Array, Array, Array]:
        """Return the matrices (T, K) of position, velocity and acceleration at times (T,) [s]."""
        number = np.arange(1, self.harmonics + 1)
        rate = 2 * np.pi * number / self.duration
        # modulo the period, so that the end gives exactly the values of the start
        phase = 2 * np.pi * np.outer(np.asarray(time) / self.duration % 1.0, number)
        sine, cosine = np.sin(phase), np.cos(phase)
        one = np.ones((len(phase), 1))
        return (
            np.hstack([one, sine, cosine]),
            np.hstack([0 * one, rate * cosine, -rate * sine]),
            np.hstack([0 * one, -(rate**2) * sine, -(rate**2) * cosine]),
        )

    def states(self, time: Array, coefficients: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (T, n) of coefficients (K, n) at times."""
        position, velocity, acceleration = self.matrices(time)
        return position @ coefficients, velocity @ coefficients, acceleration @ coefficients

    def shifted(self, coefficients: Array, time: float) -> Array:
        """Return the coefficients (K, n) of the motion started at `time` [s] of its period."""
        phase = 2 * np.pi * np.arange(1, self.harmonics + 1) * (time / self.duration % 1.0)
        sine, cosine = np.sin(phase)[:, None], np.cos(phase)[:, None]
        a, b = np.split(coefficients[1:], 2)
        return np.vstack([coefficients[:1], cosine * a - sine * b, sine * a + cosine * b])

    def hull(self, order: int, density: int) -> Array:
        """Return the matrix (C, K) whose largest |row @ c| bounds the derivative of `order`."""
        count = max(density, 2) * self.size
        time = self.duration * np.arange(count) / count
        # M. Riesz (1914): around a maximum M of |s|, |s(phase)| >= M cos(N phase) for N harmonics,
        # so the largest of C equally spaced samples is at least M cos(pi N / C)
        return np.asarray(self.matrices(time)[order] / np.cos(np.pi * self.harmonics / count))

    def to_dict(self) -> dict[str, Any]:
        """Return the basis as JSON content."""
        return {"type": "fourier", "harmonics": self.harmonics, "duration": self.duration}
