"""Estimate: values with their covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from seaid._arrays import Array, frozen
from seaid.errors import SeaidError


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated parameters (p,): names, values, covariance (p, p), units.

    `residual_std` is the standard deviation of the residual in the pass band, in the unit of the
    rows; `condition_number` that of the regressor with columns scaled to unit norm; `flags` say in
    words what must not be trusted. `white_standard_errors` (p,) are those of the textbook for
    white noise, for comparison, where an estimator gives them.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    units: tuple[str, ...]
    residual_std: float
    condition_number: float
    flags: tuple[str, ...] = ()
    white_standard_errors: Array | None = None

    def __post_init__(self) -> None:
        p = len(self.names)
        object.__setattr__(self, "values", frozen("values", self.values, (p,)))
        object.__setattr__(self, "covariance", frozen("covariance", self.covariance, (p, p)))
        if self.white_standard_errors is not None:
            white = frozen("white_standard_errors", self.white_standard_errors, (p,))
            object.__setattr__(self, "white_standard_errors", white)

    @property
    def standard_errors(self) -> Array:
        """Standard deviation of each value (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def relative_standard_errors(self) -> Array:
        """Standard error over absolute value (p,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.standard_errors / np.abs(self.values))

    @property
    def correlation(self) -> Array:
        """Correlation matrix (p, p) of the values; 0 beside what has no error."""
        errors = self.standard_errors
        scale = np.where(errors > 0, errors, np.inf)
        correlation = np.asarray(self.covariance / np.outer(scale, scale))
        np.fill_diagonal(correlation, 1.0)
        return correlation

    def interval(self, level: float = 0.95) -> Array:
        """Return lower and upper ends (p, 2) of the normal confidence intervals."""
        if not 0 < level < 1:
            raise SeaidError(f"level must be between 0 and 1, found {level}")
        half = float(ndtri(0.5 + level / 2)) * self.standard_errors
        return np.column_stack([self.values - half, self.values + half])

    def part(self, indices: Sequence[int], names: Sequence[str]) -> Estimate:
        """Return the estimate of some of the parameters, under their names there."""
        picked, white = list(indices), self.white_standard_errors
        return replace(
            self,
            names=tuple(names),
            values=self.values[picked],
            covariance=self.covariance[np.ix_(picked, picked)],
            units=tuple(self.units[index] for index in picked),
            white_standard_errors=None if white is None else white[picked],
        )

    def value(self, name: str) -> float:
        """Return the value of one parameter by name."""
        return float(self.values[self._index(name)])

    def standard_error(self, name: str) -> float:
        """Return the standard error of one parameter by name."""
        return float(self.standard_errors[self._index(name)])

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise SeaidError(f"no parameter '{name}'; there are: {', '.join(self.names)}")
        return self.names.index(name)
