"""Draw the packages of seaid, each below those that it imports, into docs/_static/architecture.svg.

    python -m scripts.architecture

A package stands as high as its imports at run time allow. An arrow leads from a package to one
that imports it, unless a way of other arrows does so too. The command line stands below all. The
order of the packages is that of tests/repository/test_architecture.py; the captions are here.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.benchmarks.house import import_graph
from tests.repository.test_architecture import FLOORS

ROOT = Path(__file__).resolve().parents[1]
PICTURED = FLOORS[: FLOORS.index("cli")]
PICTURE = ROOT / "docs/_static/architecture.svg"

CAPTIONS = {
    "symbolic": ("model", "exact: (9) and (14)"),
    "drives": ("model", "one joint: (1)–(4), (7)"),
    "robot": ("model", "URDF and drives: Robot"),
    "log": ("data", "files and repairs: Log"),
    "regressor": ("model", "(7) and (8): y = W θ"),
    "estimation": ("result", "θ and its covariance"),
    "checks": ("result", "mistakes, with remedies"),
    "excitation": ("data", "motions: Trajectory"),
    "simulation": ("data", "in place of a robot: Log"),
    "identification": ("result", "both sides: Identification"),
    "frequency": ("result", "responses to multisines"),
    "legged": ("result", "moving bases, contacts"),
    "export": ("tool", "URDF, MuJoCo, Isaac"),
    "report": ("tool", "tables, figures, the page"),
    "project": ("tool", "a set-up in one file"),
    "view": ("tool", "the robot in a browser"),
    "cli": ("tool", "every step as a command of the shell"),
}
"""{package: kind of what it gives, in a few words}."""

KINDS = {"model": "equations", "data": "motions and logs", "result": "estimates", "tool": "output"}
"""{kind: its name in the legend}."""

WIDTH, BOX, HEIGHT, STEP, TOP = 520, 156, 42, 64, 14
"""Sizes in px: the picture, a box, and from one row to the next."""

LIGHT = {
    **{"card-fill": "#fbfcfd", "card-line": "#d5dae0", "box": "#ffffff", "flow": "#8a949f"},
    **{"text": "#22272e", "dim": "#59636e"},
    **{"model": "#1f5fbf", "data": "#c8600a", "result": "#187a50", "tool": "#98a2ad"},
}
DARK = {
    **{"card-fill": "#1a1d21", "card-line": "#3a4048", "box": "#22262c", "flow": "#7d8792"},
    **{"text": "#e6e9ed", "dim": "#a8b1bb"},
    **{"model": "#7eacf5", "data": "#f29a4a", "result": "#5fcf9a", "tool": "#77818c"},
}
"""{what: its colour}."""

MONOSPACE = "ui-monospace, Menlo, Consolas, 'DejaVu Sans Mono', monospace"


def style() -> str:
    """Return the style sheet, with the colours of dark pages too."""
    return (
        f"    .dim {{ font-size: 11px }} .box {{ stroke-width: 1.4 }}\n"
        f"    .name {{ font-family: {MONOSPACE}; font-size: 12px; font-weight: 600 }}\n"
        f"    .flow {{ fill: none; stroke-width: 1.5 }}\n"
        f"    {colours(LIGHT)}\n"
        f"    @media (prefers-color-scheme: dark) {{\n      {colours(DARK)}\n    }}\n"
    )


def colours(scheme: dict[str, str]) -> str:
    """Return the rules of a colour scheme."""
    rules = {
        ".card": f"fill: {scheme['card-fill']}; stroke: {scheme['card-line']}",
        "text": f"fill: {scheme['text']}",
        ".dim": f"fill: {scheme['dim']}",
        ".box": f"fill: {scheme['box']}",
        ".flow": f"stroke: {scheme['flow']}",
        ".tip": f"fill: {scheme['flow']}",
        **{f".{kind}": f"stroke: {scheme[kind]}" for kind in KINDS},
    }
    return " ".join(f"{name} {{ {rule} }}" for name, rule in rules.items())


def imports_of_packages() -> dict[str, set[str]]:
    """Return {package: packages that it imports at run time}, for all but the command line."""
    imports: dict[str, set[str]] = {package: set() for package in PICTURED}
    for module, others in import_graph("seaid", ROOT / "seaid").items():
        package = [*module.split("."), ""][1]
        for other in {[*name.split("."), ""][1] for name in others}:
            if package in imports and other in FLOORS[: FLOORS.index(package)]:
                imports[package].add(other)
    return imports


def all_before(imports: dict[str, set[str]], package: str) -> set[str]:
    """Return what a package imports, and what these import."""
    return imports[package].union(*(all_before(imports, other) for other in imports[package]))


def arrows(imports: dict[str, set[str]]) -> dict[str, list[str]]:
    """Return {package: packages that it imports and that none of the others imports}."""
    return {
        package: [
            other
            for other in PICTURED
            if other in imports[package]
            and not any(other in all_before(imports, between) for between in imports[package])
        ]
        for package in PICTURED
    }


def rows_of(imports: dict[str, set[str]]) -> list[list[str]]:
    """Return the rows of packages, each row below all that its packages import."""
    height: dict[str, int] = {}
    for package in PICTURED:
        height[package] = 1 + max((height[other] for other in imports[package]), default=-1)
    return [[p for p in PICTURED if height[p] == row] for row in range(max(height.values()) + 1)]


def places(rows: list[list[str]], drawn: dict[str, list[str]]) -> dict[str, tuple[int, int]]:
    """Return {package: (middle of its box, its top)}: near the packages that it imports."""
    place: dict[str, tuple[int, int]] = {}
    for number, row in enumerate(rows):

        def mean(package: str) -> float:
            above = [place[other][0] for other in drawn[package]]
            return sum(above) / len(above) if above else 0.0

        gap = BOX + 14
        for column, package in enumerate(sorted(row, key=mean)):
            middle = WIDTH // 2 + round(gap * (column - (len(row) - 1) / 2))
            place[package] = (middle, TOP + STEP * number)
    return place


def box(package: str, middle: int, top: int, width: int = BOX) -> str:
    """Return a package with its caption."""
    kind, caption = CAPTIONS[package]
    left = middle - width // 2
    return (
        f'  <rect class="box {kind}" x="{left}" y="{top}" width="{width}" height="{HEIGHT}" '
        f'rx="8"/>\n'
        f'  <text class="name" x="{left + 10}" y="{top + 18}">{package}</text>\n'
        f'  <text class="dim" x="{left + 10}" y="{top + 34}">{caption}</text>\n'
    )


def arrow(start: tuple[int, int], end: tuple[int, int]) -> str:
    """Return an arrow from the bottom of one box to the top of another."""
    (x1, y1), (x2, y2) = start, end
    y1, curve = y1 + HEIGHT, (STEP - HEIGHT) // 2
    return (
        f'  <path class="flow" d="M{x1} {y1} '
        f'C{x1} {y2 - curve} {x2} {y2 - 2 * curve} {x2} {y2 - 6}"/>\n'
        f'  <path class="tip" d="M{x2} {y2 - 1} l-4 -8 h8 z"/>\n'
    )


def legend() -> str:
    """Return what the colours are."""
    lines = []
    for row, (kind, name) in enumerate(KINDS.items()):
        y = TOP + 4 + 18 * row
        lines.append(f'  <rect class="box {kind}" x="14" y="{y}" width="12" height="12" rx="3"/>\n')
        lines.append(f'  <text class="dim" x="33" y="{y + 10}">{name}</text>\n')
    return "".join(lines)


def picture() -> str:
    """Return the drawing as SVG."""
    imports = imports_of_packages()
    drawn, rows = arrows(imports), rows_of(imports)
    place = places(rows, drawn)
    bottom = TOP + STEP * len(rows)
    height = bottom + HEIGHT + TOP
    said = "; ".join(
        f"{package}: {CAPTIONS[package][1]}, below {', '.join(drawn[package]) or 'none'}"
        for package in PICTURED
    )
    font = "system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif"
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img" '
        f'aria-labelledby="t d" font-family="{font}" font-size="13">\n'
        '  <title id="t">The packages of seaid, each with arrows to those that use it</title>\n'
        f'  <desc id="d">{said}.</desc>\n  <style>\n{style()}  </style>\n'
        f'  <rect class="card" x="0.5" y="0.5" width="{WIDTH - 1}" height="{height - 1}" '
        f'rx="10"/>\n'
    )
    flows = [arrow(place[other], place[one]) for one in PICTURED for other in drawn[one]]
    boxes = [box(package, *place[package]) for package in PICTURED]
    boxes.append(box("cli", WIDTH // 2, bottom, 3 * BOX + 28))
    return "".join([head, *flows, *boxes, legend(), "</svg>\n"])


def main() -> None:
    """Write the picture."""
    PICTURE.write_text(picture(), "utf-8")


if __name__ == "__main__":
    main()
