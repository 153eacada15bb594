"""Singular directions of a regressor: what its rows determine well, poorly, or not at all.

All decisions of rank are made here, on columns scaled to unit norm: by `RANK_TOLERANCE` where a
parameter is called identifiable or not, by `ROUNDING` where directions of rounding are dropped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from seaid._arrays import Array, safely
from seaid.errors import IdentificationError, SeaidError

RANK_TOLERANCE = 1e-7
"""Scaled singular value, relative to the largest, below which a combination is unidentifiable.

Columns of regressors are computed to about 1e-10; real motions have 1e-2 to 1e-4."""

ROUNDING = 1e-9
"""The same for directions that are nothing but rounding, which projections exclude."""

_PART = 0.1
"""A parameter with less than this part of the largest share of a combination is not named."""

_MOST_TERMS = 4
_LONGEST_NAME = 40


@dataclass(frozen=True, eq=False)
class ScaledSVD:
    """The singular value decomposition of columns (R, p) scaled to unit norm.

    `left` (R, m), `sizes` (m,) in decreasing order and `vectors` (m, p), which has the right
    singular vectors as rows; `norms` (p,) are those of the columns, 1 for columns of zeros.
    """

    left: Array
    sizes: Array
    vectors: Array
    norms: Array

    def rank(self, tolerance: float = ROUNDING) -> int:
        """Return the number of singular values above a part of the largest."""
        return int(np.sum(self.sizes > tolerance * np.max(self.sizes, initial=0.0)))

    def span(self, tolerance: float = ROUNDING) -> Array:
        """Return an orthonormal basis (R, rank) of the range of the columns."""
        return self.left[:, : self.rank(tolerance)]

    def solve(self, y: Array, tolerance: float = ROUNDING) -> Array:
        """Return theta (p,) of least squares to y (R,), least in norm in the scaled parameters."""
        kept = slice(self.rank(tolerance))
        scaled = self.vectors[kept].T @ ((self.left[:, kept].T @ y) / self.sizes[kept])
        return np.asarray(scaled / self.norms)


def scaled_svd(
    columns: Array, what: str = "the equations", error: type[SeaidError] = IdentificationError
) -> ScaledSVD:
    """Return the decomposition of columns (R, p); `what` names them in an `error`."""
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0] = 1.0
    left, sizes, vectors = safely(_svd, columns / norms, what=what, error=error)
    return ScaledSVD(left, sizes, vectors, norms)


def _svd(matrix: Array) -> tuple[Array, Array, Array]:
    """Return the thin decomposition: divide and conquer, or QR iterations where it fails.

    Divide and conquer (gesdd) is faster, but sometimes does not converge for a finite matrix.
    """
    try:
        found = linalg.svd(matrix, full_matrices=False, check_finite=False)
    except linalg.LinAlgError:
        found = linalg.svd(matrix, full_matrices=False, check_finite=False, lapack_driver="gesvd")
    left, sizes, vectors = found
    return left, sizes, vectors


@dataclass(frozen=True, eq=False)
class Directions:
    """Singular directions of rows with columns scaled to unit norm, best determined first.

    `svd` is that of the factor; `shares` (p,) are its singular values relative to the largest, so
    that 1 / shares[-1] is the condition number.
    """

    names: tuple[str, ...]
    svd: ScaledSVD
    shares: Array

    def terms(self, direction: int) -> list[int]:
        """Return the parameters of a direction, the largest share first."""
        share = np.abs(self.svd.vectors[direction])
        named = np.flatnonzero(share > _PART * share.max())
        return [int(place) for place in named[np.argsort(-share[named], kind="stable")]]

    def text(self, direction: int) -> str:
        """Return a combination as text, 'A - 0.97 B', in the units of the parameters."""
        terms = self.terms(direction)
        coefficients = self.svd.vectors[direction] * self.svd.norms
        text = first_term(self.names[terms[0]])
        for place in terms[1:_MOST_TERMS]:
            value = coefficients[place] / coefficients[terms[0]]
            size = "" if abs(abs(value) - 1) < 5e-3 else f"{abs(value):.2g} "
            text += f" {'-' if value < 0 else '+'} {size}{first_term(self.names[place])}"
        more = len(terms) - _MOST_TERMS
        return text + (f" and {more} more" if more > 0 else "")


def directions(factor: Array, names: tuple[str, ...]) -> Directions:
    """Return the singular directions of a weighted factor (p+1, p+1)."""
    p = len(names)
    svd = scaled_svd(factor[:p, :p])
    return Directions(names, svd, svd.sizes / np.max(svd.sizes, initial=1e-300))


def first_term(name: str) -> str:
    """Return a long grouping by its first parameter, which names the base column."""
    return name if len(name) <= _LONGEST_NAME else f"{name.split(' ')[0]} + ..."
