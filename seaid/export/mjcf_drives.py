"""The drives of a MuJoCo model: rotors, springs, friction and motors.

In words: what of a robot's drives a MuJoCo model has in another way, or not at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from seaid.drives import Drive, SeriesElasticDrive, StiffDrive, key_of, unit_of
from seaid.errors import RobotError
from seaid.export.mjcf_bodies import TINY, text
from seaid.robot import Robot

SMOOTH = ("smooth_coulomb", "shifted_coulomb")
"""Friction terms that are written as dry friction."""

_SAID = ("viscous", "coulomb", *SMOOTH)


def note_drive(joint: str, drive: Drive, notes: list[str]) -> None:
    """Say what of a drive's terms the model has not, or has in another way."""
    smooth = [term for term in drive.friction if term in SMOOTH]
    if smooth:
        notes.append(f"joint '{joint}': its {smooth[0]} is written as dry friction (friction loss)")
    lost = [term for term in drive.friction if term not in _SAID]
    lost += [f"extra term {term}" for term in drive.extra_terms]
    if lost:
        notes.append(f"joint '{joint}': left out, MuJoCo cannot say it: {', '.join(lost)}")
    offset = drive.values.get("spring_offset", 0.0)
    if offset and "preload" not in getattr(drive, "spring", ()):
        notes.append(
            f"joint '{joint}': its deflection offset ({offset:.4g} "
            f"{unit_of(drive, 'spring_offset')}) is what the encoders' zeros leave and not in "
            "the model, where the spring is at rest when both sides are at zero"
        )
    if drive.motor_input != "torque":
        constant = f"{drive.motor_input.replace('current', 'torque')}_constant"
        value = drive.values.get(constant)
        told = "unknown" if value is None else f"{value:.6g} {unit_of(drive, constant)}"
        notes.append(
            f"joint '{joint}': its control is the motor torque, {constant} ({told}) times the "
            f"{drive.motor_input}"
        )


def note_drives(robot: Robot, step: float, notes: list[str]) -> None:
    """Say what holds for all motors, and of the time step [s] that friction needs."""
    if robot.elastic_joints:
        notes.append(
            "motors of elastic joints turn on bodies of their own that stand still in the world "
            f"({TINY:g} kg, and that much of their inertia in kg m^2): the links carry the motors' "
            "masses, and gyroscopic torques of rotors are not there, as in the method's equations"
        )
    dry = ("coulomb_friction", "joint_coulomb_friction")
    if any(drive.values.get(name) for drive in robot.drives.values() for name in dry):
        notes.append(
            f"MuJoCo's friction loss is soft: it brakes within a step ({step:g} s), and what it "
            "holds creeps a little"
        )


_FIRM = 0.999
"""Impedance of friction loss: how firmly it holds, of 1."""


@dataclass(frozen=True)
class _Line:
    """What acts along one coordinate: values of attributes; `rest` is where its spring rests."""

    armature: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    rest: tuple[float, ...] = (0.0,)


def add_drives(
    robot: Robot,
    joints: Mapping[str, Any],
    world: Any,
    parts: Sequence[Any],
    step: float,
    notes: list[str],
) -> None:
    """Add all drives to the elements of the joints, to the world, and to <tendon> and <actuator>.

    Raises RobotError naming joint and value that is not known, and what MuJoCo cannot say.
    """
    tendons, actuators = parts
    taken = {*robot.joint_names, *robot.body_names, "world"}
    for index, joint in enumerate(robot.joint_names):
        drive, C = robot.drives[joint], robot.transmission[index]
        note_drive(joint, drive, notes)
        turned = {robot.joint_names[at]: float(C[at]) for at in np.flatnonzero(C)}
        beside, gear = _beside(joint, drive), _Line()
        where = {"joint": joint}
        if isinstance(drive, StiffDrive):
            gear = _behind_gear(joint, drive)
            _check_armature(robot, joint, turned, gear.armature)
            if turned != {joint: 1.0}:
                where = {"tendon": _free(f"{joint}_drive", taken)}
                _add_tendon(tendons, where["tendon"], turned, gear, step)
                gear = _Line()
        shared = replace(
            beside,
            armature=gear.armature,
            damping=beside.damping + gear.damping,
            friction=beside.friction + gear.friction,
        )
        _set_joint(joints[joint], shared, step)
        if isinstance(drive, SeriesElasticDrive):
            where = {"joint": _add_rotor(world, joint, drive, taken, step)}
            lever = {where["joint"]: drive.motor_radius / drive.ratio}
            lever |= {name: -drive.load_radius * factor for name, factor in turned.items()}
            spring = _spring(joint, drive)
            _add_tendon(tendons, _free(f"{joint}_spring", taken), lever, spring, step)
        ratio = drive.ratio if isinstance(drive, StiffDrive) else 1.0
        actuators.append(actuators.makeelement("motor", name=joint, gear=text([ratio]), **where))
    note_drives(robot, step, notes)


def _behind_gear(joint: str, drive: StiffDrive) -> _Line:
    """Return the motor of a stiff drive, seen at what it turns."""
    motor = _motor(joint, drive)
    return _Line(
        armature=drive.ratio**2 * motor.armature,
        damping=drive.ratio**2 * motor.damping,
        friction=drive.ratio * motor.friction,
    )


def _beside(joint: str, drive: Drive) -> _Line:
    """Return what acts between the joint's bodies beside the drive: parallel spring, friction."""
    beside = getattr(drive, "joint_friction", ())
    damping = _value(joint, drive, "joint_viscous_friction") if "viscous" in beside else 0.0
    friction = _value(joint, drive, "joint_coulomb_friction") if "coulomb" in beside else 0.0
    parallel, stiffness, rest = drive.parallel_spring, 0.0, 0.0
    if "linear" in parallel:
        stiffness = _value(joint, drive, "parallel_stiffness")
    if "preload" in parallel:
        preload = _value(joint, drive, "parallel_preload")
        if stiffness == 0 and preload != 0:
            raise RobotError(
                f"joint '{joint}': MuJoCo has no parallel preload without a parallel spring: give "
                "parallel_spring=('linear', 'preload')"
            )
        rest = -preload / stiffness if stiffness else 0.0
    if stiffness < 0:
        raise RobotError(
            f"joint '{joint}': MuJoCo has no parallel spring with a negative stiffness, found "
            f"{stiffness:.4g} {unit_of(drive, 'parallel_stiffness')}"
        )
    return _Line(0.0, damping, friction, stiffness, (rest,))


def _motor(joint: str, drive: Drive) -> _Line:
    """Return what acts at the motor of a drive, as its own coordinate has it."""
    dry = any(term in drive.friction for term in ("coulomb", *SMOOTH))
    viscous = "viscous" in drive.friction
    return _Line(
        armature=_value(joint, drive, "motor_inertia"),
        damping=_value(joint, drive, "viscous_friction") if viscous else 0.0,
        friction=_value(joint, drive, "coulomb_friction") if dry else 0.0,
    )


def _spring(joint: str, drive: SeriesElasticDrive) -> _Line:
    """Return the spring of a drive over its deflection."""
    nonlinear = [term for term in drive.spring if term in ("cubic", "fifth")]
    if nonlinear:
        raise RobotError(
            f"joint '{joint}': the spring has the term '{nonlinear[0]}', and MuJoCo's are straight "
            "lines: give or identify one with spring=('linear',)"
        )
    stiffness = _value(joint, drive, "stiffness")
    damping = _value(joint, drive, "spring_damping") if "damping" in drive.spring else 0.0
    if "dead_zone" in drive.spring:
        if "preload" in drive.spring:
            raise RobotError(
                f"joint '{joint}': the spring has a dead zone and a preload, which pulls inside "
                "of it too; MuJoCo's do not: give or identify one without one of the two"
            )
        zero, half = drive.values.get("deflection_zero", 0.0), _value(joint, drive, "dead_zone")
        return _Line(damping=damping, stiffness=stiffness, rest=(zero - half, zero + half))
    preload = _value(joint, drive, "spring_offset") if "preload" in drive.spring else 0.0
    return _Line(damping=damping, stiffness=stiffness, rest=(-preload / stiffness,))


def _value(joint: str, drive: Drive, name: str) -> float:
    values = drive.values
    if name not in values:
        raise RobotError(
            f"joint '{joint}': '{key_of(name, unit_of(drive, name))}' is not known; a MuJoCo "
            "model needs it: identify it, or give a nominal value"
        )
    return values[name]


def _set_joint(element: Any, line: _Line, step: float) -> None:
    numbers = {
        "armature": line.armature,
        "damping": line.damping,
        "frictionloss": line.friction,
        "stiffness": line.stiffness,
        "springref": line.rest[0],
    }
    for name, number in numbers.items():
        if number:
            element.set(name, text([number]))
    _set_friction(element, line, step)


def _add_tendon(
    tendons: Any, name: str, lever: Mapping[str, float], line: _Line, step: float
) -> None:
    """Add a tendon whose length is the sum of lever times coordinate."""
    element = tendons.makeelement("fixed", name=name)
    numbers = {"armature": line.armature, "damping": line.damping, "frictionloss": line.friction}
    for attribute, number in numbers.items():
        if number:
            element.set(attribute, text([number]))
    if line.stiffness:
        element.set("stiffness", text([line.stiffness]))
        element.set("springlength", text(line.rest))
    _set_friction(element, line, step)
    for joint, factor in lever.items():
        element.append(element.makeelement("joint", joint=joint, coef=text([factor])))
    tendons.append(element)


def _set_friction(element: Any, line: _Line, step: float) -> None:
    """Make friction loss brake within one step, the quickest that MuJoCo takes."""
    if line.friction:
        element.set("solreffriction", text([2 * step, 1.0]))
        element.set("solimpfriction", text([_FIRM, _FIRM, 0.001]))


def _add_rotor(
    world: Any, joint: str, drive: SeriesElasticDrive, taken: set[str], step: float
) -> str:
    """Add the motor of an elastic drive as a body of its own; return the name of its joint."""
    name = _free(f"{joint}_motor", taken)
    line = _motor(joint, drive)
    if line.armature <= TINY:
        raise RobotError(f"joint '{joint}': an elastic drive needs a motor inertia to be simulated")
    body = world.makeelement("body", name=name)
    nothing = {"mass": text([TINY]), "diaginertia": text([TINY] * 3)}
    body.append(body.makeelement("inertial", pos="0 0 0", **nothing))
    element = body.makeelement("joint", name=name, type="hinge", axis="0 0 1", limited="false")
    # what the body itself has about its axis is not in the armature
    _set_joint(element, _Line(line.armature - TINY, line.damping, line.friction), step)
    body.append(element)
    world.append(body)
    return name


def _free(name: str, taken: set[str]) -> str:
    """Return a name that nothing has yet, and take it."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _check_armature(robot: Robot, joint: str, turned: Mapping[str, float], armature: float) -> None:
    """Refuse rotor inertia between joints of different branches: MuJoCo would lose a part of it."""
    if not armature:
        return
    places = [int(robot.model.getJointId(name)) for name in turned]
    supports: dict[int, pin.StdVec_Index] = {at: list(robot.model.supports[at]) for at in places}
    for first in places:
        for second in places:
            if first not in supports[second] and second not in supports[first]:
                raise RobotError(
                    f"joint '{joint}': its stiff drive moves joints of different branches "
                    f"({', '.join(turned)}), and MuJoCo does not couple their inertia: it can be "
                    "written with motor_inertia_kg_m2 = 0, or as an elastic drive"
                )
