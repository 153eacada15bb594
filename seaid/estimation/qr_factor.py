"""What rows determine: their QR factor, its singular directions, and fits of a few plain columns.

The factor is second moments as one triangle per equation, which adds up. All decisions of rank are
made here, on columns scaled to unit norm: by `RANK_TOLERANCE` where a parameter is called
identifiable or not, by `ROUNDING` where directions of rounding are dropped. That is why the fits of
columns without names or weights stand here, too: with errors (`fitted_columns`), of all rows but
some (`deleted_residual`), of a slope (`fitted_slope`), and with errors of known variance in the
columns (`posterior`, `whitened`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, reduce
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg

from seaid._arrays import Array, BoolArray, IndexArray, freeze, safely
from seaid.drives import ParameterName
from seaid.errors import IdentificationError, SeaidError

if TYPE_CHECKING:
    from seaid.regressor import Regression

_BLOCK = 1024
"""Rows that are factored at once: they stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class QRFactor:
    """The rows of a `Regression` in a form whose size does not grow with time.

    `factors` (E, m, p+1) has the upper triangular factor R of [H y] of each of the `equations` (E),
    given by joint index, from `counts` (E) rows, with rows of zeros below shorter ones: m is p+1,
    or the largest count if that is less. `propagated` (E, p, s) is H^T C with the
    regression's `propagated` C; `excluded` counts the instants near standstill. The QR factors of
    chunks and logs add with `+`.
    """

    names: tuple[ParameterName, ...]
    units: tuple[str, ...]
    equations: tuple[int, ...]
    counts: tuple[int, ...]
    factors: Array
    propagated: Array
    excluded: int = 0
    joint_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        equations, p = len(self.equations), len(self.names)
        freeze(self, {"factors": (equations, None, p + 1), "propagated": (equations, p, None)})

    @property
    def count(self) -> int:
        """Number of rows of all equations."""
        return sum(self.counts)

    def weighted_factor(self, weights: Array | None = None) -> Array:
        """Return R (p+1, p+1) of all rows, those of each equation times its weight (E,).

        |[H y] x| = |R x| for every x, with weighted rows; x = (-theta, 1) gives the residual.
        Without `weights` all rows have weight one.
        """
        weights = np.ones(len(self.equations)) if weights is None else weights
        width = len(self.names) + 1
        rows = triangle((weights[:, None, None] * self.factors).reshape(-1, width))
        return np.asarray(_stack([rows], width, width)[0])

    def residual_norms(self, theta: Array) -> Array:
        """Return the norm (E,) of each equation's residual y - H theta."""
        return np.asarray(np.linalg.norm(self.factors @ np.append(-theta, 1.0), axis=1))

    def without(self, dropped: Iterable[str]) -> QRFactor:
        """Return the QR factor of the same rows without the `dropped` columns."""
        dropped = set(dropped)
        kept = [place for place, name in enumerate(self.names) if name not in dropped]
        columns = [*kept, len(self.names)]
        return replace(
            self,
            names=tuple(self.names[place] for place in kept),
            units=tuple(self.units[place] for place in kept),
            factors=_stack([triangle(R[:, columns]) for R in self.factors], len(columns)),
            propagated=self.propagated[:, kept],
        )


def qr_factor_of(rows: Regression, among: IndexArray | None = None) -> QRFactor:
    """Return the QR factor of rows, or of those `among` them (m,).

    Raises IdentificationError if they are not finite.
    """
    among = np.arange(len(rows.y)) if among is None else among
    joint = rows.joint[among]
    equations = np.unique(joint)
    of_equation = [among[joint == equation] for equation in equations]
    p, s = len(rows.names), rows.propagated.shape[1]
    triangles, propagated = [], np.zeros((len(equations), p, s))
    for place, indices in enumerate(of_equation):
        # Triangles of blocks, then the triangle of these (TSQR, Demmel et al. 2012): orthogonal
        # throughout, where H^T H would square the condition number.
        blocks = (indices[start : start + _BLOCK] for start in range(0, len(indices), _BLOCK))
        triangles.append(
            triangle(np.concatenate([triangle(_columns(rows, block)) for block in blocks]))
        )
        if s:
            propagated[place] = rows.H[indices].T @ rows.propagated[indices]
    factors = _stack(triangles, p + 1)
    if not (np.all(np.isfinite(factors)) and np.all(np.isfinite(propagated))):
        raise IdentificationError(_not_finite(rows))
    return QRFactor(
        names=rows.names,
        units=rows.units,
        equations=tuple(map(int, equations)),
        counts=tuple(map(len, of_equation)),
        factors=factors,
        propagated=propagated,
        excluded=rows.excluded,
        joint_names=rows.joint_names,
    )


def combined(parts: Iterable[QRFactor]) -> QRFactor:
    """Return the QR factor of all parts together, stacked and factored again."""
    parts = iter(parts)
    first = next(parts, None)
    if first is None:
        raise IdentificationError("combined needs a QR factor, found none")
    return reduce(_sum, parts, first)


def triangle(columns: Array) -> Array:
    """Return the upper triangular factor R (m, c) of columns (R, c), m the smaller of R and c."""
    width, rows = columns.shape[1], min(columns.shape)
    if not rows:
        return np.empty((0, width))
    # LAPACK alone, without Q: of the small factors of checks scipy's `qr` takes twice as long. By
    # panels of 16 columns, factored recursively: of fifty columns `dgeqrf` takes twice as long.
    vectors = linalg.lapack.dgeqrt(min(16, rows), columns, overwrite_a=True)[0]
    return np.where(_below(rows, width), 0.0, vectors[:rows])


@cache
def _below(rows: int, width: int) -> BoolArray:
    """Return what is below the diagonal, which `np.triu` makes anew in most of its time."""
    return np.tri(rows, width, -1, dtype=bool)


def _stack(factors: Sequence[Array], width: int, height: int | None = None) -> Array:
    """Return factors (m, width) as one array, with rows of zeros below the lower ones."""
    height = max(map(len, factors), default=0) if height is None else height
    stack = np.zeros((len(factors), height, width))
    for place, factor in enumerate(factors):
        stack[place, : len(factor)] = factor
    return stack


def _sum(first: QRFactor, second: QRFactor) -> QRFactor:
    parts = first, second
    columns = [(x.names, x.units, x.propagated.shape[2], x.joint_names) for x in parts]
    if columns[0] != columns[1]:
        raise IdentificationError(
            f"QR factors add only if their columns are the same: one has "
            f"{', '.join(first.names)} ({first.propagated.shape[2]} propagated), the other "
            f"{', '.join(second.names)} ({second.propagated.shape[2]} propagated)"
        )
    equations = sorted({*first.equations, *second.equations})
    factors, propagated, counts = [], [], []
    for equation in equations:
        blocks = [
            (part.factors[place], part.propagated[place], part.counts[place])
            for part in parts
            for place, number in enumerate(part.equations)
            if number == equation
        ]
        factors.append(triangle(np.concatenate([R for R, _, _ in blocks])))
        propagated.append(sum(moments for _, moments, _ in blocks))
        counts.append(sum(count for _, _, count in blocks))
    return replace(
        first,
        equations=tuple(equations),
        counts=tuple(counts),
        factors=_stack(factors, len(first.names) + 1),
        propagated=np.array(propagated).reshape(len(equations), *first.propagated.shape[1:]),
        excluded=first.excluded + second.excluded,
    )


def _columns(rows: Regression, block: IndexArray) -> Array:
    """Return [H y] of some rows in column order, which LAPACK factors without a copy."""
    columns = np.empty((len(block), len(rows.names) + 1), order="F")
    columns[:, :-1] = rows.H[block]
    columns[:, -1] = rows.y[block]
    return columns


def _not_finite(rows: Regression) -> str:
    """Name the columns that are not finite."""
    bad: list[str] = [
        name
        for name, column in zip(rows.names, rows.H.T, strict=True)
        if not np.all(np.isfinite(column))
    ]
    if not np.all(np.isfinite(rows.y)):
        bad.append("the torque")
    return f"rows that are not finite: {', '.join(bad) or 'propagated parameters'}"


_SEEN = 1e-9
"""Part of the largest column of an equation below which a column is rounding."""


def equation_name(joint_names: tuple[str, ...], index: int) -> str:
    """Return the name of an equation: its joint, by name if names are known.

    The n equations of the joints precede those of their motors if both sides are solved at once.
    """
    if not joint_names:
        return f"joint {index}"
    name = joint_names[index % len(joint_names)]
    return name if index < len(joint_names) else f"motor of {name}"


def determining_joints(qr_factor: QRFactor, columns: list[int]) -> list[str]:
    """Return the joints whose torque determines columns: of each, the outermost equation."""
    norms = np.linalg.norm(qr_factor.factors[:, :, :-1], axis=1)
    sees = norms > _SEEN * np.max(norms, axis=0, initial=0.0)
    joints = []
    for column in columns:
        seeing = np.flatnonzero(sees[:, column])
        if len(seeing):
            # The further out a joint, the fewer columns act on its torque; the last of equals.
            fewest = np.sum(sees[seeing], axis=1)
            place = seeing[np.flatnonzero(fewest == fewest.min())[-1]]
            joints.append(qr_factor.equations[place])
    return [equation_name(qr_factor.joint_names, joint) for joint in sorted(set(joints))]


RANK_TOLERANCE = 1e-7
"""Scaled singular value, relative to the largest, below which a combination is unidentifiable.

Columns of regressors are computed to about 1e-10; real motions have 1e-2 to 1e-4."""

ROUNDING = 1e-9
"""The same for directions that are nothing but rounding, which projections exclude."""

NAMED = 0.1
"""Share of a parameter in a combination, over the largest one, from which it is named."""

_MOST_TERMS = 4
"""Parameters of a combination that a message writes out; of the others it has the number."""

_LONGEST_NAME = 40
"""Characters of a grouping from which a message has its first parameter in place of it."""


@dataclass(frozen=True, eq=False)
class ScaledSVD:
    """The singular value decomposition of columns (R, p) scaled to unit norm.

    `left` (R, m), `sizes` (m,) in decreasing order and `vectors` (m, p), which has the right
    singular vectors as rows; `norms` (p,) are those of the columns, 1 for columns of zeros. Of
    stacked columns (..., R, p) each array is stacked, and `spans` and `inverses` are for these.
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

    @property
    def spans(self) -> Array:
        """Orthonormal bases (..., R, m) of the ranges, zero beyond the ranks."""
        return np.asarray(self.left * self._kept[..., None, :])

    @property
    def inverses(self) -> Array:
        """The pseudo-inverses (..., p, R) of the columns."""
        scaled = (
            self.vectors.swapaxes(-1, -2) / np.where(self._kept, self.sizes, np.inf)[..., None, :]
        )
        return np.asarray(scaled @ self.left.swapaxes(-1, -2) / self.norms[..., None])

    @property
    def _kept(self) -> BoolArray:
        """Whether singular values (..., m) are above rounding."""
        largest = np.max(self.sizes, axis=-1, keepdims=True, initial=0.0)
        return np.asarray(self.sizes > ROUNDING * largest)

    def solve(self, y: Array, tolerance: float = ROUNDING) -> Array:
        """Return theta (p,) of least squares to y (R,), least in norm in the scaled parameters."""
        kept = slice(self.rank(tolerance))
        scaled = self.vectors[kept].T @ ((self.left[:, kept].T @ y) / self.sizes[kept])
        return np.asarray(scaled / self.norms)


def scaled_svd(
    columns: Array, what: str = "the equations", error: type[SeaidError] = IdentificationError
) -> ScaledSVD:
    """Return the decomposition of columns (..., R, p); `what` names them in an `error`."""
    norms = np.linalg.norm(columns, axis=-2)
    norms[norms == 0] = 1.0
    U, sizes, vectors = safely(_svd, columns / norms[..., None, :], what=what, error=error)
    return ScaledSVD(U, sizes, vectors, norms)


def _svd(matrix: Array) -> tuple[Array, Array, Array]:
    """Return the thin decomposition: divide and conquer, or QR iterations where it fails.

    Divide and conquer (gesdd) is faster, but sometimes does not converge for a finite matrix.
    """
    try:
        U, sizes, vectors = np.linalg.svd(matrix, full_matrices=False)
    except np.linalg.LinAlgError:
        gesvd = {"full_matrices": False, "check_finite": False, "lapack_driver": "gesvd"}
        U, sizes, vectors = linalg.svd(matrix, **gesvd)
    return U, sizes, vectors


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
        named = np.flatnonzero(share > NAMED * share.max())
        return [int(place) for place in named[np.argsort(-share[named], kind="stable")]]

    def text(self, direction: int) -> str:
        """Return a combination as text, 'A - 0.97 B', in the units of the parameters."""
        terms = self.terms(direction)
        # A scaled parameter is theta times the norm of its column: v^T N theta.
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


def residual_of(y: Array, columns: Array) -> Array:
    """Return what columns (R, k) leave of y (R,) by least squares."""
    return np.asarray(y - columns @ scaled_svd(columns).solve(y))


def deleted_residual(
    H: Array, y: Array, apart: BoolArray, correlated: float
) -> tuple[Array, float]:
    """Return what the fit of all rows but those `apart` leaves of y (R,), and the rms of theirs.

    The rows `apart` are in units of the error of their prediction over the noise: of a row h that
    is not in the fit it has the variance 1 + c h (H^T H)^-1 h^T, c for `correlated` rows.
    """
    # The rows of all others as their triangular factor: (p + 1) rows in place of R.
    R, p = triangle(np.column_stack([H, y])[~apart]), H.shape[1]
    svd = scaled_svd(R[:, :p])
    residual = y - H @ svd.solve(R[:, p], RANK_TOLERANCE)
    # |reach|^2 = h (H^T H)^-1 h^T. A direction that the other rows lack predicts nothing: its reach
    # is huge, not infinite.
    sizes = np.maximum(svd.sizes, RANK_TOLERANCE * svd.sizes[0])
    reach = (H[apart] / svd.norms) @ svd.vectors.T / sizes
    residual[apart] /= np.sqrt(1 + correlated * np.sum(reach**2, axis=1))
    freedom = max(int(np.sum(~apart)) - svd.rank(RANK_TOLERANCE), 1)
    return residual, math.sqrt(float(np.sum(residual[~apart] ** 2)) / freedom)


def fitted_columns(columns: Array, y: Array, inflation: float, count: int) -> tuple[Array, Array]:
    """Return the parameters of a fit and their covariance, from the residuals of each part of y.

    Standard errors are `inflation` times those for white noise; y has `count` parts of equal size.
    """
    svd = scaled_svd(columns)
    rank = svd.rank(RANK_TOLERANCE)
    x = svd.solve(y, RANK_TOLERANCE)
    residual = (y - columns @ x).reshape(count, -1)
    rows = np.sum(residual != 0, axis=1)  # others are excluded
    sizes = np.linalg.norm(residual, axis=1) / np.sqrt(np.maximum(rows - rank / count, 1))
    # (X^T X)^+ = inverse^T inverse, in the units of the parameters.
    inverse = (svd.vectors[:rank] / svd.sizes[:rank, None]) / svd.norms
    # the first parameter of each part belongs to its residuals; all parts are weighed alike
    size = np.full(len(x), float(np.sqrt(np.mean(sizes**2))))
    size[:count] = sizes
    scaled = inflation * inverse * size
    return x, np.asarray(scaled.T @ scaled)


def fitted_slope(columns: Array, y: Array, inflation: float) -> tuple[float, float]:
    """Return -b/a of the parameters a, b of the first two columns, and its standard error.

    Between a motor and a joint angle it is the gear ratio. Noise of the first column biases it, and
    noise of y that of the reverse regression, of the first column on y: the true slope is anywhere
    between them. The error is that of the fit, `inflation` times as for white noise, or of the
    halves of the rows if they differ by more; and, as in `gear_ratio`, the error of the gear, the
    smooth part of the residual: what rows that are no neighbours share, in time or in the angle,
    beyond the standard error of such a correlation of noise.
    """

    def part(rows: slice) -> tuple[float, float, Array]:
        used = columns[rows][:, np.any(columns[rows] != 0, axis=0)]  # zeros of encoders of its logs
        x, covariance = fitted_columns(used, y[rows], inflation, 1)
        # The gradient of -x_1 / x_0, for the error to first order.
        slopes = np.array([x[1] / x[0] ** 2, -1 / x[0]])
        error = float(np.sqrt(slopes @ covariance[:2, :2] @ slopes))
        return float(-x[1] / x[0]), error, (y[rows] - used @ x) / x[1]

    slope, error, residual = part(slice(None))
    count, joint = len(y), columns[:, 1]
    if count > 6 * columns.shape[1]:
        (first, e, _), (second, f, _) = part(slice(count // 2)), part(slice(count // 2, None))
        # The error e f / sqrt(e^2 + f^2) of the weighted mean of both halves, times their Birge
        # ratio |first - second| / sqrt(e^2 + f^2).
        error = max(error, abs(first - second) * e * f / max(e**2 + f**2, 1e-300))
    by_angle = residual[np.argsort(joint)]
    shared = max(float(residual[2:] @ residual[:-2]), float(by_angle[1:] @ by_angle[:-1])) / count
    # Of white noise a mean of products has the standard deviation sigma^2 / sqrt(count).
    smooth = np.sqrt(max(shared - float(residual @ residual) / count**1.5, 0.0))
    error = math.hypot(error, slope * smooth / max(float(np.std(joint)), 1e-300))
    # y = a x_0 + b x_1 + ... is x_0 = y / a - b / a x_1 - ...
    reverse = float(scaled_svd(np.column_stack([y, columns[:, 1:]])).solve(columns[:, 0])[1])
    # of a uniform distribution between both
    return (slope + reverse) / 2, math.hypot(error, (slope - reverse) / math.sqrt(12))


_LOST = 1e-6
"""Part of a column below which nothing is left of it next to the others but rounding."""


def explained_squares(columns: Array, basis: Array, residual: Array, parts: IndexArray) -> Array:
    """Return the sums of squares of a residual (R,) that some columns explain.

    They are those of each of the `parts` (c,) of columns (R, c), next to an orthonormal basis
    (R, p), of which the residual has nothing.
    """
    # Of X = columns - Q Q^T columns the products X^T X and X^T r are these.
    seen, along = basis.T @ columns, columns.T @ residual
    G = columns.T @ columns - seen.T @ seen
    is_left = np.diag(G) > _LOST**2 * np.sum(columns**2, axis=0)
    sizes = np.sqrt(np.where(is_left, np.diag(G), np.inf))
    scaled = np.where(np.equal.outer(parts, parts), G / np.outer(sizes, sizes), 0.0)
    # r^T X (X^T X)^-1 X^T r of each part alone
    scaled = scaled + _LOST**2 * np.eye(len(parts))
    solution = safely(np.linalg.solve, scaled, along / sizes, what="columns")
    return np.asarray(np.bincount(parts, along / sizes * solution), dtype=float)


def projected_out(X: Array, p: int) -> tuple[Array, Array]:
    """Return coefficients (p, s) of the last s columns on the first p, and what is left."""
    R = triangle(X)
    svd = scaled_svd(R[:, :p])
    kept = slice(svd.rank(ROUNDING))
    # y - U U^T y: also right where the first p columns depend on each other.
    seen = svd.left[:, kept].T @ R[:, p:]
    scaled = svd.vectors[kept].T @ (seen / svd.sizes[kept, None])
    return scaled / svd.norms[:, None], triangle(R[:, p:] - svd.left[:, kept] @ seen)


def explained_apart(X: Array, prior: Array, parts: Collection[BoolArray]) -> Iterator[float]:
    """Yield the share of the squared residual that values of its own explain, of each part.

    The last column of X (R, c) is y. The rows of the `prior` of some values (k, c) count for each
    part in equal shares, and once for all rows together. The parts share no row.
    """
    columns = np.concatenate([X, prior])
    norms = np.linalg.norm(columns, axis=0)
    Q = np.linalg.qr(columns[:, norms > 0] / norms[norms > 0])[0]  # the last column: the residual
    rows, shared = Q[: len(X)], Q[len(X) :].T @ Q[len(X) :] / (len(parts) + 1)
    for part in parts:
        # With r the residual, B the basis of the columns and B^T B = V diag(l) V^T in the part,
        # |r|^2 falls by sum (V^T B^T r)^2 (1 / l + 1 / (1 - l)): in the part, and in the others.
        G = rows[part].T @ rows[part] + shared
        sizes, V = safely(np.linalg.eigh, G[:-1, :-1], what="rows apart")
        squares = (V.T @ G[:-1, -1]) ** 2
        yield float(np.sum(squares / np.maximum(sizes * (1 - sizes), np.finfo(float).eps)))


BLOCKS, SEGMENTS = 8, 4
"""Number of blocks, of which each is predicted from the others, and of its segments in time.

A block of one segment may lack what makes two models differ, such as the large deflections of a
spring; four spread over the log find a cubic spring twice as often, and no more that is not there
(scripts/benchmarks/term_selection.py)."""


def time_blocks(rows: Regression, count: int = BLOCKS, segments: int = 1) -> list[BoolArray]:
    """Return `count` masks of rows, of blocks of segments in turn.

    Each block has every `count`-th of `count * segments` segments in time, which have equal numbers
    of rows.
    """
    size, p = len(rows.y), rows.H.shape[1]
    if size < count * 2 or size * (count - 1) / count <= p:
        raise IdentificationError(
            f"{size} rows are too few to exclude one of {count} blocks and estimate {p} parameters "
            "from the others: record a longer log"
        )
    # By log, then by time: all joints of an instant are in one segment, but at its ends.
    place = np.argsort(np.lexsort((rows.time, rows.run)))
    # Segment s of count * segments is in block s mod count.
    block = place * count * segments // size % count
    return [np.asarray(block == number) for number in range(count)]


def posterior(effects: Array, y: Array, widths: Array) -> tuple[Array, Array]:
    """Return the mean (k,) of W u and a root (k, p) of its covariance, W (k, p) being `widths`.

    The errors u have the variance 1; `effects` (R, p) are what each adds to y (R,), which is over
    its noise.
    """
    count = widths.shape[1]
    svd = scaled_svd(np.vstack([effects, np.eye(count)]))
    # The posterior mean of u minimises |E u - y|^2 + |u|^2.
    mean = widths @ svd.solve(np.concatenate([y, np.zeros(count)]))
    return mean, widths @ (svd.vectors / svd.sizes[:, None] / svd.norms).T


def shrunk(theta: Array, sizes: Array) -> Array:
    """Return T S T^T (p, p) for parameters T (p, k) of effects, S being how far each one shrinks.

    An effect of z standard deviations of the noise shrinks by 1 - (1 + z^2)^(-1/2).
    """
    return np.asarray(theta * (1 - 1 / np.hypot(1, sizes)) @ theta.T)


def whitened(y: Array, X: Array, effects: Iterable[tuple[Array, Array]]) -> Array:
    """Return rows (rows, ...) times (1 + B B^T)^(-1/2), with B = X T diag(sizes), of each effect.

    The columns of U = X T are orthonormal.
    """
    for theta, sizes in effects:
        # (1 + U Z^2 U^T)^(-1/2) = 1 - U S U^T, with S = 1 - (1 + Z^2)^(-1/2)
        y = y - X @ (shrunk(theta, sizes) @ (X.T @ y))
    return y
