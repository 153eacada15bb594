"""Several conditions together: what is shared counts once, what is own once a condition."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seaid.errors import IdentificationError
from seaid.identification import Conditions, identify, identify_conditions
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure
from tests.experiments import (
    ELASTIC,
    LEG_SENSORS,
    TEST_MASS,
    arm,
    arm_motion,
    drive_scores,
    leg,
    leg_log,
    leg_motion,
    load_scores,
    perfect_log,
)
from tests.mistakes import with_channels
from tests.representatives import quick_first
from tests.standard_errors import check_scores, scores

pytestmark = pytest.mark.usefixtures("estimates_only")

WARM = 0.4
"""Part of the viscous friction that a warm leg lacks."""


@cache
def together(seed: int = 1) -> Conditions:
    """Return the leg cold with its bare foot, and with a test mass and less friction when warm."""
    cold = measure(leg(), leg_motion(), LEG_SENSORS, seed=seed)
    warm = leg_log(seed + 1)
    friction = [leg().drives[joint].values["viscous_friction"] for joint in leg().joint_names]
    lacking = WARM * np.array(friction) * leg_motion(TEST_MASS).motor_velocity
    warm = replace(warm, motor_torque=warm.motor_torque - lacking)
    bare, loaded = leg().without_nominal(), leg(TEST_MASS).without_nominal()
    own = ("spring_offset", "viscous_friction")
    pairs = {"cold": (bare, cold), "warm": (loaded, warm)}
    return identify_conditions(pairs, condition_specific=own)


@pytest.mark.parametrize("joint", quick_first(ELASTIC))
def test_shared_and_own_parameters_hold_the_truth(joint: str) -> None:
    truth = leg().drives[joint].values
    cold, warmed = (together().identifications[name].drives[joint] for name in ("cold", "warm"))
    for name in ("stiffness", "coulomb_friction"):
        assert cold.value(name) == warmed.value(name)
        assert abs(scores(cold, {name: truth[name]})) < 4
    viscous = "viscous_friction"
    assert abs(scores(cold, {viscous: truth[viscous]})) < 4
    assert abs(scores(warmed, {viscous: (1 - WARM) * truth[viscous]})) < 4
    differences = together().differences
    own = {("viscous_friction", joint) for joint in leg().joint_names}
    own |= {("spring_offset", joint) for joint in ELASTIC}
    assert {*differences} == {f"{name} of {joint}" for name, joint in own}
    assert differences[f"viscous_friction of {joint}"].bic > 0


@pytest.mark.slow  # 60 identifications of two logs
def test_errors_are_as_large_as_the_standard_errors_say() -> None:
    """1.13 is the standard deviation of Student's t with the degrees of freedom of so few rows."""
    drives, loads = [], []
    for seed in range(1, 121, 2):
        cold, warmed = together(seed=seed).identifications.values()
        shared = "stiffness", "coulomb_friction", "viscous_friction"
        own = [
            scores(one, {shared[2]: (1 - WARM) * leg().drives[joint].values[shared[2]]})
            for joint, one in warmed.drives.items()
        ]
        drives.append(np.concatenate([drive_scores(cold, leg(), *shared), *own]))
        loads.append(load_scores(cold, leg()))
    check_scores(drives, 1.13, band=1.2)
    check_scores(loads, band=1.2)


@pytest.mark.slow  # 0.5 s
@pytest.mark.rounding
def test_all_shared_is_one_identification_of_both_logs() -> None:
    logs = [measure(arm(), arm_motion(), Noise(torque_std_Nm=0.003), seed=seed) for seed in (1, 2)]
    robot = arm().without_nominal()
    both = identify(robot, logs, method="two-step")
    apart = identify_conditions(
        {"a": (robot, logs[0]), "b": (robot, logs[1])}, condition_specific=()
    )
    assert not apart.differences
    text = apart.summary()
    assert "2 conditions: shared parameters" in text
    assert "viscous_friction of" in text
    for found in apart.identifications.values():
        np.testing.assert_allclose(found.load_side.values, both.load_side.values, rtol=1e-9)
        np.testing.assert_allclose(found.load_side.covariance, both.load_side.covariance, rtol=1e-6)
        for joint, estimate in both.drives.items():
            np.testing.assert_allclose(found.drives[joint].values, estimate.values, rtol=1e-9)


def test_own_bodies_and_own_friction_of_stiff_drives() -> None:
    robot, log = arm().without_nominal(), perfect_log(arm(), arm_motion())
    stiff = next(j for j in robot.joint_names if j not in robot.elastic_joints)
    friction = f"coulomb_friction of {stiff}"
    apart = identify_conditions(
        {"a": (robot, log), "b": (robot, log)}, condition_specific=("bodies", friction)
    )
    found = list(apart.identifications.values())
    assert {friction, *found[0].load.names} == set(apart.differences)
    np.testing.assert_allclose(found[0].load.values, found[1].load.values, rtol=1e-6, atol=1e-9)


def without_friction(robot: Robot) -> Robot:
    """Return a robot whose first stiff drive has no friction."""
    joint = next(j for j in robot.joint_names if j not in robot.elastic_joints)
    return robot.with_drives({joint: replace(robot.drives[joint], friction=())})


@pytest.mark.parametrize(
    ("second", "own", "words"),
    [
        (None, (), "at least two conditions, found 1"),
        (arm, ("stifness",), r"condition_specific=: .*did you mean 'stiffness'"),
        (arm, ("stiffness of knee",), "condition_specific=: no joint is named 'knee'"),
        (leg, (), r"'b' hip_yaw, .*: they must be one type of robot"),
        (lambda: without_friction(arm()), (), "conditions need the same sensors and terms"),
    ],
)
def test_conditions_that_cannot_be_are_refused(
    second: Callable[[], Robot] | None, own: tuple[str, ...], words: str
) -> None:
    """The error names the condition, the parameter or the joint."""
    pairs = {"a": (arm(), perfect_log(arm(), arm_motion()))}
    if second is not None:
        log = perfect_log(leg(), leg_motion()) if second is leg else pairs["a"][1]
        pairs["b"] = second(), log
    with pytest.raises(IdentificationError, match=words):
        identify_conditions(pairs, condition_specific=own)


@pytest.mark.findings
@pytest.mark.slow  # identifications of two logs of the leg
def test_a_wrong_set_up_is_named_in_its_condition() -> None:
    bare, loaded = leg().without_nominal(), leg(TEST_MASS).without_nominal()
    good = measure(leg(), leg_motion(), LEG_SENSORS, seed=1)
    bad = with_channels(leg_log(2), "knee_pitch", motor_torque=np.negative)
    both = identify_conditions({"bare": (bare, good), "loaded": (loaded, bad)})
    named = {
        name: [(one.code, one.joint) for one in found.findings if one.severity == "wrong"]
        for name, found in both.identifications.items()
    }
    assert named == {name: [("sign", "knee_pitch")] for name in ("bare", "loaded")}
    messages = {name: one.findings[0].message for name, one in both.identifications.items()}
    assert messages["bare"].startswith("in condition 'loaded', which shares parameters: ")
    assert messages["loaded"].startswith("the motor torque")
    assert not any("good" in one.verdict.sentence for one in both.identifications.values())


@pytest.mark.findings
@pytest.mark.slow  # identifications of two logs of the leg
def test_a_torque_that_the_model_does_not_explain_is_named_in_its_condition() -> None:
    """In one condition the torque of the wrist is that of another part of the motion."""
    robot = arm().without_nominal()
    logs = [measure(arm(), arm_motion(), Noise(torque_std_Nm=0.003), seed=seed) for seed in (0, 1)]
    wrong = with_channels(logs[1], "wrist", motor_torque=lambda x: np.roll(x, len(x) // 3))
    for second, level in ((logs[1], "good"), (wrong, "usable with care")):
        both = identify_conditions({"a": (robot, logs[0]), "b": (robot, second)})
        found = both.identifications
        errors = {name: one.joint_fits["wrist"] for name, one in found.items()}
        named = [one.code for one in found["b"].warnings if one.joint == "wrist"]
        assert found["a"].verdict.level == "good"
        assert found["b"].verdict.level == level
        assert ("no-fit" in named) == (second is wrong)
        unfit = [one for one in found["b"].warnings if one.code == "no-fit"]
        assert all("the payload it had (payload=)" in one.remedy for one in unfit)
        assert (errors["b"].blocks > 3 * errors["a"].blocks) == (second is wrong)
        assert all(one.joint_fits["shoulder"].own < 0.01 for one in found.values())
    assert set(found["b"].setup) == set(robot.joint_names)
