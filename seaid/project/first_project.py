"""A first project file for a robot and its logs, with each doubt as a comment."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import chain, compress, pairwise
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w

from seaid._arrays import Array, FrozenMapping, safely
from seaid._files import PROJECT_FILE, from_template, read_toml, write_whole
from seaid._progress import Display
from seaid.checks import JointCheck
from seaid.checks.commands import is_unsigned, no_measurements
from seaid.checks.tolerances import BODY, LARGEST_RATIO, MOST, POOR, SLIGHT
from seaid.drives import COMMANDS, Controller, SeriesElasticDrive, drive_table
from seaid.drives.terms import MotorInput
from seaid.drives.toml import drives_from_mapping
from seaid.errors import Hertz, LogError, SeaidError, abridged, checked, listed
from seaid.identification import check
from seaid.legged import load_robot, with_leg_order
from seaid.log import Description, Log, LogDescription, describe_log, low_pass, read_log
from seaid.log.base_log import moving_base
from seaid.log.describe import logs_of_files
from seaid.log.describe.inference import Doubt
from seaid.log.description import as_toml
from seaid.log.readers.opening import files_of, open_tables
from seaid.log.reading import read_or_describe
from seaid.log.repair.channels import held_over
from seaid.project.project import refusal
from seaid.robot import Robot

_OWN_PART = 0.7
"""Part of a single log that is used to identify; the rest validates."""

_SHORTEST_S = (40.0, 10.0)
"""Duration from which a single log is divided: its first part then has about half a minute. With
position commands and known bodies few parameters are unknown, and the replay needs another part."""


@dataclass(frozen=True, repr=False)
class FirstProject(Display):
    """What `write_first_project` wrote.

    Attributes
    ----------
    files : tuple of Path
        The project file, and descriptions and drives that did not exist.
    doubts : tuple of str
        What was inferred and has to be checked; in the files as comments too.
    """

    files: tuple[Path, ...]
    doubts: tuple[str, ...]


@checked(SeaidError)
def write_first_project(
    urdf: str | Path,
    logs: str | Path | Sequence[str | Path],
    *,
    drives: str | Path | None = None,
    folder: str | Path = ".",
    controllers: Mapping[str, Controller] = FrozenMapping({}),
    rate_hz: Hertz | None = None,
    columns: Sequence[str] = (),
    **robot_options: Any,
) -> FirstProject:
    """Write a project file for a robot and its logs, and the files that it needs.

    Logs with custom columns get a description (`describe_log`). Without `drives` the drives are
    those of the file next to the URDF, or are inferred: from both encoders the gear ratio, and
    whether a spring lies between them. Joints with position commands and no torque get a
    controller; then the bodies of the URDF count as known. Files with different columns over the
    same time are one log. One log is divided into a part to identify from and one to validate on;
    of several the last validates. Existing files are not changed.

    Parameters
    ----------
    urdf : str or Path
    logs : str, Path or a sequence of them
    drives : str or Path, optional
    folder : str or Path
        The folder of the project.
    controllers : mapping {joint: Controller}, optional
        The position controllers of joints with position commands and no torque. Without them their
        gains have to be written into the drives file.
    rate_hz : float, optional
        Sampling rate of logs without a column of time; then all files are those of one log, unless
        they have columns of the same names.
    columns : sequence of str, optional
        Names for the columns of each log, as in `describe_log`; then each file is a log, or all
        are one log if the time is named for each of them, as ["t", "q", "t", "tau"].
    **robot_options
        Those of `load_robot`: joints, locked, payloads, gravity, independent_mimics, base, contacts
        and imu_link.

    Returns
    -------
    FirstProject

    Raises
    ------
    SeaidError
        If the project file exists, and for files that cannot be read.

    Examples
    --------
    >>> made = seaid.write_first_project("leg.urdf", ["run.csv", "other.csv"], folder="leg")
    >>> made.doubts
    """
    folder = Path(folder)
    file = folder / PROJECT_FILE
    _check_request(file, logs, drives, controllers)
    paths, _ = files_of(logs)
    known, of_neighbour = _known_drives(urdf, drives, bool(controllers))
    robot, joints, unnamed = _load_named_joints(urdf, known, robot_options, paths)
    describe = partial(describe_log, rate_hz=rate_hz, columns=columns)
    reading, read = _Reading(robot, folder, describe, columns, known is not None), list[_ReadLog]()
    files_of_logs, of_files = _files_of_logs(paths, robot, rate_hz, columns)
    for files in files_of_logs:
        read.append(reading.log(files, read))
    robot = reading.with_springs(entry.guess for entry in read)
    texts, of_columns, guessed = _descriptions(read)
    logs_read = [entry.log for entry in read]
    without, untrue = _joints_without_torque(robot, logs_read)
    tables, of_drives = dict[str, _Table](), list[str]()
    if known is None:
        gains = {**read[0].guess.gains, **controllers}
        tables, of_drives = _drives_of_logs(robot, logs_read, without, gains, guessed)
        if tables:
            known = folder / f"{Path(urdf).stem}_drives.toml"
            texts[known] = _drives_text(tables, of_drives, known)
    # Drives that are inferred have their own doubts about the ratios.
    of_columns = [x for x in of_columns if not (tables and x.code == "gear_ratio")]
    doubts = [*of_neighbour, *unnamed, *of_files, *of_columns]
    doubts += [*untrue, *of_drives, *_without_flags(robot, logs_read)]
    text = from_template(
        "seaid.project",
        "first_project.toml.j2",
        {
            **{"toml": as_toml, "comment": _comment, "relative": partial(_relative, folder=folder)},
            **{"unflagged": _unflagged, "moving_base": moving_base, "known": _known_fields},
        },
        **_known_bodies(robot, logs_read, tables),
        **{"doubts": doubts, "logs": _parts(read, _is_commanded(tables)), "robot": robot},
        **{"urdf": urdf, "drives": known, "joints": joints, "options": robot_options},
    )
    for path, content in {**texts, file: text}.items():
        write_whole(path, content)
    return FirstProject((file, *texts), tuple(doubts))


def _check_request(file: Path, logs: object, drives: object, controllers: object) -> None:
    """Raise SeaidError for a project that exists, or arguments that do not go together."""
    if file.exists():
        raise refusal("project_exists", file=file)
    if not logs:
        raise SeaidError("a project needs a log: give the URDF and at least one log")
    if drives is not None and controllers:
        raise refusal("given_controllers", drives=drives)


def _known_drives(
    urdf: str | Path, drives: str | Path | None, has_controllers: bool
) -> tuple[str | Path | None, list[str]]:
    """Return the file of the drives, and a doubt if it was not given.

    That is the one next to the URDF, if there is one, and no gains were given.
    """
    neighbour = Path(urdf).with_suffix(".toml")
    if drives is not None or not neighbour.is_file():
        return drives, []
    code = "neighbour_not_used" if has_controllers else "neighbour"
    return None if has_controllers else neighbour, [_doubt(code, file=neighbour.name)]


def _load_named_joints(
    urdf: str | Path, drives: str | Path | None, options: dict[str, Any], paths: Sequence[Path]
) -> tuple[Robot, Sequence[str] | None, list[str]]:
    """Return the robot with its joints, else with those whose names are in columns, if some.

    With it come these joints, and a doubt about those that no column names.
    """
    robot = load_robot(urdf, drives, **options)
    if options.get("joints") is not None:
        return robot, options["joints"], []
    columns = {name for path in paths for name in open_tables([path]).names}
    named = [x for x in robot.joint_names if any(x in column for column in columns)]
    if not 0 < len(named) < robot.n:
        return robot, None, []
    unnamed = [joint for joint in robot.joint_names if joint not in named]
    robot = load_robot(urdf, drives, **{**options, "joints": named})
    return robot, named, _about(unnamed, "unnamed")


def _files_of_logs(
    paths: Sequence[Path], robot: Robot, rate_hz: float | None, columns: Sequence[str]
) -> tuple[Sequence[tuple[Path, ...]], Sequence[str]]:
    """Return the files of each log, and what is doubtful about that.

    Files whose columns the user names are parts of one log if a name comes again, since each has
    its own time; files without a time are parts of one log unless they share names.
    """
    if columns:
        is_one = len({*columns}) < len(columns)
    elif rate_hz is not None:
        names = [x for path in paths for x in {*open_tables([path]).names} if not x.isdecimal()]
        is_one = len({*names}) == len(names)
    else:
        return logs_of_files(paths, robot)
    return [tuple(paths)] if is_one else [(path,) for path in paths], ()


_NO_GUESS = Description(LogDescription(), (), ())
"""That of a log that needs no description, or has one."""


@dataclass(frozen=True)
class _ReadLog:
    """The log of some `files`, and by what it was read, if its columns needed a description.

    That is the inferred `guess`, or the `file` for it in the project if the user has one there.
    """

    files: tuple[Path, ...]
    log: Log
    guess: Description = _NO_GUESS
    file: Path | None = None


@dataclass(frozen=True)
class _Reading:
    """The logs of a robot, read by descriptions in the `folder` of a project or by inference.

    A joint whose deflection is logged has a spring, unless the drives of the robot are known. The
    `columns` are those that the user names.
    """

    robot: Robot
    folder: Path
    describe: Callable[..., Description]
    columns: Sequence[str]
    are_drives_known: bool

    def log(self, files: tuple[Path, ...], earlier: Sequence[_ReadLog]) -> _ReadLog:
        """Read a log by the description in the project, that of an earlier log, or the guess."""
        read = partial(read_or_describe, describe=self.describe)
        guess = (self.describe if self.columns else read)(files, self.robot)
        if isinstance(guess, Log):
            return _ReadLog(files, guess)
        robot = self.with_springs([guess])
        file = self.folder / f"{files[0].stem}_columns.toml"
        if file.exists():
            if self.columns:
                raise SeaidError(f"'{file}' names the columns: remove it, or columns=", "columns=")
            return _ReadLog(files, read_log(files, robot, description=file), guess, file)
        for entry in earlier if len(files) == 1 else ():
            if entry.file and _columns(entry.guess) == _columns(guess):
                source = entry.file if entry.file.exists() else entry.guess.description
                with suppress(LogError):
                    log = read_log(files, robot, description=source)
                    return replace(entry, files=files, log=log)
        return _ReadLog(files, *_read_guessed(files, robot, guess), file)

    def with_springs(self, guesses: Iterable[Description]) -> Robot:
        """Return the robot with springs in joints whose deflection is logged, and no gear."""
        turning = SeriesElasticDrive(gear_ratio=1.0)
        sliding = replace(turning, motor_pulley_radius_m=1.0)
        slides = dict(zip(self.robot.joint_names, self.robot.is_prismatic, strict=True))
        logged = chain(*(guess.description.joints.items() for guess in guesses))
        joints = () if self.are_drives_known else (x for x, y in logged if "deflection" in y)
        return self.robot.with_drives({x: sliding if slides[x] else turning for x in joints})


def _columns(guess: Description) -> set[str]:
    """Return all columns of a log."""
    return guess.description.columns() | {*guess.unused}


def _read_guessed(
    files: Sequence[Path], robot: Robot, guess: Description
) -> tuple[Log, Description]:
    """Return a log by its inferred description, and that with the order of its legs.

    Raises LogError with what is unsure about it.
    """
    try:
        log = read_log(files, robot, description=guess.description)
        codes = {x.code for x in guess.unsure}
        if robot.base_is_held and any(doubts <= codes for doubts in _TORQUE_UNREAD):
            raise LogError(f"'{files[0]}': a joint has no torque, and unused columns may be its")
        # Joints whose positions have seaid's names are in no doubt about their order.
        names = chain(*guess.description.joints.values())
        is_doubtful = any(name.endswith("_position") for name in names)
        ordered = with_leg_order(guess, robot, log) if is_doubtful else guess
        if ordered is not guess:
            log = read_log(files, robot, description=ordered.description)
        return log, ordered
    except LogError as problem:
        raise LogError("; ".join(_of_guess(files[0], robot, guess, problem)), "locked=") from None


def _of_guess(file: Path, robot: Robot, guess: Description, problem: LogError) -> Iterator[str]:
    """Yield what is wrong with a guess. Advice of reading has the names of seaid's columns."""
    yield problem.reason
    yield from (x for x in guess.unsure if x.code in _OF_COLUMNS)
    logged = guess.description.joints
    if any(len(logged.get(joint, ())) < _FEWEST for joint in robot.joint_names):
        yield "joints that stand still, or that no column has, are locked with locked="
        place, unused = file.with_suffix(".toml"), listed(guess.unused) or "none"
        yield f"columns of the others are named in a description: seaid describe {file} -o {place}"
        yield f"columns that are not used: {unused}"


_OF_COLUMNS = {"no_effort", "unknown_command", "no_such_joint", "unused"}
"""The codes of doubts that matter where a joint lacks columns."""

_TORQUE_UNREAD = ({"unknown_command"}, {"no_effort", "unused"})
"""Codes of doubts that, together, leave open whether a column has the torque of a joint."""

_FEWEST = 2
"""Columns that each joint needs: a position, and a torque or what stands for it."""


def _descriptions(read: Sequence[_ReadLog]) -> tuple[dict[Path, str], list[Doubt], set[str]]:
    """Return the new descriptions of logs {file: text}, and what is doubtful about them.

    Last come the joints with an encoder whose counts are a guess.
    """
    new = {entry.file: entry for entry in reversed(read) if entry.file and not entry.file.exists()}
    joints = chain(*(entry.guess.description.joints.items() for entry in new.values()))
    guessed = {x for x, sources in joints if "counts" in map(attrgetter("unit"), sources.values())}
    doubts = [x.about([e.files[0].name]) for e in new.values() for x in e.guess.unsure]
    return {file: entry.guess.to_toml() for file, entry in new.items()}, doubts, guessed


def _joints_without_torque(robot: Robot, logs: Sequence[Log]) -> tuple[set[str], list[str]]:
    """Return the joints whose torques are no measurements, and each finding as a doubt."""
    findings = [finding for log in logs for finding in no_measurements(robot, log)]
    # Next to a joint whose torques are magnitudes, those that are never negative are so too.
    torques = zip(*(log.motor_torque.T for log in logs), strict=True)
    unsigned = (findings != [] and all(map(is_unsigned, of_joint)) for of_joint in torques)
    joints = {*compress(robot.joint_names, unsigned), *(x.joint for x in findings)}
    return joints, [*dict.fromkeys(f"{x.joint}: {x.message}" for x in findings)]


def _about(names: Collection[str], code: str, **values: object) -> list[str]:
    """Return a doubt about joints or links, none without them."""
    return [_doubt(code, **values).about(names)] if names else []


def _doubt(code: str, **values: object) -> Doubt:
    """Return a doubt of `doubts.toml` with values of the log."""
    return Doubt.of(code, _DOUBTS, **values)


_FILE_OF_DOUBTS = Path(__file__).with_name("doubts.toml")
_DOUBTS: Mapping[str, str] = read_toml(_FILE_OF_DOUBTS, "the texts of doubts", SeaidError)
"""{code of a doubt: its text, with braces for values of the log}."""


def _comment(doubt: str) -> str:
    """Return a doubt on one line."""
    return abridged(" ".join(doubt.split()))


def _known_bodies(
    robot: Robot, logs: Sequence[Log], tables: Mapping[str, _Table]
) -> dict[str, Any]:
    """Return the bodies that count as known, if the file has masses, and the width of each mass."""
    unscaled = _unscaled(robot, logs, tables)
    is_needed = _is_commanded(tables) or unscaled
    names = robot.body_names if np.any(robot.parameters) and is_needed else ()
    return {"known_bodies": names, "std_of_bodies": BODY if names and unscaled else None}


def _is_commanded(tables: Mapping[str, _Table]) -> bool:
    """Return whether some of the inferred drives have a controller."""
    return any("controller" in table for table in tables.values())


def _known_fields(item: Any) -> dict[str, Any]:
    """Return the fields of an object that are not zero."""
    return {name: value for name, value in vars(item).items() if np.any(value)}


def _parts(read: Sequence[_ReadLog], is_commanded: bool) -> list[tuple[_ReadLog, Any]]:
    """Return the logs, each with None, or both parts of a single long one; the last validates."""
    start, end = read[0].log.time[[0, -1]]
    if len(read) > 1 or end - start <= _SHORTEST_S[is_commanded]:
        return [(entry, None) for entry in read]
    middle = np.round(start + _OWN_PART * (end - start), 1)
    ends = map(float, (np.floor(start), middle, np.ceil(end + 1)))
    return [(read[0], part) for part in pairwise(ends)]


def _unflagged(robot: Robot, log: Log) -> tuple[str, ...]:
    """Return the contacts of a floating base of which a log has neither a flag nor a wrench."""
    return () if log.base is None else log.base.unflagged(moving_base(robot).contact_links)


def _without_flags(robot: Robot, logs: Sequence[Log]) -> list[str]:
    """Return a doubt about the contacts that each log does not flag."""
    return [*dict.fromkeys(x for log in logs for x in _about(_unflagged(robot, log), "unflagged"))]


def _relative(path: str | Path, folder: Path) -> str:
    """Return a path relative to the folder of the project; the name of a robot stays."""
    is_name = not Path(path).suffix and not Path(path).is_file()
    return str(path) if is_name else os.path.relpath(path, folder)


_GAP = "?"
"""Stands in a table for a number that the log does not show and the user has to write."""

_Table = dict[str, Any]
"""Table of a drive as in TOML, with gaps; its controller is a table, too."""

_Gains = Mapping[str, Controller]
"""{joint: its controller}."""

_INPUTS: tuple[MotorInput, ...] = ("torque", "current", "voltage")
"""Kinds of a motor's input, the most direct one first."""

_TORQUES = ("joint_torque", *(f"motor_{kind}" for kind in _INPUTS))
"""Sensors of a torque, or of what is proportional to it, the most direct one first."""

_POSITION_GAIN, _VELOCITY_GAIN = "position_gain_Nm_per_rad", "velocity_gain_Nms_per_rad"

_RATIO_KEYS = {False: "gear_ratio", True: "gear_ratio_rad_per_m"}
"""{whether a joint slides: key of the ratio of its gear in a table}."""

_MOVES = {False: 0.05, True: 0.005}
"""{whether a joint slides: least range [rad or m] that shows a gear ratio}."""

_BAND_HZ, _WIDTH, _ROUNDING = 5.0, 0.05, float(np.sqrt(np.finfo(float).eps))
"""Low pass of the signals from which a gear ratio is inferred, in which robots move and encoders
differ by springs rather than noise; width of the tanh of dry friction over the standard deviation
of the speed, narrow enough for a step wherever the joint moves; share of a range or of a ratio that
is no more than rounding."""


def _drives_of_logs(
    robot: Robot, logs: Sequence[Log], without: Set[str], gains: _Gains, guessed: Set[str]
) -> tuple[dict[str, _Table], list[str]]:
    """Return the drives of logs, those of commands with their controllers, and what is doubtful.

    The torques of the joints `without` are no measurements, and the counts of those `guessed` are
    a guess.
    """
    commanded = _commanded(robot, logs, without)
    tables, doubts = inferred_drives(robot, logs, commanded, guessed)
    tables |= {joint: _controlled(robot, joint, logs, gains.get(joint)) for joint in commanded}
    laws = {joint: tables[joint]["controller"] for joint in commanded}
    doubts += _about([joint for joint, law in laws.items() if _GAP in law.values()], "gains")
    doubts += [_doubt("delay")] * bool(commanded)
    fast = [joint for joint in commanded if "velocity_command" in _sent(logs, joint)]
    doubts += _about(fast, "velocity_commands")
    doubts += _about([joint for joint, law in laws.items() if law.get("is_held")], "held")
    return tables, doubts


def _commanded(robot: Robot, logs: Sequence[Log], untrue: Set[str]) -> tuple[str, ...]:
    """Return the joints of which all logs have a command of one kind, and none has a torque.

    The torques and currents of the joints `untrue` are no measurements.
    """
    measured = {x for x in robot.joint_names for log in logs if {*_TORQUES} & {*log.logged(x)}}
    return tuple(x for x in robot.joint_names if _sent(logs, x) and x not in measured - untrue)


def _sent(logs: Sequence[Log], joint: str) -> list[str]:
    """Return the kinds of command that all logs have of a joint."""
    return [kind for kind in COMMANDS if all(kind in log.logged(joint) for log in logs)]


def _controlled(robot: Robot, joint: str, logs: Sequence[Log], law: Controller | None) -> _Table:
    """Return the drive table of a joint with a controller, K_v = K_d if it gets velocities."""
    gains, sent = _gains(law, _sent(logs, joint))
    if all(held_over(log.time, log.logged(joint)[sent[0]]) > 1 for log in logs):
        gains["is_held"] = True
    if "velocity_command" in sent:
        gains["command_velocity_gain_Nms_per_rad"] = gains[_VELOCITY_GAIN]
    return {
        "type": "stiff",
        _RATIO_KEYS[bool(robot.is_prismatic[robot.index(joint)])]: 1.0,
        "friction": ["viscous", "coulomb", "offset"],
        "motor_input": sent[0],
        "controller": gains,
        "command_delay_s": 0.0,
        "command_delay_s_std": 0.005,
    }


def _gains(law: Controller | None, sent: list[str]) -> tuple[_Table, list[str]]:
    """Return the table of a controller, and the kinds of the commands `sent` that it takes.

    A controller without a position gain takes velocities alone. Gains that do not go with the
    commands are gaps.
    """
    if law is not None and (law.position_gain_Nm_per_rad or sent == ["velocity_command"]):
        return asdict(law), sent
    if law is not None and law.velocity_gain_Nms_per_rad and "velocity_command" in sent:
        return asdict(law), ["velocity_command"]
    gains: _Table = {_POSITION_GAIN: _GAP} if "position_command" in sent else {}
    return gains | {_VELOCITY_GAIN: _GAP if "velocity_command" in sent else 0.0}, sent


def _drives_text(tables: Mapping[str, _Table], doubts: Sequence[str], file: Path) -> str:
    """Return the text of a new file of drives with doubts and gaps."""
    if file.exists():
        raise SeaidError(f"'{file}' is there already: give it as drives")
    drives = drives_from_mapping(filled(tables))
    text = tomli_w.dumps({x: _with_gaps(drive_table(drives[x]), tables[x]) for x in drives})
    lines = [f"# unsure: {_comment(doubt)}\n" for doubt in doubts]
    return "".join([*lines, *["\n"] * bool(lines), text])


def filled(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables with one in their gaps: motor and joint, or gain and torque, in one unit."""
    return {
        key: filled(value) if isinstance(value, Mapping) else 1.0 if value == _GAP else value
        for key, value in table.items()
    }


def _with_gaps(written: _Table, inferred: _Table) -> _Table:
    """Return the table of a drive as it is written, with the gaps of the inferred one."""
    return written | {x: value for x, value in inferred.items() if filled({x: value})[x] != value}


def _input(sensors: Set[str]) -> MotorInput | Literal[""]:
    """Return by what a motor is logged, the most direct one; "" by nothing."""
    return next((kind for kind in _INPUTS if f"motor_{kind}" in sensors), "")


def _has_locked_output(log: Log, index: int, slides: bool) -> bool:
    """Return whether the position of a joint is logged and hardly changes while its motor moves.

    That is by more than any gear or screw explains. A side without an encoder is NaN, of which no
    comparison is true.
    """
    motor, joint = np.ptp(log.motor_position[:, index]), np.ptp(log.joint_position[:, index])
    return bool(joint < np.minimum(_MOVES[slides], motor / LARGEST_RATIO[slides]))


def _unscaled(robot: Robot, logs: Sequence[Log], tables: Mapping[str, _Table]) -> list[str]:
    """Return the joints whose motor has an unknown constant, without a sensor of their torque."""
    driven = [joint for joint, table in tables.items() if "motor_input" in table]
    sensed = {x for x in driven for log in logs if "joint_torque" in _moving_sensors(log, x)}
    return [joint for joint in driven if joint not in sensed]


def inferred_drives(
    robot: Robot, logs: Sequence[Log], without: Sequence[str] = (), guessed: Collection[str] = ()
) -> tuple[dict[str, _Table], list[str]]:
    """Return drive tables of joints with a motor's torque, and what is doubtful about them.

    Nothing is said of the joints `without`; those with counts that are `guessed` have no ratio.
    Numbers that no log shows are gaps, see `filled`.
    """
    drives = {x: _inferred_drive(robot, x, logs) for x in robot.joint_names if x not in without}
    tables, sizes = _with_confirmed_ratios(robot, logs, drives, guessed)
    doubts, shared = list[str](), dict[str, list[str]](no_encoder=[], no_motor=[], passive=[])
    for joint, drive in drives.items():
        if drive.doubt.code in shared:
            shared[drive.doubt.code].append(joint)
        else:
            doubts.append(f"{joint}: {sizes.get(joint, '')}{drive.doubt}")
    shared["unscaled"] = _unscaled(robot, logs, tables)
    return tables, [*doubts, *(x for code, joints in shared.items() for x in _about(joints, code))]


@dataclass(frozen=True)
class _Drive:
    """An inferred drive and its doubt; no table if the torque counts as known at the joint.

    `key` is that of the ratio, if both encoders show one: next to it stands its standard error.
    """

    table: _Table | None
    doubt: Doubt
    key: str = ""


def _inferred_drive(robot: Robot, joint: str, logs: Sequence[Log]) -> _Drive:
    """Return the drive of a joint by its sensors that move in the logs."""
    moving, j = [_moving_sensors(log, joint) for log in logs], robot.index(joint)
    sensors, slides = set[str]().union(*moving), bool(robot.is_prismatic[j])
    encoded = (x for x in zip(logs, moving, strict=True) if "motor_position" in x[1])
    log, channels = next(encoded, (None, dict[str, Array]()))
    drive = _spring_without_gear(robot, j, log, channels)
    if drive is None and log is not None and "joint_position" in channels:
        drive = _drive_of_encoders(slides, log.time, channels)
    kind = _input(sensors)
    drive = drive or _drive_without_encoder(sensors, kind, _RATIO_KEYS[slides])
    if drive.table is not None and kind not in ("", "torque"):
        return replace(drive, table=drive.table | {"motor_input": kind})
    return drive


def _spring_without_gear(
    robot: Robot, index: int, log: Log | None, channels: Mapping[str, Array]
) -> _Drive | None:
    """Return a spring whose gear ratio no encoder shows, None if there is no sign of one."""
    # The spring of a joint that slides is behind a pulley or a screw, whose radius is its ratio.
    key = "motor_pulley_radius_m" if robot.is_prismatic[index] else "gear_ratio"
    table: _Table = {"type": "series_elastic", "gear_ratio": 1.0, key: 1.0}
    if log is not None and _has_locked_output(log, index, robot.is_prismatic[index]):
        return _Drive({**table, key: _GAP}, _doubt("locked_output", key=key))
    if robot.drives[robot.joint_names[index]].is_elastic and "deflection" not in channels:
        return _Drive(table, _doubt("of_deflection", key=key))
    return None


def _drive_without_encoder(sensors: Set[str], kind: str, key: str) -> _Drive:
    """Return the stiff drive of a joint by its sensors, of which one encoder at most is logged."""
    # A torque sensor has a scale, and behind it are neither friction nor rotor.
    is_known = "joint_torque" in sensors and kind != "torque"
    if "motor_position" in sensors and not is_known:
        return _Drive({"type": "stiff", key: _GAP}, _doubt("no_joint_encoder", key=key))
    if not kind or is_known:
        return _Drive(None, _doubt("no_motor" if is_known else "passive"))
    return _Drive({"type": "stiff", key: 1.0}, _doubt("no_encoder"))


def _with_confirmed_ratios(
    robot: Robot, logs: Sequence[Log], drives: Mapping[str, _Drive], guessed: Collection[str]
) -> tuple[dict[str, _Table], dict[str, str]]:
    """Return drive tables with the ratios of `check`, and each ratio as a text {joint: text}.

    That takes a search over all logs: it knows the springs of these drives, and takes (7) where the
    motor moves. The standard errors go into those of the estimates (`gear_ratio_std`). A ratio with
    a large one, or by counts that are `guessed`, is a gap.
    """
    tables = {joint: drive.table for joint, drive in drives.items() if drive.table}
    keys, sizes = {x: drives[x].key for x in tables if drives[x].key}, dict[str, str]()
    checks: Mapping[str, JointCheck] = {}
    with suppress(SeaidError):  # logs that fit no drive: run names what is wrong
        inferred = robot.with_drives(drives_from_mapping(filled(tables)))
        checks = check(inferred, logs).joints if keys else {}
    for joint, key in keys.items():
        table = tables[joint]
        value, error = _confirmed(table[key], table.pop(f"{key}_std"), checks.get(joint), key)
        # the rotor's inertia behind the gear, N^2 I, has twice as much
        if joint in guessed or error > POOR * value:
            table[key] = _GAP
            code = "of_guessed_counts" if joint in guessed else "undetermined"
            sizes[joint] = _doubt(code, key=key, value=value, error=error)
        else:
            stated = [(f"{key}_std", float(f"{error:.2g}"))] * bool(error > _ROUNDING * value)
            table |= {key: _shortest(value, error), **dict(stated)}
            sizes[joint] = f"{key} = {table[key]:.7g} " + f"+- {error:.2g} " * len(stated)
    return tables, sizes


def _shortest(value: float, error: float) -> float:
    """Return the decimal of fewest digits within the standard error: ratios of gears are round."""
    return next((x for n in range(8) if abs((x := round(value, n)) - value) <= error), value)


def _confirmed(value: float, error: float, fit: JointCheck | None, key: str) -> tuple[float, float]:
    """Return a gear ratio or radius, and its standard error, by the ratio that `check` finds.

    A value that it does not confirm stays, and its error is at least the difference.
    """
    if fit is None or not fit.gear_ratio_error > 0:
        return value, error
    ratio = abs(fit.gear_ratio)
    # The gear ratio of a screw is 1: its radius goes with the inverse of what the check finds.
    better = value / ratio if "pulley" in key else ratio
    if abs(better / value - 1) < SLIGHT:
        return better, better * fit.gear_ratio_error / ratio
    return value, max(error, abs(better - value))


def _moving_sensors(log: Log, joint: str) -> dict[str, Array]:
    """Return the sensors {name: samples} of a joint that change."""
    return {name: values for name, values in log.logged(joint).items() if np.ptp(values) > 0}


def _drive_of_encoders(slides: bool, time: Array, sensors: Mapping[str, Array]) -> _Drive:
    """Return the drive of a joint with two encoders, and the doubt about it."""
    motor, joint = sensors["motor_position"], sensors["joint_position"]
    if np.array_equal(motor, joint):
        return _Drive(None, _doubt("same_values"))
    if np.ptp(joint) < _MOVES[slides]:
        return _Drive(None, _doubt("hardly_moves"))
    ratio, explained, error = _ratio(time, sensors)
    spread, unit = float(np.std(motor / ratio - joint)), "m" if slides else "rad"
    code = ("agree", "differ")[spread > _ROUNDING * float(np.ptp(joint))]
    apart = _doubt(code, spread=spread, unit=unit) + _doubt("backwards") * (ratio < -error)
    key, ratio = _RATIO_KEYS[slides], abs(ratio)
    explains = explained > MOST or "deflection" in sensors
    table: _Table = {"type": ("stiff", "series_elastic")[explains]}
    if explains and slides:  # behind a screw, as behind a pulley
        table["gear_ratio"] = 1.0
        key, ratio, error = "motor_pulley_radius_m", 1 / ratio, error / ratio**2
    table |= {key: float(f"{ratio:.5g}"), f"{key}_std": error}
    if explains:
        return _Drive(table, _doubt("spring", apart=apart, explained=explained), key)
    if "joint_torque" in sensors and "motor_torque" not in sensors:
        return _Drive(None, _doubt("torque_sensor", key=key, value=ratio, error=error, apart=apart))
    return _Drive(table, _doubt("stiff", apart=apart), key)


def _ratio(time: Array, sensors: Mapping[str, Array]) -> tuple[float, float, float]:
    """Return the gear ratio, the part of the encoders' difference that is a spring's, and an error.

    The error is the standard error of the ratio by one sample of the residual, as in `gear_ratio`.

    motor / N - joint is the torque on the spring over its stiffness, and that is the torque of the
    motor less its inertia and friction, (7): motor = N joint + c_1 torque + c_2 w + c_3 sign(w) +
    c_4 w' + c_5. A current or voltage does as well, since c_1 is free.
    """
    rate_hz = (len(time) - 1) / float(time[-1] - time[0])
    names = [x for x in ("motor_position", "joint_position", *_TORQUES) if x in sensors][:3]
    signals = low_pass(np.column_stack([sensors[name] for name in names]), rate_hz, _BAND_HZ)
    columns = [signals[:, 1], np.ones(len(time))]
    if len(names) > 2:
        speed = np.gradient(signals[:, 0], time)
        width = _WIDTH * max(float(np.std(speed)), np.finfo(float).tiny)
        # tanh, because the low pass has rounded the reversals of the torque as well.
        columns += [signals[:, 2], speed, np.tanh(speed / width), np.gradient(speed, time)]
    # One period of the low pass is its transient at each end.
    end = min(int(rate_hz / _BAND_HZ), len(time) // 4)
    rows, turned = np.column_stack(columns)[end : len(time) - end], signals[end : -end or None, 0]
    fit = safely(np.linalg.lstsq, rows, turned, rcond=None, what="a ratio", error=LogError)[0]
    # Of motor - N joint, what torque and motion explain is a spring's; the rest is neither, and nor
    # is what only rounding leaves.
    apart, rest = float(np.var(turned - fit[0] * rows[:, 0])), float(np.var(turned - rows @ fit))
    explained = (apart - rest) / max(apart, _ROUNDING**2 * float(np.var(turned)), 1e-300)
    return float(fit[0]), explained, rest**0.5 / max(float(np.std(rows[:, 0])), 1e-300)
