"""Estimates over the pass band, as a table and as a figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seaid.report.figures import save_figure
from seaid.report.text import number, table

if TYPE_CHECKING:
    from seaid.sensitivity import CutoffSensitivity

_COLUMNS, _LONGEST = 4, 40
_LEVEL = 1.96


def sensitivity_table(result: CutoffSensitivity) -> str:
    """Return each estimate in each pass band, and how far it moves in standard errors.

    The proposed band is in brackets.
    """
    marked = [
        f"[{cutoff:.3g} Hz]" if place == result.proposed else f"{cutoff:.3g} Hz"
        for place, cutoff in enumerate(result.cutoffs_hz)
    ]
    rows = [
        [
            _short(name),
            *(number(value) for value in result.values[:, place]),
            f"{result.standard_errors[result.proposed, place]:.2g}",
            f"{result.moves[place]:.1f} s.e.",
            result.units[place],
        ]
        for place, name in enumerate(result.names)
    ]
    header = ["parameter", *marked, "std. error", "moves", "unit"]
    title = "Estimates over the pass band; moves: up to half and twice the proposed one"
    return "\n".join(
        [
            table(title, header, rows),
            *(f"! {cutoff:.3g} Hz: {why}" for cutoff, why in result.refused.items()),
        ]
    )


def save_sensitivity_figure(result: CutoffSensitivity, path: str | Path) -> None:
    """Draw each estimate with its 95 % interval over the cutoff, the proposed one marked.

    Raises SeaidError where the file cannot be written.
    """
    from matplotlib.figure import Figure

    rows = -(-len(result.names) // _COLUMNS)
    figure = Figure(figsize=(3.0 * _COLUMNS, 0.8 + 1.7 * rows), layout="constrained")
    figure.suptitle("Estimates and 95 % intervals over the pass band; red: the proposed one")
    axes = figure.subplots(rows, _COLUMNS, sharex=True, squeeze=False).ravel()
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
        axis.set_title(f"{_short(name)} [{result.units[place]}]", fontsize="x-small")
    for axis in axes[len(result.names) :]:
        axis.set_axis_off()
    figure.supxlabel("cutoff [Hz]", fontsize="small")
    save_figure(figure, path)


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 4] + " ..."
