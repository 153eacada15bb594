"""Physically consistent parameters of a robot: nearest to an estimate and to a prior.

An estimate determines fewer combinations than there are standard parameters, and noise may make it
physically inconsistent. `feasible_parameters` returns the consistent robot nearest to both the
estimate and the robot file, with the weight of the prior selected by the data
(`seaid.estimation.sdp`). If no consistent robot is near the estimate, the assumption that
contradicts the data is named.

Limits of the semidefinite program are drive parameters that are not negative. Prior bodies are
those of the robot file, repaired if physically inconsistent, or balls.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from seaid._arrays import Array, finite, safely
from seaid._progress import Result, counted
from seaid.checks.values import contradictions
from seaid.drives import ParameterName, readable
from seaid.errors import Finding, IdentificationError, RobotError
from seaid.estimation import Estimate, nearest, sdp
from seaid.identification.drive_estimates import with_values
from seaid.regressor.load import LoadModel
from seaid.robot import Robot, is_physical
from seaid.robot.inertia import from_center_of_mass, from_pseudo_inertia, pseudo_inertia

_SHAPES = ("without mass", "a point mass", "a thin rod", "a flat plate")
"""Names of bodies whose pseudo-inertia has rank 0, 1, 2, 3."""


@dataclass(frozen=True, eq=False, repr=False)
class FeasibleParameters(Result):
    """A physically consistent robot and its distance from the estimate.

    Attributes
    ----------
    robot : Robot
        The robot with the consistent bodies and the identified drives.
    parameters : ndarray (10n,)
        Its standard parameters.
    names, units : tuple of str (p,)
        The combinations of parameters that were estimated.
    values, estimate : ndarray (p,)
        Their consistent and their estimated values.
    distance : ndarray (p,)
        Difference in standard errors.
    chi_square, nearest_chi_square : float
        Squared distance of all values together, and the least that consistent bodies can have.
    weight, freedom : float
        Weight of the prior, and effective number of values that the data determine.
    active_bounds : tuple of str
        The constraints that are active at the `parameters`.
    notes : tuple of str
        Replacements for missing or inconsistent values of the prior.
    warnings : tuple of Finding
        Assumptions that the data contradict, such as a payload.
    """

    table_name = "feasible_text"

    robot: Robot
    parameters: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    estimate: Array
    distance: Array
    chi_square: float
    nearest_chi_square: float
    weight: float
    freedom: float
    active_bounds: tuple[str, ...]
    notes: tuple[str, ...]
    warnings: tuple[Finding, ...] = ()

    def _in_short(self) -> str:
        distance = f"chi-square {self.chi_square:.3g} over {counted(len(self.values), 'value')}"
        bounds = counted(len(self.active_bounds), "active bound")
        return f"'{self.robot.name}': {distance}, {bounds}"


def feasible_parameters(
    robot: Robot,
    model: LoadModel,
    load_side: Estimate,
    drives: Mapping[str, Estimate] | None = None,
    *,
    prior: Array | None = None,
    weight: float | None = None,
    white_covariance: Array | None = None,
) -> FeasibleParameters:
    """Return the physically consistent parameters nearest to an estimate and to a prior.

    Parameters
    ----------
    robot : Robot
        The robot. Its payloads are no part of the bodies, and its known bodies stay as they are.
    model, load_side : LoadModel, Estimate
        The model of the load side, and the estimate of its columns; with both sides estimated at
        once also those of elastic drives as '<parameter> of <joint>'.
    drives : mapping {joint: Estimate}, optional
        Estimates of elastic drives that are not in `load_side`.
    prior : ndarray (10n,), optional
        Standard parameters, by default the robot's; a body without (NaN) gets a ball of 1 kg as
        large as its link.
    weight : float, optional
        Weight of the prior in units of chi-square. Default: selected by the data. With 0 it
        determines only what the data leave free.
    white_covariance : ndarray (p, p), optional
        Covariance of `load_side` for white noise, a floor for its covariance.

    Returns
    -------
    FeasibleParameters

    Raises
    ------
    IdentificationError
        For an estimate that is not finite, and if the program cannot be solved.
    """
    if white_covariance is not None:
        floored = sdp.floored_covariance(load_side.covariance, white_covariance)
        load_side = replace(load_side, covariance=floored)
    of_drives = [drive.at(joint) for joint, drive in (drives or {}).items()]
    known = Estimate.joined([load_side, *of_drives])
    finite("the estimate", known.values, (None,), IdentificationError)
    bodies, notes = prior_bodies(robot, robot.parameters if prior is None else prior)
    program, words = body_program(robot, model, known, bodies)
    bound = nearest(program)
    if weight is None:
        point = sdp.of_least_risk(program, bound.chi_square)
    else:
        point = sdp.regularised(program, max(weight, sdp.WEIGHTS[-1]))
    consistent = _robot(robot, model, known, point)
    return FeasibleParameters(
        robot=consistent,
        parameters=consistent.parameters,
        names=known.names,
        units=known.units,
        values=point.values,
        estimate=known.values,
        # root root^T is the covariance: the norms of its rows are the standard errors.
        distance=(point.values - known.values) / np.linalg.norm(program.root, axis=1),
        chi_square=point.chi_square,
        nearest_chi_square=bound.chi_square,
        weight=point.weight,
        freedom=point.effective_parameters,
        active_bounds=_active_bounds(robot, point, words),
        notes=notes,
        warnings=tuple(contradictions(robot, program, bound.chi_square)),
    )


def _robot(robot: Robot, model: LoadModel, known: Estimate, point: sdp.FeasiblePoint) -> Robot:
    """Return the robot with consistent bodies, known ones as they are, and identified drives."""
    m, names = robot.parameters.size, dict(zip(known.names, point.values, strict=True))
    for (joint, name, _), value in zip(model.absorbed, point.unknowns[m:], strict=False):
        names[ParameterName(name, joint)] = value
    drives = {}
    for joint, drive in robot.drives.items():
        own = {name.quantity: value for name, value in names.items() if name.owner == joint}
        drives[joint] = with_values(drive, own)
    bodies = np.where(robot.is_known, robot.parameters, point.unknowns[:m])
    return robot.with_values(bodies, drives)


def _active_bounds(robot: Robot, point: sdp.FeasiblePoint, words: list[str]) -> tuple[str, ...]:
    """Describe the constraints that are active at a feasible point."""
    shapes = [
        f"{body} is {_SHAPES[rank]}"
        for body, rank in zip(robot.body_names, point.ranks, strict=True)
        if rank < 4
    ]
    return tuple(dict.fromkeys([*shapes, *(words[index] for index in point.active_bounds)]))


BALL_MASS = 1.0
"""Mass [kg] of the ball that replaces an unknown body."""

SHIFT = 1e-3
"""Part of a ball added to a physically inconsistent or degenerate body."""

_safely = partial(safely, what="a body of the file", error=RobotError)

_DEGENERATE = 1e-5
"""Least eigenvalue of the pseudo-inertia of a body, over that of the ball in its place, from which
it is taken as it is."""

_LEAST_RADIUS = 0.05
"""Least radius [m] of the ball that replaces an unknown body."""


def balls(robot: Robot) -> Array:
    """Return a ball of 1 kg for every body (n, 10), as large as the robot's links.

    Its centre is the middle between the body's joint and the next ones, its radius half their
    distance (the mean of the robot for a body without a next joint), at least 5 cm.
    """
    model, count = robot.model, len(robot.body_names)
    centers, radii = np.zeros((count, 3)), np.full(count, np.nan)
    parents = np.array(model.parents)
    for position, index in enumerate(robot.model_order, 1):
        ends = [
            model.jointPlacements[child].translation
            for child in np.flatnonzero(parents == position).tolist()
        ]
        # Joint frames are at the proximal end of a body: the next joints are its distal ends.
        if ends:
            centers[index] = np.mean(ends, axis=0) / 2
            radii[index] = np.mean(np.linalg.norm(ends, axis=1)) / 2
    usual = np.nanmean(radii) if np.any(np.isfinite(radii)) else 0.0
    radii = np.maximum(np.where(np.isfinite(radii), radii, usual), _LEAST_RADIUS)
    # 2/5 m r^2 of a solid ball.
    inertias = 0.4 * BALL_MASS * radii[:, None, None] ** 2 * np.eye(3)
    pairs = zip(centers, inertias, strict=True)
    return np.array([from_center_of_mass(BALL_MASS, *pair) for pair in pairs])


def prior_bodies(robot: Robot, parameters: Array) -> tuple[Array, tuple[str, ...]]:
    """Return consistent bodies (n, 10) with mass in every direction, and notes of changes.

    `parameters` (10n,) are those of the file or others. A body with NaN becomes its ball; an
    inconsistent one loses its negative part; it and a degenerate one (no mass, a point, a rod, a
    plate) get a thousandth of a ball of their mass.
    """
    bodies, notes, plain = parameters.reshape(-1, 10).copy(), [], balls(robot)
    missing = ~np.all(np.isfinite(bodies), axis=1)
    if np.any(missing):
        names = ", ".join(np.array(robot.body_names)[missing])
        notes.append(f"no values in the prior: a ball of {BALL_MASS:g} kg replaces {names}")
    masses = bodies[~missing, 0]
    usual = float(np.mean(masses[masses > 0])) if np.any(masses > 0) else BALL_MASS
    bodies[missing] = plain[missing]
    for index in np.flatnonzero(~missing).tolist():
        scaled = plain[index] * max(bodies[index, 0], 0.01 * usual)
        repaired = _repaired(bodies[index], scaled)
        if repaired is not None:
            kind = "degenerate" if is_physical(bodies[index]) else "physically inconsistent"
            notes.append(
                f"{robot.body_names[index]} is {kind} in the file: {SHIFT:g} of a ball of "
                f"{scaled[0]:.3g} kg was added"
            )
            bodies[index] = repaired
    return bodies, tuple(notes)


def _repaired(body: Array, ball: Array) -> Array | None:
    """Return a nearby consistent body for one without mass in some direction, otherwise None."""
    # Eigenvalues of L^-1 J L^-T, with the ball L L^T: those of J itself would mix kg, kg m, kg m^2.
    half = _safely(np.linalg.cholesky, pseudo_inertia(ball))
    inverse = _safely(np.linalg.inv, half)
    spread, vectors = _safely(np.linalg.eigh, inverse @ pseudo_inertia(body) @ inverse.T)
    if spread[0] >= _DEGENERATE:
        return None
    # J' = L V (max(s, 0) + shift) V^T L^T.
    root = half @ vectors * np.sqrt(np.maximum(spread, 0.0) + SHIFT)
    return from_pseudo_inertia(root @ root.T)


NON_NEGATIVE = ("viscous_friction", "coulomb_friction", "motor_inertia", "stiffness")
"""Parameters of drives that cannot be negative."""


def body_program(
    robot: Robot, model: LoadModel, known: Estimate, bodies: Array
) -> tuple[sdp.Program, list[str]]:
    """Return the program, and the description of each inequality as an active bound.

    Unknowns: the standard parameters, the parameters of stiff drives that the base parameters
    absorb, the other drive parameters.
    """
    m, absorbed = robot.parameters.size, len(model.absorbed)
    columns, pivots, drive_rows = _columns(model, known, m)
    root = sdp.covariance_root(known.covariance, known.values)
    # An absorbed parameter adds `absorption` times itself to base parameters, as an inertia does:
    # the largest inertia over this factor is its natural size.
    largest = np.max(np.abs(model.absorption), axis=0, initial=0.0)
    names = [ParameterName(name, joint) for joint, name, _ in model.absorbed]
    names += [known.names[row] for row in drive_rows]
    sizes = np.append(np.max(bodies[:, 4:]) / largest, np.linalg.norm(root, axis=1)[drive_rows])
    values = np.append(np.zeros(absorbed), known.values[drive_rows])
    signed = np.array([name.quantity in NON_NEGATIVE for name in names], dtype=bool)
    limited = np.flatnonzero(signed)
    limits = np.zeros((len(limited), columns.shape[1]))
    limits[range(len(limited)), m + limited] = 1 / sizes[limited]
    program = sdp.Program(
        columns=columns,
        pivots=pivots,
        estimate=known.values,
        root=root,
        prior=bodies,
        limits=limits,
        bounds=np.zeros(len(limited)),
        # Strictly inside: an interior-point method cannot start on a bound.
        start=np.append(bodies, np.where(signed, np.maximum(values, 0.1 * sizes), values)),
    )
    return program, [f"{readable(names[place])} is zero" for place in limited.tolist()]


def _columns(model: LoadModel, known: Estimate, m: int) -> tuple[Array, tuple[int, ...], list[int]]:
    """Return the columns of all unknowns in the estimate, its pivots, and the rows of drives."""
    start = m + len(model.absorbed)
    base = [known.names.index(name) for name in model.expressions]
    rows = [known.names.index(name) for name in model.names]
    drive_rows = [row for row in range(len(known.names)) if row not in base]
    columns = np.zeros((len(known.names), start + len(drive_rows)))
    # estimate = columns @ unknowns: (14) with the standard parameters, what the absorbed ones add,
    # and the other drive parameters by themselves.
    columns[base, :m] = model.base.grouping
    columns[rows, m:start] = model.absorption
    columns[drive_rows, range(start, columns.shape[1])] = 1.0
    # Each estimated value has one unknown with the column of an identity matrix, its pivot.
    pivots = np.empty(len(known.names), dtype=int)
    pivots[base] = model.base.columns
    pivots[drive_rows] = range(start, columns.shape[1])
    return columns, tuple(map(int, pivots)), drive_rows
