import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import ExcitationError
from seaid.excitation import (
    BasisName,
    FourierBasis,
    JoinedBasis,
    Trajectory,
    load_trajectory,
    make_basis,
)
from seaid.excitation.trajectory import message_times
from tests.plants import polynomial_trajectory


def resting(scale: float = 1.0) -> Trajectory:
    inside = scale * np.random.default_rng(0).normal(size=(8, 2))
    values = np.pad(inside, ((2, 2), (0, 0)), mode="edge")
    return Trajectory(("rail", "elbow"), make_basis("bspline", 2.0, 12), values, ("rail",))


def restless(name: BasisName = "polynomial") -> Trajectory:
    basis = make_basis(name, 2.0, 9)
    return Trajectory(("elbow",), basis, np.random.default_rng(0).normal(size=(9, 1)))


def test_a_resting_motion_holds_its_ends() -> None:
    motion = resting()
    assert motion.rests_at_ends
    assert [states.shape for states in motion.sample(0.7)] == [(1, 2)] * 3
    assert not motion.coefficients.flags.writeable
    q, v, a = motion.sample([-1.0, 0.0, 2.0, 3.0])
    np.testing.assert_array_equal(q[0], q[1])
    np.testing.assert_array_equal(q[2], q[3])
    np.testing.assert_allclose(q[[0, 2]], motion.coefficients[[0, -1]], atol=1e-14)
    np.testing.assert_array_equal(v, 0.0)
    np.testing.assert_array_equal(a, 0.0)


def test_a_restless_motion_cannot_be_sampled_outside() -> None:
    motion = restless()
    assert not motion.rests_at_ends
    motion.sample([0.0, 2.0 + 1e-12])
    with pytest.raises(ExcitationError, match=r"time 2\.5 s is outside of this motion"):
        motion.sample([1.0, 2.5])


def joined() -> Trajectory:
    parts = (make_basis("bspline", 0.5, 8), FourierBasis(3, 1.0), make_basis("polynomial", 0.5, 6))
    values = np.random.default_rng(0).normal(size=(21, 2))
    return Trajectory(("a", "b"), JoinedBasis(parts), values, ("b",), (0.5, 1.5))


def test_json_gives_back_the_same_motion_bit_for_bit(tmp_path: Path) -> None:
    twice = Trajectory(("elbow",), FourierBasis(4, 2.0, 2), restless("fourier").coefficients)
    for motion in (resting(), restless(), restless("fourier"), joined(), twice):
        motion.save(tmp_path / "motion.json")
        again = load_trajectory(tmp_path / "motion.json")
        assert again.joint_names == motion.joint_names
        assert again.prismatic_joints == motion.prismatic_joints
        assert again.main_interval == motion.main_interval
        time = np.linspace(0.0, 2.0, 101)
        np.testing.assert_array_equal(motion.sample(time), again.sample(time))
    assert [path.name for path in tmp_path.iterdir()] == ["motion.json"]


def test_set_points_have_their_units_in_the_header(tmp_path: Path) -> None:
    motion = resting()
    motion.save_set_points(tmp_path / "motion.csv", rate_hz=50.0)
    with (tmp_path / "motion.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == [
        "time_s",
        *("rail.position_m", "rail.velocity_m_s", "rail.acceleration_m_s2"),
        *("elbow.position_rad", "elbow.velocity_rad_s", "elbow.acceleration_rad_s2"),
    ]
    table = np.array(rows, dtype=float)
    np.testing.assert_allclose(table[:, 0], np.arange(101) / 50.0, rtol=1e-15)
    q, v, a = motion.sample(table[:, 0])
    np.testing.assert_array_equal(table[:, [1, 4]], q)
    np.testing.assert_array_equal(table[:, [2, 5]], v)
    np.testing.assert_array_equal(table[:, [3, 6]], a)


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_a_rate_must_be_more_than_zero(tmp_path: Path, rate: float) -> None:
    with pytest.raises(ExcitationError, match="rate_hz must be finite and more than 0, found"):
        resting().save_set_points(tmp_path / "motion.csv", rate_hz=rate)
    with pytest.raises(ExcitationError, match="rate_hz must be finite and more than 0, found"):
        resting().joint_trajectory(rate)
    assert not list(tmp_path.iterdir())


def test_own_polynomial_of_equation_18() -> None:
    motion = polynomial_trajectory(["a", "b"], 3.0, [[1, 0], [0, 2], [0, 0], [0.5, 0], [0, -1]])
    time = np.linspace(0.0, 3.0, 7)
    q, v, a = motion.sample(time)
    np.testing.assert_allclose(q, np.column_stack([1 + 0.5 * time**3, 2 * time - time**4]))
    np.testing.assert_allclose(v, np.column_stack([1.5 * time**2, 2 - 4 * time**3]), atol=1e-12)
    np.testing.assert_allclose(a, np.column_stack([3 * time, -12 * time**2]), atol=1e-12)


TWELVE = make_basis("bspline", 2.0, 12)
TORN = np.where(np.arange(24).reshape(12, 2) == 7, np.nan, 0.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Trajectory(("a", "a"), TWELVE, np.zeros((12, 2))), "joint names, each once"),
        (lambda: Trajectory((), TWELVE, np.zeros((12, 0))), "needs joint names"),
        (lambda: Trajectory(("elbow",), TWELVE, np.zeros((12, 1)), ("elbo",)), "mean 'elbow'"),
        (lambda: Trajectory(("a",), TWELVE, np.zeros((11, 1))), r"shape \(12, 1\), found \(11, 1"),
        (lambda: Trajectory(("a", "b"), TWELVE, TORN), "coefficients of joint 'b' are not all fin"),
        (lambda: polynomial_trajectory(["a"], 1.0, np.zeros((3, 1))), "at least 3, found 2"),
        (lambda: resting().sample([0.0, np.nan]), "must be finite"),
    ],
)
def test_bad_trajectories_say_what_is_wrong(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ExcitationError, match=words):
        make()


def change(content: dict[str, Any], **changes: Any) -> str:
    return json.dumps({key: value for key, value in (content | changes).items() if value != "drop"})


FOURIER = {"type": "fourier", "harmonics": 1, "duration": 2.0}


def test_broken_files_say_what_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "motion.json"
    with pytest.raises(ExcitationError, match="cannot read trajectory"):
        load_trajectory(path)
    resting().save(path)
    content = json.loads(path.read_text())
    for text, words in (
        ("{", "is not JSON"),
        ("[1]", "is no trajectory"),
        (change(content, format="other 2"), "is no trajectory: 'format' is 'other 2'"),
        (change(content, basis="drop"), "is not complete"),
        (change(content, basis={"type": "spline", "degree": 5}), "is not complete: KeyError"),
        (change(content, basis={"type": "spline", "degree": 5, "knots": "x"}), "must be a number"),
        (change(content, basis={"type": "spline", "degree": "5", "knots": [0]}), "a whole number"),
        (change(content, basis={"type": "wavelet"}), "no basis type is named 'wavelet'"),
        (change(content, coefficients=[[0.0]]), "coefficients must have shape"),
        (change(content, coefficients=[["0.0"]]), "coefficients must be a number, found '0.0'"),
        (change(content, coefficients=[[True]]), "coefficients must be a number, found True"),
        (change(content, joints="ab"), "joints must be a list of names, found 'ab'"),
        (change(content, joints=[["a"], 2]), "joints must be a list of names"),
        (change(content, prismatic_joints=None), "prismatic_joints must be a list of names"),
        (change(content, main_interval=0), "main_interval must be a start and an end, found 0"),
        (change(content, basis=[1]), "a basis must be an object with a type"),
        (change(content, basis={"type": "joined", "parts": "x"}), "parts must be a list of bases"),
        (change(content, basis=FOURIER | {"harmonics": True}), "harmonics must be a whole number"),
        (
            change(content, basis=FOURIER | {"duration": 1e300}, coefficients=[[0, 0]] * 3),
            "lasts from 1e-06 to 1e[+]07 s",
        ),
        (change(content, basis=FOURIER, coefficients=[[0, 1e300]] * 3), "at most 1e[+]09 rad or m"),
        (change(content, basis={"type": "spline", "degree": 3, "knots": []}), "must be 4 zeros"),
        (change(content, basis={"type": "spline", "degree": 10**9, "knots": [0]}), "at most 100"),
    ):
        path.write_text(text)
        with pytest.raises(ExcitationError, match=words):
            load_trajectory(path)


# numbers in YAML 1.1 as its readers resolve them: an exponent needs a point before it
YAML_FLOAT = re.compile(r"[-+]?[0-9]+\.[0-9]*([eE][-+][0-9]+)?|[-+]?[0-9]+")


def test_message_has_the_shape_of_a_joint_trajectory_and_the_states() -> None:
    planned = resting()
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
    values = np.array([1e-5, 1e-5, 1e-5, 2e-7, 1e-5, 1e-5, 1e-5])[:, None]
    Trajectory(("a 1e-05",), make_basis("bspline", 1.0, 7), values).save_joint_trajectory(
        tmp_path / "small.yaml", 2.0
    )
    small = (tmp_path / "small.yaml").read_text()
    assert '"positions": [1.0e-05]' in small
    assert json.loads(small)["joint_names"] == ["a 1e-05"]
    planned = resting(1e-5)  # json alone writes 1e-05, which YAML takes for a word
    path = tmp_path / "motion.yaml"
    planned.save_joint_trajectory(path, 20.0)
    text = path.read_text()
    assert json.loads(text) == planned.joint_trajectory(20.0)
    assert "e-" in text
    for token in re.findall(r"(?<=[\[ ])[-+]?\d[^,\]} \n]*", text):
        assert YAML_FLOAT.fullmatch(token), token
