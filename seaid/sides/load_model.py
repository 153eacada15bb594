"""What the load side (8) can tell: base parameters, and the columns of drives beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seaid.arrays import Array, frozen
from seaid.base import BaseParameters, grouped_text, left_to_right, negligible, random_states
from seaid.drive_signals import motor_regressor
from seaid.drivetrain.model import SeriesElasticDrive
from seaid.inertia import UNITS
from seaid.rigid_body import regressor_at_drives
from seaid.robot import Robot
from seaid.sides.drive_columns import drive_columns, stiff_signals


@dataclass(frozen=True, eq=False)
class LoadModel:
    """What the load side can tell: base parameters, and the columns of the stiff drives.

    `drives` (p_d) are (joint, parameter, unit) of the drive columns that are identifiable beside
    the p base columns; the others are part of the base parameters, as `expressions` (p,) say: they
    are `absorbed` (a), and `absorption` (p + p_d, a) is how much of each is in every column. `rows`
    are the joints whose equations are used: those of their drives, which for drives that move
    several joints are the torques on what each of them turns.
    """

    base: BaseParameters
    rows: tuple[str, ...]
    drives: tuple[tuple[str, str, str], ...]
    expressions: tuple[str, ...]
    absorbed: tuple[tuple[str, str, str], ...]
    absorption: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns: expressions, then '<parameter> of <joint>'."""
        return self.expressions + tuple(f"{name} of {joint}" for joint, name, _ in self.drives)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of all columns."""
        base = tuple(UNITS[column % 10] for column in self.base.columns)
        return base + tuple(unit for _, _, unit in self.drives)


def load_model(robot: Robot, base: BaseParameters, rows: Sequence[str]) -> LoadModel:
    """Return which columns of stiff drives are identifiable beside the base parameters."""
    known = [robot.index(joint) for joint in rows]
    q, v, a = random_states(robot, seed=1, torques=len(known))
    Y = base.reduce(regressor_at_drives(robot, q, v, a))[:, known]
    columns, drives = drive_columns(robot, rows, lambda index: stiff_signals(robot, index, q, v, a))
    H = np.concatenate([Y, columns], axis=2).reshape(len(q) * len(known), -1)
    p = len(base.columns)
    bent = [
        p + place
        for place, (joint, name, _) in enumerate(drives)
        if name in _bent_parameters(robot, joint)
    ]
    found, grouping = _identifiable(H, bent)
    names = (*base.expressions, *(f"{name}_{joint}" for joint, name, _ in drives))
    absorbed = [column for column in range(p, H.shape[1]) if column not in found]
    expressions = []
    for row in range(p):
        wanted = np.zeros(H.shape[1])
        wanted[[row, *absorbed]] = grouping[row, [row, *absorbed]]
        expressions.append(grouped_text(wanted, names))
    return LoadModel(
        base=base,
        rows=tuple(rows),
        drives=tuple(drives[column - p] for column in found if column >= p),
        expressions=tuple(expressions),
        absorbed=tuple(drives[column - p] for column in absorbed),
        absorption=frozen("absorption", grouping[:, absorbed], (len(found), None)),
    )


def _bent_parameters(robot: Robot, joint: str) -> tuple[str, ...]:
    """Return the parameters in which a stiff drive is not linear."""
    elastic = isinstance(robot.drivetrains[joint], SeriesElasticDrive)
    return () if elastic else motor_regressor(robot, joint).non_linear


def _identifiable(H: Array, bent: Sequence[int]) -> tuple[list[int], Array]:
    """Return the columns of H that are identifiable, and how much of each is in every column.

    The slopes of what is `bent` stand beside the others whatever the random states: they live where
    the motor is slow.
    """
    straight = [column for column in range(H.shape[1]) if column not in bent]
    chosen, grouping, _ = left_to_right(H[:, straight], negligible(H[:, straight]))
    found = sorted([straight[column] for column in chosen] + list(bent))
    whole = np.zeros((len(found), H.shape[1]))
    rows = [found.index(straight[column]) for column in chosen]
    whole[np.ix_(rows, straight)] = grouping
    whole[[found.index(column) for column in bent], list(bent)] = 1.0
    return found, whole
