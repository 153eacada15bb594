"""How much of the torques the identified model explains, and the verdict on the result.

The model of a joint is compared with what the same rows can do: a constant torque, and the nominal
bodies of the robot file. The error is given for the own logs, and for blocks of them that were
excluded from the fit.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from seaid._arrays import Array, BoolArray, FrozenMapping, safely
from seaid._progress import Display
from seaid.checks import tolerances as tol
from seaid.checks.codes import CODES, as_note, excluding_torque
from seaid.checks.engine import Check, guarded, observed
from seaid.checks.experiment import Experiment
from seaid.errors import Finding, IdentificationError, Severity, listed
from seaid.estimation import Estimate, FittedRows, qr_factor
from seaid.estimation.covariance import row_step
from seaid.regressor import BaseParameters, Regression
from seaid.regressor.base import regressor_at_drives
from seaid.robot import BASE_ROWS

Level = Literal["good", "usable with care", "do not use"]

Errors = Mapping[int, float]
"""{equation: error}."""

NAN = float("nan")


@dataclass(frozen=True)
class JointCheck:
    """What the logs say of one joint, NaN where they cannot.

    Attributes
    ----------
    swing : float
        Range of the position [rad or m].
    encoder_slope : float
        Motor angle per joint angle over the gear ratio: 1 for a right set-up.
    nominal, bodies, motor : float
        Share (rms) of the torque that is left by the bodies of the robot file, by any bodies, and
        by the motor equation (7) of a spring joint, where the motor moves: its friction at
        standstill is anything up to that of Coulomb.
    gear_ratio, gear_ratio_error : float
        Gear ratio between both encoders, without the deflection of a spring, and standard error.
    delay_s, delay_error_s : float
        Delay of the motor torque against the motion and its standard error.
    """

    swing: float
    encoder_slope: float = NAN
    nominal: float = NAN
    bodies: float = NAN
    motor: float = NAN
    gear_ratio: float = NAN
    gear_ratio_error: float = NAN
    delay_s: float = NAN
    delay_error_s: float = NAN


@dataclass(frozen=True, repr=False)
class JointFit(Display):
    """Errors of the torques of one joint, over the rms of their deviation from the mean.

    Attributes
    ----------
    own, blocks : float
        Error on the load side: of the own logs, and of blocks that were excluded from the fit.
    motor : float
        Error of the motor equation (7) of a spring joint; NaN without one.
    identified, nominal : float
        Error of the identified bodies and of the nominal ones of the robot file with any friction,
        against the torque of the motor, or of the sensor at the joint.
    """

    own: float
    blocks: float
    motor: float = NAN
    identified: float = NAN
    nominal: float = NAN

    @property
    def is_exact(self) -> bool:
        """Whether neither error matters."""
        return not max(self.own, self.motor) > tol.NEGLIGIBLE  # `motor` is NaN without a spring


@dataclass(frozen=True, repr=False)
class Verdict(Display):
    """Whether to use a result.

    Attributes
    ----------
    level : {"good", "usable with care", "do not use"}
        The words with which the sentence begins, by the worst severity of the warnings: notes
        only, "doubtful", or "wrong".
    sentence : str
        The level and its reasons.
    joints : mapping {joint: JointFit}
        How much of the torque of each joint the model explains.
    """

    level: Level
    sentence: str
    joints: Mapping[str, JointFit]


# The verdict


_LEVELS: dict[Severity, Level] = {"wrong": "do not use", "doubtful": "usable with care"}
"""{severity: level}, the worst first."""


def verdict_of(warnings: Sequence[Finding], joints: Mapping[str, JointFit]) -> Verdict:
    """Return the verdict that follows from the warnings of a result."""
    loads = _load_sides(warnings, joints)
    if loads:
        return Verdict("do not use", loads, joints)
    for severity, level in _LEVELS.items():
        reasons: dict[str, dict[str, None]] = {}  # {code: its joints}
        for finding in _of_severity(severity, warnings):
            reasons.setdefault(finding.code, {})[finding.joint] = None
        if reasons:
            names = (code + _in_brackets(filter(None, named)) for code, named in reasons.items())
            what = " this result" if severity == "wrong" else ""
            return Verdict(level, f"{level}{what}: {', '.join(names)}", joints)
    unknown = {
        finding.joint: None
        for finding in warnings
        if finding.code == "poorly-identified"
        and finding.evidence.get("standard error", 0) >= abs(finding.evidence.get("value", 1))
    }
    but = f", but drives have errors of 100% and more: {listed(unknown, 2 * tol.MOST_ALIKE)}"
    sentence = "good: no warning contradicts the set-up or the model"
    return Verdict("good", sentence + but * bool(unknown), joints)


def not_validated(is_unseen: bool, reasons: Iterable[str], own: Iterable[str]) -> Iterator[Finding]:
    """Yield what a result was not validated on: an unseen motion at all, and logs that were named.

    `reasons` are why some of these were not used, `own` the names of those that it was fitted to.
    """
    code = CODES["not-validated"]
    yield from (code.finding("unused", "", {"reason": reason}) for reason in reasons)
    yield from (code.finding("own-log", "", {"name": name}) for name in own)
    if not is_unseen:
        yield code.note("unseen")


def _of_severity(severity: Severity, findings: Iterable[Finding]) -> list[Finding]:
    return [finding for finding in findings if finding.severity == severity]


def _in_brackets(joints: Iterable[str]) -> str:
    names = listed(joints, 2 * tol.MOST_ALIKE)
    return f" ({names})" if names else ""


def _load_sides(warnings: Sequence[Finding], joints: Mapping[str, JointFit]) -> str:
    """Return the sentence if only the torques of some joints are wrong, "" otherwise.

    It names load sides of springs, and less than half of the joints otherwise.
    """
    wrong = _of_severity("wrong", warnings)
    names = [*dict.fromkeys(finding.joint for finding in wrong)]
    if {finding.code for finding in wrong} != {"no-fit"} or not {*names} <= {*joints}:
        return ""
    motors = np.array([joints[joint].motor for joint in names])
    masks = np.isnan(motors), np.isfinite(motors), motors < tol.MOST
    stiff, springs, driven = (np.array(names)[mask].tolist() for mask in masks)
    if 2 * len(stiff) >= len(joints):
        return ""
    doubtful = _of_severity("doubtful", warnings)
    parts = [f"do not use the load side of {listed(springs)}: no-fit"] * bool(springs)
    parts += [f"do not use the torque of {listed(stiff)}: no-fit"] * bool(stiff)
    parts += [f"the drive of {joint} is {_care(doubtful, [joint])}" for joint in driven]
    others = {finding.joint for finding in doubtful}.difference(names)
    return "; ".join(parts + [f"the rest is {_care(doubtful, others)}"] * bool(stiff))


def _care(doubtful: Sequence[Finding], joints: Collection[str]) -> str:
    codes = dict.fromkeys(finding.code for finding in doubtful if finding.joint in joints)
    return f"usable with care: {', '.join(codes)}" if codes else "good"


# How much of the torques the model explains


@dataclass(frozen=True)
class Contact:
    """Times [s] of a log, by its `run` in the rows, at which something touches the robot.

    It begins and ends softly, within `softly_s`; `joints` are those that feel it.
    """

    run: int
    start_s: float
    end_s: float
    softly_s: float
    joints: tuple[str, ...]

    def touches(self, rows: Regression) -> BoolArray:
        """Return the mask (R,) of the rows from its soft beginning to its soft end."""
        is_after = rows.time >= self.start_s - self.softly_s
        is_before = rows.time <= self.end_s + self.softly_s
        return np.asarray((rows.run == self.run) & is_after & is_before)


@dataclass(frozen=True, eq=False)
class RobotFit:
    """The fit of a robot, and how much of its torques it explains.

    `fit` is that of the load side, or of both sides at once; `joints` {joint: its errors}, or those
    of the rows of a floating base where no joint has a torque. `residual` is the norm of the
    residual of all joints over that of their torques without contact forces, of a floating base, in
    the own logs and in excluded blocks. `rows_per_parameter` are the independent ones, infinite
    without blocks; `predicted` are the errors of other motions by joint, and `beyond` the torques
    of the identified bodies over those of the robot file, or over those measured if these are
    larger. `own` (R,) are the rows of the logs concerned, None for all; `weak` are joints whose
    spring is hardly loaded, `lacking` those whose motor equation lacks a term. `logs` {run of the
    rows: number of its log, from 1} name the logs. `notes` are on checks that could not be made.
    """

    joint_names: tuple[str, ...]
    fit: FittedRows
    joints: Mapping[str, JointFit] = FrozenMapping({}, "joint")
    residual: tuple[float, float] = (NAN, NAN)
    rows_per_parameter: float = float("inf")
    own: BoolArray | None = None
    weak: Collection[str] = ()
    lacking: Collection[str] = ()
    predicted: Mapping[str, float] = FrozenMapping({}, "joint")
    beyond: Mapping[str, float] = FrozenMapping({}, "joint")
    logs: Mapping[int, int] = field(default_factory=dict)
    notes: Sequence[Finding] = ()

    @property
    def rows(self) -> Regression | None:
        """The own rows, if they are in memory."""
        rows = self.fit.rows
        return rows if rows is None or self.own is None else rows.at(self.own)

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts, at most one of a log.

        A contact pulls the fit towards itself: the rows of suspicious windows are predicted by a
        fit of the others, in units of the error of a prediction. That counts if it shows at two
        joints. Bursts that are scattered come from a friction that the model lacks.
        """
        rows = self.rows
        if rows is None:
            return ()
        # A window has at least one independent row of each joint.
        instants = np.unique(rows.time[rows.run == rows.run[0]])
        window_s = max(tol.WINDOW_S, tol.CORRELATED_ROWS * row_step(instants))
        residual = _beyond_friction(rows, self.fit, rows.y - rows.H @ self.fit.estimate.values)
        bursts = _bursts(self.joint_names, rows, residual, tol.BURST, window_s)
        suspects = _bursts(self.joint_names, rows, residual, tol.SURE, window_s)
        window, apart = np.floor(rows.time / window_s), np.zeros(len(rows.y), dtype=bool)
        for run, windows in suspects.items():
            apart |= (rows.run == run) & np.isin(window, list(windows))
        if np.any(apart) and np.mean(apart) < tol.RARE:
            places = np.searchsorted(self.fit.qr_factor.equations, rows.joint)
            weight = np.asarray(self.fit.weights)[places]
            columns, y = weight[:, None] * rows.H, weight * rows.y
            deleted = qr_factor.deleted_residual(columns, y, apart, tol.CORRELATED_ROWS)[0]
            deleted = _beyond_friction(rows, self.fit, deleted / weight)
            others = _bursts(self.joint_names, rows, deleted, tol.BURST, window_s)
            bursts |= {run: x for run, x in others.items() if len(set().union(*x.values())) > 1}
        # One contact has at least half of the windows from its start to its end.
        if any(max(x) + 1 - min(x) > 2 * len(x) for x in bursts.values()):
            return ()
        contacts = list[Contact]()
        for run, windows in sorted(bursts.items()):
            joints = sorted(set().union(*windows.values()), key=self.joint_names.index)
            start_s, end_s = min(windows) * window_s, (max(windows) + 1) * window_s
            contacts.append(Contact(run, start_s, end_s, window_s, tuple(joints)))
        return tuple(contacts)


def robot_fit(
    bare: RobotFit,
    actuators: Mapping[str, FittedRows],
    experiment: Experiment,
    bodies: Array,
    locked: Collection[str],
    base: BaseParameters,
    load: Estimate,
) -> RobotFit:
    """Return how much of the torques of all joints with rows in memory a `bare` fit explains.

    `actuators` are the fits of motor equations; `bodies` (10n,) the identified standard parameters
    with the payloads; `experiment` is what has the own rows. Load sides of `locked` joints are
    unknown, NaN. Errors of other motions are those of the `base` parameters of a `load` side.
    """
    fit, rows, names = bare.fit, bare.rows, bare.joint_names
    if rows is None or fit.rows is None:
        return bare
    notes, whole = list[Finding](), bare
    with guarded(CODES["no-fit"], notes):
        (targets, count), sizes = _blocks(fit), _load_sizes(experiment, bodies)
        computed = rows.H @ fit.estimate.values
        predicted = targets if bare.own is None else targets[bare.own]
        errors, blocks = (_errors(rows, each, sizes) for each in (computed, predicted))
        moving = experiment.in_motion
        misfits = np.column_stack([moving.of_bodies(bodies), moving.nominal])
        misfits[moving.is_unscaled] = NAN  # torques by the bodies of the file agree with these
        of_bodies, motors = dict(zip(names, misfits.tolist(), strict=True)), dict[int, float]()
        for side in actuators.values():
            if side.rows is not None:
                motors |= _errors(side.rows, side.rows.H @ side.estimate.values, {})
        joints = _joint_fits(rows.joint_names, errors, blocks, motors, of_bodies)
        joints |= {x: JointFit(NAN, NAN, joints[x].motor) for x in joints if x in locked}
        residual = NAN, NAN
        if not experiment.robot.base_is_held:
            residual = _whole(rows, computed, joints), _whole(rows, predicted, joints)
        fits = FrozenMapping(joints, "joint")
        whole = replace(bare, joints=fits, residual=residual, rows_per_parameter=count)
        # a base that moves has no sizes, and no torques of the robot file
        both = (experiment.target, experiment.of_file) if sizes else ()
        beyond = {names[j]: x / max(float(np.std(y[:, j])) for y in both) for j, x in sizes.items()}
        whole = replace(whole, beyond=beyond)
    with guarded(CODES["few-rows"], notes):
        whole = replace(whole, predicted=_prediction_errors(experiment, base, load))
    return replace(whole, notes=notes)


def _joint_fits(
    names: Sequence[str], own: Errors, blocks: Errors, motors: Errors, of_bodies: Mapping[str, Any]
) -> dict[str, JointFit]:
    """Return the errors of joints, or of the rows of a base where no joint has a torque.

    They are those of the own logs, of excluded blocks and of motor equations; `of_bodies`
    {joint: errors of the identified and of the nominal bodies}.
    """
    fits = {
        names[j]: JointFit(error, blocks[j], motors.get(j, NAN), *of_bodies.get(names[j], ()))
        for j, error in own.items()
    }
    return {x: fit for x, fit in fits.items() if x in of_bodies} or fits


def _whole(rows: Regression, computed: Array, joints: Collection[str]) -> float:
    """Return the norm of the error of the rows of joints over that of their targets."""
    some = np.isin(rows.joint, [j for j, name in enumerate(rows.joint_names) if name in joints])
    size = float(np.linalg.norm(rows.y[some]))
    return float(np.linalg.norm((rows.y - computed)[some])) / size if size else NAN


def _load_sizes(experiment: Experiment, bodies: Array) -> Errors:
    """Return {equation: rms of a torque without its mean} that is not in the y of the rows, (8).

    That is the torque of all bodies, of which known ones and payloads are not in y, and with
    measured wrenches that of the joint, of which they leave little.
    """
    robot, target = experiment.robot, experiment.target
    if experiment.has_wrenches:
        logged = np.flatnonzero(np.all(np.isfinite(target), axis=0)).tolist()
        return {j: float(np.std(target[:, j])) for j in logged}
    if not robot.base_is_held or not np.all(np.isfinite(bodies)):
        return {}
    return dict(enumerate(np.std(experiment.regressor @ bodies, axis=0).tolist()))


def _errors(rows: Regression, computed: Array, least: Errors) -> Errors:
    """Return the rms of the error over that of the torque without its mean, not below `least`."""
    errors = {}
    for equation in np.unique(rows.joint).astype(int).tolist():
        of_equation = rows.joint == equation
        size = max(float(np.std(rows.y[of_equation])), least.get(equation, 0.0), tol.LEAST)
        rms = float(np.sqrt(np.mean((rows.y[of_equation] - computed[of_equation]) ** 2)))
        errors[equation] = rms / size
    return errors


def _blocks(fit: FittedRows) -> tuple[Array, float]:
    """Return the targets (R,) of blocks of the rows, each predicted by the fit of the others.

    They are NaN if there are too few rows for them. The second value are the independent rows per
    parameter, by how much farther blocks are from the fit of all, in each direction of the
    parameters, than in white noise.
    Directions of the parameters that a block alone determines, such as the mass at a foot that is
    in the air once, are those of the fit of all: the others predict nothing of them.
    """
    rows = fit.rows
    assert rows is not None
    try:
        masks = qr_factor.time_blocks(rows)
    except IdentificationError:  # too few rows
        return np.full(len(rows.y), NAN), float("inf")
    factors = [
        part.weighted_factor(fit.weights[np.searchsorted(fit.qr_factor.equations, part.equations)])
        for part in [qr_factor.qr_factor_of(rows.at(mask)) for mask in masks]
    ]
    R = qr_factor.triangle(np.concatenate(factors))
    svd = qr_factor.scaled_svd(R[:, :-1])
    theta, kept = svd.solve(R[:, -1]), svd.rank()
    # (H^T H)^+ = root root^T: in the coordinates z of theta = root z the columns are orthonormal.
    root = (svd.vectors[:kept] / svd.norms).T / svd.sizes[:kept]
    targets, scores = np.empty(len(rows.y)), []
    for mask, factor in zip(masks, factors, strict=True):
        # X^T X of all blocks is 1, of this one V S V^T: white noise leaves V^T X^T e the variances
        # S (1 - S), and the fit of the others differs from that of all by -(1 - V S V^T)^-1 X^T e
        X = factor[:, :-1] @ root
        shares, V = safely(np.linalg.eigh, X.T @ X, what="a block of the logs")
        gradient = V.T @ (X.T @ (factor[:, -1] - factor[:, :-1] @ theta))
        variance = shares * (1 - shares)
        real = variance > qr_factor.RANK_TOLERANCE
        scores.append(gradient[real] ** 2 / variance[real])
        change = np.where(1 - shares > tol.POOR, gradient / np.maximum(1 - shares, tol.POOR), 0.0)
        targets[mask] = rows.H[mask] @ (theta - root @ (V @ change))
    score, squares = np.concatenate(scores), np.sum((R[:, -1] - R[:, :-1] @ theta) ** 2)
    if not np.sum(score) > 0:  # each direction is determined by a block alone
        return targets, float("inf")
    # of n independent rows the residuals have (1 - kept / n) of the variance of the noise
    return targets, 1 + float(squares / np.mean(score)) / kept


def _beyond_friction(rows: Regression, fit: FittedRows, residual: Array) -> Array:
    """Return a residual (R,), of joints that move slowly beyond their Coulomb friction.

    There the friction may have any value up to that, as of a joint at rest.
    """
    beyond, sizes, place = residual.copy(), np.abs(rows.H), rows.names.index
    for joint, friction in fit.estimate.by_owner().items():
        if {"viscous_friction", "coulomb_friction"} <= {*friction.names}:
            viscous = sizes[:, place(f"viscous_friction of {joint}")]
            coulomb = sizes[:, place(f"coulomb_friction of {joint}")]
            # the columns are zero in the rows of other joints
            is_slow = (viscous > 0) & (viscous < tol.POOR * np.max(viscous))
            most = np.max(coulomb) * abs(friction.value("coulomb_friction"))
            beyond[is_slow] -= np.clip(residual[is_slow], -most, most)
    return beyond


def _bursts(
    joint_names: Sequence[str], rows: Regression, residual: Array, times: float, window_s: float
) -> dict[int, dict[int, set[str]]]:
    """Return {run: {window: joints whose residual exceeds that of their median window}}.

    Windows are numbered from the time zero of each log.
    """
    bursts: dict[int, dict[int, set[str]]] = {}
    for j, joint in enumerate(joint_names):
        for run in np.unique(rows.run[rows.joint == j]).astype(int).tolist():
            of_run = (rows.joint == j) & (rows.run == run)
            window = np.floor(rows.time[of_run] / window_s)
            starts, place, counts = np.unique(window, return_inverse=True, return_counts=True)
            size = np.sqrt(np.bincount(place, residual[of_run] ** 2) / counts)
            least = tol.SLIGHT * float(np.std(rows.y[of_run]))
            # The median, because a contact has few of the windows and would enlarge a mean.
            far = size > max(times * float(np.median(size)), least)
            if len(size) >= 8 and np.sum(far) > 1 and np.mean(far) < tol.RARE:
                for start in starts[far].astype(int).tolist():
                    bursts.setdefault(run, {}).setdefault(start, set()).add(joint)
    return bursts


# What a fit shows


def _percent(part: float) -> str:
    return f"{part:.0%}" if part * tol.POOR < 1 else f"over {1 / tol.POOR:.0%}"


def _unexplained(whole: RobotFit) -> Iterator[Finding]:
    """Yield the joints whose torque the model does not explain."""
    for joint, fit in whole.joints.items():
        error = fit.blocks if np.isfinite(fit.blocks) else fit.own
        if error > tol.NOTHING or (min(error, fit.own) > tol.MOST and joint not in whole.weak):
            yield _misfit(whole, joint, error)
        elif fit.nominal < tol.MOST**0.5 * fit.identified and fit.identified > tol.POOR:
            evidence = {"identified bodies": fit.identified, "nominal bodies": fit.nominal}
            yield CODES["no-fit"].finding("better-by-file", joint, evidence)
        if (times := whole.beyond.get(joint, NAN)) > tol.MANY_TIMES:
            # What cancels such a torque stands, as it does, for something that the model lacks.
            beyond = {"torque of the bodies over the usual one": times}
            yield CODES["no-fit"].finding("cancelled", joint, beyond, is_worse=times > tol.FAR)


def _misfit(whole: RobotFit, joint: str, error: float) -> Finding:
    """Return the finding on a joint of which the model lacks all or much, by its `error`."""
    fit, excluded = whole.joints[joint], (joint, *BASE_ROWS)
    kept = [x for x, each in whole.joints.items() if x not in excluded and each.own < tol.NOTHING]
    evidence = {"error": fit.own, "error of excluded blocks": fit.blocks, "error of blocks": error}
    words = {"own": _percent(fit.own), "blocks": _percent(error), "kept": excluding_torque(kept)}
    words |= {"of": f"the torque on the load of {joint}", "force": "torque", "holds": ""}
    words["terms"] = ", or remove terms of this drive"
    if fit.motor < tol.MOST:
        words["holds"] = f"; its motor equation holds, with an error of {fit.motor:.1%}"
    case = "nothing" if error > tol.NOTHING else "much"
    case = "own-logs" if fit.own <= tol.MOST else case
    if joint in BASE_ROWS:
        words |= {"of": f"the {joint}", "force": "force", "terms": ""}
        case = {"much": "much-force", "nothing": "nothing-force"}.get(case, case)
    return CODES["no-fit"].finding(case, joint, {**evidence, **words})


def _contacts(whole: RobotFit) -> Iterator[Finding]:
    """Yield the times at which residuals of several windows are far beyond those of the others.

    The torque of a spring by another law than its own looks so where its deflection is large.
    """
    for contact in whole.contacts:
        several = len(set(whole.logs.values())) > 1
        log = f"log {whole.logs[contact.run]}" if several else "the log"
        start, end, joints = contact.start_s, contact.end_s, contact.joints
        softly = f"{max(start - contact.softly_s, 0):.3f}, {end + contact.softly_s:.3f}"
        words = {"of_log": f" of {log}" * several, "times": f"{tol.BURST:g}"}
        evidence = {"start [s]": start, "end [s]": end, "joints": ", ".join(joints), **words}
        remedy = f"in the description of {log}:\nexclude_s = [[{softly}]]"
        finding = CODES["contact"].finding("far", joints[0], evidence, remedy, joints=joints)
        yield as_note(finding) if {*joints} <= {*whole.lacking} else finding


def _few_rows(whole: RobotFit) -> Iterator[Finding]:
    """Yield that blocks of the logs contradict each other as so few independent rows do."""
    has_fit = any(tol.NEGLIGIBLE < each.blocks <= tol.NOTHING for each in whole.joints.values())
    error, count = float(np.median([*whole.predicted.values()] or [0.0])), whole.rows_per_parameter
    # nothing is predicted of a floating base
    fewest = tol.FEWEST_BY_BLOCKS if whole.predicted else tol.FEWEST_INDEPENDENT
    is_unclear = error > tol.POOR and count < tol.TWICE * fewest
    if has_fit and (count < fewest or is_unclear) and not whole.contacts:
        evidence = {"independent rows per parameter": count, "error in other motions": error}
        unseen = f", and the torques of other motions have standard errors of {error:.0%} of them"
        words = {"unseen": unseen * is_unclear}
        yield CODES["few-rows"].finding("blocks", "", {**evidence, **words})


OF_FIT = (
    Check(CODES["no-fit"], (), _unexplained),
    Check(CODES["contact"], (), _contacts),
    Check(CODES["few-rows"], (), _few_rows),
)


def _prediction_errors(
    experiment: Experiment, base: BaseParameters, estimate: Estimate
) -> Mapping[str, float]:
    """Return {joint: standard error of the torque of its bodies in other motions, over its size}.

    In these, each joint has the states of the log at other times than the others have theirs.
    """
    robot, count = experiment.robot, experiment.joint.shape[1]
    if not robot.base_is_held or not base.columns:
        return {}
    # Other postures with the speeds of the log: the joints' states are shifted in time by k T / n.
    shifts = [place * count // robot.n for place in range(robot.n)]
    states = [np.roll(experiment.joint[:, :, j], shift, axis=1) for j, shift in enumerate(shifts)]
    H = base.reduce(regressor_at_drives(robot, *np.stack(states, axis=2)))
    p = H.shape[2]
    # The mean of h C h^T over the instants, joint by joint.
    variance = np.einsum("rjp,pq,rjq->j", H, estimate.covariance[:p, :p], H) / count
    sizes = np.std(H @ estimate.values[:p], axis=0)
    moved = np.flatnonzero(sizes > qr_factor.RANK_TOLERANCE * np.max(sizes, initial=0.0)).tolist()
    return {robot.joint_names[j]: float(np.sqrt(variance[j]) / sizes[j]) for j in moved}


def fit_findings(fit: RobotFit) -> list[Finding]:
    """Return what the fit of a robot shows: torques without a model, contacts, too few rows."""
    return [*observed(OF_FIT, fit), *fit.notes]
