"""One log in several files: positions here, currents there, each with its own clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log import Log, LogDescription, describe_log, read_log
from seaid.log.channels import OF_JOINTS
from seaid.log.describe import logs_of_files
from seaid.log.sources import of_other_names
from seaid.project import load_project, write_first_project
from seaid.project.project import ProjectLog
from seaid.robot import Robot
from tests.plants import write_columns

FAST: Array = np.linspace(0.0, 4.0, 401)
SLOW: Array = np.linspace(0.0, 4.0, 201)
JOINTS = {"arm": {"joint_position": "q", "motor_torque": {"column": "tau", "unit": "mNm"}}}


def q(time: Array) -> Array:
    return np.sin(3 * time)


def tau(time: Array) -> Array:
    return 2e3 * np.cos(2 * time)


def write(path: Path, **columns: Array) -> Path:
    return write_columns(path, columns)


def both(folder: Path, time: str = "t") -> list[Path]:
    """Return a file with positions, and one with torques at half the rate."""
    torques = write(folder / "torques.csv", **{time: SLOW, "tau": tau(SLOW)})
    return [write(folder / "positions.csv", t=FAST, q=q(FAST)), torques]


def check(log: object) -> None:
    assert isinstance(log, Log)
    np.testing.assert_allclose(log.joint_position[:, 0], q(log.time), atol=1e-6)
    np.testing.assert_allclose(log.motor_torque[:, 0], 1e-3 * tau(log.time), atol=2e-3)
    assert len(log.time) == 401


def test_several_files_are_one_log(arm: Robot, tmp_path: Path) -> None:
    """With clocks of one name, with seaid's own columns, and as the log of a project."""
    files, description = both(tmp_path), {"time": "t", "joints": JOINTS}
    check(read_log(files, arm, description=description))
    torque = 'motor_torque = { column = "tau", unit = "mNm" }'
    text = f'time = "t"\n[joints.arm]\njoint_position = "q"\n{torque}\n'
    (tmp_path / "run.toml").write_text(text)
    check(ProjectLog(tuple(files), description=tmp_path / "run.toml").read(arm))
    columns = {"arm.joint_position_rad": q(FAST), "arm.motor_torque_Nm": 1e-3 * tau(SLOW)}
    paths = [
        write(tmp_path / f"{k}.csv", **{"time_s": time, name: columns[name]})
        for k, (name, time) in enumerate(zip(columns, (FAST, SLOW), strict=True))
    ]
    check(read_log(paths, arm))
    with pytest.raises(LogError, match=r"no column is named 'x'; allowed: positions.csv:t, q, tor"):
        read_log(files, arm, description={"time": "x", "joints": JOINTS})


@pytest.mark.parametrize("time", ["t", "stamp"])
def test_the_description_names_the_files(arm: Robot, tmp_path: Path, time: str) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    guess = describe_log(both(folder, time), arm)
    assert guess.description.files == ("positions.csv", "torques.csv")
    text = guess.to_toml().replace('column = "tau"', 'column = "tau", unit = "mNm"')
    for name in ("positions.toml", "run.toml"):
        (folder / name).write_text(text)
    assert "files = [" in text
    check(read_log(folder / "positions.csv", arm))
    check(read_log(folder / "run.toml", arm))
    check(read_log(folder / "torques.csv", arm, description=folder / "run.toml"))


def test_files_of_matrices_are_told_apart_by_their_names(arm: Robot, tmp_path: Path) -> None:
    for name, values in (("time.txt", FAST), ("q.txt", q(FAST)), ("tau.txt", tau(FAST))):
        np.savetxt(tmp_path / name, values)
    paths = [tmp_path / name for name in ("time.txt", "q.txt", "tau.txt")]
    torque = {"column": "tau.txt:1", "unit": "mNm"}
    joints = {"arm": {"joint_position": "q.txt:1", "motor_torque": torque}}
    check(read_log(paths, arm, description={"time": "time.txt:1", "joints": joints}))


def names_of(logs: list[tuple[Path, ...]]) -> list[list[str]]:
    return [[path.name for path in files] for files in logs]


def test_files_of_one_motion_are_recognised_by_columns_and_times(
    arm: Robot, tmp_path: Path
) -> None:
    """Files of other columns over the same time are one log; others stay apart, in doubt or not."""
    positions, torques = both(tmp_path)
    logs, (doubt,) = logs_of_files([positions, torques], arm)
    assert names_of(logs) == [["positions.csv", "torques.csv"]]
    words = "positions.csv, torques.csv: different columns over the same time (4 s): taken for"
    assert doubt.startswith(words)
    again = write(tmp_path / "again.csv", t=FAST, q=q(FAST))
    hip = write(tmp_path / "hip.csv", t=FAST, hip_pos=q(FAST), hip_torque=tau(FAST))
    knee = write(tmp_path / "knee.csv", t=FAST, knee_pos=q(FAST), knee_torque=tau(FAST))
    for apart in ([tmp_path / "no.csv", positions, again], [hip, knee]):
        assert logs_of_files(apart, arm) == ([(path,) for path in apart], ())
    late = write(tmp_path / "torques.csv", t=SLOW + 1000, tau=tau(SLOW))
    logs, (doubt,) = logs_of_files([positions, late], arm)
    assert names_of(logs) == [["positions.csv"], ["torques.csv"]]
    assert doubt.startswith("positions.csv and torques.csv have different columns, and one lacks")
    assert 'files = ["positions.csv", "torques.csv"]' in doubt


@pytest.mark.parametrize("prefix", ["", "my "])
def test_columns_with_names_of_seaid_need_no_description(
    arm: Robot, tmp_path: Path, prefix: str
) -> None:
    """Whatever their samples suggest; with other names they need one."""
    names = [row.columns("arm")[0] for row in OF_JOINTS.values()]
    columns = {f"{prefix}{x}": q(FAST) * (1 + k) for k, x in enumerate(names)}
    guess = describe_log(write(tmp_path / "run.csv", time_s=FAST, **columns), arm)
    assert guess.description.joints
    rest = of_other_names(guess.description, arm)
    assert rest.joints == (guess.description.joints if prefix else {})
    assert of_other_names(LogDescription(rest.joints), arm).joints == rest.joints


def test_a_first_project_lists_the_files_of_one_log(arm: Robot, tmp_path: Path) -> None:
    positions, torques = both(tmp_path)
    shifted = [
        write(tmp_path / "b_q.csv", t=FAST + 60, q=q(FAST)),
        write(tmp_path / "b_tau.csv", t=SLOW + 60, tau=tau(SLOW)),
    ]
    assert arm.urdf is not None
    made = write_first_project(arm.urdf, [positions, *shifted, torques], folder=tmp_path)
    text = (tmp_path / "seaid.toml").read_text()
    assert 'files = ["positions.csv", "torques.csv"]' in text
    assert 'files = ["b_q.csv", "b_tau.csv"]' in text
    assert sum("of one log" in one for one in made.doubts) == 2
    project = load_project(tmp_path)
    assert [one.use for one in project.logs] == ["identify", "validate"]
    log = project.logs[0].read(arm)
    np.testing.assert_allclose(log.joint_position[:, 0], q(log.time), atol=1e-6)


@pytest.mark.parametrize(
    ("files", "change", "words"),
    [
        ([], {}, "path= is an empty list: name the files of the log"),
        (["a.csv", "b/a.csv"], {}, "need names of their own, found a.csv, a.csv"),
        (["a.csv", "b.csv"], {}, "several files have a column 'q': write 'a.csv:q' or 'b.csv:q'"),
        (["a.csv", "no.csv"], {}, "no log file at"),
        ("none.toml", {"files": 3}, "'files' must be a list, as files = "),
    ],
)
def test_mistakes_are_named(
    arm: Robot, tmp_path: Path, files: list[str] | str, change: dict[str, object], words: str
) -> None:
    (tmp_path / "b").mkdir()
    for name in ("a.csv", "b.csv", "b/a.csv"):
        write(tmp_path / name, t=FAST, q=q(FAST), tau=tau(FAST))
    path = tmp_path / files if isinstance(files, str) else [tmp_path / one for one in files]
    with pytest.raises(LogError) as caught:
        read_log(path, arm, description={"time": "t", "joints": JOINTS, **change})
    assert words in str(caught.value)
