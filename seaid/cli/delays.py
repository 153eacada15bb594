"""Command delays: channels of a log that are late or early."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from seaid.cli.messages import written
from seaid.cli.options import LogOptions, ResultOptions, checked_suffix


def delays(
    options: LogOptions,
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

    checked_suffix(output, *WRITTEN)
    result.check(output, read=(*options.files, log))
    robot = options.robot(options.known_body)
    (read,) = options.logs([log], robot)
    delays = estimate_delays(robot, read, largest_s=largest_s, cutoff_hz=options.cutoff_hz)
    if output is not None:
        with written(output, ".csv") as file:
            write_log(correct_delays(read, delays), file)
    content = [{**asdict(delay), "is_significant": delay.is_significant} for delay in delays]
    text = [str(delay) for delay in delays] or ["no channel is redundant with others of its joint"]
    result.show("\n".join(text), {"delays": content}, output, robot=robot.name)
