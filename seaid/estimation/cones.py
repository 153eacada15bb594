"""The possible bodies nearest to an estimate: a semidefinite programme (Wensing et al. 2018).

Solved by Clarabel (extra `feasible`), whose multipliers tell what holds the estimate back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from seaid.arrays import Array, IndexArray
from seaid.errors import IdentificationError
from seaid.estimation.programme import Programme

_LEAST_TRACE = 1e-7
"""Weight of the bodies' size in the programme without prior, whose minimum is not one point."""

_PUSH = 1e-3
"""Slope of chi-square along a bound, in the bound's own size, from which the data push."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The least `chi_square` of all possible unknowns, and what holds them there.

    `values` (p,) are those of the estimate's combinations. `ranks` (n,) of the pseudo-inertias
    where the data push against their bound, 4 where they do not; `held` the inequalities that they
    push against.
    """

    values: Array
    chi_square: float
    ranks: tuple[int, ...]
    held: tuple[int, ...]


def nearest(programme: Programme) -> Nearest:
    """Return the possible values nearest to the estimate, by Clarabel's semidefinite cones.

    Raises IdentificationError without Clarabel, and with the solver's status where it fails.
    """
    p, count, bodies = len(programme.estimate), len(programme.bounds), len(programme.prior)
    triangles, constants = triangle_rows(*programme.cones)
    A = np.vstack([programme.slack[1], triangles])
    b = np.concatenate([programme.slack[0], constants])
    linear = _LEAST_TRACE * np.einsum("nfii->f", programme.cones[1])
    quadratic = np.where(np.arange(len(linear)) < p, 2.0, 0.0)
    x, dual = solve_cones(quadratic, linear, A, b, count, (4,) * bodies)
    return Nearest(
        values=programme.estimate + programme.root @ x[:p],
        chi_square=float(x[:p] @ x[:p]),
        ranks=_ranks(dual[count:].reshape(bodies, -1)),
        held=tuple(map(int, np.flatnonzero(dual[:count] > _PUSH))),
    )


def solve_cones(
    quadratic: Array,
    linear: Array,
    A: Array,
    b: Array,
    inequalities: int,
    triangles: tuple[int, ...],
) -> tuple[Array, Array]:
    """Return the x of least sum of quadratic x^2 / 2 + linear x with A x + b in cones, multipliers.

    The cones in the order of the rows: so many `inequalities` (>= 0), and upper `triangles` of
    positive semidefinite matrices of these sizes as `triangle_rows` has them. Raises
    IdentificationError without Clarabel, and with the solver's status where it fails.
    """
    try:
        import clarabel
    except ImportError:
        raise IdentificationError(
            "possible bodies need the package clarabel: pip install 'seaid[feasible]'"
        ) from None
    kinds = [clarabel.NonnegativeConeT(inequalities)] * bool(inequalities)
    kinds += [clarabel.PSDTriangleConeT(size) for size in triangles]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    scale = 1 / np.sqrt(quadratic + np.sum(A**2, axis=0))
    P = sparse.diags(quadratic * scale**2, format="csc")
    rows = sparse.csc_matrix(-A * scale)
    solution = clarabel.DefaultSolver(P, linear * scale, rows, b, kinds, settings).solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise IdentificationError(
            f"the semidefinite programme of possible bodies failed: {solution.status} after "
            f"{solution.iterations} iterations; check the bounds, and that the covariance of the "
            "estimate is finite"
        )
    return scale * np.array(solution.x), np.array(solution.z)


def triangle_rows(offset: Array, matrix: Array) -> tuple[Array, Array]:
    """Return rows and constants of symmetric matrices: their upper triangles, by root 2 off it."""
    rows, columns = upper_triangle(offset.shape[1])
    scale = np.where(rows == columns, 1.0, np.sqrt(2))
    constants = (offset[:, rows, columns] * scale).ravel()
    triangles = (matrix[:, :, rows, columns] * scale).transpose(0, 2, 1)
    return triangles.reshape(len(constants), -1), constants


def upper_triangle(size: int) -> tuple[IndexArray, IndexArray]:
    """Return rows and columns of the upper triangle, column by column."""
    columns, rows = np.tril_indices(size)
    return rows, columns


def _ranks(dual: Array) -> tuple[int, ...]:
    """Return the ranks that the pseudo-inertias are pushed to, from the cones' multipliers."""
    rows, columns = upper_triangle(4)
    multipliers = np.zeros((len(dual), 4, 4))
    scale = np.where(rows == columns, 1.0, np.sqrt(0.5))
    multipliers[:, rows, columns] = multipliers[:, columns, rows] = dual * scale
    return tuple(int(4 - np.sum(np.linalg.eigvalsh(one) > _PUSH)) for one in multipliers)
