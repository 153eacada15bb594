"""The gear between the encoders: its compliance in series with the spring."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from seaid.drives import SeriesElasticDrive
from seaid.errors import IdentificationError, RobotError
from seaid.estimation.fitting import EstimatorName
from seaid.identification import Identification, identify, identify_conditions, refine, validate
from seaid.log import Log
from seaid.robot import Robot
from tests.experiments import arm, arm_log, arm_motion, with_drive
from tests.representatives import quick_first

pytestmark = pytest.mark.usefixtures("estimates_only")

GEAR = 4000.0


def with_gear(robot: Robot, stiffness: float, joint: str = "shoulder") -> Robot:
    """Return the robot whose gear has a stiffness, with the same stiffness between encoders."""
    geared = with_drive(robot, joint, gear_stiffness_Nm_per_rad=stiffness).drives[joint]
    return robot.with_drives({joint: geared.with_values(robot.drives[joint].values)})


@cache
def log() -> Log:
    return arm_log(0)


@cache
def found(geared: bool) -> Identification:
    robot = with_gear(arm(), GEAR) if geared else arm()
    return identify(robot.without_nominal(), log())


def test_springs_and_gears_are_in_series() -> None:
    """A pulley of radius r turns the gear's N m/rad into N/m by 1/r^2."""
    drive = SeriesElasticDrive(
        gear_ratio=100.0,
        motor_pulley_radius_m=0.01,
        load_pulley_radius_m=0.02,
        stiffness_N_per_m=2e5,
        gear_stiffness_Nm_per_rad=100.0,
    )
    assert drive.own_values["stiffness"] == 2e5
    assert drive.values["stiffness"] == pytest.approx(1 / (1 / 2e5 + 0.01**2 / 100))
    again = drive.with_values(drive.values)
    assert again.stiffness_N_per_m == pytest.approx(2e5, rel=1e-14)


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


def test_stiffness_is_that_of_the_spring_if_the_gear_is_known() -> None:
    plain, geared = (found(one).drives["shoulder"] for one in (False, True))
    between, own = plain.value("stiffness"), geared.value("stiffness")
    assert 1 / own == pytest.approx(1 / between - 1 / GEAR)
    error = (own / between) ** 2 * plain.standard_error("stiffness")  # dk / dK = (k / K)^2
    assert geared.standard_error("stiffness") == pytest.approx(error)
    for name in ("viscous_friction", "spring_offset"):
        assert geared.value(name) == pytest.approx(plain.value(name))
    identified: Any = found(True).robot.drives["shoulder"]
    assert identified.own_values["stiffness"] == pytest.approx(own)
    assert identified.values["stiffness"] == pytest.approx(between)


@pytest.mark.slow  # refines a joint or searches for instruments
def test_refined_stiffness_is_that_of_the_spring() -> None:
    between, own = (
        refine(found(one), log()).drives["shoulder"].value("stiffness") for one in (False, True)
    )
    assert 1 / own == pytest.approx(1 / between - 1 / GEAR, rel=1e-6)


def test_what_a_known_or_a_measured_gear_excludes_is_refused() -> None:
    """A gear softer than what it is part of, a deflection of some logs, and its refinement."""
    known = arm().without_nominal()
    soft = with_drive(known, "shoulder", gear_stiffness_Nm_per_rad=10.0)
    with pytest.raises(RobotError, match="check gear_stiffness_Nm_per_rad"):
        identify(soft, log())
    with pytest.raises(IdentificationError, match="deflection of shoulder is in 1 of 2 logs"):
        identify(known, [log(), log_with_deflection()])
    with pytest.raises(IdentificationError, match="deflection of shoulder was measured"):
        refine(found_with_deflection(), log_with_deflection())


@cache
def log_with_deflection(joint: str = "shoulder", gear: float = GEAR) -> Log:
    """Return a log whose deflection between the encoders is partly that of the gear."""
    drive, index = with_gear(arm(), gear, joint).drives[joint], arm().index(joint)
    motion = arm_motion()
    between = drive.motor_radius / drive.ratio * motion.motor_position[:, index]
    between = between - drive.load_radius * motion.joint_position[:, index]
    own = between * drive.values["stiffness"] / drive.own_values["stiffness"]
    deflection = np.full_like(motion.joint_position, np.nan)
    noise = np.random.default_rng(0).normal(size=len(own))
    deflection[:, index] = (own + 2e-5 * np.ptp(own) * noise) / drive.load_radius
    return replace(log(), deflection=deflection)


@pytest.mark.parametrize(
    ("joint", "gear", "estimator"),
    quick_first([("telescope", 20.0, "wls"), ("shoulder", 4000.0, "iv")]),
)
def test_deflection_separates_spring_and_gear(
    joint: str, gear: float, estimator: EstimatorName
) -> None:
    """Whichever way they are estimated."""
    truth = with_gear(arm(), gear, joint).drives[joint]
    measured = log_with_deflection(joint, gear)
    one = identify(arm().without_nominal(), measured, estimator=estimator)
    drive = one.drives[joint]
    for name, true in (("stiffness", truth.own_values["stiffness"]), ("gear_stiffness", gear)):
        assert drive.value(name) == pytest.approx(true, rel=0.02)
        assert abs(drive.value(name) - true) < 3 * drive.standard_error(name)
    assert abs(drive.value("gear_hysteresis")) < 3 * drive.standard_error("gear_hysteresis")
    identified: Any = one.robot.drives[joint]
    assert identified.gear_stiffness_Nm_per_rad == drive.value("gear_stiffness")
    between = found(False).drives[joint].value("stiffness")
    assert identified.values["stiffness"] == pytest.approx(between, rel=1e-3)


@cache
def found_with_deflection() -> Identification:
    return identify(arm().without_nominal(), log_with_deflection())


def test_given_gear_stays_as_given() -> None:
    known = with_gear(arm(), 3000.0).without_nominal()
    one = identify(known, log_with_deflection())
    same = found_with_deflection().drives["shoulder"].value("stiffness")
    assert one.drives["shoulder"].value("stiffness") == pytest.approx(same)
    identified: Any = one.robot.drives["shoulder"]
    assert identified.gear_stiffness_Nm_per_rad == 3000.0


def test_validation_needs_no_deflection_and_takes_none() -> None:
    """The stiffness between the encoders is in place of the spring's where only they are logged."""
    right = validate(found(False), log()).actuator.rms_error
    without = validate(found_with_deflection(), log()).actuator.rms_error
    assert without == pytest.approx(right, rel=0.02, nan_ok=True)
    index = arm().index("shoulder")
    spring = replace(found_with_deflection(), gears={}, robot=found(False).robot)
    assert validate(spring, log()).actuator.rms_error[index] > 1.5 * right[index]
    more = validate(found(False), log_with_deflection()).actuator.rms_error
    assert more == pytest.approx(right, nan_ok=True)


@pytest.mark.findings
def test_rigid_gear_is_reported_as_rigid() -> None:
    one = identify(arm().without_nominal(), log_with_deflection(gear=1e9))
    assert "gear_stiffness" not in one.drives["shoulder"].names
    (note,) = [flag for flag in one.warnings if "rigid within the errors" in flag.message]
    assert (note.code, note.joint, note.severity) == ("gear-compliance", "shoulder", "note")
    assert one.robot.drives["shoulder"].gear_compliance == 0


def test_hysteresis_of_the_gear() -> None:
    index, clean = arm().index("shoulder"), log_with_deflection()
    assert clean.deflection is not None
    late = clean.deflection.copy()
    speed = arm_motion().motor_velocity[:, index]
    slow = np.abs(speed) < 0.01 * np.max(np.abs(speed))  # somewhere inside the hysteresis
    late[:, index] -= 1e-3 * np.where(slow, 0.0, np.sign(speed))
    drive = identify(arm().without_nominal(), replace(clean, deflection=late)).drives["shoulder"]
    # the force of the wind-up follows from the same deflection: c k h on top of h
    seen = 1e-3 * (1 + drive.value("stiffness") / GEAR)
    assert drive.value("gear_hysteresis") == pytest.approx(seen, rel=0.005)
    assert drive.value("gear_stiffness") == pytest.approx(GEAR, rel=0.02)


def test_conditions_with_a_measured_deflection() -> None:
    part = {"a": (0.0, 3.0), "b": (3.0, 7.0)}
    robot, whole = arm().without_nominal(), log_with_deflection()
    logs = {name: (robot, whole.between(*ends)) for name, ends in part.items()}
    both = identify_conditions(logs, cutoff_hz=8.0)
    for one in both.identifications.values():
        assert one.drives["shoulder"].value("gear_stiffness") == pytest.approx(GEAR, rel=0.05)
