"""Terms of friction and springs that the rows of an identification support and its drives lack.

All candidate columns are compared at the rows of the fit (`model_comparison`), by the rules of
`compare_terms`. A drive whose friction nobody named gets the supported ones of `DEFAULTS`; about
every other drive a finding names the best term. Orders of motor, joint and mesh angle, the errors
of a gear that are periodic, are tried as columns in the same way, one by one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, white_noise
from seaid._files import toml_table
from seaid.drives import DefaultTerms, Drive
from seaid.errors import Finding, IdentificationError, Severity
from seaid.estimation import Alternative, best_supported, compare_models, scaled_svd
from seaid.identification.datasets import Dataset
from seaid.identification.term_columns import (
    LEAST_TORQUE,
    PROMISING,
    DriveRows,
    TermComparison,
    actuator_drive,
    best_term,
    coarse_motions,
    compared_columns,
    decimated_by,
    evidence_of,
    explained_squares,
    load_drive,
    possible_terms,
    promising_terms,
    reference_position,
    toml_of,
    with_term,
)
from seaid.identification.two_step import RobotEstimate
from seaid.log import Log, Motion, in_band_at, still_speed
from seaid.regressor import actuator_equation, actuator_regression, motor_regressor, stacked
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.identification.identification import Identification
    from seaid.regressor import Regression

DEFAULTS = ("offset", "smooth_coulomb")
"""Friction terms that a drive gets by itself where the data support them."""

MOST_ROUNDS = 4
"""Largest number of fits with more terms of drives whose friction nobody named."""

_STIFF = {"friction": (*DEFAULTS, "asymmetric", "quadratic", "stribeck")}
_ELASTIC = {
    "friction": ("smooth_coulomb", "asymmetric", "quadratic", "load", "stribeck"),
    "spring": ("cubic", "fifth", "dead_zone"),
}
"""Candidates: those of a stiff drive have no load-dependent friction, which needs another fit."""

_COMMANDED = {"friction": ("coulomb_position",), "parallel_spring": ("linear",)}
"""Further candidates of a drive with a controller, whose errors over the position its closed loop
shows: without them one calf of a Unitree Go2 has six times the error of the other joints."""

_STRONG = 6.0
"""Least difference of the information criterion, "strong" by Kass and Raftery (1995).

`compare_terms` is asked, this is not: above zero 3 of 120 right set-ups have a
finding, all of them below 4 (scripts/benchmarks/term_selection.py --findings)."""

_MATTERS = 0.25
"""Part of the squared residual that makes a missing friction term doubtful: the residual falls by
an eighth. A spring that is not linear always is, since its stiffness has no single value."""


def supported_terms(
    robot: Robot,
    datasets: Sequence[Dataset],
    found: RobotEstimate,
    widths: Mapping[str, float],
) -> dict[str, list[TermComparison]]:
    """Return {joint: comparisons of terms that its drive lacks}, none of rows not in memory.

    Terms that explain little at coarse samples have no comparison. The criterion is that of one
    comparison alone, see `_among`. `widths` {joint: width of Coulomb friction} that the encoders
    resolve.
    """
    motions = [one for one in datasets if isinstance(one, Motion)]
    if len(motions) < len(datasets) or found.fit.rows is None:
        return {}
    stiff = [
        joint
        for place, joint in enumerate(robot.joint_names)
        if joint not in robot.elastic_joints and np.any(found.fit.rows.joint == place)
    ]
    commanded = [joint for joint in stiff if robot.drives[joint].controller is not None]
    sides = [(fitted, [joint], False) for joint, fitted in found.actuators.items()]
    sides += [(found.fit, stiff, False), (found.fit, commanded, True)]
    grids = {joint: {"coulomb_width": _widths(width)} for joint, width in widths.items()}
    every = {joint: _candidates(robot.drives[joint]) for joint in (*found.actuators, *stiff)}
    coarse, comparisons = coarse_motions(motions), []
    for fitted, joints, at_joint in sides:
        rows, theta, is_whole = fitted.rows, fitted.estimate.values, fitted.settled is not None
        if rows is None or not joints or not (is_whole or fitted.equal):  # robust ones lack rows
            continue
        of_joint: Callable[..., DriveRows] = partial(load_drive, at_joint=at_joint)
        if joints[0] in found.actuators:
            of_joint = actuator_drive
        asked = {
            joint: [one for one in every[joint] if (one[0] == "parallel_spring") == at_joint]
            for joint in joints
        }
        few = [of_joint(robot, motions, joint, rows, theta, coarse) for joint in joints]
        terms = promising_terms(few, fitted, asked, grids)
        drives = [of_joint(robot, motions, joint, rows, theta) for joint in joints if terms[joint]]
        comparisons += compared_columns(drives, fitted, terms, 1, grids=grids, only_promising=True)
    return {joint: [one for one in comparisons if one.joint == joint] for joint in every}


def _among(
    robot: Robot,
    terms: Mapping[str, Sequence[TermComparison]],
    counted: Callable[[Drive, str], bool],
) -> dict[str, list[TermComparison]]:
    """Return comparisons whose criterion allows for the number of those that are `counted`."""
    count = sum(
        counted(robot.drives[joint], term)
        for joint in terms
        for _, term in _candidates(robot.drives[joint])
    )
    penalty = 2 * math.log(max(count, 1))  # Chen and Chen 2008
    return {
        joint: [
            replace(one, comparison=replace(one.comparison, bic=one.comparison.bic - penalty))
            for one in found
            if one.comparison is not None
        ]
        for joint, found in terms.items()
    }


def _candidates(drive: Drive) -> list[tuple[str, str]]:
    found = list(possible_terms(drive, _ELASTIC if drive.is_elastic else _STIFF))
    if drive.controller is not None and not drive.is_elastic:
        found += possible_terms(drive, _COMMANDED)
    return found


_MULTIPLES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)


def _widths(resolved: float) -> list[float]:
    """Return the widths of Coulomb friction that are tried, from the one that is resolved."""
    return [multiple * resolved for multiple in _MULTIPLES]


def resolved_widths(
    robot: Robot, logs: Sequence[Log], datasets: Sequence[Dataset]
) -> dict[str, float]:
    """Return {joint: motor speed [rad/s] below which logs do not resolve the direction of motion}.

    One encoder step per sample, and the change of the speed within a sample at a reversal. The step
    is that of a quantised position of the same noise, whose standard deviation is step / sqrt(12).
    Not less than the speed below which a motor counts as standing: a smaller width would describe
    the friction of a motor that sticks, which has no sign, in rows next to standstill.
    """
    widths = {}
    motions = [one for one in datasets if isinstance(one, Motion)]
    for joint in robot.joint_names:
        speeds = []
        for log in logs:
            place = log.joint_names.index(joint)
            motor, ratio = log.motor_position[:, place], 1.0
            if not np.all(np.isfinite(motor)):
                motor, ratio = log.joint_position[:, place], robot.drives[joint].ratio
            noise = white_noise(motor)
            speeds.append(ratio * np.sqrt(12.0) * noise / float(np.median(np.diff(log.time))))
        width = float(np.median(speeds)) if speeds else 0.0
        if np.isfinite(width) and width > 0:
            index = robot.index(joint)
            turns = [_change_at_reversal(one, index) for one in motions]
            width = float(np.hypot(width, np.median(turns) if turns else 0.0))
            widths[joint] = max([width, *(still_speed(one, index) for one in motions)])
    return widths


def _change_at_reversal(motion: Motion, place: int) -> float:
    """Return the median change of a motor's speed [rad/s] within a sample at its reversals."""
    speed = motion.motor_velocity[:, place]
    reversals = np.flatnonzero(speed[1:] * speed[:-1] < 0)
    changes = np.abs(motion.motor_acceleration[reversals, place]) / motion.rate_hz
    return float(np.median(changes)) if len(changes) else 0.0


def with_default_terms(
    robot: Robot, given: Robot, terms: Mapping[str, Sequence[TermComparison]]
) -> tuple[Robot, Robot, list[Finding]]:
    """Return the robot with the supported terms of drives whose friction nobody named, and notes.

    The same drives stand in the robot as it was `given`.

    An offset is included if it is supported, a width of Coulomb friction if no other term is
    supported better: it is that of the comparison, as a known value. Other terms only compete: the
    criterion does not count them.
    """
    drives: dict[str, Drive] = {}
    notes = []
    for joint, found in _among(robot, terms, _is_default).items():
        best = best_term(found)
        if not isinstance(robot.drives[joint].friction, DefaultTerms):
            continue
        for one in found:
            is_added = one.term == "offset" or (one is best and one.term in DEFAULTS)
            if is_added and one.is_supported and one.comparison is not None:
                drive = with_term(drives.get(joint, robot.drives[joint]), one.field, one.term)
                drive = drive.with_values(one.values)
                drives[joint] = replace(
                    drive,
                    friction=DefaultTerms(drive.friction),
                    known=(*drive.known, *one.values),
                )
                share = one.comparison.explained
                width = "".join(f" over {value:.2g} rad/s" for value in one.values.values())
                message = (
                    f"friction of {joint}, of which the drive names no terms: "
                    f"'{one.term}'{width} is included and explains {share:.0%} of the squared "
                    "residual; name the terms in friction = [...] to decide it"
                )
                notes.append(
                    Finding("missing-term", message, joint, "note", evidence_of(one), "", "certain")
                )
    if drives:
        robot, given = robot.with_drives(drives), given.with_drives(drives)
    return robot, given, notes


def _is_default(drive: Drive, term: str) -> bool:
    return isinstance(drive.friction, DefaultTerms) and term in DEFAULTS


def with_closed_terms(robot: Robot, identified: Robot) -> Robot:
    """Return the robot with the terms of an `identified` one where nobody named friction terms."""
    drives: dict[str, Drive] = {}
    for joint, drive in robot.drives.items():
        if isinstance(drive.friction, DefaultTerms):
            other = identified.drives[joint]
            drive = replace(drive, friction=tuple(other.friction))
            if "coulomb_width" in other.known:
                drive = drive.with_values({"coulomb_width": other.values["coulomb_width"]})
                drive = replace(drive, known=(*drive.known, "coulomb_width"))
            drives[joint] = drive
    return robot.with_drives(drives)


_UNRESOLVED = 2.0
"""Width of Coulomb friction, over the one that the logs resolve, up to which it is that of the
sampling: of an encoder step, or of a sample in which the speed changes its sign."""


_FOLLOWS = {
    "coulomb_position": "the residual of {} follows its position, with the sign of its speed",
    "linear": "the residual of {} follows its position",
}
"""{candidate of a drive with a controller: what its support means}."""


def missing_terms(
    robot: Robot,
    terms: Mapping[str, Sequence[TermComparison]],
    widths: Mapping[str, float],
    datasets: Sequence[Dataset] = (),
) -> Iterator[Finding]:
    """Yield the best supported term of each drive that lacks it; `widths` are resolved by logs."""
    motions = [one for one in datasets if isinstance(one, Motion)]
    for joint, found in _among(robot, terms, lambda *_: True).items():
        best = best_term(found)
        if best is None or best.comparison is None or best.comparison.bic < _STRONG:
            continue
        drive, share = robot.drives[joint], best.comparison.explained
        if drive.controller is not None and not drive.is_elastic:  # of one of n equal parts
            share = min(1.0, robot.n * share)
        is_spring = best.field == "spring"
        is_sampled = best.values.get("coulomb_width", np.inf) <= _UNRESOLVED * widths.get(joint, 0)
        matters = is_spring or (share > _MATTERS and not is_sampled)
        severity: Severity = "doubtful" if matters else "note"
        what = f"the spring of {joint} is not linear" if is_spring else f"{joint} lacks a term"
        what = _FOLLOWS.get(best.term, what).format(joint)
        middle = ""
        if best.term == "coulomb_position" and not drive.reference_position_rad:
            at = reference_position(motions, robot.index(joint))
            middle = f"\nreference_position_rad = {at:g}"
        message = (
            f"{what}: '{best.term}' in its {best.field} would explain {share:.0%} of the squared "
            f"residual of its {'motor' if drive.is_elastic else 'torque'} equation and improve "
            f"the prediction of excluded blocks by {best.comparison.improvement:.0%}"
        )
        yield Finding(
            "nonlinear-spring" if is_spring else "missing-term",
            message,
            joint,
            severity,
            evidence_of(best),
            f"in the drives file:\n{toml_of(drive, best)}{middle}",
        )


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
    findings = (_periodic(found, joint, coarse) for joint in joints if found.motions)
    return tuple(one for one in findings if one is not None)


def _periodic(found: Identification, joint: str, coarse: Sequence[Motion]) -> Finding | None:
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
