"""Every term of a drive in simulation: against its equations, mechanics known exactly, and back."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from seaid._arrays import Array
from seaid.drives import Drive, SeriesElasticDrive, StiffDrive, motor_equation, spring_equation
from seaid.drives.equations import DriveEquation, joint_equation
from seaid.errors import RobotError, SeaidError
from seaid.identification import identify
from seaid.legged import load_robot
from seaid.robot import Robot
from seaid.simulation import Noise, simulate
from seaid.simulation.forward_dynamics import advance, begin_of, gear_torques
from seaid.simulation.plant import JOINT_POSITION, JOINT_SPEED, POSITION, SPEED, Plant, plant_of
from seaid.simulation.simulation import measure, simulate_motion
from tests.experiments import wiggle
from tests.representatives import quick_first
from tests.simulation.swings import SLIDER, Chain, pendulum, run
from tests.terms import (
    DRY,
    ELASTIC,
    FULL,
    HEAVY,
    PARALLEL,
    SMOOTH,
    STIFF,
    arm,
    arm_of,
    elastic,
    stiff,
    value_of,
)

_STRIBECK = {"stribeck_friction": 0.02, "stribeck_speed": 5.0}
DRIVES: dict[str, Drive] = {
    "heavy": HEAVY,
    "smooth": SMOOTH,
    "full": FULL,
    "smooth load and stribeck": elastic(
        {"coulomb_width": 2.0, "coulomb_shift": 0.7, **_STRIBECK, "load_friction": 0.2},
        friction=("shifted_coulomb", "load", "stribeck"),
    ),
    "smooth coulomb": elastic({"coulomb_width": 2.0}, friction=("viscous", "smooth_coulomb")),
    "position": elastic(
        {"coulomb_position_slope": 0.004, "coulomb_position_curvature": 0.002},
        friction=(*DRY, "coulomb_position"),
    ),
    # without any function of a drive beside it
    "extra term stiff": replace(STIFF, extra_terms=("2e-4*theta_M'**2",)),
    "extra term elastic": replace(ELASTIC, extra_terms=("2e-4*theta_M'**2",)),
    "parallel": elastic(PARALLEL, parallel_spring=("linear", "preload")),
    "preload": elastic({"spring_offset": 1.0}, spring=("linear", "preload")),
    "damped dead zone": elastic(
        {"dead_zone": 0.01, "spring_damping": 0.5}, spring=("linear", "dead_zone", "damping")
    ),
    "fifth alone": elastic({"fifth_stiffness": 1e7}, spring=("fifth",)),
}


@cache
def equation_of(make: Callable[[Any], DriveEquation], drive: Drive) -> DriveEquation:
    return make(drive)


def residuals(robot: Robot, plant: Plant, state: Array, torque: Array) -> list[float]:
    """Return (7), (4b) and (8) with what acts beside them at a state that slips."""
    data = robot.model.createData()
    held, rates = begin = begin_of(plant, data, state, torque)
    assert np.all(held.slip != 0)
    motor, joint = rates[[SPEED, JOINT_SPEED]]
    position, speed = state[JOINT_POSITION], state[JOINT_SPEED]
    bodies = np.array(pin.rnea(robot.model, data, position, speed, joint))
    C, found = robot.transmission, []
    beside = [
        value_of(
            equation_of(joint_equation, robot.drives[name]),
            robot.drives[name],
            {"theta_L": position[index], "theta_L_dot": speed[index], "tau_L": 0.0},
        )
        for index, name in enumerate(robot.joint_names)
    ]
    on_drives = np.linalg.solve(C.T, bodies + beside)
    for index, name in enumerate(robot.joint_names):
        drive = robot.drives[name]
        by_name = {
            "theta_M": state[POSITION, index],
            "theta_M_dot": state[SPEED, index],
            "theta_M_ddot": motor[index],
            "theta_L": C[index] @ position,
            "theta_L_dot": C[index] @ speed,
            "tau_M": torque[index],
        }
        load = on_drives[index]
        by_name |= {"tau_L": load, "tau_G": load}
        found.append(float(value_of(equation_of(motor_equation, drive), drive, by_name)))
        if isinstance(drive, SeriesElasticDrive):
            found.append(float(value_of(equation_of(spring_equation, drive), drive, by_name)) / 100)
        else:
            assert gear_torques(plant, data, state, begin)[index] == pytest.approx(load)
            assert motor[index] == pytest.approx(drive.ratio * C[index] @ joint)
    return found


def random_state(robot: Robot, rng: np.random.Generator) -> Array:
    """Return a state in which everything moves, stiff motors with their joints."""
    state = np.empty((4, robot.n))
    state[JOINT_POSITION] = rng.uniform(-1, 1, robot.n)
    C = robot.transmission
    turning = rng.uniform(0.3, 1, robot.n) * rng.choice([-1, 1], robot.n)
    state[JOINT_SPEED] = np.linalg.solve(C, turning)
    ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
    state[POSITION] = ratio * (C @ state[JOINT_POSITION])
    state[SPEED] = ratio * (C @ state[JOINT_SPEED])
    for index, joint in enumerate(robot.joint_names):
        if joint in robot.elastic_joints:
            state[POSITION, index] += ratio[index] * rng.uniform(-0.05, 0.05)
            state[SPEED, index] += rng.uniform(1, 20)
    return state


@pytest.mark.parametrize("is_coupled", [False, True], ids=["", "coupled"])
@pytest.mark.parametrize("terms", DRIVES)
def test_accelerations_satisfy_the_equations(terms: str, is_coupled: bool, tmp_path: Path) -> None:
    drive = DRIVES[terms]
    for one, two in ((drive, ELASTIC), (STIFF, drive)):
        robot = arm_of(tmp_path, one, two, is_coupled)
        plant, rng = plant_of(robot), np.random.default_rng(0)
        for _ in range(4):
            state, torque = random_state(robot, rng), rng.uniform(-0.2, 0.2, 2)
            assert np.max(np.abs(residuals(robot, plant, state, torque))) < 1e-9


HYSTERESIS: dict[str, Drive] = {
    "stiff gear": stiff({"presliding_angle": 0.3}, friction=("viscous", "dahl", "load")),
    "elastic gear": elastic({"presliding_angle": 0.3}, friction=("viscous", "dahl", "load")),
    "spring": elastic(
        {"hysteresis_force": 0.5, "hysteresis_deflection": 0.003}, spring=("linear", "dahl")
    ),
}


@pytest.mark.slow  # 4.8 s
@pytest.mark.parametrize("kind", quick_first(HYSTERESIS, 2))
def test_hysteresis_follows_its_differential_equation(kind: str, tmp_path: Path) -> None:
    """The motor equation (7) holds along a simulated motion with a state by `solve_ivp`."""
    drive = HYSTERESIS[kind]
    if kind != "spring":
        drive = drive.with_values({"load_friction": 0.05})
    robot = arm(tmp_path, *((drive, ELASTIC) if kind == "stiff gear" else (STIFF, drive)))
    place = 0 if kind == "stiff gear" else 1
    plan = wiggle(robot, 2.0, (0.2, 0.3), (0.8, 1.1))
    motion = simulate_motion(robot, plan, rate_hz=500.0)
    values = drive.values
    motor, speed = motion.motor_position[:, place], motion.motor_velocity[:, place]
    d = motor / drive.ratio - motion.joint_position[:, place]
    v = np.gradient(d, motion.time) if kind == "spring" else speed
    width = values["hysteresis_deflection" if kind == "spring" else "presliding_angle"]

    def rate(time: float, z: Array) -> Array:
        now = np.interp(time, motion.time, v)
        return np.asarray((now - abs(now) * z) / width)

    z = solve_ivp(rate, (0, 2), [0.0], t_eval=motion.time, max_step=2e-3).y[0]
    force = values.get("stiffness", 0.0) * d
    direction = np.sign(speed) if kind == "spring" else z
    if kind == "spring":
        force = force + values["hysteresis_force"] * z
    elif kind == "stiff gear":
        assert motion.gear_torque is not None
        force = motion.gear_torque[:, place]
    load = values.get("load_friction", 0.0) * np.abs(force) / drive.ratio
    level = values["coulomb_friction"] + load
    needed = values["motor_inertia"] * motion.motor_acceleration[:, place] + force / drive.ratio
    needed += values["viscous_friction"] * speed + level * direction
    kept = (motion.time > 0.8) & (np.abs(speed) > 0.5)  # z forgets its start
    error = (motion.motor_torque[:, place] - needed)[kept]
    assert np.max(np.abs(error)) < 0.02 * values["coulomb_friction"]


@pytest.mark.slow  # 1.0 s
def test_a_stuck_motor_yields_like_its_bristles(write_chain: Chain) -> None:
    """Without gravity a small torque turns a motor by tau w / F, and lets it back when it goes."""
    drive = stiff({"presliding_angle": 0.5}, friction=("viscous", "dahl"))
    plant = plant_of(pendulum(write_chain, drive, g=0.0))
    assert plant.rows == 6
    loaded = run(plant, np.zeros((6, 1)), lambda t: np.array([min(t, 1.0) * 2e-4]), 3.0, 1e-3)
    assert loaded[-1, POSITION, 0] == pytest.approx(2e-4 * 0.5 / 0.02, rel=0.02)
    back = run(plant, loaded[-1], lambda _: np.zeros(1), 3.0, 1e-3)
    assert abs(back[-1, POSITION, 0]) < 0.02 * loaded[-1, POSITION, 0]  # z^2 w is left


def breaking_torque(plant: Plant, state: Array) -> float:
    """Return the motor torque at which a resting motor starts, raised by 0.2 N m/s."""
    states = run(plant, state, lambda t: np.array([0.2 * t]), 0.9, 1e-3)
    moving = states[:, SPEED, 0] > 0
    assert moving.any()
    first = int(np.argmax(moving))
    assert not np.any(states[:first, SPEED])
    return 0.2 * 1e-3 * (first - 1)


@pytest.mark.parametrize("make", [stiff, elastic])
@pytest.mark.parametrize(("terms", "expected"), [(DRY, 0.03), ((*DRY, "stribeck"), 0.05)])
def test_a_motor_breaks_loose_where_the_torque_passes_its_friction(
    write_chain: Chain, make: Callable[..., Drive], terms: tuple[str, ...], expected: float
) -> None:
    """Stribeck friction holds what Coulomb friction does not."""
    more = _STRIBECK if "stribeck" in terms else {}
    drive = make({**more, "coulomb_friction": 0.03}, friction=terms)
    plant = plant_of(pendulum(write_chain, drive, g=0.0))
    assert breaking_torque(plant, np.zeros((4, 1))) == pytest.approx(expected, abs=4e-4)


def test_a_released_motor_that_creeps_back_is_stopped(write_chain: Chain) -> None:
    """A speed below that of rest may be against the direction in which friction is released.

    A part of a step without length leaves it as it is: nothing is divided by its change.
    """
    drive = stiff({"coulomb_friction": 0.03}, friction=DRY)
    plant = plant_of(pendulum(write_chain, drive, g=0.0))
    state = np.zeros((4, 1))
    state[[SPEED, JOINT_SPEED], 0] = -5e-10, -5e-10 / drive.ratio
    torque = np.array([0.05])  # above the friction
    stopped = advance(plant, plant.model.createData(), state, torque, np.zeros(1), 0.0)
    assert stopped[SPEED, 0] == 0.0
    moved = advance(plant, plant.model.createData(), state, torque, np.zeros(1), 1e-3)
    assert moved[SPEED, 0] > 0.0


def test_loaded_gear_holds_more(write_chain: Chain) -> None:
    """At rest the load's torque G is behind the gear: it breaks at G/N + F_C + F_L |G|/N."""
    values = {"coulomb_friction": 0.04, "load_friction": 0.4}
    drive = replace(stiff(values, friction=(*DRY, "load")), gear_ratio=10.0)
    robot = pendulum(write_chain, drive)
    q = -0.5
    G = float(pin.rnea(robot.model, robot.model.createData(), *np.array([[q], [0.0], [0.0]]))[0])
    state = np.array([[10 * q], [0.0], [q], [0.0]])
    expected = G / 10 + 0.04 + 0.4 * abs(G) / 10
    assert 0.02 < abs(G) / 10 < 0.05
    assert breaking_torque(plant_of(robot), state) == pytest.approx(expected, abs=4e-4)


def test_stretched_spring_loads_the_friction_of_its_motor(write_chain: Chain) -> None:
    """The load is held by a spring of 120 N m/rad stretched by 0.02: 2.4 N m, 0.048 at the motor.

    The joint is turned so that it stays there: only the first instants count.
    """
    values = {"coulomb_friction": 0.03, "load_friction": 0.5}
    drive = elastic(values, friction=(*DRY, "load"))
    plant = plant_of(pendulum(write_chain, drive))
    data = plant.model.createData()
    state = np.array([[0.0], [0.0], [-0.02], [0.0]])
    level = 0.03 + 0.5 * 0.048
    for torque, slips in ((0.048 + level, 1), (0.048 - level, -1)):
        for part, direction in ((0.999, 0), (1.001, slips)):
            now = np.array([0.048 + part * (torque - 0.048)])
            assert begin_of(plant, data, state, now)[0].slip[0] == direction


def test_deflection_offset_of_encoder_zeros_does_not_act(write_chain: Chain) -> None:
    found = elastic({"spring_offset": 5.0})
    for drive in (found, replace(found, friction=(*DRY, "load")).with_values({"load_friction": 0})):
        plant = plant_of(pendulum(write_chain, drive, g=0.0))
        assert not np.any(run(plant, np.zeros((4, 1)), lambda _: np.zeros(1), 0.02, 1e-3))
    acting = replace(found, spring=("linear", "preload"))
    plant = plant_of(pendulum(write_chain, acting, g=0.0))
    assert np.any(run(plant, np.zeros((4, 1)), lambda _: np.zeros(1), 0.02, 1e-3))


def test_steep_friction_is_stepped_finely_and_absurd_friction_refused(write_chain: Chain) -> None:
    friction = ("viscous", "smooth_coulomb")
    steep = elastic({"coulomb_width": 0.05, "viscous_friction": 0.0}, friction=friction)
    plant = plant_of(pendulum(write_chain, steep))
    assert plant.longest_step == pytest.approx(1e-5 * 0.05 / 0.03, rel=1e-6)
    start = np.array([[0.0], [0.0], [0.05], [0.0]])
    sharp = plant_of(pendulum(write_chain, elastic({"viscous_friction": 0.0})))
    ends = [run(each, start, lambda _: np.zeros(1), 0.02, 1e-3)[-1] for each in (plant, sharp)]
    assert ends[0][POSITION] > 0.2
    assert ends[0] == pytest.approx(ends[1], rel=0.01)
    absurd = elastic({"coulomb_width": 1e-3}, friction=friction)
    with pytest.raises(
        RobotError, match=r"'swing': its friction has a time constant of 3\.3e-07 s"
    ):
        plant_of(pendulum(write_chain, absurd))


RUBBING = elastic(
    {"viscous_friction": 0.0, "coulomb_friction": 0.02, "joint_coulomb_friction": 1.0},
    joint_friction=("coulomb",),
)


def test_joint_is_held_by_its_own_friction_while_its_motor_moves(write_chain: Chain) -> None:
    """It breaks loose where the spring pulls with F_C of the joint: at theta = N F_C / k."""
    plant = plant_of(pendulum(write_chain, RUBBING, g=0.0))
    states = run(plant, np.zeros((4, 1)), lambda t: np.array([0.02 + 0.04 * t]), 0.6, 5e-4)
    motor, joint = states[:, POSITION, 0], states[:, JOINT_SPEED, 0]
    first = int(np.argmax(joint > 0))
    assert first > 100
    assert not np.any(states[:first, JOINT_POSITION])
    assert motor[first - 2] <= 50 / 120 <= motor[first]  # a step decides at its start
    assert np.all(joint[first:] > 0)


def test_held_joint_of_a_differential_stays_while_the_other_moves(write_chain: Chain) -> None:
    """Joint a rubs and stays: both motors pull b alone, through their springs."""
    drive = SeriesElasticDrive(
        gear_ratio=20.0, motor_inertia_kg_m2=1e-4, motor_pulley_radius_m=0.05, friction=()
    ).with_values({"stiffness": 3e3})
    rubbing = replace(drive, joint_friction=("coulomb",)).with_values(
        {"joint_coulomb_friction": 500.0}
    )
    robot, both, second = table(write_chain, rubbing, drive)
    plant = plant_of(robot)
    state = np.zeros((4, 2))
    state[POSITION] = [10.0, -10.0]
    states = run(plant, state, lambda _: np.zeros(2), 0.05, 1e-3)
    assert not np.any(states[:, JOINT_POSITION:, 0])
    force = 3e3 * 0.05 / 20 * 10.0
    data = plant.model.createData()
    held, rates = begin_of(plant, data, state, np.zeros(2))
    assert held.slip.tolist() == [1, 1, 0]
    assert rates[JOINT_SPEED] == pytest.approx([0.0, 2 * force / second])
    freed = begin_of(plant, data, state, np.zeros(2), np.ones(3))[1]
    assert freed[JOINT_SPEED] == pytest.approx(
        np.linalg.solve([[both, second], [second, second]], [-500.0, 2 * force])
    )


# Two sliders whose motors drive sum and difference: small enough to write down.


def table(write_chain: Chain, one: Drive, two: Drive) -> tuple[Robot, float, float]:
    """Return two sliders on one line, and the mass that each moves."""
    factors: list[dict[str, float]] = [{"a": 1.0, "b": 1.0}, {"a": 1.0, "b": -1.0}]
    drives = {
        name: replace(drive, transmission=row)
        for name, drive, row in zip("ab", (one, two), factors, strict=True)
    }
    robot = load_robot(write_chain({"a": SLIDER, "b": SLIDER}), drives)
    first, second = robot.parameters[[0, 10]]
    return robot, float(first + second), float(second)


SLIDING = StiffDrive(gear_ratio_rad_per_m=100.0, motor_inertia_kg_m2=1e-4, friction=DRY)
SLIDING = SLIDING.with_values({"viscous_friction": 1e-3, "coulomb_friction": 0.1})


def test_held_motor_of_a_differential_keeps_the_sum(write_chain: Chain) -> None:
    """With a + b held, a = -b = s: (m_a - 2 m_b + m_b + 4 N^2 I) s'' = 2 N (tau - F_C) at rest."""
    robot, both, second = table(write_chain, SLIDING, SLIDING)
    plant = plant_of(robot)
    states = run(plant, np.zeros((4, 2)), lambda _: np.array([0.0, 0.2]), 0.02, 1e-3)
    assert np.all(states[:, SPEED, 0] == 0)
    assert np.all(states[:, POSITION, 0] == 0)
    assert np.max(np.abs(states[:, JOINT_POSITION].sum(axis=1))) < 1e-15
    data = plant.model.createData()
    torque = np.array([0.0, 0.2])
    held, rates = begin_of(plant, data, states[0], torque)
    assert held.slip.tolist() == [0, 1]
    expected = 200 * (0.2 - 0.1) / (both - second + 4 * 100**2 * 1e-4)
    assert rates[JOINT_SPEED] == pytest.approx([expected, -expected])


@pytest.mark.parametrize("kind", ["current", "voltage"])
def test_motion_knows_the_torque_of_a_motor_that_is_logged_by_its_input(
    kind: Literal["current", "voltage"], tmp_path: Path
) -> None:
    """The log of that motor has the input in place of the torque."""
    constant = "torque_constant" if kind == "current" else "voltage_constant"
    robot = arm(tmp_path, STIFF, elastic({constant: 0.04}, motor_input=kind))
    motion = simulate_motion(robot, wiggle(robot, 0.2, (0.0, 0.0), (0.1, 0.1)), rate_hz=500.0)
    log = measure(robot, motion, Noise())
    assert np.all(np.isfinite(motion.motor_torque))
    assert np.array_equal(log.motor_torque[:, 0], motion.motor_torque[:, 0])
    assert np.all(np.isnan(log.motor_torque[:, 1]))
    inputs = {"current": log.motor_current, "voltage": log.motor_voltage}
    logged = inputs.pop(kind)
    assert logged is not None
    assert np.all(np.isnan(logged[:, 0]))
    assert logged[:, 1] == pytest.approx(motion.motor_torque[:, 1] / 0.04)
    assert list(inputs.values()) == [None]


def test_friction_under_load_above_one_does_not_settle(write_chain: Chain) -> None:
    drive = stiff({"load_friction": 5.0}, friction=(*DRY, "load"))
    plant = plant_of(pendulum(write_chain, drive))
    state = np.array([[40.0], [40.0], [1.0], [1.0]])
    with pytest.raises(SeaidError, match="load_friction must be well below one"):
        begin_of(plant, plant.model.createData(), state, np.zeros(1), np.ones(1))


_SENSORS = Noise(
    motor_resolution_rad=2 * np.pi / 2**16,
    joint_resolution_rad=2 * np.pi / 2**21,
    torque_std_Nm=0.0005,
)

_CUTOFF_HZ = 15.0
"""Reversals of friction are faster than the motion: behind a filter at 4 Hz they look wider."""

EXPERIMENTS: dict[str, tuple[Drive, Drive]] = {
    "load, cubic, current": (
        stiff({"load_friction": 0.08}, friction=(*DRY, "load")),
        elastic(
            {"stiffness": 30.0, "cubic_stiffness": 4e3, "torque_constant": 0.05},
            spring=("linear", "cubic"),
            motor_input="current",
        ),
    ),
    "quadratic, parallel, dead zone": (
        stiff(
            {"quadratic_friction": 1e-5, "parallel_stiffness": 3.0, "parallel_preload": 1.0},
            friction=(*DRY, "quadratic"),
            parallel_spring=("linear", "preload"),
        ),
        elastic({"dead_zone": 0.01}, spring=("linear", "dead_zone")),
    ),
    "preload, load of a spring, joint friction": (
        STIFF,
        elastic(
            {
                "load_friction": 0.08,
                "spring_offset": 1.0,
                "joint_viscous_friction": 0.1,
                "joint_coulomb_friction": 0.15,
            },
            friction=(*DRY, "load"),
            spring=("linear", "preload"),
            joint_friction=("viscous", "coulomb"),
        ),
    ),
}


@pytest.mark.slow  # six seconds of two drives, simulated step by step
@pytest.mark.parametrize("terms", EXPERIMENTS)
def test_what_was_simulated_is_found_again(terms: str, tmp_path: Path) -> None:
    """What the terms bring is within three of its standard errors, which are small."""
    robot = arm(tmp_path, *EXPERIMENTS[terms])
    trajectory = wiggle(robot, 6.0, (0.0, 0.0), (1.2, 1.5))
    log = simulate(robot, trajectory, rate_hz=500.0, noise=_SENSORS, seed=1)
    found = identify(robot.without_nominal(), log, cutoff_hz=_CUTOFF_HZ)
    for joint, estimate in found.drives.items():
        drive = robot.drives[joint]
        plain = STIFF if isinstance(drive, StiffDrive) else ELASTIC
        wanted = [name for name, one in drive.values.items() if plain.values.get(name) != one]
        assert set(wanted) <= set(estimate.names)
        for name in wanted:
            truth, error = drive.values[name], estimate.standard_error(name)
            assert abs(estimate.value(name) - truth) < 3 * error, (joint, name)
            assert error < 0.2 * abs(truth), (joint, name, error)
        friction = drive.values["viscous_friction"]
        assert estimate.value("viscous_friction") == pytest.approx(friction, rel=0.04)
