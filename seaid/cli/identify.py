"""Commands that find parameters in logs: identify, validate, terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seaid.cli.messages import say, say_results, shows_progress, to_be_written
from seaid.cli.options import (
    AsJson,
    CutoffHz,
    Description,
    Drives,
    EncoderOffsetStd,
    Estimator,
    Force,
    FromLogs,
    Joints,
    KnownBodies,
    Logs,
    Method,
    Output,
    Payloads,
    Repair,
    TorqueJoints,
    Urdf,
    check_unseen,
    logs_of,
    names,
    robot_of,
)

if TYPE_CHECKING:
    from seaid.identification import Identification, Source, TermComparison
    from seaid.robot import Robot


PIECES = "Read logs with our own column names piece by piece: they may be longer than memory."
FEASIBLE = "The physically possible bodies nearest to the estimate."


def identify(
    urdf: Urdf,
    logs: Logs,
    drives: Drives = None,
    joints: Joints = None,
    payload: Payloads = None,
    known_body: KnownBodies = None,
    description: Description = None,
    repair: Repair = False,
    in_pieces: Annotated[bool, typer.Option("--in-pieces", help=PIECES)] = False,
    torque_joints: TorqueJoints = None,
    method: Method = "two-step",
    estimator: Estimator = "wls",
    feasible: Annotated[bool, typer.Option("--feasible", help=FEASIBLE)] = False,
    cutoff_hz: CutoffHz = None,
    encoder_offset_std: EncoderOffsetStd = 0.0,
    output: Output = Path("parameters.json"),
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Identify drives and bodies from one log or several.

    Only geometry, ratios, radii, rotor inertias and what is named as known are used of the files;
    other numbers in them are nominal. Lines with '!' say what must not be trusted.

    seaid identify leg.urdf run.csv --drives leg.toml --payload foot:2.0:0.15,0,0
    seaid identify arm.urdf a.csv b.csv --drives arm.toml --method joint -o arm.json
    seaid identify arm.urdf bag/ --description arm_log.toml --estimator huber
    seaid identify arm.urdf day.parquet --drives arm.toml --in-pieces
    """
    if in_pieces and (repair or description is not None):
        raise typer.BadParameter(
            "logs that are read in pieces are taken as they are: no --repair, no --description",
            param_hint="--in-pieces",
        )
    to_be_written(output, force=force, read=(urdf, drives, description, *logs))
    robot = robot_of(urdf, drives, joints, payload, known_body)
    found = identified(
        robot,
        logs if in_pieces else logs_of(logs, robot, description, repair),
        torque_joints,
        method,
        estimator,
        feasible,
        cutoff_hz,
        encoder_offset_std,
    )
    found.save(output)
    say(found.summary(), found.to_dict(), as_json)
    say_results(as_json, output)


def identified(
    robot: Robot,
    logs: Sequence[Source],
    torque_joints: str | None,
    method: str,
    estimator: str,
    feasible: bool,
    cutoff_hz: float | None,
    encoder_offset_std: float,
) -> Identification:
    """Identify as the options tell."""
    from seaid.identification import identify as identify_logs

    return identify_logs(
        robot,
        logs,
        torque_joints=names(torque_joints),
        method=method,
        estimator=estimator,
        feasible=feasible,
        cutoff_hz=cutoff_hz,
        encoder_offset_std=encoder_offset_std,
        progress=shows_progress(),
    )


def validate(
    urdf: Urdf,
    log: Annotated[Path, typer.Argument(help="A log not identified from.", metavar="LOG")],
    from_logs: FromLogs,
    drives: Drives = None,
    joints: Joints = None,
    payload: Payloads = None,
    known_body: KnownBodies = None,
    description: Description = None,
    repair: Repair = False,
    torque_joints: TorqueJoints = None,
    method: Method = "two-step",
    estimator: Estimator = "wls",
    cutoff_hz: CutoffHz = None,
    encoder_offset_std: EncoderOffsetStd = 0.0,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File for parameters with their validation."),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Identify from some logs, and predict the torques of another one.

    seaid validate leg.urdf other.csv --from run.csv --drives leg.toml
    seaid validate arm.urdf c.csv --from a.csv --from b.csv -o parameters.json
    """
    from seaid.identification import validate as validated
    from seaid.report import validation_table

    check_unseen([log], from_logs)
    to_be_written(output, force=force, read=(urdf, drives, description, log, *from_logs))
    robot = robot_of(urdf, drives, joints, payload, known_body)
    *known, unseen = logs_of([*from_logs, log], robot, description, repair)
    found = identified(
        robot, known, torque_joints, method, estimator, False, cutoff_hz, encoder_offset_std
    )
    result = validated(found, unseen)
    if output is not None:
        found.save(output, result)
    text = [validation_table(result), *(f"! {flag}" for flag in found.flags)]
    say("\n".join(text), {**result.to_dict(), "flags": found.flags}, as_json)
    say_results(as_json, output)


def terms(
    urdf: Urdf,
    logs: Logs,
    drives: Drives = None,
    joints: Joints = None,
    payload: Payloads = None,
    known_body: KnownBodies = None,
    description: Description = None,
    repair: Repair = False,
    of: Annotated[
        str | None, typer.Option(help="Joints asked about, as a,b,c; default: all.")
    ] = None,
    torque_joints: TorqueJoints = None,
    cutoff_hz: CutoffHz = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="TOML with the drives and recommended terms."),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Ask which more terms of friction and springs the logs support.

    seaid terms leg.urdf run.csv --drives leg.toml -o leg_with_terms.toml
    seaid terms leg.urdf run.csv --drives leg.toml --of knee_pitch
    """
    from seaid.drives import write_drives
    from seaid.identification import compare_terms

    to_be_written(output, force=force, read=(urdf, drives, description, *logs))
    robot = robot_of(urdf, drives, joints, payload, known_body)
    selection = compare_terms(
        robot,
        logs_of(logs, robot, description, repair),
        joints=names(of),
        torque_joints=names(torque_joints),
        cutoff_hz=cutoff_hz,
        progress=shows_progress(),
    )
    if output is not None:
        write_drives(selection.robot.drives, output)
    content = {
        "recommended": selection.recommended,
        "asked": [_gain_facts(one) for one in selection.comparisons],
    }
    say(str(selection), content, as_json)
    say_results(as_json, output)


def _gain_facts(one: TermComparison) -> dict[str, object]:
    facts = {"joint": one.joint, "field": one.field, "term": one.term, "step": one.step + 1}
    facts |= {"worth_having": one.is_supported, "chosen": one.selected, "reason": one.reason}
    return facts | {"gain": None if one.comparison is None else asdict(one.comparison)}
