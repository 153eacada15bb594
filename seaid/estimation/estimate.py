"""The result of an estimator: values with their covariance, and its diagnostics.

Diagnostics are poorly determined directions, the significance of terms, and whiteness.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from scipy import linalg

from seaid._arrays import Array, FrozenMapping, freeze
from seaid._progress import MOST_NAMES, Result, counted
from seaid.drives import ParameterName
from seaid.drives.terms import places_of
from seaid.errors import (
    IdentificationError,
    SeaidError,
    UnknownNameError,
    checked,
    listed,
    shortened,
    unknown_name,
)
from seaid.estimation.covariance import by_instant
from seaid.estimation.qr_factor import QRFactor, directions, triangle

if TYPE_CHECKING:
    from pandas import DataFrame

    from seaid.regressor import Regression


@dataclass(frozen=True)
class Drift:
    """The drift of the torque of a joint: below `corner_hz` it is larger than the noise.

    `share` is its rms over that of the torque, without its mean; `ratio` twice the logarithm of the
    ratio of likelihoods with and without it.
    """

    joint: str
    corner_hz: float
    share: float
    ratio: float


@dataclass(frozen=True)
class Diagnostics:
    """How the errors of the rows of a fit deviate from white noise.

    `independent_rows` are those that determine the `parameters`; `scatter` is the largest ratio of
    Birge, between estimates of parts of the data, of which there are `blocks`; `growth` is the
    largest factor on a variance by the `drifts`; `instruments` {parameter: partial R^2 of its
    column}, by Shea (1997), if the estimate has instruments.
    """

    independent_rows: float = float("inf")
    parameters: int = 0
    scatter: float = 1.0
    blocks: int = 0
    drifts: tuple[Drift, ...] = ()
    growth: float = 1.0
    instruments: Mapping[str, float] = FrozenMapping({}, "parameter")


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Result):
    """Estimated parameters with their covariance.

    Attributes
    ----------
    names, units : tuples of p ParameterName and of p str
        Name and unit of each of the p parameters.
    values : ndarray (p,)
        Estimated values.
    covariance : ndarray (p, p)
        Covariance of the values, with the autocorrelation of the residual.
    residual_std : float
        Standard deviation of the residual below the cutoff, in the unit of the rows.
    condition_number : float
        Condition number of the regressor with columns scaled to unit norm.
    white_standard_errors : ndarray (p,) or None
        Standard errors under the assumption of white noise, for comparison.
    degrees_of_freedom : ndarray (p,) or None
        Of Student's t in the intervals, which are wider than normal ones if few rows determine the
        standard errors. None: infinite.
    diagnostics : Diagnostics
        How the errors of the rows deviate from white noise.

    Examples
    --------
    >>> estimate.value("stiffness"), estimate.standard_error("stiffness")
    >>> estimate.interval(0.95)
    >>> estimate.to_dataframe()
    """

    table_name = "estimate_table"

    names: tuple[ParameterName, ...]
    values: Array
    covariance: Array
    units: tuple[str, ...]
    residual_std: float
    condition_number: float
    white_standard_errors: Array | None = None
    degrees_of_freedom: Array | None = None
    diagnostics: Diagnostics = Diagnostics()

    def _in_short(self) -> str:
        entries = zip(self.names, self.values, self.standard_errors, self.units, strict=True)
        texts = [
            f"{shortened(name, 24)} {x:.4g} +- {error:.2g} {unit}"
            for name, x, error, unit in entries
        ]
        return f"{counted(len(texts), 'parameter')}: {listed(texts, MOST_NAMES)}"

    def __post_init__(self) -> None:
        p = len(self.names)
        object.__setattr__(self, "names", ParameterName.all_of(self.names))
        numbers = "values", "white_standard_errors", "degrees_of_freedom"
        freeze(self, {**dict.fromkeys(numbers, (p,)), "covariance": (p, p)})

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

    @checked(SeaidError)
    def interval(self, level: float = 0.95) -> Array:
        """Return the lower and upper bounds (p, 2) of the confidence intervals.

        Raises SeaidError for a `level` outside (0, 1).
        """
        if not 0 < level < 1:
            raise SeaidError(f"level must be between 0 and 1, found {level}")
        half = scipy.special.stdtrit(self._freedom, 0.5 + level / 2) * self.standard_errors
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
            names=ParameterName.all_of(names),
            values=self.values[picked],
            covariance=self.covariance[np.ix_(picked, picked)],
            units=tuple(self.units[index] for index in picked),
            white_standard_errors=None if white is None else white[picked],
            degrees_of_freedom=None if freedom is None else freedom[picked],
        )

    def of_names(self, names: Iterable[str]) -> Estimate:
        """Return the estimate of the parameters of these names, in their order."""
        wanted = tuple(names)
        return self.part([self._index(name) for name in wanted], wanted)

    def by_owner(self) -> dict[str, Estimate]:
        """Return what each owner, such as a joint, has of the estimate, under names without it."""
        places: dict[str, list[int]] = {}
        for place, name in enumerate(self.names):
            if owner := name.owner:
                places.setdefault(owner, []).append(place)
        return {
            owner: self.part(kept, [self.names[place].at("") for place in kept])
            for owner, kept in places.items()
        }

    def at(self, owner: str) -> Estimate:
        """Return the estimate under the names that an owner gives to its parameters."""
        return replace(self, names=tuple(name.at(owner) for name in self.names))

    @staticmethod
    def joined(estimates: Iterable[Estimate]) -> Estimate:
        """Return estimates without correlation as one, whose residual is that of the first."""
        parts = list(estimates)
        return replace(
            parts[0],
            names=tuple(name for part in parts for name in part.names),
            values=np.concatenate([part.values for part in parts]),
            covariance=linalg.block_diag(*(part.covariance for part in parts)),
            units=tuple(unit for part in parts for unit in part.units),
            white_standard_errors=_concatenated(part.white_standard_errors for part in parts),
            degrees_of_freedom=_concatenated(part.degrees_of_freedom for part in parts),
        )

    def with_further(self, further: Estimate, by: Sequence[str], slopes: Array) -> Estimate:
        """Return the estimate with further values, whose errors contain those of present ones.

        `slopes` (q, k) are the derivatives of the further values by those of the names `by`; the
        covariance of `further` is without them. This is the covariance of stacked moments,
        A^-1 B A^-T with a block-triangular A (Newey and McFadden 1994, section 6).
        """
        whole, p = Estimate.joined([self, further]), len(self.names)
        if not len(by):
            return whole
        covariance = whole.covariance.copy()
        across = slopes @ self.covariance[[self._index(name) for name in by]]
        covariance[p:, :p], covariance[:p, p:] = across, across.T
        covariance[p:, p:] += across[:, [self._index(name) for name in by]] @ slopes.T
        return replace(whole, covariance=covariance)

    def transformed(self, values: Array, slopes: Array) -> Estimate:
        """Return the estimate of functions of the values, with their derivatives `slopes` (p, p).

        The covariance is that of the delta method.
        """
        white = self.white_standard_errors
        return replace(
            self,
            values=values,
            covariance=slopes @ self.covariance @ slopes.T,
            white_standard_errors=None if white is None else np.sqrt(slopes**2 @ white**2),
        )

    def of_condition(self, condition: str) -> Estimate:
        """Return what a condition has of the estimate, under the names of its own columns."""
        places = places_of(self.names, condition)
        return self.part(places, [self.names[x].within(None) for x in places])

    @property
    def by_name(self) -> dict[str, float]:
        """The values by the names of their parameters."""
        return dict(zip(map(str, self.names), self.values.tolist(), strict=True))

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


def _concatenated(parts: Iterable[Array | None]) -> Array | None:
    """Return arrays as one, None if one of them is missing."""
    present = list(parts)
    known = [part for part in present if part is not None]
    return np.concatenate(known) if len(known) == len(present) else None


POORLY_DETERMINED = 1e-2
"""Singular value, relative to the largest, below which a combination is poorly determined."""

_WHITENESS_LAGS = 10
"""Largest lag [rows] of the autocorrelations that are tested together (Ljung and Box 1978)."""


@dataclass(frozen=True, eq=False)
class TermTest:
    """Significance of a group of parameters.

    `growth` is the sum of squared residuals without the `terms` over that with them; `F` and
    `p_value` test the hypothesis that they are zero; `bic` is the Bayesian information criterion
    (Schwarz 1978) without the terms minus that with them, positive if the data support them;
    `independent` is the number of independent rows assumed.
    """

    terms: tuple[str, ...]
    growth: float
    F: float
    p_value: float
    bic: float
    independent: float

    @classmethod
    def of_statistic(
        cls, terms: Sequence[str], F: float, q: int, p: int, independent: float
    ) -> TermTest:
        """Return the test with a statistic F of q constraints on p parameters."""
        # F = ((SSR_0 - SSR) / q) / (SSR / (n - p)), with n the number of independent rows.
        growth = 1 + q * F / (independent - p)
        return cls(
            terms=tuple(terms),
            growth=growth,
            F=F,
            p_value=float(scipy.special.fdtrc(q, independent - p, max(F, 0.0))),
            # Schwarz 1978: BIC = n log(SSR / n) + p log n, without the terms minus with them.
            bic=float(independent * np.log(growth) - q * np.log(independent)),
            independent=independent,
        )


@dataclass(frozen=True, eq=False)
class SharedParameter:
    """A parameter that the drives of a group share.

    `name` is that of the group, "stiffness of calf_motor"; `values` are those that the `joints`
    would have alone, and `difference` tests whether they differ.
    """

    name: ParameterName
    joints: tuple[str, ...]
    values: tuple[float, ...]
    difference: TermTest


@dataclass(frozen=True, eq=False)
class Whiteness:
    """Autocorrelation of the residual of one equation.

    `first` is the autocorrelation at lag one; `durbin_watson` is 2 for white noise and 0 for a
    constant; `p_value` is that of Ljung and Box (1978) for no autocorrelation over ten lags. Rows
    behind a low pass are autocorrelated even if the model is complete.
    """

    first: float
    durbin_watson: float
    p_value: float


def poorly_determined(
    qr_factor: QRFactor, share: float = POORLY_DETERMINED, factor: Array | None = None
) -> list[str]:
    """Return a sentence per combination with a singular value below `share`, worst first.

    Columns are scaled to unit norm, and the largest singular value counts as 1. `factor`
    (p+1, p+1) is the weighted factor; None: all rows have weight one.
    """
    factor = qr_factor.weighted_factor() if factor is None else factor
    combinations = directions(factor, qr_factor.names)
    return [
        f"scaled singular value {combinations.shares[place]:.1e} of the combination "
        f"{combinations.text(int(place))}"
        for place in np.flatnonzero(combinations.shares < share)[::-1]
    ]


def independent_errors(stds: Mapping[str, float]) -> Estimate:
    """Return independent errors {name: standard deviation} as an estimate of zeros."""
    errors = np.array([*stds.values()], dtype=float)
    return Estimate(
        names=ParameterName.all_of(stds),
        values=np.zeros(len(stds)),
        covariance=np.diag(errors**2),
        units=("",) * len(stds),
        residual_std=float("nan"),
        condition_number=float("nan"),
        white_standard_errors=errors,
        degrees_of_freedom=np.full(len(stds), np.inf),
    )


def independent_rows(qr_factor: QRFactor, estimate: Estimate) -> float:
    """Return the number of independent rows that give the standard errors of the correlated ones.

    It is the number of rows over the median ratio of the variances to those for white noise.
    """
    white = estimate.white_standard_errors
    if white is None or not len(white) or not np.all(white > 0):
        return float(qr_factor.count)
    inflation = float(np.median((estimate.standard_errors / white) ** 2))
    return qr_factor.count / max(inflation, 1.0)


def term_test(
    qr_factor: QRFactor,
    weights: Array,
    terms: Sequence[str],
    independent: float | None = None,
    factor: Array | None = None,
) -> TermTest:
    """Return the significance of a group of `terms`, from the QR factor alone.

    `weights` (E,) of the equations are kept; `factor` is the weighted factor if available;
    `independent` is the number of independent rows (default: all rows, right for white noise), see
    `independent_rows`. Raises IdentificationError for unknown terms, and unless there are more
    independent rows than parameters.
    """
    for term in terms:
        if term not in qr_factor.names:
            raise IdentificationError("terms=: " + unknown_name("parameter", term, qr_factor.names))
    rows = float(qr_factor.count) if independent is None else independent
    p, q = len(qr_factor.names), len(terms)
    if rows <= p or not q:
        raise IdentificationError(
            f"a test needs terms and more independent rows than parameters, found {q} terms, "
            f"{rows:.1f} rows and {p} parameters"
        )
    R = qr_factor.weighted_factor(weights) if factor is None else factor
    dropped = {place for place, name in enumerate(qr_factor.names) if name in terms}
    first = min(dropped)
    below = sorted({*range(first, p + 1)} - dropped)  # columns before stay triangular
    # R[-1, -1] is the norm of the residual of y on all columns before it.
    full, fewer = R[-1, -1] ** 2, triangle(R[first:, below])[-1, -1] ** 2
    growth = float(fewer / full) if full > 0 else float("inf")
    return TermTest.of_statistic(terms, (rows - p) / q * (growth - 1), q, p, rows)


def whiteness(rows: Regression, theta: Array) -> dict[int, Whiteness]:
    """Return the autocorrelation of the residual of each equation, by joint index."""
    residual = rows.y - rows.H @ theta
    by_joint = {}
    for joint in np.unique(rows.joint):
        mask = rows.joint == joint
        count = int(np.sum(mask))
        # (rows,) -> per log (T, 2) at every instant, zero without a row: lags are steps of time.
        columns = np.column_stack([residual[mask], np.ones(count)])
        runs = by_instant(columns, np.ones(count), rows.time[mask], rows.run[mask])
        lagged, pairs = np.array([_lagged(runs, lag) for lag in range(_WHITENESS_LAGS + 1)]).T
        r = lagged[1:] / lagged[0] if lagged[0] > 0 else np.zeros(_WHITENESS_LAGS)
        # Ljung and Box 1978: r_l has the variance (n - l) / (n (n + 2)), where n - l is the number
        # of pairs of rows l steps apart. Logs and gaps have fewer, and no pair tests nothing.
        Q = count * (count + 2) * np.sum(r**2 / np.maximum(pairs[1:], 1))
        tested = int(np.sum(pairs[1:] > 0))
        changes = sum(float(np.sum(np.diff(run[:, 0]) ** 2)) for run in runs)
        by_joint[int(joint)] = Whiteness(
            first=float(r[0]),
            durbin_watson=changes / lagged[0] if lagged[0] > 0 else 2.0,
            p_value=float(scipy.special.chdtrc(tested, Q)) if tested else 1.0,
        )
    return by_joint


def _lagged(runs: Sequence[Array], lag: int) -> Array:
    """Return the sums (c,) of the products of columns of logs (T, c) with those `lag` later."""
    products = [np.sum(run[lag:] * run[: max(len(run) - lag, 0)], axis=0) for run in runs]
    return np.asarray(np.sum(products, axis=0))


@dataclass(frozen=True, eq=False)
class ModelChecks:
    """Checks of the model of one regression.

    `condition_number` is that of columns of unit norm; `poorly_determined` names combinations that
    the data determine poorly; `terms` tests each optional term of the drives; `whiteness` {joint:
    `Whiteness` of its residual} is empty if the rows were not kept in memory.
    """

    condition_number: float
    poorly_determined: tuple[str, ...]
    terms: tuple[TermTest, ...]
    whiteness: Mapping[str, Whiteness]


def model_checks(
    qr_factor: QRFactor,
    estimate: Estimate,
    optional: Sequence[str],
    whiteness: Mapping[str, Whiteness],
    weights: Array,
) -> ModelChecks:
    """Return the checks of an estimate from its QR factor and the `settled_weights`."""
    factor = qr_factor.weighted_factor(weights)
    independent = independent_rows(qr_factor, estimate)
    return ModelChecks(
        condition_number=estimate.condition_number,
        poorly_determined=tuple(poorly_determined(qr_factor, factor=factor)),
        terms=tuple(
            term_test(qr_factor, weights, [name], independent, factor)
            for name in optional
            if independent > len(qr_factor.names)
        ),
        whiteness=whiteness,
    )
