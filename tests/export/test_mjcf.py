"""write_mjcf: MuJoCo's accelerations and motions are the library's own, and what is refused.

MuJoCo's RK4 and the plant's are the same scheme: with the same steps and the same held torque they
differ by rounding only, but for friction, which needs shorter steps in MuJoCo.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.drives import Drive, SeriesElasticDrive, StiffDrive
from seaid.errors import RobotError
from seaid.export import write_mjcf
from seaid.legged import load_robot
from seaid.robot import Robot
from seaid.simulation.forward_dynamics import begin_of
from seaid.simulation.plant import JOINT_SPEED, SPEED, plant_of
from tests import terms
from tests.experiments import MODELS, TEST_MASS, arm, leg
from tests.one_joint import BODY
from tests.plants import body, tree, write_robot
from tests.regressor.trees import SLIDE, Joint, joints, joints_of
from tests.terms import ELASTIC, STIFF
from tests.terms import arm as two_joints

mujoco = pytest.importorskip("mujoco")

LIMIT = '<limit lower="-3" upper="3" effort="9" velocity="9"/>'
TURN = f'revolute <axis xyz="0 0.6 0.8"/>{LIMIT}'


def without_friction(robot: Robot) -> Robot:
    drives = robot.drives.items()
    return robot.with_drives(
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
        expected = begin_of(twin.plant, data, state, torque, slip)[1][[SPEED, JOINT_SPEED]]
        twin.put(state)
        for found, own in zip(twin.accelerations(torque), expected, strict=True):
            largest = max(largest, float(np.max(np.abs(found - own)) / np.max(np.abs(own))))
    return largest


def reordered() -> Robot:
    """Return four joints of the leg in another order, with another gravity."""
    joints = ("ankle_pitch", "hip_roll", "knee_pitch", "hip_yaw")
    files = MODELS / "tulip_leg.urdf", MODELS / "tulip_leg.toml"
    return load_robot(*files, joints=joints, gravity=(1.0, -2.0, -9.0))


def stiff_arm() -> Robot:
    return load_robot(MODELS / "philips_arm.urdf", MODELS / "philips_arm.toml")


ROBOTS: dict[str, Callable[[], Robot]] = {"leg": leg, "mixed arm": arm, "stiff arm": stiff_arm}

VISCOUS: tuple[str, ...] = ("viscous",)

stiff, elastic = (partial(drive, friction=VISCOUS) for drive in (terms.stiff, terms.elastic))

PULLED = {"parallel_stiffness": 7.0, "parallel_preload": -1.5}

PULL: dict[str, Any] = {"parallel_spring": ("linear", "preload")}

CUBIC = {"cubic_stiffness": 4e3}

BOTH, TURNED = {"one": 1.0, "two": 1.0}, {"one": 0.5, "two": -1.0}

TERMS: dict[str, Drive | tuple[Drive, Drive]] = {
    "damping": elastic({"spring_damping": 0.4}, spring=("linear", "damping")),
    "preload": elastic({"spring_offset": 2.0}, spring=("linear", "preload")),
    "dead zone": elastic(
        {"dead_zone": 0.02, "deflection_zero": 0.01, "spring_damping": 0.1},
        spring=("linear", "dead_zone", "damping"),
    ),
    "smooth dead zone, sharp here": elastic(
        {"dead_zone": 0.02, "dead_zone_rounding": 0.0}, spring=("linear", "smooth_dead_zone")
    ),
    "parallel spring": elastic(PULLED, **PULL),
    "joint friction": elastic({"joint_viscous_friction": 0.3}, joint_friction=("viscous",)),
    "friction offset": stiff({"friction_offset": 0.03}, friction=("viscous", "offset")),
    "parallel spring of a stiff drive": stiff(PULLED, **PULL),
    "hardening": elastic({**CUBIC, "deflection_zero": 0.01}, spring=("linear", "cubic")),
    "softening": elastic({"cubic_stiffness": -4e3}, spring=("linear", "cubic")),
    "cubic alone": elastic({"cubic_stiffness": 4e4}, spring=("cubic",)),
    "cubic with a preload": elastic(
        {**CUBIC, "spring_offset": 3.0}, spring=("linear", "cubic", "preload")
    ),
    "cubic with a preload alone": elastic(
        {"cubic_stiffness": 4e4, "spring_offset": -3.0}, spring=("cubic", "preload")
    ),
    "cubic with a dead zone": elastic(
        {**CUBIC, "dead_zone": 0.02}, spring=("linear", "cubic", "dead_zone")
    ),
    "stiff drives that move several joints": (
        stiff(PULLED, **PULL, transmission=BOTH),
        stiff({}, transmission=TURNED),
    ),
    "elastic drives that move several joints": (
        elastic(PULLED, **PULL, transmission=BOTH),
        elastic({}, transmission=TURNED),
    ),
}


@pytest.mark.parametrize("name", TERMS)
def test_accelerations_with_every_term_that_mujoco_has(name: str, tmp_path: Path) -> None:
    drives = TERMS[name]
    if not isinstance(drives, tuple):
        other = STIFF if isinstance(drives, SeriesElasticDrive) else ELASTIC
        drives = replace(other, friction=VISCOUS), drives
    assert acceleration_errors(Twin(two_joints(tmp_path, *drives), tmp_path), 30) < 1e-9


WHOLE = ROBOTS | {"leg with a mass": lambda: leg(TEST_MASS), "reordered": reordered}


@pytest.mark.parametrize("name", WHOLE)
def test_accelerations_of_whole_robots(name: str, tmp_path: Path) -> None:
    robot = without_friction(WHOLE[name]())
    assert acceleration_errors(Twin(robot, tmp_path)) < 1e-9


def test_bodies_without_mass_or_thickness_load(write_chain: Any, tmp_path: Path) -> None:
    path = write_chain({"one": TURN, "two": TURN}, empty=("one_link",))
    robot = load_robot(path, dict.fromkeys(("one", "two"), stiff({})))
    point = robot.parameters.copy()
    point[10:] = (2.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.08, 0.0, 0.0, 0.08)  # 2 kg at x = 0.2 m
    for each in (robot, robot.with_values(point, robot.drives)):
        assert acceleration_errors(Twin(each, tmp_path)) < 1e-9


@given(
    tree=st.lists(st.tuples(joints, st.booleans()), min_size=1, max_size=4),
    ratio=st.floats(2, 150),
    stiffness=st.floats(10, 1e4),
    inertia=st.floats(1e-6, 1e-3),
)
def test_accelerations_of_any_tree_with_any_drives(
    tree: list[tuple[Joint, bool]],
    ratio: float,
    stiffness: float,
    inertia: float,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Each joint has a spring or none."""
    folder, drives = tmp_path_factory.mktemp("tree"), dict[str, Drive]()
    wide = {
        joint: text.replace(SLIDE, LIMIT) for joint, text in joints_of([x for x, _ in tree]).items()
    }
    for (joint, text), (_, has_spring) in zip(wide.items(), tree, strict=True):
        slides, own = text.startswith("prismatic"), {"motor_inertia": inertia}
        if has_spring:
            radius = 0.02 if slides else None
            drive: Drive = SeriesElasticDrive(ratio, motor_pulley_radius_m=radius, friction=VISCOUS)
            own["stiffness"] = stiffness
        else:
            ratios: Any = {"gear_ratio_rad_per_m" if slides else "gear_ratio": ratio}
            drive = StiffDrive(**ratios, friction=VISCOUS)
        drives[joint] = drive.with_values({**own, "viscous_friction": 1e-4})
    robot = load_robot(write_robot(folder / "tree.urdf", wide, body(1)), drives)
    assert acceleration_errors(Twin(robot, folder), 3) < 1e-9


@pytest.mark.parametrize("kind", ["stiff", "elastic"])
def test_friction_that_holds_creeps_little(kind: str, tmp_path: Path) -> None:
    robot = two_joints(tmp_path, STIFF, STIFF if kind == "stiff" else ELASTIC)
    drives = {
        joint: drive.with_values({"coulomb_friction": 1.0}) for joint, drive in robot.drives.items()
    }
    twin = Twin(robot.with_drives(drives), tmp_path)
    state = np.zeros((4, 2))
    state[2] = (0.6, 0.3)
    state[0] = state[2] * twin.plant.ratio
    twin.put(state)
    for _ in range(round(1.0 / twin.model.opt.timestep)):
        mujoco.mj_step(twin.model, twin.data)
    motors = np.array([twin.data.joint(name).qpos[0] for name in twin.motors])
    motors = motors * np.where(twin.plant.elastic, 1.0, twin.plant.ratio)
    assert np.max(np.abs(motors - state[0])) < 1e-3  # rad at the motor, in a second


def test_dry_friction_is_of_the_motor_or_the_joint_and_offsets_are_left_out(tmp_path: Path) -> None:
    rubbing = elastic(
        {"joint_coulomb_friction": 0.7, "coulomb_friction": 0.03, "spring_offset": 0.1},
        joint_friction=("coulomb",),
        friction=("viscous", "coulomb"),
    )
    robot = two_joints(tmp_path, STIFF, rubbing)
    model = loaded(robot, tmp_path)
    (note,) = (x for x in write_mjcf(robot, tmp_path / "r.xml").notes if "spring offset" in x)
    assert note.startswith(
        "joint 'two': its spring offset (0.1 N m) comes from the encoder offsets"
    )
    losses = [model.joint(name).frictionloss[0] for name in ("one", "two", "two_motor")]
    assert losses == pytest.approx([40 * 0.02, 0.7, 0.03], rel=1e-12)


def test_file_says_step_payload_and_what_is_left_out(tmp_path: Path) -> None:
    first = stiff(
        {"coulomb_width": 2.0, "coulomb_friction": 0.1, "load_friction": 0.1},
        friction=("viscous", "smooth_coulomb", "load"),
        motor_input="current",
        extra_terms=("c_4*sin(theta_L)",),
    )
    hysteresis = {"presliding_angle": 0.3, "hysteresis_force": 1.0, "hysteresis_deflection": 0.01}
    second = elastic(
        {**hysteresis, "dead_zone": 0.01, "dead_zone_rounding": 0.001},
        friction=("viscous", "dahl"),
        spring=("linear", "dahl", "smooth_dead_zone"),
    )
    payload = replace(TEST_MASS, link="lower")
    robot = two_joints(tmp_path, first, second, payloads=[payload])
    written = write_mjcf(robot, tmp_path / "out.xml")
    text = (tmp_path / "out.xml").read_text()
    for words in (
        "integrator RK4 with steps of 0.0005 s",
        "contacts are off",
        "joint 'one': its smooth_coulomb is written as dry friction",
        "joint 'one': excluded, not available in MuJoCo: load, extra term c_4*sin(theta_L)",
        "joint 'two': its dahl is written as dry friction (friction loss)",
        "joint 'two': excluded, not available in MuJoCo: dahl of the spring",
        "joint 'two': its smooth_dead_zone is written with sharp corners",
        "its control is the motor torque, torque_constant (unknown) times the current",
        "motors of elastic joints turn on separate bodies fixed in the world",
        "the known payload is part of the bodies",
    ):
        assert any(words in note for note in written.notes), words
        assert words in text


def test_names_never_clash_and_odd_ones_load(write_chain: Any, tmp_path: Path) -> None:
    twins = ("a--", "a--_motor")
    robot = load_robot(write_chain(dict.fromkeys(twins, TURN)), dict.fromkeys(twins, ELASTIC))
    model = loaded(robot, tmp_path)
    names = {model.joint(index).name for index in range(model.njnt)}
    assert names == {"a--", "a--_motor", "a--_motor_", "a--_motor_motor"}
    links, joints = ("base", "world", "world_link", "left/hand é"), ("world", "a b", "arm/joint")
    rows = [f'<link name="{name}">{BODY}</link>' for name in links]
    for joint, parent, child in zip(joints, links[:-1], links[1:], strict=True):
        rows.append(
            f'<joint name="{joint}" type="continuous"><parent link="{parent}"/>'
            f'<child link="{child}"/><axis xyz="0 1 0"/></joint>'
        )
    path = tmp_path / "odd.urdf"
    path.write_text(f'<robot name="a/b &lt;c&gt;">{"".join(rows)}</robot>', encoding="utf-8")
    robot = load_robot(path, dict.fromkeys(joints, ELASTIC))
    model = loaded(robot, tmp_path)
    bodies = [model.body(index).name for index in range(4)]
    assert bodies == ["world", "world_link_", "world_link", "left/hand é"]
    assert {model.actuator(index).name for index in range(model.nu)} == set(joints)
    notes = write_mjcf(robot, tmp_path / "again.xml").notes
    assert any("link 'world' is the body 'world_link_'" in note for note in notes)


REFUSED: dict[str, Drive] = {
    "'motor_inertia_kg_m2' is not known; the model of a": replace(STIFF, motor_inertia_kg_m2=None),
    "needs a motor inertia to be simulated": replace(ELASTIC, motor_inertia_kg_m2=0.0),
    "'stiffness_Nm_per_rad' is not known": replace(ELASTIC, stiffness_Nm_per_rad=None),
    "'coulomb_friction_Nm' is not known": replace(STIFF, coulomb_friction_Nm=None),
    "the term 'fifth', and MuJoCo's springs end with the third power": elastic(
        {"fifth_stiffness": 1.0}, spring=("linear", "fifth")
    ),
    "its spring has no stiffness": elastic({"cubic_stiffness": 0.0}, spring=("cubic",)),
    "has a dead zone and a preload": elastic(
        {"dead_zone": 0.1, "spring_offset": 1.0}, spring=("linear", "dead_zone", "preload")
    ),
    "no parallel preload without": stiff({"parallel_preload": 1.0}, parallel_spring=("preload",)),
    "negative stiffness, found -2 N m/rad": stiff(
        {"parallel_stiffness": -2.0}, parallel_spring=("linear",)
    ),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_is_not_known_or_cannot_be_said_is_refused(words: str, tmp_path: Path) -> None:
    robot = two_joints(tmp_path, STIFF, REFUSED[words])
    with pytest.raises(RobotError, match="^joint 'two': .*" + words):
        write_mjcf(robot, tmp_path / "out.xml")
    assert not (tmp_path / "out.xml").exists()


def test_rotors_between_branches_are_refused(write_urdf: Any, tmp_path: Path) -> None:
    joints = {f"j{x}": f'continuous base {x} <axis xyz="0 1 0"/>' for x in "ab"}
    path = write_urdf(tree(joints, BODY))
    drives = {
        "ja": stiff({}, transmission={"ja": 1.0, "jb": 1.0}),
        "jb": stiff({}, transmission={"ja": 1.0, "jb": -1.0}),
    }
    with pytest.raises(RobotError, match=r"joint 'ja': its stiff drive moves joints of different"):
        write_mjcf(load_robot(path, drives), tmp_path / "out.xml")
    springs = {
        name: replace(ELASTIC, friction=VISCOUS, transmission=drive.transmission)
        for name, drive in drives.items()
    }
    twin = Twin(load_robot(path, springs), tmp_path)
    assert acceleration_errors(twin) < 1e-9  # springs between branches are exact
