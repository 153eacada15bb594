"""Checks of the fitted model: what its equations lack, as columns next to those of the fit.

Every `ColumnCheck` proposes candidates for an equation: terms of friction and springs that a drive
lacks, springs parallel to a joint, gains in another unit, errors of the gear that are periodic,
motors that move with two joints, a ratio that varies, a torque that is late, a zero that is off.
`selections` selects among all of them, equation by equation, and each check words what was accepted
of its own; candidates of other checks that explain as much are named as rivals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from seaid._arrays import Array, white_noise
from seaid._files import toml_key
from seaid.checks.check import Code, in_description, in_drives, only_joint
from seaid.checks.codes import (
    BACKLASH,
    COUPLED_JOINTS,
    DELAY,
    ENCODER_OFFSET,
    GAIN_SCALE,
    GEAR_RATIO,
    MISSING_TERM,
    NONLINEAR_SPRING,
    TRANSMISSION_ERROR,
    VARYING_RATIO,
)
from seaid.checks.engine import (
    Accepted,
    Alternative,
    Candidate,
    Equation,
    Point,
    Selection,
    Trial,
    forward_selection,
)
from seaid.checks.terms import (
    DriveRows,
    TermComparison,
    actuator_drive,
    coarse_motions,
    evidence_of,
    load_drive,
    possible_terms,
    reference_position,
    term_candidates,
    toml_of,
    with_term,
)
from seaid.checks.tolerances import LEAST_DELAY_S, LEAST_SWING, PART, POOR, SIGNIFICANT, SURE
from seaid.checks.values import drive_findings, noise_findings
from seaid.drives import (
    IDEAL_DRIVE,
    DefaultTerms,
    Drive,
    parameter_of,
    term_fields,
    total_ratio,
    unit_of,
)
from seaid.errors import Finding, SeaidError, listed
from seaid.estimation import (
    FittedRows,
    estimator_named,
    fit,
    qr_factor_of,
    scaled_svd,
    settled_weights,
)
from seaid.log import Log, Motion, changed_source, in_band_at, still_speed
from seaid.regressor import (
    BaseParameters,
    motor_regressor,
    regressor_at_drives,
    with_known_friction,
)
from seaid.robot import Robot


@dataclass(frozen=True, eq=False)
class Side:
    """An equation of the fit: (7) of an elastic joint, or the load side (8).

    `joints` are those whose drives are in its rows, `widths` {joint: width of Coulomb friction}
    those that the encoders resolve, `gears` the joints whose gear was measured, `base` the
    base parameters of the load side, `offset_std` [rad] the standard deviation of the joints'
    zeros that the errors of the estimate contain.
    """

    robot: Robot
    motions: Sequence[Motion]
    fitted: FittedRows
    joints: tuple[str, ...]
    is_motor: bool
    widths: Mapping[str, float]
    gears: frozenset[str] = frozenset()
    base: BaseParameters | None = None
    offset_std: float = 0.0

    @cached_property
    def equation(self) -> Equation:
        """The rows of the fit with the weights of its equations."""
        assert self.fitted.rows is not None
        return Equation(self.fitted.rows, self.fitted.weights)

    def unexplained(self, joint: str) -> float:
        """Return the error of the equation of a joint over its torque without the mean."""
        rows = self.equation.rows.joint == self.robot.index(joint)
        y = self.equation.weight[rows] * self.equation.rows.y[rows]
        return float(np.sqrt(self.equation.squares(rows) / max(float(np.var(y)) * len(y), 1e-300)))

    def swing(self, joint: str) -> float:
        """Return the range of a joint [rad or m], in the motion where it is largest."""
        index = self.robot.index(joint)
        return max(float(np.ptp(motion.joint_position[:, index])) for motion in self.motions)

    def source(self, joint: str, quantity: str) -> str | Mapping[str, Any]:
        """Return the column of a quantity, or its entry in the description; "" without it."""
        processing = self.motions[0].processing
        sources = (processing and processing.sources) or {}
        found: str | Mapping[str, Any] = sources.get(joint, {}).get(quantity, "")
        return found

    @cached_property
    def coarse(self) -> list[Motion]:
        """The motions with as few samples as screening needs."""
        return coarse_motions(self.motions)

    def drive(self, joint: str, *, at_joint: bool = False, few: bool = False) -> DriveRows:
        """Return a drive at the rows, at its motor or `at_joint`, by `few` samples or all."""
        return self._drive(joint, at_joint, few)

    @cached_property
    def _drive(self) -> Callable[[str, bool, bool], DriveRows]:
        return cache(partial(_drive_at_rows, self))

    @cached_property
    def bodies_at_rows(self) -> Array:
        """The columns (R, 10N) of the bodies at the rows."""
        return _bodies_turned(self, "", 0.0)

    @cached_property
    def states(self) -> list[tuple[Any, ...]]:
        """Position, velocity and acceleration (T, n) of the joints at the rows of each motion.

        The fourth array are the places of the rows, the fifth those of their instants.
        """
        rows, found = self.equation.rows, []
        for run, motion in enumerate(self.motions):
            own = np.flatnonzero(rows.run == run)
            times, instants = np.unique(rows.time[own], return_inverse=True)
            samples = np.searchsorted(motion.time, times)
            states = (in_band_at(motion, state, samples) for state in motion.joint_states)
            found.append((*states, own, instants))
        return found


def _drive_at_rows(side: Side, joint: str, at_joint: bool, few: bool) -> DriveRows:
    coarse = side.coarse if few else ()
    rows, theta = side.equation.rows, side.fitted.estimate.values
    if side.is_motor:
        return actuator_drive(side.robot, side.motions, joint, rows, theta, coarse)
    return load_drive(side.robot, side.motions, joint, rows, theta, coarse, at_joint=at_joint)


@dataclass(frozen=True)
class ColumnCheck:
    """A check of an equation: `candidates` are its columns for a joint.

    `finding` words what was accepted of a joint, with the part of the squared residual that it
    explains; it may find that it is nothing. `cause` names a candidate as the rival of another, by
    its field and term, and `decision` is the measurement that separates it from its rivals.
    `contains` are the codes of simpler mistakes, whose columns are among those of the candidates.
    """

    code: Code
    candidates: Callable[[Side, str], Iterable[Candidate]]
    finding: Callable[[Side, str, Sequence[Accepted], float], Finding | None]
    cause: str
    decision: str
    contains: tuple[Code, ...] = ()


_STIFF = ("offset", "smooth_coulomb", "asymmetric", "quadratic", "stribeck")
_ELASTIC = ("smooth_coulomb", "asymmetric", "quadratic", "load", "stribeck")
"""Friction of a stiff drive has no part that depends on the load, which needs another fit."""

_LAWS = ("cubic", "fifth", "dead_zone", "dahl", "damping")


def _terms(
    side: Side, joint: str, field: str, terms: Sequence[str], *, at_joint: bool = False
) -> list[Candidate]:
    """Return the terms of a field that a drive lacks and can have, as candidates."""
    possible = list(possible_terms(side.robot.drives[joint], {field: terms}))
    if not possible:
        return []
    width = side.widths.get(joint)
    grids = {} if width is None else {"coulomb_width": [width * k for k in _MULTIPLES]}
    few = side.drive(joint, at_joint=at_joint, few=True)
    return term_candidates(side.drive(joint, at_joint=at_joint), few, possible, grids)


_MULTIPLES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Widths of Coulomb friction that are tried, over the one that the encoders resolve."""


def _friction(side: Side, joint: str) -> list[Candidate]:
    drive = side.robot.drives[joint]
    if drive.is_elastic and not side.is_motor:
        return []
    terms: tuple[str, ...] = _ELASTIC if drive.is_elastic else _STIFF
    if drive == IDEAL_DRIVE:  # it has no friction at all
        terms = ("viscous", "coulomb", "offset")
    found = _terms(side, joint, "friction", terms)
    if drive.controller is None or drive.is_elastic:
        return found
    # the closed loop of a drive with a controller shows errors over its position
    return found + _terms(side, joint, "friction", ("coulomb_position",))


def _parallel_springs(side: Side, joint: str) -> list[Candidate]:
    """Return the spring parallel to a joint; what holds a locked output, and yields, is none."""
    if side.is_motor or side.swing(joint) < LEAST_SWING:
        return []
    return _terms(side, joint, "parallel_spring", ("linear",), at_joint=True)


def _gain_scales(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the torque of the known bodies at a joint whose gains may be in another unit.

    With y = tau - tau_known and gains that are 1 / s of their unit, tau = (tau_known + ...) / s: y
    has (1 / s - 1) tau_known more.
    """
    drive = side.robot.drives[joint]
    is_given = drive.controller is not None and not drive.is_up_to_scale
    has_bodies = np.any(side.robot.known_parameters) and side.robot.floating_base is None
    if is_given and has_bodies and not side.is_motor:
        yield Candidate(joint, "gain_scale", "", partial(_known_torque, side, joint))


def _known_torque(side: Side, joint: str, of_few: bool) -> list[Point]:
    """Return the torque (R, 1) of the known bodies at the rows of a joint."""
    del of_few  # the rows alone are computed
    is_own = side.equation.rows.joint == side.robot.index(joint)
    known = side.robot.known_parameters[:, None]
    return [Point({}, Alternative(is_own[:, None] * _turned_at_rows(side, joint, 0.0, known), 1))]


def _spring_laws(side: Side, joint: str) -> list[Candidate]:
    return _terms(side, joint, "spring", _LAWS) if side.is_motor else []


_ORDERS = {"motor": (1, 2, 3, 4, 6), "joint": (1, 2, 3, 4, 5, 6, 8, 10, 12), "mesh": (1, 2)}
"""Orders that are tried: turns and poles of the motor, turns of the joint, and the two lobes of
strain-wave gears. Higher orders of the motor turn faster than a cutoff lets pass."""

_LEAST_PERIODS = 0.5
"""An order is tried if the motion covers so many of its periods; fewer look like the spring."""


def _orders(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the cosine and sine of the orders that a drive lacks and the motion covers."""
    if not side.is_motor:
        return
    drive, exact, few = side.robot.drives[joint], side.drive(joint), side.drive(joint, few=True)
    angles = _angles(drive, exact.signals)
    own = {(one.angle, one.order) for one in drive.harmonics}
    for name, orders in _ORDERS.items():
        width = max((float(np.ptp(angle)) for angle in angles.get(name, ())), default=0.0)
        if name == "mesh" and width < 2 * np.pi * drive.ratio:  # it has the orders of the motor
            continue
        for order in orders:
            if (name, order) not in own and order * width >= 2 * np.pi * _LEAST_PERIODS:
                points = partial(_harmonic, side.equation, exact, few, name, order)
                yield Candidate(joint, name, str(order), points)


def _angles(drive: Drive, signals: Sequence[Mapping[str, Array]]) -> dict[str, list[Array]]:
    """Return the angles of each motion by name."""
    angles = {
        "motor": [one["theta_M"] for one in signals],
        "mesh": [one["theta_M"] * (1 - 1 / drive.ratio) for one in signals],
    }
    if drive.joint_units[1] == "rad":
        angles["joint"] = [one["theta_L"] for one in signals]
    return angles


_LEAST_LEFT = 0.1
"""Least part of a harmonic that the low pass and the other columns leave, to be tried at all."""


def _harmonic(
    equation: Equation, exact: DriveRows, few: DriveRows, name: str, order: int, of_few: bool
) -> list[Point]:
    drive = few if of_few else exact
    angles = _angles(exact.robot.drives[exact.joint], drive.signals)[name]
    parts = [np.column_stack([np.cos(order * x), np.sin(order * x)]) for x in angles]
    pair = drive.at_rows(parts)
    left = np.abs(np.diag(np.linalg.qr(equation.left(pair))[1]))
    if np.min(left) < _LEAST_LEFT * np.sqrt(0.5 * len(pair)):  # norm of a cosine over its periods
        return []
    return [Point({}, Alternative(pair, 2))]


def _couplings(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the angles of other joints: a motor that moves with them has them in (7).

    Not where the deflection is measured, which shows the spring alone.
    """
    if side.is_motor and joint not in side.gears:
        for other in side.robot.joint_names:
            if other not in {joint, *side.robot.drives[joint].transmission}:
                yield Candidate(joint, _COUPLED, other, partial(_angle, side, joint, other))


def _varying_ratio(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the angle that a motor has more where its ratio varies once per turn of its joint."""
    is_rotary = side.robot.drives[joint].joint_units[1] == "rad"
    if side.is_motor and is_rotary and joint not in side.gears:
        yield Candidate(joint, _VARYING, "joint", partial(_angle, side, joint, joint))


_COUPLED, _VARYING = "coupled", "varying"
"""Fields of the candidates of a motor that moves with two joints, and of a ratio that varies."""


def _angle(side: Side, joint: str, moving: str, of_few: bool) -> list[Point]:
    """Return the angle of another joint at the rows, or the angle, cosine and sine of the own."""
    drive, index = side.drive(joint, few=of_few), side.robot.index(moving)
    angles = [motion.joint_position[:, index] for motion in drive.motions]
    if moving == joint:
        parts = [np.column_stack([x, np.cos(x), np.sin(x)]) for x in angles]
    else:
        parts = [x[:, None] for x in angles]
    columns = drive.at_rows(parts)
    return [Point({}, Alternative(columns, columns.shape[1]))]


_LATE = "delay"
"""Field of the candidates of late torques."""


def _late_torque(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the slope of the motor torque: one late by d is tau - d tau' to first order."""
    drive = side.robot.drives[joint]
    if drive.motor_input != "torque" or (drive.is_elastic and not side.is_motor):
        return
    index = side.robot.index(joint)
    if all(np.all(np.isfinite(one.motor_torque[:, index])) for one in side.motions):
        yield Candidate(joint, _LATE, "motor_torque", partial(_slope, side, joint))


def _slope(side: Side, joint: str, of_few: bool) -> list[Point]:
    """Return -tau' at the rows, without what friction and rotor of another drive explain."""
    del of_few  # few samples of a noisy torque do not have its slope
    slope, others = _late_columns(side, joint)
    equation = side.equation
    weight = equation.weight[:, None]
    left = equation.left(weight * np.hstack([slope, others]))
    shared = others @ scaled_svd(left[:, 1:]).solve(left[:, 0])
    return [Point({}, Alternative(slope - shared[:, None], 1))]


def _late_columns(side: Side, joint: str) -> tuple[Array, Array]:
    """Return -tau' (R, 1) of a motor at the rows, and what resembles it in another drive (R, c).

    Friction that changes gradually near reversals resembles an early torque. What is in the model
    already is zero.
    """
    rows, drive, index = side.drive(joint), side.robot.drives[joint], side.robot.index(joint)
    is_ideal = drive == IDEAL_DRIVE
    is_open = is_ideal or drive.motor_inertia_kg_m2 is None
    fastest = max(float(np.max(np.abs(one.motor_velocity[:, index]))) for one in side.motions)
    parts = [
        np.column_stack(
            [
                np.tanh(one.motor_velocity[:, index] / (_WIDTH * fastest)),
                one.motor_velocity[:, index],
                is_ideal * np.sign(one.motor_velocity[:, index]),
                is_open * one.motor_acceleration[:, index],
            ]
        )
        for one in side.motions
    ]
    others, weight = rows.at_rows(parts), side.equation.weight[:, None]
    left = np.linalg.norm(side.equation.left(weight * others), axis=0)
    # what is in the model already leaves nothing but rounding
    others[:, left < _LEAST_LEFT**3 * np.linalg.norm(weight * others, axis=0)] = 0.0
    return -rows.slope_at_rows([one.motor_torque[:, index] for one in side.motions]), others


_WIDTH = 0.1
"""Speed over the largest one at which friction may have another shape than that of the drive."""


def _zeros(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the torque that the fitted bodies have more where the zero of an encoder is off.

    The motors of springs move along, because the spring offset absorbs a constant deflection.
    """
    if side.is_motor or side.base is None or side.robot.floating_base is not None:
        return
    if side.robot.has_controllers:  # an offset moves the commands as well: `commands` looks at it
        return
    if not side.robot.is_prismatic[side.robot.index(joint)] and side.swing(joint) > LEAST_SWING:
        yield Candidate(joint, "offset", "joint_position", partial(_turned, side, joint))


_STEP_RAD = 1e-4
"""Step of the difference quotient by a joint angle."""


def _turned(side: Side, joint: str, of_few: bool) -> list[Point]:
    """Return the derivative (R, 1) of the load's torque by the angle of a joint."""
    del of_few  # the rows alone are computed
    assert side.base is not None
    fitted = side.equation.values[: len(side.base.grouping)]
    bodies = side.base.least(fitted) + side.robot.known_parameters
    change = (_bodies_turned(side, joint, _STEP_RAD) - side.bodies_at_rows) @ bodies
    return [Point({}, Alternative(change[:, None] / _STEP_RAD, 1))]


def _bodies_turned(side: Side, joint: str, angle: float) -> Array:
    """Return the columns (R, 10N) of the bodies at the rows, with an angle added to a joint."""
    turn = np.zeros(side.robot.n)
    if joint:
        turn[side.robot.index(joint)] = angle
    found = np.zeros((len(side.equation.rows.y), 10 * len(side.robot.body_names)))
    for q, v, a, own, instants in side.states:
        regressor = regressor_at_drives(side.robot, q + turn, v, a)
        found[own] = regressor[instants, side.equation.rows.joint[own].astype(int)]
    return found


_MOST_STEPS, _AT_ONCE = 8, 4000
"""Steps of the search of an offset, which is far below a radian; samples of a regressor at once."""


def _turned_at_rows(side: Side, joint: str, angle: float, onto: Array) -> Array:
    """Return the bodies' columns at the rows, an angle added to a joint, times `onto` (10N, k).

    They are filtered as the rows (R, k) are: the torque of filtered states differs from the
    filtered torque by more than the error of an angle.
    """
    rows, turn = side.equation.rows, np.zeros(side.robot.n)
    turn[side.robot.index(joint)] = angle
    turned = np.zeros((len(rows.y), onto.shape[1]))
    for motion, (*_, own, instants) in zip(side.motions, side.states, strict=True):
        parts = []
        for start in range(0, len(motion.time), _AT_ONCE):
            q, v, a = (state[start : start + _AT_ONCE] for state in motion.joint_states)
            parts.append(regressor_at_drives(side.robot, q + turn, v, a) @ onto)
        columns = with_known_friction(motion, range(side.robot.n), np.concatenate(parts))
        samples = np.searchsorted(motion.time, np.unique(rows.time[own]))
        columns = in_band_at(motion, columns, samples)
        turned[own] = columns[instants, rows.joint[own].astype(int)]
    return turned


def _searched_zero(side: Side, joint: str) -> tuple[float, float]:
    """Return the angle to be added to a joint, and its standard error, next to any bodies.

    Gauss and Newton's steps, with the derivative at the angle of the log: the bodies were fitted at
    the wrong zero, and change with it, and so do the weights of the equations.
    """
    assert side.base is not None
    rows, count = side.equation.rows, len(side.base.grouping)
    onto = np.column_stack([side.base.least(np.eye(count)), side.robot.known_parameters])
    before, ahead = (_turned_at_rows(side, joint, x, onto) for x in (0.0, _STEP_RAD))
    angle, change, derivative = 0.0, np.zeros_like(before), (ahead - before) / _STEP_RAD
    for _ in range(_MOST_STEPS):
        H, y = rows.H.copy(), rows.y - change[:, count]
        H[:, :count] += change[:, :count]
        turned = replace(rows, H=H, y=y)
        current = Equation(turned, settled_weights(qr_factor_of(turned)))
        slope = derivative @ np.append(current.values[:count], 1.0)
        (correction,), (error,) = current.with_alternative(Alternative(slope[:, None], 1)).last(1)
        angle += float(correction)
        if abs(correction) < 0.1 * error:
            break
        change = _turned_at_rows(side, joint, angle, onto) - before
    return angle, float(error)


def _zero_is_off(
    side: Side, joint: str, accepted: Sequence[Accepted], share: float
) -> Finding | None:
    """Return the finding of a joint whose zero is not that of the robot file.

    An angle beyond a turn, or one that is not determined, stands for something else.
    """
    (offset,), (error,) = accepted[0].coefficients.tolist(), accepted[0].errors.tolist()
    if abs(offset) > SURE * side.offset_std:  # else its effect is linear, and in the errors
        offset, error = _searched_zero(side, joint)
    if abs(offset) > np.pi or abs(offset) < SIGNIFICANT * error:
        return None
    robot = side.robot
    moved = {(joint, "joint_position"): 1.0}
    for turns, (other, drive) in zip(
        robot.transmission[:, robot.index(joint)], robot.drives.items(), strict=True
    ):
        moved[other, "motor_position"] = turns * total_ratio(drive)
    entries: dict[str, dict[str, str]] = {}
    for (other, quantity), factor in moved.items():
        if factor and side.source(other, quantity):
            changed = changed_source(side.source(other, quantity), offset=round(factor * offset, 5))
            entries.setdefault(other, {})[quantity] = changed
    return ENCODER_OFFSET.finding(
        f"the zero of {joint} is {np.degrees(offset):.2f} +- {np.degrees(error):.2f} degrees from "
        f"that of the robot file: that explains {share:.0%} of the squared residual of its torque",
        joint,
        "note" if abs(offset) < SURE * side.offset_std else "doubtful",
        {"offset [rad]": offset, "standard error [rad]": error, "explained": share},
        in_description(entries),
    )


def _missing_terms(side: Side, joint: str, accepted: Sequence[Accepted], share: float) -> Finding:
    """Return the finding of terms that a drive lacks, with the field of the drive that has them."""
    drive, field = side.robot.drives[joint], accepted[0].trial.candidate.field
    terms = [one.trial.candidate.term for one in accepted]
    if field == "parallel_spring" and drive.is_elastic:
        terms.append("preload")  # it rests at any angle, which the spring in series would hide
    is_spring = field == "spring"
    width = next((x.trial.values.get("coulomb_width") for x in accepted), None)
    is_sampled = len(terms) == 1 and (width or np.inf) <= _UNRESOLVED * side.widths.get(joint, 0)
    # the width of a term that was added by itself is one of a coarse grid
    is_coarse = isinstance(drive.friction, DefaultTerms) and "coulomb_width" in drive.known
    matters = is_spring or (share > _MATTERS and not (is_sampled or is_coarse))
    if field == "parallel_spring" and drive.controller is None:
        # next to a torque that is explained it resembles gravity, which other mistakes change too
        matters = matters and side.unexplained(joint) > PART
    what = f"the spring of {joint} is not linear" if is_spring else f"{joint} lacks a term"
    what = _FOLLOWS.get(terms[0], what).format(joint)
    names = " and ".join(f"'{one.trial.candidate.term}'" for one in accepted)
    comparison = accepted[0].trial.comparison
    assert comparison is not None
    values = {name: value for one in accepted for name, value in one.trial.values.items()}
    remedy = f"in the drives file:\n{toml_of(joint, drive, field, terms, values)}"
    if "coulomb_position" in terms and not drive.reference_position_rad:
        middle = reference_position(side.motions, side.robot.index(joint))
        remedy += f"\nreference_position_rad = {middle:g}"
    message = (
        f"{what}: {names} in its {field} would explain {share:.0%} of the squared residual of its "
        f"{'motor' if side.is_motor else 'torque'} equation and improve the prediction of excluded "
        f"blocks by {comparison.improvement:.0%}"
    )
    code = NONLINEAR_SPRING if is_spring else MISSING_TERM
    evidence = evidence_of(comparison, values) | {"explained": share}
    return code.finding(message, joint, "doubtful" if matters else "note", evidence, remedy)


_MATTERS = 0.25
"""Part of the squared residual of a joint that makes what its drive lacks doubtful: the residual
falls by an eighth. A spring that is not linear always is, since its stiffness has no single
value."""

_UNRESOLVED = 2.0
"""Width of Coulomb friction, over the one that the logs resolve, up to which it is that of the
sampling: of an encoder step, or of a sample in which the speed changes its sign."""

_FOLLOWS = {
    "coulomb_position": "the residual of {} follows its position, with the sign of its speed",
    "linear": "the residual of {} follows its position",
}
"""{candidate of a drive with a controller: what its support means}."""


def _gain_is_scaled(
    side: Side, joint: str, accepted: Sequence[Accepted], share: float
) -> Finding | None:
    """Return the finding of gains in another unit, or of bodies that are heavier or lighter."""
    (change,), (error,) = accepted[0].coefficients.tolist(), accepted[0].errors.tolist()
    times = 1.0 + change
    if times <= 0:
        return None
    return GAIN_SCALE.finding(
        f"the torque of the controller of {joint} is {times:.3g} +- {error:.2g} times that of the "
        f"known bodies, which explains {share:.0%} of the squared residual of its torque equation: "
        f"its gains are in another unit, such as V per rad, and {1 / times:.3g} times as large in "
        f"N m; or the bodies are {times:.3g} times as heavy as in the robot file",
        joint,
        "doubtful",
        {
            "torque over that of the known bodies": times,
            "standard error": error,
            "explained": share,
        },
        "weigh a link: if the known bodies are right, the scale of the gains is a parameter, "
        + in_drives({(joint, "controller"): "is_up_to_scale = true"}),
    )


_DOUBTFUL_ORDERS = 0.3
"""Share of the residual that orders must explain to make a result doubtful."""


def _periodic(side: Side, joint: str, accepted: Sequence[Accepted], share: float) -> Finding:
    """Return the finding of periodic errors, with their orders as TOML."""
    drive, estimate = side.robot.drives[joint], side.fitted.estimate
    is_error = joint not in side.gears and not drive.is_nonlinear_spring
    field = "transmission_error" if is_error else "torque_ripple"
    orders = [(one.trial.candidate.field, int(one.trial.candidate.term)) for one in accepted]
    text = ", ".join(f"order {order} of the {angle}" for angle, order in orders)
    evidence = {"share of the residual": share}
    if is_error and "stiffness" in estimate.names and estimate.value("stiffness") > 0:
        is_motor = side.drive(joint).regressor is motor_regressor
        lever = drive.motor_radius / drive.ratio if is_motor else 1.0
        largest = max(float(np.linalg.norm(one.coefficients)) for one in accepted)
        error = largest / (lever * estimate.value("stiffness"))
        evidence["amplitude"] = error
        text += f"; up to {1e3 * error:.2g} m{drive.spring_units[1]} between the encoders"
    by_angle: dict[str, list[int]] = {}
    own = [(one.angle, one.order) for one in drive.harmonics if one.field == field]
    for angle, order in [*own, *orders]:
        by_angle.setdefault(angle, []).append(order)
    table = ", ".join(f"{angle} = {sorted(numbers)}" for angle, numbers in by_angle.items())
    return TRANSMISSION_ERROR.finding(
        f"{share:.0%} of the residual of (10) of {joint} is periodic ({text}): an error of the "
        "gear or its encoders, or ripple of the motor",
        joint,
        "doubtful" if share >= _DOUBTFUL_ORDERS else "note",
        evidence,
        in_drives({(joint,): f"{field} = {{ {table} }}"}),
    )


def _spring_of(side: Side, joint: str, accepted: Sequence[Accepted]) -> float:
    """Return what an angle of the joint adds to the equation of its motor, next to columns."""
    drive, equation = side.robot.drives[joint], side.equation
    for found in accepted:
        assert found.trial.alternative is not None
        equation = equation.with_alternative(found.trial.alternative)
    stiffness = equation.values[side.fitted.estimate.names.index("stiffness")]
    is_motor = side.drive(joint).regressor is motor_regressor
    lever = drive.motor_radius / drive.ratio if is_motor else 1.0
    return float(stiffness) * drive.load_radius * lever


def _moves_with(
    side: Side, joint: str, accepted: Sequence[Accepted], share: float
) -> Finding | None:
    """Return the finding of a motor that moves with other joints than its own.

    None where the part of another joint is small: flexible links turn encoders by thousandths.
    """
    spring, turned = _spring_of(side, joint, accepted), {joint: 1.0}
    said = []
    for found in accepted:
        other = found.trial.candidate.term
        turns, error = (float(x[0]) / spring for x in (-found.coefficients, found.errors))
        turned[other] = turns
        said.append(f"{turns:.3g} +- {abs(error):.1g} times with {other}")
    if max(abs(turns) for other, turns in turned.items() if other != joint) < POOR:
        return None
    table = ", ".join(f"{toml_key(other)} = {turns:.4g}" for other, turns in turned.items())
    return COUPLED_JOINTS.finding(
        f"the motor of {joint} turns behind its gear as {joint} and {listed(said)}: that explains "
        f"{share:.0%} of the squared residual of its motor equation. It drives several joints, by "
        f"a differential, a tendon or a parallel linkage; or the encoder of {joint} measures its "
        "angle against another link than the one before it",
        joint,
        "wrong" if share > PART else "doubtful",
        {
            **{f"turns with {other}": turns for other, turns in turned.items()},
            "explained": share,
        },
        in_drives({(joint,): f"transmission = {{ {table} }}"}),
    )


def _ratio_varies(
    side: Side, joint: str, accepted: Sequence[Accepted], share: float
) -> Finding | None:
    """Return the finding of a ratio that depends on the angle, None where it hardly does.

    A motor that turns by N (q + e q + c cos q + s sin q) has, for its angle, the ratio
    N (1 + e - c sin q + s cos q). That of its torque is not in the columns.
    """
    drive, index = side.robot.drives[joint], side.robot.index(joint)
    slope, cosine, sine = -accepted[0].coefficients / _spring_of(side, joint, accepted)
    reached = np.concatenate([motion.joint_position[:, index] for motion in side.motions])
    angles = np.linspace(np.min(reached), np.max(reached), _ANGLES)
    ratios = drive.ratio * (1.0 + slope - cosine * np.sin(angles) + sine * np.cos(angles))
    low, high = int(np.argmin(ratios)), int(np.argmax(ratios))
    if ratios[high] - ratios[low] < POOR * abs(float(np.mean(ratios))):
        return None
    return VARYING_RATIO.finding(
        f"the gear ratio of {joint} depends on its angle: {ratios[low]:.3g} at {angles[low]:.2g} "
        f"rad and {ratios[high]:.3g} at {angles[high]:.2g} rad, where the drives file has "
        f"{drive.ratio:g}. This explains {share:.0%} of the squared residual of its motor "
        "equation: the transmission is a linkage, a lever or a spindle",
        joint,
        "wrong",
        {
            "least ratio": float(ratios[low]),
            "largest ratio": float(ratios[high]),
            "cos [rad]": float(cosine),
            "sin [rad]": float(sine),
            "explained": share,
        },
        "convert angle and torque of the motor to those of a gear with a constant ratio, by the "
        "geometry of the linkage, before the log is read",
    )


_ANGLES = 50
"""Angles at which a ratio is evaluated, over the range of a joint."""


def _late(side: Side, joint: str, accepted: Sequence[Accepted], share: float) -> Finding:
    """Return the finding of a motor torque that is late or early against the positions."""
    (delay,), (error,) = accepted[0].coefficients.tolist(), accepted[0].errors.tolist()
    return late_torques(side, [joint], delay, error, {"explained": share})


def late_torques(
    side: Side, joints: Sequence[str], delay: float, error: float, evidence: Mapping[str, float]
) -> Finding:
    """Return the finding that the motor torques of joints are late by a delay [s], or early."""
    late_s = round(delay, 5)
    entries = {
        joint: {"motor_torque": changed_source(side.source(joint, "motor_torque"), delay_s=late_s)}
        for joint in joints
    }
    return DELAY.finding(
        f"the motor torques of {', '.join(joints)} are {1e3 * abs(delay):.2f} +- "
        f"{1e3 * error:.2f} ms {'late' if delay > 0 else 'early'} against the positions",
        only_joint(joints),
        "doubtful" if abs(delay) > LEAST_DELAY_S else "note",
        {"delay [s]": delay, "standard error [s]": error, **evidence},
        in_description(entries),
    )


_AT_SPEEDS = "torques at several constant speeds show friction"
_AT_ANGLES = "torques that hold the joint at several angles show springs and masses"

COLUMN_CHECKS = (
    ColumnCheck(MISSING_TERM, _friction, _missing_terms, "'{term}' in its {field}", _AT_SPEEDS),
    ColumnCheck(
        MISSING_TERM, _parallel_springs, _missing_terms, "'{term}' in its {field}", _AT_ANGLES
    ),
    ColumnCheck(
        GAIN_SCALE,
        _gain_scales,
        _gain_is_scaled,
        "gains of the controller in another unit",
        "a link on a scale shows whether gains or masses are wrong",
    ),
    ColumnCheck(
        NONLINEAR_SPRING,
        _spring_laws,
        _missing_terms,
        "'{term}' in its {field}",
        "deflections of the locked joint under slowly growing and falling loads show the law of "
        "its spring",
    ),
    ColumnCheck(
        COUPLED_JOINTS,
        _couplings,
        _moves_with,
        "a motor that moves with {term}",
        "a motor that turns while its joint is held and another joint is moved drives both",
    ),
    ColumnCheck(
        VARYING_RATIO,
        _varying_ratio,
        _ratio_varies,
        "a gear ratio that varies with the angle",
        "both encoders of a joint that is slowly turned without a load show its ratio",
        (GEAR_RATIO,),
    ),
    ColumnCheck(
        TRANSMISSION_ERROR,
        _orders,
        _periodic,
        "an error of the gear (order {term} of the {field})",
        "both encoders of a joint that is slowly turned without a load show the errors of its gear",
    ),
    ColumnCheck(
        DELAY,
        _late_torque,
        _late,
        "a motor torque that is late or early",
        "torque and position that are stamped by one clock have no delay",
    ),
    ColumnCheck(
        ENCODER_OFFSET,
        _zeros,
        _zero_is_off,
        "a zero of the joint that is not that of the robot file",
        "a spirit level or a stop shows the zero of a joint",
    ),
)
"""The checks of an equation, in the order in which their findings are listed."""


def included_term(one: Trial) -> Finding:
    """Return the note that a term was added to a drive whose friction nobody named."""
    candidate, comparison = one.candidate, one.comparison
    assert comparison is not None
    width = "".join(f" over {value:.2g} rad/s" for value in one.values.values())
    return MISSING_TERM.finding(
        f"friction of {candidate.joint}, of which the drive names no terms: "
        f"'{candidate.term}'{width} is included and explains {comparison.explained:.0%} of the "
        "squared residual; name the terms in friction = [...] to decide it",
        candidate.joint,
        "note",
        evidence_of(comparison, one.values),
        certainty="certain",
    )


def backlash(joint: str, drive: Drive, one: TermComparison) -> Finding:
    """Return the finding of backlash that looks like a weak spring, by a comparison of laws."""
    comparison = one.comparison
    assert comparison is not None
    unit = unit_of(with_term(drive, one.field, one.term), "dead_zone")
    return BACKLASH.finding(
        f"the gear or the spring of {joint} has backlash, with a half width of about "
        f"{one.values['dead_zone']:.2g} {unit}: 'dead_zone' in its spring would explain "
        f"{comparison.explained:.0%} of the squared residual of its motor equation, and its "
        "stiffness without it is not that of the spring",
        joint,
        "doubtful",
        evidence_of(comparison, one.values),
        f"in the drives file:\n{toml_of(joint, drive, one.field, [one.term], one.values)}",
    )


STRONG = 6.0
"""Least decrease of the information criterion, "strong" by Kass and Raftery (1995).

`compare_terms` is asked, this is not: above zero 3 of 120 right set-ups have a
finding, all of them below 4 (scripts/benchmarks/term_selection.py --findings)."""


@dataclass(frozen=True, eq=False)
class SideSelection:
    """What was accepted into the equation of a side."""

    side: Side
    selection: Selection

    def delays(self) -> dict[str, tuple[float, float]]:
        """Return the delay of each motor torque [s], and its standard error, all at once.

        They are next to what was accepted but for delays: a torque that is late spoils the bodies,
        and with them the other joints.
        """
        joints = [one.joint for x in self.side.joints for one in _late_torque(self.side, x)]
        if not joints:
            return {}
        equation = self.selection.before
        for one in self.selection.accepted:
            if one.trial.candidate.field != _LATE and one.trial.alternative is not None:
                equation = equation.with_alternative(one.trial.alternative)
        slopes, others = zip(*(_late_columns(self.side, joint) for joint in joints), strict=True)
        equation = equation.with_alternative(Alternative(np.hstack(others), 0))
        late = Alternative(np.hstack(slopes), len(joints))
        values, errors = equation.with_alternative(late).last(len(joints))
        found = zip(values.tolist(), errors.tolist(), strict=True)
        return dict(zip(joints, found, strict=True))

    def vanished(self, cutoff_hz: float) -> set[tuple[str, str]]:
        """Return what the values show without the accepted columns, and not with them.

        It is (code, joint) of each: an echo of what was accepted.
        """
        rows = self.selection.after.rows
        kept = np.any(rows.H != 0, axis=0)  # columns of zeros were replaced
        names, units = (
            tuple(one for one, is_kept in zip(all_of, kept, strict=True) if is_kept)
            for all_of in (rows.names, rows.units)
        )
        rows = replace(rows, names=names, units=units, H=rows.H[:, kept])
        with suppress(SeaidError):
            again = fit(rows, estimator_named("wls"), cutoff_hz=cutoff_hz)
            return self._shown(self.side.fitted) - self._shown(again)
        return set()

    def _shown(self, fitted: FittedRows) -> set[tuple[str, str]]:
        """Return what the noise and the values of a fit show (code, joint)."""
        findings, estimate = noise_findings(fitted.estimate), fitted.estimate
        qr_factor = fitted.qr_factor if self.side.is_motor else None
        for joint in self.side.joints:
            own = [
                place
                for place, name in enumerate(estimate.names)
                if name in self.side.fitted.estimate.names
                and (self.side.is_motor or getattr(name, "joint", "") == joint)
            ]
            names = [parameter_of(estimate.names[place]) for place in own]
            findings += drive_findings(joint, estimate.part(own, names), qr_factor)
        return {(finding.code, finding.joint) for finding in findings}

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was accepted, of each joint and check."""
        return tuple(finding for *_, finding in self._worded)

    @property
    def contained(self) -> set[tuple[str, str]]:
        """The simpler mistakes (code, joint) whose columns are among those that were accepted."""
        return {(code.name, joint) for check, joint, _ in self._worded for code in check.contains}

    @property
    def unfounded(self) -> set[tuple[object, str]]:
        """The checks of joints whose columns were accepted and turn out to be nothing."""
        accepted = {
            (x.trial.candidate.about, x.trial.candidate.joint) for x in self.selection.accepted
        }
        return accepted - {(check, joint) for check, joint, _ in self._worded}

    @cached_property
    def _worded(self) -> tuple[tuple[ColumnCheck, str, Finding], ...]:
        return tuple(self._word())

    def _word(self) -> Iterator[tuple[ColumnCheck, str, Finding]]:
        for joint in self.side.joints:
            for check in COLUMN_CHECKS:
                own = [
                    one
                    for one in self.selection.accepted
                    if one.trial.candidate.about is check and one.trial.candidate.joint == joint
                ]
                share = sum(one.share for one in own)
                finding = check.finding(self.side, joint, own, share) if own else None
                if finding is not None:
                    yield check, joint, _with_rivals(self.side, finding, own)


def _with_rivals(side: Side, finding: Finding, accepted: Sequence[Accepted]) -> Finding:
    """Return a finding with the causes that explain as much, and what decides between them.

    Lines that only one of the causes supports would mislead. What would be nothing if it were
    accepted in place of the others is no cause.
    """
    rivals = [one for found in accepted for one in found.rivals if _would_be_named(side, one)]
    if not rivals:
        return finding
    trials = {one.candidate.name: one for one in (*(x.trial for x in accepted), *rivals)}
    causes, decisions = list[str](), dict[str, None]()
    for one in trials.values():
        check, candidate = one.candidate.about, one.candidate
        assert isinstance(check, ColumnCheck)
        field = candidate.field.replace("_", " ")
        causes.append(check.cause.format(term=candidate.term, field=field))
        decisions[check.decision] = None
    return replace(
        finding,
        message=f"{finding.message}. The log does not decide between {' and '.join(causes)}: each "
        "explains as much",
        remedy=f"a measurement decides: {'; '.join(decisions)}",
    )


def _would_be_named(side: Side, trial: Trial) -> bool:
    """Whether a candidate is a finding if it alone is accepted into the equation of the fit."""
    check = trial.candidate.about
    if trial.alternative is None or not isinstance(check, ColumnCheck):
        return False
    count = trial.alternative.columns.shape[1]
    found = Accepted(trial, *side.equation.with_alternative(trial.alternative).last(count))
    return check.finding(side, trial.candidate.joint, [found], trial.share) is not None


def without_setup_echoes(
    findings: Sequence[Finding],
    setup: Sequence[Finding],
    selected: Sequence[SideSelection],
    robot: Robot,
    mistakes_of: Callable[[Robot], Iterable[Finding]],
) -> list[Finding]:
    """Return findings without mistakes of the set-up that are echoes of what equations lack.

    `setup` are the mistakes of the set-up among them. A mistake is an echo if the robot whose
    drives have the selected terms does not show it, or if it is contained in what was selected: a
    tilt of gravity in springs parallel to the joints, another ratio in a ratio that varies.
    """
    mistakes = [one for one in setup if one.severity != "note"]
    if not mistakes:
        return list(findings)
    supported = _with_selected_terms(robot, selected)
    kept = {(one.code, one.joint) for one in mistakes}
    if supported.drives != robot.drives:
        kept = {(one.code, one.joint) for one in mistakes_of(supported)}
    kept = kept.difference(*(one.contained for one in selected))
    return [one for one in findings if one not in mistakes or (one.code, one.joint) in kept]


def _with_selected_terms(robot: Robot, selected: Iterable[SideSelection]) -> Robot:
    """Return the robot whose drives have the terms that the equations support."""
    drives = dict(robot.drives)
    for one in selected:
        for found in one.selection.accepted:
            candidate = found.trial.candidate
            if candidate.field in term_fields(drives[candidate.joint]):
                drive = drives[candidate.joint]
                drives[candidate.joint] = with_term(drive, candidate.field, candidate.term)
    return robot.with_drives(drives)


def without_echoes(
    values: Sequence[Finding], selected: Sequence[SideSelection], cutoff_hz: float
) -> list[Finding]:
    """Return what the values of a fit show, but for what its missing columns explain.

    Where the accepted columns are in the model, a weak spring, play between the encoders, or a
    drift may be gone: it was an echo of what the model lacks.
    """
    vanished: set[tuple[str, str]] = set()
    for one in selected:
        if any(finding.severity != "note" for finding in one.findings):
            vanished |= one.vanished(cutoff_hz)
    return [finding for finding in values if (finding.code, finding.joint) not in vanished]


def model_sides(
    robot: Robot,
    motions: Sequence[Motion],
    fits: tuple[Mapping[str, FittedRows], FittedRows],
    widths: Mapping[str, float],
    gears: Iterable[str] = (),
    base: BaseParameters | None = None,
    offset_std: float = 0.0,
) -> list[Side]:
    """Return the equations of `fits` that are checked: (7) of elastic joints, and the load side.

    `widths` {joint: width of Coulomb friction} are those that the encoders resolve, `gears` the
    joints whose gear was measured, `base` the base parameters of the load side, and `offset_std`
    the standard deviation of the joints' zeros [rad]. Rows that are not in memory are not checked,
    nor those of robust estimators, which lack some instants.
    """
    actuators, load = fits
    rows = load.rows
    if rows is None or not motions:
        return []
    loads = tuple(
        joint for place, joint in enumerate(robot.joint_names) if np.any(rows.joint == place)
    )
    given = widths, frozenset(gears)
    sides = [
        Side(robot, motions, fitted, (joint,), True, *given) for joint, fitted in actuators.items()
    ]
    sides += [Side(robot, motions, load, loads, False, *given, base, offset_std)] if loads else []
    return [
        side
        for side in sides
        if side.fitted.rows is not None and (side.fitted.settled is not None or side.fitted.equal)
    ]


def resolved_widths(
    robot: Robot, logs: Sequence[Log], motions: Sequence[Motion]
) -> dict[str, float]:
    """Return {joint: motor speed [rad/s] below which logs do not resolve the direction of motion}.

    One encoder step per sample, and the change of the speed within a sample at a reversal. The step
    is that of a quantised position of the same noise, whose standard deviation is step / sqrt(12).
    Not less than the speed below which a motor counts as standing: a smaller width would describe
    the friction of a motor that sticks, which has no sign, in rows next to standstill.
    """
    widths = {}
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


def selections(sides: Sequence[Side]) -> list[SideSelection]:
    """Return what the rows of each side support next to the columns of its fit."""
    proposed = [
        [
            replace(candidate, about=check)
            for check in COLUMN_CHECKS
            for joint in side.joints
            for candidate in check.candidates(side, joint)
        ]
        for side in sides
    ]
    asked = sum(map(len, proposed))
    return [_selected(*each, asked) for each in zip(sides, proposed, strict=True)]


def _selected(side: Side, candidates: Sequence[Candidate], asked: int) -> SideSelection:
    """Return what the rows of a side support, without candidates that turn out to be nothing."""
    while True:
        found = SideSelection(side, forward_selection(side.equation, candidates, asked, STRONG))
        nothing = found.unfounded
        if not nothing:
            return found
        candidates = [one for one in candidates if (one.about, one.joint) not in nothing]


def model_findings(
    selected: Sequence[SideSelection], known: Sequence[Finding] = ()
) -> list[Finding]:
    """Return what the equations of a fit lack: torques that are all late by as much are one.

    What is `known` already, such as a torque that is held over samples, is not repeated.
    """
    findings = [finding for one in selected for finding in one.findings]
    common = common_delay(selected)
    if common is not None:
        findings = [common, *(one for one in findings if one.code != DELAY.name)]
    codes = {finding.code for finding in known if finding.severity != "note"}
    if any(not finding.joint for finding in known if finding.severity != "note"):
        # a mistake about the whole robot, such as a tilt, looks like the zero of a joint
        findings = [
            replace(one, severity="note") if one.code == ENCODER_OFFSET.name else one
            for one in findings
        ]
    return [one for one in findings if one.code != DELAY.name or one.code not in codes]


_SURE_DELAY = 4.0
"""Multiple of the standard error, scatter between the joints included, of a common delay."""


def common_delay(selected: Sequence[SideSelection]) -> Finding | None:
    """Return the finding that all motor torques are late by as much, None without it.

    Delays of single joints that the rows hardly show add up: the weighted mean has the error of
    its parts, and their scatter (Birge 1932).
    """
    delays = {joint: found for one in selected for joint, found in one.delays().items()}
    if len(delays) < 2:
        return None
    values, errors = np.array(list(delays.values())).T
    weights = 1.0 / (errors**2 + LEAST_DELAY_S**2)
    common = float(np.average(values, weights=weights))
    spread = float(np.linalg.norm(weights * errors) / np.sum(weights))
    scatter = float(np.sqrt(np.average((values - common) ** 2, weights=weights) / len(values)))
    error = float(np.hypot(spread, scatter))
    if abs(common) < max(_SURE_DELAY * error, LEAST_DELAY_S):
        return None
    return late_torques(selected[0].side, list(delays), common, error, {})
