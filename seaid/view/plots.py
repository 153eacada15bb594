"""Plots: torque and spring deflection of one joint over time, with a cursor at the time shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array
from seaid.view.picture import hexadecimal
from seaid.view.stage import IDENTIFIED, NOMINAL
from seaid.view.traces import SOURCES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seaid.robot import Robot
    from seaid.view.playback import Playback

_STYLES: dict[str, dict[str, Any]] = {
    "measured": {"stroke": "#b4bcc6", "width": 4.0},
    "nominal": {"stroke": hexadecimal(NOMINAL), "width": 1.5, "dash": (6.0, 4.0)},
    "identified": {"stroke": hexadecimal(IDENTIFIED), "width": 1.8},
}
"""Lines of the sources: what is measured stays visible under what is computed."""

_CURSOR = {"label": "now", "stroke": "#d1242f", "width": 1.5}

_CURSOR_STEPS = 300
"""Places of the cursor, about one per pixel: it is sent when it comes to another one."""

_WIDTH_PX, _HEIGHT_PX = 370, 215


@dataclass(frozen=True, eq=False)
class Plots:
    """Handles of viser: `joint` is the choice of the joint, the others are plots."""

    joint: Any
    torque: Any
    deflection: Any


def put_plots(server: Any, robot: Robot, playbacks: Sequence[Playback]) -> Plots:
    """Add the plots in a panel of their own: at the left, on a small page a section to open."""
    gui, panel = server.gui, server.gui.add_panel()
    with panel.add_tab("Plots", icon="chart-line"):
        first = _first_joint(robot, playbacks[0])
        joint = gui.add_dropdown("joint", robot.joint_names, initial_value=first)
        gui.add_html(_key(playbacks))
        torque, deflection = (
            gui.add_uplot(
                (np.zeros(2),) * (2 + len(SOURCES)),
                ({"label": "time [s]"}, _CURSOR, *({"label": s, **_STYLES[s]} for s in SOURCES)),
                height=_HEIGHT_PX,
                legend={"show": False},
                axes=({"size": 30.0}, {"size": 52.0}),
                padding=(6, 12, 0, 0),
            )
            for _ in range(2)
        )
    panel.dock_left()
    panel.set_width(_WIDTH_PX)
    return Plots(joint, torque, deflection)


def draw_plots(plots: Plots, robot: Robot, playback: Playback, time: float) -> None:
    """Show the selected joint of a motion, with the cursor at a time [s]."""
    index, traces = robot.index(plots.joint.value), playback.traces
    joint, slides = plots.joint.value, robot.is_prismatic[index]
    at_motor = traces.at_motor[index]
    torque, unit = ("motor torque", "N m") if at_motor else ("torque at the joint", "N m")
    if slides and not at_motor:
        torque, unit = "force at the joint", "N"
    sources = {name: one[:, index] for name, one in traces.torque.items()}
    _draw(plots.torque, f"{torque} of {joint} [{unit}]", traces.time, sources, time)
    scaled = {name: 1e3 * one[:, index] for name, one in traces.deflection.items()}
    elastic = joint in robot.elastic_joints
    title = f"spring deflection of {joint} [{'mm' if slides else 'mrad'}]"
    _draw(plots.deflection, title, traces.time, scaled if elastic else {}, time)


def _draw(plot: Any, title: str, grid: Array, sources: Mapping[str, Array], time: float) -> None:
    """Show the sources {name: (G,)} of a plot, which is hidden without any value."""
    values = np.concatenate([one[np.isfinite(one)] for one in sources.values()] or [np.zeros(0)])
    plot.visible = bool(len(values))
    if not len(values):
        return
    low, high = float(np.min(values)), float(np.max(values))
    room = 0.06 * (high - low) or max(0.1 * abs(high), 1e-9)
    low, high = low - room, high + room
    scales = {
        "x": {"time": False, "range": (0.0, float(grid[-1]))},
        "y": {"range": (low, high)},
    }
    if plot.title != title:
        plot.title = title
    if plot.scales != scales:
        plot.scales = scales
    step = float(grid[-1]) / _CURSOR_STEPS
    plot.data = _with_cursor(grid, sources, step * round(time / step), (low, high))


def _with_cursor(
    grid: Array, sources: Mapping[str, Array], now: float, ends: tuple[float, float]
) -> tuple[Array, ...]:
    """Return the data of a plot: time, cursor, and all sources, NaN where one has no value.

    The cursor runs below the plot, where nobody sees it, and across it at the time `now`.
    """
    place = int(np.searchsorted(grid, now))
    time = np.insert(grid, place, [now] * 3)
    cursor = np.full(len(time), ends[0] - (ends[1] - ends[0]))
    cursor[place + 1] = ends[1]
    nothing = np.full(len(grid), np.nan)
    lines = (np.interp(time, grid, sources.get(name, nothing)) for name in SOURCES)
    return (time, cursor, *lines)


def _first_joint(robot: Robot, playback: Playback) -> str:
    """Return the joint whose spring moves most, the first one without springs."""
    known = np.where(np.isfinite(playback.deflection), np.abs(playback.deflection), 0.0)
    return robot.joint_names[int(np.argmax(np.max(known, axis=0)))]


def _key(playbacks: Sequence[Playback]) -> str:
    """Return the names of the lines that some motion has."""
    there = [name for name in SOURCES if any(name in one.traces.torque for one in playbacks)]
    lines = "".join(f"<span>{_line(**_STYLES[name])}{name}</span>" for name in there)
    return f'<div style="font-size:0.8em;margin:0 0 0.2em">{lines}</div>'


def _line(stroke: str, width: float, dash: tuple[float, ...] = ()) -> str:
    kind = "dashed" if dash else "solid"
    return (
        f'<span style="display:inline-block;width:1.8em;margin:0 0.35em 0 0.9em;'
        f'border-top:{width:g}px {kind} {stroke};vertical-align:0.25em"></span>'
    )
