"""The result of an identification: the robot with its values, what they rest on, and how far."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, singledispatch
from typing import Any, Literal

import numpy as np

from seaid._arrays import Array, BoolArray, FrozenMapping
from seaid._progress import Display, Result, counted, sampled_text
from seaid.checks import JointCheck, JointFit, Verdict
from seaid.checks.codes import consequences, merged, that_matter
from seaid.checks.tolerances import SURE
from seaid.checks.verdict import verdict_of
from seaid.errors import Finding, by_severity
from seaid.estimation import Estimate, FittedRows, SharedParameter
from seaid.estimation.estimate import ModelChecks
from seaid.estimation.fitting import EstimatorName
from seaid.identification.consistency import FeasibleParameters
from seaid.identification.datasets import Dataset
from seaid.identification.drive_estimates import with_values
from seaid.identification.gear import own_estimates
from seaid.identification.stacked_fits import RobotEstimate, SensorErrors
from seaid.log import Log, Motion, Processing
from seaid.regressor import BaseParameters
from seaid.regressor.base import torque_slopes
from seaid.regressor.load import LoadModel
from seaid.robot import Robot

_FAR_M = 1e4
"""Distance of a centre of mass from which a body has no mass but for rounding."""


NUMBERS = (
    "rms_error",
    "relative_error",
    "relative_error_with_standstill",
    "raw_relative_error",
    "r_squared",
    "counted_share",
)
"""Fields of a Fit that tables and files contain."""


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Display):
    """Measured and computed torque (T, n) below the cutoff, and error measures (n,).

    Both torques are NaN in the filter transients at the ends. The samples that count are those from
    which parameters are identified, too: not those at which a motor with dry friction stands, since
    the model has no torque there, only one anywhere within Coulomb friction. `counted_share` is
    their share.

    `rms_error` is in the unit of the torque; `relative_error` is the norm of the error over that of
    the signal; `relative_error_with_standstill` the same with the samples at standstill;
    `raw_relative_error` as `relative_error`, without the low pass; `r_squared` is one minus the
    variance of the error over that of the signal. NaN for a joint without such an equation, and,
    but for the one with standstill, for a motor that never moves.

    Attributes
    ----------
    measured, computed : array (T, n)
    counted : bool array (T, n)
    rms_error, relative_error, r_squared, raw_relative_error : array (n,)
    relative_error_with_standstill, counted_share : array (n,)
    """

    measured: Array
    computed: Array
    counted: BoolArray
    rms_error: Array
    relative_error: Array
    r_squared: Array
    raw_relative_error: Array
    relative_error_with_standstill: Array
    counted_share: Array

    def to_dict(self, names: Iterable[str]) -> dict[str, dict[str, float | None]]:
        """Return the `NUMBERS` of each column by its name, null where there is no equation."""
        return {
            column: {name: _number(getattr(self, name)[index]) for name in NUMBERS}
            for index, column in enumerate(names)
        }

    @property
    def whole_relative_error(self) -> float:
        """The norm of the errors of all joints over that of their torques."""
        size = float(np.linalg.norm(self.measured[self.counted]))
        error = float(np.linalg.norm((self.measured - self.computed)[self.counted]))
        return error / size if size > 0 else float("nan")


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


@dataclass(frozen=True, eq=False, repr=False)
class Validation(Result):
    """Predicted torques of a log, `actuator` (motor torque of elastic joints) and `load` side.

    Attributes
    ----------
    joints : tuple of n str
        The n joints.
    time : ndarray (T,)
        Time [s].
    cutoff_hz : float
        Cutoff of the comparison.
    actuator, load : Fit
        Torques and error measures of both sides.
    motions : tuple of Motion
        The motions of the log, several if it has gaps in time: for figures over the motion, and to
        predict the same torques with other values.
    warnings : tuple of Finding
        Joints whose torque the model does not predict here, though it explains the own logs better.
    """

    table_name = "validation_table"

    joints: tuple[str, ...]
    time: Array
    cutoff_hz: float
    actuator: Fit
    load: Fit
    motions: tuple[Motion, ...] = ()
    warnings: tuple[Finding, ...] = ()

    def _in_short(self) -> str:
        sides = {"motor": self.actuator.relative_error, "load": self.load.relative_error}
        known = {side: errors[np.isfinite(errors)] for side, errors in sides.items()}
        texts = [f"{100 * x.max():.2g} % ({side} torque)" for side, x in known.items() if len(x)]
        errors = ", ".join(texts)
        return f"{sampled_text(self.time, self.joints)}: relative error at most {errors}"

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `parameters.json`, null for a joint without such an equation."""
        sides = {"actuator": self.actuator, "load": self.load}
        return {side: fit.to_dict(self.joints) for side, fit in sides.items()}


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """The parameters of a robot identified from one log or several.

    Attributes
    ----------
    drive_side : mapping {joint: Estimate}
        The parameters of each drive as in its equations: a stiffness is that between the encoders.
    load : Estimate
        The base parameters, whose definitions are in `base`.
    robot : Robot
        The robot with the identified values. Its standard parameters are those nearest to the robot
        file that have the estimated base parameters; physically consistent ones if `feasible` is
        set.
    known : Robot
        The input robot, with values for the parameters in which its drive equations are nonlinear.
    model, load_side : LoadModel, Estimate
        The columns of the load side (8) and their whole estimate.
    springs : mapping {joint: ndarray}
        Parameters of the springs whose torque is that on the load.
    cutoff_hz : float
        Cutoff of the low pass.
    excluded, checks : mapping
        Number of instants near standstill, and checks of the model, by joint and "load" for the
        load side ("both" if both sides were estimated at once).
    feasible : FeasibleParameters or None
        How the physically consistent parameters were computed.
    gears : mapping {joint: Estimate}
        Stiffness, hysteresis and encoder offset of the gears, where the deflection of the spring
        was measured.
    processing, motions : tuple
        Processing of each log; motions of the logs in memory, for `compared`.
    findings : tuple of Finding
        Findings about the set-up, the fit of the whole robot, and its values.
    joint_fits : mapping {joint: JointFit}
        How much of the torque of each joint the model explains.
    residual : tuple of 2 floats
        Of a floating base, the norm of the residual of all joints over that of their torques
        without contact forces: in the own logs, and in blocks of them excluded from the fit.
    exact_constants : mapping {constant: float}
        Constants that were taken as exact, by their names in `known_std`, with typical tolerances.
    known_std : mapping {constant: float}
        Relative standard deviations of known constants that are in the standard errors.
    setup : mapping {joint: JointCheck}
        What the logs say of the set-up: gear ratios between encoders, delays of torques.
    nominal : Robot or None
        `known` without the values of the search: the nominal ones of the input robot only.
    not_shared : str
        Why both sides were not estimated at once; "" where they were, or where the method was
        chosen.
    estimator : str
        The `estimator=` of `identify`, or "output-error" after a refinement by simulation.
    shared : tuple of SharedParameter
        The parameters that the drives of a group share, with tests of whether they differ.
    """

    table_name = "identification_table"

    drive_side: Mapping[str, Estimate]
    load: Estimate
    base: BaseParameters
    robot: Robot
    known: Robot
    model: LoadModel
    load_side: Estimate
    springs: Mapping[str, Array]
    cutoff_hz: float
    excluded: Mapping[str, int]
    checks: Mapping[str, ModelChecks]
    feasible: FeasibleParameters | None = None
    gears: Mapping[str, Estimate] = field(default_factory=dict)
    processing: tuple[Processing, ...] = ()
    motions: tuple[Motion, ...] = ()
    findings: tuple[Finding, ...] = ()
    joint_fits: Mapping[str, JointFit] = field(default_factory=dict)
    residual: tuple[float, float] = (float("nan"), float("nan"))
    exact_constants: Mapping[str, float] = field(default_factory=dict)
    known_std: Mapping[str, float] = field(default_factory=lambda: FrozenMapping({}))
    setup: Mapping[str, JointCheck] = field(default_factory=dict)
    nominal: Robot | None = None
    not_shared: str = ""
    estimator: EstimatorName | Literal["output-error"] = "wls"
    shared: tuple[SharedParameter, ...] = ()

    def _in_short(self) -> str:
        drives = counted(len(self.drives), "drive")
        warnings = counted(len(self.warnings), "warning")
        sizes = f"{drives}, {counted(len(self.load.names), 'base parameter')}"
        return f"'{self.robot.name}': {sizes}, cutoff {self.cutoff_hz:.3g} Hz, {warnings}"

    @property
    def method(self) -> Literal["two-step", "simultaneous"]:
        """The method of the estimate: "two-step" or "simultaneous"."""
        return "simultaneous" if "both" in self.checks else "two-step"

    @cached_property
    def drives(self) -> Mapping[str, Estimate]:
        """The parameters of each drive, with the spring's own stiffness if the gear's is known."""
        return own_estimates(self.known.drives, self.drive_side, self.gears)

    @cached_property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings about the experiment, the data and the values, the worst first.

        Those of one code at many joints are one.
        """
        return merged(self.weighed_findings)

    @cached_property
    def weighed_findings(self) -> tuple[Finding, ...]:
        """The findings of each joint, as severe as they are next to all others, the worst first."""
        exact = [joint for joint, fit in self.joint_fits.items() if fit.is_exact]
        return by_severity(that_matter(self.findings, exact))

    @cached_property
    def unusable_joints(self) -> Mapping[str, str]:
        """Joints of a fixed base that no simulation should have, each with the reason.

        Their torque was not used, or their rotor inertia is negative, and not only uncertain.
        """
        if not self.robot.base_is_held:
            return {}
        unused = set(self.robot.joint_names) - set(self.model.torque_joints)
        stands = "it stands still in all logs"
        reasons = {
            joint: stands if joint in self.known.at_rest else "its torque was not used"
            for joint in self.robot.joint_names
            if joint in unused
        }
        return FrozenMapping({**reasons, **negative_inertias(self.robot, self.drives)}, "joint")

    @cached_property
    def verdict(self) -> Verdict:
        """Whether to use the result, by its warnings."""
        return verdict_of(self.weighed_findings, self.joint_fits)

    def with_findings(self, findings: Iterable[Finding]) -> Identification:
        """Return the identification with more findings, what the present ones explain as notes."""
        more = consequences(self.findings, findings)
        return replace(self, findings=(*self.findings, *more))


def negative_inertias(robot: Robot, drives: Mapping[str, Estimate]) -> dict[str, str]:
    """Return the joints whose estimated rotor inertia is negative {joint: sentence}.

    It is by more than its uncertainty, or by more than the inertia of the bodies that move along.
    """
    mass = torque_slopes(robot, *np.zeros((3, 1, robot.n)))[2, 0]
    reasons = {}
    for index, joint in enumerate(robot.joint_names):
        estimate = drives.get(joint)
        if estimate is None or "motor_inertia" not in estimate.names:
            continue
        value, error = estimate.value("motor_inertia"), estimate.standard_error("motor_inertia")
        # The inertia of bodies and rotor at the joint, M + N^2 I, must be positive.
        at_joint = value * robot.drives[joint].ratio ** 2
        if value < -SURE * error or at_joint < min(-mass[index, index], 0.0):
            reasons[joint] = (
                f"its rotor inertia was estimated as {value:.3g} kg m^2, and no drive has a "
                "negative one"
            )
    return reasons


def identified_robot(robot: Robot, sides: RobotEstimate) -> Robot:
    """Return the robot with the identified values, its standard parameters nearest to the file's.

    Nearest in the Euclidean norm, from 1 kg per body if the robot has no masses: they have the
    estimated base parameters but need not be physically consistent. A body without mass cannot have
    first moments in Pinocchio: where it gets some, it starts from 1 kg too.
    """
    prior, base = robot.parameters.copy(), sides.model.base
    prior[::10][np.isnan(prior[::10])] = 1.0
    prior = np.nan_to_num(prior)
    correction = base.least(sides.load.values - base.project(prior))
    bodies = np.abs((prior + correction).reshape(-1, 10))
    # A body with mass m, first moment h and inertia I has |h| / m and sqrt(I / m) of its size: far
    # beyond `_FAR_M` it has no mass but rounding, from which Pinocchio cannot make a body.
    least_kg = np.maximum(np.max(bodies[:, 1:4], axis=1) / _FAR_M, bodies[:, 4:].max(1) / _FAR_M**2)
    if np.any(bodies[:, 0] < least_kg):
        prior[::10][prior[::10] == 0] = 1.0
        correction = base.least(sides.load.values - base.project(prior))
    drives = sides.drives
    identified = {
        joint: with_values(drive, drives[joint].by_name) if joint in drives else drive
        for joint, drive in robot.drives.items()
    }
    return robot.with_values(prior + correction, identified)


# What a kind of robot adds to `identify` and `validate`: nothing, if its base is held. A package
# that knows another kind of robot registers its `Extension` for the type of that robot, so that
# nothing in this package asks what kind a robot is.


class Extension:
    """The additions of robots whose base is held, which are none: other kinds replace them."""

    def log_findings(
        self, robot: Robot, logs: Sequence[Log], motions: Sequence[Sequence[Motion]]
    ) -> Iterable[Finding]:
        """Return what contradicts itself in logs and the motions of each of them, before a fit."""
        return ()

    def torque_findings(
        self, robot: Robot, asked: Sequence[str], used: Collection[str]
    ) -> Iterable[Finding]:
        """Return the notes on joints that are `asked` for and whose torque is not `used`."""
        return ()

    def sensor_errors(
        self, robot: Robot, datasets: Sequence[Dataset], model: LoadModel, fit: FittedRows
    ) -> SensorErrors | None:
        """Return the errors of sensors that the rows of a fit support; `robot` has its bodies."""
        return None

    def fit_findings(
        self,
        result: Identification,
        datasets: Sequence[Dataset],
        fit: FittedRows,
        errors: SensorErrors | None,
    ) -> Iterable[Finding]:
        """Return what the rows of a fit contradict, after `errors` of sensors were removed."""
        return ()

    def value_findings(self, declared: Robot, result: Identification) -> Iterable[Finding]:
        """Return what the values of a result contradict; `declared` has those of the robot file."""
        return ()

    def compared(self, comparison: Validation, rows: Sequence[Array]) -> Validation:
        """Return a comparison with what the `rows` (T, r, 2) of each motion have besides joints.

        They are measured and computed torques of the load side.
        """
        return comparison

    def validated(self, identification: Identification, comparison: Validation) -> Validation:
        """Return the comparison of an unseen log with what else is predicted in it."""
        return comparison


@singledispatch
def extension_of(robot: Robot) -> Extension:
    """Return what the kind of a robot adds."""
    return Extension()
