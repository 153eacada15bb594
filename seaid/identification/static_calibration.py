"""Calibration from statics: the law of a spring, gain and offset of a torque sensor.

The loads are known: dead weights, or gravity at held poses. The reading (a deflection, or the raw
value of a sensor) has the errors, so that load = law(reading) is estimated with functions of the
load as instruments: unbiased by noise of the reading, and for a straight line the same as the
regression of the reading on the load. Friction opposes the change of the load: under the same load
the reading differs between up and down; the mean is the law, half of the difference is friction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.special import stdtr

from seaid._arrays import Array, frozen, runs, safely
from seaid._progress import Result, counted
from seaid.checks.values import calibration_findings
from seaid.drives import Drive, ParameterName
from seaid.drives.drives import deflection
from seaid.errors import Finding, IdentificationError, LogError, checked, listed
from seaid.estimation import Estimate
from seaid.log import Log
from seaid.log.channels import UNIT_FACTORS
from seaid.log.readers.opening import open_tables
from seaid.regressor import joint_torques
from seaid.robot import Robot, at_drives, torques_at_drives

Law = Literal["linear", "cubic"]

_GRAVITY = 9.80665
"""Standard gravity [m/s^2], by which the mass of a dead weight is a force."""

_FEWEST = 5
"""Fewest loads of a calibration; each direction needs three of its own."""

_TURNS = 50
"""Most iterations of Gauss and Newton; a straight line needs one, a cubic law a few."""

_SIGNIFICANT = 0.01
"""Level at which a cubic term or friction counts as supported by the data."""


@dataclass(frozen=True, eq=False, repr=False)
class Statics:
    """Loads and readings at rest, in the order in which they were taken.

    Attributes
    ----------
    load, reading : array (T,)
        Loads [N m, or N], and deflections or raw values of a sensor.
    load_unit : {"N m", "N"}
    reading_unit : str
        "rad" and "m" are deflections of a spring; any other one is a sensor's, such as "mV".
    direction : array (T,) of 1, -1 or 0
        Whether the load rose or fell before the reading; 0: unknown.
    """

    load: Array
    reading: Array
    load_unit: str = "N m"
    reading_unit: str = "rad"
    direction: Array | None = None


@dataclass(frozen=True, eq=False, repr=False)
class StaticCalibration(Result):
    """The result of `calibrate_statics`; str() is its table.

    Attributes
    ----------
    statics : Statics
        The loads and readings, with directions.
    law : {"linear", "cubic"}
        load = k d, or k d + k_3 d^3, with d = reading less its zero.
    estimate : Estimate
        "stiffness" (of a sensor "gain"), "cubic_stiffness" (cubic law), "zero" (the reading without
        a load), and "friction" if loads rose and fell; the intervals are by Student's t. Its
        `residual_std` is that of load less law and friction, by the degrees of freedom.
    linearity, hysteresis : float
        Largest distance of the cubic law from the straight line at the readings, and mean
        difference of the load between up and down, as parts of the range of the load; hysteresis is
        NaN without both directions.
    cubic_p_value : float
        Probability of so large a cubic term by chance.
    warnings : tuple of Finding
    """

    table_name = "statics_table"

    statics: Statics
    law: Law
    estimate: Estimate
    linearity: float
    hysteresis: float
    cubic_p_value: float
    warnings: tuple[Finding, ...] = ()

    def _in_short(self) -> str:
        estimate = self.estimate
        value = f"{estimate.names[0]} {estimate.values[0]:.4g} {estimate.units[0]}"
        return f"{value}, rms {estimate.residual_std:.3g} {self.statics.load_unit}"


@checked(IdentificationError)
def calibrate_statics(statics: Statics, *, law: Law = "linear") -> StaticCalibration:
    """Calibrate a spring or a torque sensor by known static loads.

    Parameters
    ----------
    statics : Statics
        Loads and readings: of arrays, `read_statics` or `held_poses`. A missing `direction` follows
        from the order of the loads, so that a slow ramp up and down separates friction.
    law : {"linear", "cubic"}
        A straight line, or one with a cubic term.

    Returns
    -------
    StaticCalibration

    Raises
    ------
    IdentificationError
        For fewer than five loads, values that are not finite, and loads or readings that do not
        change.

    Examples
    --------
    >>> loads = np.linspace(-14.7, 14.7, 18)
    >>> statics = seaid.identification.Statics(loads, loads / 159.8)
    >>> print(seaid.identification.calibrate_statics(statics))
    """
    statics = _checked(statics)
    line, cubic = (_estimate(statics, name) for name in ("linear", "cubic"))
    estimate = line if law == "linear" else cubic
    assert cubic.degrees_of_freedom is not None
    # The probability of so large a cubic term by chance.
    ratio = abs(cubic.values[1]) / max(cubic.standard_errors[1], 1e-300)
    p_value = float(2 * stdtr(cubic.degrees_of_freedom[1], -ratio))
    spread = statics.load.max() - statics.load.min()
    curve = _load_at(cubic, statics.reading) - _load_at(line, statics.reading)
    friction = estimate.value("friction") if "friction" in estimate.names else np.nan
    count = len(statics.load)
    rms = estimate.residual_std * np.sqrt(1 - len(estimate.names) / count)
    share, gain, is_curved = rms / np.std(statics.load), estimate.values[0], p_value < _SIGNIFICANT
    findings = calibration_findings(float(share), float(gain), law, p_value, is_curved=is_curved)
    return StaticCalibration(
        statics=statics,
        law=law,
        estimate=estimate,
        linearity=float(np.max(np.abs(curve)) / spread),
        # Between rising and falling loads there is twice the friction.
        hysteresis=float(2 * abs(friction) / spread),
        cubic_p_value=p_value,
        warnings=tuple(findings),
    )


def _checked(statics: Statics) -> Statics:
    """Return the statics with directions. Raises IdentificationError for what gives no law."""
    load = frozen("load", statics.load, (None,), IdentificationError)
    reading = frozen("reading", statics.reading, (len(load),), IdentificationError)
    for name, values in (("load", load), ("reading", reading)):
        if not np.all(np.isfinite(values)):
            raise IdentificationError(
                f"{name} {int(np.argmin(np.isfinite(values))) + 1} is not finite: remove its row"
            )
        if len(values) < _FEWEST or np.ptp(values) == 0:
            text = f"{len(values)} of them" if len(values) < _FEWEST else f"all {values[0]:g}"
            raise IdentificationError(
                f"a calibration needs {_FEWEST} or more {name}s that differ, found {text}"
            )
    if statics.load_unit not in ("N m", "N"):
        raise IdentificationError(f"load_unit must be 'N m' or 'N', found '{statics.load_unit}'")
    declared = statics.direction
    direction = _direction(load) if declared is None else np.sign(np.asarray(declared, dtype=float))
    direction = frozen("direction", direction, (len(load),), IdentificationError)
    return replace(statics, load=load, reading=reading, direction=direction)


def _direction(load: Array) -> Array:
    """Return whether the loads (T,) rise (1) or fall (-1); a repeated load as the one before."""
    step = np.sign(np.diff(load))
    known = np.flatnonzero(step)
    # The last change before a sample that repeats its load, or the first one of all.
    before = known[np.clip(np.searchsorted(known, np.arange(len(step)), "right") - 1, 0, None)]
    direction = step[before]
    return np.concatenate([direction[:1], direction])


_POWERS: dict[Law, Array] = {"linear": np.array([1]), "cubic": np.array([1, 3])}
"""{law: the powers of the deflection d = reading - zero, whose sum it is}."""


def _load_at(estimate: Estimate, reading: Array) -> Array:
    """Return the load (P,) of a law at readings, without friction."""
    theta = estimate.values[: estimate.names.index("zero") + 1]
    return _predicted(theta, reading, np.empty((len(reading), 0)))[0]


def _estimate(statics: Statics, law: Law) -> Estimate:
    """Return the instrumental-variable estimate: Z^T (load - law) = 0, Z of the load alone."""
    load, reading, direction = statics.load, statics.reading, np.asarray(statics.direction)
    has_friction = bool(min(np.sum(direction > 0), np.sum(direction < 0)) >= 3)
    powers, force, length = _POWERS[law], statics.load_unit, statics.reading_unit
    gain = "stiffness" if length in ("rad", "m") else "gain"
    of_powers = {gain: f"{force}/{length}", f"cubic_{gain}": f"{force}/{length}^3"}
    names = dict(list(of_powers.items())[: len(powers)]) | {"zero": length}
    names |= {"friction": force} if has_friction else {}
    directions = direction[:, None][:, : int(has_friction)]
    slope, offset = np.polyfit(reading, load, 1)
    # load = a reading + b = k (reading - zero): k = a, zero = -b / a.
    theta, zero, spread = np.zeros(len(names)), len(powers), np.ptp(reading)
    theta[0], theta[zero] = slope, -offset / slope
    nearest = min(theta[zero], np.min(reading) - spread), max(theta[zero], np.max(reading) + spread)
    # the part of the reading that the load explains, without its noise
    basis = np.column_stack([np.ones_like(load), load[:, None] ** powers, directions])
    fitted = safely(np.linalg.lstsq, basis, reading, rcond=None, what="the loads")
    readings = reading, basis @ fitted[0]
    for _ in range(_TURNS):
        inverse, Z, residual = _moments(theta, load, readings, directions)
        step = inverse @ (Z.T @ residual)
        theta = theta + step
        # Readings that do not follow the load have no law, and a search for its zero never ends.
        theta[zero] = np.clip(theta[zero], *nearest)
        if np.all(np.abs(step) <= 1e-12 * np.maximum(np.abs(theta), 1e-9)):
            break
    inverse, Z, residual = _moments(theta, load, readings, directions)
    freedom = len(load) - len(theta)
    variance = residual @ residual / max(freedom, 1)
    # s^2 (Z^T J)^-1 Z^T Z (Z^T J)^-T of instrumental variables.
    covariance = variance * inverse @ (Z.T @ Z) @ inverse.T * _correlation_factor(residual)
    return Estimate(
        names=ParameterName.all_of(names),
        values=theta,
        covariance=covariance,
        units=tuple(names.values()),
        residual_std=float(np.sqrt(variance)),
        condition_number=float("nan"),
        degrees_of_freedom=np.full(len(theta), float(freedom)),
    )


def _moments(
    theta: Array, load: Array, readings: tuple[Array, Array], directions: Array
) -> tuple[Array, Array, Array]:
    """Return (Z^T J)^-1, the instruments Z (T, p), and the residual (T,) of a law.

    J are its slopes at the first of the `readings`, and Z those at the second, without noise.
    """
    (predicted, J), (_, Z) = (_predicted(theta, reading, directions) for reading in readings)
    what = "the law: give more different loads"
    return safely(np.linalg.inv, Z.T @ J, what=what), Z, load - predicted


def _predicted(theta: Array, reading: Array, directions: Array) -> tuple[Array, Array]:
    """Return the load (T,) of a law, and its slopes (T, p) by the parameters.

    `directions` (T, 1) are those of friction, (T, 0) without it.
    """
    count = len(theta) - 1 - directions.shape[1]
    k, d, powers = theta[:count], (reading - theta[count])[:, None], _POWERS["cubic"][:count]
    by_zero = -(powers * d ** (powers - 1)) @ k
    load = d**powers @ k + directions @ theta[count + 1 :]
    return load, np.column_stack([d**powers, by_zero, directions])


def _correlation_factor(residual: Array) -> float:
    """Return the factor (1 + r)/(1 - r) on variances for residuals correlated by r at lag 1.

    A ramp has many samples that are not independent; a table of weights is not corrected for a
    correlation that chance explains.
    """
    # A first-order process has r^|k| at lag k, whose sum over all k is (1 + r) / (1 - r).
    centred = residual - np.mean(residual)
    r = float(centred[1:] @ centred[:-1] / max(float(centred @ centred), 1e-300))
    return (1 + r) / (1 - min(r, 0.999)) if r > 2 / np.sqrt(len(centred)) else 1.0


# Where statics come from

_UNITS = {"load": ("Nm", "N"), "deflection": ("rad", "m"), "lever": ("m",)}
"""{what a column <what>_<unit> of a table of statics has: its SI units}; a column sensor_<unit> is
a reading in any unit."""


@checked(IdentificationError)
def read_statics(path: str | Path) -> Statics:
    """Read a table of loads and readings, such as a CSV file with a header.

    The load is `load_Nm` or `load_N` (`_mNm`, `_Ncm`, `_kN`), or `mass_kg` with `lever_m` (torque
    by 9.80665 m/s^2) or without (force). The reading is `deflection_rad` (`_mrad`, `_deg`, `_m`,
    `_mm`), or `sensor_<unit>` in any unit. A column `direction` of 1 and -1 is optional.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Statics

    Raises
    ------
    IdentificationError
        For a file that cannot be read, missing columns, and values that are no numbers.

    Examples
    --------
    >>> rows = [[load, load / 160.0] for load in range(6)]
    >>> header = "load_Nm,deflection_rad"
    >>> np.savetxt("weights.csv", rows, header=header, delimiter=",", comments="")
    >>> seaid.identification.calibrate_statics(seaid.identification.read_statics("weights.csv"))
    """
    try:
        table = open_tables([Path(path)])
        meanings = {name: x for name in table.names if (x := _meaning(name)) is not None}
        columns = table.load(list(meanings)) if meanings else {}
    except LogError as problem:
        raise IdentificationError(str(problem)) from None
    measured: dict[str, tuple[Array, str]] = {}
    for name, (what, factor, unit) in meanings.items():
        measured.setdefault(what, (factor * columns[name], unit))
    if "mass" in measured:
        weights, lever = _GRAVITY * measured["mass"][0], measured.get("lever")
        by_mass = (weights, "N") if lever is None else (weights * lever[0], "Nm")
        measured.setdefault("load", by_mass)
    if not {"load", "reading"} <= {*measured}:
        raise IdentificationError(
            f"'{path}' needs a column of loads and one of readings (load_Nm, load_N or mass_kg "
            "(and lever_m), and deflection_rad, deflection_m or sensor_mV, in any such unit), "
            f"found {listed(table.names)}"
        )
    (load, load_unit), (reading, unit) = measured["load"], measured["reading"]
    direction = measured.get("direction", (None, ""))[0]
    return Statics(load, reading, load_unit.replace("Nm", "N m"), unit, direction)


def _meaning(name: str) -> tuple[str, float, str] | None:
    """Return what a column of a table has, its factor, and its unit then; None for another one."""
    what, _, unit = name.partition("_")
    if name in ("mass_kg", "direction"):
        return what, 1.0, unit
    if what == "sensor" and unit:
        return "reading", 1.0, unit
    for si in _UNITS.get(what, ()):
        if unit in UNIT_FACTORS[si]:
            return what.replace("deflection", "reading"), UNIT_FACTORS[si][unit], si
    return None


_HELD_S, _SMOOTH_S, _MOVES = 0.3, 0.1, 0.01
"""Least time at a pose [s], average of a speed [s], and share of the range of a position that it
may move by in that time at rest."""


@checked(IdentificationError)
def held_poses(
    robot: Robot, log: Log, joint: str, *, sensor: Literal["spring", "torque"] = "spring"
) -> Statics:
    """Return the gravity torque of a joint and a reading at the held poses of a log.

    The bodies and payloads of the robot must be known: they are the dead weights. Poses at which
    all joints rest for 0.3 s or longer are averaged.

    Parameters
    ----------
    robot : Robot
    log : Log
    joint : str
        The joint that is calibrated.
    sensor : {"spring", "torque"}
        "spring": the deflection of its spring, between the encoders or by its own sensor; "torque":
        the torque sensor of the joint.

    Returns
    -------
    Statics

    Raises
    ------
    IdentificationError
        For a joint without a spring or sensor, unknown bodies, and fewer than five poses.
    """
    robot.selected(joint)
    if joint not in log.joint_names:
        raise IdentificationError(
            f"the log has no joint '{joint}'; it has {listed(log.joint_names)}"
        )
    if not np.all(np.isfinite(robot.parameters)):
        raise IdentificationError("held poses need the inertial parameters of the bodies")
    drive = robot.drives[joint]
    order = list(map(log.joint_names.index, robot.joint_names))
    position = log.joint_position[:, order]
    turned = at_drives(robot.transmission, *robot.drive_states(position))[:, robot.index(joint)]
    values = _sensed(drive, log, log.joint_names.index(joint), sensor, turned)
    if np.isnan(values[0]) or np.any(np.isnan(position[0])):
        wanted = {"spring": "a spring with both encoders, or its deflection", "torque": "a sensor"}
        raise IdentificationError(
            f"joint '{joint}' needs {wanted[sensor]}, and all joints their positions in the log"
        )
    spans = _rests(log.time, position)
    if len(spans) < _FEWEST:
        raise IdentificationError(
            f"the log has {counted(len(spans), 'held pose')}, at least {_FEWEST} are needed: hold "
            f"each for more than {_HELD_S} s"
        )
    poses = np.array([position[span].mean(axis=0) for span in spans])
    reading = np.array([values[span].mean() for span in spans])
    nothing = np.zeros_like(poses)
    behind = robot.drive_states(poses, nothing, nothing)
    torques = joint_torques(robot, *behind)
    if sensor == "torque":
        load = (robot.angle_ratios.rates(poses) * torques)[:, robot.index(joint)]
        return Statics(load, reading, drive.joint_units[0], drive.joint_units[0])
    # The spring of a drive that moves several joints has the torque on phi = C q.
    load = torques_at_drives(robot.transmission, torques)[:, robot.index(joint)]
    return Statics(load / drive.load_radius, reading, *drive.spring_units)


def _sensed(drive: Drive, log: Log, place: int, sensor: str, turned: Array) -> Array:
    """Return the torque sensor (T,) of a joint, or the deflection of its spring; NaN without.

    The load side of the spring has the angle `turned` (T,).
    """
    if sensor == "torque" and log.joint_torque is not None:
        return log.joint_torque[:, place]
    if sensor == "torque" or not drive.is_elastic:
        return np.full(len(log.time), np.nan)
    if log.deflection is not None and not np.isnan(log.deflection[0, place]):
        return drive.load_radius * log.deflection[:, place]
    return deflection(drive, log.motor_position[:, place], turned)


def _rests(time: Array, position: Array) -> list[slice]:
    """Return the spans in which all positions (T, n) rest."""
    window = max(1, round(_SMOOTH_S * (len(time) - 1) / float(time[-1] - time[0])))
    # Change over a window, by which noise and steps of an encoder weigh less than in a speed.
    moved = np.abs(position[window:] - position[:-window])
    allowed = _MOVES * np.maximum(np.ptp(position, axis=0), 1e-9)
    still = np.concatenate([np.all(moved <= allowed, axis=1), np.zeros(window, dtype=bool)])
    long = [x for x in runs(still) if time[x[1] - 1] - time[x[0]] >= _HELD_S]
    return [slice(int(first), int(end)) for first, end in long]
