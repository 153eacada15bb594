"""Checks of gears and their sensors: periodic errors, couplings, other ratios, delays, zeros.

In a fit they are columns next to its equations: errors that are periodic in the angle of the motor
or the joint, late torques and positions, and zeros of encoders that are off. Before a fit they are
transforms of the `Experiment`, which undo a wrong gear ratio, a motor that moves with several
joints, a spring that is not declared, or a linkage whose ratio depends on the angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seaid._arrays import Array
from seaid._files import toml_key
from seaid.checks import codes, engine
from seaid.checks import tolerances as tol
from seaid.checks.codes import CODES
from seaid.checks.engine import Acceptance
from seaid.checks.experiment import Experiment, Transform, best_factors, multiplied, near
from seaid.checks.instants import MOST_STEPS, fitted
from seaid.checks.terms import DriveRows
from seaid.checks.values import POSITIVE
from seaid.drives import IDEAL_DRIVE, AngleRatio
from seaid.drives.angle_ratio import Ratios
from seaid.drives.terms import MOTOR_CONSTANTS
from seaid.errors import Finding, listed
from seaid.estimation.least_squares import settled_weights
from seaid.estimation.qr_factor import qr_factor_of, residual_of, scaled_svd
from seaid.log import Motion, low_pass
from seaid.log.description import changed_source, moved_zeros
from seaid.log.motion import POSITION_BAND
from seaid.log.repair import channels
from seaid.regressor.base import INPUT_FIELDS, regressor_at_drives

# In a fit, as columns next to its equations

if TYPE_CHECKING:
    from seaid.checks.columns import Side


_HIGHEST = {"motor": 6, "joint": 12, "mesh": 2}
"""Highest orders that are tried, without odd ones above 6: turns and poles of the motor, turns of
the joint, and the two lobes of strain-wave gears. Higher orders of the motor turn faster than a
cutoff lets pass."""


def orders(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield the cosine and sine of the orders that a drive lacks and the motion covers."""
    drive = side.robot.drives[joint]
    known = {(harmonic.angle, harmonic.order) for harmonic in drive.harmonics}
    for name, highest in _HIGHEST.items():
        width = max(float(np.ptp(angle)) for angle in _angles(side.drive(joint), name))
        is_of_motor = name == "mesh" and width < 2 * np.pi * drive.ratio  # it has the same orders
        if is_of_motor or (name == "joint" and drive.joint_units[1] != "rad"):
            continue
        # Less than half a period looks like the spring.
        usual = *range(1, min(highest, 6) + 1), *range(8, highest + 1, 2)
        orders = [k for k in usual if (name, k) not in known and k * width >= np.pi]
        yield from _harmonics(side, joint, name, orders) if orders else ()


def _angles(drive: DriveRows, name: str) -> list[Array]:
    """Return an angle of each motion: of the motor, the joint, or the mesh of their gear."""
    # The mesh turns by the motor less its output: theta_M - theta_M / N.
    factor = 1 - 1 / drive.robot.drives[drive.joint].ratio if name == "mesh" else 1.0
    signal = "theta_L" if name == "joint" else "theta_M"
    return [factor * signals[signal] for signals in drive.signals]


def _harmonics(side: Side, joint: str, name: str, orders: list[int]) -> Iterator[engine.Candidate]:
    """Yield the cosine and sine of each order, no columns if next to nothing is left of one."""
    phases = [np.multiply.outer(angle, orders) for angle in _angles(side.drive(joint), name)]
    # (R, 2 orders), which are filtered at once: all cosines, then all sines
    pairs = side.drive(joint).at_rows([np.hstack([np.cos(x), np.sin(x)]) for x in phases])
    rest = side.equation.residual_of(pairs)
    for place, order in enumerate(orders):
        # |R_kk| is the norm of what the columns before leave of column k. The weight of a single
        # equation does not change the basis.
        both = [place, place + len(orders)]
        sizes = np.abs(np.diag(np.linalg.qr(rest[:, both])[1]))
        # the norm of a cosine over its periods is sqrt(R / 2)
        is_left = bool(np.min(sizes) >= tol.POOR * np.sqrt(0.5 * len(pairs)))
        models = (engine.Alternative(pairs[:, both], 2),) * is_left
        yield engine.Candidate(joint, name, str(order), models)


def periodic(side: Side, joint: str, accepted: Acceptance, share: float) -> Finding | None:
    """Return the finding of periodic errors, with their orders as TOML, none of a huge one."""
    drive, estimate = side.robot.drives[joint], side.fitted.estimate
    is_error = joint not in side.gears and not drive.is_nonlinear_spring
    field = "transmission_error" if is_error else "torque_ripple"
    orders = [(x.trial.candidate.field, int(x.trial.candidate.term)) for x in accepted]
    text = ", ".join(f"order {order} of the {angle}" for angle, order in orders)
    evidence = {codes.OF_MOTOR: share}
    if is_error and "stiffness" in estimate.names and estimate.value("stiffness") > 0:
        largest = max(float(np.linalg.norm(x.coefficients)) for x in accepted)
        # A torque over k r_M / N in (7), or a force over k in (4b), is a deflection.
        error = largest / (_lever(side, joint) * estimate.value("stiffness"))
        if error > tol.SLIGHT:  # rad or m: no gear or encoder has it, but a step or an offset
            return None
        evidence["amplitude"] = error
        text += f"; up to {1e3 * error:.2g} m{drive.spring_units[1]} between the encoders"
    known = [(x.angle, x.order) for x in drive.harmonics if x.field == field]
    by_angle = dict[str, list[int]]()
    for angle, order in sorted([*known, *orders], key=lambda x: x[1]):
        by_angle.setdefault(angle, []).append(order)
    table = ", ".join(f"{angle} = {of_angle}" for angle, of_angle in by_angle.items())
    lines = codes.in_drives({(joint,): f"{field} = {{ {table} }}"})
    of_joint = "periodic", joint, {**evidence, "text": text}, lines, share >= tol.MATTERS
    return CODES["transmission-error"].finding(*of_joint)


def _lever(side: Side, joint: str) -> float:
    """Return the part of the spring's force in the equation of a motor: r_M / N in (7)."""
    drive = side.robot.drives[joint]
    return drive.motor_radius / drive.ratio if side.drive(joint).is_of_motor else 1.0


# Before the fit, as transforms of an experiment


def other_slope(experiment: Experiment, j: int) -> float | None:
    """Return the slope between two encoders over the gear ratio, None if the gear ratio is right.

    A slight difference counts only where it is many of its standard errors: springs and errors of
    gears explain a smaller one.
    """
    slope = abs(experiment.encoder_slope(j)[0]) if experiment.both[j] else 1.0
    ratio, error = experiment.encoder_ratio(j)
    size, given = abs(ratio), float(experiment.ratio[j])  # an encoder may have the opposite sign
    if abs(slope - 1) >= tol.SLIGHT:
        # the deflection of a spring is a part of the slope, and apart in the motor equation
        is_known = error < tol.FEW * size and 1 / tol.TWICE < size / (slope * given) < tol.TWICE
        return size / given if is_known else slope if 1e-6 < slope < 1e6 else None
    return size / given if abs(size - given) > tol.SIGNIFICANT * error else None


def _with_ratio(j: int, experiment: Experiment, log_factor: float) -> Experiment:
    """Return the experiment with a factor on the gear ratio of joint j, by its logarithm."""
    factors = np.exp(np.where(np.arange(experiment.robot.n) == j, log_factor, 0.0))
    return experiment.with_changes(ratio=experiment.ratio * factors).consistent


def _other_ratios(experiment: Experiment, j: int, slope: float) -> Iterator[Sequence[float]]:
    """Yield the factors on a gear ratio as `best_factors` does, by the slope of two encoders."""
    ratio, error = experiment.encoder_ratio(j)
    if not experiment.both[j]:
        yield from best_factors(experiment, partial(_with_ratio, j))
    elif slope != 1 and not math.isnan(ratio):
        yield from ((x, error / abs(ratio), float(x == slope)) for x in near(slope))


def gear_ratios(experiment: Experiment) -> Iterator[Transform]:
    """Yield gear ratios: by the slope of two encoders, or by the torque and the motion of one."""
    for j in experiment.used:
        joint, ratio = experiment.robot.joint_names[j], float(experiment.ratio[j])
        is_linear = experiment.robot.is_prismatic[j]
        is_per_m = is_linear and not experiment.robot.drives[joint].is_elastic
        key = "gear_ratio_rad_per_m" if is_per_m else "gear_ratio"
        slope = other_slope(experiment, j) or 1.0
        for factor, error, penalty in _other_ratios(experiment, j, slope):
            value, std = ratio * factor, ratio * factor * error
            if value <= tol.LARGEST_RATIO[is_linear]:
                evidence = {"given ratio": ratio, "ratio": value, "standard error": std}
                lines = codes.in_drives({(joint,): f"{key} = {value:.6g}\n{key}_std = {std:.2g}"})
                finding = CODES["gear-ratio"].finding("other", joint, evidence, lines)
                yield Transform(finding, _with_ratio(j, experiment, math.log(factor)), penalty)


def missing_ratios(experiment: Experiment) -> Iterator[Finding]:
    """Yield the gears that drives of a ratio of 1 lack: their torques are far from moving bodies.

    No masses of a robot file explain so large a ratio of torques, and no unit or clock one that
    differs from joint to joint.
    """
    names, scales = experiment.robot.joint_names, experiment.clear_scales
    factors = [x.factor for x in scales.values()]
    if not max(factors, default=0.0) > tol.TWICE * min(factors, default=0.0) > 0:
        return
    is_open = (experiment.ratio == 1) & ~experiment.both & np.isfinite(experiment.torque[0])
    ratios = {names[j]: 1 / x.factor for j, x in scales.items() if is_open[j]}
    ratios = {joint: ratio for joint, ratio in ratios.items() if ratio > tol.FAR}
    if ratios:
        words = {"lacking": listed(ratios), "values": listed([f"{x:.3g}" for x in ratios.values()])}
        evidence = {f"bodies over the torque of {joint}": x for joint, x in ratios.items()}
        yield CODES["gear-ratio"].finding("lacking", "", evidence | words, joints=tuple(ratios))


def can_move(experiment: Experiment, joints: Sequence[int], factor: float) -> bool:
    """Return whether joints can have moved `factor` times as far, by the median of several.

    The motion of a log is more than a tenth of a radian and less than two turns, the range of a
    wrist: degrees that are read as radians are 57 times too much, and radians read as degrees 57
    times too little. A joint that slides moves over a part of its range in the robot file.
    """
    # In a radian, or the range in the robot file: one without an end is infinite.
    ranges = np.maximum(experiment.robot.upper_limits - experiment.robot.lower_limits, _ROUNDING)
    units = np.where(experiment.robot.is_prismatic, ranges, 1.0)
    moved = np.median((np.ptp(experiment.joint[0], axis=0) / units)[list(joints)])
    return tol.POOR < factor * float(moved) < 4 * math.pi


def geared_encoders(experiment: Experiment) -> Iterator[Transform]:
    """Yield encoders at the other side of their gears than described, of each joint and of all."""
    robot, lever = experiment.robot, experiment.lever
    for side, channel, other in (("joint", "q", "motor"), ("motor", "m", "joint")):
        factors = (1 / lever if side == "joint" else lever).tolist()
        joints = [j for j in range(robot.n) if _may_be_geared(experiment, j, side, factors[j])]
        for places in dict.fromkeys([(*joints,), *((j,) for j in joints)]) if joints else ():
            of_places = CODES["unit"], "geared", experiment, {j: factors[j] for j in places}
            yield multiplied(*of_places, channel, {"other": other})


def _may_be_geared(experiment: Experiment, j: int, side: str, factor: float) -> bool:
    """Return whether an encoder described at a `side` of the gear may be at the other side.

    Where there are two encoders it is there if both show equal angles, without the gear; a single
    one may be there if the joint can have moved `factor` times as far.
    """
    if experiment.both[j]:
        slope = other_slope(experiment, j)
        return bool(slope) and abs(math.log(slope * experiment.lever[j])) < 3 * tol.SLIGHT
    is_alone = j in experiment.used and experiment.logged(j, "q") == [f"{side}_position"]
    return is_alone and max(factor, 1 / factor) > tol.TWICE and can_move(experiment, [j], factor)


def _between_encoders(experiment: Experiment) -> list[int]:
    """Return the joints whose encoders show the gear: that of a spring needs its torque."""
    drives = [*experiment.robot.drives.values()]
    both = np.flatnonzero(experiment.both).tolist()
    return [j for j in both if j in experiment.used or not drives[j].is_elastic]


def without_slips(experiment: Experiment) -> tuple[list[Finding], Experiment]:
    """Return the findings of joints whose encoders step in a log, and the experiment without steps.

    A step stands out next to the deflection of a spring and to a drift in time, which is no step.
    """
    logs = np.equal.outer(experiment.log, np.unique(experiment.log)).astype(float)
    # (R, R): in column i a step at instant i, within its log
    steps = np.tri(len(logs)) * (logs @ logs.T)
    last = float(np.max(experiment.time)) + 1  # the low pass takes less from the end of a log
    findings, motor, counted = list[Finding](), experiment.motor.copy(), experiment.counted.copy()
    for j in _between_encoders(experiment):
        # The rotor has a column of its own, because a step spoils the inertia that (7) gave it.
        deflection = [experiment.deflection(j), experiment.motor[2][:, j]]
        span = scaled_svd(np.column_stack([logs, logs * experiment.time, *deflection])).spans
        X = np.column_stack([steps, experiment.apart[:, j]])
        X -= span @ (span.T @ X)
        # A step of which the other columns leave less than at two instants is an offset at the end
        # of a log, or friction at a reversal.
        squares = np.maximum(np.sum(X[:, :-1] ** 2, axis=0), 2.0)
        projected = X[:, :-1].T @ X[:, -1]
        i = int(np.argmax(projected**2 / squares))
        step = float(projected[i] / squares[i])
        is_step = step * projected[i] > (1 - tol.SEVERE) * float(X[:, -1] @ X[:, -1])
        if is_step and abs(step) > tol.LEAST_OFFSET:
            start, end = experiment.time[[i - 1, i], 0].tolist()
            evidence = {"step": step, "time before [s]": start, "time [s]": end}
            of_joint = "steps", experiment.robot.joint_names[j], {**evidence, "last": f"{last:.0f}"}
            findings.append(CODES["loose-encoder"].finding(*of_joint))
            motor[0, :, j] -= experiment.lever[j] * step * steps[:, i]
            counted[i - 1 : i + 1, j] = False  # the low pass spreads the step over its neighbours
    changed = experiment.with_changes(motor=motor, counted=counted)
    return findings, changed if findings else experiment


def unlike_motions(experiment: Experiment) -> Iterator[Finding]:
    """Yield the joints whose encoders show two motions, of which no deflection explains one."""
    for j in _between_encoders(experiment):
        part, joint = float(experiment.of_encoders[j]), experiment.robot.joint_names[j]
        if part > tol.SEVERE and np.ptp(experiment.turned[0][:, j]) > tol.LEAST_SWING:
            evidence = {"part between the encoders": part}
            yield CODES["loose-encoder"].finding("apart", joint, evidence)


def _turns(experiment: Experiment, j: int, joints: Sequence[int]) -> Array:
    """Return how often (k,) a motor turns with `joints`, beyond its drive, per turn of each."""
    # theta_M / lever - phi_j = sum_i a_i q_i + c + deflection: the motor turns a_i times with i.
    H = [experiment.joint[0][:, joints], np.ones_like(experiment.time), experiment.deflection(j)]
    x, covariance = fitted(H, experiment.apart[:, j])
    errors = np.sqrt(np.diag(covariance))
    rounded = np.round(x / tol.SLIGHT) * tol.SLIGHT
    return np.where(abs(x - rounded) < tol.SURE * errors, rounded, x)[: len(joints)]


def _coupled(experiment: Experiment, turns: Mapping[int, Mapping[int, float]]) -> Transform:
    """Return the transform of motors that turn with joints, {motor: {joint: turns}}."""
    names, drives = experiment.robot.joint_names, {**experiment.robot.drives}
    lines, evidence = dict[tuple[str, ...], str](), dict[str, float]()
    for j, added in turns.items():
        factors = {**(drives[names[j]].transmission or {names[j]: 1.0})}
        for i, count in added.items():
            factors[names[i]] = float(f"{factors.get(names[i], 0.0) + count:.4g}")
            evidence[f"turns of the motor of {names[j]} with {names[i]}"] = factors[names[i]]
        drives[names[j]] = replace(drives[names[j]], transmission=factors)
        table = ", ".join(f"{toml_key(name)} = {number:.4g}" for name, number in factors.items())
        lines[names[j],] = f"transmission = {{ {table} }}"
    joints = tuple(names[j] for j in turns)
    words = {"turns": listed(f"{name}: {count:.3g}" for name, count in evidence.items())}
    of_joints = "motors", joints[0], {**evidence, **words}, codes.in_drives(lines)
    finding = CODES["coupled-joints"].finding(*of_joints, joints=joints)
    changed = experiment.with_changes(robot=experiment.robot.with_drives(drives))
    return Transform(finding, changed, penalty=float(len(turns)))


def _uncoupled(experiment: Experiment) -> list[tuple[int, int]]:
    """Return (motor, joint) that the drives do not couple and a mechanism may."""
    robot = experiment.robot
    return [
        (j, i)
        for j, i in product(_between_encoders(experiment), range(robot.n))
        if i != j and robot.joint_names[i] not in robot.drives[robot.joint_names[j]].transmission
        if robot.is_prismatic[i] == robot.is_prismatic[j]
    ]


def coupled_motors(experiment: Experiment) -> Iterator[Transform]:
    """Yield motors that turn with another joint too, and encoders that measure a sum of joints."""
    for j, i in _uncoupled(experiment):
        turns = float(_turns(experiment, j, [i])[0])
        if abs(turns) < tol.POOR:
            continue
        yield _coupled(experiment, {j: {i: turns}})
        if abs(abs(turns) - 1) < 3 * tol.SLIGHT:
            yield _against_another_link(experiment, i, j, float(np.sign(turns)), "q")


def differentials(experiment: Experiment) -> Iterator[Transform]:
    """Yield pairs of motors that turn with both of their joints, each also against its joint."""
    pairs = _uncoupled(experiment)
    for j, i in (pair for pair in pairs if pair[0] < pair[1] and pair[::-1] in pairs):
        turns = np.array([_turns(experiment, motor, [j, i]) for motor in (j, i)])
        is_coupled = np.min(np.abs(turns[[0, 1], [1, 0]])) > tol.POOR
        if is_coupled and abs(np.linalg.det(turns + np.eye(2))) > tol.POOR:
            rows = ({j: float(x), i: float(y)} for x, y in turns)
            yield _coupled(experiment, dict(zip((j, i), rows, strict=True)))


def absolute_positions(experiment: Experiment) -> Iterator[Transform]:
    """Yield joints whose positions on both sides contain the angle of the joint before."""
    turning = [j for j in experiment.used if not experiment.robot.is_prismatic[j]]
    for (i, j), sign in product(pairwise(turning), (-1.0, 1.0)):
        yield _against_another_link(experiment, i, j, sign, "qm")


def _against_another_link(
    experiment: Experiment, i: int, j: int, sign: float, channels: str
) -> Transform:
    """Return the transform of positions (q, m) of joint j that are its own plus or minus joint i.

    That of the joint alone looks like a motor that turns once with the other joint.
    """
    joint, mover = (experiment.robot.joint_names[place] for place in (j, i))
    angles = np.zeros_like(experiment.joint)
    angles[:, :, j] = sign * experiment.joint[:, :, i]
    changed = experiment.turned_by(angles)
    motor = changed.motor if "m" in channels else experiment.motor
    changed = changed.with_changes(motor=motor, direction=np.sign(motor[1]))
    added = f"{'minus' if sign < 0 else 'plus'} the angle of {mover}"
    words = {"measured": experiment.subject((j,), channels), "added": added}
    finding = CODES["coupled-joints"].finding("absolute", joint, words)
    return Transform(finding, changed, penalty=1.0)


def undeclared_springs(experiment: Experiment) -> Iterator[Transform]:
    """Yield springs of joints whose drives are given as stiff, of each and of all together."""
    springs = {j: x for j, x in _springs(experiment) if experiment.of_encoders[j] > tol.FEW}
    for joints in dict.fromkeys([*((j,) for j in springs), tuple(springs)]):
        yield _declared(experiment, {j: springs[j] for j in joints})


def small_springs(experiment: Experiment) -> Iterator[Finding]:
    """Yield springs of drives given as stiff that deflect little next to the motion of the joint.

    They leave nothing that counts between the encoders. As in `seaid init`, it is a spring if the
    torque explains most of what the encoders differ by, however small that is next to the motion.
    """
    for j, spring in _springs(experiment):
        apart = float(np.ptp(spring.deflection))
        if spring.explained > tol.MOST and apart > tol.LEAST_OFFSET:
            declared = _declared(experiment, {j: spring}).finding
            evidence = {"explained by the torque": spring.explained, "deflection": apart}
            words = {**declared.evidence, **evidence, "text": declared.message}
            yield CODES["gear-compliance"].finding("small", declared.joint, words, declared.remedy)


def _declared(experiment: Experiment, springs: Mapping[int, _Spring]) -> Transform:
    """Return the transform of drives that have springs and are given as stiff."""
    names, motor = experiment.robot.joint_names, experiment.motor.copy()
    for j, spring in springs.items():
        motor[0, :, j] -= experiment.lever[j] * spring.deflection
    text = [f"{names[j]} by {x.stiffness:.3g} +- {x.error:.2g} N m/rad" for j, x in springs.items()]
    evidence = {f"stiffness of {names[j]}": x.stiffness for j, x in springs.items()}
    lines = codes.in_drives({(names[j],): 'type = "series_elastic"' for j in springs})
    joint, words = codes.only_joint([names[j] for j in springs]), {"springs": listed(text)}
    finding = CODES["gear-compliance"].finding("declared", joint, {**evidence, **words}, lines)
    return Transform(finding, experiment.with_changes(motor=motor), penalty=float(len(springs)))


class _Spring(NamedTuple):
    """What the torque explains of the angle between two encoders, as the spring (4b) does.

    `stiffness` and its `error` [N m/rad] at the joint, its `deflection` (R,) with that by friction,
    and the part of the squared angle that is `explained`.
    """

    stiffness: float
    error: float
    deflection: Array
    explained: float


def _springs(experiment: Experiment) -> Iterator[tuple[int, _Spring]]:
    """Yield joints with both encoders whose drives are given as stiff, and what looks like springs.

    A ratio that is off, encoders that are late, zeros of a log and an unknown rotor are no spring:
    what they explain of the angle between the encoders is not of the torque.
    """
    zeros = np.equal.outer(experiment.log, np.unique(experiment.log)[1:])
    # a drive without a spring has no motor equation of its own
    stiff = np.isnan(experiment.of_motors) & experiment.both
    for j in (j for j in experiment.used if stiff[j] and not experiment.robot.is_prismatic[j]):
        # k apart = tau - friction: the torque, and friction with the constant of both encoders
        of_spring = [experiment.target[:, j], experiment.friction[j]]
        of_motion = [experiment.turned[0][:, j], experiment.motor[2][:, j], zeros]
        columns, apart = np.column_stack([*of_spring, *of_motion]), experiment.apart[:, j]
        rows = experiment.counted[:, j]
        x, covariance = fitted([columns[rows]], apart[rows])
        without, left = residual_of(apart[rows], columns[rows, 1:]), (apart - columns @ x)[rows]
        if x[0] > 0:
            explained = 1 - float(left @ left) / max(float(without @ without), tol.LEAST)
            error, deflection = math.sqrt(covariance[0, 0]) / x[0] ** 2, columns[:, :4] @ x[:4]
            yield j, _Spring(1 / float(x[0]), float(error), deflection, explained)


def linkages(experiment: Experiment) -> Iterator[Transform]:
    """Yield gear ratios that vary once per turn: theta = N (q + e q + c cos q + s sin q)."""
    robot = experiment.robot
    for j in _between_encoders(experiment):
        q, drive = experiment.turned[0][:, j], robot.drives[robot.joint_names[j]]
        other = drive.angle_ratio, drive.parallel_spring, drive.joint_friction, drive.transmission
        if any(other) or robot.is_prismatic[j] or np.ptp(q) < tol.POOR:
            continue
        deflection = experiment.deflection(j)
        if deflection.size:
            # The rotor has a column of its own: (7) with a constant ratio gave it a wrong inertia.
            deflection = np.column_stack([experiment.motor[2][:, j], deflection])
        x, covariance = _varied(q, experiment.apart[:, j], deflection)
        # The ratio over N is the derivative of q + e q + c cos q + s sin q: 1 + e - c sin q
        # + s cos q, which is a mean, and an order with two amplitudes.
        slopes = np.column_stack([np.ones(len(q)), -np.sin(q), np.cos(q)])
        factor, variance = 1 + slopes @ x, np.mean(np.sum(slopes @ covariance * slopes, axis=1))
        low, high = float(np.min(factor)), float(np.max(factor))
        mean, size = 1 + float(x[0]), float(np.hypot(*x[1:]))
        if size > (1 - 2 * tol.FEW) * mean or high - low < tol.POOR * (high + low) / 2:
            continue
        joint, ratio = robot.joint_names[j], float(experiment.ratio[j])
        cosine, sine = (float(f"{amplitude:.4g}") for amplitude in (x[2] / mean, -x[1] / mean))
        # The drives file has no errors of amplitudes: that of the ratio in this motion has them.
        lines = f"gear_ratio = {ratio * mean:.6g}\ngear_ratio_std = {ratio * variance**0.5:.2g}\n"
        lines += f"angle_ratio = {{ cos = [{cosine!r}], sin = [{sine!r}] }}  # counts as exact"
        linkage = AngleRatio(cos=(cosine,), sin=(sine,))
        is_own, of_joint = np.arange(robot.n) == j, Ratios({j: linkage})
        # What is measured at the joint becomes that behind the gear, as a motion has it.
        changed = experiment.with_changes(
            robot=robot.with_drives({joint: replace(drive, angle_ratio=linkage)}),
            ratio=experiment.ratio * np.where(is_own, mean, 1.0),
            joint=np.array(of_joint.at_drives(*experiment.joint)),
            sensed=experiment.sensed / of_joint.rates(experiment.joint[0]),
        )
        evidence = {"least ratio": ratio * low, "largest ratio": ratio * high, "given ratio": ratio}
        remedy = codes.in_drives({(joint,): lines})
        finding = CODES["varying-ratio"].finding("linkage", joint, evidence, remedy)
        yield Transform(finding, changed, penalty=1.0)


def _varied(q: Array, apart: Array, deflection: Array) -> tuple[Array, Array]:
    """Return e, c and s (3,), and their covariance, of theta_M / lever - q.

    That is e q + c cos q + s sin q + deflection.
    """
    columns, kept = [np.ones_like(q), q, np.cos(q), np.sin(q)], slice(-3, None)
    if not deflection.size:
        x, covariance = fitted(columns, apart)
        return x[kept], covariance[kept, kept]
    # The noise is in the torque of the spring, the last column of its deflection, and not in the
    # angles of the encoders: k (apart - e q - ...) = torque + friction.
    x, covariance = fitted([apart, deflection[:, :-1], *columns], deflection[:, -1])
    return -x[kept] / x[0], covariance[kept, kept] / x[0] ** 2


# In a fit, too: delays, and zeros of encoders


def late_torque(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield what a late torque adds to the equation: tau - d tau' to first order, late by d."""
    channel = torque_channel(side, joint)
    yield engine.linear_candidate(joint, "delay", channel, _slope(side, joint))


def late_position(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield what a late position of the joint adds to (7) or to its load, to first order.

    To (7) it adds -(r_M/N) k r_L d theta_L', and to the torque of the spring k r_L^2 d theta_L',
    where it looks like friction behind the spring. The coefficient is k d, because the stiffness k
    changes with the delay.
    """
    drive = side.robot.drives[joint]
    factor = drive.load_radius * (-_lever(side, joint) if side.is_motor else drive.load_radius)
    slope = side.drive(joint, at_joint=True).signal("theta_L_dot")
    yield engine.linear_candidate(joint, "delay", "joint_position", factor * slope)


def torque_channel(side: Side, joint: str) -> str:
    """Return the torque, current or voltage in the equation of a joint, "" if it is a command."""
    drive, index = side.robot.drives[joint], side.robot.index(joint)
    if drive.controller is not None or (drive.is_elastic and not side.is_motor):
        return ""
    for channel in (INPUT_FIELDS[drive.motor_input], *["joint_torque"] * (not drive.is_elastic)):
        signals = [getattr(motion, channel) for motion in side.motions]
        if all(x is not None and np.all(np.isfinite(x[:, index])) for x in signals):
            return channel
    return ""


def _constant_of(side: Side, joint: str) -> float:
    """Return the torque of a motor for a current or voltage of 1 in the rows of its equation."""
    rows, name = side.drive(joint), MOTOR_CONSTANTS.get(side.robot.drives[joint].motor_input, "")
    # rows of an unknown constant that is no parameter are those of a constant of 1
    is_in_rows = name in side.robot.drives[joint].known or rows.has_parameter(name)
    return rows.values[name] if is_in_rows else 1.0


def _slope(side: Side, joint: str) -> Array:
    """Return -tau' (R, 1) at the rows, less the part that friction and a rotor may explain."""
    slope, alike = side.once(late_columns, joint)
    # The multiples of `alike` that explain most of the slope next to the columns of the fit (Frisch
    # and Waugh 1933) are subtracted: the coefficient of the rest is still the delay.
    rest = side.equation.residual_of(side.equation.weighted(np.hstack([slope, alike])))
    return np.asarray(slope - (alike @ scaled_svd(rest[:, 1:]).solve(rest[:, 0]))[:, None])


def late_columns(side: Side, joint: str) -> tuple[Array, Array]:
    """Return -tau' (R, 1) of a torque at the rows, and columns (R, c) that resemble it.

    They are those of friction and a rotor that the drive may lack: friction that changes gradually
    near reversals resembles an early torque. Columns that the model has already are zero.
    """
    rows, drive, index = side.drive(joint), side.robot.drives[joint], side.robot.index(joint)
    is_ideal, channel = drive == IDEAL_DRIVE, torque_channel(side, joint)
    constant = _constant_of(side, joint)
    is_open = is_ideal or drive.motor_inertia_kg_m2 is None
    fastest = max(float(np.max(np.abs(x.motor_velocity[:, index]))) for x in side.motions)

    def of_drive(motion: Motion) -> Array:
        speed, acceleration = motion.motor_velocity[:, index], motion.motor_acceleration[:, index]
        # tanh(v / w) is 1 from about 2 w on, as the sign of Coulomb friction.
        gradual = np.tanh(speed / (tol.POOR * fastest))
        return np.column_stack([gradual, speed, is_ideal * np.sign(speed), is_open * acceleration])

    alike = rows.at_rows([*map(of_drive, side.motions)])
    weighted = side.equation.weighted(alike)
    rest = np.linalg.norm(side.equation.residual_of(weighted), axis=0)
    alike[:, rest < _ROUNDING * np.linalg.norm(weighted, axis=0)] = 0.0

    # Filtered first: at the ends of a log the filter continues a torque and not a slope, the noise
    # of which is as large as its first difference.
    def slope_in(motion: Motion) -> Array:
        signal, band_hz = getattr(motion, channel)[:, [index]], POSITION_BAND * motion.cutoff_hz
        smooth = low_pass(signal, motion.rate_hz, band_hz)
        return constant * np.gradient(smooth, motion.time, axis=0)

    return -rows.at_rows([*map(slope_in, side.motions)]), alike


_ROUNDING = 1e-3
"""Part of a column that rounding leaves of one that is in the model already; least range [m] of a
joint that slides."""


def beyond_extremes(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield what a motor gives beyond the extremes of what was logged, while the log is there.

    The coefficient is the mean over these samples.
    """
    index, channel = side.robot.index(joint), torque_channel(side, joint)
    shapes = [channels.beyond_extremes(getattr(x, channel)[:, index]) for x in side.motions]
    sizes = np.sum(np.abs(np.concatenate(shapes)), axis=0)
    if sizes[0]:  # the number of samples at an extreme
        factors = -_constant_of(side, joint) * sizes[0] / sizes
        columns = side.drive(joint).at_rows([factors * shape for shape in shapes])
        models = (engine.Alternative(column[:, None], 1) for column in columns.T)
        yield engine.Candidate(joint, "saturation", channel, tuple(models))


def beyond_amplifiers(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield what a logged command has beyond a limit of its amplifier.

    The limit is that of a grid by which the filtered torque at the rows, which costs little,
    explains most of the residual.
    """
    index, channel = side.robot.index(joint), torque_channel(side, joint)
    inputs, drive = [getattr(x, channel)[:, [index]] for x in side.motions], side.drive(joint)
    size = np.abs(at_rows := drive.at_rows(inputs))
    limits = np.quantile(size[side.equation.rows.joint == index], 1 - _PARTS_BEYOND)
    rows = side.equation.weighted(np.sign(at_rows) * np.maximum(size - limits, 0.0))
    rest, residual = side.equation.residual_of(rows), side.equation.residual
    shares = (residual @ rest) ** 2 / np.maximum(np.sum(rest**2, axis=0), tol.LEAST)
    if np.max(shares) > tol.SLIGHT * side.equation.squares():
        limit = float(limits[np.argmax(shares)])
        beyond = [np.sign(x) * np.maximum(np.abs(x) - limit, 0.0) for x in inputs]
        column = _constant_of(side, joint) * drive.at_rows(beyond)
        model = engine.Alternative(column, 2, values={"limit": limit})
        yield engine.Candidate(joint, "saturation", "amplifier", (model,))


_PARTS_BEYOND = np.geomspace(0.5, 0.01)
"""Parts of the samples of a command beyond the limits that are tried."""


def is_amplifier(side: Side, joint: str, accepted: Acceptance, share: float) -> Finding | None:
    """Return the finding of an amplifier that gives what is beyond its limit to no part."""
    value, error = float(accepted[0].coefficients[0]), float(accepted[0].errors[0])
    # all that is beyond the limit, within the grid of limits, or else it is another nonlinearity
    if error > tol.POOR or abs(value - 1) > max(tol.SURE * error, tol.RARE):
        return None
    limit = accepted[0].trial.alternative.values["limit"]
    words = {"quantity": torque_channel(side, joint).replace("_", " "), "explained": share}
    of_joint = "amplifier", joint, {"limit": limit, "part": value, "standard error": error, **words}
    return CODES["saturation"].finding(*of_joint, is_worse=_changes_much(side, accepted))


def limit_of_motor(side: Side, selection: engine.Selection, finding: Finding) -> Finding | None:
    """Return the note that a motor has the limit of its log, None if it may give more or less.

    By both shapes the mean of that is at most a slight part of the limit, next to what is accepted.
    """
    accepted = [x.trial.alternative for x in selection.accepted]
    candidates = beyond_extremes(side, finding.joint) if torque_channel(side, finding.joint) else ()
    models = [model for candidate in candidates for model in candidate.alternatives]
    fits = [side.equation.with_alternatives([*accepted, model]).last(1) for model in models]
    most = max((abs(x.item()) + tol.SURE * error.item() for x, error in fits), default=math.inf)
    if most > tol.SLIGHT * finding.evidence.get("limit", 0.0):
        return None
    evidence = {**finding.evidence, "before": finding.message, "most": most}
    return CODES["saturation"].finding("of_motor", finding.joint, evidence)


def is_beyond(side: Side, joint: str, accepted: Acceptance, share: float) -> Finding | None:
    """Return the finding of a motor that gave more, or less, than the extreme that was logged."""
    value, error = float(accepted[0].coefficients[0]), float(accepted[0].errors[0])
    if abs(value) < tol.SURE * error:
        return None
    evidence = {"beyond the limit": value, "standard error": error, "explained": share}
    words = {"quantity": accepted[0].trial.candidate.term.replace("_", " "), "size": abs(value)}
    of_joint = "beyond" if value > 0 else "less", joint, {**evidence, **words}
    return CODES["saturation"].finding(*of_joint, is_worse=_changes_much(side, accepted))


def is_late(side: Side, joint: str, accepted: Acceptance, share: float) -> Finding | None:
    """Return the finding of a channel that is late or early against the others."""
    late, channel = accepted[0], accepted[0].trial.candidate.term
    value = float(late.coefficients[0]), float(late.errors[0])
    delay = _late_encoder(side, joint, late) if channel == "joint_position" else value
    # Beyond half a period of the cutoff nothing is linear in a delay, and blocks of time contradict
    # one that is within its error: it stands for another cause.
    if delay is None or not tol.SURE * delay[1] < abs(delay[0]) < 0.5 / side.motions[0].cutoff_hz:
        return None
    is_doubt = _changes_much(side, accepted)
    is_doubt |= channel == "joint_position" and _changes_friction(side, joint, value[0])
    is_doubt |= abs(delay[0]) - tol.SURE * delay[1] > tol.LEAST_DELAY_S
    finding = late_channels(side, {joint: channel}, delay, share, is_doubt)
    # A value that is by half too large or too small is not to be used.
    is_wrong = _changes_much(side, accepted, tol.MOST)
    return replace(finding, severity="wrong") if is_wrong else finding


def _changes_much(side: Side, accepted: Acceptance, part: float = tol.POOR) -> bool:
    """Whether what was accepted changes a positive parameter of the fit by a part of what it is.

    That is beyond its errors, and a part of the value next to what was accepted.
    """
    change = sum(x.change for x in accepted)
    after = np.abs(side.fitted.estimate.values + change)
    is_large = side.changed_by(accepted)["standard errors"] > tol.SIGNIFICANT
    is_large &= np.abs(change) > part * after
    # a part of a value that may be zero, as of a product of inertia, is none
    is_large &= [name.quantity in POSITIVE for name in side.fitted.estimate.names]
    return bool(np.any(is_large))


def _changes_friction(side: Side, joint: str, damping: float) -> bool:
    """Whether k d of a position that is late by d changes the viscous friction of the motor."""
    drive, motor = side.robot.drives[joint], side.motor_values(joint)
    viscous, error = motor.get("viscous_friction", (0.0, math.inf))
    # The deflection has d theta_L' more, and (7) the torque r_M/N k d r_L theta_L' of friction.
    change = abs(damping) * (drive.motor_radius / drive.ratio) ** 2
    return change > max(tol.POOR * abs(viscous), tol.SIGNIFICANT * error)


def late_channels(
    side: Side,
    channels: Mapping[str, str],
    value: tuple[float, float],
    share: float,
    is_doubt: bool,
) -> Finding:
    """Return the finding that {joint: channel}, of one kind, are late, or early.

    `value` is their delay [s] and its standard error; it explains the `share` of a residual. The
    finding is a doubt, and not a note, if the delay is above the least one that matters, or changes
    a parameter. Of one joint what exceeds `SURE` standard errors counts; of a delay common to many
    joints the whole does, because their scatter is in the standard error already.
    """
    delay, error = value
    earlier = partial(changed_source, delay_s=round(delay, 5))
    entries = {
        joint: {channel: earlier(side.sources.get(joint, {}).get(channel, ""))}
        for joint, channel in channels.items()
    }
    late = f"{next(iter(channels.values())).replace('_', ' ')}s"
    words = {"channels": late, "joints": ", ".join(channels)}
    words["late"] = "late" if delay > 0 else "early"
    words["others"] = "motor positions" if late == "joint positions" else "positions"
    evidence = {"delay [s]": delay, "standard error [s]": error, "explained": share}
    remedy = codes.in_description(entries)
    of_channels = "late", codes.only_joint([*channels]), {**evidence, **words}, remedy, is_doubt
    return CODES["delay"].finding(*of_channels)


def common_delay(
    selected: Sequence[tuple[Side, engine.Selection]], delays: Mapping[str, tuple[float, float]]
) -> Finding | None:
    """Return the finding that all motor torques are late by as much, None without it.

    `delays` are those of all sides. Those of single joints that the rows hardly show add up: the
    weighted mean has the error of its parts, and their scatter (Birge 1932).
    """
    if len(delays) < 2:
        return None
    values, errors = np.array(list(delays.values())).T
    # Each delay counts as off by LEAST_DELAY_S more, by filters and friction that a model lacks.
    weights = 1.0 / (errors**2 + tol.LEAST_DELAY_S**2)
    common = float(np.average(values, weights=weights))
    spread = float(np.linalg.norm(weights * errors) / np.sum(weights))
    # The variance of the values over their number is that of their mean.
    scatter = float(np.sqrt(np.average((values - common) ** 2, weights=weights) / len(values)))
    error = float(np.hypot(spread, scatter))
    if abs(common) < max(tol.SIGNIFICANT * error, tol.LEAST_DELAY_S):
        return None
    accepted = (x for _, selection in selected for x in selection.accepted)
    shares = [x.share for x in accepted if x.trial.candidate.about.code is CODES["delay"]]
    side, share = selected[0][0], max(shares, default=0.0)
    channels = {joint: torque_channel(side, joint) for joint in delays}
    return late_channels(side, channels, (common, error), share, is_doubt=True)


def torque_delays(side: Side, selection: engine.Selection) -> dict[str, tuple[float, float]]:
    """Return the delay of each motor torque [s], and its standard error, by one fit of all.

    The fit has the accepted columns other than delays. All delays are fitted at once, because a
    torque that is late spoils the bodies, and with them the other joints.
    """
    joints = [joint for joint in side.joints if torque_channel(side, joint)]
    if not joints:
        return {}
    trials = (x.trial for x in selection.accepted)
    accepted = [x.alternative for x in trials if x.candidate.field != "delay"]
    columns = [side.once(late_columns, joint) for joint in joints]
    late = np.hstack([*(alike for _, alike in columns), *(slope for slope, _ in columns)])
    larger = side.equation.with_alternatives([*accepted, engine.Alternative(late, 0)])
    values, errors = larger.last(len(joints))
    return dict(zip(joints, zip(values.tolist(), errors.tolist(), strict=True), strict=True))


def _late_encoder(side: Side, joint: str, late: engine.Accepted) -> tuple[float, float] | None:
    """Return the delay of a joint position [s] and its error, None if it may be something else.

    The speed of the joint is that of the motor less that of the deflection. Next to viscous
    friction a delay d is a damping k d of the spring, with less friction, by k d (r_M/N)^2: the
    torque on the load separates both. An early position, d < 0, looks like a late torque with as
    much more friction: where no friction is left next to the position, the torque is late.
    """
    refitted = side.next_to(late)
    stiffness, _ = {**side.motor_values(joint), **refitted}.get("stiffness", (0.0, 0.0))
    viscous, tolerance = refitted.get("viscous_friction", (0.0, 0.0))
    damping, error = float(late.coefficients[0]), float(late.errors[0])
    is_damping = viscous - damping * _lever(side, joint) ** 2 > -tol.SURE * tolerance
    is_other = side.is_motor and (is_damping if damping > 0 else viscous < tol.SURE * tolerance)
    if stiffness <= 0 or is_other:
        return None
    return damping / stiffness, error / stiffness


def zeros(side: Side, joint: str) -> Iterator[engine.Candidate]:
    """Yield the torque that the fitted bodies have more where the zero of an encoder is off.

    The motors of springs move along, because the spring offset absorbs a constant deflection.
    """
    turned = side.slopes[:, [side.robot.index(joint)]]
    yield engine.linear_candidate(joint, "offset", "joint_position", turned)


def _searched_zero(side: Side, joint: str, start: float) -> tuple[float, float]:
    """Return the angle to be added to a joint, and its standard error, next to any bodies.

    Gauss and Newton's steps, with the slopes between the angle of the log and a first one, `start`:
    the bodies were fitted at the wrong zero, and change with it, and so do the weights of the
    equations.
    """
    assert side.base is not None
    base, robot, rows = side.base, side.robot, side.equation.rows
    count, is_turned = len(base.grouping), np.array(robot.joint_names) == joint

    def turned_by(angle: float) -> Array:
        def columns_of(q: Array, v: Array, a: Array) -> Array:
            Y = regressor_at_drives(robot, q + angle * is_turned, v, a)
            return np.concatenate([base.reduce(Y), Y @ robot.known_parameters[:, None]], axis=2)

        return side.filtered(columns_of)

    # (R, p + 1): the base columns at the angle of the log, and the torque of the known bodies.
    before = np.column_stack([rows.H[:, :count], side.torque_of_known])
    # A first angle beyond a slight one is none, but an echo of what the bodies lack.
    near = start if abs(start) < tol.SLIGHT else tol.LEAST_OFFSET
    angle, change, slopes = 0.0, np.zeros_like(before), (turned_by(near) - before) / near
    for _ in range(MOST_STEPS):
        # (8) at the angle: (H + dH) theta = y - d tau_known. Columns of drives do not change.
        H, y = rows.H.copy(), rows.y - change[:, count]
        H[:, :count] += change[:, :count]
        turned = replace(rows, H=H, y=y)
        current = engine.Equation(turned, settled_weights(qr_factor_of(turned)))
        # (R, p + 1) @ (p + 1,): the derivative of the torque of all bodies by the angle.
        slope = slopes @ np.append(current.values[:count], 1.0)
        column = engine.Alternative(slope[:, None], 1)
        (correction,), (error,) = current.with_alternatives([column]).last(1)
        angle += float(correction)
        if abs(correction) < tol.POOR * error:
            break
        # Next to the angle of the slopes the change is linear, up to their product.
        is_near = abs(angle * (angle - near)) < tol.FEW * error
        change = angle * slopes if is_near else turned_by(angle) - before
    return angle, float(error)


def zero_is_off(side: Side, joint: str, accepted: Acceptance, share: float) -> Finding | None:
    """Return the finding of a joint whose zero is not that of the robot file.

    An angle that is not determined stands for something else: over an interval beyond half a
    radian, 5 standard errors of a tenth, torques are not linear in it. Alone an echo of another
    joint's angle has another sign or size than next to that. Known bodies whose centres of mass lie
    in another direction have the same torque.
    """
    (near,), (error,) = accepted[0].coefficients.tolist(), accepted[0].errors.tolist()
    offset = near  # next to what else was accepted
    # The effect of a smaller offset is linear, and the errors contain it.
    if abs(offset) > tol.SURE * side.offset_std:
        offset, error = _searched_zero(side, joint, offset)
    is_sure = abs(offset) >= tol.SIGNIFICANT * error and error <= tol.POOR
    # to first order an angle x has a torque of sin(x), which is half of it at 1.9 rad
    if not is_sure or not 1 / tol.TWICE < near / offset < tol.TWICE:
        return None
    is_known, rival = bool(side.robot.known_bodies), ", or centres of known bodies are off as much"
    # Known bodies are wrong by a tenth of what others are (`Experiment.widths`).
    is_minor = abs(offset) < max(tol.SURE * side.offset_std, tol.BODY * tol.POOR * is_known)
    is_minor |= share < tol.FEW  # next to what else was accepted it explains nothing
    evidence = {"offset [rad]": offset, "standard error [rad]": error, "explained": share}
    lines = codes.in_description(moved_zeros(side.robot, {joint: offset}, side.sources))
    of_joint = "residual", joint, {**evidence, "rival": rival * is_known}, lines, not is_minor
    return CODES["encoder-offset"].finding(*of_joint)
