"""Mistakes of a set-up as transforms: what a model explains if a sign, a unit or a place differs.

`MISTAKES` lists what can be wrong with a channel, a drive, gravity or a body, and what each needs.
A transform undoes one of them. The one that explains far more than the set-up as given is a
finding, and all others are tested again without that mistake (forward selection): two mistakes are
found in turn, and the echoes of the first one vanish.

`log_findings` and `setup_findings` are all that is found before a fit: in the logs alone, and in
their motion.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from seaid._arrays import Array
from seaid._files import toml_key, toml_table
from seaid.checks.bodies import (
    gravities,
    lengths,
    near,
    payloads,
    penalty_of,
    zeros,
    zeros_of_two,
)
from seaid.checks.channels import (
    HELD,
    OF_LOGS,
    Logged,
    decided_delays,
    limit_findings,
    offset_findings,
)
from seaid.checks.check import (
    Code,
    Observation,
    excluding_torque,
    in_description,
    in_drives,
    is_wrong,
    observed,
    only_joint,
)
from seaid.checks.codes import (
    CONTACT,
    COUPLED_JOINTS,
    GEAR_RATIO,
    GEOMETRY,
    GRAVITY,
    HOLES,
    MISSING_DRIVES,
    NO_MEASUREMENT,
    NOMINAL_VALUES,
    PAYLOAD,
    ROTOR_INERTIA,
    SATURATION,
    SIGN,
    SWAPPED_JOINTS,
    TIME_UNIT,
    TORQUE_SCALE,
    UNIT,
    VARYING_RATIO,
    WRAPS,
)
from seaid.checks.commands import (
    command_findings,
    gain_findings,
    hidden_limits,
    no_measurements,
    pose_findings,
)
from seaid.checks.experiment import (
    FALLS,
    LEAST_GAIN,
    SEVERE,
    SUSPICIOUS,
    TIE,
    Experiment,
    Transform,
    fitted,
    scaled,
)
from seaid.checks.tolerances import CORRELATED_ROWS, POOR, SURE
from seaid.errors import Certainty, Finding, Severity, listed
from seaid.estimation import scaled_svd
from seaid.log import Log, changed_source
from seaid.robot import Robot

_MOST_MISTAKES = 5
"""Mistakes that are looked for one after the other."""

_BARELY, _TIMES = 0.04, 3.0
"""The set-up is compared with others from this misfit on too, if the nominal bodies have so many
times the misfit of any bodies."""

_WORSE = 1.5
"""Most that a transform may increase the cost of one kind of misfit."""

_SHORTLIST = 12
"""Transforms, best by the nominal bodies and the encoders, whose other misfits are computed too."""


@dataclass(frozen=True)
class Mistake:
    """A kind of mistake: `transforms` yields what undoes it where the `needs` are met."""

    transforms: Callable[[Experiment], Iterator[Transform]]
    needs: tuple[Callable[[Experiment], bool], ...]


def mistakes(given: Experiment) -> tuple[list[Finding], Experiment]:
    """Return the mistakes that explain an experiment far better, and it without them."""
    findings: list[Finding] = []
    while len(findings) < _MOST_MISTAKES:
        given = replace(given, left=given.free)  # one noise for all that is compared
        best = _best(given) if _is_suspicious(given) else None
        best = best or _significant(given)
        if best is None:
            break
        finding, given = best
        given = _described(given, finding.remedy)
        findings.append(finding)
        if finding.code == NOMINAL_VALUES.name:
            given = replace(given, bodies=np.full_like(given.bodies, np.nan))
    return findings, given


def _described(given: Experiment, remedy: str) -> Experiment:
    """Return the experiment whose channels are read as a remedy describes them.

    The lines of the next mistake in a channel then contain those of this one.
    """
    header, _, lines = remedy.partition("\n")
    if not header.endswith("in the description of the log:"):
        return given
    changed = tomllib.loads(lines).get("joints", {})
    sources = (
        {joint: {**entries, **changed.get(joint, {})} for joint, entries in log.items()}
        for log in given.sources
    )
    return replace(given, sources=tuple(sources))


def _is_suspicious(one: Experiment) -> bool:
    """Whether a misfit is larger than that of a right set-up."""
    beyond = (one.nominal > _BARELY) & (one.nominal > _TIMES * one.free)
    return bool(_largest_misfit(one) > SUSPICIOUS or np.any(beyond))


def _largest_misfit(one: Experiment) -> float:
    return max(float(np.nanmax(misfit, initial=0.0)) for misfit in one.misfits.values())


def transforms(given: Experiment, *needs: Callable[[Experiment], bool]) -> Iterator[Transform]:
    """Yield what undoes each mistake that is possible; with `needs`, of those that have one."""
    for mistake in MISTAKES:
        is_meant = not needs or not {*needs}.isdisjoint(mistake.needs)
        if is_meant and all(need(given) for need in mistake.needs):
            yield from mistake.transforms(given)


def _best(given: Experiment) -> tuple[Finding, Experiment] | None:
    """Return the finding of the transform that explains most, and the experiment without it."""
    quick = ("nominal" if np.any(np.isfinite(given.nominal)) else "free", "encoders")
    tried = [(one, one.undo(given)) for one in transforms(given)]
    tried.sort(key=lambda pair: sum(map(pair[1].cost, quick)) + pair[0].penalty)
    gains = [
        (_gain(given, changed) - one.penalty, one, changed)
        for one, changed in tried[:_SHORTLIST]
        if _left(one, changed) < _EXPLAINED and _explains(given, changed)
    ]
    gains.sort(key=lambda entry: -entry[0])
    if not gains or gains[0][0] < LEAST_GAIN:
        return None
    gain, one, changed = gains[0]
    close = [entry for entry in gains[1:] if entry[0] > gain - TIE and entry[1].code != one.code]
    certainty: Certainty = "possible" if close else "likely" if gain < 3 * LEAST_GAIN else "certain"
    instead, severity, remedy = "", one.severity, one.remedy
    if {entry[1].code for entry in (gains[0], *close)} == {TORQUE_SCALE, NOMINAL_VALUES}:
        # masses of a robot file are rough, and no line may be printed that one cause supports alone
        (_, one, changed), *close = sorted((gains[0], *close), key=_is_of_torques)
        severity, remedy = "note", _WEIGH
    what, joint, before, after = _fall(given, changed)
    evidence = {**one.evidence, "misfit as given": before, "misfit without it": after}
    if close:
        instead = f"; or {close[0][1].message}"
        evidence[f"or {close[0][1].code.name}"] = 1.0
    message = (
        f"{one.message}: the part of the {what} of {joint} that is left unexplained falls from "
        f"{before:.0%} to {after:.0%}{instead}"
    )
    return one.code.finding(message, one.joint, severity, evidence, remedy, certainty), changed


def _is_of_torques(entry: tuple[float, Transform, Experiment]) -> bool:
    return entry[1].code == TORQUE_SCALE


_WEIGH = (
    "weigh a link, or hold a known weight at a known distance and compare the torque: if the robot "
    "file is wrong, the estimate needs no change; if the torques are, give them their scale in the "
    "description of the log"
)


_SIGNIFICANT = 6.0
"""Standard errors of a value, errors of the nominal bodies included, from which it is wrong."""


def _significant(given: Experiment) -> tuple[Finding, Experiment] | None:
    """Return the value about bodies or torques that is wrong by most standard errors, if any is.

    Where no misfit is large, chi-square by the nominal bodies decides: it distinguishes a value
    that is off by little from errors of nominal masses.
    """
    if not _has_bodies(given) or float(np.nanmax(given.nominal, initial=0.0)) >= SEVERE:
        return None
    tried = [(one, one.undo(given)) for one in transforms(given, _has_bodies)]
    scores = [(_score(given, changed) - one.penalty, one, changed) for one, changed in tried]
    score, one, changed = max(scores, key=lambda entry: entry[0], default=(0.0, None, given))
    if one is None or score < 0.5 * _SIGNIFICANT**2:
        return None
    errors = math.sqrt(2 * score)
    message = (
        f"{one.message}: the torques contradict the value given by {errors:.0f} standard errors, "
        "errors of the masses in the robot file included"
    )
    evidence = {**one.evidence, "standard errors": errors}
    severity: Severity = "note" if one.severity == "note" else "doubtful"
    return one.code.finding(message, one.joint, severity, evidence, one.remedy), changed


def _score(given: Experiment, changed: Experiment) -> float:
    """Return the gain of the log likelihood, with as much noise as the change leaves at least."""
    rows, noise = len(given.used) * len(given.target), max(changed.chi_square, 1.0)
    return rows * (given.chi_square - changed.chi_square) / (2 * noise * CORRELATED_ROWS)


_EXPLAINED = 0.6
"""Misfit above which a transform does not explain the torque either."""


def _left(one: Transform, changed: Experiment) -> float:
    """Return the misfit that a transform leaves at its joint, or at the middle one of all.

    Any bodies count as well as the nominal ones, which another mistake may contradict.
    """
    misfit = np.fmin(changed.nominal, changed.free)
    own = misfit[changed.robot.index(one.joint)] if one.joint else np.nan
    return float(own) if np.isfinite(own) else _median(misfit)


def _median(values: Array) -> float:
    """Return the median of the finite values, NaN for none."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


def _explains(given: Experiment, changed: Experiment) -> bool:
    """Whether a misfit of some joint that matters falls by much."""
    return any(
        bool(np.any((before > SUSPICIOUS) & (changed.misfits[kind] < FALLS * before)))
        for kind, before in given.misfits.items()
    )


def _gain(given: Experiment, changed: Experiment) -> float:
    """Return the decrease of the cost; -inf if the transform contradicts a kind of evidence."""
    gains = [given.cost(kind) - changed.cost(kind) for kind in given.misfits]
    return sum(gains) if min(gains) > -_WORSE else -math.inf


_EXPLAINED_BY = {
    "nominal": "torque (by the bodies of the robot file)",
    "free": "torque (by any bodies)",
    "motor": "motor torque",
    "encoders": "motion between the encoders",
}


def _fall(given: Experiment, changed: Experiment) -> tuple[str, str, float, float]:
    """Return the misfit that falls most, of what and of which joint, as given and changed."""
    ratios = {
        (kind, j): changed.misfits[kind][j] / before[j]
        for kind, before in given.misfits.items()
        for j in np.flatnonzero(before > SUSPICIOUS).tolist()
    }
    kind, j = min(ratios, key=lambda key: float(np.nan_to_num(ratios[key], nan=np.inf)))
    before, after = (float(one.misfits[kind][j]) for one in (given, changed))
    return _EXPLAINED_BY[kind], given.robot.joint_names[j], before, after


# What a transform needs


def _has_bodies(given: Experiment) -> bool:
    return bool(given.used) and bool(np.all(np.isfinite(given.bodies)))


def _has_joints(given: Experiment) -> bool:
    return len(given.used) > 1


def _is_severe(given: Experiment) -> bool:
    """Whether a misfit is as large as that of a wrong sign, unit, clock or place."""
    return _largest_misfit(given) >= SEVERE


def _has_own_channels(given: Experiment) -> bool:
    """Whether each joint has its motor."""
    return np.array_equal(given.robot.transmission, np.eye(given.robot.n))


def _has_encoders_apart(given: Experiment) -> bool:
    """Whether the encoders of a joint contradict each other."""
    return bool(np.nanmax(given.of_encoders, initial=0.0) > SUSPICIOUS)


# Factors on channels: signs, units of angles and of torques


def _entries(given: Experiment, joints: Sequence[int], channels: str, factor: float) -> str:
    """Return the lines of a description that multiply logged channels of joints by a factor."""
    return in_description(
        {
            given.robot.joint_names[j]: {
                quantity: changed_source(given.source(j, quantity), factor=factor)
                for quantity in given.logged(j, channels)
            }
            for j in joints
        }
    )


_WORDS = {"joint_position": "joint encoder", "motor_position": "motor encoder"}


def _words(given: Experiment, j: int, channels: str, several: str = "") -> str:
    """Return the words for logged channels of a joint."""
    return " and ".join(
        f"{_WORDS.get(one, 'torque')}{several}" for one in given.logged(j, channels)
    )


def _multiplied(
    code: Code,
    given: Experiment,
    joints: Sequence[int],
    channels: str,
    factor: float,
    message: str,
    **more: Any,
) -> Transform:
    """Return the transform that multiplies channels (q, m, t) of joints by a factor."""
    undo = partial(scaled, joints=joints, factors=dict.fromkeys(channels, factor))
    joint = only_joint([given.robot.joint_names[j] for j in joints])
    remedy = _entries(given, joints, channels, factor)
    return Transform(code, message, undo, joint, remedy, **more)


_SIGNS = {True: {"t": 0.0, "qm": 1.0, "qmt": 0.0}, False: {"q": 0.0, "m": 0.0, "qt": 1.0}}
"""{whether the encoders turn the same way: {channels of the opposite sign: penalty}}."""


def _signs(given: Experiment) -> Iterator[Transform]:
    for j in given.used:
        joint = given.robot.joint_names[j]
        product = float(np.mean(given.motor[1][:, j] * given.joint[1][:, j]) * given.ratio[j])
        agree = not given.both[j] or product > 0
        if not agree and product < 0:
            yield _multiplied(
                GEAR_RATIO,
                given,
                [j],
                "mt",
                -1.0,
                f"the gear of {joint} reverses: its ratio is negative, so that motor encoder and "
                "torque have the opposite sign",
                evidence={"given ratio": float(given.ratio[j])},
            )
        for channels, penalty in _SIGNS[agree].items():
            words = _words(given, j, channels)
            message = f"the {words} of {joint} has the opposite sign"
            if channels == "qmt":
                message = f"the whole joint {joint} has the opposite sign, {words}"
            yield _multiplied(SIGN, given, [j], channels, -1.0, message, penalty=penalty)


def _sign_of_torques(given: Experiment) -> Iterator[Transform]:
    message = "the torques of all joints have the opposite sign"
    yield _multiplied(SIGN, given, given.used, "t", -1.0, message)


_ANGLES = {"deg": math.pi / 180, "turn": 2 * math.pi, "rad": 180 / math.pi}
"""{unit of an angle: the factor that repairs it}; "rad" where degrees were declared."""

_LEAST_TURN, _MOST_TURN = 0.1, 4 * math.pi
"""Range of a joint [rad] in an experiment: one in degrees is 57 times smaller than it seems, so
that a joint that seems to move by a radian would hardly move."""


def _turns(given: Experiment, joints: Sequence[int], factor: float) -> bool:
    """Whether a factor on the positions leaves the ranges of joints possible, by their median."""
    moved = factor * float(np.median(np.ptp(given.joint[0][:, joints], axis=0)))
    return _LEAST_TURN < moved < _MOST_TURN


def _angles(given: Experiment) -> Iterator[Transform]:
    """Yield units of the angles of a joint, at both sides or at the one that the slope suggests."""
    evidence = "slope between the encoders over the gear ratio"
    for j in given.used:
        joint, is_prismatic = given.robot.joint_names[j], given.robot.is_prismatic[j]
        slope = _other_slope(given, j)
        for unit, factor in _ANGLES.items():
            if not is_prismatic and _turns(given, [j], factor):
                message = f"the positions of {joint} are in {unit}"
                yield _multiplied(UNIT, given, [j], "qm", factor, message)
            for channel, effect in (("m", factor), ("q", 1 / factor)):
                if slope and abs(math.log(slope * effect)) < 3 * _SAME_SLOPE:
                    message = f"the {_words(given, j, channel)} of {joint} is in {unit}"
                    slopes = {evidence: slope}
                    yield _multiplied(UNIT, given, [j], channel, factor, message, evidence=slopes)


def _all_angles(given: Experiment) -> Iterator[Transform]:
    """Yield units of the angles of all joints, at both sides or at one."""
    turning = [j for j in range(given.robot.n) if not given.robot.is_prismatic[j]]
    both = [j for j in turning if given.both[j]]
    choices = [("qm", turning, "positions"), ("q", both, "joint encoders")]
    choices.append(("m", both, "motor encoders"))
    for unit, factor in _ANGLES.items():
        for channels, joints, words in choices:
            if len(joints) > 1 and (channels != "qm" or _turns(given, joints, factor)):
                message = f"the {words} of all joints are in {unit}"
                yield _multiplied(UNIT, given, joints, channels, factor, message)


_UNITS = {"mNm": 1e3, "kNm": 1e-3}
"""{unit of a torque: its value over that in N m}."""

_FAR_FACTOR, _LEAST_FACTOR, _LEAST_ROTOR = 20.0, 0.05, 0.2
"""A factor on a torque beyond this is a unit, not an error of a constant; relative errors of torque
constants and of rotor inertias that are usual."""


def _slopes(given: Experiment, j: int) -> tuple[float, float]:
    """Return the torque over that of the nominal bodies, and the rotor inertia over the given.

    The first one is zero where the torque does not show those of the bodies, as one that friction
    alone explains: in any unit it would explain as much.
    """
    slope, error, rotor = _slope_of_bodies(given, j)
    return slope * (abs(slope) > SURE * error), rotor


def _slope_of_bodies(given: Experiment, j: int) -> tuple[float, float, float]:
    """Return the torque over that of the nominal bodies, its error, and the slope of the rotor."""
    columns = np.column_stack([given.regressor[:, j] @ given.bodies, given.load_columns(j)])
    y = given.lever[j] * given.torque[:, j]
    if np.all(np.isnan(y)):
        y = given.sensed[:, j]
    rotor = given.lever[j] * given.motor[2][:, j]
    has_rotor = given.inertia[j] > 0 and bool(np.all(np.isfinite(given.torque[:, j])))
    if has_rotor:
        columns = np.column_stack([columns, given.inertia[j] * rotor])
    x = scaled_svd(columns).solve(y)
    _, covariance = fitted(columns, y)
    rotor_slope = float(x[-1]) if has_rotor else math.nan
    return float(x[0]), math.sqrt(covariance[0, 0]), rotor_slope


def _of_friction_alone(given: Experiment) -> Iterator[Finding]:
    """Yield torques that lack those of the nominal bodies, which other joints show.

    Their slope is zero, with an error that is far below one, and friction explains the torque.
    """
    if not _has_bodies(given):
        return
    slopes = {j: _slope_of_bodies(given, j)[:2] for j in given.used}
    shown = [j for j, (slope, error) in slopes.items() if slope > max(POOR, SURE * error)]
    names = [given.robot.joint_names[j] for j in shown]
    for j, (slope, error) in slopes.items():
        torque = given.lever[j] * given.torque[:, j]
        rubbing = given.friction[j]
        left = torque - rubbing @ scaled_svd(rubbing).solve(np.nan_to_num(torque))
        is_friction = float(np.std(left)) < SEVERE * float(np.std(torque))
        is_silent = abs(slope) < SURE * error < POOR and is_friction
        if is_silent and 2 * len(shown) > len(slopes):
            joint = given.robot.joint_names[j]
            yield NO_MEASUREMENT.finding(
                f"the torque of {joint} has {slope:.2g} +- {error:.2g} times that of the bodies of "
                "the robot file, and follows the direction of its motion: it measures friction, or "
                "nothing",
                joint,
                "wrong",
                {"torque over that of the bodies": slope, "standard error": error},
                f"log the current or the torque that the drive measures{excluding_torque(names)}",
            )


def _torque_scales(given: Experiment) -> Iterator[Transform]:
    """Yield factors on the torque of a joint."""
    for j in given.used:
        slope, _ = _slopes(given, j)
        if slope > 0:
            slope *= _refinement(scaled(given, j, {"t": 1 / slope}), j)
            scale = _scale(given, [j], slope, f"the torque of {given.robot.joint_names[j]} is")
            if abs(slope - 1) > _LEAST_FACTOR:
                yield scale


def _scale(
    given: Experiment, joints: Sequence[int], slope: float, words: str, penalty: float = 0.0
) -> Transform:
    """Return the transform of torques that are `slope` times too large, or in another unit."""
    unit = min(_UNITS, key=lambda name: abs(math.log(slope / _UNITS[name])))
    is_unit = abs(math.log(slope)) > math.log(_FAR_FACTOR)
    exact = is_unit and abs(math.log(slope / _UNITS[unit])) < math.log(2.0)
    factor = 1 / _UNITS[unit] if exact else float(f"{1 / slope:.4g}")
    off = f"{slope:.3g} times too large" if slope > 1 else f"{1 / slope:.3g} times too small"
    return _multiplied(
        UNIT if is_unit else TORQUE_SCALE,
        given,
        joints,
        "t",
        factor,
        f"{words} {f'in {unit}' if exact else off}",
        severity="wrong" if is_unit else "doubtful",
        evidence={"factor": slope},
        penalty=penalty,
    )


def _refinement(given: Experiment, j: int) -> float:
    """Return the factor on the torque of a joint that the nominal bodies of all joints suggest.

    Nominal torques are the instrument: noise of the logged one would bias least squares.
    """
    nominal, own = given.regressor @ given.bodies, np.arange(given.robot.n) == j
    torque = np.where(np.isnan(given.torque), given.sensed, given.lever * given.torque)
    z, x = given.weighed(own * nominal), given.weighed(own * torque)
    size = float(z @ x)
    inverse = 1 + float(z @ given.weighed(nominal - given.target)) / size if size else 1.0
    return 1 / inverse if 0.5 < inverse < 2.0 else 1.0


_SAME_AS_GEAR = 1.5
"""Torques of the motors over those of the nominal bodies, over the gear, that say that they are
behind it: as far from one as errors of nominal bodies are."""


def _all_torque_scales(given: Experiment) -> Iterator[Transform]:
    """Yield a factor on all torques: their unit, that they are behind the gears, or the masses."""
    slopes, rotors = np.array([_slopes(given, j) for j in given.used]).T
    middle, rotor = float(np.median(slopes)), _median(rotors)
    if middle <= 0:
        return
    # torques in another unit change the apparent rotor inertias too, masses do not
    of_masses = rotor > 0 and abs(math.log(rotor)) < 0.5 * abs(math.log(middle))
    words = "the torques of all joints are"
    yield _scale(given, given.used, middle, words, penalty=1.0 if of_masses else 0.0)
    levers, is_driven = given.lever[given.used], np.all(np.isfinite(given.torque[:, given.used]))
    is_behind = 1 / _SAME_AS_GEAR < float(np.median(slopes / levers)) < _SAME_AS_GEAR
    if is_driven and np.min(levers) >= _FAR_FACTOR and is_behind:
        yield _behind_gears(given, middle)
    yield Transform(
        NOMINAL_VALUES,
        f"{_heavier(middle)}: the torques are {middle:.3g} times those of the masses in it",
        partial(replace, bodies=middle * given.bodies),
        severity="note",
        remedy="correct the masses in the robot file, or name the payload",
        evidence={"factor": middle},
        penalty=0.0 if of_masses else 0.5,
    )


def _heavier(factor: float, error: float | None = None) -> str:
    """Return the words for a robot that is heavier or lighter than its file by a factor."""
    spread = "" if error is None else f" +- {error:.1%}"
    size = f"{abs(factor - 1):.0%}{spread} {'heavier' if factor > 1 else 'lighter'}"
    return f"the robot is {size} than its file, or carries a payload that was not given"


def weight_findings(
    experiment: Experiment, bodies: Array, known: Sequence[Finding]
) -> Iterator[Finding]:
    """Yield the note that the identified bodies (10n,) need more torque than those of the file.

    The factor is the slope of their torques over the nominal ones, weighed by the noise of each
    joint, without payloads. Its error is that of the jackknife over the joints, or that of the
    slope. What is `known` about torques and masses explains it already.
    """
    robot, used = experiment.robot, experiment.used
    is_explained = is_wrong(known) or {one.code for one in known} & _OF_WEIGHTS
    if is_explained or robot.has_controllers or not used or not np.any(robot.parameters):
        return
    own = np.stack([robot.parameters, bodies - robot.payload_parameters])
    nominal, identified = np.einsum("rjp,ep->erj", experiment.regressor[:, used], own)
    noise = experiment.noise[used] * np.std(experiment.target[:, used], axis=0)
    nominal, identified = nominal / noise, identified / noise
    squares, products = np.sum(nominal**2, axis=0), np.sum(nominal * identified, axis=0)
    if not np.all(np.isfinite(products)) or np.sum(squares) == 0:
        return
    factor, count = float(np.sum(products) / np.sum(squares)), len(used)
    left = np.linalg.norm(identified - factor * nominal)
    error = float(left / np.sqrt(np.sum(squares) * nominal.size / CORRELATED_ROWS))
    rest = np.sum(squares) - squares
    if count > 1 and np.all(rest > 0):  # else one joint alone feels the masses
        without = (np.sum(products) - products) / rest
        error = max(error, float(np.sqrt((count - 1) * np.var(without))))
    if factor > 0 and abs(factor - 1) > max(POOR, SURE * error):
        yield NOMINAL_VALUES.finding(
            f"{_heavier(factor, error)}: the identified bodies need {factor:.3g} times the torques "
            f"of those in it; or all torques are {factor:.3g} times what they should be",
            severity="note",
            evidence={"factor": factor, "standard error": error},
            remedy=_WEIGH,
        )


_OF_WEIGHTS = {
    one.name
    for one in (
        GRAVITY,
        NOMINAL_VALUES,
        PAYLOAD,
        TORQUE_SCALE,
        UNIT,
        TIME_UNIT,
        GEOMETRY,
        GEAR_RATIO,
    )
}
"""Codes of what changes the torques of bodies as other masses do."""


def _behind_gears(given: Experiment, factor: float) -> Transform:
    """Return the transform of motor torques that are those behind the gears."""
    is_used = np.isin(np.arange(given.robot.n), given.used)
    torque = np.where(is_used, np.nan, given.torque)
    sensed = np.where(is_used, given.torque, given.sensed)
    lines = (
        f"{toml_table('joints', given.robot.joint_names[j])}\n"
        f"joint_torque = {changed_source(given.source(j, 'motor_torque'))}"
        for j in given.used
    )
    note = '# or, if they are computed from currents: motor_torque = {..., side = "joint"}'
    return Transform(
        UNIT,
        "the torques of all joints are those behind the gears, not those of the motors",
        partial(replace, torque=torque, sensed=sensed),
        remedy="\n".join(["in the description of the log:", *lines, note]),
        evidence={"factor": factor},
    )


# Gears, rotors and the clock


def _with_ratio(given: Experiment, j: int, factor: float) -> Experiment:
    """Return the experiment with another gear ratio, and the side that it was computed from."""
    factors = np.where(np.arange(given.robot.n) == j, factor, 1.0)
    joint = given.joint if given.both[j] else given.joint / factors
    return replace(given, ratio=given.ratio * factors, joint=joint)


_SAME_SLOPE = 0.05
"""Relative difference of the encoders' slope from the gear ratio that springs and noise explain."""


def encoder_slope(given: Experiment, j: int) -> float:
    """Return the motor angle per joint angle over the gear ratio, without the spring's deflection.

    The deflection is proportional to the torque of the spring, which is that of the motor but for
    friction: both are columns of the regression next to the joint angle.
    """
    columns = [given.turned[0][:, j], np.ones(len(given.direction))]
    if j in given.used:
        columns += [given.target[:, j], *given.friction[j][:, :2].T]
    H = np.column_stack(columns)
    x = scaled_svd(H).solve(given.motor[0][:, j])
    return float(x[0] / given.lever[j])


def _other_slope(given: Experiment, j: int) -> float | None:
    """Return the slope between two encoders over the gear ratio, None if it is that of the gear."""
    slope = abs(encoder_slope(given, j)) if given.both[j] else 1.0
    return None if abs(slope - 1) < _SAME_SLOPE or not 1e-6 < slope < 1e6 else slope


def _gear_ratios(given: Experiment) -> Iterator[Transform]:
    """Yield gear ratios: of the slope between two encoders, or one half and twice of others."""
    for j in given.used:
        joint, slope = given.robot.joint_names[j], _other_slope(given, j)
        is_linear = given.robot.is_prismatic[j] and not given.robot.drives[joint].is_elastic
        key = "gear_ratio_rad_per_m" if is_linear else "gear_ratio"
        by, evidence = "", {"given ratio": float(given.ratio[j])}
        factors = [] if given.both[j] else [0.5, 2.0]
        if slope:
            by, factors = " by its two encoders,", near(slope)
            evidence = {"slope between the encoders over the gear ratio": slope}
        for factor in factors:
            ratio = given.ratio[j] * factor
            yield Transform(
                GEAR_RATIO,
                f"the gear ratio of {joint} is {ratio:.4g}{by or ','} not {given.ratio[j]:.4g}",
                partial(_with_ratio, j=j, factor=factor),
                joint,
                in_drives({(joint,): f"{key} = {ratio:.6g}"}),
                evidence=evidence,
                penalty=penalty_of(factor, slope),
            )


def _geared(given: Experiment) -> Iterator[Transform]:
    """Yield joint encoders that are multiplied by the gears: their slope to the motors' is one."""
    slopes = {j: _other_slope(given, j) for j in np.flatnonzero(given.both).tolist()}
    joints = [
        j
        for j, slope in slopes.items()
        if slope and abs(math.log(slope * abs(given.lever[j]))) < 3 * _SAME_SLOPE
    ]
    if not joints:
        return
    factors = {given.robot.joint_names[j]: 1 / float(given.lever[j]) for j in joints}
    sources = {
        joint: {
            "joint_position": changed_source(given.sources[0][joint]["joint_position"], factor=x)
        }
        for joint, x in factors.items()
    }
    yield Transform(
        UNIT,
        f"the joint encoders of {listed(factors)} have the angles of the motors: they are "
        "multiplied by the gear ratio already",
        partial(_ungeared, factors=factors),
        only_joint([*factors]),
        in_description(sources),
    )


def _ungeared(given: Experiment, factors: Mapping[str, float]) -> Experiment:
    factor = np.array([factors.get(joint, 1.0) for joint in given.robot.joint_names])
    return replace(given, joint=given.joint * factor)


_ROUND_TURNS = 0.05
"""Turns with another joint of which pulleys and differentials have multiples: an estimate that is
so within its error is one, since the deflection of a spring is a thousandth of the angles."""


def _couplings(given: Experiment) -> Iterator[Transform]:
    """Yield motors that turn with another joint too, and encoders that measure a sum of joints."""
    robot = given.robot
    for j in np.flatnonzero(given.both).tolist():
        joint, drive = robot.joint_names[j], robot.drives[robot.joint_names[j]]
        apart, columns = given.between_encoders(j)
        for i in range(robot.n):
            other = robot.joint_names[i]
            is_alike = robot.is_prismatic[i] == robot.is_prismatic[j]
            if other in {joint, *drive.transmission} or not is_alike:
                continue
            H = np.column_stack([given.joint[0][:, i], columns])
            x, covariance = fitted(H, apart)
            turns, error = float(x[0]), math.sqrt(covariance[0, 0])
            if abs(turns) < POOR:
                continue
            rounded = round(turns / _ROUND_TURNS) * _ROUND_TURNS
            turns = rounded if abs(turns - rounded) < SURE * error else turns
            factors = {**(drive.transmission or {joint: 1.0}), other: float(f"{turns:.4g}")}
            table = ", ".join(f"{toml_key(name)} = {one:.4g}" for name, one in factors.items())
            drives = {**robot.drives, joint: replace(drive, transmission=factors)}
            yield Transform(
                COUPLED_JOINTS,
                f"the motor of {joint} turns behind its gear as {joint} and {turns:.3g} times with "
                f"{other}: it drives both, by a differential, a tendon or a parallel linkage",
                partial(replace, robot=robot.with_drives(drives)),
                joint,
                in_drives({(joint,): f"transmission = {{ {table} }}"}),
                evidence={f"turns with {other}": turns},
                penalty=0.5,
            )
            if abs(abs(turns) - 1) < 3 * _SAME_SLOPE:
                way = "minus" if turns < 0 else "plus"
                yield Transform(
                    COUPLED_JOINTS,
                    f"the encoder of {joint} measures its angle against another link than the one "
                    f"before it: the joint moves as its encoder {way} that of {other}",
                    partial(_against_link, j=j, i=i, turns=float(np.sign(turns))),
                    joint,
                    f"write the angle of {joint} {way} that of {other} into the log, as that of "
                    f"{joint}",
                    evidence={f"turns with {other}": turns},
                    penalty=0.5,
                )


def _against_link(given: Experiment, j: int, i: int, turns: float) -> Experiment:
    joint = given.joint.copy()
    joint[:, :, j] += turns * joint[:, :, i]
    return replace(given, joint=joint)


def _varying_ratios(given: Experiment) -> Iterator[Transform]:
    """Yield gear ratios that vary once per turn: theta = N (q + e q + c cos q + s sin q)."""
    robot = given.robot
    for j in np.flatnonzero(given.both).tolist():
        q = given.turned[0][:, j]
        if robot.is_prismatic[j] or np.ptp(q) < _LEAST_TURN:
            continue
        apart, columns = given.between_encoders(j)
        H = np.column_stack([q, np.cos(q), np.sin(q), columns])
        x = scaled_svd(H).solve(apart)[:3]
        factor = 1 + x[0] - x[1] * np.sin(q) + x[2] * np.cos(q)
        low, high = float(np.min(factor)), float(np.max(factor))
        if low <= 0 or high - low < POOR * (high + low) / 2:
            continue
        joint, ratio = robot.joint_names[j], float(given.ratio[j])
        yield Transform(
            VARYING_RATIO,
            f"the gear ratio of {joint} depends on its angle: it is from {ratio * low:.3g} to "
            f"{ratio * high:.3g}, where the drives file has {ratio:g}: the transmission is a "
            "linkage, a lever or a spindle",
            partial(_with_constant_ratio, j=j, x=x),
            joint,
            "convert angle and torque of the motor to those of a gear with a constant ratio, by "
            "the geometry of the linkage, before the log is read",
            evidence={"least ratio": ratio * low, "largest ratio": ratio * high},
            penalty=1.0,
        )


def _with_constant_ratio(given: Experiment, j: int, x: Array) -> Experiment:
    """Return the experiment with a motor of constant ratio and the same power.

    Of e q + c cos q + s sin q, with slope g - 1, the derivatives are (g - 1) q' and (g - 1) q'' +
    g' q'^2.
    """
    q, v, a = given.turned[:, :, j]
    columns = np.column_stack([q, np.cos(q), np.sin(q)])
    more = np.column_stack([np.ones_like(q), -np.sin(q), np.cos(q)]) @ x
    change = np.column_stack([-np.cos(q), -np.sin(q)]) @ x[1:]
    motor, torque, rate = given.motor.copy(), given.torque.copy(), given.torque_rate.copy()
    motor[:, :, j] -= given.lever[j] * np.array([columns @ x, more * v, more * a + change * v**2])
    torque[:, j] *= 1 + more
    rate[:, j] *= 1 + more
    return replace(given, motor=motor, torque=torque, torque_rate=rate)


def _rotor_inertias(given: Experiment) -> Iterator[Transform]:
    for j in given.used:
        joint, (_, rotor) = given.robot.joint_names[j], _slopes(given, j)
        if not (math.isfinite(rotor) and rotor > 0) or abs(rotor - 1) < _LEAST_ROTOR:
            continue
        for factor in near(rotor, given.lever[j] ** 2):
            inertia = given.inertia.copy()
            inertia[j] *= factor
            yield Transform(
                ROTOR_INERTIA,
                f"the rotor inertia of {joint} is {inertia[j]:.3g} kg m^2, not "
                f"{given.inertia[j]:.3g}",
                partial(replace, inertia=inertia),
                joint,
                in_drives({(joint,): f"motor_inertia_kg_m2 = {inertia[j]:.4g}"}),
                evidence={"ratio": factor},
                penalty=penalty_of(factor, rotor),
            )


_FACTORS_OF_TIME = {
    0.1: "10 times too short, so that speeds are too large",
    0.5: "2 times too short, so that speeds are too large",
    2.0: "2 times too long, so that speeds are too small",
    10.0: "10 times too long, so that speeds are too small",
}


def _times(given: Experiment) -> Iterator[Transform]:
    """Yield clocks that run too fast or too slowly by a round factor."""
    for factor, words in _FACTORS_OF_TIME.items():
        yield Transform(
            TIME_UNIT,
            f"the time of the log is {words}",
            partial(_with_time, factor=factor),
            remedy="in the description of the log:\n"
            f"time = {{ rate_hz = {given.rate_hz * factor:.6g} }}",
            evidence={"factor": factor},
            penalty=1.0,
        )


def _with_time(given: Experiment, factor: float) -> Experiment:
    powers = np.array([1.0, factor, factor**2])[:, None, None]
    return replace(
        given,
        joint=powers * given.joint,
        motor=powers * given.motor,
        torque_rate=factor * given.torque_rate,
        rate_hz=given.rate_hz * factor,
    )


# Channels of two joints exchanged


def _exchanges(given: Experiment) -> Iterator[Transform]:
    for pair in combinations(range(given.robot.n), 2):
        names = [given.robot.joint_names[j] for j in pair]
        for channels in ("qmt", "qm", "t", *("qm" if np.all(given.both[[*pair]]) else "")):
            words = "channels" if channels == "qmt" else _words(given, pair[0], channels, "s")
            sources = {
                given.robot.joint_names[j]: {
                    quantity: changed_source(given.source(source, quantity))
                    for quantity in given.logged(source, channels)
                }
                for j, source in (pair, pair[::-1])
            }
            yield Transform(
                SWAPPED_JOINTS,
                f"the {words} of {names[0]} and {names[1]} are exchanged",
                partial(_exchanged, pair=[*pair], channels=channels),
                names[0],
                in_description(sources),
            )


def _exchanged(given: Experiment, pair: list[int], channels: str) -> Experiment:
    """Return the experiment with channels (q, m, t) of two joints exchanged."""
    order = np.arange(given.robot.n)
    order[pair] = order[pair[::-1]]
    fields = {
        "q": ("joint",),
        "m": ("motor", "direction"),
        "t": ("torque", "torque_rate", "sensed"),
    }
    names = [name for channel in channels for name in fields[channel]]
    changed = {name: getattr(given, name)[..., order] for name in names}
    if {*channels} >= {*"qm"}:
        joint, motor = changed["joint"], changed["motor"]
        for j in pair:  # the side without an encoder was computed from the motor's
            if not given.both[j]:
                joint[:, :, j] = motor[:, :, j] / given.ratio[j]
    return replace(given, **changed)


_BODIES, _SEVERE = (_has_bodies,), (_is_severe,)

MISTAKES = (
    Mistake(_torque_scales, _BODIES),
    Mistake(_rotor_inertias, _BODIES),
    Mistake(_all_torque_scales, (*_BODIES, _has_joints)),
    Mistake(gravities, _BODIES),
    Mistake(lengths, _BODIES),
    Mistake(zeros, _BODIES),
    Mistake(zeros_of_two, (*_BODIES, *_SEVERE)),
    Mistake(payloads, _BODIES),
    Mistake(_sign_of_torques, (*_SEVERE, _has_joints)),
    Mistake(_all_angles, (*_SEVERE, _has_joints)),
    Mistake(_times, _SEVERE),
    Mistake(_signs, (*_SEVERE, _has_own_channels)),
    Mistake(_angles, (*_SEVERE, _has_own_channels)),
    Mistake(_gear_ratios, (*_SEVERE, _has_own_channels)),
    Mistake(_geared, _SEVERE),
    Mistake(_couplings, (_has_encoders_apart,)),
    Mistake(_varying_ratios, (_has_encoders_apart,)),
    Mistake(_exchanges, (*_SEVERE, _has_own_channels)),
)
"""What can be wrong with a set-up, and what each needs."""


def log_findings(
    robot: Robot, logs: Sequence[Log], torque_joints: Collection[str] | None = None
) -> list[Finding]:
    """Return the findings that need no motion: the unit of time, drives, saturated torques.

    Those of torques and commands are of the `torque_joints`, by default of all.
    """
    used = robot.joint_names if torque_joints is None else torque_joints
    others = Observation(NO_MEASUREMENT, _unmeasured), Observation(GEOMETRY, _sizes)
    return observed((*OF_LOGS, *others), Logged(robot, logs, used))


def _unmeasured(logged: Logged) -> Iterator[Finding]:
    """Yield what is wrong with torques and commands, see `commands`."""
    for _, log in logged.numbered:
        findings = (*no_measurements(logged.robot, log), *command_findings(logged.robot, log))
        yield from (finding for finding in findings if finding.joint in logged.used)


_LONGEST_M = 20.0
"""Distance [m] between two joints that no robot has; that of 2 cm in mm."""


def _sizes(logged: Logged) -> Iterator[Finding]:
    """Yield that the lengths of the robot file are in mm."""
    model = logged.robot.model
    longest = max(float(np.linalg.norm(one.translation)) for one in model.jointPlacements)
    if longest > _LONGEST_M:
        yield GEOMETRY.finding(
            f"two joints of the robot file are {longest:.3g} m apart: its lengths are in mm, not m",
            severity="wrong",
            evidence={"longest distance [m]": longest},
            remedy="in the robot file: all lengths times 0.001, and inertias in kg mm^2 times 1e-6",
            certainty="certain",
        )


def setup_findings(experiment: Experiment, known: Sequence[Finding]) -> list[Finding]:
    """Return the `known` findings and the mistakes of the set-up, unless those explain the torques.

    Torques beyond their limits are no finding of joints whose gains are in another unit, or whose
    limit is another one.
    """
    known = [finding for finding in known if HELD not in finding.evidence] + [
        *decided_delays(experiment, known)
    ]
    findings = [*known, *_of_motion(experiment, known)]
    joints = {joint for finding in findings for joint in finding.joints}
    return [
        finding
        for finding in findings
        if finding.code != SATURATION.name or finding.joints or finding.joint not in joints
    ]


def _of_motion(experiment: Experiment, known: Sequence[Finding]) -> list[Finding]:
    """Return the mistakes of the set-up that the motion shows, next to `known` findings."""
    hiding = {TIME_UNIT.name, MISSING_DRIVES.name, WRAPS.name, GEOMETRY.name}
    wrong = {finding.code for finding in known if finding.severity == "wrong"}
    if hiding & {finding.code for finding in known} or {NO_MEASUREMENT.name, HOLES.name} & wrong:
        return []  # the torques show no other mistake
    offsets = list(offset_findings(experiment))
    if offsets:
        return offsets
    if experiment.robot.has_controllers:
        # the channels of a torque are not there, and an unknown armature looks like another mistake
        if any(finding.severity == "wrong" for finding in known):
            return []
        limited = list(hidden_limits(experiment))
        if limited:  # which looks like gains in another unit, or another zero
            return limited
        stopped = {finding.joint for finding in known if finding.code == CONTACT.name}
        gains, without = gain_findings(experiment)
        findings = [*gains, *limit_findings(without), *pose_findings(without)]
        return [finding for finding in findings if finding.joint not in stopped]
    findings = list(_of_friction_alone(experiment))
    if findings:
        return findings
    findings, _ = mistakes(experiment)
    return findings or list(limit_findings(experiment))
