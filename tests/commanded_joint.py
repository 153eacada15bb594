"""A joint with a position controller: its robot, and logs of MuJoCo's own actuator."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco.rollout import rollout as mujoco_rollout

import seaid
from scripts.benchmarks import command_delays
from seaid._arrays import Array
from tests.plants import kept, log_with

URDF, TIME, CHIRP = command_delays.URDF, command_delays.TIME, command_delays.FAST
SOFT, HARD = command_delays.GAINS
"""Two gain sets: K_p [N m/rad] and K_d [N m s/rad]."""

TRUTH = {"viscous_friction": 0.12, "coulomb_friction": 0.18, "motor_inertia": 0.0243}
"""Of the MuJoCo plant at the joint: damping, friction loss and armature."""

GAINS = ("position_gain_Nm_per_rad", "velocity_gain_Nms_per_rad")


def robot_of(
    urdf: Path,
    gains: tuple[float, float] | Mapping[str, Any],
    delay_s: float | None = None,
    std_s: float = 0.0,
) -> seaid.Robot:
    """Return the robot with a known arm under two gains or a law; `delay_s` None: estimated."""
    law = dict(zip(GAINS, gains, strict=True)) if isinstance(gains, tuple) else gains
    drive = seaid.StiffDrive(
        friction=("viscous", "coulomb", "offset"),
        motor_input="position_command" if GAINS[0] in law else "velocity_command",
        controller=seaid.Controller(**law),
        command_delay_s=delay_s,
        known=() if delay_s is None else ("command_delay",),
        std={"command_delay_s": std_s} if std_s else {},
    )
    return seaid.load_robot(urdf, {"j": drive}, known_bodies=["arm"])


def log_of(position: Array, time: Array = TIME, **commands: Array) -> seaid.Log:
    """Return the log of positions (T,) and commands (T,), CHIRP if none is given."""
    sent = commands or {"position_command": CHIRP}
    return log_with("j", time, joint_position=position, **sent)


def mujoco_log(
    gains: tuple[float, float],
    delay_s: float,
    noise: float,
    seed: int,
    slope: float = 0.0,
    stiffness: float = 0.0,
) -> seaid.Log:
    """Return the log of MuJoCo's own position actuator, whose command is late.

    Friction loss grows by `slope` [N m/rad], and a spring acts parallel to the drive.
    """
    position = mujoco_positions(gains, delay_s, slope, stiffness)
    return log_of(position + np.random.default_rng(seed).normal(size=len(TIME)) * noise)


STEP_S, PARTS = 2.5e-4, 20
"""Step of the plant, and how many of them make a sample."""


def plant(integrator: str, actuator: str, joint: str) -> mujoco.MjModel:
    """Return MuJoCo's model of the arm, with more of its joint and an actuator."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{STEP_S}" integrator="{integrator}" gravity="0 0 -9.81"/>
        <worldbody><body><joint name="j" axis="0 1 0" armature="{TRUTH["motor_inertia"]}"
        damping="{TRUTH["viscous_friction"]}" frictionloss="{TRUTH["coulomb_friction"]}" {joint}/>
        <inertial pos="0.2 0 0" mass="1.5" diaginertia="0.01 0.02 0.02"/></body></worldbody>
        <actuator>{actuator}</actuator></mujoco>"""
    )


@kept
def mujoco_positions(
    gains: tuple[float, float], delay_s: float, slope: float, stiffness: float
) -> Array:
    """Return the positions at TIME."""
    servo = f'<position joint="j" kp="{gains[0]}" kv="{gains[1]}"/>'
    model = plant("implicitfast", servo, f'stiffness="{stiffness}" solreffriction="0.001 1"')
    data = mujoco.MjData(model)
    data.qpos[0] = CHIRP[0]
    ticks = np.arange(len(TIME) * PARTS) * STEP_S
    commands = np.interp(ticks - delay_s, TIME, CHIRP)
    if slope == 0:
        start = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        states, _ = mujoco_rollout(model, data, start, commands[:, None])
        # a state is that after a step, and its first number is the time
        return np.append(CHIRP[0], states[0, PARTS - 1 : -1 : PARTS, 1])

    def rub(_: int, moving: mujoco.MjData) -> None:
        model.dof_frictionloss[0] = TRUTH["coulomb_friction"] + slope * moving.qpos[0]

    return stepped(model, commands, PARTS, rub)


def stepped(
    model: mujoco.MjModel,
    commands: Array,
    parts: int,
    change: Callable[[int, mujoco.MjData], None] = lambda tick, data: None,
) -> Array:
    """Return the position (T,) before each of T samples, of `parts` steps with one command each.

    `change` is called before each step, with its number.
    """
    data, position = mujoco.MjData(model), np.empty(len(commands) // parts)
    joint, control = data.qpos, data.ctrl  # views, in loops of tens of thousands of steps
    for tick, command in enumerate(commands.tolist()):
        if tick % parts == 0:
            position[tick // parts] = joint.item(0)
        control[0] = command
        change(tick, data)
        mujoco.mj_step(model, data)
    return position


def driven(
    law: seaid.Controller,
    sent: Mapping[str, Array],
    time: Array,
    delay_s: float = 0.0,
    supply_V: Array | None = None,
) -> Array:
    """Return the position (T,) of MuJoCo's plant under a law that is computed here.

    tau = K_p (u - q) + K_d (w - q') + f, within its limits, times the share of a supply, of
    commands that are late. Euler steps would move the armature by K_d times half a step, 3 % at
    the gains of a velocity controller.
    """
    servo = '<general joint="j" biastype="affine" forcelimited="true" forcerange="-1e9 1e9"/>'
    model = plant("RK4", servo, 'solreffriction="-1 -16000"')
    ticks = (np.arange(len(time) * PARTS) + 0.5) * STEP_S - delay_s  # the middle of each step
    position, torque = (sent.get(f"{name}_command", 0.0 * time) for name in ("position", "torque"))
    velocity = sent.get("velocity_command", np.gradient(position, time))
    fed = law.command_velocity_gain_Nms_per_rad * np.interp(ticks, time, velocity)
    fed += np.interp(ticks, time, torque) + law.feedforward_Nm
    of_tick = np.maximum(np.floor(ticks * 200.0 + 1e-9).astype(int), 0)
    held = position[of_tick] if law.is_held else np.interp(ticks, time, position)
    share = np.ones(len(time)) if supply_V is None else supply_V / (law.nominal_supply_V or 1.0)
    factor = np.interp(ticks + delay_s, time, share)
    limit, no_load = law.torque_limit_Nm, law.no_load_speed_rad_per_s
    gains = np.array([law.position_gain_Nm_per_rad, law.velocity_gain_Nms_per_rad])
    bias, force = model.actuator_biasprm, model.actuator_forcerange

    def act(tick: int, data: mujoco.MjData) -> None:
        bias[0, 1:3] = -factor[tick] * gains
        if math.isfinite(limit):
            speed = data.qvel.item(0) / no_load
            force[0] = (-limit * min(max(1 + speed, 0), 1), limit * min(max(1 - speed, 0), 1))

    return stepped(model, factor * (gains[0] * held + fed), PARTS, act)


def values_of(found: seaid.Identification) -> dict[str, tuple[float, float]]:
    """Return {parameter: (value, standard error)}."""
    side = found.load_side
    names = [str(name).removesuffix(" of j") for name in side.names]
    return dict(zip(names, zip(side.values, side.standard_errors, strict=True), strict=True))


def wrong_of(robot: seaid.Robot, log: seaid.Log) -> list[seaid.Finding]:
    """Return the findings of a check but notes."""
    return [one for one in seaid.check(robot, log).warnings if one.severity != "note"]
