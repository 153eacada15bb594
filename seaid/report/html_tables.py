"""Tables of a page: drives, base parameters, checks and prediction errors, with rounded numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid.drives import JointParameter, readable
from seaid.identification import POORLY_IDENTIFIED
from seaid.report.html_traces import SIDES

if TYPE_CHECKING:
    from seaid.estimation import Estimate, TermTest
    from seaid.identification import Fit, Identification
    from seaid.report.html_traces import Run

_ERROR_DIGITS, _VALUE_DIGITS, _WITHOUT_ERROR = 2, 2, 6
_FIXED = (-4, 6)
"""Range of powers of ten in which a number is written without an exponent."""

_TINY = 1e-16

NONE = "–"


@dataclass(frozen=True)
class Rounded:
    """A value with its standard errors and 95 % interval as text, all with the same last digit."""

    value: str
    error: str
    lower: str
    upper: str
    white: str


def rounded(
    value: float, error: float, lower: float, upper: float, white: float = math.nan
) -> Rounded:
    """Return numbers rounded at the second digit of the error, or of the value if finer."""
    if not math.isfinite(value):
        return Rounded(NONE, NONE, NONE, NONE, NONE)
    last = _last_place(value, error)
    size = max(abs(value), error if math.isfinite(error) else 0.0)
    top = _power(size) if size > 0 else 0
    shift = 0 if _FIXED[0] <= top < _FIXED[1] else top
    texts = (_fixed(one, last, shift) for one in (value, error, lower, upper, white))
    return Rounded(*texts)


def short(value: float, digits: int = 3) -> str:
    """Return a number with a given number of digits, a dash for NaN."""
    return f"{value:.{digits}g}".replace("-", "−") if math.isfinite(value) else NONE


def probability(value: float) -> str:
    """Return a probability with two digits, or as below 1e-16."""
    return short(value, 2) if not value < _TINY else "< 1e−16"


def share(value: float) -> str:
    """Return a ratio in percent with two digits, without decimals from 100 %, a dash for NaN."""
    if not math.isfinite(value):
        return NONE
    per_cent = 100 * value
    if abs(per_cent) >= 99.5:
        return (
            f"{per_cent:.0f}\N{NO-BREAK SPACE}%"
            if abs(per_cent) < 1e4
            else "> 10⁴\N{NO-BREAK SPACE}%"
        )
    decimals = 0 if per_cent == 0 else max(0, 1 - _power(abs(per_cent)))
    return f"{per_cent:.{min(decimals, 6)}f}\N{NO-BREAK SPACE}%"


def seconds(value: float) -> str:
    """Return a duration in s, or in min from two minutes."""
    return f"{value:.4g} s" if value < 120 else f"{value / 60:.3g} min"


def _last_place(value: float, error: float) -> int:
    """Return the power of ten of the last digit that is written."""
    if not math.isfinite(error) or error <= 0:
        return _power(abs(value)) - _WITHOUT_ERROR + 1 if value else 0
    by_error = _power(error) - _ERROR_DIGITS + 1
    by_value = _power(abs(value)) - _VALUE_DIGITS + 1 if value else by_error
    return max(min(by_error, by_value), by_error - 2)


def _power(size: float) -> int:
    return math.floor(math.log10(size) + 1e-12) if size > 0 else 0


def _fixed(value: float, last: int, shift: int) -> str:
    if not math.isfinite(value):
        return NONE
    decimals = max(shift - last, 0)
    text = f"{value / 10.0**shift:.{decimals}f}"
    text = text.removeprefix("-") if float(text) == 0 else text
    return text.replace("-", "−") + (f"e{shift:+d}".replace("-", "−") if shift else "")


_LONG_GROUPING = 64
_GROUPINGS_ROOM = 1_000_000
"""Characters of the page for groupings; beyond them groupings are shortened with a note."""

CORRELATED = 0.9
"""Autocorrelation at lag 1 above which a term is missing; a low-pass filter alone causes 0.5."""

_UNITS = {"^2": "²", "^3": "³", "^5": "⁵"}


@dataclass(frozen=True)
class ParameterRow:
    """One parameter: numbers as text, its exact value, and its relative error as `bar` (0 to 1).

    `mark` is "unidentifiable", "may be zero" if the 95 % interval contains zero, or "poorly
    determined" if the standard error exceeds a tenth of the value.
    """

    name: str
    more: str
    numbers: Rounded
    exact: float
    relative: str
    bar: float
    mark: str
    unit: str


@dataclass(frozen=True)
class DriveTable:
    """The parameters of one joint's drive."""

    joint: str
    rows: tuple[ParameterRow, ...]


@dataclass(frozen=True)
class CheckRow:
    """A row of a table of checks: its cells as text, and whether it is a warning."""

    cells: tuple[str, ...]
    is_warning: bool


def drive_tables(found: Identification) -> list[DriveTable]:
    """Return a table for every joint whose drive has parameters."""
    return [
        DriveTable(joint, tuple(_rows(estimate, lambda name: name.replace("_", " "))))
        for joint, estimate in found.drives.items()
    ]


def base_rows(found: Identification) -> list[ParameterRow]:
    """Return the base parameters with their groupings, shortened if the page has no room."""
    names = found.load.names
    room = max(_LONG_GROUPING, _GROUPINGS_ROOM // max(len(names), 1))

    def cut(name: str) -> str:
        if sum(map(len, names)) <= _GROUPINGS_ROOM or len(name) <= room:
            return name
        kept = name[:room].rsplit(" ", 2)[0]
        return f"{kept} … ({terms_in(name)} terms; parameters.json has them all)"

    return list(_rows(found.load, cut))


def terms_in(expression: str) -> int:
    """Return the number of terms of a grouping."""
    return 1 + expression.count(" + ") + expression.count(" - ")


def _rows(estimate: Estimate, text: Callable[[str], str]) -> Iterator[ParameterRow]:
    white, intervals = _white(estimate), estimate.interval()
    errors, relative = estimate.standard_errors, estimate.relative_standard_errors
    for place, name in enumerate(estimate.names):
        value, error, ends = float(estimate.values[place]), float(errors[place]), intervals[place]
        head, more = _head(text(name))
        yield ParameterRow(
            name=head,
            more=more,
            numbers=rounded(value, error, float(ends[0]), float(ends[1]), float(white[place])),
            exact=value,
            relative=share(float(relative[place])),
            bar=bar(float(relative[place])),
            mark=_mark(value, error, ends[0] <= 0 <= ends[1]),
            unit=readable_unit(estimate.units[place]),
        )


def _white(estimate: Estimate) -> Array:
    """Return the standard errors for white noise, NaN if the estimator gave none."""
    white = estimate.white_standard_errors
    return np.full(len(estimate.names), np.nan) if white is None else white


def has_white(found: Identification) -> bool:
    """Return whether any estimate has standard errors for white noise."""
    every = (found.load, *found.drives.values())
    return any(one.white_standard_errors is not None for one in every)


def _head(text: str) -> tuple[str, str]:
    """Return the visible start of a grouping, and the whole if it is longer."""
    if len(text) <= _LONG_GROUPING:
        return text, ""
    terms = text[:_LONG_GROUPING].rsplit(" + ", 1)[0].rsplit(" - ", 1)[0]
    return f"{terms} + …", text


def _mark(value: float, error: float, contains_zero: bool) -> str:
    if not (math.isfinite(value) and math.isfinite(error)):
        return "unidentifiable"
    if error > 0 and contains_zero:
        return "may be zero"
    return "poorly determined" if error > POORLY_IDENTIFIED * abs(value) else ""


def bar(relative: float) -> float:
    """Return a relative standard error as the length of a bar, at most 1."""
    return round(min(relative, 1.0), 4) if math.isfinite(relative) else 1.0


def readable_unit(unit: str) -> str:
    """Return a unit with superscript exponents, empty for 1."""
    for plain, raised in _UNITS.items():
        unit = unit.replace(plain, raised)
    return "" if unit == "1" else unit


def term_rows(found: Identification) -> list[CheckRow]:
    """Return each tested term of the drives, and whether the data support it."""
    return [
        CheckRow(
            (
                term_name(side, term),
                f"× {math.sqrt(term.growth):.4g}",
                short(term.F),
                probability(term.p_value),
                short(term.bic),
                "yes" if term.bic > 0 else "no",
            ),
            term.bic <= 0,
        )
        for side, checks in found.checks.items()
        for term in checks.terms
    ]


def term_name(side: str, term: TermTest) -> str:
    """Return the name of a tested term with its joint."""
    name = term.terms[0]
    return readable(name if side in ("load", "both") else JointParameter(name, side))


def residual_rows(found: Identification) -> list[CheckRow]:
    """Return the autocorrelation of the residual of every equation."""
    return [
        CheckRow(
            (joint, side_name(side), short(white.first), short(white.durbin_watson)),
            white.first > CORRELATED,
        )
        for side, checks in found.checks.items()
        for joint, white in checks.whiteness.items()
    ]


def condition_rows(found: Identification) -> list[CheckRow]:
    """Return condition number, residual and number of excluded instants per regression."""
    rows = []
    for side, checks in found.checks.items():
        elastic = side not in ("load", "both")
        estimate = found.drives[side] if elastic else found.load_side
        unit = "" if not elastic and any(found.robot.is_prismatic) else "N m"
        excluded = sum(found.excluded.values()) if side == "both" else found.excluded.get(side)
        cells = (
            f"actuator side of {side}" if elastic else side_name(side),
            short(checks.condition_number),
            f"{short(estimate.residual_std)} {unit}".strip(),
            "–" if excluded is None else str(excluded),
        )
        rows.append(CheckRow(cells, False))
    return rows


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


def error_rows(found: Identification, runs: Sequence[Run]) -> list[ErrorRow]:
    """Return the prediction errors of every run, by side and joint, if there are traces."""
    return [
        ErrorRow(
            run=run.name,
            is_unseen=run.is_unseen,
            joint=joint,
            side=side,
            cells=_error_cells(fit, index, _torque_unit(found, side, index)),
            relative_error=float(fit.relative_error[index]),
        )
        for run in runs
        for side in SIDES
        for fit in [getattr(run.result, side)]
        for index, joint in enumerate(run.result.joints)
        if np.isfinite(fit.relative_error[index])
    ]


def worst_rows(rows: Sequence[ErrorRow]) -> list[ErrorRow]:
    """Return the rows with the 1500 largest errors, in their order."""
    largest = sorted(range(len(rows)), key=lambda k: -rows[k].relative_error)[:_MOST_ERRORS]
    return [rows[k] for k in sorted(largest)]


def _torque_unit(found: Identification, side: str, index: int) -> str:
    return "N" if side == "load" and found.robot.is_prismatic[index] else "N m"


def _error_cells(fit: Fit, index: int, unit: str) -> tuple[str, ...]:
    return (
        share(float(fit.relative_error[index])),
        share(float(fit.moving_relative_error[index])),
        share(float(fit.raw_relative_error[index])),
        f"{short(float(fit.rms_error[index]))} {unit}",
        f"{float(fit.r_squared[index]):.4f}",
    )
