"""Columns of the terms that a drive lacks, at the rows of a fit: what model comparisons consist of.

A term with parameters in which the equation is nonlinear has one set of columns per value on a
coarse grid. Other columns are derivatives at the fit, where the level of the term is zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import product

import numpy as np

from seaid._arrays import Array, BoolArray, FrozenMapping, IndexArray
from seaid._files import toml_table
from seaid.checks.engine import (
    Alternative,
    Candidate,
    Equation,
    ModelComparison,
    Point,
    Trial,
    best_supported,
    compared_candidates,
)
from seaid.drives import (
    COULOMB,
    DEAD_ZONES,
    PARAMETERS,
    Drive,
    DriveRegressor,
    key_of,
    parameter_of,
    term_fields,
    unit_of,
)
from seaid.errors import RobotError
from seaid.estimation import FittedRows
from seaid.log import Motion, in_band, in_band_at
from seaid.regressor import (
    Regression,
    actuator_equation,
    input_signals,
    joint_regressor,
    motor_regressor,
    spring_regressor,
)
from seaid.robot import Robot, torques_at_drives

_DIRECTED = (
    *("coulomb_friction", "load_friction", "stribeck_friction", "stribeck_speed"),
    *("coulomb_position_slope", "coulomb_position_curvature"),
    *("coulomb_temperature_slope", "cold_coulomb_friction"),
)
"""Parameters of friction whose columns have the sign of the speed, or its tanh."""


@lru_cache(256)
def with_term(drive: Drive, field: str, term: str) -> Drive:
    """Return the drive with one more term, without the values of parameters that it then lacks.

    A Coulomb term takes the place of another one, and so do dead zones.
    Raises RobotError for a term that the drive cannot have.
    """
    alike = [*map(set, (COULOMB, DEAD_ZONES))]
    own = getattr(drive, field)
    terms = tuple(one for one in own if not any({one, term} <= some for some in alike))
    bare = replace(drive, nominal={}, known=(), **{field: (*terms, term)})  # type: ignore[arg-type]
    names = bare.parameter_names
    valued = bare.with_values({n: x for n, x in drive.values.items() if n in names})
    return replace(valued, known=tuple(name for name in drive.known if name in names))


def possible_terms(drive: Drive, asked: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, str]]:
    """Yield the terms (field, term) among those asked for that a drive lacks and can have."""
    for field, terms in asked.items():
        own = getattr(drive, field) if field in term_fields(drive) else terms
        smooth = {"friction": COULOMB[1:], "spring": (*DEAD_ZONES, "dahl")}.get(field, ())
        for term in terms:
            instead = {*smooth, "coulomb"} - {"shifted_coulomb"} if {*smooth} & {*own} else ()
            if term in own or term in instead:
                continue
            try:
                with_term(drive, field, term)
            except RobotError:  # what this drive cannot have
                continue
            yield field, term


def reference_position(motions: Sequence[Motion], place: int) -> float:
    """Return the middle of the positions [rad or m] of a joint, of two digits.

    There the level of Coulomb friction is positive, even if its slope is large.
    """
    lows = [float(np.min(one.joint_position[:, place])) for one in motions]
    highs = [float(np.max(one.joint_position[:, place])) for one in motions]
    return float(f"{0.5 * (min(lows) + max(highs)):.2g}")


@dataclass(frozen=True, eq=False)
class DriveRows:
    """A drive at the rows of the side that has its equation.

    `values` are the fitted ones of the drive. `regressor` derives the equation of the side, which
    is that of the motor or of the spring; `signals` evaluate it. `placed` are the parts of the
    drive's columns in the equations: places among the rows, samples of each motion, factor. If
    `is_coarse`, samples are places between those of motions with fewer samples, and changed columns
    are given as their changes.
    """

    robot: Robot
    motions: Sequence[Motion]
    joint: str
    rows: Regression
    values: Mapping[str, float]
    regressor: Callable[[Robot, str], DriveRegressor]
    signals: Sequence[Mapping[str, Array]]
    placed: Sequence[tuple[BoolArray, Sequence[IndexArray | Array], float]]
    is_coarse: bool = False

    def terms(
        self, field: str, term: str, given: Mapping[str, Sequence[float]] | None = None
    ) -> Iterator[Point]:
        """Yield a term at each point of its grid; `given` {parameter: values} replaces a grid."""
        drive = self.robot.drives[self.joint]
        larger = self.robot.with_drives({self.joint: with_term(drive, field, term)})
        old, new = (self.regressor(robot, self.joint) for robot in (self.robot, larger))
        extra = [name for name in new.names if name not in old.names]
        values = dict.fromkeys(new.names, 0.0) | dict(self.values)
        if "deflection_zero" in extra:
            if values.get("stiffness", 0.0) <= 0:  # the fit does not have the zero
                return
            rest = -values.get("spring_offset", 0.0) / values["stiffness"]
            values["deflection_zero"] = (given or {}).get("deflection_zero", (rest,))[0]
        grid = self._grid(extra, given or {})
        changed = _changed(term, old, new, extra)
        added = [name for name in extra if name not in (*grid, "deflection_zero")]
        if not added and not grid:  # no part of this equation
            return
        places = [
            place
            for place, name in enumerate(self.rows.names)
            if parameter_of(name) in changed and getattr(name, "joint", self.joint) == self.joint
        ]
        points = [dict(zip(grid, one, strict=True)) for one in product(*grid.values())]
        wanted = [(new, values | at, [*changed, *added]) for at in points]
        *found, before = self._columns([*wanted, (old, values, changed)])
        more = len(added) + len(grid)
        zero = {name: values[name] for name in ("deflection_zero",) if name in extra}
        for at, columns in zip(points, found, strict=True):
            if self.is_coarse:
                columns[:, : len(changed)] -= before
            yield Point(at | zero, Alternative(columns, more, tuple(places)))

    def _grid(
        self, names: Sequence[str], given: Mapping[str, Sequence[float]]
    ) -> dict[str, Sequence[float]]:
        """Return {nonlinear parameter: the values that are tried}."""
        searched = [
            name for name in names if PARAMETERS[name].starts and PARAMETERS[name].is_positive
        ]
        if not searched:
            return {}
        grid = {
            name: given.get(name)
            or [part * size_of(name, self._scale) for part in _dense(PARAMETERS[name].starts)]
            for name in searched
        }
        if "coulomb_width" in grid and "coulomb_width" not in given and not self.is_coarse:
            widths = grid["coulomb_width"]
            grid["coulomb_width"] = [x for x in widths if x > self._crossing] or widths[-1:]
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
        is_elastic = self.robot.drives[self.joint].is_elastic
        scale_of = deflection_scale if is_elastic else speed_scale
        return scale_of(self.robot, self.motions, self.joint)

    def _columns(
        self, wanted: Sequence[tuple[DriveRegressor, Mapping[str, float], Sequence[str]]]
    ) -> list[Array]:
        """Return the columns (R, names) of (regressor, values, names) at all rows of the side."""
        parts = [
            np.hstack([of.columns(one, values, names) for of, values, names in wanted])
            for one in self.signals
        ]
        ends = np.cumsum([len(names) for _, _, names in wanted])[:-1]
        return np.split(self.at_rows(parts), ends, axis=1)

    def at_rows(self, parts: Sequence[Array]) -> Array:
        """Return columns (T, c) of torques at the samples of each motion at all rows (R, c)."""
        found = np.zeros((len(self.rows.y), parts[0].shape[1]))
        for mine, samples, factor in self.placed:
            known = self._where_known(mine, parts)
            banded = map(in_band_at, self.motions, known, samples)
            found[mine] = factor * np.concatenate(list(banded))
        return found

    def slope_at_rows(self, torques: Sequence[Array]) -> Array:
        """Return the slope (R, 1) of torques (T,) of each motion, below the cutoff, at all rows.

        They are filtered first: at the ends of a log the filter continues a torque and not a slope,
        whose noise is as large as its first difference.
        """
        slopes = [
            np.gradient(in_band(motion, torque), motion.time)
            for motion, torque in zip(self.motions, torques, strict=True)
        ]
        found = np.zeros((len(self.rows.y), 1))
        for mine, samples, factor in self.placed:
            parts = [slope[own] for slope, own in zip(slopes, samples, strict=True)]
            found[mine, 0] = factor * np.concatenate(parts)
        return found

    def _where_known(self, mine: BoolArray, parts: Sequence[Array]) -> Sequence[Array]:
        """Return columns of the load side, zero where friction in the equation is not known."""
        if self.robot.drives[self.joint].is_elastic:
            return parts
        index = int(self.rows.joint[mine][0])
        return [one.where_known(index, part) for one, part in zip(self.motions, parts, strict=True)]


def _dense(starts: Sequence[float]) -> list[float]:
    """Return the starts of a search and their geometric means, without a search after them."""
    between = np.sqrt(np.array(starts[1:]) * np.array(starts[:-1]))
    return sorted([*starts, *between.tolist()])


def _changed(
    term: str, old: DriveRegressor, new: DriveRegressor, extra: Sequence[str]
) -> list[str]:
    """Return the parameters of the drive whose columns a term changes."""
    names: Sequence[str] = ()
    if {"coulomb_width", "presliding_angle"} & {*extra}:  # in place of the sign in all friction
        names = _DIRECTED
    elif term in DEAD_ZONES:
        names = ("stiffness",)
    return [name for name in names if name in old.names and name in new.names]


def actuator_drive(
    robot: Robot,
    motions: Sequence[Motion],
    joint: str,
    rows: Regression,
    theta: Array,
    coarse: Sequence[Motion] = (),
) -> DriveRows:
    """Return an elastic drive at the rows of its actuator side (10), with its fit `theta`.

    `coarse` motions, with fewer samples, are those of the signals if given.
    """
    equations = [actuator_equation(robot, one, joint) for one in coarse or motions]
    is_motor = equations[0][0] == motor_regressor(robot, joint)
    every = np.ones(len(rows.y), dtype=bool)
    return DriveRows(
        robot=robot,
        motions=coarse or motions,
        joint=joint,
        rows=rows,
        values={**robot.drives[joint].values, **dict(zip(rows.names, theta.tolist(), strict=True))},
        regressor=motor_regressor if is_motor else spring_regressor,
        signals=[signals for _, signals in equations],
        placed=[(every, _samples(motions, rows, every, coarse), 1.0)],
        is_coarse=bool(coarse),
    )


def _samples(
    motions: Sequence[Motion], rows: Regression, mine: BoolArray, coarse: Sequence[Motion]
) -> list[IndexArray | Array]:
    """Return the samples of each motion that are rows of `mine`, or their places in `coarse`."""
    found: list[IndexArray | Array] = [
        np.searchsorted(motion.time, rows.time[mine & (rows.run == run)])
        for run, motion in enumerate(motions)
    ]
    return [
        samples / decimated_by(motion) if coarse else samples
        for samples, motion in zip(found, motions, strict=True)
    ]


def load_drive(
    robot: Robot,
    motions: Sequence[Motion],
    joint: str,
    rows: Regression,
    theta: Array,
    coarse: Sequence[Motion] = (),
    *,
    at_joint: bool = False,
) -> DriveRows:
    """Return a drive at the rows of the load side (8): a stiff one, or what acts `at_joint`."""
    index, n = robot.index(joint), robot.n
    own = {
        parameter_of(name): value
        for name, value in zip(rows.names, theta.tolist(), strict=True)
        if getattr(name, "joint", "") == joint
    }
    share = np.eye(n)[index] * robot.drives[joint].ratio
    if at_joint:
        share = torques_at_drives(robot.transmission, np.eye(n)[index])
    of_joint = {k: np.asarray(rows.joint == k) for k in range(n) if share[k]}
    by_motion = [input_signals(robot, motion, index) for motion in coarse or motions]
    if at_joint:  # of its own states, also where a drive moves several joints
        for signals, motion in zip(by_motion, coarse or motions, strict=True):
            states = (state[:, index] for state in motion.joint_states)
            signals |= dict(zip(_JOINT, states, strict=True))
    return DriveRows(
        robot=robot,
        motions=coarse or motions,
        joint=joint,
        rows=rows,
        values={**robot.drives[joint].values, **own},
        regressor=joint_regressor if at_joint else motor_regressor,
        signals=by_motion,
        placed=[
            (mine, _samples(motions, rows, mine, coarse), float(share[k]))
            for k, mine in of_joint.items()
            if np.any(mine)
        ],
        is_coarse=bool(coarse),
    )


_JOINT = ("theta_L", "theta_L_dot", "theta_L_ddot")


_COARSE = 40.0
"""Samples per period of the cutoff at which terms are screened."""


def decimated_by(motion: Motion) -> int:
    """Return the number of samples of a motion per coarse one."""
    return max(1, int(motion.rate_hz / (_COARSE * motion.cutoff_hz)))


def coarse_motions(motions: Sequence[Motion]) -> list[Motion]:
    """Return motions with as many samples as screening needs."""
    return [one.samples(slice(None, None, decimated_by(one))) for one in motions]


def term_candidates(
    exact: DriveRows,
    coarse: DriveRows,
    terms: Iterable[tuple[str, str]],
    grids: Mapping[str, Sequence[float]] = FrozenMapping({}),
) -> list[Candidate]:
    """Return terms (field, term) of a drive as candidates; `coarse` is the drive at few samples."""

    def points(of_few: bool, field: str, term: str) -> list[Point]:
        drive = coarse if of_few else exact
        return list(drive.terms(field, term, grids))

    return [
        Candidate(exact.joint, *one, partial(points, field=one[0], term=one[1])) for one in terms
    ]


@dataclass(frozen=True)
class Scale:
    """Largest motor speed [rad/s], half range of its angle, duration of the longest log [s], and
    middle and half range of the deflection.
    """

    speed: float
    turn: float
    duration: float
    middle: float
    reach: float


def deflection_scale(robot: Robot, motions: Sequence[Motion], joint: str) -> Scale:
    """Return the scale of an elastic joint."""
    drive = robot.drives[joint]
    by_name = [actuator_equation(robot, motion, joint)[1] for motion in motions]
    stretch = np.concatenate(
        [
            drive.motor_radius / drive.ratio * one["theta_M"] - drive.load_radius * one["theta_L"]
            for one in by_name
        ]
    )
    low, high = float(np.min(stretch)), float(np.max(stretch))
    motor = speed_scale(robot, motions, joint)
    return replace(motor, middle=0.5 * (low + high), reach=max(0.5 * (high - low), 1e-12))


def speed_scale(robot: Robot, motions: Sequence[Motion], joint: str) -> Scale:
    """Return the scale of a stiff joint."""
    index = robot.index(joint)
    speed = max(float(np.max(np.abs(one.motor_velocity[:, index]))) for one in motions)
    turn = max(float(np.ptp(one.motor_position[:, index])) for one in motions) / 2
    return Scale(max(speed, 1e-9), max(turn, 1e-12), duration_s(motions), 0.0, 1.0)


def duration_s(motions: Sequence[Motion]) -> float:
    """Return the time from the start of a log to the end of its motion, of the longest one."""
    return max(float(one.time[-1] - one.start_s) for one in motions)


def size_of(name: str, scale: Scale) -> float:
    """Return the unit of the starts of a nonlinear parameter."""
    sizes = {"rad/s": scale.speed, "rad": scale.turn, "s": scale.duration}
    return sizes.get(PARAMETERS[name].unit, scale.reach)


@dataclass(frozen=True, eq=False)
class TermComparison:
    """Comparison of a joint's drive with and without one more term, at `step` of the selection.

    `comparison` is None if the term could not be estimated: `reason` says why. The best supported
    term of a step is `selected`. `values` {parameter: value} are the best of a grid, of parameters
    in which the equation is nonlinear. `cutoff_hz` is that of a second comparison, above that of
    the motion, of laws whose torque has corners.
    """

    joint: str
    field: str
    term: str
    step: int
    comparison: ModelComparison | None
    reason: str = ""
    selected: bool = False
    values: Mapping[str, float] = FrozenMapping({})
    cutoff_hz: float | None = None

    @property
    def is_supported(self) -> bool:
        """Whether both criteria support the term."""
        return self.comparison is not None and self.comparison.is_supported


def best_comparison(comparisons: Sequence[TermComparison]) -> TermComparison | None:
    """Return the best of the supported terms, None without any."""
    compared = [one for one in comparisons if one.comparison is not None]
    place = best_supported([one.comparison for one in compared if one.comparison is not None])
    return None if place is None else compared[place]


def evidence_of(comparison: ModelComparison, values: Mapping[str, float]) -> dict[str, float]:
    """Return the numbers of a comparison at `values` of nonlinear parameters, as evidence."""
    return {
        "explained": comparison.explained,
        "F": comparison.F,
        "BIC": comparison.bic,
        "improvement": comparison.improvement,
        "standard error": comparison.improvement_std,
        **values,
    }


def toml_of(
    joint: str, drive: Drive, field: str, terms: Iterable[str], values: Mapping[str, float]
) -> str:
    """Return the TOML of a drive's field with further terms, and where their search starts."""
    larger = drive
    for term in terms:
        larger = with_term(larger, field, term)
    names = ", ".join(f'"{term}"' for term in getattr(larger, field))
    starts = [
        f"{key_of(name, unit_of(larger, name))} = {value:.3g}"
        for name, value in values.items()
        if name in larger.parameter_names and name != "deflection_zero"  # that of these logs
    ]
    return "\n".join([toml_table(joint), f"{field} = [{names}]", *starts])


def compared_terms(
    drive: DriveRows,
    fitted: FittedRows,
    terms: Sequence[tuple[str, str]],
    count: int,
    step: int,
    grids: Mapping[str, Sequence[float]] = FrozenMapping({}),
) -> list[TermComparison]:
    """Return the comparison of each term (field, term) of a drive, at the best point of its grid.

    `count` is the number of all comparisons, `grids` {nonlinear parameter: values} replace those of
    the search.
    """
    equation = Equation(fitted_rows(fitted), fitted.weights)
    candidates = term_candidates(drive, drive, terms, grids)
    return [comparison_of(one, step) for one in compared_candidates(equation, candidates, count)]


def fitted_rows(fitted: FittedRows) -> Regression:
    """Return the rows of a fit, which are in memory."""
    assert fitted.rows is not None
    return fitted.rows


def comparison_of(one: Trial, step: int) -> TermComparison:
    """Return a tested term of a drive as the comparison of a step."""
    return TermComparison(*one.candidate.name, step, one.comparison, one.reason, values=one.values)
