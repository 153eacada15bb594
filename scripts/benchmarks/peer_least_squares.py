"""The same ordinary least squares of a rigid arm by seaid and by figaroh, if it can be imported.

Time, peak memory, and the largest difference of the predicted torque, from joint positions,
velocities, accelerations and torques to the estimate. Each runs in a separate process; set
OPENBLAS_NUM_THREADS=1. figaroh comes with `pip install 'seaid[peers]'`.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import math
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import seaid
from scripts.example_robots import example_urdf
from seaid._arrays import Array
from seaid.estimation.least_squares import ordinary
from seaid.log import Motion
from seaid.regressor import base_parameters, joint_torques, load_regression
from seaid.regressor.load import load_model
from seaid.report import table

SAMPLES, RATE_HZ = 10_000, 100.0
Answer = tuple[Array, dict[str, float]]


def robot() -> seaid.Robot:
    """Return the UR10 with ideal drives: torques are known at the joints."""
    return seaid.load_robot(example_urdf("ur10_robot.urdf"))


def data(arm: seaid.Robot) -> tuple[Array, Array, Array, Array]:
    """Return q, v, a and noisy torques (T, n) of a smooth motion."""
    rng = np.random.default_rng(0)
    speed = 2 * np.pi * rng.uniform(0.1, 1.0, (5, arm.n))
    angle = speed * (np.arange(SAMPLES) / RATE_HZ)[:, None, None] + rng.uniform(0, 6, (5, arm.n))
    reach = rng.uniform(0.1, 0.4, (5, arm.n))
    q = np.sum(reach * np.sin(angle), axis=1)
    v = np.sum(reach * speed * np.cos(angle), axis=1)
    a = -np.sum(reach * speed**2 * np.sin(angle), axis=1)
    return q, v, a, joint_torques(arm, q, v, a) + rng.normal(0, 0.5, q.shape)


def ours() -> Answer:
    """Return the predicted torque (T, n) and the seconds of regressor and estimate."""
    arm = robot()
    q, v, a, torque = data(arm)
    nothing = np.full_like(q, np.nan)
    motion = Motion(
        time=np.arange(SAMPLES) / RATE_HZ,
        joint_names=arm.joint_names,
        joint_position=q,
        joint_velocity=v,
        joint_acceleration=a,
        motor_position=q,
        motor_velocity=v,
        motor_acceleration=a,
        motor_torque=nothing,
        joint_torque=torque,
        cutoff_hz=math.inf,
    )
    begin = time.perf_counter()
    model = load_model(arm, base_parameters(arm), arm.joint_names)
    ready = time.perf_counter()
    rows = load_regression(arm, motion, model, {})
    built = time.perf_counter()
    found = ordinary(rows)
    end = time.perf_counter()
    predicted = np.empty_like(q)
    predicted[np.searchsorted(motion.time, rows.time), rows.joint.astype(int)] = (
        rows.H @ found.values
    )
    seconds = {"base": ready - begin, "regressor": built - ready, "estimate": end - built}
    return predicted, seconds


def peers() -> Answer:
    """Return the same for figaroh; its rows are joint by joint, its base from a QR of the data."""
    from figaroh.identification.parameter import (  # type: ignore[import-not-found]
        get_standard_parameters,
    )
    from figaroh.tools.qrdecomposition import QRDecomposer  # type: ignore[import-not-found]
    from figaroh.tools.regressor import (  # type: ignore[import-not-found]
        RegressorBuilder,
        RegressorConfig,
        build_regressor_reduced,
        get_index_eliminate,
    )

    arm = robot()
    q, v, a, torque = data(arm)
    peer = SimpleNamespace(model=arm.model, data=arm.model.createData())
    begin = time.perf_counter()
    setting = {"act_idxv": list(range(arm.n))}
    W = RegressorBuilder(peer, RegressorConfig()).build_basic_regressor(q, v, a, setting)
    built = time.perf_counter()
    dropped, kept = get_index_eliminate(W, get_standard_parameters(arm.model))
    reduced = build_regressor_reduced(W, dropped)
    answer = QRDecomposer().double_decomposition(torque.T.ravel(), reduced, kept)
    end = time.perf_counter()
    predicted = (answer[0] @ answer[3]).reshape(arm.n, -1).T
    return predicted, {"base": 0.0, "regressor": built - begin, "estimate": end - built}


def main() -> None:
    """Print both results."""
    if importlib.util.find_spec("figaroh") is None:
        print("no figaroh here, seaid only; pip install 'seaid[peers]'")
        ways = ["seaid"]
    else:
        ways = ["seaid", "figaroh"]
    cells, predictions = [], []
    with tempfile.TemporaryDirectory() as folder:
        for way in ways:
            path = Path(folder) / f"{way}.npy"
            command = [sys.executable, __file__, way, str(path)]
            said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            found = json.loads(said.splitlines()[-1])
            predictions.append(np.load(path))
            cells.append([way, *(f"{value:.3f}" for value in found["seconds"].values())])
            cells[-1] += [f"{found['before_MB']:.0f}", f"{found['peak_MB']:.0f}"]
    header = ["", "base [s]", "regressor [s]", "estimate [s]", "before [MB]", "peak [MB]"]
    print(table(f"Ordinary least squares, UR10, {6 * SAMPLES} rows", header, cells))
    if len(ways) == 2:
        difference = np.max(np.abs(predictions[0] - predictions[1]))
        print(
            f"largest difference of a predicted torque: {difference:.1e} N m, "
            f"{difference / np.max(np.abs(predictions[1])):.1e} of the largest torque"
        )


def one(way: str, path: str) -> None:
    """Run one of them and print its time and memory."""
    warnings.simplefilter("ignore")
    data(robot())
    if way == "figaroh":
        importlib.import_module("figaroh.identification.parameter")
        importlib.import_module("figaroh.tools.regressor")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    predicted, seconds = ours() if way == "seaid" else peers()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    np.save(path, predicted)
    print(json.dumps({"seconds": seconds, "before_MB": before, "peak_MB": peak}))


if __name__ == "__main__":
    if len(sys.argv) == 3:
        one(sys.argv[1], sys.argv[2])
    else:
        warnings.simplefilter("ignore", seaid.SeaidWarning)
        main()
