from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import ExcitationError, SeaidError
from seaid.excitation import SplineBasis, Trajectory, load_trajectory, polynomial_trajectory
from seaid.excitation.basis import make_basis


def resting() -> Trajectory:
    basis = make_basis("bspline", 2.0, 12)
    values = np.pad(np.random.default_rng(0).normal(size=(8, 2)), ((2, 2), (0, 0)), mode="edge")
    return Trajectory(("rail", "elbow"), basis, values, ("rail",))


def periodic() -> Trajectory:
    basis = make_basis("fourier", 2.0, 9)
    return Trajectory(("elbow",), basis, np.random.default_rng(0).normal(size=(9, 1)))


def restless() -> Trajectory:
    basis = make_basis("polynomial", 2.0, 9)
    return Trajectory(("elbow",), basis, np.random.default_rng(0).normal(size=(9, 1)))


def test_a_resting_motion_holds_its_ends() -> None:
    motion = resting()
    assert motion.rests_at_ends
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


def test_times_must_be_finite() -> None:
    with pytest.raises(ExcitationError, match="must be finite"):
        resting().sample([0.0, np.nan])


def test_one_time_is_one_row() -> None:
    q, v, a = resting().sample(0.7)
    assert q.shape == v.shape == a.shape == (1, 2)


def test_json_gives_back_the_same_motion_bit_for_bit(tmp_path: Path) -> None:
    for motion in (resting(), restless(), periodic()):
        motion.save(tmp_path / "motion.json")
        again = load_trajectory(tmp_path / "motion.json")
        assert again.joint_names == motion.joint_names
        assert again.prismatic_joints == motion.prismatic_joints
        time = np.linspace(0.0, 2.0, 101)
        for first, second in zip(motion.sample(time), again.sample(time), strict=True):
            np.testing.assert_array_equal(first, second)
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


def test_a_rate_must_be_more_than_zero(tmp_path: Path) -> None:
    with pytest.raises(ExcitationError, match=r"rate_hz must be more than zero, found 0\.0"):
        resting().save_set_points(tmp_path / "motion.csv", rate_hz=0.0)
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(SeaidError, match="cannot write"):
        resting().save(tmp_path / "taken" / "motion.json")


def test_own_polynomial_of_equation_18() -> None:
    motion = polynomial_trajectory(["a", "b"], 3.0, [[1, 0], [0, 2], [0, 0], [0.5, 0], [0, -1]])
    time = np.linspace(0.0, 3.0, 7)
    q, v, a = motion.sample(time)
    np.testing.assert_allclose(q, np.column_stack([1 + 0.5 * time**3, 2 * time - time**4]))
    np.testing.assert_allclose(v, np.column_stack([1.5 * time**2, 2 - 4 * time**3]), atol=1e-12)
    np.testing.assert_allclose(a, np.column_stack([3 * time, -12 * time**2]), atol=1e-12)


@pytest.mark.parametrize(
    ("joints", "shape", "prismatic", "words"),
    [
        (("a", "a"), (12, 2), (), "joint names, each once"),
        ((), (12, 0), (), "needs joint names"),
        (("elbow",), (12, 1), ("elbo",), "did you mean 'elbow'"),
        (("a",), (11, 1), (), r"coefficients must have shape \(12, 1\), found \(11, 1\)"),
    ],
)
def test_bad_trajectories_say_what_is_wrong(
    joints: tuple[str, ...], shape: tuple[int, int], prismatic: tuple[str, ...], words: str
) -> None:
    basis = make_basis("bspline", 2.0, 12)
    with pytest.raises(ExcitationError, match=words):
        Trajectory(joints, basis, np.zeros(shape), prismatic)


def test_coefficients_must_be_finite() -> None:
    values = np.zeros((12, 2))
    values[3, 1] = np.nan
    basis = make_basis("bspline", 2.0, 12)
    with pytest.raises(ExcitationError, match="coefficients of joint 'b' are not all finite"):
        Trajectory(("a", "b"), basis, values)


def test_a_polynomial_needs_a_duration_and_cubic_terms() -> None:
    with pytest.raises(ExcitationError, match="duration must be more than zero"):
        polynomial_trajectory(["a"], -1.0, np.zeros((5, 1)))
    with pytest.raises(ExcitationError, match="at least 3, found 2"):
        polynomial_trajectory(["a"], 1.0, np.zeros((3, 1)))


def change(content: dict[str, Any], **changes: Any) -> str:
    return json.dumps({key: value for key, value in (content | changes).items() if value != "drop"})


FOURIER = {"type": "fourier", "harmonics": 1, "duration": 2.0}


def test_broken_files_say_what_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "motion.json"
    with pytest.raises(ExcitationError, match="cannot read trajectory"):
        load_trajectory(path)
    path.write_text("{")
    with pytest.raises(ExcitationError, match="is not JSON"):
        load_trajectory(path)
    path.write_text("[1]")
    with pytest.raises(ExcitationError, match="is no trajectory"):
        load_trajectory(path)
    resting().save(path)
    content = json.loads(path.read_text())
    for text, words in (
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


def test_arrays_are_read_only() -> None:
    motion = resting()
    with pytest.raises(ValueError, match="read-only"):
        motion.coefficients[0] = 1.0
    assert isinstance(motion.basis, SplineBasis)
    with pytest.raises(ValueError, match="read-only"):
        motion.basis.knots[0] = 1.0
