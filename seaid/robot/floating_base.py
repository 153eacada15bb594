"""The floating base of a robot: its own body, and the model with a free joint above it.

The base has six equations without a motor, of the force and the moment on it. In its own frame they
depend neither on where the base is nor on how fast it moves, but on its angular velocity w and
acceleration e and on the specific force f = R^T (a - g) of its origin, which an accelerometer
measures: with the model's velocity (0, w), acceleration (f, e) and no gravity, inverse dynamics
gives the same force as with the true ones.

A planar base, as that of a hopper on a boom or of a wheeled platform, moves in one plane. Its guide
has unknown forces along the normal of the plane and unknown moments about the two axes in it: the
three equations of these directions determine nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from seaid._arrays import Array, BoolArray, FrozenMapping
from seaid._progress import Display
from seaid.errors import RobotError, check_name

if TYPE_CHECKING:
    from seaid.robot.pinocchio_model import Assembly, BaseKind

_NORMALS: dict[BaseKind, tuple[float, float, float]] = {
    "planar_yz": (1.0, 0.0, 0.0),
    "planar_xz": (0.0, 1.0, 0.0),
    "planar_xy": (0.0, 0.0, 1.0),
}
"""{kind of a base that is guided in a plane: the normal of that plane, in the axes of its link}."""

HANGING = "hanging"
"""In place of the contacts of a stance: the base is bolted to the world, as in its frame's axes."""

BASE_ROWS = (
    *("base force x", "base force y", "base force z"),
    *("base moment x", "base moment y", "base moment z"),
)
"""The equations of the base, in its own frame [N, N m]."""


@dataclass(frozen=True, repr=False)
class Contact(Display):
    """A place of the robot that touches the ground: a point, or a flat foot.

    Parameters
    ----------
    link : str
        Link of the URDF.
    position_m : 3 floats, default (0, 0, 0)
        The place in the frame of the link [m].
    is_flat : bool, default False
        Whether the contact has moments, as that of a flat foot; a point has forces only.
    radius_m : float, default 0
        Radius of a ball about the place [m], which touches level ground with its lowest point; the
        log then needs the orientation of the base.

    Examples
    --------
    >>> Contact("FL_foot", radius_m=0.02), Contact("left_sole", is_flat=True)
    """

    link: str
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_flat: bool = False
    radius_m: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class FloatingBase(Display):
    """The base of a robot that nothing holds. Its body is the last of the robot's.

    Attributes
    ----------
    link : str
        The link whose frame is that of the base.
    frames : mapping {link: (body, rotation (3, 3), position (3,))}
        Where each link of the file is: the place of its body in `Robot.body_names`, -1 for the
        base, and its placement in the frame of that body.
    contacts : tuple of Contact
        Where the robot can touch the ground.
    imu_link : str or None
        The link of the inertial measurement unit, None: that of the base.
    normal : 3 floats or None
        The normal of the plane in which a guide lets the base move, an axis of its frame; the base
        turns about it. None: the base moves freely.
    upright : array (3, 3) or None
        The rotation of a planar base in the world at the angle zero, None: it has the world's axes.
    """

    link: str
    frames: Mapping[str, tuple[int, Array, Array]]
    contacts: tuple[Contact, ...] = ()
    imu_link: str | None = None
    normal: tuple[float, float, float] | None = None
    upright: Array | None = None

    def _in_short(self) -> str:
        planar = "planar, " * (self.normal is not None)
        return f"{planar}'{self.link}', contacts {', '.join(self.contact_links) or 'none'}"

    @property
    def kind(self) -> BaseKind:
        """What `load_robot(base=)` takes for this base."""
        if self.normal is None:
            return "floating"
        names = {normal: kind for kind, normal in _NORMALS.items()}
        return names.get(self.normal, "planar") if self.upright is None else "planar"

    def frame(self, link: str) -> tuple[int, Array, Array]:
        """Return where a link is. Raises RobotError with the nearest name."""
        check_name("link", link, self.frames, RobotError)
        return self.frames[link]

    @property
    def contact_links(self) -> tuple[str, ...]:
        """The links of the contacts."""
        return tuple(contact.link for contact in self.contacts)

    def contact_of(self, link: str) -> Contact:
        """Return the contact at a link, or one at its origin."""
        return next((contact for contact in self.contacts if contact.link == link), Contact(link))

    @property
    def free_axes(self) -> BoolArray:
        """Whether the base moves along x, y, z and turns about x, y, z of its frame (6,)."""
        if self.normal is None:
            return np.ones(6, dtype=bool)
        turns = np.array(self.normal) != 0
        return np.concatenate([~turns, turns])

    @property
    def turning(self) -> Array:
        """The projection (3, 3) of angular velocities on those that the base can have."""
        return np.diag(self.free_axes[3:].astype(float))

    @property
    def upright_quaternion(self) -> Array:
        """The rotation of a planar base at the angle zero as a quaternion w, x, y, z."""
        x, y, z, w = pin.Quaternion(self._upright).normalized().coeffs()
        return np.array([w, x, y, z])

    @property
    def _upright(self) -> Array:
        return np.eye(3) if self.upright is None else self.upright

    @property
    def normal_in_world(self) -> Array:
        """The normal of the plane of a planar base in the world (3,)."""
        return np.asarray(self._upright @ np.array(self.normal))

    @property
    def imu_is_fixed(self) -> bool:
        """Whether no joint moves the IMU in the frame of the base."""
        return self.frame(self.imu_link or self.link)[0] < 0

    @property
    def imu_placement(self) -> tuple[Array, Array]:
        """Rotation (3, 3) and position (3,) of the IMU in the frame of its body."""
        return self.frame(self.imu_link or self.link)[1:]


def base_of_assembly(
    built: Assembly,
    contacts: Sequence[str | Contact],
    imu_link: str | None,
    kind: BaseKind,
) -> FloatingBase:
    """Return the base of an assembled robot. Raises RobotError."""
    link, at_root = built.tree.root, built.tree.at_root
    if built.bodies[-1, 0] <= 0:
        raise RobotError(
            f"base='{kind}': the link '{link}' of '{built.tree.path}' and what is fixed to it have "
            "no mass: give the base its <inertial>, or load the robot with base='fixed'",
            f"base='{kind}'",
            "base='fixed'",
        )
    frames = {
        name: (built.order[joint - 1] if joint else -1, placement.rotation, placement.translation)
        for name, (joint, placement) in built.frames.items()
    }
    touching = tuple(Contact(x) if isinstance(x, str) else x for x in contacts)
    base = FloatingBase(
        link=link,
        frames=FrozenMapping(frames, "link"),
        contacts=touching,
        imu_link=imu_link,
        normal=_normal(built, kind),
        upright=at_root.placement.rotation if at_root and at_root.type == "planar" else None,
    )
    _check_links(base)
    return base


class ImuMotion(NamedTuple):
    """How joints move the IMU against the base, in the axes of the base.

    The rotation (T, 3, 3) of the IMU, its place, velocity and acceleration (T, 3), and its angular
    velocity (T, 3); T is 1 if no joint moves it.
    """

    rotation: Array
    place: Array
    velocity: Array
    acceleration: Array
    angular_velocity: Array


def imu_motion(
    base: FloatingBase, model: pin.Model, order: Sequence[int], states: Sequence[Array]
) -> ImuMotion:
    """Return how joints move the IMU of a base, whose model has the bodies in an `order`.

    The states q, q', q'' (T, n) are those of the model.
    """
    body, rotation, place = base.frame(base.imu_link or base.link)
    if body < 0:
        still = np.zeros((1, 3))
        return ImuMotion(rotation[None], place[None], still, still, still)
    model, joint = pin.Model(model), 1 + order.index(body)
    imu = pin.Frame("imu of seaid", joint, 0, pin.SE3(rotation, place), pin.FrameType.OP_FRAME)
    frame, data = model.addFrame(imu, False), model.createData()
    motion, axes = np.empty((len(states[0]), 7, 3)), pin.LOCAL_WORLD_ALIGNED
    for t, (q_t, v_t, a_t) in enumerate(zip(*states, strict=True)):
        pin.forwardKinematics(model, data, q_t, v_t, a_t)
        placement = pin.updateFramePlacement(model, data, frame)
        rate = pin.getFrameVelocity(model, data, frame, axes)
        motion[t, :3], motion[t, 3] = placement.rotation, placement.translation
        motion[t, 4], motion[t, 6] = rate.linear, rate.angular
        motion[t, 5] = pin.getFrameClassicalAcceleration(model, data, frame, axes).linear
    return ImuMotion(motion[:, :3], *(motion[:, k] for k in range(3, 7)))


def _normal(built: Assembly, kind: BaseKind) -> tuple[float, float, float] | None:
    """Return the normal of the plane of a base. Raises RobotError for one that is no axis."""
    at_root = built.tree.at_root
    if at_root is None or at_root.type != "planar":
        return _NORMALS.get(kind)
    axis = at_root.axis
    if np.count_nonzero(axis) != 1:
        raise RobotError(
            f"'{built.tree.path}': the axis of the planar joint '{at_root.name}' must be one of "
            f"those of its child link, found {axis.tolist()}: turn it, so that the plane is xy, xz "
            "or yz"
        )
    return tuple(axis.tolist())


def _check_links(base: FloatingBase) -> None:
    """Raise RobotError for contacts and an IMU at links that cannot have them."""
    for link in base.contact_links:
        check_name("link", link, base.frames, RobotError, "contacts=", "contacts=")
        if base.contact_links.count(link) > 1:
            raise RobotError(f"contacts= names '{link}' twice", "contacts=")
    if base.imu_link is not None:
        check_name("link", base.imu_link, base.frames, RobotError, "imu_link=", "imu_link=")
