"""Log descriptions: foreign columns, units, sides, clocks become our channels; mistakes named."""

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from seaid._arrays import Array
from seaid.errors import LogError
from seaid.legged import load_robot
from seaid.log import Log, LogDescription, describe_log, read_log, write_log
from seaid.log.description import changed_source, description_for
from seaid.log.repair.clocks import longest_bridge
from seaid.log.usable_parts import holes
from seaid.robot import Robot
from tests.experiments import DATA, leg, leg_motion, perfect_log
from tests.measured import LOGS
from tests.one_joint import BODY
from tests.plants import write_robot

TIME = np.arange(200) / 100
ROTARY = {"type": "series_elastic", "gear_ratio": 100}
PULLEYS = ROTARY | {"motor_pulley_radius_m": 0.02, "load_pulley_radius_m": 0.04}
DRUM = ROTARY | {"motor_pulley_radius_m": 0.02}
Table = dict[str, Any]


def robot_of(
    folder: Path, drive: Table, joints: tuple[str, ...] = ("arm",), kind: str = "continuous"
) -> Robot:
    limits = '<limit lower="-1.5" upper="1.5" effort="1" velocity="1"/>'
    parents = ("base", *(f"body_{joint}" for joint in joints))
    chain = {
        joint: f"{kind} {parent} body_{joint} {limits if kind != 'continuous' else ''}"
        for joint, parent in zip(joints, parents, strict=False)
    }
    path = write_robot(folder / "robot.urdf", chain, BODY)
    return load_robot(path, dict.fromkeys(joints, drive))


def wave(hz: float, size: float = 1.0) -> Array:
    return size * np.sin(2 * np.pi * hz * TIME + hz)


def log_file(folder: Path, **columns: Array) -> Path:
    columns = {"t": TIME} | columns | {"a": wave(0.5), "b": wave(0.7), "c": wave(0.9)}
    np.savez(folder / "log.npz", **columns)  # type: ignore[arg-type]
    return folder / "log.npz"


def described(**arm: Any) -> Table:
    quantities = {"motor_position": "a", "joint_position": "b", "motor_torque": "c"} | arm
    kept = {name: one for name, one in quantities.items() if one is not None}
    return {"time": "t", "joints": {"arm": kept}}


def error_of(path: Path, robot: Robot, description: Any) -> str:
    with pytest.raises(LogError) as caught:
        read_log(path, robot, description=description)
    return str(caught.value)


# Units, signs, sides


@pytest.mark.parametrize(
    ("quantity", "source", "factor", "zero"),
    [
        ("joint_position", {"unit": "deg"}, np.pi / 180, 0.0),
        ("joint_position", {"unit": "turn", "sign": -1}, -2 * np.pi, 0.0),
        ("motor_position", {"unit": "counts", "counts_per_turn": 4}, np.pi / 2, 0.0),
        ("motor_position", {"side": "joint"}, 200.0, 0.0),
        ("motor_position", {"side": "joint", "unit": "deg"}, 200 * np.pi / 180, 0.0),
        ("joint_position", {"side": "motor"}, 1 / 200, 0.0),
        ("motor_torque", {"side": "joint"}, 1 / 200, 0.0),
        ("joint_torque", {"side": "motor", "unit": "mNm"}, 0.2, 0.0),
        ("motor_torque", {"unit": "A", "torque_constant_Nm_per_A": 0.03}, 0.03, 0.0),
        ("motor_torque", {"unit": "mA", "torque_constant_Nm_per_A": 3.0}, 0.003, 0.0),
        ("motor_torque", {"scale": -0.5, "sign": -1}, 0.5, 0.0),
        ("motor_current", {"unit": "mA"}, 1e-3, 0.0),
        ("motor_voltage", {"times": 24.0}, 24.0, 0.0),
        ("motor_temperature", {"unit": "degC", "scale": 2.0, "offset": 1.0}, 2.0, 1.0),
        ("motor_temperature", {"unit": "K", "scale": 2.0}, 2.0, -546.3),
        ("motor_temperature", {"unit": "degF"}, 5 / 9, -160 / 9),
        ("slide", {"unit": "mm", "offset": 0.5}, 1e-3, 0.5),
        ("slide", {"unit": "counts", "counts_per_m": 1e4}, 1e-4, 0.0),
        ("slide joint_torque", {"unit": "kN"}, 1e3, 0.0),
        ("slide motor_position", {"side": "joint", "unit": "mm"}, 5.0, 0.0),
    ],
)
def test_value_is_the_column_in_si_units_at_its_side(
    tmp_path: Path, quantity: str, source: Table, factor: float, zero: float
) -> None:
    """The motor turns 100 * 0.04 / 0.02 times as far as the joint, or 5000 rad per metre."""
    is_sliding, quantity = quantity.startswith("slide"), quantity.removeprefix("slide").strip()
    kind, quantity = "prismatic" if is_sliding else "continuous", quantity or "joint_position"
    robot = robot_of(tmp_path, DRUM if is_sliding else PULLEYS, kind=kind)
    description = described(**{quantity: {"column": "d", **source}})
    log = read_log(log_file(tmp_path, d=wave(0.7)), robot, description=description)
    expected = factor * wave(0.7) + zero
    np.testing.assert_allclose(log.sensors()[quantity][:, 0], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("drive", "kind"), [(ROTARY, "continuous"), (PULLEYS, "continuous"), (DRUM, "prismatic")]
)
def test_deflection_and_one_side_give_the_other(tmp_path: Path, drive: Table, kind: str) -> None:
    """The spring's deflection is the difference of both sides, as a motion of the joint."""
    robot = robot_of(tmp_path, drive, kind=kind)
    motor, load = wave(0.5, 50.0), wave(0.7)
    behind_gear = drive.get("motor_pulley_radius_m", 1.0) / 100
    twist = behind_gear * motor - drive.get("load_pulley_radius_m", 1.0) * load  # (7), (8)
    path = log_file(tmp_path, motor=motor, load=load, twist=-1e3 * twist)
    deflection = {"column": "twist", "sign": -1, "scale": 1e-3}
    given = {"motor_position": "motor", "joint_position": "load"}
    for excluded in given:
        arm: Table = given | {"deflection": deflection, excluded: None}
        log = read_log(path, robot, description=described(**arm))
        np.testing.assert_allclose(log.motor_position[:, 0], motor, atol=1e-12 * 5000)
        np.testing.assert_allclose(log.joint_position[:, 0], load, atol=1e-12)


def test_voltage_of_a_position_servo_is_computed_and_clipped(tmp_path: Path) -> None:
    """The mean of the errors before and after a new goal, times the gain, within the supply."""
    robot = robot_of(tmp_path, {"type": "stiff", "gear_ratio": 1.0})
    on = np.where(TIME < 1.5, 1.0, 0.0)
    path = log_file(tmp_path, kp=np.full(200, 5.0), on=on)
    servo = {"goal": "a", "position": "b", "gain": "kp", "gain_factor": 0.2, "supply": 12.0}
    arm = {"motor_position": None, "motor_torque": None, "motor_voltage": {"servo": servo}}
    description = described(**arm) | {"where": "on"}
    log = read_log(path, robot, description=description)
    goal = wave(0.5)
    held = np.concatenate([goal[:1], goal[:-1]])
    before, after = (np.clip(one - wave(0.7), -1, 1) for one in (held, goal))
    expected = 6 * (before + after)[on > 0]
    assert np.max(np.abs(expected)) == 12.0
    np.testing.assert_allclose(log.sensors()["motor_voltage"][:, 0], expected, rtol=1e-12)


# Partial descriptions of files with seaid's own names


def own_file(folder: Path, log: Log) -> Path:
    """Write a log with seaid's own names."""
    write_log(log, folder / "own.npz")
    return folder / "own.npz"


def same(log: Log, other: Log) -> bool:
    columns = {"time_s": other.time, **other.columns()}
    return all(
        np.array_equal(values, columns[name])
        for name, values in {"time_s": log.time, **log.columns()}.items()
    )


def test_described_delay_is_corrected_and_other_channels_stay(tmp_path: Path) -> None:
    """A delay that was planted is taken out of its channel, and the end that it lacks is left."""
    plain = perfect_log(leg(), leg_motion())
    knee, delay_s = leg().index("knee_pitch"), 0.0123
    late = plain.motor_torque.copy()
    late[:, knee] = CubicSpline(plain.time, late[:, knee])(plain.time - delay_s)
    path = own_file(tmp_path, replace(plain, motor_torque=late))
    source = {"column": "knee_pitch.motor_torque_Nm", "delay_s": delay_s}
    log = read_log(path, leg(), description={"joints": {"knee_pitch": {"motor_torque": source}}})
    kept = plain.time <= plain.time[-1] - delay_s
    np.testing.assert_array_equal(log.time, plain.time[kept])
    np.testing.assert_array_equal(log.motor_position, plain.motor_position[kept])
    error = np.abs(log.motor_torque[:, knee] - plain.motor_torque[kept, knee])[20:]
    assert np.sqrt(np.mean(error**2)) < 2e-3 * np.std(plain.motor_torque[:, knee])
    assert [(one.channel, one.kind) for one in log.report] == [(source["column"], "delay")]


def test_excluded_intervals_are_holes(tmp_path: Path) -> None:
    """Samples in an interval are left out, and the others stay to the last bit."""
    plain = perfect_log(leg(), leg_motion())
    path = own_file(tmp_path, plain)
    log = read_log(path, leg(), description={"exclude_s": [[1.5, 2.0], [5.5, 99]]})
    assert same(log, plain.at((plain.time < 1.5) | ((plain.time >= 2.0) & (plain.time < 5.5))))
    assert [repair.kind for repair in log.report] == ["excluded intervals"]
    assert np.ptp(holes(log.time), axis=1) == pytest.approx([0.5], abs=0.01)


@pytest.mark.parametrize("drive", [ROTARY, PULLEYS])
def test_deflection_next_to_both_positions_is_a_channel_of_its_own(
    tmp_path: Path, drive: Table
) -> None:
    """As a motion of the joint: an elongation of the spring over the radius of its pulley."""
    robot, radius = robot_of(tmp_path, drive), drive.get("load_pulley_radius_m", 1.0)
    path = log_file(tmp_path, twist=wave(0.3))
    log = read_log(path, robot, description=described(deflection="twist"))
    assert log.deflection is not None
    np.testing.assert_allclose(log.motor_position[:, 0], wave(0.5))
    np.testing.assert_allclose(log.joint_position[:, 0], wave(0.7))
    np.testing.assert_allclose(log.deflection[:, 0], wave(0.3) / radius)
    path = own_file(tmp_path, log)
    for description in (None, {"exclude_s": [[-2.0, -1.0]]}):
        assert same(read_log(path, robot, description=description), log)


# Clocks and repair


def test_joints_have_clocks_of_their_own_and_encoders_wrap(tmp_path: Path) -> None:
    """An encoder of one turn with a late clock gives the motion at the times of the others."""
    robot = robot_of(tmp_path, ROTARY)
    late, motor = TIME + 0.0042, wave(0.5, 30.0)
    turned = np.mod(motor * 4096 / (2 * np.pi), 4096)
    path = log_file(tmp_path, late=1e6 * late, turned=turned)
    source = {"column": "turned", "unit": "counts", "counts_per_turn": 4096, "wraps": 4096}
    clock = {"column": "late", "unit": "us"}
    log = read_log(path, robot, description=described(motor_position=source | {"time": clock}))
    expected = 30 * np.sin(2 * np.pi * 0.5 * (log.time - 0.0042) + 0.5)
    error = log.motor_position[:, 0] - expected
    turns = error / (2 * np.pi)
    assert np.ptp(error[5:-5]) < 1e-3
    assert np.mean(turns) == pytest.approx(np.round(np.mean(turns)), abs=1e-3)
    assert any("wraps" in str(repair) for repair in log.report)
    assert log.between(0.0, 1.0).report == log.report


@pytest.mark.parametrize(
    ("source", "wraps"),
    [
        ({"unit": "deg"}, 360),
        ({"unit": "turn", "scale": 0.5}, 2),
        ({"unit": "counts", "counts_per_turn": 4096, "sign": -1}, 4096),
        ({"scale": 0.1}, 20 * np.pi),
        ({"times": 0.5}, 4 * np.pi),  # before the number multiplies it
    ],
)
def test_a_period_is_in_the_unit_of_its_column(tmp_path: Path, source: Table, wraps: float) -> None:
    """The text of the remedy, a period of one turn, unwraps the log of which it is."""
    if "wraps" not in source:
        source = changed_source({"column": "turned"} | source, wraps=2 * np.pi)
    assert source["wraps"] == pytest.approx(wraps)
    motor = wave(0.5, 30.0)
    turned = np.mod(motor * wraps / (2 * np.pi) * source.get("sign", 1), wraps)
    description = described(motor_position={"column": "turned"} | source)
    log = read_log(
        log_file(tmp_path, turned=turned), robot_of(tmp_path, ROTARY), description=description
    )
    assert np.ptp(log.motor_position[:, 0] - motor) < 1e-6
    assert any("(as given)" in str(repair) for repair in log.report)


# Where descriptions come from


def test_toml_beside_the_log_is_taken_and_others_are_left_alone(tmp_path: Path) -> None:
    """A file of that name which is no description is not taken for one, unless it is nearly one."""
    robot = robot_of(tmp_path, ROTARY)
    path = log_file(tmp_path)
    description = description_for(path, described(motor_torque={"column": "c", "unit": "mNm"}))
    assert description is not None
    beside = path.with_suffix(".toml")
    beside.write_text(description.to_toml())
    np.testing.assert_allclose(read_log(path, robot).motor_torque[:, 0], 1e-3 * wave(0.9))
    for other in ('[arm]\ntype = "stiff"\n', "junk", '[joints]\ntype = "stiff"\n'):
        beside.write_text(other)
        with pytest.raises(LogError, match="has no column of this robot"):
            read_log(path, robot)
    beside.write_text("[joints.arm]\nx = ]")
    with pytest.raises(LogError, match="is not valid TOML"):
        read_log(path, robot)


names = st.text(st.characters(exclude_categories=["C"]), min_size=1, max_size=12)
sources = st.fixed_dictionaries(
    {"column": names},
    optional={
        "sign": st.sampled_from([-1]),
        "scale": st.floats(0.1, 10),
        "offset": st.floats(-3, 3),
        "unit": st.sampled_from(["deg", "turn"]),
        "wraps": st.floats(1, 1e4),
        "delay_s": st.floats(-1, 1),
        "time": st.one_of(names, st.fixed_dictionaries({"rate_hz": st.floats(1, 1e4)})),
    },
)


@given(joints=st.dictionaries(names, sources, min_size=1), time=names)
def test_description_survives_its_toml(
    tmp_path_factory: pytest.TempPathFactory, joints: dict[str, Table], time: str
) -> None:
    content = {
        "time": time,
        "joints": {joint: {"joint_position": source} for joint, source in joints.items()},
        "repair": {"most_missing": 0.5},
        "exclude_s": [[1.0, 2.5], [3.0, 4.0]],
    }
    given = description_for(Path("log.csv"), content)
    assert given is not None
    path = tmp_path_factory.mktemp("description") / "log.toml"
    path.write_text(given.to_toml(), encoding="utf-8")
    back = description_for(Path("log.csv"), path)
    assert back is not None
    assert back.to_dict() == given.to_dict()


# Mistakes


MISTAKES = tomllib.loads((DATA / "descriptions" / "mistakes.toml").read_text("utf-8"))["mistake"]


@pytest.mark.parametrize("mistake", MISTAKES, ids=[mistake["says"] for mistake in MISTAKES])
def test_mistake_in_a_description_is_named(tmp_path: Path, mistake: Table) -> None:
    columns = {"off": np.zeros(200), "short": np.ones(7), "dead": np.zeros(200)}
    path, left = log_file(tmp_path, **columns), dict.fromkeys(mistake.get("leave", ()))
    description = described(**mistake.get("arm", {}), **left) | mistake.get("change", {})
    description = {key: value for key, value in description.items() if key not in left}
    assert mistake["says"] in error_of(path, robot_of(tmp_path, ROTARY), description)


def test_other_descriptions_that_cannot_be_meant_are_named(tmp_path: Path) -> None:
    robot, path = robot_of(tmp_path, ROTARY), log_file(tmp_path)
    assert "cannot read the description" in error_of(path, robot, tmp_path / "no.toml")
    given = description_for(Path("x"), described())
    assert given is not None
    for key, value, words in (
        ("wraps", 10**400, "above zero (1e-30"),
        ("scale", None, "found None"),
        ("scale", 1e300, "(at most 1e+30 in size) that is not zero, found 1e+300"),
        ("scale", 10**5000, "that is not zero, found a int too long"),
        (3, "q", "no key is named '3'"),
    ):
        assert words in error_of(path, robot, described(motor_position={"column": "a", key: value}))
    speed = {"speed": given.joints["arm"]["motor_torque"]}
    wrong = LogDescription({"arm": dict(given.joints["arm"]) | speed})  # made in Python
    assert "no key is named 'speed'" in error_of(path, robot, wrong)
    stiff = robot_of(tmp_path, STIFF)
    text = error_of(path, stiff, described(motor_position=None, deflection="a"))
    assert "joint 'arm' has a stiff drive, which has no deflection" in text


# Measured logs

HEBI = ROTARY | {"gear_ratio": 272.222}
STIFF = {"type": "stiff", "gear_ratio": 1.0}
HEBI_JOINTS = tuple(f"joint_{index}" for index in range(5))
UR10 = tuple(
    f"{one}_joint"
    for one in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
)


MODULE = (
    *("motor_position", "joint_position", "joint_torque", "motor_current", "motor_voltage"),
    "motor_temperature",
)
SPRING = ("joint_position", "deflection", *MODULE[2:4], MODULE[-1])
SIMPLE = ("joint_position", "motor_torque")
PENDULUM = ("Joint1", "Joint2")
SERVO_OF_XL330 = ("joint_position", "position_command", "motor_temperature")


@pytest.mark.parametrize(
    ("log", "description", "drive", "joints", "rate_hz", "quantities"),
    [
        ("hebi_arms/capstone_rep*", "hebi_csv_5", HEBI, HEBI_JOINTS, 100, MODULE),
        ("hebi_arms/grav_comp_bad*", "hebi_csv_2", HEBI, HEBI_JOINTS[:2], 92, MODULE),
        ("hebi_arms/ps4_*", "hebi_csv_3_deflection", HEBI, HEBI_JOINTS[:3], 94, MODULE),
        ("hebi_arms/ps5_*", "hebi_csv_3", HEBI, HEBI_JOINTS[:3], 97, MODULE),
        ("hebi_arms/sample*", "hebi_csv_2_deflection", HEBI, HEBI_JOINTS[:2], 100, SPRING),
        ("hebi_arms/virtual_*", "hebi_csv_2", HEBI, HEBI_JOINTS[:2], 94, MODULE),
        ("hebi_x5_unloaded/*.csv", "hebi_csv_1", HEBI, HEBI_JOINTS[:1], 100, MODULE),
        pytest.param(
            *("hebi_x5_unloaded/*.hebilog", "hebilog_1", HEBI, HEBI_JOINTS[:1], 100),
            (*MODULE[:4], MODULE[-1]),
            marks=pytest.mark.hebi,
        ),
        ("ur10_exciting/*.npz", "ur10_csv", STIFF, UR10, 125, SIMPLE),
        ("double_pendulum_a0/st*/*", "double_pendulum_strong", STIFF, PENDULUM, 500, SIMPLE),
        ("double_pendulum_a0/we*/*", "double_pendulum_weak", STIFF, PENDULUM, 500, SIMPLE),
        ("xl330_pendulum/raw/*", "xl330", STIFF, ("pendulum",), 187, SERVO_OF_XL330),
    ],
)
def test_every_measured_set_is_read_with_its_description_and_described_without(
    tmp_path: Path,
    log: str,
    description: str,
    drive: Table,
    joints: tuple[str, ...],
    rate_hz: float,
    quantities: tuple[str, ...],
) -> None:
    """The rate and the joints are those of the set; without a description it is found, in doubt."""
    path = min(LOGS.glob(log))
    measured = read_log(
        path, robot_of(tmp_path, drive, joints), description=LOGS / f"{description}.toml"
    )
    assert 1 / np.median(np.diff(measured.time)) == pytest.approx(rate_hz, rel=0.01)
    assert set(measured.columns()) >= {f"{joint}.joint_position_rad" for joint in joints}
    steps, kinds = np.diff(measured.time), {repair.kind for repair in measured.report}
    even = steps[steps <= longest_bridge(measured.time)]  # the others are holes
    assert np.ptp(even) < 1e-8 or "irregular steps" not in kinds
    assert not kinds & {"wraps", "clock jumps", "late samples"}
    inferred = describe_log(path)
    assert [tuple(of) for of in inferred.description.joints.values()] == [quantities] * len(joints)
    assert inferred.unsure
    signs = {
        of["deflection"].sign for of in inferred.description.joints.values() if "deflection" in of
    }
    assert signs <= {-1}  # as the makers of the arm have it
