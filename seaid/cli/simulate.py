"""Command simulate: the log of a simulated robot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from seaid.cli.messages import is_terminal, written
from seaid.cli.options import (
    Output,
    ResultOptions,
    RobotOptions,
    check_joints,
    checked_suffix,
    values,
)

if TYPE_CHECKING:
    from seaid.robot import Robot
    from seaid.simulation import Noise


_OF_ALL = "for all joints, or as knee=2,hip=1"


@dataclass(frozen=True)
class NoiseOptions:
    """The errors of the simulated sensors."""

    torque_std: Annotated[str, Option(help=f"Noise of motor torques [N m], {_OF_ALL}.")] = "0"
    motor_resolution: Annotated[str, Option(help=f"Motor encoder step [rad], {_OF_ALL}.")] = "0"
    joint_resolution: Annotated[str, Option(help=f"Joint encoder step [rad or m], {_OF_ALL}.")] = (
        "0"
    )
    motor_offset: Annotated[str, Option(help=f"Motor encoder offset [rad], {_OF_ALL}.")] = "0"
    joint_offset: Annotated[str, Option(help=f"Joint encoder offset [rad or m], {_OF_ALL}.")] = "0"

    def noise(self, robot: Robot) -> Noise:
        """Return the errors, with zero for joints that are not named."""
        from seaid.simulation import Noise

        errors: dict[str, tuple[float, ...]] = {}
        for name, text in vars(self).items():
            option = f"--{name.replace('_', '-')}"
            number = values(option, text)
            sizes = number if isinstance(number, dict) else dict.fromkeys(robot.joint_names, number)
            check_joints(option, sizes, robot)
            unit = "Nm" if name == "torque_std" else "rad"
            errors[f"{name}_{unit}"] = tuple(sizes.get(joint) or 0.0 for joint in robot.joint_names)
        return Noise(**errors)


def _temperatures(text: str) -> dict[str, list[float]] | None:
    """Return {joint: temperatures from start to end} of a text as knee=20:45,hip=30."""
    try:
        pairs = [part.rpartition("=") for part in text.split(",") if part]
        return {joint: [float(value) for value in of.split(":")] for joint, _, of in pairs} or None
    except ValueError:
        hint = "knee=30 or knee=20:45, joints separated by commas"
        raise typer.BadParameter(f"'{text}' is not {hint}", param_hint="--temperature") from None


def simulate(
    options: RobotOptions,
    trajectory: Annotated[Path, Argument(help="Trajectory of seaid excite.", metavar="TRAJECTORY")],
    *,
    rate_hz: Annotated[float, Option(help="Rate of controller and log [Hz].")] = 1000.0,
    sensors: NoiseOptions,
    seed: Annotated[int, Option(help="Seed of the noise.")] = 0,
    temperature: Annotated[
        str,
        Option(help="Temperatures of motors [degC], knee=30 or from start to end, knee=20:45."),
    ] = "",
    output: Output = Path("log.csv"),
    result: ResultOptions,
) -> None:
    """Simulate the robot on a trajectory, and write the log of its sensors.

    All terms of the drives act with their nominal values, which the TOML must contain.

    seaid simulate leg.urdf plan.json --drives leg.toml -o run.csv
    seaid simulate leg.urdf plan.json --drives leg.toml --joint-offset knee_pitch=0.01 -o run.csv
    seaid simulate leg.urdf plan.json --drives leg.toml --payload foot:2.0:0.15,0,0 -o loaded.npz
    """
    from seaid.excitation import load_trajectory
    from seaid.log import WRITTEN, write_log
    from seaid.simulation import simulate as simulated

    checked_suffix(output, *WRITTEN)
    result.check(output, read=(options.urdf, options.drives, trajectory))
    robot = options.robot()
    noise = sensors.noise(robot)
    log = simulated(
        robot,
        load_trajectory(trajectory),
        rate_hz=rate_hz,
        noise=noise,
        seed=seed,
        temperature_degC=_temperatures(temperature),
        progress=is_terminal(),
    )
    with written(output, ".csv") as file:
        write_log(log, file)
    content = {"samples": len(log.time), "joints": log.joint_names}
    text = f"{len(log.time)} samples of {', '.join(log.joint_names)}, {log.time[-1]:.4g} s"
    result.show(text, content, output, robot=robot.name)
