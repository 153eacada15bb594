"""What the shell offers on TAB, by the protocol of its environment variables."""

from dataclasses import fields, is_dataclass
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import pytest
from typer.testing import CliRunner

import seaid
from seaid.cli import excite, simulate
from seaid.cli.commands import COMMANDS, app
from seaid.cli.kinds import LOGS, SENSORS
from seaid.cli.options import IdentifyOptions, RobotOptions
from seaid.errors import Severity
from seaid.estimation.fitting import EstimatorName
from seaid.excitation import BasisName
from seaid.excitation.criteria import CriterionName
from seaid.excitation.multisine import Spectrum
from seaid.identification.problem import Method
from seaid.identification.static_calibration import Law
from seaid.log.readers.opening import READERS
from seaid.regressor.structural_identifiability import Sensor
from seaid.robot import BaseKind

ROOT = Path(__file__).parents[2]
LEG = str(ROOT / "models" / "tulip_leg.urdf")
JOINTS = ["hip_yaw", "hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch"]


def offered(line: str) -> list[str]:
    """Return what bash is offered for the last word of a line."""
    words = line.split(" ")
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    asked |= {"_TYPER_COMPLETE_ARGS": line, "_SEAID_COMPLETE": "complete_bash"}
    said = CliRunner().invoke(app, [], env=asked)
    assert (said.exit_code, said.stderr) == (0, "")
    return said.stdout.split()


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("seaid freq", ["frequency"]),
        (f"seaid identify {LEG} --estimator ", ["ols", "wls", "huber", "tukey", "iv"]),
        (f"seaid excite {LEG} --basis ", ["bspline", "polynomial", "fourier", "multisine"]),
        (f"seaid inspect {LEG} --joints ", JOINTS),
        (f"seaid inspect {LEG} --joints hip_yaw,hip_r", ["hip_yaw,hip_roll"]),
        (f"seaid inspect {LEG} --known", []),
        (f"seaid excite {LEG} --velocity hip_yaw=2,k", ["hip_yaw=2,knee_pitch="]),
        (f"seaid inspect {LEG} --payload f", ["foot:"]),
        (f"seaid inspect {LEG} --sensors joint_position,joint", ["joint_position,joint_torque"]),
        ("seaid inspect no.urdf --joints ", []),
        ("seaid inspect mod", []),  # the shell offers its own files where nothing is offered
        ("seaid compare ", []),
    ],
)
def test_bash_is_offered_values_and_names(line: str, found: list[str]) -> None:
    assert offered(line) == found


LIBRARY: dict[str, Any] = {
    "estimator": EstimatorName,
    "method": Method,
    "basis": BasisName,
    "spectrum": Spectrum,
    "criterion": CriterionName,
    "base": BaseKind,
    "law": Law,
    "fail_on": Severity,
}


def test_choices_are_those_of_the_library() -> None:
    """Of options in all commands, of sensors, and of formats of logs."""
    functions = [getattr(import_module(f"seaid.cli.{name}"), name) for name in COMMANDS]
    groups = {hint for one in functions for hint in get_type_hints(one).values()}
    tried = set()
    for function in (*functions, *filter(is_dataclass, groups)):
        for name, hint in get_type_hints(function).items():
            literals = [x for x in (hint, *get_args(hint)) if get_origin(x) is Literal]
            if literals and name in LIBRARY:
                assert {*get_args(literals[0])} == {*get_args(LIBRARY[name])}, name
                tried.add(name)
    assert tried == {*LIBRARY}
    assert {*SENSORS} == {*get_args(Sensor)}
    assert {*READERS} <= {*LOGS}


@pytest.mark.parametrize(
    ("command", "function", "names"),
    [
        (IdentifyOptions, seaid.identify, "method estimator encoder_offset_std"),
        (RobotOptions, seaid.load_robot, "gravity base independent_mimics"),
        (excite.MotionOptions, seaid.design_excitation, "basis"),
        (excite.SearchOptions, seaid.design_excitation, "criterion starts iterations seed"),
        (excite.MultisineOptions, seaid.excitation.Multisine, "spectrum period_s posture"),
        (excite.StanceOptions, seaid.excitation.Stance, "friction sole_m least_load"),
        (excite.LimitOptions, seaid.Limits, " ".join(one.name for one in fields(seaid.Limits))),
        (simulate.simulate, seaid.simulate, "rate_hz seed"),
    ],
)
def test_defaults_are_those_of_the_library(command: Any, function: Any, names: str) -> None:
    """By the signatures of both."""
    of_command, of_library = signature(command).parameters, signature(function).parameters
    for name in names.split():
        assert of_command[name].default == of_library[name].default, name
