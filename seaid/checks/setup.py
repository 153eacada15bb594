"""Mistakes of a set-up as hypotheses: what a model explains if a sign, a unit or a place differs.

A hypothesis changes the experiment: a channel, a drive, gravity, a payload. What explains far more
than the set-up as given is a finding, and the search goes on from there, so that two mistakes are
found in turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, combinations

import numpy as np

from seaid._arrays import Array
from seaid._files import toml_table
from seaid.checks.bodies import (
    CORRELATED_ROWS,
    gravities,
    lengths,
    near,
    payloads,
    penalty_of,
    with_bodies,
)
from seaid.checks.experiment import (
    FALLS,
    LEAST_GAIN,
    SEVERE,
    SUSPICIOUS,
    TIE,
    Experiment,
    Hypothesis,
    flipped,
    scaled,
)
from seaid.errors import Certainty, Finding, Severity
from seaid.estimation import scaled_svd
from seaid.log import changed_source
from seaid.robot import Robot

_MOST_MISTAKES = 5
"""Mistakes that are looked for one after the other."""

_BARELY, _TIMES = 0.04, 3.0
"""The set-up is compared with others from this misfit on too, if the nominal bodies have so many
times the misfit of any bodies."""

_WORSE = 1.5
"""Most that a hypothesis may increase the cost of one kind of misfit."""

_SHORTLIST = 12
"""Hypotheses, best by the nominal bodies and the encoders, whose other misfits are computed too."""

_ANGLES = {"deg": math.pi / 180, "turn": 2 * math.pi, "rad": 180 / math.pi}
"""{unit of an angle: the factor that repairs it}; "rad" where degrees were declared."""


def mistakes(given: Experiment) -> tuple[list[Finding], Experiment]:
    """Return the mistakes that explain an experiment far better, and it without them."""
    found: list[Finding] = []
    while len(found) < _MOST_MISTAKES:
        given = replace(given, left=given.free)  # one noise for all that is compared
        best = _best(given) if _is_suspicious(given) else None
        best = best or _significant(given)
        if best is None:
            break
        finding, given = best
        found.append(finding)
        if finding.code == "nominal-values":
            given = replace(given, bodies=np.full_like(given.bodies, np.nan))
    return found, given


def _is_suspicious(one: Experiment) -> bool:
    """Whether a misfit is larger than that of a right set-up."""
    beyond = (one.nominal > _BARELY) & (one.nominal > _TIMES * one.free)
    largest = max(np.nanmax(misfit, initial=0.0) for misfit in one.misfits.values())
    return bool(largest > SUSPICIOUS or np.any(beyond))


def _best(given: Experiment) -> tuple[Finding, Experiment] | None:
    """Return the finding of the hypothesis that explains most, and the experiment without it."""
    quick = ("nominal" if np.any(np.isfinite(given.nominal)) else "free", "encoders")
    tried = [(one, one.undo(given)) for one in hypotheses(given)]
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
    close = [
        other for value, other, _ in gains[1:] if value > gain - TIE and other.code != one.code
    ]
    certainty: Certainty = "possible" if close else "likely" if gain < 3 * LEAST_GAIN else "certain"
    what, joint, before, after = _fall(given, changed)
    evidence = {**one.evidence, "misfit as given": before, "misfit without it": after}
    instead = f"; or {close[0].message}" if close else ""
    message = (
        f"{one.message}: the part of the {what} of {joint} that is left unexplained falls from "
        f"{before:.0%} to {after:.0%}{instead}"
    )
    finding = Finding(one.code, message, one.joint, one.severity, evidence, one.remedy, certainty)
    return finding, changed


_SIGNIFICANT = 6.0
"""Standard errors of a value, errors of the nominal bodies included, from which it is wrong."""


def _significant(given: Experiment) -> tuple[Finding, Experiment] | None:
    """Return the value about bodies or torques that is wrong by most standard errors, if any is.

    Where no misfit is large, chi-square by the nominal bodies decides: it distinguishes a value
    that is off by little from errors of nominal masses.
    """
    largest = float(np.nanmax(given.nominal, initial=0.0))
    if not given.used or not np.all(np.isfinite(given.bodies)) or largest >= SEVERE:
        return None
    tried = [(one, one.undo(given)) for one in chain(_factors(given), _bodies(given))]
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
    return Finding(one.code, message, one.joint, severity, evidence, one.remedy), changed


def _score(given: Experiment, changed: Experiment) -> float:
    """Return the gain of the log likelihood, with as much noise as the change leaves at least."""
    rows, noise = len(given.used) * len(given.target), max(changed.chi_square, 1.0)
    return rows * (given.chi_square - changed.chi_square) / (2 * noise * CORRELATED_ROWS)


def _factors(given: Experiment) -> Iterator[Hypothesis]:
    return (one for j in given.used for one in _torques(given, j))


_EXPLAINED = 0.6
"""Misfit above which a hypothesis does not explain the torque either."""


def _left(one: Hypothesis, changed: Experiment) -> float:
    """Return the misfit that a hypothesis leaves at its joint, or at the middle one of all.

    Any bodies count as well as the nominal ones, which another mistake may contradict.
    """
    misfit = np.fmin(changed.nominal, changed.free)
    own = misfit[changed.robot.index(one.joint)] if one.joint else np.nan
    known = misfit[~np.isnan(misfit)]
    middle = np.median(known) if len(known) else np.nan  # no joint has a misfit
    return float(own if np.isfinite(own) else middle)


def _explains(given: Experiment, changed: Experiment) -> bool:
    """Whether a misfit of some joint that matters falls by much."""
    return any(
        bool(np.any((before > SUSPICIOUS) & (changed.misfits[kind] < FALLS * before)))
        for kind, before in given.misfits.items()
    )


def _gain(given: Experiment, changed: Experiment) -> float:
    """Return the decrease of the cost; -inf if the hypothesis contradicts a kind of evidence."""
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


def hypotheses(given: Experiment) -> Iterator[Hypothesis]:
    """Yield the mistakes that are possible."""
    yield from _factors(given)
    yield from _bodies(given)
    if max(np.nanmax(one, initial=0.0) for one in given.misfits.values()) < SEVERE:
        return
    yield from _whole(given)
    if not np.array_equal(given.robot.transmission, np.eye(given.robot.n)):
        return
    for j in given.used:
        yield from _signs(given, j)
        yield from _positions(given, j)
    for i, j in combinations(range(given.robot.n), 2):
        yield from _swaps(given, i, j)


def _entries(given: Experiment, joints: Sequence[int], channels: str, factor: float) -> str:
    """Return the lines of a description that multiply logged channels of joints by a factor."""
    lines = ["in the description of the log:"]
    for j in joints:
        lines.append(toml_table("joints", given.robot.joint_names[j]))
        lines += [
            f"{one} = {changed_source(given.source(j, one), factor=factor)}"
            for one in given.logged(j, channels)
        ]
    return "\n".join(lines)


_WORDS = {"joint_position": "joint encoder", "motor_position": "motor encoder"}


def _words(quantities: Sequence[str], several: str = "") -> str:
    """Return the words for logged quantities of a joint."""
    return " and ".join(f"{_WORDS.get(one, 'torque')}{several}" for one in quantities)


def _signs(given: Experiment, j: int) -> Iterator[Hypothesis]:
    joint = given.robot.joint_names[j]
    choices = ["t", "qm", "qmt"]
    if given.both[j]:
        product = float(np.mean(given.motor[1][:, j] * given.joint[1][:, j]) * given.ratio[j])
        choices = choices if product > 0 else ["q", "m", "qt"]
        if product < 0:
            yield Hypothesis(
                "gear-ratio",
                f"the gear of {joint} reverses: its ratio is negative, so that motor encoder and "
                "torque have the opposite sign",
                partial(flipped, j=j, channels="mt"),
                joint,
                _entries(given, [j], "mt", -1.0),
                evidence={"given ratio": float(given.ratio[j])},
            )
    for channels in choices:
        words = _words(given.logged(j, channels))
        whole = f"the whole joint {joint} has the opposite sign, {words}"
        yield Hypothesis(
            "sign",
            whole if channels == "qmt" else f"the {words} of {joint} has the opposite sign",
            partial(flipped, j=j, channels=channels),
            joint,
            _entries(given, [j], channels, -1.0),
            penalty=0.0 if channels in ("t", "qmt", "q", "m") else 1.0,
        )


def _with_ratio(given: Experiment, j: int, factor: float) -> Experiment:
    """Return the experiment with another gear ratio, and the side that it was computed from."""
    ratio = given.ratio.copy()
    ratio[j] *= factor
    joint = given.joint.copy()
    if not given.both[j]:
        joint[:, :, j] /= factor
    return replace(given, ratio=ratio, joint=joint)


def _ratio_remedy(given: Experiment, j: int, factor: float) -> str:
    joint = given.robot.joint_names[j]
    key = "gear_ratio_rad_per_m" if _is_linear(given.robot, j) else "gear_ratio"
    return f"in the drives file:\n{toml_table(joint)}\n{key} = {given.ratio[j] * factor:.6g}"


def _is_linear(robot: Robot, j: int) -> bool:
    return robot.is_prismatic[j] and not robot.drives[robot.joint_names[j]].is_elastic


_LEAST_TURN, _MOST_TURN = 0.1, 4 * math.pi
"""Range of a joint [rad] in an experiment: one in degrees is 57 times smaller than it seems, so
that a joint that seems to move by a radian would hardly move."""


def _turns(given: Experiment, joints: Sequence[int], factor: float) -> bool:
    """Whether a factor on the positions leaves the ranges of joints possible, by their median."""
    moved = factor * float(np.median(np.ptp(given.joint[0][:, joints], axis=0)))
    return _LEAST_TURN < moved < _MOST_TURN


def _positions(given: Experiment, j: int) -> Iterator[Hypothesis]:
    """Yield units of angles and gear ratios."""
    joint = given.robot.joint_names[j]
    for unit, factor in {} if given.robot.is_prismatic[j] else _ANGLES.items():
        if not _turns(given, [j], factor):
            continue
        yield Hypothesis(
            "unit",
            f"the positions of {joint} are in {unit}",
            partial(scaled, j=j, factors=dict.fromkeys("qm", factor)),
            joint,
            _entries(given, [j], "qm", factor),
        )
    if given.both[j]:
        yield from _encoders(given, j)
    for factor in () if given.both[j] else (0.5, 2.0):
        yield Hypothesis(
            "gear-ratio",
            f"the gear ratio of {joint} is {given.ratio[j] * factor:.4g}, not {given.ratio[j]:.4g}",
            partial(_with_ratio, j=j, factor=factor),
            joint,
            _ratio_remedy(given, j, factor),
            evidence={"given ratio": float(given.ratio[j])},
        )


_SAME_SLOPE = 0.05
"""Relative difference of the encoders' slope from the gear ratio that springs and noise explain."""


def encoder_slope(given: Experiment, j: int) -> float:
    """Return the motor angle per joint angle over the gear ratio, without the spring's deflection.

    The deflection is proportional to the torque of the spring, which is that of the motor but for
    friction: both are columns of the regression next to the joint angle.
    """
    columns = [given.joint[0][:, j], np.ones(len(given.direction))]
    if j in given.used:
        columns += [given.target[:, j], *given.friction[j][:, :2].T]
    H = np.column_stack(columns)
    x = scaled_svd(H).solve(given.motor[0][:, j])
    return float(x[0] / given.lever[j])


def _encoders(given: Experiment, j: int) -> Iterator[Hypothesis]:
    """Yield gear ratios and units that the slope between the encoders of a joint suggests."""
    joint, slope = given.robot.joint_names[j], abs(encoder_slope(given, j))
    if abs(slope - 1) < _SAME_SLOPE or not 1e-6 < slope < 1e6:
        return
    for unit, factor in _ANGLES.items():
        for channel, effect in (("m", factor), ("q", 1 / factor)):
            if abs(math.log(slope * effect)) < _SAME_SLOPE * 3:
                yield Hypothesis(
                    "unit",
                    f"the {_words(given.logged(j, channel))} of {joint} is in {unit}",
                    partial(scaled, j=j, factors={channel: factor}),
                    joint,
                    _entries(given, [j], channel, factor),
                    evidence={"slope between the encoders over the gear ratio": slope},
                )
    for factor in near(slope):
        yield Hypothesis(
            "gear-ratio",
            f"the gear ratio of {joint} is {given.ratio[j] * factor:.4g} by its two encoders, not "
            f"{given.ratio[j]:.4g}",
            partial(_with_ratio, j=j, factor=factor),
            joint,
            _ratio_remedy(given, j, factor),
            evidence={"slope between the encoders over the gear ratio": slope},
            penalty=penalty_of(factor, slope),
        )


def _slopes(given: Experiment, j: int) -> tuple[float, float]:
    """Return the torque over that of the nominal bodies, and the rotor inertia over the given."""
    columns = np.column_stack([given.regressor[:, j] @ given.bodies, given.friction[j]])
    y = given.lever[j] * given.torque[:, j]
    if np.all(np.isnan(y)):
        y = given.sensed[:, j]
    rotor = given.lever[j] * given.motor[2][:, j]
    if given.inertia[j] > 0 and np.all(np.isfinite(given.torque[:, j])):
        columns = np.column_stack([columns, given.inertia[j] * rotor])
    x = scaled_svd(columns).solve(y)
    return float(x[0]), float(x[-1]) if columns.shape[1] == 5 else math.nan


_UNITS = {"mNm": 1e3, "kNm": 1e-3}
"""{unit of a torque: its value over that in N m}."""

_FAR_FACTOR, _LEAST_FACTOR, _LEAST_ROTOR = 20.0, 0.05, 0.2
"""A factor on a torque beyond this is a unit, not an error of a constant; relative errors of torque
constants and of rotor inertias that are usual."""


def _torques(given: Experiment, j: int) -> Iterator[Hypothesis]:
    """Yield factors on the torque of a joint, and its rotor inertia."""
    if not np.all(np.isfinite(given.bodies)):
        return
    joint = given.robot.joint_names[j]
    slope, rotor = _slopes(given, j)
    if slope > 0:
        every = _factor(given, [j], slope, f"the torque of {joint}", joint)
        if abs(every.evidence["factor"] - 1) > _LEAST_FACTOR:
            yield every
    if not (math.isfinite(rotor) and rotor > 0) or abs(rotor - 1) < _LEAST_ROTOR:
        return
    for factor in near(rotor, given.lever[j] ** 2):
        inertia = given.inertia.copy()
        inertia[j] *= factor
        yield Hypothesis(
            "rotor-inertia",
            f"the rotor inertia of {joint} is {inertia[j]:.3g} kg m^2, not {given.inertia[j]:.3g}",
            partial(_with_inertia, inertia=inertia),
            joint,
            f"in the drives file:\n{toml_table(joint)}\nmotor_inertia_kg_m2 = {inertia[j]:.4g}",
            evidence={"ratio": factor},
            penalty=penalty_of(factor, rotor),
        )


def _with_inertia(given: Experiment, inertia: Array) -> Experiment:
    return replace(given, inertia=inertia)


def _factor(
    given: Experiment, joints: Sequence[int], slope: float, words: str, joint: str
) -> Hypothesis:
    """Return the hypothesis of a factor on the torques of some joints, near a first estimate."""
    if joint:
        slope *= _refinement(scaled(given, joints[0], {"t": 1 / slope}), joints[0])
    unit = min(_UNITS, key=lambda name: abs(math.log(slope / _UNITS[name])))
    is_unit = abs(math.log(slope)) > math.log(_FAR_FACTOR)
    exact = is_unit and abs(math.log(slope / _UNITS[unit])) < math.log(2.0)
    factor = 1 / _UNITS[unit] if exact else float(f"{1 / slope:.4g}")
    off = f"{slope:.3g} times too large" if slope > 1 else f"{1 / slope:.3g} times too small"
    text = f"in {unit}" if exact else off
    undo = partial(_all_scaled, joints=joints, factors={"t": factor})
    remedy = _entries(given, joints, "t", factor)
    return Hypothesis(
        "unit" if is_unit else "torque-scale",
        f"{words} {'are' if not joint else 'is'} {text}",
        undo,
        joint,
        remedy,
        "wrong" if is_unit else "doubtful",
        {"factor": slope},
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


def _swaps(given: Experiment, i: int, j: int) -> Iterator[Hypothesis]:
    names = [given.robot.joint_names[one] for one in (i, j)]
    choices = ["qmt", "qm", "t"]
    if given.both[i] and given.both[j]:
        choices += ["q", "m"]
    for channels in choices:
        words = "channels" if channels == "qmt" else _words(given.logged(i, channels), "s")
        yield Hypothesis(
            "swapped-joints",
            f"the {words} of {names[0]} and {names[1]} are exchanged",
            partial(swapped, pair=[i, j], channels=channels),
            names[0],
            _swap_remedy(given, (i, j), channels),
        )


def swapped(given: Experiment, pair: list[int], channels: str) -> Experiment:
    """Return the experiment with channels (q, m, t) of two joints exchanged."""
    order = np.arange(given.robot.n)
    order[pair] = order[pair[::-1]]
    found = given
    if "m" in channels:
        found = replace(found, motor=found.motor[:, :, order], direction=found.direction[:, order])
    if "t" in channels:
        torque, rate = found.torque[:, order], found.torque_rate[:, order]
        sensed = found.sensed[:, order]
        found = replace(found, torque=torque, torque_rate=rate, sensed=sensed)
    if "q" in channels:
        joint = found.joint[:, :, order]
        for one in pair:  # the side without an encoder was computed from the motor's
            if not given.both[one] and "m" in channels:
                joint[:, :, one] = found.motor[:, :, one] / given.ratio[one]
        found = replace(found, joint=joint)
    return found


def _swap_remedy(given: Experiment, pair: tuple[int, int], channels: str) -> str:
    lines = ["in the description of the log:"]
    for own, other in (pair, pair[::-1]):
        lines.append(toml_table("joints", given.robot.joint_names[own]))
        lines += [
            f"{one} = {changed_source(given.source(other, one))}"
            for one in given.logged(other, channels)
        ]
    return "\n".join(lines)


def _whole(given: Experiment) -> Iterator[Hypothesis]:
    """Yield severe mistakes that concern all joints: signs, units of angles, the clock."""
    if len(given.used) > 1:
        yield Hypothesis(
            "sign",
            "the torques of all joints have the opposite sign",
            partial(_all_scaled, joints=given.used, factors={"t": -1.0}),
            remedy=_entries(given, given.used, "t", -1.0),
        )
        yield from _all_angles(given)
    yield from _times(given)


def _bodies(given: Experiment) -> Iterator[Hypothesis]:
    """Yield mistakes about bodies: unit of all torques, nominal masses, gravity, lengths, loads."""
    if not np.all(np.isfinite(given.bodies)) or not given.used:
        return
    if len(given.used) > 1:
        slopes, rotors = np.array([_slopes(given, j) for j in given.used]).T
        middle, rotor = float(np.median(slopes)), _median(rotors)
        if middle > 0:
            # torques in another unit change the apparent rotor inertias too, masses do not
            of_masses = rotor > 0 and abs(math.log(rotor)) < 0.5 * abs(math.log(middle))
            every = _factor(given, given.used, middle, "the torques of all joints", "")
            yield replace(every, penalty=1.0 if of_masses else 0.0)
            yield from _behind_gears(given, slopes)
            yield Hypothesis(
                "nominal-values",
                f"the torques are {middle:.3g} times those of the masses in the robot file: wrong "
                "nominal values, or a payload that was not given",
                partial(with_bodies, bodies=middle * given.bodies),
                severity="note",
                remedy="correct the masses in the robot file, or name the payload",
                evidence={"factor": middle},
                penalty=0.5,
            )
    yield from gravities(given)
    yield from lengths(given)
    yield from payloads(given)


_SAME_AS_GEAR = 1.5
"""Torques of the motors over those of the nominal bodies, over the gear, that say that they are
behind it: as far from one as errors of nominal bodies are."""


def _behind_gears(given: Experiment, slopes: Array) -> Iterator[Hypothesis]:
    """Yield that the torques of the motors are those behind the gears, from `slopes` of `used`."""
    joints = [j for j in given.used if np.all(np.isfinite(given.torque[:, j]))]
    levers = given.lever[joints]
    if joints != given.used or np.min(levers) < _FAR_FACTOR:
        return
    if not 1 / _SAME_AS_GEAR < float(np.median(slopes / levers)) < _SAME_AS_GEAR:
        return
    lines = (
        f"{toml_table('joints', given.robot.joint_names[j])}\n"
        f"joint_torque = {changed_source(given.source(j, 'motor_torque'))}"
        for j in joints
    )
    yield Hypothesis(
        "unit",
        "the torques of all joints are those behind the gears, not those of the motors",
        partial(_as_sensed, joints=joints),
        remedy="\n".join(
            [
                "in the description of the log:",
                *lines,
                '# or, if they are computed from currents: motor_torque = {..., side = "joint"}',
            ]
        ),
        evidence={"factor": float(np.median(slopes))},
    )


def _as_sensed(given: Experiment, joints: Sequence[int]) -> Experiment:
    """Return the experiment with the torques of some motors as those of sensors at the joints."""
    torque, sensed = given.torque.copy(), given.sensed.copy()
    sensed[:, joints] = torque[:, joints]
    torque[:, joints] = np.nan
    return replace(given, torque=torque, sensed=sensed)


def _median(values: Array) -> float:
    """Return the median of the finite values, NaN for none."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else math.nan


def _all_angles(given: Experiment) -> Iterator[Hypothesis]:
    """Yield units of the angles of all joints, at both sides or at one."""
    turning = [j for j in range(given.robot.n) if not given.robot.is_prismatic[j]]
    both = [j for j in turning if given.both[j]]
    choices = [("qm", turning, "positions"), ("q", both, "joint encoders")]
    choices.append(("m", both, "motor encoders"))
    for unit, factor in _ANGLES.items():
        for channels, joints, words in choices:
            if len(joints) > 1 and (channels != "qm" or _turns(given, joints, factor)):
                yield Hypothesis(
                    "unit",
                    f"the {words} of all joints are in {unit}",
                    partial(_all_scaled, joints=joints, factors=dict.fromkeys(channels, factor)),
                    remedy=_entries(given, joints, channels, factor),
                )


def _all_scaled(given: Experiment, joints: Sequence[int], factors: dict[str, float]) -> Experiment:
    """Return the experiment with channels of some joints multiplied by factors."""
    for j in joints:
        given = scaled(given, j, factors)
    return given


_FACTORS_OF_TIME = (0.1, 0.5, 2.0, 10.0)


def _times(given: Experiment) -> Iterator[Hypothesis]:
    """Yield clocks that run too fast or too slowly by a round factor."""
    for factor in _FACTORS_OF_TIME:
        rate = given.rate_hz * factor
        yield Hypothesis(
            "time-unit",
            f"the time of the log is {factor:g} times too long, so that speeds are too small"
            if factor > 1
            else f"the time of the log is {1 / factor:g} times too short, so that speeds are too "
            "large",
            partial(_with_time, factor=factor),
            remedy=f"in the description of the log:\ntime = {{ rate_hz = {rate:.6g} }}",
            evidence={"factor": factor},
            penalty=1.0,
        )


def _with_time(given: Experiment, factor: float) -> Experiment:
    given = replace(given, torque_rate=factor * given.torque_rate)
    powers = np.array([1.0, factor, factor**2])[:, None, None]
    rate = given.rate_hz * factor
    return replace(given, joint=powers * given.joint, motor=powers * given.motor, rate_hz=rate)
