"""Command terms: which further terms of the drives the logs support."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from seaid.cli.messages import is_terminal, written
from seaid.cli.options import LogOptions, Logs, ResultOptions, check_joints, names

if TYPE_CHECKING:
    from seaid.checks import TermComparison


def terms(
    options: LogOptions,
    logs: Logs,
    *,
    of: Annotated[
        str | None, Option(help="Joints whose terms are compared, as a,b,c; default: all.")
    ] = None,
    output: Annotated[
        Path | None, Option("--output", "-o", help="TOML with the drives and recommended terms.")
    ] = None,
    result: ResultOptions,
) -> None:
    """Compare which further terms of friction and springs the logs support.

    seaid terms leg.urdf run.csv --drives leg.toml -o leg_with_terms.toml
    seaid terms leg.urdf run.csv --drives leg.toml --of knee_pitch
    """
    from seaid.drives import write_drives
    from seaid.identification import compare_terms

    result.check(output, read=(*options.files, *logs))
    robot = options.robot(options.known_body)
    check_joints("--of", names(of), robot)
    selection = compare_terms(
        robot,
        options.logs(logs, robot),
        joints=names(of),
        torque_joints=names(options.torque_joints),
        cutoff_hz=options.cutoff_hz,
        progress=is_terminal(),
    )
    if output is not None:
        with written(output, ".toml") as file:
            write_drives(selection.robot.drives, file)
    content = {
        "recommended": selection.recommended,
        "comparisons": [_comparison_facts(comparison) for comparison in selection.comparisons],
    }
    result.show(str(selection), content, output, robot=robot.name)


def _comparison_facts(test: TermComparison) -> dict[str, object]:
    facts = {"joint": test.joint, "field": test.field, "term": test.term, "step": test.step + 1}
    facts |= {"cutoff_hz": test.cutoff_hz}
    facts |= {"supported": test.is_supported, "selected": test.selected, "reason": test.reason}
    return facts | {"significance": None if test.comparison is None else asdict(test.comparison)}
