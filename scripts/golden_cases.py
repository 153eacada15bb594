"""The cases of the golden results: one declared list, by group.

Case functions use what seaid shows in `seaid.*`, and robots and plants of other scripts, so that
they keep running while the inside is rebuilt. Everything random has a seed. Logs that several
cases share are simulated once per process: such cases are one batch.

Of the gauntlet there are the right set-ups and the severe form of each mistake at all four robots,
and the mild form at two of them. Of wrong set-ups the base parameters are not kept. The biped
moves for 8 s. Motions of the Philips arm are random and not planned, since the end of a search for
a motion depends on rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import seaid
from scripts.gauntlet_robots import load, subjects
from scripts.golden_measured import command_cases, go2_found, init_cases, measured_cases
from scripts.golden_records import (
    Case,
    KnownWrong,
    Records,
    exported,
    number,
    parameters,
    text,
)
from scripts.golden_simulated import gauntlet_cases, leg_cases, plant_cases, stiff_arm, term_cases

BOTH = ("motor_position", "joint_position")


def export_cases() -> list[Case]:
    """Return the cases of files for simulators."""
    return [
        Case("stiff arm, files", "exports", partial(exported, stiff_arm), True, "stiff plain"),
        Case(
            "stiff arm, parameters", "exports", partial(parameters, stiff_arm), batch="stiff plain"
        ),
        Case("Go2, files", "exports", partial(exported, go2_found), batch="Go2"),
    ]


def _identifiability(name: str, sensors: Sequence[str]) -> Records:
    subject = subjects()[name]
    robot = load(subject.urdf, subject.drives)
    found = seaid.identifiability(robot, sensors)  # type: ignore[arg-type]
    return {
        "rank": number(found.rank),
        "doubles agree": text(found.agree),
        "identifiable": text("; ".join(found.identifiable)),
        "combinations": text("; ".join(found.combinations)),
        "up to scale": text("; ".join(map(str, found.ratios))),
        "unidentifiable": text("; ".join(found.unidentifiable)),
    }


def _base_of(equations: Any, motion: Sequence[Any], unknowns: Sequence[Any]) -> Records:
    from seaid.symbolic import reduce, separate

    base = reduce(separate(equations, motion, unknowns))
    records = {f"parameter {place}": text(x) for place, x in enumerate(base.parameters)}
    return records | {"base": number(len(base.parameters)), "up to scale": text(base.ratios)}


def _link_with_unknown_ratio() -> Records:
    """(7) and (8) of one link on which a known torque acts, with an unknown gear ratio."""
    import sympy as sp

    motor, joint, torque, outside = (
        sp.Function(name)(sp.Symbol("t")) for name in ("theta_M", "theta_L", "tau_M", "tau_E")
    )
    I_M, F_v, F_C, k, N, J, mx = sp.symbols("I_M F_v F_C k N J mx")
    r_M, r_L, g = sp.symbols("r_M r_L g")
    speed, stretch = motor.diff(), r_M / N * motor - r_L * joint
    seven = I_M * speed.diff() + F_v * speed + F_C * sp.sign(speed) + r_M / N * k * stretch - torque
    eight = J * joint.diff().diff() + mx * g * sp.sin(joint) - r_L * k * stretch - outside
    signals = [motor, joint, torque, outside]
    return _base_of([seven, eight], signals, [I_M, F_v, F_C, k, N, J, mx])


def _ball_and_beam() -> Records:
    """The ball and beam with an unknown radius of the ball: the rank is 3."""
    import sympy as sp

    from seaid.symbolic import equations_of_motion

    x, angle = (sp.Function(name)(sp.Symbol("t")) for name in ("x", "theta"))
    m, R, J, J_b, g, u = sp.symbols("m R J J_b g u")
    energy = (m + J / R**2) * x.diff() ** 2 / 2 + (J_b + m * x**2) * angle.diff() ** 2 / 2
    lagrangian = energy - m * g * x * sp.sin(angle)
    equations = equations_of_motion(lagrangian, [x, angle], [0, u])
    return _base_of(equations, [x, angle], [m, J, J_b, R])


def structure_cases() -> list[Case]:
    """Return the cases of identifiability, and of systems that are no URDF."""
    group = "identifiability"
    sensors: dict[str, tuple[str, ...]] = {
        "all": (*BOTH, "motor_torque"),
        "no torque": BOTH,
        "motor side": ("motor_position", "motor_torque"),
    }
    return [
        *(
            Case(
                f"{robot}, {name}",
                group,
                partial(_identifiability, robot, chosen),
                quick=(robot, name) == ("scara", "no torque"),
            )
            for robot in ("leg", "scara")
            for name, chosen in sensors.items()
        ),
        Case("one link, unknown gear ratio", group, _link_with_unknown_ratio, True),
        Case("ball and beam, unknown radius", group, _ball_and_beam, True),
    ]


@cache
def cases() -> tuple[Case, ...]:
    """Return all cases, those that take longest first."""
    return (
        *leg_cases(),
        *plant_cases(),
        *command_cases(),
        *gauntlet_cases(),
        *measured_cases(),
        *term_cases(),
        *export_cases(),
        *init_cases(),
        *structure_cases(),
    )


GROUPS: tuple[str, ...] = tuple(dict.fromkeys(case.group for case in cases()))

KNOWN_WRONG: tuple[KnownWrong, ...] = (
    KnownWrong(
        "leg, right, bare, 1 log, seed 2",
        "codes ankle_pitch",
        "a delay is reported where the spring is too weak to be seen",
    ),
    KnownWrong(
        "leg, robot hardly moving (mild)",
        "codes *",
        "a delay is reported where the robot hardly moves",
    ),
)
"""What is wrong in the baseline, and the repair of which is no loss."""
