"""What drives share: one delay of the commands on each bus, one value in each group of one type."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, Any

from seaid.drives.controller import DELAY_PARAMETER
from seaid.drives.terms import PARAMETERS
from seaid.errors import RobotError, shown

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


# A motor, its gear and its spring have parameters by their type, which drives of a group share; a
# joint has its own by its mounting: zeros of encoders, offsets of torques, levels over positions.
SHARED = frozenset(PARAMETERS) - {
    *("friction_offset", "coulomb_position_slope", "coulomb_position_curvature"),
    *("spring_offset", "deflection_zero", DELAY_PARAMETER),
    *("parallel_stiffness", "parallel_preload", "joint_viscous_friction", "joint_coulomb_friction"),
}
"""Parameters that the drives of a group share; drives of one bus have one delay anyway."""


def groups_of(drives: Mapping[str, Drive]) -> dict[str, list[str]]:
    """Return {group: its joints} of drives."""
    names = dict.fromkeys(drive.shared for drive in drives.values() if drive.shared)
    return {name: [joint for joint, x in drives.items() if x.shared == name] for name in names}


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
