"""The golden results: the comparison sees what changed, and nothing within the tolerances."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import pytest

from scripts import golden
from scripts.golden import MOVE, REDERIVATION, WRONG, CaseResult, Difference, Golden
from scripts.golden_cases import GROUPS, KNOWN_WRONG, cases
from scripts.golden_records import KnownWrong, Record, of_error, of_text
from seaid.errors import SeaidError

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "tests/data/golden.json.gz"
DRIVE = "[knee]\nstiffness = 59966.0  # N/m\nratio = 86\n"


def before() -> Golden:
    records: dict[str, Record] = {
        "verdict": ["text", "good but"],
        "knee stiffness": ["value", 100.0, 2.0],
        "knee motor_inertia": ["value", 3.4e-6, 0.0],
        "codes knee": ["codes", ["delay wrong", "payload note"]],
        "cutoff_hz": ["number", 4.5],
        "drives": of_text(DRIVE, ".toml"),
    }
    other = CaseResult("measured", {"verdict": ["text", "good"]})
    wrong = KnownWrong("wrong*", "active *", "they are not active")
    cases = {"leg": CaseResult("TULip", records), "arm": other}
    cases["wrong one"] = CaseResult("TULip", {"active bound 0": ["text", "mass of foot"]})
    return Golden(cases, (wrong,))


def changed(case: str = "leg", **records: Record | None) -> Golden:
    """Return the golden results with other records of a case; `_` stands for a blank."""
    old = before()
    own = dict(old.cases[case].records)
    for key, record in records.items():
        own.pop(name := key.replace("__", " "), None)
        own |= {} if record is None else {name: record}
    return replace(old, cases={**old.cases, case: replace(old.cases[case], records=own)})


def found(now: Golden, tolerance: golden.Tolerance = REDERIVATION) -> list[tuple[str, ...]]:
    differences = golden.differences(before(), now, tolerance)
    return [(one.group, one.case, one.record, one.kind) for one in differences]


STIFFNESS = ("TULip", "leg", "knee stiffness")
FILE_OF_DRIVES = ("TULip", "leg", "drives")


@pytest.mark.parametrize(
    ("now", "expected"),
    [
        (changed(knee__stiffness=["value", 100.1, 2.0]), (*STIFFNESS, "value")),
        (changed(knee__stiffness=["value", 100.0, 2.08]), (*STIFFNESS, "standard error")),
        (changed(knee__stiffness=["value", float("nan"), 2.0]), (*STIFFNESS, "value")),
        (changed(knee__stiffness=None), (*STIFFNESS, "missing")),
        (
            changed(knee__motor_inertia=["value", 3.41e-6, 0.0]),
            ("TULip", "leg", "knee motor_inertia", "value"),
        ),
        (
            changed(codes__knee=["codes", ["delay wrong"]]),
            ("TULip", "leg", "codes knee", "codes"),
        ),
        (changed(codes__knee=None), ("TULip", "leg", "codes knee", "codes")),
        (changed(codes__hip=["codes", ["unit note"]]), ("TULip", "leg", "codes hip", "codes")),
        (changed(verdict=["text", "good"]), ("TULip", "leg", "verdict", "text")),
        (changed(verdict=["number", 1.0]), ("TULip", "leg", "verdict", "kind")),
        (changed(cutoff_hz=["number", 4.51]), ("TULip", "leg", "cutoff_hz", "number")),
        (changed(scale=["number", 1.0]), ("TULip", "leg", "scale", "additional")),
        (
            changed(drives=of_text(DRIVE.replace("59966", "60036"), ".toml")),
            (*FILE_OF_DRIVES, "number in a file"),
        ),
        (
            changed(drives=of_text(DRIVE.replace("ratio", "gear_ratio"), ".toml")),
            (*FILE_OF_DRIVES, "text of a file"),
        ),
        (
            changed(drives=of_text(DRIVE.replace("59966.0", "5.99660e4"), ".toml")),
            (*FILE_OF_DRIVES, "formatting"),
        ),
        (
            changed(drives=of_text(DRIVE.replace("N/m", "newtons"), ".toml")),
            (*FILE_OF_DRIVES, "formatting"),
        ),
        (
            changed("wrong one", active__bound__0=None),
            (WRONG, "wrong one", "active bound 0", "missing"),
        ),
    ],
)
def test_each_change_is_one_difference_of_its_group(now: Golden, expected: tuple[str, ...]) -> None:
    assert found(now) == [expected]


def test_missing_and_additional_cases_are_differences() -> None:
    old = before()
    without = replace(old, cases={name: old.cases[name] for name in ("leg", "wrong one")})
    assert found(without) == [("measured", "arm", "", "missing")]
    extra = replace(old, cases={**old.cases, "biped": CaseResult("biped", {})})
    assert found(extra) == [("biped", "biped", "", "additional")]


@pytest.mark.parametrize(
    ("records", "moved"),
    [
        ({"knee__stiffness": ["value", 100.03, 2.0]}, "value"),
        ({"knee__stiffness": ["value", 100.0, 2.05]}, "standard error"),
        ({"cutoff_hz": ["number", 4.502]}, "number"),
        ({"drives": of_text(DRIVE.replace("59966", "59980"), ".toml")}, "number in a file"),
    ],
)
def test_changes_within_the_tolerances_of_a_rederivation_are_none_but_no_move(
    records: dict[str, Record], moved: str
) -> None:
    now = changed("leg", **records)
    assert found(now) == []
    assert [kind for *_, kind in found(now, MOVE)] == [moved]
    assert found(changed(knee__stiffness=["value", 100.0 * (1 + 1e-10), 2.0]), MOVE) == []


def test_table_has_the_known_wrong_records_last_with_their_reason() -> None:
    both = changed(verdict=["text", "good"])
    wrong = changed("wrong one", active__bound__0=None).cases["wrong one"]
    now = replace(both, cases={**both.cases, "wrong one": wrong})
    text = golden.table_of(golden.differences(before(), now, REDERIVATION))
    lines = [line.split() for line in text.splitlines()]
    assert lines.index(["TULip:"]) < lines.index(["known", "wrong:"])
    assert "they are not active" in text
    assert "good but -> good" in text
    assert golden.table_of([]) == "No differences."
    many = [Difference("TULip", f"case {place}", "", "missing") for place in range(12)]
    assert "and 2 more" in golden.table_of(many)


def test_a_written_file_is_read_as_it_was_and_has_the_same_bytes(tmp_path: Path) -> None:
    paths = tmp_path / "one.json.gz", tmp_path / "two.json.gz"
    for path in paths:
        golden.write_golden(path, before())
    assert golden.read_golden(paths[0]) == before()
    assert paths[0].read_bytes() == paths[1].read_bytes()


def compressed(content: bytes) -> bytes:
    """Return the content as gzip writes it, without the time: it names a test."""
    return gzip.compress(content, mtime=0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"no gzip", "cannot be read as a golden file"),
        (compressed(b"{"), "cannot be read as a golden file"),
        (compressed(b"[]"), "is no golden file"),
        (compressed(b'{"format": "other"}'), "is no golden file"),
        (compressed(b'{"format": "seaid golden", "version": 99}'), "of version 99"),
        (compressed(b'{"format": "seaid golden", "version": 1}'), "is damaged"),
    ],
)
def test_bad_file_is_refused(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "golden.json.gz"
    path.write_bytes(content)
    with pytest.raises(SeaidError, match=message) as refused:
        golden.read_golden(path)
    assert "scripts/golden.py" in str(refused.value)


def test_truncated_and_missing_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "golden.json.gz"
    golden.write_golden(path, before())
    path.write_bytes(path.read_bytes()[:-20])
    for bad in (path, tmp_path / "none.json.gz"):
        with pytest.raises(SeaidError, match="cannot be read"):
            golden.read_golden(bad)


def test_an_error_of_a_case_is_a_record() -> None:
    def refused() -> dict[str, Record]:
        raise SeaidError("'/tmp/x1/log.csv' has no time")

    case = replace(cases()[0], records=refused)
    assert golden.results_of(case).records == {
        "error": ["text", "SeaidError"],
        "error text": ["text", "'log.csv' has no time"],
    }
    assert of_error(ValueError("a/b"))["error text"] == ["text", "a/b"]


def test_cases_are_those_of_the_file() -> None:
    names = [case.name for case in cases()]
    assert len(set(names)) == len(names)
    assert {case.group for case in cases() if case.quick} >= {*GROUPS} - {*SLOW_GROUPS}
    kept = golden.read_golden(FILE)
    assert set(kept.cases) == set(names)
    assert kept.known_wrong == KNOWN_WRONG
    assert FILE.stat().st_size < 300_000


SLOW_GROUPS = (*("conditions", "biped", "Philips", "motor side", "commands", "XL330", "terms"),)
"""Groups without a case of a few seconds."""


@pytest.mark.slow  # a case or two per group: about 15 s of processor time
def test_quick_cases_run_and_are_compared_with_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Repairs change results: that they are those of the file is shown, and not tested here."""
    output, quick = tmp_path / "golden.json.gz", {case.name for case in cases() if case.quick}
    golden.main(golden.arguments_of(["--quick", "--against", str(FILE), "--output", str(output)]))
    assert "ifferences" in capsys.readouterr().out
    now, kept = golden.read_golden(output).cases, golden.read_golden(FILE).cases
    assert set(now) == quick
    refused = [{name for name in quick if "error" in each[name].records} for each in (now, kept)]
    assert refused[0] == refused[1]
    groups = [*{one.group for one in now.values()}]
    words = ["--against", str(output), "--results", str(output), "--move", "--only", *groups]
    assert golden.main(golden.arguments_of(words)) == 0
    assert capsys.readouterr().out.strip() == "No differences."
