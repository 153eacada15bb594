"""How much of the torques the identified model explains, and the verdict on the result.

The model of a joint is compared with what the same rows can do: a constant torque, and the nominal
bodies of the robot file. The error is given for the own logs, and for blocks of them that were
excluded from the fit.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, Literal

import numpy as np

from seaid._arrays import Array, BoolArray, FrozenMapping, safely
from seaid._files import toml_text
from seaid._progress import Display
from seaid.errors import Finding, IdentificationError, SeaidError, Severity, listed
from seaid.estimation import (
    FEWEST_INDEPENDENT,
    RANK_TOLERANCE,
    FittedRows,
    qr_factor_of,
    row_step,
    scaled_svd,
    time_blocks,
    triangle,
)
from seaid.regressor import INPUT_FIELDS, motor_regressor
from seaid.robot import BASE_ROWS

if TYPE_CHECKING:
    from seaid.checks import Experiment
    from seaid.identification.identification import Identification
    from seaid.identification.two_step import RobotEstimate
    from seaid.regressor import Regression

Level = Literal["good", "usable with care", "do not use"]

NOTHING, PART = 0.9, 0.5
"""Error of excluded blocks, over that of a constant torque, from which a model is of no use;
if it is below the second one in the own logs, it fits these only. Where both errors are between
them, the model lacks much. A motor equation whose error is below the second one holds."""

_BETTER, _MATTERS = 0.7, 0.1
"""The nominal bodies are better if their error is below this multiple of that of the
identified ones, and that is a part of the torque that matters."""

_BURST, _WINDOW_S, _MOST_BURSTS, _LEAST_BURST, _SCATTERED = 6.0, 0.25, 0.2, 0.05, 2.0
"""A contact is where the residual of a window exceeds so many times that of the median window
(rms), unless it does so in more than a part of the windows, is a small part of the torque, or is
scattered over so many times as many windows. A window has at least one independent row."""

_SUSPECT, _CORRELATED = 3.0, 4.0
"""Multiple of the median window from which windows are predicted by the others; rows per
independent one."""


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
    motor: float
    identified: float
    nominal: float


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


def consequences(setup: Sequence[Finding], found: Iterable[Finding]) -> list[Finding]:
    """Return findings about a fit: mere notes if the set-up is already known to be wrong."""
    return [replace(one, severity="note") if is_wrong(setup) else one for one in found]


_ECHOES = (
    *("nonlinear-spring", "missing-term", "transmission-error", "estimator-disagrees"),
    "drift",
)
"""Findings that noise alone raises where the deflection of a spring is mostly noise."""

_SYMPTOMS = ("weak-spring", "loose-encoder", "backlash", "nonlinear-spring")
"""What a drive looks like whose equation lacks a term, of friction for instance."""


_NEGLIGIBLE = 0.003
"""Error of a torque below which what the model lacks does not matter."""


def without_echoes(
    findings: Sequence[Finding], fits: Mapping[str, JointFit] = FrozenMapping({})
) -> list[Finding]:
    """Return findings without those that follow from another finding of their joint.

    What explains most of the squared residual of a joint, more than half, is no echo, and its
    symptoms are. Without it a weak spring, or backlash, has echoes. What a model lacks is a note
    where its torque errors do not matter.
    """
    parts = sorted((one.evidence.get("explained", 0.0), n) for n, one in enumerate(findings)
                   if one.severity != "note")  # fmt: skip
    explaining = {findings[n].joint: findings[n] for part, n in parts if part > 0.5}
    weak = {one.joint for one in findings if one.code == "weak-spring"}
    loose = {one.joint for one in findings if one.code == "backlash"}
    echoes = {**dict.fromkeys(_ECHOES, weak), "weak-spring": loose}
    echoes |= {code: {*echoes.get(code, ()), *explaining} for code in _SYMPTOMS}
    exact = {name for name, one in fits.items() if not max(one.own, one.motor) > _NEGLIGIBLE}
    return [
        replace(one, severity="note") if one.code in _ECHOES and one.joint in exact else one
        for one in findings
        if one is explaining.get(one.joint) or one.joint not in echoes.get(one.code, ())
    ]


def is_wrong(setup: Iterable[Finding]) -> bool:
    """Whether findings say that the set-up, and not only the model, is wrong."""
    return any(one.severity == "wrong" and one.code != "no-fit" for one in setup)


@contextmanager
def explained(findings: Sequence[Finding]) -> Iterator[None]:
    """Put before an error of seaid the finding that explains it: a wrong set-up, and its remedy."""
    try:
        yield
    except SeaidError as problem:
        wrong = [one for one in findings if one.severity == "wrong"]
        if not wrong:
            raise
        text = f"{wrong[0].code}: {wrong[0].message}; {wrong[0].remedy}\nand so: {problem}"
        problem.args = SeaidError(text).args
        raise


_OF_SEVERITY: tuple[tuple[Severity, Level, str], ...] = (
    ("wrong", "do not use", "do not use this result"),
    ("doubtful", "usable with care", "usable with care"),
)
"""(severity, level, how the sentence begins), the worst first."""


def verdict_of(warnings: Sequence[Finding], joints: Mapping[str, JointFit]) -> Verdict:
    """Return the verdict that follows from the warnings of a result."""
    loads = _load_sides(warnings, joints)
    if loads:
        return Verdict("do not use", loads, joints)
    for severity, level, start in _OF_SEVERITY:
        reasons = [one for one in warnings if one.severity == severity]
        if reasons:
            names = [
                f"{code} ({listed(own, _MOST_NAMED)})" if own else code
                for code in dict.fromkeys(one.code for one in reasons)
                for own in [
                    list(dict.fromkeys(x.joint for x in reasons if x.code == code and x.joint))
                ]
            ]
            return Verdict(level, f"{start}: {', '.join(names)}", joints)
    return Verdict("good", "good: no warning contradicts the set-up or the model", joints)


_MOST_NAMED = 6
"""Joints that the verdict names per code; the warnings name all."""


def _load_sides(warnings: Sequence[Finding], joints: Mapping[str, JointFit]) -> str:
    """Return the sentence if only the torques of some joints are wrong, "" otherwise.

    It names load sides of springs, and less than half of the joints otherwise.
    """
    wrong = [one for one in warnings if one.severity == "wrong"]
    motors = {one.joint: joints[one.joint].motor for one in wrong if one.joint in joints}
    if len(motors) < len({one.joint for one in wrong}) or any(x.code != "no-fit" for x in wrong):
        return ""
    stiff = [joint for joint, error in motors.items() if np.isnan(error)]
    if not motors or 2 * len(stiff) >= len(joints):
        return ""
    springs = [joint for joint in motors if joint not in stiff]
    found = [f"do not use the load side of {listed(springs)}: no-fit"] if springs else []
    found += [f"do not use the torque of {listed(stiff)}: no-fit"] if stiff else []
    doubtful = [one for one in warnings if one.severity == "doubtful"]
    for joint in (one for one in springs if motors[one] < PART):
        care = _care(one for one in doubtful if one.joint == joint)
        found.append(f"the drive of {joint} is {care}")
    if stiff:
        care = _care(one for one in doubtful if one.joint not in motors)
        found.append(f"the rest is {care}")
    return "; ".join(found)


def _care(doubts: Iterable[Finding]) -> str:
    codes = dict.fromkeys(one.code for one in doubts)
    return f"usable with care: {', '.join(codes)}" if codes else "good"


def joint_fits(
    joint_names: Sequence[str],
    found: RobotEstimate,
    given: Experiment,
    bodies: Array,
    own: BoolArray | None = None,
) -> tuple[FrozenMapping[JointFit], tuple[float, float], float]:
    """Return the errors of the torques of all joints with rows in memory; {} without any.

    Of a floating base the second result is the norm of the residual of all joints over that of
    their torques without contact forces, in the own logs and in excluded blocks; else it is NaN.
    The third one is the number of independent rows per parameter, infinite if there are no blocks.

    Where no joint has a torque they are those of the rows of a floating base. `bodies` (10n,) are
    the identified standard parameters with the payloads. `given` is what has the `own` (R,) rows of
    the fit, by default all.
    """
    rows, nothing = found.fit.rows, float("nan")
    if rows is None:
        return FrozenMapping({}, "joint"), (nothing, nothing), float("inf")
    n = len(rows.joint_names)
    theta = found.fit.estimate.values  # with those of torque offsets
    sizes = _load_sizes(rows, given, bodies)
    computed, by_blocks = rows.H @ theta, _blocks(found.fit)
    predicted = None if by_blocks is None else by_blocks.predicted
    if own is not None:
        rows, computed = rows.at(own), computed[own]
        predicted = None if predicted is None else predicted[own]
    errors = _errors(rows, computed, sizes)
    blocks = {} if predicted is None else _errors(rows, predicted, sizes)
    motors = {joint: _motor_error(joint, found, errors, n) for joint in joint_names}
    identified = given.of_bodies(bodies)
    fits = {
        joint: JointFit(
            own=errors[j],
            blocks=blocks.get(j, nothing),
            motor=motors[joint],
            identified=float(identified[j]),
            nominal=float(given.nominal[j]),
        )
        for j, joint in enumerate(joint_names)
        if j in errors
    }
    alone = {} if fits else {rows.joint_names[j]: j for j in errors if j < n}
    for row, j in alone.items():
        fits[row] = JointFit(errors[j], blocks.get(j, nothing), nothing, nothing, nothing)
    whole = (nothing, nothing)
    if given.robot.floating_base is not None:
        of_fits = np.isin(
            rows.joint, [j for j, name in enumerate(rows.joint_names) if name in fits]
        )
        whole = _whole(rows, computed, of_fits), _whole(rows, predicted, of_fits)
    per_parameter = float("inf") if by_blocks is None else by_blocks.rows_per_parameter
    return FrozenMapping(fits, "joint"), whole, per_parameter


def _whole(rows: Regression, computed: Array | None, some: BoolArray) -> float:
    """Return the norm of the error of some rows over that of what is computed; NaN without."""
    size = float(np.linalg.norm(rows.y[some]))
    if computed is None or size == 0.0:
        return float("nan")
    return float(np.linalg.norm((rows.y - computed)[some])) / size


def without_loads(fits: Mapping[str, JointFit], joints: Collection[str]) -> FrozenMapping[JointFit]:
    """Return the errors without those of the load sides of some joints, which are NaN then."""
    names, nothing = ("own", "blocks", "identified", "nominal"), float("nan")
    unknown = dict.fromkeys(names, nothing)
    changed = {
        joint: replace(one, **unknown) if joint in joints else one for joint, one in fits.items()
    }
    return FrozenMapping(changed, "joint")


def _motor_error(joint: str, found: RobotEstimate, errors: Mapping[int, float], n: int) -> float:
    if joint in found.actuators and found.actuators[joint].rows is not None:
        side = found.actuators[joint]
        assert side.rows is not None
        (error,) = _errors(side.rows, side.rows.H @ side.estimate.values).values()
        return error
    names = () if found.fit.rows is None else found.fit.rows.joint_names
    places = [j for j in errors if j >= n and names[j - n] == joint]
    return errors[places[0]] if places else float("nan")


def _load_sizes(rows: Regression, given: Experiment, bodies: Array) -> dict[int, float]:
    """Return {equation: rms of a torque without its mean} that is not in the y of the rows, (8).

    That is the torque of all bodies if some are known, and with measured wrenches that of the
    joint, of which they leave little.
    """
    robot = given.robot
    if given.has_wrenches:
        logged = np.flatnonzero(np.all(np.isfinite(given.target), axis=0))
        return {int(j): float(np.std(given.target[:, j])) for j in logged}
    is_free = robot.floating_base is not None
    if is_free or not robot.known_bodies or not np.all(np.isfinite(bodies)):
        return {}
    return dict(enumerate(np.std(given.regressor @ bodies, axis=0).tolist()))


def _errors(
    rows: Regression, computed: Array, sizes: Mapping[int, float] | None = None
) -> dict[int, float]:
    """Return {equation: rms of the error over that of the torque without its mean}.

    The latter is not below that in `sizes`.
    """
    found, least = {}, sizes or {}
    for equation in np.unique(rows.joint).tolist():
        mine = rows.joint == equation
        size = max(float(np.std(rows.y[mine])), least.get(equation, 0.0), 1e-300)
        found[int(equation)] = float(np.sqrt(np.mean((rows.y[mine] - computed[mine]) ** 2))) / size
    return found


def _percent(part: float) -> str:
    return f"{part:.0%}" if part < _ABSURD else f"over {_ABSURD:.0%}"


_ABSURD = 10.0
"""Error of a torque, over that of a constant, whose size says nothing more."""


_ALONE = 0.9
"""Part of the information on a direction of the parameters from which a block alone determines it.
The other blocks then predict it with ten times the variance of the noise, for an eighth with 1/7
of it."""


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Torques (R,) of blocks of the rows, each predicted by the fit of the others.

    `rows_per_parameter` are the independent ones, by how much farther blocks are from the fit of
    all, in each direction of the parameters, than in white noise.
    """

    predicted: Array
    rows_per_parameter: float


def _blocks(fit: FittedRows) -> _Blocks | None:
    """Return the predictions of blocks, None if there are too few rows for them.

    Directions of the parameters that a block alone determines, such as the mass at a foot that is
    in the air once, are those of the fit of all: the others predict nothing of them.
    """
    rows = fit.rows
    assert rows is not None
    try:
        masks = time_blocks(rows)
    except IdentificationError:  # too few rows
        return None
    parts = [qr_factor_of(rows.at(mask)) for mask in masks]
    weights = [
        fit.weights[np.searchsorted(fit.qr_factor.equations, one.equations)] for one in parts
    ]
    factors = [one.weighted_factor(own) for one, own in zip(parts, weights, strict=True)]
    R = triangle(np.concatenate(factors))
    svd = scaled_svd(R[:, :-1])
    theta, kept = svd.solve(R[:, -1]), svd.rank()
    root = (svd.vectors[:kept] / svd.norms).T / svd.sizes[:kept]
    computed, scores = np.empty(len(rows.y)), []
    for mask, factor in zip(masks, factors, strict=True):
        # X^T X of all blocks is 1, of this one V S V^T: white noise leaves V^T X^T e the variances
        # S (1 - S), and the fit of the others differs from that of all by -(1 - V S V^T)^-1 X^T e
        X = factor[:, :-1] @ root
        shares, V = safely(np.linalg.eigh, X.T @ X, what="a block of the logs")
        gradient = V.T @ (X.T @ (factor[:, -1] - factor[:, :-1] @ theta))
        variance = shares * (1 - shares)
        real = variance > RANK_TOLERANCE
        scores.append(gradient[real] ** 2 / variance[real])
        change = np.where(shares < _ALONE, gradient / np.maximum(1 - shares, 1 - _ALONE), 0.0)
        computed[mask] = rows.H[mask] @ (theta - root @ (V @ change))
    score, squares = np.concatenate(scores), np.sum((R[:, -1] - R[:, :-1] @ theta) ** 2)
    if not np.sum(score) > 0:  # each direction is determined by a block alone
        return _Blocks(computed, float("inf"))
    # of n independent rows the residuals have (1 - kept / n) of the variance of the noise
    return _Blocks(computed, 1 + float(squares / np.mean(score)) / kept)


_OF_JOINT = "check signs, units and zeros of this joint"
_OF_BASE = (
    "check the signs, units, axes and links of the force sensors and of the IMU, and that nothing "
    "else touches the robot"
)


def excluding_torque(kept: Sequence[str]) -> str:
    """Return how to use the torques of some joints only, after words to which ", or" fits."""
    if not kept:
        return ""
    return (
        f", or exclude its torque (--torque-joints {','.join(kept)}), in [identify] of "
        f"seaid.toml:\ntorque_joints = [{', '.join(map(toml_text, kept))}]"
    )


_LACKS = (
    "look at the residual of this joint in the report. What may lack: a spring, the gear ratio or "
    "the rotor inertia in the drives file, the torque limit of a controller, a payload; or the "
    "torque is mostly noise"
)


def fit_findings(
    joint_names: Sequence[str],
    found: RobotEstimate,
    joints: Mapping[str, JointFit],
    rows_per_parameter: float,
    own: BoolArray | None = None,
) -> Iterator[Finding]:
    """Yield the joints whose torque the model does not explain, and bursts of their residual.

    The errors of the `joints` are those of the `own` (R,) rows of the fit, by default of all.
    """
    warnings = (one for drive in found.drives.values() for one in drive.warnings)
    weak = {one.joint for one in warnings if one.code == "weak-spring"}
    explained = [x for x, fit in joints.items() if x not in BASE_ROWS and fit.own < NOTHING]
    for joint, one in joints.items():
        error = one.blocks if np.isfinite(one.blocks) else one.own
        evidence = {"error": one.own, "error of excluded blocks": one.blocks}
        holds = f"; its motor equation holds, with an error of {one.motor:.1%}"
        of, remedy = f"the torque on the load of {joint}", _OF_JOINT + excluding_torque(explained)
        if joint in BASE_ROWS:
            of, remedy = f"the {joint}", _OF_BASE
        if error > NOTHING and one.own > PART:
            yield Finding(
                "no-fit",
                f"the model explains nothing of {of}: its error is {_percent(one.own)} of it in "
                f"the own logs and {_percent(error)} in excluded blocks, that of a constant 100%"
                f"{holds if one.motor < PART else ''}",
                joint,
                "wrong",
                evidence,
                remedy,
                "certain",
            )
        elif error > NOTHING:
            yield Finding(
                "no-fit",
                f"the model of {joint} fits the own logs, with an error of {one.own:.0%} of the "
                f"{'force' if joint in BASE_ROWS else 'torque'}, and predicts excluded blocks of "
                f"them with {error:.0%}: the motion of a part of the log does not determine its "
                "parameters",
                joint,
                "doubtful",
                evidence,
                "record a longer motion"
                + ("" if joint in BASE_ROWS else ", or remove terms of this drive"),
            )
        elif error > PART and one.own > PART and joint not in weak:
            yield Finding(
                "no-fit",
                f"the model leaves much of {of} unexplained: {one.own:.0%} of it in the own logs "
                f"and {error:.0%} in excluded blocks, a constant 100%"
                f"{holds if one.motor < PART else ''}",
                joint,
                "doubtful",
                evidence,
                remedy if joint in BASE_ROWS else _LACKS,
            )
        elif one.nominal < _BETTER * one.identified and one.identified > _MATTERS:
            yield Finding(
                "no-fit",
                f"the bodies of the robot file predict the torque of {joint} better, with an error "
                f"of {one.nominal:.1%}, than the identified ones, with {one.identified:.1%}",
                joint,
                "doubtful",
                {"identified bodies": one.identified, "nominal bodies": one.nominal},
                "record a longer motion that moves this joint and those behind it more",
            )
    contacts = list(_contacts(joint_names, found.fit, own))
    yield from contacts or _few_rows(joints, rows_per_parameter)


def _few_rows(joints: Mapping[str, JointFit], rows_per_parameter: float) -> Iterator[Finding]:
    """Yield that blocks of the logs contradict each other as so few independent rows do."""
    has_fit = any(_NEGLIGIBLE < one.blocks <= NOTHING for one in joints.values())
    if has_fit and rows_per_parameter < FEWEST_INDEPENDENT:
        yield Finding(
            "few-rows",
            "blocks of the logs contradict each other as if there were only "
            f"{rows_per_parameter:.2g} independent rows per parameter: the logs are too short for "
            "so many parameters",
            evidence={"independent rows per parameter": rows_per_parameter},
            remedy="record a longer motion, or remove terms of the drives",
        )


def _contacts(
    joint_names: Sequence[str], fit: FittedRows, own: BoolArray | None
) -> Iterator[Finding]:
    """Yield the times at which residuals of several windows are far beyond those of the others.

    A contact pulls the fit towards itself: the rows of suspicious windows are predicted by a fit of
    the others, in units of the error of a prediction. That counts if it shows at two joints.
    """
    rows = fit.rows
    if rows is None:
        return
    rows = rows if own is None else rows.at(own)
    window_s = max(_WINDOW_S, _CORRELATED * row_step(np.unique(rows.time[rows.run == rows.run[0]])))
    residual = rows.y - rows.H @ fit.estimate.values
    bursts = _bursts(joint_names, rows, residual, _BURST, window_s)
    suspects = _bursts(joint_names, rows, residual, _SUSPECT, window_s)
    apart = np.isin(np.floor(rows.time / window_s), list(suspects))
    if np.any(apart) and np.mean(apart) < _MOST_BURSTS:
        left = _deleted_residual(fit, rows, apart)
        others = _bursts(joint_names, rows, left, _BURST, window_s)
        bursts = others if len(set().union(*others.values())) > 1 else bursts
    windows = sorted(bursts)
    if not windows or windows[-1] + 1 - windows[0] > _SCATTERED * len(windows):
        return  # scattered bursts, such as those of a friction that the model lacks
    start, end = windows[0] * window_s, (windows[-1] + 1) * window_s
    joints = sorted(set.union(*bursts.values()), key=list(joint_names).index)
    yield Finding(
        "contact",
        f"between {start:.2f} and {end:.2f} s the torques of {', '.join(joints)} are far from the "
        f"model, more than {_BURST:g} times as far as at other times: contact, or a hand",
        joints[0],
        "doubtful",
        {"start [s]": start, "end [s]": end},
        f"in the description of the log:\n"  # a contact begins and ends softly
        f"exclude_s = [[{max(start - window_s, 0):.3f}, {end + window_s:.3f}]]",
    )


def _bursts(
    joint_names: Sequence[str], rows: Regression, residual: Array, times: float, window_s: float
) -> dict[int, set[str]]:
    """Return {number of a window: joints whose residual exceeds that of their median window}."""
    bursts: dict[int, set[str]] = {}
    for j, joint in enumerate(joint_names):
        for run in np.unique(rows.run[rows.joint == j]).tolist():
            mine = (rows.joint == j) & (rows.run == run)
            window = np.floor(rows.time[mine] / window_s)
            starts, place, counts = np.unique(window, return_inverse=True, return_counts=True)
            size = np.sqrt(np.bincount(place, residual[mine] ** 2) / counts)
            least = _LEAST_BURST * float(np.std(rows.y[mine]))
            far = size > max(times * float(np.median(size)), least)
            if len(size) >= 8 and np.sum(far) > 1 and np.mean(far) < _MOST_BURSTS:
                for start in starts[far].tolist():
                    bursts.setdefault(int(start), set()).add(joint)
    return bursts


def _deleted_residual(fit: FittedRows, rows: Regression, apart: BoolArray) -> Array:
    """Return the residual of a fit without the rows `apart`; theirs by the error of prediction.

    A row h that is not in the fit is predicted with (1 + c h (H^T H)^-1 h^T) times the variance of
    the noise, c for autocorrelated rows.
    """
    weight = np.asarray(fit.weights)[np.searchsorted(fit.qr_factor.equations, rows.joint)]
    H, p = weight[:, None] * rows.H, rows.H.shape[1]
    R = triangle(np.column_stack([H, weight * rows.y])[~apart])
    svd = scaled_svd(R[:, :p])
    residual = rows.y - rows.H @ svd.solve(R[:, p], RANK_TOLERANCE)
    sizes = np.maximum(svd.sizes, RANK_TOLERANCE * svd.sizes[0])
    reach = (H[apart] / svd.norms) @ svd.vectors.T / sizes
    residual[apart] /= np.sqrt(1 + _CORRELATED * np.sum(reach**2, axis=1))
    return np.asarray(residual)


_CHANNELS = (*INPUT_FIELDS.values(), "joint_torque")


def unused_findings(found: Identification) -> tuple[Finding, ...]:
    """Return notes on parameters of drives that no equation has, and on channels without use."""
    return tuple(chain(_missing_parameters(found), _unused_channels(found)))


def _missing_parameters(found: Identification) -> Iterator[Finding]:
    """Yield a note for every elastic joint whose motor equation (7) the log does not have."""
    for joint in found.known.elastic_joints:
        drive, own = found.known.drives[joint], found.drives[joint].names
        names = motor_regressor(found.known, joint).names
        missing = [name.replace("_", " ") for name in names if name not in own]
        if missing:
            message = (
                f"the log has the joint torque of {joint} and not its motor {drive.motor_input}, "
                f"which alone would identify {listed(missing)}"
            )
            yield Finding("unidentifiable", message, joint, "note", certainty="certain")


def _unused_channels(found: Identification) -> Iterator[Finding]:
    """Yield a note for every kind of torque channel that is in the log and in no equation."""
    robot = found.known
    joints = [one for one in robot.joint_names if one in found.model.torque_joints]
    own = {joint: INPUT_FIELDS[robot.drives[joint].motor_input] for joint in joints}
    for channel in _CHANNELS:
        unused = [
            joint
            for joint in joints
            if channel != own[joint] and _is_logged(found, channel, joint)
            if channel != "joint_torque" or not robot.drives[joint].is_elastic
            if channel != "joint_torque" or _is_logged(found, own[joint], joint)
        ]
        if unused:
            name = channel.replace("_", " ")
            message = f"the {name} of {listed(unused)} is in the log and in no equation"
            joint = unused[0] if len(unused) == 1 else ""
            yield Finding("unused-channel", message, joint, "note", certainty="certain")


def _is_logged(found: Identification, channel: str, joint: str) -> bool:
    """Whether a log in memory has a channel of a joint."""
    index = found.known.index(joint)
    values = [getattr(motion, channel) for motion in found.motions]
    return any(one is not None and bool(np.any(np.isfinite(one[:, index]))) for one in values)
