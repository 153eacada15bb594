"""Command conditions: several conditions of one robot, identified together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from seaid.cli.messages import is_terminal, written
from seaid.cli.mistakes import check_log_files
from seaid.cli.options import LogOptions, ResultOptions, names
from seaid.errors import by_severity

if TYPE_CHECKING:
    from seaid.robot import Robot


def conditions(
    options: LogOptions,
    condition: Annotated[
        list[str],
        Option(help="Name and log of a condition. May be repeated.", metavar="NAME=LOG"),
    ],
    *,
    specific: Annotated[
        str | None,
        Option(
            help="Parameters estimated per condition, as viscous_friction,spring_offset of knee; "
            "'bodies' for the base parameters; '' for none. Default: the offsets of springs."
        ),
    ] = None,
    condition_payload: Annotated[
        list[str] | None,
        Option(
            help="Payload that one condition has besides those of --payload. May be repeated.",
            metavar="NAME=LINK:MASS:X,Y,Z",
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
    seaid conditions leg.urdf --condition bare=a.csv --condition loaded=b.csv --drives leg.toml \
--condition-payload loaded=foot:2.0:0.15,0,0 --specific ""
    """
    from seaid._files import write_json
    from seaid.identification import CONDITION_SPECIFIC, identify_conditions

    paths = _by_condition(condition, "LOG, as warm=run.csv", "--condition")
    if len(paths) < 2:
        raise typer.BadParameter(
            f"it takes two conditions at least, found {', '.join(paths)}: add one, as "
            "--condition warm=run.csv",
            param_hint="--condition",
        )
    payloads = _payloads(condition_payload, paths)
    logs = {name: [*map(Path, texts)] for name, texts in paths.items()}
    every = [*chain(*logs.values())]
    check_log_files(every, options.description)
    result.check(output, read=(*options.files, *every))
    robots = {name: _robot(options, payloads.get(name, ())) for name in paths}
    fits = identify_conditions(
        {name: (robot, options.logs(logs[name], robot)) for name, robot in robots.items()},
        condition_specific=CONDITION_SPECIFIC if specific is None else names(specific) or (),
        torque_joints=names(options.torque_joints),
        cutoff_hz=options.cutoff_hz,
        progress=is_terminal(),
    )
    content = {
        "conditions": {name: fit.to_dict() for name, fit in fits.identifications.items()},
        "differences": [
            {"parameter": str(name), "differs": test.bic > 0, **asdict(test)}
            for name, test in fits.differences.items()
        ],
    }
    if output is not None:
        with written(output, ".json") as file:
            write_json(file, content)
    findings = chain(*(fit.warnings for fit in fits.identifications.values()))
    robot, warnings = next(iter(robots.values())).name, by_severity(dict.fromkeys(findings))
    result.show(fits.summary(), content, output, robot=robot, warnings=warnings)


def _robot(options: LogOptions, payloads: Sequence[str]) -> Robot:
    """Return the robot of the line with further payloads."""
    every = [*(options.payload or ()), *payloads]
    return replace(options, payload=every).robot(options.known_body)


def _payloads(
    texts: Sequence[str] | None, conditions: Mapping[str, object]
) -> dict[str, list[str]]:
    """Return {condition: its payloads}; raise BadParameter for one that has no log."""
    payloads = _by_condition(texts or (), "LINK:MASS:X,Y,Z", "--condition-payload")
    for name in payloads:
        if name not in conditions:
            message = f"'{name}' is no condition: they are {', '.join(conditions)}"
            raise typer.BadParameter(message, param_hint="--condition-payload")
    return payloads


def _by_condition(texts: Sequence[str], form: str, option: str) -> dict[str, list[str]]:
    """Return {condition: what the texts NAME=... give it}."""
    by_condition: dict[str, list[str]] = {}
    for text in texts:
        name, separator, value = text.partition("=")
        if not (name and separator and value):
            raise typer.BadParameter(f"'{text}' is not NAME={form}", param_hint=option)
        by_condition.setdefault(name, []).append(value)
    return by_condition
