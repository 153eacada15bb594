"""write_report: one self-contained HTML page with results, warnings and checks."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from seaid._files import plain, write_whole
from seaid.errors import SeaidError, checked
from seaid.identification import Identification, Validation, compared
from seaid.report.html_experiment import (
    known_rows,
    log_facts,
    motion_ranges,
    settings_facts,
    versions,
)
from seaid.report.html_maps import (
    cells_of,
    correlation_map,
    dot_chart,
    figures_of,
    packed_correlations,
    singular_values,
)
from seaid.report.html_tables import (
    base_rows,
    condition_rows,
    drive_tables,
    error_rows,
    has_white,
    residual_rows,
    term_rows,
    worst_rows,
)
from seaid.report.html_traces import Run, traces_of
from seaid.report.html_verdict import verdict, warnings_of

Fact = str | int | float


@checked(SeaidError)
def write_report(
    found: Identification,
    results: Validation | Iterable[Validation],
    path: str | Path,
    *,
    facts: Mapping[str, Fact] | None = None,
) -> None:
    """Write the report of an identification as one HTML file that opens offline.

    The page has a verdict, warnings, tables with confidence intervals, checks, interactive traces
    with residual and spectrum, figures, singular values, correlations and versions. Its size is
    below 6 MB for any logs; traces are thinned if necessary, and the page says so.

    Parameters
    ----------
    found : Identification
    results : Validation or iterable of Validation
        Validations on motions that were not used for identification. For an empty list the page
        says that there is no validation.
    path : path
        The file to write, ending in .html.
    facts : dict, optional
        Experiment metadata {name: text or number}, as seeds, files, people and places.

    Raises
    ------
    SeaidError
        For another suffix, results that are not validations of this robot, invalid facts, and if
        the file cannot be written.

    Examples
    --------
    >>> checked = seaid.validate(result, seaid.read_log("other.csv", robot))
    >>> seaid.write_report(result, checked, "report.html", facts={"place": "Eindhoven"})
    """
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise SeaidError(f"a report is an HTML page: '{path}' must end in .html")
    runs = runs_of(found, _checked(found, results))
    page = _page(found, runs, _checked_facts(facts or {}))
    write_whole(path, page)


def runs_of(found: Identification, results: Sequence[Validation]) -> list[Run]:
    """Return all motions of a page: those used for identification, then the validations."""
    own = [compared(found, motion) for motion in found.motions]
    runs = [Run(_name("own log", place, own), one, False) for place, one in enumerate(own)]
    for place, result in enumerate(results):
        seen = any(_same(result, one) for one in own)
        name = _name("validation", place, results)
        runs.append(Run(name, result, not seen))
    return runs


def _name(kind: str, place: int, every: Sequence[Any]) -> str:
    return f"{kind} {place + 1}" if len(every) > 1 else kind


def _same(one: Validation, other: Validation) -> bool:
    """Return whether two validations are of the same motion."""
    return one.load.measured.shape == other.load.measured.shape and all(
        np.allclose(a, b, rtol=1e-9, atol=0, equal_nan=True)
        for a, b in (
            (one.time, other.time),
            (one.actuator.measured, other.actuator.measured),
            (one.load.measured, other.load.measured),
        )
    )


def _checked(found: Identification, results: Validation | Iterable[Validation]) -> list[Validation]:
    every = [results] if isinstance(results, Validation) else list(results)
    for one in every:
        if not isinstance(one, Validation):
            raise SeaidError(f"results= must be Validations, found {type(one).__name__}")
        if one.joints != found.robot.joint_names:
            raise SeaidError(
                f"results: a validation of the joints {', '.join(one.joints)}, but the identified "
                f"robot '{found.robot.name}' has {', '.join(found.robot.joint_names)}: validate "
                "the identification of the report"
            )
    return every


def _checked_facts(facts: Mapping[str, Fact]) -> list[tuple[str, str]]:
    for name, value in facts.items():
        if not isinstance(name, str) or not isinstance(value, str | int | float | np.number):
            raise SeaidError(
                f"facts= must be {{name: text or number}}, found {name!r}: {type(value).__name__}"
            )
    return [(name, str(value)) for name, value in facts.items()]


def _page(found: Identification, runs: Sequence[Run], facts: list[tuple[str, str]]) -> str:
    """Return the page as text."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("seaid.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(
        robot=found.robot.name,
        **_parameters(found),
        **_experiment(found, facts),
        **_motions(found, runs),
        heads=_heads,
        asset=_asset,
    )


def _parameters(found: Identification) -> dict[str, Any]:
    """Return the template values of the estimates."""
    return {
        "drives": drive_tables(found),
        "base": base_rows(found),
        "has_white": has_white(found),
        "feasible": found.feasible,
        "terms": term_rows(found),
        "residuals": residual_rows(found),
        "conditions": condition_rows(found),
        "singular": _singular(found),
        "correlations": _correlations(found),
    }


def _experiment(found: Identification, facts: list[tuple[str, str]]) -> dict[str, Any]:
    """Return the template values of data, settings and experiment."""
    return {
        "cutoff": f"{found.cutoff_hz:.3g}",
        "logs": log_facts(found),
        "used": settings_facts(found),
        "known": known_rows(found),
        "reached": motion_ranges(found),
        "facts": facts,
        "versions": versions(),
    }


def _motions(found: Identification, runs: Sequence[Run]) -> dict[str, Any]:
    """Return the template values of the motions, and the verdict."""
    warnings, errors = warnings_of(found, runs), error_rows(found, runs)
    traces = traces_of(found, runs)
    pictured = ([run for run in runs if run.is_unseen] or list(runs))[:1]
    return {
        "verdict": verdict(found, runs, warnings),
        "warnings": warnings,
        "errors": worst_rows(errors),
        "all_errors": len(errors),
        "pictures": [picture for run in pictured for picture in figures_of(run)],
        "pictured": [run.name for run in pictured],
        "has_own": bool(found.motions),
        "has_runs": bool(runs),
        "traces": _as_json(traces),
        "without_traces": len(runs) - len(traces["runs"]),
    }


def _heads(first: str, white: bool) -> list[str]:
    """Return the header of a parameter table, with or without errors for white noise."""
    textbook = ["S.e. if white"] if white else []
    return [first, "Value", "Std. error", "95 % interval", "Unit", "Relative s.e.", "", *textbook]


def _singular(found: Identification) -> dict[str, Any] | None:
    values = singular_values(found)
    if values is None:
        return None
    return {
        "chart": dot_chart(values),
        "condition": f"{1 / values.shares[-1]:.3g}",
        "combinations": values.combinations,
        "threshold": f"{values.threshold:g}",
    }


def _correlations(found: Identification) -> dict[str, Any]:
    shown = correlation_map(found)
    return {
        "map": shown,
        "cells": cells_of(shown),
        "strongest": [(one, other, f"{value:+.2f}") for one, other, value in shown.strongest],
        "data": _as_json({"names": shown.names, "data": packed_correlations(shown)}),
    }


def _as_json(content: Any) -> Any:
    """Return JSON that is safe inside a <script>: without '<', '>', '&' and NaN."""
    from markupsafe import Markup

    text = json.dumps(plain(content), allow_nan=False, separators=(",", ":"))
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)


def _asset(name: str) -> Any:
    """Return a file of the page verbatim: style, script, or the chart library."""
    from markupsafe import Markup

    return Markup((files("seaid.report") / "page" / name).read_text(encoding="utf-8"))
