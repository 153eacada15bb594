"""Files in a wrong place of the line, named with the place where they belong."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from pathlib import Path

from seaid.cli.completion import LOGS
from seaid.errors import SeaidError

_ROBOTS = (".urdf", ".xacro")


def check_robot_files(urdf: Path, drives: Path | None) -> None:
    """Raise SeaidError for a log or TOML in the place of the URDF, and others than drives."""
    if urdf.suffix.lower() in LOGS:
        raise SeaidError(
            f"'{urdf}' stands where the URDF belongs, and is a log by its name: the URDF comes "
            "first, and then the logs; or have a seaid.toml here, which names it (seaid init)"
        )
    if urdf.suffix.lower() == ".toml":
        raise SeaidError(
            f"'{urdf}' stands where the URDF belongs, which comes first: give drives with --drives "
            "and the description of a log with --description"
        )
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
        if log.suffix.lower() in _ROBOTS:
            raise SeaidError(
                f"'{log}' stands where a log belongs, and is a robot by its name: the URDF comes "
                "first, and then the logs"
            )
        if log.suffix.lower() == ".toml":
            raise SeaidError(
                f"'{log}' stands where a log belongs: give drives with --drives and the "
                "description of a log with --description"
            )
        if real_path(log) in seen:
            raise SeaidError(
                f"'{log}' is given twice, which would count its samples twice: name each log once"
            )
        seen.add(real_path(log))
    if description is not None and _kind(description) == "drives":
        raise SeaidError(f"--description: '{description}' has drives: give it with --drives")


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
