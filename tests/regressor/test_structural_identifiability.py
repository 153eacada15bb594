"""Which sensors tell what: by hand, by laws, and against base parameters."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import seaid
from seaid._arrays import Array
from seaid.drives import StiffDrive
from seaid.drives.equations import N, r_L, r_M
from seaid.errors import RobotError
from seaid.legged import load_robot
from seaid.regressor import base_parameters, identifiability, joint_torques
from seaid.regressor.base import left_to_right
from seaid.regressor.motor_only import _columns, _instant, _rows
from seaid.regressor.random_instants import _instants, dependencies, random_truth, rows_of_sums
from seaid.regressor.sensor_equations import STRETCH, STRETCH_DOT, plain, system_of
from seaid.regressor.structural_identifiability import SENSORS, Sensor
from seaid.robot import Payload, Robot
from tests.experiments import DATA
from tests.plants import tree
from tests.regressor.trees import SLIDE, Joint, joints, robot_of
from tests.representatives import quick_first

Chain = Callable[..., Path]
MOTOR_SIDE: tuple[Sensor, Sensor] = ("motor_position", "motor_torque")
BOTH: tuple[Sensor, Sensor] = ("motor_position", "joint_position")
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


# One pendulum, by hand: tau = mx, mz, Iyy parts (8), spring k d + f_0 (4b), motor (7).

BY_CURRENT: tuple[Sensor, ...] = (*BOTH, "motor_current")
CURRENT = EVERYTHING | {"torque_constant of a", "motor_inertia of a"}
VOLTAGE = {"voltage_constant of a", "back_emf_damping of a"}
NO_ROTOR: dict[str, Any] = {"motor_inertia_kg_m2": None}
KNOWN_STIFFNESS = {**NO_ROTOR, "known": ["stiffness"]}
KNOWN_CONSTANT = {
    **NO_ROTOR,
    "known": ["torque_constant"],
    "motor_input": "current",
    "torque_constant_Nm_per_A": 0.05,
}


@pytest.mark.rounding
@pytest.mark.parametrize(
    ("sensors", "options", "alone", "up_to_a_factor"),
    [
        ((*BOTH, "motor_torque"), {}, EVERYTHING, set()),
        (("motor_position", "deflection", "motor_torque"), {}, EVERYTHING, set()),
        (BOTH, {}, set(), SPRING_OF_A | BODY),
        (BOTH, {"axis": "0 0 1"}, set(), SPRING_OF_A | {"Izz_a_link"}),
        (BOTH, {"known_bodies": ["a_link"]}, SPRING_OF_A, set()),
        ((*BOTH, "joint_torque"), {}, SPRING_OF_A | BODY, set()),
        (("joint_position", "joint_torque"), {}, BODY, set()),
        (("deflection", "joint_torque"), {}, SPRING_OF_A, set()),
        (("motor_position", "motor_torque", "joint_torque"), {}, FRICTION, set()),
        (("motor_position", "motor_torque"), {}, set(), set()),
        (("joint_position", "motor_torque"), {}, set(), set()),
        (("motor_torque", "joint_torque"), {}, set(), set()),
        ((), {}, set(), set()),
        (BY_CURRENT, {}, EVERYTHING | {"torque_constant of a"}, set()),
        (BY_CURRENT, {"drive": NO_ROTOR}, set(), CURRENT),
        (BY_CURRENT, {"drive": KNOWN_STIFFNESS}, CURRENT - {"stiffness of a"}, set()),
        (BY_CURRENT, {"drive": KNOWN_CONSTANT}, CURRENT - {"torque_constant of a"}, set()),
        ((*BOTH, "motor_voltage", "motor_torque"), {}, EVERYTHING | VOLTAGE, set()),
    ],
)
def test_pendulum_by_hand(
    sensors: tuple[Sensor, ...],
    options: dict[str, Any],
    alone: set[str],
    up_to_a_factor: set[str],
    write_chain: Chain,
) -> None:
    robot = pendulum(write_chain, **options)
    found = identifiability(robot, sensors)
    assert found.agree
    assert found.base.grouping.shape == (len(found.base.columns), len(found.names))
    assert set(found.identifiable) == alone
    assert {name for group in found.ratios for name in group} == up_to_a_factor
    assert len(found.ratios) == bool(up_to_a_factor)
    assert found.combinations == ()
    unknown = {x for x in found.names if "known_bodies" not in options or x.endswith("of a")}
    assert set(found.unidentifiable) == unknown - alone - up_to_a_factor
    assert found.rank == len(alone) + max(len(up_to_a_factor) - 1, 0)


def test_known_payload_scales_only_beside_a_log_without_it(write_chain: Chain) -> None:
    """Held all the time it is a part of the body: k (d) = Y (theta + known) has no scale."""
    bare = pendulum(write_chain)
    loaded = pendulum(write_chain, payloads=[Payload("a_link", 1.0, (0.1, 0.0, 0.2))])
    assert set(identifiability(loaded, BOTH).ratios[0]) == SPRING_OF_A | BODY
    both = identifiability(loaded, BOTH, conditions=[bare])
    assert both.agree
    assert set(both.identifiable) == SPRING_OF_A | BODY
    assert both.ratios == ()


def test_stiff_joint_holds_its_rotor_inertia_with_the_body(write_chain: Chain) -> None:
    """As gravity does with an extra term of its form."""
    drive = {"type": "stiff", "gear_ratio": 50.0}
    chain = write_chain({"a": 'continuous <axis xyz="0 1 0"/>'})
    found = identifiability(load_robot(chain, {"a": drive}))
    assert found.combinations == ("Iyy_a_link + 2500 motor_inertia of a",)
    assert set(found.identifiable) == FRICTION | {"mx_a_link", "mz_a_link"}
    drive = drive | {"extra_terms": ["c*cos(theta_L)"]}
    found = identifiability(load_robot(chain, {"a": drive}))
    assert found.combinations[0].startswith("mx_a_link")
    assert found.combinations[0].endswith("c of a")


def test_motor_torque_of_one_spring_scales_those_behind_it(write_chain: Chain) -> None:
    """The other motor's equation cannot be used, and the reason is said."""
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
    """Nothing but the base joins them."""
    joints = {x: f'continuous base {x}_arm <axis xyz="0 1 0"/>' for x in ("left", "right")}
    robot = load_robot(write_urdf(tree(joints)), dict.fromkeys(joints, SPRING))
    found = identifiability(robot, BOTH)
    assert [len(group) for group in found.ratios] == [5, 5]
    assert all(len({name.rpartition("right")[1] for name in group}) == 1 for group in found.ratios)


def test_unknown_position_spoils_all_rows_that_depend_on_it(
    tulip_leg: Robot, write_chain: Chain
) -> None:
    """Springs of other joints keep their motors' equations, and axes at right angles their rows."""
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
    axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    slides = {name: f'prismatic <axis xyz="{axis}"/>{SLIDE}' for name, axis in axes.items()}
    torque: tuple[Sensor, Sensor] = ("joint_position", "motor_torque")
    sensors = {"x": torque, "y": ("motor_torque",), "z": torque}
    found = identifiability(load_robot(write_chain(slides)), sensors)
    assert found.combinations == ("m_x_link + m_y_link",)
    assert found.identifiable == ("m_z_link",)


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


def test_all_terms_come_along() -> None:
    """Springs, friction, motors and extra terms of all kinds, on both sides of dead zones."""
    robot = load_robot(DATA / "mixed_arm.urdf", DRIVES)
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
    assert (unscaled.rank, [len(group) for group in unscaled.ratios]) == (53, [48])
    assert unscaled.agree
    sensors: tuple[Sensor, ...] = (*BOTH, "motor_voltage", "motor_torque")
    assert [identifiability(robot, sensors, seed=seed).rank for seed in range(3)] == [58] * 3


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


ROBOTS: list[tuple[str, bool, list[tuple[int, int]]]] = [
    ("finger_edu.urdf", True, [(25, 0), (16, 17), (28, 0), (31, 0), (18, 0), (2, 0)]),
    ("panda.urdf", False, [(65, 0), (46, 47), (73, 0), (81, 0), (56, 0), (4, 0)]),
    ("ur5_robot.urdf", True, [(51, 0), (34, 35), (57, 0), (63, 0), (42, 0), (4, 0)]),
    ("xarm7.urdf", True, [(60, 0), (41, 42), (67, 0), (74, 0), (51, 0), (4, 0)]),
    ("a1.urdf", True, [(93, 0), (39, 42), (104, 24), (117, 0), (77, 0), (6, 0)]),
    ("ur5_gripper.urdf", False, [(51, 0), (34, 35), (57, 0), (63, 0), (42, 0), (4, 0)]),
]
"""Whether mimic joints move by themselves, the rank and what is up to a factor for each of SETS.

These counts are those of the same equations modulo a prime, which has no rounding.
"""


@pytest.mark.rounding
@pytest.mark.filterwarnings("ignore::seaid.SeaidWarning")
@pytest.mark.parametrize(("name", "mimics", "counts"), quick_first(ROBOTS))
def test_counts_are_those_without_rounding(
    name: str, mimics: bool, counts: list[tuple[int, int]], example_path: Callable[[str], Path]
) -> None:
    robot = with_springs(example_path(name), independent_mimics=mimics)
    answers = [identifiability(robot, sensors) for sensors in SETS]
    assert [(found.rank, sum(map(len, found.ratios))) for found in answers] == counts
    assert all(found.agree for found in answers)
    exact = seaid.symbolic.base_parameters(robot)
    assert answers[0].base.columns[: answers[0].body_count] == exact.columns


def test_coupled_drives(write_chain: Chain) -> None:
    plain = {"type": "stiff", "gear_ratio": 50.0, "motor_inertia_kg_m2": 1e-5}
    drives = {
        "b": {**plain, "transmission": {"b": 0.5, "c": 0.5}},
        "c": {**SPRING, "transmission": {"b": 0.5, "c": -0.5}},
    }
    axes = {"a": "0 0 1", "b": "0 1 0", "c": "1 0 0"}
    chain = write_chain({name: f'continuous <axis xyz="{x}"/>' for name, x in axes.items()})
    robot = load_robot(chain, drives)
    some: dict[str, tuple[Sensor, ...]] = {"a": ("joint_position",), "b": MOTOR_SIDE}
    found, less = (
        identifiability(robot, sensors)
        for sensors in (None, some | {"c": ("motor_position", "deflection")})
    )
    assert [(answer.rank, answer.agree) for answer in (found, less)] == [(21, True), (18, True)]
    assert found.body_count == len(base_parameters(robot).columns)
    assert "stiffness of c" in found.identifiable
    assert less.ratios == ()
    part = identifiability(robot, dict.fromkeys("ac", BOTH) | {"b": (*BOTH, "motor_torque")})
    assert part.rank >= len(base_parameters(robot, torque_joints=["b"]).columns)


def test_no_large_matrix_is_left_of_a_chain_with_all_torques(
    write_chain: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each sum determines its columns next to those of smaller sums, by a matrix of its own."""
    widths = list[int]()
    reduce = left_to_right

    def counted(H: Array, *more: Any, **options: Any) -> tuple[list[int], Array, float]:
        widths.append(int(np.count_nonzero(H.any(axis=0))) if H.size else 0)
        return reduce(H, *more, **options)

    axes = ("0 0 1", "0 1 0", "1 0 0") * 2
    joints = {f"j{k}": f'continuous <axis xyz="{x}"/>' for k, x in enumerate(axes)}
    robot = load_robot(write_chain(joints), dict.fromkeys(joints, SPRING))
    base_parameters(robot)
    monkeypatch.setattr("seaid.regressor.structural_identifiability.left_to_right", counted)
    assert identifiability(robot).agree
    assert max(widths) <= 12


@pytest.mark.parametrize(
    ("name", "value"), [("_CLEAR_GAP", 1e300), ("_is_confirmed", lambda *_: False)]
)
def test_a_rank_without_a_clear_gap_or_that_other_instants_contradict_is_not_sure(
    name: str, value: Any, tulip_leg: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nominal values make no difference."""
    sure = identifiability(tulip_leg.without_nominal())
    assert sure.agree
    assert sure.base.expressions == identifiability(tulip_leg).base.expressions
    monkeypatch.setattr(f"seaid.regressor.structural_identifiability.{name}", value)
    assert not identifiability(tulip_leg).agree


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
    assert less.agree
    assert greater.agree
    assert full.agree
    assert less.rank <= greater.rank
    assert set(less.identifiable) <= set(greater.identifiable)
    assert full.body_count == len(base_parameters(robot).columns)


def test_table_says_all_of_it(write_chain: Chain) -> None:
    text = str(identifiability(pendulum(write_chain), BOTH))
    assert "14 parameters, of which the sensors determine 4 combinations" in text
    assert "Up to scale: 5" in text
    assert "a (motor_position, joint_position): (7) of its motor cannot be used" in text
    assert "Unidentifiable: 9" in text
    assert "agree" in text
    assert max(map(len, text.splitlines())) <= 100
    assert "no sensor" in identifiability(pendulum(write_chain), ()).summary()
    no_rotor = pendulum(write_chain, drive={"motor_inertia_kg_m2": None})
    words = identifiability(no_rotor, (*BOTH, "motor_current")).usable["a"]
    assert "its motor torque is known only up to the scale of its torque constant" in words
    assert "its spring torque is known only up to the scale of its stiffness" in words


@pytest.mark.parametrize(
    ("sensors", "words"),
    [
        (("motor_torqe",), r"'hip_yaw'.* 'motor_torqe'; did you mean 'motor_torque'"),
        ({"knee_pitc": BOTH}, r"'knee_pitc'; did you mean 'knee_pitch'"),
        ("deflection", r"must be a list of names or a mapping.* text 'deflection'"),
        (None, "the same robot with other payloads"),
    ],
)
def test_unknown_names_and_conditions_of_another_robot_are_refused(
    sensors: Any, words: str, tulip_leg: Robot, write_chain: Chain
) -> None:
    """Names of sensors and of joints come with the nearest."""
    conditions = [] if sensors else [pendulum(write_chain)]
    with pytest.raises(RobotError, match=words):
        identifiability(tulip_leg, sensors, conditions=conditions)


def test_random_motions_satisfy_the_equations(tulip_leg: Robot) -> None:
    """(3), and (7) and (8) with a known payload, homogeneous as no motor is known."""
    drives = {x: replace(y, motor_inertia_kg_m2=None) for x, y in tulip_leg.drives.items()}
    leg, rng = tulip_leg.with_drives(drives), np.random.default_rng(0)
    sensors = dict.fromkeys(leg.joint_names, frozenset({*BOTH, "motor_current"}))
    system = system_of(leg, sensors, dependencies(leg, 0))
    truth, payload = random_truth(system, rng), rng.uniform(0.5, 1.5, leg.parameters.size)
    pairs = zip(system.terms, truth.drives, strict=True)
    of_drives = [values[symbol] for terms, values in pairs for symbol in terms.unknowns]
    theta = np.array([*truth.bodies + payload, *of_drives])
    rows = rows_of_sums(system, truth, rng, 5, payload)
    assert len(rows) == leg.n + len(leg.elastic_joints)
    for columns, values in rows:
        parts = values * theta[columns]
        assert np.max(np.abs(parts.sum(axis=1))) < 1e-10 * np.max(np.abs(parts))
    for signals in _instants(system, truth, rng, 5, payload)[1]:
        for order, stretch in (("", STRETCH), ("_dot", STRETCH_DOT)) * (STRETCH in signals):
            motor, joint = (signals[plain(f"theta_{side}{order}")] for side in "ML")
            expected = motor * signals[r_M] / signals[N] - signals[r_L] * joint
            np.testing.assert_allclose(signals[stretch], expected, atol=1e-12)


@pytest.mark.parametrize(("axis", "count"), [("0 1 0", 6), ("0 0 1", 4)])
def test_a_motor_side_alone_tells_of_a_pendulum_by_its_derivatives(
    axis: str, count: int, write_chain: Chain
) -> None:
    """An offset of the spring is one of the joint's angle, and turns the body.

    The counts are those of motor angles simulated under a torque, by their slopes.
    """
    unknown = {"motor_inertia_kg_m2": None, "stiffness_Nm_per_rad": None}
    found = identifiability(
        pendulum(write_chain, axis, drive={"friction": ["viscous"], **unknown}), MOTOR_SIDE
    )
    assert found.rank == 0
    assert found.derivatives is not None
    assert len(found.derivatives.columns) == count
    alone = {*found.derivatives.expressions}
    assert {f"{x} of a" for x in ("stiffness", "motor_inertia", "viscous_friction")} <= alone
    assert "By derivatives of motor angle and motor torque" in str(found.summary())


def test_derivatives_of_torques_are_those_along_the_motion(tulip_leg: Robot) -> None:
    """The torques along its Taylor polynomial, exact up to order 2, by central differences."""
    (position, torque), step = _instant(tulip_leg, np.random.default_rng(0)), 1e-3
    x = [np.polynomial.Polynomial(c / [1, 1, 2, 6, 24]) for c in position.T]
    times = step * np.arange(-1, 2)
    q, v, a = (np.column_stack([f.deriv(k)(times) for f in x]) for k in range(3))
    before, now, after = joint_torques(tulip_leg, q, v, a)
    found = now, (after - before) / (2 * step), (after - 2 * now + before) / step**2
    np.testing.assert_allclose(torque[:3], found, rtol=1e-4, atol=1e-3)


def test_columns_of_a_motor_have_their_derivatives() -> None:
    """Of every term, along a polynomial of the motor angle, by central differences."""
    terms = ("viscous", "coulomb", "offset", "quadratic", "asymmetric")
    angle, step = np.polynomial.Polynomial([0.1, -2.0, 0.3, 0.5, -0.2]), 1e-3
    before, now, after = (
        _columns(StiffDrive(50.0, friction=terms), np.array([angle.deriv(k)(t) for k in range(5)]))
        for t in (-step, 0.0, step)
    )
    assert len(now) == 6
    for name, (value, *found) in now.items():
        sides = before[name][0], after[name][0]
        by_steps = (sides[1] - sides[0]) / (2 * step), (sum(sides) - 2 * value) / step**2
        assert found == pytest.approx(by_steps, rel=1e-4, abs=1e-4)


def test_rows_of_a_motor_side_are_derivatives_by_its_parameters(tulip_leg: Robot) -> None:
    """The torque of the bodies less that of the spring, behind the motor, by differences."""
    leg, knee = tulip_leg, 3
    position, torque = _instant(tulip_leg, np.random.default_rng(0))
    names = [f"{x} of knee_pitch" for x in ("viscous_friction", "stiffness", "spring_offset")]
    places = {name: place for place, name in enumerate([*leg.parameter_names, *names])}
    sensors = dict.fromkeys(leg.joint_names, frozenset({"joint_torque"}))
    sensors["knee_pitch"] = frozenset(MOTOR_SIDE)
    truth, radius, lever = np.array([0.0, 90.0, 0.0]), 0.036, 86 / 0.020
    rows = _rows(leg, np.full(leg.n, truth[1]), sensors, places, np.random.default_rng(0))
    spring = torque[:, knee] / radius
    motor = lever * (radius * position[:, knee] + spring / truth[1])

    def torques(viscous: float, stiffness: float, offset: float) -> Array:
        force = spring[:3] - lever * viscous * motor[1:4]
        q = position[:3].copy()
        q[:, knee] = (motor[:3] / lever - (force - [offset, 0, 0]) / stiffness) / radius
        return np.asarray(
            joint_torques(leg, *q[:, None])[0] - radius * force[0] * np.eye(leg.n)[knee]
        )

    for place, step in enumerate((1e-10, 1e-3, 1e-5)):
        change = step * (np.arange(3) == place)
        slope = (torques(*truth - change) - torques(*truth + change)) / (2 * step)
        np.testing.assert_allclose(rows[: leg.n, place - 3], slope, rtol=1e-5, atol=1e-6)


def test_motor_sides_alone_determine_all_of_the_leg_but_one_combination() -> None:
    """The offset of the ankle's spring turns the foot; the other joints may have any sensors."""
    leg = seaid.load_robot("models/tulip_leg.urdf", "models/tulip_leg.toml")
    by_regression = seaid.identifiability(leg)
    found = seaid.identifiability(leg, MOTOR_SIDE)
    assert found.derivatives is not None
    assert by_regression.derivatives is None
    assert len(found.derivatives.columns) == by_regression.rank - 1 == 44
    assert found.derivatives.gap > 1e6
    assert {f"stiffness of {x}" for x in leg.elastic_joints} <= {*found.derivatives.expressions}
    both: tuple[Sensor, ...] = (*MOTOR_SIDE, "joint_position")
    sensors = {joint: MOTOR_SIDE if joint == "knee_pitch" else both for joint in leg.joint_names}
    derivatives = seaid.identifiability(leg, sensors).derivatives
    assert derivatives is not None
    assert len(derivatives.columns) == 45
    sensors["hip_yaw"] = ("motor_torque",)
    assert seaid.identifiability(leg, sensors).derivatives is None
