"""Periodic errors of a drive: transmission error of its gear, and ripple of its motor's torque.

An error of order n has the two amplitudes of cos(n x) and sin(n x). Its angle x is that of

- "motor": theta_M, once per turn of the motor (eccentricity, cogging, poles);
- "joint": theta_L, once per turn of the joint (the joint's encoder, the last wheel);
- "mesh": theta_M - theta_M/N, the motor relative to the output of its gear (strain-wave gears: 2).

The transmission error [rad, or m of a linear spring] adds to the deflection that the encoders show;
the spring force sees k times that, which is linear in its amplitudes. Ripple is a torque of the
motor [N m].
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from seaid.errors import RobotError, shown, unknown_name

Angle = Literal["motor", "joint", "mesh"]
"""Angles in which an error of a drive may be periodic."""

_HIGHEST_ORDER = 1000
_PARTS = ("cos", "sin")


@dataclass(frozen=True)
class Harmonic:
    """One order of a periodic error, with its amplitudes or None where they are unknown."""

    field: str
    angle: Angle
    order: int
    amplitudes: tuple[float, float] | None = None

    @property
    def names(self) -> tuple[str, str]:
        """Names of the two parameters, such as "torque_ripple_motor_6_cos"."""
        cosine, sine = (f"{self.field}_{self.angle}_{self.order}_{part}" for part in _PARTS)
        return cosine, sine


FIELDS = ("transmission_error", "torque_ripple")
"""Fields of a drive that have harmonics."""


def is_harmonic(name: str) -> bool:
    """Return whether a parameter is an amplitude of a harmonic."""
    return name.startswith(FIELDS)


def harmonics_of(field: str, given: Any) -> tuple[Harmonic, ...]:
    """Return the harmonics of a field from {angle: [orders]} or {angle: {order: [cos, sin]}}.

    Raises RobotError naming the field.
    """
    if isinstance(given, tuple) and all(isinstance(one, Harmonic) for one in given):
        return given
    if not isinstance(given, Mapping):
        raise RobotError(
            f"{field} must be a table of orders, such as {{ motor = [1, 2] }}, found {shown(given)}"
        )
    found = []
    for angle, orders in given.items():
        if angle not in get_args(Angle):
            raise RobotError(unknown_name(f"angle of {field}", angle, get_args(Angle)))
        if not isinstance(orders, Mapping | list | tuple) or not orders:
            raise RobotError(
                f"{field} {angle} must be a list of orders, or a table {{ order = [cos, sin] }} of "
                f"amplitudes, found {shown(orders)}"
            )
        for order in orders:
            amplitudes = orders[order] if isinstance(orders, Mapping) else None
            found.append(_harmonic(field, angle, order, amplitudes))
    if len({one.names for one in found}) < len(found):
        raise RobotError(f"{field} names an order twice: {shown(given)}")
    return tuple(found)


def _harmonic(field: str, angle: Angle, order: Any, amplitudes: Any) -> Harmonic:
    whole = isinstance(order, int) and not isinstance(order, bool)
    number = order if whole else int(order) if isinstance(order, str) and order.isdigit() else 0
    if not 1 <= number <= _HIGHEST_ORDER:
        raise RobotError(
            f"{field} {angle}: an order is a whole number from 1 to {_HIGHEST_ORDER}, found "
            f"{shown(order)}"
        )
    if amplitudes is None:
        return Harmonic(field, angle, number)
    pair = amplitudes if isinstance(amplitudes, list | tuple) else ()
    if len(pair) != len(_PARTS) or not all(_is_finite(x) for x in pair):
        raise RobotError(
            f"{field} {angle} {number}: the amplitudes are two finite numbers [cos, sin], found "
            f"{shown(amplitudes)}"
        )
    return Harmonic(field, angle, number, (float(pair[0]), float(pair[1])))


def _is_finite(x: Any) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x)


def harmonics_table(harmonics: Iterable[Harmonic]) -> dict[str, Any]:
    """Return harmonics as a table for TOML: lists of orders, or amplitudes where they are known."""
    table: dict[str, dict[str, list[float] | None]] = {}
    for one in harmonics:
        amplitudes = None if one.amplitudes is None else list(one.amplitudes)
        table.setdefault(one.angle, {})[str(one.order)] = amplitudes
    return {
        angle: [int(order) for order in orders] if None in orders.values() else dict(orders)
        for angle, orders in table.items()
    }
