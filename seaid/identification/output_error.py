"""`refine`: maximum likelihood by output error, both sides at once, from an identification.

The measured motor angles (and the joints without a spring) are the input of the complete model:
the joints behind the springs are simulated by (8), and their encoders and all torques compared
with the measured ones. Motor encoders see the joint through a gear, so that their noise is far
below that of the joint encoders: as inputs they cost little accuracy, prevent drift, and need no
controller. Each window of the log has its own initial state.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from seaid._arrays import Array, BoolArray, FrozenMapping, white_noise
from seaid.checks import fixed_findings, nothing_to_simulate, revalued, worse_than_start
from seaid.drives import DefaultTerms, ParameterName, is_dry, parameter_named, readable, total_ratio
from seaid.errors import ExcitationError, Finding, IdentificationError, SeaidError, checked
from seaid.estimation import (
    Estimate,
    Parameter,
    Point,
    Prior,
    Residuals,
    Step,
    gauss_newton_search,
    information,
    joined,
    nuisance_draw,
    without_information,
)
from seaid.identification.drive_estimates import with_estimate, with_values, without_torque
from seaid.identification.sensitivity import STEP, Constant, constants_of
from seaid.identification.simulated_joints import (
    CommandedLog,
    check_refinable,
    commanded_point,
    finer_side,
    friction_corrections,
    hysteresis_corrections,
    smoothed,
    with_base_parameters,
    with_encoder_noise,
    with_hysteresis,
)
from seaid.identification.stacked_fits import TORQUE_OFFSET, merged_estimates
from seaid.identification.unseen_springs import (
    SAMPLES,
    joints_sensed_by_motor_only,
    with_angles,
    with_joint_angles,
    with_motor_side_findings,
    with_rigid_angles,
)
from seaid.identification.validation import compared
from seaid.log import (
    POSITION_BAND,
    SHORTEST_STRETCH,
    Log,
    Motion,
    decimated,
    decimation,
    noise_density,
    reconstruct_motion,
    reconstruct_motions,
    row_samples,
    still_speed,
    stretches,
    usable,
)
from seaid.regressor import (
    Regress,
    Regression,
    actuator_columns,
    actuator_regression,
    check_offset_std,
    drive_torques,
    load_columns,
    load_regression,
    motor_regressor,
    offset_sensitivity,
    spring_regressor,
)
from seaid.robot import Robot, check_held, coupled_names
from seaid.simulation import Response, TorqueJacobians, response_to, torque_jacobians

if TYPE_CHECKING:
    from seaid.identification.result import Identification

WIDER = 3.0
"""Cutoff of the refinement over that of the identification, to keep the steps of dry friction.
It is that of the identification where no encoder is behind a spring and the noise of the motor's,
twice differentiated, would exceed that of the torque, or the rotor inertia is unknown; and where a
spring has hysteresis, whose states add up the travel of the noise: at three times that cutoff
widths were 12 to 23 % large."""

WINDOW_S = 1.0
"""Length [s] of the simulated windows, over which model errors accumulate."""

SHORT_WINDOW_S, _FIRST_STEPS, _CLOSE_TO_LONGER = 0.25, 12, 0.5
"""Windows and most steps of a first estimate without joint encoders, see `unseen_springs`; its next
step [standard errors] from which longer windows go on."""


@dataclass(frozen=True, eq=False)
class Layout:
    """The parameters (p,) of a refinement, and the columns of each kind.

    `simulated` are the joints behind springs, `unseen` those of them without an encoder behind the
    spring; `actuators` {joint: estimate} are the elastic drives as (7) has them, `drives` {joint:
    columns} their columns, and `load` those of (8). `zeros` are those of encoder offsets, none
    without. `tested` are terms of springs that the model lacks, in the last columns: a torque of
    the joint by the derivative of this order of its deflection, with the factor zero.
    """

    identification: Identification
    parameters: tuple[Parameter, ...]
    simulated: tuple[str, ...]
    unseen: tuple[str, ...]
    actuators: FrozenMapping[Estimate]
    drives: FrozenMapping[slice]
    load: slice
    zeros: slice
    tested: tuple[tuple[str, int], ...] = ()

    @cached_property
    def places(self) -> Mapping[Parameter, int]:
        """The column of each parameter."""
        return {parameter: place for place, parameter in enumerate(self.parameters)}

    @cached_property
    def nonlinear(self) -> Mapping[str, Mapping[str, int]]:
        """The drives whose equations are nonlinear, {joint: {parameter: column}}."""
        known, drives = self.identification.known, {}
        for joint, drive in known.drives.items():
            named = {name: Parameter(name, joint) for name in drive.parameter_names}
            columns = {name: self.places[x] for name, x in named.items() if x in self.places}
            if columns.keys() & {*motor_regressor(known, joint).non_linear}:
                drives[joint] = columns
        return drives

    def tests(self, motion: Motion) -> Iterator[tuple[int, str, Array]]:
        """Yield column, joint, and torque (T,) at the joint per unit of each tested term."""
        known, first = self.identification.known, len(self.parameters) - len(self.tested)
        motors = motion.motor_position, motion.motor_velocity, motion.motor_acceleration
        loads = motion.joint_states
        for column, (joint, order) in enumerate(self.tested, first):
            index, ratio = known.index(joint), total_ratio(known.drives[joint])
            yield column, joint, motors[order][:, index] / ratio - loads[order][:, index]

    @property
    def followed(self) -> tuple[str, ...]:
        """Joints without a spring whose torque is that of the simulated motion.

        Where no encoder is behind a spring, the angles there are part of the estimate: a torque on
        them by the angles of an earlier estimate would be fitted to the noise of that one.
        """
        others = self.identification.model.torque_joints
        return tuple(joint for joint in others if self.unseen and joint not in self.simulated)

    @property
    def sensed(self) -> tuple[str, ...]:
        """Joints with a spring whose torque was measured."""
        return tuple(joint for joint in self.drives if joint not in self.simulated)

    @property
    def others(self) -> tuple[str, ...]:
        """Joints that are neither simulated nor followed, with a torque on the load side."""
        used = (*self.simulated, *self.followed)
        return tuple(x for x in self.identification.model.torque_joints if x not in used)

    @property
    def has_zeros(self) -> bool:
        """Whether encoder offsets are estimated."""
        return bool(self.zeros.stop > self.zeros.start)

    @property
    def start(self) -> Array:
        """The values (p,) of the identification, with zero encoder offsets."""
        values = np.zeros(len(self.parameters))
        for joint, columns in self.drives.items():
            values[columns] = self.actuators[joint].values
        values[self.load] = self.identification.load_side.values
        if self.unseen and self.identification.feasible is not None:
            # an inertia that can be simulated
            consistent = self.identification.base.project(self.identification.robot.parameters)
            values[self.load][: len(consistent)] = consistent
        # It stands for the zero of the motor's encoder (`layout_of`), whose expectation is zero.
        values[[self.offset(joint) for joint in self.unseen]] = 0.0
        return values

    def spring(self, joint: str) -> list[int]:
        """Return the columns of a joint's spring, for a linear one stiffness and offset."""
        names = spring_regressor(self.identification.known, joint).names
        return [self.places[Parameter(name, joint)] for name in names]

    def offset(self, joint: str) -> int:
        """Return the column of the offset of a joint's spring."""
        return self.places[Parameter("spring_offset", joint)]

    def with_known(self, robot: Robot) -> Layout:
        """Return the layout of an identification that took other constants as known."""
        return replace(self, identification=replace(self.identification, known=robot))

    def known_at(self, x: Array) -> Robot:
        """Return the robot whose nonlinear drives are linearised at the values x (p,)."""
        known, drives = self.identification.known, {}
        for joint, columns in self.nonlinear.items():
            values = {name: float(x[column]) for name, column in columns.items()}
            for name in motor_regressor(known, joint).non_linear:
                if parameter_named(name).is_positive and values.get(name, 1.0) <= 0:
                    raise IdentificationError(
                        f"the {readable(ParameterName(name, joint))} would become negative"
                    )
            drives[joint] = with_values(known.drives[joint], values)
        return known.with_drives(drives) if drives else known


@dataclass(frozen=True, eq=False)
class Run:
    """Windows of a log at the present estimate: its motion with the simulated joints.

    `reading` (T, simulated) is the measured position of these joints, `still` (T, simulated and
    followed) masks samples at which the friction of their motors is unknown; `block` samples make a
    row. `measured` is the motion by the encoders, from the start of the log to the end of the
    windows.
    """

    motion: Motion
    reading: Array
    still: BoolArray
    windows: int
    block: int
    measured: Motion


_EXACT_RAD = 1e-7
"""Standard deviation of a motor's encoder offset, seen at the joint, that counts as zero."""


def _actuator_part(identification: Identification, joint: str) -> Estimate:
    """Return the parameters of a drive by (7); a parallel spring and joint friction are in (8)."""
    whole = identification.drive_side[joint]
    load = {*map(Parameter.of_column, identification.model.names)}
    return whole.of_names(name for name in whole.names if Parameter(name, joint) not in load)


def layout_of(
    start: Identification, encoder_offset_std: float, unseen: tuple[str, ...] = ()
) -> Layout:
    """Return the parameters of an identification in one vector.

    The spring offset of an `unseen` joint is k r_L times the zero of its motor's encoder, which the
    joint's angle follows: it turns gravity, and is known as well as that zero.
    """
    robot = start.known
    parameters: list[Parameter] = []
    drives: dict[str, slice] = {}
    actuators = {joint: _actuator_part(start, joint) for joint in robot.elastic_joints}
    for joint, estimate in actuators.items():
        first = len(parameters)
        parameters += [Parameter(name, joint) for name in estimate.names]
        drives[joint] = slice(first, len(parameters))
        if joint in unseen:
            # F = k r_L dq: the standard deviation of the spring's force by that of the zero dq.
            force = estimate.value("stiffness") * robot.drives[joint].load_radius
            prior = Prior(0.0, abs(force) * max(encoder_offset_std, _EXACT_RAD))
            place = first + estimate.names.index("spring_offset")
            parameters[place] = replace(parameters[place], prior=prior)
    load = slice(len(parameters), len(parameters) + len(start.model.names))
    parameters += map(Parameter.of_column, start.model.names)
    if encoder_offset_std:
        zero = Prior(0.0, encoder_offset_std)
        parameters += [Parameter("encoder_zero", joint, prior=zero) for joint in robot.joint_names]
    return Layout(
        identification=start,
        parameters=tuple(parameters),
        simulated=tuple(joint for joint in start.model.torque_joints if joint in start.springs),
        unseen=unseen,
        actuators=FrozenMapping(actuators),
        drives=FrozenMapping(drives),
        load=load,
        zeros=slice(load.stop, len(parameters)),
    )


_MOST_ENTRIES = 1_000_000
"""Entries of the response of the joints in memory at a time, of 20 or so arrays of this size."""


def runs_of(layout: Layout, log: Log, window_s: float = WINDOW_S) -> list[Run]:
    """Return a log without gaps, with the wider cutoff, in parts of whole windows."""
    known, motion = layout.identification.known, _in_wider_band(layout, log)
    if layout.unseen:
        motion = smoothed(motion, [known.index(joint) for joint in layout.unseen])
        # The angles behind the springs are simulated, so that the samples must resolve the
        # fastest oscillation in the band, and no more: the cost grows with their number.
        motion = decimated(motion, max(1, int(motion.rate_hz / (SAMPLES * motion.cutoff_hz))))
    block = decimation(motion.rate_hz, motion.cutoff_hz)
    transient = round(motion.transient_s * motion.rate_hz)
    length = len(motion.time) - 2 * transient
    windows = max(1, round(length / motion.rate_hz / window_s))
    # Windows are whole numbers of blocks, since a row is the mean of a block in one window.
    window = length // windows // block * block
    simulated = [known.index(joint) for joint in layout.simulated]
    compared = (*layout.simulated, *layout.followed)
    still = np.column_stack([_turning(known, motion, joint) for joint in compared])
    # Response of s joints: (T, s, 1 + p + 2 s), the residual, p parameters, 2 s initial states.
    per_window = window * len(simulated) * (1 + len(layout.parameters) + 2 * len(simulated))
    most = max(1, _MOST_ENTRIES // max(per_window, 1))
    runs = []
    for start in range(0, windows, most):
        count = min(most, windows - start)
        first = transient + start * window
        part = slice(first, first + count * window)
        reading = motion.joint_position[part, simulated]
        # The state of a spring's hysteresis depends on the whole past, not on the window alone.
        before = motion.samples(slice(part.stop))
        runs.append(Run(motion.samples(part), reading, still[part], count, block, before))
    return runs


def _in_wider_band(layout: Layout, log: Log) -> Motion:
    """Return the motion of a log at the wider cutoff, where `WIDER` has no reason against it."""
    start, known = layout.identification, layout.identification.known
    rate_hz = (len(log.time) - 1) / (log.time[-1] - log.time[0])
    wider = 1.0 if with_hysteresis(known, layout.simulated) else WIDER
    band = min(wider * start.cutoff_hz, rate_hz / 8)
    motion = finer_side(known, reconstruct_motion(known, log, band))
    behind = (*layout.unseen, *layout.followed)
    # Torque noise < noise of I_M w': a wider band would only add that of the encoder. Any noise in
    # the column w' of an unknown I_M makes it too small (errors in variables).
    noises = [_motor_noise(start, joint, log, motion) for joint in behind]
    is_noisy = any(torque < rotor for torque, rotor in noises)
    if is_noisy or any("motor_inertia" in layout.actuators[x].names for x in layout.unseen):
        return finer_side(known, reconstruct_motion(known, log, start.cutoff_hz))
    return motion


def _zeros(layout: Layout, x: Array) -> Array:
    """Return the encoder offsets (n,), zero if they are not estimated."""
    return x[layout.zeros] if layout.has_zeros else np.zeros(layout.identification.known.n)


@dataclass(frozen=True, eq=False)
class MeasuredLog:
    """The residuals of what is not simulated in a part of a log without gaps.

    `rows` are the residuals at parameters of zero, linearised at x (p,).
    """

    layout: Layout
    log: Log
    motion: Motion
    rows: Residuals
    x: Array

    @classmethod
    def of(cls, layout: Layout, log: Log, x: Array) -> MeasuredLog:
        """Return the residuals of a log, filtered at the cutoff of the identification."""
        known = layout.identification.known
        motion = reconstruct_motion(known, log, layout.identification.cutoff_hz)
        motion = finer_side(known, motion)
        return cls(layout, log, motion, _measured_near(layout, motion, x), x)

    @property
    def residuals(self) -> Residuals:
        """The residuals at x."""
        return replace(self.rows, residual=self.rows.residual + self.rows.jacobian @ self.x)

    def moved(self, x: Array, part: float, nuisance: Array) -> MeasuredLog:
        """Return the residuals at parameters x (p,)."""
        rows = self.rows
        if self.layout.nonlinear:
            rows = _measured_near(self.layout, self.motion, x)
        return replace(self, rows=rows, x=x)

    def with_layout(self, layout: Layout, x: Array) -> MeasuredLog:
        """Return the residuals with further parameters, at x (p,)."""
        return self.of(layout, self.log, x)

    def with_constant(self, constant: Constant) -> MeasuredLog:
        """Return the residuals with a constant changed."""
        return self.of(self.layout.with_known(constant.robot), constant.scaled(self.log), self.x)


def _measured_near(layout: Layout, motion: Motion, x: Array) -> Residuals:
    """Return what is not simulated, linearised at x (p,), at parameters of zero."""
    samples = row_samples(motion)
    instants = motion.time[samples]
    shape = (1, len(instants), len(layout.sensed) + len(layout.others))
    residual, jacobian = np.zeros(shape), np.zeros((*shape, len(x)))
    kept = np.zeros(shape, dtype=bool)
    rows_of_channels = _rows_of_channels(layout, motion, x)
    for channel, (index, columns, rows) in enumerate(rows_of_channels):
        of_joint = rows.joint == index
        # Rows near standstill are missing: others are placed by time, 1e-9 s against rounding.
        places = np.searchsorted(instants, rows.time[of_joint] - 1e-9)
        # The rows are at twice the Nyquist rate of the filter: every second one counts, so that
        # white noise below the cutoff is uncorrelated from row to row.
        kept[0, places[places % 2 == 0], channel] = True
        residual[0, places, channel] = rows.y[of_joint]
        jacobian[0, places, channel, columns] = -rows.H[of_joint]
        if layout.has_zeros:
            jacobian[0, places, channel, layout.zeros] = -rows.propagated[of_joint]
    simulated = 2 * len(layout.simulated) + len(layout.followed)
    return Residuals(
        residual=residual,
        jacobian=jacobian,
        nuisance=np.zeros((*shape, 0)),
        kept=kept,
        time=instants[None],
        channels=range(simulated, simulated + shape[2]),
    )


def _rows_of_channels(
    layout: Layout, motion: Motion, x: Array
) -> Iterator[tuple[int, slice, Regression]]:
    """Yield joint, columns and rows of what is not simulated.

    These are the drives of springs with a measured torque, and the torques of stiff joints. Their
    columns have the noise of the encoders, so that both sides are filtered as in `identify`. The
    effect of encoder offsets is that at the start.
    """
    known, model, start = layout.known_at(x), layout.identification.model, layout.start

    def rows_of(regress: Regress, columns: slice) -> Regression:
        if layout.has_zeros:
            return offset_sensitivity(known, motion, regress, start[columns])
        return regress(motion)

    for joint in layout.sensed:
        rows = rows_of(partial(actuator_regression, known, joint=joint), layout.drives[joint])
        _check_columns(layout, rows.names, joint)
        yield known.index(joint), layout.drives[joint], rows
    if layout.others:
        zero = without_torque(known, layout.simulated)
        rows = rows_of(partial(load_regression, known, model=model, springs=zero), layout.load)
        yield from ((known.index(joint), layout.load, rows) for joint in layout.others)


def linearised(layout: Layout, run: Run, x: Array) -> tuple[Residuals, Pull]:
    """Return the residuals of the simulated joints around x, and what pulls at these joints.

    Channels: positions of the simulated joints, torques of their drives, those of followed joints.
    """
    around = _Around(layout, run, x)
    pull = Pull(around.inside, around.load_of(layout.simulated), around.step_s, run.windows)
    response = pull.response(pull.force)
    torques = around.motor_torques(response), around.followed_torques(response)
    columns = np.concatenate([around.positions(response), *torques], axis=1)
    unseen = np.isin(layout.simulated, layout.unseen)
    # A joint without an encoder has no measured position: its rows never count. Positions of
    # the others count at standstill too, where only the torques are unknown.
    unknown = np.hstack([np.broadcast_to(unseen, (len(columns), len(unseen))), run.still])
    if run.motion.bridged is not None:  # what was interpolated over a gap was not measured
        unknown |= run.motion.bridged[:, None]
    return _blocks(run, columns, unknown, 2 * len(unseen)), pull


@dataclass(frozen=True, eq=False)
class Pull:
    """The linearised load side (8) of the simulated joints: `inside` moves by `force`.

    The first column of `force` (T, joints, 1 + p) is the residual of (8), by which the joints have
    to move to satisfy it; then follow its derivatives by the parameters.
    """

    inside: TorqueJacobians
    force: Array
    step_s: float
    windows: int

    def response(self, force: Array) -> Response:
        """Return the response of the joints to a force (T, joints, any), and free motions."""
        return response_to(self.inside, force, self.step_s, self.windows)


_NUDGE = 1e-6
"""Change of a joint's position [rad or m] and speed for the slopes of its drive's torques."""


@dataclass(frozen=True, eq=False)
class _Around:
    """The equations of a run about parameters x (p,), of S simulated joints.

    Columns (T, joints, 1 + p) are a residual and its derivatives by x.
    """

    layout: Layout
    run: Run
    x: Array

    @property
    def step_s(self) -> float:
        """The time between samples."""
        return 1 / self.run.motion.rate_hz

    @cached_property
    def known(self) -> Robot:
        """The robot whose nonlinear drives are linearised at x."""
        return self.layout.known_at(self.x)

    @cached_property
    def joints(self) -> list[int]:
        """The places of the simulated joints in the robot."""
        return list(map(self.known.index, self.layout.simulated))

    @cached_property
    def springs(self) -> dict[str, Array]:
        """The values of the springs whose torque is in (8)."""
        layout = self.layout
        return {joint: self.x[layout.spring(joint)] for joint in layout.identification.springs}

    @cached_property
    def jacobians(self) -> TorqueJacobians:
        """The derivatives of the inverse dynamics by the motion."""
        robot = with_base_parameters(self.layout.identification, self.x[self.layout.load])
        return torque_jacobians(robot, *self.run.motion.joint_states)

    @cached_property
    def hysteresis(self) -> dict[str, Array]:
        """The corrections of the springs with hysteresis."""
        layout, run = self.layout, self.run
        motions = run.motion, run.measured
        return hysteresis_corrections(self.known, layout.simulated, *motions, layout.places, self.x)

    @cached_property
    def friction(self) -> tuple[dict[str, Array], Array]:
        """The corrections of dry friction of the joints, and its slopes (T, S) by their speeds."""
        layout = self.layout
        return friction_corrections(
            self.known, layout.simulated, self.run.motion, layout.places, self.x
        )

    @cached_property
    def load(self) -> Array:
        """The columns of (8) of all joints with a torque."""
        layout, motion, x = self.layout, self.run.motion, self.x
        model = layout.identification.model
        torque, payload, H, by_springs = load_columns(self.known, motion, model, self.springs)
        columns = np.zeros((*torque.shape, 1 + len(x)))
        by_x = columns[:, :, 1:]
        columns[:, :, 0] = torque - payload - H @ x[layout.load]
        by_x[:, :, layout.load] = -H
        of_springs = [column for joint in layout.simulated for column in layout.spring(joint)]
        by_x[:, :, of_springs] = by_springs
        if layout.has_zeros:
            rows = list(map(self.known.index, model.torque_joints))
            # q = reading - zero: -tau(q) changes by +dtau/dq per unit of the zero. Positions
            # of simulated joints do not depend on the zero of their encoders, their outputs do.
            by_x[:, :, layout.zeros] = self.jacobians.position[:, rows]
            by_x[:, :, [layout.zeros.start + joint for joint in self.joints]] = 0.0
        for column, joint, unit in layout.tests(motion):
            by_x[:, model.torque_joints.index(joint), column] = unit
        for joint, correction in (*self.hysteresis.items(), *self.friction[0].items()):
            # A correction of the torque on the joint is in (8) with its sign, and in (7), through
            # the gear, with the opposite one (below); joint friction is in (8) alone.
            columns[:, model.torque_joints.index(joint)] += correction
        return columns

    def load_of(self, joints: Sequence[str]) -> Array:
        """Return the columns of (8) of some joints."""
        names = self.layout.identification.model.torque_joints
        return np.asarray(self.load[:, list(map(names.index, joints))])

    @cached_property
    def nudged(self) -> tuple[Motion, Motion]:
        """The motions with all joint positions changed by `_NUDGE`, and with all speeds.

        The torque of a drive depends on its own joint, so that one change of all joints at once
        gives all slopes. `refine` refuses coupled drives, for which this is not so.
        """
        motion = self.run.motion
        return (
            replace(motion, joint_position=motion.joint_position + _NUDGE),
            replace(motion, joint_velocity=motion.joint_velocity + _NUDGE),
        )

    @property
    def inside(self) -> TorqueJacobians:
        """What pulls at the simulated joints: the bodies, and the drives against their motion."""
        layout, eye = self.layout, np.eye(len(self.joints))
        model = layout.identification.model
        simulated = list(map(model.torque_joints.index, layout.simulated))
        unchanged, *torques = (
            drive_torques(self.known, motion, model, self.springs, self.x[layout.load])
            for motion in (self.run.motion, *self.nudged)
        )
        by_position, by_speed = (
            ((unchanged - torque)[:, simulated, None] / _NUDGE) * eye for torque in torques
        )
        by_speed = by_speed + self.friction[1][:, :, None] * eye
        return self.jacobians.part(self.joints, self.joints).plus(by_position, by_speed)

    def positions(self, response: Response) -> Array:
        """Return the columns of the encoders of the simulated joints, and of their free motions."""
        layout, joints = self.layout, self.joints
        columns = -response.position
        # y - q - z, where q is the present motion plus its Newton correction, the first column.
        columns[:, :, 0] += self.run.reading - self.run.motion.joint_position[:, joints]
        if layout.has_zeros:
            columns[:, :, 0] -= self.x[layout.zeros][joints]
            zeros = [1 + layout.zeros.start + joint for joint in joints]
            columns[:, range(len(joints)), zeros] -= 1.0
        return columns

    def motor_torques(self, response: Response) -> Array:
        """Return the columns of (7) of the simulated joints, and of their free motions."""
        layout = self.layout
        columns = np.zeros_like(response.position)
        for row, joint in enumerate(layout.simulated):
            names, zeta, R = self.motor_equation(joint, self.run.motion)
            _check_columns(layout, names, joint)
            of_drive = layout.drives[joint]
            residual = zeta - R @ self.x[of_drive]
            columns[:, row, 0] = residual
            columns[:, row, 1 + of_drive.start : 1 + of_drive.stop] = -R
            moves = response.position[:, row], response.velocity[:, row]
            for move, motion in zip(moves, self.nudged, strict=True):
                _, zeta, R = self.motor_equation(joint, motion)
                slope = (zeta - R @ self.x[of_drive] - residual) / _NUDGE
                # Chain rule d(7)/dx + d(7)/dq dq/dx + d(7)/dv dv/dx; (7) has no joint acceleration.
                # The first column is the change by the Newton correction of the joint.
                columns[:, row] += slope[:, None] * move
        # A torque on the joint loads its motor, through the gear.
        for column, joint, unit in layout.tests(self.run.motion):
            ratio = total_ratio(self.known.drives[joint])
            columns[:, layout.simulated.index(joint), 1 + column] -= unit / ratio
        for joint, torque in self.hysteresis.items():
            ratio = total_ratio(self.known.drives[joint])
            columns[:, layout.simulated.index(joint), : torque.shape[1]] -= torque / ratio
        return columns

    def motor_equation(self, joint: str, motion: Motion) -> tuple[tuple[str, ...], Array, Array]:
        """Return names, zeta and R of (7), with a column for an identified torque offset."""
        regressor, zeta, R = actuator_columns(self.known, motion, joint)
        if Parameter(TORQUE_OFFSET, joint) not in self.layout.places:
            return regressor.names, zeta, R
        return (*regressor.names, TORQUE_OFFSET), zeta, np.column_stack([R, np.ones(len(zeta))])

    def followed_torques(self, response: Response) -> Array:
        """Return the columns of (8) of the followed joints, and of the free motions of others."""
        followed = list(map(self.known.index, self.layout.followed))
        columns = -self.jacobians.part(followed, self.joints).change(response)
        rows = self.load_of(self.layout.followed)
        columns[:, :, : rows.shape[2]] += rows
        return columns


def _check_columns(layout: Layout, names: tuple[str, ...], joint: str) -> None:
    """Raise IdentificationError if a log has other torque sensors than the identification."""
    identified = layout.actuators[joint].names
    if names != identified:
        raise IdentificationError(
            f"the log determines {', '.join(names)} of {joint}, the identification "
            f"has {', '.join(identified)}: same torque sensors needed"
        )


def _turning(robot: Robot, motion: Motion, joint: str) -> BoolArray:
    """Return a mask (T,) of samples near which a motor with dry friction stands or turns back.

    A width of Coulomb friction that `identify` selected is that of its rows, below the narrower
    cutoff and often of the sampling alone: near rest such friction is as unknown as a dry one.
    """
    drive = robot.drives[joint]
    if not (is_dry(drive) or isinstance(drive.friction, DefaultTerms)):
        return np.zeros(len(motion.time), dtype=bool)
    speed = motion.motor_velocity[:, robot.index(joint)]
    still = np.abs(speed) < still_speed(motion, robot.index(joint))
    still[1:] |= speed[1:] * speed[:-1] < 0
    # The low pass of the positions smears a reversal over about one of its periods.
    seen = round(motion.rate_hz / (POSITION_BAND * motion.cutoff_hz))
    return np.asarray(scipy.ndimage.maximum_filter1d(still.astype(np.uint8), 2 * seen + 1) > 0)


def _blocks(run: Run, columns: Array, unknown: BoolArray, free: int) -> Residuals:
    """Average columns (T, C, 1 + p + s) over blocks, by which white noise stays white.

    Blocks with a sample that is `unknown` (T, C) do not count.
    """
    shape = (run.windows, -1, run.block, columns.shape[1])
    means = columns.reshape(*shape, columns.shape[2]).mean(axis=2)
    last = columns.shape[2] - free
    return Residuals(
        residual=means[..., 0],
        jacobian=means[..., 1:last],
        nuisance=means[..., last:],
        kept=np.asarray(~unknown.reshape(shape).any(axis=2)),
        time=run.motion.time.reshape(run.windows, -1, run.block).mean(axis=2),
        channels=range(columns.shape[1]),
    )


_AT_NOISE, _SMALLEST_TORQUE = 3.0, 1e-6
"""Residual torque over the noise between samples at which a first estimate is not in a wrong
minimum, where it was 10 to 60 times on three plants of scripts/benchmarks/motor_side.py; and the
least noise [N m] of a log."""

_SETTLED, _CLOSE = 1e-3, 0.05
"""Next steps [standard errors] at which a search ends, and up to which it has converged."""

_LARGEST = 1e100
"""Size from which a simulation diverges: squares of what is larger overflow."""


@dataclass(frozen=True, eq=False)
class DrivenLog:
    """The residuals of joints that are simulated from the motor angles of a log."""

    layout: Layout
    runs: list[Run]
    x: Array

    @cached_property
    def _linearised(self) -> list[tuple[Residuals, Pull]]:
        diverges = "the simulation diverges at this estimate: check the identification it starts "
        diverges += "from"
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                around = [linearised(self.layout, run, self.x) for run in self.runs]
        except IdentificationError as problem:
            raise IdentificationError(f"{diverges}; {problem}") from None
        for rows, _ in around:
            for part in (rows.residual, rows.jacobian, rows.nuisance):
                if not np.all(np.abs(part) < _LARGEST):
                    raise IdentificationError(diverges)
        return around

    @cached_property
    def residuals(self) -> Residuals:
        """The residuals of all windows."""
        return joined([rows for rows, _ in self._linearised])

    def moved(self, x: Array, part: float, nuisance: Array) -> DrivenLog:
        """Return the residuals at parameters x (p,), its joints after a part of a step."""
        starts = np.cumsum([run.windows for run in self.runs])[:-1]
        initial = np.split(part * nuisance, starts)
        pulls = [pull for _, pull in self._linearised]
        runs = [
            _moved(self.layout, run, pull, x - self.x, part, states)
            for run, pull, states in zip(self.runs, pulls, initial, strict=True)
        ]
        return replace(self, runs=runs, x=x)

    def with_layout(self, layout: Layout, x: Array) -> DrivenLog:
        """Return the residuals with further parameters, at x (p,)."""
        return replace(self, layout=layout, x=x)

    def with_constant(self, constant: Constant) -> DrivenLog:
        """Return the residuals with a constant changed."""
        runs = [
            replace(run, motion=constant.scaled(run.motion), measured=constant.scaled(run.measured))
            for run in self.runs
        ]
        return replace(self, runs=runs, layout=self.layout.with_known(constant.robot))

    def with_noise(self, logs: Sequence[Log], rng: np.random.Generator) -> DrivenLog:
        """Return the residuals whose measured joints have the noise of the encoders once more."""
        known = self.layout.identification.known
        runs = [
            replace(run, measured=with_encoder_noise(known, run.measured, logs, rng))
            for run in self.runs
        ]
        return replace(self, runs=runs)


LogPoint = Point[DrivenLog | MeasuredLog]


@checked(IdentificationError)
def refine(
    identification: Identification,
    logs: Log | Sequence[Log],
    *,
    encoder_offset_std: float = 0.0,
    iterations: int = 20,
    progress: bool = False,
) -> Identification:
    """Refine an identification to the maximum-likelihood estimate of both sides at once.

    Output error (Gautier, Janot and Vandanjon 2013) by Gauss-Newton with forward sensitivities: the
    joints behind springs are simulated from the measured motor angles; their encoders and all
    measured torques are outputs with white noise of estimated variance. Rows in which a motor with
    dry friction, or one whose width `identify` selected, stands still or turns back are excluded,
    as are gaps. The covariance includes autocorrelation.
    The torques of joints that are not simulated are compared below the cutoff, as in `identify`.
    Where position commands were logged, the model follows them under its own controllers, and the
    joint positions are the outputs.
    `residual_std` is that of averages over blocks of samples: of a drive's torque (or spring
    force), and on the load side of the torques of stiff joints, or else of the joint encoders.

    Parameters
    ----------
    identification : Identification
        The start, of `identify`.
    logs : Log or sequence of Log
        The logs to fit.
    encoder_offset_std : float
        Standard deviation of the joint encoder offsets [rad or m]; if positive they are estimated.
    iterations : int
        Largest number of Gauss-Newton steps.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Identification
        The refined parameters. Those of the start, with a warning that says why, if they predict
        the logs better, or if no joint can be simulated.

    Raises
    ------
    IdentificationError
        If the start is unusable or the iteration does not converge.
    ExcitationError
        If the logs leave parameters unidentifiable.
    LogError
        If a log does not fit the robot.

    Examples
    --------
    >>> refined = seaid.refine(seaid.identify(robot, log), log)
    """
    logs = [logs] if isinstance(logs, Log) else list(logs)
    if not logs:
        raise IdentificationError("refine needs a log, found none")
    check_held(
        identification.robot, "refine", IdentificationError, why="seaid does not simulate contacts"
    )
    check_offset_std(encoder_offset_std)
    _check_start(identification, joints_sensed_by_motor_only(identification.known, logs))
    if identification.known.has_controllers:
        return _commanded_refinement(identification, logs, iterations, progress)
    return refined_with_logs(identification, logs, encoder_offset_std, iterations, progress)[0]


_COMMANDED_SETTLED = 0.02
"""Next step [standard errors] at which a search ends."""

_FAR = 3.0
"""Standard errors of the next step beyond which a search that cannot go on has not converged: 0.13
to 0.41 on the measured logs of a Go2, 48 where friction holds the joints of an arm at reversals."""


def _commanded_refinement(
    start: Identification, logs: Sequence[Log], iterations: int, progress: bool
) -> Identification:
    """Return the identification with the least output error of the closed loop.

    It is the start with the reason why, where the values are worse. With errors of the model in
    place of noise the likelihood, in which joints of small errors weigh most, may rise while the
    positions get worse; or no step may improve it, although its slope is not zero.
    """
    first = commanded_point(start, logs)
    try:
        _ = first.step
    except SeaidError as problem:
        raise IdentificationError(
            "the model cannot be simulated with the values of the identification: give the bodies "
            f"that are known (known_bodies=), or identify with feasible=True; {problem}",
            "known_bodies=",
            "feasible=True",
        ) from None
    point, is_stuck = gauss_newton_search(first, iterations, _COMMANDED_SETTLED, progress)
    step = point.step
    errors = np.sqrt(np.diag(step.covariance))
    rest = np.abs(step.change) / np.where(errors > 0, errors, 1.0)
    if is_stuck and np.max(rest, initial=0.0) > _FAR:
        worst = int(np.argmax(rest))
        name = readable(point.parameters[worst].name)
        reason = (
            f"its search cannot improve the simulated positions, although its next step would "
            f"change {name} by {rest[worst]:.0f} standard errors"
        )
        evidence = {"standard errors": float(rest[worst])}
        return start.with_findings([worse_than_start(reason, evidence)])
    before, after = _mean_absolute_error(first), _mean_absolute_error(point)
    if after > before:
        reason = "its positions follow the commands more closely"
        evidence = {"error of the start": before, "error after": after}
        return start.with_findings([worse_than_start(reason, evidence)])
    return _refined_commanded(point)


def _mean_absolute_error(point: Point[CommandedLog]) -> float:
    """Return the mean absolute error of all joints [rad or m]."""
    residuals = [log.residuals for log in point.logs]
    return float(np.mean(np.concatenate([abs(x.residual[x.kept]) for x in residuals])))


def _refined_commanded(point: Point[CommandedLog]) -> Identification:
    """Return the identification with the values of a point and their covariance."""
    commands, step = point.logs[0].commands, point.step
    start, spread = commands.identification, commands.spread
    side = replace(
        start.load_side,
        values=spread @ point.x,
        covariance=spread @ (step.covariance + _of_constants(start, point)) @ spread.T,
        residual_std=float(np.sqrt(np.mean(step.stds**2))),
        condition_number=step.condition_number,
        white_standard_errors=np.sqrt(np.diag(spread @ step.white_covariance @ spread.T)),
        degrees_of_freedom=None,
    )
    return _with_estimates(start, {}, side)


def refined_with_logs(
    identification: Identification,
    logs: list[Log],
    encoder_offset_std: float,
    iterations: int = 20,
    progress: bool = False,
) -> tuple[Identification, list[Log]]:
    """Return the result of `refine`, and the logs with the simulated angles of unseen joints."""
    unseen = joints_sensed_by_motor_only(identification.known, logs)
    layout = layout_of(identification, encoder_offset_std, unseen)
    if not (layout.simulated or encoder_offset_std):
        return identification.with_findings([nothing_to_simulate()]), logs
    # Angles without an encoder come from (7), and the errors of a poor start accumulate over a
    # window: an iteration in short windows comes first.
    simulated, first = _filled(layout, logs, layout.start), layout.start
    if unseen:
        short = point_at(layout, simulated, first, SHORT_WINDOW_S)
        point, _ = gauss_newton_search(short, iterations, _CLOSE_TO_LONGER, progress)
        simulated, first = [_simulated_log(layout, log, point) for log in logs], point.x
    start = point_at(layout, simulated, first)
    point, _ = gauss_newton_search(start, iterations, _SETTLED, progress)
    # `not <` also refuses NaN.
    if not point.size < _CLOSE:
        held = _held(identification, layout, point)
        if held is not None:
            return refined_with_logs(held, logs, encoder_offset_std, iterations, progress)
        raise IdentificationError(
            f"the refinement did not converge in {iterations} iterations: its next step would be "
            f"{point.size:.2g} standard errors; use the result of identify, if the logs and "
            "the identification belong together"
        )
    if unseen:
        if any("motor_inertia" in layout.actuators[joint].names for joint in unseen):
            point = _without_noise_of_rotors(layout, point, simulated)
        return _refined_unseen(layout, point), [_simulated_log(layout, x, point) for x in logs]
    step = point.step
    step = replace(step, covariance=step.covariance + _of_noisy_deflections(layout, point, logs))
    refined = _refined(layout, point, step)
    worse = _worse(identification, refined, logs, _zeros(layout, point.x))
    return (identification.with_findings(worse) if worse else refined), logs


def _refined_unseen(layout: Layout, point: LogPoint) -> Identification:
    """Return the refinement of joints without encoder, with the terms that their springs lack."""
    wider, wider_point = _with_tests(layout, point)
    noise, p = _noise_of_states(wider_point), len(point.x)
    terms = _tested_terms(wider, without_information(wider_point.step, noise))
    refined = _refined(layout, point, without_information(point.step, noise[:p, :p]))
    return with_motor_side_findings(refined, terms, _runs(point)[0].motion)


def _held(start: Identification, layout: Layout, point: LogPoint) -> Identification | None:
    """Return the start with nonlinear parameters fixed that kept the search from ending, if any.

    These are positive ones of elastic drives whose 95 % interval at the last point reaches zero,
    where the equations are singular: a Stribeck speed without Stribeck friction.
    """
    error = np.sqrt(np.diag(point.step.white_covariance))
    known, sides, notes = dict(start.known.drives), dict(start.drive_side), list[Finding]()
    for joint in layout.nonlinear.keys() & layout.drives.keys():
        estimate, drive = sides[joint], known[joint]
        columns = layout.nonlinear[joint]
        weak = [
            name
            for name in motor_regressor(start.known, joint).non_linear
            if name in columns
            and parameter_named(name).is_positive
            # `not >` also takes NaN as weak.
            and not point.x[columns[name]] > 2 * error[columns[name]]
        ]
        if not weak:
            continue
        notes += fixed_findings(joint, drive, weak, by_simulation=True)
        sides[joint] = estimate.of_names(name for name in estimate.names if name not in weak)
        known[joint] = replace(drive, known=(*drive.known, *weak))
    if known == dict(start.known.drives):
        return None
    robot = start.known.with_drives(known)
    return replace(start, known=robot, drive_side=FrozenMapping(sides)).with_findings(notes)


def simulated_from_motors(identification: Identification, log: Log) -> Log:
    """Return a log with the angles of joints without a sensor there, simulated by the model.

    The motors turn as measured; only the initial state of each window is fitted to their torques.
    """
    unseen = joints_sensed_by_motor_only(identification.known, [log])
    if not unseen:
        return log
    _check_start(identification, unseen)
    layout = layout_of(identification, 0.0, unseen)
    filled = _filled(layout, [log], layout.start)
    return _simulated_log(layout, log, point_at(layout, filled, layout.start))


@dataclass(frozen=True, eq=False)
class FirstEstimate:
    """A fit in short windows: its merit, and the logs with the simulated angles of unseen joints.

    `is_at_noise` says whether nothing but the noise of the torques is left.
    """

    merit: float
    logs: list[Log]
    is_at_noise: bool


def first_estimate(identification: Identification, logs: list[Log]) -> FirstEstimate:
    """Return the fit in short windows of logs without some joint encoders."""
    layout = layout_of(identification, 0.0, joints_sensed_by_motor_only(identification.known, logs))
    x = layout.start
    for joint in layout.unseen:  # the angles of the start are those of a spring without damping
        if (damping := Parameter("spring_damping", joint)) in layout.places:
            x[layout.places[damping]] = identification.known.drives[joint].values.get(
                "spring_damping", 0.0
            )
    filled = _filled(layout, logs, x)
    short = point_at(layout, filled, x, SHORT_WINDOW_S)
    point, _ = gauss_newton_search(short, _FIRST_STEPS, _CLOSE_TO_LONGER)
    # Channels: the s positions of simulated joints, then the torques of their s drives.
    channels = len(layout.simulated) + np.flatnonzero(np.isin(layout.simulated, layout.unseen))
    noise = [
        max(
            np.hypot(*_motor_noise(identification, joint, log, run.motion))
            for log in logs
            for run in _runs(point)
        )
        for joint in layout.unseen
    ]
    if any(point.x[layout.spring(joint)[0]] <= 0 for joint in layout.unseen):
        raise IdentificationError("the search of the stiffness ended below zero")
    at_noise = point.step.stds[channels] <= _AT_NOISE * np.maximum(noise, _SMALLEST_TORQUE)
    simulated = [_simulated_log(layout, log, point) for log in logs]
    return FirstEstimate(point.step.merit, simulated, bool(np.all(at_noise)))


def _motor_noise(
    start: Identification, joint: str, log: Log, motion: Motion
) -> tuple[float, float]:
    """Return the noise of a motor torque, and of its encoder in the torque of the rotor."""
    # The robot has the rotor inertia of a start that does not know it, too.
    index, drive = start.known.index(joint), start.robot.drives[joint]
    rotor = drive.values.get("motor_inertia", 0.0) * white_noise(
        motion.motor_acceleration[:, index]
    )
    return white_noise(log.motor_torque[:, index]), rotor


def point_at(layout: Layout, logs: Sequence[Log], x: Array, window_s: float = WINDOW_S) -> LogPoint:
    """Return the point of a search at the values x (p,), its joints simulated to satisfy (8)."""
    shortest_s = SHORTEST_STRETCH / layout.identification.cutoff_hz
    parts = [part for log in logs for part in stretches(usable(log), shortest_s)]
    residuals: list[DrivenLog | MeasuredLog] = []
    if layout.simulated:
        residuals += [DrivenLog(layout, runs_of(layout, part, window_s), x) for part in parts]
    if layout.sensed or layout.others:
        residuals += [MeasuredLog.of(layout, part, x) for part in parts]
    return Point(layout.parameters, x, tuple(residuals)).settled()


def _runs(point: LogPoint) -> list[Run]:
    """Return the simulated windows of all logs."""
    return [run for log in point.logs if isinstance(log, DrivenLog) for run in log.runs]


def _filled(layout: Layout, logs: list[Log], x: Array) -> list[Log]:
    """Return the logs with the angles of unseen joints by (7) at the values x (p,)."""
    known, cutoff_hz = layout.identification.known, layout.identification.cutoff_hz
    drives = {
        joint: dict(zip(layout.actuators[joint].names, x[layout.drives[joint]], strict=True))
        for joint in layout.unseen
    }
    return [with_joint_angles(known, log, drives, cutoff_hz) if drives else log for log in logs]


def _simulated_log(layout: Layout, log: Log, point: LogPoint) -> Log:
    """Return the simulated part of the log with the simulated angles of the unseen joints."""
    robot = layout.identification.known
    motions = [run.motion for run in _runs(point)]
    parts = [x for x in motions if log.time[0] <= x.time[0] <= log.time[-1]]
    filled = with_angles(robot, with_rigid_angles(robot, log, layout.unseen), parts, layout.unseen)
    return filled.between(parts[0].time[0], parts[-1].time[-1])


_WORSE, _WORSE_SHARE = 1.5, 0.02
"""A joint is predicted worse if the relative error of its torque grows by this factor, and by this
much. Without model errors the factor is at most 1.2 (`scripts/benchmarks/output_error.py`,
cutoffs of 2 to 12 Hz): the likelihood weights other channels than the regression does.
"""


def _worse(
    before: Identification, after: Identification, logs: list[Log], zeros: Array
) -> list[Finding]:
    """Return which torque the refined values predict worse than the start, if any."""
    motions = [
        part for log in logs for part in reconstruct_motions(before.known, log, before.cutoff_hz)
    ]
    shifted = [replace(motion, joint_position=motion.joint_position - zeros) for motion in motions]
    # (2, n): the motor torques, then the load torques.
    old, new = (
        np.array([fits.actuator.relative_error, fits.load.relative_error])
        for fits in (compared(before, *motions), compared(after, *shifted))
    )
    with np.errstate(invalid="ignore"):
        is_worse = (new > _WORSE * old) & (new - old > _WORSE_SHARE)
        worst = np.unravel_index(np.argmax(np.where(is_worse, new / old, 0.0)), new.shape)
    if not is_worse[worst]:
        return []
    side, joint = ("motor", "load")[worst[0]], before.known.joint_names[worst[1]]
    evidence = {"error before": float(old[worst]), "error after": float(new[worst])}
    reason = (
        f"the error of the {side} torque of {joint} would grow from {old[worst]:.1%} to "
        f"{new[worst]:.1%}"
    )
    return [worse_than_start(reason, evidence)]


def _check_start(start: Identification, unseen: Sequence[str] = ()) -> None:
    coupled = coupled_names(start.known.joint_names, start.known.transmission)
    if coupled:
        raise IdentificationError(
            f"the drives of {', '.join(coupled)} move several joints, which the refinement cannot "
            "simulate; use the result of identify, or its estimator='iv' or method='simultaneous'",
            "estimator='iv'",
            "method='simultaneous'",
        )
    check_refinable(start.known, unseen)
    if start.gears:
        raise IdentificationError(
            f"the deflection of {', '.join(start.gears)} was measured, and the refinement knows "
            "that between the encoders only: use the result of identify, or exclude that channel"
        )
    for joint in start.springs:
        estimate = start.drive_side[joint]
        is_known = "stiffness" not in estimate.names
        drive = start.known.drives[joint]
        stiffness = drive.values["stiffness"] if is_known else estimate.value("stiffness")
        if not (np.isfinite(stiffness) and stiffness > 0):
            raise IdentificationError(
                f"the refinement cannot start: the estimated stiffness of {joint} is "
                f"{stiffness:.3g}, and the simulation needs a positive one"
            )


_STATE_DRAWS = 8
"""Random errors of the initial states from which their part of the information is computed."""


def _noise_of_states(point: LogPoint) -> Array:
    """Return the information (p, p) that is noise of initial states which only torques determine.

    Where no encoder shows the joint, noise of the torque becomes motion of the estimated initial
    states, and the derivatives by a stiffness have a part that is noise.
    """
    rng, step = np.random.default_rng(0), point.step
    driven = [log for log in point.logs if isinstance(log, DrivenLog)]
    noise = np.zeros((len(point.x), len(point.x)))
    for _ in range(_STATE_DRAWS):
        states = [nuisance_draw(log.residuals, step.stds, rng) for log in driven]
        parts = []
        for log, drawn in zip(driven, states, strict=True):
            rows, moved = log.residuals, log.moved(point.x, 1.0, drawn).residuals
            parts.append(replace(rows, jacobian=moved.jacobian - rows.jacobian))
        noise += information(parts, step.stds) / _STATE_DRAWS
    return noise


def _spread(point: Point[Any], logs: Iterable[Any]) -> Array:
    """Return the square (p, p) of the change of the next step with other logs at its values."""
    change = replace(point, logs=tuple(logs)).step.change - point.step.change
    return np.outer(change, change)


def _of_noisy_deflections(layout: Layout, point: LogPoint, logs: Sequence[Log]) -> Array:
    """Return the covariance (p, p) by the effect of noisy deflections on hysteresis.

    As much noise as the deflections have is added to them: the mean square of the changes of the
    estimate is that of its error by the noise that they have (Cook and Stefanski 1994).
    """
    known, rng = layout.identification.known, np.random.default_rng(0)
    total = np.zeros((len(point.x), len(point.x)))
    for _ in range(_STATE_DRAWS if with_hysteresis(known, layout.simulated) else 0):
        noisy = (
            part.with_noise(logs, rng) if isinstance(part, DrivenLog) else part
            for part in point.logs
        )
        total += _spread(point, noisy) / _STATE_DRAWS
    return total


def _without_noise_of_rotors(layout: Layout, point: LogPoint, logs: Sequence[Log]) -> LogPoint:
    """Return the point without the bias by the noise in the accelerations of the motors.

    Noise in the column of an unknown rotor inertia makes it too small (errors in variables). As
    much noise of the encoders once more changes the estimate by as much again (Cook and Stefanski
    1994).
    """
    rng = np.random.default_rng(0)
    places = [layout.identification.known.index(joint) for joint in layout.unseen]
    bias = -point.step.change
    for _ in range(_STATE_DRAWS):
        noisy = [_with_motor_noise(log, places, rng) for log in logs]
        bias += point_at(layout, noisy, point.x).step.change / _STATE_DRAWS
    return point.moved(
        -bias, 1.0, [np.zeros_like(change) for change in point.step.nuisance_alone]
    ).settled()


def _with_motor_noise(log: Log, places: Sequence[int], rng: np.random.Generator) -> Log:
    """Return the log whose motor positions have the noise of their encoders once more."""
    rate_hz = (len(log.time) - 1) / (log.time[-1] - log.time[0])
    position = log.motor_position.copy()
    for place in places:
        std = np.sqrt(noise_density(position[:, place], rate_hz) * rate_hz / 2)
        position[:, place] += std * rng.normal(size=len(position))
    return replace(log, motor_position=position)


def _with_tests(layout: Layout, point: LogPoint) -> tuple[Layout, LogPoint]:
    """Return the point with terms that springs without encoder may lack, if they are identifiable.

    Their first step from zero is a score test (Rao 1948).
    """
    tested = tuple(
        (joint, order)
        for joint in layout.unseen
        for order in (1, 2)
        if order == 2 or Parameter("spring_damping", joint) not in layout.places
    )
    terms = (Parameter(f"deflection derivative {order}", joint) for joint, order in tested)
    wider = replace(layout, parameters=(*layout.parameters, *terms), tested=tested)
    x = np.append(point.x, np.zeros(len(tested)))
    try:
        wider_logs = tuple(log.with_layout(wider, x) for log in point.logs)
        wider_point = Point(wider.parameters, x, wider_logs)
        _ = wider_point.step
        return wider, wider_point
    except ExcitationError:
        return layout, point


def _tested_terms(wider: Layout, step: Step) -> dict[str, dict[int, Array]]:
    """Return {joint: {order: [value, standard error]}} of the tested terms, in units of (8)."""
    first = len(wider.parameters) - len(wider.tested)
    errors = np.sqrt(np.diag(step.covariance))
    tested_terms: dict[str, dict[int, Array]] = {joint: {} for joint in wider.unseen}
    for place, (joint, order) in enumerate(wider.tested, first):
        tested_terms[joint][order] = np.array([step.change[place], errors[place]])
    return tested_terms


def _moved(layout: Layout, run: Run, pull: Pull, change: Array, part: float, initial: Array) -> Run:
    """Return a run with its simulated joints after a part of a step."""
    known, motion = layout.identification.known, run.motion
    joints = [known.index(joint) for joint in layout.simulated]
    # q + part dq_0 + dq/dx change + Phi(t) s: the Newton correction dq_0 of (8), the change of the
    # parameters, and free motions Phi from the changes s of each window's initial state.
    response = pull.response(pull.force @ np.append(part, change)[:, None])
    states = []
    for state, moves in zip(
        motion.joint_states,
        (response.position, response.velocity, response.acceleration),
        strict=True,
    ):
        windowed = moves.reshape(run.windows, -1, *moves.shape[1:])
        weights = np.column_stack([np.ones(run.windows), initial])
        new = state.copy()
        new[:, joints] += np.einsum("wtjs,ws->wtj", windowed, weights).reshape(moves.shape[:2])
        states.append(new)
    if layout.has_zeros:
        others = [joint for joint in range(known.n) if joint not in joints]
        # Joints that are not simulated follow their encoders: q = reading - zero.
        states[0][:, others] -= change[layout.zeros][others]
    q, v, a = states
    moved = replace(motion, joint_position=q, joint_velocity=v, joint_acceleration=a)
    return replace(run, motion=moved)


def _of_constants(start: Identification, point: Point[Any]) -> Array:
    """Return the covariance (p, p) of a point by errors of the known constants.

    A constant changes the residuals at the same values, and the next step by its derivative.
    """
    total = np.zeros((len(point.x), len(point.x)))
    for constant in constants_of(start.known, start.known_std):
        changed = [log.with_constant(constant) for log in point.logs]
        total += (constant.std / STEP) ** 2 * _spread(point, changed)
    return total


def _refined(layout: Layout, point: LogPoint, step: Step) -> Identification:
    """Return the identification with the values of a point and the covariance of a step."""
    start, x = layout.identification, point.x
    step = replace(step, covariance=step.covariance + _of_constants(start, point))
    actuators, load_side = _estimates(layout, x, step)
    springs = FrozenMapping({joint: x[layout.spring(joint)] for joint in start.springs})
    start = replace(start, known=layout.known_at(x), springs=springs)
    return _with_estimates(start, actuators, load_side)


def _with_estimates(
    start: Identification, actuators: Mapping[str, Estimate], load_side: Estimate
) -> Identification:
    """Return an identification with estimates of (7) by joint, and of (8)."""
    refined = {**start.drive_side, **merged_estimates(actuators, load_side.by_owner())}
    drives = {joint: refined[joint] for joint in start.drive_side}
    robot = with_base_parameters(start, load_side.values)
    known = {
        joint: with_estimate(start.known.drives[joint], drives[joint]) if joint in drives else drive
        for joint, drive in robot.drives.items()
    }
    return replace(
        start,
        drive_side=FrozenMapping(drives),
        load=load_side.of_names(start.model.expressions),
        load_side=load_side,
        robot=robot.with_values(robot.parameters, known),
        findings=revalued(start.findings, drives),
    )


def _estimates(layout: Layout, at: Array, step: Step) -> tuple[dict[str, Estimate], Estimate]:
    """Return the estimates of elastic drives by joint, and of the load side, at values (p,)."""
    identification = layout.identification
    covariance, x = step.covariance.copy(), at.copy()
    # Without encoder offsets the prior of `_EXACT_RAD` alone determined these: they are known.
    fixed = [] if layout.has_zeros else [layout.offset(joint) for joint in layout.unseen]
    covariance[fixed], covariance[:, fixed], x[fixed] = 0.0, 0.0, 0.0
    whole = Estimate(
        names=tuple(parameter.name for parameter in layout.parameters),
        values=x,
        covariance=covariance,
        units=("",) * len(x),
        residual_std=float("nan"),
        condition_number=step.condition_number,
    )

    def part(old: Estimate, columns: slice, std: float) -> Estimate:
        new = whole.part(range(columns.start, columns.stop), old.names)
        return replace(new, units=old.units, residual_std=std, diagnostics=old.diagnostics)

    # Channels: s positions, s drives, followed joints; then, of what is not simulated, the drives
    # with a measured spring torque and the joints of (8).
    first, joints = len(layout.simulated), list(layout.simulated)
    end = 2 * first + len(layout.followed)
    stds = dict(zip(joints, step.stds[first:], strict=False))
    stds |= dict(zip(layout.sensed, step.stds[end:], strict=False))
    drives = {
        joint: part(layout.actuators[joint], columns, float(stds[joint]))
        for joint, columns in layout.drives.items()
    }
    rest = np.append(step.stds[2 * first : end], step.stds[end + len(layout.sensed) :])
    load_std = float(np.sqrt(np.mean((rest if rest.size else step.stds[:first]) ** 2)))
    return drives, part(identification.load_side, layout.load, load_std)
