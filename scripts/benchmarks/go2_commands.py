"""The Unitree Go2 from position commands: regression, refinement, and a search as PACE does it.

The first two thirds of ../shared/data/go2_commands identify, and the last third is replayed by
`seaid.replay`; with the terms of the drives as given, and with those that `compare_terms` adds.
CMA-ES searches the same parameters over rollouts of MuJoCo in the same log, until its error there
is that of the regression:

    python -m scripts.benchmarks.go2_commands [most seconds of the search]
"""

from __future__ import annotations

import tempfile
import time
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import seaid
from scripts.example_robots import example_urdf
from scripts.short_form import few, sized, words
from seaid._arrays import Array

DATA = Path(__file__).resolve().parents[3] / "shared/data/go2_commands/go2_second_half.csv"
CUTOFF_HZ = 9.0
"""Chosen with the first third against the second: 3.8 (default), 6, 9 and 14 Hz were tried."""

STEP_S, LOWER, UPPER = 2.5e-3, 0.0, np.array([0.1, 1.0, 2.0, 0.5])
"""Step of MuJoCo, and the box of armature, damping, friction loss and offset (from -0.5)."""


def robot_of(joints: list[str]) -> seaid.Robot:
    """Return the Go2 with known bodies and position commands."""
    urdf = example_urdf("go2.urdf")
    drive = seaid.StiffDrive(
        friction=("viscous", "coulomb", "offset"),
        motor_input="position_command",
        controller=seaid.Controller(position_gain_Nm_per_rad=20.0, velocity_gain_Nms_per_rad=1.5),
    )
    return seaid.load_robot(urdf, dict.fromkeys(joints, drive), joints=joints, known_bodies="all")


def logs_of(robot: seaid.Robot) -> tuple[seaid.Log, ...]:
    """Return the thirds of the log."""
    table = np.genfromtxt(DATA, delimiter=",", names=True, deletechars="")
    table = table[: sized(len(table), len(table) // 4)]
    at = table["time_s"] - table["time_s"][0]
    positions, commands = (
        np.column_stack([table[f"{joint}.{name}_rad"] for joint in robot.joint_names])
        for name in ("position", "command")
    )
    unknown = np.full_like(positions, np.nan)
    edges = [0, len(at) // 3, 2 * len(at) // 3, len(at)]

    def part(first: int, last: int) -> seaid.Log:
        own = slice(edges[first], edges[last])
        return seaid.Log(
            time=at[own],
            joint_names=robot.joint_names,
            joint_position=positions[own],
            motor_position=unknown[own],
            motor_torque=unknown[own],
            position_command=commands[own],
            is_prismatic=robot.is_prismatic,
        )

    return part(0, 1), part(1, 2), part(0, 2), part(2, 3)


def error_mrad(robot: seaid.Robot, log: seaid.Log) -> float:
    """Return the mean absolute error of a replay."""
    moved = seaid.replay(robot, log)
    return 1e3 * float(np.mean(np.abs(moved.joint_position - log.joint_position)))


class Rollouts:
    """MuJoCo's model of the exported robot, whose joints have other parameters at each call."""

    def __init__(self, robot: seaid.Robot, log: seaid.Log, folder: Path) -> None:
        seaid.write_mjcf(robot, folder / "go2.xml")
        self.model = mujoco.MjModel.from_xml_path(str(folder / "go2.xml"))
        self.model.opt.timestep = STEP_S
        self.data, self.log = mujoco.MjData(self.model), log
        self.places = [self.model.joint(name).qposadr[0] for name in log.joint_names]
        self.dofs = [self.model.joint(name).dofadr[0] for name in log.joint_names]
        step = np.arange(round((log.time[-1] - log.time[0]) / STEP_S) + 1) * STEP_S + log.time[0]
        assert log.position_command is not None
        self.commands = np.column_stack(
            [np.interp(step, log.time, one) for one in log.position_command.T]
        )
        slopes = np.polyfit(log.time[:20] - log.time[0], log.joint_position[:20], 2)
        self.start = slopes[2], slopes[1]

    def positions(self, x: Array) -> Array:
        """Return the positions (T, n) with parameters x (4, n): the motor torque is the PD's."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        model.dof_armature[self.dofs], model.dof_damping[self.dofs] = x[0], x[1] + 1.5
        model.dof_frictionloss[self.dofs] = x[2]
        data.qpos[self.places], data.qvel[self.dofs] = self.start
        found = np.empty_like(self.log.joint_position)
        every = round((self.log.time[1] - self.log.time[0]) / STEP_S)
        for tick, command in enumerate(self.commands[: every * len(found)]):
            if tick % every == 0:
                found[tick // every] = data.qpos[self.places]
            data.ctrl[:] = 0.0
            data.qfrc_applied[self.dofs] = 20.0 * (command - data.qpos[self.places]) - x[3]
            mujoco.mj_step(model, data)
        return found

    def error_mrad(self, x: Array) -> float:
        """Return the mean absolute error of the positions."""
        error = np.abs(self.positions(x) - self.log.joint_position)
        return 1e3 * float(np.mean(error)) if np.all(np.isfinite(error)) else 1e6


def search(
    robot: seaid.Robot, fitted: seaid.Log, judged: seaid.Log, seconds: float, goal_mrad: float
) -> None:
    """Print the error of CMA-ES over rollouts after growing CPU times, until it is at a goal."""
    CMA: Any = import_module("cmaes").CMA  # pip install 'seaid[peers]'

    n = robot.n
    with tempfile.TemporaryDirectory() as folder:
        own, other = (Rollouts(robot, log, Path(folder)) for log in (fitted, judged))
        own.model.actuator_gainprm[:] = other.model.actuator_gainprm[:] = 0.0
        own.model.actuator_biasprm[:] = other.model.actuator_biasprm[:] = 0.0

        def values(z: Array) -> Array:
            x = z.reshape(4, n) * UPPER[:, None]
            x[3] = 2 * x[3] - UPPER[3]
            return np.asarray(x)

        optimizer = CMA(
            mean=np.full(4 * n, 0.3),
            sigma=0.15,
            bounds=np.tile([0.0, 1.0], (4 * n, 1)),
            seed=1,
        )
        begin, best, where, count, shown = time.process_time(), np.inf, None, 0, 12.5
        while time.process_time() - begin < seconds:
            tried = []
            for _ in range(optimizer.population_size):
                z = optimizer.ask()
                error = own.error_mrad(values(z))
                count += 1
                tried.append((z, error))
                if error < best:
                    best, where = error, z
            optimizer.tell(tried)
            spent = time.process_time() - begin
            is_last = best <= goal_mrad or spent > seconds
            if (spent > shown or is_last) and where is not None:
                print(
                    f"CMA-ES | {spent:.0f} s | {count} rollouts | {best:.2f} | "
                    f"{other.error_mrad(values(where)):.2f}",
                    flush=True,
                )
                shown *= 2
            if best <= goal_mrad:
                break


def main(seconds: float) -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    if not DATA.is_file():
        print(f"skipped: the log is not here, no file '{DATA}'")
        return
    table = np.genfromtxt(DATA, delimiter=",", names=True, deletechars="", max_rows=1)
    columns = table.dtype.names or ()
    joints = [name.split(".")[0] for name in columns if name.endswith(".position_rad")]
    robot = robot_of(joints)
    first, second, both, last = logs_of(robot)
    print("| what | CPU time | own part [mrad] | next part [mrad] |")
    parts = (("two thirds", both, last), ("first third", first, second))
    for title, fitted, judged in sized(parts, parts[1:]):
        for cutoff_hz, has_terms in few(((None, False), (None, True), (CUTOFF_HZ, False))):
            start = time.process_time()
            drives = seaid.compare_terms(robot, fitted).robot if has_terms else robot
            found = seaid.identify(drives, fitted, cutoff_hz=cutoff_hz)
            spent = time.process_time() - start
            refined = seaid.refine(found, fitted)
            whole = time.process_time() - start
            name = f"{title}, cutoff {cutoff_hz or 'default'}{', terms' * has_terms}"
            for what, used, one in (("identify", spent, found), ("refine", whole, refined)):
                errors = [error_mrad(one.robot, log) for log in (fitted, judged)]
                print(
                    f"{name}, {what} | {used:.1f} s | {errors[0]:.2f} | {errors[1]:.2f}", flush=True
                )
            if seconds and title == "two thirds" and name.endswith("default"):
                search(found.robot, both, last, seconds, error_mrad(found.robot, both))


if __name__ == "__main__":
    main(float((words() or ["0"])[0]))
