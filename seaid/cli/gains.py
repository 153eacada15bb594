"""Command gains: a second gain set that separates armature and delay."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from seaid.cli.messages import is_terminal, written
from seaid.cli.options import IdentifiedOptions, ResultOptions, numbers


def gains(
    given: IdentifiedOptions,
    log: Annotated[Path, Argument(help="The log of the first gain set.", metavar="LOG")],
    *,
    factor: Annotated[
        list[str] | None,
        Option(
            help="Factors on K_p and K_d that can be used. May be repeated. Default: 0.5,1, 0.5,2, "
            "1,2 and 2,1.",
            metavar="KP,KD",
        ),
    ] = None,
    duration: Annotated[float, Option(help="Length of the second log [s].")] = 10.0,
    seed: Annotated[int, Option(help="Seed of noise and steps.")] = 0,
    output: Annotated[
        Path | None, Option("--output", "-o", help="The best commands.", metavar="LOG")
    ] = None,
    result: ResultOptions,
) -> None:
    """Plan a second log with other controller gains that separates armature and delay.

    One gain set determines armature + (K_d + F_v) delay. The identified model follows chirps and
    steps with other gains, within the limits of position, speed and torque, and both logs are
    identified together: the table has the standard errors that this would give.

    seaid gains go2.csv@0:8 --run runs/latest -o second.csv
    seaid gains leg.urdf run.csv --from run.csv --drives leg.toml --factor 0.7,1 --factor 1,1.5
    """
    from seaid.identification import GAIN_FACTORS, plan_gain_set
    from seaid.log import write_log

    factors: Sequence[tuple[float, float]] = GAIN_FACTORS
    if factor is not None:
        pairs = [numbers("--factor", one, "KP,KD, as 0.5,1", 2) for one in factor]
        factors = tuple((stiffness, damping) for stiffness, damping in pairs)
    result.check(output, read=(*given.files, log))
    found = given.result().identification
    (first,) = given.logs([log], found.known)
    plan = plan_gain_set(
        found,
        first,
        gain_factors=factors,
        duration_s=duration,
        seed=seed,
        progress=is_terminal(),
    )
    if output is not None:
        with written(output, ".csv") as file:
            write_log(plan.candidates[0].log, file)
    result.show(plan.summary(), plan.to_dict(), output, robot=found.robot.name)
