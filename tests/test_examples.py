"""The examples in the docstrings of the packages run as they stand."""

from __future__ import annotations

import doctest
import shutil
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import seaid
from seaid.simulation.simulation import measure
from tests.experiments import LEG_SENSORS, leg, leg_motion

MODELS = Path(__file__).parents[1] / "models"
PACKAGES = ("drives", "robot", "log", "regressor", "excitation", "simulation", "identification")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with models/ and two logs of the leg, as the examples expect them."""
    place = tmp_path_factory.mktemp("examples")
    (place / "models").mkdir()
    for name in ("tulip_leg.urdf", "tulip_leg.toml", "tulip_plan.json"):
        shutil.copy(MODELS / name, place / "models" / name)
    for seed, name in enumerate(("run", "other")):
        seaid.write_log(measure(leg(), leg_motion(), LEG_SENSORS, seed), place / f"{name}.csv")
    return place


@pytest.mark.parametrize(
    "name",
    # that of the simulation simulates a whole plan
    [
        pytest.param(name, marks=pytest.mark.slow if name == "simulation" else ())
        for name in (*PACKAGES, "export", "report")
    ],
)
def test_example_of_a_package_runs(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    text = (Path(seaid.__file__).parent / name / "__init__.py").read_text().split('"""')[1]
    examples = doctest.DocTestParser().get_examples(text)
    assert len(examples) >= 2
    values: dict[str, object] = {}
    for example in examples:
        exec(compile(example.source, f"seaid.{name}", "single"), values)
    plt.close("all")
    assert all(value is not None for value in values.values())
