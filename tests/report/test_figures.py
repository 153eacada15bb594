"""Figures: whole files, with the numbers of the validation in their captions."""

from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import pytest

from scripts.excitation_figure import save_excitation_figure
from scripts.torque_figures import save_actuator_figure, save_load_figure
from seaid.errors import SeaidError
from seaid.excitation import Trajectory
from seaid.excitation.limits import JointLimits
from tests.experiments import arm_result
from tests.plants import polynomial_trajectory


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[matplotlib.figure.Figure]:
    """Return the figures that would be saved, to look into: to draw one takes two seconds."""
    figures: list[matplotlib.figure.Figure] = []

    def note(figure: matplotlib.figure.Figure, file: BytesIO, **options: Any) -> None:
        figures.append(figure)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", note)
    return figures


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
    """Behind them are the measured torques of one comparison, and the computed ones of another."""
    load, shape = arm_result().load, arm_result().load.measured.shape
    every = replace(arm_result(), load=replace(load, measured=np.ones(shape)))
    chatter = replace(arm_result(), cutoff_hz=50.0, load=replace(load, computed=np.zeros(shape)))
    save_load_figure(arm_result(), tmp_path / "b.png", raw=(every, chatter))
    assert len(drawn[0].axes) == 4
    for joint, axis in enumerate(drawn[0].axes):
        *behind, measured, computed = axis.get_lines()
        words = [line.get_label() for line in behind]
        assert words == ["measured, every sample", "computed below 50 Hz"]
        for line, value in zip(behind, (1.0, 0.0), strict=True):
            assert np.unique(np.asarray(line.get_ydata())).tolist() == [value]
        assert (measured.get_label(), computed.get_label()) == ("measured", "computed")
        assert (measured.get_color(), computed.get_color()) == ("0.62", "black")
        assert np.array_equal(measured.get_ydata(), arm_result().load.measured[:, joint], True)
        assert np.array_equal(computed.get_ydata(), arm_result().load.computed[:, joint], True)
        caption = axis.get_title(loc="left")
        assert f"{arm_result().load.relative_error[joint]:.1%}" in caption
        assert f"({arm_result().load.raw_relative_error[joint]:.1%} raw)" in caption


# The figure of a planned motion: every joint and limit drawn, with units, and the spectra.


def planned(n: int) -> tuple[Trajectory, JointLimits]:
    """Return a motion of n joints, the second of which slides, and limits of their own."""
    names = [f"j{joint}" for joint in range(n)]
    powers = np.random.default_rng(0).uniform(-0.1, 0.1, (5, n))
    grow = np.linspace(1.0, 2.0, n)
    limits = JointLimits(-grow, 2 * grow, 3 * grow, 4 * grow)
    return polynomial_trajectory(names, 2.0, powers, names[1:2]), limits


def test_a_row_a_joint_with_limits_and_units(
    tmp_path: Path, drawn: list[matplotlib.figure.Figure]
) -> None:
    motion, limits = planned(3)
    save_excitation_figure(motion, limits, tmp_path / "motion.png")
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


def test_what_cannot_be_drawn_is_refused(
    tmp_path: Path, drawn: list[matplotlib.figure.Figure]
) -> None:
    """Singular values that are none, limits of another robot, and a robot without springs."""
    motion, limits = planned(2)
    for bad in ([1.0, np.nan], [1.0, -1.0], []):
        with pytest.raises(SeaidError, match="singular_before must be finite numbers of zero or"):
            save_excitation_figure(motion, limits, tmp_path / "motion.png", np.array(bad))
    with pytest.raises(SeaidError, match="2 joints in the trajectory, limits of 3"):
        save_excitation_figure(motion, planned(3)[1], tmp_path / "motion.png")
    nothing = replace(arm_result().actuator, relative_error=np.full(4, np.nan))
    with pytest.raises(SeaidError, match="none of rail, shoulder, telescope, wrist has an act"):
        save_actuator_figure(replace(arm_result(), actuator=nothing), tmp_path / "a.png")
    assert drawn == []
    assert not list(tmp_path.iterdir())
