"""Columns of the terms that a drive lacks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seaid._arrays import Array
from seaid.checks.terms import _changed, possible_terms, with_term
from seaid.drives.terms import DRY, PARAMETERS_OF
from seaid.regressor import motor_regressor
from tests.one_joint import one_joint
from tests.terms import STIFF


@pytest.mark.parametrize("law", ["smooth_coulomb", "dahl"])
@pytest.mark.parametrize("dry", DRY)
def test_a_smooth_law_replaces_the_columns_that_it_changes(
    dry: str, law: str, tmp_path: Path
) -> None:
    """These are the columns with the sign of the speed, those by a nonlinear parameter too."""
    terms: Any = tuple(dict.fromkeys(("viscous", "coulomb", dry)))
    robot = one_joint(tmp_path).with_drives({"arm": replace(STIFF, friction=terms)})
    smooth = robot.with_drives({"arm": with_term(robot.drives["arm"], "friction", law)})
    old, new = (motor_regressor(x, "arm") for x in (robot, smooth))
    rng = np.random.default_rng(1)
    signals = {name: rng.normal(size=20) for name in sorted(old.signals | new.signals)}
    values = {str(name): rng.uniform(0.5, 1.5) for name in new.names}
    common = [name for name in old.names if name in new.names]
    before, after = (x.columns(signals, values, common) for x in (old, new))
    differ = {x for x, *pair in zip(common, before.T, after.T, strict=True) if not close(*pair)}
    new_names = [name for name in new.names if name not in old.names]
    assert {*_changed(law, old, new, new_names)} == differ
    assert {*PARAMETERS_OF["friction"][dry]} <= differ


def close(before: Array, after: Array) -> bool:
    return bool(np.allclose(before, after, rtol=1e-9))


def test_a_smooth_drive_gets_a_shift_and_no_other_law() -> None:
    asked = {"friction": ("coulomb", "dahl", "shifted_coulomb", "load"), "spring": ("cubic",)}
    drive = replace(STIFF, friction=("viscous", "smooth_coulomb"))
    assert [*possible_terms(drive, asked)] == [
        ("friction", "shifted_coulomb"),
        ("friction", "load"),
    ]
