"""Motor constants need something known: else every parameter could be larger by a factor."""

from __future__ import annotations

import numpy as np

from seaid.errors import IdentificationError
from seaid.estimation.information import Information
from seaid.linear_algebra import safely

CONSTANTS = {"torque_constant": "current", "voltage_constant": "voltage"}
"""Parameters that turn what is logged of a motor into its torque."""

_ROUNDING = 1e-9

_LOST, _PART = 1e-7, 0.01
"""A combination of columns that is lost, and the least part of it that a constant has then."""

_BY_LOAD = "known bodies (known_bodies=), logs with and without a payload (identify_conditions), "
_BY_SPRING = "the stiffness of its spring (known = ['stiffness']), "


def check_scale(information: Information) -> None:
    """Raise IdentificationError where a motor constant is unknown and nothing fixes the scale.

    Then the equations are homogeneous, and least squares finds zero for all that is in them. A
    payload that is always there does not help: it could as well be part of its body.
    """
    places = {
        place: name.split(" of ", 1)
        for place, name in enumerate(information.names)
        if name.split(" of ", 1)[0] in CONSTANTS
    }
    if not places or not information.count:  # without any row `solve` says so
        return
    R, p = information.weighted_factor(), len(information.names)
    norms = np.linalg.norm(R[:, :p], axis=0)
    U, sizes, Vt = safely(
        np.linalg.svd, R[:p, :p] / np.where(norms > 0, norms, 1.0), what="the scale of the torques"
    )
    told = sizes > _LOST * sizes[0]
    theta = Vt[told].T @ ((U.T @ R[:p, p])[told] / sizes[told])
    least = _ROUNDING * float(np.linalg.norm(R[:, p]))
    open_part = np.max(np.abs(Vt[~told]), axis=0, initial=0.0)
    for place, (name, *where) in places.items():
        if abs(theta[place]) <= least or open_part[place] > _PART:
            joint = where[0] if where else information.joint_names[information.equations[0]]
            raise IdentificationError(
                f"of the motor of {joint} only the {CONSTANTS[name]} was logged, and nothing known "
                f"tells its {name.replace('_', ' ')}: all torques could be larger by a factor. "
                f"Give one of: {_BY_LOAD if where else _BY_SPRING}its rotor inertia, or the constant "
                f"itself (known = ['{name}'])"
            )
