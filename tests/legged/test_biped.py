"""Two TULip legs with a trunk: springs and bodies while it hangs and while it stands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import seaid
from scripts.identify_biped import FEET, plant, simulate, standing_plan, write_biped


def test_biped_is_two_legs_and_a_trunk(tmp_path: Path) -> None:
    urdf, toml = write_biped(tmp_path)
    robot = seaid.load_robot(urdf, drives=toml, base="floating", contacts=FEET)
    leg = seaid.load_robot("models/tulip_leg.urdf")
    masses = robot.parameters[::10]
    # the axle of each ankle weighs 45 g, the trunk 3 kg
    assert np.sum(masses) == pytest.approx(2 * (np.sum(leg.parameters[::10]) + 0.045) + 3.0)
    assert len(robot.elastic_joints) == 6
    stance = [[foot.link for foot in FEET]]
    assert len(seaid.base_parameters(robot, stances=stance).columns) == 66


@pytest.mark.slow  # 12 s of MuJoCo in steps of 0.25 ms, and the fit
def test_standing_determines_springs_of_ankles(tmp_path: Path) -> None:
    urdf, toml = write_biped(tmp_path)
    robot = seaid.load_robot(urdf, drives=toml, base="floating", contacts=FEET)
    log = simulate(robot, plant(urdf, robot, False), standing_plan(robot, 12.0, 1), 1)
    found = seaid.identify(robot.without_nominal(), log)
    for side in ("left", "right"):
        joint = f"{side}_ankle_pitch"
        truth = robot.drives[joint].values["stiffness"]
        assert found.drives[joint].value("stiffness") == pytest.approx(truth, rel=0.02)
