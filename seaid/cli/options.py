"""Options that commands share, in groups: a command has one argument per group.

`seaid.cli.signature` makes the fields of a group options of the command line, with the help of the
docstrings below. Options of a command itself have the help of its docstring, or of this one, if
several commands have them:

Parameters
----------
logs
    Logs to identify from.
rate_hz
    Sampling rate of logs without a column of time [Hz].
feasible
    Physically consistent bodies nearest to the estimate.
verbose
    Print base parameters, processing and checks as well.
output
    File for the result.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from itertools import chain
from pathlib import Path
from typing import Any, Literal

import click

import seaid
from seaid.cli import kinds
from seaid.cli.messages import is_terminal, note, show
from seaid.cli.project import is_typed, project_here, warn_of_changes
from seaid.cli.signature import option_name
from seaid.errors import SEVERITIES, SeaidError, Severity, by_severity, unknown_name


@dataclass(frozen=True)
class RobotOptions:
    """The robot of a command.

    Parameters
    ----------
    urdf
        The robot.
    drives
        Its drives, one table per joint; default: all stiff.
    joints
        Moving joints, as a,b,c; the others are locked at zero.
    locked
        Joints that stand still elsewhere, at positions [rad or m].
    payload
        Known body on a link: mass [kg] at x,y,z [m] in the link's frame, and its inertia there
        [kg m^2]; without it a point mass.
    gravity
        Gravity in the base frame [m/s^2].
    independent_mimics
        Mimic joints of the URDF are independent joints.
    base
        fixed, floating (legged robots, which nothing holds), planar_xz, planar_xy or planar_yz
        (guided in a plane of its axes), or planar (that of a joint of the file).
    contact
        Links of a floating base that touch the ground, with a point [m] of their frame, as a flat
        foot with moments, or a ball.
    imu_link
        Link of the IMU of a floating base; default: the base.
    """

    urdf: kinds.UrdfFile
    _: KW_ONLY
    drives: kinds.TomlFile | None = None
    joints: kinds.Names | None = None
    locked: kinds.Positions | None = None
    payload: tuple[kinds.LinkPayload, ...] = ()
    gravity: kinds.Vector = (0.0, 0.0, -9.81)
    independent_mimics: bool = False
    base: Literal["fixed", "floating", "planar", "planar_xy", "planar_xz", "planar_yz"] = "fixed"
    contact: tuple[kinds.Contacts, ...] = ()
    imu_link: str | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of these options, which a command reads; a saved run is none of them."""
        values = [value for name, value in vars(self).items() if name != "run"]
        every = chain(*(value if isinstance(value, tuple) else [value] for value in values))
        return tuple(value for value in every if isinstance(value, Path))

    def keywords_of_robot(self) -> dict[str, Any]:
        """Return the keyword arguments that `load_robot` and `write_first_project` share."""
        names = ("drives", "joints", "gravity", "base", "imu_link", "independent_mimics")
        return {
            **{name: getattr(self, name) for name in names},
            "locked": self.locked or {},
            "payloads": self.payload,
            "contacts": [*chain(*self.contact)],
        }

    def robot(self, known_bodies: Sequence[str] | None = None) -> seaid.Robot:
        """Load the robot."""
        return seaid.load_robot(
            self.urdf,
            known_bodies=known_bodies or (),
            **self.keywords_of_robot(),
        )


@dataclass(frozen=True, kw_only=True)
class LogOptions(RobotOptions):
    """The robot of a command, and what of its logs is used.

    Parameters
    ----------
    known_body
        Link with the known inertial parameters of the URDF; all: each that has them.
    description
        Meaning of custom columns of the logs; default: run.toml for run.csv.
    repair
        Repair gaps, repeated times and lost samples of the logs.
    torque_joints
        Joints whose torque is used, as a,b,c; default: all with a torque.
    cutoff_hz
        Cutoff of the low pass [Hz]; default: from the data.
    find_contacts
        Find contacts without a flag from torques and motion.
    """

    known_body: tuple[kinds.Link, ...] = ()
    description: kinds.TomlFile | None = None
    repair: bool = False
    torque_joints: kinds.Names | None = None
    cutoff_hz: float | None = None
    find_contacts: bool = False

    def robot(self, known_bodies: Sequence[str] | None = None) -> seaid.Robot:
        """Load the robot, with its known bodies."""
        return super().robot(known_bodies or self.known_body)

    def logs(self, paths: Sequence[Path], robot: seaid.Robot) -> list[seaid.Log]:
        """Read logs."""
        check_joints("--torque-joints", self.torque_joints, robot)
        logs = logs_of(paths, robot, self.description, self.repair)
        if not self.find_contacts:
            return logs

        by_log = [seaid.legged.find_contacts(robot, log) for log in logs]
        for path, contacts in zip(paths, by_log, strict=True):
            note(f"{path}: contacts found from torques: {contacts._in_short()}")
        return [contacts.log for contacts in by_log]


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions(LogOptions):
    """The robot of a command, and how it is identified.

    Parameters
    ----------
    method
        two-step: springs, then bodies; simultaneous: both in one regression; auto: the latter where
        the data support it.
    estimator
        ols, wls, huber, tukey or iv.
    encoder_offset_std
        Standard deviation of joint encoder offsets [rad or m].
    known_std
        Relative standard deviations of constants, as torque=0.03,payload=0.01, or of known bodies:
        bodies=0.05.
    """

    method: Literal["auto", "two-step", "simultaneous"] = "auto"
    estimator: Literal["ols", "wls", "huber", "tukey", "iv"] = "wls"
    encoder_offset_std: float = 0.0
    known_std: kinds.Deviations | None = None

    def saved(self, run: Path | None, *names: str) -> seaid.project.Run | None:
        """Load a saved run, unless options, or parameters of these `names`, ask for another result.

        They do if they are on the line and the run is not: then it is that of the project.
        """
        options = (option.name for option in fields(IdentifyOptions) if option.name != "urdf")
        if run is None or (is_typed(*options, *names) and not is_typed("run")):
            return None
        saved_run = seaid.project.load_run(run)
        warn_of_changes(run, saved_run.provenance)
        return saved_run

    def recorded(self, logs: Sequence[Path], **more: Any) -> dict[str, Any]:
        """Return the options that are not at their defaults, and the logs, as plain data.

        `more` are the options that only the command has. The project file, if there is one, has how
        its logs are read.
        """
        from seaid._files import plain

        project = project_here()
        every = {x.name: (getattr(self, x.name), x.default) for x in fields(IdentifyOptions)}
        values = {name: value for name, (value, usual) in every.items() if value != usual}
        values |= {"logs": logs, "project": project and project.file, **more}
        return {name: plain(x) for name, x in values.items() if x is not None and x is not False}

    def keywords(self) -> dict[str, Any]:
        """Return the keyword arguments that `seaid.identify` and `cross_validate` share."""
        names = ("torque_joints", "method", "estimator", "cutoff_hz", "encoder_offset_std")
        std = self.known_std or {}
        known_std = std if isinstance(std, Mapping) else {"torque": std}
        choices = {name: getattr(self, name) for name in names}
        return {**choices, "known_std": known_std, "progress": is_terminal()}


@dataclass(frozen=True, kw_only=True)
class IdentifiedOptions(IdentifyOptions):
    """The identification of a command: a saved run, or logs to identify from.

    Parameters
    ----------
    from_logs
        Log to identify from.
    run
        Saved run in place of URDF and --from: nothing is identified again.
    """

    from_logs: tuple[kinds.LogFile, ...] = ()
    run: kinds.RunFile | None = None

    def identified_run(self, *, feasible: bool = False) -> seaid.project.Run:
        """Load the saved run, or identify.

        The run of a project file gives way to logs and options of the command line.
        """
        both = is_typed("run") and is_typed("from_logs")
        if not both and (saved := self.saved(self.run, "from_logs")) is not None:
            return saved
        if both or not self.from_logs:
            raise click.BadParameter("give one of the two", param_hint="--from, --run")
        robot = self.robot()
        logs = self.logs(self.from_logs, robot)
        identification = seaid.identify(robot, logs, feasible=feasible, **self.keywords())
        options = self.recorded(self.from_logs, feasible=feasible)
        origin = seaid.report.provenance_of(self.files, options, command_line())
        return seaid.project.Run(identification, {}, origin)


@dataclass(frozen=True, kw_only=True)
class JsonOptions:
    """How a command prints its results.

    Parameters
    ----------
    as_json
        The result as JSON on stdout; errors too.
    """

    as_json: bool = False

    def show(self, text: str, result: Any, *paths: Path | None, **facts: Any) -> None:
        """Print the result and the paths of its files; `facts` as of `messages.show`."""
        show(text, result, self.as_json, *paths, **facts)


@dataclass(frozen=True, kw_only=True)
class ResultOptions(JsonOptions):
    """How a command writes and prints its results.

    Parameters
    ----------
    force
        Overwrite existing files.
    """

    force: bool = False

    def check(self, *paths: Path | None, read: Iterable[Path | None]) -> None:
        """Raise SeaidError before a long computation if a result cannot be written.

        That is an existing file without --force, a file that is `read`, a folder, and a path that
        cannot be written.
        """
        from seaid._files import is_replaced, real_path, result_folder

        sources = {real_path(path) for path in filter(None, read)}
        for path in filter(None, paths):
            target = real_path(path)
            if str(path) == "-":
                raise SeaidError("'-' is no file: name one; --json prints the result on stdout")
            if target in sources:
                raise SeaidError(f"'{path}' is read by this command: name another file")
            if os.path.isdir(target):
                raise SeaidError(f"'{path}' is a folder: name a file in it")
            replaced = is_replaced(path)
            if replaced and not self.force:
                raise SeaidError(f"'{path}' is there already: name another file, or add --force")
            if replaced or not path.exists():  # not for a device or a pipe
                result_folder(target.parent)


@dataclass(frozen=True, kw_only=True)
class FailOptions:
    """Which findings make a command fail.

    Parameters
    ----------
    fail_on
        Exit with 3 if a warning is as severe as this: wrong, or doubtful (or wrong).
    """

    fail_on: Severity | None = None

    def check(
        self, warnings: Sequence[seaid.errors.Finding], default: Severity | None = None
    ) -> None:
        """End the command with exit code 3 if a warning is at least as severe as `fail_on`."""
        severity = self.fail_on or default
        if severity is not None:
            failing = SEVERITIES[: SEVERITIES.index(severity) + 1]
            if any(finding.severity in failing for finding in warnings):
                click.get_current_context().exit(3)


def command_line() -> tuple[str, ...]:
    """Return the words of the running command."""
    return "seaid", *sys.argv[1:]


def refuse(reason: str, *names: str) -> None:
    """Raise BadParameter with a `reason` for those of the parameters that are on the line."""
    if typed := [option_name(name) for name in names if is_typed(name)]:
        raise click.BadParameter(reason, param_hint=", ".join(typed))


def check_joints(option: str, joints: Iterable[str] | None, robot: seaid.Robot) -> None:
    """Raise SeaidError for a joint that the robot has not; one that stands still is ignored."""
    for joint in joints or ():
        if joint not in (*robot.joint_names, *robot.standing_joints):
            raise SeaidError(f"{option}: {unknown_name('joint', joint, robot.joint_names)}")


def by_joint(
    option: str, value: float | dict[str, float] | None, robot: seaid.Robot
) -> dict[str, float]:
    """Return {joint: number} of an option that is a number for all joints, or names some."""
    numbers = value if isinstance(value, dict) else dict.fromkeys(robot.joint_names, value or 0.0)
    check_joints(option, numbers, robot)
    return numbers


def logs_of(
    paths: Sequence[Path], robot: seaid.Robot, description: Path | None = None, repair: bool = False
) -> list[seaid.Log]:
    """Return the logs of a robot: as the project file has them, or as a path says.

    A description or a repair of the command line takes precedence.
    """
    check_distinct(*paths)
    project = project_here()
    known = {log.path: log for log in (project.logs if project else ())}
    return [
        (known.get(path) or seaid.project.log_at(path)).read(robot, description, repair)
        for path in paths
    ]


def check_distinct(*logs: Path) -> None:
    """Raise SeaidError for a log that is given twice, to identify from or to validate on."""
    from seaid._files import real_path

    seen: set[Path] = set()
    for log in logs:
        if real_path(log) in seen:
            raise SeaidError(
                f"'{log}' is given twice, which would count its samples twice: name each log once, "
                "and validate on another"
            )
        seen.add(real_path(log))


def judgement_of(
    fit: seaid.Identification, *results: seaid.Validation | seaid.simulation.ReplayComparison
) -> dict[str, Any]:
    """Return robot, verdict and warnings of an identification and its tests, for `show`."""
    every = [*fit.warnings, *(finding for each in results for finding in each.warnings)]
    verdict = seaid.identification.verdict_with(fit, results)
    return {"robot": fit.robot.name, "verdict": verdict, "warnings": by_severity(every)}
