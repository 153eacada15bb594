"""Mistakes of commands, and torques that are none, are named with lines that repair them."""

from __future__ import annotations

import csv
import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seaid
from scripts.benchmarks.commanded_arms import ARMS
from seaid._arrays import Array
from seaid.checks import commands
from seaid.checks.commands import _is_folded, _returns, _returns_of, no_measurements
from seaid.checks.tolerances import EVENTS
from seaid.drives.toml import drives_from_mapping
from seaid.errors import IdentificationError, LogError
from seaid.simulation import rollout
from tests.commanded_joint import (
    CHIRP,
    SOFT,
    TIME,
    TRUTH,
    URDF,
    log_of,
    mujoco_log,
    robot_of,
    values_of,
    wrong_of,
)
from tests.measured import LOGS
from tests.representatives import quick_first

SO101 = Path(__file__).parents[3] / "shared" / "data" / "so101_commands"
"""Measured logs that are not shipped."""


def test_what_is_wrong_with_commands_is_said(urdf: Path) -> None:
    robot, log = robot_of(urdf, SOFT), mujoco_log(SOFT, 0.0, 0.0, 0)
    blind = replace(log, position_command=None)
    with pytest.raises(LogError, match=r"no column 'j\.position_command_rad'"):
        seaid.identify(robot, blind)
    with pytest.raises(LogError, match=r"no column 'j\.position_command_rad'"):
        seaid.replay(seaid.identify(robot, log).robot, blind)
    assert [one.code for one in wrong_of(robot, log)] == []
    backwards = replace(log, position_command=-CHIRP[:, None])
    (sign,) = wrong_of(robot, backwards)
    assert sign.code == "sign"
    assert 'position_command = { column = "j.position_command_rad", sign = -1 }' in sign.remedy
    (unit,) = wrong_of(robot, replace(log, position_command=np.rad2deg(CHIRP)[:, None]))
    assert unit.code == "unit"
    assert "it is in degrees" in unit.message
    assert "scale = 0.01745 }" in unit.remedy
    late = replace(log, position_command=np.interp(TIME + 0.3, TIME, CHIRP)[:, None])
    drive = replace(robot.drives["j"], command_delay_s=0.3)
    words = r"delayed by 299 ms, more than 250 ms either way(.|\n)*, delay_s = -0\.299 \}"
    with pytest.raises(IdentificationError, match=words):
        seaid.identify(robot.with_drives({"j": drive}), late)
    (unfit,) = (x for x in seaid.identify(robot, late).warnings if x.code == "no-fit")
    assert unfit.severity == "wrong"


@pytest.mark.parametrize("delay_s", quick_first([-0.04, 0.08, -0.001, 0.01], 2))  # 0.4 s each
def test_delays_that_no_bus_has_are_identified_and_said(urdf: Path, delay_s: float) -> None:
    log = mujoco_log(SOFT, 0.0, 1e-4, 0)
    shifted = np.interp(TIME + delay_s, TIME, CHIRP)[:, None]
    found = seaid.identify(robot_of(urdf, SOFT), replace(log, position_command=shifted))
    assert values_of(found)["command_delay"][0] == pytest.approx(delay_s, abs=3e-4)
    assert values_of(found)["motor_inertia"][0] == pytest.approx(TRUTH["motor_inertia"], rel=0.02)
    said = [(one.severity, one.message) for one in found.warnings if one.code == "delay"]
    if -0.002 < delay_s < 0.05:
        assert not said
        return
    ((severity, message),) = said
    assert severity == ("note" if delay_s < 0 else "doubtful")
    assert f" ms {'before' if delay_s < 0 else 'after'} their time in the log" in message


def test_the_sums_that_one_gain_set_determines_are_said_before_a_fit(urdf: Path) -> None:
    """Those of the check are the effect of a delay on the estimates, within 5 %."""
    log = mujoco_log(SOFT, 0.0, 2e-3, 0)
    (found,) = seaid.check(robot_of(urdf, SOFT), log).warnings
    assert found.code == "command-delay"
    fits = [values_of(seaid.identify(robot_of(urdf, SOFT, delay), log)) for delay in (0, 1e-3)]
    for name, parameter in (("armature", "motor_inertia"), ("friction", "viscous_friction")):
        slope = (fits[0][parameter][0] - fits[1][parameter][0]) / 1e-3
        evidence = found.evidence[f"{name} of j per second of delay"]
        assert evidence == pytest.approx(slope, rel=0.05)
    assert "this log separates the delay T" in found.message  # by gravity and inertia
    assert not seaid.check(robot_of(urdf, SOFT, 0.0), log).warnings


@pytest.mark.slow  # 1.1 s
def test_a_torque_limit_that_is_not_stated_is_found_and_its_lines_repair_it(urdf: Path) -> None:
    robot = robot_of(urdf, SOFT)
    drive = robot.drives["j"].with_values({**TRUTH, "friction_offset": 0.0, "command_delay": 0.004})
    law = drive.controller
    assert law is not None
    limited = replace(drive, controller=replace(law, torque_limit_Nm=4.0))
    plan = log_of(np.full(len(TIME), CHIRP[0])).between(0.0, 8.0)
    noise = np.random.default_rng(5).normal(size=(len(plan.time), 1)) * 1e-4

    def logged(true: Any) -> seaid.Log:
        moved = rollout(robot.with_drives({"j": true}), plan, longest_closed_s=5e-3)
        return replace(plan, joint_position=moved.joint_position + noise)

    log = logged(limited)
    (found,) = wrong_of(robot, log)
    assert (found.code, found.joint, found.severity) == ("saturation", "j", "wrong")
    assert found.evidence["torque limit"] == pytest.approx(4.0, rel=0.06)
    assert "torque_limit_Nm = " in found.remedy
    stated = replace(law, torque_limit_Nm=found.evidence["torque limit"])
    repaired = robot.with_drives({"j": replace(robot.drives["j"], controller=stated)})
    assert wrong_of(repaired, log) == []
    assert wrong_of(robot, logged(drive)) == []


def test_commands_that_are_repeated_limited_or_followed_too_well_are_said(
    urdf: Path, tmp_path: Path
) -> None:
    log, robot = mujoco_log(SOFT, 0.0, 0.0, 0), robot_of(urdf, SOFT)
    command = log.position_command
    assert command is not None
    rng = np.random.default_rng(1)
    twice = np.flatnonzero(rng.random(len(TIME)) < 0.1)[1:]
    late = command.copy()
    late[twice] = late[twice - 1]
    (repeated,) = wrong_of(robot, replace(log, position_command=late))
    assert repeated.code == "delay"
    assert repeated.evidence["share of repeated commands"] == pytest.approx(0.1, abs=0.02)
    held = np.repeat(command[::4], 4, axis=0)[: len(command)]
    assert wrong_of(robot, replace(log, position_command=held)) == []
    # Ticks repeat near each reversal, and no message is late.
    tick = float(np.percentile(np.abs(np.diff(command[:, 0])), 40))
    in_ticks = tick * np.round(command / tick)
    assert wrong_of(robot, replace(log, position_command=in_ticks)) == []
    limited = seaid.Controller(
        position_gain_Nm_per_rad=40.0, velocity_gain_Nms_per_rad=1.0, torque_limit_Nm=6.0
    )
    drive = replace(robot.drives["j"], controller=limited)
    found = seaid.check(robot.with_drives({"j": drive}), log).warnings
    (saturated,) = [one for one in found if one.code == "saturation"]
    assert saturated.severity == "note"
    asked = 40.0 * (command - log.joint_position) - np.gradient(log.joint_position, TIME, axis=0)
    share = float(np.mean(np.abs(asked) > 6.0))
    assert saturated.evidence["share at the limit"] == pytest.approx(share, abs=0.01)
    weak = tmp_path / "weak.urdf"
    weak.write_text(URDF.replace('effort="50"', 'effort="6"'))
    (beyond,) = wrong_of(robot_of(weak, SOFT), log)
    assert beyond.code == "saturation"
    assert beyond.evidence == saturated.evidence
    assert "torque_limit_Nm = 6" in beyond.remedy
    noise = rng.normal(size=command.shape) * 1e-3
    (close,) = wrong_of(robot, replace(log, joint_position=command + noise))
    assert close.code == "unidentifiable"
    assert close.evidence["tracking error over noise"] == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow  # all checks of a measured quadruped
def test_a_commanded_go2_has_no_mistake() -> None:
    """Its armature, which the file lacks, looked like exchanged joints and late torques."""
    bare = seaid.load_robot("go2")
    gains = seaid.Controller(position_gain_Nm_per_rad=20.0, velocity_gain_Nms_per_rad=1.5)
    drive = seaid.StiffDrive(motor_input="position_command", controller=gains)
    drives = dict.fromkeys(bare.joint_names, drive)
    robot = seaid.load_robot("go2", drives, known_bodies=bare.body_names)
    log = seaid.read_log("models/logs/go2_commands/go2_second_half.npz", robot)
    found = seaid.check(robot, log).warnings
    assert [one.code for one in found] == ["command-delay"]
    assert "does not separate" in found[0].message
    assert "FL_hip_joint armature + " in found[0].message
    assert 'known = ["command_delay"]' in found[0].remedy


@pytest.mark.slow  # 1.2 s
@pytest.mark.parametrize("units", [256.0, 4096 / (2 * np.pi), 0.01])
def test_gains_in_another_unit_are_named_by_the_bodies(
    urdf: Path, tmp_path: Path, units: float
) -> None:
    """The finding has the factor, and its line of TOML ends it; limits are no finding then."""
    log, (kp, kd) = mujoco_log(SOFT, 0.006, 2e-4, 0), SOFT
    robot = robot_of(urdf, (units * kp, units * kd))
    (finding,) = wrong_of(robot, log)
    assert (finding.code, finding.severity, finding.joint) == ("gain-scale", "wrong", "j")
    assert finding.evidence["torque of j over that of the bodies"] == pytest.approx(units, rel=0.03)
    assert "known bodies (known_bodies=)" not in finding.remedy
    drives = tmp_path / "drives.toml"
    seaid.write_drives(robot.drives, drives)
    head, _, table = finding.remedy.partition("in the drives file:\n[j.controller]\n")
    assert head
    assert table == "is_up_to_scale = true"
    text = drives.read_text().replace("[j.controller]", f"[j.controller]\n{table}")
    drives.write_text(text)
    declared = seaid.load_robot(urdf, drives, known_bodies=["arm"])
    assert wrong_of(declared, log) == []
    scale, error = values_of(seaid.identify(declared, log))["gain_scale"]
    assert scale == pytest.approx(1 / units, rel=0.01)
    assert error < 0.01 * scale
    unknown = seaid.load_robot(urdf, robot.drives)
    (same,) = wrong_of(unknown, log)
    assert same.code == "gain-scale"
    assert "known bodies (known_bodies=)" in same.remedy


@pytest.mark.parametrize("factor", quick_first([0.7, 1.5]))  # 0.5 s each
def test_gains_that_known_bodies_contradict_are_no_parallel_spring(
    urdf: Path, factor: float
) -> None:
    """Gravity of the bodies is nearly proportional to the angle, as a parallel spring is."""
    log, (kp, kd) = mujoco_log(SOFT, 0.004, 2e-5, 0), SOFT
    robot = robot_of(urdf, (factor * kp, factor * kd), 0.004)
    (finding,) = seaid.identify(robot, log).warnings
    assert (finding.code, finding.severity, finding.joint) == ("gain-scale", "doubtful", "j")
    times = finding.evidence["torque over that of the known bodies"]
    assert times == pytest.approx(factor, abs=4 * finding.evidence["standard error"])
    drive = robot.drives["j"]
    assert drive.controller is not None
    table = tomllib.loads(finding.remedy.partition("in the drives file:\n")[2])["j"]["controller"]
    law = replace(drive.controller, **table)
    after = seaid.identify(robot.with_drives({"j": replace(drive, controller=law)}), log)
    assert after.verdict.level == "good"
    assert values_of(after)["gain_scale"][0] == pytest.approx(1 / factor, rel=1e-3)


def test_gains_in_another_unit_are_named_by_a_limit(urdf: Path, tmp_path: Path) -> None:
    """With limits of the drive or, of bodies without masses, of the robot file."""
    log, (kp, kd) = mujoco_log(SOFT, 0.006, 2e-4, 0), SOFT
    robot = robot_of(urdf, (256 * kp, 256 * kd))
    drive = robot.drives["j"]
    assert drive.controller is not None
    limited = replace(drive, controller=replace(drive.controller, torque_limit_Nm=50.0))
    empty = tmp_path / "empty.urdf"
    start, _, end = URDF.partition("<inertial>")
    empty.write_text(start + end.partition("</inertial>")[2])
    for one in (robot.with_drives({"j": limited}), seaid.load_robot(empty, robot.drives)):
        (finding,) = (x for x in wrong_of(one, log) if x.code == "gain-scale")
        assert finding.severity == "doubtful"
        assert finding.evidence["median torque over its limit"] > 5
        assert "[j.controller]\nis_up_to_scale = true" in finding.remedy


@pytest.mark.slow  # all checks of a measured quadruped
def test_a_wrong_gain_of_a_joint_whose_gravity_is_small_is_named_with_the_others() -> None:
    """All hips and thighs of the measured Go2 show the factor; calves are too uncertain to."""
    bare = seaid.load_robot("go2")
    gains = seaid.Controller(position_gain_Nm_per_rad=20.0 * 256, velocity_gain_Nms_per_rad=384.0)
    drive = seaid.StiffDrive(motor_input="position_command", controller=gains)
    drives = dict.fromkeys(bare.joint_names, drive)
    robot = seaid.load_robot("go2", drives, known_bodies=bare.body_names)
    log = seaid.read_log("models/logs/go2_commands/go2_second_half.npz", robot)
    (found,) = wrong_of(robot, log)
    assert (found.code, found.severity, found.joint) == ("gain-scale", "wrong", "")
    assert found.remedy.count(".controller]\nis_up_to_scale = true") == 12
    assert len(found.evidence) < 12
    assert all(256 < factor < 1.7 * 256 for factor in found.evidence.values())
    assert "FL_calf_joint" in found.message.partition("as the others")[0].rpartition(";")[2]


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> tuple[seaid.Robot, seaid.Log]:
    """Return two arms of known bodies in a chain, and a log of their commands."""
    path = tmp_path_factory.mktemp("chain") / "chain.urdf"
    path.write_text(ARMS)
    time = np.arange(0, 12, 0.01)
    slow, fast = np.sin(1.7 * time), np.sin(2.3 * time + 1)
    commands = np.column_stack([0.6 * slow + 0.2 * np.sin(5 * time), 0.5 * fast])
    gains = seaid.Controller(position_gain_Nm_per_rad=60.0, velocity_gain_Nms_per_rad=2.0)
    drive = seaid.StiffDrive(
        motor_input="position_command",
        controller=gains,
        command_delay_s=0.0,
        known=("command_delay",),
    )
    robot = seaid.load_robot(path, {"j0": drive, "j1": drive}, known_bodies=["a", "b"])
    true = replace(
        drive,
        motor_inertia_kg_m2=0.03,
        viscous_friction_Nms_per_rad=0.3,
        coulomb_friction_Nm=0.2,
    )
    unknown = np.full_like(commands, np.nan)
    plan = seaid.Log(time, ("j0", "j1"), unknown, commands, unknown, position_command=commands)
    moved = rollout(robot.with_drives({"j0": true, "j1": true}), plan, longest_closed_s=2.5e-3)
    return robot, replace(plan, joint_position=moved.joint_position)


def test_exchanged_commands_are_named_and_their_remedy_repairs_it(
    chain: tuple[seaid.Robot, seaid.Log],
) -> None:
    robot, log = chain
    assert log.position_command is not None
    exchanged = replace(log, position_command=log.position_command[:, ::-1])
    (finding,) = wrong_of(robot, exchanged)
    assert (finding.code, finding.joint) == ("swapped-joints", "j0")
    tables = tomllib.loads(finding.remedy.partition("\n")[2])["joints"]
    columns = [tables[joint]["position_command"]["column"] for joint in robot.joint_names]
    sources = exchanged.sources()
    assert columns == [sources[joint]["position_command"] for joint in ("j1", "j0")]
    assert "swapped-joints" not in {x.code for x in wrong_of(robot, log)}
    # A joint that follows its own command, and that of the other one too, shows no exchange.
    alike = replace(log, position_command=log.position_command[:, [0, 0]])
    assert "swapped-joints" not in {x.code for x in wrong_of(robot, alike)}


@pytest.mark.slow  # 1.2 s
@pytest.mark.parametrize(
    ("signs", "zeros"),
    [
        ((1, 1), (0.0, 0.0)),
        ((1, -1), (0.0, 0.0)),
        ((-1, -1), (0.0, 0.0)),
        ((1, 1), (-1.5708, 0.0)),
        ((-1, 1), (0.0, 0.8)),
        ((1, -1), (0.0, 1.5708)),
    ],
)
def test_signs_and_zeros_are_found_by_gravity(
    chain: tuple[seaid.Robot, seaid.Log], signs: tuple[int, int], zeros: tuple[float, float]
) -> None:
    """A log has sign * (position - zero); the remedy is the way back, sign * value + offset."""
    robot, log = chain
    assert log.position_command is not None
    other = replace(
        log,
        joint_position=np.array(signs) * (log.joint_position - np.array(zeros)),
        position_command=np.array(signs) * (log.position_command - np.array(zeros)),
    )
    found = [x for x in wrong_of(robot, other) if x.code in ("sign", "encoder-offset")]
    wanted = {f"j{k}": pair for k, pair in enumerate(zip(signs, zeros, strict=True))}
    wanted = {joint: pair for joint, pair in wanted.items() if pair != (1, 0.0)}
    offsets = {
        name.split()[2]: (one, angle)
        for one in found
        for name, angle in one.evidence.items()
        if name.startswith("offset of ")
    }
    assert set(offsets) == set(wanted)
    for joint, (sign, zero) in wanted.items():
        one, offset = offsets[joint]
        assert one.code == ("sign" if sign < 0 else "encoder-offset")
        assert offset == pytest.approx(zero, abs=0.03)
        table = tomllib.loads(one.remedy.partition("\n")[2])["joints"][joint]
        assert [entry.get("sign", 1) for entry in table.values()] == [sign, sign]
        assert [entry.get("offset", 0.0) for entry in table.values()] == [
            pytest.approx(offset, abs=1e-5)
        ] * 2


@pytest.mark.parametrize(
    ("factor", "heavier", "severity"), [(0.7, 1.0, "doubtful"), (1.0, 0.6, "note")]
)
def test_gains_that_hold_at_another_joint_are_not_in_another_unit(
    chain: tuple[seaid.Robot, seaid.Log], factor: float, heavier: float, severity: str
) -> None:
    """The joints have one controller: of gains in another unit they have one factor."""
    robot, log = chain
    bodies = robot.parameters.copy()
    bodies[10:] *= heavier
    drives = {}
    for joint, drive in robot.drives.items():
        law = seaid.Controller(
            position_gain_Nm_per_rad=factor * 60.0, velocity_gain_Nms_per_rad=factor * 2.0
        )
        drives[joint] = replace(drive, controller=law)
    wrong = robot.with_values(bodies, drives)
    found = [x for x in seaid.identify(wrong, log).warnings if x.code == "gain-scale"]
    assert found
    assert {x.severity for x in found} == {severity}
    is_contradicted = ["with the same gains have other factors" in x.message for x in found]
    assert is_contradicted == [severity == "note"] * len(found)
    assert ["is_up_to_scale" in x.remedy for x in found] == [severity != "note"] * len(found)


def _servo_log(torque: Array, command: Array | None = None) -> tuple[seaid.Robot, seaid.Log]:
    """Return the pendulum and a log of it with a torque (T,), and perhaps a command (T,)."""
    robot = seaid.load_robot(Path(__file__).parents[2] / "models" / "xl330_pendulum.urdf")
    nothing = np.full((len(torque), 1), np.nan)
    position = _tracked()[1][:, None]
    log = seaid.Log(
        time=_tracked()[0],
        joint_names=robot.joint_names,
        motor_position=nothing,
        joint_position=position,
        motor_torque=torque[:, None],
        position_command=None if command is None else command[:, None],
    )
    return robot, log


def _tracked() -> tuple[Array, Array, Array]:
    """Return time, position and tracking error of a servo that follows two sines."""
    time = np.arange(0, 10, 0.01)
    error = 0.03 * np.sin(2.9 * time + 1) + 0.02 * np.sin(7.1 * time)
    return time, 0.5 * np.sin(2.9 * time) + 0.3 * np.sin(7.1 * time), error


def test_torques_without_sign_and_outputs_of_a_controller_are_named() -> None:
    _, position, error = _tracked()
    noise = np.random.default_rng(5).normal(size=len(error)) * 0.02
    torque = 20 * error + 0.1 * np.sign(np.gradient(position)) + noise

    def named(given: Array, command: Array | None = None) -> list[seaid.Finding]:
        return list(no_measurements(*_servo_log(given, command)))

    (magnitude,) = named(np.abs(torque))
    assert (magnitude.code, magnitude.severity) == ("no-measurement", "wrong")
    assert "has no sign: it is a magnitude" in magnitude.message
    (coarse,) = named(np.round(5 * np.abs(torque)) / 5, position + error)
    assert coarse.severity == "wrong"
    (computed,) = named(20 * error, position + error)
    assert computed.severity == "doubtful"
    assert "is 20 times the tracking error (correlation 1.0000)" in computed.message
    head, _, table = computed.remedy.partition("\n")
    assert head == "in the drives file:"
    (drive,) = drives_from_mapping(tomllib.loads(table)).values()
    assert drive.controller == seaid.Controller(position_gain_Nm_per_rad=20.0)
    # a signed torque with noise, one of gravity that never changes sign, one with a free sign
    assert named(torque) == named(torque, position + error) == []
    assert named(5 + 20 * error + noise) == []
    assert named(np.maximum(torque, 0) - np.maximum(-torque, 0) * 0.01) == []


@pytest.mark.parametrize(
    ("quantity", "constants", "gain"),
    [
        ("motor_torque", {}, 200.0),
        ("joint_torque", {}, 20.0),
        ("motor_current", {"torque_constant": 0.1}, 20.0),
        ("motor_current", {}, None),
    ],
)
def test_the_gain_of_a_torque_that_is_computed_acts_at_the_joint(
    quantity: str, constants: dict[str, float], gain: float | None
) -> None:
    """Each is 20 times the tracking error; the gear ratio is 10."""
    _, position, error = _tracked()
    robot, log = _servo_log(np.full(len(error), np.nan), position + error)
    log = replace(log, **{quantity: 20 * error[:, None]})  # type: ignore[arg-type]
    is_known = {"motor_input": "current"} if constants else {}
    drive = seaid.StiffDrive(gear_ratio=10.0, nominal=constants, **is_known)  # type: ignore[arg-type]
    (finding,) = no_measurements(robot.with_drives({"pendulum": drive}), log)
    assert "is 20 times the tracking error" in finding.message
    is_placeholder = "position_gain_Nm_per_rad = 20.0  # write the gain" in finding.remedy
    assert is_placeholder == (gain is None)
    assert gain is None or f"position_gain_Nm_per_rad = {gain:g}" in finding.remedy


def test_a_load_that_vanishes_once_is_no_magnitude() -> None:
    """A foot that is hardly loaded for a second, with noise: eight returns to zero before."""
    time = _tracked()[0]
    noise = 0.02 * np.random.default_rng(5).normal(size=len(time))
    load = 5 * (1 - np.exp(-(((time - 5) / 1.5) ** 6)))
    torque = load + 0.09 + noise
    near = np.abs(torque) < 0.02 * np.percentile(torque, 99)
    assert np.min(torque) > 0
    assert np.count_nonzero(near[1:] & ~near[:-1]) > 8
    assert _returns_of(torque) < EVENTS
    assert _returns_of(np.abs(torque * np.sin(9 * time))) >= EVENTS


def test_a_noisy_torque_of_gravity_near_zero_is_no_magnitude() -> None:
    """It comes near zero once, for a second, with noise of 2 % of its size."""
    time = np.arange(0, 10, 1e-3)
    noise = 0.02 * np.random.default_rng(5).normal(size=len(time))
    torque = np.minimum(-0.075 - 0.9 * np.sin(np.pi * (time - 5) / 10) ** 2 + noise, -1e-3)
    near = np.abs(torque) < 0.05
    assert np.count_nonzero(near[1:] & (torque[:-1] < -0.1)) > 8
    assert _returns_of(torque) < EVENTS


@pytest.mark.parametrize("path", sorted(LOGS.rglob("*.npz")), ids=lambda path: path.stem)
def test_no_torque_of_a_measured_log_is_taken_for_a_magnitude(path: Path) -> None:
    with np.load(path) as columns:
        for name in columns:
            if re.match(r"(eff|tau|wcur)", name) and np.all(np.isfinite(columns[name])):
                assert _returns_of(columns[name]) < EVENTS


@pytest.mark.skipif(not SO101.is_dir(), reason="the SO-101 logs are not here")
def test_the_torques_of_a_so101_are_magnitudes() -> None:
    def of(name: str, column: str) -> Array:
        with (SO101 / f"chirp_sweep.{name}.csv").open(newline="") as file:
            return np.array([json.loads(row[column]) for row in csv.DictReader(file)])

    torques, position = of("state_motor", "torques"), of("state_motor", "positions")
    command = of("control", "positions")[: len(position)]
    assert all(_returns_of(one) >= EVENTS for one in torques.T)
    found = [_is_folded(*pair) for pair in zip((command - position).T, torques.T, strict=True)]
    assert sum(found) >= 3  # gravity pulls the others to one side


def test_returns_of_joints_count_together_where_no_torque_is_below_zero() -> None:
    """Each returns four times, which may be chance."""
    time = np.linspace(0, 1, 2000)
    torques = np.abs(np.column_stack([np.sin(4 * np.pi * time), np.cos(4 * np.pi * time)]))
    assert [_returns_of(torque) for torque in torques.T] == [4, 4]
    assert _returns([*torques.T]) == [8, 8]
    assert _returns([torques[:, 0], -torques[:, 1]]) == [4, 4]


def test_commands_that_act_early_may_be_those_of_a_velocity_gain_on_the_error() -> None:
    early, late = (commands._unusual_delay(sign * 0.04, ["j"]).message for sign in (-1, 1))
    assert "40 ms before their time" in early
    assert "command_velocity_gain" in early
    assert "command_velocity_gain" not in late
