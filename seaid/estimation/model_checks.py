"""Is the model right? What is checked of one regression, for a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from seaid.arrays import Array
from seaid.estimation.checks import (
    TermTest,
    Whiteness,
    independent_rows,
    poorly_told,
    term_test,
)
from seaid.estimation.estimate import Estimate
from seaid.estimation.information import Information


@dataclass(frozen=True, eq=False)
class ModelChecks:
    """What speaks for and against the model of one regression.

    `condition_number` is that of columns of unit norm; `poorly_told` names combinations of which
    the data tell little; `terms` tests each optional term of the drives; `whiteness` {joint: of its
    residual}, empty where the rows were not kept in memory.
    """

    condition_number: float
    poorly_told: tuple[str, ...]
    terms: tuple[TermTest, ...]
    whiteness: Mapping[str, Whiteness]


def model_checks(
    information: Information,
    estimate: Estimate,
    optional: Sequence[str],
    whiteness: Mapping[str, Whiteness],
    weights: Array,
) -> ModelChecks:
    """Return the checks of an estimate, from its information; `optional` terms are tested.

    `weights` (E,) of the equations are those that `settled_weights` gives.
    """
    factor = information.weighted_factor(weights)
    independent = independent_rows(information, estimate)
    return ModelChecks(
        condition_number=estimate.condition_number,
        poorly_told=tuple(poorly_told(information, factor=factor)),
        terms=tuple(
            term_test(information, weights, [name], independent, factor)
            for name in optional
            if independent > len(information.names)
        ),
        whiteness=whiteness,
    )
