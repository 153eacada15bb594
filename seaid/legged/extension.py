"""What a floating base adds to `identify` and `validate`: checks, sensors, and contact forces.

The type of a robot whose base moves stands below what it adds to packages that know nothing of it,
and this module above that: with it all is registered for the type. A robot that was sent to another
process is restored here, so that it is registered there too.
"""

from __future__ import annotations

import copyreg
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import chain, compress
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, FrozenMapping
from seaid._files import toml_table
from seaid.checks import CODES, engine
from seaid.checks.codes import Remedy, is_wrong
from seaid.checks.columns import Side
from seaid.checks.engine import observed
from seaid.checks.gears import late_channels, late_columns, torque_channel
from seaid.checks.instants import MOST_STEPS
from seaid.checks.model import COLUMN_CHECKS, column_checks
from seaid.checks.predictions import unseen_motion
from seaid.checks.tolerances import FEW, LEAST_DELAY_S, POOR, RARE, SURE, TWICE
from seaid.errors import Finding, listed
from seaid.estimation import FittedRows
from seaid.excitation.stance import standing_robot
from seaid.identification import Fit, Identification, Validation
from seaid.identification.datasets import Dataset
from seaid.identification.result import Extension, extension_of
from seaid.identification.stacked_fits import SensorErrors
from seaid.identification.validation import Traces, compared, fit_of
from seaid.legged.base import (
    base_findings,
    guide_findings,
    missing_torques,
    sensor_bias,
    whole_body,
)
from seaid.legged.contacts import (
    FEET_CHECKS,
    ContactForces,
    contact_forces,
    legged_fit,
    smoothed_where,
)
from seaid.legged.feet import feet_findings
from seaid.legged.floating import FloatingRobot, base_of, floating, row_scale
from seaid.legged.load_side import FloatingBodies, FloatingLoadSide, late_base, thinned
from seaid.log import Log, Motion
from seaid.log.base_log import moving_base, needed_columns
from seaid.log.channels import ANGLE, CHANNELS
from seaid.log.description import as_toml, changed_source
from seaid.regressor import Identifiability, base_parameters
from seaid.regressor.base import BodyEquations, body_equations
from seaid.regressor.load import LoadModel, LoadSide, load_side
from seaid.regressor.structural_identifiability import of_stances
from seaid.robot import BASE_ROWS, FloatingBase, Robot

if TYPE_CHECKING:
    from seaid.excitation import Limits, Stance
    from seaid.excitation.limits import JointLimits
    from seaid.excitation.stance import StandingRobot


@dataclass(frozen=True, eq=False, repr=False)
class LeggedValidation(Validation):
    """Predicted torques of a log of a robot with a floating base, and the forces of the ground.

    Attributes
    ----------
    contacts : ContactForces or None
        The forces on each contact, predicted by `validate`; None without contacts in the log.
    base : Fit or None
        Force [N] and moment [N m] of the ground on the base, in its frame, as `BASE_ROWS`: by the
        measured wrenches, zero in flight, and by the model. NaN while a contact has an unknown
        force; None without an instant at which all are known.
    """

    contacts: ContactForces | None = None
    base: Fit | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `parameters.json`, null for a joint without such an equation."""
        numbers: dict[str, Any] = super().to_dict()
        if self.base is not None:
            numbers["base"] = self.base.to_dict(BASE_ROWS)
        return numbers if self.contacts is None else numbers | {"contacts": self.contacts.to_dict()}


class LeggedExtension(Extension):
    """The additions of robots with a floating base."""

    def log_findings(
        self, robot: Robot, logs: Sequence[Log], motions: Sequence[Sequence[Motion]]
    ) -> list[Finding]:
        """Return what contradicts itself in bases and contacts of logs, and their motions."""
        findings = base_findings(floating(robot), logs)
        if is_wrong(findings):
            return findings
        of_logs = list(chain(*motions))
        findings += guide_findings(of_logs)
        return findings + feet_findings(floating(robot), logs, of_logs)

    def torque_findings(
        self, robot: Robot, asked: Sequence[str], used: Collection[str]
    ) -> Iterator[Finding]:
        """Return the note on joints without torque, of which only the equations are missing."""
        return missing_torques(asked, used)

    def sensor_errors(
        self, robot: Robot, datasets: Sequence[Dataset], model: LoadModel, fit: FittedRows
    ) -> SensorErrors | None:
        """Return the errors of accelerometer and force sensors."""
        return sensor_bias(robot, datasets, model, fit)

    def fit_findings(
        self,
        result: Identification,
        datasets: Sequence[Dataset],
        fit: FittedRows,
        errors: SensorErrors | None,
    ) -> list[Finding]:
        """Return what the rows of a fit contradict in the feet."""
        legged = legged_fit(result, datasets, fit, errors)
        return [] if legged is None else observed(FEET_CHECKS, legged)

    def value_findings(self, declared: Robot, result: Identification) -> Iterator[Finding]:
        """Return what contradicts the total mass."""
        mass = whole_body(result)[0]
        return mass_findings(declared, result.motions, mass.value, mass.standard_error)

    def compared(self, comparison: Validation, rows: Sequence[Array]) -> LeggedValidation:
        """Return the comparison with the rows of the base, which are the first six."""
        values = {x.name: getattr(comparison, x.name) for x in fields(Validation)}
        base = _base_fit(comparison.motions, [row[:, :6] for row in rows])
        return LeggedValidation(**values, base=base)

    def validated(self, identification: Identification, comparison: Validation) -> Validation:
        """Return the comparison of an unseen log with the contact forces in it."""
        assert isinstance(comparison, LeggedValidation)
        contacts = contact_forces(identification, *comparison.motions)
        findings = [*comparison.warnings, *_contradictions(identification, comparison)]
        findings += [] if contacts is None else force_findings(contacts.to_dict()["feet"])
        return replace(comparison, warnings=tuple(findings), contacts=contacts)


def mass_findings(
    robot: Robot, motions: Sequence[Motion], mass_kg: float, error_kg: float
) -> Iterator[Finding]:
    """Yield a negative total mass, or one far from the nominal mass.

    `robot` has the bodies of its file. The mass is NaN where it is not determined.
    """
    nominal_kg = float(np.sum((robot.parameters + robot.payload_parameters)[::10]))
    sure_kg, ratio = SURE * error_kg, mass_kg / nominal_kg if nominal_kg > 0 else 1.0
    evidence = {"mass [kg]": mass_kg, "standard error [kg]": error_kg}
    evidence["robot file [kg]"] = nominal_kg
    if mass_kg < -sure_kg:
        lines = {"lines": _turned_forces(motions)}
        yield CODES["total-mass"].finding("negative", "", {**evidence, **lines})
    elif mass_kg > 0 and not 1 / TWICE < ratio < TWICE and abs(mass_kg - nominal_kg) > sure_kg:
        words = {"ratio": f"{ratio:.2g}"}
        yield CODES["total-mass"].finding("far", "", {**evidence, **words})


def _turned_forces(motions: Sequence[Motion]) -> str:
    """Return the lines that change the signs of measured forces, "" without any."""
    sensors = sorted({link for motion in motions for link in base_of(motion).wrenches})
    lines = [f"{toml_table('contacts', link)}\nforce = {{ ..., scale = -1 }}" for link in sensors]
    header = "; in the description of the log, and so for each moment:"
    return "\n".join([header, *lines]) if sensors else ""


def force_findings(feet: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """Yield feet whose predicted force is not that measured, or pulls at the ground.

    `feet` {link: numbers} are those of `ContactForces.to_dict`, None where they are not known.
    """
    for link, foot in feet.items():
        error, scale = foot["relative_error"], foot["scale"]
        if error is not None and error > RARE:
            evidence = {"error": error, "scale": scale, "link": link}
            yield CODES["contact-forces"].finding("differs", link, evidence)
        pulled = foot["pulled"]
        if pulled is not None and pulled > FEW:
            least_N, error_N = foot["least_normal"], foot["standard_error"]
            evidence = {"least normal force [N]": least_N, "standard error [N]": error_N}
            evidence |= {"share of the stance": pulled, "link": link}
            yield CODES["contact-forces"].finding("pulls", link, evidence)


def _base_fit(motions: Sequence[Motion], rows: Sequence[Array]) -> Fit | None:
    """Return the fit of the rows (T, 6, 2) of the base at instants without unknown forces."""
    parts = []
    for motion, forces in zip(motions, rows, strict=True):
        base = base_of(motion)
        # A contact with a flag has no measured wrench: its force is unknown while it touches.
        known = base.used & ~np.any([*base.contacts.values(), ~base.used], axis=0)
        still = np.zeros((len(known), 6), dtype=bool)
        raw = np.where(known[:, None, None], forces, np.nan)
        smooth = smoothed_where(motion, forces.swapaxes(1, 2), np.column_stack([known] * 2))
        # `smoothed_where` has NaN in transients, and where few samples under the filter count.
        parts.append(Traces(raw[:, :, 0], raw[:, :, 1], smooth[:, 0], smooth[:, 1], still))
    is_known = any(np.any(np.isfinite(part.smooth_measured[:, 0])) for part in parts)
    return fit_of(parts) if is_known else None


_LEAST_OF_WEIGHT = 0.05
"""Part of the weight, or of its moment at the lever of the contacts, that counts as the force on
the base where the ground acts less: in flight it does not act at all."""


def _contradictions(identification: Identification, result: LeggedValidation) -> Iterator[Finding]:
    """Yield that the force or moment on a floating base is not predicted, worse than in own logs.

    The error is that of the vector of the three forces, or moments, over its deviation from the
    mean.
    """
    if result.base is None:
        return
    robot = identification.robot
    weight = float(np.linalg.norm(robot.model.gravity.linear) * robot.parameters[::10].sum())
    lever = float(row_scale(robot, 6)[0, 0])
    own = (compared(identification, motion) for motion in identification.motions)
    fits = [comparison.base for comparison in own if isinstance(comparison, LeggedValidation)]
    for kind, rows, least in (("force", slice(3), weight), ("moment", slice(3, 6), weight * lever)):
        measured = result.base.measured[:, rows]
        # Without the mean, which is the weight: it would hide any error.
        size = float(np.linalg.norm(np.nanstd(measured, axis=0)))
        rms = float(np.linalg.norm(result.base.rms_error[rows]))
        error = rms / max(size, _LEAST_OF_WEIGHT * least)
        known = [float(np.linalg.norm(fit.rms_error[rows])) for fit in fits if fit is not None]
        # A guide may leave no equation of a moment: its residual is zero.
        ratio = rms / max(known) if any(known) else np.inf
        yield from unseen_motion(f"the {kind} on the base", "", error, float(ratio))


# What the rows of a fit contradict in the time of the base, and of all torques


def _late_base(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield what a late base adds to the load side, which is one equation of all joints."""
    if not side.is_motor and joint == side.joints[0]:
        yield engine.linear_candidate(joint, "late", "base", _slope_of_base(side))


def _late_torques(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield what torques that are all late add to the load side, -d tau' to first order."""
    is_whole = all(torque_channel(side, x) for x in side.joints)
    if is_whole and not side.is_motor and joint == side.joints[0]:
        slopes = [side.once(late_columns, x)[0] for x in side.joints]
        yield engine.linear_candidate(joint, "late", "torques", np.sum(slopes, axis=0))


def _slope_of_base(side: Side) -> Array:
    """Return the change (R, 1) of y per second at the delay of the base that explains most.

    By Gauss and Newton's steps, at the delay and with the bodies of the step before: those of the
    fit were fitted to the mistake, and a delay is no small step of a fast motion.
    """
    assert side.base is not None
    joints, motions = list(map(side.robot.index, side.joints)), list(map(thinned, side.motions))
    drive, units = side.drive(side.joints[0]), [np.ones((len(x.time), 1)) for x in motions]
    equation, delay_s = side.equation, 1.0 / motions[0].rate_hz
    for _ in range(MOST_STEPS):
        values = equation.values[: len(side.base.grouping)]
        bodies = side.base.least(values) + side.robot.known_parameters
        changes = [late_base(side.robot, x, joints, bodies, delay_s) for x in motions]
        column = replace(drive, motions=motions, factors=changes).at_rows(units) / delay_s
        late = engine.linear_candidate(side.joints[0], "late", "base", column)
        if not side.equation.is_promising(late):
            break
        equation = side.equation.with_alternatives(late.alternatives)
        (next_s,), (error_s,) = (x.tolist() for x in equation.last(1))
        # More than a period of the cutoff is no shift of this motion.
        if abs(next_s - delay_s) < POOR * error_s or not 0 < abs(next_s) < 1 / motions[0].cutoff_hz:
            break
        delay_s = next_s
    return column


def _are_late(
    side: Side, joint: str, accepted: Sequence[engine.Accepted], share: float
) -> Finding | None:
    """Return the finding of torques, or channels of the base, that are late or early as a whole."""
    (delay,), (error,) = accepted[0].coefficients.tolist(), accepted[0].errors.tolist()
    is_doubt = abs(delay) - SURE * error > LEAST_DELAY_S
    if accepted[0].trial.candidate.term == "torques":
        torques = {x: torque_channel(side, x) for x in side.joints}
        return late_channels(side, torques, (delay, error), share, is_doubt)
    sources = base_sources(moving_base(side.robot), side.records[0])
    earlier = partial(changed_source, delay_s=round(delay, 5))
    lines = [f"{name} = {as_toml(earlier(source))}" for name, source in sources.items()]
    words = {"channels": listed([name.replace("_", " ") for name in sources])}
    words["late"] = "late" if delay > 0 else "early"
    evidence = {"delay [s]": delay, "standard error [s]": error, "explained": share, **words}
    remedy = Remedy("in the description of the log:", {toml_table("base"): lines})
    return CODES["delay"].finding("base", "", evidence, remedy, is_doubt)


def base_sources(base: FloatingBase, log: Log) -> dict[str, Mapping[str, Any]]:
    """Return the sources of what the equations of a base have, as the description of a log."""
    own = {x: needed_columns(base, x) for x in CHANNELS if getattr(log.base, x) is not None}
    if base.normal is not None:  # the column of the angle is in place of the orientation
        own.pop("orientation", ())
        own["angle"] = (ANGLE,)
    described = (log.description or {}).get("base", own)
    sources = {x: y if isinstance(y, Mapping) else {"columns": y} for x, y in described.items()}
    # A pose is in the equations where the log has no specific force.
    for name in ("position", "velocity") if "specific_force" in own else ():
        sources.pop(name, {})
    return sources


LATE_CHECKS = (
    engine.ColumnCheck(CODES["delay"], (), _late_base, _are_late),
    engine.ColumnCheck(CODES["delay"], (), _late_torques, _are_late),
)
"""What is late in all rows of a fit, as the base or all torques."""


@moving_base.register(FloatingRobot)
def _(robot: FloatingRobot) -> FloatingBase:
    return robot.floating_base


@extension_of.register(FloatingRobot)
def _(robot: FloatingRobot) -> Extension:
    return LeggedExtension()


@column_checks.register(FloatingRobot)
def _(robot: FloatingRobot) -> tuple[engine.ColumnCheck[Side], ...]:
    return (*COLUMN_CHECKS, *LATE_CHECKS)


@body_equations.register(FloatingRobot)
def _(robot: FloatingRobot) -> BodyEquations:
    return FloatingBodies(robot)


@load_side.register(FloatingRobot)
def _(robot: FloatingRobot) -> LoadSide:
    return FloatingLoadSide(robot)


@of_stances.register(FloatingRobot)
def _(robot: FloatingRobot, stances: Sequence[Sequence[str]], seed: int) -> Identifiability:
    body_equations(robot).check_stances(stances)
    base = base_parameters(robot, stances=stances, seed=seed)
    again = base_parameters(robot, stances=stances, seed=seed + len(stances))
    alone = np.count_nonzero(base.grouping, axis=1) == 1
    missing = ~np.any(base.grouping, axis=0) & ~robot.is_known
    return Identifiability(
        robot_name=robot.name,
        names=robot.parameter_names,
        identifiable=tuple(compress(base.names, alone)),
        combinations=tuple(compress(base.expressions, ~alone)),
        ratios=(),
        unidentifiable=tuple(compress(robot.parameter_names, missing)),
        base=base,
        rank=len(base.columns),
        usable=FrozenMapping({}),
        sensors=FrozenMapping({}),
        gap=base.gap,
        agree=again.columns == base.columns,
    )


@standing_robot.register(FloatingRobot)
def _(
    robot: FloatingRobot,
    stance: Stance,
    bounds: JointLimits,
    limits: Limits | None,
    torque_joints: str | Sequence[str] | None,
) -> StandingRobot:
    from seaid.legged.stance import stance_model

    return stance_model(robot, stance, bounds, limits, torque_joints)


def floating_robot(values: Mapping[str, Any]) -> FloatingRobot:
    """Return the robot with these fields, of the type for which all is registered here."""
    return FloatingRobot(**values)


def _pickled(robot: FloatingRobot) -> tuple[Callable[..., FloatingRobot], tuple[dict[str, Any]]]:
    return floating_robot, ({field.name: getattr(robot, field.name) for field in fields(robot)},)


copyreg.pickle(FloatingRobot, _pickled)
