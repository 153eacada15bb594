"""The first screen of a page: verdict, notices with their remedies, errors before and after.

"Before" are the values of the robot files, which predict the same torques as the identified ones.
They keep what no file can have: the zeros of the encoders and the offsets of torque sensors, as
identified.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, FrozenMapping
from seaid._progress import counted
from seaid.checks.channels import excluded_instants
from seaid.checks.tolerances import POOR
from seaid.checks.values import inconsistent_bodies, regression_notes
from seaid.checks.verdict import not_validated
from seaid.drives import PARAMETERS_OF, Drive
from seaid.drives.terms import MOTOR_CONSTANTS
from seaid.errors import SEVERITIES, Finding, Severity
from seaid.identification import Fit, Identification, verdict_with
from seaid.identification.validation import compared
from seaid.legged import FloatingRobot
from seaid.log import row_samples
from seaid.report.formats import seconds, share, short
from seaid.report.tables import ErrorRow, error_rows, place_name, side_name

if TYPE_CHECKING:
    from seaid.estimation import Estimate
    from seaid.report.html_charts import Run
    from seaid.robot import Robot
    from seaid.simulation import ReplayComparison


@dataclass(frozen=True)
class Notice:
    """Warnings of one code with one remedy, which is in words and, as `snippet`, text to copy."""

    subject: str
    severity: Severity
    messages: tuple[str, ...]
    joints: tuple[str, ...] = ()
    remedy: str = ""
    snippet: str = ""


@dataclass(frozen=True)
class PageVerdict:
    """The verdict: level for its colour, words, sentence; `numbers` are (name, value, note)."""

    level: str
    words: str
    sentence: str
    numbers: tuple[tuple[str, str, str], ...]


def page_verdict(
    result: Identification, runs: Sequence[Run], replays: Sequence[ReplayComparison] = ()
) -> PageVerdict:
    """Return the verdict on an identification with its numbers."""
    verdict = verdict_with(result, [*(run.result for run in runs), *replays])
    said = verdict.sentence.partition(": ")
    # The page has the level in large letters already: the sentence goes on without it.
    is_repeated = said[0] in ("good", "usable with care", "do not use this result")
    because = "" if verdict.level == "good" else "because of "
    sentence = because + said[2] if is_repeated else verdict.sentence
    level, numbers = verdict.level.replace(" ", "-"), tuple(_numbers(result, runs, replays))
    return PageVerdict(level, verdict.level.capitalize(), _sentence(sentence), numbers)


def _numbers(
    result: Identification, runs: Sequence[Run], replays: Sequence[ReplayComparison]
) -> Iterator[tuple[str, str, str]]:
    """Yield the numbers of the verdict, each with its name and a note."""
    unseen = error_rows([run for run in runs if run.is_unseen], result.robot)
    yield _prediction(unseen or error_rows(runs, result.robot), bool(unseen))
    kinds = (("Drive parameters", result.drives.values()), ("Base parameters", [result.load]))
    for name, estimates in kinds:
        errors = _relative_errors(estimates)
        if len(errors):
            good = int(np.sum(errors < POOR))
            note = "with a standard error below 10\N{NO-BREAK SPACE}%"
            yield name, f"{good} of {len(errors)}", note
    if replays:
        yield _replay_number(replays[0])
    if result.motions:
        length = sum(float(motion.time[-1] - motion.time[0]) for motion in result.motions)
        note = f"in {counted(len(result.motions), 'motion')}, below {result.cutoff_hz:.3g} Hz"
        yield "Data", seconds(length), note


def _replay_number(replay: ReplayComparison) -> tuple[str, str, str]:
    """Return the mean error of the replayed positions after and before, in each unit."""
    means = replay.mean_errors.items()
    before, after = (
        ", ".join(f"{short(1e3 * mean[place])} {unit}" for unit, mean in means) for place in (0, 1)
    )
    return "Replay", after, f"mean absolute error of the joints; {before} before"


def _relative_errors(estimates: Iterable[Estimate]) -> Array:
    """Return the relative standard errors of all parameters."""
    return np.concatenate([np.zeros(0), *(e.relative_standard_errors for e in estimates)])


def _prediction(rows: Sequence[ErrorRow], is_unseen: bool) -> tuple[str, str, str]:
    """Return the error of the predicted torques: median, and the worst."""
    motion = "Unseen motion" if is_unseen else "Own motion, not validated"
    if not rows:
        return motion, "–", "no torque to compare"
    errors = [row.relative_error for row in rows]
    worst = max(rows, key=lambda row: row.relative_error)
    note = f"worst {share(worst.relative_error)}: {worst.joint}, {worst.side} side"
    return motion, share(float(np.median(errors))), f"median error of the torques; {note}"


def notices_of(
    result: Identification,
    runs: Sequence[Run],
    replays: Sequence[ReplayComparison] = (),
    notes: Sequence[str] = (),
) -> list[Notice]:
    """Return the notices of a page, the worst first; those that differ in their joint are one.

    `notes` are the reasons why logs that were to validate do not.
    """
    every = [
        *result.warnings,
        *(finding for run in runs for finding in run.result.warnings),
        *(finding for replay in replays for finding in replay.warnings),
        *_about_validations(runs, notes),
        *_notes(result),
    ]
    together: dict[tuple[str, ...], Notice] = {}
    for notice in map(_notice, every):
        key = notice.subject, notice.severity, notice.remedy, notice.snippet
        first = together.get(key, replace(notice, messages=(), joints=()))
        together[key] = replace(
            first,
            messages=first.messages + notice.messages,
            joints=tuple(dict.fromkeys(first.joints + notice.joints)),
        )
    return sorted(together.values(), key=lambda notice: SEVERITIES.index(notice.severity))


def _notice(finding: Finding) -> Notice:
    """Return a finding as a notice; a remedy of several lines has a text to copy."""
    first, _, rest = finding.remedy.strip().partition("\n")
    joints = (finding.joint,) if finding.joint else finding.joints
    return Notice(
        finding.code, finding.severity, (_sentence(finding.message),), joints, first, rest
    )


def _about_validations(runs: Sequence[Run], reasons: Sequence[str]) -> Iterator[Finding]:
    own = [run.name for run in runs if not run.is_unseen and run.name.startswith("validation")]
    return not_validated(any(run.is_unseen for run in runs), reasons, own)


def _notes(result: Identification) -> Iterator[Finding]:
    """Yield the notes on the model of an identification, which only a page has room for."""
    yield from inconsistent_bodies(result.robot, result.feasible is not None)
    for side, checks in result.checks.items():
        joint = side if side in result.drives else ""
        yield from regression_notes(place_name(side), side_name(side), joint, checks)
    instants = sum(len(row_samples(motion)) for motion in result.motions)
    for side, count in result.excluded.items():
        # An instant has one equation (7) per motor; (8) has one per torque and axis of the base.
        rows = instants * (_load_rows(result) if side == "load" else 1)
        has_contacts = side == "load" and not result.robot.base_is_held
        if rows:
            yield from excluded_instants(place_name(side), count / rows, has_contacts)


def _load_rows(result: Identification) -> int:
    """Return the number of load-side equations at an instant."""
    robot, count = result.robot, len(result.model.torque_joints)
    if isinstance(robot, FloatingRobot):
        count += int(robot.free_axes.sum())
    return count


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if text.endswith(".") else ".")


_ZEROS = ("spring_offset", "deflection_zero", "torque_offset")
"""What no file can have; a spring offset follows from the stiffness."""

_NEEDED = {name for names in PARAMETERS_OF["spring"].values() for name in names}
_NEEDED |= {*MOTOR_CONSTANTS.values()}
"""Parameters without which a drive predicts nothing; others, as friction, are zero if absent."""

NO_BODIES = "the robot file has no inertial values"


@dataclass(frozen=True, eq=False)
class Nominal:
    """The `result` with the values of a robot's files in place of the estimates, zero without one.

    `bodies` are the base parameters among them, None without inertial values.
    """

    result: Identification
    robot: Robot
    bodies: Array | None

    def lack(self, side: str, joint: str) -> tuple[str, bool]:
        """Return what a torque is without, and whether it can be predicted nevertheless."""
        if side == "load" and self.bodies is None:
            return NO_BODIES, False
        known = {*self.robot.drives[joint].values, *_ZEROS}
        absent = [name for name in self._names(side, joint) if name not in known]
        listed = ", ".join(name.replace("_", " ") for name in absent)
        if _NEEDED & set(absent):
            return f"no nominal {listed}", False
        return f"without {listed}" if absent else "", True

    def _names(self, side: str, joint: str) -> Sequence[str]:
        """Return the parameters of the drive of a joint in the equation of a side."""
        if side == "actuator":
            return self.result.drive_side[joint].names
        model = self.result.model
        return [name for of, name, _ in (*model.drives, *model.absorbed) if of == joint]


def nominal_values(result: Identification, robot: Robot) -> Nominal:
    """Return the values of a robot's files for the parameters that were identified."""
    model = result.model
    drives = {
        joint: replace(estimate, values=np.nan_to_num(_drive_values(estimate, robot.drives[joint])))
        for joint, estimate in result.drive_side.items()
    }
    places = (*model.drives, *model.absorbed)
    values = np.array([robot.drives[of].values.get(name, 0.0) for of, name, _ in places])
    count = len(model.drives)
    load = np.concatenate([result.base.project(np.nan_to_num(robot.parameters)), values[:count]])
    # theta_b = K pi + A x: absorbed drive parameters x are part of combinations and of drives.
    load = load + model.absorption @ values[count:]
    load = np.concatenate([load, np.zeros(len(result.load_side.names) - len(load))])
    has_bodies = not np.any(np.isnan(robot.parameters))
    load_side = replace(result.load_side, values=load)
    return Nominal(
        replace(result, drive_side=FrozenMapping(drives), load_side=load_side),
        robot,
        load[: len(result.load.names)] if has_bodies else None,
    )


def _drive_values(estimate: Estimate, drive: Drive) -> Array:
    """Return the nominal values (p,) of a drive, its encoder zeros as identified."""
    fitted = estimate.by_name
    kept = {name: fitted[name] for name in _ZEROS[1:] if name in fitted}
    if "spring_offset" in fitted and "preload" not in drive.spring:
        # f_0 = k d_0: the encoders' offset d_0 stays, with the stiffness of the file.
        zero = fitted["spring_offset"] / fitted["stiffness"] if fitted.get("stiffness") else np.nan
        kept["spring_offset"] = zero * drive.values.get("stiffness", np.nan)
    values = {**drive.values, **kept}
    return np.array([values.get(name, np.nan) for name in estimate.names])


def before_and_after(nominal: Nominal, run: Run) -> list[ErrorRow]:
    """Return the errors of a run by side and joint, before with the nominal values."""
    motions = run.result.motions
    # The same equations and motions with other values, so that both errors are of the same samples.
    before = compared(nominal.result, *motions) if motions else None
    rows = []
    for row in error_rows([run], nominal.result.robot):
        reason, is_predicted = nominal.lack(row.side, row.joint)
        if is_predicted and before is None:
            reason = "the motion of this validation is not kept"
        if is_predicted and before is not None:
            fit: Fit = getattr(before, row.side)
            error = float(fit.relative_error[before.joints.index(row.joint)])
            row = replace(row, before=error)
        rows.append(replace(row, reason=reason))
    return rows
