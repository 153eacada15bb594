"""The project file seaid.toml: robot, logs, options and results in one place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from pathlib import Path
from typing import Any, Literal

from seaid._arrays import FrozenMapping
from seaid._files import PROJECT_FILE, read_toml, real_path
from seaid._progress import Display, counted
from seaid.errors import SeaidError, Severity, check_name, checked, listed
from seaid.estimation.fitting import EstimatorName
from seaid.identification.problem import Method
from seaid.legged import find_contacts, load_robot
from seaid.log import Log, Repairs, read_log
from seaid.log.channels import Refusals
from seaid.log.tables import Interval, Reader, types_of
from seaid.robot import BaseKind, Contact, Payload, Robot

refusal = Refusals(Path(__file__).with_name("refusals.toml"), SeaidError)
"""Return the error of a code about a project."""

Use = Literal["identify", "validate"]
Output = Literal["parameters", "report", "urdf", "mjcf"]


@dataclass(frozen=True)
class ProjectLog:
    """A log of a project.

    Attributes
    ----------
    files : tuple of Path
        The file, or several files of one motion.
    use : {"identify", "validate"}
    description : Path or None
        The description of its custom columns; None: the file of its name (run.toml for run.csv).
    repair : bool
        Whether faults are repaired within the usual limits.
    find_contacts : bool
        Whether contacts without a flag are found (`seaid.legged.find_contacts`).
    condition : str
        The condition of the robot, such as "cold"; logs of one condition share all parameters.
    between_s : tuple (start, end) or None
        The part of the log's time [s] that is used.
    """

    files: tuple[Path, ...]
    use: Use = "identify"
    description: Path | None = None
    repair: bool = False
    find_contacts: bool = False
    condition: str = ""
    between_s: Interval | None = None

    @property
    def name(self) -> str:
        """The name of its first file, with the part that is used, as "run.csv@0:20"."""
        part = "" if self.between_s is None else "@{:.12g}:{:.12g}".format(*self.between_s)
        return self.files[0].name + part

    @property
    def path(self) -> Path:
        """Its first file and the part that is used, as the command line has it."""
        return self.files[0].with_name(self.name)

    def read(self, robot: Robot, description: Path | None = None, repair: bool = False) -> Log:
        """Read the log; a `description` that is given takes precedence."""
        limits = Repairs() if repair or self.repair else None
        described = description or self.description
        log = read_log(self.files, robot, description=described, repair=limits)
        log = log if self.between_s is None else log.between(*self.between_s)
        return find_contacts(robot, log).log if self.find_contacts else log


def log_at(path: Path) -> ProjectLog:
    """Return the log of a path, or a part of it: "run.csv@0:20" is its first 20 s."""
    file, at, part = str(path).rpartition("@")
    start, colon, end = part.partition(":")
    if not (at and colon) or path.exists():
        return ProjectLog((path,))
    try:
        between = float(start or "-inf"), float(end or "inf")
    except ValueError:
        return ProjectLog((path,))
    if not between[0] < between[1]:
        raise SeaidError(f"'{path}': the part of a log must end after its start, as run.csv@0:20")
    return ProjectLog((Path(file),), between_s=between)


@dataclass(frozen=True)
class Options:
    """How a project is identified: the options of `seaid.identify`, and whether to refine."""

    method: Method = "auto"
    estimator: EstimatorName = "wls"
    feasible: bool = True
    torque_joints: tuple[str, ...] | None = None
    cutoff_hz: float | None = None
    encoder_offset_std: float = 0.0
    known_std: Mapping[str, float] = field(default_factory=lambda: FrozenMapping({}))
    refine: bool = False
    condition_specific: tuple[str, ...] | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Project(Display):
    """A project, as `load_project` reads it.

    Attributes
    ----------
    file : Path
        The project file.
    urdf : Path or str
        The robot file, or the name of a robot.
    drives : Path or None
    joints : tuple of str or None
    locked : mapping {joint: position}
        Joints that stand still elsewhere than at zero [rad or m].
    payloads : mapping {condition: tuple of Payload}
        Those of the condition "" are in all logs.
    known_bodies : tuple of str
        Names of links, or "all".
    gravity : tuple of 3 floats
    independent_mimics : bool
        Whether mimic joints are independent joints.
    base : {"fixed", "floating", "planar", "planar_xy", "planar_xz", "planar_yz"}
    contacts : tuple of Contact
        Links of a floating base that touch the ground.
    imu_link : str or None
    logs : tuple of ProjectLog
    options : Options
    write : tuple of {"parameters", "report", "urdf", "mjcf"}
        The results of a run.
    folder : Path
        The folder of the runs.
    fail_on : {"wrong", "doubtful", "note"} or None
        Severity of warnings from which `seaid run` ends with exit code 3.
    experiment : mapping {name: text}
        Experiment metadata for the report.
    """

    file: Path
    urdf: Path | str
    drives: Path | None = None
    joints: tuple[str, ...] | None = None
    locked: Mapping[str, float] = field(default_factory=lambda: FrozenMapping({}))
    payloads: Mapping[str, tuple[Payload, ...]] = field(default_factory=dict)
    known_bodies: tuple[str, ...] = ()
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    independent_mimics: bool = False
    base: BaseKind = "fixed"
    contacts: tuple[Contact, ...] = ()
    imu_link: str | None = None
    logs: tuple[ProjectLog, ...] = ()
    options: Options = Options()
    write: tuple[Output, ...] = ("parameters", "report", "urdf")
    folder: Path = Path("runs")
    fail_on: Severity | None = None
    experiment: Mapping[str, str] = field(default_factory=dict)

    def _in_short(self) -> str:
        return f"'{self.file}': {Path(self.urdf).name}, {counted(len(self.logs), 'log')}"

    @property
    def conditions(self) -> tuple[str, ...]:
        """The conditions of the logs to identify from, in the order of the file."""
        return tuple(dict.fromkeys(log.condition for log in self.logs_for("identify")))

    def logs_for(self, use: Use, condition: str | None = None) -> tuple[ProjectLog, ...]:
        """Return the logs of a use, and of one condition if it is given."""
        logs = (log for log in self.logs if log.use == use)
        return tuple(log for log in logs if condition in (None, log.condition))

    def robot(self, condition: str = "") -> Robot:
        """Load the robot with the payloads of a condition."""
        general = self.payloads.get("", ())
        payloads = general + (self.payloads.get(condition, ()) if condition else ())
        options = {name: getattr(self, name) for name in (*_ROBOT, "contacts")}
        return load_robot(self.urdf, payloads=payloads, **options)

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that the project reads: itself, robot, drives, logs and descriptions."""
        robot = [path for path in (self.urdf, self.drives) if isinstance(path, Path)]
        logs = [path for log in self.logs for path in (*log.files, log.description) if path]
        return tuple(dict.fromkeys([self.file, *robot, *logs]))


@checked(SeaidError)
def load_project(path: str | Path = PROJECT_FILE) -> Project:
    """Read a project file.

    Parameters
    ----------
    path : str or Path
        The file, or its folder. Paths in it are relative to its folder.

    Returns
    -------
    Project

    Raises
    ------
    SeaidError
        For a file that is missing or invalid, with the table and the key.

    Examples
    --------
    >>> project = seaid.load_project()
    >>> robot = project.robot()
    >>> logs = [log.read(robot) for log in project.logs_for("identify")]
    >>> result = seaid.identify(robot, logs)
    """
    file = Path(path) / (PROJECT_FILE if Path(path).is_dir() else "")
    if not file.exists():
        raise SeaidError(f"cannot read the project '{file}': seaid init URDF LOG writes one")
    where, reader = f"'{file}'", Reader(SeaidError, file.parent, {Contact: "link"})
    content = read_toml(file, "the project", SeaidError)
    for key in ("known_bodies", "contacts"):  # one alone needs no list
        if key in content and not isinstance(content[key], list):
            content[key] = [content[key]]
    values = reader.table(_OF_PROJECT, content, where, needed=["urdf"])
    run = reader.table(_OF_RUN, values.pop("run", {}), f"{where} [run]")
    logs = tuple(_log(reader, *table) for table in _tables(reader, values, "log", where))
    payloads = _payloads(reader, _tables(reader, values, "payload", where), logs)
    values["urdf"] = _robot_file(values["urdf"], file.parent)
    values["experiment"] = {name: str(x) for name, x in values.get("experiment", {}).items()}
    return Project(
        file=file,
        options=values.pop("identify", Options()),
        **values,
        payloads=FrozenMapping(payloads),
        logs=logs,
        **{"folder": file.parent / "runs", **run},
    )


@dataclass(frozen=True)
class _PayloadTable:
    """A table [[payload]]: its inertia at the centre of mass is xx, yy, zz, xy, xz, yz."""

    link: str
    mass_kg: float
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia_kg_m2: tuple[float, float, float, float, float, float] = (0.0,) * 6
    condition: str = ""


_HINTS = types_of(Project)
_ROBOT = (
    *("drives", "joints", "locked", "gravity", "known_bodies", "independent_mimics", "base"),
    "imu_link",
)
_OF_PROJECT = {
    **{"urdf": str, "experiment": Mapping[str, Any], "identify": Options},
    **{key: _HINTS[key] for key in (*_ROBOT, "contacts")},
    **dict.fromkeys(("payload", "log", "run"), Any),
}
_OF_RUN = {key: _HINTS[key] for key in ("folder", "write", "fail_on")}
_OF_LOG = {"file": Path, **types_of(ProjectLog)}
"""{key: type} of the tables of a project file; those of [identify] are the fields of `Options`."""


def _tables(reader: Reader, values: dict[str, Any], key: str, where: str) -> list[tuple[Any, str]]:
    """Remove the tables of a list, and return each with its place."""
    tables = values.pop(key, [])
    if not isinstance(tables, list):
        raise reader.refusal(tables, f"tables [[{key}]], one each", key, where)
    return [(table, f"{where} [[{key}]] {number}") for number, table in enumerate(tables, 1)]


def _robot_file(text: str, folder: Path) -> Path | str:
    """Return the path of the robot's file, or its name if it is no path."""
    path = folder / text
    return path if path.exists() or Path(text).suffix or "/" in text else text


def _log(reader: Reader, table: Any, where: str) -> ProjectLog:
    values = reader.table(_OF_LOG, table, where)
    file, several = values.pop("file", None), values.pop("files", ())
    if (file is None) == (not several):
        raise SeaidError(f"{where}: give either 'file' or 'files' of one motion")
    return ProjectLog(several or (file,), **values)


def _payloads(
    reader: Reader, tables: Sequence[tuple[Any, str]], logs: Sequence[ProjectLog]
) -> dict[str, tuple[Payload, ...]]:
    """Return {condition: payloads}; "" for those in all logs."""
    payloads: dict[str, tuple[Payload, ...]] = {}
    conditions = {log.condition for log in logs} - {""}
    for content, where in tables:
        table = reader.instance(_PayloadTable, content, where)
        condition = table.condition
        if condition:
            check_name("condition of a log", condition, sorted(conditions), SeaidError, where)
        xx, yy, zz, xy, xz, yz = table.inertia_kg_m2
        inertia = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
        payload = Payload(table.link, table.mass_kg, table.com_m, inertia)
        payloads[condition] = (*payloads.get(condition, ()), payload)
    return payloads


def check_logs(project: Project) -> None:
    """Raise SeaidError unless a log identifies, all logs exist, and no sample is used twice."""
    if not project.logs_for("identify"):
        raise refusal("no_log", file=project.file)
    # before a long identification whose validation would fail
    missing = [path for log in project.logs for path in log.files if not path.exists()]
    if missing:
        raise SeaidError(f"'{project.file}': there is no log '{missing[0]}': correct its name")
    _check_samples(project)
    strange = {log.condition for log in project.logs_for("validate")} - {*project.conditions, ""}
    if strange:
        unknown, known = listed(sorted(strange)), listed(project.conditions)
        raise refusal("no_such_condition", file=project.file, unknown=unknown, known=known)


def _check_samples(project: Project) -> None:
    """Raise SeaidError if another log has samples of one to identify from."""
    # Several names of a file, by links, have one real path, which is looked up once per log.
    files = [{real_path(path) for path in log.files} for log in project.logs]
    for (fitted, paths), (log, others) in permutations(zip(project.logs, files, strict=True), 2):
        if fitted.use == "identify" and paths & others and _overlap(fitted, log):
            raise refusal("used_twice", file=project.file, log=log.name)


def _overlap(first: ProjectLog, second: ProjectLog) -> bool:
    """Return whether the parts of two logs of one file have samples in common."""
    whole = -float("inf"), float("inf")
    (start, end), (begin, stop) = first.between_s or whole, second.between_s or whole
    return start < stop and begin < end
