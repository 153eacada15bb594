"""The records of the golden file: what is kept of a result, by names of joints and parameters.

A record is plain data, a list whose first element is its kind:

    ["value", x, s]                  an estimate and its standard error
    ["number", x]                    a number without a standard error
    ["text", "..."]                  a word, or a sentence
    ["codes", ["code severity", ..]] the findings of a joint, sorted; "" is the whole robot
    ["file", sha256, form, [..]]     a file: the hash of it, the hash of its text without comments
                                     and numbers, and its numbers
"""

from __future__ import annotations

import hashlib
import re
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, SupportsFloat, get_args

import seaid

Record = list[Any]
Records = dict[str, Record]
Build = Callable[[], seaid.Identification]

DIGITS = 12
"""Significant digits of the numbers in the file."""


@dataclass(frozen=True)
class Case:
    """One case: a function without arguments that returns records.

    Attributes
    ----------
    name, group : str
        Its name, unlike all others, and its group.
    records : callable
        Returns the records by names; an exception becomes a record.
    quick : bool
        Whether `--quick` has it.
    batch : str
        Cases of one batch run one after the other in one process, and share simulated logs.
    """

    name: str
    group: str
    records: Callable[[], Records]
    quick: bool = False
    batch: str = ""


@dataclass(frozen=True)
class KnownWrong:
    """Records that are known to be wrong: `*` in the case or the record stands for any text."""

    case: str
    record: str
    reason: str


def rounded(x: float) -> float:
    """Return a number with the digits of the file."""
    return float(f"{x:.{DIGITS}g}")


def number(x: SupportsFloat) -> Record:
    """Return the record of a number."""
    return ["number", rounded(float(x))]


def text(x: object) -> Record:
    """Return the record of a text."""
    return ["text", str(x)]


def of_error(problem: BaseException) -> Records:
    """Return the records of an exception: its type, and its text without folders."""
    words = re.sub(r"(?:/[\w.+-]+)+/(?=[\w.+-]*)", "", str(problem))
    return {"error": text(type(problem).__name__), "error text": text(words)}


def of_estimate(prefix: str, estimate: seaid.Estimate) -> Records:
    """Return the records of the values of an estimate."""
    rows = zip(estimate.names, estimate.values, estimate.standard_errors, strict=True)
    return {f"{prefix} {name}": ["value", rounded(x), rounded(s)] for name, x, s in rows}


_TERMS = re.compile(r"= \[(\"[^\]]*)\]")


def of_findings(findings: Iterable[seaid.Finding]) -> Records:
    """Return the records of findings: codes with severities, and terms of remedies, by joint."""
    codes: dict[str, list[str]] = {}
    for finding in findings:
        terms = "".join(f" [{x}]" for x in _TERMS.findall(finding.remedy))
        codes.setdefault(finding.joint, []).append(f"{finding.code} {finding.severity}{terms}")
    return {f"codes {joint}": ["codes", sorted(each)] for joint, each in sorted(codes.items())}


def of_identification(found: seaid.Identification, has_load: bool = True) -> Records:
    """Return the records of an identification; without `has_load` not those of its bodies."""
    records: Records = {
        "verdict": text(found.verdict.level),
        "cutoff_hz": number(found.cutoff_hz),
        "base parameters": number(len(found.load.names)),
        **of_findings(found.weighed_findings),
    }
    for joint, estimate in found.drives.items():
        records |= of_estimate(f"{joint}", estimate)
    for joint, estimate in found.gears.items():
        records |= of_estimate(f"gear of {joint}", estimate)
    if has_load:
        records |= of_estimate("load", found.load)
    if found.feasible is not None:
        records |= {f"active bound: {x}": text("active") for x in found.feasible.active_bounds}
    return records


def of_validation(found: seaid.Identification, log: seaid.Log) -> Records:
    """Return the relative errors of the predicted torques of a log, by joint."""
    validation = seaid.validate(found, log)
    sides = {"actuator": validation.actuator, "load": validation.load}
    return {
        f"error of the {side} torque of {joint}": number(x)
        for side, fit in sides.items()
        for joint, x in zip(found.robot.joint_names, fit.relative_error, strict=True)
    }


_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?!\w)")
_COMMENT = {
    ".toml": re.compile(r"(?m)(?:^|\s)#[^\"'\n]*$"),
    ".py": re.compile(r"(?m)(?:^|\s)#[^\"'\n]*$"),
    ".yaml": re.compile(r"(?m)(?:^|\s)#[^\"'\n]*$"),
    ".usda": re.compile(r"(?m)(?:^|\s)#(?!usda)[^\"'\n]*$"),
    ".xml": re.compile(r"<!--.*?-->", re.DOTALL),
    ".urdf": re.compile(r"<!--.*?-->", re.DOTALL),
}


def of_text(content: str, suffix: str = "") -> Record:
    """Return the record of the content of a file with this suffix."""
    bare = _COMMENT[suffix].sub("", content) if suffix in _COMMENT else content
    form = " ".join(_NUMBER.sub("#", bare).split())
    numbers = [rounded(float(one)) for one in _NUMBER.findall(bare)]
    return ["file", _hash(content), _hash(form), numbers]


def of_file(path: Path) -> Record:
    """Return the record of a file."""
    content = path.read_text("utf-8").replace(str(path.parent), "FOLDER")
    return of_text(content, path.suffix)


def _hash(content: str) -> str:
    return hashlib.sha256(content.encode()).hexdigest()[:32]


def of_settings(path: Path) -> Records:
    """Return each setting of a TOML file as a record of its own; folders are replaced."""
    content = path.read_text("utf-8").replace(str(path.parent), "FOLDER")
    return {
        f"{path.name}: {name}": number(x)
        if isinstance(x, int | float) and not isinstance(x, bool)
        else text(x)
        for name, x in _flat(tomllib.loads(content))
    }


def _flat(content: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the scalars of tables and lists by their names."""
    if isinstance(content, Mapping):
        for key, each in content.items():
            yield from _flat(each, f"{name}.{key}" if name else str(key))
    elif isinstance(content, list):
        for place, each in enumerate(content):
            yield from _flat(each, f"{name}[{place}]")
    else:
        yield name, content


@contextmanager
def folder_of_files() -> Iterator[Path]:
    """Yield a folder that is removed."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def exported(build: Build) -> Records:
    """Write an identified robot in all formats; a refusal is a record."""
    found = build()
    formats = sorted(get_args(seaid.export.FormatName))
    records: Records = {}
    with folder_of_files() as folder:
        for form in formats:
            try:
                suffix = seaid.export.FORMATS[form].suffix
                written = seaid.write_model(found, folder / f"{form}{suffix}", form)
            except seaid.SeaidError as problem:
                records |= {f"{form}: {key}": x for key, x in of_error(problem).items()}
                continue
            records[form] = of_file(written.path)
            if written.drives is not None:
                records[f"{form}, drives"] = of_file(written.drives)
            parts = of_findings(written.warnings)
            records |= {f"{form}: {key}": record for key, record in parts.items()}
        if found.feasible is not None:
            path = folder / "randomization.json"
            seaid.export.write_randomization(found, path, samples=3)
            records["randomization"] = of_file(path)
    return records


def parameters(build: Build) -> Records:
    """Write `parameters.json`, and read it again."""
    found = build()
    with folder_of_files() as folder:
        seaid.write_parameters(found, folder / "parameters.json")
        robot = seaid.read_parameters(folder / "parameters.json", found.known)
    bodies = {f"parameter {place}": number(x) for place, x in enumerate(robot.parameters)}
    drives = {
        f"{joint} {name}": number(x)
        for joint, drive in robot.drives.items()
        for name, x in drive.values.items()
    }
    return bodies | drives


def of_build(build: Build) -> Records:
    """Return the records of the identification that a function returns."""
    return of_identification(build())
