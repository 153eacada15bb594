"""The tables of results, each made once: for the text of a summary and for a page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array
from seaid.drives import ParameterName, readable
from seaid.report.formats import (
    NONE,
    Measured,
    Scaled,
    Table,
    Where,
    change,
    is_partial,
    number,
    powers_of_ten,
    short,
    table_of,
)
from seaid.report.html_charts import SIDES, torque_units
from seaid.report.html_robot import center_of_mass
from seaid.robot import BASE_ROWS
from seaid.robot.inertia import principal_moments

if TYPE_CHECKING:
    from seaid.checks import JointCheck
    from seaid.estimation import Estimate
    from seaid.frequency import FrequencyResponse
    from seaid.identification import Fit, Identification, StaticCalibration
    from seaid.legged import ContactForces
    from seaid.report.comparison import Comparison
    from seaid.report.html_charts import Run
    from seaid.robot import Robot
    from seaid.simulation import ReplayComparison


def measured(
    estimate: Estimate, nominal: Mapping[str, float] | None = None
) -> Iterator[tuple[str, Measured]]:
    """Yield the parameters of an estimate by name, with their nominal values."""
    numbers = zip(estimate.values.tolist(), estimate.standard_errors.tolist(), strict=True)
    before = nominal or {}
    for name, (value, error), (low, high), unit in zip(
        estimate.names, numbers, estimate.interval().tolist(), estimate.units, strict=True
    ):
        yield name, Measured(value, error, low, high, unit, before.get(name, math.nan))


def drive_table(identification: Identification, nominal: Robot | None = None) -> Table:
    """Return the parameters of all drives, nominal and identified: Table 1 of the paper."""
    rows = [
        (joint, name, value)
        for joint, estimate in identification.drives.items()
        for name, value in measured(
            estimate, None if nominal is None else nominal.drives[joint].own_values
        )
    ]
    return table_of("drives", rows)


_GROUPINGS_ROOM, _LEAST_ROOM = 1_000_000, 64
"""Characters of the page for all groupings, and for each; beyond them they are shortened."""


def load_table(estimate: Estimate, nominal: Array | None = None, head: str = "grouping") -> Table:
    """Return the base parameters, or others, by their groupings; `nominal` (p,)."""
    before = None if nominal is None else dict(zip(estimate.names, nominal.tolist(), strict=True))
    room = max(_LEAST_ROOM, _GROUPINGS_ROOM // max(len(estimate.names), 1))
    is_full = sum(map(len, estimate.names)) > _GROUPINGS_ROOM
    rows = [
        (_fitting(name, room) if is_full else name, value)
        for name, value in measured(estimate, before)
    ]
    return table_of("base parameters", rows, head=head)


def _fitting(grouping: str, room: int) -> str:
    """Return a grouping, shortened with a note if it has no room."""
    if len(grouping) <= room:
        return grouping
    terms = 1 + grouping.count(" + ") + grouping.count(" - ")
    kept = grouping[:room].rsplit(" ", 2)[0]
    return f"{kept} … ({terms} terms; parameters.json has them all)"


def calibration_table(calibration: StaticCalibration) -> Table:
    """Return the parameters of a calibration from statics."""
    return table_of("calibration", measured(calibration.estimate))


def response_table(response: FrequencyResponse) -> Table:
    """Return resonance, antiresonance, damping and spring of every elastic joint."""
    rows = [
        (joint, name, value)
        for joint, estimate in response.drives.items()
        for name, value in measured(estimate)
    ]
    return table_of("response", rows)


def whole_body_table(identification: Identification) -> Table:
    """Return mass and centre of mass of a robot with a floating base, and of its base alone."""
    from seaid.legged import whole_body

    rows = []
    for quantity in whole_body(identification):
        found = Measured(quantity.value, quantity.standard_error)
        pair = (found, found) if quantity.is_determined else ("not determined", "")
        rows.append((quantity.name.capitalize(), *pair, quantity.unit))
    return table_of("whole", rows)


def setup_table(joints: Mapping[str, JointCheck]) -> Table:
    """Return the numbers on which a check of the set-up rests, by joint."""
    rows = [
        (
            *(joint, setup.swing, setup.encoder_slope, setup.nominal, setup.bodies, setup.motor),
            Measured(setup.gear_ratio, setup.gear_ratio_error),
            Measured(1e3 * setup.delay_s, 1e3 * setup.delay_error_s),
        )
        for joint, setup in joints.items()
    ]
    return table_of("set-up", rows)


def contact_tables(runs: Sequence[Run]) -> list[Table]:
    """Return the contact forces of those validations that have any."""
    from seaid.legged import LeggedValidation

    return [
        contact_table(run.name, run.result.contacts)
        for run in runs
        if isinstance(run.result, LeggedValidation) and run.result.contacts is not None
    ]


def contact_table(name: str, forces: ContactForces) -> Table:
    """Return the predicted and measured contact forces of a validation of this name."""
    from seaid.legged.contacts import CONTACT_NUMBERS

    shown = (getattr(forces, x) for x in CONTACT_NUMBERS if x not in ("scale", "pulled"))
    rows = zip(forces.links, forces.basis, *shown, strict=True)
    sums = {
        "predicted": forces.vertical,
        "measured": forces.measured_vertical,
        "weight": forces.weight,
    }
    known = [f"{x} {powers_of_ten(number(f))} N" for x, f in sums.items() if np.isfinite(f)]
    caption = f"Contact forces [N] of the {name}"
    caption += f". Normal forces in sum: {', '.join(known)}." if known else "."
    return replace(table_of("contacts", rows), name=f"contacts {name}", caption=caption)


def bodies_table(identification: Identification, nominal: Robot) -> Table:
    """Return mass, centre of mass and moments of every body, nominal and identified."""
    robots = (nominal, identification.robot)
    pairs = zip(*(robot.parameters.reshape(-1, 10) for robot in robots), strict=True)
    rows = [
        (
            name,
            *(float(body[0]) for body in both),
            change(float(both[0][0]), float(both[1][0])),
            *(describe(body) for describe in (_center, _moments) for body in both),
        )
        for name, both in zip(identification.robot.body_names, pairs, strict=True)
    ]
    return table_of("links", rows)


def _center(body: Array) -> str:
    """Return the centre of mass of a body as text."""
    center = center_of_mass(body) if np.all(np.isfinite(body)) else None
    return NONE if center is None else _vector(center)


def _moments(body: Array) -> str:
    """Return the principal moments of inertia about the centre of mass as text."""
    if not np.all(np.isfinite(body)) or body[0] <= 0:
        return NONE
    return _vector(principal_moments(body))


def _vector(values: Array) -> str:
    """Return numbers with three digits, and 0 for what is below the fourth digit of the largest."""
    size = float(np.max(np.abs(values)))
    last = 10.0 ** (math.floor(math.log10(size)) - 3) if size > 0 else 1.0
    return " ".join(short(float(value)) for value in last * np.round(values / last) + 0.0)


def side_name(side: str) -> str:
    """Return the name of a side of the checks."""
    return {"load": "load side", "both": "both sides"}.get(side, "actuator side")


def place_name(side: str) -> str:
    """Return the name of a regression: a side, and its joint if it is of one."""
    return side_name(side) + ("" if side in ("load", "both") else f" of {side}")


def term_name(side: str, name: str) -> str:
    """Return the name of a tested term with its joint."""
    return name if side in ("load", "both") else ParameterName(name, side)


def term_table(identification: Identification) -> Table:
    """Return each tested term of the drives, and whether the data support it."""
    rows = [
        (
            term_name(side, term.terms[0]),
            # `growth` is that of the sum of squares, its root that of the residual.
            math.sqrt(term.growth),
            *(term.F, term.p_value, term.bic),
            "yes" if term.bic > 0 else "no",
        )
        for side, checks in identification.checks.items()
        for term in checks.terms
    ]
    return table_of("terms", rows)


def shared_table(identification: Identification) -> Table:
    """Return the parameters that drives share, and whether the data contradict it."""
    rows = []
    for shared in identification.shared:
        estimate, quantity = identification.drive_side[shared.joints[0]], shared.name.quantity
        measured = Measured(estimate.value(quantity), estimate.standard_error(quantity))
        alone, test = ", ".join(map(short, shared.values)), shared.difference
        differ = "yes" if test.bic > 0 else "no"
        name = readable(shared.name)
        rows.append((name, ", ".join(shared.joints), measured, alone, test.F, test.bic, differ))
    return table_of("shared", rows)


def residual_table(identification: Identification) -> Table:
    """Return the autocorrelation of the residual of every equation."""
    rows = [
        (joint, side_name(side), white.first, white.durbin_watson)
        for side, checks in identification.checks.items()
        for joint, white in checks.whiteness.items()
    ]
    return table_of("residuals", rows)


def condition_table(result: Identification) -> Table:
    """Return condition number, residual and number of excluded instants per regression."""
    rows = []
    for side, checks in result.checks.items():
        elastic = side not in ("load", "both")
        estimate = result.drives[side] if elastic else result.load_side
        # The residual of a load side with a prismatic joint has rows in N.
        unit = "" if not elastic and any(result.robot.is_prismatic) else "N m"
        excluded = sum(result.excluded.values()) if side == "both" else result.excluded.get(side)
        count = NONE if excluded is None else str(excluded)
        rows.append((place_name(side), checks.condition_number, estimate.residual_std, unit, count))
    return table_of("regressions", rows)


@dataclass(frozen=True)
class ErrorRow:
    """The prediction errors of the torque of a joint on one side of a run.

    `before` is the relative error with the values of the robot files, NaN for the `reason`, or
    without what the reason names. Shares of the samples and errors are those of `Fit`.
    """

    run: str
    is_unseen: bool
    joint: str
    side: str
    unit: str
    relative_error: float
    counted_share: float = math.nan
    relative_error_with_standstill: float = math.nan
    raw_relative_error: float = math.nan
    rms_error: float = math.nan
    r_squared: float = math.nan
    before: float = math.nan
    reason: str = ""


def error_rows(runs: Sequence[Run], robot: Robot | None = None) -> list[ErrorRow]:
    """Return the prediction errors of every run, by side and joint, if there are traces.

    Without a robot they have no units.
    """
    return [
        _error_row(run, side, joint, units[index], getattr(run.result, side), index)
        for run in runs
        for side in SIDES
        for units in [torque_units(robot, side) if robot else [""] * len(run.result.joints)]
        for index, joint in enumerate(run.result.joints)
        if np.isfinite(getattr(run.result, side).relative_error[index])
    ]


def _error_row(run: Run, side: str, name: str, unit: str, fit: Fit, index: int) -> ErrorRow:
    from seaid.identification.result import NUMBERS  # which imports the checks

    measures: dict[str, Any] = {name: float(getattr(fit, name)[index]) for name in NUMBERS}
    return ErrorRow(run.name, run.is_unseen, name, side, unit, **measures)


def whole_rows(run: Run) -> list[ErrorRow]:
    """Return the prediction errors of all joints together by side, and of a floating base."""
    result = run.result
    rows = [
        ErrorRow(run.name, run.is_unseen, "all joints", side, "", error)
        for side in SIDES
        for error in [getattr(result, side).whole_relative_error]
        if len(result.joints) > 1 and np.isfinite(error)
    ]
    return [*rows, *base_rows(run)]


def base_rows(run: Run) -> list[ErrorRow]:
    """Return the prediction errors of the force and the moment on a floating base."""
    from seaid.legged import LeggedValidation

    fit = run.result.base if isinstance(run.result, LeggedValidation) else None
    return [
        _error_row(run, "base", name, "N" if index < 3 else "N m", fit, index)
        for index, name in enumerate(BASE_ROWS)
        if fit is not None and np.isfinite(fit.relative_error[index])
    ]


_MOST_ERRORS = 1500
"""Most rows of the table of errors, so that the page of a robot with hundreds of joints opens
fast."""


def error_table(rows: Sequence[ErrorRow]) -> Table:
    """Return the table of the 1500 largest errors, in their order."""
    largest = sorted(range(len(rows)), key=lambda k: -rows[k].relative_error)[:_MOST_ERRORS]
    cells = [
        (
            f"{row.run}{' (unseen)' * row.is_unseen}",
            *(row.joint, row.side, row.relative_error, row.counted_share),
            *(row.relative_error_with_standstill, row.raw_relative_error),
            f"{short(row.rms_error)} {row.unit}".strip(),
            row.r_squared,
        )
        for row in (rows[k] for k in sorted(largest))
    ]
    # Where all samples count, a terminal has no columns about those at standstill.
    where: Where = "both" if any(is_partial(row.counted_share) for row in rows) else "page"
    table, partial = table_of("predictions", cells), ("counted", "with standstill")
    columns = (replace(x, where=where) if x.head in partial else x for x in table.columns)
    return replace(table, columns=tuple(columns))


_ALL = {"mrad": "all revolute joints", "mm": "all prismatic joints"}


def replay_error_table(result: ReplayComparison) -> Table:
    """Return the errors of the replays before and after the identification, and their means."""
    errors = np.array([*result.mean_absolute_errors, *result.rms_errors])
    over = np.divide(errors[3], result.noise, where=result.noise > 0, out=errors[3] * np.nan)
    units = ["mm" if slides else "mrad" for slides in result.is_prismatic]
    rows: list[tuple[Any, ...]] = [
        (joint, *1e3 * errors[:, index], units[index], over[index])
        for index, joint in enumerate(result.joints)
    ]
    means = result.mean_errors
    if len(rows) > len(means):
        for unit, mean in means.items():
            name = "all joints" if len(means) == 1 else _ALL[unit]
            rows.append((name, *(1e3 * error for error in mean), unit, ""))
    return table_of("replay", rows)


def difference_table(result: Comparison) -> Table:
    """Return the parameters of two identifications side by side."""
    first, second = result.names
    largest = max((abs(x.significance) for x in result.differences), default=1.0)
    rows = [
        (
            x.joint or "load",
            x.name.replace("_", " ") if x.joint else x.name,
            Measured(x.first, x.first_error, x.first, x.first),
            Measured(x.second, x.second_error, x.second, x.second),
            *(x.unit, x.change, x.relative_change, x.error),
            *(Scaled(x.significance, largest), x.p_value),
            "differs" if x.is_significant else "",
        )
        for x in result.differences
    ]
    return table_of("comparison", rows, first=first, second=second)
