"""Charts of a page as SVG text: singular values, correlations, and copies of traces for paper.

Axes have round ticks, and there is no script. Colours are classes of report.css, so that a chart
follows the theme and the printer.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from seaid._arrays import Array
from seaid.drives import ParameterName, readable
from seaid.estimation.estimate import POORLY_DETERMINED
from seaid.estimation.least_squares import settled_weights
from seaid.estimation.qr_factor import directions, first_term, qr_factor_of
from seaid.regressor import load_regression
from seaid.regressor.load import with_gear_torque
from seaid.regressor.regression import stacked, under_load
from seaid.report import formats
from seaid.report.formats import (
    Column,
    Table,
    is_partial,
    power_of_ten,
    powers_of_ten,
    rendered,
    table_of,
    words,
)
from seaid.report.html_traces import SIDES, Run, axis_time, torque_units

if TYPE_CHECKING:
    from seaid.identification import Identification
    from seaid.log import Motion
    from seaid.robot import Robot

_WIDTH, _HEIGHT = 460.0, 300.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 10.0, 10.0, 44.0
_TICKS = 5
_FEW_POWERS = 3
"""Powers of ten of an axis below which it has ticks at 2 and 5 of each too."""


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
    across = _Scale(x, _ends(x, [layer.x for layer in layers]), _LEFT, width - _RIGHT)
    up = _Scale(y, _ends(y, [layer.y for layer in layers], 0.05), height - _BOTTOM, _TOP)
    margins = {"left": _LEFT, "right": _RIGHT, "top": _TOP, "bottom": _BOTTOM}
    size = {"width": width, "height": height}
    content = {"across": across, "up": up, "layers": layers, "margins": margins, **size}
    return rendered("chart.svg.j2", title=title, **content)


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
        low, high = self.ends
        if self.axis.is_log:
            values, texts = _log_ticks(low, high)
        else:
            step_size = _round_step((high - low) / _TICKS)
            first, last = math.ceil(low / step_size - 1e-9), math.floor(high / step_size + 1e-9)
            values = [k * step_size for k in range(first, last + 1)]
            texts = [_tick(x / 10.0**self.power, step_size / 10.0**self.power) for x in values]
        return list(zip(self.places(np.array(values)).tolist(), texts, strict=True))


def _log_ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Return the values of the ticks of a logarithmic axis, and their texts."""
    powers = range(math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9) + 1)
    if len(powers) < _FEW_POWERS:
        start = math.floor(math.log10(low))
        every = (m * 10.0**p for p in range(start, start + 5) for m in (1, 2, 5))
        values = [value for value in every if low <= value <= high]
        return values, [powers_of_ten(f"{value:g}") for value in values]
    powers = powers[:: max(1, math.ceil(len(powers) / 7))]
    return [10.0**power for power in powers], [power_of_ten(power) for power in powers]


def _round_step(least: float) -> float:
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= least * (1 - 1e-9))


def _tick(value: float, step: float) -> str:
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    return f"{value + 0.0:.{decimals}f}".replace("-", "−") if abs(value) > 1e-9 * step else "0"


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


@dataclass(frozen=True, eq=False)
class SingularValues:
    """Singular values of the load side relative to the largest, in decreasing order.

    `combinations` describes the parameter combinations of the smallest ones; a combination is
    poorly determined below the `threshold`.
    """

    shares: Array
    combinations: tuple[str, ...]
    threshold: float = POORLY_DETERMINED


def singular_values(result: Identification) -> SingularValues | None:
    """Return the singular values of the load side over all motions, None for long logs.

    Columns have unit norm, rows are weighted by their joint's residual, as in weighted least
    squares: the ratio of largest and smallest is the condition number.
    """
    if not result.motions or not result.model.names:
        return None
    motions = fitted_motions(result)
    # Motions are stacked, then reduced to triangles [R y], whose singular values are those of H.
    qr_factor = qr_factor_of(
        stacked([load_regression(result.known, m, result.model, result.springs) for m in motions])
    )
    found_directions = directions(
        qr_factor.weighted_factor(settled_weights(qr_factor)), qr_factor.names
    )
    count = len(found_directions.shares)
    smallest = range(count - 1, max(count - 4, -1), -1)
    return SingularValues(
        found_directions.shares, tuple(found_directions.text(place) for place in smallest)
    )


def fitted_motions(identification: Identification) -> list[Motion]:
    """Return the motions used, with the torque through the gears where friction depends on it."""
    # Friction that depends on the load needs the torque through the gear, which the fit has made.
    if not under_load(identification.known, identification.model.torque_joints):
        return list(identification.motions)
    model, theta = identification.model, identification.load_side.values
    return [
        with_gear_torque(identification.known, motion, model, identification.springs, theta)
        for motion in identification.motions
    ]


@dataclass(frozen=True, eq=False)
class CorrelationMap:
    """Correlations of estimated parameters: `names` (p,), and the estimate of each, `blocks` (p,).

    `values` (p, p) are NaN between separate estimates. `total` counts the parameters including
    those excluded for weak correlations; `strongest` lists (name, name, correlation).
    """

    names: tuple[str, ...]
    blocks: tuple[int, ...]
    values: Array
    total: int
    strongest: tuple[tuple[str, str, float], ...]


_MOST_PARAMETERS, _STRONGEST, _STRONG = 110, 10, 0.7


def correlation_map(identification: Identification) -> CorrelationMap:
    """Return the correlations of all estimates, or of the most correlated 110 parameters."""
    estimates = list(_estimates(identification))
    names = [*chain.from_iterable(block_names for block_names, _ in estimates)]
    blocks = np.array([k for k, (_, part) in enumerate(estimates) for _ in part], dtype=int)
    total = len(names)
    values = np.full((total, total), np.nan)
    for block, (_, part) in enumerate(estimates):
        values[np.ix_(blocks == block, blocks == block)] = part
    # Without the ones of the diagonal, and with zero where separate estimates have no correlation.
    others = np.abs(np.nan_to_num(values - np.eye(total)))
    kept = np.arange(total)
    if total > _MOST_PARAMETERS:
        # Those with the strongest correlation to any other, again in the order of the parameters.
        kept = np.sort(np.argsort(-others.max(axis=0), kind="stable")[:_MOST_PARAMETERS])
    rows, columns = np.triu_indices(total, 1)
    order = np.argsort(-others[rows, columns], kind="stable")[:_STRONGEST]
    strongest = [
        (names[rows[k]], names[columns[k]], float(values[rows[k], columns[k]]))
        for k in order
        if others[rows[k], columns[k]] > _STRONG
    ]
    return CorrelationMap(
        names=tuple(names[place] for place in kept),
        blocks=tuple(blocks[kept].tolist()),
        values=values[np.ix_(kept, kept)],
        total=total,
        strongest=tuple(strongest),
    )


def _estimates(identification: Identification) -> Iterator[tuple[list[str], Array]]:
    """Yield the short names and the correlations of each estimate: drives, then the load."""
    load = identification.load_side
    for joint in identification.known.elastic_joints:
        drive = identification.drives[joint]
        # What acts behind the spring, such as joint friction, is estimated with the load below.
        kept = [
            i for i, name in enumerate(drive.names) if ParameterName(name, joint) not in load.names
        ]
        if kept:
            named = [readable(ParameterName(drive.names[i], joint)) for i in kept]
            yield named, drive.correlation[np.ix_(kept, kept)]
    if load.names:
        bodies = [first_term(name) for name in identification.model.expressions]
        yield [*bodies, *map(readable, load.names[len(bodies) :])], load.correlation


@dataclass(frozen=True)
class Cells:
    """Cells of a map with the same sign and strength (1 to 10), as the path of an SVG."""

    sign: str
    strength: int
    path: str


def cells_of(shown: CorrelationMap) -> list[Cells]:
    """Return the lower triangle of a map with unit cells, one path per colour."""
    rows, columns = np.tril_indices(len(shown.names), -1)
    values = shown.values[rows, columns]
    paths: dict[tuple[str, int], list[str]] = {}
    for row, column, value in zip(rows, columns, values, strict=True):
        strength = 0 if math.isnan(value) else math.ceil(10 * min(abs(value), 1.0) - 1e-9)
        sign = "none" if math.isnan(value) else "plus" if value > 0 else "minus"
        if strength or sign == "none":
            paths.setdefault((sign, strength), []).append(f"M{column} {row}h1v1h-1z")
    return [Cells(sign, strength, "".join(path)) for (sign, strength), path in paths.items()]


def strongest_table(shown: CorrelationMap) -> Table:
    """Return the strongest correlations of a map."""
    caption = (
        "The strongest correlations: such parameters are better identifiable in combination than "
        "individually."
    )
    columns = (*words("parameter", "with"), Column("correlation", formats.TWO_DIGITS))
    return table_of("correlations", caption, columns, shown.strongest)


def packed_correlations(shown: CorrelationMap) -> str:
    """Return the whole map in hundredths as base64 of signed bytes, -128 for NaN."""
    steps = np.where(np.isnan(shown.values), -128, np.round(100 * np.nan_to_num(shown.values)))
    return base64.b64encode(steps.astype(np.int8).tobytes()).decode("ascii")


def singular_chart(singular: SingularValues) -> Any:
    """Return the singular values over their number as a chart with a logarithmic axis."""
    # Zero has no logarithm; 1e-16 is what rounding leaves of it.
    shares = np.maximum(singular.shares, 1e-16)
    lowest = min(float(shares.min()), POORLY_DETERMINED)
    count = np.arange(1.0, len(shares) + 1.0)
    ends = np.array([0.0, len(shares) + 1.0])
    layers = [
        Layer(count, shares, "singular"),
        Layer(ends, np.full(2, singular.threshold), "threshold", "line"),
    ]
    return chart(
        layers,
        Axis("number of the combination, best determined first", "", 0.0, len(shares) + 1.0),
        Axis(
            "singular value over the largest", "", 10.0 ** math.floor(math.log10(lowest)), 1.3, True
        ),
        title="Singular values of the load side",
        width=760.0,
        height=260.0,
    )


_PRINTED_JOINTS, _PRINTED_SAMPLES = 8, 700


@dataclass(frozen=True)
class Picture:
    """A static copy of the traces of a joint, for paper, with its caption."""

    svg: Any
    caption: str


def printed_traces(robot: Robot, runs: Sequence[Run]) -> list[Picture]:
    """Return the traces of some joints of runs from the best to the worst predicted, by side."""
    return [
        _printed(run, side, index, torque_units(robot, side)[index])
        for run in runs
        for side in SIDES
        for index in _from_best_to_worst(getattr(run.result, side).relative_error)
    ]


def _from_best_to_worst(errors: Array) -> list[int]:
    joints = np.flatnonzero(np.isfinite(errors))
    if not len(joints):
        return []
    order = joints[np.argsort(errors[joints], kind="stable")]
    few = np.unique(np.linspace(0, len(order) - 1, _PRINTED_JOINTS).round().astype(int))
    return sorted(order[few].tolist())


def _printed(run: Run, side: str, index: int, unit: str) -> Picture:
    result = run.result
    fit, joint = getattr(result, side), result.joints[index]
    step = max(1, len(result.time) // _PRINTED_SAMPLES)
    time = axis_time(result.time)
    layers = [
        Layer(time[::step], trace[::step, index], name, "line")
        for name, trace in (("measured", fit.measured), ("computed", fit.computed))
    ]
    of = "motor torque" if side == "actuator" else "torque on the load"
    svg = chart(
        layers,
        Axis("time", "s"),
        Axis(of, unit),
        title=f"{joint}: {of}, measured and computed",
        width=760.0,
        height=230.0,
    )
    error, counted = (
        f"{100 * value[index]:.2g}\N{NO-BREAK SPACE}%"
        for value in (fit.relative_error, fit.counted_share)
    )
    if is_partial(float(fit.counted_share[index])):
        error += f" in the {counted} of the samples that are away from standstill"
    caption = (
        f"{joint}, {side} side, {run.name}: measured (wide) and computed (thin), error {error}."
    )
    return Picture(svg, caption)
