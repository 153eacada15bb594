"""A short run of the fuzzer: fixed cases of each target; `scripts/fuzz.py` runs many more."""

from __future__ import annotations

import os
import subprocess
import sys
import traceback
from pathlib import Path
from random import Random

import pytest

from tests.fuzz import seeds
from tests.fuzz.targets import TARGETS, LawError, run_case

ROOT = Path(__file__).parents[2]
CASES = {"mesh": 6, "hebilog": 6, "command": 6, "identify": 20}
"""Cases of the slow targets; of the others 40."""


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_content_is_taken_or_refused_in_our_words(name: str, tmp_path: Path) -> None:
    kinds = set()
    for seed in range(CASES.get(name, 40)):
        folder = tmp_path / str(seed)
        folder.mkdir()
        outcome = run_case(name, seed, folder)
        said = "".join(traceback.format_exception(outcome.problem)) if outcome.problem else ""
        assert outcome.kind in ("accepted", "refused"), f"{name} {seed}: {said}"
        kinds.add(outcome.kind)
    assert kinds == {"accepted", "refused"}  # else the mutators do too much, or nothing


@pytest.mark.parametrize("name", TARGETS)
def test_a_case_is_its_target_and_seed(name: str, tmp_path: Path) -> None:
    folders = [tmp_path / one for one in ("a", "b")]
    for folder in folders:
        folder.mkdir()
        TARGETS[name](Random(f"{name} 3"), folder)
    one, two = (seeds.files_in(folder) for folder in folders)
    assert one == two


def fuzz(*arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-W", "ignore", "scripts/fuzz.py", "--workers", "1", *arguments]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
