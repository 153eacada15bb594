"""The equations of a robot with its drives, and which of them some sensors leave to be used.

Every drive has a motor balance (7) and, if it is elastic, a spring (3); every joint has a load row
(8). The torques of the motors and those on what the drives turn stand between them: a torque that
no sensor measures is an unknown function of time, so it has to be eliminated, and a position that
none measures makes every equation useless in which it stands.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp
from flint import fmpq, fmpq_mat
from numpy.typing import NDArray

from seaid.drivetrain.symbols import r_L
from seaid.robot import Robot
from seaid.symbolic.geometry import exact_number
from seaid.symbolic.sensing.drives import INPUTS, DriveTerms, drive_terms
from seaid.symbolic.sensing.positions import Seen, exact_transmission, positions_seen


@dataclass(frozen=True, eq=False)
class Equation:
    """An equation that is zero along every motion.

    `kind` is "motor", "spring", "input", "load" or "sensor", `index` its drive or joint. Its
    `parts` are (drive, factor, expression), to be summed; a load row has the rigid bodies' torque
    of its joint besides, with a minus. `torques` {("motor" or "load", drive): factor} are those of
    which it is linear. `missing` says in words what no sensor tells, so that it cannot be used.
    """

    kind: str
    index: int
    parts: tuple[tuple[int, fmpq, sp.Expr], ...]
    torques: Mapping[tuple[str, int], fmpq]
    missing: tuple[str, ...] = ()


def equations_of(
    robot: Robot,
    terms: Sequence[DriveTerms],
    sensors: Mapping[str, frozenset[str]],
    depends: Sequence[frozenset[int]],
) -> list[Equation]:
    """Return all equations, with what is missing to use each.

    `depends` are the joints whose motion the rigid bodies' torque at each joint depends on.
    """
    seen = positions_seen(robot, sensors)
    found: list[Equation] = []
    for i, (joint, drive) in enumerate(zip(robot.joint_names, terms, strict=True)):
        found += _drive_equations(i, drive, sensors[joint], seen)
    found += _load_rows(robot, terms, sensors, seen, depends)
    return found


def _drive_equations(
    i: int, terms: DriveTerms, sensors: frozenset[str], seen: Seen
) -> Iterator[Equation]:
    share = _number(terms.share, terms)
    one = fmpq(1)
    yield Equation(
        "motor",
        i,
        ((i, one, terms.motor),),
        {("motor", i): -one, ("load", i): share},
        _missing(terms.motor, i, sensors, seen),
    )
    if terms.spring is not None:
        yield Equation(
            "spring",
            i,
            ((i, one, terms.spring),),
            {("load", i): -1 / _number(r_L, terms)},
            _missing(terms.spring, i, sensors, seen),
        )
    for sensor, expression in terms.inputs.items():
        missing = _missing(expression, i, sensors, seen)
        if sensor not in sensors:
            missing = (f"no {sensor.replace('_', ' ')}",)
        yield Equation("input", i, ((i, one, expression),), {("motor", i): -one}, missing)


def _load_rows(
    robot: Robot,
    terms: Sequence[DriveTerms],
    sensors: Mapping[str, frozenset[str]],
    seen: Seen,
    depends: Sequence[frozenset[int]],
) -> Iterator[Equation]:
    C = exact_transmission(robot)
    for j, joint in enumerate(robot.joint_names):
        factors = {i: C[i, j] for i in range(robot.n) if C[i, j] != 0}
        parts = tuple((i, -x, terms[i].beside) for i, x in factors.items())
        unseen = [robot.joint_names[k] for k in sorted(depends[j]) if not seen.joint[k]]
        missing = [f"the position of {', '.join(unseen)} is not known"] if unseen else []
        for i, _, expression in parts:
            missing += [] if missing else _missing(expression, i, sensors[joint], seen)
        torques = {("load", i): x for i, x in factors.items()}
        yield Equation("load", j, parts, torques, tuple(missing))
        if "joint_torque" in sensors[joint]:
            yield Equation("sensor", j, (), torques)


def _missing(expression: sp.Expr, i: int, sensors: frozenset[str], seen: Seen) -> tuple[str, ...]:
    """Return what an expression of a drive's signals needs and the sensors do not tell."""
    found = {symbol.name for symbol in expression.free_symbols}
    names = {name.removesuffix("_ddot").removesuffix("_dot") for name in found}
    needs = {
        "theta_M": ("the motor's position is not known", seen.motor[i]),
        "theta_L": ("the joint's position is not known", seen.driven[i]),
        "deflection": ("the spring's deflection is not known", seen.stretch[i]),
        "tau_G": (
            "its friction needs the torque through the gear",
            bool(sensors & {*INPUTS, "joint_torque"}),
        ),
    }
    return tuple(words for name, (words, told) in needs.items() if name in names and not told)


def _number(expression: sp.Expr, terms: DriveTerms) -> fmpq:
    """Return an expression of ratio and radii as a rational."""
    exact = {s: exact_number(x) for s, x in terms.known.items()}
    found = expression.xreplace({s: sp.Rational(int(x.p), int(x.q)) for s, x in exact.items()})
    return fmpq(int(found.p), int(found.q))


def eliminations(equations: Sequence[Equation]) -> fmpq_mat:
    """Return the sums (W, E) of usable equations in which no unknown torque is left.

    Echelon from the back, so that as few equations as possible stand in each.
    """
    usable = [e for e, equation in enumerate(equations) if not equation.missing]
    torques = sorted({torque for e in usable for torque in equations[e].torques})
    rows = []
    for e in usable:
        unit = [fmpq(int(e == other)) for other in range(len(equations))]
        rows.append([equations[e].torques.get(torque, fmpq(0)) for torque in torques] + unit)
    if not rows:
        return fmpq_mat(0, len(equations))
    echelon, rank = fmpq_mat(rows).rref()
    kept = [row for row in echelon.tolist()[:rank] if not any(row[: len(torques)])]
    return fmpq_mat([row[len(torques) :] for row in kept]) if kept else fmpq_mat(0, len(equations))


@dataclass(frozen=True, eq=False)
class System:
    """The equations that some sensors leave: `sums` (W, E) of them are free of unknown torques.

    `names` are those of the unknown parameters: ten a body, then those of the drives.
    """

    robot: Robot
    terms: tuple[DriveTerms, ...]
    equations: tuple[Equation, ...]
    sums: NDArray[np.object_]
    names: tuple[str, ...]

    @property
    def used(self) -> frozenset[int]:
        """The places of the equations that are in a sum."""
        return frozenset(np.flatnonzero(np.any(self.sums != 0, axis=0)).tolist())


def system_of(
    robot: Robot, sensors: Mapping[str, frozenset[str]], depends: Sequence[frozenset[int]]
) -> System:
    """Return the equations of a robot that its sensors leave.

    `depends` are the joints whose motion the rigid bodies' torque at each joint depends on.
    """
    joints = robot.joint_names
    terms = tuple(drive_terms(robot.drivetrains[joint], sensors[joint]) for joint in joints)
    equations = equations_of(robot, terms, sensors, depends)
    drives = zip(joints, terms, strict=True)
    names = tuple(f"{name} of {joint}" for joint, drive in drives for name in drive.names)
    sums = eliminations(equations)
    table = np.array(sums.entries(), dtype=object).reshape(sums.nrows(), sums.ncols())
    return System(robot, terms, tuple(equations), table, (*robot.parameter_names, *names))
