"""The limits of a planning problem as SLSQP takes them."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from seaid.arrays import Array
from seaid.excitation.problem import AIM, Problem, curved_use, is_curved, linear_slack


def constraints(problem: Problem, curved: bool = True) -> list[dict[str, Any]]:
    """Return the limits as SLSQP takes them; the `curved` ones as well where there are any."""
    functions = [_remembered(lambda x: linear_slack(problem, x))]
    if curved and is_curved(problem):
        functions.append(_remembered(lambda x: _curved_slack(problem, x)))
    return [
        {
            "type": "ineq",
            "fun": lambda x, function=function: function(x.tobytes())[0],
            "jac": lambda x, function=function: function(x.tobytes())[1],
        }
        for function in functions
    ]


def _curved_slack(problem: Problem, x: Array) -> tuple[Array, Array]:
    use, gradient = curved_use(problem, x)
    return AIM - use, -gradient


def _remembered(function: Callable[[Array], Any]) -> Callable[[bytes], Any]:
    """Return a function of x as bytes that keeps its last result: SLSQP asks for it twice."""
    return lru_cache(maxsize=2)(lambda x: function(np.frombuffer(x)))
