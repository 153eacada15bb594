"""Checks as objects: what they yield, and what becomes of one that fails."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid import checks
from seaid.checks import CODES, channels, commands, engine, model, setup, verdict
from seaid.checks.channels import OF_LOGS
from seaid.checks.codes import Observation, observed
from seaid.checks.experiment import Experiment
from seaid.checks.verdict import RobotFit
from seaid.errors import Finding, LogError
from seaid.identification import checking, conclusion, result
from tests.experiments import arm, arm_log
from tests.representatives import quick_only

DRIFT, HOLES = CODES["drift"], CODES["holes"]


def holes(count: int) -> Iterator[Finding]:
    yield HOLES.finding(f"{count} holes")


def broken(count: int) -> Iterator[Finding]:
    yield DRIFT.finding("a drift")
    raise LogError(f"{count} rows are too few")


def test_a_check_that_raises_becomes_a_note_with_its_name() -> None:
    found = observed([Observation(DRIFT, broken), Observation(HOLES, holes)], 3)
    assert [finding.code for finding in found] == ["drift", "drift", "holes"]
    assert found[1].severity == "note"
    assert found[1].message == "the check 'drift' could not be made: 3 rows are too few"


def fail(*_: Any, **__: Any) -> Any:
    raise ArithmeticError("no such number")


def broken_mistakes() -> dict[Any, Any]:
    """Return all transforms, with functions of their own that raise."""
    return {
        (lambda _: True): {(lambda _, code=code: fail(code)): code for code in generators.values()}
        for generators in setup.MISTAKES.values()
    }


BROKEN: dict[str, tuple[Any, str, Any]] = {
    "logs": (channels, "OF_LOGS", [replace(check, look=fail) for check in OF_LOGS]),
    "mistakes": (setup, "MISTAKES", broken_mistakes()),
    "transforms": (setup, "transforms", fail),
    "misfits": (Experiment, "cost", fail),
    "columns": (model, "COLUMN_CHECKS", [replace(x, candidates=fail) for x in model.COLUMN_CHECKS]),
    "wording": (model, "COLUMN_CHECKS", [replace(x, finding=fail) for x in model.COLUMN_CHECKS]),
    "selection": (engine, "forward_selection", fail),
    "fit": (verdict, "_OF_FIT", [replace(check, look=fail) for check in verdict._OF_FIT]),
    "rest": (setup, "_OF_REST", [replace(check, look=fail) for check in setup._OF_REST]),
    "friction": (commands, "of_friction_alone", fail),
    "limits": (setup, "_BEYOND_LIMITS", replace(setup._BEYOND_LIMITS, look=fail)),
    "offsets": (channels, "offset_findings", fail),
    "delays": (channels, "decided_delays", fail),
    "ratings": (checking, "_RATINGS", replace(checking._RATINGS, look=fail)),
    "strengths": (checking, "_STRENGTHS", replace(checking._STRENGTHS, look=fail)),
    "stops": (checking, "stop_findings", fail),
    "contacts": (RobotFit, "contacts", property(fail)),
    "blocks": (verdict, "_blocks", fail),
    "predictions": (verdict, "_prediction_errors", fail),
    "joints": (Experiment, "in_motion", property(fail)),
    "values": (result, "drive_findings", fail),
    "channels": (result, "unused_findings", fail),
    "sensitivity": (conclusion, "sensitivity_findings", fail),
    "echoes": (conclusion, "without_echoes", fail),
    "scales": (conclusion, "unknown_scales", fail),
}
"""{part of the checks: the module or class, its name, and what fails in its place}."""

ONLY_IN_FITS = {"columns", "wording", "selection", "fit", "contacts", "blocks", "predictions"}
ONLY_IN_FITS |= {*[*BROKEN][-5:]}
"""What `check` does not look at, or not of logs that fit."""


@pytest.mark.parametrize("part", quick_only(BROKEN, ["mistakes", "columns"]))
def test_a_fit_stands_whatever_raises_in_a_check(
    part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, log = arm(), arm_log()
    if part == "wording":  # of a torque that is late
        log = replace(log, motor_torque=np.roll(log.motor_torque, 8, axis=0))
    module, name, broken_part = BROKEN[part]
    monkeypatch.setattr(module, name, broken_part)
    identified = seaid.identify(robot, log)
    assert identified.drives
    codes = {
        "logs": [check.code for check in OF_LOGS],
        "mistakes": [x for generators in setup.MISTAKES.values() for x in generators.values()],
        "columns": [check.code for check in model.COLUMN_CHECKS],
        "fit": [check.code for check in verdict._OF_FIT],
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
