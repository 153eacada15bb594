"""Command identify: from logs to parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from seaid.cli.options import (
    FEASIBLE,
    VERBOSE,
    FailOn,
    IdentifyOptions,
    Logs,
    Output,
    ResultOptions,
    check_fail_on,
)

PIECES = "Read logs with the column names of seaid in pieces: they may be larger than memory."


def identify(
    options: IdentifyOptions,
    logs: Logs,
    *,
    in_pieces: Annotated[bool, Option("--in-pieces", help=PIECES)] = False,
    feasible: Annotated[bool, Option("--feasible", help=FEASIBLE)] = False,
    verbose: Annotated[bool, Option("--verbose", "-v", help=VERBOSE)] = False,
    output: Output = Path("parameters.json"),
    fail_on: FailOn = None,
    result: ResultOptions,
) -> None:
    """Identify drives and bodies from one log or several.

    Of the files only geometry, ratios, radii, rotor inertias and the parameters named as known are
    used; other numbers are nominal. The first line says whether to use the result. Then follow the
    warnings with their remedies ('!' wrong, '?' doubtful, '-' for information), the drives with
    their nominal values, and how much of the torque of each joint is unexplained. An output
    that ends in .npz is the whole result, for --run of other commands.

    seaid identify leg.urdf run.csv --drives leg.toml --payload foot:2.0:0.15,0,0
    seaid identify arm.urdf a.csv b.csv --drives arm.toml --method simultaneous -o arm.json
    seaid identify arm.urdf bag/ --description arm_log.toml --estimator huber
    seaid identify leg.urdf run.csv --drives leg.toml -o leg.npz
    seaid identify arm.urdf day.parquet --drives arm.toml --in-pieces
    """
    if in_pieces and (options.repair or options.description or options.find_contacts):
        raise typer.BadParameter(
            "logs that are read in pieces are not changed: no --repair, no --description, no "
            "--find-contacts",
            param_hint="--in-pieces",
        )
    check_fail_on(fail_on)
    result.check(output, read=(*options.files, *logs))
    robot = options.robot(options.known_body)
    known = logs if in_pieces else options.logs(logs, robot)
    fit = options.identify(robot, known, feasible=feasible)
    recorded = options.recorded(logs, in_pieces=in_pieces, feasible=feasible)
    files = (*options.files, *logs)
    result.show_identification(
        fit, robot, output, read=files, options=recorded, verbose=verbose, fail_on=fail_on
    )
