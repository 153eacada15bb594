"""Motor constants need something known: else every parameter could be larger by a factor."""

from __future__ import annotations

import numpy as np

from seaid.errors import IdentificationError
from seaid.estimation.information import Information

CONSTANTS = {"torque_constant": "current", "voltage_constant": "voltage"}
"""Parameters that turn what is logged of a motor into its torque."""

_ROUNDING = 1e-9

_SPRING = "the stiffness of its spring (known = ['stiffness']), "


def check_scale(information: Information) -> None:
    """Raise IdentificationError where a motor constant is unknown and nothing fixes the scale.

    Then the equations are homogeneous, and least squares finds zero for all that is in them.
    """
    places = {
        place: name.split(" of ", 1)
        for place, name in enumerate(information.names)
        if name.split(" of ", 1)[0] in CONSTANTS
    }
    if not places:
        return
    R, p = information.weighted_factor(), len(information.names)
    norms = np.linalg.norm(R[:, :p], axis=0)
    theta = np.linalg.lstsq(R[:p, :p] / np.where(norms > 0, norms, 1.0), R[:p, p], rcond=1e-9)[0]
    least = _ROUNDING * float(np.linalg.norm(R[:, p]))
    for place, (name, *where) in places.items():
        if abs(theta[place]) <= least:
            joint = where[0] if where else information.joint_names[information.equations[0]]
            known = "a payload (payloads=), known bodies (known_bodies=), "
            raise IdentificationError(
                f"of the motor of {joint} only the {CONSTANTS[name]} was logged, and nothing known "
                f"tells its {name.replace('_', ' ')}: all torques could be larger by a factor. "
                f"Give one of: {known if where else _SPRING}its rotor inertia, or the constant "
                f"itself (known = ['{name}'])"
            )
