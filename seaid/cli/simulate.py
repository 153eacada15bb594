"""Command simulate: the log of a simulated robot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import seaid
from seaid.cli.kinds import ByJoint, JsonFile, Temperatures, WrittenLog
from seaid.cli.messages import is_terminal
from seaid.cli.options import ResultOptions, RobotOptions, by_joint
from seaid.cli.signature import option_name


@dataclass(frozen=True, kw_only=True)
class NoiseOptions:
    """The errors of the simulated sensors.

    Parameters
    ----------
    torque_std
        Noise of motor torques [N m]
    motor_resolution
        Motor encoder step [rad]
    joint_resolution
        Joint encoder step [rad or m]
    motor_offset
        Motor encoder offset [rad]
    joint_offset
        Joint encoder offset [rad or m]
    """

    torque_std: ByJoint = 0
    motor_resolution: ByJoint = 0
    joint_resolution: ByJoint = 0
    motor_offset: ByJoint = 0
    joint_offset: ByJoint = 0

    def noise(self, robot: seaid.Robot) -> seaid.Noise:
        """Return the errors, with zero for joints that are not named."""
        errors: dict[str, tuple[float, ...]] = {}
        for name, error in vars(self).items():
            sizes = by_joint(option_name(name), error, robot)
            unit = "Nm" if name == "torque_std" else "rad"
            errors[f"{name}_{unit}"] = tuple(sizes.get(joint, 0.0) for joint in robot.joint_names)
        return seaid.Noise(**errors)


def simulate(
    options: RobotOptions,
    trajectory: JsonFile,
    *,
    rate_hz: float = 1000.0,
    sensors: NoiseOptions,
    seed: int = 0,
    temperature: Temperatures | None = None,
    output: WrittenLog = Path("log.csv"),
    result: ResultOptions,
) -> None:
    """Simulate the robot on a trajectory, and write the log of its sensors.

    All terms of the drives act with their nominal values, which the TOML must contain.

    Parameters
    ----------
    trajectory
        Trajectory of seaid excite.
    rate_hz
        Rate of controller and log [Hz].
    seed
        Seed of the noise.
    temperature
        Temperatures of motors [degC], knee=30 or from start to end, knee=20:45.

    Examples
    --------
    seaid simulate leg.urdf plan.json --drives leg.toml -o run.csv
    seaid simulate leg.urdf plan.json --drives leg.toml --joint-offset knee_pitch=0.01 -o run.csv
    seaid simulate leg.urdf plan.json --drives leg.toml --payload foot:2.0:0.15,0,0 -o loaded.npz
    """
    robot = options.robot()
    result.check(output, read=(options.urdf, options.drives, trajectory))
    noise = sensors.noise(robot)
    log = seaid.simulate(
        robot,
        seaid.load_trajectory(trajectory),
        rate_hz=rate_hz,
        noise=noise,
        seed=seed,
        temperature_degC=temperature or None,
        progress=is_terminal(),
    )
    seaid.write_log(log, output)
    content = {"samples": len(log.time), "joints": log.joint_names}
    text = f"{len(log.time)} samples of {', '.join(log.joint_names)}, {log.time[-1]:.4g} s"
    result.show(text, content, output, robot=robot.name)
