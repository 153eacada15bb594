"""In words: what of a robot's drives a MuJoCo model has in another way, or not at all."""

from __future__ import annotations

from seaid.drivetrain.model import Drive
from seaid.drivetrain.values import unit_of
from seaid.export.mjcf_bodies import TINY
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
    offset = drive.values.get("deflection_offset", 0.0)
    if offset and "preload" not in getattr(drive, "spring", ()):
        notes.append(
            f"joint '{joint}': its deflection offset ({offset:.4g} "
            f"{unit_of(drive, 'deflection_offset')}) is what the encoders' zeros leave and not in "
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
    if any(drive.values.get(name) for drive in robot.drivetrains.values() for name in dry):
        notes.append(
            f"MuJoCo's friction loss is soft: it brakes within a step ({step:g} s), and what it "
            "holds creeps a little"
        )
