"""Numeric and exact base parameters are the same, on every robot there is."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seaid.errors import SeaidError
from seaid.regressor.base import base_parameters, cross_check
from seaid.robot.robot import Robot
from seaid.symbolic import base_parameters as exact_base_parameters

LARGEST = 60
"""Joints; the numeric QR of a larger tree takes seconds, and the script does them all."""

ROUNDED = {"kinova": (36, 38), "anymal-kinova": (104, 106), "so100": (36, 38), "so101": (36, 38)}


@pytest.mark.rounding
def test_numeric_and_exact_agree(example_urdf: Path, load_quietly: Callable[..., Robot]) -> None:
    robot = load_quietly(example_urdf)
    if robot.n > LARGEST:
        pytest.skip(f"{robot.n} joints: scripts/cross_check.py")
    check = cross_check(base_parameters(robot), exact_base_parameters(robot))
    assert check.agree, check
    assert check.same_columns
    assert check.counts[0] == check.counts[1]
    assert check.max_difference < 1e-9
    # The left-to-right choice is ill-conditioned where axes are tilted by 2.6 degrees.
    assert check.gap > (1e9 if example_urdf.stem == "romeo_laas_small" else 1e12)


@pytest.mark.rounding
def test_leg_agrees(tulip_leg: Robot) -> None:
    check = cross_check(base_parameters(tulip_leg), exact_base_parameters(tulip_leg))
    assert check.agree
    assert check.counts == (29, 29)
    assert check.max_difference < 1e-13


@pytest.mark.parametrize(("name", "counts"), ROUNDED.items(), ids=ROUNDED)
def test_rounded_angles_split_the_count_and_snapping_heals_it(
    name: str,
    counts: tuple[int, int],
    example_path: Callable[[str], Path],
    load_quietly: Callable[..., Robot],
) -> None:
    path = example_path(f"{name}.urdf")
    for tolerance, count in zip((2e-3, 0.0), counts, strict=True):
        robot = load_quietly(path, snap_tolerance_rad=tolerance)
        assert exact_base_parameters(robot).rank == count


@pytest.mark.rounding
def test_another_choice_of_columns_does_not_agree(tulip_leg: Robot) -> None:
    numeric = base_parameters(tulip_leg)
    fewer = replace(numeric, columns=numeric.columns[1:], grouping=numeric.grouping[1:])
    check = cross_check(fewer, exact_base_parameters(tulip_leg))
    assert not check.agree
    assert not check.same_columns
    assert check.max_difference == float("inf")
    assert check.counts == (28, 29)


def test_another_grouping_does_not_agree(tulip_leg: Robot) -> None:
    numeric = base_parameters(tulip_leg)
    grouping = np.array(numeric.grouping)
    grouping[0, -1] += 1e-6
    check = cross_check(replace(numeric, grouping=grouping), exact_base_parameters(tulip_leg))
    assert check.same_columns
    assert not check.agree
    # the coefficient's own rounding, 1e-16 of numbers up to 1, is 1e-10 of what was added
    assert check.max_difference == pytest.approx(1e-6, rel=1e-8)


@pytest.mark.rounding
def test_rounding_of_an_ill_conditioned_choice_is_no_disagreement(tulip_leg: Robot) -> None:
    """2.6e-9 of the largest coefficient, at a gap of 4e9: rounding, amplified by the choice."""
    numeric, exact = base_parameters(tulip_leg), exact_base_parameters(tulip_leg)
    grouping = np.array(numeric.grouping)
    grouping[0, -1] += 2.4e-9 * max(1.0, np.abs(grouping).max())
    for gap, agree in ((4e9, True), (1e14, False)):
        found = cross_check(replace(numeric, grouping=grouping, gap=gap), exact)
        assert found.agree is agree
    grouping[0, -1] += 2e-6
    assert not cross_check(replace(numeric, grouping=grouping, gap=10.0), exact).agree


def test_two_robots_are_not_compared(
    tulip_leg: Robot, example_path: Callable[[str], Path], load_quietly: Callable[..., Robot]
) -> None:
    other = load_quietly(example_path("xarm7.urdf"))
    with pytest.raises(SeaidError, match="found 50 and 70"):
        cross_check(base_parameters(tulip_leg), exact_base_parameters(other))


@pytest.mark.slow  # a script with exact base parameters of several robots
def test_table_of_the_script(tmp_path: Path) -> None:
    done = run_script("--only", "kinova", "--output", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("3 of 3 agree")
    assert done.stdout.rstrip().endswith(f"Table: {tmp_path / 'cross_check.md'}")
    text = (tmp_path / "cross_check.md").read_text()
    assert "| kinova | 6 | 36 | 36 | yes |" in text
    assert "| anymal-kinova: leg to LF_KFE | 3 | 17 | 17 | yes |" in text
    assert "| kinova, as written | 6 | 36 | 38 | no |" in text


def test_no_such_robot_is_one_line(tmp_path: Path) -> None:
    done = run_script("--only", "nothing", "--output", str(tmp_path))
    assert done.returncode != 0
    assert done.stderr.strip() == "error: no robot has 'nothing' in the name of its file"


def run_script(*arguments: str) -> subprocess.CompletedProcess[str]:
    script = Path(__file__).parents[2] / "scripts" / "cross_check.py"
    return subprocess.run(
        [sys.executable, str(script), *arguments],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
