"""Command codegen: the regressor of a robot as code."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from seaid.cli.messages import is_stdout, written
from seaid.cli.options import ResultOptions, RobotOptions, checked_suffix


def codegen(
    given: RobotOptions,
    *,
    output: Annotated[
        Path, Option("--output", "-o", help="File to write: .py, or .c; - for Python on stdout.")
    ],
    result: ResultOptions,
) -> None:
    """Write the regressor of a robot as one file of Python or C.

    The regressor times the inertial parameters is the inverse dynamics of the bodies, without
    friction and rotor inertia; the base regressor has the identifiable columns only. It is exact:
    no number of it is rounded but the lengths in the URDF. Python needs NumPy, C99 its <math.h>.

    seaid codegen leg.urdf -o leg_regressor.py
    seaid codegen arm.urdf --joints shoulder,elbow -o arm_regressor.c
    """
    from seaid.symbolic import export_c, export_numpy, rigid_body

    checked_suffix(output, ".py", ".c")
    result.check(output, read=given.files)
    robot = given.robot()
    form = rigid_body(robot)
    suffix = ".py" if is_stdout(output) else output.suffix.lower()
    with written(output, suffix) as file:
        (export_c if suffix == ".c" else export_numpy)(form, file)
    content = {
        "joints": form.joint_names,
        "parameters": form.parameter_names,
        "base_parameters": form.base.expressions,
    }
    text = (
        f"{robot.name}: regressor of {len(form.parameter_names)} parameters and of "
        f"{len(form.base.expressions)} base parameters written"
    )
    result.show(text, content, output, robot=robot.name)
