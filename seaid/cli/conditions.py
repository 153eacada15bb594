"""Command conditions: several conditions of one robot, identified together."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from seaid.cli.messages import is_terminal, written
from seaid.cli.mistakes import check_log_files
from seaid.cli.options import LogOptions, ResultOptions, names
from seaid.errors import by_severity


def conditions(
    given: LogOptions,
    condition: Annotated[
        list[str],
        Option(help="Name and log of a condition. May be repeated.", metavar="NAME=LOG"),
    ],
    *,
    specific: Annotated[
        str | None,
        Option(
            help="Parameters estimated per condition, as viscous_friction,spring_offset of knee; "
            "'bodies' for the base parameters. Default: friction and offsets."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        Option("--output", "-o", help="JSON with the parameters of each condition; - for stdout."),
    ] = None,
    result: ResultOptions,
) -> None:
    """Identify several conditions together, such as cold and warm.

    Parameters that are not specific to a condition are shared, and rest on the logs of all
    conditions. A test says which of the specific ones differ.

    seaid conditions leg.urdf --condition cold=a.csv --condition warm=b.csv --drives leg.toml
    seaid conditions leg.urdf --condition cold=a.csv --condition warm=b.csv --drives leg.toml \
--specific viscous_friction
    """
    from seaid._files import write_json
    from seaid.identification import CONDITION_SPECIFIC, identify_conditions

    paths = _logs_by_condition(condition)
    every = [path for found in paths.values() for path in found]
    check_log_files(every, given.description)
    result.check(output, read=(*given.files, *every))
    robot = given.robot(given.known_body or ())
    found = identify_conditions(
        {name: (robot, given.logs(logs, robot)) for name, logs in paths.items()},
        condition_specific=CONDITION_SPECIFIC if specific is None else names(specific) or (),
        torque_joints=names(given.torque_joints),
        cutoff_hz=given.cutoff_hz,
        progress=is_terminal(),
    )
    content = {
        "conditions": {name: one.to_dict() for name, one in found.identifications.items()},
        "differences": [
            {"parameter": str(name), "differs": test.bic > 0, **asdict(test)}
            for name, test in found.differences.items()
        ],
    }
    if output is not None:
        with written(output, ".json") as file:
            write_json(file, content)
    warnings = by_severity(
        {one: None for each in found.identifications.values() for one in each.warnings}
    )
    result.show(found.summary(), content, output, robot=robot.name, warnings=warnings)


def _logs_by_condition(texts: list[str]) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for text in texts:
        name, separator, path = text.partition("=")
        if not (name and separator and path):
            raise typer.BadParameter(
                f"'{text}' is not NAME=LOG, as warm=run.csv", param_hint="--condition"
            )
        found.setdefault(name, []).append(Path(path))
    if len(found) < 2:
        raise typer.BadParameter(
            f"it takes two conditions at least, found {', '.join(found)}: add one, as "
            "--condition warm=run.csv",
            param_hint="--condition",
        )
    return found
