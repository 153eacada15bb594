"""Command report: identification and validation as one HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

import seaid
from seaid.cli.kinds import JsonFile, LogFile, Page
from seaid.cli.options import (
    IdentifiedOptions,
    ResultOptions,
    check_distinct,
    judgement_of,
)
from seaid.cli.project import is_typed


def report(
    options: IdentifiedOptions,
    *,
    output: Page = Path("report.html"),
    validation: tuple[LogFile, ...] = (),
    multisine: tuple[LogFile, ...] = (),
    plan: JsonFile | None = None,
    feasible: bool = False,
    result: ResultOptions,
) -> None:
    """Identify, validate, and write the results with their reliability as one HTML page.

    The page opens offline in any browser: verdict and flags, tables with confidence intervals,
    zoomable traces, checks, and the conditions of the experiment. Without --validate the report has
    no validation section and says so. With --multisine it has measured and computed frequency
    responses.

    Parameters
    ----------
    output
        The page to write.
    validation
        Another log, to validate on.
    multisine
        Log of a multisine: frequency responses.
    plan
        The plan that --multisine followed.

    Examples
    --------
    seaid report leg.urdf --from run.csv --validate other.csv --drives leg.toml -o report.html
    seaid report arm.urdf --from a.csv --from b.csv --validate c.csv --feasible
    seaid report --run runs/latest --validate third.csv
    seaid report --run runs/latest --multisine sine.csv --plan sine.json
    """
    check_distinct(*validation, *options.from_logs)
    if plan is not None and not multisine:
        raise click.BadParameter(
            "needs the logs that followed it, --multisine", param_hint="--plan"
        )
    result.check(output, read=(*options.files, *validation, *multisine, plan))
    run = options.identified_run(feasible=feasible)
    fit = run.identification
    facts = seaid.report.facts_of(run.provenance)
    results, replays = dict(run.validations), list(run.replays.values())
    # --validate replaces the validations of a saved run, and the notes on its logs.
    if is_typed("validation") or not results:
        facts |= _facts_of_tests(validation)
        results, replays = _tested(options, fit, validation)
    every = list(results.values())
    notes = () if is_typed("validation") else run.provenance.get("notes", ())
    response = _response(options, fit, multisine, plan) if multisine else None
    seaid.write_report(
        fit, output, every, facts=facts, replays=replays, frequency=response, notes=notes
    )
    content = {"validations": [test.to_dict() for test in every]}
    judged = judgement_of(fit, *every, *replays)
    text = [
        f"{fit.robot.name}: {judged['verdict'].sentence}",
        *seaid.report.warning_lines(judged["warnings"]),
    ]
    result.show("\n".join(text), content, output, **judged)


def _facts_of_tests(unseen: Sequence[Path]) -> dict[str, str]:
    """Return the logs that the model was validated on, as facts {name: text}."""
    origin = seaid.report.provenance_of(unseen, {}, ())
    facts = seaid.report.facts_of({"inputs": origin["inputs"]})
    return {name.replace("Input", "Validated on"): text for name, text in facts.items()}


def _tested(
    options: IdentifiedOptions, fit: seaid.Identification, paths: Sequence[Path]
) -> tuple[dict[str, seaid.Validation], list[seaid.simulation.ReplayComparison]]:
    """Return the validations by log, and the replays of a robot with position commands."""
    logs = options.logs(paths, fit.known)
    by_path = dict(zip(map(str, paths), logs, strict=True))
    validations = {path: seaid.validate(fit, log) for path, log in by_path.items()}
    if not fit.robot.has_controllers:
        return validations, []
    held = fit.unusable_joints
    return validations, [seaid.compare_replays(fit.known, fit.robot, log, held) for log in logs]


def _response(
    options: IdentifiedOptions, fit: seaid.Identification, paths: Sequence[Path], plan: Path | None
) -> seaid.frequency.FrequencyResponse:
    """Return measured and computed frequency responses of logs of a multisine."""
    logs = options.logs(paths, fit.known)
    motion = None if plan is None else seaid.load_trajectory(plan)
    return seaid.frequency_response(fit.known, logs, plan=motion, identification=fit)
