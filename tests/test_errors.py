"""The errors are of one family, and name what exists."""

import ast
import pickle
import re
from pathlib import Path

import pytest

import seaid
from seaid import errors
from seaid.errors import (
    LogError,
    SeaidError,
    SeaidWarning,
    listed,
    reason_of,
    shortened,
    shown,
    unknown_name,
    visible,
)
from tests.sources import tree_of

KINDS = ("RobotError", "LogError", "ExcitationError", "SymbolicError", "IdentificationError")


@pytest.mark.parametrize("name", KINDS)
def test_every_error_is_a_seaid_error(name: str) -> None:
    assert issubclass(getattr(errors, name), SeaidError)


def test_seaid_error_is_no_builtin_kind_that_code_might_swallow() -> None:
    assert SeaidError.__bases__ == (Exception,)
    assert SeaidWarning.__bases__ == (UserWarning,)


def test_unknown_name_offers_the_nearest_and_lists_all() -> None:
    text = unknown_name("joint", "kne_pitch", ["hip_pitch", "knee_pitch"])
    assert text == (
        "no joint is named 'kne_pitch'; did you mean 'knee_pitch'? allowed: hip_pitch, knee_pitch"
    )


def test_unknown_name_offers_nothing_where_nothing_is_near() -> None:
    assert unknown_name("key", "xyz", ["mass"]) == "no key is named 'xyz'; allowed: mass"


def test_unknown_name_says_none_where_nothing_exists() -> None:
    assert unknown_name("joint", "a", iter(())) == "no joint is named 'a'; allowed: none"


def test_messages_are_bounded_and_without_control_characters() -> None:
    text = str(LogError(f"'a\x1b[31m\x00': {'x' * 10**6} and the end"))
    assert len(text) < 2_100
    assert text.startswith("'a\\x1b[31m\\x00': xxx")
    assert text.endswith("and the end")
    assert str(LogError("two\nlines")) == "two\nlines"
    assert visible("é\t肩") == "é\\t肩"


def test_long_lists_and_names_are_shortened() -> None:
    assert listed(["a", "b"]) == "a, b"
    assert listed(range(100_000), 3) == "0, 1, 2 and 99,997 more"
    assert shortened("x" * 1_000, 10) == "xxxxxxxx …"
    assert shown("a\n" * 1_000, 10) == "'a\\na\\na …"
    assert shown(10**5_000) == "a int too long to show"
    names = [f"column_{k}" for k in range(100_000)]
    text = unknown_name("column", "x" * 100_000, names)
    assert len(text) < 1_000
    assert text.endswith("and 99,940 more")


def test_what_a_library_says_is_one_line() -> None:
    assert reason_of(ValueError("first\nsecond")) == "first"
    assert reason_of(ValueError()) == "ValueError"
    assert reason_of(FileNotFoundError(2, "No such file", "/x")) == "No such file"
    assert reason_of(MemoryError()) == "it requests more memory than is available"
    assert len(reason_of(ValueError("x" * 10_000))) <= 300


NAMED = re.compile(
    r"\b(?:feasible=True|force=True|repair=seaid\.Repairs\(\)|payloads=|known_bodies=|torque_joints="
    r"|joints=|description=|(?:method|estimator)=(?:'\w+'|\"\w+\"|(?=:)))"
)
"""Arguments of the library for which the command line has options."""


def texts(node: ast.AST) -> str:
    strings = [one.value for one in ast.walk(node) if isinstance(one, ast.Constant)]
    return "\n".join(one for one in strings if isinstance(one, str))


@pytest.mark.parametrize(
    "path", sorted(Path(seaid.__file__).parent.rglob("*.py")), ids=lambda path: path.name
)
def test_every_error_carries_the_arguments_that_it_names(path: Path) -> None:
    for node in ast.walk(tree_of(path.read_text())):
        if not isinstance(node, ast.Call) or not node.args:
            continue
        if not ast.unparse(node.func).lower().endswith("error"):
            continue
        carried = "\n".join(map(texts, node.args[1:]))
        for argument in NAMED.findall(texts(node.args[0])):
            assert argument in carried, f"{path}:{node.lineno}: {argument}"


def test_an_error_keeps_its_arguments_on_the_way_from_another_process() -> None:
    error = pickle.loads(pickle.dumps(LogError("move the joints with joints=", "joints=")))
    assert (str(error), error.arguments) == ("move the joints with joints=", ("joints=",))
    assert SeaidError("no argument").arguments == ()
