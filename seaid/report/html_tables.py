"""Tables of a page: parameters before and after, checks and prediction errors, rounded."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.checks import POOR
from seaid.drives import JointParameter, readable
from seaid.identification import whole_body
from seaid.report.html_charts import powers_of_ten
from seaid.report.html_robot import center_of_mass, principal_moments
from seaid.report.html_traces import SIDES, torque_units
from seaid.report.text import entries

if TYPE_CHECKING:
    from seaid.estimation import Estimate, TermTest
    from seaid.identification import (
        ContactForces,
        Fit,
        FrequencyResponse,
        Identification,
        StaticCalibration,
    )
    from seaid.report.comparison import Comparison
    from seaid.report.html_traces import Run
    from seaid.report.html_verdict import Nominal
    from seaid.robot import Robot
    from seaid.simulation import ReplayComparison


@dataclass(frozen=True)
class Cell:
    """A cell: its text, its exact value for copies, a bar, and what a click opens.

    `bar` is (start, end) as parts of the width of its track.
    """

    text: str
    exact: float | None = None
    bar: tuple[float, float] | None = None
    more: str = ""

    @property
    def is_empty(self) -> bool:
        """Whether a narrow page leaves the cell out."""
        return not self.text


@dataclass(frozen=True)
class Table:
    """A table of the page; the first `words` columns, and all in `texts`, are left-aligned."""

    name: str
    caption: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    words: int
    texts: tuple[str, ...]


def table_of(
    name: str,
    caption: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[Cell | str]],
    words: int = 1,
    texts: Sequence[str] = ("Unit", "Note"),
) -> Table:
    """Return a table of texts and cells."""
    cells = tuple(tuple(x if isinstance(x, Cell) else Cell(x) for x in row) for row in rows)
    return Table(name, caption, tuple(heads), cells, words, tuple(texts))


_ERROR_DIGITS, _VALUE_DIGITS, _WITHOUT_ERROR = 2, 2, 6
_FIXED = (-2, 6)
"""Range of powers of ten in which a number is written without an exponent."""

_TINY = 1e-16

NONE = "–"


@dataclass(frozen=True)
class Rounded:
    """A value with its standard error and 95 % interval as text, all with the same last digit."""

    value: str
    error: str
    lower: str
    upper: str


def rounded(value: float, error: float, lower: float, upper: float) -> Rounded:
    """Return numbers rounded at the second digit of the error, or of the value if finer."""
    if not math.isfinite(value):
        return Rounded(NONE, NONE, NONE, NONE)
    last = _last_place(value, error)
    size = max(abs(value), error if math.isfinite(error) else 0.0)
    top = _power(size) if size > 0 else 0
    shift = 0 if _FIXED[0] <= top < _FIXED[1] else top
    texts = (_fixed(number, last, shift) for number in (value, error, lower, upper))
    return Rounded(*texts)


def short(value: float, digits: int = 3) -> str:
    """Return a number with a given number of digits, a dash for NaN."""
    return powers_of_ten(f"{value:.{digits}g}") if math.isfinite(value) else NONE


def probability(value: float) -> str:
    """Return a probability with two digits, or as below 1e-16."""
    return short(value, 2) if not value < _TINY else "< 10⁻¹⁶"


def share(value: float) -> str:
    """Return a ratio in percent with two digits, without decimals from 100 %, a dash for NaN."""
    if not math.isfinite(value):
        return NONE
    per_cent = 100 * value
    if abs(per_cent) >= 99.5:
        text = f"{per_cent:.0f}" if abs(per_cent) < 1e4 else "> 10⁴"
    else:
        # Two digits: a value of 10^p has its second one 1 - p places behind the point.
        decimals = 0 if per_cent == 0 else max(0, 1 - _power(abs(per_cent)))
        text = f"{per_cent:.{min(decimals, 6)}f}"
    return f"{text.replace('-', '−')}\N{NO-BREAK SPACE}%"


def seconds(value: float) -> str:
    """Return a duration in s, or in min from two minutes."""
    return f"{value:.4g} s" if value < 120 else f"{value / 60:.3g} min"


def _last_place(value: float, error: float) -> int:
    """Return the power of ten of the last digit that is written."""
    if not math.isfinite(error) or error <= 0:
        return _power(abs(value)) - _WITHOUT_ERROR + 1 if value else 0
    by_error = _power(error) - _ERROR_DIGITS + 1
    by_value = _power(abs(value)) - _VALUE_DIGITS + 1 if value else by_error
    # A small value with a large error gets digits of its own, but at most two more than the error.
    return max(min(by_error, by_value), by_error - 2)


def _power(size: float) -> int:
    return math.floor(math.log10(size) + 1e-12) if size > 0 else 0


def _fixed(value: float, last: int, shift: int) -> str:
    if not math.isfinite(value):
        return NONE
    decimals = max(shift - last, 0)
    text = f"{value / 10.0**shift:.{decimals}f}"
    # A rounded -0.004 is 0.00, not -0.00.
    text = text.removeprefix("-") if float(text) == 0 else text
    return powers_of_ten(f"{text}e{shift}" if shift else text)


_LONG_GROUPING = 64
_GROUPINGS_ROOM = 1_000_000
"""Characters of the page for groupings; beyond them groupings are shortened with a note."""

CORRELATED = 0.9
"""Autocorrelation at lag 1 above which a term is missing; a low-pass filter alone causes 0.5."""

_UNITS = {"^2": "²", "^3": "³", "^5": "⁵"}
_HEADS = (
    "Nominal",
    "Identified",
    "Std. error",
    "95 % interval",
    "Unit",
    "Change",
    "Rel. s.e.",
    "Note",
)


def drive_table(identification: Identification, nominal: Robot) -> Table:
    """Return the parameters of all drives, nominal and identified."""
    rows: list[list[Cell | str]] = []
    for joint, estimate in identification.drives.items():
        values = nominal.drives[joint].own_values
        before = np.array([values.get(name, np.nan) for name in estimate.names])
        for name, cells in zip(estimate.names, _parameter_cells(estimate, before), strict=True):
            rows.append([joint, name.replace("_", " "), *cells])
    caption = "Parameters of the drives; friction and rotor inertia are at the motor."
    return table_of("drives", caption, ("Joint", "Parameter", *_HEADS), rows, 2)


def base_table(identification: Identification, nominal: Nominal) -> Table:
    """Return the base parameters with their groupings, shortened if the page has no room."""
    names = identification.load.names
    room = max(_LONG_GROUPING, _GROUPINGS_ROOM // max(len(names), 1))
    before = nominal.load[: len(names)] if nominal.has_bodies else np.full(len(names), np.nan)

    def grouping(name: str) -> Cell:
        text = name
        if sum(map(len, names)) > _GROUPINGS_ROOM and len(name) > room:
            kept = name[:room].rsplit(" ", 2)[0]
            text = f"{kept} … ({terms_in(name)} terms; parameters.json has them all)"
        if len(text) <= _LONG_GROUPING:
            return Cell(text)
        head = text[:_LONG_GROUPING].rsplit(" + ", 1)[0].rsplit(" - ", 1)[0]
        return Cell(f"{head} + …", more=text)

    rows = [
        [grouping(name), *cells]
        for name, cells in zip(names, _parameter_cells(identification.load, before), strict=True)
    ]
    return table_of("base parameters", "Base parameters of the load.", ("Grouping", *_HEADS), rows)


def terms_in(expression: str) -> int:
    """Return the number of terms of a grouping."""
    return 1 + expression.count(" + ") + expression.count(" - ")


def _parameter_cells(estimate: Estimate, nominal: Array) -> Iterator[tuple[Cell | str, ...]]:
    """Yield the cells of every parameter under `_HEADS`."""
    intervals, relative = estimate.interval(), estimate.relative_standard_errors
    numbers = zip(estimate.values, estimate.standard_errors, intervals, nominal, strict=True)
    for place, (value, error, (lower, upper), before) in enumerate(numbers):
        texts = rounded(float(value), float(error), float(lower), float(upper))
        yield (
            _nominal_text(float(before)),
            Cell(texts.value, exact=float(value)),
            Cell(texts.error, exact=float(error)),
            f"{texts.lower} … {texts.upper}",
            readable_unit(estimate.units[place]),
            change(float(before), float(value)),
            Cell(share(float(relative[place])), bar=(0.0, bar(float(relative[place])))),
            _mark(float(value), float(error), lower <= 0 <= upper),
        )


def _nominal_text(value: float) -> str:
    """Return a nominal value with four digits, or with all before its decimal point."""
    whole = _power(abs(value)) + 1 if math.isfinite(value) else 0
    return short(value, max(4, whole if whole <= _FIXED[1] else 0))


def change(before: float, after: float) -> str:
    """Return the change of a value in percent, with its sign."""
    if not (math.isfinite(before) and math.isfinite(after)) or before == 0:
        return NONE
    text = share(after / before - 1)
    return text if text[0] in "−>" else f"+{text}"


def _mark(value: float, error: float, contains_zero: bool) -> str:
    if not (math.isfinite(value) and math.isfinite(error)):
        return "unidentifiable"
    if error > 0 and contains_zero:
        return "may be zero"
    return "poorly determined" if error > POOR * abs(value) else ""


def bar(relative: float) -> float:
    """Return a relative standard error as the length of a bar, at most 1."""
    return round(min(relative, 1.0), 4) if math.isfinite(relative) else 1.0


def readable_unit(unit: str) -> str:
    """Return a unit with superscript exponents, empty for 1."""
    for plain, raised in _UNITS.items():
        unit = unit.replace(plain, raised)
    return "" if unit == "1" else unit.replace(" ", "\N{NO-BREAK SPACE}")


def whole_body_table(identification: Identification) -> Table:
    """Return mass and centre of mass of a robot with a floating base, and of its base alone."""
    rows: list[list[Cell | str]] = [
        [
            quantity.name.capitalize(),
            *(
                (short(quantity.value, 4), short(quantity.standard_error, 2))
                if quantity.is_determined
                else ("not determined", "")
            ),
            readable_unit(quantity.unit),
        ]
        for quantity in whole_body(identification)
    ]
    heads = ("Quantity", "Identified", "Standard error", "Unit")
    caption = "The whole robot, in the frame of its base at the mean posture of the logs."
    return table_of("whole", caption, heads, rows, texts=heads[:1])


def contact_table(name: str, forces: ContactForces) -> Table:
    """Return the predicted and measured contact forces of a validation."""
    numbers = ("rms_force", "rms_error", "relative_error")
    others = ("mean_normal", "least_normal", "standard_error", "friction_used")
    rows: list[list[Cell | str]] = [
        [
            link,
            forces.basis[place],
            *(short(getattr(forces, field)[place]) for field in numbers[:2]),
            share(forces.relative_error[place]),
            *(short(getattr(forces, field)[place]) for field in others),
        ]
        for place, link in enumerate(forces.links)
    ]
    heads = (
        *("Contact", "Parameters", "Measured (rms)", "Error (rms)", "Error"),
        *("Normal (mean)", "Normal (least)", "Standard error", "Friction used"),
    )
    texts = ("predicted {} N", "measured {} N", "weight {} N")
    sums = (forces.vertical, forces.measured_vertical, forces.weight)
    known = [text.format(short(x)) for text, x in zip(texts, sums, strict=True) if np.isfinite(x)]
    caption = f"Contact forces [N] of the {name}"
    caption += f". Normal forces in sum: {', '.join(known)}." if known else "."
    return table_of(f"contacts {name}", caption, heads, rows, texts=heads[:2])


def bodies_table(identification: Identification, nominal: Robot) -> Table:
    """Return mass and centre of mass of every body, nominal and identified."""
    rows: list[list[Cell | str]] = []
    pairs = zip(
        identification.robot.body_names,
        nominal.parameters.reshape(-1, 10),
        identification.robot.parameters.reshape(-1, 10),
        strict=True,
    )
    for name, before, after in pairs:
        masses = float(before[0]), float(after[0])
        rows.append(
            [
                name,
                short(masses[0], 4),
                Cell(short(masses[1], 4), exact=masses[1]),
                change(*masses),
                *(_center(body) for body in (before, after)),
                *(_moments(body) for body in (before, after)),
            ]
        )
    heads = (
        *("Link", "Mass in the file [kg]", "Mass identified [kg]", "Change"),
        *("Centre in the file [m]", "Centre identified [m]"),
        *("Moments in the file [kg m²]", "Moments identified [kg m²]"),
    )
    caption = (
        "Links in the robot file and as exported: mass, centre of mass, principal moments of "
        "inertia about it."
    )
    return table_of("links", caption, heads, rows, texts=heads[4:])


def _center(body: Array) -> str:
    center = center_of_mass(body) if np.all(np.isfinite(body)) else None
    return NONE if center is None else _vector(center)


def _moments(body: Array) -> str:
    """Return the principal moments of inertia about the centre of mass."""
    if not np.all(np.isfinite(body)) or body[0] <= 0:
        return NONE
    return _vector(principal_moments(body))


def _vector(values: Array) -> str:
    """Return numbers with three digits, and those that are nothing but rounding as 0."""
    least = 1e-9 * float(np.max(np.abs(values)))
    return " ".join(short(float(value) if abs(value) > least else 0.0) for value in values)


def term_table(identification: Identification) -> Table:
    """Return each tested term of the drives, and whether the data support it."""
    rows = [
        (
            term_name(side, term),
            # `growth` is that of the sum of squares, its root that of the residual.
            f"× {math.sqrt(term.growth):.4g}",
            short(term.F),
            probability(term.p_value),
            short(term.bic),
            "yes" if term.bic > 0 else "no",
        )
        for side, checks in identification.checks.items()
        for term in checks.terms
    ]
    caption = (
        "Model comparison: growth of the residual without each term of the drives. The data "
        "support a term if the difference of the Bayesian information criterion is above zero."
    )
    heads = ("Term", "Residual without", "F", "p", "BIC", "Supported")
    return table_of("terms", caption, heads, rows)


def term_name(side: str, term: TermTest) -> str:
    """Return the name of a tested term with its joint."""
    name = term.terms[0]
    return readable(name if side in ("load", "both") else JointParameter(name, side))


def calibration_table(calibration: StaticCalibration) -> Table:
    """Return the parameters of a calibration from statics."""
    rows = _value_rows(calibration)
    return table_of("calibration", "Parameters of the law, and friction.", _VALUE_HEADS, rows)


def response_table(response: FrequencyResponse) -> Table:
    """Return resonance, antiresonance, damping and spring of every elastic joint."""
    rows = [[Cell(joint), *row] for joint, d in response.drives.items() for row in _value_rows(d)]
    caption = "From the response of motor angles to motor torques; frequencies with all motors free"
    caption += " (resonance) and held (antiresonance)."
    return table_of("response", caption, ("Joint", *_VALUE_HEADS), rows, 2)


_VALUE_HEADS = ("Parameter", "Value", "Std. error", "95 % interval", "Unit")


def _value_rows(estimate: StaticCalibration | Estimate) -> list[list[Cell]]:
    every = estimate.intervals if hasattr(estimate, "intervals") else estimate.interval()
    rows = []
    for (name, value, error, unit), (low, high) in zip(
        entries(estimate), every.tolist(), strict=True
    ):
        texts = rounded(value, error, low, high)
        interval = Cell(f"{texts.lower} to {texts.upper}")
        values = Cell(texts.value, value), Cell(texts.error, error), interval
        rows.append([Cell(name.replace("_", " ")), *values, Cell(readable_unit(unit))])
    return rows


def residual_table(identification: Identification) -> Table:
    """Return the autocorrelation of the residual of every equation."""
    rows = [
        (joint, side_name(side), short(white.first), short(white.durbin_watson))
        for side, checks in identification.checks.items()
        for joint, white in checks.whiteness.items()
    ]
    caption = (
        "Autocorrelation of the residuals at lag 1. A low-pass filter causes some even for a "
        "complete model, which the standard errors account for; a Durbin-Watson number near 0 "
        "indicates a missing term."
    )
    heads = ("Joint", "Side", "Autocorrelation", "Durbin-Watson")
    return table_of("residuals", caption, heads, rows, 2)


def condition_table(result: Identification) -> Table:
    """Return condition number, residual and number of excluded instants per regression."""
    rows = []
    for side, checks in result.checks.items():
        elastic = side not in ("load", "both")
        estimate = result.drives[side] if elastic else result.load_side
        # The residual of a load side with a prismatic joint has rows in N.
        unit = "" if not elastic and any(result.robot.is_prismatic) else "N m"
        excluded = sum(result.excluded.values()) if side == "both" else result.excluded.get(side)
        rows.append(
            (
                f"actuator side of {side}" if elastic else side_name(side),
                short(checks.condition_number),
                f"{short(estimate.residual_std)} {unit}".strip(),
                NONE if excluded is None else str(excluded),
            )
        )
    caption = (
        "Each regression: condition number of its columns (unit norm), standard deviation of its "
        "residual below the cutoff, and excluded instants near standstill."
    )
    heads = ("Regression", "Condition number", "Residual", "Excluded")
    return table_of("regressions", caption, heads, rows)


def side_name(side: str) -> str:
    """Return the name of a side of the checks."""
    return {"load": "load side", "both": "both sides"}.get(side, "actuator side")


_MOST_ERRORS = 1500


@dataclass(frozen=True)
class ErrorRow:
    """The prediction errors of the torque of a joint on one side in a run."""

    run: str
    is_unseen: bool
    joint: str
    side: str
    cells: tuple[str, ...]
    relative_error: float


def error_rows(identification: Identification, runs: Sequence[Run]) -> list[ErrorRow]:
    """Return the prediction errors of every run, by side and joint, if there are traces."""
    return [
        ErrorRow(
            run=run.name,
            is_unseen=run.is_unseen,
            joint=joint,
            side=side,
            cells=_error_cells(fit, index, torque_units(identification.robot, side)[index]),
            relative_error=float(fit.relative_error[index]),
        )
        for run in runs
        for side in SIDES
        for fit in [getattr(run.result, side)]
        for index, joint in enumerate(run.result.joints)
        if np.isfinite(fit.relative_error[index])
    ]


def error_table(rows: Sequence[ErrorRow]) -> Table:
    """Return the table of the 1500 largest errors, in their order."""
    largest = sorted(range(len(rows)), key=lambda k: -rows[k].relative_error)[:_MOST_ERRORS]
    kept = [rows[k] for k in sorted(largest)]
    numbers = ("Error", "Counted", "With standstill", "Unfiltered", "RMS error", "R²")
    heads = ("Motion", "Joint", "Side", *numbers)
    cells = [(f"{r.run}{' (unseen)' * r.is_unseen}", r.joint, r.side, *r.cells) for r in kept]
    return table_of("predictions", "Prediction errors of the torques.", heads, cells, 3)


def _error_cells(fit: Fit, index: int, unit: str) -> tuple[str, ...]:
    return (
        share(float(fit.relative_error[index])),
        share(float(fit.counted_share[index])),
        share(float(fit.relative_error_with_standstill[index])),
        share(float(fit.raw_relative_error[index])),
        f"{short(float(fit.rms_error[index]))} {unit}",
        f"{float(fit.r_squared[index]):.4f}".replace("-", "−"),
    )


def replay_error_table(result: ReplayComparison) -> Table:
    """Return the errors of the replays before and after the identification by joint."""
    heads = ("Joint", "Mean absolute, before", "After", "Rms, before", "After", "After over noise")
    errors = [*result.mean_absolute_errors, *result.rms_errors]
    over = np.divide(errors[3], result.noise, where=result.noise > 0, out=errors[3] * np.nan)
    rows = [
        (
            joint,
            *(f"{short(1e3 * float(error[index]))} {unit}" for error in errors),
            short(float(over[index]), 2),
        )
        for index, joint in enumerate(result.joints)
        for unit in ["mm" if result.is_prismatic[index] else "mrad"]
    ]
    return table_of("replay", "Errors of the replayed joint positions.", heads, rows)


def difference_table(result: Comparison, room: int = _LONG_GROUPING) -> Table:
    """Return the parameters of two identifications side by side."""
    first, second = result.names
    largest = max((abs(d.significance) for d in result.differences), default=1.0)
    rows: list[list[Cell | str]] = []
    for d in result.differences:
        pairs = (d.first, d.first_error), (d.second, d.second_error)
        rows.append(
            [
                d.joint or "load",
                d.name.replace("_", " ") if d.joint else _shortened(d.name, room),
                *(_value_cell(*pair) for pair in pairs),
                readable_unit(d.unit),
                change(d.first, d.second),
                _significance(d.significance, largest),
                probability(d.p_value),
                "differs" if d.is_significant else "",
            ]
        )
    heads = ("Joint", "Parameter", first, second, "Unit", "Change", "Change / s.e.", "p", "Note")
    caption = "All parameters that both identifications have: value ± standard error."
    return table_of("comparison", caption, heads, rows, 2)


def _shortened(name: str, room: int) -> Cell:
    return Cell(name) if len(name) <= room else Cell(f"{name[:room]}…", more=name)


def _value_cell(value: float, error: float) -> Cell:
    text = rounded(value, error, value, value)
    return Cell(f"{text.value} ± {text.error}", exact=value)


def _significance(value: float, largest: float) -> Cell:
    text = powers_of_ten(f"{value:+.1f}") if math.isfinite(value) else NONE
    return Cell(text, value, _diverging(value, largest))


def _diverging(value: float, largest: float) -> tuple[float, float] | None:
    """Return a bar from the middle of its track to the side of the sign of a value."""
    if not math.isfinite(value) or not largest > 0:
        return None
    # At least one standard error is the whole length: insignificant differences stay short.
    end = 0.5 + 0.5 * value / max(largest, 1.0)
    return (min(0.5, end), max(0.5, end))
