"""Command view: a robot and its motions in the browser."""

from __future__ import annotations

import contextlib
from pathlib import Path

import click

import seaid
from seaid.cli.kinds import Folder, JsonFile, LogFile, RunFile, TomlFile
from seaid.cli.messages import note
from seaid.cli.options import JsonOptions, RobotOptions, logs_of
from seaid.cli.project import is_typed, warn_of_changes


def view(
    options: RobotOptions,
    *,
    log: tuple[LogFile, ...] = (),
    trajectory: tuple[JsonFile, ...] = (),
    run: RunFile | None = None,
    description: TomlFile | None = None,
    repair: bool = False,
    package_dir: tuple[Folder, ...] = (),
    port: int = 8080,
    host: str = "127.0.0.1",
    seconds: float | None = None,
    open_browser: bool = False,
    result: JsonOptions,
) -> None:
    """Show a robot and its motions in the browser, at the address in the last line.

    The colour of an elastic joint shows its deflection. Logs come first, then trajectories; another
    motion can be shown next to the one that plays. Without motions, joints have sliders. With
    --run, identified bodies are drawn next to the nominal ones, and plots have the identified
    torques too. Needs pip install 'seaid[view]'.

    Parameters
    ----------
    log
        Recorded log to play.
    trajectory
        Trajectory of seaid excite to play.
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
    open_browser
        Open the page in the browser.

    Examples
    --------
    seaid view leg.urdf --drives leg.toml --log run.csv --trajectory plan.json
    seaid view --run runs/latest
    seaid view arm.urdf --package-dir ~/ros/src --port 0
    """
    robot, identified = _robots(options, run)
    motions: dict[str, seaid.view.Shown] = {}
    read = logs_of(log, robot, description, repair)
    motions |= zip(map(str, log), read, strict=True)
    motions |= {str(path): seaid.load_trajectory(path) for path in trajectory}
    shown = seaid.view.view_robot(
        robot,
        motions or _motions_of(identified),
        identified=identified,
        package_dirs=package_dir,
        host=host,
        port=port,
    )
    with shown, contextlib.suppress(KeyboardInterrupt):
        for text in shown.picture.notes:
            note(text)
        result.show(shown.url, {"url": shown.url}, robot=robot.name)
        if open_browser:
            click.launch(shown.url)
        shown.wait(seconds)


def _robots(
    options: RobotOptions, run: Path | None
) -> tuple[seaid.Robot, seaid.Identification | None]:
    """Return the nominal robot, and its identification: the run of a project is for its robot."""
    if run is None or (not is_typed("run") and is_typed("urdf", "drives", "joints")):
        return options.robot(), None
    saved = seaid.project.load_run(run)
    warn_of_changes(run, saved.provenance)
    robot = options.robot() if is_typed("urdf") else saved.identification.known
    return robot, saved.identification


def _motions_of(
    identified: seaid.Identification | None,
) -> dict[str, seaid.view.Shown]:
    """Return the motions that an identification has, for a view without other ones."""
    motions = getattr(identified, "motions", ())
    return {f"identified from {number}": motion for number, motion in enumerate(motions, 1)}
