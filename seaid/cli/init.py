"""Command init: a first project file."""

from __future__ import annotations

from pathlib import Path

import seaid
from seaid.cli.kinds import ByJoint, Folder, LogFile, Names
from seaid.cli.options import JsonOptions, RobotOptions, by_joint, check_distinct
from seaid.errors import abridged


def init(
    options: RobotOptions,
    logs: tuple[LogFile, ...],
    *,
    position_gain: ByJoint | None = None,
    velocity_gain: ByJoint = 0,
    rate_hz: float | None = None,
    columns: Names | None = None,
    folder: Folder = Path(),
    result: JsonOptions,
) -> None:
    """Write a first project file for a robot and its logs, with each doubt as a comment.

    The file is seaid.toml. Joints with position or velocity commands and no torque get a controller
    with the gains given. Logs with custom columns get a description, and a robot without drives
    gets those that the logs show: check what is unsure, then run it.

    Parameters
    ----------
    position_gain
        Gain of the position controllers [N m/rad at the joint]
    velocity_gain
        Their velocity gain [N m s/rad at the joint]
    columns
        Names of the columns of each log, or t,q,qd,tau: the time, and arrays in the order of the
        joints; t,q,t,tau of two files of one log.
    folder
        The folder of the project.

    Examples
    --------
    seaid init leg.urdf run.csv other.csv
    seaid init go2 go2.csv --position-gain 20 --velocity-gain 1.5
    seaid init go2 walk.npz --base floating --contact FL_foot,FR_foot,RL_foot,RR_foot --rate-hz 500
    seaid init arm.urdf no_header.csv --columns t,q,qd,tau
    seaid init arm.urdf run.csv --drives arm.toml --payload hand:1.5:0,0,0.05
    """
    check_distinct(*logs)
    project = seaid.write_first_project(
        options.urdf,
        logs,
        folder=folder,
        controllers=_controllers(options, position_gain, velocity_gain),
        rate_hz=rate_hz,
        columns=columns or (),
        **options.keywords_of_robot(),
    )
    text = [f"unsure: {abridged(doubt)}" for doubt in project.doubts]
    place = "" if folder == Path() else f" {folder}"
    text.append(f"Check what is unsure, then: seaid run{place}")
    content = {"files": project.files, "doubts": project.doubts}
    result.show("\n".join(text), content, *project.files)


def _controllers(
    options: RobotOptions,
    position_gain: float | dict[str, float] | None,
    velocity_gain: float | dict[str, float],
) -> dict[str, seaid.Controller]:
    """Return {joint: controller} of the options, none without a gain."""
    robot = options.robot()
    if position_gain is None and not velocity_gain:
        return {}
    stiff = by_joint("--position-gain", position_gain, robot)
    damped = by_joint("--velocity-gain", velocity_gain, robot)
    return {
        joint: seaid.Controller(
            position_gain_Nm_per_rad=stiff.get(joint, 0.0),
            velocity_gain_Nms_per_rad=damped.get(joint, 0.0),
        )
        for joint in (stiff if position_gain is not None else damped)
    }
