"""Finite Fourier series over one period (Swevers et al. 1997): the basis "fourier"."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.errors import ExcitationError, shown


@dataclass(frozen=True)
class FourierBasis:
    """Sines and cosines of so many `harmonics` of one period, `duration` [s].

    The coefficients of a joint are the constant, then the amplitudes of the sines, then those of
    the cosines [rad or m]. The motion can run period after period without a jump, so that the runs
    can be averaged. Raises ExcitationError for less than one harmonic or no duration.
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
        """Number of coefficients a joint, 2 harmonics + 1."""
        return 2 * self.harmonics + 1

    @property
    def constant(self) -> Array:
        """The coefficients (K,) of the constant 1."""
        return np.asarray(np.eye(self.size)[0])

    @property
    def natural(self) -> Array:
        """The matrix (K, K) from variables of like size to amplitudes that fall with harmonics."""
        falling = 1.0 / np.arange(1, self.harmonics + 1)
        return np.diag(np.concatenate([[1.0], falling, falling]))

    def matrices(self, time: Array) -> tuple[Array, Array, Array]:
        """Return the matrices (T, K) of position, velocity and acceleration at times (T,) [s]."""
        number = np.arange(1, self.harmonics + 1)
        rate = 2 * np.pi * number / self.duration
        # the phase is that of the time within the period: zero at its end as at its start
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
        """Return the coefficients (K, n) of the same motion, begun at `time` [s] of its period."""
        phase = 2 * np.pi * np.arange(1, self.harmonics + 1) * (time / self.duration % 1.0)
        sine, cosine = np.sin(phase)[:, None], np.cos(phase)[:, None]
        a, b = np.split(coefficients[1:], 2)
        return np.vstack([coefficients[:1], cosine * a - sine * b, sine * a + cosine * b])

    def hull(self, order: int, density: int) -> Array:
        """Return the matrix (C, K) whose largest |row @ c| the derivative of `order` never exceeds.

        Samples, `density` a coefficient, over cos(pi harmonics / samples): near its largest value a
        series of N harmonics falls off no faster than cos(N phase) (M. Riesz 1914).
        """
        count = max(density, 2) * self.size
        time = self.duration * np.arange(count) / count
        return np.asarray(self.matrices(time)[order] / np.cos(np.pi * self.harmonics / count))

    def to_dict(self) -> dict[str, Any]:
        """Return what a JSON file keeps of the basis."""
        return {"type": "fourier", "harmonics": self.harmonics, "duration": self.duration}
