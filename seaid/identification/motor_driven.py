"""Joints behind springs, simulated from the measured motor angles: a simulator of `refine`.

The measured motor angles (and the joints without a spring) are the input of the complete model: the
joints behind the springs are simulated by (8), and their encoders and all torques compared with the
measured ones. Motor encoders see the joint through a gear, so that their noise is far below that of
the joint encoders: as inputs they cost little accuracy, prevent drift, and need no controller. Each
window of the log has its own initial state.

Dry friction of joints is not smooth. It enters as a correction (T, 1 + p) per joint: what is added
to the torque on the joint, and to its derivatives by the p parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from seaid._arrays import Array, BoolArray, white_noise
from seaid.drives import is_dry, total_ratio
from seaid.drives.drives import DefaultTerms
from seaid.errors import IdentificationError
from seaid.estimation import Parameter
from seaid.estimation.nonlinear_least_squares import Residuals
from seaid.identification import joint_dynamics
from seaid.identification.refined_parameters import Layout, MotionChange, Outputs, block_means
from seaid.identification.stacked_fits import TORQUE_OFFSET
from seaid.identification.unseen_springs import SAMPLES
from seaid.log import Log, Motion, reconstruct_motion
from seaid.log.filtering import decimation
from seaid.log.motion import POSITION_BAND, decimated
from seaid.log.rows import still_speed
from seaid.regressor.load import load_side
from seaid.regressor.regression import actuator_columns
from seaid.robot import Robot
from seaid.simulation.plant import response_to, torque_jacobians

WIDER = 3.0
"""Cutoff of the refinement over that of the identification, to keep the steps of dry friction.
The cutoff is not raised where no encoder is behind a spring and either the noise of the motor's
encoder, twice differentiated, exceeds that of its torque, or its rotor inertia is unknown."""

WINDOW_S = 1.0
"""Length [s] of the simulated windows, over which model errors accumulate."""


@dataclass(frozen=True, eq=False)
class Run:
    """Windows of a log at the present estimate: its motion with the simulated joints.

    `reading` (T, simulated) is the measured position of these joints, `still` (T, simulated and
    followed) masks samples at which the friction of their motors is unknown; `block` samples make a
    row.
    """

    motion: Motion
    reading: Array
    still: BoolArray
    windows: int
    block: int


_MOST_ENTRIES = 1_000_000
"""Entries of the response of the joints in memory at a time, of 20 or so arrays of this size."""


def runs_of(layout: Layout, log: Log, window_s: float = WINDOW_S) -> list[Run]:
    """Return a log without gaps, with the wider cutoff, in parts of whole windows."""
    known, motion = layout.identification.known, _in_wider_band(layout, log)
    if layout.unseen:
        motion = joint_dynamics.smoothed(motion, [known.index(joint) for joint in layout.unseen])
        # The angles behind the springs are simulated, so that the samples must resolve the
        # fastest oscillation in the band, and no more: the cost grows with their number.
        motion = decimated(motion, max(1, int(motion.rate_hz / (SAMPLES * motion.cutoff_hz))))
    block = decimation(motion.rate_hz, motion.cutoff_hz)
    transient = round(motion.transient_s * motion.rate_hz)
    length = len(motion.time) - 2 * transient
    # Windows are whole numbers of blocks, since a row is the mean of a block in one window. The
    # torque has to show more than the two numbers of the initial state of a joint there.
    windows = max(1, min(round(length / motion.rate_hz / window_s), length // (3 * block)))
    window = length // windows // block * block
    simulated = [known.index(joint) for joint in layout.simulated]
    compared = (*layout.simulated, *layout.followed)
    still = np.column_stack([_near_reversals(known, motion, joint) for joint in compared])
    # Response of s joints: (T, s, 1 + p + 2 s), the residual, p parameters, 2 s initial states.
    per_window = window * len(simulated) * (1 + len(layout.parameters) + 2 * len(simulated))
    most = max(1, _MOST_ENTRIES // max(per_window, 1))
    runs = []
    for start in range(0, windows, most):
        count = min(most, windows - start)
        first = transient + start * window
        part = slice(first, first + count * window)
        reading = motion.joint_position[part, simulated]
        runs.append(Run(motion.samples(part), reading, still[part], count, block))
    return runs


def _in_wider_band(layout: Layout, log: Log) -> Motion:
    """Return the motion of a log at the wider cutoff, where `WIDER` has no reason against it."""
    start, known = layout.identification, layout.identification.known
    rate_hz = (len(log.time) - 1) / (log.time[-1] - log.time[0])
    band = min(WIDER * start.cutoff_hz, rate_hz / 8)
    motion = joint_dynamics.finer_side(known, reconstruct_motion(known, log, band))
    behind = (*layout.unseen, *layout.followed)
    # Torque noise < noise of I_M w': a wider band would only add that of the encoder. Any noise in
    # the column w' of an unknown I_M makes it too small (errors in variables).
    is_noisy = any(_is_noisier(layout, joint, log, motion) for joint in behind)
    if is_noisy or any("motor_inertia" in layout.actuators[x].names for x in layout.unseen):
        return joint_dynamics.finer_side(known, reconstruct_motion(known, log, start.cutoff_hz))
    return motion


def _is_noisier(layout: Layout, joint: str, log: Log, motion: Motion) -> bool:
    """Whether the noise of a motor's encoder in the torque of its rotor is above the torque's."""
    # The robot has the rotor inertia of a start that does not know it, too.
    start = layout.identification
    index, drive = start.known.index(joint), start.robot.drives[joint]
    of_encoder = white_noise(motion.motor_acceleration[:, index])
    inertia = drive.values.get("motor_inertia", 0.0)
    return white_noise(log.motor_torque[:, index]) < inertia * of_encoder


def _near_reversals(robot: Robot, motion: Motion, joint: str) -> BoolArray:
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
    smear = round(motion.rate_hz / (POSITION_BAND * motion.cutoff_hz))
    return np.asarray(scipy.ndimage.maximum_filter1d(still.astype(np.uint8), 2 * smear + 1) > 0)


_LARGEST = 1e100
"""Size from which a simulation diverges: squares of what is larger overflow."""

_DIVERGES = "the simulation diverges at this estimate: check the identification it starts from"

_LEAST_RAD_S = 1e-12
"""Change of speed from a sample to the next that counts as none."""


@dataclass(frozen=True, eq=False)
class MotorDriven(Outputs):
    """A run, whose S joints behind springs are simulated from the motor angles.

    Columns (T, joints, 1 + p) are a residual and its derivatives by x.
    """

    run: Run

    @cached_property
    def known(self) -> Robot:
        """The robot whose nonlinear drives are linearised at x."""
        return self.layout.known_at(self.x)

    @cached_property
    def joints(self) -> list[int]:
        """The places of the simulated joints in the robot."""
        return list(map(self.known.index, self.layout.simulated))

    @cached_property
    def jacobians(self) -> Array:
        """The derivatives (3, T, n, n) of the inverse dynamics by the motion."""
        robot = self.layout.robot_at(self.x)
        return torque_jacobians(robot, *self.run.motion.joint_states)

    @cached_property
    def friction_and_slopes(self) -> tuple[dict[str, Array], Array]:
        """The corrections of dry friction of the joints, and its slopes (T, S) by their speeds.

        It is the mean about a sample of c sign(v), with v linear in time. Its slope lets a reversal
        move; with the sign at the samples alone bodies were 1.5 to 5 times worse.
        """
        motion, torques = self.run.motion, dict[str, Array]()
        slopes = np.zeros((len(motion.time), len(self.joints)))
        for row, joint in enumerate(self.layout.simulated):
            if "coulomb" not in self.known.drives[joint].joint_friction:
                continue
            index = self.known.index(joint)
            speed = motion.joint_velocity[:, index]
            # v goes from v - s to v + s about a sample: the mean of sign(v), clip(v / s, -1, 1),
            # takes the place of the sign(v) in the columns of (8).
            swept = 0.5 * np.abs(motion.joint_acceleration[:, index]) / motion.rate_hz
            swept = np.maximum(swept, _LEAST_RAD_S)
            change = np.sign(speed) - np.clip(speed / swept, -1.0, 1.0)
            place = self.layout.places.get(Parameter("joint_coulomb_friction", joint))
            known = self.known.drives[joint].values
            level = known["joint_coulomb_friction"] if place is None else float(self.x[place])
            torques[joint] = np.zeros((len(speed), 1 + len(self.x)))
            torques[joint][:, 0] = level * change
            if place is not None:
                torques[joint][:, 1 + place] = change
            slopes[:, row] = np.where(np.abs(speed) < swept, level / swept, 0.0)
        return torques, slopes

    @cached_property
    def load_rows(self) -> Array:
        """The columns of (8) of all joints with a torque."""
        layout, motion, x = self.layout, self.run.motion, self.x
        model = layout.identification.model
        side = load_side(self.known).columns(motion, model, layout.springs_at(x))
        columns = np.zeros((*side.torque.shape, 1 + len(x)))
        by_x = columns[:, :, 1:]
        columns[:, :, 0] = side.torque - side.payload - side.H @ x[layout.load]
        by_x[:, :, layout.load] = -side.H
        of_springs = [column for joint in layout.simulated for column in layout.spring(joint)]
        by_x[:, :, of_springs] = side.propagated
        if layout.has_zeros:
            rows = list(map(self.known.index, model.torque_joints))
            # q = reading - zero: -tau(q) changes by +dtau/dq per unit of the zero. Positions
            # of simulated joints do not depend on the zero of their encoders, their outputs do.
            by_x[:, :, layout.zeros] = self.jacobians[0][:, rows]
            by_x[:, :, [layout.zeros.start + joint for joint in self.joints]] = 0.0
        for column, joint, unit in layout.tests(motion):
            by_x[:, model.torque_joints.index(joint), column] = unit
        friction, _ = self.friction_and_slopes
        for joint, correction in friction.items():
            columns[:, model.torque_joints.index(joint)] += correction
        return columns

    def load_rows_of(self, joints: Sequence[str]) -> Array:
        """Return the columns of (8) of some joints."""
        names = self.layout.identification.model.torque_joints
        return np.asarray(self.load_rows[:, list(map(names.index, joints))])

    @cached_property
    def nudged(self) -> tuple[Motion, Motion]:
        """The motions with all joint positions changed, and with all speeds."""
        motion = self.run.motion
        return joint_dynamics.nudged(motion, 0), joint_dynamics.nudged(motion, 1)

    @cached_property
    def linearised_load(self) -> Array:
        """The derivatives (3, T, S, S) of what pulls at the simulated joints, by their motion.

        That are the bodies, and the drives against their motion.
        """
        layout, eye, motion = self.layout, np.eye(len(self.joints)), self.run.motion
        model = layout.identification.model
        simulated = list(map(model.torque_joints.index, layout.simulated))
        slopes = joint_dynamics.drive_slopes(
            self.known, motion, self.nudged, model, layout.springs_at(self.x), self.x[layout.load]
        )
        by_position, by_speed = (slope[:, simulated, None] * eye for slope in slopes)
        _, of_friction = self.friction_and_slopes
        by_speed = by_speed + of_friction[:, :, None] * eye
        inside = self.jacobians[:, :, self.joints][..., self.joints]
        inside[:2] += by_position, by_speed
        return inside

    def response(self, force: Array) -> Array:
        """Return the response of the simulated joints to a force (T, S, any), and free motions."""
        step_s = 1 / self.run.motion.rate_hz
        return response_to(self.linearised_load, force, step_s, self.run.windows)

    def moved(self, x: Array, part: float, nuisance: Array) -> MotorDriven:
        """Return the run with its simulated joints after a part of a step to parameters x (p,)."""
        layout, change, initial = self.layout, x - self.x, part * nuisance
        force = self.load_rows_of(layout.simulated)
        # q + part dq_0 + dq/dx change + Phi(t) s: the Newton correction dq_0 of (8), the change of
        # the parameters, and free motions Phi from the changes s of each window's initial state.
        response = self.response(force @ np.append(part, change)[:, None])
        weights = np.column_stack([np.ones(len(initial)), initial])
        motion = joint_dynamics.displaced(self.run.motion, self.joints, response, weights)
        if layout.has_zeros:
            position = motion.joint_position.copy()
            others = [joint for joint in range(self.known.n) if joint not in self.joints]
            # Joints that are not simulated follow their encoders: q = reading - zero.
            position[:, others] -= change[layout.zeros][others]
            motion = replace(motion, joint_position=position)
        return replace(self, x=x, run=replace(self.run, motion=motion))

    def changed(self, known: Robot, change: MotionChange) -> MotorDriven:
        """Return the residuals for a robot with other constants, and a change of the log."""
        run = replace(self.run, motion=change(self.run.motion))
        return replace(self, layout=self.layout.with_known(known), run=run)

    @cached_property
    def residuals(self) -> Residuals:
        """The residuals of the simulated joints. Raises IdentificationError if these diverge."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                rows = self.outputs
        except IdentificationError as problem:
            raise IdentificationError(f"{_DIVERGES}; {problem}") from None
        for part in (rows.residual, rows.jacobian, rows.nuisance):
            if not np.all(np.abs(part) < _LARGEST):
                raise IdentificationError(_DIVERGES)
        return rows

    @property
    def outputs(self) -> Residuals:
        """The residuals of the simulated joints, whatever their size.

        Channels: positions of the simulated joints, torques of their drives and of followed joints.
        The first column of what moves the joints is the residual of (8), by which they have to move
        to satisfy it; then follow its derivatives by the parameters.
        """
        layout, run = self.layout, self.run
        response = self.response(self.load_rows_of(layout.simulated))
        torques = self.motor_torques(response), self.followed_torques(response)
        columns = np.concatenate([self.positions(response), *torques], axis=1)
        unseen = np.isin(layout.simulated, layout.unseen)
        # A joint without an encoder has no measured position: its rows never count. Positions of
        # the others count at standstill too, where only the torques are unknown.
        unknown = np.hstack([np.broadcast_to(unseen, (len(columns), len(unseen))), run.still])
        return block_means(columns, unknown, run.motion, run.windows, run.block, 2 * len(unseen))

    def positions(self, response: Array) -> Array:
        """Return the columns of the encoders of the simulated joints, and of their free motions."""
        layout, joints = self.layout, self.joints
        columns: Array = -response[0]
        # y - q - z, where q is the present motion plus its Newton correction, the first column.
        columns[:, :, 0] += self.run.reading - self.run.motion.joint_position[:, joints]
        if layout.has_zeros:
            columns[:, :, 0] -= self.x[layout.zeros][joints]
            zeros = [1 + layout.zeros.start + joint for joint in joints]
            columns[:, range(len(joints)), zeros] -= 1.0
        return columns

    def motor_torques(self, response: Array) -> Array:
        """Return the columns of (7) of the simulated joints, and of their free motions."""
        layout = self.layout
        columns: Array = np.zeros_like(response[0])
        for row, joint in enumerate(layout.simulated):
            names, zeta, R = self.motor_equation(joint, self.run.motion)
            check_columns(layout, names, joint)
            of_drive = layout.drives[joint]
            residual = zeta - R @ self.x[of_drive]
            columns[:, row, 0] = residual
            columns[:, row, 1 + of_drive] = -R
            # by position and by speed
            for move, motion in zip(response[:2, :, row], self.nudged, strict=True):
                _, zeta, R = self.motor_equation(joint, motion)
                slope = (zeta - R @ self.x[of_drive] - residual) / joint_dynamics.NUDGE
                # Chain rule d(7)/dx + d(7)/dq dq/dx + d(7)/dv dv/dx; (7) has no joint acceleration.
                # The first column is the change by the Newton correction of the joint.
                columns[:, row] += slope[:, None] * move
        # A torque on the joint loads its motor, through the gear.
        for column, joint, unit in layout.tests(self.run.motion):
            ratio = total_ratio(self.known.drives[joint])
            columns[:, layout.simulated.index(joint), 1 + column] -= unit / ratio
        return columns

    def motor_equation(self, joint: str, motion: Motion) -> tuple[tuple[str, ...], Array, Array]:
        """Return names, zeta and R of (7), with a column for an identified torque offset."""
        regressor, zeta, R = actuator_columns(self.known, motion, joint)
        if Parameter(TORQUE_OFFSET, joint) not in self.layout.places:
            return regressor.names, zeta, R
        return (*regressor.names, TORQUE_OFFSET), zeta, np.column_stack([R, np.ones(len(zeta))])

    def followed_torques(self, response: Array) -> Array:
        """Return the columns of (8) of the followed joints, and of the free motions of others."""
        followed = list(map(self.known.index, self.layout.followed))
        by_states = self.jacobians[:, :, followed][..., self.joints]
        columns: Array = -np.sum(by_states @ response, axis=0)
        rows = self.load_rows_of(self.layout.followed)
        columns[:, :, : rows.shape[2]] += rows
        return columns


def check_columns(layout: Layout, names: tuple[str, ...], joint: str) -> None:
    """Raise IdentificationError if a log has other torque sensors than the identification."""
    identified = layout.actuators[joint].names
    if names != identified:
        raise IdentificationError(
            f"the log determines {', '.join(names)} of {joint}, the identification "
            f"has {', '.join(identified)}: same torque sensors needed"
        )
