"""Mass and centre of mass of a whole legged robot, contacts found from torques, and a biped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import seaid
from scripts.identify_biped import FEET, plant, simulate, standing_plan, write_biped
from seaid.errors import IdentificationError, LogError
from seaid.legged import whole_body
from tests.legged.test_feet import flags, walked
from tests.legged.test_floating_base import STANDING, found_standing, go2


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
def test_contacts_are_found_from_torques_with_bodies_that_are_not_exact() -> None:
    rng, base = np.random.default_rng(2), walked().base
    assert base is not None
    wrong = np.repeat(rng.uniform(0.8, 1.2, len(go2().body_names)), 10)
    robot = go2().with_values(go2().parameters * wrong, go2().drives)
    log = replace(walked(), base=replace(base, contacts={}))
    with pytest.raises(LogError, match="or find it from torques and motion"):
        seaid.reconstruct_motion(robot, log)
    done = seaid.legged.find_contacts(robot, log)
    assert done.log.base is not None
    for foot, flag in flags().items():
        own = done.log.base.contacts[foot] > 0.5
        assert np.mean(own == (flag > 0.5)) > 0.98
        assert done.certainty[foot] > 0.95
    said = [str(one) for one in done.log.report if one.kind == "samples of unclear load"]
    for note, (foot, clear) in zip(said, done.certainty.items(), strict=True):
        assert note.startswith(f"{foot}.contact")
        assert note.endswith(f"from torques and motion, {clear:.1%} of the samples are clear")
    half = replace(log, base=replace(base, contacts={"FL_foot": flags()["FL_foot"]}))
    assert "FL_foot" not in seaid.legged.find_contacts(robot, half).certainty
    held = seaid.load_robot("go2")
    silent = replace(log, motor_torque=np.full_like(log.motor_torque, np.nan))
    for one, given, message in (
        (held, log, "needs a robot with a floating base and contacts="),
        (robot.without_nominal(), log, "the inertial parameters of the robot file"),
        (robot, silent, "needs the torque of each joint"),
    ):
        with pytest.raises(IdentificationError, match=message):
            seaid.legged.find_contacts(one, given)


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
def test_mass_and_center_of_a_walking_robot_have_their_errors() -> None:
    robot = STANDING
    rng = np.random.default_rng(5)
    grouping = seaid.base_parameters(robot, stances=[[]])
    covariance = np.diag(rng.uniform(1e-6, 1e-4, len(grouping.columns)))
    estimate = replace(
        found_standing().load,
        names=grouping.expressions,
        values=grouping.project(robot.parameters),
        units=("1",) * len(grouping.columns),
        covariance=covariance,
        white_standard_errors=None,
        degrees_of_freedom=None,
    )
    identified = replace(found_standing(), base=grouping, load=estimate, motions=())
    values = [one.value for one in whole_body(identified)]
    bodies = robot.parameters.reshape(-1, 10)
    assert values[0] == pytest.approx(bodies[:, 0].sum())
    assert np.all(np.isnan(values[4:]))  # the base shares its mass with the hips
    draws = rng.multivariate_normal(estimate.values, covariance, 4000)
    spread = [
        [one.value for one in whole_body(replace(identified, load=replace(estimate, values=x)))][:4]
        for x in draws[:400]
    ]
    errors = [one.standard_error for one in whole_body(identified)][:4]
    np.testing.assert_allclose(np.std(spread, axis=0), errors, rtol=0.12)


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
