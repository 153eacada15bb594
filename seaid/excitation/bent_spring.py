"""How far a spring that is no straight line is stretched by a force, and how that changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seaid.arrays import Array
from seaid.drivetrain.model import SeriesElasticDrive
from seaid.errors import ExcitationError

_SOFTEST = 0.1
"""Where a spring is softer than this part of its stiffness at zero it is continued straight."""

_CROSSING = 0.5
"""A dead zone is crossed while the spring behind it stretches by this part of the zone."""

_HALVINGS = 64


@dataclass(frozen=True, eq=False)
class BentSpring:
    """force = preload + k d + k_3 d^3 + k_5 d^5, d = stretch less `zero` less a dead zone `gap`.

    From the deflection `end` on it is continued straight, so that every force has one stretch.
    """

    coefficients: tuple[float, float, float]
    preload: float
    zero: float
    gap: float
    end: float

    def stretch(self, force: Array) -> tuple[Array, Array]:
        """Return the stretch under a force (any shape) from the spring's zero, and its slope."""
        pull = np.abs(force - self.preload)
        low, high = np.zeros_like(pull), pull / (_SOFTEST * self.coefficients[0])
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            short = self._pull(middle)[0] < pull
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        d = np.sign(force - self.preload) * high
        slope = 1.0 / self._pull(high)[1]
        if self.gap == 0:
            return d, slope
        crossing = np.tanh(d / (_CROSSING * self.gap))
        return d + self.gap * crossing, slope * (1 + (1 - crossing**2) / _CROSSING)

    def _pull(self, d: Array) -> tuple[Array, Array]:
        """Return force without preload and stiffness at deflections that are not negative."""
        k, k_3, k_5 = self.coefficients
        x = np.minimum(d, self.end)
        stiffness = k + 3 * k_3 * x**2 + 5 * k_5 * x**4
        return x * (k + k_3 * x**2 + k_5 * x**4) + (d - x) * stiffness, stiffness


def bent_spring(joint: str, drive: SeriesElasticDrive) -> BentSpring:
    """Return the spring of a drive whose values are all given, at rest: damping is left out.

    Raises ExcitationError for one without linear stiffness: at zero force its motor would have no
    speed that ends.
    """
    values, terms = drive.values, drive.spring
    k = values["stiffness"] if "linear" in terms else 0.0
    if k <= 0:
        raise ExcitationError(
            f"joint '{joint}': its spring has no linear stiffness, so that no force holds its "
            "deflection at zero: where its motor goes along a planned motion cannot be told; plan "
            "for the base parameters, without parameters and limits of its drive"
        )
    k_3 = values["cubic_stiffness"] if "cubic" in terms else 0.0
    k_5 = values["fifth_stiffness"] if "fifth" in terms else 0.0
    squares = np.roots([5 * k_5, 3 * k_3, (1 - _SOFTEST) * k])
    softest = [float(root.real) for root in squares if root.imag == 0 and root.real > 0]
    return BentSpring(
        coefficients=(k, k_3, k_5),
        preload=values["deflection_offset"] if "preload" in terms else 0.0,
        zero=values.get("deflection_zero", 0.0) if drive.knows_zero else 0.0,
        gap=values["dead_zone"] if "dead_zone" in terms else 0.0,
        end=float(np.sqrt(min(softest))) if softest else np.inf,
    )
