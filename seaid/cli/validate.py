"""Command validate: prediction of the torques of another log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from seaid.cli.messages import written
from seaid.cli.options import (
    FromLogs,
    IdentifyOptions,
    ResultOptions,
    check_validation_logs,
    facts_of,
)


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
        with written(output, ".json") as file:
            found.save(file, validation)
    text = [validation.summary(), *warning_lines(found.warnings)]
    result.show("\n".join(text), validation.to_dict(), output, **facts_of(found))
