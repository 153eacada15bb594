"""Panel: what the user turns and presses beside the picture, and what it says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seaid.arrays import Array
from seaid.view.picture import Picture
from seaid.view.playback import Playback
from seaid.view.readout import legend, words
from seaid.view.stage import Stage, fade, show

NOTHING = "nothing"
SPEEDS = ("0.1x", "0.25x", "0.5x", "1x", "2x", "4x")

_SHOWN = (
    ("lines", "lines between joints", False),
    ("joints", "joints", True),
    ("names", "names of joints", True),
    ("payloads", "known payloads", True),
    ("centers", "centres of mass", False),
)


@dataclass(frozen=True, eq=False)
class Panel:
    """Handles of viser's inputs and texts; those of time are None where there is no motion.

    `joints` (n) are sliders of positions, there where no motion moves the robot.
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
    """Add the panel to a viser server: time and choice of motion, colours, numbers, what to see."""
    gui = server.gui
    gui.set_panel_label(picture.robot.name)
    gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
    run = time = play = speed = compared = None
    if playbacks:
        names = [one.name for one in playbacks]
        run = gui.add_dropdown("motion", names, initial_value=names[0])
        time = gui.add_slider("time [s]", 0.0, slider_end(playbacks[0]), 0.001, 0.0)
        play = gui.add_button("Play", icon="player-play")
        speed = gui.add_dropdown("speed", SPEEDS, initial_value="1x")
        if len(names) > 1:
            compared = gui.add_dropdown(
                "orange lines",
                [NOTHING, *names],
                initial_value=NOTHING,
                hint="Another motion beside this one, at the same time since its start.",
            )
    if playbacks:
        gui.add_html(legend(picture.robot, limits))
    table = gui.add_html("")
    notes = gui.add_html("")
    joints = () if playbacks else _joint_sliders(gui, picture)
    with gui.add_folder("Show", expand_by_default=False):
        _choices(gui, picture, stage)
    return Panel(run, time, play, speed, compared, joints, table, notes)


def slider_end(playback: Playback) -> float:
    """Return the end of the slider of time for a motion [s], to the millisecond."""
    return max(round(playback.duration, 3), 0.001)


def said(picture: Picture, playback: Playback | None) -> str:
    """Return the notes on a motion and on what could not be shown."""
    lines = [*(playback.notes if playback else ()), *picture.notes]
    return words([f"Note: {line}" for line in lines]) if lines else ""


def _joint_sliders(gui: Any, picture: Picture) -> tuple[Any, ...]:
    robot, home, sliders = picture.robot, picture.home, []
    with gui.add_folder("Joints", expand_by_default=robot.n <= 12):
        for index, joint in enumerate(robot.joint_names):
            ends = np.array([robot.lower_limits[index], robot.upper_limits[index]])
            free = (-1.0, 1.0) if robot.is_prismatic[index] else (-np.pi, np.pi)
            lower, upper = np.round(np.where(np.isfinite(ends), ends, free), 3)
            value = float(np.clip(home[index], lower, upper))
            sliders.append(gui.add_slider(joint, float(lower), float(upper), 0.001, value))
    return tuple(sliders)


def _choices(gui: Any, picture: Picture, stage: Stage) -> None:
    """Add what shows and hides; without shapes on all bodies the lines are shown from the start."""
    if stage.groups["bodies"]:
        seen_through = 0.6 if picture.robot.elastic_joints else 1.0
        opacity = gui.add_slider("bodies", 0.0, 1.0, 0.05, seen_through)
        opacity.on_update(lambda _: fade(stage.groups["bodies"], opacity.value))
        fade(stage.groups["bodies"], seen_through)
    for group, label, shown in _SHOWN:
        nodes = stage.groups[group]
        if not nodes:
            continue
        if group == "lines":
            shown = shown or bool(picture.bare_bodies)
        if group == "names":
            shown = nodes[0].visible
        box = gui.add_checkbox(label, shown)
        show(nodes, shown)
        box.on_update(lambda _, nodes=nodes, box=box: show(nodes, box.value))
