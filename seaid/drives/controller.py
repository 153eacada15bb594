"""The position controller of a drive: the torque that it commands for a commanded position."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid.errors import RobotError, shown, unknown_name

if TYPE_CHECKING:
    from seaid._arrays import Array, BoolArray
    from seaid.drives.drives import Drive

NORMAL_95 = 1.96


STATED_DELAY_S = 12.5e-3
"""An unknown delay [s] of commands is within this of its nominal value, with 95 %, if the drive
states no standard deviation: two or three samples of a bus at 200 Hz."""


@dataclass(frozen=True, kw_only=True)
class Controller:
    """A position controller: torque = clip(K_p (u - q) - K_d q', -limit, limit) at the joint.

    The position q is that of the drive's own encoder: theta_M / N behind the gear.

    Parameters
    ----------
    position_gain_Nm_per_rad : float
        K_p at the joint [N m/rad], of a prismatic joint [N/m].
    velocity_gain_Nms_per_rad : float, default 0
        K_d at the joint [N m s/rad], of a prismatic joint [N s/m].
    torque_limit_Nm : float, default inf
        Largest torque at the joint [N m], of a prismatic joint [N].

    Raises
    ------
    RobotError
        For gains that are negative or not finite.

    Examples
    --------
    >>> pd = seaid.Controller(position_gain_Nm_per_rad=20.0, velocity_gain_Nms_per_rad=1.5)
    >>> seaid.StiffDrive(gear_ratio=1.0, motor_input="position_command", controller=pd)
    """

    position_gain_Nm_per_rad: float
    velocity_gain_Nms_per_rad: float = 0.0
    torque_limit_Nm: float = math.inf

    def __post_init__(self) -> None:
        for name in ("position_gain_Nm_per_rad", "velocity_gain_Nms_per_rad", "torque_limit_Nm"):
            value, is_gain = getattr(self, name), name != "torque_limit_Nm"
            least = "zero or more" if name.startswith("velocity") else "more than zero"
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            is_allowed = is_number and (value >= 0 if least == "zero or more" else value > 0)
            if not is_allowed or (is_gain and not math.isfinite(value)):
                finite = " and finite" if is_gain else ""
                ask = ": write the number of your controller" if isinstance(value, str) else ""
                raise RobotError(f"{name} must be {least}{finite}, found {shown(value)}{ask}")

    def torque(self, command: Array, position: Array, velocity: Array) -> tuple[Array, BoolArray]:
        """Return the torque (T,) at the joint, and the mask (T,) of samples at its limit."""
        wanted = self.position_gain_Nm_per_rad * (command - position)
        wanted = wanted - self.velocity_gain_Nms_per_rad * velocity
        limit = self.torque_limit_Nm
        return np.clip(wanted, -limit, limit), np.abs(wanted) > limit


def stated_delay_s(drive: Drive) -> float:
    """Return within what a delay is of its nominal value [s], with 95 %; 0 if exactly known."""
    known = drive.controller is None or "command_delay" in drive.known
    own = drive.std.get("command_delay_s")
    return (0.0 if known else STATED_DELAY_S) if own is None else NORMAL_95 * own


def delay_sums(joint: str, drives: Sequence[Drive]) -> str:
    """Return what logs with the gain sets of some drives of a joint determine of its delay T.

    To first order T adds (K_d + F_v) T to the armature and K_p T to the viscous friction.
    """
    within = max(map(stated_delay_s, drives))
    if not within:
        return ""
    pairs = []
    for drive in drives:
        assert drive.controller is not None
        friction = drive.values.get("viscous_friction", 0.0) * drive.ratio**2
        laws = drive.controller
        pair = laws.velocity_gain_Nms_per_rad + friction, laws.position_gain_Nm_per_rad
        pairs += [pair] * (pair not in pairs)
    text = "; and ".join(
        f"armature + {slope:.3g} T and viscous friction + {gain:.4g} T" for slope, gain in pairs
    )
    start = f"{joint}: with the delay T of its commands, to first order, {text}"
    if len(pairs) > 1:
        return f"{start}: these {len(pairs)} gain sets separate them"
    (slope, gain), ms = pairs[0], 1e3 * within
    return (
        f"{start}: alone they are uncertain by {slope * within:.2g} and {gain * within:.2g} for T "
        f"within {ms:.3g} ms; a log with another gain set separates them"
    )


def controller_of(given: Any) -> Controller:
    """Return a controller, or that of a table as in the TOML. Raises RobotError."""
    if isinstance(given, Controller):
        return given
    if not isinstance(given, Mapping):
        raise RobotError(f"controller must be a table with its gains, found {shown(given)}")
    allowed = [field.name for field in fields(Controller)]
    for key in given:
        if key not in allowed:
            raise RobotError(f"controller: {unknown_name('key', key, allowed)}")
    if "position_gain_Nm_per_rad" not in given:
        raise RobotError(
            "controller: key 'position_gain_Nm_per_rad' is missing, the torque at the joint per "
            "rad of position error"
        )
    return Controller(**given)
