"""A window without a browser: nodes where the robot is, time that goes on, a clean end."""

import subprocess
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
from seaid.view.panel import bodies_table, deflection_colors
from seaid.view.picture import (
    IDENTIFIED,
    NEUTRAL,
    NOMINAL,
    WRONG,
    picture_of,
    placements,
)
from seaid.view.stage import GHOST, aim, sphere_around
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


def pose(view: View, name: str) -> Array:
    """Return the homogeneous matrix (4, 4) of a node of the scene."""
    handle = node(view, name)
    w, x, y, z = handle.wxyz
    return np.asarray(pin.SE3(pin.Quaternion(w, x, y, z), np.array(handle.position)).homogeneous)


def node_of(view: View, joint: int, group: str = "bodies") -> tuple[str, pin.GeometryObject]:
    """Return the name of the node of a group's first object on a joint of the model, and it."""
    part = next(one for one in view.picture.objects(group) if one.parentJoint == joint)
    return f"/robot/visual/{part.name}", part


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
        for body in range(6):
            name, part = node_of(view, body)
            expected = data.oMi[body] * part.placement
            np.testing.assert_allclose(pose(view, name), expected.homogeneous, atol=1e-9)
    view.seek(2.0)
    _, deflection = view.playbacks[0].at(2.0)
    expected = deflection_colors(deflection, view.limits)
    assert [tuple(joint.color) for joint in view.stage.groups["joints"]] == expected
    assert expected[:2] == [NEUTRAL, NEUTRAL]
    assert len(set(expected[2:])) == 3
    largest = np.nanmax(np.abs([np.nanmax(np.abs(one.deflection)) for one in view.playbacks]))
    np.testing.assert_allclose(view.limits, largest)
    lowest = np.min(view.picture.outline(view.playbacks[0].position[::20])[:, 2])
    assert node(view, "/grid").position[2] <= lowest
    view.seek(1.0)
    position, deflection = view.playbacks[0].at(1.0)
    assert f"{position[3]:+.3f} rad" in view.panel.table.content
    assert f"{1e3 * deflection[3]:+.2f} mrad".replace("-", "−") in view.panel.table.content


def boxes_of(view: View) -> dict[str, Any]:
    """Return the inputs of the panel by their labels."""
    return {one.label: one for one in view.server.gui._gui_input_handle_from_uuid.values()}


def test_what_is_shown_is_chosen_in_the_panel(view: View) -> None:
    """Shapes, payloads, lines and names are where the picture has them, and can be hidden."""
    name, _ = node_of(view, 5, "payloads")
    assert 4 / 3 * np.pi * node(view, name).radius ** 3 == pytest.approx(2.0 / 7850.0)
    assert node(view, f"{name}/name").text == "2 kg"
    assert node(view, "/robot/visual/joints/3/name").text == "knee_pitch"
    assert not node(view, node_of(view, 3, "lines")[0]).visible  # shapes show the bodies
    boxes, bodies = boxes_of(view), view.stage.groups["bodies"]
    for label, group in (
        ("lines between joints", "lines"),
        ("joints", "joints"),
        ("names of joints", "names"),
        ("known payloads", "payloads"),
        ("nominal", "nominal"),
    ):
        before = boxes[label].value
        boxes[label].value = not before
        assert {one.visible for one in view.stage.groups[group]} == {not before}
    for opacity in (0.25, 1.0):
        boxes["bodies"].value = opacity
        assert {one.opacity or 1.0 for one in bodies} == {opacity}
    boxes["bodies"].value = 0.0
    assert {one.visible for one in bodies} == {False}


def test_identified_bodies_are_drawn_beside_the_nominal_ones(leg: Robot) -> None:
    """The same size for twice the mass, a cross where no body can be, and both in a table."""
    values = 2.0 * leg.parameters
    values[10] = -3.0
    with view_robot(leg, identified=leg.with_values(values, leg.drives), port=0) as shown:
        nominal, found = (
            node(shown, f"/robot/visual/{which}/0") for which in ("nominal", "identified")
        )
        np.testing.assert_allclose(nominal.scale, found.scale)
        np.testing.assert_allclose(nominal.position, found.position)
        assert (nominal.wireframe, found.wireframe) == (True, False)
        assert tuple(nominal.color) == NOMINAL != IDENTIFIED == tuple(found.color)
        assert tuple(node(shown, "/robot/visual/identified/1_cross_0").color) == WRONG
        assert node(shown, "/robot/visual/identified/1_center") is None
        assert "a negative mass, -3 kg" in shown.panel.notes.content
        assert "✕ −3<" in bodies_table(shown.picture)
        for which in ("nominal", "identified"):
            boxes_of(shown)[which].value = False
            assert {one.visible for one in shown.stage.groups[which]} == {False}
    moved = np.array(leg.parameters)
    moved[1] += 0.01 * moved[0]  # the first centre of mass 10 mm along x
    text = bodies_table(picture_of(leg, identified=leg.with_values(moved, leg.drives)))
    assert text.count(f">{moved[0]:.3g}</td>") == 2
    assert ">10</td>" in text


def test_without_motions_joints_have_sliders_and_no_plots(
    leg: Robot, write_chain: Callable[..., Path]
) -> None:
    """Within the limits of a joint, or a turn; a robot without shapes has its lines."""
    with view_robot(leg, port=0) as shown:
        assert (shown.playback, shown.time, shown.panel.plots) == (None, 0.0, None)
        slider = shown.panel.joints[3]
        assert (slider.label, slider.min, slider.max) == ("knee_pitch", 0.05, 1.4)
        slider.value = 1.2
        name, part = node_of(shown, 5)
        expected = placements(leg, np.array([0.0, 0.0, 0.0, 1.2, 0.0]))[5] * part.placement
        np.testing.assert_allclose(pose(shown, name), expected.homogeneous, atol=1e-9)
        calls: tuple[tuple[Callable[[], object], str], ...] = (
            (lambda: shown.seek(1.0), "no motion to seek in"),
            (shown.play, "no motion to play"),
            (lambda: shown.compare("x"), "no other motion to compare with"),
            (lambda: shown.show("x"), "no motion is named 'x'; allowed: none"),
        )
        for asked, words in calls:
            with pytest.raises(SeaidError, match=words):
                asked()
        shown.pause()
    robot = load_robot(write_chain({"a/b": "continuous", "slide": "prismatic"}))
    with view_robot(robot, port=0) as shown:
        ends = [(one.min, one.max) for one in shown.panel.joints]
        assert ends == [(-3.142, 3.142), (-1.0, 1.0)]
        assert node(shown, "/robot/visual/joints/0/name").text == "a/b"
        assert shown.stage.groups["bodies"] == []
        assert all(lines.visible for lines in shown.stage.groups["lines"])


def test_another_motion_is_shown_within_its_time_and_beside(view: View) -> None:
    assert view.playback is view.playbacks[0]
    view.seek(1.8)
    view.show("plan")
    assert view.playback is view.playbacks[1]
    assert view.time == view.panel.time.max == 1.0
    assert "planned; deflections are those of the nominal model" in view.panel.notes.content
    name, part = node_of(view, 5)
    expected = placements(view.picture.robot, view.playbacks[1].position[-1])[5] * part.placement
    np.testing.assert_allclose(pose(view, name), expected.homogeneous, atol=1e-9)
    view.show("run")
    assert view.panel.time.max == 2.0
    assert view.panel.notes.content == ""
    ghost, (name, line) = view.stage.ghost, node_of(view, 4, "lines")
    name = name.replace("robot", "ghost")
    assert tuple(node(view, name).color) == GHOST
    assert not ghost.visualRootFrame.visible
    view.compare("plan")
    assert ghost.visualRootFrame.visible
    view.seek(0.5)
    position, _ = view.playbacks[1].at(0.5)
    expected = placements(view.picture.robot, position)[4] * line.placement
    np.testing.assert_allclose(pose(view, name), expected.homogeneous, atol=1e-9)
    view.compare(None)
    assert not ghost.visualRootFrame.visible
    for asked in (view.show, view.compare):
        with pytest.raises(SeaidError, match="did you mean 'plan'"):
            asked("plann")


@pytest.mark.slow  # 0.7 s
def test_time_goes_on_while_it_plays(view: View) -> None:
    view.panel.speed.value = "4x"
    foot, _ = node_of(view, 5)
    start = pose(view, foot)
    click(view.panel.play)
    assert view.panel.play.label == "Pause"
    assert in_time(lambda: view.time > 0.3)
    assert np.max(np.abs(pose(view, foot) - start)) > 0.01
    assert in_time(lambda: view.time < 0.3)  # it begins again
    click(view.panel.play)
    assert view.panel.play.label == "Play"
    still = view.time
    time.sleep(0.15)
    assert view.time == still


@pytest.mark.parametrize("window_px", [(1280, 800), (900, 560), (390, 844), (360, 640)])
@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.6, 0.0, -0.8)])
def test_camera_sees_the_robot_free_of_the_panel(
    leg: Robot, window_px: tuple[int, int], up: tuple[float, ...]
) -> None:
    picture = picture_of(leg)
    camera = SimpleNamespace(position=None, look_at=None, fov=0.0, near=0.0, far=0.0)
    points = picture.outline(np.random.default_rng(1).uniform(-1, 1, (20, leg.n)))
    aim(camera, *sphere_around(points), np.array(up), window_px)
    forward = np.subtract(camera.look_at, camera.position)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    rays = points - camera.position
    depth = rays @ forward
    assert camera.near < np.min(depth) < np.max(depth) < camera.far
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
    """Springs without a deflection have no plot of one, and plans nothing measured."""
    plots = view.panel.plots
    assert plots is not None
    for time_s in (0.0, 0.77, 2.0):
        view.seek(time_s)
        for plot in (plots.torque, plots.deflection):
            assert cursor_of(plot) == pytest.approx(time_s, abs=2.0 / 300)
    assert plots.joint.value == "ankle_pitch"  # the spring that moves most
    plots.joint.value = "knee_pitch"
    assert plots.torque.title == "motor torque of knee_pitch [N m]"
    assert plots.deflection.title == "spring deflection of knee_pitch [mrad]"
    traces = view.playbacks[0].traces
    time, _, measured, *_ = plots.deflection.data
    expected = np.interp(time, traces.time, 1e3 * traces.deflection["measured"][:, 3])
    np.testing.assert_allclose(measured, expected)
    low, high = plots.deflection.scales["y"]["range"]
    assert low < np.nanmin(expected)
    assert high > np.nanmax(expected)
    plots.joint.value = "hip_yaw"
    assert not plots.deflection.visible  # no spring
    view.show("plan")
    assert plots.torque.data[0][-1] == 1.0
    assert np.all(np.isnan(plots.torque.data[2]))  # nothing is measured yet
    nominal = view.playbacks[1].traces.torque["nominal"][:, 0]
    np.testing.assert_allclose(plots.torque.data[3][0], nominal[0])


def test_a_window_begins_and_ends_without_a_trace(
    leg: Robot, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Threads and ports are free again, after a failure too, and nothing is printed."""
    before = set(threading.enumerate())
    with seaid.view_robot(leg, [log_of(leg), plan_of(leg)], port=0) as shown:
        assert [one.name for one in shown.playbacks] == ["log 1", "plan 2"]
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
    monkeypatch.setattr("seaid.view.window.put_panel", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        view_robot(leg, port=0)
    assert in_time(lambda: set(threading.enumerate()) <= before)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        *(({"port": port}, "port must be a whole number of 0 to") for port in (-1, 65536, True)),
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


@pytest.mark.slow  # a process of its own
def test_nothing_of_the_window_is_imported_before_it_opens() -> None:
    code = "import sys, seaid.cli.commands, seaid.view.picture, seaid.view.playback, seaid; "
    code += "seaid.view_robot; print([m for m in ('viser', 'trimesh', 'yourdfpy') if m in "
    code += "sys.modules])"
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert said.stdout == "[]\n"
