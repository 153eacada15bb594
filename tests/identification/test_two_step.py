"""What was put into a simulation comes out of the identification."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio
import pytest

from seaid._arrays import Array
from seaid.drives import ParameterName
from seaid.estimation import Estimate
from seaid.estimation.qr_factor import qr_factor_of
from seaid.identification import Identification, identify, validate
from seaid.identification.problem import Method
from seaid.identification.stacked_fits import TORQUE_OFFSET, FitsInTurn, identifiable_offsets
from seaid.log import Log, Motion
from seaid.regressor.base import regressor_at_drives
from seaid.robot import Robot
from seaid.simulation import Noise
from seaid.simulation.simulation import measure
from tests.experiments import (
    ARM_SENSORS,
    ELASTIC,
    LEG_SENSORS,
    TEST_MASS,
    arm,
    arm_motion,
    drive_errors,
    drive_scores,
    leg,
    leg_log,
    leg_motion,
    load_scores,
    perfect_log,
    with_drive,
    with_named_friction,
)
from tests.plants import regression
from tests.representatives import quick_first
from tests.standard_errors import check_scores

DRIVE = ("viscous_friction", "coulomb_friction", "stiffness", "motor_inertia")


Experiment = tuple[Robot, Motion, Noise]
EXPERIMENTS: dict[str, Callable[[], Experiment]] = {
    "tulip_leg": lambda: (leg(TEST_MASS), leg_motion(TEST_MASS), LEG_SENSORS),
    "mixed_arm": lambda: (arm(), arm_motion(), ARM_SENSORS),
}


@pytest.fixture(params=[*EXPERIMENTS])
def experiment(request: pytest.FixtureRequest) -> Experiment:
    return EXPERIMENTS[request.param]()


def load_error(found: Identification, truth: Robot) -> float:
    """Return the largest error of a base parameter, relative to the largest one of its unit."""
    true, units = found.base.project(truth.parameters), np.array(found.load.units)
    largest = [np.max(np.abs(true)[units == unit]) for unit in units]
    return float(np.max(np.abs(found.load.values - true) / largest))


def assert_same(found: Identification, other: Identification) -> None:
    """Check that all estimates and their errors are equal to the last digit."""
    pairs = [(found.load, other.load), *((x, other.drives[j]) for j, x in found.drives.items())]
    for estimate, same in pairs:
        np.testing.assert_array_equal(estimate.values, same.values)
        np.testing.assert_array_equal(estimate.covariance, same.covariance)


# Perfect sensors: what is left comes from the filters, and from rows in which dry friction changes
# sign inside the filter's window.


def test_perfect_sensors_give_nearly_the_truth(experiment: Experiment) -> None:
    truth, motion, _ = experiment
    found = identify(truth.without_nominal(), perfect_log(truth, motion), cutoff_hz=20.0)
    errors = drive_errors(found, truth, *DRIVE)
    # the ankle's motor is slow and sticks; only its friction suffers
    suffering = {f"{name} of ankle_pitch" for name in DRIVE[:2]} & {*errors}
    sticking = {name: errors.pop(name) for name in suffering}
    assert len(errors) == (11 if sticking else 10)
    assert max(map(abs, errors.values())) < 0.005
    assert all(abs(error) < 0.03 for error in sticking.values())
    assert load_error(found, truth) < 0.005
    assert {flag.code for flag in found.warnings} == {"gear-compliance"}


# Real sensors: inside the intervals.


@pytest.mark.parametrize("experiment", quick_first([*EXPERIMENTS][::-1]), indirect=True)
def test_findings_alter_no_estimate(experiment: Experiment, request: pytest.FixtureRequest) -> None:
    truth, motion, noise = experiment
    log = measure(truth, motion, noise, seed=0)
    whole = identify(truth.without_nominal(), log)
    request.getfixturevalue("estimates_only")
    alone = identify(truth.without_nominal(), log)
    assert whole.setup
    assert not alone.setup
    assert_same(whole, alone)


@pytest.mark.slow  # 72 and 200 identifications of whole robots
@pytest.mark.usefixtures("estimates_only")
@pytest.mark.parametrize(
    ("experiment", "draws"), [("tulip_leg", 72), ("mixed_arm", 200)], indirect=["experiment"]
)
def test_errors_are_as_large_as_the_standard_errors_say(experiment: Experiment, draws: int) -> None:
    """1.13 is the standard deviation of Student's t with the degrees of freedom of six seconds.

    The torque offsets correlate all bodies of the arm, which moves little: its draws scatter more.
    """
    truth, motion, noise = experiment
    drives, loads = [], []
    robot = with_named_friction(truth.without_nominal())
    for seed in range(draws):
        found = identify(robot, measure(truth, motion, noise, seed))
        drives.append(drive_scores(found, truth, *DRIVE))
        loads.append(load_scores(found, truth))
    check_scores(drives, 1.13, band=1.2)
    check_scores(loads, band=1.2)


@pytest.mark.slow  # 2.8 s
def test_nothing_of_the_nominal_values_leaks(experiment: Experiment) -> None:
    truth, motion, noise = experiment
    log = measure(truth, motion, noise, seed=7)
    drives: dict[str, Any] = {
        joint: drive.with_values(dict.fromkeys({*DRIVE[:3]} & {*drive.values}, 1.0))
        for joint, drive in truth.drives.items()
    }
    wrong = truth.with_values(3 * truth.parameters, drives)
    results = [identify(robot, log) for robot in (truth, truth.without_nominal(), wrong)]
    for other in results[1:]:
        assert_same(results[0], other)


@pytest.mark.slow  # identifications of whole robots
@pytest.mark.parametrize("massless", [("hip_yaw", "hip_roll"), leg().joint_names])
def test_bodies_without_mass_keep_their_first_moments(massless: tuple[str, ...]) -> None:
    bodies = leg().parameters.reshape(-1, 10).copy()
    bodies[[leg().index(joint) for joint in massless]] = 0.0
    bare = leg().with_values(bodies.ravel(), leg().drives)
    found = identify(bare, measure(leg(), leg_motion(), LEG_SENSORS, 1))
    robot, states = found.robot, [one[::100] for one in leg_motion().joint_states]
    assert found.base.project(robot.parameters) == pytest.approx(found.load.values, abs=1e-9)
    expected = regressor_at_drives(robot, *states) @ robot.parameters
    order, data = list(robot.model_order), robot.model.createData()
    torques = [
        pinocchio.rnea(robot.model, data, *(one[order] for one in state))
        for state in zip(*states, strict=True)
    ]
    assert np.array(torques) == pytest.approx(expected[:, order], abs=1e-6)


@pytest.mark.usefixtures("estimates_only")
def test_encoder_zeros_end_up_in_the_deflection_offset() -> None:
    truth, motion = arm(), arm_motion()
    zeros = (0.7, -0.4, 2.0, 0.1)
    log = measure(truth, motion, Noise(motor_offset_rad=zeros))
    found, plain = (
        identify(truth.without_nominal(), one) for one in (log, perfect_log(truth, motion))
    )
    for joint, zero, lever in (("shoulder", -0.4, 1 / 100.0), ("telescope", 2.0, 0.02 / 20.0)):
        drives = found.drives[joint], plain.drives[joint]
        stiffness, right = (drive.value("stiffness") for drive in drives)
        shifted, offset = (drive.value("spring_offset") for drive in drives)
        assert shifted - offset == pytest.approx(-right * lever * zero, rel=1e-3)
        assert stiffness == pytest.approx(right, rel=1e-6)
    assert found.load.values == pytest.approx(plain.load.values, abs=1e-6)


@pytest.mark.usefixtures("estimates_only")
@pytest.mark.parametrize("unknown", ["rotor inertias", "motor torques"])
def test_what_is_not_known_of_a_spring_is_found_or_not_needed(unknown: str) -> None:
    """Its rotor inertia in (7), and (4b) in the place of (7) where its joint torque is measured."""
    truth, motion = arm(), arm_motion()
    known, log = truth.without_nominal(), perfect_log(truth, motion)
    if unknown == "rotor inertias":
        for joint in truth.joint_names:
            known = with_drive(known, joint, motor_inertia_kg_m2=None)
    else:
        is_sensed = np.isfinite(motion.joint_torque)
        torque = np.where(is_sensed, np.nan, motion.motor_torque)
        log = replace(log, joint_torque=motion.joint_torque, motor_torque=torque)
    found = identify(known, log, cutoff_hz=20.0)
    errors = drive_errors(found, truth, *DRIVE)
    assert max(map(abs, errors.values())) < (0.01 if unknown == "rotor inertias" else 0.005)
    if unknown == "motor torques":
        names = {found.drives[joint].names for joint in truth.elastic_joints}
        assert names == {("stiffness", "spring_offset")}
        assert load_error(found, truth) < 0.005
        return
    assert {f"motor_inertia of {joint}" for joint in truth.elastic_joints} <= errors.keys()
    absorbed = [name for name in found.load.names if "motor_inertia" in name]
    assert absorbed == [
        "m_carriage + m_upper_arm + 1.6e+05 motor_inertia_rail",
        "Ixx_tool + 2500 motor_inertia_wrist",
    ]
    assert {name for _, name, _ in found.model.drives} == {"viscous_friction", "coulomb_friction"}
    assert found.model.names[-1] == "coulomb_friction of wrist"


# Torque offsets of drives on springs, which the load side tells from spring offsets.


OFFSETS = {"hip_pitch": 2e-3, "knee_pitch": -2e-3, "ankle_pitch": 5e-4}


@cache
def with_offsets(part: float, method: Method = "two-step") -> tuple[Log, Identification]:
    """Return the log of the leg with a part of the offsets, and its identification."""
    log = leg_log(3)
    offsets = [part * OFFSETS.get(joint, 0.0) for joint in log.joint_names]
    log = replace(log, motor_torque=log.motor_torque + offsets)
    return log, identify(leg(TEST_MASS).without_nominal(), log, cutoff_hz=4.0, method=method)


@pytest.mark.parametrize("method", quick_first(["two-step", "simultaneous"]))
def test_an_offset_moves_nothing_but_itself(method: Method) -> None:
    """The equations are linear: the constant is in one column, whatever the data are.

    The motor side is predicted with it, and a large one is a finding.
    """
    (_, plain), (_, off) = runs = [with_offsets(part, method) for part in (0.0, 1.0)]
    assert off.load.values == pytest.approx(plain.load.values, rel=1e-3, abs=1e-4)
    for joint, offset in OFFSETS.items():
        before, after = plain.drives[joint], off.drives[joint]
        names = (TORQUE_OFFSET, "spring_offset", *DRIVE[:3])
        change, *rest = (after.value(name) - before.value(name) for name in names)
        assert change == pytest.approx(offset, rel=1e-3)
        sizes = [before.standard_error(name) for name in names]
        assert np.all(np.abs(rest) < 1e-2 * np.array(sizes[1:]))
        assert abs(before.value(TORQUE_OFFSET)) < 3.0 * sizes[0]  # no offset in truth
    errors = [validate(found, log).actuator.rms_error for log, found in runs]
    elastic = [leg().index(joint) for joint in ELASTIC]
    assert errors[1][elastic] == pytest.approx(errors[0][elastic], rel=1e-2)
    assert "torque-offset" not in {one.code for one in plain.warnings}
    finding = next(one for one in off.warnings if one.joint == "knee_pitch")
    assert finding.code == "torque-offset"
    assert finding.evidence["offset_Nm"] == pytest.approx(-2e-3, rel=0.3)


def test_a_constant_that_gravity_explains_is_not_identifiable() -> None:
    angle = np.random.default_rng(0).normal(size=400)
    for reach, expected in ((1.0, ("a",)), (0.05, ())):
        columns = np.column_stack([np.cos(reach * angle), np.ones(400)])
        rows = regression(columns, angle, names=("gravity", "offset"))
        assert identifiable_offsets(qr_factor_of(rows), ["a"]) == expected


# Fits in turn as one estimate: errors that several values have in common are correlated.


JOINTS = ("hip_pitch", "knee_pitch")
SPRING = ("stiffness", "spring_offset")
UNIT, OF_UNIT = np.array([[80.0, 3.0], [60.0, -2.0]]), np.diag([0.5, 0.1])
CONSTANTS, OF_CONSTANTS = np.array([2.0, 3.0]), np.array([[4e-4, 3e-4], [3e-4, 9e-4]])


def fit_of(names: tuple[str, ...], values: Array, covariance: Array) -> Any:
    """Return a fit with an estimate, which the propagated springs do not move."""
    every = ParameterName.all_of(names)
    estimate = Estimate(every, values, covariance, ("",) * len(names), 0.1, 1.0)
    return SimpleNamespace(estimate=estimate, sensitivity=np.zeros((len(names), 4)))


def test_springs_that_one_load_scales_share_the_errors_of_their_constants() -> None:
    """k = K k_1 for a constant K by the load: cov(k, k') = k_1 k_1' cov(K, K')."""
    names = tuple(ParameterName("torque_constant", joint) for joint in JOINTS)
    motors = {joint: fit_of(SPRING, x, OF_UNIT) for joint, x in zip(JOINTS, UNIT, strict=True)}
    scales = fit_of(names, CONSTANTS, OF_CONSTANTS)
    constants = dict(zip(JOINTS, names, strict=True))
    drives = FitsInTurn(leg(), motors, JOINTS, constants, by_load=scales).drives
    springs = drives.of_names([ParameterName("stiffness", joint) for joint in JOINTS])
    assert springs.values == pytest.approx(CONSTANTS * UNIT[:, 0])
    shared = np.outer(UNIT[:, 0], UNIT[:, 0]) * OF_CONSTANTS
    assert springs.covariance == pytest.approx(shared + np.diag(CONSTANTS**2 * OF_UNIT[0, 0]))
