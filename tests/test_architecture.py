"""How modules stand to each other: one way, each library where it belongs, all of them named."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


SOURCES = {name_of(path): path.read_text() for path in sorted((ROOT / "seaid").rglob("*.py"))}


def imported(nodes: Iterable[ast.AST], within: bool) -> Iterator[str]:
    """Names that a module imports when it is run; those of its functions too if `within`."""
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            yield str(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            yield from imported(node.orelse, within)
        elif within or not isinstance(node, ast.FunctionDef):
            yield from imported(ast.iter_child_nodes(node), within)


def test_no_module_imports_one_that_imports_it() -> None:
    imports = {
        name: {other for other in imported(ast.parse(text).body, False) if other in SOURCES}
        for name, text in SOURCES.items()
    }
    order = list(TopologicalSorter(imports).static_order())
    assert order.index("seaid.robot") < order.index("seaid.identification")


@pytest.mark.parametrize(
    ("library", "places"),
    [
        ("sympy", ("seaid.drivetrain", "seaid.symbolic")),
        ("matplotlib", ("seaid.report",)),
        ("jinja2", ("seaid.report",)),
        ("viser", ("seaid.view",)),
        ("typer", ("seaid.cli",)),
    ],
)
def test_a_library_stays_where_it_belongs(library: str, places: tuple[str, ...]) -> None:
    users = {
        name
        for name, text in SOURCES.items()
        if any(one.split(".")[0] == library for one in imported(ast.parse(text).body, True))
    }
    assert users
    assert {name for name in users if not name.startswith(places)} == set()


def test_every_module_has_its_line_in_the_readme() -> None:
    architecture = (ROOT / "README.md").read_text().split("## Architecture")[1]
    tops = {name.split(".")[1] for name in SOURCES if "." in name} - {"__main__"}
    assert {
        one for one in tops if f"`{one}`" not in architecture and f"`{one}/`" not in architecture
    } == set()


CAN_FAIL = {"cholesky", "cond", "eig", "eigh", "eigvals", "eigvalsh", "inv", "lstsq", "matrix_rank"}
CAN_FAIL |= {"orth", "pinv", "solve", "solve_triangular", "svd", "cho_factor", "det", "slogdet"}

CANNOT_FAIL = {
    # factors that were found before of matrices of four by four; it takes no others
    "seaid.estimation.interior_point": {"cholesky", "eigh", "eigvalsh", "inv", "solve_triangular"},
    "seaid.estimation.feasible": {"eigvalsh"},
    "seaid.estimation.programme": {"inv"},  # of a triangular factor that was found
    "seaid.export.mjcf_bodies": {"det"},  # of three axes; it raises for no numbers
}


def test_what_can_fail_in_numpy_and_scipy_is_called_safely() -> None:
    """No LinAlgError leaves seaid: `safely` says in words what was singular or not finite."""
    found: dict[str, set[str]] = {}
    for name, text in SOURCES.items():
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func).split(".")
            direct = called[-1] in ("solve_triangular", "svd", "lstsq", "pinv") and len(called) == 1
            if called[-1] in CAN_FAIL and ("linalg" in called or direct):
                found.setdefault(name, set()).add(called[-1])
    assert found == CANNOT_FAIL
