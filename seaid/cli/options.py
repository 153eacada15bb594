"""Arguments and options that commands share, and the conversion of their values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

import seaid
from seaid.errors import SeaidError, unknown_name

if TYPE_CHECKING:
    from seaid.log import Log
    from seaid.robot import Payload, Robot


Urdf = Annotated[Path, typer.Argument(help="The robot, with its base fixed.", metavar="URDF")]
Logs = Annotated[
    list[Path], typer.Argument(help="Logs to identify from: docs/logs.md.", metavar="LOG...")
]
FromLogs = Annotated[
    list[Path],
    typer.Option("--from", help="Log to identify from. May be repeated.", metavar="LOG"),
]
Drives = Annotated[
    Path | None,
    typer.Option(help="Its drives, one table per joint; default: all stiff.", metavar="TOML"),
]
Joints = Annotated[
    str | None, typer.Option(help="Moving joints, as a,b,c; the others are locked at zero.")
]
Payloads = Annotated[
    list[str] | None,
    typer.Option(
        "--payload",
        help="Known body on a link: mass [kg] at x,y,z [m] in the link's frame. May be repeated.",
        metavar="LINK:MASS:X,Y,Z",
    ),
]
KnownBodies = Annotated[
    list[str] | None,
    typer.Option(
        "--known-body",
        help="Link with the known inertial parameters of the URDF. May be repeated.",
        metavar="LINK",
    ),
]
Description = Annotated[
    Path | None,
    typer.Option(
        help="Meaning of custom columns of the logs; default: run.toml for run.csv.",
        metavar="TOML",
    ),
]
Repair = Annotated[
    bool, typer.Option("--repair", help="Repair gaps, repeated times and lost samples of the logs.")
]
TorqueJoints = Annotated[
    str | None,
    typer.Option(help="Joints whose torque is used, as a,b,c; default: all with a torque."),
]


def one_of(name: str, choice: Callable[[], Any]) -> Callable[[str], str]:
    """Return the check of an option whose values are a Literal of the library.

    It is made before any file is read, and imports the library only if the option is used.
    """

    def checked(value: str) -> str:
        if value not in get_args(choice()):
            raise SeaidError(f"{name}=: {unknown_name(name, value, get_args(choice()))}")
        return value

    return checked


Method = Annotated[
    str,
    typer.Option(
        help="two-step: springs, then bodies; simultaneous: both in one regression.",
        callback=one_of("method", lambda: seaid.identification.Method),
    ),
]
Estimator = Annotated[
    str,
    typer.Option(
        help="ols, wls, huber, tukey or iv.",
        callback=one_of("estimator", lambda: seaid.estimation.EstimatorName),
    ),
]
CutoffHz = Annotated[
    float | None, typer.Option(help="Cutoff of the low pass [Hz]; default: from the data.")
]
EncoderOffsetStd = Annotated[
    float, typer.Option(help="Standard deviation of joint encoder offsets [rad or m].")
]
Output = Annotated[Path, typer.Option("--output", "-o", help="File for the result.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite existing files.")]
AsJson = Annotated[bool, typer.Option("--json", help="JSON on stdout.")]


def names(text: str | None) -> list[str] | None:
    """Return the names in a list with commas; None for None."""
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]


def values(option: str, text: str | None) -> float | dict[str, float] | None:
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
            f"'{text}' is neither a number nor a list as knee=2,hip=1", param_hint=option
        ) from None


def payload_of(text: str) -> Payload:
    """Return the payload of 'link:mass:x,y,z', or of 'link:mass' at the link's origin."""
    from seaid.robot import Payload

    link, *parts = text.split(":")
    try:
        mass = float(parts[0])
        x, y, z = map(float, parts[1].split(",")) if len(parts) > 1 else (0.0, 0.0, 0.0)
        if len(parts) > 2:
            raise ValueError
    except (ValueError, IndexError):
        raise typer.BadParameter(
            f"'{text}' is not link:mass:x,y,z, as foot:2.0:0.15,0,0", param_hint="--payload"
        ) from None
    return Payload(link, mass, (x, y, z))


def robot_of(
    urdf: Path,
    drives: Path | None,
    joints: str | None = None,
    payloads: list[str] | None = None,
    known_bodies: list[str] | None = None,
) -> Robot:
    """Return the robot of the options."""
    from seaid.robot import load_robot

    return load_robot(
        urdf,
        drives,
        joints=names(joints),
        payloads=[payload_of(text) for text in payloads or ()],
        known_bodies=known_bodies or (),
    )


def logs_of(
    paths: list[Path], robot: Robot, description: Path | None = None, repair: bool = False
) -> list[Log]:
    """Return the logs of a robot, read with one description or with that of each log."""
    from seaid.log import Repairs, read_log

    limits = Repairs() if repair else None
    return [read_log(path, robot, description=description, repair=limits) for path in paths]


def check_validation_logs(unseen: Sequence[Path], from_logs: Sequence[Path]) -> None:
    """Raise SeaidError for a validation log that is also used for the identification."""
    from seaid._files import real_path

    known = {real_path(path) for path in from_logs}
    for log in unseen:
        if real_path(log) in known:
            raise SeaidError(f"'{log}' is used for the identification: validate on another log")


def checked_suffix(path: Path, *allowed: str) -> Path:
    """Return the path if its suffix is allowed. Raises BadParameter otherwise."""
    if path.suffix.lower() not in allowed:
        raise typer.BadParameter(
            f"'{path}' must end in {' or '.join(allowed)}", param_hint="--output"
        )
    return path
