"""Two identifications side by side, with the significance of the difference of each parameter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf, nan, sqrt

import numpy as np
from scipy.special import chdtrc, stdtr

from seaid._progress import Display, Result, counted
from seaid.drives import ParameterName, readable
from seaid.errors import IdentificationError, checked
from seaid.estimation import Estimate
from seaid.estimation.qr_factor import scaled_svd
from seaid.identification import Identification

_LEVEL = 0.05
"""Probability that any parameter of two equal robots is called significant (Bonferroni)."""

_ASSUMPTION = (
    "The standard errors of the differences assume independent estimates. Estimates from logs in "
    "common are positively correlated: the standard errors are then upper bounds, and differences "
    "can be more significant than stated here."
)


@dataclass(frozen=True, repr=False)
class Difference(Display):
    """A parameter in two identifications, second minus first.

    Attributes
    ----------
    name, joint, unit : str
        The parameter; `joint` is that of its drive, "" for a base parameter.
    first, second, first_error, second_error : float
        Both values and their standard errors.
    p_value : float
        Probability of a difference as large as this one if the true values are equal.
    is_significant : bool
        Whether `p_value` times the number of parameters is below 0.05.
    """

    name: str
    joint: str
    unit: str
    first: float
    second: float
    first_error: float
    second_error: float
    p_value: float = nan
    is_significant: bool = False

    @property
    def change(self) -> float:
        """The second value minus the first."""
        return self.second - self.first

    @property
    def error(self) -> float:
        """The standard error of the change, of independent estimates."""
        return sqrt(self.first_error**2 + self.second_error**2)

    @property
    def relative_change(self) -> float:
        """The change over the first value."""
        return self.change / abs(self.first) if self.first else nan

    @property
    def significance(self) -> float:
        """The change over its standard error."""
        return self.change / self.error if self.error > 0 else nan

    @property
    def text(self) -> str:
        """The parameter with its joint: "stiffness of knee"."""
        return _text(self.joint, self.name)


@dataclass(frozen=True)
class GroupTest:
    """Whether the parameters of a drive, or all base parameters, differ: chi-square test."""

    chi_square: float
    freedom: int
    p_value: float


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """Two identifications side by side.

    Attributes
    ----------
    names : (str, str)
        Of the identifications, such as ("cold", "warm").
    differences : tuple of Difference
        All parameters that both have: of the drives, then the base parameters.
    only : (tuple of str, tuple of str)
        Parameters that only the first, and only the second, has.
    groups : mapping {joint or "load": GroupTest}
        Whether the parameters of a drive, or the base parameters, differ as a whole.
    """

    table_name = "comparison_table"

    names: tuple[str, str]
    differences: tuple[Difference, ...]
    only: tuple[tuple[str, ...], tuple[str, ...]]
    groups: dict[str, GroupTest]

    def _in_short(self) -> str:
        return f"{self.names[0]}, {self.names[1]}: {self.sentence.partition('. ')[0]}"

    @property
    def sentence(self) -> str:
        """How many parameters differ, and what the standard errors of the differences assume."""
        significant = sum(difference.is_significant for difference in self.differences)
        total = counted(len(self.differences), "parameter")
        return f"{significant} of {total} differ significantly. {_ASSUMPTION}"


@checked(IdentificationError)
def comparison_of(
    first: Identification, second: Identification, *, names: tuple[str, str] = ("first", "second")
) -> Comparison:
    """Compare the parameters of two identifications, such as cold and warm, or before and after.

    Parameters
    ----------
    first, second : Identification
        Two identifications of one robot, or of robots with joints in common.
    names : (str, str)
        How tables name them.

    Returns
    -------
    Comparison

    Raises
    ------
    IdentificationError
        If they have no parameter in common.

    Examples
    --------
    >>> cold, warm = (seaid.identify(robot, log) for log in (cold_log, warm_log))
    >>> for difference in seaid.report.comparison_of(cold, warm).differences:
    ...     print(difference.text, difference.first, difference.second, difference.significance)
    """
    old, new = _estimates(first), _estimates(second)
    pairs = list(_pairs(old, new))
    differences = [x for joint, *both in pairs for x in _differences(joint, *both)]
    if not differences:
        raise IdentificationError(
            f"'{first.robot.name}' and '{second.robot.name}' have no parameter in common: compare "
            "identifications of one robot, with the same known bodies"
        )
    count = len(differences)
    marked = [replace(x, is_significant=x.p_value * count < _LEVEL) for x in differences]
    groups = {joint or "load": _group_test(*both) for joint, *both in pairs}
    return Comparison(names, tuple(marked), (_only(old, new), _only(new, old)), groups)


_Estimates = Mapping[str, Estimate]
"""{joint: estimate of its drive}, and that of the load by the name ""."""


def _estimates(identification: Identification) -> _Estimates:
    return {**identification.drives, "": identification.load}


def _pairs(first: _Estimates, second: _Estimates) -> Iterator[tuple[str, Estimate, Estimate]]:
    """Yield (joint, its drive in both), then ("", the load), of the parameters that both have."""
    for joint, estimate in first.items():
        names = second[joint].names if joint in second else ()
        shared = [name for name in estimate.names if name in names]
        if shared:
            yield joint, estimate.of_names(shared), second[joint].of_names(shared)


def _text(joint: str, name: str) -> str:
    """Return a parameter with its joint, a base parameter as it is."""
    return readable(ParameterName(name, joint)) if joint else name


def _only(first: _Estimates, second: _Estimates) -> tuple[str, ...]:
    """Return the texts of the parameters that only the first has."""
    in_second = {joint: {*estimate.names} for joint, estimate in second.items()}
    return tuple(
        _text(joint, name)
        for joint, estimate in first.items()
        for name in estimate.names
        if name not in in_second.get(joint, ())
    )


def _differences(joint: str, old: Estimate, new: Estimate) -> Iterator[Difference]:
    """Yield the difference of each parameter, not yet marked as significant, with its p-value.

    `old` and `new` have the same names in the same order.
    """
    errors = np.array([old.standard_errors, new.standard_errors])
    change, variances = new.values - old.values, errors**2
    variance = variances.sum(axis=0)
    none = np.full(len(old.names), inf)
    freedoms = [none if x.degrees_of_freedom is None else x.degrees_of_freedom for x in (old, new)]
    with np.errstate(divide="ignore", invalid="ignore"):
        # Welch and Satterthwaite: (s1^2 + s2^2)^2 / (s1^4 / nu1 + s2^4 / nu2)
        freedom = 1 / np.sum((variances / variance) ** 2 / freedoms, axis=0)
        # Student's distribution is normal for infinite degrees of freedom; to double precision it
        # is so for 1e12, which `stdtr` accepts.
        p_values = 2 * stdtr(np.minimum(freedom, 1e12), -np.abs(change) / np.sqrt(variance))
    # Where neither has a standard error only equal values do not differ.
    p_values = np.where(variance == 0, np.where(change == 0, 1.0, 0.0), p_values)
    numbers = np.array([old.values, new.values, *errors, p_values]).T.tolist()
    for name, unit, row in zip(old.names, old.units, numbers, strict=True):
        yield Difference(name, joint, unit, *row)


def _group_test(old: Estimate, new: Estimate) -> GroupTest:
    """Return the chi-square test d^T (C1 + C2)^-1 d of the differences d of two estimates.

    C1 and C2 are their covariances. Without a usable parameter its values are NaN.
    """
    change = new.values - old.values
    covariance = old.covariance + new.covariance
    # A parameter without a variance (unidentifiable, or exactly zero) would decide the test alone.
    usable = np.isfinite(change) & np.isfinite(np.diag(covariance)) & (np.diag(covariance) > 0)
    if not np.any(usable):
        return GroupTest(nan, 0, nan)
    scale = np.sqrt(np.diag(covariance)[usable])
    # The correlation matrix is decomposed. Where it is singular, its rank is smaller than the
    # number of parameters, and is the degrees of freedom.
    solved = scaled_svd(covariance[np.ix_(usable, usable)] / np.outer(scale, scale))
    scores = change[usable] / scale
    chi_square = float(scores @ solved.solve(scores))
    rank = solved.rank()
    return GroupTest(chi_square, rank, float(chdtrc(rank, max(chi_square, 0.0))))
