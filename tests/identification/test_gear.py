"""The gear between the encoders: its compliance in series with the spring."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seaid.drives import SeriesElasticDrive, drive_table, drives_from_mapping
from seaid.errors import RobotError
from seaid.identification.identification import Identification, identify
from seaid.identification.output_error import refine
from seaid.identification.validation import validate
from seaid.log.log import Log
from seaid.robot.robot import Robot
from seaid.simulation.plant import plant_of
from seaid.simulation.simulation import measure
from tests.experiments import ARM_SENSORS, arm, arm_motion

GEAR = 4000.0


def with_gear(robot: Robot, stiffness: float, joint: str = "shoulder") -> Robot:
    """Return the robot whose gear has a stiffness, with the same stiffness between encoders."""
    drive = replace(robot.drives[joint], gear_stiffness_Nm_per_rad=stiffness)
    return robot.with_drives({joint: drive.with_values(robot.drives[joint].values)})


@cache
def log() -> Log:
    return measure(arm(), arm_motion(), ARM_SENSORS, 0)


@cache
def found(geared: bool) -> Identification:
    robot = with_gear(arm(), GEAR) if geared else arm()
    return identify(robot.without_nominal(), log())


def test_series_of_spring_and_gear() -> None:
    drive = SeriesElasticDrive(
        gear_ratio=100.0, stiffness_Nm_per_rad=300.0, gear_stiffness_Nm_per_rad=1500.0
    )
    assert drive.own_values["stiffness"] == 300.0
    assert drive.values["stiffness"] == pytest.approx(1 / (1 / 300 + 1 / 1500))
    again = drive.with_values(drive.values)
    assert again.stiffness_Nm_per_rad == pytest.approx(300.0, rel=1e-14)


def test_pulleys_see_the_gear_through_their_radius() -> None:
    """A pulley of radius r turns the gear's N m/rad into N/m by 1/r^2."""
    drive = SeriesElasticDrive(
        gear_ratio=100.0,
        motor_pulley_radius_m=0.01,
        load_pulley_radius_m=0.02,
        stiffness_N_per_m=2e5,
        gear_stiffness_Nm_per_rad=100.0,
    )
    assert drive.values["stiffness"] == pytest.approx(1 / (1 / 2e5 + 0.01**2 / 100))


def test_gear_in_a_table_of_drives() -> None:
    table = {
        "type": "series_elastic",
        "gear_ratio": 100.0,
        "stiffness_Nm_per_rad": 300.0,
        "gear_stiffness_Nm_per_rad": 1500.0,
    }
    (drive,) = drives_from_mapping({"knee": table}).values()
    assert drive_table(drive) == table
    assert drive.without_nominal().gear_compliance == 1 / 1500


@pytest.mark.parametrize("cubic", [3e4, -1e4])
def test_nonlinear_spring_behind_a_gear(cubic: float) -> None:
    """Between the encoders: F solves d = d_s + F / k_G, F = k d_s + k_3 d_s^3 (+ damping)."""
    k, fifth, gear = 300.0, 2e5, 3000.0
    drive = SeriesElasticDrive(
        gear_ratio=100.0,
        spring=("linear", "cubic", "fifth"),
        stiffness_Nm_per_rad=k,
        nominal={"cubic_stiffness": cubic, "fifth_stiffness": fifth},
        gear_stiffness_Nm_per_rad=gear,
    )
    own = np.linspace(-0.04, 0.04, 9)
    force = k * own + cubic * own**3 + fifth * own**5
    d, values = own + force / gear, drive.values
    powers = ("stiffness", 1), ("cubic_stiffness", 3), ("fifth_stiffness", 5)
    between = sum(values[name] * d**power for name, power in powers)
    bent, softer = force - k * own, 3 * cubic * own**2 + 5 * fifth * own**4
    neglected = np.max(np.abs(bent * softer)) / gear  # see `seaid.drives.terms`
    assert between == pytest.approx(force, abs=neglected)
    assert neglected < 0.1 * np.max(np.abs(k * d + cubic * d**3 + fifth * d**5 - force))
    again = drive.with_values({"stiffness": values["stiffness"]})
    assert again.own_values["cubic_stiffness"] == pytest.approx(cubic)


def test_simulation_has_the_stiffness_between_the_encoders() -> None:
    index = arm().model_order.index(arm().index("shoulder"))
    geared = with_gear(arm(), GEAR)
    assert plant_of(geared).stiffness[index] == pytest.approx(plant_of(arm()).stiffness[index])
    assert geared.drives["shoulder"].stiffness > 1.02 * arm().drives["shoulder"].stiffness


def test_stiffness_is_that_of_the_spring_if_the_gear_is_known() -> None:
    plain, geared = (found(one).drives["shoulder"] for one in (False, True))
    between, own = plain.value("stiffness"), geared.value("stiffness")
    assert 1 / own == pytest.approx(1 / between - 1 / GEAR)
    error = (own / between) ** 2 * plain.standard_error("stiffness")  # dk / dK = (k / K)^2
    assert geared.standard_error("stiffness") == pytest.approx(error)
    for name in ("viscous_friction", "spring_offset"):
        assert geared.value(name) == pytest.approx(plain.value(name))
    identified = found(True).robot.drives["shoulder"]
    assert identified.stiffness == pytest.approx(own)
    assert identified.values["stiffness"] == pytest.approx(between)


def test_predictions_and_refinement_do_not_depend_on_who_knows_the_gear() -> None:
    plain, geared = (validate(found(one), log()) for one in (False, True))
    assert geared.actuator.rms_error == pytest.approx(plain.actuator.rms_error, nan_ok=True)
    assert geared.load.rms_error == pytest.approx(plain.load.rms_error, nan_ok=True)


def test_refined_stiffness_is_that_of_the_spring() -> None:
    between, own = (
        refine(found(one), log()).drives["shoulder"].value("stiffness") for one in (False, True)
    )
    assert 1 / own == pytest.approx(1 / between - 1 / GEAR, rel=1e-6)


def test_note_says_which_stiffness_is_meant() -> None:
    def notes(one: Identification) -> list[str]:
        return [flag.message for flag in one.warnings if flag.code == "gear-compliance"]

    (plain,) = notes(found(False))
    assert "shoulder" in plain
    assert "between the encoders" in plain
    assert not any("shoulder" in one for one in notes(found(True)))


def test_gear_softer_than_what_it_is_part_of() -> None:
    with pytest.raises(RobotError, match="check gear_stiffness_Nm_per_rad"):
        identify(with_soft_gear(), log())


def with_soft_gear() -> Robot:
    known = arm().without_nominal()
    drive = replace(known.drives["shoulder"], gear_stiffness_Nm_per_rad=10.0)
    return known.with_drives({"shoulder": drive})


@pytest.mark.parametrize("value", [0.0, -5.0, 1e40])
def test_gear_stiffness_that_is_none(value: float) -> None:
    with pytest.raises(RobotError, match="gear_stiffness_Nm_per_rad must be"):
        SeriesElasticDrive(gear_ratio=100.0, gear_stiffness_Nm_per_rad=value)
