"""What many tests measure: trees of joints, rows of equations, files of columns, simulations."""

import hashlib
import inspect
import os
import pickle
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np

from seaid._arrays import Array
from seaid.excitation import Trajectory
from seaid.excitation.basis import SplineBasis
from seaid.log import Log
from seaid.regressor import Regression, joint_torques
from seaid.robot import Robot

ROOT = Path(__file__).parents[1]
KEPT = ROOT / ".pytest_cache" / "simulations"
DAY_S = 86400.0
P = ParamSpec("P")
T = TypeVar("T")


@cache
def _folder_of_sources() -> Path:
    """Return the folder of results of these sources; those of others stay for a day."""
    digest = hashlib.sha256()
    patterns = {"seaid": "*.py", "scripts": "*.py", "tests": "*.py", "models": "*.*ml"}
    for name, pattern in patterns.items():
        for path in sorted((ROOT / name).rglob(pattern)):
            if not path.name.startswith("test_"):
                digest.update(path.read_bytes())
    folder = KEPT / digest.hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    for other in set(KEPT.iterdir()) - {folder}:
        if other.stat().st_mtime < time.time() - DAY_S:
            shutil.rmtree(other, ignore_errors=True)
    return folder


def kept(simulate: Callable[P, T]) -> Callable[P, T]:
    """Keep what a function returns for its arguments, for all processes that run tests.

    Simulations of whole robots take seconds, and each process would need them. A change of any
    source or model makes them anew. The arguments are distinguished by their `repr`.
    """

    @cache
    @wraps(simulate)
    def result(*arguments: P.args, **options: P.kwargs) -> T:
        module = Path(inspect.getfile(simulate)).read_bytes()
        bound = inspect.signature(simulate).bind(*arguments, **options)
        bound.apply_defaults()  # the same motion with a default given and not
        call = f"{simulate.__qualname__}{bound.args!r}{sorted(bound.kwargs.items())}"
        file = _folder_of_sources() / hashlib.sha256(module + call.encode()).hexdigest()[:32]
        if file.exists():
            found: T = pickle.loads(file.read_bytes())
            return found
        made = simulate(*arguments, **options)
        unfinished = file.with_suffix(f".{os.getpid()}")
        unfinished.write_bytes(pickle.dumps(made))
        unfinished.replace(file)
        return made

    return cast(Callable[P, T], result)


def write_columns(path: Path, columns: Mapping[str, Array], fmt: str = "%.12g") -> Path:
    """Write columns as a CSV file, or as .npz by the ending of the path."""
    if path.suffix == ".npz":
        np.savez(path, **columns)  # type: ignore[arg-type]
        return path
    table, header = np.column_stack([*columns.values()]), ",".join(columns)
    np.savetxt(path, table, fmt=fmt, delimiter=",", header=header, comments="")
    return path


def log_with(joints: str | Sequence[str], time: Array, **columns: Array) -> Log:
    """Return the log of one or several joints with columns (T,) or (T, n), others not logged."""
    names = (joints,) if isinstance(joints, str) else tuple(joints)
    unknown = np.full((len(time), len(names)), np.nan)
    needed = dict.fromkeys(("joint_position", "motor_position", "motor_torque"), unknown)
    given: dict[str, Any] = {name: x.reshape(unknown.shape) for name, x in columns.items()}
    return Log(time=time, joint_names=names, **(needed | given))


def picked(source: Log, joints: list[int], names: tuple[str, ...]) -> Log:
    """Return the log of some joints, in any order and under other names."""
    return replace(
        source,
        joint_names=names,
        motor_position=source.motor_position[:, joints],
        joint_position=source.joint_position[:, joints],
        motor_torque=source.motor_torque[:, joints],
        is_prismatic=tuple(source.is_prismatic[joint] for joint in joints),
    )


def regression(H: Array, y: Array, *, unit: str = "kg", **more: Any) -> Regression:
    """Return rows y = H theta + noise, with names a, b, ... and one equation unless told.

    Equations `joint=` follow each other in time, 0.05 s a row, unless `time=` is given.
    """
    count, width = H.shape
    joint = np.asarray(more.get("joint", np.zeros(count)), dtype=float)
    time = np.empty(count)
    for one in np.unique(joint):
        time[joint == one] = 0.05 * np.arange(np.sum(joint == one))
    plain: dict[str, Any] = {
        "names": tuple("abcdefghijklmnop"[:width]),
        "units": (unit,) * width,
        "time": time,
        "run": np.zeros(count),
        "excluded": 0,
        "propagated": np.empty((count, 0)),
    }
    return Regression(H=H, y=y, **(plain | more | {"joint": joint}))


def body(number: int) -> str:
    """Return the inertia of a link, different for every number."""
    rng = np.random.default_rng(number)
    com, rpy = rng.uniform(-0.1, 0.1, 3), rng.uniform(-1, 1, 3)
    ixx, iyy, izz = 0.02 + 0.01 * rng.random(3)
    return (
        f'<inertial><origin xyz="{com[0]} {com[1]} {com[2]}" rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/>'
        f'<mass value="{1 + rng.random()}"/><inertia ixx="{ixx}" ixy="0.001" ixz="-0.002" '
        f'iyy="{iyy}" iyz="0.0015" izz="{izz}"/></inertial>'
    )


def states(n: int, count: int = 6, seed: int = 0) -> tuple[Array, Array, Array]:
    """Return random q, v and a, each (count, n)."""
    q, v, a = np.random.default_rng(seed).uniform(-1, 1, (3, count, n))
    return q, 2 * v, 5 * a


def torque_slopes_by_steps(robot: Robot, states: Sequence[Array], step: float) -> Array:
    """Return the derivatives (3, T, n, n) of torques by q, v and a, by central differences."""
    slopes = np.empty((3, *states[0].shape, robot.n))
    for order in range(3):
        for joint in range(robot.n):
            ends = []
            for sign in (1, -1):
                moved = [state.copy() for state in states]
                moved[order][:, joint] += sign * step
                ends.append(joint_torques(robot, *moved))
            slopes[order, :, :, joint] = (ends[0] - ends[1]) / (2 * step)
    return slopes


Bodies = Mapping[str, str] | str


def tree(joints: Mapping[str, str], bodies: Bodies = "") -> str:
    """Return links and joints of a URDF: {joint: "type parent child <elements>"}.

    Parameters
    ----------
    joints : {str: str}
        Each with what it is, the links that it joins, and its elements.
    bodies : {str: str} or str
        What stands in a link, or in all that are a child.
    """
    ends = {name: text.split(" ", 3) for name, text in joints.items()}
    links = dict.fromkeys(link for _, *pair in ends.values() for link in pair[:2])
    children = {child for _, _, child, *_ in ends.values()}
    own = dict.fromkeys(children, bodies) if isinstance(bodies, str) else bodies
    text = "".join(f'<link name="{link}">{own.get(link, "")}</link>' for link in links)
    for name, (kind, parent, child, *elements) in ends.items():
        text += f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        text += f'<child link="{child}"/>{"".join(elements)}</joint>'
    return text


def write_robot(
    path: Path, joints: Mapping[str, str], bodies: Mapping[str, str] | str = ""
) -> Path:
    """Write a URDF of a `tree`, its name that of the file."""
    path.write_text(f'<robot name="{path.stem}">{tree(joints, bodies)}</robot>', encoding="utf-8")
    return path


def polynomial_trajectory(
    joint_names: Sequence[str],
    duration: float,
    coefficients: Any,
    prismatic_joints: Sequence[str] = (),
) -> Trajectory:
    """Return the polynomial trajectory sum_i a_i t^i (18) over `duration` [s], of a_i (d+1, n)."""
    from scipy.special import comb

    powers = np.asarray(coefficients, dtype=float)
    count = len(powers)
    i, j = np.indices((count, count))
    # t^j = duration^j sum_i C(i, j) / C(d, j) B_i(t / duration), i >= j
    # (Farouki and Rajan 1988)
    bernstein = np.where(j <= i, comb(i, j) / comb(count - 1, j), 0.0)
    values = bernstein @ (powers * (duration ** np.arange(count))[:, None])
    basis = SplineBasis(count - 1, np.repeat([0.0, duration], count))
    return Trajectory(tuple(joint_names), basis, values, tuple(prismatic_joints))
