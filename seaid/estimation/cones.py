"""Programmes over semidefinite and exponential cones, solved by Clarabel (extra `feasible`)."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from seaid.arrays import Array, IndexArray
from seaid.errors import IdentificationError


def solve_cones(
    quadratic: Array,
    linear: Array,
    A: Array,
    b: Array,
    inequalities: int,
    triangles: tuple[int, ...],
    exponentials: int = 0,
) -> tuple[Array, Array]:
    """Return the x of least sum of quadratic x^2 / 2 + linear x with A x + b in cones, multipliers.

    The cones in the order of the rows: so many `inequalities` (>= 0), upper `triangles` of positive
    semidefinite matrices of these sizes as `triangle_rows` has them, and `exponentials` of three
    rows (r, s, t), s exp(r / s) <= t. Raises IdentificationError without Clarabel, and with the
    solver's status where it fails.
    """
    try:
        import clarabel
    except ImportError:
        raise IdentificationError(
            "possible bodies need the package clarabel: pip install 'seaid[feasible]'"
        ) from None
    kinds = [clarabel.NonnegativeConeT(inequalities)] * bool(inequalities)
    kinds += [clarabel.PSDTriangleConeT(size) for size in triangles]
    kinds += [clarabel.ExponentialConeT()] * exponentials
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    P = sparse.diags(quadratic, format="csc")
    solver = clarabel.DefaultSolver(P, linear, sparse.csc_matrix(-A), b, kinds, settings)
    solution = solver.solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise IdentificationError(
            f"the semidefinite programme of possible bodies failed: {solution.status} after "
            f"{solution.iterations} iterations; check the bounds, and that the covariance of the "
            "estimate is finite"
        )
    return np.array(solution.x), np.array(solution.z)


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
