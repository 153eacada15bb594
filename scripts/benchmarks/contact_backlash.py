"""Backlash next to a stiff contact: how often it is selected, its error, and false selections.

One elastic joint of 1 kg m^2 with a gear of 50 follows random motions of 12 s under a PD
controller. Motor and load are integrated here with 20 kHz, all motions at once, without the
simulator of seaid. The encoders have 4096 steps per turn of the motor and 2^17 of the joint, the
torque has 2 mN m of noise. Cubic springs, hysteresis and the sharp dead zone are compared.

    python scripts/benchmarks/contact_backlash.py --motions 20 --logs 200
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import seaid
from scripts.short_form import add_quick, few, sized
from seaid._arrays import Array
from seaid.drives import SeriesElasticDrive
from seaid.report import table
from tests.experiments import wiggle
from tests.one_joint import one_joint

RATIO, INERTIA, VISCOUS, COULOMB = 50.0, 1e-5, 5e-4, 0.03
STEP_S, EVERY = 5e-5, 40
CASES = {
    "contact of 4000 N m/rad, backlash of 10 mrad": (4000.0, 0.005, True),
    "contact of 20000 N m/rad, backlash of 4 mrad": (20000.0, 0.002, True),
    "contact of 4000 N m/rad without backlash": (4000.0, 0.0, False),
    "spring of 120 N m/rad without backlash": (120.0, 0.0, False),
}


def robot_of(folder: Path) -> seaid.Robot:
    """Return the joint with a linear spring, and viscous friction behind it."""
    drive = SeriesElasticDrive(
        gear_ratio=RATIO, motor_inertia_kg_m2=INERTIA, joint_friction=("viscous",)
    )
    return one_joint(folder).with_drives({"arm": drive})


def motions_of(
    robot: seaid.Robot, k: float, g: float, count: int, duration: float = 12.0
) -> tuple[Array, ...]:
    """Return times (T,), and joint angles, motor angles and torques (T, count)."""
    ticks = round(duration / (STEP_S * EVERY)) + 1
    time = np.arange(ticks) * STEP_S * EVERY
    plans = [
        wiggle(robot, duration, (0.2,), (1.0,), seed=seed).sample(time) for seed in range(count)
    ]
    wanted, speed, acceleration = (
        np.column_stack([plan[order][:, 0] for plan in plans]) for order in range(3)
    )
    found = np.empty((3, ticks, count))
    q, v, motor, w = wanted[0].copy(), 0 * wanted[0], RATIO * wanted[0], 0 * wanted[0]
    stiffness = 4.0 * INERTIA * 60.0**2  # of the controller, at the motor
    torque, command = 0 * motor, 0 * motor
    for tick in range(ticks):
        torque = command.copy()  # it ramps from one command to the next within a tick
        error = RATIO * wanted[tick] - motor
        command = stiffness * error + 0.8 * INERTIA * 60.0 * (RATIO * speed[tick] - w) * 4.0
        command += acceleration[tick] / RATIO + COULOMB * np.sign(speed[tick])
        found[:, tick] = q, motor, torque
        rise = (command - torque) / EVERY
        for part in range(EVERY):
            d = motor / RATIO - q
            force = k * (d - np.clip(d, -g, g))
            friction = VISCOUS * w + COULOMB * np.tanh(w / 0.05)
            acting = torque + (part + 0.5) * rise
            w += STEP_S * (acting - friction - force / RATIO) / INERTIA
            motor = motor + STEP_S * w
            v += STEP_S * (force - 0.5 * v)
            q = q + STEP_S * v
    return time, *found


def log_of(time: Array, states: list[Array], seed: int) -> seaid.Log:
    """Return the log of one motion by its sensors."""
    rng = np.random.default_rng(seed)
    steps = 2 * np.pi / 2**17, 2 * np.pi / 4096
    q, motor = (
        step * np.round((x + rng.uniform(-1, 1) * size) / step)
        for step, x, size in zip(steps, states[:2], (0.0, 1.0), strict=True)
    )
    torque = states[2] + 0.002 * rng.normal(size=len(time))
    return seaid.Log(
        time=time,
        joint_names=("arm",),
        joint_position=q[:, None],
        motor_position=motor[:, None],
        motor_torque=torque[:, None],
    )


def main() -> None:
    """Print the rate of selection and the error of the half width of each case."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--motions", type=int, default=20)
    parser.add_argument("--logs", type=int, default=200, help="without backlash; with: --motions")
    add_quick(parser)
    given = parser.parse_args()
    rows = []
    with TemporaryDirectory() as folder:
        robot = robot_of(Path(folder))
        for name, (k, g, has) in few(CASES.items()):
            time, *states = motions_of(robot, k, g, given.motions, sized(12.0, 2.0))
            hits, errors = 0, []
            logs = given.motions if has else given.logs // 2
            for seed in range(logs):
                log = log_of(time, [x[:, seed % given.motions] for x in states], seed)
                terms = {"spring": ("cubic", "dahl", "dead_zone")}
                selection = seaid.compare_terms(robot, log, terms=terms)
                terms_of = [term for _, term in selection.recommended.get("arm", ())]
                hits += "dead_zone" in terms_of
                if has and "dead_zone" in terms_of:
                    drive = seaid.identify(selection.robot, log).drives["arm"]
                    errors.append(abs(drive.value("dead_zone") / g - 1))
                if terms_of:
                    print(name, seed, terms_of, errors[-1:], flush=True)
            worst = f"{np.median(errors):.1%}, {max(errors):.1%}" if errors else ""
            rows.append([name, f"{hits} of {logs}", worst])
            print(rows[-1], flush=True)
    header = ["joint", "dead zone selected", "error of the half width (median, largest)"]
    print(table("Backlash next to a stiff contact", header, rows))


if __name__ == "__main__":
    main()
