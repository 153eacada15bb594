"""Mistakes of a set-up as transforms: what a model explains if a sign, a unit or a place differs.

`MISTAKES` lists what can be wrong with a channel, a drive, gravity or a body, and what shows it.
A transform undoes one of them. The one that explains most is a finding, if the log shows it without
the bodies of the robot file or contradicts these by far; all others are tested again without that
mistake (forward selection): two mistakes are found in turn, and the echoes of the first one vanish.
What explains as much as the finding is named in it, with the measurement that decides.

`log_findings` and `setup_findings` are all that is found before a fit: in the logs alone, and in
their motion.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, permutations, product
from operator import attrgetter

import numpy as np
import scipy

from seaid._arrays import Array
from seaid.checks import bodies, channels, codes, commands, gears
from seaid.checks import tolerances as tol
from seaid.checks.codes import CODES, in_drives
from seaid.checks.engine import Check, Need, guarded, observed, proposals
from seaid.checks.experiment import (
    KINDS,
    SHORTLIST,
    Experiment,
    Transform,
    best_factors,
    best_value,
    multiplied,
    near,
    scaling,
    with_torques_of,
)
from seaid.errors import Finding, listed
from seaid.log import Log
from seaid.log.channels import UNIT_FACTORS
from seaid.log.description import Entry, Logged
from seaid.robot import Robot
from seaid.robot.transmission import group_of

_MOST_MISTAKES = 5
"""Mistakes that are looked for one after the other."""

_DIRECT = ("free", "of_motors", "of_encoders", "of_sensors")
"""Misfits that do not rest on the bodies of the robot file."""


@dataclass(frozen=True, eq=False)
class _Trial:
    """A transform, one of a `count` that were tried on the experiment `before`, and its support.

    `falls` are the misfits that matter and fall by half, {(kind, joint): before and after}. Gains
    of the log likelihood: `direct` by all that does not rest on the robot file, `shown` by what
    matters of it, `bodies` by the bodies of the robot file and their errors.
    """

    before: Experiment
    transform: Transform
    count: int
    falls: Mapping[tuple[str, int], tuple[float, float]]
    shown: float
    direct: float
    bodies: float

    @property
    def total(self) -> float:
        """Gain by all, less what the transform costs."""
        return self.direct + self.bodies - self.transform.penalty

    @property
    def is_demanded(self) -> bool:
        """Whether the log demands the transform: it explains more than chance does.

        Twice the log of a likelihood ratio has the distribution of chi-square, with the number of
        fitted values as its degrees of freedom, and at most that of one between values that are not
        fitted. The least gain is that of which all transforms together have one by chance in a
        hundred logs.
        """
        # The value that chi-square exceeds with this probability: FEW for all transforms together
        # is FEW / count for each (Bonferroni).
        least = scipy.special.chdtri(max(self.transform.penalty, 1), tol.FEW / self.count) / 2
        return self.explains(float(least))

    @property
    def left(self) -> tuple[float, float]:
        """The part of the torque that is left at the joints of the transform, and at the middle."""
        changed, finding = self.transform.changed, self.transform.finding
        # any bodies or those of the file: another mistake may contradict the latter, or one of the
        # two joints of an exchange
        misfit = np.fmin(changed.nominal, changed.predicted)
        middle = float(np.nanmedian(misfit)) if np.any(np.isfinite(misfit)) else 0.0
        names = finding.joints or (finding.joint,) * bool(finding.joint)
        of_joints = misfit[[changed.robot.index(name) for name in names]]
        return float(np.nanmin(of_joints)) if np.any(np.isfinite(of_joints)) else middle, middle

    def explains(self, least: float = 0.0) -> bool:
        """Whether the transform has more than the `least` gain and leaves little unexplained.

        The gain has to come from what the log shows without the robot file, where a misfit that
        matters falls, or from all together, and the bodies of the file contradict it by less.
        """
        if self.total <= 0:
            return False
        if self.shown > least:
            return self.left[0] < tol.MOST
        is_possible = bool(self.falls) or _is_value(self.before, self.transform)
        return self.shown + self.bodies > least and is_possible and max(self.left) < tol.SEVERE


def _trial(before: Experiment, transform: Transform, count: int) -> _Trial:
    """Return what speaks for a transform.

    Where much is left it is the model's error, which any change makes somewhat smaller or larger:
    only a fall by half counts there. Where nearly nothing is left it is noise, whose likelihood
    shows a value that is off by little.
    """
    changed, is_value = transform.changed, _is_value(before, transform)
    kinds, rows = [*before.misfits], before.independent_rows
    # misfits (kinds, n), of which nothing is less than a hundredth
    x, y = (np.maximum([*each.misfits.values()], tol.FEW) for each in (before, changed))
    if transform.finding.code == "swapped-joints":
        # a misfit that moves from one joint to the other is no less: the larger ones are compared
        pair = [before.robot.index(joint) for joint in transform.finding.joints]
        both = np.ix_(np.all(np.isfinite(x[:, pair]), axis=1), pair)
        x[both], y[both] = np.sort(x[both]), np.sort(y[both])
    # n log(rms before / rms after): the gain of Gaussian residuals of unknown size.
    gains, is_less = rows * np.log(x / y), y < tol.MOST * x
    places = np.argwhere((x > tol.POOR) & is_less).tolist()
    falls = {(kinds[k], j): (float(x[k, j]), float(y[k, j])) for k, j in places}
    # A misfit that a joint does not have is NaN, which compares as False and does not count.
    counts = ((x > tol.SLIGHT) & is_less) | (is_value & (y < tol.SLIGHT))
    counts &= np.array([[kind in _DIRECT] for kind in kinds])
    shown = float(np.sum(np.where(counts, gains, 0.0))) if falls or is_value else 0.0
    direct = sum(before.cost(kind, rows) - changed.cost(kind, rows) for kind in _DIRECT)
    bodies_of_file = before.file_cost - changed.file_cost
    return _Trial(before, transform, count, falls, min(direct, shown), direct, bodies_of_file)


def _is_contradicted(before: Experiment, transform: Transform) -> bool:
    """Whether a kind of misfit that matters grows by more than chance, which no mistake does.

    That of nominal bodies may grow by factors on channels with which a file explains more.
    """
    changed = transform.changed
    is_by_file = bool(transform.channels) and changed.file_cost < before.file_cost
    for kind in _DIRECT if is_by_file else KINDS:
        x, y = (np.maximum(getattr(each, kind), tol.FEW) for each in (before, changed))
        losses = before.independent_rows * np.log(y / x)
        # z standard errors are z^2 / 2 of a log likelihood.
        if np.nansum(np.where(y > tol.POOR, losses, 0.0)) >= tol.SURE**2 / 2:
            return True
    return False


def mistakes(
    experiment: Experiment, possible: Possible | None = None
) -> tuple[list[Finding], Experiment]:
    """Return the mistakes that explain an experiment far better, and it without them.

    Those of `MISTAKES`, or others that are `possible`.
    """
    findings, notes = list[Finding](), list[Finding]()
    find = partial(_trials, possible=possible or MISTAKES, notes=notes)
    trials = find(experiment)
    while len(findings) < _MOST_MISTAKES and (demanded := _demanded(trials, findings)):
        best, rivals = demanded[0], _rivals(demanded[0], trials)
        experiment = _without(best, is_decided=not rivals)
        trials = find(experiment)
        undecided = [rival for rival in rivals if not _is_second(rival, trials)]
        if rivals and not undecided:
            experiment = _without(best, is_decided=True)
            trials = find(experiment)
        findings.append(_finding(best, undecided))
    return [*findings, *dict.fromkeys(notes)], experiment


def _demanded(trials: Sequence[_Trial], findings: Iterable[Finding]) -> list[_Trial]:
    """Return the trials that the log demands next to `findings`."""
    # the value of a mistake has an error, which makes others small ones that are none
    is_first = all(finding.severity == "note" for finding in findings)
    return [trial for trial in trials if trial.is_demanded and (is_first or trial.falls)]


def _without(best: _Trial, is_decided: bool) -> Experiment:
    """Return the experiment without the mistake of the best trial, and described so if decided."""
    experiment, transform = best.transform.changed, best.transform
    if is_decided:  # the lines of the next mistake in a channel then contain those of this one
        experiment = experiment.described_as(transform.sources, transform.log)
    # The file is contradicted as a whole: nothing else is compared with its bodies.
    if transform.finding.code == "nominal-values":
        return experiment.with_changes(bodies=np.full_like(experiment.bodies, np.nan))
    return experiment


def _is_second(rival: _Trial, trials: Iterable[_Trial]) -> bool:
    """Whether a rival is a second mistake: without the first one it explains as much or more."""
    alike = (x for x in trials if _subject(x.transform) == _subject(rival.transform))
    return any(x.is_demanded and x.falls and x.total > tol.MOST * rival.total for x in alike)


def transforms(
    experiment: Experiment, possible: Possible, notes: list[Finding]
) -> Iterator[Transform]:
    """Yield what undoes each mistake that is possible, and add the `notes` on checks that raise."""
    for check in possible:
        of_logs = replace(check, proposed=partial(_in_single_logs, check=check))
        yield from proposals((check, of_logs), notes, experiment)


def _in_single_logs(experiment: Experiment, check: Mistake) -> Iterator[Transform]:
    """Yield mistakes in the description of a log that the other logs do not have.

    With these the log has another model, so that any bodies, a spring or a gear leave something.
    """
    logs = np.unique(experiment.log).tolist()
    is_apart = any(_is_off(experiment, kind, tol.SLIGHT) for kind in _DIRECT)
    for number in logs if len(logs) > 1 and is_apart else ():
        alone = experiment.of_log(number)
        for transform in check.proposed(alone) if len(alone.log) >= tol.FEWEST_INSTANTS else ():
            if transform.sources:
                message = f"in log {number + 1} {transform.finding.message}"
                changed = experiment.with_log(alone, transform.changed)
                # a line of the drives would be one of all logs
                finding = replace(transform.finding, message=message, remedy="")
                yield replace(transform, finding=finding, changed=changed, log=number)


def _trials(experiment: Experiment, possible: Possible, notes: list[Finding]) -> list[_Trial]:
    """Return what the log does not contradict, the best first, and add `notes` as above."""
    costs, rows = dict[Transform, tuple[float, float]](), experiment.independent_rows
    best, count, trials = list[Transform](), 0, list[_Trial]()
    for transform in transforms(experiment, possible, notes):
        with guarded(CODES[transform.finding.code], notes):
            changed = transform.changed
            cost = changed.file_cost if experiment.has_bodies else changed.cost("free", rows)
            cost += sum(changed.cost(kind, rows) for kind in _DIRECT[1:])
            # one of several mistakes repairs its joints, while others still contradict the file
            nominal = changed.cost("nominal", rows) + transform.penalty
            costs[transform], count = (cost + transform.penalty, nominal), count + 1
            changed.forget_rows()
            # of a robot with many joints there are thousands of transforms
            best = [x for k in (0, 1) for x in sorted(costs, key=lambda x: costs[x][k])[:SHORTLIST]]
            costs = {x: costs[x] for x in costs if x in best}
    # Only then: in the place of one that the log contradicts another would be compared that its
    # costs do not suggest.
    for transform in dict.fromkeys(best):
        with guarded(CODES[transform.finding.code], notes):
            if not _is_contradicted(experiment, transform):
                trials.append(_trial(experiment, transform, count))
    return sorted(trials, key=lambda trial: -trial.total)


def _finding(best: _Trial, rivals: Sequence[_Trial]) -> Finding:
    """Return the finding of the best trial, with the `rivals` that explain as much."""
    finding = best.transform.finding
    message, evidence, severity = finding.message, {**finding.evidence}, finding.severity
    if best.falls:
        (kind, j), (before, after) = min(best.falls.items(), key=lambda x: x[1][1] / x[1][0])
        evidence |= {codes.AS_GIVEN: before, "misfit without it": after}
        message += f": the part of the {KINDS[kind][1]} of {best.before.robot.joint_names[j]} that "
        message += f"is left unexplained falls from {before:.0%} to {after:.0%}"
    else:
        # The inverse of z^2 / 2, which is positive for a transform that is demanded.
        evidence["standard errors"] = errors = math.sqrt(2 * (best.direct + best.bodies))
        other = "; the error after +- is that by the torques alone" * ("+-" in message)
        severity = "note" if severity == "note" else "doubtful"
        message += ": by all that it shows, errors of the bodies in the robot file included, the "
        message += f"log contradicts the value given by {errors:.0f} standard errors{other}"
    finding = replace(
        finding,
        message=message,
        severity=severity,
        evidence=evidence,
        remedy=best.transform.lines,
        # what rests on the bodies of the robot file is at most likely
        certainty="certain" if best.shown > tol.SIGNIFICANT**2 / 2 else "likely",
    )
    others = [(x.transform.finding, best.total - x.total) for x in rivals]
    causes = {(CODES[other.code], other.message): less for other, less in others}
    return codes.undecided(finding, causes) if causes else finding


def _rivals(best: _Trial, trials: Sequence[_Trial]) -> list[_Trial]:
    """Return the best of each other code, joint and torque that explains as much as the best trial.

    The same mistake of further joints, which nothing shows, is no rival of that of one.
    """
    transform = best.transform
    code, joints = transform.finding.code, transform.sources.keys()
    rivals = {
        _subject(trial.transform): trial
        # From the worst to the best: of each subject the best one stays in the dictionary.
        for trial in reversed(trials)
        if trial.total > best.total - tol.SURE**2 / 2
        and trial.explains()
        and trial.transform.penalty <= transform.penalty + 1  # the simple one of two that agree
        and not (trial.transform.finding.code == code and joints < trial.transform.sources.keys())
    }
    rivals.pop(_subject(transform), None)
    return list(rivals.values())


def _subject(transform: Transform) -> tuple[str, str, int | None, bool, bool]:
    """Return code, joint, log, and whether a transform changes torque sensors, or places, alone."""
    channels, finding = transform.channels, transform.finding
    return finding.code, finding.joint, transform.log, channels == "s", not channels


_OF_VALUES = (
    *("encoder-offset", "gear-compliance", "gear-ratio", "geometry", "gravity"),
    *("nominal-values", "payload", "rotor-inertia", "time-unit", "torque-scale"),
)
"""Mistakes that may be small, as fitted factors on positions may be."""


def _is_value(before: Experiment, transform: Transform) -> bool:
    """Whether a mistake may be small: not next to motor constants that the bodies have given."""
    is_factor = transform.channels == "qm" and "standard error" in transform.finding.evidence
    return (transform.finding.code in _OF_VALUES or is_factor) and not np.any(before.is_unscaled)


# Factors on channels: signs, units of positions and of torques

# A penalty of 1 is that of a fitted value: of mistakes that explain as much, it is the last one.
_SIGNS = {True: {"t": 0.0, "qm": 1.0, "qmts": 0.0}}
_SIGNS[False] = {"mt": 0.0, "q": 0.0, "m": 0.0, "qt": 1.0}
"""{whether the encoders turn the same way: {channels of the opposite sign: penalty}}."""


def _signs(experiment: Experiment) -> Iterator[Transform]:
    """Yield signs: of the torques of all joints, and of the channels of each."""
    used, code = experiment.used, CODES["sign"]
    if len(used) > 1:
        every = dict.fromkeys(used, -1.0)
        yield multiplied(code, "opposite", experiment, every, _torques(experiment))
    for j in used:
        speeds = experiment.motor[1][:, j] * experiment.joint[1][:, j]
        choices = _SIGNS[not experiment.both[j] or float(np.mean(speeds)) > 0]
        if len(group_of(experiment.robot.transmission, j)) > 1:
            choices = choices | _SIGNS[False]  # the motor of a coupled joint may turn either way
        sensors = {"s": 0.0} if experiment.has_both_torques[j] else {}
        for sides, penalty in (choices | sensors).items():
            of_joint = experiment, {j: -1.0}, sides
            if sides == "mt":
                evidence = {"given ratio": float(experiment.ratio[j])}
                yield multiplied(CODES["gear-ratio"], "reversed", *of_joint, evidence, penalty)
            else:
                case = "whole" if sides == "qmts" else "opposite"
                yield multiplied(code, case, *of_joint, penalty=penalty)


_ANGLES = {unit: UNIT_FACTORS["rad"][unit] for unit in ("deg", "turn")} | {"rad": 180 / math.pi}
"""{unit of an angle: the factor that repairs it}; "rad" where degrees were declared."""

_METRES = {unit: UNIT_FACTORS["m"][unit] for unit in ("m", "cm", "mm")} | {"inch": 0.0254}
"""{unit of a length: its value in m}, of those that robots are designed in."""

_LENGTHS = {f"{a}, read as {b}": x / y for (a, x), (b, y) in permutations(_METRES.items(), 2)}
"""{unit of the position of a sliding joint: the factor that repairs it}."""


def _units_by(slope: float, is_length: bool) -> dict[str, float]:
    """Return units of positions: with a slope between encoders, also counts of a power of two.

    The unit may be another number of counts: an encoder counts one, two or four edges of each of
    its lines, and of the bits of an absolute one, per turn, some may be missing.
    """
    units = _LENGTHS if is_length else _ANGLES
    if not slope:
        return units
    power, of_turn = (round(math.log2(x)) for x in (slope, 2 * math.pi * max(slope, 1 / slope)))
    powers = set() if is_length and abs(power) > 2 else {power, -power} - {0}
    steps = {f"steps, {2.0**k:g} times as many as described": 2.0**-k for k in powers}
    is_count = 2**of_turn >= tol.FEWEST_COUNTS and not is_length
    raw = {f"counts, {2**of_turn} per turn": 2 * math.pi / 2**of_turn} if is_count else {}
    return units | steps | raw


def _in_units(
    experiment: Experiment, joints: Sequence[int], channels: str, slope: float = 0.0
) -> Iterator[Transform]:
    """Yield units of the positions of joints in which they can be, or which explain a slope."""
    logged, slides = experiment.logged(joints[0], channels[0]), experiment.robot.is_prismatic
    is_length = "joint_position" in logged and slides[joints[0]]
    for unit, factor in _units_by(slope, is_length).items():
        if channels == "qm":
            is_possible = gears.can_move(experiment, joints, factor)
        else:  # the slope is motor over joint: a factor on the joint encoder divides it
            effect = slope * (factor if channels == "m" else 1 / factor)
            is_possible = not slope or abs(math.log(effect)) < 3 * tol.SLIGHT
        if is_possible:
            of_joints = experiment, dict.fromkeys(joints, factor), channels
            yield multiplied(CODES["unit"], "read-as", *of_joints, {"unit": unit})


def _positions(experiment: Experiment) -> Iterator[Transform]:
    """Yield units of positions, of each joint and of all that turn.

    They are those of both sides, or of the one that the slope between the encoders suggests.
    """
    slides, singles = experiment.robot.is_prismatic, [(j,) for j in experiment.used]
    turning = tuple(np.flatnonzero(~np.array(slides)).tolist())
    for joints in filter(None, dict.fromkeys([*singles, turning])):
        pairs = [j for j in joints if experiment.both[j]]
        if not (slides[joints[0]] and pairs):
            yield from _in_units(experiment, joints, "qm")
        for channel in "mq" * bool(pairs):
            yield from _in_units(experiment, pairs, channel, _common_slope(experiment, pairs))


def _common_slope(experiment: Experiment, pairs: Iterable[int]) -> float:
    """Return the slope between the encoders of joints over their gear ratios, 0 if it differs."""
    slopes = [gears.other_slope(experiment, j) or 1.0 for j in pairs]
    return float(np.median(slopes)) * (max(slopes) < (1 + 3 * tol.SLIGHT) * min(slopes))


def _position_scales(experiment: Experiment) -> Iterator[Transform]:
    """Yield factors on the positions of joints with one encoder, as by other counts per turn.

    They are those of each joint, or one of all.
    """
    alone = [j for j in experiment.used if not experiment.both[j]]
    for joints in dict.fromkeys([*((j,) for j in alone), tuple(alone)]) if alone else ():
        for factor, error, penalty in best_factors(experiment, scaling(joints, "qm")):
            evidence = {"standard error": error / factor, "times": _off_by(1 / factor, error)}
            of_joints = experiment, dict.fromkeys(joints, factor), "qm"
            yield multiplied(CODES["unit"], "scaled", *of_joints, evidence, penalty)


def _off_by(slope: float, error: float) -> str:
    """Return the words for values that are `slope` times what they should be."""
    times = max(slope, 1 / slope)
    spread = f" +- {times * error:.2g}" if error else ""
    return f"are {times:.3g}{spread} times too {'large' if slope > 1 else 'small'}"


def _torques(experiment: Experiment) -> str:
    """Return the channels of the torques of all joints: with the sensors that agree with motors."""
    return "t" if _is_off(experiment, "of_sensors", tol.POOR) else "ts"


_UNITS = {unit: 1 / UNIT_FACTORS["Nm"][unit] for unit in ("mNm", "Ncm", "kNm")}
"""{unit of a torque: its value over that in N m}."""


def _torque_scales(experiment: Experiment) -> Iterator[Transform]:
    """Yield factors on the torque of a joint; those of another unit may have another sign too."""
    rounding = float(np.finfo(float).eps)
    for j in sorted({*experiment.doubted} & experiment.scales.keys()):
        slope = experiment.scales[j].shown
        is_reversed_only = slope < 0 and abs(math.log(-slope)) <= math.log(tol.FAR)
        # beyond, one of the torques is nothing but rounding next to the other
        if is_reversed_only or not rounding < abs(slope) < 1 / rounding:
            continue
        # those of the bodies of all joints suggest another factor
        near_one = experiment.scaled({j: 1 / slope}, "t")
        log_factor, error = best_value(near_one, scaling([j], "t"))
        slope = float(slope) * math.exp(-log_factor)
        if abs(slope - 1) > tol.SLIGHT:
            scale = _scale(experiment, [j], slope, error)
            of_gear = [*_of_gear(experiment, j, slope)]
            # a fitted factor that is that of the gear is no other cause, a unit is; and none
            # whose error is as large as its value
            is_known = not scale.penalty or (error < 1 and not of_gear)
            yield from [scale, *of_gear] if is_known else of_gear


def _of_gear(experiment: Experiment, j: int, slope: float) -> Iterator[Transform]:
    """Yield the transforms of a torque that is that behind its gear, which is no unit."""
    lever = float(experiment.lever[j])
    if abs(math.log(lever)) > 2 * tol.POOR > abs(math.log(abs(slope) / lever)):
        evidence = {"factor": slope, "lever": lever, "sign": _WITH_SIGN * (slope < 0)}
        of_joint = experiment, {j: math.copysign(1 / lever, slope)}, "t"
        yield multiplied(CODES["torque-scale"], "gear", *of_joint, evidence)
        if experiment.input(j) == "motor_torque" and slope > 0:
            yield _behind_gears(experiment, [j], slope)


_WITH_SIGN = ", with the opposite sign"


def _scale(
    experiment: Experiment,
    joints: Sequence[int],
    slope: float,
    error: float = 0.0,
    channels: str = "t",
) -> Transform:
    """Return the transform of torques that are `slope` times too large, or in another unit.

    `error` is the relative standard error of the slope, zero if it is not known; the `channels` of
    torques are those of motors (t) and of sensors (s).
    """
    size, sign = abs(slope), math.copysign(1.0, slope)
    known = {"standard error": max(size, 1 / size) * error} if error else {}
    unit = min(_UNITS, key=lambda name: abs(math.log(size / _UNITS[name])))
    is_unit = abs(math.log(size)) > math.log(tol.FAR)
    exact = is_unit and abs(math.log(size / _UNITS[unit])) < math.log(tol.TWICE)
    is_of_motors = all(experiment.input(j) in experiment.logged(j, channels) for j in joints)
    # A unit is one of few values and no fitted number: it costs one parameter less.
    factor = sign / _UNITS[unit] if exact else float(f"{1 / slope:.4g}")
    words = {"unit": unit, "times": _off_by(size, error), "sign": _WITH_SIGN * (sign < 0)}
    code = CODES["unit" if is_unit else "torque-scale"]
    case = "torques" if exact else "large" if is_unit else "scaled"
    names = [experiment.robot.joint_names[j] for j in joints]
    remedy = _stated(names, [error * (is_of_motors and not exact)] * len(names))
    evidence = {"factor": slope} | known | words
    scaled = experiment, dict.fromkeys(joints, factor), channels, evidence, float(not exact)
    # errors of bodies in the robot file do not explain it
    is_worse = abs(math.log(size)) > math.log(tol.TWICE)
    return multiplied(code, case, *scaled, remedy=remedy, is_worse=is_worse)


def _sensor_scales(experiment: Experiment) -> Iterator[Transform]:
    """Yield factors between the torques of motors and sensors, on either of them.

    The bodies of the robot file decide which of the two it is.
    """
    scales = experiment.sensor_scales
    for j, (slope, error) in scales.items():
        if abs(abs(slope) - 1) > max(tol.SLIGHT, tol.SURE * error):
            yield _scale(experiment, [j], slope, error / abs(slope), channels="s")
            yield _scale(experiment, [j], 1 / slope, error / abs(slope))
    factors = {j: float(f"{slope:.4g}") for j, (slope, _) in scales.items()}
    if min(factors.values(), default=0.0) > tol.TWICE:  # each by the ratio of its own gear
        others = dict.fromkeys(experiment.used, float(np.median([*factors.values()])))
        words = {"factors": listed([f"{x:g}" for x in factors.values()])}
        of_all = CODES["torque-scale"], "sensors", experiment, others | factors
        yield multiplied(*of_all, "t", words, penalty=float(len(factors)))


def _all_torque_scales(experiment: Experiment) -> Iterator[Transform]:
    """Yield a factor on all torques: their unit, that they are behind the gears, or the masses."""
    used = [*experiment.scales]
    if len(used) < 2:
        return
    slopes = np.array([scale.shown for scale in experiment.scales.values()])
    middle, channels = float(np.median(slopes)), _torques(experiment)
    start = -math.log(middle) if middle > 0 else 0.0
    # Known rotors show the factor beyond their own errors, whatever the masses of the file are.
    log_factor, error = best_value(experiment, scaling(used, channels), start)
    is_shown = abs(log_factor) > max(tol.POOR, tol.SURE * error)
    factors = {middle: 0.0} | ({math.exp(-log_factor): error} if is_shown else {})
    for factor, known in factors.items():
        if factor > 0 and abs(factor - 1) >= tol.SLIGHT:
            yield _scale(experiment, used, factor, known, channels)
    if middle <= 0 or abs(middle - 1) < tol.SLIGHT:
        return
    yield from _at_other_sides(experiment, slopes, channels)
    # `bodies` include the payloads, `robot.parameters` do not: these were weighed.
    heavier = experiment.bodies + (middle - 1) * experiment.robot.parameters
    finding = CODES["nominal-values"].finding("masses", "", {"factor": middle})
    yield Transform(finding, experiment.with_changes(bodies=heavier), penalty=1.0)


def _at_other_sides(experiment: Experiment, slopes: Array, channels: str) -> Iterator[Transform]:
    """Yield torques on the other sides of the gears: behind them, or those of the motors."""
    used = [*experiment.scales]
    lever, torques = experiment.lever[used], experiment.torque[:, used]
    behind, of_motors = (float(np.median(x)) for x in (slopes / lever, slopes * lever))
    is_of_motors = all(experiment.input(j) == "motor_torque" for j in used)
    if np.min(lever) < tol.FAR or not is_of_motors or not np.all(np.isfinite(torques)):
        return
    if 1 / tol.TWICE < behind < tol.TWICE:
        yield _behind_gears(experiment, used, float(np.median(slopes)))
    if 1 / tol.TWICE < of_motors < tol.TWICE:
        levers = dict(zip(used, lever.tolist(), strict=True))
        yield multiplied(CODES["unit"], "at-motors", experiment, levers, channels)


def _ratings(experiment: Experiment) -> Iterator[Transform]:
    """Yield torques that are parts of a rating of each motor: each has another factor.

    Factors on the torques of the bodies in the robot file differ from joint to joint as their
    limits do, or are all so large that masses do not explain them.
    """
    scales = experiment.clear_scales
    clear, logs = [*scales], np.log([scale.factor for scale in scales.values()])
    if not _are_scales(logs, experiment.lever[clear]):
        return
    least, largest = np.exp([np.min(logs), np.max(logs)]).tolist()
    ratings = {"limits": _parts_of_limits(experiment, logs, clear)}
    if least >= tol.FAR:
        ratings["masses"] = {j: 1 / x.factor for j, x in experiment.scales.items() if x.factor > 0}
    for by, parts in ((by, parts) for by, parts in ratings.items() if parts):
        names = tuple(experiment.robot.joint_names[j] for j in parts)
        words = f"# by the {by} of the robot file; the ratings in the data sheets are better"
        stated = _stated(names, _scale_errors(experiment, parts)) if by == "masses" else ""
        evidence = {"least factor": least, "largest factor": largest}
        penalty = float(len(parts) if by == "masses" else 1)
        factors = {j: float(f"{factor:.4g}") for j, factor in parts.items()}
        of_all = CODES["unit"], "ratings", experiment, factors, "t", evidence, penalty
        yield multiplied(*of_all, remedy=f"{words}\n{stated}".strip(), joints=names)


def _scale_errors(experiment: Experiment, parts: Mapping[int, float]) -> list[float]:
    """Return the relative errors of factors on the torques of joints by the bodies of the file.

    Each has an error of its own, and that of a factor on all, as of masses.
    """
    right, choices = experiment.scaled(parts, "t"), [[*parts], *([j] for j in parts)]
    shared, *errors = (best_value(right, scaling(x, "t"))[1] for x in choices)
    return [math.hypot(shared, error) for error in errors]


def _stated(joints: Sequence[str], errors: Sequence[float]) -> str:
    """Return the remedy that states the errors of scales of torques, of those that are known."""
    known = {x: error for x, error in zip(joints, errors, strict=True) if 0 < error < 1}
    lines = in_drives({(x,): f"torque_scale_std = {error:.2g}" for x, error in known.items()})
    return lines if known else ""


def _are_scales(logs: Array, levers: Array) -> bool:
    """Whether logarithms of factors on torques are large and differ, and not by the gears alone."""
    if len(logs) < 3 or np.median(np.abs(logs)) < tol.MOST or np.std(logs) < tol.MOST:
        return False
    if np.median(np.abs(logs - np.median(logs))) < 2 * tol.POOR:
        return False  # most joints have one factor: it is a unit, and another one is an outlier
    # torques behind the gears have their ratio
    return bool(np.max(np.abs(logs - np.log(levers))) >= np.log(tol.TWICE))


def _parts_of_limits(experiment: Experiment, logs: Array, clear: Sequence[int]) -> dict[int, float]:
    """Return the scales of torques that are parts of the limits of the robot file, or none."""
    is_motor = np.isfinite(experiment.torque[0])
    limits = experiment.robot.effort_limits / np.where(is_motor, experiment.lever, 1.0)
    if not np.all(np.isfinite(limits) & (limits > 0)):
        return {}
    # A part of a rating is full tau / limit, so that factor times limit is `full` at all joints.
    parts = logs + np.log(limits[clear])
    # 10^2 for per cent, 10^3 for per mille
    full = 10.0 ** np.rint(np.median(parts) / np.log(10))
    # A chained comparison: the limits explain three quarters of the variance of the factors, and
    # the factors differ by more than two.
    is_part = np.std(parts) < tol.MOST * np.std(logs) > tol.MOST * np.log(tol.TWICE)
    # masses that are a hundred times too large look like parts of 1
    return {j: float(limits[j] / full) for j in experiment.used} if is_part and full >= 100 else {}


def _behind_gears(experiment: Experiment, joints: Sequence[int], factor: float) -> Transform:
    """Return the transform of motor torques that are those behind the gears."""
    names, is_behind = experiment.robot.joint_names, np.isin(np.arange(experiment.robot.n), joints)
    effort = np.where(is_behind, np.nan, experiment.effort)
    sensed = np.where(is_behind, experiment.torque, experiment.sensed)
    sources = {names[j]: {"joint_torque": experiment.source(j, "motor_torque")} for j in joints}
    evidence = {"factor": factor, "subject": experiment.subject(joints, "t")}
    finding = CODES["unit"].finding("behind", codes.only_joint([*sources]), evidence)
    changed = experiment.with_changes(effort=effort, sensed=sensed)
    return Transform(finding, changed, sources=sources)


# Rotors and the clock


def _rotor_inertias(experiment: Experiment) -> Iterator[Transform]:
    """Yield rotor inertias: of each joint, and of all that are off, as by another unit."""
    doubted = {j: x.rotor for j, x in experiment.scales.items() if j in experiment.doubted}
    off = {j: x for j, x in doubted.items() if x > 0 and abs(x - 1) >= tol.SLIGHT}
    # lever^2 and its inverse: the inertia at the joint was given for that at the motor.
    alone = ({j: x} for j in off for x in near(off[j], experiment.lever[j] ** 2))
    # another unit of torques changes those of bodies too, by as many times at most joints
    times = float(np.median([1.0, *map(attrgetter("factor"), experiment.scales.values())]))
    for factors in chain(alone, [off] * (len(off) > 1 and 1 / tol.TWICE < times < tol.TWICE)):
        yield _with_rotors(experiment, factors, len({*factors.items()} & {*off.items()}))


def _with_rotors(experiment: Experiment, factors: Mapping[int, float], penalty: float) -> Transform:
    """Return the transform of rotor inertias that are other ones than given by factors."""
    names, count = experiment.robot.joint_names, experiment.robot.n
    inertia = experiment.inertia * [factors.get(j, 1.0) for j in range(count)]
    values = {names[j]: f"{inertia[j]:.4g}" for j in factors}
    lines = in_drives({(x,): f"motor_inertia_kg_m2 = {values[x]}" for x in values})
    evidence = {f"rotor inertia of {names[j]} over that given": x for j, x in factors.items()}
    words = {"names": listed(values), "times": listed(f"{x:.3g}" for x in factors.values())}
    of_joints = "given", codes.only_joint([*values]), {**evidence, **words}, lines
    finding = CODES["rotor-inertia"].finding(*of_joints)
    return Transform(finding, experiment.with_changes(inertia=inertia), penalty)


def _parallel_springs(experiment: Experiment) -> Iterator[Transform]:
    """Yield an undeclared spring parallel to a joint: to the fit it is a heavy body."""
    for j in experiment.doubted:
        joint, is_own = experiment.robot.joint_names[j], np.arange(experiment.robot.n) == j
        # what the file leaves of the torque, over the angle
        stiffness, error = experiment.multiple(np.where(is_own, experiment.joint[0], 0.0))
        if stiffness > tol.SURE * error and not experiment.sprung[j]:
            unit = "N/m" if experiment.robot.is_prismatic[j] else "N m/rad"
            evidence = {"stiffness": stiffness, "standard error": error, "unit": unit}
            lines = in_drives({(joint,): 'parallel_spring = ["linear", "preload"]'})
            finding = CODES["missing-term"].finding("parallel", joint, evidence, lines)
            changed = experiment.with_changes(sprung=experiment.sprung | is_own)
            yield Transform(finding, changed, penalty=1.0)


def _times(experiment: Experiment) -> Iterator[Transform]:
    """Yield clocks that run too fast or too slowly, by a round factor or another one."""
    round_factors = (0.1, 0.5, 2.0, 10.0) if _is_severe(experiment) else ()
    fitted = {x: error for x, error, _ in best_factors(experiment, _with_clock, smallest=tol.FEW)}
    for factor, error in {**dict.fromkeys(round_factors, 0.0), **fitted}.items():
        times, speeds = ("short", "large") if factor < 1 else ("long", "small")
        changed, size = _with_clock(experiment, math.log(factor)), max(factor, 1 / factor)
        known = {"factor": factor} | ({"standard error": size * error} if error else {})
        spread = f"{size:.3g}" + f" +- {size * error:.2g}" * bool(error)
        evidence = {**known, "size": spread, "times": times, "speeds": speeds}
        lines = f"in the description of the log:\ntime = {{ rate_hz = {changed.rate_hz:.6g} }}"
        finding = CODES["time-unit"].finding("clock", "", evidence, lines)
        yield Transform(finding, changed, penalty=1.0)


def _with_clock(experiment: Experiment, log_factor: float) -> Experiment:
    """Return the experiment with speeds by a factor, by its logarithm; the torques stay."""
    factor = math.exp(log_factor)
    # Position, velocity and acceleration in a time t / factor.
    powers = np.array([1.0, factor, factor**2])[:, None, None]
    return experiment.with_changes(
        joint=powers * experiment.joint,
        motor=powers * experiment.motor,
        effort_rate=factor * experiment.effort_rate,
        rate_hz=factor * experiment.rate_hz,
    )


# Channels of two joints exchanged


def _exchanges(experiment: Experiment) -> Iterator[Transform]:
    for i, j in experiment.pairs(range(experiment.robot.n)):
        first, second = pair = tuple(experiment.robot.joint_names[place] for place in (i, j))
        order = np.arange(experiment.robot.n)
        order[[i, j]] = j, i
        for sides in _exchangeable(experiment, i, j):
            # constants and gains of motors stay with them where columns are exchanged
            stays = sides == "t" or experiment.robot.has_controllers
            factor = _constant(experiment, i) / _constant(experiment, j) if stays else 1.0
            both = experiment.both[order] if {"q", "m"} <= {*sides} else experiment.both
            taken = partial(np.take, indices=order, axis=-1)
            changed = experiment.with_changes(both=both).with_channels(sides, taken)
            sources = {first: _of_other(experiment, j, sides, factor)}
            sources[second] = _of_other(experiment, i, sides, 1 / factor)
            if factor != 1:
                changed = changed.scaled({i: factor, j: 1 / factor}, "t")
            words = {"subject": experiment.subject((i, j), sides)}
            finding = CODES["swapped-joints"].finding("channels", first, words, joints=pair)
            yield Transform(finding, changed, sources=sources)


def _exchangeable(experiment: Experiment, i: int, j: int) -> Iterator[str]:
    """Yield the channels that two joints may have exchanged: with controllers all of them."""
    yield "qmts"
    if not experiment.robot.has_controllers:
        yield from ("qm", "t")
        yield from "qm" if experiment.both[i] and experiment.both[j] else ""
        yield from "s" if np.all(experiment.has_both_torques[[i, j]]) else ""


def _of_other(experiment: Experiment, j: int, channels: str, factor: float) -> dict[str, Entry]:
    """Return the sources of joint j for another one, but a torque that its controller computes."""
    if not experiment.robot.has_controllers:
        return experiment.entries(j, channels, factor=factor)
    sources = experiment.sources[0][experiment.robot.joint_names[j]]
    return {name: source for name, source in sources.items() if name != experiment.input(j)}


def _constant(experiment: Experiment, j: int) -> float:
    """Return what turns a current or a command of joint j into its torque."""
    if controller := experiment.robot.drives[experiment.robot.joint_names[j]].controller:
        return controller.position_gain_Nm_per_rad or controller.velocity_gain_Nms_per_rad
    sources = [experiment.source(j, quantity) for quantity in experiment.logged(j, "t")]
    tables = [source for source in sources if not isinstance(source, str)]
    return float(tables[0].get("torque_constant_Nm_per_A", 1.0)) if tables else 1.0


# What shows that a mistake is possible


def _is_severe(experiment: Experiment) -> bool:
    """Whether a misfit is as large as that of a wrong sign, unit, clock or place."""
    return any(_is_off(experiment, kind, tol.SEVERE) for kind in KINDS)


def _is_off(experiment: Experiment, kind: str, least: float) -> bool:
    """Whether the misfit of a kind is larger than `least` at some joint."""
    return bool(np.nanmax(getattr(experiment, kind), initial=0.0) > least)


Mistake = Check[Experiment, Transform]
Possible = Sequence[Mistake]
"""What can be wrong with a set-up, in the order in which it is tried."""

ExperimentNeed = Need[Experiment]

_BODIES = ExperimentNeed("bodies of the robot file", attrgetter("has_bodies"))
_TORQUES = ExperimentNeed("torques that change", attrgetter("used"))
_SEVERE = ExperimentNeed("a torque that is mostly unexplained", _is_severe)
_SENSORS = ExperimentNeed(
    "torques on both sides that differ", partial(_is_off, kind="of_sensors", least=tol.SLIGHT)
)
_ENCODERS = ExperimentNeed(
    "encoders on both sides that differ", partial(_is_off, kind="of_encoders", least=tol.FEW)
)


def _contradicts_bodies(experiment: Experiment) -> bool:
    """Whether the torques of known bodies are not those of the joints."""
    return bool(experiment.robot.known_bodies) and _is_off(experiment, "nominal", tol.POOR)


_CONTRADICTED = ExperimentNeed("known bodies that torques contradict", _contradicts_bodies)

MISTAKES: Possible = (
    Check(CODES["torque-scale"], (_BODIES,), _torque_scales),
    Check(CODES["rotor-inertia"], (_BODIES,), _rotor_inertias),
    Check(CODES["torque-scale"], (_BODIES,), _all_torque_scales),
    Check(CODES["unit"], (_BODIES,), _ratings),
    Check(CODES["gravity"], (_BODIES,), bodies.gravities),
    Check(CODES["geometry"], (_BODIES,), bodies.lengths),
    Check(CODES["encoder-offset"], (_BODIES,), bodies.zeros),
    Check(CODES["unit"], (_BODIES,), _position_scales),
    Check(CODES["missing-term"], (_BODIES,), _parallel_springs),
    Check(CODES["payload"], (_BODIES,), bodies.payloads),
    Check(CODES["encoder-offset"], (_SEVERE,), bodies.quarter_turns),
    Check(CODES["unit"], (_SEVERE,), gears.geared_encoders),
    Check(CODES["sign"], (_SEVERE,), _signs),
    Check(CODES["unit"], (_SEVERE,), _positions),
    Check(CODES["swapped-joints"], (_SEVERE,), _exchanges),
    Check(CODES["coupled-joints"], (_SEVERE,), gears.absolute_positions),
    Check(CODES["torque-scale"], (_SENSORS,), _sensor_scales),
    Check(CODES["gear-ratio"], (_TORQUES,), gears.gear_ratios),
    Check(CODES["time-unit"], (_TORQUES,), _times),
    Check(CODES["coupled-joints"], (_ENCODERS,), gears.coupled_motors),
    Check(CODES["coupled-joints"], (_ENCODERS,), gears.differentials),
    Check(CODES["gear-compliance"], (_ENCODERS,), gears.undeclared_springs),
    Check(CODES["varying-ratio"], (_ENCODERS,), gears.linkages),
)
"""The mistakes that torques show."""

OF_COMMANDS: Possible = (
    Check(CODES["saturation"], (_BODIES,), commands.torque_limits),
    Check(CODES["gain-scale"], (_BODIES,), commands.gain_scales),
    Check(CODES["encoder-offset"], (_BODIES,), bodies.zeros),
    Check(CODES["sign"], (_CONTRADICTED,), bodies.poses),
    Check(CODES["swapped-joints"], (_CONTRADICTED,), _exchanges),
)
"""The mistakes that the torques of controllers show."""


def log_findings(
    robot: Robot, logs: Sequence[Log], torque_joints: Collection[str] | None = None
) -> list[Finding]:
    """Return the findings that need no motion: the unit of time, drives, saturated torques.

    Those of torques and commands are of the `torque_joints`, by default of all.
    """
    used = robot.joint_names if torque_joints is None else torque_joints
    return observed(OF_LOGS, Logged(robot, logs, used))


def _unmeasured(logged: Logged) -> Iterator[Finding]:
    """Yield what is wrong with torques and commands, see `commands`."""
    for log, look in product(logged.logs, (commands.no_measurements, commands.command_findings)):
        yield from (x for x in look(logged.robot, log) if x.joint in logged.used)


def _sizes(logged: Logged) -> Iterator[Finding]:
    """Yield that lengths of the robot file are in mm, or gravity in another unit than m/s^2."""
    model, bodies = logged.robot.model, logged.robot.parameters.reshape(-1, 10)
    of_mass = bodies / np.where(bodies[:, :1] > 0, bodies[:, :1], np.inf)
    sizes = {
        "joints that are apart by": np.array([x.translation for x in model.jointPlacements]),
        "centres of mass away from their joints by": of_mass[:, 1:4],
        # I / m is the square of a radius of gyration
        "radii of gyration of": np.sqrt(np.abs(of_mass[:, [4, 6, 9]])),
    }
    farthest = {words: float(np.max(np.linalg.norm(x, axis=1))) for words, x in sizes.items()}
    far = [f"{words} {size:.3g} m" for words, size in farthest.items() if size > tol.LONGEST_M]
    if far:
        evidence = {"longest distance [m]": max(farthest.values()), "far": listed(far)}
        yield CODES["geometry"].finding("large", "", evidence)
    size = float(np.linalg.norm(model.gravity.linear))
    if size > tol.STRONGEST_M_PER_S2:
        of_size = "strong", "", {"gravity [m/s^2]": size}, codes.with_gravity("0,0,-9.81")
        yield CODES["gravity"].finding(*of_size)


OF_LOGS: Sequence[Check[Logged, Finding]] = (
    *channels.OF_LOGS,
    Check(CODES["no-measurement"], (), _unmeasured),
    Check(CODES["geometry"], (), _sizes),
)
"""What is looked for in logs alone."""


def setup_findings(experiment: Experiment, known: Sequence[Finding]) -> list[Finding]:
    """Return the `known` findings and the mistakes of the set-up, unless those explain the torques.

    Torques beyond their limits are no finding of joints whose gains are in another unit, or whose
    limit is another one.
    """
    findings = [*known, *_of_motion(experiment, known)]
    joints = {joint for finding in findings for joint in finding.joints}
    return [x for x in findings if x.code != "saturation" or x.joints or x.joint not in joints]


def _of_motion(experiment: Experiment, known: Sequence[Finding]) -> list[Finding]:
    """Return the mistakes of the set-up that the motion shows, next to `known` findings."""
    spoiling = {"time-unit", "missing-drives", "wraps", "geometry", "gravity", "holes"}
    of_logs = {finding.code for finding in known if finding.severity != "note"}
    wrong = {finding.code for finding in known if finding.severity == "wrong"}
    if (of_logs & spoiling) | (wrong & {"no-measurement", "delay"}):
        return []  # the torques show no other mistake
    slips, notes = list[Finding](), list[Finding]()
    with guarded(CODES["loose-encoder"], notes):
        slips, experiment = gears.without_slips(experiment)
    hiding = ([*proposals([check], notes, experiment)] for check in OF_MOTION)
    findings = next(filter(None, hiding), [])
    if not findings:
        search = _of_commands if experiment.robot.has_controllers else _of_torques
        with guarded(CODES["nominal-values"], notes):
            findings = search(experiment, known)
    return [*slips, *findings, *notes]


def _of_torques(experiment: Experiment, known: Sequence[Finding]) -> list[Finding]:
    """Return the mistakes of the set-up that torques show, and what contradicts the robot file."""
    # a torque that ends at a limit has a factor that no sensor has, what holds an output is no body
    hidden = {"saturation", "locked-output"}
    kept = {*experiment.robot.joint_names} - {x.joint for x in known if x.code in hidden}
    findings, without = mistakes(with_torques_of(experiment, kept).in_motion)
    is_named = any(finding.severity != "note" for finding in findings)
    beyond = [] if is_named else channels.limit_findings(experiment)
    return [*findings, *beyond, *observed(OF_REST, without)]


OF_REST = (
    Check(CODES["loose-encoder"], (), gears.unlike_motions),
    Check(CODES["gear-compliance"], (), gears.small_springs),
    Check(CODES["nominal-values"], (), bodies.file_findings),
)
"""What is found next to all mistakes."""


def _of_commands(experiment: Experiment, known: Sequence[Finding]) -> list[Finding]:
    """Return the mistakes of the set-up of a robot with controllers.

    The channels of a torque are not there, and an unknown armature looks like another mistake.
    """
    if any(finding.severity == "wrong" for finding in known):
        return []
    stopped = {finding.joint for finding in known if finding.code == "contact"}
    findings, without = mistakes(experiment, OF_COMMANDS)
    findings += channels.limit_findings(without)
    return [finding for finding in findings if finding.joint not in stopped]


_NO_CONTROLLERS = ExperimentNeed("no controllers", lambda x: not x.robot.has_controllers)
OF_MOTION: Sequence[Check[Experiment, Finding]] = (
    Check(CODES["encoder-offsets-differ"], (), channels.offset_findings),
    Check(CODES["no-measurement"], (_NO_CONTROLLERS, _BODIES), commands.magnitudes),
    Check(CODES["no-measurement"], (_NO_CONTROLLERS,), commands.of_friction_alone),
    Check(CODES["gear-ratio"], (_NO_CONTROLLERS, _BODIES), gears.missing_ratios),
)
"""What hides all else: the first that finds something ends the search."""
