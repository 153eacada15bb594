"""Formats of values, the columns and tables made of them, and the templates of the pages.

A table is made once, by a function of `tables`. Each kind of value has one format for a terminal,
with four digits, and one for a page, with no digit below those of the error. The page's own script
makes CSV and LaTeX of what the page shows, with the exact values that its cells have. A template
(`seaid/report/page`) makes the markup of a page or of a picture.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, make_dataclass
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, NamedTuple

from seaid._arrays import Array
from seaid._files import plain, read_toml
from seaid._progress import counted
from seaid.checks.tolerances import POOR
from seaid.drives import readable
from seaid.errors import SeaidError

NONE = "–"
"""What a page shows for NaN; a terminal shows "-"."""

_ERROR_DIGITS, _VALUE_DIGITS, _WITHOUT_ERROR = 2, 2, 6
"""Significant digits of an error, digits of a value down to which it is written at least, and those
of a value without an error."""

_FIXED = (-2, 6)
"""Range of powers of ten in which a number is written without an exponent."""

_TINY = 1e-16
"""Probability below which its size is rounding: it is written as less than this."""

_UNITS = {"^2": "²", "^3": "³", "^5": "⁵"}
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float, digits: int = 4) -> str:
    """Return a number for a terminal, a dash for NaN."""
    return f"{value:.{digits}g}" if math.isfinite(value) else "-"


def percent(value: float) -> str:
    """Return a ratio in percent with two digits for a terminal, a dash for NaN."""
    if not math.isfinite(value):
        return "-"
    if abs(value) >= 1e4:
        return f"{100 * value:.0e} %"
    return f"{100 * value:.2g} %" if abs(value) < 0.995 else f"{100 * value:.0f} %"


def is_partial(share_of_all: float) -> bool:
    """Return whether a share is visibly less than all."""
    return math.isfinite(share_of_all) and percent(share_of_all) != percent(1.0)


def cut(text: str, longest: int = 56) -> str:
    """Return a text, cut to a number of letters."""
    return text if len(text) <= longest else text[: longest - 4] + " ..."


def short(value: float, digits: int = 3) -> str:
    """Return a number for a page, a dash for NaN."""
    return powers_of_ten(f"{value:.{digits}g}") if math.isfinite(value) else NONE


def powers_of_ten(text: str) -> str:
    """Return a number such as 1.2e-05 as 1.2·10⁻⁵, other numbers with a proper minus."""
    mantissa, _, exponent = text.replace("−", "-").partition("e")
    return mantissa.replace("-", "−") + (f"·{power_of_ten(int(exponent))}" if exponent else "")


def power_of_ten(exponent: int) -> str:
    """Return a power of ten as 10⁻⁵."""
    return f"10{str(exponent).translate(_SUPERSCRIPTS)}"


def probability(value: float) -> str:
    """Return a probability for a page with two digits, or as below 1e-16."""
    return short(value, 2) if not value < _TINY else "< 10⁻¹⁶"


def share(value: float) -> str:
    """Return a ratio in percent with two digits for a page, a dash for NaN."""
    if not math.isfinite(value):
        return NONE
    return f"{powers_of_ten(percent(value).removesuffix(' %'))}\N{NO-BREAK SPACE}%"


_WELL_PREDICTED, _BADLY_PREDICTED = 0.05, 0.2
"""Relative errors below which a joint is explained well, and from which poorly: friction at
reversals alone leaves 1 to 5 % on the measured robots of docs/results.md."""


def explained_as(error: float) -> str:
    """Return how well a torque with a relative error is explained: a class of report.css."""
    if not math.isfinite(error):
        return "none"
    return "good" if error < _WELL_PREDICTED else "fair" if error < _BADLY_PREDICTED else "poor"


def signed_share(value: float) -> str:
    """Return a change in percent for a page, with its sign."""
    text = share(value)
    return text if text[0] in f"−{NONE}" else f"+{text}"


def seconds(value: float) -> str:
    """Return a duration in s, or in min from two minutes."""
    return f"{value:.4g} s" if value < 120 else f"{value / 60:.3g} min"


def readable_unit(unit: str) -> str:
    """Return a unit for a page with superscript exponents, empty for 1."""
    for written, raised in _UNITS.items():
        unit = unit.replace(written, raised)
    return "" if unit == "1" else unit.replace(" ", "\N{NO-BREAK SPACE}")


def four_digits(value: float) -> str:
    """Return a number for a page with four digits, or with all before its decimal point."""
    whole = _power(abs(value)) + 1 if math.isfinite(value) else 0
    return short(value, max(4, whole if whole <= _FIXED[1] else 0))


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


@dataclass(frozen=True)
class Cell:
    """A cell of a page: its text, its exact value for copies, a bar, and what a click opens.

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
class Measured:
    """A value with its standard error and the 95 % interval, and a nominal one, NaN if unknown."""

    value: float
    error: float
    lower: float = math.nan
    upper: float = math.nan
    unit: str = ""
    nominal: float = math.nan

    @cached_property
    def _places(self) -> tuple[int, int]:
        """The powers of ten of the last digit that a page writes, and of the exponent."""
        size = max(abs(self.value), self.error if math.isfinite(self.error) else 0.0)
        top = _power(size)
        return _last_place(self.value, self.error), 0 if _FIXED[0] <= top < _FIXED[1] else top

    def text(self, name: str) -> str:
        """Return a field for a page: all fields have the same last digit.

        It is the second one of the error, or of the value if that is finer.
        """
        is_known = math.isfinite(self.value)
        return _fixed(getattr(self, name), *self._places) if is_known else NONE

    @property
    def relative(self) -> float:
        """The standard error over the absolute value, NaN for a value of zero."""
        return self.error / abs(self.value) if self.value else math.nan

    @property
    def change(self) -> float:
        """The value over the nominal one, less one."""
        return change(self.nominal, self.value)

    @property
    def off(self) -> float:
        """The difference from the nominal value in standard errors, NaN without one."""
        return (self.value - self.nominal) / self.error if self.error else math.nan

    @property
    def note(self) -> str:
        """What the error and the interval say about the value, empty if all is well."""
        if not (math.isfinite(self.value) and math.isfinite(self.error)):
            return "unidentifiable"
        if self.error > 0 and self.lower <= 0 <= self.upper:
            return "may be zero"
        return "poorly determined" if self.error > POOR * abs(self.value) else ""


@dataclass(frozen=True)
class Scaled:
    """A value with a sign, and the largest of its column, which has the longest bar."""

    value: float
    largest: float


def change(before: float, after: float) -> float:
    """Return the relative change of a value, NaN if it was zero or unknown."""
    return after / before - 1 if before else math.nan


def _with_bar(ratio: float) -> Cell:
    """Return a ratio in percent with a bar from the left, whole from 100 %."""
    known = math.isfinite(ratio)
    return Cell(share(ratio), bar=(0.0, round(min(ratio, 1.0), 4)) if known else None)


class Format(NamedTuple):
    """How a kind of value is shown: in a terminal, and on a page, which aligns words left."""

    text: Callable[[Any], str]
    page: Callable[[Any], str | Cell]
    is_words: bool = False


_LONG_GROUPING = 64
"""Characters of a combination of parameters beyond which the rest opens on a click."""


def _grouping(name: str) -> str | Cell:
    """Return a combination of parameters for a page: what is long opens on a click."""
    if len(name) <= _LONG_GROUPING:
        return name
    head = name[:_LONG_GROUPING].rsplit(" + ", 1)[0].rsplit(" - ", 1)[0]
    return Cell(f"{head} + …", more=name)


def _diverging(x: Scaled) -> Cell:
    """Return a value with a bar from the middle of its track to the side of its sign."""
    if not math.isfinite(x.value):
        return Cell(short(x.value), x.value)
    # At least one standard error is the whole length: insignificant differences stay short.
    end = 0.5 + 0.5 * x.value / max(x.largest, 1.0)
    bar_ends = (min(0.5, end), max(0.5, end)) if x.largest > 0 else None
    return Cell(powers_of_ten(f"{x.value:+.1f}"), x.value, bar_ends)


def _unit(x: str | Measured) -> str:
    return x.unit if isinstance(x, Measured) else x


FORMATS = {
    "words": Format(str, str, is_words=True),
    "parameter": Format(str, lambda x: x.replace("_", " "), is_words=True),
    "term": Format(str, readable, is_words=True),
    "grouping": Format(cut, _grouping, is_words=True),
    "unit": Format(_unit, lambda x: readable_unit(_unit(x)), is_words=True),
    # Numbers that have their unit already: of texts only these are aligned right.
    "figure": Format(str, str),
    "number": Format(number, lambda x: Cell(short(x, 4), x)),
    "two digits": Format(lambda x: number(x, 2), lambda x: short(x, 2)),
    "three digits": Format(lambda x: number(x, 3), short),
    "share": Format(percent, share),
    "change": Format(percent, signed_share),
    "probability": Format(lambda x: number(x, 2), probability),
    "factor": Format(lambda x: f"x {x:.3g}", lambda x: f"× {x:.4g}"),
    "significance": Format(lambda x: f"{x.value:+.1f}", _diverging),
    # Parts of a measured value.
    "nominal": Format(lambda x: number(x.nominal), lambda x: four_digits(x.nominal)),
    "value": Format(lambda x: number(x.value), lambda x: Cell(x.text("value"), x.value)),
    "error": Format(lambda x: number(x.error), lambda x: Cell(x.text("error"), x.error)),
    "interval": Format(
        lambda x: f"{number(x.lower)} to {number(x.upper)}",
        lambda x: f"{x.text('lower')} … {x.text('upper')}",
    ),
    "relative error": Format(lambda x: percent(x.relative), lambda x: _with_bar(x.relative)),
    "change of value": Format(lambda x: percent(x.change), lambda x: signed_share(x.change)),
    "off": Format(lambda x: f"{x.off:+.1f} s.e.".replace("+nan s.e.", "-"), lambda x: short(x.off)),
    "note": Format(lambda x: x.note, lambda x: x.note, is_words=True),
    "value and error": Format(
        lambda x: f"{number(x.value)} +- {x.error:.2g}" if math.isfinite(x.value) else "-",
        lambda x: (
            Cell(f"{x.text('value')} ± {x.text('error')}", x.value)
            if math.isfinite(x.value)
            else NONE
        ),
    ),
}
"""{name of a kind of value: how it is shown}."""

Where = Literal["both", "text", "page"]


@dataclass(frozen=True)
class Column:
    """A column: its head as in a terminal, and the `kind` of its values, of FORMATS.

    A page begins the head with a capital, but for a name that the user gave, `is_name`. An optional
    column that has a value in no row is omitted.
    """

    head: str
    kind: str = "number"
    where: Where = "both"
    is_optional: bool = False
    is_name: bool = False

    @property
    def page_head(self) -> str:
        """The head on a page."""
        keeps = self.is_name or len(self.head) == 1
        return self.head if keeps else self.head[:1].upper() + self.head[1:]

    @property
    def format(self) -> Format:
        """How its values are shown."""
        return FORMATS[self.kind]

    @property
    def is_unit(self) -> bool:
        """Whether the column has the units of others."""
        return self.kind == "unit"

    def text(self, value: Any) -> str:
        """Return a value for a terminal; a text stands for a value that is not known."""
        if value == NONE:
            return "-"
        is_text = isinstance(value, str) and not self.format.is_words
        return value if is_text else self.format.text(value)

    def cell(self, value: Any) -> Cell:
        """Return a value for a page."""
        is_done = isinstance(value, Cell) or (isinstance(value, str) and not self.format.is_words)
        shown = value if is_done else self.format.page(value)
        return shown if isinstance(shown, Cell) else Cell(shown)


@dataclass(frozen=True)
class Table:
    """A table: `name` of its file of CSV or LaTeX, caption, and a value per column in each row.

    A summary has its `title`.
    """

    name: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Any, ...], ...]
    title: str = ""

    def _columns_in(self, excluded: Where) -> list[tuple[Column, list[Any]]]:
        """The columns with their values, without those that are shown in `excluded` alone."""
        every = [(column, [row[k] for row in self.rows]) for k, column in enumerate(self.columns)]
        return [
            (column, values)
            for column, values in every
            if column.where != excluded
            and not (column.is_optional and {*map(column.text, values)} <= {"-", ""})
        ]

    @property
    def texts(self) -> tuple[list[str], list[list[str]]]:
        """The heads and the rows for a terminal, where units stand in the last column."""
        kept = sorted(self._columns_in("page"), key=lambda pair: pair[0].is_unit)
        rows = zip(*(map(column.text, values) for column, values in kept), strict=True)
        return [column.head for column, _ in kept], [list(row) for row in rows]

    @property
    def on_page(self) -> tuple[Column, ...]:
        """The columns of a page."""
        return tuple(column for column, _ in self._columns_in("text"))

    @property
    def cells(self) -> list[list[Cell]]:
        """The rows of a page."""
        kept = self._columns_in("text")
        return [list(row) for row in zip(*(map(c.cell, values) for c, values in kept), strict=True)]


def table_of(name: str, rows: Iterable[Sequence[Any]], **words: str) -> Table:
    """Return a table of `tables.toml` with a value per column in each row.

    The last value of a shorter row, a measured one, has all columns that follow. `words` stand in
    its title and its heads, {first} for first=.
    """
    about = _tables()[name]
    title, caption = (about.get(key, "").format(**words) for key in ("title", "caption"))
    columns = [
        Column(**{**column, "head": column["head"].format(**words)})
        for entry in about["columns"]
        for column in (_tables()[entry]["columns"] if isinstance(entry, str) else [entry])
    ]
    filled = tuple((*row, *row[-1:] * (len(columns) - len(row))) for row in map(tuple, rows))
    return Table(name, caption, tuple(columns), filled, title)


@cache
def _tables() -> Mapping[str, Any]:
    return read_toml(Path(__file__).with_name("tables.toml"), "the tables", SeaidError)


def layout_of(part: str) -> Any:
    """Return the numbers of a part of a page, which `layout.toml` has, by their names."""
    numbers = read_toml(Path(__file__).with_name("layout.toml"), "the layout", SeaidError)[part]
    return make_dataclass("Layout", numbers, frozen=True)(**numbers)


def rendered(template: str, **content: Any) -> Any:
    """Return a page or a picture as markup; texts in the content are escaped."""
    from markupsafe import Markup

    return Markup(_environment().get_template(template).render(content))


@cache
def _environment() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("seaid.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["asset"] = _asset
    environment.filters |= {
        "counted": counted,
        "in_script": _in_script,
        "svg_path": svg_path,
        "share": share,
        "explained": explained_as,
    }
    environment.tests |= {"finite": math.isfinite, "partial": is_partial}
    return environment


def _asset(name: str) -> Any:
    """Return a file of the page verbatim: style, script, or the chart library."""
    from markupsafe import Markup

    return Markup((files("seaid.report") / "page" / name).read_text(encoding="utf-8"))


def _in_script(content: Any) -> Any:
    """Return JSON that is safe inside a <script>: without '<', '>', '&' and NaN."""
    from markupsafe import Markup

    text = json.dumps(plain(content), allow_nan=False, separators=(",", ":"))
    # "</script>" inside a text would end the script.
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)


def svg_path(points: Array) -> str:
    """Return the path of an SVG through points (P, 2)."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
