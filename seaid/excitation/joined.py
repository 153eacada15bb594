"""Motions one after another as one motion: its basis is that of the parts, side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid.arrays import Array, BoolArray
from seaid.errors import ExcitationError

if TYPE_CHECKING:
    from seaid.excitation.basis import Basis


@dataclass(frozen=True, eq=False)
class JoinedBasis:
    """Bases over consecutive intervals, each with its own coefficients, stacked in their order.

    That the motion goes on smoothly where parts meet is up to the coefficients; there, the later
    part counts. Raises ExcitationError without a part.
    """

    parts: tuple[Basis, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts:
            raise ExcitationError("a joined basis needs at least one part, found none")

    @cached_property
    def starts(self) -> tuple[float, ...]:
        """When each part starts, then the end of the last [s]."""
        durations = [part.duration for part in self.parts]
        return (0.0, *np.cumsum(durations).tolist())

    @property
    def duration(self) -> float:
        """End of the motion [s]; it starts at 0."""
        return self.starts[-1]

    @property
    def size(self) -> int:
        """Number of coefficients a joint, those of all parts."""
        return sum(part.size for part in self.parts)

    @property
    def constant(self) -> Array:
        """The coefficients (K,) of the constant 1."""
        return np.concatenate([part.constant for part in self.parts])

    @property
    def natural(self) -> Array:
        """The matrix (K, K) from variables of like size to coefficients, block by block."""
        return _block_diagonal([part.natural for part in self.parts])

    def matrices(self, time: Array) -> tuple[Array, Array, Array]:
        """Return the matrices (T, K) of position, velocity and acceleration at times (T,) [s]."""
        found = np.zeros((3, len(time), self.size))
        for part, columns, here, local in self._pieces(time):
            found[:, here, columns] = part.matrices(local)
        return found[0], found[1], found[2]

    def states(self, time: Array, coefficients: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (T, n) of coefficients (K, n) at times."""
        found = np.empty((3, len(time), coefficients.shape[1]))
        for part, columns, here, local in self._pieces(time):
            found[:, here] = part.states(local, coefficients[columns])
        return found[0], found[1], found[2]

    def hull(self, order: int, density: int) -> Array:
        """Return the matrix (C, K) whose largest |row @ c| the derivative of `order` never exceeds.

        Those of the parts, block by block.
        """
        return _block_diagonal([part.hull(order, density) for part in self.parts])

    def to_dict(self) -> dict[str, Any]:
        """Return what a JSON file keeps of the basis."""
        return {"type": "joined", "parts": [part.to_dict() for part in self.parts]}

    def _pieces(self, time: Array) -> Iterator[tuple[Basis, slice, BoolArray, Array]]:
        """Give each part in use, its columns, the times that are its own, and these from its start.

        Rounding must not carry a time over the end of its part.
        """
        owner = np.searchsorted(self.starts[1:-1], time, side="right")
        first = 0
        for number, (part, start) in enumerate(zip(self.parts, self.starts, strict=False)):
            here = owner == number
            if np.any(here):
                local = np.clip(np.asarray(time)[here] - start, 0.0, part.duration)
                yield part, slice(first, first + part.size), here, local
            first += part.size


def _block_diagonal(blocks: Sequence[Array]) -> Array:
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))
