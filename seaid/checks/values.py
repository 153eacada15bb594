"""What estimated values show: errors that are large, signs that cannot be, and doubtful noise.

Estimates and fits come in, findings go out. The values of a drive are those of its equations: its
stiffness is that between the encoders.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array
from seaid.checks import tolerances as tol
from seaid.checks.codes import CODES, consequences, only_joint
from seaid.checks.engine import looks_for
from seaid.drives import DEAD_ZONES, PARAMETERS, Drive, ParameterName, readable, unit_of
from seaid.drives.terms import MOTOR_CONSTANTS, is_harmonic
from seaid.errors import Finding, listed
from seaid.estimation import Diagnostics, Estimate, FittedRows, SharedParameter, nearest
from seaid.estimation.estimate import ModelChecks
from seaid.estimation.qr_factor import QRFactor, first_term, triangle
from seaid.estimation.sdp import Program
from seaid.log import Motion
from seaid.log.description import Entries
from seaid.regressor import Regression, motor_regressor
from seaid.regressor.base import INPUT_FIELDS
from seaid.robot import Robot, is_physical
from seaid.robot.inertia import THIN

if TYPE_CHECKING:
    from seaid.checks.experiment import Experiment

# Two estimates of the same parameters


def disagreement(
    joint: str, rows: Regression, ways: Mapping[str, Array], scores: Array, remedy: str
) -> Iterator[Finding]:
    """Yield the finding on the parameters that differ between two cutoffs, with the worst of them.

    `ways` {cutoff in words: its values}; `scores` (p,) are the standard errors by which they
    differ, zero where it does not matter.
    """
    if not np.any(scores):
        return
    names, worst = [first_term(readable(name)) for name in rows.names], int(np.argmax(scores))
    numbers = {way: float(values[worst]) for way, values in ways.items()}
    sizes = " and ".join(f"{number:.4g}" for number in numbers.values())
    words = {"ways": " and ".join(ways), "worst": names[worst]}
    words["sizes"] = f"{sizes} {rows.units[worst]}".strip()
    words["differing"] = listed([names[x] for x in np.argsort(-scores) if scores[x]], 4)
    evidence = {**numbers, "standard errors": float(scores[worst]), **words}
    yield CODES["cutoff-sensitive"].finding("differs", joint, evidence, remedy)


def homogeneous(fit: FittedRows, weights: Array, cutoff_hz: float) -> Iterator[Finding]:
    """Yield the equations without a known torque, if they pull the parameters to zero.

    These equations have next to no torque, and columns of nothing but noise. To first order they
    reduce all parameters by their part of |W H theta|^2.
    """
    factor, theta = fit.qr_factor, fit.estimate.values
    # The model fits these equations worse than zero parameters do.
    zero_fits = factor.residual_norms(theta) > np.linalg.norm(factor.factors[:, :, -1], axis=1)
    # |W H theta|^2 by equation, from the triangular factors: |R theta| = |H theta|.
    power = (weights * np.linalg.norm(factor.factors[:, :, :-1] @ theta, axis=1)) ** 2
    pull = float(np.sum(power[zero_fits]) / max(float(np.sum(power)), tol.LEAST))
    if pull > tol.HARDLY and not np.all(zero_fits):
        names = [factor.joint_names[factor.equations[place]] for place in np.flatnonzero(zero_fits)]
        evidence = {"reduction": pull, "cutoff_hz": cutoff_hz, "names": listed(names)}
        yield CODES["homogeneous"].finding("pull", names[0], evidence, is_worse=pull > tol.RARE)


# The noise of a fit


@looks_for(CODES["drift"])
def noise_findings(estimate: Estimate) -> Iterator[Finding]:
    """Yield what the errors of the rows of a fit show, by its diagnostics."""
    shown = estimate.diagnostics
    count, p, scatter = shown.independent_rows, shown.parameters, shown.scatter
    if count < tol.FEWEST_INDEPENDENT * p:
        evidence = {"independent rows": count, "parameters": float(p)}
        yield CODES["few-rows"].finding("fit", "", evidence)
    if scatter >= tol.TWICE:
        evidence = {"chi-square per degree of freedom": scatter, "blocks": float(shown.blocks)}
        yield CODES["blocks-disagree"].finding("scatter", "", {**evidence, "scatter": scatter**0.5})
    yield from _drifts(shown)
    for name, share in shown.instruments.items():
        if share < tol.POOR:
            weak = {"partial R^2": share, "name": name}
            yield CODES["weak-instruments"].finding("weak", "", weak)


def _drifts(shown: Diagnostics) -> Iterator[Finding]:
    # Drifts with a smaller ratio are not reported; the standard errors contain them too.
    for drift in (drift for drift in shown.drifts if drift.ratio > tol.FAR):
        evidence = {"share of the torque": drift.share, "corner_hz": drift.corner_hz}
        evidence["time constant [s]"] = 1 / (2 * math.pi * drift.corner_hz)
        evidence |= {"likelihood ratio": drift.ratio, "enlarged by": math.sqrt(shown.growth)}
        is_large = shown.growth > tol.TWICE and drift.share >= tol.FEW
        words = {"of": drift.joint or "the joint"}
        yield CODES["drift"].finding("slow", drift.joint, {**evidence, **words}, is_worse=is_large)


def instruments_of_stiff_drives() -> Finding:
    """Return the note on instruments of stiff drives."""
    return CODES["weak-instruments"].note("stiff")


def regression_notes(place: str, side: str, joint: str, checks: ModelChecks) -> Iterator[Finding]:
    """Yield notes on a regression: poor combinations, needless terms, and correlated residuals.

    `place` names the regression in words with its joint, `side` without; `joint` is that of its
    terms, "" if their names contain it.
    """
    for text in checks.poorly_determined:
        yield CODES["poorly-determined"].note("part", "", {"place": place, "text": text})
    for term in checks.terms:
        if term.bic <= 0:
            name = readable(ParameterName(term.terms[0], joint) if joint else term.terms[0])
            # A torque offset is in no drives file: identify adds it.
            what = "seaid adds it" if "torque_offset" in term.terms[0] else "remove the term"
            evidence = {"BIC": term.bic, "name": name, "what": what}
            yield CODES["needless-term"].note("bic", "", evidence)
    for name, white in checks.whiteness.items():
        if white.first > 1 - tol.POOR:
            evidence = {"autocorrelation": white.first, "name": name, "side": side}
            yield CODES["residual"].note("autocorrelated", "", evidence)


# The values of a drive

_ZEROS = (
    *("spring_offset", "deflection_zero", "friction_offset", "torque_offset", "coulomb_shift"),
    *("parallel_preload", "command_delay"),
)
"""Parameters whose true value may be zero, so that a relative error is meaningless."""

POSITIVE = {name for name, kind in PARAMETERS.items() if kind.is_positive}
"""Parameters that are not negative in a drive."""

_OF_TORQUE = (*MOTOR_CONSTANTS.values(), "stiffness")
"""Parameters that are negative where a channel of the log has the opposite sign."""


def _values(joint: str, estimate: Estimate) -> Iterator[tuple[str, str, dict[str, float]]]:
    """Yield the parameters of a drive whose true value is not zero.

    They are (name, name in words, {"value": value, "standard error": error}), the last one as the
    evidence of a finding.
    """
    columns = estimate.values.tolist(), estimate.standard_errors.tolist()
    for name, value, error in zip(estimate.names, *columns, strict=True):
        if not (name in _ZEROS or is_harmonic(name)):
            text = readable(ParameterName(name, joint))
            yield name, text, {"value": value, "standard error": error}


_NONLINEAR = {"deflection_zero", "cubic_stiffness", "fifth_stiffness", "hysteresis_force"}
"""Parameters of springs whose force is not linear in the deflection, dead zones included."""


def _weak(estimate: Estimate, qr_factor: QRFactor | None) -> list[str]:
    """Return why a stiffness may be biased by noise in the deflection, if it may.

    Direct regression with noise in a column gives too small a value, reverse regression too large a
    one. Their ratio is the column's partial R^2, a^2 / (a^2 + b^2) with a, b the entries of the
    last column of R for the deflection and for the residual (Frisch 1934).
    """
    is_linear = {"stiffness", "spring_offset"} <= {*estimate.names}
    if qr_factor is None or not is_linear or _NONLINEAR & {*estimate.names}:
        return []
    names = qr_factor.names
    k, offset, p = names.index("stiffness"), names.index("spring_offset"), len(names)
    others = [place for place in range(p) if place not in (k, offset)]
    # Deflection and torque come last: R[-2:, -2:] has what all other columns leave of both.
    R = triangle(qr_factor.weighted_factor()[:, [*others, offset, k, p]])[-2:, -2:]
    share = R[0, 1] ** 2 / max(R[0, 1] ** 2 + R[1, 1] ** 2, tol.LEAST)  # partial R^2
    if share > 1 - tol.POOR:
        return []
    about_mean = triangle(qr_factor.weighted_factor()[:, [offset, k]])[1, 1]
    # amplitude of the sinusoid with the same root mean square
    swing = np.sqrt(2.0 / qr_factor.count) * abs(about_mean * estimate.value("stiffness"))
    constant = _scattering_constant(estimate)
    name = constant or "stiffness"
    value, unit = estimate.value(name), estimate.units[estimate.names.index(name)]
    # (7) has k / K: a stiffness that is too small is a motor constant that is too large.
    reverse = value * share if constant else value / share
    return [
        f"direct and reverse regression give {value:.3g} and {reverse:.3g} {unit}",
        f"the motion changes the torque of this spring by only +-{swing:.2g} N m at the motor",
    ]


def _scattering_constant(estimate: Estimate) -> str:
    """Return the motor constant with a larger relative error than the stiffness, "" without one.

    For a constant K that the load or a torque sensor determines, (7) has the stiffness k_1 = k / K.
    Where k is known from the load, noise in the deflection is in K.
    """
    sizes = dict(zip(estimate.names, estimate.relative_standard_errors, strict=True))
    larger = (x for x in MOTOR_CONSTANTS.values() if sizes.get(x, 0.0) > sizes["stiffness"])
    return next(larger, "")


def _uncertain(joint: str, estimate: Estimate, qr_factor: QRFactor | None) -> Iterator[Finding]:
    """Yield the parameters with a large standard error, and a stiffness that is biased by noise."""
    weak = _weak(estimate, qr_factor)
    for name, text, evidence in _values(joint, estimate):
        value, error = evidence.values()
        reasons = weak if name == "stiffness" else []
        is_weak = bool(reasons)
        if error > tol.POOR * abs(value):
            share = f"standard error {error / abs(value):.0%}" if value else "value zero"
            reasons = [share, *reasons]
        if is_weak and (K := _scattering_constant(estimate)):
            text = f"{readable(ParameterName(K, joint))}, and with it friction and rotor inertia,"
        if reasons:
            code, case = ("weak-spring", "noise") if is_weak else ("poorly-identified", "error")
            words = {"name": text, "reasons": "; ".join(reasons)}
            yield CODES[code].finding(case, joint, {**evidence, **words})


def _negative(joint: str, estimate: Estimate) -> Iterator[Finding]:
    """Yield the parameters with the wrong sign."""
    for name, text, evidence in _values(joint, estimate):
        value, error = evidence.values()
        if name not in POSITIVE or not value < 0:
            continue
        is_sure, words = value < -tol.SURE * error, {"name": text}
        if PARAMETERS[name].starts:  # of a search: not due to a wrong sign in the log
            yield CODES["needless-term"].finding("zero", joint, {**evidence, **words})
        elif name == "coulomb_friction" and "stiffness" in estimate.names:
            evidence["play"] = abs(value / estimate.value("stiffness"))
            of_joint = "play", joint, {**evidence, **words}
            yield CODES["loose-encoder"].finding(*of_joint, is_worse=is_sure)
        else:
            case = _if_negative(name, estimate.names, is_sure)
            of_value = case, joint, {**evidence, **words}
            yield CODES["negative-parameter"].finding(*of_value, is_worse=is_sure)


def _if_negative(name: str, others: Collection[str], is_sure: bool) -> str:
    """Return the case of a parameter below zero, `is_sure` if its interval excludes zero."""
    if name in _OF_TORQUE:
        return "channel"
    if name != "motor_inertia":
        return "friction" if is_sure else "zero"
    if not is_sure:
        return "zero-inertia"
    if "command_delay" in others:
        return "delayed"
    return "with-spring" if "stiffness" in others else "without-spring"


_OF_VALUES = ("poorly-identified", "needless-term", "loose-encoder", "negative-parameter")
"""The codes of values alone; a weak spring is one by its equation."""


@looks_for(CODES["poorly-identified"])
def drive_findings(joint: str, estimate: Estimate, factor: QRFactor | None) -> list[Finding]:
    """Return what the values of a drive show, with the QR factor of its motor equation (10)."""
    return [*_uncertain(joint, estimate, factor), *_negative(joint, estimate)]


def revalued(findings: Sequence[Finding], drives: Mapping[str, Estimate]) -> tuple[Finding, ...]:
    """Return findings with those of the values of some drives that were estimated anew."""
    kept = (x for x in findings if x.code not in _OF_VALUES or x.joint not in drives)
    new = [x for joint, estimate in drives.items() for x in drive_findings(joint, estimate, None)]
    return (*kept, *consequences(findings, new))


_ONE_SIDED = ("dead_zone", "deflection_zero")
"""Half width and centre of a dead zone: a spring that is loaded in one direction shows one end."""


@looks_for(CODES["unidentifiable"])
def fixed_findings(joint: str, drive: Drive, names: Collection[str]) -> Iterator[Finding]:
    """Yield the parameters of a drive that a search fixed at their values in the drive."""
    # without a dead zone, or next to a preload, a zero may be unidentifiable from any motion
    has_zone = {*DEAD_ZONES} & {*drive.spring} and "preload" not in drive.spring
    for name in names:
        value, evidence = drive.values[name], dict[str, float]()
        words = {"name": readable(ParameterName(name, joint))}
        words["fixed"], case = f"fixed at {value:.3g} {unit_of(drive, name)}", "fixed"
        if name in _ONE_SIDED and has_zone:
            (second,) = {*_ONE_SIDED} - {name}
            words["second"], evidence, case = second.replace("_", " "), {name: value}, "one-sided"
        yield CODES["unidentifiable"].finding(case, joint, {**evidence, **words})


def competing_optimum(joint: str, evidence: Mapping[str, Any], is_far: bool) -> Finding:
    """Return the finding of values with which the drive of a joint explains the log as well."""
    return CODES["competing-optima"].finding("optimum", joint, evidence, is_worse=is_far)


@looks_for(CODES["drives-differ"])
def shared_findings(parameters: Iterable[SharedParameter]) -> Iterator[Finding]:
    """Yield the shared parameters in which the drives of a group differ beyond chance."""
    for shared in parameters:
        if shared.difference.p_value > math.erfc(tol.SIGNIFICANT / math.sqrt(2)):
            continue
        spread = float(np.ptp(shared.values) / np.max(np.abs(shared.values)))
        values = dict(zip(shared.joints, shared.values, strict=True))
        words = {"owner": shared.name.owner, "quantity": shared.name.quantity.replace("_", " ")}
        words["alone"] = listed(f"{value:.3g} at {joint}" for joint, value in values.items())
        evidence = {**values, "spread": spread, **words}
        of_group = "shared", "", evidence, None, spread > tol.POOR
        yield CODES["drives-differ"].finding(*of_group, joints=shared.joints)


def sure_offsets(drives: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """Return {joint: constant error of its motor torque} of those that are no chance.

    Of springs the load side has a column of it. `drives` are the estimates by joint.
    """
    name, level = "torque_offset", 1 - tol.FEW * tol.POOR  # one in a thousand is chance
    offsets = {joint: x.of_names([name]) for joint, x in drives.items() if name in x.names}
    # both ends of the interval have one sign
    return {joint: x for joint, x in offsets.items() if np.prod(x.interval(level)) > 0}


@looks_for(CODES["torque-offset"])
def offset_findings(drives: Mapping[str, Estimate], experiment: Experiment) -> Iterator[Finding]:
    """Yield the constant errors of motor torques that matter next to the torque on the spring.

    That is the whole torque, of known bodies too. So `drives` have the errors of what was given.
    """
    for joint, offset in sure_offsets(drives).items():
        (value,), (error,) = offset.values.tolist(), offset.standard_errors.tolist()
        j, lever = experiment.robot.index(joint), experiment.robot.drives[joint].load_radius
        k, force = (drives[joint].value(x) for x in ("stiffness", "spring_offset"))
        # (4b): r_L (k r_L (r_M / (N r_L) theta_M - q) + f_0), over N r_L / r_M that at the motor.
        torques = lever * (k * lever * experiment.apart[:, j] + force) / experiment.lever[j]
        torque = float(np.sqrt(np.mean(torques**2)))
        if not abs(value) < tol.FEW * torque:
            evidence = {"offset_Nm": value, "standard error": error, "torque_rms_Nm": torque}
            evidence["part"] = abs(value) / torque
            is_large = evidence["part"] > tol.RARE
            yield CODES["torque-offset"].finding("constant", joint, evidence, is_worse=is_large)


# What was given as known


def shared_scale(std: float) -> Finding:
    """Return the note that one scale error of all torques is in all standard errors."""
    return CODES["torque-scale"].note("shared", "", {"relative std": std})


def scale_of_bodies(joints: Sequence[str]) -> Iterator[Finding]:
    """Yield the note on joints whose motor constants rest on known bodies, which are exact."""
    if joints:
        names = {"joints": listed(joints)}
        yield CODES["torque-scale"].finding("bodies", only_joint(joints), names)


# Bodies


def contradictions(robot: Robot, program: Program, least: float) -> Iterator[Finding]:
    """Yield the assumption that the data contradict, unless chi-square `least` is plausible.

    `least` is the least chi-square of a program of physical consistency. Each payload and all of
    them are removed in turn: the one that reduces chi-square most is named. Raises as `nearest`
    does.
    """
    count = len(program.estimate)
    # chi-square has the mean n and the variance 2 n
    if least <= count + tol.CONTRADICTED * math.sqrt(2.0 * count):
        return
    without = {nearest(x).chi_square: words for words, x in _payloads_removed(robot, program)}
    smallest, evidence = min(without, default=least), {"chi-square": least, "values": float(count)}
    case, words = "far", {"known": ""}
    if smallest < (1 - tol.NOTHING) * least:
        case, words = "payload", {"without": without[smallest]}
        evidence["chi-square without"] = smallest
    elif robot.known_bodies:
        words["known"] = f"known bodies ({', '.join(robot.known_bodies)}), "
    yield CODES["inconsistent-inertia"].finding(case, "", {**evidence, **words})


def inconsistent_bodies(robot: Robot, is_nearest: bool) -> Iterator[Finding]:
    """Yield the note on bodies of a result that are physically inconsistent.

    `is_nearest` says whether the nearest consistent ones were asked for.
    """
    bodies = zip(robot.body_names, robot.parameters.reshape(-1, 10), strict=True)
    wrong = [x for x, y in bodies if not (np.all(np.isfinite(y)) and is_physical(y, THIN))]
    if wrong:
        code = CODES["inconsistent-inertia"]
        remedy = "" if is_nearest else code.advice
        yield code.note("links", evidence={"links": listed(wrong)}, remedy=remedy)


def _payloads_removed(robot: Robot, program: Program) -> Iterator[tuple[str, Program]]:
    """Yield each payload with its remedy, and the program without it."""
    payloads = robot.payload_parameters.reshape(-1, 10)
    loaded = np.flatnonzero(payloads[:, 0]).tolist()
    for bodies in [[body] for body in loaded] + ([loaded] if len(loaded) > 1 else []):
        removed = np.zeros_like(payloads)
        removed[bodies] = payloads[bodies]
        masses = ((payloads[body, 0], robot.body_names[body]) for body in bodies)
        each = " and ".join(f"the payload of {mass:.4g} kg on {name}" for mass, name in masses)
        # Without the payloads their torque is one of the bodies.
        propagated = program.columns[:, : payloads.size] @ removed.ravel()
        without = replace(program, estimate=program.estimate + propagated)
        yield f"{each}: check that it is on the robot, its mass and its place", without


# Gears, and what of a log no equation uses


def rigid_gear(joint: str, least: float) -> Finding:
    """Return the note on a gear whose stiffness [N m/rad] is above the `least` one."""
    return CODES["gear-compliance"].note("rigid", joint, {"least stiffness": least})


@looks_for(CODES["gear-compliance"])
def gear_findings(
    robot: Robot, drives: Mapping[str, Estimate], gears: Collection[str], sources: Sequence[Entries]
) -> Iterator[Finding]:
    """Yield a note on the joints whose stiffness includes that of the gear, but those of `gears`.

    `sources` {joint: {quantity: source}} are those of each log: a sensor of the deflection may
    stand for the encoder of one side of a spring.
    """
    joints = [
        joint
        for joint, estimate in drives.items()
        if joint not in gears and "stiffness" in estimate.names
        # a motor turns and a slide does not: a screw, a rack or a belt is between them
        if robot.drives[joint].ratio != 1 or robot.drives[joint].joint_units[1] == "m"
        if not robot.drives[joint].gear_compliance
        if not all(_is_by_deflection(source.get(joint, {})) for source in sources)
    ]
    if joints:
        names = {"joints": listed(joints)}
        yield CODES["gear-compliance"].note("in-series", only_joint(joints), names)


def _is_by_deflection(channels: Collection[str]) -> bool:
    """Return whether a deflection stands for the encoder of one side of a spring."""
    return "deflection" in channels and not {"motor_position", "joint_position"} <= {*channels}


@looks_for(CODES["unused-channel"])
def unused_findings(
    robot: Robot, drives: Mapping[str, Estimate], used: Sequence[str], motions: Sequence[Motion]
) -> Iterator[Finding]:
    """Yield notes on parameters of `drives` that no equation has, and on channels without use.

    The torques of the joints that are `used` are in the equations.
    """
    yield from _without_motor_equation(robot, drives)
    inputs = {x: INPUT_FIELDS[robot.drives[x].motor_input] for x in used}
    logged = _logged_torques(robot, motions)
    for channel, joints in logged.items():
        unused = [joint for joint in joints if inputs.get(joint, channel) != channel]
        if channel == "joint_torque":  # that is in (4b), or stands for that of the motor
            stiff = {*robot.joint_names}.difference(robot.elastic_joints)
            unused = [x for x in unused if x in stiff.intersection(logged[inputs[x]])]
        if unused:
            words = {"channel": channel.replace("_", " "), "joints": listed(unused)}
            yield CODES["unused-channel"].note("unused", only_joint(unused), words)


def _without_motor_equation(robot: Robot, drives: Mapping[str, Estimate]) -> Iterator[Finding]:
    for joint in robot.elastic_joints:
        names = motor_regressor(robot, joint).names
        missing = [name.replace("_", " ") for name in names if name not in drives[joint].names]
        if missing:
            words = {"input": robot.drives[joint].motor_input, "missing": listed(missing)}
            yield CODES["unidentifiable"].note("motor", joint, words)


def _logged_torques(robot: Robot, motions: Sequence[Motion]) -> dict[str, list[str]]:
    """Return {channel: joints of which some motion has it}."""
    logged = {}
    for channel in (*INPUT_FIELDS.values(), "joint_torque"):
        is_logged = np.zeros(robot.n, dtype=bool)
        for motion in motions:
            signals = getattr(motion, channel)
            is_logged |= False if signals is None else np.any(np.isfinite(signals), axis=0)
        logged[channel] = np.array(robot.joint_names)[is_logged].tolist()
    return logged


# Held loads


def calibration_findings(
    misfit: float, slope: float, law: str, p_value: float, is_curved: bool
) -> Iterator[Finding]:
    """Yield what to know before a calibration by held loads is used.

    `misfit` is the rms error over the standard deviation of the loads; `p_value` that of a cubic
    term, and `is_curved` whether it is significant.
    """
    if misfit > tol.SLIGHT:
        yield CODES["no-fit"].finding("law", "", {"misfit": misfit}, is_worse=misfit > tol.MOST)
    if law == "linear" and is_curved:
        yield CODES["nonlinear-spring"].finding("loads", "", {"p-value": p_value})
    if law == "cubic" and not is_curved:
        yield CODES["needless-term"].finding("cubic", "", {"p-value": p_value})
    if slope < 0:
        yield CODES["sign"].finding("readings")
