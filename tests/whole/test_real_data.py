"""Measured logs of real robots: every figure of the table, and what is shipped of them."""

import warnings
from pathlib import Path

import pytest

import seaid
from scripts import real_data
from tests.measured import LOGS

CASES = real_data.read_cases()


@pytest.mark.slow  # friction that is searched for, or simulated sample by sample
@pytest.mark.parametrize("case", [x for x in CASES if not x.forward], ids=lambda case: case.name)
def test_every_figure_of_a_measured_set_is_reached(case: real_data.Case, tmp_path: Path) -> None:
    """Those of a simulation sample by sample are long: the script has them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", seaid.SeaidWarning)
        rows = list(real_data.rows_of(case, LOGS, tmp_path))
    asked = [row for row in rows if row.met is not None]
    assert asked
    assert [row.cells() for row in asked if not row.met] == []


@pytest.mark.slow  # sixteen logs
def test_position_commands_alone_give_the_motor_of_a_servo() -> None:
    """Gains in volts: their scale is kt/R. The published model had the voltage."""
    (case,) = (one for one in CASES if one.gains)
    sets = real_data.gain_sets_of(case, case.load_robot(), LOGS)
    assert [len(logs) for _, logs in sets.values()] == [4, 4, 4, 4]
    found = seaid.identify_conditions(sets, condition_specific=()).identifications
    rows = list(real_data.value_rows(case, next(iter(found.values()))))
    assert [row.met for row in rows] == [True, True]


def test_shipped_logs_are_small_and_keep_their_licences() -> None:
    files = [path for path in LOGS.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 8e6
    sets = {path.name for path in LOGS.iterdir() if path.is_dir()}
    readme = (LOGS / "README.md").read_text(encoding="utf-8")
    for name in sets:
        assert "opyright" in (LOGS / name / "LICENSE.txt").read_text(encoding="utf-8")
        assert f"## {name}" in readme
    others = {"hebi_x5_unloaded", "go2_commands"}
    assert sets == {Path(case.logs).parts[0] for case in CASES} | others
