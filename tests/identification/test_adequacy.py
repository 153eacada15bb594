"""What of a log no equation uses is noted; torques that no model explains are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import seaid
from seaid.identification.adequacy import unused_findings
from seaid.log.reading import Log
from seaid.simulation.simulation import measure
from tests.experiments import LEG_SENSORS, leg, leg_motion


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
