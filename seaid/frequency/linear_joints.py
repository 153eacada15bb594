"""The robot linearised about a posture: motors, springs and bodies as A(s) x = forces, in SI units.

Coordinates are those of the joints: a motor angle is divided by its ratio to the joint, N r_L/r_M,
and its torque multiplied by it, so that all inertias, stiffnesses and dampings are at the joint.
Motor of an elastic joint, (7):  I s^2 phi_M + F s phi_M + (k + c s)(phi_M - phi) = tau_M
Load, (8) linearised:            M s^2 phi + D s phi + G phi - (k + c s)(phi_M - phi) = 0
with the mass matrix M and the Hessian G of the potential energy at the posture. A stiff joint has
no motor coordinate: I and F are added to the diagonals of M and D.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy

from seaid._arrays import Array, BoolArray, safely
from seaid.drives import Drive, ParameterName, is_dry, total_ratio, unit_of
from seaid.estimation import Estimate
from seaid.estimation.covariance import LEAST_LEFT
from seaid.estimation.qr_factor import scaled_svd
from seaid.frequency.spectra import NEAR, STICKS, Record, Spectra, motor_rates
from seaid.regressor.base import check_constant_ratios, torque_slopes
from seaid.robot import Robot

_WHAT = "the linearised robot"


@dataclass(frozen=True, eq=False)
class LinearJoints:
    """Matrices at the joints of n drives, of which those in `elastic` (n,) have a spring.

    `inertia`, `friction`, `stiffness`, `damping` (n,) are I, F, k and c; `mass`, `gravity` (n, n)
    are M and G. The robot's m joints move by J phi with `motion` (m, n) J, and have the viscous
    friction `drag` (m,) b, so that D = J^T diag(b) J. A stiff joint has its rotor in `mass`, and
    zeros in k, c and I. `dry` (n,) is the level F_C of the motors' dry friction, which is not
    linear, and in none of the matrices.
    """

    elastic: BoolArray
    inertia: Array
    friction: Array
    stiffness: Array
    damping: Array
    mass: Array
    gravity: Array
    drag: Array
    motion: Array
    dry: Array

    def matrices(self) -> tuple[Array, Array, Array]:
        """Return inertia, damping and stiffness (N, N) of the motors, then the stiff and loads.

        The first n coordinates are those of the motor encoders, the others the elastic loads.
        """
        motor, load = self.angles()
        stretch, links = motor - load, self.motion @ load
        # A sum of value * d^T d over the elements, with the row d by which one sees coordinates.
        inertia = motor.T * self.inertia @ motor + load.T @ self.mass @ load
        damping = motor.T * self.friction @ motor + stretch.T * self.damping @ stretch
        stiffness = stretch.T * self.stiffness @ stretch + load.T @ self.gravity @ load
        return inertia, damping + links.T * self.drag @ links, stiffness

    def angles(self) -> tuple[Array, Array]:
        """Return the angles of motors and loads (2 of (n, N)) by all coordinates."""
        n = len(self.elastic)
        motor = np.eye(n, n + int(np.sum(self.elastic)))
        # A stiff joint has one coordinate, which is both its motor's and its load's.
        load = motor.copy()
        load[self.elastic] = np.eye(len(motor.T))[n:]
        return motor, load

    def compliance(self, s: Any) -> Array:
        """Return A(s)^-1 (F, N, N) at complex frequencies s (F,) [rad/s]."""
        inertia, damping, stiffness = self.matrices()
        s = s[:, None, None]
        A = inertia * s**2 + damping * s + stiffness
        return np.asarray(safely(np.linalg.inv, A, what=_WHAT))

    def modes(self, *, held: bool) -> Array:
        """Return a mode of each elastic joint (m,) as its eigenvalue.

        Resonances are poles, with all motors free; antiresonances are zeros, with all motors
        `held`, and rotors have no part in them. A mode belongs to the joint whose spring has most
        of its energy.
        """
        motor, load = self.angles()
        kept = np.arange(len(motor) if held else 0, len(motor.T))
        m, c, k = (matrix[np.ix_(kept, kept)] for matrix in self.matrices())
        values, vectors = safely(np.linalg.eig, state_matrix(m, c, k), what=_WHAT)
        # one of each complex pair; an overdamped mode has two real values, of which none is one
        upper = np.flatnonzero(values.imag > 0)
        shapes = vectors[: len(kept), upper]
        stretch = (motor - load)[np.ix_(self.elastic, kept)] @ shapes
        energy = self.stiffness[self.elastic, None] * np.abs(stretch) ** 2
        # per kinetic energy, so that the lowest modes, with little of a spring's, count little
        energy /= np.maximum(np.diag(m) @ np.abs(shapes) ** 2, 1e-300)
        modes = np.full(len(energy), np.nan, dtype=complex)
        # One mode per joint, so that the sum of the energies in the joints' springs is largest.
        rows, columns = scipy.optimize.linear_sum_assignment(-energy)
        modes[rows] = values[upper[columns]]
        return modes


def state_matrix(inertia: Array, damping: Array, stiffness: Array) -> Array:
    """Return the first-order form (2N, 2N) of M q'' + C q' + K q = 0 with the state (q, q')."""
    nothing, unity = np.zeros_like(inertia), np.eye(len(inertia))
    inverse = safely(np.linalg.inv, inertia, what=_WHAT)
    return np.block([[nothing, unity], [-inverse @ stiffness, -inverse @ damping]])


def linearised(robot: Robot, posture: Array, joints: Sequence[int]) -> LinearJoints:
    """Return a robot with nominal values, linearised at a posture (n,) with other joints held.

    Drives that move several joints have their coordinates phi = C q: M and G become C^-T M C^-1.
    Springs and friction parallel to a drive act at its own joint, and are transformed likewise.
    Missing values are NaN.
    """
    check_constant_ratios(robot, "a linearised robot")
    still = np.zeros((1, robot.n))
    gravity, _, mass = torque_slopes(robot, posture[None], still, still)[:, 0]
    # q = C^-1 phi: the other drives are held, their columns are dropped, not eliminated.
    motion = safely(np.linalg.inv, robot.transmission, what="a transmission")[:, joints]
    every = [robot.drives[name] for name in robot.joint_names]
    # The slope of gravity is symmetric, that of a potential, but for rounding.
    gravity = 0.5 * (gravity + gravity.T) + np.diag(_values(every, "parallel_stiffness"))
    mass, gravity = (motion.T @ matrix @ motion for matrix in (mass, gravity))
    drives = [every[index] for index in joints]
    elastic = np.array([drive.is_elastic for drive in drives])
    ratio, radius = np.array([(total_ratio(x), x.load_radius) for x in drives]).T
    rotor = _values(drives, "motor_inertia", np.nan) * ratio**2
    return LinearJoints(
        elastic=elastic,
        inertia=np.where(elastic, rotor, 0.0),
        friction=_values(drives, "viscous_friction") * ratio**2,
        stiffness=np.where(elastic, _values(drives, "stiffness", np.nan) * radius**2, 0.0),
        damping=np.where(elastic, _values(drives, "spring_damping") * radius**2, 0.0),
        mass=mass + np.diag(np.where(elastic, 0.0, np.nan_to_num(rotor))),
        gravity=gravity,
        drag=_values(every, "joint_viscous_friction"),
        motion=motion,
        dry=_values(drives, "coulomb_friction") * ratio,
    )


def _values(drives: Sequence[Drive], name: str, missing: float = 0.0) -> Array:
    """Return a value of each drive."""
    return np.array([drive.values.get(name, missing) for drive in drives], dtype=float)


_POSITIVE = ("stiffness", "inertia")
"""Fields of which the parameters are logarithms, positive and with relative steps."""


@dataclass(frozen=True, eq=False)
class _Parameters:
    """The parameters of joints as a vector: the numbers that are `free` {field: mask}, in order.

    The others are those of `start`. Of a symmetric matrix the upper triangle is free.
    """

    start: LinearJoints
    free: Mapping[str, BoolArray]

    def vector(self, joints: LinearJoints) -> Array:
        """Return the vector of some joints."""
        parts = {name: getattr(joints, name)[mask] for name, mask in self.free.items()}
        return np.concatenate([np.log(x) if name in _POSITIVE else x for name, x in parts.items()])

    def parts(self, x: Array) -> dict[str, Array]:
        """Return the part of a vector for each field."""
        ends = np.cumsum([np.count_nonzero(mask) for mask in self.free.values()])
        return dict(zip(self.free, np.split(x, ends[:-1]), strict=True))

    def joints(self, x: Array) -> LinearJoints:
        """Return the joints of a vector."""
        fields = {}
        for name, part in self.parts(x).items():
            values = getattr(self.start, name).copy()
            # Clipped, so that a far trial step of the search does not overflow.
            positive = name in _POSITIVE
            values[self.free[name]] = np.exp(np.clip(part, -60, 60)) if positive else part
            is_matrix = values.ndim == 2
            fields[name] = np.triu(values) + np.triu(values, 1).T if is_matrix else values
        return replace(self.start, **fields)


def _slopes(function: Callable[[Array], Array], x: Array, steps: Array) -> Array:
    """Return the derivatives (R, p) of a function by parameters x (p,), by central differences."""
    slopes = [
        (function(x + change) - function(x - change)) / (2 * step)
        for change, step in zip(np.diag(steps), steps, strict=True)
    ]
    return np.stack(slopes, axis=1)


@dataclass(frozen=True, eq=False)
class Fit:
    """The linearised robot that fits spectra best, and the covariance of its parameters.

    `residual` is the root mean square of the weighted residual: 1 if the weights fit. `lack_of_fit`
    is the size of its errors over that of the part which motor angles do not explain.
    """

    parameters: _Parameters
    x: Array
    joints: LinearJoints
    covariance: Array
    residual: float
    lack_of_fit: float

    def estimate(self, place: int, drive: Drive) -> Estimate:
        """Return resonance, antiresonance and the numbers of one elastic joint, by its place."""

        def numbers(x: Array) -> Array:
            return np.array([*_numbers(self.parameters.joints(x), place, drive).values()])

        J = _slopes(numbers, self.x, 1e-5 * np.maximum(np.abs(self.x), 1e-3))  # the delta method
        covariance, names = J @ self.covariance @ J.T, _numbers(self.joints, place, drive)
        inertia = "kg m^2" if drive.joint_units[0] == "N m" else "kg"
        units = {"load_inertia": inertia, "gravity_stiffness": unit_of(drive, "parallel_stiffness")}
        for name in ("resonance", "antiresonance"):
            units |= {name: "Hz", f"{name}_damping": "1"}
        every = tuple(units.get(name) or unit_of(drive, name) for name in names)
        texts = ParameterName.all_of(names)
        return Estimate(texts, numbers(self.x), covariance, every, self.residual, math.nan)


def _numbers(joints: LinearJoints, place: int, drive: Drive) -> dict[str, float]:
    """Return the numbers of one elastic joint by their names."""
    mode, numbers = int(np.sum(joints.elastic[:place])), dict[str, float]()
    for name, held in (("resonance", False), ("antiresonance", True)):
        value = joints.modes(held=held)[mode]
        # the natural frequency [Hz] and the damping ratio of an eigenvalue
        numbers |= {name: abs(value) / (2 * np.pi), f"{name}_damping": -value.real / abs(value)}
    by_radius, by_ratio = drive.load_radius**2, total_ratio(drive) ** 2
    return numbers | {
        "stiffness": joints.stiffness[place] / by_radius,
        "spring_damping": joints.damping[place] / by_radius,
        "motor_inertia": joints.inertia[place] / by_ratio,
        "viscous_friction": joints.friction[place] / by_ratio,
        "load_inertia": joints.mass[place, place],
        "gravity_stiffness": joints.gravity[place, place],
    }


_STARTS = (1.0, 0.4, 2.5)
"""Factors on the stiffness at the start: the nominal one may be wrong."""

_SCAN = 8
"""Antiresonances, spread over the band, from which a search without a nominal stiffness starts."""

_AVERAGED = 40
"""Lines of all logs over which a power is averaged, at least: fewer make intervals too narrow."""

_LEAST_NOISE = 1e-4
"""Share of the errors that noise of the torque, and that of the angle, have at least."""

FITS = 1.15
"""Lack of fit below which a minimum is the right one. On random systems of two and three joints it
was 0.96 to 1.06 in right minima, with an exception, and 1.2 to 5 in wrong ones."""

_RANDOM_STARTS = 40
"""Starts with random antiresonances of coupled joints, if no other start ends in a good fit."""

_FRACTION_ROUNDS = 8
"""Linear fits with the weights of the one before, from which a search starts."""

_LIGHT = 0.02
"""Damping ratio of a spring at the start."""

_ROUNDS, _LEAST_ROUNDS = 20, 3
"""Rounds of weights and fit in which a start is refined, and those by which starts are compared."""

_ENDS, _ENDS_WITH_LINE = (0, 1, 2), (-1, 0, 1, 2)
"""Powers of s by which the ends of a record act on a motor: position and speed, one for what
sampling adds, and of a log without periods the line that is subtracted. On a load 0 and 1 act: its
others are combinations of these."""

_RIGID = 0.3
"""Share of the inertia that is the rotor's, where nothing is known."""


def fitted(spectra: Spectra, nominal: LinearJoints, robot: Robot, joints: Sequence[int]) -> Fit:
    """Return the maximum-likelihood fit of the linearised robot to the spectra of all logs.

    `nominal` is that of the `joints` of a robot, by their places.

    The motor angles are Y = H (U - F_C S + T) with the spectra of torque and sign of the speed, and
    what the ends of the record leave, a polynomial T of s (Pintelon and Schoukens 2012, section
    6.3.2). The residual is weighted by its own variance, averaged over near lines, so that noise
    and nonlinear distortion count as large as they are.
    """
    drives = [robot.drives[name] for name in robot.joint_names]
    viscous = np.array(["viscous" in drive.joint_friction for drive in drives])
    n, elastic = len(nominal.elastic), nominal.elastic
    upper = np.triu(np.ones((n, n), dtype=bool))
    free = {
        "stiffness": elastic,
        "inertia": elastic & ~np.isfinite(nominal.inertia),
        "damping": elastic,
        "friction": np.full(n, True),
        "drag": viscous & np.any(nominal.motion != 0, axis=1),
        "mass": upper,
        "gravity": upper,
        "dry": np.array([is_dry(drives[index]) for index in joints]),
    }
    parameters = _Parameters(replace(nominal, dry=np.zeros(n)), free)
    problem = _Problem(spectra, parameters)
    first, further = _starts(spectra, parameters)
    x, cost = min((problem.solved(x, _LEAST_ROUNDS) for x in first), key=lambda pair: pair[1])
    for start in further:
        if problem.lack_of_fit(x) < FITS:
            break
        tried = problem.solved(start, _LEAST_ROUNDS)
        x, cost = min((x, cost), tried, key=lambda pair: pair[1])
    return problem.fit(problem.solved(x, _ROUNDS)[0])


def refitted(spectra: Spectra, fit: Fit, *, are_rotors_free: bool = False) -> Fit:
    """Return the fit to spectra of the same joints, from where one ended.

    The inertias of all elastic joints' rotors may be free, known or not.
    """
    free = dict(fit.parameters.free)
    if are_rotors_free:
        free["inertia"] = fit.joints.elastic
    problem = _Problem(spectra, replace(fit.parameters, free=free))
    x = problem.parameters.vector(fit.joints)
    return problem.fit(problem.solved(x, _ROUNDS)[0])


def sticking_sign(record: Record, picked: Sequence[int], fit: Fit) -> Record:
    """Return a record with the dry friction of the fit while motors stick, over its level.

    At rest friction is what the torque leaves besides spring and rotor, at most its level:
    tau - I w' - F w - k (phi_M - phi), with the load angle phi that the linearised robot has. The
    fit thus does not rest on samples at standstill.
    """
    joints, dry = fit.joints, fit.joints.dry
    n, e = len(dry), np.flatnonzero(joints.elastic)
    fields = (record.torque, record.motor, record.sign)
    U, Y, S = (signal[..., picked].reshape(-1, n) for signal in fields)
    s = 2j * np.pi * np.fft.rfftfreq(len(U), record.step_s)
    force = np.fft.rfft(U - dry * S, axis=0)
    # A robot without gravity has no compliance at s = 0, where A(0) is singular.
    x = np.einsum("fij,fj->fi", joints.compliance(s[1:])[:, :, :n], force[1:])
    spring = np.zeros_like(force)
    spring[0] = force[0]  # the motor does not accelerate on average
    stretch = x @ np.subtract(*joints.angles())[e].T
    # the measured angle of the motor, in place of that of the model
    measured = np.fft.rfft(Y, axis=0)[1:, e] - x[:, e]
    spring[1:, e] = (joints.stiffness[e] + s[1:, None] * joints.damping[e]) * stretch
    spring[1:, e] += joints.stiffness[e] * measured
    speed, acceleration = motor_rates(Y)
    residual = U - np.fft.irfft(spring, len(U), axis=0)
    residual -= joints.inertia * acceleration / record.step_s**2
    residual -= joints.friction * speed / record.step_s
    sticks = joints.elastic & (dry > 0) & (np.abs(speed) < STICKS * np.std(speed, axis=0))
    sign = record.sign.copy()
    friction = np.clip(residual / np.where(dry > 0, dry, 1.0), -1.0, 1.0)
    sign[..., picked] = np.where(sticks, friction, S).reshape(sign[..., picked].shape)
    return replace(record, sign=sign)


def _starts(spectra: Spectra, parameters: _Parameters) -> tuple[list[Array], list[Array]]:
    """Return where searches start, by linear fits and nominal values, and where if none fits.

    A single joint without a nominal stiffness starts from a scan, coupled ones also at random.
    """
    nominal, e, free = parameters.start, parameters.start.elastic, parameters.free
    base = _with_rigid_values(spectra, nominal, free["dry"])
    level = 0.1 * np.sqrt(np.mean(np.abs(spectra.torque.mean(1)) ** 2, axis=(0, 1)))
    known = np.where(e, nominal.inertia, 0.0)
    rotors = [known] if np.all(np.isnan(known[e])) else [known, np.where(e, np.nan, 0.0)]
    first = [
        _possible(joints, base, free["inertia"], spectra.hz)
        for rotor in rotors
        for joints in _by_fractions(spectra, e, rotor, free["dry"])
    ]
    ends, coupled = np.log(spectra.hz[[0, -1]]), np.sum(e) > 1
    chances = np.random.default_rng(0).uniform(ends[0], ends[1], (_RANDOM_STARTS, len(e)))
    further = [_with_antiresonances(first[-1], np.exp(chance)) for chance in chances if coupled]
    if np.all(np.isfinite(nominal.stiffness)):
        first += [replace(base, stiffness=factor * nominal.stiffness) for factor in _STARTS]
    else:
        scan = np.geomspace(spectra.hz[0] * 2, spectra.hz[-1], _SCAN)
        same = [_with_antiresonances(base, hz) for hz in scan]
        first, further = (first, same + further) if coupled else (first + same, further)

    def vector(joints: LinearJoints) -> Array:
        return parameters.vector(replace(_lightly_damped(joints), dry=level))

    return list(map(vector, first)), list(map(vector, further))


def _with_rigid_values(spectra: Spectra, nominal: LinearJoints, dry: BoolArray) -> LinearJoints:
    """Return nominal joints with the friction, and what they lack, of a rigid robot.

    A robot with springs is nearly rigid at the lowest third of the lines.
    """
    n = len(dry)
    low = max(len(spectra.hz) // 3, min(len(spectra.hz), 3 * n))
    rigid = _by_fractions(spectra.up_to(low), np.full(n, False), np.zeros(n), dry)[0]
    whole = np.abs(np.diag(rigid.mass))
    inertia = np.where(np.isnan(nominal.inertia), _RIGID * whole, nominal.inertia)
    friction = np.maximum(rigid.friction, 0.0)
    joints = replace(nominal, inertia=inertia, friction=friction)
    if np.all(np.diag(nominal.mass) > 0):  # not NaN, nor links without a mass
        return joints
    mass, least = rigid.mass - np.diag(inertia), _RIGID * np.maximum(whole, inertia)
    mass = mass + np.diag(np.maximum(least - np.diag(mass), 0.0))
    return replace(joints, mass=mass, gravity=rigid.gravity)


def _with_antiresonances(joints: LinearJoints, hz: Array) -> LinearJoints:
    """Return joints whose loads alone, with a held motor, would swing at frequencies (n,)."""
    stiffness = np.diag(joints.mass) * (2 * np.pi * hz) ** 2
    return replace(joints, stiffness=np.where(joints.elastic, stiffness, 0.0))


def _lightly_damped(joints: LinearJoints) -> LinearJoints:
    """Return joints with damping, since an undamped zero on a line is no place to start from."""
    light = 2 * _LIGHT * np.sqrt(joints.stiffness * np.maximum(np.diag(joints.mass), 0.0))
    return replace(joints, damping=np.where(joints.damping > 0, joints.damping, light))


def _possible(
    joints: LinearJoints, base: LinearJoints, rotors: BoolArray, hz: Array
) -> LinearJoints:
    """Return estimated joints with what is not positive, and known rotors, taken from `base`.

    A stiffness that is not positive becomes that of an antiresonance in the middle of the band.
    """
    mass = joints.mass if safely(np.linalg.eigvalsh, joints.mass, what=_WHAT)[0] > 0 else base.mass
    middle = np.diag(mass) * (2 * np.pi) ** 2 * hz[0] * hz[-1]
    stiffness = np.where(joints.stiffness > 0, joints.stiffness, middle)
    return replace(
        base,
        stiffness=np.where(base.elastic, stiffness, 0.0),
        inertia=np.where(rotors & (joints.inertia > 0), joints.inertia, base.inertia),
        mass=mass,
        gravity=joints.gravity,
    )


def _by_fractions(
    spectra: Spectra, elastic: BoolArray, rotor: Array, dry: BoolArray
) -> list[LinearJoints]:
    """Return estimates of the joints by linear least squares, which need no start.

    Without spring damping the loads obey D tau = N phi_M, a fraction of polynomials of s with
    D = 1 + (M s^2 + G) / k and N = M s^2 + G + D (I s^2 + F s). Divided by 1 + G / k its rows are
    linear in the coefficients (Levy 1959), of which D_2 k = N_2 - I and D_2 I = N_4; with G << k
    N_2 - I and N_0 are M and G. Known rotors (NaN where not) are subtracted first. The first of
    the two has equal weights, the second those of the errors of both signals (Sanathanan and
    Koerner 1963).
    """
    U, Y, S = (signal.mean(1) for signal in (spectra.torque, spectra.motor, spectra.sign))
    logs, lines, n = U.shape
    # In units of the middle of the band, the powers of s up to 4 have similar sizes.
    unit = 2 * np.pi * math.sqrt(spectra.hz[0] * spectra.hz[-1])
    s = (2j * np.pi / unit * spectra.hz)[:, None]
    known, free = np.nan_to_num(rotor) * unit**2, elastic & np.isnan(rotor)
    T = U - known * s**2 * Y
    # the coefficients D_1, D_2, N_0 to N_4 of the joints' columns
    exist = np.array([elastic, elastic, *3 * [np.full(n, True)], elastic, free])
    signals = np.stack([-s * T, -(s**2) * T, *(s**power * Y for power in range(5))], axis=2)
    ends = np.kron(np.eye(logs), np.hstack([s**power for power in _ENDS]))
    # T = -(D_1 s + D_2 s^2) T + (N_0 + ... + N_4 s^4) Y + F_C S + ends, with D_0 = 1.
    columns = np.concatenate([signals[..., exist], S[..., dry]], axis=2)
    columns = np.hstack([columns.reshape(logs * lines, -1), ends])
    weights = np.tile(1 / np.sqrt(1 + np.abs(s) ** 4), n)
    coefficients, estimates = np.zeros((7, n, n)), []
    for count in range(_FRACTION_ROUNDS):
        for row in range(n):
            # Each row of the matrices is a fit of its own, and has all signals as columns.
            weight = np.tile(weights[:, row], logs)
            rows, goal = weight[:, None] * columns, weight * T[..., row].ravel()
            decomposition = scaled_svd(np.vstack([rows.real, rows.imag]), _WHAT)
            x = decomposition.solve(np.concatenate([goal.real, goal.imag]))
            coefficients[:, row][exist] = x[: np.sum(exist)]
            error = (T[..., row].ravel() - columns @ x).reshape(logs, -1)
            D = np.eye(n)[row] + s * coefficients[0, row] + s**2 * coefficients[1, row]
            N = sum(s**power * coefficients[2 + power, row] for power in range(5))
            weights[:, row] = _fraction_weight(error, D, N + D * known * s**2)
        if count in (0, _FRACTION_ROUNDS - 1):
            estimates.append(_joints_of_fraction(coefficients, unit, elastic, free))
    return estimates


def _fraction_weight(error: Array, D: Array, N: Array) -> Array:
    """Return the weights (L,) of a row with errors (E, L), by noise of torques and of angles."""
    by_torque, by_angle = (np.sum(np.abs(polynomial) ** 2, axis=1) for polynomial in (D, N))
    # error = D (noise of the torque) - N (noise of the angle): power a |D|^2 + b |N|^2.
    power = np.maximum(np.mean(np.abs(error) ** 2, axis=0), np.finfo(float).tiny)
    noise = _noise(power / by_torque, by_angle / by_torque)
    return np.asarray(1 / np.sqrt(noise[0] * by_torque + noise[1] * by_angle))


def _joints_of_fraction(
    coefficients: Array, unit: float, elastic: BoolArray, free: BoolArray
) -> LinearJoints:
    """Return what the coefficients (7, n, n) of a fraction in s / unit say of the joints."""
    n, e = len(elastic), np.flatnonzero(elastic)
    powers = np.array([2, 0, 1, 2, 4])[:, None, None]
    D2, N0, N1, N2, N4 = coefficients[[1, 2, 3, 4, 6]] / unit**powers
    inverse = safely(np.linalg.pinv, D2[:, e], what=_WHAT)
    inertia, stiffness = np.zeros((2, n))
    inertia[e] = np.diag(inverse @ N4[:, e])
    mass = N2 - np.diag(np.where(free, inertia, 0.0))
    stiffness[e] = np.diag(inverse @ mass[:, e])
    mass, gravity = (0.5 * (matrix + matrix.T) for matrix in (mass, N0))
    nothing = np.zeros(n)
    numbers = inertia, np.diag(N1), stiffness, nothing, mass, gravity, nothing
    return LinearJoints(elastic, *numbers, motion=np.eye(n), dry=nothing)


def _noise(error: Array, gain: Array) -> Array:
    """Return (a, b), the power of noise of torque and angle: a + b gain fits errors (L,).

    Iterated weights, since the scatter of a power is of its own size.
    """
    columns = np.column_stack([np.ones_like(gain), gain])
    shape = np.full_like(error, np.mean(error))
    noise = least = _LEAST_NOISE * np.mean(error) / np.array([1.0, np.mean(gain)])
    for _ in range(_LEAST_ROUNDS * 2):
        noise = np.maximum(scipy.optimize.nnls(columns / shape[:, None], error / shape)[0], least)
        shape = columns @ noise
    return np.asarray(noise)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Weighted residuals of the motor angles over all logs and lines."""

    spectra: Spectra
    parameters: _Parameters
    unity: Array = field(default_factory=lambda: np.array([1.0, 0.0])[:, None, None])
    """Noise (2, 1, 1) of torques alone, by which errors are torques."""

    @cached_property
    def s(self) -> Any:
        """The complex frequencies (L,) [rad/s]."""
        return 2j * np.pi * self.spectra.hz

    def errors(self, x: Array, noise: Array) -> Array:
        """Return the errors of the torques (E, L, n), less what the ends may explain.

        They are divided by their standard deviation, the root of a + b |A|^2 with `noise` (2, L, n)
        a and b of torques and angles and A = H^-1, as in the maximum-likelihood estimator with
        errors in both (Pintelon and Schoukens 2012, section 9.11).
        """
        H, weights = self.whitened(x, noise)
        dry = self.parameters.joints(x).dry
        force = self.spectra.torque.mean(1) - dry * self.spectra.sign.mean(1)
        angle = np.einsum("lij,elj->eli", H[:, :, : H.shape[1]], force)
        error = self.spectra.motor.mean(1) - angle
        error = np.einsum("lij,elj->eli", weights, error)
        Q = self.ends(H, weights)
        flat = error.reshape(len(error), -1)
        return np.asarray((flat - (flat @ Q.conj()).real @ Q.T).reshape(error.shape))

    def whitened(self, x: Array, noise: Array) -> tuple[Array, Array]:
        """Return the responses, and the weights (L, n, n) by which errors of angles are errors."""
        joints = self.parameters.joints(x)
        H = joints.compliance(self.s)[:, : len(joints.elastic)]
        A = safely(np.linalg.inv, H[:, :, : H.shape[1]], what=_WHAT)
        power = noise[0] + noise[1] * np.sum(np.abs(A) ** 2, axis=2)
        return H, A / np.sqrt(power)[:, :, None]

    def ends(self, H: Array, weights: Array) -> Array:
        """Return a basis (Ln, c) of what the ends of one log may do, times real factors.

        It is complex; its real and imaginary parts together are orthonormal.
        """
        n = H.shape[1]
        ends = weights @ H
        scale = np.abs(self.s[-1])
        powers = [(power, (self.s / scale)[:, None, None] ** power) for power in self.powers]
        parts = [ends[:, :, :n] * factor for _, factor in powers]
        parts += [ends[:, :, n:] * factor for power, factor in powers if power in (0, 1)]
        columns = np.concatenate(parts, axis=2)
        columns = columns.reshape(-1, columns.shape[2])
        real, imaginary = np.split(np.linalg.qr(np.vstack([columns.real, columns.imag]))[0], 2)
        return np.asarray(real + 1j * imaginary)

    def noise(self, x: Array) -> Array:
        """Return the noise (2, L, n) of torques and angles, a fit times the power of near lines."""
        E, _, L, n = self.spectra.torque.shape
        _, A = self.whitened(x, self.unity)
        error = np.mean(np.abs(self.errors(x, self.unity)) ** 2, axis=0)
        error = np.maximum(error, 1e-24 * np.mean(np.abs(self.spectra.torque) ** 2))
        gain = np.sum(np.abs(A) ** 2, axis=2)
        noise = np.array([_noise(error[:, i], gain[:, i]) for i in range(n)]).T[:, None]
        shape = noise[0] + noise[1] * gain
        # Real equations per degree of freedom, by which residuals are smaller than errors.
        share = 2 * E * L * n / max(self.spare, 1)
        return np.asarray(noise * share * self.averaged(error / shape))

    def averaged(self, power: Array) -> Array:
        """Return a power (L, n) averaged over near lines."""
        width = 2 * max(NEAR, math.ceil(_AVERAGED / (2 * len(self.spectra.motor)))) + 1
        return np.asarray(scipy.ndimage.uniform_filter1d(power, width, axis=0))

    @property
    def powers(self) -> tuple[int, ...]:
        """Powers of s by which the ends of a record act."""
        return _ENDS if self.spectra.is_periodic else _ENDS_WITH_LINE

    @property
    def spare(self) -> int:
        """Degrees of freedom: real equations less parameters and ends."""
        E, _, L, n = self.spectra.torque.shape
        ends = len(self.powers) * n + 2 * int(np.sum(self.parameters.start.elastic))
        free = sum(map(np.count_nonzero, self.parameters.free.values()))
        return int(2 * E * L * n - ends * E - free)

    def solved(self, x: Array, rounds: int) -> tuple[Array, float]:
        """Return the parameters and the cost, the logarithm of the residual torques."""
        for _ in range(rounds):
            solution = scipy.optimize.least_squares(
                self._real, x, args=(self.noise(x),), x_scale=self._scale(x), max_nfev=12
            )
            x, step = solution.x, np.max(np.abs(solution.x - x) / self._scale(x))
            if step < 1e-6:
                break
        H, weights = self.whitened(x, self.noise(x))
        by_torque = np.einsum("lij,ljk->lik", weights, H[:, :, : H.shape[1]])
        # weights H has the diagonal 1 / sqrt(power), and weighted residuals have size 1 by these
        # weights: what remains of -2 log-likelihood is the sum of log power.
        return x, -2 * float(np.sum(np.log(np.abs(np.einsum("lii->li", by_torque)))))

    def lack_of_fit(self, x: Array) -> float:
        """Return the errors of torques over those that a smooth response leaves of them.

        The error of a wrong model is a response to the motor angles, which among near lines is
        linear in the frequency (local polynomials: Pintelon and Schoukens 2012, section 7.2).
        """
        n, lines = self.spectra.torque.shape[-1], len(self.s)
        errors, Y = self.errors(x, self.unity), self.spectra.motor.mean(1)
        width = max(2 * NEAR + 1, math.ceil(4 * n / len(Y)))
        ratios = []
        for first in range(0, lines - width + 1, width):
            near = slice(first, first + width)
            slope = np.linspace(-1, 1, width)[:, None]
            columns = np.concatenate([Y[:, near], slope * Y[:, near]], 2).reshape(-1, 2 * n)
            goal = errors[:, near].reshape(-1, n)
            Q = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]
            rest = goal - Q @ (Q.conj().T @ goal)
            before, after = (np.sum(np.abs(error) ** 2, 0) for error in (goal, rest))
            # Degrees of freedom of the local fit with 2 n columns.
            share = len(goal) / (len(goal) - 2 * n)
            ratios.append(np.log(np.maximum(before, 1e-300) / np.maximum(share * after, 1e-300)))
        return float(np.exp(0.5 * np.mean(ratios))) if ratios else 1.0

    def _scale(self, x: Array) -> Array:
        """Return typical sizes of the parameters: of one kind the largest."""
        parts = self.parameters.parts(x).items()
        sizes = {k: 1.0 if k in _POSITIVE else np.max(np.abs(x), initial=1e-6) for k, x in parts}
        return np.concatenate([np.full(len(x), sizes[name]) for name, x in parts])

    def _real(self, x: Array, noise: Array) -> Array:
        error = self.errors(x, noise).ravel()
        return np.concatenate([error.real, error.imag])

    def fit(self, x: Array) -> Fit:
        """Return the fit with the covariance of its parameters."""
        noise, scale = self.noise(x), self._scale(x)
        # The weights, by `noise` at x, are held: they are no part of the derivative.
        J = _slopes(partial(self._real, noise=noise), x, 1e-6 * scale)
        inverse = scale[:, None] * safely(np.linalg.pinv, J * scale, what=_WHAT)
        errors = self.errors(x, noise)
        # the power of a line, of which the fit takes the share h, is |e|^2 / (1 - h), as in HC2
        # (MacKinnon and White 1985), averaged over near lines; real and imaginary parts have half
        Q = self.ends(*self.whitened(x, noise))
        by_fit = np.sum(np.linalg.qr(J)[0] ** 2, axis=1).reshape(2, *errors.shape).mean(axis=0)
        by_ends = 0.5 * np.sum(np.abs(Q) ** 2, axis=1).reshape(errors.shape[1:])
        remaining = np.maximum(1 - by_fit - by_ends, LEAST_LEFT)
        power = self.averaged(np.mean(np.abs(errors) ** 2 / remaining, axis=0))
        spread = np.broadcast_to(power, (2, *errors.shape)).ravel()
        covariance = 0.5 * (inverse * spread) @ inverse.T
        residual = float(np.sqrt(np.mean(np.abs(errors) ** 2)))
        if self.spare < 1:
            covariance = np.full_like(covariance, np.nan)  # fewer equations than unknowns
        joints = self.parameters.joints(x)
        return Fit(self.parameters, x, joints, covariance, residual, self.lack_of_fit(x))
