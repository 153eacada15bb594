"""`refine`: maximum likelihood by output error, both sides at once, from an identification.

The measured motor angles (and the joints without a spring) are the input of the complete model:
the joints behind the springs are simulated by (8), and their encoders and all torques compared
with the measured ones. Motor encoders see the joint through a gear, so that their noise is far
below that of the joint encoders: as inputs they cost little accuracy, prevent drift, and need no
controller. Each window of the log has its own initial state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter1d

from seaid._arrays import Array, BoolArray, FrozenMapping, white_noise
from seaid._progress import track
from seaid.checks import (
    consequences,
    fixed_findings,
    nothing_to_simulate,
    revalued,
    worse_than_start,
)
from seaid.drives import (
    DefaultTerms,
    JointParameter,
    is_dry,
    parameter_named,
    readable,
    total_ratio,
)
from seaid.errors import ExcitationError, Finding, IdentificationError, checked
from seaid.estimation import (
    Estimate,
    Residuals,
    Step,
    gauss_newton_step,
    information,
    joined,
    nuisance_draw,
    without_information,
)
from seaid.identification.command_refinement import refine_commanded
from seaid.identification.drive_estimates import (
    TORQUE_OFFSET,
    merged_estimates,
    with_estimate,
    with_values,
)
from seaid.identification.motor_side import (
    SAMPLES,
    with_angles,
    with_joint_angles,
    with_motor_side_findings,
    with_rigid_angles,
    without_joint_encoder,
)
from seaid.identification.sensitivity import STEP, constants_of
from seaid.identification.simulated_joints import (
    Response,
    TorqueJacobians,
    check_refinable,
    finer_side,
    friction_corrections,
    hysteresis_corrections,
    response_to,
    smoothed,
    torque_jacobians,
    with_encoder_noise,
    with_hysteresis,
)
from seaid.identification.two_step import split_load_side, without_torque
from seaid.identification.validation import compared
from seaid.log import (
    POSITION_BAND,
    SHORTEST_STRETCH,
    Log,
    Motion,
    decimated,
    decimation,
    reconstruct_motion,
    reconstruct_motions,
    row_samples,
    still_speed,
    stretches,
    usable,
)
from seaid.regressor import (
    Regress,
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
"""Windows and most steps of a first estimate without joint encoders, see `motor_side`; its next
step [standard errors] from which longer windows go on."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Places of the parameters: `names` (p,) of all, and the columns of each kind.

    `simulated` are the joints behind springs, `unseen` those of them without an encoder behind the
    spring; `precision` (p,) are the inverse standard deviations of the prior, that of the encoder
    offsets. `nonlinear` {joint: {parameter: column}} are the drives whose equations are nonlinear
    in their parameters. `tested` are terms of springs that the model lacks, in the last columns: a
    torque of the joint by the derivative of this order of its deflection, with the factor zero.
    """

    identification: Identification
    simulated: tuple[str, ...]
    names: tuple[str, ...]
    drives: FrozenMapping[slice]
    load: slice
    zeros: slice
    precision: Array
    unseen: tuple[str, ...] = ()
    nonlinear: FrozenMapping[dict[str, int]] = field(default_factory=lambda: FrozenMapping({}))
    tested: tuple[tuple[str, int], ...] = ()

    def tests(self, motion: Motion) -> Iterator[tuple[int, str, Array]]:
        """Yield column, joint, and torque (T,) at the joint per unit of each tested term."""
        motors = motion.motor_position, motion.motor_velocity, motion.motor_acceleration
        loads = motion.joint_states
        for column, (joint, order) in enumerate(self.tested, len(self.names) - len(self.tested)):
            index, ratio = (
                self.identification.known.index(joint),
                total_ratio(self.identification.known.drives[joint]),
            )
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
    def has_zeros(self) -> bool:
        """Whether encoder offsets are estimated."""
        return bool(self.zeros.stop > self.zeros.start)

    @property
    def start(self) -> Array:
        """The values (p,) of the identification, with zero encoder offsets."""
        values = np.zeros(len(self.names))
        for joint, columns in self.drives.items():
            values[columns] = self.actuator(joint).values
        values[self.load] = self.identification.load_side.values
        if self.unseen and self.identification.feasible is not None:
            # an inertia that can be simulated
            consistent = self.identification.base.project(self.identification.robot.parameters)
            values[self.load][: len(consistent)] = consistent
        # It stands for the zero of the motor's encoder (`layout_of`), whose expectation is zero.
        values[[self.offset(joint) for joint in self.unseen]] = 0.0
        return values

    def actuator(self, joint: str) -> Estimate:
        """Return the identified parameters of a drive without those of the load side."""
        return _actuator_part(self.identification, joint)

    def spring(self, joint: str) -> list[int]:
        """Return the columns of a joint's spring, for a linear one stiffness and offset."""
        names = self.actuator(joint).names
        first = self.drives[joint].start
        spring_names = spring_regressor(self.identification.known, joint).names
        return [first + names.index(name) for name in spring_names]

    def offset(self, joint: str) -> int:
        """Return the column of the offset of a joint's spring."""
        return int(self.drives[joint].start) + self.actuator(joint).names.index("spring_offset")

    def known_at(self, x: Array) -> Robot:
        """Return the robot whose nonlinear drives are linearised at the values x (p,)."""
        known, drives = self.identification.known, {}
        for joint, columns in self.nonlinear.items():
            values = {name: float(x[column]) for name, column in columns.items()}
            for name in motor_regressor(known, joint).non_linear:
                if parameter_named(name).is_positive and values.get(name, 1.0) <= 0:
                    raise IdentificationError(
                        f"the {readable(JointParameter(name, joint))} would become negative"
                    )
            drives[joint] = with_values(known.drives[joint], values)
        return known.with_drives(drives) if drives else known


@dataclass(frozen=True, eq=False)
class Run:
    """Windows of a log at the present estimate: its motion with the simulated joints.

    `reading` (T, simulated) is the measured position of these joints, `still` (T, simulated and
    followed) masks samples at which the friction of their motors is unknown; `block` samples make a
    row; `log` is the number of the log. `measured` is the motion by the encoders, from the start of
    the log to the end of the windows.
    """

    motion: Motion
    reading: Array
    still: BoolArray
    windows: int
    block: int
    log: int
    measured: Motion


_EXACT_RAD = 1e-7
"""Standard deviation of a motor's encoder offset, seen at the joint, that counts as zero."""


def _actuator_part(identification: Identification, joint: str) -> Estimate:
    """Return the parameters of a drive by (7); a parallel spring and joint friction are in (8)."""
    whole, load = identification.drive_side[joint], identification.model.names
    names = [name for name in whole.names if f"{name} of {joint}" not in load]
    return whole.part([whole.names.index(name) for name in names], names)


def layout_of(
    start: Identification, encoder_offset_std: float, unseen: tuple[str, ...] = ()
) -> Layout:
    """Return the places of the parameters of an identification in one vector.

    The spring offset of an `unseen` joint is k r_L times the zero of its motor's encoder, which the
    joint's angle follows: it turns gravity, and is known as well as that zero.
    """
    robot = start.known
    names: list[str] = []
    drives: dict[str, slice] = {}
    for joint in robot.elastic_joints:
        drive_names = _actuator_part(start, joint).names
        drives[joint] = slice(len(names), len(names) + len(drive_names))
        names += [f"{name} of {joint}" for name in drive_names]
    load = slice(len(names), len(names) + len(start.model.names))
    names += start.model.names
    zeros = slice(len(names), len(names) + (robot.n if encoder_offset_std else 0))
    names += (
        [f"encoder zero of {joint}" for joint in robot.joint_names] if encoder_offset_std else []
    )
    precision = np.zeros(len(names))
    precision[zeros] = 1 / encoder_offset_std if encoder_offset_std else 0.0
    for joint in unseen:
        estimate = _actuator_part(start, joint)
        # F = k r_L dq: the standard deviation of the spring's force by that of the zero dq.
        force = estimate.value("stiffness") * robot.drives[joint].load_radius
        place = drives[joint].start + estimate.names.index("spring_offset")
        precision[place] = 1 / (force * max(encoder_offset_std, _EXACT_RAD))
    return Layout(
        identification=start,
        simulated=tuple(joint for joint in start.model.torque_joints if joint in start.springs),
        names=tuple(names),
        drives=FrozenMapping(drives),
        load=load,
        zeros=zeros,
        precision=precision,
        unseen=unseen,
        nonlinear=FrozenMapping(_nonlinear_drives(robot, names)),
    )


def _nonlinear_drives(robot: Robot, names: Sequence[str]) -> dict[str, dict[str, int]]:
    """Return {joint: {parameter: column}} of the drives with nonlinear parameters in `names`."""
    nonlinear = {}
    for joint, drive in robot.drives.items():
        columns = {
            name: names.index(f"{name} of {joint}")
            for name in drive.parameter_names
            if f"{name} of {joint}" in names
        }
        if columns.keys() & {*motor_regressor(robot, joint).non_linear}:
            nonlinear[joint] = columns
    return nonlinear


_MOST_ENTRIES = 1_000_000
"""Entries of the response of the joints in memory at a time, of 20 or so arrays of this size."""


def runs_of(layout: Layout, log: Log, number: int = 0, window_s: float = WINDOW_S) -> list[Run]:
    """Return a log without gaps, with the wider cutoff, in parts of whole windows."""
    if not layout.simulated:
        return []
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
    per_window = window * len(simulated) * (1 + len(layout.names) + 2 * len(simulated))
    most = max(1, _MOST_ENTRIES // max(per_window, 1))
    runs = []
    for start in range(0, windows, most):
        count = min(most, windows - start)
        first = transient + start * window
        part = slice(first, first + count * window)
        reading = motion.joint_position[part, simulated]
        # The state of a spring's hysteresis depends on the whole past, not on the window alone.
        before = motion.samples(slice(part.stop))
        runs.append(Run(motion.samples(part), reading, still[part], count, block, number, before))
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
    if is_noisy or any("motor_inertia" in layout.actuator(x).names for x in layout.unseen):
        return finer_side(known, reconstruct_motion(known, log, start.cutoff_hz))
    return motion


def _zeros(layout: Layout, x: Array) -> Array:
    """Return the encoder offsets (n,), zero if they are not estimated."""
    return x[layout.zeros] if layout.has_zeros else np.zeros(layout.identification.known.n)


def robot_at(layout: Layout, x: Array) -> Robot:
    """Return the identified robot with the base parameters of x."""
    base, robot = layout.identification.base, layout.identification.robot
    load = x[layout.load][: len(base.columns)]
    # The standard parameters of least change that have these base parameters (14); a simulation
    # depends on the base parameters only.
    correction = base.least(load - base.project(robot.parameters))
    return robot.with_values(robot.parameters + correction, robot.drives)


def measured(layout: Layout, log: Log) -> Callable[[Array], Residuals]:
    """Return the residuals of what is not simulated, as a function of the parameters x (p,)."""
    motion = reconstruct_motion(layout.identification.known, log, layout.identification.cutoff_hz)
    motion = finer_side(layout.identification.known, motion)
    linear = _measured_near(layout, motion, layout.start)

    def at(x: Array) -> Residuals:
        residuals = _measured_near(layout, motion, x) if layout.nonlinear else linear
        return replace(residuals, residual=residuals.residual + residuals.jacobian @ x)

    return at


def _measured_near(layout: Layout, motion: Motion, x: Array) -> Residuals:
    """Return what is not simulated, linearised at x (p,), at parameters of zero.

    These are the torques of stiff joints, and the drives of springs with a measured torque. Their
    columns have the noise of the encoders, so that both sides are filtered as in `identify`. The
    effect of encoder offsets is that at the start.
    """
    known, model, start = layout.known_at(x), layout.identification.model, layout.start
    drives = [joint for joint in layout.drives if joint not in layout.simulated]
    others = [joint for joint in model.torque_joints if joint not in layout.simulated]
    others = [] if layout.unseen else others
    equations: list[tuple[Regress, slice, list[str]]] = [
        (partial(actuator_regression, known, joint=joint), layout.drives[joint], [joint])
        for joint in drives
    ]
    zero = without_torque(known, layout.simulated)
    equations.append(
        (partial(load_regression, known, model=model, springs=zero), layout.load, others)
    )
    samples = row_samples(motion)
    instants = motion.time[samples]
    shape = (1, len(instants), len(drives) + len(others))
    residual, jacobian = np.zeros(shape), np.zeros((*shape, len(start)))
    kept, channel = np.zeros(shape, dtype=bool), 0
    for regress, columns, joints in equations if shape[2] else []:
        rows = regress(motion)
        if columns != layout.load:
            _check_columns(layout, rows.names, joints[0])
        if layout.has_zeros:
            rows = offset_sensitivity(known, motion, regress, start[columns])
        for joint in joints:
            of_joint = rows.joint == known.index(joint)
            # Rows near standstill are missing: others are placed by time, 1e-9 s against rounding.
            places = np.searchsorted(instants, rows.time[of_joint] - 1e-9)
            # The rows are at twice the Nyquist rate of the filter: every second one counts, so that
            # white noise below the cutoff is uncorrelated from row to row.
            kept[0, places[places % 2 == 0], channel] = True
            residual[0, places, channel] = rows.y[of_joint]
            jacobian[0, places, channel, columns] = -rows.H[of_joint]
            if layout.has_zeros:
                jacobian[0, places, channel, layout.zeros] = -rows.propagated[of_joint]
            channel += 1
    simulated = 2 * len(layout.simulated) + len(layout.followed)
    return Residuals(
        residual=residual,
        jacobian=jacobian,
        nuisance=np.zeros((*shape, 0)),
        kept=kept,
        time=instants[None],
        channels=range(simulated, simulated + shape[2]),
    )


def linearised(layout: Layout, run: Run, x: Array) -> tuple[Residuals, Pull]:
    """Return the residuals of the simulated joints around x, and what pulls at these joints.

    Channels: positions of the simulated joints, torques of their drives, those of followed joints.
    """
    known, motion = layout.known_at(x), run.motion
    places = {name: place for place, name in enumerate(layout.names)}
    springs = hysteresis_corrections(known, layout.simulated, motion, run.measured, places, x)
    frictions, slopes = friction_corrections(known, layout.simulated, motion, places, x)
    load = _load_error(layout, known, run, x)
    for joint, torque in (*springs.items(), *frictions.items()):
        # A correction of the torque on the joint is in (8) with its sign, and in (7), through the
        # gear, with the opposite one (below); joint friction is in (8) alone.
        load.columns[:, load.joints.index(joint)] += torque
    pull = _pull(layout, known, run, x, load, slopes)
    response = pull.response(pull.force)
    joints = [known.index(joint) for joint in layout.simulated]
    encoder = -response.position
    # y - q - z, where q is the present motion plus its Newton correction, the first column.
    encoder[:, :, 0] += run.reading - motion.joint_position[:, joints]
    if layout.has_zeros:
        zeros = [1 + layout.zeros.start + joint for joint in joints]
        encoder[:, :, 0] -= x[layout.zeros][joints]
        encoder[:, range(len(joints)), zeros] -= 1.0
    drives = _drive_error(layout, known, run, x, response)
    for joint, torque in springs.items():
        ratio = total_ratio(known.drives[joint])
        drives[:, layout.simulated.index(joint), : torque.shape[1]] -= torque / ratio
    columns = np.concatenate([encoder, drives, _followed(layout, load, response)], axis=1)
    seen = np.isin(layout.simulated, layout.unseen)
    # A joint without an encoder has no measured position: its rows never count. Positions of
    # the others count at standstill too, where only the torques are unknown.
    unknown = np.hstack([np.broadcast_to(seen, (len(columns), len(joints))), run.still])
    if motion.bridged is not None:  # what was interpolated over a gap was not measured
        unknown |= motion.bridged[:, None]
    return _blocks(run, columns, unknown, 2 * len(joints)), pull


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


def _pull(layout: Layout, known: Robot, run: Run, x: Array, load: LoadError, dry: Array) -> Pull:
    """Return what pulls at the joints, with the slopes `dry` (T, simulated) of dry friction."""
    joints = [known.index(joint) for joint in layout.simulated]
    stiffness, damping = _drive_slopes(layout, known, run.motion, x)
    damping = damping + dry[:, :, None] * np.eye(len(joints))
    inside = load.jacobians.part(joints, joints).plus(stiffness, damping)
    return Pull(inside, load.rows(layout.simulated), 1 / run.motion.rate_hz, run.windows)


def _drive_slopes(layout: Layout, known: Robot, motion: Motion, x: Array) -> tuple[Array, Array]:
    """Return the decrease of the drives' load torques with position and speed, (T, s, s) each."""
    model, eye = layout.identification.model, np.eye(len(layout.simulated))
    simulated = [model.torque_joints.index(joint) for joint in layout.simulated]
    springs = {joint: x[layout.spring(joint)] for joint in layout.identification.springs}
    torques = [
        drive_torques(known, variant, model, springs, x[layout.load])[:, simulated]
        for variant in (
            motion,
            replace(motion, joint_position=motion.joint_position + _NUDGE),
            replace(motion, joint_velocity=motion.joint_velocity + _NUDGE),
        )
    ]
    # A diagonal: the torque of a drive depends on its own joint, so that one nudge of all joints
    # at once gives all slopes. `refine` refuses coupled drives, for which this is not so.
    by_position, by_velocity = (
        (torques[0] - torque)[:, :, None] / _NUDGE * eye for torque in torques[1:]
    )
    return by_position, by_velocity


def _followed(layout: Layout, load: LoadError, response: Response) -> Array:
    """Return the residuals of (8) of the followed joints and their derivatives, as `response`."""
    known = layout.identification.known
    followed, moving = (
        [known.index(joint) for joint in joints] for joints in (layout.followed, layout.simulated)
    )
    columns = -load.jacobians.part(followed, moving).change(response)
    rows = load.rows(layout.followed)
    columns[:, :, : rows.shape[2]] += rows
    return columns


@dataclass(frozen=True, eq=False)
class LoadError:
    """Residuals of (8) and their derivatives by x (T, joints, 1 + p), and of torques by motion."""

    joints: tuple[str, ...]
    columns: Array
    jacobians: TorqueJacobians

    def rows(self, joints: Sequence[str]) -> Array:
        """Return the columns (T, joints, 1 + p) of some joints."""
        return np.asarray(self.columns[:, [self.joints.index(joint) for joint in joints]])


def _load_error(layout: Layout, known: Robot, run: Run, x: Array) -> LoadError:
    """Return the residuals of (8) of all joints with a torque, and their derivatives."""
    identification, motion = layout.identification, run.motion
    springs = {joint: x[layout.spring(joint)] for joint in identification.springs}
    torque, payload, H, propagated = load_columns(known, motion, identification.model, springs)
    jacobians = torque_jacobians(robot_at(layout, x), *motion.joint_states)
    by_x = np.zeros((*torque.shape, len(x)))
    by_x[:, :, layout.load] = -H
    columns = [column for joint in layout.simulated for column in layout.spring(joint)]
    by_x[:, :, columns] = propagated
    if layout.has_zeros:
        rows, joints = (
            [known.index(joint) for joint in names]
            for names in (identification.model.torque_joints, layout.simulated)
        )
        # q = reading - zero, so that -tau(q) changes by +dtau/dq per unit of the zero. Positions
        # of simulated joints do not depend on the zero of their encoders, their outputs do.
        by_x[:, :, layout.zeros] = jacobians.position[:, rows]
        by_x[:, :, [layout.zeros.start + joint for joint in joints]] = 0.0
    for column, joint, unit in layout.tests(motion):
        by_x[:, identification.model.torque_joints.index(joint), column] = unit
    error = torque - payload - H @ x[layout.load]
    whole = np.concatenate([error[:, :, None], by_x], axis=2)
    return LoadError(identification.model.torque_joints, whole, jacobians)


def _motor_columns(
    layout: Layout, known: Robot, motion: Motion, joint: str
) -> tuple[tuple[str, ...], Array, Array]:
    """Return names, zeta and R of (7), with a column for the torque offset if it was identified."""
    regressor, zeta, R = actuator_columns(known, motion, joint)
    if TORQUE_OFFSET not in layout.actuator(joint).names:
        return regressor.names, zeta, R
    return (*regressor.names, TORQUE_OFFSET), zeta, np.column_stack([R, np.ones(len(zeta))])


def _drive_error(layout: Layout, known: Robot, run: Run, x: Array, response: Response) -> Array:
    """Return the residuals of (7) and their derivatives (T, simulated, 1 + p + s)."""
    motion = run.motion
    residuals = np.zeros_like(response.position)
    nudged = (
        (response.position, replace(motion, joint_position=motion.joint_position + _NUDGE)),
        (response.velocity, replace(motion, joint_velocity=motion.joint_velocity + _NUDGE)),
    )
    for row, joint in enumerate(layout.simulated):
        columns = layout.drives[joint]
        names, zeta, R = _motor_columns(layout, known, motion, joint)
        _check_columns(layout, names, joint)
        residuals[:, row, 0] = zeta - R @ x[columns]
        residuals[:, row, 1 + columns.start : 1 + columns.stop] = -R
        unchanged = residuals[:, row, 0].copy()
        for change, moved in nudged:
            _, zeta, R = _motor_columns(layout, known, moved, joint)
            slope = (zeta - R @ x[columns] - unchanged) / _NUDGE
            # Chain rule d(7)/dx + d(7)/dq dq/dx + d(7)/dv dv/dx; (7) has no joint acceleration.
            # The first column is the change by the Newton correction of the joint.
            residuals[:, row] += slope[:, None] * change[:, row]
    for column, joint, unit in layout.tests(motion):
        ratio = total_ratio(known.drives[joint])
        # A torque on the joint loads its motor, through the gear.
        residuals[:, layout.simulated.index(joint), 1 + column] -= unit / ratio
    return residuals


def _check_columns(layout: Layout, names: tuple[str, ...], joint: str) -> None:
    """Raise IdentificationError if a log has other torque sensors than the identification."""
    identified = layout.actuator(joint).names
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
    return np.asarray(maximum_filter1d(still.astype(np.uint8), 2 * seen + 1) > 0)


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
_MOST_HALVINGS, _MOST_SWEEPS = 6, 5
_EQUAL_MERIT = 1e-3
"""Difference below which log-likelihoods count as equal."""


@dataclass(frozen=True, eq=False)
class Point:
    """A point of the iteration: parameters (p,), runs, the pull at their joints, the next step.

    `measured` are the residuals per log of what is not simulated, as functions of the parameters.
    """

    x: Array
    runs: list[Run]
    pulls: list[Pull]
    step: Step
    measured: list[Callable[[Array], Residuals]]


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
    _check_start(identification, without_joint_encoder(identification.known, logs))
    if identification.known.has_controllers:
        refined, reason, evidence = refine_commanded(identification, logs, iterations, progress)
        return _unchanged(identification, reason, evidence) if reason else refined
    return refined_with_logs(identification, logs, encoder_offset_std, iterations, progress)[0]


def refined_with_logs(
    identification: Identification,
    logs: list[Log],
    encoder_offset_std: float,
    iterations: int = 20,
    progress: bool = False,
) -> tuple[Identification, list[Log]]:
    """Return the result of `refine`, and the logs with the simulated angles of unseen joints."""
    unseen = without_joint_encoder(identification.known, logs)
    layout = layout_of(identification, encoder_offset_std, unseen)
    if not (layout.simulated or encoder_offset_std):
        return _with_finding(identification, nothing_to_simulate()), logs
    # Angles without an encoder come from (7), and the errors of a poor start accumulate over a
    # window: an iteration in short windows comes first.
    simulated, first = _filled(layout, logs, layout.start), layout.start
    if unseen:
        _, point = _iterated(layout, simulated, first, iterations, progress, SHORT_WINDOW_S)
        simulated, first = _simulated_logs(layout, logs, point), point.x
    start, point = _iterated(layout, simulated, first, iterations, progress)
    # `not <` also refuses NaN.
    if not _size(point.step) < _CLOSE:
        held = _held(identification, layout, point)
        if held is not None:
            return refined_with_logs(held, logs, encoder_offset_std, iterations, progress)
        raise IdentificationError(
            f"the refinement did not converge in {iterations} iterations: its next step would be "
            f"{_size(point.step):.2g} standard errors; use the result of identify, if the logs and "
            "the identification belong together"
        )
    if unseen:
        wider, wider_point = _with_tests(layout, point)
        noise, p = _noise_of_states(wider, wider_point), len(point.x)
        terms = _tested_terms(wider, wider_point, noise)
        refined = with_motor_side_findings(
            _refined(layout, point, logs, noise[:p, :p]), terms, point.runs[0].motion
        )
        return refined, _simulated_logs(layout, logs, point)
    point = _with_noisy_deflections(layout, point, logs)
    refined = _refined(layout, point, logs)
    reason, evidence = _worse(identification, refined, logs, _zeros(layout, point.x))
    if point.step.merit > start.step.merit + _EQUAL_MERIT:
        reason = "its likelihood is lower than that of the start"
    if reason:
        return _unchanged(identification, reason, evidence), logs
    return refined, logs


def _held(start: Identification, layout: Layout, point: Point) -> Identification | None:
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
        kept = [name for name in estimate.names if name not in weak]
        notes += consequences(
            start.findings, fixed_findings(joint, drive, weak, by_simulation=True)
        )
        sides[joint] = estimate.part(list(map(estimate.names.index, kept)), kept)
        known[joint] = replace(drive, known=(*drive.known, *weak))
    if known == dict(start.known.drives):
        return None
    return replace(
        start,
        known=start.known.with_drives(known),
        drive_side=FrozenMapping(sides),
        findings=(*start.findings, *notes),
    )


def simulated_from_motors(identification: Identification, log: Log) -> Log:
    """Return a log with the angles of joints without a sensor there, simulated by the model.

    The motors turn as measured; only the initial state of each window is fitted to their torques.
    """
    unseen = without_joint_encoder(identification.known, [log])
    if not unseen:
        return log
    _check_start(identification, unseen)
    layout = layout_of(identification, 0.0, unseen)
    _, point = _iterated(layout, _filled(layout, [log], layout.start), layout.start, 0, False)
    return _simulated_log(layout, log, point.runs)


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
    layout = layout_of(identification, 0.0, without_joint_encoder(identification.known, logs))
    x = layout.start
    for joint in layout.unseen:  # the angles of the start are those of a spring without damping
        if "spring_damping" in layout.actuator(joint).names:
            damping = layout.names.index(f"spring_damping of {joint}")
            x[damping] = identification.known.drives[joint].values.get("spring_damping", 0.0)
    filled = _filled(layout, logs, x)
    _, point = _iterated(layout, filled, x, _FIRST_STEPS, False, SHORT_WINDOW_S)
    # Channels: the s positions of simulated joints, then the torques of their s drives.
    channels = len(layout.simulated) + np.flatnonzero(np.isin(layout.simulated, layout.unseen))
    noise = [
        max(
            np.hypot(*_motor_noise(identification, joint, log, run.motion))
            for log in logs
            for run in point.runs
        )
        for joint in layout.unseen
    ]
    if any(point.x[layout.spring(joint)[0]] <= 0 for joint in layout.unseen):
        raise IdentificationError("the search of the stiffness ended below zero")
    at_noise = point.step.stds[channels] <= _AT_NOISE * np.maximum(noise, _SMALLEST_TORQUE)
    simulated = _simulated_logs(layout, logs, point)
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


def _iterated(
    layout: Layout,
    logs: list[Log],
    x: Array,
    iterations: int,
    progress: bool,
    window_s: float = WINDOW_S,
) -> tuple[Point, Point]:
    """Return the first and the last point of an iteration from the values x (p,)."""
    settled = _SETTLED if window_s == WINDOW_S else _CLOSE_TO_LONGER
    parts = enumerate(_parts(layout, logs))
    runs = list(chain(*(runs_of(layout, part, k, window_s) for k, part in parts)))
    fixed = _measured_parts(layout, logs)
    start = point = _simulated(layout, _point(layout, runs, fixed, x))
    for _ in track(range(iterations), "refining", progress):
        point, better = _improved(layout, point)
        if _size(point.step) < settled or not better:
            break
    return start, point


def _parts(layout: Layout, logs: Sequence[Log]) -> list[Log]:
    """Return the parts of logs without gaps that are long enough."""
    shortest_s = SHORTEST_STRETCH / layout.identification.cutoff_hz
    return [part for log in logs for part in stretches(usable(log), shortest_s)]


def _measured_parts(layout: Layout, logs: Sequence[Log]) -> list[Callable[[Array], Residuals]]:
    """Return the residuals of what is not simulated, if there is any, per part of the logs."""
    compared = {*layout.simulated, *layout.followed}
    if not {*layout.drives, *layout.identification.model.torque_joints} - compared:
        return []
    return [measured(layout, part) for part in _parts(layout, logs)]


def _filled(layout: Layout, logs: list[Log], x: Array) -> list[Log]:
    """Return the logs with the angles of unseen joints by (7) at the values x (p,)."""
    known, cutoff_hz = layout.identification.known, layout.identification.cutoff_hz
    drives = {
        joint: dict(zip(layout.actuator(joint).names, x[layout.drives[joint]], strict=True))
        for joint in layout.unseen
    }
    return [with_joint_angles(known, log, drives, cutoff_hz) if drives else log for log in logs]


def _simulated_logs(layout: Layout, logs: Sequence[Log], point: Point) -> list[Log]:
    """Return the simulated parts of logs with the simulated angles of the unseen joints."""
    return [_simulated_log(layout, log, point.runs) for log in logs]


def _simulated_log(layout: Layout, log: Log, runs: list[Run]) -> Log:
    """Return the simulated part of the log with the simulated angles of the unseen joints."""
    robot = layout.identification.known
    parts = [run.motion for run in runs if log.time[0] <= run.motion.time[0] <= log.time[-1]]
    filled = with_angles(robot, with_rigid_angles(robot, log, layout.unseen), parts, layout.unseen)
    return filled.between(parts[0].time[0], parts[-1].time[-1])


_WORSE, _WORSE_SHARE = 1.5, 0.02
"""A joint is predicted worse if the rms error of its torque grows by this factor, and by this share
of the torque. Without model errors the factor is at most 1.2 (`scripts/benchmarks/output_error.py`,
cutoffs of 2 to 12 Hz): the likelihood weights other channels than the regression does.
"""


def _worse(
    before: Identification, after: Identification, logs: list[Log], zeros: Array
) -> tuple[str, dict[str, float]]:
    """Return which torque the refined values predict worse than the start, and the numbers."""
    motions = [
        part for log in logs for part in reconstruct_motions(before.known, log, before.cutoff_hz)
    ]
    old, size = _torque_errors(before, motions)
    shifted = [replace(motion, joint_position=motion.joint_position - zeros) for motion in motions]
    new, _ = _torque_errors(after, shifted)
    with np.errstate(invalid="ignore"):
        is_worse = (new > _WORSE * old) & (new - old > _WORSE_SHARE * size)
        worst = int(np.argmax(np.where(is_worse, new / old, 0.0)))
    if not is_worse[worst]:
        return "", {}
    # (2 n,): the motor torques, then the load torques.
    side, joint = divmod(worst, before.known.n)
    shares = {"error before": old[worst] / size[worst], "error after": new[worst] / size[worst]}
    return (
        f"the error of the {('motor', 'load')[side]} torque of {before.known.joint_names[joint]} "
        f"would grow from {shares['error before']:.1%} to {shares['error after']:.1%}"
    ), {name: float(share) for name, share in shares.items()}


def _torque_errors(identification: Identification, motions: list[Motion]) -> tuple[Array, Array]:
    """Return the rms errors (2 n,) of motor and load torques below the cutoff, and their rms.

    NaN where no sample counts.
    """
    squares, count = np.zeros((2, 2, identification.known.n)), np.zeros((2, identification.known.n))
    for motion in motions:
        fits = compared(identification, motion)
        for side, fit in enumerate((fits.actuator, fits.load)):
            pair = np.stack([fit.measured - fit.computed, fit.measured])
            squares[:, side] += np.sum(pair**2, axis=1, where=fit.counted)
            count[side] += np.sum(fit.counted, axis=0)
    with np.errstate(invalid="ignore"):
        error, size = np.sqrt(squares / count).reshape(2, -1)
    return error, size


def _unchanged(start: Identification, reason: str, evidence: dict[str, float]) -> Identification:
    """Return the start with the reason why it is not replaced."""
    return _with_finding(start, worse_than_start(reason, evidence))


def _with_finding(start: Identification, finding: Finding) -> Identification:
    return replace(start, findings=(*start.findings, *consequences(start.findings, [finding])))


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


def _point(
    layout: Layout, runs: list[Run], fixed: list[Callable[[Array], Residuals]], x: Array
) -> Point:
    residuals, pulls = _linear_runs(layout, runs, x)
    residuals += [residuals_at(x) for residuals_at in fixed]
    step = gauss_newton_step(residuals, layout.names, x, layout.precision)
    return Point(x, runs, pulls, step, fixed)


_LARGEST = 1e100
"""Size from which a simulation diverges: squares of what is larger overflow."""


def _linear_runs(layout: Layout, runs: list[Run], x: Array) -> tuple[list[Residuals], list[Pull]]:
    """Return the residuals of the simulated joints of each log, and the pull in each run."""
    diverges = "the simulation diverges at this estimate: check the identification it starts from"
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            around = [linearised(layout, run, x) for run in runs]
    except IdentificationError as problem:
        raise IdentificationError(f"{diverges}; {problem}") from None
    sizes = [part for rows, _ in around for part in (rows.residual, rows.jacobian, rows.nuisance)]
    if not all(np.all(np.abs(size) < _LARGEST) for size in sizes):
        raise IdentificationError(diverges)
    by_log: dict[int, list[Residuals]] = {}
    for run, (rows, _) in zip(runs, around, strict=True):
        by_log.setdefault(run.log, []).append(rows)
    return [joined(by_log[log]) for log in sorted(by_log)], [pull for _, pull in around]


def _size(step: Step) -> float:
    """Return the largest change of a parameter in standard errors."""
    return float(np.max(np.abs(step.change) / np.sqrt(np.diag(step.white_covariance))))


def _improved(layout: Layout, point: Point) -> tuple[Point, bool]:
    """Return the next point, the step halved until the likelihood improves; and if it did."""
    part = 1.0
    for _ in range(_MOST_HALVINGS):
        change = part * point.step.change
        with suppress(IdentificationError, ExcitationError):  # it diverges there
            trial = _simulated(layout, _next(layout, point, change, part, point.step.nuisance))
            if trial.step.merit <= point.step.merit + _EQUAL_MERIT:
                return trial, True
        part /= 2
    return point, False


def _simulated(layout: Layout, point: Point) -> Point:
    """Return the point with its joints simulated to satisfy (8), by Newton's method."""
    for _ in range(_MOST_SWEEPS):
        new = _next(layout, point, np.zeros_like(point.x), 1.0, point.step.own)
        settled = abs(new.step.merit - point.step.merit) < _EQUAL_MERIT
        point = new
        if settled:
            break
    return point


def _next(
    layout: Layout, point: Point, change: Array, part: float, initial: tuple[Array, ...]
) -> Point:
    """Return the point after a change of the parameters and a part of the initial states'."""
    runs = _runs_after(layout, point, change, part, initial)
    return _point(layout, runs, point.measured, point.x + change)


def _runs_after(
    layout: Layout, point: Point, change: Array, part: float, initial: Sequence[Array]
) -> list[Run]:
    states = iter([row for log in initial for row in log])  # per window, in the order of the runs
    return [
        _moved(
            layout, run, pull, change, part, np.array([next(states) for _ in range(run.windows)])
        )
        for run, pull in zip(point.runs, point.pulls, strict=True)
    ]


_STATE_DRAWS = 8
"""Random errors of the initial states from which their part of the information is computed."""


def _noise_of_states(layout: Layout, point: Point) -> Array:
    """Return the information (p, p) that is noise of initial states which only torques determine.

    Where no encoder shows the joint, noise of the torque becomes motion of the estimated initial
    states, and the derivatives by a stiffness have a part that is noise.
    """
    rng, step = np.random.default_rng(0), point.step
    logs, _ = _linear_runs(layout, point.runs, point.x)
    noise = np.zeros((len(point.x), len(point.x)))
    for _ in range(_STATE_DRAWS):
        states = [nuisance_draw(log, step.stds, rng) for log in logs]
        runs = _runs_after(layout, point, np.zeros_like(point.x), 1.0, states)
        drawn, _ = _linear_runs(layout, runs, point.x)
        parts = [
            replace(a, jacobian=b.jacobian - a.jacobian) for a, b in zip(logs, drawn, strict=True)
        ]
        noise += information(parts, step.stds) / _STATE_DRAWS
    return noise


def _with_noisy_deflections(layout: Layout, point: Point, logs: list[Log]) -> Point:
    """Return the point with the effect of noisy deflections on hysteresis in its covariance.

    As much noise as the deflections have is added to them: the mean square of the changes of the
    estimate is that of its error by the noise that they have (Cook and Stefanski 1994).
    """
    known = layout.identification.known
    if not with_hysteresis(known, layout.simulated):
        return point
    rng, total = np.random.default_rng(0), np.zeros((len(point.x), len(point.x)))
    for _ in range(_STATE_DRAWS):
        runs = [
            replace(run, measured=with_encoder_noise(known, run.measured, logs, rng))
            for run in point.runs
        ]
        change = _point(layout, runs, point.measured, point.x).step.change - point.step.change
        total += np.outer(change, change) / _STATE_DRAWS
    step = replace(point.step, covariance=point.step.covariance + total)
    return replace(point, step=step)


def _with_tests(layout: Layout, point: Point) -> tuple[Layout, Point]:
    """Return the point with terms that springs without encoder may lack, if they are identifiable.

    Their first step from zero is a score test (Rao 1948).
    """
    tested = tuple(
        (joint, order)
        for joint in layout.unseen
        for order in (1, 2)
        if order == 2 or "spring_damping" not in layout.actuator(joint).names
    )
    more = np.zeros(len(tested))

    def padded(residuals_at: Callable[[Array], Residuals]) -> Callable[[Array], Residuals]:
        def at(x: Array) -> Residuals:
            rows = residuals_at(x[: len(point.x)])
            none = np.zeros((*rows.residual.shape, len(more)))
            return replace(rows, jacobian=np.concatenate([rows.jacobian, none], axis=3))

        return at

    wider = replace(
        layout,
        names=(*layout.names, *(f"order {order} of {joint}" for joint, order in tested)),
        precision=np.append(layout.precision, more),
        tested=tested,
    )
    try:
        measured = [padded(residuals_at) for residuals_at in point.measured]
        return wider, _point(wider, point.runs, measured, np.append(point.x, more))
    except ExcitationError:
        return layout, point


def _tested_terms(wider: Layout, point: Point, noise: Array) -> dict[str, dict[int, Array]]:
    """Return {joint: {order: [value, standard error]}} of the tested terms, in units of (8)."""
    step, first = without_information(point.step, noise), len(wider.names) - len(wider.tested)
    errors = np.sqrt(np.diag(step.covariance))
    tested_terms: dict[str, dict[int, Array]] = {joint: {} for joint in wider.unseen}
    for place, (joint, order) in enumerate(wider.tested, first):
        tested_terms[joint][order] = np.array([step.change[place], errors[place]])
    return tested_terms


def _moved(layout: Layout, run: Run, pull: Pull, change: Array, part: float, initial: Array) -> Run:
    """Return a run with its simulated joints after a part of a step."""
    known, motion = layout.identification.known, run.motion
    joints = [known.index(joint) for joint in layout.simulated]
    # q + part dq_0 + dq/dx change + part Phi(t) s: the Newton correction dq_0 of (8), the change
    # of the parameters, and free motions Phi from the changes s of each window's initial state.
    response = pull.response(pull.force @ np.append(part, change)[:, None])
    states = []
    for state, moves in zip(
        motion.joint_states,
        (response.position, response.velocity, response.acceleration),
        strict=True,
    ):
        windowed = moves.reshape(run.windows, -1, *moves.shape[1:])
        weights = np.column_stack([np.ones(run.windows), part * initial])
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


def _of_constants(layout: Layout, point: Point, logs: Sequence[Log]) -> Array:
    """Return the covariance (p, p) of a point by errors of the known constants.

    A constant changes the residuals at the same values, and the next step by its derivative.
    """
    start, total = layout.identification, np.zeros((len(point.x), len(point.x)))
    for constant in constants_of(start.known, start.known_std):
        changed = replace(layout, identification=replace(start, known=constant.robot))
        runs = [
            replace(run, motion=constant.scaled(run.motion), measured=constant.scaled(run.measured))
            for run in point.runs
        ]
        others = _measured_parts(changed, [constant.scaled(log) for log in logs])
        change = _point(changed, runs, others, point.x).step.change - point.step.change
        total += (constant.std / STEP) ** 2 * np.outer(change, change)
    return total


def _refined(
    layout: Layout, point: Point, logs: Sequence[Log], noise: Array | None = None
) -> Identification:
    """Return the identification with the values of a point, less information that is noise."""
    start, x = layout.identification, point.x
    step = point.step if noise is None else without_information(point.step, noise)
    step = replace(step, covariance=step.covariance + _of_constants(layout, point, logs))
    actuators, load_side = _estimates(layout, point.x, step)
    load, load_drives = split_load_side(start.model, load_side)
    refined = merged_estimates(actuators, load_drives)
    drives = {joint: refined[joint] for joint in start.drive_side}
    robot = robot_at(layout, x)
    known = {
        joint: with_estimate(start.known.drives[joint], drives[joint]) if joint in drives else drive
        for joint, drive in robot.drives.items()
    }
    return replace(
        start,
        known=layout.known_at(x),
        drive_side=FrozenMapping(drives),
        load=load,
        load_side=load_side,
        robot=robot.with_values(robot.parameters, known),
        springs=FrozenMapping({joint: x[layout.spring(joint)] for joint in start.springs}),
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
        names=layout.names,
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
    others = [joint for joint in layout.drives if joint not in joints]
    end = 2 * first + len(layout.followed)
    stds = dict(zip(joints, step.stds[first:], strict=False))
    stds |= dict(zip(others, step.stds[end:], strict=False))
    drives = {
        joint: part(layout.actuator(joint), columns, float(stds[joint]))
        for joint, columns in layout.drives.items()
    }
    rest = np.append(step.stds[2 * first : end], step.stds[end + len(others) :])
    load_std = float(np.sqrt(np.mean((rest if rest.size else step.stds[:first]) ** 2)))
    return drives, part(identification.load_side, layout.load, load_std)
