"""Mistakes of a set-up with commands in place of torques: gains in another unit, signs and zeros.

Gravity and inertia of known bodies are compared with the torque of the controllers. The other
mistakes of `seaid.checks.setup` need a measured torque.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from seaid._arrays import Array
from seaid._files import toml_table
from seaid.checks import (
    FALLS,
    LEAST_GAIN,
    SEVERE,
    SUSPICIOUS,
    TIE,
    Experiment,
    fitted,
    flipped,
    scaled,
)
from seaid.errors import Finding, listed
from seaid.estimation import scaled_svd
from seaid.log import changed_source

_OTHER_UNIT = 2.0
"""Factor between the torques of controllers and of the bodies in the robot file from which gains
are in another unit. Masses by CAD are nearer, and a measured Go2 with right gains has 1.1 to
1.7."""

_WELL_KNOWN = 0.1
"""Relative standard error above which nothing is said of such a factor."""


def gain_findings(given: Experiment) -> tuple[list[Finding], Experiment]:
    """Return gains in another unit than N m by the bodies of the robot file, and it with N m.

    What is so on each joint that shows it counts as so on the others.
    """
    shown = _gain_factors(given)
    off = {j: one for j, one in shown.items() if not 1 / _OTHER_UNIT < one[0] < _OTHER_UNIT}
    if not off:
        return [], given
    factors = {j: factor for j, (factor, _) in off.items()}
    if len(off) == len(shown):
        middle = float(np.median([*factors.values()]))
        factors = {j: factors.get(j, middle) for j in _commanded(given)}
    found = _gain_finding(given, off, sorted(factors))
    for j, factor in factors.items():
        given = scaled(given, j, {"t": 1 / factor})
    return [found], given


def _commanded(given: Experiment) -> list[int]:
    """Return the joints whose torque is that of a controller with gains in N m."""
    drives, names = given.robot.drives, given.robot.joint_names
    return [j for j in given.used if drives[names[j]].controller is not None]


_LEVELS = np.linspace(0.3, 0.98, 35)
"""Shares of the samples below the torque limits that are tried."""

_UNLIMITED, _LIMITED = 0.05, 0.25
"""Residual without a limit, over the torque, from which a limit is looked for, and the part of it
that is left with the right one: at most 0.14 at three simulated limits, and at least 0.32 at SO-101
joints without one that stand most of the time, after which it was chosen."""


def hidden_limits(given: Experiment) -> list[Finding]:
    """Return controllers without a limit whose torque ends at one, by the motion that follows.

    The torque that they ask for is cut at levels; with the right one, bodies, friction and rotor
    inertia leave little of the residual.
    """
    names, found = given.robot.joint_names, []
    for j in _commanded(given) if np.all(np.isfinite(given.bodies)) else ():
        law = given.robot.drives[names[j]].controller
        if law is None or np.isfinite(law.torque_limit_Nm):
            continue
        of_bodies = given.regressor[:, j] @ given.bodies
        H = np.column_stack([of_bodies, given.friction[j], given.lever[j] * given.motor[2][:, j]])
        asked = given.lever[j] * given.torque[:, j]
        before = _share_left(H, asked)
        levels = np.quantile(np.abs(asked), _LEVELS)
        after = [_share_left(H, np.clip(asked, -level, level)) for level in levels if level > 0]
        if before < _UNLIMITED or not after or min(after) > _LIMITED * before:
            continue
        limit = float(levels[levels > 0][int(np.argmin(after))])
        share = float(np.mean(np.abs(asked) > limit))
        found.append(
            Finding(
                "saturation",
                f"the controller of {names[j]} has no torque limit and asks for up to "
                f"{float(np.max(np.abs(asked))):.3g} N m, but the joint moves as if its torque "
                f"ended at about {limit:.3g} N m ({share:.0%} of the samples): that leaves "
                f"{min(after):.2g} of the torque unexplained, no limit {before:.2g}",
                names[j],
                "wrong",
                {"torque limit": limit, "unexplained": min(after), "without a limit": before},
                f"in the drives file:\n{toml_table(names[j], 'controller')}\n"
                f"torque_limit_Nm = {limit:.3g}  # write that of your drive",
                "likely",
                (names[j],),
            )
        )
    return found


def _share_left(H: Array, y: Array) -> float:
    """Return the rms residual of a fit over that of the torque."""
    x = fitted(H, y)[0]
    return float(np.std(y - H @ x) / max(float(np.std(y)), np.finfo(float).tiny))


def _gain_factors(given: Experiment) -> dict[int, tuple[float, float]]:
    """Return the torque of controllers over that of the bodies, and its standard error, by joint.

    With any friction and any rotor inertia; of joints where it is well known, and where both
    together explain the torque.
    """
    found: dict[int, tuple[float, float]] = {}
    for j in _commanded(given) if np.all(np.isfinite(given.bodies)) else ():
        of_bodies = given.regressor[:, j] @ given.bodies
        H = np.column_stack([of_bodies, given.friction[j], given.lever[j] * given.motor[2][:, j]])
        y = given.lever[j] * given.torque[:, j]
        x, covariance = fitted(H, y)
        factor, error = float(x[0]), float(np.sqrt(covariance[0, 0]))
        is_explained = np.std(y - H @ x) < SEVERE * np.std(y)
        if factor > 0 and error < _WELL_KNOWN * factor and is_explained:
            found[j] = factor, error
    return found


def _gain_finding(
    given: Experiment, shown: Mapping[int, tuple[float, float]], joints: Sequence[int]
) -> Finding:
    """Return the finding for the factors and standard errors `shown`, and all joints concerned."""
    robot, names = given.robot, given.robot.joint_names
    each = [
        f"{names[j]} {factor:.3g}" if factor > 1 else f"{names[j]} 1/{1 / factor:.3g}"
        for j, (factor, _) in shown.items()
    ]
    error = float(np.median([error / factor for factor, error in shown.values()]))
    others = [names[j] for j in joints if j not in shown]
    more = f"; {listed(others, _MOST_JOINTS)} as the others" if others else ""
    bodies, scale = "known bodies", ""
    if not robot.known_bodies:
        bodies, scale = "bodies of the robot file", " with known bodies (known_bodies=)"
    tables = [f"{toml_table(names[j], 'controller')}\nis_up_to_scale = true" for j in joints]
    return Finding(
        "gain-scale",
        f"the controllers give many times or a fraction of the torque that moves and holds the "
        f"{bodies} ({listed(each, _MOST_JOINTS)}, +- {error:.1%}{more}): their gains are in units "
        "of the drive (counts, 1/256, per degree) and not in N m, or those bodies are wrong",
        names[joints[0]] if len(joints) == 1 else "",
        "wrong",
        {
            f"torque of {names[j]} over that of the bodies": factor
            for j, (factor, _) in shown.items()
        },
        f"gains in N m/rad, or their scale as a parameter{scale}, in the drives file:\n"
        + "\n".join(tables),
        "likely",
        joints=tuple(names[j] for j in joints),
    )


_MOST_JOINTS = 12
"""Most joints in a message."""


_GRID, _NEAREST = math.radians(30), math.radians(1)
"""First and last step of the search for the zero of a joint [rad]."""

_BEYOND = math.radians(10)
"""Most that the zero of a joint may move its range beyond the limits of the robot file [rad]."""

_PASSES, _POSE_INSTANTS = 3, 50
"""Passes of the search over all joints, one after the other, and instants that it uses."""

Poses = dict[int, tuple[float, float]]
"""{joint: sign and offset [rad] of its position}."""


def pose_findings(given: Experiment) -> list[Finding]:
    """Return signs and zeros of joints with position commands that gravity contradicts.

    By gravity on the known bodies. Command and position have one sign and one zero, and the torque
    between them has that sign.
    """
    robot = given.robot
    commanded = [j for j in _commanded(given) if not robot.is_prismatic[j]]
    is_known = bool(robot.known_bodies) and bool(np.all(np.isfinite(given.bodies)))
    if not (is_known and commanded and np.any(robot.model.gravity.linear)):
        return []
    given = _with_poses(_thinned(given), {})
    found: list[Finding] = []
    if np.nanmax(given.nominal) > SUSPICIOUS:
        pairs: list[Poses] = [
            {i: (-1.0, 0.0), j: (-1.0, 0.0)} for i, j in combinations(commanded, 2)
        ]
        starts = [{}, *sorted(pairs, key=lambda one: _pose_cost(given, one))[:1]]
        starts = [one for one in starts if _pose_cost(given, one) <= _pose_cost(given, {})]
        poses = min(
            (_searched(given, commanded, start) for start in starts),
            key=lambda one: _pose_cost(given, one),
        )
        for j in sorted(poses):
            finding = _pose_finding(given, poses, j)
            found += [] if finding is None else [finding]
    return found


def _thinned(given: Experiment) -> Experiment:
    """Return the experiment at fewer instants."""
    part = slice(None, None, max(1, len(given.direction) // _POSE_INSTANTS))
    return replace(
        given,
        log=given.log[part],
        motor=given.motor[:, part],
        joint=given.joint[:, part],
        direction=given.direction[part],
        torque=given.torque[part],
        torque_rate=given.torque_rate[part],
        sensed=given.sensed[part],
    )


def _with_poses(given: Experiment, poses: Poses) -> Experiment:
    """Return the experiment with sign * position + offset of joints, at both encoders.

    Unknown rotor inertias are those that explain the torques best.
    """
    for j, (sign, offset) in poses.items():
        found = flipped(given, j, "qmt") if sign < 0 else given
        joint, motor = found.joint.copy(), found.motor.copy()
        joint[0, :, j] += offset
        motor[0, :, j] += found.lever[j] * offset
        given = replace(found, joint=joint, motor=motor)
    inertia, left = given.inertia.copy(), given.lever * given.torque
    left = left - given.regressor @ given.bodies
    for j in given.used:
        if given.robot.drives[given.robot.joint_names[j]].motor_inertia_kg_m2 is None:
            rotor = given.lever[j] * given.motor[2][:, j]
            columns = np.column_stack([given.friction[j], rotor])
            inertia[j] = max(float(scaled_svd(columns).solve(left[:, j])[-1]), 0.0)
    found = replace(given, inertia=inertia)
    vars(found)["regressor"] = given.regressor  # of the same motion: not computed again
    return found


def _pose_cost(given: Experiment, poses: Poses) -> float:
    """Return the cost of signs and zeros: that of the misfit, and one of each change."""
    changes = sum(0.5 * (sign < 0) + 0.5 * (offset != 0) for sign, offset in poses.values())
    return _with_poses(given, poses).cost("nominal") + float(changes)


def _searched(given: Experiment, joints: Sequence[int], poses: Poses) -> Poses:
    """Return the signs and zeros that explain most, found joint by joint from a start."""
    cost = _pose_cost(given, poses)
    for _ in range(_PASSES):
        before = cost
        for j in joints:
            others = {i: pose for i, pose in poses.items() if i != j}
            tried = [(_pose_cost(given, others), others)]
            for sign in (1.0, -1.0):
                best = _best_zero(given, others, j, sign, cost)
                tried += [] if best is None else [best]
            best_cost, best_poses = min(tried, key=lambda one: one[0])
            if best_cost < cost:
                cost, poses = best_cost, best_poses
        if before - cost < TIE:
            break
    return poses


def _best_zero(
    given: Experiment, others: Poses, j: int, sign: float, most_cost: float
) -> tuple[float, Poses] | None:
    """Return the best cost, and poses, with a sign of joint j, within its limits.

    A grid that comes nowhere near `most_cost` has none.
    """
    robot, moved = given.robot, sign * given.joint[0][:, j]
    lower, upper = robot.position_range(robot.joint_names[j])
    least = max(lower - float(moved.min()) - _BEYOND, -math.pi)
    most = min(upper - float(moved.max()) + _BEYOND, math.pi)

    def at(offset: float) -> tuple[float, float]:
        return _pose_cost(given, others | {j: (sign, offset)}), offset

    grid = [float(x) for x in np.arange(-6, 7) * _GRID if least <= x <= most]
    if not grid:
        return None
    best, step = min(map(at, grid)), 0.5 * _GRID
    if best[0] > most_cost + LEAST_GAIN:
        return None
    while step > 0.5 * _NEAREST:
        best, step = min([best, *(at(best[1] + x) for x in (-step, step))]), 0.5 * step
    cost, offset = min(best, at(math.radians(round(math.degrees(best[1])))))
    if sign > 0 and abs(offset) < 3 * _NEAREST:
        return None
    return cost, others | {j: (sign, offset)}


def _pose_finding(given: Experiment, poses: Poses, j: int) -> Finding | None:
    """Return the finding of one joint, None if the others explain the torques without it."""
    sign, offset = poses[j]
    others = {i: pose for i, pose in poses.items() if i != j}
    gain = _pose_cost(given, others) - _pose_cost(given, poses)
    before, after = (_with_poses(given, one).nominal for one in (others, poses))
    falls = (before > SUSPICIOUS) & (after < FALLS * before)
    if gain < LEAST_GAIN or not np.any(falls):
        return None
    names, joint = given.robot.joint_names, given.robot.joint_names[j]
    worst = int(np.argmax(np.where(falls, before / np.maximum(after, 1e-9), 0.0)))
    zero = f"its zero {math.degrees(offset):.0f} degrees from that of the robot file"
    parts = [*(["the opposite sign"] if sign < 0 else []), *([zero] if offset else [])]
    per_joint = {"motor_position": float(given.ratio[j])}
    lines = [
        f"{one} = {changed_source(source, factor=sign, offset=round(moved, 4))}"
        for one in (*given.logged(j, "qm"), "position_command")
        for source, moved in [(given.source(j, one), offset * per_joint.get(one, 1.0))]
    ]
    if sign < 0:
        lines += ["# the same sign for velocity_command and torque_command, if the log has them"]
    return Finding(
        "sign" if sign < 0 else "encoder-offset",
        f"the position of {joint} has {' and '.join(parts)}: the part of the torque of "
        f"{names[worst]} that gravity on the known bodies leaves unexplained falls from "
        f"{before[worst]:.0%} to {after[worst]:.0%}",
        joint,
        "wrong",
        {
            "offset [rad]": offset,
            "misfit as given": float(before[worst]),
            "misfit without it": float(after[worst]),
        },
        "\n".join(["in the description of the log:", toml_table("joints", joint), *lines]),
        "likely",
    )
