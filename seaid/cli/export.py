"""What a user takes home: export."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seaid.cli.identify import FEASIBLE, identified
from seaid.cli.messages import in_one_line, say, say_results, to_be_written
from seaid.cli.options import (
    AsJson,
    CutoffHz,
    Description,
    Drives,
    EncoderOffsetStd,
    Estimator,
    Force,
    Joints,
    KnownBodies,
    Method,
    Payloads,
    Repair,
    TorqueJoints,
    Urdf,
    ending,
    logs_of,
    robot_of,
)

if TYPE_CHECKING:
    from seaid.robot import Robot


def export(
    urdf: Urdf,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="File to write: .urdf, or .xml for MuJoCo.")
    ],
    from_logs: Annotated[
        list[Path] | None,
        typer.Option("--from", help="Log to identify from. May be repeated.", metavar="LOG"),
    ] = None,
    parameters: Annotated[
        Path | None,
        typer.Option(help="What seaid identify wrote, taken as it is, in place of --from."),
    ] = None,
    drives: Drives = None,
    joints: Joints = None,
    payload: Payloads = None,
    known_body: KnownBodies = None,
    description: Description = None,
    repair: Repair = False,
    torque_joints: TorqueJoints = None,
    method: Method = "two-step",
    estimator: Estimator = "wls",
    feasible: Annotated[bool, typer.Option("--feasible/--as-estimated", help=FEASIBLE)] = True,
    allow_inconsistent: Annotated[
        bool, typer.Option("--allow-inconsistent", help="Write bodies that cannot exist.")
    ] = False,
    cutoff_hz: CutoffHz = None,
    encoder_offset_std: EncoderOffsetStd = 0.0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write the robot with what was identified, as URDF or MuJoCo model.

    Of logs (--from) the possible bodies nearest to the estimate are written, of --parameters those
    in the file: identify with --feasible. A URDF has its drives as TOML beside it; all else in it
    stays as it was, comments, meshes and unknown tags, and payloads are not written. A MuJoCo model
    has the springs and the payloads.

    seaid export leg.urdf --from run.csv --drives leg.toml -o found.urdf
    seaid export leg.urdf --parameters parameters.json -o found.urdf
    seaid export leg.urdf --from run.csv --drives leg.toml -o found.xml
    """
    ending(output, ".urdf", ".xml")
    if (parameters is None) == (not from_logs):
        raise typer.BadParameter("give one of the two", param_hint="--from, --parameters")
    beside = output.with_suffix(".toml") if output.suffix.lower() == ".urdf" else None
    read = (urdf, drives, description, parameters, *(from_logs or ()))
    to_be_written(output, beside, force=force, read=read)
    robot = robot_of(urdf, drives, joints, payload, known_body)
    flags: tuple[str, ...] = ()
    if parameters is not None:
        from seaid.export import read_parameters

        robot = read_parameters(parameters, robot)
    else:
        logs = logs_of(from_logs or [], robot, description, repair)
        found = identified(
            robot, logs, torque_joints, method, estimator, feasible, cutoff_hz, encoder_offset_std
        )
        robot, flags = found.robot, found.flags
    tables, notes = _written(robot, output, allow_inconsistent)
    for note in notes:
        typer.echo(f"note: {in_one_line(note)}", err=True)
    content = {"robot": output, "drives": tables, "notes": notes, "flags": flags}
    text = [f"{robot.name}: {robot.n} bodies and their drives written"]
    text += [f"! {flag}" for flag in flags]
    say("\n".join(text), content, as_json)
    say_results(as_json, output, tables)


def _written(
    robot: Robot, output: Path, allow_inconsistent: bool
) -> tuple[Path | None, tuple[str, ...]]:
    """Write the robot, and return the file of its drives and what a reader must know."""
    if output.suffix.lower() == ".xml":
        from seaid.export import write_mjcf

        return None, write_mjcf(robot, output, force=allow_inconsistent).notes
    from seaid.export import write_urdf

    written = write_urdf(robot, output, force=allow_inconsistent)
    return written.drives, written.notes
