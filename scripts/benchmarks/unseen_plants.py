"""The default of `identify` on MuJoCo plants that nobody tuned it on, next to plain least squares.

Every plant of `scripts.unseen_robots` is simulated once. Each seed has its own sensor noise,
encoder offsets and wrong bodies in the robot file. Four ways of `identify` read the files as a
user does; the fifth estimate is least squares written here, with the true structure.

A figure is a parameter of a drive, or a base parameter that makes more than 3 % of a joint's
torque. It is within if its error is at most 1.5 times that of the reference, or the reference's
standard error where that is larger (its error may be near zero by luck), or 0.5 %:

    python -m scripts.benchmarks.unseen_plants --seeds 2 --output OUT
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.signal import butter, sosfiltfilt

import seaid
from scripts.short_form import add_quick, few, sized
from scripts.unseen_robots import PLANTS, Joint, Plant, Run, simulated, write_files
from seaid._arrays import Array
from seaid.report import table
from seaid.report.formats import percent

WAYS: Mapping[str, Mapping[str, Any]] = {
    "default": {},
    "two-step": {"method": "two-step"},
    "simultaneous": {"method": "simultaneous"},
    "simultaneous 6 Hz": {"method": "simultaneous", "cutoff_hz": 6.0},
}
REFERENCE = "reference"
FACTOR, SMALL, SHARE = 1.5, 0.005, 0.03
"""Allowed ratio of errors; error that is always within; least share of a base parameter."""
CUTOFFS_HZ, JUDGED_HZ = (3.0, 5.0, 8.0, 12.0, 20.0), 8.0
"""Cutoffs that the reference tries, and that at which excluded blocks judge them."""
FOLDS, BLOCK_S = 8, 1.0


@dataclass(frozen=True)
class Figure:
    """A parameter with its true value and the scale of its relative error."""

    name: str
    truth: float
    scale: float


Estimates = dict[str, tuple[float, float, tuple[float, float]]]
"""{name: (value, standard error, 95 % interval)}."""


@dataclass(frozen=True)
class Rows:
    """Filtered rows of all equations: {equation: (H (r, p), y (r,), time (r,))}."""

    names: tuple[str, ...]
    equations: Mapping[str, tuple[Array, Array]]
    time: Array

    def part(self, kept: Array) -> Rows:
        """Return the rows of some instants."""
        some = {name: (H[kept], y[kept]) for name, (H, y) in self.equations.items()}
        return replace(self, equations=some, time=self.time[kept])


def low_pass(values: Array, cutoff_hz: float, rate_hz: float) -> Array:
    """Return values (T, ...) through a Butterworth filter of order four, there and back."""
    sections = butter(4, cutoff_hz, fs=rate_hz, output="sos")
    return np.asarray(sosfiltfilt(sections, values, axis=0))


@dataclass(frozen=True)
class Signals:
    """Filtered angles and their derivatives (T, n), and the regressor (T, n, p) of (8)."""

    joint_angle: Array
    motor_angle: Array
    motor_speed: Array
    motor_acceleration: Array
    regressor: Array


def rows_of(plant: Plant, robot: seaid.Robot, log: seaid.Log, base: Any, cutoff_hz: float) -> Rows:
    """Return (7) and (8) of all joints, both sides filtered in parallel and decimated."""
    rate_hz, names = plant.rate_hz, _names(plant, base)
    signals = _signals(robot, log, base, min(4 * cutoff_hz, 0.4 * rate_hz), rate_hz)
    step, edge = max(1, int(rate_hz / (4 * cutoff_hz))), int(rate_hz)
    kept = slice(edge, -edge, step)
    equations = {}
    for index, joint in enumerate(plant.joints):
        torque = log.motor_torque[:, index]
        for side, (H, y) in _equations(joint, index, names, signals, torque).items():
            H, y = (low_pass(x, cutoff_hz, rate_hz)[kept] for x in (H, y))
            equations[f"{side} {joint.name}"] = H, y
    return Rows(names, equations, log.time[kept])


def _signals(
    robot: seaid.Robot, log: seaid.Log, base: Any, cutoff_hz: float, rate_hz: float
) -> Signals:
    """Return filtered positions, their differences and the base columns of (8)."""
    q, angle = (low_pass(x, cutoff_hz, rate_hz) for x in (log.joint_position, log.motor_position))
    v, w = (np.gradient(x, 1 / rate_hz, axis=0) for x in (q, angle))
    a, dw = (np.gradient(x, 1 / rate_hz, axis=0) for x in (v, w))
    return Signals(q, angle, w, dw, base.reduce(regressor(robot, q, v, a)))


def regressor(robot: seaid.Robot, q: Array, v: Array, a: Array) -> Array:
    """Return the regressor (T, n, m) of the rigid bodies, by Pinocchio."""
    model, data = robot.model, robot.model.createData()
    states = zip(q, v, a, strict=True)
    return np.array([pin.computeJointTorqueRegressor(model, data, *x).copy() for x in states])


def _equations(
    joint: Joint, index: int, names: Sequence[str], signals: Signals, torque: Array
) -> dict[str, tuple[Array, Array]]:
    """Return H and y of "motor" (7) and "load" (8) of a spring, or of the "load" of a stiff one."""
    drive, w = joint.drive, signals.motor_speed[:, index]
    load = np.zeros((len(w), len(names)))
    load[:, -signals.regressor.shape[2] :] = -signals.regressor[:, index]
    motor, target = np.zeros_like(load), torque.copy()
    columns = {"viscous_friction": w, "coulomb_friction": np.sign(w)}
    if drive.motor_inertia_known:
        target -= drive.motor_inertia * signals.motor_acceleration[:, index]
    else:
        columns["motor_inertia"] = signals.motor_acceleration[:, index]
    for name, column in columns.items():
        motor[:, names.index(f"{name} of {joint.name}")] = column
    if not drive.stiffness:  # N (tau_M - I_M w' - friction) = Y theta
        return {"load": (drive.ratio * motor - load, drive.ratio * target)}
    stretch = drive.lever * signals.motor_angle[:, index]
    stretch = stretch - drive.load_radius * signals.joint_angle[:, index]
    for name, column in _spring(drive.cubic != 0, stretch).items():
        place = names.index(f"{name} of {joint.name}")
        motor[:, place], load[:, place] = drive.lever * column, drive.load_radius * column
    return {"motor": (motor, target), "load": (load, np.zeros(len(w)))}


def _names(plant: Plant, base: Any) -> tuple[str, ...]:
    """Return the names of the columns of all equations."""
    names: list[str] = []
    for joint in plant.joints:
        terms = ["viscous_friction", "coulomb_friction"]
        terms += [] if joint.drive.motor_inertia_known else ["motor_inertia"]
        if joint.drive.stiffness:
            terms += _spring(joint.drive.cubic != 0, np.zeros(1))
        names += [f"{term} of {joint.name}" for term in terms]
    return (*names, *base.names)


def _spring(is_cubic: bool, d: Array) -> dict[str, Array]:
    """Return the columns of a spring; k_3 (d - d_0)^3 is a polynomial of d."""
    columns = {"spring_offset": np.ones_like(d), "stiffness": d}
    return columns | ({"square": d**2, "cubic_stiffness": d**3} if is_cubic else {})


def fit(rows: Rows) -> tuple[Array, Array]:
    """Return values and covariance: two steps for the weights, then all equations at once.

    The covariance is that of clusters of `BLOCK_S`, which allows for autocorrelation.
    """
    motor = [name for name in rows.equations if name.startswith("motor")]
    first = _least_squares(rows, dict.fromkeys(motor, 1.0), np.zeros(len(rows.names)))
    # the load side, with the springs of the first step in its target
    second = _least_squares(rows, dict.fromkeys(set(rows.equations) - set(motor), 1.0), first)
    sigma = {name: np.std(y - H @ second) for name, (H, y) in rows.equations.items()}
    weights = {name: 1.0 / float(value) for name, value in sigma.items()}
    values = _least_squares(rows, weights, np.zeros(len(rows.names)))
    H = np.vstack([weights[name] * H for name, (H, _) in rows.equations.items()])
    y = np.concatenate([weights[name] * y for name, (_, y) in rows.equations.items()])
    size = np.linalg.norm(H, axis=0)
    score = (H / size) * (y - H @ values)[:, None]
    cluster = np.tile((rows.time // BLOCK_S).astype(int), len(weights))
    sums = np.array([score[cluster == number].sum(axis=0) for number in np.unique(cluster)])
    inverse = np.linalg.pinv((H / size).T @ (H / size))
    return values, inverse @ sums.T @ sums @ inverse / np.outer(size, size)


def _least_squares(rows: Rows, weights: Mapping[str, float], fixed: Array) -> Array:
    """Return the values of weighted least squares; those not zero in `fixed` are kept."""
    free = fixed == 0
    H = np.vstack([w * rows.equations[name][0] for name, w in weights.items()])
    y = np.concatenate([w * rows.equations[name][1] for name, w in weights.items()])
    size = np.linalg.norm(H, axis=0)
    free &= size > 0
    values = fixed.copy()
    solution = np.linalg.lstsq(H[:, free] / size[free], y - H @ fixed, rcond=None)[0]
    values[free] = solution / size[free]
    return values


def predicted_error(train: Rows, judge: Rows) -> float:
    """Return the error of excluded blocks: of each (7), of (8) with (7) in place of the spring."""
    total = 0.0
    lower, upper = judge.time[0], judge.time[-1]
    edges = np.linspace(lower, upper + 1e-9, FOLDS + 1)
    for begin, end in pairwise(edges):
        values, _ = fit(train.part((train.time < begin) | (train.time >= end)))
        excluded = judge.part((judge.time >= begin) & (judge.time < end))
        residual = {name: y - H @ values for name, (H, y) in excluded.equations.items()}
        for name, error in residual.items():
            joint = name.split()[1]
            motor = f"motor {joint}"
            y = judge.equations[motor if motor in judge.equations else name][1]
            if motor in residual and name != motor:
                column = train.names.index(f"spring_offset of {joint}")
                # r_M/N over r_L, from the columns of the constant of the spring
                lever = excluded.equations[motor][0][0, column]
                error = residual[motor] + lever / excluded.equations[name][0][0, column] * error
            total += float(np.mean(error**2) / np.mean(y**2))
    return total


def reference(
    plant: Plant, robot: seaid.Robot, log: seaid.Log, base: Any
) -> tuple[Estimates, float]:
    """Return the estimates of plain least squares at the cutoff that predicts best, and it."""
    judge = rows_of(plant, robot, log, base, JUDGED_HZ)
    tried = {x: rows_of(plant, robot, log, base, x) for x in few(CUTOFFS_HZ, 2)}
    cutoff_hz = min(tried, key=lambda each: predicted_error(tried[each], judge))
    rows = tried[cutoff_hz]
    values, covariance = fit(rows)
    errors = np.sqrt(np.diag(covariance))
    for joint in plant.joints:
        if (
            joint.drive.cubic
        ):  # c_1 d + c_2 d^2 + c_3 d^3: d_0 = -c_2 / 3 c_3, k = c_1 - c_2^2 / 3 c_3
            terms = ("stiffness", "square", "cubic_stiffness")
            places = [rows.names.index(f"{term} of {joint.name}") for term in terms]
            _, c2, c3 = values[places]
            slope = np.array([1.0, -2 * c2 / (3 * c3), c2**2 / (3 * c3**2)])
            values[places[0]] -= c2**2 / (3 * c3)
            errors[places[0]] = np.sqrt(slope @ covariance[np.ix_(places, places)] @ slope)
    limits = zip(rows.names, values, errors, strict=True)
    estimates = {name: (x, s, (x - 1.96 * s, x + 1.96 * s)) for name, x, s in limits}
    return estimates, cutoff_hz


def estimates_of(result: seaid.Identification) -> Estimates:
    """Return the drive parameters as "name of joint", and the base parameters."""
    tables = {f" of {joint}": x for joint, x in result.drives.items()}
    names = {suffix: x.names for suffix, x in tables.items()} | {"": result.base.names}
    tables[""] = result.load
    return {
        f"{name}{suffix}": (float(value), float(error), (float(limits[0]), float(limits[1])))
        for suffix, x in tables.items()
        for name, value, error, limits in zip(
            names[suffix], x.values, x.standard_errors, x.interval(), strict=True
        )
    }


def figures_of(
    plant: Plant, run: Run, offsets: Array, truth: seaid.Robot, base: Any
) -> list[Figure]:
    """Return the true parameters of the drives, and the base parameters that matter."""
    figures = []
    for index, joint in enumerate(plant.joints):
        drive = joint.drive
        values = {
            "viscous_friction": drive.viscous,
            "coulomb_friction": drive.coulomb,
            "motor_inertia": 0.0 if drive.motor_inertia_known else drive.motor_inertia,
            "stiffness": drive.stiffness,
            "cubic_stiffness": drive.cubic,
        }
        figures += [Figure(f"{name} of {joint.name}", x, x) for name, x in values.items() if x]
        if drive.stiffness and not drive.cubic:
            stretch = drive.lever * run.motor_position[:, index]
            stretch = stretch - drive.load_radius * run.joint_position[:, index]
            force = drive.stiffness * float(np.sqrt(np.mean(stretch**2)))
            offset = -drive.stiffness * drive.lever * float(offsets[index])
            figures.append(Figure(f"spring_offset of {joint.name}", offset, force))
    return figures + _bodies(plant, run, truth, base)


def _bodies(plant: Plant, run: Run, truth: seaid.Robot, base: Any) -> list[Figure]:
    """Return the base parameters that make more than `SHARE` of the torque of a joint, rms."""
    true = base.project(truth.parameters)
    q = run.joint_position[::10]
    v = np.gradient(q, 10 / plant.rate_hz, axis=0)
    Y = regressor(truth, q, v, np.gradient(v, 10 / plant.rate_hz, axis=0))
    torque = np.sqrt(np.mean((Y @ truth.parameters) ** 2, axis=0))
    part = np.sqrt(np.mean((base.reduce(Y) * true) ** 2, axis=0))
    share = np.max(part / torque[:, None], axis=0)
    bodies = zip(base.names, true, share, strict=True)
    return [Figure(name, x, abs(x)) for name, x, much in bodies if much > SHARE]


@dataclass(frozen=True)
class Score:
    """One figure by one way: plant, relative error, standard errors, and whether it is within."""

    plant: str
    figure: str
    way: str
    error: float
    deviations: float
    within: bool
    covered: bool

    @property
    def quantity(self) -> str:
        """The parameter of a drive without its joint, or "base parameter"."""
        name, _, joint = self.figure.partition(" of ")
        return name if joint else "base parameter"


def scores(title: str, figures: Sequence[Figure], ways: Mapping[str, Estimates]) -> list[Score]:
    """Return the figures by all ways that gave a result."""
    rows = []
    for figure in figures:
        value, error, _ = ways[REFERENCE][figure.name]
        allowed = max(FACTOR * max(abs(value - figure.truth), error), SMALL * figure.scale)
        for way, estimates in ways.items():
            value, error, (lower, upper) = estimates[figure.name]
            off = value - figure.truth
            within, covered = abs(off) <= allowed, lower <= figure.truth <= upper
            score = off / figure.scale, off / error, within, covered
            rows.append(Score(title, figure.name, way, *score))
    return rows


def plant_table(rows: Sequence[Score], titles: Sequence[str]) -> str:
    """Return the errors of a plant's figures; a star marks those beyond what is allowed."""
    by_figure: dict[str, list[str]] = {}
    for row in rows:
        cell = f"{100 * row.error:+.2f} % ({row.deviations:+.1f}){' ' if row.within else '*'}"
        by_figure.setdefault(row.figure, [row.figure]).append(cell)
    header = ["figure: error (in standard errors)", *titles]
    return str(table(rows[0].plant, header, list(by_figure.values())))


def summary(rows: Sequence[Score], alarms: Mapping[str, list[str]], logs: int) -> str:
    """Return shares within, median errors, coverage and false alarms of each way."""
    lines = []
    for way in (*WAYS, REFERENCE):
        some = [row for row in rows if row.way == way]
        within, covered = ([getattr(x, key) for x in some] for key in ("within", "covered"))
        cells = [way, str(len(some)), str(within.count(False)), f"{np.mean(within):.1%}"]
        cells += [percent(float(np.mean(covered)))]
        cells += [percent(float(np.median([abs(row.error) for row in some])))]
        lines.append([*cells, str(len(alarms.get(way, [])))])
    header = ["way", "figures", "beyond", "within", "coverage", "median error", "false alarms"]
    return str(table(f"All plants, {logs} logs", header, lines))


def coverage_table(rows: Sequence[Score]) -> str:
    """Return the coverage of 95 % intervals and the mean deviation of each quantity."""
    quantities = dict.fromkeys(row.quantity for row in rows)
    lines = []
    for quantity in quantities:
        cells = [quantity]
        for way in (*WAYS, REFERENCE):
            some = [row for row in rows if row.way == way and row.quantity == quantity]
            if not some:  # refused
                cells.append("-")
                continue
            covered = float(np.mean([row.covered for row in some]))
            mean = 100 * float(np.mean([row.error for row in some]))
            cells.append(f"{percent(covered)} ({mean:+.2f} %)")
        lines.append(cells)
    header = ["coverage (mean error)", *WAYS, REFERENCE]
    return str(table("By quantity", header, lines))


def examined(
    plant: Plant, run: Run, title: str, seed: int, folder: Path, alarms: dict[str, list[str]]
) -> list[Score]:
    """Return the scores of a plant with the noise of a seed, and print their table."""
    offsets = write_files(plant, run, seed, folder)
    robot = seaid.load_robot(folder / "robot.urdf", folder / "drives.toml")
    truth = seaid.load_robot(folder / "truth.urdf", folder / "drives.toml")
    log = seaid.read_log(folder / "run.csv", robot)
    base = seaid.base_parameters(robot)
    ways: dict[str, Estimates] = {}
    cutoffs = []
    for way, options in WAYS.items():
        try:
            result = seaid.identify(robot, log, **options)
        except seaid.SeaidError as refusal:
            cutoffs.append(f"{way} is refused: {refusal}")
            continue
        ways[way] = estimates_of(result)
        cutoffs.append(f"{way} is {result.method} at {result.cutoff_hz:.1f} Hz")
        alarms[way] += [
            f"{title}: {x.severity} {x.code} {x.joint}: {x.message}"
            for x in result.warnings
            if x.severity != "note"
        ]
    ways[REFERENCE], cutoff_hz = reference(plant, robot, log, base)
    rows = scores(title, figures_of(plant, run, offsets, truth, base), ways)
    print(plant_table(rows, list(ways)))
    print("; ".join([*cutoffs, f"{REFERENCE} at {cutoff_hz:g} Hz"]), "\n", flush=True)
    return rows


def main(seeds: int, motion: int, only: str, folder: Path) -> None:
    """Print the tables of all plants, the findings on these right set-ups, and the summary."""
    begin, rows, logs = time.monotonic(), [], 0
    alarms: dict[str, list[str]] = {way: [] for way in WAYS}
    for plant in few([plant for plant in PLANTS if only in plant.title], 2):
        plant = replace(plant, duration_s=sized(plant.duration_s, 5.0))
        run = simulated(plant, motion)
        for seed in range(1, seeds + 1):
            title = f"{plant.title}, seed {seed}"
            place = folder / title.replace(" ", "_").replace(",", "")
            rows += examined(plant, run, title, seed, place, alarms)
            logs += 1
    for way, messages in alarms.items():
        print(f"False alarms, {way}: {len(messages)}", *messages, sep="\n  ")
    beyond = [row for row in rows if not row.within]
    print(f"\nBeyond: {len(beyond)}", *map(_line, beyond), sep="\n  ")
    print(coverage_table(rows), summary(rows, alarms, logs), sep="\n")
    print(f"{time.monotonic() - begin:.0f} s")


def _line(row: Score) -> str:
    """Return a score in a line."""
    return (
        f"{row.way}: {row.figure}, {100 * row.error:+.2f} %, {row.deviations:+.1f} standard errors "
        f"({row.plant})"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="logs of each plant")
    parser.add_argument("--motion", type=int, default=1, help="seed of the motion of each plant")
    parser.add_argument("--only", default="", help="part of the titles of the plants")
    parser.add_argument("--output", type=Path, help="folder for the files; default: none kept")
    add_quick(parser)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    with tempfile.TemporaryDirectory() as name:
        folder = arguments.output or Path(name)
        main(arguments.seeds, arguments.motion, arguments.only, folder)
