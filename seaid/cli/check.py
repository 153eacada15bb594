"""Command check: what is wrong with a set-up before a fit, and what logs determine of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

import seaid
from seaid.cli.kinds import JointNames, Kind, LogFile
from seaid.cli.messages import is_stdout, is_terminal, written
from seaid.cli.options import FailOptions, LogOptions, ResultOptions, check_joints, refuse
from seaid.errors import LogError

Section = tuple[str, dict[str, Any]]
"""A part of the result: its text, and its content as JSON."""


def check(
    options: LogOptions,
    logs: list[LogFile],
    *,
    delays: bool = False,
    largest_s: float = 0.03,
    gear_ratios: bool = False,
    terms: bool = False,
    of: JointNames | None = None,
    output: Annotated[Path, Kind("FILE")] | None = None,
    fail: FailOptions,
    result: ResultOptions,
) -> None:
    """Check units, signs, ratios, gravity and payloads of an experiment before a fit.

    With --delays, --gear-ratios or --terms it estimates these instead. Delays are those between
    channels of a joint that measure the same: both encoders, and torques with the motion; delay_s
    in the description of the log corrects them. Gear ratios come from the angles on both sides of
    the gears, each log with its own encoder offsets; behind a spring without a measured deflection
    they come from the motor equation. Terms are further ones of friction and springs that the logs
    support.

    Parameters
    ----------
    delays
        Estimate by how much the channels of a log are late or early.
    largest_s
        Largest delay of the search [s].
    gear_ratios
        Estimate the gear ratios, as lines for the drives file.
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
    seaid check leg.urdf run.csv --drives leg.toml --gear-ratios
    seaid check leg.urdf run.csv --drives leg.toml --terms -o leg_with_terms.toml
    """
    if sum((delays, gear_ratios, terms)) > 1:
        raise typer.BadParameter("give one of them", param_hint="--delays, --gear-ratios, --terms")
    _check_output(output, delays, terms)
    if not delays:
        refuse("it needs --delays", "largest_s")
    if not terms:
        refuse("it needs --terms", "of")
    result.check(output, read=(*options.files, *logs))
    robot = options.robot()
    check_joints("--of", of, robot)
    read = options.logs(logs, robot)
    if not (delays or gear_ratios or terms):
        setup = seaid.check(robot, read, cutoff_hz=options.cutoff_hz)
        facts = {"robot": robot.name, "warnings": setup.warnings}
        result.show(setup.summary(), {"joints": setup.joints}, **facts)
        fail.check(setup.warnings)
        return
    if delays:
        text, content = _delays(robot, read, largest_s, options.cutoff_hz, output)
    elif gear_ratios:
        text, content = _gear_ratios(robot, read)
    else:
        text, content = _terms(robot, read, of, options, output)
    result.show(text, content, output, robot=robot.name)


def _check_output(output: Path | None, delays: bool, terms: bool) -> None:
    """Raise BadParameter for an output that the command does not write."""
    if output is None:
        return
    if not (delays or terms):
        raise typer.BadParameter("it needs --delays or --terms", param_hint="--output")
    allowed = seaid.log.WRITTEN if delays else (".toml",)
    if not is_stdout(output) and output.suffix.lower() not in allowed:
        message = f"'{output}' must end in {' or '.join(allowed)}"
        raise typer.BadParameter(message, param_hint="--output")


def _delays(
    robot: seaid.Robot,
    logs: Sequence[seaid.Log],
    largest_s: float,
    cutoff_hz: float | None,
    output: Path | None,
) -> Section:
    """Return the delays in a log, and write the log without those that are significant."""
    if len(logs) > 1:
        raise typer.BadParameter("give one log: its delays are its own", param_hint="--delays")
    (log,) = logs
    delays = seaid.estimate_delays(robot, log, largest_s=largest_s, cutoff_hz=cutoff_hz)
    written(output, ".csv", lambda file: seaid.write_log(seaid.correct_delays(log, delays), file))
    content = [{**asdict(delay), "is_significant": delay.is_significant} for delay in delays]
    lines = [str(delay) for delay in delays] or ["no channel is redundant with others of its joint"]
    return "\n".join(lines), {"delays": content}


def _gear_ratios(robot: seaid.Robot, logs: Sequence[seaid.Log]) -> Section:
    """Return the gear ratios as a table with lines for the drives file; LogError without any."""
    from seaid._files import toml_table

    fits = {joint: _gear_fit(robot, logs, joint) for joint in robot.joint_names}
    header = ["joint", "ratio", "std. error", "by the drives", "misfit", "unit"]
    keys = ("ratio", "standard_error", "of_drives", "misfit")
    rows, lines = [], []
    for joint, fit in fits.items():
        if "reason" not in fit:
            values = ("-" if fit[key] is None else f"{fit[key]:.6g}" for key in keys)
            rows.append([joint, *values, fit["unit"]])
            key = "gear_ratio" if fit["unit"] == "rad/rad" else "gear_ratio_rad_per_m"
            lines.append(f"{toml_table(joint)}\n{key} = {fit['ratio']:.7g}")
            lines.append(f"{key}_std = {fit['standard_error']:.2g}")
    reasons = [f"{joint}: {fit['reason']}" for joint, fit in fits.items() if "reason" in fit]
    if not rows:
        raise LogError(f"no gear ratio is determined: {'; '.join(reasons)}")
    table = seaid.report.table("Motor motion per motion behind the gear", header, rows)
    return "\n".join([table, *reasons, "\nin the drives file:", *lines]), {"joints": fits}


def _gear_fit(robot: seaid.Robot, logs: Sequence[seaid.Log], joint: str) -> dict[str, Any]:
    """Return the ratio of a joint, or the reason why there is none."""
    try:
        value, error, misfit = _gear_ratio(robot, logs, joint)
    except LogError as problem:
        return {"reason": str(problem).removeprefix("gear_ratio: ")}
    drive = robot.drives[joint]
    # The ratio of a spring is to the angle of its pulley, also where the joint slides.
    is_linear = robot.is_prismatic[robot.index(joint)] and not drive.is_elastic
    return {
        "ratio": value,
        "standard_error": error,
        "of_drives": drive.ratio,
        "misfit": misfit,
        "unit": "rad/m" if is_linear else "rad/rad",
    }


def _gear_ratio(
    robot: seaid.Robot, logs: Sequence[seaid.Log], joint: str
) -> tuple[float, float, float | None]:
    """Return ratio, standard error and misfit [rad]; raise LogError if it is not determined."""
    import numpy as np

    drive, index = robot.drives[joint], robot.index(joint)
    if np.count_nonzero(robot.transmission[index]) > 1:
        raise LogError("its motor turns several joints")
    columns = [(log, log.joint_names.index(joint)) for log in logs]
    behind = [log.joint_position[:, column] for log, column in columns]
    if drive.is_elastic:
        unknown = np.array(np.nan)
        stretch = [x.deflection[:, j] if x.deflection is not None else unknown for x, j in columns]
        if not all(np.isfinite(deflection).all() for deflection in stretch):
            # The spring lies between the encoders: its torque explains the deflection by (7).
            fit = seaid.check(robot, [*logs]).joints[joint]
            if not np.isfinite(fit.gear_ratio):
                reason = "its spring lies between the encoders; log deflection or motor torque"
                raise LogError(reason)
            return fit.gear_ratio, fit.gear_ratio_error, None
        # d = r_M/(N r_L) theta_M - q by (3), so that r_L/r_M (q + d) = theta_M/N.
        behind = [angle + deflection for angle, deflection in zip(behind, stretch, strict=True)]
    lever = drive.load_radius / drive.motor_radius  # r_L/r_M theta_L is the angle behind the gear
    motor = [log.motor_position[:, column] for log, column in columns]
    if not all(np.isfinite(angle).all() for angle in (*motor, *behind)):
        raise LogError("a log has not both of its encoders")
    ratio = seaid.gear_ratio(motor, [lever * angle for angle in behind])
    return ratio.value, ratio.standard_error, ratio.misfit_rad


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
    written(output, ".toml", lambda file: seaid.write_drives(selection.robot.drives, file))
    comparisons = [_comparison_facts(comparison) for comparison in selection.comparisons]
    return str(selection), {"recommended": selection.recommended, "comparisons": comparisons}


def _comparison_facts(test: seaid.checks.TermComparison) -> dict[str, object]:
    names = ("joint", "field", "term", "cutoff_hz", "selected", "reason")
    return {
        **{name: getattr(test, name) for name in names},
        "step": test.step + 1,
        "supported": test.is_supported,
        "significance": None if test.comparison is None else asdict(test.comparison),
    }
