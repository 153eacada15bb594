"""Delays of position commands: one for all drives of a bus, and only where the log determines it.

With one gain set a delay T adds (K_d + F_v) T to the rotor inertia at the joint and K_p T to the
viscous friction, to first order. What is left to tell them apart is often less than the errors of
the model; the delay is then as stated, and its uncertainty in all intervals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from seaid._arrays import Array, safely
from seaid._files import toml_table
from seaid.drives import DELAY_PARAMETER, NORMAL_95, Drive, buses_of, is_stated
from seaid.errors import IdentificationError
from seaid.estimation import Estimate, FittedRows
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


def with_shared_delays(
    drives: Mapping[str, Drive], fitted: FittedRows, joint: str = ""
) -> FittedRows:
    """Return a fit with one delay per bus, the stated one where the rows do not determine it.

    They do not if the effect of the stated range, beyond that of all other parameters, is less than
    the residual: errors of the model may then hide it. An estimate farther beyond that range than
    such errors explain is one to linearise at. The values are those of constrained least squares.
    """
    names = fitted.estimate.names
    buses = buses_of(drives, names, joint)
    if not buses:
        return fitted
    white, p = fitted.white_covariance, len(names)
    rows: list[Array] = []
    wanted: list[float] = []
    for bus in buses:
        for first, second in zip(bus.places, bus.places[1:], strict=False):
            # Constraint: two delays of one bus are equal.
            rows.append(np.eye(p)[first] - np.eye(p)[second])
            wanted.append(0.0)
    shared = _constrained(fitted.estimate, white, rows, wanted, {})
    free = sum(len(bus.places) for bus in buses)
    stds: dict[int, float] = {}
    kept = _projection(white, rows)[0]
    for bus in buses:
        place = bus.places[0]
        # |column| of the delay, orthogonal to all others, is 1 / error for a residual of 1
        error = float(np.sqrt((kept @ white @ kept.T)[place, place]))
        as_residual = error * np.sqrt(fitted.qr_factor.count * len(bus.places) / free)
        stated = NORMAL_95 * bus.std_s
        far = abs(shared.values[place] - bus.nominal_s) > stated + as_residual
        if as_residual > stated and not far:
            stds[len(rows)] = bus.std_s
            rows.append(np.eye(p)[place])
            wanted.append(bus.nominal_s)
    estimate = _constrained(fitted.estimate, white, rows, wanted, stds) if stds else shared
    values = estimate.values.copy()
    for bus in buses:  # the same but for rounding
        is_nominal = any(rows[row][bus.places[0]] == 1 for row in stds)
        values[list(bus.places)] = bus.nominal_s if is_nominal else values[bus.places[0]]
    constraint = _projection(white, rows)[0]
    return replace(fitted, estimate=replace(estimate, values=values), constraint=constraint)


_FREE = 1e-8
"""Part of a variance that stays to a direction with a fixed value, so that matrices have roots."""


def with_fixed_delays(
    drives: Mapping[str, Drive], estimate: Estimate, white: Array, joint: str = ""
) -> tuple[Estimate, Array]:
    """Return an estimate and its covariance `white` (p, p) for delays that stay where they are.

    A physically consistent robot is looked for near the estimate. Delays of one bus stay equal
    then, and those that are as stated keep their value: both have a distance from no other value.
    """
    stated: list[int] = []
    rows: list[Array] = []
    unit = np.eye(len(white))
    for bus in buses_of(drives, estimate.names, joint):
        if is_stated(estimate.standard_errors[bus.places[0]], bus.std_s):
            stated += bus.places
            rows += [unit[place] for place in bus.places]
        else:
            rows += [unit[place] - unit[bus.places[0]] for place in bus.places[1:]]
    if not rows:
        return estimate, white
    kept = _projection(white, rows)[0]
    covariance, across = estimate.covariance, estimate.covariance[:, stated]
    if stated:
        # C - C_xs C_ss^-1 C_sx, the covariance of the others if the stated delays s are exact.
        inner = safely(np.linalg.pinv, across[stated], what="the delays of the commands")
        covariance = covariance - across @ inner @ across.T
    return replace(estimate, covariance=covariance), kept @ white @ kept.T + _FREE * white


def with_merged_delays(
    drives: Mapping[str, Drive], rows: Regression, estimate: Estimate, joint: str = ""
) -> Regression:
    """Return rows with one column for the delay of a bus, themselves without such columns.

    Their fit is the constrained one of `with_shared_delays`. Delays that are as stated in an
    estimate have no column: their torque is known.
    """
    buses = buses_of(drives, rows.names, joint)
    if not buses:
        return rows
    H, y = rows.H.copy(), rows.y.copy()
    gone: list[int] = []
    for bus in buses:
        first, *others = bus.places
        if is_stated(estimate.standard_errors[first], bus.std_s):
            y -= bus.nominal_s * H[:, list(bus.places)].sum(axis=1)
            gone.append(first)
        else:
            # One delay for all: the column of their common value is the sum.
            H[:, first] = H[:, list(bus.places)].sum(axis=1)
        gone += others
    kept = np.setdiff1d(np.arange(len(rows.names)), gone)
    names, units = (tuple(texts[place] for place in kept) for texts in (rows.names, rows.units))
    return replace(rows, names=names, units=units, H=H[:, kept], y=y)


def _projection(white: Array, rows: list[Array]) -> tuple[Array, Array]:
    """Return P (p, p) and G (p, c): x of least squares with A x = b is P x + G b."""
    p = len(white)
    if not rows:
        return np.eye(p), np.zeros((p, 0))
    A = np.array(rows)
    inverse = safely(np.linalg.pinv, A @ white @ A.T, what="the delays of the commands")
    G = white @ A.T @ inverse
    return np.eye(p) - G @ A, G


def _constrained(
    estimate: Estimate,
    white: Array,
    rows: list[Array],
    wanted: list[float],
    stds: Mapping[int, float],
) -> Estimate:
    """Return an estimate with rows @ x = wanted, some of which have a standard deviation."""
    P, G = _projection(white, rows)
    covariance = P @ estimate.covariance @ P.T
    # Errors of the data under the constraints; what a stated value adds comes below.
    variances = np.diag(covariance).copy()
    for row, std in stds.items():
        covariance = covariance + std**2 * np.outer(G[:, row], G[:, row])
    freedom, errors = estimate.degrees_of_freedom, estimate.white_standard_errors
    total = np.diag(covariance)
    if freedom is not None:
        # Welch and Satterthwaite: the stated part of the variance has no degrees of freedom
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            freedom = freedom * (total / variances) ** 2
        freedom = np.where(np.isfinite(freedom), freedom, np.inf)
    if errors is not None:
        ratio = np.diag(P @ white @ P.T) / np.maximum(np.diag(white), 1e-300)
        errors = errors * np.sqrt(np.maximum(ratio, 0.0))
    return replace(
        estimate,
        values=P @ estimate.values + G @ np.array(wanted),
        covariance=covariance,
        degrees_of_freedom=freedom,
        white_standard_errors=errors,
    )


def with_estimated_delays(robot: Robot, identified: Robot) -> Robot:
    """Return the robot with the delays of an estimate as nominal ones; itself if they converged.

    Raises IdentificationError for a delay that is far beyond the range of the linearisation.
    """
    drives: dict[str, Drive] = {}
    of_buses: dict[float, list[float]] = {}
    for joint, drive in robot.drives.items():
        if drive.controller is None or DELAY_PARAMETER in drive.known:
            continue
        delay, near = identified.drives[joint].values[DELAY_PARAMETER], drive.command_delay_s or 0.0
        if drive.is_up_to_scale and "gain_scale" not in drive.known:
            # the slope by the delay was that of the nominal scale
            scale, before = (max(x.scale_of_gains, 1e-9) for x in (identified.drives[joint], drive))
            delay = near + (delay - near) * before / scale
            if abs(scale / before - 1) > _SCALE:
                drive = drives[joint] = drive.with_values({"gain_scale": scale})
        if abs(delay) > LARGEST_DELAY_S:
            raise IdentificationError(
                f"the command of {joint} seems delayed by {delay * 1e3:.3g} ms, more than "
                f"{LARGEST_DELAY_S * 1e3:g} ms either way, where the search ends: check the gains "
                "of its controller, and the signs and clocks of commands and positions; commands "
                "that act so late are shifted in the description of the log:\n"
                f"{toml_table('joints', joint)}\n"
                f'position_command = {{ column = "...", delay_s = {-delay:.3g} }}'
            )
        seen = of_buses.setdefault(near, [])
        delay = next((known for known in seen if abs(known - delay) < _ROUNDING_S), delay)
        seen.append(delay)
        if abs(delay - near) > _DELAY_S:
            drives[joint] = replace(drive, command_delay_s=delay)
    return robot.with_drives(drives) if drives else robot
