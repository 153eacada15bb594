"""Figure of a planned motion within its limits, and of the singular values before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, frozen
from seaid.errors import SeaidError
from seaid.excitation import Trajectory
from seaid.excitation.limits import JointLimits

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure


_MOST_ROWS = 8
_SAMPLES = 1500
_KINDS = ("position", "velocity", "acceleration")
_UNITS = (("rad", "rad/s", "rad/s²"), ("m", "m/s", "m/s²"))
_LIMIT: dict[str, Any] = {"color": "tab:red", "linewidth": 0.9, "linestyle": "--"}
_BEFORE: dict[str, Any] = {"color": "0.62", "marker": "o", "markersize": 4, "linewidth": 1.2}
_AFTER: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 3, "linewidth": 0.9}


def save_excitation_figure(
    trajectory: Trajectory,
    limits: JointLimits,
    path: str | Path,
    singular_before: Array | None = None,
    singular_after: Array | None = None,
) -> None:
    """Draw position, velocity and acceleration of a planned motion with their limits.

    There is one row per joint, or for more than 8 joints one panel per quantity with each joint as
    a share of its limit. Below are the given singular values (p,) of the observation matrix, of the
    start of the search and of the plan, with their condition numbers (16). Raises SeaidError if
    limits or singular values do not fit, or the file cannot be written.
    """
    n = len(trajectory.joint_names)
    if len(limits.lower) != n:
        raise SeaidError(f"'{path}': {n} joints in the trajectory, limits of {len(limits.lower)}")
    given = ((singular_before, "before", _BEFORE), (singular_after, "after", _AFTER))
    spectra = [
        (_spectrum(f"singular_{when}", values), f"{when} optimisation", style)
        for values, when, style in given
        if values is not None
    ]
    _figure(trajectory, limits, spectra).savefig(path, dpi=130)


def _spectrum(name: str, values: Array) -> Array:
    """Return singular values in decreasing order."""
    spectrum = np.sort(frozen(name, values, (None,)))[::-1]
    if not (spectrum.size and np.all(np.isfinite(spectrum)) and spectrum[-1] >= 0):
        raise SeaidError(f"{name} must be finite numbers of zero or more, at least one")
    return spectrum


def _figure(
    trajectory: Trajectory, limits: JointLimits, spectra: list[tuple[Array, str, dict[str, Any]]]
) -> Figure:
    from matplotlib.figure import Figure

    n = len(trajectory.joint_names)
    rows = n if n <= _MOST_ROWS else len(_KINDS)
    heights = [1.6 * rows + 0.7] if n <= _MOST_ROWS else [2.2 * rows + 0.7]
    heights += [2.8] if spectra else []
    figure = Figure(figsize=(11.0, sum(heights)), layout="constrained")
    parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    time = np.linspace(0.0, trajectory.duration, _SAMPLES)
    parts[0].suptitle("Planned motion and its limits", fontsize=11)
    draw = _draw_rows if n <= _MOST_ROWS else _draw_shares
    draw(parts[0], trajectory, limits, time)
    if spectra:
        _draw_spectra(parts[1], spectra)
    return figure


def _draw_rows(part: SubFigure, trajectory: Trajectory, limits: JointLimits, time: Array) -> None:
    """Draw one row per joint, one column per quantity."""
    motion = trajectory.sample(time)
    names = trajectory.joint_names
    axes = part.subplots(len(names), len(_KINDS), sharex=True, squeeze=False)
    bounds = (
        (limits.lower, limits.upper),
        (-limits.velocity, limits.velocity),
        (-limits.acceleration, limits.acceleration),
    )
    for joint, name in enumerate(names):
        units = _UNITS[name in trajectory.prismatic_joints]
        for kind, unit in enumerate(units):
            panel = axes[joint, kind]
            panel.plot(time, motion[kind][:, joint], color="black", linewidth=1.0, label="planned")
            for side, label in zip(bounds[kind], ("limit", "_"), strict=True):
                panel.axhline(side[joint], label=label, **_LIMIT)
            panel.set_title(f"{name}: {_KINDS[kind]}", fontsize=9, loc="left")
            panel.set_ylabel(f"[{unit}]", fontsize=9)
            _dress(panel)
    for panel in axes[-1]:
        panel.set_xlabel("time [s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    part.legend(handles, labels, loc="outside lower right", ncols=2, fontsize=8)


def _draw_shares(part: SubFigure, trajectory: Trajectory, limits: JointLimits, time: Array) -> None:
    """Draw one panel per quantity, every joint as a share of its limit."""
    q, v, a = trajectory.sample(time)
    shares = (
        (q - limits.middle) / limits.half_range,
        v / limits.velocity,
        a / limits.acceleration,
    )
    axes = part.subplots(len(_KINDS), 1, sharex=True)
    colours = _colours(len(trajectory.joint_names))
    for panel, share, kind in zip(axes, shares, _KINDS, strict=True):
        for name, values, colour in zip(trajectory.joint_names, share.T, colours, strict=True):
            panel.plot(time, values, color=colour, linewidth=0.9, label=name)
        for side, label in ((1.0, "limit"), (-1.0, "_")):
            panel.axhline(side, label=label, **{**_LIMIT, "color": "black"})
        of = "half its range, from its middle" if kind == "position" else "its limit"
        panel.set_title(f"{kind} of each joint, as a share of {of}", fontsize=9, loc="left")
        panel.set_ylabel("share [1]", fontsize=9)
        _dress(panel)
    axes[-1].set_xlabel("time [s]")
    handles, labels = axes[0].get_legend_handles_labels()
    columns = 1 + (len(labels) - 1) // 30
    part.legend(handles, labels, loc="outside right upper", fontsize=8, ncols=columns)


def _draw_spectra(part: SubFigure, spectra: list[tuple[Array, str, dict[str, Any]]]) -> None:
    panel = part.subplots()
    for values, label, style in spectra:
        condition = values[0] / values[-1] if values[-1] > 0 else np.inf
        number = np.arange(1, len(values) + 1)
        shown = np.where(values > 0, values, np.nan)
        panel.plot(number, shown, label=f"{label}: condition number {condition:.4g}", **style)
    panel.set_yscale("log")
    panel.set_title("Singular values of the base observation matrix", fontsize=9, loc="left")
    panel.set_xlabel("number, from the largest")
    panel.set_ylabel("singular value")
    panel.grid(color="0.9")
    part.legend(loc="outside lower right", ncols=2, fontsize=8)


def _dress(panel: Any) -> None:
    panel.margins(x=0, y=0.08)
    panel.tick_params(labelsize=8)
    panel.grid(color="0.9")


def _colours(count: int) -> list[Any]:
    """Return distinct colours."""
    import matplotlib as mpl

    return [mpl.colormaps["turbo"](share) for share in np.linspace(0.03, 0.93, count)]
