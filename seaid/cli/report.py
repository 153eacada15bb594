"""Command report: identification and validation as one HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import seaid
from seaid.cli.kinds import JsonFile, LogFile, Page
from seaid.cli.messages import written
from seaid.cli.options import (
    IdentifiedOptions,
    ResultOptions,
    check_validation_logs,
    judgement_of,
    refuse,
)
from seaid.cli.project import is_typed


def report(
    options: IdentifiedOptions,
    *,
    output: Page = Path("report.html"),
    validation: list[LogFile] | None = None,
    multisine: list[LogFile] | None = None,
    plan: JsonFile | None = None,
    feasible: bool = False,
    result: ResultOptions,
) -> None:
    """Identify, validate, and write the results with their reliability as one HTML page.

    The page opens offline in any browser: verdict and flags, tables with confidence intervals,
    zoomable traces, checks, and the conditions of the experiment. Without --validate the report has
    no validation section and says so. With --multisine it has measured and
    computed frequency responses.

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
    unseen = validation or []
    check_validation_logs(unseen, options.from_logs)
    if not multisine:
        refuse("a plan needs its --multisine", "plan")
    result.check(output, read=(*options.files, *unseen, *(multisine or ()), plan))
    run = options.identified_run(feasible=feasible)
    fit = run.identification
    facts = seaid.project.facts_of(run.provenance)
    results, replays = dict(run.validations), list(run.replays.values())
    # --validate replaces the validations of a saved run, and the notes on its logs.
    if is_typed("validation") or not results:
        facts |= _facts_of_tests(unseen)
        results, replays = _tested(options, fit, unseen)
    response = _response(options, fit, multisine, plan) if multisine else None
    every = list(results.values())
    notes = () if is_typed("validation") else run.provenance.get("notes", ())
    more: dict[str, Any] = {"replays": replays, "frequency": response, "notes": notes}
    written(output, ".html", lambda file: seaid.write_report(fit, file, every, facts=facts, **more))
    content = {"validations": [test.to_dict() for test in every]}
    judged = judgement_of(fit, *every, *replays)
    text = [
        f"{fit.robot.name}: {judged['verdict'].sentence}",
        *seaid.report.warning_lines(judged["warnings"]),
    ]
    result.show("\n".join(text), content, output, **judged)


def _facts_of_tests(unseen: Sequence[Path]) -> dict[str, str]:
    """Return the logs that the model was validated on, as facts {name: text}."""
    origin = seaid.project.provenance_of(unseen, {}, ())
    facts = seaid.project.facts_of({"inputs": origin["inputs"]})
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
