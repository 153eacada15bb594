"""Commands check, identify, validate and terms: from logs to parameters."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from seaid.cli.messages import is_terminal, show
from seaid.cli.options import (
    FEASIBLE,
    AsJson,
    FailOn,
    FromLogs,
    IdentifyOptions,
    LogOptions,
    Logs,
    Output,
    ResultOptions,
    check_fail_on,
    check_validation_logs,
    fail_on_warnings,
    names,
)

if TYPE_CHECKING:
    from seaid.identification import TermComparison


PIECES = "Read logs with the column names of seaid in pieces: they may be larger than memory."


def identify(
    given: IdentifyOptions,
    logs: Logs,
    *,
    in_pieces: Annotated[bool, Option("--in-pieces", help=PIECES)] = False,
    feasible: Annotated[bool, Option("--feasible", help=FEASIBLE)] = False,
    output: Output = Path("parameters.json"),
    fail_on: FailOn = None,
    result: ResultOptions,
) -> None:
    """Identify drives and bodies from one log or several.

    Of the files only geometry, ratios, radii, rotor inertias and the parameters named as known are
    used; other numbers are nominal. The first lines say whether to use the result. Warnings have a
    code and a remedy: '!' wrong, '?' doubtful, '-' for information.

    seaid identify leg.urdf run.csv --drives leg.toml --payload foot:2.0:0.15,0,0
    seaid identify arm.urdf a.csv b.csv --drives arm.toml --method simultaneous -o arm.json
    seaid identify arm.urdf bag/ --description arm_log.toml --estimator huber
    seaid identify arm.urdf day.parquet --drives arm.toml --in-pieces
    """
    if in_pieces and (given.repair or given.description is not None):
        raise typer.BadParameter(
            "logs that are read in pieces are not changed: no --repair, no --description",
            param_hint="--in-pieces",
        )
    check_fail_on(fail_on)
    result.check(output, read=(*given.files, *logs))
    robot = given.robot(given.known_body or ())
    known = logs if in_pieces else given.logs(logs, robot)
    found = given.identify(robot, known, feasible=feasible)
    found.save(output)
    result.show(found.summary(), found.to_dict(), output)
    fail_on_warnings(found.warnings, fail_on)


def check(
    given: LogOptions,
    logs: Logs,
    *,
    fail_on: FailOn = None,
    as_json: AsJson = False,
) -> None:
    """Check units, signs, ratios, gravity and payloads of an experiment before a fit.

    seaid check leg.urdf run.csv --drives leg.toml
    seaid check arm.urdf a.csv b.csv --drives arm.toml --fail-on doubtful
    """
    from seaid.identification import check as checked

    check_fail_on(fail_on)
    robot = given.robot(given.known_body or ())
    found = checked(robot, given.logs(logs, robot), cutoff_hz=given.cutoff_hz)
    content = {"warnings": found.warnings, "joints": found.joints}
    show(found.summary(), content, as_json)
    fail_on_warnings(found.warnings, fail_on)


def validate(
    given: IdentifyOptions,
    log: Annotated[Path, Argument(help="A log not identified from.", metavar="LOG")],
    from_logs: FromLogs,
    *,
    output: Annotated[
        Path | None, Option("--output", "-o", help="File for parameters with their validation.")
    ] = None,
    result: ResultOptions,
) -> None:
    """Identify from some logs, and predict the torques of another one.

    seaid validate leg.urdf other.csv --from run.csv --drives leg.toml
    seaid validate arm.urdf c.csv --from a.csv --from b.csv -o parameters.json
    """
    from seaid.identification import validate as validated
    from seaid.report import warning_lines

    check_validation_logs([log], from_logs)
    result.check(output, read=(*given.files, log, *from_logs))
    robot = given.robot(given.known_body or ())
    *known, unseen = given.logs([*from_logs, log], robot)
    found = given.identify(robot, known)
    validation = validated(found, unseen)
    if output is not None:
        found.save(output, validation)
    text = [validation.summary(), *warning_lines(found.warnings)]
    result.show("\n".join(text), {**validation.to_dict(), "warnings": found.warnings}, output)


def terms(
    given: LogOptions,
    logs: Logs,
    *,
    of: Annotated[
        str | None, Option(help="Joints whose terms are compared, as a,b,c; default: all.")
    ] = None,
    output: Annotated[
        Path | None, Option("--output", "-o", help="TOML with the drives and recommended terms.")
    ] = None,
    result: ResultOptions,
) -> None:
    """Compare which further terms of friction and springs the logs support.

    seaid terms leg.urdf run.csv --drives leg.toml -o leg_with_terms.toml
    seaid terms leg.urdf run.csv --drives leg.toml --of knee_pitch
    """
    from seaid.drives import write_drives
    from seaid.identification import compare_terms

    result.check(output, read=(*given.files, *logs))
    robot = given.robot(given.known_body or ())
    selection = compare_terms(
        robot,
        given.logs(logs, robot),
        joints=names(of),
        torque_joints=names(given.torque_joints),
        cutoff_hz=given.cutoff_hz,
        progress=is_terminal(),
    )
    if output is not None:
        write_drives(selection.robot.drives, output)
    content = {
        "recommended": selection.recommended,
        "comparisons": [_comparison_facts(one) for one in selection.comparisons],
    }
    result.show(str(selection), content, output)


def _comparison_facts(one: TermComparison) -> dict[str, object]:
    facts = {"joint": one.joint, "field": one.field, "term": one.term, "step": one.step + 1}
    facts |= {"supported": one.is_supported, "selected": one.selected, "reason": one.reason}
    return facts | {"significance": None if one.comparison is None else asdict(one.comparison)}
