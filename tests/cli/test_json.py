"""The JSON of all commands, results on stdout, and errors as JSON."""

from __future__ import annotations

import ast
import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from seaid.cli.commands import COMMANDS, command_of
from tests.cli.test_cli import arm, done, refused, robot_and_drives, run

__all__ = ["arm"]


@pytest.fixture(scope="module", autouse=True)
def parameters(arm: Path) -> None:
    """Write the files that `compare` reads."""
    for name in ("run", "other"):
        done("identify", *robot_and_drives(arm), arm / f"{name}.csv", "-o", arm / f"{name}.npz")


KEYS = ["format", "command", "robot", "verdict", "warnings", "notes", "result", "files", "error"]

ARGUMENTS = {
    "inspect": "arm.urdf --drives arm.toml",
    "inspect --exact": "arm.urdf",
    "excite": "arm.urdf --duration 2 --starts 1 --iterations 3",
    "simulate": "arm.urdf short_plan.json --drives arm.toml",
    "describe": "run.csv",
    "check": "arm.urdf run.csv --drives arm.toml",
    "check --delays": "arm.urdf run.csv --drives arm.toml",
    "check --terms": "arm.urdf run.csv --drives arm.toml --of elbow",
    "calibrate": "weights.csv",
    "identify": "arm.urdf run.csv --drives arm.toml",
    "identify --refine": "arm.urdf run.csv --drives arm.toml",
    "identify --condition a=run.csv": "arm.urdf --drives arm.toml --condition b=other.csv",
    "frequency": "arm.urdf run.csv --drives arm.toml --band 0.3,5",
    "validate": "arm.urdf other.csv --from run.csv --drives arm.toml",
    "validate --cross": "arm.urdf run.csv other.csv --drives arm.toml",
    "replay": "arm.urdf other.csv --from run.csv --drives arm.toml",
    "compare": "run.npz other.npz",
    "report": "arm.urdf --from run.csv --drives arm.toml",
    "export": "arm.urdf --from run.csv --drives arm.toml",
    "export --format python": "arm.urdf",
}
"""A line for each command and for what it does on request, without its output."""

SLOW = ("frequency", "identify --refine", "replay")
"""Commands that fit or simulate for more than a second."""

OF_PROJECTS = ("init", "run")
"""Commands that are tried in tests/project."""

SUFFIX = {"excite": "json", "simulate": "csv", "identify": "json", "report": "html"}
READ: dict[str, Callable[[str], object]] = {
    "json": json.loads,
    "toml": tomllib.loads,
    "urdf": ElementTree.fromstring,
    "csv": lambda text: np.loadtxt(text.splitlines(), delimiter=",", skiprows=1),
    "html": str.split,
    "py": ast.parse,
}
SUFFIX |= {"describe": "toml", "check --terms": "toml", "export": "urdf", "validate": "json"}
SUFFIX |= {
    "identify --refine": "json",
    "check --delays": "csv",
    "identify --condition a=run.csv": "json",
    "export --format python": "py",
    "compare": "html",
    "calibrate": "html",
    "replay": "html",
}
VERDICTS = ("identify", "identify --refine", "validate", "report", "export", "replay")
"""Lines whose result is judged."""


def test_every_command_but_the_view_is_tried_here() -> None:
    tried = {line.split()[0] for line in ARGUMENTS}
    assert tried == {*COMMANDS} - {"view", *OF_PROJECTS}
    outputs = {
        name for name in tried if any("--output" in one.opts for one in command_of(name).params)
    }
    assert outputs == {line.split()[0] for line in SUFFIX}


@pytest.mark.parametrize(
    "command",
    [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in ARGUMENTS],
)
def test_json_of_a_command_and_its_result_on_stdout(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    """With --json stdout has the JSON, with `-o -` what the file has; else nothing is written."""
    monkeypatch.chdir(arm)
    before = {*arm.iterdir()}
    line, suffix = [*command.split(), *ARGUMENTS[command].split()], SUFFIX.get(command)
    file = tmp_path / f"out.{suffix}"
    content = json.loads(done(*line, *(("-o", file) if suffix else ()), "--json").out)
    assert [*content] == KEYS
    assert content["format"] == f"seaid {line[0]} 1"
    assert content["command"] == line[0]
    assert content["robot"] == (None if command in ("describe", "calibrate") else "small_arm")
    assert content["error"] is None
    assert isinstance(content["result"], dict)
    assert {*content["files"]} == {str(one) for one in tmp_path.iterdir()}
    assert (content["verdict"] is not None) == (command in VERDICTS)
    if suffix:
        check_stdout(command, line, file)
    assert {*arm.iterdir()} == before


def check_stdout(command: str, line: list[str], file: Path) -> None:
    """Check that `-o -` writes the result to stdout and the text to stderr."""
    printed = done(*line, "-o", "-")
    if command != "report":
        written = [re.sub(r"\d\d:\d\d UTC", "", x) for x in (printed.out, file.read_text())]
        assert written[0].rstrip("\n") == written[1].rstrip("\n")
    READ[SUFFIX[command]](printed.out)
    assert "Results: " not in printed.out + printed.err
    said = run(*line, "-o", "-", "--json")
    assert said.code == 2
    assert "stdout has the JSON: name a file" in said.err


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("inspect no.urdf", 1, "no URDF file at 'no.urdf'"),
        ("identify arm.urdf run.csv --method both", 1, "--method: no method is named 'both'"),
        ("identify arm.urdf", 2, "LOG: it is missing"),
        ("inspect arm.urdf --payload lower", 2, "is not link:mass:x,y,z"),
        ("check arm.urdf run.csv --colour", 2, "No such option: --colour"),
    ],
)
def test_errors_are_json_on_stdout_as_well(
    arm: Path, monkeypatch: pytest.MonkeyPatch, line: str, code: int, words: str
) -> None:
    monkeypatch.chdir(arm)
    said, plain = run(*line.split(), "--json"), run(*line.split())
    content = json.loads(said.out)
    assert [*content] == KEYS
    assert content["error"]["exit_code"] == said.code == plain.code == code
    assert words in " ".join(content["error"]["message"].split())
    assert content["result"] is None
    assert content["format"] == f"seaid {line.split()[0]} 1"
    assert (said.err, plain.out) == (plain.err, "")


def test_undecodable_bytes_of_a_path_are_escaped_in_json() -> None:
    content = json.loads(run("inspect", "caf\udce9.urdf", "--json").out)
    assert "caf\udce9.urdf" in content["error"]["message"].replace("\\udce9", "\udce9")


def test_the_view_has_its_address_in_json(arm: Path) -> None:
    pytest.importorskip("viser")
    options = ("--port", "0", "--seconds", "0", "--no-browser", "--json")
    content = json.loads(done("view", arm / "arm.urdf", *options).out)
    assert [*content] == KEYS
    assert content["result"]["url"].startswith("http://127.0.0.1:")
    assert content["robot"] == "small_arm"


def test_an_unknown_command_is_an_error_in_json(arm: Path) -> None:
    said = run("identfy", "--json")
    content = json.loads(said.out)
    assert (said.code, content["command"]) == (2, "seaid")
    assert "Did you mean 'identify'?" in content["error"]["message"]


def test_a_failed_comparison_prints_one_json(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import seaid

    apart = seaid.regressor.CrossCheck(False, False, float("inf"), 1.0, (6, 7))
    monkeypatch.setattr("seaid.regressor.cross_check", lambda *_: apart)
    said = run("inspect", arm / "arm.urdf", "--exact", "--json")
    assert json.loads(said.out)["result"]["exact"]["agree"] is False
    assert said.code == 1


def test_notes_are_in_the_json(arm: Path, tmp_path: Path) -> None:
    rounded = (arm / "arm.urdf").read_text()
    rounded = rounded.replace('xyz="0 0 -0.3"', 'xyz="0 0 -0.3" rpy="1.5708 0 0"')
    (tmp_path / "rounded.urdf").write_text(rounded)
    said = done("inspect", tmp_path / "rounded.urdf", "--json")
    (note,) = json.loads(said.out)["notes"]
    assert "1.5708" in note
    assert said.err == f"note: {note}\n"


def test_a_folder_for_the_output_is_refused_before_the_work(arm: Path) -> None:
    words = refused("identify", *robot_and_drives(arm), arm / "run.csv", "-o", arm)
    assert "is a folder: name a file in it" in words
