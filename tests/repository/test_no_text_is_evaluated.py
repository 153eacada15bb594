"""No text of a user is run: what could run one does not occur, but where a reason stands here."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from scripts.sources import tree_of

SEAID = Path(__file__).resolve().parents[2] / "seaid"


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

HARMLESS = {"re.compile", "copyreg.pickle"}
"""`copyreg.pickle` says how a robot on a floating base is copied, and loads nothing."""

LAMBDIFY = {
    "drives/functions.py",
    "drives/regressor.py",
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
    "robot/robot_file.py",
    "project/running.py",
    "cli/commands.py",
}
"""Names of seaid's own modules (commands: of a fixed list), of readers listed in `log/readers`, of
three optional packages, and of robots in the list of robot_descriptions; none is of a file."""

LOAD = {"estimation/fitting.py", "project/saved.py"}
"""`np.load` refuses objects unless `allow_pickle` is given, which occurs as False only."""


def words(tree: ast.AST) -> Iterator[str]:
    """Names that a module imports, and what it calls, as `a.b`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from (alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            yield str(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Name | ast.Attribute):
            yield ast.unparse(node)


@cache
def words_of_all() -> dict[str, set[str]]:
    """Return the names of each module, and the ends of a.b.c among them."""
    return {
        place: {
            word.split(".", first)[-1]
            for word in words(tree)
            if word not in HARMLESS
            for first in range(word.count(".") + 1)
        }
        for place, tree in sources().items()
    }


@pytest.mark.parametrize(
    ("name", "places"),
    [
        *((name, set()) for name in sorted(NEVER)),
        ("lambdify", LAMBDIFY),
        ("sympify", SYMPIFY),
        ("ast", PARSE),
        ("import_module", IMPORT_MODULE),
        ("np.load", LOAD),
    ],
)
def test_what_runs_text_does_not_occur_or_has_a_reason(name: str, places: set[str]) -> None:
    """The reason stands next to the places."""
    assert {place for place, found in words_of_all().items() if name in found} == places


@pytest.mark.slow  # 0.7 s
def test_sympify_is_strict_numpy_loads_no_objects_and_ast_parses_only() -> None:
    """By the arguments of every call; the search finds what it should."""
    nodes = [node for tree in sources().values() for node in ast.walk(tree)]
    calls = [node for node in nodes if isinstance(node, ast.Call)]
    strict = [
        {word.arg: ast.unparse(word.value) for word in call.keywords}["strict"]
        for call in calls
        if ast.unparse(call.func).endswith("sympify")
    ]
    assert {*strict} == {"True"}
    keywords = [node for node in nodes if isinstance(node, ast.keyword)]
    pickles = {ast.unparse(one.value) for one in keywords if one.arg == "allow_pickle"}
    assert pickles == {"False"}
    called = {ast.unparse(call.func) for call in calls}
    assert {one for one in called if one.startswith("ast.")} == {"ast.parse"}
    tree = ast.parse("from sympy.parsing.sympy_parser import parse_expr as p\nx = sp.sympify('1')")
    assert {"parse_expr", "sp.sympify"} <= {*words(tree)}
