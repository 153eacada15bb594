"""Is a larger model worth it? BIC over independent rows, and prediction of blocks left out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array, BoolArray
from seaid.errors import IdentificationError
from seaid.estimation.checks import term_test
from seaid.estimation.information import Information, information_of
from seaid.regression import Regression

BLOCKS = 8
"""Parts of the rows, one after the other in time, of which each is predicted from the others."""

_LOST = 1e-9


@dataclass(frozen=True, eq=False)
class Gain:
    """What a group of parameters is worth.

    `bic` is how much the extended Bayesian information criterion falls by them (Chen, Chen 2008:
    it counts how many terms were asked about; Schwarz 1978); `F` of the test that they are zero;
    `improvement` is how much smaller the squared error of blocks that were left out becomes, as a
    part of it, with `improvement_std` from the spread over the blocks; `better` of `blocks` became
    better.
    """

    bic: float
    F: float
    improvement: float
    improvement_std: float
    better: int
    blocks: int

    @property
    def is_worth_it(self) -> bool:
        """Both say so: the criterion, and the prediction by more than its standard error."""
        return self.bic > 0 and self.improvement > self.improvement_std


def gain(
    rows: Regression,
    weights: Array,
    base: Sequence[str],
    terms: Sequence[str],
    independent: float,
    asked: int,
) -> Gain:
    """Return what the columns `terms` are worth beside the columns `base` of rows.

    `weights` (E,) of the equations are held; so many `independent` rows tell as much as the
    correlated ones; so many terms were `asked` about. Raises as `term_test` does.
    """
    kept = [*base, *terms]
    places = [rows.names.index(name) for name in kept]
    picked = replace(
        rows,
        names=tuple(kept),
        units=tuple(rows.units[place] for place in places),
        H=rows.H[:, places],
    )
    test = term_test(information_of(picked), weights, terms, independent)
    parts = [information_of(_part(picked, block)) for block in time_blocks(picked)]
    factors = [part.weighted_factor(_of(part, picked, weights)) for part in parts]
    without, whole = (
        _left_out(factors, columns) for columns in (range(len(base)), range(len(kept)))
    )
    change, total = without - whole, float(np.sum(without))
    return Gain(
        bic=test.bic - 2 * math.log(max(asked, 1)),
        F=test.F,
        improvement=float(np.sum(change)) / total,
        improvement_std=math.sqrt(len(change)) * float(np.std(change, ddof=1)) / total,
        better=int(np.sum(change > 0)),
        blocks=len(change),
    )


def time_blocks(rows: Regression, count: int = BLOCKS) -> list[BoolArray]:
    """Return `count` blocks of rows, equally long in time over all runs one after the other.

    Raises IdentificationError where one of them would have fewer rows than columns.
    """
    order = np.lexsort((rows.time, rows.run))
    place = np.empty(len(order), dtype=np.intp)
    place[order] = np.arange(len(order))
    block = place * count // max(len(order), 1)
    found = [np.asarray(block == one) for one in range(count)]
    if len(order) < count * 2 or len(order) * (count - 1) / count <= rows.H.shape[1]:
        raise IdentificationError(
            f"{len(order)} rows are too few to leave out one of {count} blocks and estimate "
            f"{rows.H.shape[1]} parameters from the others: record more"
        )
    return found


def _part(rows: Regression, block: BoolArray) -> Regression:
    arrays = {
        name: getattr(rows, name)[block] for name in ("H", "y", "joint", "time", "run", "carried")
    }
    return replace(rows, **arrays)


def _of(part: Information, rows: Regression, weights: Array) -> Array:
    """Return the weights of the equations that a part has."""
    equations = np.unique(rows.joint).tolist()
    return np.array([weights[equations.index(equation)] for equation in part.equations])


def _left_out(factors: Sequence[Array], columns: range) -> Array:
    """Return the squared error of each block, predicted from the others with some columns."""
    kept = [*columns, -1]
    errors = np.empty(len(factors))
    for place, left in enumerate(factors):
        others = np.concatenate([R for other, R in enumerate(factors) if other != place])
        H, y = others[:, columns], others[:, -1]
        norms = np.linalg.norm(H, axis=0)
        norms[norms == 0] = 1.0
        theta = np.linalg.lstsq(H / norms, y, rcond=_LOST)[0] / norms
        errors[place] = np.sum((left[:, kept] @ np.append(-theta, 1.0)) ** 2)
    return errors
