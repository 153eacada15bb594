"""A short run of the fuzzer: fixed cases of each target; `scripts/fuzz.py` runs many more."""

from __future__ import annotations

import json
import tempfile
import traceback
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

import seaid
from seaid.errors import LogError
from tests.fuzz import seeds
from tests.fuzz.targets import TARGETS, run_case

CASES = {"mesh": 5, "run": 12, "bag": 4, "mat": 5, "hebilog": 5, "identify": 12}
CASES |= {"parquet": 10, "hdf5": 10, "csv": 10, "parameters": 10}
"""Cases of the targets that take longer; of the others 25."""


@pytest.mark.slow  # 2.1 s
@pytest.mark.parametrize("name", sorted({*TARGETS} - {"command"}))  # which has its own test below
def test_damaged_content_is_taken_or_refused_in_our_words(name: str, tmp_path: Path) -> None:
    if name == "hebilog":
        pytest.importorskip("hebi", reason="HEBI's reader is not installed")
    kinds = [kind_of(name, seed, tmp_path) for seed in range(CASES.get(name, 25))]
    assert {*kinds} == {"accepted", "refused"}  # else the mutators do too much, or nothing


def kind_of(name: str, seed: int, place: Path) -> str:
    """Return how a case ended, in a folder of its own: as it may."""
    folder = place / str(seed)
    folder.mkdir()
    outcome = run_case(name, seed, folder)
    said = "".join(traceback.format_exception(outcome.problem)) if outcome.problem else ""
    assert outcome.kind in ("accepted", "refused"), f"{name} {seed}: {said}"
    return outcome.kind


@pytest.mark.parametrize("name", TARGETS)
def test_a_case_is_its_target_and_seed(name: str, tmp_path: Path) -> None:
    """A finding can be made again."""
    folders = [tmp_path / one for one in ("a", "b")]
    for folder in folders:
        folder.mkdir()
        TARGETS[name](Random(f"{name} 3"), folder)
    one, two = (seeds.files_in(folder) for folder in folders)
    assert one == two


def test_commands_are_taken_or_refused_and_write_nothing_outside_of_their_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    around = tmp_path / "x" / "y" / "z"
    around.mkdir(parents=True)
    monkeypatch.chdir(around)
    assert {kind_of("command", seed, tmp_path) for seed in range(8)} == {"accepted", "refused"}
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["x", *map(str, range(8))])
    assert [path.name for path in (tmp_path / "x").rglob("*")] == ["y", "z"]


# Names and expressions of any letters

names = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)


@given(st.lists(names, min_size=1, max_size=6, unique=True))
def test_columns_of_any_names_are_described_or_refused(found: list[str]) -> None:
    """Any names of columns are described or refused."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.json"
        path.write_text(json.dumps({name: [0.0, 0.1, 0.3] for name in found}))
        with suppress(LogError):
            seaid.describe_log(path)
