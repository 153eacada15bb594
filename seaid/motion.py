"""Motion: what the robot did, both sides, filtered and differentiated from a log."""

from __future__ import annotations

from dataclasses import dataclass

from seaid.arrays import Array


@dataclass(frozen=True, eq=False)
class Motion:
    """Position, velocity, acceleration and torque of both sides, each (T, n), on a uniform grid.

    Joint side in rad or m, motor side in rad; torques in N m (`joint_torque` of a prismatic joint
    in N); NaN where a joint has no such sensor.
    """

    time: Array
    joint_names: tuple[str, ...]
    joint_position: Array
    joint_velocity: Array
    joint_acceleration: Array
    motor_position: Array
    motor_velocity: Array
    motor_acceleration: Array
    motor_torque: Array
    joint_torque: Array
    cutoff_hz: float

    @property
    def joint_states(self) -> tuple[Array, Array, Array]:
        """Joint position, velocity and acceleration, each (T, n)."""
        return self.joint_position, self.joint_velocity, self.joint_acceleration

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return float((len(self.time) - 1) / (self.time[-1] - self.time[0]))
