"""Tables: aligned, with the numbers of the result."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seaid.checks import JointCheck
from seaid.errors import Finding
from seaid.identification.checking import SetupCheck
from seaid.identification.identification import identify, validate
from seaid.report.formats import number, percent
from seaid.report.html_verdict import page_verdict
from seaid.report.text import (
    drive_table,
    identification_table,
    load_table,
    replay_table,
    setup_table,
    table,
    validation_table,
    warning_lines,
)
from seaid.simulation import ReplayComparison
from tests.experiments import arm, arm_found, arm_log, arm_result

ROOT = Path(__file__).resolve().parents[2]


def estimates(summary: str) -> str:
    """Return the part of a summary before the checks, which name the parameters again."""
    return summary.split("Terms of the drives")[0].split("Drives\n", 1)[-1]


def lines(text: str, *words: str) -> list[str]:
    """Return the lines that hold all words."""
    return [line for line in text.splitlines() if all(word in line for word in words)]


def test_columns_are_aligned_first_left_others_right() -> None:
    text = table("Title", ["name", "value"], [["a", "1"], ["longer", "1000"]]).splitlines()
    assert text[0].strip() == "Title"
    a, longer = lines("\n".join(text), "a ")[-1], lines("\n".join(text), "longer")[0]
    assert a.index("a") == longer.index("longer")
    assert len(a) == len(longer)
    assert all(line == line.rstrip() for line in text)


def test_brackets_are_text_not_markup() -> None:
    assert "[N m] [bold]" in table("t", ["a"], [["[N m] [bold]"]])


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (83008.4, "8.301e+04"), (0.00456, "0.00456"), (np.nan, "-"), (np.inf, "-")],
)
def test_number_has_four_digits(value: float, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0123, "1.2 %"), (-0.004, "-0.4 %"), (1.5, "150 %"), (0.996, "100 %"), (np.nan, "-")],
)
def test_percent_has_two_digits(value: float, text: str) -> None:
    assert percent(value) == text


def test_summary_has_every_parameter_with_error_and_unit() -> None:
    summary = arm_found().summary()
    assert summary == identification_table(arm_found())
    assert summary.startswith("mixed_arm: good: no warning contradicts the set-up or the model\n")
    assert "mixed_arm: 14 base parameters from the torques at rail, shoulder," in summary
    for joint, estimate in arm_found().drives.items():
        for name, value, error, unit in zip(
            estimate.names, estimate.values, estimate.standard_errors, estimate.units, strict=True
        ):
            (line,) = lines(estimates(summary), joint, name)
            assert f" {number(value)} " in line
            assert f" {number(error)} " in line
            assert line.endswith(unit)
    for name, value in zip(arm_found().load.names, arm_found().load.values, strict=True):
        assert lines(summary, name[:50], number(value))
    assert f"{arm_found().load_side.condition_number:.3g}" in summary


def test_summary_is_aligned() -> None:
    """Units are right-aligned, so all lines of a table end at the same place."""
    rows = lines(estimates(arm_found().summary()), "friction")
    assert len(rows) == 8
    assert len({len(line) for line in rows if line.endswith("N m")}) == 1


def test_flags_are_in_the_summary() -> None:
    narrow = identify(
        arm().without_nominal(),
        arm_log().between(1.0, 2.6),
        cutoff_hz=10.0,
    )
    assert narrow.warnings
    for flag in narrow.warnings:
        mark = {"wrong": "!", "doubtful": "?", "note": "-"}[flag.severity]
        assert f"{mark} {flag.code}: {flag}" in narrow.summary().splitlines()


def test_truth_stands_next_to_the_estimate() -> None:
    (line,) = lines(drive_table("Table 1", arm_found(), arm()), "shoulder", "stiffness")
    value = arm_found().drives["shoulder"].value("stiffness")
    assert " 250 " in line
    assert f" {percent(value / 250 - 1)} " in line
    (line,) = lines(load_table("Base", arm_found(), arm()), "m_carriage + m_upper_arm")
    assert " 5 " in line
    assert "s.e." in line


def test_validation_table_has_a_row_for_each_side_that_has_a_torque() -> None:
    result = validate(arm_found(), arm_log(2, motion_seed=5))
    text = validation_table(result)
    for side, fit in (("actuator", result.actuator), ("load", result.load)):
        (line,) = lines(text, "shoulder", side)
        assert f" {percent(fit.relative_error[1])} " in line
        (line,) = lines(text, "all joints", side)
        assert f" {percent(fit.whole_relative_error)} " in line
        assert line.split()[-1] == "-"
    (line,) = lines(text, "rail")
    assert line.split()[1] == "load"


def test_validation_table_has_the_share_of_the_samples_counted_where_it_is_not_all() -> None:
    result = arm_result()
    (line,) = lines(validation_table(result), "wrist")
    assert percent(result.load.counted_share[3]) in line
    assert percent(result.load.relative_error_with_standstill[3]) in line
    every = np.ones(4)
    sides = [replace(one, counted_share=every) for one in (result.actuator, result.load)]
    text = validation_table(replace(result, actuator=sides[0], load=sides[1]))
    (line,) = lines(text, "wrist")
    numbers = [
        percent(one[3]) for one in (result.load.relative_error, result.load.raw_relative_error)
    ]
    assert line.split() == ["wrist", "load", *" ".join(numbers).split()]
    assert "counted" not in str(text)


MM, MRAD = (3.0, 5.0), (20.0, 40.0)
"""Errors of the rail and the telescope, and of the shoulder and the wrist, before; after: half."""


def replayed(*slides: bool) -> ReplayComparison:
    """Return a replay of the arm with constant errors, before twice those after."""
    nothing, names = np.zeros((9, 4)), arm_found().robot.joint_names
    errors = np.array([MM[0], MRAD[0], MM[1], MRAD[1]]) * 1e-3
    replays = (nothing + errors, nothing + 0.5 * errors)
    return ReplayComparison(names, np.arange(9.0), nothing, *replays, np.zeros(4), slides)


def test_mean_errors_of_a_replay_are_of_joints_with_one_unit() -> None:
    mixed = replayed(*(bool(slides) for slides in arm().is_prismatic))
    text = replay_table(mixed)
    (turning,) = lines(text, "all revolute joints", "mrad")
    assert turning.split()[3:] == ["30", "15", "30", "15", "mrad"]
    (sliding,) = lines(text, "all prismatic joints", "mm")
    assert sliding.split()[3:] == ["4", "2", "4", "2", "mm"]
    assert not lines(text, "all joints")
    (number_of_replay,) = [
        x for x in page_verdict(arm_found(), [], [mixed]).numbers if x[0] == "Replay"
    ]
    assert number_of_replay[1] == "15 mrad, 2 mm"
    assert number_of_replay[2] == "mean absolute error of the joints; 30 mrad, 4 mm before"
    assert "mean absolute error 30 mrad, 4 mm before, 15 mrad, 2 mm after" in repr(mixed)
    assert mixed.to_dict()["mean_absolute_error"] == {"before": None, "after": None}


@pytest.mark.parametrize(("slides", "unit"), [(False, "mrad"), (True, "mm")])
def test_mean_errors_of_a_replay_are_of_all_joints_if_they_have_one_unit(
    slides: bool, unit: str
) -> None:
    replay = replayed(*[slides] * 4)
    (line,) = lines(replay_table(replay), "all joints")
    assert line.split() == ["all", "joints", "17", "8.5", "17", "8.5", unit]
    verdict = page_verdict(arm_found(), [], [replay])
    assert ("Replay", f"8.5 {unit}") in [x[:2] for x in verdict.numbers]


def test_doubts_and_mistakes_end_with_the_sections_that_explain_their_codes() -> None:
    note = Finding("holes", "samples are missing", severity="note")
    late, reversed_torque = Finding("delay", "it is late"), Finding("sign", "it is reversed")
    *_, last = warning_lines([note, late, reversed_torque, late])
    assert last == "Causes and advice: docs/warnings.md#delay, #sign"
    page = (ROOT / "docs/warnings.md").read_text("utf-8")
    assert {"### delay", "### sign"} <= {*page.splitlines()}
    assert warning_lines([note]) == ["- holes: samples are missing"]


def test_a_payload_is_advised_as_an_option_and_as_the_table_of_a_project() -> None:
    """In a project the option of a command is of no use."""
    remedy = "option: --payload foot:1.9:0.15,0,-0.1"
    finding = Finding("payload", "a payload was not named", "knee", "wrong", remedy=remedy)
    _, option, *project, _ = warning_lines([finding])
    assert option == f"    {remedy}, or in seaid.toml"
    content = tomllib.loads("\n".join(project))
    assert content == {"payload": [{"link": "foot", "mass_kg": 1.9, "com_m": [0.15, 0, -0.1]}]}
    absent = replace(finding, remedy="option: without --payload foot:2:0.15,0,0")
    assert warning_lines([absent])[1] == f"    {absent.remedy}"


def test_a_check_without_a_torque_or_two_encoders_says_what_was_not_compared() -> None:
    """A table of dashes above "nothing contradicts the set-up" says that all was compared."""
    for nominal, lines in ((0.1, 1), (math.nan, 2)):
        joints = {"pan": JointCheck(swing=2.0, nominal=nominal)}
        shown = str(setup_table(SetupCheck((), joints))).splitlines()
        assert shown[-lines:][0] == "nothing contradicts the set-up"
        assert (len(shown[-lines:]) == 2) == ("no second encoder" in shown[-1])
