"""The judge of the gauntlet: mistakes do harm, remedies repair them, and letters say so."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import pytest

import seaid
from scripts import gauntlet
from scripts.gauntlet_joints import joint_mistakes
from scripts.gauntlet_mistakes import Case, Mistake, Setup, scaled
from scripts.gauntlet_robots import Columns, Subject, load, subjects, true_robot
from seaid.errors import Finding
from tests.representatives import quick_first

REMEDY = """in the description of the log:
[joints.{0}]
motor_torque = {{ column = "{0}.motor_torque_Nm", unit = "mNm" }}"""


@pytest.fixture(scope="module")
def arm() -> Subject:
    pytest.importorskip("mujoco")
    return subjects()["stiff"]


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
        ("tighten it, or exclude its torque (--torque-joints a)", {}),
        ("measure again", {}),
    ],
)
def test_remedy_is_applied_as_it_is_printed(remedy: str, changed: Mapping[str, Any]) -> None:
    found, expected = gauntlet.with_remedy(setup(), setup(), remedy), setup(**changed)
    assert gauntlet.same(found, expected)


def test_every_mistake_has_a_code_and_changes_what_a_robot_can_have() -> None:
    every = gauntlet.every_mistake()
    titles = [one.title for one in every]
    assert len(set(titles)) == len(titles) > 120
    assert all(one.codes for one in every)


IN_LOGS: tuple[str, ...] = (
    "absolute joint angles",
    "ratio varies",
    "joint encoder multiplied",
    "zero",
    "torque",
)
IN_LOGS += ("stop reached", "packets lost", "bursts lost", "motor encoders within a turn")


@pytest.mark.parametrize(
    "mistake", [x for x in joint_mistakes() if x.name.startswith(IN_LOGS)], ids=lambda x: x.title
)
def test_mistake_in_the_log_changes_it_and_leaves_the_files(arm: Subject, mistake: Mistake) -> None:
    right = Case(arm).setup("plain")
    setup = mistake.change(Case(arm), right)
    assert setup is not None
    assert (setup.urdf, setup.drives) == (right.urdf, right.drives)
    (log,), (before,) = setup.logs, right.logs
    counts = {len(values) for values in log.values()}
    assert len(counts) == 1
    changed = [x for x in log if not np.array_equal(log[x], before[x])]
    assert changed
    if "lost" not in mistake.name:
        assert changed != list(log)


@pytest.mark.parametrize(
    "mistake", [x for x in joint_mistakes() if "robot file" in x.name], ids=lambda x: x.title
)
def test_robot_of_another_size_has_longer_links(arm: Subject, mistake: Mistake) -> None:
    right = Case(arm).setup("plain")
    setup = mistake.change(Case(arm), right)
    assert setup is not None
    wrong, true = (
        float(np.linalg.norm(load(one.urdf, one.drives).model.jointPlacements[4].translation))
        for one in (setup, right)
    )
    assert wrong > 1.05 * true > 0


TRUE_DRIVES = {
    **{("stiff", f"{kind}100"): "parallel_spring" for kind in ("parallel", "preload", "constant")},
    **{("stiff", kind): "transmission" for kind in ("tendon50", "differential")},
    **{("scara", kind): "spring" for kind in ("damping20", "hysteresis20")},
}


@pytest.mark.parametrize(("name", "truth"), quick_first(TRUE_DRIVES, 5))
def test_true_robot_has_what_its_user_does_not_declare(name: str, truth: str) -> None:
    pytest.importorskip("mujoco")
    key, subject = TRUE_DRIVES[name, truth], subjects()[name]
    true, nominal = true_robot(name, truth), load(subject.urdf, subject.drives)
    assert any(
        getattr(true.drives[joint], key) != getattr(drive, key)
        for joint, drive in nominal.drives.items()
    )


def test_another_code_is_a_false_explanation_unless_it_names_the_right_one_as_a_rival() -> None:
    right = gauntlet.Said("delay", "doubtful", "a", "")
    rival = gauntlet.Said("sign", "wrong", "a", "", rivals=("delay",))
    other, note = (gauntlet.Said("unit", kind, "a", "") for kind in ("doubtful", "note"))
    outcome = partial(gauntlet.Outcome, "late", "severe", "arm", 0, "N", 1.0, codes=("delay",))
    assert outcome(said=(right, other, note)).false_codes == ["unit"]
    assert outcome(said=(rival, note)).false_codes == []
    found = [outcome(said=(right, other)), outcome(said=(rival,))]
    assert gauntlet.false_explanations(found) == [["late", "severe", "unit", "arm"]]


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
        found.__dict__["weighed_findings"] = said
        return found

    monkeypatch.setattr(seaid, "identify", silent)
    outcome = gauntlet.judge(Case(arm), mistake)
    assert outcome is not None
    return outcome


@pytest.mark.slow  # identifies an arm twice and more
@pytest.mark.parametrize(
    ("code", "severity", "letter"),
    [
        ("unit", "note", "-"),
        ("unit", "wrong", "R"),
        ("payload", "wrong", "D"),
        ("", "wrong", "-"),
    ],
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


@pytest.mark.slow  # 2 s
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
