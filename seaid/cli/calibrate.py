"""Command calibrate: the law of a spring, or gain and offset of a torque sensor, from statics."""

from __future__ import annotations

from typing import Literal

import click

import seaid
from seaid.cli.kinds import TableFile, TomlFile, UrdfFile
from seaid.cli.options import JsonOptions


def calibrate(
    table: TableFile,
    *,
    law: Literal["linear", "cubic"] = "linear",
    urdf: UrdfFile | None = None,
    drives: TomlFile | None = None,
    joint: str | None = None,
    sensor: Literal["spring", "torque"] = "spring",
    result: JsonOptions,
) -> None:
    """Calibrate a spring or a torque sensor by dead weights, ramps or held poses.

    The table has a column load_Nm (or load_N, or mass_kg and lever_m) and one of readings:
    deflection_rad (_mrad, _deg, _m, _mm) of a spring, or sensor_mV in any unit. Loads up and down
    separate friction from the law. With --urdf the dead weights are the bodies of the robot at the
    held poses of a log.

    Parameters
    ----------
    table
        Loads and readings (CSV), or a log with --urdf.
    law
        Law of the spring or sensor: linear or cubic.
    urdf
        Robot of a log with held poses, its bodies known.
    drives
        Drives of that robot.
    joint
        Joint that is calibrated by a log.
    sensor
        What a log has of it: spring, or torque sensor.

    Examples
    --------
    seaid calibrate weights.csv
    seaid calibrate poses.csv --urdf leg.urdf --drives leg.toml --joint knee_pitch
    """
    if (urdf is None) != (joint is None):
        raise click.BadParameter("a log needs both", param_hint="--urdf, --joint")
    if urdf is None or joint is None:
        statics = seaid.identification.read_statics(table)
    else:
        robot = seaid.load_robot(urdf, drives)
        log = seaid.read_log(table, robot)
        statics = seaid.identification.held_poses(robot, log, joint, sensor=sensor)
    fit = seaid.identification.calibrate_statics(statics, law=law)
    content = {
        "law": fit.law,
        "parameters": seaid.export.values_of(fit.estimate),
        "rms": fit.estimate.residual_std,
        "linearity": fit.linearity,
        "hysteresis": fit.hysteresis,
        "warnings": fit.warnings,
    }
    result.show(fit.summary(), content, robot=joint)
