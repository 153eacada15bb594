"""init, run, and the project file and the saved run as defaults of all other commands."""

import json
import shutil
from pathlib import Path

import pytest

import seaid
from tests.cli.small_arm import done
from tests.cli.small_arm import run as run_command
from tests.cli.test_commands import KEYS


@pytest.fixture(scope="module")
def project(arm: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a project that was run."""
    folder = tmp_path_factory.mktemp("project")
    for name in ("arm.urdf", "arm.toml", "run.csv", "other.csv"):
        shutil.copy(arm / name, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        made = json.loads(done("init", "arm.urdf", "run.csv", "other.csv", "--json").out)
        ran = json.loads(done("run", "--json").out)
    assert [*made] == [*ran] == KEYS
    assert made["files"] == ["seaid.toml"]
    assert made["result"]["doubts"] == ["drives: 'arm.toml' lies next to the URDF and is used"]
    assert ran["robot"] == "small_arm"
    assert ran["verdict"]["level"].startswith("good")
    assert "runs/latest" not in ran["files"]
    return folder


@pytest.fixture
def here(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(project)
    return tmp_path


LOAD = """
[[payload]]
link = "lower"
mass_kg = 0.5
com_m = [0, 0, -0.2]
"""
SEARCH = "--duration 2 --starts 1 --iterations 5"
LINES: dict[str, tuple[str, str, str, str]] = {
    "robot and logs": ("", "", "identify", "arm.urdf run.csv --drives arm.toml --feasible"),
    "an option of the line wins": (
        "",
        "",
        "identify --estimator ols",
        "arm.urdf run.csv --drives arm.toml --feasible",
    ),
    "gravity and payloads": (
        "gravity = [0.0, 9.81, 0.0]\n",
        LOAD,
        "check",
        "arm.urdf run.csv --drives arm.toml --payload lower:0.5:0,0,-0.2 --gravity 0,9.81,0",
    ),
    "joints that are locked": (
        'joints = ["elbow"]\nlocked = { shoulder = 0.4 }\n',
        "",
        f"excite {SEARCH} -o plan.json",
        "arm.urdf --drives arm.toml --joints elbow --locked shoulder=0.4",
    ),
}
"""{what a project gives: the start and the end of its file, a command, and what it stands for}."""


@pytest.mark.parametrize("given", LINES)
def test_a_project_stands_for_the_words_of_a_line(
    given: str, here: Path, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Outside of the folder the same words have to be named, with the same result."""
    start, end, command, words = LINES[given]
    results = []
    for name, arguments in (("of_project", ""), ("of_line", words)):
        (here / name).mkdir()
        for file in ("arm.urdf", "arm.toml", "run.csv", "other.csv"):
            shutil.copy(project / file, here / name)
        if name == "of_project":
            text = (project / "seaid.toml").read_text()
            (here / name / "seaid.toml").write_text(start + text + end)
        monkeypatch.chdir(here / name)
        verb, *more = command.split()
        said = done(verb, *arguments.split(), *more, "--json")
        results.append(json.loads(said.out)["result"])
    assert results[0] == results[1]


def test_nothing_is_identified_again(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("identified again")

    monkeypatch.setattr("seaid.identification.identification.identify", never)
    monkeypatch.setattr(seaid.identification, "identify", never, raising=False)
    assert "Unseen motion" in done("validate").out
    assert "Unseen motion" in done("validate", "other.csv").out
    done("report", "-o", here / "report.html")
    assert "other.csv" in (here / "report.html").read_text()
    done("export", "-o", here / "found.urdf")
    written = (here / "found.urdf").read_text()
    assert written == Path("runs/latest/small_arm.urdf").read_text()


def test_a_run_outlives_its_robot_file(project: Path, tmp_path: Path) -> None:
    moved = tmp_path / "moved"
    shutil.copytree((project / "runs" / "latest").resolve(), moved)
    before = seaid.project.load_run(moved)
    assert before.identification.robot.urdf == project / "arm.urdf"
    (project / "arm.urdf").rename(project / "gone.urdf")
    try:
        after = seaid.project.load_run(moved).identification
        assert after.robot.urdf == after.known.urdf == moved / "inputs" / "arm.urdf"
        seaid.write_urdf(after.robot, tmp_path / "found.urdf")
    finally:
        (project / "gone.urdf").rename(project / "arm.urdf")


@pytest.mark.slow  # 0.9 s
def test_what_changed_since_a_run_is_said(here: Path, project: Path) -> None:
    copy = here / "copy"
    shutil.copytree(project, copy, symlinks=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(copy)
        done("run")
        with (copy / "arm.toml").open("a") as file:
            file.write("# changed\n")
        said = done("report")
        assert "arm.toml changed since 'runs/latest' was made: repeat seaid run" in said.err
        again = done("report", "--force", "--from", "run.csv").err
        assert "are from 'seaid.toml'" in again
        assert "changed since" not in again


def test_a_line_with_a_robot_has_nothing_of_the_project(here: Path) -> None:
    named = done("identify", "arm.urdf", "run.csv", "-o", here / "a.json")
    assert "seaid.toml" not in named.err
    assert "are from 'seaid.toml'" in done("identify", "run.csv", "-o", here / "b.json").err
    assert (here / "a.json").read_bytes() != (here / "b.json").read_bytes()


def test_projects_of_a_folder_end_with_the_worst_code(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "seaid.toml").write_text('urdf = "arm.urdf"\n[[log]]\nfile = "no.csv"\n')
    ended = run_command("run", tmp_path, "--json")
    assert ended.code == 1
    first, second = json.loads(ended.out)["result"]["projects"]
    assert (first["project"], second["project"]) == (str(tmp_path / "a"), str(tmp_path / "b"))
    assert first["verdict"] == second["verdict"] == "failed"
    table = run_command("run", tmp_path).out
    assert "report, or what is wrong" in table
    assert "there is no log" in table
    assert "it is for one project" in run_command("run", tmp_path, "--open").err
    alone = run_command("run", tmp_path / "a", "--executor", "dask:x").err
    assert "it is for a folder with several projects" in alone
