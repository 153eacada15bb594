"""Tables in text, aligned, with standard errors."""

from __future__ import annotations

from collections.abc import Sequence
from io import StringIO
from typing import TYPE_CHECKING

import numpy as np

from seaid.found import nominal_values

if TYPE_CHECKING:
    from seaid.estimation.estimate import Estimate
    from seaid.identification import Identification
    from seaid.robot import Robot
    from seaid.validation import Validation


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return an aligned table as text; the first column to the left, the others to the right."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    drawn = Table(box=box.SIMPLE_HEAD)
    for position, name in enumerate(header):
        drawn.add_column(name, justify="right" if position else "left", no_wrap=True)
    for row in rows:
        drawn.add_row(*row)
    text = StringIO()
    Console(file=text, width=400, markup=False).print(drawn)
    return "\n".join([title, *(line.rstrip() for line in text.getvalue().splitlines())])


def drive_table(title: str, found: Identification, truth: Robot | None = None) -> str:
    """Return Table 1 of the paper: drive parameters with standard errors, beside a known truth."""
    header = ["joint", "parameter", "estimated", "std. error", "rel."]
    rows = []
    for joint, estimate in found.drivetrains.items():
        true = {} if truth is None else nominal_values(truth.drivetrains[joint])
        for name, value, error, unit in _entries(estimate):
            exact = true.get(name, np.nan)
            beside = [] if truth is None else [number(exact), percent(value / exact - 1)]
            numbers = [number(value), number(error), percent(error / abs(value))]
            rows.append([joint, name, *numbers, *beside, unit])
    return table(title, [*header, *([] if truth is None else ["true", "off by"]), "unit"], rows)


def load_table(title: str, found: Identification, truth: Robot | None = None) -> str:
    """Return the base parameters with standard errors, beside a known truth.

    Long groupings are cut; `parameters.json` has them whole.
    """
    header = ["base parameter", "estimated", "std. error", "rel."]
    true = np.full(len(found.load.values), np.nan)
    if truth is not None:
        true = found.base.project(truth.parameters)
    rows = []
    for exact, (name, value, error, unit) in zip(true, _entries(found.load), strict=True):
        off = [number(exact), f"{(value - exact) / error:+.1f} s.e."]
        numbers = [number(value), number(error), percent(error / abs(value))]
        rows.append([_short(name), *numbers, *([] if truth is None else off), unit])
    return table(title, [*header, *([] if truth is None else ["true", "off by"]), "unit"], rows)


def identification_table(found: Identification) -> str:
    """Return the summary of an identification: drives, base parameters, flags."""
    parts = [
        f"{found.robot.name}: {len(found.load.values)} base parameters from the torques at "
        f"{', '.join(found.model.rows)}; pass band {found.cutoff_hz:.3g} Hz",
        drive_table("Drives", found),
        load_table("Base parameters", found),
        "condition number of the load side (columns of unit norm): "
        f"{found.load_side.condition_number:.3g}",
        *(f"! {flag}" for flag in found.flags),
    ]
    return "\n".join(parts)


def validation_table(result: Validation) -> str:
    """Return relative errors by joint and side: in the pass band, away from standstill, and raw."""
    title = "Unseen motion: relative error in the pass band; away from standstill; unfiltered"
    header = ["joint", "motor torque", "moving", "raw", "load torque", "moving", "raw"]
    kinds = ("relative_error", "moving_relative_error", "raw_relative_error")
    rows = [
        [
            joint,
            *(
                percent(getattr(fit, kind)[index])
                for fit in (result.actuator, result.load)
                for kind in kinds
            ),
        ]
        for index, joint in enumerate(result.joints)
    ]
    return table(title, header, rows)


def number(value: float) -> str:
    """Return a number with four digits, a dash where there is none."""
    return f"{value:.4g}" if np.isfinite(value) else "-"


def percent(value: float) -> str:
    """Return a ratio in percent with two digits, a dash where there is none."""
    if not np.isfinite(value):
        return "-"
    return f"{100 * value:.2g} %" if abs(value) < 0.995 else f"{100 * value:.0f} %"


def _entries(estimate: Estimate) -> list[tuple[str, float, float, str]]:
    values, errors = estimate.values.tolist(), estimate.standard_errors.tolist()
    return list(zip(estimate.names, values, errors, estimate.units, strict=True))


def _short(text: str, longest: int = 56) -> str:
    return text if len(text) <= longest else text[: longest - 4] + " ..."
