"""Base parameters by the recursion: their text, a floating base, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid.errors import RobotError, SeaidError, SymbolicError
from seaid.legged import load_robot
from seaid.robot.robot import Robot
from seaid.symbolic import base_parameters
from tests.regressor.stances import check_floating

Y = '<axis xyz="0 1 0"/>'


def test_grouping_is_rational_and_readable(write_chain: Callable[..., Path]) -> None:
    knee = f'continuous {Y}<origin xyz="0 0 0.275"/>'
    robot = load_robot(write_chain({"hip": f"continuous {Y}", "knee": knee}))
    base = base_parameters(robot)
    assert base.expressions == (
        "mx_hip_link",
        "mz_hip_link + 11/40 m_knee_link",
        "Iyy_hip_link + 121/1600 m_knee_link",
        "mx_knee_link",
        "mz_knee_link",
        "Iyy_knee_link",
    )
    assert np.array_equal(np.array(base.exact_grouping, dtype=float), base.grouping)
    assert base.exact_grouping[2][10] * 1600 == 121


def test_long_numbers_are_shown_as_decimals(
    example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    """Short rationals stay as they are."""
    texts = base_parameters(load_quietly(example_path("ur5_robot.urdf"))).expressions
    assert "0.01846 m_upper_arm_link + 2717/10000 my_upper_arm_link" in texts[0]


@pytest.mark.parametrize("name", ["a1.urdf", "ur5_robot.urdf", "baxter.urdf"])
def test_floating_base_is_that_of_pinocchios_free_flyer(
    name: str, example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    """Columns and grouping; the base has a name that no link has."""
    robot = load_quietly(example_path(name))
    exact = base_parameters(robot, floating_base=True)
    link = "floating_base" if "base" in robot.body_names else "base"
    assert exact.names[:4] == tuple(f"{parameter}_{link}" for parameter in ("m", "mx", "my", "mz"))
    check_floating(exact, load_quietly(example_path(name), base="floating"))


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        (
            {"through": "energy", "torque_joints": ("knee_pitch",)},
            SymbolicError,
            r'through="energy", but only through="torque"',
        ),
        ({"through": "torques"}, SymbolicError, "did you mean 'torque'"),
        (
            {"through": "energy", "floating_base": True},
            SymbolicError,
            "floating_base=True needs",
        ),
        ({"torque_joints": ("knee_pich",)}, RobotError, "did you mean 'knee_pitch'"),
        ({"torque_joints": ()}, SymbolicError, "at least one joint name"),
        ({"torque_joints": "knee_pitch"}, SymbolicError, "found 'knee_pitch'"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    options: Any, error: type[SeaidError], words: str, tulip_leg: Robot
) -> None:
    """The message names the option that goes."""
    with pytest.raises(error, match=words):
        base_parameters(tulip_leg, **options)
