"""Drives that get velocities and feed-forward torques next to positions, or velocities alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import seaid
from seaid._arrays import Array
from seaid.errors import LogError, RobotError
from seaid.log.commands import commanded_torque
from tests.commanded_joint import TRUTH, log_of

TIME = np.arange(0, 10, 0.005)
REFERENCE = 0.4 * np.sin(2 * np.pi * (0.1 * TIME + 0.12 * TIME**2)) + 0.2 * np.sin(2.3 * TIME)
VELOCITY = np.gradient(REFERENCE, TIME)
GRAVITY = -1.5 * 9.81 * 0.2 * np.cos(REFERENCE)
"""Feed-forward torque [N m] of a controller that compensates gravity about the y axis."""
SUPPLY = 24.0 - 3.0 * TIME / TIME[-1] - 1.5 * np.abs(np.sin(1.1 * TIME))
"""Voltage [V] of a battery that sags."""
DELAY_S = 0.006
NOISE = 5e-5
"""Standard deviation of the encoder [rad]."""


def robot_of(urdf: Path, motor_input: str = "position_command", **gains: Any) -> seaid.Robot:
    drive = seaid.StiffDrive(
        friction=("viscous", "coulomb"),
        motor_input=motor_input,  # type: ignore[arg-type]
        controller=seaid.Controller(**gains),
    )
    return seaid.load_robot(urdf, {"j": drive}, known_bodies=["arm"])


def moved(
    gains: tuple[float, float], u: Array, w: Array, f: Array, share: Array | None = None
) -> Array:
    """Return the noisy position of MuJoCo's plant under tau = K_p (u - q) + K_d (w - q') + f.

    All of it is times the `share` of a supply, and the commands are late. Euler steps would move
    the armature by K_d times half a step, 3 % at the gains of the velocity controller.
    """
    parts, step_s = 20, 2.5e-4
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{step_s}" integrator="RK4" gravity="0 0 -9.81"/>
        <worldbody><body><joint name="j" axis="0 1 0" armature="{TRUTH["motor_inertia"]}"
        damping="{TRUTH["viscous_friction"]}" frictionloss="{TRUTH["coulomb_friction"]}"
        solreffriction="-1 -16000"/>
        <inertial pos="0.2 0 0" mass="1.5" diaginertia="0.01 0.02 0.02"/></body>
        </worldbody><actuator><general joint="j" biastype="affine"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qpos[0] = u[0]
    ticks = (np.arange(len(TIME) * parts) + 0.5) * step_s  # the middle of each step
    late = [np.interp(ticks - DELAY_S, TIME, one) for one in (u, w, f)]
    factor = np.ones(len(ticks)) if share is None else np.interp(ticks, TIME, share)
    position = np.empty(len(TIME))
    for tick in range(len(ticks)):
        if tick % parts == 0:
            position[tick // parts] = data.qpos[0]
        of_command = gains[0] * late[0][tick] + gains[1] * late[1][tick] + late[2][tick]
        data.ctrl[0] = factor[tick] * of_command
        model.actuator_biasprm[0, 1:3] = -factor[tick] * np.array(gains)
        mujoco.mj_step(model, data)
    return position + np.random.default_rng(1).normal(size=len(TIME)) * NOISE


def assert_true(found: seaid.Identification, bound: float = 0.02) -> None:
    side = found.load_side
    values = dict(zip(map(str, side.names), side.values, strict=True))
    errors = dict(zip(map(str, side.names), side.standard_errors, strict=True))
    for name, truth in TRUTH.items():
        assert values[f"{name} of j"] == pytest.approx(truth, rel=bound), (name, errors)
    assert abs(values["command_delay of j"] - DELAY_S) < 3e-4


ALL: dict[str, Any] = {
    "position_gain_Nm_per_rad": 30.0,
    "velocity_gain_Nms_per_rad": 1.5,
    "command_velocity_gain_Nms_per_rad": 1.5,
}

RATES: dict[str, Any] = {
    "velocity_gain_Nms_per_rad": 6.0,
    "command_velocity_gain_Nms_per_rad": 6.0,
}


@pytest.mark.slow  # 3.0 s
@pytest.mark.usefixtures("estimates_only")
def test_positions_velocities_and_torques_are_one_command(urdf: Path) -> None:
    position = moved((30.0, 1.5), REFERENCE, VELOCITY, GRAVITY)
    sent = {"position_command": REFERENCE, "velocity_command": VELOCITY, "torque_command": GRAVITY}
    robot, log = robot_of(urdf, **ALL), log_of(position, TIME, **sent)
    found = seaid.identify(robot, log)
    assert_true(found)
    refined = seaid.refine(found, log, iterations=1)
    assert_true(refined)
    error = seaid.replay(found.robot, log).joint_position - log.joint_position
    assert float(np.sqrt(np.mean(error**2))) < 2e-4


@pytest.mark.slow  # 0.7 s
def test_a_command_that_is_left_out_shows(urdf: Path) -> None:
    """Without its feed-forward torque the friction is not that of the plant."""
    position = moved((30.0, 1.5), REFERENCE, VELOCITY, GRAVITY)
    robot = robot_of(urdf, **ALL)
    found = seaid.identify(robot, log_of(position, TIME, position_command=REFERENCE))
    assert found.load_side.residual_std > 0.5
    quiet: dict[str, Any] = {key: x for key, x in ALL.items() if not key.startswith("command")}
    log = log_of(position, TIME, position_command=REFERENCE, velocity_command=VELOCITY)
    (finding,) = (
        one
        for one in seaid.check(robot_of(urdf, **quiet), log).warnings
        if one.code == "unused-command"
    )
    assert "command_velocity_gain_Nms_per_rad = 1.5" in finding.remedy


@pytest.mark.slow  # a simulation under commands and its identification
@pytest.mark.usefixtures("estimates_only")
def test_velocity_commands_alone(urdf: Path) -> None:
    wanted = 2.5 * np.cos(2 * np.pi * (0.1 * TIME + 0.12 * TIME**2)) + 0.8 * np.cos(2.3 * TIME)
    position = moved((0.0, 6.0), np.zeros_like(TIME), wanted, np.zeros_like(TIME))
    log = log_of(position, TIME, velocity_command=wanted)
    found = seaid.identify(robot_of(urdf, "velocity_command", **RATES), log)
    assert_true(found)
    error = seaid.replay(found.robot, log).joint_position - log.joint_position
    assert float(np.sqrt(np.mean(error**2))) < 5e-3


@pytest.mark.slow  # a simulation under commands and its identification
@pytest.mark.usefixtures("estimates_only")
def test_a_supply_that_sags_scales_a_duty_cycle(urdf: Path) -> None:
    position = moved((30.0, 1.5), REFERENCE, VELOCITY, GRAVITY, SUPPLY / 24.0)
    sent = {"position_command": REFERENCE, "velocity_command": VELOCITY, "torque_command": GRAVITY}
    robot = robot_of(urdf, **ALL, nominal_supply_V=24.0, is_duty=True)
    found = seaid.identify(robot, log_of(position, TIME, **sent, supply_voltage=SUPPLY))
    assert_true(found)
    constant = seaid.identify(robot_of(urdf, **ALL), log_of(position, TIME, **sent))
    assert constant.load_side.residual_std > 3 * found.load_side.residual_std
    with pytest.raises(LogError, match=r"has nominal_supply_V, and the log has no column 'j\.supp"):
        seaid.identify(robot, log_of(position, TIME, **sent))
    with pytest.raises(LogError, match=r"is -1 V at 0\.5 s: it must be more than zero"):
        wrong = np.where(np.arange(len(TIME)) == 100, -1.0, SUPPLY)
        seaid.identify(robot, log_of(position, TIME, **sent, supply_voltage=wrong))


def test_the_limit_of_a_motor_falls_with_supply_and_speed(urdf: Path) -> None:
    gains: dict[str, Any] = {"position_gain_Nm_per_rad": 100.0, "torque_limit_Nm": 4.0}
    robot = robot_of(urdf, **gains, no_load_speed_rad_per_s=10.0, nominal_supply_V=24.0)
    supply = np.full_like(TIME, 18.0)
    moving = log_of(np.sin(TIME), TIME, position_command=np.sin(TIME) + 1.0, supply_voltage=supply)
    signals = moving.sensors()
    torque = commanded_torque(robot, TIME, signals)[0][:, 0]
    speed = np.cos(TIME)
    expected = 4.0 * np.clip(0.75 - speed / 10.0, 0.0, 0.75)
    np.testing.assert_allclose(torque[5:-5], expected[5:-5], atol=1e-4)


@pytest.mark.parametrize(
    ("motor_input", "gains", "words"),
    [
        (
            "position_command",
            {"velocity_gain_Nms_per_rad": 1.0},
            'with velocity commands alone has motor_input = "velocity_command"',
        ),
        (
            "velocity_command",
            {"position_gain_Nm_per_rad": 2.0, "command_velocity_gain_Nms_per_rad": 1.0},
            "found position_gain_Nm_per_rad = 2 and motor_input",
        ),
        (
            "velocity_command",
            {"velocity_gain_Nms_per_rad": 1.0},
            "command_velocity_gain_Nms_per_rad is missing or zero",
        ),
        ("position_command", {"is_duty": True}, "is_duty = true needs nominal_supply_V"),
        ("position_command", {"nominal_supply_V": 0.0}, "nominal_supply_V must be more than zero"),
    ],
)
def test_controllers_and_motor_inputs_that_do_not_fit(
    urdf: Path, motor_input: str, gains: dict[str, Any], words: str
) -> None:
    with pytest.raises(RobotError, match=words):
        robot_of(urdf, motor_input, **gains)


def test_a_log_keeps_all_its_commands(urdf: Path, tmp_path: Path) -> None:
    robot = robot_of(urdf, **ALL)
    sent = {"position_command": REFERENCE, "velocity_command": VELOCITY, "torque_command": GRAVITY}
    log = log_of(REFERENCE, TIME, **sent, supply_voltage=SUPPLY)
    seaid.write_log(log, tmp_path / "log.csv")
    header = (tmp_path / "log.csv").read_text().split("\n")[0]
    assert header.split(",")[2:] == [
        *("j.position_command_rad", "j.velocity_command_rad_per_s", "j.torque_command_Nm"),
        "j.supply_voltage_V",
    ]
    again = seaid.read_log(tmp_path / "log.csv", robot)
    for name, values in log.sensors().items():
        np.testing.assert_allclose(getattr(again, name), values, err_msg=name)
    described = {
        "time": "time_s",
        "joints": {
            "j": {
                "joint_position": "q",
                "position_command": "q",
                "velocity_command": {"column": "rate", "unit": "rpm"},
            }
        },
    }
    lines = [f"{t},{x},{x}" for t, x in zip(TIME, REFERENCE, strict=True)]
    text = "\n".join(["time_s,q,rate", *lines])
    (tmp_path / "custom.csv").write_text(text)
    custom = seaid.read_log(tmp_path / "custom.csv", robot, description=described)
    assert custom.velocity_command is not None
    np.testing.assert_allclose(custom.velocity_command[:, 0], REFERENCE * 2 * np.pi / 60)


@pytest.mark.slow  # a simulation under commands and its identification
def test_the_model_of_a_velocity_controller_moves_as_its_replay(urdf: Path, tmp_path: Path) -> None:
    robot = robot_of(urdf, "velocity_command", **RATES)
    drive = replace(
        robot.drives["j"],
        motor_inertia_kg_m2=0.05,
        viscous_friction_Nms_per_rad=0.1,
        coulomb_friction_Nm=0.0,
        command_delay_s=0.0,
    )
    robot = robot.with_drives({"j": drive})
    wanted = 2.0 * np.cos(2 * TIME)
    log = log_of(np.zeros_like(TIME), TIME, velocity_command=wanted)
    replayed = seaid.replay(robot, log).joint_position[:, 0]
    seaid.write_mjcf(robot, tmp_path / "one.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "one.xml"))
    data, parts = mujoco.MjData(model), round(0.005 / model.opt.timestep)
    found = np.empty(len(TIME))
    for tick in range(len(TIME)):
        found[tick] = data.qpos[0]
        for part in range(parts):
            data.ctrl[0] = np.interp(TIME[tick] + part * model.opt.timestep, TIME, wanted)
            mujoco.mj_step(model, data)
    assert float(np.max(np.abs(found - replayed))) < 0.01 * float(np.ptp(replayed))
