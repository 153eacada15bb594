"""What a log has of a floating base: its motion by an IMU or by its pose, contacts and wrenches.

`base_motion` reduces every source to three signals in the frame of the base: angular velocity and
acceleration, and the specific force f = R^T (a - g) of its origin. With an accelerometer neither
position nor orientation is needed; with a pose they give all three.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import singledispatch
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np

from seaid._arrays import Array, BoolArray, FrozenMapping, frozen, white_noise
from seaid._files import toml_key
from seaid._progress import Display
from seaid.errors import LogError, unknown_name
from seaid.log.channels import ANGLE, CHANNELS, check_finite, contact_columns, refusal
from seaid.log.filtering import STILL, low_pass, spline_derivatives
from seaid.robot import BASE_ROWS, imu_motion

if TYPE_CHECKING:
    from seaid.robot import FloatingBase, ImuMotion, Robot


@singledispatch
def moving_base(robot: Robot) -> FloatingBase:
    """Return the base of a robot that nothing holds. Raises LogError for one that is held.

    The type of robots with such a base registers it, see `seaid.legged`.
    """
    raise refusal("base_is_held", robot=robot.name)


@dataclass(frozen=True, eq=False, repr=False)
class BaseLog(Display):
    """Samples of the base of a legged robot and of its contacts at the T instants of a log.

    Attributes
    ----------
    position : array (T, 3) or None
        Position of the base in the world [m].
    orientation : array (T, 4) or None
        Unit quaternion (w, x, y, z) that turns vectors of the base's frame to the world's.
    velocity : array (T, 3) or None
        Velocity of the base in the world [m/s], as a state estimator has it.
    angular_velocity : array (T, 3) or None
        Of an IMU, in its own frame [rad/s].
    specific_force : array (T, 3) or None
        Of an IMU, in its own frame [m/s^2]: at rest it points upwards with 9.81.
    contacts : mapping {link: array (T,)}
        Whether a link touches the ground: above 0.5.
    wrenches : mapping {link: array (T, 3) or (T, 6)}
        Measured force of the ground on a link [N], and its moment about the place of contact
        [N m], in the frame of the link.

    Raises
    ------
    LogError
        For shapes that do not fit, values that are not finite, and quaternions of another length.
    """

    position: Array | None = None
    orientation: Array | None = None
    velocity: Array | None = None
    angular_velocity: Array | None = None
    specific_force: Array | None = None
    contacts: Mapping[str, Array] = field(default_factory=dict)
    wrenches: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, columns in CHANNELS.items():
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, _samples(name, values, len(columns)))
        for name, mapping in (("contacts", self.contacts), ("wrenches", self.wrenches)):
            width = 1 if name == "contacts" else None
            samples = {link: _samples(f"{name} of {link}", x, width) for link, x in mapping.items()}
            object.__setattr__(self, name, FrozenMapping(samples, "link"))
        for link, values in self.wrenches.items():
            if values.shape[1] not in (3, 6):
                raise refusal("no_wrench", link=link, width=values.shape[1])
        if self.orientation is not None:
            _check_quaternions(self.orientation)
            object.__setattr__(self, "orientation", continuous(self.orientation))

    def _in_short(self) -> str:
        signals = [name.replace("_", " ") for name in CHANNELS if getattr(self, name) is not None]
        feet = [f"contacts of {link}" for link in self.contacts]
        return ", ".join([*signals, *feet, *(f"wrenches of {link}" for link in self.wrenches)])

    def unflagged(self, links: Sequence[str]) -> tuple[str, ...]:
        """Return those of some links that have neither a contact flag nor a measured wrench."""
        return tuple(x for x in links if x not in {**self.contacts, **self.wrenches})

    @classmethod
    def hanging(cls, robot: Robot, count: int) -> BaseLog:
        """Return `count` samples of a base that is held upright while all feet are in the air.

        The base counts as a foot with unknown forces and moments: `contacts=` of the robot names
        it. So one fit has logs of the robot that hangs and of the robot that stands.

        Raises
        ------
        LogError
            For a robot without a flat contact at its base.

        Examples
        --------
        >>> hanging = replace(log, base=seaid.log.BaseLog.hanging(robot, len(log.time)))
        >>> seaid.identify(robot, [hanging, standing])
        """
        base = None if robot.base_is_held else moving_base(robot)
        if base is None or not base.contact_of(base.link).is_flat:
            link = "base" if base is None else base.link
            raise refusal("no_flat_base", link=link)
        return cls(
            orientation=np.tile(base.upright_quaternion, (count, 1)),
            velocity=np.zeros((count, 3)),
            contacts={x: np.full(count, float(x == base.link)) for x in base.contact_links},
        )

    def each(self, change: Callable[[Array], Array]) -> BaseLog:
        """Return the samples with a function applied to each of the arrays (T, k)."""
        return BaseLog(**_changed(self, change))

    def columns(self) -> dict[str, Array]:
        """Return {column name in a file: samples (T,)}."""
        columns: dict[str, Array] = {}
        for name, names in CHANNELS.items():
            if (values := getattr(self, name)) is not None:
                columns.update(zip(names, values.T, strict=True))
        for link, values in self.contacts.items():
            columns[contact_columns(link)[0]] = values[:, 0]
        for link, values in self.wrenches.items():
            columns.update(zip(contact_columns(link)[1], values.T, strict=False))
        return columns


def _changed(data: BaseLog | BaseMotion, change: Callable[[Any], Any]) -> dict[str, Any]:
    """Return the fields with a function applied to each of the arrays, also of the mappings."""
    arrays: dict[str, Any] = {}
    for signal in fields(data):
        value = getattr(data, signal.name)
        if isinstance(value, Mapping):
            arrays[signal.name] = {link: change(x) for link, x in value.items()}
        elif isinstance(value, np.ndarray):
            arrays[signal.name] = change(value)
    return arrays


def continuous(orientation: Array) -> Array:
    """Return quaternions (T, 4) without changes of sign: p and -p are one rotation."""
    known = np.all(np.isfinite(orientation), axis=1)  # the sign may change where some are unknown
    whole, seen = orientation.copy(), orientation[known]
    # Each change of sign negates all quaternions behind it, hence the parity of their number.
    turned = np.sum(seen[1:] * seen[:-1], axis=1) < 0
    whole[known] *= np.where(np.cumsum([False, *turned])[: len(seen)] % 2, -1.0, 1.0)[:, None]
    return np.asarray(whole)


def needed_columns(base: FloatingBase, field: str) -> tuple[str, ...]:
    """Return the columns of a field that a log must have: a planar base lacks those of its guide.

    Those are the coordinate along its normal, and the rates about the axes in its plane.
    """
    names = CHANNELS[field]
    in_world = field in ("position", "velocity")
    if base.normal is None or field == "orientation" or not (in_world or base.imu_is_fixed):
        return names
    normal = base.normal_in_world if in_world else np.array(base.normal) @ base.imu_placement[0]
    along = np.abs(normal) if field == "angular_velocity" else 1 - np.abs(normal)
    return tuple(name for name, part in zip(names, along, strict=True) if part > _PART)


_PART = 1e-6
"""Component of an axis that is no rounding."""


def with_guided(picked: Mapping[str, Array], robot: Robot) -> dict[str, Array]:
    """Return the columns of a planar base with the orientation of its angle and what it cannot do.

    Gravity has a specific force along the normal of a plane that is not vertical.
    """
    columns = dict(picked)
    if robot.base_is_held or (base := moving_base(robot)).normal is None:
        return columns
    if ANGLE in columns:
        names = CHANNELS["orientation"]
        columns.update(zip(names, _quaternions(base, columns.pop(ANGLE)).T, strict=True))
    # A guide holds the base along its normal n against gravity: f = -(g n) n, in the IMU's axes.
    held = -float(robot.model.gravity.linear @ base.normal_in_world)
    values = {"specific_force": held * np.array(base.normal) @ base.imu_placement[0]}
    for name, names in CHANNELS.items():
        needed = needed_columns(base, name)
        if set(needed) <= set(columns):
            like = columns[needed[0]]
            for column, value in zip(names, values.get(name, np.zeros(4)), strict=False):
                columns.setdefault(column, np.where(np.isnan(like), np.nan, value))
    return columns


def _quaternions(base: FloatingBase, angle_rad: Array) -> Array:
    """Return the quaternions (T, 4) of a planar base at its angles (T,)."""
    half = np.asarray(angle_rad)[:, None] / 2
    # that of the angle zero, times that of the angle
    w, x = (base.upright_quaternion[:1], base.upright_quaternion[1:])
    s, v = np.cos(half), np.sin(half) * np.array(base.normal)
    return np.hstack([w * s - (v @ x)[:, None], w * v + s * x + np.cross(x, v)])


def base_log(picked: Mapping[str, Array], robot: Robot) -> BaseLog | None:
    """Return the samples of the base from its columns {name: samples (T,)}, None without any."""
    arrays: dict[str, Any] = {"contacts": {}, "wrenches": {}}
    picked = with_guided(picked, robot)
    for name, names in CHANNELS.items():
        if logged := [*filter(picked.__contains__, names)]:
            arrays[name] = _stacked(names, picked, f"the log has {logged[0]} and")
    for link in moving_base(robot).contact_links:
        contact, wrench = contact_columns(link)
        if contact in picked:
            _check_flags(link, picked[contact])
            arrays["contacts"][link] = picked[contact][:, None]
        if logged := [*filter(picked.__contains__, wrench)]:
            names = wrench[: 3 if len(logged) <= 3 else 6]
            arrays["wrenches"][link] = _stacked(names, picked, f"the wrench of '{link}' has")
    return BaseLog(**arrays) if any(map(len, arrays.values())) else None


def _stacked(names: Sequence[str], picked: Mapping[str, Array], about: str) -> Array:
    """Return columns side by side. Raises LogError if one is missing."""
    if missing := [column for column in names if column not in picked]:
        raise LogError(f"{about} no column {', '.join(missing)}")
    return np.column_stack([picked[column] for column in names])


def _samples(name: str, values: Any, width: int | None) -> Array:
    array = np.asarray(values)
    samples = frozen(name, array[:, None] if array.ndim == 1 else array, (None, width), LogError)
    check_finite(f"base: {name}", samples)
    return samples


def _check_flags(link: str, values: Array) -> None:
    """Raise LogError for a contact that is no flag, as forces and codes are none."""
    row = int(np.nanargmax(np.abs(values - 0.5)))
    if abs(values[row] - 0.5) > 1.0:  # 0 and 1 are 0.5 from the middle; 2 and -1 are no overshoot
        raise refusal("no_flag", link=link, value=values[row], row=row, key=toml_key(link))


_LENGTH = 0.05
"""Deviation of the length of a quaternion from one that is no rounding."""


def _check_quaternions(orientation: Array) -> None:
    length = np.linalg.norm(orientation, axis=1)
    if np.max(np.abs(length - 1)) > _LENGTH:
        row = int(np.argmax(np.abs(length - 1)))
        raise refusal("no_unit_quaternion", length=length[row], row=row)


@dataclass(frozen=True, eq=False, repr=False)
class BaseMotion(Display):
    """The motion of a floating base in its own frame, at the T instants of a motion.

    Attributes
    ----------
    angular_velocity, angular_acceleration, specific_force : arrays (T, 3)
        [rad/s], [rad/s^2] and [m/s^2], the last of the origin of the base.
    contacts : mapping {link: bool array (T,)}
        Whether a link touches the ground, with a force that was not measured.
    wrenches : mapping {link: array (T, 3) or (T, 6)}
        Measured wrenches, in the frame of the link.
    up : array (T, 3) or None
        The unit vector against gravity, None if the orientation is unknown.
    used : bool array (T,)
        Whether a sample is used: it is not near a change of contact or a jump of a pose.
    velocity : array (T, 3) or None
        Of the base, in its own frame [m/s], if the log has its pose.
    imu : array (3, 3) or None
        The rotation from the frame of the IMU, if an accelerometer on the base gives the specific
        force.
    guided : tuple of str
        Those of `BASE_ROWS` in which the guide of a planar base has an unknown force, since the
        base does not move along, or about, an axis that the plane leaves free.
    """

    angular_velocity: Array
    angular_acceleration: Array
    specific_force: Array
    contacts: Mapping[str, BoolArray]
    wrenches: Mapping[str, Array]
    used: BoolArray
    up: Array | None = None
    velocity: Array | None = None
    imu: Array | None = None
    guided: tuple[str, ...] = ()

    def _in_short(self) -> str:
        return f"{len(self.used):,} samples, contacts {', '.join(self.contacts) or 'none'}"

    @property
    def states(self) -> tuple[Array, Array, Array]:
        """Angular velocity, angular acceleration and specific force."""
        return self.angular_velocity, self.angular_acceleration, self.specific_force

    def samples(self, part: slice) -> BaseMotion:
        """Return some successive samples."""
        return replace(self, **_changed(self, lambda values: values[part]) | {"imu": self.imu})


States = tuple[Array, Array, Array]
"""Three signals: positions, velocities and accelerations, or those of `BaseMotion.states`."""


def base_motion(
    robot: Robot, log: BaseLog | None, time: Array, cutoff_hz: float, joints: States
) -> BaseMotion:
    """Return the motion of the base on a uniform grid, whose signals pass a low pass.

    `joints` are positions, velocities and accelerations (T, n), by which an IMU moves on its link.
    The angular velocity is that of the IMU, else of the orientation; the specific force that of the
    IMU, else of position and orientation. Samples nearer than two periods of the low pass to a
    change of contact are not used, nor those of a foot that is in the air for less than `_LIFTED`.
    """
    base = moving_base(robot)
    rate_hz = (len(time) - 1) / float(time[-1] - time[0])
    log, jumped = _without_jumps(_logged(robot, log))
    smooth = log.each(lambda x: low_pass(x, rate_hz, cutoff_hz))
    states = list(map(robot.to_model, joints, range(len(joints))))
    imu = imu_motion(base, robot.model, robot.model_order, states)
    gravity = robot.model.gravity.linear
    R, w = _turning(smooth, time, imu)
    # A planar base cannot turn about the axes in its plane: rates about them are noise of the IMU.
    w = w @ base.turning
    # The derivative of the components in the base's axes is that of the vector, since w x w = 0.
    e = spline_derivatives(time, w)[1]
    if smooth.specific_force is not None:
        f = _specific_force_of_imu(smooth.specific_force, imu, w, e)
        _check_gravity(f)
    else:
        f = _specific_force_of_pose(smooth, time, R, gravity)
    _check_contacts(log, base)
    flags = {x: log.contacts[x][:, 0] > 0.5 for x in log.contacts if x not in log.wrenches}
    # Period of the low pass in samples.
    period = rate_hz / cutoff_hz
    feet = {f"wrench of {link}": loaded(x) for link, x in log.wrenches.items()}
    used = _between_changes({**flags, **feet, "": jumped}, len(time), round(_PERIODS * period))
    has_imu = smooth.specific_force is not None and base.imu_is_fixed
    return BaseMotion(
        angular_velocity=w,
        angular_acceleration=e,
        specific_force=f,
        contacts=FrozenMapping(flags, "link"),
        wrenches=FrozenMapping(log.wrenches, "link"),
        used=_without_short_lifts(used, flags, _LIFTED * period),
        velocity=_velocity(smooth, time, R),
        imu=base.imu_placement[0] if has_imu else None,
        guided=_guided(base, log, R),
        # A row times R (T, 3, 3) is R^T times the column: gravity in the axes of the base.
        up=None if R is None else np.asarray(-gravity / np.linalg.norm(gravity) @ R),
    )


def _guided(base: FloatingBase, log: BaseLog, R: Array | None) -> tuple[str, ...]:
    """Return the equations of a planar base about and along the free axes that it never uses."""
    moves = np.ones(6, dtype=bool)
    # A quaternion has the sine of half of the angle.
    turn = log.angular_velocity if log.orientation is None else 2.0 * log.orientation
    moves[3:] = base.normal is None or turn is None or any(map(_moves, turn.T))
    place = log.velocity if log.position is None else log.position
    if not moves[3] and R is not None and place is not None:
        # The axes of a base that does not turn are constant in the world.
        moves[:3] = [_moves(along) for along in (place @ R.mean(axis=0)).T]
    return tuple(compress(BASE_ROWS, base.free_axes & ~moves))


def _moves(place: Array) -> bool:
    # As a joint, a base does not move within so many times the noise between samples.
    return bool(np.ptp(place) > max(STILL, _RARE * white_noise(place)))


def _logged(robot: Robot, log: BaseLog | None) -> BaseLog:
    """Return the samples of a base. Raises LogError if there are none."""
    if log is None:
        force, rate = (CHANNELS[x][0] for x in ("specific_force", "angular_velocity"))
        raise refusal("no_base", robot=robot.name, force=force, rate=rate)
    return log


def _specific_force_of_imu(measured: Array, imu: ImuMotion, w: Array, e: Array) -> Array:
    """Return the specific force (T, 3) of the base's origin by that of an IMU on one of its links.

    `w` and `e` (T, 3) are the angular velocity and acceleration of the base.
    """
    f = (imu.rotation @ measured[:, :, None])[:, :, 0]
    # a_0 = a_p - e x p - w x (w x p), less 2 w x p' + p'' by joints that move the IMU
    f = f - np.cross(e, imu.place) - np.cross(w, np.cross(w, imu.place))
    return np.asarray(f - 2 * np.cross(w, imu.velocity) - imu.acceleration)


def _specific_force_of_pose(log: BaseLog, time: Array, R: Array | None, gravity: Array) -> Array:
    """Return the specific force f = R^T (a - g) by the derivative of the velocity or position."""
    # The velocity first: one derivative has less noise than two.
    for order, values in ((1, log.velocity), (2, log.position)):
        if R is not None and values is not None:
            acceleration = spline_derivatives(time, values)[order]
            return np.asarray(np.einsum("tij,ti->tj", R, acceleration - gravity))
    raise refusal("no_acceleration", column=CHANNELS["specific_force"][0])


def _check_contacts(log: BaseLog, base: FloatingBase) -> None:
    """Raise LogError for contacts that the robot does not have, and for those not logged."""
    for link in log.contacts:
        if link not in {*base.contact_links, *log.wrenches}:
            unknown = unknown_name("contact", link, base.contact_links)
            raise refusal("unknown_contact", unknown=unknown)
    for link in log.wrenches:
        if link not in base.frames:
            raise LogError(f"wrenches: {unknown_name('link', link, base.frames)}")
    if silent := log.unflagged(base.contact_links):
        column = contact_columns(silent[0])[0]
        raise refusal("unflagged_contact", links=", ".join(silent), column=column)


def _velocity(log: BaseLog, time: Array, R: Array | None) -> Array | None:
    """Return the velocity of the base in its own frame, None if it is unknown."""
    v = log.velocity
    if v is None and log.position is not None:
        v = spline_derivatives(time, log.position)[1]
    return None if v is None or R is None else np.asarray(np.einsum("tij,ti->tj", R, v))


_JUMPS = {"position": 0.005, "velocity": 0.3, "orientation": 0.01}
"""Least jump of a pose between two samples [m, m/s, quaternion], above those of feet that land."""

_RARE = 20.0
"""A jump is this many times as large as the median change of the steps."""


def differentiated(log: BaseLog) -> list[str]:
    """Return the fields whose derivatives enter the equations."""
    names = ["orientation"] if log.angular_velocity is None else []
    if log.specific_force is None:
        names.append("position" if log.velocity is None else "velocity")
    return [name for name in names if getattr(log, name) is not None]


def jumps_of(name: str, values: Array) -> tuple[BoolArray, Array]:
    """Return the samples (T,) that a jump ends, and how far each of the steps (T, k) is off."""
    steps = np.diff(values, axis=0)
    off = np.zeros_like(values)
    # Row i is the step to sample i less the mean of its neighbours. A jump by J gives -J/2, J,
    # -J/2, hence the largest of three below.
    off[2:-1] = steps[1:-1] - 0.5 * (steps[:-2] + steps[2:])
    size = np.linalg.norm(off, axis=1)
    is_jump = size > max(_JUMPS[name], _RARE * float(np.median(size)))
    is_jump[1:-1] &= (size[1:-1] >= size[:-2]) & (size[1:-1] >= size[2:])
    return is_jump, off


def _without_jumps(log: BaseLog) -> tuple[BaseLog, BoolArray]:
    """Return the samples without jumps, and a flag (T,) that changes where they were."""
    arrays = _changed(log, lambda values: values)
    jumps = np.zeros(len(next(iter(log.columns().values()))), dtype=bool)
    for name in differentiated(log):
        is_jump, off = jumps_of(name, arrays[name])
        jumps |= is_jump
        # Rotations do not add, so that their jumps are only excluded.
        if np.any(is_jump) and name != "orientation":
            arrays[name] = arrays[name] - np.cumsum(off * is_jump[:, None], axis=0)
    # The parity of the number of jumps changes at each of them, as a contact flag does at
    # touchdown, so that `_between_changes` excludes the samples about it.
    return (BaseLog(**arrays) if np.any(jumps) else log), np.cumsum(jumps) % 2 == 1


def quaternion_rates(orientation: Array, time: Array) -> Array:
    """Return the angular velocity (T, 3) of unit quaternions in the frame of the base."""
    rate = spline_derivatives(time, orientation)[1]
    # w = 2 Im(conj(p) p'), in the frame of the base
    scalar, vector = orientation[:, :1], orientation[:, 1:]
    w = scalar * rate[:, 1:] - rate[:, :1] * vector - np.cross(vector, rate[:, 1:])
    return np.asarray(2 * w)


def _turning(log: BaseLog, time: Array, imu: ImuMotion) -> tuple[Array | None, Array]:
    """Return the rotation of the base (T, 3, 3), None if unknown, and its angular velocity."""
    R = None
    if log.orientation is not None:
        p = log.orientation / np.linalg.norm(log.orientation, axis=1, keepdims=True)
        R = matrices(p)
        if log.angular_velocity is None:
            return R, quaternion_rates(p, time)
    if log.angular_velocity is None:
        raise refusal("no_rotation", column=CHANNELS["angular_velocity"][0])
    # w_IMU = w_base + w of the IMU against the base, by the joints between them.
    return R, (imu.rotation @ log.angular_velocity[:, :, None])[:, :, 0] - imu.angular_velocity


def matrices(quaternions: Array) -> Array:
    """Return the rotations (T, 3, 3) of unit quaternions (T, 4): w, x, y, z."""
    # R = 1 + 2 w [v]x + 2 [v]x [v]x of a unit quaternion (w, v).
    K = np.cross(quaternions[:, None, 1:], np.eye(3)).swapaxes(1, 2)
    return np.asarray(np.eye(3) + 2 * (quaternions[:, :1, None] * K + K @ K))


_GRAVITY_FREE = 3.0
"""Median and mean of a specific force [m/s^2] below which gravity was taken out of it."""

_MOST, _ABOUT_ONE = (0.1, 0.5, 0.9), 0.3
"""Quantiles of the size of a specific force that are about one if it is in g."""


def _check_gravity(force: Array) -> None:
    size = np.linalg.norm(force, axis=1)
    # A robot that is mostly in flight has none there, and on average that of its weight.
    typical = max(float(np.median(size)), float(np.linalg.norm(np.mean(force, axis=0))))
    # Three quantiles, because the median alone of an acceleration without gravity may be near one.
    if np.all(np.abs(np.quantile(size, _MOST) - 1) < _ABOUT_ONE):
        raise refusal("in_g", typical=typical)
    if typical < _GRAVITY_FREE:
        raise refusal("no_gravity", typical=typical)


_PERIODS = 2.0
"""Periods of the low pass of the positions at each side of a change of contact that are not used.

Touchdown is a corner of the positions. With one period what the low pass leaves of it is half of a
standard error of each parameter of a simulated Solo12, with two a quarter, and no longer intervals.
"""


_LOADED = 0.03
"""Part of the largest measured force on a foot from which it touches the ground."""


def loaded(wrench: Array) -> BoolArray:
    """Return whether a foot with a measured wrench (T, 3 or 6) touches the ground."""
    force = np.linalg.norm(wrench[:, :3], axis=1)
    # The quantile and not the maximum, which is that of an impact or an outlier.
    return np.asarray(force > _LOADED * np.quantile(force, 0.99))


def _between_changes(flags: Mapping[str, BoolArray], count: int, margin: int) -> BoolArray:
    """Return the samples (T,) that are `margin` samples or more from a change of contact."""
    used = np.ones(count, dtype=bool)
    for flag in flags.values():
        for place in np.flatnonzero(np.diff(flag.astype(int))) + 1:
            used[max(place - margin, 0) : place + margin] = False
    return used


_LIFTED = 2.5
"""Periods of the low pass of the positions, half of one of that of the rows, up to which the time
of a foot in the air is not used. That is one independent row, which determines the mass at the foot
alone: no residual shows its error. A Go2 that sways and now and then loses contact for a moment had
errors of 3 and 6 standard errors there."""

LEAST_LIFT = _LIFTED + 2 * _PERIODS
"""Periods of the low pass of the positions that a foot is in the air, from which that is used."""


def _without_short_lifts(used: BoolArray, flags: Mapping[str, BoolArray], most: float) -> BoolArray:
    """Return the used samples (T,) without feet in the air that are so in `most` or less."""
    lifts = [used & ~flag for flag in flags.values()]
    short = [lift for lift in lifts if np.sum(lift) <= most]
    return used & ~np.any(short, axis=0) if short else used
