"""Model selection: which friction and spring terms the data support.

Each drive with one more term is compared with the drive as it is, on the same log. A term is
recommended if both the extended Bayesian information criterion and the prediction of excluded
blocks support it. The next term is then compared with that model, until no term is supported. The
result is a table and a robot; no term is added silently.

A drive whose friction nobody named gets the supported ones of `DEFAULTS`, by the first step of the
selection among all columns that the rows of a fit may lack (`seaid.checks`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain

from seaid._arrays import FrozenMapping
from seaid._progress import MOST_NAMES, Result, counted, track
from seaid.checks import engine
from seaid.checks.columns import Side, backlash, included_term
from seaid.checks.engine import Trial, best_of, best_trial
from seaid.checks.model import SideSelection
from seaid.checks.terms import (
    DriveRows,
    duration_s,
    possible_terms,
    reference_position,
    term_candidates,
    with_term,
)
from seaid.drives import DEAD_ZONES, PARAMETERS_OF, Drive
from seaid.drives.drives import DefaultTerms
from seaid.drives.terms import BY_TEMPERATURE, WARM_UP, parameter_named
from seaid.errors import Finding, IdentificationError, LogError, check_name, checked, listed
from seaid.estimation import FittedRows, estimator_named, fit
from seaid.identification.datasets import (
    Source,
    check_temperatures,
    datasets_by_log,
    first_motion,
    sources_of,
)
from seaid.identification.nonlinear_terms import (
    linearised,
    linearised_load,
    missing_reversals,
    starting_load_fit,
    with_gear_torques,
    with_torques,
)
from seaid.identification.two_step import Condition, joints_with_torque
from seaid.log import Motion
from seaid.regressor import actuator_regression
from seaid.regressor.regression import stacked
from seaid.robot import Robot
from seaid.robot.robot import check_held

_NOT_COMPARED = {
    "friction": ("viscous", "coulomb", "shifted_coulomb", *BY_TEMPERATURE, *WARM_UP),
    "spring": ("linear", "fifth", "preload"),
}
"""Terms that are not compared unasked: those of the usual drive, those that another term stands for
in a comparison, and those of temperature and time, for which `compare_terms` needs logs with a
temperature, or logs that are long enough."""

LEAST_WARM_UP_S = 60.0
"""Shortest log in which a warm-up is looked for unasked: windings take a minute, housings and
grease many, and in seconds any drift looks like one."""

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
    term of a step is `selected`. `values` {parameter: value} are the best of a grid, of parameters
    in which the equation is nonlinear. `cutoff_hz` is that of a second comparison, above that of
    the motion, of laws whose torque has corners.
    """

    joint: str
    field: str
    term: str
    step: int
    comparison: engine.ModelComparison | None
    reason: str = ""
    selected: bool = False
    values: Mapping[str, float] = FrozenMapping({})
    cutoff_hz: float | None = None

    @property
    def is_supported(self) -> bool:
        """Whether both criteria support the term."""
        return self.comparison is not None and self.comparison.is_supported_overall


@dataclass(frozen=True, eq=False, repr=False)
class TermSelection(Result):
    """The result of `compare_terms`; str() is a table with the recommendation.

    Attributes
    ----------
    comparisons : tuple of TermComparison
        All terms compared.
    robot : Robot
        The robot with the recommended terms and start values of nonlinear ones, to be identified.
    """

    table_name = "terms_table"

    comparisons: tuple[TermComparison, ...]
    robot: Robot

    @property
    def recommended(self) -> Mapping[str, tuple[tuple[str, str], ...]]:
        """The terms that the data support, {joint: ((field, term), ...)}."""
        terms = dict[str, tuple[tuple[str, str], ...]]()
        for x in self.comparisons:
            if x.selected:
                terms[x.joint] = (*terms.get(x.joint, ()), (x.field, x.term))
        return FrozenMapping(terms)

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
    check_held(robot, "compare_terms", IdentificationError)
    plain, compared = _asked(terms), robot.selected(joints)
    selected = robot.selected(torque_joints)  # refuses unknown joints before a log is read
    datasets = list(chain(*datasets_by_log(robot, sources_of(logs), cutoff_hz, progress)))
    motions = [first_motion(dataset) for dataset in datasets]
    used = joints_with_torque(robot, datasets) if torque_joints is None else selected
    comparisons: list[TermComparison] = []
    finer: list[Motion] = []
    model = _model_of(robot, motions, used)
    if terms is None and duration_s(motions) >= LEAST_WARM_UP_S:
        plain = {**plain, "friction": (*plain["friction"], *WARM_UP)}
    asked = {joint: _with_temperature(robot, motions, joint, plain, terms) for joint in compared}
    # The comparisons of all joints: the criterion allows for the best of so many by chance.
    count = sum(len(list(possible_terms(robot.drives[joint], asked[joint]))) for joint in compared)
    for joint in track(compared, "terms", progress):
        model = _extended(model, joint, asked[joint], count, comparisons)
        if cutoff_hz is None:
            model = _with_backlash(model, joint, asked[joint], logs, finer, count, comparisons)
    return TermSelection(tuple(comparisons), _with_known_of(robot, model.robot))


def _with_known_of(robot: Robot, searched: Robot) -> Robot:
    """Return a searched robot with no more known parameters than those of a robot."""
    drives = {}
    for joint, drive in searched.drives.items():
        known = tuple(name for name in drive.known if name in robot.drives[joint].known)
        drives[joint] = replace(drive, known=known)
    return searched.with_drives(drives)


def backlash_findings(
    robot: Robot, logs: Sequence[Source], weak: Iterable[str], used: Sequence[str]
) -> Iterator[Finding]:
    """Yield the backlash of drives whose springs look `weak`; a finer cutoff shows its corners.

    In simulation it names 12 of 12 joints with backlash, and none of 100 others with weak springs.
    """
    for joint in weak if robot.base_is_held else ():
        if {*DEAD_ZONES, "dahl"} & {*robot.drives[joint].spring}:
            continue
        try:
            selection = compare_terms(
                robot, logs, joints=joint, terms={"spring": _LAWS}, torque_joints=used
            )
        except (IdentificationError, LogError):  # such as a log too short for a comparison
            continue
        for zone in (x for x in selection.comparisons if x.selected and x.term == "dead_zone"):
            if zone.comparison is not None:
                yield backlash(joint, robot.drives[joint], zone.comparison, zone.values)


_LAWS = ("cubic", "dead_zone")
"""Laws that are compared where a spring looks weak: backlash, and what it is mistaken for."""


def _asked(terms: Mapping[str, Sequence[str]] | None) -> Mapping[str, Sequence[str]]:
    if terms is None:
        return {**AT_THE_MOTOR, **AT_THE_JOINT}
    for field, names in terms.items():
        check_name("field", field, PARAMETERS_OF, IdentificationError, "terms=")
        kind = f"{field.replace('_', ' ')} term"
        for name in names:
            check_name(kind, name, PARAMETERS_OF[field], IdentificationError, "terms=")
    return terms


def _with_temperature(
    robot: Robot,
    motions: Sequence[Motion],
    joint: str,
    asked: Mapping[str, Sequence[str]],
    chosen: Mapping[str, Sequence[str]] | None,
) -> Mapping[str, Sequence[str]]:
    """Return the terms for a joint: with those of temperature if they are asked for and logged.

    Raises IdentificationError for a temperature that is asked for and is not logged or constant.
    """
    named = {*(chosen or {}).get("friction", ())} & {*BY_TEMPERATURE}
    terms = tuple(named or BY_TEMPERATURE)
    bare = replace(robot.drives[joint], friction=terms, nominal={}, known=())
    try:
        check_temperatures(robot.with_drives({joint: bare}), motions, joint)
    except IdentificationError:
        if named:
            raise
        return asked
    friction = [*asked.get("friction", ()), *(() if chosen is not None else terms)]
    return {**asked, "friction": friction} if friction else asked


def _extended(
    model: _Model,
    joint: str,
    asked: Mapping[str, Sequence[str]],
    count: int,
    comparisons: list[TermComparison],
) -> _Model:
    """Return the model with the supported terms of one joint; append all to `comparisons`.

    `count` is the number of comparisons of all joints, which the criterion allows for.
    """
    for step in range(_MOST_STEPS):
        terms = _compared_terms(model, joint, asked, count, step)
        supported = {x: x.comparison for x in terms if x.comparison is not None and x.is_supported}
        best = best_of(supported)
        if best is not None:
            try:
                model = model.with_term(best)
            except IdentificationError as problem:  # such as a warm-up longer than the log
                place, best = terms.index(best), None
                terms[place] = replace(terms[place], comparison=None, reason=str(problem))
        comparisons += [replace(term, selected=term is best) for term in terms]
        if best is None:
            break
    return model


def _with_backlash(
    model: _Model,
    joint: str,
    asked: Mapping[str, Sequence[str]],
    logs: Source | Sequence[Source],
    finer: list[Motion],
    count: int,
    comparisons: list[TermComparison],
) -> _Model:
    """Return the model with the dead zone of an elastic drive, if its corners support one.

    Where teeth bounce, a dead zone explains only a tenth of the residual at the cutoff of the
    motion, and may have been missed. It is compared again at the higher cutoff for corners, if the
    spring has no dead zone and no hysteresis yet. Laws of hysteresis are not compared again: the
    noise of the deflection of a stiff contact, which grows with the cutoff, looks like one. `finer`
    are the motions at that cutoff, reconstructed where they are first used.
    """
    drive = model.robot.drives[joint]
    fields = {"spring": [term for term in asked.get("spring", ()) if term in DEAD_ZONES]}
    has_law = drive.is_elastic and {*DEAD_ZONES, "dahl"} & {*drive.spring}
    terms = list(possible_terms(drive, fields))
    if not drive.is_elastic or has_law or not terms:
        return model
    if not finer:  # the same for every joint
        groups = datasets_by_log(model.larger(joint, *terms[0]).robot, sources_of(logs), None)
        finer += map(first_motion, chain(*groups))
    added: list[TermComparison] = []
    # The finer cutoff is for the corners of the zone alone: other terms stay at that of the motion.
    again = _model_of(model.robot, finer, model.used)
    again = _extended(again, joint, fields, count + len(terms), added)
    comparisons += [replace(term, cutoff_hz=finer[0].cutoff_hz) for term in added]
    return replace(model, robot=again.robot)


def _model_of(robot: Robot, motions: Sequence[Motion], used: Sequence[str]) -> _Model:
    """Return the model of a robot, whose nonlinear parameters are searched."""
    model = with_gear_torques(_Model(robot, motions, used))
    return model.with_drives({joint: _fixed(x) for joint, x in model.robot.drives.items()})


class _Model(Condition):
    """The model of the robot at a step of the selection, linear: nonlinear parameters are known.

    Its datasets are motions, with the torque through the gears if friction depends on it.
    """

    @cached_property
    def load(self) -> FittedRows:
        """The fit of the load side (8)."""
        return fit(starting_load_fit(self).rows, _WLS)

    def larger(self, joint: str, field: str, term: str) -> _Model:
        """Return the model with one more term in the drive of a joint."""
        return self.with_drives({joint: with_term(self.robot.drives[joint], field, term)})

    @cached_property
    def _loaded(self) -> Sequence[Motion]:
        """The motions with the torque through the gears of the fit, for load-dependent friction."""
        return with_torques(self)

    def side(self, joint: str, at_motor: bool) -> Side | None:
        """Return the side with the equation of a joint: (7) `at_motor` of a spring, else (8).

        None for a joint without a torque on the load side.
        """
        robot = self.robot
        if at_motor and joint in robot.elastic_joints:
            rows = stacked([actuator_regression(robot, x, joint) for x in self.motions])
            return Side(robot, self.motions, fit(rows, _WLS), (joint,), True, {})
        motions = self._loaded if at_motor else self.motions
        used = tuple(self.used)
        return Side(robot, motions, self.load, used, False, {}) if joint in used else None

    def with_term(self, term: TermComparison) -> _Model:
        """Return the model with a selected term, near the best values of its comparison."""
        drive = with_term(self.robot.drives[term.joint], term.field, term.term)
        if term.term == "coulomb_position":
            middle = reference_position(self.motions, self.robot.index(term.joint))
            drive = replace(drive, reference_position_rad=middle)
        joints = (term.joint,) if drive.is_elastic and term.field in AT_THE_MOTOR else ()
        near = self.with_drives({term.joint: drive.with_values(term.values)})
        model = linearised(near, joints)
        searched = model.robot.drives[term.joint]
        missing = {*searched.parameter_names} - {*searched.values}
        if term.field == "spring" and "stiffness" in missing:
            raise IdentificationError(
                f"joint '{term.joint}': with '{term.term}' its stiffness is not positive"
            )
        if term.term in WARM_UP and not drive.is_elastic:  # the steps of its grid are wide
            model = linearised_load(model)
        model = model.with_drives({term.joint: _fixed(model.robot.drives[term.joint])})
        needs_torque = term.term == "load" and not drive.is_elastic
        return replace(model, datasets=self._loaded) if needs_torque else model


def _fixed(drive: Drive) -> Drive:
    """Return a stiff drive with its nonlinear parameters, those with starts of a search, known.

    A search of the load side takes long, one of an actuator side does not.
    """
    if drive.is_elastic:
        return drive
    shapes = (name for name in drive.parameter_names if parameter_named(name).starts)
    more = [name for name in shapes if name in drive.values and name not in drive.known]
    return replace(drive, known=(*drive.known, *more))


_WLS = estimator_named("wls")


def _compared(
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
    reason, trials = _NO_COLUMN, list[engine.Trial]()
    try:
        candidates = term_candidates(drive, terms, grids)
        trials = engine.compared_candidates(engine.equation_of(fitted), candidates, count)
    except IdentificationError as problem:  # too few rows
        reason = str(problem)
    compared = {trial.candidate.name: trial for trial in trials}
    return [
        TermComparison(drive.joint, *name, step, trial.comparison, values=trial.alternative.values)
        if (trial := compared.get((drive.joint, *name)))
        else TermComparison(drive.joint, *name, step, None, reason)
        for name in terms
    ]


_NO_COLUMN = "it has no column: the log lacks its equation, or the fit the stiffness of the spring"


def _compared_terms(
    model: _Model, joint: str, asked: Mapping[str, Sequence[str]], count: int, step: int
) -> list[TermComparison]:
    """Return the comparison of each term that a drive lacks, can have, and has equations for."""
    compared: list[TermComparison] = []
    for at_motor in (True, False):
        fields = {field: of for field, of in asked.items() if (field in AT_THE_MOTOR) == at_motor}
        terms = list(possible_terms(model.robot.drives[joint], fields))
        larger = {term: model.larger(joint, *term) for term in terms}
        unseen = {x: reason for x, y in larger.items() for reason in missing_reversals(y, [joint])}
        compared += [TermComparison(joint, *term, step, None, why) for term, why in unseen.items()]
        terms = [term for term in terms if term not in unseen]
        side = model.side(joint, at_motor) if terms else None
        if side is not None:
            drive = side.drive(joint, at_joint=not at_motor)
            tried = _compared(drive, side.fitted, terms, count, step)
            searched = partial(_with_searched_zone, model, drive, side.fitted, count)
            compared += map(searched, tried)
    return compared


def _with_searched_zone(
    model: _Model, drive: DriveRows, fitted: FittedRows, count: int, term: TermComparison
) -> TermComparison:
    """Return the comparison of a sharp dead zone of an elastic drive at its searched values.

    Next to a stiff contact the deflection beyond the zone is a small part of it: an error of its
    width by a tenth, as that of a grid, is half of that deflection, and a cubic spring fits better.
    """
    is_elastic = drive.robot.drives[term.joint].is_elastic
    if term.term != "dead_zone" or not is_elastic or _explained(term) <= 0:
        return term
    larger = model.larger(term.joint, term.field, term.term)
    try:
        values = linearised(larger, (term.joint,)).robot.drives[term.joint].values
    except IdentificationError:
        return term
    grid = {name: (values[name],) for name in ("dead_zone", "deflection_zero") if name in values}
    (searched,) = _compared(drive, fitted, [(term.field, term.term)], count, term.step, grid)
    return searched if _explained(searched) > _explained(term) else term


def _explained(term: TermComparison) -> float:
    return term.comparison.explained if term.comparison is not None else 0.0


DEFAULTS = ("offset", "smooth_coulomb")
"""Friction terms that a drive gets by itself where the data support them."""

MOST_ROUNDS = 4
"""Largest number of fits with more terms of drives whose friction nobody named."""


def with_default_terms(
    robot: Robot, nominal: Robot, selected: Sequence[SideSelection]
) -> tuple[Robot, Robot, list[Finding]]:
    """Return the robot and the nominal one with supported `DEFAULTS`, and a note on each term.

    `nominal` is the robot before the search of nonlinear values. Only drives whose friction nobody
    named get terms. An offset is added if the data support it, smooth Coulomb friction only if it
    is the best supported trial of its joint; its width is then a known value. Trials of other terms
    compete to be the best, and do not count in the penalty.
    """
    of_joint = _trials_without_named_friction(robot, selected)
    # Every default term is tried at each drive.
    penalty = 2 * math.log(max(len(DEFAULTS) * len(of_joint), 1))
    drives: dict[str, Drive] = {}
    notes = []
    for joint, trials in of_joint.items():
        # `bic` is the decrease of the criterion, the larger the better. A penalty for the number of
        # trials reduces it: the best of many is better by chance.
        compared = [
            replace(trial, comparison=replace(trial.comparison, bic=trial.comparison.bic - penalty))
            for trial in trials
        ]
        best = best_trial(compared)
        for trial in compared:
            term, values = trial.candidate.term, trial.alternative.values
            is_added = term == "offset" or (trial is best and term in DEFAULTS)
            if is_added and trial.comparison.is_supported_overall:
                drive = with_term(drives.get(joint, robot.drives[joint]), "friction", term)
                drive = drive.with_values(values)
                friction, known = DefaultTerms(drive.friction), (*drive.known, *values)
                drives[joint] = replace(drive, friction=friction, known=known)
                notes.append(included_term(trial))
    if drives:
        robot, nominal = robot.with_drives(drives), nominal.with_drives(drives)
    return robot, nominal, notes


def _trials_without_named_friction(
    robot: Robot, selected: Sequence[SideSelection]
) -> dict[str, list[Trial]]:
    """Return the first trials of friction and springs where nobody named the friction, by joint."""
    trials: dict[str, list[Trial]] = {
        # The terms of drives that share parameters stay the same ones.
        joint: []
        for joint, x in robot.drives.items()
        if isinstance(x.friction, DefaultTerms) and not x.shared
    }
    for trial in (trial for side in selected for trial in side.selection.first):
        candidate = trial.candidate
        if candidate.joint in trials and candidate.field in ("friction", "spring"):
            trials[candidate.joint].append(trial)
    return trials
