"""What the shell offers on TAB, and that values of options are those of the library."""

from dataclasses import fields
from inspect import signature
from typing import Any, get_args

import click
import pytest
from click.testing import CliRunner

import seaid
from seaid.cli import excite, simulate
from seaid.cli.commands import COMMANDS, app, command_of
from seaid.cli.options import IdentifyOptions, RobotOptions
from seaid.errors import Severity
from seaid.estimation.fitting import EstimatorName
from seaid.excitation import BasisName
from seaid.excitation.criteria import CriterionName
from seaid.excitation.multisine import Spectrum
from seaid.identification.problem import Method
from seaid.identification.static_calibration import Law
from seaid.robot import BaseKind


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("seaid freq", ["plain,frequency"]),
        ("seaid identify leg.urdf --estimator t", ["plain,tukey"]),
        ("seaid inspect mod", ["file,mod"]),  # the shell offers its files
    ],
)
def test_bash_is_offered_commands_and_values(line: str, found: list[str]) -> None:
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split()) - 1)}
    said = CliRunner().invoke(app, [], env=asked | {"_SEAID_COMPLETE": "bash_complete"})
    assert (said.exit_code, said.stdout.split()) == (0, found)


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
    options = [option for name in COMMANDS for option in command_of(name).params]
    tried = {x.name: x.type.choices for x in options if isinstance(x.type, click.Choice)}
    assert {name: {*choices} for name, choices in tried.items() if name in LIBRARY} == {
        name: {*get_args(kind)} for name, kind in LIBRARY.items()
    }


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
    of_command, of_library = signature(command).parameters, signature(function).parameters
    for name in names.split():
        assert of_command[name].default == of_library[name].default, name
