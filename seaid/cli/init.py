"""Command init: a first project file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from seaid.cli.messages import show
from seaid.cli.mistakes import check_log_files, check_robot_files
from seaid.cli.options import (
    AsJson,
    Logs,
    RateHz,
    RobotOptions,
    check_joints,
    contacts_of,
    names,
    payload_of,
    positions,
    values,
    vector,
)
from seaid.errors import abridged

if TYPE_CHECKING:
    from seaid.drives import Controller


def init(
    options: RobotOptions,
    logs: Logs,
    *,
    position_gain: Annotated[
        str | None,
        Option(help="Gain of the position controllers [N m/rad at the joint], or hip=20,knee=40."),
    ] = None,
    velocity_gain: Annotated[
        str, Option(help="Their velocity gain [N m s/rad at the joint], or hip=1,knee=2.")
    ] = "0",
    rate_hz: RateHz = None,
    folder: Annotated[Path, Option(help="The folder of the project.")] = Path(),
    as_json: AsJson = False,
) -> None:
    """Write a first project file for a robot and its logs, with each doubt as a comment.

    The file is seaid.toml. Joints with position or velocity commands and no torque get a controller
    with the gains given. Logs with custom columns get a description, and a robot without drives
    gets those that the logs show: check what is unsure, then run it.

    seaid init leg.urdf run.csv other.csv
    seaid init go2 go2.csv --position-gain 20 --velocity-gain 1.5
    seaid init go2 walk.npz --base floating --contact FL_foot,FR_foot,RL_foot,RR_foot --rate-hz 500
    seaid init arm.urdf run.csv --drives arm.toml --payload hand:1.5:0,0,0.05
    """
    from seaid.project import write_first_project

    check_robot_files(options.urdf, options.drives)
    check_log_files(logs)
    project = write_first_project(
        options.urdf,
        logs,
        drives=options.drives,
        joints=names(options.joints),
        locked=positions("--locked", options.locked),
        payloads=[payload_of(text) for text in options.payload or ()],
        gravity=vector("--gravity", options.gravity),
        folder=folder,
        controllers=_controllers(options, position_gain, velocity_gain),
        base=options.base,  # type: ignore[arg-type]
        contacts=[contact for text in options.contact or () for contact in contacts_of(text)],
        imu_link=options.imu_link,
        rate_hz=rate_hz,
    )
    text = [f"unsure: {abridged(doubt)}" for doubt in project.doubts]
    place = "" if folder == Path() else f" {folder}"
    text.append(f"Check what is unsure, then: seaid run{place}")
    content = {"files": project.files, "doubts": project.doubts}
    show("\n".join(text), content, as_json, *project.files)


def _controllers(
    options: RobotOptions, position_gain: str | None, velocity_gain: str
) -> dict[str, Controller] | None:
    """Return {joint: controller} of the options, None without a position gain."""
    from seaid.drives import Controller

    robot = options.robot()
    stiffness = values("--position-gain", position_gain)
    damping = values("--velocity-gain", velocity_gain)
    if stiffness is None and not damping:
        return None
    stiff, damped = (
        gains if isinstance(gains, dict) else dict.fromkeys(robot.joint_names, gains or 0.0)
        for gains in (stiffness, damping)
    )
    check_joints("--position-gain", stiff, robot)
    check_joints("--velocity-gain", damped, robot)
    return {
        joint: Controller(
            position_gain_Nm_per_rad=stiff.get(joint, 0.0),
            velocity_gain_Nms_per_rad=damped.get(joint, 0.0),
        )
        for joint in (stiff if stiffness is not None else damped)
    }
