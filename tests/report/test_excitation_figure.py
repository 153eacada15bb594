"""The figure of a planned motion: every joint and limit drawn, with units, and the spectra."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import pytest

from scripts.excitation_figure import save_excitation_figure
from seaid.errors import SeaidError
from seaid.excitation.limits import JointLimits
from seaid.excitation.trajectory import Trajectory, polynomial_trajectory


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[matplotlib.figure.Figure]:
    """Return the figures that were saved, to look into."""
    figures: list[matplotlib.figure.Figure] = []
    save = matplotlib.figure.Figure.savefig

    def note(figure: matplotlib.figure.Figure, *arguments: Any, **options: Any) -> None:
        figures.append(figure)
        save(figure, *arguments, **options)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", note)
    return figures


def planned(n: int) -> tuple[Trajectory, JointLimits]:
    """Return a motion of n joints, the second of which slides, and limits of their own."""
    names = [f"j{joint}" for joint in range(n)]
    powers = np.random.default_rng(0).uniform(-0.1, 0.1, (5, n))
    grow = np.linspace(1.0, 2.0, n)
    limits = JointLimits(-grow, 2 * grow, 3 * grow, 4 * grow)
    return polynomial_trajectory(names, 2.0, powers, names[1:2]), limits


@pytest.mark.slow  # 1.0 s
def test_a_row_a_joint_with_limits_and_units(
    tmp_path: Path, drawn: list[matplotlib.figure.Figure]
) -> None:
    motion, limits = planned(3)
    save_excitation_figure(motion, limits, tmp_path / "motion.png")
    assert (tmp_path / "motion.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    axes = np.array(drawn[0].axes).reshape(3, 3)
    time = axes[0, 0].get_lines()[0].get_xdata()
    states = motion.sample(time)
    units = [["[rad]", "[rad/s]", "[rad/s²]"], ["[m]", "[m/s]", "[m/s²]"]]
    for joint in range(3):
        bounds = ((limits.lower, limits.upper), limits.velocity, limits.acceleration)
        for kind, name in enumerate(("position", "velocity", "acceleration")):
            panel = axes[joint, kind]
            curve, low, high = panel.get_lines()
            assert np.array_equal(curve.get_ydata(), states[kind][:, joint])
            bound = bounds[kind]
            pair = bound if isinstance(bound, tuple) else (-bound, bound)
            assert (low.get_ydata()[0], high.get_ydata()[0]) == (pair[0][joint], pair[1][joint])
            assert panel.get_title(loc="left") == f"j{joint}: {name}"
            assert panel.get_ylabel() == units[joint == 1][kind]
    assert [panel.get_xlabel() for panel in axes[-1]] == ["time [s]"] * 3


def test_many_joints_share_a_panel_a_kind_each_in_its_colour(
    tmp_path: Path, drawn: list[matplotlib.figure.Figure]
) -> None:
    motion, limits = planned(12)
    save_excitation_figure(motion, limits, tmp_path / "motion.png")
    axes = drawn[0].axes
    assert len(axes) == 3
    q, v, a = motion.sample(axes[0].get_lines()[0].get_xdata())
    shares = ((q - limits.middle) / limits.half_range, v / limits.velocity, a / limits.acceleration)
    for panel, share in zip(axes, shares, strict=True):
        *curves, high, low = panel.get_lines()
        assert [curve.get_label() for curve in curves] == list(motion.joint_names)
        assert len({tuple(curve.get_color()) for curve in curves}) == 12
        for curve, values in zip(curves, share.T, strict=True):
            assert np.array_equal(curve.get_ydata(), values)
        assert [np.ravel(line.get_ydata())[0] for line in (high, low)] == [1.0, -1.0]


@pytest.mark.slow  # columns of several planned motions
def test_singular_values_with_their_condition_numbers(
    tmp_path: Path, drawn: list[matplotlib.figure.Figure]
) -> None:
    motion, limits = planned(2)
    after = np.array([2.0, 8.0, 4.0])
    for before, said in (([9.0, 1.0, 0.5], "18"), ([9.0, 1.0, 0.0], "inf")):
        save_excitation_figure(motion, limits, tmp_path / "motion.png", np.array(before), after)
        panel = drawn[-1].axes[-1]
        first, second = panel.get_lines()
        assert panel.get_yscale() == "log"
        assert first.get_label() == f"before optimisation: condition number {said}"
        assert second.get_label() == "after optimisation: condition number 4"
        assert np.array_equal(second.get_ydata(), [8.0, 4.0, 2.0])
    save_excitation_figure(motion, limits, tmp_path / "motion.png", singular_after=after)
    assert len(drawn[-1].axes[-1].get_lines()) == 1


@pytest.mark.parametrize("bad", [[1.0, np.nan], [1.0, -1.0], []])
def test_bad_singular_values(tmp_path: Path, bad: list[float]) -> None:
    motion, limits = planned(2)
    with pytest.raises(SeaidError, match="singular_before must be finite numbers of zero or more"):
        save_excitation_figure(motion, limits, tmp_path / "motion.png", np.array(bad))
    assert not list(tmp_path.iterdir())


@pytest.mark.slow  # 0.6 s
def test_limits_of_another_robot_and_a_path_that_cannot_be(tmp_path: Path) -> None:
    motion, limits = planned(3)
    with pytest.raises(SeaidError, match="3 joints in the trajectory, limits of 2"):
        save_excitation_figure(motion, planned(2)[1], tmp_path / "motion.png")
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(SeaidError, match="cannot write"):
        save_excitation_figure(motion, limits, tmp_path / "file" / "motion.png")
