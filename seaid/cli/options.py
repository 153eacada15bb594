"""Options that commands share, in groups: a command has one argument per group.

`with_groups` makes the fields of a group options of the command line.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer
from typer import Argument, Option

import seaid
from seaid.cli.messages import check_outputs, is_stdout, is_terminal, note, show, written
from seaid.cli.mistakes import check_log_files, check_robot_files
from seaid.errors import SEVERITIES, SeaidError, shortened, unknown_name

if TYPE_CHECKING:
    from seaid.errors import Finding
    from seaid.identification import Identification, Source, Validation
    from seaid.log import Log
    from seaid.project import Run as SavedRun
    from seaid.robot import Contact, Payload, Robot
    from seaid.simulation import ReplayComparison


Urdf = Annotated[Path, Argument(help="The robot.", metavar="URDF")]
Logs = Annotated[list[Path], Argument(help="Logs to identify from: docs/logs.md.", metavar="LOG")]
FROM = Option("--from", help="Log to identify from. May be repeated.", metavar="LOG")
Run = Annotated[
    Path | None,
    Option(
        "--run",
        help="Saved run in place of URDF and --from: nothing is identified again.",
        metavar="RUN",
    ),
]
Drives = Annotated[
    Path | None, Option(help="Its drives, one table per joint; default: all stiff.", metavar="TOML")
]
Joints = Annotated[
    str | None, Option(help="Moving joints, as a,b,c; the others are locked at zero.")
]
Locked = Annotated[
    str | None,
    Option(
        help="Joints that stand still elsewhere, at positions [rad or m].",
        metavar="TORSO=0.3,HEAD=0.1",
    ),
]
Description = Annotated[
    Path | None,
    Option(
        help="Meaning of custom columns of the logs; default: run.toml for run.csv.", metavar="TOML"
    ),
]
Repair = Annotated[
    bool, Option("--repair", help="Repair gaps, repeated times and lost samples of the logs.")
]
TorqueJoints = Annotated[
    str | None, Option(help="Joints whose torque is used, as a,b,c; default: all with a torque.")
]


def one_of(name: str, text: str, choice: Callable[[], Any]) -> Any:
    """Return an option whose values are those of a Literal, checked before any file is read."""

    def checked(value: str | None) -> str | None:
        names = get_args(choice())
        if value is not None and value not in names:
            raise SeaidError(f"{name}=: {unknown_name(name, value, names)}", f"{name}=")
        return value

    return Option(help=text, callback=checked)


Base = Annotated[
    str,
    one_of(
        "base",
        (
            "fixed, floating (legged robots, which nothing holds), planar_xz, planar_xy or "
            "planar_yz (guided in a plane of its axes), or planar (that of a joint of the file)."
        ),
        lambda: seaid.robot.BaseKind,
    ),
]
ContactLinks = Annotated[
    list[str] | None,
    Option(
        "--contact",
        help=(
            "Links of a floating base that touch the ground, with a point [m] of their frame, "
            "as a flat foot with moments, or a ball. May be repeated."
        ),
        metavar="LINK,LINK[:X,Y,Z][:flat][:radius=R]",
    ),
]
RateHz = Annotated[
    float | None, Option(help="Sampling rate of logs without a column of time [Hz].")
]
Output = Annotated[Path, Option("--output", "-o", help="File for the result; - for stdout.")]
AsJson = Annotated[bool, Option("--json", help="The result as JSON on stdout; errors too.")]

FailOn = Annotated[
    str | None,
    Option(
        "--fail-on",
        help="Exit with 3 if a warning is as severe as this: wrong, or doubtful (or wrong).",
        metavar="SEVERITY",
    ),
]

VERBOSE = "Print base parameters, processing and checks as well."
FEASIBLE = "Physically consistent bodies nearest to the estimate."


@dataclass(frozen=True)
class RobotOptions:
    """The robot of a command."""

    urdf: Urdf
    drives: Drives = None
    joints: Joints = None
    locked: Locked = None
    payload: Annotated[
        list[str] | None,
        Option(
            "--payload",
            help=(
                "Known body on a link: mass [kg] at x,y,z [m] in the link's frame, and its inertia "
                "there [kg m^2]; without it a point mass. May be repeated."
            ),
            metavar="LINK:MASS:X,Y,Z[:IXX,IYY,IZZ,IXY,IXZ,IYZ]",
        ),
    ] = None

    gravity: Annotated[str, Option(help="Gravity in the base frame [m/s^2].", metavar="X,Y,Z")] = (
        "0,0,-9.81"
    )
    independent_mimics: Annotated[
        bool,
        Option("--independent-mimics", help="Mimic joints of the URDF are independent joints."),
    ] = False
    base: Base = "fixed"
    contact: ContactLinks = None
    imu_link: Annotated[
        str | None, Option(help="Link of the IMU of a floating base; default: the base.")
    ] = None

    @property
    def files(self) -> tuple[Path | None, ...]:
        """The files of these options, which a command reads."""
        return self.urdf, self.drives

    def robot(self, known_bodies: Sequence[str] | None = None) -> Robot:
        """Load the robot."""
        from seaid.robot import load_robot

        check_robot_files(self.urdf, self.drives)
        return load_robot(
            self.urdf,
            self.drives,
            joints=names(self.joints),
            locked=positions("--locked", self.locked),
            payloads=[payload_of(text) for text in self.payload or ()],
            known_bodies=known_bodies or (),
            gravity=vector("--gravity", self.gravity),
            independent_mimics=self.independent_mimics,
            base=self.base,  # type: ignore[arg-type]
            contacts=[contact for text in self.contact or () for contact in contacts_of(text)],
            imu_link=self.imu_link,
        )


@dataclass(frozen=True)
class LogOptions(RobotOptions):
    """The robot of a command, and what of its logs is used."""

    known_body: Annotated[
        list[str] | None,
        Option(
            "--known-body",
            help="Link with the known inertial parameters of the URDF; all: each that has them. "
            "May be repeated.",
            metavar="LINK",
        ),
    ] = None
    description: Description = None
    repair: Repair = False
    torque_joints: TorqueJoints = None
    cutoff_hz: Annotated[
        float | None, Option(help="Cutoff of the low pass [Hz]; default: from the data.")
    ] = None
    find_contacts: Annotated[
        bool,
        Option("--find-contacts", help="Find contacts without a flag from torques and motion."),
    ] = False

    @property
    def files(self) -> tuple[Path | None, ...]:
        """The files of these options, which a command reads."""
        return *super().files, self.description

    def logs(self, paths: Sequence[Path], robot: Robot) -> list[Log]:
        """Read logs."""
        check_joints("--torque-joints", names(self.torque_joints), robot)
        logs = logs_of(paths, robot, self.description, self.repair)
        if not self.find_contacts:
            return logs
        from seaid.identification import find_contacts

        by_log = [find_contacts(robot, log) for log in logs]
        for path, contacts in zip(paths, by_log, strict=True):
            note(f"{path}: contacts found from torques: {contacts._in_short()}")
        return [contacts.log for contacts in by_log]


@dataclass(frozen=True)
class IdentifyOptions(LogOptions):
    """The robot of a command, and how it is identified."""

    method: Annotated[
        str,
        one_of(
            "method",
            "two-step: springs, then bodies; simultaneous: both in one regression; auto: the "
            "latter where the data support it.",
            lambda: seaid.identification.Method,
        ),
    ] = "auto"
    estimator: Annotated[
        str,
        one_of(
            "estimator", "ols, wls, huber, tukey or iv.", lambda: seaid.estimation.EstimatorName
        ),
    ] = "wls"
    encoder_offset_std: Annotated[
        float, Option(help="Standard deviation of joint encoder offsets [rad or m].")
    ] = 0.0
    known_std: Annotated[
        str | None,
        Option(
            help="Relative standard deviations of constants, as torque=0.03,payload=0.01, or of "
            "known bodies: bodies=0.05."
        ),
    ] = None

    def saved(self, run: Path | None, *names: str) -> SavedRun | None:
        """Load a saved run, unless options, or parameters of these `names`, ask for another result.

        They do if they are on the line and the run is not: then it is that of the project.
        """
        from seaid.cli.defaults import is_typed, warn_of_changes
        from seaid.project import load_run

        options = (option.name for option in fields(IdentifyOptions) if option.name != "urdf")
        if run is None or (is_typed(*options, *names) and not is_typed("run")):
            return None
        saved_run = load_run(run)
        warn_of_changes(run, saved_run.provenance)
        return saved_run

    def identify(
        self, robot: Robot, logs: Sequence[Source], *, feasible: bool = False
    ) -> Identification:
        """Identify a robot from logs."""
        from seaid.identification import identify

        return identify(robot, logs, feasible=feasible, progress=is_terminal(), **self.keywords())

    def recorded(self, logs: Sequence[Path], **more: Any) -> dict[str, Any]:
        """Return all options that are given or have a default, as plain data for a saved run.

        `more` are the options that only the command has. The project file, if there is one, has how
        its logs are read.
        """
        from seaid.cli.defaults import project_here

        values = {option.name: getattr(self, option.name) for option in fields(IdentifyOptions)}
        project = project_here()
        values |= {"logs": logs, "project": project.file if project else None, **more}
        return {
            name: [*map(str, value)]
            if isinstance(value, Sequence) and not isinstance(value, str)
            else str(value)
            if isinstance(value, Path)
            else value
            for name, value in values.items()
            if value is not None and value is not False
        }

    def keywords(self) -> dict[str, Any]:
        """Return the keyword arguments of `seaid.identify`."""
        known_std = values("--known-std", self.known_std, "torque=0.03,payload=0.01")
        return {
            "torque_joints": names(self.torque_joints),
            "method": self.method,
            "estimator": self.estimator,
            "cutoff_hz": self.cutoff_hz,
            "encoder_offset_std": self.encoder_offset_std,
            "known_std": known_std if isinstance(known_std, dict) else {"torque": known_std or 0.0},
        }


@dataclass(frozen=True)
class IdentifiedOptions(IdentifyOptions):
    """The identification of a command: a saved run, or logs to identify from."""

    from_logs: Annotated[list[Path] | None, FROM] = None
    run: Run = None

    @property
    def files(self) -> tuple[Path | None, ...]:
        """The files of these options, which a command reads."""
        return *super().files, *(self.from_logs or ())

    def result(self, *, feasible: bool = False) -> SavedRun:
        """Load the saved run, or identify.

        The run of a project file gives way to logs and options of the command line.
        """
        from seaid.cli.defaults import is_typed
        from seaid.project import Run, provenance_of

        if self.run is not None and is_typed("run") and is_typed("from_logs"):
            raise typer.BadParameter("give one of the two", param_hint="--from, --run")
        if (saved := self.saved(self.run, "from_logs")) is not None:
            return saved
        if not self.from_logs:
            raise typer.BadParameter("give one of the two", param_hint="--from, --run")
        robot = self.robot(self.known_body)
        identification = self.identify(robot, self.logs(self.from_logs, robot), feasible=feasible)
        options = self.recorded(self.from_logs, feasible=feasible)
        origin = provenance_of(filter(None, self.files), options, command_line())
        return Run(identification, {}, origin)


@dataclass(frozen=True)
class ResultOptions:
    """How a command writes and prints its results."""

    force: Annotated[bool, Option("--force", help="Overwrite existing files.")] = False
    as_json: AsJson = False

    def check(self, *paths: Path | None, read: Iterable[Path | None]) -> None:
        """Raise SeaidError before a long computation if a result cannot be written."""
        if self.as_json and any(map(is_stdout, paths)):
            raise typer.BadParameter("stdout has the JSON: name a file", param_hint="--output")
        check_outputs(*paths, force=self.force, read=read)

    def show(self, text: str, result: Any, *paths: Path | None, **facts: Any) -> None:
        """Print the result and the paths of its files; `facts` as of `show`."""
        show(text, result, self.as_json, *paths, **facts)

    def show_identification(
        self,
        identification: Identification,
        nominal: Robot,
        output: Path,
        *,
        read: Iterable[Path | None],
        options: dict[str, Any],
        verbose: bool,
        fail_on: str | None,
    ) -> None:
        """Write an identification from the files `read`, whole or its parameters, and print it."""
        from seaid.report import short_text

        if output.suffix == ".npz":
            from seaid.project import provenance_of, save_run

            origin = provenance_of(filter(None, read), options, command_line())
            save_run(identification, output, provenance=origin)
        else:
            with written(output, ".json") as file:
                identification.save(file)
        text = short_text(identification, nominal, verbose)
        self.show(text, identification.to_dict(), output, **facts_of(identification))
        fail_on_warnings(identification.warnings, fail_on)


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that has the fields of its dataclass arguments as options of its own."""
    groups: dict[str, Any] = {}
    parameters: list[Parameter] = []
    annotations = get_type_hints(command, include_extras=True)
    for name, parameter in signature(command).parameters.items():
        if is_dataclass(annotations[name]):
            groups[name] = signature(annotations[name], eval_str=True).parameters
            parameters += groups[name].values()
        else:
            parameters.append(parameter.replace(annotation=annotations[name]))

    required = {p.name: metavar for p in parameters if (metavar := _required(p))}
    positional = [p.name for p in parameters if _argument(p) is not None]

    def run(context: typer.Context, **values: Any) -> None:
        from seaid.cli.defaults import with_project

        arguments = with_project(context, values, positional)
        if arguments is None:
            return
        _check_required(arguments, required)
        for name, group in groups.items():
            chosen = {field: arguments.pop(field) for field in group}
            arguments[name] = annotations[name](**chosen)
        command(**arguments)

    keyword = Parameter.KEYWORD_ONLY
    optional = [p.replace(default=None) if p.name in required else p for p in parameters]
    first = Parameter("context", Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context)
    # Typer reads the options of a command from its signature.
    run.__signature__ = Signature([first, *(p.replace(kind=keyword) for p in optional)])  # type: ignore[attr-defined]
    return run


def _check_required(values: Mapping[str, Any], required: Mapping[str, str]) -> None:
    """Raise BadParameter for a missing one of the `required` arguments {name: metavar}."""
    for name, metavar in required.items():
        if not values[name] and not (name == "urdf" and values.get("run")):
            hint = ", or have a seaid.toml here (seaid init)" * (metavar in ("URDF", "LOG"))
            raise typer.BadParameter(f"it is missing: name it{hint}", param_hint=metavar)


def _argument(parameter: Parameter) -> Any:
    """Return the `Argument` of a positional parameter, None for an option."""
    parts = getattr(parameter.annotation, "__metadata__", ())
    return next((part for part in parts if isinstance(part, typer.models.ArgumentInfo)), None)


def _required(parameter: Parameter) -> str | None:
    """Return the name of an argument that the line or a project file must have, else None."""
    argument = _argument(parameter)
    if argument is None or parameter.default is not Parameter.empty:
        return None
    return str(argument.metavar).removesuffix("...")


def command_line() -> tuple[str, ...]:
    """Return the words of the running command."""
    return "seaid", *sys.argv[1:]


def check_fail_on(fail_on: str | None) -> None:
    """Raise BadParameter for an unknown severity of --fail-on."""
    if fail_on is not None and fail_on not in SEVERITIES:
        allowed = ", ".join(SEVERITIES)
        raise typer.BadParameter(f"'{fail_on}' is none of {allowed}", param_hint="--fail-on")


def fail_on_warnings(warnings: Sequence[Finding], fail_on: str | None) -> None:
    """End the command with exit code 3 if a warning is at least as severe as `fail_on`."""
    if fail_on is not None:
        failing = SEVERITIES[: [*SEVERITIES].index(fail_on) + 1]  # type: ignore[arg-type]
        if any(finding.severity in failing for finding in warnings):
            raise typer.Exit(3)


def names(text: str | None) -> list[str] | None:
    """Return the names in a list with commas; None for None."""
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]


def values(
    option: str, text: str | None, example: str = "knee=2,hip=1"
) -> float | dict[str, float] | None:
    """Return one number, or {joint: number} of 'knee=2,hip=1'."""
    if text is None:
        return None
    try:
        if "=" not in text:
            return float(text)
        pairs = [part.split("=", 1) for part in text.split(",")]
        return {joint.strip(): float(value) for joint, value in pairs}
    except ValueError:
        raise typer.BadParameter(
            f"'{text}' is neither a number nor a list as {example}", param_hint=option
        ) from None


def positions(option: str, text: str | None) -> dict[str, float]:
    """Return {joint: position} of 'torso=0.3,head=0.1'."""
    parsed = values(option, text, "torso=0.3,head=0.1")
    if parsed is not None and not isinstance(parsed, dict):
        message = f"'{text}' names no joint: write it as torso=0.3,head=0.1"
        raise typer.BadParameter(message, param_hint=option)
    return parsed or {}


def check_joints(option: str, joints: Iterable[str] | None, robot: Robot) -> None:
    """Raise SeaidError for a joint that the robot has not; one that stands still is ignored."""
    for joint in joints or ():
        if joint not in (*robot.joint_names, *robot.standing_joints):
            raise SeaidError(f"{option}: {unknown_name('joint', joint, robot.joint_names)}")


def band_of(text: str | None) -> tuple[float, float] | None:
    """Return the lowest and highest frequency [Hz] of '0.5,20'; None for None."""
    if text is None:
        return None
    low, high = numbers("--band", text, "a lowest and a highest frequency, as 0.5,20", 2)
    return low, high


def numbers(option: str, text: str, form: str, count: int) -> list[float]:
    """Return the numbers of a text with commas between them, as an option has them."""
    try:
        parsed = [float(part) for part in text.split(",")]
    except ValueError:
        parsed = []
    if len(parsed) != count:
        message = f"'{shortened(text)}' is not {form}"
        raise typer.BadParameter(message, param_hint=option)
    return parsed


def vector(option: str, text: str) -> list[float]:
    """Return the three numbers of 'x,y,z'."""
    return numbers(option, text, "x,y,z, as 0,0,-9.81", 3)


def payload_of(text: str) -> Payload:
    """Return the payload of a text: link:mass, and then :x,y,z and :ixx,iyy,izz,ixy,ixz,iyz."""
    from seaid.robot import Payload

    link, *parts = text.split(":")
    try:
        numbers = [list(map(float, part.split(","))) for part in parts]
        (mass,), (x, y, z), (xx, yy, zz, xy, xz, yz) = numbers + _POINT_MASS[len(numbers) :]
    except (ValueError, IndexError):
        raise typer.BadParameter(
            f"'{text}' is not link:mass:x,y,z, as foot:2.0:0.15,0,0", param_hint="--payload"
        ) from None
    return Payload(link, mass, (x, y, z), ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))


_POINT_MASS: list[list[float]] = [[], [0.0] * 3, [0.0] * 6]
"""Defaults of what follows the link in the text of a payload; the mass has none."""


def contacts_of(text: str) -> list[Contact]:
    """Return the contacts of a text: links with commas, and then :x,y,z, :flat and :radius=r."""
    from seaid.robot import Contact

    links, *parts = text.split(":")
    properties: dict[str, Any] = {}
    try:
        for part in parts:
            if part == "flat":
                properties["is_flat"] = True
            elif part.startswith("radius="):
                properties["radius_m"] = float(part.removeprefix("radius="))
            else:
                x, y, z = map(float, part.split(","))
                properties["position_m"] = (x, y, z)
    except ValueError:
        raise typer.BadParameter(
            f"'{text}' is not link:x,y,z:flat or link:radius=r, as FL_foot,FR_foot:radius=0.02 of "
            "both; contacts of another shape have a --contact of their own",
            param_hint="--contact",
        ) from None
    return [Contact(link, **properties) for link in names(links) or ()]


def logs_of(
    paths: Sequence[Path], robot: Robot, description: Path | None = None, repair: bool = False
) -> list[Log]:
    """Return the logs of a robot: as the project file has them, or as a path says.

    A description or a repair of the command line takes precedence.
    """
    from seaid.cli.defaults import project_here
    from seaid.project import log_at

    check_log_files(paths, description)
    project = project_here()
    known = {log.path: log for log in (project.logs if project else ())}
    return [(known.get(path) or log_at(path)).read(robot, description, repair) for path in paths]


def check_validation_logs(unseen: Sequence[Path], from_logs: Sequence[Path] | None) -> None:
    """Raise SeaidError for a validation log that is also used for the identification."""
    from seaid._files import real_path

    known = {real_path(path) for path in from_logs or ()}
    for log in unseen:
        if real_path(log) in known:
            raise SeaidError(f"'{log}' is used for the identification: validate on another log")


def facts_of(fit: Identification, *results: Validation | ReplayComparison) -> dict[str, Any]:
    """Return robot, verdict and warnings of an identification and its tests, for `show`."""
    from seaid.errors import by_severity
    from seaid.identification import verdict_with

    every = [*fit.warnings, *(finding for each in results for finding in each.warnings)]
    verdict = verdict_with(fit, results)
    return {"robot": fit.robot.name, "verdict": verdict, "warnings": by_severity(every)}


def checked_suffix(path: Path | None, *allowed: str) -> None:
    """Raise BadParameter unless the suffix of a result is allowed, or it goes to stdout."""
    if path is not None and path.suffix.lower() not in allowed and not is_stdout(path):
        raise typer.BadParameter(
            f"'{path}' must end in {' or '.join(allowed)}", param_hint="--output"
        )
