"""Possible bodies of a robot: what an estimate says, made physically possible body by body.

An estimate tells fewer combinations than there are standard parameters; noise may put it where no
body can be. `feasible_parameters` returns the physically possible robot nearest to both the
estimate and the robot file, the weight between them chosen by the data
(`seaid.estimation.feasible`).

Where no physically consistent bodies come near an estimate: which assumption is to blame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from seaid._arrays import Array, finite
from seaid.errors import IdentificationError
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
from seaid.identification.drive_estimates import with_values
from seaid.identification.physical.problem import (
    NON_NEGATIVE,
    Boxes,
    MassBounds,
    body_limits,
    body_program,
    interior_start,
    prior_bodies,
)
from seaid.regressor import LoadModel
from seaid.robot import Robot

_DEVIATIONS = 10.0
"""Standard deviations of chi-square above its mean from which data and assumptions contradict."""

_EXPLAINED = 0.9
"""Part of chi-square that an assumption must explain to be named as the one to blame."""


def contradiction(robot: Robot, program: Program, least: float, bounds: int) -> str | None:
    """Say what the data contradict, None where bodies come as near as errors of `least` explain.

    `least` is the least chi-square of a program whose first `bounds` limits are those of a user.
    Each payload, all of them, and the bounds are left out in turn: what takes most of chi-square
    away is named. Raises as `nearest` does.
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
        return f"{text}, and {smallest:.3g} without {words}"
    known = f"known bodies ({', '.join(robot.known_bodies)}), " if robot.known_bodies else ""
    return (
        f"{text}; check {known}payloads that are missing, encoder zeros, and lengths and axes in "
        "the robot file"
    )


def _assumptions(robot: Robot, program: Program, bounds: int) -> Iterator[tuple[str, Program]]:
    """Return what may be wrong, in words with the remedy, and the program without it."""
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
            "mass_bounds= and com_boxes=: check them, or leave them out",
            replace(program, limits=limits, bounds=values),
        )


def _off(program: Program, payloads: Array) -> Program:
    """Return the program for a robot without payloads (n, 10): its bodies carry their torque."""
    propagated = program.columns[:, : payloads.size] @ payloads.ravel()
    return replace(program, estimate=program.estimate + propagated)


_SHAPES = ("without mass", "a point mass", "a thin rod", "a flat plate")
"""What a body is whose pseudo-inertia has rank 0, 1, 2, 3."""


@dataclass(frozen=True, eq=False)
class FeasibleParameters:
    """A possible robot and how far it is from the estimate.

    `robot` has the possible bodies, their `parameters` (10n,), and the drives found. `names`,
    `units`, `values` (p,) and `estimate` (p,) are the combinations that the estimate tells, here
    and there; `distance` (p,) their difference in standard errors; `chi_square` that of all
    together, `nearest_chi_square` the least that possible bodies can have.

    `weight` is that of the prior, `freedom` how many of the p values the data decide beside it.
    `held` says in words what holds the estimate back, `notes` what stands for missing values of
    the file, `flags` what the data contradict: a payload that is not on the robot, bounds.
    """

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
    flags: tuple[str, ...] = ()


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
    """Return the possible bodies nearest to an estimate of the load side and to a prior.

    `load_side` has the columns of `model`, and those of elastic drives as '<parameter> of <joint>'
    where both sides were estimated at once; `drives` {joint: Estimate} are estimates of elastic
    drives beside it. `prior` (10n,) are standard parameters, by default the robot's; a body
    without (NaN) gets a ball of 1 kg as large as its link. Payloads are no part of the bodies, and
    known bodies stay what they are.

    `mass_bounds` {body: (least, most)} [kg]; `com_boxes` {body: (lower, upper)}, corners [m] in the
    body's frame. `weight` of the prior in units of chi-square: None = chosen by the data, 0 = only
    what the data leave open is decided by it. `white_covariance` (p, p) is what the covariance of
    `load_side` would be for white noise: no combination counts as known better.

    Raises IdentificationError for bounds that no body can keep, for estimates that do not fit the
    model, and where the program is not solved; RobotError for a prior of another shape.
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
    flag = contradiction(robot, program, bound.chi_square, len(limits))
    found = _weighted(program, weight, bound.chi_square)
    return FeasibleParameters(
        robot=_robot(robot, model, known, found),
        parameters=_bodies(robot, found),
        names=known.names,
        units=known.units,
        values=found.values,
        estimate=known.values,
        distance=(found.values - known.values) / _errors(program),
        chi_square=found.chi_square,
        nearest_chi_square=bound.chi_square,
        weight=found.weight,
        freedom=found.freedom,
        active_bounds=_active_bounds(robot, bound, words),
        notes=notes,
        flags=() if flag is None else (flag,),
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
    names += [f"{name} of {joint}" for joint, one in drives.items() for name in one.names]
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
    )


def _weighted(program: Program, weight: float | None, least: float) -> FeasiblePoint:
    if weight is None:
        return with_selected_weight(program, least)
    if not (np.isfinite(weight) and weight >= 0):
        raise IdentificationError(
            f"weight= must be zero or more and finite (None: chosen by the data), found {weight}"
        )
    return regularised(program, max(weight, WEIGHTS[-1]))


def _bodies(robot: Robot, found: FeasiblePoint) -> Array:
    """Return the standard parameters (10n,) that were found, known ones as they are."""
    return np.where(robot.is_known, robot.parameters, found.unknowns[: 10 * robot.n])


def _robot(robot: Robot, model: LoadModel, known: Estimate, found: FeasiblePoint) -> Robot:
    """Return the robot with possible bodies and the drives that were found."""
    m, names = 10 * robot.n, dict(zip(known.names, found.values, strict=True))
    for (joint, name, _), value in zip(model.absorbed, found.unknowns[m:], strict=False):
        names[f"{name} of {joint}"] = value
    drives = dict(robot.drives)
    for joint, drive in drives.items():
        own = {
            (name := full.removesuffix(f" of {joint}")): _rounded(name, value)
            for full, value in names.items()
            if full.endswith(f" of {joint}") and full not in model.expressions
        }
        drives[joint] = with_values(drive, own)
    return robot.with_values(_bodies(robot, found), drives)


def _rounded(name: str, value: float) -> float:
    """Return the value of a drive's parameter, one that rounding made negative as zero."""
    return max(value, 0.0) if name in NON_NEGATIVE else value


def _errors(program: Program) -> Array:
    return np.asarray(np.linalg.norm(program.root, axis=1))


def _active_bounds(robot: Robot, bound: FeasiblePoint, words: list[str]) -> tuple[str, ...]:
    """Say what the data push against."""
    shapes = [
        f"{body} is {_SHAPES[rank]}"
        for body, rank in zip(robot.body_names, bound.ranks, strict=True)
        if rank < 4
    ]
    return tuple(dict.fromkeys([*shapes, *(words[index] for index in bound.active_bounds)]))
