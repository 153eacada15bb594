"""What is shown of a robot: where its links are, how they look, what is said to be missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from seaid._arrays import Array
from seaid.errors import RobotError
from seaid.legged import load_robot
from seaid.robot.inertia import from_center_of_mass, in_parent_frame
from seaid.robot.pinocchio_model import Payload
from seaid.robot.robot import Robot
from seaid.robot.robot_file import reread_urdf
from seaid.view.picture import (
    GREY,
    Ellipsoid,
    Picture,
    ellipsoids_of,
    link_places,
    picture_of,
    placements,
    rest_posture,
)

ROBOTS = [
    "ur5_robot.urdf",
    "panda.urdf",
    "tiago_no_hand.urdf",
    "a1.urdf",
    "kinova.urdf",
    "double_pendulum.urdf",
]
"""With mimic, prismatic, continuous and fixed joints among them, and no rounded angles."""

Load = Callable[..., Robot]


def posture(robot: Robot, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    lower, upper = np.maximum(robot.lower_limits, -2.0), np.minimum(robot.upper_limits, 2.0)
    return np.asarray(rng.uniform(lower, upper))


def frames_by_pinocchio(path: Path, positions: dict[str, float]) -> dict[str, pin.SE3]:
    """Return all links of a file by Pinocchio's own reader, joints not named at zero."""
    model = pin.buildModelFromUrdf(str(path))
    data, q = model.createData(), pin.neutral(model)
    for name, value in positions.items():
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 2:  # a continuous joint: cosine and sine
            q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
        else:
            q[joint.idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    bodies = [(i, one) for i, one in enumerate(model.frames) if one.type == pin.FrameType.BODY]
    return {one.name: data.oMf[i] for i, one in bodies}


def link_placements(picture: Picture, q: Array) -> dict[str, pin.SE3]:
    """Return the placements of all links of the URDF, including fixed and locked ones."""
    assert picture.robot.urdf is not None
    places = link_places(reread_urdf(picture.robot.urdf), picture.robot)
    joints = placements(picture.robot, q)
    return {link: joints[joint] * place for link, (joint, place) in places.items()}


def largest_difference(found: dict[str, pin.SE3], expected: dict[str, pin.SE3]) -> float:
    assert set(found) == set(expected) - {"universe"}
    return max(
        float(np.max(np.abs(found[name].homogeneous - expected[name].homogeneous)))
        for name in found
    )


@pytest.mark.slow  # 1.4 s
@pytest.mark.parametrize("name", ROBOTS)
def test_links_are_where_pinocchio_has_them(
    name: str, example_path: Callable[[str], Path], load_quietly: Load
) -> None:
    path = example_path(name)
    robot = load_quietly(path)
    picture, q = picture_of(robot), posture(robot, 1)
    expected = frames_by_pinocchio(path, dict(zip(robot.joint_names, q, strict=True)))
    assert largest_difference(link_placements(picture, q), expected) < 1e-9


def test_order_of_joints_and_locked_ones_count(
    example_path: Callable[[str], Path], load_quietly: Load
) -> None:
    path = example_path("panda.urdf")
    robot = load_quietly(path, joints=("panda_joint6", "panda_finger_joint2", "panda_joint2"))
    q = posture(robot, 3)
    expected = frames_by_pinocchio(path, dict(zip(robot.joint_names, q, strict=True)))
    assert largest_difference(link_placements(picture_of(robot), q), expected) < 1e-9


def test_bodies_are_at_the_joints_of_the_robots_model(
    example_path: Callable[[str], Path], load_quietly: Load
) -> None:
    robot = load_quietly(example_path("ur10_robot.urdf"))  # its angles are rounded
    q, data = posture(robot, 4), robot.model.createData()
    pin.forwardKinematics(robot.model, data, q[list(robot.model_order)])
    placed = link_placements(picture_of(robot), q)
    for name, body in zip(robot.joint_names, robot.body_names, strict=True):
        expected = data.oMi[robot.model.getJointId(name)]
        np.testing.assert_allclose(placed[body].homogeneous, expected.homogeneous, atol=1e-12)


@pytest.mark.parametrize("name", ["ur5_robot.urdf", "panda.urdf", "xarm7.urdf"])
def test_meshes_of_packages_are_found(
    name: str, example_path: Callable[[str], Path], load_quietly: Load
) -> None:
    picture = picture_of(load_quietly(example_path(name)))
    assert picture.notes == ()
    assert sum(len(mesh.faces) for mesh in picture.meshes.values()) > 10_000
    assert len({color_of(part) for part in picture.objects("bodies")}) > 1


def color_of(part: pin.GeometryObject) -> tuple[int, ...]:
    """Return the colour as viser takes it from the floats of an object, by truncation."""
    return tuple(int(255.0 * channel) for channel in part.meshColor[:3])


def middle_of(part: pin.GeometryObject) -> Array:
    return np.asarray(part.placement.translation)


def visual(geometry: str, origin: str = "", material: str = "") -> str:
    return f"<visual>{origin}<geometry>{geometry}</geometry>{material}</visual>"


def shown(
    write_urdf: Callable[[str], Path], inside: str, top: str = "", **options: object
) -> Picture:
    """Return the picture of a base that carries a link with visuals 1 m above it."""
    path = write_urdf(
        f'{top}<link name="base"/><link name="arm">{inside}</link>'
        '<joint name="j" type="revolute"><parent link="base"/><child link="arm"/>'
        '<origin xyz="0 0 1"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
    )
    return picture_of(load_robot(path), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("geometry", "half_size"),
    [
        ('<box size="0.2 0.4 0.6"/>', (0.1, 0.2, 0.3)),
        ('<sphere radius="0.1"/>', (0.1, 0.1, 0.1)),
        ('<cylinder radius="0.1" length="0.6"/>', (0.1, 0.1, 0.3)),
    ],
)
def test_primitive_shapes_have_their_size(
    write_urdf: Callable[[str], Path], geometry: str, half_size: tuple[float, ...]
) -> None:
    (shape,) = shown(write_urdf, visual(geometry)).objects("bodies")
    assert (shape.parentJoint, color_of(shape)) == (1, GREY)
    assert type(shape.geometry).__name__.lower() in geometry
    shape.geometry.computeLocalAABB()
    np.testing.assert_allclose(shape.geometry.aabb_local.max_, half_size)


def test_origins_colours_and_fixed_links_count(write_urdf: Callable[[str], Path]) -> None:
    red = '<material name="red"/>'
    picture = shown(
        write_urdf,
        visual('<box size="0.2 0.2 0.2"/>', '<origin xyz="1 0 0" rpy="0 0 0"/>', red)
        + visual(
            '<sphere radius="0.1"/>',
            material='<material name="own"><color rgba="0 0.5 1 1"/></material>',
        ),
        '<material name="red"><color rgba="1 0 0 1"/></material><link name="tip"/>'
        '<joint name="f" type="fixed"><parent link="arm"/><child link="tip"/>'
        '<origin xyz="0 0 0.5"/></joint>',
    )
    box, sphere = picture.objects("bodies")
    assert color_of(box) == (255, 0, 0)
    assert color_of(sphere) == (0, 128, 255)
    np.testing.assert_allclose(middle_of(box), [1.0, 0.0, 0.0], atol=1e-12)
    placement = link_placements(picture, np.array([np.pi / 2]))["tip"]
    np.testing.assert_allclose(placement.translation, [0.5, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("ending", ["stl", "obj", "ply"])
def test_meshes_are_scaled_and_searched_in_package_dirs(
    write_urdf: Callable[[str], Path], tmp_path: Path, ending: str
) -> None:
    packages = tmp_path / "elsewhere"
    (packages / "arms" / "meshes").mkdir(parents=True)
    box = trimesh.creation.box((1.0, 2.0, 3.0)).apply_translation([5.0, 0.0, 0.0])
    box.export(packages / "arms" / "meshes" / f"a.{ending}")
    mesh = visual(f'<mesh filename="package://arms/meshes/a.{ending}" scale="0.1 0.1 0.01"/>')
    missing = shown(write_urdf, mesh)
    assert missing.objects("bodies") == []
    assert missing.notes == (
        f"mesh 'package://arms/meshes/a.{ending}' is not found (link 'arm'): name the folder that "
        "contains the package 'arms' with --package-dir (package_dirs=), or set ROS_PACKAGE_PATH",
    )
    assert missing.bare_bodies == ("arm",)
    found = shown(write_urdf, mesh, package_dirs=packages)
    (part,) = found.objects("bodies")
    np.testing.assert_allclose(2.0 * part.geometry.halfSide, [0.1, 0.2, 0.03], rtol=1e-6)
    np.testing.assert_allclose(middle_of(part), [0.5, 0.0, 0.0], atol=1e-9)
    mesh = found.meshes[part.name]
    np.testing.assert_allclose(mesh.bounds, [-part.geometry.halfSide, part.geometry.halfSide])
    assert found.notes == found.bare_bodies == ()


def test_mesh_that_cannot_be_read_makes_a_note(
    write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    (tmp_path / "bad.stl").write_text("no mesh at all")
    both = visual('<mesh filename="bad.stl"/>') + visual('<box size="1 1 1"/>')
    picture = shown(write_urdf, both)
    assert len(picture.objects("bodies")) == 1
    assert picture.notes == (
        f"mesh '{tmp_path / 'bad.stl'}' has no triangles (link 'arm'): replace it by an STL, OBJ, "
        "PLY, glTF or Collada file with triangles",
    )
    (tmp_path / "bad.dae").write_text("no mesh at all")
    (note,) = shown(write_urdf, visual('<mesh filename="bad.dae"/>')).notes
    assert f"mesh '{tmp_path / 'bad.dae'}' cannot be read" in note


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("file:///gone/a.stl", "put the file there, or correct the path in the URDF"),
        ("meshes/a.stl", "put it in the folder of the URDF, or name the folder of its path with"),
    ],
)
def test_note_on_a_missing_mesh_has_its_remedy(
    write_urdf: Callable[[str], Path], name: str, remedy: str
) -> None:
    several = "".join(visual(f'<mesh filename="{name}{number}"/>') for number in (1, 2, 3))
    (note,) = shown(write_urdf, several).notes
    assert f"mesh '{name}1' is not found (link 'arm'), and 2 others likewise: {remedy}" in note


def test_what_cannot_be_shown_is_refused(
    write_urdf: Callable[[str], Path], tulip_leg: Robot, tulip_urdf: Path, tmp_path: Path
) -> None:
    with pytest.raises(RobotError, match="package_dirs: there is no folder"):
        shown(write_urdf, visual('<box size="1 1 1"/>'), package_dirs="nowhere")
    with pytest.raises(RobotError, match=r"joint positions must have shape \(5\)"):
        placements(tulip_leg, np.zeros(4))
    with pytest.raises(RobotError, match="joint positions must be finite"):
        placements(tulip_leg, np.full(5, np.nan))
    with pytest.raises(RobotError, match="has no URDF to show"):
        picture_of(replace(tulip_leg, urdf=None))
    with pytest.raises(RobotError, match="no URDF file at"):
        picture_of(replace(tulip_leg, urdf=tmp_path / "gone.urdf"))
    changed = tmp_path / "changed.urdf"
    changed.write_text(tulip_urdf.read_text().replace('"knee_pitch"', '"knee"'))
    with pytest.raises(RobotError, match=r"has no joint knee_pitch any more.*load it again"):
        picture_of(replace(tulip_leg, urdf=changed))


def ends_of(line: pin.GeometryObject) -> list[Array]:
    """Return the ends of a line in the frame of its joint."""
    half = np.array([0.0, 0.0, line.geometry.halfLength])
    return [line.placement.act(end) for end in (-half, half)]


def rounded(points: list[Array]) -> list[tuple[float, ...]]:
    return sorted(tuple((np.round(point, 9) + 0.0).tolist()) for point in points)


def test_lines_join_joints_rails_and_payloads(write_chain: Callable[..., Path]) -> None:
    limit = '<limit lower="-0.1" upper="0.3" velocity="1" effort="1"/>'
    path = write_chain({"a": f"revolute {limit}", "b": f"prismatic {limit}"}, empty=("b_link",))
    robot = load_robot(path, payloads=[Payload("b_link", 2.0, (0.0, 0.1, 0.0))])
    picture = picture_of(robot)
    assert picture.objects("bodies") == []
    assert picture.bare_bodies == ("a_link", "b_link")
    still, slid = (placements(robot, np.array([0.3, slide])) for slide in (0.0, 0.2))
    lines = picture.objects("lines")
    ends = [slid[line.parentJoint].act(end) for line in lines for end in ends_of(line)]
    a, b = still[1].translation, still[2].translation
    rail = [still[2].act(np.array([end, 0.0, 0.0])) for end in (-0.1, 0.3)]
    payload = [slid[2].translation, slid[2].act(np.array([0.0, 0.1, 0.0]))]
    assert rounded(ends) == rounded([np.zeros(3), a, a, b, *rail, *payload])


def test_leaf_has_a_line_to_its_centre_of_mass(write_chain: Callable[..., Path]) -> None:
    robot = load_robot(write_chain({"a": "continuous"}))
    picture = picture_of(robot)
    (center,) = picture.nominal
    lines = picture.objects("lines")
    assert [line.parentJoint for line in lines] == [0, 1]
    np.testing.assert_allclose(ends_of(lines[1]), [np.zeros(3), center.center], atol=1e-12)
    assert center.mass == pytest.approx(robot.parameters[0])


def test_payloads_are_marked_where_they_are(tulip_urdf: Path) -> None:
    payloads = [Payload("foot", 1.0, (0.1, 0.0, 0.0)), Payload("foot", 3.0, (0.2, 0.0, 0.0))]
    robot = load_robot(tulip_urdf, payloads=payloads)
    (ball,) = picture_of(robot).objects("payloads")
    assert ball.parentJoint == 5
    assert 4 / 3 * np.pi * ball.geometry.radius**3 * 7850.0 == pytest.approx(4.0)
    np.testing.assert_allclose(middle_of(ball), [0.175, 0.0, 0.0])


def test_unknown_bodies_have_no_ellipsoid(tulip_leg: Robot) -> None:
    assert len(picture_of(tulip_leg).nominal) == 5
    assert picture_of(tulip_leg.without_nominal()).nominal == ()


def test_inconsistent_bodies_are_notes_with_a_remedy(tulip_leg: Robot) -> None:
    values = np.array(tulip_leg.parameters)
    values[[14, 24]] = -1.0
    wrong = tulip_leg.with_values(values, tulip_leg.drives)
    names = tulip_leg.body_names[1:3]
    for picture, which, remedy in (
        (picture_of(tulip_leg, identified=wrong), "identified", "feasible=True (--feasible)"),
        (picture_of(wrong), "nominal", "correct the inertial parameters of the URDF"),
    ):
        (note,) = picture.notes
        several = ", ".join(f"'{name}'" for name in names)
        assert f"the {which} bodies {several} are physically inconsistent, marked" in note
        assert f"'{names[0]}' has a negative principal moment of inertia" in note
        assert note.endswith(remedy)


def test_up_is_against_gravity(tulip_urdf: Path) -> None:
    for gravity, up in (
        ((-9.81, 0.0, 0.0), (1.0, 0.0, 0.0)),
        ((0.0, 3.0, -4.0), (0.0, -0.6, 0.8)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    ):
        np.testing.assert_allclose(picture_of(load_robot(tulip_urdf, gravity=gravity)).up, up)


def test_outline_is_around_all_that_is_shown(tulip_leg: Robot) -> None:
    picture = picture_of(tulip_leg)
    postures = np.array([posture(tulip_leg, seed) for seed in range(5)])
    points = picture.outline(postures)
    for q in postures:
        joints = placements(tulip_leg, q)
        for part in picture.objects("bodies"):
            corners = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
            shape = part.geometry
            if isinstance(shape, coal.Cylinder):
                half_sides = np.array([shape.radius, shape.radius, shape.halfLength])
            else:
                half_sides = shape.halfSide
            place = joints[part.parentJoint] * part.placement
            seen = np.array([place.act(point) for point in corners * half_sides])
            assert np.all(seen >= np.min(points, axis=0) - 1e-9)
            assert np.all(seen <= np.max(points, axis=0) + 1e-9)
    assert 0.7 < picture.size < 1.2  # the leg is 0.7 m long


def test_home_is_zero_within_the_limits(tulip_leg: Robot) -> None:
    np.testing.assert_array_equal(rest_posture(tulip_leg), [0.0, 0.0, 0.0, 0.05, 0.0])


# Inertia ellipsoids: the ellipsoid of a body that is an ellipsoid, against sampled mass.


def bodies_of(leg: Robot, *parameters: Array) -> list[Ellipsoid]:
    """Return the ellipsoids of the first bodies of a robot with these ten parameters each."""
    values = np.array(leg.parameters)
    values[: 10 * len(parameters)] = np.concatenate(parameters)
    return list(ellipsoids_of(leg.with_values(values, leg.drives)))[: len(parameters)]


@dataclass(frozen=True)
class Solid:
    """A uniform ellipsoid: mass [kg], semi-axes [m], and where it is."""

    mass: float
    semi_axes: tuple[float, float, float]
    placement: pin.SE3

    @property
    def parameters(self) -> Array:
        """The ten parameters, by the sum over points of equal mass."""
        grid = np.linspace(-1.0, 1.0, 81)
        points = np.array(np.meshgrid(grid, grid, grid)).reshape(3, -1).T
        points = points[np.sum(points**2, axis=1) <= 1.0] * self.semi_axes
        second = self.mass * points.T @ points / len(points)
        inertia = np.trace(second) * np.eye(3) - second
        centered = from_center_of_mass(self.mass, np.zeros(3), inertia)
        return in_parent_frame(centered, self.placement)


def test_ellipsoid_of_a_uniform_ellipsoid_is_itself(tulip_leg: Robot) -> None:
    turn = pin.exp3(np.array([0.3, -0.8, 0.5]))
    solid = Solid(3.2, (0.05, 0.11, 0.30), pin.SE3(turn, np.array([0.1, -0.2, 0.4])))
    (found,) = bodies_of(tulip_leg, solid.parameters)
    assert found.mass == pytest.approx(3.2)
    np.testing.assert_allclose(found.center, [0.1, -0.2, 0.4])
    np.testing.assert_allclose(found.semi_axes, solid.semi_axes, rtol=2e-3)  # of the grid
    np.testing.assert_allclose(np.abs(found.rotation.T @ turn), np.eye(3), atol=1e-9)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


def test_semi_axes_are_those_of_the_principal_moments(tulip_leg: Robot) -> None:
    moments = np.array([0.02, 0.05, 0.06])
    (found,) = bodies_of(tulip_leg, from_center_of_mass(2.0, np.zeros(3), np.diag(moments)))
    squares = [5 / (2 * 2.0) * (np.sum(moments) - 2 * one) for one in moments]
    np.testing.assert_allclose(found.semi_axes, np.sort(np.sqrt(squares)))


def test_point_mass_has_no_extent(tulip_leg: Robot) -> None:
    (found,) = bodies_of(tulip_leg, from_center_of_mass(2.0, np.ones(3), np.zeros((3, 3))))
    assert found.problem is None
    np.testing.assert_allclose(found.semi_axes, 0.0, atol=1e-7)


def test_inconsistent_bodies_have_a_reason_in_place_of_an_ellipsoid(tulip_leg: Robot) -> None:
    long = from_center_of_mass(2.0, np.array([0.0, 0.0, 0.3]), np.diag([0.01, 0.01, 0.03]))
    light = from_center_of_mass(-1.0, np.array([0.0, 0.0, 0.3]), np.diag([0.01, 0.01, 0.01]))
    found = bodies_of(tulip_leg, long, light)
    assert found[0].problem is not None
    assert "above the sum of the other two" in found[0].problem
    np.testing.assert_allclose(found[0].center, [0.0, 0.0, 0.3])
    assert found[1].problem == "a negative mass, -1 kg"
    for one in found:
        np.testing.assert_array_equal(one.semi_axes, 0.0)
    np.testing.assert_array_equal(found[1].center, 0.0)


def test_bodies_without_values_have_no_ellipsoid(tulip_leg: Robot) -> None:
    values = np.array(tulip_leg.parameters)
    values[:10], values[10:20] = 0.0, np.nan
    names = [one.name for one in ellipsoids_of(tulip_leg.with_values(values, tulip_leg.drives))]
    assert names == list(tulip_leg.body_names[2:])
