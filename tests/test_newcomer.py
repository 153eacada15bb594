"""Mistakes of newcomers at the command line: each is named, with its place and what repairs it.

The formal ones are on a small arm; those that need physics are the severe ones of the gauntlet, on
the leg, handed over as files.
"""

from __future__ import annotations

import gzip
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from scripts.gauntlet_mistakes import Case, Setup, mistakes
from scripts.gauntlet_robots import subjects
from tests.cli.test_cli import arm, run

__all__ = ["arm"]


def changed(name: str, old: str, new: str, count: int = -1) -> Callable[[Path], None]:
    """Return what replaces a text in a file."""

    def change(folder: Path) -> None:
        file = folder / name
        text = file.read_text()
        assert old in text, (name, old)
        file.write_text(text.replace(old, new, count))

    return change


def written(name: str, content: str | bytes) -> Callable[[Path], None]:
    """Return what writes a file."""

    def write(folder: Path) -> None:
        data = content.encode() if isinstance(content, str) else content
        (folder / name).write_bytes(data)

    return write


def rows(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    """Return what changes the numbers of run.csv."""

    def write(folder: Path) -> None:
        file = folder / "run.csv"
        header = file.read_text().splitlines()[0]
        values = change(np.loadtxt(file, delimiter=",", skiprows=1))
        np.savetxt(file, values, delimiter=",", header=header, comments="", fmt="%.9g")

    return write


def time(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    """Return what changes the times of run.csv."""
    return rows(lambda values: np.column_stack([change(values[:, 0]), values[:, 1:]]))


def with_semicolons(folder: Path) -> None:
    """Write the log as a German spreadsheet does."""
    text = (folder / "run.csv").read_text()
    (folder / "run.csv").write_text(
        text.replace(",", ";").replace(".", ",").replace(",m", ".m").replace(",j", ".j")
    )


def without_header(folder: Path) -> None:
    lines = (folder / "run.csv").read_text().splitlines(keepends=True)
    (folder / "run.csv").write_text("".join(lines[1:]))


def nothing(folder: Path) -> None:
    """Change no file: the mistake is on the line."""


IDENTIFY = "identify arm.urdf run.csv --drives arm.toml"
FORMAL: dict[str, tuple[Callable[[Path], None], str, str]] = {
    # the robot
    "no robot": (nothing, "identify", r"URDF: it is missing: name it, or have a seaid.toml here"),
    "no log": (nothing, "identify arm.urdf", r"LOG: it is missing"),
    "wrong name of the URDF": (nothing, "inspect arn.urdf", r"no URDF file at 'arn.urdf'"),
    "drives in place of the URDF": (nothing, "inspect arm.toml", r"arm.toml.*(drives|TOML)"),
    "log in place of the URDF": (nothing, "identify run.csv arm.urdf", r"'?run.csv'?.*(log|URDF)"),
    "URDF cut off": (
        changed("arm.urdf", "</robot>", ""),
        "inspect arm.urdf",
        r"arm.urdf.*line \d+",
    ),
    "xacro": (
        written("arm.xacro", '<robot xmlns:xacro="http://ros.org/wiki/xacro" name="a"/>'),
        "inspect arm.xacro",
        r"xacro",
    ),
    "compressed": (
        written("arm.urdf.gz", gzip.compress(b"<robot/>")),
        "inspect arm.urdf.gz",
        r"arm.urdf.gz",
    ),
    "floating joint": (
        changed("arm.urdf", 'type="revolute"', 'type="floating"', 1),
        "inspect arm.urdf",
        r"joint 'shoulder' is floating.*--joints",
    ),
    "mimic of nothing: named though it can be read": (
        changed("arm.urdf", '<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="hand"/>', 1),
        "inspect arm.urdf",
        r"<mimic> of shoulder names joints that are not there \(hand\)",
    ),
    "no joint moves": (
        changed("arm.urdf", 'type="revolute"', 'type="fixed"'),
        "inspect arm.urdf",
        r"has no joint that moves",
    ),
    "unknown joint": (
        nothing,
        "inspect arm.urdf --joints shoulder,ellbow",
        r"did you mean 'elbow'",
    ),
    "joint with a capital": (
        changed("arm.toml", "[elbow]", "[Elbow]"),
        "inspect arm.urdf --drives arm.toml",
        r"no joint is named 'Elbow'; did you mean 'elbow'",
    ),
    "payload on no link": (
        nothing,
        "inspect arm.urdf --payload hand:1:0,0,0",
        r"--payload: no link is named 'hand'",
    ),
    "payload without mass": (
        nothing,
        "inspect arm.urdf --payload lower",
        r"--payload.*link:mass:x,y,z, as foot:2.0",
    ),
    "payload with a negative mass": (
        nothing,
        "inspect arm.urdf --payload lower:-1",
        r"payload on 'lower' must have a mass",
    ),
    "gravity as a number": (nothing, "inspect arm.urdf --gravity 9.81", r"--gravity.*as 0,0,-9.81"),
    "known body that is none": (
        nothing,
        f"{IDENTIFY} --known-body base",
        r"--known-body.*no moving joint.*'base'",
    ),
    # the drives
    "no drives file": (
        nothing,
        "inspect arm.urdf --drives no.toml",
        r"cannot read drives 'no.toml'",
    ),
    "TOML syntax": (
        changed("arm.toml", "gear_ratio = 50.0", "gear_ratio 50.0"),
        "inspect arm.urdf --drives arm.toml",
        r"drives 'arm.toml'.*not valid TOML.*line 3",
    ),
    "ratio as 100:1": (
        changed("arm.toml", "gear_ratio = 100.0", 'gear_ratio = "100:1"'),
        "inspect arm.urdf --drives arm.toml",
        r"arm.toml: \[elbow\]: gear_ratio.*'100:1'",
    ),
    "ratio of zero": (
        changed("arm.toml", "gear_ratio = 100.0", "gear_ratio = 0"),
        "inspect arm.urdf --drives arm.toml",
        r"arm.toml: \[elbow\]: gear_ratio.*found 0",
    ),
    "unknown key": (
        changed("arm.toml", "stiffness_Nm_per_rad", "stiffness"),
        "inspect arm.urdf --drives arm.toml",
        r"arm.toml: \[elbow\]: no key is named 'stiffness'; did you mean 'stiffness_Nm_per_rad'",
    ),
    "unknown type": (
        changed("arm.toml", '"series_elastic"', '"elastic"'),
        "inspect arm.urdf --drives arm.toml",
        r"\[elbow\]: no drive type is named 'elastic'",
    ),
    "no ratio": (
        changed("arm.toml", "gear_ratio = 100.0\n", ""),
        "inspect arm.urdf --drives arm.toml",
        r"\[elbow\]: key 'gear_ratio' is missing",
    ),
    "negative stiffness": (
        changed("arm.toml", "250.0", "-250.0"),
        "inspect arm.urdf --drives arm.toml",
        r"\[elbow\].*stiffness.*-250",
    ),
    # the log
    "wrong name of the log": (nothing, "identify arm.urdf run.cvs", r"no log file at 'run.cvs'"),
    "a missing column": (
        changed("run.csv", "elbow.motor_torque_Nm", "elbow.torque"),
        IDENTIFY,
        r"'run.csv'.*elbow.motor_torque_Nm",
    ),
    "column of a joint with a capital": (
        changed("run.csv", "elbow.motor_position_rad", "Elbow.motor_position_rad"),
        IDENTIFY,
        r"'Elbow.motor_position_rad' in the file is similar to 'elbow.motor_position_rad'",
    ),
    "no header": (without_header, IDENTIFY, r"'run.csv'.*no header"),
    "an empty file": (written("run.csv", ""), IDENTIFY, r"'run.csv' (is empty|has no)"),
    "only a header": (
        lambda folder: written("run.csv", (folder / "run.csv").read_text().splitlines()[0])(folder),
        IDENTIFY,
        r"'run.csv'.*(no samples|no rows|too short|samples)",
    ),
    "xlsx": (written("run.xlsx", b"PK\x03\x04"), "identify arm.urdf run.xlsx", r"run.xlsx.*CSV"),
    "times that repeat": (
        time(lambda t: np.where(np.arange(len(t)) == 50, t[49], t)),
        IDENTIFY,
        r"time.*--repair",
    ),
    "times that go back": (
        time(lambda t: np.where(np.arange(len(t)) == 50, t[40], t)),
        IDENTIFY,
        r"time.*--repair",
    ),
    "epoch with too few digits": (
        time(lambda t: 1.7e9 + np.round(t, 1)),
        IDENTIFY,
        r"time.*(digits|rate_hz|resolution|steps)",
    ),
    "time in ms: named though it can be read": (time(lambda t: 1e3 * t), IDENTIFY, r"time.*ms"),
    "not a number": (
        changed("run.csv", ",0.", ",abc", 1),
        IDENTIFY,
        r"'run.csv', line 2: column 'shoulder.mo.* has 'abc",
    ),
    "a hole in a channel": (
        rows(
            lambda x: np.where(
                (np.arange(x.shape[1]) == 2) & (np.arange(len(x)) == 80)[:, None], np.nan, x
            )
        ),
        IDENTIFY,
        r"run.csv.*--repair",
    ),
    "unknown column in the description": (
        written("run.toml", '[joints.elbow]\nmotor_torque = "tau_2"\n'),
        IDENTIFY,
        r"'tau_2'",
    ),
    "unknown unit in the description": (
        written(
            "run.toml",
            '[joints.elbow]\nmotor_torque = { column = "elbow.motor_torque_Nm", unit = "lbf" }\n',
        ),
        IDENTIFY,
        r"run.toml.*'lbf'",
    ),
    "unknown joint in the description": (
        written("run.toml", '[joints.elbo]\nmotor_torque = "elbow.motor_torque_Nm"\n'),
        IDENTIFY,
        r"'elbo'.*did you mean 'elbow'",
    ),
    "the same log twice": (nothing, "identify arm.urdf run.csv run.csv", r"run.csv.*twice"),
    # options
    "unknown estimator": (nothing, f"{IDENTIFY} --estimator best", r"--estimator.*'best'.*wls"),
    "unknown method": (nothing, f"{IDENTIFY} --method both", r"--method.*'both'.*two-step"),
    "unknown severity": (nothing, f"{IDENTIFY} --fail-on bad", r"--fail-on.*'bad'.*wrong"),
    "unknown option": (nothing, f"{IDENTIFY} --drive a", r"No such option: --drive.*--drives"),
    "cutoff above the rate": (nothing, f"{IDENTIFY} --cutoff-hz 4000", r"cutoff.*4000"),
    "cutoff of nothing": (nothing, f"{IDENTIFY} --cutoff-hz 0", r"cutoff.*0"),
    "unknown constant": (nothing, f"{IDENTIFY} --known-std torqe=0.1", r"--known-std.*'torqe'"),
    "validation on the own log": (
        nothing,
        "validate arm.urdf run.csv --from run.csv --drives arm.toml",
        r"validate on another",
    ),
    "validation from nothing": (nothing, "validate arm.urdf run.csv", r"--from, --run: give one"),
    "no saved run": (nothing, "report --run runs/latest", r"no saved run at 'runs/latest'"),
    "a result that exists": (nothing, f"{IDENTIFY} -o run_plan.json", r"is there already.*--force"),
    "a result that is read": (nothing, f"{IDENTIFY} -o arm.toml", r"is read by this command"),
    "unknown format of an export": (
        nothing,
        "export arm.urdf --from run.csv -o arm.sdf",
        r"must end in .urdf or .xml",
    ),
    "no limits of velocity": (
        changed("arm.urdf", ' velocity="3"', ""),
        "excite arm.urdf --duration 2 -o plan.json",
        r"velocity",
    ),
    "sensor that is none": (nothing, "inspect arm.urdf --sensors eye", r"no sensor is named 'eye'"),
    # the project
    "no project": (nothing, "run", r"cannot read the project 'seaid.toml'"),
    "unknown key of the project": (
        written("seaid.toml", 'urdf = "arm.urdf"\ndrive = "arm.toml"\n'),
        "run",
        r"'seaid.toml': no key is named 'drive'; did you mean 'drives'",
    ),
    "project without a log": (
        written("seaid.toml", 'urdf = "arm.urdf"\n'),
        "run",
        r"no log to identify from: add \[\[log\]\]",
    ),
    "project that is there": (
        written("seaid.toml", ""),
        "init arm.urdf run.csv",
        r"'seaid.toml' is there already",
    ),
}


@pytest.fixture
def folder(arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("arm.urdf", "arm.toml", "run.csv", "other.csv", "run_plan.json"):
        shutil.copy(arm / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", FORMAL)
def test_a_formal_mistake_is_named(name: str, folder: Path) -> None:
    change, line, words = FORMAL[name]
    change(folder)
    before = {one.name for one in folder.iterdir()}
    said = run(*line.split())
    text = " ".join((said.err + said.out).split())
    assert said.code in (1, 2) or "though it can be read" in name, text
    assert re.search(words, text), text
    assert "Traceback" not in text
    made = {one.name for one in folder.iterdir()} - before
    assert made <= ({"parameters.json"} if said.code == 0 else set())


def test_a_spreadsheet_with_semicolons_and_decimal_commas_is_read(folder: Path) -> None:
    plain = run(*IDENTIFY.split(), "--json").out
    (folder / "parameters.json").unlink()
    with_semicolons(folder)
    assert json.loads(run(*IDENTIFY.split(), "--json").out)["result"] == json.loads(plain)["result"]


def handed_over(setup: Setup, folder: Path) -> list[str]:
    """Write a set-up as files, and return the arguments of a command with them."""
    (folder / "robot.urdf").write_text(setup.urdf)
    line = ["robot.urdf"]
    for number, (log, description) in enumerate(zip(setup.logs, setup.descriptions, strict=True)):
        np.savetxt(
            folder / f"run{number}.csv",
            np.column_stack(list(log.values())),
            delimiter=",",
            header=",".join(log),
            comments="",
            fmt="%.17g",
        )
        line.append(f"run{number}.csv")
        if description:
            (folder / f"run{number}.toml").write_text(tomli_w.dumps(description))
    if setup.drives is not None:
        (folder / "drives.toml").write_text(tomli_w.dumps(setup.drives))
        line += ["--drives", "drives.toml"]
    for payload in setup.payloads:
        line += ["--payload", payload]
    return [*line, "--gravity", ",".join(map(str, setup.gravity))]


SEVERE = {one.name: one for one in mistakes() if one.form == "severe"}


@pytest.mark.slow  # each simulates and identifies a leg
@pytest.mark.parametrize("name", [*SEVERE])
def test_a_mistake_of_the_set_up_is_named(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mistake, case = SEVERE[name], Case(subjects()["leg"])
    setup = mistake.change(case, case.setup(mistake.truth, mistake.logs))
    assert setup is not None
    monkeypatch.chdir(tmp_path)
    said = run("identify", *handed_over(setup, tmp_path))
    text = " ".join((said.err + said.out).split())
    assert "Traceback" not in text
    named = any(f" {code}: " in text for code in mistake.codes)
    refused = said.code == 1 and any(word in text for word in mistake.words)
    assert named or refused, text[:1500]
