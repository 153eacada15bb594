"""No text of a user is run: what could run one does not occur, but where a reason stands here."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.sources import tree_of

SEAID = Path(__file__).resolve().parents[1] / "seaid"


@cache
def sources() -> dict[str, ast.Module]:
    """Return the trees of all modules."""
    return {
        path.relative_to(SEAID).as_posix(): tree_of(path.read_text("utf-8"))
        for path in sorted(SEAID.rglob("*.py"))
    }


NEVER = {
    *("eval", "exec", "compile", "__import__", "execfile", "parse_expr", "pickle", "cPickle"),
    *("_pickle", "dill", "cloudpickle", "joblib.load", "marshal", "shelve", "literal_eval"),
    *("yaml", "runpy", "os.system", "os.popen", "sp.S", "sympy.S"),
}
"""Names that must not be called or imported."""

LAMBDIFY = {
    "drives/functions.py",
    "drives/regressor.py",
    "drives/equations.py",
    "regressor/random_instants.py",
    "symbolic/independence.py",
}
"""sympy writes source of expressions that seaid built: of its own symbols, of rationals, and of
names that `symbolic/expression_text.py` let through, which are ASCII words and no keywords."""

SYMPIFY = {"symbolic/from_sympy.py"}
"""Strict: a sympy expression given by a caller of the library; a text is refused."""

PARSE = {"symbolic/expression_text.py"}
"""`ast.parse` makes a tree and runs nothing."""

IMPORT_MODULE = {
    "log/readers/table.py",
    "log/readers/child_process.py",
    "robot/robot_file.py",
    "project/running.py",
    "cli/commands.py",
}
"""Names of seaid's own modules (commands: of a fixed list), of readers listed in `log/readers`, of
three optional packages, and of robots in the list of robot_descriptions; none is of a file."""

LOAD = {"log/readers/child_process.py", "estimation/fitting.py"}
"""`np.load` refuses objects unless `allow_pickle` is given, which occurs as False only."""


def words(tree: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Names that a module imports, and what it calls, as `a.b`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield str(node.module), node
            yield from ((f"{node.module}.{alias.name}", node) for alias in node.names)
            yield from ((alias.name, node) for alias in node.names)
        elif isinstance(node, ast.Name | ast.Attribute):
            yield dotted(node), node


def dotted(node: ast.expr) -> str:
    """Return a name as `a.b`; what is no name is `?`."""
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else "?"


@cache
def words_of_all() -> dict[str, set[str]]:
    """The names of each module."""
    return {place: {word for word, _ in words(tree)} for place, tree in sources().items()}


def users(name: str) -> set[str]:
    """Modules with a name, plain or as the last part of a.b."""
    return {
        place
        for place, found in words_of_all().items()
        if any(word == name or word.endswith(f".{name}") for word in found)
    }


def calls(name: str) -> Iterator[ast.Call]:
    for tree in sources().values():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and dotted(node.func).split(".")[-1] == name:
                yield node


@pytest.mark.slow  # 0.5 s
@pytest.mark.parametrize("name", sorted(NEVER))
def test_what_runs_text_does_not_occur(name: str) -> None:
    # `copyreg.pickle` says how a robot on a floating base is copied, and loads nothing.
    allowed = {"compile": {"re.compile"}, "pickle": {"copyreg.pickle"}}.get(name, set())
    uses = {
        f"{place}: {word}"
        for place, found in words_of_all().items()
        for word in found
        if (word == name or word.endswith(f".{name}")) and word not in allowed
    }
    assert uses == set()


@pytest.mark.parametrize(
    ("name", "places"),
    [
        ("lambdify", LAMBDIFY),
        ("sympify", SYMPIFY),
        ("ast", PARSE),
        ("import_module", IMPORT_MODULE),
        ("np.load", LOAD),
    ],
)
def test_what_could_run_text_occurs_for_a_reason(name: str, places: set[str]) -> None:
    assert users(name) == places


@pytest.mark.slow  # 0.7 s
def test_sympify_is_strict_and_numpy_loads_no_objects() -> None:
    given = [{k.arg: k.value for k in call.keywords} for call in calls("sympify")]
    assert given
    assert all(ast.unparse(one["strict"]) == "True" for one in given)
    everywhere = [k for tree in sources().values() for k in ast.walk(tree)]
    pickles = [k for k in everywhere if isinstance(k, ast.keyword) and k.arg == "allow_pickle"]
    assert pickles
    assert all(ast.unparse(one.value) == "False" for one in pickles)


def test_ast_is_used_to_parse_and_to_look_only() -> None:
    tree = sources()["symbolic/expression_text.py"]
    called = {ast.unparse(n.func) for n in ast.walk(tree) if isinstance(n, ast.Call)}
    assert {one for one in called if one.startswith("ast.")} == {"ast.parse"}


def test_the_search_finds_what_it_should() -> None:
    tree = ast.parse("from sympy.parsing.sympy_parser import parse_expr as p\nx = sp.sympify('1')")
    found = {word for word, _ in words(tree)}
    assert {"parse_expr", "sp.sympify"} <= found
