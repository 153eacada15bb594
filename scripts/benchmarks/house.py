"""How easy the house is to move into: size, complexity and imports, next to targets and peers.

    python -m scripts.benchmarks.house           print the tables
    python -m scripts.benchmarks.house --write   lower the ceilings of house.toml to what stands

`house.toml` has for each package its budget in lines of code, and for each figure its target. Until
one is reached, its ceiling is what stood when it was last written, which
`tests/repository/test_architecture.py` lets only fall, and `--write` refuses to raise.

The peers are pink and mujoco.sysid, where they are installed (seaid[peers]). Complexity is
McCabe's as radon counts it: conditions and comprehensions included. All figures of 25 November are
counts of this script on the last commit of that day.
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.benchmarks.hops import hops
from scripts.short_form import is_quick, sized
from scripts.sources import import_statements, inner_statements, tree_of
from seaid.report import table
from tests.repository.test_language import INSTEAD, dialect, vague_names

Graph = dict[str, set[str]]
ROOT = Path(__file__).resolve().parents[2]
LIMITS = Path(__file__).with_suffix(".toml")
LONG_BODY = 40
"""Lines of a body of a function, without its docstring, above which it counts as long."""


@dataclass(frozen=True)
class Limit:
    """What a figure was on 25 November, what it is to reach, and what it may be until then."""

    before: int
    target: int
    ceiling: int | None = None
    """None once the target is reached."""

    @property
    def most(self) -> int:
        """The largest value that the test accepts."""
        return self.target if self.ceiling is None else self.ceiling


def modules_of(package: str, folder: Path) -> dict[str, Path]:
    """Return the modules of a package by their dotted names."""
    found = {}
    for path in sorted(folder.rglob("*.py")):
        parts = (package, *path.relative_to(folder).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def faces(top: str, folder: Path) -> dict[tuple[str, str], str]:
    """Return which module defines each name of a lazily loaded face: {(package, name): module}."""
    found = {}
    for path in folder.rglob("__init__.pyi"):
        package = ".".join((top, *path.relative_to(folder).parts[:-1]))
        for node in tree_of(path.read_text("utf-8")).body:
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    found[package, alias.name] = f"{package}.{node.module or alias.name}"
    return found


def _at_run_time(nodes: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """Yield the imports that a module makes at run time: not those for types or in functions."""
    for node in nodes:
        if isinstance(node, ast.ImportFrom | ast.Import):
            yield node
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            yield from _at_run_time(node.orelse)
        elif not isinstance(node, ast.FunctionDef):
            yield from _at_run_time(inner_statements(node))


def imported(statements: Iterable[ast.AST], package: str) -> Iterator[tuple[str, str]]:
    """Yield module and name of what statements in a module of a package import."""
    for node in statements:
        if isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1]
            module = ".".join(
                [*above, *filter(None, [node.module])] if node.level else [str(node.module)]
            )
            yield from ((module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)


def import_graph(top: str, folder: Path) -> Graph:
    """Return the modules that each module imports at run time, through the faces of packages."""
    return _graph(top, folder, lambda text: _at_run_time(tree_of(text).body))


def _graph(top: str, folder: Path, statements: Callable[[str], Iterable[ast.AST]]) -> Graph:
    modules, face = modules_of(top, folder), faces(top, folder)
    lazy = {package for package, _ in face}
    graph: Graph = {}
    for name, path in modules.items():
        package = name if path.stem == "__init__" else name.rpartition(".")[0]
        graph[name] = set()
        for module, attribute in imported(statements(path.read_text("utf-8")), package):
            while (module, attribute) in face:
                module = face[module, attribute]
            graph[name] |= {one for one in (module, f"{module}.{attribute}") if one in modules}
        graph[name] -= {name, *lazy}
    return graph


def complete_graph(top: str, folder: Path) -> Graph:
    """Return the modules that each module imports anywhere, for types and in functions too."""
    return _graph(top, folder, import_statements)


def longest_chain(graph: Graph) -> int:
    """Return the number of modules in the longest chain of imports; a cycle ends it."""
    depths: dict[str, int] = {}

    def depth(name: str) -> int:
        if name not in depths:
            depths[name] = 0
            depths[name] = 1 + max(map(depth, graph[name]), default=0)
        return depths[name]

    return max(map(depth, graph))


def in_cycles(graph: Graph) -> int:
    """Return the number of modules that import themselves by way of others."""

    def reached(name: str) -> set[str]:
        found: set[str] = set()
        ahead = set(graph[name])
        while ahead:
            found |= ahead
            ahead = set().union(*(graph[one] for one in ahead)) - found
        return found

    return sum(name in reached(name) for name in graph)


def docstrings_of(tree: ast.Module) -> set[int]:
    """Return the numbers of the lines of all strings that are statements, as docstrings are."""
    lines: set[int] = set()
    ahead: list[ast.AST] = [tree]
    while ahead:
        for node in inner_statements(ahead.pop()):
            if isinstance(node, ast.Expr):
                if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
                    lines.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
            else:
                ahead.append(node)
    return lines


def lines_of(path: Path) -> Counter[str]:
    """Return how many lines of a file are code, documentation (docstrings), comments or blank."""
    text = path.read_text("utf-8")
    documented = docstrings_of(tree_of(text))
    kinds: Counter[str] = Counter()
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        if number in documented:
            kinds["documentation"] += 1
        elif line.startswith("#"):
            kinds["comments"] += 1
        else:
            kinds["code" if line else "blank"] += 1
    return kinds


def all_lines(paths: Iterable[Path]) -> Counter[str]:
    """Return the lines of files by their kind."""
    return sum(map(lines_of, paths), Counter())


def lines_of_packages(folder: Path) -> dict[str, int]:
    """Return {package: lines of code}, with "root" for the modules in no package."""
    lines: Counter[str] = Counter()
    for path in folder.rglob("*.py"):
        package, *within = path.relative_to(folder).parts
        lines[package if within else "root"] += lines_of(path)["code"]
    return dict(lines)


def long_bodies(paths: Iterable[Path]) -> dict[str, int]:
    """Return {function: lines of its body} of those longer than 40 lines without docstring."""
    lengths = {}
    for path in paths:
        for function in functions_of(path):
            first = function.body[ast.get_docstring(function, clean=False) is not None :]
            length = (function.end_lineno or 0) - first[0].lineno + 1 if first else 0
            if length > LONG_BODY:
                lengths[f"{path.name}:{function.lineno} {function.name}"] = length
    return lengths


def functions_of(path: Path) -> Iterator[ast.FunctionDef]:
    """Yield all functions of a file, those within classes and functions too."""
    ahead: list[ast.AST] = [tree_of(path.read_text("utf-8"))]
    while ahead:
        for node in inner_statements(ahead.pop()):
            ahead.append(node)
            if isinstance(node, ast.FunctionDef):
                yield node


def fixed_numbers(paths: Iterable[Path]) -> int:
    """Return how many numbers stand in the assignments at the level of modules."""
    return sum(
        isinstance(part, ast.Constant) and type(part.value) in (int, float)
        for path in paths
        for node in tree_of(path.read_text("utf-8")).body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for part in ast.walk(node.value)
    )


def places_of_findings(paths: Iterable[Path]) -> list[tuple[str, str]]:
    """Return (module, code or variable) of each call that makes a finding."""
    return [
        (path.stem, ast.unparse(node.func.value).rpartition(".")[2])
        for path in paths
        for node in ast.walk(tree_of(path.read_text("utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in ("finding", "wrong", "note")
    ]


_BRANCHES = (ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler, ast.Assert, ast.match_case)


def complexities(paths: Iterable[Path]) -> dict[str, int]:
    """Return the cyclomatic complexity (McCabe 1976) of all functions of files, as radon counts it.

    One, and one more for each branch, loop, condition of a comprehension, and operand of `and` or
    `or`; those of functions within a function count in both.
    """
    found = {}
    for path in paths:
        for function in functions_of(path):
            count = sum(map(_branches, ast.walk(function)))
            found[f"{path.name}:{function.lineno} {function.name}"] = 1 + count
    return found


def _branches(node: ast.AST) -> int:
    if isinstance(node, ast.BoolOp):
        return len(node.values) - 1
    if isinstance(node, ast.comprehension):
        return 1 + len(node.ifs)
    return int(isinstance(node, _BRANCHES))


def figures_of(name: str, folder: Path) -> dict[str, float]:
    """Return the figures of a package by their names in the table."""
    modules = modules_of(name, folder)
    graph, complete = import_graph(name, folder), complete_graph(name, folder)
    lines, counts = all_lines(modules.values()), complexities(modules.values()).values()
    importers = [sum(module in others for others in graph.values()) for module in graph]
    return {
        "lines of code": lines["code"],
        "functions of complexity over 10": sum(count > 10 for count in counts),
        "functions of complexity over 15": sum(count > 15 for count in counts),
        "bodies of more than 40 lines": len(long_bodies(modules.values())),
        "numbers at module level": fixed_numbers(modules.values()),
        "modules in cycles of imports, with those for types": in_cycles(complete),
        "share of comments": lines["comments"] / lines.total(),
        "share of docstrings": lines["documentation"] / lines.total(),
        "lines": lines.total(),
        "modules": len(modules),
        "modules with one importer": sum(count == 1 for count in importers),
        "longest chain of imports": longest_chain(graph),
        "modules in cycles of imports at run time": in_cycles(graph),
    }


@cache
def figures_of_seaid() -> dict[str, float]:
    """Return the figures of seaid."""
    return figures_of("seaid", ROOT / "seaid")


def limits(table_name: str) -> dict[str, Limit]:
    """Return the limits of one table of house.toml, "packages" or "figures", by their names."""
    rows = tomllib.loads(LIMITS.read_text("utf-8"))[table_name]
    return {name: Limit(**row) for name, row in rows.items()}


def standing() -> dict[str, float]:
    """Return what stands today of all that has a limit; packages that share a budget are added."""
    lines = lines_of_packages(ROOT / "seaid")
    figures = figures_of_seaid()
    return {
        **{name: sum(lines[one] for one in name.split(" + ")) for name in limits("packages")},
        **{name: figures[name] for name in limits("figures")},
    }


def with_ceilings(text: str, standing: Mapping[str, float]) -> str:
    """Return the text of house.toml with ceilings that are what stands, none where it is reached.

    A figure above its limit raises ValueError: a ceiling only falls.
    """
    rows = tomllib.loads(text)
    for name, row in {**rows["packages"], **rows["figures"]}.items():
        value, limit = standing[name], Limit(**row)
        if value > limit.most:
            raise ValueError(f"{name}: {value:,} is above its limit of {limit.most:,}")
        ending = f", ceiling = {value}" if value > limit.target else ""
        entry = re.compile(rf'^("?{re.escape(name)}"? = {{[^}}]*?)(, ceiling = \d+)?( }})', re.M)
        text = entry.sub(rf"\g<1>{ending}\g<3>", text)
    return text


def shown(value: float) -> str:
    """Return a figure as text: a share in per cent, a number with its thousands."""
    return f"{value:.1%}" if isinstance(value, float) else f"{value:,}"


def print_packages() -> None:
    """Print the lines of code of all packages, next to their budgets."""
    stands = standing()
    rows = [
        [name, *map(shown, (limit.before, limit.target, stands[name], limit.most))]
        for name, limit in limits("packages").items()
    ]
    print(table("Lines of code", ["", "25 Nov", "budget", "today", "ceiling"], rows))


OTHER_TARGETS = {
    "lines of code": (50_557, 40_000),
    "share of comments": (0.002, 0.02),
    "share of vague identifiers": (0.063, 0.005),
    "lines of tests": (50_055, 38_000),
}
"""{figure: what it was on 25 November, what it is to reach} of those that have no ceiling here."""


def print_figures() -> None:
    """Print the figures of seaid and its peers, next to their targets."""
    names = sized(("seaid", "pink", "mujoco.sysid"), ("seaid",))
    columns: dict[str, dict[str, float]] = {}
    for name in names:
        if name == "seaid":
            vague, variables = vague_names()
            columns[name] = {
                **figures_of_seaid(),
                "share of vague identifiers": vague / variables,
                "lines of tests": all_lines((ROOT / "tests").rglob("*.py")).total(),
            }
            continue
        top = importlib.util.find_spec(name.split(".")[0])
        spec = importlib.util.find_spec(name) if top is not None else None
        if spec is not None and spec.origin is not None:
            columns[name] = figures_of(name, Path(spec.origin).parent)
    aims = {name: (limit.before, limit.target) for name, limit in limits("figures").items()}
    rows = []
    for name in columns["seaid"]:
        aim = {**aims, **OTHER_TARGETS}.get(name)
        values = [shown(figures[name]) if name in figures else "" for figures in columns.values()]
        rows.append([name, *(map(shown, aim) if aim else ("", "")), *values])
    print(table("Figures", ["", "25 Nov", "to reach", *columns], rows))


def main() -> None:
    """Print the tables, or lower the ceilings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help="lower the ceilings of house.toml")
    parser.add_argument("--quick", action="store_true", help="without peers and the run, as tests")
    if parser.parse_args().write:
        try:
            text = with_ceilings(LIMITS.read_text("utf-8"), standing())
        except ValueError as error:
            sys.exit(f"{error}. A ceiling is never raised: make the code smaller.")
        LIMITS.write_text(text, "utf-8")
        return
    print_packages()
    print_figures()
    places = places_of_findings((ROOT / "seaid").rglob("*.py"))
    modules = Counter(code for _, code in set(places) if code.startswith("CODES["))
    print(
        f"\n{len(places)} places in {len({module for module, _ in places})} modules make a finding;"
        f" {sum(count > 1 for count in modules.values())} codes are named in several of them"
        " (25 Nov: 120, 35, 18; to reach: each code in one place)"
    )
    print(f"{len(dialect())} lines have one of {len(INSTEAD)} patterns of replaced words")
    if not is_quick():
        entered, changes, _ = hops()
        print(
            f"identify on the TULip leg enters {len(entered)} files, {changes:,} changes of file"
            " (25 Nov: 51, 16,048; to reach: 28, 3,000)"
        )


if __name__ == "__main__":
    main()
