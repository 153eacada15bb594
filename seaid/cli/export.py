"""Command export: the identified robot for a simulator, and its equations as code."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import seaid
from seaid._progress import counted
from seaid.cli.kinds import JsonFile, ModelFile, check_suffix
from seaid.cli.messages import note, option_of
from seaid.cli.options import IdentifiedOptions, ResultOptions, judgement_of, refuse
from seaid.cli.project import is_typed
from seaid.errors import SeaidError, by_severity, listed, unknown_name

CODE = {"python": ".py", "c": ".c"}
"""{format of code: its suffix}."""


def export(
    options: IdentifiedOptions,
    *,
    output: ModelFile,
    format: str | None = None,  # noqa: A002
    time_step: float = 0.005,
    parameters: JsonFile | None = None,
    as_estimated: bool = False,
    allow_inconsistent: bool = False,
    randomization: ModelFile | None = None,
    level: float = 0.95,
    samples: int = 100,
    at_temperature: float | None = None,
    result: ResultOptions,
) -> None:
    """Write the identified robot for a simulator: URDF, MuJoCo, Isaac Lab and others.

    The bodies are physically consistent: with --from those nearest to the estimate; with --run and
    --parameters those of the run and the file, which needs identify --feasible. A URDF gets its
    drives as TOML next to it and keeps everything else (comments, meshes, unknown tags); payloads
    are not written. A MuJoCo model contains the springs and the payloads. The other formats have
    the actuators of the joints; what a format cannot hold is a warning.

    A file that ends in .py or .c has the regressor and the inverse dynamics as code, of the URDF if
    nothing is identified: the torque of the joints without friction and rotor inertia, with the
    payloads. The regressor times the inertial parameters is the same without payloads, and the base
    regressor has the identifiable columns only. They are exact: no number is rounded but the
    lengths in the URDF. Python needs NumPy, C99 its <math.h>.

    Parameters
    ----------
    output
        File to write: .urdf, .xml for MuJoCo, .py or .c for code, or of --format.
    format
        mjcf, urdf, isaaclab, usd, newton or drake, or python or c for code; default: by the suffix.
    time_step
        Time step [s] of the simulation, in which delays are counted.
    parameters
        Parameters of seaid identify, used unchanged in place of --from.
    as_estimated
        The bodies as estimated, or physically consistent ones nearest to the estimate.
    allow_inconsistent
        Also write physically inconsistent bodies.
    randomization
        Also write ranges and samples for domain randomization, as .json.
    level
        Probability of the ranges.
    samples
        Number of samples next to the ranges.
    at_temperature
        Temperature of the motors [degC], for friction that depends on it.

    Examples
    --------
    seaid export leg.urdf --from run.csv --drives leg.toml -o found.urdf
    seaid export --run runs/latest -o found.xml
    seaid export leg.urdf --parameters parameters.json -o found.urdf
    seaid export leg.urdf --from run.csv --drives leg.toml -o found.xml
    seaid export --run runs/latest --format isaaclab -o actuators.py
    seaid export --run runs/latest -o found.xml --randomization ranges.json
    seaid export leg.urdf -o leg_dynamics.py
    seaid export leg.urdf --parameters runs/latest/parameters.json -o leg_dynamics.c
    """
    kind, suffix = _format(format, output)
    if parameters is not None:
        refuse("give one of them, or --parameters", "from_logs", "run")
        refuse("it needs --from or --run", "randomization")
    toml = output.with_suffix(".toml") if suffix == ".urdf" else None
    result.check(output, toml, randomization, read=(*options.files, parameters))
    robot, fit = _robot(options, parameters, feasible=not as_estimated, is_code=kind in CODE)
    if kind in CODE:
        result.show(*_write_code(robot, output, suffix), output, robot=robot.name)
        return
    form = cast("seaid.export.FormatName", kind)
    facts: dict[str, Any] = {"robot": robot.name} if fit is None else judgement_of(fit)
    ranges = None
    if fit is not None and randomization is not None:
        ranges = seaid.export.write_randomization(fit, randomization, level=level, samples=samples)
    model = seaid.write_model(
        robot,
        output,
        form,
        time_step_s=time_step,
        force=allow_inconsistent,
        at_temperature_degC=at_temperature,
    )
    for text in model.notes:
        note(text.replace("payloads=", option_of("payloads=")))
    facts["warnings"] = by_severity([*facts.get("warnings", ()), *model.warnings])
    lines = [*_lines(robot, form, ranges), *seaid.report.warning_lines(facts["warnings"])]
    content = {"bodies": robot.body_names, "drives": [*robot.drives]}
    result.show("\n".join(lines), content, output, model.drives, randomization, **facts)


def _format(name: str | None, output: Path) -> tuple[str, str]:
    """Return the format of an output, and its suffix; raise BadParameter for another suffix."""
    suffixes: dict[str, str] = {kind: entry.suffix for kind, entry in seaid.export.FORMATS.items()}
    suffixes |= CODE
    if name is not None and name not in suffixes:
        raise SeaidError(f"--format: {unknown_name('format', name, suffixes)}")
    by_code = {suffix: code for code, suffix in CODE.items()}
    kind = name or by_code.get(output.suffix.lower()) or seaid.export.by_suffix(output)
    allowed = [suffixes[kind]] if name else [".urdf", ".xml", ".usda", *by_code]
    check_suffix(output, allowed, "--output")
    return kind, suffixes[kind]


def _robot(
    options: IdentifiedOptions, parameters: Path | None, *, feasible: bool, is_code: bool
) -> tuple[seaid.Robot, seaid.Identification | None]:
    """Return the robot that is written, and the identification that it is of."""
    if parameters is not None:
        return seaid.read_parameters(parameters, options.robot()), None
    if is_code and options.run is None and not is_typed("from_logs"):
        return options.robot(), None
    fit = options.identified_run(feasible=feasible).identification
    return fit.robot, fit


def _write_code(robot: seaid.Robot, output: Path, suffix: str) -> tuple[str, dict[str, Any]]:
    """Write regressor and inverse dynamics as Python or C; return a text and JSON content."""
    form = seaid.symbolic.rigid_body(robot)
    write = seaid.symbolic.export_c if suffix == ".c" else seaid.symbolic.export_numpy
    parameters = robot.parameters + robot.payload_parameters
    write(form, output, parameters)
    content = {
        "joints": form.joint_names,
        "parameters": form.parameter_names,
        "base_parameters": form.base.expressions,
    }
    text = (
        f"{robot.name}: regressor of {counted(len(form.parameter_names), 'parameter')} and of "
        f"{counted(len(form.base.expressions), 'base parameter')}, and inverse dynamics, written"
    )
    return text, content


def _lines(
    robot: seaid.Robot, kind: seaid.export.FormatName, ranges: seaid.export.Randomization | None
) -> Iterator[str]:
    """Yield what was written, and what of the `ranges` is not determined."""
    if seaid.export.FORMATS[kind].has_bodies:
        yield f"{robot.name}: {counted(robot.n, 'body')} written, with the drives"
    else:
        actuators = counted(robot.n, "actuator")
        yield f"{robot.name}: {actuators} written for {seaid.export.FORMATS[kind].title}"
    if ranges is not None:
        free = listed(f"{parameter.name} of {parameter.of}" for parameter in ranges.unidentified)
        yield f"not determined by the log, and as wide as the prior: {free or 'none'}"
