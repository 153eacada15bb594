"""What the shell offers on TAB, by the protocol of its environment variables."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import get_args

import pytest
from typer.testing import CliRunner

import seaid
from seaid.cli.commands import COMMANDS, app, command_of
from seaid.cli.completion import BY_JOINT, CHOICES, FILES, LOGS, SENSORS, completer_of
from seaid.cli.excite import LimitOptions
from seaid.cli.simulate import NoiseOptions
from seaid.estimation import EstimatorName
from seaid.excitation import BasisName, CriterionName
from seaid.identification import Method
from seaid.log.readers.opening import READERS
from seaid.regressor import Sensor

ROOT = Path(__file__).parents[2]
LEG = str(ROOT / "models" / "tulip_leg.urdf")
JOINTS = ["hip_yaw", "hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch"]


def offered(line: str, folder: Path, shell: str = "bash") -> list[str]:
    """Return what the shell is offered for the last word of a line."""
    words = line.split(" ")
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    asked |= {"_TYPER_COMPLETE_ARGS": line, "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    asked |= {"_SEAID_COMPLETE": f"complete_{shell}"}
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(folder)
        said = CliRunner().invoke(app, [], env=asked)
    assert (said.exit_code, said.stderr) == (0, "")
    return said.stdout.split()


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("seaid gear", ["gear-ratio"]),
        (f"seaid identify {LEG} --estimator ", ["ols", "wls", "huber", "tukey", "iv"]),
        (f"seaid identify {LEG} --estimator h", ["huber"]),
        (f"seaid identify {LEG} --method s", ["simultaneous"]),
        (f"seaid identify {LEG} --fail-on d", ["doubtful"]),
        (f"seaid excite {LEG} --basis ", ["bspline", "polynomial", "fourier", "multisine"]),
        (f"seaid excite {LEG} --criterion d", ["d_optimality"]),
        (f"seaid inspect {LEG} --joints ", JOINTS),
        (f"seaid inspect {LEG} --joints hip_yaw,hip_r", ["hip_yaw,hip_roll"]),
        (f"seaid inspect {LEG} --joints knee_pitch,k", []),
        (f"seaid inspect {LEG} --known", []),
        (f"seaid excite {LEG} --velocity hip_yaw=2,k", ["hip_yaw=2,knee_pitch="]),
        (f"seaid inspect {LEG} --payload f", ["foot:"]),
        (f"seaid identify {LEG} --known-body sh", ["shank"]),
        (f"seaid inspect {LEG} --sensors joint_position,joint", ["joint_position,joint_torque"]),
        ("seaid inspect no.urdf --joints ", []),
        ("seaid inspect ", ["arm.URDF", "logs/", "robots/"]),
        ("seaid inspect a", ["arm.URDF"]),
        ("seaid inspect lo", ["logs/", "logs/run.urdf"]),
        ("seaid identify arm.URDF logs/r", ["logs/run.csv"]),
        ("seaid identify arm.URDF --drives arm", ["arm.toml"]),
        ("seaid compare logs/p", ["logs/parameters.json"]),
    ],
)
def test_bash_is_offered_values_names_and_files(
    tmp_path: Path, line: str, found: list[str]
) -> None:
    for name in ("arm.URDF", "arm.toml", "arm.txt", ".hidden.urdf", "logs/run.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    for name in ("logs/run.urdf", "logs/parameters.json", "robots/arm.urdf"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert offered(line, tmp_path) == found


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_are_offered_the_same(tmp_path: Path, shell: str) -> None:
    found = " ".join(offered(f"seaid inspect {LEG} --joints hip_", tmp_path, shell))
    assert all(joint in found for joint in ("hip_yaw", "hip_roll", "hip_pitch"))
    assert "knee" not in found


def test_choices_are_those_of_the_library() -> None:
    assert CHOICES["estimator"] == get_args(EstimatorName)
    assert CHOICES["method"] == get_args(Method)
    assert CHOICES["basis"] == get_args(BasisName)
    assert CHOICES["criterion"] == get_args(CriterionName)
    assert {*SENSORS} == {*get_args(Sensor)}
    assert {*READERS} <= {*LOGS}
    by_joint = [one.name for group in (LimitOptions, NoiseOptions) for one in fields(group)]
    assert {*BY_JOINT} == {*by_joint, "position_gain", "velocity_gain"}
    assert {one.name for one in fields(seaid.Limits)} <= {*BY_JOINT}


TO_WRITE = ("output", "figure", "joint_trajectory", "folder")


def test_every_file_of_a_command_is_completed() -> None:
    """A file to read is of a known kind; a file to write is named by hand."""
    for name in COMMANDS:
        for one in command_of(name).params:
            kind = one.type_descriptor.annotation
            if kind in (Path, list[Path]) and one.name not in TO_WRITE:
                assert one.name in FILES, (name, one.name)
    assert completer_of("output") is None


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_installed_and_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: str
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    for option in ("--show-completion", "--install-completion"):
        said = CliRunner().invoke(app, [option, shell], prog_name="seaid")
        assert said.exit_code == 0, said.stderr
    assert f"{shell} completion installed in" in said.stdout
    written = [one.read_text() for one in tmp_path.rglob("*") if one.is_file()]
    assert any("_SEAID_COMPLETE=complete_" + shell in text for text in written)
