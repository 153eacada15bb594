"""Linearisation of nonlinear drives before an identification, and load-dependent friction.

Load-dependent friction of a stiff drive needs the torque through the gear. The measured motor
torque would put its noise into the column; the torque of the fitted model is used instead, from a
fit without that friction first and then with it, until it converges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seaid.drives import WARM_UP, Drive
from seaid.errors import IdentificationError
from seaid.identification.datasets import Dataset, first_motion
from seaid.identification.nonlinear_terms import (
    linearised,
    linearised_load,
    nonlinear_joints,
    starting_load_fit,
)
from seaid.log import Motion
from seaid.regressor import under_load, with_gear_torque
from seaid.robot import Robot

_SETTLED, _MOST_TURNS, _SEARCHES = 1e-5, 20, 2


def with_gear_torques(
    robot: Robot, motions: Sequence[Motion], used: Sequence[str]
) -> tuple[Robot, list[Motion]]:
    """Return the robot with linearised stiff drives, and motions with their gear torques."""
    joints = under_load(robot, used)
    if not joints:
        return linearised_load(robot, motions, used), list(motions)
    drives = {joint: _without_load(robot.drives[joint]) for joint in joints}
    plain = robot.with_drives(drives)
    found = linearised_load(plain, motions, used)
    known = _known(found, motions, used)
    for _ in range(_SEARCHES):
        starts = {joint: _with_values_of(robot, found, joint) for joint in robot.joint_names}
        found = linearised_load(robot.with_drives(starts), known, used)
        known = _settled(found, known, used)
    return found, known


def _with_values_of(robot: Robot, other: Robot, joint: str) -> Drive:
    """Return a drive with the values of the same drive with or without load-dependent friction."""
    drive = robot.drives[joint]
    values = other.drives[joint].values
    return drive.with_values({n: values[n] for n in drive.parameter_names if n in values})


def _settled(robot: Robot, motions: Sequence[Motion], used: Sequence[str]) -> list[Motion]:
    """Return the motions at which the torques through the gears converge."""
    known = list(motions)
    for _ in range(_MOST_TURNS):
        better = _known(robot, known, used)
        if _change(known, better) < _SETTLED:
            return better
        known = better
    raise IdentificationError(
        f"load-dependent friction of {', '.join(under_load(robot, used))} did not converge in "
        f"{_MOST_TURNS} iterations: remove 'load' from friction, or move these joints more"
    )


def _without_load(drive: Drive) -> Drive:
    return replace(
        drive,
        friction=tuple(term for term in drive.friction if term != "load"),
        nominal={name: x for name, x in drive.nominal.items() if name != "load_friction"},
        known=tuple(name for name in drive.known if name != "load_friction"),
    )


def _known(robot: Robot, motions: Sequence[Motion], used: Sequence[str]) -> list[Motion]:
    fit = starting_load_fit(robot, motions, used)
    return [with_gear_torque(robot, one, fit.model, fit.springs, fit.values) for one in motions]


def _change(before: Sequence[Motion], after: Sequence[Motion]) -> float:
    """Return the relative change of the torques."""
    old, new = (
        np.concatenate([np.nan_to_num(np.asarray(one.gear_torque)) for one in motions])
        for motions in (before, after)
    )
    return float(np.linalg.norm(new - old) / max(float(np.linalg.norm(new)), 1e-300))


def _check_whole_warm_up(robot: Robot, datasets: Sequence[Dataset]) -> None:
    """Raise IdentificationError for a warm-up that is searched in a log read in pieces."""
    if all(isinstance(dataset, Motion) for dataset in datasets):
        return
    for joint, drive in robot.drives.items():
        if {*WARM_UP} & {*drive.friction} and "warm_up_time" not in drive.known:
            raise IdentificationError(
                f"joint '{joint}': the time of its warm-up is searched in a whole log, and this "
                "one is read in pieces: read it with read_log, or give warm_up_time_s and "
                'known = ["warm_up_time"] in the drives file'
            )


def linearised_robot(
    robot: Robot, datasets: Sequence[Dataset], used: Sequence[str]
) -> tuple[Robot, list[Dataset]]:
    """Return the robot with values at which its nonlinear drives are linearised, and its datasets.

    The datasets have the torque through the gears if friction depends on it. Of logs that are read
    in pieces the first piece is searched. Raises IdentificationError for load-dependent friction of
    a stiff drive in such a log, and for an unknown warm-up time.
    """
    _check_whole_warm_up(robot, datasets)
    motions = [first_motion(dataset) for dataset in datasets]
    robot = linearised(robot, motions)
    if not nonlinear_joints(robot, used) and not under_load(robot, used):
        return robot, list(datasets)
    robot, known = with_gear_torques(robot, motions, used)
    if not under_load(robot, used):
        return robot, list(datasets)
    if not all(isinstance(dataset, Motion) for dataset in datasets):
        raise IdentificationError(
            "load-dependent friction of a stiff drive needs the log in memory: read it with "
            "read_log"
        )
    return robot, list(known)
