"""Charts of a page as SVG text, and the traces of its logs, thinned and packed.

Axes have round ticks, and there is no script in a chart. Colours are classes of report.css, so that
it follows the theme and the printer. Low-pass filtered traces are decimated without visible loss.
If the page has no room for all joints, the smallest and largest sample of every interval are kept
instead, which preserves peaks.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from seaid._arrays import Array, IndexArray
from seaid.drives import COMMANDS, IDEAL_DRIVE
from seaid.report.formats import layout_of, power_of_ten, powers_of_ten, rendered

if TYPE_CHECKING:
    from seaid.identification import Fit, Identification, Validation
    from seaid.log import Motion
    from seaid.robot import Robot

SIDES = ("actuator", "load")

_CHART, _TRACES = layout_of("chart"), layout_of("traces")


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
        across = _Scale(self.x, _ends(self.x, [layer.x for layer in self.layers]), *_CHART.across)
        up = _Scale(self.y, _ends(self.y, [layer.y for layer in self.layers], 0.05), *_CHART.up)
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
        locator: Locator = MaxNLocator(_CHART.most_ticks, steps=[1, 2, 5, 10])
        if self.axis.is_log:
            is_short = math.log10(high / low) < _CHART.few_powers
            locator = LogLocator(subs=[1, 2, 5] if is_short else [1], numticks=_CHART.most_ticks)
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
    step = -(-len(time) // _CHART.most_samples)
    instants = axis_time(time)[::step]
    layers = [Layer(instants, trace[::step], name, "line") for name, trace in traces.items()]
    return Figure(title, layers, Axis("time", "s"), y, caption)


@dataclass(frozen=True, eq=False)
class Run:
    """A motion with measured and computed torques; `is_unseen`: not used for identification."""

    name: str
    result: Validation
    is_unseen: bool


def traces_of(identification: Identification, runs: Sequence[Run]) -> dict[str, Any]:
    """Return runs as packed traces by side and joint; unseen logs take precedence for room."""
    runs = _drawn_runs(runs)
    count = sum(map(_count, runs))
    room = int(_TRACES.room_bytes / _TRACES.sample_bytes / max(count, 1))
    lines = _TRACES.lines if count <= _TRACES.many else _TRACES.few_lines
    joints = list(identification.robot.joint_names)
    return {
        "joints": joints,
        "units": {side: torque_units(identification.robot, side) for side in SIDES},
        "sources": {
            side: [_source(identification, joint, side) for joint in joints] for side in SIDES
        },
        "runs": [_packed_run(run, max(room, _TRACES.fewest_samples), lines) for run in runs],
    }


def torque_units(robot: Robot, side: str) -> list[str]:
    """Return the unit of the torque of each joint: a load that slides has a force."""
    return ["N" if slides and side == "load" else "N m" for slides in robot.is_prismatic]


def _drawn_runs(runs: Sequence[Run]) -> list[Run]:
    """Return the runs whose traces fit in the page, in their order."""
    kept: list[Run] = []
    # False sorts before True: unseen runs come first.
    for run in sorted(runs, key=lambda run: not run.is_unseen):
        if not kept or sum(map(_count, [*kept, run])) <= _TRACES.most:
            kept.append(run)
    return [run for run in runs if run in kept]


def _count(run: Run) -> int:
    return len(_joints_with_traces(run.result.actuator)) + len(_joints_with_traces(run.result.load))


def _joints_with_traces(fit: Fit) -> list[int]:
    """Return the joints for which a side has traces."""
    return [int(i) for i in np.flatnonzero(np.any(np.isfinite(fit.measured), axis=0))]


def _source(identification: Identification, joint: str, side: str) -> str:
    """Return the source of the measured torque of a joint on a side."""
    known = identification.known
    source = _logged(identification, joint)
    if side == "actuator" or known.drives[joint] == IDEAL_DRIVE:
        return source
    if joint in identification.springs:
        return "the torque of the identified spring at its measured deflection, (4b)"
    if joint in known.elastic_joints:
        return "the torque of the sensor at the joint"
    return f"{source}, at the joint, minus that of a known rotor"


def _logged(identification: Identification, joint: str) -> str:
    """Return what a log has of the torque of a motor."""
    kind, index = identification.known.drives[joint].motor_input, identification.known.index(joint)
    if kind in COMMANDS:
        return "the torque that the controller gives for the logged command"
    if kind != "torque":
        return f"the motor's {kind} times the identified constant"
    if all(bool(np.isfinite(motion.motor_torque[0, index])) for motion in identification.motions):
        return "the logged motor torque"
    return "the torque of the sensor at the joint"


def axis_time(time: Array) -> Array:
    """Return instants (T,) [s] for an axis: from the first one if their stamps are long.

    Unix times differ in their last digits only, and have no room next to each other.
    """
    return time - time[0] if abs(time[0]) >= _TRACES.long_stamp_s else time


def _packed_run(run: Run, room: int, lines: int) -> dict[str, Any]:
    result = run.result
    rate_hz = (len(result.time) - 1) / (result.time[-1] - result.time[0])
    inside = _inside(result)
    step = max(1, int(rate_hz / (_TRACES.per_period * result.cutoff_hz)))
    count = len(range(*inside.indices(len(result.time))))
    # Two samples of each bin are kept: its width is ceil(2 count / room) samples, 0 without bins.
    width = 0 if -(-count // step) <= room else -(-2 * count // room)
    bands = _bands(count, rate_hz, result.cutoff_hz, lines)
    return {
        "name": run.name,
        "unseen": run.is_unseen,
        "cutoff": result.cutoff_hz,
        "start": float(axis_time(result.time)[inside][0]),
        # Smallest and largest sample of a bin are drawn half a bin apart.
        "step": (width / 2 if width else step) / rate_hz,
        "thinned": _thinned_text(step, width, rate_hz, result.cutoff_hz),
        "frequencies": [float(f"{hz:.4g}") for hz in bands.frequency],
        **{
            side: _packed_side(getattr(result, side), inside, (step, width), bands)
            for side in SIDES
        },
        **_packed_motion(result.motions, result.time[inside][::step], bool(width)),
    }


def _packed_motion(motions: Sequence[Motion], time: Array, is_thinned: bool) -> dict[str, Any]:
    """Return what the residual is drawn over at the samples of the traces, null without room.

    These are joint positions and velocities, and the temperatures of motors that were logged.
    """
    content: dict[str, Any] = dict.fromkeys(("position", "velocity", "temperature"))
    if is_thinned or not motions:
        return content
    states = {"position": "joint_position", "velocity": "joint_velocity"}
    if all(motion.motor_temperature is not None for motion in motions):
        states["temperature"] = "motor_temperature"
    instants = np.concatenate([motion.time for motion in motions])
    for state, field in states.items():
        whole = np.concatenate([getattr(motion, field) for motion in motions])
        content[state] = [
            packed(np.interp(time, instants, column)) if np.all(np.isfinite(column)) else None
            for column in whole.T
        ]
    return content


def _inside(result: Validation) -> slice:
    """Return the samples with a trace of any joint, without the filter transients at the ends."""
    both = np.hstack([result.actuator.measured, result.load.measured])
    samples = np.flatnonzero(np.any(np.isfinite(both), axis=1))
    return slice(int(samples[0]), int(samples[-1]) + 1) if len(samples) else slice(0, len(both))


def _thinned_text(step: int, width: int, rate_hz: float, cutoff_hz: float) -> str:
    if width:
        interval = f"{width} samples ({1e3 * width / rate_hz:.3g} ms)"
        return f"Thinned to the smallest and largest of every {interval}: peaks are preserved."
    kept = f"every {step}th sample" if step > 1 else "every sample"
    return f"Drawn is {kept} of {rate_hz:.4g} Hz, low-pass filtered at {cutoff_hz:.3g} Hz."


def _packed_side(
    fit: Fit, inside: slice, thinning: tuple[int, int], bands: Bands
) -> list[dict[str, Any] | None]:
    joints = set(_joints_with_traces(fit))
    return [
        _packed_trace(fit.measured[inside, j], fit.computed[inside, j], thinning, bands)
        if j in joints
        else None
        for j in range(fit.measured.shape[1])
    ]


def _packed_trace(
    measured: Array, computed: Array, thinning: tuple[int, int], bands: Bands
) -> dict[str, Any]:
    step, width = thinning
    traces = {"measured": measured, "computed": computed, "residual": measured - computed}
    thin = {
        name: envelope(trace, width) if width else trace[::step] for name, trace in traces.items()
    }
    return {
        **{name: packed(trace) for name, trace in thin.items()},
        "spectra": {name: packed(np.log10(bands.amplitude(x))) for name, x in traces.items()},
    }


def envelope(trace: Array, width: int) -> Array:
    """Return smallest and largest sample of each bin in order of time, NaN if one lacks."""
    count = -(-len(trace) // width)
    padded = np.pad(trace, (0, count * width - len(trace)), mode="edge").reshape(count, width)
    known = np.where(np.isfinite(padded), padded, 0.0)
    places = np.sort([np.argmin(known, axis=1), np.argmax(known, axis=1)], axis=0)
    extremes = np.take_along_axis(padded, places.T, axis=1)
    # Also where one sample only is missing: an extreme among the others could be a false one.
    extremes[~np.all(np.isfinite(padded), axis=1)] = np.nan
    return np.asarray(extremes.ravel())


def packed(trace: Array) -> dict[str, Any]:
    """Return {data, scale, offset}: little-endian int16 as base64, value = offset + scale * int.

    The smallest integer is a missing sample.
    """
    known = trace[np.isfinite(trace)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    # From -32767 to 32767; a constant trace has no range, and any scale does.
    scale, offset = (high - low) / 65534 or 1.0, (high + low) / 2
    steps = np.full(len(trace), _TRACES.missing)
    steps[np.isfinite(trace)] = np.round((known - offset) / scale)
    data = base64.b64encode(steps.astype("<i2").tobytes()).decode("ascii")
    return {"data": data, "scale": float(f"{scale:.9g}"), "offset": float(f"{offset:.9g}")}


@dataclass(frozen=True, eq=False)
class Bands:
    """Bands of a spectrum, equally wide on a logarithmic axis; `start` is the first line of each.

    The amplitude of a band is that of its largest line.
    """

    frequency: Array
    start: IndexArray
    end: int

    def amplitude(self, trace: Array) -> Array:
        """Return the largest amplitude per band, of a trace without its mean (Hann window)."""
        centred = np.nan_to_num(trace - np.nanmean(trace))
        window = np.hanning(len(centred))
        # A sine of amplitude a has |DFT| = a sum(window)/2 at its line.
        lines = 2 * np.abs(np.fft.rfft(window * centred)) / max(float(window.sum()), 1e-300)
        amplitude = np.maximum.reduceat(lines[: self.end], self.start)
        # The page has logarithms of amplitudes, and a constant residual has none.
        return np.maximum(amplitude, max(_TRACES.deepest * float(np.max(amplitude)), 1e-300))


def _bands(count: int, rate_hz: float, cutoff_hz: float, lines: int) -> Bands:
    """Return the bands of traces of `count` samples, up to well above the cutoff."""
    frequency = np.fft.rfftfreq(count, 1 / rate_hz)
    end = int(np.searchsorted(frequency, _TRACES.highest * cutoff_hz, side="right"))
    end = max(min(end, len(frequency)), 2)
    # From line 1 on: line 0 is the mean, which is subtracted.
    edges = np.unique(np.round(np.geomspace(1, end, lines + 1)).astype(np.intp))
    start, stop = (edges[:-1], edges[1:]) if len(edges) > 1 else (edges, edges + 1)
    return Bands(np.sqrt(frequency[start] * frequency[stop - 1]), start, end)
