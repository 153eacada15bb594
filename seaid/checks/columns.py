"""An equation of the fit, the columns that a drive may lack in it, and what they mean.

A `Side` is an equation of the fit. A `ColumnCheck` proposes candidates for it, columns next to
those of the fit, and words what was accepted of them. Here are the checks of a drive: terms of
friction and springs that it lacks, springs parallel to a joint, gains in another unit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
import scipy

from seaid._arrays import Array, FrozenMapping, IndexArray
from seaid.checks import engine
from seaid.checks import tolerances as tol
from seaid.checks.codes import CODES, EXPLAINED, in_drives, only_joint
from seaid.checks.engine import Acceptance, Check, ColumnCheck, Need
from seaid.checks.terms import (
    DriveRows,
    actuator_drive,
    load_drive,
    possible_terms,
    reference_position,
    term_candidates,
    toml_of,
    with_term,
)
from seaid.drives import IDEAL_DRIVE, PARAMETERS, PARAMETERS_OF, Drive, is_dry, unit_of
from seaid.drives.drives import DefaultTerms
from seaid.drives.terms import BY_TEMPERATURE, LEVEL_OF, MOTOR_CONSTANTS
from seaid.errors import Finding, listed
from seaid.estimation import FittedRows
from seaid.log import Log, Motion
from seaid.log.description import Entries, sources_of
from seaid.log.rows import in_band_at
from seaid.regressor import BaseParameters
from seaid.regressor.base import regressor_at_drives, torque_slopes
from seaid.regressor.load import load_side, where_known
from seaid.robot import Robot
from seaid.robot.transmission import rows_at_drives

SideNeed = Need["Side", str]

FACTORS = ("gain_scale", "motor_inertia", "known_mass")
"""Candidates whose coefficient is the relative change of a given value."""

SCALES = {*MOTOR_CONSTANTS.values(), "gain_scale"}
"""Parameters that turn what is logged of a motor into its torque."""


@dataclass(frozen=True, eq=False)
class Side:
    """An equation of the fit: (7) of an elastic joint, or the load side (8).

    `joints` are those whose drives are in its rows, `widths` {joint: width of Coulomb friction}
    those that the encoders resolve, `gears` the joints whose gear was measured, `base` the
    base parameters of the load side, `offset_std` [rad] the standard deviation of the joints'
    zeros that the errors of the estimate contain. `notes` are on checks of all equations that could
    not be made; `logs` are the numbers, from 1, of the logs of the motions; `actuators`
    {joint: fit} those of all motor equations; `records` are the logs in memory.
    """

    robot: Robot
    motions: Sequence[Motion]
    fitted: FittedRows
    joints: tuple[str, ...]
    is_motor: bool
    widths: Mapping[str, float]
    gears: frozenset[str] = frozenset()
    notes: tuple[Finding, ...] = ()
    base: BaseParameters | None = None
    offset_std: float = 0.0
    logs: tuple[int, ...] = ()
    actuators: Mapping[str, FittedRows] = FrozenMapping({})
    records: Sequence[Log] = ()

    @property
    def is_checked(self) -> bool:
        """Whether the rows are in memory, and all that a robust estimator has."""
        fitted = self.fitted
        return fitted.rows is not None and (fitted.settled is not None or fitted.equal)

    def motor_values(self, joint: str) -> dict[str, tuple[float, float]]:
        """Return {parameter: value and standard error} of the motor equation of a joint."""
        estimate = self.actuators[joint].estimate
        pairs = zip(estimate.values.tolist(), estimate.standard_errors.tolist(), strict=True)
        return dict(zip(estimate.names, pairs, strict=True))

    def has_spring(self, joint: str) -> bool:
        """Whether a joint has a motor equation, whose spring has no play on its load side.

        With play the motor has less dry friction than none, and the load more.
        """
        if joint not in self.actuators:
            return False
        friction, error = self.motor_values(joint).get("coulomb_friction", (0.0, 0.0))
        return self.is_motor or friction >= -tol.SURE * error

    def has_gains(self, joint: str) -> bool:
        """Whether the torque of a joint is that of a controller whose gains are given."""
        drive = self.robot.drives[joint]
        return drive.controller is not None and not drive.is_up_to_scale

    def has_both_encoders(self, joint: str) -> bool:
        """Whether the positions of a joint and of its motor were logged."""
        return {"motor_position", "joint_position"} <= self.sources.get(joint, {}).keys()

    def has_known_rotor(self, joint: str) -> bool:
        """Whether the rotor inertia of a joint is given, and its rows are those of its motor."""
        inertia = self.robot.drives[joint].values.get("motor_inertia", 0.0)
        return inertia > 0 and self.drive(joint).is_of_motor

    @cached_property
    def equation(self) -> engine.Equation:
        """The rows of the fit with the weights of its equations."""
        return engine.equation_of(self.fitted)

    def unexplained(self, joint: str) -> float:
        """Return the error of the equation of a joint over its torque without the mean."""
        rows = self.equation.rows.joint == self.robot.index(joint)
        # All rows of a joint have one weight, which cancels in the ratio.
        y = self.equation.weight[rows] * self.equation.rows.y[rows]
        whole = max(float(np.var(y)) * len(y), tol.LEAST)
        return float(np.sqrt(self.equation.squares(rows) / whole))

    def next_to(self, accepted: engine.Accepted) -> dict[str, tuple[float, float]]:
        """Return {parameter of the fit: value and standard error} next to accepted columns."""
        larger = self.equation.with_alternatives([accepted.trial.alternative])
        values, errors = larger.last(larger.rows.H.shape[1])
        pairs = zip(values.tolist(), errors.tolist(), strict=True)
        return dict(zip(self.equation.rows.names, pairs, strict=False))  # the columns are the last

    def keeps_scale(self, accepted: Acceptance) -> bool:
        """Whether constants stay positive next to what was accepted: unknown and given ones.

        What carries the bodies in place of a motor explains every torque: its constant is zero.
        """
        if any(x.trial.candidate.field in FACTORS and x.coefficients[0] <= -1 for x in accepted):
            return False
        places = [k for k, x in enumerate(self.equation.rows.names) if x.quantity in SCALES]
        if not places:
            return True
        larger = self.equation.with_alternatives(x.trial.alternative for x in accepted)
        values, errors = larger.last_of_blocks(larger.rows.H.shape[1])
        return bool(np.all(values[places] > tol.SURE * errors[places]))

    def changed_by(self, accepted: Acceptance) -> dict[str, Array]:
        """Return the changes (p,) of the parameters in standard errors and in per cent."""
        estimate, change = self.fitted.estimate, sum(x.change for x in accepted)
        sizes = {"standard errors": estimate.standard_errors, "%": np.abs(estimate.values) / 100}
        return {x: np.abs(change) / np.maximum(y, np.finfo(float).tiny) for x, y in sizes.items()}

    def swing(self, joint: str) -> float:
        """Return the range of a joint [rad or m], in the motion where it is largest."""
        index = self.robot.index(joint)
        return max(float(np.ptp(motion.joint_position[:, index])) for motion in self.motions)

    @property
    def sources(self) -> Entries:
        """Columns, or entries in the description of the first log: {joint: {quantity: source}}."""
        return sources_of(self.motions)

    @cached_property
    def once(self) -> Callable[..., Any]:
        """What a function of this side and a joint returns, computed once."""
        return cache(lambda function, joint, **options: function(self, joint, **options))

    def drive(self, joint: str, *, at_joint: bool = False) -> DriveRows:
        """Return the drive of a joint at the rows, or what of it acts `at_joint` on the load."""
        drive: DriveRows = self.once(Side._drive, joint, at_joint=at_joint and not self.is_motor)
        return drive

    def _drive(self, joint: str, *, at_joint: bool) -> DriveRows:
        fit = self.robot, self.motions, joint, self.equation.rows, self.fitted.estimate.values
        if self.is_motor:
            return actuator_drive(*fit)
        return load_drive(*fit, self.parts, at_joint=at_joint)

    @cached_property
    def parts(self) -> list[Callable[[Array], dict[int, Array]]]:
        """The functions `LoadSide.parts` of the motions."""
        equations = self.equation.rows.joint
        return [load_side(self.robot).parts(motion, equations) for motion in self.motions]

    @cached_property
    def bodies(self) -> Array:
        """Standard parameters (10N,) of the fitted bodies, the known ones included.

        Those that the rows do not show are such that no body without a mass has a centre.
        """
        assert self.base is not None
        usual = 1.0 * (~self.robot.is_known & (np.arange(self.robot.is_known.size) % 10 == 0))
        fitted = self.equation.values[: len(self.base.grouping)] - self.base.project(usual)
        return np.asarray(usual + self.base.least(fitted) + self.robot.known_parameters)

    @property
    def torque_of_known(self) -> Array:
        """The torque (R, 1) of the known bodies and the payloads at the rows."""
        return np.asarray(np.sum(self.torques_of_known, axis=1, keepdims=True))

    @cached_property
    def torques_of_known(self) -> Array:
        """The torques (R, K + 1) at the rows of the K known bodies, and of the payloads."""
        robot, payload = self.robot, self.robot.payload_parameters
        if not robot.known_bodies and self.base is not None:  # payloads: by the base columns
            own = self.base.project(payload)
            return self.equation.rows.H[:, : len(own)] @ own[:, None]
        # (10N, N) each body alone in its column
        each = scipy.linalg.block_diag(*robot.parameters.reshape(-1, 10)).T
        parts = np.column_stack([each[:, np.isin(robot.body_names, robot.known_bodies)], payload])
        return self.filtered(lambda *states: regressor_at_drives(robot, *states) @ parts)

    def _at_rows(self, of_motion: Callable[[Motion, Array, IndexArray], Array]) -> Array:
        """Return at the rows (R, k) what a function has at samples of a motion (samples, n, k).

        Its other argument is where friction in the equations (8) is known (T, n).
        """
        rows, columns, every = self.equation.rows, np.empty(0), np.ones(self.robot.n)
        for run, (motion, factors) in enumerate(zip(self.motions, self.parts, strict=True)):
            places = np.flatnonzero(rows.run == run)
            times, instants = np.unique(rows.time[places], return_inverse=True)
            known = np.column_stack([*factors(every).values()])
            values = of_motion(motion, known, np.searchsorted(motion.time, times))
            columns = columns if run else np.zeros((len(rows.y), values.shape[2]))
            # (instants, n, k) -> (R, k): of each row its instant and its joint.
            columns[places] = values[instants, rows.joint[places].astype(int)]
        return columns

    @cached_property
    def slopes(self) -> Array:
        """The derivatives (R, n) of the torque of the fitted bodies by the angle of each joint.

        They are those at the states of the rows, which are below the cutoff.
        """
        robot, payloads = self.robot, self.robot.payload_parameters
        robot = robot.with_values(self.bodies - payloads, robot.drives)

        def at_samples(motion: Motion, known: Array, samples: IndexArray) -> Array:
            states = (in_band_at(motion, state, samples) for state in motion.joint_states)
            by_angle = rows_at_drives(robot.transmission, torque_slopes(robot, *states)[0])
            return where_known(in_band_at(motion, known, samples), by_angle)

        return self._at_rows(at_samples)

    def filtered(self, columns_of: Callable[[Array, Array, Array], Array]) -> Array:
        """Return columns (R, k) of torques of bodies, which are filtered as the rows are.

        `columns_of` joint states at T samples are (T, n, k). The torque of filtered states differs
        from the filtered torque by more than the error of an angle.
        """

        def at_samples(motion: Motion, known: Array, samples: IndexArray) -> Array:
            starts = range(0, len(motion.time), _AT_ONCE)
            parts = [[x[start : start + _AT_ONCE] for x in motion.joint_states] for start in starts]
            columns = np.concatenate([columns_of(*states) for states in parts])
            return in_band_at(motion, where_known(known, columns), samples)

        return self._at_rows(at_samples)


_AT_ONCE = 4000
"""Samples of a regressor at once, which is too large for a long log."""


_PLAIN = ("viscous", "coulomb")
_FRICTION = (*_PLAIN, "smooth_coulomb", "asymmetric", "quadratic", "load", "stribeck")
_LAWS = ("cubic", "fifth", "dead_zone", "dahl", "damping")


def _terms(side: Side, joint: str, field: str, terms: Sequence[str]) -> list[engine.Candidate]:
    """Return the terms of a field that a drive lacks and can have, as candidates."""
    possible = list(possible_terms(side.robot.drives[joint], {field: terms}))
    if not possible:  # the rows of the drive are not needed
        return []
    width = side.widths.get(joint)
    # Widths of Coulomb friction from the one that the encoders resolve to 32 times as much.
    grids = {} if width is None else {"coulomb_width": [width * 2.0**k for k in range(6)]}
    drive = side.drive(joint, at_joint=field in ("parallel_spring", "joint_friction"))
    return term_candidates(drive, possible, grids)


def _friction(side: Side, joint: str) -> list[engine.Candidate]:
    """Return the friction that a drive lacks; that of elastic drives is in their motor equation."""
    drive = side.robot.drives[joint]
    if drive.is_elastic and not side.is_motor:
        return []
    if drive == IDEAL_DRIVE:  # it has no friction at all
        return _terms(side, joint, "friction", (*_PLAIN, "offset"))
    terms = [*_FRICTION, *["offset"] * (not drive.is_elastic)]
    if drive.controller is not None and not drive.is_elastic:
        # the closed loop of a drive with a controller shows errors over its position
        terms.append("coulomb_position")
    warmth = np.concatenate([by_name["Delta_T"] for by_name in side.drive(joint).signals])
    # a temperature that is not logged is NaN
    terms += BY_TEMPERATURE if np.ptp(warmth) >= tol.LEAST_RANGE_K else ()
    return _terms(side, joint, "friction", terms)


# what holds a locked output, and yields, is no spring parallel to the joint
_parallel_springs = partial(_terms, field="parallel_spring", terms=("linear",))
# the motor equation does not have the friction behind the spring of a joint
_joint_friction = partial(_terms, field="joint_friction", terms=_PLAIN)
_spring_laws = partial(_terms, field="spring", terms=_LAWS)


def _gain_scales(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield the torque of the known bodies at a joint whose gains may be in another unit.

    With y = tau - tau_known and gains that are 1 / s of their unit, tau = (tau_known + ...) / s: y
    has (1 / s - 1) tau_known more.
    """
    yield engine.linear_candidate(joint, "gain_scale", "", _known_torque(side, joint))


def _known_torque(side: Side, joint: str) -> Array:
    """Return the torque (R, 1) of the known bodies at the rows of a joint."""
    rows = side.equation.rows.joint == side.robot.index(joint)
    return np.asarray(rows[:, None] * side.torque_of_known)


def _is_impossible(side: Side, found: engine.Accepted) -> bool:
    """Whether a linear parameter of a term that cannot be negative is: damping or hysteresis.

    A torque that is late by d has the slope of the spring's torque with -d, which is a damping of
    -k d: something else looks like the term. So does a late encoder of the joint, see `gears`.
    """
    candidate = found.trial.candidate
    of_term = PARAMETERS_OF[candidate.field][candidate.term]
    positive = {x for x in of_term if PARAMETERS[x].is_positive or x in LEVEL_OF.values()}
    # A law that replaces columns has the coefficients of these too, which are not of the term.
    values = zip(found.trial.alternative.names, found.coefficients.tolist(), strict=True)
    if (candidate.field, candidate.term) == ("spring", "damping"):
        viscous, error = side.next_to(found).get("viscous_friction", (0.0, 0.0))
        if viscous < -tol.SURE * error:
            return True
    return any(name in positive and value < 0 for name, value in values)


def _missing_terms(side: Side, joint: str, accepted: Acceptance, share: float) -> Finding | None:
    """Return the finding of terms that a drive lacks, with the field of the drive that has them.

    Next to other weights the residual may be as large as before, or larger: these explain nothing.
    """
    if share < tol.FEW or any(_is_impossible(side, x) for x in accepted):
        return None
    drive, trials = side.robot.drives[joint], [x.trial for x in accepted]
    field, comparison = trials[0].candidate.field, trials[0].comparison
    terms, is_spring = [trial.candidate.term for trial in trials], field == "spring"
    words = {"terms": " and ".join(f"'{term}'" for term in terms), "field": field}
    words["equation"] = "motor" if side.is_motor else "torque"
    if field == "parallel_spring" and drive.is_elastic:
        terms.append("preload")  # it rests at any angle, which the spring in series would hide
    values = {name: value for trial in trials for name, value in trial.alternative.values.items()}
    evidence = {**comparison.evidence, **values, EXPLAINED: share}
    matters = is_spring or _matters(side, joint, trials, share)
    code, case = ("nonlinear-spring", "law") if is_spring else ("missing-term", "lacks")
    remedy = _lines_of_terms(side, joint, field, terms, values)
    return CODES[code].finding(case, joint, {**evidence, **words}, remedy, matters)


def _lines_of_terms(
    side: Side, joint: str, field: str, terms: Sequence[str], values: Mapping[str, float]
) -> str:
    """Return the remedy that adds terms to a drive, with the starts of what is searched."""
    drive = side.robot.drives[joint]
    lines = toml_of(drive, field, terms, values)
    if "coulomb_position" in terms and not drive.reference_position_rad:
        middle = reference_position(side.motions, side.robot.index(joint))
        lines += f"\nreference_position_rad = {middle:g}"
    return in_drives({(joint,): lines})


def _matters(side: Side, joint: str, trials: Sequence[engine.Trial], share: float) -> bool:
    """Whether terms that a drive lacks matter, and are no effect of the sampling or of gravity."""
    if share <= tol.MATTERS or _is_sampled(side, joint, trials):
        return False
    if trials[0].candidate.field != "parallel_spring":
        return True
    # it resembles gravity, which other mistakes change too: it is the cause of a torque that is not
    # explained if that is explained with it, or if nearly nothing is left with bodies of any mass
    before = side.unexplained(joint)
    # A share is one of squares, an unexplained part one of rms values.
    after = before * float(np.sqrt(max(1 - share, 0.0)))
    is_exact = 1 - share < tol.POOR and not side.robot.known_bodies
    return (is_exact or before > tol.MOST) and after < tol.MOST


def _is_sampled(side: Side, joint: str, trials: Sequence[engine.Trial]) -> bool:
    """Whether a term is the effect of an encoder step, a sample, or a coarse grid of widths."""
    drive = side.robot.drives[joint]
    # the width of a term that was added by itself is one of a coarse grid
    if isinstance(drive.friction, DefaultTerms) and "coulomb_width" in drive.known:
        return True
    # Next to dry friction a width of up to twice that which the logs resolve is that of an encoder
    # step or of a sample.
    width = trials[0].alternative.values.get("coulomb_width", np.inf)
    return is_dry(drive) and len(trials) == 1 and width <= tol.TWICE * side.widths.get(joint, 0.0)


def _gain_is_scaled(side: Side, joint: str, accepted: Acceptance, share: float) -> Finding | None:
    """Return the finding of gains in another unit, or of bodies that are heavier or lighter."""
    evidence = _factor(accepted[0], share)
    if others := _contradicting(side, joint):
        return CODES["gain-scale"].finding("differs", joint, {**evidence, "others": listed(others)})
    before = "weigh a link: if the known bodies are right, the scale of the gains is a parameter, "
    lines = in_drives({(joint, "controller"): "is_up_to_scale = true"}, before)
    return CODES["gain-scale"].finding("alone", joint, evidence, lines)


def _unknown_scales(robot: Robot, joints: Sequence[str]) -> Iterator[Finding]:
    """Yield the finding of `joints` whose gains have a scale that nothing determines."""
    words = {"scales": listed(f"{x} {robot.drives[x].scale_of_gains:.4g}" for x in joints)}
    before = "known bodies (known_bodies=), logs with and without a payload (identify_conditions), "
    lines = 'gain_scale = 1.0  # write yours\nknown = ["gain_scale"]'
    remedy = in_drives({(joints[0],): lines}, f"{before}or ")
    yield CODES["gain-scale"].finding("unknown", only_joint(joints), words, remedy)


_UNSCALED = Need[Robot, Sequence[str]]("gains in units of the drive", lambda _, x: bool(x))
unknown_scales = Check(CODES["gain-scale"], (_UNSCALED,), _unknown_scales)
"""What is looked for in joints whose gains have no scale."""


def _known_rotors(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield the acceleration of a motor behind a spring, whose rotor inertia is known.

    With y = tau_M - I_M theta_M'' and a torque that is s times too large, y has (s - 1) I_M
    theta_M'' more: next to a spring of any stiffness the rotor is the scale of the torque.
    """
    inertia = side.robot.drives[joint].values["motor_inertia"]
    torque = inertia * side.drive(joint).signal("theta_M_ddot")
    yield engine.linear_candidate(joint, "motor_inertia", "", torque)


def _rotor_is_other(side: Side, joint: str, accepted: Acceptance, share: float) -> Finding | None:
    """Return the finding of a known rotor inertia that the motor equation contradicts."""
    evidence, scale = _factor(accepted[0], share), CODES["torque-scale"]
    times = evidence["factor"]
    off = f"{max(times, 1 / times):.3g} times too {'large' if times > 1 else 'small'}"
    words = {"off": off, "implied": scale.implies}
    remedy = f"{scale.measurement}: if the torque is right, remove motor_inertia_kg_m2 of the "
    remedy += "drive to have it identified"
    matters = share > tol.MATTERS and bool(abs(np.log(times)) > 2 * tol.POOR)
    return CODES["rotor-inertia"].finding("motion", joint, {**evidence, **words}, remedy, matters)


def _factor(accepted: engine.Accepted, share: float) -> dict[str, float]:
    """Return the evidence of one of the `FACTORS`: its value, and its standard error."""
    (change,), (error,) = accepted.coefficients.tolist(), accepted.errors.tolist()
    return {"factor": 1.0 + change, "standard error": error, EXPLAINED: share}


def _contradicting(side: Side, joint: str) -> list[str]:
    """Return the joints with the controller of a joint, whose torques have another factor.

    Gains of one controller have one unit: the factors of all joints are estimated at once.
    """
    law = side.robot.drives[joint].controller
    alike = [x for x in side.joints if side.robot.drives[x].controller == law and x != joint]
    columns = np.hstack([_known_torque(side, x) for x in (*alike, joint)])
    equation = side.equation.with_alternatives([engine.Alternative(columns, columns.shape[1])])
    factors, errors = equation.last(columns.shape[1])
    apart = np.abs(factors - factors[-1]) > tol.SURE * np.hypot(errors, errors[-1])
    return [name for name, is_apart in zip(alike, apart, strict=False) if is_apart]


def known_bodies(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield the torque of each known body of a joint, of which y has a part if it is heavier.

    A centre that is off looks like the zero of the joint, see `gears.zeros`, or like a mass.
    """
    robot, known = side.robot, [x for x in side.robot.body_names if x in side.robot.known_bodies]
    for link, torque in zip(known, side.torques_of_known.T, strict=False):
        if robot.joint_of(robot.body_names.index(link)) == joint:
            yield engine.linear_candidate(joint, "known_mass", link, torque[:, None])


def bodies_differ(side: Side, joint: str, accepted: Acceptance, share: float) -> Finding | None:
    """Return the finding of known bodies that are heavier or lighter than given."""
    factors = {x.trial.candidate.term: _factor(x, share) for x in accepted}
    # Known bodies are wrong by a tenth of what others are (`Experiment.widths`).
    least = tol.POOR * tol.BODY
    if all(abs(x["factor"] - 1) < least + tol.SURE * x["standard error"] for x in factors.values()):
        return None
    text = "{link} is {factor:.3g} +- {standard error:.2g} times"
    texts = [text.format_map({"link": link, **x}) for link, x in factors.items()]
    of_bodies = "known", joint, {**_factor(accepted[0], share), "bodies": listed(texts)}
    return CODES["nominal-values"].finding(*of_bodies, is_worse=share > tol.MATTERS)


MOTOR_SIDE = SideNeed("the motor equation of a spring", lambda side, _: side.is_motor)
LOAD_SIDE = SideNeed("the load side", lambda side, _: not side.is_motor)
SPRING = SideNeed("a spring without play", lambda side, joint: side.has_spring(joint))
MOTION = SideNeed("a joint that moves", lambda side, joint: side.swing(joint) >= tol.LEAST_SWING)
HELD_BASE = SideNeed("a base that is held", lambda side, _: side.robot.base_is_held)
_KNOWN = SideNeed("known bodies or payloads", lambda x, _: bool(any(x.robot.known_parameters)))
_GAINS = SideNeed("a controller with its gains", lambda side, joint: side.has_gains(joint))
_OF_GAINS = (LOAD_SIDE, _GAINS, _KNOWN, HELD_BASE)
_KNOWN_ROTOR = SideNeed("a known rotor inertia", lambda side, joint: side.has_known_rotor(joint))

DRIVE_CHECKS = (
    ColumnCheck(CODES["missing-term"], (), _friction, _missing_terms),
    ColumnCheck(CODES["missing-term"], (LOAD_SIDE, MOTION), _parallel_springs, _missing_terms),
    ColumnCheck(CODES["missing-term"], (LOAD_SIDE, SPRING), _joint_friction, _missing_terms),
    ColumnCheck(CODES["gain-scale"], _OF_GAINS, _gain_scales, _gain_is_scaled),
    ColumnCheck(CODES["nonlinear-spring"], (MOTOR_SIDE,), _spring_laws, _missing_terms),
    ColumnCheck(CODES["rotor-inertia"], (MOTOR_SIDE, _KNOWN_ROTOR), _known_rotors, _rotor_is_other),
)
"""The checks of a drive, in the order in which their findings are listed."""


def included_term(trial: engine.Trial) -> Finding:
    """Return the note that a term was added to a drive whose friction nobody named."""
    candidate, comparison, values = trial.candidate, trial.comparison, trial.alternative.values
    width = "".join(f" over {value:.2g} rad/s" for value in values.values())
    evidence = {**comparison.evidence, **values, "term": candidate.term, "width": width}
    return CODES["missing-term"].note("included", candidate.joint, evidence)


def backlash(
    joint: str, drive: Drive, comparison: engine.ModelComparison, values: Mapping[str, float]
) -> Finding:
    """Return the finding of backlash that looks like a weak spring, by a comparison of laws."""
    unit = unit_of(with_term(drive, "spring", "dead_zone"), "dead_zone")
    lines = in_drives({(joint,): toml_of(drive, "spring", ["dead_zone"], values)})
    evidence = {**comparison.evidence, **values, "unit": unit}
    return CODES["backlash"].finding("looks", joint, evidence, lines)
