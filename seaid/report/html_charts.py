"""Small charts as SVG text: axes with round ticks, points and lines; without a script.

Colours are classes of report.css, so that a chart follows the theme and the printer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Literal

import numpy as np

from seaid._arrays import Array

_WIDTH, _HEIGHT = 460.0, 300.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 10.0, 10.0, 44.0
_TICKS = 5
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True, eq=False)
class Layer:
    """Points x, y (P,) of a chart; `name` is their class of report.css.

    Lines are interrupted at NaN.
    """

    x: Array
    y: Array
    name: str
    kind: Literal["points", "line"] = "points"


@dataclass(frozen=True)
class Axis:
    """An axis: `label` without its unit, which may get a power of ten, and its ends."""

    label: str
    unit: str = ""
    low: float = math.nan
    high: float = math.nan
    is_log: bool = False


def chart(
    layers: Sequence[Layer],
    x: Axis,
    y: Axis,
    *,
    title: str,
    width: float = _WIDTH,
    height: float = _HEIGHT,
) -> Any:
    """Return a chart as SVG; `title` says to a screen reader what it shows."""
    from markupsafe import Markup

    across = _Scale(x, _ends(x, [one.x for one in layers]), _LEFT, width - _RIGHT)
    up = _Scale(y, _ends(y, [one.y for one in layers], 0.05), height - _BOTTOM, _TOP)
    parts = [
        f'<svg class="plot" role="img" viewBox="0 0 {width:g} {height:g}" '
        f'aria-label="{escape(title)}">',
        *_grid(across, up, width, height),
        f'<svg x="{_LEFT:g}" y="{_TOP:g}" width="{width - _LEFT - _RIGHT:g}" '
        f'height="{height - _TOP - _BOTTOM:g}" viewBox="{_LEFT:g} {_TOP:g} '
        f'{width - _LEFT - _RIGHT:g} {height - _TOP - _BOTTOM:g}">',  # cuts what is outside
        *(_drawn(one, across, up) for one in layers),
        "</svg></svg>",
    ]
    return Markup("".join(parts))


def powers_of_ten(text: str) -> str:
    """Return a number such as 1.2e-05 as 1.2·10⁻⁵, other numbers with a proper minus."""
    mantissa, _, exponent = text.replace("−", "-").partition("e")
    raised = f"·10{str(int(exponent)).translate(_SUPERSCRIPTS)}" if exponent else ""
    return mantissa.replace("-", "−") + raised


@dataclass(frozen=True)
class _Scale:
    """A map from values to places along an axis, `start` to `stop` in units of the SVG."""

    axis: Axis
    ends: tuple[float, float]
    start: float
    stop: float

    @property
    def power(self) -> int:
        """The power of ten in the label of the axis."""
        size = max(abs(one) for one in self.ends)
        power = math.floor(math.log10(size)) if size > 0 else 0
        return 0 if self.axis.is_log or -1 <= power < 4 else power

    @property
    def label(self) -> str:
        power = f"10{str(self.power).translate(_SUPERSCRIPTS)}" if self.power else ""
        unit = " ".join(one for one in (power, self.axis.unit) if one)
        return f"{self.axis.label} [{unit}]" if unit else self.axis.label

    def places(self, values: Array) -> Array:
        """Return the places (P,) of values, at most one length of the axis outside."""
        low, high = self.ends
        if self.axis.is_log:
            values, (low, high) = np.log10(np.maximum(values, 1e-300)), np.log10(self.ends)
        shares = np.clip((values - low) / (high - low), -1.0, 2.0)
        return np.asarray(self.start + shares * (self.stop - self.start))

    def ticks(self) -> list[tuple[float, str]]:
        """Return the place and text of every tick."""
        low, high = self.ends
        if self.axis.is_log:
            powers = range(
                math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9) + 1
            )
            step = max(1, math.ceil(len(powers) / 7))
            values = [10.0**power for power in powers[::step]]
            texts = [f"10{str(power).translate(_SUPERSCRIPTS)}" for power in powers[::step]]
        else:
            step_size = _round_step((high - low) / _TICKS)
            count = range(
                math.ceil(low / step_size - 1e-9), math.floor(high / step_size + 1e-9) + 1
            )
            values = [k * step_size for k in count]
            texts = [_tick(one / 10.0**self.power, step_size / 10.0**self.power) for one in values]
        return list(zip(self.places(np.array(values)).tolist(), texts, strict=True))


def _round_step(least: float) -> float:
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= least * (1 - 1e-9))


def _tick(value: float, step: float) -> str:
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    return f"{value + 0.0:.{decimals}f}".replace("-", "−") if abs(value) > 1e-9 * step else "0"


def _ends(axis: Axis, values: Sequence[Array], margin: float = 0.02) -> tuple[float, float]:
    """Return the ends of an axis: as given, else of the finite values with a margin."""
    known = np.concatenate([one[np.isfinite(one)] for one in values] or [np.zeros(0)])
    low = axis.low if math.isfinite(axis.low) else float(np.min(known, initial=np.inf))
    high = axis.high if math.isfinite(axis.high) else float(np.max(known, initial=-np.inf))
    if not low < high:
        middle = low if math.isfinite(low) else 0.0
        return (0.5 * middle, 2 * middle) if axis.is_log else (middle - 1.0, middle + 1.0)
    if axis.is_log:
        return low, high
    room = margin * (high - low)
    return (
        low if math.isfinite(axis.low) else low - room,
        high if math.isfinite(axis.high) else high + room,
    )


def _grid(across: _Scale, up: _Scale, width: float, height: float) -> list[str]:
    """Return grid lines, ticks and labels."""
    bottom = height - _BOTTOM
    lines = "".join(f"M{place:.1f} {_TOP:g}V{bottom:g}" for place, _ in across.ticks())
    lines += "".join(f"M{_LEFT:g} {place:.1f}H{width - _RIGHT:g}" for place, _ in up.ticks())
    middle = (bottom + _TOP) / 2
    return [
        f'<path class="grid" d="{lines}"/>',
        *(
            f'<text x="{place:.1f}" y="{bottom + 16:g}" text-anchor="middle">{text}</text>'
            for place, text in across.ticks()
        ),
        *(
            f'<text x="{_LEFT - 6:g}" y="{place + 4:.1f}" text-anchor="end">{text}</text>'
            for place, text in up.ticks()
        ),
        f'<text class="of-axis" x="{(width + _LEFT - _RIGHT) / 2:g}" y="{height - 8:g}" '
        f'text-anchor="middle">{escape(across.label)}</text>',
        f'<text class="of-axis" text-anchor="middle" '
        f'transform="translate(13 {middle:g}) rotate(-90)">{escape(up.label)}</text>',
    ]


def _drawn(layer: Layer, across: _Scale, up: _Scale) -> str:
    x, y = across.places(layer.x), up.places(layer.y)
    there = np.isfinite(x) & np.isfinite(y)
    pairs = [f"{a:.1f} {b:.1f}" for a, b in zip(x[there], y[there], strict=True)]
    if layer.kind == "points":
        path = "".join(f"M{pair}h0" for pair in pairs)
    else:
        starts = np.diff(np.flatnonzero(there), prepend=-2) > 1
        path = "".join(
            ("M" if new else "L") + pair for new, pair in zip(starts, pairs, strict=True)
        )
    return f'<path class="{layer.kind} {layer.name}" d="{path}"/>'
