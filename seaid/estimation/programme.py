"""Possible bodies near an estimate, as data: what is told, how well, and what is allowed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from seaid.arrays import Array, finite
from seaid.errors import IdentificationError
from seaid.inertia import from_pseudo_inertia, pseudo_inertia
from seaid.linear_algebra import safely


@dataclass(frozen=True, eq=False)
class Programme:
    """An estimate of combinations of f unknowns, the first 10n of which are n bodies.

    columns (p, f) @ unknowns is what `estimate` (p,) tells with covariance root @ root.T; the
    `pivots` (p,) are unknowns whose columns are those of the identity. `prior` (n, 10) are possible
    bodies with mass in every direction; `limits` (c, f) @ unknowns >= `bounds` (c,); `start` (f,)
    keeps all of that strictly.
    """

    columns: Array
    pivots: tuple[int, ...]
    estimate: Array
    root: Array
    prior: Array
    limits: Array
    bounds: Array
    start: Array

    def __post_init__(self) -> None:
        p, f = np.shape(self.columns)
        shapes = {
            "columns": (p, f),
            "estimate": (p,),
            "root": (p, p),
            "prior": (None, 10),
            "limits": (None, f),
            "bounds": (len(self.limits),),
            "start": (f,),
        }
        for name, shape in shapes.items():
            value = finite(name, getattr(self, name), shape, IdentificationError)
            object.__setattr__(self, name, value)

    @cached_property
    def free(self) -> tuple[int, ...]:
        """The unknowns beside the pivots."""
        return tuple(sorted(set(range(self.columns.shape[1])) - set(self.pivots)))

    @cached_property
    def span(self) -> tuple[Array, Array]:
        """Offset (f,) and matrix (f, f): unknowns = offset + matrix @ (u, unknowns that are free).

        Exact for every u and every free unknown: the estimate moves by root @ u and nothing else.
        """
        p, f = self.columns.shape
        offset, matrix = np.zeros(f), np.zeros((f, f))
        pivots, free = list(self.pivots), list(self.free)
        offset[pivots] = self.estimate
        matrix[pivots, :p] = self.root
        matrix[pivots, p:] = -self.columns[:, free]
        matrix[free, range(p, f)] = 1.0
        return offset, matrix

    @cached_property
    def prior_roots(self) -> Array:
        """Triangular factors (n, 4, 4) of the prior's pseudo-inertias, whose Q is 1."""
        prior = np.array([pseudo_inertia(parameters) for parameters in self.prior])
        return np.asarray(safely(np.linalg.cholesky, prior, what="the bodies of the prior"))

    @cached_property
    def cones(self) -> tuple[Array, Array]:
        """Offset (n, 4, 4) and matrix (n, f, 4, 4) of the pseudo-inertias, 1 at the prior's."""
        offset, matrix = self.span
        basis = np.array([pseudo_inertia(unit) for unit in np.eye(10)])
        first, blocks = [], []
        for body, half in enumerate(np.linalg.inv(self.prior_roots)):
            units = half @ basis @ half.T
            own = slice(10 * body, 10 * body + 10)
            first.append(np.tensordot(offset[own], units, 1))
            blocks.append(np.tensordot(matrix[own].T, units, 1))
        return np.array(first), np.array(blocks)

    @cached_property
    def slack(self) -> tuple[Array, Array]:
        """Offset (c,) and matrix (c, f) of what the inequalities leave."""
        offset, matrix = self.span
        return self.limits @ offset - self.bounds, self.limits @ matrix

    def scaled(self, unknowns: Array) -> Array:
        """Return the pseudo-inertias Q (n, 4, 4) of unknowns (f,), 1 at the prior's."""
        half = np.linalg.inv(self.prior_roots)
        bodies = unknowns[: self.prior.size].reshape(-1, 10)
        return np.asarray(
            half @ [pseudo_inertia(body) for body in bodies] @ half.transpose(0, 2, 1)
        )

    def bodies(self, Q: Array) -> Array:
        """Return the parameters (n, 10) of scaled pseudo-inertias: possible if they are."""
        pseudo = self.prior_roots @ Q @ self.prior_roots.transpose(0, 2, 1)
        return np.array([from_pseudo_inertia(one) for one in pseudo])

    def coordinates(self, unknowns: Array) -> Array:
        """Return (u, free unknowns) of unknowns (f,)."""
        distance = self.columns @ unknowns - self.estimate
        u = safely(linalg.solve, self.root, distance, what="the covariance", check_finite=False)
        return np.concatenate([u, unknowns[list(self.free)]])


def root_of(covariance: Array, values: Array) -> Array:
    """Return root (p, p) with root @ root.T = covariance, invertible for every covariance.

    A standard error counts as 1e-10 of its value at least, and a combination of values that are in
    standard errors as 1e-10 of the largest: better is nothing known in double precision.
    """
    covariance = finite("covariance", covariance, (len(values),) * 2, IdentificationError)
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.maximum(errors, 1e-10 * np.abs(values) + 1e-13)
    spread, vectors = safely(
        np.linalg.eigh, covariance / np.outer(scale, scale), what="the covariance"
    )
    spread = np.maximum(spread, 1e-10 * max(spread[-1], 1e-3))
    return np.asarray(scale[:, None] * vectors * np.sqrt(spread))


def least_spread(covariance: Array, white: Array) -> Array:
    """Return the covariance with no combination known better than noise that is white allows.

    A long-run covariance from a finite record is far too small in its smallest directions, and
    they would decide what is nearest. `white` (p, p) is positive definite.
    """
    ratios, vectors = safely(
        linalg.eigh, covariance, white, what="the covariance beside that of white noise"
    )
    half = white @ vectors * np.sqrt(np.maximum(ratios, 1.0))
    return np.asarray(half @ half.T)
