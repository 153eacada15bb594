"""Signs that cannot be right: a torque that was logged with the other sign, said in words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from seaid.arrays import Array
from seaid.base import random_states
from seaid.rigid_body import regressor_at_drives
from seaid.transmission import at_joints

if TYPE_CHECKING:
    from seaid.estimation.estimate import Estimate
    from seaid.identification import Identification

_SURE = 2.0
_FEWEST = 2
_POSTURES = 40
_OWN = {
    "viscous_friction": "viscous friction",
    "coulomb_friction": "Coulomb friction",
    "stiffness": "stiffness",
}


def sign_flags(found: Identification) -> tuple[str, ...]:
    """Return a sentence for every joint whose torque looks flipped.

    Friction and stiffness are positive, so is the inertia that a joint feels, and where the robot
    was given masses, gravity pulls as they do. A torque looks flipped if two of these or more fit
    with a minus beyond doubt and none with a plus; inertia and gravity, which the torques of other
    joints tell too, are not heard against friction and stiffness.
    """
    flags = []
    for joint in found.known.joint_names:
        own = dict(_own_signs(found, joint))
        if 1 in own.values():  # contradicted, whatever the others say
            continue
        shared = dict(_shared_signs(found, joint))
        minus = [name for name, sign in (own | shared).items() if sign < 0]
        own_minus = [name for name in minus if name in own]
        contradicted = 1 in shared.values() and len(own_minus) < _FEWEST
        if len(minus) >= _FEWEST and not contradicted:
            what = " and ".join([", ".join(minus[:-1]), minus[-1]])
            number = "both" if len(minus) == _FEWEST else "all"
            flags.append(
                f"the torque of {joint} looks flipped: {what} {number} fit with a minus; check the "
                "sign of its torque column against that of its position"
            )
    return tuple(flags)


def _own_signs(found: Identification, joint: str) -> Iterator[tuple[str, int]]:
    """Return what has a known sign in a drive: 1 as it should be, -1 the other way, 0 not sure."""
    drive = found.drivetrains.get(joint)
    if drive is None:
        return
    for place, name in enumerate(drive.names):
        if name in _OWN:
            yield _OWN[name], _sure(float(drive.values[place]), drive.standard_errors[place])


def _shared_signs(found: Identification, joint: str) -> Iterator[tuple[str, int]]:
    """Return the same of what the load on a joint has."""
    if joint not in found.model.rows:
        return
    yield "inertia", _sign(found.load, _inertia(found, joint))
    gravity = _gravity(found, joint)
    if gravity is not None:
        yield "gravity", _sign(found.load, gravity)


def _sign(load: Estimate, direction: Array) -> int:
    """Return the sign of a combination (p,) of the base parameters, 0 where it is not sure."""
    variance = max(float(direction @ load.covariance @ direction), 0.0)
    return _sure(float(direction @ load.values), variance**0.5)


def _sure(value: float, error: float) -> int:
    return int(np.sign(value)) if abs(value) > _SURE * error else 0


def _inertia(found: Identification, joint: str) -> Array:
    """Return the mean inertia that a joint feels over all postures, in the base parameters (p,)."""
    robot = found.known
    q, v, _ = (state[:_POSTURES] for state in random_states(robot, seed=2))
    index = robot.index(joint)
    pushed = np.zeros_like(q)
    pushed[:, index] = 1.0
    pushed = at_joints(robot.transmission, pushed)
    rows = regressor_at_drives(robot, q, 0 * v, pushed) - regressor_at_drives(
        robot, q, 0 * v, 0 * v
    )
    return np.asarray(np.mean(found.base.reduce(rows)[:, index], axis=0))


def _gravity(found: Identification, joint: str) -> Array | None:
    """Return gravity in the base parameters (p,) as the given masses turn it; None without them."""
    robot = found.known
    if not np.all(np.isfinite(robot.parameters)):
        return None
    q, v, _ = (state[:_POSTURES] for state in random_states(robot, seed=3))
    rows = found.base.reduce(regressor_at_drives(robot, q, 0 * v, 0 * v))[:, robot.index(joint)]
    expected = rows @ found.base.project(robot.parameters)
    size = float(expected @ expected)
    return np.asarray(expected @ rows / size) if size > 0 else None
