"""The plant and the sensors against mechanics that is known exactly."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.drives import Drive, SeriesElasticDrive, StiffDrive
from seaid.errors import RobotError, SeaidError
from seaid.excitation import Trajectory, make_basis
from seaid.legged import load_robot
from seaid.log import Log
from seaid.robot import Robot
from seaid.simulation import Noise, simulate
from seaid.simulation.plant import JOINT_POSITION, JOINT_SPEED, POSITION, SPEED, Plant, plant_of
from seaid.simulation.simulation import measure
from tests.experiments import arm, arm_motion, leg, wiggle
from tests.simulation.swings import SLIDER, Chain, pendulum, run

SPRING = SeriesElasticDrive(gear_ratio=50.0, motor_inertia_kg_m2=1e-5).with_values(
    {"stiffness": 40.0, "viscous_friction": 0.0, "coulomb_friction": 0.02}
)
STIFF = StiffDrive(gear_ratio=50.0, motor_inertia_kg_m2=1e-5).with_values(
    {"viscous_friction": 0.0, "coulomb_friction": 0.3}
)
STEP_S = 5e-4


def run_of_one(
    plant: Plant, state: Array, torque: Callable[[float], float], duration: float, step: float
) -> Array:
    """Return the states (T, 4) of one joint under a motor torque of time."""
    return run(plant, state, lambda t: np.array([torque(t)]), duration, step)[:, :, 0]


def at_rest() -> Array:
    return np.zeros((4, 1))


def test_motor_sticks_while_friction_can_hold_it(write_chain: Chain) -> None:
    """Behind a spring its load swings on; a stiff joint is held against gravity without creep."""
    state = at_rest()
    state[JOINT_SPEED] = 0.3
    plant = plant_of(pendulum(write_chain, SPRING))
    states = run_of_one(plant, state, lambda t: 0.004 * np.sin(30 * t), 0.5, STEP_S)
    assert not np.any(states[:, [SPEED, POSITION]])
    assert np.ptp(states[:, JOINT_POSITION]) > 0.01
    state = at_rest()
    state[JOINT_POSITION], state[POSITION] = 0.4, 20.0
    plant = plant_of(pendulum(write_chain, STIFF))
    states = run_of_one(plant, state, lambda t: 0.1 * np.sin(30 * t), 0.3, STEP_S)
    assert np.all(states[:, SPEED] == 0.0)
    assert np.all(states[:, JOINT_POSITION] == 0.4)


def test_slider_stops_where_friction_says_and_stays(write_chain: Chain) -> None:
    """v^2 = 2 a x under dry friction alone, which brakes evenly."""
    drive = replace(STIFF, gear_ratio=None, gear_ratio_rad_per_m=100.0)
    robot = load_robot(write_chain({"slide": SLIDER}), {"slide": drive})
    mass = robot.parameters[0] + 100.0**2 * 1e-5
    state = at_rest()
    state[JOINT_SPEED], state[SPEED] = 0.9, 90.0
    states = run_of_one(plant_of(robot), state, lambda _: 0.0, 0.2, 1e-3)
    brake = 100.0 * 0.3 / mass
    assert 0.9 / brake < 0.15
    assert states[-1, JOINT_POSITION] == pytest.approx(0.9**2 / (2 * brake), rel=1e-9)
    assert np.all(states[-40:, SPEED] == 0.0)
    assert states[-1, POSITION] == pytest.approx(100 * states[-1, JOINT_POSITION], rel=1e-9)


def test_halving_the_step_shows_the_fourth_order(write_chain: Chain) -> None:
    plant = plant_of(pendulum(write_chain, replace(SPRING, coulomb_friction_Nm=0.0)))
    state = at_rest()
    state[JOINT_POSITION] = 1.0
    runs = [
        run_of_one(plant, state, lambda t: 0.1 * t, 0.32, 1e-3 / 2**halving) for halving in range(3)
    ]
    steps = [np.max(np.abs(coarse - fine[::2])) for coarse, fine in pairwise(runs)]
    assert steps[0] / steps[1] == pytest.approx(16, rel=0.1)


def test_robot_follows_its_trajectory() -> None:
    motion = arm_motion()
    middle, reach = (0.0, 0.3, 0.15, 0.0), (0.4, 0.8, 0.2, 0.9)
    planned = wiggle(arm(), 6.0, middle, reach).sample(motion.time)[0]
    assert np.max(np.abs(motion.joint_position - planned)) < 0.03


def short(robot: Robot, duration: float = 0.2) -> Trajectory:
    basis = make_basis("bspline", duration, 8)
    random = np.random.default_rng(0).uniform(-0.1, 0.1, (8, robot.n))
    random[:3], random[-3:] = random[:1], random[-1:]
    return Trajectory(robot.joint_names, basis, random)


@pytest.mark.slow  # 0.9 s
def test_same_seed_gives_the_same_log_and_another_only_other_torque_noise(
    write_chain: Chain,
) -> None:
    robot = pendulum(write_chain, SPRING)
    noise = Noise(motor_resolution_rad=0.01, torque_std_Nm=0.01)
    logs = [simulate(robot, short(robot), noise=noise, seed=seed) for seed in (3, 3, 4)]
    for field in ("time", "motor_position", "joint_position", "motor_torque"):
        assert np.array_equal(getattr(logs[0], field), getattr(logs[1], field))
    assert np.array_equal(logs[0].motor_position, logs[2].motor_position)
    assert not np.any(logs[0].motor_torque == logs[2].motor_torque)


def test_encoders_read_whole_steps_from_a_shifted_zero() -> None:
    steps, zeros = (1e-3, 0.0, 2e-3, 5e-3), (0.5, -0.1, 0.0, 3.0)
    noise = Noise(motor_resolution_rad=steps, motor_offset_rad=zeros, joint_offset_rad=0.01)
    motion = arm_motion()
    log = measure(arm(), motion, noise)
    shifted = motion.motor_position + zeros
    assert np.array_equal(log.motor_position[:, 1], shifted[:, 1])
    for joint in (0, 2, 3):
        counts = log.motor_position[:, joint] / steps[joint]
        assert np.max(np.abs(counts - np.round(counts))) < 1e-6
        error = log.motor_position[:, joint] - shifted[:, joint]
        assert np.max(np.abs(error)) <= 0.5 * steps[joint] * (1 + 1e-9)
    assert np.array_equal(log.joint_position, motion.joint_position + 0.01)
    perfect = measure(arm(), motion, Noise())
    for name in ("motor_position", "joint_position", "motor_torque"):
        assert np.array_equal(getattr(perfect, name), getattr(motion, name))
    assert log.joint_torque is None
    assert log.is_prismatic == (True, False, True, False)


def test_torque_noise_is_white_and_as_large_as_asked() -> None:
    stds = np.array([0.1, 0.2, 0.0, 0.4])
    motion = arm_motion()
    noise = measure(arm(), motion, Noise(torque_std_Nm=tuple(stds)), seed=1).motor_torque
    noise = noise - motion.motor_torque
    assert np.std(noise, axis=0) == pytest.approx(stds, rel=0.03)
    lagged = np.sum(noise[1:] * noise[:-1], axis=0)[[0, 1, 3]]
    assert np.max(np.abs(lagged / np.sum(noise**2, axis=0)[[0, 1, 3]])) < 0.05


@pytest.mark.parametrize(("rate_hz", "duration"), [(200.0, 0.3), (1000.0, 0.2006)])
def test_rate_of_the_log(rate_hz: float, duration: float, write_chain: Chain) -> None:
    """It ends within a motion that does not rest at its end."""
    robot = pendulum(write_chain, replace(SPRING, friction=("viscous",), coulomb_friction_Nm=None))
    free = Trajectory(
        ("swing",), make_basis("bspline", duration, 8), np.linspace(0, 0.1, 8)[:, None]
    )
    log = simulate(robot, free, rate_hz=rate_hz)
    assert np.diff(log.time) == pytest.approx(1 / rate_hz)
    assert log.time[[0, -1]] == pytest.approx([0.0, round(duration, 1)])


@pytest.mark.parametrize(
    ("drive", "words"),
    [
        (
            replace(SPRING, stiffness_Nm_per_rad=None),
            "joint 'swing': 'stiffness_Nm_per_rad' is not given; a ",
        ),
        (replace(STIFF, coulomb_friction_Nm=None), "'coulomb_friction_Nm' is not given"),
        (replace(SPRING, motor_inertia_kg_m2=0.0), "'swing': an elastic drive needs a motor iner"),
        (
            replace(STIFF, friction=("viscous", "smooth_coulomb")),
            "'coulomb_width_rad_per_s' is not given; a simulation needs a nominal",
        ),
        (replace(STIFF, friction=("coulomb", "load")), "'load_friction' is not given"),
        (replace(SPRING, spring=("linear", "cubic")), "'cubic_stiffness_Nm_per_rad3' is not giv"),
        (replace(SPRING, joint_friction=("viscous",)), "'joint_viscous_friction_Nms_per_rad' is"),
        (replace(STIFF, motor_input="current"), "'torque_constant_Nm_per_A' is not given, or zer"),
    ],
)
def test_drives_that_cannot_be_simulated_are_named(
    drive: Drive, words: str, write_chain: Chain
) -> None:
    robot = pendulum(write_chain, drive)
    with pytest.raises(RobotError, match=words):
        simulate(robot, short(robot))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: simulate(leg().without_nominal(), short(leg())), "has no inertial parameters: it"),
        (lambda: simulate(leg(), short(leg()), rate_hz=0.0), "finite and more than 0.1, found 0"),
        (lambda: simulate(leg(), short(leg()), rate_hz=np.inf), "rate_hz must be finite and"),
        (
            lambda: simulate(leg(), short(arm())),
            r"rail, shoulder, telescope, wrist, but .* hip_yaw",
        ),
        (lambda: noisy(1e308), r"Noise\.torque_std_Nm must be from -1e\+09 to 1e\+09"),
        (lambda: noisy(np.nan), r"Noise\.torque_std_Nm must be from -1e\+09 to 1e\+09"),
        (lambda: noisy((0.1, 0.2)), r"Noise\.torque_std_Nm must have shape \(4\)"),
    ],
)
def test_what_cannot_be_simulated_is_said(make: Callable[[], object], words: str) -> None:
    with pytest.raises(SeaidError, match=words):
        make()


def noisy(std: float | tuple[float, ...]) -> Log:
    return measure(arm(), arm_motion(), Noise(torque_std_Nm=std))
