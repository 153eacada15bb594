"""The texts of errors: each is used, with the values that its braces name."""

from __future__ import annotations

import ast
from pathlib import Path
from string import Formatter
from typing import Any

import pytest

from seaid.log import channels
from seaid.log.channels import Refusals
from seaid.project import project

TABLES = [
    pytest.param(channels.refusal, channels, id="log"),
    pytest.param(project.refusal, project, id="project"),
]


@pytest.mark.parametrize(("refusal", "module"), TABLES)
def test_each_text_is_used_with_its_values(refusal: Refusals[Any], module: Any) -> None:
    nodes = [
        node
        for path in Path(module.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
    ]
    assert refusal.texts.keys() <= {x.value for x in nodes if isinstance(x, ast.Constant)}
    calls = [x for x in nodes if isinstance(x, ast.Call) and ast.unparse(x.func) == "refusal"]
    for call in calls:
        names = {keyword.arg for keyword in call.keywords}
        for code in (x.value for x in ast.walk(call.args[0]) if isinstance(x, ast.Constant)):
            text = refusal.texts[str(code)]
            fields = {field for _, field, *_ in Formatter().parse(text) if field}
            # ** of a mapping has no name, and may have any of the others.
            assert names - {None} <= fields, code
            assert None in names or names == fields, code


@pytest.mark.parametrize(("refusal", "module"), TABLES)
def test_the_arguments_of_an_error_are_named_by_a_text(refusal: Refusals[Any], module: Any) -> None:
    """The command line puts the names of its options in their place."""
    assert refusal.arguments.keys() <= refusal.texts.keys()
    texts = " ".join(refusal.texts.values())
    assert all(argument in texts for x in refusal.arguments.values() for argument in x)


def test_an_error_has_the_text_of_its_code_with_values() -> None:
    error = channels.refusal("too_short", duration_s=1.0, fewest=10.0, cutoff_hz=2.0)
    assert error.arguments == ("cutoff_hz",)
    assert str(error).startswith("the log is too short: 1 s are fewer than 10 periods")
