"""The texts of errors about logs: each is used, with the values that its braces name."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from string import Formatter

import seaid.log
from seaid.log.refusals import REFUSALS, refusal

TEXTS, ARGUMENTS = REFUSALS["texts"], REFUSALS["arguments"]


def calls() -> Iterator[tuple[set[str], set[str | None]]]:
    """Yield the codes of each call of `refusal` in the sources, and the names of its values."""
    for path in Path(seaid.log.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "refusal":
                texts = {x.value for x in ast.walk(node.args[0]) if isinstance(x, ast.Constant)}
                yield {str(x) for x in texts}, {keyword.arg for keyword in node.keywords}


def test_each_text_is_used_with_its_values() -> None:
    used = set[str]()
    for codes, names in calls():
        used |= codes
        for code in codes:
            fields = {field for _, field, *_ in Formatter().parse(TEXTS[code]) if field}
            # ** of a mapping has no name, and may have any of the others.
            assert names - {None} <= fields, code
            assert None in names or names == fields, code
    # The codes of a few calls stand in a variable.
    assert TEXTS.keys() - used <= {"no_memory", "padded"}
    assert used <= TEXTS.keys()


def test_the_arguments_of_an_error_are_named_by_a_text() -> None:
    """The command line puts the names of its options in their place."""
    assert ARGUMENTS.keys() <= TEXTS.keys()
    texts = " ".join(TEXTS.values())
    assert all(argument in texts for arguments in ARGUMENTS.values() for argument in arguments)
    error = refusal("too_short", duration_s=1.0, fewest=10.0, cutoff_hz=2.0)
    assert error.arguments == ("cutoff_hz",)
    assert str(error).startswith("the log is too short: 1 s are fewer than 10 periods")
