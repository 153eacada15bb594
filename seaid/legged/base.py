"""The base of a legged robot: its sensors in a log, their errors in a fit, and its mass.

Axes that are missing, frames and orders that contradict each other, and jumps of a pose are seen in
the samples.

Mass and centre of mass of the whole robot, and of its base alone, are linear in the inertial
parameters, or ratios of such: c^T theta is determined if c is a combination of the rows of the
grouping matrix of the base parameters, and only then has a value.

A bias b of the accelerometer, constant in the axes of the base, is as a constant acceleration: it
adds M_0 b to the equations, with the first three columns M_0 of the mass matrix. Next to the bodies
it is identified from the change of gravity in these axes. The zero z of a force sensor adds J_c^T z
in the axes of its link, and is identified as the foot turns, or as it leaves the ground.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations, compress
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from scipy.special import fdtrc, stdtrit

from seaid._arrays import Array, FrozenMapping, is_constant, safely
from seaid._progress import counted
from seaid.checks import CODES
from seaid.checks.codes import only_joint
from seaid.checks.engine import Check, observed
from seaid.checks.tolerances import MANY_TIMES, MOST, NEGLIGIBLE, RARE, SURE
from seaid.errors import Finding, listed
from seaid.estimation import Estimate, FittedRows
from seaid.estimation.covariance import MOST_FREEDOM
from seaid.estimation.fitting import with_further_columns
from seaid.identification.datasets import Dataset, rows_in_memory
from seaid.legged.floating import FloatingRobot, base_of
from seaid.legged.load_side import accelerometer_rows, wrench_rows
from seaid.log import BaseLog, Log, Motion, low_pass
from seaid.log.base_log import (
    BaseMotion,
    differentiated,
    jumps_of,
    matrices,
    needed_columns,
    quaternion_rates,
)
from seaid.log.channels import CHANNELS
from seaid.log.motion import MotionWithBase
from seaid.regressor.load import LoadModel
from seaid.regressor.regression import Regress
from seaid.robot import FloatingBase, Robot

if TYPE_CHECKING:
    from seaid.identification import Identification


FRAMES_HZ, BASE_TURNS_RAD_S, BASE_MOVES_M_S = 5.0, 0.05, 0.02
"""Low pass [Hz] behind which rates of a base are compared, in which 0.1 degrees of noise of an
orientation are a tenth of the rate (rms) [rad/s] from which a base turns, and 0.1 mm of noise of a
position a tenth of that [m/s] from which it moves."""


@dataclass(frozen=True, eq=False)
class BaseRecord:
    """The samples of a base at the times (T,) of a log, and the base that has the sensors."""

    samples: BaseLog
    time: Array
    base: FloatingBase


def _missing_axes(record: BaseRecord) -> Iterator[Finding]:
    """Yield the axes of an IMU that are constant."""
    for name in ("angular_velocity", "specific_force"):
        values, needed = getattr(record.samples, name), needed_columns(record.base, name)
        columns = zip("xyz", CHANNELS[name], () if values is None else values.T, strict=False)
        for axis, whole_name, column in columns:
            if whole_name in needed and is_constant(column):
                words = {"axis": axis, "name": name.replace("_", " ")}
                evidence = {"value": float(column[0]) + 0.0, **words}
                yield CODES["base-sensor"].finding("constant", "", evidence)


def base_jumps(log: BaseLog, time: Array) -> dict[str, tuple[int, float, float]]:
    """Return {field: number of jumps, the largest, time of the first} of a pose that jumps."""
    jumps = {}
    for name in differentiated(log):
        is_jump, off = jumps_of(name, getattr(log, name))
        if np.any(is_jump):
            largest = float(np.max(np.linalg.norm(off[is_jump], axis=1)))
            jumps[name] = int(is_jump.sum()), largest, float(time[np.argmax(is_jump)])
    return jumps


def _jumps(record: BaseRecord) -> Iterator[Finding]:
    """Yield jumps of a pose, which were taken out."""
    for name, (count, largest, first_s) in base_jumps(record.samples, record.time).items():
        unit = {"position": " m", "velocity": " m/s"}.get(name, " rad")
        words = {"name": name, "unit": unit, "times": counted(count, "jump")}
        words["at"] = f"{first_s:.4g}"
        evidence = {"jumps": float(count), "largest": largest, **words}
        yield CODES["base-jumps"].finding("removed", "", evidence)


def _contradicting_frames(record: BaseRecord) -> Iterator[Finding]:
    """Yield an order, a frame or a plane that the sensors of a base contradict."""
    samples, base = record.samples, record.base
    if not base.imu_is_fixed:
        return
    w, force = (
        None if vectors is None else vectors @ base.imu_placement[0].T
        for vectors in (samples.angular_velocity, samples.specific_force)
    )
    if samples.orientation is not None:
        turning = [*_turning(samples.orientation, w, record.time)] if w is not None else []
        yield from turning
        if force is not None and not turning:  # a wrong orientation turns gravity too
            yield from _downwards(turned_to_world(samples.orientation, force).mean(axis=0))
    if base.normal is not None and w is not None:
        yield from _out_of_plane(base, np.array(base.normal), w)


def _downwards(force: Array) -> Iterator[Finding]:
    """Yield a mean specific force (3,) in the world that has the direction of gravity."""
    if force[2] < -MOST * np.linalg.norm(force):
        evidence, lines = (
            {"mean upwards [m/s^2]": float(force[2])},
            _described("specific_force", "-1"),
        )
        yield CODES["base-frames"].finding("downwards", "", evidence, lines)


def _out_of_plane(base: FloatingBase, normal: Array, w: Array) -> Iterator[Finding]:
    """Yield a planar base whose angular velocity (T, 3) is about the axes in its plane too."""
    inside = float(np.std(w @ normal))
    # w without its part about the normal; `turning` projects on that.
    outside = float(np.linalg.norm(np.std(w @ (np.eye(3) - base.turning), 0)))
    # a guide with play and an IMU that is mounted askew have a few hundredths
    if outside > max(RARE * inside, BASE_TURNS_RAD_S):
        evidence = {"out of the plane [rad/s]": outside, "in the plane [rad/s]": inside}
        yield CODES["base-frames"].finding("plane", "", evidence)


def _turning(orientation: Array, w: Array, time: Array) -> Iterator[Finding]:
    """Yield the order, frame or unit that makes the gyroscope the change of the orientation."""
    w, orientation = _slow(time, w, orientation)
    change = quaternion_rates(orientation, time)
    if float(np.std(change)) < BASE_TURNS_RAD_S:
        return
    w_in_base, back = turned_to_world(orientation, w, back=True), orientation * [1, -1, -1, -1]
    # A quaternion is w, x, y, z in memory: one that was read in the other order is permuted back.
    readings = {
        'angular_velocity is in the frame of the world: frame = "world"': (orientation, w_in_base),
        'the quaternion is x, y, z, w: order = "xyzw"': (orientation[:, [3, 0, 1, 2]], w),
        'the quaternion is w, x, y, z: order = "wxyz"': (orientation[:, [1, 2, 3, 0]], w),
        "the quaternion turns from the world to the base: change the signs of x, y, z": (back, w),
    }
    rates = {text: (quaternion_rates(turns, time), x) for text, (turns, x) in readings.items()}
    degrees = ("is in degrees per second", "0.0174533")
    yield from _misread(("angular_velocity", "orientation"), (change, w), rates, degrees)


def _moving(record: BaseRecord) -> Iterator[Finding]:
    """Yield the sign, axes, frame or unit that makes the velocity the change of the position."""
    samples, time = record.samples, record.time
    if samples.velocity is None or samples.position is None:
        return
    v, position = _slow(time, samples.velocity, samples.position)
    change = np.gradient(position, time, axis=0)
    if float(np.std(change)) < BASE_MOVES_M_S:
        return
    # A planar base has no velocity along its normal.
    axes = np.flatnonzero(np.any(v != 0, axis=0)).tolist()
    readings = {"its sign: scale = -1": (change, -v)}
    for pair in combinations(axes, 2):
        order = np.arange(3)
        order[[*pair]] = pair[::-1]
        readings[f"{'xyz'[pair[0]]} and {'xyz'[pair[1]]} are exchanged"] = change, v[:, order]
    if samples.orientation is not None:
        readings['its frame: frame = "base"'] = change, turned_to_world(samples.orientation, v)
    yield from _misread(("velocity", "position"), (change, v), readings, ("is in mm/s", "0.001"))


def _slow(time: Array, *signals: Array) -> Iterator[Array]:
    """Yield signals (T, k) behind one low pass: what it attenuates is no misfit between them."""
    rate_hz = (len(time) - 1) / float(time[-1] - time[0])
    return (low_pass(x, rate_hz, min(FRAMES_HZ, 0.4 * rate_hz)) for x in signals)


_Rates = tuple[Array, Array]


def _misread(
    names: tuple[str, str], rates: _Rates, readings: Mapping[str, _Rates], unit: tuple[str, str]
) -> Iterator[Finding]:
    """Yield how a quantity has to be read that is not the change of another one.

    `names` are those of both, `rates` this change and the quantity, `readings` {text: both as they
    may be meant}, and `unit` the words and the scale of another unit.
    """
    misfit = 1 - _correlation(*rates)
    misfits = {text: 1 - _correlation(*pair) for text, pair in readings.items()}
    best = min(misfits, key=misfits.__getitem__)
    text, remedy = f"contradicts the {names[1]}: order, frame, or times are others", _BY_SAMPLES
    if misfit > NEGLIGIBLE and MANY_TIMES * misfits[best] < misfit:
        text = f"contradicts the {names[1]}: {best}"
    elif misfit <= MOST:
        text, remedy = unit[0], _described(names[0], unit[1])
        # change = s v by least squares has the scale s of the other unit
        scale = np.sum(rates[0] * rates[1]) / np.sum(rates[1] ** 2)
        if abs(scale / float(unit[1]) - 1) >= RARE:
            return
    evidence = {"correlation": 1 - misfit, "name": names[0].replace("_", " "), "text": text}
    yield CODES["base-frames"].finding("misread", "", evidence, remedy)


def turned_to_world(orientation: Array, vectors: Array, *, back: bool = False) -> Array:
    """Return vectors (T, 3) of the base's frame in the world's, or `back`."""
    R = matrices(orientation / np.linalg.norm(orientation, axis=1, keepdims=True))
    return np.asarray(np.einsum("tji,tj->ti" if back else "tij,tj->ti", R, vectors))


_BY_SAMPLES = (
    "name order and frame in [base] of the description of the log; seaid describe decides both by "
    "the samples"
)


def _described(quantity: str, scale: str) -> str:
    """Return a vector of the base with a scale, as TOML."""
    columns = '["...", "...", "..."]'
    return (
        f"in the description of the log:\n[base]\n{quantity} = "
        f"{{ columns = {columns}, scale = {scale} }}"
    )


def _correlation(x: Array, y: Array) -> float:
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(np.sum(x * y)) / size if size > 0 else 0.0


RECORD_CHECKS = (
    Check(CODES["base-sensor"], (), _missing_axes),
    Check(CODES["base-frames"], (), _contradicting_frames),
    Check(CODES["base-frames"], (), _moving),
    Check(CODES["base-jumps"], (), _jumps),
)


def base_findings(robot: FloatingRobot, logs: Sequence[Log]) -> list[Finding]:
    """Return what contradicts itself in the base of logs."""
    base = robot.floating_base
    records = [BaseRecord(log.base, log.time, base) for log in logs if log.base is not None]
    return [finding for record in records for finding in observed(RECORD_CHECKS, record)]


def guide_findings(motions: Iterable[Motion]) -> list[Finding]:
    """Return the note on equations of planar bases that do not use a freedom of their plane."""
    guided = dict.fromkeys(chain(*(base_of(x).guided for x in motions)))
    if not guided:
        return []
    evidence = {"equations": float(len(guided)), "names": listed([*guided])}
    return [CODES["locked-output"].finding("guided", "", evidence)]


def missing_torques(asked: Sequence[str], used: Collection[str]) -> Iterator[Finding]:
    """Yield the note on joints of a floating base that are `asked` for and have no torque."""
    missing = [joint for joint in asked if joint not in used]
    if missing:
        evidence = {"joints": float(len(missing)), "names": listed(missing)}
        case = "partly" if used else "all"
        yield CODES["no-torque"].finding(case, only_joint(missing), evidence)


DETERMINED = 1e-6
"""Part of a functional of the parameters, or of a force, outside of what is determined (the base
parameters, the equations) that is rounding; over its norm."""


@dataclass(frozen=True)
class BodyValue:
    """A mass [kg] or a coordinate of a centre of mass [m], NaN if the logs do not determine it."""

    name: str
    value: float
    standard_error: float
    unit: str

    @property
    def is_determined(self) -> bool:
        """Whether the logs determine it."""
        return bool(np.isfinite(self.value))


def whole_body(identification: Identification) -> tuple[BodyValue, ...]:
    """Return mass and centre of mass of the robot in the middle of its motion, and of its base.

    Centres are in the frame of the base, payloads included. Empty for a fixed base.
    """
    if not isinstance(identification.robot, FloatingRobot):
        return ()
    moments = _first_moments(identification)
    base = identification.robot.body_names[-1]
    alone = np.zeros_like(moments)
    # The base is the last body; its first four parameters are m, m x, m y, m z in its frame.
    alone[:, -10:-6] = np.eye(4)
    return tuple(
        value
        for name, rows in (("whole robot", moments), (base, alone))
        for value in _mass_and_center(identification, name, rows)
    )


def mean_posture(result: Identification) -> Array:
    """Return the mean joint positions (n,) of the logs, zero if none was in memory."""
    if not result.motions:
        return np.zeros(result.robot.n)
    return np.asarray(np.concatenate([x.joint_position for x in result.motions]).mean(axis=0))


def _first_moments(identification: Identification) -> Array:
    """Return the functionals (4, 10N) of mass and first moments of the robot about its base."""
    robot = identification.robot
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.to_model(mean_posture(identification)))
    rows = np.zeros((4, robot.parameters.size))
    frames = [pin.SE3.Identity()] * len(robot.body_names)
    for place, index in enumerate(robot.model_order, 1):
        frames[index] = data.oMi[place]
    for body, frame in enumerate(frames):
        rows[0, 10 * body] = 1.0
        # m c in the axes of the base: R h + m p, with the body's first moment h in its own frame.
        rows[1:, 10 * body] = frame.translation
        rows[1:, 10 * body + 1 : 10 * body + 4] = frame.rotation
    return rows


def _mass_and_center(identification: Identification, name: str, rows: Array) -> list[BodyValue]:
    """Return the values of the functionals (4, 10N) of a mass and its first moments."""
    robot, base = identification.robot, identification.base
    combined = rows[:, list(base.columns)]
    # c^T theta = c_b^T beta if c = c_b B (14), with the entries c_b at the base columns, where B is
    # the identity. What is left may be on known bodies, whose values are added below.
    undetermined = (rows - combined @ base.grouping) * ~robot.is_known
    is_known = np.linalg.norm(undetermined, axis=1) <= DETERMINED * np.linalg.norm(rows, axis=1)
    known = rows @ (robot.payload_parameters + np.where(robot.is_known, robot.parameters, 0.0))
    mass, *moment = (combined @ identification.load.values + known).tolist()
    slopes = np.vstack([combined[:1], (combined[1:] - np.outer(moment, combined[0]) / mass) / mass])
    # h / m has the slopes (c_h - h / m c_m) / m
    errors = np.sqrt(np.einsum("ij,jk,ik->i", slopes, identification.load.covariance, slopes))
    values = np.array([mass, *(h / mass for h in moment)])
    is_known[1:] &= is_known[0]
    values[~is_known] = errors[~is_known] = np.nan
    names = [f"mass of {name}", *(f"centre of mass of {name}, {x}" for x in "xyz")]
    units = ["kg", *["m"] * 3]
    facts = zip(names, values.tolist(), errors.tolist(), units, strict=True)
    return [BodyValue(*fact) for fact in facts]


def bodies_of_fit(identification: Identification) -> tuple[Array, bool]:
    """Return standard parameters (10N,) with the base parameters of the fit, and if they are whole.

    What the base parameters lack is that of the identified robot, or zero if it has none.
    """
    known, base = identification.known, identification.base
    bodies = np.where(known.is_known, 0.0, identification.robot.parameters)
    is_whole = bool(np.all(np.isfinite(known.parameters)))
    bodies = bodies if is_whole else np.zeros_like(bodies)
    values = identification.load_side.values[: len(base.columns)]
    # B has the identity at the base columns, so that adding the difference there satisfies (14).
    bodies[list(base.columns)] += values - base.grouping @ bodies
    return bodies + known.known_parameters, is_whole


@dataclass(frozen=True, eq=False)
class SensorBias:
    """Constant errors (k,) of an accelerometer [m/s^2] and of force sensors [N or N m].

    `places` are the k axes: (link of the sensor, axis in its frame), the link "" for those of the
    base. `columns` are the changes of y by the errors (R, k), which have a `covariance` (k, k).
    `hidden` are axes of force sensors whose zeros the logs do not determine; `imu` (3, 3) turns
    from the frame of the accelerometer.
    """

    places: tuple[tuple[str, int], ...]
    value: Array
    covariance: Array
    columns: Array
    hidden: tuple[tuple[str, int], ...]
    imu: Array | None = None

    @property
    def errors(self) -> Array:
        """The standard errors (k,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def of(self, link: str, width: int = 3) -> Array:
        """Return the errors (width,) of one sensor, zero where none was found."""
        errors = np.zeros(width)
        for (sensor, axis), value in zip(self.places, self.value, strict=True):
            if sensor == link:
                errors[axis] = value
        return errors

    def removed(self, datasets: Sequence[Dataset]) -> list[Motion]:
        """Return the motions of a floating base without the errors."""
        motions: list[Motion] = []
        for motion in (log for log in datasets if isinstance(log, MotionWithBase)):
            force = motion.base.specific_force - self.of("")
            wrenches = {x: y - self.of(x, y.shape[1]) for x, y in motion.base.wrenches.items()}
            base = replace(
                motion.base, specific_force=force, wrenches=FrozenMapping(wrenches, "link")
            )
            motions.append(replace(motion, base=base))
        return motions

    def findings(self) -> Iterator[Finding]:
        """Yield the notes on the errors that were identified and subtracted."""
        pairs = zip(self.value.tolist(), self.errors.tolist(), strict=True)
        estimates = dict(zip(self.places, pairs, strict=True))
        bias = [estimates.pop(("", axis), (0.0, 0.0)) for axis in range(3)]
        if self.imu is not None and any(error for _, error in bias):
            yield _bias_note(np.array(bias), self.imu)
        if estimates:
            yield _zeros_note(estimates, self.hidden)


def _bias_note(bias: Array, imu: Array) -> Finding:
    """Return the note on the bias (3, 2) of an accelerometer, with its error, in axes `imu`."""
    names = ("x [m/s^2]", "y [m/s^2]", "z [m/s^2]")
    evidence = dict(zip(names, bias[:, 0] @ imu, strict=True))
    words = {"sizes": ", ".join(f"{x:.2g}" for x in evidence.values())}
    words["error"] = f"{np.max(bias[:, 1]):.1g}"
    return CODES["base-bias"].finding("subtracted", "", {**evidence, **words})


def _zeros_note(
    estimates: Mapping[tuple[str, int], tuple[float, float]], hidden: Sequence[tuple[str, int]]
) -> Finding:
    """Return the note on zeros of force sensors {axis: value and error}, some axes `hidden`."""
    zeros = {f"{_axis_of(*x)} [{'N m' if x[1] > 2 else 'N'}]": y for x, y in estimates.items()}
    texts = (f"{name} {value:.3g} +- {std:.1g}" for name, (value, std) in zeros.items())
    unknown = listed(_axis_of(*place) for place in hidden)
    words = {"zeros": ", ".join(texts), "unknown": unknown and f"; not determined: {unknown}"}
    evidence = {name: value for name, (value, _) in zeros.items()}
    link = next(iter(estimates))[0]
    return CODES["sensor-zero"].finding("subtracted", link, {**evidence, **words})


_BIASED_M_S2, _NO_BIAS_M_S2 = 0.02, 1.0
"""Bias from which it is removed: 2 mrad of tilt; and from which it is an error of the model. Those
of MEMS sensors are up to 0.5 m/s^2."""

_LEAST_ZERO, _HIDDEN_ZERO, _NO_ZERO = 0.002, 0.02, 0.2
"""Zero of a force sensor over 99 % of its forces or moments from which it is removed, standard
error from which it is not determined, and zero from which it is an error of the model."""

_UNLOADED = 0.25
"""Least force over 99 % of the forces of a sensor from which it is always loaded. The zeros of feet
that always stand rest on small accelerations, whose noise makes the mass small and the zeros large.
"""

_LEVEL = 0.999
"""Level of the tests for errors of sensors."""


@dataclass(frozen=True, eq=False)
class _Axes:
    """The k axes of sensors whose errors act, and the columns (R, k) of these.

    An error counts from the size `least` (k,), and is none of a sensor from `most` (k,).
    """

    places: list[tuple[str, int]]
    columns: Array
    least: Array
    most: Array

    def at(self, kept: list[int]) -> _Axes:
        """Return some of the axes."""
        places = [self.places[k] for k in kept]
        return _Axes(places, self.columns[:, kept], self.least[kept], self.most[kept])

    def counts(self, errors: Array) -> bool:
        """Whether one of the errors (k,) is so large that it is removed."""
        return bool(np.any(np.abs(errors) > self.least))

    def hidden(self, covariance: Array) -> tuple[tuple[str, int], ...]:
        """Return the axes of force sensors whose errors are not determined."""
        far = np.sqrt(np.diag(covariance)) > _HIDDEN_ZERO / _NO_ZERO * self.most
        return tuple(place for place in compress(self.places, far) if place[0])


def sensor_bias(
    robot: Robot, datasets: Sequence[Dataset], model: LoadModel, fit: FittedRows
) -> SensorBias | None:
    """Return the errors of accelerometer and force sensors that the rows of a `fit` support.

    `robot` has the estimated bodies. See the module.
    """
    bases = [log.base for log in datasets if isinstance(log, MotionWithBase)]
    if fit.rows is None or len(bases) < len(datasets):
        return None
    limits = _limits(bases)
    if not limits:
        return None
    axes = _acting_axes(robot, datasets, model, limits, bases[0].wrenches)
    estimate = with_further_columns(fit, axes.columns, axes.counts)
    if estimate is None:  # the base does not tilt, or no error counts
        return None
    k = len(axes.places)
    # The errors are the last k columns of the fit.
    value, covariance = estimate.values[-k:], estimate.covariance[-k:, -k:]
    hidden = axes.hidden(covariance)
    axes = axes.at(_significant(axes, value, covariance, _freedom(estimate)))
    if len(axes.places) < k:
        k = len(axes.places)
        # Without any axis kept the fit is None, and so is the result.
        estimate = with_further_columns(fit, axes.columns, lambda _: k > 0)
    if estimate is None:
        return None
    # Errors that are later taken as normal: the covariance is widened by the square of the ratio of
    # the t quantile to that of a covariance that is as good as known.
    normal = (stdtrit(_freedom(estimate), 0.975) / stdtrit(MOST_FREEDOM, 0.975)) ** 2
    return SensorBias(
        places=tuple(axes.places),
        value=estimate.values[-k:],
        covariance=normal * estimate.covariance[-k:, -k:],
        columns=axes.columns,
        hidden=hidden,
        imu=bases[0].imu,
    )


def _acting_axes(
    robot: Robot,
    datasets: Sequence[Dataset],
    model: LoadModel,
    limits: Mapping[tuple[str, int], tuple[float, float]],
    wrenches: Mapping[str, Array],
) -> _Axes:
    """Return those axes with limits whose errors change the rows.

    The rows have columns of all sensors of `wrenches`, in their order, with and without limits.
    """
    forces = [(link, axis) for link, x in wrenches.items() for axis in range(x.shape[1])]
    axes = {"imu": [("", axis) for axis in range(3)], "force sensors": forces}
    equations: dict[str, Regress] = {
        "imu": partial(accelerometer_rows, robot, model=model),
        "force sensors": partial(wrench_rows, robot, model=model),
    }
    asked = {name: equations[name] for name in axes if {*axes[name]} & {*limits}}
    places, columns = list[tuple[str, int]](), list[Array]()
    for name, rows in rows_in_memory(datasets, asked).items():
        norms = np.linalg.norm(rows.H, axis=0)
        is_limited = np.array([axis in limits for axis in axes[name]])
        kept = (norms > _NOTHING * np.max(norms)) & is_limited
        places += compress(axes[name], kept)
        columns.append(rows.H[:, kept])
    sizes = np.array([limits[place] for place in places]).reshape(-1, 2)
    return _Axes(places, np.hstack(columns), *sizes.T)


def _limits(bases: Sequence[BaseMotion]) -> dict[tuple[str, int], tuple[float, float]]:
    """Return the size from which the error of each axis counts, and from which it is no error."""
    limits: dict[tuple[str, int], tuple[float, float]] = {}
    if all(base.imu is not None for base in bases):
        limits = {("", axis): (_BIASED_M_S2, _NO_BIAS_M_S2) for axis in range(3)}
    # The force sensors of all logs, and their numbers of axes.
    if len({frozenset((x, y.shape[1]) for x, y in base.wrenches.items()) for base in bases}) > 1:
        return limits
    for link in bases[0].wrenches:
        sizes = _sizes_of_axes(np.concatenate([base.wrenches[link] for base in bases]))
        for axis, size in enumerate(sizes):
            limits[link, axis] = (_LEAST_ZERO * size, _NO_ZERO * size)
    return limits


def _sizes_of_axes(wrench: Array) -> list[float]:
    """Return the size of each axis of a force sensor, nothing for one that is always loaded.

    Without accelerations the zero of such a sensor is that of the mass.
    """
    # Forces and moments have sizes of their own: axes 0 to 2, and 3 to 5.
    norms = np.array([np.linalg.norm(wrench[:, k : k + 3], axis=1) for k in (0, 3)])
    sizes = np.quantile(norms, 0.99, axis=1)
    if np.min(norms[0]) > _UNLOADED * sizes[0]:
        return []
    return [float(size) for size in np.repeat(sizes, 3)[: wrench.shape[1]]]


def _significant(axes: _Axes, value: Array, covariance: Array, freedom: float) -> list[int]:
    """Return the axes with errors: those of the accelerometer, of all force sensors, both, or none.

    What is left without the other kind has the values and the covariance of a fit without it,
    b - C_bd C_dd^-1 d. Zeros count all or none: to exclude those that are not significant one by
    one would bias the mass by up to some standard errors.
    """
    is_force = np.array([bool(link) for link, _ in axes.places])
    kinds = [kind for kind in map(np.flatnonzero, (~is_force, is_force)) if len(kind)]
    while kinds:
        kept = np.concatenate(kinds).tolist()
        removed = np.setdiff1d(np.arange(len(value)), kept)
        share = safely(
            np.linalg.solve,
            covariance[np.ix_(removed, removed)],
            covariance[np.ix_(removed, kept)],
            what="the errors of the sensors",
        )
        b, C = np.zeros_like(value), np.zeros_like(covariance)
        b[kept] = value[kept] - value[removed] @ share
        C[np.ix_(kept, kept)] = covariance[np.ix_(kept, kept)]
        # Covariance of the fit in which the removed errors d are zero: C_bb - C_bd C_dd^-1 C_db.
        C[np.ix_(kept, kept)] -= covariance[np.ix_(kept, removed)] @ share
        chances = [
            _chance(axes.at(kind.tolist()), b[kind], C[np.ix_(kind, kind)], freedom)
            for kind in kinds
        ]
        if max(chances) < 1 - _LEVEL:
            return list(kept)
        kinds.pop(int(np.argmax(chances)))
    return []


def _chance(axes: _Axes, b: Array, C: Array, freedom: float) -> float:
    """Return the probability of so large values without errors, 1 if their size does not count."""
    k, size, spread = len(b), np.abs(b), SURE * np.sqrt(np.diag(C))
    if not (axes.counts(b) and np.all(size - spread < axes.most) and freedom >= k):
        return 1.0
    # T^2 = b^T C^-1 b (n - k + 1) / (k n) has the distribution F(k, n - k + 1) (Hotelling)
    score = float(b @ safely(np.linalg.solve, C, b, what="the errors of the sensors"))
    return float(fdtrc(k, freedom - k + 1, score * (freedom - k + 1) / (k * freedom)))


def _freedom(estimate: Estimate) -> float:
    """Return the fewest degrees of freedom of the covariance of an estimate."""
    every = estimate.degrees_of_freedom
    return MOST_FREEDOM if every is None else float(np.min(every, initial=MOST_FREEDOM))


_NOTHING = 1e-9
"""Part of the largest column below which one is rounding."""


def _axis_of(link: str, axis: int) -> str:
    """Return the name of an axis of a force sensor, forces first."""
    return f"{('force', 'moment')[axis // 3]} {'xyz'[axis % 3]} of {link}"
