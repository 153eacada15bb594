"""Command refine: maximum likelihood of both sides, by output error."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from seaid.cli.messages import is_terminal
from seaid.cli.options import (
    VERBOSE,
    FailOn,
    IdentifyOptions,
    Logs,
    Output,
    ResultOptions,
    Run,
    check_fail_on,
)


def refine(
    options: IdentifyOptions,
    logs: Logs,
    *,
    run: Run = None,
    iterations: Annotated[int, Option(help="Iteration limit of Gauss-Newton.")] = 20,
    verbose: Annotated[bool, Option("--verbose", "-v", help=VERBOSE)] = False,
    output: Output = Path("parameters.json"),
    fail_on: FailOn = None,
    result: ResultOptions,
) -> None:
    """Refine an identification to the maximum-likelihood estimate of both sides at once.

    The logs are identified first, or a run is loaded. From there output error simulates the joints
    behind springs, and fits encoders and torques at once; it needs joints with springs. The result
    of the start is kept if it predicts the logs better. The output is that of identify.

    seaid refine leg.urdf run.csv --drives leg.toml -o refined.json
    seaid refine leg.urdf run.csv --drives leg.toml --encoder-offset-std 0.01
    seaid refine run.csv --run runs/latest
    """
    from seaid.identification import refine as refined

    check_fail_on(fail_on)
    result.check(output, read=(*options.files, *logs))
    saved = options.saved(run, "logs")
    robot = options.robot(options.known_body) if saved is None else saved.identification.known
    read = options.logs(logs, robot)
    fit = refined(
        options.identify(robot, read) if saved is None else saved.identification,
        read,
        encoder_offset_std=options.encoder_offset_std,
        iterations=iterations,
        progress=is_terminal(),
    )
    recorded = options.recorded(logs, iterations=iterations, run=run)
    if saved is not None:
        # How the start was identified is in its run; the refinement itself has only these options.
        of_refinement = ("logs", "run", "encoder_offset_std", "iterations")
        kept = {name: recorded[name] for name in of_refinement}
        recorded |= {**saved.provenance.get("options", {}), **kept}
    files = (*options.files, *logs)
    result.show_identification(
        fit, robot, output, read=files, options=recorded, verbose=verbose, fail_on=fail_on
    )
