"""What is shown of a robot: where its links are, how they look, what is said to be missing."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from seaid._arrays import Array
from seaid.errors import RobotError
from seaid.legged import load_robot
from seaid.robot import Robot, reread_urdf
from seaid.robot.inertia import from_center_of_mass, in_parent_frame
from seaid.view.picture import (
    GREY,
    NOMINAL,
    Picture,
    Shape,
    ellipsoids_of,
    link_places,
    picture_of,
    placements,
    rest_posture,
)
from tests.representatives import quick_first

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


def link_placements(robot: Robot, q: Array) -> dict[str, pin.SE3]:
    """Return the placements of all links of the URDF, including fixed and locked ones."""
    assert robot.urdf is not None
    places = link_places(reread_urdf(robot.urdf).locked_at(robot.locked), robot)
    joints = placements(robot, q)
    return {link: joints[joint] * place for link, (joint, place) in places.items()}


@pytest.mark.parametrize(
    ("name", "joints", "within"),
    quick_first(
        [
            ("panda.urdf", ("panda_joint6", "panda_finger_joint2", "panda_joint2"), 1e-9),
            ("ur10_robot.urdf", None, 2e-5),  # its angles are rounded
            ("ur5_robot.urdf", None, 1e-9),
            ("tiago_no_hand.urdf", None, 1e-9),
            ("a1.urdf", None, 1e-9),
        ],
        2,
    ),
)
def test_links_are_where_pinocchio_has_them(
    name: str,
    joints: tuple[str, ...] | None,
    within: float,
    example_path: Callable[[str], Path],
    load_quietly: Load,
) -> None:
    """By its own reader, for mimic, prismatic, continuous, fixed and locked joints in any order.

    Bodies of the robot are at the joints of its model, whose angles are rounded, to rounding.
    """
    path = example_path(name)
    robot = load_quietly(path, joints=joints) if joints else load_quietly(path)
    picture, q = picture_of(robot), posture(robot, 1)
    found = link_placements(robot, q)
    expected = frames_by_pinocchio(path, dict(zip(robot.joint_names, q, strict=True)))
    assert set(found) == set(expected) - {"universe"}
    for link, place in found.items():
        np.testing.assert_allclose(place.homogeneous, expected[link].homogeneous, atol=within)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q[list(robot.model_order)])
    for joint, body in zip(robot.joint_names, robot.body_names, strict=True):
        place = data.oMi[robot.model.getJointId(joint)]
        np.testing.assert_allclose(found[body].homogeneous, place.homogeneous, atol=1e-12)
    if name in ("panda.urdf", "ur5_robot.urdf"):  # their meshes are found in the package
        assert picture.notes == ()
        bodies = picture.groups["bodies"]
        assert sum(len(shape.mesh.faces) for shape in bodies) > 10_000
        assert len({shape.color for shape in bodies}) > 1


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


BOX = '<box size="0.2 0.4 0.6"/>'


@pytest.mark.parametrize(
    ("geometry", "half_size"),
    [
        (BOX, (0.1, 0.2, 0.3)),
        ('<sphere radius="0.1"/>', (0.1, 0.1, 0.1)),
        ('<cylinder radius="0.1" length="0.6"/>', (0.1, 0.1, 0.3)),
    ],
)
def test_shapes_have_their_size_place_and_colour(
    write_urdf: Callable[[str], Path], geometry: str, half_size: tuple[float, ...]
) -> None:
    """Grey if they have none; a colour may be that of a material at the top of the file."""
    origin, red = '<origin xyz="1 0 0" rpy="0 0 0"/>', '<material name="red"/>'
    own = '<material name="own"><color rgba="0 0.5 1 1"/></material>'
    top = '<material name="red"><color rgba="1 0 0 1"/></material>'
    inside = visual(geometry) + visual(geometry, origin, red) + visual(geometry, material=own)
    shapes = shown(write_urdf, inside, top).groups["bodies"]
    assert [shape.color for shape in shapes] == [GREY, (255, 0, 0), (0, 127, 255)]
    for shape, x in zip(shapes, (0.0, 1.0, 0.0), strict=True):
        np.testing.assert_allclose(np.mean(shape.mesh.bounds, axis=0), [x, 0, 0], atol=1e-9)
        np.testing.assert_allclose(shape.mesh.extents, 2.0 * np.array(half_size), rtol=0.01)


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
    assert missing.groups["bodies"] == []
    assert missing.notes == (
        f"mesh 'package://arms/meshes/a.{ending}' is not found (link 'arm'): name the folder that "
        "contains its package or path with --package-dir (package_dirs=), or correct it in the "
        "URDF",
    )
    picture = shown(write_urdf, mesh, package_dirs=packages)
    (shape,) = picture.groups["bodies"]
    np.testing.assert_allclose(shape.mesh.bounds, [[0.45, -0.1, -0.015], [0.55, 0.1, 0.015]])
    assert picture.notes == ()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("bad.stl", "bad.stl' has no triangles (link 'arm'): replace it by an STL, OBJ, PLY, glTF"),
        ("empty.ply", "empty.ply' has no triangles (link 'arm'): replace it"),
        ("bad.dae", "bad.dae' cannot be read"),
        (
            "file:///gone/a.stl",
            "mesh 'file:///gone/a.stl' is not found (link 'arm'): name the folder that contains",
        ),
        ("meshes/a.stl", "or path with --package-dir (package_dirs=), or correct it in the URDF"),
    ],
)
def test_a_mesh_that_is_none_makes_a_note_with_its_remedy(
    write_urdf: Callable[[str], Path], tmp_path: Path, name: str, words: str
) -> None:
    """The other shapes of the link are shown, and other meshes of this kind are counted."""
    for bad in ("bad.stl", "bad.dae"):
        (tmp_path / bad).write_text("no mesh at all")
    cloud: Any = trimesh.points
    cloud.PointCloud(np.eye(3)).export(tmp_path / "empty.ply")
    mesh = visual(f'<mesh filename="{name}"/>')
    picture = shown(write_urdf, mesh + visual(BOX))
    assert len(picture.groups["bodies"]) == 1
    (note,) = picture.notes
    assert words in note
    if "/" in name:
        several = mesh + "".join(visual(f'<mesh filename="{name}{x}"/>') for x in (1, 2))
        (note,) = shown(write_urdf, several).notes
        assert f"mesh '{name}' is not found (link 'arm'), and 2 others likewise: " in note


def test_what_cannot_be_shown_is_refused(
    write_urdf: Callable[[str], Path], tulip_leg: Robot, tulip_urdf: Path, tmp_path: Path
) -> None:
    """Folders that are not there, and robots whose file is not there or has changed."""
    changed = tmp_path / "changed.urdf"
    changed.write_text(tulip_urdf.read_text().replace('"knee_pitch"', '"knee"'))

    def of_file(urdf: Path | None) -> Picture:
        return picture_of(replace(tulip_leg, urdf=urdf))

    calls: tuple[tuple[Callable[[], object], str], ...] = (
        (lambda: shown(write_urdf, "", package_dirs="nowhere"), "package_dirs: there is no folder"),
        (lambda: of_file(None), "has no URDF to show"),
        (lambda: of_file(tmp_path / "gone.urdf"), "no URDF file at"),
        (lambda: of_file(changed), r"has no joint knee_pitch any more.*load it again"),
    )
    for asked, words in calls:
        with pytest.raises(RobotError, match=words):
            asked()


def ends_of(line: Shape, joints: list[pin.SE3]) -> Array:
    """Return the ends of a line (2, 3), the means of its two caps in the frame of the base."""
    joint, vertices = joints[line.joint], line.mesh.vertices
    axis = np.linalg.svd(vertices - vertices.mean(axis=0))[2][0]
    upper = (vertices - vertices.mean(axis=0)) @ axis > 0
    return np.array([joint.act(vertices[side].mean(axis=0)) for side in (~upper, upper)])


def test_lines_lead_to_the_joints_and_the_last_centre_of_mass(
    write_chain: Callable[..., Path],
) -> None:
    limit = '<limit lower="-0.1" upper="0.3" velocity="1" effort="1"/>'
    robot = load_robot(write_chain({"a": f"revolute {limit}", "b": f"prismatic {limit}"}))
    picture, joints = picture_of(robot), placements(robot, np.array([0.3, 0.2]))
    assert picture.groups["bodies"] == []
    lines = picture.groups["lines"]
    assert [line.joint for line in lines] == [0, 1, 2]
    mass, *moment = robot.parameters[10:14]
    rest = placements(robot, np.array([0.3, 0.0]))[2].translation
    center = joints[2].act(np.array(moment) / mass)
    expected = ([np.zeros(3), joints[1].translation], [joints[1].translation, rest])
    for line, ends in zip(lines, (*expected, [joints[2].translation, center]), strict=True):
        shown_ends = ends_of(line, joints)
        turned = shown_ends if np.allclose(shown_ends[0], ends[0], atol=1e-3) else shown_ends[::-1]
        np.testing.assert_allclose(turned, ends, atol=1e-3)


def test_drums_are_about_the_axes_and_thicker_with_a_spring(tulip_leg: Robot) -> None:
    tree = reread_urdf(tulip_leg.urdf)  # type: ignore[arg-type]
    drums = picture_of(tulip_leg).groups["joints"]
    lengths = []
    for name, drum in zip(tulip_leg.joint_names, drums, strict=True):
        assert drum.joint == tulip_leg.model.getJointId(name)
        along = drum.mesh.vertices @ tree.joints[name].axis
        lengths.append(np.ptp(along))
        np.testing.assert_allclose(np.mean(drum.mesh.vertices, axis=0), 0.0, atol=1e-12)
        assert lengths[-1] == pytest.approx(np.max(drum.mesh.extents))
    elastic = [name in tulip_leg.elastic_joints for name in tulip_leg.joint_names]
    assert [length > np.mean(lengths) for length in lengths] == elastic


def test_outline_is_around_all_that_is_shown(tulip_leg: Robot) -> None:
    picture = picture_of(tulip_leg)
    postures = np.array([posture(tulip_leg, seed) for seed in range(5)])
    points = picture.outline(postures)
    for q in postures:
        joints = placements(tulip_leg, q)
        for shape in picture.groups["bodies"]:
            seen = np.array([joints[shape.joint].act(point) for point in shape.mesh.vertices])
            assert np.all(seen >= np.min(points, axis=0) - 1e-9)
            assert np.all(seen <= np.max(points, axis=0) + 1e-9)
    rest = picture.outline(rest_posture(tulip_leg)[None])
    assert 0.7 < np.linalg.norm(np.ptp(rest, axis=0)) < 1.2  # the leg is 0.7 m long


@pytest.mark.parametrize(
    ("gravity", "up"),
    [((-9.81, 0, 0), (1, 0, 0)), ((0, 3, -4), (0, -0.6, 0.8)), ((0, 0, 0), (0, 0, 1))],
)
def test_up_is_against_gravity_and_home_within_the_limits(
    tulip_urdf: Path, gravity: tuple[float, ...], up: tuple[float, ...]
) -> None:
    """Without gravity up is along z."""
    robot = load_robot(tulip_urdf, gravity=gravity)
    np.testing.assert_allclose(picture_of(robot).up, up)
    np.testing.assert_array_equal(rest_posture(robot), [0.0, 0.0, 0.0, 0.05, 0.0])


# Inertia ellipsoids: the ellipsoid of a body that is an ellipsoid, against sampled mass.


def bodies_of(leg: Robot, *parameters: Array) -> list[Shape]:
    """Return the ellipsoids of a robot whose first bodies alone have parameters, ten each."""
    values = np.zeros(len(leg.parameters))
    values[: 10 * len(parameters)] = np.concatenate(parameters)
    return ellipsoids_of(leg.with_values(values, leg.drives), NOMINAL, 1e-6)


def test_ellipsoid_of_a_uniform_ellipsoid_is_itself(tulip_leg: Robot) -> None:
    """Of half axes a its second moments are m a^2 / 5, wherever it is."""
    mass, half_axes = 3.2, np.array([0.05, 0.11, 0.30])
    place = pin.SE3(pin.exp3(np.array([0.3, -0.8, 0.5])), np.array([0.1, -0.2, 0.4]))
    tensor = mass / 5 * np.diag(np.sum(half_axes**2) - half_axes**2)
    centered = from_center_of_mass(mass, np.zeros(3), tensor)
    (ellipsoid,) = bodies_of(tulip_leg, in_parent_frame(centered, place))
    assert ellipsoid.joint == 1
    inside = (ellipsoid.mesh.vertices - place.translation) @ place.rotation
    np.testing.assert_allclose(np.linalg.norm(inside / half_axes, axis=1), 1.0, rtol=1e-5)
    assert ellipsoid.mesh.volume > 0  # no mirror image


def test_bodies_that_are_no_ellipsoid_are_not_drawn(tulip_leg: Robot) -> None:
    """A point has no extent; inconsistent bodies and those without values have no ellipsoid."""
    place = np.array([0.0, 0.0, 0.3])
    point, long, light = (
        from_center_of_mass(mass, place, np.diag(moments))
        for mass, moments in (
            (2.0, [0.0, 0.0, 0.0]),
            (2.0, [0.01, 0.01, 0.03]),
            (-1.0, [0.01, 0.01, 0.01]),
        )
    )
    (ball,) = bodies_of(tulip_leg, point, long, light, np.full(10, np.nan))
    assert ball.joint == 1
    np.testing.assert_allclose(ball.mesh.vertices, np.tile(place, (162, 1)), atol=2e-6)
