"""How the time of `identifiability` grows with the number of joints, all of them with springs.

python scripts/benchmarks/identifiability_time.py
"""

from __future__ import annotations

import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

import seaid

JOINT = """<link name="l{i}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0"
ixz="0" iyz="0"/></inertial></link><joint name="j{i}" type="continuous"><parent link="l{before}"/>
<child link="l{i}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/></joint>"""
DRIVE = {"type": "series_elastic", "friction": ["viscous", "coulomb"], "gear_ratio": 100.0}
DRIVE |= {"motor_inertia_kg_m2": 1e-5, "stiffness_Nm_per_rad": 200.0}


def chain(joints: int) -> seaid.Robot:
    """Return a chain with random axes and offsets, every third link tilted by 0.3 rad."""
    rng = np.random.default_rng(0)
    text = '<robot name="chain"><link name="l0"/>'
    for i in range(1, joints + 1):
        axis = ("1 0 0", "0 1 0", "0 0 1")[rng.integers(3)]
        xyz = " ".join(f"{x:.3f}" for x in rng.uniform(-0.3, 0.3, 3))
        rpy = ("0 0 0", "1.5707963267948966 0 0", "0 0.3 0")[rng.integers(3)]
        text += JOINT.format(i=i, before=i - 1, xyz=xyz, rpy=rpy, axis=axis)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / "chain.urdf"
        path.write_text(text + "</robot>")
        return seaid.load_robot(path, {f"j{i}": DRIVE for i in range(1, joints + 1)})


def main() -> None:
    """Print a row per number of joints."""
    sizes = [int(word) for word in sys.argv[1:]] or [10, 20, 40, 60]
    seaid.identifiability(chain(2))  # imports
    print("| joints | combinations | processor time [s] | draws agree |\n|---|---|---|---|")
    for joints in sizes:
        robot, started = chain(joints), time.process_time()
        found = seaid.identifiability(robot)
        spent = time.process_time() - started
        print(f"| {joints} | {len(found.base.names)} | {spent:.1f} | {found.agree} |", flush=True)


if __name__ == "__main__":
    main()
