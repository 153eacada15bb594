"""Command init: a first project file."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from seaid.cli.messages import show
from seaid.cli.options import AsJson, Drives, Logs, Urdf, payload_of


def init(
    urdf: Urdf,
    logs: Logs,
    *,
    drives: Drives = None,
    payload: Annotated[
        list[str] | None,
        Option("--payload", help="Known body in all logs.", metavar="LINK:MASS:X,Y,Z"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a first project file for a robot and its logs, with each doubt as a comment.

    The file is seaid.toml in the working folder. Logs with custom columns get a description, and a
    robot without drives gets those that the logs show: check what is unsure, then run it.

    seaid init leg.urdf run.csv other.csv
    seaid init arm.urdf run.csv --drives arm.toml --payload hand:1.5:0,0,0.05
    """
    from seaid.project import write_first_project

    payloads = [payload_of(text) for text in payload or ()]
    found = write_first_project(urdf, logs, drives=drives, payloads=payloads)
    text = [f"unsure: {one}" for one in found.doubts]
    text.append("Check what is unsure, then: seaid run")
    content = {"files": found.files, "doubts": found.doubts}
    show("\n".join(text), content, as_json, *found.files)
