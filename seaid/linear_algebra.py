"""Factorisations of numpy and scipy of which a failure is an error of seaid, in words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from seaid.errors import IdentificationError, SeaidError


def safely(
    function: Callable[..., Any],
    *matrices: Any,
    what: str,
    error: type[SeaidError] = IdentificationError,
    **options: Any,
) -> Any:
    """Return function(*matrices, **options); no LinAlgError of numpy or scipy comes out of it.

    `what` the matrices are stands in the message of `error`: they are singular, not finite, which
    some kernels answer with NaN and others with a failure, or so different in size that the
    iteration inside does not end.
    """
    bad = sum(np.size(one) - int(np.count_nonzero(np.isfinite(one))) for one in matrices)
    if bad:
        raise _error(what, f"{bad} numbers that are not finite", matrices, error)
    try:
        return function(*matrices, **options)
    except np.linalg.LinAlgError as problem:
        raise _error(what, str(problem).lower(), matrices, error) from None


def _error(what: str, found: str, matrices: tuple[Any, ...], error: type[SeaidError]) -> SeaidError:
    sizes = [np.max(np.abs(one), initial=0.0, where=np.isfinite(one)) for one in matrices]
    return error(
        f"{what} cannot be solved: {found}, in sizes up to {max(sizes):.3g}. Check the units and "
        "sizes of all that is given: lengths, masses and inertias of the robot, positions and "
        "torques of the log"
    )
