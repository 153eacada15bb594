"""The controller of a drive: the torque that it gives for logged commands."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from seaid._arrays import Array, BoolArray, number
from seaid.errors import RobotError, shown

NORMAL_95 = 1.96
"""Standard errors on either side of a normal value within which it is with 95 %."""

DELAY_PARAMETER = "command_delay"
"""The parameter of the delay of commands."""


_SUPPLY = "nominal_supply_V"
_LEAST = {
    **dict.fromkeys(("position_gain_Nm_per_rad", "velocity_gain_Nms_per_rad"), "zero or more"),
    **dict.fromkeys(("command_velocity_gain_Nms_per_rad", "feedforward_Nm"), "a number"),
    **dict.fromkeys(("torque_limit_Nm", "no_load_speed_rad_per_s", _SUPPLY), "more than zero"),
}
"""{field: what its number must be}."""


def signed_number(name: str, value: Any, least: str, most: float = np.finfo(float).max) -> float:
    """Return a number that is "zero or more", "more than zero" or "a number", up to `most`.

    An infinite `most` allows infinity, and the largest number what is finite.
    """
    size = number(name, value, RobotError)
    allowed = {"zero or more": size >= 0, "more than zero": size > 0}.get(least, True)
    if not (allowed and abs(size) <= most):
        limits = {math.inf: "", np.finfo(float).max: " and finite"}
        finite = limits.get(most, f" and at most {most:g}")
        raise RobotError(f"{name} must be {least}{finite}, found {shown(value)}")
    return size


@dataclass(frozen=True, kw_only=True)
class Controller:
    """A joint controller: torque = clip(K_p (u - q) + K_v w - K_d q' + F + f) at the joint.

    The log has the position command u and, where the drive gets them, the velocity command w and
    the feed-forward torque f; without a column w is u', and f zero. The position q is that of the
    drive's own encoder: theta_M / N behind the gear. The limits of the torque are -limit and limit;
    with a no-load speed v_0, those of a motor at a fixed voltage too: limit (1 - q'/v_0) above, and
    -limit (1 + q'/v_0) below.

    Parameters
    ----------
    position_gain_Nm_per_rad : float, default 0
        K_p at the joint [N m/rad], of a prismatic joint [N/m]; zero for velocity commands alone.
    velocity_gain_Nms_per_rad : float, default 0
        K_d at the joint [N m s/rad], of a prismatic joint [N s/m].
    torque_limit_Nm : float, default inf
        Largest torque at the joint [N m], of a prismatic joint [N].
    no_load_speed_rad_per_s : float, default inf
        v_0, the speed at which the motor has no torque left [rad/s, of a prismatic joint m/s].
    command_velocity_gain_Nms_per_rad : float, default 0
        K_v on the velocity of the command [N m s/rad]: K_d for a controller of velocity errors,
        as the low-level command of legged robots and the MIT Mini Cheetah's drives have.
    feedforward_Nm : float, default 0
        F, a constant torque [N m].
    is_held : bool, default False
        Whether the drive holds each logged command until the next one, half a period later on
        average; without it commands count as a line through those of the log.
    is_up_to_scale : bool, default False
        Whether gains, limit and feed-forward are in units of the drive (counts, volts, duty): the
        torques are these times `gain_scale`, a parameter of the drive.
    nominal_supply_V : float, optional
        Supply voltage V_0 [V] to which the limit belongs: with it the log needs the column
        `supply_voltage_V`, and the limits are limit (V/V_0 - q'/v_0) and -limit (V/V_0 + q'/v_0).
    is_duty : bool, default False
        Whether the controller gives a duty cycle, so that its torque is V/V_0 times the above.

    Raises
    ------
    RobotError
        For gains that are negative or not finite.

    Examples
    --------
    >>> pd = seaid.Controller(position_gain_Nm_per_rad=20.0, velocity_gain_Nms_per_rad=1.5)
    >>> seaid.StiffDrive(gear_ratio=1.0, motor_input="position_command", controller=pd)
    """

    position_gain_Nm_per_rad: float = 0.0
    velocity_gain_Nms_per_rad: float = 0.0
    torque_limit_Nm: float = math.inf

    no_load_speed_rad_per_s: float = math.inf
    command_velocity_gain_Nms_per_rad: float = 0.0
    feedforward_Nm: float = 0.0
    is_held: bool = False
    is_up_to_scale: bool = False
    nominal_supply_V: float | None = None
    is_duty: bool = False

    def __post_init__(self) -> None:
        for name in ("is_held", "is_up_to_scale", "is_duty"):
            if not isinstance(getattr(self, name), bool):
                raise RobotError(
                    f"{name} must be true or false, found {shown(getattr(self, name))}"
                )
        defaults = {field.name: field.default for field in fields(self)}
        for name, least in _LEAST.items():
            if getattr(self, name) is not None or defaults[name] is not None:
                most = math.inf if defaults[name] == math.inf else np.finfo(float).max
                signed_number(name, getattr(self, name), least, most)
        if self.is_duty and self.nominal_supply_V is None:
            raise RobotError(
                "is_duty = true needs nominal_supply_V, the supply voltage to which the gains of "
                "the duty cycle belong: nominal_supply_V = 12.0"
            )

    def times(self, scale: float) -> Controller:
        """Return the controller with gains, limit and feed-forward times a scale, in N m."""
        names = [name for name in _LEAST if name not in ("no_load_speed_rad_per_s", _SUPPLY)]
        changes: dict[str, Any] = {name: scale * getattr(self, name) for name in names}
        return replace(self, is_up_to_scale=False, **changes)

    def torque(
        self,
        commanded: Array,
        position: Array,
        velocity: Array,
        supply: Array | float = 1.0,
    ) -> tuple[Array, BoolArray]:
        """Return the torque (T,) at the joint, and the mask (T,) of samples at its limit.

        `commanded` is the part of the torque that the commands give, K_p u + K_v w + F + f, and
        `supply` the voltage of the supply over its nominal one.
        """
        feedback = self.position_gain_Nm_per_rad * position
        feedback = feedback + self.velocity_gain_Nms_per_rad * velocity
        wanted = (commanded - feedback) * self.gain_factor(supply)
        if math.isinf(self.torque_limit_Nm):
            return wanted, np.zeros(np.shape(wanted), dtype=bool)
        speed = velocity / self.no_load_speed_rad_per_s
        # A motor that brakes has the limit at rest and not more: hence the upper end of the clip.
        high, low = (
            self.torque_limit_Nm * np.clip(supply - x, 0.0, supply) for x in (speed, -speed)
        )
        return np.clip(wanted, -low, high), (wanted > high) | (wanted < -low)

    def gain_factor(self, supply: Array | float) -> Array | float:
        """Return the factor on all gains at a supply voltage over its nominal one."""
        return supply if self.is_duty else 1.0
