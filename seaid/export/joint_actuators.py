"""The drives of a robot as simulators see them: one rigid actuator per joint, in its coordinate.

A simulator has the armature N^2 I_M, viscous friction N^2 F_v and dry friction N F_C of a joint;
for an elastic drive N is N r_L / r_M, as if its spring were rigid. What a file of a simulator
cannot hold is a `Finding`: none of it is excluded silently.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from seaid.checks.predictions import not_in_format
from seaid.drives import Drive, total_ratio, unit_of
from seaid.errors import Finding, Severity, listed
from seaid.export.mjcf_drives import SMOOTH, motor_at, term_value, unsupported_terms
from seaid.robot import Robot


@dataclass(frozen=True)
class JointActuator:
    """An actuator in the coordinate of its joint [SI, rad or m]; `offset` acts against the motor.

    Its force is clip(position_gain (u(t - delay_s) - q) - velocity_gain q' + feedforward, +-limit)
    - offset.
    """

    joint: str
    slides: bool
    drive: Drive
    armature: float
    viscous: float
    dry: float
    offset: float
    feedforward: float
    position_gain: float
    velocity_gain: float
    limit: float
    delay_s: float
    velocity_limit: float

    def steps(self, step_s: float) -> int:
        """Return the delay in time steps; a command that acts early acts at once."""
        return max(round(self.delay_s / step_s), 0)


def actuators_of(robot: Robot, *, is_complete: bool = True) -> tuple[JointActuator, ...]:
    """Return the actuators of all drives that move one joint.

    Raises RobotError for a value that is unknown if the model has to be complete; else it is zero.
    """
    # A differential, a belt past the elbow or a linkage is no actuator with one ratio to a joint.
    # Writers exclude infinite numbers, so that infinity is "no limit" in each format.
    limits = np.nan_to_num(robot.velocity_limits, nan=np.inf, posinf=np.inf)
    return tuple(
        _actuator(joint, _known(robot.drives[joint], is_complete), slides, float(limit))
        for joint, slides, limit, is_plain in zip(
            robot.joint_names, robot.is_prismatic, limits, has_plain_gear(robot), strict=True
        )
        if is_plain
    )


def has_plain_gear(robot: Robot) -> np.ndarray:
    """Return whether each drive (n,) moves its own joint alone, by a constant ratio."""
    plain = (robot.transmission == np.eye(robot.n)).all(axis=1)
    return np.asarray(plain & ~np.isin(np.arange(robot.n), [*robot.angle_ratios.by_joint]))


def _known(drive: Drive, is_complete: bool) -> Drive:
    """Return the drive, with zeros for values that are unknown unless it has to be complete."""
    unknown = {name: 0.0 for name in drive.parameter_names if name not in drive.values}
    return drive.with_values(unknown) if unknown and not is_complete else drive


def _actuator(joint: str, drive: Drive, slides: bool, velocity_limit: float) -> JointActuator:
    # `law` has the gains in N m even if those of `controller` are in counts or duty cycles.
    ratio, controller = total_ratio(drive), drive.law
    # The law acts at theta_M/N = (r_L/r_M) q: its torques at the joint are r_L/r_M times as large,
    # and its gains by the square of that.
    pulleys = ratio / drive.ratio
    motor = motor_at(joint, drive, ratio)
    return JointActuator(
        joint=joint,
        slides=slides,
        drive=drive,
        armature=motor.armature,
        viscous=motor.damping + term_value(joint, drive, "joint_friction", "viscous"),
        dry=motor.friction + term_value(joint, drive, "joint_friction", "coulomb"),
        offset=ratio * term_value(joint, drive, "friction", "offset"),
        # The torque limit of the drive holds for its feed-forward, and not for its friction.
        feedforward=pulleys * controller.feedforward_Nm if controller else 0.0,
        position_gain=pulleys**2 * controller.position_gain_Nm_per_rad if controller else 0.0,
        velocity_gain=pulleys**2 * controller.velocity_gain_Nms_per_rad if controller else 0.0,
        limit=pulleys * controller.torque_limit_Nm if controller else math.inf,
        delay_s=drive.command_delay_s or 0.0 if controller else 0.0,
        # A URDF must have the attribute velocity, and has 0 where no limit is known.
        velocity_limit=velocity_limit if velocity_limit > 0 else math.inf,
    )


Remedy = Callable[[Sequence[JointActuator]], str]
"""What replaces an effect that a file lacks, for the actuators that have the effect."""


def no_remedy(_: Sequence[JointActuator]) -> str:
    """Return the remedy of an effect that nothing replaces."""
    return ""


@dataclass(frozen=True)
class Effect:
    """What a model may have: its size per actuator, its severity if a file lacks it, its remedy."""

    size: Callable[[JointActuator], float]
    unit: str
    severity: Severity
    remedy: Remedy = no_remedy


SLIDING_UNITS = {"kg m^2": "kg", "N m s/rad": "N s/m", "N m/rad": "N/m", "N m": "N", "s": "s"}
"""{unit of a joint that turns: that of one that slides}."""


def _unit(actuator: JointActuator, effect: Effect) -> str:
    if effect is EFFECTS["spring"]:
        return unit_of(actuator.drive, "stiffness")
    return SLIDING_UNITS[effect.unit] if actuator.slides else effect.unit


def _as_commands(torque: Callable[[JointActuator], float]) -> Remedy:
    """Return the remedy that replaces a constant torque by a change of the commands."""

    # As a torque it is added as it is, to a commanded position as the du with K_p du = torque.
    # Beyond the torque limit the controller cuts it off, as a drive does with its feed-forward.
    def remedy(lost: Sequence[JointActuator]) -> str:
        shifts = [
            f"{a.joint} {torque(a) / a.position_gain:+.4g} {'m' if a.slides else 'rad'}"
            if a.position_gain
            else f"{a.joint} {torque(a):+.4g} {'N' if a.slides else 'N m'}"
            for a in lost
        ]
        return f"add to the commands: {', '.join(shifts)}"

    return remedy


def _spring(actuator: JointActuator) -> float:
    return actuator.drive.values.get("stiffness", math.nan) if actuator.drive.is_elastic else 0.0


def _parallel(actuator: JointActuator) -> float:
    values = actuator.drive.values
    return values.get("parallel_stiffness", 0.0) or values.get("parallel_preload", 0.0)


def _term_size(name: str, term: str) -> Callable[[JointActuator], float]:
    def size(actuator: JointActuator) -> float:
        return actuator.drive.values.get(name, math.nan) if term in actuator.drive.friction else 0.0

    return size


EFFECTS = {
    "armature": Effect(lambda a: a.armature, "kg m^2", "doubtful"),
    "viscous friction": Effect(lambda a: a.viscous, "N m s/rad", "doubtful"),
    "dry friction": Effect(lambda a: a.dry, "N m", "doubtful"),
    "friction offset": Effect(lambda a: a.offset, "N m", "note", _as_commands(lambda a: -a.offset)),
    "feed-forward": Effect(
        lambda a: a.feedforward, "N m", "note", _as_commands(lambda a: a.feedforward)
    ),
    "gains": Effect(
        lambda a: a.position_gain,
        "N m/rad",
        "note",
        lambda lost: (
            "give the controller these gains: "
            + ", ".join(f"{x.joint} p {x.position_gain:.6g}, d {x.velocity_gain:.6g}" for x in lost)
        ),
    ),
    "torque limit": Effect(lambda a: a.limit if a.limit < math.inf else 0, "N m", "note"),
    "delay": Effect(lambda a: a.delay_s, "s", "doubtful"),
    "spring": Effect(
        _spring,
        "N m/rad",
        "doubtful",
        lambda _: "--format mjcf, which has springs; in this file the joints are rigid",
    ),
    "parallel spring": Effect(_parallel, "N m/rad", "doubtful"),
    "Stribeck friction": Effect(_term_size("stribeck_friction", "stribeck"), "N m", "doubtful"),
}
"""What a file may hold of the drives, in the order of the findings and of the table of the docs."""

_BY_OTHERS = ("viscous", "coulomb", *SMOOTH, "offset", "stribeck")


def _other_terms(drive: Drive) -> list[str]:
    """Return the terms of a drive that no simulator has."""
    terms, law = unsupported_terms(drive, _BY_OTHERS), drive.law
    if law is None:
        return terms
    # The simulators' PD laws are K_p (u - q) + K_d (w - q') with w = 0 or the velocity of the
    # command: only these two values of K_v can be had from their single velocity gain.
    gain = law.command_velocity_gain_Nms_per_rad
    is_lost = {
        "gain on the velocity of the command": gain not in (0.0, law.velocity_gain_Nms_per_rad),
        "no-load speed": math.isfinite(law.no_load_speed_rad_per_s),
        "supply voltage": law.nominal_supply_V is not None,
    }
    return [*terms, *compress(is_lost, is_lost.values())]


def lost_effects(
    robot: Robot, actuators: Sequence[JointActuator], title: str, holds: Collection[str]
) -> list[Finding]:
    """Return what a format that `holds` some effects does not have of the drives of a robot."""
    findings = [
        finding
        for name, effect in EFFECTS.items()
        if name not in holds
        for finding in _lost_effect(effect, f"{title} has no {name}", actuators)
    ]
    if "other terms" not in holds:
        findings += _lost_terms(title, actuators, is_dry="dry friction" in holds)
    single = {a.joint for a in actuators}
    coupled = [joint for joint in robot.joint_names if joint not in single]
    if coupled and "coupled drives" not in holds:
        text = f"{title} has no drive that moves several joints, or one by a ratio of its angle"
        findings.append(not_in_format(f"{text}: those of {listed(coupled)} are not in the file"))
    return findings


def _lost_effect(
    effect: Effect, problem: str, actuators: Iterable[JointActuator]
) -> Iterator[Finding]:
    """Yield the finding of an effect that a format lacks, if an actuator has it."""
    lost = [a for a in actuators if effect.size(a) != 0]
    sizes = {a.joint: effect.size(a) for a in lost}
    texts = listed(f"{a.joint} ({sizes[a.joint]:.4g} {_unit(a, effect)})" for a in lost)
    if lost:
        text = f"{problem}: it is not in the file for {texts}"
        remedy = effect.remedy(lost)
        yield not_in_format(text, severity=effect.severity, evidence=sizes, remedy=remedy)


def _lost_terms(
    title: str, actuators: Sequence[JointActuator], *, is_dry: bool
) -> Iterator[Finding]:
    """Yield the findings of terms that a format lacks, or has as dry friction if `is_dry`."""
    others = {a.joint: _other_terms(a.drive) for a in actuators}
    texts = [f"{joint} ({', '.join(terms)})" for joint, terms in others.items() if terms]
    if texts:
        yield not_in_format(f"{title} has not these terms of the drives: {listed(texts)}")
    smooth = [a.joint for a in actuators if {*SMOOTH} & {*a.drive.friction}]
    if smooth and is_dry:
        text = f"smooth friction is written as dry friction for {listed(smooth)}"
        yield not_in_format(text, severity="note")


def limited_offsets(actuators: Iterable[JointActuator]) -> list[Finding]:
    """Return the friction offsets that a limit of the whole force cuts off, unlike the drive's."""
    limited = [a for a in actuators if a.offset and math.isfinite(a.limit)]
    if not limited:
        return []
    sizes = {a.joint: a.offset for a in limited}
    text = "at its torque limit, an actuator of the file has no friction offset: "
    text += listed(f"{a.joint} ({a.offset:.4g} of {a.limit:.4g})" for a in limited)
    return [not_in_format(text, severity="note", evidence=sizes)]


def rounded_delays(actuators: Iterable[JointActuator], step_s: float) -> list[Finding]:
    """Return the delays that differ from those of the file, which are whole steps."""
    errors = {a.joint: a.steps(step_s) * step_s - a.delay_s for a in actuators}
    far = {joint: error for joint, error in errors.items() if abs(error) > _EXACT * step_s}
    if not far:
        return []
    delays = listed(f"{joint} is {error * 1e3:+.3g} ms off" for joint, error in far.items())
    text = f"delays are whole steps of {step_s * 1e3:g} ms in the file: {delays}"
    remedy = "--time-step, with the time step of the simulation"
    return [not_in_format(text, severity="note", evidence=far, remedy=remedy)]


_EXACT = 0.05
"""Part of a time step that a rounded delay may be off without a finding."""
