"""Coverage of the intervals from position commands of unknown delay, with one and two gain sets.

A pendulum with armature, viscous and Coulomb friction follows commands by its controller; each draw
has its own friction, armature, delay and encoder noise. All draws are simulated at once, with steps
of 0.05 ms; or one by one by MuJoCo, with its position actuator, integrator and friction loss.
Prints how many of the 95 % intervals contain the truth, also that of armature + (K_d + F_v) delay,
and the errors:

    python -m scripts.benchmarks.command_delays [draws] [mujoco]
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco
import numpy as np

import seaid
from scripts.short_form import few, sized, words
from seaid._arrays import Array

URDF = """<robot name="one"><link name="base"/><link name="arm"><inertial><origin xyz="0.2 0 0"/>
<mass value="1.5"/><inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
</link><joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="50" velocity="20"/></joint></robot>"""
BODY, WEIGHT = 0.02 + 1.5 * 0.2**2, 1.5 * 9.81 * 0.2
GAINS = ((40.0, 1.0), (20.0, 3.0))
STEP_S, PARTS = 5e-5, 100
TIME = np.arange(0, sized(20, 3), STEP_S * PARTS)
NAMES = ("motor_inertia", "viscous_friction", "coulomb_friction", "command_delay")
FAST = 0.4 * np.sin(2 * np.pi * (0.1 * TIME + 0.0625 * TIME**2)) + 0.2 * np.sin(2.3 * TIME)
SLOW = 0.3 * np.sin(2 * np.pi * 0.15 * TIME) + 0.15 * np.sin(2 * np.pi * 0.26 * TIME + 1)


Plant = Callable[[tuple[float, float], dict[str, Array], Array], Array]


def truths(draws: int, rng: np.random.Generator, delay_s: Array) -> dict[str, Array]:
    """Return the values of the parameters of each draw."""
    return dict(
        zip(
            NAMES,
            (*(x * rng.uniform(0.7, 1.4, draws) for x in (0.0243, 0.12, 0.18)), delay_s),
            strict=True,
        )
    )


def motion(gains: Sequence[float | Array], truth: dict[str, Array], command: Array) -> Array:
    """Return the positions (T, draws): velocity Verlet, with friction that may stick.

    The two gains, of position and velocity, are numbers or (draws,).
    """
    inertia, viscous, coulomb, delay = (truth[name] for name in NAMES)
    inertia = BODY + inertia
    q, v = np.full(len(delay), command[0]), np.zeros(len(delay))
    found = np.empty((len(TIME), len(delay)))
    for tick in range(len(TIME)):
        found[tick] = q
        for part in range(PARTS):
            q = q + STEP_S / 2 * v
            at = TIME[tick] + (part + 0.5) * STEP_S
            wanted = gains[0] * (np.interp(at - delay, TIME, command) - q) + WEIGHT * np.cos(q)
            # (I + h/2 D) v+ = (I - h/2 D) v + h (tau - friction): the trapezoidal rule
            damping = STEP_S / 2 * (gains[1] + viscous)
            free = (inertia - damping) * v + STEP_S * wanted
            v = np.sign(free) * np.maximum(np.abs(free) - STEP_S * coulomb, 0.0)
            v = v / (inertia + damping)
            q = q + STEP_S / 2 * v
    return found


MUJOCO_STEP_S = 1.25e-4
"""Step of MuJoCo's Runge-Kutta integrator, with the command of the middle of a step.

Friction loss is a soft constraint, which changes its sign 1/b before the speed does: 0.06 ms with
`solreffriction="-1 -16000"`, 0.5 ms with "0.001 1" (a time constant of 1 ms). Integrators of first
order are late: with `implicitfast`, steps of 0.25 ms and the command of their start, the plant is
0.07 ms later than its parameters say, which is 14 standard errors."""


def mujoco_motion(gains: tuple[float, float], truth: dict[str, Array], command: Array) -> Array:
    """Return the positions (T, draws) of MuJoCo's plants."""
    inertia, viscous, coulomb, delay = (truth[name] for name in NAMES)
    parts = round((TIME[1] - TIME[0]) / MUJOCO_STEP_S)
    middle = (np.arange(len(TIME) * parts) + 0.5) * MUJOCO_STEP_S
    found = np.empty((len(TIME), len(delay)))
    for draw in range(len(delay)):
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{MUJOCO_STEP_S}" integrator="RK4"
            gravity="0 0 -9.81"/><worldbody><body><joint name="j" axis="0 1 0"
            armature="{inertia[draw]}" damping="{viscous[draw]}" frictionloss="{coulomb[draw]}"
            solreffriction="-1 -16000"/><inertial pos="0.2 0 0" mass="1.5"
            diaginertia="0.01 0.02 0.02"/></body></worldbody><actuator>
            <position joint="j" kp="{gains[0]}" kv="{gains[1]}"/></actuator></mujoco>"""
        )
        data = mujoco.MjData(model)
        data.qpos[0] = command[0]
        for tick, wanted in enumerate(np.interp(middle - delay[draw], TIME, command)):
            if tick % parts == 0:
                found[tick // parts, draw] = data.qpos[0]
            data.ctrl[0] = wanted
            mujoco.mj_step(model, data)
    return found


def robot_of(path: Path, gains: tuple[float, float]) -> seaid.Robot:
    """Return the robot with unknown drive and delay."""
    controller = seaid.Controller(
        position_gain_Nm_per_rad=gains[0], velocity_gain_Nms_per_rad=gains[1]
    )
    drive = seaid.StiffDrive(
        friction=("viscous", "coulomb"), motor_input="position_command", controller=controller
    )
    return seaid.load_robot(path, {"j": drive}, known_bodies=["arm"])


def log_of(position: Array, command: Array) -> seaid.Log:
    """Return the log of one draw."""
    unknown = np.full((len(TIME), 1), np.nan)
    return seaid.Log(
        time=TIME,
        joint_names=("j",),
        joint_position=position[:, None],
        motor_position=unknown,
        motor_torque=unknown,
        position_command=command[:, None],
    )


def study(
    path: Path, title: str, sets: int, command: Array, noise: float, draws: int, plant: Plant
) -> None:
    """Print the row of a case."""
    rng = np.random.default_rng(7)
    delays = rng.uniform(0, 0.02, draws)
    if title.startswith("stated"):
        delays = rng.normal(0, 0.0125 / 1.96, draws)
    truth = truths(draws, rng, delays)
    moved = [plant(gains, truth, command) for gains in GAINS[:sets]]
    inside, errors, combined, covered = np.zeros(4), [], [], 0
    for draw in range(draws):
        logs = [log_of(one[:, draw] + noise * rng.normal(size=len(TIME)), command) for one in moved]
        robots = [robot_of(path, gains) for gains in GAINS[:sets]]
        if sets == 1:
            side = seaid.identify(robots[0], logs[0]).load_side
        else:
            conditions = {f"{k}": pair for k, pair in enumerate(zip(robots, logs, strict=True))}
            found = seaid.identify_conditions(conditions, condition_specific=())
            side = found.identifications["0"].load_side
        true = np.array([truth[name][draw] for name in NAMES])
        places = [list(map(str, side.names)).index(f"{name} of j") for name in NAMES]
        lower, upper = side.interval()[places].T
        inside += (lower <= true) & (true <= upper)
        values = side.values[places]
        errors.append(np.abs(values - true) / np.where(np.array(NAMES) == NAMES[3], 1e-3, true))
        sums = [one[0] + (GAINS[0][1] + true[1]) * one[3] for one in (values, true)]
        combined.append(abs(sums[0] / sums[1] - 1))
        both = side.covariance[np.ix_([places[0], places[3]], [places[0], places[3]])]
        slopes = np.array([1.0, GAINS[0][1] + true[1]])
        covered += abs(sums[0] - sums[1]) <= 1.96 * np.sqrt(slopes @ both @ slopes)
    worst = np.quantile(errors, 0.95, axis=0)
    print(
        f"{title} | "
        + " | ".join(f"{x:.0%}" for x in inside / draws)
        + f" | {worst[0]:.1%} | {worst[1]:.1%} | {worst[2]:.1%} | {worst[3]:.2f} | "
        f"{np.quantile(combined, 0.95):.1%} | {covered / draws:.0%}",
        flush=True,
    )


def main(draws: int, plant: Plant) -> None:
    """Print the table."""
    print(
        "| case | armature | viscous | Coulomb | delay | 95 % of errors: armature | viscous "
        "| Coulomb | delay [ms] | combination | its coverage |"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "one.urdf"
        path.write_text(URDF)
        cases = (
            ("two gain sets, chirp, 0 to 20 ms", 2, FAST, 2e-4),
            ("one gain set, chirp, 0 to 20 ms", 1, FAST, 2e-4),
            ("stated range, one gain set, slow", 1, SLOW, 1e-3),
            ("stated range, one gain set, slow, little noise", 1, SLOW, 1e-4),
        )
        for case in few(cases):
            study(path, *case, draws, plant)


if __name__ == "__main__":
    numbers = [int(one) for one in words() if one.isdigit()]
    main(numbers[0] if numbers else 100, mujoco_motion if "mujoco" in sys.argv else motion)
