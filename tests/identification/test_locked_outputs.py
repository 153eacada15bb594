"""A spring whose output is held from outside, as on a test bench."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import seaid
from seaid.drives.drives import SeriesElasticDrive, StiffDrive
from seaid.errors import IdentificationError, LogError
from seaid.identification.identification import identify
from seaid.log.log import Log
from seaid.project.first_project import inferred_drives
from seaid.robot.robot import Robot, load_robot

URDF = """\
<robot name="bench"><link name="base"/>
<link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="1.0"/>
<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="100" velocity="5"/></joint></robot>
"""
K, N, ROTOR, VISCOUS, COULOMB, K_T = 300.0, 100.0, 5e-5, 1e-4, 0.02, 0.05
TRUE = {
    "stiffness": K,
    "motor_inertia": ROTOR,
    "viscous_friction": VISCOUS,
    "coulomb_friction": COULOMB,
}
RATE_HZ, STEPS = 1000, 4


@cache
def bench_log() -> Log:
    """Return a bench under a position controller, integrated here, at the rate of its encoder."""
    time = np.arange(0.0, 10.0, 1 / RATE_HZ)
    tones = ((0.3, 0.0), (0.9, 1.0), (1.7, 2.0), (3.1, 0.4))
    goal = 4.0 * np.sum([np.sin(2 * np.pi * hz * time + phase) for hz, phase in tones], axis=0)
    angle = speed = 0.0
    dt, found = 1 / RATE_HZ / STEPS, []
    for one in goal.tolist():
        current = (0.02 * (one - angle) - 0.001 * speed) / K_T
        found.append((angle, current))
        for _ in range(STEPS):
            friction = VISCOUS * speed + COULOMB * np.tanh(speed / 0.2)
            speed += dt * (K_T * current - friction - K * angle / N**2) / ROTOR
            angle += dt * speed
    motor, current = np.array(found).T[:, :, None]
    random, step = np.random.default_rng(1), 2 * np.pi / 2048
    return Log(
        time=time,
        joint_names=("elbow",),
        motor_position=step * np.round(motor / step),
        joint_position=np.zeros_like(motor),
        motor_torque=K_T * current + 5e-4 * random.normal(size=motor.shape),
        joint_torque=K * motor / N + 0.05 * random.normal(size=motor.shape),
    )


def bench(tmp_path: Path, **options: object) -> Robot:
    (tmp_path / "bench.urdf").write_text(URDF)
    drive = replace(SeriesElasticDrive(gear_ratio=N), **options)  # type: ignore[arg-type]
    return load_robot(tmp_path / "bench.urdf", {"elbow": drive})


@pytest.mark.parametrize("is_current", [False, True])
def test_the_drive_of_a_locked_output_is_identified(tmp_path: Path, is_current: bool) -> None:
    log, input_of = bench_log(), "current" if is_current else "torque"
    if is_current:
        unknown = np.full_like(log.motor_torque, np.nan)
        log = replace(log, motor_torque=unknown, motor_current=log.motor_torque / K_T)
    found = identify(bench(tmp_path, motor_input=input_of), log)
    true = TRUE | ({"torque_constant": K_T} if is_current else {})
    drive = found.drives["elbow"]
    for name, value in true.items():  # friction near standstill is that of tanh
        assert drive.value(name) == pytest.approx(value, rel=0.035), name
    assert drive.value("stiffness") == pytest.approx(K, rel=2e-3)
    assert found.verdict.level == "good", found.summary()
    (note,) = [one for one in found.warnings if one.code == "locked-output"]
    assert (note.joint, note.severity) == ("elbow", "note")
    assert np.isnan(found.joint_fits["elbow"].own)
    assert found.joint_fits["elbow"].motor < 0.05
    assert seaid.check(bench(tmp_path, motor_input=input_of), log).warnings[0].code == note.code


def test_what_holds_an_output_may_yield(tmp_path: Path) -> None:
    log = bench_log()
    yields = replace(log, joint_position=0.01 * log.motor_position / N)
    found = identify(bench(tmp_path), yields)
    assert [one.code for one in found.warnings if one.code != "gear-compliance"] == [
        "locked-output"
    ]
    assert found.drives["elbow"].value("stiffness") == pytest.approx(K / 0.99, rel=2e-3)


def test_an_encoder_that_does_not_follow_a_wide_motion_is_dead(tmp_path: Path) -> None:
    log = bench_log()
    wide = replace(log, motor_position=5 * log.motor_position)
    with pytest.raises(LogError, match=r"the joint position of 'elbow' is 0 all the time"):
        identify(bench(tmp_path), wide)


def test_a_current_alone_gives_no_scale(tmp_path: Path) -> None:
    log = bench_log()
    unknown = np.full_like(log.motor_torque, np.nan)
    alone = replace(log, motor_torque=unknown, motor_current=log.motor_torque, joint_torque=None)
    message = "the torque constant of elbow is unidentifiable: .* and its output is locked"
    with pytest.raises(IdentificationError, match=message):
        identify(bench(tmp_path, motor_input="current"), alone)
    known = {"stiffness_Nm_per_rad": K, "known": ("stiffness",), "motor_input": "current"}
    drive = identify(bench(tmp_path, **known), alone).drives["elbow"]
    assert drive.value("torque_constant") == pytest.approx(1.0, rel=2e-3)


def test_a_first_project_asks_for_the_gear_ratio_of_a_locked_output(tmp_path: Path) -> None:
    robot = bench(tmp_path).with_drives({"elbow": StiffDrive(gear_ratio=1.0)})
    tables, (doubt,) = inferred_drives(robot, [bench_log()])
    assert tables == {"elbow": {"type": "series_elastic", "gear_ratio": 1.0}}
    assert "gear_ratio = 1.0 is a placeholder: write that of the data sheet" in doubt


def test_a_locked_output_that_slides_gets_a_drive_that_can_be_read(tmp_path: Path) -> None:
    (tmp_path / "bench.urdf").write_text(URDF.replace('"revolute"', '"prismatic"'))
    robot = load_robot(tmp_path / "bench.urdf")
    tables, (doubt,) = inferred_drives(robot, [replace(bench_log(), is_prismatic=(True,))])
    assert "motor_pulley_radius_m = 1.0 is a placeholder" in doubt
    assert load_robot(tmp_path / "bench.urdf", tables).drives["elbow"].is_elastic
