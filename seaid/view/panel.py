"""Panels: the inputs of a view, colour scale and table of joints; plots over time of one joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array
from seaid.view.picture import IDENTIFIED, NEUTRAL, NOMINAL, WRONG, color_of, rest_posture

if TYPE_CHECKING:
    from seaid.robot import Robot
    from seaid.view.picture import Color, Ellipsoid, Picture
    from seaid.view.playback import Playback
    from seaid.view.stage import Stage


_STOPS = ("#144eba", "#68ace8", "#fff3ba", "#f59042", "#ba2212")
"""Blue, light blue, pale yellow, orange, red; at -1, -1/2, 0, 1/2 and 1."""


def deflection_colors(deflection: Array, limit: Array) -> list[Color]:
    """Return colours of deflections (n,) on scales from -limit to limit, neutral for NaN."""
    known = np.isfinite(deflection) & (limit > 0)
    part = np.where(known, deflection, 0.0) / np.where(known, limit, 1.0)
    at = np.linspace(-1.0, 1.0, len(_STOPS))
    channels = [np.interp(part, at, stops) for stops in zip(*map(color_of, _STOPS), strict=True)]
    painted = np.round(np.column_stack(channels)).astype(int)
    return [
        (int(red), int(green), int(blue)) if is_known else NEUTRAL
        for (red, green, blue), is_known in zip(painted, known, strict=True)
    ]


def hexadecimal(color: Color) -> str:
    """Return a colour in CSS notation, '#1450b4'."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def gradient() -> str:
    """Return the scale as a CSS background, from -limit (left) to limit (right)."""
    return f"linear-gradient(to right, {', '.join(_STOPS)})"


_TEXT = "font-size:0.8em;line-height:1.45;margin:0 0.6em 0.5em"


def legend(robot: Robot, limits: Array) -> str:
    """Return the colour scale of deflections up to `limits` (n,) [rad or m]."""
    bars = [
        _bar(limit, unit)
        for limit, unit in zip(_ends(robot, limits), ("mrad", "mm"), strict=True)
        if limit > 0
    ]
    if not bars:
        reason = "no deflection is known" if robot.elastic_joints else "no joint has a spring"
        return f'<div style="{_TEXT}">Joints are grey: {reason}.</div>'
    return (
        f'<div style="{_TEXT}"><b>Spring deflection about its mean</b>{"".join(bars)}'
        "motor side (through the gear) minus joint side. "
        f'<span style="white-space:nowrap">{_chip(NEUTRAL)} no spring</span></div>'
    )


def table(robot: Robot, position: Array, deflection: Array, colors: Sequence[Color]) -> str:
    """Return the table of joints: position [rad or m] and spring deflection [mrad or mm]."""
    springs = bool(robot.elastic_joints)
    rows = []
    for index, (joint, slides) in enumerate(
        zip(robot.joint_names, robot.is_prismatic, strict=True)
    ):
        rows.append([f"{_chip(colors[index])} {escape(joint)}"])
        rows[-1].append(_number(position[index], ".3f", "m" if slides else "rad"))
        if springs:
            rows[-1].append(_number(1e3 * deflection[index], ".2f", "mm" if slides else "mrad"))
    heads = ["joint", "position", "deflection"] if springs else ["joint", "position"]
    return f'<div style="{_TEXT}">{_table(heads, rows)}</div>'


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of HTML cells, the first column aligned left and the others right."""

    def row(tag: str, cells: Sequence[str]) -> str:
        sides = ("left", *("right" for _ in cells[1:]))
        both = zip(sides, cells, strict=True)
        return "".join(f'<{tag} style="text-align:{side}">{cell}</{tag}>' for side, cell in both)

    body = "".join(f"<tr>{row('td', cells)}</tr>" for cells in rows)
    style = "width:100%;font-variant-numeric:tabular-nums"
    return f'<table style="{style}"><tr>{row("th", heads)}</tr>{body}</table>'


def plain_text(lines: Sequence[str]) -> str:
    """Return lines of plain text."""
    return f'<div style="{_TEXT}">{"<br>".join(escape(line) for line in lines)}</div>'


def _ends(robot: Robot, limits: Array) -> tuple[float, float]:
    """Return the end of the scale of revolute joints [mrad] and of prismatic ones [mm]."""
    sliding = np.array(robot.is_prismatic)
    turning, slid = (1e3 * np.max(limits[kind], initial=0.0) for kind in (~sliding, sliding))
    return float(turning), float(slid)


def _bar(limit: float, unit: str) -> str:
    ends = "".join(
        f"<span>{text}</span>" for text in (f"−{limit:.3g}", "0", f"+{limit:.3g} {unit}")
    )
    return (
        f'<div style="background:{gradient()};height:0.9em;border-radius:3px;margin-top:0.4em">'
        f'</div><div style="display:flex;justify-content:space-between">{ends}</div>'
    )


def _chip(color: Color) -> str:
    return (
        f'<span style="display:inline-block;width:0.8em;height:0.8em;border-radius:2px;'
        f'border:1px solid #888;vertical-align:-0.05em;background:{hexadecimal(color)}"></span>'
    )


def _number(value: float, form: str, unit: str) -> str:
    return f"{value:+{form}} {unit}".replace("-", "−") if np.isfinite(value) else ""


def bodies_table(picture: Picture) -> str:
    """Return the colours of ellipsoids, each body's mass [kg] and the shift of its centre [mm]."""
    chips = [
        f"{_chip(color)} {name}"
        for name, color in (("nominal (wire)", NOMINAL), ("identified (solid)", IDENTIFIED))
        if getattr(picture, name.split()[0])
    ]
    nominal = {ellipsoid.name: ellipsoid for ellipsoid in picture.nominal}
    identified = {ellipsoid.name: ellipsoid for ellipsoid in picture.identified}
    rows = []
    for name in picture.robot.body_names:
        before, after = nominal.get(name), identified.get(name)
        cells = [_mass(before), _mass(after)] if identified else [_mass(before)]
        if identified:
            cells.append(_shift(before, after))
        rows.append([escape(name), *cells])
    heads = ["body", "nominal kg", "identified kg", "moved mm"] if identified else ["body", "kg"]
    return (
        f'<div style="{_TEXT}">Centre of mass, and the solid ellipsoid of uniform density with the '
        f"same mass and inertia: {', '.join(chips)}.{_table(heads, rows)}</div>"
    )


def _mass(body: Ellipsoid | None) -> str:
    """Return a mass, in red for a physically inconsistent body."""
    if body is None:
        return ""
    text = f"{body.mass:.3g}".replace("-", "−")
    if body.problem is None:
        return text
    color, reason = hexadecimal(WRONG), escape(body.problem)
    return f'<span style="color:{color}" title="{reason}">✕ {text}</span>'


def _shift(before: Ellipsoid | None, after: Ellipsoid | None) -> str:
    """Return the distance between two centres of mass."""
    if before is None or after is None or min(before.mass, after.mass) <= 0:
        return ""
    return f"{1e3 * float(np.linalg.norm(after.center - before.center)):.3g}"


NOTHING = "nothing"
SPEEDS = ("0.1x", "0.25x", "0.5x", "1x", "2x", "4x")

_FEW_JOINTS = 12
"""Robots with more joints show their names, and the sliders of their joints, when asked."""


@dataclass(frozen=True, eq=False)
class Panel:
    """Handles of viser's inputs and texts; those of time and `plots` are None without a motion.

    `joints` (n) are sliders of positions, present only without a motion.
    """

    table: Any
    notes: Any
    joints: tuple[Any, ...] = ()
    run: Any = None
    time: Any = None
    play: Any = None
    speed: Any = None
    compared: Any = None
    plots: Plots | None = None


def put_panel(
    server: Any, picture: Picture, stage: Stage, playbacks: Sequence[Playback], limits: Array
) -> Panel:
    """Add the panel to a viser server: motion and time, colours, table, visible parts, plots."""
    gui = server.gui
    gui.set_panel_label(picture.robot.name)
    gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
    inputs = _inputs_of_time(gui, playbacks) if playbacks else {}
    if playbacks:
        gui.add_html(legend(picture.robot, limits))
    table, notes = gui.add_html(""), gui.add_html("")
    if not playbacks:
        inputs["joints"] = _joint_sliders(gui, picture.robot)
    if picture.nominal or picture.identified:
        shown = bool(picture.identified)
        with gui.add_folder("Masses and inertia", expand_by_default=shown):
            for group in ("nominal", "identified"):
                _checkbox(gui, stage, group, group, shown)
            gui.add_html(bodies_table(picture))
    with gui.add_folder("Show", expand_by_default=False):
        _choices(gui, picture, stage)
    if playbacks:
        inputs["plots"] = _put_plots(server, picture.robot, playbacks)
    return Panel(table, notes, **inputs)


def _inputs_of_time(gui: Any, playbacks: Sequence[Playback]) -> dict[str, Any]:
    names = [playback.name for playback in playbacks]
    inputs = {
        "run": gui.add_dropdown("motion", names, initial_value=names[0]),
        "time": gui.add_slider("time [s]", 0.0, slider_end(playbacks[0]), 0.001, 0.0),
        "play": gui.add_button("Play", icon="player-play"),
        "speed": gui.add_dropdown("speed", SPEEDS, initial_value="1x"),
    }
    if len(names) > 1:
        inputs["compared"] = gui.add_dropdown(
            "compare with",
            [NOTHING, *names],
            initial_value=NOTHING,
            hint="Another motion, drawn in orange at the same time since its start.",
        )
    return inputs


def slider_end(playback: Playback) -> float:
    """Return the end of the time slider for a motion [s], to the millisecond."""
    return max(round(playback.duration, 3), 0.001)


def notes_of(picture: Picture, playback: Playback | None) -> str:
    """Return the notes on a motion and on parts that could not be shown."""
    lines = [*(playback.notes if playback else ()), *picture.notes]
    return plain_text([f"Note: {line}" for line in lines]) if lines else ""


def _joint_sliders(gui: Any, robot: Robot) -> tuple[Any, ...]:
    free = np.where(robot.is_prismatic, 1.0, np.pi)
    lower = np.round(np.where(np.isfinite(robot.lower_limits), robot.lower_limits, -free), 3)
    upper = np.round(np.where(np.isfinite(robot.upper_limits), robot.upper_limits, free), 3)
    rest = np.clip(rest_posture(robot), lower, upper)
    ranges = zip(robot.joint_names, lower.tolist(), upper.tolist(), rest.tolist(), strict=True)
    with gui.add_folder("Joints", expand_by_default=robot.n <= _FEW_JOINTS):
        return tuple(gui.add_slider(name, low, up, 0.001, at) for name, low, up, at in ranges)


def _checkbox(gui: Any, stage: Stage, group: str, label: str, shown: bool) -> None:
    """Add a checkbox that shows and hides a group of nodes, if there are any."""
    if stage.groups[group]:
        box = gui.add_checkbox(label, shown)
        stage.show(group, shown)
        box.on_update(lambda _: stage.show(group, box.value))


def _choices(gui: Any, picture: Picture, stage: Stage) -> None:
    """Add the choice of visible parts; lines are visible if a body has no shape."""
    if stage.groups["bodies"]:
        initial = 0.6 if picture.robot.elastic_joints else 1.0
        initial = 0.25 if picture.identified else initial
        opacity = gui.add_slider("bodies", 0.0, 1.0, 0.05, initial)
        opacity.on_update(lambda _: stage.fade(opacity.value))
        stage.fade(initial)
    _checkbox(gui, stage, "lines", "lines between joints", bool(picture.bare_bodies))
    _checkbox(gui, stage, "joints", "joints", True)
    _checkbox(gui, stage, "names", "names of joints", picture.robot.n <= _FEW_JOINTS)
    _checkbox(gui, stage, "payloads", "known payloads", True)


_STYLES: dict[str, dict[str, Any]] = {
    "measured": {"stroke": "#b4bcc6", "width": 4.0},
    "nominal": {"stroke": hexadecimal(NOMINAL), "width": 1.5, "dash": (6.0, 4.0)},
    "identified": {"stroke": hexadecimal(IDENTIFIED), "width": 1.8},
}
"""Lines of the sources: what is measured stays visible under what is computed."""

_CURSOR = {"label": "now", "stroke": "#d1242f", "width": 1.5}

_WIDTH_PX, _HEIGHT_PX = 370, 215


@dataclass(frozen=True, eq=False)
class Plots:
    """Handles of viser: `joint` is the choice of the joint, the others are plots."""

    joint: Any
    torque: Any
    deflection: Any


def _put_plots(server: Any, robot: Robot, playbacks: Sequence[Playback]) -> Plots:
    """Add the plots in a panel of their own: at the left, on a small page a section to open."""
    gui, panel = server.gui, server.gui.add_panel()
    sources = ({"label": source, **style} for source, style in _STYLES.items())
    series = ({"label": "time [s]"}, _CURSOR, *sources)
    with panel.add_tab("Plots", icon="chart-line"):
        known = np.nan_to_num(np.abs(playbacks[0].deflection))
        # The joint whose spring moves most, the first one without springs.
        first = robot.joint_names[int(np.argmax(np.max(known, axis=0)))]
        joint = gui.add_dropdown("joint", robot.joint_names, initial_value=first)
        gui.add_html(_legend_of_plots(playbacks))
        torque, deflection = (
            gui.add_uplot(
                (np.zeros(2),) * len(series),
                series,
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
    torque, unit = "motor torque", "N m"
    if not traces.at_motor[index]:
        torque, unit = ("force at the joint", "N") if slides else ("torque at the joint", "N m")
    sources = {name: values[:, index] for name, values in traces.torque.items()}
    _draw(plots.torque, f"{torque} of {joint} [{unit}]", traces.time, sources, time)
    scaled = {name: 1e3 * values[:, index] for name, values in traces.deflection.items()}
    elastic = joint in robot.elastic_joints
    title = f"spring deflection of {joint} [{'mm' if slides else 'mrad'}]"
    _draw(plots.deflection, title, traces.time, scaled if elastic else {}, time)


def _draw(plot: Any, title: str, grid: Array, sources: Mapping[str, Array], time: float) -> None:
    """Show the sources {name: (G,)} of a plot, which is hidden without any value."""
    values = np.concatenate([x[np.isfinite(x)] for x in sources.values()] or [np.zeros(0)])
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
    # The cursor runs below the plot, where nobody sees it, and at one sample up across it.
    now = np.argmin(np.abs(grid - time))
    cursor = np.where(np.arange(len(grid)) == now, high, 2.0 * low - high)
    nothing = np.full(len(grid), np.nan)
    plot.data = (grid, cursor, *(sources.get(name, nothing) for name in _STYLES))


def _legend_of_plots(playbacks: Sequence[Playback]) -> str:
    """Return the names of the lines that some motion has."""
    drawn = [name for name in _STYLES if any(name in p.traces.torque for p in playbacks)]
    lines = "".join(f"<span>{_line(**_STYLES[name])}{name}</span>" for name in drawn)
    return f'<div style="font-size:0.8em;margin:0 0 0.2em">{lines}</div>'


def _line(stroke: str, width: float, dash: tuple[float, ...] = ()) -> str:
    kind = "dashed" if dash else "solid"
    return (
        f'<span style="display:inline-block;width:1.8em;margin:0 0.35em 0 0.9em;'
        f'border-top:{width:g}px {kind} {stroke};vertical-align:0.25em"></span>'
    )
