"""The result of an estimator: values with their covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

from seaid._arrays import Array, frozen
from seaid._progress import MOST_NAMES, Result, counted
from seaid.errors import Finding, SeaidError, UnknownNameError, listed, shortened, unknown_name

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Result):
    """Estimated parameters with their covariance.

    Attributes
    ----------
    names, units : tuple of str
        Name and unit of each of the p parameters.
    values : ndarray (p,)
        Estimated values.
    covariance : ndarray (p, p)
        Covariance of the values, with the autocorrelation of the residual.
    residual_std : float
        Standard deviation of the residual below the cutoff, in the unit of the rows.
    condition_number : float
        Condition number of the regressor with columns scaled to unit norm.
    warnings : tuple of Finding
        Warnings about poorly determined or implausible values.
    white_standard_errors : ndarray (p,) or None
        Standard errors under the assumption of white noise, for comparison.
    degrees_of_freedom : ndarray (p,) or None
        Of Student's t in the intervals, which are wider than normal ones if few rows determine the
        standard errors. None: infinite.

    Examples
    --------
    >>> estimate.value("stiffness"), estimate.standard_error("stiffness")
    >>> estimate.interval(0.95)
    >>> estimate.to_dataframe()
    """

    table_name = "estimate_table"

    names: tuple[str, ...]
    values: Array
    covariance: Array
    units: tuple[str, ...]
    residual_std: float
    condition_number: float
    warnings: tuple[Finding, ...] = ()
    white_standard_errors: Array | None = None
    degrees_of_freedom: Array | None = None

    def _in_short(self) -> str:
        entries = zip(self.names, self.values, self.standard_errors, self.units, strict=True)
        texts = [
            f"{shortened(name, 24)} {x:.4g} +- {error:.2g} {unit}"
            for name, x, error, unit in entries
        ]
        return f"{counted(len(texts), 'parameter')}: {listed(texts, MOST_NAMES)}"

    def __post_init__(self) -> None:
        p = len(self.names)
        object.__setattr__(self, "values", frozen("values", self.values, (p,)))
        object.__setattr__(self, "covariance", frozen("covariance", self.covariance, (p, p)))
        for name in ("white_standard_errors", "degrees_of_freedom"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen(name, getattr(self, name), (p,)))

    @property
    def standard_errors(self) -> Array:
        """Standard error of each value (p,): one standard deviation."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def _freedom(self) -> Array:
        """The degrees of freedom (p,), infinite if there are none."""
        none = np.full(len(self.names), np.inf)
        return none if self.degrees_of_freedom is None else self.degrees_of_freedom

    @property
    def relative_standard_errors(self) -> Array:
        """Standard error over absolute value (p,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.standard_errors / np.abs(self.values))

    @property
    def correlation(self) -> Array:
        """Correlation matrix (p, p) of the values; 0 for parameters without a standard error."""
        errors = self.standard_errors
        scale = np.where(errors > 0, errors, np.inf)
        correlation = np.asarray(self.covariance / np.outer(scale, scale))
        np.fill_diagonal(correlation, 1.0)
        return correlation

    def interval(self, level: float = 0.95) -> Array:
        """Return the lower and upper bounds (p, 2) of the confidence intervals.

        Raises SeaidError for a `level` outside (0, 1).
        """
        if not 0 < level < 1:
            raise SeaidError(f"level must be between 0 and 1, found {level}")
        half = stdtrit(self._freedom, 0.5 + level / 2) * self.standard_errors
        return np.column_stack([self.values - half, self.values + half])

    def to_dataframe(self) -> DataFrame:
        """Return a pandas DataFrame: name, value, standard_error, unit, lower, upper (95 %).

        Raises SeaidError if pandas is not installed.
        """
        try:
            from pandas import DataFrame
        except ImportError:
            raise SeaidError("to_dataframe needs pandas: get it with pip install pandas") from None
        columns = {"value": self.values, "standard_error": self.standard_errors, "unit": self.units}
        lower, upper = self.interval().T
        return DataFrame({"name": self.names, **columns, "lower": lower, "upper": upper})

    def part(self, indices: Sequence[int], names: Sequence[str]) -> Estimate:
        """Return the estimate of the parameters at `indices`, renamed to `names`."""
        picked, white = list(indices), self.white_standard_errors
        freedom = self.degrees_of_freedom
        return replace(
            self,
            names=tuple(names),
            values=self.values[picked],
            covariance=self.covariance[np.ix_(picked, picked)],
            units=tuple(self.units[index] for index in picked),
            white_standard_errors=None if white is None else white[picked],
            degrees_of_freedom=None if freedom is None else freedom[picked],
        )

    def value(self, name: str) -> float:
        """Return the value of one parameter. Raises SeaidError for an unknown name."""
        return float(self.values[self._index(name)])

    def standard_error(self, name: str) -> float:
        """Return the standard error of one parameter. Raises SeaidError for an unknown name."""
        return float(self.standard_errors[self._index(name)])

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise UnknownNameError(unknown_name("parameter", name, self.names))
        return self.names.index(name)
