"""How easy the house is to move into: modules, lines, imports and complexity, next to its peers.

    python -m scripts.benchmarks.house

The peers are pink and mujoco.sysid, where they can be imported. Complexity is McCabe's as radon
counts it: conditions and comprehensions included.
"""

from __future__ import annotations

import ast
import importlib.util
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.benchmarks.hops import hops
from scripts.short_form import sized
from seaid.report.text import table
from tests.sources import inner_statements, tree_of
from tests.test_language import INSTEAD, dialect, vague_names

Graph = dict[str, set[str]]


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


def imported(nodes: Iterable[ast.AST], package: str) -> Iterator[tuple[str, str]]:
    """Yield module and name of run-time imports: not those for types or inside functions."""
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1]
            module = ".".join(
                [*above, *filter(None, [node.module])] if node.level else [str(node.module)]
            )
            yield from ((module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            yield from imported(node.orelse, package)
        elif not isinstance(node, ast.FunctionDef):
            yield from imported(inner_statements(node), package)


def import_graph(top: str, folder: Path) -> Graph:
    """Return the modules that each module imports at run time, through the faces of packages."""
    modules, face = modules_of(top, folder), faces(top, folder)
    lazy = {package for package, _ in face}
    graph: Graph = {}
    for name, path in modules.items():
        package = name if path.stem == "__init__" else name.rpartition(".")[0]
        graph[name] = set()
        for module, attribute in imported(tree_of(path.read_text("utf-8")).body, package):
            while (module, attribute) in face:
                module = face[module, attribute]
            graph[name] |= {one for one in (module, f"{module}.{attribute}") if one in modules}
        graph[name] -= {name, *lazy}
    return graph


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


def lines_of(paths: Iterable[Path]) -> tuple[int, int, int]:
    """Return the lines of files: all, those of docstrings, those of comments."""
    everything = documented = comments = 0
    for path in paths:
        text = path.read_text("utf-8")
        everything += len(text.splitlines())
        comments += sum(line.lstrip().startswith("#") for line in text.splitlines())
        for node in ast.walk(tree_of(text)):
            body = getattr(node, "body", None)
            first = body[0] if isinstance(body, list) and body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                documented += (first.end_lineno or first.lineno) - first.lineno + 1
    return everything, documented, comments


_BRANCHES = (ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler, ast.Assert, ast.match_case)


def complexities(paths: Iterable[Path]) -> dict[str, int]:
    """Return the cyclomatic complexity (McCabe 1976) of all functions of files, as radon counts it.

    One, and one more for each branch, loop, condition of a comprehension, and operand of `and` or
    `or`; those of functions within a function count in both.
    """
    found = {}
    for path in paths:
        for function in ast.walk(tree_of(path.read_text("utf-8"))):
            if isinstance(function, ast.FunctionDef):
                count = sum(map(_branches, ast.walk(function)))
                found[f"{path.name}:{function.lineno} {function.name}"] = 1 + count
    return found


def _branches(node: ast.AST) -> int:
    if isinstance(node, ast.BoolOp):
        return len(node.values) - 1
    if isinstance(node, ast.comprehension):
        return 1 + len(node.ifs)
    return int(isinstance(node, _BRANCHES))


def column(name: str, folder: Path) -> list[str]:
    """Return the figures of a package, in the order of `ROWS`."""
    modules, graph = modules_of(name, folder), import_graph(name, folder)
    everything, documented, comments = lines_of(modules.values())
    importers = [sum(one in others for others in graph.values()) for one in graph]
    counts = complexities(modules.values()).values()
    return [
        f"{len(modules)}",
        f"{everything:,}",
        f"{everything - documented:,}",
        f"{documented / everything:.0%}",
        f"{comments}",
        f"{sum(one == 1 for one in importers)}",
        f"{longest_chain(graph)}",
        f"{in_cycles(graph)}",
        *(str(sum(count > most for count in counts)) for most in (10, 15)),
    ]


ROWS = (
    *("modules", "lines", "lines without docstrings", "docstrings", "lines of comments"),
    *("modules with one importer", "longest chain of imports", "modules in cycles of imports"),
    *("functions of complexity over 10", "over 15"),
)


def main() -> None:
    """Print the table."""
    names = sized(("seaid", "pink", "mujoco.sysid"), ("seaid.estimation",))
    columns = {}
    for name in names:
        top = importlib.util.find_spec(name.split(".")[0])
        found = importlib.util.find_spec(name) if top is not None else None
        if found is not None and found.origin is not None:
            columns[name] = column(name, Path(found.origin).parent)
    rows = [[row, *(one[place] for one in columns.values())] for place, row in enumerate(ROWS)]
    print(table("The house", ["", *columns], rows))
    entered, changes = hops()
    words = len(dialect())
    print(
        f"\n{words} lines of seaid have one of {len(INSTEAD)} patterns of words that were replaced"
    )
    vague, count = vague_names()
    print(f"{vague} of {count:,} variables have a vague name ({vague / count:.1%})")
    print(f"identify on the TULip leg enters {len(entered)} files, {changes:,} changes of file")


if __name__ == "__main__":
    main()
