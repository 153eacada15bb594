"""Motions in stance: what is asked for (Stance), what comes out (StancePlan), and what it takes.

`design_excitation` needs a `StandingRobot`, whose planned coordinates determine its motion and the
rows of its parameters. `seaid.legged` registers for robots with a floating base how one is made of
a `Stance`. A new limit of a motion in stance is a field of `Stance` and a row of the used shares of
`seaid.legged.stance`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import TYPE_CHECKING, Protocol

import numpy as np

from seaid._arrays import Array
from seaid._progress import Display, counted
from seaid.errors import ExcitationError
from seaid.robot import Robot

if TYPE_CHECKING:
    from seaid.excitation.basis import Basis
    from seaid.excitation.criteria import States
    from seaid.excitation.limits import JointLimits, Limits
    from seaid.excitation.trajectory import Trajectory


@dataclass(frozen=True, repr=False)
class Stance(Display):
    """The contacts that stay on the ground during a motion, and what they may transmit.

    Parameters
    ----------
    contacts : sequence of str
        Links of `contacts=` of `load_robot` that stand, all at once.
    posture : {joint: position}, sequence of n floats, optional
        Joint positions [rad or m] at the start and at the end, with the base level. Default, and
        for joints not named: the middle of the position limits.
    friction : float, default 0.6
        Friction coefficient: tangential over normal force is less.
    sole_m : (float, float), optional
        Length and width of a flat foot [m] about its contact, along x and y of its link. The centre
        of pressure stays in it.
    least_load : float, default 0.1
        Least normal force of each contact, as a share of the weight per contact.
    base_range_m, base_range_rad : float or 3 floats
        How far the base moves from its start, along x, y and z of the world, and in roll, pitch and
        yaw. Default: a third of its height above the ground, and 0.5 rad.

    Examples
    --------
    >>> feet = ["FL_foot", "FR_foot", "RL_foot", "RR_foot"]
    >>> Stance(feet, posture={"FL_calf_joint": -1.6}, friction=0.5)
    """

    contacts: Sequence[str]
    posture: Mapping[str, float] | Sequence[float] | None = None
    friction: float = 0.6
    sole_m: tuple[float, float] | None = None
    least_load: float = 0.1
    base_range_m: float | Sequence[float] | None = None
    base_range_rad: float | Sequence[float] = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class StancePlan(Display):
    """The base and the contact forces of a planned motion in stance.

    Attributes
    ----------
    base : Trajectory
        Position [m] and roll, pitch, yaw [rad] (R = Rz Ry Rx) of the base in the world, whose axes
        are those of the base at the start.
    time : array (T,)
        Instants [s] of the forces.
    forces : mapping {link: (T, 3 or 6)}
        Forces on the robot [N] at each contact, x and y tangential (along the link's at the start)
        and z normal, then for flat feet the moments [N m]. They are the least ones that hold the
        base; the real ones differ where feet push against each other.
    joint_torques : array (T, n)
        [N m or N], of the nominal bodies under these forces.
    friction_used : mapping {link: float}
        Largest ratio of tangential to normal force.
    least_normal_force : mapping {link: float}
        [N].
    """

    base: Trajectory
    time: Array
    forces: Mapping[str, Array]
    joint_torques: Array

    @property
    def friction_used(self) -> dict[str, float]:
        """Largest ratio of tangential to normal force of each contact."""
        forces = self.forces.items()
        return {link: float(np.max(np.hypot(f[:, 0], f[:, 1]) / f[:, 2])) for link, f in forces}

    @property
    def least_normal_force(self) -> dict[str, float]:
        """Least normal force of each contact [N]."""
        return {link: float(np.min(f[:, 2])) for link, f in self.forces.items()}

    def _in_short(self) -> str:
        most, least = max(self.friction_used.values()), min(self.least_normal_force.values())
        return (
            f"{counted(len(self.forces), 'contact')}, normal forces of at least {least:.4g} N, "
            f"tangential ones of at most {most:.3g} of them"
        )


class StandingRobot(Protocol):
    """A robot in stance, over its m planned coordinates: those of the base, and of free joints.

    `States` are those of the planned coordinates, each (T, m); there are n joints, r known joint
    torques, p base parameters, c limits (of contacts, dependent joints and torques) and k free
    variables of each coordinate. `seaid.legged.stance.StanceModel` is one.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the planned coordinates."""

    @property
    def start(self) -> Array:
        """The planned coordinates (m,) at the start."""

    @property
    def links(self) -> tuple[str, ...]:
        """The links of the contacts."""

    @property
    def free_limits(self) -> JointLimits:
        """The limits of the planned coordinates."""

    @property
    def torque_limits(self) -> Array:
        """The limits (n,) of the torques of all joints."""

    def with_base_parameters(self, columns: Sequence[int]) -> StandingRobot:
        """Return the robot whose observation matrix has these columns of standard parameters."""

    def observed_rows(self, states: States) -> Array:
        """Return the observation matrix (T, 6 + r, p) without contact forces, unweighted."""

    def pull_back(self, states: States, G: Array) -> States:
        """Return the gradient by q, v and a of a function with gradient G by the rows."""

    def used_shares(self, states: States) -> Array:
        """Return the used share (T, c) of each limit: 1 at the limit, less within it."""

    def worst_shares(
        self, states: States, starts: range, maps: Sequence[Array], half_range: Array
    ) -> tuple[Array, Array]:
        """Return the largest used share of each limit in each block of instants, (B c,).

        Also its derivatives (B c, m, k). A block has the `starts.step` instants from one of the B
        starts on. The `maps`, three of (T, k), give position, velocity and acceleration of a
        coordinate of half range 1; `half_range` (m,) scales them.
        """

    def joint_torques(self, states: States) -> Array:
        """Return the joint torques (T, n)."""

    def plan(self, basis: Basis, planned: Array, time: Array) -> tuple[Trajectory, StancePlan]:
        """Return the trajectory of all joints, and base and forces at times."""


@singledispatch
def standing_robot(
    robot: Robot,
    stance: Stance,
    bounds: JointLimits,
    limits: Limits | None,
    torque_joints: str | Sequence[str] | None,
) -> StandingRobot:
    """Return a robot in a stance. Raises ExcitationError for one that cannot stand.

    The `bounds` are the limits of joint positions, velocities and accelerations with their
    defaults; of `limits` only those of joint torques count, and limits of motors are refused.
    """
    raise ExcitationError(
        f"stance= needs a floating base, and that of '{robot.name}' is fixed: load it with "
        "base='floating' and contacts=[...]",
        "stance=",
        "base='floating'",
    )


def refuse_in_stance(basis: str, **arguments: bool) -> None:
    """Raise ExcitationError for arguments of `design_excitation` that a stance does not have."""
    if basis == "multisine":
        raise ExcitationError(
            "basis='multisine' is not available with stance=: take bspline, polynomial or fourier",
            "basis='multisine'",
        )
    for name, is_given in arguments.items():
        if is_given:
            raise ExcitationError(
                f"{name}= is not available with stance=: the motion starts and ends at rest in the "
                "posture of the stance, is for the base parameters, and knows neither a scene nor "
                "previous logs",
                f"{name}=",
            )
