"""Robots on which nobody tuned seaid: what they truly are, their motion by MuJoCo, and their logs.

A plant is a serial chain of joints with drives. Its MJCF is written here, and not by seaid: a
rotor is a body of its own whose coordinate is the motor angle, with the rotor inertia as armature,
and the spring is a fixed tendon of length (r_M/N) theta_M - r_L theta_L, the deflection of (3). The
user's files have the true geometry and ratios; masses, centres and inertias are off by 10 to 30 %.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco.rollout import rollout

from seaid._arrays import Array

STEP_S, SETTLE_S, RAMP_S = 1e-4, 2.0, 1.0
"""Step of RK4; standstill before the log; smooth beginning and end of each motion."""
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
STICKING_PER_S = 5000.0
"""Damping of MuJoCo's sticking. A rotor slides above F_C / I_M over this, 0.1 % of its speed."""
BANDWIDTH_HZ, DAMPING_RATIO = 5.0, 0.7
"""Of the position controllers, on the inertia that the motor feels at rest."""


@dataclass(frozen=True)
class Drive:
    """The true drive of a joint, in the units of a drive TOML.

    The spring acts if `stiffness` is not zero. `motor_inertia_known` puts I_M in the user's file.
    """

    ratio: float
    motor_inertia: float
    viscous: float
    coulomb: float
    stiffness: float = 0.0
    cubic: float = 0.0
    motor_radius: float = 1.0
    load_radius: float = 1.0
    motor_inertia_known: bool = False

    @property
    def lever(self) -> float:
        """Deflection of the spring per motor angle, r_M/N, or that of the joint if it is stiff."""
        return self.motor_radius / self.ratio


@dataclass(frozen=True)
class Joint:
    """A joint, the body behind it, and the range of its motion [m, kg, kg m^2, rad or m]."""

    name: str
    axis: str
    origin: str
    centre: tuple[float, float, float]
    mass: float
    inertia: tuple[float, float, float]
    middle: float
    reach: float
    drive: Drive
    is_prismatic: bool = False


@dataclass(frozen=True)
class Plant:
    """A chain of joints, and the sensors and the band of the motion of its log."""

    title: str
    joints: tuple[Joint, ...]
    rate_hz: float = 1000.0
    duration_s: float = 20.0
    tones_hz: tuple[float, float] = (0.1, 1.2)
    joint_bits: int = 17
    motor_counts: float = 4096.0
    torque_noise: float = 0.01
    homed_within_rad: float = np.pi
    """Motor encoders were set to zero within this of the zero of the joint."""


@dataclass(frozen=True, eq=False)
class Run:
    """Joint and motor angles and motor torques (T, n) by MuJoCo, at the instants of a log (T,)."""

    time: Array
    joint_position: Array
    motor_position: Array
    motor_torque: Array


Friction = tuple[float, float]
"""Viscous and Coulomb friction of a motor [N m s/rad, N m]."""


def _elastic(ratio: float, inertia: float, friction: Friction, k: float, **more: Any) -> Drive:
    """Return a drive with a spring, whose rotor inertia is to be identified."""
    return Drive(ratio, inertia, *friction, stiffness=k, **more)


def _stiff(ratio: float, inertia: float, friction: Friction) -> Drive:
    """Return a drive without a spring, whose rotor inertia is in its data sheet."""
    return Drive(ratio, inertia, *friction, motor_inertia_known=True)


LEG = Plant(
    "leg with a weak ankle",
    (
        Joint("knee", "0 1 0", "0 0 0", (0.01, 0.005, -0.18), 3.2, (0.035, 0.035, 0.006),
              0.2, 0.5, _elastic(80, 2.5e-5, (2e-4, 6e-3), 1500)),
        Joint("ankle", "0 1 0", "0 0 -0.4", (0.1, 0.01, -0.05), 1.5, (0.003, 0.009, 0.008),
              0.0, 0.5, _elastic(60, 8e-6, (5e-5, 3e-3), 300)),
    ),
)  # fmt: skip
GANTRY = Plant(
    "gantry of a ball screw with a spring",
    (
        Joint("cart", "1 0 0", "0 0 1", (0.02, 0, 0.05), 8.0, (0.05, 0.06, 0.05),
              0.0, 0.2, _elastic(1, 2e-5, (3e-4, 8e-3), 4e4, motor_radius=0.02 / (2 * np.pi)),
              is_prismatic=True),
        Joint("swing", "0 1 0", "0 0 -0.1", (0.0, 0.0, -0.25), 1.6, (0.02, 0.02, 0.002),
              0.3, 0.7, _elastic(50, 1.5e-5, (1e-4, 4e-3), 200)),
    ),
    tones_hz=(0.2, 1.5),
)  # fmt: skip
ONE_SIDED = Plant(
    "shoulder that gravity loads to one side",
    (
        Joint("shoulder", "0 1 0", "0 0 1", (0.22, 0.01, 0.02), 2.6, (0.004, 0.03, 0.03),
              0.0, 0.5, _elastic(90, 4e-5, (3e-4, 0.012), 800)),
        Joint("elbow", "0 1 0", "0.4 0 0", (0.18, 0, 0), 1.1, (0.002, 0.012, 0.012),
              0.1, 0.6, _elastic(70, 1e-5, (1e-4, 4e-3), 400)),
    ),
    joint_bits=16,
)  # fmt: skip
STIFF_SPRINGS = Plant(
    "very stiff springs",
    (
        Joint("lift", "0 1 0", "0 0 1", (0.25, 0.0, 0.03), 12.0, (0.05, 0.3, 0.3),
              -0.4, 0.7, _elastic(100, 1.2e-4, (1e-3, 0.08), 2e4)),
        Joint("reach", "0 1 0", "0.5 0 0", (0.2, 0.02, 0), 7.0, (0.02, 0.12, 0.12),
              0.5, 0.8, _elastic(100, 6e-5, (6e-4, 0.03), 2e4)),
    ),
    joint_bits=19, motor_counts=8192, torque_noise=0.005,
)  # fmt: skip
SOFT_WRIST = Plant(
    "soft wrist of a light hand",
    (
        Joint("elbow", "0 1 0", "0 0 0", (0.01, 0, -0.15), 1.3, (0.012, 0.012, 0.002),
              0.3, 0.7, _elastic(60, 1e-5, (6e-5, 3e-3), 250)),
        Joint("wrist", "1 0 0", "0 0 -0.28", (0.005, 0.01, -0.07), 0.25, (3e-4, 3e-4, 1e-4),
              0.3, 0.8, _elastic(30, 1e-6, (3e-6, 5e-4), 15)),
    ),
    torque_noise=0.02,
)  # fmt: skip
EXO = Plant(
    "exoskeleton knee with pulleys",
    (
        Joint("hip", "0 1 0", "0 0 1", (0.02, 0.03, -0.2), 4.5, (0.06, 0.06, 0.01),
              0.1, 0.5, _stiff(50, 1.2e-4, (6e-4, 0.03))),
        Joint("knee", "0 1 0", "0 0 -0.42", (0.0, 0.02, -0.2), 2.4, (0.03, 0.03, 0.004),
              0.6, 0.6, _elastic(40, 3e-5, (2e-4, 6e-3), 9e4, motor_radius=0.018,
                                 load_radius=0.045)),
    ),
    rate_hz=500.0, joint_bits=14,
)  # fmt: skip
DIRECT = Plant(
    "direct drive, then a spring",
    (
        Joint("swivel", "0 1 0", "0 0 1", (0.0, 0.02, -0.15), 1.8, (0.015, 0.015, 0.003),
              0.0, 0.7, _stiff(1, 2e-3, (0.02, 0.1))),
        Joint("elbow", "1 0 0", "0 0 -0.3", (0.01, 0, -0.16), 1.0, (0.01, 0.01, 0.001),
              0.2, 0.7, _elastic(50, 1.2e-5, (1e-4, 2e-3), 350)),
    ),
    joint_bits=18,
)  # fmt: skip
HEAVY_FRICTION = Plant(
    "gear with Coulomb friction of 30 %",
    (
        Joint("first", "0 1 0", "0 0 1", (0.0, 0.01, -0.25), 3.0, (0.03, 0.03, 0.004),
              0.4, 0.7, _elastic(100, 5e-5, (3e-4, 0.03), 1200)),
        Joint("second", "0 1 0", "0 0 -0.4", (0.02, 0, -0.15), 1.4, (0.01, 0.01, 0.002),
              0.5, 0.7, _elastic(80, 1.5e-5, (1e-4, 0.008), 500)),
    ),
    torque_noise=0.02,
)  # fmt: skip
HARMONIC = Plant(
    "harmonic gears, rotors heavier than links",
    (
        Joint("pan", "0 0 1", "0 0 0.3", (0.12, 0.01, 0.05), 3.0, (0.02, 0.03, 0.03),
              0.0, 1.0, _elastic(160, 6e-5, (2e-4, 0.03), 6000)),
        Joint("tilt", "0 1 0", "0.1 0 0.15", (0.2, 0.0, 0.04), 4.0, (0.01, 0.03, 0.03),
              -0.3, 0.8, _elastic(160, 4e-5, (2e-4, 0.015), 4000)),
    ),
    joint_bits=19, torque_noise=0.005,
)  # fmt: skip
HARDENING = Plant(
    "spring that hardens",
    (
        Joint("upper", "0 1 0", "0 0 1", (0.0, 0.01, -0.22), 3.4, (0.04, 0.04, 0.005),
              0.1, 0.8, _elastic(90, 3e-5, (2e-4, 0.01), 250, cubic=5e4)),
        Joint("lower", "0 1 0", "0 0 -0.4", (0.01, 0, -0.15), 1.4, (0.012, 0.012, 0.002),
              0.4, 0.7, _elastic(70, 1e-5, (1e-4, 4e-3), 400)),
    ),
    homed_within_rad=0.2,
)  # fmt: skip
HOPPER = Plant(
    "hopping leg held in the air",
    (
        Joint("roll", "1 0 0", "0 0 1", (0.02, 0.03, -0.04), 1.2, (0.004, 0.004, 0.003),
              0.0, 0.4, _elastic(50, 6e-5, (3e-4, 0.02), 900)),
        Joint("pitch", "0 1 0", "0 0.06 -0.08", (0.0, 0.01, -0.15), 3.5, (0.03, 0.03, 0.006),
              0.3, 0.6, _elastic(50, 6e-5, (3e-4, 0.02), 700)),
        Joint("knee", "0 1 0", "0 0 -0.33", (0.0, 0.0, -0.16), 1.1, (0.009, 0.009, 0.001),
              -0.7, 0.6, _elastic(50, 3e-5, (2e-4, 0.008), 500)),
    ),
    tones_hz=(0.2, 2.0),
)  # fmt: skip
SCARA = Plant(
    "SCARA on a ball screw",
    (
        Joint("slide", "0 0 1", "0 0 0.4", (0.05, 0, 0.02), 4.0, (0.03, 0.03, 0.03),
              0.0, 0.15, _stiff(2 * np.pi / 0.01, 3e-5, (2e-4, 0.03)), is_prismatic=True),
        Joint("inner", "0 0 1", "0.1 0 0", (0.18, 0.01, 0.03), 3.0, (0.01, 0.05, 0.05),
              0.0, 1.0, _elastic(80, 4e-5, (4e-4, 0.015), 1500)),
        Joint("outer", "0 0 1", "0.35 0 0", (0.14, 0, 0), 1.8, (0.004, 0.025, 0.025),
              0.5, 1.2, _elastic(50, 2e-5, (2e-4, 6e-3), 700)),
    ),
    duration_s=25.0,
)  # fmt: skip
MIXED = Plant(
    "arm of two springs and two stiff joints",
    (
        Joint("yaw", "0 0 1", "0 0 0.2", (0.02, 0.01, 0.1), 4.0, (0.03, 0.03, 0.02),
              0.0, 1.0, _stiff(100, 4e-5, (4e-4, 0.02))),
        Joint("shoulder", "0 1 0", "0 0.1 0.15", (0.2, 0.03, 0.0), 3.5, (0.01, 0.06, 0.06),
              -0.5, 0.7, _elastic(120, 5e-5, (4e-4, 0.02), 3000)),
        Joint("elbow", "0 1 0", "0.4 0 0", (0.16, 0.0, 0.02), 2.0, (0.005, 0.03, 0.03),
              0.8, 0.8, _elastic(100, 3e-5, (2e-4, 0.01), 1200)),
        Joint("wrist", "1 0 0", "0.33 0 0", (0.05, 0.03, 0.0), 0.7, (0.001, 0.002, 0.002),
              0.0, 1.2, _stiff(50, 4e-6, (3e-5, 3e-3))),
    ),
    duration_s=25.0,
)  # fmt: skip
ARM = Plant(
    "arm of six springs",
    (
        Joint("j1", "0 0 1", "0 0 0.3", (0.01, -0.03, 0.05), 6.0, (0.05, 0.05, 0.04),
              0.0, 1.0, _elastic(100, 1e-4, (8e-4, 0.05), 8000)),
        Joint("j2", "0 1 0", "0 0.1 0.1", (0.2, 0.05, 0.01), 5.0, (0.02, 0.1, 0.1),
              -0.8, 0.7, _elastic(120, 1e-4, (8e-4, 0.05), 8000)),
        Joint("j3", "0 1 0", "0.42 0 0", (0.12, -0.04, 0.02), 3.0, (0.01, 0.04, 0.04),
              1.2, 0.8, _elastic(100, 5e-5, (4e-4, 0.02), 4000)),
        Joint("j4", "1 0 0", "0.25 0 0.03", (0.08, 0.01, 0.02), 1.5, (0.003, 0.006, 0.006),
              0.2, 1.2, _elastic(80, 1e-5, (1e-4, 6e-3), 800)),
        Joint("j5", "0 1 0", "0.18 0 0", (0.04, 0.01, -0.03), 1.0, (0.002, 0.002, 0.0015),
              0.5, 1.0, _elastic(80, 8e-6, (6e-5, 5e-3), 600)),
        Joint("j6", "1 0 0", "0.08 0 0", (0.04, 0.03, 0.03), 0.6, (0.001, 0.001, 0.0008),
              0.0, 1.4, _elastic(50, 4e-6, (3e-5, 2e-3), 300)),
    ),
    duration_s=30.0, joint_bits=19,
)  # fmt: skip

PLANTS = (
    LEG,
    GANTRY,
    ONE_SIDED,
    STIFF_SPRINGS,
    SOFT_WRIST,
    EXO,
    DIRECT,
    HEAVY_FRICTION,
    HARMONIC,
    HARDENING,
    HOPPER,
    SCARA,
    MIXED,
    ARM,
)
"""The plants, the arm of six joints last."""


def generator(plant: Plant, seed: int) -> np.random.Generator:
    """Return the random numbers of a plant, which no other plant has.

    With one noise for all plants their errors would not be independent: of the first drives most
    had the viscous friction off to one side, of the second ones to the other.
    """
    return np.random.default_rng([seed, zlib.crc32(plant.title.encode())])


def urdf_of(plant: Plant, rng: np.random.Generator | None = None) -> str:
    """Return the URDF: the true one, or by a generator one with bodies off by 10 to 30 %."""

    def off() -> float:
        return 1.0 if rng is None else 1 + float(rng.choice([-1, 1]) * rng.uniform(0.1, 0.3))

    rows, parent = ['<robot name="unseen"><link name="base"/>'], "base"
    for joint in plant.joints:
        mass, place, size = off(), off(), off()
        centre = " ".join(f"{place * x:.9g}" for x in joint.centre)
        Ixx, Iyy, Izz = (size * x for x in joint.inertia)
        low, high = joint.middle - 1.2 * joint.reach, joint.middle + 1.2 * joint.reach
        kind = "prismatic" if joint.is_prismatic else "revolute"
        rows.append(
            f'''<joint name="{joint.name}" type="{kind}"><parent link="{parent}"/>
<child link="{joint.name}_link"/><origin xyz="{joint.origin}"/><axis xyz="{joint.axis}"/>
<limit lower="{low:.6g}" upper="{high:.6g}" velocity="20" effort="500"/></joint>
<link name="{joint.name}_link"><inertial><origin xyz="{centre}"/>
<mass value="{mass * joint.mass:.9g}"/>
<inertia ixx="{Ixx:.9g}" iyy="{Iyy:.9g}" izz="{Izz:.9g}" ixy="0" ixz="0" iyz="0"/>
</inertial></link>'''
        )
        parent = f"{joint.name}_link"
    return "\n".join([*rows, "</robot>"])


def drives_toml(plant: Plant) -> str:
    """Return the drives as a user states them: types, ratios, radii, and data of stiff motors."""
    rows = []
    for joint in plant.joints:
        drive, table = joint.drive, [f"[{joint.name}]"]
        table.append(f'type = "{"series_elastic" if drive.stiffness else "stiff"}"')
        unit = "_rad_per_m" if joint.is_prismatic and not drive.stiffness else ""
        table.append(f"gear_ratio{unit} = {float(drive.ratio)!r}")
        if drive.motor_radius != 1:
            table.append(f"motor_pulley_radius_m = {drive.motor_radius!r}")
        if drive.load_radius != 1:
            table.append(f"load_pulley_radius_m = {drive.load_radius!r}")
        if drive.motor_inertia_known:
            table.append(f"motor_inertia_kg_m2 = {drive.motor_inertia!r}")
        if drive.cubic:
            table.append('spring = ["linear", "cubic"]')
        rows.append("\n".join(table))
    return "\n\n".join(rows) + "\n"


def _mjcf(plant: Plant) -> str:
    """Return the MJCF, with position actuators whose gains are set in `_with_gains`."""
    bodies, tendons, actuators, sensors = "", "", "", ""
    for joint in reversed(plant.joints):
        drive, name = joint.drive, joint.name
        moved, rotor, side = name, "", _motor_side(drive, drive.ratio)
        if drive.stiffness:
            moved, side = f"{name}_motor", ""
            rotor = (
                f'<body pos="{joint.origin}"><joint name="{moved}" axis="{joint.axis}" '
                f"{_motor_side(drive)}/>"
                '<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-14 1e-14 1e-14"/></body>'
            )
            tendons += (
                f'<fixed stiffness="{drive.stiffness} 0 {drive.cubic}" springlength="0">'
                f'<joint joint="{moved}" coef="{drive.lever!r}"/>'
                f'<joint joint="{name}" coef="{-drive.load_radius}"/></fixed>'
            )
        centre, inertia = (" ".join(map(str, x)) for x in (joint.centre, joint.inertia))
        bodies = (
            f'{rotor}<body pos="{joint.origin}"><joint name="{name}" axis="{joint.axis}" '
            f'type="{"slide" if joint.is_prismatic else "hinge"}" {side}/><inertial '
            f'pos="{centre}" mass="{joint.mass}" diaginertia="{inertia}"/>{bodies}</body>'
        )
        actuators = f'<position name="{name}" joint="{moved}" kp="1" kv="1"/>{actuators}'
        sensors = (
            f'<jointpos joint="{name}"/><jointpos joint="{moved}"/>'
            f'<actuatorfrc actuator="{name}"/>{sensors}'
        )
    return (
        f'<mujoco><option timestep="{STEP_S}" integrator="RK4"/><worldbody>{bodies}</worldbody>'
        f"<tendon>{tendons}</tendon><actuator>{actuators}</actuator>"
        f"<sensor>{sensors}</sensor></mujoco>"
    )


def _motor_side(drive: Drive, N: float = 1.0) -> str:
    """Return the attributes of a joint of MJCF for a motor: N^2 I_M, N^2 F_v, N F_C."""
    inertia, damping, loss = N**2 * drive.motor_inertia, N**2 * drive.viscous, N * drive.coulomb
    return (
        f'armature="{inertia!r}" damping="{damping!r}" frictionloss="{loss!r}" '
        f'solreffriction="-1 {-STICKING_PER_S}"'
    )


def _reference(plant: Plant, time: Array, rng: np.random.Generator) -> Array:
    """Return the reference of the joints (T, n), sums of six tones from rest to rest."""
    low, high = plant.tones_hz
    envelope = np.clip(np.minimum(time, plant.duration_s - time) / RAMP_S, 0, 1)
    envelope = envelope**3 * (10 - 15 * envelope + 6 * envelope**2)
    columns = []
    for joint in plant.joints:
        frequency, phase = rng.uniform(low, high, 6), rng.uniform(0, 2 * np.pi, 6)
        tones = np.sin(2 * np.pi * frequency * time[:, None] + phase) / np.sqrt(frequency)
        wave = envelope * np.sum(tones, axis=1)
        columns.append(joint.middle + joint.reach * wave / np.max(np.abs(wave)))
    return np.column_stack(columns)


def _with_gains(plant: Plant, model: Any) -> Any:
    """Return data at rest in the middle, after the gains were set for the inertias there."""
    data, omega = mujoco.MjData(model), 2 * np.pi * BANDWIDTH_HZ
    for joint in plant.joints:
        data.joint(joint.name).qpos = joint.middle
        if joint.drive.stiffness:
            angle = joint.middle * joint.drive.load_radius / joint.drive.lever
            data.joint(f"{joint.name}_motor").qpos = angle
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    for joint in plant.joints:
        place, actuator = model.joint(joint.name).dofadr[0], model.actuator(joint.name).id
        felt = float(inertia[place, place])  # with the armature of a stiff motor
        if joint.drive.stiffness:
            felt *= (joint.drive.lever / joint.drive.load_radius) ** 2
            felt += joint.drive.motor_inertia
        gain, damping = felt * omega**2, 2 * DAMPING_RATIO * omega * felt
        model.actuator_gainprm[actuator, 0] = gain
        model.actuator_biasprm[actuator, 1:3] = -gain, -damping
    return data


def simulated(plant: Plant, seed: int) -> Run:
    """Return the true motion that MuJoCo computes at the rate of the log."""
    model: Any = mujoco.MjModel.from_xml_string(_mjcf(plant))
    data = _with_gains(plant, model)
    time: Array = np.arange(float(round(plant.duration_s / STEP_S))) * STEP_S
    control = _reference(plant, time, generator(plant, seed))
    drives = [joint.drive for joint in plant.joints]
    control *= [x.load_radius / x.lever if x.stiffness else 1.0 for x in drives]
    # Without damping a load would still swing on its spring, while friction holds the motor.
    model.tendon_damping[:] = SETTLE_S / 100 * model.tendon_stiffness
    start = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, start, STATE)
    settled, _ = rollout(
        model, data, start, np.repeat(control[:1], round(SETTLE_S / STEP_S), axis=0)
    )
    model.tendon_damping[:] = 0.0
    _, sensors = rollout(model, data, settled[0, -1], control)
    # A sensor has the value at the beginning of a step, with the control that begins there. The
    # mean of the torques before and after that jump is what the accelerations around it have.
    jump = np.diff(control, axis=0, prepend=control[:1])
    rows = slice(None, None, round(1 / (plant.rate_hz * STEP_S)))
    position, moved, force = sensors[0, rows].reshape(-1, len(drives), 3).transpose(2, 0, 1)
    force = force - 0.5 * model.actuator_gainprm[:, 0] * jump[rows]
    ratio = np.array([1.0 if drive.stiffness else drive.ratio for drive in drives])
    return Run(time[rows], position, ratio * moved, force / ratio)


def logged(plant: Plant, run: Run, rng: np.random.Generator) -> tuple[Mapping[str, Array], Array]:
    """Return the columns of a log, with encoder steps and noise, and the motor offsets (n,)."""
    offsets = rng.uniform(-plant.homed_within_rad, plant.homed_within_rad, len(plant.joints))
    columns = {"time_s": run.time}
    for index, joint in enumerate(plant.joints):
        step, unit = 2 * np.pi / 2**plant.joint_bits, "rad"
        if joint.is_prismatic:
            step, unit = step / 20, "m"
        motor_step = 2 * np.pi / plant.motor_counts
        # a stiff motor has its zero where the joint has it: it is calculated from the joint
        offsets[index] *= bool(joint.drive.stiffness)
        torque = run.motor_torque[:, index]
        noise = plant.torque_noise * np.std(torque) * rng.normal(size=len(torque))
        angle = run.motor_position[:, index] + offsets[index]
        columns |= {
            f"{joint.name}.motor_position_rad": motor_step * np.round(angle / motor_step),
            f"{joint.name}.joint_position_{unit}": step
            * np.round(run.joint_position[:, index] / step),
            f"{joint.name}.motor_torque_Nm": torque + noise,
        }
    return columns, offsets


def write_files(plant: Plant, run: Run, seed: int, folder: Path) -> Array:
    """Write robot.urdf, truth.urdf, drives.toml and run.csv; return the motor offsets (n,)."""
    rng = generator(plant, seed)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(urdf_of(plant, rng))
    (folder / "truth.urdf").write_text(urdf_of(plant))
    (folder / "drives.toml").write_text(drives_toml(plant))
    columns, offsets = logged(plant, run, rng)
    np.savetxt(
        folder / "run.csv",
        np.column_stack(list(columns.values())),
        fmt="%.9g",
        delimiter=",",
        header=",".join(columns),
        comments="",
    )
    return offsets
