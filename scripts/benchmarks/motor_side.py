"""Stiffness and resonance from motor angle and motor torque alone, of two- and three-mass joints.

Each plant is a pendulum behind a drive with a spring. Its equations are integrated here, by
Runge-Kutta, and not by seaid; a controller follows a random-phase multisine. The log has the
motor's encoder in whole steps, and its torque with white noise. A three-mass joint has a second
spring in its link, which no model of seaid has: its error is the bias of the two-mass model.

python scripts/benchmarks/motor_side.py [draws]
python scripts/benchmarks/motor_side.py --coverage [draws] [first seed]
python scripts/benchmarks/motor_side.py --rotor [draws] [first seed], with unknown rotor inertias
python scripts/benchmarks/motor_side.py --lacking [draws] [first seed]
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import seaid
from scripts.short_form import few, sized, words
from seaid._arrays import Array
from seaid.report import table
from seaid.report.formats import percent

RATE_HZ, STEPS, BANDWIDTH = 1000.0, 8, 15.0
GRAVITY = 9.81

State = tuple[float, float, float, float, float, float]
"""Angle and speed of the motor, of the joint, and of the part behind the spring of the link."""


@dataclass(frozen=True)
class Joint:
    """A pendulum behind a rotary spring; the link has a joint of its own if `link_k` is finite.

    `mass` [kg] has its centre at `length` [m], and `inertia` [kg m^2] about it; `share` of the
    mass moves behind the link's spring of `link_k` [N m/rad]. `damping` [N m s/rad] is that of the
    drive's spring.
    """

    ratio: float
    rotor: float
    viscous: float
    coulomb: float
    k: float
    mass: float
    length: float
    inertia: float
    counts: int
    torque_std: float
    reach: float
    highest_hz: float
    link_k: float = np.inf
    share: float = 0.3
    damping: float = 0.0

    @property
    def load(self) -> float:
        """Inertia about the joint [kg m^2]."""
        return self.inertia + self.mass * self.length**2

    @property
    def antiresonance_hz(self) -> float:
        """Frequency of the load with a locked motor."""
        return float(np.sqrt(self.k / self.load) / (2 * np.pi))


TULIP = Joint(
    86 * 0.036 / 0.02,
    3.4e-6,
    8e-5,
    0.00268,
    59966 * 0.036**2,
    1.5,
    0.22,
    0.02,
    2000,
    0.006,
    0.35,
    6.0,
)
"""The knee of the TULip leg (`models/README.md`), its pulleys as one ratio, with shank and foot."""

ANYDRIVE = Joint(50.0, 6e-5, 4e-4, 0.012, 159.8, 2.5, 0.2, 0.03, 4096, 0.005, 0.35, 6.0)
"""k as in the published calibration of an ANYdrive; the other numbers are assumed."""

CENTAURO = Joint(120.0, 1e-4, 1.5e-3, 0.04, 6000.0, 8.0, 0.35, 0.3, 8192, 0.01, 0.3, 8.0)
"""The size of a large drive of CENTAURO; all numbers are assumed."""

JOINTS = {"TULip-like knee": TULIP, "ANYdrive-like": ANYDRIVE, "CENTAURO-like": CENTAURO}


def random_joint(seed: int) -> Joint:
    """Return a joint of random sizes, excited up to 1.1 to 1.5 times its antiresonance."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    ratio, load, antiresonance_hz = between(20, 150), between(0.05, 2), between(3, 12)
    length, slender, reach = between(0.1, 0.4), between(0.2, 1), between(0.2, 0.4)
    rotor = load / ratio**2 / between(0.2, 5)
    mass = load / length**2 / (1 + slender)
    speed = reach * 2 * np.pi * 2
    typical = (load + rotor * ratio**2) * speed * 2 * np.pi * 2 / ratio
    return Joint(
        ratio=ratio,
        rotor=rotor,
        viscous=typical * between(0.01, 0.1) / (ratio * speed),
        coulomb=typical * between(0.02, 0.3),
        k=load * (2 * np.pi * antiresonance_hz) ** 2,
        mass=mass,
        length=length,
        inertia=load - mass * length**2,
        counts=int(between(2000, 16384)),
        torque_std=typical * between(0.003, 0.02),
        reach=reach,
        highest_hz=antiresonance_hz * between(1.1, 1.5),
    )


def multisine(joint: Joint, duration: float, seed: int) -> tuple[Array, NDArray[np.complex128]]:
    """Return frequencies [rad/s] and complex amplitudes [rad] of a random-phase multisine."""
    lines = np.arange(2, int(joint.highest_hz * duration), 3)
    rng = np.random.default_rng(seed)
    rates = 2 * np.pi * lines / duration
    sizes = np.exp(2j * np.pi * rng.uniform(size=len(lines))) / (1 + rates / (2 * np.pi))
    t = np.linspace(0, duration, 4000)
    peak = np.max(np.abs(np.real(np.exp(1j * np.outer(t, rates)) @ sizes)))
    return np.asarray(rates, dtype=float), np.asarray(joint.reach * sizes / peak)


def duration_s() -> float:
    """Return the duration of the logs [s], in the short form a short one."""
    return sized(10.0, 4.0)


def simulated_together(
    joints: Sequence[Joint], seeds: Sequence[int], duration: float = 10.0
) -> list[seaid.Log]:
    """Return the logs of the motor sides of joints, each with its own seed."""
    return [simulated(joint, duration, seed) for joint, seed in zip(joints, seeds, strict=True)]


def simulated(joint: Joint, duration: float = 10.0, seed: int = 0) -> seaid.Log:
    """Return the log of the motor side of a joint: plain numbers, the fastest for one joint."""
    n, has_link = joint.ratio, math.isfinite(joint.link_k)
    far, link_k = (joint.share, joint.link_k) if has_link else (0.0, 0.0)
    near_J, far_J = (1 - far) * joint.load, far * joint.load if has_link else 1.0
    # motor speed over which Coulomb friction changes its sign: the least that Runge-Kutta follows
    width = joint.coulomb / joint.rotor / (RATE_HZ * STEPS)
    weight = joint.mass * joint.length * GRAVITY
    near_m, far_m = (1 - far) * weight, far * weight
    rotor, viscous, coulomb, k, damping = (
        joint.rotor,
        joint.viscous,
        joint.coulomb,
        joint.k,
        joint.damping,
    )
    reflected = joint.load + rotor * n**2
    gain_p, gain_d = reflected * BANDWIDTH**2, 2 * reflected * BANDWIDTH

    def slope(x: State, torque: float) -> State:
        th, w, q, v, p, u = x
        spring = k * (th / n - q) + damping * (w / n - v)
        link = link_k * (q - p)
        friction = viscous * w + coulomb * math.tanh(w / width)
        a = (spring - near_m * math.sin(q) - link) / near_J
        b = (link - far_m * math.sin(p)) / far_J if has_link else 0.0
        return w, (torque - friction - spring / n) / rotor, v, a, u, b

    # the controller runs at every step: a torque held or interpolated between the samples of the
    # log has less of their frequencies, by sinc^2, than the samples themselves
    rate_hz = RATE_HZ * STEPS
    time = np.arange(round(duration * rate_hz)) / rate_hz
    rates, sizes = multisine(joint, duration, seed)
    waves = np.exp(1j * np.outer(time, rates))
    plan = np.column_stack([np.real(waves @ (sizes * (1j * rates) ** i)) for i in range(3)])
    step, memory, h = 2 * math.pi / joint.counts, 0.2 / STEPS, 1 / rate_hz
    start, start_speed, _ = plan[0].tolist()
    speed = n * start_speed
    x: State = (n * start, speed, start, start_speed, start, start_speed)
    readings, torques = [], []
    before: float | None = None
    last: float | None = None
    for position, velocity, acceleration in plan.tolist():
        reading = round(x[0] / step) * step
        if before is not None:
            speed += memory * ((reading - before) * rate_hz - speed)
        before = reading
        wanted = gain_p * (position - reading / n) + gain_d * (velocity - speed / n)
        command = (wanted + reflected * acceleration) / n
        # the torque changes linearly to the command of this step until the next one
        last = command if last is None else last
        readings.append(reading)
        torques.append(last)
        middle = (last + command) / 2
        k1 = slope(x, last)
        k2 = slope(moved(x, h / 2, k1), middle)
        k3 = slope(moved(x, h / 2, k2), middle)
        k4 = slope(moved(x, h, k3), command)
        x = moved(moved(moved(moved(x, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)
        last = command
    time, torque = time[::STEPS], np.array(torques[::STEPS])
    noise = np.random.default_rng(seed + 1000).normal(0, joint.torque_std, len(time))
    return seaid.Log(
        time=time,
        joint_names=("arm",),
        motor_position=np.array(readings[::STEPS])[:, None],
        joint_position=np.full((len(time), 1), np.nan),
        motor_torque=(torque + noise)[:, None],
    )


def moved(x: State, step: float, slope: State) -> State:
    """Return a state after a step along a slope."""
    (a, b, c, d, e, f), (da, db, dc, dd, de, df) = x, slope
    return a + step * da, b + step * db, c + step * dc, d + step * dd, e + step * de, f + step * df


def robot_of(
    joint: Joint,
    folder: str | Path,
    spring: tuple[str, ...] = ("linear",),
    *,
    knows_rotor: bool = True,
) -> seaid.Robot:
    """Return the robot with geometry, gear and rotor of a joint, and nothing else."""
    path = Path(folder) / "arm.urdf"
    path.write_text(
        '<robot name="arm"><link name="base"/><link name="body"/>'
        '<joint name="arm" type="revolute"><parent link="base"/>'
        '<child link="body"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" effort="999" velocity="99"/></joint></robot>'
    )
    drive = seaid.SeriesElasticDrive(
        gear_ratio=joint.ratio,
        motor_inertia_kg_m2=joint.rotor if knows_rotor else None,
        friction=("viscous", "coulomb"),
        spring=spring,
    )
    return seaid.load_robot(path, {"arm": drive})


def errors(joint: Joint, found: seaid.Identification) -> dict[str, float]:
    """Return the relative errors of stiffness, resonance and inertia, and k's over its std."""
    drive = found.drives["arm"]
    k, load = drive.value("stiffness"), found.load.value("Iyy_body")
    rotor = joint.rotor * joint.ratio**2
    true = np.sqrt(joint.k * (1 / joint.load + 1 / rotor))
    return {
        "k": k / joint.k - 1,
        "resonance": float(np.sqrt(k * (1 / load + 1 / rotor)) / true - 1),
        "J": load / joint.load - 1,
        "score": (k - joint.k) / drive.standard_error("stiffness"),
        "std": drive.standard_error("stiffness") / joint.k,
    }


def scores(joint: Joint, found: seaid.Identification) -> Array:
    """Return the errors of k, F_v, F_C, J, first moment and rotor in standard errors.

    That of the rotor inertia is missing if it was known.
    """
    drive, load = found.drives["arm"], found.load
    parts: list[tuple[seaid.Estimate, str, float]] = [
        (drive, "stiffness", joint.k),
        (drive, "viscous_friction", joint.viscous),
        (drive, "coulomb_friction", joint.coulomb),
        (load, "Iyy_body", joint.load),
        (load, "mz_body", -joint.mass * joint.length),
        (drive, "motor_inertia", joint.rotor),
    ]
    parts = [part for part in parts if part[1] in part[0].names]
    return np.array([(one.value(x) - true) / one.standard_error(x) for one, x, true in parts])


def coverage(draws: int = 20, first: int = 1000, *, knows_rotor: bool = True) -> None:
    """Print how many 95 % intervals hold the truth, and the root mean squares of the scores."""
    seeds = list(range(first, first + draws))
    cases = {name: [joint] * draws for name, joint in JOINTS.items()}
    cases["random joints"] = [random_joint(seed) for seed in seeds]
    rows = []
    for name, joints in few(cases.items()):
        found, failed = [], 0
        for joint, log in zip(joints, simulated_together(joints, seeds, duration_s()), strict=True):
            with tempfile.TemporaryDirectory() as folder:
                robot = robot_of(joint, folder, knows_rotor=knows_rotor)
                try:
                    found.append(scores(joint, seaid.identify(robot, log)))
                except seaid.errors.SeaidError:
                    failed += 1
        held = np.mean(np.abs(found) < 1.96, axis=0)
        rms = np.sqrt(np.mean(np.square(found), axis=0))
        cells = (f"{percent(a)} ({b:.2f})" for a, b in zip(held, rms, strict=True))
        rows.append((name, *cells, str(failed)))
    title = f"95 % intervals with the truth of {draws} draws from seed {first} (rms score)"
    heads = ("joint", "k", "F_v", "F_C", "J", "first moment", *(() if knows_rotor else ("rotor",)))
    print(table(title, (*heads, "failed"), rows))


def lacking(draws: int = 20, first: int = 500) -> None:
    """Print what is said of random joints: clean, with a damped spring, or with an elastic link.

    "within the bound": the error of k is below what the note says a link may hide.
    """
    seeds = list(range(first, first + draws))
    plain = [random_joint(seed) for seed in seeds]
    damped = [replace(one, damping=0.04 * float(np.sqrt(one.k * one.load))) for one in plain]
    cases = {"clean": plain, "damping ratio of 2 %": damped}
    for times in (3.0, 4.5, 6.0):
        cases[f"link of {times:g} times"] = [
            replace(one, link_k=times**2 * one.k * one.share) for one in plain
        ]
    rows = []
    for name, joints in few(cases.items()):
        for band in few((None, 2.0)):
            wider = [
                one if band is None else replace(one, highest_hz=band * one.antiresonance_hz)
                for one in joints
            ]
            said = {"damping": 0, "link": 0, "within the bound": 0, "failed": 0}
            biases = []
            for joint, log in zip(
                wider, simulated_together(wider, seeds, duration_s()), strict=True
            ):
                with tempfile.TemporaryDirectory() as folder:
                    try:
                        found = seaid.identify(robot_of(joint, folder), log)
                    except seaid.errors.SeaidError:
                        said["failed"] += 1
                        continue
                biases.append(abs(errors(joint, found)["k"]))
                evidence: dict[str, float] = {}
                for one in found.warnings:
                    evidence |= one.evidence if one.code == "motor-side" else {}
                said["damping"] += "damping ratio" in evidence
                said["link"] += "fall at the antiresonance" in evidence
                least = evidence.get("hidden part of the stiffness of arm", 0.0)
                said["within the bound"] += biases[-1] < least
            ends = "1.1 to 1.5" if band is None else f"{band:g}"
            rows.append((name, ends, percent(float(np.median(biases))), *map(str, said.values())))
    heads = ("joints", "band over antiresonance", "median error of k", *said)
    print(table(f"what is said of {draws} joints from seed {first}", heads, rows))


def main(draws: int = 3) -> None:
    """Print the errors of each joint."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, joint in few(JOINTS.items()):
            robot = robot_of(joint, folder)
            found = [
                errors(joint, seaid.identify(robot, simulated(joint, duration_s(), seed)))
                for seed in range(draws)
            ]
            worst = {key: max(abs(one[key]) for one in found) for key in found[0]}
            std = float(np.mean([one["std"] for one in found]))
            rows.append(
                (
                    name,
                    f"{joint.antiresonance_hz:.1f} Hz",
                    percent(worst["k"]),
                    percent(std),
                    percent(worst["resonance"]),
                    percent(worst["J"]),
                    f"{worst['score']:.1f}",
                )
            )
            # the link's own antiresonance at 3 and 6 times that of the joint
            for times in few((3.0, 6.0)):
                stiff = (times**2) * joint.k * joint.share
                three = replace(joint, link_k=stiff)
                bias = errors(joint, seaid.identify(robot, simulated(three, duration_s())))
                rows.append(
                    (
                        f"  with a link of {times:g} times",
                        f"{times * joint.antiresonance_hz:.1f} Hz",
                        percent(abs(bias["k"])),
                        percent(bias["std"]),
                        percent(abs(bias["resonance"])),
                        percent(abs(bias["J"])),
                        f"{abs(bias['score']):.1f}",
                    )
                )
    heads = (
        "joint",
        "antiresonance",
        "error of k",
        "std. error",
        "of resonance",
        "of J",
        "error/std",
    )
    print(table(f"largest errors of {draws} draws, of three masses: one draw", heads, rows))


if __name__ == "__main__":
    given = words()
    if given[:1] in (["--coverage"], ["--rotor"]):
        coverage(*map(int, given[1:3]), knows_rotor=given[0] == "--coverage")
    elif given[:1] == ["--lacking"]:
        lacking(*map(int, given[1:3]))
    else:
        main(*map(int, given[:1]))
