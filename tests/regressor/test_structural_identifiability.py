"""Which sensors tell what: by hand, by laws, against base parameters, and by solving."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import seaid
from seaid._arrays import Array
from seaid.errors import RobotError
from seaid.legged import load_robot
from seaid.regressor import joint_torques, rigid_body_regressor
from seaid.regressor.base import base_parameters, random_states
from seaid.regressor.exact.geometry import exact_tree
from seaid.regressor.exact.program import Value, regressor_program
from seaid.regressor.structural_identifiability import (
    SENSORS,
    Identifiability,
    Sensor,
    identifiability,
)
from seaid.robot.robot import Payload, Robot
from tests.plants import tree, write_robot
from tests.regressor.modular.arithmetic import ResidueNumbers
from tests.regressor.modular.decision import exact_decision
from tests.regressor.modular.dynamics import PRIME, residue
from tests.regressor.trees import Joint, joints, robot_of
from tests.representatives import quick_first

Chain = Callable[..., Path]
BOTH: tuple[Sensor, Sensor] = ("motor_position", "joint_position")
ARM = Path(__file__).parents[2] / "models" / "philips_arm"
TREE = Path(__file__).parents[1] / "data" / "mixed_arm.urdf"
SPRING: dict[str, Any] = {
    "type": "series_elastic",
    "gear_ratio": 100.0,
    "motor_inertia_kg_m2": 1e-5,
    "stiffness_Nm_per_rad": 200.0,
}
FRICTION = {"viscous_friction of a", "coulomb_friction of a"}
SPRING_OF_A = {"stiffness of a", "spring_offset of a"}
BODY = {"mx_a_link", "mz_a_link", "Iyy_a_link"}
EVERYTHING = FRICTION | SPRING_OF_A | BODY


def pendulum(write_chain: Chain, axis: str = "0 1 0", **options: Any) -> Robot:
    """Return a body on a spring: three parameters of the body, four of the drive."""
    drive = {**SPRING, **options.pop("drive", {})}
    drive = {name: value for name, value in drive.items() if value is not None}
    return load_robot(
        write_chain({"a": f'continuous <axis xyz="{axis}"/>'}), {"a": drive}, **options
    )


def assert_is_exact(found: Identifiability, robot: Robot, conditions: Sequence[Robot] = ()) -> None:
    """Compare an answer with that of the same equations modulo a prime, without rounding."""
    sensors = {joint: frozenset(names) for joint, names in found.sensors.items()}
    exact = exact_decision(robot, sensors, conditions)
    assert found.base.columns == exact.columns
    # Directions that coincide up to the digits of a file's angle are apart as rationals only.
    assert not np.any((found.base.grouping != 0) & ~exact.pattern)
    assert found.rank == exact.rank
    of_groups = zip(found.base.names, found.base.expressions, strict=True)
    scaled = set(chain(*found.ratios))
    assert {name for name, text in of_groups if text in scaled} == exact.coupled
    assert found.agree


# One pendulum, by hand: tau = mx, mz, Iyy parts (8), spring k d + f_0 (4b), motor (7).


@pytest.mark.rounding
@pytest.mark.parametrize(
    ("sensors", "alone", "up_to_a_factor"),
    [
        ((*BOTH, "motor_torque"), EVERYTHING, set()),
        (("motor_position", "deflection", "motor_torque"), EVERYTHING, set()),
        (("joint_position", "deflection", "motor_torque"), EVERYTHING, set()),
        (BOTH, set(), SPRING_OF_A | BODY),
        ((*BOTH, "joint_torque"), SPRING_OF_A | BODY, set()),
        (("joint_position", "joint_torque"), BODY, set()),
        (("deflection", "joint_torque"), SPRING_OF_A, set()),
        (("motor_position", "motor_torque", "joint_torque"), FRICTION, set()),
        (("motor_position", "motor_torque"), set(), set()),
        (("joint_position", "motor_torque"), set(), set()),
        (("deflection", "motor_torque"), set(), set()),
        (("motor_torque", "joint_torque"), set(), set()),
        ((*BOTH, "motor_current"), EVERYTHING | {"torque_constant of a"}, set()),
        ((*BOTH, "motor_voltage"), EVERYTHING | {"voltage_constant of a"}, set()),
        ((*BOTH, "motor_current", "motor_torque"), EVERYTHING | {"torque_constant of a"}, set()),
        (
            (*BOTH, "motor_voltage", "motor_torque"),
            EVERYTHING | {"voltage_constant of a", "back_emf_damping of a"},
            set(),
        ),
    ],
)
def test_pendulum_by_hand(
    sensors: tuple[Sensor, ...], alone: set[str], up_to_a_factor: set[str], write_chain: Chain
) -> None:
    robot = pendulum(write_chain)
    found = identifiability(robot, sensors)
    assert_is_exact(found, robot)
    assert set(found.identifiable) == alone
    assert {name for group in found.ratios for name in group} == up_to_a_factor
    assert len(found.ratios) == bool(up_to_a_factor)
    assert found.combinations == ()
    assert set(found.unidentifiable) == set(found.names) - alone - up_to_a_factor
    assert found.rank == len(alone) + max(len(up_to_a_factor) - 1, 0)
    assert found.agree


def test_vertical_pendulum_has_its_inertia_over_its_stiffness(write_chain: Chain) -> None:
    found = identifiability(pendulum(write_chain, axis="0 0 1"), BOTH)
    assert set(found.ratios[0]) == SPRING_OF_A | {"Izz_a_link"}
    assert found.rank == 2


def test_current_alone_has_no_scale_unless_the_rotor_inertia_has_it(write_chain: Chain) -> None:
    robot = pendulum(write_chain, drive={"motor_inertia_kg_m2": None})
    found = identifiability(robot, (*BOTH, "motor_current"))
    everything = EVERYTHING | {"torque_constant of a", "motor_inertia of a"}
    assert set(found.ratios[0]) == everything
    assert found.rank == len(everything) - 1
    words = found.usable["a"]
    assert "its motor torque is known only up to the scale of its torque constant" in words
    assert "its spring torque is known only up to the scale of its stiffness" in words


@pytest.mark.parametrize("name", ["stiffness", "torque_constant"])
def test_one_known_constant_gives_the_scale(name: str, write_chain: Chain) -> None:
    drive: dict[str, Any] = {"motor_inertia_kg_m2": None, "known": [name]}
    if name == "torque_constant":
        drive |= {"motor_input": "current", "torque_constant_Nm_per_A": 0.05}
    found = identifiability(pendulum(write_chain, drive=drive), (*BOTH, "motor_current"))
    everything = EVERYTHING | {"torque_constant of a", "motor_inertia of a"}
    assert set(found.identifiable) == everything - {f"{name} of a"}
    assert found.ratios == ()


def test_known_payload_scales_only_beside_a_log_without_it(write_chain: Chain) -> None:
    """Held all the time it is a part of the body: k (d) = Y (theta + known) has no scale."""
    bare = pendulum(write_chain)
    loaded = pendulum(write_chain, payloads=[Payload("a_link", 1.0, (0.1, 0.0, 0.2))])
    assert set(identifiability(loaded, BOTH).ratios[0]) == SPRING_OF_A | BODY
    both = identifiability(loaded, BOTH, conditions=[bare])
    assert_is_exact(both, loaded, [bare])
    assert set(both.identifiable) == SPRING_OF_A | BODY
    assert both.ratios == ()


def test_known_body_scales_its_spring(write_chain: Chain) -> None:
    found = identifiability(pendulum(write_chain, known_bodies=["a_link"]), BOTH)
    assert set(found.identifiable) == SPRING_OF_A
    assert set(found.unidentifiable) == FRICTION


def test_stiff_joint_holds_its_rotor_inertia_with_the_body(write_chain: Chain) -> None:
    chain = write_chain({"a": 'continuous <axis xyz="0 1 0"/>'})
    found = identifiability(load_robot(chain, {"a": {"type": "stiff", "gear_ratio": 50.0}}))
    assert found.combinations == ("Iyy_a_link + 2500 motor_inertia of a",)
    assert set(found.identifiable) == FRICTION | {"mx_a_link", "mz_a_link"}


def test_motor_torque_of_one_spring_scales_those_behind_it(write_chain: Chain) -> None:
    joints = dict.fromkeys("ab", 'continuous <axis xyz="0 1 0"/>')
    robot = load_robot(write_chain(joints), dict.fromkeys("ab", SPRING))
    found = identifiability(robot, {"a": (*BOTH, "motor_torque"), "b": BOTH})
    assert found.ratios == ()
    assert "stiffness of b" in found.identifiable
    assert "viscous_friction of b" in found.unidentifiable
    assert found.usable["b"][0] == (
        "(7) of its motor cannot be used: no motor torque, current or voltage"
    )


def test_two_arms_have_a_factor_each(write_urdf: Callable[[str], Path]) -> None:
    joints = {x: f'continuous base {x}_arm <axis xyz="0 1 0"/>' for x in ("left", "right")}
    robot = load_robot(write_urdf(tree(joints)), dict.fromkeys(joints, SPRING))
    found = identifiability(robot, BOTH)
    assert [len(group) for group in found.ratios] == [5, 5]
    assert all(len({name.rpartition("right")[1] for name in group}) == 1 for group in found.ratios)


# The TULip leg, METHOD 1


@pytest.mark.rounding
@pytest.mark.parametrize(
    ("joints", "torques", "count"),
    [
        (None, None, 29),
        (None, ("hip_pitch", "knee_pitch", "ankle_pitch"), 21),
        (("hip_pitch", "knee_pitch", "ankle_pitch"), None, 9),
    ],
)
def test_tulip_leg_has_its_table(
    joints: tuple[str, ...] | None, torques: tuple[str, ...] | None, count: int, tulip_urdf: Path
) -> None:
    leg = load_robot(tulip_urdf, tulip_urdf.with_suffix(".toml"), joints=joints)
    known = torques or leg.joint_names
    sensors: Any = {name: (*BOTH, *["motor_torque"] * (name in known)) for name in leg.joint_names}
    found = identifiability(leg, sensors)
    assert found.body_count == count
    assert found.rank == count + 4 * 3 + 2 * (len(known) - 3)
    exact = seaid.symbolic.base_parameters(leg, torque_joints=known)
    bodies = found.base.grouping[: found.body_count, : 10 * leg.n]
    assert found.base.columns[:count] == exact.columns
    np.testing.assert_allclose(bodies, exact.grouping, rtol=1e-9, atol=1e-12)
    assert found.base.expressions[:count] == exact.expressions
    assert found.agree
    assert found.gap > 1e12


def test_unknown_position_spoils_all_rows_that_depend_on_it(tulip_leg: Robot) -> None:
    full: dict[str, tuple[Sensor, ...]]
    full = dict.fromkeys(tulip_leg.joint_names, (*BOTH, "motor_torque"))
    found = identifiability(tulip_leg, full | {"knee_pitch": ("motor_position", "motor_torque")})
    assert found.body_count == 0
    for joint in tulip_leg.joint_names:
        assert any(
            "(8) of its load cannot be used: the position of knee_pitch is not known" in words
            for words in found.usable[joint]
        )
    assert "stiffness of hip_pitch" in found.identifiable
    assert "stiffness of knee_pitch" in found.unidentifiable


def test_rows_that_do_not_depend_on_it_stay(write_chain: Chain) -> None:
    slide = '<limit lower="0" upper="1" effort="1" velocity="1"/>'
    axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    chain = {name: f'prismatic <axis xyz="{axis}"/>{slide}' for name, axis in axes.items()}
    robot = load_robot(write_chain(chain))
    torque: tuple[Sensor, Sensor] = ("joint_position", "motor_torque")
    found = identifiability(robot, {"x": torque, "y": ("motor_torque",), "z": torque})
    assert found.combinations == ("m_x_link + m_y_link",)
    assert found.identifiable == ("m_z_link",)


# Against base parameters, over robots of all kinds

DRIVES: dict[str, Any] = {
    "rail": {
        "type": "stiff",
        "gear_ratio_rad_per_m": 400.0,
        "friction": ["viscous", "coulomb", "load", "offset"],
    },
    "shoulder": {
        "type": "series_elastic",
        "gear_ratio": 100.0,
        "spring": ["linear", "cubic", "dead_zone", "damping", "preload"],
        "friction": ["viscous", "smooth_coulomb", "stribeck"],
        "parallel_spring": ["linear", "preload"],
        "joint_friction": ["viscous", "coulomb"],
    },
    "telescope": {
        "type": "series_elastic",
        "gear_ratio": 20.0,
        "motor_pulley_radius_m": 0.02,
        "friction": ["viscous", "coulomb", "quadratic", "asymmetric", "load"],
        "extra_terms": ["ripple*cos(theta_M)", "tilt*theta_L"],
        "parallel_spring": ["linear"],
    },
    "wrist": {
        "type": "stiff",
        "gear_ratio": 50.0,
        "friction": ["viscous", "coulomb", "stribeck"],
        "extra_terms": ["gas_spring*sin(theta_L)"],
        "motor_input": "current",
    },
}


@pytest.mark.parametrize("path", [TREE, ARM.with_suffix(".urdf")])
def test_torques_modulo_the_prime_are_those_of_the_exact_program(path: Path) -> None:
    """An independent route: the straight-line program in rationals, at rational states."""
    robot = load_robot(path)
    numbers = ResidueNumbers(robot, np.random.default_rng(0))
    q, turned, v, a = numbers.states(2)
    Y = numbers.regressor(q, turned, v, a)
    program, entries = regressor_program(exact_tree(robot))
    states = dict(zip("csqva", (*turned, q, v, a), strict=True))
    known = {f"{x}{i}": values[:, i] for x, values in states.items() for i in range(robot.n)}

    def value(terms: Value) -> Any:
        parts = [
            residue(Fraction(int(x.p), int(x.q))) * math.prod(known[name] for name in factors)
            for factors, x in terms.items()
        ]
        return sum(parts) % PRIME

    for step, terms in program.steps.items():
        known[step] = value(terms)
    expected = np.zeros_like(Y)
    for (row, column), terms in entries.items():
        expected[:, row, column] = value(terms)
    assert np.array_equal(Y, expected)
    bodies = numbers.random(robot.parameters.size)
    assert np.array_equal(numbers.torques(q, turned, v, a, bodies), Y @ bodies % PRIME)


def test_all_terms_come_along() -> None:
    robot = load_robot(TREE, DRIVES)
    found = identifiability(robot)
    assert found.agree
    assert found.ratios == ()
    alone = set(found.identifiable)
    for joint, names in {
        "shoulder": ("cubic_stiffness", "dead_zone", "stribeck_speed", "parallel_stiffness"),
        "telescope": ("quadratic_friction", "load_friction", "ripple", "tilt"),
        "wrist": ("torque_constant", "stribeck_friction"),
    }.items():
        assert {f"{name} of {joint}" for name in names} <= alone
    assert found.body_count == len(base_parameters(robot).columns)
    unscaled = identifiability(robot, (*BOTH, "motor_current"))
    assert [len(group) for group in unscaled.ratios] != []
    assert_is_exact(unscaled, robot)


def test_random_instants_are_on_both_sides_of_a_dead_zone() -> None:
    robot, sensors = load_robot(TREE, DRIVES), (*BOTH, "motor_voltage", "motor_torque")
    assert [identifiability(robot, sensors, seed=seed).rank for seed in range(3)] == [58] * 3  # type: ignore[arg-type]


def test_gravity_and_an_extra_term_of_the_same_form_come_together(write_chain: Chain) -> None:
    drive = {"type": "stiff", "gear_ratio": 50.0, "extra_terms": ["c*cos(theta_L)"]}
    robot = load_robot(write_chain({"a": 'continuous <axis xyz="0 1 0"/>'}), {"a": drive})
    found = identifiability(robot)
    assert "-" in found.combinations[0] or "+" in found.combinations[0]
    assert found.combinations[0].startswith("mx_a_link")
    assert found.combinations[0].endswith("c of a")


EXAMPLES = (
    *("ur5_robot.urdf", "xarm7.urdf", "talos_left_arm.urdf", "a1.urdf", "tiago_no_hand.urdf"),
    *("double_pendulum.urdf", "finger_edu.urdf", "hextilt_flying_arm_5.urdf"),
)


@pytest.mark.rounding
@pytest.mark.parametrize("name", EXAMPLES)
def test_all_torques_give_the_base_parameters(
    name: str, example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    robot = load_quietly(example_path(name))
    found = identifiability(robot, ("joint_position", "joint_torque"))
    exact = seaid.symbolic.base_parameters(robot)
    assert found.base.columns == exact.columns
    scale = np.max(np.abs(exact.grouping), axis=1, keepdims=True)
    assert np.max(np.abs(found.base.grouping - exact.grouping) / scale) < 1e-8
    assert np.array_equal(found.base.grouping != 0, exact.grouping != 0)
    assert found.agree


SETS: tuple[tuple[Sensor, ...] | None, ...] = (
    None,
    BOTH,
    (*BOTH, "motor_current"),
    (*BOTH, "motor_voltage", "motor_torque"),
    ("joint_position", "motor_torque"),
    ("deflection", "joint_torque"),
)


def with_springs(path: Path, **options: Any) -> Robot:
    """Return a robot with drives of three kinds in turn, a fourth joint without a drive."""
    bare = load_robot(path, **options)
    drives = {}
    for place, joint in enumerate(bare.joint_names):
        kind = "prismatic" if bare.is_prismatic[place] else "continuous"
        drives[joint] = drive_of(kind, ("elastic", "unknown rotor", "stiff", "ideal")[place % 4])
    return load_robot(path, {x: y for x, y in drives.items() if y is not None}, **options)


@pytest.mark.rounding
@pytest.mark.filterwarnings("ignore::seaid.SeaidWarning")
@pytest.mark.parametrize(
    ("name", "mimics"),
    quick_first(
        [
            *(("finger_edu.urdf", True), ("panda.urdf", False), ("ur5_robot.urdf", True)),
            *(("xarm7.urdf", True), ("a1.urdf", True), ("ur5_gripper.urdf", False)),
        ]
    ),
)
def test_answers_are_those_without_rounding(
    name: str, mimics: bool, example_path: Callable[[str], Path]
) -> None:
    robot = with_springs(example_path(name), independent_mimics=mimics)
    for sensors in SETS:
        assert_is_exact(identifiability(robot, sensors), robot)


def test_coupled_drives(load_quietly: Callable[..., Robot], write_chain: Chain) -> None:
    plain = {"type": "stiff", "gear_ratio": 50.0, "motor_inertia_kg_m2": 1e-5}
    drives = {
        "b": {**plain, "transmission": {"b": 0.5, "c": 0.5}},
        "c": {**SPRING, "transmission": {"b": 0.5, "c": -0.5}},
    }
    axes = {"a": "0 0 1", "b": "0 1 0", "c": "1 0 0"}
    chain = write_chain({name: f'continuous <axis xyz="{x}"/>' for name, x in axes.items()})
    robot = load_robot(chain, drives)
    found = identifiability(robot)
    assert found.agree
    assert found.body_count == len(base_parameters(robot).columns)
    assert "stiffness of c" in found.identifiable
    sensors: dict[str, tuple[Sensor, ...]]
    sensors = {"a": ("joint_position",), "b": ("motor_position", "motor_torque")}
    some = identifiability(robot, sensors | {"c": ("motor_position", "deflection")})
    for answer in (found, some):
        assert_is_exact(answer, robot)
    assert some.ratios == ()
    part = identifiability(robot, dict.fromkeys("ac", BOTH) | {"b": (*BOTH, "motor_torque")})
    assert part.rank >= len(base_parameters(robot, torque_joints=["b"]).columns)


def test_without_nominal_values_the_answer_is_the_same(tulip_leg: Robot) -> None:
    assert identifiability(tulip_leg.without_nominal()).base.expressions == (
        identifiability(tulip_leg).base.expressions
    )


@pytest.mark.parametrize(
    ("name", "value"), [("_CLEAR_GAP", 1e300), ("_is_confirmed", lambda *_: False)]
)
def test_a_rank_without_a_clear_gap_or_that_other_instants_contradict_is_not_sure(
    name: str, value: Any, tulip_leg: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert identifiability(tulip_leg).agree
    monkeypatch.setattr(f"seaid.regressor.structural_identifiability.{name}", value)
    assert not identifiability(tulip_leg).agree


@pytest.mark.rounding
def test_another_seed_gives_the_same_answer(load_quietly: Callable[..., Robot]) -> None:
    robot = load_quietly(TREE, TREE.with_suffix(".toml"))
    first, second = (identifiability(robot, BOTH, seed=seed) for seed in (0, 1))
    assert first.ratios == second.ratios
    assert first.base.columns == second.base.columns


sensor_sets = st.frozensets(st.sampled_from(SENSORS))
random_joints = st.tuples(
    joints,
    st.sampled_from(["ideal", "stiff", "elastic", "unknown rotor"]),
    sensor_sets,
    sensor_sets,
)


def drive_of(kind: str, drive: str) -> dict[str, Any] | None:
    ratio = "gear_ratio_rad_per_m" if kind == "prismatic" else "gear_ratio"
    if drive == "stiff":
        return {"type": "stiff", ratio: 50.0, "motor_inertia_kg_m2": 1e-5}
    if drive == "unknown rotor":
        return {"type": "stiff", ratio: 50.0}
    radius = {"motor_pulley_radius_m": 0.02} if kind == "prismatic" else {}
    elastic = {"type": "series_elastic", "gear_ratio": 20.0, "motor_inertia_kg_m2": 1e-5}
    return {**elastic, **radius} if drive == "elastic" else None


@pytest.mark.rounding
@pytest.mark.slow  # twenty random trees, each with several choices of sensors
@settings(max_examples=20)
@given(tree=st.lists(random_joints, min_size=1, max_size=4))
def test_more_sensors_never_tell_less_and_both_ranks_agree(
    tree: list[tuple[Joint, str, frozenset[str], frozenset[str]]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    few: dict[str, Any] = {}
    more: dict[str, Any] = {}
    drives: dict[str, Any] = {}
    for number, (joint, drive, some, others) in enumerate(tree, 1):
        name, table = f"j{number}", drive_of(joint[0], drive)
        few[name], more[name] = some, some | others
        drives |= {} if table is None else {name: table}
    robot = robot_of(tmp_path_factory.mktemp("tree"), [joint for joint, *_ in tree], drives)
    less, greater = identifiability(robot, few), identifiability(robot, more)
    full = identifiability(robot)
    for found in (less, greater, full):
        assert_is_exact(found, robot)
    assert less.rank <= greater.rank
    assert set(less.identifiable) <= set(greater.identifiable)
    assert full.body_count == len(base_parameters(robot).columns)


# By solving: a pendulum with analytic motion, columns and noise-free signals written here


@pytest.mark.rounding
def test_null_space_of_an_arm_on_springs_without_torques() -> None:
    """The nominal arm by inverse dynamics: all of (8) at once is told but for one factor."""
    robot = load_robot(ARM.with_suffix(".urdf"), ARM.with_name("philips_arm_elastic.toml"))
    base = base_parameters(robot)
    states = random_states(robot, seed=5)
    torques, Y = joint_torques(robot, *states), base.reduce(rigid_body_regressor(robot, *states))
    n, count = robot.n, len(torques)
    springs = [robot.drives[joint].values["stiffness"] for joint in robot.joint_names]
    H = np.zeros((count, n, 2 * n + len(base.columns)))
    for i in range(n):
        H[:, i, i], H[:, i, n + i] = torques[:, i] / springs[i], 1.0
    H[:, :, 2 * n :] = -Y
    flat = H.reshape(count * n, -1)
    scale = np.linalg.norm(flat, axis=0)
    _, sizes, directions = np.linalg.svd(flat / scale, full_matrices=False)
    assert sizes[-2] > 1e-6 * sizes[0]
    assert sizes[-1] < 1e-12 * sizes[0]
    factor = directions[-1] / scale
    true = np.concatenate([springs, np.zeros(n), base.project(robot.parameters)])
    np.testing.assert_allclose(factor / factor[0], true / true[0], rtol=1e-6, atol=1e-9)
    found = identifiability(robot, BOTH)
    assert [len(group) for group in found.ratios] == [flat.shape[1]]
    assert found.rank == flat.shape[1] - 1


# Words


def test_table_says_all_of_it(write_chain: Chain) -> None:
    text = str(identifiability(pendulum(write_chain), BOTH))
    assert "14 parameters, of which the sensors determine 4 combinations" in text
    assert "Up to scale: 5" in text
    assert "a (motor_position, joint_position): (7) of its motor cannot be used" in text
    assert "Unidentifiable: 9" in text
    assert "agree" in text
    assert max(map(len, text.splitlines())) <= 100


def test_no_sensor_tells_nothing(tulip_leg: Robot) -> None:
    found = identifiability(tulip_leg, ())
    assert found.rank == 0
    assert found.base.columns == ()
    assert found.unidentifiable == found.names
    assert "no sensor" in found.summary()


def test_unknown_names_are_refused_with_the_nearest(tulip_leg: Robot, write_chain: Chain) -> None:
    with pytest.raises(RobotError, match=r"'hip_yaw'.* 'motor_torqe'; did you mean 'motor_torque'"):
        identifiability(tulip_leg, ("motor_torqe",))  # type: ignore[arg-type]
    with pytest.raises(RobotError, match=r"'knee_pitc'; did you mean 'knee_pitch'"):
        identifiability(tulip_leg, {"knee_pitc": BOTH})
    with pytest.raises(RobotError, match=r"must be a list of names or a .* text 'deflection'"):
        identifiability(tulip_leg, "deflection")  # type: ignore[arg-type]
    with pytest.raises(RobotError, match="the same robot with other payloads"):
        identifiability(tulip_leg, conditions=[pendulum(write_chain)])


def script(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run scripts/identifiability.py on the leg."""
    root = Path(__file__).parents[2]
    leg = ("scripts/identifiability.py", "models/tulip_leg.urdf", "models/tulip_leg.toml")
    command = [sys.executable, *leg, *arguments]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)


@pytest.mark.slow  # a script for many choices
def test_script_compares_choices_of_sensors() -> None:
    done = script()
    assert done.returncode == 0, done.stderr
    cells = [line.strip().split("  ") for line in done.stdout.splitlines()]
    counts = {line[0]: [cell.strip() for cell in line[1:] if cell] for line in cells}
    assert counts["both positions, motor torque"][0] == "29"
    assert counts["the same, no torque at stiff joints"][0] == "21"


# What motor angle and motor torque determine with their derivatives, against simulations

MOTOR_SIDE: tuple[Sensor, ...] = ("motor_position", "motor_torque")
RATIO = 50.0
PENDULUM = {"Iyy": 0.09, "mx": 0.24, "mz": -0.1}
DRIVE = {"viscous": 3e-4, "inertia": 4e-5, "stiffness": 60.0, "offset": 1.5}


def pendulum_about(folder: Path, axis: str) -> seaid.Robot:
    limit = '<limit lower="-3" upper="3" effort="50" velocity="20"/>'
    body = (
        '<inertial><origin xyz="0.2 0 0"/><mass value="1.2"/><inertia ixx="0.01" iyy="0.02" '
        'izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    joints = {"j": f'revolute base arm <axis xyz="{axis}"/>{limit}'}
    drive = seaid.SeriesElasticDrive(gear_ratio=RATIO, friction=("viscous",))
    return seaid.load_robot(write_robot(folder / "one.urdf", joints, body), {"j": drive})


def motor_angles(parameters: Array, start: Array, gravity: float) -> Array:
    """Return the motor angles (T,) of a motor, a spring and a pendulum under a given torque."""
    viscous, inertia, stiffness, offset, J, mx, mz = parameters

    def rate(time: float, state: Array) -> list[float]:
        theta, w, q, v = state
        given = 0.03 * np.sin(1.3 * time) + 0.02 * np.sin(4.1 * time + 1) + 0.02 * np.cos(9 * time)
        torque = stiffness * (theta / RATIO - q) + offset
        weight = gravity * (mx * np.cos(q) + mz * np.sin(q))
        return [w, (given - viscous * w - torque / RATIO) / inertia, v, (torque + weight) / J]

    times = np.linspace(0, 3, 200)
    run = solve_ivp(rate, (0, 3), start, t_eval=times, rtol=1e-11, atol=1e-12, method="DOP853")
    return np.asarray(run.y[0])


def rank_of_simulations(gravity: float) -> int:
    """Return the number of combinations in the angles, besides those of the first state."""
    truth, start = np.array([*DRIVE.values(), *PENDULUM.values()]), np.array([0.1, 0.0, 0.0, 0.2])
    columns = []
    for place in range(len(truth) + len(start)):
        ends = []
        for sign in (1, -1):
            changed, begin = truth.copy(), start.copy()
            if place < len(truth):
                changed[place] *= 1 + sign * 1e-4
            else:
                begin[place - len(truth)] += sign * 1e-4
            ends.append(motor_angles(changed, begin, gravity))
        columns.append(ends[0] - ends[1])
    S = np.column_stack(columns)
    norms = np.linalg.norm(S, axis=0)
    kept = norms > 1e-9 * norms.max()
    sizes = np.linalg.svd(S[:, kept] / norms[kept], compute_uv=False)
    rank = int(np.argmax(sizes[:-1] / sizes[1:])) + 1
    assert sizes[rank - 1] > 100 * sizes[rank]
    return rank - len(start)


@pytest.mark.slow  # 1.8 s
@pytest.mark.parametrize(("axis", "gravity", "rank"), [("0 1 0", 9.81, 6), ("0 0 1", 0.0, 4)])
def test_the_count_is_that_of_simulated_motor_angles(
    tmp_path: Path, axis: str, gravity: float, rank: int
) -> None:
    """An offset of the spring is one of the joint's angle, and turns the last body."""
    found = seaid.identifiability(pendulum_about(tmp_path, axis), MOTOR_SIDE)
    assert found.rank == 0
    assert found.derivatives is not None
    # an offset moves the first angle of the joint, which is free in the simulation
    assert len(found.derivatives.columns) == rank == rank_of_simulations(gravity)
    alone = np.count_nonzero(found.derivatives.grouping, axis=1) == 1
    names = [name for name, one in zip(found.derivatives.names, alone, strict=True) if one]
    for name in ("stiffness of j", "motor_inertia of j", "viscous_friction of j"):
        assert name in names
    assert "By derivatives of motor angle and motor torque" in str(found.summary())


def test_the_leg_joints_sensed_by_motor_onlys() -> None:
    leg = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
    by_regression = seaid.identifiability(leg)
    found = seaid.identifiability(leg, MOTOR_SIDE)
    assert found.derivatives is not None
    assert by_regression.derivatives is None
    # all but one: the offset of the ankle's spring turns the foot
    assert len(found.derivatives.columns) == by_regression.rank - 1 == 44
    assert found.derivatives.gap > 1e6
    expressions = found.derivatives.expressions
    for joint in leg.elastic_joints:
        assert f"stiffness of {joint}" in expressions


def test_the_other_joints_may_have_any_sensors() -> None:
    leg = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
    both: tuple[Sensor, ...] = (*MOTOR_SIDE, "joint_position")
    sensors = {joint: MOTOR_SIDE if joint == "knee_pitch" else both for joint in leg.joint_names}
    found = seaid.identifiability(leg, sensors)
    assert found.derivatives is not None
    assert len(found.derivatives.columns) == 45
    sensors["hip_yaw"] = ("motor_torque",)
    assert seaid.identifiability(leg, sensors).derivatives is None
