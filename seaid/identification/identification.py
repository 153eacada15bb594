"""identify: the paper's two parts. Actuator side first, then the load side with its springs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, FrozenMapping
from seaid._files import write_json
from seaid.errors import IdentificationError, unknown_name
from seaid.estimation import Estimate, ModelChecks, estimator_named
from seaid.identification.datasets import Dataset, Source, datasets_of, processing_of, sources_of
from seaid.identification.drive_estimates import with_estimate
from seaid.identification.instrumental import estimate_instrumental
from seaid.identification.linearisation import linearised_robot
from seaid.identification.log_checks import check_channels, check_excitation, sign_flags
from seaid.identification.nonlinear_terms import with_fixed_flags
from seaid.identification.physical.consistency import FeasibleParameters, feasible_parameters
from seaid.identification.simultaneous import estimate_simultaneous
from seaid.identification.two_step import RobotEstimate, estimate_two_step, joints_with_torque
from seaid.log import Log, Motion, Processing, stretches
from seaid.regressor import BaseParameters, LoadModel, base_parameters, check_offset_std, load_model
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.identification.validation import Validation


METHODS = ("two-step", "simultaneous")

INSTRUMENTAL = "iv"
"""The estimator that starts from another one's estimate."""


@dataclass(frozen=True, eq=False)
class Identification:
    """What a log told about a robot.

    `drives` {joint: Estimate} has the drives' parameters; `load` the base parameters, whose
    combinations are in `base`; `robot` the robot with the found values (its standard parameters are
    the nearest to those of the file that have the found base parameters; physically possible ones
    where `possible` tells how they came about), `known` the robot as it was given, with
    a value of what bends its drives' equations. `load_side` is the whole estimate of the load side
    in the columns of `model`. `excluded` counts instants near standstill by joint, "load" for the
    load side; `checks` of the model have the same keys ("both" where both sides were estimated at
    once). `processing` tells what was done to each log before; `motions` are those of the logs in
    memory, for a look at how well they are matched (`seaid.identification.validation.compared`).
    """

    drives: Mapping[str, Estimate]
    load: Estimate
    base: BaseParameters
    robot: Robot
    known: Robot
    model: LoadModel
    load_side: Estimate
    springs: Mapping[str, Array]
    cutoff_hz: float
    excluded: Mapping[str, int]
    checks: Mapping[str, ModelChecks]
    feasible: FeasibleParameters | None = None
    processing: tuple[Processing, ...] = ()
    motions: tuple[Motion, ...] = ()

    @cached_property
    def flags(self) -> tuple[str, ...]:
        """In words, what must not be trusted."""
        estimates = (*self.drives.values(), self.load)
        flags = tuple(flag for one in estimates for flag in one.flags) + sign_flags(self)
        if self.feasible is not None:
            flags += self.feasible.flags
        return flags + tuple(flag for one in self.processing for flag in one.flags)

    def summary(self) -> str:
        """Return one table that a human reads."""
        from seaid.report import identification_table

        return identification_table(self)

    def to_dict(self, validation: Validation | None = None) -> dict[str, Any]:
        """Return the content of `parameters.json`: plain data, null for what is not there."""
        from seaid.export import content_of

        return content_of(self, validation)

    def save(self, path: str | Path, validation: Validation | None = None) -> None:
        """Write `parameters.json`, whole or not at all; `read_parameters` takes it up again."""
        write_json(path, self.to_dict(validation))


def identify(
    robot: Robot,
    logs: Source | Sequence[Source],
    *,
    torque_joints: Sequence[str] | None = None,
    method: str = "two-step",
    estimator: str = "wls",
    feasible: bool = False,
    cutoff_hz: float | None = None,
    encoder_offset_std: float = 0.0,
    executor: Executor | None = None,
    progress: bool = False,
) -> Identification:
    """Identify drives and load from one log or several.

    Part one estimates friction, stiffness and deflection offset of each elastic joint from (7);
    part two computes the load torques by (4b) and estimates the base parameters from (8), with the
    uncertainty of the springs carried along. `method` "simultaneous" goes on from there to (7) and
    (8) at once, which share the springs. Only ratios, radii, geometry, payload and what is known of
    drives and bodies of `robot` are used, and with `feasible` its inertial parameters as a prior;
    nominal values only as the start of a search.

    Parameters in which a drive's equation is not linear (a width, a Stribeck speed, a dead zone)
    are searched for first, by variable projection; of logs read in pieces the first piece is
    searched. Then they have a column and a standard error as all others.

    `logs` may be paths of files with our column names, or `open_long_log`'s: they are read in
    pieces, and with "ols" and "wls" memory does not grow with their length. `rows` names the joints
    whose torque is used on the load side (default: all that were measured). `estimator`: "ols",
    "wls" (rows weighted by joint), "huber" or "tukey" (outliers count less), or "iv" (instrumental
    variables from the fitted model, against the bias of noise in the regressor; sequential only).
    `feasible`: `Identification.robot` then has the physically possible bodies nearest to the
    estimate and the robot's own, see `feasible_parameters`. `cutoff_hz` is the pass band, None =
    proposed from the data. `encoder_offset_std` [rad or m] is how well the zeros of the joint
    encoders are known; a wrong one turns gravity, and the covariance of the load side then says
    what that does. `executor` (concurrent.futures) works on the logs, one a task. Raises kinds of
    SeaidError for data that cannot answer.
    """
    if method not in METHODS:
        raise IdentificationError("method=: " + unknown_name("method", method, METHODS))
    if estimator == INSTRUMENTAL and method != "two-step":
        raise IdentificationError(f'estimator="iv" needs method="two-step", found "{method}"')
    check_offset_std(encoder_offset_std)
    solver = estimator_named("wls" if estimator == INSTRUMENTAL else estimator)
    sources = sources_of(logs)
    datasets = datasets_of(robot, sources, cutoff_hz, executor, progress)
    logs_in_memory = [source for source in sources if isinstance(source, Log)]
    in_memory = [part for log in logs_in_memory for part in stretches(log)]
    if len(logs_in_memory) == len(sources):
        check_excitation(robot, in_memory)
    check_channels(logs_in_memory)
    used = (
        joints_with_torque(robot, datasets) if torque_joints is None else robot.rows(torque_joints)
    )
    given = robot
    robot, datasets = linearised_robot(robot, datasets, used)
    model = load_model(robot, base_parameters(robot, torque_joints=used), used)
    found = estimate_two_step(
        robot, datasets, model, solver, encoder_offset_std, executor, progress
    )
    if estimator == INSTRUMENTAL:
        found = estimate_instrumental(robot, datasets, model, found, encoder_offset_std, executor)
    if method == "simultaneous":
        found = estimate_simultaneous(
            robot, datasets, model, found, solver, encoder_offset_std, executor
        )
    found = replace(found, drives=with_fixed_flags(found.drives, given, robot))
    possible = _possible(robot, model, found) if feasible else None
    return identification_of(robot, model, found, datasets, possible)


def identification_of(
    robot: Robot,
    model: LoadModel,
    found: RobotEstimate,
    datasets: Sequence[Dataset],
    feasible: FeasibleParameters | None = None,
) -> Identification:
    """Return what both sides told of the records as an Identification of the robot."""
    return Identification(
        drives=FrozenMapping(found.drives),
        load=found.load,
        base=model.base,
        robot=_found_robot(robot, model.base, found) if feasible is None else feasible.robot,
        known=robot,
        model=model,
        load_side=found.load_side,
        springs=FrozenMapping(found.springs),
        cutoff_hz=datasets[0].cutoff_hz,
        excluded=FrozenMapping(found.excluded),
        checks=FrozenMapping(found.checks),
        feasible=feasible,
        processing=processing_of(datasets),
        motions=tuple(dataset for dataset in datasets if isinstance(dataset, Motion)),
    )


def _possible(robot: Robot, model: LoadModel, found: RobotEstimate) -> FeasibleParameters:
    """Return the possible bodies nearest to the estimate of both sides."""
    white = found.white_covariance
    if found.whole is not None:
        return feasible_parameters(robot, model, found.whole, white_covariance=white)
    elastic = {}
    for joint in robot.elastic_joints:
        drive, load = found.drives[joint], found.load_side.names
        own = [i for i, name in enumerate(drive.names) if f"{name} of {joint}" not in load]
        elastic[joint] = drive.part(own, [drive.names[i] for i in own])
    return feasible_parameters(robot, model, found.load_side, elastic, white_covariance=white)


def _found_robot(robot: Robot, base: BaseParameters, sides: RobotEstimate) -> Robot:
    """Return the robot with the found values; standard parameters nearest to the file's.

    Nearest in the plain Euclidean sense, from a point of 1 kg a body where the robot has none: it
    has the found base parameters, and need not be physically possible body by body.
    """
    prior = robot.parameters.copy()
    prior[::10][np.isnan(prior[::10])] = 1.0
    prior = np.nan_to_num(prior)
    correction = base.least(sides.load.values - base.project(prior))
    drives = sides.drives
    found = {
        joint: with_estimate(drive, drives[joint]) if joint in drives else drive
        for joint, drive in robot.drives.items()
    }
    return robot.with_values(prior + correction, found)
