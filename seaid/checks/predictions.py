"""What predictions show: of other motions, replays, simulated joints and responses.

Each function gets the numbers of a comparison that was made elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from scipy.special import ndtri

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
    if not (error > MOST and ratio > TWICE):
        return
    times = f", and {ratio:.2g} times that in the own logs" if math.isfinite(ratio) else ""
    yield CODES["unseen-motion"].finding(
        f"the model does not predict {of} in another motion: its error is {error:.0%} of it, that "
        f"of a constant 100%{times}",
        joint,
        "wrong" if error > NOTHING else "doubtful",
        {"error": error, "over that in the own logs": ratio},
    )


def not_measured(joints: Sequence[str]) -> Iterator[Finding]:
    """Yield the note on joints that a validation simulates from their motor angles."""
    if joints:
        yield CODES["motor-side"].note(
            f"the log has no sensor behind the spring of {', '.join(joints)}: the joint is "
            "simulated from the motor angle, and the motor torque compared; there is no measured "
            "torque on its load to compare",
            only_joint(joints),
        )


# Replays


def not_replayed(joint: str, reason: str) -> Finding:
    """Return the note on a joint that follows its measured motion in a replay."""
    return CODES["not-replayed"].note(
        f"{joint} follows its measured motion in the replay, which compares the other joints: "
        f"{reason}",
        joint,
    )


def other_inertias(title: str, inertias: Mapping[str, float], reason: str = "") -> Finding:
    """Return that a model was replayed with other rotor `inertias` at joints.

    It is doubtful if an identified model diverged, and a note for another `reason`.
    """
    line = "motor_inertia_kg_m2 = 1e-5  # write that of your motor"
    remedy = f"nominal values {in_drives({(next(iter(inertias)),): line})}"
    return CODES["rotor-inertia"].finding(
        f"{reason or 'the simulation diverged under the controllers'}: the {title} model was "
        "replayed with the least rotor inertia that can be simulated, at the joint [kg m^2 or kg]: "
        f"{listed(f'{joint} {x:.2g}' for joint, x in inertias.items())}",
        only_joint([*inertias]),
        "note" if reason or title == "nominal" else "doubtful",
        inertias,
        remedy if title == "nominal" else "check gains, their units, signs and zeros of the joints",
        "certain",
    )


def replay_worse(
    after: Mapping[str, float], ratios: Mapping[str, float], units: Sequence[str], is_closed: bool
) -> Iterator[Finding]:
    """Yield the joints that are replayed worse after; the whole robot if most of it is.

    `after` {joint: rms error}, with `units` of a thousandth; `ratios` {joint: that over the error
    before}. In open loop (not `is_closed`) torques drift apart.
    """
    whole = float(np.exp(np.mean(np.log(np.maximum([*ratios.values()], np.finfo(float).tiny)))))
    # of a joint, less is within the scatter of parts of one log
    worse = {joint: ratio for joint, ratio in ratios.items() if ratio > 1 + POOR}
    unit_of = dict(zip(ratios, units, strict=True))
    for joint, ratio in ({"": whole} if whole > 1 else worse).items():
        what, size, mean = "this log", "", " (geometric mean of the joints)"
        if joint:
            what, size, mean = joint, f"{1e3 * after[joint]:.3g} {unit_of[joint]}, ", ""
        yield CODES["replay-worse"].finding(
            f"the identified model replays {what} worse than the nominal one: its "
            f"rms error is {size}{ratio:.2g} times that before{mean}",
            joint,
            "wrong" if is_closed and not joint else "doubtful",
            {"ratio": ratio},
            certainty="likely" if joint else "certain" if is_closed else "possible",
        )


# Refinements, and springs behind motors


def nothing_to_simulate() -> Finding:
    """Return the note that a refinement has no joint to simulate."""
    return CODES["nothing-to-simulate"].note(
        "refine returns the values of its start: no joint has a spring whose torque is unknown, so "
        "there is no motion to simulate, and the torques alone determine no more than identify "
        "found",
        remedy=CODES["nothing-to-simulate"].advice,
    )


def worse_than_start(reason: str, evidence: Mapping[str, float]) -> Finding:
    """Return that a refinement returns its start, because of a reason."""
    return CODES["worse-than-start"].finding(
        f"refine returns the values of its start, because {reason}: the model lacks an effect that "
        "the simulation of the joints accumulates, or the log is another one",
        evidence=evidence,
    )


def motor_side_findings(
    tests: Mapping[str, Mapping[int, tuple[float, float]]], antiresonances_hz: Mapping[str, float]
) -> Iterator[Finding]:
    """Yield that joints have no encoder behind their springs, and what no model of these has.

    `tests` {joint: {order of the derivative: size and standard error}} are torques of the
    deflection over that of the spring at its antiresonance: 1 is damping. With 2 a link with the
    share s of the inertia behind a spring of its own lowers k by the part d, and the motor feels
    k (1 - B (w/w_a)^2) instead of k, with the size B = d^2 (1 - s) / s. A chance of 1 % is none.
    """
    hidden: dict[str, float] = {}
    for joint, sizes in tests.items():
        damping, error = sizes.get(1, (0.0, 0.0))
        fall, error_of_fall = sizes.get(2, (0.0, 0.0))
        is_link, is_damped = fall > ndtri(0.99) * error_of_fall, damping > SURE * error
        # damping of a spring has a part in the other term; a link has less than any spring
        if is_damped and not (is_link and damping < FEW):
            text = f"the spring of {joint} has damping that its drive lacks, a damping ratio of "
            text += f"{damping / 2:.2%} of its load, {damping / error:.0f} standard errors: its "
            text += "stiffness and friction may be wrong by more than their intervals"
            evidence = {"damping ratio": damping / 2, "standard error": error / 2}
            lines = in_drives({(joint,): 'spring = ["linear", "damping"]'})
            yield CODES["motor-side"].finding(text, joint, "doubtful", evidence, lines)
        elif is_link:
            less = f"; a damping ratio of {damping / 2:.2%} is that of a link" * is_damped
            yield _flexible(joint, fall, error_of_fall, antiresonances_hz[joint], less)
        elif 2 in sizes:
            # Of half of the inertia B is d^2: the upper end of its one-sided 95 % interval as d.
            hidden[joint] = math.sqrt(abs(fall) + ndtri(0.95) * error_of_fall)
    bounds = ", ".join(f"{least:.1%} at {joint}" for joint, least in hidden.items())
    unshown = "; an elastic link with half of the inertia behind it, which this log does not show, "
    unshown += f"may have lowered the stiffness by up to {bounds} (95 %); motions up to twice the "
    unshown += "antiresonance show more"
    yield CODES["motor-side"].note(
        f"{', '.join(tests)}: no sensor behind the spring, so that stiffness and load come from "
        "motor angle and torque by output error; the stiffness is that of gear, spring and link in "
        "series, and the joint angle that of the motor over the gear ratio at a spring without "
        f"force{unshown if hidden else ''}",
        only_joint([*tests]),
        evidence={f"hidden part of the stiffness of {x}": least for x, least in hidden.items()},
    )


def _flexible(joint: str, size: float, error: float, antiresonance_hz: float, more: str) -> Finding:
    # d from B = d^2 (1 - s) / s
    less = [math.sqrt(size * share / (1 - share)) for share in (0.3, 0.5)]
    return CODES["motor-side"].finding(
        f"the stiffness that the motor of {joint} feels falls with the frequency, by {size:.2%} at "
        f"its antiresonance of {antiresonance_hz:.3g} Hz, {size / error:.0f} standard errors: "
        "something behind the spring is elastic too, a link, a gear or a mounting, which the model "
        f"lacks. That in series with the spring makes the stiffness about {less[0]:.1%} lower than "
        f"the spring's with 30% of the inertia behind it, {less[1]:.1%} with half{more}",
        joint,
        evidence={"fall at the antiresonance": size, "standard error": error},
        remedy="take the stiffness as that of spring and link in series, or log the joint position",
    )


def noisy_springs(unexplained: Mapping[str, float]) -> Iterator[Finding]:
    """Yield the joints whose torque, as their motors feel it, is mostly not explained."""
    for joint, part in unexplained.items():
        if part > MOST:
            text = f"{part:.0%} of the torque on the spring of {joint}, as its motor feels it, is "
            text += "unexplained: its stiffness and load may be wrong by more than their intervals"
            yield CODES["motor-side"].finding(text, joint, evidence={"unexplained": part})


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
        needed_hz, larger = rate_hz[1] * hz, share / SLIGHT
        rate = f"log at {needed_hz:.3g} Hz or more, " if needed_hz > rate_hz[0] else ""
        yield CODES["hidden-resonance"].finding(
            f"the motor torque hardly shows the spring of {joint}: its stiffness is known to "
            f"{share:.0%}. The motor feels it most at the antiresonance, about {hz:.3g} Hz, and "
            f"the motion has a band of {band_hz:.3g} Hz",
            joint,
            evidence={"antiresonance [Hz]": hz, "relative standard error": share},
            remedy=f"{rate}excite the joint up to {1.5 * hz:.3g} Hz or with {larger:.2g} times the "
            "amplitude, or log the joint position",
        )


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
    factor = min(error / SLIGHT, FAR)
    # Noise over the response falls with the amplitude, and with the root of the number of periods.
    louder = f"give {factor:.2g} times the amplitude, or {factor**2:.2g} times the periods"
    expected = f"with its nominal values the antiresonance is at {expected_hz:.3g} Hz"
    if expected_hz > min(seen, top):
        needed_hz, rate_hz = 1.5 * expected_hz, ""
        reason = f"{expected}, and the motion excites up to {top:.3g} Hz"
        if expected_hz > seen:
            reason = f"{expected}, and half of the rate (Nyquist) is {rate / 2:.4g} Hz"
            rate_hz = f"log at {needed_hz / seen * rate:.3g} Hz or more, and "
        remedy = f"{rate_hz}excite up to {needed_hz:.3g} Hz"
    elif math.isfinite(expected_hz):
        reason = f"{expected}, where noise and nonlinear distortion are {noise:.2g} of the response"
        remedy = louder
    else:
        reason = f"no resonance stands out up to {top:.3g} Hz; it is above that, or inside the "
        reason += f"noise, which is {noise:.2g} of the response there"
        remedy = f"excite up to {2 * top:.3g} Hz, logged at {6 * top:.3g} Hz or more; or {louder}"
    yield CODES["hidden-resonance"].wrong(
        f"the response of {joint} does not determine its spring (relative standard error "
        f"{error:.2g}): {reason}",
        joint,
        evidence={"relative_standard_error": error, "expected_hz": expected_hz, "highest_hz": top},
        remedy=remedy,
        certainty="likely" if math.isfinite(expected_hz) else "possible",
    )


def wrong_minimum(lack_of_fit: float) -> Finding:
    """Return that the errors of coupled joints follow the angles of their motors."""
    return CODES["wrong-minimum"].finding(
        "the errors of the torques of the coupled joints follow their motor angles: they are "
        f"{lack_of_fit:.3g} times as large as what does not; the search may have ended in a wrong "
        "minimum, or links or gears are elastic",
        evidence={"error_ratio": lack_of_fit},
    )


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
        yield CODES["rotor-inertia"].finding(
            f"the response of {joint} contradicts its rotor inertia of {inertia:.3g} kg m^2: it "
            f"shows {rotor:.3g} kg m^2, {low:.3g} to {high:.3g}, with which the stiffness is "
            f"{k:.4g} {free.units[free.names.index('stiffness')]} and not {stiffness:.4g}",
            joint,
            evidence={"stated": inertia, "by the response": rotor, "stiffness with it": k},
            remedy=in_drives({(joint,): f"motor_inertia_kg_m2 = {rotor:.4g}"}),
        )


def stiffness_disagrees(joint: str, response: Estimate, identified: Estimate) -> Iterator[Finding]:
    """Yield that the interval of a stiffness by its response excludes that of an identification."""
    both = response, identified
    (low, high), (least, most) = (k.interval()[k.names.index("stiffness")] for k in both)
    if low > most or high < least:
        k, other_k = response.value("stiffness"), identified.value("stiffness")
        unit = response.units[response.names.index("stiffness")]
        yield CODES["estimator-disagrees"].finding(
            f"the stiffness of {joint} is {k:.4g} {unit} by its frequency response, {low:.4g} to "
            f"{high:.4g}, and {other_k:.4g} by the identification, {least:.4g} to {most:.4g}: a "
            "spring that is not linear, or softer at other amplitudes, a cutoff below its "
            "resonance, or another posture",
            joint,
            evidence={"frequency_response": k, "identification": other_k},
            remedy="compare the terms of the spring with compare_terms, or motions of one size",
        )


# Files for simulators


not_in_format = partial(CODES["not-in-format"].finding, joint="", certainty="certain")
"""Return that a written file does not hold a part of the model."""
