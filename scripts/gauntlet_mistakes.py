"""The mistakes of the gauntlet: what each changes in a right set-up, and the codes that name it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from scripts.gauntlet_robots import (
    RATE_HZ,
    Columns,
    Sensors,
    Subject,
    columns,
    deflection,
    heavier,
    nominal_drives,
    nominal_urdf,
    true_drives,
    true_motion,
    true_payload,
    true_robot,
)
from seaid._arrays import Array

HELD_OUT = 99
"""The motion on which predictions are judged."""


@dataclass(frozen=True)
class Setup:
    """What a user hands over: files, logs and options.

    `description` is the content of the TOML next to each log, `options` those of `identify`, and
    `base` those of a floating base.
    """

    urdf: str
    drives: Mapping[str, Mapping[str, Any]] | None
    payloads: tuple[str, ...]
    logs: tuple[Columns, ...]
    descriptions: tuple[Mapping[str, Any], ...]
    gravity: tuple[float, ...] = (0.0, 0.0, -9.81)
    repair: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    base: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """A robot and a seed, from which all set-ups of it follow."""

    subject: Subject
    seed: int = 0

    def setup(self, truth: str = "plain", logs: int = 1, *, terms: bool = False) -> Setup:
        """Return the right set-up of a true robot: nominal values of the files are not the true.

        With `terms` the drives have the true terms, for robots that are not as linear as the
        user's drives are.
        """
        rng = np.random.default_rng((self.seed, 3))
        sensors = Sensors(seed=self.seed)
        drives = true_drives(self.subject, truth) if terms else self.subject.drives
        return Setup(
            urdf=nominal_urdf(self.subject.urdf, rng),
            drives=nominal_drives(drives, rng),
            payloads=true_payload(self.subject, truth),
            logs=tuple(
                columns(self.subject.name, truth, 10 * self.seed + number, sensors)
                for number in range(logs)
            ),
            descriptions=({},) * logs,
            base=self.subject.base,
        )


Change = Callable[[Case, Setup], Setup | None]
Form = Literal["severe", "mild"]


@dataclass(frozen=True)
class Mistake:
    """A mistake in one form.

    Attributes
    ----------
    name, form : str
        Its name, and how bad it is.
    codes : set of str
        The codes of findings that name it rightly.
    words : tuple of str
        A refusal names it if one of these is in its text.
    change : callable
        Makes the wrong set-up of a right one; None if the robot cannot have this mistake.
    truth, logs : str, int
        The true robot and motion, and the number of logs.
    repairable : bool
        Whether a description, a drives file or an option can repair it.
    harmless : bool
        The result is right all the same, so that nothing else than `codes` may be flagged.
    by_masses : bool
        What repairs it is a value that only nominal masses of the robot file give.
    of_quadruped : bool
        It is made at the quadruped, and no other one is.
    """

    name: str
    form: Form
    codes: frozenset[str]
    words: tuple[str, ...]
    change: Change
    truth: str = "plain"
    logs: int = 1
    repairable: bool = True
    harmless: bool = False
    by_masses: bool = False
    of_quadruped: bool = False

    @property
    def title(self) -> str:
        """Name and form."""
        return f"{self.name} ({self.form})"


def in_logs(setup: Setup, change: Callable[[Columns], Columns]) -> Setup:
    """Return the set-up with a change of each log."""
    return replace(setup, logs=tuple(change(dict(log)) for log in setup.logs))


def channels_of(log: Columns, joints: list[str], channel: str) -> list[str]:
    """Return the columns of joints whose name contains a channel, as 'motor_torque'."""
    return [one for one in log if one.split(".")[0] in joints and f".{channel}" in one]


def scaled(channel: str, factor: float, every: bool, turning: bool = True) -> Change:
    """Multiply a channel, at every joint or at the important one only."""

    def change(case: Case, setup: Setup) -> Setup | None:
        joints = list(case.subject.drives) if every else [case.subject.joint]
        named = channels_of(setup.logs[0], joints, channel)
        found = [one for one in named if not (turning and one.endswith("_m"))]
        return in_logs(setup, lambda log: log | {one: factor * log[one] for one in found})

    return change


def clock(factor: float) -> Change:
    """Multiply the time."""
    return lambda case, setup: in_logs(setup, lambda log: log | {"time_s": factor * log["time_s"]})


def coarse_clock(step_s: float) -> Change:
    """Write the time as seconds since 1970 with few digits."""

    def change(case: Case, setup: Setup) -> Setup:
        def coarse(log: Columns) -> Columns:
            return log | {"time_s": np.round((1.7e9 + log["time_s"]) / step_s) * step_s}

        return in_logs(setup, coarse)

    return change


def swapped(channels: tuple[str, ...], minor: bool) -> Change:
    """Exchange channels of two joints of one kind."""

    def change(case: Case, setup: Setup) -> Setup | None:
        one, other = case.subject.minor_pair if minor else case.subject.pair
        names = {
            a: a.replace(one, other, 1)
            for channel in channels
            for a in channels_of(setup.logs[0], [one], channel)
        }
        if any(b not in setup.logs[0] for b in names.values()):  # a turning and a sliding joint
            return None
        names |= {b: a for a, b in names.items()}
        return in_logs(setup, lambda log: {name: log[names.get(name, name)] for name in log})

    return change


_ALL: tuple[str, ...] = ("motor_position", "joint_position", "motor_torque")


def flipped(channels: tuple[str, ...], minor: bool) -> Change:
    """Reverse the sign of channels of a joint."""

    def change(case: Case, setup: Setup) -> Setup:
        joint = case.subject.minor if minor else case.subject.joint
        found = [one for c in channels for one in channels_of(setup.logs[0], [joint], c)]
        return in_logs(setup, lambda log: log | {name: -log[name] for name in found})

    return change


def drive_value(key: str, factor: float) -> Change:
    """Multiply a value in the drive of the important joint, where it counts as known."""

    def change(case: Case, setup: Setup) -> Setup:
        assert setup.drives is not None
        drives = {joint: dict(table) for joint, table in setup.drives.items()}
        table = drives[case.subject.joint]
        name = next(one for one in table if one.startswith(key))
        table[name] = factor * table[name]
        return replace(setup, drives=drives)

    return change


def without_drives(every: bool) -> Change:
    """Load the robot without its drives, or without the drive of the important joint."""

    def change(case: Case, setup: Setup) -> Setup:
        kept = {} if every else dict(setup.drives or {})
        kept.pop(case.subject.joint, None)
        return replace(setup, drives=kept or None)

    return change


def payload(change_of: Callable[[Subject], tuple[str, ...]]) -> Change:
    """Name other payloads than the true one."""
    return lambda case, setup: replace(setup, payloads=change_of(case.subject))


def _displaced(subject: Subject) -> tuple[str, ...]:
    """Return the payload 8 cm from its place."""
    link, mass, place = subject.payload.split(":")
    x, y, z = map(float, place.split(","))
    return (f"{link}:{mass}:{x - 0.08:g},{y:g},{z:g}",)


def gravity(*vector: float) -> Change:
    """Give another gravity."""
    return lambda case, setup: replace(setup, gravity=vector)


def tilted(degrees: float) -> Change:
    """Give the gravity of a level base to a robot on a tilted one: here the other way round."""
    angle = np.deg2rad(degrees)
    return gravity(9.81 * float(np.sin(angle)), 0.0, -9.81 * float(np.cos(angle)))


def _torques(change: Callable[[Array, Array], Array], every: bool = False) -> Change:
    """Change the motor torques by a function of time and torque."""

    def whole(case: Case, setup: Setup) -> Setup:
        joints = list(case.subject.drives) if every else [case.subject.joint]

        def of_log(log: Columns) -> Columns:
            found = channels_of(log, joints, "motor_torque")
            return log | {name: change(log["time_s"], log[name]) for name in found}

        return in_logs(setup, of_log)

    return whole


def late(seconds: float) -> Change:
    """Delay all torques."""
    return _torques(lambda time, torque: np.interp(time - seconds, time, torque), every=True)


def offset(share: float) -> Change:
    """Add a constant, a share of the torque's standard deviation."""
    return _torques(lambda time, torque: torque + share * np.std(torque))


def drift(share: float) -> Change:
    """Add a slow AR(1) process (2 s) whose standard deviation is a share of the torque's."""

    def drifting(time: Array, torque: Array) -> Array:
        decay = np.exp(-float(np.median(np.diff(time))) / 2.0)
        white = np.random.default_rng(5).normal(size=len(torque))
        state, found = 0.0, np.empty(len(torque))
        for place, kick in enumerate(white * np.sqrt(1 - decay**2)):
            found[place] = state = decay * state + kick
        return torque + share * np.std(torque) * found

    return _torques(drifting)


def clipped(share: float) -> Change:
    """Clip the logged torque at a share of its peak.

    The peak is that of 99.9 % of the samples: the simulated logs begin with a sample of up to seven
    times the largest torque after it, and half of that clips nothing else.
    """

    def limited(time: Array, torque: Array) -> Array:
        most = share * np.quantile(np.abs(torque), 0.999)
        return np.clip(torque, -most, most)

    return _torques(limited)


def contact(share: float) -> Change:
    """Press on the last body for a second, with joint torques up to a share of those of the load.

    The joints keep their motion: springs and motor torques change as (4b), (7) and (8) demand.
    """

    def change(case: Case, setup: Setup) -> Setup:
        name, motion = case.subject.name, 10 * case.seed
        robot, true = true_robot(name, "plain"), true_motion(name, "plain", motion)
        data, load = robot.model.createData(), np.zeros_like(true.joint_position)
        external = np.zeros_like(load)
        bump = np.where(np.abs(true.time - 4.0) < 0.5, np.cos(np.pi * (true.time - 4.0)) ** 2, 0.0)
        states = (true.joint_position, true.joint_velocity, true.joint_acceleration)
        for row, state in enumerate(zip(*states, strict=True)):
            load[row] = pin.rnea(robot.model, data, *state)
            if bump[row]:
                pin.computeJointJacobians(robot.model, data, state[0])
                jacobian = pin.getJointJacobian(
                    robot.model, data, robot.n, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
                )
                external[row] = jacobian[:3].T @ (bump[row] * np.array([0.6, 0.6, 0.5]))
        spread = np.std(load, axis=0)
        external *= share / np.max(np.abs(external) / spread)
        return in_logs(setup, lambda log: log | pushed(robot, log, external))

    return change


def pushed(robot: Any, log: Columns, external: Array) -> Columns:
    """Return the changed channels for torques (T, n) that act on the joints from outside."""
    found = {}
    for index, joint in enumerate(robot.joint_names):
        drive, torque = robot.drives[joint], f"{joint}.motor_torque_Nm"
        force = -external[:, index] / drive.load_radius
        more = drive.motor_radius / drive.ratio * force
        if drive.is_elastic:
            angle = f"{joint}.motor_position_rad"
            turn = drive.ratio / drive.motor_radius * force / drive.values["stiffness"]
            speed = np.gradient(turn, 1 / RATE_HZ)
            found[angle] = log[angle] + turn
            more = more + drive.values["motor_inertia"] * np.gradient(speed, 1 / RATE_HZ)
            more = more + drive.values["viscous_friction"] * speed
        found[torque] = log[torque] + more
    return found


def _peak_deflection(name: str, joint: str) -> float:
    """Return the peak deflection of a spring in a true motion."""
    return float(
        np.ptp(deflection(true_robot(name, "plain"), true_motion(name, "plain", 0), joint))
    )


def moved_encoders(share: float) -> Change:
    """Move the encoders of the second log, as a new power-up does."""

    def change(case: Case, setup: Setup) -> Setup:
        subject, (first, *others) = case.subject, setup.logs
        robot = true_robot(subject.name, "plain")
        found = []
        for log in others:
            changed = dict(log)
            for joint in subject.elastic or [subject.joint]:
                drive = robot.drives[joint]
                if drive.is_elastic:
                    peak = _peak_deflection(subject.name, joint)
                    name = f"{joint}.motor_position_rad"
                    size = drive.ratio / drive.motor_radius * peak
                else:
                    name, size = f"{joint}.joint_position_rad", 0.3
                changed[name] = changed[name] + share * size
            found.append(changed)
        return replace(setup, logs=(first, *found))

    return change


def shortened(seconds: float) -> Change:
    """Keep so many seconds from the middle."""

    def cut(log: Columns) -> Columns:
        kept = np.abs(log["time_s"] - 4.0) < seconds / 2
        return {name: values[kept] for name, values in log.items()}

    return lambda case, setup: in_logs(setup, cut)


def loose_encoder(share: float) -> Change:
    """Give the joint encoder play: it follows when the joint has passed it (backlash)."""

    def change(case: Case, setup: Setup) -> Setup:
        robot = true_robot(case.subject.name, "plain")
        drive, joint = robot.drives[case.subject.joint], case.subject.joint
        half = share * 0.02
        if drive.is_elastic:
            half = share * _peak_deflection(case.subject.name, joint) / drive.load_radius

        def loose(log: Columns) -> Columns:
            (name,) = channels_of(log, [joint], "joint_position")
            found, at = np.array(log[name]), log[name][0]
            for row, value in enumerate(log[name]):
                at = found[row] = min(max(at, value - half), value + half)
            return log | {name: found}

        return in_logs(setup, loose)

    return change


def longer_link(factor: float) -> Change:
    """Make a link of the URDF longer than it is."""

    def change(case: Case, setup: Setup) -> Setup:
        tree = ElementTree.fromstring(setup.urdf)
        (origin,) = tree.findall(f"joint[@name='{case.subject.length}']/origin")
        numbers = [factor * float(text) for text in origin.get("xyz", "0 0 0").split()]
        origin.set("xyz", " ".join(f"{number:.9g}" for number in numbers))
        return replace(setup, urdf=ElementTree.tostring(tree, encoding="unicode"))

    return change


def wrong_description(unit: str, channel: str, every: bool) -> Change:
    """Describe columns in SI units as if they had another unit."""

    def change(case: Case, setup: Setup) -> Setup:
        log, joints = setup.logs[0], list(case.subject.drives) if every else [case.subject.joint]
        tables: dict[str, dict[str, Any]] = {}
        for joint in joints:
            (name,) = channels_of(log, [joint], channel)
            if not (unit == "deg" and name.endswith("_m")):
                tables[joint] = {channel: {"column": name, "unit": unit}}
        return replace(setup, descriptions=({"joints": tables},) * len(setup.logs))

    return change


def nonsense(factor: float) -> Change:
    """Multiply the nominal masses and inertias of the URDF."""

    def change(case: Case, setup: Setup) -> Setup:
        tree = ElementTree.fromstring(setup.urdf)
        for body in tree.iter("inertial"):
            for element in (*body.findall("mass"), *body.findall("inertia")):
                for key, value in element.attrib.items():
                    element.set(key, f"{factor * float(value):.9g}")
        return replace(setup, urdf=ElementTree.tostring(tree, encoding="unicode"))

    return change


def noise_only(every: bool) -> Change:
    """Replace all channels, or the torque of the important joint, by white noise of their size."""

    def change(case: Case, setup: Setup) -> Setup:
        def noise(log: Columns) -> Columns:
            rng = np.random.default_rng(11)
            names = [one for one in log if one != "time_s"]
            if not every:
                names = channels_of(log, [case.subject.joint], "motor_torque")
            return log | {one: np.std(log[one]) * rng.normal(size=len(log[one])) for one in names}

        return in_logs(setup, noise)

    return change


def both(*changes: Change) -> Change:
    """Make several mistakes at once."""

    def change(case: Case, setup: Setup) -> Setup | None:
        found: Setup | None = setup
        for one in changes:
            found = None if found is None else one(case, found)
        return found

    return change


def unchanged(case: Case, setup: Setup) -> Setup:
    """Return the set-up: the mistake is in the true robot or in its motion."""
    return setup


def elastic_only(case: Case, setup: Setup) -> Setup | None:
    """Return the set-up of a robot with springs."""
    return setup if case.subject.elastic else None


_UNIT, SCALE, _TIME = {"unit"}, {"unit", "torque-scale"}, {"time-unit"}
_FEW = {"few-rows", "poorly-identified", "unidentifiable", "standstill", "no-fit", "weak-spring"}
_LOOSE = {
    "loose-encoder",
    "backlash",
    "transmission-error",
    "nonlinear-spring",
    "blocks-disagree",
    "gear-compliance",
}
TORQUE_WORDS = ("torque", "unit")
_MOVE_WORDS = ("move", "moves", "excite", "excited", "still", "short", "samples", "motion")


def forms(
    name: str, codes: set[str], words: tuple[str, ...], severe: Any, mild: Any, **more: Any
) -> list[Mistake]:
    """Return the severe and the mild form of a mistake; `severe` may be (change, truth)."""
    found = []
    for form, given in (("severe", severe), ("mild", mild)):
        if given is None:
            continue
        change, truth = given if isinstance(given, tuple) else (given, "plain")
        kind: Any = form
        found.append(Mistake(name, kind, frozenset(codes), words, change, truth, **more))
    return found


def _units() -> list[Mistake]:
    """Return mistakes of units and of the clock."""
    joint, motor, torque = "joint_position", "motor_position", "motor_torque"
    degree, turn, kt = 180 / np.pi, 1 / (2 * np.pi), 1 / 0.05
    words = ("unit", "degrees", "deg")
    return [
        *forms("joint positions in degrees", _UNIT, words,
               scaled(joint, degree, True), scaled(joint, degree, False, False)),
        *forms("motor positions in turns", _UNIT, words,
               scaled(motor, turn, True), scaled(motor, turn, False)),
        *forms("steps of an encoder counted twice, or half", {*_UNIT, "gear-ratio"}, words,
               scaled(joint, 2.0, False, False), scaled(motor, 0.5, False, False)),
        *forms("torques in mN m", _UNIT, TORQUE_WORDS,
               scaled(torque, 1e3, True), scaled(torque, 1e3, False)),
        *forms("currents in mA as torques", SCALE, TORQUE_WORDS,
               scaled(torque, 1e3 * kt, True), scaled(torque, kt, False), by_masses=True),
        *forms("torques in kN m", _UNIT, TORQUE_WORDS,
               scaled(torque, 1e-3, True), scaled(torque, 1e-3, False)),
        *forms("time in ms, or twice too fast", _TIME, ("time",), clock(1e3), clock(0.5)),
        *forms("time in ns, or in us", _TIME, ("time",), clock(1e9), clock(1e6)),
        *forms("epoch with few digits", {*_TIME, "holes"}, ("time",),
               coarse_clock(0.1), coarse_clock(0.01)),
        *forms("wrong unit in the description: deg", _UNIT, words,
               wrong_description("deg", joint, True), wrong_description("deg", motor, False)),
        *forms("wrong unit in the description: mNm", _UNIT, TORQUE_WORDS,
               wrong_description("mNm", torque, True), wrong_description("mNm", torque, False)),
    ]  # fmt: skip


def _channels() -> list[Mistake]:
    """Return exchanged and reversed channels."""
    found: list[Mistake] = []
    words = ("exchanged", "swapped", "swap", "sign", "opposite")
    exchanged = {"all channels": _ALL, "joint encoders": _ALL[1:2], "torques": _ALL[2:]}
    for name, channels in exchanged.items():
        changes = [swapped(channels, minor) for minor in (False, True)]
        found += forms(f"joints exchanged: {name}", {"swapped-joints"}, words, *changes)
    reversed_ones = {"motor encoder": _ALL[:1], "joint encoder": _ALL[1:2], "torque": _ALL[2:]}
    reversed_ones |= {"whole joint": _ALL, "motor (gear)": (_ALL[0], _ALL[2])}
    for name, channels in reversed_ones.items():
        codes = {"sign", "gear-ratio"} if "gear" in name else {"sign"}
        changes = [flipped(channels, minor) for minor in (False, True)]
        found += forms(f"sign reversed: {name}", codes, words, *changes)
    return found


def _files() -> list[Mistake]:
    """Return mistakes in the robot's files and options."""
    load, geometry = {"payload"}, {"geometry"}
    return [
        *forms("gear ratio halved, or 10 % off", {"gear-ratio"}, ("gear", "ratio"),
               drive_value("gear_ratio", 0.5), drive_value("gear_ratio", 0.9)),
        *forms("payload named that is not there", load, ("payload",),
               (payload(lambda one: (one.payload,)), "bare"),
               (payload(lambda one: (heavier(one.payload, 0.25),)), "bare")),
        *forms("payload not named", load, ("payload",),
               payload(lambda one: ()), (payload(lambda one: ()), "light"), by_masses=True),
        *forms("payload doubled, or 20 % heavier", load, ("payload",),
               payload(lambda one: (heavier(one.payload, 2.0),)),
               payload(lambda one: (heavier(one.payload, 1.2),)), by_masses=True),
        *forms("payload on the wrong link, or 8 cm off", load, ("payload",),
               payload(lambda one: (one.misplaced,)), payload(_displaced), by_masses=True),
        *forms("gravity along x, or base tilted by 30 deg", {"gravity"}, ("gravity",),
               gravity(9.81, 0.0, 0.0), tilted(30.0)),
        *forms("base tilted by 20 deg, or 5 deg", {"gravity"}, ("gravity",),
               tilted(20.0), tilted(5.0), by_masses=True),
        *forms("no drives, or one missing", {"missing-drives"}, ("drive", "drives"),
               without_drives(True), without_drives(False)),
        *forms("rotor inertia times 10, or 2", {"rotor-inertia"}, ("inertia",),
               drive_value("motor_inertia", 10.0), drive_value("motor_inertia", 2.0)),
        *forms("link 20 % longer, or 5 %", geometry, ("length",),
               longer_link(1.2), longer_link(1.05), repairable=False),
    ]  # fmt: skip


def _physics() -> list[Mistake]:
    """Return what the model lacks, and faults of sensors."""
    late_ms = {"delay"}
    return [
        *forms("torque late by 20 ms, or 1 ms", late_ms, ("late", "delay"), late(0.02), late(1e-3)),
        *forms("torque late by 5 ms", late_ms, ("late", "delay"), late(5e-3), None),
        *forms("torque constant off by 20 %, or 5 %", SCALE, TORQUE_WORDS,
               scaled(_ALL[2], 1.2, False), scaled(_ALL[2], 1.05, False), by_masses=True),
        *forms("torque offset of 10 %, or 2 %", {"torque-offset", "missing-term"}, ("offset",),
               offset(0.1), offset(0.02)),
        *forms("drift of 10 %, or 3 %", {"drift", "blocks-disagree"}, ("drift",),
               drift(0.1), drift(0.03), repairable=False),
        *forms("cubic spring, 20 or 5 %", {"nonlinear-spring"}, ("spring",),
               (elastic_only, "cubic20"), (elastic_only, "cubic5")),
        *forms("dead zone of 20 or 5 %", {"nonlinear-spring"}, ("spring",),
               (elastic_only, "dead20"), (elastic_only, "dead5")),
        *forms("Stribeck friction of 100 or 30 %", {"missing-term"}, ("friction",),
               (unchanged, "stribeck100"), (unchanged, "stribeck30")),
        *forms("contact for a second", {"contact"}, ("contact",), contact(1.0), contact(0.2)),
        *forms("other encoder offsets in the second log", {"encoder-offsets-differ"}, ("offset",),
               moved_encoders(0.3), moved_encoders(0.05), logs=2),
        *forms("robot hardly moving", _FEW, _MOVE_WORDS,
               (unchanged, "still"), (unchanged, "slow"), repairable=False),
        *forms("a second of data, or two", _FEW, _MOVE_WORDS,
               shortened(1.0), shortened(2.0), repairable=False),
        *forms("torque saturated at 50 or 80 %", {"saturation"}, ("limit", "saturated", "clipped"),
               clipped(0.5), clipped(0.8), repairable=False),
        *forms("loose encoder", _LOOSE, ("play", "backlash"),
               loose_encoder(0.2), loose_encoder(0.05), repairable=False),
    ]  # fmt: skip


def _bad_input() -> list[Mistake]:
    """Return nonsense, and two mistakes at once."""
    noise = {*_FEW, "homogeneous", "saturation", "sign", "gear-ratio", "unit", "swapped-joints"}
    two = both(scaled("motor_torque", 1e3, True), swapped(_ALL[1:2], False))
    return [
        *forms("nothing but noise", noise, (*_MOVE_WORDS, "noise"),
               noise_only(True), noise_only(False), repairable=False),
        *forms("two: mN m, and joint encoders exchanged", {*_UNIT, "swapped-joints"}, (),
               two, None),
        *forms("two: joint encoder reversed, torque late by 20 ms", {"sign", "delay"}, (),
               both(flipped(_ALL[1:2], False), late(0.02)), None),
        *forms("two: gear ratio halved, payload doubled", {"gear-ratio", "payload"}, (),
               both(drive_value("gear_ratio", 0.5),
                    payload(lambda one: (heavier(one.payload, 2.0),))), None, by_masses=True),
        *forms("nominal masses times 100, or zero", {"nominal-values"}, (),
               nonsense(100.0), nonsense(0.0), harmless=True, repairable=False),
    ]  # fmt: skip


def mistakes() -> tuple[Mistake, ...]:
    """Return all mistakes in their forms."""
    return (*_units(), *_channels(), *_files(), *_physics(), *_bad_input())
