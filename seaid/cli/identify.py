"""Commands identify, validate and terms: parameters from logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seaid.cli.messages import check_outputs, is_terminal, show, show_paths
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
    check_validation_logs,
    logs_of,
    names,
    robot_of,
)

if TYPE_CHECKING:
    from seaid.identification import Identification, Source, TermComparison
    from seaid.robot import Robot


PIECES = "Read logs with the column names of seaid in pieces: they may be larger than memory."
FEASIBLE = "Physically consistent bodies nearest to the estimate."


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

    Of the files only geometry, ratios, radii, rotor inertias and the parameters named as known are
    used; other numbers are nominal. Lines with '!' are warnings.

    seaid identify leg.urdf run.csv --drives leg.toml --payload foot:2.0:0.15,0,0
    seaid identify arm.urdf a.csv b.csv --drives arm.toml --method simultaneous -o arm.json
    seaid identify arm.urdf bag/ --description arm_log.toml --estimator huber
    seaid identify arm.urdf day.parquet --drives arm.toml --in-pieces
    """
    if in_pieces and (repair or description is not None):
        raise typer.BadParameter(
            "logs that are read in pieces are not changed: no --repair, no --description",
            param_hint="--in-pieces",
        )
    check_outputs(output, force=force, read=(urdf, drives, description, *logs))
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
    show(found.summary(), found.to_dict(), as_json)
    show_paths(as_json, output)


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
    """Identify with the values of the options."""
    from seaid.identification import identify as identify_logs

    return identify_logs(
        robot,
        logs,
        torque_joints=names(torque_joints),
        method=method,  # type: ignore[arg-type]  # identify checks it
        estimator=estimator,  # type: ignore[arg-type]
        feasible=feasible,
        cutoff_hz=cutoff_hz,
        encoder_offset_std=encoder_offset_std,
        progress=is_terminal(),
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

    check_validation_logs([log], from_logs)
    check_outputs(output, force=force, read=(urdf, drives, description, log, *from_logs))
    robot = robot_of(urdf, drives, joints, payload, known_body)
    *known, unseen = logs_of([*from_logs, log], robot, description, repair)
    found = identified(
        robot, known, torque_joints, method, estimator, False, cutoff_hz, encoder_offset_std
    )
    result = validated(found, unseen)
    if output is not None:
        found.save(output, result)
    text = [result.summary(), *(f"! {flag}" for flag in found.flags)]
    show("\n".join(text), {**result.to_dict(), "flags": found.flags}, as_json)
    show_paths(as_json, output)


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
        str | None, typer.Option(help="Joints whose terms are compared, as a,b,c; default: all.")
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
    """Compare which further terms of friction and springs the logs support.

    seaid terms leg.urdf run.csv --drives leg.toml -o leg_with_terms.toml
    seaid terms leg.urdf run.csv --drives leg.toml --of knee_pitch
    """
    from seaid.drives import write_drives
    from seaid.identification import compare_terms

    check_outputs(output, force=force, read=(urdf, drives, description, *logs))
    robot = robot_of(urdf, drives, joints, payload, known_body)
    selection = compare_terms(
        robot,
        logs_of(logs, robot, description, repair),
        joints=names(of),
        torque_joints=names(torque_joints),
        cutoff_hz=cutoff_hz,
        progress=is_terminal(),
    )
    if output is not None:
        write_drives(selection.robot.drives, output)
    content = {
        "recommended": selection.recommended,
        "comparisons": [_comparison_facts(one) for one in selection.comparisons],
    }
    show(str(selection), content, as_json)
    show_paths(as_json, output)


def _comparison_facts(one: TermComparison) -> dict[str, object]:
    facts = {"joint": one.joint, "field": one.field, "term": one.term, "step": one.step + 1}
    facts |= {"supported": one.is_supported, "selected": one.selected, "reason": one.reason}
    return facts | {"significance": None if one.comparison is None else asdict(one.comparison)}
