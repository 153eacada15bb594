"""Command describe: what the custom columns of a log mean."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal

import seaid
from seaid.cli.kinds import Contacts, LogFile, Names, TomlFile, UrdfFile
from seaid.cli.options import ResultOptions, RobotOptions
from seaid.errors import LogError


def describe(
    logs: tuple[LogFile, ...],
    *,
    urdf: UrdfFile | None = None,
    drives: TomlFile | None = None,
    joints: Names | None = None,
    base: Literal["fixed", "floating", "planar", "planar_xy", "planar_xz", "planar_yz"] = "fixed",
    contact: tuple[Contacts, ...] = (),
    rate_hz: float | None = None,
    columns: Names | None = None,
    output: TomlFile | None = None,
    result: ResultOptions,
) -> None:
    """Infer the meaning of custom columns, as a log description in TOML.

    Check it, above all the uncertain choices, and correct it by hand. Next to the log under its
    name (run.toml for run.csv) it is used by default.

    Parameters
    ----------
    logs
        A log with custom columns, or the files of one log.
    urdf
        The robot, for joint names and units of angles.
    columns
        Names of the columns, or t,q,qd,tau: the time, and arrays in the order of the joints.
    output
        File for the TOML; default: on stdout.

    Examples
    --------
    seaid describe run.csv
    seaid describe run.csv --urdf arm.urdf --drives arm.toml -o run.toml
    seaid describe positions.csv currents.csv -o positions.toml
    seaid describe walk.npz --urdf go2 --base floating --contact FL_foot,FR_foot --rate-hz 500
    """
    from seaid._files import write_whole

    result.check(output, read=(*logs, urdf, drives))
    robot = None
    if urdf is not None:
        robot = RobotOptions(urdf, drives=drives, joints=joints, base=base, contact=contact).robot()
    guess = seaid.describe_log(logs, robot, rate_hz=rate_hz, columns=columns or ())
    if isinstance(robot, seaid.legged.FloatingRobot):
        with suppress(LogError):  # what cannot be read yet is for the user to correct
            log = seaid.read_log(logs, robot, description=guess.description)
            guess = seaid.legged.with_leg_order(guess, robot, log)
    lists = {key: getattr(guess, key) for key in ("unsure", "assumed", "unused")}
    content = {"description": guess.description.to_dict(), **lists}
    if output is not None:
        write_whole(output, guess.to_toml())
        result.show(str(guess), content, output)
    else:
        result.show(guess.to_toml().rstrip(), content)
