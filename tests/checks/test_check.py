"""Checks as objects: what they yield, and what becomes of one that fails."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

from seaid import checks
from seaid.checks import CODES, Observation, observed
from seaid.checks.codes import consequences
from seaid.errors import Finding, LogError

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


def test_what_follows_from_a_wrong_set_up_prints_no_lines_to_apply() -> None:
    lines = "in the drives file:\n[a]\nspring = ['linear', 'dead_zone']"
    finding = DRIFT.finding("a drift", "a", "doubtful", remedy=lines)
    (note,) = consequences([HOLES.finding("holes", severity="wrong")], [finding])
    assert (note.severity, note.remedy) == ("note", "")
    assert consequences([HOLES.finding("holes")], [finding]) == [finding]


def test_texts_of_codes_are_those_of_codes() -> None:
    tables = tomllib.loads((Path(checks.__file__).with_name("codes.toml")).read_text("utf-8"))
    assert [*tables] == [*CODES]
    for code in CODES.values():
        assert code.meaning
        assert code.cause.endswith(".")
        assert code.advice.endswith(".")
        assert not code.measurement.endswith(".")
        assert not code.implies.endswith(".")
