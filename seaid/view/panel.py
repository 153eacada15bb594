"""Panels: the inputs of a view with its colour scale, and plots over time of one joint."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, IndexArray
from seaid.view.picture import NEUTRAL, rest_posture

if TYPE_CHECKING:
    from seaid.robot import Robot
    from seaid.view.picture import Picture, Stage
    from seaid.view.playback import Playback

NOTHING = "nothing"
SPEEDS = ("0.1x", "0.25x", "0.5x", "1x", "2x", "4x")

_STOPS = ("#144eba", "#68ace8", "#fff3ba", "#f59042", "#ba2212")
"""Blue, light blue, pale yellow, orange, red; at -1, -1/2, 0, 1/2 and 1."""

_FEW_JOINTS = 12
"""Robots with more joints show their names, and the sliders of their joints, when asked."""

_WIDTH_PX, _HEIGHT_PX = 370, 240
"""Size of the plots."""

_LINES: dict[str, dict[str, Any]] = {
    "time [s]": {},
    "now": {"stroke": "#d1242f", "width": 1.5},
    "motion": {"stroke": "#9aa4b0", "width": 4.0},
    "identified": {"stroke": "#00966e", "width": 1.8},
    "compared": {"stroke": "#f0821e", "width": 1.8},
}
"""Lines of a plot: the motion is seen below what is compared with it."""

_SAMPLES = 600
"""Instants of a plot, about two per pixel."""


def deflection_colors(deflection: Array, limit: Array) -> IndexArray:
    """Return colours (n, 3) of deflections on scales from -limit to limit, neutral for NaN."""
    part = np.divide(deflection, limit, where=limit > 0, out=np.full(len(limit), np.nan))
    places = np.linspace(-1.0, 1.0, len(_STOPS))
    channels = zip(*(bytes.fromhex(stop[1:]) for stop in _STOPS), strict=True)
    colors = np.column_stack([np.interp(part, places, stops) for stops in channels])
    return np.round(np.where(np.isnan(colors), NEUTRAL, colors)).astype(int)


def scales(playbacks: Sequence[Playback], is_prismatic: Sequence[bool]) -> Array:
    """Return the ends (n,) of the colour scales, the largest deflections per kind of joint."""
    sliding = np.array(is_prismatic)
    sizes = [np.max(np.nan_to_num(np.abs(x.deflection)), axis=0) for x in playbacks]
    largest = np.max([np.zeros(len(sliding)), *sizes], axis=0)
    return np.array(np.where(sliding, np.max(largest * sliding), np.max(largest * ~sliding)))


def legend(robot: Robot, limits: Array) -> str:
    """Return the colour scale of deflections up to `limits` (n,) [rad or m]."""
    sliding = np.array(robot.is_prismatic)
    ends = [
        f"±{1e3 * np.max(limits[kind]):.3g} {unit}"
        for kind, unit in ((~sliding, "mrad"), (sliding, "mm"))
        if np.any(limits[kind] > 0)
    ]
    colors = f"linear-gradient(to right, {', '.join(_STOPS)})"
    bar = f'<div style="background:{colors};height:0.9em;border-radius:3px"></div>'
    known = f"{bar}motor minus joint side, {' and '.join(ends)} at the ends"
    return _text(f"<b>Spring deflection about its mean</b>{known if ends else ': none is known'}")


def _text(content: str) -> str:
    return f'<div style="font-size:0.8em;line-height:1.45;margin:0 0.6em 0.5em">{content}</div>'


class Panel:
    """Handles of viser's inputs, texts and plots; those of time and plots only with a motion.

    `inputs` are those that move the robot: without a motion sliders of its joints (n). `limits`
    (n,) are the ends of the colour scale of deflections [rad or m].
    """

    def __init__(
        self, server: Any, picture: Picture, stage: Stage, playbacks: Sequence[Playback]
    ) -> None:
        self.gui, self.robot = server.gui, picture.robot
        self.limits = scales(playbacks, self.robot.is_prismatic)
        self.gui.set_panel_label(self.robot.name)
        self.gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        if playbacks:
            self._put_time([playback.name for playback in playbacks])
            self.gui.add_html(legend(self.robot, self.limits))
        else:
            self._put_sliders()
        notes = [f"{x.name}: {note}" for x in playbacks for note in x.notes] + [*picture.notes]
        self.notes = self.gui.add_html(_text("".join(f"<br>Note: {escape(x)}" for x in notes)))
        with self.gui.add_folder("Show", expand_by_default=bool(playbacks)):
            self._put_choices(stage)
        if playbacks:
            self._put_plots(playbacks[0])

    def _put_time(self, names: Sequence[str]) -> None:
        gui, several = self.gui, len(names) > 1
        self.run = gui.add_dropdown("motion", names)
        self.time = gui.add_slider("time [s]", 0.0, 1.0, 0.001, 0.0)
        self.play = gui.add_button("Play", icon="player-play")
        self.speed = gui.add_dropdown("speed", SPEEDS, initial_value="1x")
        self.compared = gui.add_dropdown("compare with", [NOTHING, *names], visible=several)
        self.inputs = [self.run, self.time, self.compared]

    def _put_sliders(self) -> None:
        robot = self.robot
        free = np.where(robot.is_prismatic, 1.0, np.pi)
        lower = np.round(np.where(np.isfinite(robot.lower_limits), robot.lower_limits, -free), 3)
        upper = np.round(np.where(np.isfinite(robot.upper_limits), robot.upper_limits, free), 3)
        rest = np.clip(rest_posture(robot), lower, upper)
        ranges = zip(robot.joint_names, lower.tolist(), upper.tolist(), rest.tolist(), strict=True)
        with self.gui.add_folder("Joints", expand_by_default=robot.n <= _FEW_JOINTS):
            self.inputs = [self.gui.add_slider(x, low, up, 0.001, at) for x, low, up, at in ranges]

    def _put_choices(self, stage: Stage) -> None:
        """Add the choice of visible parts; lines are visible if the robot has no shape."""
        groups, few = stage.groups, self.robot.n <= _FEW_JOINTS
        shown = {"lines": not groups["bodies"], "nominal": bool(groups["identified"]), "names": few}
        for group, nodes in groups.items():
            if nodes:
                box = self.gui.add_checkbox(group, shown.get(group, True))
                box.on_update(lambda event, group=group: stage.show(group, event.target.value))
                stage.show(group, box.value)

    def _put_plots(self, playback: Playback) -> None:
        """Add the plots in a panel of their own: at the left, on a small page a section to open."""
        names, panel = self.robot.joint_names, self.gui.add_panel()
        # The joint whose spring moves most, the first one without springs.
        first = names[int(np.argmax(np.max(np.nan_to_num(np.abs(playback.deflection)), axis=0)))]
        series = tuple({"label": label, **style} for label, style in _LINES.items())
        empty, sizes = (np.zeros(2),) * len(series), ({"size": 30.0}, {"size": 52.0})
        with panel.add_tab("Plots", icon="chart-line"):
            self.joint = self.gui.add_dropdown("joint", names, initial_value=first)
            self.torque, self.deflection = (
                self.gui.add_uplot(empty, series, height=_HEIGHT_PX, axes=sizes) for _ in range(2)
            )
        self.inputs.append(self.joint)
        panel.dock_left()
        panel.set_width(_WIDTH_PX)

    def draw(self, playback: Playback, compared: Playback | None) -> None:
        """Show the selected joint in the plots, with a cursor at the time shown."""
        joint, index = self.joint.value, self.robot.index(self.joint.value)
        grid, unknown = np.linspace(0.0, playback.duration, _SAMPLES), np.full(_SAMPLES, np.nan)
        deflection, torque, computed = playback.curves(grid, index)
        second = (unknown, unknown) if compared is None else compared.curves(grid, index)
        small, large = ("mm", "N") if self.robot.is_prismatic[index] else ("mrad", "N m")
        at_motor = joint in self.robot.elastic_joints or np.all(np.isnan(computed))
        title = f"motor torque of {joint} [N m]" if at_motor else f"load of {joint} [{large}]"
        self._draw_lines(self.torque, title, grid, np.array([torque, computed, second[1]]))
        deflections = 1e3 * np.array([deflection, unknown, second[0]])
        title = f"spring deflection of {joint} [{small}]"
        self._draw_lines(self.deflection, title, grid, deflections)

    def _draw_lines(self, plot: Any, title: str, grid: Array, lines: Array) -> None:
        """Show lines (3, G) in a plot, which is hidden without any value."""
        plot.title, plot.visible = title, bool(np.any(np.isfinite(lines)))
        if plot.visible:
            low, high = float(np.nanmin(lines)), float(np.nanmax(lines))
            room = 0.06 * (high - low) or max(0.1 * abs(high), 1e-9)
            plot.scales = {"x": {"time": False}, "y": {"range": (low - room, high + room)}}
            # The cursor runs below the plot, where nobody sees it, and at one sample across it.
            is_now = np.arange(len(grid)) == np.argmin(np.abs(grid - self.time.value))
            plot.data = (grid, np.where(is_now, high + room, low - 2 * room), *lines)
