"""Kinds of values on the command line: what their words mean.

The type of an option has its kind, as `joints: Names | None`: its words are parsed and refused in
one way in all commands. Nothing heavy is imported, since it runs with every TAB.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import click

import seaid
from seaid.errors import SeaidError, shortened


@dataclass(frozen=True)
class Kind(click.ParamType[Any]):
    """How a word becomes a value.

    Parameters
    ----------
    name : str
        What stands for the value in the help.
    parse : function of a text
        Returns the value, and raises ValueError.
    wrong : str
        What is said of another text, as "is not x,y,z".
    hint : str
        Added to the help of the option.
    """

    name: str
    parse: Callable[[str], Any]
    wrong: str = ""
    hint: str = ""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return the value of a word; a default is a value already."""
        if not isinstance(value, str):
            return value
        try:
            return self.parse(value)
        except ValueError:
            self.fail(f"'{shortened(value)}' {self.wrong}", param, ctx)
        except SeaidError as problem:
            raise problem.at(param.opts[0]) from None


class File(click.Path):
    """A path, for which the shell offers its files; one that is written ends in a suffix."""

    def __init__(self, name: str, *suffixes: str) -> None:
        """Make the kind by the name in the help."""
        super().__init__(path_type=Path)
        self.name, self.suffixes = name, suffixes

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return the path of a word."""
        if self.suffixes:
            check_suffix(value, self.suffixes)
        return super().convert(value, param, ctx)


def check_suffix(path: Path | str, suffixes: Sequence[str], option: str | None = None) -> None:
    """Raise BadParameter for a result that has none of the suffixes."""
    if Path(path).suffix.lower() not in suffixes:
        message = f"'{path}' must end in {' or '.join(suffixes)}"
        raise click.BadParameter(message, param_hint=option)


def names_of(text: str) -> list[str]:
    """Return the names in a list with commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _by_name(text: str) -> dict[str, float]:
    """Return {name: number} of a text as knee=2,hip=1."""
    pairs = [part.split("=", 1) for part in text.split(",")]
    return {name.strip(): float(value) for name, value in pairs}


def _number_or_by_name(text: str) -> float | dict[str, float]:
    return _by_name(text) if "=" in text else float(text)


def _pair(text: str) -> tuple[float, float]:
    first, second = map(float, text.split(","))
    return first, second


def _vector(text: str) -> tuple[float, float, float]:
    x, y, z = map(float, text.split(","))
    return x, y, z


def _temperatures(text: str) -> dict[str, list[float]]:
    """Return {joint: temperatures from start to end} of a text as knee=20:45,hip=30."""
    pairs = [part.rpartition("=") for part in text.split(",") if part]
    return {joint: [float(value) for value in of.split(":")] for joint, _, of in pairs}


def payload_of(text: str) -> seaid.Payload:
    """Return the payload of a text: link:mass, and then :x,y,z and :ixx,iyy,izz,ixy,ixz,iyz."""
    link, *parts = text.split(":")
    point_mass: list[list[float]] = [[], [0.0] * 3, [0.0] * 6]  # defaults of what follows the link
    numbers = [list(map(float, part.split(","))) for part in parts]
    (mass,), (x, y, z), (xx, yy, zz, xy, xz, yz) = numbers + point_mass[len(numbers) :]
    return seaid.Payload(link, mass, (x, y, z), ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))


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
            properties["position_m"] = _vector(part)
    return [seaid.robot.Contact(link, **properties) for link in names_of(links)]


UrdfFile = Annotated[Path, File("URDF")]
LogFile = Annotated[Path, File("LOG")]
TomlFile = Annotated[Path, File("TOML")]
YamlFile = Annotated[Path, File("YAML")]
JsonFile = Annotated[Path, File("JSON")]
RunFile = Annotated[Path, File("RUN")]
ModelFile = Annotated[Path, File("FILE")]
TableFile = Annotated[Path, File("TABLE")]
ProjectFile = Annotated[Path, File("[PROJECT]")]
Folder = Annotated[Path, File("FOLDER")]
Page = Annotated[Path, File("HTML", ".html", ".htm")]
Plan = Annotated[Path, File("JSON", ".json")]
WrittenLog = Annotated[Path, File("LOG", ".csv", ".npz")]

Names = Annotated[list[str], Kind("NAME,NAME", names_of)]
Link = Annotated[str, Kind("LINK", str)]
ByJoint = Annotated[
    float | dict[str, float],
    Kind(
        "NUMBER",
        _number_or_by_name,
        "is neither a number nor a list as knee=2,hip=1",
        ", for all joints, or as knee=2,hip=1",
    ),
]
Positions = Annotated[
    dict[str, float],
    Kind("TORSO=0.3,HEAD=0.1", _by_name, "names no joint: write it as torso=0.3,head=0.1"),
]
Deviations = Annotated[
    float | dict[str, float],
    Kind(
        "NUMBER",
        _number_or_by_name,
        "is neither a number nor a list as torque=0.03,payload=0.01",
    ),
]
Vector = Annotated[tuple[float, ...], Kind("X,Y,Z", _vector, "is not x,y,z, as 0,0,-9.81")]
Band = Annotated[
    tuple[float, float],
    Kind("LOW,HIGH", _pair, "is not a lowest and a highest frequency, as 0.5,20"),
]
Sole = Annotated[
    tuple[float, float], Kind("LENGTH,WIDTH", _pair, "is not a length and a width, as 0.2,0.1")
]
Temperatures = Annotated[
    dict[str, list[float]],
    Kind(
        "KNEE=20:45",
        _temperatures,
        "is not knee=30 or knee=20:45, joints separated by commas",
    ),
]
LinkPayload = Annotated[
    Any,  # a Payload, which is imported on use
    Kind(
        "LINK:MASS:X,Y,Z[:IXX,IYY,IZZ,IXY,IXZ,IYZ]",
        payload_of,
        "is not link:mass:x,y,z, as foot:2.0:0.15,0,0",
    ),
]
Contacts = Annotated[
    Any,
    Kind(
        "LINK,LINK[:X,Y,Z][:flat][:radius=R]",
        contacts_of,
        "is not link:x,y,z:flat or link:radius=r, as FL_foot,FR_foot:radius=0.02 of both; contacts "
        "of another shape have a --contact of their own",
    ),
]
