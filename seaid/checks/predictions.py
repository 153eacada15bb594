"""What predictions show: of other motions, replays, simulated joints and responses.

Each function gets the numbers of a comparison that was made elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import scipy

from seaid._arrays import FrozenMapping
from seaid.checks.codes import CODES, in_drives, only_joint
from seaid.checks.tolerances import FAR, FEW, MOST, NOTHING, POOR, RARE, SLIGHT, SURE, TWICE
from seaid.errors import Finding, listed
from seaid.estimation import Estimate

# Other motions


def unseen_motion(of: str, joint: str, error: float, ratio: float) -> Iterator[Finding]:
    """Yield that the model does not predict a torque, or a force on the base (without a joint).

    `error` is that over the error of a constant, `ratio` is the rms error over that in the own
    logs: infinite if nothing is known of these.
    """
    if error > MOST and ratio > TWICE:
        times = f", and {ratio:.2g} times that in the own logs" if math.isfinite(ratio) else ""
        evidence = {"error": error, "over that in the own logs": ratio, "of": of, "times": times}
        is_wrong = error > NOTHING
        yield CODES["unseen-motion"].finding("unpredicted", joint, evidence, is_worse=is_wrong)


def not_measured(joints: Sequence[str]) -> Iterator[Finding]:
    """Yield the note on joints that a validation simulates from their motor angles."""
    if joints:
        names = {"names": ", ".join(joints)}
        yield CODES["motor-side"].note("simulated", only_joint(joints), names)


# Replays


def not_replayed(joint: str, reason: str) -> Finding:
    """Return the note on a joint that follows its measured motion in a replay."""
    return CODES["not-replayed"].note("measured", joint, {"reason": reason})


def other_inertias(title: str, inertias: Mapping[str, float], reason: str = "") -> Finding:
    """Return that a model was replayed with other rotor `inertias` at joints.

    It is doubtful if an identified model diverged, and a note for another `reason`.
    """
    remedy = None
    if title == "nominal":
        line = "motor_inertia_kg_m2 = 1e-5  # write that of your motor"
        remedy = f"nominal values {in_drives({(next(iter(inertias)),): line})}"
    words = {
        "reason": reason or "the simulation diverged under the controllers",
        "title": title,
        "inertias": listed(f"{joint} {x:.2g}" for joint, x in inertias.items()),
    }
    code, joint = CODES["rotor-inertia"], only_joint([*inertias])
    matters = not reason and title != "nominal"
    return code.finding("replayed", joint, {**inertias, **words}, remedy, matters)


def replay_worse(
    after: Mapping[str, float], ratios: Mapping[str, float], units: Sequence[str], is_closed: bool
) -> Iterator[Finding]:
    """Yield the joints that are replayed worse after; the whole robot if most of it is.

    `after` {joint: rms error}, with `units` of a thousandth; `ratios` {joint: that over the error
    before}. In open loop (not `is_closed`) torques drift apart.
    """
    whole = float(np.exp(np.mean(np.log(np.maximum([*ratios.values()], np.finfo(float).tiny)))))
    code, evidence = CODES["replay-worse"], {"ratio": whole}
    if whole > 1:
        yield code.finding("whole" if is_closed else "open", "", evidence)
        return
    for (joint, ratio), unit in zip(ratios.items(), units, strict=True):
        if ratio > 1 + POOR:  # of a joint, less is within the scatter of parts of one log
            size = f"{1e3 * after[joint]:.3g} {unit}"
            yield code.finding("joint", joint, {"ratio": ratio, "size": size})


# Refinements, and springs behind motors


def nothing_to_simulate() -> Finding:
    """Return the note that a refinement has no joint to simulate."""
    code = CODES["nothing-to-simulate"]
    return code.note("torques", remedy=code.advice)


def worse_than_start(reason: str, evidence: Mapping[str, float]) -> Finding:
    """Return that a refinement returns its start, because of a reason."""
    return CODES["worse-than-start"].finding("kept", "", {**evidence, "reason": reason})


def motor_side_findings(
    tests: Mapping[str, Mapping[int, tuple[float, float]]], antiresonances_hz: Mapping[str, float]
) -> Iterator[Finding]:
    """Yield that joints have no encoder behind their springs, and what no model of these has.

    `tests` {joint: {order of the derivative: size and standard error}} are torques of the
    deflection over that of the spring at its antiresonance: 1 is damping. With 2 a link with the
    share s of the inertia behind a spring of its own lowers k by the part d, and the motor feels
    k (1 - B (w/w_a)^2) instead of k, with the size B = d^2 (1 - s) / s. A chance of 1 % is none.
    """
    code, hidden = CODES["motor-side"], dict[str, float]()
    for joint, sizes in tests.items():
        damping, error = sizes.get(1, (0.0, 0.0))
        fall, error_of_fall = sizes.get(2, (0.0, 0.0))
        is_link = fall > scipy.special.ndtri(0.99) * error_of_fall
        is_damped = damping > SURE * error
        # damping of a spring has a part in the other term; a link has less than any spring
        if is_damped and not (is_link and damping < FEW):
            evidence = {"damping ratio": damping / 2, "standard error": error / 2}
            evidence["standard errors"] = damping / error
            lines = in_drives({(joint,): 'spring = ["linear", "damping"]'})
            yield code.finding("damped", joint, evidence, lines)
        elif is_link:
            less = f"; a damping ratio of {damping / 2:.2%} is that of a link" * is_damped
            yield _flexible(joint, fall, error_of_fall, antiresonances_hz[joint], less)
        elif 2 in sizes:
            # Of half of the inertia B is d^2: the upper end of its one-sided 95 % interval as d.
            hidden[joint] = math.sqrt(abs(fall) + scipy.special.ndtri(0.95) * error_of_fall)
    case, words = "series", {"names": ", ".join(tests)}
    evidence = {f"hidden part of the stiffness of {x}": y for x, y in hidden.items()}
    if hidden:
        case = "hidden"
        words["bounds"] = ", ".join(f"{least:.1%} at {joint}" for joint, least in hidden.items())
    yield code.note(case, only_joint([*tests]), {**evidence, **words})


def _flexible(joint: str, size: float, error: float, antiresonance_hz: float, more: str) -> Finding:
    # d from B = d^2 (1 - s) / s
    less = [math.sqrt(size * share / (1 - share)) for share in (0.3, 0.5)]
    evidence = {"fall at the antiresonance": size, "standard error": error}
    evidence |= {"standard errors": size / error, "antiresonance [Hz]": antiresonance_hz}
    evidence |= {"lower by, 30% behind it": less[0], "lower by, 50% behind it": less[1]}
    return CODES["motor-side"].finding("link", joint, {**evidence, "more": more})


def noisy_springs(unexplained: Mapping[str, float]) -> Iterator[Finding]:
    """Yield the joints whose torque, as their motors feel it, is mostly not explained."""
    for joint, part in unexplained.items():
        if part > MOST:
            yield CODES["motor-side"].finding("noisy", joint, {"unexplained": part})


def hidden_springs(
    springs: Mapping[str, tuple[float, float]],
    antiresonances_hz: Mapping[str, float],
    band_hz: float,
    rate_hz: tuple[float, int],
) -> Iterator[Finding]:
    """Yield the joints whose stiffness the motor hardly shows, with what would show it.

    `springs` {joint: stiffness and standard error}; `rate_hz` is that of the log, and the samples
    per period that an oscillation needs.
    """
    for joint, (k, error) in springs.items():
        if error < POOR * k:
            continue
        hz, share = antiresonances_hz[joint], error / abs(k)
        rate = f"log at {rate_hz[1] * hz:.3g} Hz or more, " * (rate_hz[1] * hz > rate_hz[0])
        evidence = {
            "antiresonance [Hz]": hz,
            "relative standard error": share,
            "band [Hz]": band_hz,
        }
        evidence |= {"excite up to [Hz]": 1.5 * hz, "amplitude over this": share / SLIGHT}
        yield CODES["hidden-resonance"].finding("motor", joint, {**evidence, "rate": rate})


# Frequency responses


def unseen_resonance(
    joint: str, spring: Estimate, expected_hz: float, band_hz: Sequence[float], noise: float
) -> Iterator[Finding]:
    """Yield that the response of a joint does not show its `spring`, and what would.

    `expected_hz` is the nominal antiresonance, NaN without nominal values; `band_hz` are the
    highest frequency of the response, the one that the log shows, and its rate; `noise` is that of
    the response, over its size, at the antiresonance or at the highest frequency.
    """
    top, seen, rate = band_hz
    error = spring.standard_error("stiffness") / spring.value("stiffness")
    # noise or images of the sampling: a spring takes energy, with damping ratios of 0.005 to 0.1
    is_noise = spring.value("antiresonance_damping") < -SLIGHT
    has_antiresonance = spring.value("antiresonance") <= FAR * top  # NaN without any
    # no slope at all is no information; without noise it would be small, not zero
    if is_noise or not has_antiresonance or not 0 < error < math.inf:
        error = math.inf
    if error <= RARE:
        return
    factor, needed_hz, case = min(error / SLIGHT, FAR), 1.5 * expected_hz, "above"
    if expected_hz > min(seen, top):
        case = "unsampled" if expected_hz > seen else "unexcited"
    elif math.isfinite(expected_hz):
        case = "noise"
    evidence = {"relative_standard_error": error, "expected_hz": expected_hz, "highest_hz": top}
    evidence |= {"Nyquist frequency [Hz]": rate / 2, "needed_hz": needed_hz, "noise": noise}
    evidence["needed rate [Hz]"] = needed_hz / seen * rate
    # Noise over the response falls with the amplitude, and with the root of the number of periods.
    louder = f"give {factor:.2g} times the amplitude, or {factor**2:.2g} times the periods"
    higher = f"excite up to {2 * top:.3g} Hz, logged at {6 * top:.3g} Hz or more"
    words = {"louder": louder, "higher": higher}
    yield CODES["hidden-resonance"].finding(case, joint, {**evidence, **words})


def wrong_minimum(lack_of_fit: float) -> Finding:
    """Return that the errors of coupled joints follow the angles of their motors."""
    return CODES["wrong-minimum"].finding("angles", "", {"error_ratio": lack_of_fit})


def contradicted_rotor(
    joint: str, stated: Mapping[str, float], free: Estimate
) -> Iterator[Finding]:
    """Yield that a response contradicts the rotor inertia of the drives file.

    A wrong one changes the stiffness, which follows from it and the resonance: it is a finding,
    twice outside its interval, if the stiffness with a `free` rotor is another one. `stated` has
    both values.
    """
    rotor, k = free.value("motor_inertia"), free.value("stiffness")
    low, high = free.interval()[free.names.index("motor_inertia")]
    inertia, stiffness = stated["motor_inertia"], stated["stiffness"]
    # high - low is two half widths of the interval.
    if abs(inertia - rotor) > high - low and abs(stiffness - k) > SLIGHT * k:
        evidence = {"stated": inertia, "by the response": rotor, "stiffness with it": k}
        unit = free.units[free.names.index("stiffness")]
        words = {"range": f"{low:.3g} to {high:.3g}", "unit": unit}
        lines = in_drives({(joint,): f"motor_inertia_kg_m2 = {rotor:.4g}"})
        evidence["stiffness"] = stiffness
        yield CODES["rotor-inertia"].finding("response", joint, {**evidence, **words}, lines)


def stiffness_disagrees(joint: str, response: Estimate, identified: Estimate) -> Iterator[Finding]:
    """Yield that the interval of a stiffness by its response excludes that of an identification."""
    both = response, identified
    (low, high), (least, most) = (k.interval()[k.names.index("stiffness")] for k in both)
    if low > most or high < least:
        k, other_k = response.value("stiffness"), identified.value("stiffness")
        evidence = {"frequency_response": k, "identification": other_k}
        unit = response.units[response.names.index("stiffness")]
        words = {"range": f"{low:.4g} to {high:.4g}", "other_range": f"{least:.4g} to {most:.4g}"}
        code = CODES["estimator-disagrees"]
        yield code.finding("response", joint, {**evidence, **words, "unit": unit})


# Files for simulators


def not_in_format(
    text: str, evidence: Mapping[str, float] = FrozenMapping({}), **more: Any
) -> Finding:
    """Return that a written file does not hold a part of the model."""
    of_part = "part", "", {**evidence, "text": text}
    return CODES["not-in-format"].finding(*of_part, certainty="certain", **more)
