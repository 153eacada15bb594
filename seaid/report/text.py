"""Tables in text: parameters with standard errors, checks, validation, sensors, terms."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from io import StringIO
from itertools import compress
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from seaid._progress import counted, field_texts
from seaid.drives import JointParameter
from seaid.errors import listed
from seaid.log import has_holes
from seaid.robot import BASE_ROWS

if TYPE_CHECKING:
    from seaid.checks import TermComparison
    from seaid.errors import Finding
    from seaid.estimation import Estimate, TermTest
    from seaid.excitation import Excitation, ExcitationMeasures
    from seaid.identification import (
        Conditions,
        FeasibleParameters,
        Fit,
        FrequencyResponse,
        Identification,
        SetupCheck,
        StaticCalibration,
        TermSelection,
        Validation,
    )
    from seaid.log import Log
    from seaid.regressor import BaseParameters, CrossCheck, Identifiability
    from seaid.report.comparison import Comparison
    from seaid.robot import DependentJoint, Robot
    from seaid.simulation import ReplayComparison


class Text(str):
    """A text with tables; `html` has the same content."""

    html: str

    def __new__(cls, text: str, html: str | None = None) -> Self:
        """Return the text; without `html` it is a paragraph."""
        made = super().__new__(cls, text)
        made.html = f'<div style="white-space: pre-wrap">{escape(text)}</div>'
        made.html = made.html if html is None else html
        return made

    def _repr_html_(self) -> str:
        return self.html


def joined(parts: Iterable[str]) -> Text:
    """Return texts and tables below each other."""
    texts = [part if isinstance(part, Text) else Text(part) for part in parts]
    return Text("\n".join(texts), "\n".join(part.html for part in texts))


def _html(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in HTML, aligned as in the text."""

    def row(tag: str, cells: Sequence[str]) -> str:
        sides = ["left", *["right"] * (len(cells) - 1)]
        texts = zip(sides, cells, strict=True)
        return "".join(f'<{tag} style="text-align: {s}">{escape(x)}</{tag}>' for s, x in texts)

    body = "".join(f"<tr>{row('td', cells)}</tr>" for cells in rows)
    caption = f'<caption style="text-align: left">{escape(title.strip())}</caption>'
    return (
        f"<table>{caption}<thead><tr>{row('th', header)}</tr></thead><tbody>{body}</tbody></table>"
    )


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> Text:
    """Return an aligned table, the first column left-aligned, the others right-aligned."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    drawn = Table(box=box.SIMPLE_HEAD)
    for position, name in enumerate(header):
        drawn.add_column(name, justify="right" if position else "left", no_wrap=True)
    for row in rows:
        drawn.add_row(*row)
    text = StringIO()
    Console(file=text, width=400, markup=False).print(drawn)
    lines = [title, *(line.rstrip() for line in text.getvalue().splitlines())]
    return Text("\n".join(lines), _html(title, header, rows))


def fields_table(data: Any) -> Text:
    """Return the fields of an object that differ from their defaults."""
    return table(repr(data), ["field", "value"], [[*row] for row in field_texts(data)])


def robot_table(robot: Robot) -> Text:
    """Return joints, drives and bodies of a robot."""
    rows = [
        [
            joint,
            "prismatic" if is_prismatic else "revolute",
            f"{'series elastic' if drive.is_elastic else 'stiff'}, ratio {number(drive.ratio)}",
            body,
            number(mass),
        ]
        for joint, is_prismatic, drive, body, mass in zip(
            robot.joint_names,
            robot.is_prismatic,
            robot.drives.values(),
            robot.body_names[: robot.n],
            robot.parameters[::10][: robot.n],
            strict=True,
        )
    ]
    rows += [
        [j.name, "prismatic" if j.is_prismatic else "revolute", _mimic_text(j), body, number(m)]
        for j, body, m in zip(
            robot.dependent_joints,
            robot.body_names[robot.n :],
            robot.parameters[::10][robot.n :],
            strict=False,
        )
    ]
    if robot.floating_base is not None:
        base = robot.floating_base.link
        kind = "free" if robot.floating_base.normal is None else "planar"
        rows.append(["", kind, "", base, number(robot.parameters[-10])])
    return table(repr(robot), ["joint", "type", "drive", "body", "mass [kg]"], rows)


def _mimic_text(joint: DependentJoint) -> str:
    offset = f" {joint.offset:+.4g}" if joint.offset else ""
    return f"mimics: {joint.multiplier:.4g} {joint.leader}{offset}"


def log_table(log: Log) -> Text:
    """Return the range of each sensor of a log."""
    rows = [
        [name, number(values.min()), number(values.max()), number(values.std())]
        for name, values in log.columns().items()
    ]
    return table(repr(log), ["sensor", "least", "largest", "std. deviation"], rows)


def estimate_table(estimate: Estimate) -> Text:
    """Return the parameters of an estimate with standard errors."""
    rows = [
        [cut(name), number(value), number(error), percent(error / (abs(value) or np.nan)), unit]
        for name, value, error, unit in entries(estimate)
    ]
    header = ["parameter", "estimated", "std. error", "rel.", "unit"]
    return table(counted(len(rows), "parameter"), header, rows)


def frequency_table(found: FrequencyResponse) -> Text:
    """Return resonances, damping and springs of elastic joints, and the noise of the response."""
    rows = [
        [f"{name.replace('_', ' ')} of {joint}", number(value), number(error), unit]
        for joint, estimate in found.drives.items()
        for name, value, error, unit in entries(estimate)
    ]
    header = ["parameter", "estimated", "std. error", "unit"]
    # (F, n, n) -> (F, n): each joint's angle over its own motor torque.
    size = np.abs(np.einsum("fii->fi", found.response))
    parts = [np.einsum("fii->fi", std) / size for std in (found.noise_std, found.total_std)]
    quality = [
        [joint, *(percent(float(np.median(part[:, place]))) for part in parts)]
        for place, joint in enumerate(found.joints)
    ]
    text = "Response of each motor: standard deviation, median over frequencies"
    return joined(
        [
            repr(found),
            table("Springs", header, rows),
            table(text, ["joint", "by noise", "with nonlinear distortion"], quality),
            *warning_lines(found.warnings),
        ]
    )


def base_table(base: BaseParameters) -> Text:
    """Return the base parameters as combinations of standard ones."""
    title = f"{counted(len(base.columns), 'base parameter')} (singular-value gap {base.gap:.2g})"
    return table(title, ["combination"], [[text] for text in base.expressions])


def cross_check_text(check: CrossCheck) -> Text:
    """Return the comparison of numeric and exact base parameters in a sentence."""
    return Text(
        f"{check.counts[0]} base parameters numerically, {check.counts[1]} exactly; largest "
        f"difference of groupings {check.max_difference:.2g}, gap {check.gap:.2g}: "
        f"{'they agree' if check.agree else 'they differ'}"
    )


def excitation_table(plan: Excitation) -> Text:
    """Return the criterion of a planned motion and the expected standard errors."""
    errors = zip(plan.names, plan.standard_errors.tolist(), plan.units, strict=True)
    rows = [[cut(name), number(error), unit] for name, error, unit in errors]
    header = ["parameter", "expected std. error", "unit"]
    return joined([repr(plan), *condition_lines(plan), table("Parameters", header, rows)])


def condition_lines(plan: Excitation) -> list[str]:
    """Return the condition numbers and the D-value of a planned motion in three lines."""
    # Singular values fall: the first over the last is the condition number (16).
    ends = [values[[0, -1]] for values in (plan.start_singular_values, plan.singular_values)]
    first, last = (pair[0] / pair[1] if pair[1] > 0 else np.inf for pair in ends)
    return [
        f"condition number of the scaled columns: random start {first:.4g}, planned {last:.4g}",
        f"condition number of the {len(plan.base.columns)} base columns: "
        f"{plan.condition_number:.4g}",
        f"condition number of {measure_text(plan.measures)}",
    ]


def drive_table(
    title: str,
    identification: Identification,
    known: Robot | None = None,
    compared: tuple[str, str] = ("true", "off by"),
) -> Text:
    """Return Table 1 of the paper: drive parameters with standard errors, and known values."""
    header = ["joint", "parameter", "estimated", "std. error", "rel."]
    rows = []
    for joint, estimate in identification.drives.items():
        values = {} if known is None else known.drives[joint].own_values
        for name, value, error, unit in entries(estimate):
            exact = values.get(name, np.nan)
            off = [number(exact), percent(value / exact - 1 if exact else np.nan)]
            numbers = [number(value), number(error), percent(error / (abs(value) or np.nan))]
            rows.append([joint, name, *numbers, *([] if known is None else off), unit])
    return table(title, [*header, *([] if known is None else compared), "unit"], rows)


def load_table(title: str, identification: Identification, truth: Robot | None = None) -> Text:
    """Return the base parameters with standard errors, and true values if `truth` is given.

    Long groupings are shortened; `parameters.json` has them in full.
    """
    header = ["base parameter", "estimated", "std. error", "rel."]
    true = np.full(len(identification.load.values), np.nan)
    if truth is not None:
        true = identification.base.project(truth.parameters)
    rows = []
    for exact, (name, value, error, unit) in zip(true, entries(identification.load), strict=True):
        off = [number(exact), f"{(value - exact) / error:+.1f} s.e."]
        numbers = [number(value), number(error), percent(error / (abs(value) or np.nan))]
        rows.append([cut(name), *numbers, *([] if truth is None else off), unit])
    return table(title, [*header, *([] if truth is None else ["true", "off by"]), "unit"], rows)


def identification_table(found: Identification) -> Text:
    """Return the summary of an identification: verdict, warnings, parameters and checks."""
    return joined([*verdict_text(found), *_details(found, drive_table("Drives", found))])


def short_text(found: Identification, nominal: Robot, details: bool = False) -> Text:
    """Return verdict, warnings, drives next to their nominal values, and the fit of each joint.

    With `details` base parameters, processing and checks follow.
    """
    values = {joint: drive.own_values for joint, drive in nominal.drives.items()}
    compares = any({*estimate.names} & {*values[joint]} for joint, estimate in found.drives.items())
    parts = _verdict_lines(found)
    if found.drives:
        parts.append(
            drive_table("Drives", found, nominal if compares else None, ("nominal", "change"))
        )
    parts += [*_fit_tables(found), *_whole_body_table(found)]
    return joined([*parts, *(_details(found) if details else [_sources_text(found)])])


def _details(identification: Identification, *drives: Text) -> list[str]:
    return [
        _sources_text(identification),
        *_processing_text(identification),
        *([f"method: {method_text(identification)}"] if identification.springs else []),
        *(f"constants: {text}" for text in exact_text(identification)),
        *drives,
        *(_whole_body_table(identification) if drives else []),
        load_table("Base parameters", identification),
        checks_table(identification),
        *(_feasible_text(identification.feasible) if identification.feasible is not None else []),
    ]


def _whole_body_table(identification: Identification) -> list[Text]:
    """Return the table of the mass and the centre of mass of a robot with a floating base."""
    from seaid.identification import whole_body

    rows = [
        [
            quantity.name,
            number(quantity.value) if quantity.is_determined else "not determined",
            number(quantity.standard_error) if quantity.is_determined else "",
            quantity.unit,
        ]
        for quantity in whole_body(identification)
    ]
    title = "Whole robot, in the frame of its base at the mean posture"
    return [table(title, ["", "identified", "std. error", "unit"], rows)] if rows else []


def _sources_text(identification: Identification) -> str:
    joints, count = ", ".join(identification.model.torque_joints), len(identification.load.values)
    source = f"the torques at {joints}" if joints else "the forces on the base"
    bodies = f"{count} base parameters from {source}" if count else "bodies as given"
    return f"{identification.robot.name}: {bodies}; cutoff {identification.cutoff_hz:.3g} Hz"


_MOST_NOTES = 4
"""Notes of one code, without a remedy, that a summary shows."""

_MARKS = {"wrong": "!", "doubtful": "?", "note": "-"}


def warning_lines(warnings: Iterable[Finding]) -> list[str]:
    """Return a line per warning with its code, and one with its remedy.

    Of notes without a remedy the first ones of each code are shown, and the others counted.
    """
    lines, notes = [], Counter[str]()
    for finding in warnings:
        if finding.severity == "note" and not finding.remedy:
            notes[finding.code] += 1
            if notes[finding.code] > _MOST_NOTES:
                continue
        lines.append(f"{_MARKS[finding.severity]} {finding.code}: {finding.message}")
        lines += [f"    {line}" for line in finding.remedy.splitlines()]
    more = {code: count - _MOST_NOTES for code, count in notes.items() if count > _MOST_NOTES}
    return lines + [f"- {code}: {counted(n, 'more note')} like these" for code, n in more.items()]


def verdict_text(identification: Identification) -> list[str]:
    """Return the verdict, the warnings, and per joint how much of its torque is unexplained."""
    return [*_verdict_lines(identification), *_fit_tables(identification)]


def _verdict_lines(identification: Identification) -> list[str]:
    verdict = f"{identification.robot.name}: {identification.verdict.sentence}"
    return [verdict, *_gain_lines(identification.robot), *warning_lines(identification.warnings)]


def _gain_lines(robot: Robot) -> list[str]:
    """Return a line with the controllers' gains, to which all that is identified is in proportion.

    Gains with a scale are identified themselves.
    """
    joints: dict[str, list[str]] = {}
    for joint, drive in robot.drives.items():
        law = drive.controller
        if law is not None and not law.is_up_to_scale:
            gains = {
                "K_p": law.position_gain_Nm_per_rad,
                "K_d": law.velocity_gain_Nms_per_rad,
            }
            text = ", ".join(f"{name} = {x:.4g}" for name, x in gains.items() if x)
            joints.setdefault(text, []).append(joint)
    if not joints:
        return []
    gains_text = "; ".join(f"{text} ({listed(places)})" for text, places in joints.items())
    return [
        f"gains as given, in SI units at the joints: {gains_text}. Inertias, friction and "
        "offsets are in proportion to them: if they are assumed, write is_up_to_scale = true into "
        "the controllers: known bodies may determine their scale"
    ]


def _fit_tables(identification: Identification) -> list[Text]:
    """Return the table of the unexplained torques, if there is one."""
    header = [
        "joint",
        "own logs",
        "excluded blocks",
        "motor equation",
        "identified bodies",
        "robot file",
    ]
    rows = [
        [
            joint,
            *(percent(x) for x in (fit.own, fit.blocks, fit.motor, fit.identified, fit.nominal)),
        ]
        for joint, fit in identification.joint_fits.items()
    ]
    title = "Unexplained torque, of that without its mean (rms)"
    return [table(title, header, rows), *_residual_text(identification)] if rows else []


def _residual_text(result: Identification) -> list[Text]:
    """Return the residual of all joints together, if it is known."""
    fitted, blocks = result.residual
    if np.isnan(fitted):
        return []
    more = "" if np.isnan(blocks) else f", {percent(blocks)} in excluded blocks"
    of = "torques of all joints" if result.model.torque_joints else "forces and moments of the base"
    return [Text(f"Residual over the {of} (norms): {percent(fitted)} in the own logs{more}")]


def setup_table(found: SetupCheck) -> Text:
    """Return the numbers of a check of the set-up, and its warnings."""
    header = ["joint", "swing", "encoder slope", "error by file", "by any bodies", "motor equation"]
    rows = [
        [
            joint,
            number(setup.swing),
            number(setup.encoder_slope),
            *(percent(error) for error in (setup.nominal, setup.bodies, setup.motor)),
        ]
        for joint, setup in found.joints.items()
    ]
    tables = [table("Torques that the set-up as given leaves unexplained", header, rows)]
    nothing = [] if found.warnings else ["nothing contradicts the set-up"]
    return joined([*(tables if rows else []), *warning_lines(found.warnings), *nothing])


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


def method_text(identification: Identification) -> str:
    """Return the method of an identification, with the reason for two steps if there is one."""
    reason = identification.not_shared
    return _METHODS[identification.method] + (f", since {reason}" if reason else "")


def exact_text(identification: Identification) -> list[str]:
    """Return one line on the constants whose tolerances are in no standard error, if any."""
    option = ",".join(f"{name}={std:g}" for name, std in identification.exact_constants.items())
    return [f"taken as exact; to include typical tolerances: --known-std {option}"] * bool(option)


def checks_table(identification: Identification) -> Text:
    """Return the checks of the model: optional terms, residuals and condition numbers.

    The data support a term whose BIC difference is above zero. A low-pass filter correlates the
    residual even of a complete model; the standard errors account for that.
    """
    terms: list[list[str]] = []
    residuals: list[list[str]] = []
    conditions: list[str] = []
    poorly: list[str] = []
    for side, checks in identification.checks.items():
        drive_names = f" of {side}", "actuator", f"the actuator side of {side}"
        suffix, column, name = _SIDES.get(side, drive_names)
        terms += [[term.terms[0] + suffix, *_term_numbers(term)] for term in checks.terms]
        residuals += [
            [joint, column, number(white.first), number(white.durbin_watson)]
            for joint, white in checks.whiteness.items()
        ]
        conditions.append(
            f"condition number of {name} (columns of unit norm): {checks.condition_number:.3g}"
        )
        poorly += [f"! {text}" for text in checks.poorly_determined]
    header = ["term", "residual without", "F", "BIC", "supported"]
    parts: list[str]
    parts = [table("Terms of the drives: support by the data", header, terms)] if terms else []
    if residuals:
        header = ["residual", "side", "autocorrelation", "Durbin-Watson"]
        parts.append(table("Residuals: autocorrelation at lag 1", header, residuals))
    return joined([*parts, *conditions, *poorly])


_SIDES = {"load": ("", "load", "the load side"), "both": ("", "both", "both sides")}
"""How a term, a residual and a condition number name a side of several joints."""


def _term_numbers(term: TermTest) -> list[str]:
    supported = "yes" if term.bic > 0 else "no"
    return [f"x {np.sqrt(term.growth):.3g}", number(term.F), number(term.bic), supported]


def feasible_text(found: FeasibleParameters) -> Text:
    """Return the summary of the physically consistent parameters."""
    return joined(_feasible_text(found))


def _feasible_text(feasible: FeasibleParameters) -> list[str]:
    """Return the summary of the physically consistent parameters."""
    return [
        f"physically consistent parameters: chi-square {feasible.chi_square:.3g} over "
        f"{len(feasible.values)} values (at least {feasible.nearest_chi_square:.3g}); weight of "
        f"the prior {feasible.weight:.2g}, {feasible.freedom:.1f} values determined by the data",
        *(f"  active bound: {text}" for text in feasible.active_bounds),
        *(f"  {note}" for note in feasible.notes),
    ]


def validation_table(result: Validation) -> Text:
    """Return relative errors by joint and side: below the cutoff, and unfiltered.

    If samples at standstill do not count, also the share of those that do, and the error of all.
    """
    sides = (result.actuator, result.load)
    title = "Unseen motion: relative error below the cutoff; unfiltered"
    columns = {"raw": "raw_relative_error"}
    if any(map(is_partial, np.concatenate([fit.counted_share for fit in sides]).tolist())):
        title = (
            "Unseen motion: relative error below the cutoff; share of the samples counted, those "
            "away from standstill; error at all samples; unfiltered"
        )
        columns = {"counted": "counted_share", "all": "relative_error_with_standstill", **columns}
    kinds, empty = ["relative_error", *columns.values()], ["-"] * len(columns)
    header = ["joint", "motor torque", *columns, "load torque", *columns]
    rows = _error_rows(result.joints, sides, kinds)
    whole = [percent(fit.whole_relative_error) for fit in sides]
    rows += [["all joints", whole[0], *empty, whole[1], *empty]] * (len(rows) > 1)
    if result.base is not None:
        rows += _error_rows(BASE_ROWS, [result.base], kinds, "-", *empty)
    is_empty = all(np.all(np.isnan(fit.measured)) for fit in sides)
    nothing = Text("Unseen motion: no joint has a torque that could be compared")
    tables = [nothing if is_empty else table(title, header, rows), *_contact_tables(result)]
    return joined([*tables, *warning_lines(result.warnings)])


def _error_rows(
    names: Sequence[str], sides: Sequence[Fit], kinds: Sequence[str], *start: str
) -> list[list[str]]:
    """Return a row for each name: its `start`, and its errors of these kinds on each side."""
    columns = [getattr(fit, kind) for fit in sides for kind in kinds]
    return [
        [name, *start, *(percent(column[place]) for column in columns)]
        for place, name in enumerate(names)
    ]


def is_partial(share: float) -> bool:
    """Return whether a share is visibly less than all."""
    return bool(np.isfinite(share)) and percent(share) != percent(1.0)


def _contact_tables(result: Validation) -> list[Text]:
    """Return the table of the contact forces of a robot with a floating base."""
    forces = result.contacts
    if forces is None:
        return []
    header = ["contact", "parameters", "measured", "error", "", "normal", "least", "std. error"]
    names = ("rms_force", "rms_error", "mean_normal", "least_normal", "standard_error")
    rows = []
    for place, link in enumerate(forces.links):
        rms, error, *normal = (number(getattr(forces, name)[place]) for name in names)
        relative = percent(forces.relative_error[place])
        used = f"{forces.friction_used[place]:.2f}"
        rows.append([link, forces.basis[place], rms, error, relative, *normal, used])
    title = "Contact forces [N]: measured (rms) and error; predicted normal force; friction used"
    sums = (forces.vertical, forces.measured_vertical, forces.weight)
    texts = ("sum of the predicted normal forces {} N", "of the measured ones {} N", "weight {} N")
    known = [text.format(number(x)) for text, x in zip(texts, sums, strict=True) if np.isfinite(x)]
    return [table(title, [*header, "friction"], rows), Text(", ".join(known))]


def replay_table(result: ReplayComparison) -> Text:
    """Return the errors of the replays by two models by joint, and those over the noise."""
    header = ["joint", "mean abs before", "after", "rms before", "after", "after/noise", "unit"]
    errors = (*result.mean_absolute_errors, *result.rms_errors)
    rows = [
        [
            joint,
            *(f"{1e3 * error[index]:.3g}" for error in errors),
            f"{errors[3][index] / result.noise[index]:.2g}" if result.noise[index] > 0 else "-",
            "mm" if result.is_prismatic[index] else "mrad",
        ]
        for index, joint in enumerate(result.joints)
    ]
    means = result.mean_errors
    if len(result.joints) > len(means):
        for unit, mean in means.items():
            start, end = ("all joints", "") if len(means) == 1 else (_ALL[unit], unit)
            rows.append([start, *(f"{1e3 * error:.3g}" for error in mean), "", end])
    length = float(result.time[-1] - result.time[0])
    title = f"Replay of {length:.4g} s by nominal (before) and identified (after) model"
    return joined([table(title, header, rows), *warning_lines(result.warnings)])


_ALL = {"mrad": "all revolute joints", "mm": "all prismatic joints"}


def comparison_table(result: Comparison) -> Text:
    """Return the parameters of two identifications side by side, with their differences."""
    first, second = result.names
    header = ["parameter", first, second, "change", "", "std. error", "change/s.e.", "p", "unit"]
    rows = [
        [
            cut(difference.text),
            f"{number(difference.first)} +- {difference.first_error:.2g}",
            f"{number(difference.second)} +- {difference.second_error:.2g}",
            number(difference.change),
            percent(difference.relative_change),
            f"{difference.error:.2g}",
            f"{difference.significance:+.1f}{' *' if difference.is_significant else ''}",
            f"{difference.p_value:.2g}",
            difference.unit,
        ]
        for difference in result.differences
    ]
    title = f"{first} and {second}: value +- standard error; * differs significantly"
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
    rest = [*only, *measure_lines(result.names, result.measures or ()), result.sentence]
    return joined([table(title, header, rows), *tests, *rest])


def measure_text(measures: ExcitationMeasures) -> str:
    """Return the condition number of columns of unit norm, and the D-value."""
    drives = ", drives included" if measures.has_drives else ""
    return (
        f"{measures.parameters} columns of unit norm{drives}: "
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


def number(value: float) -> str:
    """Return a number with four digits, a dash for NaN."""
    return f"{value:.4g}" if np.isfinite(value) else "-"


def percent(value: float) -> str:
    """Return a ratio in percent with two digits, a dash for NaN."""
    if not np.isfinite(value):
        return "-"
    if abs(value) >= 1e4:
        return f"{100 * value:.0e} %"
    return f"{100 * value:.2g} %" if abs(value) < 0.995 else f"{100 * value:.0f} %"


def entries(estimate: Estimate | StaticCalibration) -> list[tuple[str, float, float, str]]:
    """Return (name, value, standard error, unit) of each parameter."""
    values, errors = estimate.values.tolist(), estimate.standard_errors.tolist()
    return list(zip(estimate.names, values, errors, estimate.units, strict=True))


def group_name(group: str) -> str:
    """Return the name of the parameters of a drive, or of the base parameters."""
    return "base parameters" if group == "load" else f"drive of {group}"


def cut(text: str, longest: int = 56) -> str:
    """Return a text, cut to a number of letters."""
    return text if len(text) <= longest else text[: longest - 4] + " ..."


_WIDTH = 100


def sensors_table(found: Identifiability) -> Text:
    """Return the parameters identifiable individually, in combination, up to scale, or not."""
    return joined(_sensor_lines(found))


def _sensor_lines(analysis: Identifiability) -> Iterator[str]:
    grouped = sum(map(len, analysis.ratios))
    yield (
        f"{analysis.robot_name}: {len(analysis.names)} parameters, of which the sensors determine "
        f"{analysis.rank} combinations"
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
    count = len(analysis.base.names)
    agree = "agree" if analysis.agree else "do NOT agree"
    yield (
        f"{count} combinations, {grouped} of them in {len(analysis.ratios)} groups; exact and "
        f"numeric rank {agree}, singular-value gap {analysis.gap:.0e}"
    )
    if analysis.derivatives is not None:
        yield from _derivative_lines(analysis.derivatives)
    for line in analysis.commands:
        yield from _wrapped("", [line])


def _derivative_lines(base: BaseParameters) -> Iterator[str]:
    alone = np.count_nonzero(base.grouping, axis=1) == 1
    yield (
        f"By derivatives of motor angle and motor torque, as identify estimates them: "
        f"{len(base.columns)} combinations"
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


def conditions_table(together: Conditions) -> Text:
    """Return the specific parameters, whether they differ by the BIC, and the shared ones."""
    rows = []
    for name, test in together.differences.items():
        values = [_value_text(result, name) for result in together.identifications.values()]
        differ = "yes" if test.bic > 0 else "no"
        rows.append([name, *values, number(test.F), number(test.bic), differ])
    count = len(together.identifications)
    size = "(value +- standard error)"
    first = next(iter(together.identifications.values()))
    named = [JointParameter(x, joint) for joint, drive in first.drives.items() for x in drive.names]
    shared = [x for x in (*named, *first.load.names) if x not in together.differences]
    common = table(
        f"{count} conditions: shared parameters {size}",
        ["parameter", "all conditions"],
        [[name, _value_text(first, name)] for name in shared],
    )
    if not rows:
        return common
    title = f"{count} conditions: condition-specific parameters {size}"
    header = ["parameter", *together.identifications, "F", "BIC", "differ"]
    return joined([table(title, header, rows), "", common])


def _value_text(identification: Identification, name: str) -> str:
    estimate, key = identification.load_side, name
    if name not in estimate.names and isinstance(name, JointParameter):
        estimate, key = identification.drives[name.joint], name.parameter
    return f"{number(estimate.value(key))} +- {estimate.standard_error(key):.2g}"


def statics_table(found: StaticCalibration) -> Text:
    """Return the parameters of a calibration from statics, with rms, linearity and hysteresis."""
    rows = [
        [name, number(value), number(error), f"{number(low)} to {number(high)}", unit]
        for (name, value, error, unit), (low, high) in zip(
            entries(found), found.intervals.tolist(), strict=True
        )
    ]
    header = ["parameter", "estimated", "std. error", "95 % interval", "unit"]
    lines = [
        f"rms {found.rms:.3g} {found.statics.load_unit} over "
        f"{counted(len(found.statics.load), 'load')}, nonlinearity {percent(found.linearity)}"
    ]
    if np.isfinite(found.hysteresis):
        lines[0] += f", hysteresis {percent(found.hysteresis)} of the range of the load"
    else:
        lines[0] += " of the range of the load; no hysteresis without loads up and down"
    lines += [f"! {finding}" for finding in found.warnings]
    return joined([table(f"Calibration from statics, {found.law} law", header, rows), *lines])


def terms_table(selection: TermSelection) -> Text:
    """Return the comparison of all candidate terms, step by step, and the recommendation."""
    header = ["joint: term", "step", "F", "BIC", "excluded blocks", "better", "supported"]
    rows = [_term_row(term) for term in selection.comparisons]
    notes = [f"! {_label(term)}: {term.reason}" for term in selection.comparisons if term.reason]
    title = "Model comparison: a term needs BIC above zero and a smaller error of excluded blocks"
    return joined([table(title, header, rows), *notes, *_recommendation(selection)])


def _term_row(candidate: TermComparison) -> list[str]:
    if candidate.comparison is None:
        return [_label(candidate), str(candidate.step + 1), *["-"] * 4, "not tested"]
    gain = candidate.comparison
    excluded = f"{percent(gain.improvement)} +- {percent(gain.improvement_std)}"
    supported = "selected" if candidate.selected else "yes" if gain.is_supported else "no"
    blocks = f"{gain.better} of {gain.blocks}"
    return [
        _label(candidate),
        str(candidate.step + 1),
        number(gain.F),
        number(gain.bic),
        excluded,
        blocks,
        supported,
    ]


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
