"""The errors are of one family, and name what exists."""

import ast
import pickle
import re
from pathlib import Path

import pytest

import seaid
from scripts.sources import tree_of
from seaid import errors


def test_every_error_is_a_seaid_error_and_keeps_its_arguments() -> None:
    """It is no kind of Python's own, which code might swallow, and comes from other processes."""
    assert errors.SeaidError.__bases__ == (Exception,)
    assert errors.SeaidWarning.__bases__ == (UserWarning,)
    for kind in (
        errors.RobotError,
        errors.LogError,
        errors.ExcitationError,
        errors.SymbolicError,
        errors.IdentificationError,
    ):
        assert issubclass(kind, errors.SeaidError)
        first = kind("no joint moves", "joints=", advice="move some with joints=")
        error = pickle.loads(pickle.dumps(first)).at("leg")
        assert isinstance(error, kind)
        assert str(error) == "leg: no joint moves; move some with joints="
        assert (error.reason, error.arguments) == ("leg: no joint moves", ("joints=",))


NAMES = ["hip_pitch", "knee_pitch"]
LONG, MANY = "x" * 100_000, [f"column_{k}" for k in range(100_000)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            errors.unknown_name("joint", "kne_pitch", NAMES),
            "no joint is named 'kne_pitch'; did you mean 'knee_pitch'? allowed: hip_pitch, "
            "knee_pitch",
        ),
        (errors.unknown_name("key", "xyz", ["mass"]), "no key is named 'xyz'; allowed: mass"),
        (errors.unknown_name("joint", "a", iter(())), "no joint is named 'a'; allowed: none"),
        (errors.unknown_name("column", LONG, MANY)[-15:], "and 99,940 more"),
        (errors.listed(["a", "b"]), "a, b"),
        (errors.listed(range(100_000), 3), "0, 1, 2 and 99,997 more"),
        (errors.shortened(LONG, 10), "xxxxxxxx …"),
        (errors.shortened("a\x1b[31m\nb"), r"a\x1b[31m\nb"),
        (errors.shown("a\n" * 1_000, 10), "'a\\na\\na …"),
        (errors.shown([1, "a"]), "[1, 'a']"),
        (errors.shown(10**5_000), "a int too long to show"),
        (errors.visible("é\t肩"), "é\\t肩"),
        (errors.reason_of(ValueError("first\nsecond")), "first"),
        (errors.reason_of(ValueError()), "ValueError"),
        (errors.reason_of(FileNotFoundError(2, "No such file", "/x")), "No such file"),
        (errors.reason_of(MemoryError()), "it requests more memory than is available"),
    ],
)
def test_what_a_message_shows_is_short_and_printable(text: str, expected: str) -> None:
    """Names of users, lists, values and the words of libraries."""
    assert text == expected
    assert len(errors.unknown_name("column", LONG, MANY)) < 1_600
    assert errors.unknown_name("joint", "kn\u202ee", NAMES).isprintable()
    assert len(errors.reason_of(ValueError(LONG))) <= 300


def test_messages_are_bounded_and_without_control_characters() -> None:
    text = str(errors.LogError(f"'a\x1b[31m\x00': {'x' * 10**6} and the end"))
    assert len(text) < 2_100
    assert text.startswith("'a\\x1b[31m\\x00': xxx")
    assert text.endswith("and the end")
    assert str(errors.LogError("two\nlines")) == "two\nlines"


NAMED = re.compile(
    r"\b(?:feasible=True|force=True|repair=seaid\.Repairs\(\)|payloads=|known_bodies=|torque_joints="
    r"|joints=|description=|imu_link=|(?:method|estimator)=(?:'\w+'|\"\w+\"|(?=:)))"
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
        advice = [keyword.value for keyword in node.keywords if keyword.arg == "advice"]
        said = "\n".join(map(texts, (node.args[0], *advice)))
        for argument in NAMED.findall(said):
            assert argument in carried, f"{path}:{node.lineno}: {argument}"
