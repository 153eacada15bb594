"""The judge of the gauntlet: mistakes do harm, remedies repair them, and letters say so."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

import seaid
from scripts import gauntlet
from scripts.gauntlet_mistakes import Case, Mistake, Setup, scaled
from scripts.gauntlet_robots import Columns, Subject, subjects
from seaid.errors import Finding

REMEDY = """in the description of the log:
[joints.{0}]
motor_torque = {{ column = "{0}.motor_torque_Nm", unit = "mNm" }}"""


@pytest.fixture(scope="module")
def arm() -> Subject:
    pytest.importorskip("mujoco")
    return subjects()["stiff"]


def in_log(text: str) -> str:
    return f"in the description of the log:\n{text}"


OFFSET = "[joints.a]\nmotor_position.offset = 1.0"
DRIVE = {"a": {"gear_ratio": 2.0}}
TERMS = {"a": {"gear_ratio": 2.0, "friction": ["viscous", "offset"]}}


@pytest.mark.parametrize(
    ("remedy", "changed"),
    [
        (in_log('time = { unit = "ns" }'), {"descriptions": ({"time": {"unit": "ns"}},) * 2}),
        (
            f"in the description of the second log:\n{OFFSET}",
            {"descriptions": ({}, {"joints": {"a": {"motor_position": {"offset": 1.0}}}})},
        ),
        ("in the drives file:\n[a]\nfriction = ['viscous', 'offset']", {"drives": TERMS}),
        ("name the payload: --payload foot:1:0,0,0", {"payloads": ("foot:1:0,0,0",)}),
        ("run it without --payload foot:2:0.1,0,0", {"payloads": ()}),
        ("--gravity 9.81,0,0", {"gravity": (9.81, 0.0, 0.0)}),
        ("read it with --repair", {"repair": True}),
        ("use --method simultaneous", {"options": {"method": "simultaneous"}}),
        ("tighten it, or exclude its torque (--torque-joints a)", {}),
    ],
)
def test_remedy_is_applied_as_it_is_printed(remedy: str, changed: Mapping[str, Any]) -> None:
    """A remedy is a file's text, an option, or advice that changes nothing."""
    log: Columns = {"time_s": np.arange(3.0)}
    setup = Setup("", DRIVE, ("foot:2:0.1,0,0",), (log, log), ({}, {}))
    expected = replace(setup, **changed)
    assert gauntlet.same(gauntlet.with_remedy(setup, setup, remedy), expected)


def test_every_mistake_has_a_code_and_changes_what_a_robot_can_have() -> None:
    every = gauntlet.every_mistake()
    titles = [one.title for one in every]
    assert len(set(titles)) == len(titles) > 120
    assert all(one.codes for one in every)


def test_another_code_is_a_false_explanation_unless_it_names_the_right_one_as_a_rival() -> None:
    right = gauntlet.Said("delay", "doubtful", "a", "")
    rival = gauntlet.Said("sign", "wrong", "a", "", rivals=("delay",))
    other, note = (gauntlet.Said("unit", kind, "a", "") for kind in ("doubtful", "note"))
    outcome = partial(gauntlet.Outcome, "late", "severe", "arm", 0, "N", 1.0, codes=("delay",))
    assert outcome(said=(right, other, note)).false_codes == ["unit"]
    assert outcome(said=(rival, note)).false_codes == []
    found = [outcome(said=(right, other)), outcome(said=(rival,))]
    assert gauntlet.false_explanations(found) == [["late", "severe", "unit", "arm"]]


@pytest.mark.slow  # identifies an arm twice and more
@pytest.mark.parametrize(
    ("code", "severity", "letter"),
    [("unit", "note", "-"), ("unit", "wrong", "R"), ("payload", "wrong", "D"), ("", "wrong", "-")],
)
def test_letter_of_a_case(
    arm: Subject, monkeypatch: pytest.MonkeyPatch, code: str, severity: Any, letter: str
) -> None:
    """Torques are in mN m, and `identify` reports one code alone until they are repaired."""
    mistake = Mistake("mN m", "severe", frozenset({"unit"}), (), scaled("motor_torque", 1e3, False))
    identify = seaid.identify

    def silent(robot: Any, logs: Any) -> Any:
        found, torque = identify(robot, logs), logs[0].motor_torque[:, robot.index(arm.joint)]
        finding = Finding(code, "x", arm.joint, severity, remedy=REMEDY.format(arm.joint))
        is_wrong = code and np.max(np.abs(torque)) > 50
        found.__dict__["weighed_findings"] = (finding,) if is_wrong else ()
        return found

    monkeypatch.setattr(seaid, "identify", silent)
    outcome = gauntlet.judge(Case(arm), mistake)
    assert outcome is not None
    assert outcome.letter == letter
    assert outcome.worst_error > 1.0
    if letter == "R":
        assert outcome.repaired_error is not None
        assert outcome.repaired_error < 0.05
        assert gauntlet.matrix([outcome], ["leg", "stiff"]) == [["mN m", "severe", ".", "R"]]
        assert gauntlet.summary([outcome])[0][1] == "1 of 1, 100%"
        assert gauntlet.problems([outcome]) == []
