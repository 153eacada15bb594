"""The command line: every command, what it says where, what it writes and what it leaves alone."""

from __future__ import annotations

import importlib
import json
import os
import re
import resource
import shlex
import subprocess
import sys
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, get_args

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import seaid
from seaid._files import plain
from seaid.cli import main
from seaid.cli.commands import COMMANDS, MOVED, RENAMED, app, command_of
from seaid.cli.messages import error_text
from seaid.errors import IdentificationError, LogError, RobotError
from seaid.estimation import EstimatorName
from seaid.regressor import Sensor

ROOT = Path(__file__).parents[2]
HELP_SECONDS = 0.5

URDF = """<robot name="small_arm">
<!-- kept -->
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.02 0.01 -0.12"/><mass value="2.0"/>
  <inertia ixx="0.025" ixy="0.001" ixz="0.002" iyy="0.022" iyz="0.001" izz="0.008"/></inertial>
</link>
<link name="lower"><inertial><origin xyz="0.03 0.0 -0.1"/><mass value="1.0"/>
  <inertia ixx="0.012" ixy="0" ixz="0.001" iyy="0.013" iyz="0" izz="0.004"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
  <limit lower="-1.2" upper="1.2" velocity="3" effort="60"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
  <origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/>
  <limit lower="-1.2" upper="1.2" velocity="3" effort="40"/></joint>
</robot>
"""
DRIVES = """[shoulder]
type = "stiff"
gear_ratio = 50.0
motor_inertia_kg_m2 = 4e-6
viscous_friction_Nms_per_rad = 5e-5
coulomb_friction_Nm = 0.003

[elbow]
type = "series_elastic"
gear_ratio = 100.0
motor_inertia_kg_m2 = 4e-6
stiffness_Nm_per_rad = 250.0
viscous_friction_Nms_per_rad = 8e-5
coulomb_friction_Nm = 0.006
"""


class Said:
    """What a run of the command line said and how it ended."""

    def __init__(self, arguments: list[str]) -> None:
        result = CliRunner().invoke(app, arguments)
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        self.code, self.out, self.err = result.exit_code, result.stdout, result.stderr


def run(*arguments: str | Path) -> Said:
    return Said([str(one) for one in arguments])


def done(*arguments: str | Path) -> Said:
    said = run(*arguments)
    assert said.code == 0, said.err
    return said


def refused(*arguments: str | Path) -> str:
    """Return the one line of an error that is ours."""
    said = run(*arguments)
    lines = said.err.splitlines()
    assert said.code == 1
    assert lines[-1].startswith("error: ")
    assert not any(line.startswith("error: ") for line in lines[:-1])
    return lines[-1]


@cache
def experiment() -> dict[str, bytes]:
    """Return the files of a small arm, of motions planned for it and of their logs."""
    with TemporaryDirectory() as folder:
        run_experiment(Path(folder))
        return {file.name: file.read_bytes() for file in Path(folder).iterdir()}


def run_experiment(folder: Path) -> None:
    (folder / "arm.urdf").write_text(URDF)
    (folder / "arm.toml").write_text(DRIVES)
    urdf, drives = folder / "arm.urdf", ("--drives", folder / "arm.toml")
    for seed, name in ((1, "run"), (2, "other")):
        search = ("--duration", "2", "--starts", "1", "--iterations", "12", "--seed", str(seed))
        done("excite", urdf, *search, "-o", folder / f"{name}_plan.json")
        plan, log = folder / f"{name}_plan.json", folder / f"{name}.csv"
        noise = ("--torque-std", "0.001", "--seed", str(seed))
        done("simulate", urdf, plan, *drives, *noise, "-o", log)
    lines = (f"{load},{load / 250}" for load in range(-6, 7))
    (folder / "weights.csv").write_text("load_Nm,deflection_rad\n" + "\n".join(lines))
    values = np.zeros((10, 2))
    values[4:6] = 0.05
    basis = seaid.excitation.make_basis("bspline", 0.5, 10)
    seaid.Trajectory(("shoulder", "elbow"), basis, values).save(folder / "short_plan.json")


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of the module with the files of the experiment."""
    folder = tmp_path_factory.mktemp("arm")
    for name, content in experiment().items():
        (folder / name).write_bytes(content)
    return folder


def robot_and_drives(arm: Path) -> tuple[str | Path, ...]:
    return (arm / "arm.urdf", "--drives", arm / "arm.toml")


def test_walk_from_a_plan_to_the_identified_robot(arm: Path, tmp_path: Path) -> None:
    robot, log = robot_and_drives(arm), arm / "run.csv"
    points = np.genfromtxt(arm / "run_plan.csv", delimiter=",", names=True, deletechars="")
    assert points["time_s"][-1] == 2.0

    identified = done("identify", *robot, log, "-o", tmp_path / "parameters.json")
    assert identified.out.splitlines()[-1] == f"Results: {tmp_path / 'parameters.json'}"
    assert "small_arm: 6 base parameters" in identified.out
    content = json.loads((tmp_path / "parameters.json").read_text())
    stiffness = content["drives"]["elbow"]["stiffness"]
    assert abs(stiffness["value"] - 250.0) < 4 * stiffness["standard_error"]
    assert stiffness["standard_error"] < 10.0

    validated = done("validate", *robot, "--from", log, arm / "other.csv", "--json")
    errors = json.loads(validated.out)["result"]
    assert errors["load"]["elbow"]["relative_error"] < 0.05
    assert errors["actuator"]["shoulder"]["relative_error"] is None

    exported = done("export", *robot, "--from", log, "-o", tmp_path / "found.urdf")
    places = f"Results: {tmp_path / 'found.urdf'}, {tmp_path / 'found.toml'}"
    assert exported.out.splitlines()[-1] == places
    found = seaid.load_robot(tmp_path / "found.urdf", tmp_path / "found.toml")
    truth = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")
    drive = found.drives["elbow"]
    assert isinstance(drive, seaid.SeriesElasticDrive)
    assert drive.stiffness_Nm_per_rad == pytest.approx(stiffness["value"], rel=0.01)
    base = seaid.base_parameters(truth)
    np.testing.assert_allclose(
        base.project(found.parameters), base.project(truth.parameters), rtol=0.1
    )
    assert "<!-- kept -->" in (tmp_path / "found.urdf").read_text()


def test_export_of_saved_parameters_writes_the_same_files(arm: Path, tmp_path: Path) -> None:
    robot, log, saved = robot_and_drives(arm), arm / "run.csv", tmp_path / "parameters.json"
    done("identify", *robot, log, "--feasible", "-o", saved)
    done("export", *robot, "--from", log, "-o", tmp_path / "one.urdf")
    said = done("export", arm / "arm.urdf", "--parameters", saved, "-o", tmp_path / "two.urdf")
    assert said.out.splitlines()[0] == "small_arm: 2 bodies and their drives written"
    for ending in (".urdf", ".toml"):
        one, two = ((tmp_path / name).with_suffix(ending) for name in ("one", "two"))
        assert one.read_bytes() == two.read_bytes()
    assert "is of another robot" in refused(
        *("export", arm / "arm.urdf", "--joints", "elbow", "--parameters", saved),
        *("-o", tmp_path / "three.urdf"),
    )


def test_export_of_a_mujoco_model(arm: Path, tmp_path: Path) -> None:
    model = tmp_path / "found.xml"
    said = done("export", *robot_and_drives(arm), "--from", arm / "run.csv", "-o", model, "--json")
    assert json.loads(said.out)["files"] == [str(model)]
    assert "note: " in said.err
    assert said.err.splitlines()[-1] == f"Results: {model}"
    assert 'name="elbow_spring"' in model.read_text()
    assert [one.name for one in tmp_path.iterdir()] == ["found.xml"]


def test_inspect_shows_tree_drives_base_parameters_and_sensors(arm: Path) -> None:
    said = done("inspect", *robot_and_drives(arm))
    assert "  upper  <- shoulder: -1.2 to 1.2 rad, stiff; gear_ratio 50.0" in said.out
    assert "    lower  <- elbow: -1.2 to 1.2 rad, series_elastic; gear_ratio 100.0" in said.out
    assert "6 base parameters" in said.out
    assert "  Iyy_upper + 0.09 m_lower" in said.out
    assert "joint_position, joint_torque" in said.out
    assert "  with their derivatives" in said.out


def test_inspect_of_given_sensors_is_in_detail(arm: Path) -> None:
    sensors: tuple[Sensor, ...] = ("motor_position", "joint_position", "motor_torque")
    said = done("inspect", *robot_and_drives(arm), "--sensors", ",".join(sensors))
    robot = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")
    assert str(seaid.identifiability(robot, sensors)) in said.out


def test_inspect_as_json_is_what_the_library_says(arm: Path) -> None:
    content = json.loads(done("inspect", *robot_and_drives(arm), "--json").out)["result"]
    robot = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")
    assert content["base_parameters"] == list(seaid.base_parameters(robot).expressions)
    assert [one["joint"] for one in content["joints"]] == ["shoulder", "elbow"]
    assert content["joints"][1]["drive"]["stiffness_Nm_per_rad"] == 250.0
    found = content["sensors"]["motor_position, joint_position, motor_torque"]
    assert found["base_parameters"] == 6
    assert found["by_derivatives"] is None
    only_motors: tuple[Sensor, ...] = ("motor_position", "motor_torque")
    derivatives = seaid.identifiability(robot, only_motors).derivatives
    assert derivatives is not None
    found = content["sensors"][", ".join(only_motors)]
    assert found["by_derivatives"] == list(derivatives.expressions)


@pytest.mark.slow  # 0.6 s
def test_inspect_measures_planned_motions(arm: Path, tmp_path: Path) -> None:
    robot = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")
    basis = seaid.excitation.make_basis("bspline", 4.0, 10)
    files = tmp_path / "one.json", tmp_path / "other.json"
    for seed, file in enumerate(files):
        values = np.random.default_rng(seed).uniform(-0.5, 0.5, (10, robot.n))
        seaid.Trajectory(robot.joint_names, basis, values).save(file)
    options = ("--plan", files[0], "--plan", files[1])
    content = json.loads(done("inspect", *robot_and_drives(arm), *options, "--json").out)
    plans = content["result"]["plans"]
    own = [
        seaid.excitation.excitation_measures(robot, seaid.load_trajectory(file)) for file in files
    ]
    for file, one in zip(files, own, strict=True):
        assert plans[str(file)]["d_value"] == pytest.approx(one.d_value)
        assert plans[str(file)]["d_efficiency"] == pytest.approx(own[0].d_efficiency(one))
    said = done("inspect", *robot_and_drives(arm), *options).out
    assert f"D-efficiency of {files[0]} over {files[1]}: " in said


def test_inspect_lists_inconsistent_links(arm: Path, tmp_path: Path) -> None:
    assert "inconsistent" not in done("inspect", arm / "arm.urdf").out
    text = (arm / "arm.urdf").read_text()
    tensor = re.search(r'<inertia ixx="[^"]*"', text)
    assert tensor is not None
    path = tmp_path / "inconsistent.urdf"
    path.write_text(text.replace(tensor.group(), '<inertia ixx="9.0"', 1))
    said = done("inspect", path)
    assert "Physically inconsistent links" in said.out
    assert "  upper has a principal moment of inertia above the sum of the other two" in said.out
    content = json.loads(done("inspect", path, "--json").out)["result"]
    assert list(content["inconsistent_links"]) == ["upper"]


def test_joints_that_are_not_asked_for_are_said_not_to_move(arm: Path) -> None:
    said = done("inspect", arm / "arm.urdf", "--joints", "elbow")
    assert "upper  <- shoulder: does not move" in said.out
    assert "lower  <- elbow: -1.2 to 1.2 rad, torque known at the joint" in said.out


def test_crosscheck_agrees(arm: Path) -> None:
    assert "they agree" in done("inspect", arm / "arm.urdf", "--exact").out
    content = json.loads(done("inspect", arm / "arm.urdf", "--exact", "--json").out)["result"]
    assert content["exact"]["agree"] is True
    assert "they agree" not in done("inspect", arm / "arm.urdf").out


def test_crosscheck_that_fails_says_so_in_its_exit_code(
    arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    apart = seaid.regressor.CrossCheck(False, False, float("inf"), 1.0, (6, 7))
    monkeypatch.setattr("seaid.regressor.cross_check", lambda *_: apart)
    said = run("inspect", arm / "arm.urdf", "--exact", "--json")
    assert said.code == 1
    assert json.loads(said.out)["result"]["exact"]["max_difference"] is None
    assert "error: numeric and exact base parameters of 'small_arm' differ" in said.err


def test_description_on_stdout_is_toml_and_reads_the_log(arm: Path, tmp_path: Path) -> None:
    said = done("describe", arm / "run.csv", "--urdf", arm / "arm.urdf")
    described = tomllib.loads(said.out)
    assert set(described["joints"]) == {"shoulder", "elbow"}
    file = tmp_path / "run.toml"
    written = done("describe", arm / "run.csv", "--urdf", arm / "arm.urdf", "-o", file)
    assert written.out.splitlines()[-1] == f"Results: {file}"
    assert tomllib.loads(file.read_text()) == described
    robot = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")
    one = seaid.read_log(arm / "run.csv", robot, description=file)
    assert one.joint_names == robot.joint_names


def test_terms_writes_drives_that_load(arm: Path, tmp_path: Path) -> None:
    arguments = (*robot_and_drives(arm), arm / "run.csv", "--of", "elbow", "--json")
    said = done("check", *arguments, "--terms", "-o", tmp_path / "drives.toml")
    content = json.loads(said.out)["result"]
    assert {one["joint"] for one in content["comparisons"]} == {"elbow"}
    assert f"Results: {tmp_path / 'drives.toml'}" in said.err
    loaded = seaid.load_robot(arm / "arm.urdf", tmp_path / "drives.toml")
    assert loaded.elastic_joints == ("elbow",)


def test_json_of_identify_is_what_it_writes(arm: Path, tmp_path: Path) -> None:
    file = tmp_path / "parameters.json"
    payload = ("--payload", "lower:0.5:0,0,-0.2", "--torque-joints", "shoulder,elbow")
    said = done("identify", *robot_and_drives(arm), arm / "run.csv", *payload, "-o", file, "--json")
    assert json.loads(said.out)["result"] == json.loads(file.read_text())
    assert said.err.splitlines()[-1] == f"Results: {file}"


@pytest.mark.slow  # 0.8 s
def test_check_names_a_mistake_and_fails_on_request(arm: Path, tmp_path: Path) -> None:
    right = done("check", *robot_and_drives(arm), arm / "run.csv")
    assert "nothing contradicts the set-up" in right.out
    assert (
        right.code == run("check", *robot_and_drives(arm), arm / "run.csv", "--fail-on=note").code
    )
    wrong = tmp_path / "wrong.csv"
    log = seaid.read_log(arm / "run.csv", seaid.load_robot(arm / "arm.urdf", arm / "arm.toml"))
    seaid.write_log(replace(log, motor_torque=1e3 * log.motor_torque), wrong)
    said = run("check", *robot_and_drives(arm), wrong, "--fail-on", "doubtful")
    assert said.code == 3
    assert "! unit: the torques of all joints are in mNm" in said.out
    assert '    motor_torque = { column = "elbow.motor_torque_Nm", scale = 0.001 }' in said.out
    content = json.loads(run("check", *robot_and_drives(arm), wrong, "--json").out)
    assert [(one["code"], one["severity"]) for one in content["warnings"]] == [("unit", "wrong")]
    assert set(content["result"]["joints"]) == {"shoulder", "elbow"}
    output = ("-o", tmp_path / "found.json", "--fail-on", "wrong")
    said = run("identify", *robot_and_drives(arm), wrong, *output)
    assert (said.code, said.out.splitlines()[0]) == (
        3,
        "small_arm: do not use this result: unit",
    )
    assert "--fail-on: no severity is named 'bad'" in refused(
        "check", *robot_and_drives(arm), wrong, "--fail-on", "bad"
    )
    said = run("check", *robot_and_drives(arm), arm / "run.csv", "--gravity", "9.81,0,0")
    assert "! gravity: gravity has the direction (0,0,-9.81)" in said.out
    assert run("check", *robot_and_drives(arm), wrong, "--gravity", "down").code == 2


def test_options_of_identify_reach_it(arm: Path, tmp_path: Path) -> None:
    options = ("--method", "simultaneous", "--estimator", "huber", "--feasible", "--cutoff-hz", "6")
    robot, file = (*robot_and_drives(arm), "--encoder-offset-std", "0"), tmp_path / "p.json"
    said = done("identify", *robot, arm / "run.csv", *options, "-o", file, "-v")
    assert "cutoff 6 Hz" in said.out
    assert "both sides" in said.out
    assert "physically consistent parameters" in said.out


def test_identify_prints_what_decides_first_and_the_rest_with_verbose(
    arm: Path, tmp_path: Path
) -> None:
    identify = (
        "identify",
        *robot_and_drives(arm),
        arm / "run.csv",
        "--force",
        "-o",
        tmp_path / "p",
    )
    short, whole = (done(*identify, *option).out for option in ((), ("--verbose",)))
    found = seaid.load_robot(arm / "arm.urdf", arm / "arm.toml")
    robot = seaid.identify(found, seaid.read_log(arm / "run.csv", found))
    verdict, drives, fit = (
        short.index(text) for text in ("small_arm: ", "\nDrives\n", "\nUnexplained torque")
    )
    assert 0 == verdict < drives < fit
    (stiffness,) = (line.split() for line in short.splitlines() if "  stiffness" in line)
    change = robot.drives["elbow"].value("stiffness") / 250.0 - 1
    assert stiffness[2] == "250"
    assert float(stiffness[5]) == pytest.approx(100 * change, rel=0.05)
    assert "Base parameters\n" not in short
    assert "autocorrelation" not in short
    assert whole.startswith(short.partition("small_arm: 6 base")[0])
    assert "Base parameters\n" in whole
    assert "autocorrelation" in whole


def test_logs_read_in_pieces_give_the_same(arm: Path, tmp_path: Path) -> None:
    found = []
    for more in ((), ("--in-pieces",)):
        file = tmp_path / f"p{len(more)}.json"
        options = ("--method", "two-step", *more, "-o", file)
        done("identify", *robot_and_drives(arm), arm / "run.csv", *options)
        found.append(json.loads(file.read_text())["drives"]["elbow"]["stiffness"]["value"])
    assert found[1] == pytest.approx(found[0], rel=1e-6)


def line_of(options: dict[str, Any]) -> list[str]:
    """Return the options of a saved run as words of the command line."""
    words = [options["urdf"], *options["logs"]]
    for name, value in options.items():
        if name not in ("urdf", "logs"):
            values = value if isinstance(value, list | tuple) else [value]
            option = f"--{name.replace('_', '-')}"
            words += [option] if value is True else [x for y in values for x in (option, str(y))]
    return words


def test_the_options_of_a_saved_run_give_the_same_result_again(arm: Path, tmp_path: Path) -> None:
    more = shlex.split(
        "--payload lower:0.01:0,0,-0.1 --gravity 0,0,-9.8 --known-body upper --known-body lower "
        "--estimator huber --cutoff-hz 8 --encoder-offset-std 0.001 --feasible "
        "--known-std torque=0.03,bodies=0.1 --torque-joints shoulder,elbow"
    )
    first, again = tmp_path / "first.npz", tmp_path / "again.npz"
    done("identify", *robot_and_drives(arm), arm / "run.csv", *more, "-o", first)
    options = dict(seaid.load_run(first).provenance["options"])
    assert {"method", "known_body", "payload", "feasible"} <= {*options}
    done("identify", *line_of(options), "-o", again)
    results = [seaid.load_run(path).identification for path in (first, again)]
    assert np.array_equal(results[0].load.values, results[1].load.values)
    assert seaid.load_run(again).provenance["options"] == options


def test_logs_in_pieces_are_not_changed(arm: Path) -> None:
    said = run(
        "identify", *robot_and_drives(arm), arm / "run.csv", "--in-pieces", "--find-contacts"
    )
    assert said.code == 2
    assert "no --find-contacts" in said.err


def test_a_plan_that_ends_in_motion_gets_a_run_in_and_a_ros_file(arm: Path, tmp_path: Path) -> None:
    file, message = tmp_path / "plan.json", tmp_path / "plan.yaml"
    search = ("--duration", "2", "--starts", "1", "--iterations", "5", "--ends-in-motion")
    said = done("excite", arm / "arm.urdf", *search, "--joint-trajectory", message, "-o", file)
    assert said.out.splitlines()[-1] == f"Results: {file}, {file.with_suffix('.csv')}, {message}"
    assert "a motion of 2 s (" in said.out
    motion = seaid.load_trajectory(file)
    begin, end = motion.main_interval
    assert 0 < begin < end < motion.duration
    assert yaml.safe_load(message.read_text())["joint_names"] == ["shoulder", "elbow"]


def test_a_file_that_is_there_is_overwritten_with_force_only(arm: Path, tmp_path: Path) -> None:
    file = tmp_path / "x.toml"
    file.write_text("mine")
    describe = ("describe", arm / "run.csv", "-o", file)
    assert refused(*describe) == f"error: '{file}' is there already: name another file, or add " + (
        "--force"
    )
    assert file.read_text() == "mine"
    done(*describe, "--force")
    assert "time" in tomllib.loads(file.read_text())


@pytest.mark.parametrize("command", ["excite", "export"])
def test_the_file_beside_is_not_overwritten_either(arm: Path, tmp_path: Path, command: str) -> None:
    beside = tmp_path / {"excite": "out.csv", "export": "out.toml"}[command]
    beside.write_text("mine")
    output = tmp_path / {"excite": "out.json", "export": "out.urdf"}[command]
    logs = ("--from", arm / "run.csv") if command == "export" else ()
    assert f"'{beside}' is there already" in refused(
        command, *robot_and_drives(arm), *logs, "-o", output
    )
    assert beside.read_text() == "mine"
    assert not output.exists()


def test_what_is_read_is_never_overwritten(arm: Path) -> None:
    log = arm / "run.csv"
    before = log.read_bytes()
    message = refused("identify", *robot_and_drives(arm), log, "-o", log, "--force")
    assert f"'{log}' is read by this command" in message
    assert log.read_bytes() == before
    assert "is read by this command" in refused(
        "export", *robot_and_drives(arm), "--from", log, "-o", arm / "arm.urdf", "--force"
    )


def test_a_folder_that_cannot_be_written_is_refused_first(arm: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    output = tmp_path / "file" / "parameters.json"
    message = refused("identify", *robot_and_drives(arm), "no_log.csv", "-o", output)
    assert f"cannot write '{output}': Not a directory" in message
    assert "name a folder you may write to" in message
    assert "is a folder" in refused("describe", arm / "run.csv", "-o", tmp_path)


def test_a_full_disk_leaves_the_old_file(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "parameters.json"
    file.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    arguments = ("identify", *robot_and_drives(arm), arm / "run.csv", "-o", file, "--force")
    monkeypatch.setattr(os, "replace", full)
    assert "No space left on device" in refused(*arguments)
    assert file.read_text() == "old"
    assert [one.name for one in tmp_path.iterdir()] == ["parameters.json"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("inspect no.urdf", "no URDF file at 'no.urdf'"),
        ("inspect arm.urdf --drives no.toml", "cannot read drives 'no.toml'"),
        ("inspect arm.urdf --joints shouldr", "did you mean 'shoulder'?"),
        ("inspect arm.urdf --sensors eye", "no sensor is named 'eye'"),
        ("inspect arm.urdf --payload hand:1", "no link is named 'hand'"),
        ("identify arm.urdf no.csv", "no log file at 'no.csv'"),
        ("identify arm.urdf .", "'.'"),
        ("identify arm.urdf run.csv --torque-joints elbo", "did you mean 'elbow'?"),
        ("identify arm.urdf run.csv --method both", "--method: no method is named 'both'"),
        ("identify arm.urdf run.csv --estimator best", "no estimator is named 'best'"),
        ("check arm.urdf run.csv --terms --of elbo", "did you mean 'elbow'?"),
        ("excite arm.urdf --velocity elbo=1", "did you mean 'elbow'?"),
        ("identify no.urdf no.csv --method twostep", "--method: no method is named 'twostep'; did"),
        ("validate no.urdf no.csv --from no.csv --estimator hube", "did you mean 'huber'?"),
        ("excite no.urdf --basis furier", "--basis: no basis is named 'furier'; did you mean"),
        ("excite no.urdf --criterion condition", "did you mean 'condition_number'?"),
        ("simulate arm.urdf no.json", "cannot read trajectory 'no.json'"),
        ("simulate arm.urdf run_plan.json --rate-hz 0", "--rate-hz must be more than zero"),
        ("validate arm.urdf run.csv --from run.csv", "is used for the identification: validate on"),
        ("describe run_plan.json", "no column looks like the position of a joint"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: str, words: str
) -> None:
    monkeypatch.chdir(arm)
    command, *others = arguments.split()
    if command in ("identify", "excite", "simulate"):
        file = {"excite": "o.json", "simulate": "o.csv"}.get(command, "o")
        others += ["-o", str(tmp_path / file)]
    assert words in refused(command, *others)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("inspect", "URDF: it is missing: name it, or have a seaid.toml here"),
        ("identify arm.urdf run.csv --in-pieces --repair", "no --repair, no --description"),
        ("nothing", "No such command 'nothing'"),
        ("inspect arm.urdf --payload lower", "is not link:mass:x,y,z"),
        ("inspect arm.urdf --payload lower:1:0,0", "is not link:mass:x,y,z"),
        ("inspect arm.urdf --payload lower:1:0,0,0:5", "is not link:mass:x,y,z"),
        ("excite arm.urdf --velocity fast", "is neither a number nor a list as knee=2,hip=1"),
        ("excite arm.urdf --rate-hz 0", "is not more than zero"),
        ("excite arm.urdf -o plan.csv", "must end in .json"),
        ("simulate arm.urdf run_plan.json -o run.mat", "must end in .csv or .npz"),
        (
            "export arm.urdf --from run.csv -o found.toml",
            "must end in .urdf or .xml or .usda or .py or .c",
        ),
        ("validate arm.urdf run.csv", "--from, --run: give one of the two"),
        ("report arm.urdf --from run.csv -o report.pdf", "must end in .html or .htm"),
        ("report arm.urdf", "--from, --run: give one of the two"),
        ("export arm.urdf -o found.urdf", "--from, --run: give one of the two"),
        ("export arm.urdf --from run.csv --parameters p -o found.urdf", "give one of them"),
        ("check arm.urdf run.csv --delays --terms", "--delays, --terms: give one of them"),
        ("check arm.urdf run.csv other.csv --delays", "--delays: give one log"),
        ("check arm.urdf run.csv --of elbow", "--of: it needs --terms"),
        ("check arm.urdf run.csv -o found.toml", "--output: it needs --delays or --terms"),
        ("check arm.urdf run.csv --delays -o found.toml", "must end in .csv or .npz"),
        ("identify arm.urdf run.csv --iterations 3", "--iterations: it needs --refine"),
        ("identify arm.urdf run.csv --refine --feasible", "--feasible: it is no option of"),
        ("identify arm.urdf run.csv --specific bodies", "--specific: it needs --condition"),
        (
            "identify arm.urdf --condition a=run.csv --condition b=other.csv --method simultaneous",
            "--method: it does not go with --condition",
        ),
        ("validate arm.urdf run.csv --from other.csv --parts 3", "--parts: it needs --cross"),
        ("validate arm.urdf run.csv other.csv --from run.csv", "LOG: give one log, or add --cross"),
        ("validate arm.urdf run.csv --cross --from other.csv", "--from: --cross identifies from"),
    ],
)
def test_wrong_usage_has_its_own_exit_code(
    arm: Path, monkeypatch: pytest.MonkeyPatch, arguments: str, words: str
) -> None:
    monkeypatch.chdir(arm)
    said = run(*arguments.split())
    assert said.code == 2
    assert words in " ".join(said.err.split())


def test_warnings_are_notes_on_stderr_once(arm: Path, tmp_path: Path) -> None:
    rounded = (
        (arm / "arm.urdf")
        .read_text()
        .replace('<origin xyz="0 0 -0.3"/>', '<origin xyz="0 0 -0.3" rpy="1.5708 0 0"/>')
    )
    (tmp_path / "rounded.urdf").write_text(rounded)
    said = done("inspect", tmp_path / "rounded.urdf", "--json")
    json.loads(said.out)
    (note,) = said.err.splitlines()
    assert note.startswith("note: ")
    assert "1.5708" in note


def test_the_commands_are_few() -> None:
    assert len(COMMANDS) <= 16


@pytest.mark.parametrize("command", [*MOVED])
def test_a_former_command_names_what_to_write_now(command: str) -> None:
    said = run(command, "arm.urdf", "--anything")
    assert (said.code, said.out) == (2, "")
    (line,) = said.err.splitlines()
    assert line == f"error: 'seaid {command}' is no longer there: {MOVED[command]}"
    for name, *options in re.findall(r"seaid (\w+)[^-]*((?:--?\w+[^-]*)*)", MOVED[command]):
        words = {word for one in command_of(name).params for word in one.opts}
        assert {*re.findall(r"--?[a-z][\w-]*", " ".join(options))} <= words
    content = json.loads(run(command, "--json").out)
    assert content["error"] == {"message": line.removeprefix("error: "), "exit_code": 2}


@pytest.mark.parametrize("option", [*RENAMED])
def test_a_former_option_names_what_to_write_now(option: str) -> None:
    for words in ((option, "x"), (f"{option}=x",)):
        said = run("identify", "arm.urdf", *words)
        line = f"error: '{option}' is no longer there: write {RENAMED[option]}\n"
        assert (said.code, said.out, said.err) == (2, "", line)
    options = {word for name in COMMANDS for one in command_of(name).params for word in one.opts}
    assert RENAMED[option].split()[0] in options


@pytest.mark.parametrize("command", [*COMMANDS])
def test_the_list_of_commands_has_the_first_line_of_each_help(command: str) -> None:
    help_text = done(command, "-h").out
    assert help_text == done(command, "--help").out
    assert f"seaid {command} [OPTIONS]" in help_text
    assert " ".join(help_text.split("\n\n")[1].split()) == COMMANDS[command]


def test_help_lists_every_command_once_in_a_section() -> None:
    said = done("--help").out
    listed = re.findall(r"^  ([a-z-]+)  +\S", said.partition("\nProject:\n")[2], re.MULTILINE)
    assert listed == [*COMMANDS]
    assert "\nIdentification:\n  identify " in said


@pytest.mark.parametrize("command", [*COMMANDS])
def test_every_option_has_a_help(command: str) -> None:
    helps = [one.help or "" for one in command_of(command).params]
    assert [text for text in helps if not re.fullmatch(r"[A-Za-z].{6,}[^.,;]\.", text)] == []


@pytest.mark.parametrize("command", [*COMMANDS])
def test_help_teaches_with_examples_as_they_are_typed(command: str) -> None:
    said = done(command, "--help")
    examples = [line.strip() for line in said.out.splitlines() if line.startswith("  seaid ")]
    assert examples
    assert all(example.startswith(f"seaid {command} ") for example in examples)


def examples() -> list[str]:
    """Return all commands in helps and in the README, without their comments."""
    helps = [done(command, "--help").out for command in COMMANDS]
    texts = [done("--help").out, *helps, (ROOT / "README.md").read_text(encoding="utf-8")]
    whole = [re.sub(r"\s*\\\n\s*", " ", text) for text in texts]
    lines = [line.strip() for text in whole for line in text.splitlines()]
    return [line.partition("  ")[0] for line in lines if re.match(r"seaid [a-z]+ [\w/]+\.", line)]


@pytest.mark.slow  # 0.6 s
def test_every_example_is_right_usage() -> None:
    found = examples()
    assert len(found) > 20
    for example in found:
        _, name, *arguments = shlex.split(example, comments=True)
        command_of(name).make_context(name, arguments)  # raises for wrong usage


def test_help_and_reference_name_all_estimators() -> None:
    said = re.findall(r"\w+", done("identify", "--help").out)
    for name in get_args(EstimatorName):
        assert name in said
        assert f'"{name}"' in str(seaid.identify.__doc__)


def test_help_and_version_come_at_once() -> None:
    def processor_seconds() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    before = processor_seconds()
    subprocess.run([sys.executable, "-m", "seaid", "--help"], check=True, capture_output=True)
    assert processor_seconds() - before < HELP_SECONDS
    assert done("--version").out == f"seaid {seaid.__version__}\n"
    assert all(command in done("--help").out for command in COMMANDS)


def test_console_script_is_the_command_line() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, name = project["scripts"]["seaid"].partition(":")
    assert getattr(importlib.import_module(module), name) is main


def test_nothing_heavy_is_imported_for_the_help() -> None:
    code = "import sys; sys.argv = ['seaid', '--help']\nfrom seaid.cli import main\ntry: main()\n"
    code += "except SystemExit: print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = said.stdout.splitlines()[-1].split()
    assert "seaid.cli.commands" in loaded
    assert not {"numpy", "pydantic", "rich", "seaid.cli.options", "seaid.cli.signature"} & {*loaded}


def test_arguments_of_the_library_are_named_as_options() -> None:
    first = RobotError(
        "torque_joints= names no joint:\n give feasible=True, or write it with force=True",
        *("torque_joints=", "feasible=True", "write it with force=True"),
    )
    with pytest.raises(LogError) as caught:
        try:
            raise first
        except RobotError as problem:  # as readers do, to say which file it is
            raise LogError(f"'joints=.csv': {problem}") from None
    assert error_text(caught.value) == (
        "'joints=.csv': --torque-joints names no joint: give --feasible, or add "
        "--allow-inconsistent"
    )
    method = IdentificationError(
        'estimator="iv" needs method="two-step"', 'estimator="iv"', 'method="two-step"'
    )
    assert error_text(method) == '--estimator "iv" needs --method "two-step"'
    assert error_text(LogError("use joints=[...]", "joints=[...]")) == "use --joints"


def test_json_has_no_numbers_that_json_has_not() -> None:
    data = {"a": np.array([1.0, np.nan]), "b": (np.inf, Path("x")), 3: np.float64(2)}
    assert plain(data) == {"a": [1.0, None], "b": [None, "x"], "3": 2.0}


@pytest.mark.parametrize(
    ("friction", "words"),
    [
        ("viscous_temperature", "'elbow.motor_temperature_degC' ranges from 31 to 31 degC: "),
        ("dahl", "its friction has hysteresis ('dahl'), and the angle of the motor never turns"),
        ("viscous_warm_up", "longer than the log of 2 s, which shows no warm motor"),
    ],
)
def test_friction_that_a_log_cannot_show_is_refused(
    arm: Path, tmp_path: Path, friction: str, words: str
) -> None:
    """No change of temperature, no reversal, and no time to warm up."""
    terms = ["viscous", *([] if friction == "dahl" else ["coulomb"]), friction]
    drives = tmp_path / "arm.toml"
    drives.write_text(DRIVES + f"friction = {json.dumps(terms)}\n")
    log = seaid.read_log(arm / "run.csv", seaid.load_robot(arm / "arm.urdf", drives))
    joint, motor, torque = (
        getattr(log, name).copy() for name in ("joint_position", "motor_position", "motor_torque")
    )
    if friction == "dahl":
        joint[:, 1] = 0.3 * log.time + 0.02 * np.sin(3 * log.time)
        motor[:, 1] = 100.0 * (joint[:, 1] + 0.005)
    if friction == "viscous_warm_up":
        speed = np.gradient(motor[:, 1], log.time)
        torque[:, 1] += 1e-4 * np.exp(-log.time / 10.0) * speed
    changed = replace(
        log,
        joint_position=joint,
        motor_position=motor,
        motor_torque=torque,
        motor_temperature=np.full_like(joint, 31.0),
    )
    seaid.write_log(changed, tmp_path / "log.csv")
    robot = (arm / "arm.urdf", "--drives", drives)
    assert words in refused("identify", *robot, tmp_path / "log.csv", "-o", tmp_path / "a.json")


def test_export_for_a_simulator_with_ranges(arm: Path, tmp_path: Path) -> None:
    robot, actuators = robot_and_drives(arm), tmp_path / "actuators.py"
    ranges = tmp_path / "ranges.yaml"
    said = done(
        *("export", *robot, "--from", arm / "run.csv", "--format", "isaaclab", "-o", actuators),
        *("--randomization", ranges, "--samples", "3"),
    )
    assert "not determined by the log, and as wide as the prior: " in said.out
    assert "ACTUATORS = {" in actuators.read_text()
    assert ranges.read_text().startswith('format: "seaid randomization 1"')
