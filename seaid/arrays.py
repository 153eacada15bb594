"""The one helper behind the frozen data types: float64, shape-checked, read-only arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaid.errors import SeaidError

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def frozen(
    name: str,
    value: Any,
    shape: tuple[int | None, ...],
    error: type[SeaidError] = SeaidError,
) -> Array:
    """Return a read-only float64 copy of `value`.

    `shape` has None where any length is allowed. Raises `error` naming `name` otherwise.
    """
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError) as problem:
        raise error(f"{name} must be numbers of shape {_text(shape)}: {problem}") from None
    fits = array.ndim == len(shape) and all(
        wanted in (None, found) for wanted, found in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise error(f"{name} must have shape {_text(shape)}, found {array.shape}")
    array.setflags(write=False)
    return array


def finite(
    name: str,
    value: Any,
    shape: tuple[int | None, ...],
    error: type[SeaidError] = SeaidError,
) -> Array:
    """Return `frozen` of a value without NaN and infinity. Raises `error` naming `name`."""
    array = frozen(name, value, shape, error)
    if not np.all(np.isfinite(array)):
        raise error(f"{name} must be finite, found {array.tolist()}")
    return array


def _text(shape: tuple[int | None, ...]) -> str:
    return "(" + ", ".join("any" if length is None else str(length) for length in shape) + ")"
