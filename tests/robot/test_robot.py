"""load_robot: the same robot as Pinocchio's own reader has, joints and payloads as asked for."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaid._arrays import Array
from seaid.drives import StiffDrive
from seaid.errors import RobotError
from seaid.legged import load_robot
from seaid.regressor import joint_torques, rigid_body_regressor
from seaid.robot import Payload, Robot
from seaid.robot.inertia import parameter_names
from tests.plants import body, states, write_robot
from tests.regressor.trees import Joint, joints, joints_of

Load = Callable[..., Robot]
Chain = Callable[..., Path]


def pinocchio_torques(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """Return the inverse dynamics of a Pinocchio model, whose continuous joints have cos, sin."""
    data, torques = model.createData(), np.empty_like(q)
    for t, row in enumerate(q):
        full = np.empty(model.nq)
        for joint, angle in zip(list(model.joints)[1:], row, strict=True):
            values = [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
            full[joint.idx_q : joint.idx_q + joint.nq] = values
        torques[t] = pin.rnea(model, data, full, v[t], a[t])
    return torques


def own_reader(path: Path) -> pin.Model:
    return pin.buildModelFromUrdf(str(path), mimic=False)


def assert_same(ours: Array, theirs: Array, *, rtol: float = 1e-9) -> None:
    np.testing.assert_allclose(ours, theirs, rtol=rtol, atol=1e-12 * np.max(np.abs(theirs)))


def test_joints_and_torques_are_those_of_pinocchios_own_reader(
    example_urdf: Path, load_quietly: Load
) -> None:
    robot = load_quietly(example_urdf, snap_tolerance_rad=0)
    theirs = own_reader(example_urdf)
    assert robot.joint_names == tuple(theirs.names)[1:]
    assert robot.model.nq == robot.model.nv == robot.n == theirs.nv
    state = states(robot.n)
    assert_same(joint_torques(robot, *state), pinocchio_torques(theirs, *state))


@given(
    tree=st.lists(joints, min_size=1, max_size=5),
    data=st.data(),
    gravity=st.sampled_from([(0.0, 0.0, -9.81), (1.0, -2.0, 3.0)]),
)
def test_any_robot_is_that_of_pinocchios_own_reader(
    tree: list[Joint],
    data: st.DataObject,
    gravity: tuple[float, float, float],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Joints are in the user's order, others locked anywhere; fixed links may be empty or loaded.

    A payload adds to the known side, and not to the parameters.
    """
    names = [f"j{number}" for number in range(1, len(tree) + 1)]
    order = data.draw(st.permutations(names))[: data.draw(st.integers(1, len(names)))]
    others = [name for name in names if name not in order]
    places = {name: data.draw(st.sampled_from([0.0, 0.4, 0.9])) for name in others}
    locked = {name: place for name, place in places.items() if place}  # at zero without a name
    last, place = f"l{order[0][1:]}", '<origin xyz="0.1 0 0.2" rpy="0.4 0.5 -0.6"/>'
    fixed = {
        "weld": "fixed world l0 " + place,
        "to_stand": "fixed l0 stand " + place,
        "to_tool": f"fixed {last} tool {place}",
        "to_tip": f"fixed {last} tip {place}",
    }
    bodies = {f"l{number}": body(number) for number in range(1, len(tree) + 1)}
    bodies |= {"stand": body(10), "tool": body(11)}
    folder = tmp_path_factory.mktemp("tree")
    path = write_robot(folder / "tree.urdf", joints_of(tree) | fixed, bodies)
    tensor = ((0.02, 0.001, 0.0), (0.001, 0.03, -0.002), (0.0, -0.002, 0.025))
    payload = Payload("tool", 2.0, (0.15, -0.05, 0.1), tensor)
    options: dict[str, Any] = {"joints": order, "locked": locked, "gravity": gravity}
    robot = load_robot(path, payloads=[payload], **options)
    assert robot.joint_names == tuple(order)
    assert robot.body_names == tuple(f"l{name[1:]}" for name in order)
    assert robot.parameter_names == parameter_names(robot.body_names)
    assert robot.is_prismatic == tuple(tree[int(x[1:]) - 1][0] == "prismatic" for x in order)
    theirs, state = own_reader(path), states(len(order))
    theirs.gravity.linear = np.array(gravity)
    frame = theirs.frames[theirs.getFrameId("tool")]
    inertia = pin.Inertia(2.0, np.array(payload.com), np.array(tensor))
    theirs.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
    columns, still = ([list(theirs.names)[1:].index(x) for x in some] for some in (order, places))
    whole = np.zeros((3, 6, theirs.nv))
    whole[:, :, columns] = state
    whole[0][:, still] = list(places.values())
    torques = pinocchio_torques(theirs, *whole)[:, columns]
    assert_same(joint_torques(robot, *state), torques)
    Y = rigid_body_regressor(robot, *state)
    assert_same(Y @ (robot.parameters + robot.payload_parameters), torques)
    plain = load_robot(path, **options)
    np.testing.assert_array_equal(robot.parameters, plain.parameters)
    assert not np.any(plain.payload_parameters)
    assert_same(joint_torques(plain, *state), Y @ plain.parameters)


def test_limits_are_in_the_users_order_and_endless_where_there_are_none(write_chain: Chain) -> None:
    limit = '<limit lower="-0.5" upper="1.5" velocity="2" effort="30"/>'
    path = write_chain({"a": f"revolute {limit}", "b": f"continuous {limit}", "c": "prismatic"})
    robot = load_robot(path, joints=["c", "b", "a"])
    assert robot.lower_limits.tolist() == [-np.inf, -np.inf, -0.5]
    assert robot.upper_limits.tolist() == [np.inf, np.inf, 1.5]
    assert robot.velocity_limits.tolist() == [np.inf, 2.0, 2.0]
    assert robot.effort_limits.tolist() == [np.inf, 30.0, 30.0]


SKEW = ((1.0, 0.5, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
HUGE = ((1e300, 0, 0), (0, 1e300, 0), (0, 0, 1e300))
NEGATIVE = ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
HERE = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        ((0.0,), r"mass of the payload on 'foot' must be 1e-30 to 1e\+09 kg, found 0"),
        ((np.nan,), "mass of the payload on 'foot' must be .* found nan"),
        (("2",), "mass of the payload on 'foot' must be a number, found '2'"),
        ((1e10,), r"must be 1e-30 to 1e\+09 kg, found 1e\+10"),
        ((1e-320,), r"must be 1e-30 to 1e\+09 kg, found 1e-320|found 9\.99"),
        ((1.0, (np.nan, 0.0, 0.0)), r"com of the payload on 'foot' must .*found \[nan, 0.0"),
        ((1.0, (0.0, 0.0)), r"com of the payload on 'foot' must have shape \(3\)"),
        ((1.0, (0.0, -1e200, 0.0)), "has its centre of mass further than 10000 m away"),
        ((1.0, HERE, SKEW), "inertia of the payload on 'foot' must be a symmetric matrix"),
        ((1.0, HERE, NEGATIVE), "without negative principal moments"),
        ((1.0, HERE, HUGE), r"payload on 'foot' has an inertia of 1e\+300 kg m\^2"),
    ],
)
def test_payload_that_cannot_be_is_refused(payload: tuple[Any, ...], words: str) -> None:
    with pytest.raises(RobotError, match=words):
        Payload("foot", *payload)


@pytest.mark.parametrize("kind", ["floating", "planar", "spherical"])
def test_joint_of_several_axes_is_refused_by_name_and_can_be_left_out(
    write_chain: Chain, kind: str
) -> None:
    path = write_chain({"ball": kind, "elbow": 'revolute <axis xyz="0 1 0"/>'})
    with pytest.raises(RobotError, match=f"joint 'ball' is {kind}; .*there are elbow"):
        load_robot(path)
    with pytest.raises(RobotError, match=f"joint 'ball' is {kind}"):
        load_robot(path, joints=["elbow", "ball"])
    robot = load_robot(path, joints=["elbow"])
    welded = load_robot(write_chain({"ball": "fixed", "elbow": 'revolute <axis xyz="0 1 0"/>'}))
    state = states(1)
    assert robot.joint_names == ("elbow",)
    assert_same(joint_torques(robot, *state), joint_torques(welded, *state))
    with pytest.raises(RobotError, match="joint 'ball' is fixed"):
        load_robot(path, joints=["ball"])
    with pytest.raises(RobotError, match=r"test\.urdf' has no joint that moves"):
        load_robot(write_chain({"weld": "fixed"}))


def test_robot_is_read_only(tulip_leg: Robot) -> None:
    with pytest.raises(ValueError, match="read-only"):
        tulip_leg.parameters[0] = 1.0
    with pytest.raises(TypeError):
        tulip_leg.drives["knee_pitch"] = StiffDrive(gear_ratio=1)  # type: ignore[index]
    with pytest.raises(AttributeError):
        tulip_leg.name = "other"  # type: ignore[misc]


def test_other_values_and_the_first_again_give_the_first_robot(tulip_urdf: Path) -> None:
    """Between them nothing nominal is left: ratios, rotors and payloads are what is known."""
    drives, payload = tulip_urdf.with_suffix(".toml"), Payload("shank", 1.0, (0.1, 0.0, 0.0))
    joints = ["ankle_pitch", "knee_pitch", "hip_pitch", "hip_yaw"]
    robot = load_robot(tulip_urdf, drives, joints=joints, payloads=[payload])
    known, state = robot.without_nominal(), states(4)
    Y = rigid_body_regressor(robot, *state)
    assert np.all(np.isnan(known.parameters))
    assert np.all(np.isnan(joint_torques(known, *state)))
    assert all(not np.any(np.isfinite(body.inertia)) for body in list(known.model.inertias)[1:])
    for drive in known.drives.values():
        assert set(drive.values) == {"motor_inertia"}
        assert drive.ratio > 80
    np.testing.assert_array_equal(known.payload_parameters, robot.payload_parameters)
    np.testing.assert_array_equal(rigid_body_regressor(known, *state), Y)
    other = robot.with_values(2 * robot.parameters, robot.drives)
    back = known.with_values(robot.parameters, robot.drives)
    total = Y @ (2 * robot.parameters + robot.payload_parameters)
    assert_same(joint_torques(other, *state), total)
    assert_same(joint_torques(back, *state), joint_torques(robot, *state))
    assert dict(back.drives) == dict(robot.drives)
    with pytest.raises(RobotError, match=r"parameters must have shape \(40\), found \(39,\)"):
        robot.with_values(robot.parameters[1:], robot.drives)


STIFF = StiffDrive(gear_ratio=1.0)
BROKEN = StiffDrive(gear_ratio=1.0, extra_terms=("c*",))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"joints": ["hip_yaw", "knee"]}, r"'tulip_leg': no joint is named 'knee'; did you mean"),
        ({"joints": "hip_yaw"}, r"joints= must be a list of names, found .*'hip_yaw'"),
        ({"joints": []}, r"leg\.urdf' has no joint that moves"),
        ({"payloads": [Payload("foott", 1.0)]}, r"no link is named 'foott'; did you mean 'foot'\?"),
        ({"payloads": [Payload("trunk", 1.0)]}, "payloads=: no joint moves 'trunk'"),
        ({"known_bodies": ["shnak"]}, "known_bodies: no body .* 'shnak'; did you mean 'shank'"),
        ({"known_bodies": ["trunk"]}, "no body that a joint moves is named 'trunk'; allowed"),
        ({"known_bodies": "trunk"}, "no body that a joint moves is named 'trunk'; allowed"),
        ({"gravity": (0.0, 0.0)}, "gravity=? must"),
        ({"gravity": (0.0, 0.0, np.nan)}, "gravity=? must"),
        ({"drives": {"kneepitch": STIFF}}, "'tulip_leg': no joint is named 'kneepitch'; did you"),
        ({"drives": {"knee_pitch": BROKEN}}, r"'knee_pitch': extra term 'c\*' is not an"),
        ({"drives": [1]}, "must be a path or a mapping"),
        ({"drives": {"knee_pitch": None}}, "must be a table of a drive"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    tulip_urdf: Path, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(RobotError, match=words):
        load_robot(tulip_urdf, **options)


def test_drive_for_the_other_kind_of_joint_is_refused(write_chain: Chain) -> None:
    """Ratio and radii of a joint that turns are none of one that slides."""
    path = write_chain({"turn": "revolute", "slide": "prismatic"})
    per_m, per_turn = {"gear_ratio_rad_per_m": 9.0}, {"gear_ratio": 9.0}
    radius, both = {"motor_pulley_radius_m": 0.1}, {"load_pulley_radius_m": 0.1}
    elastic = {"type": "series_elastic", **per_turn}
    for joint, table, words in (
        ("turn", {"type": "stiff", **per_m}, "has gear_ratio, found gear_ratio_rad_per_m"),
        ("slide", {"type": "stiff", **per_turn}, "has gear_ratio_rad_per_m, found gear_ratio"),
        ("turn", elastic | radius, "turns: its linear spring needs load_pulley_radius_m"),
        ("slide", elastic, "is prismatic: its elastic drive has motor_pulley_radius_m"),
        ("slide", elastic | radius | both, "prismatic: .* and no load_pulley_radius_m"),
    ):
        with pytest.raises(RobotError, match=f"joint '{joint}' .*{words}"):
            load_robot(path, {joint: table})
    load_robot(path, {"turn": elastic | radius | both, "slide": elastic | radius})
    load_robot(path, {"turn": elastic, "slide": {"type": "stiff", **per_m}})


def test_rows_names_each_joint_once_and_takes_a_plain_name(tulip_leg: Robot) -> None:
    """A torque counted twice would make the standard errors too small."""
    assert tulip_leg.selected(["knee_pitch", "hip_yaw", "knee_pitch"]) == ("knee_pitch", "hip_yaw")
    assert tulip_leg.selected("knee_pitch") == ("knee_pitch",)
    assert tulip_leg.selected(None) == tulip_leg.joint_names
    with pytest.raises(RobotError, match="tulip_leg: no joint is named 'kneepitch'; did you mean"):
        tulip_leg.selected("kneepitch")
