"""What of a log no equation uses is noted; torques that no model explains are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import seaid
from seaid.identification.adequacy import unused_findings
from seaid.log.reading import Log
from seaid.simulation.simulation import measure
from tests.experiments import LEG_SENSORS, TEST_MASS, leg, leg_motion, true_value


def leg_log(seed: int = 1) -> Log:
    return measure(leg(), leg_motion(), LEG_SENSORS, seed)


def with_sensed_torque(joint: str, *, only: bool) -> Log:
    """Return the leg's log with the measured torque of a joint too, or `only` with this."""
    log, motion, index = leg_log(), leg_motion(), leg().index(joint)
    sensed, motor = np.full_like(log.joint_position, np.nan), log.motor_torque.copy()
    noise = 0.1 * np.random.default_rng(0).normal(size=len(log.time))
    sensed[:, index] = motion.joint_torque[:, leg().index("knee_pitch")] + noise
    if only:
        motor[:, index] = np.nan
    return replace(log, joint_torque=sensed, motor_torque=motor)


def test_friction_that_a_log_cannot_identify_is_said() -> None:
    found = seaid.identify(leg(), with_sensed_torque("knee_pitch", only=True))
    assert [str(one) for one in unused_findings(found)] == [
        "the log has the joint torque of knee_pitch and not its motor torque, which alone would "
        "identify viscous friction, coulomb friction"
    ]
    assert set(unused_findings(found)) < set(found.warnings)
    assert found.drives["knee_pitch"].names == ("stiffness", "spring_offset")


def test_a_channel_in_no_equation_is_said() -> None:
    assert unused_findings(seaid.identify(leg(), leg_log())) == ()
    assert (
        unused_findings(seaid.identify(leg(), with_sensed_torque("knee_pitch", only=False))) == ()
    )
    log = with_sensed_torque("hip_roll", only=False)
    log = replace(log, motor_current=20.0 * log.motor_torque)
    names = "hip_yaw, hip_roll, hip_pitch, knee_pitch, ankle_pitch"
    findings = unused_findings(seaid.identify(leg(), log))
    assert [(one.code, one.joint, str(one)) for one in findings] == [
        ("unused-channel", "", f"the motor current of {names} is in the log and in no equation"),
        (
            "unused-channel",
            "hip_roll",
            "the joint torque of hip_roll is in the log and in no equation",
        ),
    ]


def test_torques_that_are_noise_are_named() -> None:
    log = leg_log()
    noise = np.random.default_rng(0).normal(size=len(log.time))
    torque = log.motor_torque.copy()
    torque[:, 1] = np.std(torque[:, 1]) * noise
    found = seaid.identify(leg(), replace(log, motor_torque=torque))
    assert [(one.joint, one.severity) for one in found.warnings if one.code == "no-fit"] == [
        ("hip_roll", "wrong")
    ]
    assert found.joint_fits["hip_roll"].blocks > 0.9
    assert found.verdict.level == "do not use"


def pushed_log(*joints: str, size: float = 3.0) -> Log:
    """Return the log of a leg that hands push at the links of some joints all the time.

    The pushes are waves of `size` times the standard deviation of the torque of the joint.
    The spring carries the push too, with the angle, inertia and friction of the motor by (4), (7).
    """
    motion = leg_motion(TEST_MASS)
    motor, torque = motion.motor_position.copy(), motion.motor_torque.copy()
    for place, joint in enumerate(joints):
        j, drive = leg().index(joint), leg().drives[joint]
        waves = [np.sin(2 * np.pi * hz * motion.time + 5 * hz + place) for hz in (0.7, 1.1, 1.9)]
        push = size * np.std(motion.joint_torque[:, j]) * np.sum(waves, axis=0)
        gear = drive.motor_radius / drive.ratio
        angle = push / (gear * drive.values["stiffness"] * drive.load_radius)
        speed = np.gradient(angle, motion.time)
        before, after = motion.motor_velocity[:, j], motion.motor_velocity[:, j] + speed
        motor[:, j] += angle
        torque[:, j] += (
            drive.values["motor_inertia"] * np.gradient(speed, motion.time)
            + drive.values["viscous_friction"] * speed
            + drive.values["coulomb_friction"] * (np.sign(after) - np.sign(before))
            + gear / drive.load_radius * push
        )
    pushed = replace(motion, motor_position=motor, motor_torque=torque)
    return measure(leg(TEST_MASS), pushed, LEG_SENSORS, 1)


def test_a_load_side_that_hands_move_is_not_to_be_used_and_its_drive_is_good() -> None:
    found = seaid.identify(leg(TEST_MASS), pushed_log("knee_pitch"))
    knee = found.drives["knee_pitch"]
    assert knee.value("stiffness") == pytest.approx(
        true_value(leg(), "knee_pitch", "stiffness"), abs=4 * knee.standard_error("stiffness")
    )
    (finding,) = [one for one in found.warnings if one.code == "no-fit"]
    assert (finding.joint, finding.severity) == ("knee_pitch", "wrong")
    assert "; its motor equation holds, with an error of " in finding.message
    sentence = "do not use the load side of knee_pitch: no-fit; the drive of knee_pitch is good"
    assert (found.verdict.level, found.verdict.sentence) == ("do not use", sentence)
    assert found.to_dict()["verdict"]["sentence"] == sentence
    assert sentence in found.summary()


def test_a_torque_of_which_much_is_unexplained_is_doubtful() -> None:
    found = seaid.identify(leg(TEST_MASS), pushed_log("knee_pitch", size=0.4))
    (finding,) = [one for one in found.warnings if one.code == "no-fit"]
    assert (finding.joint, finding.severity) == ("knee_pitch", "doubtful")
    fit = found.joint_fits["knee_pitch"]
    assert 0.5 < fit.own < fit.blocks < 0.9
    assert f"unexplained: {fit.own:.0%} of it in the own logs" in finding.message
    assert "a spring, the gear ratio or the rotor inertia" in finding.remedy
    assert found.verdict.level == "good but"


def test_a_contact_is_named_with_its_time() -> None:
    log = leg_log()
    torque = log.motor_torque.copy()
    touched = (log.time > 2.0) & (log.time < 2.6)
    torque[touched, 0] += 0.5 * np.ptp(torque[:, 0])
    found = seaid.identify(leg(), replace(log, motor_torque=torque))
    (contact,) = [one for one in found.warnings if one.code == "contact"]
    assert contact.joint == "hip_yaw"
    assert 1.5 <= contact.evidence["start [s]"] <= 2.1
    assert 2.5 <= contact.evidence["end [s]"] <= 3.1
    assert "exclude_s = [[" in contact.remedy


def test_a_contact_that_pulls_the_fit_is_named_all_the_same() -> None:
    log = leg_log()
    size = 0.1 * np.ptp(log.motor_torque[:, :2], axis=0)
    bump = np.where(np.abs(log.time - 3.0) < 0.5, np.cos(np.pi * (log.time - 3.0)) ** 2, 0.0)
    torque = log.motor_torque.copy()
    torque[:, :2] += size * bump[:, None]
    found = seaid.identify(leg(), replace(log, motor_torque=torque))
    (contact,) = [one for one in found.warnings if one.code == "contact"]
    assert 2.2 <= contact.evidence["start [s]"] < 3.0 < contact.evidence["end [s]"] <= 3.8


def test_a_log_too_short_for_its_parameters_is_named() -> None:
    log = leg_log()
    found = seaid.identify(leg(), log.between(2.0, 3.0))
    (few,) = [one for one in found.warnings if one.code == "few-rows"]
    assert few.severity == "doubtful"
    assert few.evidence["error of excluded blocks over that of the own logs"] > 2.3
