"""The commands on a robot without an encoder behind its spring, from `inspect` to `export`."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import pytest

import seaid
from scripts.benchmarks.motor_side import ANYDRIVE, robot_of, simulated_together
from tests.cli.small_arm import done


@pytest.mark.slow  # four identifications and two logs of a plant in Python
def test_commands_on_a_log_of_the_motor_alone(tmp_path: Path) -> None:
    robot_of(ANYDRIVE, tmp_path)
    drives, log, other = (tmp_path / name for name in ("arm.toml", "run.csv", "other.csv"))
    drives.write_text(
        f'[arm]\ntype = "series_elastic"\ngear_ratio = {ANYDRIVE.ratio}\n'
        f'motor_inertia_kg_m2 = {ANYDRIVE.rotor}\nfriction = ["viscous", "coulomb"]\n'
    )
    for path, one in zip((log, other), simulated_together([ANYDRIVE] * 2, [50, 51]), strict=True):
        seaid.write_log(one, path)
    robot = (tmp_path / "arm.urdf", "--drives", drives)

    sensors = ("--sensors", "motor_position,motor_torque")
    assert "derivatives" in done("inspect", *robot, *sensors).out

    for options in ((), ("--refine",)):
        saved = tmp_path / f"parameters{len(options)}.json"
        said = done("identify", *robot, log, *options, "-o", saved)
        assert "no sensor behind the spring" in said.out + said.err
        (drive,) = json.loads(saved.read_text())["drives"].values()
        assert drive["stiffness"]["value"] == pytest.approx(ANYDRIVE.k, rel=0.01)

    validated = done("validate", *robot, "--from", log, other)
    assert "no measured torque on its load" in validated.out + validated.err

    page = tmp_path / "report.html"
    done("report", *robot, "--from", log, "--validate", other, "-o", page)
    assert "no sensor behind the spring" in page.read_text("utf-8")

    model = tmp_path / "arm.xml"
    done("export", *robot, "--from", log, "-o", model)
    stiffness = mujoco.MjModel.from_xml_path(str(model)).jnt_stiffness
    tendon = mujoco.MjModel.from_xml_path(str(model)).tendon_stiffness
    assert max([*stiffness, *tendon]) == pytest.approx(ANYDRIVE.k, rel=0.01)
