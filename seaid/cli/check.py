"""Command check: what is wrong with a set-up before a fit, and what logs determine of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
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
    delays: bool = False,
    terms: bool = False,
    of: Names | None = None,
    output: ModelFile | None = None,
    fail: FailOptions,
    result: ResultOptions,
) -> None:
    """Check units, signs, ratios, gravity and payloads of an experiment before a fit.

    The gear ratio of each joint comes from the angles on both sides of its gear, each log with its
    own encoder offsets, and behind a spring from the motor equation too. With --delays or --terms
    the command estimates these instead. Delays are those between channels of a joint that measure
    the same: both encoders, and torques with the motion; delay_s in the description of the log
    corrects them. Terms are further ones of friction and springs that the logs support.

    Parameters
    ----------
    delays
        Estimate by how much the channels of a log are late or early.
    terms
        Compare which further terms of friction and springs the logs support.
    of
        Joints whose terms are compared, as a,b,c; default: all.
    output
        With --delays the log with significant delays corrected, with --terms the drives with the
        recommended terms.

    Examples
    --------
    seaid check leg.urdf run.csv --drives leg.toml
    seaid check arm.urdf a.csv b.csv --drives arm.toml --fail-on doubtful
    seaid check leg.urdf run.csv --drives leg.toml --delays -o corrected.csv
    seaid check leg.urdf run.csv --drives leg.toml --terms -o leg_with_terms.toml
    """
    _check_usage(output, delays, terms)
    result.check(output, read=(*options.files, *logs))
    robot = options.robot()
    check_joints("--of", of, robot)
    read = options.logs(logs, robot)
    if not (delays or terms):
        setup = seaid.check(robot, read, cutoff_hz=options.cutoff_hz)
        facts = {"robot": robot.name, "warnings": setup.warnings}
        result.show(setup.summary(), {"joints": setup.joints}, **facts)
        fail.check(setup.warnings)
        return
    if delays:
        text, content = _delays(robot, read, options.cutoff_hz, output)
    else:
        text, content = _terms(robot, read, of, options, output)
    result.show(text, content, output, robot=robot.name)


def _check_usage(output: Path | None, delays: bool, terms: bool) -> None:
    """Raise BadParameter for options that do not go together, and another suffix of the output."""
    if delays and terms:
        refuse("give one of them", "delays", "terms")
    if not terms:
        refuse("it needs --terms", "of")
    if not (delays or terms):
        refuse("it needs --delays or --terms", "output")
    elif output is not None:
        check_suffix(output, seaid.log.WRITTEN if delays else (".toml",), "--output")


def _delays(
    robot: seaid.Robot,
    logs: Sequence[seaid.Log],
    cutoff_hz: float | None,
    output: Path | None,
) -> Section:
    """Return the delays in a log, and write the log without those that are significant."""
    if len(logs) > 1:
        refuse("give one log: its delays are its own", "delays")
    log, package = logs[0], seaid.identification
    delays = package.estimate_delays(robot, log, cutoff_hz=cutoff_hz)
    if output is not None:
        seaid.write_log(package.correct_delays(log, delays), output)
    content = [{**asdict(delay), "is_significant": delay.is_significant} for delay in delays]
    lines = [str(delay) for delay in delays] or ["no channel is redundant with others of its joint"]
    return "\n".join(lines), {"delays": content}


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
