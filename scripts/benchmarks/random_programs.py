"""Random semidefinite programs of robots, solved by seaid and by Clarabel.

Everything about a program follows from its number: the robot, the known bodies, the estimate with
its covariance, and the bounds. The programs cover all that users can cause, and more: standard
errors from 1e-6 to 1000 times a value, combinations known up to 1e5 times better than others,
payloads that are not on the robot, bounds that allow a single mass or contradict the data.

`outcome` solves one program, and compares the smallest chi-square with that of Clarabel. Results
are appended to one file per kernel of OpenBLAS (OPENBLAS_CORETYPE), so that a run can be continued.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import clarabel
import numpy as np
from scipy import sparse

import seaid
from scripts.example_robots import example_urdf
from seaid._arrays import Array
from seaid.drives import StiffDrive
from seaid.errors import SeaidError
from seaid.estimation import Estimate, nearest
from seaid.estimation.sdp import (
    BARRIER,
    FeasiblePoint,
    Program,
    floored_covariance,
    of_least_risk,
    regularised,
)
from seaid.identification.consistency import body_program, prior_bodies
from seaid.regressor import base_parameters
from seaid.regressor.load import LoadModel, load_model
from seaid.robot import is_physical
from seaid.robot.inertia import from_center_of_mass, from_pseudo_inertia, pseudo_inertia

MODELS = Path(__file__).resolve().parents[2] / "models"
ROBOTS = ("leg", "stiff leg", "stiff knee", "arm", "UR10", "Panda")
BOUNDS = ("none", "none", "tight", "given", "contradictory")
ERRORS = ("noise", "noise", "wrong", "payload", "missing payload")
AGREEMENT = 1e-6
"""Relative accuracy of Clarabel's objective: its tolerances are 1e-8 of each of many terms."""

_LEAST_WIDTH, _LENGTH = 1e-9, 0.1
"""Least half width of bounds, relative or [m], and the natural size of a centre of mass [m]."""

PRIORS = ("file", "distorted", "none", "degenerate")


@dataclass(frozen=True)
class Kind:
    """The number of a program, and its kind in words."""

    number: int
    robot: str
    prior: str
    error: str
    bounds: str
    variance: float


@dataclass(frozen=True, eq=False)
class Case(Kind):
    """A program and its kind."""

    program: Program


@cache
def robot_named(name: str) -> seaid.Robot:
    """Return one of `ROBOTS`."""
    if name == "UR10":
        return seaid.load_robot(example_urdf("ur10_robot.urdf"))
    if name == "Panda":
        arm = [f"panda_joint{number}" for number in range(1, 8)]
        return seaid.load_robot(example_urdf("panda.urdf"), joints=arm)
    urdf = MODELS / ("philips_arm.urdf" if name == "arm" else "tulip_leg.urdf")
    if name == "leg":
        return seaid.load_robot(urdf, drives=MODELS / "tulip_leg.toml")
    joints = ["knee_pitch", "ankle_pitch"] if name == "stiff knee" else None
    robot = seaid.load_robot(urdf, joints=joints)
    drive = StiffDrive(gear_ratio=50.0)
    return seaid.load_robot(urdf, dict.fromkeys(robot.joint_names, drive), joints=joints)


@cache
def model_of(name: str) -> LoadModel:
    """Return the load model of one of `ROBOTS`."""
    robot = robot_named(name)
    return load_model(robot, base_parameters(robot), robot.joint_names)


def random_case(number: int) -> Case:
    """Return the program with this number."""
    rng = np.random.default_rng(number)
    name, prior = str(rng.choice(ROBOTS)), str(rng.choice(PRIORS))
    error, bounds = str(rng.choice(ERRORS)), str(rng.choice(BOUNDS))
    variance = float(10 ** rng.uniform(-12, 6))
    robot, model = robot_named(name), model_of(name)
    estimate, white = _estimate(robot, model, error, variance, rng)
    known = estimate
    if rng.random() < 0.3:
        spread = floored_covariance(known.covariance, white)
        known = Estimate(known.names, known.values, spread, known.units, 1.0, 1.0)
    bodies, _ = prior_bodies(robot, _prior(robot, prior, rng))
    program, _ = body_program(robot, model, known, bodies)
    program = _with_bounds(program, *_bounds(robot, bounds, rng))
    return Case(number, name, prior, error, bounds, variance, program)


def _estimate(
    robot: seaid.Robot, model: LoadModel, error: str, variance: float, rng: np.random.Generator
) -> tuple[Estimate, Array]:
    """Return an estimate of the truth, and its covariance for white noise."""
    bodies = robot.parameters.copy()
    if "payload" in error:
        place = slice(10 * (body := int(rng.integers(robot.n))), 10 * body + 10)
        sign = 1.0 if error == "missing payload" else -1.0
        mass, centre = 10 ** rng.uniform(-1, 1.3), rng.uniform(-0.2, 0.2, 3)
        bodies[place] += sign * from_center_of_mass(mass, centre, np.zeros((3, 3)))
    friction = np.abs(rng.normal(size=len(model.drives))) * 0.1
    values = np.append(model.base.project(bodies), friction)
    values = values + model.absorption @ np.abs(rng.normal(size=len(model.absorbed))) * 0.1
    p, worst = len(values), rng.uniform(0, 10)
    turn = np.linalg.qr(rng.normal(size=(p, p)))[0]
    half = turn * 10 ** (-rng.uniform(0, worst, p) / 2)
    half *= np.sqrt(variance) * (np.abs(values) + 1e-3)[:, None]
    size = 10 ** rng.uniform(0, 4) if error == "wrong" else 1.0
    off = size * half @ rng.normal(size=p)
    white = half * 10 ** rng.uniform(-1, 1, p)
    covariances = half @ half.T, white @ white.T + 1e-12 * np.diag(np.diag(half @ half.T))
    return Estimate(model.names, values + off, covariances[0], model.units, 1.0, 1.0), covariances[
        1
    ]


def _prior(robot: seaid.Robot, prior: str, rng: np.random.Generator) -> Array:
    """Return the standard parameters of a robot file: right, wrong, missing or degenerate."""
    parameters = robot.parameters
    if prior == "none":
        return np.full_like(parameters, np.nan)
    if prior == "distorted":
        return distorted(robot, rng, float(10 ** rng.uniform(-2, 0)))
    bodies = parameters.reshape(-1, 10).copy()
    if prior == "degenerate":
        body = int(rng.integers(robot.n))
        bodies[body, 4:] = 0.0
        bodies[body] *= rng.integers(2)
    return bodies.ravel()


def distorted(robot: seaid.Robot, rng: np.random.Generator, size: float = 0.1) -> Array:
    """Return standard parameters that are physically consistent, and wrong by about `size`."""
    bodies = []
    for body in robot.parameters.reshape(-1, 10):
        change = np.eye(4)
        change[:3, :3] += size * rng.normal(size=(3, 3))
        change[:3, 3] = 0.1 * size * rng.normal(size=3)
        pseudo = change @ pseudo_inertia(body) @ change.T
        bodies.append(from_pseudo_inertia(pseudo * np.exp(size * rng.normal())))
    return np.concatenate(bodies)


Bounds = Mapping[int, tuple[Array, Array]]
"""The lower and the upper bounds of some bodies."""


def _bounds(robot: seaid.Robot, bounds: str, rng: np.random.Generator) -> tuple[Bounds, Bounds]:
    """Return bounds of the mass (1,) and of the centre of mass (3,) of some bodies."""
    masses: dict[int, tuple[Array, Array]] = {}
    boxes: dict[int, tuple[Array, Array]] = {}
    if bounds == "none":
        return masses, boxes
    for index, body in enumerate(robot.parameters.reshape(-1, 10)):
        mass, centre = body[:1], body[1:4] / body[0]
        width = 0.0 if bounds == "given" else 10 ** rng.uniform(-6, -1)
        if bounds == "contradictory":
            mass = mass * 10 ** rng.uniform(-2, 2)
            centre = centre + rng.uniform(-1, 1, 3)
        # a single value is a bound of some width, since the program needs an interior
        if rng.random() < 0.5:
            wide = max(width, _LEAST_WIDTH)
            masses[index] = mass * (1 - wide), mass * (1 + wide)
        if rng.random() < 0.3:
            wide = max(width, _LEAST_WIDTH)
            boxes[index] = centre - wide, centre + wide
    return masses, boxes


def _with_bounds(program: Program, masses: Bounds, boxes: Bounds) -> Program:
    """Return a program with bounds of bodies, as limits before its own, and a start inside."""
    rows, values, start = [], [], program.start.copy()
    for body, scale in enumerate(program.prior[:, 0].tolist()):
        column = 10 * body
        moved = _inside_bounds(program.prior[body], masses.get(body), boxes.get(body))
        start[column : column + 10] = moved
        for sign, bound in zip((1, -1), masses.get(body, ()), strict=False):
            row = np.zeros(len(start))
            row[column] = sign / scale
            rows.append(row)
            values.append(sign * bound[0] / scale)
        for sign, corner in zip((1, -1), boxes.get(body, ()), strict=False):
            for axis, bound in enumerate(corner):
                row = np.zeros(len(start))
                # c >= b is m c - b m >= 0, linear in the first moment m c and the mass m.
                row[column + 1 + axis] = sign / (scale * _LENGTH)
                row[column] = -sign * bound / (scale * _LENGTH)
                rows.append(row)
                values.append(0.0)
    return replace(
        program,
        limits=np.vstack([*rows, program.limits]),
        bounds=np.append(values, program.bounds),
        start=start,
    )


def _inside_bounds(
    body: Array, masses: tuple[Array, Array] | None, box: tuple[Array, Array] | None
) -> Array:
    """Return a body (10,) with the mass and the centre in the middle of bounds it is outside of."""
    pseudo = pseudo_inertia(body)
    mass, centre = body[0], body[1:4] / body[0]
    # The pseudo-inertia (Wensing et al. 2018) is m ([c; 1][c^T, 1] + [S, 0; 0, 0]), with the spread
    # S of the mass, which stays.
    spread = pseudo[:3, :3] / mass - np.outer(centre, centre)
    if masses is not None and not masses[0][0] < mass < masses[1][0]:
        mass = (masses[0][0] + masses[1][0]) / 2
    if box is not None:
        inside = (box[0] < centre) & (centre < box[1])
        centre = np.where(inside, centre, (box[0] + box[1]) / 2)
    column = np.append(centre, 1.0)
    pseudo = mass * np.outer(column, column)
    pseudo[:3, :3] += mass * spread
    return from_pseudo_inertia(pseudo)


@dataclass(frozen=True)
class ConeOptimum:
    """Clarabel's result for a program: its status and the smallest chi-square + weight tr Q.

    `feasible` is the objective after its point was moved towards the start of the program until it
    is inside all cones, and so is not below the optimum. `objective` is too low if its point is
    outside a cone.
    """

    status: str
    objective: float
    feasible: float

    @property
    def ends_well(self) -> bool:
        """Return whether it is solved, to a millionth, at its own point."""
        apart = abs(self.feasible - self.objective)
        return self.status == "Solved" and apart < AGREEMENT * (1 + abs(self.objective))


def cone_optimum(program: Program, weight: float) -> ConeOptimum:
    """Solve the semidefinite program by Clarabel: smallest chi-square + weight times the trace."""
    p, f = program.columns.shape
    (first, blocks), (offset, matrix) = program.cones, program.slack
    columns, rows = np.tril_indices(4)
    root = np.where(rows == columns, 1.0, np.sqrt(2))
    A = [-matrix, *(-(block[:, rows, columns] * root).T for block in blocks)]
    b = np.concatenate([offset, *(body[rows, columns] * root for body in first)])
    options = clarabel.DefaultSettings()
    options.verbose = False
    cones = [clarabel.PSDTriangleConeT(4)] * len(first)
    if len(offset):
        cones = [clarabel.NonnegativeConeT(len(offset)), *cones]
    quadratic = sparse.diags(np.where(np.arange(f) < p, 2.0, 0.0), format="csc")
    linear = weight * np.einsum("nfii->f", blocks)
    solver = clarabel.DefaultSolver(
        quadratic, linear, sparse.csc_matrix(np.vstack(A)), b, cones, options
    )
    try:
        solution = solver.solve()
    except BaseException as problem:  # a panic of Clarabel, in Rust, is not an Exception
        if type(problem).__name__ != "PanicException":
            raise
        return ConeOptimum("Panic", np.nan, np.inf)
    x = np.array(solution.x)
    if not np.all(np.isfinite(x)):
        return ConeOptimum(str(solution.status), np.nan, np.inf)
    start, part = program.coordinates(program.start), 0.0
    for decade in range(-14, 1):
        if _is_inside(program, (1 - part) * x + part * start):
            break
        part = 10.0**decade
    inside = objective(program, (1 - part) * x + part * start, weight)
    return ConeOptimum(str(solution.status), objective(program, x, weight), inside)


def _is_inside(program: Program, x: Array) -> bool:
    (first, blocks), (offset, matrix) = program.cones, program.slack
    bodies = first + np.tensordot(x, blocks, (0, 1))
    return bool(
        np.min(np.linalg.eigvalsh(bodies)) >= 0 and np.min(offset + matrix @ x, initial=0) >= 0
    )


def objective(program: Program, x: Array, weight: float) -> float:
    """Return chi-square + weight times the trace of all bodies in units of the prior."""
    first, blocks = program.cones
    u = x[: len(program.estimate)]
    trace = np.einsum("nii->", first) + x @ np.einsum("nfii->f", blocks)
    return float(u @ u + weight * trace)


@dataclass(frozen=True)
class Outcome(Kind):
    """The result of a program: "solved", or the type of exception and its message.

    `apart` and `worse` are differences of the objective of `nearest` from Clarabel's, beyond those
    explained by weight and barrier, relative to 1 + Clarabel's objective. `worse` compares with the
    feasible point of Clarabel, in all programs. `apart` is None unless Clarabel ends well.
    """

    result: str
    words: str
    chi_square: float
    seconds: float
    clarabel: str
    worse: float
    apart: float | None


def outcome(number: int, choose_every: int = 10) -> Outcome:
    """Solve a program: nearest, with a random weight, and every tenth with that of the data."""
    case = random_case(number)
    program = case.program
    weight = float(10 ** np.random.default_rng([number, 1]).uniform(-6, 4))
    result, words, chi_square, worse, apart = "solved", "", np.nan, 0.0, None
    begin = time.process_time()
    status = ""
    try:
        found = nearest(program)
        others = [regularised(program, weight)]
        if number % choose_every == 0:
            others.append(of_least_risk(program, found.chi_square))
        seconds = time.process_time() - begin
        if not all(_is_possible(program, one) for one in (found, *others)):
            result = "inconsistent"
        chi_square = found.chi_square
        theirs = cone_optimum(program, found.weight)
        x = np.concatenate([found.distance, found.unknowns[list(program.free)]])
        mine = objective(program, x, found.weight)
        barrier = max(BARRIER, found.weight) if len(program.bounds) else 0.0
        gap = 4 * len(program.prior) * found.weight + barrier * len(program.bounds)
        status = theirs.status
        worse = max(0.0, mine - theirs.feasible - gap) / (1 + abs(theirs.feasible))
        if theirs.ends_well:
            apart = max(0.0, abs(mine - theirs.objective) - gap) / (1 + abs(theirs.objective))
    except SeaidError as problem:
        result, words, seconds = "refused", str(problem), time.process_time() - begin
    except Exception as problem:  # an exception that is not ours is a finding
        result, words = type(problem).__name__, str(problem)
        seconds = time.process_time() - begin
    kind = (case.robot, case.prior, case.error, case.bounds, case.variance)
    return Outcome(number, *kind, result, words, chi_square, seconds, status, worse, apart)


def _is_possible(program: Program, found: FeasiblePoint) -> bool:
    """Return whether bodies are physically consistent and bounds kept, except for rounding.

    A small body is the difference of sums as large as the largest one. Each of up to a hundred
    steps rounds the sum of its f terms.
    """
    offset, matrix = program.span
    x = np.concatenate([found.distance, found.unknowns[list(program.free)]])
    largest = np.max(np.abs(offset) + np.abs(matrix) @ np.abs(x))
    slack = program.limits @ found.unknowns - program.bounds
    sums = np.sum(np.abs(program.limits), axis=1) * largest + np.abs(program.bounds)
    rounding = 100 * len(x) * np.finfo(float).eps * sums
    bodies = found.unknowns[: program.prior.size].reshape(-1, 10)
    return all(is_physical(body, 1e-15) for body in bodies) and bool(np.all(slack >= -rounding))


def kernel() -> str:
    """Return the name of the requested kernel of OpenBLAS."""
    return os.environ.get("OPENBLAS_CORETYPE", "default")


def run(count: int, folder: Path) -> None:
    """Append the outcomes of programs 0 to count - 1 that are not in the folder yet."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"programs_{kernel()}.jsonl"
    done = {one.number for one in read(path)}
    with path.open("a") as file:
        for number in range(count):
            if number not in done:
                file.write(json.dumps(asdict(outcome(number))) + "\n")
                file.flush()


def read(path: Path) -> list[Outcome]:
    """Return the outcomes in a file, none if it does not exist."""
    if not path.exists():
        return []
    return [Outcome(**json.loads(line)) for line in path.read_text().splitlines()]


def summary(name: str, outcomes: Sequence[Outcome]) -> list[str]:
    """Return the table row of a kernel."""
    solved = [one for one in outcomes if one.result == "solved"]
    refused = sum(one.result == "refused" for one in outcomes)
    apart = [one.apart for one in solved if one.apart is not None]
    return [
        name,
        f"{len(outcomes)}",
        f"{len(solved)}",
        f"{refused}",
        f"{len(outcomes) - len(solved) - refused}",
        f"{len(apart)}",
        f"{max(apart, default=np.nan):.1g}",
        f"{max((one.worse for one in solved), default=np.nan):.1g}",
        f"{np.median([one.seconds for one in outcomes]):.3f}",
        f"{max(one.seconds for one in outcomes):.2f}",
    ]


HEADER = [
    "kernel",
    "programs",
    "solved",
    "refused by us",
    "other exception",
    "Clarabel ends well",
]
HEADER += ["largest difference", "largest excess", "median [s]", "longest [s]"]
