"""Planned motions as messages trajectory_msgs/msg/JointTrajectory, which ROS 2 controllers take."""

from __future__ import annotations

import json
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from seaid.arrays import Array, check_rate
from seaid.errors import ExcitationError

_NANO = 10**9


def message_times(duration: float, rate_hz: float) -> list[int]:
    """Return the times of the points [ns], at a rate [1/s] and at the end; whole numbers, exact.

    Raises ExcitationError for a rate that is not more than zero.
    """
    check_rate(rate_hz, duration, error=ExcitationError)
    rate, end = Fraction(rate_hz), round(Fraction(duration) * _NANO)
    times = [round(k * _NANO / rate) for k in range(int(Fraction(duration) * rate) + 1)]
    # what rounding of the duration leaves over is no point of its own
    close = len(times) > 1 and end - times[-1] < 1e-6 * _NANO / rate_hz
    return [*(times[:-1] if close or times[-1] == end else times), end]


def joint_trajectory_message(
    joint_names: Sequence[str], times: Sequence[int], states: tuple[Array, Array, Array]
) -> dict[str, Any]:
    """Return the message of `states`, position, velocity, acceleration (T, n), at `times` [ns]."""
    q, v, a = (state.tolist() for state in states)
    points = [
        {
            "positions": q[t],
            "velocities": v[t],
            "accelerations": a[t],
            "effort": [],
            "time_from_start": {"sec": time // _NANO, "nanosec": time % _NANO},
        }
        for t, time in enumerate(times)
    ]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": list(joint_names), "points": points}


def as_yaml(message: dict[str, Any]) -> str:
    """Return a message as text that is JSON and YAML alike, a line a point."""
    points = ",\n".join("  " + _text(point) for point in message["points"])
    head = {key: value for key, value in message.items() if key != "points"}
    return f'{json.dumps(head)[:-1]},\n "points": [\n{points}\n]}}\n'


def _text(value: Any) -> str:
    """Return JSON whose numbers all readers of YAML take for numbers: 1.0e-05, not 1e-05."""
    if isinstance(value, dict):
        return "{" + ", ".join(f'"{key}": {_text(part)}' for key, part in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_text, value)) + "]"
    text = json.dumps(value)
    return text if "." in text else text.replace("e", ".0e")
