"""What a gear does that the drive does not have: periodic errors, other joints, other ratios.

The errors of a gear and its encoders are periodic in the angle of the motor or of the joint; a
motor may move with several joints; the ratio of a linkage depends on the angle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array
from seaid._files import toml_key
from seaid.checks.check import in_drives
from seaid.checks.codes import COUPLED_JOINTS, GEAR_RATIO, TRANSMISSION_ERROR, VARYING_RATIO
from seaid.checks.engine import Accepted, Alternative, Candidate, ColumnCheck, Equation, Point
from seaid.checks.terms import DriveRows
from seaid.checks.tolerances import PART, POOR
from seaid.drives import Drive
from seaid.errors import Finding, listed
from seaid.regressor import motor_regressor

if TYPE_CHECKING:
    from seaid.checks.columns import Side


_ORDERS = {"motor": (1, 2, 3, 4, 6), "joint": (1, 2, 3, 4, 5, 6, 8, 10, 12), "mesh": (1, 2)}
"""Orders that are tried: turns and poles of the motor, turns of the joint, and the two lobes of
strain-wave gears. Higher orders of the motor turn faster than a cutoff lets pass."""

_LEAST_PERIODS = 0.5
"""An order is tried if the motion covers so many of its periods; fewer look like the spring."""


def _orders(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the cosine and sine of the orders that a drive lacks and the motion covers."""
    if not side.is_motor:
        return
    drive, exact, few = side.robot.drives[joint], side.drive(joint), side.drive(joint, few=True)
    angles = _angles(drive, exact.signals)
    own = {(one.angle, one.order) for one in drive.harmonics}
    for name, orders in _ORDERS.items():
        width = max((float(np.ptp(angle)) for angle in angles.get(name, ())), default=0.0)
        if name == "mesh" and width < 2 * np.pi * drive.ratio:  # it has the orders of the motor
            continue
        for order in orders:
            if (name, order) not in own and order * width >= 2 * np.pi * _LEAST_PERIODS:
                points = partial(_harmonic, side.equation, exact, few, name, order)
                yield Candidate(joint, name, str(order), points)


def _angles(drive: Drive, signals: Sequence[Mapping[str, Array]]) -> dict[str, list[Array]]:
    """Return the angles of each motion by name."""
    angles = {
        "motor": [one["theta_M"] for one in signals],
        "mesh": [one["theta_M"] * (1 - 1 / drive.ratio) for one in signals],
    }
    if drive.joint_units[1] == "rad":
        angles["joint"] = [one["theta_L"] for one in signals]
    return angles


_LEAST_LEFT = 0.1
"""Least part of a harmonic that the low pass and the other columns leave, to be tried at all."""


def _harmonic(
    equation: Equation, exact: DriveRows, few: DriveRows, name: str, order: int, of_few: bool
) -> list[Point]:
    drive = few if of_few else exact
    angles = _angles(exact.robot.drives[exact.joint], drive.signals)[name]
    parts = [np.column_stack([np.cos(order * x), np.sin(order * x)]) for x in angles]
    pair = drive.at_rows(parts)
    left = np.abs(np.diag(np.linalg.qr(equation.left(pair))[1]))
    if np.min(left) < _LEAST_LEFT * np.sqrt(0.5 * len(pair)):  # norm of a cosine over its periods
        return []
    return [Point({}, Alternative(pair, 2))]


def _couplings(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the angles of other joints: a motor that moves with them has them in (7).

    Not where the deflection is measured, which shows the spring alone.
    """
    if side.is_motor and joint not in side.gears:
        for other in side.robot.joint_names:
            if other not in {joint, *side.robot.drives[joint].transmission}:
                yield Candidate(joint, _COUPLED, other, partial(_angle, side, joint, other))


def _varying_ratio(side: Side, joint: str) -> Iterator[Candidate]:
    """Yield the angle that a motor has more where its ratio varies once per turn of its joint."""
    is_rotary = side.robot.drives[joint].joint_units[1] == "rad"
    if side.is_motor and is_rotary and joint not in side.gears:
        yield Candidate(joint, _VARYING, "joint", partial(_angle, side, joint, joint))


_COUPLED, _VARYING = "coupled", "varying"
"""Fields of the candidates of a motor that moves with two joints, and of a ratio that varies."""


def _angle(side: Side, joint: str, moving: str, of_few: bool) -> list[Point]:
    """Return the angle of another joint at the rows, or the angle, cosine and sine of the own."""
    drive, index = side.drive(joint, few=of_few), side.robot.index(moving)
    angles = [motion.joint_position[:, index] for motion in drive.motions]
    if moving == joint:
        parts = [np.column_stack([x, np.cos(x), np.sin(x)]) for x in angles]
    else:
        parts = [x[:, None] for x in angles]
    columns = drive.at_rows(parts)
    return [Point({}, Alternative(columns, columns.shape[1]))]


_DOUBTFUL_ORDERS = 0.3
"""Share of the residual that orders must explain to make a result doubtful."""


def _periodic(side: Side, joint: str, accepted: Sequence[Accepted], share: float) -> Finding:
    """Return the finding of periodic errors, with their orders as TOML."""
    drive, estimate = side.robot.drives[joint], side.fitted.estimate
    is_error = joint not in side.gears and not drive.is_nonlinear_spring
    field = "transmission_error" if is_error else "torque_ripple"
    orders = [(one.trial.candidate.field, int(one.trial.candidate.term)) for one in accepted]
    text = ", ".join(f"order {order} of the {angle}" for angle, order in orders)
    evidence = {"share of the residual": share}
    if is_error and "stiffness" in estimate.names and estimate.value("stiffness") > 0:
        is_motor = side.drive(joint).regressor is motor_regressor
        lever = drive.motor_radius / drive.ratio if is_motor else 1.0
        largest = max(float(np.linalg.norm(one.coefficients)) for one in accepted)
        error = largest / (lever * estimate.value("stiffness"))
        evidence["amplitude"] = error
        text += f"; up to {1e3 * error:.2g} m{drive.spring_units[1]} between the encoders"
    by_angle: dict[str, list[int]] = {}
    own = [(one.angle, one.order) for one in drive.harmonics if one.field == field]
    for angle, order in [*own, *orders]:
        by_angle.setdefault(angle, []).append(order)
    table = ", ".join(f"{angle} = {sorted(numbers)}" for angle, numbers in by_angle.items())
    return TRANSMISSION_ERROR.finding(
        f"{share:.0%} of the residual of (10) of {joint} is periodic ({text}): an error of the "
        "gear or its encoders, or ripple of the motor",
        joint,
        "doubtful" if share >= _DOUBTFUL_ORDERS else "note",
        evidence,
        in_drives({(joint,): f"{field} = {{ {table} }}"}),
    )


def _spring_of(side: Side, joint: str, accepted: Sequence[Accepted]) -> float:
    """Return what an angle of the joint adds to the equation of its motor, next to columns."""
    drive, equation = side.robot.drives[joint], side.equation
    for found in accepted:
        assert found.trial.alternative is not None
        equation = equation.with_alternative(found.trial.alternative)
    stiffness = equation.values[side.fitted.estimate.names.index("stiffness")]
    is_motor = side.drive(joint).regressor is motor_regressor
    lever = drive.motor_radius / drive.ratio if is_motor else 1.0
    return float(stiffness) * drive.load_radius * lever


def _moves_with(
    side: Side, joint: str, accepted: Sequence[Accepted], share: float
) -> Finding | None:
    """Return the finding of a motor that moves with other joints than its own.

    None where the part of another joint is small: flexible links turn encoders by thousandths.
    """
    spring, turned = _spring_of(side, joint, accepted), {joint: 1.0}
    said = []
    for found in accepted:
        other = found.trial.candidate.term
        turns, error = (float(x[0]) / spring for x in (-found.coefficients, found.errors))
        turned[other] = turns
        said.append(f"{turns:.3g} +- {abs(error):.1g} times with {other}")
    if max(abs(turns) for other, turns in turned.items() if other != joint) < POOR:
        return None
    table = ", ".join(f"{toml_key(other)} = {turns:.4g}" for other, turns in turned.items())
    return COUPLED_JOINTS.finding(
        f"the motor of {joint} turns behind its gear as {joint} and {listed(said)}: that explains "
        f"{share:.0%} of the squared residual of its motor equation. It drives several joints, by "
        f"a differential, a tendon or a parallel linkage; or the encoder of {joint} measures its "
        "angle against another link than the one before it",
        joint,
        "wrong" if share > PART else "doubtful",
        {
            **{f"turns with {other}": turns for other, turns in turned.items()},
            "explained": share,
        },
        in_drives({(joint,): f"transmission = {{ {table} }}"}),
    )


def _ratio_varies(
    side: Side, joint: str, accepted: Sequence[Accepted], share: float
) -> Finding | None:
    """Return the finding of a ratio that depends on the angle, None where it hardly does.

    A motor that turns by N (q + e q + c cos q + s sin q) has, for its angle, the ratio
    N (1 + e - c sin q + s cos q). That of its torque is not in the columns.
    """
    drive, index = side.robot.drives[joint], side.robot.index(joint)
    slope, cosine, sine = -accepted[0].coefficients / _spring_of(side, joint, accepted)
    reached = np.concatenate([motion.joint_position[:, index] for motion in side.motions])
    angles = np.linspace(np.min(reached), np.max(reached), _ANGLES)
    ratios = drive.ratio * (1.0 + slope - cosine * np.sin(angles) + sine * np.cos(angles))
    low, high = int(np.argmin(ratios)), int(np.argmax(ratios))
    if ratios[high] - ratios[low] < POOR * abs(float(np.mean(ratios))):
        return None
    return VARYING_RATIO.finding(
        f"the gear ratio of {joint} depends on its angle: {ratios[low]:.3g} at {angles[low]:.2g} "
        f"rad and {ratios[high]:.3g} at {angles[high]:.2g} rad, where the drives file has "
        f"{drive.ratio:g}. This explains {share:.0%} of the squared residual of its motor "
        "equation: the transmission is a linkage, a lever or a spindle",
        joint,
        "wrong",
        {
            "least ratio": float(ratios[low]),
            "largest ratio": float(ratios[high]),
            "cos [rad]": float(cosine),
            "sin [rad]": float(sine),
            "explained": share,
        },
        "convert angle and torque of the motor to those of a gear with a constant ratio, by the "
        "geometry of the linkage, before the log is read",
    )


_ANGLES = 50
"""Angles at which a ratio is evaluated, over the range of a joint."""


GEAR_CHECKS = (
    ColumnCheck(
        COUPLED_JOINTS,
        _couplings,
        _moves_with,
        "a motor that moves with {term}",
        "a motor that turns while its joint is held and another joint is moved drives both",
    ),
    ColumnCheck(
        VARYING_RATIO,
        _varying_ratio,
        _ratio_varies,
        "a gear ratio that varies with the angle",
        "both encoders of a joint that is slowly turned without a load show its ratio",
        (GEAR_RATIO,),
    ),
    ColumnCheck(
        TRANSMISSION_ERROR,
        _orders,
        _periodic,
        "an error of the gear (order {term} of the {field})",
        "both encoders of a joint that is slowly turned without a load show the errors of its gear",
    ),
)
"""The checks of a gear, in the order in which their findings are listed."""
