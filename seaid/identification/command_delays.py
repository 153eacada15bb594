"""Delays of position commands: one for all drives of a bus, and only where the log determines it.

With one gain set a delay T adds (K_d + F_v) T to the rotor inertia at the joint and K_p T to the
viscous friction, to first order. What is left to tell them apart is often less than the errors of
the model; the delay is then as stated, and its uncertainty in all intervals.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from seaid._arrays import Array, safely
from seaid._files import toml_table
from seaid.drives import (
    DELAY_PARAMETER,
    NORMAL_95,
    Bus,
    Drive,
    ParameterName,
    buses_of,
    is_stated,
    shared_columns,
)
from seaid.errors import IdentificationError
from seaid.estimation import (
    Constraints,
    Estimate,
    FittedRows,
    independent_rows,
    shared_parameters,
)
from seaid.regressor import Regression
from seaid.robot import Robot

MOST_DELAY_ROUNDS = 3
"""Most repetitions with commands delayed by the estimate: the error of one is of its square."""

_DELAY_S = 2e-4
"""Change of a delay [s] below which its linearisation has converged."""

_ROUNDING_S = 1e-7
"""Difference [s] of the delays of one bus by rounding; drives stay on one by equal delays."""

_SCALE = 0.01
"""Relative change of the scale of gains below which the slope by the delay has converged."""

LARGEST_DELAY_S = 0.25
"""Largest delay of a command [s] for which the linearisation is tried."""

_FREE = 1e-8
"""Part of a variance that stays to a direction with a fixed value, so that matrices have roots."""


def with_shared_parameters(
    drives: Mapping[str, Drive], fitted: FittedRows, joint: str = ""
) -> FittedRows:
    """Return a fit with one value for what drives share, and one delay per bus.

    The delay is the stated one where the rows do not determine it.
    """
    free = fitted.estimate
    buses, groups = buses_of(drives, free.names, joint), shared_columns(drives, free.names, joint)
    if not buses and not groups:
        return fitted
    white, p = fitted.white_covariance, len(free.names)
    equal = _equal(buses, groups)
    constraints = Constraints.of(p, equal)
    estimate = constraints.applied(free, white)
    P, _ = constraints.solution(white)
    stated = _undetermined(buses, estimate, P @ white @ P.T, fitted.qr_factor.count)
    if stated:
        constraints = Constraints.of(p, equal, stated)
        estimate = constraints.applied(free, white)
    rows = independent_rows(fitted.qr_factor, free)
    return replace(
        fitted,
        estimate=estimate,
        constraint=constraints.solution(white)[0],
        shared=shared_parameters(free, groups, rows),
    )


def _equal(
    buses: Iterable[Bus], groups: Mapping[ParameterName, Sequence[int]]
) -> list[Sequence[int]]:
    """Return the places of the columns of each parameter that several drives have."""
    return [*(bus.places for bus in buses), *groups.values()]


def _undetermined(buses: Sequence[Bus], estimate: Estimate, white: Array, count: int) -> list[Bus]:
    """Return the buses whose delay `count` rows do not determine, with a covariance (p, p).

    They do not if the effect of the stated range, beyond that of all other parameters, is less than
    the residual: errors of the model may then hide it. An estimate farther beyond that range than
    such errors explain is one to linearise at.
    """
    free, stated = sum(len(bus.places) for bus in buses), []
    for bus in buses:
        place, range_s = bus.places[0], NORMAL_95 * bus.std_s
        # |column| of the delay, orthogonal to all others, is 1 / error for a residual of 1.
        as_residual = np.sqrt(white[place, place] * count * len(bus.places) / free)
        is_far = abs(estimate.values[place] - bus.nominal_s) > range_s + as_residual
        if as_residual > range_s and not is_far:
            stated.append(bus)
    return stated


def with_fixed_delays(
    drives: Mapping[str, Drive], estimate: Estimate, white: Array, joint: str = ""
) -> tuple[Estimate, Array]:
    """Return an estimate and its covariance `white` (p, p) for delays that stay where they are.

    A physically consistent robot is looked for near the estimate. What drives share stays equal
    then, as delays of one bus do, and those that are as stated keep their value: both have a
    distance from no other value.
    """
    buses = buses_of(drives, estimate.names, joint)
    groups = shared_columns(drives, estimate.names, joint)
    exact = [bus for bus in buses if is_stated(estimate.standard_errors[bus.places[0]], bus.std_s)]
    constraints = Constraints.of(len(white), _equal(buses, groups), exact)
    if not len(constraints.A):
        return estimate, white
    P, _ = constraints.solution(white)
    stated = [place for bus in exact for place in bus.places]
    covariance, across = estimate.covariance, estimate.covariance[:, stated]
    if stated:
        # C - C_xs C_ss^-1 C_sx, the covariance of the others if the stated delays s are exact.
        inner = safely(np.linalg.pinv, across[stated], what="the delays of the commands")
        covariance = covariance - across @ inner @ across.T
    return replace(estimate, covariance=covariance), P @ white @ P.T + _FREE * white


def with_merged_columns(
    drives: Mapping[str, Drive], rows: Regression, estimate: Estimate, joint: str = ""
) -> Regression:
    """Return rows with one column for what drives share, themselves without such columns.

    Their fit is the constrained one of `with_shared_parameters`. Delays that are as stated in an
    estimate have no column: their torque is known.
    """
    buses, groups = buses_of(drives, rows.names, joint), shared_columns(drives, rows.names, joint)
    if not buses and not groups:
        return rows
    H, y = rows.H.copy(), rows.y.copy()
    gone: list[int] = []
    for first, *others in _equal(buses, groups):
        # One value for all: its column is the sum.
        H[:, first] += H[:, others].sum(axis=1)
        gone += others
    for bus in buses:
        first = bus.places[0]
        if is_stated(estimate.standard_errors[first], bus.std_s):
            y -= bus.nominal_s * H[:, first]
            gone.append(first)
    kept = np.setdiff1d(np.arange(len(rows.names)), gone)
    names, units = (tuple(texts[place] for place in kept) for texts in (rows.names, rows.units))
    return replace(rows, names=names, units=units, H=H[:, kept], y=y)


def with_estimated_delays(robot: Robot, identified: Robot) -> Robot:
    """Return the robot with the delays of an estimate as nominal ones; itself if they converged.

    Raises IdentificationError for a delay that is far beyond the range of the linearisation.
    """
    drives: dict[str, Drive] = {}
    of_buses: dict[float, list[float]] = {}
    for joint, drive in robot.drives.items():
        if drive.controller is None or DELAY_PARAMETER in drive.known:
            continue
        near = drive.command_delay_s or 0.0
        scaled, delay = _estimated_delay(joint, drive, identified.drives[joint])
        seen = of_buses.setdefault(near, [])
        delay = next((known for known in seen if abs(known - delay) < _ROUNDING_S), delay)
        seen.append(delay)
        if abs(delay - near) > _DELAY_S:
            scaled = replace(scaled, command_delay_s=delay)
        if scaled is not drive:
            drives[joint] = scaled
    return robot.with_drives(drives) if drives else robot


def _estimated_delay(joint: str, drive: Drive, identified: Drive) -> tuple[Drive, float]:
    """Return a drive with the estimated scale of its gains, if that moved, and its delay [s]."""
    delay, near = identified.values[DELAY_PARAMETER], drive.command_delay_s or 0.0
    if drive.is_up_to_scale and "gain_scale" not in drive.known:
        # The slope by the delay was that of the nominal scale.
        scale, before = (max(x.scale_of_gains, 1e-9) for x in (identified, drive))
        delay = near + (delay - near) * before / scale
        if abs(scale / before - 1) > _SCALE:
            drive = drive.with_values({"gain_scale": scale})
    if abs(delay) > LARGEST_DELAY_S:
        raise IdentificationError(
            f"the command of {joint} seems delayed by {delay * 1e3:.3g} ms, more than "
            f"{LARGEST_DELAY_S * 1e3:g} ms either way, where the search ends: check the gains "
            "of its controller, and the signs and clocks of commands and positions; commands "
            "that act so late are shifted in the description of the log:\n"
            f"{toml_table('joints', joint)}\n"
            f'position_command = {{ column = "...", delay_s = {-delay:.3g} }}'
        )
    return drive, delay
