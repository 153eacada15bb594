"""What dry friction holds: motors behind stiff gears and rubbing joints that must stay at rest."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin

from seaid.arrays import Array, IndexArray
from seaid.errors import RobotError
from seaid.forward.inertia_matrix import inverse_inertia
from seaid.forward.plant import JOINT_POSITION, Plant
from seaid.linear_algebra import safely

_safely = partial(safely, what="what dry friction holds", error=RobotError)


def held_rows(plant: Plant, held: IndexArray) -> Array:
    """Return what held drives and joints turn, as rows (held, n) on the joints."""
    n = len(plant.elastic)
    turned = np.eye(n) if plant.coupling is None else plant.coupling
    return np.vstack([turned, np.eye(n)[plant.rubbing]])[held]


def without(plant: Plant, joint: Array, held: IndexArray) -> Array:
    """Return joint speeds or accelerations without those of held drives and joints: no creeping."""
    n = len(joint)
    if plant.coupling is not None:
        rows = held_rows(plant, held)
        joint = joint - _safely(np.linalg.pinv, rows) @ (rows @ joint)
        held = held[held >= n]
    joint[plant.places[held]] = 0.0
    return joint


def holding(
    plant: Plant, data: pin.Data, state: Array, joint: Array, held: IndexArray
) -> tuple[Array, Array]:
    """Return the torques that keep held drives and joints still, and their joint accelerations."""
    inverse = inverse_inertia(plant.model, data, state[JOINT_POSITION], plant.rotors)
    if plant.coupling is None:
        places = plant.places[held]
        torque = np.asarray(
            -_safely(np.linalg.solve, inverse[np.ix_(places, places)], joint[places])
        )
        return torque, np.asarray(inverse[:, places] @ torque)
    rows = held_rows(plant, held)
    torque = np.asarray(-_safely(np.linalg.lstsq, rows @ inverse @ rows.T, rows @ joint)[0])
    return torque, np.asarray(inverse @ rows.T @ torque)
