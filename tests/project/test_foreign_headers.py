"""From a log with the header of another program to identified values, by `init` and `run`.

The headers are those of tests/data/headers; the values are of the simulated leg, in their units.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import IdentificationError
from seaid.identification.result import Identification
from seaid.legged import load_robot
from seaid.log.reading import Log
from seaid.project.first_project import FirstProject, write_first_project
from seaid.project.project import load_project
from seaid.project.running import run_project
from seaid.robot.robot import Robot
from seaid.simulation.simulation import measure, simulate_motion
from tests import experiments

Columns = dict[str, Array]
PULLEYS = r"(?m)^(motor_pulley|load_pulley|stiffness).*\n"
NOT_SI = "taken for the motor's torque converted to the joint, which includes friction"


def drives_of(kind: str) -> str:
    """Return the drives of the leg: with their springs, or stiff ones with the same gears."""
    text = (experiments.MODELS / "tulip_leg.toml").read_text("utf-8")
    if kind == "elastic":
        return text
    return re.sub(PULLEYS, "", text.replace('"series_elastic"', '"stiff"'))


@cache
def experiment(kind: str, folder: Path) -> tuple[Robot, Log]:
    """Return the true leg of a kind and a log of it."""
    (folder / "leg.toml").write_text(drives_of(kind), encoding="utf-8")
    robot = load_robot(experiments.MODELS / "tulip_leg.urdf", folder / "leg.toml")
    motion = simulate_motion(robot, experiments.leg_trajectory())
    return robot, measure(robot, motion, experiments.LEG_SENSORS, 1)


def voraus(
    k: int, joint: str, q: Array, v: Array, m: Array, tau: Array, at_joint: Array
) -> Columns:
    return {
        **{f"target_position_{k + 1}": q + 0.01, f"motor_position_{k + 1}": m},
        **{f"joint_position_{k + 1}": q, f"joint_velocity_{k + 1}": v},
        **{f"motor_torque_{k + 1}": tau, f"computed_torque_{k + 1}": 0.9 * tau},
    }


def link_and_motor(
    k: int, joint: str, q: Array, v: Array, m: Array, tau: Array, at_joint: Array
) -> Columns:
    return {f"q[{k}]": q, f"theta[{k}]": m, f"dq[{k}]": v, f"tau[{k}]": tau}


def with_units(
    k: int, joint: str, q: Array, v: Array, m: Array, tau: Array, at_joint: Array
) -> Columns:
    names = (f"{joint}_enc_deg", f"{joint}_motor_rad", f"{joint}_torque_mNm")
    return dict(zip(names, (np.degrees(q), m, 1e3 * tau), strict=True))


def joint_states(
    k: int, joint: str, q: Array, v: Array, m: Array, tau: Array, at_joint: Array
) -> Columns:
    return {f"{joint}_pos": q, f"{joint}_vel": v, f"{joint}_eff": at_joint}


def rostopic(
    k: int, joint: str, q: Array, v: Array, m: Array, tau: Array, at_joint: Array
) -> Columns:
    return {f"field.position{k}": q, f"field.velocity{k}": v, f"field.effort{k}": at_joint}


def kuka_german(
    k: int, joint: str, q: Array, v: Array, m: Array, tau: Array, at_joint: Array
) -> Columns:
    angle = np.degrees(q)
    return {
        **{f"axis_pos_act{k + 1}": angle, f"sollposition_{k + 1}": angle + 0.3},
        **{f"sollmoment_{k + 1}": 0.95 * at_joint, f"istmoment_{k + 1}": at_joint},
    }


def booster(
    k: int, joint: str, q: Array, v: Array, m: Array, tau: Array, at_joint: Array
) -> Columns:
    return {f"q_act_{k}": q, f"dq_act_{k}": v, f"tau_est_{k}": at_joint, f"q_cmd_{k}": q + 0.02}


def dfki(k: int, joint: str, q: Array, v: Array, m: Array, tau: Array, at_joint: Array) -> Columns:
    return {
        **{f"pos_meas{k + 1}": q, f"vel_meas{k + 1}": v, f"pos_des{k + 1}": q - 0.01},
        **{f"tau_meas{k + 1}": at_joint, f"tau_des{k + 1}": 0.97 * at_joint},
    }


def degrees_called_rad(
    k: int, joint: str, q: Array, v: Array, m: Array, tau: Array, at_joint: Array
) -> Columns:
    return {f"{joint}_pos_rad": np.degrees(q), f"{joint}_torque_Nm": at_joint}


def currents_of_one_sign(
    k: int, joint: str, q: Array, v: Array, m: Array, tau: Array, at_joint: Array
) -> Columns:
    head = f"Device/SubDeviceList/{joint}"
    current = np.abs(tau) / 0.03
    return {f"{head}/Position/Sensor/Value": q, f"{head}/ElectricCurrent/Sensor/Value": current}


CLOCKS = {"rostopic": ("%time", 1e9), "kuka_german": ("zeit", 1.0)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("legs")


def made(header: Callable[..., Columns], kind: str, legs: Path, folder: Path) -> FirstProject:
    """Write the log under a foreign header, and a first project for it."""
    robot, log = experiment(kind, legs)
    name, factor = CLOCKS.get(header.__name__, ("time", 1.0))
    columns = {name: factor * np.asarray(log.time)}
    for k, joint in enumerate(robot.joint_names):
        q, tau = log.joint_position[:, k], log.motor_torque[:, k]
        at_joint = tau * robot.drives[joint].ratio
        speed = np.gradient(q, log.time)
        columns |= header(k, joint, q, speed, log.motor_position[:, k], tau, at_joint)
    table, head = np.column_stack(list(columns.values())), ",".join(columns)
    np.savetxt(folder / "run.csv", table, "%.15g", ",", header=head, comments="")
    urdf = experiments.MODELS / "tulip_leg.urdf"
    (folder / "leg.toml").write_text(drives_of(kind), encoding="utf-8")
    return write_first_project(
        urdf, [folder / "run.csv"], drives=folder / "leg.toml", folder=folder
    )


def run(folder: Path) -> Identification:
    return run_project(load_project(folder)).runs[""].identification


@pytest.mark.slow  # an identification each
@pytest.mark.parametrize("header", [voraus, link_and_motor, with_units])
def test_springs_come_from_logs_with_both_encoders(
    header: Callable[..., Columns], folder: Path, tmp_path: Path
) -> None:
    first = made(header, "elastic", folder, tmp_path)
    truth, found = experiment("elastic", folder)[0], run(tmp_path)
    errors = experiments.drive_errors(found, truth, "stiffness", "viscous_friction")
    assert abs(errors.pop("stiffness of hip_pitch")) < 0.02
    assert abs(errors.pop("stiffness of knee_pitch")) < 0.02
    errors.pop("stiffness of ankle_pitch")  # hardly loaded: the report says so
    assert max(map(abs, errors.values())) < 0.1
    assert np.max(np.abs(experiments.drive_scores(found, truth, "stiffness"))) < 5
    unsaid = "taken for the motor's torque, at the motor" in "\n".join(first.doubts)
    assert unsaid == (header is not voraus)


@pytest.mark.slow  # an identification each
@pytest.mark.parametrize("header", [joint_states, rostopic, kuka_german, booster, dfki])
def test_friction_comes_from_logs_with_one_encoder_and_the_side_of_the_torque_is_a_doubt(
    header: Callable[..., Columns], folder: Path, tmp_path: Path
) -> None:
    first = made(header, "stiff", folder, tmp_path)
    errors = experiments.drive_errors(
        run(tmp_path), experiment("stiff", folder)[0], "viscous_friction", "coulomb_friction"
    )
    assert max(map(abs, errors.values())) < 0.2
    assert NOT_SI in "\n".join(first.doubts)


@pytest.mark.slow  # simulates the leg
def test_degrees_called_radians_are_a_doubt(folder: Path, tmp_path: Path) -> None:
    doubts = "\n".join(made(degrees_called_rad, "stiff", folder, tmp_path).doubts)
    for joint in experiment("stiff", folder)[0].joint_names:
        assert f"{joint}_pos_rad: goes beyond the limits of {joint}: check its unit" in doubts


@pytest.mark.slow  # simulates the leg
def test_currents_of_one_sign_are_a_doubt_and_no_torque(folder: Path, tmp_path: Path) -> None:
    doubts = "\n".join(made(currents_of_one_sign, "stiff", folder, tmp_path).doubts)
    assert "has one sign: a magnitude or the current of a supply?" in doubts
    with pytest.raises(IdentificationError, match="no joint has a torque in the logs: describe"):
        run(tmp_path)
