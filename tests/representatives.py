"""Cases of a parametrised test of which the first ones represent all in the quick tests."""

from collections.abc import Iterable
from typing import Any

import pytest


def quick_only(cases: Iterable[Any], quick: Iterable[Any]) -> list[Any]:
    """Return the cases as parameters of a test, all slow but for the `quick` ones."""
    kept = list(quick)
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)),
            marks=() if case in kept else pytest.mark.slow,
        )
        for case in cases
    ]


def quick_first(cases: Iterable[Any], count: int = 1) -> list[Any]:
    """Return the cases as parameters of a test, all but the first `count` of them slow."""
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)),
            marks=pytest.mark.slow if number >= count else (),
        )
        for number, case in enumerate(cases)
    ]
