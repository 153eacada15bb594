"""Springs, resonance and damping by frequency response, from motor torque and motor angle alone.

First two masses of the sizes of three drives, simulated by scipy with dry friction and noise: the
largest and root mean square errors over several draws of phases and noise; then the same with
an elastic load, a third mass whose mode is at three or five times the resonance. Then the TULip leg
with its test mass, 10 s of one multisine of its three elastic joints by `seaid.simulate`.

    python scripts/benchmarks/frequency.py [--draws 10] [--leg 3]
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

import seaid
from scripts.short_form import PLAN_S, add_quick, few, plan, sized
from seaid._arrays import Array
from tests.experiments import ELASTIC, TEST_MASS, leg
from tests.linear_plant import TwoMass, multisine_torque, state_space


@dataclass(frozen=True)
class ThreeMass(TwoMass):
    """The same with an elastic load: a part of its inertia behind a second, light spring."""

    outer: float = 0.5
    """Part of the load's inertia behind the second spring."""
    outer_stiffness: float = 1e4
    outer_damping: float = 1.0

    @property
    def matrices(self) -> tuple[Array, Array]:
        """A and B of the state (motor angle, position, outer position, their speeds)."""
        N, k, c = self.gear_ratio, self.stiffness, self.damping
        part = self.outer * self.load
        mass = np.diag([self.motor_inertia, self.load - part, part])
        pull = np.zeros((3, 3))
        pull[:2, :2] = [[1 / N**2, -1 / N], [-1 / N, 1.0]]
        second = np.zeros((3, 3))
        second[1:, 1:] = [[1.0, -1.0], [-1.0, 1.0]]
        weight = np.diag([0.0, self.gravity * (1 - self.outer), self.gravity * self.outer])
        stiffness = k * pull + self.outer_stiffness * second + weight
        damping = c * pull + self.outer_damping * second + np.diag([self.friction, 0.0, 0.0])
        return state_space(mass, stiffness, damping)

    @property
    def modes(self) -> Array:
        """Those of the lowest resonance and antiresonance."""
        A, _ = self.matrices
        held = A[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])]
        pairs = []
        # with a free motor the lowest pole is that of the pendulum, and the last is of the load
        for matrix, place in ((A, -2), (held, 0)):
            poles = np.linalg.eigvals(matrix)
            pole = sorted(poles[poles.imag > 0], key=abs)[place]
            pairs.append((abs(pole) / (2 * np.pi), -pole.real / abs(pole)))
        return np.ravel(pairs)


DRIVES = {
    # of the size of an ANYdrive, with the spring of 159.8 N m/rad of published dead weights, of a
    # knee of CENTAURO, and of the knee of the TULip leg; loads and friction are assumed
    "ANYdrive-like": (TwoMass(50.0, 6e-5, 2e-4, 159.8, 0.3, 0.3, 8.0), 0.3),
    "CENTAURO-like": (TwoMass(160.0, 1e-4, 5e-4, 6000.0, 6.0, 2.0, 30.0), 0.3),
    "TULip-like": (TwoMass(154.8, 3.4e-6, 8e-5, 77.7, 0.1, 0.33, 9.8), 0.06),
}
"""{name: plant and rms of the motor torque [N m]}."""

COULOMB, TORQUE_STD, STEP_RAD = 0.1, 0.02, 2 * np.pi / 2000
"""Shares of the torque: dry friction, and white noise at 1 kHz; step of the motor encoder."""

NAMES = ("stiffness", "resonance", "resonance_damping", "antiresonance", "antiresonance_damping")


OUTER = 0.3
"""Part of the load's inertia that is a third mass."""


def with_outer_mass(plant: TwoMass, times: float) -> TwoMass:
    """Return a plant whose load has a mode at so many times the resonance, with a free link."""
    if not times:
        return plant
    stiffness = OUTER * (1 - OUTER) * plant.load * (2 * np.pi * times * plant.modes[0]) ** 2
    damping = 0.02 * np.sqrt(stiffness * OUTER * plant.load)
    return ThreeMass(**asdict(plant), outer=OUTER, outer_stiffness=stiffness, outer_damping=damping)


def errors_of(name: str, draw: int, folder: Path, times: float = 0.0) -> Array:
    """Return the relative errors of `NAMES` of one draw, without nominal values of the drive."""
    plant, size = with_outer_mass(DRIVES[name][0], times), DRIVES[name][1]
    modes = plant.modes
    torque = multisine_torque(
        size, period_s=5.0, periods=2, top_hz=2.0 * modes[0], seed=draw, left_out=4
    )
    log = plant.log(torque, coulomb=COULOMB * size, torque_std=TORQUE_STD * size, seed=draw)
    stepped = np.round(log.motor_position / STEP_RAD) * STEP_RAD
    robot = plant.robot(folder, nominal=False)
    drive = replace(robot.drives["arm"], friction=("viscous", "coulomb"))
    robot = robot.with_drives({"arm": drive})
    found = seaid.frequency_response(robot, replace(log, motor_position=stepped), period_s=5.0)
    truth = np.array([plant.stiffness, *modes])
    errors: Array = np.divide([found.drives["arm"].value(one) for one in NAMES], truth) - 1.0
    return errors


def of_leg(seed: int) -> list[tuple[float, float]]:
    """Return error and standard error of each spring of the leg, relative to it."""
    robot = leg(TEST_MASS)
    sizes = {"hip_yaw": 0.0, "hip_roll": 0.0, "hip_pitch": 0.012, "knee_pitch": 0.02}
    period_s = sized(10.0, PLAN_S)
    shape = seaid.Multisine(
        band_hz=(1.2, 14.0),
        period_s=period_s,  # one period: with twice the lines, phases that fit badly count less
        amplitude={**sizes, "ankle_pitch": 0.2},
        omit_one_of=0,
    )
    limits = seaid.Limits(acceleration=200.0)
    planned = plan(robot, period_s, basis="multisine", multisine=shape, limits=limits, seed=seed)
    noise = seaid.Noise(motor_resolution_rad=STEP_RAD, torque_std_Nm=0.005)
    log = seaid.simulate(robot, planned.trajectory, noise=noise, seed=seed)
    blind = replace(log, joint_position=np.full_like(log.joint_position, np.nan))
    found = seaid.frequency_response(robot, blind, plan=planned.trajectory)
    truth = [robot.drives[joint].values["stiffness"] for joint in ELASTIC]
    return [
        (one.value("stiffness") / k - 1, one.standard_error("stiffness") / k)
        for one, k in zip(found.drives.values(), truth, strict=True)
    ]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--leg", type=int, default=10)
    add_quick(parser)
    given = parser.parse_args()
    print(f"rms (largest) relative error of {given.draws} draws of 10 s")
    print(f"{'drive':28s}", *(f"{name:>22s}" for name in NAMES))
    with tempfile.TemporaryDirectory() as folder:
        for times, name in product(few((0.0, 3.0, 5.0)), few(DRIVES)):
            draws = range(given.draws if not times else min(given.draws, 3))
            errors = np.array([errors_of(name, draw, Path(folder), times) for draw in draws])
            rms, most = np.sqrt(np.mean(errors**2, axis=0)), np.abs(errors).max(axis=0)
            cells = (f"{100 * a:.2f} % ({100 * b:.2f} %)" for a, b in zip(rms, most, strict=True))
            kind = f", elastic load, {times:g}" if times else ""
            print(f"{name + kind:28s}", *(f"{one:>22s}" for one in cells), flush=True)
    print("\nTULip leg with the test mass of 2 kg, one multisine of 10 s, no joint encoder")
    print(f"{'seed':15s}", *(f"{name:>22s}" for name in ELASTIC))
    for seed in range(given.leg):
        cells = (f"{100 * a:+.2f} % +- {100 * b:.2f} %" for a, b in of_leg(seed))
        print(f"{seed:<15d}", *(f"{one:>22s}" for one in cells), flush=True)


if __name__ == "__main__":
    main()
