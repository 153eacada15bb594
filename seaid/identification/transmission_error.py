"""Errors of the gear that are periodic: found in the residual of (10), and named as terms.

Orders of motor, joint and mesh angle are tried as columns next to those of the drive, one by one,
by the criterion and the prediction of excluded blocks that decide on all terms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid._files import toml_table
from seaid.errors import Finding, IdentificationError
from seaid.estimation import Alternative, best_supported, compare_models, scaled_svd
from seaid.identification.term_columns import (
    LEAST_TORQUE,
    PROMISING,
    coarse_motions,
    decimated_by,
    explained_squares,
)
from seaid.log import in_band_at
from seaid.regressor import (
    actuator_equation,
    actuator_regression,
    motor_regressor,
    stacked,
)

if TYPE_CHECKING:
    from seaid.identification.identification import Identification
    from seaid.log import Motion
    from seaid.regressor import Regression

_Order = tuple[str, int]

_ORDERS = [
    *(("motor", order) for order in (1, 2, 3, 4, 6)),
    *(("joint", order) for order in (1, 2, 3, 4, 5, 6, 8, 10, 12)),
    *(("mesh", order) for order in (1, 2)),
]
"""Orders that are tried: turns and poles of the motor, turns of the joint, and the two lobes of
strain-wave gears. Higher orders of the motor turn faster than a cutoff lets pass."""

_LEAST_PERIODS = 0.5
"""An order is tried if the motion covers so many of its periods; fewer look like the spring."""

_LEAST_LEFT = 0.1
"""Least part of a column that the low pass and the other columns leave, to be tried at all."""

_DOUBTFUL_SHARE = 0.3
"""Share of the residual that orders must explain to make a result doubtful."""

_MOST_ORDERS = 4


def periodic_findings(found: Identification) -> tuple[Finding, ...]:
    """Return findings on joints whose residual of (10) is periodic in motor, joint or mesh."""
    joints = [joint for joint in found.known.elastic_joints if joint in found.drive_side]
    coarse = coarse_motions(found.motions) if joints else []
    findings = (_finding(found, joint, coarse) for joint in joints if found.motions)
    return tuple(one for one in findings if one is not None)


def _finding(found: Identification, joint: str, coarse: Sequence[Motion]) -> Finding | None:
    rows = stacked([actuator_regression(found.known, one, joint) for one in found.motions])
    if not set(rows.names) <= set(found.drive_side[joint].names):
        return None
    basis = np.linalg.qr(rows.H / np.maximum(np.linalg.norm(rows.H, axis=0), 1e-300))[0]
    whole = residual = _beside(basis, rows.y)
    least = len(rows.y) * (LEAST_TORQUE * float(np.std(rows.y))) ** 2
    if whole @ whole < least:
        return None
    angles = [_angles(found, motion, joint) for motion in found.motions]
    orders = _orders(found, joint, angles)
    if not orders:
        return None
    pairs = _pairs(found.motions, rows, angles, orders, coarse)
    selected: dict[_Order, float] = {}
    while len(selected) < _MOST_ORDERS:
        needed = max(PROMISING * float(residual @ residual), least)
        promising = [
            one
            for one, pair in pairs.items()
            if explained_squares(_beside(basis, pair), residual) > needed
        ]
        if not promising:
            break
        exact = _pairs(found.motions, rows, angles, promising)
        tried = {one: pair for one, pair in exact.items() if _is_left(basis, pair)}
        best = _supported(rows, tried, len(_ORDERS))
        if best is None:
            break
        del pairs[best]
        rows = replace(
            rows,
            names=(*rows.names, *(f"{best} {part}" for part in ("cos", "sin"))),
            units=(*rows.units, "", ""),
            H=np.hstack([rows.H, tried[best]]),
        )
        own = _beside(basis, tried[best])
        selected[best] = float(np.linalg.norm(scaled_svd(own).solve(residual)))
        basis = np.linalg.qr(np.hstack([basis, own]))[0]
        residual = _beside(basis, rows.y)
    if not selected:
        return None
    share = 1 - float(residual @ residual) / float(whole @ whole)
    return _named(found, joint, list(selected), share, max(selected.values()))


def _supported(rows: Regression, columns: Mapping[_Order, Array], asked: int) -> _Order | None:
    """Return the best order that criterion and prediction support, None without any."""
    try:
        alternatives = [Alternative(pair, 2) for pair in columns.values()]
        compared = compare_models(rows, np.ones(1), alternatives, asked, only_promising=True)
    except IdentificationError:  # too few rows
        return None
    place = best_supported(compared)
    return None if place is None else list(columns)[place]


def _orders(
    found: Identification, joint: str, angles: Sequence[Mapping[str, Array]]
) -> list[_Order]:
    """Return the orders that the drive lacks and the motion covers."""
    drive = found.known.drives[joint]
    own = {(one.angle, one.order) for one in drive.harmonics}
    wide = {name: max(float(np.ptp(one[name])) for one in angles) for name in angles[0]}
    if wide["motor"] < 2 * np.pi * drive.ratio:  # the mesh has the orders of the motor
        del wide["mesh"]
    return [
        (name, order)
        for name, order in _ORDERS
        if name in wide
        and (name, order) not in own
        and order * wide[name] >= 2 * np.pi * _LEAST_PERIODS
    ]


def _pairs(
    motions: Sequence[Motion],
    rows: Regression,
    angles: Sequence[Mapping[str, Array]],
    orders: Sequence[_Order],
    coarse: Sequence[Motion] = (),
) -> dict[_Order, Array]:
    """Return cosine and sine (R, 2) of orders at the rows, of `coarse` motions if given."""
    parts = []
    for run, (motion, by_name) in enumerate(zip(motions, angles, strict=True)):
        step = decimated_by(motion) if coarse else 1
        x = [order * by_name[name][::step] for name, order in orders]
        columns = np.column_stack([part for one in x for part in (np.cos(one), np.sin(one))])
        kept = np.searchsorted(motion.time, rows.time[rows.run == run])
        used, places = (coarse[run], kept / step) if coarse else (motion, kept)
        parts.append(in_band_at(used, columns, places))
    return dict(zip(orders, np.split(np.vstack(parts), len(orders), axis=1), strict=True))


def _angles(found: Identification, motion: Motion, joint: str) -> dict[str, Array]:
    """Return the angles (T,) by name."""
    drive, signals = found.known.drives[joint], actuator_equation(found.known, motion, joint)[1]
    angles = {"motor": signals["theta_M"], "mesh": signals["theta_M"] * (1 - 1 / drive.ratio)}
    if drive.joint_units[1] == "rad":
        angles["joint"] = signals["theta_L"]
    return angles


def _beside(basis: Array, columns: Array) -> Array:
    """Return columns without their part in an orthonormal basis."""
    return np.asarray(columns - basis @ (basis.T @ columns))


def _is_left(basis: Array, pair: Array) -> bool:
    full = np.sqrt(0.5 * len(pair))  # norm of a cosine over whole periods
    left = np.abs(np.diag(np.linalg.qr(_beside(basis, pair))[1]))
    return bool(np.min(left) > _LEAST_LEFT * full)


def _is_motor_equation(found: Identification, joint: str) -> bool:
    regressor, _ = actuator_equation(found.known, found.motions[0], joint)
    return regressor is motor_regressor(found.known, joint)


def _named(
    found: Identification, joint: str, selected: Sequence[_Order], share: float, largest: float
) -> Finding:
    """Return the finding with the orders as TOML."""
    drive = found.known.drives[joint]
    is_error = joint not in found.gears and not drive.is_nonlinear_spring
    field = "transmission_error" if is_error else "torque_ripple"
    text = ", ".join(f"order {order} of the {angle}" for angle, order in selected)
    evidence = {"share of the residual": share}
    estimate = found.drive_side[joint]
    if is_error and "stiffness" in estimate.names and estimate.value("stiffness") > 0:
        lever = drive.motor_radius / drive.ratio if _is_motor_equation(found, joint) else 1.0
        error = largest / (lever * estimate.value("stiffness"))
        evidence["amplitude"] = error
        text += f"; up to {1e3 * error:.2g} m{drive.spring_units[1]} between the encoders"
    orders: dict[str, list[int]] = {}
    own = [(one.angle, one.order) for one in drive.harmonics if one.field == field]
    for angle, order in [*own, *selected]:
        orders.setdefault(angle, []).append(order)
    table = ", ".join(f"{angle} = {sorted(numbers)}" for angle, numbers in orders.items())
    return Finding(
        "transmission-error",
        f"{share:.0%} of the residual of (10) of {joint} is periodic ({text}): an error of the "
        "gear or its encoders, or ripple of the motor",
        joint,
        "doubtful" if share >= _DOUBTFUL_SHARE else "note",
        evidence,
        f"in the drives file:\n{toml_table(joint)}\n{field} = {{ {table} }}",
    )
