"""What estimated values show: springs between the encoders of slides and of gears."""

from dataclasses import replace

import numpy as np

from seaid.checks.values import gear_findings
from seaid.drives import ParameterName, SeriesElasticDrive
from seaid.estimation import Estimate
from tests.experiments import arm


def with_telescope(stiffness: float | None = None) -> list[str]:
    """Return the joints of the note on an arm whose telescope has a motor without a gear."""
    robot, names = arm(), tuple(map(ParameterName, ("stiffness", "spring_offset")))
    drive = robot.drives["telescope"]
    assert isinstance(drive, SeriesElasticDrive)
    robot = robot.with_drives(
        {"telescope": replace(drive, gear_ratio=1.0, gear_stiffness_Nm_per_rad=stiffness)}
    )
    spring = Estimate(names, np.ones(2), np.eye(2), ("N/m", "N"), 1.0, 1.0)
    found = gear_findings(robot, {"telescope": spring}, (), [{}])
    return [finding.joint for finding in found]


def test_a_screw_without_a_gear_is_in_series_with_its_spring() -> None:
    assert with_telescope() == ["telescope"]


def test_a_screw_of_a_stated_stiffness_needs_no_note() -> None:
    assert with_telescope(300.0) == []
