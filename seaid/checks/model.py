"""What the equations of a fit lack: selected among the columns of all checks, and named.

`selections` selects among the candidates of drives, gears and sensors, equation by equation, and
each check words what was accepted of its own; candidates of other checks that explain as much are
named as rivals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, singledispatch
from itertools import chain, compress, product
from typing import Any

import numpy as np

from seaid._arrays import Array, BoolArray
from seaid._files import toml_text
from seaid.checks import codes, columns, engine, gears
from seaid.checks.codes import CODES, EXPLAINED, Cause, joints_of, notes_beside, undecided
from seaid.checks.columns import DRIVE_CHECKS, Side, SideNeed
from seaid.checks.engine import ColumnCheck, guarded, proposals
from seaid.checks.gears import common_delay, torque_delays
from seaid.checks.terms import with_term
from seaid.checks.tolerances import LEAST, MATTERS, SIGNIFICANT, STRONG, SURE, TWICE
from seaid.checks.values import drive_findings, noise_findings, sure_offsets
from seaid.drives import PARAMETERS_OF, ParameterName, readable
from seaid.drives.drives import term_fields
from seaid.errors import Finding, SeaidError, by_severity, listed
from seaid.estimation import FittedRows, estimator_named, fit
from seaid.estimation.qr_factor import first_term
from seaid.robot import Robot


def _other_set_ups(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield the columns of each log alone, whose parameters are those of another set-up.

    The load side is one equation of all joints. Of two logs one is enough.
    """
    numbers = [*dict.fromkeys(side.logs)] if joint == side.joints[0] else []
    for number in numbers[1:] if len(numbers) <= 2 else numbers:
        yield engine.Candidate(joint, "log", str(number), (_of_log(side, number),))


def _of_log(side: Side, number: int) -> engine.Alternative:
    """Return the columns of the fit at the rows of a log."""
    rows = side.equation.rows
    is_own = np.array(side.logs)[rows.run.astype(int)] == number
    return engine.Alternative(rows.H, rows.H.shape[1], own=is_own)


def _is_another_set_up(
    side: Side, joint: str, accepted: engine.Acceptance, share: float
) -> Finding | None:
    """Return the finding of logs of another set-up, or of another temperature, if it is either.

    Friction and zeros may differ first: another set-up is what explains the rest.
    """
    numbers, names = [x.trial.candidate.term for x in accepted], side.equation.rows.names
    # Bodies and springs make a set-up; friction changes with the temperature, and zeros do so with
    # a start.
    is_fixed = np.array([x == "stiffness" or not (side.is_motor or x.owner) for x in names])
    own = np.hstack([x.trial.alternative.columns[:, is_fixed] for x in accepted])
    further = [*dict.fromkeys(side.logs)][1:]
    of_each = np.hstack([_of_log(side, x).columns[:, ~is_fixed] for x in further])
    with_friction = side.equation.with_alternatives([engine.Alternative(of_each, 0)])
    explained, scores, _ = _explained_by(with_friction, own, is_fixed)
    case, remedy = "set-up", None
    if not scores:
        case, (explained, scores, remedy) = "friction", _in_friction(side, of_each, ~is_fixed)
    evidence = {EXPLAINED: explained, "logs": " and log ".join(numbers)}
    return _of_scores(side, joint, case, scores, evidence, remedy)


def _of_scores(
    side: Side, joint: str, case: str, scores: Scores, evidence: dict[str, Any], remedy: str | None
) -> Finding | None:
    """Return the finding of logs that differ, with the values that do so most, if any do."""
    if not scores:
        return None
    # a column of a motor equation has no owner
    worst, named = sorted(scores, key=scores.__getitem__)[:-4:-1], joint * side.is_motor
    evidence["standard errors"] = scores[worst[0]]
    evidence["differing"] = listed(first_term(readable(x.at(x.owner or named))) for x in worst)
    evidence["sizes"] = listed(f"{scores[x]:.0f}" for x in worst)
    evidence["equation"] = f"motor equation of {joint}" if side.is_motor else "torque equations"
    return CODES["logs-differ"].finding(case, named, evidence, remedy)


def _in_friction(side: Side, of_each: Array, is_free: BoolArray) -> tuple[float, Scores, str]:
    """Return what friction explains that each log has for itself, its scores, and the remedy.

    There are no scores if it is not friction that differs.
    """
    explained, *values = _explained_by(side.equation, of_each, is_free)
    scores, lowest = ({x: y for x, y in z.items() if x.quantity in _FRICTION} for z in values)
    # Friction that takes up errors of the model is negative in some logs: that is no temperature.
    is_other = min(lowest.values(), default=0.0) < -SURE
    specific = sorted({"spring_offset", *(x.quantity for x in scores)})
    names = ", ".join(map(toml_text, specific))
    remedy = f"give each log a condition of its own, with condition_specific = [{names}]"
    return explained, {} if is_other else scores, remedy


Scores = Mapping[ParameterName, float]
"""{parameter: value over its standard error}."""


def _explained_by(
    equation: engine.Equation, columns: Array, kept: BoolArray
) -> tuple[float, Scores, Scores]:
    """Return the part of the squared residual that columns explain, and {name: largest score}.

    The columns (R, k p) are those of the p `kept` parameters, of one log after the other. A score
    is a value over its standard error, of which the significant ones count, none if little is
    explained. Last comes the lowest value that a log has of each parameter, over the same error.
    """
    larger = equation.with_alternatives([engine.Alternative(columns, 0)])
    values, errors = larger.last(columns.shape[1])
    shape, errors = (-1, np.count_nonzero(kept)), np.maximum(errors, np.finfo(float).tiny)
    scores, first = (values / errors).reshape(shape), larger.values[: len(kept)][kept]
    largest = np.max(np.abs(scores), axis=0).tolist()
    lowest = np.min(scores + first / errors.reshape(shape), axis=0).tolist()
    names = list(compress(equation.rows.names, kept))
    explained = 1 - larger.squares() / max(equation.squares(), LEAST)
    least = SIGNIFICANT if explained >= MATTERS else np.inf
    significant = {x: y for x, y in zip(names, largest, strict=True) if y > least}
    return explained, significant, dict(zip(names, lowest, strict=True))


_FRICTION = {*chain(*PARAMETERS_OF["friction"].values(), *PARAMETERS_OF["joint_friction"].values())}
"""Parameters that change with the temperature."""


_TORQUE = SideNeed("a torque that was logged", lambda *of: bool(gears.torque_channel(*of)))
# what is beyond the supply is no voltage of a motor
_COMMAND = SideNeed(
    "a torque or a current",
    lambda *of: gears.torque_channel(*of) in {"motor_torque", "motor_current"},
)
_BOTH_ENCODERS = SideNeed("encoders on both sides", lambda side, x: side.has_both_encoders(x))
_TURNS = SideNeed("a joint that turns", lambda x, j: not x.robot.is_prismatic[x.robot.index(j)])
# an offset moves the commands as well: `commands` looks at it
_NO_CONTROLLERS = SideNeed("no controllers", lambda side, _: not side.robot.has_controllers)
_BODIES = SideNeed("bodies that are fitted", lambda side, _: side.base is not None)
_OF_BODIES = (columns.LOAD_SIDE, _BODIES, columns.HELD_BASE, _NO_CONTROLLERS)
_OF_KNOWN = (*_OF_BODIES, SideNeed("known bodies", lambda x, _: bool(x.robot.known_bodies)))
_OF_ANGLES = (*_OF_BODIES, _TURNS, columns.MOTION)

GEAR_CHECKS = (
    ColumnCheck(CODES["transmission-error"], (columns.MOTOR_SIDE,), gears.orders, gears.periodic),
    ColumnCheck(CODES["delay"], (_TORQUE,), gears.late_torque, gears.is_late),
    ColumnCheck(
        CODES["delay"], (columns.SPRING, _BOTH_ENCODERS), gears.late_position, gears.is_late
    ),
    ColumnCheck(CODES["saturation"], (_TORQUE,), gears.beyond_extremes, gears.is_beyond),
    ColumnCheck(CODES["saturation"], (_COMMAND,), gears.beyond_amplifiers, gears.is_amplifier),
    ColumnCheck(CODES["encoder-offset"], _OF_ANGLES, gears.zeros, gears.zero_is_off),
)
"""The checks of a gear and its sensors, in the order in which their findings are listed."""


COLUMN_CHECKS = (
    *(*DRIVE_CHECKS, *GEAR_CHECKS),
    ColumnCheck(CODES["nominal-values"], _OF_KNOWN, columns.known_bodies, columns.bodies_differ),
    ColumnCheck(CODES["logs-differ"], (), _other_set_ups, _is_another_set_up),
)
"""The checks of an equation, in the order in which their findings are listed."""


@singledispatch
def column_checks(robot: Robot) -> tuple[ColumnCheck[Side], ...]:
    """Return the checks of an equation of this kind of robot."""
    return COLUMN_CHECKS


@dataclass(frozen=True, eq=False)
class SideSelection:
    """What was accepted into the equation of a side, and the finding of each check and joint.

    `notes` are those on checks that could not be made.
    """

    side: Side
    selection: engine.Selection
    findings: Mapping[tuple[ColumnCheck[Side], str], Finding]
    notes: Sequence[Finding] = ()

    @property
    def damping(self) -> float:
        """The damping of the spring of a motor equation, zero if none was accepted."""
        accepted = {x.trial.candidate.name[1:]: x.coefficients for x in self.selection.accepted}
        return float(accepted.get(("spring", "damping"), [0.0])[0])

    @cached_property
    def delays(self) -> dict[str, tuple[float, float]]:
        """The delay of each motor torque [s], and its standard error."""
        return torque_delays(self.side, self.selection)

    @property
    def doubtful(self) -> set[tuple[ColumnCheck[Side], str]]:
        """The checks and joints with a finding above a note: a note explains nothing away."""
        return {key for key, finding in self.findings.items() if finding.severity != "note"}

    def on_limit(self, finding: Finding) -> Finding | None:
        """Return the note on a torque at a limit of the log that these rows settle, else None."""
        is_open = (finding.code, finding.severity) == ("saturation", "doubtful")
        if not is_open or finding.joint not in self.side.joints:
            return None
        names = {x.trial.candidate.name[:2] for x in self.selection.accepted}
        if (finding.joint, "saturation") in names:
            return replace(finding, severity="note")
        return gears.limit_of_motor(self.side, self.selection, finding)

    def vanished(self, cutoff_hz: float) -> set[tuple[str, str]]:
        """Return what the values show without the accepted columns, and not with them.

        It is (code, joint) of each: an echo of what was accepted.
        """
        rows = self.selection.after.rows
        kept = np.flatnonzero(np.any(rows.H != 0, axis=0))  # columns of zeros were replaced
        with suppress(SeaidError):
            again = fit(rows.of_columns(kept), estimator_named("wls"), cutoff_hz=cutoff_hz)
            return self._shown(self.side.fitted) - self._shown(again)
        return set()

    def _shown(self, fitted: FittedRows) -> set[tuple[str, str]]:
        """Return what the noise and the values of a fit show (code, joint)."""
        findings, known = noise_findings(fitted.estimate), self.side.fitted.estimate.names
        estimate = fitted.estimate.of_names(x for x in fitted.estimate.names if x in known)
        if self.side.is_motor:
            (joint,) = self.side.joints
            findings += drive_findings(joint, estimate, fitted.qr_factor)
        for joint, of_joint in estimate.by_owner().items():
            findings += drive_findings(joint, of_joint, None) if joint in self.side.joints else []
        offsets = {("torque-offset", joint) for joint in sure_offsets(fitted.estimate.by_owner())}
        return offsets | {(finding.code, finding.joint) for finding in findings}


def _with_effect(side: Side, finding: Finding, accepted: Sequence[engine.Accepted]) -> Finding:
    """Return a finding with the parameter of the fit that its columns change most.

    The change is in standard errors of the estimate, and in per cent of the value.
    """
    changes = side.changed_by(accepted)
    worst = int(np.argmax(changes["standard errors"]))
    name = first_term(readable(side.fitted.estimate.names[worst]))
    effect = {f"change of {name} [{unit}]": float(x[worst]) for unit, x in changes.items()}
    return replace(finding, evidence={**finding.evidence, **effect})


def _with_rivals(side: Side, finding: Finding, accepted: Sequence[engine.Accepted]) -> Finding:
    """Return a finding with the causes that explain as much, and what decides between them."""
    rivals = dict[Cause, float]()
    for best in accepted:
        for trial in best.rivals:
            if other := _found_alone(side, trial):
                less = best.trial.comparison.bic - trial.comparison.bic
                rivals[CODES[other.code], other.message] = less
                if other.severity == "note":  # what explains as much does not matter
                    finding = replace(finding, severity="note")
    return undecided(finding, rivals) if rivals else finding


def _found_alone(side: Side, trial: engine.Trial) -> Finding | None:
    """Return the finding of a candidate that alone is accepted into the equation of the fit.

    What would be nothing in place of the others is no rival of them.
    """
    candidate, alternative = trial.candidate, trial.alternative
    larger = side.equation.with_alternatives([alternative])
    change = larger.values[: len(side.equation.values)] - side.equation.values
    of_columns = larger.last_of_blocks(alternative.columns.shape[1])
    alone = engine.Accepted(trial, *of_columns, trial.comparison.share, change)
    check: ColumnCheck[Side] = candidate.about
    return check.finding(side, candidate.joint, [alone], trial.comparison.share)


def with_settled_limits(
    findings: Sequence[Finding], selected: Sequence[SideSelection]
) -> list[Finding]:
    """Return findings with notes on the torques at the limits of a log that a fit has settled.

    Either the limit is that of the motor, or the fit has a finding of what the motor gives.
    """
    for side in selected:
        findings = [side.on_limit(finding) or finding for finding in findings]
    return [*findings]


def without_setup_echoes(
    findings: Sequence[Finding],
    setup: Sequence[Finding],
    selected: Sequence[SideSelection],
    robot: Robot,
    mistakes_of: Callable[[Robot], Iterable[Finding]],
) -> list[Finding]:
    """Return findings without mistakes of the set-up that are echoes of what equations lack.

    `setup` are the mistakes of the set-up among them. A mistake is an echo if the robot whose
    drives have the selected terms does not show it, as a tilt of gravity next to parallel springs.
    """
    mistakes = [finding for finding in setup if finding.severity != "note"]
    if not mistakes:
        return list(findings)
    supported = _with_selected_terms(robot, selected)
    shown = mistakes if supported.drives == robot.drives else mistakes_of(supported)
    kept = {(finding.code, finding.joint) for finding in shown}
    return [x for x in findings if x not in mistakes or (x.code, x.joint) in kept]


def _with_selected_terms(robot: Robot, selected: Iterable[SideSelection]) -> Robot:
    """Return the robot whose drives have the terms that the equations support."""
    drives = dict(robot.drives)
    for side in selected:
        for candidate in (accepted.trial.candidate for accepted in side.selection.accepted):
            joint, field, term = candidate.name
            is_doubtful = (candidate.about, joint) in side.doubtful
            if is_doubtful and field in term_fields(drives[joint]):
                drives[joint] = with_term(drives[joint], field, term)
    return robot.with_drives(drives)


def without_echoes(
    values: Sequence[Finding], selected: Sequence[SideSelection], cutoff_hz: float
) -> tuple[list[Finding], list[SideSelection]]:
    """Return what the values of a fit show, but for what its missing columns explain, and these.

    Where the accepted columns are in the model, a weak spring, play between the encoders, or a
    drift may be gone: it was an echo of what the model lacks, which is as severe.
    """
    above = {(x.code, x.joint): x for x in values if x.severity != "note"}
    vanished, sides = set[tuple[str, str]](), list[SideSelection]()
    for side in selected:
        if side.doubtful or (side.findings and above):
            gone = side.vanished(cutoff_hz)
            explained = by_severity(above[key] for key in gone if key in above)
            if explained and not side.doubtful:
                worst = explained[0].severity
                findings = {x: replace(y, severity=worst) for x, y in side.findings.items()}
                side = replace(side, findings=findings)
            vanished |= gone if side.doubtful else set()
        sides.append(side)
    return [x for x in values if (x.code, x.joint) not in vanished], sides


def delays_of(selected: Iterable[SideSelection]) -> dict[str, tuple[float, float]]:
    """Return {joint: delay of its torque and standard error [s]} of all equations."""
    return {joint: delay for side in selected for joint, delay in side.delays.items()}


def selections(sides: Sequence[Side]) -> list[SideSelection]:
    """Return what the rows of each side support next to the columns of its fit."""
    proposed = [_proposed(side) for side in sides]
    asked = sum(len(candidates) for candidates, _ in proposed)
    return [_selected(side, *each, asked) for side, each in zip(sides, proposed, strict=True)]


def _proposed(side: Side) -> tuple[list[engine.Candidate], list[Finding]]:
    """Return the candidates of a side, and notes on the checks that raise."""
    notes, pairs = list(side.notes), product(column_checks(side.robot), side.joints)
    return [x for check, j in pairs for x in proposals([check], notes, side, j)], notes


def _selected(
    side: Side, candidates: Sequence[engine.Candidate], notes: list[Finding], asked: int
) -> SideSelection:
    """Return what the rows of a side support, without candidates that turn out to be nothing."""
    selection, findings = engine.Selection((), side.equation, ()), {}
    with guarded(CODES["missing-term"], notes):
        selection = engine.forward_selection(side.equation, candidates, asked, STRONG)
    for joint, check in product(side.joints, column_checks(side.robot)):
        accepted = [x for x in selection.accepted if x.trial.candidate.origin == (check, joint)]
        if not accepted:
            continue
        finding = None
        with guarded(check.code, notes):
            finding = _finding_of(side, check, joint, accepted)
        if finding is None:
            # What it explained may belong to others that were not accepted next to it: all anew.
            remaining = [x for x in candidates if x.origin != (check, joint)]
            return _selected(side, remaining, notes, asked)
        findings[check, joint] = finding
    return SideSelection(side, selection, findings, notes)


def _finding_of(
    side: Side, check: ColumnCheck[Side], joint: str, accepted: engine.Acceptance
) -> Finding | None:
    """Return the finding of what was accepted of a check at a joint, None if it is nothing."""
    if not side.keeps_scale(accepted):
        return None
    finding = check.finding(side, joint, accepted, sum(x.share for x in accepted))
    if finding is None:
        return None
    return _with_rivals(side, _with_effect(side, finding, accepted), accepted)


def model_findings(
    selected: Sequence[SideSelection], known: Sequence[Finding] = ()
) -> list[Finding]:
    """Return what the equations of a fit lack: torques that are all late by as much are one.

    What is `known` already, such as a torque that is held over samples, is not repeated, and what
    the equations of a joint lack whose channels are wrong is a note without a remedy. That is each
    joint where the samples of a log are certainly wrong, or the robot hardly moves.
    """
    findings = _without_late_encoders(selected)
    mistakes = [finding for finding in known if finding.severity != "note"]
    spoiling = [finding for finding in mistakes if CODES[finding.code].kind == "cause"]
    # a mistake of no joints, as a clock or a tilt, that is certain or most of a misfit
    whole = [finding for finding in spoiling if not (finding.joint or finding.joints)]
    is_whole = any(codes.AS_GIVEN in x.evidence or x.certainty == "certain" for x in whole)
    findings = notes_beside(spoiling, findings, is_whole)
    findings = _with_common_delay(findings, selected, mistakes)
    if any(not finding.joint for finding in mistakes):
        # a mistake about the whole robot, such as a tilt, looks like the zero of a joint
        zero = "encoder-offset"
        findings = [replace(x, severity="note") if x.code == zero else x for x in findings]
    return [*findings, *dict.fromkeys(chain.from_iterable(side.notes for side in selected))]


def _without_late_encoders(selected: Sequence[SideSelection]) -> list[Finding]:
    """Return what equations lack, with what an encoder that is late adds to both sides as one.

    It looks like damping of the spring to the motor, and like as much friction to the load. Damping
    alone is next to none to the load: what the load has of it is an echo, as is what it has of a
    delay that the motor equation shows.
    """
    motors = [side for side in selected if side.side.is_motor]
    loads = [side for side in selected if side not in motors]
    dampings = {side.side.joints[0]: side.damping for side in motors}
    late = [*chain.from_iterable(_late_at_both(side, dampings) for side in loads)]
    at_both, delays = joints_of(late), {"delay", "or delay"}
    of_motors, of_load = map(_findings_of, (motors, loads))
    kept = [x for x in of_motors if x.code != "nonlinear-spring" or x.joint not in at_both]
    joints = at_both | joints_of(x for x in kept if x.code in ("delay", "nonlinear-spring"))
    of_load = [x for x in of_load if x.joint not in joints or not {x.code, *x.evidence} & delays]
    return [*kept, *late, *of_load]


def _findings_of(sides: Iterable[SideSelection]) -> list[Finding]:
    return [*chain.from_iterable(side.findings.values() for side in sides)]


def _late_at_both(load: SideSelection, dampings: Mapping[str, float]) -> Iterator[Finding]:
    """Yield the late encoders that the load shows and the motors as `dampings` {joint: damping}."""
    for best in load.selection.accepted:
        for trial in (best.trial, *best.rivals):
            # both are k d of a delay d, whose mean has half of what they differ by as an error
            k_d, damping = float(best.coefficients[0]), dampings.get(trial.candidate.joint, 0.0)
            if trial.candidate.field == "delay" and 1 / TWICE < damping / k_d < TWICE:
                mean, error = 0.5 * (best.coefficients + damping), 0.5 * (damping - k_d)
                errors = np.hypot(best.errors, error)
                both = engine.Accepted(trial, mean, errors, best.share, best.change)
                check, joint = trial.candidate.origin
                yield from filter(None, [check.finding(load.side, joint, [both], best.share)])


def _with_common_delay(
    findings: list[Finding], selected: Sequence[SideSelection], mistakes: Sequence[Finding]
) -> list[Finding]:
    """Return findings with one delay in place of those of all joints, and none if it is known."""
    # One of no joint, of the base or of all torques of a side, stands for those of single joints.
    others = [finding for finding in findings if finding.code != "delay" or not finding.joint]
    if any(finding.code == "delay" for finding in (*mistakes, *others)):
        return others
    pairs = [(side.side, side.selection) for side in selected]
    common = common_delay(pairs, delays_of(selected))
    if common is None:
        return findings
    # it is as severe as those of single joints that it stands for
    alike = by_severity(x for x in (common, *findings) if x.code == "delay")
    return [replace(common, severity=alike[0].severity), *others]
