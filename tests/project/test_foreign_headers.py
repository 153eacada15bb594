"""From a log with the header of another program to identified values, by `init` and `run`.

The headers are those of tests/data/headers; the values are of the simulated leg, in their units.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from seaid.errors import IdentificationError
from seaid.identification import Identification
from seaid.legged import load_robot
from seaid.log import Log
from seaid.project import FirstProject, load_project, run_project, write_first_project
from seaid.robot import Robot
from seaid.simulation.simulation import measure, simulate_motion
from tests import experiments
from tests.plants import write_columns

_DEVICE = "Device/SubDeviceList/{joint}"


HEADERS: dict[str, dict[str, str]] = {
    "voraus": {
        "target_position_{one}": "target",
        "motor_position_{one}": "m",
        "joint_position_{one}": "q",
        "joint_velocity_{one}": "v",
        "motor_torque_{one}": "torque",
        "computed_torque_{one}": "torque",
    },
    "link_and_motor": {"q[{k}]": "q", "theta[{k}]": "m", "dq[{k}]": "v", "tau[{k}]": "torque"},
    "with_units": {
        "{joint}_enc_deg": "degrees",
        "{joint}_motor_rad": "m",
        "{joint}_torque_mNm": "mN m",
    },
    "joint_states": {"{joint}_pos": "q", "{joint}_vel": "v", "{joint}_eff": "at the joint"},
    "rostopic": {
        "field.position{k}": "q",
        "field.velocity{k}": "v",
        "field.effort{k}": "at the joint",
    },
    "kuka_german": {
        "axis_pos_act{one}": "degrees",
        "sollposition_{one}": "degrees",
        "sollmoment_{one}": "desired",
        "istmoment_{one}": "at the joint",
    },
    "booster": {
        "q_act_{k}": "q",
        "dq_act_{k}": "v",
        "tau_est_{k}": "at the joint",
        "q_cmd_{k}": "target",
    },
    "degrees_called_rad": {"{joint}_pos_rad": "degrees", "{joint}_torque_Nm": "at the joint"},
    "currents_of_one_sign": {
        f"{_DEVICE}/Position/Sensor/Value": "q",
        f"{_DEVICE}/ElectricCurrent/Sensor/Value": "current without sign",
    },
}
"""{program: the columns of a joint, by its name or number, and what is in them}"""


CLOCKS = {"rostopic": ("%time", 1e9), "kuka_german": ("zeit", 1.0)}


def made(header: str, kind: str, legs: Path, folder: Path) -> FirstProject:
    """Write the log under a foreign header, and a first project for it."""
    robot, log = experiment(kind, legs)
    name, factor = CLOCKS.get(header, ("time", 1.0))
    columns = {name: factor * np.asarray(log.time)}
    for k, joint in enumerate(robot.joint_names):
        q, torque = log.joint_position[:, k], log.motor_torque[:, k]
        at_joint = torque * robot.drives[joint].ratio
        signals = {
            "q": q,
            "target": q + 0.01,
            "degrees": np.degrees(q),
            "v": np.gradient(q, log.time),
            "m": log.motor_position[:, k],
            "torque": torque,
            "mN m": 1e3 * torque,
            "current without sign": np.abs(torque) / 0.03,
            "at the joint": at_joint,
            "desired": 0.97 * at_joint,
        }
        for form, signal in HEADERS[header].items():
            columns[form.format(joint=joint, k=k, one=k + 1)] = signals[signal]
    path = write_columns(folder / "run.csv", columns, "%.15g")
    drives = folder / "leg.toml"
    drives.write_text(drives_of(kind), encoding="utf-8")
    urdf = experiments.MODELS / "tulip_leg.urdf"
    return write_first_project(urdf, [path], drives=drives, folder=folder)


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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("legs")


def run(folder: Path) -> Identification:
    return run_project(load_project(folder)).runs[""].identification


@pytest.mark.slow  # an identification each
@pytest.mark.parametrize("header", ["voraus", "link_and_motor", "with_units"])
def test_springs_come_from_logs_with_both_encoders(
    header: str, folder: Path, tmp_path: Path
) -> None:
    first = made(header, "elastic", folder, tmp_path)
    truth, found = experiment("elastic", folder)[0], run(tmp_path)
    errors = experiments.drive_errors(found, truth, "stiffness", "viscous_friction")
    errors.pop("stiffness of ankle_pitch")  # hardly loaded: the report says so
    assert max(map(abs, errors.values())) < 0.1
    for joint in ("hip_pitch", "knee_pitch"):
        assert abs(errors[f"stiffness of {joint}"]) < 0.02
    assert np.max(np.abs(experiments.drive_scores(found, truth, "stiffness"))) < 5
    unsaid = "taken for the motor's torque, at the motor" in "\n".join(first.doubts)
    assert unsaid == (header != "voraus")


@pytest.mark.slow  # an identification each
@pytest.mark.parametrize("header", ["joint_states", "rostopic", "kuka_german", "booster"])
def test_friction_comes_from_logs_with_one_encoder_and_the_side_of_the_torque_is_a_doubt(
    header: str, folder: Path, tmp_path: Path
) -> None:
    first = made(header, "stiff", folder, tmp_path)
    errors = experiments.drive_errors(
        run(tmp_path), experiment("stiff", folder)[0], "viscous_friction", "coulomb_friction"
    )
    assert max(map(abs, errors.values())) < 0.2
    assert NOT_SI in "\n".join(first.doubts)


@pytest.mark.slow  # simulates the leg
def test_values_that_contradict_their_names_are_doubts(folder: Path, tmp_path: Path) -> None:
    """Degrees called radians, and currents of one sign, which are no torque."""
    doubts = "\n".join(made("degrees_called_rad", "stiff", folder, tmp_path).doubts)
    for joint in experiment("stiff", folder)[0].joint_names:
        assert f"{joint}_pos_rad: goes beyond the limits of {joint}: check its unit" in doubts
    (tmp_path / "currents").mkdir()
    first = made("currents_of_one_sign", "stiff", folder, tmp_path / "currents")
    assert any("has one sign: a magnitude or the current of a" in doubt for doubt in first.doubts)
    with pytest.raises(IdentificationError, match="no joint has a torque in the logs: describe"):
        run(tmp_path / "currents")
