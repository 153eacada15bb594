"""Distances of a scene: closed forms, gradients against differences, independent placements."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import ExcitationError, RobotError, SeaidWarning
from seaid.excitation import Box, load_scene
from seaid.excitation.collision import Scene, distance_gradients, distances
from seaid.legged import load_robot
from seaid.robot import Robot
from tests.one_joint import BODY
from tests.representatives import quick_first

TETRAHEDRON = "\n".join(
    ["v 0 0 0", "v 0.2 0 0", "v 0 0.2 0", "v 0 0 0.2", "f 1 3 2", "f 1 2 4", "f 1 4 3", "f 2 3 4"]
)
Write = Callable[[str], Path]


def link(name: str, *shapes: str) -> str:
    """Return a link with collision shapes, each '<geometry> at x y z'."""
    text = f'<link name="{name}">{BODY}'
    for shape in shapes:
        geometry, _, place = shape.partition(" at ")
        text += f'<collision><origin xyz="{place or "0 0 0"}"/>'
        text += f"<geometry><{geometry}/></geometry></collision>"
    return text + "</link>"


def joint(name: str, kind: str, parent: str, child: str, place: str, axis: str, limit: str) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}"/><axis xyz="{axis}"/><limit {limit} velocity="3" effort="9"/>'
        "</joint>"
    )


RANGE = 'lower="-2.5" upper="2.5"'
PLANAR = (  # balls of 0.1 m at the base, at the elbow (0.5 m) and at the tip (0.9 m)
    link("ground", 'sphere radius="0.1"')
    + link("upper", 'sphere radius="0.1" at 0.5 0 0')
    + link("lower", 'sphere radius="0.1" at 0.4 0 0')
    + joint("shoulder", "revolute", "ground", "upper", "0 0 0", "0 0 1", RANGE)
    + joint("elbow", "continuous", "upper", "lower", "0.5 0 0", "0 0 1", "")
)
CRANE = (  # a tree with a rail, a locked joint, a welded link and every shape
    link("ground", 'box size="0.3 0.2 0.1" at 0 0 -0.3')
    + link("carriage", 'cylinder radius="0.05" length="0.3"')
    + link("arm", 'sphere radius="0.08" at 0 0 0.2', 'box size="0.1 0.1 0.2" at 0.1 0 0.1')
    + link("locked", 'sphere radius="0.06" at 0.1 0 0')
    + link("hand", 'sphere radius="0.05" at 0 0.1 0.1')
    + link("weld", 'box size="0.1 0.05 0.05" at 0.1 0 0')
    + link("other", 'sphere radius="0.07" at 0 0 0.3')
    + joint("rail", "prismatic", "ground", "carriage", "0 0 0.2", "1 0.5 0", RANGE)
    + joint("b_turn", "continuous", "carriage", "arm", "0.3 0 0.1", "0 0.6 0.8", "")
    + joint("a_locked", "revolute", "arm", "locked", "0.1 0.1 0.3", "1 0 0", RANGE)
    + joint("wrist", "revolute", "locked", "hand", "0.2 0 0.1", "0 1 0", RANGE)
    + '<joint name="fix" type="fixed"><parent link="hand"/><child link="weld"/>'
    + '<origin xyz="0.1 0 0" rpy="0.3 0.2 0.1"/></joint>'
    + joint("swing", "revolute", "ground", "other", "0 0.4 0.2", "1 0 0", RANGE)
)
CRANE_JOINTS = ("swing", "wrist", "b_turn", "rail")


@pytest.fixture
def planar(write_urdf: Write) -> tuple[Path, Robot]:
    path = write_urdf(PLANAR)
    return path, load_robot(path)


@pytest.fixture
def crane(write_urdf: Write) -> tuple[Path, Robot]:
    path = write_urdf(CRANE)
    return path, load_robot(path, joints=CRANE_JOINTS)


def positions(count: int, n: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(-2.5, 2.5, (count, n))


def differences(scene: Scene, q: Array, step: float) -> Array:
    columns = []
    for j in range(q.shape[1]):
        e = step * np.eye(q.shape[1])[j]
        columns.append((distances(scene, q + e) - distances(scene, q - e)) / (2 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, 0.7])
def test_balls_and_a_turned_box(planar: tuple[Path, Robot], turn: float) -> None:
    box = Box((1.5, 0.3, 0.0), (0.6, 0.2, 1.0), (0.0, 0.0, turn), name="post")
    scene = load_scene(*planar, keep_out=[box])
    assert scene.pairs == (("ground", "lower"), ("upper", "post"), ("lower", "post"))
    q = positions(50, 2, seed=1)
    both = q[:, 0] + q[:, 1]
    tip = 0.5 * np.array([np.cos(q[:, 0]), np.sin(q[:, 0])])
    tip = tip + 0.4 * np.array([np.cos(both), np.sin(both)])
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    outside = np.abs(turned @ (tip - np.array([[1.5], [0.3]]))) - np.array([[0.3], [0.1]])
    expected = np.linalg.norm(np.maximum(outside, 0), axis=0) - 0.1
    apart = expected > 0
    assert apart.sum() > 40
    found = distances(scene, q)
    np.testing.assert_allclose(found[apart, 2], expected[apart], atol=1e-13)
    np.testing.assert_allclose(found[:, 0], np.linalg.norm(tip, axis=0) - 0.2, atol=1e-14)


def test_gradients_are_the_differences_also_with_overlap_and_order(
    crane: tuple[Path, Robot],
) -> None:
    box = Box((0.5, 0.5, 0.5), (0.3, 0.4, 0.5), (0.1, 0.2, 0.3))
    scene = load_scene(*crane, keep_out=[box])
    q = positions(60, 4) * [1, 1, 1, 0.3]
    found, gradient = distance_gradients(scene, q)
    assert np.array_equal(found, distances(scene, q))
    assert found.min() < 0 < found.max()
    shapes = [type(o.geometry).__name__ for o in scene.geometry.geometryObjects]
    kinds = [{shapes[i], shapes[j]} for i, j in zip(*scene.objects_of_pairs, strict=True)]
    round_ = np.array(["Sphere" in kind for kind in kinds])
    smooth = ~np.array(["Cylinder" in kind for kind in kinds])
    error = np.max(np.abs(gradient - differences(scene, q, 1e-6)), axis=2)
    assert np.quantile(error[:, round_], 0.99) < 1e-8  # the rest cross an edge in the difference
    assert np.quantile(error[:, smooth], 0.97) < 1e-7
    assert np.quantile(error[:, ~smooth], 0.9) < 1e-5
    assert np.max(np.abs(gradient)) > 0.3


def test_cap_keeps_what_is_below_and_saves_the_rest(crane: tuple[Path, Robot]) -> None:
    scene = load_scene(*crane)
    q = positions(30, 4)
    exact, gradient = distance_gradients(scene, q)
    for cap in (-0.01, 0.1, 0.4):
        capped, slope = distance_gradients(scene, q, cap_m=cap)
        expected = np.where((exact < cap)[:, :, None], gradient, 0.0)
        np.testing.assert_allclose(capped, np.minimum(exact, cap), atol=1e-9)
        np.testing.assert_allclose(slope, expected, atol=1e-4)  # cylinders start from other guesses
        assert np.all(slope[exact > cap] == 0.0)


def test_bodies_are_watched_unless_one_joint_connects_them_or_none_moves(
    crane: tuple[Path, Robot],
) -> None:
    scene = load_scene(*crane, keep_out=[Box((0, 0, 3), (1, 1, 1), name="roof")])
    watched = {frozenset(pair) for pair in scene.pairs}
    apart = [("ground", "arm"), ("carriage", "hand"), ("other", "carriage"), ("other", "weld")]
    assert {frozenset(pair) for pair in apart} <= watched
    together = [("hand", "weld"), ("arm", "locked"), ("locked", "hand"), ("ground", "carriage")]
    assert not {frozenset(pair) for pair in [*together, ("ground", "roof")]} & watched
    assert {frozenset((name, "roof")) for name in ("carriage", "hand", "weld", "other")} <= watched
    assert scene.ignored == ()


def test_pairs_are_left_out_on_request(crane: tuple[Path, Robot]) -> None:
    box = Box((0, 0, 3), (1, 1, 1), name="roof")
    full = load_scene(*crane, keep_out=[box])
    pairs = [("hand", "carriage"), ("roof", "other")]
    less = load_scene(*crane, keep_out=[box], disabled_pairs=pairs)
    assert set(full.pairs) - set(less.pairs) == {("carriage", "hand"), ("other", "roof")}


def test_bodies_that_always_overlap_are_ignored_with_a_warning(write_urdf: Write) -> None:
    third = link("tool", 'sphere radius="0.2"') + joint(
        "wrist", "revolute", "lower", "tool", "0 0 0", "1 0 0", RANGE
    )
    path = write_urdf(PLANAR + third)
    with pytest.warns(SeaidWarning, match=r"'test': not checked .* 0\.01 m .*: upper and tool$"):
        scene = load_scene(path, load_robot(path))
    assert scene.ignored == (("upper", "tool"),)
    assert scene.pairs == (("ground", "lower"), ("ground", "tool"))
    assert distances(scene, np.zeros((1, 3))).shape == (1, 2)


def mesh_arm(filename: str) -> str:
    """Return the planar arm with a mesh for its lower link, shifted by 0.4 m."""
    ball, mesh = link("lower", 'sphere radius="0.1" at 0.4 0 0'), f'mesh filename="{filename}"'
    assert ball in PLANAR
    return PLANAR.replace(ball, link("lower", f"{mesh} at 0.4 0 0"))


PLACES: list[tuple[str, str, Any]] = [
    ("part.obj", ".", ()),
    ("meshes/part.obj", "meshes", ()),
    ("package://arm_description/meshes/part.obj", "arm_description/meshes", ()),
    ("package:///arm_description/meshes/part.obj", "arm_description/meshes", ()),
    ("file://{folder}/part.obj", ".", ()),
    ("package://arm/part.obj", "packages/arm", "packages"),
    ("package://arm/part.obj", "packages/arm", ["packages"]),
    ("package://arm/part.obj", "packages/arm", ["packages/arm"]),
]


@pytest.mark.slow  # 0.6 s
@pytest.mark.parametrize(("filename", "folder", "package_dirs"), PLACES)
def test_meshes_are_found_and_are_hulls(
    write_urdf: Write,
    tmp_path: Path,
    filename: str,
    folder: str,
    package_dirs: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beside the file, by a full path, and in folders of packages or those of one package."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / folder).mkdir(parents=True, exist_ok=True)
    (tmp_path / folder / "part.obj").write_text(TETRAHEDRON)
    path = write_urdf(mesh_arm(filename.format(folder=tmp_path)))
    robot = load_robot(path)
    if package_dirs:
        with pytest.raises(RobotError, match="1 collision meshes not found: package://arm/part"):
            load_scene(path, robot)
    scene = load_scene(path, robot, package_dirs=package_dirs)
    found = distances(scene, np.array([[0.3, 0.0], [0.3, np.pi]]))
    np.testing.assert_allclose(found[0, 0], 0.8, atol=1e-12)
    assert found[1, 0] < 0


PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 {corner}\n"
)


FLAT = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    quick_first(  # a process each
        [
            ("a.obj", "nothing", "cannot be read"),
            ("a.ply", PLY.format(corner=99999999), "the process that read it crashed"),
            ("a.off", f"OFF\n4000000000 1 0\n{TETRAHEDRON}", "cannot be read: std::bad_alloc"),
            ("a.obj", "v 0 0 1e300\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 2 3 4\n", "beyond 1e"),
            ("a.obj", FLAT, "is flat, its"),
            ("a.stl", "", "cannot be read"),
        ]
    ),
)
def test_a_mesh_that_is_none_is_said_and_does_not_end_the_process(
    write_urdf: Write, tmp_path: Path, name: str, content: str, words: str
) -> None:
    (tmp_path / name).write_text(content)
    path = write_urdf(mesh_arm(name))
    with pytest.raises(RobotError, match=words) as caught:
        load_scene(path, load_robot(path))
    assert f"link 'lower': collision mesh '{tmp_path / name}'" in str(caught.value)


@pytest.mark.slow  # 0.6 s
def test_a_mesh_has_three_scales(write_urdf: Write, tmp_path: Path) -> None:
    (tmp_path / "part.obj").write_text(TETRAHEDRON)
    for scale in ("1 1", "1 0 1", "1 1 inf"):
        path = write_urdf(mesh_arm("part.obj").replace("<mesh ", f'<mesh scale="{scale}" '))
        with pytest.raises(RobotError, match=f"three numbers that are not zero, found '{scale}'"):
            load_scene(path, load_robot(path))
    path = write_urdf(mesh_arm("part.obj").replace("<mesh ", '<mesh scale="2 2 -2" '))
    found = distances(load_scene(path, load_robot(path)), np.array([[0.3, 0.0]]))
    assert found[0, 0] < 0.8


def test_a_scene_goes_to_another_process_and_tells_the_same(crane: tuple[Path, Robot]) -> None:
    """Also without nominal values of the robot."""
    box = Box((0.5, 0.5, 0.5), (0.3, 0.4, 0.5))
    scene = load_scene(crane[0], crane[1].without_nominal(), keep_out=[box])
    q = positions(20, 4)
    again = pickle.loads(pickle.dumps(load_scene(*crane, keep_out=[box])))
    assert again.pairs == scene.pairs
    for one, two in zip(distance_gradients(scene, q), distance_gradients(again, q), strict=True):
        assert np.array_equal(one, two)


@pytest.mark.parametrize(
    ("box", "words"),
    [
        ({"size": (1, 0, 1)}, r"size of keep-out box 'b' must be more than zero in every .*found"),
        ({"size": (1, 1)}, r"size of keep-out box 'b' must have shape \(3\), found \(2,\)"),
        ({"center": (0, np.nan, 0)}, "center of keep-out box 'b' must be finite"),
        ({"rotation_rpy": "left"}, "rotation_rpy of keep-out box 'b' must be numbers"),
        ({"name": 3}, "name of a keep-out box is a text .*, found 3"),
        ({"name": "\ud800"}, r"name of a keep-out box is a text .*, found '\\ud800'"),
    ],
)
def test_bad_boxes(box: dict[str, Any], words: str) -> None:
    with pytest.raises(ExcitationError, match=words):
        Box(**{"center": (0, 0, 0), "size": (1, 1, 1), "name": "b", **box})


AROUND_ALL = Box((0, 0, 0), (4, 4, 4), name="cell")
FAR = Box((0, 0, 9), (1, 1, 1), name="far")
BARE = link("ground") + link("upper")
BARE += joint("shoulder", "revolute", "ground", "upper", "0 0 0", "0 0 1", RANGE)


TOO_LONG = (mesh_arm("9" * 300 + ".obj"), mesh_arm("a/" * 3000 + "part.obj"))
BROKEN: list[tuple[str, dict[str, Any], str]] = [
    (PLANAR, {"clearance_m": -0.1}, "clearance_m must be zero or more, found -0.1"),
    (PLANAR, {"clearance_m": np.nan}, "clearance_m must be zero or more, found nan"),
    (PLANAR, {"disabled_pairs": [("grund", "lower")]}, "disabled_pairs: no link with .* 'ground'"),
    (PLANAR, {"disabled_pairs": ["lower"]}, "must be pairs of link names, found 'low"),
    (PLANAR, {"disabled_pairs": [(["a"], "lower")]}, r"link names, found \(\['a'\], 'lower'\)"),
    (PLANAR, {"disabled_pairs": [1.0]}, r"must be pairs of link names, found 1\.0"),
    (PLANAR, {"disabled_pairs": 7}, "disabled_pairs= must be a list of tuples, found 7"),
    (PLANAR, {"keep_out": [AROUND_ALL]}, r"no posture .*'upper'.*'cell'.*disabled_pairs=\[\('up"),
    (PLANAR, {"keep_out": [FAR, FAR]}, "keep-out box 'far' has the name of another box"),
    (PLANAR, {"keep_out": [Box((0, 0, 9), (1, 1, 1), name="lower")]}, "'lower' has the name of"),
    (PLANAR, {"disabled_pairs": [("ground", "lower")]}, "'test' has no two bodies to keep apart"),
    (PLANAR, {"package_dirs": ["/nowhere"]}, "package_dirs: there is no folder '/nowhere'"),
    (BARE, {}, "has no collision geometry, so no distance of"),
    (BARE, {"keep_out": [FAR]}, "has no collision geometry, so no distance of"),
    *((text, {}, "1 collision meshes not found") for text in TOO_LONG),
]


@pytest.mark.parametrize(("text", "options", "words"), BROKEN)
def test_scenes_that_cannot_be_made_say_why(
    write_urdf: Write,
    tmp_path: Path,
    text: str,
    options: dict[str, Any],
    words: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Options, files and robots that give no distances between bodies."""
    monkeypatch.chdir(tmp_path)
    path = write_urdf(text)
    with pytest.raises((ExcitationError, RobotError), match=words):
        load_scene(path, load_robot(path), **options)


def test_other_robots_and_positions_are_refused(
    planar: tuple[Path, Robot], slider_arm: Robot, tmp_path: Path
) -> None:
    """A file without the robot's joints, or with one elsewhere; positions of a wrong shape."""
    path, robot = planar
    with pytest.raises(RobotError, match="is not the file of robot 'slider_arm': it has no joint"):
        load_scene(path, slider_arm)
    longer = tmp_path / "longer.urdf"
    longer.write_text(path.read_text().replace("0.5 0 0", "0.6 0 0"))
    with pytest.raises(RobotError, match="is not the file of robot 'test': joint 'elbow' is elsew"):
        load_scene(longer, robot)
    scene = load_scene(*planar)
    for q in (np.zeros((2, 3)), np.full((1, 2), np.nan), np.zeros(2)):
        with pytest.raises(ExcitationError, match=r"^q must"):
            distances(scene, q)
