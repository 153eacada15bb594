"""Panels: the inputs of a view, colour scale and table of joints; plots over time of one joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array
from seaid.view.picture import NEUTRAL, gradient, hexadecimal
from seaid.view.stage import IDENTIFIED, NOMINAL, WRONG, fade, show

if TYPE_CHECKING:
    from seaid.robot import Robot
    from seaid.view.picture import Picture
    from seaid.view.playback import Playback
    from seaid.view.shapes import Color, Ellipsoid
    from seaid.view.stage import Stage


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
        cells = [_number(position[index], ".3f", "m" if slides else "rad")]
        if springs:
            cells.append(_number(1e3 * deflection[index], ".2f", "mm" if slides else "mrad"))
        rows.append([f"{_chip(colors[index])} {escape(joint)}", *cells])
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


NOTHING = "nothing"
SPEEDS = ("0.1x", "0.25x", "0.5x", "1x", "2x", "4x")

_SHOWN = (
    ("lines", "lines between joints", False),
    ("joints", "joints", True),
    ("names", "names of joints", True),
    ("payloads", "known payloads", True),
)


@dataclass(frozen=True, eq=False)
class Panel:
    """Handles of viser's inputs and texts; those of time are None without a motion.

    `joints` (n) are sliders of positions, present only without a motion.
    """

    run: Any
    time: Any
    play: Any
    speed: Any
    compared: Any
    joints: tuple[Any, ...]
    table: Any
    notes: Any


def put_panel(
    server: Any, picture: Picture, stage: Stage, playbacks: Sequence[Playback], limits: Array
) -> Panel:
    """Add the panel to a viser server: motion and time, colours, table, visible parts."""
    gui = server.gui
    gui.set_panel_label(picture.robot.name)
    gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
    run = time = play = speed = compared = None
    if playbacks:
        names = [playback.name for playback in playbacks]
        run = gui.add_dropdown("motion", names, initial_value=names[0])
        time = gui.add_slider("time [s]", 0.0, slider_end(playbacks[0]), 0.001, 0.0)
        play = gui.add_button("Play", icon="player-play")
        speed = gui.add_dropdown("speed", SPEEDS, initial_value="1x")
        if len(names) > 1:
            compared = gui.add_dropdown(
                "compare with",
                [NOTHING, *names],
                initial_value=NOTHING,
                hint="Another motion, drawn in orange at the same time since its start.",
            )
        gui.add_html(legend(picture.robot, limits))
    table = gui.add_html("")
    notes = gui.add_html("")
    joints = () if playbacks else _joint_sliders(gui, picture)
    if picture.nominal or picture.identified:
        with gui.add_folder("Masses and inertia", expand_by_default=bool(picture.identified)):
            _bodies(gui, picture, stage)
    with gui.add_folder("Show", expand_by_default=False):
        _choices(gui, picture, stage)
    return Panel(run, time, play, speed, compared, joints, table, notes)


def slider_end(playback: Playback) -> float:
    """Return the end of the time slider for a motion [s], to the millisecond."""
    return max(round(playback.duration, 3), 0.001)


def notes_of(picture: Picture, playback: Playback | None) -> str:
    """Return the notes on a motion and on parts that could not be shown."""
    lines = [*(playback.notes if playback else ()), *picture.notes]
    return plain_text([f"Note: {line}" for line in lines]) if lines else ""


def _joint_sliders(gui: Any, picture: Picture) -> tuple[Any, ...]:
    robot, sliders = picture.robot, []
    with gui.add_folder("Joints", expand_by_default=robot.n <= 12):
        for index, joint in enumerate(robot.joint_names):
            ends = np.array([robot.lower_limits[index], robot.upper_limits[index]])
            free = (-1.0, 1.0) if robot.is_prismatic[index] else (-np.pi, np.pi)
            lower, upper = np.round(np.where(np.isfinite(ends), ends, free), 3)
            value = float(np.clip(picture.rest_posture[index], lower, upper))
            sliders.append(gui.add_slider(joint, float(lower), float(upper), 0.001, value))
    return tuple(sliders)


def bodies_table(picture: Picture) -> str:
    """Return the colours of ellipsoids, each body's mass [kg] and the shift of its centre [mm]."""
    chips = [
        f"{_chip(color)} {name}"
        for name, color in (("nominal (wire)", NOMINAL), ("identified (solid)", IDENTIFIED))
        if getattr(picture, name.split()[0])
    ]
    nominal = {ellipsoid.body: ellipsoid for ellipsoid in picture.nominal}
    identified = {ellipsoid.body: ellipsoid for ellipsoid in picture.identified}
    rows = []
    for body, name in enumerate(picture.robot.body_names, 1):
        place = body % (len(picture.robot.all_joint_names) + 1)  # a floating base is 0
        before, after = nominal.get(place), identified.get(place)
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


def _bodies(gui: Any, picture: Picture, stage: Stage) -> None:
    """Add a checkbox per kind of ellipsoids and their table."""
    for group in ("nominal", "identified"):
        if stage.groups[group]:
            _checkbox(gui, group, stage.groups[group], bool(picture.identified))
    gui.add_html(bodies_table(picture))


def _checkbox(gui: Any, label: str, nodes: Sequence[Any], shown: bool) -> None:
    box = gui.add_checkbox(label, shown)
    show(nodes, shown)
    box.on_update(lambda _: show(nodes, box.value))


def _choices(gui: Any, picture: Picture, stage: Stage) -> None:
    """Add the choice of visible parts; lines are visible if a body has no shape."""
    if stage.groups["bodies"]:
        initial = 0.6 if picture.robot.elastic_joints else 1.0
        initial = 0.25 if picture.identified else initial
        opacity = gui.add_slider("bodies", 0.0, 1.0, 0.05, initial)
        opacity.on_update(lambda _: fade(stage.groups["bodies"], opacity.value))
        fade(stage.groups["bodies"], initial)
    for group, label, shown in _SHOWN:
        nodes = stage.groups[group]
        if not nodes:
            continue
        if group == "lines":
            shown = shown or bool(picture.bare_bodies)
        if group == "names":
            shown = nodes[0].visible
        _checkbox(gui, label, nodes, shown)


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
        gui.add_html(_legend(playbacks))
        torque, deflection = (
            gui.add_uplot(
                (np.zeros(2),) * (2 + len(_STYLES)),
                (
                    {"label": "time [s]"},
                    _CURSOR,
                    *({"label": s, **style} for s, style in _STYLES.items()),
                ),
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
    step = float(grid[-1]) / _CURSOR_STEPS
    plot.data = _cursor_data(grid, sources, step * round(time / step), (low, high))


def _cursor_data(
    grid: Array, sources: Mapping[str, Array], now: float, ends: tuple[float, float]
) -> tuple[Array, ...]:
    """Return the data of a plot: time, cursor, and all sources, NaN where one has no value.

    The cursor runs below the plot, where nobody sees it, and across it at the time `now`.
    """
    place = int(np.searchsorted(grid, now))
    # Three points at one time: below the plot, at its top, below: a vertical line.
    time = np.insert(grid, place, [now] * 3)
    cursor = np.full(len(time), ends[0] - (ends[1] - ends[0]))
    cursor[place + 1] = ends[1]
    nothing = np.full(len(grid), np.nan)
    lines = (np.interp(time, grid, sources.get(name, nothing)) for name in _STYLES)
    return (time, cursor, *lines)


def _first_joint(robot: Robot, playback: Playback) -> str:
    """Return the joint whose spring moves most, the first one without springs."""
    known = np.where(np.isfinite(playback.deflection), np.abs(playback.deflection), 0.0)
    return robot.joint_names[int(np.argmax(np.max(known, axis=0)))]


def _legend(playbacks: Sequence[Playback]) -> str:
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
