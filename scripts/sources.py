"""The trees of Python sources, each parsed once for all tests that look at them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache


@cache
def tree_of(source: str) -> ast.Module:
    """Return the tree of a source, which no test changes."""
    return ast.parse(source)


def inner_statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the statements within a statement, as imports are; no parts of expressions."""
    for field in ("body", "handlers", "orelse", "finalbody", "cases"):
        yield from getattr(node, field, ())


@cache
def import_statements(source: str) -> tuple[ast.Import | ast.ImportFrom, ...]:
    """Return all imports of a source, those of its functions too."""
    found, ahead = [], [*inner_statements(tree_of(source))]
    while ahead:
        node = ahead.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            found.append(node)
        ahead += inner_statements(node)
    return tuple(found)
