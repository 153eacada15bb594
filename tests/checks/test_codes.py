"""Which findings follow from others."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid.checks import CODES
from seaid.checks.codes import consequences, merged, that_matter
from seaid.checks.tolerances import MOST_ALIKE
from seaid.errors import SEVERITIES, Finding, by_severity


def lacking(joint: str, field: str = "friction") -> Finding:
    lines = f'in the drives file:\n[{joint}]\n{field} = ["viscous"]'
    return Finding("missing-term", f"{joint} lacks it", joint, evidence={"F": 9.0}, remedy=lines)


@pytest.mark.parametrize("count", [MOST_ALIKE, MOST_ALIKE + 1, 30])
def test_what_many_joints_have_is_one_warning_with_all_joints_and_tables(count: int) -> None:
    joints = [f"j{number}" for number in range(count)]
    others = [Finding("delay", "late", "j1"), Finding("no-fit", "all", severity="wrong")]
    notes = [Finding("drift", "slow", joint, "note") for joint in joints]
    each = [*map(lacking, joints), lacking("j0", "parallel_spring")]
    warnings = merged([*notes, *each, *others])
    if count <= MOST_ALIKE:
        assert warnings == by_severity([*notes, *each, *others])
        return
    wrong, one, delay, *rest = warnings
    assert (wrong, delay, rest) == (others[1], others[0], notes)
    assert (one.code, one.severity, one.joint) == ("missing-term", "doubtful", "")
    assert one.joints == tuple(joints)
    assert one.evidence == {f"{joint}: F": 9.0 for joint in joints}
    header, _, lines = one.remedy.partition("\n")
    assert header == "in the drives file:"
    tables = tomllib.loads(lines)
    assert [*tables] == joints
    assert [*tables["j0"]] == ["friction", "parallel_spring"]


TERM = Finding("missing-term", "most of the residual", "knee", evidence={"explained": 0.8})
NO_FIT = Finding("no-fit", "60 % is left unexplained", "knee", remedy="look at the residual")


def test_a_weak_spring_silences_what_noise_alone_raises() -> None:
    weak = Finding("weak-spring", "hardly loaded", "knee")
    term = replace(TERM, evidence={"explained": 0.3})
    assert that_matter([weak, term]) == [weak]
    # A wrong set-up has made notes of its symptoms: without it nothing would be left of both.
    wrong = replace(term, severity="wrong")
    assert that_matter([replace(weak, severity="note"), wrong])[1] == wrong


@pytest.mark.parametrize(
    "cause",
    [
        TERM,
        Finding("holes", "788 samples were lost"),
        Finding("contact", "a hand", "hip", "wrong", joints=("hip", "knee")),
        # the bodies, which it spoils, are those of all joints
        Finding("torque-scale", "1.2 times", "hip", evidence={"misfit as given": 0.16}),
    ],
)
def test_a_symptom_of_a_cause_is_a_note_without_a_remedy(cause: Finding) -> None:
    assert that_matter([cause, NO_FIT]) == [cause, replace(NO_FIT, severity="note", remedy="")]


def test_a_cause_is_as_severe_as_its_symptoms() -> None:
    term = replace(TERM, evidence={"explained": 0.95})
    cause, symptom = that_matter([term, replace(NO_FIT, severity="wrong")])
    assert cause == replace(term, severity="wrong")
    assert symptom.severity == "note"


@pytest.mark.parametrize(
    ("cause", "symptom"),
    [
        (replace(TERM, evidence={"explained": 0.3}), NO_FIT),  # much is left with it
        (TERM, replace(NO_FIT, severity="wrong")),
        (TERM, replace(NO_FIT, evidence={"error": 4.8})),  # twice the torque is left with it
        (replace(TERM, severity="note"), NO_FIT),
        (replace(TERM, joint="hip"), NO_FIT),
        (Finding("drift", "slow", "knee"), NO_FIT),  # one symptom explains no other
        (Finding("gain-scale", "nothing fixes the scale"), NO_FIT),  # which spoils no fit
        (Finding("standstill", "it stands still", "hip"), NO_FIT),
    ],
)
def test_a_symptom_stays_without_a_cause_that_explains_it(cause: Finding, symptom: Finding) -> None:
    assert that_matter([cause, symptom]) == [cause, symptom]


ANY = st.builds(
    Finding,
    st.sampled_from([*CODES]),
    st.just("what was found"),
    st.sampled_from(["", "hip", "knee"]),
    st.sampled_from(SEVERITIES),
    st.dictionaries(st.just("explained"), st.floats(0, 1)),
)


@settings(max_examples=300)
@given(st.lists(ANY, max_size=8))
def test_no_result_is_better_for_symptoms_that_follow(findings: list[Finding]) -> None:
    """The worst severity stays, but for what noise raises at a weak spring or backlash."""
    weak = ("weak-spring", "backlash")
    findings = [finding for finding in findings if finding.code not in weak]
    left = that_matter(findings)
    assert [finding.code for finding in left] == [finding.code for finding in findings]
    assert worst(left) == worst(findings)


def worst(findings: list[Finding]) -> str:
    return by_severity(findings)[0].severity if findings else ""


def test_what_follows_from_a_wrong_set_up_is_a_note_without_lines_to_apply() -> None:
    """A cause that rests on the robot file spares the findings of other joints."""
    lines = "in the drives file:\n[knee]\nspring = ['linear', 'dead_zone']"
    findings = [Finding("drift", "", joint, remedy=lines) for joint in ("knee", "hip", "")]
    notes = [replace(finding, severity="note", remedy="") for finding in findings]
    likely = Finding("torque-scale", "", "knee", "wrong", certainty="likely")
    assert consequences([likely], findings) == [notes[0], findings[1], notes[2]]
    assert consequences([replace(likely, certainty="certain")], findings) == notes
    assert consequences([replace(likely, severity="doubtful")], findings) == findings
