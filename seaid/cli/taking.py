"""What a user takes home: export."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seaid.cli.finding import FEASIBLE, identified
from seaid.cli.options import (
    AsJson,
    CutoffHz,
    Description,
    Drives,
    Estimator,
    Force,
    FromLogs,
    Joints,
    JointZeroStd,
    KnownBodies,
    Payloads,
    Repair,
    Rows,
    Sides,
    Urdf,
    ending,
    logs_of,
    robot_of,
)
from seaid.cli.words import say, say_results, to_be_written

if TYPE_CHECKING:
    from seaid.identification import Identification


def export(
    urdf: Urdf,
    from_logs: FromLogs,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="File to write: .urdf, or .xml for MuJoCo.")
    ],
    drives: Drives = None,
    joints: Joints = None,
    payload: Payloads = None,
    known_body: KnownBodies = None,
    description: Description = None,
    repair: Repair = False,
    rows: Rows = None,
    sides: Sides = "sequential",
    estimator: Estimator = "wls",
    feasible: Annotated[bool, typer.Option("--feasible/--as-estimated", help=FEASIBLE)] = True,
    allow_impossible: Annotated[
        bool, typer.Option("--allow-impossible", help="Write bodies that cannot exist.")
    ] = False,
    cutoff_hz: CutoffHz = None,
    joint_zero_std: JointZeroStd = 0.0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Identify, and write the robot with what was identified, as URDF or MuJoCo model.

    A URDF has its drives as TOML beside it; all else in it stays as it was, comments, meshes and
    unknown tags, and payloads are not written. A MuJoCo model has the springs and the payloads.

    seaid export leg.urdf --from run.csv --drives leg.toml -o found.urdf
    seaid export leg.urdf --from run.csv --drives leg.toml --as-estimated -o found.urdf
    seaid export leg.urdf --from run.csv --drives leg.toml -o found.xml
    """
    ending(output, ".urdf", ".xml")
    beside = output.with_suffix(".toml") if output.suffix.lower() == ".urdf" else None
    read = (urdf, drives, description, *from_logs)
    to_be_written(output, beside, force=force, read=read)
    robot = robot_of(urdf, drives, joints, payload, known_body)
    logs = logs_of(from_logs, robot, description, repair)
    found = identified(robot, logs, rows, sides, estimator, feasible, cutoff_hz, joint_zero_std)
    drivetrains, notes = _written(found, output, allow_impossible)
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    content = {"robot": output, "drivetrains": drivetrains, "notes": notes, "flags": found.flags}
    text = [f"{robot.name}: {len(found.load.values)} base parameters and its drives written"]
    text += [f"! {flag}" for flag in found.flags]
    say("\n".join(text), content, as_json)
    say_results(as_json, output, drivetrains)


def _written(
    found: Identification, output: Path, allow_impossible: bool
) -> tuple[Path | None, tuple[str, ...]]:
    """Write the robot, and return the file of its drives and what a reader must know."""
    if output.suffix.lower() == ".xml":
        from seaid.export.mjcf import write_mjcf

        return None, write_mjcf(found, output, force=allow_impossible).notes
    from seaid.export.urdf_file import write_urdf

    written = write_urdf(found, output, force=allow_impossible)
    return written.drivetrains, written.notes
