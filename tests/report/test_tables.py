"""Tables: made once, and the same numbers in a terminal and on a page."""

import math
import re
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from seaid.legged import ContactForces
from seaid.report import comparison_of, tables
from seaid.report.formats import FORMATS, Cell, Column, Measured, Table, _tables, table_of
from seaid.report.html_charts import Run
from tests.experiments import arm, arm_found, arm_result, leg
from tests.report.test_comparison import made, of_loads
from tests.report.test_formats import read

MAKERS: dict[str, Callable[[], Table]] = {
    "drives": lambda: tables.drive_table(arm_found(), arm()),
    "load": lambda: tables.load_table(arm_found().load, arm_found().base.project(arm().parameters)),
    "terms": lambda: tables.term_table(arm_found()),
    "residuals": lambda: tables.residual_table(arm_found()),
    "regressions": lambda: tables.condition_table(arm_found()),
    "predictions": lambda: tables.error_table(
        tables.error_rows([Run("validation", arm_result(), True)], arm())
    ),
}


def unit(text: str) -> float:
    """Return one in the last digit that is written, at most over the number."""
    digits = re.sub(r"\D", "", re.split("[e·]", text)[0]).lstrip("0")
    return 10.0 ** (1 - len(digits))


@pytest.mark.parametrize("name", MAKERS)
def test_a_terminal_and_a_page_show_the_same_numbers(name: str) -> None:
    table = MAKERS[name]()
    heads, rows = table.texts
    assert len(rows) == len(table.cells) == len(table.rows) > 0
    places = {column.head: place for place, column in enumerate(table.on_page)}
    compared = 0
    for texts, cells in zip(rows, table.cells, strict=True):
        for head, text in zip(heads, texts, strict=True):
            if head not in places or head in ("95 % interval", "p"):
                continue
            number = text.removeprefix("x ").removesuffix(" %")
            shown = cells[places[head]].text.removeprefix("× ").strip("+%\N{NO-BREAK SPACE}")
            if re.fullmatch(r"-?[\d.]+(e[-+]\d+)?", number):
                within = 0.51 * (unit(number) + unit(shown))
                assert read(shown) == pytest.approx(float(number), rel=within), head
                compared += 1
    assert compared >= len(rows)


def test_what_is_not_known_has_one_dash_and_what_is_far_below_the_largest_is_0() -> None:
    """No "– ± –" for a gear ratio, and no centre of mass of 6.8·10⁻¹⁰ m next to 0.12 m."""
    assert FORMATS["value and error"].page(Measured(math.nan, math.nan)) == "–"
    robot = arm_found().robot
    bodies = robot.parameters.reshape(-1, 10).copy()
    bodies[0] = [2.0, 2 * 6.78e-10, 2 * 3.93e-5, -2 * 0.1234, 0.2, 0.0, 0.2, 0.0, 0.0, 0.2]
    nominal = robot.with_values(bodies.ravel(), robot.drives)
    (row, *_) = tables.bodies_table(arm_found(), nominal).rows
    assert row[4] == "0 0 −0.123"


def test_a_unit_is_the_last_column_of_a_terminal_and_stays_in_its_place_on_a_page() -> None:
    columns = (Column("joint", "words"), Column("unit", "unit"), Column("error", "share"))
    table = Table("a", "", columns, (("knee", "kg m^2", 0.5),))
    assert table.texts == (["joint", "error", "unit"], [["knee", "50 %", "kg m^2"]])
    assert [column.page_head for column in table.on_page] == ["Joint", "Unit", "Error"]
    assert [cell.text for cell in table.cells[0]] == [
        *("knee", "kg\N{NO-BREAK SPACE}m²", "50\N{NO-BREAK SPACE}%")
    ]


def test_columns_of_one_place_and_columns_without_a_value_are_left_out() -> None:
    columns = (
        Column("joint", "words"),
        Column("nominal", "nominal", is_optional=True),
        Column("interval", "interval", "page"),
        Column("off", "off", "text"),
        Column("note", "figure"),
    )
    unknown, known = Measured(2.0, 0.5, 1.0, 3.0), Measured(2.0, 0.5, 1.0, 3.0, nominal=1.0)
    bare = Table("a", "", columns, (("knee", *[unknown] * 3, "–"),))
    assert bare.texts == (["joint", "off", "note"], [["knee", "-", "-"]])
    both = replace(bare, rows=tuple(("knee", *[value] * 3, "") for value in (unknown, known)))
    assert both.texts[1] == [["knee", "-", "-", ""], ["knee", "1", "+2.0 s.e.", ""]]
    assert [column.head for column in both.on_page] == ["joint", "nominal", "interval", "note"]
    assert both.cells[1][2] == Cell("1.00 … 3.00")


@pytest.mark.parametrize("name", _tables())
def test_every_declared_table_has_columns_of_known_kinds(name: str) -> None:
    """A measured value at the end of a row has all columns that follow."""
    words = {"head": "parameter", "first": "{cold}", "second": "warm", "count": "3"}
    table = table_of(name, [("knee", Measured(2.0, 0.5))], **words)
    assert {column.kind for column in table.columns} <= set(FORMATS)
    assert {column.where for column in table.columns} <= {"both", "text", "page"}
    assert len(table.rows[0]) == len(table.columns)
    assert not [x for x in (table.title, table.caption) if "  " in x or "{first}" in x]


def test_the_residual_of_torques_and_forces_together_has_no_unit() -> None:
    """Joints that slide have forces; those of the leg all turn."""
    for robot, unit in ((arm(), ""), (leg(), "N m")):
        heads, (row,) = tables.condition_table(replace(arm_found(), robot=robot)).texts
        assert row[heads.index("unit")] == unit


def test_a_page_has_no_capital_in_a_name_of_the_user() -> None:
    heads = [Column("cold.csv", is_name=True), Column("std. error"), Column("p"), Column("BIC")]
    assert [head.page_head for head in heads] == ["cold.csv", "Std. error", "p", "BIC"]


def test_a_value_and_its_interval_make_its_note() -> None:
    notes = [Measured(1.0, e, low, 2.0).note for e, low in ((0.05, 0.9), (0.2, 0.6), (0.6, -0.2))]
    assert notes == ["", "poorly determined", "may be zero"]
    assert Measured(1.0, math.inf).note == "unidentifiable"
    assert math.isnan(Measured(0.0, 0.1).relative)
    assert Measured(-2.0, 0.5).relative == 0.25


def test_the_change_of_a_negative_parameter_has_the_sign_of_its_significance() -> None:
    """From -2 to -3 is a change by -50 % of the size, in the text and on the page."""
    first, second = (made([value], [0.1], np.inf) for value in (-2.0, -3.0))
    table = tables.difference_table(comparison_of(*of_loads(first, second)))
    places = {column.head: place for place, column in enumerate(table.on_page)}
    cells = table.cells[0]
    assert cells[places["change"]].text == "−50\N{NO-BREAK SPACE}%"
    assert cells[places["change / s.e."]].text == "−7.1"
    heads, (texts,) = table.texts
    shown = dict(zip(heads, texts, strict=True))
    assert (shown["difference"], shown["change"], shown["change / s.e."]) == ("-1", "-50 %", "-7.1")


def test_forces_that_are_not_known_are_dashes() -> None:
    nothing, one = np.full((3, 1, 3), np.nan), np.array([np.nan])
    values: dict[str, Any] = {field.name: one for field in fields(ContactForces)}
    values |= {"links": ("foot",), "basis": ("none",), "predicted": nothing, "measured": nothing}
    values |= {"weight": 157.8, "vertical": math.nan, "measured_vertical": math.nan}
    table = tables.contact_table("validation", ContactForces(**values))
    assert table.texts[1] == [["foot", "none", *["-"] * 7]]
    assert {cell.text for cell in table.cells[0][2:]} == {"–"}
    assert table.caption.endswith("Normal forces in sum: weight 157.8 N.")


def test_a_page_without_room_shortens_groupings_with_a_note(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tables, "_GROUPINGS_ROOM", 10)
    name = " + ".join(f"0.1 m_{k}" for k in range(40))
    estimate = made([1.0], [0.1], np.inf).part([0], [name])
    (row,) = tables.load_table(estimate).cells
    assert row[0].more.endswith("… (40 terms; parameters.json has them all)")
    assert len(row[0].more) < 120
