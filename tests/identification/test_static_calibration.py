"""Calibration from statics: laws recovered, intervals that hold, ramps, poses, tables, mistakes."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import seaid
from seaid._arrays import Array
from seaid.errors import IdentificationError
from seaid.identification import (
    StaticCalibration,
    Statics,
    calibrate_statics,
    held_poses,
    read_statics,
)
from tests.experiments import leg
from tests.standard_errors import scores

WEIGHTS = np.linspace(-14.7, 14.7, 18)
"""The loads [N m] of the published calibration of an ANYdrive: k = 159.8 N m/rad, rms 0.077 N m."""

STIFFNESS, RMS = 159.8, 0.077


def anydrive(seed: int) -> StaticCalibration:
    noise = RMS / STIFFNESS * np.random.default_rng(seed).normal(size=len(WEIGHTS))
    return calibrate_statics(Statics(WEIGHTS, WEIGHTS / STIFFNESS + 0.01 + noise))


def ramp(seed: int, friction: float = 0.3, cubic: float = 2000.0) -> Statics:
    """Return a slow ramp up and down, with the readings of a spring behind friction."""
    up = np.linspace(-15.0, 15.0, 300)
    load = np.concatenate([up, up[-2::-1]])
    direction = np.repeat([1.0, -1.0], [300, 299])
    d = np.linspace(-0.16, 0.16, 20_001)
    reading = np.interp(load - friction * direction, 150.0 * d + cubic * d**3, d) + 0.02
    noise = 5e-4 * np.random.default_rng(seed).normal(size=len(load))
    return Statics(load, reading + noise)


def test_a_straight_line_is_the_regression_of_the_reading_on_the_load() -> None:
    """An independent route: loads without errors are the regressor."""
    found = anydrive(3)
    slope, start = np.polyfit(WEIGHTS, found.statics.reading, 1)
    assert found.estimate.value("stiffness") == pytest.approx(1 / slope, rel=1e-9)
    assert found.estimate.value("zero") == pytest.approx(start, rel=1e-9)
    # hysteresis takes loads up and down
    assert found.estimate.names == ("stiffness", "zero")
    assert np.isnan(found.hysteresis)
    assert "no hysteresis without loads up and down" in str(found)


def test_a_ramp_up_and_down_separates_friction_from_a_cubic_spring() -> None:
    found = [calibrate_statics(ramp(seed), law="cubic") for seed in range(60)]
    assert found[0].estimate.names == ("stiffness", "cubic_stiffness", "zero", "friction")
    assert found[0].estimate.units == ("N m/rad", "N m/rad^3", "rad", "N m")
    truth = dict(zip(map(str, found[0].estimate.names), (150.0, 2000.0, 0.02, 0.3), strict=True))
    draws = np.array([scores(one.estimate, truth) for one in found])
    assert np.all(np.abs(np.mean(draws, axis=0)) < 0.5)
    assert np.all((np.std(draws, axis=0) > 0.75) & (np.std(draws, axis=0) < 1.3))
    assert found[0].hysteresis == pytest.approx(0.6 / 30, rel=0.05)
    assert 0.01 < found[0].linearity < 0.04
    assert not found[0].warnings


@pytest.mark.slow  # 0.7 s
def test_correlated_readings_have_a_wider_interval() -> None:
    """A drifting sensor on a long ramp: the scatter is that of the standard errors."""
    load, draws, errors = np.linspace(-10.0, 10.0, 400), [], []
    for seed in range(200):
        white = np.random.default_rng(seed).normal(size=400)
        noise = lfilter([1e-3], [1.0, -0.9], np.append(0.0, white[1:]))
        found = calibrate_statics(Statics(load, load / 100.0 + noise))
        draws.append(found.estimate.values[0])
        errors.append(found.estimate.standard_errors[0])
    assert 0.75 < np.mean(errors) / np.std(draws) < 1.3


@pytest.mark.parametrize(
    ("statics", "law", "code", "severity"),
    [
        (ramp(0, 0.0), "linear", "nonlinear-spring", "doubtful"),
        (ramp(0, 0.0, 0.0), "cubic", "needless-term", "note"),
        (Statics(WEIGHTS, -WEIGHTS / STIFFNESS), "linear", "sign", "doubtful"),
        (Statics(WEIGHTS, np.cos(np.arange(18.0)) + 1e-3 * WEIGHTS), "linear", "no-fit", "wrong"),
    ],
)
def test_what_is_wrong_is_named(statics: Statics, law: Any, code: str, severity: str) -> None:
    found = calibrate_statics(statics, law=law)
    assert (code, severity) in {(one.code, one.severity) for one in found.warnings}


@pytest.mark.parametrize(
    ("load", "reading", "words"),
    [
        (np.ones(18), WEIGHTS, "5 or more loads that differ, found all 1"),
        (WEIGHTS, np.ones(18), "5 or more readings that differ, found all 1"),
        (WEIGHTS[:4], WEIGHTS[:4], "5 or more loads that differ, found 4 of them"),
        (np.where(WEIGHTS > 14, np.nan, WEIGHTS), WEIGHTS, "load 18 is not finite"),
        (WEIGHTS, WEIGHTS[1:], "reading"),
    ],
)
def test_statics_that_give_no_law_are_refused(load: Array, reading: Array, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        calibrate_statics(Statics(load, reading))
    with pytest.raises(IdentificationError, match="load_unit must be 'N m' or 'N'"):
        calibrate_statics(Statics(WEIGHTS, WEIGHTS, load_unit="kg"))


def test_tables_are_read_in_their_units(tmp_path: Path) -> None:
    path = tmp_path / "weights.csv"
    path.write_text(
        "mass_kg,lever_m,deflection_mrad\n" + "".join(f"{m},0.5,{3 * m}\n" for m in range(6))
    )
    statics = read_statics(path)
    np.testing.assert_allclose(statics.load, 9.80665 * 0.5 * np.arange(6.0))
    np.testing.assert_allclose(statics.reading, 3e-3 * np.arange(6.0))
    assert calibrate_statics(statics).estimate.value("stiffness") == pytest.approx(9.80665 / 6e-3)
    path.write_text(
        "load_N,sensor_mV,direction\n" + "".join(f"{m},{2 * m + 7},1\n" for m in range(6))
    )
    found = calibrate_statics(read_statics(path))
    assert found.estimate.names == ("gain", "zero")
    assert found.estimate.units == ("N/mV", "mV")
    np.testing.assert_allclose(found.estimate.values, [0.5, 7.0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "no log file at"),
        ("", "is empty"),
        ("torque,angle\n1,2\n", "a column of loads and one of readings .*found torque, angle"),
        ("load_Nm,deflection_rad\n1,2\n3,x\n", "line 3: column 'deflection_rad' has 'x'"),
        ("load_Nm,deflection_rad\n1,2\n3\n", "line 3 has 1 cell"),
    ],
)
def test_mistakes_in_a_table_are_named(tmp_path: Path, text: str | None, words: str) -> None:
    """With their line."""
    if text is not None:
        (tmp_path / "weights.csv").write_text(text)
    with pytest.raises(IdentificationError, match=words):
        read_statics(tmp_path / "weights.csv")


def poses_log(offset: float = 0.4, gain: float = 0.8) -> seaid.Log:
    """Return a log of the leg at nine held poses, its knee spring of 40 kN/m as nothing else."""
    robot = leg()
    joint = robot.index("knee_pitch")
    rng = np.random.default_rng(4)
    poses = np.tile(rng.uniform(-0.3, 0.3, robot.n), (9, 1))
    poses[:, joint] = np.linspace(0.1, 1.3, 9)
    moves = [np.linspace(one, two, 50) for one, two in pairwise(poses)]
    parts = [np.tile(poses[0], (100, 1))]
    for move, pose in zip(moves, poses[1:], strict=True):
        parts += [move, np.tile(pose, (100, 1))]
    position = np.concatenate(parts)
    nothing = np.zeros_like(position)
    torque = seaid.regressor.joint_torques(robot, position, nothing, nothing)
    drive = robot.drives["knee_pitch"]
    stretch = torque[:, [joint]] / drive.load_radius / 40e3
    motor = (stretch + drive.load_radius * position) * drive.ratio / drive.motor_radius
    sensed = np.full_like(position, np.nan)
    sensed[:, joint] = torque[:, joint] / gain + offset
    time = np.arange(len(position)) / 100.0
    return seaid.Log(time, robot.joint_names, motor, position, nothing, joint_torque=sensed)


def test_held_poses_calibrate_spring_and_sensor() -> None:
    spring = calibrate_statics(held_poses(leg(), poses_log(), "knee_pitch"))
    assert spring.estimate.units[0] == "N/m"
    assert spring.estimate.value("stiffness") == pytest.approx(40e3, rel=1e-6)
    sensor = calibrate_statics(held_poses(leg(), poses_log(), "knee_pitch", sensor="torque"))
    assert sensor.estimate.names == ("gain", "zero")
    assert sensor.estimate.value("gain") == pytest.approx(0.8, rel=1e-6)
    assert sensor.estimate.value("zero") == pytest.approx(0.4, rel=1e-6)


def test_a_log_without_poses_or_sensor_is_refused() -> None:
    log = poses_log()
    bare = leg().with_values(np.full_like(leg().parameters, np.nan), leg().drives)
    with pytest.raises(IdentificationError, match="has 1 held pose, at least 5 are needed"):
        held_poses(leg(), log.between(0.0, 0.9), "knee_pitch")
    with pytest.raises(IdentificationError, match="joint 'hip_yaw' needs a spring"):
        held_poses(leg(), log, "hip_yaw")
    with pytest.raises(IdentificationError, match="needs a sensor"):
        held_poses(leg(), log, "hip_pitch", sensor="torque")
    with pytest.raises(IdentificationError, match="need the inertial parameters"):
        held_poses(bare, log, "knee_pitch")
