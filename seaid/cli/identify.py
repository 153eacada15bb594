"""Command identify: from logs to parameters."""

from __future__ import annotations

from pathlib import Path

import seaid
from seaid.cli.kinds import LogFile, ModelFile
from seaid.cli.messages import is_terminal
from seaid.cli.options import (
    FailOptions,
    IdentifyOptions,
    ResultOptions,
    command_line,
    judgement_of,
    refuse,
)


def identify(
    options: IdentifyOptions,
    logs: tuple[LogFile, ...],
    *,
    in_pieces: bool = False,
    feasible: bool = False,
    refine: bool = False,
    verbose: bool = False,
    output: ModelFile = Path("parameters.json"),
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
    start is kept if it predicts the logs better. Several conditions, such as cold and warm, are
    identified together by a project file with the condition of each log.

    Parameters
    ----------
    in_pieces
        Read logs with the column names of seaid in pieces: they may be larger than memory.
    refine
        Refine to the maximum-likelihood estimate of both sides at once; needs joints with springs.

    Examples
    --------
    seaid identify leg.urdf run.csv --drives leg.toml --payload foot:2.0:0.15,0,0
    seaid identify arm.urdf a.csv b.csv --drives arm.toml --method simultaneous -o arm.json
    seaid identify arm.urdf bag/ --description arm_log.toml --estimator huber
    seaid identify leg.urdf run.csv --drives leg.toml -o leg.npz
    seaid identify arm.urdf day.parquet --drives arm.toml --in-pieces
    seaid identify leg.urdf run.csv --drives leg.toml --refine --encoder-offset-std 0.01
    """
    if options.repair or options.description or options.find_contacts:
        changes = "no --repair, no --description, no --find-contacts"
        refuse(f"logs that are read in pieces are not changed: {changes}", "in_pieces")
    if refine:
        refuse("it is no option of --refine", "feasible", "in_pieces")
    robot = options.robot()
    result.check(output, read=(*options.files, *logs))
    read = [] if in_pieces else options.logs(logs, robot)
    choices = {"feasible": feasible and not refine, **options.keywords()}
    fit = seaid.identify(robot, read or logs, **choices)
    if refine:
        std = options.encoder_offset_std
        fit = seaid.refine(fit, read, encoder_offset_std=std, progress=is_terminal())
    if output.suffix == ".npz":
        more = {"in_pieces": in_pieces, "feasible": choices["feasible"], "refine": refine}
        recorded = options.recorded(logs, **more)
        origin = seaid.report.provenance_of((*options.files, *logs), recorded, command_line())
        seaid.project.save_run(fit, output, provenance=origin)
    else:
        seaid.write_parameters(fit, output)
    text = seaid.report.short_text(fit, robot, verbose)
    result.show(text, seaid.export.content_of(fit), output, **judgement_of(fit))
    fail.check(fit.warnings)
