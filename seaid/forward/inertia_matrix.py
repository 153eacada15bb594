"""The mass matrix of a model, its inverse, and what every drive feels of it."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import pinocchio as pin

from seaid.arrays import Array, IndexArray
from seaid.errors import RobotError
from seaid.linear_algebra import safely

_safely = partial(safely, what="the mass matrix", error=RobotError)


def mass_matrix(model: pin.Model, data: pin.Data, position: Array) -> Array:
    """Return the mass matrix (n, n) of a model with its armature."""
    upper = np.triu(pin.crba(model, data, position))
    return np.asarray(upper + np.triu(upper, 1).T)


def inverse_inertia(
    model: pin.Model, data: pin.Data, position: Array, rotors: Array | None
) -> Array:
    """Return the inverse of the mass matrix (n, n), with `rotors` (n, n) that the model has not."""
    if rotors is not None:
        return np.asarray(_safely(np.linalg.inv, mass_matrix(model, data, position) + rotors))
    inverse = np.array(pin.computeMinverse(model, data, position))
    below = _below(len(position))
    inverse[below] = inverse.T[below]
    return inverse


@cache
def _below(n: int) -> tuple[IndexArray, IndexArray]:
    """Return the places below the diagonal, which Pinocchio leaves empty."""
    return np.tril_indices(n, -1)


def felt_inertia(model: pin.Model, C: Array, rotors: Array | None) -> Array:
    """Return the inertia (n,) that each drive feels at zero with the others free."""
    inertia = mass_matrix(model, model.createData(), np.zeros(model.nv))
    inertia = inertia if rotors is None else inertia + rotors
    return np.asarray(1 / np.diag(C @ _safely(np.linalg.solve, inertia, C.T)))
