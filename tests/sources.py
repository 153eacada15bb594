"""The trees of Python sources, each parsed once for all tests that look at them."""

from __future__ import annotations

import ast
from functools import cache


@cache
def tree_of(source: str) -> ast.Module:
    """Return the tree of a source, which no test changes."""
    return ast.parse(source)
