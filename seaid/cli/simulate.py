"""Command simulate: the log of a simulated robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from seaid.cli.messages import is_terminal, written
from seaid.cli.options import Output, ResultOptions, RobotOptions, checked_suffix


def simulate(
    given: RobotOptions,
    trajectory: Annotated[Path, Argument(help="Trajectory of seaid excite.", metavar="TRAJECTORY")],
    *,
    rate_hz: Annotated[float, Option(help="Rate of controller and log [Hz].")] = 1000.0,
    torque_std: Annotated[float, Option(help="Noise of motor torques [N m].")] = 0.0,
    motor_resolution: Annotated[float, Option(help="Motor encoder step [rad].")] = 0.0,
    joint_resolution: Annotated[float, Option(help="Joint encoder step [rad or m].")] = 0.0,
    seed: Annotated[int, Option(help="Seed of the noise.")] = 0,
    output: Output = Path("log.csv"),
    result: ResultOptions,
) -> None:
    """Simulate the robot on a trajectory, and write the log of its sensors.

    All terms of the drives act with their nominal values, which the TOML must contain.

    seaid simulate leg.urdf plan.json --drives leg.toml -o run.csv
    seaid simulate leg.urdf plan.json --drives leg.toml --payload foot:2.0:0.15,0,0 -o loaded.npz
    """
    from seaid.excitation import load_trajectory
    from seaid.log import WRITTEN, write_log
    from seaid.simulation import Noise
    from seaid.simulation import simulate as simulated

    checked_suffix(output, *WRITTEN)
    result.check(output, read=(given.urdf, given.drives, trajectory))
    noise = Noise(
        motor_resolution_rad=motor_resolution,
        joint_resolution_rad=joint_resolution,
        torque_std_Nm=torque_std,
    )
    robot = given.robot()
    log = simulated(
        robot,
        load_trajectory(trajectory),
        rate_hz=rate_hz,
        noise=noise,
        seed=seed,
        progress=is_terminal(),
    )
    with written(output, ".csv") as file:
        write_log(log, file)
    content = {"samples": len(log.time), "joints": log.joint_names}
    text = f"{len(log.time)} samples of {', '.join(log.joint_names)}, {log.time[-1]:.4g} s"
    result.show(text, content, output, robot=robot.name)
