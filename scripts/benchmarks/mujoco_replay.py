"""A MuJoCo replay of the exported model against `seaid.replay`, on a measured Go2 and simulations.

The Go2 (shared/data/go2_commands) is identified from the first two thirds of its log, with its
bodies as they are in example-robot-data, and replays the last third; with friction offsets in the
model and without. Simulated servos move by their commands with a delay.

    python scripts/benchmarks/mujoco_replay.py ../shared/data/go2_commands/go2_second_half.csv
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

import seaid
from scripts.example_robots import example_urdfs
from scripts.short_form import add_quick, few
from seaid._arrays import Array

MODELS = Path(__file__).resolve().parents[2] / "models"
GAINS = seaid.Controller(position_gain_Nm_per_rad=20.0, velocity_gain_Nms_per_rad=1.5)


def in_mujoco(robot: seaid.Robot, log: seaid.Log, folder: Path, ours: Array) -> Array:
    """Return the positions (T, n) of a replay of the exported model, from the start of `ours`."""
    import mujoco

    path = seaid.write_model(robot, folder / "model.xml", "mjcf").path
    model: Any = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    speed = np.gradient(ours, log.time, axis=0, edge_order=2)[0]
    for index, joint in enumerate(robot.joint_names):
        data.joint(joint).qpos, data.joint(joint).qvel = ours[0, index], speed[index]
    found = np.empty_like(ours)
    commands = log.position_command
    assert commands is not None
    order = [log.joint_names.index(joint) for joint in robot.joint_names]
    period = float(log.time[-1] - log.time[0]) / (len(log.time) - 1)
    steps = int(np.ceil(period / model.opt.timestep - 1e-6))
    model.opt.timestep = period / steps  # samples are taken at the end of a step
    for tick in range(len(log.time)):
        found[tick] = [data.joint(joint).qpos[0] for joint in robot.joint_names]
        for step in range(steps):
            for joint, column in zip(robot.joint_names, order, strict=True):
                actuator = data.actuator(joint)
                # a control is held for the step; that of a delay is a line through its samples
                held = 0.0 if model.actuator_delay[actuator.id] else 0.5
                now = log.time[tick] + (step + held) * model.opt.timestep
                actuator.ctrl = np.interp(now, log.time, commands[:, column])
            mujoco.mj_step(model, data)
    return found


def part(log: seaid.Log, rows: slice) -> seaid.Log:
    """Return a stretch of a log."""
    every = {one.name: getattr(log, one.name) for one in fields(log)}
    size = len(log.time)
    arrays: dict[str, Any] = {
        name: value[rows]
        for name, value in every.items()
        if isinstance(value, np.ndarray) and value.shape[:1] == (size,)
    }
    return replace(log, **arrays)


def errors(robot: seaid.Robot, log: seaid.Log, folder: Path) -> tuple[float, float]:
    """Return the mean absolute errors [mrad] of both replays."""
    columns = [log.joint_names.index(joint) for joint in robot.joint_names]
    true = log.joint_position[:, columns]
    ours = seaid.replay(robot, log).joint_position
    replays = (ours, in_mujoco(robot, log, folder, ours))
    own, other = (1e3 * float(np.mean(np.abs(one - true))) for one in replays)
    return own, other


def without_offsets(robot: seaid.Robot) -> seaid.Robot:
    """Return the robot with friction offsets of zero."""
    drives = robot.drives.items()
    return robot.with_drives(
        {joint: drive.with_values({"friction_offset": 0.0}) for joint, drive in drives}
    )


def go2(path: Path, folder: Path) -> None:
    """Print the errors of the Go2."""
    urdf = next(one for one in example_urdfs() if one.stem == "go2")
    drive = seaid.StiffDrive(
        motor_input="position_command",
        controller=GAINS,
        friction=("viscous", "coulomb", "offset"),
        command_delay_s=0.0,
        known=("command_delay",),
    )
    joints = [x for x in path.open().readline().split(",") if x.endswith("position_rad")]
    names = [name.removesuffix(".position_rad") for name in joints]
    bare = seaid.load_robot(urdf, dict.fromkeys(names, drive), joints=names)
    robot = seaid.load_robot(
        urdf, dict.fromkeys(names, drive), joints=names, known_bodies=list(bare.body_names)
    )
    log = seaid.read_log(path, robot)
    cut = 2 * len(log.time) // 3
    found = seaid.identify(robot, part(log, slice(0, cut))).robot
    for title, one in (("with offsets", found), ("without", without_offsets(found))):
        own, other = errors(one, part(log, slice(cut, None)), folder)
        print(f"Go2 {title}: seaid.replay {own:.3f} mrad, MuJoCo {other:.3f} mrad, "
              f"{100 * (other / own - 1):+.2f} %")  # fmt: skip


def simulated(folder: Path, delay_s: float, seed: int) -> None:
    """Print the errors of a servo whose plant has other parameters than its model."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, 6, 0.005)
    chirp = 0.4 * np.sin(2 * np.pi * (0.1 * time + 0.15 * time**2)) + 0.2 * np.sin(2.3 * time)
    true = seaid.StiffDrive(
        motor_input="position_command",
        controller=replace(GAINS, position_gain_Nm_per_rad=2.0, velocity_gain_Nms_per_rad=0.05),
        friction=("viscous", "coulomb", "offset"),
        nominal={"friction_offset": 0.02},
        motor_inertia_kg_m2=0.002,
        viscous_friction_Nms_per_rad=0.02,
        coulomb_friction_Nm=0.03,
        command_delay_s=delay_s,
    )
    mass = seaid.Payload("arm", 0.49, (0.0, 0.0, -0.1))
    robot = seaid.load_robot(MODELS / "xl330_pendulum.urdf", {"pendulum": true}, payloads=[mass])
    nothing = np.full((len(time), 1), np.nan)
    plan = seaid.Log(
        time=time,
        joint_names=("pendulum",),
        joint_position=np.zeros((len(time), 1)),
        motor_position=nothing,
        motor_torque=nothing,
        position_command=chirp[:, None],
    )
    moved = seaid.replay(robot, plan).joint_position
    log = replace(plan, joint_position=moved + rng.normal(size=moved.shape) * 1e-4)
    factors = {name: x * rng.uniform(0.8, 1.25) for name, x in true.values.items()}
    factors["command_delay"] = delay_s
    model = robot.with_drives({"pendulum": true.with_values(factors)})
    own, other = errors(model, log, folder)
    print(f"servo with a delay of {1e3 * delay_s:g} ms: seaid.replay {own:.3f} mrad, "
          f"MuJoCo {other:.3f} mrad, {100 * (other / own - 1):+.2f} %")  # fmt: skip


def main() -> None:
    """Print the errors of both replays."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path, nargs="?")
    add_quick(parser)
    path = parser.parse_args().log
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    with tempfile.TemporaryDirectory() as folder:
        if path is not None:
            go2(path, Path(folder))
        for seed, delay_s in few(enumerate((0.0, 0.005, 0.0123, 0.02)), 2):
            simulated(Path(folder), delay_s, seed)


if __name__ == "__main__":
    main()
