"""Command replay: the log forward in time, by the nominal and by the identified model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from seaid.cli.messages import written
from seaid.cli.options import (
    FailOn,
    IdentifiedOptions,
    ResultOptions,
    check_fail_on,
    checked_suffix,
    facts_of,
    fail_on_warnings,
)


def replay(
    options: IdentifiedOptions,
    log: Annotated[Path, Argument(help="The log to replay; best an unseen one.", metavar="LOG")],
    *,
    nominal: Annotated[
        Path | None,
        Option(
            help="Nominal model: drives (.toml) or robot (.urdf, MuJoCo .xml); default: that given."
        ),
    ] = None,
    output: Annotated[
        Path | None, Option("--output", "-o", help="A report with the replay.", metavar="HTML")
    ] = None,
    fail_on: FailOn = None,
    result: ResultOptions,
) -> None:
    """Replay a log by the nominal and by the identified model, and compare their errors.

    From the first state of the log on only its motor inputs enter: torques, or position commands
    through the controllers of the drives. Without values in the files the nominal model has no
    friction, rotor inertia and delay. A MuJoCo model brings its bodies, armature, damping and
    friction loss. An identified model that replays the log worse is a warning.

    seaid replay other.csv --run runs/latest
    seaid replay go2.csv@19:24 --run runs/latest --nominal go2.xml -o replay.html
    seaid replay leg.urdf other.csv --from run.csv --drives leg.toml
    """
    from seaid.report import write_report
    from seaid.robot import nominal_model
    from seaid.simulation import compare_replays

    check_fail_on(fail_on)
    checked_suffix(output, ".html", ".htm")
    result.check(output, read=(*options.files, log, nominal))
    run = options.result()
    fit = run.identification
    before = fit.known if nominal is None else nominal_model(nominal, fit.known)
    (unseen,) = options.logs([log], fit.known)
    moved = compare_replays(before, fit.robot, unseen, fit.unusable_joints)
    if output is not None:
        with written(output, ".html") as file:
            write_report(fit, file, list(run.validations.values()), replays=moved)
    facts = facts_of(fit, *run.validations.values(), moved)
    result.show(moved.summary(), {"log": str(log), **moved.to_dict()}, output, **facts)
    fail_on_warnings(moved.warnings, fail_on)
