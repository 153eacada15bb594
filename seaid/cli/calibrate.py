"""Command calibrate: the law of a spring, or gain and offset of a torque sensor, from statics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from seaid.cli.defaults import is_typed
from seaid.cli.messages import written
from seaid.cli.options import ResultOptions, checked_suffix


def calibrate(
    table: Annotated[
        Path, Argument(help="Loads and readings (CSV), or a log with --urdf.", metavar="TABLE")
    ],
    *,
    law: Annotated[Literal["linear", "cubic"], Option(help="Law of the spring or sensor.")] = (
        "linear"
    ),
    urdf: Annotated[
        Path | None, Option(help="Robot of a log with held poses, its bodies known.")
    ] = None,
    drives: Annotated[Path | None, Option(help="Drives of that robot.")] = None,
    joint: Annotated[str | None, Option(help="Joint that is calibrated by a log.")] = None,
    sensor: Annotated[
        Literal["spring", "torque"], Option(help="What a log has of it: spring, or torque sensor.")
    ] = "spring",
    output: Annotated[
        Path | None, Option("--output", "-o", help="A page with the law.", metavar="HTML")
    ] = None,
    result: ResultOptions,
) -> None:
    """Calibrate a spring or a torque sensor by dead weights, ramps or held poses.

    The table has a column load_Nm (or load_N, or mass_kg and lever_m) and one of readings:
    deflection_rad (_mrad, _deg, _m, _mm) of a spring, or sensor_mV in any unit. Loads up and down
    separate friction from the law. With --urdf the dead weights are the bodies of the robot at the
    held poses of a log.

    seaid calibrate weights.csv -o weights.html
    seaid calibrate poses.csv --urdf leg.urdf --drives leg.toml --joint knee_pitch
    """
    from seaid.identification import calibrate_statics, held_poses, read_statics
    from seaid.report import write_calibration

    checked_suffix(output, ".html", ".htm")
    is_half = is_typed("urdf") if joint is None else urdf is None
    if is_half:
        raise typer.BadParameter("a log needs both", param_hint="--urdf, --joint")
    result.check(output, read=(table, *((urdf, drives) if joint is not None else ())))
    if urdf is None or joint is None:
        statics = read_statics(table)
    else:
        from seaid.log import read_log
        from seaid.robot import load_robot

        robot = load_robot(urdf, drives)
        statics = held_poses(robot, read_log(table, robot), joint, sensor=sensor)
    fit = calibrate_statics(statics, law=law)
    name = joint or table.stem
    if output is not None:
        with written(output, ".html") as file:
            write_calibration(fit, file, name=name)
    values = zip(fit.names, fit.values, fit.standard_errors, fit.units, strict=True)
    content = {
        "law": fit.law,
        "parameters": {
            parameter: {"value": float(value), "standard_error": float(error), "unit": unit}
            for parameter, value, error, unit in values
        },
        **{key: getattr(fit, key) for key in ("rms", "linearity", "hysteresis")},
        "warnings": fit.warnings,
    }
    result.show(fit.summary(), content, output, robot=joint)
