"""What is derived from an experiment is computed anew where a field that it rests on changes."""

from __future__ import annotations

import ast
import inspect
from dataclasses import fields

from seaid.checks import experiment
from seaid.checks.experiment import Experiment

FIELDS = {field.name for field in fields(Experiment)}


def reads() -> dict[str, set[str]]:
    """Return {method or property: the attributes of the experiment that its source reads}."""
    (tree,) = ast.parse(inspect.getsource(Experiment)).body
    assert isinstance(tree, ast.ClassDef)
    return {
        method.name: {
            node.attr
            for node in ast.walk(method)
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "self"
        }
        for method in tree.body
        if isinstance(method, ast.FunctionDef)
    }


def test_derived_properties_name_all_fields_that_they_rest_on() -> None:
    """Also through other properties: `with_changes` keeps what names no changed field."""
    by_method, undeclared = reads(), dict[str, set[str]]()
    for name, declared in experiment._FIELDS_OF.items():
        reached, waiting = set[str](), [name]
        while waiting:
            attribute = waiting.pop()
            if attribute not in reached:
                reached.add(attribute)
                waiting += by_method.get(attribute, ())
        undeclared[name] = reached & FIELDS - declared
    assert len(undeclared) > 20
    assert {name: missing for name, missing in undeclared.items() if missing} == {}
