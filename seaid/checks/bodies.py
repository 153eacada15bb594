"""Mistakes about bodies as transforms: other gravity, lengths, zeros and payloads than given."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations, product

import numpy as np

from seaid._arrays import Array
from seaid.checks.check import only_joint, zeros_in_description
from seaid.checks.codes import ENCODER_OFFSET, GEOMETRY, GRAVITY, PAYLOAD
from seaid.checks.experiment import Experiment, Transform
from seaid.estimation import scaled_svd, triangle
from seaid.regressor import regressor_at_drives

_USUAL = (2.0, 3.0, 4.0, 5.0, 10.0, 100.0, 1000.0)


def near(factor: float, *others: float) -> list[float]:
    """Return a factor, and the usual ones within a fifth of it: mistakes are often round."""
    usual = [*_USUAL, *others, *(1 / one for one in (*_USUAL, *others))]
    return [*(one for one in usual if abs(math.log(factor / one)) < 0.2), factor]


def penalty_of(factor: float, estimated: float | None) -> float:
    """Return the penalty of a factor that is not a usual one, but estimated."""
    return ROUND if factor == estimated else 0.0


ROUND = 0.3


CORRELATED_ROWS = 4.0
"""Instants per independent one: those of a joint are about eight per period of the cutoff."""


def _with_gravity(given: Experiment, gravity: Array) -> Experiment:
    model = given.robot.model.copy()
    model.gravity.linear = gravity
    return replace(given, robot=replace(given.robot, model=model))


def gravities(given: Experiment) -> Iterator[Transform]:
    """Yield the directions of gravity along the axes, and the one that explains most."""
    now = np.array(given.robot.model.gravity.linear)
    size = float(np.linalg.norm(now))
    if size == 0:
        return
    down = -size * np.eye(3)[2]  # the usual one, where a torque does not have the sign of gravity
    choices = [(size * sign * axis, ROUND) for axis in np.eye(3) for sign in (1.0, -1.0)]
    choices[-1] = down, 0.0
    best = _best_gravity(given)
    if best is not None:
        choices.append((size * best, 0.5))
    for one, penalty in choices:
        angle = math.degrees(math.acos(float(np.clip(one @ now / size**2, -1, 1))))
        if angle < _LEAST_TILT_DEG:
            continue
        text = ",".join(f"{x:.4g}" for x in one + 0.0)
        yield Transform(
            GRAVITY,
            f"gravity has the direction ({text}) m/s^2 in the base frame, {angle:.0f} degrees from "
            "the one given: a tilted base",
            partial(_with_gravity, gravity=one),
            remedy=f"option: --gravity {text}",
            severity="wrong" if angle > 3 * _LEAST_TILT_DEG else "doubtful",
            evidence={"tilt [deg]": angle},
            penalty=penalty,
        )


_LEAST_TILT_DEG = 2.0


def _best_gravity(given: Experiment) -> Array | None:
    """Return the unit direction of gravity by which the nominal bodies explain most."""
    still = 0 * given.joint[1]
    zero = given.joint[0], still, still
    size = float(np.linalg.norm(given.robot.model.gravity.linear))
    columns = [
        regressor_at_drives(_with_gravity(given, size * axis).robot, *zero) @ given.bodies
        for axis in np.eye(3)
    ]
    A = np.column_stack([given.weighed(one) for one in columns])
    left = given.weighed(given.target - given.regressor @ given.bodies)
    now = np.array(given.robot.model.gravity.linear) / size
    found = now + scaled_svd(A).solve(left, _SEEN)  # what the motion does not show stays as given
    norm = float(np.linalg.norm(found))
    return np.asarray(found / norm) if norm > 0.3 else None


_SEEN = 0.05
"""Singular value, over the largest, of a direction of gravity that the motion shows."""

_LENGTH_STEP, _LEAST_LENGTH = 0.01, 0.03


def lengths(given: Experiment) -> Iterator[Transform]:
    """Yield other distances between joints, by the first-order effect on the nominal torque."""
    before = given.regressor @ given.bodies
    for joint in given.robot.joint_names[1:]:
        changed = _with_length(given, joint, 1 + _LENGTH_STEP)
        if changed is given:
            continue
        slope = (changed.regressor @ given.bodies - before) / _LENGTH_STEP
        x = given.weighed(slope)
        size = float(x @ x)
        factor = 1 + float(x @ given.weighed(given.target - before)) / size if size else 1
        if abs(factor - 1) < _LEAST_LENGTH or not 0.3 < factor < 3.0:
            continue
        yield Transform(
            GEOMETRY,
            f"the distance of {joint} from the joint before it is {factor:.3g} times that of the "
            "robot file",
            partial(_with_length, joint=joint, factor=factor),
            joint,
            f"in the robot file: the origin of joint {joint}, xyz times {factor:.4g}",
            "wrong" if abs(factor - 1) > 3 * _LEAST_LENGTH else "doubtful",
            {"factor": factor},
            penalty=0.5,
        )


_LEAST_ZERO, _FAR_ZERO = 0.1, 0.5
"""Error of the zero of a joint [rad] that errors of nominal bodies do not make; one beyond which
the effect of an angle on the torque is not linear."""

_QUARTERS = (math.pi / 2, -math.pi / 2)
"""Angles by which an encoder or a horn is mounted off."""


def zeros(given: Experiment) -> Iterator[Transform]:
    """Yield other zeros of joints: by the first-order effect on the nominal torque, and round."""
    before = given.regressor @ given.bodies
    for j in _turning(given):
        ahead = _with_zeros(given, {j: _ZERO_STEP})
        slope = given.weighed((ahead.regressor @ given.bodies - before) / _ZERO_STEP)
        size = float(slope @ slope)
        angle = float(slope @ given.weighed(given.target - before)) / size if size else 0.0
        if _LEAST_ZERO < abs(angle) < _FAR_ZERO:
            yield _moved(given, {j: angle}, 0.5)
        for turn in (*_QUARTERS, math.pi):
            yield _moved(given, {j: turn}, ROUND)


def zeros_of_two(given: Experiment) -> Iterator[Transform]:
    """Yield zeros of two joints that are off by a quarter of a turn each."""
    for pair in combinations(_turning(given), 2):
        for turns in product(_QUARTERS, repeat=2):
            yield _moved(given, dict(zip(pair, turns, strict=True)), 2 * ROUND)


def _turning(given: Experiment) -> list[int]:
    return [j for j in given.used if not given.robot.is_prismatic[j]]


def _moved(given: Experiment, angles: dict[int, float], penalty: float) -> Transform:
    """Return the transform that adds angles to the zeros of joints."""
    named = {given.robot.joint_names[j]: angle for j, angle in angles.items()}
    words = " and ".join(f"{math.degrees(x):.3g} degrees at {joint}" for joint, x in named.items())
    return Transform(
        ENCODER_OFFSET,
        f"the zeros of joints are not those of the robot file, by {words}",
        partial(_with_zeros, angles=angles),
        only_joint([*named]),
        zeros_in_description(given.robot, named, given.sources[0]),
        evidence={f"offset of {joint} [rad]": angle for joint, angle in named.items()},
        penalty=penalty,
    )


_ZERO_STEP = 1e-4
"""Step [rad] of the difference quotient by the zero of a joint."""


def _with_zeros(given: Experiment, angles: dict[int, float]) -> Experiment:
    joint = given.joint.copy()
    for j, angle in angles.items():
        joint[0, :, j] += angle
    return replace(given, joint=joint)


def _with_length(given: Experiment, joint: str, factor: float) -> Experiment:
    robot = given.robot
    model = robot.model.copy()
    place = robot.model_order.index(robot.index(joint)) + 1
    placement = model.jointPlacements[place].copy()
    if np.linalg.norm(placement.translation) < 1e-3:
        return given
    placement.translation = factor * placement.translation
    model.jointPlacements[place] = placement
    return replace(given, robot=replace(robot, model=model))


def payloads(given: Experiment) -> Iterator[Transform]:
    """Yield a payload that is absent, there twice, or on another link."""
    robot = given.robot
    known = robot.payload_parameters.reshape(-1, 10)
    for body in np.flatnonzero(known[:, 0]).tolist():
        own = np.zeros_like(known)
        own[body] = known[body]
        mass, name = own[body, 0], robot.body_names[body]
        com = ",".join(f"{x:.4g}" for x in own[body, 1:4] / mass + 0.0)
        text = f"the payload of {mass:.4g} kg on {name}"
        factor, error = _share(given, own.ravel())
        absent = f"option: without --payload {name}:{mass:g}:{com}"
        choices = [(-own, f"{text} is not there", absent, 0.0)]
        is_there = factor > max(_LEAST_PAYLOAD, 2 * error)
        for other in near(factor) if is_there and abs(factor - 1) > _LEAST_PAYLOAD else ():
            heavier = f"option: --payload {name}:{other * mass:.3g}:{com}"
            words = f"{text} has {other * mass:.3g} kg"
            choices.append(((other - 1) * own, words, heavier, penalty_of(other, factor)))
        for change, message, remedy, penalty in choices:
            undo = partial(replace, bodies=given.bodies + change.ravel())
            joint = robot.joint_of(body)
            yield Transform(PAYLOAD, message, undo, joint, remedy, penalty=penalty)
        yield from _placed(given, given.bodies - own.ravel(), text, mass)
    if not np.any(known) and not robot.known_bodies:
        yield from _placed(given, given.bodies, "a payload that was not named", None)


def _placed(given: Experiment, bodies: Array, text: str, mass: float | None) -> Iterator[Transform]:
    """Yield a point mass at each body, where it explains the torques best: of a `mass`, or any."""
    robot = given.robot
    for body, link in enumerate(robot.body_names):
        point = _point_mass(given, bodies, body, mass)
        if point[0] <= _LEAST_SHARE * abs(bodies[10 * body]) or not np.all(np.isfinite(point)):
            continue
        com = ",".join(f"{x:.3g}" for x in point[1:4] / point[0] + 0.0)
        changed = bodies.copy()
        changed[10 * body : 10 * body + 10] += point
        yield Transform(
            PAYLOAD,
            f"{text} is on {link}, {point[0]:.3g} kg at ({com}) m",
            partial(replace, bodies=changed),
            robot.joint_of(body),
            f"option: --payload {link}:{point[0]:.3g}:{com}",
            "wrong" if mass is not None else "doubtful",
            penalty=1.0 if mass is not None else _UNNAMED,
        )


_UNNAMED = 4.0
"""Penalty of a payload that was not named, which resembles an error of the nominal bodies."""

_LEAST_SHARE, _FARTHEST_M, _STEPS, _STARTS = 0.3, 5.0, 8, (0.3, 30.0, 5)
"""Mass over that of its body from which a payload is looked for; its largest distance from the
joint; steps of its estimate; first, last and number of the masses from which an unknown one is
searched, over that of its body."""


def _point_mass(given: Experiment, bodies: Array, body: int, mass: float | None) -> Array:
    """Return the ten parameters of the point mass on a body that explains the torques best.

    They are [m, m c, m (c^2 1 - c c^T)] for a mass m at c. An unknown mass has several starts.
    """
    columns = given.regressor[:, :, 10 * body : 10 * body + 10]
    X = [given.weighed(columns[:, :, place]) for place in range(10)]
    R = triangle(np.column_stack([*X, given.weighed(given.target - given.regressor @ bodies)]))
    starts = [mass] if mass else max(abs(bodies[10 * body]), 0.1) * np.geomspace(*_STARTS)
    points = [_fitted_point(R, float(start), free=mass is None) for start in starts]
    return min(points, key=lambda point: float(np.linalg.norm(R[:, :10] @ point - R[:, 10])))


def _fitted_point(R: Array, m: float, *, free: bool) -> Array:
    """Return a point mass by Gauss-Newton steps in its place, and if it is `free` in its mass m.

    `R` (11, 11) is the triangular factor of the ten columns and of the torque.
    """
    c, places = np.zeros(3), slice(0 if free else 1, None)
    for _ in range(_STEPS):
        by_place = [
            _parameters(0.0, m * e, m * (2 * (c @ e) * np.eye(3) - np.outer(e, c) - np.outer(c, e)))
            for e in np.eye(3)
        ]
        point = _point(m, c)
        slopes, step = np.column_stack([point / m, *by_place])[:, places], np.zeros(4)
        step[places] = scaled_svd(R[:, :10] @ slopes).solve(R[:, 10] - R[:, :10] @ point, 1e-3)
        m, c = m + float(step[0]), c + step[1:]
        if m <= 0 or np.linalg.norm(c) > _FARTHEST_M:
            return np.zeros(10)
    return _point(m, c)


def _point(m: float, c: Array) -> Array:
    """Return the ten parameters of a mass m at c."""
    return _parameters(m, m * c, m * ((c @ c) * np.eye(3) - np.outer(c, c)))


def _parameters(mass: float, moments: Array, J: Array) -> Array:
    """Return ten parameters in the order of Pinocchio."""
    return np.array([mass, *moments, *J[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])


_LEAST_PAYLOAD = 0.1
"""Relative error of a payload's mass below which it is not distinguished from those of the file."""


def _share(given: Experiment, part: Array) -> tuple[float, float]:
    """Return the multiple of a part (10n,) of the bodies in the torques, and its standard error."""
    rest = given.target - given.regressor @ (given.bodies - part)
    y, x = given.weighed(rest), given.weighed(given.regressor @ part)
    size = float(x @ x)
    error = math.sqrt(CORRELATED_ROWS / max(size, 1e-300))
    return float(x @ y) / size if size > 0 else 1.0, error
