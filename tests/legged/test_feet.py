"""Mistakes in the base and the contacts of a legged robot's log, and its mass as a whole."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import seaid
from scripts.benchmarks.legged import noisy
from scripts.legged_plant import GO2_FEET, foot_positions, plant, simulate
from seaid._arrays import Array
from seaid.checks.engine import observed
from seaid.drives import ParameterName
from seaid.errors import Finding, IdentificationError, LogError, SeaidError
from seaid.identification.result import extension_of
from seaid.legged import whole_body, with_leg_order
from seaid.legged.base import turned_to_world
from seaid.legged.feet import MOTION_CHECKS, FeetInMotion, foot_places
from seaid.legged.floating import contact_map
from seaid.log import BaseLog, Description, LogDescription
from seaid.log.base_log import moving_base
from seaid.log.describe.inference import Doubt
from seaid.log.description import Source
from tests.legged.test_base import STANDING, base_of, found_standing, go2, with_base
from tests.plants import kept


def log_findings(
    robot: seaid.Robot, logs: list[seaid.Log], motions: list[list[seaid.Motion]]
) -> list[Finding]:
    """Return what contradicts itself in the base and the feet of logs."""
    return [*extension_of(robot).log_findings(robot, logs, motions)]


@kept
def walked() -> seaid.Log:
    return noisy(simulate(go2(), plant(go2(), 0.001, soft=True), 16.0, seed=11), 3)


@cache
def pose() -> Array:
    """Positions of the base, whose left front foot stands on the ground."""
    orientation = base_of(walked()).orientation
    assert orientation is not None
    foot = foot_positions(go2(), walked().joint_position)[:, 3]
    return -turned_to_world(orientation, foot)


def found(**changed: Any) -> list[Finding]:
    log = with_base(walked(), **changed)
    motion = seaid.reconstruct_motion(go2(), log, cutoff_hz=10.0)
    return log_findings(go2(), [log], [[motion]])


def flags() -> dict[str, Array]:
    return {foot: np.array(values) for foot, values in base_of(walked()).contacts.items()}


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
def test_a_right_log_has_no_findings() -> None:
    assert found() == []
    orientation = base_of(walked()).orientation
    assert orientation is not None
    assert found(orientation=-np.array(orientation)) == []  # the same rotation


@pytest.mark.slow  # 4.4 s
def test_exchanged_flags_are_named_with_their_columns() -> None:
    own, (one, other) = flags(), (GO2_FEET[0], GO2_FEET[3])
    (finding,) = found(contacts={**own, one: own[other], other: own[one]})
    assert (finding.code, finding.severity) == ("contact-flags", "wrong")
    for link, column in ((one, other), (other, one)):
        assert f'[contacts.{link}]\ncontact = "{column}.contact"' in finding.remedy


def lost_for_two_seconds(own: Array) -> Array:
    return np.where(np.arange(len(own)) // 500 == 2, 0.0, own[:, 0])[:, None]


WRONG_FLAGS: dict[str, tuple[Callable[[Array], Array], str, str, float]] = {
    "stands in the air": (np.ones_like, "doubtful", "speed [m/s]", 0.08),
    "rests while flagged in the air": (lost_for_two_seconds, "", "longest rest [s]", 0.3),
    "never stands": (np.zeros_like, "wrong", "share", 0.5),
}
"""{what is wrong with a foot: its flags, the severity, and an evidence with the least of it}."""


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
@pytest.mark.parametrize("what", WRONG_FLAGS)
def test_wrong_flags_of_a_foot_are_named(what: str) -> None:
    change, severity, key, least = WRONG_FLAGS[what]
    (finding,) = found(contacts={**flags(), "FR_foot": change(flags()["FR_foot"])})
    assert (finding.code, finding.joint) == ("contact-flags", "FR_foot")
    assert finding.severity == (severity or finding.severity)
    assert finding.evidence[key] > least


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
def test_a_foot_that_is_hardly_in_the_air_is_named_with_the_time_it_needs() -> None:
    brief = np.ones_like(flags()["FR_foot"])
    brief[1000:1020] = brief[2000:2030] = 0
    for end, is_named in ((2030, True), (2060, False)):
        brief[2000:end] = 0
        notes = found(contacts={**flags(), "FR_foot": brief})
        named = [one for one in notes if one.code == "unidentifiable" and one.joint == "FR_foot"]
        assert len(named) == is_named
        if named:
            assert "is in the air for 0.2 s in all, in 2 lifts" in str(named[0])
            assert "at least 0.13 s at a time" in named[0].remedy  # 6.5 periods of 50 Hz


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
def test_a_foot_that_slides_is_a_note() -> None:
    slide = np.where((walked().time > 6) & (walked().time < 8), 0.3, 0.0)
    moved = pose() + np.cumsum(np.outer(slide, [1, 0, 0]), axis=0) / 250
    slips = [one for one in found(position=moved) if "slips" in str(one)]
    assert {one.severity for one in slips} == {"note"}


FRAMES: dict[str, Callable[[Any], dict[str, Any]]] = {
    "x, y, z, w": lambda base: {"orientation": np.roll(base.orientation, -1, axis=1)},
    "w, x, y, z": lambda base: {"orientation": np.roll(base.orientation, 1, axis=1)},
    "from the world to the base": lambda base: {"orientation": base.orientation * [1, -1, -1, -1]},
    'frame = "world"': lambda base: {
        "angular_velocity": turned_to_world(base.orientation, base.angular_velocity)
    },
    "in degrees per second": lambda base: {"angular_velocity": np.degrees(base.angular_velocity)},
    "points downwards": lambda base: {"specific_force": -base.specific_force},
    "the y axis of the angular velocity of the base is 0 all the time": lambda base: {
        "angular_velocity": base.angular_velocity * [1, 0, 1] + 0.0
    },
}

UNITS: dict[str, Callable[[Any], dict[str, Any]]] = {
    "it is in g": lambda base: {"specific_force": base.specific_force / 9.81},
    "took gravity out": lambda base: {
        "specific_force": base.specific_force
        - turned_to_world(base.orientation, np.tile([0, 0, 9.81], (len(pose()), 1)), back=True)
    },
    # before the error that follows from it
    "base-sensor: the z axis of the angular velocity of the base is 0 all the": lambda base: {
        "angular_velocity": base.angular_velocity * [1, 1, 0],
        "specific_force": base.specific_force * [1, 0, 1],
    },
}


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
@pytest.mark.parametrize("text", FRAMES)
def test_wrong_frames_and_sensors_are_named(text: str) -> None:
    (finding,) = found(**FRAMES[text](base_of(walked())))
    assert finding.severity == "wrong"
    assert text in str(finding)
    assert finding.remedy


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
@pytest.mark.parametrize("text", UNITS)
def test_sensors_in_another_unit_or_without_axes_are_refused(text: str) -> None:
    log = with_base(walked(), **UNITS[text](base_of(walked())))
    with pytest.raises(SeaidError, match=text):
        seaid.identify(go2(), log, cutoff_hz=5.0)


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
def test_jumps_of_a_pose_are_taken_out() -> None:
    jumped = pose().copy()
    jumped[1200:] += [0.08, 0.0, 0.02]
    jumped[2500:] -= [0.0, 0.05, 0.0]
    motions = []
    for position in (pose(), jumped):
        base = base_of(walked())
        estimated = BaseLog(position=position, orientation=base.orientation, contacts=base.contacts)
        changed = replace(walked(), base=estimated)
        motions.append(seaid.reconstruct_motion(go2(), changed, cutoff_hz=6.0).base)
    right, repaired = motions
    assert right is not None
    assert repaired is not None
    kept = repaired.used
    assert right.used.sum() > kept.sum() > 0.9 * right.used.sum()
    np.testing.assert_allclose(repaired.specific_force[kept], right.specific_force[kept], atol=0.2)
    jumps = (x for x in log_findings(go2(), [changed], []) if x.code == "base-jumps")
    finding = next(x for x in jumps if "position" in str(x))
    assert finding.evidence["jumps"] == 2
    assert finding.evidence["largest"] == pytest.approx(0.0825, rel=0.05)


LEGS = ("FL", "FR", "RL", "RR")


def test_places_of_contacts_are_those_of_forward_kinematics() -> None:
    q = np.random.default_rng(1).normal(size=(5, 12))
    own = foot_places(go2(), q, GO2_FEET)
    np.testing.assert_allclose(own, foot_positions(go2(), q), atol=1e-12)


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
@pytest.mark.parametrize(
    ("order", "flags_too"),
    [
        (("FR", "FL", "RR", "RL"), True),
        (("FR", "FL", "RR", "RL"), False),
        (("FL", "FR", "RR", "RL"), False),
        (("RR", "RL", "FL", "FR"), True),
    ],
)
def test_exchanged_legs_are_named_by_their_columns(order: tuple[str, ...], flags_too: bool) -> None:
    """The motors of many quadrupeds are numbered in another order than the joints of the URDF."""
    log, robot = walked(), go2()
    of = dict(zip(LEGS, order, strict=True))
    columns = [robot.index(f"{of[name[:2]]}{name[2:]}") for name in robot.joint_names]
    sources = {leg: of[leg] if flags_too else leg for leg in LEGS}
    swapped = replace(
        with_base(log, contacts={f"{x}_foot": flags()[f"{y}_foot"] for x, y in sources.items()}),
        joint_position=log.joint_position[:, columns],
        motor_torque=log.motor_torque[:, columns],
    )
    motion = seaid.reconstruct_motion(robot, swapped, cutoff_hz=10.0)
    legs_found, *flags_found = log_findings(robot, [swapped], [[motion]])
    assert (legs_found.code, legs_found.severity) == ("swapped-joints", "wrong")
    moved = [leg for leg in LEGS if of[leg] != leg]
    for leg in moved:
        source = next(one for one in LEGS if of[one] == leg)
        lines = f'[joints.{leg}_calf_joint]\njoint_position = "{source}_calf_joint.joint_position_'
        assert lines in legs_found.remedy
        assert f'motor_torque = "{source}_calf_joint.motor_torque_Nm"' in legs_found.remedy
    assert legs_found.remedy.count("[joints.") == 3 * len(moved)
    assert [one.code for one in flags_found] == ["contact-flags"] * flags_too
    assert all(one.remedy.count("[contacts.") == len(moved) for one in flags_found)


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
def test_joints_in_groups_and_exchanged_flags_are_put_in_order() -> None:
    """Logs of simulators have the hips of all legs first; those of Unitree the right legs."""
    log, robot = walked(), go2()
    grouped = np.arange(12).reshape(4, 3)[[1, 0, 3, 2]].T.ravel()
    flags_of = dict(zip(GO2_FEET, (GO2_FEET[k] for k in (1, 0, 3, 2)), strict=True))
    given = replace(
        with_base(log, contacts={foot: flags()[source] for foot, source in flags_of.items()}),
        joint_position=log.joint_position[:, grouped],
        motor_torque=log.motor_torque[:, grouped],
    )
    joints = {
        name: {
            "joint_position": Source((f"q[{k}]",)),
            "motor_torque": Source((f"t[{k}]",), side="joint"),
        }
        for k, name in enumerate(robot.joint_names)
    }
    columns = {foot: Source((f"contact[{k}]",)) for k, foot in enumerate(GO2_FEET)}
    contacts = {foot: {"contact": source} for foot, source in columns.items()}
    plain = Description(LogDescription(joints, None, contacts=contacts), (Doubt("q: a guess"),), ())
    ordered = with_leg_order(plain, robot, given)
    for k, name in enumerate(robot.joint_names):
        column = f"q[{grouped.tolist().index(k)}]"
        assert ordered.description.joints[name]["joint_position"].column == column
    for foot, flag in flags_of.items():
        assert ordered.description.contacts[foot]["contact"].columns == columns[flag].columns
    assert "in the order in which standing feet rest" in ordered.unsure[0]
    assert with_leg_order(plain, robot, log) is plain


@pytest.mark.slow  # 16 s of MuJoCo with contacts, and checks of a floating base
@pytest.mark.parametrize(("late_s", "word"), [(0.08, "late"), (-0.06, "early"), (0.0, "")])
@pytest.mark.parametrize("places", [range(4), [2]])
def test_late_flags_have_their_delay(late_s: float, word: str, places: Sequence[int]) -> None:
    """Feet that trot: they stand for 60 % of each period, and move with 0.5 m/s else."""
    robot = go2()
    motion = seaid.reconstruct_motion(robot, walked(), cutoff_hz=10.0)
    assert motion.base is not None
    time, size = motion.time, (len(motion.time), 4)
    phase = (time[:, None] / 0.6 + [0.0, 0.5, 0.5, 0.0]) % 1
    feet = np.zeros((*size, 3))
    feet[:, :, 0] = 0.5 * (phase > 0.6) + 0.01 * np.random.default_rng(0).normal(size=size)
    J = contact_map(robot, motion.joint_position, moving_base(robot).contacts, motion.base.up)
    v = np.linalg.solve(J[:, 6:].swapaxes(1, 2), feet.reshape(size[0], -1, 1))[:, :, 0]
    late = phase <= 0.6
    late[:, places] = np.roll(late[:, places], round(late_s * motion.rate_hz), axis=0)
    still = replace(
        motion.base,
        velocity=np.zeros((size[0], 3)),
        angular_velocity=np.zeros((size[0], 3)),
        contacts=dict(zip(GO2_FEET, late.T, strict=True)),
        used=np.ones(size[0], dtype=bool),
    )
    described = {foot: {"contact": {"columns": f"flag[{k}]"}} for k, foot in enumerate(GO2_FEET)}
    log = replace(walked(), description={"contacts": described})
    moves = replace(motion, joint_velocity=np.asarray(v, dtype=float), base=still)
    feet_of = FeetInMotion(robot, moves, [log])
    np.testing.assert_allclose(feet_of.velocities, feet, atol=1e-9)
    findings = [one for one in observed(MOTION_CHECKS, feet_of) if one.severity == "wrong"]
    assert [one.code for one in findings] == ["contact-flags"] * bool(word)
    for finding in findings:
        delay_s = finding.evidence["delay [s]"]
        assert delay_s == pytest.approx(late_s, abs=0.011)
        assert f" {word} by about" in finding.message
        assert finding.remedy.count("delay_s") == len(places)
        line = f'{{ columns = "flag[{places[0]}]", delay_s = {round(delay_s, 3)} }}'
        assert f"contact = {line}" in finding.remedy


# The whole robot, and contacts that no flags name


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
        names=ParameterName.all_of(grouping.expressions),
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
