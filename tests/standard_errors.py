"""Right standard errors: errors divided by them have a root mean square of one over many draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seaid._arrays import Array

FACTOR = 1.3
"""Standard errors wrong by this factor must fail a test."""


def check_scores(scores: Sequence[Array], expected: float = 1.0, band: float = 1.14) -> None:
    """Check the root mean square of errors over standard errors, one array per independent draw.

    It must lie within a factor of `band` of `expected`; 1.14 squared is below FACTOR, so that no
    value within the bounds stays there if it is scaled by FACTOR. The parameters of one draw are
    correlated: how sure the root mean square is follows from its scatter over the draws, and both
    bounds must be four standard deviations from `expected`.
    """
    squares = np.array([np.mean(np.square(draw)) for draw in scores])
    rms = float(np.sqrt(np.mean(squares)))
    spread = float(np.std(squares) / np.sqrt(len(squares)) / (2 * rms))
    found = f"root mean square {rms:.3f} +- {spread:.3f} of {len(squares)} draws"
    assert 4 * spread < expected * (1 - 1 / band), f"{found}: take more draws"
    assert expected / band < rms < expected * band, f"{found}: expected {expected}"
    assert rms / FACTOR < expected / band, f"{found}: too small by {FACTOR} would pass"
    assert rms * FACTOR > expected * band, f"{found}: too large by {FACTOR} would pass"
