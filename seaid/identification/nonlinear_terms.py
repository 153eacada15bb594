"""Parameters in which drive equations are nonlinear, found by variable projection.

Given a Stribeck speed, the width of smooth friction or a dead zone, the equations (7) and (8) are
linear. These parameters are searched first, those of elastic drives on the actuator side, those
of stiff drives on the load side, joint by joint. `identify` then linearises the equations at the
values found, where each parameter has a column and a standard error. Nonlinear parameters that
this motion cannot identify are fixed where the search ended, and reported in a flag.

Load-dependent friction of a stiff drive needs the torque through the gear. The measured motor
torque would put its noise into the column; the torque of the fitted model is used instead, from a
fit without that friction first and then with it, until it converges.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product
from typing import Any, TypeVar

import numpy as np

from seaid._arrays import Array, BoolArray
from seaid._files import toml_table
from seaid.checks.terms import (
    DriveRows,
    Scale,
    actuator_drive,
    duration_s,
    load_drive,
    scale_of,
    size_of,
)
from seaid.checks.values import competing_optimum
from seaid.drives import PARAMETERS, Drive, unit_of
from seaid.drives.controller import NORMAL_95
from seaid.drives.drives import deflection
from seaid.drives.regressor import DriveRegressor
from seaid.drives.terms import COULOMB, LEVEL_OF, WARM_UP, parameter_named
from seaid.errors import Finding, IdentificationError, listed
from seaid.estimation import Estimate
from seaid.estimation.least_squares import equal_weights, ordinary
from seaid.estimation.nonlinear_least_squares import error_growth, separable_least_squares
from seaid.estimation.qr_factor import NAMED, RANK_TOLERANCE, QRFactor, qr_factor_of, scaled_svd
from seaid.identification.datasets import rows_in_memory
from seaid.identification.drive_estimates import with_values
from seaid.identification.stacked_fits import LOAD, RobotEstimate, spring_of, with_spring_torque
from seaid.identification.two_step import Condition, two_step_equations
from seaid.log import Motion
from seaid.regressor import Regression, actuator_regression, motor_regressor, regression
from seaid.regressor.load import load_side, with_gear_torque

Conditioned = TypeVar("Conditioned", bound=Condition)

_SINGULAR = 1e-6
"""Singular value below which a nonlinear parameter is fixed: its column is a derivative, whose
rank falls only near the best values, where the search ends."""

_SEEN = 1e-3
"""Largest entry of the column of a friction level, of 1, below which no row determines it."""


_LEVELS = tuple(level for term, level in LEVEL_OF.items() if term not in COULOMB)
"""Levels of friction that may go with the shape of their term."""


def _unidentifiable(names: Sequence[str], H: Array, candidates: Sequence[str]) -> str | None:
    """Return the candidate with the largest share of a lost combination, None if none is lost."""
    may_go = np.array([name in candidates for name in names])
    dead = np.flatnonzero(~np.any(H, axis=0) & may_go)
    if len(dead):
        return names[int(dead[0])]
    if not len(names):
        return None
    svd = scaled_svd(H, "the columns of a drive")
    # The last right singular vector is the worst determined combination of scaled columns. It is
    # that of a candidate only if the candidate has a real part in it, NAMED of the largest.
    share = np.abs(svd.vectors[-1])
    place = int(np.argmax(np.where(may_go, share, 0.0)))
    is_named = may_go[place] and share[place] > NAMED * share.max()
    is_lost = is_named and svd.rank(_SINGULAR) < len(names)
    return names[place] if is_lost else None


def with_searched_drives(estimate: RobotEstimate, condition: Condition) -> RobotEstimate:
    """Return an estimate whose drives have values that a search allows, and errors by the misfit.

    Its findings are the optima that compete with it. A positive parameter of a search whose
    linearised value is negative, within its standard error of zero, has the value at which the
    search ended: the best one that is allowed. The errors are those of tangents times their
    `error_growth`.
    """
    robot, drives, findings = condition.robot, dict(estimate.drives), list[Finding]()
    searched = {name for name, x in PARAMETERS.items() if x.is_positive and x.starts}
    joints = drives.keys() & {*robot.elastic_joints, *condition.used}
    for joint, search in _searches(condition, _nonlinear(condition, joints)):
        nearby, drive = robot.drives[joint].values, drives[joint]
        values = [
            nearby[name] if name in searched and value < 0 else value
            for name, value in drive.by_name.items()
        ]
        growth = search.error_growth()
        larger = np.array([growth.get(name, 1.0) for name in drive.names])
        covariance = drive.covariance * np.outer(larger, larger)
        drives[joint] = replace(drive, values=np.array(values), covariance=covariance)
        findings += [_optimum(joint, drives[joint], x) for x in condition.competing.get(joint, ())]
    return replace(estimate, drives=drives, findings=(*estimate.findings, *findings))


def _optimum(joint: str, estimate: Estimate, drive: Drive) -> Finding:
    """Return the finding of an optimum, a drive that explains the log as well as its estimate."""
    # (7) has the sum of spring and torque offset, which the estimate may have apart.
    names = [x for x in estimate.names if x in drive.values and x != "spring_offset"]
    alone, values = estimate.of_names(names), {str(name): drive.values[name] for name in names}
    is_far = np.abs([*values.values()] - alone.values) > NORMAL_95 * alone.standard_errors
    searched = (name for name, x in PARAMETERS.items() if name in values and x.starts)
    texts = (f"{x.replace('_', ' ')} {values[x]:.3g} {unit_of(drive, x)}" for x in searched)
    return competing_optimum(joint, {**values, "values": listed(texts)}, any(is_far))


_LEAST, _MOST = 1e-4, 2.0
"""Bounds of positive parameters in the units of their starts."""

_ORDER = 5
"""Highest order of a spring."""


@dataclass(frozen=True, eq=False)
class _Search:
    """The rows of a side as functions of the nonlinear parameters of one `drive` of it.

    `weights` (R,) are those of the rows.
    """

    drive: DriveRows
    weights: Array

    @cached_property
    def linear(self) -> tuple[str, ...]:
        """The linear parameters with a column."""
        return tuple(filter(self.drive.has_parameter, self.regressor.linear))

    @cached_property
    def y(self) -> Array:
        """The weighted target (R,) without the part of the drive."""
        parts = [self.regressor.evaluate(by_name)[0][:, None] for by_name in self.drive.signals]
        # The target has zeta at the values of the drive.
        return np.asarray(self.weights * (self.drive.rows.y - self.drive.at_rows(parts)[:, 0]))

    @cached_property
    def others(self) -> Array:
        """The span (R, rank) of the weighted columns of all other parameters: bodies and drives."""
        names, parameters = self.regressor.names, self.drive.parameters.items()
        of_drive = [place for place, name in parameters if name in names]
        H = self.weights[:, None] * np.delete(self.drive.rows.H, of_drive, axis=1)
        return scaled_svd(H, "the columns of the other parameters").span()

    @cached_property
    def regressor(self) -> DriveRegressor:
        """The regressor of the equation of the side."""
        return self.drive.regressor(self.drive.robot, self.drive.joint)

    def optima(self, drive: Drive, starts: Sequence[Array], scale: Scale) -> list[Drive]:
        """Return the drive with its parameters at the best optimum, and at those that compete.

        A rotor inertia has no value, with which it would be known.
        """
        of_name = zip(self.regressor.non_linear, np.transpose(starts).tolist(), strict=True)
        bounds = np.array([bounds_of(name, scale, values) for name, values in of_name])
        optima = separable_least_squares(self.columns, self.slopes, starts, *bounds.T)
        names = *self.regressor.non_linear, *self.linear
        kept = [place for place, name in enumerate(names) if name != "motor_inertia"]
        at = map(np.concatenate, optima)
        return [with_values(drive, {names[place]: x[place] for place in kept}) for x in at]

    def error_growth(self) -> dict[str, float]:
        """Return by which factors errors of the drive's parameters are larger than by tangents."""
        names, drive = self.regressor.non_linear, self.drive.robot.drives[self.drive.joint]
        scale = scale_of(self.drive.robot, self.drive.motions, self.drive.joint)
        # searched from all starts, but for values that are known
        nominal = {name: value for name, value in drive.nominal.items() if name in drive.known}
        grid = _grid(names, replace(drive, nominal=nominal), drive.values, scale)
        starts = [np.array([drive.values[name] for name in names]), *grid]
        bounds = np.array([bounds_of(name, scale, [drive.values[name]]) for name in names])
        growth = error_growth(self.columns, self.slopes, starts, *bounds.T)
        return dict(zip((*self.linear, *names), growth.tolist(), strict=True))

    def with_fixed(self, drive: Drive) -> Drive:
        """Return the drive with its unidentifiable nonlinear parameters as known ones.

        Examples are a dead zone of zero, and a Stribeck speed without Stribeck friction: the
        equations are singular in them.
        """
        nonlinear = np.array([drive.values[name] for name in self.regressor.non_linear])
        linear = np.array([drive.values.get(name, 0.0) for name in self.linear])
        columns = np.hstack([self.columns(nonlinear)[1], self.slopes(nonlinear, linear)])
        names, fixed = (*self.linear, *self.regressor.non_linear), list[str]()
        candidates = [*self.regressor.non_linear, *_LEVELS]
        # One at a time, since the others may be identifiable once the worst is fixed.
        while True:
            kept = [place for place, name in enumerate(names) if name not in fixed]
            name = _unidentifiable([names[place] for place in kept], columns[:, kept], candidates)
            if name is None:
                return replace(drive, known=(*drive.known, *fixed)) if fixed else drive
            fixed.append(name)

    def columns(self, nonlinear: Array) -> tuple[Array, Array]:
        """Return y and the drive's linear columns, with the other columns projected out."""
        values = dict(zip(self.regressor.non_linear, nonlinear.tolist(), strict=True))
        places = [self.regressor.linear.index(name) for name in self.linear]
        pairs = [self.regressor.given(by_name, values) for by_name in self.drive.signals]
        both = self.drive.at_rows([np.column_stack([part, H[:, places]]) for part, H in pairs])
        zeta, columns = both[:, 0], both[:, 1:]
        columns[:, self._vanishing(columns)] = 0.0
        columns *= self.weights[:, None]
        return self._projected(self.y + self.weights * zeta), self._projected(columns)

    def _vanishing(self, columns: Array) -> BoolArray:
        """Return the levels of friction whose columns vanish: at no row is the motor slow enough.

        The largest entry of the column of a level is the factor of the rows. A column that is far
        smaller has any value that rounding gives it.
        """
        is_level = np.array([name in LEVEL_OF.values() for name in self.linear], dtype=bool)
        largest = np.max(np.abs(columns), axis=0, initial=0.0)
        factors = (np.max(np.abs(x)) for each in self.drive.factors for x in each.values())
        return np.asarray(is_level & (largest < _SEEN * max(factors)))

    def slopes(self, nonlinear: Array, linear: Array) -> Array:
        """Return the columns of the nonlinear parameters in the same way."""
        values = {**self.regressor.drive.values}
        values |= dict(zip(self.regressor.non_linear, nonlinear.tolist(), strict=True))
        values |= dict(zip(self.linear, linear.tolist(), strict=True))
        # `evaluate` has derivatives in these columns, d(H theta - zeta)/dv at v and theta.
        places = [self.regressor.names.index(name) for name in self.regressor.non_linear]
        parts = [
            self.regressor.evaluate(by_name, values)[1][:, places] for by_name in self.drive.signals
        ]
        return self._projected(self.weights[:, None] * self.drive.at_rows(parts))

    def _projected(self, columns: Array) -> Array:
        if not self.others.shape[1]:
            return columns
        # (I - Q Q^T) H with an orthonormal basis Q of the other columns: their parameters are at
        # their best values for each trial, without being computed.
        return np.asarray(columns - self.others @ (self.others.T @ columns))


def _linear_start(condition: Condition, joint: str) -> dict[str, float]:
    """Return friction, stiffness and zero of the deflection of a drive with linear terms only."""
    robot, motions = condition.robot, condition.motions
    drive = robot.drives[joint]
    sharp = ("coulomb" if term in COULOMB else term for term in drive.friction)
    friction = tuple(term for term in sharp if term not in ("load", *LEVEL_OF))
    known = tuple(name for name in drive.known if name in ("stiffness", "viscous_friction"))
    linear: Any = ("linear",)
    plain = replace(drive, friction=friction, spring=linear, known=known, nominal={})
    simple = robot.with_drives({joint: plain})
    rows = regression.stacked([actuator_regression(simple, motion, joint) for motion in motions])
    values = {**plain.values, **ordinary(rows).by_name}
    stiffness = values.get("stiffness", 0.0)
    if stiffness == 0:
        raise IdentificationError(f"joint '{joint}': no stiffness to start the search")
    # k d + f_0 = k (d - d_0) with d_0 = -f_0 / k.
    values["deflection_zero"] = -values.get("spring_offset", 0.0) / stiffness
    return values


def starts_of(
    name: str, drive: Drive, start: Mapping[str, float], scale: Scale
) -> tuple[float, ...]:
    """Return the starts of the search for a parameter: its nominal value, or some from the data."""
    if name in drive.values:
        return (drive.values[name],)
    if name == "deflection_zero":
        return (start[name], scale.middle_deflection)
    parts = tuple(part * size_of(name, scale) for part in parameter_named(name).starts)
    return parts or (start.get(name, 0.0),)


def bounds_of(name: str, scale: Scale, starts: Sequence[float]) -> tuple[float, float]:
    """Return the lower and upper search bound of a nonlinear parameter.

    The zero of a spring that is loaded to one side lies outside of the motion. Where F = k x^p, the
    tangent vanishes at x / p from the middle: the zero of a spring of the order 5 is at most five
    times as far as that of the linear one.
    """
    if not parameter_named(name).starts:
        return (0.0 if parameter_named(name).is_positive else -np.inf), np.inf
    size = size_of(name, scale)
    middle = scale.middle_deflection if name == "deflection_zero" else 0.0
    if name == "deflection_zero":
        size = max(size, *(_ORDER / _MOST * abs(start - middle) for start in starts))
    if parameter_named(name).is_positive:
        return _LEAST * size, _MOST * size
    return middle - _MOST * size, middle + _MOST * size


_LEAST_RETURN = 0.01
"""Least return of a position, over its range, that shows a law of hysteresis: with less its state
keeps one value, which is an offset."""


def missing_reversals(condition: Condition, joints: Sequence[str]) -> Iterator[str]:
    """Yield which hysteresis the motions do not show, as its position never returns."""
    robot, motions = condition.robot, condition.motions
    for joint in joints:
        drive, index = robot.drives[joint], robot.index(joint)
        for field, what, unit in (
            ("friction", "angle of the motor", "rad"),
            ("spring", "deflection", drive.spring_units[1]),
        ):
            if "dahl" not in getattr(drive, field):
                continue
            by_motion = [regression.signals(robot, motion, index) for motion in motions]
            positions = [x["theta_M"] for x in by_motion]
            if field == "spring":
                positions = [deflection(drive, x["theta_M"], x["theta_L"]) for x in by_motion]
            turns = list(map(_fall_and_rise, positions))
            # A motion in one direction has only one of them, so that the smaller is the return.
            returned, moved = max(map(min, turns)), max(1e-12, *map(max, turns))
            if returned < _LEAST_RETURN * moved:
                yield (
                    f"joint '{joint}': its {field} has hysteresis ('dahl'), and the {what} never "
                    f"turns back: it moves by {moved:.3g} {unit} and returns by "
                    f"{returned:.2g} {unit}. Log a motion with reversals, whose {what} returns "
                    f"by more than {_LEAST_RETURN * moved:.2g} {unit} and many times the "
                    f"width of the law, such as one of design_excitation, or remove 'dahl'"
                )


def _fall_and_rise(x: Array) -> tuple[float, float]:
    """Return the fall below the running maximum, and the rise above the running minimum."""
    fall, rise = np.maximum.accumulate(x) - x, x - np.minimum.accumulate(x)
    return float(np.max(fall)), float(np.max(rise))


def _check_warm_up(condition: Condition, joints: Sequence[str]) -> None:
    """Raise IdentificationError for friction that fades over more than the longest log.

    A straight line in time then fits as well as an exponential, and what a warm motor keeps is not
    in the log.
    """
    longest = duration_s(condition.motions)
    for joint in joints:
        drive = condition.robot.drives[joint]
        found_s = drive.values.get("warm_up_time", 0.0) if {*WARM_UP} & {*drive.friction} else 0.0
        if found_s > longest and "warm_up_time" not in drive.known:
            terms = ", ".join(term for term in drive.friction if term in WARM_UP)
            raise IdentificationError(
                f"joint '{joint}': its friction warms up over {found_s:.3g} s or more, longer than "
                f"the log of {longest:.3g} s, which shows no warm motor. Log twice that time or "
                f"longer, remove {terms}, or give the time in the drives file:\n"
                f"{toml_table(joint)}\nwarm_up_time_s = {found_s:.3g}\n"
                'known = ["warm_up_time"]'
            )


_SWEEPS = 2
"""Number of sweeps in which each joint is searched with the others fixed."""

_FEW = 1e-3
"""Least ratio of the weights of two equations."""


@dataclass(frozen=True, eq=False)
class LoadFit:
    """A fit of the load side: the values of the springs, its `values` (p,) and its rows."""

    springs: Mapping[str, Array]
    values: Array
    rows: Regression
    qr_factor: QRFactor


def linearised_load(condition: Conditioned) -> Conditioned:
    """Return the condition whose stiff drives are linearised."""
    stiff = [joint for joint in condition.used if joint not in condition.robot.elastic_joints]
    return linearised(condition, stiff)


def linearised(condition: Conditioned, joints: Sequence[str]) -> Conditioned:
    """Return the condition of the robot with values at which drives of some joints are linearised.

    All of them are elastic, or all of them are stiff and have a torque that is used. Linear drives
    stay as they are. Raises IdentificationError if a linear spring has no stiffness to start from,
    and for a hysteresis without reversals.
    """
    for reason in missing_reversals(condition, joints):
        raise IdentificationError(reason)
    nonlinear = _nonlinear(condition, joints)
    starts, scales = dict[str, Mapping[str, float]](), dict[str, Scale]()
    competing = {**condition.competing}
    nominal, elastic = condition.robot.drives, {*condition.robot.elastic_joints}
    for joint in nonlinear:
        starts[joint] = _linear_start(condition, joint) if joint in elastic else {}
        scales[joint] = scale_of(condition.robot, condition.motions, joint)
        condition = _started(condition, joint, scales[joint], starts[joint])
    # Sides of elastic drives share no parameters, and one joint needs no second sweep, since the
    # parameters of the others are linear and at their best values for each of its trials.
    sweeps = 1 if {*nonlinear} <= elastic else min(len(nonlinear), _SWEEPS)
    for turn, joint in enumerate(sweeps * nonlinear):
        ((_, search),), drive = _searches(condition, [joint]), condition.robot.drives[joint]
        names, of_joint = search.regressor.non_linear, (starts[joint], scales[joint])
        points = [np.array([drive.values[name] for name in names])]
        if is_first := turn < len(nonlinear):
            points = _grid(names, nominal[joint], *of_joint)
        best, *others = search.optima(drive, points, scales[joint])
        condition = condition.with_drives({joint: best})
        # A second sweep starts from the best one, and finds no others.
        competing[joint] = others if is_first else competing[joint]
    drives, searches = condition.robot.drives, _searches(condition, nonlinear)
    condition = condition.with_drives({x: search.with_fixed(drives[x]) for x, search in searches})
    _check_warm_up(condition, joints)
    return replace(condition, competing=competing)


def _nonlinear(condition: Condition, joints: Iterable[str]) -> list[str]:
    """Return the joints of which the equations are nonlinear in parameters of their drives."""
    robot, motion, nonlinear = condition.robot, condition.motions[0], []
    for joint in joints:
        equation = motor_regressor(robot, joint)
        if joint in robot.elastic_joints:
            equation = regression.actuator_equation(robot, motion, joint)[0]
        nonlinear += [joint] if equation.non_linear else []
    return nonlinear


def _grid(
    names: Sequence[str], drive: Drive, start: Mapping[str, float], scale: Scale
) -> list[Array]:
    """Return all combinations of the starts of nonlinear parameters."""
    return [
        np.array(point) for point in product(*(starts_of(x, drive, start, scale) for x in names))
    ]


def starting_load_fit(condition: Condition) -> LoadFit:
    """Fit the load side by weighted least squares, the springs by ordinary ones before it.

    Between two steps of a search a nonlinear parameter may have no column, such as the width of
    Coulomb friction that is zero: unidentifiable combinations are zero here, and `identify` decides
    about them at the end of the search.
    """
    robot, joints = condition.robot, condition.springs
    rows = rows_in_memory(condition.motions, two_step_equations(robot, condition.model, joints))
    springs = {joint: spring_of(robot, ordinary(rows[joint]), joint) for joint in joints}
    load = with_spring_torque(list(springs.values()), rows[LOAD])
    qr_factor = qr_factor_of(load)
    theta = _least_norm(qr_factor, _weights(qr_factor))
    values = {joint: spring.values for joint, spring in springs.items()}
    return LoadFit(values, theta, load, qr_factor)


def _least_norm(qr_factor: QRFactor, weights: Array) -> Array:
    """Return the least-squares solution (p,) with zero for unidentifiable combinations."""
    R, p = qr_factor.weighted_factor(weights), len(qr_factor.names)
    return scaled_svd(R[:p, :p], "the load side").solve(R[:p, p], RANK_TOLERANCE)


def _weights(qr_factor: QRFactor) -> Array:
    """Return limited weights (E,) of the equations by the residuals of one ordinary fit."""
    theta = _least_norm(qr_factor, equal_weights(qr_factor))
    std = qr_factor.residual_norms(theta) / np.sqrt(np.maximum(qr_factor.counts, 1))
    largest = float(np.max(std))
    # An equation without a torque is homogeneous, and zero fits it without a residual: unbounded
    # weights would give it everything.
    return largest / np.maximum(std, _FEW * largest) if largest else equal_weights(qr_factor)


def _started(
    condition: Conditioned, joint: str, scale: Scale, start: Mapping[str, float]
) -> Conditioned:
    """Return the condition with start values for nonlinear parameters of a drive, and its levels.

    `start` are values of the drive with linear terms only.
    """
    drive = condition.robot.drives[joint]
    values: dict[str, float] = {
        # A level of zero would make the columns of the other parameters of its term zero.
        name: 1.0 if name in LEVEL_OF.values() else starts_of(name, drive, start, scale)[0]
        for name in motor_regressor(condition.robot, joint).names
        if name in PARAMETERS and name not in (*drive.values, "motor_inertia")
    }
    # A regression may find positive parameters below zero.
    signed = {x: abs(y) if PARAMETERS[x].is_positive else y for x, y in values.items()}
    return condition.with_drives({joint: drive.with_values(signed)})


def _searches(condition: Condition, joints: Iterable[str]) -> Iterator[tuple[str, _Search]]:
    """Yield joints with searches on the sides of their drives; other columns are projected out."""
    load = cache(lambda: starting_load_fit(condition))  # one for all stiff drives
    robot, motions = condition.robot, condition.motions
    for joint in joints:
        if joint in robot.elastic_joints:
            rows = regression.stacked([actuator_regression(robot, x, joint) for x in motions])
            at_rows = actuator_drive(robot, motions, joint, rows, np.empty(0))
            yield joint, _Search(at_rows, np.ones(len(rows.y)))
            continue
        fit = load()
        parts = [load_side(robot).parts(motion, fit.rows.joint) for motion in motions]
        drive = load_drive(robot, motions, joint, fit.rows, fit.values, parts)
        # (E,) per equation -> (R,) per row; `equations` are sorted.
        places = np.searchsorted(fit.qr_factor.equations, fit.rows.joint)
        yield joint, _Search(drive, _weights(fit.qr_factor)[places])


_SETTLED, _MOST_TURNS, _SEARCHES = 1e-5, 20, 2
"""Relative change of the torques through the gears at which they have converged; most iterations
until then; searches of the nonlinear parameters, each with the torques of the one before."""


def with_gear_torques(condition: Conditioned) -> Conditioned:
    """Return the condition with linearised drives, and the torques through its gears."""
    condition = linearised(condition, condition.robot.elastic_joints)
    robot, motions = condition.robot, condition.motions
    if not regression.under_load(robot, condition.used):
        return linearised_load(condition)
    # Without a torque through the gears there is no load-dependent friction, whose column is zero.
    known = [replace(x, gear_torque=np.zeros_like(x.joint_position)) for x in motions]
    linear = linearised_load(replace(condition, datasets=known))
    for _ in range(_SEARCHES):
        linear = _settled(linear)
        near = {x: y.with_values(linear.robot.drives[x].values) for x, y in robot.drives.items()}
        linear = linearised_load(replace(linear, robot=robot.with_drives(near)))
    return _settled(linear)


def _settled(condition: Conditioned) -> Conditioned:
    """Return the condition with the motions at which the torques through the gears converge."""
    for _ in range(_MOST_TURNS):
        before, condition = condition.motions, replace(condition, datasets=with_torques(condition))
        if _change(before, condition.motions) < _SETTLED:
            return condition
    joints = regression.under_load(condition.robot, condition.used)
    raise IdentificationError(
        f"load-dependent friction of {', '.join(joints)} did not converge in {_MOST_TURNS} "
        "iterations: remove 'load' from friction, or move these joints more"
    )


def with_torques(condition: Condition) -> list[Motion]:
    """Return the motions with the torques through the gears by a fit of the load side."""
    fit = starting_load_fit(condition)
    of_fit = condition.model, fit.springs, fit.values
    return [with_gear_torque(condition.robot, x, *of_fit) for x in condition.motions]


def _change(before: Sequence[Motion], after: Sequence[Motion]) -> float:
    """Return the relative change of the torques."""
    old, new = (
        np.concatenate([np.nan_to_num(np.asarray(motion.gear_torque)) for motion in motions])
        for motions in (before, after)
    )
    return float(np.linalg.norm(new - old) / max(float(np.linalg.norm(new)), 1e-300))


def _check_whole(condition: Condition) -> None:
    """Raise IdentificationError for what is searched in a whole log, if one is read in pieces."""
    robot = condition.robot
    if all(isinstance(dataset, Motion) for dataset in condition.datasets):
        return
    for joint, drive in robot.drives.items():
        if {*WARM_UP} & {*drive.friction} and "warm_up_time" not in drive.known:
            raise IdentificationError(
                f"joint '{joint}': the time of its warm-up is searched in a whole log, and this "
                "one is read in pieces: read it with read_log, or give warm_up_time_s and "
                'known = ["warm_up_time"] in the drives file'
            )
    if regression.under_load(robot, condition.used):
        raise IdentificationError(
            "load-dependent friction of a stiff drive needs the log in memory: read it with "
            "read_log"
        )


def linearised_condition(condition: Conditioned) -> Conditioned:
    """Return the condition of the robot with values at which its nonlinear drives are linearised.

    Its datasets have the torque through the gears if friction depends on it. Of logs that are read
    in pieces the first piece is searched. Raises IdentificationError for load-dependent friction of
    a stiff drive in such a log, and for an unknown warm-up time.
    """
    if regression.is_linear(condition.robot, condition.used):
        return condition
    _check_whole(condition)
    linear = with_gear_torques(replace(condition, datasets=condition.motions))
    if regression.under_load(condition.robot, condition.used):
        return linear
    return replace(linear, datasets=condition.datasets)
