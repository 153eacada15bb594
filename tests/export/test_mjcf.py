"""write_mjcf: MuJoCo's accelerations and motions are the library's own, and what is refused.

MuJoCo's RK4 and the plant's are the same scheme: with the same steps and the same held torque they
differ by rounding only, which shows that the models are the same but nothing of how accurate either
is; so the plant is also run with other steps.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid.arrays import Array
from seaid.drivetrain.model import Drive, SeriesElasticDrive, StiffDrive
from seaid.export.mjcf import write_mjcf
from seaid.plant import accelerations, advance, plant_of
from seaid.robot import Robot, load_robot
from tests.experiments import MODELS, TEST_MASS, arm, arm_motion, leg, leg_motion
from tests.terms import ELASTIC, STIFF, with_terms
from tests.terms import arm as two_joints

mujoco = pytest.importorskip("mujoco")

LIMIT = '<limit lower="-3" upper="3" effort="9" velocity="9"/>'
TURN = f'revolute <axis xyz="0 0.6 0.8"/>{LIMIT}'
SLIDE = f'prismatic <axis xyz="0 0.6 0.8"/>{LIMIT}'


def without_friction(robot: Robot) -> Robot:
    drives = robot.drivetrains.items()
    return robot.with_drivetrains(
        {joint: replace(drive, coulomb_friction_Nm=0.0) for joint, drive in drives}
    )


def loaded(robot: Robot, folder: Path) -> Any:
    return mujoco.MjModel.from_xml_path(str(write_mjcf(robot, folder / "robot.xml").path))


class Twin:
    """The same robot in MuJoCo and as a plant; states (4, n) and torques in the plant's order."""

    def __init__(self, robot: Robot, folder: Path) -> None:
        self.model = loaded(robot, folder)
        self.data = mujoco.MjData(self.model)
        self.plant = plant_of(robot)
        self.names = [robot.joint_names[index] for index in robot.model_order]
        elastic = zip(self.names, self.plant.elastic, strict=True)
        self.motors = [f"{name}_motor" if is_elastic else name for name, is_elastic in elastic]
        self.turned = np.eye(robot.n) if self.plant.coupling is None else self.plant.coupling

    def put(self, state: Array) -> None:
        for index, name in enumerate(self.names):
            if self.plant.elastic[index]:
                motor = self.data.joint(self.motors[index])
                motor.qpos, motor.qvel = state[0, index], state[1, index]
            self.data.joint(name).qpos = state[2, index]
            self.data.joint(name).qvel = state[3, index]

    def set_torque(self, torque: Array) -> None:
        for name, value in zip(self.names, torque, strict=True):
            self.data.actuator(name).ctrl = value

    def accelerations(self, torque: Array) -> tuple[Array, Array]:
        self.set_torque(torque)
        mujoco.mj_forward(self.model, self.data)
        joint = np.array([self.data.joint(name).qacc[0] for name in self.names])
        motor = np.array([self.data.joint(name).qacc[0] for name in self.motors])
        stiff = ~self.plant.elastic
        motor[stiff] = (self.plant.ratio * (self.turned @ joint))[stiff]
        return motor, joint

    def positions(self) -> Array:
        return np.array([self.data.joint(name).qpos[0] for name in self.names])

    def random_state(self, rng: np.random.Generator) -> Array:
        """Return a random state with springs stretched by up to 0.05 of their units."""
        plant, joint = self.plant, rng.uniform(-1, 1, (2, len(self.names)))
        behind = np.where(plant.elastic, plant.load_radius, 1.0) * (joint @ self.turned.T)
        stretch = np.where(plant.elastic, rng.uniform(-0.05, 0.05, joint.shape), 0.0)
        radius = np.where(plant.elastic, plant.motor_radius, 1.0)
        motor = (behind + stretch) * plant.ratio / radius
        return np.array([*motor, *joint])


def acceleration_errors(twin: Twin, states: int = 10, seed: int = 0) -> float:
    """Return the largest relative difference of accelerations at random states, slipping."""
    rng, data = np.random.default_rng(seed), twin.plant.model.createData()
    largest = 0.0
    for _ in range(states):
        state, torque = twin.random_state(rng), rng.uniform(-0.2, 0.2, len(twin.names))
        slip = np.sign(state[1])
        expected = accelerations(twin.plant, data, state, torque, slip)
        twin.put(state)
        for found, own in zip(twin.accelerations(torque), expected, strict=True):
            largest = max(largest, float(np.max(np.abs(found - own)) / np.max(np.abs(own))))
    return largest


def rigid_errors(robot: Robot, model: Any, states: int = 5) -> float:
    """Return the largest relative difference of mass matrix and bias torques of the joints."""
    data, own, rng = mujoco.MjData(model), robot.model.copy(), np.random.default_rng(0)
    own_data, plant = own.createData(), plant_of(robot)
    own.armature = plant.model.armature
    names = [own.names[index] for index in range(1, own.njoints)]
    places = [model.joint(name).dofadr[0] for name in names]
    largest = 0.0
    for _ in range(states):
        q, v = rng.uniform(-1, 1, (2, robot.n))
        for name, position, speed in zip(names, q, v, strict=True):
            data.joint(name).qpos, data.joint(name).qvel = position, speed
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        upper = np.triu(pin.crba(own, own_data, q))
        mass, bias = upper + np.triu(upper, 1).T, pin.nle(own, own_data, q, v)
        for found, expected in (
            (full[np.ix_(places, places)], mass),
            (data.qfrc_bias[places], bias),
        ):
            error = float(np.max(np.abs(found - expected)) / (np.max(np.abs(expected)) + 1e-9))
            largest = max(largest, error)
    return largest


# Bodies


def test_mass_matrix_and_bias_torques_are_those_of_the_robot(tmp_path: Path) -> None:
    reordered = load_robot(
        MODELS / "tulip_leg.urdf",
        MODELS / "tulip_leg.toml",
        joints=("ankle_pitch", "hip_roll", "knee_pitch", "hip_yaw"),
        gravity=(1.0, -2.0, -9.0),
    )
    for robot in (leg(), leg(TEST_MASS), arm(), reordered):
        assert rigid_errors(robot, loaded(robot, tmp_path)) < 1e-9


EXAMPLES = ("ur10_robot.urdf", "panda.urdf", "kinova.urdf", "double_pendulum.urdf")


@pytest.mark.parametrize("name", EXAMPLES)
def test_robots_of_others_have_their_mass_matrix_and_bias_torques(
    name: str, tmp_path: Path, example_path: Callable[[str], Path]
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = load_robot(example_path(name))
    assert rigid_errors(robot, loaded(robot, tmp_path)) < 1e-9


# Drives


@pytest.mark.parametrize("payloads", [(), (TEST_MASS,)])
def test_accelerations_are_the_plants(payloads: tuple[Any, ...], tmp_path: Path) -> None:
    assert acceleration_errors(Twin(without_friction(leg(*payloads)), tmp_path)) < 1e-9
    assert acceleration_errors(Twin(without_friction(arm()), tmp_path)) < 1e-9


VISCOUS = ("viscous",)


def stiff(values: Mapping[str, float], **terms: Any) -> Drive:
    drive: Drive = with_terms(STIFF, {"friction": VISCOUS, **terms}, values)
    return drive


def elastic(values: Mapping[str, float], **terms: Any) -> Drive:
    drive: Drive = with_terms(ELASTIC, {"friction": VISCOUS, **terms}, values)
    return drive


PULLED = {"parallel_stiffness": 7.0, "parallel_preload": -1.5}
TERMS: dict[str, Drive] = {
    "damping": elastic({"spring_damping": 0.4}, spring=("linear", "damping")),
    "preload": elastic({"deflection_offset": 2.0}, spring=("linear", "preload")),
    "dead zone": elastic(
        {"dead_zone": 0.02, "deflection_zero": 0.01, "spring_damping": 0.1},
        spring=("linear", "dead_zone", "damping"),
    ),
    "parallel spring": elastic(PULLED, parallel_spring=("linear", "preload")),
    "joint friction": elastic({"joint_viscous_friction": 0.3}, joint_friction=("viscous",)),
    "parallel spring of a stiff drive": stiff(PULLED, parallel_spring=("linear", "preload")),
}


@pytest.mark.parametrize("name", TERMS)
def test_accelerations_with_every_term_that_mujoco_has(name: str, tmp_path: Path) -> None:
    other = STIFF if isinstance(TERMS[name], SeriesElasticDrive) else ELASTIC
    robot = two_joints(tmp_path, replace(other, friction=VISCOUS), TERMS[name])
    assert acceleration_errors(Twin(robot, tmp_path), 30) < 1e-9


@pytest.mark.parametrize("make", [stiff, elastic])
def test_accelerations_with_drives_that_move_several_joints(make: Any, tmp_path: Path) -> None:
    one = make(PULLED, parallel_spring=("linear", "preload"), transmission={"one": 1, "two": 1})
    two = make({}, transmission={"one": 0.5, "two": -1.0})
    robot = two_joints(tmp_path, one, two)
    assert acceleration_errors(Twin(robot, tmp_path)) < 1e-9


@given(
    kinds=st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=4),
    ratio=st.floats(2, 150),
    stiffness=st.floats(10, 1e4),
    inertia=st.floats(1e-6, 1e-3),
)
def test_accelerations_of_chains_of_any_joints_and_drives(
    kinds: list[tuple[bool, bool]],
    ratio: float,
    stiffness: float,
    inertia: float,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = tmp_path_factory.mktemp("chain")
    robot = chain(folder, kinds, ratio, stiffness, inertia)
    assert acceleration_errors(Twin(robot, folder), 3) < 1e-9


def chain(
    folder: Path, kinds: list[tuple[bool, bool]], ratio: float, stiffness: float, inertia: float
) -> Robot:
    """Return a chain of joints that slide or turn (first), with a spring or stiff (second)."""
    shared: dict[str, Any] = {"motor_inertia_kg_m2": inertia, "viscous_friction_Nms_per_rad": 1e-4}
    rows, drives, parent = ['<link name="base"/>'], dict[str, Drive](), "base"
    for number, (slides, has_spring) in enumerate(kinds):
        joint, link = f"j{number}", f"l{number}"
        kind, _, elements = (SLIDE if slides else TURN).partition(" ")
        rows.append(
            f'<joint name="{joint}" type="{kind}"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="0.1 0.2 0.3" rpy="{number} 0.4 -0.2"/>{elements}</joint>'
            f'<link name="{link}"><inertial><origin xyz="0.05 0.02 -0.1" rpy="0.1 0.2 0.3"/>'
            '<mass value="1.5"/><inertia ixx="0.02" iyy="0.015" izz="0.01" ixy="0.001" '
            'ixz="-0.002" iyz="0.0015"/></inertial></link>'
        )
        if not has_spring:
            key = "gear_ratio_rad_per_m" if slides else "gear_ratio"
            drives[joint] = StiffDrive(friction=VISCOUS, **{key: ratio, **shared})
        elif slides:
            drives[joint] = SeriesElasticDrive(
                gear_ratio=ratio,
                motor_pulley_radius_m=0.02,
                stiffness_N_per_m=stiffness,
                friction=VISCOUS,
                **shared,
            )
        else:
            drives[joint] = SeriesElasticDrive(
                gear_ratio=ratio, stiffness_Nm_per_rad=stiffness, friction=VISCOUS, **shared
            )
        parent = link
    path = folder / "chain.urdf"
    path.write_text(f'<robot name="chain">{"".join(rows)}</robot>')
    return load_robot(path, drives)


# Motions


def stiff_arm() -> Robot:
    return load_robot(MODELS / "philips_arm.urdf", MODELS / "philips_arm.toml")


def torques_of(robot: Robot, duration: float, step: float) -> tuple[Array, Array]:
    """Return a start (4, n) and motor torques (T, n) that move it much, as an experiment does."""
    if robot.name in ("tulip_leg", "mixed_arm"):
        motion = leg_motion() if robot.name == "tulip_leg" else arm_motion()
        time = np.arange(round(duration / step)) * step
        start = (motion.motor_position, motion.joint_position)
        columns = [np.interp(time, motion.time, column) for column in motion.motor_torque.T]
        still = np.zeros(robot.n)
        return np.array([start[0][0], still, start[1][0], still]), np.array(columns).T
    rng, time = np.random.default_rng(0), np.arange(round(duration / step)) * step
    ratio = np.array([robot.drivetrains[joint].ratio for joint in robot.joint_names])
    waves = np.sin(2 * np.pi * time[:, None] * rng.uniform(0.5, 2, robot.n) + rng.uniform(size=1))
    return np.zeros((4, robot.n)), 4.0 / ratio * waves


def run(
    robot: Robot, folder: Path, duration: float, parts: int, slower: int = 1
) -> tuple[Array, Array]:
    """Return joint positions (T, n) of plant and of MuJoCo under one torque held in each step.

    The plant makes `parts` steps of its own in each; MuJoCo has a step `slower` times shorter.
    """
    twin = Twin(robot, folder)
    held = twin.model.opt.timestep
    twin.model.opt.timestep /= slower
    if slower > 1:
        twin.model.dof_solref[:, 0] /= slower
    start, torques = torques_of(robot, duration, held)
    twin.put(start)
    data, state, both = twin.plant.model.createData(), start, []
    for torque in torques:
        twin.set_torque(torque)
        for _ in range(slower):
            mujoco.mj_step(twin.model, twin.data)
        for _ in range(parts):
            state = advance(twin.plant, data, state, torque, 0 * torque, held / parts)
        both.append((state[2], twin.positions()))
    found = np.array(both)
    return found[:, 0], found[:, 1]


ROBOTS: dict[str, Callable[[], Robot]] = {"leg": leg, "mixed arm": arm, "stiff arm": stiff_arm}


@pytest.mark.parametrize("name", ROBOTS)
def test_motion_without_dry_friction_is_the_plants(name: str, tmp_path: Path) -> None:
    robot = without_friction(ROBOTS[name]())
    own, found = run(robot, tmp_path, 0.5, 1)
    assert np.min(np.ptp(own, axis=0)) > 0.02  # every joint moves
    assert np.max(np.abs(found - own)) < 1e-12  # the same scheme and steps: rounding
    own, found = run(robot, tmp_path, 0.5, 2)
    assert np.max(np.abs(found - own)) < 1e-7  # other steps: what both integrators leave
