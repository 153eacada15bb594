"""Command gear-ratio: gear ratios from the encoders on both sides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from seaid._files import toml_table
from seaid.cli.messages import show
from seaid.cli.options import AsJson, LogOptions, Logs
from seaid.errors import LogError

if TYPE_CHECKING:
    from seaid.log import Log
    from seaid.robot import Robot


def gear_ratio(options: LogOptions, logs: Logs, *, as_json: AsJson = False) -> None:
    """Estimate the gear ratios from the angles on both sides of the gears.

    Each log has its own encoder offsets. Behind a gear with a spring the angle is that of the joint
    plus the measured deflection; without it the motor equation explains the deflection by the
    torque. The lines for the drives file let identify include the standard error in its own.

    seaid gear-ratio leg.urdf run.csv --drives leg.toml
    seaid gear-ratio arm.urdf a.csv b.csv --drives arm.toml
    """
    from seaid.report import table

    robot = options.robot(options.known_body)
    read = options.logs(logs, robot)
    fits = {joint: _ratio(robot, read, joint) for joint in robot.joint_names}
    header = ["joint", "ratio", "std. error", "by the drives", "misfit", "unit"]
    keys = ("ratio", "standard_error", "of_drives", "misfit")
    ratios = {joint: fit for joint, fit in fits.items() if "ratio" in fit}
    rows = [
        [joint, *("-" if fit[key] is None else f"{fit[key]:.6g}" for key in keys), fit["unit"]]
        for joint, fit in ratios.items()
    ]
    reasons = [f"{joint}: {fit['reason']}" for joint, fit in fits.items() if "reason" in fit]
    if not rows:
        raise LogError(f"no gear ratio is determined: {'; '.join(reasons)}")
    title = "Motor motion per motion behind the gear"
    text = [table(title, header, rows), *reasons, "\nin the drives file:", *_drives_lines(ratios)]
    show("\n".join(text), {"joints": fits}, as_json, robot=robot.name)


def _drives_lines(ratios: dict[str, dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of a drives file that have the ratios."""
    for joint, fit in ratios.items():
        key = "gear_ratio" if fit["unit"] == "rad/rad" else "gear_ratio_rad_per_m"
        yield f"{toml_table(joint)}\n{key} = {fit['ratio']:.7g}"
        yield f"{key}_std = {fit['standard_error']:.2g}"


def _ratio(robot: Robot, logs: Sequence[Log], joint: str) -> dict[str, Any]:
    """Return the ratio of a joint, or the reason why there is none."""
    import numpy as np

    from seaid.identification import gear_ratio as ratio_of

    drive = robot.drives[joint]
    if np.count_nonzero(robot.transmission[robot.index(joint)]) > 1:
        return {"reason": "its motor turns several joints"}
    lever = drive.load_radius / drive.motor_radius  # r_L/r_M theta_L is the angle behind the gear
    motor, output = [], []
    for log in logs:
        place = log.joint_names.index(joint)
        behind = log.joint_position[:, place]
        if drive.is_elastic:
            if log.deflection is None or not np.all(np.isfinite(log.deflection[:, place])):
                return _ratio_of_motor_equation(robot, logs, joint)
            # d = r_M/(N r_L) theta_M - q by (3), so that r_L/r_M (q + d) = theta_M/N.
            behind = behind + log.deflection[:, place]
        pair = log.motor_position[:, place], lever * behind
        if not all(np.all(np.isfinite(angles)) for angles in pair):
            return {"reason": "a log has not both of its encoders"}
        motor.append(pair[0])
        output.append(pair[1])
    try:
        ratio = ratio_of(motor, output)
    except LogError as problem:
        return {"reason": str(problem).removeprefix("gear_ratio: ")}
    # The ratio of a spring is to the angle of its pulley, also where the joint slides.
    is_linear = robot.is_prismatic[robot.index(joint)] and not drive.is_elastic
    return {
        "ratio": ratio.value,
        "standard_error": ratio.standard_error,
        "of_drives": drive.ratio,
        "misfit": ratio.misfit_rad,
        "unit": "rad/m" if is_linear else "rad/rad",
    }


def _ratio_of_motor_equation(robot: Robot, logs: Sequence[Log], joint: str) -> dict[str, Any]:
    """Return the ratio of a joint whose spring lies between the encoders."""
    import numpy as np

    from seaid.identification import check

    joint_check = check(robot, list(logs)).joints[joint]
    if not np.isfinite(joint_check.gear_ratio):
        return {"reason": "its spring lies between the encoders; log deflection or motor torque"}
    return {
        "ratio": joint_check.gear_ratio,
        "standard_error": joint_check.gear_ratio_error,
        "of_drives": robot.drives[joint].ratio,
        "misfit": None,
        "unit": "rad/rad",
    }
