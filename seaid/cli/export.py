"""Command export: the identified robot as URDF or MuJoCo model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

from seaid.cli.defaults import is_typed
from seaid.cli.messages import is_stdout, note, option_of, written
from seaid.cli.options import (
    FEASIBLE,
    IdentifiedOptions,
    ResultOptions,
    checked_suffix,
    facts_of,
)

if TYPE_CHECKING:
    from seaid.robot import Robot


def export(
    given: IdentifiedOptions,
    *,
    output: Annotated[
        Path, Option("--output", "-o", help="File to write: .urdf, or .xml for MuJoCo.")
    ],
    parameters: Annotated[
        Path | None, Option(help="Parameters of seaid identify, used unchanged in place of --from.")
    ] = None,
    feasible: Annotated[bool, Option("--feasible/--as-estimated", help=FEASIBLE)] = True,
    allow_inconsistent: Annotated[
        bool, Option("--allow-inconsistent", help="Also write physically inconsistent bodies.")
    ] = False,
    at_temperature: Annotated[
        float | None,
        Option(help="Temperature of the motors [degC], for friction that depends on it."),
    ] = None,
    result: ResultOptions,
) -> None:
    """Write the identified robot as URDF or MuJoCo model.

    The bodies are physically consistent: with --from those nearest to the estimate; with --run and
    --parameters those of the run and the file, which needs identify --feasible. A URDF gets its
    drives as TOML next to it and keeps everything else (comments, meshes, unknown tags); payloads
    are not written. A MuJoCo model contains the springs and the payloads.

    seaid export leg.urdf --from run.csv --drives leg.toml -o found.urdf
    seaid export --run runs/latest -o found.xml
    seaid export leg.urdf --parameters parameters.json -o found.urdf
    seaid export leg.urdf --from run.csv --drives leg.toml -o found.xml
    """
    from seaid.report import warning_lines

    checked_suffix(output, *_WRITERS)
    if parameters is not None and is_typed("from_logs", "run"):
        raise typer.BadParameter("give one of them", param_hint="--from, --run, --parameters")
    toml = output.with_suffix(".toml") if output.suffix.lower() == ".urdf" else None
    result.check(output, toml, read=(*given.files, parameters))
    if parameters is not None:
        from seaid.export import read_parameters

        robot = read_parameters(parameters, given.robot(given.known_body or ()))
        facts: dict[str, Any] = {"robot": robot.name}
    else:
        found = given.result(feasible=feasible).identification
        robot, facts = found.robot, facts_of(found)
    kind = ".urdf" if is_stdout(output) else output.suffix.lower()
    with written(output, kind) as file:
        tables, notes = _WRITERS[kind](robot, file, allow_inconsistent, at_temperature)
    for text in notes:
        note(text.replace("payloads=", option_of("payloads=")))
    if is_stdout(output):
        tables = None
        note("stdout has the URDF without its drives: --output writes both")
    lines = [f"{robot.name}: {robot.n} bodies and their drives written"]
    lines += warning_lines(facts.get("warnings", ()))
    content = {"bodies": robot.body_names, "drives": [*robot.drives]}
    result.show("\n".join(lines), content, output, tables, **facts)


_Written = tuple[Path | None, tuple[str, ...]]


def _urdf(robot: Robot, output: Path, allow_inconsistent: bool, warmth: float | None) -> _Written:
    from seaid.export import write_urdf

    files = write_urdf(robot, output, force=allow_inconsistent, at_temperature_degC=warmth)
    return files.drives, files.notes


def _mjcf(robot: Robot, output: Path, allow_inconsistent: bool, warmth: float | None) -> _Written:
    from seaid.export import write_mjcf

    model = write_mjcf(robot, output, force=allow_inconsistent, at_temperature_degC=warmth)
    return None, model.notes


_WRITERS = {".urdf": _urdf, ".xml": _mjcf}
"""{suffix: what writes the robot, and returns the file of its drives, if any, and the notes}."""
