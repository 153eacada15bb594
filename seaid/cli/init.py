"""Command init: a first project file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from seaid.cli.messages import show
from seaid.cli.mistakes import check_log_files, check_robot_files
from seaid.cli.options import AsJson, Logs, RobotOptions, names, payload_of, vector


def init(
    given: RobotOptions,
    logs: Logs,
    *,
    folder: Annotated[Path, Option(help="The folder of the project.")] = Path(),
    as_json: AsJson = False,
) -> None:
    """Write a first project file for a robot and its logs, with each doubt as a comment.

    The file is seaid.toml. Logs with custom columns get a description, and a robot without drives
    gets those that the logs show: check what is unsure, then run it.

    seaid init leg.urdf run.csv other.csv
    seaid init arm.urdf run.csv --drives arm.toml --payload hand:1.5:0,0,0.05
    """
    from seaid.project import write_first_project

    check_robot_files(given.urdf, given.drives)
    check_log_files(logs)
    found = write_first_project(
        given.urdf,
        logs,
        drives=given.drives,
        joints=names(given.joints),
        payloads=[payload_of(text) for text in given.payload or ()],
        gravity=vector("--gravity", given.gravity),
        folder=folder,
    )
    text = [f"unsure: {one}" for one in found.doubts]
    place = "" if folder == Path() else f" {folder}"
    text.append(f"Check what is unsure, then: seaid run{place}")
    content = {"files": found.files, "doubts": found.doubts}
    show("\n".join(text), content, as_json, *found.files)
