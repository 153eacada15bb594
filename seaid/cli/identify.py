"""Command identify: from logs to parameters, of one condition or of several together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import typer

import seaid
from seaid.cli import kinds
from seaid.cli.kinds import check_log_files
from seaid.cli.messages import is_terminal, written
from seaid.cli.options import (
    FailOptions,
    IdentifyOptions,
    ResultOptions,
    command_line,
    judgement_of,
    refuse,
)
from seaid.cli.project import is_typed
from seaid.errors import by_severity


def identify(
    options: IdentifyOptions,
    logs: list[kinds.LogFile],
    *,
    in_pieces: bool = False,
    feasible: bool = False,
    refine: bool = False,
    iterations: int = 20,
    run: kinds.RunFile | None = None,
    condition: list[kinds.Condition] | None = None,
    specific: kinds.Names | None = None,
    condition_payload: list[kinds.ConditionPayload] | None = None,
    verbose: bool = False,
    output: Annotated[Path, kinds.Kind("FILE")] = Path("parameters.json"),
    fail: FailOptions,
    result: ResultOptions,
) -> None:
    """Identify drives and bodies from one log or several.

    Of the files only geometry, ratios, radii, rotor inertias and the parameters named as known are
    used; other numbers are nominal. The first line says whether to use the result. Then follow the
    warnings with their remedies ('!' wrong, '?' doubtful, '-' for information), the drives with
    their nominal values, and how much of the torque of each joint is unexplained. An output
    that ends in .npz is the whole result, for --run of other commands.

    With --refine output error continues to the maximum-likelihood estimate of both sides: it
    simulates the joints behind springs, and fits encoders and torques at once. The result of the
    start is kept if it predicts the logs better.

    With --condition several conditions, such as cold and warm, are identified together. Parameters
    that are not specific to a condition are shared, and rest on the logs of all conditions. A test
    says which of the specific ones differ.

    Parameters
    ----------
    in_pieces
        Read logs with the column names of seaid in pieces: they may be larger than memory.
    refine
        Refine to the maximum-likelihood estimate of both sides at once; needs joints with springs.
    iterations
        Iteration limit of Gauss-Newton of --refine.
    run
        Saved run from which --refine starts, in place of URDF and a first identification.
    condition
        Name and log of a condition, in place of logs.
    specific
        Parameters estimated per condition, as viscous_friction,spring_offset of knee; 'bodies' for
        the base parameters; '' for none. Default: the offsets of springs.
    condition_payload
        Payload that one condition has besides those of --payload.
    output
        File for the result; - for stdout. With --condition none by default.

    Examples
    --------
    seaid identify leg.urdf run.csv --drives leg.toml --payload foot:2.0:0.15,0,0
    seaid identify arm.urdf a.csv b.csv --drives arm.toml --method simultaneous -o arm.json
    seaid identify arm.urdf bag/ --description arm_log.toml --estimator huber
    seaid identify leg.urdf run.csv --drives leg.toml -o leg.npz
    seaid identify arm.urdf day.parquet --drives arm.toml --in-pieces
    seaid identify leg.urdf run.csv --drives leg.toml --refine --encoder-offset-std 0.01
    seaid identify run.csv --run runs/latest --refine
    seaid identify leg.urdf --condition cold=a.csv --condition warm=b.csv --drives leg.toml \
--specific viscous_friction
    seaid identify leg.urdf --condition bare=a.csv --condition loaded=b.csv --drives leg.toml \
--condition-payload loaded=foot:2.0:0.15,0,0 --specific ""
    """
    _check_usage(options, in_pieces, refine)
    if condition:
        _refuse_in_conditions(logs, output)
        file = output if is_typed("output") else None
        loads = condition_payload or ()
        fail.check(_identify_conditions(options, condition, specific, loads, file, result))
        return
    refuse("it needs --condition", "specific", "condition_payload")
    result.check(output, read=(*options.files, *logs))
    if refine:
        robot, fit, recorded = _refined(options, logs, iterations, run)
    else:
        robot = options.robot()
        read = logs if in_pieces else options.logs(logs, robot)
        fit = seaid.identify(robot, read, feasible=feasible, **options.keywords())
        recorded = options.recorded(logs, in_pieces=in_pieces, feasible=feasible)
    if output.suffix == ".npz":
        files = (*options.files, *logs)
        origin = seaid.project.provenance_of(files, recorded, command_line())
        seaid.project.save_run(fit, output, provenance=origin)
    else:
        written(output, ".json", lambda file: seaid.write_parameters(fit, file))
    text = seaid.report.short_text(fit, robot, verbose)
    result.show(text, seaid.export.content_of(fit), output, **judgement_of(fit))
    fail.check(fit.warnings)


def _refined(
    options: IdentifyOptions, logs: Sequence[Path], iterations: int, run: Path | None
) -> tuple[seaid.Robot, seaid.Identification, dict[str, Any]]:
    """Return the robot as it was known, its refined identification, and the options of both."""
    start = options.saved(run, "logs")
    robot = options.robot() if start is None else start.identification.known
    read = options.logs(logs, robot)
    recorded = options.recorded(logs, refine=True, iterations=iterations, run=run)
    if start is None:
        fit = seaid.identify(robot, read, **options.keywords())
    else:
        fit = start.identification
        # How the start was identified is in its run; the refinement has only these options.
        of_refinement = ("logs", "run", "encoder_offset_std", "refine", "iterations")
        kept = {name: recorded[name] for name in of_refinement}
        recorded |= {**start.provenance.get("options", {}), **kept}
    std, progress = options.encoder_offset_std, is_terminal()
    fit = seaid.refine(fit, read, encoder_offset_std=std, iterations=iterations, progress=progress)
    return robot, fit, recorded


def _check_usage(options: IdentifyOptions, in_pieces: bool, refine: bool) -> None:
    """Raise BadParameter for options that do not go together."""
    if in_pieces and (options.repair or options.description or options.find_contacts):
        changes = "no --repair, no --description, no --find-contacts"
        refuse(f"logs that are read in pieces are not changed: {changes}", "in_pieces")
    if refine:
        refuse("it is no option of --refine", "feasible", "in_pieces", "condition")
    else:
        refuse("it needs --refine", "iterations", "run")


def _refuse_in_conditions(logs: Sequence[Path], output: Path) -> None:
    """Raise BadParameter for what does not go with --condition."""
    names = ("method", "estimator", "known_std", "in_pieces", "feasible", "verbose")
    refuse("it does not go with --condition", *names)
    if logs:
        raise typer.BadParameter("the logs are those of --condition", param_hint="LOG")
    if output.suffix == ".npz":
        refuse("conditions are written as JSON", "output")


def _identify_conditions(
    options: IdentifyOptions,
    condition: Sequence[tuple[str, str]],
    specific: Sequence[str] | None,
    payloads: Sequence[tuple[str, seaid.Payload]],
    output: Path | None,
    result: ResultOptions,
) -> tuple[Any, ...]:
    """Identify the robot in several conditions, print and write the results; return findings."""
    from seaid._files import write_json
    from seaid.identification.conditions import CONDITION_SPECIFIC

    logs: dict[str, list[Path]] = {}
    for name, log in condition:
        logs.setdefault(name, []).append(Path(log))
    _check_conditions(logs, payloads)
    every = [*chain(*logs.values())]
    check_log_files(every, options.description)
    result.check(output, read=(*options.files, *every))
    robots = {name: _robot_in(options, name, payloads) for name in logs}
    names = ("torque_joints", "cutoff_hz", "encoder_offset_std")
    fits = seaid.identify_conditions(
        {name: (robot, options.logs(logs[name], robot)) for name, robot in robots.items()},
        condition_specific=CONDITION_SPECIFIC if specific is None else specific,
        progress=is_terminal(),
        **{name: getattr(options, name) for name in names},
    )
    content = {
        "conditions": {
            name: seaid.export.content_of(fit) for name, fit in fits.identifications.items()
        },
        "differences": [
            {"parameter": str(name), "differs": test.bic > 0, **asdict(test)}
            for name, test in fits.differences.items()
        ],
    }
    written(output, ".json", lambda file: write_json(file, content))
    findings = chain(*(fit.warnings for fit in fits.identifications.values()))
    robot, warnings = next(iter(robots.values())).name, by_severity(dict.fromkeys(findings))
    result.show(fits.summary(), content, output, robot=robot, warnings=warnings)
    return warnings


def _robot_in(
    options: IdentifyOptions, condition: str, payloads: Sequence[tuple[str, seaid.Payload]]
) -> seaid.Robot:
    """Return the robot of the line with the payloads of a condition."""
    loads = [payload for name, payload in payloads if name == condition]
    return replace(options, payload=[*(options.payload or ()), *loads]).robot()


def _check_conditions(
    logs: Mapping[str, Sequence[Path]], payloads: Sequence[tuple[str, seaid.Payload]]
) -> None:
    """Raise BadParameter for fewer than two conditions, and payloads of others."""
    names = ", ".join(logs)
    if len(logs) < 2:
        another = "add one, as --condition warm=run.csv"
        refuse(f"it takes two conditions at least, found {names}: {another}", "condition")
    for name, _ in payloads:
        if name not in logs:
            refuse(f"'{name}' is no condition: they are {names}", "condition_payload")
