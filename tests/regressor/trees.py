"""Random trees of joints: of two kinds, with axes along and askew, at right angles and others."""

from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from seaid.legged import load_robot
from seaid.robot import Robot
from tests.plants import write_robot

SLIDE = '<limit lower="0" upper="1" effort="1" velocity="1"/>'
Joint = tuple[str, str, str, str, int]
_numbers = st.sampled_from(["0", "0", "1", "-1", "0.3", "-0.25", "0.1234567"])
_triples = st.tuples(_numbers, _numbers, _numbers).map(" ".join)
_angles = st.sampled_from(["0", "0", "1.5707963267948966", "3.141592653589793", "0.4", "-1.1"])
joints = st.tuples(
    st.sampled_from(["continuous", "prismatic"]),
    _triples.filter(lambda axis: set(axis.split()) != {"0"}),
    _triples,
    st.tuples(_angles, _angles, _angles).map(" ".join),
    st.integers(0, 3),
)
"""Kind, axis, place, angles and number of the parent."""


def joints_of(tree: list[Joint]) -> dict[str, str]:
    """Return the joints j1, j2, ... of a tree with links l0, l1, ..., for `write_robot`."""
    return {
        f"j{number}": f"{kind} l{min(parent, number - 1)} l{number} "
        f'<axis xyz="{axis}"/><origin xyz="{xyz}" rpy="{rpy}"/>{SLIDE}'
        for number, (kind, axis, xyz, rpy, parent) in enumerate(tree, 1)
    }


def robot_of(folder: Path, tree: list[Joint], drives: Any = None, **options: Any) -> Robot:
    """Return the robot of a tree."""
    return load_robot(write_robot(folder / "tree.urdf", joints_of(tree)), drives, **options)
