"""The judge of the gauntlet: mistakes do harm, remedies repair them, and letters say so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import seaid
from scripts import gauntlet
from scripts.gauntlet_mistakes import Case, Mistake, Setup, mistakes, scaled
from scripts.gauntlet_robots import Columns, Subject, subjects
from seaid.errors import Finding
from tests.representatives import quick_first

REMEDY = """in the description of the log:
[joints.{0}]
motor_torque = {{ column = "{0}.motor_torque_Nm", unit = "mNm" }}"""


def setup(**changed: Any) -> Setup:
    """Return a set-up without samples."""
    log: Columns = {"time_s": np.arange(3.0)}
    given = {"urdf": "", "drives": {"a": {"gear_ratio": 2.0}}, "payloads": ("foot:2:0.1,0,0",)}
    return Setup(**{**given, "logs": (log, log), "descriptions": ({}, {}), **changed})


@pytest.mark.parametrize(
    ("remedy", "changed"),
    [
        (
            'in the description of the log:\ntime = { column = "time_s", unit = "ms" }',
            {"descriptions": ({"time": {"column": "time_s", "unit": "ms"}},) * 2},
        ),
        (
            'it is in ns; in the description of the log:\ntime = { unit = "ns" }',
            {"descriptions": ({"time": {"unit": "ns"}},) * 2},
        ),
        (
            "in the description of the second log:\n[joints.a]\nmotor_position.offset = 1.0",
            {"descriptions": ({}, {"joints": {"a": {"motor_position": {"offset": 1.0}}}})},
        ),
        (
            "in the drives file:\n[a]\nfriction = ['viscous', 'offset']",
            {"drives": {"a": {"gear_ratio": 2.0, "friction": ["viscous", "offset"]}}},
        ),
        ("name the payload: --payload foot:1:0,0,0", {"payloads": ("foot:1:0,0,0",)}),
        ("run it without --payload foot:2:0.1,0,0", {"payloads": ()}),
        ("--gravity 9.81,0,0", {"gravity": (9.81, 0.0, 0.0)}),
        ("read it with --repair", {"repair": True}),
        ("use --method simultaneous", {"options": {"method": "simultaneous"}}),
        ("measure again", {}),
    ],
)
def test_remedy_is_applied_as_it_is_printed(remedy: str, changed: Mapping[str, Any]) -> None:
    found, expected = gauntlet.with_remedy(setup(), setup(), remedy), setup(**changed)
    assert gauntlet.same(found, expected)


def test_every_mistake_has_a_code_and_changes_what_a_robot_can_have() -> None:
    titles = [one.title for one in mistakes()]
    assert len(set(titles)) == len(titles) > 80
    assert all(one.codes for one in mistakes())


@pytest.fixture(scope="module")
def arm() -> Subject:
    pytest.importorskip("mujoco")
    return subjects()["stiff"]


def judged(
    arm: Subject, monkeypatch: pytest.MonkeyPatch, code: str, severity: str = "wrong"
) -> gauntlet.Outcome:
    """Judge torques of one joint in mN m, if `identify` says nothing but a code, until repaired."""
    mistake = Mistake("mN m", "severe", frozenset({"unit"}), (), scaled("motor_torque", 1e3, False))
    identify = seaid.identify

    def silent(robot: Any, logs: Any) -> Any:
        found, torque = identify(robot, logs), logs[0].motor_torque[:, robot.index(arm.joint)]
        is_wrong, remedy = np.max(np.abs(torque)) > 50, REMEDY.format(arm.joint)
        kind: Any = severity
        said = (Finding(code, "x", arm.joint, kind, remedy=remedy),) if is_wrong and code else ()
        found.__dict__["warnings"] = said
        return found

    monkeypatch.setattr(seaid, "identify", silent)
    outcome = gauntlet.judge(Case(arm), mistake)
    assert outcome is not None
    return outcome


@pytest.mark.parametrize(
    ("code", "severity", "letter"),
    quick_first(
        [
            ("unit", "wrong", "R"),
            ("unit", "note", "-"),
            ("payload", "wrong", "D"),
            ("", "wrong", "-"),
        ]
    ),
)
def test_letter_of_a_case(
    arm: Subject, monkeypatch: pytest.MonkeyPatch, code: str, severity: str, letter: str
) -> None:
    outcome = judged(arm, monkeypatch, code, severity)
    assert outcome.letter == letter
    assert outcome.worst_error > 1.0
    if letter == "R":
        assert outcome.repaired_error is not None
        assert outcome.repaired_error < 0.05


def test_right_set_up_predicts_the_unseen_motion(arm: Subject) -> None:
    errors = gauntlet.right_errors(arm.name, 0)
    assert np.max(errors) < 0.03
    assert gauntlet.is_right(Case(arm), errors)
    assert not gauntlet.is_right(Case(arm), errors + 0.05)


@pytest.mark.slow  # 0.8 s
def test_report_counts_what_was_found(arm: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    outcomes = [judged(arm, monkeypatch, "unit")]
    assert gauntlet.matrix(outcomes, ["leg", "stiff"]) == [["mN m", "severe", ".", "R"]]
    assert gauntlet.summary(outcomes)[0][1] == "1 of 1, 100%"
    assert gauntlet.problems(outcomes) == []
