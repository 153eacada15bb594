"""Charts of a page: singular values, correlations, and Fig. 3 and Fig. 4 of the paper as SVG."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from io import StringIO
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array
from seaid.drives import JointParameter, readable
from seaid.estimation import (
    POORLY_DETERMINED,
    directions,
    first_term,
    qr_factor_of,
    settled_weights,
)
from seaid.regressor import load_regression, stacked, under_load, with_gear_torque
from seaid.report.figures import UNSEEN, actuator_figure, load_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seaid.identification import Fit, Identification, Validation
    from seaid.log import Motion
    from seaid.report.html_traces import Run


@dataclass(frozen=True, eq=False)
class SingularValues:
    """Singular values of the load side relative to the largest, in decreasing order.

    `combinations` describes the parameter combinations of the smallest ones; a combination is
    poorly determined below the `threshold`.
    """

    shares: Array
    combinations: tuple[str, ...]
    threshold: float = POORLY_DETERMINED


def singular_values(found: Identification) -> SingularValues | None:
    """Return the singular values of the load side over all motions, None for long logs.

    Columns have unit norm, rows are weighted by their joint's residual, as in weighted least
    squares: the ratio of largest and smallest is the condition number.
    """
    if not found.motions or not found.model.names:
        return None
    motions = [_with_gear_torque(found, motion) for motion in found.motions]
    qr_factor = qr_factor_of(
        stacked([load_regression(found.known, m, found.model, found.springs) for m in motions])
    )
    found_directions = directions(
        qr_factor.weighted_factor(settled_weights(qr_factor)), qr_factor.names
    )
    count = len(found_directions.shares)
    smallest = range(count - 1, max(count - 4, -1), -1)
    return SingularValues(
        found_directions.shares, tuple(found_directions.text(place) for place in smallest)
    )


def _with_gear_torque(found: Identification, motion: Motion) -> Motion:
    if not under_load(found.known, found.model.torque_joints):
        return motion
    theta = found.load_side.values
    return with_gear_torque(found.known, motion, found.model, found.springs, theta)


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


def correlation_map(found: Identification) -> CorrelationMap:
    """Return the correlations of all estimates, or of the most correlated 110 parameters."""
    names, blocks, parts = _estimates(found)
    total = len(names)
    values = np.full((total, total), np.nan)
    for block, part in enumerate(parts):
        own = [place for place, one in enumerate(blocks) if one == block]
        values[np.ix_(own, own)] = part
    others = np.abs(np.nan_to_num(values - np.eye(total)))
    kept = np.arange(total)
    if total > _MOST_PARAMETERS:
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
        blocks=tuple(blocks[place] for place in kept),
        values=values[np.ix_(kept, kept)],
        total=total,
        strongest=tuple(strongest),
    )


def _estimates(found: Identification) -> tuple[list[str], list[int], list[Array]]:
    """Return short names, the block of each, and the correlations per block: drives, then load."""
    names: list[str] = []
    blocks: list[int] = []
    parts: list[Array] = []

    def add(part: Array, own: Sequence[str]) -> None:
        names.extend(own)
        blocks.extend([len(parts)] * len(own))
        parts.append(part)

    load = found.load_side
    for joint in found.known.elastic_joints:
        drive = found.drives[joint]
        own = [i for i, name in enumerate(drive.names) if f"{name} of {joint}" not in load.names]
        if own:
            named = [readable(JointParameter(drive.names[i], joint)) for i in own]
            add(drive.correlation[np.ix_(own, own)], named)
    if load.names:
        bodies = [first_term(name) for name in found.model.expressions]
        add(load.correlation, [*bodies, *map(readable, load.names[len(bodies) :])])
    return names, blocks, parts


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


def packed_correlations(shown: CorrelationMap) -> str:
    """Return the whole map in hundredths as base64 of signed bytes, -128 for NaN."""
    steps = np.where(np.isnan(shown.values), -128, np.round(100 * np.nan_to_num(shown.values)))
    return base64.b64encode(steps.astype(np.int8).tobytes()).decode("ascii")


@dataclass(frozen=True)
class DotChart:
    """Points of a chart with a logarithmic axis, in a box of `width` times `height`.

    `dots` are (x, y, text), `decades` (y, exponent) of the grid lines, `threshold` is a y.
    """

    width: float
    height: float
    dots: tuple[tuple[float, float, str], ...]
    decades: tuple[tuple[float, int], ...]
    threshold: float


def dot_chart(found: SingularValues, width: float = 640.0, height: float = 200.0) -> DotChart:
    """Return singular values over their index as points of a chart."""
    shares = np.maximum(found.shares, 1e-16)
    lowest = math.floor(math.log10(min(float(shares.min()), POORLY_DETERMINED)))

    def y_of(share: float) -> float:
        return round(height * math.log10(share) / lowest, 2)

    step = width / len(shares)
    dots = (
        (round((k + 0.5) * step, 2), y_of(float(share)), f"{k + 1}: {share:.2g}")
        for k, share in enumerate(shares)
    )
    return DotChart(
        width=width,
        height=height,
        dots=tuple(dots),
        decades=tuple((y_of(10.0**power), power) for power in range(0, lowest - 1, -1)),
        threshold=y_of(found.threshold),
    )


_COLOURS = {"#000000": "ink", "#ffffff": "paper", "#9e9e9e": "measured-static", "#e6e6e6": "grid"}
_MOST_JOINTS, _MOST_SAMPLES = 8, 1500


@dataclass(frozen=True)
class Picture:
    """An SVG with its caption."""

    svg: Any
    caption: str


def figures_of(run: Run) -> list[Picture]:
    """Return Fig. 3 and Fig. 4 of the paper for a run, for the sides that it has."""
    result, pictures = _thinned(run.result), []
    motion = UNSEEN if run.is_unseen else f"the {run.name}"
    if np.any(np.isfinite(result.actuator.relative_error)):
        svg = _svg(partial(actuator_figure, result, motion), "actuator")
        pictures.append(Picture(svg, "Motor torques: the elastic joints predicted best and worst."))
    joints = np.flatnonzero(np.isfinite(result.load.relative_error))
    if len(joints):
        order = joints[np.argsort(result.load.relative_error[joints], kind="stable")]
        few = order[np.unique(np.linspace(0, len(order) - 1, _MOST_JOINTS).round().astype(int))]
        shown = joints if len(joints) <= _MOST_JOINTS else np.sort(few)
        more = f" {len(shown)} of {len(joints)} joints, from best to worst." * (
            len(joints) > len(shown)
        )
        svg = _svg(partial(load_figure, result, motion, shown.tolist()), "load")
        pictures.append(Picture(svg, f"Torques on the load, measured and computed.{more}"))
    return pictures


def _thinned(result: Validation) -> Validation:
    """Return the validation with fewer samples, enough for the size of the figure."""
    step = max(1, len(result.time) // _MOST_SAMPLES)

    def thin(fit: Fit) -> Fit:
        return replace(fit, measured=fit.measured[::step], computed=fit.computed[::step])

    return replace(
        result, time=result.time[::step], actuator=thin(result.actuator), load=thin(result.load)
    )


def _svg(draw: Callable[[], Figure], name: str) -> Any:
    """Return a figure as SVG for a page: with text elements, named colours and unique ids."""
    import matplotlib
    from markupsafe import Markup
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    text = StringIO()
    settings: dict[Any, Any] = {
        "svg.fonttype": "none",
        "svg.hashsalt": name,
        "path.simplify_threshold": 0.2,
        "text.parse_math": False,
    }
    with matplotlib.rc_context(settings):
        figure = draw()
        FigureCanvasSVG(figure)
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), svg)
    svg = re.sub(r'(<[^<>]*?(?: id="|href="#|url\(#))', rf"\g<1>{name}-", svg)
    for colour, variable in _COLOURS.items():
        svg = svg.replace(colour, f"var(--{variable})")
    return Markup(svg.replace("<svg ", '<svg role="img" ', 1))
