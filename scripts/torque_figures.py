"""Figures of measured and computed torques, as Fig. 3 and Fig. 4 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from seaid.errors import SeaidError
from seaid.identification import Validation

_MEASURED: dict[str, Any] = {"color": "0.62", "linewidth": 2.4, "label": "measured"}
_COMPUTED: dict[str, Any] = {"color": "black", "linewidth": 0.9, "label": "computed"}
_RAW: dict[str, Any] = {"color": "0.86", "linewidth": 0.5, "label": "measured, every sample"}
_CHATTER: dict[str, Any] = {"color": "#3f7fc8", "linewidth": 0.5}


Raw = tuple[Validation, Validation]
"""The comparison of the same motion at higher cutoffs: whose measured, whose computed torque."""

_UNSEEN = "a motion that was not used for identification"


def save_actuator_figure(
    result: Validation, path: str | Path, motion: str = _UNSEEN, raw: Raw | None = None
) -> None:
    """Draw the motor torques of the best and the worst elastic joint, as Fig. 3 of the paper.

    The title names the `motion`. The `raw` torques are drawn behind those below the cutoff, as the
    paper shows them. Raises SeaidError if the validation has no actuator side.
    """
    errors = result.actuator.relative_error
    elastic = [int(index) for index in np.flatnonzero(np.isfinite(errors))]
    if not elastic:
        raise SeaidError(
            f"'{path}': none of {', '.join(result.joints)} has an actuator side to draw; "
            "draw the load side"
        )
    best, worst = min(elastic, key=errors.item), max(elastic, key=errors.item)
    shown = {best: "best joint", worst: "worst joint"} if best != worst else {best: "only joint"}
    title = f"Actuator side: motor torque of {motion}"
    figure = _torques(result, "actuator", list(shown.items()), title, 1e3, "mN m", raw)
    _save(figure, path)


def save_load_figure(
    result: Validation, path: str | Path, motion: str = _UNSEEN, raw: Raw | None = None
) -> None:
    """Draw the load torques, as Fig. 4 of the paper; `motion` and `raw` as of the actuator side."""
    shown = [(int(index), "") for index in np.flatnonzero(np.isfinite(result.load.relative_error))]
    title = f"Load side: torque on the load in {motion}"
    _save(_torques(result, "load", shown, title, 1.0, "N m", raw), path)


def _save(figure: Figure, path: str | Path) -> None:
    """Write a figure as a PNG file, whose description has its titles for tests to read."""
    titles = [axes.get_title("left") for axes in figure.axes]
    figure.savefig(path, dpi=130, metadata={"Description": "\n".join(titles)})


def _torques(
    result: Validation,
    side: Literal["actuator", "load"],
    shown: Sequence[tuple[int, str]],
    title: str,
    scale: float,
    unit: str,
    raw: Raw | None,
) -> Figure:
    figure = Figure(figsize=(9.0, 0.9 + 2.2 * len(shown)), layout="constrained")
    figure.suptitle(title, fontsize=11)
    fit = getattr(result, side)
    for position, (index, note) in enumerate(shown):
        axes = figure.add_subplot(len(shown), 1, position + 1)
        if raw is not None:
            measured, computed = (getattr(shown_raw, side) for shown_raw in raw)
            axes.plot(result.time, scale * measured.measured[:, index], **_RAW)
            label = f"computed below {raw[1].cutoff_hz:.3g} Hz"
            axes.plot(result.time, scale * computed.computed[:, index], label=label, **_CHATTER)
        axes.plot(result.time, scale * fit.measured[:, index], **_MEASURED)
        axes.plot(result.time, scale * fit.computed[:, index], **_COMPUTED)
        counted = fit.counted_share[index]
        part = f" in the {counted:.0%} of the samples in motion" if counted < 0.995 else ""
        axes.set_title(
            f"({chr(97 + position)}) {result.joints[index]}{', ' + note if note else ''}: "
            f"relative error {fit.relative_error[index]:.1%} below {result.cutoff_hz:.3g} Hz{part} "
            f"({fit.raw_relative_error[index]:.1%} raw), R² {fit.r_squared[index]:.4f}",
            fontsize=9,
            loc="left",
        )
        axes.set_ylabel(f"torque [{unit}]")
        axes.margins(x=0)
        axes.grid(color="0.9")
    axes.set_xlabel("time [s]")
    lines = {
        label: line
        for axes in figure.axes
        for line, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(lines.values(), lines, loc="outside lower right", ncols=4, fontsize=8)
    return figure
