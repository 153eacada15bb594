"""How objects show themselves: one line, a table as text, the same table in HTML."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid._progress import Display, Result, counted, value_text
from seaid.report.text import base_table, fields_table
from tests.experiments import arm, arm_log


@pytest.fixture(scope="module")
def log() -> seaid.Log:
    return arm_log()


@pytest.fixture(scope="module")
def found(log: seaid.Log) -> seaid.Identification:
    return seaid.identify(arm().without_nominal(), log, feasible=True)


@pytest.mark.parametrize(
    ("number", "noun", "text"),
    [
        (1, "joint", "1 joint"),
        (0, "joint", "0 joints"),
        (1, "body", "1 body"),
        (2, "body", "2 bodies"),
        (3, "frequency", "3 frequencies"),
        (2, "delay", "2 delays"),
        (1200, "more entry", "1,200 more entries"),
    ],
)
def test_a_number_with_its_noun(number: int, noun: str, text: str) -> None:
    assert counted(number, noun) == text


def test_a_drive_is_made_of_its_line_again_and_a_long_name_is_cut() -> None:
    drive = seaid.StiffDrive(gear_ratio=50.0, motor_input="current")
    assert eval(repr(drive), {"StiffDrive": seaid.StiffDrive}) == drive
    assert repr(arm()) == "Robot('mixed_arm': 4 joints, 2 springs)"
    name = repr(replace(arm(), name="two\nlines" + "x" * 1_000))
    assert "two\\nlines" in name
    assert len(name) < 330


def things(log: seaid.Log, found: seaid.Identification) -> Iterator[Display]:
    """Yield objects that a user sees."""
    robot, base = arm(), found.base
    yield from (robot, *robot.drives.values(), log, seaid.reconstruct_motion(robot, log))
    yield from (found, found.load, found.drives["shoulder"], seaid.validate(found, log), base)
    yield from (seaid.cross_check(base, base), seaid.identifiability(robot), seaid.Limits())
    yield from (
        seaid.excitation.EndState(),
        seaid.Repairs(),
        seaid.excitation.Box((0, 0, 1), (1, 1, 1)),
    )
    if found.feasible is not None:
        yield found.feasible


def words_of_html(html: str) -> list[str]:
    """Return the texts of a piece of HTML, whose tags are all closed."""
    return " ".join(ElementTree.fromstring(f"<div>{html}</div>").itertext()).split()


def test_every_object_has_one_line_and_html_with_the_content_of_its_text(
    log: seaid.Log, found: seaid.Identification
) -> None:
    kinds = set()
    for one in things(log, found):
        kinds.add(type(one).__name__)
        line = repr(one)
        assert "\n" not in line
        assert len(line) <= 330
        assert line.startswith(f"{type(one).__name__}(")
        text = str(getattr(seaid.report.text, one.table_name)(one))
        assert words_of_html(one._repr_html_()) == text.split()
        if isinstance(one, Result):
            assert one.summary() == str(one) == text
        else:
            assert str(one) == line or type(one).__str__ is not object.__str__
    assert len(kinds) == 16
    lines = [line.strip() for line in base_table(found.base).splitlines()[4:]]
    assert lines == list(found.base.expressions)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.zeros((3, 2)), "array (3, 2)"),
        (np.array([1.0, 2.0]), "[1.0, 2.0]"),
        (list(range(100)), "100 entries"),
        ("x" * 1_000, "'" + "x" * 77 + " …"),
    ],
)
def test_values_are_short(value: Any, text: str) -> None:
    assert value_text(value) == text


def test_fields_at_their_defaults_are_not_shown() -> None:
    @dataclass(frozen=True, eq=False, repr=False)
    class Example(Display):
        name: str
        values: Array
        hidden: int = field(default=3, repr=False)
        usual: tuple[str, ...] = ("a",)
        other: int = 1

    one = Example("x", np.zeros(5), 4, ("a",), 2)
    assert repr(one) == "Example(name='x', values=array (5,), other=2)"
    assert [line.split() for line in fields_table(one).splitlines()[4:]] == [
        ["name", "'x'"],
        ["values", "array", "(5,)"],
        ["other", "2"],
    ]


def test_an_estimate_as_a_data_frame(
    found: seaid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With intervals wider than normal ones, since the log has few independent rows."""
    spring = found.drives["shoulder"]
    frame = spring.to_dataframe()
    assert list(frame.columns) == ["name", "value", "standard_error", "unit", "lower", "upper"]
    assert (tuple(frame["name"]), tuple(frame["unit"])) == (spring.names, spring.units)
    np.testing.assert_array_equal(frame["value"], spring.values)
    np.testing.assert_array_equal(frame["standard_error"], spring.standard_errors)
    np.testing.assert_array_equal(frame[["lower", "upper"]], spring.interval(0.95))
    assert np.all(frame["upper"] - frame["lower"] > 2 * 1.959963984540054 * frame["standard_error"])
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(seaid.SeaidError, match="needs pandas: get it with pip install pandas"):
        spring.to_dataframe()
