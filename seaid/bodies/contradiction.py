"""Where no physically consistent bodies come near an estimate: which assumption is to blame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from seaid.arrays import Array
from seaid.estimation.feasible import nearest
from seaid.estimation.programme import Programme
from seaid.robot import Robot

_DEVIATIONS = 10.0
"""Standard deviations of chi-square above its mean from which data and assumptions contradict."""

_EXPLAINED = 0.9
"""Part of chi-square that an assumption must explain to be named as the one to blame."""


def contradiction(robot: Robot, programme: Programme, least: float, bounds: int) -> str | None:
    """Say what the data contradict, None where bodies come as near as errors of `least` explain.

    `least` is the least chi-square of a programme whose first `bounds` limits are those of a user.
    Each payload, all of them, and the bounds are left out in turn: what takes most of chi-square
    away is named. Raises as `nearest` does.
    """
    count = len(programme.estimate)
    if least <= count + _DEVIATIONS * np.sqrt(2.0 * count):
        return None
    text = (
        f"no physically consistent robot comes near the estimate: chi-square is at least "
        f"{least:.3g} over {count} values"
    )
    found = [
        (nearest(without).chi_square, words)
        for words, without in _assumptions(robot, programme, bounds)
    ]
    smallest, words = min(found, default=(least, ""))
    if smallest < (1 - _EXPLAINED) * least:
        return f"{text}, and {smallest:.3g} without {words}"
    known = f"known bodies ({', '.join(robot.known_bodies)}), " if robot.known_bodies else ""
    return (
        f"{text}; check {known}payloads that are missing, encoder zeros, and lengths and axes in "
        "the robot file"
    )


def _assumptions(
    robot: Robot, programme: Programme, bounds: int
) -> Iterator[tuple[str, Programme]]:
    """Return what may be wrong, in words with the remedy, and the programme without it."""
    payloads = robot.payload_parameters.reshape(-1, 10)
    loaded = np.flatnonzero(payloads[:, 0]).tolist()
    for bodies in [[body] for body in loaded] + ([loaded] if len(loaded) > 1 else []):
        one = np.zeros_like(payloads)
        one[bodies] = payloads[bodies]
        each = " and ".join(
            f"the payload of {payloads[body, 0]:.4g} kg on {robot.body_names[body]}"
            for body in bodies
        )
        yield f"{each}: check that it is on the robot, its mass and its place", _off(programme, one)
    if bounds:
        limits, values = programme.limits[bounds:], programme.bounds[bounds:]
        yield (
            "mass_bounds= and com_boxes=: check them, or leave them out",
            replace(programme, limits=limits, bounds=values),
        )


def _off(programme: Programme, payloads: Array) -> Programme:
    """Return the programme for a robot without payloads (n, 10): its bodies carry their torque."""
    carried = programme.columns[:, : payloads.size] @ payloads.ravel()
    return replace(programme, estimate=programme.estimate + carried)
