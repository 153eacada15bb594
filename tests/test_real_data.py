"""Measured logs of real robots; skipped where the folder with them is missing."""

import importlib.util
import sys
import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import seaid

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"measured logs are not part of the project: no folder {DATA}"
)


def script(name: str) -> ModuleType:
    """Import a script as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def test_ur10_second_half_from_the_first() -> None:
    ur10 = script("identify_ur10")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", seaid.SeaidWarning)  # its URDF has rounded angles
        robot = ur10.load_ur10()
    log = ur10.read(DATA / "ur10_exciting" / "ur10_exciting_trajectory.csv", robot)
    middle = float(np.mean(log.time[[0, -1]]))
    found = seaid.identify(robot, log.between(-np.inf, middle))
    unseen = seaid.validate(found, log.between(middle, np.inf))
    assert len(found.load.values) == 36
    assert np.all(unseen.load.relative_error <= np.array([0.18, 0.05, 0.06, 0.15, 0.13, 0.31]))


def test_hebi_spring_without_the_deflection_channel() -> None:
    hebi = script("identify_hebi_joint")
    robot = seaid.load_robot(
        ROOT / "models" / "hebi_arm_2.urdf", drivetrains=ROOT / "models" / "hebi_arm_2.toml"
    )
    found = seaid.identify(robot, hebi.read(DATA / "hebi_arms" / "virtual_spring.csv", robot))
    assert found.drivetrains["joint_0"].value("stiffness") == pytest.approx(70.0, rel=0.04)
    assert not found.drivetrains["joint_0"].flags
    assert "stiffness of joint_1 is poorly identified" in found.flags[0]
