"""Command view: a robot and its motions in the browser."""

from __future__ import annotations

import contextlib
import os
import sys
import webbrowser
from pathlib import Path

import seaid
from seaid.cli.kinds import Folder, JsonFile, LogFile, RunFile, TomlFile
from seaid.cli.messages import note
from seaid.cli.options import JsonOptions, RobotOptions, logs_of, refuse
from seaid.cli.project import is_typed, warn_of_changes


def view(
    options: RobotOptions,
    *,
    log: list[LogFile] | None = None,
    trajectory: list[JsonFile] | None = None,
    parameters: JsonFile | None = None,
    run: RunFile | None = None,
    description: TomlFile | None = None,
    repair: bool = False,
    package_dir: list[Folder] | None = None,
    port: int = 8080,
    host: str = "127.0.0.1",
    seconds: float | None = None,
    no_browser: bool = False,
    result: JsonOptions,
) -> None:
    """Show a robot and its motions in the browser, at the address in the last line.

    The colour of an elastic joint shows its deflection. Logs come first, then trajectories; another
    motion can be shown next to the one that plays. Without motions, joints have sliders. With
    --run or --parameters, identified bodies are drawn next to the nominal ones; with --run, plots
    have the identified torques too.
    On a desktop the browser opens by itself. Needs pip install 'seaid[view]'.

    Parameters
    ----------
    log
        Recorded log to play.
    trajectory
        Trajectory of seaid excite to play.
    parameters
        Identified parameters to compare with: parameters.json of seaid identify.
    run
        Saved run, with or without a URDF: its values and motions.
    package_dir
        Folder with packages of meshes.
    port
        Port of the page; 0: any free port.
    host
        Access: 127.0.0.1 from this machine, 0.0.0.0 from the network.
    seconds
        Time to show it [s]; default: until Ctrl-C.
    no_browser
        Print the address without opening the browser.

    Examples
    --------
    seaid view leg.urdf --drives leg.toml --log run.csv --trajectory plan.json
    seaid view leg.urdf --drives leg.toml --log run.csv --parameters parameters.json
    seaid view --run runs/latest
    seaid view arm.urdf --package-dir ~/ros/src --port 0
    """
    robot, identified = _robots(options, parameters, run)
    motions = _motions(robot, log or [], trajectory or [], description, repair)
    shown = seaid.view.view_robot(
        robot,
        motions or _motions_of(identified),
        identified=identified,
        package_dirs=package_dir or (),
        host=host,
        port=port,
    )
    with shown, contextlib.suppress(KeyboardInterrupt):
        for text in shown.picture.notes:
            note(text)
        result.show(shown.url, {"url": shown.url}, robot=robot.name)
        if not no_browser and has_display():
            webbrowser.open(shown.url)
        shown.wait(seconds)


def _robots(
    options: RobotOptions, parameters: Path | None, run: Path | None
) -> tuple[seaid.Robot, seaid.Robot | seaid.Identification | None]:
    """Return the nominal robot, and what was identified.

    The run of a project file gives way to another robot and to --parameters.
    """
    if parameters is not None:
        if is_typed("run"):
            refuse("give one of the two", "parameters", "run")
        robot = options.robot()
        return robot, seaid.read_parameters(parameters, robot)
    if run is None or (not is_typed("run") and is_typed("urdf", "drives", "joints")):
        return options.robot(), None
    saved = seaid.project.load_run(run)
    warn_of_changes(run, saved.provenance)
    robot = options.robot() if is_typed("urdf") else saved.identification.known
    return robot, saved.identification


def _motions_of(
    identified: seaid.Robot | seaid.Identification | None,
) -> dict[str, seaid.view.Shown]:
    """Return the motions that an identification has, for a view without other ones."""
    motions = getattr(identified, "motions", ())
    return {f"identified from {number}": motion for number, motion in enumerate(motions, 1)}


def has_display() -> bool:
    """Return whether somebody at a terminal of this machine would see a browser that opens."""
    if not is_shown() or "SSH_CONNECTION" in os.environ:
        return False
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform in ("win32", "darwin") or any(map(os.environ.get, displays))


def is_shown() -> bool:
    """Return whether stdout, which has the address, is a terminal."""
    return sys.stdout.isatty()


def _motions(
    robot: seaid.Robot,
    logs: list[Path],
    trajectories: list[Path],
    description: Path | None,
    repair: bool,
) -> dict[str, seaid.view.Shown]:
    """Return all motions by the names of their files, or by their paths if names are equal."""
    paths = [*logs, *trajectories]
    read: list[seaid.view.Shown] = [*logs_of(logs, robot, description, repair)]
    read += map(seaid.load_trajectory, trajectories)
    names = [path.name for path in paths]
    return {
        path.name if names.count(path.name) == 1 else str(path): motion
        for path, motion in zip(paths, read, strict=True)
    }
