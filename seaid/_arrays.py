"""Checked read-only arrays, mappings and numbers, and linear algebra with errors of seaid."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from numbers import Real
from typing import Any, NoReturn, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from seaid.errors import (
    IdentificationError,
    SeaidError,
    UnknownNameError,
    reason_of,
    shown,
    unknown_name,
)

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]
Shape = tuple[int | None, ...]
"""The shape of an array, with None where any length is allowed."""

Value = TypeVar("Value")

MOST_SAMPLES = 10_000_000
"""Largest number of samples of a motion that is written or simulated."""


class FrozenMapping(dict[str, Value]):
    """A read-only copy of a mapping, which can be hashed and pickled.

    `kind` is what its names are, for messages.
    """

    def __init__(self, items: Mapping[str, Value], kind: str = "entry") -> None:
        super().__init__(items)
        self._kind = kind

    def __missing__(self, name: str) -> NoReturn:
        raise UnknownNameError(unknown_name(self._kind, name, self))

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))

    def __reduce__(self) -> tuple[type[Self], tuple[dict[str, Value], str]]:
        return type(self), (dict(self), self._kind)

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError("a FrozenMapping is read-only, and dict(...) of it is a copy that is not")

    __setitem__ = __delitem__ = __ior__ = _refuse
    update = setdefault = pop = popitem = clear = _refuse


def frozen(name: str, value: Any, shape: Shape, error: type[SeaidError] = SeaidError) -> Array:
    """Return a read-only float64 copy of a value; raise `error` naming `name` for other shapes."""
    wanted = str(shape).replace("None", "any").replace(",)", ")")
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError) as problem:
        raise error(f"{name} must be numbers of shape {wanted}: {reason_of(problem)}") from None
    lengths = zip(shape, array.shape, strict=False)
    if array.ndim != len(shape) or any(x not in (None, length) for x, length in lengths):
        raise error(f"{name} must have shape {wanted}, found {array.shape}")
    array.setflags(write=False)
    return array


def finite(name: str, value: Any, shape: Shape, error: type[SeaidError] = SeaidError) -> Array:
    """Return `frozen` of a value. Raises `error` naming `name` for NaN and infinity."""
    array = frozen(name, value, shape, error)
    if bad := np.count_nonzero(~np.isfinite(array)):
        described = array.tolist() if array.size <= 10 else f"{bad} of {array.size} that are not"
        raise error(f"{name} must be finite, found {described}")
    return array


def freeze(item: Any, shapes: Mapping[str, Shape], error: type[SeaidError] = SeaidError) -> None:
    """Replace fields of a frozen dataclass by `frozen` arrays of these shapes; None stays None."""
    for name, shape in shapes.items():
        if (value := getattr(item, name)) is not None:
            object.__setattr__(item, name, frozen(name, value, shape, error))


def as_float(value: Any) -> float:
    """Return a number as float64; infinite if it is too large."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def number(name: str, value: Any, error: type[SeaidError] = SeaidError) -> float:
    """Return a number as float64. Raises `error` naming `name` for other types, bool included."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise error(f"{name} must be a number, found {shown(value)}")
    return as_float(value)


def check_rate(
    rate_hz: Any, duration: float, least: float = 0.0, error: type[SeaidError] = SeaidError
) -> None:
    """Raise `error` for a rate [1/s] not above `least`, or one that makes too many samples."""
    rate = number("rate_hz", rate_hz, error)
    if not least < rate < math.inf:
        raise error(f"rate_hz must be finite and more than {least:g}, found {rate}", "rate_hz")
    if duration * rate > MOST_SAMPLES:
        most = f"{MOST_SAMPLES / duration:.4g}, with which there are {MOST_SAMPLES:,} samples"
        raise error(f"rate_hz must be at most {most}, found {rate:g}", "rate_hz")


def connected_groups(links: BoolArray) -> list[list[int]]:
    """Return the connected components of an undirected graph (n, n), each in rising order."""
    from scipy.sparse.csgraph import connected_components

    count, labels = connected_components(links, directed=False)
    return [np.flatnonzero(labels == label).tolist() for label in range(count)]


def spaced(values: Iterable[float]) -> str:
    """Return numbers as an attribute of XML: with spaces between them, in full precision."""
    return " ".join(repr(float(value)) for value in values)


def safely(
    function: Callable[..., Any],
    *matrices: Any,
    what: str,
    error: type[SeaidError] = IdentificationError,
    **options: Any,
) -> Any:
    """Return function(*matrices, **options); raise `error` in place of a LinAlgError.

    `what` names the matrices in the message. Matrices that are not finite are refused beforehand,
    because some LAPACK kernels return NaN for them and others fail.
    """
    bad = sum(np.size(matrix) - int(np.count_nonzero(np.isfinite(matrix))) for matrix in matrices)
    try:
        if bad:
            raise np.linalg.LinAlgError(f"{bad} numbers that are not finite")
        return function(*matrices, **options)
    except np.linalg.LinAlgError as problem:
        sizes = [np.max(np.abs(x), initial=0.0, where=np.isfinite(x)) for x in matrices]
        raise error(
            f"{what} cannot be solved: {str(problem).lower()}, in sizes up to {max(sizes):.3g}. "
            "Check the units and sizes of all inputs: lengths, masses and inertias of the robot, "
            "positions and torques of the log"
        ) from None


def is_constant(values: Array) -> bool:
    """Return whether all samples (T,) of a channel are the same finite number."""
    return bool(len(values) and np.all(np.isfinite(values)) and np.ptp(values) == 0.0)


def resolution(values: Array) -> float:
    """Return the resolution of a channel (T,): its smallest change, 0 for a constant channel."""
    changes = np.abs(np.diff(np.unique(values[np.isfinite(values)])))
    largest = np.max(np.abs(values[np.isfinite(values)]), initial=0.0)
    # Conversions of units split equal values by rounding; what is left are true steps, of which the
    # smallest may be an outlier of rounded decimals.
    changes = changes[changes > 1e-9 * largest]
    return float(np.percentile(changes, 5)) if len(changes) else 0.0


def white_noise(values: Array, *, robust: bool = False) -> float:
    """Return the standard deviation of the white noise of a channel (T,), from second differences.

    They have 1 + 4 + 1 times its variance. With `robust` outliers and jumps count little: 0.6745
    standard deviations are the median of their sizes, which is zero for a coarse encoder.
    """
    changes = np.diff(values, 2)
    size = np.median(np.abs(changes)) / 0.6745 if robust else np.std(changes)
    return float(size) / math.sqrt(6)


def runs(mask: BoolArray) -> IndexArray:
    """Return the first sample and the end (R, 2) of each run of true values in `mask` (T,)."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return np.column_stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)])
