"""write_randomization: its ranges hold the truth, its samples are robots that can exist."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from scripts.benchmarks.randomization_coverage import log_of
from seaid.errors import RobotError
from seaid.export import Randomization
from seaid.identification import Identification
from seaid.robot import is_physical
from seaid.robot.inertia import from_center_of_mass
from tests.terms import STIFF, arm


@cache
def found_in(folder: Path) -> Identification:
    drive = replace(STIFF, friction=("viscous", "coulomb"), nominal={})
    robot = arm(folder, drive, drive)
    log = log_of(robot, np.random.default_rng(0))
    return seaid.identify(robot, log, feasible=True, cutoff_hz=8.0)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Identification:
    return found_in(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def made(found: Identification, tmp_path_factory: pytest.TempPathFactory) -> Randomization:
    return seaid.export.write_randomization(
        found, tmp_path_factory.mktemp("made") / "a.json", samples=200
    )


def test_samples_are_robots_that_can_exist(found: Identification, made: Randomization) -> None:
    assert all(is_physical(ten_of(body), 1e-9) for row in bodies_of(made) for body in row)
    names = [one.name for one in made.ranges]
    for name in ("viscous_friction", "dry_friction", "armature"):
        places = [at for at, one in enumerate(names) if one == name]
        assert len(places) == 2
        assert np.all(made.samples[:, places] >= 0)


def test_samples_have_the_covariance_of_the_estimate(
    found: Identification, made: Randomization
) -> None:
    """Base parameters of the samples scatter as the log says, single ones as the prior says."""
    theta = np.array([np.concatenate([ten_of(x) for x in row]) for row in bodies_of(made)])
    combinations = theta @ found.base.grouping.T
    scores = combinations.std(axis=0) / found.load.standard_errors
    # 16 degrees of freedom of the standard errors widen a normal distribution by 1.08
    assert np.all((scores > 0.9) & (scores < 1.27))
    upper = theta[:, 9]  # of whose Izz no torque depends on
    assert upper.std() / upper.mean() == pytest.approx(0.1, rel=0.4)


def bodies_of(made: Randomization) -> Any:
    return made.samples[:, -20:].reshape(-1, 2, 10)


def ten_of(body: Any) -> Any:
    mass, x, y, z, xx, xy, yy, xz, yz, zz = body
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return from_center_of_mass(mass, np.array([x, y, z]), tensor)


def test_what_is_not_determined_is_named(made: Randomization) -> None:
    free = {(one.of, one.name): one.why for one in made.unidentified}
    assert "no torque of this robot depends on Izz of this body" in free["upper", "Izz"]
    assert any("only in combination: " in why for why in free.values())
    given = [one for one in made.ranges if one.source == "given"]
    assert {one.name for one in given} == {"armature"}
    assert all(one.low == one.high == one.nominal for one in given)
    for one in made.ranges:
        assert one.low <= one.nominal <= one.high


@pytest.mark.slow  # 500 robots are written
def test_the_file_holds_what_is_returned(found: Identification, tmp_path: Path) -> None:
    made = seaid.export.write_randomization(
        found, tmp_path / "a.json", samples=3, level=0.9, seed=5
    )
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["format"] == "seaid randomization 1"
    assert content["samples"] == made.samples.tolist()
    assert [one["low"] for one in content["parameters"]] == [one.low for one in made.ranges]
    assert len(content["unidentified"]) == len(made.unidentified)
    assert made.samples.shape == (3, len(made.ranges))


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("a.txt", {}, r"must end in \.json"),
        ("a.json", {"level": 1.0}, "level= must be between 0 and 1, found 1.0"),
        ("a.json", {"samples": -1}, "samples= must be a whole number of 0 or more"),
        ("a.json", {"samples": 1.5}, "samples= must be a whole number of 0 or more"),
        ("a.json", {"spread": 0.0}, "spread= must be above 0 and at most 1"),
    ],
)
def test_what_is_refused(
    found: Identification, tmp_path: Path, name: str, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(RobotError, match=words):
        seaid.export.write_randomization(found, tmp_path / name, **options)


def test_bodies_that_cannot_exist_are_refused(found: Identification, tmp_path: Path) -> None:
    values = found.robot.parameters.copy()
    values[4] = -1.0
    broken = replace(found, robot=found.robot.with_values(values, found.robot.drives))
    with pytest.raises(RobotError, match="'upper' is physically inconsistent: identify with fea"):
        seaid.export.write_randomization(broken, tmp_path / "a.json")
