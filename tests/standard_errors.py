"""Right standard errors: errors divided by them have a root mean square of one over many draws."""

from collections.abc import Mapping, Sequence

import numpy as np

from seaid._arrays import Array
from seaid.estimation import Estimate


def scores(estimate: Estimate, truth: Mapping[str, float]) -> Array:
    """Return the errors of an estimate over its standard errors, by true values of some names."""
    return np.array(
        [(estimate.value(x) - true) / estimate.standard_error(x) for x, true in truth.items()]
    )


def check_scores(scores: Sequence[Array], expected: float = 1.0, band: float = 1.14) -> None:
    """Check the root mean square of errors over standard errors, one array per independent draw.

    It must lie within a factor of `band` of `expected`, both bounds at least four of its standard
    deviations from `expected`. The parameters of one draw are correlated, so that its standard
    deviation follows from the scatter over the draws. Standard errors wrong by a factor of 1.3 fail
    at 1.14, whose square is below that, whatever is found; at 1.2, which needs half as many draws,
    if what is found is within 8 % of `expected`.
    """
    squares = np.array([np.mean(np.square(draw)) for draw in scores])
    rms = float(np.sqrt(np.mean(squares)))
    spread = float(np.std(squares) / np.sqrt(len(squares)) / (2 * rms))
    found = f"root mean square {rms:.3f} +- {spread:.3f} of {len(squares)} draws"
    assert 4 * spread < rms * (1 - 1 / band), f"{found}: take more draws"
    assert expected / band < rms < expected * band, f"{found}: expected {expected}"
