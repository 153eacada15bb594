"""A window without a browser: nodes where the robot is, time that goes on, a clean end."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import seaid
from seaid._arrays import Array
from seaid.errors import RobotError, SeaidError
from seaid.excitation import Trajectory
from seaid.excitation.trajectory import polynomial_trajectory
from seaid.legged import load_robot
from seaid.log.reading import Log
from seaid.robot.pinocchio_model import Payload
from seaid.robot.robot import Robot
from seaid.view.panel import bodies_table, deflection_colors
from seaid.view.picture import (
    IDENTIFIED,
    LINES,
    NEUTRAL,
    NOMINAL,
    WRONG,
    picture_of,
    placements,
)
from seaid.view.stage import GHOST, aim, sphere_around
from seaid.view.window import View, view_robot

SETTLED_S = 5.0


@pytest.fixture(scope="module")
def leg() -> Robot:
    models = Path(__file__).parents[2] / "models"
    payloads = [Payload("foot", 2.0, (0.15, 0.0, 0.0))]
    return load_robot(models / "tulip_leg.urdf", models / "tulip_leg.toml", payloads=payloads)


def log_of(robot: Robot) -> Log:
    """Return 2 s of waves, with deflections of 0.01 rad at the hip, 0.02 at the knee, ..."""
    t = np.linspace(0.0, 2.0, 201)[:, None]
    joint = 0.3 + 0.2 * np.sin((1.0 + np.arange(robot.n)) * t)
    deflection = 0.01 * np.arange(-1, robot.n - 1) * np.cos(np.pi * t)
    drives = [robot.drives[name] for name in robot.joint_names]
    radii = [one.load_radius / one.motor_radius for one in drives]
    motor = (joint + deflection) * [one.ratio for one in drives] * np.array(radii)
    return Log(t[:, 0], robot.joint_names, motor, joint, np.full(joint.shape, np.nan))


def plan_of(robot: Robot) -> Trajectory:
    powers = np.zeros((4, robot.n))
    powers[0], powers[2], powers[3] = 0.1, 0.6, -0.4
    return polynomial_trajectory(robot.joint_names, 1.0, powers)


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
    view.seek(1.0)
    position, deflection = view.playbacks[0].at(1.0)
    assert f"{position[3]:+.3f} rad" in view.panel.table.content
    assert f"{1e3 * deflection[3]:+.2f} mrad".replace("-", "−") in view.panel.table.content


def test_payloads_shapes_names_and_lines_are_there(view: View) -> None:
    name, ball = node_of(view, 5, "payloads")
    np.testing.assert_allclose(ball.placement.translation, [0.15, 0.0, 0.0])
    volume = 4 / 3 * np.pi * node(view, name).radius ** 3
    assert volume == pytest.approx(2.0 / 7850.0)
    assert node(view, f"{name}/name").text == "2 kg"
    assert node(view, "/robot/visual/joints/3/name").text == "knee_pitch"
    assert len(view.stage.groups["bodies"]) == 6
    name, line = node_of(view, 3, "lines")
    assert 2.0 * line.geometry.halfLength == pytest.approx(0.275)
    assert not node(view, name).visible  # shapes show the bodies
    assert not node(view, node_of(view, 3, "nominal")[0]).visible
    assert view.stage.groups["identified"] == []


def test_robot_without_shapes_has_its_lines(leg: Robot, write_chain: Callable[..., Path]) -> None:
    limit = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
    robot = load_robot(write_chain({"a": f"revolute {limit}", "b": f"revolute {limit}"}))
    with view_robot(robot, port=0) as shown:
        assert shown.stage.groups["bodies"] == []
        assert all(lines.visible for lines in shown.stage.groups["lines"])
        assert tuple(shown.stage.groups["lines"][0].color) == LINES


def test_what_is_shown_is_chosen_in_the_panel(view: View) -> None:
    inputs = view.server.gui._gui_input_handle_from_uuid.values()
    boxes = {handle.label: handle for handle in inputs}
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
    boxes["bodies"].value = 0.25
    assert {one.opacity for one in view.stage.groups["bodies"]} == {0.25}
    boxes["bodies"].value = 1.0
    assert {one.opacity for one in view.stage.groups["bodies"]} == {None}
    boxes["bodies"].value = 0.0
    assert {one.visible for one in view.stage.groups["bodies"]} == {False}


def identified_leg(robot: Robot) -> Robot:
    """Return the robot with the masses doubled, and a second body that no body can be."""
    values = 2.0 * robot.parameters
    values[10] = -3.0
    return robot.with_values(values, robot.drives)


def test_identified_bodies_are_drawn_beside_the_nominal_ones(leg: Robot) -> None:
    with view_robot(leg, identified=identified_leg(leg), port=0) as shown:
        nominal, found = (
            node(shown, f"/robot/visual/{which}/0") for which in ("nominal", "identified")
        )
        np.testing.assert_allclose(nominal.scale, found.scale)  # the same size, twice as heavy
        np.testing.assert_allclose(nominal.position, found.position)
        assert nominal.wireframe
        assert not found.wireframe
        assert tuple(nominal.color) == NOMINAL != IDENTIFIED == tuple(found.color)
        assert tuple(node(shown, "/robot/visual/identified/1_cross_0").color) == WRONG
        assert node(shown, "/robot/visual/identified/1_center") is None
        assert "a negative mass, -3 kg" in shown.panel.notes.content
        boxes = {
            handle.label: handle for handle in shown.server.gui._gui_input_handle_from_uuid.values()
        }
        for which in ("nominal", "identified"):
            nodes = shown.stage.groups[which]
            assert {one.visible for one in nodes} == {True}
            boxes[which].value = False
            assert {one.visible for one in nodes} == {False}


def test_bodies_are_compared_in_a_table(leg: Robot) -> None:
    found = np.array(leg.parameters)
    found[1] += 0.01 * found[0]  # the first centre of mass 10 mm along x
    picture = picture_of(leg, identified=leg.with_values(found, leg.drives))
    text = bodies_table(picture)
    mass = f">{found[0]:.3g}</td>"
    assert text.count(mass) == 2
    assert ">10</td>" in text
    wrong = bodies_table(picture_of(leg, identified=identified_leg(leg)))
    assert "✕ −3<" in wrong
    assert "identified" not in bodies_table(picture_of(leg))


def test_what_cannot_be_opened_is_said(leg: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(
            SeaidError, match=rf"cannot open port {port} of host '127.0.0.1'.*in use"
        ):
            view_robot(leg, port=port)
    with pytest.raises(SeaidError, match=r"cannot open port 0 of host '192.0.2.1'"):
        view_robot(leg, host="192.0.2.1", port=0)  # an address for documents only
    other = load_robot(leg.urdf, joints=["knee_pitch"]) if leg.urdf else leg
    with pytest.raises(RobotError, match="load both with the same joints="):
        view_robot(leg, identified=other, port=0)
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(SeaidError, match=r"pip install 'seaid\[view\]'"):
        view_robot(leg, port=0)


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


def test_without_motions_joints_have_sliders_and_no_plots(leg: Robot) -> None:
    with view_robot(leg, port=0) as shown:
        assert shown.playback is None
        assert shown.time == 0.0
        sliders = shown.panel.joints
        assert [(one.label, one.min, one.max) for one in sliders][3] == ("knee_pitch", 0.05, 1.4)
        sliders[3].value = 1.2
        q = np.array([0.0, 0.0, 0.0, 1.2, 0.0])
        name, part = node_of(shown, 5)
        expected = (placements(leg, q)[5] * part.placement).homogeneous
        np.testing.assert_allclose(pose(shown, name), expected, atol=1e-9)
        with pytest.raises(SeaidError, match="no motion to seek in"):
            shown.seek(1.0)
        with pytest.raises(SeaidError, match="no motion to play"):
            shown.play()
        with pytest.raises(SeaidError, match="no other motion to compare with"):
            shown.compare("x")
        with pytest.raises(SeaidError, match="no motion is named 'x'; allowed: none"):
            shown.show("x")
        shown.pause()
    with view_robot(leg, port=0) as shown:
        assert shown.panel.plots is None


def test_motions_without_names_get_some(leg: Robot) -> None:
    with seaid.view_robot(leg, [log_of(leg), plan_of(leg)], port=0) as shown:
        assert [one.name for one in shown.playbacks] == ["log 1", "plan 2"]
    with seaid.view_robot(leg, plan_of(leg), port=0) as shown:
        assert [one.name for one in shown.playbacks] == ["plan 1"]


def test_a_free_joint_can_be_turned_about(write_chain: Callable[..., Path]) -> None:
    robot = load_robot(write_chain({"a/b": "continuous", "slide": "prismatic"}))
    with view_robot(robot, port=0) as shown:
        free, stuck = shown.panel.joints
        assert (free.min, free.max) == (-3.142, 3.142)
        assert (stuck.min, stuck.max) == (-1.0, 1.0)
        assert node(shown, "/robot/visual/joints/0/name").text == "a/b"


@dataclass
class Camera:
    """What a camera of viser is told."""

    position: Any = None
    look_at: Any = None
    fov: float = 0.0
    near: float = 0.0
    far: float = 0.0


@pytest.mark.parametrize("window_px", [(1280, 800), (900, 560), (390, 844), (360, 640)])
@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.6, 0.0, -0.8)])
def test_camera_sees_the_robot_free_of_the_panel(
    leg: Robot, window_px: tuple[int, int], up: tuple[float, ...]
) -> None:
    picture, camera = picture_of(leg), Camera()
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


def test_camera_of_the_start_and_floor(view: View) -> None:
    corners = view.picture.outline(view.playbacks[0].position[::20])
    camera = view.server.initial_camera
    sight = np.subtract(camera.look_at, camera.position)
    sight /= np.linalg.norm(sight)
    rays = corners - camera.position
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    assert np.all(np.arccos(rays @ sight) < 0.75 * camera.fov)  # half of it up and down
    assert node(view, "/grid").position[2] <= np.min(corners[:, 2])


def cursor_of(plot: Any) -> float:
    """Return the time of the cursor of a plot, whose line goes up to the upper end."""
    time, cursor = plot.data[:2]
    (place,) = np.flatnonzero(cursor == plot.scales["y"]["range"][1])
    assert np.max(np.delete(cursor, place)) < plot.scales["y"]["range"][0]
    return float(time[place])


def test_cursor_of_the_plots_is_at_the_time(view: View) -> None:
    assert view.panel.plots is not None
    for time_s in (0.0, 0.77, 2.0):
        view.seek(time_s)
        for plot in (view.panel.plots.torque, view.panel.plots.deflection):
            assert cursor_of(plot) == pytest.approx(time_s, abs=2.0 / 300)
    plot = view.panel.plots.torque
    click(view.panel.play)
    assert in_time(lambda: cursor_of(plot) > 0.1)
    view.pause()


def test_plots_are_of_the_selected_joint_and_motion(view: View) -> None:
    plots = view.panel.plots
    assert plots is not None
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
    leg: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    before = set(threading.enumerate())
    with view_robot(leg, log_of(leg), port=0) as shown:
        port = shown.server.get_port()
        assert shown.url == f"http://127.0.0.1:{port}"
        shown.play()
        with urllib.request.urlopen(shown.url, timeout=10) as page:
            assert page.status == 200
            assert b"<html" in page.read().lower()
    assert in_time(lambda: set(threading.enumerate()) <= before)
    with view_robot(leg, port=port):  # the port is free again
        pass
    shown.stop()  # again, for nothing
    with view_robot(leg, port=0):
        pass
    assert capsys.readouterr() == ("", "")
    with view_robot(leg, host="0.0.0.0", port=0) as shown:
        assert shown.url.startswith("http://localhost:")


def test_wait_ends_with_the_window(leg: Robot) -> None:
    shown = view_robot(leg, port=0)
    begin = time.monotonic()
    shown.wait(0.05)
    timer = threading.Timer(0.1, shown.stop)
    timer.start()
    shown.wait()
    assert time.monotonic() - begin < SETTLED_S
    timer.join()
    assert in_time(lambda: not shown._clock.is_alive())


@pytest.mark.parametrize("port", [-1, 65536, 80.5, True])
def test_a_port_that_cannot_be_is_refused(leg: Robot, port: Any) -> None:
    with pytest.raises(SeaidError, match="port must be a whole number of 0 to 65535, found"):
        view_robot(leg, port=port)


def test_failure_while_it_opens_closes_the_server(
    leg: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = set(threading.enumerate())
    monkeypatch.setattr("seaid.view.window.put_panel", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        view_robot(leg, port=0)
    assert in_time(lambda: set(threading.enumerate()) <= before)


@pytest.mark.slow  # a process of its own
def test_nothing_of_the_window_is_imported_before_it_opens() -> None:
    code = "import sys, seaid.cli.commands, seaid.view.picture, seaid.view.playback, seaid; "
    code += "seaid.view_robot; print([m for m in ('viser', 'trimesh', 'yourdfpy') if m in "
    code += "sys.modules])"
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert said.stdout == "[]\n"
