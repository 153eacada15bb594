"""seaid.toml: what it means, what is wrong in it, and where."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import seaid
from seaid.errors import SeaidError
from seaid.project import load_project, log_at, run_project
from seaid.project.running import _file_name
from tests import experiments
from tests.measured import LOGS

MODELS = experiments.MODELS
PROJECT = """urdf = "arm.urdf"
drives = "arm.toml"
gravity = [0, 0, -9.8]

[[payload]]
link = "forearm"
mass_kg = 0.5
com_m = [0.1, 0, 0]
inertia_kg_m2 = [0.01, 0.02, 0.03, 0.001, 0.002, 0.003]

[[log]]
file = "run.npz"
description = "columns.toml"
between_s = [0, 20]

[[log]]
file = "run.npz"
description = "columns.toml"
use = "validate"
between_s = [20, 100]

[identify]
estimator = "huber"
known_std = { torque = 0.03 }
torque_joints = ["joint_0"]

[run]
folder = "results"
write = ["parameters", "report", "urdf", "mjcf"]
fail_on = "wrong"

[experiment]
place = "Eindhoven"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, source in {
        "arm.urdf": MODELS / "hebi_arm_2.urdf",
        "arm.toml": MODELS / "hebi_arm_2.toml",
        "columns.toml": LOGS / "hebi_csv_2.toml",
        "run.npz": LOGS / "hebi_arms/grav_comp_bad.npz",
    }.items():
        (tmp_path / name).symlink_to(source)
    (tmp_path / "seaid.toml").write_text(PROJECT)
    return tmp_path


def test_a_project_is_read_from_anywhere(folder: Path) -> None:
    project = load_project(folder)
    assert load_project(folder / "seaid.toml").urdf == project.urdf == folder / "arm.urdf"
    robot = project.robot()
    payload = seaid.Payload(
        "forearm",
        0.5,
        (0.1, 0.0, 0.0),
        ((0.01, 0.001, 0.002), (0.001, 0.02, 0.003), (0.002, 0.003, 0.03)),
    )
    assert np.allclose(robot.payload_parameters[10:], payload.parameters)
    assert robot.model.gravity.linear.tolist() == [0, 0, -9.8]
    assert project.options.estimator == "huber"
    assert dict(project.options.known_std) == {"torque": 0.03}
    (own,), (unseen,) = project.logs_for("identify"), project.logs_for("validate")
    assert own.read(robot).time[-1] < 20 <= unseen.read(robot).time[0]
    assert (own.name, unseen.name) == ("run.npz@0:20", "run.npz@20:100")
    assert dict(project.experiment) == {"place": "Eindhoven"}


@pytest.mark.slow  # three identifications
def test_a_run_has_a_folder_with_everything(folder: Path) -> None:
    project = load_project(folder)
    done = run_project(project, command=["seaid", "run"])
    latest = folder / "results" / "latest"
    assert done.folder.parent == folder / "results"
    assert latest.resolve() == done.folder.resolve()
    names = {one.name for one in done.files}
    assert names == {one.name for one in done.folder.iterdir()} - {"inputs"}
    assert {"report.html", "parameters.json", "identification.npz", "hebi_arm_2.urdf"} <= names
    inputs = {one.name for one in (done.folder / "inputs").iterdir()}
    assert inputs == {"seaid.toml", "arm.urdf", "arm.toml"}
    (note,) = done.notes
    assert note.startswith("hebi_arm_2.xml was not written: joint 'joint_0': 'coulomb_friction_Nm'")
    found = done.runs[""].identification
    direct = seaid.identify(
        project.robot(),
        [one.read(project.robot()) for one in project.logs_for("identify")],
        estimator="huber",
        torque_joints=["joint_0"],
        known_std={"torque": 0.03},
        feasible=True,
    )
    assert np.array_equal(found.load.values, direct.load.values)
    saved = seaid.project.load_run(latest)
    assert saved.identification.summary() == found.summary()
    assert [*saved.validations] == ["run.npz@20:100"]
    assert len({one["path"] for one in saved.provenance["inputs"] if one["sha256"]}) == 5
    page = (done.folder / "report.html").read_text()
    assert "Eindhoven" in page
    assert "seaid run" in page
    again = run_project(project)
    assert again.folder != done.folder
    assert latest.resolve() == again.folder.resolve()


@pytest.mark.slow  # 0.5 s
def test_a_run_that_fails_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise SeaidError("the disk is full")

    monkeypatch.setattr("seaid.project.running.save_run", full)
    with pytest.raises(SeaidError, match="the disk is full"):
        run_project(load_project(folder))
    assert [*(folder / "results").iterdir()] == []


@pytest.mark.slow  # simulates the leg
def test_conditions_are_identified_together(tmp_path: Path) -> None:
    robot = experiments.leg(experiments.TEST_MASS)
    motion = experiments.leg_motion(experiments.TEST_MASS)
    text = f'urdf = "{MODELS / "tulip_leg.urdf"}"\ndrives = "{MODELS / "tulip_leg.toml"}"\n'
    text += '[[payload]]\nlink = "foot"\nmass_kg = 2.0\ncom_m = [0.15, 0, 0]\n[run]\nwrite = []\n'
    for seed, name in enumerate(("cold", "warm")):
        log = seaid.simulation.simulation.measure(robot, motion, experiments.LEG_SENSORS, seed)
        seaid.write_log(log, tmp_path / f"{name}.npz")
        text += f'[[log]]\nfile = "{name}.npz"\ncondition = "{name}"\n'
    (tmp_path / "seaid.toml").write_text(text)
    done = run_project(load_project(tmp_path))
    assert [*done.runs] == ["cold", "warm"]
    assert done.conditions is not None
    cold, warm = (seaid.project.load_run(done.folder / name).identification for name in done.runs)
    assert np.array_equal(cold.load.values, warm.load.values)
    offsets = [one.drives["knee_pitch"].value("spring_offset") for one in (cold, warm)]
    assert offsets[0] != offsets[1]
    with pytest.raises(SeaidError, match=r"of several conditions: name .*; they are cold, warm"):
        seaid.project.load_run(done.folder)
    (tmp_path / "seaid.toml").write_text(text + '[identify]\nmethod = "simultaneous"\n')
    with pytest.raises(SeaidError, match=r"\[identify\]: 'method' is for logs of one condition"):
        run_project(load_project(tmp_path))


TWICE = "is used twice"

A, B, OTHER = '["a.csv", "b.csv"]', '["b.csv", "a.csv"]', "validate on another"

PAIRS = {
    f'[[log]]\nfiles = {A}\n[[log]]\nfiles = {B}\nuse = "validate"': "validate on",
    '[[log]]\nfile = "a.csv"\n[[log]]\nfile = "a.csv"\nuse = "validate"': OTHER,
    '[[log]]\nfile = "a.csv"\n[[log]]\nfile = "./x/../a.csv"\nuse = "validate"': OTHER,
    '[[log]]\nfile = "a.csv"\n[[log]]\nfile = "a.csv"': TWICE,
    "".join(f'[[log]]\nfile = "a.csv"\nbetween_s = {x}\n' for x in ([0, 9], [8, 20])): TWICE,
    '[[log]]\nfile = "a.csv"\n[[log]]\nfile = "c.csv"\nuse = "validate"': "no log '.*c.csv'",
    "": "has no log to identify from",
}
"""{the logs of a project: what is wrong with them}"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('urdf = "arm.urdf"', "", r"seaid.toml': key 'urdf' is missing"),
        ('drives = "arm.toml"', "drive = 1", r"no key is named 'drive'; did you mean 'drives'"),
        ("[[log]]", "[log]", r"cannot read|not valid TOML|is not valid"),
        ('use = "validate"', 'use = "test"', r"\[\[log\]\] 2: 'use': no value is named 'test'"),
        (
            'use = "validate"',
            'condition = "x"\nuse = "validate"',
            "no log identifies the condition x",
        ),
        ("between_s = [0, 20]", "between_s = [20, 0]", r"\[\[log\]\] 1: 'between_s' must be"),
        ("between_s = [0, 20]", "", r"'run.npz@20:100' is used twice"),
        ('file = "run.npz"', "files = []", r"\[\[log\]\] 1: give either 'file' or 'files'"),
        ('link = "forearm"', "", r"\[\[payload\]\] 1: key 'link' is missing"),
        ('fail_on = "wrong"', 'fail_on = "bad"', r"\[run\]: 'fail_on': no value is named 'bad'"),
        ('["joint_0"]', '"joint_0"', r"'torque_joints' must be a list, as torque_joints"),
        ("mass_kg = 0.5", 'mass_kg = 0.5\ncondition = "hot"', r"\[\[payload\]\] 1: no condition"),
    ],
)
def test_what_is_wrong_in_it_is_said_with_its_place(
    old: str, new: str, words: str, folder: Path
) -> None:
    assert old in PROJECT
    (folder / "seaid.toml").write_text(PROJECT.replace(old, new, 1))
    with pytest.raises(SeaidError, match=words):
        run_project(load_project(folder))


@pytest.mark.parametrize("logs", PAIRS)
def test_logs_are_checked_before_a_run(tmp_path: Path, logs: str) -> None:
    (tmp_path / "x").mkdir()
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("")
    (tmp_path / "seaid.toml").write_text(f'urdf = "arm.urdf"\n{logs}\n')
    with pytest.raises(SeaidError, match=PAIRS[logs]):
        run_project(str(tmp_path))


def test_names_of_folders_are_short_and_distinct(tmp_path: Path) -> None:
    assert [_file_name(x) for x in ("a b/c", "..", "", 300 * "é")] == [
        *("a_b_c", "without_name", "without_name", 50 * "é")
    ]
    text = 'urdf = "arm.urdf"\n'
    for name in ("warm", "Warm"):
        (tmp_path / f"{name}.csv").touch()
        text += f'[[log]]\nfile = "{name}.csv"\ncondition = "{name}"\n'
    (tmp_path / "seaid.toml").write_text(text)
    with pytest.raises(SeaidError, match="a folder of its name: give other names than warm, Warm"):
        run_project(tmp_path)


def test_parts_of_logs_on_the_command_line(tmp_path: Path) -> None:
    part = log_at(Path("a/run.csv@1.5:20"))
    assert (part.files, part.between_s) == ((Path("a/run.csv"),), (1.5, 20.0))
    assert log_at(Path("run.csv@5:")).between_s == (5.0, np.inf)
    (tmp_path / "odd@1:2").write_text("")
    assert log_at(tmp_path / "odd@1:2").between_s is None
    assert log_at(Path("me@home.csv")).between_s is None
    with pytest.raises(SeaidError, match="must end after its start"):
        log_at(Path("run.csv@20:10"))
