"""How objects show themselves: one line, a table as text, the same table in HTML."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pandas as pd
import pytest

import seaid
from seaid._arrays import Array
from seaid._progress import Display, Result, counted, value_text
from seaid.report import base_table, fields_table, table
from seaid.report.text import Text, joined
from tests.experiments import arm, arm_log


@pytest.fixture(scope="module")
def log() -> seaid.Log:
    return arm_log()


@pytest.fixture(scope="module")
def found(log: seaid.Log) -> seaid.Identification:
    return seaid.identify(arm().without_nominal(), log, feasible=True)


def test_a_robot_and_its_drives_in_one_line() -> None:
    assert repr(arm()) == "Robot('mixed_arm': 4 joints, 2 springs)"
    drive = seaid.StiffDrive(gear_ratio=50.0, motor_input="current")
    assert repr(drive) == "StiffDrive(motor_input='current', gear_ratio=50.0)"
    assert repr(seaid.Payload("foot", 2.0)) == "Payload(link='foot', mass=2.0)"
    assert eval(repr(drive), {"StiffDrive": seaid.StiffDrive}) == drive
    assert repr(seaid.Noise()) == "Noise()"


def test_a_log_and_its_motion_in_one_line(log: seaid.Log) -> None:
    sensors = "motor position, joint position, motor torque"
    samples = "6,001 samples, 6.00 s at 1000 Hz, joints rail, shoulder, telescope, wrist"
    assert repr(log) == f"Log({samples}: {sensors})"
    motion = seaid.reconstruct_motion(arm(), log, 8.0)
    assert repr(motion) == f"Motion({samples}, cutoff 8 Hz)"


def test_results_in_one_line(log: seaid.Log, found: seaid.Identification) -> None:
    cutoff, warnings = f"{found.cutoff_hz:.3g} Hz", len(found.warnings)
    noun = "warning" if warnings == 1 else "warnings"
    count = len(found.load.names)
    line = f"'mixed_arm': 4 drives, {count} base parameters, cutoff {cutoff}, {warnings} {noun}"
    assert repr(found) == f"Identification({line})"
    spring = found.drives["shoulder"]
    assert repr(spring).startswith("Estimate(5 parameters: viscous_friction ")
    assert f"stiffness {spring.value('stiffness'):.4g} +- " in repr(spring)
    result = seaid.validate(found, log)
    worst = np.nanmax(result.actuator.relative_error)
    assert f"relative error at most {100 * worst:.2g} % (motor torque), " in repr(result)
    assert repr(found.base).startswith(f"BaseParameters({count} combinations of 40 parameters, ")
    assert found.feasible is not None
    assert f"over {len(found.feasible.values)} values" in repr(found.feasible)


def things(log: seaid.Log, found: seaid.Identification) -> Iterator[Display]:
    """Yield objects that a user sees."""
    robot, base = arm(), found.base
    yield from (robot, *robot.drives.values(), log, seaid.reconstruct_motion(robot, log))
    yield from (found, found.load, found.drives["shoulder"], seaid.validate(found, log), base)
    yield from (seaid.cross_check(base, base), seaid.identifiability(robot), seaid.Limits())
    yield from (seaid.EndState(), seaid.Repairs(), seaid.Box((0, 0, 1), (1, 1, 1)))
    yield seaid.gear_ratio(log.motor_position[:, 3], log.joint_position[:, 3])
    if found.feasible is not None:
        yield found.feasible


class Cells(HTMLParser):
    """The texts of a piece of HTML; every tag that it opens it closes."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts += data.split()


def words_of_html(html: str) -> list[str]:
    parser = Cells()
    parser.feed(html)
    assert parser.open == []
    return parser.texts


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
        text = str(getattr(seaid.report, one.table_name)(one))
        plain = [word for word in text.split() if set(word) != {"─"}]
        assert sorted(words_of_html(one._repr_html_())) == sorted(plain)
        if isinstance(one, Result):
            assert one.summary() == str(one) == text
        else:
            assert str(one) == line or type(one).__str__ is not object.__str__
    assert len(kinds) == 17


def test_html_is_escaped() -> None:
    made = joined([table("<b>", ["<i>"], [["a & b"]]), "! <u>"])
    assert "<b>" not in made.html
    assert '<td style="text-align: left">a &amp; b</td>' in made.html
    assert made.html.endswith('<div style="white-space: pre-wrap">! &lt;u&gt;</div>')
    assert made._repr_html_() == made.html
    assert isinstance(made, Text)
    assert made.splitlines()[-1] == "! <u>"


def test_a_name_of_a_user_stays_in_its_line() -> None:
    robot = replace(arm(), name="two\nlines" + "x" * 1_000)
    assert "two\\nlines" in repr(robot)
    assert len(repr(robot)) < 330


def test_values_are_short() -> None:
    assert value_text(np.zeros((3, 2))) == "array (3, 2)"
    assert value_text(np.array([1.0, 2.0])) == "[1.0, 2.0]"
    assert value_text(list(range(100))) == "100 entries"
    assert value_text("x" * 1_000) == "'" + "x" * 77 + " …"
    assert counted(1, "joint") == "1 joint"
    assert counted(1200, "sample") == "1,200 samples"


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


def test_base_parameters_are_listed_whole() -> None:
    base = seaid.base_parameters(arm())
    lines = [line.strip() for line in base_table(base).splitlines()[4:]]
    assert lines == list(base.expressions)


def test_an_estimate_as_a_data_frame(found: seaid.Identification) -> None:
    spring = found.drives["shoulder"]
    frame = spring.to_dataframe()
    assert list(frame.columns) == ["name", "value", "standard_error", "unit", "lower", "upper"]
    assert tuple(frame["name"]) == spring.names
    assert tuple(frame["unit"]) == spring.units
    row = frame.set_index("name").loc["stiffness"]
    assert row["value"] == spring.value("stiffness")
    assert row["standard_error"] == spring.standard_error("stiffness")
    lower, upper = spring.interval(0.95)[spring.names.index("stiffness")]
    assert (row["lower"], row["upper"]) == (lower, upper)
    # wider than the normal interval, since the log has few independent rows
    assert upper - lower > 2 * 1.959963984540054 * row["standard_error"]
    assert isinstance(frame, pd.DataFrame)


def test_without_pandas_the_error_says_how_to_get_it(
    found: seaid.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(seaid.SeaidError, match="needs pandas: get it with pip install pandas"):
        found.load.to_dataframe()
