"""Which terms do the data support? Drives with one more term each, compared on the same log.

A term is recommended where both the extended Bayesian information criterion and the prediction of
blocks that were left out are for it. Then the next is asked for beside it, until none is worth
having. Nothing is selected silently: the result is a table and a robot to look at.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from seaid._arrays import Array, FrozenMapping
from seaid._progress import track
from seaid.drives import PARAMETERS_OF, Drive
from seaid.errors import IdentificationError, RobotError, SeaidError, unknown_name
from seaid.estimation import (
    ModelComparison,
    common_rows,
    compare_models,
    independent_rows,
    qr_factor_of,
    settled_weights,
    weighted,
)
from seaid.identification.datasets import Source, datasets_of, first_motion, sources_of
from seaid.identification.linearisation import with_gear_torques
from seaid.identification.nonlinear_terms import fit_load, linearised
from seaid.identification.two_step import joints_with_torque
from seaid.log import Motion
from seaid.regressor import Regression, actuator_regression, stacked
from seaid.robot import Robot

AT_THE_MOTOR = {
    "friction": ("offset", "asymmetric", "quadratic", "load", "stribeck"),
    "spring": ("cubic", "dead_zone", "damping"),
}
"""Terms asked for on the actuator side of an elastic drive; of a stiff one on the load side."""

AT_THE_JOINT = {"parallel_spring": ("linear",), "joint_friction": ("viscous", "coulomb")}
"""Terms asked for on the load side of any drive that can have them."""

_MOST_STEPS = 4
"""Terms that one drive may gain."""


@dataclass(frozen=True, eq=False)
class TermComparison:
    """What one more term of a joint's drive is worth beside those it has at `step`.

    `gain` is None where the term could not be asked about: `reason` says why. Of those worth having
    at a step the best is `selected`.
    """

    joint: str
    field: str
    term: str
    step: int
    comparison: ModelComparison | None
    reason: str = ""
    selected: bool = False

    @property
    def is_supported(self) -> bool:
        """Both criteria are for the term."""
        return self.comparison is not None and self.comparison.is_supported


@dataclass(frozen=True, eq=False)
class TermSelection:
    """All terms asked about, and those recommended {joint: ((field, term), ...)}.

    `robot` has the recommended terms, and values of bent ones to start from; it still has to be
    identified.
    """

    comparisons: tuple[TermComparison, ...]
    recommended: Mapping[str, tuple[tuple[str, str], ...]]
    robot: Robot

    def __str__(self) -> str:
        """Return a table of all terms, and the recommendation in words."""
        from seaid.report import terms_table

        return terms_table(self)


def compare_terms(
    robot: Robot,
    logs: Source | Sequence[Source],
    *,
    joints: Sequence[str] | None = None,
    terms: Mapping[str, Sequence[str]] | None = None,
    torque_joints: Sequence[str] | None = None,
    cutoff_hz: float | None = None,
    progress: bool = False,
) -> TermSelection:
    """Ask of each joint's drive which more terms the logs support.

    `joints` (default all) and `terms` {field of the drive: terms} limit what is asked about;
    `rows` and `cutoff_hz` as in `identify`. Raises IdentificationError for unknown terms, as
    `identify` for logs that cannot answer.
    """
    asked = _asked(terms)
    datasets = datasets_of(robot, sources_of(logs), cutoff_hz, None, progress)
    motions = [first_motion(dataset) for dataset in datasets]
    used = (
        joints_with_torque(robot, datasets) if torque_joints is None else robot.rows(torque_joints)
    )
    comparisons: list[TermComparison] = []
    for joint in track(robot.rows(joints), "terms", progress):
        robot = _extended(_Question(robot, motions, used, joint), asked, comparisons)
    recommended = {
        joint: tuple(
            (one.field, one.term) for one in comparisons if one.joint == joint and one.selected
        )
        for joint in robot.joint_names
    }
    return TermSelection(
        comparisons=tuple(comparisons),
        recommended=FrozenMapping({joint: found for joint, found in recommended.items() if found}),
        robot=robot,
    )


def with_term(drive: Drive, field: str, term: str) -> Drive:
    """Return the drive with one more term; values of parameters that it then lacks are dropped."""
    terms = (*getattr(drive, field), term)
    bare = replace(drive, nominal={}, known=(), **{field: terms})  # type: ignore[arg-type]
    names = bare.parameter_names
    valued = bare.with_values({n: x for n, x in drive.values.items() if n in names})
    return replace(valued, known=tuple(name for name in drive.known if name in names))


def _asked(terms: Mapping[str, Sequence[str]] | None) -> Mapping[str, Sequence[str]]:
    if terms is None:
        return {**AT_THE_MOTOR, **AT_THE_JOINT}
    for field, names in terms.items():
        if field not in PARAMETERS_OF:
            raise IdentificationError("terms=: " + unknown_name("field", field, PARAMETERS_OF))
        for name in names:
            if name not in PARAMETERS_OF[field]:
                kind = f"{field.replace('_', ' ')} term"
                message = unknown_name(kind, name, PARAMETERS_OF[field])
                raise IdentificationError(f"terms=: {message}")
    return terms


def _extended(
    question: _Question, asked: Mapping[str, Sequence[str]], comparisons: list[TermComparison]
) -> Robot:
    """Return the robot with the terms that one joint is worth; all that was asked goes to gains."""
    for step in range(_MOST_STEPS):
        candidates = _candidates(question, asked)
        found = _gains(question, candidates, step)
        worth = [one for one in found if one.is_supported]
        best = max(worth, key=_bic, default=None)
        comparisons += [replace(one, selected=one is best) for one in found]
        if best is None:
            break
        drive = with_term(question.robot.drives[question.joint], best.field, best.term)
        robot = question.robot.with_drives({question.joint: drive})
        question = replace(question, robot=linearised(robot, question.motions))
    return question.robot


def _bic(one: TermComparison) -> float:
    return -float("inf") if one.comparison is None else one.comparison.bic


def _candidates(question: _Question, asked: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Return the terms that a drive does not have and can have."""
    drive, found = question.robot.drives[question.joint], []
    for field, terms in asked.items():
        told = question.is_motor_side(field) or question.joint in question.used
        for term in terms if told and hasattr(drive, field) else ():
            if term not in getattr(drive, field):
                with suppress(RobotError):  # what this drive cannot have
                    with_term(drive, field, term)
                    found.append((field, term))
    return found


@dataclass(frozen=True, eq=False)
class _Question:
    """A joint whose drive is asked about, beside all that the robot has by now."""

    robot: Robot
    motions: Sequence[Motion]
    used: Sequence[str]
    joint: str

    def is_motor_side(self, field: str) -> bool:
        """Tell whether a field's terms are in the actuator side, (7)."""
        return field in AT_THE_MOTOR and self.joint in self.robot.elastic_joints

    def rows(self, robot: Robot, motor_side: bool) -> Regression:
        """Return the rows of one side with the drives of a robot, bent ones near their best."""
        if motor_side:
            straight = linearised(robot, self.motions)
            return stacked([actuator_regression(straight, one, self.joint) for one in self.motions])
        straight, motions = with_gear_torques(
            linearised(robot, self.motions), self.motions, self.used
        )
        return fit_load(straight, motions, self.used).rows


@dataclass(frozen=True, eq=False)
class _Base:
    """The rows of the model as it is, its equations' weights, and how many are independent."""

    rows: Regression
    weights: Array
    independent: float


def _base(rows: Regression) -> _Base:
    qr_factor, estimate = qr_factor_of(rows), weighted(rows)
    weights = settled_weights(qr_factor)
    return _Base(rows, weights, independent_rows(qr_factor, estimate))


def _gains(
    question: _Question, candidates: Sequence[tuple[str, str]], step: int
) -> list[TermComparison]:
    """Return what each candidate is worth."""
    bases: dict[bool, _Base] = {}
    found = []
    for field, term in candidates:
        motor_side = question.is_motor_side(field)
        if motor_side not in bases:
            bases[motor_side] = _base(question.rows(question.robot, motor_side))
        found.append(_gain(question, bases[motor_side], field, term, step, len(candidates)))
    return found


def _gain(
    question: _Question, base: _Base, field: str, term: str, step: int, asked: int
) -> TermComparison:
    joint, rows = question.joint, base.rows
    drive = with_term(question.robot.drives[joint], field, term)
    nothing = TermComparison(joint, field, term, step, None)
    try:
        robot = question.robot.with_drives({joint: drive})
        larger = question.rows(robot, question.is_motor_side(field))
        rows, larger = common_rows(rows, larger)
        names = tuple(f"{name} with {term}" for name in larger.names)
        both = replace(
            rows,
            names=(*rows.names, *names),
            units=(*rows.units, *larger.units),
            H=np.hstack([rows.H, larger.H]),
            propagated=np.empty((len(rows.y), 0)),
        )
        result = compare_models(both, base.weights, rows.names, names, base.independent, asked)
    except SeaidError as problem:
        return replace(nothing, reason=str(problem))
    return replace(nothing, comparison=result)
