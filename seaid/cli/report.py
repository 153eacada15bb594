"""Command report: identification and validation as one HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from seaid.cli.defaults import is_typed
from seaid.cli.messages import written
from seaid.cli.options import (
    FEASIBLE,
    IdentifiedOptions,
    ResultOptions,
    check_validation_logs,
    checked_suffix,
    facts_of,
)

if TYPE_CHECKING:
    from seaid.identification import FrequencyResponse, Identification, Validation
    from seaid.simulation import ReplayComparison


def report(
    options: IdentifiedOptions,
    *,
    output: Annotated[
        Path, Option("--output", "-o", help="The page to write.", metavar="HTML")
    ] = Path("report.html"),
    validation: Annotated[
        list[Path] | None,
        Option("--validate", help="Another log, to validate on. May be repeated.", metavar="LOG"),
    ] = None,
    multisine: Annotated[
        list[Path] | None,
        Option(help="Log of a multisine: frequency responses. May be repeated.", metavar="LOG"),
    ] = None,
    plan: Annotated[
        Path | None, Option(help="The plan that --multisine followed.", metavar="JSON")
    ] = None,
    feasible: Annotated[bool, Option("--feasible", help=FEASIBLE)] = False,
    result: ResultOptions,
) -> None:
    """Identify, validate, and write the results with their reliability as one HTML page.

    The page opens offline in any browser: verdict and flags, tables with confidence intervals,
    zoomable traces, checks, and the conditions of the experiment. Without --validate the report has
    no validation section and says so. With --multisine it has measured and
    computed frequency responses.

    seaid report leg.urdf --from run.csv --validate other.csv --drives leg.toml -o report.html
    seaid report arm.urdf --from a.csv --from b.csv --validate c.csv --feasible
    seaid report --run runs/latest --validate third.csv
    seaid report --run runs/latest --multisine sine.csv --plan sine.json
    """
    from seaid.project import facts_of as origin_facts
    from seaid.project import provenance_of
    from seaid.report import warning_lines, write_report

    checked_suffix(output, ".html", ".htm")
    unseen = validation or []
    check_validation_logs(unseen, options.from_logs)
    if plan is not None and not multisine:
        raise typer.BadParameter("a plan needs its --multisine", param_hint="--plan")
    result.check(output, read=(*options.files, *unseen, *(multisine or ()), plan))
    run = options.result(feasible=feasible)
    fit = run.identification
    facts = origin_facts(run.provenance)
    results, replays = dict(run.validations), list(run.replays.values())
    if is_typed("validation") or not results:
        read = origin_facts({"inputs": provenance_of(unseen, {}, ())["inputs"]})
        facts |= {name.replace("Input", "Validated on"): text for name, text in read.items()}
        results, replays = _tested(options, fit, unseen)
    response = _response(options, fit, multisine, plan) if multisine else None
    every = list(results.values())
    with written(output, ".html") as file:
        notes = () if is_typed("validation") else run.provenance.get("notes", ())
        write_report(
            fit, file, every, facts=facts, replays=replays, frequency=response, notes=notes
        )
    content = {"validations": [test.to_dict() for test in results.values()]}
    judged = facts_of(fit, *results.values(), *replays)
    text = [f"{fit.robot.name}: {judged['verdict'].sentence}", *warning_lines(judged["warnings"])]
    result.show("\n".join(text), content, output, **judged)


def _tested(
    options: IdentifiedOptions, fit: Identification, paths: Sequence[Path]
) -> tuple[dict[str, Validation], list[ReplayComparison]]:
    """Return the validations by log, and the replays of a robot with position commands."""
    from seaid.identification import validate
    from seaid.simulation import compare_replays

    logs = options.logs(paths, fit.known)
    validations = {str(path): validate(fit, log) for path, log in zip(paths, logs, strict=True)}
    if not fit.robot.has_controllers:
        return validations, []
    held = fit.unusable_joints
    return validations, [compare_replays(fit.known, fit.robot, log, held) for log in logs]


def _response(
    options: IdentifiedOptions, fit: Identification, paths: Sequence[Path], plan: Path | None
) -> FrequencyResponse:
    """Return measured and computed frequency responses of logs of a multisine."""
    from seaid.excitation import load_trajectory
    from seaid.identification import frequency_response

    logs = options.logs(paths, fit.known)
    motion = None if plan is None else load_trajectory(plan)
    return frequency_response(fit.known, logs, plan=motion, identification=fit)
