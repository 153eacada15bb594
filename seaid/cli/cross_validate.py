"""Command cross-validate: each log on the model of all the others."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from seaid.cli.messages import is_terminal, show
from seaid.cli.options import AsJson, IdentifyOptions, Logs


def cross_validate(
    options: IdentifyOptions,
    logs: Logs,
    *,
    parts: Annotated[int, Option(help="Parts into which a single log is cut.")] = 4,
    as_json: AsJson = False,
) -> None:
    """Validate each log on the model identified from all the others.

    seaid cross-validate leg.urdf run.csv --drives leg.toml --parts 5
    seaid cross-validate arm.urdf a.csv b.csv c.csv --drives arm.toml
    """
    from seaid.identification import cross_validate as validated

    robot = options.robot(options.known_body)
    read = options.logs(logs, robot)
    folds = validated(robot, read, parts=parts, progress=is_terminal(), **options.keywords())
    alone = [f"part {number + 1} of {logs[0]}" for number in range(len(folds))]
    names = [str(log) for log in logs] if len(logs) > 1 else alone
    text = [f"{name}\n{fold.summary()}" for name, fold in zip(names, folds, strict=True)]
    content = [{"log": name, **fold.to_dict()} for name, fold in zip(names, folds, strict=True)]
    show("\n".join(text), {"validations": content}, as_json, robot=robot.name)
