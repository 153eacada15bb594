"""Before and after: the values of the robot files beside the identified ones.

The nominal robot predicts the same torques as the identified one. It keeps what no file can have:
the zeros of the encoders and the offsets of the torque sensors, as identified.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, FrozenMapping
from seaid.identification import compared

if TYPE_CHECKING:
    from seaid.drives import Drive
    from seaid.estimation import Estimate
    from seaid.identification import Identification, Validation
    from seaid.robot import Robot

_ZEROS = ("spring_offset", "deflection_zero", "torque_offset")
"""What no file can have; a spring offset follows from the stiffness."""

NO_BODIES = "the robot file has no inertial values"


@dataclass(frozen=True, eq=False)
class Nominal:
    """The values of the robot files in the places of the estimates, NaN where there are none.

    `drives` {joint: values} is in the order of `Identification.drive_side`, `load` in that of
    `load_side`; `missing` {(side, joint): reason} names what keeps a joint from being predicted.
    """

    drives: dict[str, Array]
    load: Array
    missing: dict[tuple[str, str], str]


def nominal_values(found: Identification, robot: Robot) -> Nominal:
    """Return the values of a robot's files for the parameters that were identified."""
    missing: dict[tuple[str, str], str] = {}
    drives = {}
    for joint, estimate in found.drive_side.items():
        drives[joint] = _of_drive(estimate, robot.drives[joint])
        own_names = [name for name in estimate.names if name not in _ZEROS]
        own = drives[joint][[estimate.names.index(name) for name in own_names]]
        _note(missing, "actuator", joint, own_names, own)
    model = found.model
    tables = [robot.drives[joint].values for joint, _, _ in (*model.drives, *model.absorbed)]
    names = [name for _, name, _ in (*model.drives, *model.absorbed)]
    own = np.array([table.get(name, np.nan) for table, name in zip(tables, names, strict=True)])
    for place, (joint, name, _) in enumerate((*model.drives, *model.absorbed)):
        _note(missing, "load", joint, [name], own[place : place + 1])
    if np.any(np.isnan(robot.parameters)):
        missing |= {("load", joint): NO_BODIES for joint in robot.joint_names}
    count = len(model.drives)
    load = np.concatenate([found.base.project(robot.parameters), own[:count]])
    if len(model.absorbed):
        load = load + model.absorption @ own[count:]
    extra = np.zeros(len(found.load_side.names) - len(load))
    return Nominal(drives, np.concatenate([load, extra]), missing)


def _note(
    missing: dict[tuple[str, str], str], side: str, joint: str, names: Sequence[str], values: Array
) -> None:
    absent = [name.replace("_", " ") for name in np.array(names)[np.isnan(values)].tolist()]
    if absent:
        said = missing.get((side, joint), "no nominal ")
        missing[side, joint] = said + (", " if said[-1] != " " else "") + ", ".join(absent)


def _of_drive(estimate: Estimate, drive: Drive) -> Array:
    """Return the nominal values (p,) of a drive, its encoder zeros as identified."""
    found: dict[str, float] = dict(zip(estimate.names, estimate.values.tolist(), strict=True))
    kept = {name: found[name] for name in _ZEROS[1:] if name in found}
    if "spring_offset" in found and "preload" not in drive.spring:
        zero = found["spring_offset"] / found["stiffness"] if found.get("stiffness") else np.nan
        kept["spring_offset"] = zero * drive.values.get("stiffness", np.nan)
    values = {**drive.values, **kept}
    return np.array([values.get(name, np.nan) for name in estimate.names])


def nominal_prediction(found: Identification, nominal: Nominal, result: Validation) -> Validation:
    """Return the same validation with the torques that the nominal values predict."""
    drives = {
        joint: replace(estimate, values=np.nan_to_num(nominal.drives[joint]))
        for joint, estimate in found.drive_side.items()
    }
    load = replace(found.load_side, values=np.nan_to_num(nominal.load))
    given = replace(found, drive_side=FrozenMapping(drives), load_side=load)
    return compared(given, *result.motions)


@dataclass(frozen=True)
class BeforeAfter:
    """Relative errors of the torque of a joint; `before` is NaN for the `reason`."""

    joint: str
    side: str
    before: float
    after: float
    reason: str


def before_and_after(
    found: Identification, nominal: Nominal, result: Validation
) -> list[BeforeAfter]:
    """Return the errors of the nominal and of the identified values, by side and joint."""
    kept = "the motion of this validation is not kept"
    before = nominal_prediction(found, nominal, result) if result.motions else None
    rows = []
    for side in ("load", "actuator"):
        after = getattr(result, side).relative_error
        for index in np.flatnonzero(np.isfinite(after)).tolist():
            joint = result.joints[index]
            reason = nominal.missing.get((side, joint), "" if before else kept)
            error = np.nan if reason else getattr(before, side).relative_error[index]
            rows.append(BeforeAfter(joint, side, float(error), float(after[index]), reason))
    return rows
