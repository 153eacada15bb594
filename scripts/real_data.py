"""Identify every measured set, and compare the estimates with known values.

The sets are in `models/logs/`, with their sources and licences. `scripts/real_data.toml` has the
robot, drives, log description and known values of each set. With `--named` the table of causes in
`models/logs/README.md` is compared with the findings of the golden file instead.
"""

from __future__ import annotations

import argparse
import gzip
import json
import re
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import Any

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._files import result_folder
from seaid._progress import track
from seaid.log.description import description_for
from seaid.log.readers.opening import open_table
from seaid.report.formats import number

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.torque_figures import save_actuator_figure, save_load_figure

ROOT = Path(__file__).resolve().parents[1]
MODELS = ROOT / "models"
DATA = MODELS / "logs"
HEADER = ("set", "what", "found", "known", "off", "trial", "asked", "met")

_SEEN = "the motion it was identified from"


@dataclass(frozen=True)
class Case:
    """A measured set: files, known values and targets; see `scripts/real_data.toml`."""

    name: str
    robot: str
    drives: str
    logs: str
    description: str
    refused: str = ""
    weak: tuple[str, ...] = ()
    gears: str = ""
    gears_of: tuple[str, ...] = ()
    value: tuple[Mapping[str, Any], ...] = ()
    torque: Mapping[str, Mapping[str, list[float]]] = field(default_factory=dict)
    payload: tuple[Mapping[str, Any], ...] = ()
    known_bodies: tuple[str, ...] = ()
    forward: Mapping[str, float] = field(default_factory=dict)
    gains: Mapping[str, Any] = field(default_factory=dict)

    def load_robot(self) -> seaid.Robot:
        """Return the robot with its known parameters only."""
        package, _, name = self.robot.rpartition("/")
        urdf = packaged(package, name) if package else MODELS / name
        payloads = tuple(seaid.Payload(**one) for one in self.payload)
        return seaid.load_robot(
            urdf,
            drives=MODELS / self.drives,
            payloads=payloads,
            known_bodies=self.known_bodies,
        )

    def read_logs(self, robot: seaid.Robot, data: Path, description: str = "") -> list[seaid.Log]:
        """Return the logs by their description (or another one)."""
        chosen = MODELS / "logs" / (description or self.description)
        return [
            seaid.read_log(path, robot, description=chosen) for path in sorted(data.glob(self.logs))
        ]


@dataclass(frozen=True)
class Row:
    """One line of the table; `met` is None if there is no target."""

    case: str
    what: str
    found: str
    known: str = ""
    off: str = ""
    trial: str = ""
    asked: str = ""
    met: bool | None = None

    def cells(self) -> list[str]:
        """Return the line as text."""
        said = {None: "", True: "yes", False: "**no**"}[self.met]
        return [
            self.case,
            self.what,
            self.found,
            self.known,
            self.off,
            self.trial,
            self.asked,
            said,
        ]


def packaged(package: str, name: str) -> str:
    """Return the path of a file of a package. Raises RobotError if it is not installed."""
    try:
        found = files(package) or []
    except PackageNotFoundError:
        raise seaid.errors.RobotError(
            f"'{name}' is a robot of {package}, which is not installed: make dev, or pip install "
            "'.[robots]'"
        ) from None
    return next(str(path.locate()) for path in found if path.name == name)


def read_cases() -> list[Case]:
    """Return all cases of the table of data."""
    tables = tomllib.loads((ROOT / "scripts" / "real_data.toml").read_text(encoding="utf-8"))
    return [_case(table) for table in tables["case"]]


def _case(table: dict[str, Any]) -> Case:
    lists = ("weak", "gears_of", "value", "payload", "known_bodies")
    given: dict[str, Any] = {key: tuple(one) if key in lists else one for key, one in table.items()}
    return Case(**given)


def rows_of(case: Case, data: Path, output: Path) -> Iterator[Row]:
    """Identify one set, and yield the rows of estimates and known values."""
    robot = case.load_robot()
    if case.gains:
        yield from commanded_rows(case, robot, data)
        return
    try:
        logs = case.read_logs(robot, data)
    except seaid.errors.LogError as problem:
        yield Row(
            case.name,
            "refused",
            f'"{problem}"'.replace(str(data), ""),
            asked=case.refused,
            met=bool(case.refused) and case.refused in str(problem),
        )
        return
    found = seaid.identify(robot, logs)
    yield from value_rows(case, found)
    yield from weak_rows(case, found)
    yield from gear_rows(case, robot, logs, data)
    yield from torque_rows(case, robot, logs, found, output)
    yield from forward_rows(case, logs, found, data)


def commanded_rows(case: Case, robot: seaid.Robot, data: Path) -> Iterator[Row]:
    """Yield the rows of logs of position commands with several gain sets, identified together."""
    sets = gain_sets_of(case, robot, data)
    found = seaid.identify_conditions(sets, condition_specific=()).identifications
    yield from value_rows(case, next(iter(found.values())))
    pairs = [(found[title].robot, log) for title, (_, own) in sets.items() for log in own]
    errors = [np.mean(np.abs(seaid.replay(*x).joint_position - x[1].joint_position)) for x in pairs]
    yield forward_row(case, float(np.mean(errors)))


def gain_sets_of(
    case: Case, robot: seaid.Robot, data: Path
) -> dict[str, tuple[seaid.Robot, list[seaid.Log]]]:
    """Return {gains: (robot with them, logs)}."""
    sets: dict[str, tuple[seaid.Robot, list[seaid.Log]]] = {}
    logs = zip(sorted(data.glob(case.logs)), case.read_logs(robot, data), strict=True)
    for path, log in logs:
        title, own = with_gains_of(case, robot, path)
        sets.setdefault(title, (own, []))[1].append(log)
    return sets


def with_gains_of(case: Case, robot: seaid.Robot, path: Path) -> tuple[str, seaid.Robot]:
    """Return the robot with the gains of the servo in a log, in volts, and their name."""
    table = open_table(path).load([case.gains["gain"], case.gains["supply"]])
    gain, supply = (float(table[case.gains[name]][0]) for name in ("gain", "supply"))
    law = {
        "position_gain_Nm_per_rad": case.gains["factor"] * gain * supply,
        "torque_limit_Nm": supply,
    }
    drives = {
        joint: replace(drive, controller=replace(drive.controller, **law))
        for joint, drive in robot.drives.items()
        if drive.controller is not None
    }
    return f"{gain:g} at {supply:g} V", robot.with_drives(drives)


def value_of(found: seaid.Identification, name: str) -> tuple[float, float]:
    """Return value and standard error of "joint.parameter", a base parameter, or "1"."""
    if name == "1":
        return 1.0, 0.0
    joint, _, parameter = name.partition(".")
    estimate, name = (
        (found.drives[joint], parameter)
        if joint in found.drives and parameter
        else (found.load, name)
    )
    return estimate.value(name), estimate.standard_error(name)


def value_rows(case: Case, found: seaid.Identification) -> Iterator[Row]:
    """Yield estimates, or ratios of two estimates, with the published values."""
    for known in case.value:
        value, error = value_of(found, known["found"])
        below, below_error = value_of(found, known.get("over", "1"))
        parts = np.array([error / value, below_error / below])
        value, error = value / below, abs(value / below) * float(np.linalg.norm(parts))
        published = float(known["published"])
        off, errors = 100 * (value / published - 1), known.get("asked_errors")
        yield Row(
            case.name,
            known["what"],
            f"{number(value)} +- {error:.1g}",
            number(published),
            f"{off:.2g} %",
            number(known["reached"]) if "reached" in known else "",
            f"{known['asked_percent']:g} %" if errors is None else f"{errors:g} std. errors",
            abs(off) <= known["asked_percent"]
            if errors is None
            else abs(value - published) <= errors * error,
        )


def weak_rows(case: Case, found: seaid.Identification) -> Iterator[Row]:
    """Yield the springs that the log does not determine: they must be flagged."""
    if case.weak:
        named = {one.joint for one in found.warnings}
        flagged = {joint: joint in named for joint in case.weak}
        values = [
            f"{joint} {number(found.drives[joint].value('stiffness'))}" for joint in case.weak
        ]
        text = f"{sum(flagged.values())} of {len(flagged)} flagged ({', '.join(values)})"
        yield Row(case.name, "springs hardly loaded", text, asked="all", met=all(flagged.values()))


def gear_rows(case: Case, robot: seaid.Robot, logs: list[seaid.Log], data: Path) -> Iterator[Row]:
    """Yield gear ratios from motor angle and angle behind the gear."""
    if not case.gears:
        return
    behind = case.read_logs(robot, data, case.gears)
    published_ratios = [robot.drives[joint].ratio for joint in robot.joint_names]
    both = []
    for log, other in zip(logs, behind, strict=True):
        turned = (other.motor_position / published_ratios).T
        angles = [np.interp(log.time, other.time, angle) for angle in turned]
        both.append(replace(log, joint_position=np.column_stack(angles)))
    # Between the encoders of motor and gear output there is no spring.
    stiff = {x: seaid.StiffDrive(gear_ratio=drive.ratio) for x, drive in robot.drives.items()}
    found = seaid.check(robot.with_drives(stiff), both).joints
    for joint, published in zip(robot.joint_names, published_ratios, strict=True):
        ratio, error = found[joint].gear_ratio, found[joint].gear_ratio_error
        off = 100 * (ratio / published - 1)
        asked = joint in case.gears_of
        yield Row(
            case.name,
            f"N of {joint}",
            f"{number(ratio)} +- {error:.1g}",
            f"{published:.7g}",
            f"{off:.2g} %",
            asked="0.2 %" if asked else "",
            met=abs(off) <= 0.2 if asked else None,
        )


def torque_rows(
    case: Case,
    robot: seaid.Robot,
    logs: list[seaid.Log],
    found: seaid.Identification,
    output: Path,
) -> Iterator[Row]:
    """Yield relative errors of the torque, and save the figure."""
    name = case.name.lower().replace(" ", "_").replace(",", "")
    in_sample = seaid.validate(found, logs[0])
    if not np.all(np.isnan(in_sample.actuator.measured)):
        save_actuator_figure(in_sample, output / f"{name}_actuator.png", _SEEN)
    if np.any(np.isfinite(in_sample.load.relative_error)):
        save_load_figure(in_sample, output / f"{name}_load.png", _SEEN)
    results = {"in_sample": in_sample}
    if "unseen_half" in case.torque:
        middle = float(np.mean(logs[0].time[[0, -1]]))
        half = seaid.identify(robot, logs[0].between(-np.inf, middle))
        results["unseen_half"] = seaid.validate(half, logs[0].between(middle, np.inf))
    for kind, known in case.torque.items():
        fit = results[kind].load
        errors = 100 * fit.relative_error_with_standstill  # published errors have standstill, too
        raw = 100 * fit.raw_relative_error
        yield Row(
            case.name,
            f"torque error, {kind.replace('_', ' ')} [%]",
            f"{_percents(errors)} (raw {_percents(raw)})",
            _percents(known.get("published", [])),
            trial=_percents(known.get("reached", [])),
            asked=_percents(known["asked"]),
            met=bool(np.all(errors <= np.array(known["asked"]))),
        )


def forward_rows(
    case: Case, logs: list[seaid.Log], found: seaid.Identification, data: Path
) -> Iterator[Row]:
    """Yield the error of the identified robot against the logs, simulated under its servo."""
    if not case.forward:
        return
    errors = []
    for path, log in zip(sorted(data.glob(case.logs)), logs, strict=True):
        simulated = seaid.replay(found.robot, log, servo_of(case, path, found.robot))
        errors.append(float(np.mean(np.abs(simulated.joint_position - log.joint_position))))
    yield forward_row(case, float(np.mean(errors)))


def forward_row(case: Case, error: float) -> Row:
    """Return the row of the mean absolute error [rad] of simulated positions."""
    return Row(
        case.name,
        "forward simulation, mean absolute error [rad]",
        f"{error:.4f}",
        f"{case.forward['published']:.4f}",
        asked=f"{case.forward['asked']:.4f}",
        met=error <= case.forward["asked"],
    )


def servo_of(case: Case, path: Path, robot: seaid.Robot) -> Callable[[float, Array], Array]:
    """Return the servo voltages of a log description; goals hold between samples."""
    described = description_for(path, MODELS / "logs" / case.description)
    if described is None or described.time is None or described.time.column is None:
        raise seaid.errors.LogError(f"'{case.description}' names no time")
    servos = [described.joints[joint]["motor_voltage"].servo for joint in robot.joint_names]
    known = [servo for servo in servos if servo is not None]
    if len(known) < robot.n:
        raise seaid.errors.LogError(f"'{case.description}' has no servo for every joint")
    names = {name for servo in known for name in servo.columns()} | {described.time.column}
    table = open_table(path).load(sorted(names))
    time = table[described.time.column]

    def voltages(at: float, position: Array) -> Array:
        now = max(int(np.searchsorted(time, at, side="right")) - 1, 0)

        def number_of(one: str | float) -> float:
            return float(table[one][now]) if isinstance(one, str) else one

        return np.array(
            [
                number_of(servo.supply)
                * np.clip(
                    servo.gain_factor
                    * number_of(servo.gain)
                    * (number_of(servo.goal) - position[index]),
                    -servo.limit,
                    servo.limit,
                )
                for index, servo in enumerate(known)
            ]
        )

    return voltages


def _percents(values: Any) -> str:
    return " ".join(f"{value:.3g}" for value in values)


def markdown(rows: list[Row]) -> str:
    """Return the table as Markdown."""
    lines = [list(HEADER), ["---"] * len(HEADER), *(row.cells() for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


GOLDEN_GROUPS = ("measured", "XL330", "commands")
"""Groups of the golden file that have the measured sets."""


def named_findings() -> set[tuple[str, str]]:
    """Return {(set, code)} of the findings above a note, as the golden file has them."""
    content = gzip.decompress((ROOT / "tests" / "data" / "golden.json.gz").read_bytes())
    return {
        (name, words.split()[0])
        for name, case in json.loads(content)["cases"].items()
        if case["group"] in GOLDEN_GROUPS
        for kind, *values in case["records"].values()
        if kind == "codes"
        for words in values[0]
        if words.split()[1] != "note"
    }


def listed_findings() -> set[tuple[str, str]]:
    """Return {(set, code)} of the table of `models/logs/README.md`."""
    text = (DATA / "README.md").read_text(encoding="utf-8").partition("## Causes that are named")[2]
    rows = re.findall(r"^\| `([a-z-]+)`[^|]*\| ([^|]+) \|", text, re.MULTILINE)
    return {(name.strip(), code) for code, names in rows for name in names.split(";")}


def unlisted() -> list[str]:
    """Return the differences between the table and the golden file."""
    named, table = named_findings(), listed_findings()
    lines = [f"the table lacks {code} of {name}" for name, code in sorted(named - table)]
    return lines + [f"{name} has no {code} any more" for name, code in sorted(table - named)]


def main(data: Path, output: Path) -> None:
    """Identify all available sets; print the table and save it with the figures."""
    result_folder(output)
    rows: list[Row] = []
    for case in track(read_cases(), "measured sets", True):
        if not list(data.glob(case.logs)):
            print(f"skipped: no {case.logs} in {data}")
            continue
        try:
            rows += rows_of(case, data, output)
        except seaid.SeaidError as problem:
            rows.append(Row(case.name, "error", str(problem), met=False))
    print(markdown(rows))
    (output / "real_data.md").write_text(markdown(rows) + "\n", encoding="utf-8")
    print(
        f"{sum(row.met is True for row in rows)} of {sum(row.met is not None for row in rows)} "
        f"asked figures met. Results: {output}/"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the measured sets")
    parser.add_argument("--output", type=Path, default=Path("out/real_data"), help="result folder")
    parser.add_argument("--named", action="store_true", help="compare the table of causes only")
    arguments = parser.parse_args()
    if arguments.named:
        sys.exit("\n".join(unlisted()) or None)
    warnings.filterwarnings("ignore", category=seaid.SeaidWarning)
    main(arguments.data, arguments.output)
