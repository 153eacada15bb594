"""Figures: whole files, with the numbers of the validation in their captions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import pytest
from matplotlib.image import imread

from scripts.coverage import save_coverage_figure
from scripts.excitation_figure import save_excitation_figure
from scripts.torque_figures import save_actuator_figure, save_load_figure
from seaid.errors import SeaidError
from seaid.excitation.limits import JointLimits
from seaid.excitation.trajectory import Trajectory, polynomial_trajectory
from seaid.identification import Validation
from tests.experiments import arm_result
from tests.representatives import quick_first


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[matplotlib.figure.Figure]:
    """Return the figures that would be saved, to look into: to draw one takes two seconds."""
    figures: list[matplotlib.figure.Figure] = []

    def note(figure: matplotlib.figure.Figure, file: BytesIO, **options: Any) -> None:
        figures.append(figure)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", note)
    return figures


def png_size(path: Path) -> tuple[int, int]:
    head = path.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return int.from_bytes(head[16:20]), int.from_bytes(head[20:24])


@pytest.mark.parametrize("save", quick_first([save_actuator_figure, save_load_figure]))
def test_files_are_png_of_a_sensible_size(
    tmp_path: Path, save: Callable[[Validation, Path], None]
) -> None:
    path = tmp_path / "new folder" / "side.png"
    save(arm_result(), path)
    width, height = png_size(path)
    assert 800 <= width <= 2000
    assert 400 <= height <= 2500
    assert path.stat().st_size > 20_000


def test_actuator_figure_shows_best_and_worst_joint(
    tmp_path: Path, drawn: list[matplotlib.figure.Figure]
) -> None:
    save_actuator_figure(arm_result(), tmp_path / "a.png")
    found = arm_result()
    errors = found.actuator.relative_error
    best, worst = (1, 2) if errors[1] < errors[2] else (2, 1)
    axes = drawn[0].axes
    captions = [axis.get_title(loc="left") for axis in axes]
    assert len(captions) == 2
    for caption, joint, note in zip(captions, (best, worst), ("best", "worst"), strict=True):
        assert f"{found.joints[joint]}, {note} joint" in caption
        assert f"relative error {errors[joint]:.1%} below {found.cutoff_hz:.3g} Hz" in caption
        assert f"R² {found.actuator.r_squared[joint]:.4f}" in caption
    assert axes[0].get_ylabel() == "torque [mN m]"
    assert axes[-1].get_xlabel() == "time [s]"


def test_load_figure_shows_every_joint_measured_grey_and_computed_black(
    tmp_path: Path, drawn: list[matplotlib.figure.Figure]
) -> None:
    save_load_figure(arm_result(), tmp_path / "b.png")
    assert len(drawn[0].axes) == 4
    for joint, axis in enumerate(drawn[0].axes):
        measured, computed = axis.get_lines()
        assert (measured.get_label(), computed.get_label()) == ("measured", "computed")
        assert (measured.get_color(), computed.get_color()) == ("0.62", "black")
        assert np.array_equal(measured.get_ydata(), arm_result().load.measured[:, joint], True)
        assert np.array_equal(computed.get_ydata(), arm_result().load.computed[:, joint], True)
        caption = axis.get_title(loc="left")
        assert f"{arm_result().load.relative_error[joint]:.1%}" in caption
        assert f"({arm_result().load.raw_relative_error[joint]:.1%} raw)" in caption


def test_every_sample_is_drawn_behind_where_it_is_given(
    tmp_path: Path, drawn: list[matplotlib.figure.Figure]
) -> None:
    raw = np.full_like(arm_result().load.measured, np.nan)
    raw[:, 1] = np.arange(len(raw))
    save_load_figure(arm_result(), tmp_path / "b.png", raw=raw)
    lines = [axis.get_lines() for axis in drawn[0].axes]
    assert [len(of_joint) for of_joint in lines] == [2, 3, 2, 2]
    assert lines[1][0].get_label() == "measured, every sample"
    assert np.array_equal(lines[1][0].get_ydata(), raw[:, 1])


def test_no_actuator_figure_without_an_elastic_joint(tmp_path: Path) -> None:
    nothing = replace(arm_result().actuator, relative_error=np.full(4, np.nan))
    stiff = replace(arm_result(), actuator=nothing)
    with pytest.raises(SeaidError, match="none of rail, shoulder, telescope, wrist has an act"):
        save_actuator_figure(stiff, tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("drawn")
def test_figure_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(SeaidError, match="cannot write"):
        save_load_figure(arm_result(), tmp_path / "file" / "load_side.png")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


#


NAMES = ["stiffness of knee", "viscous_friction of knee", "Izz_foot"]


def test_one_panel_per_estimator_is_drawn(tmp_path: Path) -> None:
    sizes = []
    for estimators in (["wls"], ["wls", "joint", "refine"]):
        coverage = {one: np.array([0.95, 0.6, 1.0]) for one in estimators}
        save_coverage_figure(
            NAMES, coverage, dict.fromkeys(estimators, 40), tmp_path / "coverage.png"
        )
        sizes.append(imread(tmp_path / "coverage.png").shape)
    assert sizes[1][1] > sizes[0][1]
    assert sizes[1][0] == sizes[0][0]


def test_a_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SeaidError, match="file"):
        save_coverage_figure(
            NAMES, {"wls": np.ones(3)}, {"wls": 10}, tmp_path / "file" / "coverage.png"
        )


# The figure of a planned motion: every joint and limit drawn, with units, and the spectra.


@pytest.fixture
def drawn_plan(monkeypatch: pytest.MonkeyPatch) -> list[matplotlib.figure.Figure]:
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
    tmp_path: Path, drawn_plan: list[matplotlib.figure.Figure]
) -> None:
    motion, limits = planned(3)
    save_excitation_figure(motion, limits, tmp_path / "motion.png")
    assert (tmp_path / "motion.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    axes = np.array(drawn_plan[0].axes).reshape(3, 3)
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
    tmp_path: Path, drawn_plan: list[matplotlib.figure.Figure]
) -> None:
    motion, limits = planned(12)
    save_excitation_figure(motion, limits, tmp_path / "motion.png")
    axes = drawn_plan[0].axes
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
    tmp_path: Path, drawn_plan: list[matplotlib.figure.Figure]
) -> None:
    motion, limits = planned(2)
    after = np.array([2.0, 8.0, 4.0])
    for before, said in (([9.0, 1.0, 0.5], "18"), ([9.0, 1.0, 0.0], "inf")):
        save_excitation_figure(motion, limits, tmp_path / "motion.png", np.array(before), after)
        panel = drawn_plan[-1].axes[-1]
        first, second = panel.get_lines()
        assert panel.get_yscale() == "log"
        assert first.get_label() == f"before optimisation: condition number {said}"
        assert second.get_label() == "after optimisation: condition number 4"
        assert np.array_equal(second.get_ydata(), [8.0, 4.0, 2.0])
    save_excitation_figure(motion, limits, tmp_path / "motion.png", singular_after=after)
    assert len(drawn_plan[-1].axes[-1].get_lines()) == 1


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
