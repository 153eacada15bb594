"""Saved runs: an identification with its validations and origin, whole in one file.

The origin (`provenance_of`) has versions, inputs with their digests, options and command line.
Results are frozen dataclasses. The file is an NPZ archive of their arrays and one JSON text of all
the rest, in which an object names its class; only the classes listed here are made again. Nothing
is pickled or evaluated.
"""

from __future__ import annotations

import hashlib
import json
import platform
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from seaid._arrays import Array, FrozenMapping
from seaid._files import followed, whole_file
from seaid._progress import Display
from seaid.drives import IDEAL_DRIVE, JointParameter, drive_table, drives_from_mapping
from seaid.errors import Finding, SeaidError, checked, listed
from seaid.estimation import Estimate, ModelChecks, TermTest, Whiteness
from seaid.identification import (
    ContactForces,
    FeasibleParameters,
    Fit,
    Identification,
    JointCheck,
    JointFit,
    Validation,
)
from seaid.log import BaseMotion, CutoffSelection, Motion, Processing, Repair, decimated
from seaid.regressor import BaseParameters, LoadModel
from seaid.robot import Contact, DependentJoint, FloatingBase, Robot, joints_of, model_of
from seaid.simulation import ReplayComparison

FILE = "identification.npz"
"""The name of the saved run in the folder of a run."""

_FORMAT = "seaid run 1"
_OLDER: dict[str, Any] = {"replays": {"is": "mapping", "items": []}}
"""What files that are older than a field have in its place."""
_CLASSES = {
    kind.__name__: kind
    for kind in (
        *(Identification, Estimate, BaseParameters, LoadModel, ModelChecks, TermTest, Whiteness),
        *(
            FeasibleParameters,
            JointCheck,
            JointFit,
            Finding,
            Processing,
            CutoffSelection,
            Repair,
            Motion,
        ),
        *(Validation, Fit, ContactForces, Robot, DependentJoint, ReplayComparison),
        *(FloatingBase, Contact, BaseMotion),
    )
}
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
    >>> seaid.save_run(result, "leg.npz", validations={"other.csv": validation})
    >>> seaid.load_run("leg.npz").identification.summary()
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise SeaidError(f"'{path}': a saved run must end in .npz")
    thinned = tuple(map(_thinned, identification.motions))
    arrays: dict[str, Array] = {}
    content = {
        "format": _FORMAT,
        "identification": _plain(replace(identification, motions=thinned), arrays),
        "validations": _plain(
            {name: _thinned_validation(one) for name, one in (validations or {}).items()}, arrays
        ),
        "provenance": _plain(dict(provenance or {}), arrays),
        "replays": _plain(dict(replays or {}), arrays),
    }
    text = np.frombuffer(json.dumps(content).encode(), dtype=np.uint8)
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, content=text, **arrays)


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
    >>> run = seaid.load_run("runs/latest")
    >>> print(run.identification.verdict.sentence)
    """
    path = followed(path)
    file = path / FILE if path.is_dir() else path
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        content = json.loads(arrays.pop("content").tobytes())
        if content["format"] != _FORMAT:
            raise SeaidError(f"'{file}' has the format {content['format']!r}, not {_FORMAT!r}")
        identification, validations, provenance, replays = (
            _restored((_OLDER | content)[name], arrays)
            for name in ("identification", "validations", "provenance", "replays")
        )
        found = _with_copies(identification, file.parent / "inputs")
        return Run(found, validations, provenance, path if path.is_dir() else None, replays)
    except FileNotFoundError:
        if conditions := sorted(one.parent.name for one in path.glob(f"*/{FILE}")):
            raise SeaidError(
                f"'{path}' is a run of several conditions: name the folder of one, as "
                f"{path / conditions[0]}; they are {listed(conditions)}"
            ) from None
        raise SeaidError(
            f"no saved run at '{path}': name a folder of `seaid run`, such as runs/latest, or a "
            "file of save_run"
        ) from None
    except (OSError, EOFError, LookupError, TypeError, ValueError, zipfile.BadZipFile) as one:
        raise SeaidError(f"'{file}' is no saved run, or damaged: {one}") from None


def _with_copies(found: Identification, inputs: Path) -> Identification:
    """Return the identification with the copy of its URDF in the run, if the file is gone."""
    path = found.robot.urdf
    if path is None or path.exists() or not (inputs / path.name).exists():
        return found
    robots = {name: getattr(found, name) for name in ("robot", "known")}
    moved = {name: replace(one, urdf=inputs / path.name) for name, one in robots.items()}
    return replace(found, **moved)


def _thinned(motion: Motion) -> Motion:
    """Return the motion with the least rate that is `_RATE_PER_CUTOFF` times the cutoff."""
    factor = _factor(motion)
    return decimated(motion, factor) if factor > 1 else motion


def _factor(motion: Motion) -> int:
    return max(1, int(motion.rate_hz / (_RATE_PER_CUTOFF * motion.cutoff_hz)))


def _thinned_validation(one: Validation) -> Validation:
    """Return the validation with thinned motions and the same samples of its torques."""
    lengths = [len(motion.time) for motion in one.motions]
    if sum(lengths) != len(one.time):
        return one
    starts = np.cumsum([0, *lengths])
    kept = np.concatenate(
        [
            np.arange(start, start + length, _factor(motion))
            for start, length, motion in zip(starts[:-1], lengths, one.motions, strict=True)
        ]
    )
    actuator, load = (
        replace(fit, measured=fit.measured[kept], computed=fit.computed[kept])
        for fit in (one.actuator, one.load)
    )
    contacts = one.contacts
    if contacts is not None:
        forces = {"predicted": contacts.predicted[kept], "measured": contacts.measured[kept]}
        contacts = replace(contacts, **forces)
    return replace(
        one,
        time=one.time[kept],
        actuator=actuator,
        load=load,
        motions=tuple(map(_thinned, one.motions)),
        contacts=contacts,
    )


def _plain(value: Any, arrays: dict[str, Array]) -> Any:
    """Return a value as JSON data; its arrays are added to `arrays`."""
    plain = partial(_plain, arrays=arrays)
    if isinstance(value, np.ndarray):
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {"is": "array", "name": name}
    if isinstance(value, Robot):
        return {"is": "Robot", "fields": plain(_robot_fields(value))}
    if type(value).__name__ in _CLASSES:
        own = {one.name: getattr(value, one.name) for one in fields(value)}
        return {"is": type(value).__name__, "fields": plain(own)}
    if isinstance(value, JointParameter):
        return {"is": "JointParameter", "parameter": value.parameter, "joint": value.joint}
    if isinstance(value, Path):
        return {"is": "Path", "path": str(value)}
    if isinstance(value, Mapping):
        return {"is": "mapping", "items": [[key, plain(one)] for key, one in value.items()]}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(one) for one in value]
    return value.item() if isinstance(value, np.generic) else value


def _restored(value: Any, arrays: Mapping[str, Array]) -> Any:
    """Return the value of `_plain`."""
    restored = partial(_restored, arrays=arrays)
    if isinstance(value, list):
        return tuple(map(restored, value))
    if not isinstance(value, dict):
        return value
    kind = value["is"]
    if kind == "array":
        return arrays[value["name"]]
    if kind == "mapping":
        return FrozenMapping({key: restored(one) for key, one in value["items"]})
    if kind == "JointParameter":
        return JointParameter(value["parameter"], value["joint"])
    if kind == "Path":
        return Path(value["path"])
    found = restored(value["fields"])
    return _robot(found) if kind == "Robot" else _CLASSES[kind](**found)


def _robot_fields(robot: Robot) -> dict[str, Any]:
    """Return the fields of a robot, its model as joints and its drives as tables."""
    found = {one.name: getattr(robot, one.name) for one in fields(robot)}
    model = {"gravity": robot.model.gravity.linear.copy(), "joints": joints_of(robot.model)}
    tables = {joint: drive_table(drive) for joint, drive in robot.drives.items()}
    urdf = None if robot.urdf is None else robot.urdf.absolute()
    return {**found, "model": model, "drives": tables, "urdf": urdf}


def _robot(found: Mapping[str, Any]) -> Robot:
    """Return the robot of `_robot_fields`."""
    model = model_of(found["name"], found["model"]["gravity"], found["model"]["joints"])
    tables = {joint: _table(one) for joint, one in found["drives"].items()}
    drives = {
        joint: IDEAL_DRIVE if drive == IDEAL_DRIVE else drive
        for joint, drive in drives_from_mapping(tables).items()
    }
    robot = Robot(**{**found, "model": model, "drives": drives})
    return robot.with_values(robot.parameters, drives)


def _table(value: Any) -> Any:
    """Return a restored table with the lists and mappings that a reader of TOML gives."""
    if isinstance(value, Mapping):
        return {key: _table(one) for key, one in value.items()}
    return list(map(_table, value)) if isinstance(value, tuple) else value


_PACKAGES = ("numpy", "scipy", "pin", "sympy")
_DIGEST = 12
"""Characters of a digest that people read."""


def provenance_of(
    files: Iterable[Path], options: Mapping[str, Any], command: Sequence[str]
) -> dict[str, Any]:
    """Return the origin of a result as plain data."""
    from seaid import __version__

    versions = {"seaid": __version__, "python": platform.python_version()}
    for name in _PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return {
        "time_utc": datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S"),
        "command": list(command),
        "system": f"{platform.system()} {platform.release()} on {platform.machine()}",
        "versions": versions,
        "inputs": [one for path in files for one in _digests(path)],
        "options": dict(options),
    }


def _digests(path: Path) -> Iterator[dict[str, Any]]:
    """Yield path, size and SHA-256 of a file, or of all files of a folder (a bag)."""
    members = sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]
    for member in members:
        try:
            with member.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            yield {"path": str(member.resolve()), "bytes": member.stat().st_size, "sha256": digest}
        except OSError:  # the name of a robot, or removed since it was read
            yield {"path": str(member), "bytes": None, "sha256": None}


def facts_of(provenance: Mapping[str, Any]) -> dict[str, str]:
    """Return the origin as facts {name: text} of a report."""
    facts = {}
    if provenance.get("command"):
        facts["Command"] = " ".join(provenance["command"])
    for place, one in enumerate(provenance.get("inputs", ()), 1):
        size = "" if one["bytes"] is None else f", {one['bytes']} bytes"
        digest = "" if one["sha256"] is None else f", SHA-256 {one['sha256'][:_DIGEST]}…"
        facts[f"Input {place}"] = f"{one['path']}{size}{digest}"
    for name, value in provenance.get("options", {}).items():
        facts[name.replace("_", " ").capitalize()] = str(value)
    return facts


def changed_inputs(provenance: Mapping[str, Any]) -> list[str]:
    """Return the names of inputs whose content is another now than when the result was made."""
    return [
        Path(one["path"]).name
        for one in provenance.get("inputs", ())
        if one["sha256"] is not None
        and Path(one["path"]).is_file()
        and one["sha256"] != next(_digests(Path(one["path"])))["sha256"]
    ]
