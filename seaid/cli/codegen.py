"""Command codegen: the regressor and the inverse dynamics of a robot as code."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from seaid.cli.messages import is_stdout, written
from seaid.cli.options import ResultOptions, RobotOptions, checked_suffix


def codegen(
    options: RobotOptions,
    *,
    output: Annotated[
        Path, Option("--output", "-o", help="File to write: .py, or .c; - for Python on stdout.")
    ],
    parameters: Annotated[
        Path | None,
        Option(help="Parameters of seaid identify, for the inverse dynamics; default: the URDF."),
    ] = None,
    result: ResultOptions,
) -> None:
    """Write the regressor and the inverse dynamics of a robot as Python or C.

    The inverse dynamics is that of the bodies and payloads: the torque of the joints without
    friction and rotor inertia. The regressor times the inertial parameters is the same without
    payloads, and the base regressor has the identifiable columns only. They are exact:
    no number is rounded but the lengths in the URDF. Python needs NumPy, C99 its <math.h>.

    seaid codegen leg.urdf -o leg_dynamics.py
    seaid codegen leg.urdf --parameters runs/latest/parameters.json -o leg_dynamics.c
    """
    from seaid.symbolic import export_c, export_numpy, rigid_body

    checked_suffix(output, ".py", ".c")
    result.check(output, read=(*options.files, parameters))
    robot = options.robot()
    if parameters is not None:
        from seaid.export import read_parameters

        robot = read_parameters(parameters, robot)
    form = rigid_body(robot)
    suffix = ".py" if is_stdout(output) else output.suffix.lower()
    with written(output, suffix) as file:
        (export_c if suffix == ".c" else export_numpy)(
            form, file, robot.parameters + robot.payload_parameters
        )
    content = {
        "joints": form.joint_names,
        "parameters": form.parameter_names,
        "base_parameters": form.base.expressions,
    }
    text = (
        f"{robot.name}: regressor of {len(form.parameter_names)} parameters and of "
        f"{len(form.base.expressions)} base parameters, and inverse dynamics, written"
    )
    result.show(text, content, output, robot=robot.name)
