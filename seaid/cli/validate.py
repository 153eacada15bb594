"""Command validate: prediction of the torques of another log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from seaid.cli.messages import written
from seaid.cli.options import (
    IdentifiedOptions,
    ResultOptions,
    check_validation_logs,
    facts_of,
)


def validate(
    options: IdentifiedOptions,
    log: Annotated[Path, Argument(help="A log not identified from.", metavar="LOG")],
    *,
    output: Annotated[
        Path | None, Option("--output", "-o", help="File for parameters with their validation.")
    ] = None,
    result: ResultOptions,
) -> None:
    """Identify from some logs, or load a run, and predict the torques of another log.

    seaid validate leg.urdf other.csv --from run.csv --drives leg.toml
    seaid validate arm.urdf c.csv --from a.csv --from b.csv -o parameters.json
    seaid validate other.csv --run runs/latest
    """
    from seaid.identification import validate as validated
    from seaid.report import warning_lines

    check_validation_logs([log], options.from_logs)
    result.check(output, read=(*options.files, log))
    fit = options.result().identification
    (unseen,) = options.logs([log], fit.known)
    validation = validated(fit, unseen)
    if output is not None:
        with written(output, ".json") as file:
            fit.save(file, validation)
    text = [validation.summary(), *warning_lines(fit.warnings)]
    result.show("\n".join(text), validation.to_dict(), output, **facts_of(fit, validation))
