"""Remedies are applied as they are printed to the files of a user, which then read again."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import savgol_filter

import seaid
from scripts import gauntlet
from scripts.gauntlet_mistakes import Setup
from scripts.gauntlet_robots import Columns, load
from tests.representatives import quick_only

JOINTS = ("shoulder", "elbow", "wrist")
RATIO, ROTOR, VISCOUS, COULOMB, RATE_HZ = 50.0, 3e-4, 2e-4, 0.01, 250.0
DRIVE = {"type": "stiff", "gear_ratio": RATIO, "motor_inertia_kg_m2": ROTOR}
DRIVES = dict.fromkeys(JOINTS, DRIVE)


@cache
def urdf() -> str:
    """Return an arm with three joints across each other."""
    axes, masses, text, parent = ("0 1 0", "1 0 0", "0 1 0"), (4.0, 2.5, 1.2), "", "base"
    for joint, axis, mass in zip(JOINTS, axes, masses, strict=True):
        text += (
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{joint}_link"/><origin xyz="0.05 0 0.3"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" effort="500" velocity="50"/></joint>'
            f'<link name="{joint}_link"><inertial><origin xyz="0.06 0.03 0.15"/>'
            f'<mass value="{mass}"/><inertia ixx="{0.02 * mass}" ixy="0" ixz="0" '
            f'iyy="{0.018 * mass}" iyz="0" izz="{0.006 * mass}"/></inertial></link>'
        )
        parent = f"{joint}_link"
    return f'<robot name="arm"><link name="base"/>{text}</robot>'


@cache
def signals() -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return {joint: (position, motor torque, torque on the load)} of a motion with noise."""
    robot, rng = load(urdf(), DRIVES), np.random.default_rng(3)
    t = np.arange(0.0, 8.0, 1 / RATE_HZ)
    sizes, phases = rng.uniform(0.1, 0.35, (2, 4, 3))[0], rng.uniform(0, 6, (4, 3))
    w = 2 * np.pi * np.array([0.25, 0.5, 0.875, 1.25])[:, None]
    angle = w[:, None] * t[:, None] + phases[:, None]
    q = 0.4 + np.einsum("kj,ktj->tj", sizes, np.sin(angle))
    v = np.einsum("kj,ktj->tj", sizes * w, np.cos(angle))
    a = -np.einsum("kj,ktj->tj", sizes * w**2, np.sin(angle))
    data = robot.model.createData()
    loads = [pin.rnea(robot.model, data, *x).copy() for x in zip(q, v, a, strict=True)]
    friction = VISCOUS * RATIO * v + COULOMB * np.sign(v)
    torque = np.array(loads) / RATIO + ROTOR * RATIO * a + friction
    torque += 0.002 * rng.normal(size=q.shape)
    q = q + 1e-5 * rng.normal(size=q.shape)
    sensed = np.array(loads) + 0.02 * rng.normal(size=q.shape)
    return {joint: (q[:, j], torque[:, j], sensed[:, j]) for j, joint in enumerate(JOINTS)} | {
        "": (t, t, t)
    }


def log(position: str, ratio: float = 1.0, torque: str = "motor_torque_Nm") -> Columns:
    """Return the columns of a log with a position, at one side, and a torque of each joint."""
    found = {"time_s": signals()[""][0]}
    for joint in JOINTS:
        q, t, _ = signals()[joint]
        found |= {f"{joint}.{position}": ratio * q, f"{joint}.{torque}": t}
    return found


def both_torques() -> Columns:
    """Return the columns of a log that also has a torque sensor behind the gear of each joint."""
    sensed = {f"{joint}.joint_torque_Nm": signals()[joint][2] for joint in JOINTS}
    return log("joint_position_rad") | log("motor_position_rad", RATIO) | sensed


CUSTOM = {
    "joints": {
        joint: {
            "joint_position": {"column": f"{joint}.q", "unit": "deg"},
            "motor_torque": {"column": f"{joint}.i", "scale": 0.5},
        }
        for joint in JOINTS
    }
}

LOGS: dict[str, Callable[[], tuple[Columns, Mapping[str, object]]]] = {
    "joint positions": lambda: (log("joint_position_rad"), {}),
    "motor positions": lambda: (log("motor_position_rad", RATIO), {}),
    "short names": lambda: (log("position_rad"), {}),
    "both positions": lambda: (log("joint_position_rad") | log("motor_position_rad", RATIO), {}),
    "both torques": lambda: (both_torques(), {}),
    "custom columns": lambda: (
        {
            name: 2 * x if name.endswith(".i") else x
            for name, x in log("q", 180 / np.pi, "i").items()
        },
        CUSTOM,
    ),
}
"""{kind of log: its columns, and the description by which it is read}"""


def times(columns: Columns, factors: Mapping[str, float]) -> Columns:
    """Return columns multiplied by the factor of the text in their name."""
    found = dict(columns)
    for text, factor in factors.items():
        found |= {name: factor * x for name, x in columns.items() if text in name}
    return found


def exchanged(columns: Columns) -> Columns:
    """Return columns of which those of the shoulder and of the wrist are exchanged."""
    names = {"shoulder": "wrist", "wrist": "shoulder"}
    found = {}
    for name, values in columns.items():
        joint, dot, quantity = name.partition(".")
        found[names.get(joint, joint) + dot + quantity] = values
    return found


POSITIONS, TORQUES = ("position", ".q"), ("torque", ".i")
Change = Callable[[Setup], Setup]


def columns_of(change: Callable[[Columns], Columns]) -> Change:
    """Return a mistake in the columns of the log."""
    return lambda setup: replace(setup, logs=(change(setup.logs[0]),))


def of(joint: str, quantities: Sequence[str], factor: float) -> Change:
    """Return a mistake: a factor on the quantities of a joint, "" for all."""

    def change(columns: Columns) -> Columns:
        mine = [one for one in columns if one.startswith(joint) and "." in one]
        return times(columns, {x: factor for x in mine if any(q in x for q in quantities)})

    return columns_of(change)


def drives(**changed: float) -> Change:
    """Return a mistake in the drive of the shoulder."""
    tables = DRIVES | {"shoulder": DRIVE | changed}
    return lambda setup: replace(setup, drives=tables)


def moved(angles: Mapping[str, float]) -> Change:
    """Return a mistake: encoders whose zeros are off by angles of their joints."""

    def change(columns: Columns) -> Columns:
        found = dict(columns)
        for joint, angle in angles.items():
            found[f"{joint}.joint_position_rad"] = columns[f"{joint}.joint_position_rad"] + angle
            motor = columns[f"{joint}.motor_position_rad"] + RATIO * angle
            found[f"{joint}.motor_position_rad"] = motor
        return found

    return columns_of(change)


def turned(*names: str) -> Change:
    """Return a mistake: each of these columns has what belongs to the next one."""
    of_next = dict(zip(names, [*names[1:], names[0]], strict=True))
    return columns_of(lambda columns: columns | {x: columns[y] for x, y in of_next.items()})


def coupled(columns: Columns) -> Columns:
    """Return columns of an arm whose motor of the elbow turns with its shoulder too: q_e - q_s/2.

    The shoulder holds half of the torque that the elbow has in addition.
    """
    q, turns = signals()["shoulder"][0], -0.5
    v, a = (np.gradient(np.gradient(q)) * RATE_HZ**2 if k else np.gradient(q) * RATE_HZ
            for k in (0, 1))  # fmt: skip
    speed = np.gradient(signals()["elbow"][0]) * RATE_HZ
    dry = COULOMB * (np.sign(speed + turns * v) - np.sign(speed))
    more = turns * RATIO * (ROTOR * a + VISCOUS * v) + dry
    friction = ROTOR * RATIO * np.gradient(speed) * RATE_HZ
    load = columns["elbow.motor_torque_Nm"] - friction - VISCOUS * RATIO * speed
    return columns | {
        "elbow.motor_position_rad": columns["elbow.motor_position_rad"] + turns * RATIO * q,
        "elbow.motor_torque_Nm": columns["elbow.motor_torque_Nm"] + more,
        "shoulder.motor_torque_Nm": columns["shoulder.motor_torque_Nm"]
        - turns * (load - COULOMB * np.sign(speed)),
    }


def torque_at_motor(angle: np.ndarray) -> np.ndarray:
    """Return the torque of rotor and friction at an angle of the motor (T,)."""
    speed, acceleration = (savgol_filter(angle, 31, 5, order, 1 / RATE_HZ) for order in (1, 2))
    return np.asarray(ROTOR * acceleration + VISCOUS * speed + COULOMB * np.sign(speed))


def sprung(columns: Columns, times: float = 1.0) -> Columns:
    """Return columns of an arm with springs of 200 and 100 N m/rad, or more, behind two gears."""
    found = dict(columns)
    for joint, stiffness in (("elbow", 200.0 * times), ("wrist", 100.0 * times)):
        position, torque = f"{joint}.motor_position_rad", f"{joint}.motor_torque_Nm"
        load = columns[torque] - torque_at_motor(columns[position])
        found[position] = columns[position] + RATIO * (RATIO * load / stiffness)
        found[torque] = load + torque_at_motor(found[position])
    return found


IN_DEGREES = "angles of a joint in degrees"
MISTAKES: dict[str, tuple[str, Change]] = {
    "all angles in degrees": ("unit", of("", POSITIONS, 180 / np.pi)),
    IN_DEGREES: ("unit", of("elbow", POSITIONS, 180 / np.pi)),
    "torques in mN m": ("unit", of("", TORQUES, 1e3)),
    "torque of a joint in mN m": ("unit", of("shoulder", TORQUES, 1e3)),
    "torque with another sign": ("sign", of("wrist", TORQUES, -1.0)),
    "all torques with another sign": ("sign", of("", TORQUES, -1.0)),
    "position with another sign": ("sign", of("elbow", POSITIONS, -1.0)),
    "exchanged joints": ("swapped-joints", columns_of(exchanged)),
    "torque constant": ("torque-scale", of("shoulder", TORQUES, 1.4)),
    "time in ms": ("time-unit", columns_of(lambda columns: times(columns, {"time_s": 1e3}))),
    "rotor inertia": ("rotor-inertia", drives(motor_inertia_kg_m2=4 * ROTOR)),
    "gear ratio": ("gear-ratio", drives(gear_ratio=0.5 * RATIO)),
    "no drives": ("missing-drives", lambda setup: replace(setup, drives=None)),
    "gravity": ("gravity", lambda setup: replace(setup, gravity=(0.0, 9.81, 0.0))),
    "payload": ("payload", lambda setup: replace(setup, payloads=("wrist_link:2:0,0,0.2",))),
    "torque in mN m with another sign": ("unit", of("elbow", TORQUES, -1e3)),
    "rotated torques": ("swapped-joints", turned(*(f"{x}.motor_torque_Nm" for x in JOINTS))),
    "zero of a joint": ("encoder-offset", moved({"elbow": 0.2})),
    "zeros of two joints": ("encoder-offset", moved({"shoulder": np.pi / 2, "elbow": -np.pi / 2})),
    "joint encoders times the gear": ("unit", of("", ("joint_position",), RATIO)),
    "tendon": ("coupled-joints", columns_of(coupled)),
    "ratio off by 2 %": ("gear-ratio", drives(gear_ratio=1.02 * RATIO)),
    "motor encoder with another sign": ("sign", of("elbow", ("motor_position",), -1.0)),
    "motor encoder in counts": ("unit", of("elbow", ("motor_position",), 4096 / (2 * np.pi))),
    "joint encoders in counts": ("unit", of("", ("joint_position",), 2**14 / (2 * np.pi))),
    "springs that are given as stiff": ("gear-compliance", columns_of(sprung)),
    "soft gears": ("gear-compliance", columns_of(partial(sprung, times=10.0))),
    "motor encoders in joint angles": ("unit", of("", ("motor_position",), 1 / RATIO)),
}
"""{mistake: its code, and the change of the set-up}"""

OF_SENSORS: dict[str, tuple[str, Change]] = {
    "torque sensor of half the torque": ("torque-scale", of("elbow", ("joint_torque",), 0.5)),
    "torque sensor with another sign": ("sign", of("wrist", ("joint_torque",), -1.0)),
    "exchanged torque sensors": (
        "swapped-joints",
        turned("shoulder.joint_torque_Nm", "elbow.joint_torque_Nm"),
    ),
    "motor constant next to a sensor": ("torque-scale", of("elbow", ("motor_torque",), 0.8)),
    "both torques with another sign": ("sign", of("", ("torque",), -1.0)),
}
"""{mistake of torques that are measured twice: its code, and the change of the set-up}"""

SAME_OF_ALL = (IN_DEGREES, "torque with another sign", "exchanged joints")
CASES = [("joint positions", mistake) for mistake in [*MISTAKES][:11]]
CASES += [(kind, mistake) for kind in [*LOGS][1:] for mistake in SAME_OF_ALL]
CASES += [("both positions", mistake) for mistake in [*MISTAKES][11:]]
CASES += [("both torques", mistake) for mistake in OF_SENSORS]
QUICK = {  # each code once or twice; the others are of one joint instead of all, or of other units
    "joint positions": ("torque with another sign", "exchanged joints", *[*MISTAKES][8:11]),
    "custom columns": (IN_DEGREES,),
    "both positions": (
        *("gear ratio", "no drives", "zeros of two joints", "tendon"),
        *("springs that are given as stiff", "soft gears"),
    ),
    "both torques": ("torque sensor of half the torque", "motor constant next to a sensor"),
}


def findings(setup: Setup) -> tuple[seaid.Finding, ...]:
    robot, logs = gauntlet.read(setup)
    return tuple(one for one in seaid.check(robot, logs).warnings if one.severity != "note")


def applied(setup: Setup, found: Sequence[seaid.Finding]) -> Setup:
    """Return the set-up with all remedies, as they are printed; `--drives` is the right file."""
    right = replace(setup, drives=DRIVES)
    for finding in found:
        setup = gauntlet.with_remedy(setup, right, finding.remedy)
    return setup


@pytest.mark.parametrize("kind", quick_only(LOGS, ["both torques", "custom columns"]))
def test_right_set_ups_have_nothing_to_repair(kind: str) -> None:
    columns, description = LOGS[kind]()
    assert findings(Setup(urdf(), DRIVES, (), (columns,), (description,))) == ()


@pytest.mark.parametrize(
    ("kind", "mistake"), quick_only(CASES, [(x, y) for x, names in QUICK.items() for y in names])
)
def test_a_remedy_speaks_of_the_columns_of_its_log_and_repairs(kind: str, mistake: str) -> None:
    columns, description = LOGS[kind]()
    code, change = (MISTAKES | OF_SENSORS)[mistake]
    setup = change(Setup(urdf(), DRIVES, (), (columns,), (description,)))
    found = findings(setup)
    assert code in {one.code for one in found}
    repaired = applied(setup, found)
    assert not gauntlet.same(setup, repaired)
    assert findings(repaired) == ()


def test_a_tilt_about_the_first_axis_and_its_zero_are_rivals() -> None:
    """They turn the robot alike: no line may be printed that one of them supports alone."""
    columns, _ = LOGS["both positions"]()
    setup = Setup(urdf(), DRIVES, (), (columns,), ({},), gravity=(9.81, 0.0, 0.0))
    (finding,) = findings(setup)
    assert (finding.code, finding.certainty) == ("gravity", "possible")
    assert "or encoder-offset" in finding.evidence
    assert gauntlet.same(setup, applied(setup, [finding]))
    assert "tilt of the base" in finding.remedy


def test_lengths_in_mm_are_named_before_any_motion_is_looked_at() -> None:
    columns, _ = LOGS["joint positions"]()
    text = urdf().replace('xyz="0.05 0 0.3"', 'xyz="50 0 300"')
    (finding,) = findings(Setup(text, DRIVES, (), (columns,), ({},)))
    assert (finding.code, finding.severity) == ("geometry", "wrong")


def test_an_encoder_that_measures_against_another_link_is_named() -> None:
    columns, _ = LOGS["both positions"]()
    names = [f"{joint}.joint_position_rad" for joint in ("elbow", "wrist")]
    sums = columns | {names[1]: columns[names[0]] + columns[names[1]]}
    (finding,) = findings(Setup(urdf(), DRIVES, (), (sums,), ({},)))
    assert (finding.code, finding.joint) == ("coupled-joints", "wrist")
    assert "against another link" in finding.message


def test_a_column_of_another_joint_is_no_motion_between_encoders() -> None:
    columns, _ = LOGS["both positions"]()
    copied = {"elbow.joint_position_rad": columns["wrist.joint_position_rad"]}
    found = findings(Setup(urdf(), DRIVES, (), (columns | copied,), ({},)))
    assert ("loose-encoder", "elbow", "wrong") in {(x.code, x.joint, x.severity) for x in found}


def test_a_ratio_that_varies_is_none_that_is_constant_and_wrong() -> None:
    columns, _ = LOGS["both positions"]()
    q, name = signals()["elbow"][0], "elbow.motor_position_rad"
    torque = "elbow.motor_torque_Nm"
    turned = columns[name] + 0.9 * RATIO * (1 - np.cos(q))
    load = columns[torque] - torque_at_motor(columns[name])
    varied = columns | {
        name: turned,
        torque: load / (1 + 0.9 * np.sin(q)) + torque_at_motor(turned),
    }
    setup = Setup(urdf(), DRIVES, (), (varied,), ({},))
    (finding,) = findings(setup)
    assert (finding.code, finding.joint) == ("varying-ratio", "elbow")
    # The remedy as it is printed repairs the result.
    assert not findings(applied(setup, [finding]))


def test_a_torque_that_friction_alone_explains_is_in_no_other_unit() -> None:
    columns, _ = LOGS["joint positions"]()
    name, speed = "elbow.motor_torque_Nm", np.gradient(signals()["elbow"][0])
    noise = 0.002 * np.random.default_rng(1).normal(size=len(speed))
    rubbing = columns | {name: 0.1 * np.sign(speed) + noise}
    (finding,) = findings(Setup(urdf(), DRIVES, (), (rubbing,), ({},)))
    assert (finding.code, finding.joint) == ("no-measurement", "elbow")


def test_bursts_of_lost_samples_are_no_wrong_clock() -> None:
    columns, _ = LOGS["joint positions"]()
    time, kept = columns["time_s"], np.ones(len(columns["time_s"]), dtype=bool)
    for begin in (200, 650, 1100, 1500):
        kept[begin : begin + 60] = False
    lost = {name: values[kept] for name, values in columns.items()}
    (finding,) = findings(Setup(urdf(), DRIVES, (), (lost | {"time_s": time[: sum(kept)]},), ({},)))
    assert (finding.code, finding.severity) == ("holes", "wrong")
    assert finding.evidence["steps"] == 4


@pytest.mark.parametrize(("joint", "size"), [("shoulder", 0.4), ("wrist", 0.5)])
def test_friction_that_is_smooth_is_in_no_other_unit_either(joint: str, size: float) -> None:
    """It is no sign of the speed, so that a part of the bodies seems to be in it."""
    columns, _ = LOGS["joint positions"]()
    speed = RATIO * RATE_HZ * np.gradient(signals()[joint][0])
    noise = 0.005 * np.random.default_rng(1).normal(size=len(speed))
    rubbing = columns | {f"{joint}.motor_torque_Nm": size * np.tanh(speed / 5) + noise}
    (finding,) = findings(Setup(urdf(), DRIVES, (), (rubbing,), ({},)))
    assert (finding.code, finding.joint) == ("no-measurement", joint)


def test_torques_in_per_cent_of_ratings_are_one_finding_with_their_errors() -> None:
    """The ratings are not the limits of the robot file, which are 500 N m at each joint."""
    columns, _ = LOGS["both positions"]()
    ratings = {"shoulder": 4.0, "elbow": 1.2, "wrist": 0.25}
    changes = [of(joint, ("torque",), 100 / rating) for joint, rating in ratings.items()]
    setup = Setup(urdf(), DRIVES, (), (columns,), ({},))
    for change in changes:
        setup = change(setup)
    (finding,) = findings(setup)
    assert (finding.code, finding.joints) == ("unit", JOINTS)
    repaired = applied(setup, [finding])
    assert findings(repaired) == ()
    assert repaired.drives
    for joint, rating in ratings.items():
        source = repaired.descriptions[0]["joints"][joint]["motor_torque"]
        std = repaired.drives[joint]["torque_scale_std"]
        assert abs(source["scale"] * 100 / rating - 1) < 3 * std < 0.5


@pytest.mark.parametrize("joints", [("elbow",), ("wrist",), JOINTS])
def test_torques_without_a_sign_are_excluded_in_one_line(joints: tuple[str, ...]) -> None:
    columns, _ = LOGS["joint positions"]()
    names = [f"{joint}.motor_torque_Nm" for joint in joints]
    folded = columns | {name: np.abs(columns[name]) for name in names}
    found = findings(Setup(urdf(), DRIVES, (), (folded,), ({},)))
    assert [(finding.code, finding.joint) for finding in found] == [
        ("no-measurement", joint) for joint in joints
    ]
    others = [f'"{joint}"' for joint in JOINTS if joint not in joints]
    lines = {line for x in found for line in x.remedy.splitlines() if "torque_joints" in line}
    assert lines == ({f"torque_joints = [{', '.join(others)}]"} if others else set())
    assert not any("[elbow" in x.remedy for x in found)  # without commands no controller gives it
