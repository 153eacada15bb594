"""Physically consistent parameters of a robot: nearest to an estimate and to a prior.

An estimate determines fewer combinations than there are standard parameters, and noise may make it
physically inconsistent. `feasible_parameters` returns the consistent robot nearest to both the
estimate and the robot file, with the weight of the prior selected by the data
(`seaid.estimation.feasible`). If no consistent robot is near the estimate, the assumption that
contradicts the data is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from seaid._arrays import Array, finite
from seaid._progress import Result, counted
from seaid.drives import JointParameter
from seaid.errors import Finding, IdentificationError
from seaid.estimation import (
    WEIGHTS,
    Estimate,
    FeasiblePoint,
    Program,
    floored_covariance,
    nearest,
    regularised,
    with_selected_weight,
)
from seaid.identification.consistency_program import (
    NON_NEGATIVE,
    Boxes,
    MassBounds,
    body_limits,
    body_program,
    interior_start,
    prior_bodies,
)
from seaid.identification.drive_estimates import with_values
from seaid.regressor import LoadModel
from seaid.robot import Robot

_DEVIATIONS = 10.0
"""Standard deviations of chi-square above its mean from which data and assumptions contradict."""

_EXPLAINED = 0.9
"""Part of chi-square that an assumption must explain to be named."""


def contradiction(robot: Robot, program: Program, least: float, bounds: int) -> Finding | None:
    """Return the assumption that the data contradict, None if chi-square `least` is plausible.

    `least` is the least chi-square of a program whose first `bounds` limits are those of the user.
    Each payload, all of them, and the bounds are removed in turn: the one that reduces chi-square
    most is named. Raises as `nearest` does.
    """
    count = len(program.estimate)
    if least <= count + _DEVIATIONS * np.sqrt(2.0 * count):
        return None
    text = (
        f"no physically consistent robot comes near the estimate: chi-square is at least "
        f"{least:.3g} over {count} values"
    )
    found = [
        (nearest(without).chi_square, words)
        for words, without in _assumptions(robot, program, bounds)
    ]
    smallest, words = min(found, default=(least, ""))
    if smallest < (1 - _EXPLAINED) * least:
        return Finding("inconsistent-inertia", f"{text}, and {smallest:.3g} without {words}")
    known = f"known bodies ({', '.join(robot.known_bodies)}), " if robot.known_bodies else ""
    return Finding(
        "inconsistent-inertia",
        f"{text}; check {known}missing payloads, encoder offsets, and lengths and axes in the "
        "robot file",
        certainty="possible",
    )


def _assumptions(robot: Robot, program: Program, bounds: int) -> Iterator[tuple[str, Program]]:
    """Yield each assumption with its remedy, and the program without it."""
    payloads = robot.payload_parameters.reshape(-1, 10)
    loaded = np.flatnonzero(payloads[:, 0]).tolist()
    for bodies in [[body] for body in loaded] + ([loaded] if len(loaded) > 1 else []):
        one = np.zeros_like(payloads)
        one[bodies] = payloads[bodies]
        each = " and ".join(
            f"the payload of {payloads[body, 0]:.4g} kg on {robot.body_names[body]}"
            for body in bodies
        )
        yield f"{each}: check that it is on the robot, its mass and its place", _off(program, one)
    if bounds:
        limits, values = program.limits[bounds:], program.bounds[bounds:]
        yield (
            "mass_bounds= and com_boxes=: check or remove them",
            replace(program, limits=limits, bounds=values),
        )


def _off(program: Program, payloads: Array) -> Program:
    """Return the program for a robot without payloads (n, 10), the bodies having their torque."""
    propagated = program.columns[:, : payloads.size] @ payloads.ravel()
    return replace(program, estimate=program.estimate + propagated)


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
        Assumptions that the data contradict: a payload, or bounds.
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
    mass_bounds: MassBounds | None = None,
    com_boxes: Boxes | None = None,
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
    mass_bounds : mapping {body: (least, most)}, optional
        Bounds of masses [kg].
    com_boxes : mapping {body: (lower, upper)}, optional
        Corners [m] of a box with the centre of mass, in the body's frame.
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
        For infeasible bounds, for estimates that do not fit the model, and if the program cannot be
        solved.
    RobotError
        For a prior of another shape.
    """
    if white_covariance is not None:
        size = len(load_side.names)
        white = finite("white_covariance", white_covariance, (size, size), IdentificationError)
        load_side = replace(load_side, covariance=floored_covariance(load_side.covariance, white))
    known = _together(model, load_side, drives or {})
    bodies, notes = prior_bodies(robot, robot.parameters if prior is None else prior)
    masses, boxes = mass_bounds or {}, com_boxes or {}
    limits = body_limits(robot, bodies, masses, boxes)
    start = interior_start(robot, bodies, masses, boxes)
    for body in robot.known_bodies:
        if body in {**masses, **boxes}:
            raise IdentificationError(f"'{body}' is a known body: it has no bounds")
    program, words = body_program(robot, model, known, bodies, limits, start)
    bound = nearest(program)
    contradicted = contradiction(robot, program, bound.chi_square, len(limits))
    found = _weighted(program, weight, bound.chi_square)
    return FeasibleParameters(
        robot=_robot(robot, model, known, found),
        parameters=_bodies(robot, found),
        names=known.names,
        units=known.units,
        values=found.values,
        estimate=known.values,
        distance=(found.values - known.values) / np.linalg.norm(program.root, axis=1),
        chi_square=found.chi_square,
        nearest_chi_square=bound.chi_square,
        weight=found.weight,
        freedom=found.freedom,
        active_bounds=_active_bounds(robot, found, words),
        notes=notes,
        warnings=() if contradicted is None else (contradicted,),
    )


def _together(model: LoadModel, load_side: Estimate, drives: Mapping[str, Estimate]) -> Estimate:
    """Return all estimates as one, those of the drives as '<parameter> of <joint>'."""
    missing = [name for name in model.names if name not in load_side.names]
    if missing:
        raise IdentificationError(
            f"the estimate of the load side lacks {', '.join(missing)}: give the one that has the "
            "columns of the model"
        )
    parts = [load_side, *drives.values()]
    names = [*load_side.names]
    names += [JointParameter(name, joint) for joint, one in drives.items() for name in one.names]
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise IdentificationError(f"estimated twice, in load_side and in drives: {twice}")
    return replace(
        load_side,
        names=tuple(names),
        values=finite(
            "the estimate",
            np.concatenate([one.values for one in parts]),
            (None,),
            IdentificationError,
        ),
        covariance=finite(
            "the covariance of the estimate",
            linalg.block_diag(*(one.covariance for one in parts)),
            (None, None),
            IdentificationError,
        ),
        units=tuple(unit for one in parts for unit in one.units),
        white_standard_errors=None,
        degrees_of_freedom=None,
    )


def _weighted(program: Program, weight: float | None, least: float) -> FeasiblePoint:
    if weight is None:
        return with_selected_weight(program, least)
    if not (np.isfinite(weight) and weight >= 0):
        raise IdentificationError(
            f"weight= must be zero or more and finite (None: selected), found {weight}"
        )
    return regularised(program, max(weight, WEIGHTS[-1]))


def _bodies(robot: Robot, found: FeasiblePoint) -> Array:
    """Return the standard parameters (10n,) of a feasible point, known ones as they are."""
    return np.where(robot.is_known, robot.parameters, found.unknowns[: robot.parameters.size])


def _robot(robot: Robot, model: LoadModel, known: Estimate, found: FeasiblePoint) -> Robot:
    """Return the robot with consistent bodies and the identified drives."""
    m, names = robot.parameters.size, dict(zip(known.names, found.values, strict=True))
    for (joint, name, _), value in zip(model.absorbed, found.unknowns[m:], strict=False):
        names[JointParameter(name, joint)] = value
    drives = dict(robot.drives)
    for joint, drive in drives.items():
        own = {
            name.parameter: _rounded(name.parameter, value)
            for name, value in names.items()
            if isinstance(name, JointParameter) and name.joint == joint
        }
        drives[joint] = with_values(drive, own)
    return robot.with_values(_bodies(robot, found), drives)


def _rounded(name: str, value: float) -> float:
    """Return the value of a drive's parameter, or zero if rounding made it negative."""
    return max(value, 0.0) if name in NON_NEGATIVE else value


def _active_bounds(robot: Robot, found: FeasiblePoint, words: list[str]) -> tuple[str, ...]:
    """Describe the constraints that are active at a feasible point."""
    shapes = [
        f"{body} is {_SHAPES[rank]}"
        for body, rank in zip(robot.body_names, found.ranks, strict=True)
        if rank < 4
    ]
    return tuple(dict.fromkeys([*shapes, *(words[index] for index in found.active_bounds)]))
