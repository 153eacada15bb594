"""Mistakes of the gauntlet about joints: springs, couplings, zeros; and sizes, torques, samples.

Each has the form of those in `scripts/gauntlet_mistakes.py`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin

from scripts.gauntlet_mistakes import (
    SCALE,
    TORQUE_WORDS,
    Case,
    Change,
    Mistake,
    Setup,
    both,
    channels_of,
    elastic_only,
    forms,
    in_logs,
    late,
    nonsense,
    payload,
    pushed,
    unchanged,
)
from scripts.gauntlet_robots import RATE_HZ, Columns, Subject, true_motion, true_robot
from seaid._arrays import Array
from seaid.drives import total_ratio


def absolute(case: Case, setup: Setup) -> Setup:
    """Give the angle of a joint against the base, not against the link before."""
    name, before = (f"{joint}.joint_position_rad" for joint in case.subject.turning)
    return in_logs(setup, lambda log: log | {name: log[name] + log[before]})


def lever(share: float) -> Change:
    """Let the gear ratio of the important joint vary by a share with the sine of its angle."""

    def change(case: Case, setup: Setup) -> Setup:
        name, joint = case.subject.name, case.subject.joint
        robot, motion = true_robot(name, "plain"), true_motion(name, "plain", 10 * case.seed)
        ratio = total_ratio(robot.drives[joint])
        index, rotor = robot.index(joint), robot.drives[joint].values["motor_inertia"]
        turned, speed, acceleration = (
            signal[:, index] / ratio
            for signal in (motion.motor_position, motion.motor_velocity, motion.motor_acceleration)
        )
        angle, torque = f"{joint}.motor_position_rad", f"{joint}.motor_torque_Nm"

        def varied(log: Columns) -> Columns:
            more, factor = ratio * share * (1 - np.cos(turned)), 1 + share * np.sin(turned)
            # The torque on the load is that over the factor, and the rotor turns as its motor.
            before, change = ratio * acceleration, np.cos(turned) * speed**2
            after = factor * before + ratio * share * change
            loaded = (log[torque] - rotor * before) / factor + rotor * after
            return log | {angle: log[angle] + more, torque: loaded}

        return in_logs(setup, varied)

    return change


def geared(every: bool) -> Change:
    """Multiply the joint encoders by their gear ratios, as if they were those of the motors."""

    def change(case: Case, setup: Setup) -> Setup:
        robot, joints = true_robot(case.subject.name, "plain"), _turning(case.subject)
        ratios = {
            f"{joint}.joint_position_rad": total_ratio(robot.drives[joint])
            for joint in (joints if every else [case.subject.joint])
        }
        return in_logs(setup, lambda log: log | {x: log[x] * ratio for x, ratio in ratios.items()})

    return change


def _turning(subject: Subject) -> list[str]:
    """Return the joints that turn."""
    robot = true_robot(subject.name, "plain")
    return [
        x for x, slides in zip(robot.joint_names, robot.is_prismatic, strict=True) if not slides
    ]


def resized(joints: float, bodies: float, mass: float, inertia: float) -> Change:
    """Multiply the places of joints, those of centres of mass, masses and inertias in the URDF."""

    def change(case: Case, setup: Setup) -> Setup:
        tree = ElementTree.fromstring(setup.urdf)
        for path, factor in (("joint/origin", joints), ("link/inertial/origin", bodies)):
            for origin in tree.findall(path):
                numbers = [factor * float(text) for text in origin.get("xyz", "0 0 0").split()]
                origin.set("xyz", " ".join(f"{number:.9g}" for number in numbers))
        for path, factor in (("link/inertial/mass", mass), ("link/inertial/inertia", inertia)):
            for element in tree.findall(path):
                for key, value in element.attrib.items():
                    element.set(key, f"{factor * float(value):.9g}")
        return replace(setup, urdf=ElementTree.tostring(tree, encoding="unicode"))

    return change


def moved_zeros(*angles: float) -> Change:
    """Add angles to the joint encoders of joints that turn, the last one first."""

    def change(case: Case, setup: Setup) -> Setup:
        pairs = zip(case.subject.turning, angles, strict=False)
        moved = {f"{joint}.joint_position_rad": angle for joint, angle in pairs}
        return in_logs(setup, lambda log: log | {x: log[x] + angle for x, angle in moved.items()})

    return change


def torques(change: Callable[[Array], Array], every: bool) -> Change:
    """Change the motor torques by a function of themselves."""

    def changed(case: Case, setup: Setup) -> Setup:
        joints = list(case.subject.drives) if every else [case.subject.joint]
        names = channels_of(setup.logs[0], joints, "motor_torque")
        return in_logs(setup, lambda log: log | {name: change(log[name]) for name in names})

    return changed


def of_rating(torque: Array) -> Array:
    """Return a torque in per cent of a rating, which is a round number above the largest torque."""
    return 100 * torque / float(f"{1.3 * np.quantile(np.abs(torque), 0.999):.1e}")


def like_friction(share: float) -> Change:
    """Replace the torque of the important joint, or a share of it, by the sign of its speed."""

    def change(case: Case, setup: Setup) -> Setup:
        joint = case.subject.joint

        def rubbing(log: Columns) -> Columns:
            (name,) = channels_of(log, [joint], "motor_torque")
            (angle,) = channels_of(log, [joint], "motor_position")
            speed = np.gradient(np.convolve(log[angle], np.ones(25) / 25, mode="same"))
            noise = 0.02 * np.random.default_rng(5).normal(size=len(speed))
            sign = np.std(log[name]) * (np.sign(speed) + noise)
            return log | {name: (1 - share) * log[name] + share * sign}

        return in_logs(setup, rubbing)

    return change


def lost(share: float, burst: int, counted: bool) -> Change:
    """Lose a share of the samples in bursts; a counter as time hides it."""

    def change(case: Case, setup: Setup) -> Setup:
        def without(log: Columns) -> Columns:
            time, rng = log["time_s"], np.random.default_rng(23)
            begins = rng.random(len(time)) < share / burst
            kept = np.convolve(begins, np.ones(burst))[: len(time)] < 0.5
            found = {name: values[kept] for name, values in log.items()}
            counter = np.arange(np.sum(kept)) / RATE_HZ
            return found | ({"time_s": counter} if counted else {})

        return in_logs(setup, without)

    return change


def wrapped(channel: str, every: bool) -> Change:
    """Let an encoder count within a turn, from zero."""

    def change(case: Case, setup: Setup) -> Setup:
        joints = _turning(case.subject) if every else [case.subject.turning[0]]
        names = channels_of(setup.logs[0], joints, channel)
        return in_logs(setup, lambda log: log | {x: log[x] % (2 * np.pi) for x in names})

    return change


def stop(share: float) -> Change:
    """Let a joint reach a stop that pushes back with up to a share of the largest load.

    It is at the position beyond which the joint is for a tenth of the time.
    """

    def change(case: Case, setup: Setup) -> Setup:
        name = case.subject.name
        robot, true = true_robot(name, "plain"), true_motion(name, "plain", 10 * case.seed)
        data, index = robot.model.createData(), robot.index(case.subject.joint)
        states = (true.joint_position, true.joint_velocity, true.joint_acceleration)
        load = [pin.rnea(robot.model, data, *state)[index] for state in zip(*states, strict=True)]
        beyond = np.maximum(states[0][:, index] - np.quantile(states[0][:, index], 0.9), 0)
        external = np.zeros_like(true.joint_position)
        external[:, index] = -share * np.max(np.abs(load)) * beyond / np.max(beyond)
        return in_logs(setup, lambda log: log | pushed(robot, log, external))

    return change


def last_torque(factor: float) -> Change:
    """Multiply the torque of the last joint."""

    def change(case: Case, setup: Setup) -> Setup:
        names = channels_of(setup.logs[0], [list(case.subject.drives)[-1]], "motor_torque")
        return in_logs(setup, lambda log: log | {name: factor * log[name] for name in names})

    return change


def farther(factor: float) -> Change:
    """Give the payload another lever."""

    def moved(subject: Subject) -> tuple[str, ...]:
        link, mass, place = subject.payload.split(":")
        numbers = ",".join(f"{factor * float(x):g}" for x in place.split(","))
        return (f"{link}:{mass}:{numbers}",)

    return payload(moved)


def rotated(case: Case, setup: Setup) -> Setup:
    """Give the last three joints the torques of the joint before each, in a circle."""
    joints = list(case.subject.drives)[-3:]
    names = [x for one in joints for x in channels_of(setup.logs[0], [one], "motor_torque")]
    order = [*names[1:], names[0]]
    return in_logs(setup, lambda log: log | {x: log[y] for x, y in zip(names, order, strict=True)})


def _of_joints() -> list[Mistake]:
    """Return springs, couplings and zeros that the files do not have."""
    spring, term, zero = ("spring",), {"missing-term"}, {"encoder-offset"}
    coupled, words = {"coupled-joints"}, ("several joints", "coupled", "moves with")
    gear, offset = ("gear", "ratio", "unit"), ("zero", "offset")
    quarter = np.pi / 2
    return [
        *forms("parallel spring not declared", term, spring,
                  (unchanged, "parallel100"), (unchanged, "parallel30")),
        *forms("parallel spring with preload not declared", term, spring,
                  (unchanged, "preload100"), (unchanged, "preload30")),
        *forms("constant parallel torque not declared", {*term, "torque-offset"}, spring,
                  (unchanged, "constant100"), (unchanged, "constant30")),
        *forms("tendon not declared", coupled, words,
                  (unchanged, "tendon50"), (unchanged, "tendon15")),
        *forms("differential not declared", coupled, words, (unchanged, "differential"), None),
        *forms("absolute joint angles", coupled, words, absolute, None, repairable=False),
        *forms("ratio varies by 30 or 10 %", {"varying-ratio"}, gear,
                  lever(0.3), lever(0.1), repairable=False),
        *forms("joint encoder multiplied by its gear", {"gear-ratio", "unit"}, gear,
                  geared(True), geared(False)),
        *forms("zero of a joint off by 0.2 or 0.15 rad", zero, offset,
                  moved_zeros(0.2), moved_zeros(0.15)),
        *forms("zeros of two joints off by 0.15 and 0.2 rad", zero, offset,
                  moved_zeros(0.15, -0.2), None),
        *forms("zeros of two joints off by 90 deg", zero, offset,
                  moved_zeros(quarter, -quarter), None),
        *forms("spring with damping", {"nonlinear-spring"}, spring,
                  (elastic_only, "damping20"), (elastic_only, "damping5")),
        *forms("spring with hysteresis", {"nonlinear-spring", "loose-encoder"}, spring,
                  (elastic_only, "hysteresis20"), (elastic_only, "hysteresis5")),
        *forms("stop reached", {"contact"}, ("contact", "stop"), stop(1.0), stop(0.3)),
    ]  # fmt: skip


def _of_files() -> list[Mistake]:
    """Return robots of another size, and payloads with another lever."""
    sizes, words = {"geometry", "nominal-values"}, ("mm", "metre", "length", "size", "unit")
    return [
        *forms("robot file in mm", sizes, words, resized(1e3, 1e3, 1.0, 1e6),
                  resized(1e3, 1.0, 1.0, 1.0), repairable=False),
        *forms("robot file of a size 30 or 10 % larger", sizes, words,
                  resized(1.3, 1.3, 1.3**3, 1.3**5), resized(1.1, 1.1, 1.1**3, 1.1**5),
                  repairable=False),
        *forms("all masses 25 % too heavy, or 20 % too light", {"nominal-values"}, (),
                  nonsense(1.25), nonsense(0.8), harmless=True, repairable=False),
        *forms("payload with twice its lever, or 1.3 times", {"payload"}, ("payload",),
                  farther(2.0), farther(1.3), by_masses=True),
    ]  # fmt: skip


def _of_logs() -> list[Mistake]:
    """Return torques that are none, or of another joint, and samples that are lost."""
    none, hole = {"no-measurement"}, ("lost", "gap", "missing", "holes")
    return [
        *forms("torques without sign", none, TORQUE_WORDS,
                  torques(np.abs, True), torques(np.abs, False), repairable=False),
        *forms("torques in per cent of a rating", SCALE, TORQUE_WORDS,
                  torques(of_rating, True), torques(of_rating, False), by_masses=True),
        *forms("torque like friction", {*none, "no-fit"}, TORQUE_WORDS,
                  like_friction(1.0), like_friction(0.5), repairable=False),
        *forms("torque of the last joint times 1.35 or 1.15", SCALE, TORQUE_WORDS,
                  last_torque(1.35), last_torque(1.15), by_masses=True),
        *forms("torques late by 1 ms", {"delay"}, ("late", "delay"), late(1e-3), None),
        *forms("torques of three joints rotated", {"swapped-joints"}, ("exchanged",),
                  rotated, None),
        *forms("packets lost, counter as time", {"holes"}, hole,
                  lost(0.15, 1, True), lost(0.03, 1, True), repairable=False),
        *forms("bursts lost, counter as time, or its own", {"holes"}, hole,
                  lost(0.15, 150, True), lost(0.15, 150, False), repairable=False),
        *forms("motor encoders within a turn, or joint encoder", {"wraps"}, ("wrap", "turn"),
                  wrapped("motor_position", True), wrapped("joint_position", False)),
        *forms("two: zero off by 0.2 rad, last torque times 1.35",
                  {*SCALE, "encoder-offset"}, (), both(moved_zeros(0.2), last_torque(1.35)), None,
                  by_masses=True),
    ]  # fmt: skip


def joint_mistakes() -> tuple[Mistake, ...]:
    """Return the mistakes of this module in their forms."""
    return (*_of_joints(), *_of_files(), *_of_logs())
