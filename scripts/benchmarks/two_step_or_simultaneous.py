"""Two-step or simultaneous identification: the TULip experiment with other joint encoders.

Each entry is the rms error over the draws, with the mean stated standard error in brackets. For the
base parameters it is the median over those parameters. "spring-free" has no (8) of elastic joints,
so the load side does not use the deflection; its stiffness is that of "two-step". "torque" is the
error of the load torque that the base parameters give along the motion.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._progress import track
from seaid.drives import ParameterName
from seaid.estimation import Estimate
from seaid.estimation.least_squares import weighted
from seaid.identification.simultaneous import (
    simultaneous_regression,
)
from seaid.log import Motion, reconstruct_motion
from seaid.regressor import Regression, base_parameters, rigid_body_regressor
from seaid.regressor.load import offset_sensitivity
from seaid.report import table
from seaid.report.formats import percent
from seaid.simulation.simulation import measure, simulate_motion

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.identify_tulip_leg import DURATION_S, LIMITS, TEST_MASS, load_leg, sensors
from scripts.short_form import add_quick, few, plan, sized

BITS = (10, 12, 14, 17)
NAMES = {"stiffness": "k", "coulomb_friction": "F_C", "viscous_friction": "F_v"}
WAYS = ("two-step", "simultaneous", "spring-free")
KEYS = tuple(f"{name} of {joint}" for name in NAMES for joint in load_leg(()).elastic_joints)


def three_ways(known: seaid.Robot, log: seaid.Log, zero_std: float) -> tuple[Array, Array]:
    """Return values and standard errors (3, parameters): KEYS, then base parameters, by WAYS."""
    first = seaid.identify(known, log, method="two-step", encoder_offset_std=zero_std)
    motion, springs = reconstruct_motion(known, log), tuple(first.springs)
    regress = partial(simultaneous_regression, known, model=first.model, springs=springs)
    # `identify` may have added terms that the log supports, such as an offset of a torque
    columns = regress(motion).names[: -len(first.model.names)]
    drives = [
        first.drives[column.owner].value(column.quantity)
        for column in columns
        if isinstance(column, ParameterName) and column.owner
    ]
    start = np.append(drives, first.load_side.values)
    rows = offset_sensitivity(known, motion, regress, start)
    zeros = zero_std**2 * np.eye(known.n)
    free = weighted(spring_free(known, rows), zeros)
    both = seaid.identify(known, log, method="simultaneous", encoder_offset_std=zero_std)
    found = [
        *(picked(result.drives, result.load) for result in (first, both)),
        picked(free.by_owner(), free.of_names(first.model.expressions)),
    ]
    values, errors = np.swapaxes(np.array(found), 0, 1)
    for part in (values, errors):
        part[2] = np.where(np.isnan(part[2]), part[0], part[2])
    return values, errors


def picked(drives: object, base: Estimate) -> tuple[Array, Array]:
    """Return values and errors of KEYS, NaN where a drive has no such parameter, then the base."""
    values, errors = [], []
    for key in KEYS:
        name, joint = key.split(" of ")
        drive: Estimate = drives[joint]  # type: ignore[index]
        there = name in drive.names
        values.append(drive.value(name) if there else np.nan)
        errors.append(drive.standard_error(name) if there else np.nan)
    return np.append(values, base.values), np.append(errors, base.standard_errors)


def spring_free(robot: seaid.Robot, rows: Regression) -> Regression:
    """Return the rows without (8) of the elastic joints; (8) is added to (7) instead."""
    H, y, propagated = rows.H.copy(), rows.y.copy(), rows.propagated.copy()
    for joint in robot.elastic_joints:
        offset = rows.names.index(f"spring_offset of {joint}")
        # the second (8), in which the same instants count for nothing as in (7)
        load = np.flatnonzero(rows.joint == 2 * robot.n + robot.index(joint))
        motor = np.flatnonzero(rows.joint == robot.n + robot.index(joint))
        load = load[np.searchsorted(rows.time[load], rows.time[motor])]
        lever = -H[motor, offset] / H[load, offset]
        H[motor] += lever[:, None] * H[load]
        y[motor] += lever * y[load]
        propagated[motor] += lever[:, None] * propagated[load]
    kept = ~np.isin(rows.joint, [robot.index(joint) for joint in robot.elastic_joints])
    kept &= rows.joint < 2 * robot.n
    spring = ("stiffness", "spring_offset")
    columns = [index for index, name in enumerate(rows.names) if not name.startswith(spring)]
    return replace(
        rows,
        names=tuple(rows.names[index] for index in columns),
        units=tuple(rows.units[index] for index in columns),
        H=H[kept][:, columns],
        y=y[kept],
        propagated=propagated[kept],
        joint=rows.joint[kept],
        time=rows.time[kept],
        run=rows.run[kept],
    )


def line(values: Array, errors: Array, truth: Array, torques: Array) -> list[str]:
    """Return the table entries of one method from values and errors (draws, parameters)."""
    off = values - truth
    size = np.where(truth == 0, np.inf, np.abs(truth))
    rms, stated = np.sqrt(np.mean(off**2, axis=0)) / size, np.mean(errors, axis=0) / size
    held = np.abs(off) < 1.96 * errors
    count = len(KEYS)
    entries = [*zip(rms[:count], stated[:count], strict=True)]
    there = np.flatnonzero(truth[count:]) + count
    entries.append((np.median(rms[there]), np.median(stated[there])))
    wrong = np.einsum("tp,dp->dt", torques, off[:, count:])
    worst = np.linalg.norm(wrong) / np.sqrt(len(off)) / np.linalg.norm(torques @ truth[count:])
    return [
        *(f"{percent(error)} ({percent(own)})" for error, own in entries),
        percent(float(worst)),
        percent(float(np.mean(held[:, :count]))),
        percent(float(np.mean(held[:, count:]))),
    ]


def study(foot: str, bits: int, motion: Motion, runs: int, zero_std: float) -> list[list[str]]:
    """Return the three lines of one foot and one joint encoder."""
    truth = load_leg((TEST_MASS,) if foot == "2 kg" else ())
    known, base = truth.without_nominal(), base_parameters(truth)
    found = []
    for run in range(runs):
        noise = replace(sensors(run), joint_resolution_rad=2 * np.pi / 2**bits)
        if not zero_std:
            noise = replace(noise, joint_offset_rad=0.0)
        found.append(three_ways(known, measure(truth, motion, noise, run), zero_std))
    values, errors = np.array(found).transpose(1, 2, 0, 3)
    drives = [truth.drives[key.split(" of ")[1]].values for key in KEYS]
    true = [drive[key.split(" of ")[0]] for drive, key in zip(drives, KEYS, strict=True)]
    exact = np.append(true, base.project(truth.parameters))
    some = [state[::50] for state in motion.joint_states]
    torques = base.reduce(rigid_body_regressor(truth, *some)).reshape(-1, len(base.columns))
    return [
        [foot, f"2^{bits}", way, *line(values[number], errors[number], exact, torques)]
        for number, way in enumerate(WAYS)
    ]


@dataclass(frozen=True)
class Mistake:
    """What the model or the experimenter does not know, in plant, log or offsets."""

    name: str
    friction: tuple[str, ...] = ("viscous", "coulomb")
    torque_offset_Nm: float = 0.0
    ripple_rad: float = 0.0
    encoder_offset_rad: float = 0.0
    encoder_offset_std: float = 0.0


MISTAKES = (
    Mistake("none"),
    Mistake("torque offset .5 mN m", torque_offset_Nm=5e-4),
    Mistake("torque offset 2 mN m", torque_offset_Nm=2e-3),
    Mistake("encoder offsets 2 mrad", encoder_offset_rad=2e-3),
    Mistake("the same, given", encoder_offset_rad=2e-3, encoder_offset_std=2e-3),
    Mistake("Stribeck 4 mN m", friction=("viscous", "coulomb", "stribeck")),
    Mistake("gear error 1 mrad", ripple_rad=1e-3),
)


def plant(mistake: Mistake) -> seaid.Robot:
    """Return the leg with the friction of a mistake."""
    truth = load_leg((TEST_MASS,))
    own = (
        {"stribeck_friction": 4e-3, "stribeck_speed": 5.0} if "stribeck" in mistake.friction else {}
    )
    drives = {
        joint: replace(drive, friction=mistake.friction, nominal={**drive.nominal, **own})
        for joint, drive in truth.drives.items()
    }
    return truth.with_values(truth.parameters, drives)


def logged(mistake: Mistake, motion: Motion, run: int) -> seaid.Log:
    """Return the log of one draw of the sensors, with the errors of a mistake in the log."""
    truth = load_leg((TEST_MASS,))
    offsets = np.random.default_rng(run).normal(0, mistake.encoder_offset_rad, truth.n)
    noise = replace(sensors(run), joint_offset_rad=tuple(offsets.tolist()))
    log = measure(truth, motion, noise, run)
    drives = truth.drives.values()
    lever = np.array([one.ratio * one.load_radius / one.motor_radius for one in drives])
    ripple = mistake.ripple_rad * np.sin(12 * log.joint_position)
    return replace(
        log,
        motor_torque=log.motor_torque + mistake.torque_offset_Nm,
        motor_position=log.motor_position + lever * ripple,
    )


def with_mistake(mistake: Mistake, trajectory: seaid.Trajectory, runs: int) -> list[list[str]]:
    """Return a line per method: errors of springs, friction and load torque, and coverage."""
    truth = load_leg((TEST_MASS,))
    motion = simulate_motion(plant(mistake), trajectory, noise=sensors(0))
    base = base_parameters(truth)
    some = [state[::50] for state in motion.joint_states]
    torques = base.reduce(rigid_body_regressor(truth, *some)).reshape(-1, len(base.columns))
    drives = [truth.drives[key.split(" of ")[1]].values for key in KEYS]
    true = [drive[key.split(" of ")[0]] for drive, key in zip(drives, KEYS, strict=True)]
    exact = np.append(true, base.project(truth.parameters))
    lines = []
    for method in ("two-step", "simultaneous"):
        found = [
            seaid.identify(
                truth.without_nominal(),
                logged(mistake, motion, run),
                method=method,
                encoder_offset_std=mistake.encoder_offset_std,
            )
            for run in range(runs)
        ]
        values, errors = np.swapaxes([picked(one.drives, one.load) for one in found], 0, 1)
        off, size = values - exact, np.abs(exact[: len(KEYS)])
        rms = np.sqrt(np.mean(off[:, : len(KEYS)] ** 2, axis=0)) / size
        held = np.abs(off) < 1.96 * errors
        wrong = np.einsum("tp,dp->dt", torques, off[:, len(KEYS) :])
        load = np.linalg.norm(wrong) / np.sqrt(runs) / np.linalg.norm(torques @ exact[len(KEYS) :])
        parts = [float(np.median(rms[:3])), float(np.median(rms[3:])), float(load)]
        parts += [float(np.mean(held[:, : len(KEYS)])), float(np.mean(held[:, len(KEYS) :]))]
        lines.append([mistake.name, method, *map(percent, parts)])
    return lines


def compare_mistakes(runs: int) -> None:
    """Print the table of mistakes."""
    known = load_leg((TEST_MASS,)).without_nominal()
    planned = plan(known, DURATION_S, basis="polynomial", limits=LIMITS, seed=2)
    rows: list[list[str]] = []
    for mistake in track(few(MISTAKES, 2), "mistakes", True):
        rows += with_mistake(mistake, planned.trajectory, runs)
    header = ["mistake", "method", "k", "friction", "torque", "95 %: drives", "base"]
    print(table(f"TULip leg with test mass, {runs} draws", header, rows))


def main(runs: int, zero_std: float) -> None:
    """Print one table."""
    known = load_leg((TEST_MASS,)).without_nominal()
    planned = plan(known, DURATION_S, basis="polynomial", limits=LIMITS, seed=2)
    rows = []
    for foot, payloads in few((("2 kg", (TEST_MASS,)), ("free", ()))):
        motion = simulate_motion(load_leg(payloads), planned.trajectory, noise=sensors(0))
        for bits in track(sized(BITS, BITS[2:3]), f"foot: {foot}", True):
            rows += study(foot, bits, motion, runs, zero_std)
    short = [f"{NAMES[key.split(' of ')[0]]} {key.split(' of ')[1].split('_')[0]}" for key in KEYS]
    header = ["foot", "encoder", "method", *short, "base", "torque", "95 %: drives", "base"]
    title = f"TULip leg, {runs} draws, encoder offsets known to {1e3 * zero_std:g} mrad"
    print(table(title, header, rows))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=16, help="draws of noise and offsets")
    parser.add_argument(
        "--offset-std", type=float, default=0.002, help="of the joint encoder offsets, rad"
    )
    parser.add_argument("--mistakes", action="store_true", help="errors of model and sensors")
    add_quick(parser)
    arguments = parser.parse_args()
    if arguments.mistakes:
        compare_mistakes(arguments.runs)
    else:
        main(arguments.runs, arguments.offset_std)
