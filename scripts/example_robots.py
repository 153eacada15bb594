"""The robots of example-robot-data, for scripts and tests: an extra of seaid, `[robots]`."""

from __future__ import annotations

import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

NOT_LOADABLE = ("ur3.urdf", "quadrotor_base.urdf", "iris_simple.urdf")
"""Files of example-robot-data that are not robots: a xacro fragment, and two without joints."""


@cache
def example_urdfs() -> tuple[Path, ...]:
    """Return the URDFs of example-robot-data that have joints, sorted.

    Ends the script with a message if the package is not installed.
    """
    try:
        found = [Path(str(path.locate())) for path in files("example-robot-data") or []]
    except PackageNotFoundError:
        sys.exit(
            "the robots of this script are those of example-robot-data, which is not installed: "
            "make dev, or pip install '.[robots]'"
        )
    urdfs = [path for path in found if path.suffix == ".urdf" and path.name not in NOT_LOADABLE]
    return tuple(sorted(path.resolve() for path in urdfs))


def example_urdf(name: str) -> Path:
    """Return the path of a URDF of example-robot-data by the name of its file, 'panda.urdf'."""
    return next(path for path in example_urdfs() if path.name == name)
