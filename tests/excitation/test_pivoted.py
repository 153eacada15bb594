from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.errors import RobotError
from seaid.excitation import criteria
from seaid.excitation.criteria import pivoted_base
from seaid.regressor import rigid_body_regressor
from seaid.regressor.base import random_states
from seaid.robot.robot import Robot
from tests.excitation.robots import robots


@pytest.mark.rounding
@pytest.mark.parametrize(("name", "rank"), [("leg", 29), ("ur5", 36), ("panda_reordered", 43)])
def test_pivoted_base_tells_the_same_torques(name: str, rank: int) -> None:
    robot = robots()[name]
    base = pivoted_base(robot)
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

    expected = pivoted_base(robot).columns
    monkeypatch.setattr(criteria, "_random_rows", rounded_otherwise)
    assert pivoted_base(robot).columns == expected


def test_unknown_row_offers_the_nearest() -> None:
    with pytest.raises(RobotError, match="did you mean 'ankle_pitch'"):
        pivoted_base(robots()["leg"], ["ankle_pich"])
