"""A window without a browser: nodes where the robot is, time that goes on, a clean end."""

import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import seaid
from seaid._arrays import Array
from seaid.errors import SeaidError
from seaid.legged import load_robot
from seaid.robot import Robot
from seaid.view import View, view_robot
from seaid.view.panel import deflection_colors
from seaid.view.picture import (
    GHOST,
    IDENTIFIED,
    NEUTRAL,
    NOMINAL,
    aim,
    picture_of,
    placements,
    sphere_around,
)
from tests import experiments
from tests.experiments import TEST_MASS
from tests.view.motions import log_of, plan_of

SETTLED_S = 5.0


@pytest.fixture(scope="module")
def leg() -> Robot:
    return experiments.leg(TEST_MASS)


@pytest.fixture
def view(leg: Robot) -> Iterator[View]:
    with view_robot(leg, {"run": log_of(leg), "plan": plan_of(leg)}, port=0) as shown:
        yield shown


def node(view: View, name: str) -> Any:
    return view.server.scene.get_handle_by_name(name)


def pose(view: View, joint: int, figure: str = "robot") -> Array:
    """Return the homogeneous matrix (4, 4) of the frame of a joint of the model."""
    handle = node(view, f"/{figure}/{joint}")
    w, x, y, z = handle.wxyz
    return np.asarray(pin.SE3(pin.Quaternion(w, x, y, z), np.array(handle.position)).homogeneous)


def foot_at(robot: Robot, position: Array) -> Array:
    """Return the homogeneous matrix (4, 4) of the last joint."""
    return np.asarray(placements(robot, position)[5].homogeneous)


def in_time(happened: Callable[[], bool]) -> bool:
    """Tell whether something happens soon."""
    end = time.monotonic() + SETTLED_S
    while not happened() and time.monotonic() < end:
        time.sleep(0.01)
    return happened()


def click(handle: Any) -> None:
    """Press a button as the browser does."""
    handle.value = True


def test_all_is_at_its_place_at_any_time(view: View, leg: Robot) -> None:
    data = leg.model.createData()
    for time_s in (0.0, 0.7, 1.333, 2.0):
        view.seek(time_s)
        q = view.playbacks[0].at(time_s)[0]
        pin.forwardKinematics(leg.model, data, q)
        for joint in range(6):
            np.testing.assert_allclose(pose(view, joint), data.oMi[joint].homogeneous, atol=1e-9)
    view.seek(2.0)
    _, deflection = view.playbacks[0].at(2.0)
    expected = [tuple(color) for color in deflection_colors(deflection, view.panel.limits).tolist()]
    assert [tuple(joint.color) for joint in view.stage.groups["joints"]] == expected
    assert expected[:2] == [NEUTRAL, NEUTRAL]
    assert len(set(expected[2:])) == 3
    largest = np.nanmax(np.abs([np.nanmax(np.abs(x.deflection)) for x in view.playbacks]))
    np.testing.assert_allclose(view.panel.limits, largest)
    lowest = np.min(view.picture.outline(view.playbacks[0].position[::20])[:, 2])
    assert node(view, "/grid").position[2] <= lowest


def boxes_of(view: View) -> dict[str, Any]:
    """Return the inputs of the panel by their labels."""
    return {x.label: x for x in view.server.gui._gui_input_handle_from_uuid.values()}


def test_what_is_shown_is_chosen_in_the_panel(view: View) -> None:
    """Meshes are on the frames of their joints, and all kinds can be hidden."""
    shapes = view.picture.groups["bodies"]
    for number, (shape, mesh) in enumerate(zip(shapes, view.stage.groups["bodies"], strict=True)):
        assert mesh.name == f"/robot/{shape.joint}/bodies/{number}"
        np.testing.assert_allclose(mesh.vertices, shape.mesh.vertices, atol=1e-6)
        assert mesh.opacity == 0.35  # springs shine through
    names = [label.text for label in view.stage.groups["names"]]
    assert names == list(view.picture.robot.joint_names)
    boxes = boxes_of(view)
    for group, is_shown in (
        ("bodies", True),
        ("lines", False),
        ("joints", True),
        ("names", True),
        ("nominal", False),
    ):
        assert boxes[group].value == is_shown
        assert {x.visible for x in view.stage.groups[group]} == {is_shown}
        boxes[group].value = not is_shown
        assert {x.visible for x in view.stage.groups[group]} == {not is_shown}
    assert "identified" not in boxes


def test_identified_bodies_are_drawn_beside_the_nominal_ones(leg: Robot) -> None:
    """The same size for twice the mass, and nothing where no body can be."""
    values = 2.0 * leg.parameters
    values[10] = -3.0
    with view_robot(leg, identified=leg.with_values(values, leg.drives), port=0) as shown:
        nominal, identified = (shown.stage.groups[x] for x in ("nominal", "identified"))
        assert len(identified) == len(nominal) - 1
        np.testing.assert_allclose(nominal[0].vertices, identified[0].vertices)
        assert (nominal[0].wireframe, identified[0].wireframe) == (True, False)
        assert tuple(nominal[0].color) == NOMINAL != IDENTIFIED == tuple(identified[0].color)
        for which in ("nominal", "identified"):
            assert {x.visible for x in shown.stage.groups[which]} == {True}


def test_without_motions_joints_have_sliders_and_no_plots(
    leg: Robot, write_chain: Callable[..., Path]
) -> None:
    """Within the limits of a joint, or a turn; a robot without shapes has its lines."""
    with view_robot(leg, port=0) as shown:
        assert (shown.playback, shown.time) == (None, 0.0)
        slider = shown.panel.inputs[3]
        assert (slider.label, slider.min, slider.max) == ("knee_pitch", 0.05, 1.4)
        slider.value = 1.2
        expected = foot_at(leg, np.array([0.0, 0.0, 0.0, 1.2, 0.0]))
        np.testing.assert_allclose(pose(shown, 5), expected, atol=1e-9)
        calls: tuple[tuple[Callable[[], object], str], ...] = (
            (lambda: shown.seek(1.0), "no motion to play"),
            (shown.play, "no motion to play"),
            (lambda: shown.compare("x"), "no motion to play"),
            (lambda: shown.show("x"), "no motion is named 'x'; allowed: none"),
        )
        for asked, words in calls:
            with pytest.raises(SeaidError, match=words):
                asked()
        shown.pause()
    far = 'revolute <limit lower="-4" upper="5" velocity="1" effort="1"/>'
    robot = load_robot(write_chain({"a/b": "continuous", "slide": "prismatic", "far": far}))
    with view_robot(robot, port=0) as shown:
        ends = [(slider.min, slider.max) for slider in shown.panel.inputs]
        assert ends == [(-3.142, 3.142), (-1.0, 1.0), (-4.0, 5.0)]
        assert shown.stage.groups["names"][0].text == "a/b"
        assert shown.stage.groups["bodies"] == []
        assert all(lines.visible for lines in shown.stage.groups["lines"])


def test_another_motion_is_shown_within_its_time_and_beside(view: View) -> None:
    assert view.playback is view.playbacks[0]
    view.seek(1.8)
    view.show("plan")
    assert view.playback is view.playbacks[1]
    assert view.time == view.panel.time.max == 1.0
    words = "Note: plan: planned; deflections are those of the nominal model"
    assert words in view.panel.notes.content
    robot, plan = view.picture.robot, view.playbacks[1]
    np.testing.assert_allclose(pose(view, 5), foot_at(robot, plan.position[-1]), atol=1e-9)
    view.show("run")
    assert view.panel.time.max == 2.0
    ghost = view.stage.ghost
    assert not ghost.root.visible
    view.compare("plan")
    assert ghost.root.visible
    view.seek(0.5)
    expected = foot_at(robot, plan.at(0.5)[0])
    np.testing.assert_allclose(pose(view, 5, "ghost"), expected, atol=1e-9)
    mesh = node(view, f"/ghost/{view.picture.groups['bodies'][0].joint}/ghost/0")
    assert tuple(mesh.color) == GHOST
    compared = view.panel.deflection.data[-1]
    assert np.all(np.isnan(compared[-100:]))  # the plan is shorter
    view.panel.joint.value = "knee_pitch"
    grid, compared = view.panel.deflection.data[0], view.panel.deflection.data[-1]
    expected = 1e3 * np.interp(grid[:200], plan.time, plan.deflection[:, 3])
    np.testing.assert_allclose(compared[:200], expected)
    view.compare(None)
    assert not ghost.root.visible
    for asked in (view.show, view.compare):
        with pytest.raises(SeaidError, match="did you mean 'plan'"):
            asked("plann")


@pytest.mark.parametrize("window_px", [(1280, 800), (900, 560), (390, 844), (360, 640)])
@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.6, 0.0, -0.8)])
def test_camera_sees_the_robot_free_of_the_panel(
    leg: Robot, window_px: tuple[int, int], up: tuple[float, ...]
) -> None:
    picture = picture_of(leg)
    camera = SimpleNamespace(position=None, look_at=None, fov=0.0)
    points = picture.outline(np.random.default_rng(1).uniform(-1, 1, (20, leg.n)))
    aim(camera, *sphere_around(points), np.array(up), window_px)
    forward = np.subtract(camera.look_at, camera.position)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    rays = points - camera.position
    depth = rays @ forward
    assert np.min(depth) > 0.0
    rise = np.tan(camera.fov / 2) * depth
    run = rise * window_px[0] / window_px[1]
    x_px = (1 + rays @ right / run) / 2 * window_px[0]
    y_px = (1 - rays @ np.cross(right, forward) / rise) / 2 * window_px[1]
    assert np.min(x_px) > 0
    assert np.min(y_px) > 0
    small = window_px[0] < 576  # the panel is below, at most 60 % of the page
    assert np.max(y_px) < (0.4 if small else 1.0) * window_px[1]
    assert np.max(x_px) < window_px[0] - (0 if small else 320)
    extent = max(np.ptp(x_px) / window_px[0], np.ptp(y_px) / window_px[1])
    assert extent > 0.2


def cursor_of(plot: Any) -> float:
    """Return the time of the cursor of a plot, whose line goes up to the upper end."""
    time, cursor = plot.data[:2]
    (place,) = np.flatnonzero(cursor == plot.scales["y"]["range"][1])
    assert np.max(np.delete(cursor, place)) < plot.scales["y"]["range"][0]
    return float(time[place])


def test_plots_are_of_the_selected_joint_and_motion_with_a_cursor_at_the_time(view: View) -> None:
    """Springs without a deflection have no plot of one, and plans no torque."""
    panel, run = view.panel, view.playbacks[0]
    for time_s in (0.0, 0.77, 2.0):
        view.seek(time_s)
        assert cursor_of(panel.deflection) == pytest.approx(time_s, abs=2.0 / 300)
    assert panel.joint.value == "ankle_pitch"  # the spring that moves most
    panel.joint.value = "knee_pitch"
    assert panel.torque.title == "motor torque of knee_pitch [N m]"
    assert panel.deflection.title == "spring deflection of knee_pitch [mrad]"
    grid, _, shown, identified, compared = panel.deflection.data
    expected = np.interp(grid, run.time, 1e3 * run.deflection[:, 3])
    np.testing.assert_allclose(shown, expected)
    assert np.all(np.isnan([identified, compared]))
    low, high = panel.deflection.scales["y"]["range"]
    assert low < np.min(expected) < np.max(expected) < high
    panel.joint.value = "hip_yaw"
    assert not panel.deflection.visible  # no spring
    assert not panel.torque.visible  # not logged
    view.show("plan")
    panel.joint.value = "knee_pitch"
    assert panel.deflection.visible
    assert panel.deflection.data[0][-1] == 1.0


def test_a_window_begins_and_ends_without_a_trace(
    leg: Robot, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Threads and ports are free again, after a failure too, and nothing is printed."""
    before = set(threading.enumerate())
    with seaid.view_robot(leg, [log_of(leg), plan_of(leg)], port=0) as shown:
        assert [x.name for x in shown.playbacks] == ["log 1", "trajectory 2"]
        port = shown.server.get_port()
        assert shown.url == f"http://127.0.0.1:{port}"
        for act, label in ((shown.play, "Pause"), (shown.pause, "Play"), (shown.play, "Pause")):
            act()
            assert shown.panel.play.label == label
        with urllib.request.urlopen(shown.url, timeout=10) as page:
            assert b"<html" in page.read().lower()
    assert in_time(lambda: set(threading.enumerate()) <= before)
    shown = view_robot(leg, port=port)
    shown.wait(0.05)
    timer = threading.Timer(0.1, shown.stop)
    timer.start()
    shown.wait()  # ends with the window
    timer.join()
    shown.stop()  # again, for nothing
    monkeypatch.setattr("seaid.view.window.Panel", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        view_robot(leg, port=0)
    assert in_time(lambda: set(threading.enumerate()) <= before)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        *(({"port": port}, f"cannot open port {port} of host") for port in (-1, 65536, 1 << 40)),
        ({"port": "http"}, "port= must be a whole number, found the text 'http'"),
        # an address for documents only
        ({"host": "192.0.2.1", "port": 0}, r"cannot open port 0 of host '192.0.2.1'"),
        ({"identified": "knee", "port": 0}, "load both with the same joints="),
        ({"viser": None, "port": 0}, r"pip install 'seaid\[view\]'"),
    ],
)
def test_what_cannot_be_opened_is_refused(
    leg: Robot, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], words: str
) -> None:
    """Ports and hosts that are none, robots of other joints, and a package that is missing."""
    assert leg.urdf is not None
    if "viser" in options:
        monkeypatch.setitem(sys.modules, "viser", None)
    if "identified" in options:
        options = {**options, "identified": load_robot(leg.urdf, joints=["knee_pitch"])}
    with pytest.raises(SeaidError, match=words):
        view_robot(leg, **{name: value for name, value in options.items() if name != "viser"})
