"""The golden results: the comparison sees what changed, and nothing within the tolerances."""

import gzip
from dataclasses import replace
from pathlib import Path

import pytest

from scripts import golden
from scripts.golden import MOVE, REDERIVATION, WRONG, CaseResult, Golden
from scripts.golden_cases import GROUPS, KNOWN_WRONG, cases
from scripts.golden_records import KnownWrong, Record, of_error, of_text
from seaid.errors import SeaidError

ROOT = Path(__file__).resolve().parents[2]
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


def changed(key: str, record: Record | None, case: str = "leg") -> Golden:
    """Return the golden results with another record of a case, or without it."""
    old = before()
    records = {name: kept for name, kept in old.cases[case].records.items() if name != key}
    records |= {} if record is None else {key: record}
    return replace(old, cases={**old.cases, case: replace(old.cases[case], records=records)})


def found(now: Golden, tolerance: golden.Tolerance = REDERIVATION) -> list[tuple[str, ...]]:
    differences = golden.differences(before(), now, tolerance)
    return [(one.group, one.case, one.record, one.kind) for one in differences]


def drives(old: str, new: str) -> Record:
    return of_text(DRIVE.replace(old, new), ".toml")


K, CODES = "knee stiffness", "codes knee"


@pytest.mark.parametrize(
    ("key", "record", "kind"),
    [
        (K, ["value", 100.1, 2.0], "value"),
        (K, ["value", 100.0, 2.08], "standard error"),
        (K, ["value", float("nan"), 2.0], "value"),
        (K, None, "missing"),
        ("knee motor_inertia", ["value", 3.41e-6, 0.0], "value"),
        (CODES, ["codes", ["delay wrong"]], "codes"),
        (CODES, None, "codes"),
        ("codes hip", ["codes", ["unit note"]], "codes"),
        ("verdict", ["text", "good"], "text"),
        ("verdict", ["number", 1.0], "kind"),
        ("cutoff_hz", ["number", 4.51], "number"),
        ("scale", ["number", 1.0], "additional"),
        ("drives", drives("59966", "60036"), "number in a file"),
        ("drives", drives("ratio", "gear_ratio"), "text of a file"),
        ("drives", drives("59966.0", "5.99660e4"), "formatting"),
        ("drives", drives("N/m", "newtons"), "formatting"),
    ],
)
def test_each_change_is_one_difference(key: str, record: Record | None, kind: str) -> None:
    """Of the group of its case; known wrong records have a group of their own."""
    assert found(changed(key, record)) == [("TULip", "leg", key, kind)]
    wrong = changed("active bound 0", None, "wrong one")
    assert found(wrong) == [(WRONG, "wrong one", "active bound 0", "missing")]


def test_missing_and_additional_cases_are_differences() -> None:
    old = before()
    without = replace(old, cases={name: old.cases[name] for name in ("leg", "wrong one")})
    assert found(without) == [("measured", "arm", "", "missing")]
    extra = replace(old, cases={**old.cases, "biped": CaseResult("biped", {})})
    assert found(extra) == [("biped", "biped", "", "additional")]


@pytest.mark.parametrize(
    ("key", "record", "kind"),
    [
        (K, ["value", 100.03, 2.0], "value"),
        (K, ["value", 100.0, 2.05], "standard error"),
        ("cutoff_hz", ["number", 4.502], "number"),
        ("drives", drives("59966", "59980"), "number in a file"),
    ],
)
def test_changes_within_the_tolerances_of_a_rederivation_are_none_but_no_move(
    key: str, record: Record, kind: str
) -> None:
    """A move keeps ten digits."""
    now = changed(key, record)
    assert found(now) == []
    assert [change for *_, change in found(now, MOVE)] == [kind]
    assert found(changed(K, ["value", 100.0 * (1 + 1e-10), 2.0]), MOVE) == []


def test_a_written_file_is_read_as_it_was_and_a_bad_one_refused(tmp_path: Path) -> None:
    """Two files of the same results have the same bytes; what is damaged names the script."""
    path, again = tmp_path / "one.json.gz", tmp_path / "two.json.gz"
    for file in (path, again):
        golden.write_golden(file, before())
    content = path.read_bytes()
    assert golden.read_golden(path) == before()
    assert content == again.read_bytes()
    damaged = {
        b"no gzip": "cannot be read as a golden file",
        content[:-20]: "cannot be read as a golden file",
        gzip.compress(b"{"): "cannot be read as a golden file",
        gzip.compress(b"[]"): "is no golden file",
        gzip.compress(b'{"format": "seaid golden", "version": 99}'): "of version 99",
        gzip.compress(b'{"format": "seaid golden", "version": 1}'): "is damaged",
    }
    for wrong, message in damaged.items():
        path.write_bytes(wrong)
        with pytest.raises(SeaidError, match=rf"{message}.*scripts/golden\.py"):
            golden.read_golden(path)
    with pytest.raises(SeaidError, match="cannot be read"):
        golden.read_golden(tmp_path / "none.json.gz")


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
