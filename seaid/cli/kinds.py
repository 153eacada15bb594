"""Kinds of values on the command line: what their words mean, and what the shell offers on TAB.

The type of an option has its kind, as `joints: JointNames | None`: its words are parsed, completed
and refused in one way in all commands. Nothing heavy is imported, since it runs with every TAB.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

import seaid
from seaid.errors import SeaidError, shortened, unknown_name

Completer = Callable[[Any, str], list[str]]
_Value = TypeVar("_Value")


@dataclass(frozen=True)
class Kind:
    """How words become a value.

    Parameters
    ----------
    metavar : str
        What stands for the value in the help; "": its type.
    parse : function of a text, optional
        Returns the value, and raises BadParameter; default: a text or path as it is.
    completer : function of the context and the incomplete word, optional
        Returns what the shell offers; default: what it offers by itself.
    hint : str
        Added to the help of the option.
    """

    metavar: str
    parse: Callable[[str], Any] | None = None
    completer: Completer | None = None
    hint: str = ""


def choice(option: str, names: Callable[[], tuple[str, ...]]) -> Kind:
    """Return the kind of an option with few values, which are checked before any file is read."""

    def parse(text: str) -> str:
        if text not in names():
            kind = {"fail-on": "severity"}.get(option, option)
            raise SeaidError(f"--{option}: {unknown_name(kind, text, names())}")
        return text

    return Kind("", parse, _completer(lambda context: names()))


def names_of(text: str) -> list[str]:
    """Return the names in a list with commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _refusing(wrong: str) -> Callable[[Callable[[str], _Value]], Callable[[str], _Value]]:
    """Return a decorator: a text for which a function raises ValueError is refused as `wrong`."""

    def decorate(parse: Callable[[str], _Value]) -> Callable[[str], _Value]:
        @wraps(parse)
        def parsed(text: str) -> _Value:
            try:
                return parse(text)
            except ValueError:
                raise typer.BadParameter(f"'{shortened(text)}' {wrong}") from None

        return parsed

    return decorate


def _by_name(text: str) -> dict[str, float]:
    """Return {name: number} of a text as knee=2,hip=1."""
    pairs = [part.split("=", 1) for part in text.split(",")]
    return {name.strip(): float(value) for name, value in pairs}


def _number_or_by_name(text: str) -> float | dict[str, float]:
    return _by_name(text) if "=" in text else float(text)


def _pair(text: str) -> tuple[float, float]:
    first, second = map(float, text.split(","))
    return first, second


@_refusing("is not x,y,z, as 0,0,-9.81")
def vector_of(text: str) -> tuple[float, float, float]:
    """Return three numbers with commas between them."""
    x, y, z = map(float, text.split(","))
    return x, y, z


@_refusing("is not knee=30 or knee=20:45, joints separated by commas")
def temperatures_of(text: str) -> dict[str, list[float]]:
    """Return {joint: temperatures from start to end} of a text as knee=20:45,hip=30."""
    pairs = [part.rpartition("=") for part in text.split(",") if part]
    return {joint: [float(value) for value in of.split(":")] for joint, _, of in pairs}


@_refusing("is not NAME=VALUE, as warm=run.csv")
def named_of(text: str) -> tuple[str, str]:
    """Return the name and the value of a text NAME=VALUE."""
    name, _, value = text.partition("=")
    if not (name and value):
        raise ValueError(text)
    return name, value


@_refusing("is not link:mass:x,y,z, as foot:2.0:0.15,0,0")
def payload_of(text: str) -> seaid.Payload:
    """Return the payload of a text: link:mass, and then :x,y,z and :ixx,iyy,izz,ixy,ixz,iyz."""
    link, *parts = text.split(":")
    point_mass: list[list[float]] = [[], [0.0] * 3, [0.0] * 6]  # defaults of what follows the link
    numbers = [list(map(float, part.split(","))) for part in parts]
    (mass,), (x, y, z), (xx, yy, zz, xy, xz, yz) = numbers + point_mass[len(numbers) :]
    return seaid.Payload(link, mass, (x, y, z), ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))


def condition_payload_of(text: str) -> tuple[str, seaid.Payload]:
    """Return the name of a condition and its payload, of a text NAME=LINK:MASS:X,Y,Z."""
    name, payload = named_of(text)
    return name, payload_of(payload)


@_refusing(
    "is not link:x,y,z:flat or link:radius=r, as FL_foot,FR_foot:radius=0.02 of both; contacts of "
    "another shape have a --contact of their own"
)
def contacts_of(text: str) -> list[seaid.robot.Contact]:
    """Return the contacts of a text: links with commas, and then :x,y,z, :flat and :radius=r."""
    links, *parts = text.split(":")
    properties: dict[str, Any] = {}
    for part in parts:
        if part == "flat":
            properties["is_flat"] = True
        elif part.startswith("radius="):
            properties["radius_m"] = float(part.removeprefix("radius="))
        else:
            x, y, z = map(float, part.split(","))
            properties["position_m"] = (x, y, z)
    return [seaid.robot.Contact(link, **properties) for link in names_of(links)]


def text_of(value: Any) -> str:
    """Return a value as the command line has it: 'x=1,y=2' of a mapping, '0,0,-9.81' of numbers."""
    if isinstance(value, Mapping):
        return ",".join(f"{name}={text_of(entry)}" for name, entry in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ",".join(map(text_of, value))
    if isinstance(value, float):
        short = f"{value:.12g}"
        return short if float(short) == value else repr(float(value))
    return str(value)


def payload_text(payload: seaid.Payload) -> str:
    """Return a payload as the command line has it."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = payload.inertia
    numbers = [(payload.mass,), payload.com, (xx, yy, zz, xy, xz, yz)]
    return ":".join([payload.link, *map(text_of, numbers if any(numbers[2]) else numbers[:2])])


def contact_text(contact: seaid.robot.Contact) -> str:
    """Return a contact as the command line has it."""
    more = ["flat"] * contact.is_flat
    more += [f"radius={text_of(contact.radius_m)}"] if contact.radius_m else []
    return ":".join([contact.link, text_of(contact.position_m), *more])


def _completer(values: Callable[[Any], Iterable[str]], commas: bool = False) -> Completer:
    """Return what completes a value, or with `commas` the last one of a list."""

    def complete(ctx: Any, incomplete: str) -> list[str]:  # Typer looks at these names
        before, comma, _ = incomplete.rpartition(",") if commas else ("", "", incomplete)
        taken = before.split(",")
        return [before + comma + value for value in values(ctx) if value not in taken]

    return complete


def _in_robot(element: str, after: str = "", commas: bool = False) -> Completer:
    """Return what completes a joint that may move, or a link, of the URDF on the line."""
    from xml.etree import ElementTree

    def values(context: Any) -> list[str]:
        # The parser leaves positional arguments in `args` where the last option has no value yet.
        path = context.params.get("urdf") or next(iter(context.args), "")
        try:
            elements = ElementTree.parse(path).getroot().findall(element)
        except (OSError, ValueError, ElementTree.ParseError):
            return []
        return [found.get("name", "") + after for found in elements if found.get("type") != "fixed"]

    return _completer(values, commas)


def check_suffix(path: Path | str, suffixes: Sequence[str], option: str | None = None) -> None:
    """Raise BadParameter for a result that is not for stdout and has none of the suffixes."""
    if str(path) != "-" and Path(path).suffix.lower() not in suffixes:
        message = f"'{path}' must end in {' or '.join(suffixes)}"
        raise typer.BadParameter(message, param_hint=option)


def _write(metavar: str, *suffixes: str) -> Kind:
    """Return the kind of a file that is written, `-` for stdout, whose suffix is checked."""

    def parse(text: str) -> Path:
        check_suffix(text, suffixes)
        return Path(text)

    return Kind(metavar, parse)


LOGS = (
    *(".csv", ".txt", ".tsv", ".dat", ".npy", ".npz", ".parquet", ".h5", ".hdf5", ".json", ".mat"),
    *(".db3", ".mcap", ".bag", ".hebilog"),
)
"""Suffixes of the files that `READERS` of seaid/log/readers/opening.py reads, without loading the
readers; a test compares the two."""
SENSORS = (
    *("motor_position", "joint_position", "motor_torque", "motor_current", "motor_voltage"),
    *("joint_torque", "deflection"),
)

UrdfFile = Annotated[Path, Kind("URDF")]
LogFile = Annotated[Path, Kind("LOG")]
TomlFile = Annotated[Path, Kind("TOML")]
JsonFile = Annotated[Path, Kind("JSON")]
RunFile = Annotated[Path, Kind("RUN")]
ModelFile = Annotated[Path, Kind("FILE")]
TableFile = Annotated[Path, Kind("TABLE")]
ProjectFile = Annotated[Path, Kind("[PROJECT]")]
Folder = Annotated[Path, Kind("FOLDER")]

Page = Annotated[Path, _write("HTML", ".html", ".htm")]
Plan = Annotated[Path, _write("JSON", ".json")]
WrittenLog = Annotated[Path, _write("LOG", ".csv", ".npz")]

Names = Annotated[list[str], Kind("", names_of)]
JointNames = Annotated[list[str], Kind("", names_of, _in_robot("joint", commas=True))]
LinkNames = Annotated[list[str], Kind("LINK,LINK", names_of)]
SensorNames = Annotated[
    list[str], Kind("", names_of, _completer(lambda context: SENSORS, commas=True))
]
Link = Annotated[str, Kind("LINK", completer=_in_robot("link"))]
ByJoint = Annotated[
    float | dict[str, float],
    Kind(
        "",
        _refusing("is neither a number nor a list as knee=2,hip=1")(_number_or_by_name),
        _in_robot("joint", "=", commas=True),
        "for all joints, or as knee=2,hip=1",
    ),
]
_positions = _refusing("names no joint: write it as torso=0.3,head=0.1")(_by_name)
_deviations = _refusing("is neither a number nor a list as torque=0.03,payload=0.01")
_band = _refusing("is not a lowest and a highest frequency, as 0.5,20")(_pair)
_sole = _refusing("is not a length and a width, as 0.2,0.1")(_pair)
Positions = Annotated[dict[str, float], Kind("TORSO=0.3,HEAD=0.1", _positions)]
Deviations = Annotated[float | dict[str, float], Kind("", _deviations(_number_or_by_name))]
Vector = Annotated[tuple[float, ...], Kind("X,Y,Z", vector_of)]
Band = Annotated[tuple[float, float], Kind("", _band)]
Sole = Annotated[tuple[float, float], Kind("", _sole)]
Temperatures = Annotated[dict[str, list[float]], Kind("", temperatures_of)]
Condition = Annotated[tuple[str, str], Kind("NAME=LOG", named_of)]
ConditionPayload = Annotated[tuple[str, Any], Kind("NAME=LINK:MASS:X,Y,Z", condition_payload_of)]
LinkPayload = Annotated[
    Any,  # a Payload, which is imported on use
    Kind("LINK:MASS:X,Y,Z[:IXX,IYY,IZZ,IXY,IXZ,IYZ]", payload_of, _in_robot("link", ":")),
]
Contacts = Annotated[Any, Kind("LINK,LINK[:X,Y,Z][:flat][:radius=R]", contacts_of)]


# Files in a wrong place of the line, named with the place where they belong


def check_robot_files(urdf: Path, drives: Path | None) -> None:
    """Raise SeaidError for a log or TOML in the place of the URDF, and others than drives."""
    _check_place(urdf, "the URDF", ("a log", "TOML"))
    if drives is not None and drives.suffix.lower() in LOGS:
        raise SeaidError(
            f"--drives: '{drives}' is a log by its name: --drives takes the TOML of the drives, "
            "and logs follow the URDF"
        )
    if drives is not None and _kind(drives) == "description":
        raise SeaidError(f"--drives: '{drives}' describes a log: give it with --description")


def check_log_files(logs: Iterable[Path], description: Path | None = None) -> None:
    """Raise SeaidError for other files than logs, a log given twice, and drives as description."""
    from seaid._files import real_path

    seen = set()
    for log in logs:
        _check_place(log, "a log", ("a robot", "TOML"))
        if real_path(log) in seen:
            raise SeaidError(
                f"'{log}' is given twice, which would count its samples twice: name each log once"
            )
        seen.add(real_path(log))
    if description is not None and _kind(description) == "drives":
        raise SeaidError(f"--description: '{description}' has drives: give it with --drives")


def _check_place(path: Path, place: str, others: Sequence[str]) -> None:
    """Raise SeaidError for a file that is one of the `others` by its name."""
    suffixes = {"a log": LOGS, "a robot": seaid.robot.ROBOT_SUFFIXES, "TOML": (".toml",)}
    for kind in others:
        if path.suffix.lower() in suffixes[kind]:
            raise SeaidError(
                f"'{path}' stands where {place} belongs, and is {kind} by its name: the URDF comes "
                "first (or a seaid.toml here names it: seaid init), then the logs; give drives "
                "with --drives, and the description of a log with --description"
            )


def _kind(path: Path) -> str:
    """Return whether a TOML has "drives" or a "description", "" if neither is clear."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ""  # its reader says what is wrong
    if "joints" in content or "time" in content:
        return "description"
    tables = content.values()
    return "drives" if content and all(isinstance(x, dict) and "type" in x for x in tables) else ""
