"""A URDF and a log of position commands lead to a run, a replay and a model for a simulator."""

from __future__ import annotations

import html
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid.errors import LogError, RobotError, SeaidError
from seaid.project import FirstProject
from tests import experiments
from tests.cli.small_arm import done, run
from tests.measured import LOGS
from tests.plants import write_columns, write_robot


def servo_project_of(
    folder: Path, *logs: Mapping[str, Array], **options: Any
) -> tuple[FirstProject, str]:
    """Write a first project of a servo from logs of columns; return it and its drives."""
    urdf = folder / "servo.urdf"
    shutil.copy(MODELS / "xl330_pendulum.urdf", urdf)
    paths = [write_columns(folder / f"log{k}.csv", log, "%.16g") for k, log in enumerate(logs)]
    made = seaid.write_first_project(urdf, paths, folder=folder / "made", **options)
    return made, (folder / "made" / "servo_drives.toml").read_text()


def two_sines(time: Array, fast: float = 0.25) -> Array:
    """Return positions of a servo: a wave, and a `fast` part of it with another frequency."""
    return np.asarray(0.4 * (np.sin(3 * time) + fast * np.sin(7 * time)))


GAINS: dict[str, tuple[dict[str, Any], bool]] = {
    "both": ({"velocity_gain_Nms_per_rad": 1.5, "position_gain_Nm_per_rad": 20.0}, True),
    "alone": ({"velocity_gain_Nms_per_rad": 1.5}, False),
    "unknown": ({}, False),
}


GO2 = LOGS / "go2_commands" / "go2_second_half.npz"
LEG = "FL_hip_joint,FL_thigh_joint,FL_calf_joint"
MODELS = experiments.MODELS


def test_gains_that_nobody_gave_are_asked_for(tmp_path: Path) -> None:
    made = seaid.write_first_project("go2", [GO2], joints=LEG.split(","), folder=tmp_path)
    drives = tmp_path / "go2_drives.toml"
    assert drives in made.files
    assert any("gain = torque / (command - position)" in one for one in made.doubts)
    assert drives.read_text().count('position_gain_Nm_per_rad = "?"') == 3
    with pytest.raises(RobotError, match=r"must be a number, found '\?'"):
        seaid.load_robot("go2", drives)
    drives.write_text(drives.read_text().replace('"?"', "20.0"))
    robot = seaid.load_project(tmp_path).robot()
    assert {one.controller for one in robot.drives.values()} == {
        seaid.Controller(position_gain_Nm_per_rad=20.0)
    }
    assert robot.known_bodies == ("FL_hip", "FL_thigh", "FL_calf")


@pytest.mark.parametrize("case", GAINS)
def test_velocity_commands_have_the_gain_of_the_measured_velocity(
    tmp_path: Path, case: str
) -> None:
    """Alone, their drive has no gain of the position."""
    gains, has_position = GAINS[case]
    time = np.arange(0, 6, 0.005)
    q = two_sines(time)
    columns = {"time_s": time, "pendulum.position_rad": q}
    columns["pendulum.velocity_command_rad_per_s"] = np.gradient(q, time)
    if has_position:
        columns["pendulum.position_command_rad"] = q
    laws = {"pendulum": seaid.Controller(**gains)} if gains else {}
    made, drives = servo_project_of(tmp_path, columns, controllers=laws)
    assert any("count as sent to the drive" in doubt for doubt in made.doubts)
    kind = "position" if has_position else "velocity"
    assert f'motor_input = "{kind}_command"' in drives
    assert ("position_gain" in drives.split("[pendulum.controller]")[1]) == has_position
    assert ("command_velocity_gain_Nms_per_rad = 1.5" in drives) == (case != "unknown")
    assert ('velocity_gain_Nms_per_rad = "?"' in drives) == (case == "unknown")


def test_gains_in_the_log_are_those_of_the_drives(tmp_path: Path) -> None:
    """Without a position gain the drive takes the velocities."""
    time = np.arange(0, 6, 0.005)
    q = two_sines(time)

    def log(gain: float) -> dict[str, Array]:
        sent = {"q": q, "dq": np.gradient(q, time), "kp": gain + 0 * q, "kd": 1.5 + 0 * q}
        commands = {f"motor_cmd[0].{name}": values for name, values in sent.items()}
        return {"time_s": time, "motor_state[0].q": q, **commands}

    _, drives = servo_project_of(tmp_path, log(40.0))
    assert "position_gain_Nm_per_rad = 40.0" in drives
    shutil.rmtree(tmp_path / "made")
    _, drives = servo_project_of(tmp_path, log(0.0))
    assert 'motor_input = "velocity_command"' in drives
    assert "command_velocity_gain_Nms_per_rad = 1.5" in drives


@pytest.mark.parametrize(
    ("period", "digits", "is_held"), [(5, 9, True), (2, 9, True), (1, 9, False), (1, 2, False)]
)
def test_commands_that_are_held_are_said(
    tmp_path: Path, period: int, digits: int, is_held: bool
) -> None:
    """Every fifth or second sample has another command, or rounding repeats those of all."""
    time = np.arange(0, 6, 0.005)
    q = 0.25 * two_sines(time)
    command = np.round(np.repeat(q[::period], period)[: len(time)], digits)
    columns = {"pendulum.position_rad": q, "pendulum.position_command_rad": command}
    made, drives = servo_project_of(tmp_path, {"time_s": time, **columns})
    assert ("is_held = true\n" in drives) == is_held
    assert any("is_held = true" in one for one in made.doubts) == is_held
    assert any("is_up_to_scale = true" in one for one in made.doubts)


def test_a_log_with_stamps_of_the_unix_time_in_rounded_milliseconds(tmp_path: Path) -> None:
    """Its parts had the same start and end, and held commands two steps."""
    time = np.arange(1800) / 120
    q = np.round(0.75 * two_sines(time, 1 / 3), 6)
    columns = {"pendulum_pos": q, "pendulum_cmd": np.repeat(q[::2], 2)}
    stamps = np.round(1.7e12 + 1e3 * time, 3)
    _, drives = servo_project_of(tmp_path, {"stamp_ms": stamps, **columns})
    assert "is_held = true\n" in drives
    file = tmp_path / "made" / "servo_drives.toml"
    file.write_text(drives.replace('"?"', "2.0"))
    parts = [one.name.partition("@")[2] for one in seaid.load_project(tmp_path / "made").logs]
    assert parts == ["1700000000:1700000010.5", "1700000010.5:1700000016"]


def test_gains_may_be_those_of_each_joint(tmp_path: Path) -> None:
    gains = ("--position-gain", "FL_hip_joint=20,FL_thigh_joint=30", "--velocity-gain", "2")
    done("init", "go2", GO2, "--joints", LEG, *gains, "--folder", tmp_path)
    text = (tmp_path / "go2_drives.toml").read_text()
    for gain in ("20.0", "30.0", '"?"'):
        assert f"position_gain_Nm_per_rad = {gain}" in text
    wrong = run("init", "go2", GO2, "--position-gain", "knee=20", "--folder", tmp_path / "x")
    assert "--position-gain: " in wrong.err
    assert wrong.code == 1


def test_gains_replace_the_drives_next_to_the_robot_and_exclude_others(tmp_path: Path) -> None:
    """A file of drives was used in place of the gains that were given, without a word."""
    drives = tmp_path / "servo.toml"
    shutil.copy(MODELS / "xl330_pendulum.toml", drives)
    time = np.arange(0, 8, 0.01)
    q = two_sines(time)
    log = {"t": time, "pendulum_pos": np.interp(time - 0.03, time, q), "pendulum_cmd": q}
    laws = {"pendulum": seaid.Controller(position_gain_Nm_per_rad=2.0)}
    made, text = servo_project_of(tmp_path, log, controllers=laws)
    assert "drives: 'servo.toml' next to the URDF is not used, as gains are given" in made.doubts
    assert "position_gain_Nm_per_rad = 2.0" in text
    shutil.rmtree(tmp_path / "made")
    with pytest.raises(SeaidError, match=r"servo\.toml' has the controllers of its drives: write"):
        servo_project_of(tmp_path, log, drives=drives, controllers=laws)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("pendulum_pos,pendulum_cmd", "pendulum_cmd: a command of what is unk"),
        ("obs_0,action_0", "no column looks like the position of a joint; columns are"),
    ],
)
def test_a_refused_log_says_what_its_columns_were_taken_for(
    tmp_path: Path, names: str, words: str
) -> None:
    """Not what seaid's own names are, if it has none of them."""
    time = np.arange(0, 8, 0.01)
    columns = dict(zip(names.split(","), (two_sines(time), np.cos(9 * time)), strict=True))
    with pytest.raises(LogError, match=words):
        servo_project_of(tmp_path, {"t": time, **columns})


def test_init_takes_commands_in_place_of_torques_that_are_none(tmp_path: Path) -> None:
    """The "torque" of this log is the size of the tracking error."""
    time = np.arange(0, 20, 0.01)
    q, error = two_sines(time), 0.02 * np.cos(5.3 * time) + 0.03 * np.sin(2 * time)
    columns = {"joint_position_rad": q, "position_command_rad": q + error}
    columns["motor_torque_Nm"] = np.abs(20 * error)
    named = {f"pendulum.{name}": values for name, values in columns.items()}
    made, drives = servo_project_of(tmp_path, {"time_s": time, **named})
    assert any("motor torque of pendulum has no sign" in one for one in made.doubts)
    assert 'motor_input = "position_command"' in drives


def test_init_reads_lists_in_cells_and_the_file_of_the_commands(tmp_path: Path) -> None:
    """As of the SO-101: two files with a clock each in us, and torques without sign."""
    time = np.arange(0, 20, 0.02)
    joints = ("shoulder", "elbow")
    position = np.column_stack([0.4 * np.sin(2 * time), 0.3 * np.sin(3.1 * time)])
    error = np.column_stack([0.05 * np.sin(2 * time + 0.5), 0.04 * np.sin(3.1 * time + 0.4)])
    rows = {
        "state": (time, position, np.abs(20 * error)),
        "control": (time + 3e-3, position + error),
    }
    files = [tmp_path / f"run.{name}.csv" for name in rows]
    for file, (name, (clock, *columns)) in zip(files, rows.items(), strict=True):
        lines = [",".join(["type", "timestamp", "positions", "torques"][: 2 + len(columns)])]
        lines += [
            f"{name.upper()},{1e6 * at}," + ",".join(f'"{one[k].tolist()}"' for one in columns)
            for k, at in enumerate(clock)
        ]
        file.write_text("\n".join(lines))
    urdf = two_links(tmp_path / "two.urdf", joints)
    gains = seaid.Controller(position_gain_Nm_per_rad=20.0, is_held=True)
    laws = dict.fromkeys(joints, gains)
    made = seaid.write_first_project(urdf, files, folder=tmp_path / "project", controllers=laws)
    assert any("elbow: the motor torque of elbow has no sign" in one for one in made.doubts)
    robot = seaid.load_robot(urdf, tmp_path / "project" / "two_drives.toml")
    assert robot.drives["elbow"].controller == gains
    log = seaid.read_log(files, robot, description=tmp_path / "project" / "run.state_columns.toml")
    assert log.position_command is not None
    inside = slice(50, -50)
    assert np.allclose(
        log.joint_position[inside, 1], np.interp(log.time[inside], time, position[:, 1]), atol=2e-3
    )
    expected = np.interp(log.time[inside], time + 3e-3, (position + error)[:, 1])
    assert np.allclose(log.position_command[inside, 1], expected, atol=2e-3)


BODY = """<inertial><origin xyz="0.2 0 0"/><mass value="1.5"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>"""
LIMIT = '<limit lower="-3" upper="3" effort="50" velocity="20"/>'


def two_links(path: Path, joints: tuple[str, str]) -> Path:
    """Write the URDF of two arms side by side."""
    ends = (f'revolute base {x}_link <axis xyz="0 1 0"/>{LIMIT}' for x in joints)
    return write_robot(path, dict(zip(joints, ends, strict=True)), BODY)


def servo_project(folder: Path, validate_s: tuple[float, float]) -> Path:
    """Write a project of two servos, one of which stands still, and of one log."""
    joints, time = ("shoulder", "elbow"), np.arange(0, 12, 0.01)
    two_links(folder / "two.urdf", joints)
    q = 0.4 * np.sin(2 * time) + 0.3 * np.sin(5.3 * time)
    v, a = np.gradient(q, time), np.gradient(np.gradient(q, time), time)
    torque = 0.1 * a - 2.943 * np.cos(q) + 0.3 * v + 0.2 * np.tanh(v / 0.05)
    columns = (q, q + torque / 40, 0.3 + 0 * q, 0.25 + 0 * q)
    names = [f"{j}.{x}_rad" for j in joints for x in ("position", "position_command")]
    write_columns(folder / "run.csv", {"time_s": time, **dict(zip(names, columns, strict=True))})
    drive = (
        '[{0}]\ntype = "stiff"\ngear_ratio = 1.0\nfriction = ["viscous", "coulomb"]\n'
        'motor_input = "position_command"\ncommand_delay_s = 0.0\nknown = ["command_delay"]\n'
        "[{0}.controller]\nposition_gain_Nm_per_rad = 40.0\n"
    )
    (folder / "two.toml").write_text("".join(map(drive.format, joints)))
    start, end = validate_s
    (folder / "seaid.toml").write_text(
        'urdf = "two.urdf"\ndrives = "two.toml"\nknown_bodies = "all"\n'
        '[[log]]\nfile = "run.csv"\nbetween_s = [0, 8]\n'
        f'[[log]]\nfile = "run.csv"\nuse = "validate"\nbetween_s = [{start}, {end}]\n'
        "[run]\nwrite = []\n"
    )
    return folder


@pytest.mark.slow  # 0.6 s
def test_a_joint_that_stands_still_loses_neither_the_run_nor_the_replay(tmp_path: Path) -> None:
    run = seaid.run_project(seaid.load_project(servo_project(tmp_path, (8.0, 11.0))))
    found, (moved,) = run.runs[""].identification, run.runs[""].replays.values()
    assert found.known.known_bodies == found.known.body_names
    assert set(found.drives) == {"shoulder"}
    assert moved.joints == ("shoulder",)
    assert moved.mean_absolute_errors[1][0] < 0.1 * moved.mean_absolute_errors[0][0]
    assert "standstill" in [one.code for one in run.warnings]
    assert run.notes == ()


def test_a_part_too_short_to_validate_loses_no_result(tmp_path: Path) -> None:
    project = seaid.load_project(servo_project(tmp_path, (11.5, 12.0)))
    finished = seaid.run_project(replace(project, write=("report",)))
    assert finished.runs[""].validations == {}
    assert set(finished.runs[""].identification.drives) == {"shoulder"}
    message = "run.csv@11.5:12 was not validated: the log is too short"
    assert finished.notes[0].startswith(message)
    saved, again = seaid.project.load_run(finished.folder), tmp_path / "again.html"
    assert saved.provenance["notes"] == finished.notes
    done("report", "--run", finished.folder, "-o", again)
    for page in (finished.folder / "report.html", again):
        text = html.unescape(page.read_text("utf-8"))
        for note in finished.notes:
            assert f"{note[:1].upper()}{note[1:]}" in text
