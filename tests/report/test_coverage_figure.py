from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from scripts.coverage import save_coverage_figure
from seaid.errors import SeaidError

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
