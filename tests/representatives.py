"""Cases of a parametrised test of which the first ones represent all in the quick tests."""

from collections.abc import Iterable
from typing import Any

import pytest


def quick_only(cases: Iterable[Any], quick: Iterable[Any]) -> list[Any]:
    """Return the cases as parameters of a test, all slow but for the `quick` ones."""
    kept = list(quick)
    return _marked((case, case in kept) for case in cases)


def quick_first(cases: Iterable[Any], count: int = 1) -> list[Any]:
    """Return the cases as parameters of a test, all but the first `count` of them slow."""
    return _marked((case, number < count) for number, case in enumerate(cases))


def _marked(cases: Iterable[tuple[Any, bool]]) -> list[Any]:
    """Return cases, each with whether it is quick, as parameters of a test."""
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)),
            marks=() if is_quick else pytest.mark.slow,
        )
        for case, is_quick in cases
    ]
