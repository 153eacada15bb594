"""Command check: what is wrong with a set-up before a fit, and what logs determine of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import seaid
from seaid.cli.kinds import LogFile, ModelFile, Names, check_suffix
from seaid.cli.messages import is_terminal
from seaid.cli.options import FailOptions, LogOptions, ResultOptions, check_joints, refuse

Section = tuple[str, dict[str, Any]]
"""A part of the result: its text, and its content as JSON."""


def check(
    options: LogOptions,
    logs: tuple[LogFile, ...],
    *,
    terms: bool = False,
    of: Names | None = None,
    output: ModelFile | None = None,
    fail: FailOptions,
    result: ResultOptions,
) -> None:
    """Check units, signs, ratios, gravity and payloads of an experiment before a fit.

    The gear ratio of each joint comes from the angles on both sides of its gear, each log with its
    own encoder offsets, and behind a spring from the motor equation too. A late channel is named
    with the delay_s of the description of the log that corrects it. With --terms the command
    compares instead which further terms of friction and springs the logs support.

    Parameters
    ----------
    terms
        Compare which further terms of friction and springs the logs support.
    of
        Joints whose terms are compared, as a,b,c; default: all.
    output
        With --terms the drives with the recommended terms.

    Examples
    --------
    seaid check leg.urdf run.csv --drives leg.toml
    seaid check arm.urdf a.csv b.csv --drives arm.toml --fail-on doubtful
    seaid check leg.urdf run.csv --drives leg.toml --terms -o leg_with_terms.toml
    """
    _check_usage(output, terms)
    robot = options.robot()
    result.check(output, read=(*options.files, *logs))
    check_joints("--of", of, robot)
    read = options.logs(logs, robot)
    if not terms:
        setup = seaid.check(robot, read, cutoff_hz=options.cutoff_hz)
        facts = {"robot": robot.name, "warnings": setup.warnings}
        result.show(setup.summary(), {"joints": setup.joints}, **facts)
        fail.check(setup.warnings)
        return
    text, content = _terms(robot, read, of, options, output)
    result.show(text, content, output, robot=robot.name)


def _check_usage(output: Path | None, terms: bool) -> None:
    """Raise BadParameter for options that need --terms, and another suffix of the output."""
    if not terms:
        refuse("it needs --terms", "of", "output")
    elif output is not None:
        check_suffix(output, (".toml",), "--output")


def _terms(
    robot: seaid.Robot,
    logs: Sequence[seaid.Log],
    joints: Sequence[str] | None,
    options: LogOptions,
    output: Path | None,
) -> Section:
    """Return which terms the logs support, and write the drives with those."""
    selection = seaid.compare_terms(
        robot,
        logs,
        joints=joints,
        torque_joints=options.torque_joints,
        cutoff_hz=options.cutoff_hz,
        progress=is_terminal(),
    )
    if output is not None:
        seaid.write_drives(selection.robot.drives, output)
    names = ("recommended", "comparisons")
    return str(selection), {name: getattr(selection, name) for name in names}
