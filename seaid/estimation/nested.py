"""Is a larger model worth it? BIC over independent rows, and prediction of blocks left out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seaid.arrays import Array, BoolArray
from seaid.errors import IdentificationError
from seaid.estimation.information import Information, information_of
from seaid.linear_algebra import safely
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
    whole: Sequence[str],
    independent: float,
    asked: int,
) -> Gain:
    """Return what a model with the columns `whole` of rows is worth beside that with `base`.

    `whole` holds what `base` can say and more, if not in the same columns. `weights` (E,) of the
    equations are held; so many `independent` rows tell as much as the correlated ones; so many
    models were `asked` about. Raises IdentificationError for too few rows, and for a model that is
    not larger.
    """
    more = len(whole) - len(base)
    if more < 1 or independent <= len(whole):
        raise IdentificationError(
            f"a comparison needs a larger model and more independent rows than its {len(whole)} "
            f"parameters, found {more} more parameters and {independent:.1f} rows"
        )
    parts = [information_of(_part(rows, block)) for block in time_blocks(rows)]
    factors = [part.weighted_factor(_of(part, rows, weights)) for part in parts]
    columns = [[rows.names.index(name) for name in names] for names in (base, whole)]
    growth = _residual(factors, columns[0]) / max(_residual(factors, columns[1]), 1e-300)
    without, within = (_left_out(factors, chosen) for chosen in columns)
    change, total = without - within, max(float(np.sum(without)), 1e-300)
    penalty = more * math.log(independent) + 2 * math.log(max(asked, 1))
    return Gain(
        bic=independent * math.log(max(growth, 1e-300)) - penalty,
        F=(independent - len(whole)) / more * (growth - 1),
        improvement=float(np.sum(change)) / total,
        improvement_std=math.sqrt(len(change)) * float(np.std(change, ddof=1)) / total,
        better=int(np.sum(change > 0)),
        blocks=len(change),
    )


def common_rows(one: Regression, other: Regression) -> tuple[Regression, Regression]:
    """Return the rows of the same equations and instants in two regressions of the same logs."""
    keys = [list(zip(rows.joint, rows.run, rows.time, strict=True)) for rows in (one, other)]
    shared = set(keys[0]) & set(keys[1])
    masks = [np.array([key in shared for key in found], dtype=bool) for found in keys]
    return _part(one, masks[0]), _part(other, masks[1])


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


def _residual(factors: Sequence[Array], columns: Sequence[int]) -> float:
    """Return the squared residual of all rows with some columns."""
    R = np.concatenate(factors)
    theta = _solved(R[:, columns], R[:, -1])
    return float(np.sum((R[:, -1] - R[:, columns] @ theta) ** 2))


def _left_out(factors: Sequence[Array], columns: Sequence[int]) -> Array:
    """Return the squared error of each block, predicted from the others with some columns."""
    errors = np.empty(len(factors))
    for place, left in enumerate(factors):
        others = np.concatenate([R for other, R in enumerate(factors) if other != place])
        theta = _solved(others[:, columns], others[:, -1])
        errors[place] = np.sum((left[:, -1] - left[:, columns] @ theta) ** 2)
    return errors


def _solved(H: Array, y: Array) -> Array:
    norms = np.linalg.norm(H, axis=0)
    norms[norms == 0] = 1.0
    return np.asarray(
        safely(np.linalg.lstsq, H / norms, y, what="the equations", rcond=_LOST)[0] / norms
    )
