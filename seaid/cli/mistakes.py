"""Files in a wrong place of the line, named with the place where they belong."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path

import seaid
from seaid.cli.kinds import LOGS
from seaid.errors import SeaidError


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
