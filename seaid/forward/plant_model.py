"""The numbers and functions of the complete model (7) + (8) that a simulation moves.

All joints are in the order of Pinocchio's model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from seaid.arrays import Array, BoolArray, IndexArray
from seaid.drivetrain.acting import ActingDrive, acting_drive, is_plain
from seaid.drivetrain.extra_terms import extra_torque
from seaid.drivetrain.model import Drive, SeriesElasticDrive
from seaid.errors import RobotError
from seaid.robot import Robot
from seaid.transmission import coupled_groups

POSITION, SPEED, JOINT_POSITION, JOINT_SPEED = range(4)
"""Rows of a state (4, n): motor angle and speed, joint position and speed."""

_STEP_A_RATE = 1.0
"""Steps are so many parts of the time in which what damps a joint would stop it."""

_SHORTEST_STEP_S = 1e-6

Extra = Callable[[float, float, float, float], float]


@dataclass(frozen=True, eq=False)
class Plant:
    """Numbers of the complete model, each (n,); stiffness 0 and not `elastic` where stiff.

    `motor_lever` r_M/N, `elastic_lever` r_L and `motor_mobility` 1/I_M, the latter two zero where
    stiff; `stiff_ratio` N, zero where elastic. `model` carries the rotor inertia of stiff drives as
    armature, seen at the joint.

    Drives with more terms than plain friction and a linear spring are in `acting`, by index, with
    zeros in `viscous`, `coulomb` and `stiffness`; `under_load` (indices) are those whose friction
    depends on the torque through a stiff gear. `rubbing` (m,) are the joints whose own friction,
    `joint_coulomb` (m,) [N m or N], can hold them. `is_dry` (n + m,) tells which friction can hold:
    that of the motors, then that of the rubbing joints; `holds_load` (n + m,) which holds something
    at the load, of joints `places` (n + m,) where none are coupled.

    Where drives move several joints `coupling` is C of phi = C q, `uncoupling` its inverse and
    `rotors` (n, n) the rotor inertia of stiff drives seen at the joints, which `model` then has
    not. No step is longer than `longest_step` [s].
    """

    model: pin.Model
    elastic: BoolArray
    ratio: Array
    motor_inertia: Array
    viscous: Array
    coulomb: Array
    motor_radius: Array
    load_radius: Array
    stiffness: Array
    motor_lever: Array
    elastic_lever: Array
    motor_mobility: Array
    stiff_ratio: Array
    extras: tuple[tuple[int, Extra], ...]
    drives: tuple[Drive, ...]
    is_dry: BoolArray
    acting: tuple[tuple[int, ActingDrive], ...]
    under_load: tuple[int, ...]
    rubbing: IndexArray
    joint_coulomb: Array
    holds_load: BoolArray
    places: IndexArray
    longest_step: float
    coupling: Array | None
    uncoupling: Array | None
    rotors: Array | None


def plant_of(robot: Robot) -> Plant:
    """Return the plant of a robot with its payloads and nominal values.

    Raises RobotError naming joint and value where a nominal value is not given.
    """
    if not np.all(np.isfinite(robot.parameters)):
        raise RobotError(f"'{robot.name}' has no inertial parameters: it cannot be simulated")
    order = list(robot.model_order)
    names = [robot.joint_names[index] for index in order]
    drives = [robot.drivetrains[name] for name in names]

    def nominal(value_of: Callable[[str, Drive, str], float], name: str) -> Array:
        pairs = zip(names, drives, strict=True)
        return np.array([value_of(joint, drive, name) for joint, drive in pairs])

    elastic = np.array([isinstance(drive, SeriesElasticDrive) for drive in drives])
    ratio = np.array([drive.ratio for drive in drives])
    inertia = nominal(_nominal, "motor_inertia_kg_m2")
    motor_radius = np.array([getattr(drive, "motor_radius", 1.0) for drive in drives])
    load_radius = np.array([getattr(drive, "load_radius", 1.0) for drive in drives])
    if np.any(elastic & (inertia == 0)):
        name = names[int(np.flatnonzero(elastic & (inertia == 0))[0])]
        raise RobotError(f"joint '{name}': an elastic drive needs a motor inertia to be simulated")
    is_coupled = bool(coupled_groups(robot.transmission))
    C = robot.transmission[np.ix_(order, order)]
    armature = np.where(elastic, 0.0, ratio**2 * inertia)
    model = robot.model.copy()
    model.armature = np.zeros(robot.n) if is_coupled else armature
    rotors = C.T @ np.diag(armature) @ C if is_coupled else None
    acting = _acting(names, drives)
    coulomb = nominal(_friction, "coulomb")
    is_dry = coulomb > 0
    for index, drive in acting:
        is_dry[index] = drive.is_dry
    rubbing = np.array([index for index, drive in acting if drive.joint_level > 0], dtype=np.intp)
    levels = {index: drive.joint_level for index, drive in acting}
    felt = _felt_inertia(model, C, rotors) if acting else np.ones(robot.n)
    return Plant(
        model=model,
        elastic=elastic,
        ratio=ratio,
        motor_inertia=inertia,
        viscous=nominal(_friction, "viscous"),
        coulomb=coulomb,
        motor_radius=motor_radius,
        load_radius=load_radius,
        stiffness=nominal(_nominal, "stiffness"),
        motor_lever=motor_radius / ratio,
        elastic_lever=np.where(elastic, load_radius, 0.0),
        motor_mobility=np.where(elastic, 1 / np.where(elastic, inertia, 1.0), 0.0),
        stiff_ratio=np.where(elastic, 0.0, ratio),
        extras=tuple(
            (index, extra_torque(drive)) for index, drive in enumerate(drives) if drive.extra_terms
        ),
        drives=tuple(drives),
        is_dry=np.append(is_dry, np.ones(len(rubbing), dtype=bool)),
        acting=acting,
        under_load=tuple(index for index, drive in acting if drive.is_under_load),
        rubbing=rubbing,
        holds_load=np.append(~elastic, np.ones(len(rubbing), dtype=bool)),
        places=np.append(np.arange(robot.n), rubbing),
        joint_coulomb=np.array([levels[index] for index in rubbing.tolist()]),
        longest_step=_longest_step(names, drives, acting, felt),
        coupling=C if is_coupled else None,
        uncoupling=np.asarray(np.linalg.inv(C)) if is_coupled else None,
        rotors=rotors,
    )


def _nominal(joint: str, drive: Drive, name: str) -> float:
    if name == "stiffness" and not (isinstance(drive, SeriesElasticDrive) and is_plain(drive)):
        return 0.0
    value = getattr(drive, name)
    if value is None:
        raise RobotError(
            f"joint '{joint}': '{name}' is not given; a simulation needs a nominal value"
        )
    return float(value)


def _friction(joint: str, drive: Drive, term: str) -> float:
    name = {"viscous": "viscous_friction_Nms_per_rad", "coulomb": "coulomb_friction_Nm"}[term]
    is_there = term in drive.friction and is_plain(drive)
    return _nominal(joint, drive, name) if is_there else 0.0


def _acting(names: list[str], drives: list[Drive]) -> tuple[tuple[int, ActingDrive], ...]:
    found = []
    for index, (name, drive) in enumerate(zip(names, drives, strict=True)):
        if not is_plain(drive):
            try:
                found.append((index, acting_drive(drive)))
            except RobotError as problem:
                raise RobotError(f"joint '{name}': {problem}") from None
    return tuple(found)


def _felt_inertia(model: pin.Model, C: Array, rotors: Array | None) -> Array:
    """Return the inertia (n,) that each drive feels at zero with the others free."""
    inertia = mass_matrix(model, model.createData(), np.zeros(model.nv))
    inertia = inertia if rotors is None else inertia + rotors
    return np.asarray(1 / np.diag(C @ np.linalg.solve(inertia, C.T)))


def mass_matrix(model: pin.Model, data: pin.Data, position: Array) -> Array:
    """Return the mass matrix (n, n) of a model with its armature."""
    upper = np.triu(pin.crba(model, data, position))
    return np.asarray(upper + np.triu(upper, 1).T)


def _longest_step(
    names: list[str],
    drives: list[Drive],
    acting: tuple[tuple[int, ActingDrive], ...],
    felt: Array,
) -> float:
    """Return the longest step [s] that what damps the joints allows."""
    longest = np.inf
    for index, _ in acting:
        drive = drives[index]
        values = drive.values
        damping = values.get("spring_damping", 0.0)
        beside = values.get("joint_viscous_friction", 0.0)
        rate = (beside + damping * getattr(drive, "load_radius", 1.0) ** 2) / felt[index]
        at_motor = values.get("viscous_friction", 0.0)
        if "coulomb_width" in values:
            turning = values.get("coulomb_friction", 0.0) + abs(values.get("stribeck_friction", 0))
            at_motor += turning / max(values["coulomb_width"], 1e-300)
        if isinstance(drive, SeriesElasticDrive):
            inertia = float(drive.motor_inertia_kg_m2 or 0.0)
            rate += (at_motor + damping * (drive.motor_radius / drive.ratio) ** 2) / inertia
        else:
            rate += at_motor * drive.ratio**2 / felt[index]
        step = _STEP_A_RATE / rate if rate > 0 else np.inf
        if step < _SHORTEST_STEP_S:
            raise RobotError(
                f"joint '{names[index]}': its friction brakes within {1 / rate:.2g} s, too stiff "
                "to simulate: give a larger coulomb_width_rad_per_s, or take the term 'coulomb' "
                "(sharp) instead"
            )
        longest = min(longest, step)
    return longest
