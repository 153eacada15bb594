"""Command frequency: resonance, damping and springs by frequency response."""

from __future__ import annotations

from typing import Any

import seaid
from seaid.cli.kinds import Band, JsonFile, LogFile, Names, RunFile
from seaid.cli.options import FailOptions, IdentifyOptions, JsonOptions, check_joints


def frequency(
    options: IdentifyOptions,
    logs: tuple[LogFile, ...],
    *,
    run: RunFile | None = None,
    plan: JsonFile | None = None,
    period_s: float | None = None,
    band: Band | None = None,
    of: Names | None = None,
    fail: FailOptions,
    result: JsonOptions,
) -> None:
    """Measure frequency responses of joints: resonance, damping and springs.

    Motor torques and motor angles suffice. Periodic logs, by excite --basis multisine, show what is
    noise and what is nonlinear. With --run the response of that identification is compared;
    report --multisine draws it.

    Parameters
    ----------
    plan
        The multisine that the logs followed.
    period_s
        Period of the logs without --plan [s].
    band
        Lowest, highest frequency [Hz], as 0.5,20.
    of
        Joints that take part, as a,b,c; default: those that move.

    Examples
    --------
    seaid frequency leg.urdf run.csv --drives leg.toml --plan plan.json
    seaid frequency leg.urdf run.csv --drives leg.toml --of knee_pitch --band 0.5,15
    """
    saved = options.saved(run, "logs")
    robot = options.robot() if saved is None else saved.identification.known
    check_joints("--of", of, robot)
    response = seaid.frequency_response(
        robot,
        options.logs(logs, robot),
        plan=None if plan is None else seaid.load_trajectory(plan),
        period_s=period_s,
        band_hz=band,
        joints=of,
        identification=None if saved is None else saved.identification,
    )
    facts = {"robot": robot.name, "warnings": response.warnings}
    result.show(response.summary(), _content(response), **facts)
    fail.check(response.warnings)


def _content(frf: seaid.frequency.FrequencyResponse) -> dict[str, Any]:
    """Return the numbers of a response as JSON content, its curve as size and phase."""
    import numpy as np

    names = ("joints", "period_s", "frequency_hz", "noise_std", "total_std", "coherence")
    return {
        "drives": {joint: seaid.export.values_of(drive) for joint, drive in frf.drives.items()},
        **{name: getattr(frf, name) for name in names},
        "response": {"size": np.abs(frf.response), "phase_rad": np.angle(frf.response)},
    }
