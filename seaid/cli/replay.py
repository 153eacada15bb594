"""Command replay: the log forward in time, by the nominal and by the identified model."""

from __future__ import annotations

import seaid
from seaid.cli.kinds import LogFile, ModelFile, Page
from seaid.cli.options import FailOptions, IdentifiedOptions, ResultOptions, judgement_of


def replay(
    options: IdentifiedOptions,
    log: LogFile,
    *,
    nominal: ModelFile | None = None,
    output: Page | None = None,
    fail: FailOptions,
    result: ResultOptions,
) -> None:
    """Replay a log by the nominal and by the identified model, and compare their errors.

    The simulation starts in the first state of the log; after it only the motor inputs of the log
    enter: torques, or position commands through the controllers of the drives. Without values in
    the files the nominal model has no friction, rotor inertia and delay. A MuJoCo model brings its
    bodies, armature, damping and friction loss. An identified model that replays the log worse is a
    warning.

    Parameters
    ----------
    log
        The log to replay; best an unseen one.
    nominal
        Nominal model: drives (.toml) or robot (.urdf, MuJoCo .xml); default: the robot as it was
        before the identification.
    output
        HTML report with the replay.

    Examples
    --------
    seaid replay other.csv --run runs/latest
    seaid replay go2.csv@19:24 --run runs/latest --nominal go2.xml -o replay.html
    seaid replay leg.urdf other.csv --from run.csv --drives leg.toml
    """
    result.check(output, read=(*options.files, log, nominal))
    run = options.identified_run()
    fit = run.identification
    before = fit.known if nominal is None else seaid.robot.nominal_model(nominal, fit.known)
    (measured,) = options.logs([log], fit.known)
    comparison = seaid.compare_replays(before, fit.robot, measured, fit.unusable_joints)
    tests = [*run.validations.values()]
    if output is not None:
        seaid.write_report(fit, output, tests, replays=comparison)
    facts = judgement_of(fit, *tests, comparison)
    result.show(comparison.summary(), {"log": str(log), **comparison.to_dict()}, output, **facts)
    fail.check(comparison.warnings)
