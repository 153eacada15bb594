"""Mistakes of a set-up as transforms: what a model explains if a sign, a unit or a place differs.

`MISTAKES` lists what can be wrong with a channel, a drive, gravity or a body, and what each needs.
A transform undoes one of them. The one that explains most is a finding, if the log shows it without
the bodies of the robot file or contradicts these by far; all others are tested again without that
mistake (forward selection): two mistakes are found in turn, and the echoes of the first one vanish.
What explains as much as the finding is named in it, with the measurement that decides.

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
from scipy.special import chdtri

from seaid._arrays import Array
from seaid.checks.bodies import (
    file_findings,
    gravities,
    lengths,
    payloads,
    quarter_turns,
    zeros,
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
    observed,
    only_joint,
)
from seaid.checks.codes import (
    CONTACT,
    COUPLED_JOINTS,
    ENCODER_OFFSET,
    GEAR_RATIO,
    GEOMETRY,
    GRAVITY,
    HOLES,
    LOCKED_OUTPUT,
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
from seaid.checks.echoes import AS_GIVEN
from seaid.checks.experiment import (
    Experiment,
    Transform,
    fitted,
    near,
    scaled,
    with_torques_of,
)
from seaid.checks.gears import (
    coupled_motors,
    gear_ratios,
    geared_encoders,
    linkages,
    other_slope,
)
from seaid.checks.tolerances import FAR, FEW, MOST, POOR, SEVERE, SIGNIFICANT, SLIGHT, SURE, TWICE
from seaid.errors import Certainty, Finding
from seaid.estimation import scaled_svd
from seaid.log import Log, changed_source
from seaid.robot import Robot

_MOST_MISTAKES = 5
"""Mistakes that are looked for one after the other."""

_SHORTLIST = 12
"""Transforms, best by what is quickly computed, whose other misfits are computed too."""


@dataclass(frozen=True)
class Mistake:
    """A kind of mistake: `transforms` yields what undoes it where the `needs` are met."""

    transforms: Callable[[Experiment], Iterator[Transform]]
    needs: tuple[Callable[[Experiment], bool], ...]


@dataclass(frozen=True)
class _Trial:
    """A transform that was tried: the experiment without the mistake, and what speaks for it.

    `falls` are the misfits that matter and fall by half, {(kind, joint): part that remains}. Gains
    of the log likelihood: `direct` by all that does not rest on the robot file, `shown` by what
    matters of it, `bodies` by the bodies of the robot file and their errors.
    """

    transform: Transform
    changed: Experiment
    falls: Mapping[tuple[str, int], float]
    shown: float
    direct: float
    bodies: float

    @property
    def total(self) -> float:
        return self.direct + self.bodies - self.transform.penalty

    @property
    def remaining(self) -> float:
        """Misfit at its joints, or at the middle one of all: by any bodies or those of the file.

        Another mistake may contradict the latter, or one of the two joints of an exchange.
        """
        misfit = np.fmin(self.changed.nominal, self.changed.free)
        names = [name for name in (self.transform.joint, self.transform.other) if name]
        own = misfit[[self.changed.robot.index(name) for name in names]]
        return float(np.nanmin(own)) if np.any(np.isfinite(own)) else _median(misfit)


def mistakes(experiment: Experiment) -> tuple[list[Finding], Experiment]:
    """Return the mistakes that explain an experiment far better, and it without them."""
    findings: list[Finding] = []
    while len(findings) < _MOST_MISTAKES:
        trials = _trials(experiment)
        if any(finding.severity != "note" for finding in findings):
            # its value has an error, which makes others small ones that are none
            trials = [trial for trial in trials if trial.falls]
        if not trials:
            break
        findings.append(_finding(experiment, trials))
        experiment = _described(trials[0].changed, findings[-1].remedy)
        if trials[0].transform.code == NOMINAL_VALUES:
            experiment = replace(experiment, bodies=np.full_like(experiment.bodies, np.nan))
    return findings, experiment


def _described(experiment: Experiment, remedy: str) -> Experiment:
    """Return the experiment whose channels are read as a remedy describes them.

    The lines of the next mistake in a channel then contain those of this one.
    """
    header, _, lines = remedy.partition("\n")
    if not header.endswith("in the description of the log:"):
        return experiment
    changed = tomllib.loads(lines).get("joints", {})
    sources = (
        {joint: {**entries, **changed.get(joint, {})} for joint, entries in log.items()}
        for log in experiment.sources
    )
    return replace(experiment, sources=tuple(sources))


def transforms(experiment: Experiment) -> Iterator[Transform]:
    """Yield what undoes each mistake that is possible."""
    for mistake in MISTAKES:
        if all(need(experiment) for need in mistake.needs):
            yield from mistake.transforms(experiment)


def _trials(experiment: Experiment) -> list[_Trial]:
    """Return the transforms that the log demands, the best first.

    Twice the log of a likelihood ratio has the distribution of chi-square, with the number of
    fitted values as its degrees of freedom, and at most that of one between values that are not
    fitted. The least gain is that of which all transforms together have one by chance in a hundred
    logs. It has to come from what the log shows without the robot file, where a misfit that matters
    falls, or from all together, and the bodies of the file contradict it by less. Signs, units,
    clocks and exchanges are mistakes that matter. None makes a misfit of another joint matter that
    did not.
    """
    tried = [(each, each.undo(experiment)) for each in transforms(experiment)]
    rows = experiment.independent_rows

    def by_file(pair: tuple[Transform, Experiment]) -> float:
        transform, changed = pair
        by_bodies = changed.file[0] if _has_bodies(experiment) else changed.cost("free", rows)
        direct = changed.cost("motor", rows) + changed.cost("encoders", rows)
        return by_bodies + direct + transform.penalty

    def by_joint(pair: tuple[Transform, Experiment]) -> float:
        return pair[1].cost("nominal", rows) + pair[0].penalty

    def is_demanded(trial: _Trial) -> bool:
        values = max(trial.transform.penalty, 1)
        least = float(chdtri(values, FEW / len(tried))) / 2
        if trial.shown > least:
            return trial.total > 0
        is_possible = bool(trial.falls) or trial.transform.code in _OF_VALUES
        return trial.shown + trial.bodies > least and is_possible and _explains_all(trial)

    # one of several mistakes repairs its joints, while the others still contradict the robot file
    best = [pair for cost in (by_file, by_joint) for pair in sorted(tried, key=cost)[:_SHORTLIST]]
    trials = [_trial(experiment, *pair) for pair in dict.fromkeys(best)]
    trials = [trial for trial in trials if trial.remaining < MOST and is_demanded(trial)]
    return sorted(trials, key=lambda trial: -trial.total)


_OF_VALUES = (
    ENCODER_OFFSET,
    GEOMETRY,
    GRAVITY,
    NOMINAL_VALUES,
    PAYLOAD,
    ROTOR_INERTIA,
    TORQUE_SCALE,
)
"""Mistakes that may be small."""


def _trial(experiment: Experiment, transform: Transform, changed: Experiment) -> _Trial:
    rows = experiment.independent_rows
    gains = sum(experiment.cost(kind, rows) - changed.cost(kind, rows) for kind in _DIRECT)
    falls, is_value = _falls(experiment, changed), transform.code in _OF_VALUES
    shown = min(gains, _shown(experiment, changed, is_value)) if falls or is_value else 0.0
    losses = [
        float(np.nansum(np.where(after > POOR, rows * np.log(after / np.maximum(before, FEW)), 0)))
        for before, after in ((experiment.misfits[x], changed.misfits[x]) for x in _EXPLAINED_BY)
    ]
    if max(losses) >= SURE**2 / 2:  # a mistake contradicts no kind of evidence
        gains = shown = -math.inf
    bodies = experiment.file[0] - changed.file[0]
    return _Trial(transform, changed, falls, shown, gains, bodies)


def _explains_all(trial: _Trial) -> bool:
    """Whether bodies explain the torques without the mistake."""
    misfit = _median(np.fmin(trial.changed.nominal, trial.changed.free))
    return max(misfit, trial.remaining) < SEVERE


_EXPLAINED_BY = {
    "nominal": "torque (by the bodies of the robot file)",
    "free": "torque (by any bodies)",
    "motor": "motor torque",
    "encoders": "motion between the encoders",
}


_DIRECT = ("free", "motor", "encoders")
"""Misfits that do not rest on the bodies of the robot file."""


def _falls(before: Experiment, after: Experiment) -> dict[tuple[str, int], float]:
    """Return the misfits that matter and fall by half, {(kind, joint): part that remains}."""
    ratios = {
        (kind, j): float(max(after.misfits[kind][j], FEW) / misfit[j])
        for kind, misfit in before.misfits.items()
        for j in np.flatnonzero(misfit > POOR).tolist()
    }
    return {place: ratio for place, ratio in ratios.items() if ratio < MOST}


def _shown(before: Experiment, after: Experiment, is_value: bool) -> float:
    """Return the gain of the log likelihood by what matters and does not rest on the robot file.

    Where much is left it is the model's error, which any change makes somewhat smaller or larger:
    only a fall by half counts there. Where nearly nothing is left it is noise, whose likelihood
    shows a value that is off by little.
    """
    gain = 0.0
    for kind in _DIRECT:
        x, y = (np.fmax(each.misfits[kind], FEW) for each in (before, after))
        counts = ((x > SLIGHT) & (y < MOST * x)) | (is_value & (y < SLIGHT))
        gain += float(np.sum(np.where(counts, before.independent_rows * np.log(x / y), 0.0)))
    return gain


def _finding(experiment: Experiment, trials: Sequence[_Trial]) -> Finding:
    """Return the finding of the first trial, with those that explain as much."""
    best, transform = trials[0], trials[0].transform
    message, evidence, severity = transform.message, {**transform.evidence}, transform.severity
    if best.falls:
        kind, j = min(best.falls, key=best.falls.__getitem__)
        before, after = (float(x.misfits[kind][j]) for x in (experiment, best.changed))
        evidence |= {AS_GIVEN: before, "misfit without it": after}
        message += (
            f": the part of the {_EXPLAINED_BY[kind]} of {experiment.robot.joint_names[j]} that is "
            f"left unexplained falls from {before:.0%} to {after:.0%}"
        )
    else:
        evidence["standard errors"] = math.sqrt(2 * (best.direct + best.bodies))
        severity = "note" if severity == "note" else "doubtful"
        message += (
            f": the torques contradict the value given by {evidence['standard errors']:.0f} "
            "standard errors, errors of the bodies in the robot file included"
        )
    remedy, certainty = transform.remedy, _certainty(best)
    rivals = _rivals(trials)
    if rivals:
        evidence |= {f"or {x.transform.code.name}": best.total - x.total for x in rivals}
        others = [rival.transform for rival in rivals]
        causes = [(message, transform), *((other.message, other) for other in others)]
        message = "; or ".join(text + _DECIDED[cause.code][0] for text, cause in causes)
        measures = list(dict.fromkeys(_DECIDED[cause.code][1] for _, cause in causes))
        remedy = f"the log does not decide between these: {' or '.join(measures[:2])} first"
        certainty = "possible"
    return transform.code.finding(message, transform.joint, severity, evidence, remedy, certainty)


def _rivals(trials: Sequence[_Trial]) -> list[_Trial]:
    """Return the best of each other code and joint that explains as much as the first trial."""
    best, transform = trials[0], trials[0].transform
    rivals = {
        (trial.transform.code, trial.transform.joint): trial
        for trial in reversed(trials)
        if trial.total > best.total - SURE**2 / 2
        and trial.transform.penalty <= transform.penalty + 1  # the simple one of two that agree
    }
    rivals.pop((transform.code, transform.joint))
    return list(rivals.values())


def _certainty(trial: _Trial) -> Certainty:
    """Return how sure a mistake is: at most likely if it rests on the bodies of the robot file."""
    return "certain" if trial.shown > SIGNIFICANT**2 / 2 else "likely"


def _median(values: Array) -> float:
    """Return the median of the finite values, NaN for none."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


_DECIDED = {
    UNIT: ("", "turn a joint by a known angle and hold a known weight"),
    TIME_UNIT: ("", "compare the duration of the log with a clock"),
    SIGN: ("", "turn the joint by hand in its positive direction and look at the signs"),
    SWAPPED_JOINTS: ("", "move one of the joints alone"),
    GEAR_RATIO: ("", "count the turns of the motor for one of the joint"),
    PAYLOAD: (" (then the bodies are estimated with that error)", "weigh the payload"),
    GRAVITY: ("", "measure the tilt of the base"),
    ENCODER_OFFSET: ("", "turn the joints to the zeros of the robot file and read the encoders"),
    COUPLED_JOINTS: ("", "turn one of the joints by hand and look which motors turn with it"),
    VARYING_RATIO: ("", "count the turns of the motor at several angles of the joint"),
    GEOMETRY: ("", "measure the distance between the joints"),
    ROTOR_INERTIA: ("", "move the motor without its load"),
    TORQUE_SCALE: (
        " (then all that is estimated from these torques is off by that factor)",
        "hold a known weight at a known distance and compare the torque",
    ),
    NOMINAL_VALUES: (" (then the estimate is right and the file is not)", "weigh a link"),
}
"""{code: (what it implies if it is the cause, the measurement that decides)}."""


# What a transform needs


def _has_bodies(experiment: Experiment) -> bool:
    return bool(experiment.used) and bool(np.all(np.isfinite(experiment.bodies)))


def _has_joints(experiment: Experiment) -> bool:
    return len(experiment.used) > 1


def _is_severe(experiment: Experiment) -> bool:
    """Whether a misfit is as large as that of a wrong sign, unit, clock or place."""
    misfits = [np.nanmax(misfit, initial=0.0) for misfit in experiment.misfits.values()]
    return float(max(misfits)) >= SEVERE


def _has_own_channels(experiment: Experiment) -> bool:
    """Whether each joint has its motor."""
    return np.array_equal(experiment.robot.transmission, np.eye(experiment.robot.n))


def _has_encoders_apart(experiment: Experiment) -> bool:
    """Whether the encoders of a joint contradict each other."""
    return bool(np.nanmax(experiment.of_encoders, initial=0.0) > SLIGHT)


# Factors on channels: signs, units of angles and of torques


def _entries(experiment: Experiment, joints: Sequence[int], channels: str, factor: float) -> str:
    """Return the lines of a description that multiply logged channels of joints by a factor."""
    return in_description(
        {
            experiment.robot.joint_names[j]: {
                quantity: changed_source(experiment.source(j, quantity), factor=factor)
                for quantity in experiment.logged(j, channels)
            }
            for j in joints
        }
    )


_WORDS = {"joint_position": "joint encoder", "motor_position": "motor encoder"}


def _words(experiment: Experiment, j: int, channels: str, several: str = "") -> str:
    """Return the words for logged channels of a joint."""
    return " and ".join(
        f"{_WORDS.get(quantity, 'torque')}{several}" for quantity in experiment.logged(j, channels)
    )


def _multiplied(
    code: Code,
    experiment: Experiment,
    joints: Sequence[int],
    channels: str,
    factor: float,
    message: str,
    **more: Any,
) -> Transform:
    """Return the transform that multiplies channels (q, m, t) of joints by a factor."""
    undo = partial(scaled, joints=joints, factors=dict.fromkeys(channels, factor))
    joint = only_joint([experiment.robot.joint_names[j] for j in joints])
    remedy = _entries(experiment, joints, channels, factor)
    return Transform(code, message, undo, joint, remedy, **more)


_SIGNS = {True: {"t": 0.0, "qm": 1.0, "qmt": 0.0}, False: {"q": 0.0, "m": 0.0, "qt": 1.0}}
"""{whether the encoders turn the same way: {channels of the opposite sign: penalty}}."""


def _signs(experiment: Experiment) -> Iterator[Transform]:
    for j in experiment.used:
        joint = experiment.robot.joint_names[j]
        product = float(
            np.mean(experiment.motor[1][:, j] * experiment.joint[1][:, j]) * experiment.ratio[j]
        )
        agree = not experiment.both[j] or product > 0
        if not agree and product < 0:
            yield _multiplied(
                GEAR_RATIO,
                experiment,
                [j],
                "mt",
                -1.0,
                f"the gear of {joint} reverses: its ratio is negative, so that motor encoder and "
                "torque have the opposite sign",
                evidence={"given ratio": float(experiment.ratio[j])},
            )
        for channels, penalty in _SIGNS[agree].items():
            words = _words(experiment, j, channels)
            message = f"the {words} of {joint} has the opposite sign"
            if channels == "qmt":
                message = f"the whole joint {joint} has the opposite sign, {words}"
            yield _multiplied(SIGN, experiment, [j], channels, -1.0, message, penalty=penalty)


def _sign_of_torques(experiment: Experiment) -> Iterator[Transform]:
    message = "the torques of all joints have the opposite sign"
    yield _multiplied(SIGN, experiment, experiment.used, "t", -1.0, message)


_ANGLES = {"deg": math.pi / 180, "turn": 2 * math.pi, "rad": 180 / math.pi}
"""{unit of an angle: the factor that repairs it}; "rad" where degrees were declared."""


def _turns(experiment: Experiment, joints: Sequence[int], factor: float) -> bool:
    """Whether a factor on the positions leaves the ranges of joints possible, by their median.

    A range in degrees is 57 times smaller than it seems: a joint that seems to move by a radian
    would hardly move. Two turns are the range of a wrist.
    """
    moved = factor * float(np.median(np.ptp(experiment.joint[0][:, joints], axis=0)))
    return POOR < moved < 4 * math.pi


def _angles(experiment: Experiment) -> Iterator[Transform]:
    """Yield units of the angles of a joint, at both sides or at the one that the slope suggests."""
    evidence = "slope between the encoders over the gear ratio"
    for j in experiment.used:
        joint, is_prismatic = experiment.robot.joint_names[j], experiment.robot.is_prismatic[j]
        slope = other_slope(experiment, j)
        for unit, factor in _ANGLES.items():
            if not is_prismatic and _turns(experiment, [j], factor):
                message = f"the positions of {joint} are in {unit}"
                yield _multiplied(UNIT, experiment, [j], "qm", factor, message)
            for channel, effect in (("m", factor), ("q", 1 / factor)):
                if slope and abs(math.log(slope * effect)) < 3 * SLIGHT:
                    message = f"the {_words(experiment, j, channel)} of {joint} is in {unit}"
                    slopes = {evidence: slope}
                    yield _multiplied(
                        UNIT, experiment, [j], channel, factor, message, evidence=slopes
                    )


def _all_angles(experiment: Experiment) -> Iterator[Transform]:
    """Yield units of the angles of all joints, at both sides or at one."""
    turning = [j for j in range(experiment.robot.n) if not experiment.robot.is_prismatic[j]]
    both = [j for j in turning if experiment.both[j]]
    choices = [("qm", turning, "positions"), ("q", both, "joint encoders")]
    choices.append(("m", both, "motor encoders"))
    for unit, factor in _ANGLES.items():
        for channels, joints, words in choices:
            if len(joints) > 1 and (channels != "qm" or _turns(experiment, joints, factor)):
                message = f"the {words} of all joints are in {unit}"
                yield _multiplied(UNIT, experiment, joints, channels, factor, message)


_UNITS = {"mNm": 1e3, "kNm": 1e-3}
"""{unit of a torque: its value over that in N m}."""


def _slopes(experiment: Experiment, j: int) -> tuple[float, float]:
    """Return the torque over that of the nominal bodies, and the rotor inertia over the given.

    The first one is zero where the torque does not show those of the bodies, as one that friction
    alone explains: in any unit it would explain as much.
    """
    slope, error, rotor = _slope_of_bodies(experiment, j)
    return slope * (abs(slope) > SURE * error), rotor


def _slope_of_bodies(experiment: Experiment, j: int) -> tuple[float, float, float]:
    """Return the torque over that of the nominal bodies, its error, and the slope of the rotor."""
    of_bodies = experiment.regressor[:, j] @ experiment.bodies
    columns = np.column_stack([of_bodies, experiment.load_columns(j)])
    y = experiment.lever[j] * experiment.torque[:, j]
    if np.all(np.isnan(y)):
        y = experiment.sensed[:, j]
    rotor = experiment.lever[j] * experiment.motor[2][:, j]
    has_rotor = experiment.inertia[j] > 0 and bool(np.all(np.isfinite(experiment.torque[:, j])))
    if has_rotor:
        columns = np.column_stack([columns, experiment.inertia[j] * rotor])
    x, covariance = fitted(columns, y)
    rotor_slope = float(x[-1]) if has_rotor else math.nan
    return float(x[0]), math.sqrt(covariance[0, 0]), rotor_slope


def _of_friction_alone(experiment: Experiment) -> Iterator[Finding]:
    """Yield torques that lack those of the nominal bodies, which other joints show.

    Their slope is zero, with an error that is far below one, and friction explains the torque.
    """
    if not _has_bodies(experiment):
        return
    # a payload that is named and not there has no torque, of a joint that measures well
    experiment = replace(experiment, bodies=experiment.robot.parameters)
    slopes = {j: _slope_of_bodies(experiment, j)[:2] for j in experiment.used}
    shown = [j for j, (slope, error) in slopes.items() if slope > max(POOR, SURE * error)]
    names = [experiment.robot.joint_names[j] for j in shown]
    for j, (slope, error) in slopes.items():
        torque = experiment.lever[j] * experiment.torque[:, j]
        rubbing = experiment.friction[j]
        left = torque - rubbing @ scaled_svd(rubbing).solve(np.nan_to_num(torque))
        is_friction = float(np.std(left)) < SEVERE * float(np.std(torque))
        is_silent = abs(slope) < SURE * error < POOR and is_friction
        if is_silent and 2 * len(shown) > len(slopes):
            joint = experiment.robot.joint_names[j]
            yield NO_MEASUREMENT.finding(
                f"the torque of {joint} has {slope:.2g} +- {error:.2g} times that of the bodies of "
                "the robot file, and follows the direction of its motion: it measures friction, or "
                "nothing",
                joint,
                "wrong",
                {"torque over that of the bodies": slope, "standard error": error},
                f"log the current or the torque that the drive measures{excluding_torque(names)}",
            )


def _torque_scales(experiment: Experiment) -> Iterator[Transform]:
    """Yield factors on the torque of a joint."""
    for j in experiment.used:
        slope, _ = _slopes(experiment, j)
        if slope > 0:
            slope *= _refinement(scaled(experiment, j, {"t": 1 / slope}), j)
            if abs(slope - 1) > SLIGHT:
                words = f"the torque of {experiment.robot.joint_names[j]} is"
                yield _scale(experiment, [j], slope, words)


def _scale(
    experiment: Experiment, joints: Sequence[int], slope: float, words: str, penalty: float = 0.0
) -> Transform:
    """Return the transform of torques that are `slope` times too large, or in another unit."""
    unit = min(_UNITS, key=lambda name: abs(math.log(slope / _UNITS[name])))
    is_unit = abs(math.log(slope)) > math.log(FAR)
    exact = is_unit and abs(math.log(slope / _UNITS[unit])) < math.log(TWICE)
    factor = 1 / _UNITS[unit] if exact else float(f"{1 / slope:.4g}")
    off = f"{slope:.3g} times too large" if slope > 1 else f"{1 / slope:.3g} times too small"
    return _multiplied(
        UNIT if is_unit else TORQUE_SCALE,
        experiment,
        joints,
        "t",
        factor,
        f"{words} {f'in {unit}' if exact else off}",
        severity="wrong" if is_unit else "doubtful",
        evidence={"factor": slope},
        penalty=penalty if exact else 1.0 + penalty,
    )


def _refinement(experiment: Experiment, j: int) -> float:
    """Return the factor on the torque of a joint that the nominal bodies of all joints suggest.

    Nominal torques are the instrument: noise of the logged one would bias least squares.
    """
    nominal, own = experiment.regressor @ experiment.bodies, np.arange(experiment.robot.n) == j
    torque = np.where(
        np.isnan(experiment.torque), experiment.sensed, experiment.lever * experiment.torque
    )
    z, x = experiment.weighed(own * nominal), experiment.weighed(own * torque)
    size = float(z @ x)
    inverse = 1 - float(z @ experiment.unexplained) / size if size else 1.0
    return 1 / inverse if 0.5 < inverse < 2.0 else 1.0


def _all_torque_scales(experiment: Experiment) -> Iterator[Transform]:
    """Yield a factor on all torques: their unit, that they are behind the gears, or the masses."""
    slopes, rotors = np.array([_slopes(experiment, j) for j in experiment.used]).T
    middle, rotor = float(np.median(slopes)), _median(rotors)
    if middle <= 0:
        return
    # torques in another unit change the apparent rotor inertias too, masses do not
    of_masses = rotor > 0 and abs(math.log(rotor)) < 0.5 * abs(math.log(middle))
    words = "the torques of all joints are"
    yield _scale(experiment, experiment.used, middle, words, penalty=1.0 if of_masses else 0.0)
    levers = experiment.lever[experiment.used]
    is_driven = np.all(np.isfinite(experiment.torque[:, experiment.used]))
    is_behind = 1 / TWICE < float(np.median(slopes / levers)) < TWICE
    if is_driven and np.min(levers) >= FAR and is_behind:
        yield _behind_gears(experiment, middle)
    heavier = experiment.bodies + (middle - 1) * experiment.robot.parameters
    yield Transform(
        NOMINAL_VALUES,
        f"the torques are {middle:.3g} times those of the masses in the robot file: wrong "
        "nominal values, or a payload that was not given",
        partial(replace, bodies=heavier),
        severity="note",
        remedy="correct the masses in the robot file, or name the payload",
        evidence={"factor": middle},
        penalty=1.0,
    )


def _behind_gears(experiment: Experiment, factor: float) -> Transform:
    """Return the transform of motor torques that are those behind the gears."""
    is_used = np.isin(np.arange(experiment.robot.n), experiment.used)
    torque = np.where(is_used, np.nan, experiment.torque)
    sensed = np.where(is_used, experiment.torque, experiment.sensed)
    sources = {
        experiment.robot.joint_names[j]: {
            "joint_torque": changed_source(experiment.source(j, "motor_torque"))
        }
        for j in experiment.used
    }
    note = '# or, if they are computed from currents: motor_torque = {..., side = "joint"}'
    return Transform(
        UNIT,
        "the torques of all joints are those behind the gears, not those of the motors",
        partial(replace, torque=torque, sensed=sensed),
        remedy=f"{in_description(sources)}\n{note}",
        evidence={"factor": factor},
    )


# Rotors and the clock


def _rotor_inertias(experiment: Experiment) -> Iterator[Transform]:
    for j in experiment.used:
        joint, (_, rotor) = experiment.robot.joint_names[j], _slopes(experiment, j)
        if not (math.isfinite(rotor) and rotor > 0) or abs(rotor - 1) < SLIGHT:
            continue
        for factor in near(rotor, experiment.lever[j] ** 2):
            inertia = experiment.inertia.copy()
            inertia[j] *= factor
            yield Transform(
                ROTOR_INERTIA,
                f"the rotor inertia of {joint} is {inertia[j]:.3g} kg m^2, not "
                f"{experiment.inertia[j]:.3g}",
                partial(replace, inertia=inertia),
                joint,
                in_drives({(joint,): f"motor_inertia_kg_m2 = {inertia[j]:.4g}"}),
                evidence={"ratio": factor},
                penalty=float(factor == rotor),
            )


_FACTORS_OF_TIME = {
    0.1: "10 times too short, so that speeds are too large",
    0.5: "2 times too short, so that speeds are too large",
    2.0: "2 times too long, so that speeds are too small",
    10.0: "10 times too long, so that speeds are too small",
}


def _times(experiment: Experiment) -> Iterator[Transform]:
    """Yield clocks that run too fast or too slowly by a round factor."""
    for factor, words in _FACTORS_OF_TIME.items():
        yield Transform(
            TIME_UNIT,
            f"the time of the log is {words}",
            partial(_with_time, factor=factor),
            remedy="in the description of the log:\n"
            f"time = {{ rate_hz = {experiment.rate_hz * factor:.6g} }}",
            evidence={"factor": factor},
            penalty=1.0,
        )


def _with_time(experiment: Experiment, factor: float) -> Experiment:
    powers = np.array([1.0, factor, factor**2])[:, None, None]
    return replace(
        experiment,
        joint=powers * experiment.joint,
        motor=powers * experiment.motor,
        torque_rate=factor * experiment.torque_rate,
        rate_hz=experiment.rate_hz * factor,
    )


# Channels of two joints exchanged


def _exchanges(experiment: Experiment) -> Iterator[Transform]:
    for pair in combinations(range(experiment.robot.n), 2):
        names = [experiment.robot.joint_names[j] for j in pair]
        for channels in ("qmt", "qm", "t", *("qm" if np.all(experiment.both[[*pair]]) else "")):
            words = "channels" if channels == "qmt" else _words(experiment, pair[0], channels, "s")
            sources = {
                experiment.robot.joint_names[j]: {
                    quantity: changed_source(experiment.source(other, quantity))
                    for quantity in experiment.logged(other, channels)
                }
                for j, other in (pair, pair[::-1])
            }
            yield Transform(
                SWAPPED_JOINTS,
                f"the {words} of {names[0]} and {names[1]} are exchanged",
                partial(_exchanged, pair=[*pair], channels=channels),
                names[0],
                in_description(sources),
                other=names[1],
            )


def _exchanged(experiment: Experiment, pair: list[int], channels: str) -> Experiment:
    """Return the experiment with channels (q, m, t) of two joints exchanged."""
    order = np.arange(experiment.robot.n)
    order[pair] = order[pair[::-1]]
    fields = {
        "q": ("joint",),
        "m": ("motor", "direction"),
        "t": ("torque", "torque_rate", "sensed"),
    }
    names = [name for channel in channels for name in fields[channel]]
    changed = {name: getattr(experiment, name)[..., order] for name in names}
    if {*channels} >= {*"qm"}:
        joint, motor = changed["joint"], changed["motor"]
        for j in pair:  # the side without an encoder was computed from the motor's
            if not experiment.both[j]:
                joint[:, :, j] = motor[:, :, j] / experiment.ratio[j]
    return replace(experiment, **changed)


_BODIES, _SEVERE = (_has_bodies,), (_is_severe,)

MISTAKES = (
    Mistake(_torque_scales, _BODIES),
    Mistake(_rotor_inertias, _BODIES),
    Mistake(_all_torque_scales, (*_BODIES, _has_joints)),
    Mistake(gravities, _BODIES),
    Mistake(lengths, _BODIES),
    Mistake(zeros, _BODIES),
    Mistake(quarter_turns, (*_BODIES, *_SEVERE)),
    Mistake(payloads, _BODIES),
    Mistake(_sign_of_torques, (*_SEVERE, _has_joints)),
    Mistake(_all_angles, (*_SEVERE, _has_joints)),
    Mistake(_times, _SEVERE),
    Mistake(_signs, (*_SEVERE, _has_own_channels)),
    Mistake(_angles, (*_SEVERE, _has_own_channels)),
    Mistake(gear_ratios, (*_SEVERE, _has_own_channels)),
    Mistake(geared_encoders, _SEVERE),
    Mistake(coupled_motors, (_has_encoders_apart,)),
    Mistake(linkages, (_has_encoders_apart,)),
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
    hiding = {TIME_UNIT.name, MISSING_DRIVES.name, WRAPS.name, GEOMETRY.name, HOLES.name}
    mistakes_of_logs = {finding.code for finding in known if finding.severity != "note"}
    wrong = {finding.code for finding in known if finding.severity == "wrong"}
    if hiding & mistakes_of_logs or NO_MEASUREMENT.name in wrong:
        return []  # the torques show no other mistake
    offsets = list(offset_findings(experiment))
    if offsets:
        return offsets
    if experiment.robot.has_controllers:
        return [] if wrong else _of_commands(experiment, known)
    silent = list(_of_friction_alone(experiment))
    if silent:
        return silent
    # a torque that ends at a limit has a factor that no sensor has, what holds an output is no body
    hidden = {SATURATION.name, LOCKED_OUTPUT.name}
    kept = {*experiment.robot.joint_names} - {one.joint for one in known if one.code in hidden}
    findings, without = mistakes(with_torques_of(experiment, kept))
    is_named = any(finding.severity != "note" for finding in findings)
    beyond = [] if is_named else list(limit_findings(experiment))
    return [*findings, *beyond, *file_findings(without)]


def _of_commands(experiment: Experiment, known: Sequence[Finding]) -> list[Finding]:
    """Return the mistakes of the set-up of a robot with controllers.

    The channels of a torque are not there, and an unknown armature looks like another mistake.
    """
    limited = list(hidden_limits(experiment))
    if limited:  # which looks like gains in another unit, or another zero
        return limited
    stopped = {finding.joint for finding in known if finding.code == CONTACT.name}
    gains, without = gain_findings(experiment)
    findings = [*gains, *limit_findings(without), *pose_findings(without)]
    return [finding for finding in findings if finding.joint not in stopped]
