"""Several conditions in one regression: what they share has one column, what differs one for each.

A condition is a part of the name of a parameter. The rows of a condition have zeros in the columns
that only other conditions have.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, chain
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.drives import ConditionParameter, without_condition
from seaid.errors import IdentificationError
from seaid.estimation.estimate import Estimate, TermTest, independent_rows, term_test
from seaid.estimation.fitting import FittedRows
from seaid.estimation.least_squares import settled_weights
from seaid.estimation.qr_factor import qr_factor_of
from seaid.regressor import stacked

if TYPE_CHECKING:
    from seaid.regressor import Regression

IsSpecific = Callable[[str], bool]
"""Whether every condition has its own parameter of a name."""


def names_of_all(
    names: Sequence[str], conditions: Sequence[str], is_specific: IsSpecific
) -> tuple[str, ...]:
    """Return the names of all columns of conditions that have columns `names` each."""
    return tuple(
        chain.from_iterable(
            [ConditionParameter(name, condition) for condition in conditions]
            if is_specific(name)
            else [name]
            for name in names
        )
    )


def places_of(names: Sequence[str], condition: str) -> list[int]:
    """Return the places of the columns that a condition has, in the order of its own names."""
    return [
        place
        for place, name in enumerate(names)
        if not isinstance(name, ConditionParameter) or name.condition == condition
    ]


def part_of(estimate: Estimate, condition: str) -> Estimate:
    """Return a condition's part of an estimate, under the names of its own columns."""
    places = places_of(estimate.names, condition)
    return estimate.part(places, [without_condition(estimate.names[place]) for place in places])


def joined_rows(
    rows: Mapping[str, Regression], is_specific: IsSpecific, propagated: Sequence[str] = ()
) -> Regression:
    """Return the rows {condition: regression} as one regression, in the order of the conditions.

    `propagated` are the names of the propagated columns. Logs are numbered through all conditions,
    as autocorrelation ends with a log. Raises IdentificationError if the conditions differ in their
    columns.
    """
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
            units=tuple(unit_of[without_condition(name)] for name in columns),
            H=_placed(part.H, columns, condition),
            propagated=_placed(part.propagated, further, condition),
        )
        for condition, part in rows.items()
    ]
    counts = (int(np.max(part.run, initial=-1.0)) + 1 for part in parts)
    starts = accumulate(counts, initial=0)
    run = np.concatenate([part.run + start for part, start in zip(parts, starts, strict=False)])
    return replace(stacked(parts), run=run)


def _placed(columns: Array, names: Sequence[str], condition: str) -> Array:
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


def differences(fit: FittedRows) -> dict[str, TermTest]:
    """Return {specific parameter: test of whether the conditions differ in it}."""
    groups: dict[str, list[int]] = {}
    for place, name in enumerate(fit.estimate.names):
        if isinstance(name, ConditionParameter):
            groups.setdefault(name.name, []).append(place)
    assert fit.rows is not None
    names, change = fit.rows.names, np.eye(len(fit.rows.names))
    for places in groups.values():
        # theta_c = theta_1 + delta_c, so that H theta = (H change) (theta_1, delta_2, ...).
        change[places, places[0]] = 1.0
    independent = independent_rows(fit.qr_factor, fit.estimate)
    # Each F test needs degrees of freedom of the residual.
    if not groups or independent <= len(names):
        return {}
    qr_factor = qr_factor_of(replace(fit.rows, H=fit.rows.H @ change))
    weights = settled_weights(qr_factor)
    return {
        name: term_test(qr_factor, weights, [names[place] for place in places[1:]], independent)
        for name, places in groups.items()
    }
