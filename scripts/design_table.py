"""The tables of docs/experiment_design.md: how long, which rate, which encoders, how stiff.

The robot is a bench with one series elastic joint. For each row `seaid.design_excitation` plans a
motion, a simulation makes logs with other draws of the torque noise and of the encoder offsets, and
`seaid.identify` estimates the drive and the link. The script prints the median of the stated
standard errors and, in brackets, the rms of the true errors, both in percent of the true values.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import seaid
from scripts.short_form import add_quick, few, plan
from seaid._arrays import Array
from seaid._progress import track
from seaid.simulation.simulation import measure, simulate_motion

BENCH = """<robot name="bench"><link name="base"/><link name="arm"><inertial>
<origin xyz="{lever} 0 0"/><mass value="{mass}"/>
<inertia ixx="0.002" iyy="0.012" izz="0.012" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" velocity="4" effort="60"/></joint></robot>"""
TORQUE_STD_NM = 0.005  # of each sample of the motor torque; that of models/README.md
PARAMETERS = ("stiffness", "viscous_friction", "coulomb_friction")


@dataclass(frozen=True)
class Bench:
    """One row of the table: the experiment and the joint."""

    duration_s: float = 10.0
    rate_hz: float = 1000.0
    joint_bits: int = 14
    motor_bits: int = 12
    stiffness_Nm_per_rad: float = 300.0
    mass_kg: float = 2.0


DEFAULT = Bench()
TABLES: dict[str, tuple[str, list[Bench]]] = {
    "duration [s]": (
        "duration_s",
        [replace(DEFAULT, duration_s=time) for time in (3.0, 10.0, 30.0, 60.0)],
    ),
    "rate [Hz]": (
        "rate_hz",
        [replace(DEFAULT, rate_hz=rate) for rate in (100.0, 200.0, 500.0, 1000.0)],
    ),
    "joint encoder [bits per turn]": (
        "joint_bits",
        [replace(DEFAULT, joint_bits=bits) for bits in (10, 11, 12, 13, 14, 16, 18)],
    ),
    "motor encoder [bits per turn]": (
        "motor_bits",
        [replace(DEFAULT, motor_bits=bits) for bits in (6, 8, 12)],
    ),
    "stiffness [N m/rad], 14 bits": (
        "stiffness_Nm_per_rad",
        [replace(DEFAULT, stiffness_Nm_per_rad=k) for k in (30.0, 100.0, 300.0, 1e3, 3e3, 1e4)],
    ),
    "stiffness [N m/rad], 18 bits": (
        "stiffness_Nm_per_rad",
        [replace(DEFAULT, stiffness_Nm_per_rad=k, joint_bits=18) for k in (1e3, 3e3, 1e4)],
    ),
    "mass of the link [kg]": (
        "mass_kg",
        [replace(DEFAULT, mass_kg=mass) for mass in (0.02, 0.1, 0.5, 2.0)],
    ),
}
"""{what a table changes: its field, and the rows}."""


def robot_of(bench: Bench) -> seaid.Robot:
    """Return the bench as a robot: a link of 0.2 m behind a gear of 100 and a rotary spring."""
    drive = {
        "type": "series_elastic",
        "gear_ratio": 100.0,
        "motor_inertia_kg_m2": 1e-5,
        "viscous_friction_Nms_per_rad": 1e-4,
        "coulomb_friction_Nm": 0.01,
        "stiffness_Nm_per_rad": bench.stiffness_Nm_per_rad,
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.urdf"
        path.write_text(BENCH.format(lever=0.2, mass=bench.mass_kg), encoding="utf-8")
        return seaid.load_robot(path, {"elbow": drive})


def noise_of(bench: Bench, seed: int) -> seaid.Noise:
    """Return the sensors, with an encoder offset of up to half a turn of the motor."""
    offset = float(np.random.default_rng(seed).uniform(-np.pi, np.pi))
    return seaid.Noise(
        motor_resolution_rad=2 * np.pi / 2**bench.motor_bits,
        joint_resolution_rad=2 * np.pi / 2**bench.joint_bits,
        motor_offset_rad=offset,
        torque_std_Nm=TORQUE_STD_NM,
    )


def errors_of(bench: Bench, draws: int) -> tuple[float, Array, Array]:
    """Return the deflection, and stated and true errors (draws, parameters).

    The deflection is its rms without the mean, in steps of the joint encoder. Errors are relative.
    """
    robot = robot_of(bench)
    planned = plan(robot, bench.duration_s, drive_parameters=True, starts=1, iterations=30)
    plant_noise = noise_of(bench, 0)
    motion = simulate_motion(robot, planned.trajectory, rate_hz=bench.rate_hz, noise=plant_noise)
    stated, true = [], []
    for seed in range(draws):
        log = measure(robot, motion, noise_of(bench, seed), seed)
        found = seaid.identify(robot.without_nominal(), log)
        drive, exact = found.drives["elbow"], robot.drives["elbow"].values
        truth = np.array([*(exact[name] for name in PARAMETERS), *_inertia(robot, found)[2:]])
        values = np.array([*map(drive.value, PARAMETERS), _inertia(robot, found)[0]])
        errors = np.array([*map(drive.standard_error, PARAMETERS), _inertia(robot, found)[1]])
        stated.append(errors / np.abs(truth))
        true.append((values - truth) / np.abs(truth))
    deflection = np.std(motion.joint_torque[:, 0]) / bench.stiffness_Nm_per_rad
    step = 2 * np.pi / 2**bench.joint_bits
    return float(deflection / step), np.array(stated), np.array(true)


def _inertia(robot: seaid.Robot, found: seaid.Identification) -> tuple[float, float, float]:
    """Return the inertia of the link about its axis: estimate, standard error and truth."""
    exact = found.base.project(robot.parameters)
    place = next(i for i, name in enumerate(found.load.names) if "Iyy" in name)
    return (
        float(found.load.values[place]),
        float(found.load.standard_errors[place]),
        float(exact[place]),
    )


def main(draws: int, only: str) -> None:
    """Print the tables as Markdown."""
    warnings.simplefilter("ignore", seaid.SeaidWarning)  # short searches of the plan
    done: dict[Bench, tuple[float, Array, Array]] = {}
    for title, (field, benches) in TABLES.items():
        if only not in title:
            continue
        print(f"\n| {title} | deflection [steps] | k [%] | F_v; F_C [%] | inertia [%] |")
        print("|---:|---:|---:|---:|---:|")
        for bench in track(few(benches), title, True):
            if bench not in done:
                done[bench] = errors_of(bench, draws)
            steps, stated, true = done[bench]
            median, rms = np.median(stated, axis=0), np.sqrt(np.mean(true**2, axis=0))
            cells = [f"{a:.2g} ({b:.2g})" for a, b in zip(100 * median, 100 * rms, strict=True)]
            value = f"{getattr(bench, field):g}"
            stiffness, viscous, coulomb, inertia = cells
            figures = f"{steps:.2g} | {stiffness} | {viscous}; {coulomb} | {inertia}"
            print(f"| {value} | {figures} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=24, help="logs per row")
    parser.add_argument("--only", default="", help="tables whose title contains this")
    add_quick(parser)
    given = parser.parse_args()
    main(given.draws, given.only)
