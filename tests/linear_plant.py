"""Linear plants of motors, springs and loads, simulated by scipy: nothing of seaid is in them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import cont2discrete

from seaid._arrays import Array
from seaid.legged import load_robot
from seaid.log import Log
from seaid.robot import Robot
from tests.plants import write_robot

RATE_HZ = 1000.0


def state_space(
    mass: Array, stiffness: Array, damping: Array, inputs: int = 1
) -> tuple[Array, Array]:
    """Return A and B of positions and their speeds, driven at the first masses."""
    inverse, nothing = np.linalg.inv(mass), np.zeros_like(mass)
    A = np.block([[nothing, np.eye(len(mass))], [-inverse @ stiffness, -inverse @ damping]])
    return A, np.vstack([nothing[:, :inputs], inverse[:, :inputs]])


def driven(
    matrices: tuple[Array, Array], inputs: Array, rate_hz: float, coulomb: float = 0.0
) -> Array:
    """Return the states (T, 2 n) from rest under inputs (T, m), and a friction of the first mass.

    Inputs are linear between the samples, or held if there is friction.
    """
    A, B = matrices
    everything = (A, B, np.eye(len(A)), 0 * B)
    Ad, Bd, C, D, _ = cont2discrete(everything, 1 / rate_hz, "zoh" if coulomb else "foh")
    speed = len(A) // 2  # of the motor
    state, states = np.zeros(len(A)), np.empty((len(inputs), len(A)))
    for t, u in enumerate(inputs):
        states[t] = C @ state + D @ u
        if coulomb:
            u = u - coulomb * np.tanh(state[speed] / 0.5)
        state = Ad @ state + Bd @ u
    return states


def log_of(
    joints: tuple[str, ...], torque: Array, motor: Array, position: Array | None = None
) -> Log:
    """Return the log of torques and motor angles (T, n), without encoders of the joints."""
    nothing = np.full_like(motor, np.nan)
    time = np.arange(len(torque)) / RATE_HZ
    return Log(time, joints, motor, nothing if position is None else position, torque)


@dataclass(frozen=True)
class TwoMass:
    """A motor behind a gear, a rotary spring with damping, a load with a gravity stiffness."""

    gear_ratio: float = 100.0
    motor_inertia: float = 2e-5
    friction: float = 4e-4
    stiffness: float = 160.0
    damping: float = 0.3
    load: float = 0.25
    gravity: float = 5.0

    @property
    def matrices(self) -> tuple[Array, Array]:
        """A and B of the state (motor angle, joint position, their speeds), from (7) and (8)."""
        N, k, c = self.gear_ratio, self.stiffness, self.damping
        mass = np.diag([self.motor_inertia, self.load])
        pull = np.array([[1 / N**2, -1 / N], [-1 / N, 1.0]])
        stiffness = k * pull + np.diag([0.0, self.gravity])
        damping = c * pull + np.diag([self.friction, 0.0])
        return state_space(mass, stiffness, damping)

    def response(self, hz: Array) -> Array:
        """The exact response from motor torque to motor angle [rad/(N m)]."""
        A, B = self.matrices
        s = 2j * np.pi * np.asarray(hz)
        return np.array([np.linalg.solve(one * np.eye(4) - A, B)[0, 0] for one in s])

    @property
    def modes(self) -> Array:
        """Resonance [Hz], its damping ratio, antiresonance [Hz] and its damping ratio."""
        A, _ = self.matrices
        poles = np.linalg.eigvals(A)
        pole = poles[np.argmax(poles.imag)]
        zeros = np.roots([self.load, self.damping, self.stiffness + self.gravity])
        pairs = [(abs(one) / (2 * np.pi), -one.real / abs(one)) for one in (pole, zeros[0])]
        return np.ravel(pairs)

    def log(
        self,
        torque: Array,
        *,
        coulomb: float = 0.0,
        torque_std: float = 0.0,
        angle_std: float = 0.0,
        seed: int = 0,
        joint: bool = False,
    ) -> Log:
        """Drive the plant from rest by a torque (T,) that is linear between its samples."""
        substeps = 5 if coulomb else 1
        rate = RATE_HZ * substeps
        # held over a substep, so that of its middle
        middle = np.arange(len(torque) * substeps) + (0.5 if coulomb else 0.0)
        fine = np.interp(middle / rate, np.arange(len(torque)) / RATE_HZ, torque)
        states = driven(self.matrices, fine[:, None], rate, coulomb)[::substeps]
        noise = np.random.default_rng(seed).normal(size=(2, len(torque), 1))
        motor, position = states[:, :1] + angle_std * noise[0], states[:, 1:2] if joint else None
        return log_of(("arm",), torque[:, None] + torque_std * noise[1], motor, position)

    def robot(self, folder: Path, *, nominal: bool = True) -> Robot:
        """The robot of a pendulum with these numbers; without `nominal` k and F are not known."""
        weight = self.gravity / 9.81  # mass times length, with half of the inertia
        mass = max(1.0, 2 * weight**2 / self.load)
        length = weight / mass
        inertia = self.load - mass * length**2
        body = (
            f'<inertial><origin xyz="0 0 {-length}"/><mass value="{mass}"/><inertia '
            f'ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial>'
        )
        limit = '<limit lower="-3" upper="3" effort="50" velocity="9"/>'
        joint = f'revolute base body <axis xyz="0 1 0"/>{limit}'
        path = write_robot(folder / "pendulum.urdf", {"arm": joint}, body)
        drive = {
            "type": "series_elastic",
            "gear_ratio": self.gear_ratio,
            "motor_inertia_kg_m2": self.motor_inertia,
            "friction": ["viscous"],
            "spring": ["linear", "damping"],
        }
        if nominal:
            drive |= {
                "stiffness_Nm_per_rad": self.stiffness,
                "viscous_friction_Nms_per_rad": self.friction,
                "nominal": {"spring_damping": self.damping},
            }
        return load_robot(path, {"arm": drive})


def multisine_torque(
    size: float,
    *,
    period_s: float = 4.0,
    periods: int = 3,
    top_hz: float = 25.0,
    seed: int = 0,
    left_out: int = 0,
) -> Array:
    """Return a torque of odd harmonics with equal amplitudes and random phases, rms `size`.

    Every `left_out`-th is not excited.
    """
    rng = np.random.default_rng(seed)
    harmonics = np.arange(1, int(top_hz * period_s) + 1, 2)
    if left_out:
        harmonics = np.delete(harmonics, np.s_[left_out // 2 :: left_out])
    time = np.arange(round(period_s * RATE_HZ)) / RATE_HZ
    phase = rng.uniform(0, 2 * np.pi, len(harmonics))
    one = np.cos(2 * np.pi * np.outer(time / period_s, harmonics) + phase).sum(axis=1)
    return np.tile(size * one / np.std(one), periods)
