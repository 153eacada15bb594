"""seaid report: the page, what is refused, what it says on stdout."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from tests.cli.test_cli import arm, done, refused, robot_and_drives

__all__ = ["arm"]


@pytest.mark.slow  # an identification, a validation and their page
def test_report_of_a_validated_identification(arm: Path, tmp_path: Path) -> None:
    page, other = tmp_path / "report.html", arm / "other.csv"
    logs = ("--from", arm / "run.csv", "--validate", other)
    said = done("report", *robot_and_drives(arm), *logs, "-o", page)
    verdicts = tuple(f"small_arm: {level}" for level in ("good", "usable with care", "do not use"))
    assert said.out.splitlines()[0].startswith(verdicts)
    assert said.out.splitlines()[-1] == f"Results: {page}"
    text = page.read_text(encoding="utf-8")
    assert "<title>small_arm: Identification report</title>" in text
    assert "Not validated" not in text
    digest = hashlib.sha256(other.read_bytes()).hexdigest()[:12]
    assert f"other.csv, {other.stat().st_size} bytes, SHA-256 {digest}…" in text
    assert "<dt>Estimator</dt><dd>wls</dd>" in text
    assert [one.name for one in tmp_path.iterdir()] == ["report.html"]


@pytest.mark.slow  # an identification and its report
def test_report_without_validation_says_so_and_is_json_for_machines(
    arm: Path, tmp_path: Path
) -> None:
    page = tmp_path / "report.html"
    options = ("--from", arm / "run.csv", "--feasible", "--cutoff-hz", "6", "--json")
    said = done("report", *robot_and_drives(arm), *options, "-o", page)
    content = json.loads(said.out)
    assert content["files"] == [str(page)]
    assert content["result"]["validations"] == []
    assert said.err.splitlines()[-1] == f"Results: {page}"
    text = page.read_text(encoding="utf-8")
    assert "Not validated on an unseen motion" in text
    assert "<dt>Cutoff</dt><dd>6 Hz</dd>" in text
    assert "Physically consistent parameters" in text


@pytest.mark.slow  # 2.3 s
def test_report_keeps_what_is_there_and_what_it_reads(arm: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    page.write_text("mine")
    logs = ("--from", arm / "run.csv")
    message = refused("report", *robot_and_drives(arm), *logs, "-o", page)
    assert f"'{page}' is there already" in message
    assert page.read_text() == "mine"
    done("report", *robot_and_drives(arm), *logs, "-o", page, "--force")
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert 'id="replay"' not in page.read_text(encoding="utf-8")


def test_report_does_not_validate_on_what_it_is_identified_from(arm: Path, tmp_path: Path) -> None:
    logs = ("--from", arm / "run.csv", "--validate", arm / ".." / arm.name / "run.csv")
    page = tmp_path / "report.html"
    message = refused("report", *robot_and_drives(arm), *logs, "-o", page)
    assert "run.csv' is used for the identification: validate on another log" in message
    assert not page.exists()
