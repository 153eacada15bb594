"""Clean simulated logs damaged as other people's are: repaired, and identified as if nothing was.

And measured logs of real robots, with the damage they have.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid.errors import LogError
from seaid.log.channels import column_names
from seaid.log.reading import Log, repaired
from seaid.log.repair import Channel
from seaid.log.repair.clocks import clock_line, longest_bridge
from seaid.robot.robot import Robot
from seaid.simulation.simulation import measure
from tests.experiments import ELASTIC, LEG_SENSORS, leg, leg_motion, true_value
from tests.measured import LOGS
from tests.representatives import quick_first

Damaged = tuple[Array, Array]
Damage = Callable[[str, Array, Array, np.random.Generator], Damaged]


@cache
def clean() -> Log:
    log = measure(leg(), leg_motion(), LEG_SENSORS, 0)
    part: dict[str, Any] = {name: one[::2] for name, one in log.sensors().items()}
    return replace(log, time=log.time[::2], **part)


@cache
def undamaged() -> seaid.Identification:
    return seaid.identify(leg().without_nominal(), clean())


def channels_of(log: Log, damage: Damage) -> list[Channel]:
    """Return the log as channels, damaged one by one."""
    found = []
    for number, (name, values) in enumerate(log.columns().items()):
        rng = np.random.default_rng(number)
        found.append(Channel(name, *damage(name, log.time.copy(), values.copy(), rng)))
    return found


def log_of(robot: Robot, channels: list[Channel]) -> Log:
    time, values, report = repaired(channels)
    fields: dict[str, Any] = {
        field: np.full((len(time), robot.n), np.nan)
        for field in ("motor_position", "joint_position", "motor_torque")
    }
    for index, joint in enumerate(robot.joint_names):
        for name, field in column_names(joint, robot.is_prismatic[index]).items():
            if name in values:
                fields[field][:, index] = values[name]
    return Log(time=time, joint_names=robot.joint_names, report=report, **fields)


def joint_clock(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    """Every joint has a clock of its own: started at another time, up to 600 us/s off."""
    joint = leg().index(name.split(".")[0])
    return time * (1 + 3e-4 * (joint - 2)) + 100.0 * joint, values


def jitter(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    """Sampled at irregular times, 1 to 3 ms apart."""
    steps = np.random.default_rng(0).uniform(0.001, 0.003, len(time))
    new = np.cumsum(steps)
    new = new[new < time[-1]]
    if name.endswith("_Nm"):  # white noise has no time of its own
        return new, values[np.round(new / np.diff(time)[0]).astype(int)]
    # of what the encoder turns, in its steps
    step = 2 * np.pi / (2000 if "motor" in name else 2**14)
    return new, np.round(np.interp(new, time, values) / step) * step


def gaps(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    kept = np.ones(len(time), dtype=bool)
    for start in (400, 900, 1500, 2200, 2600):
        kept[start : start + 20] = False
    return time[kept], values[kept]


def dropouts(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    values[rng.integers(5, len(values) - 5, 40)] = np.nan
    return time, values


def zeros(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    if "position" in name:
        values[rng.integers(5, len(values) - 5, 20)] = 0.0
    return time, values


def held(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    for place in rng.integers(5, len(values) - 5, 60):
        values[place] = values[place - 1]
    return time, values


def wraps(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    """The encoders of the motors know one turn."""
    return time, np.mod(values, 2 * np.pi) if "motor_position" in name else values


def disorder(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    order = np.arange(len(time))
    for place in (300, 1000, 2000):
        order[place : place + 2] = order[place : place + 2][::-1]
    return time[order], values[order]


def repeats(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    rows = np.sort(np.concatenate([np.arange(len(time)), np.arange(100, 2800, 30)]))
    return time[rows], values[rows]


def set_back(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    time[1300:] -= 0.7
    return time, values


def everything(name: str, time: Array, values: Array, rng: np.random.Generator) -> Damaged:
    for damage in (wraps, held, dropouts, gaps, repeats, set_back, joint_clock):
        time, values = damage(name, time, values, np.random.default_rng(len(name)))
    return time, values


WAYS = (
    *(joint_clock, jitter, gaps, dropouts, zeros, held, wraps, disorder, repeats, set_back),
    everything,
)


QUICK = (jitter, everything)
"""The other ways are parts of the last one, but for zeros and disorder, in which time stays."""


@pytest.mark.slow  # 2.3 s
@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(  # an identification of a leg each
            way, id=way.__name__, marks=() if way in QUICK else pytest.mark.slow
        )
        for way in WAYS
    ],
)
def test_a_damaged_log_is_repaired_and_its_estimate_holds(damage: Damage) -> None:
    robot = leg().without_nominal()
    log = log_of(robot, channels_of(clean(), damage))
    assert log.report
    found, before = seaid.identify(robot, log), undamaged()
    for joint in ELASTIC:
        drive, plain = found.drives[joint], before.drives[joint]
        for name in ("viscous_friction", "coulomb_friction", "stiffness"):
            place = drive.names.index(name)
            error = drive.values[place] - true_value(leg(), joint, name)
            assert abs(error) < 3.0 * drive.standard_errors[place], f"{name} of {joint}"
            assert drive.standard_errors[place] < 2.0 * plain.standard_errors[place]
    truth = found.base.project(leg().parameters)
    off = (found.load.values - truth)[: len(truth)] / found.load.standard_errors
    assert np.sqrt(np.mean(off**2)) < 2.0


@pytest.mark.slow  # 1.0 s
@pytest.mark.parametrize(
    ("hole", "described"),
    quick_first(  # an identification of a leg each
        [((3.0, 3.3), True), ((3.0, 3.15), False), ((2.5, 3.5), False)]
    ),
)
def test_a_hole_is_excluded_and_said(hole: tuple[float, float], described: bool) -> None:
    """Bridged, holes of 0.3 and of 1 s put a stiffness 30 and 20 standard errors off."""
    robot, (start, end) = leg().without_nominal(), hole
    kept = (clean().time <= start) | (clean().time >= end)
    if described:
        channels = [Channel(name, clean().time, one) for name, one in clean().columns().items()]
        log = log_of(
            robot, [replace(c, time=c.time[kept], values=c.values[kept]) for c in channels]
        )
    else:
        sensors: dict[str, Any] = {field: one[kept] for field, one in clean().sensors().items()}
        log = replace(clean(), time=clean().time[kept], **sensors)
    found = seaid.identify(robot, log)
    assert (
        sum("holes in time, 1 found, the first at t = " in one for one in map(str, found.warnings))
        == 1
    )
    for joint in ELASTIC:
        drive = found.drives[joint]
        for name in ("viscous_friction", "coulomb_friction", "stiffness"):
            place = drive.names.index(name)
            error = drive.values[place] - true_value(leg(), joint, name)
            assert abs(error) < 3.0 * drive.standard_errors[place], f"{name} of {joint}"
    truth = found.base.project(leg().parameters)
    off = (found.load.values - truth)[: len(truth)] / found.load.standard_errors
    assert np.sqrt(np.mean(off**2)) < 2.0
    validation = seaid.validate(found, log)
    assert len(validation.time) == len(log.time)
    assert np.nanmax(validation.load.relative_error) < 1.5 * np.nanmax(
        seaid.validate(found, clean()).load.relative_error
    )


@pytest.mark.slow  # output error of a whole leg
def test_a_refinement_leaves_the_hole_out() -> None:
    kept = (clean().time <= 3.0) | (clean().time >= 3.3)
    sensors: dict[str, Any] = {field: one[kept] for field, one in clean().sensors().items()}
    log = replace(clean(), time=clean().time[kept], **sensors)
    refined = seaid.refine(seaid.identify(leg().without_nominal(), log), log)
    for joint in ELASTIC:
        stiffness = refined.drives[joint].value("stiffness")
        assert stiffness == pytest.approx(true_value(leg(), joint, "stiffness"), rel=0.03)


def test_a_log_that_is_mostly_a_hole_is_refused() -> None:
    kept = (clean().time <= 0.5) | (clean().time >= 5.5)
    sensors: dict[str, Any] = {field: one[kept] for field, one in clean().sensors().items()}
    log = replace(clean(), time=clean().time[kept], **sensors)
    for use in (seaid.identify, seaid.reconstruct_motion, seaid.replay):
        with pytest.raises(LogError, match=r"holes in time .* of 5 s at t = 0\.5 s"):
            use(leg(), log)


def test_unrepaired_clocks_would_have_been_seen() -> None:
    """A clock that was set back by five samples, left so, gives no such estimate."""
    robot = leg().without_nominal()
    motor = clean().motor_position.copy()
    motor[5:] = motor[:-5]
    found = seaid.identify(robot, replace(clean(), motor_position=motor))
    drive = found.drives["knee_pitch"]
    place = drive.names.index("viscous_friction")
    error = drive.values[place] - true_value(leg(), "knee_pitch", "viscous_friction")
    assert abs(error) > 5.0 * drive.standard_errors[place]


def table(path: Path) -> dict[str, Array]:
    with np.load(path) as columns:
        return dict(columns)


def hebi_channels(name: str) -> list[Channel]:
    columns = table(LOGS / "hebi_arms" / f"{name}.npz")
    sensors = {
        "pos": "joint_position_rad",
        "mpos": "motor_position_rad",
        "eff": "joint_torque_Nm",
    }
    return [
        Channel(f"joint_{joint}.{ours}", columns[f"t_tx_{joint}"], columns[f"{theirs}_{joint}"])
        for joint in range(5)
        if f"t_tx_{joint}" in columns
        for theirs, ours in sensors.items()
    ]


@pytest.mark.parametrize(
    "name",
    [
        *("capstone_repeat_waypoints", "grav_comp_bad", "ps4_repeat_waypoints"),
        *("ps5_robot_data", "star_trace", "virtual_spring"),
    ],
)
def test_modules_with_clocks_of_their_own(name: str) -> None:
    channels = hebi_channels(name)
    time, values, found = repaired(channels)
    kinds = {one.kind for one in found}
    assert {"irregular steps", "gaps"} <= kinds
    assert not kinds & {"wraps", "sudden zeros", "constant channel", "clock jumps"}
    steps = np.diff(time)
    inside = steps <= longest_bridge(time)  # the others are holes
    assert np.ptp(steps[inside]) < 1e-9
    assert np.sum(~inside) < 30
    for channel in channels:
        assert np.all(np.isfinite(values[channel.name]))
        assert np.min(values[channel.name]) > np.min(channel.values) - 0.1 * np.ptp(channel.values)
        assert np.max(values[channel.name]) < np.max(channel.values) + 0.1 * np.ptp(channel.values)


def test_clocks_of_modules_beside_the_receiver() -> None:
    columns = table(LOGS / "hebi_arms" / "ps4_repeat_waypoints.npz")
    lines = [clock_line(columns[f"t_tx_{joint}"], columns["t_rx"]) for joint in range(3)]
    assert all(line.jitter_s < 0.01 for line in lines)
    beside = [clock_line(columns[f"t_tx_{one}"], columns["t_tx_0"]) for one in (1, 2)]
    assert all(abs(line.offset_s) < 1e-3 and line.jitter_s < 5e-4 for line in beside)
    assert all(abs(line.drift) < 1e-4 for line in beside)


def test_unpowered_modules_have_dead_motor_channels() -> None:
    channels = hebi_channels("sample")
    _, values, found = repaired(channels)
    dead = [one.channel for one in found if one.kind == "constant channel"]
    assert dead == ["joint_0.motor_position_rad", "joint_1.motor_position_rad"]
    assert not np.any(values[dead[0]])


def test_torques_that_end_half_way_are_refused() -> None:
    name = "design_A.0_20220812_sys_id_20220812-060143-PM_measured.npz"
    columns = table(LOGS / "double_pendulum_a0" / "strong_torque" / name)
    channels = [Channel("a.motor_torque_Nm", columns["time"], columns["tau1"])]
    with pytest.raises(LogError, match=r"'a.motor_torque_Nm' lacks 999 of 1998 samples"):
        repaired(channels)


def test_jittered_servo_logs_and_pendulums() -> None:
    for path in sorted((LOGS / "xl330_pendulum" / "raw").glob("*.npz")):
        columns = table(path)
        time, angle = columns["timestamp"], columns["position"]
        grid, values, found = repaired([Channel("a.joint_position_rad", time, angle)])
        assert {one.kind for one in found} <= {"irregular steps", "held values"}
        assert 180 < 1 / np.diff(grid)[0] < 290
        line = np.interp(grid, time, angle)
        assert np.max(np.abs(values["a.joint_position_rad"] - line)) < 0.02
    for path in sorted((LOGS / "double_pendulum_a0" / "weak_torque").glob("*.npz")):
        columns = table(path)
        channels = [Channel("a.joint_position_rad", columns["time"], columns["pos_meas1"])]
        assert {one.kind for one in repaired(channels)[2]} == {"irregular steps"}
