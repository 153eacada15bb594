"""Residuals of weighted least squares over and over with other weights: cheap, and as exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from seaid.arrays import Array
from seaid.estimation.information import Information
from seaid.linear_algebra import safely

_MOST_UNEQUAL = 1e4
"""Largest over smallest weight up to which the products below lose nothing that matters."""


@dataclass(frozen=True, eq=False)
class Orthonormal:
    """Equations in parameters in which the rows of all of them together are orthonormal.

    With R the factor of all rows and theta_0 its solution, z = R (theta - theta_0): an equation's
    residual is `residuals` (E, m) - `columns` (E, m, p) z, and `products` (E, p, p) are C^T C of
    its columns C, which add up to the identity. However badly conditioned the regressor is,
    weighted normal equations in z are only as badly conditioned as the weights are unequal,
    squared.
    """

    columns: Array
    residuals: Array
    products: Array

    def residual_norms(self, weights: Array) -> Array | None:
        """Return the norm (E,) of each equation's residual at the estimate with weights (E,).

        None where the weights are too unequal for it.
        """
        if np.max(weights) > _MOST_UNEQUAL * np.min(weights):
            return None
        squares = weights**2
        normal = np.tensordot(squares, self.products, 1)
        z = safely(
            linalg.solve,
            normal,
            np.einsum("e,emp,em->p", squares, self.columns, self.residuals, optimize=True),
            what="the weighted equations",
            assume_a="pos",
            check_finite=False,
        )
        return np.asarray(np.linalg.norm(self.residuals - self.columns @ z, axis=1))


def orthonormal(information: Information, theta: Array) -> Orthonormal:
    """Return the equations of information whose unweighted solution is `theta` (p,), p > 0."""
    p = len(information.names)
    factors = information.filled_factors
    R = information.weighted_factor()[:p, :p]
    residuals = factors @ np.append(-theta, 1.0)
    stacked = factors[:, :, :p].reshape(-1, p)
    columns = safely(
        linalg.solve_triangular,
        R,
        stacked.T,
        what="the equations",
        trans="T",
        check_finite=False,
    ).T
    columns = columns.reshape(*factors.shape[:2], p)
    return Orthonormal(columns, residuals, columns.swapaxes(1, 2) @ columns)
