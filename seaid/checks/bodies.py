"""Mistakes about bodies as transforms: other gravity, lengths, zeros and payloads than given."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, combinations, product

import numpy as np
import scipy

from seaid._arrays import Array
from seaid.checks import codes
from seaid.checks import tolerances as tol
from seaid.checks.codes import CODES, Cause, only_joint, undecided, with_payload
from seaid.checks.experiment import (
    Experiment,
    Transform,
    best_factors,
    best_value,
    best_values,
    moved,
    multiplied,
    near,
)
from seaid.errors import Finding, Severity, listed
from seaid.estimation.qr_factor import RANK_TOLERANCE, posterior, scaled_svd, triangle
from seaid.log.description import moved_zeros
from seaid.regressor.base import regressor_at_drives


def _with_gravity(experiment: Experiment, gravity: Array) -> Experiment:
    model = experiment.robot.model.copy()
    model.gravity.linear = gravity
    return experiment.with_changes(robot=replace(experiment.robot, model=model))


def gravities(experiment: Experiment) -> Iterator[Transform]:
    """Yield the directions of gravity along the axes, and the one that explains most."""
    now = np.array(experiment.robot.model.gravity.linear)
    size = float(np.linalg.norm(now))
    if size == 0:
        return
    # down is the usual one, where a torque does not have the sign of gravity
    axes = [(sign * axis, tol.SLIGHT) for axis in np.eye(3) for sign in (1.0, -1.0)]
    best = [(x, 2.0) for x in [_best_gravity(experiment)] if x is not None]
    for direction, penalty in [*axes[:-1], (-np.eye(3)[2], 0.0), *best]:
        tilt = math.acos(float(np.clip(direction @ now / size, -1, 1)))
        if tilt >= tol.FEW:
            text = ",".join(f"{x:.4g}" for x in size * direction + 0.0)
            evidence = {"tilt [deg]": math.degrees(tilt), "direction": text}
            of_direction = "direction", "", evidence, codes.with_gravity(text), tilt > tol.POOR
            finding = CODES["gravity"].finding(*of_direction)
            yield Transform(finding, _with_gravity(experiment, size * direction), penalty)


def _best_gravity(experiment: Experiment) -> Array | None:
    """Return the unit direction of gravity by which the nominal bodies explain most."""
    still = 0 * experiment.joint[1]
    size, columns = float(np.linalg.norm(experiment.robot.model.gravity.linear)), []
    for axis in np.eye(3):
        robot = _with_gravity(experiment, size * axis).robot
        # At rest a torque is linear in gravity: one column per axis has its effect exactly.
        regressor = regressor_at_drives(robot, experiment.joint[0], still, still)
        columns.append(experiment.weighed(regressor @ experiment.bodies))
    now = np.array(experiment.robot.model.gravity.linear) / size
    # what the motion does not show stays as it is
    change = scaled_svd(np.column_stack(columns)).solve(experiment.unexplained, tol.SLIGHT)
    # The length of gravity is known: only the direction of the sum counts.
    norm = float(np.linalg.norm(now + change))
    return np.asarray((now + change) / norm) if norm > tol.SEVERE else None


def lengths(experiment: Experiment) -> Iterator[Transform]:
    """Yield other distances between joints: of each, and of all as in a robot of another size."""
    for joint in (*experiment.robot.joint_names[1:], ""):
        what, line = f"the distance of {joint} from the joint before it", f"origin of {joint}: xyz"
        if not joint:
            what, line = "the size of the robot", "all lengths, centres of mass included,"
        # Next to an unknown factor on all masses that of the size has a large error.
        least = tol.SURE if joint else 1.0
        for factor, error, penalty in best_factors(experiment, partial(_with_length, joint), least):
            is_far = abs(factor - 1) > max(tol.POOR, tol.SURE * error)
            evidence = {"factor": factor, "standard error": factor * error}
            of_joint = "factor", joint, {**evidence, "what": what, "line": line}
            finding = CODES["geometry"].finding(*of_joint, is_worse=is_far)
            yield Transform(finding, _with_length(joint, experiment, math.log(factor)), penalty)


def zeros(experiment: Experiment) -> Iterator[Transform]:
    """Yield other zeros of joints, of each and of all together that differ significantly."""
    joints = _turning(experiment)
    alone = [*chain(*(_zero(experiment, j, (0.0,)) for j in joints))]
    yield from alone
    while alone and len(joints) > 1:  # alone, each zero takes up a part of the others
        changes = [partial(_with_zeros, [j]) for j in joints]
        angles, errors, _ = best_values(experiment, changes, np.zeros(len(joints)))
        scores = np.abs(angles) / np.maximum(tol.SLIGHT, tol.SIGNIFICANT * errors)
        if np.min(scores) > 1:
            off = dict(zip(joints, angles.tolist(), strict=True))
            yield _off(experiment, off, len(joints), errors=errors)
            break
        # the least one goes, or all that are far from it
        is_least = scores <= max(tol.MOST, float(np.min(scores)))
        joints = np.array(joints)[~is_least].tolist()


def _zero(
    experiment: Experiment, j: int, starts: Sequence[float], reverses: Sequence[int] = ()
) -> Iterator[Transform]:
    """Yield the zeros of joint j that are found from several starts."""
    for start in starts:
        angle, error = best_value(experiment, partial(_with_zeros, [j]), start)
        if max(tol.SLIGHT, tol.SURE * error) < abs(angle) < math.pi + tol.POOR:
            yield _off(experiment, {j: angle}, 1.0, reverses, [error])


_TURNS = (math.pi / 2, -math.pi / 2, math.pi)
"""Angles by which an encoder or a horn is mounted off: both quarters of a turn, and its half."""


def poses(experiment: Experiment) -> Iterator[Transform]:
    """Yield signs and zeros of joints with controllers, whose commands have the same ones.

    Gravity on the known bodies shows them. Two signs of joints that both carry the load may do
    nothing alone.
    """
    turning = _turning(experiment)
    for j in turning:
        yield from _zero(experiment, j, (0.0, *_TURNS))
    for joints in chain(combinations(turning, 1), combinations(turning, 2)):
        reversed_joints = experiment.scaled(dict.fromkeys(joints, -1.0), "qmts")
        yield _off(reversed_joints, dict.fromkeys(joints, 0.0), tol.MOST * len(joints), joints)
        if len(joints) == 1:
            yield from _zero(reversed_joints, joints[0], (0.0, *_TURNS), joints)


def quarter_turns(experiment: Experiment) -> Iterator[Transform]:
    """Yield zeros that are off by quarters of a turn, of a joint or of two."""
    turning = _turning(experiment) if experiment.has_bodies else []
    for j, turn in product(turning, _TURNS):
        yield _off(experiment, {j: turn}, tol.SLIGHT)
    for pair, turns in product(experiment.pairs(turning), product(_TURNS[:2], repeat=2)):
        yield _off(experiment, dict(zip(pair, turns, strict=True)), 2 * tol.SLIGHT)


def _turning(experiment: Experiment) -> list[int]:
    return [j for j in experiment.used if not experiment.robot.is_prismatic[j]]


def _off(
    experiment: Experiment,
    angles: dict[int, float],
    penalty: float,
    reverses: Sequence[int] = (),
    errors: Iterable[float] = (),
) -> Transform:
    """Return the transform that adds angles to the zeros of joints.

    The experiment has the positions of joints that are `reverses` with the opposite sign already.
    """
    named = {experiment.robot.joint_names[j]: angle for j, angle in angles.items()}
    signs = [experiment.robot.joint_names[j] for j in reverses]
    spreads = [f" +- {math.degrees(x):.2g}" for x in errors] or [""] * len(named)
    sizes = zip(named.items(), spreads, strict=True)
    off = [f"{math.degrees(x):.3g}{spread} degrees at {joint}" for (joint, x), spread in sizes if x]
    evidence = {f"offset of {joint} [rad]": angle for joint, angle in named.items()}
    case = {(1, 0): "moved", (0, 1): "reversed", (1, 1): "moved-and-reversed"}
    words = {"offsets": " and ".join(off), "joints": listed(signs)}
    of_joints = case[bool(off), bool(signs)], only_joint([*named]), {**evidence, **words}
    finding = CODES["sign" if signs else "encoder-offset"].finding(*of_joints)
    sources = moved_zeros(experiment.robot, named, experiment.sources[0], signs)
    right = _with_zeros([*angles], experiment, [*angles.values()])
    return Transform(finding, right, penalty, sources=sources)


def _with_zeros(
    joints: Sequence[int], experiment: Experiment, angles: float | Sequence[float] | Array
) -> Experiment:
    """Return the experiment with angles added to the positions of joints, and of their motors."""
    added = np.zeros((3, 1, experiment.robot.n))
    added[0, 0, joints] = angles
    return experiment.turned_by(added)


def _with_length(joint: str, experiment: Experiment, log_factor: float) -> Experiment:
    """Return the experiment with another distance of a joint, unless it is next to none.

    Without a joint it has all other distances, and bodies of the same masses, as large as these.
    """
    robot, model, factor = experiment.robot, experiment.robot.model.copy(), math.exp(log_factor)
    placements = model.jointPlacements
    if joint:  # joint 0 of Pinocchio is the universe
        placements = [placements[robot.model_order.index(robot.index(joint)) + 1]]
    for placement in placements:
        if np.linalg.norm(placement.translation) >= tol.LEAST_OFFSET:
            placement.translation = factor * placement.translation
    powers = np.zeros(10) if joint else np.repeat([0, 1, 2], [1, 3, 6])  # of m, m c and J
    parameters = np.resize(factor**powers, robot.parameters.shape) * robot.parameters
    bodies = experiment.bodies + parameters - robot.parameters
    changed = replace(robot, model=model, parameters=parameters)
    return experiment.with_changes(robot=changed, bodies=bodies)


def payloads(experiment: Experiment) -> Iterator[Transform]:
    """Yield a payload that is absent, there twice, or on another link."""
    robot, code = experiment.robot, CODES["payload"]
    known = robot.payload_parameters.reshape(-1, 10)
    for body in np.flatnonzero(known[:, 0]).tolist():
        payload = np.where(np.arange(len(known))[:, None] == body, known, 0.0).ravel()
        mass, link, joint = known[body, 0], robot.body_names[body], robot.joint_of(body)
        com = ",".join(f"{x:.4g}" for x in known[body, 1:4] / mass + 0.0)
        more, error = experiment.multiple(experiment.regressor @ payload)
        factor, spread = 1 + more, f" +- {mass * error:.2g}" * math.isfinite(error)
        is_off = factor > tol.POOR and abs(factor - 1) > tol.POOR
        words = {"link": link, "com": com, "given": f"{mass:.4g}", "option": f"{mass:g}"}
        # Round multiples come without a penalty, since only `factor` itself is a fitted number.
        for times in (0.0, *(near(factor) if is_off else ())):
            finding = code.finding("absent", joint, words)
            if times:
                words["mass"] = f"{times * mass:.3g}{spread}"
                finding = code.finding("mass", joint, words, with_payload(link, times * mass, com))
            changed = experiment.with_changes(bodies=experiment.bodies + (times - 1) * payload)
            yield Transform(finding, changed, penalty=float(times == factor))
        text = f"the payload of {mass:.4g} kg on {link}"
        yield from _placed(experiment, experiment.bodies - payload, text, mass)
    if not np.any(known) and not robot.known_bodies:
        yield from _placed(experiment, experiment.bodies, "a payload that was not named", None)


def _placed(
    experiment: Experiment, bodies: Array, text: str, mass: float | None
) -> Iterator[Transform]:
    """Yield a point mass at each body, where it explains the torques best: of a `mass`, or any.

    One that was not named is a note if it may be an error of the robot file: then the body that
    carries it is estimated together with it.
    """
    robot, is_named = experiment.robot, mass is not None
    heaviest = tol.FAR * np.sum(np.abs(bodies[::10]))  # no robot moves so many times its own mass
    for body, link in enumerate(robot.body_names):
        point, error = _point_mass(experiment, bodies, body, mass)
        is_load = tol.BODY * abs(bodies[10 * body]) < point[0] < heaviest
        if not is_load or not np.all(np.isfinite(point)):
            continue
        com = ",".join(f"{x:.3g}" for x in point[1:4] / point[0] + 0.0)
        changed = bodies.copy()
        changed[10 * body : 10 * body + 10] += point
        is_beyond = point[0] > tol.SURE * experiment.widths[10 * body, 5 * body]
        severity: Severity = "wrong" if is_named else "doubtful" if is_beyond else "note"
        spread = f" +- {error:.2g}" * (not is_named)
        words = {"text": text, "link": link, "mass": f"{point[0]:.3g}{spread}", "com": com}
        # one that may be an error of its body is identified as a part of it
        code, lines = CODES["payload"], with_payload(link, point[0], com)
        of_body = robot.joint_of(body), words, code.measurement if severity == "note" else lines
        loaded = experiment.with_changes(bodies=changed)
        finding = code.finding("placed", *of_body, severity=severity)
        yield Transform(finding, loaded, penalty=3.0 if is_named else 4.0)


_FARTHEST_M, _STARTS = 5.0, (0.3, 3.0, 30.0)
"""Largest distance of a payload from the joint, and the standard deviation of its place; the masses
from which an unknown one is searched, over that of its body."""


def _point_mass(
    experiment: Experiment, bodies: Array, body: int, mass: float | None
) -> tuple[Array, float]:
    """Return the ten parameters of the point mass on a body that explains the torques best.

    They are [m, m c, m (c^2 1 - c c^T)] for a mass m at c, of a `mass` or of any; zero for a point
    far from the joint. Next to them stands the standard error of a mass that is not known.
    """
    columns = experiment.regressor[:, :, 10 * body : 10 * body + 10]
    y = experiment.target - experiment.regressor @ bodies
    # the triangular factor has the residuals of all rows, in eleven
    R = triangle(experiment.weighed(np.concatenate([columns, y[..., None]], axis=2)))

    def mass_at(x: Array) -> float:
        # The log keeps an unknown mass positive, and the bound its exponential finite.
        return float(mass) if mass else math.exp(min(float(x[3]), 50.0))

    def point(x: Array) -> Array:
        m, c = mass_at(x), x[:3]
        # The integral of the slopes from the joint to c: they are linear, so that half way counts.
        return np.append(m, (moved(m, 0.5 * m * c) @ c)[1:])

    least = max(abs(bodies[10 * body]), 0.1)
    centre = bodies[10 * body + 1 : 10 * body + 4] / least
    starts = [centre] if mass else [[*centre, math.log(x * least)] for x in _STARTS]

    def residual(x: Array) -> Array:
        # Three more residuals, (c - c_0) / 5 m, make a place unique that the torques do not show.
        return np.concatenate([R[:, :10] @ point(x) - R[:, 10], (x[:3] - centre) / _FARTHEST_M])

    def slopes(x: Array) -> Array:
        # The slope by the logarithm of the mass is the point itself.
        m = mass_at(x)
        by_x = np.column_stack([moved(m, m * x[:3]), point(x)])[:, : len(x)]
        return np.vstack([R[:, :10] @ by_x, np.eye(3, len(x)) / _FARTHEST_M])

    fits = (scipy.optimize.least_squares(residual, x, slopes, method="lm") for x in starts)
    x = min(fits, key=lambda fit: float(fit.cost)).x
    error = mass_at(x) * float(np.linalg.norm(scaled_svd(slopes(x)).inverses[-1]))
    return (point(x) if np.linalg.norm(x[:3]) < _FARTHEST_M else np.zeros(10)), error


def _masses(experiment: Experiment) -> tuple[Array, Array, Array, tuple[float, float]] | None:
    """Return how the bodies differ from the robot file, None where no torque shows it.

    Each body counts as that of the file times a factor, which the torques determine next to the
    width of its mass; what this leaves unexplained beyond the noise counts as noise. That is the
    relative changes (N,), roots (N, k) of the covariance of these, and the parts (N,) of the mass
    that the torques show. Last come the relative change of that mass and its standard error if
    centres and inertias have their errors, too: a torque shows products of masses and lengths.
    """
    robot, bodies = experiment.robot, experiment.robot.parameters.reshape(-1, 10)
    if not experiment.has_bodies or robot.known_bodies or np.any(experiment.is_unscaled):
        return None
    each = scipy.linalg.block_diag(*bodies)
    effects = experiment.over_noise(experiment.regressor @ each.T)
    y = experiment.over_noise(experiment.target - experiment.of_file)
    excess = y - effects @ scaled_svd(effects).solve(y, RANK_TOLERANCE)
    noise = math.sqrt(max(1.0, float(np.mean(excess**2)) * tol.CORRELATED_ROWS))
    mass = np.maximum(np.abs(bodies[:, 0]), np.finfo(float).tiny)
    # The rows of the masses, one of ten, over the masses: (N, 5N + 1).
    errors = np.hstack([experiment.widths, experiment.common[:, :1]])
    widths = errors[::10] / mass[:, None]
    change, roots = posterior(effects @ widths / noise, y / noise, widths)
    spread = np.linalg.norm(roots, axis=1)
    # A torque shows a mass whose standard deviation it halves.
    is_shown = spread < tol.MOST * np.linalg.norm(widths, axis=1)
    misfit = experiment.of_bodies(experiment.bodies + change @ each)
    # No mass is negative beyond its error.
    is_possible = np.all((change + tol.SURE * spread)[is_shown] > -1)
    if not np.any(is_shown) or not is_possible or np.nanmedian(misfit) >= tol.SEVERE:
        return None
    share = np.where(is_shown, mass, 0.0) / np.sum(mass[is_shown])
    torques = experiment.over_noise(experiment.regressor @ errors)
    of_mass, root = posterior(torques, y, share[None] @ widths)
    return change, roots, share, (float(of_mass[0]), float(np.linalg.norm(root)))


def file_findings(experiment: Experiment) -> Iterator[Finding]:
    """Yield by which factor the bodies of the file are off, and what is known of the mass."""
    masses = _masses(experiment)
    if masses is None:
        return
    robot, (change, roots, share, of_mass) = experiment.robot, masses
    total, error = float(share @ change), float(np.linalg.norm(share @ roots))
    # the body that changes the mass most, in the direction in which all together change it
    most = int(np.argmax(share * change * math.copysign(1.0, total)))
    link, part = robot.body_names[most], float(change[most])
    error_of_part = float(np.linalg.norm(roots[most]))
    is_heavier = abs(total) > max(tol.POOR, tol.SURE * error)
    least = (tol.SURE if is_heavier else tol.SIGNIFICANT) * error_of_part
    differs = abs(part - is_heavier * total) > least
    size = tol.MOST * abs(total) if is_heavier else tol.POOR
    is_mostly = differs and abs(share[most] * part) > size
    if not is_heavier and not is_mostly:
        return
    mostly = f", mostly {link}, by {part:+.0%}" * bool(is_heavier and is_mostly)
    words = {"what": link, "times": f"{1 + part:.3g} +- {error_of_part:.2g}", "mostly": mostly}
    if is_heavier:
        words |= {"what": "bodies", "times": f"{1 + total:.3g} +- {error:.2g}"}
    words["word"] = "heavier" if of_mass[0] > 0 else "lighter"
    evidence = {"bodies over those of the file": 1 + total, "standard error": error}
    of_robot = ("relative change of the mass", "standard error of the mass")
    evidence |= dict(zip(of_robot, of_mass, strict=True)) | {f"relative change of {link}": part}
    joint = robot.joint_of(most) if is_mostly and not is_heavier else ""
    finding = CODES["nominal-values"].finding("bodies", joint, {**evidence, **words})
    # a payload that was not named makes no link lighter
    rivals = _rivals(experiment, link if is_mostly and part > 0 else "", 1 + is_heavier * total)
    yield undecided(finding, dict.fromkeys(rivals, 0.0))


def _rivals(experiment: Experiment, mostly: str, times: float) -> Iterator[Cause]:
    """Yield what else explains torques of bodies that are heavier, `mostly` a link, "" for all.

    They are `times` as heavy. Where a torque is mostly that of an acceleration, so are positions
    that are as many times too small.
    """
    alone = sorted({*experiment.used} - {*np.flatnonzero(experiment.both).tolist()})
    if alone and times > 0 and abs(times - 1) > tol.POOR:
        options = CODES["unit"], "counts", experiment, dict.fromkeys(alone, times), "qm"
        turned, rows = multiplied(*options, {"times": 1 / times}), experiment.independent_rows
        costs = [x.file_cost + x.cost("free", rows) for x in (turned.changed, experiment)]
        if costs[0] < costs[1] + tol.SURE**2 / 2:
            yield CODES["unit"], turned.finding.message
    if np.any(experiment.robot.payload_parameters):
        yield CODES["payload"], "a payload has another mass than the one named"
    elif mostly:
        yield CODES["payload"], f"a payload on {mostly} was not named"
    elif times != 1:
        yield CODES["torque-scale"], f"all torques are {times:.3g} times what they should be"
