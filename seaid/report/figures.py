"""Figures in the manner of the paper's Fig. 3 and Fig. 4: measured grey, computed black."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid.errors import SeaidError
from seaid.files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seaid.validation import Fit, Validation

_MEASURED: dict[str, Any] = {"color": "0.62", "linewidth": 2.4, "label": "measured"}
_COMPUTED: dict[str, Any] = {"color": "black", "linewidth": 0.9, "label": "computed"}


UNSEEN = "a motion the identification has not seen"


def save_actuator_figure(result: Validation, path: str | Path, motion: str = UNSEEN) -> None:
    """Draw the motor torques of the best and the worst elastic joint, as Fig. 3 of the paper.

    `motion` says in the title which motion it is. Raises SeaidError where the validation has no
    actuator side.
    """
    if not np.any(np.isfinite(result.actuator.relative_error)):
        raise SeaidError(
            f"'{path}': none of {', '.join(result.joints)} has an actuator side to draw; "
            "draw the load side"
        )
    save_figure(actuator_figure(result, motion), path)


def save_load_figure(result: Validation, path: str | Path, motion: str = UNSEEN) -> None:
    """Draw the load torque of every joint that has one, as Fig. 4 of the paper.

    `motion` says in the title which motion it is.
    """
    save_figure(load_figure(result, motion), path)


def actuator_figure(result: Validation, motion: str = UNSEEN) -> Figure:
    """Return Fig. 3 of the paper, of a validation that has an actuator side."""
    errors = result.actuator.relative_error
    elastic = [int(index) for index in np.flatnonzero(np.isfinite(errors))]
    best, worst = min(elastic, key=errors.item), max(elastic, key=errors.item)
    shown = {best: "best joint", worst: "worst joint"} if best != worst else {best: "only joint"}
    title = f"Actuator side: motor torque of {motion}"
    return _torques(result, result.actuator, list(shown.items()), title, 1e3, "mN m")


def load_figure(
    result: Validation, motion: str = UNSEEN, joints: Sequence[int] | None = None
) -> Figure:
    """Return Fig. 4 of the paper, of the joints that have a load side or a choice of them."""
    shown = np.flatnonzero(np.isfinite(result.load.relative_error)) if joints is None else joints
    title = f"Load side: torque on the load in {motion}"
    return _torques(result, result.load, [(int(i), "") for i in shown], title, 1.0, "N m")


def _torques(
    result: Validation,
    fit: Fit,
    shown: Sequence[tuple[int, str]],
    title: str,
    scale: float,
    unit: str,
) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 0.9 + 2.2 * len(shown)), layout="constrained")
    figure.suptitle(title, fontsize=11)
    for position, (index, note) in enumerate(shown):
        axes = figure.add_subplot(len(shown), 1, position + 1)
        axes.plot(result.time, scale * fit.measured[:, index], **_MEASURED)
        axes.plot(result.time, scale * fit.computed[:, index], **_COMPUTED)
        axes.set_title(
            f"({chr(97 + position)}) {result.joints[index]}{', ' + note if note else ''}: "
            f"relative error {fit.relative_error[index]:.1%} below {result.cutoff_hz:.3g} Hz "
            f"({fit.raw_relative_error[index]:.1%} raw), rms {scale * fit.rms_error[index]:.3g} "
            f"{unit}, R² {fit.r_squared[index]:.4f}",
            fontsize=9,
            loc="left",
        )
        axes.set_ylabel(f"torque [{unit}]")
        axes.margins(x=0)
        axes.grid(color="0.9")
    axes.set_xlabel("time [s]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower right", ncols=2, fontsize=8)
    return figure


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG, whole.

    Raises SeaidError for another ending and where it cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    if Path(path).suffix.lower() != ".png":
        raise SeaidError(f"a figure is a PNG image: '{path}' must end in .png")
    FigureCanvasAgg(figure)
    content = BytesIO()
    figure.savefig(content, format="png", dpi=130)
    write_whole(path, content.getvalue())
