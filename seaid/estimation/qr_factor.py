"""Information: what rows tell second moments, as one triangular factor an equation; it adds up.

What combinations of parameters rows tell well and badly, in words.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from io import BytesIO
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from scipy import linalg

from seaid._arrays import Array, frozen, safely
from seaid._files import working_folder, write_whole
from seaid.errors import IdentificationError
from seaid.regressor import Regression

_BLOCK = 1024
"""Rows that are factored at once: they stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class QRFactor:
    """The rows of a `Regression` without the rows: what does not grow with time.

    `factors` (E, p+1, p+1) has the upper triangular factor R of [H y] of each of the `equations`
    (E), named by their joint's index, from `counts` (E) rows; `propagated` (E, p, s) is H^T C with
    the regression's `propagated` C; `excluded` counts the instants that are not rows. Information
    of chunks, logs and machines adds with `+`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    equations: tuple[int, ...]
    counts: tuple[int, ...]
    factors: Array
    propagated: Array
    excluded: int = 0
    joint_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        equations, p = len(self.equations), len(self.names)
        factors = frozen("factors", self.factors, (equations, p + 1, p + 1))
        object.__setattr__(self, "factors", factors)
        object.__setattr__(
            self, "propagated", frozen("propagated", self.propagated, (equations, p, None))
        )

    @property
    def count(self) -> int:
        """Number of rows of all equations."""
        return sum(self.counts)

    def __add__(self, other: QRFactor) -> QRFactor:
        """Return the information of both. Raises IdentificationError for other columns."""
        return combined([self, other])

    @property
    def filled_factors(self) -> Array:
        """The factors (E, m, p+1) without the zeros below as many rows as an equation has."""
        return self.factors[:, : max(self.counts, default=0)]

    def weighted_factor(self, weights: Array | None = None) -> Array:
        """Return R (p+1, p+1) of all rows, those of each equation times its weight (E,).

        |[H y] x| = |R x| for every x with weighted rows: a quadratic form in the parameters, with
        x = (theta, -1) that of the residual. Without `weights` all rows count alike.
        """
        weights = np.ones(len(self.equations)) if weights is None else weights
        filled = self.filled_factors
        return triangle((weights[:, None, None] * filled).reshape(-1, len(self.names) + 1))

    def residual_norms(self, theta: Array) -> Array:
        """Return the norm (E,) of each equation's residual y - H theta."""
        return np.asarray(np.linalg.norm(self.factors @ np.append(-theta, 1.0), axis=1))

    def without(self, dropped: Iterable[str]) -> QRFactor:
        """Return the information of the same rows without some of the columns."""
        dropped = set(dropped)
        kept = [place for place, name in enumerate(self.names) if name not in dropped]
        columns = [*kept, len(self.names)]
        return QRFactor(
            names=tuple(self.names[place] for place in kept),
            units=tuple(self.units[place] for place in kept),
            equations=self.equations,
            counts=self.counts,
            factors=np.array([triangle(R[:, columns]) for R in self.factors]).reshape(
                len(self.equations), len(columns), len(columns)
            ),
            propagated=self.propagated[:, kept],
            excluded=self.excluded,
            joint_names=self.joint_names,
        )

    def save(self, path: str | Path) -> None:
        """Write an NPZ file, whole or not at all, for `load_qr_factor`."""
        fields = {name: np.asarray(value) for name, value in vars(self).items()}
        content = BytesIO()
        np.savez(content, **fields)  # type: ignore[arg-type]
        write_whole(path, content.getvalue())


def load_qr_factor(path: str | Path) -> QRFactor:
    """Read what `QRFactor.save` wrote. Raises IdentificationError for any other file."""
    path = Path(path)
    if not path.is_file():
        raise IdentificationError(f"no information file at '{path}' ({working_folder()})")
    try:
        with np.load(path) as archive:
            return QRFactor(
                names=tuple(map(str, archive["names"])),
                units=tuple(map(str, archive["units"])),
                equations=tuple(map(int, archive["equations"])),
                counts=tuple(map(int, archive["counts"])),
                factors=archive["factors"],
                propagated=archive["propagated"],
                excluded=int(archive["excluded"]),
                joint_names=tuple(map(str, archive["joint_names"])),
            )
    except (OSError, ValueError, EOFError, KeyError, AttributeError, TypeError, BadZipFile):
        raise IdentificationError(
            f"'{path}' is not a file of information (.npz of Information.save), or a damaged one"
        ) from None


def qr_factor_of(rows: Regression) -> QRFactor:
    """Return the information of rows. Raises IdentificationError where they are not finite."""
    equations = np.unique(rows.joint)
    of_equation = [np.flatnonzero(rows.joint == equation) for equation in equations]
    p, s = len(rows.names), rows.propagated.shape[1]
    factors, propagated = np.empty((len(equations), p + 1, p + 1)), np.zeros((len(equations), p, s))
    for place, mine in enumerate(of_equation):
        blocks = (mine[start : start + _BLOCK] for start in range(0, len(mine), _BLOCK))
        factors[place] = triangle(
            np.concatenate([triangle(_columns(rows, block)) for block in blocks])
        )
        if s:
            propagated[place] = rows.H[mine].T @ rows.propagated[mine]
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
    """Return the information of all parts together, stacked and factored again.

    Raises IdentificationError for none, and where columns or carried parameters differ.
    """
    parts = iter(parts)
    first = next(parts, None)
    if first is None:
        raise IdentificationError("combined needs information, found none")
    return reduce(_sum, parts, first)


def triangle(columns: Array) -> Array:
    """Return the upper triangular factor R (c, c) of columns (R, c), zero below few rows."""
    width = columns.shape[1]
    R = np.zeros((width, width))
    if len(columns):
        found = linalg.qr(columns, mode="raw", overwrite_a=True, check_finite=False)[1][:width]
        R[: len(found)] = found
    return R


def _sum(one: QRFactor, other: QRFactor) -> QRFactor:
    same = (one.names, one.units, one.propagated.shape[2]) == (
        other.names,
        other.units,
        other.propagated.shape[2],
    )
    if not same or one.joint_names != other.joint_names:
        raise IdentificationError(
            f"information adds only where the columns are the same: one has "
            f"{', '.join(one.names)} ({one.propagated.shape[2]} propagated), the other "
            f"{', '.join(other.names)} ({other.propagated.shape[2]} propagated)"
        )
    equations = sorted({*one.equations, *other.equations})
    factors, propagated, counts = [], [], []
    for equation in equations:
        mine = [
            (part.factors[place], part.propagated[place], part.counts[place])
            for part in (one, other)
            for place, found in enumerate(part.equations)
            if found == equation
        ]
        factors.append(triangle(np.concatenate([R for R, _, _ in mine])))
        propagated.append(sum(moments for _, moments, _ in mine))
        counts.append(sum(count for _, _, count in mine))
    return QRFactor(
        names=one.names,
        units=one.units,
        equations=tuple(equations),
        counts=tuple(counts),
        factors=np.array(factors).reshape(len(equations), *one.factors.shape[1:]),
        propagated=np.array(propagated).reshape(len(equations), *one.propagated.shape[1:]),
        excluded=one.excluded + other.excluded,
        joint_names=one.joint_names,
    )


def _columns(rows: Regression, block: np.ndarray) -> Array:
    """Return [H y] of some rows in the column order that LAPACK works in without a copy."""
    columns = np.empty((len(block), len(rows.names) + 1), order="F")
    columns[:, :-1] = rows.H[block]
    columns[:, -1] = rows.y[block]
    return columns


def _not_finite(rows: Regression) -> str:
    bad = [
        name
        for name, column in zip(rows.names, rows.H.T, strict=True)
        if not np.all(np.isfinite(column))
    ]
    if not np.all(np.isfinite(rows.y)):
        bad.append("the torque")
    return f"rows that are not finite: {', '.join(bad) or 'what is carried along'}"


_PART = 0.1
"""A parameter whose share of a combination is below this part of the largest is not named."""

_MOST_TERMS = 4
_LONGEST_NAME = 40
_SEEN = 1e-9


@dataclass(frozen=True, eq=False)
class Directions:
    """Singular directions of rows with columns scaled to unit norm, best told first.

    `shares` (p,) are the singular values relative to the largest, so that 1 / shares[-1] is the
    condition number; `vectors` (p, p) has the right singular vectors as rows; `norms` (p,) are the
    norms of the columns. `left` (p, p) are the left singular vectors in the basis of the factor and
    `largest` the largest singular value.
    """

    names: tuple[str, ...]
    shares: Array
    vectors: Array
    norms: Array
    left: Array
    largest: float

    def terms(self, direction: int) -> list[int]:
        """Return the parameters that make up a direction, the largest share first."""
        share = np.abs(self.vectors[direction])
        named = np.flatnonzero(share > _PART * share.max())
        return [int(place) for place in named[np.argsort(-share[named], kind="stable")]]

    def text(self, direction: int) -> str:
        """Return the combination in words, 'A - 0.97 B', in the units of the parameters."""
        terms = self.terms(direction)
        coefficients = self.vectors[direction] * self.norms
        words = first_term(self.names[terms[0]])
        for place in terms[1:_MOST_TERMS]:
            value = coefficients[place] / coefficients[terms[0]]
            size = "" if abs(abs(value) - 1) < 5e-3 else f"{abs(value):.2g} "
            words += f" {'-' if value < 0 else '+'} {size}{first_term(self.names[place])}"
        more = len(terms) - _MOST_TERMS
        return words + (f" and {more} more" if more > 0 else "")


def directions(factor: Array, names: tuple[str, ...]) -> Directions:
    """Return the singular directions of a weighted factor (p+1, p+1) without columns of zeros."""
    p = len(names)
    norms = np.linalg.norm(factor[:p, :p], axis=0)
    U, s, Vt = safely(linalg.svd, factor[:p, :p] / norms, what="the equations", check_finite=False)
    largest = float(s[0]) if p else 1.0
    return Directions(names, s / largest, Vt, norms, U, largest)


def equation_name(joint_names: tuple[str, ...], index: int) -> str:
    """Return the joint of an equation, by name where names are known.

    After the n equations of the joints come those of their motors, where both are solved at once.
    """
    if not joint_names:
        return f"joint {index}"
    name = joint_names[index % len(joint_names)]
    return name if index < len(joint_names) else f"motor of {name}"


def telling_joints(qr_factor: QRFactor, columns: list[int]) -> list[str]:
    """Return the joints whose torque tells columns, by name where names are known.

    Of the equations that see a column the one that sees the fewest others: the outermost joint.
    """
    norms = np.linalg.norm(qr_factor.factors[:, :, :-1], axis=1)
    sees = norms > _SEEN * np.max(norms, axis=0, initial=0.0)
    joints = []
    for column in columns:
        seeing = np.flatnonzero(sees[:, column])
        if len(seeing):
            fewest = np.sum(sees[seeing], axis=1)
            place = seeing[np.flatnonzero(fewest == fewest.min())[-1]]
            joints.append(qr_factor.equations[place])
    return [equation_name(qr_factor.joint_names, joint) for joint in sorted(set(joints))]


def first_term(name: str) -> str:
    """Return a long grouping by its first parameter, which is the base column's own name."""
    return name if len(name) <= _LONGEST_NAME else f"{name.split(' ')[0]} + ..."
