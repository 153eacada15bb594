"""Parameters of a problem, as data: what is estimated, of what, and what is known of it before.

A problem has a tuple of these, one per column of its residual blocks. Two blocks share a parameter
by naming the same quantity, owner and condition: all else is not compared.

Equations that were fitted apart share parameters by `Constraints` of their estimates: for the
covariance of least squares, the constrained values are those of the fit in which the columns of
equal parameters are their sum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, chain
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, safely
from seaid.drives import Drive, ParameterName
from seaid.drives.controller import DELAY_PARAMETER, NORMAL_95
from seaid.drives.drives import SHARED, STATED_DELAY_S, check_groups
from seaid.drives.terms import places_of
from seaid.errors import IdentificationError, RobotError, check_name
from seaid.estimation.estimate import Estimate, SharedParameter, TermTest

if TYPE_CHECKING:
    from seaid.regressor import Regression


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter before the data: an expected value, a standard deviation."""

    value: float
    std: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.value) and math.isfinite(self.std) and self.std > 0):
            raise IdentificationError(
                "a prior needs a finite value and a standard deviation above zero, found "
                f"{self.value} and {self.std}"
            )


@dataclass(frozen=True)
class Parameter:
    """One parameter of a problem; two are the same if quantity, owner and condition are.

    Attributes
    ----------
    quantity : str
        What it is: "stiffness", "viscous_friction", "command_delay", a base parameter.
    owner : str
        The joint, link, sensor or bus that has it; "" for what belongs to the robot.
    condition : str or None
        The condition of the experiments in which it has this value; None: in all of them.
    unit : str
    prior : Prior or None
        What is known of it before the data; None: nothing.
    lower, upper : float
        Bounds of a search.
    is_fixed : bool
        Whether it keeps its value, as known constants do. The standard deviation of its prior is
        then in the errors of all others, and the data do not reduce it.

    Examples
    --------
    >>> Parameter("stiffness", "knee", unit="N m/rad", lower=0.0).name
    'stiffness of knee'
    """

    quantity: str
    owner: str = ""
    condition: str | None = None
    unit: str = field(default="", compare=False)
    prior: Prior | None = field(default=None, compare=False)
    lower: float = field(default=-math.inf, compare=False)
    upper: float = field(default=math.inf, compare=False)
    is_fixed: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        if not self.lower < self.upper:
            raise IdentificationError(
                f"the bounds of {self.name} leave no value: {self.lower} to {self.upper}"
            )

    @classmethod
    def of_column(cls, name: ParameterName, unit: str = "") -> Parameter:
        """Return the parameter of a column: of a joint or a condition if the name has one."""
        return cls(name.quantity, name.owner, name.condition, unit)

    @property
    def name(self) -> ParameterName:
        """The name of its column, in text "stiffness of knee [warm]"."""
        return ParameterName(self.quantity, self.owner, self.condition)


def bounds_of(parameters: Sequence[Parameter]) -> tuple[Array, Array]:
    """Return the lower and upper bounds (p,) of a search."""
    lower, upper = (np.array([getattr(x, end) for x in parameters]) for end in ("lower", "upper"))
    return lower, upper


def priors_of(parameters: Sequence[Parameter]) -> tuple[Array, Array]:
    """Return expected values (p,) and standard deviations (p,), 0 and infinite without a prior."""
    priors = (parameter.prior for parameter in parameters)
    pairs = [(prior.value, prior.std) if prior else (0.0, math.inf) for prior in priors]
    expected, stds = np.array(pairs, dtype=float).reshape(-1, 2).T
    return expected, stds


def delay_std_s(drive: Drive) -> float:
    """Return the standard deviation [s] of a delay before an identification."""
    return float(drive.std.get("command_delay_s", STATED_DELAY_S / NORMAL_95))


def is_stated(std_s: float, stated_s: float) -> bool:
    """Return whether a delay with a standard error is as stated, and not estimated."""
    return bool(np.isclose(std_s, stated_s, rtol=1e-6))


def shared_columns(
    drives: Mapping[str, Drive], names: Sequence[ParameterName], joint: str = ""
) -> dict[ParameterName, list[int]]:
    """Return {shared parameter, with its group as owner: the places of its columns, two or more}.

    `joint` owns names without one. A condition has parameters of its own if they are specific.
    """
    places: dict[ParameterName, list[int]] = {}
    for place, name in enumerate(names):
        drive = drives.get(name.owner or joint)
        if drive is not None and drive.shared and name.quantity in SHARED:
            places.setdefault(name.at(drive.shared), []).append(place)
    return {name: columns for name, columns in places.items() if len(columns) > 1}


@dataclass(frozen=True)
class Bus:
    """Drives with one delay: the `places` of its columns, nominal value and standard deviation."""

    places: tuple[int, ...]
    nominal_s: float
    std_s: float


def buses_of(
    drives: Mapping[str, Drive], names: Sequence[ParameterName], joint: str = ""
) -> list[Bus]:
    """Return the groups of columns; drives with one nominal delay are on one bus.

    `joint` owns names without one. A condition has delays of its own if they are specific to it.
    """
    places: dict[tuple[float, float, str | None], list[int]] = {}
    for place, name in enumerate(names):
        if name.quantity == DELAY_PARAMETER:
            drive = drives[name.owner or joint]
            key = (drive.command_delay_s or 0.0, delay_std_s(drive), name.condition)
            places.setdefault(key, []).append(place)
    return [Bus(tuple(columns), near_s, std_s) for (near_s, std_s, _), columns in places.items()]


def check_buses(drives: Mapping[str, Drive]) -> None:
    """Raise RobotError for drives of one bus that state different deviations of its delay."""
    buses = dict[float, tuple[str, float]]()
    for joint, drive in drives.items():
        if drive.controller is None or DELAY_PARAMETER in drive.known:
            continue
        std_s = delay_std_s(drive)
        first, of_first_s = buses.setdefault(drive.command_delay_s or 0.0, (joint, std_s))
        if std_s != of_first_s:
            raise RobotError(
                f"[{first}] and [{joint}] have one command_delay_s, as drives of one bus do, with "
                f"the standard deviations {of_first_s:.3g} and {std_s:.3g} s "
                f"({STATED_DELAY_S / NORMAL_95:.3g} s if none is stated): give both the same "
                "command_delay_s_std, or on different buses different command_delay_s"
            )


def with_groups(
    drives: Mapping[str, Drive], share: Mapping[str, Sequence[str]]
) -> dict[str, Drive]:
    """Return drives with the groups {group: joints} of `share=`. Raises RobotError."""
    group_of: dict[str, str] = {}
    for group, joint in ((group, joint) for group, joints in share.items() for joint in joints):
        check_name("joint", joint, drives, RobotError, "share=", "share=")
        if joint in group_of:
            text = f"{joint} is in '{group_of[joint]}' and in '{group}': name it once, in one group"
            raise RobotError(f"share=: {text}", "share=")
        group_of[joint] = group
    empty = [group for group, joints in share.items() if not (group and joints)]
    if empty:
        raise RobotError(f"share=: the group '{empty[0]}' needs a name, and joints", "share=")
    changed = {x: replace(y, shared=group_of.get(x, y.shared)) for x, y in drives.items()}
    check_groups(changed, "share=")
    return changed


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints A x = b of parameters (p,), with standard deviations `stds` (c,) of the b.

    x of least squares with a covariance W (p, p) becomes P x + G b, with G = W A^T (A W A^T)^+ and
    P = 1 - G A. The places of each group in `equal` have one value.
    """

    equal: tuple[list[int], ...]
    A: Array
    b: Array
    stds: Array

    @classmethod
    def of(cls, p: int, equal: Iterable[Sequence[int]], stated: Sequence[Bus] = ()) -> Constraints:
        """Return one value for the places of each group, and that of buses of `stated` delay."""
        unit, groups = np.eye(p), tuple(map(list, equal))
        rows = [unit[first] - unit[other] for first, *others in groups for other in others]
        b, stds = np.zeros((2, len(rows) + len(stated)))
        b[len(rows) :] = [bus.nominal_s for bus in stated]
        stds[len(rows) :] = [bus.std_s for bus in stated]
        rows += [unit[bus.places[0]] for bus in stated]
        return cls(groups, np.reshape(rows, (len(rows), p)), b, stds)

    def solution(self, covariance: Array) -> tuple[Array, Array]:
        """Return P (p, p) and G (p, c) for a covariance (p, p)."""
        A = self.A
        variance = A @ covariance @ A.T
        # Stiffness and rotor inertia differ by many powers of ten: the rank is that of scaled rows.
        scale = np.sqrt(np.maximum(np.diag(variance), np.finfo(float).tiny))
        scaled = variance / np.outer(scale, scale)
        inverse = safely(np.linalg.pinv, scaled, what="the shared parameters", hermitian=True)
        G = covariance @ A.T @ (inverse / np.outer(scale, scale))
        return np.eye(len(covariance)) - G @ A, G

    def applied(self, estimate: Estimate, white_covariance: Array) -> Estimate:
        """Return an estimate under the constraints."""
        P, G = self.solution(white_covariance)
        of_data, spread = P @ estimate.covariance @ P.T, G * self.stds
        covariance = of_data + spread @ spread.T
        freedom, errors = estimate.degrees_of_freedom, estimate.white_standard_errors
        if freedom is not None:
            # Welch and Satterthwaite: the stated part of the variance has no degrees of freedom.
            with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
                freedom = freedom * (np.diag(covariance) / np.diag(of_data)) ** 2
            freedom = np.where(np.isfinite(freedom), freedom, np.inf)
        if errors is not None:
            white = np.diag(P @ white_covariance @ P.T)
            ratio = white / np.maximum(np.diag(white_covariance), 1e-300)
            errors = errors * np.sqrt(np.maximum(ratio, 0.0))
        values = P @ estimate.values + G @ self.b
        # A row with one entry states a value (that of a bus), one with two entries an equality.
        stated = np.count_nonzero(self.A, axis=1) == 1
        values[np.argmax(self.A[stated], axis=1)] = self.b[stated]
        for places in self.equal:  # the same, and not only but for rounding
            values[places] = values[places[0]]
            if freedom is not None:
                # Parts v of the variance have errors of v sqrt(2 / freedom). Their sum has at most
                # the sum of these, exactly so if all are of one fit. Welch and Satterthwaite, for
                # parts that do not depend on each other, would have more degrees of freedom.
                parts = P[places[0], places] ** 2 * np.diag(estimate.covariance)[places]
                error = np.sum(parts / np.sqrt(freedom[places]))
                freedom[places] = (np.sum(parts) / error) ** 2 if error > 0 else np.inf
        return replace(
            estimate,
            values=values,
            covariance=covariance,
            degrees_of_freedom=freedom,
            white_standard_errors=errors,
        )


def shared_parameters(
    estimate: Estimate, groups: Mapping[ParameterName, Sequence[int]], independent: float
) -> tuple[SharedParameter, ...]:
    """Return the values of each group before they are made equal, with a test of their equality.

    `groups` are {shared parameter: its places} in an estimate without constraints.
    `independent` is the number of independent rows of the estimate.
    """
    shared, p = [], len(estimate.names)
    for name, places in groups.items():
        A = Constraints.of(p, [places]).A
        change, variance = A @ estimate.values, A @ estimate.covariance @ A.T
        # The test of Wald of whether the parameters are equal.
        F = float(change @ safely(np.linalg.pinv, variance, what=name) @ change) / len(A)
        test = TermTest.of_statistic((name,), F, len(A), p, max(independent, p + 1.0))
        joints = tuple(estimate.names[place].owner for place in places)
        shared.append(SharedParameter(name, joints, tuple(estimate.values[places].tolist()), test))
    return tuple(shared)


IsSpecific = Callable[[ParameterName], bool]
"""Whether every condition has its own parameter of a name."""


def names_of_all(
    names: Sequence[ParameterName], conditions: Sequence[str], is_specific: IsSpecific
) -> tuple[ParameterName, ...]:
    """Return the names of all columns of conditions that have columns `names` each."""
    return tuple(
        chain.from_iterable(
            [name.within(condition) for condition in conditions] if is_specific(name) else [name]
            for name in names
        )
    )


def joined_rows(
    rows: Mapping[str, Regression],
    is_specific: IsSpecific,
    propagated: Sequence[ParameterName] = (),
) -> Regression:
    """Return the rows {condition: regression} as one regression, in the order of the conditions.

    `propagated` are the names of the propagated columns. Logs are numbered through all conditions,
    as autocorrelation ends with a log. Raises IdentificationError if the conditions differ in their
    columns.
    """
    from seaid.regressor.regression import stacked

    first, *others = rows
    names, units = rows[first].names, rows[first].units
    for condition in others:
        if rows[condition].names != names:
            raise IdentificationError(
                f"condition '{first}' has the parameters {', '.join(names)}; '{condition}' has "
                f"{', '.join(rows[condition].names)}: conditions need the same sensors and terms"
            )
    columns = names_of_all(names, [*rows], is_specific)
    further = names_of_all(propagated, [*rows], is_specific)
    unit_of = dict(zip(names, units, strict=True))
    parts = [
        replace(
            part,
            names=columns,
            units=tuple(unit_of[name.within(None)] for name in columns),
            H=_placed(part.H, columns, condition),
            propagated=_placed(part.propagated, further, condition),
        )
        for condition, part in rows.items()
    ]
    starts = accumulate((int(np.max(part.run, initial=-1.0)) + 1 for part in parts), initial=0)
    run = np.concatenate([part.run + start for part, start in zip(parts, starts, strict=False)])
    return replace(stacked(parts), run=run)


def _placed(columns: Array, names: Sequence[ParameterName], condition: str) -> Array:
    """Return the columns (R, c) of a condition among the columns `names` of all."""
    wide = np.zeros((len(columns), len(names)))
    wide[:, places_of(names, condition)] = columns
    return wide


@dataclass(frozen=True, eq=False)
class Share:
    """What a condition has of joined rows: which rows, and how many instants were excluded."""

    rows: slice
    excluded: int


def shares_of(rows: Mapping[str, Regression]) -> dict[str, Share]:
    """Return {condition: its share} of the `joined_rows`."""
    ends = accumulate((len(part.y) for part in rows.values()), initial=0)
    return {
        condition: Share(slice(start, start + len(part.y)), part.excluded)
        for (condition, part), start in zip(rows.items(), ends, strict=False)
    }
