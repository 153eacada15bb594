"""Which findings follow from others."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaid.checks import CODES, that_matter
from seaid.errors import SEVERITIES, Finding, by_severity

TERM = Finding("missing-term", "most of the residual", "knee", evidence={"explained": 0.8})
NO_FIT = Finding("no-fit", "60 % is left unexplained", "knee", remedy="look at the residual")


def test_a_weak_spring_silences_what_noise_alone_raises() -> None:
    weak = Finding("weak-spring", "hardly loaded", "knee")
    term = replace(TERM, evidence={"explained": 0.3})
    assert that_matter([weak, term]) == [weak]


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
