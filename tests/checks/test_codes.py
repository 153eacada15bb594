"""Codes of findings: their texts, which follow from others, and checks that fail."""

import re
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import seaid
from seaid import checks, legged
from seaid.checks import CODES, channels, columns, engine, model, setup, values, verdict
from seaid.checks.codes import consequences, in_drives, merged, that_matter
from seaid.checks.engine import Check, observed
from seaid.checks.experiment import Experiment
from seaid.checks.tolerances import MOST_ALIKE, MOST_READ
from seaid.checks.verdict import RobotFit
from seaid.errors import SEVERITIES, Finding, LogError, by_severity
from seaid.identification import checking, conclusion
from tests.experiments import arm, arm_log
from tests.representatives import quick_only


def lacking(joint: str, field: str = "friction") -> Finding:
    lines = in_drives({(joint,): f'{field} = ["viscous"]'})
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


@pytest.mark.parametrize("count", [MOST_READ, MOST_READ + 3])
def test_more_findings_than_one_reads_end_as_notes_that_keep_their_remedies(count: int) -> None:
    note, codes = Finding("drift", "slow", "", "note"), [*CODES][:count]
    each = [Finding(code, f"{code} of it", remedy="repair it") for code in codes]
    worst = Finding("no-fit", "nothing", "knee", "wrong")
    warnings = merged([note, *each[1:], worst])
    assert warnings[:MOST_READ] == (worst, *each[1:MOST_READ])
    assert warnings[-1] == note
    for finding, last in zip(each[MOST_READ:], warnings[MOST_READ:-1], strict=True):
        assert (last.severity, last.remedy) == ("note", "repair it")
        assert last.message.startswith(finding.message + " (a note behind 7 findings")


TERM = Finding("missing-term", "most of the residual", "knee", evidence={"explained": 0.8})
NO_FIT = Finding("no-fit", "60 % is left unexplained", "knee", remedy="look at the residual")


def test_a_weak_spring_silences_what_noise_alone_raises() -> None:
    weak = Finding("weak-spring", "hardly loaded", "knee")
    term = replace(TERM, evidence={"explained": 0.3})
    assert that_matter([weak, term]) == [weak]
    # a joint without a spring, whose rotor has to carry the load
    assert that_matter([Finding("rotor-inertia", "3.2 times", "knee"), weak]) == [weak]
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
        Finding("payload", "of another lever", "hip", "wrong", {"misfit as given": 0.3}),
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


# What becomes of a check that fails

DRIFT, HOLES = CODES["drift"], CODES["holes"]


def holes(count: int) -> Iterator[Finding]:
    yield Finding("holes", f"{count} holes")


def raising(count: int) -> Iterator[Finding]:
    yield Finding("drift", "a drift")
    raise LogError(f"{count} rows are too few")


def test_a_check_that_raises_becomes_a_note_with_its_name() -> None:
    found = observed([Check(DRIFT, (), raising), Check(HOLES, (), holes)], 3)
    assert [finding.code for finding in found] == ["drift", "holes", "drift"]
    assert found[2].severity == "note"
    assert found[2].message == "the check 'drift' could not be made: 3 rows are too few"


def fail(*_: Any, **__: Any) -> Any:
    raise ArithmeticError("no such number")


def broken_checks(checks: Iterable[Any]) -> list[Any]:
    """Return checks that are always made and raise."""
    return [*map(broken, checks)]


def broken(check: Any) -> Any:
    """Return a check that is always made and raises."""
    return replace(check, needs=(), proposed=fail)


BROKEN: dict[str, tuple[Any, str, Any]] = {
    "logs": (setup, "OF_LOGS", broken_checks(setup.OF_LOGS)),
    "mistakes": (setup, "MISTAKES", broken_checks(setup.MISTAKES)),
    "transforms": (setup, "transforms", fail),
    "misfits": (Experiment, "cost", fail),
    "columns": (model, "COLUMN_CHECKS", broken_checks(model.COLUMN_CHECKS)),
    "wording": (model, "COLUMN_CHECKS", [replace(x, finding=fail) for x in model.COLUMN_CHECKS]),
    "selection": (engine, "forward_selection", fail),
    "fit": (verdict, "OF_FIT", broken_checks(verdict.OF_FIT)),
    "rest": (setup, "OF_REST", broken_checks(setup.OF_REST)),
    "motion": (setup, "OF_MOTION", broken_checks(setup.OF_MOTION)),
    "limits": (channels, "limit_findings", broken(channels.limit_findings)),
    "ratings": (setup, "_are_scales", fail),
    "strengths": (checking, "strength_findings", broken(channels.strength_findings)),
    "stops": (checking, "stop_findings", broken(channels.stop_findings)),
    "contacts": (RobotFit, "contacts", property(fail)),
    "blocks": (verdict, "_blocks", fail),
    "predictions": (verdict, "_prediction_errors", fail),
    "joints": (Experiment, "in_motion", property(fail)),
    "values": (conclusion, "drive_findings", broken(values.drive_findings)),
    "channels": (conclusion, "unused_findings", broken(values.unused_findings)),
    "sensitivity": (conclusion, "sensitivity_findings", fail),
    "echoes": (conclusion, "without_echoes", fail),
    "scales": (conclusion, "unknown_scales", broken(columns.unknown_scales)),
}
"""{part of the checks: the module or class, its name, and what fails in its place}."""

ONLY_IN_FITS = {"columns", "wording", "selection", "fit", "contacts", "blocks", "predictions"}
ONLY_IN_FITS |= {*[*BROKEN][-5:]}
"""What `check` does not look at, or not of logs that fit."""


@pytest.mark.parametrize("part", quick_only(BROKEN, ["mistakes", "columns"]))
def test_a_fit_stands_whatever_a_check_raises(part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, log = arm(), arm_log()
    if part == "wording":  # of a torque that is late
        log = replace(log, motor_torque=np.roll(log.motor_torque, 8, axis=0))
    module, name, broken_part = BROKEN[part]
    monkeypatch.setattr(module, name, broken_part)
    identified = seaid.identify(robot, log)
    assert identified.drives
    codes = {
        "logs": [check.code for check in setup.OF_LOGS],
        "mistakes": [check.code for check in setup.MISTAKES],
        "columns": [check.code for check in model.COLUMN_CHECKS],
        "fit": [check.code for check in verdict.OF_FIT],
    }.get(part, ())
    checked = () if part in ONLY_IN_FITS else (seaid.check(robot, log).warnings,)
    for findings in (identified.warnings, *checked):
        notes = {x.code for x in findings if x.message.endswith("made: no such number")}
        assert notes
        assert notes >= {code.name for code in codes}


def test_codes_that_modules_name_are_codes() -> None:
    """A misspelled name in a check that hardly ever speaks would show only there."""
    named = {
        name
        for path in Path(seaid.__file__).parent.rglob("*.py")
        for name in re.findall(r'\bCODES\["([^"]+)"\]', path.read_text("utf-8"))
    }
    assert {"delay", "no-fit", "drift"} <= named
    assert named <= {*CODES}


def test_texts_of_codes_are_those_of_codes() -> None:
    tables = tomllib.loads((Path(checks.__file__).with_name("codes.toml")).read_text("utf-8"))
    assert [*tables] == [*CODES]
    for code in CODES.values():
        assert code.kind in ("cause", "symptom", "")
        assert code.meaning
        assert code.cause.endswith(".")
        assert code.advice.endswith(".")
        assert not code.measurement.endswith(".")
        assert not code.implies.endswith(".")


def test_each_case_of_a_code_is_used_and_its_templates_can_be_filled() -> None:
    folders = (Path(str(module.__file__)).parent for module in (checks, legged))
    sources = "".join(x.read_text("utf-8") for folder in folders for x in folder.glob("*.py"))
    cases = [(name, case) for code in CODES.values() for name, case in code.cases.items()]
    assert len(cases) > 100
    for name, case in cases:
        assert f'"{name}"' in sources, name
        filled = case.filled(defaultdict(lambda: 1.0))
        assert filled.message, name
        assert not {*"{}|"} & {*filled.message}, name
