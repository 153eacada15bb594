"""A transmission whose ratio depends on the angle of the joint: a four-bar, a cam, a spindle.

The drive turns phi = g(q) behind its gear, with the relative ratio rho = dg/dq: the motor turns
N rho times as fast as the joint. The same power on both sides, tau_q q' = tau_phi phi', gives
tau_phi = tau_q / rho. What a drive has and measures is a function of phi; bodies move by q.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np

from seaid._arrays import Array, finite
from seaid.errors import RobotError, shown

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

_LARGEST = 100.0
"""Largest relative ratio, and one over the least: near zero, at a dead centre, the motor does not
move the joint."""

_ANGLES = 4096
"""Angles from which the inverse starts."""

Number = Array | float


@dataclass(frozen=True)
class AngleRatio:
    """The ratio rho of a transmission at an angle q of its joint, over the drive's gear ratio.

    It has harmonics, rho = 1 + sum_k (c_k cos(k q) + s_k sin(k q)), or a table of angles and ratios
    with a cubic spline between them. The first and the last ratio of a table continue beyond it.
    The angle g behind the gear is zero where that of the joint is.

    Parameters
    ----------
    cos, sin : list of floats
        Amplitudes c_k and s_k of the orders k = 1, 2, ...
    angle_rad, ratio : list of floats
        The table: increasing angles of the joint [rad], and the ratios at them.

    Raises
    ------
    RobotError
        For a ratio below 0.01 or above 100 at any angle, and for a table that is too short or whose
        angles do not increase.

    Examples
    --------
    >>> linkage = seaid.drives.AngleRatio(cos=(0.24,), sin=(-0.07,))
    >>> linkage.joint_angle(linkage.drive_angle(0.5))
    """

    cos: tuple[float, ...] = ()
    sin: tuple[float, ...] = ()
    angle_rad: tuple[float, ...] = ()
    ratio: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            values = finite(
                f"angle_ratio {field.name}", getattr(self, field.name), (None,), RobotError
            )
            object.__setattr__(self, field.name, tuple(values.tolist()))
        has_table = bool(self.angle_rad or self.ratio)
        if has_table == bool(self.cos or self.sin):
            raise RobotError("angle_ratio has harmonics (cos, sin), or a table (angle_rad, ratio)")
        if has_table:
            self._check_table()
        ratios = self.rate(self._grid[0])
        if not np.all((ratios >= 1 / _LARGEST) & (ratios <= _LARGEST)):
            raise RobotError(
                f"angle_ratio is from {np.min(ratios):.3g} to {np.max(ratios):.3g}, and must be "
                f"from {1 / _LARGEST:g} to {_LARGEST:g} at all angles: at zero the motor does not "
                "move the joint; a table is of the angles that the joint reaches"
            )

    def _check_table(self) -> None:
        """Raise RobotError for a table that a spline cannot pass."""
        angles, ratios = self.angle_rad, self.ratio
        if not 2 <= len(angles) == len(ratios) or np.any(np.diff(angles) <= 0):
            raise RobotError(
                f"the table of angle_ratio needs two or more increasing angles and as many "
                f"ratios, found angles {shown(list(angles))} and ratios {shown(list(ratios))}"
            )

    @cached_property
    def _grid(self) -> tuple[Array, Array]:
        """Joint angles over the table, or a turn, and the angles behind the gear."""
        reach = self.angle_rad or (-np.pi, np.pi)
        angles = np.linspace(reach[0], reach[-1], _ANGLES)
        return angles, self.drive_angle(angles)

    @cached_property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.angle_rad, self.ratio)

    @cached_property
    def _harmonics(self) -> Array:
        """The numbers i k and c_k - i s_k (2, K) of rho = 1 + sum_k Re (c_k - i s_k) exp(i k q)."""
        pairs = zip_longest(self.cos, self.sin, fillvalue=0.0)
        return np.array([(1j * k, complex(c, -s)) for k, (c, s) in enumerate(pairs, 1)]).T

    def rate(self, q: Array, order: int = 0) -> Array:
        """Return rho at joint angles, or its derivative of an `order`; -1 is an integral of it."""
        if not self.angle_rad:
            ik, amplitudes = self._harmonics
            periodic = np.exp(np.asarray(q)[..., None] * ik) @ (amplitudes * ik**order)
            return np.asarray(periodic.real + {-1: q, 0: 1.0}.get(order, 0.0))
        inside = np.clip(q, self.angle_rad[0], self.angle_rad[-1])
        if order < 0:
            beyond = self.rate(inside) * (q - inside)
            return np.asarray(self._spline.antiderivative()(inside) + beyond)
        return np.asarray(self._spline(inside, order) * (1.0 if order == 0 else q == inside))

    @cached_property
    def _at_zero(self) -> Array:
        """The integral at the zero of both angles."""
        return self.rate(np.zeros(()), -1)

    def drive_angle(self, q: Array) -> Array:
        """Return the angles g behind the gear at joint angles."""
        return np.asarray(self.rate(q, -1) - self._at_zero)

    def joint_angle(self, phi: Array) -> Array:
        """Return the joint angles at angles behind the gear, the inverse of `drive_angle`."""
        angles, driven = self._grid
        # A turn of the joint is a turn behind the gear; a table continues in straight lines.
        period = 0.0 if self.angle_rad else 2 * np.pi
        turns = period * np.floor((phi - driven[0]) / (2 * np.pi))
        q = np.interp(phi - turns, driven, angles) + turns
        for _ in range(2):  # each step of Newton's method squares the error, of 1e-7 at first
            q = q - (self.drive_angle(q) - phi) / self.rate(q)
        return np.asarray(q)

    def drive_states(self, q: Array, v: Number = 0.0, a: Number = 0.0) -> tuple[Array, ...]:
        """Return phi, phi' = rho q' and phi'' = rho q'' + (d rho / d q) q'^2."""
        rho = self.rate(q)
        return self.drive_angle(q), rho * v, rho * a + self.rate(q, 1) * v**2

    def joint_states(self, phi: Array, v: Number = 0.0, a: Number = 0.0) -> tuple[Array, ...]:
        """Return q, q' and q'' at phi, phi' and phi'', the inverse of `drive_states`."""
        q = self.joint_angle(phi)
        rho = self.rate(q)
        speed = v / rho
        return q, speed, (a - self.rate(q, 1) * speed**2) / rho


@dataclass(frozen=True)
class Ratios:
    """The ratios of a robot that depend on the angles of joints, by the index of the joint.

    Joints without such a ratio keep their states (..., n).
    """

    by_joint: Mapping[int, AngleRatio]

    def __bool__(self) -> bool:
        return bool(self.by_joint)

    def in_order(self, order: Sequence[int]) -> Ratios:
        """Return the ratios where the joints have another order."""
        return Ratios({order.index(j): ratio for j, ratio in self.by_joint.items()})

    def at_drives(self, *states: Array) -> tuple[Array, ...]:
        """Return phi, phi', phi'' of joints at q, q', q'', or at the first of these."""
        return self._moved(AngleRatio.drive_states, states)

    def at_joints(self, *states: Array) -> tuple[Array, ...]:
        """Return q, q', q'' of joints at phi, phi', phi'', or at the first of these."""
        return self._moved(AngleRatio.joint_states, states)

    def _moved(
        self, move: Callable[..., tuple[Array, ...]], states: tuple[Array, ...]
    ) -> tuple[Array, ...]:
        moved = tuple(np.array(state) for state in states) if self else states
        for j, ratio in self.by_joint.items():
            columns = move(ratio, *(state[..., j] for state in states))
            for state, column in zip(moved, columns, strict=False):
                state[..., j] = column
        return moved

    def rates(self, q: Array, order: int = 0) -> Array:
        """Return rho (..., n) at joint angles q, or derivatives by q: tau_phi = tau_q / rho."""
        rates = np.full(np.shape(q), 1.0 if order == 0 else 0.0)
        for j, ratio in self.by_joint.items():
            rates[..., j] = ratio.rate(q[..., j], order)
        return rates
