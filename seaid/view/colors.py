"""The colours of spring deflections: symmetric about zero, told apart by the colour-blind too."""

from __future__ import annotations

import numpy as np

from seaid.arrays import Array
from seaid.view.shapes import Color

NEUTRAL: Color = (88, 94, 102)
"""Of joints without a spring, and where its deflection is not known."""

_STOPS = np.array(
    [(20, 78, 186), (104, 172, 232), (255, 243, 186), (245, 144, 66), (186, 34, 18)], dtype=float
)
"""Blue, light blue, pale yellow, orange, red; at -1, -1/2, 0, 1/2 and 1."""


def deflection_colors(deflection: Array, limit: Array) -> list[Color]:
    """Return the colour of each deflection (n,) on scales from -limit to limit (n,).

    Beyond the limit it is that of the limit; NaN, and a limit that is not more than zero, have the
    neutral one.
    """
    known = np.isfinite(deflection) & (limit > 0)
    part = np.where(known, deflection, 0.0) / np.where(known, limit, 1.0)
    at = np.linspace(-1.0, 1.0, len(_STOPS))
    channels = [np.interp(part, at, stops) for stops in _STOPS.T]
    painted = np.round(np.column_stack(channels)).astype(int)
    return [
        (int(red), int(green), int(blue)) if told else NEUTRAL
        for (red, green, blue), told in zip(painted, known, strict=True)
    ]


def hexadecimal(color: Color) -> str:
    """Return a colour as web pages write it, '#1450b4'."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def gradient() -> str:
    """Return the scale as a CSS background, from -limit at its left to limit at its right."""
    stops = ", ".join(hexadecimal((int(r), int(g), int(b))) for r, g, b in _STOPS)
    return f"linear-gradient(to right, {stops})"
