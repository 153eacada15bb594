"""What drives share: one delay of the commands on each bus, one value in each group of one type."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid.drives.controller import DELAY_PARAMETER
from seaid.drives.terms import PARAMETERS, ParameterName
from seaid.errors import RobotError, shown, unknown_name

if TYPE_CHECKING:
    from seaid.drives.drives import Drive

NORMAL_95 = 1.96


STATED_DELAY_S = 12.5e-3
"""An unknown delay [s] of commands is within this of its nominal value, with 95 %, if the drive
states no standard deviation: two or three samples of a bus at 200 Hz."""


def stated_delay_s(drive: Drive) -> float:
    """Return within what a delay is of its nominal value [s], with 95 %; 0 if exactly known."""
    known = drive.controller is None or "command_delay" in drive.known
    std = drive.std.get("command_delay_s")
    return (0.0 if known else STATED_DELAY_S) if std is None else NORMAL_95 * std


def delay_std_s(drive: Drive) -> float:
    """Return the standard deviation [s] of a delay before an identification."""
    return float(drive.std.get("command_delay_s", STATED_DELAY_S / NORMAL_95))


def is_stated(std_s: float, stated_s: float) -> bool:
    """Return whether a delay with a standard error is as stated, and not estimated."""
    return bool(np.isclose(std_s, stated_s, rtol=1e-6))


def delay_sums(joint: str, drives: Sequence[Drive]) -> str:
    """Return what logs with the gain sets of some drives of a joint determine of its delay T.

    To first order T adds (K_d + F_v) T to the armature and K_p T to the viscous friction.
    """
    within = max(map(stated_delay_s, drives))
    if not within:
        return ""
    pairs = []
    for drive in drives:
        laws = drive.law
        assert laws is not None
        # F_v of the motor is F_v N^2 at the joint.
        friction = drive.values.get("viscous_friction", 0.0) * drive.ratio**2
        pair = laws.velocity_gain_Nms_per_rad + friction, laws.position_gain_Nm_per_rad
        pairs += [pair] * (pair not in pairs)
    text = "; and ".join(
        f"armature + {slope:.3g} T" + (f" and viscous friction + {gain:.4g} T" if gain else "")
        for slope, gain in pairs
    )
    start = f"{joint}: with the delay T of its commands, to first order, {text}"
    if len(pairs) > 1:
        return f"{start}: these {len(pairs)} gain sets separate them"
    (slope, gain), ms = pairs[0], 1e3 * within
    return (
        f"{start}: alone they are uncertain by {slope * within:.2g} and {gain * within:.2g} for T "
        f"within {ms:.3g} ms; a log with another gain set separates them"
    )


# A motor, its gear and its spring have parameters by their type, which drives of a group share; a
# joint has its own by its mounting: zeros of encoders, offsets of torques, levels over positions.
SHARED = frozenset(PARAMETERS) - {
    *("friction_offset", "coulomb_position_slope", "coulomb_position_curvature"),
    *("spring_offset", "deflection_zero", DELAY_PARAMETER),
    *("parallel_stiffness", "parallel_preload", "joint_viscous_friction", "joint_coulomb_friction"),
}
"""Parameters that the drives of a group share; drives of one bus have one delay anyway."""


def shared_columns(
    drives: Mapping[str, Drive], names: Sequence[str], joint: str = ""
) -> dict[ParameterName, list[int]]:
    """Return {shared parameter, with its group as owner: the places of its columns, two or more}.

    `joint` owns names without one. A condition has parameters of its own if they are specific.
    """
    places: dict[ParameterName, list[int]] = {}
    for place, name in enumerate(map(ParameterName.of, names)):
        drive = drives.get(name.owner or joint)
        if drive is not None and drive.shared and name.quantity in SHARED:
            places.setdefault(name.at(drive.shared), []).append(place)
    return {name: columns for name, columns in places.items() if len(columns) > 1}


@dataclass(frozen=True)
class Bus:
    """Drives with one delay: the `places` of its columns, nominal value and standard deviation."""

    places: tuple[int, ...]
    nominal_s: float
    std_s: float


def buses_of(drives: Mapping[str, Drive], names: Sequence[str], joint: str = "") -> list[Bus]:
    """Return the groups of columns; drives with one nominal delay are on one bus.

    `joint` owns names without one. A condition has delays of its own if they are specific to it.
    """
    places: dict[tuple[float, str | None], list[int]] = {}
    stds: dict[tuple[float, str | None], float] = {}
    for place, name in enumerate(map(ParameterName.of, names)):
        if name.quantity != DELAY_PARAMETER:
            continue
        drive = drives[name.owner or joint]
        key = (drive.command_delay_s or 0.0, name.condition)
        places.setdefault(key, []).append(place)
        stds[key] = max(stds.get(key, 0.0), delay_std_s(drive))
    return [Bus(tuple(places[key]), key[0], stds[key]) for key in places]


def groups_of(drives: Mapping[str, Drive]) -> dict[str, list[str]]:
    """Return {group: its joints} of drives."""
    names = dict.fromkeys(drive.shared for drive in drives.values() if drive.shared)
    return {name: [joint for joint, x in drives.items() if x.shared == name] for name in names}


def with_groups(
    drives: Mapping[str, Drive], share: Mapping[str, Sequence[str]]
) -> dict[str, Drive]:
    """Return drives with the groups {group: joints} of `share=`. Raises RobotError."""
    group_of: dict[str, str] = {}
    for group, joint in ((group, joint) for group, joints in share.items() for joint in joints):
        if joint not in drives:
            raise RobotError("share=: " + unknown_name("joint", joint, drives), "share=")
        if not group:
            raise RobotError(f"share=: the group of {joint} has no name: give it one", "share=")
        if joint in group_of:
            raise RobotError(
                f"share=: {joint} is in '{group_of[joint]}' and in '{group}': name it in one group",
                "share=",
            )
        group_of[joint] = group
    changed = {x: replace(y, shared=group_of.get(x, y.shared)) for x, y in drives.items()}
    check_groups(changed, "share=")
    return changed


def check_groups(drives: Mapping[str, Drive], where: str, is_whole: bool = True) -> None:
    """Raise RobotError for groups whose drives cannot share their parameters.

    Where the drives are not the whole robot, a group may be that of one of them.
    """
    for group, joints in groups_of(drives).items():
        if is_whole and len(joints) == 1:
            raise RobotError(
                f"{where}: [{joints[0]}] is alone in the group '{group}': write shared = '{group}' "
                "at the other joints with this motor too, or remove it"
            )
        first, *others = ((joint, _kind(drives[joint])) for joint in joints)
        for searched in first[1]["searched parameters"]:
            raise RobotError(
                f"{where}: [{joints[0]}] shares '{group}', and its equation is nonlinear in the "
                f"unknown {searched}, where only linear parameters are shared: give its value "
                f"(known = ['{searched}']), or remove its term or the group"
            )
        for (joint, kind), what in product(others, first[1]):
            if kind[what] != first[1][what]:
                raise RobotError(
                    f"{where}: [{joints[0]}] and [{joint}] share '{group}' and differ in {what}, "
                    f"{shown(first[1][what])} and {shown(kind[what])}: correct one of them, or "
                    "give them groups of their own"
                )


def _kind(drive: Drive) -> dict[str, Any]:
    """Return in what the drives of a group are alike."""
    known = {name: drive.own_values[name] for name in drive.known if name in SHARED}
    names = [name for name in drive.parameter_names if name in SHARED and name not in known]
    return {
        "type": "series_elastic" if drive.is_elastic else "stiff",
        "unit of the spring": drive.spring_units[0] if drive.is_elastic else "",
        "motor_input": drive.motor_input,
        "known parameters": known | {"motor_inertia": drive.motor_inertia_kg_m2},
        "unknown parameters": names,
        "searched parameters": [name for name in names if PARAMETERS[name].starts],
    }
