"""Tables: aligned, with the numbers of the result."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seaid.checks import JointCheck
from seaid.errors import Finding
from seaid.identification import SetupCheck, identify
from seaid.report import table, warning_lines
from seaid.report.formats import number, percent
from seaid.report.html_verdict import page_verdict
from seaid.report.text import (
    drive_table,
    identification_table,
    replay_table,
    setup_table,
    validation_table,
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


def test_a_table_is_aligned_and_its_words_are_no_markup() -> None:
    """The first column to the left and the others to the right, without spaces at the ends."""
    text = table("[bold]", ["name", "value"], [["a", "1"], ["longer", "1000"]])
    last = text.splitlines()[-2:]
    assert [line.strip().split() for line in last] == [["a", "1"], ["longer", "1000"]]
    assert last[0].index("a") == last[1].index("longer")
    assert len(last[0]) == len(last[1])
    assert all(line == line.rstrip() for line in text.splitlines())
    assert "[bold]" in text


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


def test_flags_and_the_truth_stand_next_to_the_estimate() -> None:
    """Findings have the mark of their severity, and a known value the change from it."""
    narrow = identify(arm().without_nominal(), arm_log().between(1.0, 2.6), cutoff_hz=10.0)
    assert narrow.warnings
    for flag in narrow.warnings:
        mark = {"wrong": "!", "doubtful": "?", "note": "-"}[flag.severity]
        assert f"{mark} {flag.code}: {flag}" in narrow.summary().splitlines()
    (line,) = lines(drive_table("Table 1", arm_found(), arm()), "shoulder", "stiffness")
    change = percent(arm_found().drives["shoulder"].value("stiffness") / 250 - 1)
    assert " 250 " in line
    assert f" {change} " in line


def test_validation_table_has_a_row_for_each_side_that_has_a_torque() -> None:
    """With the share of the samples counted where that is not all of them."""
    result = arm_result()
    text = validation_table(result)
    for side, fit in (("actuator", result.actuator), ("load", result.load)):
        (line,) = lines(text, "shoulder", side)
        assert f" {percent(fit.relative_error[1])} " in line
        (line,) = lines(text, "all joints", side)
        assert f" {percent(fit.whole_relative_error)} " in line
    (line,) = lines(text, "wrist")
    assert line.split()[1] == "load"
    assert percent(result.load.counted_share[3]) in line
    sides = {x: replace(getattr(result, x), counted_share=np.ones(4)) for x in ("actuator", "load")}
    text = validation_table(replace(result, **sides))
    (line,) = lines(text, "wrist")
    errors = (
        percent(one[3]) for one in (result.load.relative_error, result.load.raw_relative_error)
    )
    assert line.split() == ["wrist", "load", *" ".join(errors).split()]
    assert "counted" not in str(text)


@pytest.mark.parametrize(
    ("slides", "rows", "number"),
    [
        (
            (True, False, True, False),
            {"all revolute joints": "30 15 30 15 mrad", "all prismatic joints": "4 2 4 2 mm"},
            "15 mrad, 2 mm",
        ),
        ((False,) * 4, {"all joints": "17 8.5 17 8.5 mrad"}, "8.5 mrad"),
        ((True,) * 4, {"all joints": "17 8.5 17 8.5 mm"}, "8.5 mm"),
    ],
)
def test_mean_errors_of_a_replay_are_of_joints_with_one_unit(
    slides: tuple[bool, ...], rows: dict[str, str], number: str
) -> None:
    """Errors of 3, 20, 5 and 40 thousandths before the identification, and half of them after."""
    nothing, names = np.zeros((9, 4)), arm_found().robot.joint_names
    before = nothing + np.array([3.0, 20.0, 5.0, 40.0]) * 1e-3
    replays = (before, 0.5 * before)
    replay = ReplayComparison(names, np.arange(9.0), nothing, *replays, np.zeros(4), slides)
    means = lines(replay_table(replay), "all", "joints")
    assert [" ".join(line.split()) for line in means] == [f"{x} {y}" for x, y in rows.items()]
    (shown,) = [x for x in page_verdict(arm_found(), [], [replay]).numbers if x[0] == "Replay"]
    assert shown[1] == number
    assert f"{number} after" in repr(replay)
    if len(rows) > 1:
        assert replay.to_dict()["mean_absolute_error"] == {"before": None, "after": None}


def test_doubts_and_mistakes_end_with_the_sections_that_explain_their_codes() -> None:
    note = Finding("holes", "samples are missing", severity="note")
    late, reversed_torque = Finding("delay", "it is late"), Finding("sign", "it is reversed")
    *_, last = warning_lines([note, late, reversed_torque, late])
    assert last.endswith("report.html#about-delay, report.html#about-sign, or the page of warnings")
    page = (ROOT / "docs/warnings.md").read_text("utf-8")
    assert {"### delay", "### sign"} <= {*page.splitlines()}
    shown = "- holes: samples are missing"
    assert warning_lines([note] * 6) == [*[shown] * 4, "- holes: 2 more notes like these"]


def test_a_check_without_a_torque_or_two_encoders_says_what_was_not_compared() -> None:
    """A table of dashes above "nothing contradicts the set-up" says that all was compared."""
    for nominal, lines in ((0.1, 1), (math.nan, 2)):
        joints = {"pan": JointCheck(swing=2.0, nominal=nominal)}
        shown = str(setup_table(SetupCheck((), joints))).splitlines()
        assert shown[-lines:][0] == "nothing contradicts the set-up"
        assert (len(shown[-lines:]) == 2) == ("no second encoder" in shown[-1])
