"""Unknown motor constants of elastic joints: by a torque sensor, or by a known test mass."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seaid.errors import IdentificationError
from seaid.identification.conditions import identify_conditions
from seaid.identification.identification import identify
from seaid.log.log import Log
from seaid.robot.inertia import is_physical
from seaid.robot.robot import Robot, load_robot
from seaid.simulation.simulation import Noise, measure
from tests.experiments import (
    ELASTIC,
    LEG_SENSORS,
    MODELS,
    TEST_MASS,
    arm,
    arm_motion,
    leg,
    leg_motion,
    perfect_log,
    true_value,
)

CONSTANTS = {"hip_pitch": 0.03, "knee_pitch": 0.026, "ankle_pitch": 0.04}
SENSOR_STD_NM = 0.02
BOUNDS = {
    "stiffness": 6.4e-6,
    "viscous_friction": 2.6e-3,
    "coulomb_friction": 7e-3,
    "motor_inertia": 4.8e-3,
}
"""Relative errors without noise: those of friction near standstill, at 6 Hz."""


@cache
def truth() -> Robot:
    return leg(TEST_MASS)


@cache
def by_current() -> Robot:
    robot = truth().without_nominal()
    return robot.with_drives(
        {
            joint: replace(robot.drives[joint], motor_input="current", motor_inertia_kg_m2=None)
            for joint in ELASTIC
        }
    )


def with_sensors(log: Log, std_Nm: float = 0.0, seed: int = 0) -> Log:
    """Return a log with currents and torque sensors at the elastic joints."""
    places = [log.joint_names.index(joint) for joint in ELASTIC]
    torque, unknown = log.motor_torque.copy(), np.full_like(log.motor_torque, np.nan)
    current, sensed = unknown.copy(), unknown.copy()
    current[:, places] = torque[:, places] / [CONSTANTS[joint] for joint in ELASTIC]
    noise = std_Nm * np.random.default_rng(seed).normal(size=(len(log.time), len(places)))
    sensed[:, places] = leg_motion(TEST_MASS).joint_torque[:, places] + noise
    torque[:, places] = np.nan
    return replace(log, motor_torque=torque, motor_current=current, joint_torque=sensed)


def by_current_alone(log: Log) -> Log:
    """Return a log with currents in place of the torques of the elastic joints."""
    return replace(with_sensors(log), joint_torque=None)


def with_and_without_mass(seed: int | None) -> dict[str, tuple[Robot, Log]]:
    """Return the leg with a bare foot and with the test mass, and its logs of currents."""
    found = dict[str, tuple[Robot, Log]]()
    for name, payloads in (("bare", []), ("loaded", [TEST_MASS])):
        drives = dict(by_current().drives)
        robot = load_robot(MODELS / "tulip_leg.urdf", drives, payloads=payloads)
        plant, motion = leg(*payloads), leg_motion(*payloads)
        log = perfect_log(plant, motion)
        if seed is not None:
            log = measure(plant, motion, LEG_SENSORS, seed + 100 * len(found))
        found[name] = robot, by_current_alone(log)
    return found


@pytest.mark.slow  # 0.5 s
def test_without_noise_all_parameters_of_the_drives_are_exact() -> None:
    log = with_sensors(perfect_log(truth(), leg_motion(TEST_MASS)))
    result = identify(by_current(), log, cutoff_hz=6.0)
    for joint in ELASTIC:
        found = result.drives[joint]
        assert found.value("torque_constant") == pytest.approx(CONSTANTS[joint], rel=3.3e-3)
        for name, error in BOUNDS.items():
            true = true_value(truth(), joint, name)
            assert found.value(name) == pytest.approx(true, rel=error), (joint, name)
    assert not {"unused-channel"} & {one.code for one in result.warnings}


@pytest.mark.slow  # ten identifications of the leg
def test_standard_errors_contain_those_of_the_sensor() -> None:
    """Without a sensor and with the torques their root mean square is 1.1 in these short logs."""
    scores = []
    for seed in range(10):
        log = measure(truth(), leg_motion(TEST_MASS), LEG_SENSORS, seed)
        result = identify(by_current(), with_sensors(log, SENSOR_STD_NM, seed), cutoff_hz=6.0)
        for joint, constant in CONSTANTS.items():
            found, true = result.drives[joint], {"torque_constant": constant}
            for name in ("stiffness", "viscous_friction", "coulomb_friction"):
                true[name] = true_value(truth(), joint, name)
            scores += [(found.value(x) - true[x]) / found.standard_error(x) for x in true]
    assert 0.88 < np.sqrt(np.mean(np.square(scores))) < 1.3


def with_known_bodies() -> Robot:
    return load_robot(
        MODELS / "tulip_leg.urdf",
        dict(by_current().drives),
        payloads=[TEST_MASS],
        known_bodies=truth().body_names,
    )


@pytest.mark.parametrize("is_sensed", [False, True])
def test_known_bodies_count_in_the_torque_that_is_explained(is_sensed: bool) -> None:
    """The load side has no parameter then; what it explains is the torque of the known bodies."""
    log = with_sensors(perfect_log(truth(), leg_motion(TEST_MASS)))
    given = log if is_sensed else replace(log, joint_torque=None)
    result = identify(with_known_bodies(), given, cutoff_hz=6.0, torque_joints=ELASTIC)
    assert len(result.load.values) == 0
    for joint in ELASTIC:
        fit = result.joint_fits[joint]
        assert fit.own < 0.01, joint
        assert result.drives[joint].value("torque_constant") == pytest.approx(
            CONSTANTS[joint], rel=6e-3
        )
    assert not [one for one in result.warnings if one.code == "no-fit"]


@pytest.mark.slow  # identifications of two logs of the leg
def test_a_test_mass_in_one_of_two_logs_gives_the_constants_of_springs() -> None:
    """The currents alone leave every torque up to scale, in each log."""
    both = identify_conditions(
        with_and_without_mass(None), torque_joints=ELASTIC, feasible=True, cutoff_hz=6.0
    )
    found = both.identifications["bare"].drives
    for joint in ELASTIC:
        one = found[joint]
        assert one.value("torque_constant") == pytest.approx(CONSTANTS[joint], rel=7e-4)
        for name, error in BOUNDS.items():
            true = true_value(truth(), joint, name)
            assert one.value(name) == pytest.approx(true, rel=max(error, 4.6e-3)), (joint, name)
    for each in both.identifications.values():
        bodies = each.robot.parameters.reshape(-1, 10)
        assert all(is_physical(body) for body in bodies)
    assert set(both.differences) == {f"spring_offset of {joint}" for joint in ELASTIC}


def test_the_rotor_inertias_of_other_joints_give_no_scale_to_noisy_currents() -> None:
    """An equation without a known torque gets a larger weight the closer all of it is to zero."""
    robot = arm().without_nominal()
    drives = {
        joint: replace(
            drive,
            motor_input="current",
            motor_inertia_kg_m2=None if drive.is_elastic else drive.motor_inertia_kg_m2,
        )
        for joint, drive in robot.drives.items()
    }
    noise = Noise(motor_resolution_rad=1e-3, joint_resolution_rad=1e-4, torque_std_Nm=0.01)
    log = measure(arm(), arm_motion(), noise, seed=0)
    unknown = np.full_like(log.motor_torque, np.nan)
    log = replace(log, motor_current=log.motor_torque / 0.05, motor_torque=unknown)
    with pytest.raises(
        IdentificationError,
        match=r"torque constant of shoulder is unidentifiable: only the current",
    ):
        identify(robot.with_drives(drives), log)
