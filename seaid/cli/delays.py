"""Command delays: channels of a log that are late or early."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from seaid.cli.messages import written
from seaid.cli.options import LogOptions, ResultOptions, checked_suffix


def delays(
    given: LogOptions,
    log: Annotated[Path, Argument(help="A log.", metavar="LOG")],
    *,
    largest_s: Annotated[float, Option(help="Largest delay of the search [s].")] = 0.03,
    output: Annotated[
        Path | None, Option("--output", "-o", help="Log with significant delays corrected.")
    ] = None,
    result: ResultOptions,
) -> None:
    """Estimate by how much the channels of a log are late or early.

    Channels of a joint that say the same are compared: both encoders, and torques with the motion.
    A delay can be written into the description of the log, as delay_s of its quantity.

    seaid delays leg.urdf run.csv --drives leg.toml
    seaid delays leg.urdf run.csv --drives leg.toml -o corrected.csv
    """
    from seaid.identification import correct_delays, estimate_delays
    from seaid.log import WRITTEN, write_log

    if output is not None:
        checked_suffix(output, *WRITTEN)
    result.check(output, read=(*given.files, log))
    robot = given.robot(given.known_body or ())
    (read,) = given.logs([log], robot)
    found = estimate_delays(robot, read, largest_s=largest_s, cutoff_hz=given.cutoff_hz)
    if output is not None:
        with written(output, ".csv") as file:
            write_log(correct_delays(read, found), file)
    content = [{**asdict(one), "is_significant": one.is_significant} for one in found]
    text = [str(one) for one in found] or ["no channel is redundant with others of its joint"]
    result.show("\n".join(text), {"delays": content}, output, robot=robot.name)
