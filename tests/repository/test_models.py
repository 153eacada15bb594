"""The robots of models/: possible bodies, known counts, drives that match their joints."""

from pathlib import Path

import numpy as np
import pytest

from seaid.legged import load_robot
from seaid.regressor import base_parameters
from seaid.robot import is_physical

MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.urdf")), ids=lambda path: path.stem)
def test_every_body_can_exist_and_has_limits(path: Path) -> None:
    robot = load_robot(path)
    assert all(is_physical(body) for body in robot.parameters.reshape(-1, 10))
    assert np.all(np.isfinite(robot.velocity_limits))
    assert np.all(np.isfinite(robot.effort_limits))


def test_tulip_leg_has_the_published_masses_and_drives() -> None:
    leg = load_robot(MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml")
    assert leg.parameters[::10].sum() == pytest.approx(4.293)
    assert leg.elastic_joints == ("hip_pitch", "knee_pitch", "ankle_pitch")


def test_philips_arm_has_45_base_parameters_and_43_upright() -> None:
    """Of bodies, whatever its drives."""
    arm = MODELS / "philips_arm.urdf"
    for gravity, count in (((-9.81, 0.0, 0.0), 45), ((0.0, 0.0, -9.81), 43)):
        for drives in ("philips_arm.toml", "philips_arm_elastic.toml"):
            robot = load_robot(arm, MODELS / drives, gravity=gravity)
            assert len(base_parameters(robot).columns) == count
