"""Rows of several conditions as one regression: shared columns once, own ones once a condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array
from seaid.errors import IdentificationError
from seaid.estimation.estimate import Estimate
from seaid.regression import Regression, stacked


@dataclass(frozen=True, eq=False)
class SharedRows:
    """Rows of all conditions, and which of their columns (p,) each condition has, in its order."""

    rows: Regression
    places: Mapping[str, tuple[int, ...]]
    names: tuple[str, ...]

    def of(self, condition: str, estimate: Estimate) -> Estimate:
        """Return a condition's part of the estimate, under the names it has there."""
        return estimate.part(self.places[condition], self.names)

    def place(self, condition: str, name: str) -> int:
        """Return the column that a parameter of a condition has."""
        return self.places[condition][self.names.index(name)]


def shared_rows(rows: Mapping[str, Regression], own: Sequence[bool]) -> SharedRows:
    """Return the regressions of conditions as one; `own` (p,) tells the columns not shared.

    An own column is named "<name> [<condition>]". Raises IdentificationError where the conditions
    do not have the same columns.
    """
    first, *others = rows
    names = rows[first].names
    for other in others:
        if rows[other].names != names:
            raise IdentificationError(
                f"condition '{first}' tells {', '.join(names)}; '{other}' tells "
                f"{', '.join(rows[other].names)}: conditions need the same sensors and terms"
            )
    columns = {name: place for place, name in enumerate(_columns(names, own, list(rows)))}
    places = {
        condition: tuple(columns[text] for text in _columns(names, own, [condition]))
        for condition in rows
    }
    units = dict(zip(names, rows[first].units, strict=True))
    wide = [
        replace(
            one,
            names=tuple(columns),
            units=tuple(units[text.split(" [")[0]] for text in columns),
            H=_placed(one.H, places[condition], len(columns)),
        )
        for condition, one in rows.items()
    ]
    offsets = np.cumsum([0, *(float(np.max(one.run, initial=0.0)) + 1 for one in wide)])
    run = np.concatenate([one.run + offset for one, offset in zip(wide, offsets, strict=False)])
    return SharedRows(replace(stacked(wide), run=run), places, names)


def placed_carried(rows: Regression, places: Sequence[int], count: int) -> Regression:
    """Return the rows with what they carry at `places` among `count` parameters."""
    return replace(rows, carried=_placed(rows.carried, places, count))


def _columns(names: Sequence[str], own: Sequence[bool], conditions: Sequence[str]) -> list[str]:
    return [
        text
        for name, is_own in zip(names, own, strict=True)
        for text in ([f"{name} [{one}]" for one in conditions] if is_own else [name])
    ]


def _placed(columns: Array, places: Sequence[int], count: int) -> Array:
    wide = np.zeros((len(columns), count))
    wide[:, list(places)] = columns
    return wide
