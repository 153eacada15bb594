"""Drives that move several joints, and linkages, by Pinocchio's torques and written equations."""

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.drives import Drive, SeriesElasticDrive, StiffDrive, total_ratio
from seaid.errors import ExcitationError, IdentificationError, LogError, RobotError, SeaidError
from seaid.estimation.least_squares import ordinary
from seaid.excitation import design_excitation
from seaid.excitation.observation_matrix import load_target
from seaid.export import write_mjcf, write_model
from seaid.frequency.linear_joints import linearised
from seaid.identification import Identification, check, identify, refine, validate
from seaid.identification.problem import Method
from seaid.identification.validation import _actuator
from seaid.legged import load_robot
from seaid.log import Log, Motion, reconstruct_motion
from seaid.log.sources import both_sides
from seaid.regressor import actuator_regression, base_parameters, joint_torques, load_regression
from seaid.regressor.base import torque_slopes
from seaid.regressor.exact.equations import complete_model
from seaid.regressor.load import LoadModel, load_model, offset_sensitivity
from seaid.robot import Robot, at_drives, at_joints, torques_at_drives, torques_at_joints
from seaid.robot.transmission import rows_at_drives
from seaid.simulation import replay
from tests.experiments import (
    DATA,
    MODELS,
    drive_errors,
    motion_of,
)
from tests.plants import torque_slopes_by_steps
from tests.regressor.stances import check_base, rows_of_torques
from tests.representatives import quick_first

DRIVE = ("viscous_friction", "coulomb_friction", "stiffness")
WRIST = MODELS / "differential_wrist.urdf"
JOINTS = ("elbow", "wrist_pitch", "wrist_roll")
States = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Case:
    """A robot, its matrix as a literal, and whether the linkages below are at its joints."""

    robot: Robot
    C: Array
    reach: float = 0.8
    has_linkages: bool = False

    @property
    def drives(self) -> list[Drive]:
        return list(self.robot.drives.values())

    def driven(self, q: Array) -> Array:
        """Return the angles phi (T, n) that the drives turn."""
        zero = np.zeros_like(q)
        return (linkages(q, zero, zero)[0] if self.has_linkages else q) @ self.C.T

    def torques_at_drives(self, q: Array, tau: Array) -> Array:
        """Return the torques tau_phi (T, n) of the same power as tau at the joints."""
        slopes = linkages(q, np.ones_like(q), 0 * q)[1] if self.has_linkages else 1.0
        return np.asarray(np.linalg.solve(self.C.T, (tau / slopes).T).T)


CURVE = 0.25, 0.3
"""The linkages: dg/dq = 1 + 0.25 cos(q + 0.3) at the elbow, and 1 + 0.25 sin(2 q + 0.3)."""


def linkages(q: Array, v: Array, a: Array) -> States:
    """Return the angles g(q) (T, n) behind the gears, zero where q is, and their derivatives."""
    (size, phase), (first, second) = CURVE, q[:, :2].T
    phi, slope, curvature = q.copy(), np.ones_like(q), np.zeros_like(q)
    phi[:, 0] += size * (np.sin(first + phase) - np.sin(phase))
    slope[:, 0] += size * np.cos(first + phase)
    curvature[:, 0] = -size * np.sin(first + phase)
    phi[:, 1] -= size / 2 * (np.cos(2 * second + phase) - np.cos(phase))
    slope[:, 1] += size * np.sin(2 * second + phase)
    curvature[:, 1] = 2 * size * np.cos(2 * second + phase)
    return phi, slope * v, slope * a + curvature * v**2


def stiff(number: int = 0, **options: Any) -> StiffDrive:
    """Return a stiff drive; `number` makes it differ from others."""
    return StiffDrive(
        gear_ratio=50.0 + 10 * number,
        motor_inertia_kg_m2=1e-5 * (1 + number),
        viscous_friction_Nms_per_rad=2e-4 * (1 + 0.3 * number),
        coulomb_friction_Nm=0.01 * (1 + 0.2 * number),
        **options,
    )


def elastic(number: int = 0, **options: Any) -> SeriesElasticDrive:
    """Return a drive with a rotary spring; `number` makes it differ from others."""
    return SeriesElasticDrive(
        gear_ratio=80.0 + 10 * number,
        motor_inertia_kg_m2=4e-6,
        stiffness_Nm_per_rad=200.0 + 60 * number,
        viscous_friction_Nms_per_rad=8e-5,
        coulomb_friction_Nm=0.006,
        **options,
    )


def differential(*drives: Drive) -> Case:
    """Return the differential wrist: sum and difference of both angles."""
    rows: tuple[dict[str, float], ...] = (
        {},
        {JOINTS[1]: 1, JOINTS[2]: 1},
        {JOINTS[1]: 1, JOINTS[2]: -1},
    )
    coupled = {
        joint: replace(drive, transmission=row)
        for joint, drive, row in zip(JOINTS, drives, rows, strict=True)
    }
    return Case(load_robot(WRIST, coupled), np.array([[1.0, 0, 0], [0, 1, 1], [0, 1, -1]]))


def compensated_differential() -> Case:
    """Return a differential with springs between the bodies of two joints, beside the drives."""
    beside: dict[str, Any] = {"parallel_spring": ("linear",)}
    second = elastic(1, nominal={"parallel_stiffness": 4.0}, **beside)
    return differential(stiff(), second, stiff(2, nominal={"parallel_stiffness": -1.5}, **beside))


def parallelogram() -> Case:
    """Return the elastic HEBI-like planar arm whose second motor stands at the base: q1 + q2."""
    path = MODELS / "hebi_arm_2.urdf"
    first, second = load_robot(path).joint_names
    drives = {first: stiff(), second: elastic(1, transmission={first: 1.0, second: 1.0})}
    return Case(load_robot(path, drives), np.array([[1.0, 0], [1, 1]]))


def sliding() -> Case:
    """Return the mixed arm with a rail and a wrist, a shoulder and a telescope that are coupled.

    Factors of a turning drive on a slide are in rad/m, those of a sliding one on a turn in m/rad.
    """
    drives = load_robot(DATA / "mixed_arm.urdf", DATA / "mixed_arm.toml").drives
    rows: dict[str, dict[str, float]] = {
        "rail": {"rail": 1.0, "wrist": 0.1},
        "shoulder": {"shoulder": 1.0, "telescope": 2.0},
        "telescope": {"shoulder": -0.05, "telescope": 1.0},
        "wrist": {"wrist": 1.0},
    }
    coupled = {name: replace(drives[name], transmission=row) for name, row in rows.items()}
    C = np.array([[1, 0, 0, 0.1], [0, 1, 2, 0], [0, -0.05, 1, 0], [0, 0, 0, 1.0]])
    return Case(load_robot(DATA / "mixed_arm.urdf", coupled), C, 0.25)


def with_linkages() -> Case:
    """Return an arm with linkages at an elastic and at a stiff drive."""
    size, phase = CURVE
    c, s = size * np.cos(phase), size * np.sin(phase)
    drives = {
        "elbow": elastic(angle_ratio={"cos": [c], "sin": [-s]}),
        "wrist_pitch": stiff(1, angle_ratio={"cos": [0.0, s], "sin": [0.0, c]}),
        "wrist_roll": elastic(2),
    }
    return Case(load_robot(WRIST, drives), np.eye(3), has_linkages=True)


CASES: dict[str, Callable[[], Case]] = {
    "stiff differential": lambda: differential(stiff(), stiff(1), stiff(2)),
    "elastic differential": lambda: differential(elastic(), elastic(1), elastic(2)),
    "mixed differential": lambda: differential(stiff(), elastic(1), stiff(2)),
    "compensated differential": compensated_differential,
    "parallelogram": parallelogram,
    "sliding": sliding,
    "linkages": with_linkages,
}


@cache
def case_of(name: str) -> Case:
    return CASES[name]()


@pytest.fixture(params=list(CASES))
def case(request: pytest.FixtureRequest) -> Case:
    return case_of(request.param)


def waves(n: int, time: Array, reach: float, seed: int) -> States:
    """Return q, v and a (T, n): sums of four sines a joint, below 1.6 Hz."""
    rng = np.random.default_rng(seed)
    w = 2 * np.pi * rng.uniform(0.15, 1.6, (4, n))
    amplitude = reach * rng.uniform(0.2, 0.5, (4, n)) / (1 + 0.15 * w)
    angle = w * time[:, None, None] + rng.uniform(-np.pi, np.pi, (4, n))
    q, v, a = amplitude * np.sin(angle), amplitude * w * np.cos(angle), amplitude * w**2
    return q.sum(axis=1), v.sum(axis=1), (-a * np.sin(angle)).sum(axis=1)


def rnea(robot: Robot, states: States) -> Array:
    """Return the joint torques (T, n); the model has the joints in the robot's order."""
    assert list(robot.model_order) == list(range(robot.n))
    data = robot.model.createData()
    return np.array([pin.rnea(robot.model, data, *state) for state in zip(*states, strict=True)])


def motor_angles(case: Case, states: States) -> tuple[Array, Array]:
    """Return the motors' angles and the torques tau_phi (T, n), by (3) and (4b)."""
    tau = rnea(case.robot, states)
    tau += states[0] * [drive.values.get("parallel_stiffness", 0.0) for drive in case.drives]
    tau_phi = case.torques_at_drives(states[0], tau)
    angle = case.driven(states[0])
    for i, drive in enumerate(case.drives):
        if isinstance(drive, SeriesElasticDrive):
            stretch = tau_phi[:, i] / drive.load_radius / drive.values["stiffness"]
            angle[:, i] = (stretch + drive.load_radius * angle[:, i]) / drive.motor_radius
    return angle * [drive.ratio for drive in case.drives], tau_phi


@cache
def true_motion(case: Case, seed: int = 0, duration: float = 8.0) -> Motion:
    """Return the exact motion at 500 Hz: torques by (7) with the motors' own derivatives.

    Its joint states are those behind the linkages, where there are any.
    """
    robot, step = case.robot, 1e-3
    time = np.arange(round(500 * duration)) / 500
    states = waves(robot.n, time, case.reach, seed)
    before, (now, tau_phi), after = (
        motor_angles(case, waves(robot.n, time - step, case.reach, seed))[0],
        motor_angles(case, states),
        motor_angles(case, waves(robot.n, time + step, case.reach, seed))[0],
    )
    speed, acceleration = (after - before) / (2 * step), (after - 2 * now + before) / step**2
    torque = np.empty_like(now)
    for i, drive in enumerate(case.drives):
        lever, values = drive.motor_radius / drive.load_radius, drive.values
        torque[:, i] = values["motor_inertia"] * acceleration[:, i]
        torque[:, i] += values["viscous_friction"] * speed[:, i]
        torque[:, i] += values["coulomb_friction"] * np.sign(speed[:, i])
        torque[:, i] += lever * tau_phi[:, i] / drive.ratio
    behind = linkages(*states) if case.has_linkages else states
    return motion_of(robot, time, behind, (now, speed, acceleration), torque)


def log_of(
    case: Case,
    seed: int = 0,
    duration: float = 8.0,
    *,
    torque: float = 0.0,
    angle: float = 0.0,
    draw: int = 0,
) -> Log:
    """Return the log of a motion; noise of torques [N m] and of joint and motor angles [rad]."""
    motion, rng = true_motion(case, seed, duration), np.random.default_rng(draw)
    q = waves(case.robot.n, motion.time, case.reach, seed)[0]
    return Log(
        time=motion.time,
        joint_names=motion.joint_names,
        motor_position=motion.motor_position + 20 * angle * rng.normal(size=q.shape),
        joint_position=q + angle * rng.normal(size=q.shape),
        motor_torque=motion.motor_torque + torque * rng.normal(size=q.shape),
    )


def without(log: Log, field: str, *columns: int) -> Log:
    """Return a log in which some columns of a field are not measured."""
    values = getattr(log, field).copy()
    values[:, columns] = np.nan
    return replace(log, **{field: values})


def load_errors(case: Case, found: Identification) -> tuple[Array, float]:
    """Return the errors of the base parameters, and the largest true one."""
    true = found.base.project(case.robot.parameters)
    places = [found.load.names.index(name) for name in found.base.expressions]
    return found.load.values[places] - true, float(np.max(np.abs(true)))


def check_near_truth(case: Case, found: Identification) -> None:
    """Check drives to 2 % and base parameters to 1 % of the largest."""
    assert max(map(abs, drive_errors(found, case.robot, *DRIVE).values())) < 0.02
    errors, size = load_errors(case, found)
    assert np.max(np.abs(errors)) < 0.01 * size


def truth_of(case: Case) -> tuple[LoadModel, dict[str, Array], Array]:
    """Return the load model, springs and values of its columns as they truly are."""
    known = case.robot.without_nominal()
    model = load_model(known, base_parameters(known), known.joint_names)
    values = {joint: drive.values for joint, drive in case.robot.drives.items()}
    springs = {
        joint: np.array([values[joint]["stiffness"], 0.0]) for joint in case.robot.elastic_joints
    }
    drives = [values[joint][name] for joint, name, _ in model.drives]
    return model, springs, np.append(model.base.project(case.robot.parameters), drives)


@pytest.mark.parametrize("name", quick_first(["stiff differential", "elastic differential"]))
def test_a_differential_that_is_not_declared_is_named_with_both_lines(name: str) -> None:
    """One row alone looks like an encoder that measures its angle against another link."""
    case = case_of(name)
    drives = {joint: replace(x, transmission={}) for joint, x in case.robot.drives.items()}
    finding = check(case.robot.with_drives(drives), log_of(case)).warnings[0]
    assert finding.code == "coupled-joints"
    assert "a differential" in finding.message
    lines = tomllib.loads(finding.remedy.partition("\n")[2])
    rows = [lines.get(joint, {"transmission": {joint: 1.0}})["transmission"] for joint in JOINTS]
    matrix = [[row.get(joint, 0.0) for joint in JOINTS] for row in rows]
    assert np.array(matrix) == pytest.approx(case.C, abs=0.01)


def matrices() -> st.SearchStrategy[Array]:
    """Return matrices of two groups and a plain joint between them, well away from singular."""

    def matrix(numbers: list[float]) -> Array:
        C = np.eye(6)
        C[np.ix_([0, 3, 5], [0, 3, 5])] += np.reshape(numbers[:9], (3, 3)) / 5
        C[np.ix_([1, 4], [1, 4])] += np.reshape(numbers[9:], (2, 2)) / 4
        return C

    numbers = st.lists(st.floats(-1, 1), min_size=13, max_size=13)
    return numbers.map(matrix)


@given(matrices(), st.integers(0, 1000))
def test_power_is_the_same_on_both_sides_and_ways_lead_back(C: Array, seed: int) -> None:
    """A plain joint keeps its values bit by bit, also beside a group that is not a number."""
    rng = np.random.default_rng(seed)
    speed, torque = rng.normal(size=(2, 7, 6))
    power = np.sum(torque * speed, axis=1)
    turned = torques_at_drives(C, torque) * at_drives(C, speed)
    assert np.sum(turned, axis=1) == pytest.approx(power, abs=1e-12)
    assert at_drives(C, speed) == pytest.approx(speed @ C.T, abs=1e-13)
    assert torques_at_joints(C, torque) == pytest.approx(torque @ C, abs=1e-13)
    assert at_joints(C, at_drives(C, speed)) == pytest.approx(speed, abs=1e-12)
    assert torques_at_joints(C, torques_at_drives(C, torque)) == pytest.approx(torque, abs=1e-12)
    rows, theta = rng.normal(size=(7, 6, 8)), rng.normal(size=8)
    assert rows_at_drives(C, rows) @ theta == pytest.approx(torques_at_drives(C, rows @ theta))
    speed[:, 0] = np.nan
    np.testing.assert_array_equal(at_drives(C, speed)[:, 2], speed[:, 2])
    assert at_drives(np.eye(6), speed) is speed


def test_the_matrix_is_in_the_order_of_the_joints() -> None:
    """It follows the joints that the user asks for, and comes from the file of drives."""
    C, drives = case_of("stiff differential").C, case_of("stiff differential").robot.drives
    read = load_robot(WRIST, WRIST.with_suffix(".toml")).transmission
    np.testing.assert_array_equal(read, C)
    assert not read.flags.writeable
    order = [2, 0, 1]
    robot = load_robot(WRIST, drives, joints=[JOINTS[index] for index in order])
    np.testing.assert_array_equal(robot.transmission, C[np.ix_(order, order)])


TABLE = {"angle_rad": [-1.0, 0.0, 0.5, 1.0], "ratio": [1.0, 1.1, 1.2, 1.1]}
BEHIND_LINKAGE = {"transmission": {"wrist_pitch": 1.0, "wrist_roll": 1.0}}
HARMONIC: dict[str, Any] = {"angle_ratio": {"cos": [0.1]}}
PITCH_ROLL = ["wrist_pitch", "wrist_roll"]
REFUSED: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({"transmission": {"wrist_rol": 1.0}}, {}, r"joint 'wrist_pitch': .*'wrist_roll'"),
    ({"transmission": {"wrist_pitch": 1.0, "elbow": 1.0}}, {}, "'elbow', which does not move here"),
    ({"transmission": {"wrist_roll": 2.0}}, {}, r"wrist_pitch, wrist_roll .*1.0\]\] is singular"),
    ({"transmission": {"wrist_pitch": 0.0}}, {}, r"of wrist_pitch do .*\[\[0.0\]\] is singular"),
    (
        {"transmission": {"wrist_pitch": 1e4, "wrist_roll": 1.0}},
        {"transmission": {"wrist_pitch": -1e4, "wrist_roll": -1.0}},
        "is singular",
    ),
    ({"angle_ratio": TABLE}, {}, "the table of its angle_ratio ends at -1 and 1"),
    (BEHIND_LINKAGE, HARMONIC, "has a factor on 'wrist_roll', whose drive has angle_ratio"),
]


@pytest.mark.parametrize(("pitch", "roll", "message"), REFUSED)
def test_drives_that_the_robot_cannot_have_are_refused(
    pitch: dict[str, Any], roll: dict[str, Any], message: str
) -> None:
    drives = {"wrist_pitch": stiff(1, **pitch), "wrist_roll": stiff(**roll)}
    with pytest.raises(RobotError, match=message):
        load_robot(WRIST, drives, joints=PITCH_ROLL)


def test_torques_behind_linkages_and_their_slopes_are_those_of_the_bodies() -> None:
    """By the chain rule at the joints, tau_phi = tau_q / rho, and by finite differences."""
    case, robot = case_of("linkages"), case_of("linkages").robot
    q, v, a = np.random.default_rng(0).normal(size=(3, 10, 3))
    expected = case.torques_at_drives(q, rnea(robot, (q, v, a)))
    behind = linkages(q, v, a)
    np.testing.assert_allclose(joint_torques(robot, *behind), expected, rtol=0, atol=1e-11)
    by_steps = torque_slopes_by_steps(robot, behind, 1e-6)
    np.testing.assert_allclose(torque_slopes(robot, *behind), by_steps, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "side", "groups"),
    [
        ("stiff differential", "joint_position", ([1], [2], [1, 2], [0, 1, 2])),
        ("stiff differential", "motor_position", ([1], [2], [1, 2], [0, 1, 2])),
        # the drive of wrist_roll is stiff, and that of wrist_pitch has a spring
        ("mixed differential", "joint_position", ([1], [2])),
        *(("sliding", f"{side}_position", ([0], [3], [0, 3])) for side in ("joint", "motor")),
    ],
)
def test_a_missing_side_of_a_differential_is_computed_from_the_other(
    name: str, side: str, groups: Sequence[list[int]]
) -> None:
    """Of one joint of the group, of both, and of all joints, where no spring is between."""
    case = case_of(name)
    log = log_of(case)
    full = reconstruct_motion(case.robot, log, 8.0)
    for columns in groups:
        half = reconstruct_motion(case.robot, without(log, side, *columns), 8.0)
        assert getattr(half, side) == pytest.approx(getattr(full, side), abs=1e-9)


def test_exact_without_noise(case: Case) -> None:
    """Drives, bodies and springs beside the drives come out of an exact motion to rounding."""
    motion, known = true_motion(case), case.robot.without_nominal()
    model, springs, theta = truth_of(case)
    for joint in case.robot.elastic_joints:
        found = ordinary(actuator_regression(known, motion, joint))
        expected = [case.robot.drives[joint].values[name] for name in DRIVE]
        assert [found.value(name) for name in DRIVE] == pytest.approx(expected, rel=1e-8)
    found = ordinary(load_regression(known, motion, model, springs))
    p = len(model.base.columns)
    scale = np.max(np.abs(case.robot.parameters))
    assert found.values[:p] == pytest.approx(theta[:p], abs=1e-7 * scale)
    assert found.values[p:] == pytest.approx(theta[p:], rel=1e-6)
    springs_beside = sum(len(drive.parallel_spring) for drive in case.drives)
    stiff_count = case.robot.n - len(case.robot.elastic_joints)
    assert len(theta) == p + 2 * stiff_count + springs_beside


OTHERS = ("stiff differential", "compensated differential", "parallelogram", "sliding")
METHODS: list[tuple[str, Method]] = [
    *((name, "two-step") for name in ("mixed differential", "linkages", "elastic differential")),
    *((name, "simultaneous") for name in ("elastic differential", "linkages")),
    *((name, "two-step") for name in OTHERS),
]


@pytest.mark.parametrize(("name", "method"), quick_first(METHODS, 3))
@pytest.mark.usefixtures("estimates_only")
def test_a_log_gives_nearly_the_truth_and_predicts_another_motion(
    name: str, method: Method
) -> None:
    """Filtering costs at most 2 %; the load of every joint and of every spring is predicted."""
    case = case_of(name)
    found = identify(case.robot.without_nominal(), log_of(case), cutoff_hz=12.0, method=method)
    count = len(drive_errors(found, case.robot, *DRIVE))
    assert count == 2 * case.robot.n + len(case.robot.elastic_joints)
    check_near_truth(case, found)
    load = validate(found, log_of(case, 5)).load
    assert np.all(load.relative_error < 0.02)
    states = waves(case.robot.n, true_motion(case, 5).time, case.reach, 5)
    tau_phi = motor_angles(case, states)[1]
    inside = np.isfinite(load.measured[:, 0])
    for joint in case.robot.elastic_joints:
        index = case.robot.index(joint)
        error = load.computed[inside, index] - tau_phi[inside, index]
        assert np.std(error) < 0.03 * np.std(tau_phi[:, index])


def sensed(case: Case) -> Array:
    """Return what sensors at the joints read, friction of stiff drives still in it."""
    motion = true_motion(case)
    states = waves(case.robot.n, motion.time, case.reach, 0)
    tau_phi = motor_angles(case, states)[1]
    for i, drive in enumerate(case.drives):
        if not drive.is_elastic:
            tau_phi[:, i] = drive.ratio * motion.motor_torque[:, i]
    slopes = linkages(states[0], np.ones_like(tau_phi), 0 * tau_phi)[1]
    return np.asarray(tau_phi @ case.C * (slopes if case.has_linkages else 1.0))


@pytest.mark.parametrize(
    "name", quick_first(["stiff differential", "linkages", "elastic differential"], 2)
)
@pytest.mark.usefixtures("estimates_only")
def test_sensors_at_all_joints_of_a_group_stand_for_its_motors(name: str) -> None:
    """They give the bodies and the springs, and the force of a spring is that on phi."""
    case = case_of(name)
    log = without(replace(log_of(case), joint_torque=sensed(case)), "motor_torque", 0, 1, 2)
    found = identify(case.robot.without_nominal(), log, cutoff_hz=12.0)
    assert found.model.torque_joints == JOINTS
    errors, size = load_errors(case, found)
    assert np.max(np.abs(errors)) < 0.01 * size
    if case.robot.elastic_joints:
        stiffness = drive_errors(found, case.robot, "stiffness")
        assert max(map(abs, stiffness.values())) < 0.01
    (seen,), measured = found.motions, _actuator(found, found.motions[0])[0]
    for joint in case.robot.elastic_joints:
        index, drive = case.robot.index(joint), case.robot.drives[joint]
        turned = at_drives(case.C, seen.joint_position)[:, index]
        stretch = seen.motor_position[:, index] / total_ratio(drive) - turned
        torque = drive.values["stiffness"] * drive.load_radius**2 * stretch / total_ratio(drive)
        np.testing.assert_allclose(measured[:, index], torque, atol=0.02 * np.ptp(torque))


@pytest.mark.usefixtures("estimates_only")
def test_one_sensor_of_a_group_is_not_enough_and_one_motor_is() -> None:
    """Without a torque a joint has no row, or a motor no drive, and may not be asked for."""
    case, log = case_of("stiff differential"), log_of(case_of("stiff differential"))
    known = case.robot.without_nominal()
    found = identify(known, without(log, "motor_torque", 2), cutoff_hz=12.0)
    assert found.model.torque_joints == JOINTS[:2]
    assert "wrist_roll" not in found.drives
    check_near_truth(case, found)
    log = without(replace(log, joint_torque=sensed(case)), "motor_torque", 0, 1, 2)
    log = without(log, "joint_torque", 2)
    assert identify(known, log, cutoff_hz=12.0).model.torque_joints == ("elbow",)
    with pytest.raises(LogError, match="no torque in the log at wrist_pitch; name the others"):
        identify(known, log, torque_joints=JOINTS[:2], cutoff_hz=12.0)


@pytest.mark.parametrize("name", ["elastic differential", "parallelogram", "sliding"])
def test_a_shifted_zero_does_to_the_torques_what_their_slope_says(name: str) -> None:
    """The slope of tau_phi is that of Pinocchio's torques, mapped by the matrix."""
    case = case_of(name)
    motion, (model, springs, theta) = true_motion(case), truth_of(case)
    known = case.robot.without_nominal()
    regress = partial(load_regression, known, model=model, springs=springs)
    rows = offset_sensitivity(known, motion, regress, theta)
    data = case.robot.model.createData()
    for at in (100, 2000, 3000):
        q, v, a = (state[at] for state in motion.joint_states)
        slope = pin.computeRNEADerivatives(case.robot.model, data, q, v, a)[0]
        expected = -np.linalg.solve(case.C.T, slope)
        for joint in springs:
            i = case.robot.index(joint)
            row = (rows.time == motion.time[at]) & (rows.joint == i)
            assert rows.propagated[row][0] == pytest.approx(expected[i], abs=2e-3, rel=1e-3)


@pytest.mark.parametrize(
    "name", quick_first(["stiff differential", "linkages", "mixed differential"], 2)
)
def test_a_replay_follows_the_log_in_the_angles_of_the_joints(name: str) -> None:
    """It starts where motors and joints were, and stays near them."""
    log = log_of(case_of(name)).between(0.6, 0.8)
    again = replay(case_of(name).robot, log)
    assert again.motor_position[0] == pytest.approx(log.motor_position[0], abs=1e-9)
    np.testing.assert_allclose(again.joint_position, log.joint_position, rtol=0, atol=1e-3)


@pytest.mark.slow  # 15 s
@pytest.mark.usefixtures("estimates_only")
def test_springs_behind_linkages_are_refined_by_output_errors() -> None:
    """The simulation of the joints by the motors is one behind the gears, too."""
    case = case_of("linkages")
    log = log_of(case, torque=0.01, angle=1e-5, draw=1)
    refined = refine(identify(case.robot.without_nominal(), log), log)
    errors = drive_errors(refined, case.robot, "stiffness")
    assert max(map(abs, errors.values())) < 0.02


@pytest.mark.parametrize("name", quick_first(["compensated differential", "parallelogram"]))
def test_the_complete_model_is_zero_along_a_motion(name: str) -> None:
    case, at = case_of(name), 1234
    motion, model = true_motion(case), complete_model(case.robot)
    t = model.coordinates[0].args[0]
    motors = [case.robot.index(joint) for joint in case.robot.elastic_joints]
    of_motors = (motion.motor_position, motion.motor_velocity, motion.motor_acceleration)
    states = [
        np.append(joints[at], others[at, motors])
        for joints, others in zip(motion.joint_states, of_motors, strict=True)
    ]
    values: dict[Any, float] = {}
    for order in (2, 1, 0):
        for coordinate, value in zip(model.coordinates, states[order], strict=True):
            values[coordinate.diff(t, order) if order else coordinate] = float(value)
    torques = dict(zip(model.inputs, map(float, motion.motor_torque[at]), strict=True))
    numbers = dict(zip(map(str, model.parameters), case.robot.parameters, strict=True))
    for joint, drive in case.robot.drives.items():
        numbers |= {
            f"N_{joint}": drive.ratio,
            f"r_M_{joint}": drive.motor_radius,
            f"r_L_{joint}": drive.load_radius,
            f"I_M_{joint}": drive.values["motor_inertia"],
            f"F_v_{joint}": drive.values["viscous_friction"],
            f"F_C_{joint}": drive.values["coulomb_friction"],
            f"k_{joint}": drive.values.get("stiffness"),
            f"f_0_{joint}": 0.0,
            f"k_P_{joint}": drive.values.get("parallel_stiffness"),
        }
    assert len(model.equations) == case.robot.n + len(motors)
    for equation in model.equations:
        by_symbol = {x: numbers[str(x)] for x in equation.free_symbols - {t}}
        derivatives = {x: y for x, y in values.items() if isinstance(x, sp.Derivative)}
        positions = {x: y for x, y in values.items() if x not in derivatives} | torques
        residual = equation.xreplace(derivatives).xreplace(positions).xreplace(by_symbol)
        assert float(residual) == pytest.approx(0.0, abs=2e-6)


@pytest.mark.usefixtures("estimates_only")
def test_what_coupled_joints_do_not_have_is_said() -> None:
    """Each refusal names the joints; it ends where the torques of a whole group are known."""
    case, robot = case_of("elastic differential"), case_of("stiff differential").robot
    rows, known = ["elbow", "wrist_roll"], case.robot.without_nominal()
    together = "wrist_pitch, wrist_roll move these joints together"
    log = log_of(case, duration=4.0)
    found = identify(known, log, cutoff_hz=12.0)
    with pytest.raises(IdentificationError, match="drives of wrist_pitch, wrist_roll move several"):
        refine(found, log)
    with pytest.raises(ExcitationError, match=together):
        load_target(robot, rows, base_parameters(robot, torque_joints=rows))
    assert load_target(robot, None, base_parameters(robot)).rows == (0, 1, 2)
    of_group = base_parameters(robot, torque_joints=PITCH_ROLL)
    check_base(of_group, rows_of_torques(robot, PITCH_ROLL))
    message = "whose motor turns several joints, and no sensor is behind its spring"
    with pytest.raises(IdentificationError, match=message):
        identify(known, without(log, "joint_position", 1, 2))
    mixed, message = case_of("mixed differential").robot, "no joint position of wrist_pitch"
    with pytest.raises(LogError, match=f"{message}, wrist_roll; .* replace it: wrist_roll$"):
        reconstruct_motion(mixed, without(log, "joint_position", 1, 2))
    with pytest.raises(LogError, match=f"{message}, wrist_roll; .* replace it: wrist_pitch$"):
        blind = without(without(log, "joint_position", 1, 2), "motor_position", 2)
        reconstruct_motion(robot, blind)
    with pytest.raises(LogError, match=r"joint 'wrist_pitch' moves several joints .* a deflection"):
        both_sides({"wrist_pitch.deflection_rad": np.zeros(3)}, case.robot)


DEFLECTION = "elbow.deflection_rad"


@pytest.mark.usefixtures("estimates_only")
def test_what_joints_with_linkages_do_not_have_is_said(tmp_path: Path) -> None:
    """Each refusal names a joint; a format without ratios of an angle is written with a warning."""
    needs = "needs constant gear ratios, and that of 'elbow' depends on its angle"
    robot, log = case_of("linkages").robot, log_of(case_of("linkages"))
    rail = DATA / "mixed_arm.urdf"
    refused: dict[str, Callable[[], object]] = {
        f"design_excitation {needs}": lambda: design_excitation(robot, 5.0),
        f"a MuJoCo model {needs}": lambda: write_mjcf(robot, tmp_path / "arm.xml"),
        f"complete_model {needs}": lambda: complete_model(robot),
        f"a linearised robot {needs}": lambda: linearised(robot, np.zeros(3), [0]),
        f"a floating base {needs}": lambda: load_robot(WRIST, robot.drives, base="floating"),
        "deflection does not determine its": lambda: both_sides({DEFLECTION: np.zeros(3)}, robot),
        "or angle_ratio, and no sensor": lambda: identify(robot, without(log, "joint_position", 0)),
        "drive with angle_ratio turns": lambda: load_robot(rail, {"telescope": stiff(**HARMONIC)}),
    }
    for words, call in refused.items():
        with pytest.raises(SeaidError, match=words):
            call()
    written = write_model(robot, tmp_path / "arm.py", "isaaclab")
    (lost,) = (x.message for x in written.warnings if "ratio of its angle" in x.message)
    assert "those of elbow, wrist_pitch are not in the file" in lost
