"""Standard deviations of what was given as known, in the errors of the estimates."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives import StiffDrive
from seaid.errors import IdentificationError
from seaid.estimation import Estimate
from seaid.identification import Identification, identify, identify_conditions, refine
from seaid.legged import load_robot
from seaid.log import Log
from seaid.robot import Robot
from tests.experiments import (
    ELASTIC,
    TEST_MASS,
    geared_arm_log,
    leg,
    leg_log,
    leg_motion,
    perfect_log,
    true_value,
    with_drive,
)
from tests.mistakes import in_currents
from tests.representatives import quick_first
from tests.standard_errors import scores

TRUTH = leg(TEST_MASS)


def found(**options: Any) -> Identification:
    return identify(TRUTH.without_nominal(), leg_log(5), cutoff_hz=4.0, **options)


@pytest.mark.slow  # several identifications of the leg
@pytest.mark.parametrize("method", ["two-step", "simultaneous"])
@pytest.mark.usefixtures("estimates_only")
def test_errors_of_constants_and_of_encoder_offsets_add_up(method: str) -> None:
    constants: dict[str, Any] = {"known_std": {"torque": 0.02, "payload": 0.01}}
    offsets = {"encoder_offset_std": 2e-3}
    plain, of_constants, of_offsets, both = (
        found(method=method, **options).load.covariance
        for options in ({}, constants, offsets, constants | offsets)
    )
    errors = np.sqrt(np.diag(both))
    rest = (both - (of_constants + of_offsets - plain)) / np.outer(errors, errors)
    assert np.max(np.abs(rest)) < 1e-3  # both sides at once settle to so many standard errors


@pytest.mark.slow  # 0.9 s
def test_the_summary_names_the_constants_that_were_taken_as_exact() -> None:
    """With the option that includes typical tolerances."""
    stated, plain = found(known_std={"torque": 0.05, "payload": 0.02}), found()
    rest = {"motor_inertia_kg_m2": 0.05, "gear_ratio": 0.001}
    rest |= {"motor_pulley_radius_m": 0.005, "load_pulley_radius_m": 0.005}
    assert stated.exact_constants == rest
    assert plain.exact_constants == {"torque": 0.03, "payload": 0.01, **rest}
    option = "--known-std torque=0.03,payload=0.01,motor_inertia_kg_m2=0.05,gear_ratio=0.001,"
    assert sum(option in line for line in plain.summary().splitlines()) == 1
    assert "taken as exact" not in replace(plain, exact_constants={}).summary()
    added = stated.load.covariance - plain.load.covariance  # each moves all parameters together
    assert np.linalg.matrix_rank(added, tol=1e-6 * np.trace(added)) == 2
    assert [x.severity for x in stated.warnings if x.code == "torque-scale"] == ["note"]


def driven_by_currents(constants: Array, noise_A: float = 0.0) -> tuple[Robot, Log]:
    """Return the UR10 with known bodies and the log of its currents, of motors with constants."""
    log = geared_arm_log()
    noise = noise_A * np.random.default_rng(1).normal(size=log.motor_torque.shape)
    log = in_currents(replace(log, motor_torque=log.motor_torque + constants * noise), constants)
    drives = dict.fromkeys(log.joint_names, StiffDrive(gear_ratio=1.0, motor_input="current"))
    return load_robot("ur10", drives, snap_tolerance_rad=0, known_bodies="all"), log


@pytest.mark.slow  # several identifications of the arm
def test_constants_of_motors_are_as_well_known_as_the_bodies() -> None:
    """Each body has a scale of its own: the constant of the last joint has that of the last one."""
    robot, log = driven_by_currents(np.full(6, 10.0))
    plain, stated = identify(robot, log), identify(robot, log, known_std={"bodies": 0.05})
    assert [x.severity for x in plain.warnings if x.code == "torque-scale"] == ["note"]
    assert plain.exact_constants["bodies"] == 0.05
    assert not {"bodies", "torque"} & set(stated.exact_constants)
    assert not [one for one in stated.warnings if one.code == "torque-scale"]
    for joint in log.joint_names[1:4]:
        drive, before = stated.drives[joint], plain.drives[joint]
        np.testing.assert_allclose(drive.values, before.values)
        errors = [x.standard_error("torque_constant") for x in (drive, before)]
        relative = np.sqrt(errors[0] ** 2 - errors[1] ** 2) / drive.value("torque_constant")
        assert 0.05 / np.sqrt(len(robot.body_names)) < relative < 0.07


@pytest.mark.slow  # identifications of the arm
@pytest.mark.parametrize("estimator", ["wls", "huber"])
@pytest.mark.usefixtures("estimates_only")
def test_noise_of_currents_does_not_make_torque_constants_small(estimator: Any) -> None:
    """The currents of the wrist are mostly friction and noise; robust weights are biased."""
    constants = np.array([13.0, 13.2, 9.5, 7.4, 7.3, 7.5])
    robot, log = driven_by_currents(constants, 0.02)
    drives = identify(robot, log, estimator=estimator).drives
    far = [
        scores(drives[joint], {"torque_constant": constant})
        for joint, constant in zip(log.joint_names[:5], constants, strict=False)
    ]
    assert (np.max(np.abs(far)) < 4) == (estimator == "wls")


STEP = 1e-4
"""Relative change of a constant in whole identifications."""

STDS = {"motor_inertia_kg_m2": 0.05}
"""Relative standard deviations of constants, with which they matter; others have `STD`."""

STD = 1e-3

CONSTANTS = (
    "torque",
    "motor_inertia_kg_m2",
    "payload",
    "gear_ratio",
    "motor_pulley_radius_m",
    "load_pulley_radius_m",
    "torque_scale",
)

Experiment = tuple[Robot, Log]


@cache
def by_torque() -> Experiment:
    """Return the leg with torques of its motors, and a log without any error."""
    return TRUTH.without_nominal(), perfect_log(TRUTH, leg_motion(TEST_MASS))


@cache
def by_noisy_torque() -> Experiment:
    """Return the leg of `by_torque`, and a log with the noise of its sensors."""
    return TRUTH.without_nominal(), leg_log(5)


def with_currents(
    log: Log, driven: Sequence[str], std_Nm: float | None = None, seed: int = 0
) -> Log:
    """Return a log of the leg with currents of some motors, of 1/20 N m/A, in place of torques.

    `std_Nm` is the noise of torque sensors behind their springs, None: without sensors.
    """
    is_current = np.isin(log.joint_names, driven)
    torque = log.motor_torque
    sensed = leg_motion(TEST_MASS).joint_torque
    sensed = sensed + (std_Nm or 0.0) * np.random.default_rng(seed).normal(size=sensed.shape)
    return replace(
        log,
        motor_torque=np.where(is_current, np.nan, torque),
        motor_current=np.where(is_current, 20.0 * torque, np.nan),
        joint_torque=log.joint_torque if std_Nm is None else np.where(is_current, sensed, np.nan),
    )


@cache
def by_current(*known_bodies: str, driven: tuple[str, ...] = ELASTIC) -> Robot:
    """Return the leg with currents of unknown scale, its elastic joints with unknown rotors."""
    robot = replace(TRUTH, known_bodies=known_bodies)
    for joint in driven:
        robot = with_drive(robot, joint, motor_input="current", nominal={})
    for joint in ELASTIC:
        robot = with_drive(robot, joint, motor_inertia_kg_m2=None)
    return robot.without_nominal()


@cache
def by_bodies() -> Experiment:
    """Return the leg with currents of all motors, whose scale known bodies determine."""
    joints = TRUTH.joint_names
    log = with_currents(by_torque()[1], joints)
    return by_current(*TRUTH.body_names[-2:], driven=joints), log


@cache
def by_sensors() -> Experiment:
    """Return the leg with currents, whose scale sensors behind the springs determine."""
    return by_current(), with_currents(by_torque()[1], ELASTIC, 0.0)


def stated(experiment: Experiment, name: str, joint: str) -> tuple[Robot, dict[str, float]]:
    """Return the robot and `known_std` with a standard deviation of a constant."""
    robot, std = experiment[0], STDS.get(name, STD)
    if name in ("torque", "payload"):
        return robot, {name: std}
    size = 1.0 if name == "torque_scale" else getattr(robot.drives[joint], name)
    return with_drive(robot, joint, std={name: std * size}), {}


def changed(experiment: Experiment, name: str, joint: str) -> Experiment:
    """Return the robot and the log with a constant larger by `STEP`."""
    robot, log = experiment
    if name in ("torque", "torque_scale"):
        factor = 1 + STEP * np.isin(robot.joint_names, [joint] if joint else robot.joint_names)
        channels = ("motor_torque", "motor_current", "joint_torque")
        given = [channel for channel in channels if getattr(log, channel) is not None]
        return robot, replace(log, **{x: getattr(log, x) * factor for x in given})
    if name == "payload":
        return replace(robot, payload_parameters=(1 + STEP) * robot.payload_parameters), log
    larger = {name: (1 + STEP) * getattr(robot.drives[joint], name)}
    return with_drive(robot, joint, **larger), log


def estimates_of(robot: Robot, log: Log, **options: Any) -> list[Estimate]:
    """Return all estimates of an identification."""
    found = identify(robot, log, cutoff_hz=4.0, **{"method": "two-step", **options})
    return [*found.drives.values(), found.load, found.load_side]


def estimates_of_halves(robot: Robot, log: Log, **options: Any) -> list[Estimate]:
    """Return all estimates of two conditions, which are the halves of a log."""
    middle = float(np.mean(log.time))
    parts = log.between(-np.inf, middle), log.between(middle, np.inf)
    both = {f"half {place}": (robot, part) for place, part in enumerate(parts)}
    found = identify_conditions(both, cutoff_hz=4.0, **options).identifications.values()
    return [side for each in found for side in (*each.drives.values(), each.load, each.load_side)]


def refined_estimates(robot: Robot, log: Log, **options: Any) -> list[Estimate]:
    """Return the load estimate of a refinement."""
    return [refine(identify(robot, log, cutoff_hz=4.0, **options), log).load]


@cache
def plain_estimates(
    estimated: Callable[..., list[Estimate]], experiment: Experiment, **options: Any
) -> list[Estimate]:
    """Return the estimates with which those by other constants are compared."""
    return estimated(*experiment, **options)


def check_moved(
    experiment: Experiment,
    name: str,
    joint: str,
    estimated: Callable[..., list[Estimate]] = estimates_of,
    **options: Any,
) -> None:
    """Compare errors by a constant with whole identifications, to a part of all standard errors."""
    robot, known_std = stated(experiment, name, joint)
    sides = (
        plain_estimates(estimated, experiment, **options),
        estimated(robot, experiment[1], known_std=known_std, **options),
        estimated(*changed(experiment, name, joint), **options),
    )
    largest = 0.0
    for before, with_std, after in zip(*sides, strict=True):
        np.testing.assert_allclose(with_std.values, before.values)
        added = np.sqrt(np.maximum(np.diag(with_std.covariance - before.covariance), 0.0))
        moved = STDS.get(name, STD) / STEP * np.abs(after.values - before.values)
        errors = before.standard_errors
        assert np.all(np.abs(added - moved) < 0.03 * moved + 0.04 * errors)
        largest = max(largest, float(np.max(moved / errors, initial=0.0)))
    assert largest > 0.05


Options = dict[str, Any]
OLS: Options = {"estimator": "ols"}
BOTH_SIDES: Options = {"estimator": "ols", "method": "simultaneous"}
KNEE = "knee_pitch"
HALVES: Options = {"estimator": "ols", "estimated": estimates_of_halves}
OWN = {"condition_specific": ("bodies", "spring_offset", "stiffness")}, {"condition_specific": ()}
JOINT = {name: "" if name in ("torque", "payload") else KNEE for name in CONSTANTS}
MOVED: list[tuple[Callable[[], Experiment], str, str, Options]] = [
    # alone, and in several conditions
    *(
        (by_torque, name, joint, options)
        for name, joint in JOINT.items()
        for options in (OLS, *(HALVES | own for own in OWN))
    ),
    (by_noisy_torque, "torque", "", {"estimated": refined_estimates}),
    *((by_torque, name, "hip_yaw", OLS) for name in ("gear_ratio", "torque_scale")),
    *((by_torque, name, "", BOTH_SIDES) for name in ("torque", "payload")),
    # Simultaneous estimation weighs the rows by residuals, which a constant changes without noise.
    (by_noisy_torque, "motor_pulley_radius_m", KNEE, BOTH_SIDES),
    # constants of motors, whose scale is that of known bodies or of sensors
    *((by_bodies, "payload", "", OLS), (by_bodies, "gear_ratio", KNEE, OLS)),
    (by_sensors, "gear_ratio", KNEE, OLS),
    *((by_torque, "payload", "", {"estimator": estimator}) for estimator in ("huber", "iv")),
]
"""Experiments with a constant of a joint, "" for all, and how they are identified."""


@pytest.mark.usefixtures("estimates_only")
@pytest.mark.parametrize(("experiment", "name", "joint", "options"), quick_first(MOVED, 2))
def test_errors_of_a_constant_are_those_of_whole_identifications(
    experiment: Callable[[], Experiment], name: str, joint: str, options: Options
) -> None:
    """The noise-free log has no residual by which weights or columns could move the estimate."""
    check_moved(experiment(), name, joint, **options)


@pytest.mark.usefixtures("estimates_only")
def test_conditions_with_different_standard_deviations_are_refused() -> None:
    robot, log = by_torque()
    doubted, _ = stated(by_torque(), "gear_ratio", "knee_pitch")
    pairs = {"cold": (robot, log), "warm": (doubted, log)}
    with pytest.raises(IdentificationError, match=r"'cold' and 'warm' .* gear ratio .*knee_pitch"):
        identify_conditions(pairs, cutoff_hz=4.0)


@pytest.mark.slow  # ten identifications of the leg
@pytest.mark.usefixtures("estimates_only")
def test_standard_errors_contain_those_of_the_sensor() -> None:
    """Without a sensor and with the torques their root mean square is 1.1 in these short logs."""
    far = []
    for seed in range(10):
        log = with_currents(leg_log(seed), ELASTIC, 0.02, seed)
        result = identify(by_current(), log, cutoff_hz=6.0)
        for joint in ELASTIC:
            names = ("stiffness", "viscous_friction", "coulomb_friction")
            true = {name: true_value(TRUTH, joint, name) for name in names}
            far.append(scores(result.drives[joint], {"torque_constant": 0.05, **true}))
    assert 0.88 < np.sqrt(np.mean(np.square(far))) < 1.3


@pytest.mark.parametrize("std_Nm", quick_first([None, 0.0]))
def test_known_bodies_count_in_the_torque_that_is_explained(std_Nm: float | None) -> None:
    """The load side has no parameter then; what it explains is the torque of the known bodies."""
    log = with_currents(by_torque()[1], ELASTIC, std_Nm)
    robot = by_current(*TRUTH.body_names)
    result = identify(robot, log, cutoff_hz=6.0, torque_joints=ELASTIC)
    assert len(result.load.values) == 0
    for joint in ELASTIC:
        assert result.joint_fits[joint].own < 0.01, joint
        assert result.drives[joint].value("torque_constant") == pytest.approx(0.05, rel=6e-3)
    assert not [one for one in result.warnings if one.code == "no-fit"]
