"""Fig. 3 and Fig. 4 of the paper for a page, as SVG that takes the page's colours."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from io import StringIO
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid.report.figures import actuator_figure, load_figure
from seaid.report.html_traces import Run
from seaid.validation import Fit, Validation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = {"#000000": "ink", "#ffffff": "paper", "#9e9e9e": "measured-static", "#e6e6e6": "grid"}
_MOST_JOINTS, _MOST_SAMPLES = 8, 1500


@dataclass(frozen=True)
class Picture:
    """An SVG with what it shows in words."""

    svg: Any
    caption: str


def figures_of(run: Run) -> list[Picture]:
    """Return Fig. 3 and Fig. 4 of the paper for a run, as far as it has these sides."""
    result, pictures = _thinned(run.result), []
    motion = "a motion the identification has not seen" if run.is_unseen else f"the {run.name}"
    if np.any(np.isfinite(result.actuator.relative_error)):
        svg = _svg(partial(actuator_figure, result, motion), "actuator")
        pictures.append(Picture(svg, "Motor torques: the elastic joints predicted best and worst."))
    told = np.flatnonzero(np.isfinite(result.load.relative_error))
    if len(told):
        order = told[np.argsort(result.load.relative_error[told], kind="stable")]
        few = order[np.unique(np.linspace(0, len(order) - 1, _MOST_JOINTS).round().astype(int))]
        shown = told if len(told) <= _MOST_JOINTS else np.sort(few)
        more = f" {len(shown)} of {len(told)} joints, from best to worst." * (
            len(told) > len(shown)
        )
        svg = _svg(partial(load_figure, result, motion, shown.tolist()), "load")
        pictures.append(Picture(svg, f"Torques on the load, measured and computed.{more}"))
    return pictures


def _thinned(result: Validation) -> Validation:
    """Return the validation with fewer samples, enough for a picture of this size."""
    step = max(1, len(result.time) // _MOST_SAMPLES)

    def thin(fit: Fit) -> Fit:
        return replace(fit, measured=fit.measured[::step], computed=fit.computed[::step])

    return replace(
        result, time=result.time[::step], actuator=thin(result.actuator), load=thin(result.load)
    )


def _svg(draw: Callable[[], Figure], name: str) -> Any:
    """Return a figure as SVG for a page: text as text, colours by name, ids of its own."""
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
