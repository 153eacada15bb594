"""Command validate: the torques of logs that the identification has not seen are predicted."""

from __future__ import annotations

from pathlib import Path

import click

import seaid
from seaid.cli.kinds import JsonFile, LogFile
from seaid.cli.options import (
    IdentifiedOptions,
    ResultOptions,
    check_distinct,
    judgement_of,
    refuse,
)


def validate(
    options: IdentifiedOptions,
    logs: tuple[LogFile, ...],
    *,
    cross: bool = False,
    parts: int = 4,
    output: JsonFile | None = None,
    result: ResultOptions,
) -> None:
    """Identify from some logs, or load a run, and predict the torques of another log.

    With --cross each of the logs is predicted by the model identified from all the others; a single
    log is cut into parts.

    Parameters
    ----------
    logs
        The log to predict, none of --from; with --cross all logs.
    cross
        Validate each log on the model identified from all the others.
    parts
        Parts into which --cross cuts a single log.
    output
        JSON file of the parameters and their validation.

    Examples
    --------
    seaid validate leg.urdf other.csv --from run.csv --drives leg.toml
    seaid validate arm.urdf c.csv --from a.csv --from b.csv -o parameters.json
    seaid validate other.csv --run runs/latest
    seaid validate arm.urdf a.csv b.csv c.csv --drives arm.toml --cross
    seaid validate leg.urdf run.csv --drives leg.toml --cross --parts 5
    """
    if cross:
        # Only options that were typed are refused.
        refuse("--cross identifies from the logs to validate", "from_logs", "run")
        refuse("--cross has a model for each log, and writes none", "output")
        _cross_validate(options, logs, parts, result)
        return
    refuse("it needs --cross", "parts")
    if len(logs) > 1:
        raise click.BadParameter("give one log, or add --cross", param_hint="LOG")
    check_distinct(*logs, *options.from_logs)
    result.check(output, read=(*options.files, *logs))
    fit = options.identified_run().identification
    (unseen,) = options.logs(logs, fit.known)
    validation = seaid.validate(fit, unseen)
    if output is not None:
        seaid.write_parameters(fit, output, validation)
    text = [validation.summary(), *seaid.report.warning_lines(fit.warnings)]
    result.show("\n".join(text), validation.to_dict(), output, **judgement_of(fit, validation))


def _cross_validate(
    options: IdentifiedOptions, logs: tuple[Path, ...], parts: int, result: ResultOptions
) -> None:
    """Print the prediction of each log, or part, by the model identified from all the others."""
    robot = options.robot()
    read = options.logs(logs, robot)
    folds = seaid.cross_validate(robot, read, parts=parts, **options.keywords())
    parts_of_log = [f"part {number + 1} of {logs[0]}" for number in range(len(folds))]
    names = [*map(str, logs)] if len(logs) > 1 else parts_of_log
    text = [f"{name}\n{fold.summary()}" for name, fold in zip(names, folds, strict=True)]
    content = [{"log": name, **fold.to_dict()} for name, fold in zip(names, folds, strict=True)]
    result.show("\n".join(text), {"validations": content}, robot=robot.name)
