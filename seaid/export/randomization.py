"""write_randomization: ranges and samples of the identified robot, for domain randomization.

What the log determines is drawn from the covariance of the estimate, and what it leaves free from a
prior around the identified robot. A body is A (1 + X) (1 + X)^T A^T, with the pseudo-inertia A A^T
and a lower triangle X: physically consistent for any X, and X + X^T are relative changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import compress
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ndtri, stdtrit

from seaid._arrays import Array, safely
from seaid._files import write_json
from seaid._progress import Display
from seaid.drives import ParameterName, total_ratio, unit_of
from seaid.drives.terms import parameter_named
from seaid.errors import Least, RobotError, Seed, checked, shortened
from seaid.export.joint_actuators import SLIDING_UNITS
from seaid.identification import Identification
from seaid.robot import PARAMETERS
from seaid.robot.inertia import THIN, from_pseudo_inertia, pseudo_inertia, second_moments

FORMAT = "seaid randomization 1"

_DRAWS = 500
"""Draws of the bodies from which ranges are computed: quantiles are then good to 0.1 deviations."""

_STEPS, _CLOSE = 20, 0.02
"""Gauss-Newton steps of a sample, and the distance in standard errors at which they end."""

_LEAST = 1e-10
"""Least eigenvalue of a correlation matrix, which rounding may make negative."""

_DETERMINED = 0.5
"""A log determines a parameter if it at least halves the standard deviation of the prior."""

_UNITS = ("kg", *("m",) * 3, *("kg m^2",) * 6)
"""Units of the mass, of the centre of mass, and of the inertia about it, as in `_BODY`."""

_BODY = ("mass", "com_x", "com_y", "com_z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""What simulators have of a body: its inertia is at the centre of mass, in the body's axes."""

_AT_JOINT = {
    "motor_inertia": ("armature", 2, "kg m^2"),
    "viscous_friction": ("viscous_friction", 2, "N m s/rad"),
    "coulomb_friction": ("dry_friction", 1, "N m"),
    "friction_offset": ("friction_offset", 1, "N m"),
}
"""{parameter of a motor: (its name at the joint, power of the ratio in it, unit at the joint)}."""


@dataclass(frozen=True)
class Range:
    """The range of one parameter of a joint or body, and where it comes from.

    `source` is "data", "prior" (not determined by the log, therefore as wide as the prior) or
    "given" (known, without a range). `why` says why a parameter is not determined.
    """

    name: str
    of: str
    unit: str
    nominal: float
    low: float
    high: float
    source: str
    why: str = ""


@dataclass(frozen=True, repr=False)
class Randomization(Display):
    """Ranges and correlated samples of a robot.

    Attributes
    ----------
    path : Path
        The file.
    ranges : tuple of Range
        The parameters of the joints and bodies, at the joint and at the centre of mass.
    samples : ndarray (samples, parameters)
        Values of all parameters in the order of `ranges`: each row is one physically consistent
        robot.
    """

    path: Path
    ranges: tuple[Range, ...]
    samples: Array

    @property
    def unidentified(self) -> tuple[Range, ...]:
        """The parameters that the log does not determine."""
        return tuple(parameter for parameter in self.ranges if parameter.source == "prior")


@checked(RobotError)
def write_randomization(
    result: Identification,
    path: str | Path,
    *,
    level: float = 0.95,
    samples: Annotated[int, Least(0)] = 100,
    spread: float = 0.1,
    seed: Seed = 0,
) -> Randomization:
    """Write ranges and samples of an identified robot, for domain randomization.

    Samples are correlated as the estimate is: armature and delay of one log move together. Every
    sample is physically consistent, with friction and armature that are not negative.

    Parameters
    ----------
    result : Identification
        The result of `identify` with feasible=True.
    path : path
        The file, .json.
    level : float
        Probability of the ranges.
    samples : int
        Number of samples in the file.
    spread : float
        Relative standard deviation of what the log does not determine.
    seed : int
        Of the random numbers.

    Returns
    -------
    Randomization
        Its `unidentified` parameters are as wide as `spread`, and say why.

    Raises
    ------
    RobotError
        For wrong options, and for bodies that are physically inconsistent.
    SeaidError
        If the file cannot be written.

    Examples
    --------
    >>> result = seaid.identify(robot, log, feasible=True)
    >>> for parameter in seaid.export.write_randomization(result, "ranges.json").unidentified:
    ...     print(parameter.name, parameter.of, parameter.nominal, parameter.why)
    """
    path = Path(path)
    _check(path, level, spread)
    cloud = _Cloud(result, level, spread)
    random = np.random.default_rng(seed)
    # Ranges of bodies are quantiles, and need many draws even if the file has few samples.
    draws = [cloud.draw(random) for _ in range(max(samples, _DRAWS if len(cloud.bodies) else 0))]
    values = np.array(draws).reshape(len(draws), -1)
    made = Randomization(path, cloud.ranges(values), values[:samples])
    content = {
        "format": FORMAT,
        "robot": result.robot.name,
        "level": level,
        "spread": spread,
        "seed": seed,
        "parameters": made.ranges,
        "unidentified": [f"{r.name} of {r.of}: {r.why}" for r in made.unidentified],
        "samples": made.samples,
    }
    write_json(path, content)
    return made


def _check(path: Path, level: float, spread: float) -> None:
    """Raise RobotError for options that have no meaning."""
    if path.suffix.lower() != ".json":
        raise RobotError(f"'{path}' must end in .json")
    if not 0 < level < 1:
        raise RobotError(f"level= must be between 0 and 1, found {level}", "level=")
    if not 0 < spread <= 1:
        raise RobotError(f"spread= must be above 0 and at most 1, found {spread}", "spread=")


def _triangles() -> Array:
    """Return a basis (10, 4, 4) of lower triangles X, so that X + X^T is alike in all directions.

    With independent normal coefficients X + X^T is then an orthogonally invariant random matrix,
    with the deviation of a coefficient on its diagonal.
    """
    basis = np.zeros((10, 4, 4))
    for place, (row, column) in enumerate((i, j) for i in range(4) for j in range(i + 1)):
        basis[place, row, column] = 0.5 if row == column else 0.5**0.5
    return basis


_BASIS = _triangles()
_TEN = np.array([from_pseudo_inertia(unit) for unit in np.eye(16).reshape(16, 4, 4)]).T
"""The linear map (10, 16) from a pseudo-inertia, row by row, to the ten parameters."""


class _Cloud:
    """The distribution of an identified robot.

    Unknowns are the ten coefficients of X for each body that is not known, and the logarithms of
    parameters of drives that only combinations have (absorbed ones). Rows are what was estimated:
    p combinations, then parameters of drives.

    - `theta` (n, 10), `center` (p,): parameters of bodies and combinations of the robot as exported
    - `roots` (bodies, 4, 4): A of each unknown body, with the pseudo-inertia A A^T
    - `absorbed`, `start`: names of absorbed parameters, and the logarithms of their values
    - `absorption` (rows, absorbed): the combinations per absorbed parameter
    - `drives`, `values`: names and values of the rows after the combinations
    - `errors` (rows,), `covariance_root` (rows, rows): their deviations, and a root of C
    - `W` (rows, p): whitening of the combinations; `following`: C_db C_bb^-1, by which the other
      drives follow the combinations
    """

    def __init__(self, result: Identification, level: float, spread: float) -> None:
        self.result, self.level, self.spread = result, level, spread
        self.robot, model = result.robot, result.model
        self.theta = self.robot.parameters.reshape(-1, 10)
        known = self.robot.is_known.reshape(-1, 10).all(axis=1)
        self.bodies = [int(body) for body in np.flatnonzero(~known)]
        self.roots = np.array([self._root(body) for body in self.bodies]).reshape(-1, 4, 4)
        values = {joint: drive.values for joint, drive in self.robot.drives.items()}
        positive = [values[joint].get(name, 0.0) > 0 for joint, name, _ in model.absorbed]
        self.absorbed = [(joint, name) for joint, name, _ in compress(model.absorbed, positive)]
        self.start = np.log(np.array([values[joint][name] for joint, name in self.absorbed]))
        self.count = 10 * len(self.bodies) + len(self.absorbed)
        self._assemble()
        self.absorption = np.zeros((len(self.errors), len(self.absorbed)))
        self.absorption[: len(model.absorption)] = model.absorption[:, positive]
        self.values = np.array(
            [values[key.owner].get(key.quantity, 0.0) for key in self.drives], dtype=float
        )
        # The combinations of the robot as exported. With feasible=True they can differ from the
        # estimate; samples vary about the robot, by the covariance of the estimate.
        self.center = self._combinations(np.zeros(self.count))

    def _root(self, body: int) -> Array:
        """Return A with A A^T the pseudo-inertia of a body; a thin one gets a least thickness."""
        pseudo = pseudo_inertia(self.theta[body])
        values, vectors = safely(
            np.linalg.eigh, pseudo, what="the inertia of a body", error=RobotError
        )
        if values[0] < -THIN * values[-1] or values[-1] <= 0:
            raise RobotError(
                f"body '{self.robot.body_names[body]}' is physically inconsistent: identify with "
                "feasible=True",
                "feasible=True",
            )
        # A (1 + X) reaches no dimension in which A is flat: each sample would be as thin.
        return np.asarray(vectors * np.sqrt(np.maximum(values, THIN * values[-1])))

    def _assemble(self) -> None:
        """Collect names and covariance of what was estimated: p combinations, then drives."""
        result, model = self.result, self.result.model
        side = result.load_side
        # Drive parameters of stiff joints are estimated with the load, correlated with the
        # combinations; those of actuator sides are separate regressions, each a block of its own.
        drives = [ParameterName(name, joint) for joint, name, _ in model.drives]
        rows = [side.names.index(name) for name in (*model.expressions, *drives)]
        blocks = [side.covariance[np.ix_(rows, rows)]]
        wider = [self._wider(side)[rows]]
        for joint, e in result.drives.items():
            alone = [at for at, x in enumerate(e.names) if ParameterName(x, joint) not in drives]
            drives += [ParameterName(e.names[at], joint) for at in alone]
            blocks.append(e.covariance[np.ix_(alone, alone)])
            wider.append(self._wider(e)[alone])
        self.drives, self.p = drives, len(model.expressions)
        covariance = block_diag(*blocks) * np.outer(np.concatenate(wider), np.concatenate(wider))
        self.errors = np.sqrt(np.diag(covariance))
        # Eigenvalues of the correlation matrix, because kg, kg m^2 and N/m differ by orders of
        # magnitude and those of the covariance would drown the small ones.
        scale = np.where(self.errors > 0, self.errors, 1.0)
        values, vectors = safely(
            np.linalg.eigh,
            covariance / np.outer(scale, scale),
            what="the covariance",
            error=RobotError,
        )
        # With C = root root^T, root times independent normal numbers has the covariance C.
        root = vectors * np.sqrt(np.maximum(values, _LEAST))
        self.covariance_root, p = scale[:, None] * root, self.p
        # With the pseudoinverse W of the p rows of combinations |W r|^2 = r^T C_bb^-1 r, and
        # C_db C_bb^-1 is the rows of the other drives times W.
        W = safely(np.linalg.pinv, root[:p], what="the covariance", error=RobotError)
        self.W = W / scale[:p]
        self.following = self.covariance_root[p:] @ self.W

    def _wider(self, estimate: Any) -> Array:
        """Return the ratio of Student's t to the normal quantile at the level."""
        freedom = estimate.degrees_of_freedom
        if freedom is None:
            return np.ones(len(estimate.names))
        at = 0.5 + self.level / 2
        return np.asarray(stdtrit(freedom, at) / ndtri(at))

    def _factors(self, x: Array) -> Array:
        """Return A (1 + X) of each unknown body."""
        X = np.tensordot(x[: 10 * len(self.bodies)].reshape(-1, 10), _BASIS, axes=1)
        return np.asarray(self.roots @ (np.eye(4) + X))

    def _bodies(self, x: Array) -> Array:
        """Return the standard parameters (n, 10) of unknowns x, P = A (1 + X) (1 + X)^T A^T."""
        theta, F = self.theta.copy(), self._factors(x)
        theta[self.bodies] = (F @ F.transpose(0, 2, 1)).reshape(-1, 16) @ _TEN.T
        return theta

    def _body_slopes(self, x: Array) -> Array:
        """Return the slopes (bodies, 10, 10) of standard parameters: A (dX (1 + X)^T + ...) A^T."""
        # d(F F^T) = dF F^T + (dF F^T)^T with F = A (1 + X) and dF = A dX: `moved` is dF F^T by
        # coefficient k.
        moved = np.einsum("bij,kjl,bml->bkim", self.roots, _BASIS, self._factors(x))
        return np.asarray(
            ((moved + moved.transpose(0, 1, 3, 2)).reshape(-1, 10, 16) @ _TEN.T).transpose(0, 2, 1)
        )

    def _absorbed(self, x: Array) -> Array:
        """Return the parameters of drives that only combinations have."""
        return np.asarray(np.exp(self.start + x[10 * len(self.bodies) :]))

    def _combinations(self, x: Array) -> Array:
        """Return the combinations (p,) of bodies and absorbed parameters."""
        bodies: Array = self.result.base.grouping @ self._bodies(x).ravel()
        return bodies + self.absorption[: self.p] @ self._absorbed(x)

    def _slopes(self, x: Array) -> Array:
        """Return the slopes (p, unknowns) of the combinations."""
        # (p, 10 N) -> (p, bodies, 10): columns of known bodies have no unknowns.
        grouping = self.result.base.grouping.reshape(self.p, -1, 10)[:, self.bodies]
        bodies = np.einsum("pbi,bik->pbk", grouping, self._body_slopes(x)).reshape(self.p, -1)
        # d exp(u)/du = exp(u): the slope of a parameter by its logarithm is the parameter itself.
        return np.asarray(np.hstack([bodies, self.absorption[: self.p] * self._absorbed(x)]))

    def _step(self, x: Array, combinations: Array, prior: Array) -> Array:
        """Return the step of least squares towards changes of combinations and of the prior."""
        # min |W (J dx - combinations)|^2 + |dx - prior|^2 / spread^2: unknowns are relative
        # changes, so the prior's covariance is spread^2 times the unit matrix.
        A = np.vstack([self.W @ self._slopes(x), np.eye(self.count) / self.spread])
        b = np.concatenate([self.W @ combinations, prior / self.spread])
        step, *_ = safely(np.linalg.lstsq, A, b, what="a sample", error=RobotError, rcond=None)
        return np.asarray(step)

    def draw(self, random: np.random.Generator) -> Array:
        """Return the parameters of one sample.

        The log and the prior are drawn anew, and x is the least squares solution for both: a draw
        from the posterior of the linearised model (randomize-then-optimize, Bardsley et al. 2014).
        Its combinations are then those of the bodies themselves: Gauss-Newton steps from there.
        """
        estimate_error = self.covariance_root @ random.normal(size=len(self.errors))
        prior_draw = self.spread * random.normal(size=self.count)
        origin, nothing = np.zeros(self.count), np.zeros(self.count)
        x = self._step(origin, estimate_error[: self.p], prior_draw)
        # The draw is that of the linear model, and F F^T is quadratic in x: smallest further steps
        # until the combinations of the bodies are the drawn ones.
        change = self._slopes(origin) @ x
        for _ in range(_STEPS):
            rest = self.center + change - self._combinations(x)
            if np.max(np.abs(self.W @ rest), initial=0.0) < _CLOSE:
                break
            step = self._step(x, rest, nothing)
            # At most 100 % per step, which is as far as the slopes can be trusted.
            x = x + step / max(1.0, float(np.max(np.abs(step), initial=0.0)))
        # The prior moved the combinations from what the log had drawn. Drive parameters follow by
        # their regression on them: d + C_db C_bb^-1 (change).
        of_combinations, of_drives = np.split(estimate_error, [self.p])
        return self._sample(x, of_drives + self.following @ (change - of_combinations))

    def _sample(self, x: Array, change: Array) -> Array:
        """Return the values of all parameters of the file, those of drives first."""
        absorbed = self._absorbed(x)
        # A row of a drive is a combination too: it has the drive's parameter plus absorbed ones.
        shift = self.absorption[self.p :] @ (absorbed - np.exp(self.start))
        values = dict(zip(self.drives, self.values + change - shift, strict=True))
        values |= {
            ParameterName(name, joint): float(value)
            for (joint, name), value in zip(self.absorbed, absorbed, strict=True)
        }
        # What was neither estimated nor absorbed is known, and the same in each sample.
        drives = [factor * values.get(name, nominal) for name, factor, nominal in self._drive_rows]
        least = [self._least_value(name) for name, _, _ in self._drive_rows]
        theta = self._bodies(x)
        bodies = [_at_center(theta[body]) for body in self.bodies]
        return np.concatenate([np.maximum(drives, least), *bodies])

    def _least_value(self, name: ParameterName) -> float:
        return 0.0 if parameter_named(name.quantity).is_positive else -math.inf

    @cached_property
    def _drive_rows(self) -> list[tuple[ParameterName, float, float]]:
        """The parameters of drives: name, factor to the joint, value of the robot."""
        rows = []
        for joint, drive in self.robot.drives.items():
            for name in drive.parameter_names:
                # Zeros of the encoders of these logs are no property of the robot.
                if name in drive.values and name not in ("spring_offset", "deflection_zero"):
                    power = _AT_JOINT[name][1] if name in _AT_JOINT else 0
                    factor = total_ratio(drive) ** power
                    rows.append((ParameterName(name, joint), factor, drive.values[name]))
        return rows

    def ranges(self, draws: Array) -> tuple[Range, ...]:
        """Return the ranges of all parameters: of drives by their errors, of bodies by draws."""
        tail = 0.5 - self.level / 2
        ranges = [self._drive_range(*row, draws[:, at]) for at, row in enumerate(self._drive_rows)]
        start = len(ranges)
        for place, body in enumerate(self.bodies):
            drawn = draws[:, start + 10 * place : start + 10 * place + 10]
            low, high = np.quantile(drawn, [tail, 1 - tail], axis=0)
            nominal, name = _at_center(self.theta[body]), self.robot.body_names[body]
            for k in range(10):
                source, why = self._body_source(place, k)
                limits = float(low[k]), float(high[k])
                ranges.append(
                    Range(_BODY[k], name, _UNITS[k], float(nominal[k]), *limits, source, why)
                )
        return tuple(ranges)

    def _drive_range(self, name: ParameterName, factor: float, value: float, draws: Array) -> Range:
        drive = self.robot.drives[name.owner]
        shown, unit = name.quantity, unit_of(drive, name.quantity)
        if shown in _AT_JOINT:
            shown, _, unit = _AT_JOINT[shown]
            slides = self.robot.is_prismatic[self.robot.index(name.owner)]
            unit = SLIDING_UNITS[unit] if slides else unit
        nominal = low = high = factor * value
        source, why = "given", "was given"
        tail = 0.5 - self.level / 2
        if name in self.drives:
            at = self.drives.index(name)
            error = float(self.errors[self.p + at])
            # `errors` are widened by t over normal: the normal quantile gives Student's interval.
            half_width = -float(ndtri(tail)) * error
            least = self._least_value(name)
            low, high = (max(factor * (value + x), least) for x in (-half_width, half_width))
            source, why = "data", ""
            if error > abs(value):
                why = f"its standard error, {factor * error:.3g} {unit}, is larger than its value"
        elif (name.owner, name.quantity) in self.absorbed:
            low, high = (float(x) for x in np.quantile(draws, [tail, 1 - tail]))
            source, why = "prior", "only its sum with inertias of bodies is determined"
        return Range(shown, name.owner, unit, nominal, low, high, source, why)

    @cached_property
    def _posterior_over_prior(self) -> Array:
        """Deviations of the standard parameters (bodies, 10) over those of the prior."""
        x = np.zeros(self.count)
        whitened = self.W @ self._slopes(x)
        # C_x = (J^T W^T W J + 1/spread^2)^-1 of the linearised model; the prior's is spread^2.
        information = whitened.T @ whitened + np.eye(self.count) / self.spread**2
        covariance = safely(np.linalg.inv, information, what="the samples", error=RobotError)
        ratios = []
        for place, J in enumerate(self._body_slopes(x)):
            block = slice(10 * place, 10 * place + 10)
            by_both = np.einsum("ik,kl,il->i", J, covariance[block, block], J)
            by_prior = self.spread**2 * np.sum(J**2, axis=1)
            ratios.append(np.sqrt(by_both / np.maximum(by_prior, 1e-300)))
        return np.array(ratios)

    def _body_source(self, place: int, k: int) -> tuple[str, str]:
        """Return the source of a parameter of a body, and why the log does not determine it."""
        if self._posterior_over_prior[place, k] < _DETERMINED:
            return "data", ""
        base, column = self.result.base, 10 * self.bodies[place] + k
        # A zero column is an unidentifiable parameter; a row with one entry has it individually.
        in_rows = np.flatnonzero(np.abs(base.grouping[:, column]) > 1e-12)
        if not len(in_rows):
            return "prior", f"no torque of this robot depends on {PARAMETERS[k]} of this body"
        alone = np.count_nonzero(np.abs(base.grouping[in_rows]) > 1e-12, axis=1) == 1
        if np.any(alone):
            return "prior", "the motion excites it too little: its standard error is too large"
        return "prior", f"only in combination: {shortened(base.expressions[int(in_rows[0])])}"


def _at_center(ten: Array) -> Array:
    """Return mass, centre of mass and inertia there of ten standard parameters."""
    # The pseudo-inertia about the centre of mass, whose first moments are zero.
    about_center = block_diag(second_moments(ten), ten[0])
    return np.concatenate([ten[:1], ten[1:4] / ten[0], from_pseudo_inertia(about_center)[4:]])
