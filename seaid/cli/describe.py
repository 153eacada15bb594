"""Command describe: what the custom columns of a log mean."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from seaid.cli.messages import is_stdout
from seaid.cli.options import (
    Base,
    ContactLinks,
    Drives,
    Joints,
    RateHz,
    ResultOptions,
    RobotOptions,
)


def describe(
    logs: Annotated[
        list[Path],
        Argument(help="A log with custom columns, or the files of one log.", metavar="LOG..."),
    ],
    urdf: Annotated[
        Path | None, Option(help="The robot, for joint names and units of angles.")
    ] = None,
    drives: Drives = None,
    joints: Joints = None,
    base: Base = "fixed",
    contact: ContactLinks = None,
    rate_hz: RateHz = None,
    *,
    output: Annotated[
        Path | None, Option("--output", "-o", help="File for the TOML; default: on stdout.")
    ] = None,
    result: ResultOptions,
) -> None:
    """Infer the meaning of custom columns, as a log description in TOML.

    Check it, above all the uncertain choices, and correct it by hand. Next to the log under its
    name (run.toml for run.csv) it is used by default.

    seaid describe run.csv
    seaid describe run.csv --urdf arm.urdf --drives arm.toml -o run.toml
    seaid describe positions.csv currents.csv -o positions.toml
    seaid describe walk.npz --urdf go2 --base floating --contact FL_foot,FR_foot --rate-hz 500
    """
    from seaid._files import write_whole
    from seaid.errors import LogError
    from seaid.identification import with_leg_order
    from seaid.log import describe_log, read_log

    result.check(output, read=(*logs, urdf, drives))
    robot = None
    if urdf is not None:
        robot = RobotOptions(urdf, drives, joints, base=base, contact=contact).robot()
    guess = describe_log(logs, robot, rate_hz=rate_hz)
    if robot is not None and robot.floating_base is not None:
        with suppress(LogError):  # what cannot be read yet is for the user to correct
            guess = with_leg_order(
                guess, robot, read_log(logs, robot, description=guess.description)
            )
    lists = {key: getattr(guess, key) for key in ("unsure", "assumed", "unused")}
    content = {"description": guess.description.to_dict(), **lists}
    if output is not None and not is_stdout(output):
        write_whole(output, guess.to_toml())
        result.show(str(guess), content, output)
    else:
        result.show(guess.to_toml().rstrip(), content)
