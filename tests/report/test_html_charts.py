"""Charts and pictures of a page: places of points, round ticks, joints where they are."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from seaid._arrays import Array
from seaid.report.html_charts import Axis, Figure, Layer
from seaid.report.html_robot import Label, posture_of, robot_picture
from tests.experiments import arm, arm_found, leg


def points_of(svg: str, name: str = "a") -> Array:
    """Return the places (P, 2) of the points of a class in a chart."""
    (path,) = re.findall(rf'<path class="points {name}" d="([^"]*)"', svg)
    return np.array([[float(x) for x in one.split()] for one in re.findall(r"M([^Mh]*)h0", path)])


def test_points_are_placed_between_the_ticks_of_their_values() -> None:
    x, y = np.array([0.0, 1.0, 2.0]), np.array([-10.0, 0.0, 10.0])
    svg = str(Figure("<t>", [Layer(x, y, "a")], Axis("x", "s"), Axis("y", "N m")).svg)
    places = points_of(svg)
    assert np.all(np.diff(places[:, 0]) > 0)
    assert np.all(np.diff(places[:, 1]) < 0)  # upwards
    zero = re.search(r'<text x="52" y="([\d.]+)" text-anchor="end">0</text>', svg)
    assert zero is not None
    assert float(zero[1]) - 4 == pytest.approx(places[1, 1], abs=0.1)
    assert "x [s]" in svg
    assert 'aria-label="&lt;t&gt;"' in svg


def test_small_values_have_their_power_of_ten_in_the_label() -> None:
    x = np.linspace(-3e-5, 4e-5, 9)
    svg = str(Figure("t", [Layer(x, x, "a")], Axis("x", "m"), Axis("y", "N")).svg)
    assert "x [10⁻⁵ m]" in svg
    ticks = re.findall(r'text-anchor="middle">([−\d.]+)</text>', svg)
    assert ticks == ["−2", "0", "2", "4"]


def test_lines_are_interrupted_and_constants_and_nothing_are_drawn() -> None:
    y = np.array([1.0, 1.0, np.nan, 1.0, 1.0])
    svg = str(Figure("t", [Layer(np.arange(5.0), y, "b", "line")], Axis("x"), Axis("y")).svg)
    (path,) = re.findall(r'<path class="line b" d="([^"]*)"', svg)
    assert [path.count(sign) for sign in "ML"] == [2, 2]
    nothing = Layer(np.zeros(0), np.zeros(0), "a")
    assert "NaN" not in str(Figure("t", [nothing], Axis("x"), Axis("y")).svg).upper()


def test_posture_is_that_of_the_robot_in_the_middle_of_its_motion() -> None:
    """Independent route: products of placements and rotations about the axes of the URDF."""
    posture = posture_of(arm_found())
    positions = arm_found().motions[0].joint_position
    middle = 0.5 * (positions.min(axis=0) + positions.max(axis=0))
    model = arm().model
    place, frames = pin.SE3.Identity(), {}
    for number, index in enumerate(arm().model_order, 1):  # a chain
        axis = pin.SE3(place * model.jointPlacements[number]).rotation.T @ posture.axes[index]
        shift = middle[index] * axis
        move = (
            pin.SE3(np.eye(3), shift)
            if arm().is_prismatic[index]
            else pin.SE3(pin.exp3(shift), 0 * shift)
        )
        place = place * model.jointPlacements[number] * move
        frames[index] = place
    for index, frame in frames.items():
        np.testing.assert_allclose(posture.origins[index], frame.translation, atol=1e-12)
    last = arm().model_order[-1]
    mass, *moments = arm_found().robot.parameters[10 * last : 10 * last + 4]
    end = frames[last].act(1.6 * np.array(moments) / mass)
    np.testing.assert_allclose(posture.links[-1], [frames[last].translation, end], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(posture.axes, axis=1), 1.0)
    assert posture.up.tolist() == [0.0, 0.0, 1.0]


def test_every_joint_is_drawn_in_its_colour_with_its_label() -> None:
    found = replace(arm_found(), robot=leg(), motions=())
    names = leg().joint_names
    labels = {name: Label(name, f"{k} %", "good") for k, name in enumerate(names)}
    labels["knee_pitch"] = Label("knee_pitch", "<99> %", "poor", is_flagged=True)
    svg = str(robot_picture(posture_of(found), labels, "title"))
    assert svg.count('<g class="joint good">') == 4
    assert svg.count('<g class="joint poor">') == 1
    assert svg.count('class="flag"') == 1
    assert "&lt;99&gt; %" in svg
    for name in names:
        assert f"<title>{name}: " in svg
    assert svg.count("<text") == 5
    assert "nan" not in svg
