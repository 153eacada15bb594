"""What the equations of a fit lack: selected among the columns of all checks, and named.

`selections` selects among the candidates of drives, gears and sensors, equation by equation, and
each check words what was accepted of its own; candidates of other checks that explain as much are
named as rivals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from seaid.checks.codes import DELAY, ENCODER_OFFSET
from seaid.checks.columns import DRIVE_CHECKS, Side
from seaid.checks.engine import (
    Accepted,
    Candidate,
    ColumnCheck,
    Selection,
    Trial,
    forward_selection,
)
from seaid.checks.gears import GEAR_CHECKS
from seaid.checks.sensors import SENSOR_CHECKS, common_delay
from seaid.checks.terms import with_term
from seaid.checks.values import drive_findings, noise_findings
from seaid.drives import parameter_of, term_fields
from seaid.errors import Finding, SeaidError
from seaid.estimation import FittedRows, estimator_named, fit
from seaid.log import Motion
from seaid.regressor import BaseParameters
from seaid.robot import Robot

COLUMN_CHECKS = (*DRIVE_CHECKS, *GEAR_CHECKS, *SENSOR_CHECKS)
"""The checks of an equation, in the order in which their findings are listed."""

STRONG = 6.0
"""Least decrease of the information criterion, "strong" by Kass and Raftery (1995).

`compare_terms` is asked, this is not: above zero 3 of 120 right set-ups have a
finding, all of them below 4 (scripts/benchmarks/term_selection.py --findings)."""


@dataclass(frozen=True, eq=False)
class SideSelection:
    """What was accepted into the equation of a side."""

    side: Side
    selection: Selection

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
    def _worded(self) -> tuple[tuple[ColumnCheck[Side], str, Finding], ...]:
        return tuple(self._word())

    def _word(self) -> Iterator[tuple[ColumnCheck[Side], str, Finding]]:
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
    rivals = [rival for x in accepted for rival in x.rivals if _would_be_named(side, rival)]
    if not rivals:
        return finding
    causes, decisions = dict[tuple[str, str, str], str](), dict[str, None]()
    for trial in [*(x.trial for x in accepted), *rivals]:
        candidate = trial.candidate
        field = candidate.field.replace("_", " ")
        causes[candidate.name] = candidate.about.cause.format(term=candidate.term, field=field)
        decisions[candidate.about.decision] = None
    return replace(
        finding,
        message=f"{finding.message}. The log does not decide between "
        f"{' and '.join(causes.values())}: each explains as much",
        remedy=f"a measurement decides: {'; '.join(decisions)}",
    )


def _would_be_named(side: Side, trial: Trial) -> bool:
    """Whether a candidate is a finding if it alone is accepted into the equation of the fit."""
    candidate, alternative = trial.candidate, trial.point.alternative
    larger = side.equation.with_alternatives([alternative])
    alone = Accepted(trial, *larger.last(alternative.columns.shape[1]))
    return candidate.about.finding(side, candidate.joint, [alone], trial.share) is not None


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
    common = common_delay([(one.side, one.selection) for one in selected])
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
