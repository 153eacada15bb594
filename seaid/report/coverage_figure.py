"""Figure of the share of experiments in which 95 % intervals held the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from seaid.arrays import Array
from seaid.report.figures import save_figure

WANTED = (0.90, 0.98)
LEVEL = 0.95


def save_coverage_figure(
    names: Sequence[str],
    coverage: Mapping[str, Array],
    experiments: Mapping[str, int],
    path: str | Path,
) -> None:
    """Draw the coverage (P,) of each parameter, one panel a way of estimating.

    `names` (P,) are the parameters, `experiments` how many each way had: the grey band is where
    95 % of the dots lie if the intervals are right, the dashed lines are what is wanted. Raises
    SeaidError where the file cannot be written.
    """
    from matplotlib.figure import Figure

    ways, places = list(coverage), np.arange(len(names))
    height = 0.6 + 0.17 * len(names)
    figure = Figure(figsize=(2.2 + 1.5 * len(ways), height), layout="constrained")
    axes = figure.subplots(1, len(ways), sharey=True, squeeze=False)[0]
    for axis, way in zip(axes, ways, strict=True):
        half = 1.96 * np.sqrt(LEVEL * (1 - LEVEL) / experiments[way])
        axis.axvspan(LEVEL - half, min(LEVEL + half, 1.0), color="0.9", zorder=0)
        for edge in WANTED:
            axis.axvline(edge, color="tab:red", linestyle="--", linewidth=0.8)
        axis.plot(coverage[way], places, "o", color="black", markersize=3)
        axis.set_title(f"{way}, {experiments[way]}", fontsize="medium")
        axis.set_xlim(min(0.7, float(np.min(coverage[way])) - 0.02), 1.01)
        axis.grid(axis="y", color="0.94")
        axis.set_xlabel("share")
    axes[0].set_yticks(places, names, fontsize="x-small")
    axes[0].set_ylim(len(names) - 0.5, -0.5)
    figure.suptitle("Experiments in which the 95 % interval held the truth")
    save_figure(figure, path)
