"""The robot whose base moves, and what it registers in the packages that know nothing of it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

from seaid.identification import extension_of
from seaid.robot import FloatingBase, Robot

if TYPE_CHECKING:
    from seaid.identification import Extension


@dataclass(frozen=True, eq=False, repr=False)
class FloatingRobot(Robot):
    """A robot whose base nothing holds, or a guide lets move in a plane.

    Attributes
    ----------
    floating_base : FloatingBase
        The base, whose body is the last of the robot's; `model` is that of the joints on a held
        base.
    """

    floating_base: FloatingBase = field(kw_only=True)

    def _in_short(self) -> str:
        kind = "floating" if self.floating_base.normal is None else "planar"
        return f"{super()._in_short()}, {kind} base"

    def joint_of(self, body: int) -> str:
        """Return the joint that moves a body, the first one for the base, which none moves."""
        return super().joint_of(0 if body == len(self.body_names) - 1 else body)


def on_floating_base(robot: Robot, base: FloatingBase) -> FloatingRobot:
    """Return an assembled robot, whose last body is that of the base, on this base."""
    values = {x.name: getattr(robot, x.name) for x in fields(Robot)}
    return FloatingRobot(**{**values, "floating_base": base})


def floating(robot: Robot) -> FloatingRobot:
    """Return a robot whose base is known to move, as one of its type."""
    assert isinstance(robot, FloatingRobot)
    return robot


@extension_of.register(FloatingRobot)
def _(robot: FloatingRobot) -> Extension:
    from seaid.legged.extension import LeggedExtension

    return LeggedExtension()
