"""Command frequency: resonance, damping and springs by frequency response."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from seaid.cli.messages import written
from seaid.cli.options import (
    FailOn,
    IdentifyOptions,
    Logs,
    ResultOptions,
    Run,
    band_of,
    check_fail_on,
    check_joints,
    checked_suffix,
    fail_on_warnings,
    names,
)

if TYPE_CHECKING:
    from seaid.identification import FrequencyResponse


def frequency(
    options: IdentifyOptions,
    logs: Logs,
    *,
    run: Run = None,
    plan: Annotated[
        Path | None, Option(help="The multisine that the logs followed.", metavar="JSON")
    ] = None,
    period_s: Annotated[float | None, Option(help="Period of the logs without --plan [s].")] = None,
    band: Annotated[str | None, Option(help="Lowest, highest frequency [Hz], as 0.5,20.")] = None,
    of: Annotated[
        str | None, Option(help="Joints that take part, as a,b,c; default: those that move.")
    ] = None,
    figure: Annotated[
        Path | None, Option(help="Draw measured and computed responses.", metavar="PNG")
    ] = None,
    fail_on: FailOn = None,
    result: ResultOptions,
) -> None:
    """Measure frequency responses of joints: resonance, damping and springs.

    Motor torques and motor angles suffice. Periodic logs, by excite --basis multisine, show what is
    noise and what is nonlinear. With --run the response of that identification is compared.

    seaid frequency leg.urdf run.csv --drives leg.toml --plan plan.json --figure response.png
    seaid frequency leg.urdf run.csv --drives leg.toml --of knee_pitch --band 0.5,15
    """
    from seaid.excitation import load_trajectory
    from seaid.identification import frequency_response
    from seaid.report import save_frequency_figure

    check_fail_on(fail_on)
    checked_suffix(figure, ".png")
    result.check(figure, read=(*options.files, *logs, plan))
    saved = None if run is None else options.saved(run, "logs")
    robot = options.robot(options.known_body) if saved is None else saved.identification.known
    check_joints("--of", names(of), robot)
    response = frequency_response(
        robot,
        options.logs(logs, robot),
        plan=None if plan is None else load_trajectory(plan),
        period_s=period_s,
        band_hz=band_of(band),
        joints=names(of),
        identification=None if saved is None else saved.identification,
    )
    if figure is not None:
        with written(figure, ".png") as file:
            save_frequency_figure(response, file)
    text, facts = response.summary(), {"robot": robot.name, "warnings": response.warnings}
    result.show(text, _facts(response), figure, **facts)
    fail_on_warnings(response.warnings, fail_on)


def _facts(frf: FrequencyResponse) -> dict[str, Any]:
    """Return the numbers of a response as JSON content; complex ones as size and phase."""
    import numpy as np

    responses = {"response": frf.response, "model": frf.model, "identified": frf.identified}
    content: dict[str, Any] = {
        name: {"size": np.abs(curve), "phase_rad": np.angle(curve)}
        for name, curve in responses.items()
        if curve is not None
    }
    drives = {
        joint: [
            {"name": name, "unit": unit, "value": value, "standard_error": error}
            for name, unit, value, error in zip(
                drive.names, drive.units, drive.values, drive.standard_errors, strict=True
            )
        ]
        for joint, drive in frf.drives.items()
    }
    names = ("joints", "period_s", "frequency_hz", "noise_std", "total_std", "coherence")
    return {"drives": drives, **{name: getattr(frf, name) for name in names}, **content}
