"""The sensitivity to the cutoff, as a table and as a figure."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seaid._files import write_whole
from seaid.errors import SeaidError
from seaid.report.text import Text, cut, joined, number, table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seaid.identification import CutoffSensitivity, FrequencyResponse


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG. Raises SeaidError for another suffix and if it cannot be written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    if Path(path).suffix.lower() != ".png":
        raise SeaidError(f"a figure is a PNG image: '{path}' must end in .png")
    FigureCanvasAgg(figure)
    content = BytesIO()
    figure.savefig(content, format="png", dpi=130)
    write_whole(path, content.getvalue())


_COLUMNS, _LONGEST = 4, 40
_LEVEL = 1.96


def sensitivity_table(result: CutoffSensitivity) -> Text:
    """Return each estimate by cutoff (selected one in brackets), and its largest change."""
    marked = [
        f"[{cutoff:.3g} Hz]" if place == result.proposed else f"{cutoff:.3g} Hz"
        for place, cutoff in enumerate(result.cutoffs_hz)
    ]
    rows = [
        [
            cut(name, _LONGEST),
            *(number(value) for value in result.values[:, place]),
            f"{result.standard_errors[result.proposed, place]:.2g}",
            f"{result.moves[place]:.1f} s.e.",
            result.units[place],
        ]
        for place, name in enumerate(result.names)
    ]
    header = ["parameter", *marked, "std. error", "change", "unit"]
    title = "Estimates over the cutoff; change: largest between half and twice the selected one"
    refused = (f"! {cutoff:.3g} Hz: {why}" for cutoff, why in result.refused.items())
    return joined([table(title, header, rows), *refused])


def save_sensitivity_figure(result: CutoffSensitivity, path: str | Path) -> None:
    """Draw each estimate with its 95 % interval over the cutoff, the selected one marked."""
    from matplotlib.figure import Figure

    rows = -(-len(result.names) // _COLUMNS)
    figure = Figure(figsize=(3.0 * _COLUMNS, 0.8 + 1.7 * rows), layout="constrained")
    figure.suptitle("Estimates and 95 % intervals over the cutoff; red: the selected one")
    axes = figure.subplots(rows, _COLUMNS, sharex=True, squeeze=False).ravel()
    # Refused cutoffs have a row of NaN.
    kept = np.flatnonzero(~np.isnan(result.values[:, 0]))
    proposed = result.cutoffs_hz[result.proposed]
    for place, name in enumerate(result.names):
        axis, value = axes[place], result.values[result.proposed, place]
        half = _LEVEL * result.standard_errors[:, place]
        axis.axhline(value, color="0.8", linewidth=0.8)
        axis.axvline(proposed, color="tab:red", linewidth=0.8, linestyle="--")
        for places, color in ((kept, "black"), ([result.proposed], "tab:red")):
            axis.errorbar(
                result.cutoffs_hz[places],
                result.values[places, place],
                half[places],
                fmt="o",
                markersize=3,
                linewidth=1.0,
                color=color,
            )
        axis.set_xscale("log")
        axis.set_xticks(result.cutoffs_hz[kept], [f"{c:.2g}" for c in result.cutoffs_hz[kept]])
        axis.minorticks_off()
        axis.tick_params(labelsize="x-small")
        axis.set_title(f"{cut(name, _LONGEST)} [{result.units[place]}]", fontsize="x-small")
    for axis in axes[len(result.names) :]:
        axis.set_axis_off()
    figure.supxlabel("cutoff [Hz]", fontsize="small")
    save_figure(figure, path)


def save_frequency_figure(found: FrequencyResponse, path: str | Path) -> None:
    """Draw the response of each motor angle to its own torque, with its model and its noise."""
    from matplotlib.figure import Figure

    count = len(found.joints)
    figure = Figure(figsize=(1.0 + 3.6 * count, 5.4), layout="constrained")
    figure.suptitle("Motor angle per motor torque, measured and computed", fontsize=11)
    axes = figure.subplots(2, count, sharex=True, squeeze=False)
    for place, joint in enumerate(found.joints):
        upper, lower = axes[:, place]
        _draw_response(upper, lower, found, place)
        if joint in found.drives:
            for name, color in (("resonance", "tab:red"), ("antiresonance", "tab:blue")):
                at = found.drives[joint].value(name)
                if found.frequency_hz[0] <= at <= found.frequency_hz[-1]:
                    upper.axvline(at, color=color, lw=0.8, linestyle="--", label=name)
        upper.set_title(joint, fontsize=9, loc="left")
        lower.set_xlabel("frequency [Hz]")
        for axis in (upper, lower):
            axis.grid(color="0.9")
    axes[0, 0].set_ylabel("rad/(N m)")
    axes[1, 0].set_ylabel("phase [°]")
    handles = {
        label: handle
        for axis in axes[0]
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    figure.legend([*handles.values()], [*handles], loc="outside lower center", ncols=4, fontsize=8)
    save_figure(figure, path)


def _draw_response(upper: Axes, lower: Axes, response: FrequencyResponse, place: int) -> None:
    """Draw the size and the phase of one response, with its noise and its models."""
    hz, measured = response.frequency_hz, response.response[:, place, place]
    dots = {"color": "0.45", "marker": "o", "markersize": 3, "linestyle": "none"}
    upper.loglog(hz, np.abs(measured), **dots, label="measured")
    lower.semilogx(hz, np.degrees(np.angle(measured)), **dots)
    for name, style, std in (
        ("deviation by noise", ":", response.noise_std),
        ("deviation in total", "-.", response.total_std),
    ):
        if np.any(np.isfinite(std)):
            upper.loglog(hz, std[:, place, place], style, color="0.6", lw=0.9, label=name)
    for name, color, style, model in (
        ("fit", "black", "-", response.model),
        ("identification", "C1", "--", response.identified),
    ):
        if model is not None:
            curve = model[:, place, place]
            upper.loglog(hz, np.abs(curve), style, color=color, lw=1.1, label=name)
            lower.semilogx(hz, np.degrees(np.angle(curve)), style, color=color, lw=1.1)
