"""Charts of a page as SVG text.

Axes have round ticks, and there is no script. Colours are classes of report.css, so that a chart
follows the theme and the printer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Any, Literal

import numpy as np

from seaid._arrays import Array
from seaid.report.formats import layout_of, power_of_ten, powers_of_ten, rendered
from seaid.report.html_traces import axis_time

_LAYOUT = layout_of("chart")


@dataclass(frozen=True, eq=False)
class Layer:
    """Points x, y (P,) of a chart; `name` is their class of report.css.

    Lines are interrupted at NaN.
    """

    x: Array
    y: Array
    name: str
    kind: Literal["points", "line"] = "points"

    def path(self, across: _Scale, up: _Scale) -> str:
        """Return the points as the path of an SVG."""
        x, y = across.places(self.x), up.places(self.y)
        visible = np.isfinite(x) & np.isfinite(y)
        pairs = [f"{a:.1f} {b:.1f}" for a, b in zip(x[visible], y[visible], strict=True)]
        if self.kind == "points":
            # A line of length zero with round caps is a dot: one path for all points.
            return "".join(f"M{pair}h0" for pair in pairs)
        # Where sample numbers of the visible points are not consecutive, NaN lies between.
        starts = np.diff(np.flatnonzero(visible), prepend=-2) > 1
        return "".join(
            ("M" if new else "L") + pair for new, pair in zip(starts, pairs, strict=True)
        )


@dataclass(frozen=True)
class Axis:
    """An axis: `label` without its unit, which may get a power of ten, and its ends."""

    label: str
    unit: str = ""
    low: float = math.nan
    high: float = math.nan
    is_log: bool = False


@dataclass(frozen=True, eq=False)
class Figure:
    """Layers over two axes, from the lowest up.

    `title` says to a screen reader what they show, and the `caption` stands below them.
    """

    title: str
    layers: Sequence[Layer]
    x: Axis
    y: Axis
    caption: str = ""

    @property
    def svg(self) -> Any:
        """The figure as SVG."""
        across = _Scale(self.x, _ends(self.x, [layer.x for layer in self.layers]), *_LAYOUT.across)
        up = _Scale(self.y, _ends(self.y, [layer.y for layer in self.layers], 0.05), *_LAYOUT.up)
        content = {"title": self.title, "layers": self.layers}
        return rendered("chart.svg.j2", across=across, up=up, **content)


@dataclass(frozen=True, eq=False)
class Panel:
    """Figures side by side, below the name of their joint and a note."""

    joint: str
    note: str
    figures: tuple[Figure, ...]


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
        size = max(abs(end) for end in self.ends)
        power = math.floor(math.log10(size)) if size > 0 else 0
        return 0 if self.axis.is_log or -1 <= power < 4 else power

    @property
    def label(self) -> str:
        """The label of the axis with its unit."""
        power = power_of_ten(self.power) if self.power else ""
        unit = " ".join(part for part in (power, self.axis.unit) if part)
        return f"{self.axis.label} [{unit}]" if unit else self.axis.label

    def places(self, values: Array) -> Array:
        """Return the places (P,) of values, at most one length of the axis outside."""
        low, high = self.ends
        if self.axis.is_log:
            values, (low, high) = np.log10(np.maximum(values, 1e-300)), np.log10(self.ends)
        # The inner <svg> cuts off what is outside, but renderers fail at coordinates of 1e9.
        shares = np.clip((values - low) / (high - low), -1.0, 2.0)
        return np.asarray(self.start + shares * (self.stop - self.start))

    def ticks(self) -> list[tuple[float, str]]:
        """Return the place and text of every tick."""
        from matplotlib.ticker import Locator, LogLocator, MaxNLocator

        low, high = self.ends
        locator: Locator = MaxNLocator(_LAYOUT.most_ticks, steps=[1, 2, 5, 10])
        if self.axis.is_log:
            is_short = math.log10(high / low) < _LAYOUT.few_powers
            locator = LogLocator(subs=[1, 2, 5] if is_short else [1], numticks=_LAYOUT.most_ticks)
        # A zero of the locator may be 1e-17, which is no text for a tick.
        values = np.asarray(locator.tick_values(low, high)) / 10.0**self.power
        values = np.round(values, 12) + 0.0
        places = self.places(values * 10.0**self.power)
        texts = [powers_of_ten(f"{value:g}").removeprefix("1·") for value in values.tolist()]
        inside = (places - self.start) * (places - self.stop) <= 1e-6
        return list(compress(zip(places.tolist(), texts, strict=True), inside.tolist()))


def _ends(axis: Axis, values: Sequence[Array], margin: float = 0.02) -> tuple[float, float]:
    """Return the ends of an axis: as given, else of the finite values with a margin."""
    known = np.concatenate([np.zeros(0), *(x[np.isfinite(x)] for x in values)])
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


def traces_figure(
    time: Array, traces: Mapping[str, Array], y: Axis, title: str, caption: str
) -> Figure:
    """Return traces (T,) over time; their names are classes of report.css."""
    step = -(-len(time) // _LAYOUT.most_samples)
    instants = axis_time(time)[::step]
    layers = [Layer(instants, trace[::step], name, "line") for name, trace in traces.items()]
    return Figure(title, layers, Axis("time", "s"), y, caption)
