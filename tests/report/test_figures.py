"""Figures: whole files, with the numbers of the validation in their captions."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import pytest

from scripts.torque_figures import save_actuator_figure, save_load_figure
from seaid.errors import SeaidError
from tests.experiments import arm_result


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[matplotlib.figure.Figure]:
    """Return the figures that were saved, to look into."""
    figures: list[matplotlib.figure.Figure] = []
    save = matplotlib.figure.Figure.savefig

    def note(figure: matplotlib.figure.Figure, file: BytesIO, **options: Any) -> None:
        figures.append(figure)
        save(figure, file, **options)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", note)
    return figures


def png_size(path: Path) -> tuple[int, int]:
    head = path.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return int.from_bytes(head[16:20]), int.from_bytes(head[20:24])


@pytest.mark.slow  # 2.1 s
def test_files_are_png_of_a_sensible_size(tmp_path: Path) -> None:
    save_actuator_figure(arm_result(), tmp_path / "new folder" / "actuator_side.png")
    save_load_figure(arm_result(), tmp_path / "load_side.png")
    for path in (tmp_path / "new folder" / "actuator_side.png", tmp_path / "load_side.png"):
        width, height = png_size(path)
        assert 800 <= width <= 2000
        assert 400 <= height <= 2500
        assert path.stat().st_size > 20_000


@pytest.mark.slow  # 4.8 s
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


def test_figure_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(SeaidError, match="cannot write"):
        save_load_figure(arm_result(), tmp_path / "file" / "load_side.png")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
