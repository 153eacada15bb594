"""A million samples of an arm with seven joints, from file to estimate: time, memory, agreement.

Each part runs in a separate process, so that its peak memory is its own. Set
OPENBLAS_NUM_THREADS=1 for one core. With "identify" as the last argument, seaid.identify is run on
the same arm with a spring in every joint: seven actuator sides and the load side, streamed only.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import seaid
from scripts.example_robots import example_urdf
from scripts.short_form import sized, words
from seaid._arrays import Array
from seaid.drives import ParameterName
from seaid.estimation import estimator_named, fit
from seaid.estimation.least_squares import ordinary
from seaid.estimation.qr_factor import qr_factor_of
from seaid.identification.datasets import rows_of_equations
from seaid.log import Motion, open_long_log, reconstruct_motion
from seaid.regressor import Regression, base_parameters, joint_torques, load_regression
from seaid.regressor.load import load_model
from seaid.report import table

CUTOFF_HZ, RATE_HZ, BLOCK = 8.0, 1000.0, 50_000
RATIO, ROTOR_KG_M2, STIFFNESS_NM_PER_RAD = 100.0, 1e-4, 2e3


def robot() -> seaid.Robot:
    """Return an arm with seven stiff joints and viscous and Coulomb friction: 57 parameters."""
    drive = seaid.StiffDrive(friction=("viscous", "coulomb"))
    arm = seaid.load_robot(example_urdf("xarm7.urdf"))
    return arm.with_values(arm.parameters, dict.fromkeys(arm.joint_names, drive))


def elastic_robot() -> seaid.Robot:
    """Return the same arm with a rotary spring behind the gear of every joint."""
    drive = seaid.SeriesElasticDrive(gear_ratio=RATIO, motor_inertia_kg_m2=ROTOR_KG_M2)
    return robot().with_drives(dict.fromkeys(robot().joint_names, drive))


def write_elastic_log(path: Path, samples: int) -> None:
    """Write the log of the motion of `write_log` for the arm with springs."""
    write_log(path, samples)
    with np.load(path) as archive:
        columns = dict(archive)
    for joint in robot().joint_names:
        torque = columns.pop(f"{joint}.motor_torque_Nm")  # that on the load, with noise
        smooth = np.convolve(torque, np.ones(51) / 51, mode="same")
        angle = RATIO * (columns[f"{joint}.joint_position_rad"] + smooth / STIFFNESS_NM_PER_RAD)
        speed = np.gradient(angle, 1 / RATE_HZ)
        friction = 1e-4 * speed + 0.02 * np.sign(speed)
        rotor = ROTOR_KG_M2 * np.gradient(speed, 1 / RATE_HZ)
        columns[f"{joint}.motor_position_rad"] = angle
        columns[f"{joint}.motor_torque_Nm"] = torque / RATIO + friction + rotor
    np.savez(path, **columns)


def write_log(path: Path, samples: int) -> None:
    """Write a log of a long smooth motion with torque noise, computed block by block."""
    arm, rng = robot(), np.random.default_rng(0)
    frequency = rng.uniform(0.05, 0.8, (5, arm.n))
    phase, reach = rng.uniform(0, 2 * np.pi, (2, 5, arm.n))
    at = np.arange(samples) / RATE_HZ
    position, torque = np.empty((2, samples, arm.n))
    for start in range(0, samples, BLOCK):
        mine = slice(start, start + BLOCK)
        angle = 2 * np.pi * frequency * at[mine, None, None] + phase
        q = 0.05 * np.sum(reach * np.sin(angle), axis=1)
        speed = 2 * np.pi * frequency
        v = 0.05 * np.sum(reach * speed * np.cos(angle), axis=1)
        a = -0.05 * np.sum(reach * speed**2 * np.sin(angle), axis=1)
        position[mine] = q
        torque[mine] = joint_torques(arm, q, v, a) + 2.0 * v + 1.0 * np.sign(v)
    torque += rng.normal(0, 0.5, torque.shape)
    columns = {
        f"{joint}.{name}": values[:, index]
        for index, joint in enumerate(arm.joint_names)
        for name, values in (("joint_position_rad", position), ("motor_torque_Nm", torque))
    }
    if path.suffix == ".csv":
        seaid.write_log(_log(arm, at, position, torque), path)
        return
    np.savez(path, time_s=at, **columns)  # type: ignore[arg-type]


def _log(arm: seaid.Robot, at: Array, position: Array, torque: Array) -> seaid.Log:
    nothing = np.full_like(position, np.nan)
    return seaid.Log(at, arm.joint_names, nothing, position, torque)


def estimate(path: Path, way: str) -> dict[str, object]:
    """Return the ordinary estimate, seconds and peak memory [MB] in memory or streamed."""
    if way == "identify":
        return _identified(path)
    arm = robot()
    model = load_model(arm, base_parameters(arm), arm.joint_names)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

    def rows(motion: Motion) -> Regression:
        return load_regression(arm, motion, model, {})

    wall, core = time.perf_counter(), time.process_time()
    if way == "streamed":
        long_log = open_long_log(path, arm, cutoff_hz=CUTOFF_HZ)
        with rows_of_equations([long_log], {"": rows}, True) as stored:
            found = fit(stored[""], estimator_named("ols")).estimate
    else:
        found = ordinary(rows(reconstruct_motion(arm, seaid.read_log(path, arm), CUTOFF_HZ)))
    return {
        "wall_s": time.perf_counter() - wall,
        "core_s": time.process_time() - core,
        "before_MB": before,
        "peak_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "values": found.values.tolist(),
        "errors": found.standard_errors.tolist(),
    }


def _identified(path: Path) -> dict[str, object]:
    """Return values, seconds and peak memory [MB] of seaid.identify on the arm with springs."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    wall, core = time.perf_counter(), time.process_time()
    found = seaid.identify(elastic_robot(), path, cutoff_hz=CUTOFF_HZ)
    estimates = [*found.drives.values(), found.load]
    return {
        "wall_s": time.perf_counter() - wall,
        "core_s": time.process_time() - core,
        "before_MB": before,
        "peak_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "values": np.concatenate([one.values for one in estimates]).tolist(),
        "errors": np.concatenate([one.standard_errors for one in estimates]).tolist(),
    }


def random_rows(instants: int, joints: int, p: int) -> Regression:
    """Return rows with p random columns, white noise, and parameters of about one."""
    rng = np.random.default_rng(0)
    H = rng.normal(size=(instants * joints, p))
    return Regression(
        names=tuple(ParameterName(f"p{column}") for column in range(p)),
        units=("",) * p,
        H=H,
        y=H @ rng.normal(size=p) + rng.normal(size=len(H)),
        joint=np.tile(np.arange(joints), instants),
        time=np.repeat(np.arange(instants) * 0.03, joints),
        run=np.zeros(len(H)),
        excluded=0,
        propagated=np.empty((len(H), 0)),
    )


def rows_to_estimate() -> list[list[str]]:
    """Return the times of 60 000 rows of 51 columns from regressor to estimate."""
    rows, cells = random_rows(10_000, 6, 51), []
    for name, work in (("information (QR)", qr_factor_of), ("estimate, covariance", ordinary)):
        times = []
        for _ in range(sized(9, 1)):
            begin = time.perf_counter()
            work(rows)
            times.append(time.perf_counter() - begin)
        cells.append([name, f"{1e3 * min(times):.0f}", f"{1e3 * float(np.median(times)):.0f}"])
    return cells


def main() -> None:
    """Print the table; `long_log.py [samples] [.npz or .csv] [identify]`."""
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    given = words()
    samples = int(given[0]) if given else 1_000_000
    ending = given[1] if len(given) > 1 else ".npz"
    springs = given[2:] == ["identify"]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"log{ending}"
        subprocess.run(
            [sys.executable, __file__, "write", path, str(samples), *given[2:]], check=True
        )
        found = {}
        for way in ("identify",) if springs else ("streamed", "in memory"):
            command = [sys.executable, __file__, "estimate", str(path), way]
            found[way] = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    cells = [
        [way, *(f"{one[name]:.1f}" for name in ("wall_s", "core_s", "before_MB", "peak_MB"))]
        for way, one in found.items()
    ]
    header = ["method", "wall [s]", "core [s]", "memory before [MB]", "peak [MB]"]
    print(table(f"{samples} samples, 7 joints, {ending}", header, cells))
    if springs:
        return
    streamed, memory = found.values()
    errors = np.array(memory["errors"])
    apart = np.abs(np.array(streamed["values"]) - memory["values"])
    print(f"largest difference of a value, in its standard errors: {np.max(apart / errors):.1e}")
    print(f"relative to the values: {np.max(apart / np.abs(memory['values'])):.1e}")
    print(
        "of the standard errors, relative: "
        f"{np.max(np.abs(np.array(streamed['errors']) / errors - 1)):.1e}"
    )
    print(table("60 000 rows x 51", ["", "best [ms]", "median [ms]"], rows_to_estimate()))


if __name__ == "__main__":
    if sys.argv[1:2] == ["write"]:
        writing = write_elastic_log if sys.argv[4:] else write_log
        writing(Path(sys.argv[2]), int(sys.argv[3]))
    elif sys.argv[1:2] == ["estimate"]:
        warnings.simplefilter("ignore", seaid.SeaidWarning)
        print(json.dumps(estimate(Path(sys.argv[2]), sys.argv[3])))
    else:
        main()
