"""A slow drift of motor torques: the joints are named, by both methods, and right logs are not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from seaid.checks.values import noise_findings
from seaid.identification import Identification, identify
from seaid.identification.problem import Method
from seaid.simulation.simulation import measure
from tests.experiments import LEG_SENSORS, TEST_MASS, leg, leg_motion
from tests.representatives import quick_first

DRIFTING = ("hip_yaw", "knee_pitch")


def found(trend_Nm: float, method: Method = "two-step") -> Identification:
    """Return the identification of the leg whose torques of two joints have a linear trend."""
    robot = leg(TEST_MASS)
    log = measure(robot, leg_motion(TEST_MASS), LEG_SENSORS, 5)
    ramp = np.linspace(-trend_Nm, trend_Nm, len(log.time))[:, None]
    drifts = np.array([joint in DRIFTING for joint in log.joint_names])
    log = replace(log, motor_torque=log.motor_torque + ramp * drifts)
    return identify(robot.without_nominal(), log, method=method)


@pytest.mark.slow  # 0.7 s
@pytest.mark.parametrize("method", quick_first(["two-step", "simultaneous"]))
def test_the_drifting_joints_are_named_and_have_its_errors(method: Method) -> None:
    drifting, steady = found(2e-3, method), found(0.0, method)
    assert {one.joint for one in drifting.warnings if one.code == "drift"} == set(DRIFTING)
    assert not any(one.code == "drift" for one in steady.warnings)
    for joint in (*DRIFTING, "hip_pitch") if method == "two-step" else ():
        ratio = drifting.drives[joint].standard_errors / steady.drives[joint].standard_errors
        friction = ratio[drifting.drives[joint].names.index("coulomb_friction")]
        assert friction > 1.5 if joint in DRIFTING else friction == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize(("share", "severity"), [(0.004, "note"), (0.02, "doubtful")])
def test_a_drift_of_a_small_part_of_the_torque_is_a_note(share: float, severity: str) -> None:
    """It is in the standard errors; what explains it is no more severe."""
    drift = SimpleNamespace(joint="knee", ratio=100.0, share=share, corner_hz=2.3)
    numbers = {"independent_rows": 100, "parameters": 1, "scatter": 1.0, "instruments": {}}
    diagnostics = SimpleNamespace(**numbers, growth=8.0, drifts=(drift,))
    (finding,) = noise_findings(SimpleNamespace(diagnostics=diagnostics))  # type: ignore[arg-type]
    assert (finding.code, finding.severity) == ("drift", severity)
