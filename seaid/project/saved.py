"""Saved runs: an identification with its validations and origin, whole in one file.

Results are frozen dataclasses. The file is an NPZ archive of their arrays and one JSON text of all
the rest, in which an object names its class; only the classes in the annotations of a run are made
again. Nothing is pickled or evaluated.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, get_args
from zipfile import is_zipfile

import numpy as np
from numpy.typing import NDArray

from seaid._arrays import Array, FrozenMapping
from seaid._files import followed, whole_file
from seaid._progress import Display
from seaid.drives import IDEAL_DRIVE, ParameterName, drive_table
from seaid.drives.toml import drives_from_mapping
from seaid.errors import SeaidError, checked, hints_of, listed, reason_of, shown
from seaid.identification import Fit, Identification, Validation
from seaid.log import Motion
from seaid.log.channels import Refusals
from seaid.log.motion import MotionWithBase, decimated
from seaid.robot import Robot
from seaid.robot.pinocchio_model import ModelJoint, joints_of, model_of
from seaid.simulation import ReplayComparison

# Not that of `project`, which loads all that reads and identifies.
refusal = Refusals(Path(__file__).with_name("refusals.toml"), SeaidError)
"""Return the error of a code about a saved run."""

FILE = "identification.npz"
"""The name of the saved run in the folder of a run."""

_FORMAT = "seaid run 7"
"""The format of this version, the only one that loads. It rises when a file of before would load
wrongly or not at all: 1 had no checksum, 2 had findings in estimates, 3 is from before robots with
a floating base had a type of their own, 4 had the parts of a run one by one, 5 no estimator, and 6
motions with a base that were of no type of their own."""

_RATE_PER_CUTOFF = 25.0
"""Least sampling rate of a saved motion over its cutoff; positions have five times the cutoff."""


@dataclass(frozen=True, eq=False, repr=False)
class Run(Display):
    """A saved run.

    Attributes
    ----------
    identification : Identification
        With motions of `thinned` samples.
    validations : mapping {log: Validation}
        Validations by the names of their logs.
    replays : mapping {log: ReplayComparison}
        Replays before and after, of logs with position commands.
    provenance : mapping
        Versions, inputs with their digests, options and command line, as plain data.
    folder : Path or None
        The folder of the run, if it was read from one.
    """

    identification: Identification
    validations: Mapping[str, Validation] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    folder: Path | None = None
    replays: Mapping[str, ReplayComparison] = field(default_factory=dict)

    @property
    def tests(self) -> tuple[Validation | ReplayComparison, ...]:
        """Its validations and replays."""
        return (*self.validations.values(), *self.replays.values())

    def _in_short(self) -> str:
        logs = f", validated on {listed(list(self.validations))}" if self.validations else ""
        return f"{self.identification!r}{logs}"


@checked(SeaidError)
def save_run(
    identification: Identification,
    path: str | Path,
    *,
    validations: Mapping[str, Validation] | None = None,
    provenance: Mapping[str, Any] | None = None,
    replays: Mapping[str, ReplayComparison] | None = None,
) -> None:
    """Save an identification whole, so that nothing has to be identified again.

    Parameters
    ----------
    identification : Identification
    path : str or Path
        The file to write, ending in .npz. Motions of high rate are thinned to 25 times the cutoff;
        a measured torque is low-passed before.
    validations : mapping {log: Validation}, optional
        Validations of it, by the names of their logs.
    provenance : mapping, optional
        Where it comes from, as plain data.
    replays : mapping {log: ReplayComparison}, optional
        Replays of it, by the names of their logs.

    Raises
    ------
    SeaidError
        For another suffix, and if the file cannot be written.

    Examples
    --------
    >>> seaid.project.save_run(result, "leg.npz", validations={"other.csv": validation})
    >>> seaid.project.load_run("leg.npz").identification.summary()
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise SeaidError(f"'{path}': a saved run must end in .npz")
    thinned = tuple(map(_thinned, identification.motions))
    tests = {name: _thinned_validation(test) for name, test in (validations or {}).items()}
    fit = replace(identification, motions=thinned)
    run = Run(fit, tests, provenance or {}, replays=replays or {})
    arrays: dict[str, Array] = {}
    content = {"format": _FORMAT, "run": _plain(run, arrays)}
    text: Any = np.frombuffer(json.dumps(content).encode(), dtype=np.uint8)
    arrays["content"] = text
    checksum: Any = _checksum(arrays)
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, checksum=checksum, **arrays)


def _checksum(arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """Return the SHA-256 (32,) of the names, types, shapes and numbers of arrays."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode("utf-8", "replace"))
        digest.update(np.ascontiguousarray(array).tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)


@checked(SeaidError)
def load_run(path: str | Path) -> Run:
    """Load a saved run.

    Parameters
    ----------
    path : str or Path
        The folder of a run of `seaid run`, or a file of `save_run`.

    Returns
    -------
    Run

    Raises
    ------
    SeaidError
        If there is no saved run, and for a damaged file or one of another version.

    Examples
    --------
    >>> run = seaid.project.load_run("runs/latest")
    >>> print(run.identification.verdict.sentence)
    """
    path = followed(path)
    file = path / FILE if path.is_dir() else path
    try:
        with file.open("rb") as archive:
            stored = np.load(archive, allow_pickle=False) if is_zipfile(file) else {}
            arrays: dict[str, NDArray[Any]] = dict(stored)
        if "content" not in arrays:
            raise ValueError("it is no archive of a run")
        content = json.loads(arrays["content"].tobytes())
        if content["format"] != _FORMAT:
            raise refusal("other_format", stored=shown(content["format"]), read=_FORMAT)
        if not np.array_equal(arrays.pop("checksum"), _checksum(arrays)):
            raise ValueError("its content is not what was saved, by its checksum")
        run: Run = _restored(content["run"], arrays)
        identification = _with_copies(run.identification, file.parent / "inputs")
        folder = path if path.is_dir() else None
        return replace(run, identification=identification, folder=folder)
    except FileNotFoundError:
        raise _without_run(path) from None
    except SeaidError as problem:
        raise SeaidError(f"'{file}' cannot be loaded: {problem}") from None
    except Exception as problem:  # a damaged file raises any exception of its readers
        raise refusal("damaged", file=file, reason=reason_of(problem)) from None


def _without_run(path: Path) -> SeaidError:
    """Return the error for a path without a saved run."""
    if conditions := sorted(saved.parent.name for saved in path.glob(f"*/{FILE}")):
        return refusal("several", path=path, first=path / conditions[0], names=listed(conditions))
    return refusal("no_run", path=path)


def _fields_of(value: Any) -> dict[str, Any]:
    """Return the fields of an object of a dataclass."""
    return {attribute.name: getattr(value, attribute.name) for attribute in fields(value)}


def _with_copies(identification: Identification, inputs: Path) -> Identification:
    """Return the identification with the copy of its URDF in the run, if the file is gone."""
    path = identification.robot.urdf
    if path is None or path.exists() or not (inputs / path.name).exists():
        return identification
    robots = {name: getattr(identification, name) for name in ("robot", "known")}
    moved = {name: replace(robot, urdf=inputs / path.name) for name, robot in robots.items()}
    return replace(identification, **moved)


def _factor(motion: Motion) -> int:
    return max(1, int(motion.rate_hz / (_RATE_PER_CUTOFF * motion.cutoff_hz)))


def _thinned(motion: Motion) -> Motion:
    """Return the motion with the least rate that is `_RATE_PER_CUTOFF` times the cutoff."""
    return decimated(motion, factor) if (factor := _factor(motion)) > 1 else motion


def _thinned_validation(validation: Validation) -> Validation:
    """Return the validation with thinned motions and the same samples of its torques."""
    # The torques of all motions follow each other, and are thinned as each motion is.
    each = [np.arange(len(motion.time)) % _factor(motion) == 0 for motion in validation.motions]
    kept = np.concatenate(each) if each else np.zeros(0)
    if kept.shape != validation.time.shape:
        return validation

    def thinned(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value[kept] if value.shape[:1] == kept.shape else value
        if isinstance(value, Fit):
            return replace(value, **{name: thinned(x) for name, x in _fields_of(value).items()})
        return value

    content = {name: thinned(x) for name, x in _fields_of(validation).items()}
    content["motions"] = tuple(map(_thinned, validation.motions))
    return replace(validation, **content)


@cache
def _classes() -> dict[str, Any]:
    """Return the dataclasses of a run by their names: those in the annotations of its parts."""
    from seaid.legged import FloatingRobot, LeggedValidation

    found: dict[str, Any] = {}
    # Next to a run the subtypes of the types in its annotations. With the latter all is loaded
    # that a robot on a floating base has registered.
    waiting: list[Any] = [Run, FloatingRobot, MotionWithBase, LeggedValidation]
    while waiting:
        hint = waiting.pop()
        waiting += get_args(hint)
        if isinstance(hint, type) and is_dataclass(hint) and hint.__name__ not in found:
            found[hint.__name__] = hint
            waiting += hints_of(hint).values()
    return found


def _plain(value: Any, arrays: dict[str, Array]) -> Any:
    """Return a value as JSON data; its arrays are added to `arrays`."""
    plain = partial(_plain, arrays=arrays)
    if isinstance(value, np.ndarray):
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {"is": "array", "name": name}
    if type(value).__name__ in _classes():
        content = _robot_fields(value) if isinstance(value, Robot) else _fields_of(value)
        return {"is": type(value).__name__, "fields": plain(content)}
    if isinstance(value, ParameterName):
        return {"is": "ParameterName", "parts": list(value.__getnewargs__())}
    if isinstance(value, Path):
        return {"is": "Path", "path": str(value.absolute())}
    if isinstance(value, Mapping):
        return {"is": "mapping", "items": [[key, plain(entry)] for key, entry in value.items()]}
    if isinstance(value, list | tuple):
        return list(map(plain, value))
    return value.item() if isinstance(value, np.generic) else value


def _restored(value: Any, arrays: Mapping[str, Array]) -> Any:
    """Return the value of which `_plain` made this JSON data; sequences come back as tuples."""
    restored = partial(_restored, arrays=arrays)
    if isinstance(value, list):
        return tuple(map(restored, value))
    if not isinstance(value, dict):
        return value
    kind = value["is"]
    if kind == "array":
        return arrays[value["name"]]
    if kind == "mapping":
        return FrozenMapping({key: restored(entry) for key, entry in value["items"]})
    if kind == "ParameterName":
        return ParameterName(*value["parts"])
    if kind == "Path":
        return Path(value["path"])
    make = _classes()[kind]
    if issubclass(make, Robot):
        make = partial(_robot, make)
    return make(**restored(value["fields"]))


def _robot_fields(robot: Robot) -> dict[str, Any]:
    """Return the fields of a robot, its model as joints and its drives as tables."""
    joints = tuple(map(vars, joints_of(robot.model)))
    model = {"gravity": robot.model.gravity.linear.copy(), "joints": joints}
    tables = {joint: drive_table(drive) for joint, drive in robot.drives.items()}
    return {**_fields_of(robot), "model": model, "drives": tables}


def _robot(kind: type[Robot], **content: Any) -> Robot:
    """Return the robot of `_robot_fields`."""
    joints = [ModelJoint(**values) for values in content["model"]["joints"]]
    drives = {
        joint: IDEAL_DRIVE if drive == IDEAL_DRIVE else drive
        for joint, drive in drives_from_mapping(content["drives"]).items()
    }
    model = model_of(content["name"], content["model"]["gravity"], joints)
    robot = kind(**{**content, "model": model, "drives": drives})
    # `model_of` makes joints only: this sets the inertias of the model.
    return robot.with_values(robot.parameters, drives)
