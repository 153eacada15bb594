"""Command check: what is wrong with a set-up, before a fit."""

from __future__ import annotations

from seaid.cli.messages import show
from seaid.cli.options import AsJson, FailOn, LogOptions, Logs, check_fail_on, fail_on_warnings


def check(
    options: LogOptions,
    logs: Logs,
    *,
    fail_on: FailOn = None,
    as_json: AsJson = False,
) -> None:
    """Check units, signs, ratios, gravity and payloads of an experiment before a fit.

    seaid check leg.urdf run.csv --drives leg.toml
    seaid check arm.urdf a.csv b.csv --drives arm.toml --fail-on doubtful
    """
    from seaid.identification import check as checked

    check_fail_on(fail_on)
    robot = options.robot(options.known_body)
    setup_check = checked(robot, options.logs(logs, robot), cutoff_hz=options.cutoff_hz)
    facts = {"robot": robot.name, "warnings": setup_check.warnings}
    show(setup_check.summary(), {"joints": setup_check.joints}, as_json, **facts)
    fail_on_warnings(setup_check.warnings, fail_on)
