"""Compare numeric and exact base parameters of every robot of example-robot-data.

The table has the robots with a fixed base, their legs as separate chains, the models here, and the
four robots with rounded angles, with and without snapping. It is written as Markdown to the folder
of `--output`.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import seaid
from scripts.example_robots import example_urdfs
from seaid._files import result_folder, write_whole
from seaid._progress import track
from seaid.regressor import CrossCheck, cross_check

MODELS = Path(__file__).resolve().parents[1] / "models"
ROUNDED = ("kinova.urdf", "anymal-kinova.urdf", "so100.urdf", "so101.urdf")
LEG = re.compile(r"hip|leg|thigh|haa|hfe", re.IGNORECASE)
HEADER = (
    "robot",
    "joints",
    "numeric",
    "exact",
    "same columns",
    "largest difference",
    "gap",
    "numeric [s]",
    "exact [s]",
)
Result = TypeVar("Result")

CAUSES = """
Causes of different columns and of small singular-value gaps:

- `kinova` and `anymal-kinova` write 180 degrees as 3.14159265359, 2.1e-13 rad off. As written, the
  first axis is not parallel to gravity. The exact method has no tolerance, and its count is 2
  higher: right for the file, not for the robot. The two columns are 1e-12 of the others, and the
  numeric method takes them as zero.
- `so100` and `so101` write angles such as 1.5708, 4e-6 rad off. Both methods include the tilt, and
  both count 2 more than the robot has. Snapping, the default of `load_robot`, gives 36 with both.
- `romeo_laas_small` has wrist and elbow axes tilted by 2.58 degrees (0.045 rad) against their
  links. From left to right, only that tilt separates first moments and inertias, again and again
  along the arm. The groupings have coefficients up to 1/0.045^2 = 493 and products up to 4166, and
  the base columns a condition number of 3e4. Rounding of 1e-16 times these coefficients makes the
  rejected columns 4e-12 instead of 1e-15. The smallest accepted column is 0.018, which gives a gap
  of 4e9. The exact null vectors annul the numeric regressor to 2e-15 of the terms they add up. Only
  the last digits of the coefficients are uncertain (absolute difference 1e-9 at 4166).
""".strip()


def leg(robot: seaid.Robot) -> list[str] | None:
    """Return the joints of the first leg of a robot that has more than that leg."""
    model = robot.model
    inner = {int(parent) for parent in model.parents[1:]}
    for tip in range(1, model.njoints):
        path = [int(joint) for joint in model.supports[tip]][1:]
        names = [str(model.names[joint]) for joint in path]
        if tip not in inner and len(path) < robot.n and any(map(LEG.search, names)):
            return names
    return None


def timed(function: Callable[[], Result]) -> tuple[Result, float]:
    """Return a result and the process time it took [s]."""
    begin = time.process_time()
    return function(), time.process_time() - begin


def row(name: str, robot: seaid.Robot) -> tuple[CrossCheck, list[str]]:
    """Compare both methods on one robot; return the check and its line of the table."""
    numeric, numeric_time = timed(lambda: seaid.base_parameters(robot))
    exact, exact_time = timed(lambda: seaid.symbolic.base_parameters(robot))
    check = cross_check(numeric, exact)
    cells = [
        name,
        str(robot.n),
        *map(str, check.counts),
        "yes" if check.same_columns else "no",
        f"{check.max_difference:.1e}" if check.same_columns else "-",
        f"{check.gap:.1e}",
        f"{numeric_time:.2f}",
        f"{exact_time:.3f}",
    ]
    return check, cells


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a markdown table, the first column to the left, the others to the right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def whole_and_legs(only: str) -> list[tuple[str, seaid.Robot]]:
    """Return the robots of the table by name, each followed by its leg."""
    paths = [*sorted(MODELS.glob("*.urdf")), *example_urdfs()]
    paths = [path for path in paths if only in path.stem]
    robots: list[tuple[str, seaid.Robot]] = []
    stems = [path.stem for path in paths]
    for path in paths:
        name = path.stem
        if stems.count(name) > 1:
            name = f"{path.parents[1].name.removesuffix('_description')}/{name}"
        robot = seaid.load_robot(path)
        robots.append((name, robot))
        joints = leg(robot)
        if joints:
            robots.append((f"{name}: leg to {joints[-1]}", seaid.load_robot(path, joints=joints)))
    return robots


def unsnapped(only: str) -> list[tuple[str, seaid.Robot]]:
    """Return the four robots with the angles as their files round them."""
    paths = {path.name: path for path in example_urdfs()}
    return [
        (f"{Path(name).stem}, as written", seaid.load_robot(paths[name], snap_tolerance_rad=0))
        for name in ROUNDED
        if only in name
    ]


def main(output: Path, only: str) -> None:
    """Compare all robots and write the table."""
    result_folder(output)
    robots = whole_and_legs(only)
    if not robots:
        raise seaid.SeaidError(f"no robot has '{only}' in the name of its file")
    checked = [row(name, robot) for name, robot in track(robots, "Numeric and exact", True)]
    rounded = [row(name, robot) for name, robot in track(unsnapped(only), "Rounded angles", True)]
    agreed = sum(check.agree for check, _ in checked)
    differences = [check.max_difference for check, _ in checked if check.same_columns]
    summary = (
        f"{agreed} of {len(checked)} agree: the same base columns, largest difference of the "
        f"groupings {max(differences, default=0.0):.1e} (each base parameter's over its largest "
        "coefficient)."
    )
    parts = ["# Numeric and exact base parameters", summary]
    parts.append(markdown(HEADER, [cells for _, cells in checked]))
    if rounded:
        parts.append("## Without snapping the angles that four files round")
        parts.append(markdown(HEADER, [cells for _, cells in rounded]))
    parts.append(CAUSES)
    path = output / "cross_check.md"
    write_whole(path, "\n\n".join(parts) + "\n")
    print(summary)
    for check, cells in checked:
        if not check.agree:
            print(f"does not agree: {cells[0]}, {check}")
    print(f"Table: {path}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the table")
    parser.add_argument("--only", default="", help="part of the file names of the robots")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", seaid.SeaidWarning)
    try:
        main(arguments.output, arguments.only)
    except seaid.SeaidError as problem:
        sys.exit(f"error: {problem}")
