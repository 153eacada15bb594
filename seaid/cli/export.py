"""Command export: the identified robot for a simulator."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer
from typer import Option

import seaid
from seaid.cli.defaults import is_typed
from seaid.cli.messages import is_stdout, note, option_of, written
from seaid.cli.options import (
    FEASIBLE,
    IdentifiedOptions,
    ResultOptions,
    checked_suffix,
    facts_of,
    one_of,
)

if TYPE_CHECKING:
    from seaid.export import FormatName, Randomization
    from seaid.robot import Robot


def export(
    options: IdentifiedOptions,
    *,
    output: Annotated[
        Path,
        Option("--output", "-o", help="File to write: .urdf, .xml for MuJoCo, or of --format."),
    ],
    format: Annotated[  # noqa: A002
        str | None,
        one_of(
            "format",
            "mjcf, urdf, isaaclab, mjlab, usd, newton, bam, drake or ros2_control; "
            "default: mjcf for .xml, urdf for .urdf.",
            lambda: seaid.export.FormatName,
        ),
    ] = None,
    time_step: Annotated[
        float, Option(help="Time step [s] of the simulation, in which delays are counted.")
    ] = 0.005,
    parameters: Annotated[
        Path | None, Option(help="Parameters of seaid identify, used unchanged in place of --from.")
    ] = None,
    feasible: Annotated[bool, Option("--feasible/--as-estimated", help=FEASIBLE)] = True,
    allow_inconsistent: Annotated[
        bool, Option("--allow-inconsistent", help="Also write physically inconsistent bodies.")
    ] = False,
    randomization: Annotated[
        Path | None,
        Option(help="Also write ranges and samples for domain randomization: .json or .yaml."),
    ] = None,
    level: Annotated[float, Option(help="Probability of the ranges.")] = 0.95,
    samples: Annotated[int, Option(help="Number of samples next to the ranges.")] = 100,
    at_temperature: Annotated[
        float | None,
        Option(help="Temperature of the motors [degC], for friction that depends on it."),
    ] = None,
    result: ResultOptions,
) -> None:
    """Write the identified robot for a simulator: URDF, MuJoCo, Isaac Lab and others.

    The bodies are physically consistent: with --from those nearest to the estimate; with --run and
    --parameters those of the run and the file, which needs identify --feasible. A URDF gets its
    drives as TOML next to it and keeps everything else (comments, meshes, unknown tags); payloads
    are not written. A MuJoCo model contains the springs and the payloads. The other formats have
    the actuators of the joints; what a format cannot hold is a warning.

    seaid export leg.urdf --from run.csv --drives leg.toml -o found.urdf
    seaid export --run runs/latest -o found.xml
    seaid export leg.urdf --parameters parameters.json -o found.urdf
    seaid export leg.urdf --from run.csv --drives leg.toml -o found.xml
    seaid export --run runs/latest --format isaaclab -o actuators.py
    seaid export --run runs/latest -o found.xml --randomization ranges.json
    """
    from seaid.errors import by_severity
    from seaid.export import FORMATS, by_suffix, read_parameters, write_model, write_randomization
    from seaid.report import warning_lines

    kind = cast("FormatName", format) or by_suffix(output)
    suffix = FORMATS[kind].suffix
    checked_suffix(output, *([suffix] if format else [".urdf", ".xml", ".usda"]))
    if parameters is not None and is_typed("from_logs", "run"):
        raise typer.BadParameter("give one of them", param_hint="--from, --run, --parameters")
    toml = output.with_suffix(".toml") if suffix == ".urdf" else None
    result.check(output, toml, randomization, read=(*options.files, parameters))
    ranges = None
    if parameters is not None:
        if randomization is not None:
            raise typer.BadParameter("needs --from or --run", param_hint="--randomization")
        robot = read_parameters(parameters, options.robot(options.known_body))
        facts: dict[str, Any] = {"robot": robot.name}
    else:
        fit = options.result(feasible=feasible).identification
        robot, facts = fit.robot, facts_of(fit)
        if randomization is not None:
            ranges = write_randomization(fit, randomization, level=level, samples=samples)
    with written(output, suffix) as file:
        model = write_model(
            robot,
            file,
            kind,
            time_step_s=time_step,
            force=allow_inconsistent,
            at_temperature_degC=at_temperature,
        )
    for text in model.notes:
        note(text.replace("payloads=", option_of("payloads=")))
    tables = model.drives
    if is_stdout(output) and tables is not None:
        tables = None
        note("stdout has the URDF without its drives: --output writes both")
    facts["warnings"] = by_severity([*facts.get("warnings", ()), *model.warnings])
    lines = [*_lines(robot, kind, ranges), *warning_lines(facts["warnings"])]
    content = {"bodies": robot.body_names, "drives": [*robot.drives]}
    result.show("\n".join(lines), content, output, tables, randomization, **facts)


def _lines(robot: Robot, kind: FormatName, ranges: Randomization | None) -> Iterator[str]:
    """Yield what was written, and what of the `ranges` is not determined."""
    from seaid.errors import listed
    from seaid.export import FORMATS

    if FORMATS[kind].has_bodies:
        yield f"{robot.name}: {robot.n} bodies and their drives written"
    else:
        yield f"{robot.name}: {robot.n} actuators written for {FORMATS[kind].title}"
    if ranges is not None:
        free = listed(f"{parameter.name} of {parameter.of}" for parameter in ranges.unidentified)
        yield f"not determined by the log, and as wide as the prior: {free or 'none'}"
