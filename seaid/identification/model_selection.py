"""Model selection: which friction and spring terms the data support.

Each drive with one more term is compared with the drive as it is, on the same log. A term is
recommended if both the extended Bayesian information criterion and the prediction of excluded
blocks support it. The next term is then compared with that model, until no term is supported. The
result is a table and a robot; no term is added silently.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from seaid._arrays import Array, FrozenMapping
from seaid._progress import MOST_NAMES, Result, counted, track
from seaid.drives import COULOMB, PARAMETERS_OF, Drive, term_fields
from seaid.errors import IdentificationError, RobotError, SeaidError, checked, listed, unknown_name
from seaid.estimation import (
    ModelComparison,
    common_rows,
    compare_models,
    estimator_named,
    fit,
    independent_rows,
)
from seaid.identification.datasets import Source, datasets_of, first_motion, sources_of
from seaid.identification.linearisation import with_gear_torques
from seaid.identification.nonlinear_terms import linearised, starting_load_fit
from seaid.identification.two_step import joints_with_torque
from seaid.log import Motion
from seaid.regressor import Regression, actuator_regression, stacked
from seaid.robot import Robot

_NOT_COMPARED = {"friction": ("viscous", *COULOMB), "spring": ("linear", "fifth", "preload")}
"""Terms of the usual drive, and those for which another one stands in a comparison."""

AT_THE_MOTOR = {
    field: tuple(term for term in PARAMETERS_OF[field] if term not in excluded)
    for field, excluded in _NOT_COMPARED.items()
}
"""Terms on the actuator side of an elastic drive; of a stiff drive on the load side."""

AT_THE_JOINT = {"parallel_spring": ("linear",), "joint_friction": ("viscous", "coulomb")}
"""Terms on the load side of any drive that can have them."""

_MOST_STEPS = 4
"""Largest number of terms that one drive may gain."""


@dataclass(frozen=True, eq=False)
class TermComparison:
    """Comparison of a joint's drive with and without one more term, at `step` of the selection.

    `comparison` is None if the term could not be estimated: `reason` says why. The best supported
    term of a step is `selected`.
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
        """Whether both criteria support the term."""
        return self.comparison is not None and self.comparison.is_supported


@dataclass(frozen=True, eq=False, repr=False)
class TermSelection(Result):
    """The result of `compare_terms`; str() is a table with the recommendation.

    Attributes
    ----------
    comparisons : tuple of TermComparison
        All terms compared.
    recommended : mapping {joint: ((field, term), ...)}
        The terms that the data support.
    robot : Robot
        The robot with the recommended terms and start values of nonlinear ones, to be identified.
    """

    table_name = "terms_table"

    comparisons: tuple[TermComparison, ...]
    recommended: Mapping[str, tuple[tuple[str, str], ...]]
    robot: Robot

    def _in_short(self) -> str:
        terms = [f"{joint} {term}" for joint, of in self.recommended.items() for _, term in of]
        tried = counted(len(self.comparisons), "comparison")
        return f"'{self.robot.name}': {tried}, recommended: {listed(terms, MOST_NAMES) or 'none'}"


@checked(IdentificationError)
def compare_terms(
    robot: Robot,
    logs: Source | Sequence[Source],
    *,
    joints: str | Sequence[str] | None = None,
    terms: Mapping[str, Sequence[str]] | None = None,
    torque_joints: str | Sequence[str] | None = None,
    cutoff_hz: float | None = None,
    progress: bool = False,
) -> TermSelection:
    """Compare the drives of a robot with drives of one more term, on the same logs.

    Parameters
    ----------
    robot, logs, torque_joints, cutoff_hz
        As in `identify`.
    joints : sequence of str, optional
        Joints whose drives are compared. Default: all.
    terms : mapping {field of the drive: terms}, optional
        Terms to compare. Default: `AT_THE_MOTOR` and `AT_THE_JOINT`.
    progress : bool
        Show a progress bar.

    Returns
    -------
    TermSelection

    Raises
    ------
    IdentificationError
        For unknown terms; further errors as in `identify`.

    Examples
    --------
    >>> selection = seaid.compare_terms(robot, log, terms={"friction": ["stribeck"]})
    >>> result = seaid.identify(selection.robot, log)
    """
    asked, compared = _asked(terms), robot.selected(joints)
    selected = robot.selected(torque_joints)  # refuses unknown joints before a log is read
    datasets = datasets_of(robot, sources_of(logs), cutoff_hz, None, progress)
    motions = [first_motion(dataset) for dataset in datasets]
    used = joints_with_torque(robot, datasets) if torque_joints is None else selected
    comparisons: list[TermComparison] = []
    for joint in track(compared, "terms", progress):
        robot = _extended(_JointModel(robot, motions, used, joint), asked, comparisons)
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
    """Return the drive with one more term, without the values of parameters that it then lacks."""
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
    model: _JointModel, asked: Mapping[str, Sequence[str]], comparisons: list[TermComparison]
) -> Robot:
    """Return the robot with the supported terms of one joint; append all to `comparisons`."""
    for step in range(_MOST_STEPS):
        candidates = _candidates(model, asked)
        found = _comparisons(model, candidates, step)
        supported = [one for one in found if one.is_supported]
        best = max(supported, key=_bic, default=None)
        comparisons += [replace(one, selected=one is best) for one in found]
        if best is None:
            break
        drive = with_term(model.robot.drives[model.joint], best.field, best.term)
        robot = model.robot.with_drives({model.joint: drive})
        model = replace(model, robot=linearised(robot, model.motions))
    return model.robot


def _bic(one: TermComparison) -> float:
    return -float("inf") if one.comparison is None else one.comparison.bic


def _candidates(model: _JointModel, asked: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Return the terms (field, term) that a drive lacks, can have, and has equations for."""
    drive, found = model.robot.drives[model.joint], []
    for field, terms in asked.items():
        has_equation = model.is_motor_side(field) or model.joint in model.used
        for term in terms if has_equation and field in term_fields(drive) else ():
            if term not in getattr(drive, field):
                with suppress(RobotError):  # what this drive cannot have
                    with_term(drive, field, term)
                    found.append((field, term))
    return found


@dataclass(frozen=True, eq=False)
class _JointModel:
    """The model of the robot at a step of the selection, and the joint whose drive is extended."""

    robot: Robot
    motions: Sequence[Motion]
    used: Sequence[str]
    joint: str

    def is_motor_side(self, field: str) -> bool:
        """Return whether a field's terms are on the actuator side (7)."""
        return field in AT_THE_MOTOR and self.joint in self.robot.elastic_joints

    def rows(self, robot: Robot, motor_side: bool) -> Regression:
        """Return the rows of one side, with the robot's drives linearised near the best values."""
        if motor_side:
            linear = linearised(robot, self.motions)
            return stacked([actuator_regression(linear, one, self.joint) for one in self.motions])
        linear, motions = with_gear_torques(
            linearised(robot, self.motions), self.motions, self.used
        )
        return starting_load_fit(linear, motions, self.used).rows


@dataclass(frozen=True, eq=False)
class _Base:
    """The rows of the present model, its equations' weights, the number of independent rows."""

    rows: Regression
    weights: Array
    independent: float


def _base(rows: Regression) -> _Base:
    found = fit(rows, estimator_named("wls"))
    return _Base(rows, found.weights, independent_rows(found.qr_factor, found.estimate))


def _comparisons(
    model: _JointModel, candidates: Sequence[tuple[str, str]], step: int
) -> list[TermComparison]:
    """Return the comparison of each candidate."""
    bases: dict[bool, _Base] = {}
    found = []
    for field, term in candidates:
        motor_side = model.is_motor_side(field)
        if motor_side not in bases:
            bases[motor_side] = _base(model.rows(model.robot, motor_side))
        found.append(_comparison(model, bases[motor_side], field, term, step, len(candidates)))
    return found


def _comparison(
    model: _JointModel, base: _Base, field: str, term: str, step: int, asked: int
) -> TermComparison:
    joint, rows = model.joint, base.rows
    drive = with_term(model.robot.drives[joint], field, term)
    nothing = TermComparison(joint, field, term, step, None)
    try:
        robot = model.robot.with_drives({joint: drive})
        larger = model.rows(robot, model.is_motor_side(field))
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
