"""Simulated experiments with known truth, each run once a session and shared by the tests.

A true motion is what costs time; logs with any sensors and seeds are measured from it.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid.drives import Drive, StiffDrive
from seaid.excitation import Trajectory, make_basis
from seaid.identification import Identification, Validation, identify, validate
from seaid.legged import load_robot
from seaid.log import Log, Motion
from seaid.robot import Payload, Robot
from seaid.simulation import Noise, simulate
from seaid.simulation.simulation import measure, simulate_motion
from tests.plants import kept
from tests.standard_errors import scores

MODELS = Path(__file__).parents[1] / "models"
DATA = Path(__file__).parent / "data"
States = tuple[Array, Array, Array]
TEST_MASS = Payload("foot", 2.0, (0.15, 0.0, 0.0))
ELASTIC = ("hip_pitch", "knee_pitch", "ankle_pitch")

LEG_SENSORS = Noise(
    motor_resolution_rad=2 * np.pi / 2000,
    joint_resolution_rad=2 * np.pi / 2**14,
    motor_offset_rad=(1.0, -2.0, 0.5, 3.0, -1.5),
    torque_std_Nm=(0.005, 0.005, 0.005, 0.006, 0.006),
)

ARM_SENSORS = Noise(
    motor_resolution_rad=2 * np.pi / 2000,
    joint_resolution_rad=(1e-5, 2 * np.pi / 2**14, 1e-5, 2 * np.pi / 2**14),
    motor_offset_rad=(1.0, 2.0, -3.0, 4.0),
    torque_std_Nm=0.003,
)


def wiggle(
    robot: Robot,
    duration: float,
    middle: tuple[float, ...],
    reach: tuple[float, ...],
    *,
    knot_s: float = 0.35,
    seed: int = 0,
) -> Trajectory:
    """Return a smooth random motion, rest to rest, within middle +- reach."""
    basis = make_basis("bspline", duration, round(duration / knot_s) + 5)
    random = np.random.default_rng(seed).uniform(-1, 1, (basis.size - 4, robot.n))
    # three equal control points at either end: rest
    coefficients = np.pad(middle + np.array(reach) * random, ((2, 2), (0, 0)), mode="edge")
    sliding = tuple(np.array(robot.joint_names)[list(robot.is_prismatic)].tolist())
    return Trajectory(robot.joint_names, basis, coefficients, sliding)


@cache
def leg(*payloads: Payload) -> Robot:
    """Return the true TULip leg."""
    return load_robot(MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml", payloads=payloads)


def leg_trajectory(seed: int = 0) -> Trajectory:
    middle, reach = (0.0, 0.0, -0.2, 0.7, 0.0), (0.8, 0.6, 0.7, 0.7, 1.1)
    return wiggle(leg(), 6.0, middle, reach, seed=seed)


@kept
def leg_motion(*payloads: Payload, seed: int = 0) -> Motion:
    """Return the true motion of six seconds with the leg."""
    return simulate_motion(leg(*payloads), leg_trajectory(seed))


@cache
def arm() -> Robot:
    """Return the true mixed arm: stiff rail, rotary spring, elastic telescope, stiff wrist."""
    return load_robot(DATA / "mixed_arm.urdf", DATA / "mixed_arm.toml")


def arm_motion(seed: int = 0) -> Motion:
    """Return the true motion of six seconds with the mixed arm."""
    return _arm_motion(seed)


@kept
def _arm_motion(seed: int) -> Motion:
    middle, reach = (0.0, 0.3, 0.15, 0.0), (0.4, 0.8, 0.2, 0.9)
    return simulate_motion(arm(), wiggle(arm(), 6.0, middle, reach, seed=seed))


@cache
def leg_log(seed: int = 1, *, motion_seed: int = 0) -> Log:
    """Return a log of the leg with the test mass by its sensors."""
    return measure(leg(TEST_MASS), leg_motion(TEST_MASS, seed=motion_seed), LEG_SENSORS, seed)


@cache
def arm_log(seed: int = 1, *, motion_seed: int = 0) -> Log:
    """Return a log of the mixed arm by its sensors."""
    return measure(arm(), arm_motion(motion_seed), ARM_SENSORS, seed)


@kept
def arm_found() -> Identification:
    """Return the mixed arm identified from a simulated log: stiff, elastic, sliding joints."""
    found = identify(arm().without_nominal(), arm_log())
    assert found.setup, "it is kept for all tests, and a test that leaves out findings made it"
    return found


@kept
def arm_result() -> Validation:
    """Return its validation on another motion."""
    return validate(arm_found(), arm_log(2, motion_seed=5))


def motion_of(
    robot: Robot,
    time: Array,
    joint: States,
    motor: States,
    torque: Array | None = None,
    **more: Any,
) -> Motion:
    """Return an unfiltered motion of positions, speeds and accelerations on both sides."""
    q, v, a = joint
    nothing = np.full_like(q, np.nan)
    return Motion(
        time=time,
        joint_names=robot.joint_names,
        joint_position=q,
        joint_velocity=v,
        joint_acceleration=a,
        motor_position=motor[0],
        motor_velocity=motor[1],
        motor_acceleration=motor[2],
        motor_torque=nothing if torque is None else torque,
        **{"joint_torque": nothing, "cutoff_hz": np.inf, **more},
    )


def perfect_log(robot: Robot, motion: Motion) -> Log:
    """Return the log of sensors without any error."""
    return measure(robot, motion, Noise())


def true_value(robot: Robot, joint: str, name: str) -> float:
    """Return the true value of a drive's parameter by the name of its estimate."""
    return float(robot.drives[joint].values[name])


def with_named_friction(robot: Robot) -> Robot:
    """Return a robot with the friction terms of its drives named, so that none is added to them."""
    drives: dict[str, Drive] = {
        joint: replace(drive, friction=tuple(drive.friction))
        for joint, drive in robot.drives.items()
    }
    return robot.with_drives(drives)


def with_drive(robot: Robot, joint: str, **fields: Any) -> Robot:
    """Return a robot whose drive of a joint has other fields."""
    return robot.with_drives({joint: replace(robot.drives[joint], **fields)})


def drive_errors(found: Identification, truth: Robot, *names: str) -> dict[str, float]:
    """Return {'stiffness of knee_pitch': relative error} of what was found."""
    return {
        f"{name} of {joint}": estimate.value(name) / true_value(truth, joint, name) - 1
        for joint, estimate in found.drives.items()
        for name in names
        if name in estimate.names
    }


def drive_scores(found: Identification, truth: Robot, *names: str) -> Array:
    """Return the errors of drives over their standard errors, of those names that were found."""
    return np.concatenate(
        [
            scores(
                estimate, {x: truth.drives[joint].values[x] for x in names if x in estimate.names}
            )
            for joint, estimate in found.drives.items()
        ]
    )


def scores_of_drive(found: Identification, truth: Robot, joint: str) -> Array:
    """Return the errors of all parameters of a drive, zero where the true drive has none."""
    values = truth.drives[joint].values
    return scores(found.drives[joint], {x: values.get(x, 0.0) for x in found.drives[joint].names})


def load_scores(found: Identification, truth: Robot) -> Array:
    """Return the errors of the base parameters over their standard errors."""
    error = found.load.values - found.base.project(truth.parameters)
    return np.asarray(error / found.load.standard_errors)


def all_scores(found: Identification, truth: Robot) -> Array:
    """Return all errors of an identification over their standard errors."""
    drives = (scores_of_drive(found, truth, joint) for joint in found.drives)
    return np.concatenate([load_scores(found, truth), *drives])


@cache
def true_geared_arm() -> Robot:
    """Return the UR10 with rotors that have more inertia at the joints than its wrist."""
    plain = load_robot("ur10", snap_tolerance_rad=0)
    sizes = zip((1.2, 1.4, 0.6, 0.12, 0.12, 0.05), (25, 24, 12, 3, 3, 2), strict=True)
    drives = {
        joint: StiffDrive(
            gear_ratio=1.0,
            motor_inertia_kg_m2=inertia,
            viscous_friction_Nms_per_rad=viscous,
            coulomb_friction_Nm=0.4 * viscous,
        )
        for joint, (inertia, viscous) in zip(plain.joint_names, sizes, strict=True)
    }
    return load_robot("ur10", drives, snap_tolerance_rad=0)


@kept
def geared_arm_log() -> Log:
    """Return the log of an arm: torques of its motors at the joints, and no motor encoders."""
    truth = true_geared_arm()
    motion = wiggle(truth, 10.0, (0.0, -1.2, 1.0, 0.0, 0.5, 0.0), (0.8,) * 6)
    log = simulate(truth, motion, rate_hz=250, noise=Noise(torque_std_Nm=0.05))
    unknown = np.full_like(log.motor_position, np.nan)
    return replace(log, joint_position=log.motor_position, motor_position=unknown)
