"""Tables in text, aligned, with standard errors."""

from __future__ import annotations

from collections.abc import Sequence
from io import StringIO
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from seaid.identification import Identification
    from seaid.validation import Validation


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return an aligned table as text; the first column to the left, the others to the right."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    drawn = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", title_style="bold")
    for position, name in enumerate(header):
        drawn.add_column(name, justify="right" if position else "left", no_wrap=True)
    for row in rows:
        drawn.add_row(*row)
    text = StringIO()
    Console(file=text, width=400, markup=False).print(drawn)
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines())


def drive_rows(found: Identification) -> list[list[str]]:
    """Return joint, parameter, value, standard error, its percentage and unit of every drive."""
    return [
        [joint, name, number(value), number(error), percent(error / abs(value)), unit]
        for joint, estimate in found.drivetrains.items()
        for name, value, error, unit in zip(
            estimate.names,
            estimate.values,
            estimate.standard_errors,
            estimate.units,
            strict=True,
        )
    ]


def identification_table(found: Identification) -> str:
    """Return the summary of an identification: drives, base parameters, flags."""
    header = ["parameter", "value", "std. error", "rel.", "unit"]
    load = [
        [_short(name), number(value), number(error), percent(error / abs(value)), unit]
        for name, value, error, unit in zip(
            found.load.names,
            found.load.values,
            found.load.standard_errors,
            found.load.units,
            strict=True,
        )
    ]
    parts = [
        f"{found.robot.name}: {len(found.load.values)} base parameters from the torques at "
        f"{', '.join(found.model.rows)}; pass band {found.cutoff_hz:.3g} Hz",
        table("Drives", ["joint", *header], drive_rows(found)),
        table("Base parameters", header, load),
        f"condition number of the load side (columns of unit norm): "
        f"{found.load_side.condition_number:.3g}",
        *(f"! {flag}" for flag in found.flags),
    ]
    return "\n".join(parts)


def validation_table(title: str, result: Validation) -> str:
    """Return relative errors and R^2 by joint and side, in the pass band and raw."""
    header = ["joint", "motor torque", "raw", "R^2", "load torque", "raw", "R^2"]
    rows = [
        [
            joint,
            *(
                cell
                for fit in (result.actuator, result.load)
                for cell in (
                    percent(fit.relative_error[index]),
                    percent(fit.raw_relative_error[index]),
                    number(fit.r_squared[index]),
                )
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


def _short(text: str, longest: int = 70) -> str:
    return text if len(text) <= longest else text[: longest - 4] + " ..."
