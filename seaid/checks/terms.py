"""Columns of the terms that a drive lacks, at the rows of a fit: what model comparisons consist of.

A term with parameters in which the equation is nonlinear has one set of columns per value on a
grid. Other columns are derivatives at the fit, where the level of the term is zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import chain, compress, product

import numpy as np

from seaid._arrays import Array
from seaid.checks import engine
from seaid.drives import DEAD_ZONES, IDEAL_DRIVE, PARAMETERS, PARAMETERS_OF, Drive, unit_of
from seaid.drives.drives import deflection, term_fields
from seaid.drives.regressor import DriveRegressor
from seaid.drives.terms import COULOMB, DRY, key_of
from seaid.errors import RobotError
from seaid.log import Motion, low_pass
from seaid.log.motion import POSITION_BAND
from seaid.log.rows import in_band_at
from seaid.regressor import Regression, joint_regressor, motor_regressor, regression
from seaid.robot import Robot, torques_at_drives

Grids = Mapping[str, Sequence[float]]
"""{nonlinear parameter: the values that are tried}."""

_DIRECTED = tuple(chain.from_iterable(PARAMETERS_OF["friction"][term] for term in DRY))
"""Parameters of friction whose columns have the sign of the speed, or its tanh."""


@lru_cache(256)
def with_term(drive: Drive, field: str, term: str) -> Drive:
    """Return the drive with one more term, without the values of parameters that it then lacks.

    A Coulomb term takes the place of another one, and so do dead zones.
    Raises RobotError for a term that the drive cannot have.
    """
    exclusive = set(COULOMB), set(DEAD_ZONES)  # a drive has at most one of each
    current = getattr(drive, field)
    kept = [x for x in current if not any({x, term} <= terms for terms in exclusive)]
    # In two steps: a drive refuses values, and known names, of parameters that it does not have.
    bare = replace(drive, nominal={}, known=(), **{field: (*kept, term)})  # type: ignore[arg-type]
    names = bare.parameter_names
    valued = bare.with_values({n: x for n, x in drive.values.items() if n in names})
    return replace(valued, known=tuple(name for name in drive.known if name in names))


def possible_terms(drive: Drive, asked: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, str]]:
    """Yield the terms (field, term) among those asked for that a drive lacks and can have."""
    for field in [x for x in asked if x in term_fields(drive)]:
        current = {*getattr(drive, field)}
        # A drive that has one of these shapes gets none of the others as a further term, except
        # `shifted_coulomb`, which adds a shift.
        shapes = {"friction": COULOMB[1:], "spring": (*DEAD_ZONES, "dahl")}.get(field, ())
        excluded = {*shapes, "coulomb"} - {"shifted_coulomb"} if current & {*shapes} else set()
        for term in asked[field]:
            if term not in current | excluded:
                with suppress(RobotError):  # what this drive cannot have
                    with_term(drive, field, term)
                    yield field, term


def reference_position(motions: Sequence[Motion], place: int) -> float:
    """Return the middle of the positions [rad or m] of a joint, of two digits.

    It is the origin of `coulomb_position`: about the middle of the range the Coulomb level is
    positive even if its slope is large.
    """
    positions = np.concatenate([motion.joint_position[:, place] for motion in motions])
    return float(f"{0.5 * (np.min(positions) + np.max(positions)):.2g}")


@dataclass(frozen=True, eq=False)
class DriveRows:
    """A drive at the rows of the side that has its equation.

    `theta` is the fit of the rows. `regressor` derives the equation of the side, which
    is that of the motor or of the spring; `signals` evaluate it. `factors` {index of an equation:
    factor (T,)} of each motion are those of the drive's columns in the equations.
    """

    robot: Robot
    motions: Sequence[Motion]
    joint: str
    rows: Regression
    theta: Array
    regressor: Callable[[Robot, str], DriveRegressor]
    signals: Sequence[Mapping[str, Array]]
    factors: Sequence[Mapping[int, Array]]

    @property
    def is_of_motor(self) -> bool:
        """Whether the equation is that of the motor, not that of the spring by a torque sensor."""
        return self.regressor is motor_regressor

    @cached_property
    def values(self) -> dict[str, float]:
        """The fitted values of the drive."""
        fitted = {name: float(self.theta[place]) for place, name in self.parameters.items()}
        return {**self.robot.drives[self.joint].values, **fitted}

    def has_parameter(self, name: str) -> bool:
        """Whether a parameter of the drive is one of the rows."""
        return name in self.parameters.values()

    @cached_property
    def parameters(self) -> dict[int, str]:
        """The parameters of the drive by their places among those of the rows."""
        names = enumerate(self.rows.names)
        return {place: x.quantity for place, x in names if x.owner in ("", self.joint)}

    def terms(self, field: str, term: str, grids: Grids) -> Iterator[engine.Alternative]:
        """Yield a term at each point of its grid; `grids` {parameter: values} replace its own."""
        drive = self.robot.drives[self.joint]
        larger = self.robot.with_drives({self.joint: with_term(drive, field, term)})
        old, new = (self.regressor(robot, self.joint) for robot in (self.robot, larger))
        new_names = [name for name in new.names if name not in old.names]
        # What the fit lacks is zero: the column of a nonlinear parameter is the derivative there.
        values = dict.fromkeys(new.names, 0.0) | dict(self.values)
        zero_value = _deflection_zero(values, grids) if "deflection_zero" in new_names else {}
        if zero_value is None:
            return
        values |= zero_value
        grid, changed = self._grid(new_names, grids), _changed(term, old, new, new_names)
        added = [name for name in new_names if name not in (*grid, "deflection_zero")]
        if not added and not grid:  # no part of this equation
            return
        # A law that replaces the sign of the speed replaces the columns of the fit that have it.
        is_changed = map(changed.__contains__, self.parameters.values())
        places = tuple(compress(self.parameters, is_changed))
        names = *changed, *added
        # The columns of all points (T, points c) are filtered at once.
        points = [dict(zip(grid, values_at, strict=True)) for values_at in product(*grid.values())]
        starts = [values | point for point in points]
        parts = [np.hstack([new.columns(x, each, names) for each in starts]) for x in self.signals]
        columns = np.split(self.at_rows(parts), len(points), axis=1)
        # Columns that replace others are no further parameters, values on a grid are.
        for point, H in zip(points, columns, strict=True):
            yield engine.Alternative(H, len(added) + len(grid), places, point | zero_value, names)

    def _grid(self, names: Sequence[str], grids: Grids) -> Grids:
        """Return the values of nonlinear parameters that are tried."""
        grid: dict[str, Sequence[float]] = {}
        for name in names:
            starts = PARAMETERS[name].starts
            if starts and PARAMETERS[name].is_positive:
                searched = [part * size_of(name, self._scale) for part in _dense(starts)]
                least = self._crossing if name == "coulomb_width" else 0.0
                grid[name] = grids.get(name) or [x for x in searched if x > least] or searched[-1:]
        return grid

    @property
    def _crossing(self) -> float:
        """Largest change of the motor speed [rad/s] from one sample to the next.

        A sharp friction that changes sign between two samples looks as smooth as that.
        """
        index = self.robot.index(self.joint)
        return max(float(np.max(np.abs(np.diff(x.motor_velocity[:, index])))) for x in self.motions)

    @cached_property
    def _scale(self) -> Scale:
        return scale_of(self.robot, self.motions, self.joint)

    def signal(self, name: str) -> Array:
        """Return a signal (R, 1) at all rows."""
        return self.at_rows([by_name[name][:, None] for by_name in self.signals])

    def through_gear(self, signals: Mapping[str, Array], motion: Motion) -> Array:
        """Return the torque (T,) behind the gear of a stiff drive by the fit.

        It is that of the motor without its friction and inertia, which the low pass of the
        positions smooths as the motion is.
        """
        regressor = self.regressor(self.robot, self.joint)
        zeta, R = regressor.evaluate(signals)
        torque = zeta - R @ np.array([self.values.get(str(name), 0.0) for name in regressor.names])
        torque *= self.robot.drives[self.joint].ratio
        return low_pass(torque[:, None], motion.rate_hz, POSITION_BAND * motion.cutoff_hz)[:, 0]

    def at_rows(self, parts: Sequence[Array]) -> Array:
        """Return columns (T, c) of torques at the samples of each motion at all rows (R, c).

        They are filtered as the rows are, and zero where friction in the equation is not known.
        """
        placed = np.zeros((len(self.rows.y), parts[0].shape[1]))
        for run, (motion, factors) in enumerate(zip(self.motions, self.factors, strict=True)):
            for index, factor in factors.items():
                chosen = np.flatnonzero((self.rows.joint == index) & (self.rows.run == run))
                # The times of rows are among those of the samples: this is their index.
                samples = np.searchsorted(motion.time, self.rows.time[chosen])
                placed[chosen] = in_band_at(motion, factor[:, None] * parts[run], samples)
        return placed


def _deflection_zero(values: Mapping[str, float], grids: Grids) -> dict[str, float] | None:
    """Return the zero about which the law of a spring is, None where the fit does not have it."""
    if values.get("stiffness", 0.0) <= 0:
        return None
    # k x + f_0 = 0: dead zones and odd laws are about the deflection without a force.
    rest = -values.get("spring_offset", 0.0) / values["stiffness"]
    return {"deflection_zero": grids.get("deflection_zero", (rest,))[0]}


def _dense(starts: Sequence[float]) -> list[float]:
    """Return the starts of a search and their geometric means, without a search after them."""
    # Sizes that differ by factors: half way is the geometric mean.
    return sorted([*starts, *np.sqrt(np.array(starts[1:]) * np.array(starts[:-1])).tolist()])


def _changed(
    term: str, old: DriveRegressor, new: DriveRegressor, new_names: Sequence[str]
) -> list[str]:
    """Return the parameters of the drive whose columns a term changes."""
    names: Sequence[str] = ()
    if {"coulomb_width", "presliding_angle"} & {*new_names}:  # in place of the sign in all friction
        names = _DIRECTED
    elif term in DEAD_ZONES:
        names = ("stiffness",)
    return [name for name in names if name in old.names and name in new.names]


def actuator_drive(
    robot: Robot, motions: Sequence[Motion], joint: str, rows: Regression, theta: Array
) -> DriveRows:
    """Return an elastic drive at the rows of its actuator side (10), with its fit `theta`."""
    equations = [regression.actuator_equation(robot, motion, joint) for motion in motions]
    # The other equation is (4b), with the torque of a sensor.
    is_motor = equations[0][0] == motor_regressor(robot, joint)
    regressor = motor_regressor if is_motor else regression.spring_regressor
    signals = [by_name for _, by_name in equations]
    index, drive = robot.index(joint), regressor(robot, joint)
    factors = [{index: regression.known_friction(robot, x, joint, drive)} for x in motions]
    return DriveRows(robot, motions, joint, rows, theta, regressor, signals, factors)


def load_drive(
    robot: Robot,
    motions: Sequence[Motion],
    joint: str,
    rows: Regression,
    theta: Array,
    parts: Sequence[Callable[[Array], dict[int, Array]]],
    *,
    at_joint: bool = False,
) -> DriveRows:
    """Return a drive at the rows of the load side (8): a stiff one, or what acts `at_joint`.

    `parts` are the functions `LoadSide.parts` of the motions.
    """
    index = robot.index(joint)
    # The rows of (8) are torques on the drives' coordinates: N times those of a motor, and those at
    # a joint by C^-T.
    unit, regressor = np.eye(robot.n)[index], motor_regressor
    shares = unit * robot.drives[joint].ratio
    signals = [regression.input_signals(robot, motion, index) for motion in motions]
    if at_joint:  # of its own states, also where a drive moves several joints
        shares, regressor = torques_at_drives(robot.transmission, unit), joint_regressor
        for by_name, motion in zip(signals, motions, strict=True):
            states = (state[:, index] for state in motion.joint_states)
            by_name |= dict(zip(("theta_L", "theta_L_dot", "theta_L_ddot"), states, strict=True))
    factors = [of_motion(shares) for of_motion in parts]
    drive = DriveRows(robot, motions, joint, rows, theta, regressor, signals, factors)
    if not at_joint and not robot.drives[joint].is_elastic:
        for by_name, motion in zip(signals, motions, strict=True):
            if motion.gear_torque is None:  # no friction depends on it so far
                by_name["tau_G"] = drive.through_gear(by_name, motion)
    return drive


def term_candidates(
    drive: DriveRows, terms: Iterable[tuple[str, str]], grids: Grids
) -> list[engine.Candidate]:
    """Return terms (field, term) of a drive as candidates."""
    return [engine.Candidate(drive.joint, *x, (*drive.terms(*x, grids),)) for x in terms]


@dataclass(frozen=True)
class Scale:
    """What starts of nonlinear parameters are multiples of, at one joint.

    `sizes` {unit: size} are the largest motor speed [rad/s], the half range of the motor angle
    [rad], and the duration of the longest log [s]; then follow the middle and the half range of the
    deflection.
    """

    sizes: Mapping[str, float]
    middle_deflection: float
    half_deflection: float


def scale_of(robot: Robot, motions: Sequence[Motion], joint: str) -> Scale:
    """Return the scale of a joint, with that of the deflection of an elastic one."""
    index, drive = robot.index(joint), robot.drives[joint]
    speed = max(float(np.max(np.abs(motion.motor_velocity[:, index]))) for motion in motions)
    angle = max(float(np.ptp(motion.motor_position[:, index])) for motion in motions) / 2
    middle, half = 0.0, 1.0
    if drive.is_elastic:
        signals = [regression.actuator_equation(robot, motion, joint)[1] for motion in motions]
        reached = np.concatenate([deflection(drive, x["theta_M"], x["theta_L"]) for x in signals])
        low, high = float(np.min(reached)), float(np.max(reached))
        middle, half = 0.5 * (low + high), max(0.5 * (high - low), 1e-12)
    sizes = {"rad/s": max(speed, 1e-9), "rad": max(angle, 1e-12), "s": duration_s(motions)}
    return Scale(sizes, middle, half)


def duration_s(motions: Sequence[Motion]) -> float:
    """Return the time from the start of a log to the end of its motion, of the longest one."""
    return max(float(motion.time[-1] - motion.start_s) for motion in motions)


def size_of(name: str, scale: Scale) -> float:
    """Return the size that the `starts` of a nonlinear parameter are multiples of."""
    return scale.sizes.get(PARAMETERS[name].unit, scale.half_deflection)


def toml_of(drive: Drive, field: str, terms: Iterable[str], values: Mapping[str, float]) -> str:
    """Return the lines of a drive's field with further terms, and where their search starts."""
    larger = drive
    for term in terms:
        larger = with_term(larger, field, term)
    names = ", ".join(f'"{term}"' for term in getattr(larger, field))
    starts = [
        f"{key_of(name, unit_of(larger, name))} = {value:.3g}"
        for name, value in values.items()
        if name in larger.parameter_names and name != "deflection_zero"  # that of these logs
    ]
    # A joint without a drive has no table yet, and the torques of its log are behind a gear.
    drive_keys = ['type = "stiff"', "gear_ratio = 1.0"] if drive == IDEAL_DRIVE else []
    return "\n".join([*drive_keys, f"{field} = [{names}]", *starts])
