"""What a log of a legged robot does not say: when its feet stand, and which leg is which.

`find_contacts` computes the forces on the feet from torques and motion, with the bodies of the
robot file. `with_leg_order` takes the order of legs and flags in which standing feet rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from seaid._arrays import Array, BoolArray, safely
from seaid._progress import Display
from seaid.checks import FeetInMotion, best_order
from seaid.errors import IdentificationError, LogError, checked
from seaid.log import (
    FOUND_CONTACT,
    Description,
    Log,
    Repair,
    low_pass,
    meaning_of,
    reconstruct_motion,
)
from seaid.regressor import contact_map, floating_regressor
from seaid.robot import Robot, torques_at_joints

LOADED, FREE = 0.03, 0.015
"""Parts of the weight on a foot above which it stands, and below which it is in the air; between
them it stays what it was. A foot said to stand costs information only, one said to be in the air
biases the bodies, so both are small: in walks of a simulated Go2 whose bodies are wrong by 20 % and
that were used to select them, 99 % of the samples are right (docs/results.md)."""

_LOAD_HZ = 15.0
"""Low pass of the forces: a foot lands within a few hundredths of a second."""


@dataclass(frozen=True, eq=False, repr=False)
class FoundContacts(Display):
    """The contacts found in a log.

    Attributes
    ----------
    log : Log
        With the flags of all contacts; its report names those that were found.
    certainty : mapping {link: float}
        The share of the samples in which the force of a foot is clearly that of a standing foot, or
        of one in the air.
    """

    log: Log
    certainty: Mapping[str, float]

    def _in_short(self) -> str:
        texts = (f"{link} {share:.1%} certain" for link, share in self.certainty.items())
        return ", ".join(texts)


@checked(IdentificationError)
def find_contacts(robot: Robot, log: Log) -> FoundContacts:
    """Return a log with the contacts of a legged robot, found from its torques and its motion.

    Use flags or force sensors if there are any: a foot that carries little is not seen.

    Parameters
    ----------
    robot : Robot
        With a floating base, contacts, and inertial parameters, which may be wrong by a fifth.
    log : Log
        With the torques of all joints; flags that it has stay.

    Returns
    -------
    FoundContacts

    Raises
    ------
    IdentificationError
        For a robot without contacts or without inertial parameters, and a log without torques.

    Examples
    --------
    >>> found = seaid.find_contacts(robot, log)
    >>> found.certainty
    >>> seaid.identify(robot, found.log)
    """
    base = robot.floating_base
    if base is None or not base.contacts:
        raise IdentificationError(
            "find_contacts needs a robot with a floating base and contacts=", "contacts="
        )
    if log.base is None or not np.all(np.isfinite(robot.parameters)):
        raise IdentificationError(
            "find_contacts needs the motion of the base in the log, and the inertial parameters of "
            "the robot file, also if they are not exact"
        )
    logged = log.base
    missing = logged.unflagged(base.contact_links)
    flying = dict.fromkeys(missing, np.zeros(len(log.time)))
    unloaded = replace(log, base=replace(logged, contacts={**logged.contacts, **flying}))
    loads = _loads(robot, unloaded)
    flags, certainty, report = dict(logged.contacts), {}, list(log.report)
    for link in missing:
        load = loads[:, base.contact_links.index(link)]
        flags[link] = _standing(load).astype(float)
        unclear = (load >= 0.5 * LOADED) & (load <= 1.5 * LOADED)
        certainty[link] = float(np.mean(~unclear))
        report.append(_as_repair(link, log.time, unclear))
    base_log = replace(logged, contacts=flags)
    return FoundContacts(replace(log, base=base_log, report=tuple(report)), certainty)


def _as_repair(link: str, time: Array, unclear: BoolArray) -> Repair:
    """Return what the report of a log has about a contact that was found."""
    first = float(time[np.argmax(unclear)])
    action = f"found from torques and motion, {np.mean(~unclear):.1%} of the samples are clear"
    return Repair(f"{link}.contact", FOUND_CONTACT, int(np.sum(unclear)), first, action)


def _loads(robot: Robot, log: Log) -> Array:
    """Return the part of the weight (T, k) that each contact carries at the times of the log."""
    motion = reconstruct_motion(robot, log)
    base = motion.base
    assert base is not None
    assert robot.floating_base is not None
    bodies = robot.parameters + robot.payload_parameters
    rows = floating_regressor(robot, *motion.joint_states, base.states) @ bodies
    ratio = np.array([robot.drives[joint].ratio for joint in robot.joint_names])
    torque = torques_at_joints(robot.transmission, motion.motor_torque * ratio)
    torque = np.where(np.isfinite(motion.joint_torque), motion.joint_torque, torque)
    if not np.all(np.isfinite(torque)):
        raise IdentificationError("find_contacts needs the torque of each joint in the log")
    rows[:, 6:] -= low_pass(torque, motion.rate_hz, min(_LOAD_HZ, 0.4 * motion.rate_hz))
    points = [replace(contact, is_flat=False) for contact in robot.floating_base.contacts]
    A = contact_map(robot, motion.joint_position, points, base.up)
    guided = ~robot.floating_base.free_axes
    rows[:, :6][:, guided] = A[:, :6][:, guided] = 0.0
    # All feet count as on the ground. Forces between two feet along their line act on nothing: the
    # small ridge makes them zero.
    normal = A.swapaxes(1, 2) @ A + 1e-9 * np.eye(A.shape[2])
    right = np.einsum("trk,tr->tk", A, rows)[:, :, None]
    forces = safely(
        np.linalg.solve, normal, right, what="the contact forces", error=IdentificationError
    )
    up = base.up
    if up is None:  # the mean specific force
        mean = base.specific_force.mean(axis=0)
        up = np.tile(mean / np.linalg.norm(mean), (len(forces), 1))
    support = np.einsum("tki,ti->tk", forces.reshape(len(forces), -1, 3), up)
    weight = bodies.reshape(-1, 10)[:, 0].sum() * np.linalg.norm(robot.model.gravity.linear)
    smooth = low_pass(support / weight, motion.rate_hz, min(_LOAD_HZ, 0.4 * motion.rate_hz))
    return np.column_stack([np.interp(log.time, motion.time, load) for load in smooth.T])


def _standing(load: Array) -> BoolArray:
    """Return whether a foot with this part (T,) of the weight stands, with hysteresis."""
    sure = np.where(load > LOADED, 1, np.where(load < FREE, 0, -1))
    last = np.maximum.accumulate(np.where(sure >= 0, np.arange(len(sure)), 0))
    # Between the limits a foot stays what it was; before the first clear sample it is in the air.
    return np.asarray(sure[last] == 1)


@checked(LogError)
def with_leg_order(guess: Description, robot: Robot, log: Log) -> Description:
    """Return an inferred description with the legs and flags in the order in which feet rest.

    Only where the joints were taken in the order of the columns: names count more than samples.

    Parameters
    ----------
    guess : Description
        As `describe_log` returns it.
    robot : Robot
        With a floating base and contacts.
    log : Log
        The log by this description.

    Returns
    -------
    Description
        The same without a floating base, without flags, or if no other order is clearly better.

    Examples
    --------
    >>> guess = seaid.describe_log("walk.npz", robot)
    >>> log = seaid.read_log("walk.npz", robot, description=guess.description)
    >>> guess = with_leg_order(guess, robot, log)
    """
    described, names = guess.description, robot.joint_names
    named = (
        meaning_of(str(source.column), names).joint == joint
        for joint, sources in described.joints.items()
        for source in sources.values()
    )
    if log.base is None or not log.base.contacts or any(named):
        return guess
    order = best_order(FeetInMotion(robot, reconstruct_motion(robot, log), [log]))
    if order is None or not set(names) <= set(described.joints):
        return guess
    joints = {
        joint: described.joints[names[j]] for joint, j in zip(names, order.joints, strict=True)
    }
    contacts = {x: described.contacts[order.contacts.get(x, x)] for x in described.contacts}
    first = [
        str(joints[x]["joint_position"].column) for x in names if "joint_position" in joints[x]
    ]
    text = (
        f"joints, contacts: in the order in which standing feet rest, with {order.speed:.2g} m/s "
        f"(rms), {order.speed_as_given:.2g} m/s in the order of the robot: {', '.join(names)} are "
        f"the columns {', '.join(first)}"
    )
    unsure = [doubt for doubt in guess.unsure if "beyond the limits of" not in doubt]
    return replace(
        guess,
        description=replace(described, joints=joints, contacts=contacts),
        unsure=(text, *unsure),
    )
