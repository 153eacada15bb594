"""The texts of errors about logs: each is used, with the values that its braces name."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from string import Formatter

import seaid.log
from seaid.log.refusals import REFUSALS, refusal

TEXTS, ARGUMENTS = REFUSALS["texts"], REFUSALS["arguments"]


def nodes() -> Iterator[ast.AST]:
    """Yield the parts of all sources of the package."""
    for path in Path(seaid.log.__file__).parent.rglob("*.py"):
        yield from ast.walk(ast.parse(path.read_text("utf-8")))


def test_each_text_is_used_with_its_values() -> None:
    every = list(nodes())
    assert TEXTS.keys() <= {x.value for x in every if isinstance(x, ast.Constant)}
    calls = [x for x in every if isinstance(x, ast.Call) and ast.unparse(x.func) == "refusal"]
    for call in calls:
        names = {keyword.arg for keyword in call.keywords}
        for code in (x.value for x in ast.walk(call.args[0]) if isinstance(x, ast.Constant)):
            fields = {field for _, field, *_ in Formatter().parse(TEXTS[code]) if field}
            # ** of a mapping has no name, and may have any of the others.
            assert names - {None} <= fields, code
            assert None in names or names == fields, code


def test_the_arguments_of_an_error_are_named_by_a_text() -> None:
    """The command line puts the names of its options in their place."""
    assert ARGUMENTS.keys() <= TEXTS.keys()
    texts = " ".join(TEXTS.values())
    assert all(argument in texts for arguments in ARGUMENTS.values() for argument in arguments)
    error = refusal("too_short", duration_s=1.0, fewest=10.0, cutoff_hz=2.0)
    assert error.arguments == ("cutoff_hz",)
    assert str(error).startswith("the log is too short: 1 s are fewer than 10 periods")
