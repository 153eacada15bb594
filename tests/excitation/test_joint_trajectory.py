from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from seaid.errors import ExcitationError, SeaidError
from seaid.excitation import Trajectory, make_basis
from seaid.excitation.trajectory import message_times

# numbers in YAML 1.1 as its readers resolve them: an exponent needs a point before it
YAML_FLOAT = re.compile(r"[-+]?[0-9]+\.[0-9]*([eE][-+][0-9]+)?|[-+]?[0-9]+")


def motion(duration: float = 2.0, scale: float = 1.0) -> Trajectory:
    inside = scale * np.random.default_rng(0).normal(size=(8, 2))
    values = np.pad(inside, ((2, 2), (0, 0)), mode="edge")
    return Trajectory(("rail", "elbow"), make_basis("bspline", duration, 12), values, ("rail",))


def test_message_has_the_shape_of_a_joint_trajectory_and_the_states() -> None:
    planned = motion()
    message = planned.joint_trajectory(50.0)
    assert list(message) == ["header", "joint_names", "points"]
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert message["joint_names"] == ["rail", "elbow"]
    points = message["points"]
    assert len(points) == 101
    q, v, a = planned.sample(np.arange(101) / 50)
    for name, states in (("positions", q), ("velocities", v), ("accelerations", a)):
        np.testing.assert_allclose([point[name] for point in points], states, atol=1e-7)
    assert all(point["effort"] == [] for point in points)
    assert points[-1]["time_from_start"] == {"sec": 2, "nanosec": 0}
    assert points[-1]["velocities"] == points[-1]["accelerations"] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("duration", "rate", "count", "last_but_one"),
    [
        (2.0, 100.0, 201, 1_990_000_000),
        (1.0, 3.0, 4, 666_666_667),
        (0.1 + 0.2, 10.0, 4, 200_000_000),  # a bit more than 0.3
        (0.7 - 1e-16, 10.0, 8, 600_000_000),
        (2.005, 100.0, 202, 2_000_000_000),
        (1e5 + 0.001, 1.0, 10**5 + 2, 10**14),
        (0.005, 100.0, 2, 0),
    ],
)
def test_times_are_whole_nanoseconds_and_the_end_is_there_once(
    duration: float, rate: float, count: int, last_but_one: int
) -> None:
    times = message_times(duration, rate)
    assert len(times) == count
    assert times[0] == 0
    assert times[-2] == last_but_one
    assert times[-1] == round(duration * 1e9)
    assert np.all(np.diff(times) > 0)


def test_file_is_json_and_its_numbers_are_numbers_in_yaml(tmp_path: Path) -> None:
    planned = motion(scale=1e-5)  # json alone writes 1e-05, which YAML takes for a word
    path = tmp_path / "motion.yaml"
    planned.save_joint_trajectory(path, 20.0)
    text = path.read_text()
    assert json.loads(text) == planned.joint_trajectory(20.0)
    assert "e-" in text
    for token in re.findall(r"(?<=[\[ ])[-+]?\d[^,\]} \n]*", text):
        assert YAML_FLOAT.fullmatch(token), token


def test_numbers_with_an_exponent_get_a_point(tmp_path: Path) -> None:
    values = np.array([1e-5, 1e-5, 1e-5, 2e-7, 1e-5, 1e-5, 1e-5])[:, None]
    planned = Trajectory(("a 1e-05",), make_basis("bspline", 1.0, 7), values)
    planned.save_joint_trajectory(tmp_path / "motion.yaml", 2.0)
    text = (tmp_path / "motion.yaml").read_text()
    assert '"positions": [1.0e-05]' in text
    assert json.loads(text)["joint_names"] == ["a 1e-05"]


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_a_rate_must_be_more_than_zero(rate: float) -> None:
    with pytest.raises(ExcitationError, match="rate_hz must be more than zero, found"):
        motion().joint_trajectory(rate)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(SeaidError, match="cannot write"):
        motion().save_joint_trajectory(tmp_path / "taken" / "motion.yaml")
