"""Tables in text: parameters with standard errors, checks, validation, sensors, terms."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from io import StringIO
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._progress import counted, field_texts
from seaid.drives import ParameterName
from seaid.errors import Finding
from seaid.report import tables
from seaid.report.formats import Column, Measured, Table, cut, number, percent, table_of
from seaid.report.html_charts import Run

if TYPE_CHECKING:
    from seaid.estimation import Estimate
    from seaid.excitation import Excitation, ExcitationMeasures
    from seaid.frequency import FrequencyResponse
    from seaid.identification import (
        Conditions,
        FeasibleParameters,
        Identification,
        SetupCheck,
        StaticCalibration,
        TermComparison,
        TermSelection,
        Validation,
    )
    from seaid.log import Log, Processing
    from seaid.regressor import BaseParameters, CrossCheck, Identifiability
    from seaid.report.comparison import Comparison
    from seaid.robot import DependentJoint, Robot
    from seaid.simulation import ReplayComparison


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return an aligned table, the first column left-aligned, the others right-aligned."""
    from rich import box
    from rich.console import Console
    from rich.table import Table as Drawing

    drawn = Drawing(box=box.SIMPLE_HEAD)
    for position, name in enumerate(header):
        drawn.add_column(name, justify="right" if position else "left", no_wrap=True)
    for row in rows:
        drawn.add_row(*row)
    text = StringIO()
    Console(file=text, width=400, markup=False, emoji=False).print(drawn)
    return "\n".join([title, *(line.rstrip() for line in text.getvalue().splitlines())])


def table_text(made: Table, title: str = "") -> str:
    """Return a table of a result as text, with another title than its own if it is given."""
    return table(title or made.title, *made.texts)


def named_table(name: str, rows: Iterable[Sequence[Any]]) -> str:
    """Return a table of `tables.toml` with a value per column in each row as text."""
    return table_text(table_of(name, rows))


def fields_table(data: Any) -> str:
    """Return the fields of an object that differ from their defaults."""
    return table(repr(data), ["field", "value"], [[*row] for row in field_texts(data)])


def robot_table(robot: Robot) -> str:
    """Return joints, drives and bodies of a robot."""
    from seaid.log.base_log import moving_base

    kinds = [
        (
            *(joint, is_prismatic),
            f"{'series elastic' if drive.is_elastic else 'stiff'}, ratio {number(drive.ratio)}",
        )
        for joint, is_prismatic, drive in zip(
            robot.joint_names, robot.is_prismatic, robot.drives.values(), strict=True
        )
    ]
    kinds += [(x.name, x.is_prismatic, _mimic_text(x)) for x in robot.dependent_joints]
    rows = [
        (name, "prismatic" if slides else "revolute", drive, body, mass)
        for (name, slides, drive), body, mass in zip(
            kinds, robot.body_names, robot.parameters[::10], strict=False
        )
    ]
    if not robot.base_is_held:
        kind = "free" if moving_base(robot).normal is None else "planar"
        rows.append(("", kind, "", moving_base(robot).link, robot.parameters[-10]))
    return table_text(table_of("robot", rows), repr(robot))


def _mimic_text(joint: DependentJoint) -> str:
    offset = f" {joint.offset:+.4g}" if joint.offset else ""
    return f"mimics: {joint.multiplier:.4g} {joint.leader}{offset}"


def log_table(log: Log) -> str:
    """Return the range of each sensor of a log."""
    rows = [(name, x.min(), x.max(), x.std()) for name, x in log.columns().items()]
    return table_text(table_of("sensors", rows), repr(log))


def estimate_table(estimate: Estimate) -> str:
    """Return the parameters of an estimate with standard errors."""
    made = tables.load_table(estimate, head="parameter")
    return table_text(made, counted(len(made.rows), "parameter"))


def frequency_table(found: FrequencyResponse) -> str:
    """Return resonances, damping and springs of elastic joints, and the noise of the response."""
    # (F, n, n) -> (F, n): each joint's angle over its own motor torque.
    size = np.abs(np.einsum("fii->fi", found.response))
    parts = [np.einsum("fii->fi", std) / size for std in (found.noise_std, found.total_std)]
    quality = zip(found.joints, *(np.median(part, axis=0) for part in parts), strict=True)
    made = [tables.response_table(found), table_of("quality", quality)]
    return "\n".join([repr(found), *map(table_text, made), *warning_lines(found.warnings)])


def base_table(base: BaseParameters) -> str:
    """Return the base parameters as combinations of standard ones."""
    title = f"{counted(len(base.columns), 'base parameter')} (singular-value gap {base.gap:.2g})"
    return table(title, ["combination"], [[text] for text in base.expressions])


def cross_check_text(check: CrossCheck) -> str:
    """Return the comparison of numeric and exact base parameters in a sentence."""
    return (
        f"{check.counts[0]} base parameters numerically, {check.counts[1]} exactly; largest "
        f"difference of groupings {check.max_difference:.2g}, gap {check.gap:.2g}: "
        f"{'they agree' if check.agree else 'they differ'}"
    )


def excitation_table(plan: Excitation) -> str:
    """Return the criterion of a planned motion and the expected standard errors."""
    rows = zip(plan.names, plan.standard_errors.tolist(), plan.units, strict=True)
    made = table_text(table_of("excitation", rows))
    return "\n".join([repr(plan), *condition_lines(plan), made])


def condition_lines(plan: Excitation) -> list[str]:
    """Return the condition numbers and the D-value of a planned motion in three lines."""
    # Singular values fall: the first over the last is the condition number (16).
    ends = [values[[0, -1]] for values in (plan.start_singular_values, plan.singular_values)]
    first, last = (pair[0] / pair[1] if pair[1] > 0 else np.inf for pair in ends)
    return [
        f"condition number of the scaled columns: random start {first:.4g}, planned {last:.4g}",
        f"condition number of {counted(len(plan.base.columns), 'base column')}: "
        f"{plan.condition_number:.4g}",
        f"condition number of {measure_text(plan.measures)}",
    ]


def drive_table(title: str, identification: Identification, known: Robot | None = None) -> str:
    """Return Table 1 of the paper: drive parameters with standard errors, and known values."""
    return table_text(tables.drive_table(identification, known), title)


def load_table(title: str, identification: Identification, truth: Robot | None = None) -> str:
    """Return the base parameters with standard errors, and true values if `truth` is given.

    Long groupings are shortened; `parameters.json` has them in full.
    """
    true = None if truth is None else identification.base.project(truth.parameters)
    return table_text(tables.load_table(identification.load, true), title)


def identification_table(found: Identification) -> str:
    """Return the summary of an identification: verdict, warnings, parameters and checks."""
    return "\n".join([*verdict_text(found), *_details(found, drive_table("Drives", found))])


def short_text(found: Identification, nominal: Robot, details: bool = False) -> str:
    """Return verdict, warnings, drives next to their nominal values, and the fit of each joint.

    With `details` base parameters, processing and checks follow.
    """
    parts = _verdict_lines(found)
    if found.drives:
        parts.append(drive_table("Drives", found, nominal))
    parts += [*_fit_tables(found), *_tables_if_any(tables.whole_body_table(found))]
    return "\n".join([*parts, *(_details(found) if details else [_sources_text(found)])])


def _details(identification: Identification, *drives: str) -> list[str]:
    return [
        _sources_text(identification),
        *_processing_text(identification),
        f"method: {method_text(identification)}",
        *(f"constants: {text}" for text in exact_text(identification)),
        *drives,
        *_tables_if_any(tables.shared_table(identification)),
        *_tables_if_any(*[tables.whole_body_table(identification)] * bool(drives)),
        load_table("Base parameters", identification),
        checks_table(identification),
        *map(feasible_text, [] if identification.feasible is None else [identification.feasible]),
    ]


def _tables_if_any(*made: Table) -> list[str]:
    """Return tables as text, without those that have no rows."""
    return [table_text(x) for x in made if x.rows]


def _sources_text(identification: Identification) -> str:
    joints, count = ", ".join(identification.model.torque_joints), len(identification.load.values)
    source = f"the torques at {joints}" if joints else "the forces on the base"
    bodies = f"{counted(count, 'base parameter')} from {source}" if count else "bodies as given"
    return f"{identification.robot.name}: {bodies}; cutoff {identification.cutoff_hz:.3g} Hz"


_MOST_NOTES = 4
"""Notes of one code, without a remedy, that a summary shows."""

_MARKS = {"wrong": "!", "doubtful": "?", "note": "-"}


def warning_lines(warnings: Sequence[Finding]) -> list[str]:
    """Return a line per warning with its code, and one with its remedy.

    Of notes without a remedy the first ones of each code are shown, and the others counted. The
    last line names the places where the codes of doubts and mistakes are explained.
    """
    lines, notes = [], Counter[str]()
    for finding in warnings:
        if finding.severity == "note" and not finding.remedy:
            notes[finding.code] += 1
            if notes[finding.code] > _MOST_NOTES:
                continue
        lines.append(f"{_MARKS[finding.severity]} {finding.code}: {finding.message}")
        lines += textwrap.indent(finding.remedy, "    ").splitlines()
    more = notes - Counter(dict.fromkeys(notes, _MOST_NOTES))
    lines += [f"- {code}: {counted(n, 'more note')} like these" for code, n in more.items()]
    codes = dict.fromkeys(one.code for one in warnings if one.severity != "note")
    places = ", ".join(f"report.html#about-{code}" for code in codes)
    return [*lines, f"Causes and advice: {places}, or the page of warnings"] if codes else lines


def verdict_text(identification: Identification) -> list[str]:
    """Return the verdict, the warnings, and per joint how much of its torque is unexplained."""
    return [*_verdict_lines(identification), *_fit_tables(identification)]


def _verdict_lines(identification: Identification) -> list[str]:
    verdict = f"{identification.robot.name}: {identification.verdict.sentence}"
    return [verdict, *warning_lines(identification.warnings)]


def _fit_tables(identification: Identification) -> list[str]:
    """Return the table of the unexplained torques, if there is one."""
    rows = [
        (joint, fit.own, fit.blocks, fit.motor, fit.identified, fit.nominal)
        for joint, fit in identification.joint_fits.items()
    ]
    return [table_text(table_of("fits", rows)), *_residual_text(identification)] if rows else []


def _residual_text(result: Identification) -> list[str]:
    """Return the residual of all joints together, if it is known."""
    fitted, blocks = result.residual
    if np.isnan(fitted):
        return []
    more = "" if np.isnan(blocks) else f", {percent(blocks)} in excluded blocks"
    of = "torques of all joints" if result.model.torque_joints else "forces and moments of the base"
    return [(f"Residual over the {of} (norms): {percent(fitted)} in the own logs{more}")]


def setup_table(found: SetupCheck) -> str:
    """Return the numbers of a check of the set-up, and its warnings."""
    made = tables.setup_table(found.joints)
    nothing = [] if found.warnings else ["nothing contradicts the set-up"]
    if made.rows and not np.any(np.isfinite([row[2:6] for row in made.rows])):
        nothing = [*nothing, "no torque in N m and no second encoder of a joint was compared"]
    return "\n".join([*_tables_if_any(made), *warning_lines(found.warnings), *nothing])


def has_holes(processing: Sequence[Processing]) -> bool:
    """Return whether a log has holes in time, so that its stretches were processed separately."""
    from seaid.log.usable_parts import HOLES

    return any(repair.kind == HOLES for entry in processing for repair in entry.repairs)


def _processing_text(identification: Identification) -> list[str]:
    """Return one line on the processing of the first log and the number of logs."""
    others = len(identification.processing) - 1
    kind = "stretches" if has_holes(identification.processing) else "logs"
    more = f" (first of {others + 1} {kind})" if others > 0 else ""
    return [f"processing{more}: {processing}" for processing in identification.processing[:1]]


_METHODS = {
    "simultaneous": "simultaneous: both sides of the springs at once",
    "two-step": "two-step: the springs, then the load",
}

_ESTIMATORS = {
    "ols": "ordinary least squares (ols)",
    "wls": "least squares weighted per joint (wls)",
    "huber": "Huber's M-estimate (huber)",
    "tukey": "Tukey's M-estimate (tukey)",
    "iv": "instrumental variables (iv)",
    "output-error": "the least output error of a simulation, from that of identify",
}


def method_text(identification: Identification) -> str:
    """Return the method of an identification with its estimator, and the reason for two steps."""
    reason, by = identification.not_shared, f"by {_ESTIMATORS[identification.estimator]}"
    if not identification.springs:
        return by
    return f"{_METHODS[identification.method]}, {by}" + (f", since {reason}" if reason else "")


def exact_text(identification: Identification) -> list[str]:
    """Return one line on the constants whose tolerances are in no standard error, if any."""
    option = ",".join(f"{name}={std:g}" for name, std in identification.exact_constants.items())
    return [f"taken as exact; to include typical tolerances: --known-std {option}"] * bool(option)


def checks_table(identification: Identification) -> str:
    """Return the checks of the model: optional terms, residuals and condition numbers.

    The data support a term whose BIC difference is above zero. A low-pass filter correlates the
    residual even of a complete model; the standard errors account for that.
    """
    checks = (tables.term_table, tables.residual_table, tables.condition_table)
    made = _tables_if_any(*(table_of_checks(identification) for table_of_checks in checks))
    poorly = [
        f"! {x}" for checks in identification.checks.values() for x in checks.poorly_determined
    ]
    return "\n".join([*made, *poorly])


def feasible_text(feasible: FeasibleParameters) -> str:
    """Return the summary of the physically consistent parameters."""
    lines = [
        f"physically consistent parameters: chi-square {feasible.chi_square:.3g} over "
        f"{counted(len(feasible.values), 'value')} (at least {feasible.nearest_chi_square:.3g}); "
        f"weight of the prior {feasible.weight:.2g}, {feasible.freedom:.1f} determined by the data",
        *(f"  active bound: {text}" for text in feasible.active_bounds),
        *(f"  {note}" for note in feasible.notes),
    ]
    return "\n".join(lines)


def validation_table(result: Validation) -> str:
    """Return relative errors by side and joint: below the cutoff, and unfiltered.

    If samples at standstill do not count, also the share of those that do, and the error of all.
    """
    run = Run(name="", result=result, is_unseen=False)
    joints = tables.error_rows([run])
    made = tables.error_table([*joints, *tables.whole_rows(run)])
    nothing = "Unseen motion: no joint has a torque that could be compared"
    contacts = tables.contact_tables([Run(name="motion", result=result, is_unseen=False)])
    return "\n".join(
        [
            *([] if joints else [nothing]),
            *_tables_if_any(made),
            *(table_text(x, x.caption) for x in contacts),
            *warning_lines(result.warnings),
        ]
    )


def replay_table(result: ReplayComparison) -> str:
    """Return the errors of the replays by two models by joint, and those over the noise."""
    length = float(result.time[-1] - result.time[0])
    title = f"Replay of {length:.4g} s by nominal (before) and identified (after) model"
    errors = table_text(tables.replay_error_table(result), title)
    return "\n".join([errors, *warning_lines(result.warnings)])


def comparison_table(result: Comparison) -> str:
    """Return the parameters of two identifications side by side, with their differences."""
    tests = [
        f"{group_name(group)} as a whole: chi-square "
        f"{number(test.chi_square)} for {counted(test.freedom, 'parameter')}, p {test.p_value:.2g}"
        for group, test in result.groups.items()
    ]
    only = [
        f"only in {name}: {', '.join(map(cut, parameters))}"
        for name, parameters in zip(result.names, result.only, strict=True)
        if parameters
    ]
    made = table_text(tables.difference_table(result))
    return "\n".join([made, *tests, *only, result.sentence])


def measure_text(measures: ExcitationMeasures) -> str:
    """Return the condition number of columns of unit norm, and the D-value."""
    drives = ", drives included" if measures.has_drives else ""
    return (
        f"{counted(measures.parameters, 'column')} of unit norm{drives}: "
        f"{measures.scaled_condition_number:.4g}; D-value {measures.d_value:.4g}"
    )


def measure_lines(names: Sequence[str], every: Sequence[ExcitationMeasures]) -> list[str]:
    """Return the measures of motions, and the D-efficiency of the first over each other one."""
    lines = [
        f"motion of {name}: condition number of {measure_text(measures)}"
        for name, measures in zip(names, every, strict=False)
    ]
    lines += [
        f"D-efficiency of {names[0]} over {name}: {every[0].d_efficiency(measures):.4g}"
        for name, measures in zip(names[1:], every[1:], strict=False)
    ]
    return lines


def group_name(group: str) -> str:
    """Return the name of the parameters of a drive, or of the base parameters."""
    return "base parameters" if group == "load" else f"drive of {group}"


_WIDTH = 100
"""Characters of a line."""


def sensors_table(found: Identifiability) -> str:
    """Return the parameters identifiable individually, in combination, up to scale, or not."""
    return "\n".join(_sensor_lines(found))


def _sensor_lines(analysis: Identifiability) -> Iterator[str]:
    grouped = sum(map(len, analysis.ratios))
    yield (
        f"{analysis.robot_name}: {counted(len(analysis.names), 'parameter')}, of which the sensors "
        f"determine {counted(analysis.rank, 'combination')}"
    )
    for joint, sentences in analysis.usable.items():
        yield from _wrapped(
            f"{joint} ({', '.join(analysis.sensors[joint]) or 'no sensor'}): ", sentences
        )
    yield from _list(f"Individually: {len(analysis.identifiable)}", analysis.identifiable)
    yield from _list(f"In combination: {len(analysis.combinations)}", analysis.combinations, "\n")
    for group in analysis.ratios:
        yield from _list(f"Up to scale: {len(group)}", group, "\n")
    yield from _list(f"Unidentifiable: {len(analysis.unidentifiable)}", analysis.unidentifiable)
    every = counted(len(analysis.base.names), "combination")
    agree = "agree" if analysis.agree else "do NOT agree"
    yield (
        f"{every}, {grouped} of them in {counted(len(analysis.ratios), 'group')}; two "
        f"random draws {agree}, singular-value gap {analysis.gap:.0e}"
    )
    if analysis.derivatives is not None:
        yield from _derivative_lines(analysis.derivatives)
    for line in analysis.commands:
        yield from _wrapped("", [line])


def _derivative_lines(base: BaseParameters) -> Iterator[str]:
    alone = np.count_nonzero(base.grouping, axis=1) == 1
    yield (
        f"By derivatives of motor angle and motor torque, as identify estimates them: "
        f"{counted(len(base.columns), 'combination')}"
    )
    yield from _list(f"Individually: {alone.sum()}", tuple(compress(base.names, alone)))
    combined = tuple(compress(base.expressions, ~alone))
    yield from _list(f"In combination: {len(combined)}", combined, "\n")


def _list(title: str, items: Sequence[str], between: str = ", ") -> Iterator[str]:
    yield title
    if between == "\n":
        for item in items:
            yield from _wrapped("  ", [item])
    elif items:
        yield from _wrapped("  ", items, between)


def _wrapped(start: str, items: Sequence[str], between: str = "; ") -> list[str]:
    text = start + between.join(items)
    return textwrap.wrap(text, _WIDTH, subsequent_indent="    ", break_long_words=False)


def conditions_table(together: Conditions) -> str:
    """Return the specific parameters, whether they differ by the BIC, and the shared ones."""
    named = together.identifications
    first = next(iter(named.values()))
    rows = [
        (
            name,
            *(_condition_value(result, name) for result in named.values()),
            *(test.F, test.bic, "yes" if test.bic > 0 else "no"),
        )
        for name, test in together.differences.items()
    ]
    every = [ParameterName(x, joint) for joint, drive in first.drives.items() for x in drive.names]
    shared = [
        (name, _condition_value(first, name))
        for name in dict.fromkeys((*every, *first.load_side.names))
        if name not in together.differences
    ]
    count = str(len(named))
    common = table_text(table_of("shared by conditions", shared, count=count))
    if not rows:
        return common
    values = [Column(name, "value and error") for name in named]
    specific = table_of("conditions", (), count=count)
    columns = (specific.columns[0], *values, *specific.columns[1:])
    made = replace(specific, columns=columns, rows=tuple(rows))
    return "\n".join([table_text(made), "", common])


def _condition_value(identification: Identification, text: str) -> Measured:
    name = ParameterName.of(text)
    estimate = identification.load_side
    if name not in estimate.names and name.owner:
        estimate = identification.drives[name.owner].at(name.owner)
    return Measured(estimate.value(name), estimate.standard_error(name))


def statics_table(found: StaticCalibration) -> str:
    """Return the parameters of a calibration from statics, with rms, linearity and hysteresis."""
    made = table_text(tables.calibration_table(found), f"Calibration from statics, {found.law} law")
    lines = [
        f"rms {found.estimate.residual_std:.3g} {found.statics.load_unit} over "
        f"{counted(len(found.statics.load), 'load')}, nonlinearity {percent(found.linearity)}"
    ]
    if np.isfinite(found.hysteresis):
        lines[0] += f", hysteresis {percent(found.hysteresis)} of the range of the load"
    else:
        lines[0] += " of the range of the load; no hysteresis without loads up and down"
    lines += [f"! {finding}" for finding in found.warnings]
    return "\n".join([made, *lines])


def terms_table(selection: TermSelection) -> str:
    """Return the comparison of all candidate terms, step by step, and the recommendation."""
    rows = [_term_row(term) for term in selection.comparisons]
    notes = [f"! {_label(term)}: {term.reason}" for term in selection.comparisons if term.reason]
    made = table_text(table_of("model comparison", rows))
    return "\n".join([made, *notes, *_recommendation(selection)])


def _term_row(candidate: TermComparison) -> tuple[Any, ...]:
    gain, start = candidate.comparison, (_label(candidate), str(candidate.step + 1))
    if gain is None:
        return (*start, *["-"] * 4, "not tested")
    return (
        *(*start, gain.F, gain.bic),
        f"{percent(gain.improvement)} +- {percent(gain.improvement_std)}",
        f"{gain.better} of {gain.blocks}",
        "selected" if candidate.selected else "yes" if gain.is_supported_overall else "no",
    )


def _label(candidate: TermComparison) -> str:
    at = f" at {candidate.cutoff_hz:.3g} Hz" if candidate.cutoff_hz is not None else ""
    return f"{candidate.joint}: {candidate.field.replace('_', ' ')} {candidate.term}{at}"


def _recommendation(selection: TermSelection) -> list[str]:
    if not selection.recommended:
        return ["The data support no term in addition to those of the drives."]
    return [
        f"{joint}: add "
        + ", ".join(f"'{term}' to {field}" for field, term in terms)
        + "; identify(selection.robot, ...) estimates them"
        for joint, terms in selection.recommended.items()
    ]
