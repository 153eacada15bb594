"""The criteria on the triangular factor: what they are, and their slopes against differences."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import seaid
from seaid._arrays import Array
from seaid.errors import ExcitationError
from seaid.excitation import criteria, excitation_measures
from seaid.excitation.observation_matrix import load_target, stacked_regressor
from seaid.regressor import base_parameters, rigid_body_regressor
from seaid.regressor.base import random_states
from seaid.robot import Robot
from tests.excitation.robots import robots
from tests.experiments import arm, leg, leg_motion, leg_trajectory


@pytest.mark.rounding
@settings(derandomize=True, max_examples=25, deadline=None)
@given(
    name=st.sampled_from(sorted(criteria.CRITERIA)),
    columns=st.integers(1, 12),
    previous_logs=st.integers(0, 4),
    seed=st.integers(0, 10**6),
)
def test_slope_equals_central_differences(
    name: criteria.CriterionName, columns: int, previous_logs: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    sizes = 10 ** rng.uniform(-2, 0, columns)
    H = rng.normal(size=(40, columns)) * sizes
    known = rng.normal(size=(previous_logs, columns)) * sizes
    smooth = criteria.CRITERIA[name].smooth
    value, slope = smooth(criteria.triangular_factor(H, known))
    direction = rng.normal(size=H.shape) * sizes
    step = 1e-5
    plus, minus = (
        smooth(criteria.triangular_factor(H + sign * step * direction, known))[0]
        for sign in (1, -1)
    )
    by_slope = float(np.sum((H @ slope) * direction))
    scale = float(np.linalg.norm(H @ slope / sizes) * np.linalg.norm(direction / sizes))
    assert by_slope == pytest.approx((plus - minus) / (2 * step), rel=1e-6, abs=1e-7 * scale)
    assert np.isfinite(value)


def test_what_the_criteria_are() -> None:
    """By the regressor itself; and the measures of columns of unit norm, and of dependent ones."""
    rng = np.random.default_rng(3)
    H = rng.normal(size=(50, 6)) * np.logspace(0, 1, 6)
    R = criteria.triangular_factor(H, np.empty((0, 6)))
    covariance = np.linalg.inv(H.T @ H)
    found = {name: np.exp(criterion.log_value(R)) for name, criterion in criteria.CRITERIA.items()}
    assert found["condition_number"] == pytest.approx(np.linalg.cond(H), rel=1e-10)
    assert found["d_optimality"] == pytest.approx(np.linalg.det(covariance) ** (1 / 12), rel=1e-9)
    worst = np.sqrt(np.diag(covariance).max())
    assert found["relative_error"] == pytest.approx(worst, rel=1e-10)
    np.testing.assert_allclose(criteria.singular_values(R), np.linalg.svd(H, compute_uv=False))
    scaled, d_value = criteria.scaled_condition_and_d_value(H)
    assert scaled == pytest.approx(np.linalg.cond(H / np.linalg.norm(H, axis=0)))
    assert d_value == pytest.approx(np.linalg.det(H.T @ H) ** (1 / 12))
    for dependent in (np.column_stack([H, H[:, 0]]), np.column_stack([H, 0 * H[:, 0]])):
        assert criteria.scaled_condition_and_d_value(dependent) == (np.inf, 0.0)


@pytest.mark.rounding
def test_smooth_criteria_are_little_above_the_plain_ones_and_recorded_rows_count() -> None:
    """Rows that were recorded stand above the planned ones, and a lost column is seen."""
    rng = np.random.default_rng(4)
    H, before = rng.normal(size=(50, 8)), rng.normal(size=(30, 8))
    R = criteria.triangular_factor(H, np.asarray(np.linalg.qr(before, mode="r")))
    np.testing.assert_allclose(R.T @ R, H.T @ H + before.T @ before, atol=1e-12)
    for criterion in criteria.CRITERIA.values():
        plain, smooth = criterion.log_value(R), criterion.smooth(R)[0]
        assert plain <= smooth + 1e-12 <= plain + 2 * np.log(8) / 32
    H[:, 3] = H[:, 0] - 2 * H[:, 1]
    assert not criteria.has_full_rank(criteria.triangular_factor(H, np.empty((0, 8))))
    assert not criteria.has_full_rank(criteria.triangular_factor(H[:3], np.empty((0, 8))))


# Planning measures that compare: invariant under the choice of base columns, and under units

TIME: Array = np.linspace(0.0, 6.0, 400)
ONE, OTHER = leg_trajectory(0), leg_trajectory(3)


def test_the_efficiency_does_not_depend_on_base_columns_and_units() -> None:
    """The raw condition number does: two routes to base parameters, and other units of columns."""
    bases = criteria.pivoted_base(leg()), base_parameters(leg())
    assert bases[0].columns != bases[1].columns
    units = 10.0 ** np.random.default_rng(2).uniform(-3, 3, 29)
    efficiencies, raw = [], []
    for base, scale in ((bases[0], 1.0), (bases[1], 1.0), (bases[1], units)):
        target = load_target(leg(), None, base)
        H = [stacked_regressor(target, TIME, one.sample(TIME)) * scale for one in (ONE, OTHER)]
        values = [criteria.scaled_condition_and_d_value(one)[1] for one in H]
        efficiencies.append(values[0] / values[1])
        raw.append(np.linalg.cond(H[0]))
    np.testing.assert_allclose(efficiencies, efficiencies[0], rtol=1e-7)
    assert abs(efficiencies[0] - 1) > 0.01
    assert raw[2] > 10 * raw[1]
    by_name = [excitation_measures(leg().without_nominal(), one) for one in (ONE, OTHER)]
    assert not by_name[0].has_drives
    assert by_name[0].d_efficiency(by_name[1]) == pytest.approx(efficiencies[0], rel=0.05)


@pytest.mark.slow  # simulates a planned motion
def test_the_motion_of_a_log_has_the_measures_of_its_plan_and_of_twice_that() -> None:
    plan = excitation_measures(leg(), ONE)
    q, v, a = ONE.sample(leg_motion().time)
    motion = replace(leg_motion(), joint_position=q, joint_velocity=v, joint_acceleration=a)
    log = excitation_measures(leg(), [motion])
    assert log.d_efficiency(plan) == pytest.approx(1.0, rel=1e-3)
    assert log.scaled_condition_number == pytest.approx(plan.scaled_condition_number, rel=1e-3)
    twice = excitation_measures(leg(), [motion, motion])
    assert twice.d_efficiency(log) == pytest.approx(1.0, rel=1e-3)


def test_a_motion_of_other_joints_is_not_measured() -> None:
    with pytest.raises(ExcitationError, match=r"the trajectory moves hip_yaw, .* but 'mixed_arm'"):
        excitation_measures(arm(), ONE)


def test_a_plan_states_its_measures() -> None:
    limits = seaid.Limits(velocity=2.5, acceleration=10.0)
    with pytest.warns(seaid.SeaidWarning, match="ended early"):
        plan = seaid.design_excitation(
            leg(), 4.0, limits=limits, starts=1, iterations=6, coefficients=10
        )
    again = excitation_measures(leg(), plan.trajectory)
    assert plan.measures.parameters == again.parameters
    assert plan.measures.scaled_condition_number == pytest.approx(
        again.scaled_condition_number, rel=0.2
    )
    assert "columns of unit norm, drives included" in str(plan)
    assert "D-value" in str(plan)
    bodies = excitation_measures(leg().without_nominal(), plan.trajectory)
    with pytest.raises(ExcitationError, match="compares motions of one robot"):
        again.d_efficiency(bodies)


@pytest.mark.rounding
@pytest.mark.parametrize(("name", "rank"), [("leg", 29), ("ur5", 36), ("panda_reordered", 43)])
def test_pivoted_base_tells_the_same_torques(name: str, rank: int) -> None:
    robot = robots()[name]
    base = criteria.pivoted_base(robot)
    assert len(base.columns) == rank
    Y = rigid_body_regressor(robot, *random_states(robot, 5))
    theta = np.random.default_rng(2).normal(size=10 * robot.n)
    np.testing.assert_allclose(base.reduce(Y) @ base.project(theta), Y @ theta, atol=1e-8)
    np.testing.assert_array_equal(base.grouping[:, base.columns], np.eye(rank))


@pytest.mark.rounding
@pytest.mark.parametrize("name", ["leg", "ur5", "panda_reordered"])
def test_rounding_does_not_choose_the_columns(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Other processors round otherwise: as if every entry were off by a few units in its place."""
    robot, rows = robots()[name], criteria._random_rows

    def rounded_otherwise(
        robot: Robot, known: list[int], seed: int, stances: Sequence[Sequence[str]]
    ) -> Array:
        H, rng = rows(robot, known, seed, stances), np.random.default_rng(seed)
        return H * (1.0 + 1e-14 * rng.uniform(-1.0, 1.0, H.shape))

    expected = criteria.pivoted_base(robot).columns
    monkeypatch.setattr(criteria, "_random_rows", rounded_otherwise)
    assert criteria.pivoted_base(robot).columns == expected


def test_known_bodies_leave_nothing_to_excite() -> None:
    robot = leg()
    with pytest.raises(ExcitationError, match="nothing to excite: all bodies are known"):
        seaid.design_excitation(replace(robot, known_bodies=robot.body_names), 5.0)
