"""A first project: what is inferred is right, or a doubt."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from scripts.example_robots import example_urdf
from seaid._arrays import Array
from seaid.checks.tolerances import BODY as WIDTH_OF_BODIES
from seaid.errors import IdentificationError, SeaidError
from seaid.project import FirstProject, Project, load_project, run_project, write_first_project
from seaid.project.first_project import _drives_text, inferred_drives
from seaid.regressor import joint_torques
from tests import experiments
from tests.legged.test_base import base_of, swayed
from tests.measured import LOGS
from tests.one_joint import chain, one_joint
from tests.plants import log_with, write_columns

MODELS = experiments.MODELS


def test_a_slide_that_moves_by_millimetres_is_not_locked(tmp_path: Path) -> None:
    """A screw with a lead of 4 mm turns 1571 rad/m: 44 mm are little next to 69 rad only."""
    time = np.arange(4000) / 200
    q = 0.015 * np.sin(time) + 0.007 * np.sin(3.1 * time)
    torque = 0.001 * np.sign(np.cos(time)) + 0.002 * np.sin(2.3 * time)
    columns = {"motor_position": 1571 * (q + 0.02 * torque), "joint_position": q}
    log = log_with(
        one_joint(tmp_path, "prismatic").joint_names, time, motor_torque=torque, **columns
    )
    tables, doubts = inferred_drives(one_joint(tmp_path, "prismatic"), [log])
    assert not any("locked" in doubt for doubt in doubts)
    (table,) = tables.values()
    ratio = table.get("gear_ratio_rad_per_m") or 1 / table["motor_pulley_radius_m"]
    assert ratio == pytest.approx(1571, rel=0.02)


@pytest.mark.slow  # 2.3 s
@pytest.mark.parametrize("is_sensed", [False, True])
def test_springs_are_recognised_by_currents(is_sensed: bool) -> None:
    """Without a torque the current is that of the spring, and a torque sensor gives the scale."""
    log, motion = experiments.leg_log(), experiments.leg_motion(experiments.TEST_MASS)
    given = replace(
        log,
        motor_torque=np.full_like(log.motor_torque, np.nan),
        motor_current=log.motor_torque / 0.03,
        joint_torque=motion.joint_torque if is_sensed else None,
    )
    tables, doubts = inferred_drives(seaid.load_robot(MODELS / "tulip_leg.urdf"), [given])
    elastic = dict.fromkeys(experiments.ELASTIC, "series_elastic")
    kinds = elastic | dict.fromkeys(("hip_yaw", "hip_roll"), "stiff")
    assert {joint: table["type"] for joint, table in tables.items()} == kinds
    assert {table["motor_input"] for table in tables.values()} == {"current"}
    (unscaled,) = [one for one in doubts if "known bodies" in one]
    assert ("knee_pitch" in unscaled) == (not is_sensed)


@pytest.mark.slow  # an identification of a measured log
def test_a_log_with_custom_columns_gets_a_description(tmp_path: Path) -> None:
    shutil.copy(MODELS / "hebi_arm_2.urdf", tmp_path / "arm.urdf")
    shutil.copy(LOGS / "hebi_arms/grav_comp_bad.npz", tmp_path / "run.npz")
    made = write_first_project(tmp_path / "arm.urdf", [tmp_path / "run.npz"], folder=tmp_path)
    names = [one.name for one in made.files]
    assert names == ["seaid.toml", "run_columns.toml", "arm_drives.toml"]
    found = run_project(load_project(tmp_path)).runs[""].identification
    # the firmware has 762.222 and 70 N m/rad
    ratio = float(re.findall(r"gear_ratio = ([\d.]+)", made.files[2].read_text())[-2])
    assert ratio == pytest.approx(762.222, rel=2e-3)
    spring = found.drives["joint_0"]
    error = spring.value("stiffness") - 70.0
    assert abs(error) < 3 * spring.standard_error("stiffness")


@pytest.mark.slow  # a whole robot is identified
@pytest.mark.filterwarnings("ignore:.*rounded angles")
def test_torques_without_motor_encoders_get_stiff_drives_at_the_joints(tmp_path: Path) -> None:
    """An arm with the topics of ROS: without friction and rotors, nothing of it was explained."""
    log = experiments.geared_arm_log()
    columns = {"__time": log.time}
    for index, joint in enumerate(log.joint_names):
        columns[f"/joint_states/{joint}/position"] = log.joint_position[:, index]
        columns[f"/joint_states/{joint}/effort"] = log.motor_torque[:, index]
        columns[f"/arm_controller/state/desired/positions[{index}]"] = 0.0 * log.time
    made, project = first_project(tmp_path, "ur10", columns)
    (doubt,) = [one for one in made.doubts if "no motor encoder in the logs" in one]
    assert doubt.startswith(", ".join(log.joint_names))
    robot = project.robot()
    assert [drive.gear_ratio for drive in robot.drives.values()] == [1.0] * 6
    found = seaid.identify(robot, project.logs[0].read(robot))
    assert found.verdict.level == "good", found.summary()
    for joint, viscous in zip(log.joint_names, (25, 24, 12, 3, 3, 2), strict=True):
        drive, name = found.drives[joint], "viscous_friction"
        allowed = max(4 * drive.standard_error(name), 0.01 * viscous)
        assert drive.value(name) == pytest.approx(viscous, abs=allowed), joint


def first_project(
    folder: Path, urdf: Path | str, columns: Mapping[str, Array], **options: Any
) -> tuple[FirstProject, Project]:
    """Write a log of columns and a first project for it, and read this."""
    log = write_columns(folder / "run.npz", columns)
    made = write_first_project(urdf, [log], folder=folder / "p", **options)
    return made, load_project(folder / "p")


@pytest.mark.parametrize(
    ("quantity", "kind"),
    [
        ("motor_torque_Nm", "torque"),
        ("motor_current_A", "current"),
        ("position_command_m", "position_command"),
    ],
)
@pytest.mark.parametrize("side", ["joint_position_m", "motor_position_rad"])
def test_a_joint_that_slides_has_its_own_gear_ratio(
    tmp_path: Path, quantity: str, kind: str, side: str
) -> None:
    one_joint(tmp_path, "prismatic")
    time = np.arange(2000) / 200
    columns = {"time_s": time, f"arm.{side}": np.sin(time), f"arm.{quantity}": np.cos(3 * time)}
    gains = {"arm": seaid.Controller(position_gain_Nm_per_rad=20.0)}
    made, project = first_project(tmp_path, tmp_path / "arm.urdf", columns, controllers=gains)
    text = made.files[-1].read_text()
    is_asked = side.startswith("motor") and not kind.endswith("command")
    assert f"gear_ratio_rad_per_m = {'?' if is_asked else 1.0}" in text.replace('"', "")
    made.files[-1].write_text(text.replace('= "?"', "= 1.0"))
    assert project.robot().drives["arm"].motor_input == kind


def test_joints_that_no_column_names_are_locked_and_said(tmp_path: Path) -> None:
    """An arm on a torso, of which only the arm is logged: the rest cannot have moved unseen."""
    chain(tmp_path, "torso", "elbow", "grip")
    time = np.arange(2000) / 200
    columns = {"time_s": time, "elbow.effort": np.cos(time), "elbow.position": np.sin(time)}
    made, project = first_project(tmp_path, tmp_path / "robot.urdf", columns)
    assert made.doubts[0].startswith("torso, grip: no column of the logs has such a name: locked")
    assert project.robot().joint_names == ("elbow",)


@pytest.mark.parametrize(("lost", "is_named"), [(None, False), ("arm.effort", True)])
def test_locked_joints_are_named_where_a_joint_lacks_columns_only(
    tmp_path: Path, lost: str | None, is_named: bool
) -> None:
    one_joint(tmp_path)
    time = np.arange(400) / 200
    columns = {"arm.effort": np.cos(time), "arm.position": np.sin(time)}  # and no time
    columns.pop(lost or "", None)
    with pytest.raises(SeaidError) as caught:
        first_project(tmp_path, tmp_path / "arm.urdf", columns)
    assert ("are locked with locked=" in str(caught.value)) == is_named


def test_a_deflection_is_that_of_a_spring_in_its_unit(tmp_path: Path) -> None:
    """Its sensor stands for the motor's encoder, whose gear then is one."""
    one_joint(tmp_path, "revolute")
    time = np.arange(4000) / 200
    twist = 8.0 * np.sin(2 * time)  # [mrad]
    columns = {
        "time [s]": time,
        "arm/link angle [deg]": 40.0 * np.sin(time),
        "arm/spring deflection [mrad]": -twist,
        "arm/Iq [A]": 0.5 * twist + 0.2 * np.sign(np.cos(time)),
    }
    log = write_columns(tmp_path / "run.csv", columns)
    made = write_first_project(tmp_path / "arm.urdf", [log], folder=tmp_path / "p")
    (said,) = [one for one in made.doubts if "its deflection is logged" in one]
    assert "gear_ratio = 1.0 is a placeholder" in said
    robot, (read,) = project_of(tmp_path / "p")
    drive = robot.drives["arm"]
    assert isinstance(drive, seaid.SeriesElasticDrive)
    assert (drive.ratio, drive.motor_input, dict(drive.std)) == (1.0, "current", {})
    apart = read.motor_position[:, 0] - read.joint_position[:, 0]
    np.testing.assert_allclose(apart, 1e-3 * twist, atol=1e-9)


def test_logs_with_the_same_columns_have_one_description(tmp_path: Path) -> None:
    """A number of counts that is put right in it is that of all logs."""
    one_joint(tmp_path, "revolute")
    time, logs, folder = np.arange(4000) / 200, list[Path](), tmp_path / "p"
    for seed in (1, 2):
        angle = np.round(600 * np.sin(seed * time))
        columns = {"t": time, "q [counts]": angle, "tau [Nm]": np.cos(seed * time)}
        logs.append(write_columns(tmp_path / f"{seed}.csv", columns))
    made = write_first_project(tmp_path / "arm.urdf", logs, folder=folder)
    file, description, *others = made.files
    assert (file.name, description.name) == ("seaid.toml", "1_columns.toml")
    text = description.read_text()
    description.write_text(re.sub(r"counts_per_turn = [0-9.]+", "counts_per_turn = 6283.185", text))
    for old in (file, *others):
        old.unlink()
    write_first_project(tmp_path / "arm.urdf", logs, folder=folder)
    assert not list(folder.glob("2_columns*"))
    for log in project_of(folder)[1]:
        both = np.hstack([log.joint_position, log.motor_position])
        assert np.nanmax(np.abs(both)) == pytest.approx(0.6, rel=1e-2)


def test_a_ratio_by_counts_that_are_a_guess_is_none(tmp_path: Path) -> None:
    """A motor with 4096 counts that makes 20 turns was one with 131072 counts and a gear of 3."""
    robot, gear, stiffness = one_joint(tmp_path, "revolute"), 100.0, 50.0
    time, random = np.arange(0, 20, 0.002), np.random.default_rng(3)
    q, v, a = np.zeros((3, len(time), 1))
    for rate, phase in ((1.1, 0.0), (2.3, 1.0), (4.7, 2.0), (8.3, 0.5)):
        for order, x in enumerate((q, v, a)):
            x[:, 0] += 0.3 * rate**order * np.sin(rate * time + phase + order * np.pi / 2)
    load = joint_torques(robot, q, v, a)
    motor = gear * (q + load / stiffness)
    speed, acceleration = np.gradient(motor, time, axis=0), gear * a
    torque = load / gear + 1e-6 * acceleration + 1e-5 * speed + 2e-3 * np.sign(speed)
    columns = {"t": time, "q [rad]": q + 1e-4 * random.normal(size=q.shape), "tau [Nm]": torque}
    columns["motor position"] = np.round(motor * 4096 / (2 * np.pi))
    path = write_columns(tmp_path / "run.csv", {key: x.ravel() for key, x in columns.items()})
    made = write_first_project(tmp_path / "arm.urdf", path, folder=tmp_path / "p")
    (drives,) = (file for file in made.files if file.name == "arm_drives.toml")
    assert any(x.startswith('arm: gear_ratio = "?": write the one') for x in made.doubts)
    with pytest.raises(SeaidError, match=r"key 'gear_ratio' is missing or '\?'"):
        run_project(tmp_path / "p")
    drives.write_text(drives.read_text().replace('"?"', "100.0"))  # that of the data sheet
    robot, (log,) = project_of(tmp_path / "p")
    (finding,) = (x for x in seaid.check(robot, log).warnings if x.severity == "wrong")
    assert (finding.code, finding.joint) == ("unit", "arm")
    counts = finding.remedy.split("counts_per_turn = ")[1].split(" }")[0].split(", scale = ")
    assert float(counts[0]) / float(counts[1]) == 4096


def project_of(folder: Path) -> tuple[seaid.Robot, list[seaid.Log]]:
    """Return the robot and the logs of a project."""
    project = load_project(folder)
    robot = project.robot()
    return robot, [log.read(robot) for log in project.logs]


def test_an_inferred_ratio_always_has_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(*_: object) -> None:
        raise SeaidError("no drive fits")

    robot = seaid.load_robot(MODELS / "hebi_arm_2.urdf")
    path, description = LOGS / "hebi_arms/star_trace.npz", LOGS / "hebi_csv_2.toml"
    log = seaid.read_log(path, robot, description=description)
    monkeypatch.setattr("seaid.project.first_project.check", refuses)
    tables, doubts = inferred_drives(robot, [log])
    for table, true, said in zip(tables.values(), (762.222, 272.222), doubts, strict=True):
        ratio, error = (float(str(table[key])) for key in ("gear_ratio", "gear_ratio_std"))
        assert 0 < abs(ratio - true) < 3 * error < 0.05 * true
        assert f" +- {error:.2g} from both encoders" in said


def test_a_ratio_that_only_rounding_spoils_has_no_error() -> None:
    """A log of a simulation without steps of encoders: "86 +- 1.1e-12" says nothing."""
    robot = seaid.load_robot(MODELS / "tulip_leg.urdf")
    time = np.linspace(0.0, 10.0, 2001)
    joint = np.sin(np.outer(time, np.arange(1.0, 6.0)))
    torque = np.cos(np.outer(time, np.arange(2.0, 7.0)))
    columns = {"motor_position": 86.0 * joint, "joint_position": joint, "motor_torque": torque}
    log = log_with(robot.joint_names, time, **columns)
    tables, doubts = inferred_drives(robot, [log])
    assert tables["hip_yaw"] == {"type": "stiff", "gear_ratio": 86.0}
    assert doubts[0].startswith(
        "hip_yaw: gear_ratio = 86 from both encoders, which agree up to rounding; taken for stiff"
    )


def test_a_project_is_written_once_and_from_logs(tmp_path: Path) -> None:
    urdf, log = MODELS / "hebi_arm_2.urdf", LOGS / "hebi_arms/grav_comp_bad.npz"
    made = write_first_project(urdf, log, folder=tmp_path)
    assert "lies next to the URDF and is used" in made.doubts[0]
    with pytest.raises(SeaidError, match=r"is there already: .* seaid.run_project\(folder\)"):
        write_first_project(urdf, [log], folder=tmp_path)
    with pytest.raises(SeaidError, match="a project needs a log"):
        write_first_project(urdf, [], folder=tmp_path / "other")


@pytest.mark.parametrize(
    ("columns", "doubt"),
    [
        ({"arm_pos": 0.9, "arm_eff": 1.0}, "taken for the motor's torque converted to the joint"),
        (
            {"arm_enc_deg": 40.0, "arm_motor_rad": 20.0, "arm_torque_mNm": 1e3},
            "arm_torque_mNm: taken for the motor's torque, at the motor",
        ),
    ],
)
def test_sides_and_units_that_names_do_not_tell_are_doubts(
    tmp_path: Path, columns: dict[str, float], doubt: str
) -> None:
    chain(tmp_path, "arm", limit=1.0)
    time = np.arange(4000) / 200
    logged = {name: size * np.sin(time + k // 2) for k, (name, size) in enumerate(columns.items())}
    made, _ = first_project(tmp_path, tmp_path / "robot.urdf", {"time": time, **logged})
    assert any(doubt in text for text in made.doubts)


def test_a_current_of_one_sign_is_a_doubt_and_no_torque(tmp_path: Path) -> None:
    robot = chain(tmp_path, "arm", limit=1.0)
    time = np.arange(4000) / 200
    columns = {"time": time, "arm_pos": 0.9 * np.sin(time), "arm_current": np.abs(np.cos(3 * time))}
    made, project = first_project(tmp_path, tmp_path / "robot.urdf", columns)
    assert any("has one sign: a magnitude or the current of a" in doubt for doubt in made.doubts)
    log = project.logs[0].read(project.robot())
    with pytest.raises(IdentificationError, match="no joint has a torque in the logs: describe"):
        seaid.identify(robot, log)


def geared_log(folder: Path, count: int = 2, **more: Array) -> Path:
    """Write a log of the chain "a", "b" whose motors turn 20 times as far, the second backwards."""
    time = np.arange(6000) / 200
    columns = {"time_s": time}
    for joint, ratio, rate in (("a", 20.0, 1.1), ("b", -20.0, 1.7))[:count]:
        angle = 0.6 * np.sin(rate * time) + 0.3 * np.sin(2.3 * rate * time)
        columns[f"{joint}.joint_position_rad"] = angle
        columns[f"{joint}.motor_position_rad"] = ratio * angle
        columns[f"{joint}.motor_torque_Nm"] = np.cos(3 * rate * time)
    return write_columns(folder / "run.csv", columns | more)


def test_a_motor_that_turns_against_its_joint_has_a_positive_ratio(tmp_path: Path) -> None:
    """A slope of -20 was written as the ratio, which no drive has, and no file was written."""
    chain(tmp_path, "a", "b")
    log, folder = geared_log(tmp_path), tmp_path / "p"
    made = write_first_project(tmp_path / "robot.urdf", [log], folder=folder)
    drives = load_project(folder).robot().drives
    assert [drive.ratio for drive in drives.values()] == pytest.approx([20.0, 20.0])
    (doubt,) = [doubt for doubt in made.doubts if "sign = -1" in doubt]
    assert doubt.startswith("b: gear_ratio = 20 from both encoders, which agree up to rounding;")


def test_a_ratio_with_a_large_error_is_asked_for(tmp_path: Path) -> None:
    """Each motor of a differential turns with both joints: the slope over one is no gear ratio."""
    robot = chain(tmp_path, "a", "b")
    log = seaid.read_log(geared_log(tmp_path), robot)
    both = log.joint_position @ np.array([[20.0, 20.0], [20.0, -20.0]])
    log = replace(log, motor_position=both)
    tables, doubts = inferred_drives(robot, [log])
    for joint, doubt in zip("ab", doubts, strict=True):
        assert "gear_ratio_std" not in tables[joint]
        assert doubt.startswith(f'{joint}: gear_ratio = "?": write that of the data sheet')
    text = _drives_text(tables, doubts, tmp_path / "drives.toml")
    assert text.count('\ngear_ratio = "?"\n') == 2


def test_masses_are_as_uncertain_as_the_checks_assume(tmp_path: Path) -> None:
    """Masses known to 5 % gave a torque constant that was wrong by 6.7 standard errors."""
    chain(tmp_path, "arm")
    time = np.arange(2000) / 200
    columns = {"time_s": time, "arm.position_rad": np.sin(time), "arm.current_A": np.cos(time)}
    made, _ = first_project(tmp_path, tmp_path / "robot.urdf", columns)
    text = made.files[0].read_text()
    assert f"known_std = {{ bodies = {WIDTH_OF_BODIES} }}" in text
    assert '# link = "link_of_arm"' in text


def test_a_joint_without_a_motor_needs_no_torque(tmp_path: Path) -> None:
    """The pole of a cart was locked at zero, or its log refused."""
    robot = chain(tmp_path, "cart", "pole")
    time = np.arange(4000) / 200
    rates = np.array([1.3, 2.9])
    q, v = np.sin(np.outer(time, rates)), rates * np.cos(np.outer(time, rates))
    torque = joint_torques(robot, q, v, -(rates**2) * q)[:, 0]
    columns = {"time_s": time, "cart.motor_torque_Nm": torque}
    columns |= {f"{x}.joint_position_rad": q[:, k] for k, x in enumerate(("cart", "pole"))}
    made, project = first_project(tmp_path, tmp_path / "robot.urdf", columns)
    assert any(doubt.startswith("pole:") and "without a motor" in doubt for doubt in made.doubts)
    result = run_project(project).runs[""].identification
    assert result.model.torque_joints == ("cart",)
    assert result.verdict.level == "good"


def test_columns_of_no_joint_are_named_for_a_description(tmp_path: Path) -> None:
    """Motors with other names than joints: the message listed seaid's own columns instead."""
    robot = chain(tmp_path, "a", "wrist_pitch")
    names = {"wrist_x/motor_pos": 0, "wrist_x/tau_motor": 1, "wrist_pitch/link_pos": 2}
    time = np.arange(6000) / 200
    more = {name: np.sin((2 + k) * time) for name, k in names.items()}
    log, folder = geared_log(tmp_path, 1, **more), tmp_path / "p"
    with pytest.raises(SeaidError) as caught:
        write_first_project(tmp_path / "robot.urdf", [log], folder=folder)
    message, description = str(caught.value), log.with_suffix(".toml")
    assert "wrist_pitch: no torque, current or voltage found" in message
    assert "wrist_x/motor_pos: has the name of a position, and is not used" in message
    assert "wrist_x/tau_motor: has the name of a torque, and is not used" in message
    assert f"seaid describe {log} -o {description}" in message
    assert "its columns are" not in message
    text = seaid.describe_log(log, robot).to_toml()
    description.write_text(f'{text.rstrip()}\nmotor_torque = "wrist_x/tau_motor"\n')
    write_first_project(tmp_path / "robot.urdf", [log], folder=folder)
    assert load_project(folder).robot().joint_names == ("a", "wrist_pitch")


@pytest.mark.parametrize(
    "name", ["time,arm_pos,arm_torque", "time_s,arm.joint_position_rad,arm.motor_torque_Nm"]
)
def test_names_of_the_user_win_over_a_description_and_names_of_seaid(
    tmp_path: Path, name: str
) -> None:
    """Here they exchange the columns; where they would be those of an old file it is refused."""
    chain(tmp_path, "arm", limit=1.0)
    time = np.arange(400) / 200
    log, folder = tmp_path / "run.csv", tmp_path / "p"
    rows = np.column_stack([time, np.sin(time), np.cos(3 * time)])
    np.savetxt(log, rows, delimiter=",", header=name, comments="")
    sources = '[joints.arm]\njoint_position = "arm_pos"\nmotor_torque = "arm_torque"\n'
    log.with_suffix(".toml").write_text(f'time = "time"\n{sources}' * name.startswith("time,"))
    made = write_first_project(
        tmp_path / "robot.urdf", log, folder=folder, columns=["t", "tau", "q"]
    )
    _, (read,) = project_of(folder)
    assert read.motor_torque[:, 0] == pytest.approx(np.sin(time))
    assert read.joint_position[:, 0] == pytest.approx(np.cos(3 * time))
    made.files[0].unlink()
    with pytest.raises(SeaidError, match=r"_columns\.toml' names the columns: remove it"):
        write_first_project(tmp_path / "robot.urdf", log, folder=folder, columns=["t", "q", "tau"])


def test_files_of_a_log_are_joined_where_the_user_names_the_time_of_each(tmp_path: Path) -> None:
    chain(tmp_path, "hip", "knee")
    time = np.arange(400) / 200
    q, tau = (np.column_stack([f(time), f(2 * time)]) for f in (np.sin, np.cos))
    for name, values in (("q.csv", q), ("tau.csv", tau)):
        np.savetxt(tmp_path / name, np.column_stack([time, values]), delimiter=",")
    logs = [tmp_path / "q.csv", tmp_path / "tau.csv"]
    columns = ["t", "q", "t", "tau"]
    write_first_project(tmp_path / "robot.urdf", logs, folder=tmp_path, columns=columns)
    _, (read,) = project_of(tmp_path)
    assert read.joint_position == pytest.approx(q)
    assert read.motor_torque == pytest.approx(tau)


def test_a_column_without_a_name_is_one_for_a_description(tmp_path: Path) -> None:
    chain(tmp_path, "arm", limit=1.0)
    time = np.arange(400) / 200
    rows = np.column_stack([time, np.sin(time), np.cos(time)])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="time,arm_pos", comments="")
    with pytest.raises(SeaidError, match="columns that are not used: unnamed"):
        write_first_project(tmp_path / "robot.urdf", tmp_path / "run.csv", folder=tmp_path / "p")


def test_a_base_in_columns_of_its_own_stands_beside_joints_with_names_of_seaid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Legs with names of seaid have no other order, which is not sought."""
    order = "seaid.project.first_project.with_leg_order"
    monkeypatch.setattr(order, lambda *_: pytest.fail("sought"))
    log = swayed()
    base = base_of(log)
    assert base.angular_velocity is not None
    assert base.specific_force is not None
    vectors = {"gyro": base.angular_velocity, "imu_acc": base.specific_force}
    axes = {f"{x}_{axis}": v[:, "xyz".index(axis)] for x, v in vectors.items() for axis in "xyz"}
    flags = {f"{foot}_contact": values[:, 0] for foot, values in base.contacts.items()}
    columns = {"time_s": log.time, **log.columns(), **axes, **flags}
    options: dict[str, Any] = {"base": "floating", "contacts": [*base.contacts]}
    _, project = first_project(tmp_path, example_urdf("go2.urdf"), columns, **options)
    read = project.logs[0].read(project.robot())
    again = base_of(read)
    assert again.angular_velocity == pytest.approx(base.angular_velocity)
    assert again.specific_force == pytest.approx(base.specific_force)
    assert again.contacts.keys() == base.contacts.keys()
    assert read.motor_torque == pytest.approx(log.motor_torque)
