"""Command crosscheck: numeric base parameters against exact ones."""

from __future__ import annotations

from dataclasses import asdict

from seaid.cli.messages import show
from seaid.cli.options import AsJson, RobotOptions


def crosscheck(options: RobotOptions, as_json: AsJson = False) -> None:
    """Compare numeric base parameters with exact ones, computed over the rationals.

    The exit code is 1 if they differ: then angles in the file are rounded, or the robot is badly
    conditioned.

    seaid crosscheck arm.urdf
    """
    from seaid import symbolic
    from seaid.errors import SeaidError
    from seaid.regressor import base_parameters, cross_check

    robot = options.robot()
    numeric = base_parameters(robot)
    comparison = cross_check(numeric, symbolic.base_parameters(robot))
    show(f"{robot.name}: {comparison.summary()}", asdict(comparison), as_json, robot=robot.name)
    if not comparison.agree:
        raise SeaidError(
            f"numeric and exact base parameters of '{robot.name}' differ: look for rounded angles "
            "in the URDF; the exact ones hold for the file as written"
        )
