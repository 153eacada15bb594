"""Delay, armatures and friction of arms whose joints stick at their reversals, from commands.

A UR5 with known bodies and gravity feed-forward, and two arms of little but rotor inertia, follow
commands that come at 50 Hz and are interpolated, with Coulomb friction up to a third of the torque.
MuJoCo moves them, with a true delay of 6 ms; each log is identified at several cutoffs:

    python -m scripts.benchmarks.commanded_arms [seconds of the log] [seeds] [cutoffs in Hz]
"""

from __future__ import annotations

import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

import seaid
from scripts.example_robots import example_urdf
from scripts.short_form import few, words
from seaid._arrays import Array
from seaid.regressor import joint_torques

RATE_HZ, COMMAND_HZ, DELAY_S, NOISE_RAD = 500.0, 50.0, 6e-3, 2e-5
STEP_S, REST = 1.25e-4, (-1.0, -16000.0)
"""Step and `solreffriction` of MuJoCo, as in `command_delays`."""
ARMS = """<robot name="chain"><link name="base"/>
<link name="a"><inertial><origin xyz="0.2 0 0"/><mass value="1.5"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j0" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="50" velocity="20"/></joint>
<link name="b"><inertial><origin xyz="0.1 0 0.03"/><mass value="0.8"/>
<inertia ixx="0.004" iyy="0.008" izz="0.008" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><origin xyz="0.3 0 0"/><parent link="a"/><child link="b"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="20"/></joint></robot>"""

PARAMETERS = ("motor_inertia", "viscous_friction", "coulomb_friction")


def robots_of(folder: Path, friction: float) -> dict[str, tuple[seaid.Robot, seaid.Robot]]:
    """Return {title: (robot with the true drives, robot to be identified)}."""
    path = folder / "arms.urdf"
    path.write_text(ARMS)
    ur5 = example_urdf("ur5_robot.urdf")
    scale = {
        ur5: (
            np.array([0.9, 0.9, 0.5, 0.12, 0.09, 0.06]),
            np.array([10.0, 10.0, 6.0, 1.5, 1.2, 1.0]),
            np.array([10.0, 14.0, 8.0, 2.0, 1.6, 1.2]),
            np.array([6000.0, 8000.0, 4000.0, 800.0, 600.0, 400.0]),
        ),
        path: tuple(np.full(2, x) for x in (0.9, 6.0, 8.0, 1500.0)),
    }
    found: dict[str, tuple[seaid.Robot, seaid.Robot]] = {}
    for title, one in (("UR5", ur5), ("two arms", path)):
        joints = seaid.load_robot(one).joint_names
        true, wanted = {}, {}
        for joint, (inertia, viscous, coulomb, gain) in zip(
            joints, np.transpose(scale[one]), strict=True
        ):
            law = seaid.Controller(
                position_gain_Nm_per_rad=float(gain),
                velocity_gain_Nms_per_rad=float(gain) / 25,
            )
            drive = seaid.StiffDrive(motor_input="position_command", controller=law)
            wanted[joint] = drive
            true[joint] = replace(
                drive,
                motor_inertia_kg_m2=inertia,
                viscous_friction_Nms_per_rad=viscous,
                coulomb_friction_Nm=friction * coulomb,
                command_delay_s=DELAY_S,
            )
        plant, robot = (seaid.load_robot(one, x, known_bodies="all") for x in (true, wanted))
        found[title] = plant, robot
    return found


def log_of(true: seaid.Robot, seconds: float, seed: int, folder: Path) -> seaid.Log:
    """Return the log of MuJoCo's plant, whose commands are sums of four tones a joint."""
    rng = np.random.default_rng(seed)
    time: Array = np.arange(float(round(seconds * RATE_HZ))) / RATE_HZ
    amplitude = rng.uniform(0.1, 0.25, (true.n, 4))
    frequency = rng.uniform(0.08, 0.8, (true.n, 4))
    phase = rng.uniform(0, 2 * np.pi, (true.n, 4))

    def command(at: Array) -> Array:
        sent = np.arange(-1.0, seconds * COMMAND_HZ + 2) / COMMAND_HZ
        angle = 2 * np.pi * frequency * sent[:, None, None] + phase
        values = np.sum(amplitude * np.sin(angle), axis=2)
        return np.column_stack([np.interp(at, sent, one) for one in values.T])

    def weight(q: Array) -> Array:
        return joint_torques(true, q, np.zeros_like(q), np.zeros_like(q))

    has_feedforward = true.n > 2
    middle: Array = (np.arange(float(round(seconds / STEP_S))) + 0.5) * STEP_S - DELAY_S
    sent = command(middle)
    parts = round(1 / (RATE_HZ * STEP_S))
    feed = weight(command(time))
    laws = [true.drives[joint].law for joint in true.joint_names]
    gains = np.array([law.position_gain_Nm_per_rad for law in laws if law is not None])
    if has_feedforward:
        sent += np.column_stack([np.interp(middle, time, one) for one in feed.T]) / gains
    model = _plant(true, folder)
    data, places = mujoco.MjData(model), [model.joint(x).qposadr[0] for x in true.joint_names]
    data.qpos[places] = command(time[:1])[0]
    found = np.empty((len(time), true.n))
    for tick, ctrl in enumerate(sent):
        if tick % parts == 0:
            found[tick // parts] = data.qpos[places]
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data)
    unknown = np.full_like(found, np.nan)
    return seaid.Log(
        time=time,
        joint_names=true.joint_names,
        joint_position=found + rng.normal(scale=NOISE_RAD, size=found.shape),
        motor_position=unknown,
        motor_torque=unknown,
        position_command=command(time),
        torque_command=feed if has_feedforward else None,
        is_prismatic=true.is_prismatic,
    )


def _plant(true: seaid.Robot, folder: Path) -> mujoco.MjModel:
    """Return MuJoCo's model of a robot, with position actuators in the order of its joints."""
    plain = seaid.StiffDrive(friction=(), motor_inertia_kg_m2=0.0)
    bare = true.with_drives(dict.fromkeys(true.joint_names, plain))
    seaid.write_mjcf(bare, folder / "plant.xml")
    spec = mujoco.MjSpec.from_file(str(folder / "plant.xml"))
    for one in list(spec.actuators):
        spec.delete(one)
    spec.option.timestep, spec.option.integrator = STEP_S, mujoco.mjtIntegrator.mjINT_RK4
    for joint in true.joint_names:
        law = true.drives[joint].law
        assert law is not None
        gain, damping = law.position_gain_Nm_per_rad, law.velocity_gain_Nms_per_rad
        actuator = spec.add_actuator(target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=gain, kv=damping)
    model = spec.compile()
    for joint in true.joint_names:
        place, values = model.joint(joint).dofadr[0], true.drives[joint].values
        model.dof_armature[place], model.dof_damping[place] = (values[x] for x in PARAMETERS[:2])
        model.dof_frictionloss[place] = values[PARAMETERS[2]]
        model.dof_solref[place] = REST
    return model


def main(seconds: float, seeds: int, cutoffs: list[float]) -> None:
    """Print the table."""
    print("| arm | friction | seed | cutoff | delay [ms] | armature | viscous | Coulomb |")
    with tempfile.TemporaryDirectory() as name:
        for friction in few((1.0, 0.1)):
            for title, (true, robot) in few(robots_of(Path(name), friction).items()):
                for seed in range(1, seeds + 1):
                    log = log_of(true, seconds, seed, Path(name))
                    for cutoff_hz in (None, *cutoffs):
                        found = seaid.identify(robot, log, cutoff_hz=cutoff_hz)
                        print(f"{title} | {friction:g} | {seed} | {_row(found, true)}", flush=True)


def _row(found: seaid.Identification, true: seaid.Robot) -> str:
    """Return cutoff, delay and the largest relative errors of all joints."""
    side = found.load_side
    delay = next(k for k, one in enumerate(side.names) if str(one).startswith("command_delay"))
    values = found.robot.drives
    worst = [
        max(abs(values[x].values[name] / true.drives[x].values[name] - 1) for x in true.joint_names)
        for name in PARAMETERS
    ]
    return (
        f"{found.cutoff_hz:.1f} Hz | {1e3 * side.values[delay]:.3f} +- "
        f"{1e3 * side.standard_errors[delay]:.3f} | " + " | ".join(f"{x:.1%}" for x in worst)
    )


if __name__ == "__main__":
    numbers = [float(one) for one in words()]
    seconds, seeds = numbers[0] if numbers else 20.0, numbers[1] if len(numbers) > 1 else 1
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    main(seconds, int(seeds), numbers[2:])
