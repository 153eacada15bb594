"""Angles of a URDF that were rounded when it was written, made the multiples of pi/2 they mean."""

from __future__ import annotations

import math
from decimal import Decimal, InvalidOperation
from typing import Any

FLOAT_NOISE_RAD = 1e-6
"""Closer than this to a multiple of pi/2 (or to zero) is float noise of an exporter."""


def snap(joint: Any, tolerance: float) -> list[str]:
    """Write the exact multiples of pi/2 into a joint's rpy; return what was rounded before."""
    origin = joint.find("origin")
    if origin is None or not origin.get("rpy") or tolerance <= 0:
        return []
    snapped, angles = [], []
    for text in origin.get("rpy").split():
        exact = _meant_angle(text, tolerance)
        if exact is not None:
            snapped.append(text)
        angles.append(text if exact is None else repr(exact))
    origin.set("rpy", " ".join(angles))
    return snapped


def _meant_angle(text: str, tolerance: float) -> float | None:
    """Return the multiple of pi/2 that a rounded angle means, None if it means itself."""
    try:
        value, exponent = float(text), Decimal(text).as_tuple().exponent
    except (ValueError, InvalidOperation):
        return None  # yourdfpy names the bad number
    if not math.isfinite(value):
        return None
    exact = round(value / (math.pi / 2)) * (math.pi / 2)
    last_digit = 10.0 ** int(exponent) if exact else 0.0
    allowed = min(tolerance, max(FLOAT_NOISE_RAD, 2 * last_digit))
    return exact if 4e-16 * max(1.0, abs(exact)) < abs(value - exact) <= allowed else None
